"""What searches for several objectives, or many kinds of designs, keep."""

from typing import Any

import numpy as np

from optim.plots.fronts import add_bar, draw_elites, draw_front
from optim.problem import Objective, objectives_of
from optim.report.charts import chart
from optim.report.markup import Html, Section, number, paragraph, picture, table
from optim.report.robot_run import RunSubject
from optim.runs.history import History, read_result
from optim.search.method import SearchResult

MOST_MEMBERS = 40


def front_section(history: History, kind: RunSubject) -> Section | None:
    """The front, or the elites, of a run; None of a search that keeps neither, or has none."""
    result = read_result(history, kind.problem)
    if result is None or result.kind not in ("front", "elites") or not len(result.points):
        return None
    if result.kind == "front":
        return Section("The Pareto front", [*_front(result, kind), _members(result, kind, "Designs of the front")])
    return Section("The elites", [*_elites(result, kind, history), _members(result, kind, "Elites, best first")])


def _front(result: SearchResult, kind: RunSubject) -> list[Html]:
    names, count = kind.problem.objective_names, len(result.points)
    labels = [objective.label for objective in objectives_of(kind.problem)]
    if len(names) not in (2, 3):
        said = f"{count} designs, none of which another dominates in {len(names)} objectives."
        return [paragraph(said if len(names) > 1 else "There is one objective, so the front is its best design.")]
    best = int(np.argmax(result.scores))

    def draw(axes: Any) -> None:
        shown = draw_front(axes, result.objectives, labels, best=best)
        if shown is not None:
            add_bar(axes.figure, axes, shown, labels[2])

    alt = f"{count} designs of the front, by {' and '.join(labels)}"
    return [
        picture(
            chart(draw, alt, size=(4.4, 3.2)),
            "Designs that no other dominates; the circle has the best mean.",
            "narrow",
        )
    ]


def _elites(result: SearchResult, kind: RunSubject, history: History) -> list[Html]:
    names, space = history.config["method"].get("descriptors", []), kind.problem.space.names
    if len(names) != 2:
        return []
    places = result.points[:, [space.index(name) for name in names]]

    def draw(axes: Any) -> None:
        shown = draw_elites(axes, places, result.scores, names)
        add_bar(axes.figure, axes, shown, Objective(*kind.score).label)

    alt = f"{len(places)} elites by {names[0]} and {names[1]}, coloured by score"
    return [picture(chart(draw, alt, size=(4.4, 3.2)), "The best design of every kind.", "narrow")]


def _members(result: SearchResult, kind: RunSubject, caption: str) -> Html:
    """A table of designs, the best mean first, by the numbers that ``--member`` takes."""
    order = np.argsort(-result.scores, kind="stable")[:MOST_MEMBERS]
    columns = kind.columns(result.points[order])
    header = ("Member", *(objective.label for objective in objectives_of(kind.problem)), *columns)
    rows = [
        (str(member + 1), *map(number, result.objectives[member].tolist()), *(cells[row] for cells in columns.values()))
        for row, member in enumerate(order.tolist())
    ]
    part = f" (the best {len(order)} of {len(result.points)})" if len(order) < len(result.points) else ""
    return table(f"{caption}{part}; export and view take them by --member", header, rows)
