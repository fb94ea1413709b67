"""From what the command line names to motions."""

import argparse
import dataclasses
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from optim.commands import options
from optim.commands.kept_points import kept_point
from optim.problem import GAIT, ROBOT, VEHICLE, WALKER
from robots.view.motion import Motion, record_every
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import read_text, why_unread

Progress = Callable[[float], None]
QUADRUPEDS = ("legged", "wheeled", "whegged")
RIGID = (*QUADRUPEDS, "vehicle", "rover")
# Options that say something of some sources only, and of which.
WHOSE = {
    "terrain": "soft robots",
    "slope": "soft robots",
    "member": "runs",
    "controller": "rigid robots and vehicle",
    "seed": "quadrupeds",
    "design": "vehicle and rover",
    "environment": "rigid robots and vehicles",
    **dict.fromkeys(("geometry", "columns", "repeats", "weight", "calibration"), "the inflatable robot"),
}
OF_KIND = {
    GAIT: ("terrain", "slope", "geometry", "columns", "repeats", "weight", "calibration"),
    WALKER: ("terrain", "slope"),
    ROBOT: ("terrain", "slope"),
    VEHICLE: ("environment",),
}


def check_options(args: argparse.Namespace) -> None:
    """Whether every option that is given says something of at least one source.

    Raises:
        ValueError: in one line, for an option that does not, and for a source that is unknown.
    """
    options.chosen_terrain(args)
    said = {option for source in args.sources for option in _options_of(source)}
    for option, whose in WHOSE.items():
        if getattr(args, option) is not None and option not in said:
            raise ValueError(f"{option}: it is of {whose}; leave it out")
    if args.seed is not None and args.controller is not None:
        raise ValueError("seed: it is of random weights; leave it out beside --controller")


def _options_of(source: str) -> tuple[str, ...]:
    """Those of ``WHOSE`` that say something of a source."""
    if source in RIGID:
        return ("controller", "environment", "seed" if source in QUADRUPEDS else "design")
    own = OF_KIND[_kind(source)]
    return (*own, "member") if source not in options.GAITS and Path(source).is_dir() else own


def _kind(source: str) -> str:
    """The kind of problem that the design of a source is of; of those that have no name.

    Raises:
        ValueError: in one line, for what is no source.
    """
    path = Path(source)
    if source in options.GAITS:
        return GAIT
    if path.is_dir():
        from optim.runs.config import read_config

        kind: str = read_config(path)["problem"].get("kind", GAIT)
        if kind not in OF_KIND:
            raise ValueError(f"source: {path} is a run of a {kind}, which has no view")
        return kind
    if path.is_file():
        from robots.lattice_robot.formats import ROBOT_FORMAT, VOXEL_SUFFIXES
        from robots.lattice_robot.formats import WALKER_FORMAT as DESIGN_FORMAT

        if path.name.lower().endswith((".py", *VOXEL_SUFFIXES)) or f'"{ROBOT_FORMAT}"' in read_text(path):
            return ROBOT
        return WALKER if f'"{DESIGN_FORMAT}"' in read_text(path) else GAIT
    known = ", ".join((*options.GAITS, *RIGID))
    raise ValueError(f"source: {source!r} is no robot ({known}), no run and no file of a design")


def motion_of(source: str, args: argparse.Namespace, progress: Progress) -> Motion:
    """Simulate what a source names, with frames.

    Raises:
        ValueError: in one line, for what is unknown or not allowed.
    """
    if source in QUADRUPEDS:
        return _quadruped(source, args)
    if source == "rover":
        return _rover(args)
    if source == "vehicle":
        from robots.braitenberg import PUBLISHED, VehicleBody, contralateral

        body = VehicleBody.published(_design(args))
        return _vehicle(body, contralateral(_pair(args)), PUBLISHED, f"vehicle {_design(args)}", args)
    if source in options.GAITS:
        return _inflatable(options.load_gait(source), source, args, None, progress)
    path = Path(source)
    return (_of_run if path.is_dir() else _of_file)(path, _kind(source), args, progress)


def _of_run(folder: Path, kind: str, args: argparse.Namespace, progress: Progress) -> Motion:
    if kind == GAIT:
        from optim.problems.inflatable.problem import GaitProblem

        gaits, point = kept_point(folder, GaitProblem.from_description, args.member)
        return _inflatable(gaits.design(point), folder.name, args, gaits, progress)
    if kind == WALKER:
        from optim.problems.walker import WalkerProblem

        walkers, point = kept_point(folder, WalkerProblem.from_description, args.member)
        return _walker(walkers.design(point), folder.name, args, walkers, progress)
    if kind == VEHICLE:
        from optim.problems.braitenberg import VehicleProblem
        from robots.braitenberg import VehicleBody

        vehicles, point = kept_point(folder, VehicleProblem.from_description, args.member)
        sites, controllers = vehicles.split(point)
        return _vehicle(VehicleBody(sites[0]), controllers[0, 0], vehicles.task, folder.name, args)
    from optim.problems.lattice_robot import LatticeRobotProblem

    own, point = kept_point(folder, LatticeRobotProblem.from_description, args.member)
    return _lattice_robot(own.design(point), folder.name, args, own.terrain, progress)


def _of_file(path: Path, kind: str, args: argparse.Namespace, progress: Progress) -> Motion:
    from robots.hardware import read_design
    from robots.lattice_robot import load_robot
    from robots.lattice_robot.walker import load_walker

    if kind == ROBOT:
        return _lattice_robot(load_robot(path), path.stem, args, None, progress)
    if kind == WALKER:
        return _walker(load_walker(path), path.stem, args, None, progress)
    return _inflatable(read_design(path), path.stem, args, None, progress)


def _where(args: argparse.Namespace, precision: str = "f32") -> dict[str, Any]:
    return {"precision": args.precision or precision, "device": args.device or "cpu", "threads": args.threads}


def _terrain(args: argparse.Namespace, own: Terrain | None) -> Terrain:
    return options.chosen_terrain(args) or own or Terrain()


def _inflatable(design: Any, name: str, args: argparse.Namespace, run: Any, progress: Progress) -> Motion:
    from robots.inflatable import simulation
    from robots.inflatable.timing import gait_steps
    from robots.view.soft_motion import inflatable_motion

    design = dataclasses.replace(design, schedule=options.cut(design.schedule, args.columns, args.repeats))
    own = (run.properties, run.geometry) if run else (None, "published")
    properties, fitted = options.load_rig(args.calibration) or own
    geometry = args.geometry or (run.geometry if run else fitted)
    weight = args.weight or (run.weight if run else "published")
    robot = options.inflatable_robot(geometry, weight, properties, design)
    terrain = _terrain(args, run.terrains[0] if run else None)
    steps = gait_steps(design.schedule, robot["actuation"])
    result = simulation.simulate(
        [design], terrain, **robot, **_where(args), record_every=record_every(steps, args.frames), progress=progress
    )
    return inflatable_motion(result, design, terrain, actuation=robot["actuation"], name=f"{name} {terrain.where}")


def _walker(design: Any, name: str, args: argparse.Namespace, run: Any, progress: Progress) -> Motion:
    from robots.lattice_robot.walker import WalkerActuation
    from robots.lattice_robot.walker_offered import Walker
    from taichi_sim.base.compute import Compute

    drive, terrain = run.actuation if run else WalkerActuation(), _terrain(args, run.terrain if run else None)
    name = f"{name} {terrain.where}"
    shown = {"frames": args.frames, "name": name, "compute": Compute(**_where(args)), "progress": progress}
    return Walker(design, drive).replay((), terrain, **shown).motion


def _lattice_robot(robot: Any, name: str, args: argparse.Namespace, own: Terrain | None, progress: Progress) -> Motion:
    from robots.lattice_robot import simulate
    from robots.view.soft_motion import lattice_robot_motion

    terrain = _terrain(args, own)
    steps = robot.cycle.end - robot.cycle.begin
    result = simulate(
        robot, None, terrain, **_where(args), record_every=record_every(steps, args.frames), progress=progress
    )
    if result.reason[0]:
        raise ValueError(f"source: {name} is no robot: {result.reason[0]}")
    return lattice_robot_motion(result, robot, terrain, name=f"{name} {terrain.where}")


def _vehicle(body: Any, controller: Floats, task: Any, name: str, args: argparse.Namespace) -> Motion:
    from robots.braitenberg import trace
    from robots.view.vehicle_motion import vehicle_motion

    environment = args.environment or 1
    if environment > len(task.starts):
        raise ValueError(f"environment: {environment} is not allowed; the task has {len(task.starts)}")
    traces = trace([body], controller[None, None], task, **_where(args, "f64"))
    motion = vehicle_motion(traces, body, task, environment=environment - 1, name=name)
    return motion.every(-(-len(motion.times) // args.frames))


def _quadruped(kind: str, args: argparse.Namespace) -> Motion:
    from robots import quadruped
    from robots.control.neural import random_weights
    from robots.view.rigid_motion import quadruped_motion

    robot = {"legged": quadruped.LEGGED, "wheeled": quadruped.WHEELED, "whegged": quadruped.WHEGGED}[kind]
    sizes = quadruped.SENSORS, quadruped.MOTORS
    weights = (
        random_weights(1, *sizes, np.random.default_rng(args.seed or 0))
        if args.controller is None
        else _matrix(Path(args.controller), sizes)
    )
    lights = [quadruped.ENVIRONMENTS[(args.environment or 1) - 1]]
    every = _every(quadruped.STEPS, args)
    found = quadruped.simulate(robot, weights, lights, record_every=every, **_where(args, "f64"))
    return quadruped_motion(robot, found, lights)


def _rover(args: argparse.Namespace) -> Motion:
    from robots import rover
    from robots.view.rigid_motion import rover_motion

    robot, lights = rover.Rover.published(_design(args)), [rover.LIGHTS[(args.environment or 1) - 1]]
    every = _every(rover.STEPS, args)
    found = rover.simulate(robot, _pair(args), lights, record_every=every, **_where(args, "f64"))
    return rover_motion(robot, found, lights, name=f"rover {_design(args)}")


def _design(args: argparse.Namespace) -> int:
    return args.design or 6553


def _every(steps: int, args: argparse.Namespace) -> int:
    return int(-(-steps // args.frames))


def _pair(args: argparse.Namespace) -> Floats:
    """Two weights, as ``1,-0.5``."""
    try:
        first, second = (float(part) for part in (args.controller or "1,1").split(","))
    except ValueError:
        raise ValueError(f"controller: {args.controller!r} is not allowed; give two numbers, such as 1,-0.5") from None
    return np.array([first, second])


def _matrix(path: Path, shape: tuple[int, int]) -> Floats:
    """Weights of a file."""
    try:
        found = np.load(path, allow_pickle=False) if path.suffix == ".npy" else np.array(json.loads(read_text(path)))
        weights = np.asarray(found, float)
    except OSError as error:
        raise ValueError(f"controller: {path} cannot be read ({why_unread(error)})") from None
    except (ValueError, TypeError, OverflowError, EOFError, RecursionError, zipfile.BadZipFile):
        raise ValueError(f"controller: {path} holds no table of numbers") from None
    if not np.isfinite(weights).all():
        raise ValueError(f"controller: {path} holds numbers that are not finite")
    if weights.shape != shape:
        raise ValueError(f"controller: {path} has shape {weights.shape}, which is not allowed; give {shape}")
    return weights
