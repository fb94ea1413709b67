"""Random soft robots and what happens to them: a case's number says everything, so any can be had again.

What a case has is drawn from all that the lattice engine knows; sizes of forces and moves are taken from the body's
own weight and stiffness, so that most robots live through their run. Every number of a program is a multiple of a
power of two, so that a program in two parts means the same bits as the whole.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from physics_bodies import EDGE, FLOATING, closeness, draw_body, draw_shape, varied

from taichi_sim.ground.relief import Water
from taichi_sim.lattice import (
    LatticeBody,
    LatticeEngine,
    LatticeProgram,
    LatticeState,
    ProgramBuilder,
    Quantity,
    Relief,
)
from taichi_sim.lattice.feedback import Decision, Felt
from taichi_sim.lattice.program import QUANTITY_COUNT

SEED = 20  # of all cases
SURROUNDINGS = ("nothing", "floor", "relief", "fluid", "water", "sand", "wet sand")
OFTEN = (0.1, 0.3, 0.2, 0.1, 0.1, 0.1, 0.1)


@dataclass(frozen=True, eq=False)
class Reflex:
    """Decides events of a program by linear functions of where the voxels are, each robot by its own.

    Attributes:
        decisions: as the engine wants them.
        robots: robot of each event, per decision.
        bases: value and rate of each event at the start positions, per decision, shape (2, E).
        weights: of the voxels' displacements, per decision, shape (E, V, 3).
        start: positions [m], shape (V, 3).
        links: of the body.
    """

    decisions: tuple[Decision, ...]
    robots: tuple[np.ndarray, ...]
    bases: tuple[np.ndarray, ...]
    weights: tuple[np.ndarray, ...]
    start: np.ndarray
    links: int

    def decide(self, number: int, felt: Felt) -> tuple[np.ndarray, np.ndarray]:
        """Value and rate of every event of a decision."""
        values, rates = self.bases[number]
        moved = [felt.positions[robot] - self.start for robot in self.robots[number]]
        pushed = [float((weight * move).sum()) for weight, move in zip(self.weights[number], moved, strict=True)]
        return values + np.array(pushed), rates

    def pull_back(self, number: int, values: np.ndarray, rates: np.ndarray) -> Felt:
        """Derivatives by what a decision felt."""
        count = 1 + int(self.robots[number].max())
        positions = np.zeros((count, *self.start.shape))
        np.add.at(positions, self.robots[number], values[:, None, None] * self.weights[number])
        return Felt(positions, np.zeros((count, len(self.start), 4)), np.zeros((count, self.links)))


@dataclass(frozen=True, eq=False)
class Case:
    """Robots of one topology, where they are, and what happens to them.

    Attributes:
        number: of the case.
        features: words for what it has.
        bodies: of the B robots.
        floors: of the robots: whether there is one, or the relief.
        options: of the engine.
        state: at the start.
        program: of the robots.
        reflex: decides some of its events, if there is one.
    """

    number: int
    features: tuple[str, ...]
    bodies: tuple[LatticeBody, ...]
    floors: tuple[bool | Relief, ...]
    options: dict[str, Any]
    state: LatticeState
    program: LatticeProgram
    reflex: Reflex | None

    def engine(self, driver: str) -> LatticeEngine:
        """An engine with the robots at their start."""
        floor = self.floors[0] if isinstance(self.floors[0], bool) else self.floors
        made = LatticeEngine(self.bodies, floor=floor, driver=driver, threads=1, **self.options)
        made.set_state(self.state)
        return made

    def of(self, robots: Sequence[int]) -> "Case":
        """The case of these of its robots, in this order; some may be there twice."""
        pick = lambda values: tuple(values[robot] for robot in robots)  # noqa: E731
        rows = list(robots)
        state = LatticeState(*(getattr(self.state, f)[rows] for f in self.state.__dataclass_fields__))
        program, source = events_of(self.program, rows)
        reflex = None if self.reflex is None else reflex_of(self.reflex, source, program)
        return replace(
            self, bodies=pick(self.bodies), floors=pick(self.floors), state=state, program=program, reflex=reflex
        )


def events_of(program: LatticeProgram, robots: Sequence[int]) -> tuple[LatticeProgram, np.ndarray]:
    """A program for these of its robots, and which event of it each one is."""
    parts, sources = [], []
    for place, robot in enumerate(robots):
        (mine,) = np.nonzero(program.events["robot"] == robot)
        events = program.events[mine]
        events["robot"] = place
        parts.append(events)
        sources.append(mine)
    rows = list(robots)
    return LatticeProgram(program.lengths[rows], np.concatenate(parts), program.snapshots[rows]), np.concatenate(
        sources
    )


def reflex_of(reflex: Reflex, source: np.ndarray, program: LatticeProgram) -> Reflex:
    """The reflex for a program whose events come from those of ``source``."""
    decisions, robots, bases, weights = [], [], [], []
    for one, base, weight in zip(reflex.decisions, reflex.bases, reflex.weights, strict=True):
        place = {int(event): i for i, event in enumerate(one.events)}
        events = np.array([i for i, event in enumerate(source) if int(event) in place], int)
        old = np.array([place[int(source[i])] for i in events], int)
        decisions.append(replace(one, events=events))
        robots.append(program.events["robot"][events].astype(int))
        bases.append(base[:, old])
        weights.append(weight[old])
    return Reflex(tuple(decisions), tuple(robots), tuple(bases), tuple(weights), reflex.start, reflex.links)


def make_case(number: int) -> Case:
    """The case of a number."""
    rng = np.random.default_rng((SEED, number))
    around = str(rng.choice(SURROUNDINGS, p=OFTEN))
    shape, voxels, chambers, cuts = draw_shape(rng, around)
    batch = int(rng.integers(1, 4))
    body, features = draw_body(rng, around, shape, voxels, chambers, cuts)
    bodies = (body, *(replace(body, materials=varied(rng, body.materials)) for _ in range(batch - 1)))
    contact = rng.random() < 0.85
    options: dict[str, Any] = {"self_contact": bool(contact), "fluid": around == "fluid"}
    options["gravity"] = float(rng.choice([0.0, 2.0, 9.80665]))
    options["time_step"] = float(min(b.recommended_time_step for b in bodies) * rng.uniform(0.2, 0.7))
    floors = draw_floors(rng, around, batch)
    unstable = rng.random() < 0.03
    options["time_step"] *= 12.0 if unstable else 1.0
    state, wild = draw_state(rng, body, floors, batch)
    near = shape in ("islands", "folded sheet") and rng.random() < 0.7
    if near:
        state.positions[:, :, 2] -= EDGE * rng.uniform(0.7, 0.9) * closeness(body)
    program, reflex = draw_program(rng, bodies, around, batch)
    features = [around, shape, *features]
    features += ["self-contact"] * contact + ["thrown"] * wild + ["feedback"] * (reflex is not None)
    features += ["parts that touch"] * near + ["unstable step"] * bool(unstable)
    features += ["several robots"] * (batch > 1)
    return Case(number, tuple(features), bodies, floors, options, state, program, reflex)


# surroundings and start


def draw_floors(rng: np.random.Generator, around: str, batch: int) -> tuple[bool | Relief, ...]:
    """The floor of every robot; in a fluid it may be missing."""
    if around in ("nothing", "floor", "fluid"):
        return (around == "floor" or (around == "fluid" and bool(rng.random() < 0.5)),) * batch
    nodes, spacing = int(rng.integers(2, 30)), float(rng.choice([0.004, 0.01, 0.03]))
    options: dict[str, Any] = {}
    if around in ("water", "wet sand"):
        added = float(rng.choice([0.0, 0.5]))
        options["water"] = Water(float(rng.uniform(-0.01, 0.04)), float(rng.uniform(500, 1500)), 9.80665, added)
    if around in ("sand", "wet sand"):
        options["yield_per_depth"] = float(10 ** rng.uniform(4, 7))
    found = []
    for _ in range(batch):
        slope = rng.uniform(-0.3, 0.3, 2) * (rng.random() < 0.4)
        grid = np.arange(nodes) * spacing
        heights = (
            slope[0] * grid[:, None] + slope[1] * grid + rng.uniform(0, 0.2) * spacing * rng.random((nodes, nodes))
        )
        friction = rng.uniform(0.5, 1.5, heights.shape) if rng.random() < 0.5 else None
        origin = tuple((-0.5 * nodes * spacing + rng.uniform(-0.01, 0.03, 2)).tolist())
        found.append(Relief(heights - heights.mean(), spacing, origin, friction, **options))
    return tuple(found)


def draw_state(
    rng: np.random.Generator, body: LatticeBody, floors: Sequence[bool | Relief], batch: int
) -> tuple[LatticeState, bool]:
    """Near the start positions, on or a little above the ground; and whether robots are thrown."""
    wild, count = bool(rng.random() < 0.5), body.voxel_count
    positions = body.start_positions + rng.normal(0, 1e-4, (batch, count, 3))
    for robot, floor in enumerate(floors):
        if isinstance(floor, Relief):
            positions[robot, :, 2] += floor.rise(positions[robot], EDGE)
    # Never just touching: there, derivatives have two sides.
    positions[:, :, 2] += rng.choice([-2e-4, 1e-4, 1e-3], p=[0.5, 0.3, 0.2]) * rng.uniform(0.5, 1.5, (batch, 1))
    velocities = rng.normal(0, 0.02, (batch, count, 3)) + wild * rng.normal(0, 0.4, (batch, 1, 3))
    turns = np.concatenate([np.ones((batch, count, 1)), rng.normal(0, 0.02, (batch, count, 3))], axis=2)
    orientations = turns / np.linalg.norm(turns, axis=2, keepdims=True)
    return LatticeState(positions, orientations, velocities, rng.normal(0, 1.0, velocities.shape)), wild


# programs


def scales(body: LatticeBody) -> np.ndarray:
    """How large a change of each of the 25 quantities a body of these materials bears."""
    modulus = min(m.youngs_modulus for m in body.materials)
    mass = min(m.density for m in body.materials) * EDGE**3
    found = np.zeros(QUANTITY_COUNT)
    found[Quantity.SCALE : Quantity.SCALE + 3] = 0.04
    found[Quantity.TEMPERATURE] = 5.0
    found[[Quantity.STATIC_FRICTION, Quantity.KINETIC_FRICTION]] = 0.4
    found[Quantity.GLOBAL_DAMPING] = 0.01
    found[Quantity.PRESSURE] = 0.01 * modulus
    found[Quantity.ACCELERATION : Quantity.ACCELERATION + 3] = 10.0
    found[Quantity.FORCE : Quantity.FORCE + 3] = min(10.0 * mass, 0.01 * modulus * EDGE**2)
    found[Quantity.MOMENT : Quantity.MOMENT + 3] = min(2.0 * mass * EDGE, 1e-3 * modulus * EDGE**3)
    found[Quantity.TRANSLATION : Quantity.TRANSLATION + 3] = 0.05 * EDGE
    found[Quantity.ROTATION : Quantity.ROTATION + 3] = 0.03
    found[Quantity.RESISTANCE : Quantity.RESISTANCE + 2] = 300.0
    return found


MIDDLES = {Quantity.SCALE + axis: 1.0 for axis in range(3)} | {
    Quantity.STATIC_FRICTION: 0.6,
    Quantity.KINETIC_FRICTION: 0.5,
    Quantity.GLOBAL_DAMPING: 0.015,
    Quantity.RESISTANCE: 500.0,
    Quantity.RESISTANCE + 1: 400.0,
}


def on_grid(values: np.ndarray, size: float) -> np.ndarray:
    """Values as multiples of a power of two that is small beside a size."""
    step = 2.0 ** (np.floor(np.log2(size)) - 30)
    return np.round(values / step) * step


def draw_program(
    rng: np.random.Generator, bodies: Sequence[LatticeBody], around: str, batch: int
) -> tuple[LatticeProgram, Reflex | None]:
    """Events of any quantity at any time, lengths of each robot, and perhaps decisions."""
    body, size = bodies[0], scales(bodies[0])
    decides = rng.random() < 0.15
    lengths = rng.integers(60, 240, batch)
    if decides:
        lengths[:] = lengths[0]
    quantities = np.arange(QUANTITY_COUNT if around in FLOATING else Quantity.RESISTANCE)
    builder = ProgramBuilder(batch)
    for _ in range(int(rng.integers(3, 16))):
        quantity = int(rng.choice(quantities))
        regions = np.flatnonzero(rng.random(body.region_count) < 0.6)
        if not len(regions):
            continue
        wide = (batch, len(regions))
        middle = MIDDLES.get(quantity, 0.0)
        values = on_grid(middle + size[quantity] * rng.uniform(-1, 1, wide), size[quantity])
        rates = on_grid(
            size[quantity] / 240 * rng.uniform(-1, 1, wide) * (rng.random(wide) < 0.6), size[quantity] / 240
        )
        step = 0 if rng.random() < 0.3 else rng.integers(0, 200, wide)
        builder.set(quantity, values, regions=regions, step=step, rate=rates)
    marks = np.array([[length // 3, 2 * length // 3, length] for length in lengths])
    program = builder.build(lengths, marks)
    if not decides:
        return program, None
    return with_reflex(rng, body, size, program)


def with_reflex(
    rng: np.random.Generator, body: LatticeBody, size: np.ndarray, program: LatticeProgram
) -> tuple[LatticeProgram, Reflex]:
    """A program with two decisions, at its first two snapshots, on a quantity of a region each."""
    batch, decisions, parts, first = program.robot_count, [], [program.events], len(program.events)
    robots, bases, weights = [], [], []
    for slot in range(2):
        step = int(program.snapshots[0, slot])
        region = int(rng.choice(np.unique(np.asarray(body.regions))))
        quantity = int(rng.choice([Quantity.SCALE + 2, Quantity.FORCE, Quantity.ACCELERATION + 1]))
        events = np.zeros(batch, program.events.dtype)
        events["robot"], events["region"], events["quantity"] = np.arange(batch), region, quantity
        events["step"] = step + 1 + rng.integers(0, 5)
        decisions.append(Decision(step, slot, first + batch * slot + np.arange(batch)))
        parts.append(events)
        robots.append(np.arange(batch))
        bases.append(np.stack([np.full(batch, MIDDLES.get(quantity, 0.0)), np.zeros(batch)]))
        spread = 0.3 * size[quantity] / EDGE / np.sqrt(body.voxel_count)
        weights.append(spread * rng.normal(size=(batch, body.voxel_count, 3)))
    made = LatticeProgram(program.lengths, np.concatenate(parts), program.snapshots)
    parts_of = tuple(decisions), tuple(robots), tuple(bases), tuple(weights)
    return made, Reflex(*parts_of, body.start_positions, len(body.topology.links))
