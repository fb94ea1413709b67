"""Kernels that take their arguments in bundles."""

from typing import Any, NamedTuple

import numpy as np
import pytest

from taichi_sim import runtime
from taichi_sim.autodiff.lanes import Real
from taichi_sim.bundling import kernel_of
from taichi_sim.runtime import ti


class Sums(NamedTuple):
    total: Any
    terms: Any = None
    twice: bool = False


@ti.func
def add(sums: ti.template(), count: ti.template()):
    for i in range(count):
        if ti.static(sums.twice):
            sums.total[i] += sums.terms[i]
        sums.total[i] += sums.terms[i]


@pytest.mark.kernels
@pytest.mark.parametrize("twice", [False, True])
def test_bundles_have_arrays_and_constants(twice):
    """A kernel takes of a named tuple what its types have, and its constants from there."""
    runtime.start("cpu", "f64", 1)
    flat = Real("f64", 1).scalars(1)
    total = np.zeros(3)
    kernel_of(add, Sums(flat, flat, twice), ti.i32)(Sums(total, np.ones(3)), 2)
    assert total.tolist() == ([2, 2, 0] if twice else [1, 1, 0])
