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


class Counted(tuple):
    """A bundle that counts how often it is looked into."""

    looks = 0

    def __getitem__(self, place):
        self.looks += 1
        return super().__getitem__(place)


def test_bundles_are_looked_at_again_only_if_they_are_others_or_nobody_kept_them(add):
    """The array and how often its number is added are in a bundle here, the number is not."""
    bundled = Relauncher(ti, add._kernel, [(0, 0), (1, None), (0, 1)])
    array, other = np.zeros(3), np.zeros(2)
    one, two = Counted((array, 2)), Counted((other, 3))
    kept = [bundled(one, 1.0), bundled(one, 2.0)]  # by Taichi itself; filling its block
    looks = one.looks
    for number in (3.0, 4.0):
        kept.append(bundled(one, number))
    assert one.looks == looks and array.tolist() == [20.0] * 3
    kept.append(bundled(two, 5.0))
    assert other.tolist() == [15.0] * 2
    bundled(one, 6.0)
    assert one.looks > looks and array.tolist() == [32.0] * 3
    looks = one.looks
    bundled(one, 7.0)  # nobody kept what the last call returned
    assert one.looks > looks and array.tolist() == [46.0] * 3


def test_a_call_that_fails_midway_leaves_nothing_half_set(add):
    bundled = Relauncher(ti, add._kernel, [(0, 0), (1, None), (0, 1)])
    one, wrong = (np.zeros(3), 2), (np.ones(3), "twice")
    kept = [bundled(one, 1.0), bundled(one, 1.0)]
    with pytest.raises(ValueError, match="twice"):
        bundled(wrong, 1.0)
    kept.append(bundled(one, 1.0))
    assert one[0].tolist() == [6.0] * 3 and wrong[0].tolist() == [1.0] * 3


def test_zeros_of_both_signs_are_two_numbers():
    @ti.kernel
    def keep(array: ti.types.ndarray(ti.f64, 1), number: ti.f64):
        for i in range(array.shape[0]):
            array[i] = number

    launch, array = Relauncher(ti, keep), np.ones(1)
    for number in (1.0, 0.0, -0.0):
        launch(array, number)
    assert np.signbit(array[0])
