"""A stand-in for the inflatable robot whose distances are linear in all numbers of its designs."""

from types import SimpleNamespace

import numpy as np

from robots.inflatable import SMALL
from robots.inflatable.numbers import numbers_of


class Linear:
    """Stands in for the simulator: distances are linear in all numbers of a design, and in the terrain's friction."""

    def __init__(self):
        self.calls = []

    def _run(self, designs, terrain, options):
        self.calls.append(SimpleNamespace(designs=designs, terrain=terrain, **options))
        terrains = terrain if isinstance(terrain, list) else [terrain] * len(designs)
        seeds = options.get("seed", (0,) * len(designs))
        tables = [numbers_of(design) for design in designs]
        weights = {n: np.random.default_rng(len(n)).normal(size=np.shape(t)) for n, t in tables[0].items()}
        weights = {n: w / (1e4 if "pressure" in n else 1.0) for n, w in weights.items()}
        distance = np.array([sum((weights[n] * np.array(t)).sum() for n, t in each.items()) for each in tables])
        distance = distance + [(t.high_friction or 0.0) + 0.1 * s for t, s in zip(terrains, seeds, strict=True)]
        status, parts = np.full(len(designs), "ok"), getattr(options.get("counting"), "stages", 1)
        result = SimpleNamespace(
            distance=distance,
            stages=np.tile(distance[:, None] / parts, parts),
            status=status,
            steps=np.full(len(designs), 1000),
            time_step=SMALL.time_step,
        )
        slopes = {n: np.array([w] * len(designs)) for n, w in weights.items()}
        return SimpleNamespace(result=result, **{"core_pressure": None, "pace": None, **slopes})

    def simulate(self, designs, terrain, *, progress=None, **options):
        return self.differentiate(designs, terrain, progress=progress, **options).result

    def differentiate(self, designs, terrain, *, progress=None, **options):
        found = self._run(designs, terrain, options)
        if progress:
            progress(1.0)
        return found
