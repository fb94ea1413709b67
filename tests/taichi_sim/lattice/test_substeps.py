"""Engines that divide the time steps of their programs: the same run in shorter steps, counted in whole ones."""

import copy

import numpy as np
import pytest
from program_values import values_after

from taichi_sim.lattice import LatticeBody, LatticeEngine, Material, ProgramBuilder, Quantity
from taichi_sim.lattice.feedback import Feedback

RUBBER = Material(1e6, 1e3)
BEAM = LatticeBody([(x, 0, 0) for x in range(4)], (RUBBER,), [0] * 4, 0.01, regions=[0, 0, 1, 1])
STEP = BEAM.recommended_time_step
STEPS = 60


def program(parts=1, rate=1e-3):
    """A muscle that swells, then is cut short, in steps that are divided into parts already."""
    builder = ProgramBuilder(robot_count=1)
    builder.set(Quantity.SCALE, 1.0, regions=[1], step=0, rate=rate / parts)
    builder.set(Quantity.SCALE, 0.97, regions=[1], step=40 * parts)
    return builder.build(STEPS * parts, [[0, 25 * parts, STEPS * parts]])


def made(parts):
    return LatticeEngine(BEAM, time_step=STEP, substeps=parts, gravity=9.8, floor=True)


def test_a_refined_program_says_the_same():
    one, fine = program(), program().refined(5)
    assert one.refined(1) is one
    steps = np.arange(STEPS + 1)
    mine = values_after(one, 0, 1, Quantity.SCALE, steps)
    ends = values_after(fine, 0, 1, Quantity.SCALE, 5 * steps - 4)  # a whole step's value holds when it begins
    np.testing.assert_allclose(ends[1:], mine[1:], rtol=1e-15)
    late = ProgramBuilder(2).build([3, 4], [[-1, 3], [2, 4]]).refined(5)
    assert late.snapshots.tolist() == [[-1, 15], [10, 20]] and late.lengths.tolist() == [15, 20]


def test_what_never_comes_stays_so_and_too_many_steps_are_refused():
    builder = ProgramBuilder(1)
    builder.set(Quantity.SCALE, 1.0, regions=[0], step=2**30 - 1)
    assert builder.build(10).refined(6).events["step"].tolist() == [2**30 - 1]
    with pytest.raises(ValueError, match=r"^lengths: 536870912 steps are not allowed in 6 substeps each$"):
        ProgramBuilder(1).build(2**29).refined(6)


@pytest.mark.kernels
@pytest.mark.parametrize("parts", [1, 6])
def test_the_step_of_a_divergence_is_that_of_the_program(parts):
    builder = ProgramBuilder(1)
    builder.set(Quantity.FORCE, 1e12, regions=[1], step=3)
    found = made(parts).run(builder.build(STEPS))
    assert found.status.tolist() == ["diverged"] and 3 < found.steps[0] <= 6


@pytest.mark.kernels
def test_substeps_are_shorter_steps_to_the_bit():
    whole = made(4).run(program())
    short = LatticeEngine(BEAM, time_step=STEP / 4, gravity=9.8, floor=True).run(program(4))
    for name in ("positions", "orientations", "strains", "sizes"):
        assert getattr(whole, name).tobytes() == getattr(short, name).tobytes()
    assert whole.steps.tolist() == [STEPS] and short.steps.tolist() == [4 * STEPS]


@pytest.mark.kernels
def test_copies_keep_the_substeps():
    engine = made(4)
    assert copy.deepcopy(engine).run(program()).positions.tobytes() == engine.run(program()).positions.tobytes()


@pytest.mark.kernels
def test_derivatives_by_rates_are_by_those_of_whole_steps():
    tape = made(4).record(program())
    cotangent = np.zeros_like(tape.result.positions)
    cotangent[:, -1, 3, 0] = cotangent[:, 1, 3, 0] = 1.0
    by = tape.pull_back(positions=cotangent).rates[0]

    def cost(rate):
        found = made(4).run(program(rate=rate)).positions
        return found[0, -1, 3, 0] + found[0, 1, 3, 0]

    assert by == pytest.approx((cost(1e-3 + 1e-7) - cost(1e-3 - 1e-7)) / 2e-7, rel=1e-5)
    assert tape.result.steps.tolist() == [STEPS]


@pytest.mark.parametrize("given", [0, -2, 1.5])
def test_substeps_must_be_a_number_of_parts(given):
    with pytest.raises(ValueError, match=r"^substeps: .* is not allowed; "):
        made(given)


@pytest.mark.kernels
def test_a_feedback_is_refused_with_substeps():
    feedback = object.__new__(Feedback)
    for way in (made(2).run, made(2).record):
        with pytest.raises(
            ValueError, match=r"^substeps: 2 is not allowed with a feedback; give 1 and a shorter time_"
        ):
            way(program(), feedback=feedback)


@pytest.mark.kernels
@pytest.mark.parametrize("horizon", [None, 0.005])
def test_derivatives_are_those_of_shorter_steps_with_a_horizon_too(horizon):
    engines = made(4), LatticeEngine(BEAM, time_step=STEP / 4, gravity=9.8, floor=True)
    found = []
    for engine, parts in zip(engines, (1, 4), strict=True):
        tape = engine.record(program(parts))
        cotangent = np.zeros_like(tape.result.positions)
        cotangent[:, -1, 3, 0] = 1.0
        found.append(tape.pull_back(positions=cotangent, horizon=horizon))
    assert found[0].positions.any()
    for name in ("values", "positions", "orientations", "velocities"):
        assert getattr(found[0], name).tobytes() == getattr(found[1], name).tobytes()
