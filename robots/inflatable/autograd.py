"""The inflatable robot as a function of torch tensors: designs in, distances out, with first-order gradients.

It imports torch, as only ``taichi_sim.lattice.autograd`` and ``robots.control.torch_networks`` do besides.
"""

from collections.abc import Sequence
from functools import reduce
from typing import Any, Unpack

import numpy as np
import torch
from torch.autograd.function import once_differentiable

from robots.inflatable import simulation
from robots.inflatable.design import InflatableDesign
from robots.inflatable.gradient import GradientOptions, differentiate
from robots.inflatable.schedule import BLADDERS, FEET, GaitSchedule
from robots.world import Terrain, one_each
from taichi_sim.lattice.checkpoints import checked_memory

PARTS = ("pressure", "orientation", "inflation", "grip", "core_pressure")


def travel(
    pressure: torch.Tensor,
    orientation: torch.Tensor,
    inflation: torch.Tensor,
    grip: torch.Tensor,
    core_pressure: torch.Tensor | None = None,
    *,
    terrains: Terrain | Sequence[Terrain] | None = None,
    repeats: int = 2,
    **options: Unpack[GradientOptions],
) -> torch.Tensor:
    """Distances [m] that a batch of designs travels, shape (B,), in the widest floating type of the tensors.

    They are float64 where all are whole numbers. Every tensor that requires a gradient gets one.

    Args:
        pressure: of the core [Pa], shape (B,), or of each of N cores, shape (B, N).
        orientation: heading [degrees], shape (B,).
        inflation: of the bladders, 0 to 1, shape (B, 8, T).
        grip: of the feet, 0 to 1, shape (B, 2, T).
        core_pressure: of the core at the end of each column's motion [Pa], shape (B, T), or of each of N cores, shape
            (B, N, T), or None.
        terrains: one for all, or one per robot; flat ground by default. Robots on one terrain run as a batch.
        repeats: how often the columns are played.
        options: of ``robots.inflatable.gradient.differentiate``.

    Raises:
        ValueError: if an argument is not allowed, or a robot diverges, as no number would be its distance.
    """
    if "memory" in options:  # also where there is no gradient, which would not use it
        checked_memory(options["memory"])
    _check_shape("pressure", pressure, ("B",), ("B", "N"))
    batch = len(pressure)
    _check_shape("orientation", orientation, (batch,))
    _check_shape("inflation", inflation, (batch, BLADDERS, "T"))
    columns = inflation.shape[2]
    _check_shape("grip", grip, (batch, FEET, columns))
    tensors = [pressure, orientation, inflation, grip]
    if core_pressure is not None:
        _check_shape("core_pressure", core_pressure, (batch, columns), (batch, "N", columns))
        tensors.append(core_pressure)
    on = one_each(Terrain() if terrains is None else terrains, batch)
    result: torch.Tensor = _Travel.apply((on, repeats, options), *tensors)  # type: ignore[no-untyped-call]
    return result


def _check_shape(name: str, tensor: torch.Tensor, *allowed: tuple[int | str, ...]) -> None:
    """Refuse a tensor whose shape is none of those allowed, in which a letter is any number from 1.

    Raises:
        ValueError: that names it.
    """
    given = tuple(tensor.shape)
    for shape in allowed:
        pairs = zip(given, shape, strict=False)
        if len(given) == len(shape) and all(n == m or (n > 0 and isinstance(m, str)) for n, m in pairs):
            return
    told = " or ".join(str(shape).replace("'", "") for shape in allowed)
    raise ValueError(f"{name}: shape {given} is not allowed; give {told}")


class _Travel(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, settings: tuple[Any, ...], *tensors: torch.Tensor) -> torch.Tensor:
        terrains, repeats, options = settings
        arrays = [t.detach().cpu().double().numpy() for t in tensors]
        cores = arrays[4] if len(arrays) > 4 else [None] * len(terrains)
        designs = [
            InflatableDesign(p, float(o), GaitSchedule(np.concatenate([i, g]), repeats, c, skip_idle=False))
            for p, o, i, g, c in zip(*arrays[:4], cores, strict=True)
        ]
        slopes = [np.zeros(a.shape) for a in arrays]
        if any(ctx.needs_input_grad):
            found = differentiate(designs, terrains, **options)
            slopes = [getattr(found, part).reshape(a.shape) for part, a in zip(PARTS, arrays, strict=False)]
            distance = found.result.distance
        else:
            distance = simulation.simulate(
                designs, terrains, **{k: v for k, v in options.items() if k != "memory"}
            ).distance
        lost = np.flatnonzero(~np.isfinite(distance))
        if lost.size:
            raise ValueError(f"robot {lost[0]}: diverged; it has no distance")
        ctx.slopes, ctx.kinds = slopes, [{"dtype": t.dtype, "device": t.device} for t in tensors]
        floating = [t.dtype for t in tensors if t.is_floating_point()] or [torch.float64]
        return torch.from_numpy(distance).to(reduce(torch.promote_types, floating)).to(tensors[0].device)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, cotangent: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        weights = cotangent.cpu().numpy().astype(float)
        parts = (s * weights.reshape(-1, *[1] * (s.ndim - 1)) for s in ctx.slopes)
        found = zip(parts, ctx.kinds, strict=True)
        return None, *(torch.from_numpy(p).to(**k) if k["dtype"].is_floating_point else None for p, k in found)
