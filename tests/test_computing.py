"""Which process runs which tests, so that few compile the same kernels."""

import pytest
from computing import ROOT, kernels_of, next_scope, place

LATTICE, SINGLE, RIGID = ("lattice", "f64"), ("lattice", "f32"), ("rigid", "f64")
WAITING = {"none": None, "b": LATTICE, "c": RIGID, "d": LATTICE, "e": SINGLE, "f": RIGID, "g": LATTICE}


@pytest.mark.parametrize(
    ("last", "of_others", "found"),
    [
        (RIGID, {LATTICE}, "c"),  # its own
        (None, set(), "b"),  # the first that nobody has
        (None, {LATTICE}, "c"),
        (("vehicle", "f32"), {LATTICE, RIGID}, "e"),
        (None, {LATTICE, RIGID, SINGLE}, "none"),  # what needs no kernels
    ],
)
def test_a_process_stays_with_its_kernels_and_leaves_others_theirs(last, of_others, found):
    assert next_scope(WAITING, last, of_others) == found


def test_at_the_end_a_process_helps_where_most_is_left():
    left = {name: kind for name, kind in WAITING.items() if kind is not None}
    assert next_scope(left, None, {LATTICE, RIGID, SINGLE}) == "b"
    assert next_scope({"f": RIGID, "e": SINGLE}, None, {RIGID, SINGLE}) == "f"


def test_kernels_are_told_of_files_and_names():
    folder = "tests/taichi_sim/rigid"
    assert (ROOT / folder / "test_rigid_batch.py").exists()
    assert kernels_of(f"{folder}/test_rigid_batch.py::test_any[f32]") == ("rigid", "f32")
    assert kernels_of("tests/taichi_sim/lattice/test_shore.py::test_any") == LATTICE
    assert kernels_of("tests/optim/test_wording.py::test_any") is None
    assert place("tests/optim/test_wording.py::test_any[f32-f64]") == ("double", False)
