"""How two editions are compared bit for bit; without physics."""

import importlib
import json
import sys
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parents[1] / "benchmarks/same_bits"
OLD = {
    "positions": np.array([-1.0, 0.5, 1.0, 0.0, 1.5, 2.0]),
    "steps": np.arange(3),
    "status": np.array(["ok", "diverged"]),
}


@pytest.fixture(scope="module")
def modules():
    """The comparison, and the list of cases."""
    sys.path.insert(0, str(FOLDER))
    try:
        importlib.import_module("probe").load_cases()
        yield {name: importlib.import_module(name) for name in ("comparison", "cases", "places")}
    finally:
        sys.path.remove(str(FOLDER))


def moved(name, place, value):
    """The arrays with one number changed."""
    array = OLD[name].copy()
    array[place] = value
    return {**OLD, name: array}


def judge(modules, new, bound=None, case="lattice/bar"):
    accepted = {} if bound is None else {case: modules["comparison"].Accepted(bound, "the law of springs was joined")}
    return modules["comparison"].judge("lattice/bar", OLD, new, accepted)


def test_equal_arrays_pass(modules):
    assert judge(modules, {name: array.copy() for name, array in OLD.items()}).ok


def test_a_flipped_bit_fails_and_names_the_array(modules):
    new = moved("positions", 5, np.nextafter(2.0, 3.0))
    verdict = judge(modules, new)
    assert not verdict.ok and "1 of 3 arrays differ, first positions: relative 2.22e-16" in verdict.text


def test_an_accepted_deviation_within_its_bound_passes_and_above_fails(modules):
    new = moved("positions", 0, -1.0 + 3e-13)
    assert judge(modules, new, 1e-12).ok and judge(modules, new, 1e-12, "lattice/*").ok
    above, other = judge(modules, new, 1e-13), judge(modules, new, 1e-12, "gaits/*")
    assert not above.ok and "DIFFERS by more than 1e-13 (the law of springs was joined)" in above.text
    assert not other.ok


def test_a_bound_may_be_that_of_one_array_or_in_its_unit(modules):
    new = {**moved("positions", 0, -1.0 + 3e-13), "steps": np.arange(3)}
    assert judge(modules, new, 1e-12, "lattice/bar:pos*").ok
    assert not judge(modules, new, 1e-12, "lattice/bar:steps").ok
    accepted = {"lattice/*": modules["comparison"].Accepted(0.0, "at rest", absolute=1e-12)}
    assert modules["comparison"].judge("lattice/bar", OLD, new, accepted).ok


@pytest.mark.parametrize(
    ("new", "told"),
    [
        (moved("positions", 3, -0.0), "differs in the signs of zeros"),
        (moved("positions", 3, np.nan), "1 of 6 numbers are finite in one tree only"),
        (moved("steps", 1, 7), "steps: 1 of 3 values differ"),
        (moved("status", 1, "ok"), "status: 1 of 2 values differ"),
        ({**OLD, "steps": OLD["steps"][:2]}, r"steps: shape (2,) instead of (3,)"),
        ({**OLD, "positions": OLD["positions"].astype(np.float32)}, "positions: float32 instead of float64"),
        ({"positions": OLD["positions"], "steps": OLD["steps"]}, "status: only in the old tree"),
        ({**OLD, "speed": np.zeros(2)}, "speed: only in the new tree"),
    ],
)
def test_other_differences_are_told_in_words(modules, new, told):
    verdict = judge(modules, new)
    assert not verdict.ok and told in verdict.text


def test_nan_in_both_is_no_difference(modules):
    nan = {"distance": np.array([np.nan, 1.0])}
    assert not modules["comparison"].differences(nan, {"distance": nan["distance"].copy()})


def test_the_table_of_accepted_deviations_says_bound_and_why(modules, tmp_path):
    read = modules["comparison"].read_accepted
    assert all(modules["cases"].chosen([pattern.split(":")[0]], False) for pattern in read(FOLDER / "accepted.json"))
    for entry, told in (({"bound": 1e-12}, "give a bound and why"), ({"bound": 1e-12, "why": " "}, "say why")):
        (tmp_path / "table.json").write_text(json.dumps({"lattice/bar": entry}))
        with pytest.raises(ValueError, match=told):
            read(tmp_path / "table.json")


def test_cases_are_chosen_by_name_group_or_pattern(modules):
    chosen = modules["cases"].chosen
    assert chosen(["lattice/floor_slip"], False) == ["lattice/floor_slip"]
    assert set(chosen(["rigid"], False)) == set(chosen(["rigid/*"], False))
    assert 0 < len(chosen([], True)) < len(chosen([], False))
    with pytest.raises(ValueError, match="only: 'lattice/bar' is no case"):
        chosen(["lattice/bar"], False)


def test_every_name_that_cases_need_is_found_in_this_tree(modules, monkeypatch):
    places = modules["places"]
    monkeypatch.setattr(sys, "meta_path", places.without_editable())
    for name in places.PLACES:
        assert getattr(places, name) is not None
    with pytest.raises(AttributeError):
        _ = places.Nothing
