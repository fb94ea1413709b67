"""What was published of the shape-changing robot's speeds [body lengths/s].

Source: Powers 2021 dissertation, ch. 5, table "simulation results" and figure "friction", d and e.
"""

from collections.abc import Mapping
from types import MappingProxyType

FLAT_MEAN, FLAT_MAX, HILL_MEAN, HILL_MAX, COMBINED = "flat_mean", "flat_max", "hill_mean", "hill_max", "combined_max"
COLUMNS = (FLAT_MEAN, FLAT_MAX, HILL_MEAN, HILL_MAX, COMBINED)

# Of changing shape by hand the text says 0.0998, its own numbers 0.09995. Of the control experiment, rolling on the
# hill, the text gives no number; those here are of the run, in which only the start was as the text says.
TABLE: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "orientation, shape, control": dict(zip(COLUMNS, (0.0791, 0.1888, 0.0023, 0.0158, 0.1023), strict=True)),
        "shape, control": dict(zip(COLUMNS, (0.0945, 0.2000, -0.0032, -0.0004, 0.0998), strict=True)),
        "control": dict(zip(COLUMNS, (0.0921, 0.1576, -0.0087, -0.0023, 0.0777), strict=True)),
        "rolling by hand": {FLAT_MAX: 0.1753, HILL_MAX: -0.5743, COMBINED: -0.1995},
        "inching by hand": {FLAT_MAX: 0.0603, HILL_MAX: 0.0246, COMBINED: 0.0424},
        "changing shape by hand": {FLAT_MAX: 0.1753, HILL_MAX: 0.0246, COMBINED: 0.0998},
        "rolling on the hill, as run": {HILL_MEAN: 0.0026, HILL_MAX: 0.0282},
    }
)

# (low, high) friction and the speed of inching on flat ground.
FRICTION: Mapping[str, tuple[tuple[float, float, float], ...]] = MappingProxyType(
    {
        "difference": (
            (0.0001, 2.0, 0.0603),
            (0.2, 1.8, 0.0450),
            (0.4, 1.6, 0.0338),
            (0.6, 1.4, 0.0223),
            (0.8, 1.2, 0.0154),
            (0.93, 1.07, 0.0032),
            (1.0, 1.0, -0.0114),
        ),
        "mean": (
            (0.13, 2.13, 0.0485),
            (0.4, 2.4, 0.0280),
            (0.8, 2.8, 0.0141),
            (1.2, 3.2, 0.0043),
            (2.0, 4.0, -0.0014),
        ),
    }
)
