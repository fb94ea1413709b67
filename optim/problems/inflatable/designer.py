"""What ``codesign`` and ``gradient-check`` can be asked of the inflatable robot, and the problems made of it."""

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from optim.problem import RelaxableProblem
from optim.problems.designer import COMPUTE, Design, Designer, DesignRequest
from robots.inflatable.actuation import WEIGHTS
from robots.inflatable.design import InflatableDesign
from robots.inflatable.kind import BLADDERS_OPTION, GEOMETRIES, RIG_OPTION, load_gait, pressure
from robots.robot import Option
from taichi_sim.base.options import count, flag, number

if TYPE_CHECKING:
    from optim.problems.inflatable.problem import GaitProblem
    from robots.inflatable.schedule import GaitSchedule

RELAXED = ("bits", "graded")  # encodings with gradients
ENCODING_NAMES = ("codes", "bits", "pattern", "graded", "graded-pattern", "graded-wave")
HORIZONS = (1, 2)  # columns that ``gradient-check`` plays
# Options that are fields of the problem by the same name.
SETTINGS = (
    *("columns", "repeats", "geometry", "weight", "bladders"),
    *("steps", "warm_up", "stages", "most_full", "ladder", "ahead", "hard", "effort"),
    *("window", "draws", "noise", "friction_spread", "gentle", "risk"),
)
WORDS = ("mean", "terrains")  # how the speeds on several terrains are judged
INSIDE = 0.15  # how far levels keep from off and on there
OPTIONS = (
    Option(
        "free",
        "what may change (default: orientation,shape,control; more: core, pressure of the cores in every column, and "
        "pace of every stroke, both with --encoding graded; friction of the feet, modulus and size of every region; "
        "bladders, which places have one)",
        metavar="PARTS",
    ),
    Option(
        "encoding",
        "of the control: frequency and offset of each actuator, every bit, a network that makes patterns, or how far "
        "bladders inflate and how long the robot settles, played as often as --steps allow, level by level, by a "
        "network, or as a wave around the robot (default: codes; bits with --method gradient)",
        choices=ENCODING_NAMES,
    ),
    count(
        "steps",
        1,
        "time steps of a graded gait, by which its speed is counted (default: those of a published gait, 186719 of the "
        "published robot)",
    ),
    count("warm_up", 0, "first time steps of a graded gait, which do not count"),
    count("stages", 1, "equally long parts of a graded gait, of which the slowest tells its speed (default: 1)"),
    Option(
        "most_full",
        "bladders of a graded gait that may be full at a time, the sum of a column's levels; those of a column with "
        "more are scaled down (default: all)",
        number(1.0, 8.0, "bladders"),
        "N",
    ),
    flag(
        "ladder",
        "of several terrains, the easiest first, a gait is tried on the next if it is faster than --ahead on the one "
        "before, which counts no more than that in the mean",
    ),
    Option(
        "ahead",
        "speed that leads to the next terrain of the ladder, in body lengths a second (default: 0.02)",
        number(0.0),
        "SPEED",
    ),
    flag(
        "hard",
        "judge gaits that get ahead also with friction 0.2 or more of sliding feet and bladders that keep their weight",
    ),
    Option(
        "effort",
        "what it costs to move every bladder in every column, in body lengths a second (default: 0)",
        number(0.0),
        "SPEED",
    ),
    count(
        "window",
        0,
        "cycles at the end of a relaxed gait by which it is differentiated, as if those before went as far "
        "(default: all)",
    ),
    count(
        "draws",
        1,
        "of noise and friction, over which relaxed gaits are judged on average (default: 1), or of what is "
        "uncertain (default: 16)",
    ),
    Option(
        "uncertain",
        "what is not known exactly, such as friction=20%%,slope=1 (degrees): every gait is judged over --draws of it; "
        "friction scales the pair, sliding and gripping one of them, levels the inflation of every bladder, timing "
        "strokes and waits; repeat it for more",
        metavar="QUANTITY=WIDTH,...",
        several=True,
    ),
    Option("risk", "over these draws: mean, cvar:SHARE of the worst, or worst (default: mean)", metavar="RISK"),
    Option("noise", "of these draws, on the start positions (default: 0)", number(0.0, 1e-3, "m"), "M"),
    Option(
        "friction_spread",
        "of these draws, S: friction is multiplied by 1 / (1 + S) to 1 + S (default: 0)",
        number(0.0),
        "S",
    ),
    Option(
        "gentle",
        "sharpness of relaxed gaits from which slopes are as they are; below it they rise with it (default: at once)",
        number(0.0),
        "SHARPNESS",
    ),
    Option(
        "gait",
        "inching, rolling or the file of a design: gives what is not free (default: rolling, with hills alone inching)",
        metavar="GAIT",
    ),
    Option("orientation", "if not free (default: the gait's own)", number(0.0, 90.0, "degrees"), "DEGREES"),
    Option(
        "pressure",
        "if shape is not free, of all cores or such as 12000,0 of each (default: the gait's own)",
        pressure(),
        "PA",
    ),
    RIG_OPTION,
    Option("geometry", "the robot's body (default: published)", choices=GEOMETRIES),
    BLADDERS_OPTION,
    count("columns", 1, "of the schedule (default: 8, or all of the gait if control is not free)", metavar="T"),
    count("repeats", 1, "how often the columns are played (default: 2, or the gait's own if control is not free)"),
    Option(
        "weight", "of bladders: none while they move or stay inflated, or always (default: published)", choices=WEIGHTS
    ),
    Option(
        "start",
        "a gait, or the file of one, near which a search of bits, graded levels or waves starts (default: random)",
        metavar="GAIT",
    ),
    Option(
        "start_orientation",
        "with which every climber starts (default: random)",
        number(0.0, 90.0, "degrees"),
        "DEGREES",
    ),
    Option(
        "start_pressure",
        "with which every climber starts; of several cores all, or such as 12000,0 (default: random)",
        pressure(12_000.0),
        "PA",
    ),
)


class InflatableDesigner(Designer):
    """Searches encode gaits in ways of their own, and judge them on terrains one after the other."""

    holds = False  # --orientation and --pressure do

    @property
    def options(self) -> tuple[Option, ...]:
        """What ``codesign`` can be asked."""
        worlds = super().options[: len(self.kind.world_options)]
        objective = Option(
            "objective",
            "mean or terrains: the mean speed over the terrains, or that on each of them (default: mean; terrains with "
            "methods for several objectives); speed, its only measure, may be named, too",
            metavar="OBJECTIVE",
            several=True,
        )
        return (*worlds, objective, *OPTIONS)

    def design(self, asked: DesignRequest) -> Design:
        """The gait problem asked for, and what was fixed by default."""
        from optim.problems.inflatable.problem import GaitProblem

        known: Any = asked.known
        args = SimpleNamespace(**{option.name: asked.given.get(option.name) for option in self.options})
        args.gait, args.terrain = args.gait or asked.source, self.kind.chosen_worlds(asked.given)
        settings = {f.name: getattr(known, f.name) for f in dataclasses.fields(known)} if known else {}
        if known and known.schedule is None:
            asked.same("problem.encoding", args.encoding, known.encoding)
        settings.setdefault("encoding", args.encoding or ("bits" if asked.method == "gradient" else "codes"))
        _choose_objectives(settings, args, asked)
        _choose_robot(settings, args, asked)
        note = _choose_parts(settings, args, asked)
        _check_control(settings, args, asked.method)
        problem = GaitProblem(**settings)
        more = {"verify": True} if asked.method == "gradient" else {}  # a relaxed judgement is never quite the true one
        return Design(problem, note, _start(args, problem), more)

    def horizons(
        self, source: str | None, given: Mapping[str, Any], wanted: Sequence[int] | None
    ) -> dict[str, tuple[RelaxableProblem, NDArray[Any]]]:
        """The gait cut to some of its columns, or played several times."""
        from robots.inflatable.design import each_pressure

        for name in ("columns", "repeats", "pressure", "orientation", "calibration"):
            if name in given:
                raise ValueError(f"{name}: it is not of this check; leave it out")
        gait = load_gait(source or "inching")
        if gait.bladders is not None:
            given = {"bladders": gait.bladders, **given}
        found: dict[str, tuple[RelaxableProblem, NDArray[Any]]] = {}
        for columns in _horizons(wanted, gait.schedule.columns):
            repeats = max(columns // gait.schedule.columns, 1)
            problem, genes = _checked_problem(self, given, gait.schedule.cut(columns // repeats, repeats))
            point = np.concatenate([[gait.orientation], each_pressure(gait.pressure, problem.body), genes])
            found["1 column" if columns == 1 else f"{columns} columns"] = problem, point
        return found


def _choose_objectives(settings: dict[str, Any], args: SimpleNamespace, asked: DesignRequest) -> None:
    """The mean over the terrains, or each of them where the method looks for a front."""
    texts = args.objective or []
    for text in texts:
        if text not in (*WORDS, "speed"):
            more = "; --effort says what it costs to move" if "effort" in text or "energy" in text else ""
            raise ValueError(f"objective: {text!r} is not allowed; gaits have mean, terrains and speed{more}")
    words = [text for text in texts if text in WORDS]
    if len(words) > 1 or len(set(texts)) < len(texts):
        raise ValueError(f"objective: {', '.join(texts)} are not allowed together; give mean or terrains once")
    word = words[0] if words else None
    if asked.known is not None:
        asked.same("problem.objectives", word, settings["objectives"])
    settings.setdefault("objectives", word or ("terrains" if asked.several else "mean"))
    count = len(set(args.terrain))
    if settings["objectives"] == "terrains" and not asked.several:
        why = f"needs a method for several objectives; {asked.method} takes one, the mean"
        raise ValueError(f"objective: 'terrains' {why}")
    if settings["objectives"] == "terrains" and asked.known is None and count < 2:
        raise ValueError("objective: 'terrains' needs at least two; repeat --terrain, or choose --objective mean")


def _choose_robot(settings: dict[str, Any], args: SimpleNamespace, asked: DesignRequest) -> None:
    """Body, terrains, simulation, what is uncertain, and what belongs to graded gaits."""
    from optim.problems.uncertain import uncertain_settings

    if args.calibration is not None:
        from robots.calibration import load_calibration, weight_of_calibration

        settings["properties"], own = load_calibration(args.calibration)
        settings.setdefault("geometry", own)
        settings.setdefault("weight", weight_of_calibration(args.calibration))
    settings |= asked.chosen((*SETTINGS, *COMPUTE))
    settings |= uncertain_settings(asked.given, asked.known)
    settings["terrains"] = tuple(args.terrain or settings.get("terrains", ()))
    if not settings["terrains"]:
        if asked.resume:
            raise ValueError(
                f"out: {asked.out} holds no run to continue; `morpholab status {asked.out.parent}` lists those near it"
            )
        raise ValueError("terrain: none given; say where the robot shall travel, such as --terrain flat")


def _choose_parts(settings: dict[str, Any], args: SimpleNamespace, asked: DesignRequest) -> str:
    """Set what is not free; a note on what was fixed by default."""
    from optim.problems.inflatable.settings import MORE_PARTS

    free = _free_parts(args, asked)
    settings["more"] = tuple(part for part in MORE_PARTS if part in free)
    # As published, what is not free is as in rolling on flat ground, as in inching on hills; both: rolling.
    gait = args.gait or ("inching" if all(terrain.slope for terrain in settings["terrains"]) else "rolling")
    design = load_gait(gait)
    own = design.materials.given if design.materials else {}
    if fixed := sorted(set(own) - set(free)):
        raise ValueError(f"gait: {gait} has {fixed[0]} of its own, which a search cannot hold; add it to --free")
    if design.bladders is not None and "bladders" not in free:
        settings.setdefault("bladders", design.bladders)
    taken = _fix_parts(settings, free, args, design)
    if args.gait and not taken:
        raise ValueError(f"gait: {gait} is not used; all it could give is free, or given")
    return f"{', '.join(taken)} neither free nor given: as in {gait}" if taken and not args.gait else ""


def _free_parts(args: SimpleNamespace, asked: DesignRequest) -> Collection[str]:
    """The parts of the design that are free: those of ``--free``, of the run that goes on, or the usual ones."""
    from optim.problems.inflatable.settings import MORE_PARTS, PARTS

    free: Collection[str] = args.free.split(",") if args.free is not None else getattr(asked.known, "free", PARTS)
    known = (*PARTS, *MORE_PARTS)
    unknown = [part for part in free if part not in known]
    if unknown:
        raise ValueError(f"free: {unknown[0]!r} is unknown; give some of {','.join(known)}")
    if len(set(free)) < len(free):
        raise ValueError(f"free: {','.join(free)} is not allowed; give none twice")
    return free


def _fix_parts(
    settings: dict[str, Any], free: Collection[str], args: SimpleNamespace, design: InflatableDesign
) -> list[str]:
    """Set the value of every part that is not free; the names of those that a design gave."""
    from optim.problems.inflatable.settings import PARTS

    taken = []
    for part, name in PARTS.items():
        given = getattr(args, name, None)
        if part in free:
            if given is not None:
                hint = f"take {part} out of --free, or use --start-{name}"
                told = ",".join(f"{value:g}" for value in (given if isinstance(given, tuple) else (given,)))
                raise ValueError(f"{name}: {told} would fix what is free; {hint}")
            settings[name] = None
        elif given is not None:
            settings[name] = given
        elif args.gait or settings.get(name) is None:
            settings[name] = getattr(design, name)
            taken.append(name)
    return taken


def _check_control(settings: dict[str, Any], args: SimpleNamespace, method: str) -> None:
    """Cut a fixed schedule; refuse options that say nothing of the control."""
    if settings["schedule"] is not None:
        if args.encoding is not None:
            raise ValueError(f"encoding: {args.encoding!r} is not used; the control is fixed")
        settings["schedule"] = settings["schedule"].cut(args.columns, args.repeats)
        return
    if method == "gradient" and settings["encoding"] not in RELAXED:
        raise ValueError(
            f"encoding: {settings['encoding']!r} has no gradient; method gradient needs {' or '.join(RELAXED)}"
        )
    if settings["encoding"].startswith("graded") and args.repeats is not None:
        raise ValueError(f"repeats: {args.repeats} is not allowed; graded gaits are played as often as --steps allow")


def _start(args: SimpleNamespace, problem: "GaitProblem") -> dict[str, float]:
    """Where variables start: at a gait, but for what is given of its shape; a pressure is of all cores, or one each."""
    from robots.inflatable.design import each_pressure

    start = {} if args.start is None else problem.start_values(load_gait(args.start))
    if args.start_orientation is not None:
        start["orientation"] = args.start_orientation
    if args.start_pressure is not None:
        start |= dict(zip(problem.shape.pressures, each_pressure(args.start_pressure, problem.body), strict=True))
    return start


def _horizons(wanted: Sequence[int] | None, columns: int) -> Sequence[int]:
    """Numbers of columns, ascending; those of the gait that exist by default."""
    if wanted is None:
        return [n for n in HORIZONS if n <= columns] or [columns]
    wrong = [n for n in wanted if n > columns and n % columns]
    if wrong:
        raise ValueError(f"horizons: {wrong[0]} is not allowed; give 1 to {columns} columns, or multiples of {columns}")
    return wanted


def _checked_problem(
    designer: Designer, options: Mapping[str, Any], schedule: "GaitSchedule"
) -> "tuple[GaitProblem, NDArray[Any]]":
    """A problem whose encoding says the schedule, and its genes of it, levels away from off and on."""
    from optim.problems.inflatable.graded_encoding import GradedGait
    from optim.problems.inflatable.problem import GaitProblem
    from robots.inflatable.schedule import ROWS
    from robots.world import Terrain

    given: dict[str, Any] = {
        name: options[name] for name in ("geometry", "weight", "bladders", *COMPUTE) if name in options
    }
    given |= {"columns": schedule.columns, "repeats": schedule.repeats, "encoding": "bits"}
    given.setdefault("precision", "f64")
    genes = np.array(schedule.levels).ravel()
    if schedule.has_own_times or schedule.core_pressure is not None:
        # All columns in a row, once, however long a difference makes them.
        given |= {"columns": schedule.columns * schedule.repeats, "repeats": 1, "encoding": "graded", "steps": 1}
        genes = GradedGait.genome(schedule)
    levels = slice(ROWS * given["columns"])
    genes[levels] = np.clip(genes[levels], INSIDE, 1 - INSIDE)
    world = designer.kind.chosen_world(options)
    terrain = world if isinstance(world, Terrain) else Terrain()
    return GaitProblem((terrain,), **given), genes
