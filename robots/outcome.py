"""Results of simulating a robot in a world: measures, gradients, motions, and their pictures in reports."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.foreign import method_of, returned
from taichi_sim.base.short_text import ShortText, decimal

if TYPE_CHECKING:
    from collections.abc import Callable

    from robots.view.motion import Motion

OK, DIVERGED, INVALID = "ok", "diverged", "invalid"


@dataclass(frozen=True)
class Quantity:
    """A number with its unit, in a row of a report."""

    value: float
    unit: str = ""
    digits: int = 4


Facts = Sequence[tuple[str, "str | Quantity"]]  # rows of a report: what, and its value


@dataclass(frozen=True)
class Measure:
    """A number by which a robot is judged; an objective says whether more or less of it is wanted.

    Attributes:
        name: name of the measure, such as ``speed``.
        unit: unit of its values, such as ``BL/s``; empty for a plain number.
        title: title of the measure for people; the name if empty.
    """

    name: str
    unit: str = ""
    title: str = ""

    @property
    def spoken(self) -> str:
        """Title of the measure for people."""
        return self.title or self.name.replace("_", " ")

    def value(self, number: float) -> str:
        """Write a value with name and unit, such as ``speed 0.1234 m/s``."""
        return f"{self.name.replace('_', ' ')} {decimal(number)} {self.unit}".rstrip()


class World(Protocol):
    """Interface of worlds in which robots are simulated, such as terrains: descriptions that never change."""

    @property
    def name(self) -> str:
        """Name of the world in options and files, such as ``hill:15``."""

    @property
    def spoken(self) -> str:
        """Text to follow a robot's name, such as ``up a slope of 15°``; may be empty."""
        return ""

    @property
    def where(self) -> str:
        """Text to follow the name of a motion, such as ``on hill:15``; may be empty."""
        return ""


@dataclass(frozen=True)
class Place:
    """A world that has only a name, for kinds with a single world."""

    name: str = "world"
    spoken: str = ""
    where: str = ""


@dataclass(frozen=True, eq=False, repr=False)
class Outcome(ShortText):
    """Result of simulating a robot at N points in one world: measures, status, gradients and frames.

    Attributes:
        measures: values by the names of the robot's measures, shape (N,) each; NaN where the status is not ``"ok"``.
        status: ``"ok"``, ``"diverged"``, or ``"invalid"`` where a point is no robot, shape (N,). By default
            ``"diverged"`` where a measure is not finite.
        reason: why a point is no robot, shape (N,); empty for the others.
        steps: time steps simulated, shape (N,); 0 where the kind does not count them.
        gradients: derivatives of measures by the P parameters, by name of the measure, shape (N, P) each; only those
            that were asked for.
        frames: recorded arrays by name, if recording was asked for.
        result: the kind's own result, for its motions and pictures.
    """

    measures: Mapping[str, Floats]
    status: NDArray[np.str_] = ()  # type: ignore[assignment]
    reason: NDArray[np.str_] = ()  # type: ignore[assignment]
    steps: Ints = ()  # type: ignore[assignment]
    gradients: Mapping[str, Floats] = field(default_factory=dict)
    frames: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    result: Any = None

    def __post_init__(self) -> None:
        measures = {name: np.atleast_1d(_real(f"measures of {name}", each)) for name, each in self.measures.items()}
        shapes = {values.shape for values in measures.values()}
        if len(shapes) != 1 or len(shape := shapes.pop()) != 1:
            told = ", ".join(f"{name} {values.shape}" for name, values in measures.items()) or "none"
            raise TypeError(
                f"measures of shapes {told} are not allowed; an Outcome has one number of each for each point"
            )
        (count,) = shape
        whole = np.all([np.isfinite(values) for values in measures.values()], axis=0)
        status = np.array(self.status if len(self.status) else np.where(whole, OK, DIVERGED), dtype=object)
        if status.shape != (count,):
            raise TypeError(f"status of shape {status.shape} is not allowed; give ({count},), one for each point")
        status[(status == OK) & ~whole] = DIVERGED
        for values in measures.values():
            values[status != OK] = np.nan
        gradients = {name: _real(f"gradients of {name}", slopes) for name, slopes in self.gradients.items()}
        for name, slopes in gradients.items():
            if slopes.ndim != 2 or len(slopes) != count:
                raise TypeError(
                    f"gradients of {name} of shape {slopes.shape} are not allowed; give ({count}, parameters)"
                )
            slopes[status != OK] = np.nan
        blank = {"reason": np.full(count, ""), "steps": np.zeros(count, np.int64)}
        object.__setattr__(self, "measures", measures)
        object.__setattr__(self, "status", status.astype(str))
        object.__setattr__(self, "gradients", gradients)
        for name, nothing in blank.items():
            object.__setattr__(self, name, np.array(getattr(self, name)) if len(getattr(self, name)) else nothing)

    @property
    def status_or_reason(self) -> NDArray[np.str_]:
        """Status of each point, or the reason why it is no robot, shape (N,)."""
        return np.where(self.reason == "", self.status, self.reason)


def _real(what: str, given: Any) -> Floats:
    """Numbers as an array of their own; a TypeError for complex ones, of which a part would be lost."""
    if np.iscomplexobj(given):
        raise TypeError(f"{what} are complex, which is not allowed; give real numbers")
    return np.array(given, float)


def checked_outcome(
    given: object, who: object, measures: Sequence[Measure], shape: tuple[int, ...], asked: Sequence[str] = ()
) -> Outcome:
    """What a robot's ``run`` gave, if it is an outcome of the points that it was given.

    Args:
        given: by ``run``.
        who: the robot.
        measures: that it shall have.
        shape: of the points, (N, P).
        asked: measures whose gradients were asked for.

    Raises:
        ValueError: for something else, a measure that is missing, and arrays of other points or parameters.
    """
    run = f"robot: {method_of(who, 'run')}"
    outcome = returned(given, Outcome, run, "an Outcome")
    for name in (measure.name for measure in measures):
        if name not in outcome.measures:
            has = ", ".join(outcome.measures)
            raise ValueError(f"{run} returns an Outcome without the measure {name}; it has {has}")
    arrays = {**outcome.measures, "status": outcome.status, "reason": outcome.reason, "steps": outcome.steps}
    slopes = {name: outcome.gradients[name] for name in asked if name in outcome.gradients}
    for wanted, found in ((shape[:1], arrays), (shape, slopes)):
        for name, values in found.items():
            if values.shape != wanted:
                what = name if found is arrays else f"a gradient of {name}"
                raise ValueError(f"{run} returns {what} of shape {values.shape}; give {wanted} for points of {shape}")
    return outcome


def checked_motion(given: object, who: object) -> "Motion":
    """What a robot's ``motion`` gave, if it is a motion.

    Raises:
        ValueError: for something else.
    """
    from robots.view.motion import Motion  # which imports the engines

    return returned(given, Motion, f"robot: {method_of(who, 'motion')}", "a Motion")


def recorded(frames: object | None) -> dict[str, NDArray[Any]]:
    """Frames of an engine's result, a dataclass of arrays, by name; none if nothing was recorded."""
    return {} if frames is None else dict(vars(frames))


@dataclass(frozen=True, eq=False, repr=False)
class Replay(ShortText):
    """A recorded simulation of one design: its outcome, the motion of the robot, and the title of its picture."""

    outcome: Outcome
    motion: "Motion"
    title: str = ""


@dataclass(frozen=True)
class Picture:
    """A picture of a design, for reports.

    Attributes:
        words: description of the picture, for people who see it and who do not.
        draw: function that draws it on matplotlib axes.
        size: width and height [inches].
        style: how pages lay it out: ``""``, ``"medium"``, ``"narrow"``, or those followed by ``" screen-only"`` or
            ``" print-only"``.
    """

    words: str
    draw: "Callable[[Any], None]"
    size: tuple[float, float] = (3.7, 2.5)
    style: str = ""


@dataclass(frozen=True)
class Judgement:
    """Judgement of how far a design can be trusted, as text for people and values for machines."""

    text: str
    document: Mapping[str, Any]
    failed: bool = False
