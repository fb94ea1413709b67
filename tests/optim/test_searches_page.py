"""The code in docs/searches.md runs, and finds what the page says."""

import re
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[2] / "docs/searches.md"


def test_the_code_of_the_page_runs(capsys):
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.S)
    names = {}
    for block in blocks:
        exec(block, names)
    assert capsys.readouterr().out.splitlines()[0] == "best score 100.0000 after 2460 evaluations: fuel 1, fins 0"
    assert names["front"].kind == "front" and len(names["front"].points) > 5
    best = names["maximise"](names["valley"], "gradient", rule="l-bfgs", climbers=4, generations=60).best
    assert best == pytest.approx({"x": 1, "y": 1}, abs=1e-2)
