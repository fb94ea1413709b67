"""Where things live in either edition: each name that the cases need, and the modules in which it may be found.

The cases take whatever names outside code may rely on from their documented places, and everything else from here:
``places.GaitProblem``. When a name moves, put its new place first and leave the old one behind it. When a function is
renamed or its arguments change, write a function of the old name and arguments at the end of this file.

Editing this file does not make the reference run again: what it finds in version 1.0 must stay the same.
"""

import contextlib
import dataclasses
import importlib.util
import inspect
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np

PLACES = {
    # The beam lattice.
    "LatticeState": ("taichi_sim.lattice", "taichi_sim.lattice.engine"),
    "ProgramBuilder": ("taichi_sim.lattice", "taichi_sim.lattice.program"),
    "Quantity": ("taichi_sim.lattice", "taichi_sim.lattice.program"),
    # The inflatable robot.
    "InflatableActuation": ("robots.inflatable", "robots.inflatable.actuation"),
    "InflatableGeometry": ("robots.inflatable", "robots.inflatable.body"),
    "NAMED_GEOMETRIES": ("robots.inflatable", "robots.inflatable.body"),
    "differentiate_gaits": ("robots.inflatable.gradient:differentiate", "robots.inflatable_gradient:differentiate"),
    "GaitProblem": ("optim.problems.inflatable", "optim.problems.inflatable.problem", "optim.gait_problem"),
    # Soft walkers, and robots of arrays.
    "WalkerDesign": ("robots.lattice_robot.walker", "robots.lattice_robot.walker_body", "robots.walker"),
    "simulate_walkers": ("robots.lattice_robot.walker:simulate", "robots.walker:simulate"),
    "WalkerProblem": ("optim.problems.walker", "optim.walker_problem"),
    "LatticeRobotProblem": ("optim.lattice_robot_problem", "optim.problems.lattice_robot"),
    # Vehicles.
    "VehicleBatch": ("taichi_sim.vehicle",),
    "VehicleTask": ("taichi_sim.vehicle",),
    "differentiate_vehicles": ("taichi_sim.vehicle:differentiate", "taichi_sim.vehicle.gradient:differentiate"),
    "rollout": ("taichi_sim.vehicle", "taichi_sim.vehicle.rollout"),
    "VehicleProblem": ("optim.problems.braitenberg", "optim.vehicle_problem"),
    # Rigid robots.
    "RigidEngine": ("taichi_sim.rigid",),
    "Tree": ("taichi_sim.rigid", "taichi_sim.rigid.model"),
    "Body": ("taichi_sim.rigid", "taichi_sim.rigid.model"),
    "Hinge": ("taichi_sim.rigid", "taichi_sim.rigid.model"),
    "Motor": ("taichi_sim.rigid", "taichi_sim.rigid.model"),
    "Capsule": ("taichi_sim.rigid", "taichi_sim.rigid.model"),
    "Sphere": ("taichi_sim.rigid", "taichi_sim.rigid.model"),
    "World": ("taichi_sim.rigid",),
    "quadruped_engine": ("robots.quadruped:engine",),
    "differentiate_quadruped": ("robots.quadruped:differentiate",),
    "Rover": ("robots.rover",),
    "simulate_rovers": ("robots.rover:simulate",),
    # Designing.
    "Evaluation": ("optim.problem",),
    "Space": ("optim.space",),
    "Variable": ("optim.space",),
    "open_run": ("optim.runs",),
    "run_search": ("optim.runs",),
}

PACKAGES = ("taichi_sim", "robots", "optim")

inputs = Path()  # the reference tree, from which data and scenes are read, whichever tree runs


def __getattr__(name: str) -> Any:
    """The thing of this name in the tree that runs."""
    if name not in PLACES:
        raise AttributeError(name)
    for place in PLACES[name]:
        module, _, called = place.partition(":")
        found = getattr(_module(module), called or name, None)
        if found is not None:
            return found
    raise ImportError(f"{name} is at none of {', '.join(PLACES[name])}; say where in benchmarks/same_bits/places.py")


def _module(name: str) -> ModuleType | None:
    """A module, or None where there is none of this name; what it fails to import itself is an error."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name and (name == error.name or name.startswith(f"{error.name}.")):
            return None
        raise


def without_editable() -> list[Any]:
    """The finders of modules, but for those of editable installs.

    These find modules of the tree that is installed, even those that the tree on PYTHONPATH does not have, and mix two
    editions.
    """
    return [finder for finder in sys.meta_path if not getattr(finder, "__module__", "").startswith("__editable__")]


def strangers(tree: Path) -> list[str]:
    """Modules imported so far that should be of a tree, but lie elsewhere."""
    tree, found = tree.resolve(), []
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if name.split(".")[0] in PACKAGES and file and not Path(file).resolve().is_relative_to(tree):
            found.append(f"{name} ({file})")
    return found


def as_published(body: Any) -> Any:
    """The body with links as version 1.0 has them all, which damps either end as its own material says."""
    return dataclasses.replace(body, links="published") if hasattr(body, "links") else body


@contextlib.contextmanager
def pulled_aside_by_rounding() -> Iterator[None]:
    """Robots of lattices on level ground as version 1.0 has them: rounding pulls them aside, by 1e-15 m/s^2."""
    module = "robots.lattice_robot.rollout"
    is_present = importlib.util.find_spec(module) is not None  # version 1.0 itself knows no other way
    with mock.patch(f"{module}.without_rounding", dict) if is_present else contextlib.nullcontext():
        yield


def scene(name: str) -> ModuleType:
    """A module of version 1.0's tests that describes bodies and programs, whichever tree runs.

    These take their names from ``taichi_sim.lattice``; those that have moved are put there.
    """
    import taichi_sim.lattice as lattice

    for needed in ("LatticeState", "ProgramBuilder", "Quantity"):
        if not hasattr(lattice, needed):
            setattr(lattice, needed, __getattr__(needed))
    folder = str(inputs / "tests")
    sys.path.insert(0, folder)
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(folder)


def lattice_engine(*given: Any, **options: Any) -> Any:
    """A lattice engine; ``width``, how many robots lie side by side, is an option of version 1.0 only."""
    from taichi_sim.lattice import LatticeEngine

    if "width" not in inspect.signature(LatticeEngine).parameters:
        options.pop("width", None)
        options = {"self_contact": "published", **options}  # where voxels swell, others miss no contact
    return LatticeEngine(*given, **options)


def set_state(engine: Any, state: Any) -> None:
    """Put robots in a state as version 1.0 did: voxels that move along the floor stick to it in the first step."""
    engine.set_state(state)
    if "width" in inspect.signature(type(engine)).parameters:
        return  # of that version
    from taichi_sim.lattice.stages import memory

    voxel = engine._driver.read(memory.VOXEL)
    voxel[:, :, memory.STICKS] = 1.0
    engine._driver.write(memory.VOXEL, voxel)


def differentiate_vehicles(*given: Any, **settings: Any) -> Any:
    """Derivatives of vehicles' distances by the names of version 1.0."""
    found = __getattr__("differentiate_vehicles")(*given, **settings)
    if hasattr(found, "closest_by_sites"):
        return found
    by = {f"{of}_by_{what}": getattr(getattr(found, f"of_{of}"), what)
          for of in ("closest", "final") for what in ("sites", "controllers")}  # fmt: skip
    return SimpleNamespace(closest=found.closest, final=found.final, **by)


def differentiate_quadruped(*given: Any, **settings: Any) -> tuple[Any, np.ndarray]:
    """What quadrupeds did, and the derivatives of their readings by the weights."""
    found = __getattr__("differentiate_quadruped")(*given, **settings)
    return found if isinstance(found, tuple) else (found, found.gradient)
