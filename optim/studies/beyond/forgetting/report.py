"""What the study writes: what was kept and gained, what bodies and methods explain of it, verdicts, a picture."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from optim.experiments.figures import COLOURS, PAGE, caption, figure, legend_above
from optim.experiments.results import write_json
from optim.experiments.tables import Record, cell, column, distinct, markdown, page, select
from optim.measures.factorial import TwoWay, two_way
from optim.measures.statistics import Difference, difference_of_means, holm, mean_interval
from optim.studies.beyond.forgetting.families import FAMILIES
from optim.studies.beyond.forgetting.methods import ENOUGH, METHODS, SEQUENTIAL
from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import write_text

TABLE = "runs.csv"
LEVELS = MappingProxyType({"high": "high M_CI", "low": "low M_CI"})
OUTCOMES = MappingProxyType(
    {
        "final_a": "A at the end",
        "forgotten": "forgotten of A",
        "gained_b": "gained in B",
        "worse": "the worse of both",
        "saved": "steps saved on the return to A",
    }
)
SOURCES = MappingProxyType({"rows": "body", "columns": "method", "interaction": "both together"})
SIGNIFICANT = 0.05
_SIDES = MappingProxyType({"high": -0.12, "low": 0.12})  # of a method in the picture


def outcome(rows: Sequence[Record], name: str) -> Floats:
    """An outcome of ``OUTCOMES``, a value for each row."""
    if name == "forgotten":
        return column(rows, "learned_a") - column(rows, "final_a")
    if name == "gained_b":
        return column(rows, "final_b") - column(rows, "learned_b")
    if name == "saved":
        return column(rows, "first") - column(rows, "again")
    return column(rows, name)


def analyse(rows: Sequence[Record], name: str) -> TwoWay | None:
    """What bodies and methods that learn one after the other explain of an outcome of one robot; None if it is one."""
    values = [[outcome(select(rows, level=level, method=way), name) for way in SEQUENTIAL] for level in LEVELS]
    return two_way(values, blocks=True) if np.ptp(values) else None


def verdict(found: TwoWay, of_interaction: float | None) -> str:
    """What an analysis says, by its interval, and by the adjusted p of the interaction."""
    _, low, high = found.advantage
    more = "the body explains more" if low > 0 else "the method explains more" if high < 0 else "neither explains more"
    depends = of_interaction is not None and of_interaction < SIGNIFICANT
    return f"{more}; " + ("methods differ by body" if depends else "no interaction shown")


def contrasts(rows: Sequence[Record], name: str) -> dict[str, tuple[str, Difference]]:
    """Differences that tell bodies from methods, in one robot, each with the method that it is about.

    ``body``: plain in bodies of high M_CI, less the method that is best on average in those of low; ``adds``: the best
    method in bodies of high M_CI less plain there; ``helps``: the same in bodies of low M_CI.
    """
    cells = {
        (level, way): outcome(select(rows, level=level, method=way), name) for level in LEVELS for way in SEQUENTIAL
    }
    others = [way for way in SEQUENTIAL if way != "plain"]
    best = {level: max(others, key=lambda way: cells[level, way].mean()) for level in LEVELS}
    plain = {level: cells[level, "plain"] for level in LEVELS}
    return {
        "body": (best["low"], difference_of_means(cells["low", best["low"]], plain["high"])),
        "adds": (best["high"], difference_of_means(plain["high"], cells["high", best["high"]], paired=True)),
        "helps": (best["low"], difference_of_means(plain["low"], cells["low", best["low"]], paired=True)),
    }


def write_report(folder: Path, rows: Sequence[Record], measured: Sequence[Record], settings: Mapping[str, Any]) -> None:
    """Write ``table.md``, ``summary.json`` and ``forgetting.png``."""
    robots = distinct(rows, "robot")
    of_robot = {robot: select(rows, robot=robot) for robot in robots}
    found = {(robot, name): analyse(of_robot[robot], name) for robot in robots for name in OUTCOMES}
    keys = [
        (*key, source) for key, each in found.items() for source in SOURCES if each and _p(each, source) is not None
    ]
    adjusted = dict(zip(keys, holm([_p(found[key[:2]], key[2]) or 0.0 for key in keys]), strict=True))
    compared = {robot: contrasts(of_robot[robot], "worse") for robot in robots}
    parts = (
        _bodies(of_robot, measured),
        _means(of_robot),
        _returns(of_robot),
        _analyses(found, adjusted),
        _compared(compared),
    )
    titles = (
        "Bodies, by M_CI and M_L of drawn controllers in A and B:",
        "Shares of the way to the light that are covered, means over bodies with 95 % intervals over bodies; *both at "
        "once* does not learn one after the other, and is no part of the analysis below:",
        f"The return to A, the plain way: steps until {ENOUGH:.0%} of what was gained there at first are there again, "
        "in shares of all steps in A (1 if that never happens), and what that saves, with 95 % intervals over bodies:",
        "What bodies and methods explain, omega squared with 95 % bootstrap intervals; p adjusted by Holm's method for "
        f"{len(keys)} tests:",
        "Differences in the worse of both environments at the end, with 95 % intervals; best is by the mean:",
    )
    write_text(folder / "table.md", page(*(part for pair in zip(titles, parts, strict=True) for part in pair)))
    summary = {
        "settings": dict(settings),
        "analyses": {
            f"{robot} {name}": None
            if each is None
            else {
                **asdict(each),
                "adjusted": {source: adjusted.get((robot, name, source)) for source in SOURCES},
                "verdict": verdict(each, adjusted.get((robot, name, "interaction"))),
            }
            for (robot, name), each in found.items()
        },
        "contrasts": {
            robot: {key: {"method": way, **asdict(each)} for key, (way, each) in some.items()}
            for robot, some in compared.items()
        },
    }
    write_json(folder / "summary.json", summary)
    _draw(folder / "forgetting.png", of_robot)


def _p(found: TwoWay | None, source: str) -> float | None:
    p: float | None = getattr(found, source).p
    return p


def _bodies(of_robot: Mapping[str, Sequence[Record]], measured: Sequence[Record]) -> list[str]:
    lines = []
    for robot, rows in of_robot.items():
        for level, title in LEVELS.items():
            some = select(rows, level=level, method="plain")
            one, other = column(some, "M_CI"), column(some, "M_L")
            lines.append(
                [
                    FAMILIES[robot].title,
                    title,
                    f"{len(some)} of {len(select(measured, robot=robot))}",
                    f"{one.mean():.2f} ({one.min():.2f} to {one.max():.2f})",
                    f"{other.mean():.3f} ({other.min():.3f} to {other.max():.3f})",
                ]
            )
    return markdown(["robot", "bodies", "number", "M_CI, mean and range", "M_L, mean and range"], "llrrr", lines)


def _groups(
    of_robot: Mapping[str, Sequence[Record]], ways: Mapping[str, str]
) -> Iterator[tuple[list[str], str, list[Record]]]:
    """Bodies of each robot and level that learned in each of some ways: the first cells of their row, way and rows."""
    for robot, rows in of_robot.items():
        for level, title in LEVELS.items():
            for way, words in ways.items():
                yield [FAMILIES[robot].title, title, words], way, select(rows, level=level, method=way)


def _means(of_robot: Mapping[str, Sequence[Record]]) -> list[str]:
    lines = []
    for cells, way, some in _groups(of_robot, METHODS):
        start, learned, final = (column(some, name).mean() for name in ("start_a", "learned_a", "final_a"))
        kept = cell((final - start) / (learned - start), ".0%") if learned > start else "-"
        ends = [_interval(column(some, name)) for name in ("final_a", "final_b", "worse")]
        first = cell(learned, ".2f") if way in SEQUENTIAL else "-"
        lines.append([*cells, cell(start, ".2f"), first, kept, *ends])
    header = ["robot", "bodies", "method", "A before", "A after A", "gain in A kept", "A at the end", "B at the end"]
    return markdown([*header, "the worse of both"], "lllrrrrrr", lines)


def _returns(of_robot: Mapping[str, Sequence[Record]]) -> list[str]:
    lines = []
    for cells, _, some in _groups(of_robot, SEQUENTIAL):
        steps = [cell(column(some, name).mean(), ".2f") for name in ("first", "again")]
        lines.append([*cells, *steps, _interval(outcome(some, "saved"))])
    return markdown(["robot", "bodies", "method in B", "A at first", "A again", "saved"], "lllrrr", lines)


def _analyses(
    found: Mapping[tuple[str, str], TwoWay | None], adjusted: Mapping[tuple[str, str, str], float]
) -> list[str]:
    lines = []
    for (robot, name), each in found.items():
        if each is None:
            continue
        cells = []
        for source in SOURCES:
            one = getattr(each, source)
            p = adjusted.get((robot, name, source))
            cells.append(f"{one.omega:.2f} ({one.omega_low:.2f} to {one.omega_high:.2f}), p {_spoken(p)}")
        words = verdict(each, adjusted.get((robot, name, "interaction")))
        lines.append([FAMILIES[robot].title, OUTCOMES[name], *cells, words])
    return markdown(["robot", "outcome", *SOURCES.values(), "verdict"], "llrrrl", lines)


def _compared(compared: Mapping[str, Mapping[str, tuple[str, Difference]]]) -> list[str]:
    titles = {
        "body": "plain in high M_CI less {} in low",
        "adds": "{} less plain, in high M_CI",
        "helps": "{} less plain, in low M_CI",
    }
    lines = [
        [
            FAMILIES[robot].title,
            titles[key].format(METHODS[way]),
            f"{d.difference:+.3f}",
            f"{d.low:+.3f} to {d.high:+.3f}",
        ]
        for robot, some in compared.items()
        for key, (way, d) in some.items()
    ]
    return markdown(["robot", "difference", "mean", "95 % interval"], "llrr", lines)


def _spoken(p: float | None) -> str:
    return "-" if p is None else "< 0.001" if p < 0.001 else f"{p:.3f}"


def _interval(values: Floats) -> str:
    low, high = mean_interval(values)
    return f"{values.mean():.2f} ({low:.2f} to {high:.2f})"


def _draw(path: Path, of_robot: Mapping[str, Sequence[Record]]) -> None:
    """A column for each robot; A at the end and the worse of both, by method, in bodies of either level."""
    shown = {"final_a": "A at the end", "worse": "worse of A and B"}
    ways = {"plain": "plain", "elastic": "elastic", "replay": "replay", "frozen": "frozen", "both": "both\nat once"}
    place = np.arange(float(len(ways)))
    with figure(path, PAGE, 4.2, nrows=len(shown), ncols=len(of_robot), sharex=True) as (drawn, panels):
        handles = []
        for axes_column, (robot, rows) in zip(panels.T, of_robot.items(), strict=True):
            for axes, name in zip(axes_column, shown, strict=True):
                handles = [_points(axes, rows, name, level, np.asarray(place + side)) for level, side in _SIDES.items()]
                axes.axhline(0.0, color="0.7", linewidth=0.6, zorder=0)
                axes.set_xticks(place, list(ways.values()))
            caption(axes_column[0], FAMILIES[robot].title)
        for axes, title in zip(panels[:, 0], shown.values(), strict=True):
            axes.set_ylabel(title)
        after = panels[0, 0].plot([], [], "--", color="0.4", linewidth=0.8, label="A after A")
        legend_above(drawn, [*handles, *after])


def _points(axes: Any, rows: Sequence[Record], name: str, level: str, place: Floats) -> Any:
    """Means of all methods with intervals, single bodies behind, and of A the mean that was learned first."""
    colour = COLOURS[list(LEVELS).index(level)]
    for at, way in zip(place, METHODS, strict=True):
        values = column(select(rows, level=level, method=way), name)
        axes.scatter(np.full(len(values), at), values, s=5, color=colour, alpha=0.25, linewidths=0)
        low, high = mean_interval(values)
        axes.plot([at, at], [low, high], color=colour)
        axes.plot(at, values.mean(), "o", color=colour, markersize=4)
    if name == "final_a":
        learned = column(select(rows, level=level, method="plain"), "learned_a").mean()
        axes.axhline(learned, color=colour, linestyle="--", linewidth=0.8)
    return axes.plot([], [], "o-", color=colour, markersize=4, label=LEVELS[level].replace("M_CI", "$M_{CI}$"))[0]
