"""A table of what fuzzing gave to the readers of files, and its sums by reader in docs/faults.md.

    python tests/fuzz/fuzz_log.py

writes the sums anew into the page, between the two comments that mark them, as ``make fuzz`` does after each reader. A
test holds the page against the table.
"""

import csv
import io
import subprocess
from collections.abc import Iterable, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TABLE, PAGE = ROOT / "docs/data/fuzzing.csv", ROOT / "docs/faults.md"
COLUMNS = ("date", "commit", "reader", "inputs", "cpu_s", "memory_mb", "failure")
BEGIN, END = "<!-- made by tests/fuzz/fuzz_log.py -->\n", "<!-- end of what is made -->\n"
FUZZED = ("taichi_sim", "robots", "optim", "tests/fuzz")  # what a commit must have as it was when it was fuzzed


def commit(root: Path = ROOT) -> str:
    """The commit that is fuzzed, with ``-dirty`` where the readers or the fuzzing differ from it."""

    def git(*words: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(["git", "-C", str(root), *words], capture_output=True, text=True)

    named = git("rev-parse", "--short=8", "HEAD")
    if named.returncode:
        return "unknown"
    return named.stdout.strip() + ("-dirty" if git("status", "--porcelain", "--", *FUZZED).stdout else "")


def append(row: Mapping[str, object], table: Path = TABLE) -> None:
    """Add a row of ``COLUMNS`` to a table, which gets its first line where it is new."""
    table.parent.mkdir(parents=True, exist_ok=True)
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    if not table.exists():
        writer.writeheader()
    writer.writerow(row)
    with table.open("a", newline="") as file:
        file.write(text.getvalue())


def read(table: Path = TABLE) -> list[dict[str, str]]:
    """Rows of a table."""
    with table.open(newline="") as file:
        return list(csv.DictReader(file))


def sums(rows: Iterable[Mapping[str, str]]) -> str:
    """The rows of each reader together, as a table of Markdown whose first line is for all readers."""
    rows = list(rows)
    by_reader: dict[str, list[Mapping[str, str]]] = {}
    for row in rows:
        by_reader.setdefault(row["reader"], []).append(row)
    lines = ["| reader | inputs | CPU time | memory, at most | failures |", "| --- | ---: | ---: | ---: | ---: |"]
    lines += [_sum(f"all {len(by_reader)}", rows), *(_sum(f"`{name}`", by_reader[name]) for name in sorted(by_reader))]
    return "".join(f"{line}\n" for line in lines)


def _sum(name: str, rows: Iterable[Mapping[str, str]]) -> str:
    rows = list(rows)
    inputs, seconds = (sum(float(row[column] or 0) for row in rows) for column in ("inputs", "cpu_s"))
    memory = max(float(row["memory_mb"]) for row in rows)
    failures = sum(row["failure"] != "" for row in rows)
    return f"| {name} | {inputs:,.0f} | {seconds:,.0f} s | {memory:.0f} MB | {failures} |"


def written(page: str, rows: Iterable[Mapping[str, str]]) -> str:
    """A page whose sums are made anew; raises ValueError if its marks are not there once each, in order."""
    before, *rest = page.split(BEGIN)
    if len(rest) != 1 or len(after := rest[0].split(END)) != 2:
        raise ValueError(f"{PAGE}: it does not have {BEGIN.strip()} and {END.strip()}, once each, in this order")
    return f"{before}{BEGIN}\n{sums(rows)}\n{END}{after[1]}"


def write_page() -> None:
    """Make the sums in docs/faults.md anew."""
    PAGE.write_text(written(PAGE.read_text(), read()))


if __name__ == "__main__":
    write_page()
