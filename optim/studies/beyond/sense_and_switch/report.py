"""What the study writes: how far machines go beside one that is told the ground, and how soon they notice changes."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.results import write_json
from optim.experiments.tables import MISSING, Record, cell, column, distinct, markdown, mean_with_interval, page, select
from optim.measures.statistics import wilson
from robots.control.cyclic import SEGMENTS
from robots.course import KINDS
from robots.lattice_robot.presets import FREQUENCY
from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import write_text

LOOK = 1.0 / (FREQUENCY * SEGMENTS)  # s from one look to the next
RESAMPLES = 10_000
TOLD, TOLD_STAYING, BEST, CHANCE = "told", "told, staying", "best single gait", "by chance"
RULES = ("sensing", "sensing, no hysteresis")
HEADER = (
    "machine",
    "distance [m]",
    "of the told one's",
    "95 % interval",
    "right gait",
    "switches [1/min]",
    "false [1/min]",
)


def ratio(part: Floats, whole: Floats) -> tuple[float, float | None, float | None]:
    """Mean of what some machines went over that of others, with its 95 % bootstrap interval.

    Both have shape (seeds, courses), in which both seeds and courses are drawn anew for every resample (percentiles).
    There is no interval if the others went nowhere in some resample.
    """
    rng = np.random.default_rng(0)
    counts = [rng.multinomial(n, np.full(n, 1 / n), RESAMPLES).astype(float) for n in whole.shape]
    sums = [np.einsum("rs,sc,rc->r", counts[0], each, counts[1]) for each in (part, whole)]
    share = float(part.mean() / whole.mean())
    if sums[1].min() <= 0:
        return share, None, None
    low, high = np.percentile(sums[0] / sums[1], [2.5, 97.5])
    return share, float(low), float(high)


def table_of(rows: Sequence[Record], name: str, what: str = "distance") -> Floats:
    """Distances of a machine [m], or another column, shape (seeds, courses)."""
    own = select(rows, machine=name)
    return column(own, what).reshape(len(distinct(own, "seed")), -1)


def with_best(rows: Sequence[Record], gaits: Sequence[Record]) -> list[Record]:
    """The rows, and those of each seed's best single gait on training courses once more, by the name of that."""
    best = {row["seed"]: f"always {row['gait']}" for row in gaits if row["best_alone"]}
    again = [{**row, "machine": BEST} for row in rows if row["machine"] == best[row["seed"]]]
    return [*rows, *again]


def _summary(rows: Sequence[Record], name: str, seconds: float) -> dict[str, Any]:
    """What one kind of machine did on all courses."""
    own, whole = select(rows, machine=name), table_of(rows, TOLD)
    share, low, high = ratio(table_of(rows, name), whole) if whole.mean() > 0 else (None, None, None)
    told: dict[str, Any] = {"distance": float(column(own, "distance").mean()), "share": share, "low": low, "high": high}
    for what, unit in (("switches", seconds / 60), ("false", seconds / 60), ("right", 1.0)):
        values = table_of(rows, name, what) / unit
        told[what], *ends = ratio(values, np.ones_like(values))
        told[f"{what}_low"], told[f"{what}_high"] = ends
    return {**told, "n": len(own)}


def _repertoires(rows: Sequence[Record], events: Sequence[Record], gaits: Sequence[Record]) -> list[dict[str, Any]]:
    """How each repertoire's sensing machine did beside the one that is told, and the hysteresis that it has."""
    found = []
    for seed in distinct(rows, "seed"):
        own, changes = select(rows, seed=seed), select(events, seed=seed, machine=RULES[0])
        told, sensing = (table_of(own, name) for name in (TOLD, RULES[0]))
        share = ratio(sensing, told) if told.mean() > 0 else (None, None, None)
        chosen = select(gaits, seed=seed)[0]
        found.append(
            {
                "repertoire": seed,
                **dict(zip(("share", "low", "high"), share, strict=True)),
                "switches": int(column(select(own, machine=RULES[0]), "switches").sum()),
                "changes": len(changes),
                "noticed": sum(row["looks"] is not None for row in changes),
                **{name: chosen[name] for name in ("margin", "stay")},
            }
        )
    return found


def _noticed(events: Sequence[Record], name: str) -> dict[str, dict[str, Any]]:
    """How soon a machine notices changes to each kind of ground."""
    found = {}
    for kind in ("any", *KINDS):
        own = [row for row in select(events, machine=name) if kind in ("any", row["to"])]
        if not own:
            continue
        looks = [row["looks"] for row in own if row["looks"] is not None]
        low, high = wilson(len(looks), len(own))
        ends = np.percentile(looks, [25, 50, 75]) * LOOK if looks else [None] * 3
        delays = dict(zip(("quarter", "median", "three_quarters"), (d and float(d) for d in ends), strict=True))
        found[kind] = {"changes": len(own), "noticed": len(looks) / len(own), "low": low, "high": high, **delays}
    return found


def report(
    folder: Path, settings: Any, rows: Sequence[Record], events: Sequence[Record], gaits: Sequence[Record]
) -> dict[str, Any]:
    """Write ``summary.json`` and ``table.md``, which follow from the tables; what each kind of machine did."""
    seconds = _seconds(settings)
    every = with_best(rows, gaits)
    names = [TOLD, TOLD_STAYING, *RULES, BEST, CHANCE]
    names += [name for name in distinct(rows, "machine") if name not in names]
    found = {name: _summary(every, name, seconds) for name in names}
    seen = {name: told for name in names if (told := _noticed(events, name))}
    over: dict[str, Any] = {}
    for name in (TOLD_STAYING, BEST):
        if table_of(every, name).mean() > 0:
            ends = ratio(table_of(every, "sensing"), table_of(every, name))
            over[name] = dict(zip(("ratio", "low", "high"), ends, strict=True))
    each = _repertoires(rows, events, gaits)
    summary = {"settings": settings.describe(), "machines": found, "noticed": seen, "sensing_over": over}
    write_json(folder / "summary.json", summary | {"repertoires": each})
    write_text(folder / "table.md", page(*_page(settings, found, seen, gaits, over), *_repertoire_table(each)))
    return found


def _page(
    settings: Any,
    found: Mapping[str, Mapping[str, Any]],
    seen: Mapping[str, Mapping[str, Mapping[str, Any]]],
    gaits: Sequence[Record],
    over: Mapping[str, Mapping[str, float]],
) -> list[str | list[str]]:
    """Tables of machines, of what they notice, and of gaits."""
    lines = []
    for name, one in found.items():
        interval = _interval(one, ".0%")
        others = [_between(one, "right", ".0%"), _between(one, "switches", ".1f"), _between(one, "false", ".1f")]
        lines.append([name, f"{one['distance']:.3f}", cell(one["share"], ".0%"), interval, *others])
    parts: list[str | list[str]] = [
        f"{settings.seeds} repertoires on {settings.held_out} held-out courses, {_seconds(settings):g} s each; "
        "intervals by resampling repertoires and courses.",
        markdown(HEADER, "lrrrrrr", lines),
    ]
    for name, one in over.items():
        parts.append(f"Sensing over {name}: {one['ratio']:.2f} times as far, 95 % interval {_interval(one, '.2f')}.")
    lines = []
    for name, kinds in seen.items():
        for kind, one in kinds.items():
            interval = _interval(one, ".0%")
            delays = [cell(one[key], ".2f") for key in ("median", "quarter", "three_quarters")]
            lines.append([name, kind, one["changes"], f"{one['noticed']:.0%}", interval, *delays])
    if lines:
        header = (
            "machine",
            "new ground",
            "changes",
            "noticed",
            "95 % interval",
            "median [s]",
            "first quartile [s]",
            "third quartile [s]",
        )
        parts += [
            "Changes of ground that want another gait, and the time until it plays, of those that are noticed; "
            "intervals take changes as independent:",
            markdown(header, "llrrrrrr", lines),
        ]
    columns = [f"on_{kind}" for kind in KINDS]
    lines = []
    for kind in KINDS:
        own = select(gaits, gait=kind)
        lines.append([kind, *(mean_with_interval(column(own, name), ".2f") for name in columns)])
    parts.append(f"Speeds of the gaits [body lengths/s], means of {settings.seeds} repertoires with 95 % intervals:")
    parts.append(markdown(("gait searched on", *(f"on {kind}" for kind in KINDS)), "lrrrr", lines))
    return parts


def _seconds(settings: Any) -> float:
    """How long machines are on a course."""
    return float((settings.cycles + 1) / FREQUENCY)


def _interval(one: Mapping[str, Any], form: str) -> str:
    """An interval from low to high, if there is one."""
    return MISSING if one["low"] is None else f"{one['low']:{form}} to {one['high']:{form}}"


def _between(one: Mapping[str, Any], what: str, form: str) -> str:
    """A mean of a machine with its interval."""
    return f"{one[what]:{form}} ({one[f'{what}_low']:{form}} to {one[f'{what}_high']:{form}})"


def _repertoire_table(each: Sequence[Mapping[str, Any]]) -> list[str | list[str]]:
    """What the sensing machine of each repertoire did."""
    header = ["repertoire", "of the told one's distance", "95 % interval", "switches", "changes", "noticed"]
    lines = [
        [
            one["repertoire"],
            cell(one["share"], ".0%"),
            _interval(one, ".0%"),
            *(one[name] for name in ("switches", "changes", "noticed")),
            f"{one['margin']:g}",
            one["stay"],
        ]
        for one in each
    ]
    return [
        "The sensing machine of each repertoire, with intervals by resampling courses; changes are those that want "
        "another gait, margin and stay what it chose on training courses:",
        markdown([*header, "margin", "stay [looks]"], "r" * 8, lines),
    ]
