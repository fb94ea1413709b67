"""Random articulated robots and what happens to them: a case's number says everything, so any can be had again.

What a case has is drawn from all that the rigid engine knows: ground, water and sand; both ways to integrate; both
kinds of friction; neurons, commands over time and commands that are decided from what robots feel.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from rigid_bodies import draw_tree, touchable, varied, with_dynamics

from taichi_sim.ground.relief import Relief, Water
from taichi_sim.rigid import Network, Physics, RigidEngine, Senses, Tree
from taichi_sim.rigid.feedback import Felt
from taichi_sim.rigid.state import State

SEED = 21  # of all cases
SURROUNDINGS = ("floor", "relief", "water", "sand", "wet sand")
OFTEN = (0.4, 0.2, 0.15, 0.15, 0.1)
FELT = tuple(each.name for each in fields(Felt))


@dataclass(frozen=True, eq=False)
class Decides:
    """Decides commands by a linear function of what robots feel, around those that were drawn.

    Attributes:
        commands: those, (B, K, M).
        maps: by the fields of what is felt, (B, K, numbers, M) each.
    """

    commands: np.ndarray
    maps: dict[str, np.ndarray]

    def decide(self, number: int, felt: Felt) -> np.ndarray:
        """The command number of each robot."""
        parts = [(getattr(felt, name)[..., None] * self.maps[name][:, number]).sum(axis=1) for name in FELT]
        return self.commands[:, number] + np.sum(parts, axis=0)

    def pull_back(self, number: int, commands: np.ndarray) -> Felt:
        """Derivatives by what was felt."""
        return Felt(*((self.maps[name][:, number] * commands[:, None]).sum(axis=2) for name in FELT))


@dataclass(frozen=True, eq=False)
class RigidCase:
    """Robots of one structure, where they are, and what happens to them.

    Attributes:
        number: of the case.
        features: words for what it has.
        trees: of the B robots.
        grounds: of the robots; None is the level floor.
        options: world, senses and network of the engine.
        state: at the start; None is as the trees describe it.
        steps: of the run.
        hold: steps that a command is kept.
        every: steps between recordings.
        given: weights or commands, and lights, of each robot.
        maps: how commands depend on what is felt, as in ``Decides``; none if they do not.
    """

    number: int
    features: tuple[str, ...]
    trees: tuple[Tree, ...]
    grounds: tuple[Relief, ...] | None
    options: dict[str, Any]
    state: State | None
    steps: int
    hold: int
    every: int
    given: dict[str, np.ndarray]
    maps: dict[str, np.ndarray]

    def engine(self, width: int | None = None) -> RigidEngine:
        """An engine for the robots."""
        return RigidEngine(self.trees, ground=self.grounds, width=width, threads=1, **self.options)

    def run_options(self) -> dict[str, Any]:
        """What a run is given, but for recordings."""
        feedback = Decides(self.given["commands"], self.maps) if self.maps else None
        return {**self.given, "hold": self.hold, "start": self.state, "feedback": feedback}

    def of(self, robots: Sequence[int]) -> "RigidCase":
        """The case of these of its robots, in this order; some may be there twice."""
        rows = list(robots)
        pick = lambda values: tuple(values[robot] for robot in rows)  # noqa: E731
        part = lambda arrays: {name: each[rows] for name, each in arrays.items()}  # noqa: E731
        state = self.state and State(*(getattr(self.state, each.name)[rows] for each in fields(State)))
        grounds = self.grounds and pick(self.grounds)
        return replace(
            self, trees=pick(self.trees), grounds=grounds, state=state, given=part(self.given), maps=part(self.maps)
        )


def make_case(number: int) -> RigidCase:
    """The case of a number."""
    rng = np.random.default_rng((SEED, number))
    around = str(rng.choice(SURROUNDINGS, p=OFTEN))
    tree, features = draw_tree(rng)
    tree, dynamics = with_dynamics(np.random.default_rng((SEED, number, 1)), tree)
    features = [*features, *dynamics]
    batch = int(rng.integers(1, 4))
    trees = (tree, *(varied(rng, tree) for _ in range(batch - 1)))
    world = draw_world(rng, around)
    grounds = draw_grounds(rng, around, batch, bool(np.isfinite(world.friction)))
    if not tree.portions():
        around, grounds = "floor", None  # water and sand find nothing
    touch = [name for name in touchable(tree) if rng.random() < 0.4]
    places = [int(rng.integers(len(tree.bodies))) for _ in range(int(rng.integers(0, 3)))]
    light = [(tree.bodies[n].name, tuple(rng.uniform(-0.1, 0.1, 3).tolist())) for n in places]
    senses = Senses(touch, light)
    network = Network(
        float(rng.uniform(0, 1)), float(rng.uniform(0.5, 2)), (-1.0, 1.0) if rng.random() < 0.5 else (0, 1)
    )
    steps, hold, every = (int(rng.integers(*ends)) for ends in ((10, 60), (2, 12), (1, 9)))
    given, maps = draw_control(rng, trees, senses, (-(-steps // hold), float(rng.uniform(0.3, 1.2))))
    given["lights"] = np.concatenate([rng.uniform(0.6, 2, (batch, 2)), rng.uniform(0, 1, (batch, 1))], axis=1)
    state = draw_state(rng, trees, grounds) if rng.random() < 0.65 else None
    features = [around, world.integration, *features]
    features += ["Coulomb friction"] * bool(np.isfinite(world.friction)) + ["tilted"] * any(world.gravity_across)
    features += ["touch"] * bool(touch) + ["light"] * bool(light) + ["feedback"] * bool(maps)
    features += ["neurons"] * ("weights" in given) + ["several robots"] * (batch > 1)
    features += ["thrown"] * (state is not None)
    options = {"world": world, "senses": senses, "network": network}
    return RigidCase(number, tuple(features), trees, grounds, options, state, steps, hold, every, given, maps)


def draw_world(rng: np.random.Generator, around: str) -> Physics:
    """Any world that its ground allows."""
    tilted = rng.random() < 0.3 and around not in ("water", "wet sand")
    return Physics(
        time_step=float(rng.choice([0.005, 0.01, 0.02, 0.05])),
        gravity=float(rng.choice([-9.81, -2.0, 0.0], p=[0.7, 0.2, 0.1])),
        slip=None if rng.random() < 0.5 else float(10 ** rng.uniform(-5, -1)),
        friction=float(rng.choice([np.inf, 0.0, 0.4, 1.2], p=[0.55, 0.1, 0.15, 0.2])),
        error_reduction=float(rng.choice([0.2, 0.8, 0.0])),
        integration=str(rng.choice(["momentum", "velocity"])),  # type: ignore[arg-type]
        gravity_across=tuple(rng.uniform(-2, 2, 2).tolist()) if tilted else (0.0, 0.0),
    )


def draw_grounds(rng: np.random.Generator, around: str, batch: int, rubs: bool) -> tuple[Relief, ...] | None:
    """The ground of every robot; factors of friction only where there is a coefficient."""
    if around == "floor":
        return None
    nodes, spacing = int(rng.integers(2, 20)), float(rng.choice([0.05, 0.2, 0.5]))
    options: dict[str, Any] = {}
    if around in ("water", "wet sand"):
        options["water"] = Water(float(rng.uniform(0, 0.5)), float(rng.uniform(300, 1500)))
    if around in ("sand", "wet sand"):
        options["yield_per_depth"] = float(10 ** rng.uniform(4.5, 7))
    found = []
    for _ in range(batch):
        grid = np.arange(nodes) * spacing
        slope = rng.uniform(-0.3, 0.3, 2) * (rng.random() < 0.4)
        heights = (
            slope[0] * grid[:, None] + slope[1] * grid + rng.uniform(0, 0.3) * spacing * rng.random((nodes, nodes))
        )
        friction = rng.uniform(0.5, 1.5, heights.shape) if rubs and rng.random() < 0.5 else None
        origin = tuple((-0.5 * nodes * spacing + rng.uniform(-0.1, 0.1, 2)).tolist())
        found.append(Relief(heights - heights.mean(), spacing, origin, friction, **options))
    return tuple(found)


def draw_control(
    rng: np.random.Generator, trees: Sequence[Tree], senses: Senses, over_time: tuple[int, float]
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Weights of neurons or commands over time (how many, how large), and maybe how they depend on what is felt."""
    batch, motors, (count, size) = len(trees), trees[0].motors, over_time
    if senses.count and rng.random() < 0.35:
        return {"weights": rng.uniform(-1, 1, (batch, senses.count, motors))}, {}
    commands = size * rng.uniform(-1, 1, (batch, count, motors))
    if not motors or rng.random() < 0.7:
        return {"commands": commands}, {}
    sizes = {"position": 3, "orientation": 4, "angles": len(trees[0].hinges), "readings": senses.count}
    maps = {name: 0.2 * rng.normal(size=(batch, count, sizes[name], motors)) for name in FELT}
    return {"commands": commands}, maps


def draw_state(rng: np.random.Generator, trees: Sequence[Tree], grounds: tuple[Relief, ...] | None) -> State:
    """Anywhere near the ground, turned, bent and moving."""
    batch, hinges = len(trees), trees[0].hinges
    ends = np.array([hinge.stops or (-1.0, 1.0) for hinge in hinges]).reshape(-1, 2)
    bent = 0.9 * rng.uniform(ends[:, 0], ends[:, 1], (batch, len(hinges))) * (rng.random() < 0.7)
    turned = np.concatenate([np.ones((batch, 1)), rng.normal(0, 0.2, (batch, 3))], axis=1)
    still = float(rng.random() < 0.7)
    start = RigidEngine(trees, Physics(friction=1.0), ground=grounds).standing()
    lifted = rng.choice([-0.01, 0.002, 0.1], p=[0.4, 0.4, 0.2]) * rng.uniform(0.5, 1.5, batch)
    floating = 0.0 if trees[0].fixed else 1.0
    position = start.position + floating * np.stack([*rng.uniform(-0.1, 0.1, (2, batch)), lifted], axis=1)
    velocity = floating * still * rng.normal(0, 0.5, (batch, 6))
    orientation = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    return State(position, orientation, bent, velocity, still * rng.normal(0, 0.5, bent.shape))
