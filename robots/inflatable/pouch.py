"""The inflatable robot as a lattice robot that feels: waves in its bladders and feet, which its reflexes change.

Its own kind plays strokes from a table and feels nothing. Here the same body swings its bladders as waves, at a core
pressure that stays, so that what it feels may answer while it moves, with exact derivatives.
"""

from dataclasses import replace

from robots.inflatable.actuation import ACTUATION
from robots.inflatable.body import BLADDER_COUNT, BLADDER_REGIONS, FOOT_REGIONS, SKIN_REGIONS, InflatableGeometry
from robots.inflatable.layout import check_every_bladder
from robots.lattice_robot.drive import Drive, Free
from robots.lattice_robot.reflexes import Reflexes
from robots.lattice_robot.robot import LatticeRobot
from taichi_sim.base import checks
from taichi_sim.lattice import LatticeBody

SWING = 0.75 * (1.0 - ACTUATION.deflated)  # most of a wave, about a voxel's own thickness
GAIN = SWING / 3  # most by which reflexes change it: together they deflate a bladder


def feeling_pouch(
    geometry: InflatableGeometry,
    pressure: float = 0.0,
    reflexes: Reflexes | None = None,
    frequency: float = 2.0,
    cycles: int = 3,
    settling: float = 0.1,
    name: str = "pouch",
) -> LatticeRobot:
    """The robot of a geometry and a core pressure [Pa], with free waves and free weights of its reflexes.

    Bladders are built as thick as a voxel, at which they fit the skin, and swing about that, until they are deflated at
    most. As they thicken they grow along and across the pouch, by as much as in the published experiment at this
    pressure, where they fit the skin when they are deflated. The friction of either foot swings between none and the
    published one. Bladders weigh, and only the floor resists motion.

    Args:
        geometry: shape and materials; of one core, closed if it is under pressure.
        pressure: of the core [Pa], which is reached when the robot has settled.
        reflexes: what it feels and answers; by default strain, touch, tilt, velocity and the time, linearly.
        frequency: of all waves [Hz].
        cycles: of a trial.
        settling: time on the floor before waves begin [s].
        name: for people.

    Raises:
        ValueError: for several cores, a body that lacks a bladder, and pressures that are no numbers of at least 0, or
            not 0 in a geometry that is not closed: by the law of faces a body whose regions differ in size drives
            itself along.
    """
    if geometry.cores > 1:
        raise ValueError(f"cores: {geometry.cores} is not allowed; give a geometry of one core")
    check_every_bladder(geometry.bladders, "in a robot whose waves drive eight")
    checks.number("pressure", pressure, low=0.0, unit="Pa")
    if pressure > 0 and not geometry.closed:
        raise ValueError(
            f"pressure: {pressure:g} is not allowed in a geometry that is not closed; give a closed one, or 0"
        )
    count, bladders = BLADDER_COUNT, tuple(BLADDER_REGIONS.tolist())
    across, along, through = ACTUATION.growth(pressure)
    swelling = Drive(
        "bladder",
        bladders,
        amplitude=(Free(0.0, SWING),) * count,
        phase=tuple(Free(0.0, 1.0, (number + 0.5) / count) for number in range(count)),  # apart, as a wave
        axes="zyx",
        proportions=(through, along, across),
    )
    half = ACTUATION.high_friction / 2
    feet = Drive(
        "foot",
        tuple(FOOT_REGIONS.tolist()),
        "friction",
        mean=half,
        amplitude=(Free(0.0, half),) * len(FOOT_REGIONS),
        phase=(Free(0.0, 1.0, 0.25), Free(0.0, 1.0, 0.75)),
    )
    core = (Drive("core", tuple(SKIN_REGIONS.tolist()), "pressure", mean=pressure),) if pressure > 0 else ()
    return LatticeRobot(
        _body(geometry),
        (swelling, feet, *core),
        frequency=frequency,
        cycles=cycles,
        settling=settling,
        name=name,
        reference_length=geometry.body_length,
        reflexes=reflexes or Reflexes(gain=GAIN),
    )


def _body(geometry: InflatableGeometry) -> LatticeBody:
    """The body of a geometry with the published friction."""
    *skin, bladder = geometry.body.materials
    grip, slip = ACTUATION.high_friction, ACTUATION.friction_of_bladders
    skins = [replace(each, static_friction=grip, kinetic_friction=grip) for each in skin]
    return geometry.body.with_materials([*skins, replace(bladder, static_friction=slip, kinetic_friction=slip)])
