"""The lattice against an independent engine: eight cases over their whole length, all drivers and precisions."""

import numpy as np
import pytest
from lattice_reference import NAMES, load_case

from taichi_sim.lattice import LatticeEngine, LatticeProgram, ProgramBuilder, Quantity

pytestmark = pytest.mark.kernels


@pytest.mark.parametrize("name", NAMES)
def test_reference_case_in_f64(name):
    case = load_case(name)
    engine = LatticeEngine(case.body, batch=1, time_step=case.time_step, threads=1, **case.options)
    result = engine.run(case.program())
    assert result.status.tolist() == ["ok"]
    assert np.abs(result.positions[0] - case.positions).max() < 2e-6
    dot = np.abs((result.orientations[0] * case.quaternions).sum(axis=2))
    assert 2 * np.arccos(np.minimum(dot, 1)).max() < 2e-3


@pytest.mark.parametrize("name", NAMES)
def test_reference_case_in_f32(name):
    """Single precision, three robots."""
    case = load_case(name)
    engine = LatticeEngine(case.body, batch=3, time_step=case.time_step, precision="f32", threads=1, **case.options)
    result = engine.run(case.program(3))
    assert np.abs(result.positions - case.positions).max() < 3e-4
    assert np.array_equal(result.positions[0], result.positions[2])


@pytest.mark.parametrize("name", NAMES)
def test_every_driver_gives_the_same_bits(name):
    """Packs mix voxels that are held, loaded and free; 300 steps of each case."""
    case, found = load_case(name), []
    events = case.program().events
    program = LatticeProgram(np.array([300]), events[events["step"] < 300], np.array([[2, 100, 300]]))
    for driver in ("packed", "stepped"):
        options = {"time_step": case.time_step, "threads": 1, "driver": driver, **case.options}
        result = LatticeEngine(case.body, 1, **options).run(program)
        found.append([result.positions, result.orientations, result.strains])
    for packed, stepped in zip(*found, strict=True):
        np.testing.assert_array_equal(packed, stepped)


def test_cantilever_agrees_with_beam_theory():
    """Small deflection of a bar held at one end: F L^3 / 3 E I."""
    case = load_case("cantilever_small")
    engine = LatticeEngine(case.body, time_step=case.time_step, threads=1, **case.options)
    builder = ProgramBuilder(1)
    case.fill(builder)
    builder.set(Quantity.GLOBAL_DAMPING, 0.01, regions=[0, 1])  # the case itself still swings at its end
    assert engine.run(builder.build(120_000)).status.tolist() == ["ok"]
    tip = engine.state().positions[0, 9, 2]
    length, inertia = 9 * 0.005, 0.005**4 / 12
    assert tip == pytest.approx(-0.0005 * length**3 / (3 * 1e6 * inertia), rel=2e-3)
