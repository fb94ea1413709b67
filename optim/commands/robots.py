"""Which robot a command is about: a kind by its name, a design that a kind knows, a file, or a run's design.

Options of a kind of robot join a command when its command line names the kind; those of others are refused.
"""

import argparse
import contextlib
import os
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from optim.notes import note
from optim.problems import kind_of_run, precision_of_run, robot_of_run
from optim.runs.config import has_run, read_config, run_of_any_seed
from optim.runs.history import History, read_history
from robots.robot import (
    KINDS,
    USUAL,
    Option,
    Robot,
    RobotKind,
    World,
    find_robot,
    find_robot_doing,
    robot_to_try,
    world_and_others,
)
from taichi_sim.base.options import given

SHARED = "seed"  # of a search, which may be that of its robot, too
TABLE_FILE = "gait.csv"  # of pressures, of robots that a rig can drive
OptionsOf = Callable[[RobotKind], Sequence[Option]]


@dataclass(frozen=True)
class Named:
    """The robot that a command line names.

    Attributes:
        kind: of the robot.
        source: the file or design from which the kind makes it; None for the usual one.
        run: the folder of a run, or of runs of several seeds, whose design it is, instead.
    """

    kind: RobotKind
    source: str | None = None
    run: Path | None = None

    @property
    def precision(self) -> str:
        """The precision in which it is simulated unless an option says another: that of its run, or f64."""
        if self.run is None:
            return "f64"
        run = self.run if has_run(self.run) else run_of_any_seed(self.run) or self.run
        return precision_of_run(run, read_config(run))

    def other_worlds(self, worlds: Sequence[World]) -> str:
        """Text about the worlds of a run but the first, up to the option that chooses one; empty without any."""
        if self.run is None or len(worlds) < 2:
            return ""
        return f"its run has {', '.join(world.name for world in worlds[1:])}, too: --{self.kind.world_option}"

    @property
    def label(self) -> str | None:
        """What people call the file or run; None for a kind's usual robots and designs, which have names."""
        if self.run is not None:
            return self.run.name
        return None if self.source is None or self.source in self.kind.designs else Path(self.source).stem


class RobotOptions(argparse.ArgumentParser):
    """A parser whose options depend on which robots the command line names."""

    def __init__(self, *args: Any, **settings: Any) -> None:
        """Take the arguments of any parser; options are given by their whole names."""
        super().__init__(*args, **{**settings, "allow_abbrev": False})  # short ones would become names of new options
        self._find: Callable[[Sequence[str]], Iterable[RobotKind]] | None = None
        self._options_of: OptionsOf = world_and_own("")
        self._own: frozenset[str] = frozenset()  # names of the command's options beside those of kinds
        self.known_to: dict[str, list[str]] = {}  # titles of the kinds that have an option, by its name

    def take_robots(self, find: Callable[[Sequence[str]], Iterable[RobotKind]], options_of: OptionsOf) -> None:
        """Add the options of kinds before the command line is parsed.

        Args:
            find: the kinds that words of a command line name, none if they name none that is known. Of a command that
                takes robots without a flag, these are the words that are values of no option.
            options_of: the options of a kind for this command.
        """
        self._find, self._options_of = find, options_of

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Add the options of the robots that the arguments name, and parse."""
        self._add_kinds(args or ())
        return super().parse_known_args(args, namespace)

    def format_help(self) -> str:
        """The help, with the options of the robots that the command line names, or else of the usual kind."""
        self._add_kinds(())
        return super().format_help()

    def _add_kinds(self, words: Sequence[str]) -> None:
        """Add options of kinds, once; those of other kinds are hidden, and refused by :meth:`values`."""
        if self._find is None:
            return
        find, self._find = self._find, None
        kinds: list[RobotKind] = []
        # What is wrong, or left out, is told when the command runs.
        with warnings.catch_warnings(), contextlib.suppress(ValueError, OSError, argparse.ArgumentError):
            warnings.simplefilter("ignore")
            kinds = list({kind.name: kind for kind in self._named(words, find)}.values())
        taken = {action.dest for action in self._actions}
        self._own = frozenset(taken)
        for kind in kinds or [KINDS[USUAL]]:
            group = self.add_argument_group(kind.title)
            for option in self._options_of(kind):
                if option.name not in taken:
                    option.add(group)
                    taken.add(option.name)
        for name in KINDS.builtin:
            for option in self._options_of(KINDS[name]):
                if option.name not in taken:
                    option.add_hidden(self)
                    taken.add(option.name)
                if option.name not in self._own:
                    self.known_to.setdefault(option.name, []).append(KINDS[name].title)

    def _named(self, words: Sequence[str], find: Callable[[Sequence[str]], Iterable[RobotKind]]) -> Iterable[RobotKind]:
        """The kinds that a command line names; a folder for results, say, is none of its robots."""
        if all(action.option_strings for action in self._actions):
            return find(words)
        flags = {flag for action in self._actions if action.nargs != 0 for flag in action.option_strings}
        flags |= self._flags_of(KINDS[name] for name in KINDS.builtin)
        bare = _without_values(words, flags)
        kinds = list(find(bare))
        bare_of_these = _without_values(words, flags | self._flags_of(kinds))  # some may be of packages
        return kinds if bare_of_these == bare else find(bare_of_these)

    def _flags_of(self, kinds: Iterable[RobotKind]) -> set[str]:
        """The options of kinds that take a value, as the command line spells them."""
        return {option.flag for kind in kinds for option in self._options_of(kind) if option.type is not None}

    def values(self, args: argparse.Namespace, kind: RobotKind, *others: RobotKind) -> dict[str, Any]:
        """Values of the options of a kind that were given, by name.

        Args:
            args: result of this parser.
            kind: of a robot that the command is about.
            others: further kinds that it is about.

        Raises:
            ValueError: for an option that none of these kinds has, and for one that a kind of a package has beside the
                command.
        """
        apart = {each.name: self._apart(each, args) for each in (kind, *others)}
        known = {option.name for each in (kind, *others) for option in self._options_of(each)}
        for name, titles in self.known_to.items():
            if name not in known and getattr(args, name, None) is not None:
                which, serves = ", ".join(titles), kind.instead.get(name, "leave it out")
                raise ValueError(f"{name.replace('_', '-')}: it is an option of other kinds ({which}); {serves}")
        return given(apart[kind.name], args)

    def _apart(self, kind: RobotKind, args: argparse.Namespace) -> list[Option]:
        """The options of a kind but those of a package's that are called as others: a value would be that of both."""
        options = list(self._options_of(kind))
        if kind.name in KINDS.builtin:
            return options
        kept, taken = list[Option](), set(self._own)
        for option in options:
            if option.name == SHARED or option.name not in taken:
                kept.append(option)
                taken.add(option.name)
            elif getattr(args, option.name, None) != self.get_default(option.name):
                told = f"{kind.title} has such an option, as the command has"
                raise ValueError(f"{option.name.replace('_', '-')}: {told}; have its package rename it")
        return kept


def _without_values(words: Sequence[str], flags: Collection[str]) -> list[str]:
    """The words of a command line that stand by themselves: neither options nor values of those that take one."""
    found, before, ended = list[str](), "", False
    for word in words:
        if ended or (before not in flags and not word.startswith("-")):
            found.append(word)
        ended = ended or word == "--"
        before = word if before not in flags else ""
    return found


def world_and_own(command: str) -> OptionsOf:
    """The options of a kind that a command has: those of one world, and those that make its robots."""

    def options_of(kind: RobotKind) -> Sequence[Option]:
        return [*(replace(option, once=True) for option in kind.world_options), *kind.options_for(command)]

    return options_of


def own_alone(command: str) -> OptionsOf:
    """The options of a kind that make its robots, for a command without a world, or with several."""

    def options_of(kind: RobotKind) -> Sequence[Option]:
        return kind.options_for(command)

    return options_of


def kinds_of_robot(words: Sequence[str]) -> list[RobotKind]:
    """The kind of robot that ``--robot`` and ``--gait`` name."""
    return [named_doing(*vars(early(words, "--robot", "--gait")).values()).kind]


def named_doing(robot: str | None, gait: str | None) -> Named:
    """What the options ``robot`` and ``gait`` name: as ``find_robot_doing`` finds it, or the folder of a run.

    Raises:
        ValueError: if they name none, or both say all.
    """
    run = _run_named(robot if robot is not None else gait or "")
    if run is None:
        return Named(*find_robot_doing(robot, gait))
    if robot is not None and gait is not None:
        raise ValueError(f"gait: {robot} is a robot by itself; leave it out")
    return run


def _run_named(text: str) -> Named | None:
    """The folder of a run, or of runs of several seeds, that a word names; None if it is no such folder."""
    if not text or not os.path.isdir(text):  # False of a name too long
        return None
    path = Path(text)
    run = path if has_run(path) else run_of_any_seed(path)
    return None if run is None else Named(kind_of_run(run, read_config(run)), run=path)


def history_of(run: Path) -> History:
    """The history of the run in a folder; of those of several seeds the best one's, of which a note tells."""
    if has_run(run):
        return read_history(run)
    from optim.runs.comparable import best_of_seeds

    best = best_of_seeds(run)
    note(f"{run} has runs of several seeds; the best one is {best.path}")
    return best


def named_source(text: str) -> Named:
    """What a word names that may be a robot, a file, or the folder of a run.

    Raises:
        ValueError: if it is none of these.
    """
    if (run := _run_named(text)) is not None:  # a folder may be called as a robot is
        return run
    found = find_robot(text)
    if found is None and os.path.isdir(text):
        read_config(Path(text))  # which says what is missing
    if found is None and (os.path.dirname(text) or Path(text).suffix):
        raise ValueError(f"source: {text} is no file of a design, and no folder")
    if found is None:
        known = [name for kind in KINDS.builtin for name in (*KINDS[kind].designs, kind)]
        raise ValueError(f"source: {text!r} is no robot ({', '.join(known)}), no run and no file of a design")
    return Named(*found)


def kinds_of_words(words: Sequence[str]) -> list[RobotKind]:
    """The kinds of robots among the words of a command line; words that name none are other things."""
    found = []
    for word in words:
        with contextlib.suppress(ValueError, OSError):
            found.append(named_source(word).kind)
    return found


def early(words: Sequence[str], *flags: str) -> argparse.Namespace:
    """Values of some options of a command line whose other options are not known yet; None where not given.

    Raises:
        argparse.ArgumentError: for an option without its value.
    """
    parser = argparse.ArgumentParser(add_help=False, exit_on_error=False, allow_abbrev=False)
    for flag in flags:
        parser.add_argument(flag)
    return parser.parse_known_args([word for word in words if word != "--help"])[0]


def loaded(named: Named, values: Mapping[str, Any], member: int | None = None) -> tuple[Robot, tuple[World, ...]]:
    """The robot that is named, with nothing free, and the worlds that it is tried in.

    Args:
        named: what the command line names.
        values: of the kind's options; one of them may name the world.
        member: of a run, which of the designs that it keeps, counted from 1; None for the best.

    Raises:
        ValueError: for options that are not allowed, and designs that are not there.
    """
    if named.run is None:
        return robot_to_try(named.kind, named.source, values)
    world, options = world_and_others(named.kind, values)
    kind, ground = named.kind, {name: values[name] for name in named.kind.ground_options if name in values}
    same = bool(ground) and ground.keys() == values.keys() & {option.name for option in kind.world_options}
    robot, worlds = robot_of_run(history_of(named.run), member, elsewhere=world is not None and not same)
    if same:
        each = (kind.chosen_world({kind.world_option: one, **ground}) for one in worlds)  # those of the run
        worlds = tuple(one for one in each if one is not None)
    elif world is not None:
        worlds = (world,)
    return robot.changed(options), worlds
