"""Whether all ways to compute a case have the same bits: drivers, batches, and runs in parts."""

import numpy as np
from physics_cases import Case

from taichi_sim.lattice import LatticeEngine
from taichi_sim.lattice.engine import LatticeResult

RECORDED = ("positions", "orientations", "strains", "sizes")


def everything(engine: LatticeEngine, result: LatticeResult) -> dict[str, np.ndarray]:
    """All that a run gives and leaves, robots first."""
    found = {f"recorded {name}": getattr(result, name) for name in RECORDED}
    found |= {"status": result.status, "steps": result.steps}
    state = engine.state()
    return found | {f"last {name}": getattr(state, name) for name in state.__dataclass_fields__}


def run(case: Case, engine: LatticeEngine) -> dict[str, np.ndarray]:
    """All that a run of a case gives."""
    return everything(engine, engine.run(case.program, feedback=case.reflex))


def run_in_parts(case: Case, engine: LatticeEngine) -> dict[str, np.ndarray]:
    """The same anew in two runs, the second made twice, from what was saved; recordings of the first are infinite."""
    engine.reset()
    engine.set_state(case.state)
    lengths = case.program.lengths
    first, rest = case.program.split((lengths * (0.2 + 0.6 * np.random.default_rng(case.number).random())).astype(int))
    begun = engine.run(first)
    saved = engine.save()
    engine.run(rest.program)
    engine.restore(saved)
    found = everything(engine, engine.run(rest.program))
    found["steps"] = found["steps"] + np.where(begun.status == "ok", begun.steps, 0)
    for name in RECORDED:
        whole = found[f"recorded {name}"]
        there = (rest.program.snapshots > 0).reshape(*whole.shape[:2], *(1,) * (whole.ndim - 2))
        found[f"recorded {name}"] = np.where(there, whole, np.inf)
    return found


def same(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two arrays have the same bits, up to those of NaN."""
    if a.dtype.kind != "f":
        return bool(np.array_equal(a, b))
    return a.shape == b.shape and bool(((a.view(np.int64) == b.view(np.int64)) | (np.isnan(a) & np.isnan(b))).all())


def differences(case: Case) -> tuple[list[str], dict[str, np.ndarray]]:
    """What differs between ways to compute a case, none if all is well; and what the packed driver found."""
    engine = case.engine("packed")
    packed = run(case, engine)
    found = compare("stepped", packed, run(case, case.engine("stepped")))
    if len(case.bodies) > 1:
        robot = case.number % len(case.bodies)
        single = case.of([robot])
        alone = run(single, single.engine("packed"))
        found += compare(
            f"robot {robot} alone", {name: each[robot : robot + 1] for name, each in packed.items()}, alone
        )
    if case.reflex is None and (packed["status"] == "ok").all():
        parts = run_in_parts(case, engine)
        masked = {name: np.where(np.isposinf(parts[name]), np.inf, each) if each.dtype.kind == "f" else each
                  for name, each in packed.items()}  # fmt: skip
        found += compare("in parts", masked, parts)
    return found, packed


def compare(way: str, wanted: dict[str, np.ndarray], found: dict[str, np.ndarray]) -> list[str]:
    """One line for each thing that differs."""
    return [
        f"{way}: {name} by {largest(each, found[name])}"
        for name, each in wanted.items()
        if not same(np.ascontiguousarray(each), np.ascontiguousarray(found[name]))
    ]


def largest(a: np.ndarray, b: np.ndarray) -> str:
    """The largest difference, for people."""
    if a.dtype.kind != "f" or a.shape != b.shape:
        return "other values"
    apart = np.abs(a - b)
    return f"{np.nanmax(apart):.1e}" if np.isfinite(apart).any() else "NaN"
