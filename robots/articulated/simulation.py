"""Articulated robots at work: how far they come, and the derivatives of that by what is free."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robots.articulated.centres import centres as centres
from robots.articulated.centres import first_centre as first_centre
from robots.articulated.measures import OF_TREES, of_trees
from robots.articulated.reflexes import PARTS, ReflexLoop, Rhythms
from robots.articulated.rigid_motion import ENDED, POSE, own_measure_values, slopes_of
from robots.articulated.senses import Anatomy
from robots.articulated.worlds import GROUND, check_gradients, length_of, physics_in, relief_under
from robots.robot import Progress, Trial, World
from robots.world import Terrain
from taichi_sim.base.arrays import Floats, Ints, along
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.base.short_text import ShortText
from taichi_sim.rigid import RigidEngine, RigidResult, State, Tree, poses
from taichi_sim.rigid.pose import rotation_matrix

if TYPE_CHECKING:
    from robots.articulated.robot import ArticulatedRobot
    from taichi_sim.ground import Relief

TAPE_BYTES = 2**29  # of the states of robots that are differentiated at once
ROBOTS_AT_ONCE = 1024  # between two calls of progress


@dataclass(frozen=True, eq=False, repr=False)
class ArticulatedResult(ShortText):
    """Result of simulating N designs of an articulated robot.

    Attributes:
        distance: way of the centre of mass along the heading, (N,) [m]; NaN of those that diverged.
        centre: place of the centre of mass at the end, (N, 3) [m].
        status: ``"ok"`` or ``"diverged"``, (N,).
        steps: time steps simulated, (N,).
        runs: everything about the rollouts, with frames if asked for; several where N is large.
        energy: work of all drives, as far as they push the way that they turn, (N,) [J]; NaN of those that diverged.
        own: users' own measures by name, (N,) each; NaN of those that diverged.
        gradients: derivatives of the distance and other measures by the parameters, (N, P), where asked for.
        trees: of the robots, N where sizes of bodies are free, else one for all.
    """

    distance: Floats
    centre: Floats
    energy: Floats
    status: NDArray[np.str_]
    steps: Ints
    runs: tuple[RigidResult, ...]
    own: Mapping[str, Floats] = field(default_factory=dict)
    gradients: Mapping[str, Floats] = field(default_factory=dict)
    trees: tuple[Tree, ...] = ()

    @property
    def gradient(self) -> Floats | None:
        """Derivatives of the distance by the parameters [m per unit], (N, P); None if not asked for."""
        return self.gradients.get("distance")


def simulate(
    robot: "ArticulatedRobot",
    points: ArrayLike,
    *,
    terrain: World = GROUND,
    record_every: int | None = None,
    progress: Progress | None = None,
    **compute: Unpack[ComputeOptions],
) -> ArticulatedResult:
    """Simulate an articulated robot at N points.

    Args:
        robot: the robot.
        points: values of its parameters, (N, P).
        terrain: level, or with a slope, uneven ground, sand, or water.
        record_every: time steps between frames; None for none.
        progress: called with the fraction done.
        **compute: device, precision and threads, as of :class:`Compute`.

    Raises:
        ValueError: for what is not allowed.
    """
    return try_points(robot, points, Trial(terrain, Compute.given(compute), record_every, progress))


def differentiate(
    robot: "ArticulatedRobot",
    points: ArrayLike,
    *,
    terrain: World = GROUND,
    progress: Progress | None = None,
    **compute: Unpack[ComputeOptions],
) -> ArticulatedResult:
    """Simulate an articulated robot at N points, with derivatives of the distance by its parameters.

    Contacts, stops and limits act as they did, see ``taichi_sim.rigid.gradient``.

    Raises:
        ValueError: for what is not allowed, Coulomb friction included: it has no derivatives here.
    """
    trial = Trial(terrain, Compute.given(compute), None, progress, gradients=("distance",))
    return try_points(robot, points, trial)


def unsettled(found: ArticulatedResult) -> tuple[str, ...]:
    """A line about robots of a result in which a step left contacts or drives unsolved; none if all were solved."""
    left = np.concatenate([run.residual for run in found.runs])
    if not (count := np.count_nonzero(left)):
        return ()
    robots = f"{count} of {len(left)} robots" if len(left) > 1 else "the robot"
    return (
        f"contacts, stops or drives did not settle in some step of {robots}; compare with double precision, or with a "
        "smaller time_step",
    )


def try_points(robot: "ArticulatedRobot", points: ArrayLike, trial: Trial) -> ArticulatedResult:
    """What a robot does at N points, shape (N, P), in a trial."""
    points, tree = robot.points(points), robot.tree
    if trial.gradients:
        check_gradients(robot, trial.world)
    state = 7 + 12 * len(tree.bodies) + tree.motors + 2 * len(tree.points())  # numbers that a tape keeps of a step
    at_once = max(1, TAPE_BYTES // (8 * state * (robot.steps + 1))) if trial.gradients else ROBOTS_AT_ONCE
    wanted = dict.fromkeys("distance" if name == "speed" else name for name in trial.gradients)
    runs, trees, slopes = [], list[Tree](), {name: list[Floats]() for name in wanted}
    done = 0
    for some in _groups(robot, points, trial.world, trial.compute, at_once):
        loop = _loop(robot, some.controls, some.begin)
        driven = {**_driven(robot, some.controls), "start": some.start, "feedback": loop}
        trees += some.trees
        if trial.gradients:
            tape = some.engine.record(robot.steps, **driven)
            runs.append(tape.result)
            for name, found in slopes.items():
                judge = partial(_measure_values, robot, name, run=tape.result)
                if _is_of_trees(robot, name):
                    found.append(_slopes_of_trees(robot, some, tape.result, judge))
                    continue
                back = tape.pull_back(**_end_slopes(robot, name, tape.result, some.trees))
                of_commands = back.commands
                given = (
                    back.weights if robot.controller == "network" else _slopes(robot, some.controls, of_commands, loop)
                )
                put = None if loop is None else loop.reader.by_first
                by_factors = robot.variants.slopes(some.factors, judge, back, put, some.relief)
                found.append(np.column_stack([given.reshape(len(some.controls), -1), by_factors]))
        else:
            runs.append(some.engine.run(robot.steps, **driven, record_every=trial.record_every))
        done += len(some.controls)
        if trial.progress:
            trial.progress(done / len(points))
    return _result(robot, runs, trees, {name: np.concatenate(found) for name, found in slopes.items()})


@dataclass(frozen=True, eq=False)
class _Group:
    """Robots that run together.

    Attributes:
        controls: values of the parameters but for free factors, (B, P - K).
        factors: free ones of bodies and hinges, (B, K).
        trees: of the robots, one for all where no factor is free.
        engine: that moves them.
        start: their state at the start; None as their trees have it.
        relief: uneven ground that they then stand on, if factors are free.
    """

    controls: Floats
    factors: Floats
    trees: list[Tree]
    engine: RigidEngine
    start: State | None
    relief: "Relief | None"

    @property
    def begin(self) -> State:
        """Their state at the start."""
        return self.engine.rest() if self.start is None else self.start


def _groups(
    robot: "ArticulatedRobot", points: Floats, world: World, compute: Compute, at_once: int
) -> Iterator[_Group]:
    """The robots of points, (N, P), a number of them at once."""
    controls, factors = robot.split(points)
    engine: tuple[RigidEngine, State | None] | None = None
    for first in range(0, len(points), at_once):
        part = slice(first, first + at_once)
        trees = [robot.variants.tree_of(each) for each in factors[part]] if robot.variants.free else [robot.tree]
        if engine is None or robot.variants.free:
            engine = engine_in(robot, world, compute, trees)
        started = robot.variants.free and engine[1] is not None  # whose starts on it follow their sizes
        relief = relief_under(robot, world) if started else None
        yield _Group(controls[part], factors[part], trees, *engine, relief)


def _each_tree(trees: Sequence[Tree], run: RigidResult) -> list[tuple[Tree, RigidResult]]:
    """Each tree with the end of the robots that have it."""
    if len(trees) == 1:
        return [(trees[0], run)]
    names = (*ENDED, "status")
    rows = ({name: getattr(run, name)[n : n + 1] for name in names} for n in range(len(trees)))
    return [(tree, replace(run, **row)) for tree, row in zip(trees, rows, strict=True)]


def _measure_values(robot: "ArticulatedRobot", name: str, trees: Sequence[Tree], run: RigidResult) -> Floats:
    """The distance, the energy, what trees say, or a user's own measure, of what robots came to, (B,)."""
    own = next((each for each in robot.own_measures if each.name == name), None)
    if own is not None:
        return np.concatenate([own_measure_values(robot, own, end, tree) for tree, end in _each_tree(trees, run)])
    if name == "energy":
        return run.work  # whatever the trees mean at the end
    if name in OF_TREES:
        return of_trees(name, trees, len(run.status))
    ways = [_centre(tree, end) - first_centre(tree) for tree, end in _each_tree(trees, run)]
    return along(np.concatenate(ways), robot.direction)


def _is_of_trees(robot: "ArticulatedRobot", name: str) -> bool:
    return name in OF_TREES and all(own.name != name for own in robot.own_measures)


def _slopes_of_trees(
    robot: "ArticulatedRobot", some: _Group, run: RigidResult, judge: Callable[[Sequence[Tree]], Floats]
) -> Floats:
    """Derivatives of a measure of how robots are made, (B, P); NaN of those that diverged."""
    by_factors = robot.variants.slopes(some.factors, judge)
    found = np.column_stack([np.zeros(some.controls.shape), by_factors])
    found[run.status != "ok"] = np.nan
    return found


def _centre(tree: Tree, run: RigidResult) -> Floats:
    return centres(tree, run.position, run.orientation, run.angles)


def _end_slopes(robot: "ArticulatedRobot", name: str, result: RigidResult, trees: Sequence[Tree]) -> dict[str, Floats]:
    """Derivatives of a measure by places, orientations and angles at the end, and by the work of drives."""
    found = []
    own = next((each for each in robot.own_measures if each.name == name), None)
    if own is None and name == "energy":
        return {"work": np.ones(len(result.work))}
    for tree, end in _each_tree(trees, result):
        if own is not None:
            found.append(slopes_of(robot, own, end, tree))
        else:
            found.append(dict(zip(POSE, centre_slopes(tree, end, robot.direction), strict=True)))
    return {each: np.concatenate([one[each] for one in found]) for each in found[0]}


def felt_over_time(robot: "ArticulatedRobot", points: Floats, world: World, compute: Compute) -> Floats:
    """What robots with reflexes feel at N points, (N, P), at every decision, (N, S, T); NaN of those that diverge."""
    found = []
    for some in _groups(robot, points, world, compute, ROBOTS_AT_ONCE):
        loop = _loop(robot, some.controls, some.begin)
        assert loop is not None
        driven = _driven(robot, some.controls)
        result = some.engine.run(robot.steps, **driven, start=some.start, feedback=loop)
        felt = np.stack(loop.readings, axis=2)
        felt[result.status != "ok"] = np.nan
        found.append(felt)
    return np.concatenate(found)


def engine_in(
    robot: "ArticulatedRobot", world: World, compute: Compute, trees: Sequence[Tree] | None = None
) -> tuple[RigidEngine, State | None]:
    """The engine that moves a robot in a world, and its state at the start; None as its file has it.

    ``trees`` are those of several robots, by default the robot's own.
    """
    relief, physics = relief_under(robot, world), physics_in(robot, world)
    own = [robot.tree] if trees is None else trees
    engine = RigidEngine(own, physics, robot.senses, robot.network, ground=relief, **compute.options)
    afloat = isinstance(world, Terrain) and world.is_fluid
    return engine, None if relief is None or afloat else engine.standing()


def anatomy_of(robot: "ArticulatedRobot") -> Anatomy:
    """What the senses of a robot may read."""
    touch, hinges = len(robot.senses.touch), len(robot.model.tree.hinges)
    return Anatomy(touch, hinges, robot.light is not None, len(robot.drives), length_of(robot))


def _loop(robot: "ArticulatedRobot", points: Floats, start: State) -> ReflexLoop | None:
    """The reflexes of robots at some points, if they have any."""
    if robot.reflexes is None:
        return None
    split, span = robot.rhythm_size, robot.hold * robot.physics.time_step
    weights = points[:, split:]  # none of them is a size
    if robot.reflexes.weights is not None:
        weights = np.tile(robot.reflexes.weights, (len(points), 1))
    rhythms = Rhythms(points[:, :split], rhythm(robot, points), span)
    return ReflexLoop(robot.reflexes, anatomy_of(robot), weights, rhythms, start.position, robot.seed)


def _slopes(robot: "ArticulatedRobot", points: Floats, of_commands: Floats, loop: ReflexLoop | None) -> Floats:
    """Derivatives of a cost by the parameters of rhythms and reflexes, from those by the commands, if none decided."""
    if loop is None:
        return rhythm_slopes(robot, points, of_commands)
    of_rhythm = rhythm_slopes(robot, points, loop.by_commands) + loop.by_points
    found = of_rhythm if robot.weights_fixed else np.column_stack([of_rhythm, loop.by_weights])
    found[~np.isfinite(of_commands).all(axis=(1, 2))] = np.nan
    return found


def _driven(robot: "ArticulatedRobot", points: Floats) -> dict[str, Any]:
    """Arguments of the engine that say how the robot is driven at some points."""
    light = {} if robot.light is None else {"lights": np.array([robot.light])}
    if robot.controller == "network":
        return {"weights": points.reshape(len(points), robot.senses.count, len(robot.drives)), **light}
    return {"commands": rhythm(robot, points), "hold": robot.hold, **light}


def rhythm(robot: "ArticulatedRobot", points: Floats) -> Floats:
    """Commands over time, (N, K, M), of rhythms."""
    amplitude, offset, turns, _ = _parts(robot, points)
    return amplitude * np.sin(2 * np.pi * turns) + (1 - amplitude) * offset


def rhythm_slopes(robot: "ArticulatedRobot", points: Floats, of_commands: Floats) -> Floats:
    """Derivatives of a cost by the parameters of rhythms, (N, P), from those by the commands, (N, K, M)."""
    amplitude, offset, turns, times = _parts(robot, points)
    of_turns = of_commands * amplitude * 2 * np.pi * np.cos(2 * np.pi * turns)
    by = {
        "amplitude": (of_commands * (np.sin(2 * np.pi * turns) - offset)).sum(1),
        "phase": of_turns.sum(1),
        "offset": (of_commands * (1 - amplitude)).sum(1),
    }
    each = np.stack([by[part] for part in PARTS], axis=-1).reshape(len(points), -1)
    return np.column_stack([(of_turns * times).sum((1, 2)), each])


def _parts(robot: "ArticulatedRobot", points: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Amplitudes and offsets, (N, 1, M), where in the cycle drives are, (N, K, M), and when, (K, 1) [s]."""
    count = -(-robot.steps // robot.hold)
    times: Floats = np.arange(count, dtype=float)[:, None] * (robot.hold * robot.physics.time_step)
    values = points[:, 1 : robot.rhythm_size].reshape(len(points), 1, len(robot.drives), len(PARTS))
    amplitude, phase, offset = np.moveaxis(values, -1, 0)
    turns: Floats = points[:, :1, None] * times + phase
    return amplitude, offset, turns, times


def centre_slopes(tree: Tree, result: RigidResult, direction: Floats) -> tuple[Floats, Floats, Floats]:
    """Derivatives of the centre of mass along a direction by the base's place, its orientation and the angles."""
    places, turns = poses(tree, result.position, result.orientation, result.angles)
    shares = tree.masses / tree.masses.sum()
    base = rotation_matrix(result.orientation)
    arm = base.transpose(0, 2, 1) @ (shares @ places - result.position)[..., None]  # in the axes of the base
    of_orientation = np.empty_like(result.orientation)
    for part, step in enumerate(np.eye(4)):  # entries of the matrix are of second degree: these differences are exact
        slope = (rotation_matrix(result.orientation + step) - rotation_matrix(result.orientation - step)) / 2
        of_orientation[:, part] = along((slope @ arm)[..., 0], direction)
    carried = np.zeros((len(tree.bodies), len(tree.bodies)), bool)  # whether a body hangs on another one, or is it
    for n, parent in enumerate(tree.parents):
        carried[n] = carried[parent] if n else False
        carried[n, n] = True
    of_angles = np.empty_like(result.angles)
    for number, n in enumerate(tree.hinged):
        hinge, body, parent = tree.hinges[number], tree.ordered[n][0], tree.parents[n]
        axis = rotation_matrix(turns[:, parent]) @ (np.array(hinge.axis, float) / np.linalg.norm(hinge.axis))
        to_anchor = np.array(hinge.anchor, float) - np.array(body.position, float)
        anchor = places[:, n] + rotation_matrix(turns[:, n]) @ to_anchor
        hanging = shares * carried[:, n]
        lever = hanging @ places - hanging.sum() * anchor
        of_angles[:, number] = along(np.cross(axis, lever), direction)
    return np.tile(direction, (len(places), 1)), of_orientation, of_angles


def _result(
    robot: "ArticulatedRobot", runs: list[RigidResult], trees: list[Tree], gradients: Mapping[str, Floats]
) -> ArticulatedResult:
    several, ends, first = bool(robot.variants.free), [], 0
    for run in runs:
        count = len(run.status)
        ends.append((trees[first : first + count] if several else trees[:1], run))
        first += count
    each = [one for end in ends for one in _each_tree(*end)]
    centre = np.concatenate([_centre(*one) for one in each])
    start = first_centre(trees[0]) if not several else np.concatenate([first_centre(tree) for tree, _ in each])
    distance = along(centre - start, robot.direction)
    names = "work", "status", "steps"
    energy, status, steps = (np.concatenate([getattr(run, name) for run in runs]) for name in names)
    own = {
        one.name: np.concatenate([_measure_values(robot, one.name, *end) for end in ends]) for one in robot.own_measures
    }
    kept = tuple(trees if several else trees[:1])
    return ArticulatedResult(distance, centre, energy, status, steps, tuple(runs), own, gradients, kept)
