"""What of a lattice robot is allowed, but likely a mistake: lengths in other units, phases in degrees, loose parts."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from robots.lattice_robot.channels import rests
from robots.lattice_robot.drive import Free
from robots.lattice_robot.faults import SMALLEST as SMALLEST_SIZE
from robots.lattice_robot.reach import reached_sizes
from robots.world import Terrain

if TYPE_CHECKING:
    from robots.lattice_robot.robot import LatticeRobot

SMALLEST, LARGEST = 1e-3, 10.0  # longest side of robots [m]
SOFTEST, STIFFEST = 100.0, 1e12  # Young's moduli [Pa]; jelly has some 1000, diamond 1e12
LIGHTEST, DENSEST = 20.0, 25_000.0  # densities [kg/m^3]; foams have 20 or more, platinum and iridium 22,000
LEAST_SCALE, MOST_SCALE = 0.7, 1.4  # rest sizes of materials [edges], whose voxels all start with an edge of 1
MOST_UNLIKE = 2.5  # largest over smallest rest size; beyond, links that are not balanced may feed bodies energy
MOST_STIFF = 1e4  # square of how far sizes of neighbours differ, times modulus over the weight of a column of an edge
MANY_CYCLES = 10.0  # phases grow along a body that waves travel through, but hardly to this


def doubts_of(robot: "LatticeRobot") -> tuple[str, ...]:
    """Likely mistakes of a robot, one line each that names the field and its unit."""
    each = _of_size, _of_parts, _of_materials, _of_drives, _of_phases, _of_reach
    return tuple(doubt for doubts in each for doubt in doubts(robot))


def doubts_on(robot: "LatticeRobot", terrain: Terrain) -> tuple[str, ...]:
    """Likely mistakes of a robot on a terrain, one line each: feet that nothing holds, and walls that fall over."""
    return *_of_feet(robot, terrain), *_of_width(robot, terrain)


def _of_width(robot: "LatticeRobot", terrain: Terrain) -> Iterator[str]:
    """Bodies that stand upright on a row of single voxels, with nothing that holds them in its plane."""
    body = robot.body
    if terrain.is_wet or robot.placed is not None or np.asarray(body.fixed).any() or np.ptp(body.voxels[:, 2]) == 0:
        return
    for axis, name in enumerate("xy"):
        if np.ptp(body.voxels[:, axis]) == 0:
            held = "hold all voxels in its plane with fixed, or make it two wide"
            yield f"voxels: {robot.name} is one voxel wide along {name} and stands upright, so it may fall over; {held}"
            return


def _of_feet(robot: "LatticeRobot", terrain: Terrain) -> tuple[str, ...]:
    used = [robot.body.materials[n] for n in np.unique(np.asarray(robot.body.material_index))]
    driven = any(drive.quantity == "friction" for drive in robot.drives)
    slippery = not (driven or any(material.static_friction for material in used)) and not terrain.is_wet
    if (
        not slippery
        or np.asarray(robot.body.fixed).any()
        or terrain.static_friction is not None
        or terrain.high_friction is not None
    ):
        return ()
    told = f"no material of {robot.name} has any, so it slides as on ice"
    return (f"static_friction: {told}; give materials static_friction=1.0, kinetic_friction=0.8, or --ground-friction",)


def _of_size(robot: "LatticeRobot") -> Iterator[str]:
    if robot.placed is not None:  # props are as large as a course is
        return
    longest = float((np.ptp(robot.body.voxels, axis=0) + 1).max()) * robot.body.voxel_size
    if not SMALLEST <= longest <= LARGEST:
        size = f"{1e3 * longest:.3g} mm" if longest < SMALLEST else f"{longest:.4g} m"
        yield f"voxel_size: {robot.name} is {size} long; lengths are metres (scale 0.001 is of meshes in millimetres)"


def _of_parts(robot: "LatticeRobot") -> Iterator[str]:
    count = int(robot.body.topology.parts.max(initial=0)) + 1
    if count > 1 and robot.placed is None:
        yield f"body: {robot.name} is {count} parts that no links join; voxels are joined where they share a face"


def _of_materials(robot: "LatticeRobot") -> Iterator[str]:
    for number, material in enumerate(robot.body.materials):
        name = material.name or f"material {number}"
        if not SOFTEST <= material.youngs_modulus <= STIFFEST:
            yield f"youngs_modulus: {name} has {material.youngs_modulus:g} Pa; it is in pascals, rubber has some 1e6"
        if not LIGHTEST <= material.density <= DENSEST:
            yield f"density: {name} has {material.density:g} kg/m^3; it is in kg/m^3, rubber has some 1000, 1 g/cm^3"
        if not all(LEAST_SCALE <= each <= MOST_SCALE for each in material.scale):
            sizes = ", ".join(f"{each:g}" for each in material.scale)
            yield f"scale: {name} has {sizes}, but voxels start with an edge of 1: they spring to their size at once"
        if material.kinetic_friction > material.static_friction:
            pair = f"{material.kinetic_friction:g} of {name} is above its static friction, {material.static_friction:g}"
            yield f"kinetic_friction: {pair}; what slides is then held more than what rests"


def _of_drives(robot: "LatticeRobot") -> Iterator[str]:
    if rests(robot):
        muscle = "give a drive an amplitude, or of a mesh mark a muscle, such as --region legs=legs.stl"
        yield f"drives: nothing moves {robot.name}, which rests; {muscle}"


def _of_phases(robot: "LatticeRobot") -> Iterator[str]:
    for drive in robot.drives:
        given = drive.phase if isinstance(drive.phase, tuple) else (drive.phase,)
        sizes = [max(abs(v.low), abs(v.high)) if isinstance(v, Free) else abs(v) for v in given]
        if max(sizes) >= MANY_CYCLES:
            yield f"phase: {max(sizes):g} of {drive.name} is likely in degrees; phases are in cycles, 90 is 0.25"


def _of_reach(robot: "LatticeRobot") -> Iterator[str]:
    """Sizes of neighbours; not by curves and proportions, whose bounds are wider than what all of a voxel reaches."""
    body = robot.body
    regions, links = np.asarray(body.regions), body.topology.links
    links = links[regions[links[:, 0]] != regions[links[:, 1]]]  # voxels of one region have one size
    if body.is_balanced or not len(links):
        return
    plain = [drive for drive in robot.drives if not (drive.knots or drive.proportions)]
    least, most = (each[links] for each in reached_sizes(robot, plain))
    least = np.maximum(least[:, ::-1], SMALLEST_SIZE)  # of the other voxel
    worst = np.unravel_index((most / least).argmax(), most.shape)
    if most[worst] > MOST_UNLIKE * least[worst]:
        sizes = f"{robot.name} has neighbours of {least[worst]:.3g} and {most[worst]:.3g} edges"
        yield f"links: {sizes}, which may push it along on dry ground; compare with links balanced"
        return
    used = [body.materials[n] for n in np.unique(np.asarray(body.material_index))]
    stiffness = max(each.youngs_modulus / each.density for each in used) / (9.81 * body.voxel_size)
    if stiffness * float((most - least).max()) ** 2 > MOST_STIFF:
        told = f"{robot.name} is stiff for its weight and size, so muscles may push it along or throw it on dry ground"
        yield f"links: {told}; compare with links balanced"
