"""Benchmark of the lattice: rates of the published robot, and how far they are from the machine's limits.

Every figure is measured several times in short pieces; the best piece is the machine undisturbed, the median what one
gets. Speeds of shared machines drift, so claims are ratios within one run: to a reference program (``--prototype``, any
program whose last line of output reads "f32: 36000 robot-steps ..."), and to the measured peak of the same core.
"""

import os
import sys
import time
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from robots.bench import braitenberg as vehicle_bench
from robots.bench import quadruped as rigid_bench
from robots.bench.rates import best_and_median, prototype_rate
from robots.inflatable.body import PUBLISHED
from robots.inflatable.design import INCHING
from robots.inflatable.program import build_program
from robots.world import Terrain
from taichi_sim import runtime
from taichi_sim.autodiff.lanes import NATIVE_WIDTH
from taichi_sim.base.compute import available_threads
from taichi_sim.lattice import LatticeEngine, LatticeProgram
from taichi_sim.lattice.drivers.roofline import FLOPS_PER_VOXEL_STEP, measure_peak

COLUMN = 11_670  # steps of a moving column of the published gaits
GRADIENT_MEMORY = 2e9  # B
PIECES = 4  # of a measurement
WARM_UP = 3000  # steps: the bladders have snapped to their thickness and contact is as usual


class Batch:
    """A batch of the published robot at the published inching gait, advanced piece by piece."""

    def __init__(self, batch: int, precision: str, threads: int, width: int | None = None) -> None:
        """Set up the batch and measure the time of the first step [s], compilation included."""
        self.batch, self._done = batch, 0
        self._program = build_program([INCHING] * batch, Terrain())
        runtime.start("cpu", precision, threads)
        body, time_step = PUBLISHED.body, PUBLISHED.time_step
        self.engine = LatticeEngine(
            body, batch, time_step=time_step, floor=True, precision=precision, threads=threads, width=width
        )
        started = time.perf_counter()
        self.advance(1)
        self.first_step = time.perf_counter() - started

    def advance(self, steps: int) -> None:
        """Run the next ``steps`` steps of the gait."""
        result = self.engine.run(self._piece(steps))
        if (result.status != "ok").any():
            raise RuntimeError("the benchmark's robots diverged")

    def differentiate(self, steps: int) -> float:
        """Run the next ``steps`` steps and differentiate them backwards; return the memory of the tape [B]."""
        tape = self.engine.record(self._piece(steps), memory=GRADIENT_MEMORY)
        tape.pull_back(positions=np.ones_like(tape.result.positions))
        return tape.memory

    def _piece(self, steps: int) -> LatticeProgram:
        """Program of the next ``steps`` steps of the gait, which records the pose at their end."""
        events = self._program.events
        piece = events[(events["step"] >= self._done) & (events["step"] < self._done + steps)].copy()
        piece["step"] -= self._done
        self._done += steps
        return LatticeProgram(np.full(self.batch, steps), piece, np.full((self.batch, 1), steps))


def rates(clock: Callable[[], float], batch: Batch, steps: int) -> dict[str, float]:
    """Measure robot-steps per second in several pieces of a run."""
    batch.advance(WARM_UP - 1)
    return best_and_median([batch.batch * steps / _timed(clock, batch.advance, steps)[0] for _ in range(PIECES)])


def measure(precision: str, quick: bool, prototype: Path | None) -> dict[str, Any]:
    """Measure all rates in one precision."""
    lanes, steps = NATIVE_WIDTH[precision], 250 if quick else 1000
    before = _prototype_rate(prototype, precision) if prototype else None
    full = Batch(lanes, precision, 1, lanes)
    found: dict[str, Any] = {"first_step_s": full.first_step, "kilobytes_per_robot": full.engine.bytes_per_robot / 1e3}
    peak = measure_peak(precision)
    rate = found["robot_steps_per_core_second"] = rates(time.process_time, full, steps)
    voxel_steps = rate["best"] * PUBLISHED.body.voxel_count
    found["million_voxel_steps_per_core_second"] = voxel_steps / 1e6
    found["part_of_peak"] = voxel_steps * FLOPS_PER_VOXEL_STEP / peak
    if prototype and before:
        after = _prototype_rate(prototype, precision)
        found["prototype"] = {"before": before, "after": after}
        found["ratio_to_prototype"] = rate["median"] / ((before + after) / 2)
    single = Batch(1, precision, 1, 1)
    found["single_robot_steps_per_second"] = rates(time.process_time, single, 2 * steps)
    found["gradient"] = gradient_cost(precision, 400 if quick else COLUMN)
    if available_threads() > 1:
        found["two_threads"] = {
            name: _two_threads(batch, precision, width, steps)
            for name, batch, width in ((f"{2 * lanes} robots", 2 * lanes, lanes), ("2 robots", 2, 1))
        }
    return found


def _prototype_rate(path: Path, precision: str) -> float:
    """Rate of a reference program: the first number after "f32:" or "f64:" on its last line."""
    pattern, place = rf"{precision}: *([0-9.]+)[^\n]*\s*$", f"after {precision}: on its last line"
    return prototype_rate("prototype", path, [precision], pattern, place)


def gradient_cost(precision: str, steps: int) -> dict[str, Any]:
    """Measure the CPU time of gradients over ``steps`` steps, as a multiple of forward runs.

    It includes the steps that the backward pass computes again.
    """
    found: dict[str, Any] = {"steps": steps}
    forward = Batch(1, precision, 1, 1)
    forward.advance(WARM_UP)
    clock = time.process_time
    scalar, _ = _timed(clock, forward.advance, steps)
    for name, robots in (("one_robot", 1), ("lanes", NATIVE_WIDTH[precision])):
        batch = Batch(robots, precision, 1, robots)
        batch.differentiate(50)  # compiles
        batch.advance(WARM_UP - 51)
        gone, _ = _timed(clock, batch.advance, steps)
        again = Batch(robots, precision, 1, robots)
        again.advance(WARM_UP - 1)
        seconds, memory = _timed(clock, again.differentiate, steps)
        found[name] = {
            "robots": robots,
            "in_its_own_forward_runs": seconds / gone,
            "in_scalar_forward_runs": seconds / scalar / robots,
            "megabytes": memory / 1e6,
        }
    return found


def _timed(clock: Callable[[], float], work: Callable[[int], Any], steps: int) -> tuple[float, Any]:
    """Time of ``work(steps)`` [s], and its result."""
    begun = clock()
    result = work(steps)
    return clock() - begun, result


def _two_threads(batch: int, precision: str, width: int, steps: int) -> float:
    """Measure the wall-clock speed of two threads divided by that of one."""
    one, two = (rates(time.perf_counter, Batch(batch, precision, threads, width), steps)["best"] for threads in (1, 2))
    return two / one


def main(args: Namespace) -> dict[str, Any]:
    """Measure all rates and print them as tables (to stderr with ``--json``); return the numbers."""
    out = sys.stderr if args.json else sys.stdout
    figures: dict[str, Any] = {"cpu": _cpu_name(), "cores": os.cpu_count()}
    machine = f"{figures['cpu']}, {figures['cores']} cores"
    if args.robot in ("all", "inflatable"):
        print(f"{machine}; published robot, 1428 voxels, full physics", file=out)
        for precision in [args.precision] if args.precision else ["f32", "f64"]:
            figures[precision] = measure(precision, args.quick, args.prototype)
            print("\n".join(lines(figures[precision], precision)), file=out)
    if args.robot in ("all", "vehicle"):
        print(f"{machine}; vehicle, all controllers of design 162", file=out)
        figures["vehicle"] = vehicle_bench.measure(args.quick, args.vehicle_prototype)
        print("\n".join(vehicle_bench.lines(figures["vehicle"])), file=out)
    if args.robot in ("all", "rigid"):
        print(f"{machine}; quadrupeds, random controllers", file=out)
        figures["rigid"] = rigid_bench.measure(args.quick, args.rigid_prototype)
        print("\n".join(rigid_bench.lines(figures["rigid"])), file=out)
    return figures


def lines(figures: dict[str, Any], precision: str) -> list[str]:
    """Lines of a table of the rates in one precision."""
    batch, single, gradient = (
        figures[name] for name in ("robot_steps_per_core_second", "single_robot_steps_per_second", "gradient")
    )
    lanes = NATIVE_WIDTH[precision]
    found = [
        f"{lanes} robots, one core    {batch['median']:>8.0f} robot-steps/s (best {batch['best']:.0f})",
        f"voxels, best piece       {figures['million_voxel_steps_per_core_second']:>8.1f} million voxel-steps/s",
        f"of the core's peak       {figures['part_of_peak']:>8.0%} ({FLOPS_PER_VOXEL_STEP} flop a voxel-step)",
        f"one robot, one core      {single['median']:>8.0f} steps/s (best {single['best']:.0f})",
        f"first step, compiling    {figures['first_step_s']:>8.1f} s",
        f"memory per robot         {figures['kilobytes_per_robot']:>8.0f} KB",
    ]
    if "ratio_to_prototype" in figures:
        found.insert(1, f"ratio to the prototype   {figures['ratio_to_prototype']:>8.2f}")
    found += [
        f"gradient, robots: {g['robots']:<2}     {g['in_scalar_forward_runs']:>8.2f} scalar forward runs a robot "
        f"({g['in_its_own_forward_runs']:.1f} of its own kind; {gradient['steps']} steps, {g['megabytes']:.0f} MB)"
        for g in (gradient["one_robot"], gradient["lanes"])
    ]
    found += [
        f"two threads, {name:<12}{ratio:>8.2f} times one" for name, ratio in figures.get("two_threads", {}).items()
    ]
    return [f"{precision}  {line}" for line in found]


def _cpu_name() -> str:
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else "unknown processor"
