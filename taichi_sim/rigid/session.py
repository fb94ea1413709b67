"""Robots under commands, a few steps at a time: for controllers that are not the engine's own."""

from collections.abc import Callable, Sequence

import numpy as np

from taichi_sim import runtime
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.rigid import slots
from taichi_sim.rigid.model.shapes import is_whole
from taichi_sim.rigid.part import Part, Setup
from taichi_sim.rigid.state import RigidResult


class RigidSession:
    """A run that stops for new commands; made by :meth:`RigidEngine.session`.

    All that robots carry from step to step stays in their memory, so that they have the same bits as in a run that is
    given all commands at once.
    """

    def __init__(
        self,
        setup: Setup,
        parts: Sequence[tuple[Part, Ints]],
        result: Callable[[np.ndarray], RigidResult],
    ) -> None:
        """Start with parts in their first state, and a way to read a result off the memory of all robots."""
        self._setup, self._parts, self._result = setup, parts, result

    @runtime.exclusive
    def advance(self, commands: Floats | None = None, steps: int = 1) -> RigidResult:
        """Keep commands for some steps; with 0 steps sense what there is.

        Args:
            commands: to all motors, (B, M); those before if None, zeros at first.
            steps: time steps.

        Returns:
            Where robots are now, and what they sense there; ``steps`` counts from this call.

        Raises:
            ValueError: for arrays of other shapes or numbers that are not allowed.
        """
        plan, batch = self._setup.plan, self._setup.given.batch
        motors = int(plan[slots.MOTORS])
        if not is_whole(steps) or steps < 0:
            raise ValueError(f"steps: {steps!r} is not allowed; give a whole number, at least 0")
        given = None if commands is None else np.asarray(commands, float)
        if given is not None and (given.shape != (batch, motors) or not np.isfinite(given).all()):
            raise ValueError(f"commands: shape {given.shape} is not allowed; give finite numbers, ({batch}, {motors})")
        runtime.start(self._setup.compute)
        plan[slots.STEPS] = steps  # which kernels read at every launch
        found = []
        for part, chosen in self._parts:
            if given is not None:
                held = part.memory.read()
                padded = np.resize(chosen, held.shape[1])
                held[plan[slots.COMMAND] : plan[slots.COMMAND] + motors] = given[padded].T
                part.memory.write(held)
            part.run()
            found.append(part.memory.read()[:, : len(chosen)])
        return self._result(np.concatenate(found, -1))
