import numpy as np
import pytest

from optim.wording import cell_value, spoken_duration, spoken_size
from taichi_sim.base.short_text import counted


@pytest.mark.parametrize(("count", "told"), [(0, "0 bodies"), (1, "1 body"), (2, "2 bodies")])
def test_one_is_told_in_the_singular(count, told):
    assert counted(count, "body", "bodies") == told
    assert counted(count, "run") == told.replace("bodies", "runs").replace("body", "run")


@pytest.mark.parametrize(
    ("size", "told"),
    [(12, "1 kB"), (34_499, "34 kB"), (999_499, "999 kB"), (999_500, "1.0 MB"), (6_700_000, "6.7 MB")],
)
def test_sizes_are_told_in_units_that_fit(size, told):
    assert spoken_size(size) == told


@pytest.mark.parametrize(
    ("seconds", "told"),
    [(0.0221, "0.022 s"), (1.4, "1.4 s"), (3, "3 s"), (100, "2 min"), (9000, "2.5 h"), (864000, "10 d")],
)
def test_durations_are_told_in_units_that_fit(seconds, told):
    assert spoken_duration(seconds) == told


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (1.23456789, "1.2346"),
        (np.float32(0.5), "0.5"),
        (np.int64(123456789), "123456789"),
        (True, "True"),
        ("ok", "ok"),
    ],
)
def test_decimals_of_cells_are_short(value, told):
    assert cell_value(value) == told
