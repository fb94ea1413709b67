"""Exact derivatives along random directions against central differences, and what explains where they do not agree."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

AGREES = 1e-4  # relative
STEPS = (1e-5, 1e-6, 1e-7)  # of central differences, in units of what a variable may change by
MORE_STEPS = (1e-3, 1e-4, 1e-8, 1e-9)  # tried where none of those agrees
ROUGH = 1e-10  # costs, which are about 1, that differ by less from smooth ones do so by rounding
NEARLY = 1e-3  # a difference must agree as well as this, however large its own error may be
SAFETY = 4.0  # a difference may be off by so many times its estimated error
LATTICE = 1e-12 * np.arange(-8, 9)  # moves at which the noise of a cost is measured
ORDERS = (4, 5, 6)  # of the differences that measure it
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
    if (off := within_own_error(direction, costs)) is not None:
        return f"{told}; within the error of differences, {off:.0e}"
    return f"unexplained: with other steps {', '.join(f'{e:.1e}' for e in further)}"


def within_own_error(direction: Direction, costs: Costs) -> float | None:
    """Relative error of the most certain central difference if it is no larger than that difference's own error.

    A chaotic motion amplifies both what rounding does to a cost and its higher derivatives, so that no step is good to
    1e-4. The error of a difference is estimated as noise / step, with the noise of the cost as measured, and a third of
    how far it is from the difference of twice the step (Richardson).
    """
    steps = np.array([step for decade in (*STEPS, *MORE_STEPS) for step in (decade, decade / 2)])
    found, coarser = (central([direction], tuple(by * steps), costs) for by in (1.0, 2.0))
    own = noise_of(direction, costs) / steps + np.abs(coarser - found)[0] / 3
    if np.isnan(own).all():
        return None
    surest = int(np.nanargmin(own))
    off, relative = abs(float(found[0, surest]) - direction.slope), float(errors_of([direction], found)[0, surest])
    return relative if off <= SAFETY * own[surest] and relative <= NEARLY else None


def noise_of(direction: Direction, costs: Costs) -> float:
    """Standard deviation of what rounding adds to a cost, by high differences at close moves (Moré and Wild 2011)."""
    values = costs([direction.moved(float(move)) for move in LATTICE])
    scaled = [
        math.factorial(order) ** 2 / math.factorial(2 * order) * float((np.diff(values, order) ** 2).mean())
        for order in ORDERS
    ]
    return math.sqrt(float(np.median(scaled)))


def agree(found, least):
    """Differences along so many directions agree, or something happened between them."""
    directions = [one for one in found if one["kind"] != "drivers"]
    assert not found[-1]["differs"] and sum(one["usual"] > 0 for one in directions) >= least
    assert all(min(one["errors"]) <= AGREES or one["because"].startswith("events") for one in directions)
