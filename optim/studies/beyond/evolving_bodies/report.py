"""Tables, a summary and a picture of what bodies evolved for learning and loops of evolution and learning found."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.figures import PAGE, dots, figure
from optim.experiments.results import write_json
from optim.experiments.tables import Record, cell, column, distinct, markdown, mean_with_interval, page, select
from optim.measures.statistics import difference_of_means
from optim.studies.beyond.body_and_learning.learning import LEARNERS, succeeded
from optim.studies.beyond.evolving_bodies import loops, metrics
from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import write_text

BODY_COLUMNS = {
    "fastest": ("fastest [cm]", 100.0, ".2f"),
    "M_L": ("M_L", 1.0, ".3f"),
    "M_CI": ("M_CI", 1.0, ".3f"),
    **{name: (f"evaluations, {each.title}", 1.0, ".0f") for name, each in LEARNERS.items()},
}

ONE_LOOP = "flat"  # the search that others are compared with


def write_report(folder: Path, bodies: Sequence[Record], runs: Sequence[Record], settings: Mapping[str, Any]) -> None:
    """Write ``table.md``, ``summary.json`` and ``evolving.png``; of searches those of seeds in which all have ended."""
    ended = [seed for seed in distinct(runs, "seed") if len(select(runs, seed=seed)) == len(loops.ARMS)]
    runs = [row for row in runs if row["seed"] in ended]
    write_text(folder / "table.md", page(*_tables(bodies, runs, settings)))
    write_json(folder / "summary.json", {"settings": dict(settings), **_summary(bodies, runs)})
    _draw(bodies, runs, folder / "evolving.png")


def _tables(bodies: Sequence[Record], runs: Sequence[Record], settings: Mapping[str, Any]) -> list[str | list[str]]:
    """What was evolved for, and what came of loops, with 95 % intervals over seeds."""
    rows = [
        [
            title,
            *(
                mean_with_interval(_values(bodies, "arm", arm, name) * scale, form)
                for name, (_, scale, form) in BODY_COLUMNS.items()
            ),
        ]
        for arm, title in metrics.ARMS.items()
    ]
    gains = [
        [
            f"{title} less those for speed",
            *(
                _difference(_values(bodies, "arm", "speed", name), _values(bodies, "arm", arm, name), scale, form)
                for name, (_, scale, form) in BODY_COLUMNS.items()
            ),
        ]
        for arm, title in metrics.ARMS.items()
        if arm != "speed"
    ]
    nearer = {name: _values(runs, "search", name, "nearer") for name in loops.ARMS if runs}
    searches = [
        [
            loops.ARMS[name].label,
            mean_with_interval(values * 100, ".2f"),
            "-" if name == ONE_LOOP else _difference(nearer[ONE_LOOP], values, 100, ".2f"),
            cell(float(np.median(column(select(runs, search=name), "evaluations"))), ".0f"),
        ]
        for name, values in nearer.items()
    ]
    titles = [each.title for each in LEARNERS.values()]
    budgets = ", ".join(str(each.evaluations(settings["budget"])) for each in LEARNERS.values())
    arms = ((title, select(bodies, arm=arm)) for arm, title in metrics.ARMS.items())
    succeeding = [
        [title, *(succeeded(part, name, settings["repetitions"]) for name in LEARNERS)] for title, part in arms
    ]
    heads = ["bodies", *(head for head, *_ in BODY_COLUMNS.values())]
    found: list[str | list[str]] = [
        f"Bodies of {settings['seeds']} runs each, by {settings['held_out']} controllers that selection has not seen, "
        f"and evaluations until one succeeds ({settings['repetitions']} repetitions in each body); means with 95 % "
        "intervals:",
        markdown(heads, "l" + "r" * len(BODY_COLUMNS), [*rows, *gains]),
        f"Runs of learning that succeeded, of at most {budgets} evaluations; others count all of these above:",
        markdown(["bodies", *titles], "l" + "r" * len(titles), succeeding),
    ]
    if runs:
        seeds = len(distinct(runs, "seed"))
        found += [
            f"Searches of {settings['seconds']:g} s of CPU time, {seeds} seeds: how much nearer the light the best "
            "is, and than with one loop, means with 95 % intervals over seeds.",
            markdown(["search", "nearer [cm]", "less one loop [cm]", "evaluations, median"], "lrrr", searches),
        ]
    return found


def _values(rows: Sequence[Record], by: str, name: str, what: str) -> Floats:
    """Values of one arm, in the order of seeds; what failed came no nearer."""
    own = sorted(select(rows, **{by: name}), key=lambda row: int(row["seed"]))
    return np.array([0.0 if row[what] is None else row[what] for row in own], float)


def _difference(one: Floats, other: Floats, scale: float, form: str) -> str:
    """How much more values of another arm are than those of one, seed by seed, with its interval."""
    a, b = one * scale, other * scale
    if len(a) < 2:
        return format(float((b - a).mean()), f"+{form}")
    found = difference_of_means(a, b, paired=True)
    return f"{found.difference:+{form}} ({found.low:+{form}} to {found.high:+{form}})"


def _summary(bodies: Sequence[Record], runs: Sequence[Record]) -> dict[str, Any]:
    """Means of all arms."""
    found = {
        arm: {name: float(_values(bodies, "arm", arm, name).mean()) for name in BODY_COLUMNS} for arm in metrics.ARMS
    }
    nearer = {name: _values(runs, "search", name, "nearer") for name in loops.ARMS if runs}
    return {"bodies": found, "loops": {name: float(values.mean()) for name, values in nearer.items()}}


def _draw(bodies: Sequence[Record], runs: Sequence[Record], path: Path) -> None:
    """Metrics and learning of bodies, and what searches reach: a dot for each run."""
    widths = (1, 1, 1.2) if runs else (1, 1)
    with figure(path, PAGE, 2.4, ncols=len(widths), width_ratios=widths) as (_, ((left, middle, *others),)):
        for axes, name, label in ((left, "M_CI", "$M_{CI}$"), (middle, "evolution", "evaluations, evolution")):
            dots(axes, {title: _values(bodies, "arm", arm, name) for arm, title in metrics.ARMS.items()})
            axes.set_xlabel(label)
        middle.tick_params(labelleft=False)
        for right in others:
            dots(right, {a.label: _values(runs, "search", n, "nearer") * 100 for n, a in loops.ARMS.items()})
            right.set_xlabel("nearer the light [cm]")
