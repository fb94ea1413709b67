"""Gaits for a real floor: measured friction, bladders that weigh, and what is not known exactly.

On each slope the lab searches for a gait whose *worst* draw is fast. A draw scales the friction of the floor, how far
every bladder goes and how long strokes last, and tilts the ground. First, every wave around the ring of bladders, with
at most so many full ones at a time, is played once, in both directions (*screen*). The best, or the gait of the slope
below, begun at whichever of its columns is best here, begins a genetic search of levels, shift, feet and settling under
draws (*robust*), and one of the same cost without (*nominal*): so gaits are led up; to choose a start comes on top.
With the setting ``capped``, what searches find keeps to so many full bladders as well. All that is found, and the gaits
that were made by hand, are then played in double precision under the same draws, which no search has seen, without
pneumatic lag. What the searches of a slope found is played through a rig as well, whose lines lag. Speeds are of the
time simulated.
"""

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

from optim.experiments.results import Progress
from optim.experiments.study import Study
from optim.experiments.tables import write_records
from optim.studies.beyond.robust_gaits.judgement import judged, on_rig
from optim.studies.beyond.robust_gaits.report import DRAWS, GAITS, INCHING_BOUNDS, RIG, SCREEN, report, rewrite
from optim.studies.beyond.robust_gaits.search import flat_walk, kept, led_up, screened
from optim.studies.beyond.robust_gaits.settings import NAME, RobustGaits
from optim.studies.chapter5.gaits import repeated
from robots.inflatable.design import INCHING, ROLLING, InflatableDesign
from robots.robot import part_of
from taichi_sim.base.results_folder import ResultsFolder

HAND_MADE = {"inching": repeated(INCHING, 1), "rolling": repeated(ROLLING, 1)}
FILES = ("table.md", SCREEN, "speeds.csv", DRAWS, RIG, "robust.png", INCHING_BOUNDS, "summary.json", GAITS, "runs")


def study(folder: Path, settings: RobustGaits, progress: Progress = None, threads: int | None = None) -> None:
    """Write screened waves, gaits, speeds of all draws, the page and the figure."""
    parts = ResultsFolder(folder, NAME, settings.describe())
    screen = screened(settings, parts, threads, part_of(progress, 0, 10, 3))
    write_records(folder / SCREEN, screen)
    found = _searched(folder, settings, parts, screen, threads, part_of(progress, 3, 10, 3))
    if 0.0 in settings.slopes:
        share = part_of(progress, 64, 100, 6)
        found["flat body"] = {0.0: flat_walk(folder, settings, threads, share)}
    gaits = {f"{name} {slope:g}°": (design, slope) for name, each in found.items() for slope, design in each.items()}
    gaits |= {f"{name} {s:g}°": (design, s) for name, design in HAND_MADE.items() for s in settings.slopes}
    steepest = max(settings.slopes)
    gaits |= {
        f"robust {steepest:g}° on {steepest + more:g}°": (found["robust"][steepest], steepest + more)
        for more in settings.steeper
    }
    saved = kept(folder / GAITS, gaits)
    draws = judged(settings, parts, saved, threads, part_of(progress, 70, 100, 25))
    write_records(folder / DRAWS, draws)
    searched = {f"{kind} {s:g}°": saved[f"{kind} {s:g}°"] for kind in ("robust", "nominal") for s in found[kind]}
    rig = on_rig(settings, parts, searched, threads, part_of(progress, 95, 100, 5))
    write_records(folder / RIG, rig)
    designs = {name: design for name, (design, _) in saved.items()}
    report(folder, settings.describe(), screen, draws, designs, rig)
    if progress:
        progress(1.0)


def _searched(
    folder: Path,
    settings: RobustGaits,
    parts: ResultsFolder,
    screen: Sequence[Mapping[str, Any]],
    threads: int | None,
    progress: Progress,
) -> dict[str, dict[float, InflatableDesign]]:
    """The gaits of searches over draws and without, by slope, each led up from the slope below."""
    found: dict[str, dict[float, InflatableDesign]] = {name: {} for name in ("robust", "nominal")}
    tasks = list(product(sorted(settings.slopes), (True, False)))
    for number, (slope, robust) in enumerate(tasks):
        kind, share = "robust" if robust else "nominal", part_of(progress, number, len(tasks))
        own, path = found[kind], folder / "runs" / f"{kind}-{slope:g}"
        below = list(own.values())[-1:]
        own[slope] = led_up(settings, slope, robust, screen, below, parts, path, threads, share)
    return found


STUDY = Study(
    title="gaits for a real floor: fast on wood in the worst of draws of friction, slope, levels and timing",
    source="chapter 5, transferring to a physical robot",
    scales={
        "small": RobustGaits(
            (0.0,),
            geometry="small",
            draws=2,
            held_out=4,
            most_full=1,
            settling=(0.0,),
            steeper=(),
            budget=0.5e6,
            begins=1,
        ),
        "medium": RobustGaits(),
        "full": RobustGaits(
            (0.0, 5.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0),
            settling=(0.0, 1000.0),
            draws=8,
            most_full=5,
            budget=600e6,
            population=24,
        ),
    },
    run=study,
    rewrite=rewrite,
    writes=FILES,
    cost="40 h of CPU time",
)
