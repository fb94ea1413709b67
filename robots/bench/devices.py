"""Benchmark of a device: batches of robots there, and on all CPU cores of the same machine, by the wall clock."""

import functools
import os
import sys
import time
from argparse import Namespace
from collections.abc import Callable
from typing import Any

import numpy as np

from robots.bench import lattice
from robots.braitenberg import STARTS
from robots.inflatable import PUBLISHED
from robots.quadruped import LEGGED
from robots.quadruped import engine as quadruped_engine
from taichi_sim import runtime
from taichi_sim.base.compute import Compute, available_threads
from taichi_sim.vehicle import VehicleBatch, VehicleTask, rollout

BATCHES = {"quick": (1, 16, 128), "full": (1, 16, 128, 1024, 4096)}
SETTLING = 1000  # steps before anything is timed: bladders fill, feet touch the ground
SHORTEST = 2.0  # of a measurement [s]
PIECE = 2000  # steps of a measurement; before and after it the robots are copied
VEHICLES = {"quick": (16,), "full": (16, 512)}  # bodies, each with so many controllers from all starts
CONTROLLERS, VEHICLE_STEPS = 441, 1000
QUADRUPEDS, QUADRUPED_STEPS = {"quick": (64,), "full": (64, 1024, 8192)}, 100
ROUNDS = 3  # of which the best counts, after one that compiles
GRADIENTS, GRADIENT_STEPS = {"quick": (64, 512), "full": (64, 512, 2048)}, 200  # robots and steps of the gradient
GRADIENT_MEMORY_PER_ROBOT = 1.6e7  # B; with less a large batch would record short pieces, and run forward more often


def published(compute: Compute, batch: int) -> lattice.Batch:
    """A batch of the published robot, set up on a device."""
    return lattice.Batch(batch, compute.precision, compute.thread_count, device=compute.device)


def rate(compute: Compute, batch: int) -> dict[str, float]:
    """Measure the robot-steps per second of a batch, by the wall clock, and the seconds of its first step."""
    robots = published(compute, batch)
    robots.advance(SETTLING)
    steps, seconds = 0, 0.0
    while seconds < SHORTEST:
        seconds += lattice.timed(time.perf_counter, robots.advance, PIECE)[0]
        steps += PIECE
    return {"robot_steps_per_second": batch * steps / seconds, "first_step_s": robots.first_step}


def gradients(compute: Compute, batch: int) -> float:
    """Measure the robot-steps per second of gradients by everything: forwards and back, by the wall clock."""
    robots, memory = published(compute, batch), max(lattice.GRADIENT_MEMORY, GRADIENT_MEMORY_PER_ROBOT * batch)
    work = functools.partial(robots.differentiate, memory=memory)
    work(50)  # compiles
    robots.advance(SETTLING)
    return batch * GRADIENT_STEPS / lattice.timed(time.perf_counter, work, GRADIENT_STEPS)[0]


def measure(device: str, precision: str, quick: bool, tell: Callable[[str], None]) -> dict[str, Any]:
    """Measure batches on a device, and what all CPU cores do with as many robots as keep them busy.

    Args:
        device: where the batches run.
        precision: ``"f32"`` or ``"f64"``.
        quick: whether to leave out the large batches.
        tell: takes a line of a table as soon as its numbers are there.
    """
    there, here, cores = Compute(device, precision), Compute("cpu", precision), available_threads()
    robots, size = max(16, 4 * cores), "quick" if quick else "full"
    cpu = rate(here, robots)
    tell(line(f"cpu, {cores} cores, {robots} robots", cpu, cpu))
    found: dict[str, Any] = {"cores": cores, "cpu": {"robots": robots, **cpu}, "batches": {}}
    for batch in BATCHES[size]:
        found["batches"][batch] = rate(there, batch)
        tell(line(f"{device}, {batch} robots", found["batches"][batch], cpu))
    found["gradients"] = {"cpu": gradients(here, robots), "device": {}}
    for batch in GRADIENTS[size]:
        made = found["gradients"]["device"][batch] = gradients(there, batch)
        ratio = made / found["gradients"]["cpu"]
        tell(f"{f'gradients of {batch} robots':<28} {made:>10.0f} robot-steps/s, {ratio:.2f} of the cpu's {robots}")
    return found


def vehicles(compute: Compute, bodies: int) -> float:
    """Measure the rollouts per second of random bodies and controllers."""
    generator = np.random.default_rng(0)
    sites = generator.uniform(-0.5, 0.5, (bodies, 2, 2))
    weights = generator.uniform(-1, 1, (bodies, CONTROLLERS, 2, 2))
    batch, task = VehicleBatch(sites, weights), VehicleTask(STARTS, steps=VEHICLE_STEPS)
    where: dict[str, Any] = {"device": compute.device, "precision": compute.precision}
    return bodies * CONTROLLERS * len(STARTS) / best(lambda: rollout(batch, task, until="end", **where))


def quadrupeds(compute: Compute, robots: int) -> float:
    """Measure the robot-steps per second of legged robots with random controllers."""
    weights = np.random.default_rng(0).uniform(-1, 1, (robots, 5, 8))
    lights = np.array([[3.0, 1.0, 0.15]])
    lab = quadruped_engine(LEGGED, device=compute.device, precision=compute.precision)
    return robots * QUADRUPED_STEPS / best(lambda: lab.run(QUADRUPED_STEPS, weights=weights, lights=lights))


def best(work: Callable[[], Any]) -> float:
    """Seconds of the best of several rounds."""
    work()
    return min(lattice.timed(time.perf_counter, lambda _: work(), None)[0] for _ in range(ROUNDS))


def side_by_side(
    device: str, precision: str, measured: Callable[[Compute, int], float], sizes: tuple[int, ...]
) -> dict[int, dict[str, float]]:
    """Measure batches of several sizes on a device and on all CPU cores."""
    there, here = Compute(device, precision), Compute("cpu", precision)
    return {size: {"device": measured(there, size), "cpu": measured(here, size)} for size in sizes}


OTHERS = (
    ("vehicle", vehicles, VEHICLES, "bodies of vehicles", f"rollouts of {VEHICLE_STEPS} steps"),
    ("rigid", quadrupeds, QUADRUPEDS, "legged robots", "robot-steps"),
)


def line(name: str, found: dict[str, float], cpu: dict[str, float]) -> str:
    """Robot-steps and voxel-steps per second, and how many times what all CPU cores do."""
    steps, first = found["robot_steps_per_second"], found["first_step_s"]
    voxels, ratio = steps * PUBLISHED.body.voxel_count / 1e6, steps / cpu["robot_steps_per_second"]
    speed = f"{steps:>10.0f} robot-steps/s {voxels:>8.1f} million voxel-steps/s {ratio:>7.2f} of the cpu"
    return f"{name:<28} {speed}; first step {first:.1f} s"


def main(args: Namespace) -> dict[str, Any]:
    """Measure a device and print a table (to stderr with ``--json``); return the numbers."""
    out, size = sys.stderr if args.json else sys.stdout, "quick" if args.quick else "full"
    precisions = [args.precision] if args.precision else ["f32", "f64"]
    for precision in precisions:
        runtime.start(args.device, precision)  # what a device cannot do is told before anything is measured
    figures: dict[str, Any] = {"cpu": lattice.cpu_name(), "cores": os.cpu_count()}
    print(f"{figures['cpu']}, {figures['cores']} cores, and {args.device}", file=out)
    for precision in precisions:
        tell = functools.partial(print, precision, "", file=out, flush=True)
        found = figures[precision] = dict[str, Any]()
        if args.robot in ("all", "inflatable"):
            found["inflatable"] = measure(args.device, precision, args.quick, tell)
        for robot, measured, sizes, name, of in OTHERS:
            if args.robot in ("all", robot):
                found[robot] = side_by_side(args.device, precision, measured, sizes[size])
                for count, pair in found[robot].items():
                    batch, ratio = f"{args.device}, {count} {name}", pair["device"] / pair["cpu"]
                    tell(f"{batch:<28} {pair['device']:>10.3g} {of}/s, {ratio:.2f} of the cpu's")
    return figures
