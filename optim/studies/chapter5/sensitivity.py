"""Whether rolling and inching survive when a parameter of the simulated robot is another one.

Source: Powers 2021 dissertation, ch. 5, "Discussion": modulus, timescale, maximum pressure, number of voxels per
bladder and density "could be adjusted without causing drastic changes in behavior".
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.figures import COLOURS, PAGE, figure, letter, logarithmic
from optim.experiments.results import Budget, Progress, cached_in_turn, write_summary
from optim.experiments.study import Study
from optim.experiments.tables import markdown
from optim.studies.chapter5.gaits import Case, Robot, repeated, shown, spread
from optim.studies.chapter5.variations import VARIATIONS, Variant
from robots.inflatable.actuation import ACTUATION
from robots.inflatable.body import PUBLISHED
from robots.inflatable.design import INCHING, ROLLING
from robots.inflatable.timing import nominal_steps
from robots.world import Terrain
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import nearest
from taichi_sim.base.results_folder import ResultsFolder

KIND = "hand-gait-sensitivity"
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
class Sensitivity:
    """Settings.

    Attributes:
        factors: by which parameters are multiplied, one at a time; names of ``VARIATIONS``.
        robot: how it is simulated; its geometry and actuation are the published ones.
        repeats: how often the columns of the gaits are played.
        slope: of the hill [degrees].
    """

    factors: Mapping[str, tuple[float, ...]] = field(default_factory=lambda: FACTORS)
    robot: Robot = field(default_factory=lambda: Robot(copies=5))  # of 3 behaviours: 15 of 16 lanes
    repeats: int = 2
    slope: float = 15.0

    def __post_init__(self) -> None:
        checks.integer("repeats", self.repeats, 1)
        object.__setattr__(self, "slope", Terrain(self.slope).slope)
        if (self.robot.geometry, self.robot.actuation) != (PUBLISHED, ACTUATION):
            raise ValueError("robot: another geometry or actuation is not allowed; what varies are the published ones")
        for name, factors in self.factors.items():
            if name not in VARIATIONS:
                known = ", ".join(VARIATIONS)
                raise ValueError(f"factors: {name!r} is unknown; choose of {known}{nearest(name, VARIATIONS)}")
            for factor in factors:
                VARIATIONS[name](checks.number(name, factor, 1e-3, 1e3))  # refused now rather than in the middle

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
    def variants(self) -> Iterator[tuple[str, float, Variant]]:
        """Parameter, factor and robot; the unchanged one first."""
        yield UNCHANGED, 1.0, Variant()
        for name, factors in self.factors.items():
            for factor in factors:
                yield name, factor, VARIATIONS[name](factor)


SCALES: Mapping[Budget, Sensitivity] = {
    "small": Sensitivity(FEW_FACTORS, Robot(precision="f32", copies=5), repeats=1),
    "full": Sensitivity(),
}


def study(folder: Path, settings: Sensitivity, progress: Progress = None, threads: int | None = None) -> dict[str, Any]:
    """Write a table, a figure and all numbers; more factors may follow in the same folder.

    For the arguments see :class:`optim.experiments.study.Study`.
    """
    about = {"robot": settings.robot.describe(), "repeats": settings.repeats, "slope": settings.slope}
    parts = ResultsFolder(folder, KIND, about)  # more factors may follow
    variants = list(settings.variants)
    names = [re.sub(r"\W+", "_", f"{name} {factor:.6g}") for name, factor, _ in variants]
    work = zip(names, (partial(travelled, settings, variant, threads) for *_, variant in variants), strict=True)
    lengths = cached_in_turn(parts, "lengths", work, progress)
    found = {(name, factor): each for (name, factor, _), each in zip(variants, lengths, strict=True)}
    rows = rows_of(found, tuple(settings.behaviours))
    summary = {**about, "survives_from": SURVIVES, "rows": rows}
    write_summary(folder, "sensitivity", summary, page(rows))
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
        for behaviour, copies in zip(behaviours, lengths, strict=True):
            here = spread(copies)
            usual = next((row["mean"] for row in rows if row["behaviour"] == behaviour), here["mean"])
            ahead = usual if usual is not None and usual > 0 else None
            share = here["mean"] / ahead if ahead is not None and here["mean"] is not None else None
            whole = share is not None and share >= SURVIVES and not here["diverged"]
            row = {"parameter": name, "factor": factor, "behaviour": behaviour, **here}
            rows.append({**row, "share": share, "survives": None if ahead is None else whole})
    return rows


def page(rows: Sequence[Mapping[str, Any]]) -> str:
    """The table as Markdown."""
    behaviours = list(dict.fromkeys(row["behaviour"] for row in rows))
    changes: dict[tuple[str, float], list[str]] = {}
    for row in rows:
        changes.setdefault((row["parameter"], row["factor"]), []).append(_cell(row))
    cells = [(name, f"{factor:.3g}", *here) for (name, factor), here in changes.items()]
    survive = [row["survives"] for row in rows if row["parameter"] != UNCHANGED and row["survives"] is not None]
    lines = [
        "Body lengths travelled in a gait: mean ± standard deviation of copies whose starts differ by noise, and the",
        f"share of the unchanged robot's distance. **Bold**: less than {SURVIVES:g} of it, or a copy diverged.",
        "",
        *markdown(("parameter", "factor", *behaviours), "lr" + "r" * len(behaviours), cells),
        "",
        f"{sum(survive)} of {len(survive)} behaviours survive.",
    ]
    return "\n".join(lines) + "\n"


def _cell(row: Mapping[str, Any]) -> str:
    text = shown(row) if row["share"] is None else f"{shown(row)}, {row['share']:.2f}"
    return f"**{text}**" if row["survives"] is False else text


def draw(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """The share of the unchanged robot's distance against the factor, a panel for each behaviour."""
    behaviours = list(dict.fromkeys(row["behaviour"] for row in rows))
    names = [name for name in dict.fromkeys(row["parameter"] for row in rows) if name != UNCHANGED]
    with figure(path, PAGE, 3.0, ncols=len(behaviours), sharey=True) as (drawn, panels):
        for axes, behaviour in zip(panels.flat, behaviours, strict=True):
            axes.axhline(SURVIVES, color="0.6", linestyle=":", linewidth=0.8)
            axes.axhline(0.0, color="0.8", linewidth=0.6, zorder=0)
            lines = [_line(axes, rows, name, behaviour, COLOURS[n]) for n, name in enumerate(names)]
            axes.set_xlabel(f"factor, {behaviour}")
            logarithmic(axes, "x", (0.5, 0.7, 1.0, 1.4, 2.0))
        panels[0, 0].set_ylabel("distance / unchanged robot's")
        letter(panels)
        drawn.legend(handles=lines, loc="outside upper center", ncols=3)


def _line(axes: Any, rows: Sequence[Mapping[str, Any]], name: str, behaviour: str, colour: str) -> Any:
    """Means with their standard deviations; through 1 where nothing is changed."""
    here = [row for row in rows if row["parameter"] in (name, UNCHANGED) and row["behaviour"] == behaviour]
    here.sort(key=lambda row: row["factor"])
    usual = next((row["mean"] for row in here if row["parameter"] == UNCHANGED), None) or np.nan
    factor, share, deviation = (np.array([row[k] for row in here], float) for k in ("factor", "share", "deviation"))
    error = np.nan_to_num(deviation / abs(usual))
    return axes.errorbar(factor, share, error, fmt="o-", ms=2.5, elinewidth=0.6, color=colour, label=name)


STUDY = Study(
    title="whether rolling and inching survive other moduli, densities, time steps, pressures and voxels",
    source="chapter 5, discussion of the simulator's parameters",
    scales=SCALES,
    run=study,
    writes=("sensitivity.md", "sensitivity.csv", "sensitivity.png", "summary.json"),
    cost="1 h of two cores",
)
