"""A stand-in for the simulator, for tests of what is above it."""

import os
from inspect import signature
from types import SimpleNamespace

import numpy as np

from robots.inflatable import ACTUATION, PUBLISHED
from robots.inflatable.simulation import InflatableResult, simulate, travel_directions
from robots.inflatable.timing import gait_steps
from robots.world import one_each
from taichi_sim.base.compute import ComputeOptions


def check_options(options):
    """Refuse options that ``simulate`` does not take, which a stand-in for it would hide."""
    if unknown := options.keys() - signature(simulate).parameters.keys() - ComputeOptions.__annotations__.keys():
        raise TypeError(f"simulate takes no {', '.join(sorted(unknown))}")


class Simulator:
    """Stands in for ``simulate``, for gaits of either kind: quick, smooth; remembers its calls."""

    def __init__(self):
        self.calls = []
        self.diverges = lambda design, terrain: False
        self.interrupt_at = None

    def __call__(self, designs, terrain, *, progress=None, **options):
        check_options(options)
        self.calls.append(SimpleNamespace(designs=designs, terrain=terrain, **options))
        os.write(1, b"chatter of the simulator\n")
        if len(self.calls) == self.interrupt_at:
            raise KeyboardInterrupt
        if progress:
            progress(0.5)
        terrains = one_each(terrain, len(designs))
        failed = np.array([self.diverges(design, ground) for design, ground in zip(designs, terrains, strict=True)])
        bits = np.array([design.schedule.levels.mean() for design in designs])
        pressure = np.array([np.mean(design.pressure) / 12e3 for design in designs])
        orientation = np.array([design.orientation / 90 for design in designs])
        slope = np.array([ground.slope for ground in terrains])
        speed = np.where(failed, np.nan, bits * pressure - abs(orientation - slope / 20))
        begins = [ACTUATION.initial_steps(float(np.max(design.pressure))) for design in designs]
        steps = np.array(begins) + [gait_steps(design.schedule) for design in designs]
        stages = getattr(options.get("counting"), "stages", 1)
        frames = SimpleNamespace(times=np.arange(3.0)) if options.get("record_every") else None
        status = np.where(failed, "diverged", "ok")
        return InflatableResult(
            distance=speed * 4,
            displacement=speed[:, None] * 4 * travel_directions(orientation * 90),
            speed=speed,
            speed_simulated=speed * 2,
            status=status,
            stages=np.tile(speed[:, None] * 4 / stages, stages),
            time_step=PUBLISHED.time_step,
            steps=steps,
            frames=frames,
            body=None,
        )
