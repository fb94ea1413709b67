"""What sand bears of the points of rigid bodies, and how they plough: beside closed forms and sums over surfaces."""

import math

import numpy as np
import pytest
from sand_surface import SOLIDS, of_point, of_solid, whole
from scipy.spatial.transform import Rotation

from taichi_sim.rigid import Box, Capsule, Sphere
from taichi_sim.rigid.stages.sand import buried_surface

DOWN, AHEAD = np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])
UPRIGHT = np.eye(3)


def turned(axis: str, degrees: float) -> np.ndarray:
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()


LYING = turned("x", 90)  # along y, across the way ahead


def ours(solid, number, rotation, depth, way=AHEAD):
    """What a point bears and how it ploughs, by the laws of the simulation."""
    radius, patch = solid.points()[number][1], solid.patches()[number]
    numbers = (
        *patch.ball,
        patch.length,
        *patch.axis,
        *patch.edges,
        radius,
        *rotation.ravel(),
        depth,
        0.0,
        0.0,
        1.0,
        *way,
    )
    return np.array(buried_surface(*map(np.asarray, numbers)))


@pytest.mark.parametrize("solid", SOLIDS.values(), ids=SOLIDS)
def test_laws_are_the_plain_formulas_of_the_oracle(solid):
    """At random depths, turns and ways."""
    rng = np.random.default_rng(0)
    for rotation in Rotation.random(20, random_state=1).as_matrix():
        depth, turn = rng.uniform(0, 0.4), rng.uniform(0, 2 * math.pi)
        way = np.array([math.cos(turn), math.sin(turn), 0.0])
        for number in range(len(solid.points())):
            plain = [of_point(solid, number, rotation, depth, each) for each in (DOWN, way)]
            assert ours(solid, number, rotation, depth, way) == pytest.approx(plain, rel=1e-7, abs=1e-10)


@pytest.mark.parametrize(
    ("solid", "rotation", "tolerance"),
    [
        (Sphere(0.1), UPRIGHT, 5e-3),
        (Box((0.4, 0.2, 0.1)), UPRIGHT, 1e-9),
        (Box((0.4, 0.2, 0.1)), turned("y", 30), 3e-3),
        (Box((0.4, 0.2, 0.1)), turned("y", -70), 3e-3),
        (Capsule(0.05, 0.3), UPRIGHT, 5e-3),
        (Capsule(0.05, 0.3), LYING, 1e-3),
        (Capsule(0.05, 0.3), turned("y", 90), 1e-3),
    ],
    ids=["ball", "level box", "box at 30", "box at 70", "upright capsule", "lying capsule", "capsule ahead"],
)
@pytest.mark.parametrize("depth", [0.02, 0.045, 0.09, 0.3, 0.7])
def test_what_belongs_to_points_adds_up_to_the_whole_surface(solid, rotation, tolerance, depth):
    """Exactly, of a ball, a box that is level or tilted about an edge across the way, and capsules along the axes."""
    for way in (DOWN, AHEAD):
        assert of_solid(solid, rotation, depth, way) == pytest.approx(whole(solid, rotation, depth, way), rel=tolerance)


@pytest.mark.parametrize("depth", [0.03, 0.1, 0.4])
def test_what_belongs_to_points_of_tilted_solids_is_nearly_that(depth):
    """A box with one corner in the ground has up to half as much again; a capsule 15 % less to 30 % more."""
    for solid, rotation, most in (
        (SOLIDS["box"], Rotation.from_euler("xyz", [30, 40, 10], degrees=True).as_matrix(), 1.52),
        (SOLIDS["capsule"], turned("x", 45), 1.3),
        (SOLIDS["capsule"], turned("x", 20), 1.3),
    ):
        for way in (DOWN, AHEAD):
            assert 0.85 < of_solid(solid, rotation, depth, way) / whole(solid, rotation, depth, way) < most


def test_closed_forms():
    """Of a ball, less and more than half buried, of a level box, and of a lying cylinder that is half buried."""
    r = 0.1
    for depth in (0.03, 0.1, 0.17, 0.3):
        c = 1 - depth / r
        bears = math.pi * r**3 / 6 * (3 - 4 * c + max(c, 0) ** 4)
        below = max(c, -1.0)
        ploughs = math.pi * r**3 / 2 * (0.25 - 2 * below / 3 + below**2 / 2 - below**4 / 12 + 4 / 3 * (below - c))
        assert ours(Sphere(r), 0, UPRIGHT, depth) == pytest.approx((bears, ploughs), rel=1e-12)
    box = Box((0.4, 0.2, 0.1))
    corners = np.array([ours(box, n, UPRIGHT, 0.06) for n in range(8) if box.points()[n][0][2] < 0])
    assert corners.sum(0) == pytest.approx([0.4 * 0.2 * 0.06, 0.2 * 0.06**2 / 2], rel=1e-14)
    rod = Capsule(0.05, 0.3)
    lying = np.sum([ours(rod, n, LYING, 0.05) for n in range(2)], axis=0)
    ball = np.array(ours(Sphere(0.05), 0, LYING, 0.05))
    assert lying - ball == pytest.approx([0.3 * 0.05**2 * 4 / 3, 0.3 * 0.05**2 / 3], rel=1e-7)


def test_surfaces_grow_smoothly_from_nothing():
    """So derivatives see a foot touch down: neither a jump nor, in the ground, a kink of what bears a level solid."""
    for solid, rotation in ((SOLIDS["ball"], UPRIGHT), (SOLIDS["box"], UPRIGHT), (SOLIDS["capsule"], LYING)):
        depths = np.linspace(0, 0.4, 4001)
        found = ours(solid, len(solid.points()) - 1, rotation, depths)
        assert (found[:, 0] == 0).all() and (np.diff(found) >= -1e-18).all()
        slopes = np.diff(found[0]) / np.diff(depths)
        assert np.abs(np.diff(slopes)).max() < 0.05 * slopes.max()
