"""The packed driver does what the stepped one does: the same bits forwards, the same gradients to rounding."""

import time

import gradient_scene as scene
import numpy as np
import pytest

from taichi_sim.lattice import LatticeBody, LatticeEngine, Material, ProgramBuilder, Quantity

pytestmark = pytest.mark.kernels
SCENES = [(False, False, False), (True, False, False), (False, True, False), (False, True, True), (True, True, True)]


def engine(driver, poisson, pouch, fluid, batch=2, **options):
    body = scene.body(poisson, pouch)
    made = LatticeEngine(
        body,
        batch,
        time_step=scene.TIME_STEP,
        floor=True,
        fluid=fluid,
        gravity=2.0,
        threads=1,
        driver=driver,
        **options,
    )
    made.set_state(scene.repeated(scene.start(body), batch))
    return made


def everything(made, result):
    state = made.state()
    parts = [getattr(result, f) for f in result.__dataclass_fields__]
    return parts + [getattr(state, f) for f in state.__dataclass_fields__]


@pytest.mark.parametrize(("poisson", "pouch", "fluid"), SCENES)
@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_the_same_bits_forwards(poisson, pouch, fluid, precision):
    runs = []
    for driver in ("stepped", "packed"):
        made = engine(driver, poisson, pouch, fluid, precision=precision)
        runs.append(everything(made, made.run(scene.program(2))))
    assert all(np.array_equal(a, b) for a, b in zip(*runs, strict=True))


@pytest.mark.parametrize(("poisson", "pouch", "fluid"), SCENES)
def test_the_same_gradients_to_rounding(poisson, pouch, fluid):
    """Sums have another order on the way back; a record in pieces changes nothing."""
    found = []
    for driver, room in (("stepped", 1e9), ("packed", 1e9), ("packed", 5e6)):
        made = engine(driver, poisson, pouch, fluid, batch=1)
        cost = scene.Cost(made.body, 3, True)
        gradient = cost.pull_back(made.record(scene.program(1), memory=room))
        parts = {name: getattr(gradient, name) for name in gradient.__dataclass_fields__}
        materials = parts.pop("materials")
        found.append(parts | materials)
    stepped, whole, pieces = found
    for name, values in stepped.items():
        scale = max(np.abs(values).max(), 1e-300)
        assert np.abs(whole[name] - values).max() <= 1e-12 * scale, name
        assert np.array_equal(whole[name], pieces[name]), name


def test_a_run_in_pieces_and_from_a_saved_state_has_the_same_bits():
    body = LatticeBody(np.argwhere(np.ones((9, 3, 2))), (Material(1e5, 1e3),), np.zeros(54, int), 0.01)
    builder = ProgramBuilder(1)
    builder.set(Quantity.SCALE, 1.0, regions=[0], step=0, rate=2e-4)
    made = LatticeEngine(body, 1, floor=True, gravity=9.81, threads=1, driver="packed")
    made.run(builder.build(100))
    saved = made.save()
    first = everything(made, made.run(ProgramBuilder(1).build(50)))
    made.restore(saved)
    made.run(ProgramBuilder(1).build(20))
    assert np.array_equal(everything(made, made.run(ProgramBuilder(1).build(30)))[-4], first[-4])


def test_on_one_thread_robots_run_in_the_thread_that_launches_them():
    """To wake another one for them would take longer than some steps; so the time of this one is that of all."""
    made, program = engine("packed", False, False, False), ProgramBuilder(2).build(2000)
    made.run(program)
    begun = time.thread_time(), time.process_time()
    made.run(program)
    own, whole = time.thread_time() - begun[0], time.process_time() - begun[1]
    assert own > 0.5 * whole


def test_a_robot_that_diverges_is_told_and_disturbs_no_other():
    body = LatticeBody([(0, 0, 0), (1, 0, 0)], (Material(1e5, 1e3),), [0, 0], 0.01)
    builder = ProgramBuilder(2)
    builder.set(Quantity.FORCE, np.array([[1e6], [0.0]]), regions=[0], step=5)
    results = []
    for driver in ("stepped", "packed"):
        made = LatticeEngine(body, 2, threads=1, driver=driver)
        results.append(made.run(builder.build(100)))
    stepped, packed = results
    assert packed.status.tolist() == stepped.status.tolist() and packed.steps.tolist() == stepped.steps.tolist()


def test_every_voxel_may_be_a_region_of_its_own():
    """More groups than lanes, so several packs of them: the same bits, and the same gradients to rounding."""
    voxels = np.argwhere(np.ones((5, 4, 3)))
    count = len(voxels)
    body = LatticeBody(voxels, (Material(1e5, 1e3),), np.zeros(count, int), 0.01, regions=np.arange(count))
    generator = np.random.default_rng(0)
    builder = ProgramBuilder(2)
    for axis in range(3):
        rates = generator.uniform(-2e-4, 2e-4, (2, count))
        builder.set(Quantity.SCALE + axis, np.ones((2, count)), regions=np.arange(count), step=10, rate=rates)
    program = builder.build(120, [[0, 60, 120]] * 2)
    seeds = generator.normal(size=(2, 3, count, 3))
    found = []
    for driver in ("stepped", "packed"):
        made = LatticeEngine(body, 2, floor=True, gravity=9.81, threads=1, driver=driver)
        tape = made.record(program)
        gradient = tape.pull_back(positions=seeds, sizes=seeds)
        found.append((tape.result, gradient))
    (stepped, slopes), (packed, packed_slopes) = found
    for name in ("positions", "orientations", "strains", "sizes"):
        np.testing.assert_array_equal(getattr(packed, name), getattr(stepped, name))
    for name in ("values", "rates", "positions"):
        wanted = getattr(slopes, name)
        np.testing.assert_allclose(getattr(packed_slopes, name), wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())
