"""The page on gaits in MuJoCo tells what its data say, and its script measures."""

import runpy
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SCRIPT = ROOT / "benchmarks/in_mujoco.py"


def test_the_page_has_the_table_of_the_data():
    told = subprocess.run(
        [sys.executable, SCRIPT, "--from", ROOT / "docs/data/in-mujoco.csv"], capture_output=True, text=True, check=True
    )
    assert told.stdout.count("\n") == 26 and told.stdout in (ROOT / "docs/in-mujoco.md").read_text()


@pytest.mark.slow
@pytest.mark.kernels
@pytest.mark.filterwarnings("ignore:model. ignored")
def test_gaits_are_tried_here_and_there():
    script = runpy.run_path(str(SCRIPT))
    rows = script["measured"](2, 1, 1)
    assert len(rows) == 2 * 2 * (2 + 1 + 1) * 2 and list(rows[0]) == list(script["FIELDS"])
    assert all(isinstance(row[name], float) for row in rows for name in script["FIELDS"][5:])
