"""Decide which runs of version 1.0 can be continued with bit-identical results; the others are refused."""

from collections.abc import Mapping
from typing import Any

from optim.problem import GAIT, WALKER

GRADIENT_METHODS = ("gradient", "memetic", "cma-gradient")


def check_resumable(config: Mapping[str, Any], version: str | None) -> None:
    """Refuse a run whose results would differ from those of the version that began it.

    Since version 1.0, the forward and reverse passes share the laws of a step, and rest sizes are part of a snapshot.
    Results are bit-identical except for gradients (which agree to 1e-12), distances of gaits in single precision
    (1e-7) and soft walkers (1e-12). ``make same-bits`` measures this.

    Args:
        config: settings of the run.
        version: version of morpholab with which the run began; None if unknown.

    Raises:
        ValueError: if the run cannot go on exactly.
    """
    problem, method = config["problem"], config["method"]["name"]
    kind = problem.get("kind", GAIT)
    what = {
        "gradients": method in GRADIENT_METHODS,
        "gaits in f32": kind == GAIT and problem.get("precision") == "f32",
        "soft walkers": kind == WALKER,
    }
    for name, differs in what.items():
        if differs and version is not None and version.startswith("1.0"):
            raise ValueError(
                f"resume: the run is of version 1.0, and {name} are rounded otherwise since; continue it with "
                "version 1.0, or start a new run"
            )
