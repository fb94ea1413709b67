"""The inflatable robot as a function of torch tensors: designs in, distances out, with first-order gradients.

One of the two files of the project that import torch (the other is ``taichi_sim.lattice.autograd``).
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch.autograd.function import once_differentiable

from robots.inflatable.gradient import differentiate, simulate_relaxed
from robots.inflatable.relaxed_schedule import RelaxedDesign, RelaxedSchedule
from robots.world import Terrain

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
    **options: Any,
) -> torch.Tensor:
    """Distances [m] that a batch of relaxed designs travels, shape (B,).

    Every tensor that requires a gradient gets one.

    Args:
        pressure: of the core [Pa], shape (B,), or of each of N cores, shape (B, N).
        orientation: heading [degrees], shape (B,).
        inflation: of the bladders, 0 to 1, shape (B, 8, T).
        grip: of the feet, 0 to 1, shape (B, 2, T).
        core_pressure: of the core at the end of each column's motion [Pa], shape (B, T), or None.
        terrains: one for all, or one per robot; flat ground by default. Robots on one terrain run as a batch.
        repeats: how often the columns are played.
        options: of ``robots.inflatable.gradient.differentiate``.

    Raises:
        ValueError: one line; also if a robot diverges, as no number would be its distance.
    """
    batch = len(pressure)
    on = [terrains or Terrain()] * batch if terrains is None or isinstance(terrains, Terrain) else list(terrains)
    if len(on) != batch:
        raise ValueError(f"terrains: {len(on)} given for {batch} robots; give one, or one per robot")
    tensors = [pressure, orientation, inflation, grip] + ([] if core_pressure is None else [core_pressure])
    result: torch.Tensor = _Travel.apply((on, repeats, options), *tensors)  # type: ignore[no-untyped-call]
    return result


class _Travel(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, settings: tuple[Any, ...], *tensors: torch.Tensor) -> torch.Tensor:
        terrains, repeats, options = settings
        arrays = [t.detach().cpu().numpy().astype(float) for t in tensors]
        cores = arrays[4] if len(arrays) > 4 else [None] * len(terrains)
        designs = [
            RelaxedDesign(p, float(o), RelaxedSchedule(i, g, repeats, c))
            for p, o, i, g, c in zip(*arrays[:4], cores, strict=True)
        ]
        distance = np.empty(len(designs))
        slopes = [np.zeros(a.shape) for a in arrays]
        wanted = any(ctx.needs_input_grad)
        for terrain in dict.fromkeys(terrains):
            mine = [i for i, other in enumerate(terrains) if other == terrain]
            chosen = [designs[i] for i in mine]
            if wanted:
                found = differentiate(chosen, terrain, **options)
                for slope, part in zip(slopes, PARTS, strict=False):
                    slope[mine] = getattr(found, part).reshape(slope[mine].shape)
                result = found.result
            else:
                result = simulate_relaxed(chosen, terrain, **{k: v for k, v in options.items() if k != "memory"})
            distance[mine] = result.distance
        lost = np.flatnonzero(~np.isfinite(distance))
        if lost.size:
            raise ValueError(f"robot {lost[0]}: diverged; it has no distance")
        ctx.slopes, ctx.kinds = slopes, [{"dtype": t.dtype, "device": t.device} for t in tensors]
        return torch.from_numpy(distance).to(**ctx.kinds[0])

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, cotangent: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        weights = cotangent.cpu().numpy().astype(float)
        parts = (s * weights.reshape(-1, *[1] * (s.ndim - 1)) for s in ctx.slopes)
        return None, *(torch.from_numpy(p).to(**kind) for p, kind in zip(parts, ctx.kinds, strict=True))
