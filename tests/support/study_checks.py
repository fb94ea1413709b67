"""What tests of studies share: files that are written again, and tables whose runs are gone."""

import shutil

import pytest

from optim.experiments.data import Data


def check_rewritten(rewrite, folder, again, names=("summary.json", "table.md")):
    """A study's folder gives the same bytes again in another one, which is new."""
    again.mkdir()
    rewrite(Data(folder), again)
    for name in names:
        assert (again / name).read_bytes() == (folder / name).read_bytes()


def check_runs_needed(study, folder, settings):
    """A study refuses a folder whose tables have lost their runs, which are removed."""
    shutil.rmtree(folder / "runs")
    with pytest.raises(ValueError, match=r"^out: .* holds tables without their runs; name a new folder, or give it to"):
        study(folder, settings)
