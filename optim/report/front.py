"""What searches for several objectives, or many kinds of designs, keep."""

from typing import Any

import numpy as np

from optim.plots.fronts import add_bar, draw_elites, draw_front
from optim.problem import objectives_of
from optim.report.markup import Html, Section, charted, paragraph, table
from optim.report.robot_run import Subject
from optim.runs.history import History, read_result
from optim.search.method import SearchResult

MOST_MEMBERS = 40
SIZE = (4.4, 3.2)  # of charts [in]


def front_section(history: History, subject: Subject) -> Section | None:
    """The front, or the elites, of a run; None of a search that keeps neither, or has none."""
    result = read_result(history, subject.problem)
    if result is None or result.kind not in ("front", "elites") or not len(result.points):
        return None
    if result.kind == "front":
        return Section("The Pareto front", [_front(result, subject), _members(result, subject, "Designs of the front")])
    return Section("The elites", [*_elites(result, subject), _members(result, subject, "Elites, best first")])


def _front(result: SearchResult, subject: Subject) -> Html:
    labels, count = [objective.label for objective in objectives_of(subject.problem)], len(result.points)
    if len(labels) == 1:
        return paragraph("There is one objective, so the front is its best design.")
    if len(labels) > 3:
        return paragraph(f"{count} designs, of which none dominates another in {len(labels)} objectives.")
    best = int(np.argmax(result.scores))

    def draw(axes: Any) -> None:
        shown = draw_front(axes, result.objectives, labels, best=best)
        if shown is not None:
            add_bar(axes.figure, axes, shown, labels[2])

    alt = f"{count} designs of the front, by {' and '.join(labels)}"
    caption = "Designs of which none dominates another; the circle has the best mean of them."
    if result.score > result.scores[best]:
        caption += " The best design of the run, with a better mean, is not among them."
    return charted(draw, alt, caption, size=SIZE, kind="narrow")


def _elites(result: SearchResult, subject: Subject) -> list[Html]:
    grid = result.grid
    if grid is None:
        return []

    def draw(axes: Any) -> None:
        add_bar(axes.figure, axes, draw_elites(axes, grid, result.scores), subject.score.label)

    names, filled = list(grid.axes), len(grid.cells) / grid.bins ** len(grid.axes)
    alt = f"{len(grid.cells)} elites by {' and '.join(names[:2])}, coloured by score"
    more = f" Along {', '.join(names[2:])} the best is shown." if len(names) > 2 else ""
    caption = f"The best design of every kind: {len(grid.cells)} cells, {filled:.0%} of all, have one.{more}"
    return [charted(draw, alt, caption, size=SIZE, kind="narrow")]


def _members(result: SearchResult, subject: Subject, caption: str) -> Html:
    """A table of designs, the best mean first, by the numbers that ``--member`` takes."""
    order = np.argsort(-result.scores, kind="stable")[:MOST_MEMBERS]
    columns = subject.columns(result.points[order])
    header = ("Member", *(objective.label for objective in objectives_of(subject.problem)), *columns)
    rows = [
        (str(member + 1), *result.objectives[member].tolist(), *(cells[row] for cells in columns.values()))
        for row, member in enumerate(order.tolist())
    ]
    part = f" (the best {len(order)} of {len(result.points)})" if len(order) < len(result.points) else ""
    return table(f"{caption}{part}; export and view take them by --member", header, rows)


def places(result: SearchResult, subject: Subject) -> dict[str, Any]:
    """Where the members of a front, or of a map of elites, are, as values that fit JSON; nothing of other searches.

    A member is a row of its place along two axes, its score and the number that ``--member`` takes: places are cells of
    a map, of which the best is told where there are more axes, and values of the first two objectives of a front.
    """
    if result.kind not in ("front", "elites") or not len(result.points):
        return {}
    if result.grid is None:
        labels = [objective.label for objective in objectives_of(subject.problem)][:2]
        if len(labels) < 2:
            return {}
        rows = np.column_stack([result.objectives[:, :2], result.scores]).tolist()
        members = [(*row, number) for number, row in enumerate(rows, start=1)]
        return {"kind": "front", "axes": [{"name": label} for label in labels], "members": members}
    grid = result.grid
    ends = [{"name": n.replace("_", " "), "low": low, "high": high} for n, (low, high) in grid.axes.items()][:2]
    best: dict[tuple[int, ...], int] = {}
    for member in np.argsort(result.scores, kind="stable").tolist():
        best[tuple(grid.places[member, :2].tolist())] = member
    cells = [(*(*cell, 0)[:2], float(result.scores[n]), n + 1) for cell, n in sorted(best.items())]
    return {"kind": "elites", "axes": ends, "bins": grid.bins, "members": cells}
