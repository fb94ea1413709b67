"""Make the tables of docs/reproduction.md: what was published and what came out here, from the data in docs/data.

    python docs/site/reproduction_table.py

writes them anew into the page, between the two comments that mark them. A test holds the page against the data.
Published values are the dissertation's; ours, n and intervals (95 %) are of the data.
"""

from collections.abc import Sequence
from string import ascii_lowercase

from reproduction_learning import learning
from reproduction_rows import PAGE, Row, data
from reproduction_soft_robot import gaits, searches
from reproduction_vehicles import interference, metrics, placement, proposals, rover

BEGIN, END = "<!-- made by docs/site/reproduction_table.py -->\n", "<!-- end of what is made -->\n"
OF_SEARCHES = "<!-- table.md of data/shape-change -->\n", "<!-- end of table.md -->\n"
RESULTS = ("what", "published", "here", "n", "run", "what differs, and why")
RUNS = ("run", "command", "seeds", "share of budget")


def chapters() -> dict[str, list[Row]]:
    """Rows of the chapters, by their headings."""
    return {
        "Quadrupeds (chapter 2)": interference(),
        "Sensors (chapter 3)": [*placement(), *rover()],
        "Metrics (chapter 4)": metrics(),
        "The shape-changing robot (chapter 5)": [*gaits(), *searches()],
        "Proposals (chapter 6)": [*proposals(), *learning()],
    }


def tables() -> str:
    """The tables of all chapters as Markdown, each below its heading."""
    return "\n".join(f"### {heading}\n\n{_tables(rows)}" for heading, rows in chapters().items())


def _tables(rows: Sequence[Row]) -> str:
    """A chapter's results, and below them its runs, which results name by letters: columns enough for a narrow page."""
    runs = dict(
        zip(dict.fromkeys((f"`{row.command}`", row.seeds, row.share) for row in rows), ascii_lowercase, strict=False)
    )
    results = [
        (row.what, row.published, row.here, row.n, runs[f"`{row.command}`", row.seeds, row.share], row.differs)
        for row in rows
    ]
    return _table(RESULTS, results) + "\n" + _table(RUNS, [(letter, *run) for run, letter in runs.items()])


def _table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "".join(f"{_line(cells)}\n" for cells in (headings, ["---"] * len(headings), *rows))


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def written(page: str) -> str:
    """A page whose tables are made anew; raises ValueError if its marks are not there once each."""
    return _put(_put(page, BEGIN, END, tables()), *OF_SEARCHES, _searches())


def _put(page: str, begin: str, end: str, made: str) -> str:
    before, *rest = page.split(begin)
    if len(rest) != 1 or len(after := rest[0].split(end)) != 2:
        raise ValueError(f"{PAGE}: it does not have {begin.strip()} and {end.strip()}, once each, in this order")
    return f"{before}{begin}\n{made}\n{end}{after[1]}"


def _searches() -> str:
    """The table of simulation results of chapter 5, and its tests, as the study writes them."""
    table = data("shape-change").path("table.md").read_text()
    return table


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text()))
