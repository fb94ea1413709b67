"""Kernels that are launched again see the arrays and numbers of the call, whatever those of the last call were."""

import gc
import weakref

import numpy as np
import pytest

from taichi_sim import runtime
from taichi_sim.launching import Relauncher
from taichi_sim.runtime import ti

pytestmark = pytest.mark.kernels


@pytest.fixture
def add():
    """A kernel that adds a number to every element."""
    runtime.start("cpu", "f64", 1)

    @ti.kernel
    def kernel(array: ti.types.ndarray(ti.f64, 1), number: ti.f64, times: ti.i32):
        for i in range(array.shape[0]):
            array[i] += number * times

    return Relauncher(ti, kernel)


def test_arrays_and_numbers_may_change(add):
    first, second = np.zeros(3), np.zeros(5)
    for number, array in ((1.0, first), (2.0, first), (3.0, second), (4.0, first)):
        add(array, number, 2)
    assert first.tolist() == [14.0] * 3 and second.tolist() == [6.0] * 5


def test_arrays_that_are_not_contiguous_are_launched_as_usual(add):
    add(np.zeros(3), 1.0, 1)
    with pytest.raises(Exception, match="contiguous"):
        add(np.zeros(6)[::2], 1.0, 1)
    array = np.zeros(4)
    add(array, 1.0, 1)
    assert array.tolist() == [1.0] * 4


def test_arrays_of_a_device_may_change_and_meet_those_of_numpy(add):
    """As on a GPU, here on the CPU."""
    first, second = (runtime.device_array(ti.f64, (size,)) for size in (3, 5))
    plain = np.zeros(2)
    for number, array in ((1.0, first), (2.0, second), (3.0, plain), (4.0, first), (5.0, plain), (6.0, second)):
        add(array, number, 2)
    assert first.to_numpy().tolist() == [10.0] * 3 and second.to_numpy().tolist() == [16.0] * 5
    assert plain.tolist() == [16.0] * 2


def test_arrays_of_a_device_outlive_the_runtime(add):
    array = runtime.device_array(ti.f64, (3,))
    add(array, 1.0, 1)
    runtime.start("cpu", "f32", 1)
    other = runtime.device_array(ti.f32, (4,))
    assert array.arr is None
    runtime.start("cpu", "f64", 1)
    add(array, 2.0, 1)
    assert array.to_numpy().tolist() == [3.0] * 3 and other.arr is None


def test_the_runtime_may_begin_anew(add):
    array = np.zeros(3)
    add(array, 1.0, 1)
    runtime.start("cpu", "f32", 1)
    runtime.start("cpu", "f64", 1)
    add(array, 1.0, 1)
    assert array.tolist() == [2.0] * 3


def test_arrays_are_not_kept(add):
    array = np.zeros(3)
    gone = weakref.ref(array)
    for _ in range(2):
        add(array, 1.0, 1)
    del array
    gc.collect()
    assert gone() is None
