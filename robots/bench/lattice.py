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
from robots.bench.control import EVERY, Network
from robots.bench.rates import best_and_median, prototype_rate, rates_of_tree
from robots.ground import Ground
from robots.inflatable import INCHING, PUBLISHED, GaitSchedule, InflatableDesign
from robots.inflatable.program import build_program
from robots.inflatable.schedule import ROWS
from robots.world import Terrain
from taichi_sim import runtime
from taichi_sim.base.compute import Compute, available_threads
from taichi_sim.lattice import LatticeEngine, LatticeProgram, Material, ProgramBuilder, Relief, body_from_array
from taichi_sim.lattice.drivers.roofline import FLOPS_PER_VOXEL_STEP, measure_peak

COLUMN = 11_670  # steps of a moving column of the published gaits
GRADIENT_MEMORY = 2e9  # B
PIECES = 8  # of a measurement
SEVERAL = 16  # robots whose networks answer together
# Readings in a measured piece of one robot, and of several. What a run costs once, its checks and its places among all
# others, is not what a reading costs: in a piece of nine readings it is a third of it.
READINGS, READINGS_OF_SEVERAL = 40, 10
CLIMBERS, COLUMNS, MAXIMUM_SEARCHED = 60, 8, 12e3  # of the published co-design; the core's pressure in Pa
UNEVEN = "rough:0.005"  # hills under the robot [m]
GROUNDS = {"uneven": UNEVEN, "sand": "sand:2e5", "shore": f"{UNEVEN}+water:0.02"}
HOLED, BODIES = (10, 6, 4), 8  # cells of which a part is there, and how many such bodies are set up
OWN_STEPS = 1000  # of each of them
WARM_UP = 3000  # steps: the bladders have snapped to their thickness and contact is as usual


class Batch:
    """A batch of the published robot at the published inching gait, advanced piece by piece."""

    def __init__(
        self,
        batch: int,
        precision: str,
        threads: int,
        ground: str | None = None,
        network: Network | None = None,
        device: str = "cpu",
    ) -> None:
        """Set up the batch on a floor or uneven ground; time the first step [s], compilation included.

        A network controls it in the loop.
        """
        self.batch, self._done, self._network = batch, 0, network
        self._program = build_program([INCHING] * batch, Terrain())
        compute, body, time_step = Compute(device, precision, threads), PUBLISHED.body, PUBLISHED.time_step
        runtime.start(compute)
        started = time.perf_counter()
        floor = True if ground is None else Ground(ground).relief(0.0, PUBLISHED.voxel_size)
        own: dict[str, Any] = {"time_step": time_step, "floor": floor, "self_contact": "published"}
        self.engine = LatticeEngine(body, batch, **own, compute=compute)
        if isinstance(floor, Relief):
            start = body.start_positions + np.array([0, 0, floor.rise(body.start_positions, PUBLISHED.voxel_size)])
            self.engine.set_positions(np.tile(start, (batch, 1, 1)))
        self.advance(1)
        self.first_step = time.perf_counter() - started

    def advance(self, steps: int) -> None:
        """Run the next ``steps`` steps of the gait."""
        result = self.engine.run(self._piece(steps), feedback=self._network)
        if (result.status != "ok").any():
            raise RuntimeError("the benchmark's robots diverged")

    def differentiate(self, steps: int, memory: float = GRADIENT_MEMORY) -> float:
        """Run the next ``steps`` steps and differentiate them backwards; return the memory of the tape [B]."""
        tape = self.engine.record(self._piece(steps), memory=memory, feedback=self._network)
        tape.pull_back(positions=np.ones_like(tape.result.positions))
        return tape.memory

    def _piece(self, steps: int) -> LatticeProgram:
        """Program of the next ``steps`` steps of the gait, which records the pose at their end."""
        events = self._program.events
        piece = events[(events["step"] >= self._done) & (events["step"] < self._done + steps)].copy()
        piece["step"] -= self._done
        self._done += steps
        program = LatticeProgram(np.full(self.batch, steps), piece, np.full((self.batch, 1), steps))
        return program if self._network is None else self._network.plan(program)


def rates(clock: Callable[[], float], batch: Batch, steps: int, pieces: int = PIECES) -> dict[str, float]:
    """Measure robot-steps per second in several pieces of a run."""
    batch.advance(WARM_UP - 1)
    return best_and_median([batch.batch * steps / timed(clock, batch.advance, steps)[0] for _ in range(pieces)])


def measure(precision: str, quick: bool, prototype: Path | None) -> dict[str, Any]:
    """Measure all rates in one precision."""
    steps = 500 if quick else 2000
    before = _prototype_rate(prototype, precision) if prototype else None
    single = Batch(1, precision, 1)
    found: dict[str, Any] = {
        "first_step_s": single.first_step,
        "kilobytes_per_robot": single.engine.bytes_per_robot / 1e3,
    }
    peak = measure_peak(precision)
    rate = found["single_robot_steps_per_second"] = rates(time.process_time, single, steps)
    voxel_steps = rate["best"] * PUBLISHED.body.voxel_count
    found["million_voxel_steps_per_core_second"] = voxel_steps / 1e6
    found["part_of_peak"] = voxel_steps * FLOPS_PER_VOXEL_STEP / peak
    if prototype and before:
        after = _prototype_rate(prototype, precision)
        found["prototype"] = {"before": before, "after": after}
        found["ratio_to_prototype"] = rate["median"] / ((before + after) / 2)
    found["gradient"] = gradient_cost(precision, 2000 if quick else COLUMN)
    for name, ground in GROUNDS.items():
        found[name] = beside(Batch(1, precision, 1, ground), steps)
    found.update(networks(precision, steps))
    found["both"] = {"gradient_in_forward_runs": gradient_cost(precision, steps, UNEVEN, True)["in_forward_runs"]}
    found["own_body"] = own_bodies(precision)
    found["generation"] = generation(precision, 0.02 if quick else 0.04)
    if available_threads() > 1:
        one, two = (rates(time.perf_counter, Batch(2, precision, threads), steps)["best"] for threads in (1, 2))
        found["two_threads"] = two / one
    return found


def networks(precision: str, steps: int) -> dict[str, dict[str, Any]]:
    """Measure what a network in the loop costs one robot and several, in pieces of at least so many steps in all."""
    one, several = (Batch(count, precision, 1, network=Network()) for count in (1, SEVERAL))
    return {
        "network": beside(one, max(steps, READINGS * EVERY)),
        "network_of_several": beside(several, max(steps // SEVERAL, READINGS_OF_SEVERAL * EVERY)),
    }


def generation(precision: str, part: float) -> dict[str, float]:
    """Measure the robot-steps per CPU second of a generation of the published co-design, all robots unlike.

    Args:
        precision: ``"f32"`` or ``"f64"``.
        part: of each robot's gait, from its start, that is simulated.
    """
    generator = np.random.default_rng(0)
    codes = generator.integers(0, COLUMNS + 1, (CLIMBERS, 2, ROWS))
    flat, round_ = 0.0, MAXIMUM_SEARCHED
    designs = [
        InflatableDesign(generator.uniform(flat, round_), generator.uniform(0, 90), GaitSchedule.from_codes(*code))
        for code in codes
    ]
    program = build_program(designs, Terrain())
    lengths = (program.lengths * part).astype(int)
    events = program.events[program.events["step"] < lengths[program.events["robot"]]]
    engine = LatticeEngine(PUBLISHED.body, CLIMBERS, time_step=PUBLISHED.time_step, floor=True, precision=precision)
    begun = time.process_time()
    steps = int(engine.run(LatticeProgram(lengths, events, lengths[:, None])).steps.sum())
    rate = steps / (time.process_time() - begun)
    return {"robot_steps_per_core_second": rate, "core_hours": float(program.lengths.sum()) / rate / 3600}


def own_bodies(precision: str) -> dict[str, float]:
    """Measure the CPU time that a body of its own takes until it moves, as each does in a search for bodies [s].

    Bodies are blocks of random holes; the median of several, alone and in 1,000 of its own steps.
    """
    generator, rubber = np.random.default_rng(0), Material(1e5, 1e3, static_friction=1.0, kinetic_friction=0.8)
    ready, moving = [], []
    for _ in range(BODIES + 1):  # the first one compiles
        body = body_from_array((generator.random(HOLED) < 0.6).astype(int), rubber, 0.01)
        program = ProgramBuilder(robot_count=1).build(lengths=OWN_STEPS)
        begun = time.process_time()
        engine = LatticeEngine(body, 1, floor=True, gravity=9.81, precision=precision, threads=1)
        engine.run(ProgramBuilder(robot_count=1).build(lengths=1))
        ready.append(time.process_time() - begun)
        moving.append(timed(time.process_time, engine.run, program)[0])
    ratios = np.array(ready[1:]) / np.array(moving[1:])
    return {"seconds": float(np.median(ready[1:])), "in_1000_steps": float(np.median(ratios))}


def _prototype_rate(path: Path, precision: str) -> float:
    """Rate of a reference program: the first number after "f32:" or "f64:" on its last line."""
    pattern, place = rf"{precision}: *([0-9.]+)[^\n]*\s*$", f"after {precision}: on its last line"
    return prototype_rate("prototype", path, [precision], pattern, place)


def gradient_cost(precision: str, steps: int, ground: str | None = None, controlled: bool = False) -> dict[str, Any]:
    """Measure the CPU time of a robot's gradients over ``steps`` steps, and as a multiple of forward runs.

    It includes the steps that the backward pass computes again.
    """
    batch = Batch(1, precision, 1, ground, Network() if controlled else None)
    batch.differentiate(50)  # compiles
    batch.advance(WARM_UP - 51)
    gone, _ = timed(time.process_time, batch.advance, steps)
    again = Batch(1, precision, 1, ground, Network() if controlled else None)
    again.advance(WARM_UP - 1)
    seconds, memory = timed(time.process_time, again.differentiate, steps)
    return {
        "steps": steps,
        "steps_per_second": steps / seconds,
        "in_forward_runs": seconds / gone,
        "megabytes": memory / 1e6,
    }


def beside(other: Batch, steps: int) -> dict[str, Any]:
    """Measure what a batch's steps cost in those of a plain one, in turns over the same parts of the gait."""
    plain = Batch(other.batch, other.engine.compute.precision, 1)
    for each in (plain, other):
        each.advance(WARM_UP - 1)
    pairs = [[timed(time.process_time, one.advance, steps)[0] for one in (plain, other)] for _ in range(PIECES)]
    return {"in_plain_steps": float(np.median([after / before for before, after in pairs]))}


def timed(clock: Callable[[], float], work: Callable[[Any], Any], steps: Any) -> tuple[float, Any]:
    """Time of ``work(steps)``, or of a program, [s], and its result."""
    begun = clock()
    result = work(steps)
    return clock() - begun, result


def main(args: Namespace) -> dict[str, Any]:
    """Measure all rates and print them as tables (to stderr with ``--json``); return the numbers."""
    out = sys.stderr if args.json else sys.stdout
    figures: dict[str, Any] = {"cpu": cpu_name(), "cores": os.cpu_count()}
    machine = f"{figures['cpu']}, {figures['cores']} cores"
    if args.robot in ("all", "inflatable"):
        print(f"{machine}; published robot, 1428 voxels, full physics", file=out)
        for precision in [args.precision] if args.precision else ["f32", "f64"]:
            figures[precision] = measure(precision, args.quick, args.prototype)
            print("\n".join(lines(figures[precision], precision)), file=out)
            if args.against:
                other = figures[f"{precision}_of_other"] = rates_of_tree(args.against, precision, args.quick)
                print(f"against {args.against}:", file=out)
                print("\n".join(against_lines(figures[precision], other, precision)), file=out)
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
    single, gradient, whole = (figures[n] for n in ("single_robot_steps_per_second", "gradient", "generation"))
    found = [
        f"one robot, one core      {single['median']:>8.0f} steps/s (best {single['best']:.0f})",
        f"voxels, best piece       {figures['million_voxel_steps_per_core_second']:>8.1f} million voxel-steps/s",
        f"of the core's peak       {figures['part_of_peak']:>8.0%} ({FLOPS_PER_VOXEL_STEP} flop a voxel-step)",
        f"gradient, one robot      {gradient['steps_per_second']:>8.0f} steps/s ({gradient['in_forward_runs']:.1f} "
        f"forward runs; {gradient['steps']} steps, {gradient['megabytes']:.0f} MB)",
        f"{CLIMBERS} climbers, a core      {whole['robot_steps_per_core_second']:>8.0f} robot-steps/s (a generation: "
        f"{whole['core_hours']:.3f} core-hours)",
        f"on uneven ground         {figures['uneven']['in_plain_steps']:>8.2f} steps on a floor",
        f"on sand                  {figures['sand']['in_plain_steps']:>8.2f} steps on a floor",
        f"uneven, half in water    {figures['shore']['in_plain_steps']:>8.2f} steps on a floor",
        f"network of 16-16-8       {figures['network']['in_plain_steps']:>8.2f} steps without, read every 50 steps; "
        f"{SEVERAL} robots {figures['network_of_several']['in_plain_steps']:.2f}",
        f"gradient with both       {figures['both']['gradient_in_forward_runs']:>8.1f} forward runs",
        f"a body of its own        {1000 * figures['own_body']['seconds']:>8.0f} ms until it moves "
        f"({figures['own_body']['in_1000_steps']:.2f} of 1,000 of its steps)",
        f"first step               {figures['first_step_s']:>8.1f} s",
        f"memory per robot         {figures['kilobytes_per_robot']:>8.0f} KB",
    ]
    if "ratio_to_prototype" in figures:
        found.insert(1, f"ratio to the prototype   {figures['ratio_to_prototype']:>8.2f}")
    if "two_threads" in figures:
        found.append(f"two threads              {figures['two_threads']:>8.2f} times one")
    return [f"{precision}  {line}" for line in found]


def against_lines(mine: dict[str, Any], other: dict[str, Any], precision: str) -> list[str]:
    """Lines that compare with the figures of another version, measured in the same run."""
    pairs = [
        ("one robot", mine["single_robot_steps_per_second"], other["single_robot_steps_per_second"]),
        ("a full vector of robots", mine["single_robot_steps_per_second"], other.get("robot_steps_per_core_second")),
    ]
    found = [
        f"{name:<24} {a['median'] / b['median']:>8.2f} times (best {a['best'] / b['best']:.2f})"
        for name, a, b in pairs
        if b
    ]
    theirs = other["gradient"]
    if "one_robot" in theirs:  # version 1.0
        rate = other["single_robot_steps_per_second"]["median"] / theirs["one_robot"]["in_its_own_forward_runs"]
    else:
        rate = theirs["steps_per_second"]
    found.append(f"gradient, one robot      {mine['gradient']['steps_per_second'] / rate:>8.2f} times")
    return [f"{precision}  {line}" for line in found]


def cpu_name() -> str:
    """Name of the processor, on Linux."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else "unknown processor"
