"""The lattice as a function of torch tensors, with first-order gradients.

The only file of the package that imports torch. Tensors lie on the CPU, in f64; NumPy arrays and tensors share memory.
"""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, NamedTuple

import numpy as np
import torch
from torch.autograd.function import once_differentiable

from taichi_sim.lattice.body import LatticeBody
from taichi_sim.lattice.checkpoints import checked_memory
from taichi_sim.lattice.engine import LatticeEngine, LatticeState
from taichi_sim.lattice.gradient import LatticeGradient, Tape
from taichi_sim.lattice.materials import Material
from taichi_sim.lattice.program import LatticeProgram

STATE = ("positions", "orientations", "velocities", "angular_velocities")
RECORDED = ("positions", "orientations", "strains", "sizes")
NUMBERS = tuple(f.name for f in fields(Material) if f.name != "name")


class RunTensors(NamedTuple):
    """What a run gave; see ``LatticeResult`` for what was recorded and ``LatticeState`` for the state at the end."""

    positions: torch.Tensor
    orientations: torch.Tensor
    strains: torch.Tensor
    sizes: torch.Tensor
    final_positions: torch.Tensor
    final_orientations: torch.Tensor
    final_velocities: torch.Tensor
    final_angular_velocities: torch.Tensor


def run(
    body: LatticeBody,
    program: LatticeProgram,
    *,
    values: torch.Tensor | None = None,
    rates: torch.Tensor | None = None,
    state: Mapping[str, torch.Tensor] | None = None,
    materials: Mapping[str, torch.Tensor] | None = None,
    memory: float = 1e9,
    **options: Any,
) -> RunTensors:
    """Run a program from the body's start; every tensor that requires a gradient gets one.

    Args:
        body: of all robots.
        program: what happens; its number of robots is the batch.
        values, rates: replace those of the program's events, shape (E,).
        state: replaces parts of the state at the start by name, such as ``positions`` of shape (B, V, 3).
        materials: replaces numbers of the materials by name, such as ``youngs_modulus``, each of shape (B, M),
            ``scale`` of (B, M, 3). They need ``time_step`` among the options: the largest stable one changes with them.
        memory: bound [B] on what is kept for the gradient.
        options: of ``LatticeEngine``.

    Raises:
        ValueError: for bad input; also if a robot diverges, as no number would be its result.
    """
    memory = checked_memory(memory)  # also where there is no gradient, which would not use it
    given = {"values": values, "rates": rates} | {f"state.{k}": v for k, v in (state or {}).items()}
    given |= {f"materials.{k}": v for k, v in (materials or {}).items()}
    tensors = {name: torch.as_tensor(value) for name, value in given.items() if value is not None}
    for name in tensors:
        part, _, field = name.partition(".")
        if part == "state" and field not in STATE:
            raise ValueError(f"state: {field!r} is unknown; choose from {', '.join(STATE)}")
        if part == "materials" and field not in NUMBERS:
            raise ValueError(f"materials: {field!r} is unknown; choose from {', '.join(NUMBERS)}")
    if materials and options.get("time_step") is None:
        raise ValueError("time_step: none given; with materials as tensors, fix it among the options")
    settings = (body, program, memory, options, tuple(tensors))
    return RunTensors(*_Run.apply(settings, *tensors.values()))


class _Run(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, settings: tuple[Any, ...], *tensors: torch.Tensor) -> tuple[torch.Tensor, ...]:
        body, program, memory, options, names = settings
        arrays = dict(zip(names, (t.detach().cpu().numpy() for t in tensors), strict=True))
        engine, program = _prepare(body, program, arrays, options)
        tape: Tape | None = engine.record(program, memory) if any(ctx.needs_input_grad) else None
        result = tape.result if tape else engine.run(program)
        for robot in np.flatnonzero(result.status != "ok"):
            raise ValueError(f"robot {robot}: diverged at step {result.steps[robot]}; it has no result")
        ctx.tape, ctx.names = tape, names
        ctx.kinds = [{"dtype": t.dtype, "device": t.device} for t in tensors]
        state = engine.state()
        found = [getattr(result, name) for name in RECORDED] + [getattr(state, name) for name in STATE]
        return tuple(torch.from_numpy(np.ascontiguousarray(array, float)) for array in found)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *cotangents: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        parts = [c.numpy() for c in cotangents]
        gradient = ctx.tape.pull_back(*parts[:4], state=LatticeState(*parts[4:]))
        found = (torch.from_numpy(_part(gradient, name)) for name in ctx.names)
        return None, *(g.to(**kind) for g, kind in zip(found, ctx.kinds, strict=True))


def _prepare(
    body: LatticeBody, program: LatticeProgram, arrays: dict[str, np.ndarray], options: dict[str, Any]
) -> tuple[LatticeEngine, LatticeProgram]:
    """The engine and the program with what the tensors replace."""
    events = program.events.copy()
    for name, field in (("values", "value"), ("rates", "rate")):
        if name in arrays:
            if arrays[name].shape != events.shape:
                raise ValueError(f"{name}: shape {arrays[name].shape} is not allowed; give {events.shape}")
            events[field] = arrays[name]
    batch, count = program.robot_count, len(body.materials)
    numbers = {name.partition(".")[2]: a for name, a in arrays.items() if name.startswith("materials.")}
    for name, array in numbers.items():
        shape = (batch, count, 3) if name == "scale" else (batch, count)
        if array.shape != shape:
            raise ValueError(f"materials.{name}: shape {array.shape} is not allowed; give {shape}")
    bodies = [body] * batch
    if numbers:
        bodies = [
            replace(
                body,
                materials=tuple(
                    replace(m, **{name: array[robot, i].tolist() for name, array in numbers.items()})
                    for i, m in enumerate(body.materials)
                ),
            )
            for robot in range(batch)
        ]
    engine = LatticeEngine(bodies, **options)
    state = engine.state()
    replaced = {name: arrays.get(f"state.{name}", getattr(state, name)) for name in STATE}
    engine.set_state(LatticeState(**replaced))
    return engine, LatticeProgram(program.lengths, events, program.snapshots)


def _part(gradient: LatticeGradient, name: str) -> np.ndarray:
    part, _, field = name.partition(".")
    if part == "materials":
        return gradient.materials[field]
    return np.ascontiguousarray(getattr(gradient, field or part))
