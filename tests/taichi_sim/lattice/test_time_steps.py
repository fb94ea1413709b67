"""Recommended time steps: closed forms, and that no energy comes from steps that are too long."""

import dataclasses

import numpy as np
import pytest

from taichi_sim.lattice import LatticeBody, LatticeEngine, LatticeState, Material, ProgramBuilder
from taichi_sim.lattice.time_steps import contact_step, floor_step, link_step

EDGE, GRAVITY = 0.01, 9.80665
RUBBER = Material(1e5, 1e3, static_friction=1.0, kinetic_friction=0.8)


def block(material: Material, *size: int) -> LatticeBody:
    voxels = np.argwhere(np.ones(size))
    return LatticeBody(voxels=voxels, materials=(material,), material_index=np.zeros(len(voxels)), voxel_size=EDGE)


def pair(density: float, **fields) -> LatticeBody:
    """A bar of rubber, and a voxel of another density far from it."""
    voxels = np.array([(0, 0, 0), (1, 0, 0), (9, 0, 0)])
    other = dataclasses.replace(RUBBER, density=density)
    return LatticeBody(voxels, (RUBBER, other), np.array([0, 0, 1]), EDGE, **fields)


def test_links_damped_up_to_one_have_the_published_step():
    """1 / (2 pi sqrt(E h / m)), to the last bit."""
    rate = np.sqrt(1e5 * EDGE / (1e3 * EDGE**3))
    for zeta in (0.0, 0.3, 1.0):
        material = dataclasses.replace(RUBBER, internal_damping=zeta)
        assert block(material, 4, 2, 2).recommended_time_step == 1 / (2 * np.pi * rate)


@pytest.mark.parametrize("zeta", [1.001, 1.5, 3.0, 10.0, 1e3])
def test_more_damping_takes_shorter_steps(zeta):
    """L (u^2 + 2 zeta u) is 4, for the L of which it is 4 at zeta = 1 and u = w dt = 1 / (2 pi)."""
    material = dataclasses.replace(RUBBER, internal_damping=zeta)
    usual = 1 / (2 * np.pi)
    step = block(material, 2, 1, 1).recommended_time_step * usual / block(RUBBER, 2, 1, 1).recommended_time_step
    assert step * step + 2 * zeta * step == pytest.approx(usual * usual + 2 * usual, rel=1e-9)
    both = link_step(material, material, EDGE)
    assert link_step(RUBBER, material, EDGE, own=True) == both < link_step(RUBBER, material, EDGE)
    assert link_step(RUBBER, material, EDGE) < link_step(RUBBER, RUBBER, EDGE)


def test_a_light_end_beside_a_heavy_one_takes_shorter_steps():
    """Its damping is up to the square root of 2 times what it has beside its like, but not as published."""
    light = dataclasses.replace(RUBBER, density=10.0)
    alone, beside = link_step(light, light, EDGE), link_step(light, RUBBER, EDGE)
    ratio, usual = np.sqrt(2 * 1000 / 1010), 1 / (2 * np.pi)
    step = beside * usual / alone
    assert step * step + 2 * ratio * step == pytest.approx(usual * usual + 2 * usual, rel=1e-9)
    assert link_step(light, RUBBER, EDGE, own=True) == alone
    body = LatticeBody([(0, 0, 0), (1, 0, 0)], (light, RUBBER), [0, 1], EDGE)
    assert body.recommended_time_step <= beside


def test_a_contact_bounces_no_faster_than_it_came():
    """k dt^2 + c dt is 2: on the floor, and between four heavy voxels that have 2.72 times the effect of one."""
    mass, root = 1e3 * EDGE**3, np.sqrt(1e5 * EDGE * 1e3 * EDGE**3)
    step = floor_step(RUBBER, EDGE)
    assert 2 * 1e5 * EDGE / mass * step**2 + 2 * root / mass * step == pytest.approx(2, rel=1e-12)
    light, step = dataclasses.replace(RUBBER, density=10.0), contact_step(RUBBER, pair(10.0).materials[1], EDGE)
    inverse = 2.72 / (mass / 100) + 1 / mass
    assert inverse * (2 * 1e5 * EDGE * step**2 + 1.1 * root * step) == pytest.approx(2, rel=1e-12)
    assert contact_step(light, RUBBER, EDGE) == step == pair(10.0).recommended_time_step
    assert contact_step(light, RUBBER, EDGE, (True, False)) > 10 * step  # only the heavy one moves
    assert contact_step(light, RUBBER, EDGE, (True, True)) == np.inf


def test_parts_that_weigh_alike_change_nothing():
    """Nor do parts that the world holds, nor light voxels with links, beyond those."""
    for density in (700.0, 1e3, 1250.0):
        assert pair(density).recommended_time_step == block(RUBBER, 2, 1, 1).recommended_time_step
    held = np.zeros((3, 6), bool)
    held[2] = True
    assert pair(10.0, fixed=held).recommended_time_step == pair(1e3).recommended_time_step
    joined = LatticeBody(np.array([(0, 0, 0), (1, 0, 0), (2, 0, 0)]), pair(10.0).materials, [0, 0, 1], EDGE)
    light = dataclasses.replace(RUBBER, density=10.0)
    assert joined.recommended_time_step == link_step(light, RUBBER, EDGE)


@pytest.mark.kernels
@pytest.mark.parametrize("zeta", [1.5, 3.0, 10.0])
@pytest.mark.parametrize("side", [2, 4])
def test_damped_blocks_come_to_rest(zeta, side):
    """Of random velocities nothing remains on the floor; in the air, that of the block as a whole."""
    body = block(dataclasses.replace(RUBBER, internal_damping=zeta), side, side, side)
    thrown = 0.01 * np.random.default_rng(0).normal(size=(1, body.voxel_count, 3))
    for floor, gravity in ((True, GRAVITY), (False, 0.0)):
        engine = LatticeEngine(body, floor=floor, gravity=gravity, time_step=body.recommended_time_step / 1.3)
        start = engine.state()
        engine.set_state(LatticeState(start.positions, start.orientations, thrown, start.angular_velocities))
        energies = [(thrown**2).sum()]
        for _ in range(20):
            assert engine.run(ProgramBuilder(1).build(200)).status == "ok"
            energies.append((engine.state().velocities ** 2).sum())
        assert max(energies) == energies[0]
        assert energies[-1] < (1e-3 if floor else 0.2) * energies[0]


def dropped(body: LatticeBody) -> tuple[float, float]:
    """How high a body that falls by 2 mm is in the end above where it stands [m], and its fastest voxel then [m/s]."""
    engine = LatticeEngine(body, floor=True, gravity=GRAVITY, time_step=body.recommended_time_step / 1.3)
    engine.set_positions(body.start_positions[None] + [0.0, 0.0, 0.002])
    engine.run(ProgramBuilder(1).build(round(0.4 / engine.time_step)))
    end = engine.state()
    return float((end.positions - body.start_positions)[..., 2].max()), float(np.abs(end.velocities).max())


@pytest.mark.kernels
@pytest.mark.parametrize("modulus", [1e5, 1e7, 3e7])
def test_a_stiff_foot_of_a_soft_column_comes_to_rest(modulus):
    """Its contact with the floor is stiffer than any link."""
    foot = dataclasses.replace(RUBBER, youngs_modulus=modulus)
    column = LatticeBody([(0, 0, z) for z in range(3)], (RUBBER, foot), [1, 0, 0], EDGE)
    height, speed = dropped(column)
    assert height < 1e-4 and speed < 1e-9


@pytest.mark.kernels
@pytest.mark.parametrize("damping", [1.0, 8.0, 20.0])
def test_much_damped_contact_throws_nothing_back(damping):
    height, speed = dropped(block(dataclasses.replace(RUBBER, collision_damping=damping), 2, 2, 2))
    assert height < 1e-4 and speed < 1e-5


@pytest.mark.kernels
@pytest.mark.parametrize("ratio", [1.0, 2.5, 5.0])
def test_blocks_damped_against_the_world_come_to_rest(ratio):
    body = block(dataclasses.replace(RUBBER, global_damping=ratio), 4, 4, 4)
    engine = LatticeEngine(body, time_step=body.recommended_time_step / 1.3)
    engine.set_positions(body.scattered(1e-7, 1, [0]))
    engine.run(ProgramBuilder(1).build(2000))
    assert np.abs(engine.state().velocities).max() < 1e-6


@pytest.mark.kernels
@pytest.mark.parametrize("density", [10.0, 100.0])
def test_a_light_voxel_in_a_pit_gains_nothing(density):
    """Dropped on the middle of four heavy ones, it lies still there."""
    voxels = np.array([(0, 0, 0), (0, 1, 0), (1, 0, 0), (1, 1, 0), (9, 0, 0)])
    light = dataclasses.replace(RUBBER, density=density)
    body = LatticeBody(voxels, (RUBBER, light), np.array([0, 0, 0, 0, 1]), EDGE)
    engine = LatticeEngine(body, floor=True, gravity=GRAVITY, time_step=body.recommended_time_step / 1.3)
    positions = body.start_positions[None].copy()
    positions[0, 4] = 0.005, 0.005, 0.013
    engine.set_positions(positions)
    heights = []
    for _ in range(40):
        assert engine.run(ProgramBuilder(1).build(int(0.2 / 40 / engine.time_step))).status == "ok"
        heights.append(engine.state().positions[0, 4, 2])
    assert max(heights) < 0.013
    assert heights[-1] == pytest.approx(EDGE * np.sqrt(1.25**2 - 0.5), abs=2e-5)


@pytest.mark.kernels
@pytest.mark.parametrize("size", [1.0, 1.2, 1.5])
def test_swollen_blocks_afloat_come_to_rest_and_not_with_longer_steps(size):
    """Balanced links turn voxels the more, the longer they are: 1.2 of the step on the ground would do for none."""
    body = block(Material(1e5, 600.0, scale=(size,) * 3), 6, 6, 6)
    assert body.sizes == (size, size)
    turning = []
    for share in (1.0, 1.15):
        step = share * body.stable_time_step(is_afloat=True)
        engine = LatticeEngine(body, fluid=True, self_contact=False, time_step=step, threads=1)
        engine.set_positions(size * body.scattered(1e-5, 1, [0]))
        engine.run(ProgramBuilder(1).build(3000))
        turning.append(np.abs(engine.state().angular_velocities).max())
    assert turning[0] < 1e-5 and turning[1] > 1.0


@pytest.mark.kernels
def test_engines_take_shorter_steps_by_themselves_where_bodies_float():
    small, large = (block(Material(1e5, 600.0, scale=(size,) * 3), 2, 1, 1) for size in (1.0, 1.5))
    for body, share in ((small, 1.2), (large, 2.45)):
        step = body.recommended_time_step
        assert LatticeEngine(body, floor=True).time_step == step == body.stable_time_step(is_afloat=False)
        assert LatticeEngine(body, fluid=True).time_step == step / share == body.stable_time_step(is_afloat=True)
