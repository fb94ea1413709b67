"""Make problems from the options of commands: for any kind of robot, or in a way that a kind defines."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from optim.problem import Problem, RelaxableProblem
from optim.problems.earlier import is_described_by
from optim.runs.history import History
from robots.partly_fixed import PartlyFixed, freed, held_as, held_at, held_names, inner_description, names_matching
from robots.robot import Option, Robot, RobotKind, World, find_robot_doing, lost_in, make_robot
from taichi_sim.base.lazy import imported
from taichi_sim.base.options import count, number

COMPUTE = ("precision", "device", "threads")
# Kinds that are designed in another way than by their parameters and measures.
DESIGNERS = {
    "inflatable": "optim.problems.inflatable.designer:InflatableDesigner",
    "vehicle": "optim.problems.designer:VehicleDesigner",
}

UNCERTAIN_OPTIONS = (
    Option(
        "uncertain",
        "what is not known exactly, such as friction=20%%,slope=1 (degrees): each design is judged over --draws of it: "
        "friction scales that of all materials, levels the amplitude of every muscle, timing the period; repeatable",
        metavar="QUANTITY=WIDTH,...",
        several=True,
    ),
    Option("risk", "over these draws: mean, cvar:SHARE of the worst, or worst (default: mean)", metavar="RISK"),
    count("draws", 2, "of what is uncertain (default: 16)"),
)
GRADIENT_HORIZON = Option(
    "gradient_horizon",
    "time over which gradients see what a change of shape or speed does (default: all of a trial; "
    "robots that feel are led farther with an eighth of a cycle)",
    number(1e-6, 1e6, "s"),
    "SECONDS",
)
HOLD = Option(
    "hold",
    "parameters that shall not change, by name or pattern, such as '*_size': they stay as in the best design of the "
    "run that --robot gives, or else as simulate tries them; repeatable",
    metavar="NAME",
    several=True,
)
VEHICLE_WORDS = {"total": "mean", "environments": "each"}  # what these are of robots of other kinds


@dataclass(frozen=True)
class DesignRequest:
    """The request to ``codesign``: the robot, its options and its worlds.

    Attributes:
        source: the file or name that ``--robot`` gives; None for a kind.
        given: values of the options that were given, by name; also of ``COMPUTE``.
        method: name of the search method.
        several: whether it takes several objectives.
        known: the problem of the run that continues; None for a new one.
        out: folder of the run, for messages.
        resume: whether a run was to be continued.
        best_of: the run that ``--robot`` gives instead, parameters of whose best design are held.
    """

    source: str | None
    given: Mapping[str, Any]
    method: str
    several: bool
    known: Problem | None
    out: Path
    resume: bool = False
    best_of: "History | None" = None

    @property
    def named(self) -> str | None:
        """What ``--robot`` gives beside a kind, for messages."""
        return self.source if self.best_of is None else str(self.best_of.path)

    def same(self, field_name: str, given: str | None, known: str) -> str:
        """A setting of the run that continues, which may be given again but not changed.

        Raises:
            ValueError: if something else is given; it is refused before that fits nothing else.
        """
        if given not in (None, known):
            raise ValueError(f"{field_name}: {given!r} is not what the run in {self.out} has, {known!r}; leave it out")
        return known

    def chosen(self, options: Sequence[str]) -> dict[str, Any]:
        """The given ones among some options, by name."""
        return {name: self.given[name] for name in options if name in self.given}


@dataclass(frozen=True)
class Design:
    """The design problem of a request, with settings for its search.

    Attributes:
        problem: what is designed.
        note: what was fixed by default, or nothing.
        start: values at which the search starts, by variable; others start at random.
        settings: of the search method, which the problem asks for unless others are given.
    """

    problem: Problem
    note: str = ""
    start: Mapping[str, float] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)


class Designer:
    """Makes problems of a kind of robot: its parameters become variables, its measures objectives.

    Attributes:
        kind: the kind of robot.
        holds: whether parameters can be held.
    """

    holds = True

    def __init__(self, kind: RobotKind) -> None:
        """For a kind of robot."""
        self.kind = kind

    @property
    def options(self) -> tuple[Option, ...]:
        """Options of ``codesign`` for this kind of robot, beside those of the search method."""
        worlds = self.kind.world_options
        return (
            *(
                option
                if option.name in self.kind.ground_options
                else dataclasses.replace(option, help=_of_several(option), several=True)
                for option in worlds
            ),
            objective_option(
                f"mean, each or worst of several {worlds[0].name}s",
                "the mean of the robot's first measure; each with methods for several objectives",
            ),
            *(UNCERTAIN_OPTIONS if any(world.name == "terrain" for world in worlds) else ()),
            *((GRADIENT_HORIZON,) if self.kind.fading_gradients else ()),
            Option("measure", "of the robot that mean, each and worst are about (default: its first)", metavar="NAME"),
            HOLD,
            *self.kind.options_for("codesign"),
        )

    def design(self, asked: DesignRequest) -> Design:
        """The problem asked for; what is not given is as in the run that continues, or else the default.

        Raises:
            ValueError: if the options do not fit each other, or the run.
        """
        from optim.problems.robot import RobotProblem
        from optim.problems.uncertain import uncertain_settings

        settings = asked.chosen(COMPUTE)
        settings.setdefault("precision", getattr(asked.known, "precision", self.kind.search_precision))
        if worlds := self.kind.chosen_worlds(asked.given):
            settings["worlds"] = worlds
        settings |= asked.chosen(("measure", "gradient_horizon")) | uncertain_settings(asked.given, asked.known)
        if "objective" in asked.given:
            settings |= self._objectives(asked)
        if asked.known is not None:
            return Design(self._continued(asked, settings))
        settings.setdefault("objective", "each" if asked.several else "mean")
        robot, worlds = self._robot(asked)
        return Design(RobotProblem(robot, **{"worlds": worlds, **settings} if worlds else settings))

    def _robot(self, asked: DesignRequest) -> tuple[Robot, tuple[World, ...]]:
        """The robot of a new run, with what is to be held, and the worlds of the run that it is from."""
        from optim.named import held_of_run

        own, hold = self._own(asked.given), asked.given.get("hold", ())
        if asked.best_of is not None:
            return held_of_run(asked.best_of, hold, own, "what shall stay as it is")
        robot = make_robot(self.kind, asked.source, own)
        return held_at(robot, robot.start, hold) if hold else robot, ()

    def _objectives(self, asked: DesignRequest) -> dict[str, Any]:
        """Fields of the problem by which it is judged; several goals are judged by their mean unless a word is given.

        Raises:
            ValueError: for what is no objective.
        """
        from optim.problems.goals import goals_in, named

        texts = asked.given["objective"]
        alone = len(goals_in(texts)) == 1
        objective = named(texts, "each" if asked.several and alone else "mean")
        return {"objective": objective, **({} if isinstance(objective, str) else {"summed": not asked.several})}

    def _own(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Values of the options that make robots of the kind."""
        names = {option.name for option in self.kind.options}
        return {name: value for name, value in given.items() if name in names}

    def _continued(self, asked: DesignRequest, settings: dict[str, Any]) -> Problem:
        """The problem of the run, with what may be given again."""
        known: Any = asked.known
        own = self._own(asked.given)
        lost = lost_in(known.offered)
        again = f"give --robot {lost[0].source} again, which alone defines {lost[0].name}" if lost else "leave it out"
        _check_held(asked, known.offered)
        if asked.named is not None or own.keys() - {"seed"}:  # which is that of the search, too
            robot = self._robot_again(asked, own)
            if not is_described_by(*(inner_description(each.describe()) for each in (known.offered, robot))):
                what = asked.named or "what is given"
                raise ValueError(f"robot: {what} is not the robot of the run in {asked.out}; {again}")
            if lost:
                known = dataclasses.replace(known, robot=held_as(robot, known.offered))
        elif lost:
            raise ValueError(f"robot: is missing for the run in {asked.out}; {again}")
        if "worlds" in settings:
            settings["worlds"] = self._as_known(settings["worlds"], known.tried_in)
        fields = {each.name for each in dataclasses.fields(known)}
        if "worlds" in settings and "terrain" in fields:  # of version 1.0
            settings["terrain"], *others = settings.pop("worlds")
            if others:
                raise ValueError(f"terrain: the run in {asked.out} has one; leave out {others[0].name}")
        for name in sorted(settings.keys() - fields):
            raise ValueError(f"{name}: the run in {asked.out} is one of version 1.0, which knows none; leave it out")
        problem: Problem = dataclasses.replace(known, **settings)
        return problem

    def _as_known(self, worlds: Sequence[World], known: Sequence[World]) -> tuple[World, ...]:
        """Worlds as a run knows them, whose version may have called them otherwise."""
        present = self.kind.present_world
        return tuple(next((k for k in known if k != each and present(k) == present(each)), each) for each in worlds)

    def _robot_again(self, asked: DesignRequest, own: Mapping[str, Any]) -> Robot:
        """The robot that is given for a run that continues, whatever is held of it."""
        from optim.problems import offered_by_run

        if asked.best_of is not None:
            return freed(offered_by_run(asked.best_of)[0], own)
        kind = self.kind if asked.source is None else find_robot_doing(asked.source)[0]  # Python sets any kind
        return make_robot(kind, asked.source, own)

    def horizons(
        self, source: str | None, given: Mapping[str, Any], wanted: Sequence[int] | None
    ) -> dict[str, tuple[RelaxableProblem, NDArray[Any]]]:
        """Problems of shorter and longer trials by what these are called, each with the point where searches start.

        Args:
            source: the file or name of the robot; None for the kind's usual one.
            given: values of options, of ``COMPUTE`` and of worlds.
            wanted: lengths of the trials; the robot's own by default.
        """
        from optim.problems.robot import RobotProblem

        robot = make_robot(self.kind, source, self._own(given))
        compute = {name: given[name] for name in COMPUTE if name in given}
        world = self.kind.chosen_world(given)
        lengths = list(wanted if wanted is not None else robot.horizons)
        trials = dict(robot.at_horizon(length) for length in lengths) if lengths else {"trial": robot}
        worlds = () if world is None else (world,)
        return {
            name: (RobotProblem(trial, worlds, relaxed_precision=None, **compute), trial.start)
            for name, trial in trials.items()
        }


class VehicleDesigner(Designer):
    """Braitenberg vehicles are judged by the sum of their distances; gradients are cut where they are steep."""

    @property
    def options(self) -> tuple[Option, ...]:
        """Options of ``codesign`` for Braitenberg vehicles."""
        own = objective_option(
            "total or environments: the sum of the distances from the light, or each; with measures total is the mean "
            "over the environments, as worst is the worst of them",
            "total; environments with methods for several objectives",
        )
        return tuple(
            own if option.name == "objective" else option for option in super().options if option.name != "measure"
        )

    def design(self, asked: DesignRequest) -> Design:
        """The problem of a vehicle."""
        from optim.problems.braitenberg import VehicleProblem

        settings = asked.chosen(COMPUTE)
        texts = asked.given.get("objective", [])
        other = asked.best_of is not None or "hold" in asked.given or any(text not in VEHICLE_WORDS for text in texts)
        named = asked.known is None and other
        if named or self.kind.chosen_worlds(asked.given) or hasattr(asked.known, "worlds"):
            given = {**asked.given, **({"objective": [VEHICLE_WORDS.get(t, t) for t in texts]} if texts else {})}
            return super().design(dataclasses.replace(asked, given=given))  # by each environment's own measures
        if len(texts) > 1:
            raise ValueError(f"objective: {' and '.join(texts)} are not allowed together; give one of them")
        objective = texts[0] if texts else None
        if asked.known is not None:
            asked.same("problem.objectives", objective, getattr(asked.known, "objectives", ""))
            return Design(self._continued(asked, settings))
        robot: Any = make_robot(self.kind, asked.source, self._own(asked.given))
        if not robot.parameters:
            raise ValueError("controller: weights leave nothing free to change; give contralateral or full")
        objectives = objective or ("environments" if asked.several else "total")
        body = {"body": robot.body, "controller": robot.controller, "sensors": robot.sensors}
        return Design(VehicleProblem(**body, objectives=objectives, **settings))


def objective_option(words: str, default: str) -> Option:
    """The option that names objectives; ``words`` says how worlds are combined."""
    goals = (
        "NAME of a measure of the robot or an objective of an installed package, WEIGHT*NAME, minimise:NAME or "
        "minimise:WEIGHT*NAME; repeat it for several, which add up, or make a front with methods for several "
        "objectives; or a limit, 'NAME >= NUMBER' or 'NAME <= NUMBER', which costs score where it is not kept"
    )
    return Option("objective", f"{goals}; or {words} (default: {default})", metavar="OBJECTIVE", several=True)


def options_of(kind: RobotKind) -> tuple[Option, ...]:
    """List the options of ``codesign`` for a kind of robot."""
    return designer_of(kind).options


def _check_held(asked: DesignRequest, known: Robot) -> None:
    """Refuse to hold other parameters than those that are held in the run that continues."""
    if (patterns := asked.given.get("hold")) is None:
        return
    if not isinstance(known, PartlyFixed):
        raise ValueError(f"hold: nothing is held in the run in {asked.out}; leave it out")
    from optim.problems import offered_by_run

    of = known.robot if asked.best_of is None else offered_by_run(asked.best_of)[0]  # options may have freed more
    if sorted(held_names(known)) != sorted([*held_names(of), *names_matching(of, patterns)]):
        raise ValueError(f"hold: the run in {asked.out} holds {', '.join(sorted(known.held))}; leave it out")


def _of_several(option: Option) -> str:
    """Help text of an option that names a world and may be repeated."""
    return f"{option.help.partition(' (default')[0]}; repeat it for several"


def designer_of(kind: RobotKind) -> Designer:
    """The designer of a kind of robot."""
    found: Designer = imported(DESIGNERS.get(kind.name, "optim.problems.designer:Designer"))(kind)
    return found
