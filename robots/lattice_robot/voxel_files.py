"""Lattice robots as files of other simulators: VoxCAD and voxcraft (``.vxa``), Voxelyze (``.vxl.json``)."""

from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from robots.lattice_robot.drive import Drive
from robots.world import STANDARD_GRAVITY
from taichi_sim.base.arrays import Floats
from taichi_sim.lattice.files import Heat, VoxelFile, save_vxa, save_vxl_json
from taichi_sim.lattice.files.vxa_writer import with_expansions

if TYPE_CHECKING:
    from robots.lattice_robot.robot import LatticeRobot


def save_voxels(robot: "LatticeRobot", path: str | PathLike[str]) -> None:
    """Write a robot of which nothing is free: a ``.vxa`` with its drives, or a ``.vxl.json`` of its body alone.

    Raises:
        ValueError: for another kind of file, and drives that the file cannot hold.
    """
    name = Path(path).name.lower()
    if name.endswith(".vxa"):
        save_vxa(heated_file(robot), path)
    elif name.endswith(".vxl.json"):
        save_vxl_json(robot.body, path)
    else:
        raise ValueError(f"voxels: {path} is not allowed; give a file that ends in .vxa or .vxl.json")


def heated_file(robot: "LatticeRobot") -> VoxelFile:
    """A robot as a voxel file: one temperature, to which each voxel's expansion and phase are fitted.

    Edges grow by 1 + a sin(2 pi (f t + phase)) in both. A drive of size gives a itself, one of temperature the
    expansion of its material times its amplitude. The file's temperature swings by the largest amplitude of the drives
    of temperature, or by 1 K, and each voxel expands by a of that.

    Raises:
        ValueError: for reflexes, and for drives that are no sine of size, along all axes about 1, or of temperature
            about 0.
    """
    if robot.reflexes is not None:
        raise ValueError(
            "reflexes: a robot that feels is not allowed in a .vxa, which plays waves alone; save it as .vxl.json"
        )
    body, swings, phases = robot.body, np.zeros(robot.body.voxel_count), np.zeros(robot.body.voxel_count)
    heats = [_of_regions(drive, "amplitude") for drive in robot.drives if drive.quantity == "temperature"]
    kelvins = max([1.0] if not heats else [float(np.abs(each).max()) for each in heats]) or 1.0
    own = np.array([material.thermal_expansion for material in body.materials])[body.material_index]
    driven = np.zeros(body.voxel_count, int)
    for drive in robot.drives:
        _check(drive)
        for region, amplitude, phase in zip(
            drive.regions, _of_regions(drive, "amplitude"), _of_regions(drive, "phase"), strict=True
        ):
            chosen = np.asarray(body.regions) == region
            share = amplitude / kelvins
            swings[chosen] = share * own[chosen] if drive.quantity == "temperature" else share
            phases[chosen] = phase % 1.0
            driven += chosen
    if driven.max() > 1:
        raise ValueError("drives: of size and of temperature are not allowed in one region of a .vxa; give one")
    heat = Heat(kelvins, 1.0 / robot.frequency, phases)
    file = replace(VoxelFile.of_body(body), heat=heat, gravity=STANDARD_GRAVITY, floor=True)
    return with_expansions(file, swings)


def _check(drive: Drive) -> None:
    """Refuse a drive that no temperature of a ``.vxa`` can express."""
    why = ""
    if drive.quantity not in ("scale", "temperature"):
        why = f"it sets {drive.quantity}"
    elif drive.knots:
        why = "its wave is no sine"
    elif drive.quantity == "scale" and set(drive.axes) != set("xyz"):
        why = f"it acts along {drive.axes} only"
    elif set(drive.proportions) - {1.0}:
        why = f"it acts by {drive.proportions} along {drive.axes}"
    elif drive.mean is not None and (_of_regions(drive, "mean") != (drive.quantity == "scale")).any():
        why = f"it swings about {drive.mean}"
    if why:
        raise ValueError(
            f"drives: {drive.name} is not allowed in a .vxa, as {why}; it takes sines of scale, along xyz about 1, "
            "and of temperature about 0"
        )


def _of_regions(drive: Drive, field: str) -> Floats:
    """Values of a field for each region of a drive of which nothing is free, shape (G,)."""
    return np.broadcast_to(np.array(getattr(drive, field), float), (len(drive.regions),))
