"""Arguments of laws: the slots that a stage reads them from, and its reverse pass adds their cotangents to."""

from typing import Any

from taichi_sim.autodiff.tracing import primitive
from taichi_sim.rigid import slots
from taichi_sim.rigid.memory import Block, Pieces, body_at, count_of, given_at, listed_in_plan, parent_at, patch_at


@primitive
def carrier_slots(robots: Block, b: Any) -> Pieces:
    """Slots for ``hinged_place`` and ``welded_place``: the parent's rotation and place, anchor and centre."""
    parent, given = parent_at(robots, b), given_at(robots, b)
    return (parent + slots.ROTATION, 9), (parent + slots.PLACE, 3), (given + slots.ANCHOR, 3), (given + slots.CENTRE, 3)


@primitive
def moving_slots(robots: Block, b: Any) -> Pieces:
    """Slots for ``carried_on``: mass and inertia, rotation, place, drift, own place, velocity."""
    places = ((slots.ROTATION, 9), (slots.PLACE, 3), (slots.DRIFT, 3), (slots.OWN, 3), (slots.VELOCITY, 6))
    return _of_body(robots, b, places)


@primitive
def body_slots(robots: Block, b: Any) -> Pieces:
    """Slots for ``prepared``: mass and inertia, rotation, place, carried, drift."""
    places = ((slots.ROTATION, 9), (slots.PLACE, 3), (slots.CARRIED, 6), (slots.DRIFT, 3))
    return _of_body(robots, b, places)


def _of_body(robots: Block, b: Any, places: Pieces) -> Pieces:
    """Mass and inertia of a body, and slots of its own."""
    body = body_at(robots, b)
    return ((given_at(robots, b) + slots.MASS, 7), *((body + first, width) for first, width in places))


@primitive
def shifted_slots(robots: Block, b: Any) -> Pieces:
    """Slots for ``moment_shift`` before the common motion: mass, place, momentum."""
    body, mass = body_at(robots, b), given_at(robots, b) + slots.MASS
    return (mass, 1), (body + slots.PLACE, 3), (body + slots.CARRIED + 3, 3)


@primitive
def contact_slots(robots: Block, b: Any, i: Any) -> Pieces:
    """Slots for ``contact_work`` before the adjoint motion: pose, drift, the point, the base's height, velocity.

    On uneven ground, where the law is another, the base's place instead of its height; on sand the surface that belongs
    to the point comes first.
    """
    body, point = body_at(robots, b), count_of(robots, slots.POINT_PARAMETER) + i * slots.POINT_PARAMETER_WIDTH
    pose = (body + slots.ROTATION, 9), (body + slots.PLACE, 3), (body + slots.DRIFT, 3)
    base = (slots.POSITION + 2, 1) if robots.ground is None else (slots.POSITION, 3)
    surface = ((patch_at(robots, i), slots.PATCH_WIDTH),) if robots.granular else ()
    return (*surface, *pose, (point, slots.POINT_PARAMETER_WIDTH), base, (body + slots.VELOCITY, 6))


@primitive
def eye_slots(robots: Block, s: Any) -> Pieces:
    """Slots for ``light_reading``: the base's place, the body's rotation and place, the sensor's offset, the light."""
    body = body_at(robots, listed_in_plan(robots, slots.EYES, s))
    offset = count_of(robots, slots.LIGHT_PARAMETER) + s * slots.LIGHT_PARAMETER_WIDTH
    return (slots.POSITION, 3), (body + slots.ROTATION, 9), (body + slots.PLACE, 3), (offset, 3), (slots.LIGHT, 3)


@primitive
def hinge_slots(robots: Block, b: Any) -> Pieces:
    """Slots for ``hinge_row``: the angle; the last rate; parameters of the motor, the stops and what acts besides."""
    body = body_at(robots, b)
    return (body + slots.ANGLE, 1), (body + slots.LAST_RATE, 1), (given_at(robots, b) + slots.TORQUE, 13)
