"""The lattice against closed forms and conservation laws."""

import dataclasses

import numpy as np
import pytest

from taichi_sim.lattice import LatticeBody, LatticeEngine, LatticeState, Material, ProgramBuilder, Quantity

pytestmark = pytest.mark.kernels

GRAVITY = 9.80665


def block(material: Material, *size: int, **options) -> LatticeBody:
    voxels = np.argwhere(np.ones(size))
    return LatticeBody(
        voxels=voxels, materials=(material,), material_index=np.zeros(len(voxels)), voxel_size=0.01, **options
    )


def run(engine: LatticeEngine, steps: int, *settings) -> None:
    builder = ProgramBuilder(engine.batch)
    for quantity, value in settings:
        builder.set(quantity, value, regions=[0])
    assert (engine.run(builder.build(steps)).status == "ok").all()


def test_free_flight_conserves_momentum():
    """A bimorph that bends itself in free space keeps its linear momentum to rounding.

    (Angular momentum only to first order in strain: the beams' lever arms are those of the undeformed lattice.)
    """
    voxels = np.argwhere(np.ones((5, 2, 2)))
    soft, hard = (Material(e, 2000) for e in (1e5, 4e5))
    body = LatticeBody(voxels=voxels, materials=(soft, hard), material_index=voxels[:, 2], voxel_size=0.01)
    engine = LatticeEngine(body, self_contact=False)
    builder = ProgramBuilder(1)
    builder.set(Quantity.SCALE, 1.0, rate=1e-4, regions=[0])
    engine.run(builder.build(2000))
    state = engine.state()
    momentum = 2000 * 0.01**3 * state.velocities[0]
    assert np.abs(state.positions[0] - body.start_positions).max() > 1e-3
    assert np.abs(momentum.sum(axis=0)).max() < 1e-12 * np.abs(momentum).sum()


def test_free_fall():
    """Without contact the centre falls by g t (t + dt) / 2, the symplectic Euler sum."""
    engine = LatticeEngine(block(Material(4e5, 3000), 2, 2, 2), gravity=GRAVITY)
    run(engine, 1000)
    t, dt = 1000 * engine.time_step, engine.time_step
    fallen = engine.state().positions[0].mean(axis=0) - [0.005, 0.005, 0.005]
    assert fallen == pytest.approx([0, 0, -GRAVITY * t * (t + dt) / 2], abs=1e-12)


@pytest.mark.parametrize("driver", ["packed", "stepped"])
def test_a_block_that_is_given_a_speed_on_the_floor_slides_to_its_closed_form(driver):
    """Sliding from the state that it is put in: v^2 / (2 mu g), not stuck in its first step."""
    material = Material(1e6, 1e3, static_friction=0.5, kinetic_friction=0.4)
    engine = LatticeEngine(block(material, 1, 1, 1), gravity=GRAVITY, floor=True, time_step=2e-5, driver=driver)
    run(engine, 5000)
    at = engine.state()
    engine.set_state(dataclasses.replace(at, velocities=np.array([[[0.3, 0.4, 0.0]]])))
    run(engine, 10_000)
    gone = engine.state().positions[0, 0] - at.positions[0, 0]
    np.testing.assert_allclose(gone[:2], 0.25 / (2 * 0.4 * GRAVITY) * np.array([0.6, 0.8]), rtol=1e-3)


@pytest.mark.parametrize(("slope", "slides"), [(21.0, False), (23.0, True)])
def test_a_block_on_an_incline_holds_up_to_the_friction_angle(slope, slides):
    """tan(slope) = mu_s; above it the block accelerates by g (sin - mu_k cos)."""
    held = np.tan(np.deg2rad(22.0))
    body = block(Material(4e5, 3000, static_friction=held, kinetic_friction=held / 2), 3, 3, 1)
    engine = LatticeEngine(body, floor=True)
    tilt = np.deg2rad(slope)
    weight = (Quantity.ACCELERATION + 2, -GRAVITY * np.cos(tilt))
    run(engine, 3000, weight)  # settle before the slope tilts
    before = engine.state()
    run(engine, 3000, (Quantity.ACCELERATION, GRAVITY * np.sin(tilt)), weight)
    moved = (engine.state().positions[0] - before.positions[0]).mean(axis=0)
    if slides:
        t = 3000 * engine.time_step
        assert moved[0] == pytest.approx(GRAVITY * (np.sin(tilt) - held / 2 * np.cos(tilt)) * t**2 / 2, rel=0.02)
    else:
        assert abs(moved[0]) < 1e-5


def test_axial_stretch_is_hookes():
    """F L / (E A) of a bar held at one end."""
    fixed = np.zeros((6, 6), bool)
    fixed[0] = True
    body = block(Material(1e6, 1000), 6, 1, 1, fixed=fixed, regions=np.arange(6) == 5)
    engine = LatticeEngine(body)
    builder = ProgramBuilder(1)
    builder.set(Quantity.FORCE, 0.5, regions=[1])
    engine.run(builder.build(20_000))
    stretch = engine.state().positions[0, 5, 0] - 0.05
    assert stretch == pytest.approx(0.5 * 0.05 / (1e6 * 0.01**2), rel=1e-9)


def test_poissons_ratio_narrows_a_stretched_block():
    """Transverse strain follows (1 + e)^-nu - 1 of the axial strain e: the gauge of the middle voxel says so."""
    voxels = np.argwhere(np.ones((7, 3, 3)))
    fixed = np.zeros((63, 6), bool)
    fixed[voxels[:, 0] == 0] = True
    body = LatticeBody(
        voxels=voxels,
        materials=(Material(1e6, 1000, poissons_ratio=0.3),),
        material_index=np.zeros(63),
        voxel_size=0.01,
        fixed=fixed,
        regions=voxels[:, 0] == 6,
    )
    engine = LatticeEngine(body, self_contact=False, time_step=0.5 * body.recommended_time_step)
    builder = ProgramBuilder(1)
    builder.set(Quantity.FORCE, 2.0, regions=[1])
    engine.run(builder.build(20_000))
    positions = engine.state().positions[0].reshape(7, 3, 3, 3)
    axial = (positions[5, 1, 1, 0] - positions[1, 1, 1, 0]) / 0.04 - 1
    lateral = (positions[3, 2, 1, 1] - positions[3, 0, 1, 1]) / 0.02 - 1
    assert axial == pytest.approx(2.0 / (1e6 * 0.01**2), rel=0.1)
    assert lateral == pytest.approx((1 + axial) ** -0.3 - 1, rel=0.15)


def test_thermal_expansion():
    """A free bar grows by alpha T."""
    body = block(Material(1e6, 1000, thermal_expansion=1e-3), 5, 1, 1)
    engine = LatticeEngine(body)
    run(engine, 8000, (Quantity.TEMPERATURE, 50.0))
    x = engine.state().positions[0, :, 0]
    assert x[-1] - x[0] == pytest.approx(0.04 * 1.05, rel=1e-9)


def test_prescribed_motion_of_fixed_voxels():
    """Held degrees of freedom follow their program; the rest of the bar follows them."""
    fixed = np.zeros((4, 6), bool)
    fixed[0] = True
    body = block(Material(1e6, 1000), 4, 1, 1, fixed=fixed, regions=np.arange(4) > 0)
    engine = LatticeEngine(body)
    builder = ProgramBuilder(1)
    builder.set(Quantity.TRANSLATION + 1, 0.0, rate=0.02 / 4000, regions=[0])
    builder.set(Quantity.TRANSLATION + 1, 0.02, step=4000, regions=[0])
    builder.set(Quantity.ROTATION + 2, 0.0, rate=np.pi / 2 / 4000, regions=[0])
    builder.set(Quantity.ROTATION + 2, np.pi / 2, step=4000, regions=[0])
    engine.run(builder.build(30_000))
    positions = engine.state().positions[0]
    assert positions[0] == pytest.approx([0, 0.02, 0], abs=1e-12)
    assert positions[3] == pytest.approx([0, 0.05, 0], abs=1e-6)


def test_a_bar_that_is_held_in_a_plane_turns_right_round():
    """As the free bar does, though it swings, so that voxels pass half a turn one by one; and as its end is driven."""
    fixed = np.zeros((4, 6), bool)
    fixed[:, [1, 3, 5]] = True
    ends, begun = [], 3.0  # rad
    for held in (fixed, None):
        engine = LatticeEngine(block(Material(1e6, 1000), 4, 1, 1, fixed=held))
        away = np.array([np.cos(begun), 0.0, -np.sin(begun)]) * np.linspace(-0.015, 0.015, 4)[:, None]
        swing = np.array([np.sin(begun), 0.0, np.cos(begun)]) * np.array([2.0, -2.0, -2.0, 2.0])[:, None]
        turned = np.tile([np.cos(begun / 2), 0.0, np.sin(begun / 2), 0.0], (1, 4, 1))
        spin = np.tile([0.0, 40.0, 0.0], (1, 4, 1))
        engine.set_state(LatticeState(away[None], turned, (np.cross(spin[0], away) + swing)[None], spin))
        run(engine, round(1.5 * 2 * np.pi / 40 / engine.time_step), (Quantity.SCALE, 1.0))
        ends.append(engine.state().positions[0])
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)

    fixed = np.zeros((4, 6), bool)
    fixed[[0, 3]] = True
    engine = LatticeEngine(block(Material(1e6, 1000), 4, 1, 1, fixed=fixed, regions=np.arange(4) // 3))
    builder = ProgramBuilder(1)
    for end, told in enumerate((3.1, 3.2)):  # at once: the ends are a tenth apart, not a whole turn
        builder.set(Quantity.ROTATION, told, regions=[end])
    engine.run(builder.build(20_000))
    twists = 2 * np.arctan2(engine.state().orientations[0, :, 1], engine.state().orientations[0, :, 0])
    assert twists[[0, 3]] == pytest.approx([3.1, 3.2]) and (np.diff(twists) > 0.02).all()

    fixed = np.zeros((4, 6), bool)
    fixed[0] = True
    engine = LatticeEngine(block(Material(1e6, 1000), 4, 1, 1, fixed=fixed, regions=np.arange(4) > 0))
    turn = np.pi * 1.5
    builder = ProgramBuilder(1)
    builder.set(Quantity.ROTATION + 2, 0.0, rate=turn / 9000, regions=[0])
    builder.set(Quantity.ROTATION + 2, turn, step=9000, regions=[0])
    engine.run(builder.build(40_000))
    assert engine.state().positions[0, 3] == pytest.approx([0, -0.03, 0], abs=1e-6)


def test_pressure_balances_the_stretch_of_a_box():
    """P times the deformed end faces equals the axial force of two rows of two voxels joined end to end."""
    voxels = np.array([(0, 0, 0), (1, 0, 0)])
    body = LatticeBody(
        voxels=voxels,
        materials=(Material(1e6, 1000),),
        material_index=[0, 0],
        voxel_size=0.01,
        pressure_normals=[(-1, 0, 0), (1, 0, 0)],
    )
    engine = LatticeEngine(body)
    run(engine, 20_000, (Quantity.PRESSURE, 2e4))
    x = engine.state().positions[0, :, 0]
    assert (x[1] - x[0]) / 0.01 - 1 == pytest.approx(2e4 / 1e6, rel=1e-9)


def test_global_damping_slows_exponentially():
    """m dv/dt = -c v with c = 2 zeta sqrt(m E h)."""
    body = block(Material(4e5, 3000, global_damping=0.01), 1, 1, 1)
    engine = LatticeEngine(body, gravity=0.0)
    run(engine, 100, (Quantity.ACCELERATION, 1.0))
    speed = engine.state().velocities[0, 0, 0]
    run(engine, 500, (Quantity.ACCELERATION, 0.0))
    rate = 2 * 0.01 * np.sqrt(0.003 * 4e5 * 0.01) / 0.003
    expected = (1 - rate * engine.time_step) ** 500
    assert engine.state().velocities[0, 0, 0] / speed == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("driver", ["packed", "stepped"])
@pytest.mark.parametrize(("other", "damping"), [(2000, 0.6), (100, 0.6), (100, 0.0)])
def test_two_voxels_of_unlike_materials_swing_about_their_resting_middle(other, damping, driver):
    """With the mean damping / sqrt(2) of critical, whatever their masses: the published law let them run away."""
    ends = Material(4e5, 2000, internal_damping=0.2), Material(1e5, other, internal_damping=damping)
    body = LatticeBody(voxels=[(0, 0, 0), (1, 0, 0)], materials=ends, material_index=[0, 1], voxel_size=0.01)
    engine = LatticeEngine(body, time_step=body.recommended_time_step / 100, self_contact=False, driver=driver)
    stretch, masses = 1e-4, np.array([2000, other]) * 0.01**3
    engine.set_positions(np.add(body.start_positions, [[0, 0, 0], [stretch, 0, 0]])[None])
    run(engine, 1)  # the link remembers how it is strained
    start = np.diff(engine.state().positions[0, :, 0])[0] - 0.01
    run(engine, 3000)
    places = engine.state().positions[0]
    assert abs(masses @ places[:, 0] - masses[1] * (0.01 + stretch)) < 1e-12 * masses.sum() * 0.01
    stiffness = 2 * 4e5 * 1e5 / 5e5 * 0.01
    frequency, ratio = np.sqrt(stiffness / (masses.prod() / masses.sum())), 0.5 * (0.2 + damping) / np.sqrt(2)
    turn, time = frequency * np.sqrt(1 - ratio**2), 3000 * engine.time_step
    swing = np.cos(turn * time) + ratio / np.sqrt(1 - ratio**2) * np.sin(turn * time)
    assert places[1, 0] - places[0, 0] - 0.01 == pytest.approx(
        start * np.exp(-ratio * frequency * time) * swing, abs=5e-3 * stretch
    )
