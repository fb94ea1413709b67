"""Exact derivatives along random directions against central differences, and what explains where they do not agree."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

AGREES = 1e-4  # relative
STEPS = (1e-5, 1e-6, 1e-7)  # of central differences, in units of what a variable may change by
MORE_STEPS = (1e-3, 1e-4, 1e-8, 1e-9)  # tried where none of those agrees
ROUGH = 1e-10  # costs, which are about 1, that differ by less from smooth ones do so by rounding
STEEP, NEARLY = 1e3, 0.01  # costs so steep are chaotic: differences agree less well, and only at the smallest steps
CANCELLED = 0.01  # derivatives below this share of what is usual in a random direction are relative to that share


@dataclass(frozen=True, eq=False)
class Direction:
    """A way to change the first robot of a case.

    Attributes:
        kind: what it changes.
        moved: the case with its robot changed by so many units.
        slope: derivative of the cost along it, by the exact gradient.
        usual: how large that is in a random direction.
    """

    kind: str
    moved: Callable[[float], Any]
    slope: float
    usual: float


Costs = Callable[[Sequence[Any]], np.ndarray]  # of cases of one robot each, all run together
Events = Callable[[Direction, float], set[str]]  # what happens in a run moved by a step to one side only


def judge(directions: Sequence[Direction], costs: Costs, events: Events) -> list[dict]:
    """A line for each direction: its kind, errors by step, and why none of them agrees."""
    errors, found = errors_of(directions, central(directions, STEPS, costs)), []
    for one, error in zip(directions, errors, strict=True):
        line = {"kind": one.kind, "errors": [float(f"{e:.2e}") for e in error], "slope": one.slope, "usual": one.usual}
        if not error.min() <= AGREES:
            line["because"] = explain(one, costs, events)
        found.append(line)
    return found


def central(directions: Sequence[Direction], steps: Sequence[float], costs: Costs) -> np.ndarray:
    """Central differences, shape (directions, steps)."""
    cases = [one.moved(sign * step) for one in directions for step in steps for sign in (1, -1)]
    values = costs(cases).reshape(len(directions), len(steps), 2)
    found: np.ndarray = (values[..., 0] - values[..., 1]) / (2 * np.asarray(steps))
    return found


def errors_of(directions: Sequence[Direction], found: np.ndarray) -> np.ndarray:
    """Relative errors of central differences, shape (directions, steps)."""
    slope, usual = (np.array([getattr(one, name) for one in directions])[:, None] for name in ("slope", "usual"))
    scale = np.maximum(np.maximum(np.abs(found), np.abs(slope)), CANCELLED * usual)
    error: np.ndarray = np.where(scale > 0, np.abs(found - slope) / np.maximum(scale, 1e-300), 0.0)
    return error


def explain(direction: Direction, costs: Costs, events: Events) -> str:
    """Why central differences do not agree: another step does, or what happened in one of the runs only."""
    differences = central([direction], (*STEPS, *MORE_STEPS), costs)
    further = errors_of([direction], differences[:, len(STEPS) :])[0]
    apart = float((np.abs(differences - direction.slope) * (*STEPS, *MORE_STEPS)).max())
    happened = sorted({name for step in STEPS[1:] for name in events(direction, step)})
    told = f"events: {', '.join(happened)}" if happened else "no events"
    if further.min() <= AGREES:
        return f"{told}; agrees with steps of {MORE_STEPS[int(further.argmin())]:g}"
    if happened:
        return told
    if apart <= ROUGH:
        return f"{told}; rounding"
    if direction.usual > STEEP and further.min() <= NEARLY:
        return f"{told}; steep, agrees to {further.min():.0e}"
    return f"unexplained: with other steps {', '.join(f'{e:.1e}' for e in further)}"
