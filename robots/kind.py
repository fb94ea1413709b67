"""Kinds of robots, and the table of them, which packages of users may add to.

A kind is built in, and stands in the table ``KINDS``, or a package adds it by an entry point::

    [project.entry-points."morpholab.robots"]
    hopper = "my_package.hopper:HopperKind"
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from robots.outcome import World
from taichi_sim.base.checks import positive
from taichi_sim.base.options import Option, converted, spelled
from taichi_sim.base.registry import Registry

if TYPE_CHECKING:
    from robots.abilities import Abilities
    from robots.own_measures import OwnMeasure
    from robots.robot import Robot


Choices = Mapping[str, tuple[float, float] | list[Any]]


OWN_MEASURES_FIELD = "own_measures"  # the option, and the field of robots that have it
OWN_MEASURES_OPTION = Option(
    OWN_MEASURES_FIELD, "measure of an installed package, to be told and searched, too", str, "NAME", several=True
)


def choices(**given: tuple[float, float] | list[Any]) -> Choices:
    """Values of a robot that are worth trying, by name: pairs of lowest and highest, or lists."""
    return MappingProxyType(given)


def lost_in(robot: Any) -> "tuple[OwnMeasure, ...]":
    """Own measures of a robot that nothing can compute: a run folder tells of them, but only a file defines them."""
    return tuple(each for each in getattr(robot, OWN_MEASURES_FIELD, ()) if each.lost)


def without_lost(robot: "Robot") -> "Robot":
    """A robot without the measures that nothing can compute, so that it can be tried."""
    if not (lost := lost_in(robot)):
        return robot
    return robot.changed(
        {OWN_MEASURES_FIELD: [each for each in getattr(robot, OWN_MEASURES_FIELD) if each not in lost]}
    )


class RobotKind(ABC):
    """A kind of robot: a factory that makes robots from options and files. Its module should import quickly.

    Attributes:
        name: name in the table ``KINDS``, or of the entry point.
        title: name of the kind for people.
        options: options of the command line from which :meth:`build` makes a robot.
        designs: names of designs that commands know without a file.
        suffixes: of files that :meth:`recognises` takes whatever is in them, to be told to people, such as ``".xml"``.
        world_option: name of the option that chooses a world.
        world_type: converts the text of that option to a value for :meth:`world`, as ``Option.type`` does.
        world_hint: help text of that option.
        ground_options: names of further ``world_options``, which hold for all worlds of a command.
        search_precision: default precision of numbers in searches, ``"f32"`` or ``"f64"``.
        quick_precision: default precision of numbers where answers must come quickly, as in the explorer.
        fading_gradients: whether gradients can have a horizon, see ``robots.trial.Trial``.
        explored: what is worth moving when a robot is explored, by names of ``options`` and ``world_options``: a pair,
            lowest and highest, or a list.
        instead: what serves instead of options that only other kinds have, by their names.
        trial_fields: names in a robot's description that say how it is tried, such as ``duration`` or, of a part of it,
            ``actuation.cycles``: scores of robots that differ in them do not mean the same.
    """

    name: str
    title: str
    options: tuple[Option, ...] = ()
    designs: tuple[str, ...] = ()
    suffixes: tuple[str, ...] = ()
    world_option: str = "world"
    world_type: Callable[[str], Any] = str
    world_hint: str = "where it is tried (default: the kind's own)"
    ground_options: tuple[str, ...] = ()
    search_precision: str = "f64"
    quick_precision: str = "f64"
    fading_gradients: bool = False
    explored: Choices = MappingProxyType({})
    instead: Mapping[str, str] = MappingProxyType({})
    trial_fields: tuple[str, ...] = ()

    @abstractmethod
    def build(self, source: str | None, options: Mapping[str, Any]) -> "Robot":
        """Make a robot of this kind from a file or name, and options.

        Args:
            source: the file of a robot or of a design, a name among ``designs``, or None.
            options: values of ``options`` that were given, by name.

        Raises:
            ValueError: for a source or an option that is not allowed.
        """

    def check_gradient_horizon(self, horizon: float) -> None:
        """Refuse a time [s] over which gradients see what happens, unless those of this kind can have one."""
        positive("gradient_horizon", horizon)
        if not self.fading_gradients:
            raise ValueError(f"gradient_horizon: {self.title} has none; leave it out")

    def recognises(self, path: Path, form: str | None) -> bool:
        """Whether a file holds a robot of this kind; ``form`` is the format that a JSON file names, None otherwise."""
        return False

    def from_description(self, description: Mapping[str, Any]) -> "Robot":
        """Build a robot from what ``Robot.describe`` returned; by default the description holds options."""
        return self.build(None, description)

    def options_for(self, command: str) -> list[Option]:
        """List the :attr:`options` that a command has."""
        return [option for option in self.options if not option.commands or command in option.commands]

    @property
    def world_options(self) -> tuple[Option, ...]:
        """Options that choose one world, see :meth:`chosen_world`."""
        return (Option(self.world_option, self.world_hint, self.world_type, self.world_option.upper()),)

    def chosen_world(self, options: Mapping[str, Any]) -> World | None:
        """Return the world that values of :attr:`world_options` choose; None if none was given."""
        given = options.get(self.world_option)
        return None if given is None else self.world(given)

    def chosen_worlds(self, options: Mapping[str, Any]) -> tuple[World, ...]:
        """Return the worlds that lists of values of :attr:`world_options` choose, each by any of these options.

        Values of :attr:`ground_options` are single, and hold for all.
        """
        common = {name: options[name] for name in self.ground_options if name in options}
        names = [option.name for option in self.world_options if option.name not in self.ground_options]
        each = [{name: value} for name in names for value in options.get(name, ())] or [{}]
        found = (self.chosen_world({**one, **common}) for one in each)
        return tuple(world for world in found if world is not None)

    def world_values(self, world: World) -> dict[str, Any]:
        """Return the values of :attr:`world_options` for which :meth:`chosen_world` returns this world."""
        return {self.world_option: world.name}

    def world_told(self, world: World) -> str:
        """Describe a world by its name and further options, such as ``hill:15 with friction 0.56,0.7``."""
        more = {name: value for name, value in self.world_values(world).items() if name != self.world_option}
        return " with ".join([world.name, *(f"{name.replace('_', ' ')} {spelled(more[name])}" for name in more)])

    def world(self, text: Any) -> World:
        """Return the world of a name, or of a value that ``world_type`` made.

        Raises:
            ValueError: for any other name.
        """
        known = {place.name: place for place in self.build(None, {}).worlds}
        if text not in known:
            raise ValueError(f"{self.world_option}: {text!r} is unknown; choose one of {', '.join(known)}")
        return known[text]

    def named_world(self, name: "str | int | World") -> World:
        """Return the world of a name as the command line spells it, such as ``"hill:15"``; a world as it is.

        Raises:
            ValueError: for a name that robots of this kind do not know, and for several worlds.
        """
        if isinstance(name, str | int | np.integer):
            return self.world(converted(self.world_option, self.world_type, str(name)))
        if not hasattr(name, "where"):
            raise ValueError(f"where: {name!r} is not allowed; give one world, or its name")
        return name

    def present_world(self, world: World) -> World:
        """Return a world of a run as this version has it, where an earlier one called it otherwise."""
        return world

    def world_record(self, world: World) -> Any:
        """Convert a world to a value that fits JSON and TOML."""
        return world.name

    def world_of(self, record: Any) -> World:
        """Convert a value from :meth:`world_record` back to a world."""
        return self.world(record)


class _Kinds(Registry[RobotKind]):
    """Kinds of robots by name; an entry may be a kind or its class."""

    def __getitem__(self, name: str) -> RobotKind:
        found = super().__getitem__(name)
        if isinstance(found, type):
            try:
                found = self._loaded[name] = found()
            except TypeError as error:  # such as of a class that lacks a method
                raise ValueError(f"robot: {name!r} cannot be made: {error}") from error
        found.name = name
        return found

    def of(self, robot: "Abilities") -> RobotKind:
        """The kind of a robot.

        Raises:
            ValueError: if its class names none that is built in or added by a package.
        """
        named: str = getattr(robot, "kind", "")
        try:
            return self[named]
        except KeyError:
            raise ValueError(
                f"robot: the kind {named!r} of {type(robot).__name__} is not registered; add it by an entry point, see "
                "docs/extending.md"
            ) from None


USUAL = "inflatable"  # the kind, where none is named
KINDS = _Kinds(
    "morpholab.robots",
    "robot",
    {
        "inflatable": "robots.inflatable.kind:InflatableKind",
        "freeform": "robots.freeform.kind:FreeformKind",
        "lattice": "robots.lattice_robot.kind:LatticeRobotKind",
        "articulated": "robots.articulated.kind:ArticulatedKind",
        "pouch": "robots.inflatable.pouch_kind:PouchKind",
        "quadruped": "robots.quadruped.kind:QuadrupedKind",
        "rover": "robots.rover.kind:RoverKind",
        "vehicle": "robots.braitenberg.kind:VehicleKind",
        "walker": "robots.lattice_robot.walker_kind:WalkerKind",
    },
    instances_of=RobotKind,
    classes_of=RobotKind,
)
"""The kinds of robots by name, those of installed packages among them."""
