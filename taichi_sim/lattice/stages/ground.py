"""How the ground acts on a voxel that touches it, before it is decided whether it sticks: one way forwards and back.

All is in the ground's axes. See ``momentum`` for who decides, and for the reverse.
"""

from typing import Any, NamedTuple

from taichi_sim.autodiff.lanes import variables
from taichi_sim.autodiff.tracing import primitive, select
from taichi_sim.ground import laws as uneven
from taichi_sim.lattice.laws import floor, motion
from taichi_sim.runtime import emit


class Sand(NamedTuple):
    """Ground that yields under a voxel.

    Attributes:
        limit: stress per depth at which it yields.
        pressed: how deep the voxel had pressed it.
        turn: orientation of the voxel.
        sides: its wet sides.
        normal: normal of the ground.
    """

    limit: Any
    pressed: Any
    turn: Any
    sides: Any
    normal: Any


@primitive
def borne(depth: Any, size: Any, stiffness: Any, sand: Sand) -> Any:
    """What sand bears of a voxel, what it could bear at most, and how deep the voxel has pressed it now."""
    below = emit(uneven.outer_share(*sand.turn, *(0.0 - n for n in sand.normal), *sand.sides))
    return variables(uneven.giving_way(size, depth, sand.pressed, stiffness, sand.limit, below))


@primitive
def ploughed(px: Any, py: Any, friction: Any, depth: Any, size: Any, sand: Sand) -> Any:
    """Force with which sand holds a voxel of such a momentum along it, whose friction is so great."""
    ahead = emit(uneven.leading_share(px, py, *sand.turn, *sand.normal, *sand.sides))
    return emit(uneven.granular_hold(friction, size, depth, sand.limit, ahead))


class Slide(NamedTuple):
    """What a voxel on the ground does in a step if it slides, in the ground's axes.

    Attributes:
        momentum: of the voxel after the step.
        pull: force along the ground of all but its friction.
        friction: that of the ground.
        bears: force by which coefficients of friction are multiplied.
        free: momentum along the ground without it, and the momentum that it takes at most; of sand, else empty.
        pressed: how deep the voxel has pressed the ground now, of sand.
    """

    momentum: Any
    pull: Any
    friction: Any
    bears: Any
    free: Any
    pressed: Any


@primitive
def slide(
    momentum: Any, force: Any, inverse_mass: Any, depth: Any, bearing: Any, sticks: Any, dt: Any, sand: Any = ()
) -> Slide:
    """What a voxel does that is so deep in the ground, in its axes, before it is decided whether it sticks.

    ``force`` is that of all but the ground, ``bearing`` the voxel's size, stiffness, damping and kinetic friction, and
    ``sticks`` whether it stuck before; ``sand`` is a :class:`Sand` or, of ground that does not yield, empty.
    """
    px, py, pz = momentum
    fx, fy, fz = force
    size, stiffness, damping, friction = bearing
    free: Any = ()
    pressed: Any = ()
    if sand:
        bears, most, pressed = borne(depth, size, stiffness, sand)
        qx, qy = variables((px + fx * dt, py + fy * dt))
        push = uneven.granular_push(bears, most, pz * inverse_mass, damping, sand.limit)
        fz = emit(fz + select(depth >= 0.0, push, 0.0))
        hold = ploughed(qx, qy, emit(friction * bears), depth, size, sand)
        free, presses = (qx, qy, emit(hold * dt)), 1.0 + 0.0 * bears
    else:
        fz, bears = variables(floor.floor_force(fz, pz * inverse_mass, depth, stiffness, damping))
        hold, presses = friction, bears
    rubs = variables(floor.slip_friction(px * inverse_mass, py * inverse_mass, hold, presses, depth, sticks))
    moves = variables(motion.accelerated(px, py, pz, fx + rubs[0], fy + rubs[1], fz, dt))
    return Slide(moves, (fx, fy), rubs, bears, free, pressed)


@primitive
def slid(found: Slide, stuck: Any, sand: Any = ()) -> Any:
    """Momentum along the ground of a voxel that slides or, as is given, sticks; and whether sand lets it stick."""
    px, py, _ = found.momentum
    return variables(uneven.slid(px, py, stuck, *found.free, sand.limit)) if sand else (px, py, stuck)
