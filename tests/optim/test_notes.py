"""What commands tell obeys nobody's orders to the terminal, and is short."""

import io
import os
import sys
import warnings

import pytest

from optim.cli import main
from optim.notes import note, notes, plain, say
from optim.progress import shown_progress
from taichi_sim.base.foreign import users_code


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("\x1b[31mred", "\\x1b[31mred"),
        ("\x9b31m \x07 \x7f", "\\x9b31m \\x07 \\x7f"),
        ("gnp.\u202etxt", "gnp.\\u202etxt"),
        ("not UTF-8: \udcff", "not UTF-8: \\udcff"),
        ("12 µm ± 3 °, α → β\u00a0m\n\tnext", "12 µm ± 3 °, α → β\u00a0m\n\tnext"),
    ],
)
def test_what_terminals_obey_is_written_out(text, shown):
    assert plain(text) == shown


def test_a_line_has_neither_orders_nor_further_lines(capsys):
    say("view", "a\nb\x1b[2J")
    assert capsys.readouterr().err == "morpholab view: a b\\x1b[2J\n"


@pytest.mark.parametrize(
    "line",
    [
        "simulate --robot '\x1b[31mred.json'",
        "view rolling --out '\x1b[2Jno/a.html'",
        "view rolling '--\x1b[2J'",
        "simulate '\x1b[2J\nsecond'",
    ],
)
def test_names_in_refusals_are_written_out(morpholab, line):
    found, out, error = morpholab(line)
    assert (found, out) == (2, "") and "\\x1b[" in error and error.rstrip("\n").isprintable()


def test_names_in_results_are_written_out(morpholab, simulator, tmp_path):
    assert morpholab("export rolling --csv a.csv")[0] == 0
    (tmp_path / "a.csv").rename(tmp_path / "\x1b[31mred.csv")
    code, out, error = morpholab("simulate --gait '\x1b[31mred.csv'")
    assert code == 0 and "\\x1b[31mred.csv" in out and "\x1b" not in out + error


def test_names_in_notes_are_written_out(morpholab):
    code, _, error = morpholab("work '\x1b[31mnew' --idle 0")
    assert code == 0 and error == "morpholab work: note: \\x1b[31mnew is new; waiting for a search that is given it\n"


def test_a_note_is_that_of_the_command_that_runs(capsys):
    note("first")
    with notes("view"):
        note("second")
        with notes("worker"):
            warnings.warn("third", stacklevel=1)
        note("fourth")
    note("fifth")
    told = ["", "view", "worker", "view", ""]
    texts = ["first", "second", "third", "fourth", "fifth"]
    lines = [f"{f'morpholab {name}'.strip()}: note: {text}" for name, text in zip(told, texts, strict=True)]
    assert capsys.readouterr().err.splitlines() == lines


def test_names_in_progress_are_no_markup(capsys):
    with shown_progress("[/red] \x1b[2J", 1.0) as update:
        update(0.0, "[/red] \x1b[2J")
    assert capsys.readouterr().err == "[/red] \\x1b[2J\n"


def test_a_long_message_of_a_users_file_is_cut(morpholab, tmp_path):
    with (
        pytest.raises(ValueError, match=r"^own.py: KeyError: 'x{299}\.\.\. \(100002 characters\)$"),
        users_code("own.py"),
    ):
        raise KeyError("x" * 100_000)
    (tmp_path / "own.py").write_text("raise ValueError('x' * 100_000)")
    for line in ("simulate --robot own.py", "codesign --problem own.py --out a"):
        code, _, error = morpholab(line)
        assert code == 2 and "ValueError: xxx" in error and len(error) < 500


def test_a_caller_may_have_closed_its_streams(monkeypatch):
    for line in (["tasks"], ["--help"], ["--version"]):
        closed = io.StringIO()
        closed.close()
        monkeypatch.setattr("sys.stdout", closed)
        assert main(line) == 1
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(io.BytesIO()))
    sys.stdout.close()
    assert main(["tasks"]) == 1


def test_a_program_without_streams_keeps_its_descriptors(monkeypatch, capfd):
    monkeypatch.setattr("sys.stderr", None)
    assert main(["simulate", "--robot", "nope"]) == 2
    os.write(2, b"still here")
    assert capfd.readouterr().err == "still here"
