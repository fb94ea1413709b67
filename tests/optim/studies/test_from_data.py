"""Studies told again from their committed data: the same tables and numbers, and nothing is run."""

import ast
import csv
import gzip
import json
import shutil
from pathlib import Path

import pytest
from matplotlib.pyplot import imread

from optim import cli
from optim.experiments.data import Data
from optim.experiments.tables import value_of, write_table
from optim.studies.catalogue import STUDIES
from optim.studies.chapter2.study import PICTURES

DATA = Path(__file__).parents[3] / "docs/data"
NUMBERS = "0 -0 7 -12 007 1_0 1.5 -0.25 1e5 1.5e-7 01.5 1.5e400 .5 5."
CELLS = (*NUMBERS.split(), "True", "None", "nan", "if", "[1,2]", "legged")
TOLD = [name for name in STUDIES if STUDIES[name].rewrite is not None]


def close(one, other):
    """Whether two documents of JSON are equal, numbers within rounding."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(close(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(close, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return one == pytest.approx(other, rel=1e-9, abs=1e-12, nan_ok=True)
    return one == other


# What no table holds, by study.
LEFT_OUT = {
    "interference": {f"{n}/{name}" for n in ("four", "gradient") for name in PICTURES},
}
OTHER_FLOORS = [("capped-gaits", DATA / "capped-gaits-acrylic")]
NOTHING_COMMITTED = ("sensor-placement", "training")  # but the tables themselves; tests of their own compare


@pytest.mark.long
@pytest.mark.usefixtures("unseen_pictures")
@pytest.mark.parametrize(("study", "data"), [*((study, DATA) for study in TOLD), *OTHER_FLOORS])
def test_the_committed_tables_come_out_of_the_committed_data(study, data, tmp_path, capsys):
    out = tmp_path / "out"
    assert cli.main(["reproduce", study, "--from-data", str(data), "--out", str(out), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    names = sorted(path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file())
    assert document["files"] == names
    asked = {name for name in STUDIES[study].writes if name.endswith((".png", ".md", ".json"))}
    assert asked - set(names) <= LEFT_OUT.get(study, set())
    compared = 0
    for name in names:
        made, committed = out / name, Data(Path(document["data"])).path(name)
        if committed.exists() and made.suffix == ".json":
            assert close(json.loads(made.read_text()), json.loads(committed.read_text())), name
        elif committed.exists() and made.suffix in (".md", ".csv"):
            content = committed.read_bytes()
            assert made.read_bytes() == (gzip.decompress(content) if committed.suffix == ".gz" else content), name
        compared += committed.exists()
    assert compared or study in NOTHING_COMMITTED


@pytest.mark.slow
@pytest.mark.parametrize(("study", "data"), [*((study, DATA) for study in TOLD), *OTHER_FLOORS])
def test_pictures_are_drawn_from_the_committed_data(study, data, tmp_path):
    out = tmp_path / "out"
    assert cli.main(["reproduce", study, "--from-data", str(data), "--out", str(out)]) == 0
    assert all(imread(path).ndim == 3 for path in out.rglob("*.png"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n", "rows.csv: it has no rows"),
        ("a\n1\n", "rows.csv: it has no column b"),
        ("a,b\n1,x\nz,x\n", "rows.csv: row 3 has 'z' as a; it must be a whole number"),
        ("a,b\n1.5,x\n", "rows.csv: row 2 has 1.5 as a; it must be a whole number"),
        ("a,b\nTrue,x\n", "rows.csv: row 2 has True as a; it must be a whole number"),
        ("a,b\n1,z\n", "rows.csv: row 2 has 'z' as b; allowed are x, y"),
        ("a,b\n,x\n", "rows.csv: row 2 has None as a; it must be a whole number"),
    ],
)
def test_cells_of_another_kind_are_told(tmp_path, text, message):
    (tmp_path / "rows.csv").write_text(text)
    with pytest.raises(ValueError) as caught:
        Data(tmp_path).records("rows.csv", {"a": int, "b": ("x", "y")})
    assert str(caught.value).endswith(message)


@pytest.mark.parametrize("cell", CELLS)
def test_cells_stand_for_what_python_reads(cell):
    """Numbers and names, which are most cells, are read faster than Python's literals, and stand for the same."""
    try:
        meant = ast.literal_eval(cell)
    except (ValueError, SyntaxError):
        meant = cell
    assert repr(value_of(cell)) == repr(meant)


def test_cells_get_the_kinds_of_their_columns(tmp_path):
    (tmp_path / "rows.csv").write_text("number,none,text,more\nnan,,162,7\n2,3,a,8\n")
    first, second = Data(tmp_path).records("rows.csv", {"number": float, "none": float | None, "text": str})
    assert first["number"] != first["number"] and first["none"] is None and first["text"] == "162"
    assert second == {"number": 2, "none": 3, "text": "a", "more": 8}


def test_groups_without_rows_are_told(tmp_path):
    kinds = {"a": ("x", "y"), "b": ("u", "v")}
    (tmp_path / "rows.csv.gz").write_bytes(gzip.compress(b"a,b\nx,u\nx,v\ny,u\n"))  # is found, compressed or not
    assert Data(tmp_path).has("rows.csv") and len(Data(tmp_path).records("rows.csv", kinds, "a")) == 3
    with pytest.raises(ValueError) as caught:
        Data(tmp_path).records("rows.csv", kinds, "a", "b")
    assert str(caught.value).endswith("rows.csv.gz: it has no rows of a y, b v")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{}", "'a' is missing"),
        ('{"a": 1}', "a: 1 is not allowed; give values by name"),
        ('{"a": {"b": 0}}', "a.b: 0 is not allowed; give a whole number, at least 1"),
    ],
)
def test_numbers_of_a_summary_that_are_none_are_told(tmp_path, text, message):
    (tmp_path / "summary.json").write_text(text)
    with pytest.raises(ValueError) as caught:
        Data(tmp_path).count("a", "b")
    assert "summary.json: " in str(caught.value) and str(caught.value).endswith(message)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["tasks", "--from-data", "none"], "from-data: none is no folder"),
        (["tasks", "--from-data", str(DATA), "--jobs", "2"], "jobs: 2 is not allowed with --from-data"),
        (["tasks", "--from-data", str(DATA), "--budget", "full"], "budget: full is not allowed with --from-data"),
    ],
)
def test_bad_input_is_told(tmp_path, monkeypatch, capsys, options, message):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["reproduce", *options, "--out", "out"]) == 2
    assert message in capsys.readouterr().err
    assert not Path("out").exists()


@pytest.mark.parametrize(
    ("left_out", "message"),
    [
        ("hill_*", "it has no part on the hill (hill_PRESSURE_ORIENTATION), so there is no metric"),
        ("hill_6000_*", "its part hill_6000_0 is missing"),
    ],
)
def test_data_of_which_nothing_can_be_told_say_what_is_missing(tmp_path, capsys, left_out, message):
    study, out = "soft-robot-metrics", tmp_path / "out"
    shutil.copytree(DATA / study, tmp_path / study, ignore=shutil.ignore_patterns(left_out))
    assert cli.main(["reproduce", study, "--from-data", str(tmp_path), "--out", str(out)]) == 2
    assert capsys.readouterr().err.endswith(f"{study}: {message}\n") and not out.exists()


def told_without(column, tmp_path, capsys):
    """What is said of the data of the hunt's program where a table lacks a column."""
    folder = tmp_path / "gait-climb"
    shutil.copytree(DATA / "gait-climb", folder)
    for path in folder.glob("*.csv"):
        header, *rows = list(csv.reader(path.read_text().splitlines()))
        kept = [place for place, name in enumerate(header) if name != column]
        write_table(path, [header[n] for n in kept], [[row[n] for n in kept] for row in rows])
    assert cli.main(["reproduce", "gait-climb", "--from-data", str(folder), "--out", str(tmp_path / "out")]) == 2
    assert not (tmp_path / "out").exists()
    return capsys.readouterr().err


@pytest.mark.parametrize(
    "column", ["evaluations", "robot_steps", "found_by", "speed", "pressure", "terrains", "speeds"]
)
def test_a_column_that_is_missing_is_told(column, tmp_path, capsys):
    assert told_without(column, tmp_path, capsys).endswith(f".csv: it has no column {column}\n")


def test_what_was_begun_goes_where_a_table_is_refused(tmp_path, capsys, monkeypatch):
    """So that the next try is not refused for what the first left."""
    monkeypatch.setattr("optim.studies.chapter2.study._draw", lambda *_: None)  # others look at its pictures
    folder = tmp_path / "interference"
    shutil.copytree(DATA / "interference/gradient", folder / "gradient")
    (folder / "alone.csv").write_text("robot\n")
    order = ["reproduce", "interference", "--from-data", str(tmp_path), "--out", str(tmp_path / "out")]
    assert cli.main(order) == 2
    assert "alone.csv" in capsys.readouterr().err and not (tmp_path / "out").exists()
    shutil.copy(DATA / "interference/alone.csv", folder / "alone.csv")
    assert cli.main(order) == 0


def test_a_folder_that_holds_something_stays(tmp_path, capsys):
    (tmp_path / "kept").write_text("kept")
    assert cli.main(["reproduce", "tasks", "--from-data", str(DATA), "--out", str(tmp_path)]) == 2
    assert "exists and is not empty" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]


def test_a_summary_without_settings_is_told(tmp_path, capsys):
    folder = tmp_path / "light-seeking"
    folder.mkdir()
    settings = json.loads((DATA / "light-seeking/summary.json").read_text())["settings"]
    (folder / "runs.csv").write_text((DATA / "light-seeking/runs.csv").read_text())
    for text, message in (
        ('{"searches": 1}', "summary.json: 'settings' is missing"),
        ('{"settings": {}}', "summary.json: settings: seconds is missing"),
        ('{"settings": {"wind": 1}}', "summary.json: settings: wind is none of seconds, seeds"),
        (json.dumps({"settings": settings | {"reach": -1}}), "summary.json: reach: -1"),
    ):
        (folder / "summary.json").write_text(text)
        assert cli.main(["reproduce", "light-seeking", "--from-data", str(tmp_path), "--out", str(tmp_path / "o")]) == 2
        assert message in capsys.readouterr().err
