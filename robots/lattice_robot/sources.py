"""Where lattice robots come from: a Python file, a design file, a file of VoxCAD or voxcraft."""

import math
import runpy
import warnings
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from robots.lattice_robot.drive import Drive, Free
from robots.lattice_robot.formats import MESH_SUFFIXES, VOXEL_SUFFIXES
from robots.lattice_robot.record import load_saved_robot
from robots.lattice_robot.robot import LatticeRobot
from robots.own_measures import RobotFile, of_file
from robots.robot import KINDS, Robot
from robots.world import STANDARD_GRAVITY
from taichi_sim.base.foreign import modules_beside, users_code
from taichi_sim.lattice.files import VoxelFile, load_voxel_file

AnyRobot = TypeVar("AnyRobot", bound=Robot)
SUFFIXES = (".py", ".json", *VOXEL_SUFFIXES, *MESH_SUFFIXES)


def load_robot(path: str | PathLike[str]) -> LatticeRobot:
    """Load a lattice robot from a file.

    Args:
        path: Python that sets ``robot`` to a ``LatticeRobot`` (it is run), JSON of ``save_robot``, or a voxel file
            that is driven by heat.

    Raises:
        ValueError: one line that names the file and what is wrong with it.
    """
    path = Path(path)
    if not path.is_file():
        raise ValueError(f"robot: {path} is no file; give one of {', '.join(SUFFIXES)}")
    name = path.name.lower()
    if name.endswith(".py"):
        return robot_of_python(path, LatticeRobot)
    if name.endswith(VOXEL_SUFFIXES):
        try:
            return robot_of_voxel_file(load_voxel_file(path), name=path.stem)
        except ValueError as error:
            raise ValueError(str(error) if str(path) in str(error) else f"{path}: {error}") from None
    if name.endswith(MESH_SUFFIXES):
        raise ValueError(f"robot: {path} is a mesh, which is no robot by itself; use robot_of_mesh")
    if name.endswith(".json"):
        return load_saved_robot(path)
    raise ValueError(f"robot: the kind of {path} is unknown; give one of {', '.join(SUFFIXES)}")


def robot_of_voxel_file(
    file: VoxelFile, *, amplitude: Free | None = None, phase: Free | None = None, **settings: Any
) -> LatticeRobot:
    """Make a lattice robot from a voxel file, driven by the temperature that the file describes.

    Args:
        file: a voxel file that ``load_voxel_file`` read.
        amplitude: amplitude of the temperature, if it is to be free [K].
        phase: phase of every region, if these are to be free [cycles]; they start as in the file.
        settings: further fields of ``LatticeRobot``.

    Raises:
        ValueError: for a file that nothing drives, or whose heat no material feels.
    """
    heat = file.heat
    if heat is None:
        raise ValueError("heat: the file drives nothing; make a LatticeRobot of its body")
    if not any(m.thermal_expansion for m in file.body.materials):
        raise ValueError("heat: no material expands; give one a CTE")
    if file.gravity is not None and not math.isclose(file.gravity, STANDARD_GRAVITY, rel_tol=0.01):
        warnings.warn(f"gravity: {file.gravity:g} m/s^2 is not that of the robots, {STANDARD_GRAVITY}", stacklevel=2)
    if file.floor is False:
        warnings.warn("floor: the file has none, robots stand on one", stacklevel=2)
    regions, first = np.unique(file.body.regions, return_index=True)  # type: ignore[call-overload]
    phases = heat.phase[first].tolist()
    if phase is not None:
        phases = [Free(phase.low, phase.high, min(max(p, phase.low), phase.high)) for p in phases]
    drive = Drive(
        "heat",
        tuple(regions.tolist()),
        "temperature",
        heat.mean,
        heat.amplitude if amplitude is None else amplitude,
        tuple(phases),
    )
    frequency = 1.0 / heat.period
    return LatticeRobot(file.body, (drive,), **{"frequency": frequency, **settings})


def robot_of_python(path: Path, kind: type[AnyRobot]) -> AnyRobot:
    """The robot that a Python file sets, which must be of a class, and of a kind in ``KINDS``; the file is run.

    Raises:
        ValueError: one line that names the file and what is wrong with it.
    """
    with users_code(path), modules_beside(path.parent):
        names = runpy.run_path(str(path))
    robot = names.get("robot")
    if not isinstance(robot, kind):
        told = "is missing" if robot is None else f"is a {type(robot).__name__}"
        raise ValueError(f"{path}: robot {told}; set it to a {kind.__name__}")
    try:
        KINDS.of(robot)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    found: AnyRobot = of_file(robot, RobotFile.of(path))
    return found
