"""Controls of a robot, and trials of what they are set to. Needs no notebook."""

import inspect
import numbers
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any

from optim import named
from robots.robot import KINDS, OK, Parameter, Progress, Replay, Robot, RobotKind, World
from taichi_sim.base.checks import choice, nearest
from taichi_sim.base.checks import number as checked_number
from taichi_sim.base.compute import Compute
from taichi_sim.base.options import Option, converted

Choice = named.OptionValue | tuple[float, float] | list[Any]
Source = str | PathLike[str] | Robot | Callable[..., Robot]
MOST_SUGGESTED = 8  # parameters that have a slider unless some are named
FINENESS = 100  # steps of a slider
FRAMES = 240  # of a motion: enough for the eye, and quick to send
UNITS = {"DEGREES": "degrees", "DEG": "degrees", "PA": "Pa", "HZ": "Hz", "M": "m", "KG": "kg", "S": "s"}  # of options


@dataclass(frozen=True)
class Control:
    """A slider from ``low`` to ``high``, or a menu of ``choices``.

    Attributes:
        name: of what it sets.
        first: the value before it is moved.
        low: lowest value of a slider.
        high: highest value of a slider.
        step: between neighbouring values of a slider.
        unit: of the values; empty if there is none or it is unknown.
        choices: of a menu; empty for a slider.
    """

    name: str
    first: Any
    low: float = 0.0
    high: float = 0.0
    step: float = 0.0
    unit: str = ""
    choices: tuple[Any, ...] = ()

    def checked(self, value: Any) -> Any:
        """A value that the control can have.

        Raises:
            ValueError: for any other.
        """
        if not self.choices:
            return checked_number(self.name, value, self.low, self.high, self.unit)
        if value not in self.choices:
            raise ValueError(
                f"{self.name}: {value!r} is not allowed; choose one of {', '.join(map(str, self.choices))}"
            )
        return value


@dataclass(frozen=True, eq=False)
class Tried:
    """What a robot did with the controls at some values.

    Attributes:
        robot: with nothing more to choose.
        world: where.
        replay: outcome and motion.
        rows: name, unit and value of each measure; nothing of a trial that failed.
        failure: why it failed; empty if it did not.
    """

    robot: Robot
    world: World
    replay: Replay
    rows: tuple[tuple[str, str, float], ...]
    failure: str


class Exploration:
    """A robot, what can be chosen of it, and how it is tried.

    Args:
        source: as of ``explore``.
        choices: pairs, lists and fixed values by name, as of ``explore``.
        measures: names of those to show; all if empty.
        precision: of numbers; that of views if None.
        threads: of the processor; all if None.

    Attributes:
        controls: sliders and menus, in the order of the choices.

    Raises:
        ValueError: for a name that is unknown or a value that is not allowed.
    """

    def __init__(
        self,
        source: Source,
        choices: Mapping[str, Any],
        measures: Sequence[str] = (),
        precision: str | None = None,
        threads: int | None = None,
    ) -> None:
        self.source = source
        self._makes = callable(source) and not isinstance(source, Robot)
        self._taken = inspect.signature(source).parameters if self._makes else {}  # type: ignore[arg-type]
        self._fixed = {name: value for name, value in choices.items() if not _varies(value)}
        varying = {name: value for name, value in choices.items() if name not in self._fixed}
        self._check_given(varying)
        robot = self._with_firsts(varying)
        if not varying:
            varying = self._suggested(robot)
            robot = self._with_firsts(varying)
        kind = self._kind_of(robot)
        # A name is that of the first of these that knows it.
        self._options = {o.name: o for o in kind.options if o.name not in self._taken}
        self._parameters = {p.name: p for p in robot.parameters if p.name not in {*self._taken, *self._options}}
        owned = {*self._taken, *self._options, *self._parameters}
        self._places = {option.name: option for option in kind.world_options if option.name not in owned}
        self._check_names([*self._fixed, *varying], kind.title)
        described = self._described(varying)
        self.controls = tuple(self._control(name, value, described) for name, value in varying.items())
        self.measures = tuple(choice("measures", name, [m.name for m in robot.measures]) for name in measures)
        self.compute = Compute(precision=precision or kind.quick_precision, threads=threads)
        self.set_up(self.first)

    @property
    def first(self) -> dict[str, Any]:
        """The controls' values before any is moved."""
        return {control.name: control.first for control in self.controls}

    def checked(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """A value for every control.

        Raises:
            ValueError: for a name or value that is not allowed.
        """
        known = {control.name: control for control in self.controls}
        for name in values:
            choice("control", name, list(known))
        return {name: known[name].checked(values.get(name, known[name].first)) for name in known}

    def set_up(self, values: Mapping[str, Any]) -> tuple[Robot, World]:
        """The robot and the world of the controls' values.

        Raises:
            ValueError: for values of which there is none.
        """
        given = {**self._fixed, **self.checked(values)}
        robot = self._made(given)
        place = {name: _read(option, given[name]) for name, option in self._places.items() if name in given}
        free = {name: given[name] for name in self._parameters if name in given}
        fixed = robot.design(robot.points(named.points_of(robot, free))[0]) if robot.parameters else robot
        world = KINDS.of(robot).chosen_world(place) if place else None
        return fixed, world or robot.worlds[0]

    def tried(self, values: Mapping[str, Any], progress: Progress | None = None) -> Tried:
        """Try the robot with the controls at some values.

        Raises:
            ValueError: for values of which there is no robot.
        """
        robot, world = self.set_up(values)
        replay = robot.replay((), world, frames=FRAMES, compute=self.compute, progress=progress)
        outcome = replay.outcome
        if outcome.status[0] != OK:
            return Tried(robot, world, replay, (), outcome.status_or_reason[0])
        shown = [m for m in robot.measures if m.name in (self.measures or outcome.measures)]
        rows = tuple((m.spoken, m.unit, float(outcome.measures[m.name][0])) for m in shown)
        return Tried(robot, world, replay, rows, "")

    def _with_firsts(self, varying: Mapping[str, Any]) -> Robot:
        """The robot with sliders in their middle and menus at their first choice."""
        return self._made({**self._fixed, **{name: _first(value) for name, value in varying.items()}})

    def _made(self, given: Mapping[str, Any]) -> Robot:
        """The robot of values, before its parameters are set."""
        source = self._returned(given) if self._makes else self.source
        known = {option.name for option in named.kind_of(source).options}  # type: ignore[arg-type]
        chosen = {n: _text(value) for n, value in given.items() if n in known and n not in self._taken}
        return named.robot(source, **chosen)  # type: ignore[arg-type]

    def _returned(self, given: Mapping[str, Any]) -> Robot:
        """The robot that the user's function makes of values."""
        taken = {name: given[name] for name in self._taken if name in given}
        missing = [n for n, each in self._taken.items() if each.default is each.empty and n not in taken]
        if missing:
            raise ValueError(f"{missing[0]}: the function wants it; give a pair, a list or a value")
        robot = self.source(**taken)  # type: ignore[operator]
        if not isinstance(robot, Robot):
            raise ValueError(f"source: it made {robot!r}, which is no robot")
        return robot

    def _described(self, varying: Mapping[str, Any]) -> dict[str, float]:
        """Numbers by which the robot describes itself where nothing is chosen, if an option among them varies."""
        if self._makes or not any(name in self._options for name in varying):
            return {}
        try:
            return dict(_numbers_in(self._made(self._fixed).describe()))
        except ValueError:  # it is no robot without the choice, as a mesh without a pitch
            return {}

    def _check_given(self, varying: Mapping[str, Any]) -> None:
        """Refuse sliders and menus of nothing."""
        for name, value in varying.items():
            if isinstance(value, tuple):
                low, high = (checked_number(name, end) for end in value)
                if not low < high:
                    raise ValueError(f"{name}: {low:g} to {high:g} is not allowed; give the lowest value first")
            elif not value:
                raise ValueError(f"{name}: a menu of nothing is not allowed; give some values")
            elif wrong := [each for each in value if not isinstance(each, str | int | float)]:
                raise ValueError(f"{name}: {wrong[0]!r} is not allowed in a menu; give texts and numbers")

    def _check_names(self, names: Sequence[str], title: str) -> None:
        known = [*self._taken, *self._parameters, *self._options, *self._places]
        for name in names:
            if name not in known:
                there = f"there are {named.some_of(known)}{nearest(name, known)}"
                raise ValueError(f"{name}: no parameter or option of {title}; {there}")

    def _kind_of(self, robot: Robot) -> RobotKind:
        """The kind whose options make the robot: the one that is named, which may make robots of another."""
        by_name = isinstance(self.source, str) and self.source in named.robots()
        return named.kind_of(self.source) if by_name else KINDS.of(robot)  # type: ignore[arg-type]

    def _suggested(self, robot: Robot) -> dict[str, Any]:
        """Pairs and lists for a robot of which nothing was chosen."""
        if self._makes:
            raise ValueError("choices: there are none; give a pair or a list for an argument of the function")
        free = [parameter for parameter in robot.parameters if parameter.place is None][:MOST_SUGGESTED]
        pairs = {parameter.name: (parameter.low, parameter.high) for parameter in free}
        kind = self._kind_of(robot)
        found = {**kind.explored, **pairs}
        suggested = {name: value for name, value in found.items() if name not in self._fixed}
        if not suggested:
            raise ValueError(f"choices: {kind.title} suggests none; give a pair or a list, such as slope=(-10, 10)")
        return suggested

    def _control(self, name: str, value: Any, described: Mapping[str, Any]) -> Control:
        """The slider or menu of a choice."""
        if not isinstance(value, tuple):
            return Control(name, value[0], choices=tuple(value))
        low, high = map(float, value)
        parameter = self._parameters.get(name)
        option = self._options.get(name) or self._places.get(name)
        step = 1.0 if self._is_whole(name, value, parameter, option) else (high - low) / FINENESS
        usual = self._usual(name, parameter, described)
        first = float(usual) if _is_number(usual) and low <= usual <= high else _first(value)
        first = low + step * round((first - low) / step) if step == 1 else first
        unit = parameter.unit if parameter else UNITS.get((option.metavar or "") if option else "", "")
        return Control(name, first, low, high, step, unit)

    def _is_whole(
        self, name: str, value: tuple[float, float], parameter: Parameter | None, option: Option | None
    ) -> bool:
        """Whether a slider has whole numbers alone: what an option refuses others of, or a function has ints of."""
        if parameter is not None:
            return parameter.is_integer
        if name in self._taken:
            return all(isinstance(end, numbers.Integral) for end in value)
        try:
            converted(name, option.type if option else None, f"{value[0] + 0.5}")
        except ValueError:
            return all(float(end).is_integer() for end in value)
        return False

    def _usual(self, name: str, parameter: Parameter | None, described: Mapping[str, Any]) -> Any:
        """The value where nobody chooses, as far as it is known."""
        if name in self._taken:
            return self._taken[name].default
        return parameter.first if parameter else described.get(name)


def _varies(value: Any) -> bool:
    """Whether a choice is a slider or a menu."""
    return isinstance(value, list) or (isinstance(value, tuple) and len(value) == 2 and all(map(_is_number, value)))


def _is_number(value: Any) -> bool:
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def _first(value: Any) -> Any:
    """The middle of a slider, rounded down between whole ends; the first of a menu."""
    if not isinstance(value, tuple):
        return value[0]
    low, high = value
    whole = all(isinstance(end, numbers.Integral) for end in value)
    return (low + high) // 2 if whole else (low + high) / 2


def _text(value: Any) -> Any:
    """A number as the command line would have it; all else as it is."""
    return f"{value:.10g}" if _is_number(value) else value


def _read(option: Option, value: Any) -> Any:
    """What an option makes of a number or a text; all else, such as a world, as it is."""
    text = _text(value)
    return converted(option.name, option.type, text) if isinstance(text, str) else text


def _numbers_in(described: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """Names and numbers of a description, those of its parts first."""
    for value in described.values():
        if isinstance(value, Mapping):
            yield from _numbers_in(value)
    yield from ((name, value) for name, value in described.items() if _is_number(value))
