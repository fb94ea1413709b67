"""A stand-in for the inflatable robot on a hill, for studies that hunt for gaits."""

import os
from types import SimpleNamespace

import numpy as np
from stand_in import check_options

from optim.studies.beyond.gait_hunt.study import search_once
from robots.inflatable import simulation
from robots.inflatable.timing import WHOLE, gait_steps


def strides(designs, count):
    """How far the first bladders of each design inflate and deflate, in the mean over so many of them."""
    return np.array([np.ptp(design.schedule.inflation[:count], axis=1).mean() for design in designs])


class Hill:
    """Stands in for the simulator: gaits climb the faster, the more their first two bladders differ in time."""

    def __init__(self):
        self.calls = 0

    def __call__(self, designs, terrain=None, *, counting=WHOLE, actuation=None, perturbation=0.0, **options):
        check_options(options)
        self.calls += 1
        warm_up, stages = counting.warm_up, counting.stages
        speed = self.speeds(designs, terrain, actuation)
        steps = np.array([gait_steps(design.schedule) for design in designs]) - warm_up
        distance = speed * steps * 1.0602478e-4 * 0.22
        parts = np.repeat(distance[:, None] / stages, stages, axis=1)
        status = np.full(len(designs), "ok")
        return SimpleNamespace(
            distance=distance, speed=speed, status=status, stages=parts, steps=steps, time_step=1.0602478e-4
        )

    def speeds(self, designs, terrain, actuation):
        """Speed of each design, in body lengths a second."""
        return 0.05 * strides(designs, 2) - (0.03 if actuation and actuation.weight == "physical" else 0.0)

    def gradient(self, designs, terrain=None, **options):
        options.pop("memory", None)
        count, columns = len(designs), designs[0].schedule.columns
        return SimpleNamespace(
            result=self(designs, terrain, **options),
            orientation=np.zeros(count),
            pressure=np.zeros(count),
            levels=np.repeat([[[0.01]] * 8 + [[0.0]] * 2], count, axis=0) * np.ones(columns),
            core_pressure=np.zeros((count, columns)),
            pace=np.zeros((count, 8, columns)),
        )


def search(folder, hunt, name, seed, compute, progress):
    """A run of the hunt, with the stand-in for the simulator in whatever process it is; a file tells which."""
    before, simulation.simulate = simulation.simulate, Hill()
    try:
        found = search_once(folder, hunt, name, seed, compute, progress)
    finally:
        simulation.simulate = before
    (folder / "runs" / f"{name}-{seed}" / str(os.getpid())).touch()
    return found
