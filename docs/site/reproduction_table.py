"""Make the table of docs/reproduction.md: what was published and what came out here, from the data in docs/data.

    python docs/site/reproduction_table.py

writes it anew into the page, between the two comments that mark it. A test holds the page against the data. Published
values are the dissertation's; ours, n and intervals (95 %) are of the data. Where no data is kept, numbers are those of
the page on which they were written down, and n says so.
"""

from collections.abc import Sequence
from dataclasses import astuple, replace

from reproduction_rows import HEADINGS, PAGE, Row
from reproduction_soft_robot import gaits, searches
from reproduction_vehicles import interference, metrics, placement, proposals, rover

BEGIN, END = "<!-- made by docs/site/reproduction_table.py -->\n", "<!-- end of what is made -->\n"


def rows() -> list[tuple[str, Row]]:
    """All rows, each with its chapter."""
    chapters = {
        "2": interference(),
        "3": [*placement(), *rover()],
        "4": metrics(),
        "5": [*gaits(), *searches()],
        "6": proposals(),
    }
    return [(chapter, row) for chapter, found in chapters.items() for row in found]


def table() -> str:
    """The whole table as Markdown."""
    lines = [_line(["chapter", *HEADINGS]), _line(["---"] * (1 + len(HEADINGS)))]
    for chapter, row in rows():
        told = replace(row, command=f"`{row.command}`")
        lines.append(_line([chapter, *astuple(told)]))
    return "\n".join(lines) + "\n"


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def written(page: str) -> str:
    """A page whose table is made anew; raises ValueError if its marks are not there once each."""
    before, *rest = page.split(BEGIN)
    if len(rest) != 1 or len(after := rest[0].split(END)) != 2:
        raise ValueError(f"{PAGE}: it does not have {BEGIN.strip()} and {END.strip()}, once each, in this order")
    return f"{before}{BEGIN}\n{table()}\n{END}{after[1]}"


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text()))
