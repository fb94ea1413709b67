"""Kernels as a GPU runs them, or a Vulkan device in software; run by `make test-device`, and `DEVICE=cuda`.

In f64 a device agrees with the CPU to some units in the last place: the compiler of Vulkan reorders sums and products,
that of CUDA rounds a product and a sum once. In f32 both are as far from the f64 of the CPU as f32 itself is, and no
farther from each other.
"""

import os
import subprocess
import sys
from dataclasses import fields, replace

import numpy as np
import pytest
from feedback_scene import Linear, engine, scene, some_weights
from gradient_scene import TIME_STEP, Cost, body, program, repeated, start

from robots.braitenberg import STARTS
from robots.quadruped import LEGGED
from robots.quadruped import engine as quadruped_engine
from taichi_sim import runtime
from taichi_sim.autodiff import elementary
from taichi_sim.autodiff.lanes import Real
from taichi_sim.lattice import Decision, LatticeBody, LatticeEngine, LatticeProgram, Material, ProgramBuilder, Quantity
from taichi_sim.lattice.drivers.stepped_kernels import FEWEST_THREADS, threads_for
from taichi_sim.runtime import ti
from taichi_sim.signals import warping_distances
from taichi_sim.vehicle import VehicleBatch, VehicleTask, differentiate, rollout, trace

pytestmark = [pytest.mark.kernels, pytest.mark.device]

DEVICE = os.environ.get("MORPHOLAB_TEST_DEVICE") or "vulkan"

PRECISIONS = pytest.mark.parametrize("precision", ["f32", "f64"])
# Of the largest number of its kind. Rounding is 6e-8 and 1e-16; hundreds of steps and their reverse make more of it.
NEAR = {"f32": 2e-4, "f64": 1e-12}  # spins of voxels that slide differ by 1.1e-4 in f32, on a CPU, too
NEAR_BY_MATERIAL = {"f32": 1e-3, "f64": 1e-12}  # sums over all voxels and steps, which cancel, on a CPU too


def apart(found, expected):
    """The largest difference, in units of the largest number."""
    assert np.shape(found) == np.shape(expected) and np.isfinite(found).all()
    return np.abs(np.subtract(found, expected)).max(initial=0) / (np.abs(expected).max(initial=0) or 1)


def numbers(result):
    """All arrays of real numbers of a result, by name."""
    every = {each.name: getattr(result, each.name) for each in fields(result)}
    every |= every.pop("materials", {})
    return {name: array for name, array in every.items() if np.asarray(array).dtype.kind == "f"}


def all_apart(found, expected):
    """The same for all arrays of two results, by name."""
    found, expected = numbers(found), numbers(expected)
    assert found.keys() == expected.keys()
    return {name: apart(found[name], expected[name]) for name in expected}


def on(device, precision):
    return {"device": device, "precision": precision, "threads": 1}


@PRECISIONS
def test_elementary_functions_are_exact_to_rounding(precision):
    """The optimiser of SPIR-V makes x of (x + c) - c, which rounds elsewhere."""
    real = Real(precision, 1)
    reals = ti.types.ndarray(dtype=real.type, ndim=1)

    @ti.kernel
    def kernel(given: reals, sines: reals, cosines: reals, tangents: reals):
        for i in given:
            sines[i], cosines[i] = elementary.sine_cosine(given[i])
            tangents[i] = elementary.hyperbolic_tangent(given[i])

    runtime.start(**{"compute": DEVICE, "precision": precision, "threads": 1})
    given = np.random.default_rng(1).uniform(-100, 100, 3000).astype(real.numpy)
    found = np.zeros((3, len(given)), real.numpy)
    kernel(given, *found)
    exact = given.astype(float)
    expected = [np.sin(exact), np.cos(exact), np.tanh(exact)]
    assert np.abs(found - expected).max() < {"f32": 3e-7, "f64": 1e-15}[precision]


@PRECISIONS
@pytest.mark.parametrize("kind", [(False, False), (True, True)], ids=["plain", "poisson in a fluid"])
def test_a_lattice_and_its_gradient(kind, precision):
    """Contacts, friction, large angles, pressure, events: 200 steps in which all of it happens, and their reverse."""
    shape = body(*kind)
    cost = Cost(shape, 3, sizes=True)

    def run(device, precision):
        lab = LatticeEngine(
            shape, 1, time_step=TIME_STEP, floor=True, fluid=kind[1], driver="stepped", **on(device, precision)
        )
        lab.set_state(repeated(start(shape), 1))
        tape = lab.record(program())
        assert (tape.result.status == "ok").all()
        return lab.state(), cost.pull_back(tape)

    (truth, slopes), (state, gradient) = run("cpu", "f64"), run(DEVICE, precision)
    assert max(all_apart(state, truth).values()) < NEAR[precision]
    for name, far in all_apart(gradient, slopes).items():
        assert far < (NEAR_BY_MATERIAL if name in slopes.materials else NEAR)[precision], name


@PRECISIONS
def test_decisions_in_the_loop_and_derivatives_through_them(precision):
    """Only the snapshot that a decision feels travels, and only what it owes to that comes back."""

    def run(device, precision):
        program, decisions = scene(2)
        feedback = Linear(some_weights(2), decisions)
        lab = engine(2, driver="stepped", **on(device, precision))
        tape = lab.record(program, feedback=feedback)
        gradient = Cost(body(), 8).pull_back(tape)
        return tape.result, gradient, feedback.slopes

    (truth, slopes, by_weights), (result, gradient, found) = run("cpu", "f64"), run(DEVICE, precision)
    assert apart(result.positions, truth.positions) < NEAR[precision]
    assert apart(found, by_weights) < NEAR_BY_MATERIAL[precision]
    assert apart(gradient.positions, slopes.positions) < NEAR_BY_MATERIAL[precision]


class Swelling:
    """Decides that voxels swell to 2.4 edges, at which they touch where no list would have them."""

    decisions = (Decision(50, 0, np.arange(3)),)

    def decide(self, number, felt):
        return np.full(3, 2.4), np.zeros(3)


@PRECISIONS
def test_lists_are_made_anew_where_a_decision_lets_voxels_grow(precision):
    """The memory that tells of it is on the device."""
    shape = LatticeBody([[0, 0, 0], [40, 0, 0]], (Material(1e5, 1e3),), [0, 0], 0.01)
    made = ProgramBuilder(1)
    for axis in range(3):
        made.set(Quantity.SCALE + axis, 1.0, step=100, regions=[0])
    plain = made.build(1500)
    read = LatticeProgram(plain.lengths, plain.events, np.array([[50]], plain.snapshots.dtype))

    def distance(device, precision):
        lab = LatticeEngine(shape, 1, driver="stepped", **on(device, precision))
        lab.set_positions(np.array([[[0, 0, 0], [0.026, 0, 0]]]))
        lab.run(read, feedback=Swelling())
        return np.ptp(lab.state().positions[0, :, 0])

    assert distance(DEVICE, precision) == pytest.approx(distance("cpu", "f64"), rel=NEAR[precision])
    assert distance(DEVICE, precision) > 0.0299


RUBBER = Material(youngs_modulus=1e6, density=1e3)
BAR = LatticeBody([(x, y, z) for x in range(3) for y in range(2) for z in range(2)], (RUBBER,), [0] * 12, 0.01)


def travelled(steps, *where):
    """Where the voxels of a symmetric bar are that stretches and shrinks on the floor, and so goes nowhere [m]."""
    builder = ProgramBuilder(1)
    for begin in range(0, 1000, 400):
        builder.set(Quantity.SCALE, 1.0, regions=[0], step=begin, rate=5e-4)
        builder.set(Quantity.SCALE, 1.1, regions=[0], step=begin + 200, rate=-5e-4)
    lab = LatticeEngine(BAR, 1, gravity=9.8, floor=True, driver="stepped", **on(*where))
    lab.run(builder.build(steps))
    return lab.state().positions[0]


@pytest.mark.parametrize("steps", [1, 10, 100, 915])
def test_what_a_symmetric_robot_travels_is_rounding(steps):
    """f32 is off by a few of its units of a voxel's position on either device, f64 by as many of its own."""
    truth = travelled(steps, "cpu", "f64")
    unit = {"f32": 2.0**-24 * 0.03, "f64": 2.0**-53 * 0.03}  # of positions up to 3 cm
    assert abs(truth[:, 0].mean() - 0.01) < 10 * unit["f64"]
    assert np.abs(travelled(steps, DEVICE, "f64") - truth).max() < 4 * unit["f64"]
    for device in ("cpu", DEVICE):
        assert np.abs(travelled(steps, device, "f32") - truth).max() < 10 * unit["f32"]


def test_gradients_of_robots_that_end_at_different_steps():
    def run(device):
        lab = LatticeEngine(BAR, 3, gravity=9.8, floor=True, driver="stepped", **on(device, "f64"))
        lab.set_positions(BAR.start_positions + np.arange(3)[:, None, None] * 1e-4)
        tape = lab.record(ProgramBuilder(3).build([15, 30, 20], [[15], [28], [10]]))
        return tape.pull_back(
            positions=np.cos(np.arange(tape.result.positions.size).reshape(tape.result.positions.shape))
        )

    expected = run("cpu")
    assert np.abs(expected.materials["youngs_modulus"]).max() > 0
    assert max(all_apart(run(DEVICE), expected).values()) < NEAR["f64"]


def test_gradients_of_a_body_with_more_channels_than_voxels_and_links():
    """A region for every voxel, whose channels outnumber the threads that voxels, links and contacts ask for."""
    bar = replace(BAR, regions=np.arange(12))

    def run(device):
        lab = LatticeEngine(bar, 2, gravity=9.8, floor=True, driver="stepped", **on(device, "f64"))
        builder = ProgramBuilder(2)
        builder.set(Quantity.SCALE, 1.1, regions=np.arange(12), step=3)
        tape = lab.record(builder.build([30, 30], [[30], [30]]))
        return tape.pull_back(positions=np.cos(np.arange(72.0)).reshape(tape.result.positions.shape))

    expected, found = run("cpu"), run(DEVICE)
    assert np.abs(expected.values).min() > 0
    assert apart(found.values, expected.values) < NEAR["f64"]


def test_a_tape_outlives_restarts_of_taichi():
    """What other engines do meanwhile, on a CPU and in another precision, does not change a gradient."""
    lab = LatticeEngine(BAR, 3, gravity=9.8, floor=True, driver="stepped", **on(DEVICE, "f32"))
    tape = lab.record(ProgramBuilder(3).build([20, 30, 30], [[20], [30], [25]]))
    seeds = np.ones_like(tape.result.positions)
    first = tape.pull_back(positions=seeds)
    travelled(5, "cpu", "f64")
    travelled(5, DEVICE, "f64")
    again = tape.pull_back(positions=seeds)
    assert max(all_apart(again, first).values()) < NEAR["f32"]  # on a GPU threads add in no fixed order


def test_robots_of_a_batch_end_and_diverge_as_on_a_cpu():
    weak = Material(youngs_modulus=1e4, density=1e3)
    builder = ProgramBuilder(3)
    builder.set(Quantity.FORCE, [[0.0], [0.0], [1e4]], regions=[0], step=5)
    ends = []
    for device in ("cpu", DEVICE):
        shape = LatticeBody(BAR.voxels, (weak,), [0] * 12, 0.01)
        lab = LatticeEngine(shape, 3, floor=True, driver="stepped", **on(device, "f32"))
        result = lab.run(builder.build([30, 60, 60]))
        ends.append((result.status.tolist(), result.steps.tolist()))
    assert ends[0] == ends[1] and ends[0][1][:2] == [30, 60]


@pytest.mark.skipif(runtime.COMPILER != "taichi", reason="where the compiler is another, calls may be ordinary ones")
def test_steps_are_launched_without_the_price_of_an_ordinary_call(monkeypatch):
    """A run of twice the steps makes no further calls by way of Taichi's own checks of arguments."""
    kernel, calls = ti.lang.kernel_impl.Kernel, []
    ordinary = kernel.launch_kernel
    monkeypatch.setattr(kernel, "launch_kernel", lambda *given: calls.append(None) or ordinary(*given))
    made = []
    for steps in (2, 20, 40):  # the first run compiles
        calls.clear()
        travelled(steps, DEVICE, "f32")
        made.append(len(calls))
    assert made[1] == made[2] > 0


def test_a_launch_has_as_many_threads_as_its_items_need():
    assert threads_for(1) == threads_for(FEWEST_THREADS) == FEWEST_THREADS
    assert threads_for(FEWEST_THREADS + 1) == 8 * FEWEST_THREADS and threads_for(10**6) is None


@PRECISIONS
def test_rigid_robots_and_their_gradient(precision):
    """Ten steps: llvmpipe ends the loops of a kernel after 65,535 iterations, fewer than 20 steps there and back."""
    weights, light = np.random.default_rng(1).uniform(-1, 1, (3, 5, 8)), np.array([[3.0, 1.0, 0.15]])

    def run(device, precision):
        tape = quadruped_engine(LEGGED, **on(device, precision)).record(10, weights=weights, lights=light)
        assert (tape.result.status == "ok").all()
        return tape.result, tape.pull_back(position=np.ones((3, 3)))

    (truth, slopes), (result, gradient) = run("cpu", "f64"), run(DEVICE, precision)
    for name in ("position", "orientation", "angles", "velocities", "readings"):
        assert apart(getattr(result, name), getattr(truth, name)) < NEAR[precision], name
    assert max(all_apart(gradient, slopes).values()) < NEAR[precision]


@PRECISIONS
def test_vehicles_their_gradients_traces_and_signals(precision):
    rng = np.random.default_rng(0)
    batch = VehicleBatch(rng.uniform(-0.5, 0.5, (2, 2, 2)), rng.uniform(-1, 1, (2, 7, 2, 2)))
    task = VehicleTask(STARTS, steps=400)
    signals = rng.normal(size=(3, 34)), rng.normal(size=(3, 50))

    def run(device, precision):
        where = on(device, precision)
        ends, slopes = rollout(batch, task, until="end", **where), differentiate(batch, task, **where)
        path, distances = trace(batch, task, every=20, **where), warping_distances(*signals, **where)
        names = slopes.of_final.sites, slopes.of_final.controllers, slopes.of_closest.sites
        return [ends.closest, ends.final, *names, path.poses, distances]

    pairs = zip(run(DEVICE, precision), run("cpu", "f64"), strict=True)
    assert max(apart(found, expected) for found, expected in pairs) < NEAR[precision]


def failing(program, **environment):
    command = [sys.executable, "-c", f"from taichi_sim import runtime\n{program}"]
    done = subprocess.run(command, env={**os.environ, **environment}, capture_output=True, text=True, check=False)
    assert done.returncode == 1 and done.stdout == ""
    return done.stderr.splitlines()[-1]


def test_a_machine_without_a_device_is_told_in_one_line():
    line = failing("runtime.start('vulkan', 'f32')", VK_ICD_FILENAMES="/none", VK_DRIVER_FILES="/none")
    assert line == "ValueError: device: 'vulkan' is not available on this machine; use 'cpu'"


@pytest.mark.skipif(DEVICE != "vulkan", reason="it needs a Vulkan device, too")
def test_a_precision_that_a_device_lacks_is_told_in_one_line(monkeypatch):
    def kernel(function):
        def launch(*arguments):
            raise RuntimeError("Type f64 not supported.")

        return launch

    runtime.start("cpu", "f64", 1)
    monkeypatch.setattr(runtime.ti, "kernel", kernel)
    line = r"^precision: device 'vulkan' of this machine cannot compute in 'f64'; use 'f32', or device 'cpu'$"
    with pytest.raises(ValueError, match=line):
        runtime.start("vulkan", "f64", 1)
    monkeypatch.undo()
    assert runtime.start("vulkan", "f32", 1).precision == "f32"
