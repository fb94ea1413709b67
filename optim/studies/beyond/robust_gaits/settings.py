"""How large the study of gaits for a real floor is, and the problems that its searches solve."""

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Annotated, Any

from optim.experiments.study import Count, Settings, Whole
from optim.problems.inflatable.graded_encoding import SETTLING
from optim.problems.inflatable.problem import GaitProblem
from optim.studies.beyond.gait_hunt.finalists import check_friction
from robots.hardware.rig import PRESETS
from robots.inflatable.body import NAMED_GEOMETRIES
from robots.inflatable.schedule import BLADDERS
from robots.uncertainty import Uncertainty
from robots.world import FLOORS, STEEPEST, Terrain, floor_of
from taichi_sim.base import checks
from taichi_sim.base.compute import Precision

NAME = "robust-gaits"
PRESSURE = 12e3  # of the core [Pa]
BATCH = 8  # gaits, or draws, of a part whose results are kept
Geometry = Annotated[str, partial(checks.choice, names=NAMED_GEOMETRIES)]
DESCRIBED_IF_SET = ("friction", "capped")  # which folders of before do not know


def checked_slopes(field_name: str, value: Any) -> tuple[float, ...]:
    """Different slopes, from level ground to the steepest that a world has [degrees]."""
    slopes = _numbers(field_name, value, STEEPEST, "degrees")
    if not slopes or len(set(slopes)) < len(slopes):
        raise ValueError(f"{field_name}: {value!r} is not allowed; give one or more different slopes")
    for slope in slopes:
        if float(f"{slope:g}") != slope:
            raise ValueError(f"{field_name}: {slope} is not allowed; give at most six digits, which name files")
    return slopes


def _settling(field_name: str, value: Any) -> tuple[float, ...]:
    """Times that waves settle after each column [time steps]."""
    if not (times := _numbers(field_name, value, SETTLING, "time steps")):
        raise ValueError(f"{field_name}: {value!r} is not allowed; give one or more numbers")
    return times


def _numbers(field_name: str, value: Any, most: float, unit: str) -> tuple[float, ...]:
    """Numbers from 0 to the most that is allowed."""
    if not isinstance(value, list | tuple):
        raise ValueError(f"{field_name}: {checks.shown(value)} is not allowed; give numbers")
    return tuple(checks.number(field_name, each, 0.0, most, unit) for each in value)


@dataclass(frozen=True)
class RobustGaits(Settings):
    """How large the study is, and on which floor: a named one, or one of a given friction, which then has no name."""

    slopes: Annotated[tuple[float, ...], checked_slopes] = (0.0, 9.0, 11.0, 12.0, 13.0, 14.0)  # [degrees]
    floor: Annotated[str, partial(checks.choice, names=FLOORS)] = "wood"
    geometry: Geometry = "published"
    uncertain: str = "friction=20%,slope=1,levels=5%,timing=5%"
    draws: Count = 4  # that a search sees
    held_out: Count = 64  # by which gaits are judged
    most_full: Annotated[int, partial(checks.integer, low=1, high=BLADDERS)] = 4  # bladders at a time, of waves
    settling: Annotated[tuple[float, ...], _settling] = (0.0,)  # of screened waves, time steps after each column
    steps: Count = 60_000  # of gaits in searches
    warm_up: Whole = 15_000  # of these, before what counts
    budget: Annotated[float, checks.positive] = 10e6  # of each search [robot-steps]
    begins: Annotated[int, partial(checks.integer, low=1, high=BLADDERS)] = BLADDERS  # columns a start is tried from
    population: Count = 12
    seed: Whole = 0
    # Than the steepest slope, on which its gait is tried [degrees].
    steeper: Annotated[tuple[float, ...], partial(_numbers, most=STEEPEST, unit="degrees")] = (2.0, 4.0, 6.0, 8.0)
    precision: Precision = "f64"  # of the judgement
    rig: Annotated[str, partial(checks.choice, names=tuple(PRESETS))] = "dissertation-lag"  # that plays what is found
    friction: Annotated[tuple[float, float], check_friction] | None = None  # of sliding and of gripping feet
    capped: bool = False  # whether gaits of searches have at most ``most_full`` bladders full at a time, as waves do

    def __post_init__(self) -> None:
        super().__post_init__()
        Uncertainty.parse(self.uncertain)
        if self.friction is not None and (named := floor_of(self.friction)):  # however it is given, it is one study
            object.__setattr__(self, "floor", named)
            object.__setattr__(self, "friction", None)

    def describe(self) -> dict[str, Any]:
        """All that results depend on, as folders of before have it: a friction is told in place of a floor."""
        unset = {name for name in DESCRIBED_IF_SET if not getattr(self, name)}
        told = {name: value for name, value in super().describe().items() if name not in unset}
        if self.friction is not None:
            del told["floor"]
        return told

    @cached_property
    def uncertainty(self) -> Uncertainty:
        """The uncertainty that the setting ``uncertain`` states."""
        return Uncertainty.parse(self.uncertain)

    def terrain(self, slope: float) -> Terrain:
        """The floor, tilted."""
        low, high = self.friction or FLOORS[self.floor]
        return Terrain(slope, high, low)

    def problem(self, slope: float, robust: bool, threads: int | None = None, rolls: bool = True) -> GaitProblem:
        """The problem of a search on a slope, over draws or without, for waves that roll or a flat body."""
        own: dict[str, Any] = (
            {"uncertain": self.uncertainty.text, "draws": self.draws, "risk": "worst"} if robust else {}
        )
        return GaitProblem(
            (self.terrain(slope),),
            orientation=0.0 if rolls else None,
            pressure=PRESSURE if rolls else 0.0,
            encoding="graded-wave" if rolls else "graded",
            steps=self.steps,
            warm_up=self.warm_up,
            geometry=self.geometry,
            weight="physical",
            most_full=self.most_full if self.capped else None,
            threads=threads,
            **own,
        )


def file_of(gait: str) -> str:
    """The name of the file of a gait, without its ending."""
    return gait.replace(" ", "-").replace("°", "")
