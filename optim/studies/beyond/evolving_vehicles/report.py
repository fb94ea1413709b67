"""What the study of evolving vehicles writes: tables with intervals, and a picture."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.figures import COLOURS, PAGE, caption, figure
from optim.experiments.results import write_json
from optim.experiments.tables import Record, column, distinct, markdown, mean_with_interval, page, select
from optim.measures.statistics import difference_of_means, mean_interval
from optim.studies.beyond.body_and_learning.learning import LEARNERS, succeeded
from optim.studies.beyond.evolving_vehicles.searches import LOOPS
from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import write_text

BODIES, LOOPED, PICTURE = "bodies.csv", "loops.csv", "evolving-vehicles.png"
LEARNED = ("evolution", "gradient")  # kinds of learning in evolved bodies
ARMS = {
    "random": "random",
    "performance": "performance",
    "resistance": "performance and M_CI",
    "learnability": "performance and M_L",
}
COLUMNS = {
    "M_L": ("M_L", ".3f"),
    "M_CI": ("M_CI", ".3f"),
    "seen_M_CI": ("M_CI as evolution saw it", ".3f"),
    "performance": ("performance [m]", ".3f"),
    "evolution": ("evaluations, evolution", ".1f"),
    "gradient": ("evaluations, gradients", ".1f"),
}


def write_report(folder: Path, bodies: Sequence[Record], loops: Sequence[Record], settings: Mapping[str, Any]) -> None:
    """Write ``table.md``, ``summary.json`` and a picture."""
    looped, count = ends(loops), len(distinct(bodies, "seed"))
    header = ["evolved for", *(title for title, _ in COLUMNS.values())]
    learners = [LEARNERS[name].title for name in LEARNED]
    budget, steep = (LEARNERS[name].evaluations(settings["budget"]) for name in LEARNED)
    write_text(
        folder / "table.md",
        page(
            f"Vehicles of {count} seeds, means with 95 % intervals:",
            markdown(header, "l" + "r" * len(COLUMNS), rows(bodies)),
            "More than evolved for performance alone, means of pairs with 95 % intervals:",
            markdown(header, "l" + "r" * len(COLUMNS), changes(bodies)),
            f"Runs of learning that succeeded within {budget} evaluations, or {steep} with gradients; others count all "
            "of these above:",
            markdown(["evolved for", *learners], "l" + "r" * len(learners), successes(bodies, settings["repetitions"])),
            f"How near the best controller comes to the light in its worst environment, as minus the distance, after "
            f"{settings['loop_budget']} evaluations, of which one with its gradient counts {settings['price']:g}; "
            f"{count} seeds:",
            markdown(["arm", "score [m]", "more than one loop [m]", "CPU time [s]"], "lrrr", loop_rows(looped)),
        ),
    )
    summary = {
        "settings": dict(settings),
        "bodies": {arm: {name: column(select(bodies, arm=arm), name).tolist() for name in COLUMNS} for arm in ARMS},
        "loops": {arm: column(select(looped, arm=arm), "best").tolist() for arm in LOOPS},
    }
    write_json(folder / "summary.json", summary)
    draw(folder / PICTURE, bodies, loops)


def ends(loops: Sequence[Record]) -> list[Record]:
    """The last mark of every run of a loop."""
    last = max(row["evaluations"] for row in loops)
    return select(loops, evaluations=last)


def rows(bodies: Sequence[Record]) -> list[list[str]]:
    """Cells of what bodies of each arm are worth."""
    return [
        [
            title,
            *(mean_with_interval(column(select(bodies, arm=arm), name), form) for name, (_, form) in COLUMNS.items()),
        ]
        for arm, title in ARMS.items()
    ]


def changes(bodies: Sequence[Record]) -> list[list[str]]:
    """Cells of how bodies of each arm differ from those evolved for performance alone."""
    base = select(bodies, arm="performance")
    found = []
    for arm, title in ARMS.items():
        if arm != "performance":
            part = select(bodies, arm=arm)
            cells = (against(column(part, name), column(base, name), form) for name, (_, form) in COLUMNS.items())
            found.append([title, *cells])
    return found


def successes(bodies: Sequence[Record], repetitions: int) -> list[list[str]]:
    """Cells of how many runs of learning succeeded in the bodies of each arm."""
    parts = ((title, select(bodies, arm=arm)) for arm, title in ARMS.items())
    return [[title, *(succeeded(part, name, repetitions) for name in LEARNED)] for title, part in parts]


def loop_rows(looped: Sequence[Record]) -> list[list[str]]:
    """Cells of where each arm ends."""
    flat = column(select(looped, arm="flat"), "best")
    found = []
    for arm, title in LOOPS.items():
        part = select(looped, arm=arm)
        best = column(part, "best")
        more = "-" if arm == "flat" else against(best, flat, ".4f")
        found.append([title, mean_with_interval(best, ".4f"), more, mean_with_interval(column(part, "seconds"), ".1f")])
    return found


def against(values: Floats, base: Floats, form: str) -> str:
    """The mean difference of pairs with its 95 % interval."""
    both = np.isfinite(values) & np.isfinite(base)
    if both.sum() < 2:
        return "-"
    one = difference_of_means(base[both], values[both], paired=True)
    return f"{one.difference:+{form}}, {one.low:+{form}} to {one.high:+{form}}"


def draw(path: Path, bodies: Sequence[Record], loops: Sequence[Record]) -> None:
    """Exact M_CI, evaluations of evolution, and courses of the loops."""
    with figure(path, PAGE, 2.7, ncols=3) as (_, panels):
        for axes, name, label in ((panels[0, 0], "M_CI", "$M_{CI}$"), (panels[0, 1], "evolution", "evaluations")):
            _points(axes, bodies, name)
            axes.set_ylabel(label)
        caption(panels[0, 0], "resistance")
        caption(panels[0, 1], "learning by evolution")
        _courses(panels[0, 2], loops)
        caption(panels[0, 2], "two loops and one")
        panels[0, 2].legend(loc="lower right")


def _points(axes: Any, bodies: Sequence[Record], name: str) -> None:
    """A point for each seed, beside the mean with its interval."""
    for place, arm in enumerate(ARMS):
        values = column(select(bodies, arm=arm), name)
        values = values[np.isfinite(values)]
        axes.scatter(np.full(len(values), place - 0.12), values, s=7, color=COLOURS[place], alpha=0.5, linewidths=0)
        if len(values) > 1:
            low, high = mean_interval(values)
            axes.plot([place + 0.12] * 2, [low, high], color=COLOURS[place])
            axes.plot(place + 0.12, values.mean(), "o", markersize=4, color=COLOURS[place])
    labels = ["random", "performance", "+ $M_{CI}$", "+ $M_L$"]
    axes.set_xticks(range(len(ARMS)), labels, fontsize=6)
    axes.set_ylim(bottom=0)


def _courses(axes: Any, loops: Sequence[Record]) -> None:
    """Mean of the best score over cost, with its interval."""
    costs = np.array(distinct(loops, "evaluations"))
    for number, (arm, title) in enumerate(LOOPS.items()):
        best = np.array([column(select(loops, arm=arm, evaluations=cost), "best") for cost in costs])
        known = np.isfinite(best).all(axis=1)
        axes.plot(costs[known], best[known].mean(axis=1), color=COLOURS[number], label=title)
        if best.shape[1] > 1:
            low, high = np.array([mean_interval(each) for each in best[known]]).reshape(-1, 2).T
            axes.fill_between(costs[known], low, high, color=COLOURS[number], alpha=0.15, linewidth=0)
    axes.set_xlabel("evaluations")
    axes.set_ylabel("best score [m]")
