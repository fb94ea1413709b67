"""Rest sizes in snapshots: what programs and temperatures make of voxels, and gradients through them."""

import numpy as np
import pytest
from gradient_scene import TIME_STEP, body, program
from program_values import values_after

from taichi_sim.lattice import LatticeEngine, LatticeProgram, ProgramBuilder, Quantity

pytestmark = pytest.mark.kernels

DRIVERS = {name: {"driver": name} for name in ("packed", "stepped")}
MARKS = np.array([[0, 1, 31, 200], [0, 60, 61, 100]])


def engine(batch: int = 2, **options) -> LatticeEngine:
    return LatticeEngine(body(pouch=True), batch, time_step=TIME_STEP, gravity=9.8, **options)


def channel(base: LatticeProgram, shape, robot: int, quantity: int, otherwise) -> np.ndarray:
    """What a channel was in the steps before the marks, in every region, shape (S, R)."""
    found = [values_after(base, robot, region, quantity, MARKS[robot]) for region in range(shape.region_count)]
    told = [np.full(MARKS.shape[1], np.nan) if values is None else values for values in found]
    values = np.stack(told, axis=1)
    return np.where(np.isnan(values), otherwise, values)


@pytest.mark.parametrize("options", DRIVERS.values(), ids=DRIVERS)
def test_sizes_are_what_the_program_and_the_temperature_say(options):
    lab = engine(**options)
    shape, base = lab.body, LatticeProgram([200, 200], program(2).events, MARKS)
    found = lab.run(base).sizes
    material = [shape.materials[shape.material_index[shape.regions == r][0]] for r in range(shape.region_count)]
    for robot in range(2):
        warm = channel(base, shape, robot, Quantity.TEMPERATURE, [m.temperature for m in material])
        growth = 1.0 + np.array([m.thermal_expansion for m in material]) * warm
        for axis in range(3):
            scale = channel(base, shape, robot, Quantity.SCALE + axis, [m.scale[axis] for m in material])
            expected = shape.voxel_size * (scale * growth)
            assert np.array_equal(found[robot, :, :, axis], expected[:, shape.regions])


def test_a_run_begins_with_the_sizes_that_the_last_one_left():
    lab, builder = engine(1), ProgramBuilder(1)
    builder.set(Quantity.SCALE, 1.02, regions=[0], rate=1e-3)
    lab.run(builder.build(10))
    found = lab.run(ProgramBuilder(1).build(1, [[0, 1]])).sizes[0, :, lab.body.regions == 0, 0]
    warmth = 1.0 + 1e-3 * 5.0
    np.testing.assert_allclose(found, 0.01 * warmth * (1.02 + 1e-3 * 10), rtol=1e-14)


def test_what_is_not_recorded_has_no_size():
    found = engine(1).run(ProgramBuilder(1).build(5, [[-1, 3]])).sizes
    assert np.isnan(found[0, 0]).all() and np.isfinite(found[0, 1]).all()


@pytest.mark.parametrize("options", DRIVERS.values(), ids=DRIVERS)
@pytest.mark.parametrize("marks", [[0], [1], [0, 1, 40]], ids=str)
def test_sizes_alone_have_gradients(marks, options):
    """By scales, temperatures, their rates and the numbers of materials; sizes are products of these, so exactly."""
    regions, generator = np.arange(4), np.random.default_rng(0)

    def build(moves: np.ndarray) -> LatticeProgram:
        builder = ProgramBuilder(1)
        for step, rate in ((0, 1e-4), (20, -1e-4)):
            for axis in range(3):
                builder.set(Quantity.SCALE + axis, 1.01 - 0.01 * axis, regions=regions, step=step, rate=rate)
            builder.set(Quantity.TEMPERATURE, 8.0, regions=regions[:2], step=step, rate=0.01)
        base = builder.build(50, [marks])
        events = base.events.copy()
        events["value"] += moves[0]
        events["rate"] += moves[1]
        return LatticeProgram(base.lengths, events, base.snapshots)

    count = 2 * (3 * 4 + 2)
    lab = engine(1, **options)
    weights = generator.normal(size=(1, len(marks), lab.body.voxel_count, 3))
    tape = lab.record(build(np.zeros((2, count))))
    found = tape.pull_back(sizes=weights)
    direction = generator.normal(size=(2, count)) * [[1e-3], [1e-5]]

    def cost(step: float) -> float:
        lab.reset()
        return (lab.run(build(step * direction)).sizes * weights).sum()

    slope = (cost(1.0) - cost(-1.0)) / 2  # of a product of two: without error
    assert (np.array([found.values, found.rates]) * direction).sum() == pytest.approx(slope, rel=1e-9)
    assert (found.positions == 0).all()
    assert (found.materials["thermal_expansion"] != 0).all() and (found.materials["temperature"] != 0).all()
