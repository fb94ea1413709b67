"""Articulated robots at work: how far they come, and the derivatives of that by what is free."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robots.articulated.reflexes import PARTS, ReflexLoop, Rhythms
from robots.articulated.rigid_motion import ENDED, slopes_of, told
from robots.articulated.senses import Sensed
from robots.robot import Place, Progress, Trial, World
from robots.terrain_fields import not_taken
from robots.world import FLUID_FIELDS, Terrain, terrain_of
from taichi_sim import rigid
from taichi_sim.base.arrays import Floats, Ints, along
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.base.short_text import ShortText
from taichi_sim.rigid import RigidEngine, RigidResult, State, Tree, poses
from taichi_sim.rigid.pose import rotation_matrix

if TYPE_CHECKING:
    from robots.articulated.robot import ArticulatedRobot
    from taichi_sim.ground import Relief

GROUND = Place("ground")
TERRAIN_FIELDS = ("slope", "ground", *FLUID_FIELDS)  # which articulated robots take
DEEP = 1e5  # m: how far a fluid all around reaches up, and down to the ground
FINENESS = 50  # nodes of uneven ground along a robot
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
        own: users' own measures by name, (N,) each; NaN of those that diverged.
        gradients: derivatives of the distance and of own measures by the parameters, (N, P), where asked for.
    """

    distance: Floats
    centre: Floats
    status: NDArray[np.str_]
    steps: Ints
    runs: tuple[RigidResult, ...]
    own: Mapping[str, Floats] = field(default_factory=dict)
    gradients: Mapping[str, Floats] = field(default_factory=dict)

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
        terrain: ``GROUND``, or a ``Terrain`` with a slope, uneven ground, sand, or water.
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


def try_points(robot: "ArticulatedRobot", points: ArrayLike, trial: Trial) -> ArticulatedResult:
    """What a robot does at N points, shape (N, P), in a trial."""
    points, tree = robot.points(points), robot.model.tree
    if trial.gradients:
        check_gradients(robot, trial.world)
    engine, start = engine_in(robot, trial.world, trial.compute)
    state = 7 + 12 * len(tree.bodies) + tree.motors + 2 * len(tree.points())  # numbers that a tape keeps of a step
    at_once = max(1, TAPE_BYTES // (8 * state * (robot.steps + 1))) if trial.gradients else ROBOTS_AT_ONCE
    wanted = dict.fromkeys("distance" if name == "speed" else name for name in trial.gradients)
    runs, slopes = [], {name: list[Floats]() for name in wanted}
    for first in range(0, len(points), at_once):
        some = points[first : first + at_once]
        loop = _loop(robot, some, engine.rest() if start is None else start)
        driven = {**_driven(robot, some), "start": start, "feedback": loop}
        if trial.gradients:
            tape = engine.record(robot.steps, **driven)
            runs.append(tape.result)
            for name, found in slopes.items():
                back = tape.pull_back(**_end_slopes(robot, name, tape.result))
                given = back.weights if robot.controller == "network" else _slopes(robot, some, back.commands, loop)
                found.append(given.reshape(len(some), -1))
        else:
            runs.append(engine.run(robot.steps, **driven, record_every=trial.record_every))
        if trial.progress:
            trial.progress((first + len(some)) / len(points))
    return _result(robot, runs, {name: np.concatenate(found) for name, found in slopes.items()})


def _end_slopes(robot: "ArticulatedRobot", name: str, result: RigidResult) -> dict[str, Floats]:
    """Derivatives of a measure by places, orientations and angles at the end."""
    for own in robot.own_measures:
        if own.name == name:
            return slopes_of(robot, own, result)
    return dict(zip(ENDED, centre_slopes(robot.model.tree, result, robot.direction), strict=True))


def felt_over_time(robot: "ArticulatedRobot", points: Floats, world: World, compute: Compute) -> Floats:
    """What robots with reflexes feel at N points, (N, P), at every decision, (N, S, T); NaN of those that diverge."""
    engine, start = engine_in(robot, world, compute)
    found = []
    for first in range(0, len(points), ROBOTS_AT_ONCE):
        some = points[first : first + ROBOTS_AT_ONCE]
        loop = _loop(robot, some, engine.rest() if start is None else start)
        assert loop is not None
        result = engine.run(robot.steps, **_driven(robot, some), start=start, feedback=loop)
        felt = np.stack(loop.readings, axis=2)
        felt[result.status != "ok"] = np.nan
        found.append(felt)
    return np.concatenate(found)


def check_gradients(robot: "ArticulatedRobot", world: World) -> None:
    """Refuse a world in which a cone limits the friction of a robot, which has no derivatives then."""
    friction = physics_in(robot, world).friction
    if np.isfinite(friction):
        told = "give inf, as --friction inf, which has no limit beyond which feet slip"
        raise ValueError(f"friction: {friction:g} has no derivatives; {told}")


def engine_in(robot: "ArticulatedRobot", world: World, compute: Compute) -> tuple[RigidEngine, State | None]:
    """The engine that moves a robot in a world, and its state at the start; None as its file has it."""
    relief, physics = relief_under(robot, world), physics_in(robot, world)
    engine = RigidEngine(robot.model.tree, physics, robot.senses, robot.network, ground=relief, **compute.options)
    afloat = isinstance(world, Terrain) and world.is_fluid
    return engine, None if relief is None or afloat else engine.standing()


def on_ground(world: World) -> World:
    """A world that robots of this kind can be in: level, tilted or uneven ground, maybe with sand or water, or a fluid.

    Raises:
        ValueError: for worlds of other kinds, and terrains that are more than ground.
    """
    if world in (GROUND, Terrain()):
        return GROUND
    terrain = terrain_of(world)
    if not_taken(terrain, TERRAIN_FIELDS):
        raise ValueError(
            f"terrain: {terrain.where!r} is not allowed for an articulated robot; give a slope, uneven ground or "
            "water, such as hill:5, rough:0.01+sand:2e5 or ramp:-5+water:0, and friction by the robot"
        )
    return terrain


def tilted(robot: "ArticulatedRobot", world: World) -> rigid.World:
    """The physics of a robot on ground that rises along its heading; the robot is turned with it."""
    slope = world.slope if isinstance(world, Terrain) else 0.0
    if slope == 0:
        return robot.physics
    angle, down = math.radians(slope), robot.physics.gravity
    x, y, _ = down * math.sin(angle) * robot.direction
    return replace(robot.physics, gravity=down * math.cos(angle), gravity_across=(float(x), float(y)))


def physics_in(robot: "ArticulatedRobot", world: World) -> rigid.World:
    """The physics of a robot in a world: in a fluid it neither sinks nor rises, and feels its drag."""
    physics = tilted(robot, world)
    if not isinstance(world, Terrain) or not world.is_wet:
        return physics
    pressure, friction = world.drag
    gravity = 0.0 if world.is_fluid else physics.gravity
    return replace(physics, gravity=gravity, pressure_drag=pressure, friction_drag=friction)


def relief_under(robot: "ArticulatedRobot", world: World) -> "Relief | None":
    """The uneven ground around a robot, whose x axis is its heading, with its water; None for the level floor."""
    from taichi_sim.ground.relief import Relief, Water

    terrain = on_ground(world)
    if not isinstance(terrain, Terrain):
        return None
    if terrain.fluid_density is not None:
        around = Water(DEEP, terrain.fluid_density) if terrain.fluid_density else None
        return Relief(np.full((2, 2), -DEEP), 1.0, water=around)
    if terrain.uneven is None:
        return None
    relief, (x, y, _) = terrain.uneven.relief(robot.heading, 2 * _length(robot) / FINENESS), ground_place(robot)
    return replace(relief, origin=(relief.origin[0] + x, relief.origin[1] + y)) if x or y else relief


def ground_place(robot: "ArticulatedRobot") -> Floats:
    """Where uneven ground has its origin, (3,) [m]: the whole metre next to the start of a robot.

    Ground is made around its origin, so a robot that its file puts elsewhere would find it level.
    """
    x, y, _ = first_centre(robot.model.tree)[0]
    return np.round([x, y, 0.0])


def _length(robot: "ArticulatedRobot") -> float:
    """The longest side of the space that a robot takes [m]."""
    centres, radii = robot.model.tree.balls()
    reach = radii[:, None]
    return float(((centres + reach).max(axis=0) - (centres - reach).min(axis=0)).max())


def sensed_of(robot: "ArticulatedRobot") -> Sensed:
    """What the senses of a robot may read."""
    touch, hinges = len(robot.senses.touch), len(robot.model.tree.hinges)
    return Sensed(touch, hinges, robot.light is not None, len(robot.drives), _length(robot))


def _loop(robot: "ArticulatedRobot", points: Floats, start: State) -> ReflexLoop | None:
    """The reflexes of robots at some points, if they have any."""
    if robot.reflexes is None:
        return None
    split, span = robot.rhythm_size, robot.hold * robot.physics.time_step
    weights = points[:, split:]
    if robot.reflexes.weights is not None:
        weights = np.tile(robot.reflexes.weights, (len(points), 1))
    rhythms = Rhythms(points[:, :split], rhythm(robot, points), span)
    return ReflexLoop(robot.reflexes, sensed_of(robot), weights, rhythms, start.position, robot.seed)


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


def centres(tree: Tree, position: Floats, orientation: Floats, angles: Floats) -> Floats:
    """Centres of mass, (..., 3) [m], at poses as of ``taichi_sim.rigid.poses``."""
    masses = tree.masses
    return np.asarray(masses @ poses(tree, position, orientation, angles)[0] / masses.sum())


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


def first_centre(tree: Tree) -> Floats:
    """Centre of mass of a robot as its file has it, from where distances count, (1, 3) [m]."""
    begin, still = np.array([tree.ordered[0][0].position], float), np.array([[1.0, 0.0, 0.0, 0.0]])
    return centres(tree, begin, still, np.zeros((1, len(tree.hinges))))


def _result(robot: "ArticulatedRobot", runs: list[RigidResult], gradients: Mapping[str, Floats]) -> ArticulatedResult:
    tree = robot.model.tree
    start = first_centre(tree)
    centre = np.concatenate([centres(tree, run.position, run.orientation, run.angles) for run in runs])
    status, steps = (np.concatenate([getattr(run, name) for run in runs]) for name in ("status", "steps"))
    own = {each.name: np.concatenate([told(robot, each, run) for run in runs]) for each in robot.own_measures}
    return ArticulatedResult(along(centre - start, robot.direction), centre, status, steps, tuple(runs), own, gradients)
