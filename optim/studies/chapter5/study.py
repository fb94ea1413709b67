"""Changing shape beside changing control only: searches, gaits made by hand, their table beside the published one."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.data import Data
from optim.experiments.figures import COLOURS, PAGE, figure
from optim.experiments.results import Costs, Progress, check_folder, write_json
from optim.experiments.study import Study
from optim.experiments.tables import MISSING, Record, cell, markdown, page, write_records, write_table
from optim.measures.statistics import effect, mean_band, welch
from optim.plots import draw_band
from optim.studies.chapter5.champions import KIND, PLACES, Played, Player, read_played
from optim.studies.chapter5.experiments import EXPERIMENTS, FLAT, HILL, PARTS, ROWS, ShapeChange, search
from optim.studies.chapter5.found import SPEEDS, Found, read, read_speeds, write_speeds
from optim.studies.chapter5.gaits import shown, spread
from robots.robot import part_of
from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import write_text

COLUMNS = ("flat_mean", "flat_max", "hill_mean", "hill_max", "combined_max")
SEARCHED = ("orientation, shape, control", "shape, control", "control")
HAND = ("flat_max", "hill_max", "combined_max")
# Of changing shape by hand the text says 0.0998, its own numbers 0.09995. Of the control experiment, rolling on the
# hill, the text gives no number; those here are of the run, in which only the start was as the text says.
TABLE: Mapping[str, Mapping[str, float]] = {
    SEARCHED[0]: dict(zip(COLUMNS, (0.0791, 0.1888, 0.0023, 0.0158, 0.1023), strict=True)),
    SEARCHED[1]: dict(zip(COLUMNS, (0.0945, 0.2000, -0.0032, -0.0004, 0.0998), strict=True)),
    SEARCHED[2]: dict(zip(COLUMNS, (0.0921, 0.1576, -0.0087, -0.0023, 0.0777), strict=True)),
    "rolling by hand": dict(zip(HAND, (0.1753, -0.5743, -0.1995), strict=True)),
    "inching by hand": dict(zip(HAND, (0.0603, 0.0246, 0.0424), strict=True)),
    "changing shape by hand": dict(zip(HAND, (0.1753, 0.0246, 0.0998), strict=True)),
    "rolling on the hill, as run": {"hill_mean": 0.0026, "hill_max": 0.0282},
}
OPEN = f"{'-'.join(PARTS)}-{HILL}"  # the experiment that rolling on the hill is held against
CHANGING = "changing shape by hand"
AGAIN = ("flat_max_again", "hill_max_again")


def summarise(settings: ShapeChange, found: Mapping[str, Found], played: Played) -> dict[str, Any]:
    """Everything the study says, ready for JSON."""
    return {
        "settings": asdict(settings),
        "rows": [*_searched(settings, found, played), *_by_hand(played)],
        "played": played.generation,
        "tests": tests(found),
        "curves": {name: curve(one.scores) for name, one in found.items()},
    }


def _searched(settings: ShapeChange, found: Mapping[str, Found], played: Played) -> Iterator[dict[str, Any]]:
    for name in ROWS:
        row: dict[str, Any] = {"row": name, "evaluations": 0, "generations": None, "climbers": settings.climbers}
        elsewhere = {}
        for experiment in (e for e in EXPERIMENTS if e.row == name and e.name in found):
            one, place = found[experiment.name], experiment.place
            row["evaluations"] += one.evaluations
            row["generations"] = len(one.scores) - 1
            row[f"{place}_mean"] = float(one.final.mean()) if one.final.size else None
            row[f"{place}_max"] = float(one.final.max()) if one.final.size else None
            if experiment.name in played.again:
                row[f"{place}_max_again"] = spread(played.again[experiment.name])
            if experiment.name in played.elsewhere:
                elsewhere[place] = played.elsewhere[experiment.name]
        row["combined_max"] = _mean(row.get("flat_max"), row.get("hill_max"))
        yield {**row, "one_design": best_on_both(elsewhere), "published": dict(TABLE.get(name, {}))}


def _by_hand(played: Played) -> Iterator[dict[str, Any]]:
    gaits = {name: {place: spread(copies[place]) for place in PLACES} for name, copies in played.by_hand.items()}
    if gaits:
        rolling, inching = gaits.values()
        gaits[CHANGING] = {FLAT: rolling[FLAT], HILL: inching[HILL]}
    for name, places in gaits.items():
        speeds = {place: places[place]["mean"] for place in PLACES}
        combined = _mean(*speeds.values())
        one = None if name == CHANGING or combined is None else {"combined": combined, **speeds, "found_on": None}
        yield {
            "row": name,
            "evaluations": sum(int(places[place]["copies"] or 0) for place in PLACES),
            "generations": None,
            **{f"{place}_max": speeds[place] for place in PLACES},
            **{f"{place}_max_again": places[place] for place in PLACES},
            "combined_max": combined,
            "one_design": one,
            "published": dict(TABLE[name]),
        }


def best_on_both(elsewhere: Mapping[str, Floats]) -> dict[str, Any] | None:
    """The design that is fastest in the mean of both terrains, and where it was found; None if all failed.

    ``elsewhere`` is, by the terrain on which designs were found, their speeds there and on the other one, shape (2, n).
    """
    best: dict[str, Any] | None = None
    for place, (own, other) in elsewhere.items():
        means = np.nan_to_num((own + other) / 2, nan=-np.inf)
        index = int(np.argmax(means))
        if np.isfinite(means[index]) and (best is None or means[index] > best["combined"]):
            flat, hill = (float(speeds[index]) for speeds in ((own, other) if place == FLAT else (other, own)))
            best = {"combined": float(means[index]), FLAT: flat, HILL: hill, "found_on": place}
    return best


def tests(found: Mapping[str, Found]) -> list[dict[str, Any]]:
    """Rolling on the hill, in both readings, against the experiment in which all was free and random: Welch's t-test.

    The authors tested this pair so. Positive t and differences say that the open experiment found faster designs. Where
    both search the same variables, climber n of one draws the same random numbers for them as climber n of the other,
    which the test does not know: ``paired`` is the mean difference of such pairs, with its 95 % bootstrap interval;
    None elsewhere, and of other numbers of climbers.
    """
    results: list[dict[str, Any]] = []
    for experiment in (e for e in EXPERIMENTS[-2:] if e.name in found and OPEN in found):
        control, against = found[experiment.name], found[OPEN]
        climbers = [len(control.final), len(against.final)]
        if min(climbers) > 1:
            test, size = welch(control.final, against.final), effect(control.final, against.final)
            paired = _paired(control.scores[-1], against.scores[-1]) if experiment.free == PARTS else None
            about = {"control": experiment.name, "open": OPEN, "climbers": climbers}
            results.append({**about, "welch": asdict(test), "effect": asdict(size), "paired": paired})
    return results


def _paired(control: Floats, open_scores: Floats) -> dict[str, float] | None:
    """Mean difference between climbers and their counterparts, where neither has failed."""
    apart = open_scores - control if len(control) == len(open_scores) else np.array([])
    apart = apart[~np.isnan(apart)]
    if not apart.size:
        return None
    low, high = map(float, mean_band(apart))
    return {"climbers": len(apart), "difference": float(apart.mean()), "low": low, "high": high}


def curve(scores: Floats) -> dict[str, list[float | None]]:
    """Mean, its 95 % bootstrap band, and maximum of climbers over generations; scores of shape (G + 1, C).

    In each generation the climbers count that have found anything by then; None where none has.
    """
    points: list[tuple[Any, ...]] = []
    for row in scores:
        known = row[~np.isnan(row)]
        points.append(tuple(map(float, (known.mean(), *mean_band(known), known.max()))) if known.size else (None,) * 4)
    return dict(zip(("mean", "low", "high", "max"), map(list, zip(*points, strict=True)), strict=True))


def _mean(a: float | None, b: float | None) -> float | None:
    return None if a is None or b is None else (a + b) / 2


def write_tables(summary: Mapping[str, Any], folder: Path) -> None:
    """Write ``table.csv`` and ``table.md`` of a summary, see :func:`summarise`."""
    write_records(folder / "table.csv", [_record(row) for row in summary["rows"]])
    write_text(folder / "table.md", text_of(summary))


def _record(row: Record) -> dict[str, Any]:
    """The line of a row in the CSV file, where all that it may have is a cell."""
    record = {name: row.get(name) for name in ("row", "climbers", "generations", "evaluations")}
    for name in COLUMNS:
        record |= {name: row.get(name), f"{name}_published": row["published"].get(name)}
    one = row["one_design"] or {}
    record |= {f"one_design_{name}": one.get(name) for name in ("combined", "flat", "hill", "found_on")}
    for name in AGAIN:
        again = row.get(name) or {}
        record |= {f"{name}_{part}": again.get(part) for part in ("mean", "deviation", "copies", "diverged")}
    return record


def text_of(summary: Mapping[str, Any]) -> str:
    """Speeds with the published ones in brackets, the best designs again, and the tests."""
    settings, rows, tests = summary["settings"], summary["rows"], summary["tests"]
    times = {1: "once", 2: "twice"}.get(settings["repeats"], f"{settings['repeats']} times")
    header = (
        *("free to change", "climbers x generations", "evaluations", "flat mean", "flat max", "hill mean", "hill max"),
        *("combined max, two designs", "best single design (flat, hill)"),
    )
    again = [
        (row["row"], *(shown(row[n]) if row.get(n) else MISSING for n in AGAIN))
        for row in rows
        if any(row.get(name) for name in AGAIN)
    ]
    played, older = summary["played"], ""
    if played is not None and any(row["generations"] not in (None, played) for row in rows):
        older = f" They, and the best single designs, are those after generation {played}; the searches have gone on."
    return page(
        f"Speeds [body lengths/s] on flat ground and up {settings['slope']:g} degrees; published values in brackets. "
        f"Robot: {settings['geometry']}, 8 columns played {times}; published: 60 climbers, 200 "
        "generations, 24,120 evaluations a row, 12,060 of those on the hill alone.",
        markdown(header, "llrrrrrrr", map(_cells, rows)),
        "Rows of searches: mean and maximum over the climbers' best designs, as the search saw them, one run in f32 "
        "each. Combined: the mean of a row's maxima on both terrains, which are two designs, as published; beside it, "
        f"the best mean of one design, of the {settings['others']} best of each terrain simulated on the other. "
        f"Gaits by hand: mean of {settings['copies']} runs in f64 whose starts differ by noise.",
        f"Fastest designs again: mean ± standard deviation of runs in f64 whose starts differ by noise.{older}"
        if again
        else "",
        markdown(("free to change", "flat", "hill"), "lrr", again) if again else "",
        "Whether shape has to change: rolling on the hill against the search with all free." if tests else "",
        [_sentence(test) for test in tests],
    )


def _cells(row: Record) -> list[str]:
    """The cells of a row on the page."""
    budget = f"{row['climbers']} x {row['generations']}" if "climbers" in row else "by hand"
    one = row["one_design"]
    best = MISSING if one is None else f"{one['combined']:.4f} ({one['flat']:.4f}, {one['hill']:.4f})"
    known, published = ({name: values.get(name) for name in COLUMNS} for values in (row, row["published"]))
    beside = {name: "" if value is None else f" ({value:.4f})" for name, value in published.items()}
    return [
        row["row"],
        budget,
        f"{row['evaluations']:,}",
        *(cell(known[name]) + beside[name] for name in COLUMNS),
        best,
    ]


def _sentence(test: Mapping[str, Any]) -> str:
    welch, size, paired = test["welch"], test["effect"], test["paired"]
    climbers = " and ".join(map(str, reversed(test["climbers"])))
    value = "nothing varies" if welch["t"] is None else f"t = {welch['t']:.2f}, p = {welch['p']:.3g}"
    text = (
        f"- {test['open']} against {test['control']} ({climbers} climbers): mean difference "
        f"{size['difference']:+.4f} [{size['low']:+.4f}, {size['high']:+.4f}] BL/s; Welch's t-test: {value}"
    )
    if paired:
        interval = f"[{paired['low']:+.4f}, {paired['high']:+.4f}]"
        text += f"; {paired['climbers']} pairs that drew the same numbers: {paired['difference']:+.4f} {interval}"
    return text


RUNS = "runs"
FILES = ("table.md", "table.csv", "curves.png", "curves.csv", "summary.json", SPEEDS, RUNS)


def study(folder: Path, settings: ShapeChange, progress: Progress = None, threads: int | None = None) -> dict[str, Any]:
    """Write a run folder for each experiment in ``runs``, the table, curves and all numbers, after every generation."""
    check_folder(folder, (*FILES, KIND, "costs.jsonl"))
    costs = Costs(folder / "costs.jsonl")
    player = Player(settings, folder, costs, threads)

    def write() -> dict[str, Any]:
        found = read(settings, folder / RUNS)
        write_speeds(found, folder / SPEEDS)
        return _report(settings, found, folder / KIND, folder, costs)

    player.play_by_hand(part_of(progress, 0, 20))
    search(settings, folder / RUNS, costs, write, threads, part_of(progress, 1, 20, 16))
    player.play_found(read(settings, folder / RUNS), part_of(progress, 17, 20, 3))
    return write()


def rewrite(data: Data, folder: Path) -> None:
    """Write all that the study writes but run folders, from the speeds that it keeps."""
    settings = Data(data.folder / KIND).kept(KIND, lambda record: ShapeChange(**record))
    found = read_speeds(data, settings.climbers)
    made = min((len(one.scores) - 1 for one in found.values()), default=0)
    _report(replace(settings, generations=made), found, data.folder / KIND, folder)


def _report(
    settings: ShapeChange, found: Mapping[str, Found], played: Path, folder: Path, costs: Costs | None = None
) -> dict[str, Any]:
    """Write what follows from what was found, and from what was played in a folder of such results."""
    summary = summarise(settings, found, read_played(played, settings.copies, found))
    if costs is not None:
        summary["seconds"] = costs.total()
    write_tables(summary, folder)
    write_json(folder / "summary.json", summary)
    write_curves(summary, folder / "curves.png")
    return summary


# By terrain: its name, and the fastest gaits made by hand, drawn as levels; rolling would leave the hill's panel.
PANELS = {FLAT: ("flat ground", ("rolling by hand", "inching by hand")), HILL: ("hill", ("inching by hand",))}


def write_curves(summary: Mapping[str, Any], path: Path) -> None:
    """Draw the curves of a summary, and write their numbers as CSV beside the picture."""
    from matplotlib.lines import Line2D
    from matplotlib.ticker import MaxNLocator

    curves = summary["curves"]
    rows = [
        (name, g, *values) for name, one in curves.items() for g, values in enumerate(zip(*one.values(), strict=True))
    ]
    write_table(path.with_suffix(".csv"), ("experiment", "generation", "mean", "low", "high", "max"), rows)
    levels = {
        (row["row"], place): row[f"{place}_max"] for row in summary["rows"] if "climbers" not in row for place in PANELS
    }
    known = [experiment for experiment in EXPERIMENTS if experiment.name in curves]
    with figure(path, PAGE, 3.4, ncols=2) as (drawn, panels):
        for axes, (place, (title, by_hand)) in zip(panels.flat, PANELS.items(), strict=True):
            for experiment in known:
                if experiment.place == place:
                    _draw(axes, curves[experiment.name], COLOURS[ROWS.index(experiment.row)])
            for name in by_hand:
                if (level := levels.get((name, place))) is not None:
                    axes.axhline(level, color="0.5", linewidth=0.8, linestyle=":")
                    place_of: Any = {"xycoords": ("axes fraction", "data"), "va": "center"}
                    axes.annotate(name.replace(" by", "\nby"), (1.01, level), fontsize=6, color="0.35", **place_of)
            where = title if place == FLAT else f"{title}, {summary['settings']['slope']:g} degrees"
            axes.set(xlabel="generation", ylabel=f"speed, {where} [BL/s]")
            axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
        searched = [name for name in ROWS if name in {experiment.row for experiment in known}]
        handles = [Line2D([], [], color=COLOURS[ROWS.index(row)], label=row) for row in searched]
        handles += [Line2D([], [], color="0.3", label="mean of climbers, 95 % band")]
        handles += [Line2D([], [], color="0.3", linestyle="--", linewidth=0.8, label="maximum")]
        drawn.legend(handles=handles, loc="outside upper center", ncols=3)


def _draw(axes: Any, curve: Mapping[str, Any], colour: str) -> None:
    mean, low, high, best = (np.array(curve[name], float) for name in ("mean", "low", "high", "max"))
    generations = np.arange(len(mean))
    draw_band(axes, generations, mean, low, high, colour=colour)
    axes.plot(generations, best, color=colour, linestyle="--", linewidth=0.8)
    axes.plot(generations[-1:], mean[-1:], "o", markersize=2.5, color=colour)


STUDY = Study(
    title="searches for gaits on flat ground and up a hill, with shape, orientation and control free or fixed",
    source="chapter 5, table of simulation results and figure of searches",
    scales={
        "small": ShapeChange(climbers=16, generations=1, geometry="small", repeats=1, copies=4, others=8),
        "medium": ShapeChange(generations=1),  # of random starts
        "full": ShapeChange(),  # as published; goes on in a folder of "medium"
    },
    run=study,
    rewrite=rewrite,
    writes=FILES,
    cost="10 h of two cores for each of 8 rows",
)
