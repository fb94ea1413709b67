"""Engines that are advanced piece by piece."""

import numpy as np
import pytest

from robots import quadruped
from taichi_sim.lattice import LatticeBody, LatticeEngine, Material, ProgramBuilder, Quantity
from taichi_sim.rigid import RigidEngine

pytestmark = pytest.mark.kernels

COMMANDS = np.random.default_rng(3).uniform(-1, 1, (3, 12, 8))
LIGHTS = np.array([[9.0, 0.0, 0.15], [0.0, 9.0, 0.15], [-9.0, 0.0, 0.15]])


@pytest.mark.parametrize("precision", ["f32", "f64"])
@pytest.mark.parametrize("kind", ["legged", "wheeled", "whegged"])
def test_a_session_has_the_bits_of_a_run(kind, precision):
    engine: RigidEngine = quadruped.engine(quadruped.Quadruped(kind), precision=precision, threads=1)
    whole = engine.run(12, commands=COMMANDS, lights=LIGHTS)
    session = engine.session(batch=3, lights=LIGHTS)
    first = session.advance(steps=0)
    np.testing.assert_array_equal(first.readings, engine.run(0, lights=LIGHTS).readings)
    for step in range(10):
        session.advance(COMMANDS[:, step])
    session.advance(COMMANDS[:, 10])
    last = session.advance(COMMANDS[:, 11])
    for name in ("position", "orientation", "angles", "velocities", "readings", "closest", "status"):
        np.testing.assert_array_equal(getattr(last, name), getattr(whole, name))


def test_a_session_may_hold_its_commands():
    engine = quadruped.engine(quadruped.LEGGED, precision="f32", threads=1)
    whole = engine.run(6, commands=COMMANDS[:1, :2], hold=3)
    session = engine.session()
    session.advance(COMMANDS[:1, 0], steps=3)
    session.advance(COMMANDS[:1, 1])
    np.testing.assert_array_equal(session.advance(steps=2).position, whole.position)


def test_what_a_session_is_given_is_checked():
    session = quadruped.engine(quadruped.LEGGED, precision="f32", threads=1).session()
    with pytest.raises(ValueError, match=r"^commands: shape \(8,\) is not allowed; give \(1, 8\)$"):
        session.advance(np.zeros(8))
    with pytest.raises(ValueError, match=r"^commands: .* give finite numbers"):
        session.advance(np.full((1, 8), np.nan))
    with pytest.raises(ValueError, match=r"^steps: -1 is not allowed; give a whole number, at least 0$"):
        session.advance(steps=-1)


@pytest.mark.parametrize("driver", ["packed", "stepped"])
def test_a_lattice_goes_on_from_what_was_saved(driver):
    rubber = Material(youngs_modulus=1e5, density=1e3, static_friction=0.5, kinetic_friction=0.4)
    bar = LatticeBody(
        voxels=[(x, 0, z) for x in range(5) for z in range(2)],
        materials=(rubber,),
        material_index=[0] * 10,
        voxel_size=0.01,
    )
    engine = LatticeEngine(bar, batch=2, gravity=9.8, floor=True, driver=driver, threads=1)

    def grow(to, steps):
        builder = ProgramBuilder(2)
        builder.set(Quantity.SCALE, [[to], [1 / to]], regions=[0])
        return engine.run(builder.build(steps, np.full((2, 1), steps)))

    grow(1.2, 150)
    saved = engine.save()
    first = grow(0.9, 200)
    assert not np.array_equal(first.positions[:, 0], engine.body.start_positions)
    grow(1.3, 300)
    engine.restore(saved)
    again = grow(0.9, 200)
    for name in ("positions", "orientations", "strains", "status"):
        np.testing.assert_array_equal(getattr(again, name), getattr(first, name))
