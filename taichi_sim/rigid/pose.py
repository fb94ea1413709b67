"""Poses and velocities of all bodies from those of the base and the hinges, on NumPy arrays.

Those of poses may be traced (``taichi_sim.autodiff.arrays``).
"""

from typing import Any

import numpy as np

from taichi_sim.autodiff import rotations
from taichi_sim.autodiff.tracing import Traced
from taichi_sim.base.arrays import Floats
from taichi_sim.rigid.model.tree import Hinge, Tree


def rotation_matrix(quaternion: Floats) -> Floats:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    return np.stack(rotations.matrix(*np.moveaxis(quaternion, -1, 0)), -1).reshape(*quaternion.shape[:-1], 3, 3)


def _array(given: Any) -> Any:
    """An array of what is given, unless it is traced."""
    return given if isinstance(given, Traced) else np.asarray(given, float)


def _about(axis: Floats, angle: Floats) -> Floats:
    """Quaternions about an axis (..., 3)."""
    half = angle[..., None] / 2
    return np.concatenate([np.cos(half), np.sin(half) * axis], -1)


def _product(a: Floats, b: Floats) -> Floats:
    return np.stack(rotations.multiply(*np.moveaxis(a, -1, 0), *np.moveaxis(b, -1, 0)), -1)


def poses(tree: Tree, position: Floats, orientation: Floats, angles: Floats) -> tuple[Floats, Floats]:
    """Compute the poses of all bodies of a robot, in the order of ``tree.ordered``, from its base and hinges.

    Args:
        tree: the robot.
        position: position of the base's centre, (..., 3) [m].
        orientation: orientation of the base, unit quaternions (w, x, y, z), (..., 4).
        angles: angles of the H hinges, (..., H) [rad].

    Returns:
        Centres (..., bodies, 3) [m] and unit quaternions (..., bodies, 4).
    """
    places, turns = [_array(position)], [_array(orientation)]
    hinge = 0
    for n, (body, joint) in enumerate(tree.ordered[1:], 1):
        parent = tree.parents[n]
        of_parent = rotation_matrix(turns[parent])
        centre, before = np.array(body.position, float), np.array(tree.ordered[parent][0].position, float)
        if isinstance(joint, Hinge):
            anchor = np.array(joint.anchor, float)
            axis = of_parent @ (np.array(joint.axis, float) / np.linalg.norm(joint.axis))
            turns.append(_product(_about(axis, _array(angles)[..., hinge]), turns[parent]))
            places.append(
                places[parent] + of_parent @ (anchor - before) + rotation_matrix(turns[n]) @ (centre - anchor)
            )
            hinge += 1
        else:
            turns.append(turns[parent])
            places.append(places[parent] + of_parent @ (centre - before))
    return np.stack(places, -2), np.stack(turns, -2)


def velocities(tree: Tree, places: Floats, turns: Floats, base: Floats, rates: Floats) -> Floats:
    """Velocities of all bodies from those of the base and the hinges' rates.

    Args:
        tree: the robot.
        places: centres of all bodies, (..., bodies, 3) [m].
        turns: their orientations, (..., bodies, 4).
        base: angular velocity of the base and velocity of its centre, (..., 6) [rad/s, m/s].
        rates: of the hinges, (..., H) [rad/s].

    Returns:
        The same of all bodies, (..., bodies, 6).
    """
    found = [np.asarray(base, float)]
    hinge = 0
    for n, (_, joint) in enumerate(tree.ordered[1:], 1):
        parent = tree.parents[n]
        angular, arm = found[parent][..., :3], places[..., n, :] - places[..., parent, :]
        linear = found[parent][..., 3:] + np.cross(angular, arm)
        if isinstance(joint, Hinge):
            turned = rotation_matrix(turns[..., parent, :])
            before = np.array(tree.ordered[parent][0].position, float)
            anchor = places[..., parent, :] + turned @ (np.array(joint.anchor, float) - before)
            spin = turned @ (np.array(joint.axis, float) / np.linalg.norm(joint.axis)) * rates[..., hinge, None]
            angular = angular + spin
            linear = linear + np.cross(spin, places[..., n, :] - anchor)
            hinge += 1
        found.append(np.concatenate([angular, linear], -1))
    return np.stack(found, -2)


def momenta(tree: Tree, places: Floats, turns: Floats, moving: Floats) -> Floats:
    """Moments of momentum about the base's centre, and momenta, of all bodies.

    Args:
        tree: the robot.
        places: centres of all bodies, (..., bodies, 3) [m].
        turns: their orientations, (..., bodies, 4).
        moving: their velocities, angular, then linear, (..., bodies, 6) [rad/s, m/s].

    Returns:
        (..., bodies, 6) [N m s, N s].
    """
    at_rest = np.array([body.inertia for body, _ in tree.ordered])
    turned = rotation_matrix(turns)
    momentum = tree.masses[:, None] * moving[..., 3:]
    local = np.einsum("...ji,...j->...i", turned, moving[..., :3])
    spin = np.einsum("...ij,...jk,...k->...i", turned, at_rest, local)
    arms = places - places[..., :1, :]
    return np.concatenate([spin + np.cross(arms, momentum), momentum], -1)
