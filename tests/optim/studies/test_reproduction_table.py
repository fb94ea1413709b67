"""The tables of docs/reproduction.md: they are what the committed data says, and have every published study."""

import gzip
import json
import re
import shutil
from functools import cache

import pytest
import reproduction_rows
import reproduction_table
from reproduction_rows import Row
from reproduction_table import PAGE, chapters, tables, written

from optim.cli import build_parser
from optim.studies.catalogue import STUDIES

OTHER_COMMANDS = {"sensor-placement": "sweep", "training": "train", "interference": "interference"}


committed = cache(chapters)  # of docs/data as it is


def rows() -> list[Row]:
    """Rows of all chapters."""
    return [row for found in committed().values() for row in found]


@pytest.mark.long
def test_the_page_is_what_the_data_says(monkeypatch):
    """Mended by ``python docs/site/reproduction_table.py``."""
    monkeypatch.setattr(reproduction_table, "chapters", committed)
    assert written(PAGE.read_text()) == PAGE.read_text()


@pytest.mark.long
def test_every_row_tells_everything_and_every_command_is_one():
    for row in rows():
        assert all(vars(row).values()), row
        assert "|" not in "".join(vars(row).values()), row
        if row.command.startswith("morpholab "):
            build_parser().parse_args([*row.command.split()[1:], "--out", "runs/a"])


@pytest.mark.long
def test_a_result_names_its_run_in_the_table_below_it():
    """Six columns are what a narrow page shows; a letter leads to the command, in the same chapter."""
    made = PAGE.read_text().split(reproduction_table.BEGIN)[1].split(reproduction_table.END)[0]
    parts = re.split(r"^### .*\n", made, flags=re.M)[1:]
    for part, found in zip(parts, committed().values(), strict=True):
        tables_of = part.strip().split("\n\n")
        results, runs = ([line.strip("| ").split(" | ") for line in table.splitlines()] for table in tables_of)
        assert {len(cells) for cells in results} == {6} and {len(cells) for cells in runs} == {4}
        told = {letter: (command.strip("`"), seeds, share) for letter, command, seeds, share in runs[2:]}
        letters = [cells[results[0].index("run")] for cells in results[2:]]
        assert [told[letter] for letter in letters] == [(row.command, row.seeds, row.share) for row in found]
        assert sorted(set(letters)) == list(told)


@pytest.mark.long
def test_every_study_of_the_dissertation_is_in_the_table():
    commands = [row.command.split() for row in rows()]
    told = {words[2] if words[1] == "reproduce" else words[1] for words in commands}
    published = [name for name in STUDIES if re.search(r"studies\.chapter\d", STUDIES[name].run.__module__)]
    assert len(published) > 12
    assert {OTHER_COMMANDS.get(name, name) for name in published} <= told


@pytest.mark.long
def test_numbers_follow_the_data(tmp_path, monkeypatch):
    """Of other data, another table: intervals, counts and correlations are read, not written down."""
    shutil.copytree(reproduction_rows.DOCS / "data", tmp_path / "data")
    monkeypatch.setattr(reproduction_rows, "DOCS", tmp_path)
    path = tmp_path / "data/interference/two/tables.csv"
    told, count = re.subn(r"(defined,M1,sum,legged,5,)[\d.]+", r"\g<1>1.25", path.read_text())
    assert count == 1
    path.write_text(told)
    (kept := tmp_path / "data/hand-gait-sensitivity").mkdir(exist_ok=True)
    made = [(1.0, None), (0.5, True), (2.0, False), (2.0, True)]
    names = ["unchanged", *["density"] * 3]
    told = [
        {"parameter": name, "factor": f, "survives": s, "copies": 3} for name, (f, s) in zip(names, made, strict=True)
    ]
    (kept / "summary.json").write_text(json.dumps({"rows": told}))
    sweep = tmp_path / "data/vehicle-sweep.csv.gz"
    told = gzip.decompress(sweep.read_bytes()).decode().replace("\n6553,26,1830\n", "\n6553,27,1830\n")
    sweep.write_bytes(gzip.compress(told.encode()))
    page, made = PAGE.read_text(), tables()
    for changed in (
        "| 1.25 [6.17, 7.64], ",
        "| 2 of 3 | 3 copies | h |",
        "| 9.5 %: 2 of 21 changes |",
        "| 0.0018, 0.0148 |",
    ):
        assert changed in made and changed not in page


def test_a_page_without_its_marks_is_refused():
    for text in ("", reproduction_table.BEGIN, reproduction_table.END + reproduction_table.BEGIN):
        with pytest.raises(
            ValueError, match=r"reproduction.md: it does not have <!-- made by .* once each, in this order"
        ):
            written(text)
