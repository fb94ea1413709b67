"""Exact gradients of random cases against central differences, and what happened where the two do not agree."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from physics_cases import EDGE, Case, Reflex, scales
from physics_directions import Direction, judge

from taichi_sim.lattice import LatticeEngine, LatticeProgram, LatticeState, Relief
from taichi_sim.lattice.engine import LatticeResult
from taichi_sim.lattice.gradient import LatticeGradient
from taichi_sim.lattice.laws import contact
from taichi_sim.lattice.stages import memory

DIRECTIONS = 2  # of each kind of variable
PARTS = ("positions", "orientations", "velocities", "angular_velocities")
SIZES = {"positions": EDGE, "orientations": 0.1, "velocities": 0.1, "angular_velocities": 5.0}
NUMBERS = ("youngs_modulus", "density", "poissons_ratio", "static_friction", "kinetic_friction", "internal_damping",
           "global_damping", "collision_damping", "thermal_expansion", "temperature")  # fmt: skip


class Cost:
    """A random smooth function of all that a run records and leaves, of like weight in each part."""

    def __init__(self, case: Case) -> None:
        """Draw it."""
        rng = np.random.default_rng((case.number, 1))
        body, marks = case.bodies[0], case.program.snapshots.shape[1]
        shape = (marks, body.voxel_count)
        self.recorded = {
            "positions": rng.normal(size=(*shape, 3)) / 1e-3,
            "orientations": rng.normal(size=(*shape, 4)) / 1e-2,
            "strains": rng.normal(size=(marks, len(body.topology.links))) / 1e-2,
            "sizes": rng.normal(size=(*shape, 3)) / 1e-3,
        }
        units = dict(zip(PARTS, (1e-3, 1e-2, 0.1, 1.0), strict=True))
        start = {name: getattr(case.state, name)[0] for name in PARTS}
        self.last = {name: rng.normal(size=start[name].shape) / units[name] for name in PARTS}
        self.start = {"positions": body.start_positions} | {
            name: np.zeros(()) for name in ("orientations", "strains", "sizes")
        }

    def of(self, engine: LatticeEngine, result: LatticeResult) -> np.ndarray:
        """Its value for every robot; NaN for those that diverged."""
        state, value = engine.state(), np.zeros(engine.batch)
        for name, weight in self.recorded.items():
            apart = (getattr(result, name) - self.start[name]) * weight
            value += np.sin(1e-3 * apart).reshape(engine.batch, -1).sum(axis=1)
        for name, weight in self.last.items():
            apart = (getattr(state, name) - (self.start["positions"] if name == "positions" else 0.0)) * weight
            value += np.sin(1e-3 * apart).reshape(engine.batch, -1).sum(axis=1)
        return value

    def slopes(self, result: LatticeResult, state: LatticeState) -> dict[str, np.ndarray | LatticeState]:
        """What a tape pulls back."""
        by = lambda value, weight: 1e-3 * weight * np.cos(1e-3 * value * weight)  # noqa: E731
        found = {n: by(getattr(result, n) - self.start[n], w) for n, w in self.recorded.items()}
        last = {n: getattr(state, n) - (self.start["positions"] if n == "positions" else 0.0) for n in PARTS}
        return found | {"state": LatticeState(*(by(last[name], self.last[name]) for name in PARTS))}


def gradient_of(case: Case, cost: Cost, driver: str, room: float = 1e9) -> LatticeGradient | None:
    """The gradient of the cost of a case of one robot; None if it diverges."""
    tape = case.engine(driver).record(case.program, memory=room, feedback=case.reflex)
    if (tape.result.status != "ok").any():
        return None
    return tape.pull_back(**cost.slopes(tape.result, tape.state))  # type: ignore[arg-type]


def as_arrays(gradient: LatticeGradient) -> dict[str, np.ndarray]:
    """Its parts by name."""
    found = {name: getattr(gradient, name) for name in gradient.__dataclass_fields__}
    return found | found.pop("materials")


def disagreements_of_drivers(case: Case, cost: Cost, gradient: LatticeGradient) -> list[str]:
    """Where gradients in little memory have other bits, or those of scalars differ by more than the order of sums."""
    wanted, found = as_arrays(gradient), []
    pieces, stepped = gradient_of(case, cost, "packed", 3e6), gradient_of(case, cost, "stepped")
    for way, other, least in (("in pieces", pieces, 0.0), ("stepped", stepped, 1e-9)):
        for name, values in as_arrays(other).items() if other is not None else ():
            scale = max(float(np.abs(values).max(initial=0.0)), 1e-300)
            apart = float(np.abs(values - wanted[name]).max(initial=0.0)) / scale
            if apart > least:
                found.append(f"gradient {way}: {name} by {apart:.1e}")
    return found


def directions_of(case: Case, gradient: LatticeGradient, rng: np.random.Generator) -> list[Direction]:
    """Random directions of every kind of variable of a case of one robot."""
    found = []
    for _ in range(DIRECTIONS):
        found += [_along_events(case, gradient, rng, field) for field in ("values", "rates")]
        found += [_along_start(case, gradient, rng, part) for part in PARTS]
        found.append(_along_materials(case, gradient, rng))
    return found


def _direction(
    kind: str, moved: Callable[[float], Case], slopes: np.ndarray, move: np.ndarray, sizes: Any
) -> Direction:
    usual = float(np.linalg.norm(slopes * sizes))
    return Direction(kind, moved, float((slopes * move).sum()), usual)


def _along_events(case: Case, gradient: LatticeGradient, rng: np.random.Generator, field: str) -> Direction:
    events = case.program.events
    size = scales(case.bodies[0])[events["quantity"]]
    size = size / 200 if field == "rates" else size
    if case.reflex is not None:  # those say nothing: they are decided
        size[np.concatenate([one.events for one in case.reflex.decisions])] = 0.0
    move = size * rng.normal(size=len(events))

    def moved(step: float) -> Case:
        other = events.copy()
        other[field[:-1]] += step * move
        return replace(case, program=LatticeProgram(case.program.lengths, other, case.program.snapshots))

    return _direction(f"event {field}", moved, getattr(gradient, field), move, size)


def _along_start(case: Case, gradient: LatticeGradient, rng: np.random.Generator, part: str) -> Direction:
    at = getattr(case.state, part)
    move = SIZES[part] * rng.normal(size=at.shape)
    if part == "orientations":  # along the sphere, where lengths change with the square only
        move -= (move * at).sum(axis=2, keepdims=True) * at

    def moved(step: float) -> Case:
        return replace(case, state=replace(case.state, **{part: at + step * move}))

    return _direction(f"start {part}", moved, getattr(gradient, part), move, SIZES[part])


def _along_materials(case: Case, gradient: LatticeGradient, rng: np.random.Generator) -> Direction:
    materials = case.bodies[0].materials
    sizes = {name: 0.1 * np.array([getattr(m, name) for m in materials]) for name in NUMBERS}
    moves = {name: size * rng.normal(size=size.shape) for name, size in sizes.items()}

    def moved(step: float) -> Case:
        changed = [
            replace(m, **{name: getattr(m, name) + step * float(moves[name][i]) for name in NUMBERS})
            for i, m in enumerate(materials)
        ]
        return replace(case, bodies=(replace(case.bodies[0], materials=tuple(changed)),))

    stack = lambda values: np.array([values[name] for name in NUMBERS])  # noqa: E731
    return _direction(
        "materials", moved, stack({n: gradient.materials[n][0] for n in NUMBERS}), stack(moves), stack(sizes)
    )


def together(cases: Sequence[Case]) -> Case:
    """One case of robots that were cases of their own, of like length and decisions."""
    first = cases[0]
    events = np.concatenate([each.program.events for each in cases])
    count = len(first.program.events)
    events["robot"] = np.repeat(np.arange(len(cases)), count)
    lengths = np.concatenate([each.program.lengths for each in cases])
    program = LatticeProgram(lengths, events, np.concatenate([each.program.snapshots for each in cases]))
    state = LatticeState(*(np.concatenate([getattr(each.state, part) for each in cases]) for part in PARTS))
    reflex = first.reflex
    if reflex is not None:
        rows = np.arange(len(cases))
        decisions = tuple(replace(one, events=(one.events + count * rows[:, None]).ravel()) for one in reflex.decisions)
        robots = tuple(np.repeat(rows, len(each)) for each in reflex.robots)
        bases = tuple(np.tile(each, (1, len(cases))) for each in reflex.bases)
        weights = tuple(np.tile(each, (len(cases), 1, 1)) for each in reflex.weights)
        reflex = Reflex(decisions, robots, bases, weights, reflex.start, reflex.links)
    bodies = tuple(each.bodies[0] for each in cases)
    return replace(first, bodies=bodies, floors=first.floors * len(cases), state=state, program=program, reflex=reflex)


def costs(cases: Sequence[Case], cost: Cost) -> np.ndarray:
    """The costs of cases of one robot each, all run together."""
    case = together(cases)
    engine = case.engine("packed")
    return cost.of(engine, engine.run(case.program, feedback=case.reflex))


def check_gradients(case: Case) -> list[dict] | None:
    """Every direction of a case's first robot: its kind, errors by step, what explains them; None if it diverged."""
    case = case.of([0])
    cost = Cost(case)
    gradient = gradient_of(case, cost, "packed")
    if gradient is None:
        return None
    directions = directions_of(case, gradient, np.random.default_rng((case.number, 2)))
    steps = int(case.program.lengths[0])
    found = judge(directions, lambda cases: costs(cases, cost), lambda one, step: events_between(one, step, steps))
    drivers = disagreements_of_drivers(case, cost, gradient)
    return [*found, {"kind": "drivers", "differs": drivers}]


# what happened


def events_between(direction: Direction, step: float, steps: int) -> set[str]:
    """What happens in a run moved by a step to one side and not, or not then, in that to the other side."""
    case = together([direction.moved(step), direction.moved(-step)])
    engine = case.engine("stepped")
    run = engine.begin(case.program)
    course, found, before = engine.course(run, case.program, case.reflex), set(), None
    for at in range(1, steps + 1):
        course.advance(at)
        now = signature(engine, case, engine._driver.read(memory.VOXEL))
        if before is None:  # sizes are known from the first step on
            start = engine._driver.read(memory.VOXEL)
            start[..., :3] = case.state.positions[:, engine.order]
            found |= {n for n, each in signature(engine, case, start).items() if not np.array_equal(each[0], each[1])}
        found |= {name for name, each in now.items() if not np.array_equal(each[0], each[1])}
        if before is not None and not np.array_equal(*(now["depth"] > before["depth"])):
            found.add("print")
        before = now
        found.discard("depth")
    return found


def signature(engine: LatticeEngine, case: Case, voxel: np.ndarray) -> dict[str, np.ndarray]:
    """All that laws branch on, robots first, for voxels in the engine's order."""
    driver, tables = engine._driver, engine.tables
    link = driver.read(memory.LINK)
    size = driver.read(memory.CURRENT)[:, tables.group, memory.MEAN_SIZE]
    x, y, z = np.moveaxis(voxel[..., :3], -1, 0)
    shell = tables.surface_voxels
    apart = np.linalg.norm(voxel[:, shell, None, :3] - voxel[:, None, shell, :3], axis=-1)
    found = {
        "stick or slip": voxel[..., memory.STICKS],
        "angle of a link": link[..., memory.REGIME],
        "self-contact": apart < contact.reach(size[:, shell, None], size[:, None, shell]),
        "depth": driver.read(memory.PRINT) if tables.medium.granular else np.zeros((2, 1, 1)),
    }
    floor = case.floors[0]
    if not isinstance(floor, Relief):
        return found | ({"floor": 0.5 * size - 0.5 * EDGE - z >= 0} if floor else {})
    height, upright = floor.below(x, y)
    cells = floor.cells_under(x, y)
    inside = np.stack([(x - cells[0]) > (y - cells[1]), *(cells[:2] / floor.spacing)])
    found["cell of the ground"] = np.moveaxis(np.rint(4 * inside), 0, -1)
    found["floor"] = 0.5 * size - (z + 0.5 * EDGE - height) * upright >= 0
    if floor.water is not None:
        share = (floor.water.level - 0.5 * EDGE - z) / size + 0.5
        found["surface of the water"] = np.sign(share) + np.sign(share - 1)
    return found
