"""Links of bodies in a fluid: they keep momentum and angular momentum, and stay what they are at small strains."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pouches import EDGE, TIME_STEP, lopsided

from taichi_sim.lattice import LatticeBody, LatticeEngine, LatticeState, Material, ProgramBuilder, Quantity
from taichi_sim.lattice.laws.link import balanced

pytestmark = pytest.mark.kernels

UNLIKE = (Material(4e5, 3000.0, internal_damping=1.0), Material(2e5, 2000.0, internal_damping=0.2))
PRESSURE, KICK = 8e3, 0.1


def pouch(materials=UNLIKE[:1]) -> LatticeBody:
    """The pouch with a fin; of two materials side by side if so many are given."""
    shape = lopsided()
    index = (shape.voxels[:, 0] > 1).astype(int) * (len(materials) - 1)
    return LatticeBody(
        shape.voxels, materials, index, EDGE, cut_links=shape.cut_links, pressure_normals=shape.pressure_normals
    )


def kicked(shape: LatticeBody) -> LatticeState:
    """Distorted, its voxels turned and moving all ways."""
    rng, count = np.random.default_rng(5), shape.voxel_count
    turns = np.concatenate([np.ones((1, count, 1)), rng.normal(0, 0.02, (1, count, 3))], axis=2)
    return LatticeState(
        shape.start_positions[None] + rng.normal(0, 0.02 * EDGE, (1, count, 3)),
        turns / np.linalg.norm(turns, axis=2, keepdims=True),
        rng.normal(0, KICK, (1, count, 3)),
        rng.normal(0, KICK / EDGE, (1, count, 3)),
    )


class Motion:
    """Momenta and kinetic energy of an engine's first robot."""

    def __init__(self, lab: LatticeEngine) -> None:
        state, inverse = lab.state(), np.empty((lab.body.voxel_count, 2))
        inverse[lab.order] = lab.inverse_masses[0]
        mass, inertia = 1 / inverse.T[..., None]
        places, speeds, spins = state.positions[0], state.velocities[0], state.angular_velocities[0]
        arms = places - (mass * places).sum(axis=0) / mass.sum()
        parts = np.cross(arms, mass * speeds) + inertia * spins
        self.momentum, self.spin = (mass * speeds).sum(axis=0), parts.sum(axis=0)
        self.spin_scale = np.linalg.norm(parts, axis=1).sum()
        tensor = mass[:, :, None] * (
            (arms**2).sum(axis=1)[:, None, None] * np.eye(3) - arms[:, :, None] * arms[:, None]
        )
        self.turning = np.linalg.norm(np.linalg.solve(tensor.sum(axis=0) + inertia.sum() * np.eye(3), self.spin))
        self.energy = 0.5 * ((mass * speeds**2).sum() + (inertia * spins**2).sum())


def inflated(lab: LatticeEngine, steps: int = 1000) -> LatticeEngine:
    """The engine after the pressure has risen."""
    builder, regions = ProgramBuilder(lab.batch), np.arange(lab.body.region_count)
    builder.set(Quantity.PRESSURE, 0.0, rate=PRESSURE / steps, regions=regions)
    builder.set(Quantity.PRESSURE, PRESSURE, regions=regions, step=steps)
    assert (lab.run(builder.build(steps)).status == "ok").all()
    return lab


def go_on(lab: LatticeEngine, steps: int) -> Motion:
    assert (lab.run(ProgramBuilder(lab.batch).build(steps)).status == "ok").all()
    return Motion(lab)


@settings(max_examples=50)
@given(st.lists(st.floats(-1, 1), min_size=15, max_size=15))
def test_balanced_forces_neither_push_nor_turn_and_are_left_alone(numbers):
    offset, *parts = np.array(numbers).reshape(5, 3)
    force, moment, given_up, moment_given_up = np.array(balanced(*offset, *np.concatenate(parts))).reshape(4, 3)
    assert np.array_equal(force, given_up)
    assert np.allclose(moment - moment_given_up, np.cross(offset, given_up), rtol=0, atol=1e-15)
    assert np.allclose(moment + moment_given_up, parts[1] + parts[3], rtol=0, atol=1e-15)
    again = np.array(balanced(*offset, *force, *moment, *given_up, *moment_given_up)).reshape(4, 3)
    assert np.allclose(again, [force, moment, given_up, moment_given_up], rtol=0, atol=1e-15)


def test_a_pouch_under_pressure_does_not_turn_itself_in_vacuum():
    """By rounding only: the published law alone turned it by 0.3 rad/s in these 4000 steps."""
    lab = inflated(LatticeEngine(pouch(), 1, time_step=TIME_STEP, fluid=True))
    assert np.abs(lab.state().positions[0] - lab.body.start_positions).max() > 0.2 * EDGE
    assert go_on(lab, 3000).turning < 1e-13


@pytest.mark.parametrize(("materials", "driver"), [(UNLIKE[:1], "packed"), (UNLIKE, "packed"), (UNLIKE, "stepped")])
def test_a_strained_body_keeps_its_momenta_in_vacuum(materials, driver):
    """With links in both regimes; by other laws than the balanced one it turns, by the published one it also moves."""
    shape, ends = pouch(materials), {}
    for name in ("fluid", "balanced", "alike", "published"):
        fluid, law = name == "fluid", "alike" if name == "fluid" else name
        body, more = replace(shape, links=law), {"time_step": TIME_STEP, "driver": driver, "self_contact": False}
        lab = LatticeEngine(body, 1, fluid=fluid, **more)
        lab.set_state(kicked(shape))
        start = Motion(lab)
        end = go_on(lab, 300)
        ends[name] = (
            np.abs(end.momentum - start.momentum).max() / (KICK * shape.voxel_count * 1e-3),
            np.abs(end.spin - start.spin).max() / start.spin_scale,
        )
    assert ends["balanced"] == ends["fluid"] and max(ends["fluid"]) < 1e-12
    assert ends["alike"][0] < 1e-12 and ends["alike"][1] > 1e-4
    assert ends["published"][1] > 1e-4 and (ends["published"][0] > 1e-6) == (len(materials) > 1)


def test_energy_is_damped_under_pressure():
    """What is left after a kick is the motion as a whole, which nothing can damp."""
    lab = inflated(LatticeEngine(pouch(), 1, time_step=TIME_STEP, fluid=True))
    lab.set_state(
        LatticeState(
            lab.state().positions,
            lab.state().orientations,
            *(getattr(kicked(lab.body), f) for f in ("velocities", "angular_velocities")),
        )
    )
    first = Motion(lab).energy
    later = [go_on(lab, 1000).energy for _ in range(4)]
    assert later[0] < 0.5 * first
    assert later[3] == pytest.approx(later[2], rel=1e-3)
    assert max(later[1:]) < later[0] * (1 + 1e-3)


def test_a_cantilever_bends_as_published_at_small_deflections():
    """To second order: a tenth of the load, a hundredth of the difference; and as F L^3 / 3 E I."""
    places = np.argwhere(np.ones((8, 1, 1)))
    fixed, regions = np.zeros((8, 6), bool), np.zeros(8, int)
    fixed[0], regions[-1] = True, 1
    bar = LatticeBody(places, UNLIKE[:1], np.zeros(8, int), EDGE, regions=regions, fixed=fixed)
    stiffness, length = 4e5 * EDGE**4 / 12, 7 * EDGE

    def tip(load: float, fluid: bool) -> float:
        lab = LatticeEngine(bar, 1, time_step=TIME_STEP, fluid=fluid, self_contact=False)
        builder = ProgramBuilder(1)
        builder.set(Quantity.FORCE + 2, load, regions=[1])
        builder.set(Quantity.GLOBAL_DAMPING, 0.02, regions=[0, 1])
        assert lab.run(builder.build(15000)).status.tolist() == ["ok"]
        return lab.state().positions[0, -1, 2] / (load * length**3 / (3 * stiffness))

    small, smaller = (0.01 * 3 * stiffness / length**2 / s for s in (1, 10))
    differences = [abs(tip(load, True) / tip(load, False) - 1) for load in (small, smaller)]
    assert tip(small, True) == pytest.approx(1.0, abs=1e-2)
    assert differences[0] < 1e-3 and differences[1] < 0.02 * differences[0] + 1e-9
