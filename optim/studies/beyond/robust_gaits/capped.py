"""How fast gaits for a real floor are with few bladders full at a time, as a rig with a small pump or one valve can.

For each number of bladders, from one up, the lab searches as the study of gaits for a real floor does: waves are
screened on each slope, and the best, the gait of the slope below, or that with fewer full bladders begins a genetic
search under draws. The levels of a column with more full bladders are scaled down, so no gait of a search has more.
What is found is judged in double precision under draws that no search has seen.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from optim.experiments.data import Data, Kind
from optim.experiments.results import Progress, write_json
from optim.experiments.study import Count, Settings, Study, Whole
from optim.experiments.tables import Record, distinct, markdown, page, select, write_records
from optim.studies.beyond.robust_gaits.judgement import judged
from optim.studies.beyond.robust_gaits.report import DRAWN as DRAWN_OF_GAITS
from optim.studies.beyond.robust_gaits.report import DRAWS, GAITS, SPEEDS_TOLD, speed_cells, summary_row
from optim.studies.beyond.robust_gaits.search import kept, led_up, screened
from optim.studies.beyond.robust_gaits.settings import NAME as SEARCHES
from optim.studies.beyond.robust_gaits.settings import Geometry, RobustGaits, checked_slopes
from robots.inflatable.design import InflatableDesign
from robots.inflatable.schedule import BLADDERS
from robots.robot import part_of
from taichi_sim.base import checks
from taichi_sim.base.compute import Precision
from taichi_sim.base.files import write_text
from taichi_sim.base.results_folder import ResultsFolder

NAME = "capped-gaits"
DRAWN: dict[str, Kind] = {"full": int, **DRAWN_OF_GAITS}
FILES = ("table.md", DRAWS, "summary.json", GAITS, "searches")


def _caps(field_name: str, value: Any) -> tuple[int, ...]:
    if not isinstance(value, list | tuple) or not value:
        raise ValueError(f"{field_name}: {value!r} is not allowed; give numbers of bladders, the least first")
    caps = tuple(checks.integer(field_name, each, low=1, high=BLADDERS) for each in value)
    if list(caps) != sorted(set(caps)):
        raise ValueError(f"{field_name}: {value!r} is not allowed; give different numbers of bladders, the least first")
    return caps


@dataclass(frozen=True)
class CappedGaits(Settings):
    """How many bladders may be full at a time, on which slopes, and how large searches are."""

    full: Annotated[tuple[int, ...], _caps] = (1, 2, 3, 4)
    slopes: Annotated[tuple[float, ...], checked_slopes] = (0.0, 9.0)  # [degrees]
    floor: str = "wood"
    geometry: Geometry = "published"
    draws: Count = 4  # that a search sees
    held_out: Count = 64
    budget: Annotated[float, checks.positive] = 6e6  # of each search [robot-steps]
    begins: Count = 1  # columns a start is tried from
    population: Count = 12
    steps: Count = 60_000  # of gaits in searches
    warm_up: Whole = 15_000  # of these, before what counts
    precision: Precision = "f64"  # of the judgement

    def __post_init__(self) -> None:
        super().__post_init__()
        self.searches(self.full[0])  # what it refuses is refused here

    def searches(self, full: int) -> RobustGaits:
        """The settings of the searches with at most so many full bladders."""
        own = {name: value for name, value in vars(self).items() if name != "full"}
        return RobustGaits(**own, most_full=full, capped=True)


def study(folder: Path, settings: CappedGaits, progress: Progress = None, threads: int | None = None) -> None:
    """Write gaits, their speeds in all draws, the page and the summary."""
    ResultsFolder(folder, NAME, settings.describe())
    draws: list[dict[str, Any]] = []
    before: dict[float, InflatableDesign] = {}
    for number, full in enumerate(settings.full):
        share = part_of(progress, number, len(settings.full))
        own, place = settings.searches(full), folder / "searches" / f"full-{full}"
        parts = ResultsFolder(place, SEARCHES, own.describe())
        before = _searched(own, parts, place, before, threads, part_of(share, 0, 10, 5))
        gaits = {f"{full} full {slope:g}°": (design, slope) for slope, design in before.items()}
        gaits = kept(folder / GAITS, gaits)
        draws += [{"full": full, **row} for row in judged(own, parts, gaits, threads, part_of(share, 5, 10, 5))]
        write_records(folder / DRAWS, draws)
    _report(folder, settings.describe(), draws)
    if progress:
        progress(1.0)


def _searched(
    settings: RobustGaits,
    parts: ResultsFolder,
    folder: Path,
    fewer: Mapping[float, InflatableDesign],
    threads: int | None,
    progress: Progress,
) -> dict[float, InflatableDesign]:
    """The gait of each slope, led up from the slope below and from the gait there with ``fewer`` full bladders."""
    screen = screened(settings, parts, threads, part_of(progress, 0, 10, 2))
    found: dict[float, InflatableDesign] = {}
    for number, slope in enumerate(sorted(settings.slopes)):
        share = part_of(part_of(progress, 2, 10, 8), number, len(settings.slopes))
        known = [*list(found.values())[-1:], *([fewer[slope]] if slope in fewer else [])]
        path = folder / "runs" / f"{slope:g}"
        found[slope] = led_up(settings, slope, True, screen, known, parts, path, threads, share)
    return found


def _report(folder: Path, settings: Mapping[str, Any], draws: Sequence[Record]) -> None:
    """Write page and summary from the speeds of draws; settings as far as they are known."""
    rows = []
    for slope in sorted(distinct(draws, "slope")):
        for full in sorted(distinct(draws, "full")):
            if mine := select(draws, slope=slope, full=full):
                rows.append({**summary_row(mine), "full": full})
    write_json(folder / "summary.json", {**settings, "rows": rows})
    table = [(f"{row['slope']:g}°", row["full"], *speed_cells(row), row["n"]) for row in rows]
    floor = f" on {settings['floor']}" if "floor" in settings else ""
    text = page(
        f"Speeds{floor}, bladders weighing, of gaits with at most so many full bladders at a time (the sum of levels), "
        f"searched for the worst of draws and judged in {rows[0]['precision']} under others [body lengths/s of the "
        "time simulated, no pneumatic lag]. Nominal: nothing is uncertain. Climb: the share of draws that go forward.",
        markdown(("slope", "full", *SPEEDS_TOLD, "n"), "rrrrrrrr", table),
    )
    write_text(folder / "table.md", text)


def rewrite(data: Data, folder: Path) -> None:
    """Write page and summary from the table of draws."""
    draws = data.records(DRAWS, DRAWN)
    if min(sum(row["draw"] >= 0 for row in select(draws, full=row["full"], slope=row["slope"])) for row in draws) < 2:
        raise ValueError(f"{data.folder / DRAWS}: a gait has less than two held-out draws (draw: at least 0)")
    _report(folder, data.kept(NAME, dict) if data.has(f"{NAME}.json") else {}, draws)


MEDIUM = CappedGaits()
STUDY = Study(
    title="gaits for a real floor with few bladders full at a time: one to four, flat and uphill",
    source="chapter 5, transferring to a physical robot",
    scales={
        "small": replace(
            MEDIUM,
            full=(1, 2),
            slopes=(0.0,),
            geometry="small",
            draws=2,
            held_out=4,
            budget=0.3e6,
            population=4,
            steps=4000,
            warm_up=0,
        ),
        "medium": MEDIUM,
        "full": replace(MEDIUM, slopes=(0.0, 5.0, 9.0, 12.0, 14.0), draws=8, begins=BLADDERS, budget=100e6),
    },
    run=study,
    rewrite=rewrite,
    writes=FILES,
    cost="30 h of CPU time; medium takes one",
)
