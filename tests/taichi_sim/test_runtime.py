"""How Taichi is started, and what its kernels say about errors in them."""

import subprocess
import sys
import threading

import numpy as np
import pytest

from taichi_sim import runtime
from taichi_sim.autodiff.rotations import multiply
from taichi_sim.autodiff.tracing import primitive
from taichi_sim.lattice import LatticeBody, LatticeEngine, Material, ProgramBuilder
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


def falling(precision: str) -> LatticeEngine:
    rubber = Material(youngs_modulus=1e6, density=1e3)
    bar = LatticeBody([(x, 0, 0) for x in range(3)], (rubber,), [0] * 3, voxel_size=0.01)
    return LatticeEngine(bar, 1, gravity=9.80665, precision=precision, threads=1)


def test_engines_that_take_turns_and_call_each_other_run_as_they_were_made():
    """Each launches its kernels where they belong: in another runtime they have other numbers, or crash."""
    single, double = falling("f32"), falling("f64")
    program, running = ProgramBuilder(1).build(3000), []

    def look(fraction):
        running.append(runtime._running)

    def call(fraction):
        look(fraction)
        if len(running) == 1:
            single.run(program)

    for engine in (single, double, single, double):
        running.clear()
        engine.run(program, progress=look)
        assert running and set(running) == {engine.compute}
    running.clear()
    double.run(program, progress=call)
    assert len(running) > 1 and set(running) == {double.compute}
    running.clear()
    double.record(program, progress=call)
    assert set(running) == {double.compute}
    speeds = [engine.state().velocities[0, 0, 2] for engine in (single, double)]
    assert speeds == pytest.approx([speeds[0]] * 2, rel=1e-4) and speeds[0] < 0


def test_a_callback_that_starts_taichi_anew_changes_no_number():
    """It has other settings then, such as fast mathematics, under which the rest of the steps were computed."""
    program, found = ProgramBuilder(1).build(3000), []

    def start_anew(fraction):
        if not begun:
            ti.init(arch=ti.cpu, log_level=ti.CRITICAL)
        begun.append(fraction)

    for progress in (None, start_anew):
        engine, begun = falling("f32"), []
        engine.run(program, progress=progress)
        assert bool(begun) == bool(progress)
        begun.clear()
        tape = engine.record(program, progress=progress)
        found.append([engine.state().positions, engine.state().velocities, tape.result.positions])
    for plain, restarted in zip(*found, strict=True):
        assert np.array_equal(plain, restarted)


def test_a_callback_that_takes_a_device_from_its_simulation_is_told_of():
    @runtime.exclusive
    def simulate():
        runtime.start("cpu", "f64", 1)
        array = runtime.device_array(ti.f64, (3,))
        ti.init(arch=ti.cpu, log_level=ti.CRITICAL)
        runtime.go_on()
        return array

    with pytest.raises(RuntimeError, match=r"^a callback of the simulation restarted Taichi: its arrays are lost"):
        simulate()


def test_a_call_in_a_callback_that_failed_changes_nothing():
    double = falling("f64")

    def fail(fraction):
        seen.append(runtime._running)
        with pytest.raises(ValueError, match="is not available"):
            LatticeEngine(double.body, 1, device="cuda" if not ti.lang.misc.is_arch_supported(ti.cuda) else "metal")

    seen = []
    double.run(ProgramBuilder(1).build(3000), progress=fail)
    assert len(seen) > 1 and set(seen) == {double.compute}


def test_other_threads_compute_in_numpy_while_a_kernel_is_compiled():
    """A law asks whether this thread compiles, not whether any does."""
    found, one = [], (1.0, 0.0, 0.0, 0.0)

    @primitive
    def meanwhile(x):
        other = threading.Thread(target=lambda: found.append((runtime.inside_kernel(), multiply(*one, *one))))
        other.start(), other.join()
        return 2.0 * x if runtime.inside_kernel() else x

    @ti.kernel
    def double(numbers: ti.types.ndarray(dtype=ti.f64, ndim=1)):
        for i in range(1):
            numbers[i] = meanwhile(numbers[i])

    @runtime.exclusive
    def launch(numbers):
        runtime.start("cpu", "f64", 1)
        double(numbers)
        return numbers

    assert launch(np.array([3.0])).tolist() == [6.0]
    assert not found[0][0] and found[0][1] == (1.0, 0.0, 0.0, 0.0)
