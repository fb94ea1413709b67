"""Progress of long work in pipes and notebooks."""

import io
import sys
from types import SimpleNamespace

import pytest
from rich.console import Console

from optim import progress


def test_in_a_pipe_there_is_a_line_now_and_then():
    """Ever more seldom, with the time left by the pace since the line before; a new text is a line at once."""
    now, told = [0.0], io.StringIO()
    with progress._lines("work", 200.0, Console(file=told), lambda: now[0]) as update:
        now[0] = 5.0  # what was compiled does not count in the pace
        update(0.0)
        for done in range(1, 101):
            now[0] = 5.0 + done
            update(float(done))
        update(150.0, "other work")
    lines = told.getvalue().splitlines()
    assert lines[0] == "work: 2% after 10 s, about 195 s left".replace("195 s", "3 min")
    assert lines[-1] == "other work" and 4 <= len(lines) <= 6
    assert lines[-2].startswith("work: ") and "after" in lines[-2]


def test_what_resumed_work_has_kept_says_nothing_of_its_pace():
    """Of 100 parts 40 were there at once, then a part takes ten seconds: ten minutes are left, not seconds."""
    now, told = [0.0], io.StringIO()
    with progress._lines("study", 100.0, Console(file=told), lambda: now[0]) as update:
        update(0.0)
        for part in range(1, 41):
            now[0] = 0.01 * part
            update(float(part))
        for part in range(41, 47):
            now[0] = 10.0 * (part - 40) + 0.4
            update(float(part))
    lines = told.getvalue().splitlines()
    assert lines[0] == "study: 41% after 10 s"  # it may have been what was compiled first
    assert lines[1] == "study: 43% after 30 s, about 10 min left"


def test_a_pause_in_which_kernels_are_compiled_says_nothing_of_the_pace():
    """A step of a thousandth takes 15 s, then they take a tenth of a second each: not hours are left."""
    now, told = [0.0], io.StringIO()
    with progress._lines("search", 1.0, Console(file=told), lambda: now[0]) as update:
        for time, share in ((0.1, 0.0), (2.5, 0.25), (17.5, 0.251)):
            now[0] = time
            update(share)
        for step in range(1, 180):
            now[0] = 17.5 + 0.1 * step
            update(0.251 + 0.001 * step)
    first, second = told.getvalue().splitlines()
    assert first.endswith("25% after 18 s")  # too little beside the pause to tell
    assert second.endswith("40% after 32 s, about 26 s left")


def test_jobs_that_end_together_say_how_long_the_others_take():
    """Of 100 jobs two at a time end at once, every 90 s: the ends beside each other say nothing of the pace."""
    now, told = [0.0], io.StringIO()
    with progress._lines("jobs", 100.0, Console(file=told), lambda: now[0]) as update:
        update(0.0)
        for job in range(30):
            now[0] = 90.0 * (job // 2 + 1) + 0.01 * (job % 2)
            update(job + 1.0)
    last = told.getvalue().splitlines()[-1]
    assert last.startswith("jobs: 29% after 22 min, about ") and 49 <= int(last.split()[-3]) <= 53


@pytest.mark.parametrize(("seconds", "told"), [(42.4, "42 s"), (420.0, "7 min"), (12600.0, "3.5 h")])
def test_spans_of_time(seconds, told):
    assert progress.span(seconds) == told


def test_in_a_notebook_there_is_a_bar_that_goes_away(monkeypatch):
    shown = []
    handle = SimpleNamespace(update=lambda data, raw: shown.append(data["text/html"]))
    display = SimpleNamespace(display=lambda data, raw, display_id: handle)
    notebook = SimpleNamespace(get_ipython=None, display=display)
    for name, module in (("ipykernel", notebook), ("IPython", notebook), ("IPython.display", display)):
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(progress, "PAUSE_OF_A_BAR", -1.0)
    with progress.shown_progress("a < b", 4.0) as update:
        update(1.0)
    assert len(shown) == 2 and shown[1] == ""
    assert 'value="0.2500"' in shown[0] and "25%, 0 s: a &lt; b" in shown[0]
