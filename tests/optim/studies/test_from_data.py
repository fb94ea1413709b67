"""Studies told again from their committed data: the same tables and numbers, and nothing is run."""

import gzip
import json
from pathlib import Path

import pytest

from optim import cli
from optim.experiments.data import Data
from optim.studies.catalogue import STUDIES

DATA = Path(__file__).parents[3] / "docs/data"
# No data, or too little of it.
NOT_THERE = ("evolving-bodies", "pouches-and-learning", "slope-sweep", "hand-gait-sensitivity", "soft-robot-metrics")
TOLD = [name for name in STUDIES if STUDIES[name].tell is not None and name not in NOT_THERE]


def close(one, other):
    """Whether two documents of JSON are equal, numbers within rounding."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(close(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(close, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return one == pytest.approx(other, rel=1e-9, abs=1e-12, nan_ok=True)
    return one == other


@pytest.mark.parametrize("name", TOLD)
def test_the_committed_tables_come_out_of_the_committed_data(name, tmp_path, capsys):
    assert cli.main(["reproduce", name, "--from-data", str(DATA), "--out", str(tmp_path / "out"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    made = sorted(path for path in (tmp_path / "out").rglob("*") if path.is_file())
    names = [path.relative_to(tmp_path / "out").as_posix() for path in made]
    assert names and document["files"] == sorted(names)
    for path, name in zip(made, names, strict=True):
        committed = Data(Path(document["data"])).path(name)
        if committed.exists() and path.suffix == ".json":
            assert close(json.loads(path.read_text()), json.loads(committed.read_text())), name
        elif committed.exists() and path.suffix in (".md", ".csv"):
            content = committed.read_bytes()
            assert path.read_bytes() == (gzip.decompress(content) if committed.suffix == ".gz" else content), name


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n", "rows.csv: it has no rows"),
        ("a\n1\n", "rows.csv: it has no column b"),
        ("a,b\n1,x\nz,x\n", "rows.csv: row 2 has 'z' as a; it must be a whole number"),
        ("a,b\n1.5,x\n", "rows.csv: row 1 has 1.5 as a; it must be a whole number"),
        ("a,b\nTrue,x\n", "rows.csv: row 1 has True as a; it must be a whole number"),
        ("a,b\n1,z\n", "rows.csv: row 1 has 'z' as b; allowed are x, y"),
        ("a,b\n,x\n", "rows.csv: row 1 has None as a; it must be a whole number"),
    ],
)
def test_cells_of_another_kind_are_told(tmp_path, text, message):
    (tmp_path / "rows.csv").write_text(text)
    with pytest.raises(ValueError) as caught:
        Data(tmp_path).records("rows.csv", {"a": int, "b": ("x", "y")})
    assert str(caught.value).endswith(message)


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
        (["shape-change", "--from-data", str(DATA)], "from-data: study shape-change is not told from tables; "),
    ],
)
def test_bad_input_is_told(tmp_path, monkeypatch, capsys, options, message):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["reproduce", *options, "--out", "out"]) == 2
    assert message in capsys.readouterr().err
    assert not Path("out").exists()


def test_data_of_which_nothing_can_be_told_say_what_is_missing(tmp_path, capsys):
    out = tmp_path / "out"
    assert cli.main(["reproduce", "soft-robot-metrics", "--from-data", str(DATA), "--out", str(out)]) == 2
    message = "soft-robot-metrics: it has no part on the hill (hill_PRESSURE_ORIENTATION), so there is no metric"
    assert capsys.readouterr().err.endswith(f"{message}\n") and not out.exists()


def test_a_folder_that_holds_something_stays(tmp_path, capsys):
    (tmp_path / "kept").write_text("kept")
    assert cli.main(["reproduce", "tasks", "--from-data", str(DATA), "--out", str(tmp_path)]) == 2
    assert "exists and is not empty" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]


def test_a_summary_without_settings_is_told(tmp_path, capsys):
    folder = tmp_path / "light-seeking"
    folder.mkdir()
    (folder / "runs.csv").write_text((DATA / "light-seeking/runs.csv").read_text())
    for text, message in (
        ('{"searches": 1}', "summary.json: 'settings' is missing"),
        ('{"settings": {"wind": 1}}', "summary.json: settings: wind is none of seconds, seeds"),
        ('{"settings": {"reach": -1}}', "summary.json: reach: -1"),
    ):
        (folder / "summary.json").write_text(text)
        assert cli.main(["reproduce", "light-seeking", "--from-data", str(tmp_path), "--out", str(tmp_path / "o")]) == 2
        assert message in capsys.readouterr().err
