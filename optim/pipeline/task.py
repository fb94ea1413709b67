"""What is asked of the pipeline: a TOML file, checked before anything is simulated."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from itertools import permutations
from pathlib import Path
from typing import Any

from optim.pipeline.handover import WAYS, Way, handover, shape_change
from optim.pipeline.plans import core_of
from optim.problems.inflatable.problem import GaitProblem
from optim.search import METHODS, build_method, default_settings
from robots.calibration import Properties, load_calibration, robot_of, weight_of_calibration
from robots.hardware import PneumaticRig, RigViolation, gait_table, read_design
from robots.inflatable.actuation import PUBLISHED_COLUMNS, PUBLISHED_STEPS, WEIGHTS
from robots.inflatable.body import NAMED_GEOMETRIES
from robots.inflatable.design import BY_HAND, InflatableDesign, common_pressure, kilopascals
from robots.inflatable.journeys import refusal_of_ground, refusal_of_leg
from robots.inflatable.kind import InflatableKind
from robots.inflatable.timing import nominal_steps
from robots.world import Terrain
from taichi_sim.base.checks import choice, nearest, number, positive, whole_number
from taichi_sim.base.files import content_of, why_unread
from taichi_sim.base.parsing import parse_toml

KIND = InflatableKind()
LEAST_RUNS = 2
FOUND = "found-"  # how names begin of gaits that searches find
# Keys whose values are taken as they are.
PLAIN = ("geometry", "weight", "runs", "stretch", "seed", "precision", "frames")
PROBLEM = ("encoding", "columns", "repeats", "steps", "warm_up", "stages", "effort")  # keys of [search] about gaits


@dataclass(frozen=True)
class Limits:
    """What a gait and a change of shape must keep to."""

    least_speed: float = 0.005  # of a gait that works on a terrain [body lengths/s]
    most_steps: int = PUBLISHED_STEPS  # time steps that a gait may take; by default those of a published gait
    shape_error: float = 5e-3  # distance from the shape that a change may end with [m]
    moved: float = 0.5  # how far the robot may move during a change [body lengths]
    next_speed: float = 0.95  # part of its speed that the next gait must reach from there

    def __post_init__(self) -> None:
        for name in ("least_speed", "shape_error", "moved"):
            positive(f"limits.{name}", getattr(self, name))
        number("limits.next_speed", self.next_speed, 0.0, 1.0)
        whole_number("limits.most_steps", self.most_steps, 1)


@dataclass(frozen=True)
class SearchSettings:
    """How gaits are searched on each terrain, beside those that are given."""

    method: str  # name in ``METHODS``
    generations: int  # of each search
    settings: Mapping[str, Any] = field(default_factory=dict)  # of the method, without its seed
    problem: Mapping[str, Any] = field(default_factory=dict)  # options of ``GaitProblem``


@dataclass(frozen=True)
class PipelineTask:
    """A task."""

    terrains: tuple[Terrain, ...]  # where the robot shall go, at least one
    gaits: Mapping[str, InflatableDesign]  # that are tried on every terrain, by name
    search: SearchSettings | None = None  # of more gaits; None for none
    geometry: str = "published"  # name of the robot's geometry
    runs: int = 4  # noisy runs that a speed is the mean of
    stretch: float = 20.0  # way on a terrain before the next one comes [body lengths]
    seed: int = 0  # of noise and searches
    precision: str = "f64"  # of all simulations
    frames: int = 300  # of the player page, about; fewer make it smaller
    limits: Limits = field(default_factory=Limits)  # what gaits and changes of shape must keep to
    rig: PneumaticRig = field(default_factory=PneumaticRig)  # that plays the package
    calibration: Properties | None = None  # properties of the robot on that rig; None is the published robot
    weight: str = "published"  # of bladders, or physical

    def __post_init__(self) -> None:
        names = [terrain.name for terrain in self.terrains]
        if not names or len(set(names)) < len(names):
            raise ValueError(f"terrains: {', '.join(names) or 'none'} given; give at least one, and none twice")
        if not self.gaits and self.search is None:
            raise ValueError("gaits: none given, and no search; give gaits to try, or [search]")
        choice("geometry", self.geometry, NAMED_GEOMETRIES)
        choice("weight", self.weight, WEIGHTS)
        if NAMED_GEOMETRIES[self.geometry].cores > 1:
            raise ValueError(f"geometry: {self.geometry!r} is not allowed; the tables of a package have one core")
        self.rig.check_plays_gaits()
        if self.rig.cores > 1:
            raise ValueError(
                f"rig: {self.rig.cores} lines for cores are not allowed; the tables of a package have one core"
            )
        if self.calibration is not None:
            self.calibration.check_time_step(NAMED_GEOMETRIES[self.geometry])
        self._check_gaits()
        choice("precision", self.precision, ("f32", "f64"))
        whole_number("runs", self.runs, LEAST_RUNS)
        whole_number("seed", self.seed, 0)
        whole_number("frames", self.frames, 2)
        positive("stretch", self.stretch)
        if self.search is not None:
            problem = self.problem(self.terrains[0])
            build_method(self.search.method, problem.space, self.method_settings)

    def _check_gaits(self) -> None:
        for name, design in self.gaits.items():
            if self.search is not None and name.startswith(FOUND):
                raise ValueError(
                    f"gaits: {name} is not allowed beside a search, whose gaits are called so; rename its file"
                )
            if common_pressure(design.pressure) is None:
                raise ValueError(f"gaits: {name} has {kilopascals(design.pressure)}, which no table says; give one")
            if refusal := self.refusal(design):
                raise ValueError(f"gaits: {name}: {refusal}")
        if len(self.terrains) > 1 and (len(self.gaits) > 1 or self.search is not None):
            self._check_legs()  # a lone gait goes on from a terrain to the next without a change of shape

    def _check_legs(self) -> None:
        for terrain in self.terrains:
            if refusal := refusal_of_ground(terrain):
                raise ValueError(f"terrains: {refusal}")
        for name, design in self.gaits.items():
            if refusal := refusal_of_leg(design):
                raise ValueError(f"gaits: {name}: {refusal}")
            if design.last_pressure != design.pressure:
                first, last = kilopascals(design.pressure), kilopascals(design.last_pressure)
                raise ValueError(
                    f"gaits: {name} begins with {first} and ends with {last}; give one that ends as it began"
                )
        for (first, before), (second, after) in permutations(self.gaits.items(), 2):
            if refusal := self.refusal_between(before, after):
                raise ValueError(f"gaits: from {first} to {second}: {refusal}")

    @property
    def robot(self) -> dict[str, Any]:
        """Geometry and actuation, as options of simulations."""
        geometry, actuation = robot_of(self.geometry, self.weight, self.calibration)
        return {"geometry": geometry, "actuation": actuation}

    def refusal(self, design: InflatableDesign) -> str:
        """Why the rig cannot play a gait; nothing if it can."""
        try:
            gait_table(design, self.rig)
        except RigViolation as error:
            return str(error)
        return ""

    def ways_between(self, before: InflatableDesign, after: InflatableDesign) -> dict[Way, InflatableDesign]:
        """Changes of shape that the rig can play from the end of a gait to the beginning of another."""
        found = {way: shape_change(before, after, way, self.core_times, self.robot) for way in WAYS}
        return {way: change for way, change in found.items() if not self._refused(before, change, after)}

    def refusal_between(self, before: InflatableDesign, after: InflatableDesign) -> str:
        """Why the rig cannot go from a gait to another without venting its lines; nothing if it can."""
        if core_of(before) == core_of(after):
            return self._refused(before, None, after)
        if self.ways_between(before, after):
            return ""
        return self._refused(before, shape_change(before, after, WAYS[0], self.core_times, self.robot), after)

    def _refused(self, before: InflatableDesign, change: InflatableDesign | None, after: InflatableDesign) -> str:
        try:
            handover(before, change, after, self.rig)
        except RigViolation as error:
            return f"{error.violations[0]}; give a rig that takes more time, or other gaits"
        return ""

    def problem(self, terrain: Terrain, **where: Any) -> GaitProblem:
        """What is searched on a terrain: orientation, shape and control."""
        assert self.search is not None
        given = {
            "geometry": self.geometry,
            "weight": self.weight,
            "precision": self.precision,
            "properties": self.calibration,
            **self.search.problem,
            **where,
        }
        return GaitProblem((terrain,), **given)

    @property
    def method_settings(self) -> dict[str, Any]:
        """Settings of the search method, with the task's seed."""
        assert self.search is not None
        return {**default_settings(self.search.method), **self.search.settings, "seed": self.seed}

    @property
    def core_times(self) -> tuple[float, float]:
        """Times that the rig takes to bring the core up and down [s]."""
        core = self.rig.channels[0]
        return core.rise_s, core.fall_s


def slug(terrain: Terrain) -> str:
    """The name of a terrain in names of files."""
    return terrain.name.replace(":", "-").replace("/", "-")


def read_task(path: Path) -> PipelineTask:
    """Read a task; raises ValueError for what cannot be read, unknown keys, and values that are not allowed."""
    try:
        given = parse_toml(content_of(path))
    except (OSError, ValueError) as error:
        raise ValueError(f"task: {path} cannot be read ({why_unread(error)})") from None
    _check_keys(path, "", given, [*(each.name for each in fields(PipelineTask)), *KIND.ground_options])
    if "terrains" not in given:
        raise ValueError(f"task: {path} has no terrains; give some, such as terrains = ['flat', 'hill:15']")
    terrains = _names("terrains", given["terrains"], "give names, such as ['flat', 'hill:15']")
    beside = _file("calibration", given, path, "give the calibration.json of morpholab calibrate")
    calibration, geometry = load_calibration(beside) if beside else (None, "published")
    weight = {"weight": weight_of_calibration(beside)} if beside else {}
    rig = _file("rig", given, path, "give the name of a rig, or its file")
    return PipelineTask(
        _grounds([Terrain.parse(name) for name in terrains], given),
        _gaits(path, given.get("gaits", [])),
        _search(path, given["search"]) if "search" in given else None,
        limits=_limits(path, given.get("limits", {}), calibration),
        rig=PneumaticRig.load(str(rig if rig.is_file() else given["rig"])) if rig else PneumaticRig(),
        calibration=calibration,
        **{"geometry": geometry, **weight, **{name: given[name] for name in PLAIN if name in given}},
    )


def _grounds(terrains: list[Terrain], given: Mapping[str, Any]) -> tuple[Terrain, ...]:
    """The terrains with the friction that a task gives, which is of those with a ground."""
    own = {name: given[name] for name in KIND.ground_options if name in given}
    dry = [terrain for terrain in terrains if not terrain.is_fluid] or terrains
    return tuple(KIND.on_ground(each, own) if own and each in dry else each for each in terrains)


def _check_keys(path: Path, table: str, given: Any, known: list[str]) -> None:
    where = f" in [{table}]" if table else ""
    if not isinstance(given, dict):
        raise ValueError(f"task: {path} has {table} = {given!r}; give a table [{table}]")
    for key in given:
        if key not in known:
            raise ValueError(f"task: {path} has an unknown key {key!r}{where}{nearest(key, known)}")


def _names(field: str, given: Any, hint: str) -> list[str]:
    if not isinstance(given, list) or not all(isinstance(name, str) for name in given):
        raise ValueError(f"{field}: {given!r} is not allowed; {hint}")
    return given


def _file(field: str, given: Mapping[str, Any], path: Path, hint: str) -> Path | None:
    """The file beside the task that a key names; None if there is no such key."""
    if field not in given:
        return None
    if not isinstance(given[field], str):
        raise ValueError(f"{field}: {given[field]!r} is not allowed; {hint}")
    return path.parent / given[field]


def _gaits(path: Path, given: Any) -> dict[str, InflatableDesign]:
    """Gaits of the robot by name: those made by hand, and files or gait tables, relative to the task."""
    found: dict[str, InflatableDesign] = {}
    for name in _names("gaits", given, "give names or files, such as ['rolling', 'climb.json']"):
        label = Path(name).stem
        if label in found:
            raise ValueError(f"gaits: {label!r} is given twice; give files of different names")
        found[label] = BY_HAND[name] if name in BY_HAND else read_design(path.parent / name)
    return found


def _search(path: Path, given: Any) -> SearchSettings:
    method, own = "", list[str]()
    if isinstance(given, dict):
        method = choice("search.method", given.get("method", "genetic"), METHODS)
        own = [name for name in default_settings(method) if name != "seed"]
    _check_keys(path, "search", given, ["method", "generations", *PROBLEM, *own])
    generations = whole_number("search.generations", given.get("generations", 20), 0)
    settings, problem = ({name: given[name] for name in names if name in given} for names in (own, PROBLEM))
    return SearchSettings(method, generations, settings, problem)


def _limits(path: Path, given: Any, calibration: Properties | None) -> Limits:
    _check_keys(path, "limits", given, [each.name for each in fields(Limits)])
    drive = robot_of("published", "published", calibration)[1]
    return Limits(**{"most_steps": nominal_steps(PUBLISHED_COLUMNS, drive), **given})
