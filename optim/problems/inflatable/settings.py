"""What of the inflatable robot a search may change, and how it is judged: settings, checks, and plain descriptions."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property, partial
from typing import Annotated, Any, Literal, Self

import numpy as np

from optim.problem import GAIT, check_kind
from optim.problems.inflatable.body_genes import EMPTY_CORE, MATERIAL_PARTS, LayoutGenes, MaterialGenes, ShapeGenes
from optim.problems.inflatable.encodings import ENCODINGS
from optim.problems.inflatable.graded_encoding import GradedGait
from optim.problems.inflatable.outcomes import NEXT
from optim.problems.robot_designing import RobotDesigning
from optim.problems.uncertain import checked_uncertain
from robots.calibration import Properties, robot_of
from robots.inflatable.actuation import PUBLISHED_COLUMNS, InflatableActuation
from robots.inflatable.body import NAMED_GEOMETRIES, InflatableGeometry
from robots.inflatable.convention import SpeedConvention
from robots.inflatable.design import Pressure, checked_pressure, each_pressure
from robots.inflatable.layout import Layout, checked_layout, told_layout
from robots.inflatable.materials import MOST_MODULUS, RegionMaterials
from robots.inflatable.schedule import BLADDERS, MOST_COLUMNS, MOST_REPEATS, GaitSchedule
from robots.inflatable.timing import Counting, nominal_steps
from robots.robot import KINDS, Facts, World
from robots.uncertainty import Uncertainty
from robots.world import Terrain
from taichi_sim.base.checks import NotNegative, check_fields, choice, number, whole_number

# What may be free to change, and the attribute of a design that holds it.
PARTS = {"orientation": "orientation", "shape": "pressure", "control": "schedule"}
GAIT_PARTS = ("core", "pace")  # of graded gaits, which may be free beside these
BLADDERS_PART = "bladders"  # which of them the body has
MORE_PARTS = (*GAIT_PARTS, *MATERIAL_PARTS, BLADDERS_PART)
# How relaxed gaits are judged, beside the true ones.
RELAXED_OPTIONS = ("window", "draws", "noise", "friction_spread", "gentle")
RISK_OPTIONS = ("uncertain", "risk")  # of all gaits, over the draws
GRADED_OPTIONS = ("steps", "warm_up", "stages")  # of a free graded gait
DESCRIBED = ("columns", "repeats", "geometry", "weight", "precision", "device")
# Described where they differ from their defaults: version 1.0 grew by them.
DESCRIBED_IF_SET = (
    *("encoding", "objectives", "ramp_steps", "steps", "warm_up", "stages", "most_full"),
    *("ladder", "ahead", "hard", "effort"),
    *RELAXED_OPTIONS,
    *RISK_OPTIONS,
    "bladders",
)
RIG_FILE = "calibration.json"  # in folders of runs
LONGEST_GAIT = 2**31 - 1  # time steps, which kernels count in 32 bits


@dataclass(frozen=True, eq=False)
class GaitSettings(RobotDesigning):
    """Settings of a search for gaits. What is given is fixed, what is None is free to change.

    Attributes:
        terrains: where the robot travels, one simulation each.
        orientation: [degrees], or None.
        pressure: of the core [Pa], the body's shape, or None; of several cores one for all, or a tuple.
        schedule: the control, or None.
        columns: of a free schedule.
        repeats: of a free schedule.
        encoding: of a free schedule, one of ``ENCODINGS``: ``"codes"``, ``"bits"``, ``"pattern"``, ``"graded"``,
            ``"graded-pattern"``, ``"graded-wave"``; patterns and codes have no gradients.
        objectives: ``"mean"`` of the speeds on all terrains; ``"terrains"``, the speed on each.
        ramp_steps: of the core pressure in relaxed evaluations. None is as published, but ``RAMP_STEPS`` if
            pressure is free: as published, the length of the ramp depends on it, and jumps.
        steps: time steps that a gait with times of its own may take, by which its speed is counted; None is those of a
            published gait, 186,719 of the published robot. Fewer are a cheaper judgement of the same gait.
        warm_up: time steps of a graded gait that do not count, nor does the cycle in which they end: what a robot does
            while it finds its stride. The time of the whole cycles that follow counts the speed.
        stages: equally long parts of a graded gait, of as many cycles after a warm-up, of which the slowest tells the
            speed: a gait that goes on beats one that lurches once.
        most_full: bladders of a graded gait that may be full at a time, the sum of a column's levels; None is all.
            Levels of a column with more are scaled down, also those of a gait at which a search starts.
        ladder: whether a terrain is for those gaits alone that are faster than ``ahead`` on the one before; the
            others are not simulated there, their speed is 0. In the mean all terrains but the last count ``ahead``
            at most. So gaits are led from easy ground to hard.
        ahead: speed that leads to the next terrain of the ladder [body lengths/s].
        hard: whether terrains count twice: as they are, and under the harder conditions of ``robustness``, where
            gaits fail that slide for their living; details end with ``_hard`` there. A gait
            that does not get ahead as it is counts so for both, and is not simulated again.
        more: what else is free, of ``MORE_PARTS``: core pressures of the columns, of each core, and the pace of every
            stroke, of graded gaits; friction of the feet, moduli and rest sizes of the regions, and which bladders
            there are, of any.
        window: cycles at the end of a relaxed gait by which its distance is differentiated, as if those before went as
            far, see ``robots.inflatable.differentiate``; 0 is all.
        draws: of start noise and friction, over which relaxed gaits are judged on average. All points have the same.
            With ``uncertain``, all gaits are.
        uncertain: friction and slope that are not known exactly, such as ``"friction=20%,slope=1"``, see
            ``robots.uncertainty``: every gait is judged over the draws, always the same ones. Empty is none.
        risk: how the speeds over these draws become one: ``"mean"``, ``"cvar:SHARE"`` or ``"worst"``.
        noise: of these, standard deviation of the start positions [m].
        friction_spread: of these, s: friction is multiplied by 1 / (1 + s) to 1 + s, evenly on a logarithmic scale.
        gentle: sharpness from which relaxed gaits are judged on the slopes as they are; below it, on as large a part of
            them as the sharpness is of this. So gradient ascent goes from flat ground to the hill. 0 is at once.
        effort: what moving the bladders costs [body lengths/s], subtracted from the mean of the speeds: so much where
            every one makes a full stroke in every column, see ``outcomes.effort``. Gaits become cleaner.
        geometry: name of a geometry, see ``NAMED_GEOMETRIES``.
        bladders: places that have a bladder, if that is not free; None is all. Genes of the others say nothing.
        weight: of bladders, ``"published"`` or ``"physical"``, see ``InflatableActuation``.
        properties: of the robot on a rig, as fitted to it; None is as published.
    """

    terrains: tuple[Terrain, ...]
    orientation: float | None = None
    pressure: Pressure | None = None
    schedule: GaitSchedule | None = None
    columns: Annotated[int, partial(whole_number, low=1, high=MOST_COLUMNS)] = 8
    repeats: Annotated[int, partial(whole_number, low=1, high=MOST_REPEATS)] = 2
    encoding: Annotated[str, partial(choice, names=ENCODINGS)] = "codes"
    objectives: Literal["mean", "terrains"] = "mean"
    ramp_steps: Annotated[int, partial(whole_number, low=1)] | None = None
    steps: Annotated[int, partial(whole_number, low=1, high=LONGEST_GAIT)] | None = None
    warm_up: Annotated[int, partial(whole_number, low=0, high=LONGEST_GAIT)] = 0
    stages: Annotated[int, partial(whole_number, low=1, high=MOST_COLUMNS)] = 1
    most_full: Annotated[float, partial(number, low=1.0, high=BLADDERS, unit="bladders")] | None = None
    ladder: bool = False
    ahead: NotNegative = NEXT
    hard: bool = False
    effort: NotNegative = 0.0
    more: tuple[str, ...] = ()
    window: Annotated[int, partial(whole_number, low=0, high=MOST_REPEATS)] = 0
    draws: Annotated[int, partial(whole_number, low=1, high=1000)] = 1
    noise: Annotated[float, partial(number, low=0.0, high=1e-3, unit="m")] = 0.0
    friction_spread: NotNegative = 0.0
    gentle: NotNegative = 0.0
    uncertain: str = ""
    risk: str = "mean"
    geometry: Annotated[str, partial(choice, names=NAMED_GEOMETRIES)] = "published"
    weight: str = "published"
    properties: Properties | None = None
    bladders: Annotated[Layout, checked_layout] | None = None
    precision: str = field(default="f32", kw_only=True)

    def __post_init__(self) -> None:
        check_fields(self)
        names = [terrain.name for terrain in self.terrains]
        if not names or len(set(names)) < len(names):
            raise ValueError(f"terrains: {', '.join(names) or 'none'} given; give at least one, and none twice")
        if self.pressure is not None:
            object.__setattr__(self, "pressure", checked_pressure(self.pressure))
            each_pressure(self.pressure, self.body)
        if not self.free:
            raise ValueError(f"free: nothing is free to change; free at least one of {', '.join(PARTS)}")
        self._check_more()
        self._check_risk()
        if self.schedule is not None:
            object.__setattr__(self, "columns", self.schedule.columns)
            object.__setattr__(self, "repeats", self.schedule.repeats)
            object.__setattr__(self, "encoding", "codes")  # unused
        if self.properties is not None and self._timed:
            self.properties.check_time_step(NAMED_GEOMETRIES[self.geometry])
        for name in (*GRADED_OPTIONS, "most_full"):
            if name in self._set and not self.graded:
                what = f"encoding {self.encoding!r}" if self.schedule is None else "a fixed gait"
                value = getattr(self, name)
                raise ValueError(f"{name}: {value} is not allowed with {what}; they are of a free graded gait")
        if 2 * self.warm_up > self.most_steps:
            raise ValueError(f"warm_up: {self.warm_up} is not allowed; give 0 to half of the steps")
        if self.ladder and len(self.terrains) < 2:
            raise ValueError("ladder: one terrain is not allowed; give several, the easiest first")
        if "ahead" in self._set and not self.ladder:
            raise ValueError(f"ahead: {self.ahead:g} is not allowed without a ladder")
        if self.effort and self.objectives != "mean":
            raise ValueError(f"effort: {self.effort:g} is not allowed with objectives, {self.objectives}; choose mean")

    def _check_more(self) -> None:
        """Refuse free parts that are unknown, or contradict the rest."""
        for part in self.more:
            choice("free", part, MORE_PARTS)
        object.__setattr__(self, "more", tuple(part for part in MORE_PARTS if part in self.more))
        for part in GAIT_PARTS:
            if part in self.more and (self.schedule is not None or self.encoding != "graded"):
                what = f"encoding {self.encoding!r}" if self.schedule is None else "a fixed gait"
                raise ValueError(f"free: {part} is not allowed with {what}; it is of a free gait, encoding graded")
        if "friction" in self.more:
            given = [t.name for t in self.terrains if (t.high_friction, t.low_friction) != (None, None) or t.is_fluid]
            if given:
                raise ValueError(f"free: friction is not allowed on {given[0]}, which has its own, or no ground")
        for name in ("noise", "friction_spread"):
            if getattr(self, name) and self.draws == 1:
                raise ValueError(f"{name}: {getattr(self, name):g} is not allowed with a single draw; give draws")
        if BLADDERS_PART in self.more and self.bladders is not None:
            raise ValueError(f"bladders: {told_layout(self.bladders)} would fix what is free; give one of both")
        if "modulus" in self.more:
            self.body.check_materials(RegionMaterials(modulus=(MOST_MODULUS,) * self.body.region_count))

    def _check_risk(self) -> None:
        """Refuse draws and risk that contradict the rest."""
        text = checked_uncertain(self.uncertain, self.risk, self.draws)
        object.__setattr__(self, "uncertain", text)
        if not text:
            return
        for terrain in self.terrains:
            Uncertainty.parse(text).check_ground(terrain)
        for name, given in (("friction_spread", self.friction_spread), ("noise", self.noise), ("ladder", self.ladder)):
            if given:
                raise ValueError(f"{name}: {given} is not allowed beside uncertain; leave out one of them")

    @property
    def _set(self) -> set[str]:
        """Names of the fields that differ from their defaults."""
        return {each.name for each in fields(self) if getattr(self, each.name) != each.default}

    @cached_property
    def _robot(self) -> tuple[InflatableGeometry, InflatableActuation]:
        return robot_of(self.geometry, self.weight, self.properties)

    @property
    def body(self) -> InflatableGeometry:
        """The robot's geometry."""
        return self._robot[0]

    @property
    def actuation(self) -> InflatableActuation:
        """How it is driven."""
        return self._robot[1]

    @property
    def most_steps(self) -> int:
        """Time steps that a gait with times of its own may take."""
        return nominal_steps(PUBLISHED_COLUMNS, self.actuation) if self.steps is None else self.steps

    @cached_property
    def convention(self) -> SpeedConvention | None:
        """How speeds count of which the options of a free graded gait say so; None is the published convention."""
        if self._set.isdisjoint(GRADED_OPTIONS):
            return None
        return SpeedConvention(Counting(self.warm_up, self.stages), self.steps)

    @cached_property
    def shape(self) -> ShapeGenes:
        """Variables of orientation and the body's shape."""
        least = EMPTY_CORE if self.graded else 0.0
        return ShapeGenes(self.orientation, self.pressure, self.body.cores, least)

    @property
    def free(self) -> tuple[str, ...]:
        """Which of ``PARTS`` are free to change."""
        return (*(part for part, attribute in PARTS.items() if getattr(self, attribute) is None), *self.more)

    @cached_property
    def made_of(self) -> MaterialGenes:
        """Variables of what the robot is made of."""
        free = tuple(part for part in MATERIAL_PARTS if part in self.more)
        return MaterialGenes(free, self.body, self.actuation)

    @cached_property
    def laid(self) -> LayoutGenes:
        """Variables of which bladders there are."""
        return LayoutGenes(BLADDERS_PART in self.more, self.bladders)

    @property
    def graded(self) -> bool:
        """Whether a schedule is searched that may have levels between 0 and 1, and has times of its own."""
        return self.schedule is None and issubclass(ENCODINGS[self.encoding], GradedGait)

    @property
    def tried_in(self) -> tuple[World, ...]:
        """The terrains."""
        return self.terrains

    @property
    def _timed(self) -> bool:
        """Whether gaits have times of their own."""
        return self.graded if self.schedule is None else self.schedule.has_own_times

    @property
    def _paced(self) -> bool:
        """Whether the gait is given, with paces of its own."""
        return self.schedule is not None and self.schedule.pace is not None

    def facts(self) -> Facts:
        """Terrains, what is free, what is fixed, and the simulation."""
        geometry = self.body
        held = [f"orientation {self.orientation:g}°"] if self.orientation is not None else []
        if self.pressure is not None:
            held.append("pressure " + ", ".join(f"{one:g}" for one in np.atleast_1d(self.pressure)) + " Pa")
        held += [f"bladders {told_layout(self.bladders)}"] if self.bladders is not None else []
        held += ["gait"] if self.schedule is not None else []
        aim = "mean speed over the terrains" if self.objectives == "mean" else "speed on each terrain"
        convention = "by the published convention" if self.convention is None else self.convention.spoken
        times = {1: "once", 2: "twice"}.get(self.repeats, f"{self.repeats} times")
        often = f"as often as {self.most_steps:,} time steps allow" if self.graded else times
        full = "" if self.most_full is None else f", at most {self.most_full:g} bladders full at a time"
        return [
            ("Robot", f"inflatable shape-changing robot, {self.geometry} geometry, {geometry.body_length:g} m long"),
            ("Terrains", ", ".join(KINDS[self.robot_kind].world_told(terrain) for terrain in self.terrains)),
            (
                "Objective",
                f"{aim if len(self.terrains) > 1 else 'speed'}, in body lengths a second {convention} (BL/s)",
            ),
            *([("Uncertain", f"{self.uncertain}: {self.risk} of {self.draws} draws")] if self.uncertain else []),
            ("Free", ", ".join(self.free)),
            ("Fixed", ", ".join(held) or "nothing"),
            ("Gait", f"{self.columns} columns, played {often}, encoded as {self.encoding}{full}"),
            *([("Rig", self.properties.spoken)] if self.properties else []),
            ("Simulation", f"{self.precision} on {self.device}, weight of bladders {self.weight}"),
        ]

    def describe(self) -> dict[str, Any]:
        """All that results depend on, as JSON values; :meth:`from_description` builds the problem again."""
        fixed = {
            "orientation": self.orientation,
            "pressure": _plain(self.pressure),
            "schedule": self.schedule.to_text() if self.schedule else None,
            "properties": dataclasses.asdict(self.properties) if self.properties else None,
        }
        described = (*DESCRIBED, *(name for name in DESCRIBED_IF_SET if name in self._set))
        return {
            "terrains": [KINDS[self.robot_kind].world_record(terrain) for terrain in self.terrains],
            "free": list(self.free),
            **_given(fixed),
            **{name: _plain(getattr(self, name)) for name in described},
        }

    @classmethod
    def settings_of(cls, description: Mapping[str, Any]) -> dict[str, Any]:
        """The fields of what was described."""
        check_kind(description, GAIT)
        settings = {name: value for name, value in description.items() if name not in ("free", "kind")}
        settings["more"] = tuple(part for part in MORE_PARTS if part in description.get("free", ()))
        settings["terrains"] = tuple(Terrain(**terrain) for terrain in settings["terrains"])
        if "properties" in settings:
            settings["properties"] = Properties(**settings["properties"])
        if "schedule" in settings:
            settings["schedule"] = GaitSchedule.from_text(settings["schedule"], settings["repeats"])
        return settings

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> Self:
        """The problem that :meth:`describe` described.

        Raises:
            ValueError: that names what is missing, unknown, not allowed or contradicts the rest.
        """
        problem = super().from_description(description)
        for name, value in problem.describe().items():
            if description.get(name) != value:
                found = description.get(name)
                raise ValueError(f"problem.{name}: {found!r} contradicts the rest, which says {value!r}")
        return problem


def _plain(value: Any) -> Any:
    """A value as JSON has it."""
    return list(value) if isinstance(value, tuple) else value


def _given(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}
