"""Scale bodies of a robot: each uniformly about the joint that carries it, and with what it carries at its joints."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from taichi_sim.base.arrays import Floats
from taichi_sim.rigid.model.shapes import Box, Capsule, Solid
from taichi_sim.rigid.model.tree import Body, Hinge, Tree


def scaled_tree(tree: Tree, factors: Sequence[float]) -> Tree:
    """Scale the bodies of a tree by a factor each; masses go by its cube and inertias by its fifth power.

    A body is scaled about the anchor of its hinge, or else about the origin of its own frame, which stays where its
    carrier, scaled, has it. Drives and stops stay as they are. Where all factors are 1 the tree is returned itself.
    Else a free tree is raised or lowered until its lowest point is as far above the ground, z = 0, as before.

    Args:
        tree: the robot.
        factors: of the bodies in the order of ``tree.ordered``.

    Raises:
        ValueError: for sizes that no body can have.
    """
    sizes = np.array(factors, float)
    if (sizes == 1).all():
        return tree
    pivots, centres = _moved(tree, sizes)
    if not tree.fixed and tree.points():
        rise = np.array([0.0, 0.0, _lowest(tree, _centres(tree), np.ones(len(sizes))) - _lowest(tree, centres, sizes)])
        pivots, centres = pivots + rise, centres + rise
    bodies, joints = list(tree.bodies), {joint.child: joint for joint in tree.joints}
    for n, (body, joint) in enumerate(tree.ordered):
        bodies[tree.order[n]] = _scaled(body, float(sizes[n]), centres[n])
        if isinstance(joint, Hinge):
            joints[joint.child] = replace(joint, anchor=pivots[n])
    return Tree(bodies, list(joints.values()), tree.fixed)


def _centres(tree: Tree) -> Floats:
    """Centres of mass at rest, (bodies, 3) [m]."""
    return np.array([body.position for body, _ in tree.ordered], float)


def _moved(tree: Tree, sizes: Floats) -> tuple[Floats, Floats]:
    """Where the points that bodies are scaled about, and the centres of mass, come to lie, (bodies, 3) each [m]."""
    centres = _centres(tree)
    pivots = np.array(
        [
            joint.anchor if isinstance(joint, Hinge) else centres[n] + np.array(body.frame, float)
            for n, (body, joint) in enumerate(tree.ordered)
        ],
        float,
    )
    moved = pivots.copy()
    for n, parent in enumerate(tree.parents):
        if n:
            moved[n] = moved[parent] + sizes[parent] * (pivots[n] - pivots[parent])
    return moved, moved + sizes[:, None] * (centres - pivots)


def _lowest(tree: Tree, centres: Floats, sizes: Floats) -> float:
    """Height of the lowest point [m], with bodies of these sizes at these centres."""
    return min(float(centres[n, 2] + sizes[n] * (centre[2] - radius)) for n, centre, radius in tree.points())


def _scaled(body: Body, size: float, centre: Floats) -> Body:
    shapes, immersed = ([_solid(each, size) for each in solids] for solids in (body.shapes, body.immersed))
    return Body(
        body.name,
        centre,
        body.mass * size**3,
        shapes,
        np.asarray(body.inertia) * size**5,
        immersed,
        size * np.array(body.frame, float),
    )


def _solid(solid: Solid, size: float) -> Solid:
    centre = size * np.array(solid.centre, float)
    if isinstance(solid, Box):
        return replace(solid, size=size * np.array(solid.size, float), centre=centre)
    if isinstance(solid, Capsule):
        return replace(solid, radius=size * solid.radius, length=size * solid.length, centre=centre)
    return replace(solid, radius=size * solid.radius, centre=centre)
