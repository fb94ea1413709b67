"""Weight manifolds in changed vehicles: their sizes, shifts and shares, by closed forms and a sweep."""

from dataclasses import replace

import numpy as np
import pytest

from optim.experiments.data import Data
from optim.experiments.tables import write_records
from optim.studies.chapter4 import reality_gap, weight_manifolds
from optim.studies.chapter4.perturbations import PERTURBATIONS
from optim.studies.chapter4.weight_manifolds import changes, compared, manifold, measure, rows_of, summary
from robots.braitenberg import Sweep, VehicleBody, sweep
from taichi_sim.base.results_folder import ResultsFolder

SHORT = Sweep(weights=9, radius=0.5, time_step=0.2, steps=2500)
BODY = VehicleBody.published(162)
KINDS = {p.name.split(" [")[0]: p for p in PERTURBATIONS}
GAIN = KINDS["gain of both motors"]


@pytest.mark.kernels
def test_a_manifold_is_what_a_sweep_finds():
    found = manifold(BODY, SHORT.task, 9, threads=1)
    overlap = sweep([BODY], 9, SHORT.radius, SHORT.time_step, SHORT.steps, threads=1)[0]
    assert found.any() and not found.all() and np.array_equal(found, overlap == 4)


@pytest.mark.kernels
def test_half_the_gain_is_half_the_weights():
    """So the manifold is that of the middle of the grid, at twice the weights."""
    before = manifold(BODY, SHORT.task, 9, threads=1)
    half = manifold(BODY, SHORT.task, 9, replace(GAIN, strength=0.5), threads=1)
    assert half[::2, ::2].any() and np.array_equal(half[::2, ::2], before[2:7, 2:7])


@pytest.mark.kernels
def test_all_controllers_of_a_manifold_are_tried_in_the_same_changed_vehicle():
    """Sensors of unequal sensitivity scale the weights of the grid: one factor for each weight."""
    seen = []

    def change(sites, controllers, task, rng, strength):
        found = kind.change(sites, controllers, task, rng, strength)
        seen.append((controllers, found[1]))
        return found

    kind = KINDS["sensitivity of sensors"]
    manifold(BODY, SHORT.task, 9, replace(kind, change=change), np.random.default_rng(1), threads=1)
    ((before, after),) = seen
    factors = after[before != 0] / before[before != 0]
    assert before.shape == after.shape == (1, 81, 2, 2) and len(np.unique(factors.round(12))) == 2


def test_sizes_shares_and_shift_of_two_squares():
    before, after = np.zeros((21, 21), bool), np.zeros((21, 21), bool)
    before[4:8, 4:8], after[7:13, 4:8] = True, True  # steps of 0.1
    assert compared(before, after) == (16, 24, 4, pytest.approx(0.4))
    *sizes, shift = compared(before, np.zeros_like(before))
    assert sizes == [16, 0, 0] and np.isnan(shift)


def told(kept, size, shift, before=100):
    """The arrays of a body in which every change does the same."""
    count = len(changes(2))
    numbers = {"before": before, "after": size, "both": kept}
    return {**{name: np.full(count, n) for name, n in numbers.items()}, "shift": np.full(count, float(shift))}


def test_what_is_told_of_manifolds():
    every, some, none = told(80, 120, 0.25), told(0, 0, np.nan), told(0, 7, np.nan, before=0)
    rows = [row for n, arrays in enumerate((every, some, none)) for row in rows_of(n, 2, arrays)]
    first, second, third = summary(rows).values()
    assert first["controllers"] == 100 and first["changes"] == len(changes(2)) == 42
    for what, mean in (("kept", 0.8), ("size", 1.2), ("shift", 0.25)):
        assert first[what] == pytest.approx({"mean": mean, "low": mean, "high": mean, "n": 7})
    assert second["kept"]["mean"] == second["size"]["mean"] == 0.0 and second["shift"] is None
    assert third == {"controllers": 0, "changes": 42}


def test_strengths_of_a_kind_count_alike_however_often_they_are_drawn():
    rows = rows_of(1, 2, told(100, 100, 0.0))
    for row in rows:
        row["both"] = 0 if row["strength"] == 0.8 else 100
    assert summary(rows)["1"]["kinds"][GAIN.name]["kept"] == pytest.approx(0.75)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"after": 82}, "after: 82 is not allowed; give whole numbers from 0 to 81"),
        ({"shift": np.inf}, "shift: .* is not allowed; give 0 to 3"),
    ],
)
def test_parts_that_cannot_be_are_measured_again(tmp_path, monkeypatch, changed, why):
    settings = reality_gap.RealityGap(manifold=9, manifold_draws=2)
    results = ResultsFolder(tmp_path, "reality-gap", settings.describe())
    possible = told(4, 5, 0.1, before=6)
    monkeypatch.setattr(weight_manifolds, "measure", lambda *_: possible)
    rows = reality_gap._manifolds(results, settings, None)
    assert len(rows) == 3 * len(changes(2))
    name = "manifold_9_2_162"
    broken = {key: value.copy() for key, value in possible.items()}
    for key, value in changed.items():
        broken[key].flat[-1] = value
    results.add(name, name.encode(), **broken)
    with pytest.warns(UserWarning, match=rf"{name}-.*: is damaged, and as good as missing \({why}"):
        assert reality_gap._manifolds(results, settings, None) == rows


def test_data_of_before_have_no_manifolds(tmp_path):
    """And are told as they were."""
    rows = [
        dict(zip(reality_gap.COLUMNS, (162, one.name, one.strength, w, 0.5, 1.0), strict=True))
        for one in PERTURBATIONS
        for w in (0.25, 0.5)
    ]
    for folder in ("old", "new"):
        (tmp_path / folder).mkdir()
        write_records(tmp_path / folder / reality_gap.TABLE, rows)
    write_records(tmp_path / "new" / weight_manifolds.TABLE, rows_of(162, 2, told(4, 5, 0.1, before=6)))
    found = {}
    for folder in ("old", "new"):
        (out := tmp_path / f"{folder}-out").mkdir()
        reality_gap.rewrite(Data(tmp_path / folder), out)
        found[folder] = Data(out).from_summary(dict)
    assert "manifolds" not in found["old"] and found["new"]["manifolds"]["162"]["kept"]["mean"] == pytest.approx(2 / 3)
    uneven = rows_of(162, 2, told(4, 5, 0.1, before=6))
    uneven[3]["before"] = 7
    write_records(tmp_path / "new" / weight_manifolds.TABLE, uneven)
    with pytest.raises(ValueError, match=r"manifolds.csv: design 162 has \[6, 7\] as before; it must be one number"):
        reality_gap.rewrite(Data(tmp_path / "new"), tmp_path / "new-out")


@pytest.mark.kernels
def test_measured_changes_are_those_of_the_study_and_come_again_with_their_seed():
    one, again = (measure(BODY, SHORT.task, 5, 1, seed, threads=1) for seed in (1, 1))
    assert all(np.array_equal(one[name], again[name], equal_nan=True) for name in one)
    assert {len(each) for each in one.values()} == {len(PERTURBATIONS)} and (one["both"] <= one["after"]).all()
