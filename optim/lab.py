"""Simulate, differentiate and view a robot in one call: the functions behind ``import morpholab as ml``."""

import html
import warnings
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass, field
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from optim.doubts import chaos_in, doubts_after
from optim.interrupts import CTRL_C, EndedBySignals
from optim.named import Designs, of_run, points_of, robot, run_in, world
from optim.notebook_tables import MOST_ROWS, data_frame, html_table
from optim.problems import precision_of_run
from optim.progress import Update, shown_progress
from optim.runs.config import read_config
from robots.robot import KINDS, OK, Measure, Outcome, Replay, Robot, World, warn_of_doubts
from taichi_sim.base.arrays import Floats, copied, fixed
from taichi_sim.base.checks import nearest, whole_number
from taichi_sim.base.compute import Compute, ComputeOptions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from robots.view.player import Player

POSES = 100  # recorded of a single design, so that its picture costs no second run
DOTS_PER_INCH = 110


@dataclass(frozen=True, eq=False, repr=False)
class Trials:
    """Results of simulating N designs of a robot, as :func:`simulate` and :func:`differentiate` return them.

    ``trials["speed"]`` gives the values of a measure, shape (N,), NaN for designs that failed; an unknown name raises a
    KeyError. Notebooks show a table of the designs, and a picture of a single one.

    Attributes:
        robot: the robot, whose P parameters differ from design to design.
        points: the designs: values of the parameters, shape (N, P), in the order of ``robot.parameters``.
        world: where the designs were simulated.
        outcome: measures, status and gradients of the designs.
        compute: device, precision and threads of the simulation.
    """

    robot: Robot
    points: Floats
    world: World
    outcome: Outcome
    compute: Compute
    _replays: dict[int, Replay] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", fixed(copied(self.points, "points")))

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, name: str) -> Floats:
        """Values of a measure, shape (N,)."""
        known = self.outcome.measures
        if name not in known:
            raise KeyError(f"measure: {name!r} is unknown; there are {', '.join(known)}{nearest(name, list(known))}")
        return known[name].copy()

    __iter__ = None  # they have a length and names, and are neither a list nor a mapping

    def __contains__(self, name: object) -> bool:
        """Whether there is a measure of this name."""
        return name in self.outcome.measures

    def best(self, measure: str | None = None) -> int:
        """Return the number of the design with the highest value of a measure, which is the robot's first by default.

        Raises:
            KeyError: for an unknown measure.
            ValueError: if no design succeeded.
        """
        values = self[measure or self.robot.measures[0].name]
        if np.isnan(values).all():
            raise ValueError(f"designs: none of {len(self)} succeeded; the first: {self.outcome.status_or_reason[0]}")
        return int(np.nanargmax(values))

    def show(self, design: int = 0, *, height: int = 860) -> "Player":
        """Show one design in motion, in an interactive player of ``height`` pixels as :func:`view` makes it.

        Raises:
            ValueError: for a design that is not among these, is no robot, or cannot be shown.
        """
        from robots.view.player import show

        return show(self.replay(design).motion, height=height)

    def plot(self, measure: str | None = None) -> "Figure":
        """Draw a single design in motion, or a measure of all designs, over the parameter if only one varies.

        Raises:
            KeyError: for an unknown measure.
        """
        from robots.view.picture import motion_picture

        if len(self) == 1 and measure is None:
            replay = self.replay()
            return motion_picture(replay.motion, title=replay.title or None)
        return self._curve(measure or self.robot.measures[0].name)

    def to_dataframe(self) -> Any:
        """Return a pandas DataFrame with a row for each design: its parameters, status, measures and derivatives.

        ``attrs["units"]`` tells units by column; those of derivatives are the measure's over the parameter's.

        Raises:
            ValueError: if pandas is not installed.
        """
        units = {parameter.name: parameter.unit for parameter in self.robot.parameters}
        return data_frame(self.columns(), units | {measure.name: measure.unit for measure in self._measures})

    def columns(self) -> dict[str, Any]:
        """Return the columns of the table of designs by name, shape (N,) each.

        They are parameters, status, measures, and derivatives, which are called ``d_MEASURE/d_PARAMETER``.
        """
        names = [parameter.name for parameter in self.robot.parameters]
        slopes = {
            f"d_{measure}/d_{name}": found[:, n]
            for measure, found in self.outcome.gradients.items()
            for n, name in enumerate(names)
        }
        given = dict(zip(names, self.points.T, strict=True))
        told = {**given, "status": self.outcome.status_or_reason, **self.outcome.measures, **slopes}
        return {name: np.array(values) for name, values in told.items()}

    def replay(self, design: int = 0) -> Replay:
        """Simulate one design again to record its motion; a single design has been recorded already.

        Raises:
            ValueError: for a design that is not among these, is no robot, or cannot be shown.
        """
        number = whole_number("design", design, 0, len(self) - 1)
        if number not in self._replays:
            with shown_progress(self._spoken, 1.0) as update:
                again = self.robot.replay(self.points[number], self.world, compute=self.compute, progress=update)
            self._replays[number] = again
        return self._replays[number]

    def centre_of_mass(self, design: int = 0) -> tuple[Floats, Floats]:
        """Return times [s], shape (F,), and places of one design's centre of mass then [m], shape (F, 3).

        They are those of the frames of :meth:`replay`. x and y lie in the ground, also where it slopes.

        Raises:
            ValueError: for a design that is not among these, is no robot, or whose masses are not known.
        """
        motion = self.replay(design).motion
        if not len(motion.centre_of_mass):
            raise ValueError(
                f"centre_of_mass: masses of {self.robot.name} are not known; replay().motion.path is where it is"
            )
        return motion.times, motion.centre_of_mass

    @property
    def _measures(self) -> tuple[Measure, ...]:
        """Measures of the robot in this world."""
        return self.robot.measures_in([self.world])

    @property
    def _spoken(self) -> str:
        return f"{self.robot.name} {self.world.where}".strip()

    @property
    def _numbers(self) -> str:
        """The precision, where it is not the usual one."""
        return "" if self.compute.precision == Compute().precision else f" (in {self.compute.precision})"

    def __repr__(self) -> str:
        fine = self.outcome.status == OK
        if len(self) == 1:
            measures = (
                [m.value(self[m.name][0]) for m in self._measures] if fine[0] else [self.outcome.status_or_reason[0]]
            )
            return f"{self._spoken}: {', '.join(map(str, measures))}{self._numbers}"
        ranges = [
            f"{m.name.replace('_', ' ')} {self[m.name][fine].min():.4g} to {self[m.name][fine].max():.4g} {m.unit}"
            for m in self._measures
            if fine.any()
        ]
        failed = f", {np.count_nonzero(~fine)} failed" if not fine.all() else ""
        told = ", ".join(map(str.strip, ranges)) or "none succeeded"
        return f"{len(self)} designs, {self._spoken}: {told}{failed}{self._numbers}"

    def _repr_html_(self) -> str:
        units = {measure.name: measure.unit for measure in self._measures}
        shown = {
            name: values for name, values in self.columns().items() if len(self.points[0]) <= MOST_ROWS or name in units
        }
        more = f"<p>and {len(self) - MOST_ROWS} more</p>" if len(self) > MOST_ROWS else ""
        table = html_table(shown, units, range(min(len(self), MOST_ROWS)))
        return f"<p>{html.escape(repr(self))}</p>{self._picture()}{table}{more}"

    def _picture(self) -> str:
        """The picture of a single design that was recorded, as HTML."""
        from robots.view.still import figure_content

        if 0 not in self._replays or len(self) > 1:
            return ""
        content = b64encode(figure_content(self.plot(), "png", DOTS_PER_INCH)).decode()
        return f'<img alt="{html.escape(self._spoken)}" src="data:image/png;base64,{content}"/>'

    def _curve(self, name: str) -> "Figure":
        """A measure of each design."""
        from matplotlib.figure import Figure

        values, measure = self[name], next(each for each in self._measures if each.name == name)
        varies = np.flatnonzero(np.ptp(self.points, axis=0))
        figure = Figure(figsize=(6, 3.2), layout="constrained")
        axes = figure.add_subplot()
        if len(varies) == 1:
            parameter = self.robot.parameters[int(varies[0])]
            order = np.argsort(self.points[:, varies[0]])
            axes.plot(self.points[order, varies[0]], values[order], marker="o", ms=3)
            axes.set_xlabel(parameter.name.replace("_", " ") + (f" [{parameter.unit}]" if parameter.unit else ""))
        else:
            axes.plot(np.arange(len(self)), values, marker="o", ms=3, ls="")
            axes.set_xlabel("design")
        axes.set_ylabel(measure.spoken + (f" [{measure.unit}]" if measure.unit else ""))
        axes.set_title(self._spoken, fontsize=10)
        axes.grid(alpha=0.3)
        return figure


def simulate(
    source: str | PathLike[str] | Robot,
    designs: Designs = None,
    where: "str | int | World | None" = None,
    **how: Unpack[ComputeOptions],
) -> Trials:
    """Simulate designs of a robot in a world, as one batch; a single design is recorded, so that it can be shown.

    Args:
        source: a robot, or the name, file or run folder that :func:`robot` makes one from.
        designs: points, shape (N, P) or (P,), which may lie beyond the bounds of a search, where the robot itself has
            none; or values of some parameters by name, each a number or of shape (N,) and within the bounds (an angle
            wraps round), while the others are as at the start; None for the start.
        where: the world or its name; by default the robot's usual one, or the first one of a run.
        how: ``precision`` (of a run its own by default), ``threads`` and ``device``, see :class:`Compute`.

    Raises:
        ValueError: for a value that is not allowed; a design that fails is not an error but has a status.

    Example:
        >>> simulate("vehicle")["closest"].shape
        (1,)
    """
    tried, points, place, compute = _given(source, designs, where, how)
    with EndedBySignals(CTRL_C), shown_progress(f"{tried.name} {place.where}".strip(), 1.0) as update:
        single = None if len(points) > 1 else _recorded(tried, points, place, compute, update)
        outcome = single.outcome if single else tried.simulate(points, place, compute=compute, progress=update)
    for doubt in doubts_after(tried, place, outcome):
        warnings.warn(doubt, stacklevel=2)
    return Trials(tried, points, place, outcome, compute, {0: single} if single else {})


def differentiate(
    source: str | PathLike[str] | Robot,
    designs: Designs = None,
    where: "str | int | World | None" = None,
    *,
    measures: Sequence[str] | str | None = None,
    gradient_horizon: float | None = None,
    **how: Unpack[ComputeOptions],
) -> Trials:
    """Simulate designs like :func:`simulate`, and compute exact derivatives of measures by the robot's parameters.

    Exact derivatives of a long motion with many contacts may say nothing of changes of a useful size. A warning tells
    where they are that large; ``morpholab gradient-check`` measures what they are worth.

    Args:
        source, designs, where, how: see :func:`simulate`.
        measures: names of the measures to differentiate; the robot's first one by default.
        gradient_horizon: time [s] over which they see what a change of shape or speed does, of robots that can tell;
            by default all the time, as exact derivatives do.

    Raises:
        ValueError: if robots of this kind have no gradients, or for a value that is not allowed.
    """
    tried, points, place, compute = _given(source, designs, where, how)
    with EndedBySignals(CTRL_C), shown_progress(f"gradient of {tried.name}", 1.0) as update:
        outcome = tried.differentiate(
            points, place, measures=measures, compute=compute, progress=update, gradient_horizon=gradient_horizon
        )
    found = Trials(tried, points, place, outcome, compute)
    for doubt in chaos_in(tried, points, place, outcome, compute):
        warnings.warn(doubt, stacklevel=2)
    return found


def view(
    source: str | PathLike[str] | Robot,
    design: Designs = None,
    where: "str | int | World | None" = None,
    *,
    height: int = 860,
    **how: Unpack[ComputeOptions],
) -> "Player":
    """Show one design of a robot in motion: an interactive 3-D player that a notebook displays below the cell.

    Args:
        source, design, where, how: see :func:`simulate`; only one design is allowed.
        height: height of the player [px].

    Raises:
        ValueError: for several designs, a robot that cannot be shown, or a value that is not allowed.
    """
    tried, points, place, compute = _given(source, design, where, how)
    if len(points) > 1:
        raise ValueError(f"design: {len(points)} are not allowed; give one")
    from robots.view.player import show

    with shown_progress(f"{tried.name} {place.where}".strip(), 1.0) as update:
        motion = tried.replay(points[0], place, compute=compute, progress=update).motion
    return show(motion, height=height)


def _given(
    source: str | PathLike[str] | Robot, designs: Designs, where: "str | int | World | None", how: ComputeOptions
) -> tuple[Robot, Floats, World, Compute]:
    """The robot, points, world and computation that a call asks for."""
    if isinstance(source, Robot):  # others are looked at when they are made
        warn_of_doubts(source)
    run = run_in(source)
    tried, place = (robot(source), None) if run is None else of_run(run, elsewhere=where is not None)
    if unknown := [name for name in how if name not in ComputeOptions.__annotations__]:
        raise ValueError(f"{unknown[0]}: is unknown here; {_place_of(tried, source, unknown[0])}")
    if place is None or where is not None:
        place = world(tried, where)
    if run is not None and "precision" not in how:
        how["precision"] = precision_of_run(run, read_config(run))
    return tried, tried.points(points_of(tried, designs)), place, Compute(**how)


def _place_of(tried: Robot, source: str | PathLike[str] | Robot, name: str) -> str:
    """Where a keyword belongs that is none of a computation."""
    kind = KINDS.of(tried)
    if name in {option.name for option in kind.world_options}:
        return f"the world is told by its name, as where={tried.worlds[0].name!r}"
    if name in {option.name for option in kind.options}:
        given = fspath(source) if not isinstance(source, Robot) else tried.name
        return f"what the robot is like is told before, as robot({given!r}, {name}=...)"
    return f"there are {', '.join(ComputeOptions.__annotations__)}"


def _recorded(tried: Robot, points: Floats, place: World, compute: Compute, update: Update) -> Replay | None:
    """The trial of a single design with its motion; None if it is no robot, or cannot be shown."""
    try:
        return tried.replay(points[0], place, frames=POSES, compute=compute, progress=update)
    except ValueError:
        return None
