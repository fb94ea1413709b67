"""How Taichi is started, and what its kernels say about errors in them."""

import subprocess
import sys

import numpy as np
import pytest

from taichi_sim import runtime
from taichi_sim.runtime import ti

NAME_ERROR = ti.TaichiNameError if runtime.COMPILER == "taichi" else ti.QuadrantsNameError

pytestmark = pytest.mark.kernels


def test_an_error_in_a_kernel_names_its_line():
    runtime.start("cpu", "f64", 1)

    @ti.kernel
    def wrong() -> ti.i32:
        return absent  # noqa: F821

    with pytest.raises(NAME_ERROR, match=r'(?s)test_runtime.py", line \d+, in wrong:.*absent'):
        wrong()


# Other code starts Taichi before, between and after, with settings under which kernels give other numbers, or none.
BESIDE_OTHER_CODE = """
import numpy as np
from taichi_sim.runtime import ti
from taichi_sim.signals import warping_distances

ti.init(arch=ti.cpu, log_level=ti.CRITICAL)
signals = np.random.default_rng(0).standard_normal((2, 3, 20))
found = []
for settings in ({}, {"advanced_optimization": False}, {"default_fp": ti.f64, "fast_math": True}, None):
    found.append(warping_distances(*signals, precision="f64", threads=1))
    ti.reset() if settings is None else ti.init(arch=ti.cpu, log_level=ti.CRITICAL, **settings)
    if settings is not None:
        field = ti.field(ti.i32, shape=3)
        field.fill(7)
        assert field.to_numpy().tolist() == [7, 7, 7]
found.append(warping_distances(*signals, precision="f64", threads=1))
print(all(np.array_equal(found[0], each) for each in found))
"""


def test_code_that_starts_taichi_beside_changes_no_number():
    command = [sys.executable, "-c", BESIDE_OTHER_CODE]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[-1] == "True"


def test_arrays_of_a_device_that_other_code_ended_are_not_taken_along():
    compute = runtime.start("cpu", "f64", 1)
    array = runtime.device_array(ti.f64, (3,))
    ti.init(arch=ti.cpu, log_level=ti.CRITICAL)
    assert runtime.start(compute) == compute and array.arr is None
    again = runtime.device_array(ti.f64, (3,))
    runtime.start("cpu", "f32", 1), runtime.start(compute)
    assert np.array_equal(again.to_numpy(), np.zeros(3))
