"""Whether rolling and inching survive when a parameter of the simulated robot is another one.

Source: Powers 2021 dissertation, ch. 5, "Discussion": modulus, timescale, maximum pressure, number of voxels per
bladder and density "could be adjusted without causing drastic changes in behavior".
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np

from optim.experiments.data import Data
from optim.experiments.figures import COLOURS, PAGE, figure, logarithmic
from optim.experiments.results import Progress, computed_arrays, write_summary
from optim.experiments.study import Count, Settings, Study
from optim.experiments.tables import Record, column, distinct, markdown, page, select
from optim.studies.chapter5.gaits import Case, GaitRuns, repeated, shown, spread
from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.body import PUBLISHED, InflatableGeometry
from robots.inflatable.design import INCHING, ROLLING
from robots.inflatable.schedule import MAXIMUM_PRESSURE
from robots.inflatable.timing import nominal_steps
from robots.world import STEEPEST, Terrain
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats
from taichi_sim.base.results_folder import ResultsFolder

NAME = "hand-gait-sensitivity"
FULL_PRESSURE = ACTUATION.round_pressure  # Pa, of the round robot


@dataclass(frozen=True)
class Variant:
    """A robot of which one thing is different."""

    geometry: InflatableGeometry = PUBLISHED  # shape and materials
    timing: InflatableActuation | None = ACTUATION  # None: gaits take as many seconds as those of the published robot
    pressure: float = FULL_PRESSURE  # of the core of the round robot [Pa]

    @property
    def actuation(self) -> InflatableActuation:
        """Rates and timing, worked out when they are asked for: a time step takes the whole body."""
        if self.timing is not None:
            return self.timing
        return retimed(PUBLISHED.time_step / self.geometry.time_step)


def retimed(steps: float) -> InflatableActuation:
    """All strokes and pauses stretched to ``steps`` times as many time steps; rates are per step."""
    return replace(
        ACTUATION,
        inflation_rate=ACTUATION.inflation_rate / steps,
        pressure_ramp=ACTUATION.pressure_ramp / steps,
        hold_steps=round(ACTUATION.hold_steps * steps),
        settle_steps=round(ACTUATION.settle_steps * steps),
    )


def in_the_same_time(**changed: Any) -> Variant:
    """A robot of a changed geometry, whose gait takes as many seconds as the published one, whatever its time step."""
    return Variant(replace(PUBLISHED, **changed), timing=None)


def with_modulus(factor: float) -> Variant:
    """Young's modulus of skin and bladders times a factor."""
    skin, bladders = PUBLISHED.youngs_modulus * factor, PUBLISHED.bladder_modulus * factor
    return in_the_same_time(youngs_modulus=skin, bladder_modulus=bladders)


def with_density(factor: float) -> Variant:
    """Density times a factor."""
    return in_the_same_time(density=PUBLISHED.density * factor)


def with_time_step(factor: float) -> Variant:
    """The time step times a factor, at most 1.3, the robot's margin to the largest stable one."""
    safety = PUBLISHED.time_step_safety
    if not 0 < factor <= safety:
        raise ValueError(f"time step: a factor of {factor:g} is not allowed; give a positive one, at most {safety:g}")
    return in_the_same_time(time_step_safety=safety / factor)


def with_duration(factor: float) -> Variant:
    """All that happens takes a factor times as long, in time steps of the same length."""
    return Variant(timing=retimed(factor))


def with_pressure(factor: float) -> Variant:
    """The pressure of the round robot times a factor; at that pressure bladders lengthen least."""
    pressure = FULL_PRESSURE * factor
    if not 0 < pressure <= MAXIMUM_PRESSURE:
        allowed = f"give a positive one, at most {MAXIMUM_PRESSURE / FULL_PRESSURE:g}"
        raise ValueError(f"maximum pressure: a factor of {factor:g} is not allowed; {allowed}")
    return Variant(timing=replace(ACTUATION, round_pressure=pressure), pressure=pressure)


def with_voxels(factor: float) -> Variant:
    """So many times the voxels across a bladder, which has 3, in a robot of the same size.

    Rows and layers follow, as whole numbers allow. The skins keep their mass per area and their bending stiffness:
    density is divided by the voxels' size h, Young's modulus by h cubed.
    """
    across = round(PUBLISHED.bladder_columns * factor)
    if across < 1:
        raise ValueError(f"voxels per bladder: a factor of {factor:g} is not allowed; it leaves none")
    size = PUBLISHED.columns * PUBLISHED.voxel_size / (4 * across + 3)
    ratio = size / PUBLISHED.voxel_size
    return in_the_same_time(
        bladder_columns=across,
        rows=round(PUBLISHED.rows / ratio),
        foot_rows=max(1, round(PUBLISHED.foot_rows / ratio)),
        bladder_layers=max(1, round(PUBLISHED.bladder_layers / ratio)),
        voxel_size=size,
        youngs_modulus=PUBLISHED.youngs_modulus / ratio**3,
        bladder_modulus=PUBLISHED.bladder_modulus / ratio**3,
        density=PUBLISHED.density / ratio,
    )


VARIATIONS: Mapping[str, Callable[[float], Variant]] = {
    "Young's modulus": with_modulus,
    "density": with_density,
    "time step": with_time_step,
    "duration": with_duration,
    "maximum pressure": with_pressure,
    "voxels per bladder": with_voxels,
}


UNCHANGED = "unchanged"
SURVIVES = 0.5  # of the distance that the unchanged robot travels in the same gait
FACTORS: Mapping[str, tuple[float, ...]] = {
    "Young's modulus": (0.5, 0.7, 1.4, 2.0),
    "density": (0.5, 0.7, 1.4, 2.0),
    "time step": (0.5, 0.7, 1.2),
    "duration": (0.5, 0.7, 1.4, 2.0),
    "maximum pressure": (0.5, 0.75, 1.25),
    "voxels per bladder": (2 / 3, 4 / 3, 5 / 3),
}
FEW_FACTORS: Mapping[str, tuple[float, ...]] = {
    **{name: (factors[0], factors[-1]) for name, factors in FACTORS.items()},
    **{"time step": (0.5,), "voxels per bladder": (2 / 3,)},
}


@dataclass(frozen=True)
class Sensitivity(Settings):
    """Parameters that are changed, and what is played with each of them."""

    fixed: ClassVar = ("robot.geometry", "robot.actuation")  # what it changes itself
    factors: Mapping[str, tuple[float, ...]] = field(
        default_factory=lambda: FACTORS
    )  # of ``VARIATIONS``, one at a time
    robot: GaitRuns = field(default_factory=lambda: GaitRuns(copies=5))  # of 3 behaviours: 15 of 16 lanes
    repeats: Count = 2  # how often the columns of the gaits are played
    # of the hill [degrees]
    slope: Annotated[float, partial(checks.number, low=-STEEPEST, high=STEEPEST, unit="degrees")] = 15.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.robot.geometry, self.robot.actuation) != (PUBLISHED, ACTUATION):
            raise ValueError("robot: another geometry or actuation is not allowed; what varies are the published ones")
        _ = self.variants  # refused now rather than in the middle

    @property
    def behaviours(self) -> dict[str, Case]:
        """Rolling and inching where they work, by name."""
        rolling, inching = (repeated(design, self.repeats) for design in (ROLLING, INCHING))
        return {
            "rolling on flat ground": Case(rolling, Terrain()),
            "inching on flat ground": Case(inching, Terrain()),
            "inching up the hill": Case(inching, Terrain(self.slope)),
        }

    @property
    def variants(self) -> dict[tuple[str, float], Variant]:
        """Robots by parameter and factor; the unchanged one first."""
        found = {(UNCHANGED, 1.0): Variant()}
        for name, factors in self.factors.items():
            if name not in VARIATIONS:
                known = ", ".join(VARIATIONS)
                raise ValueError(f"factors: {name!r} is unknown; choose of {known}{checks.nearest(name, VARIATIONS)}")
            for factor in factors:
                found[name, factor] = VARIATIONS[name](checks.number(name, factor, 1e-3, 1e3))
        return found


def study(folder: Path, settings: Sensitivity, progress: Progress = None, threads: int | None = None) -> dict[str, Any]:
    """Write a table, a figure and all numbers; more factors may follow in the same folder."""
    about = {"robot": settings.robot.describe(), "repeats": settings.repeats, "slope": settings.slope}
    variants = settings.variants
    parts = {_part(*change): partial(travelled, settings, variant, threads) for change, variant in variants.items()}
    allowed = dict.fromkeys(parts, settings.robot.allowed_speeds(len(settings.behaviours)))
    lengths = computed_arrays(ResultsFolder(folder, NAME, about), "lengths", parts, progress, allowed)
    return _report(folder, about, dict(zip(variants, lengths, strict=True)))


def rewrite(data: Data, folder: Path) -> None:
    """Write all that the study writes from the distances that its folder keeps; published factors only.

    Names of parts have no more than six digits of a factor, too few to tell others from them.
    """
    about = data.kept(NAME, lambda settings: {name: settings[name] for name in ("robot", "repeats", "slope")})
    usual, *changes = Sensitivity().variants
    found = {usual: data.array(_part(*usual), "lengths", "f2")}
    for change in changes:
        if (part := data.part(_part(*change), lengths="f2")) is not None:
            found[change] = part["lengths"]
    for change, lengths in found.items():
        if len(lengths) != len(Sensitivity().behaviours):
            raise ValueError(
                f"{data.folder}: part {_part(*change)} has {len(lengths)} behaviours, not those of the study"
            )
    _report(folder, about, found)


def _part(name: str, factor: float) -> str:
    """Name of the part of a change."""
    return re.sub(r"\W+", "_", f"{name} {factor:.6g}")


def _report(folder: Path, about: Mapping[str, Any], found: Mapping[tuple[str, float], Floats]) -> dict[str, Any]:
    """Write what follows from distances, of shape (behaviours, copies), by change."""
    rows = rows_of(found, tuple(Sensitivity().behaviours))
    summary = {**about, "survives_from": SURVIVES, "rows": rows}
    write_summary(folder, "sensitivity", summary, text_of(rows))
    draw(rows, folder / "sensitivity.png")
    return summary


def travelled(settings: Sensitivity, variant: Variant, threads: int | None, progress: Progress) -> Floats:
    """Distance that a robot travels in each behaviour's gait [its body lengths], shape (behaviours, copies)."""
    cases = list(settings.behaviours.values())
    cases[0] = replace(cases[0], design=replace(cases[0].design, pressure=variant.pressure))
    robot = replace(settings.robot, geometry=variant.geometry, actuation=variant.actuation)
    columns = cases[0].design.schedule.columns * settings.repeats
    seconds = nominal_steps(columns, variant.actuation) * variant.geometry.time_step
    return robot.speeds(cases, threads, progress) * seconds


def rows_of(found: Mapping[tuple[str, float], Floats], behaviours: Sequence[str]) -> list[dict[str, Any]]:
    """A row for each change and behaviour, of distances of shape (behaviours, copies); the unchanged robot first.

    A behaviour survives if all copies do, and their mean is at least ``SURVIVES`` of the unchanged robot's. Where that
    one does not get ahead, there is nothing to survive: share and survival are None.
    """
    rows: list[dict[str, Any]] = []
    for (name, factor), lengths in found.items():
        for number, (behaviour, copies) in enumerate(zip(behaviours, lengths, strict=True)):
            here = spread(copies)
            usual = rows[number]["mean"] if rows[number:] else here["mean"]
            ahead = usual if usual is not None and usual > 0 else None
            share = here["mean"] / ahead if ahead is not None and here["mean"] is not None else None
            whole = share is not None and share >= SURVIVES and not here["diverged"]
            row = {"parameter": name, "factor": factor, "behaviour": behaviour, **here}
            rows.append({**row, "share": share, "survives": None if ahead is None else whole})
    return rows


def text_of(rows: Sequence[Record]) -> str:
    """The page: the table, and how many behaviours survive."""
    behaviours = distinct(rows, "behaviour")
    changes: dict[tuple[str, float], list[str]] = {}
    for row in rows:
        text = shown(row) if row["share"] is None else f"{shown(row)}, {row['share']:.2f}"
        cell = f"**{text}**" if row["survives"] is False else text
        changes.setdefault((row["parameter"], row["factor"]), []).append(cell)
    cells = [(name, f"{factor:.3g}", *here) for (name, factor), here in changes.items()]
    survive = [row["survives"] for row in rows if row["parameter"] != UNCHANGED and row["survives"] is not None]
    return page(
        "Body lengths travelled in a gait: mean ± standard deviation of copies whose starts differ by noise, and the\n"
        f"share of the unchanged robot's distance. **Bold**: less than {SURVIVES:g} of it, or a copy diverged.",
        markdown(("parameter", "factor", *behaviours), "lr" + "r" * len(behaviours), cells),
        f"{sum(survive)} of {len(survive)} behaviours survive.",
    )


def draw(rows: Sequence[Record], path: Path) -> None:
    """Draw the share of the unchanged robot's distance against the factor, a panel for each behaviour.

    Means with their standard deviations, through 1 where nothing is changed.
    """
    behaviours, (_, *names) = distinct(rows, "behaviour"), distinct(rows, "parameter")
    with figure(path, PAGE, 3.0, ncols=len(behaviours), sharey=True) as (drawn, panels):
        for axes, behaviour in zip(panels.flat, behaviours, strict=True):
            axes.axhline(SURVIVES, color="0.6", linestyle=":", linewidth=0.8)
            axes.axhline(0.0, color="0.8", linewidth=0.6, zorder=0)
            unchanged = select(rows, behaviour=behaviour, parameter=UNCHANGED)
            usual = abs(unchanged[0]["mean"] or np.nan)
            lines = []
            for name, colour in zip(names, COLOURS, strict=False):
                here = [*select(rows, behaviour=behaviour, parameter=name), *unchanged]
                here.sort(key=lambda row: row["factor"])
                factor, share, deviation = (column(here, key) for key in ("factor", "share", "deviation"))
                line: Any = {"fmt": "o-", "ms": 2.5, "elinewidth": 0.6, "color": colour, "label": name}
                lines.append(axes.errorbar(factor, share, np.nan_to_num(deviation / usual), **line))
            axes.set_xlabel(f"factor, {behaviour}")
            logarithmic(axes, "x", (0.5, 0.7, 1.0, 1.4, 2.0))
        panels[0, 0].set_yscale("symlog", linthresh=1.0, linscale=1.0)  # what slides down goes many times as far
        panels[0, 0].set_yticks([-10, -1, 0, 1, 10], ["-10", "-1", "0", "1", "10"])
        panels[0, 0].set_ylabel("distance / unchanged robot's")
        drawn.legend(handles=lines, loc="outside upper center", ncols=3)


STUDY = Study(
    title="whether rolling and inching survive other moduli, densities, time steps, pressures and voxels",
    source="chapter 5, discussion of the simulator's parameters",
    scales={"small": Sensitivity(FEW_FACTORS, GaitRuns(precision="f32", copies=5), repeats=1), "full": Sensitivity()},
    run=study,
    rewrite=rewrite,
    writes=("sensitivity.md", "sensitivity.csv", "sensitivity.png", "summary.json"),
    cost="1 h of two cores",
)
