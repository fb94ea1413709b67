"""The table of what fuzzing gave to the readers, and its sums on the page."""

import subprocess
import sys
from types import SimpleNamespace

import fuzz
import fuzz_log
import fuzz_targets
import pytest


def row(reader, inputs, seconds, memory, failure=""):
    told = ("2026-11-27", "0123abcd", reader, inputs, seconds, memory, failure)
    return dict(zip(fuzz_log.COLUMNS, told, strict=True))


def test_the_page_has_the_sums_of_the_table():
    """Mended by ``python tests/fuzz/fuzz_log.py``."""
    page = fuzz_log.PAGE.read_text()
    assert fuzz_log.written(page, fuzz_log.read()) == page


def test_every_row_of_the_table_is_of_a_reader_and_whole():
    for each in fuzz_log.read():
        assert set(each) == set(fuzz_log.COLUMNS)
        assert each["reader"] in fuzz_targets.TARGETS
        assert float(each["memory_mb"]) < fuzz.MEMORY or each["failure"]
        assert each["failure"] in ("", "crash", "timeout", "memory")


def test_rows_are_added_to_what_is_there(tmp_path):
    table = tmp_path / "new/fuzzing.csv"
    first, second = row("vxa", "10", "1.5", "100"), row("stl", "", "", "90", "crash")
    fuzz_log.append(first, table)
    fuzz_log.append(second, table)
    assert fuzz_log.read(table) == [first, second]


def test_sums_are_by_reader_with_most_memory_and_failures():
    rows = [row("vxa", "1200", "90", "100"), row("stl", "", "24", "90", "timeout"), row("vxa", "34", "", "120")]
    assert fuzz_log.sums(rows).splitlines()[2:] == [
        "| all 2 | 1,234 | 114 s | 120 MB | 1 |",
        "| `stl` | 0 | 24 s | 90 MB | 1 |",
        "| `vxa` | 1,234 | 90 s | 120 MB | 0 |",
    ]


@pytest.mark.parametrize("page", ["", fuzz_log.BEGIN, fuzz_log.END + fuzz_log.BEGIN])
def test_a_page_without_its_marks_is_told(page):
    with pytest.raises(ValueError, match="once each, in this order"):
        fuzz_log.written(page, [])


@pytest.mark.parametrize(
    ("code", "said", "inputs", "failure"),
    [
        (0, "stat::number_of_executed_units: 512\n", "512", ""),
        (77, "AssertionError: \nstat::number_of_executed_units: 5\n", "5", "crash"),
        (70, "==1== ERROR: libFuzzer: timeout after 6 seconds\n", "", "timeout"),
        (77, "TimeoutError: it takes 6.1 s of CPU time, more than 5\n", "", "timeout"),
        (71, "==1== ERROR: libFuzzer: out-of-memory (used: 1003Mb; limit: 1000Mb)\n", "", "memory"),
        (-9, "", "", "crash"),
    ],
)
def test_what_a_target_ended_with_is_in_its_row(code, said, inputs, failure):
    made = fuzz.Outcome(code, said, 12.34, 170.6).row("vxa")
    assert (made["reader"], made["inputs"], made["failure"]) == ("vxa", inputs, failure)
    assert (made["cpu_s"], made["memory_mb"]) == ("12.3", "171")


def test_a_commit_is_dirty_where_what_is_fuzzed_differs(tmp_path):
    assert fuzz_log.commit(tmp_path) == "unknown"
    own = ["-c", "user.name=x", "-c", "user.email=x@example.org"]
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots/a.py").write_text("")
    for words in (["init", "-q"], ["add", "."], [*own, "commit", "-qm", "a"]):
        subprocess.run(["git", "-C", str(tmp_path), *words], check=True)
    named = fuzz_log.commit(tmp_path)
    assert len(named) == 8
    (tmp_path / "notes.md").write_text("rows of a table do not count")
    assert fuzz_log.commit(tmp_path) == named
    (tmp_path / "robots/a.py").write_text("a = 1\n")
    assert fuzz_log.commit(tmp_path) == f"{named}-dirty"


UNREAD = SimpleNamespace(TARGETS=("vxa", "stl", "rig"))  # targets that nothing reads


@pytest.mark.parametrize(("options", "logged"), [(["--seconds", "1"], True), (["--runs", "3"], False)])
def test_turns_by_time_are_logged_and_a_reader_that_failed_has_no_more(tmp_path, monkeypatch, options, logged):
    seeds = {}

    def fuzzed(targets, name, corpus, given):
        seeds.setdefault(name, []).append(given[-1])
        return fuzz.Outcome(77 if name == "stl" else 0, "stat::number_of_executed_units: 3", 1.0, 100.0)

    monkeypatch.setattr(fuzz, "instrumented_targets", lambda: UNREAD)
    monkeypatch.setattr(fuzz, "fuzz_apart", fuzzed)
    monkeypatch.setattr(fuzz_log, "TABLE", tmp_path / "fuzzing.csv")
    monkeypatch.setattr(fuzz_log, "write_page", lambda: seeds.setdefault("page", []).append(""))
    monkeypatch.setattr(sys, "argv", ["fuzz.py", *options, "--rounds", "2", "vxa", "stl"])
    assert fuzz.main() == 1
    assert len(set(seeds["vxa"])) == 2 and len(seeds["stl"]) == 1
    if logged:
        assert [each["reader"] for each in fuzz_log.read(tmp_path / "fuzzing.csv")] == ["vxa", "stl", "vxa"]
        assert len(seeds["page"]) == 3
    else:
        assert list(tmp_path.iterdir()) == [] and "page" not in seeds
        assert seeds["vxa"] == ["-seed=1", "-seed=2"]  # the same each time


def test_an_unknown_target_is_told_in_a_line(monkeypatch, capsys):
    monkeypatch.setattr(fuzz, "instrumented_targets", lambda: UNREAD)
    monkeypatch.setattr(sys, "argv", ["fuzz.py", "vxc"])
    with pytest.raises(SystemExit):
        fuzz.main()
    assert "unknown targets vxc; known are vxa, stl, rig" in capsys.readouterr().err
