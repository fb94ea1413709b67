"""Whether all ways to compute a case of articulated robots have the same bits: widths, batches, tapes and sessions."""

from dataclasses import fields

import numpy as np
from physics_bits import compare
from rigid_cases import RigidCase

from taichi_sim.rigid.state import Frames, RigidResult

WIDTHS = (1, 4)  # of lanes, one by turns; all cases are computed in the usual eight of f64, too


def everything(result: RigidResult) -> dict[str, np.ndarray]:
    """All that a run gives, robots first."""
    found = {each.name: getattr(result, each.name) for each in fields(RigidResult) if each.name != "frames"}
    if result.frames is not None:
        recorded = {each.name: getattr(result.frames, each.name) for each in fields(Frames) if each.name != "times"}
        found |= {f"recorded {name}": np.moveaxis(values, 1, 0) for name, values in recorded.items()}
    return found


def run(case: RigidCase, width: int | None = None) -> dict[str, np.ndarray]:
    """All that a run of a case gives."""
    return everything(case.engine(width).run(case.steps, record_every=case.every, **case.run_options()))


def run_in_session(case: RigidCase) -> dict[str, np.ndarray]:
    """The same with commands given as they are due, and each part of the way in two."""
    session = case.engine().session(lights=case.given["lights"], start=case.state)
    rng, commands, taken = (
        np.random.default_rng((case.number, 3)),
        case.given["commands"],
        np.zeros(len(case.trees), int),
    )
    for number in range(-(-case.steps // case.hold)):
        ahead = min(case.hold, case.steps - number * case.hold)
        first = int(rng.integers(0, ahead + 1))
        for steps, told in ((first, commands[:, number]), (ahead - first, None)):
            lost = taken < number * case.hold + (0 if told is not None else first)
            result = session.advance(told, steps)
            taken = np.where(lost, taken, taken + result.steps)
    found = everything(result)
    found["steps"] = taken
    return found


def differences(case: RigidCase) -> tuple[list[str], dict[str, np.ndarray]]:
    """What differs between ways to compute a case, none if all is well; and what the widest lanes found."""
    wide = run(case)
    width = WIDTHS[case.number % len(WIDTHS)]
    found = compare(f"width {width}", wide, run(case, width))
    last = {name: each for name, each in wide.items() if "recorded" not in name}
    if len(case.trees) > 1:
        robot = case.number % len(case.trees)
        mine = {name: each[robot : robot + 1] for name, each in wide.items()}
        found += compare(f"robot {robot} alone", mine, run(case.of([robot])))
    if np.isinf(case.options["world"].friction):
        taped = everything(case.engine().record(case.steps, **case.run_options()).result)
        found += compare("taped", last, taped)
    if "commands" in case.given and not case.maps and (wide["status"] == "ok").all():
        found += compare("in a session", last, run_in_session(case))
    return found, wide
