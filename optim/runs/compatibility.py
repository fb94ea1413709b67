"""Which runs of version 1.0 go on to the same bits, and which are refused."""

from collections.abc import Mapping
from typing import Any

from optim.problem import GAIT, WALKER

GRADIENT_METHODS = ("gradient", "memetic", "cma-gradient")


def check_resumable(config: Mapping[str, Any], version: str | None) -> None:
    """Refuse a run that this version would continue to other bits than those of the version that began it.

    Since version 1.0 the laws of a step are shared with its way back, and rest sizes are part of a snapshot. Results
    are the same bits but for three: gradients (to 1e-12), distances of gaits in single precision (to 1e-7), and
    soft walkers (to 1e-12). ``make same-bits`` measures this.

    Args:
        config: of the run.
        version: of morpholab, with which the run began; None if it is not known.

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
