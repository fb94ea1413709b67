"""Exact gradients of random articulated robots against central differences, and what happened where they disagree."""

from collections.abc import Sequence
from dataclasses import astuple, fields, replace
from typing import Any

import numpy as np
from physics_directions import Direction, judge
from rigid_bodies import scaled
from rigid_cases import RigidCase, make_case

from taichi_sim.ground.relief import Relief
from taichi_sim.rigid import Passive, Servo, Tree, slots
from taichi_sim.rigid.feedback import roll
from taichi_sim.rigid.gradient import RigidGradient
from taichi_sim.rigid.model.tree import Hinge
from taichi_sim.rigid.run import _of_tree, bodies_of
from taichi_sim.rigid.state import RigidResult, State

DIRECTIONS = 2  # of each kind of variable
SIZES = {"position": 0.1, "orientation": 0.1, "angles": 0.1, "velocity": 0.5, "rates": 0.5}
PARTS = tuple(SIZES)


def make_smooth_case(number: int) -> RigidCase:
    """The first robot of a case, without a cone of friction, which has no derivatives."""
    case = make_case(number).of([0])
    world = replace(case.options["world"], friction=np.inf)
    grounds = case.grounds and tuple(replace(relief, friction=None) for relief in case.grounds)
    features = tuple(word for word in case.features if word not in ("Coulomb friction", "several robots"))
    return replace(case, features=features, options={**case.options, "world": world}, grounds=grounds)


class Cost:
    """A random smooth function of where a robot ends, how it is turned and bent, what it sees, and its work."""

    def __init__(self, case: RigidCase) -> None:
        """Draw it."""
        rng, tree, senses = np.random.default_rng((case.number, 1)), case.trees[0], case.options["senses"]
        sizes = {"position": 3, "orientation": 4, "angles": len(tree.hinges), "readings": senses.count}
        self.weights = {name: rng.normal(size=size) for name, size in sizes.items()}
        self.weights["readings"][: len(senses.touch)] = 0.0  # which have no derivatives
        self.of_work = rng.normal() if case.options["world"].integration == "momentum" else 0.0  # else none is counted

    def of(self, result: RigidResult) -> np.ndarray:
        """Its value for every robot; NaN for those that diverged."""
        values = [np.sin(getattr(result, name) * weight).sum(axis=1) for name, weight in self.weights.items()]
        found: np.ndarray = np.sum(values, axis=0)
        return found + self.of_work * np.log1p(result.work) if self.of_work else found

    def slopes(self, result: RigidResult) -> dict[str, np.ndarray]:
        """What a tape pulls back."""
        found = {name: weight * np.cos(getattr(result, name) * weight) for name, weight in self.weights.items()}
        return {**found, **({"work": self.of_work / (1 + result.work)} if self.of_work else {})}


def gradient_of(case: RigidCase, cost: Cost, width: int | None = None) -> tuple[RigidResult, RigidGradient]:
    """A run of a case, and the gradient of its cost."""
    tape = case.engine(width).record(case.steps, **case.run_options())
    return tape.result, tape.pull_back(**cost.slopes(tape.result))


def check_gradients(case: RigidCase) -> list[dict] | None:
    """Every direction of a case's robot: its kind, errors by step, what explains them; None if it diverged."""
    cost = Cost(case)
    result, gradient = gradient_of(case, cost)
    if (result.status != "ok").any():
        return None
    rng = np.random.default_rng((case.number, 2))
    directions = [one for _ in range(DIRECTIONS) for one in directions_of(case, gradient, rng)]
    found = judge(directions, lambda cases: costs(cases, cost), events_between)
    return [*found, {"kind": "drivers", "differs": disagreements(case, cost, gradient)}]


def disagreements(case: RigidCase, cost: Cost, gradient: RigidGradient) -> list[str]:
    """Where gradients have other bits beside a copy of the robot, or in single lanes."""
    wanted, found = _as_arrays(gradient), []
    ways = {"beside copies": gradient_of(case.of([0, 0, 0]), cost), "of one lane": gradient_of(case, cost, width=1)}
    for way, (_, other) in ways.items():
        given = _as_arrays(other)
        differs = [name for name, each in wanted.items() if not np.array_equal(each[0], given[name][-1])]
        found += [f"gradient {way}: {name}" for name in differs]
    return found


def _as_arrays(gradient: RigidGradient) -> dict[str, np.ndarray]:
    every = {each.name: getattr(gradient, each.name) for each in fields(RigidGradient)}
    return {name: values for name, values in every.items() if isinstance(values, np.ndarray)}


# directions


def directions_of(case: RigidCase, gradient: RigidGradient, rng: np.random.Generator) -> list[Direction]:
    """A random direction of every kind of variable."""
    found = [_along_given(case, gradient, rng, name) for name in case.given if case.given[name].size]
    if case.state is None:
        return [*found, _along_design(case, gradient, rng)]
    return found + [_along_start(case, gradient, rng, name) for name in PARTS if getattr(case.state, name).size]


def _along_given(case: RigidCase, gradient: RigidGradient, rng: np.random.Generator, name: str) -> Direction:
    at, slopes = case.given[name], getattr(gradient, name)
    move = rng.normal(size=at.shape)

    def moved(step: float) -> RigidCase:
        return replace(case, given={**case.given, name: at + step * move})

    return Direction(name, moved, float((slopes * move).sum()), float(np.linalg.norm(slopes)))


def _along_start(case: RigidCase, gradient: RigidGradient, rng: np.random.Generator, name: str) -> Direction:
    """Along a part of the start; what bodies carry, and where they are, follows from it."""
    start, tree = case.state, case.trees[0]
    assert start is not None
    by_momentum = case.options["world"].integration == "momentum"
    at = getattr(start, name)

    def slope(move: np.ndarray) -> float:
        ends = [replace(start, **{name: at + side * move}) for side in (1e-4, -1e-4)]
        (carried, places, _), (before, places_before, _) = (_of_tree(tree, end, by_momentum) for end in ends)
        told = float((getattr(gradient, name) * move).sum()) if name != "velocity" else 0.0
        by_carried = float((gradient.carried * (carried - before)).sum()) / 2e-4
        return told + by_carried + float((gradient.places * (places - places_before)).sum()) / 2e-4

    def along(move: np.ndarray) -> np.ndarray:
        return move - (move * at).sum(axis=1, keepdims=True) * at if name == "orientation" else move

    def moved(step: float) -> RigidCase:
        other = at + step * move
        if name == "orientation":
            other = other / np.linalg.norm(other, axis=1, keepdims=True)
        return replace(case, state=replace(start, **{name: other}))

    move = along(SIZES[name] * rng.normal(size=at.shape))
    unit = SIZES[name] * np.eye(at.shape[1])
    usual = float(np.linalg.norm([slope(along(one[None])) for one in unit]))
    return Direction(f"start {name}", moved, slope(move), usual)


def _along_design(case: RigidCase, gradient: RigidGradient, rng: np.random.Generator) -> Direction:
    """Along masses, inertias, places, axes, and the motors' numbers, all at once."""
    tree = case.trees[0]
    draws = [(rng.normal(), rng.normal(size=3), rng.normal(size=3), rng.normal(size=2)) for _ in tree.bodies]

    def tree_of(value: float) -> Tree:
        step, number = value - 1.0, {body.name: n for n, body in enumerate(tree.bodies)}
        place = lambda at, way: tuple((np.array(at) + 0.05 * step * way).tolist())  # noqa: E731

        def joint_of(joint: Any) -> Any:
            if not isinstance(joint, Hinge):
                return joint
            factor, _, way, factors = draws[number[joint.child]]
            torque, rate = (1.0 + 0.3 * step * factors).tolist()
            motor = joint.motor
            if motor is not None:
                factors = {"torque": torque, "by_command": rate, "by_angle": 1.0 + 0.3 * step * way[0]}
                if isinstance(motor, Servo):
                    factors["by_rate"] = 1.0 + 0.3 * step * way[1]
                motor = replace(motor, **scaled(motor, **factors))
            passive = Passive(
                *(np.array(astuple(joint.passive)) * (1.0 + 0.3 * step * np.append(way, [factor, -factor]))).tolist()
            )
            moved = {"anchor": place(joint.anchor, way), "axis": place(joint.axis, way)}
            return replace(joint, **moved, motor=motor, passive=passive)

        bodies = [
            replace(
                body,
                mass=body.mass * (1.0 + 0.3 * step * factor),
                inertia=np.array(body.inertia) * (1.0 + 0.3 * step * factor),
                position=place(body.position, way),
            )
            for body, (factor, way, *_) in zip(tree.bodies, draws, strict=True)
        ]
        return Tree(bodies, [joint_of(joint) for joint in tree.joints], tree.fixed)

    slope = float(gradient.by_design(tree_of, 1.0)[0])
    return Direction("design", lambda step: replace(case, trees=(tree_of(1.0 + step),)), slope, abs(slope))


# differences


def together(cases: Sequence[RigidCase]) -> RigidCase:
    """One case of robots that were cases of their own."""
    first = cases[0]
    join = lambda name: {  # noqa: E731
        key: np.concatenate([getattr(each, name)[key] for each in cases]) for key in getattr(first, name)
    }
    states = [each.state for each in cases]
    state = first.state and State(*(np.concatenate([getattr(each, part) for each in states]) for part in PARTS))
    trees = tuple(each.trees[0] for each in cases)
    grounds = first.grounds and first.grounds * len(cases)
    return replace(first, trees=trees, grounds=grounds, state=state, given=join("given"), maps=join("maps"))


def costs(cases: Sequence[RigidCase], cost: Cost) -> np.ndarray:
    """The costs of cases of one robot each, all run together."""
    case = together(cases)
    return cost.of(case.engine().run(case.steps, **case.run_options()))


# what happened


def events_between(direction: Direction, step: float) -> set[str]:
    """What happens in a run moved by a step to one side and not, or not then, in that to the other side."""
    case, found = together([direction.moved(step), direction.moved(-step)]), set()
    for steps in range(case.steps + 1):
        now = signature(case, steps)
        found |= {name for name, each in now.items() if not np.array_equal(each[0], each[1])}
    return found


def signature(case: RigidCase, steps: int) -> dict[str, np.ndarray]:
    """All that laws branch on in the last of some steps, robots first."""
    engine = case.engine()
    given = (case.given.get(name) for name in ("weights", "commands"))
    run = engine._start(steps, *given, case.hold, case.given["lights"], case.state)
    memory = np.concatenate([each.part.state() for each in roll(run, case.run_options()["feedback"])], -1)
    plan, tree = run.plan, case.trees[0]
    bodies = np.moveaxis(bodies_of(memory, plan), -1, 0)
    count, width = int(plan[slots.POINTS]), slots.HINGES + int(plan[slots.DEPTH])
    points = memory[plan[slots.POINT] :][: count * width].T.reshape(len(case.trees), count, width)
    found = {
        "contact": points[..., slots.DEEP] >= 0,
        "push": points[..., slots.IMPULSES : slots.IMPULSES + 2] > 0,
        "torque or stop": bodies[:, tree.hinged, slots.MODES : slots.MODES + 2],
        "friction of a hinge": bodies[:, tree.hinged, slots.WAYS : slots.WAYS + 2],
        "unsolved": memory[slots.RESIDUAL] > 1e-9,
    }
    found |= hinge_signature(run, bodies, memory)
    if case.grounds is None:
        return found
    relief, position = case.grounds[0], memory[slots.POSITION : slots.POSITION + 3].T
    radii = np.array([radius for _, _, radius in tree.points()])
    at, normal = (points[..., slot : slot + 2] for slot in (slots.AT, slots.NORMAL))
    x, y = np.moveaxis(position[:, None, :2] + at + radii[:, None] * normal, -1, 0)
    cells = relief.cells_under(x, y)
    inside = np.stack([(x - cells[0]) > (y - cells[1]), *(cells[:2] / relief.spacing)])
    found["cell of the ground"] = np.moveaxis(np.rint(4 * inside), 0, -1)
    if engine._granular:
        sandy = memory[plan[slots.SANDY_POINT] :][: count * slots.SANDY_POINT_WIDTH]
        found["yielding sand"] = sandy.T.reshape(len(case.trees), count, -1)[..., slots.SATURATED]
    if engine._wet:
        found |= water_signature(relief, tree, bodies, position)
    return found


def hinge_signature(run: Any, bodies: np.ndarray, memory: np.ndarray) -> dict[str, np.ndarray]:
    """On which side of their stops hinges are, and whether motors would be faster than they can."""
    tree, plan = run.trees[0], run.plan
    given = run.numbers[slots.PARAMETER][:, tree.hinged]
    angle = bodies[:, tree.hinged, slots.ANGLE]
    columns = [hinge.command if hinge.motor is not None else -1 for hinge in tree.hinges]
    neurons = np.concatenate([memory[plan[slots.NEURON] :][: tree.motors].T, np.zeros((len(angle), 1))], axis=1)
    by_command, by_angle, offset, fastest = np.moveaxis(
        given[..., [slots.BY_COMMAND, slots.BY_ANGLE, slots.OFFSET, slots.FASTEST]], -1, 0
    )
    wanted = by_command * neurons[:, columns] + by_angle * angle + offset
    sides = (angle <= given[..., slots.LOWER]), (angle >= given[..., slots.UPPER])
    return {
        "fastest rate": (wanted > fastest).astype(int) - (wanted < -fastest),
        "at a stop": np.stack([*sides, (sides[0] | sides[1]) & (wanted > 0)], axis=-1),
    }


def water_signature(relief: Relief, tree: Tree, bodies: np.ndarray, position: np.ndarray) -> dict[str, np.ndarray]:
    """Which portions are wholly, partly or not in the water, and whether they go in or come out."""
    assert relief.water is not None
    sides, ways = [], []
    for n, portion in tree.portions():
        body = bodies[:, n]
        rotation = body[:, slots.ROTATION : slots.ROTATION + 9].reshape(-1, 3, 3)
        up = rotation[:, 2]
        arm = rotation @ np.asarray(portion.centre)
        height = position[:, 2] + body[:, slots.PLACE + 2] + body[:, slots.DRIFT + 2] + arm[:, 2]
        reach = np.sqrt(np.einsum("bi,ij,bj->b", up, portion.spread, up))
        sides.append(np.clip(np.trunc((relief.water.level - height) / reach), -1, 1))
        spin, velocity = body[:, slots.MOVING : slots.MOVING + 3], body[:, slots.MOVING + 3 : slots.MOVING + 6]
        ways.append((velocity[:, 2] + np.cross(spin, arm)[:, 2] > 0) & (sides[-1] == 0))
    return {"surface of the water": np.stack(sides, 1), "into or out of the water": np.stack(ways, 1)}
