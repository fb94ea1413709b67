"""Robots under commands, a few steps at a time: for controllers that are not the engine's own."""

import numpy as np

from taichi_sim import runtime
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats
from taichi_sim.rigid import slots
from taichi_sim.rigid.run import Run
from taichi_sim.rigid.state import RigidResult


class RigidSession:
    """A simulation that pauses for new commands; made by :meth:`RigidEngine.session`.

    All that robots carry from step to step stays in their memory, so that they have the same bits as in a run that is
    given all commands at once.
    """

    def __init__(self, run: Run) -> None:
        """Put robots where the run starts."""
        self._run, self._parts = run, list(run.parts())

    @runtime.exclusive
    def advance(self, commands: Floats | None = None, steps: int = 1) -> RigidResult:
        """Simulate some time steps with constant commands; 0 steps only read the sensors.

        Args:
            commands: to all motors, (B, M); those before if None, zeros at first.
            steps: time steps.

        Returns:
            Where robots are now, and what they sense there; ``steps`` counts from this call.

        Raises:
            ValueError: for arrays of other shapes or numbers that are not allowed.
        """
        plan = self._run.plan
        plan[[slots.STEPS, slots.UNTIL]] = checks.integer("steps", steps, 0)  # which kernels read at every launch
        motors = int(plan[slots.MOTORS])
        given = None if commands is None else checks.numbers("commands", commands, self._run.batch, motors)
        runtime.start(self._run.compute)
        for part in self._parts:
            if given is not None:
                part.command(0, given[part.robots])
            part.run()
        return self._run.result(np.concatenate([part.state() for part in self._parts], -1))
