"""Laws of water around rigid bodies in plain Python: potentials, closed forms, and what adds up."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from taichi_sim.rigid import Box, Capsule, Sphere
from taichi_sim.rigid.pose import rotation_matrix
from taichi_sim.rigid.stages.water import own_motion, water_on

LOWER = np.tril_indices(3)
LEVEL, WEIGHT = 0.3, 9810.0
SOLIDS = {
    "ball": Sphere(0.1, (0.02, 0.0, 0.01)),
    "box": Box((0.3, 0.2, 0.1)),
    "capsule": Capsule(0.05, 0.3, (1.0, 0.5, 0.2)),
}


def turned(rng: np.random.Generator) -> np.ndarray:
    quaternion = rng.normal(size=4)
    return rotation_matrix(quaternion / np.linalg.norm(quaternion))


def buoyancy(part, rotation: np.ndarray, place: np.ndarray, base: float) -> np.ndarray:
    """Moment about the common point and force of the water on a portion at rest [N m, N]."""
    own = *part.centre, *part.spread[LOWER], part.volume, float(part.is_ball), *np.zeros(6)
    still = *rotation.ravel(), *place, *np.zeros(3), base, *np.zeros(6)
    at, matrix, impulse, moment = water_on(*own, *still, LEVEL, WEIGHT, 0.0, 0.0, 1.0, 0.0, False)
    assert not np.any(matrix)
    return np.concatenate([np.cross(at, impulse) + moment, impulse])


def potential(part, rotation: np.ndarray, place: np.ndarray, base: float) -> float:
    """Work that it takes to bring a portion down from above the water [J]."""
    depth = LEVEL - base - place[2] - (rotation @ part.centre)[2]
    reach = math.sqrt((rotation @ part.spread @ rotation.T)[2, 2])
    s = np.clip((1 + depth / reach) / 2, 0, 1)
    integral = s**3 * (2 - s) if part.is_ball else s * s
    return WEIGHT * part.volume * (reach * integral + max(depth - reach, 0.0))


def about(axis: np.ndarray, angle: float) -> np.ndarray:
    return rotation_matrix(np.array([math.cos(angle / 2), *(math.sin(angle / 2) * axis)]))


@pytest.mark.parametrize("solid", SOLIDS.values(), ids=SOLIDS)
def test_buoyancy_is_the_slope_of_a_potential(solid):
    """By height and by turns about the common point, of portions that are cut by the surface, in any pose."""
    rng, step, cut = np.random.default_rng(0), 1e-6, 0
    for part in solid.portions() * 3:
        rotation, place = turned(rng), rng.normal(scale=0.1, size=3)
        base = LEVEL - place[2] - (rotation @ part.centre)[2] + rng.uniform(-0.7, 0.7) * math.sqrt(part.spread[2, 2])
        found = buoyancy(part, rotation, place, base)
        cut += 0 < found[5] < WEIGHT * part.volume
        slopes = []
        for axis in np.eye(3):
            turns = about(axis, step), about(axis, -step)
            high, low = (potential(part, turn @ rotation, turn @ place, base) for turn in turns)
            slopes.append((high - low) / (2 * step))
        high, low = (potential(part, rotation, place, base + side * step) for side in (1, -1))
        expected = -np.array([*slopes, 0.0, 0.0, (high - low) / (2 * step)])
        assert found == pytest.approx(expected, rel=1e-6, abs=1e-6)
    assert cut > 2


def test_a_ball_displaces_its_cap_and_a_level_box_what_is_below():
    """Whatever the depth, and the box in all its blocks."""
    place = np.zeros(3)
    for depth in np.linspace(-0.09, 0.09, 7):
        (ball,) = Sphere(0.1).portions()
        height = 0.1 + depth
        cap = math.pi * height**2 * (0.1 - height / 3)
        assert buoyancy(ball, np.eye(3), place, LEVEL - depth)[5] == pytest.approx(WEIGHT * cap, rel=1e-12)
        blocks = [buoyancy(each, np.eye(3), place, LEVEL - depth) for each in Box((0.4, 0.3, 0.2)).portions()]
        assert np.sum(blocks, axis=0) == pytest.approx([0, 0, 0, 0, 0, WEIGHT * 0.12 * height], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("solid", SOLIDS.values(), ids=SOLIDS)
def test_portions_have_the_volume_centre_and_spread_of_their_solid(solid):
    """Its inertia with a mass of its volume, less that of their centres, is that of their spreads."""
    parts, centre = solid.portions(), np.array(solid.centre)
    volumes = np.array([part.volume for part in parts])
    assert volumes.sum() == pytest.approx(solid.volume)
    assert volumes @ [part.centre for part in parts] == pytest.approx(solid.volume * centre, abs=1e-15)
    second = np.zeros((3, 3))
    for part in parts:
        spread = part.spread * (3 / 5 if part.is_ball else 1.0)  # a ball's is that of its radius
        second += part.volume * (spread / 3 + np.outer(part.centre - centre, part.centre - centre))
    inertia = np.trace(second) * np.eye(3) - second
    assert inertia == pytest.approx(solid.inertia(solid.volume), rel=1e-9, abs=1e-12)


def surface(solid: Capsule, count: int = 200) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of a capsule along x, outward normals and areas."""
    r, half, around = solid.radius, solid.length / 2, (np.arange(count) + 0.5) * 2 * math.pi / count
    out = np.column_stack([0 * around, np.cos(around), np.sin(around)])
    places, normals, areas = [], [], []
    for x in (np.arange(count) + 0.5) / count * solid.length - half:
        places.append(r * out + [x, 0, 0])
        normals.append(out)
        areas.append(np.full(count, solid.length / count * 2 * math.pi * r / count))
    for tilt in (np.arange(count) + 0.5) * math.pi / 2 / count:
        for side in (-1, 1):
            normal = math.sin(tilt) * out + [side * math.cos(tilt), 0, 0]
            places.append(r * normal + [side * half, 0, 0])
            normals.append(normal)
            areas.append(np.full(count, r**2 * math.sin(tilt) * math.pi / 2 / count * 2 * math.pi / count))
    return np.concatenate(places), np.concatenate(normals), np.concatenate(areas)


@pytest.mark.parametrize(("radius", "share"), [(0.02, 0.95), (0.05, 0.98), (0.1, 1.04)])
@pytest.mark.parametrize("end", [0.0, -0.5], ids=["about its middle", "about its end"])
def test_pressure_slows_a_turning_rod_as_its_surface_says(radius, share, end):
    """Its portions have the faces that are theirs: tips with a quarter of all would give 1.5 times the moment."""
    rod = Capsule(radius, 1.0, (1.0, 0.0, 0.0))
    places, normals, areas = surface(rod)
    moving = np.cross([0.0, 0.0, 1.0], places - [end, 0, 0])
    along = (moving * normals).sum(axis=1)
    force = (0.5 * areas * along * np.abs(along))[:, None] * normals  # half on each side, as for lattice robots
    expected = np.cross(places - [end, 0, 0], force)[:, 2].sum()
    found = 0.0
    for part in rod.portions():
        arm = part.centre - [end, 0, 0]
        speed = np.cross([0.0, 0.0, 1.0], arm)
        found += np.cross(arm, np.linalg.norm(speed) * part.faces.pressure @ speed)[2]
    assert found / expected == pytest.approx(share if end == 0 else 1.0, abs=0.03)


@pytest.mark.parametrize("scale", [1.0, 1e-13])
def test_own_motion_is_that_of_the_momentum(scale):
    """However small the body."""
    rng = np.random.default_rng(1)
    rotation, place, spin, velocity = turned(rng), *rng.normal(size=(3, 3))
    half = rng.normal(size=(3, 3))
    mass, inertia = 0.7, scale * (half @ half.T + np.eye(3))
    momentum = mass * velocity
    at_rest = 0.0 * place if scale < 1 else place  # the moment of the momentum would drown the spin's
    angular = rotation @ inertia @ rotation.T @ spin + np.cross(at_rest, momentum)
    given = mass, *inertia[LOWER], *rotation.ravel(), *at_rest, *angular, *momentum
    assert own_motion(*given, False, 0.0) == pytest.approx([*spin, *velocity], rel=1e-9)
    assert own_motion(*given, True, 2e-3) == pytest.approx([*angular, *momentum])


def test_own_motion_is_that_in_the_pose_of_the_step_before():
    """To the fourth order of the step: the angular velocity that the body had before it turned on."""
    rng = np.random.default_rng(2)
    rotation, spin = turned(rng), rng.normal(size=3)
    half = rng.normal(size=(3, 3))
    inertia = half @ half.T + np.eye(3)
    momentum = rotation @ inertia @ rotation.T @ spin

    def error(step):
        now = Rotation.from_rotvec(step * spin).as_matrix() @ rotation
        found = own_motion(1.0, *inertia[LOWER], *now.ravel(), *np.zeros(3), *momentum, *np.zeros(3), False, step)
        return np.abs(found[:3] - spin).max()

    assert error(0.02) < 1e-3 and error(0.02) == pytest.approx(16 * error(0.01), rel=0.2)
