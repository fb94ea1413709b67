"""Articulated robots as Gymnasium environments, one or a batch: an action is a command to each drive."""

import warnings
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import gymnasium
import numpy as np

from robots.articulated.reflexes import changed_command
from robots.articulated.rigid_motion import own_measure_values
from robots.articulated.robot import ArticulatedRobot
from robots.articulated.senses import SENSES, DriveReader
from robots.articulated.simulation import anatomy_of, centres, engine_in, first_centre, rhythm
from robots.articulated.worlds import on_ground
from robots.control.reflexes import senses_among
from robots.control.senses import width_of
from robots.gym.batch import Batch, Gain, Observation, checked_gain, gained_by
from robots.gym.environment import FARTHEST, RobotEnvironment, RobotVector, compute_of, named_world
from robots.robot import FixedRobot, World, find_robot_doing, make_robot
from robots.world import Terrain
from taichi_sim.base.arrays import Bools, Floats, Ints, along
from taichi_sim.base.checks import choice, number, shown
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.rigid import Frames, RigidResult
from taichi_sim.rigid.feedback import Felt

if TYPE_CHECKING:
    from robots.view.motion import Motion

ACTIONS = ("commands", "differences")
GAINS = ("progress", "light")
TOLD = ("diverged", "left", "position", "lean", "distance", "energy", "light_distance", "speed")  # names in ``info``

Given = ArticulatedRobot | FixedRobot | str | Path


def robot_of(given: Given | None) -> tuple[ArticulatedRobot, Floats]:
    """The robot that is given, or that a file means, with no free bodies and hinges, and the point of its rhythm, (P,).

    Raises:
        ValueError: for anything else, and robots of other kinds.
    """
    found: object = make_robot(*find_robot_doing(str(given)), {}) if isinstance(given, str | Path) else given
    robot, point = (found.robot, found.point) if isinstance(found, FixedRobot) else (found, None)
    if not isinstance(robot, ArticulatedRobot):
        raise ValueError(f"robot: {shown(given)} is no articulated robot; give one, or its file, such as ant.xml")
    controls, factors = robot.split(robot.start if point is None else point)
    if len(factors):
        with warnings.catch_warnings(action="ignore"):  # what of the file is ignored was told before
            robot = replace(robot, **robot.variants.settled(factors))
    return robot, controls


def _ground(given: Terrain | str) -> World:
    """The ground that is given, or that a name means.

    Raises:
        ValueError: for anything else, and what is more than ground.
    """
    try:
        return on_ground(named_world(given))
    except ValueError as error:
        raise ValueError(f"world: {str(error).partition(': ')[2]}") from None


class Driven(Batch):
    """Articulated robots of one file side by side, whose drives are told what to do command by command.

    Attributes:
        gain: what rewards count: how far the centre of mass came along the heading, or how near the base is to the
            light [lengths of the robot]; or a function's, see ``checked_gain``.
    """

    def __init__(
        self,
        count: int,
        robot: Given | None,
        world: Terrain | str,
        senses: tuple[str, ...] | None,
        actions: str,
        strength: float,
        gain: Gain,
        most_lean: float | None,
        compute: Compute,
    ) -> None:
        """Take what an ``ArticulatedEnvironment`` takes."""
        self._robot, point = robot_of(robot)
        self._world = _ground(world)
        self._differs = choice("actions", actions, ACTIONS) == "differences"
        self.gain = checked_gain(gain, GAINS)
        self._check(self._robot, point)
        self._strength = number("strength", strength, 0.0, 2.0)
        self._most_lean = None if most_lean is None else number("most_lean", most_lean, 0.0, 180.0, "degrees")
        self._senses = self._usual_senses() if senses is None else senses_among(SENSES)("senses", senses)
        self._anatomy, self._engine = anatomy_of(self._robot), engine_in(self._robot, self._world, compute)
        for name in self._senses:
            if not SENSES[name].width(self._anatomy):
                raise ValueError(f"senses: {name} is not allowed without sensors of it in {self._robot.name}")
        width = width_of(SENSES, self._senses, self._anatomy)
        observed = gymnasium.spaces.Box(-FARTHEST, FARTHEST, (width,), np.float64)
        acted = gymnasium.spaces.Box(-1.0, 1.0, (self._anatomy.drives,), np.float64)
        super().__init__(count, observed, acted, self._robot.hold * self._robot.physics.time_step)
        self._commands_in_all = -(-self._robot.steps // self._robot.hold)
        self._first_centre = first_centre(self._robot.tree)
        self._points = np.tile(point, (count, 1))[:, : self._robot.rhythm_size]

    def _check(self, robot: ArticulatedRobot, point: Floats) -> None:
        """Refuse what the robot has not got, and tell of what does not act."""
        if self.gain == "light" and robot.light is None:
            raise ValueError("gain: light is not allowed without one; give a robot with light=(x, y, z)")
        if robot.controller != "rhythm":
            raise ValueError("robot: one with a network is not allowed, as actions are in its place; give a rhythm")
        for own in robot.own_measures:
            if own.name in TOLD:
                raise ValueError(f"own_measures: {own.name} is not allowed in an environment, whose info has it")
        free = point[robot.rhythm_size :]
        if robot.reflexes is not None and np.any(free if robot.reflexes.weights is None else robot.reflexes.weights):
            why = f"the reflexes of {robot.name} do not act in an environment; its actions drive it instead"
            warnings.warn(why, stacklevel=2)

    def _usual_senses(self) -> tuple[str, ...]:
        """What is felt by default: a policy that was learned expects these numbers in this order."""
        robot, rest = self._robot, ("angles", "tilt", "velocity")
        lit, clock = ("light",) * (robot.light is not None), ("clock",) * self._differs
        return *rest, *("touch",) * bool(robot.senses.touch), *lit, *clock

    @property
    def left(self) -> int:
        """Commands until the duration of the robot is over."""
        return self._commands_in_all - self._done

    def begin(self, which: Ints, ways: Ints) -> Observation:
        """Begin episodes of all robots; what they feel, shape (B, width)."""
        assert len(which) == self.count
        robot, (engine, start) = self._robot, self._engine
        lights = None if robot.light is None else np.array([robot.light])
        self._session = engine.session(batch=self.count, lights=lights, start=start)
        self._done, self._commands = 0, np.zeros((self.count, self._anatomy.drives))
        self._distance, self._energy = np.zeros(self.count), np.zeros(self.count)
        self._over = np.zeros(self.count, bool)  # who has fallen or diverged: nothing more is told of it
        self._rhythm = rhythm(robot, self._points) if self._differs else None
        found = self._session.advance(steps=0)
        first = np.array(found.position, float)
        self._reader = DriveReader(self._senses, self._anatomy, self.seconds, self._points, first)
        self._reader.keeps = False
        return self._feel(found)

    def advance(self, actions: Floats) -> tuple[Observation, Floats, Bools, Bools]:
        """Give all drives a command each, and keep it for its time."""
        self._commands = actions
        if self._rhythm is not None:
            self._commands = changed_command(self._rhythm[:, self._done], self._strength * actions)
        robot, before = self._robot, self._value
        steps = min(robot.hold, robot.steps - self._done * robot.hold)
        found = self._session.advance(self._commands, steps)
        self._done, self._reader.sooner = self._done + 1, (robot.hold - steps) * robot.physics.time_step
        felt, failed = self._feel(found), found.status != "ok"
        fell = np.zeros(self.count, bool) if self._most_lean is None else self._lean > self._most_lean
        self._over = self._over | fell | failed
        return felt, self._value - before, fell, failed

    def _feel(self, found: RigidResult) -> Observation:
        """What robots feel as they now are, and how far they came; those whose episodes are over stay as they were."""
        now = found.position, found.orientation, found.angles, found.readings
        goes_on = (found.status == "ok") & ~self._over
        distance = along(centres(self._robot.tree, *now[:3]) - self._first_centre, self._robot.direction)
        seen = self._seen if self._done else now
        self._seen: tuple[Floats, ...] = tuple(
            np.where(goes_on[:, None], each, before) for each, before in zip(now, seen, strict=True)
        )
        self._found, self._distance = found, np.where(goes_on, distance, self._distance)
        self._energy = np.where(goes_on, found.work, self._energy)
        _, x, y, _ = self._seen[1].T
        self._lean = np.degrees(np.arccos(np.clip(1 - 2 * (x * x + y * y), -1.0, 1.0)))
        if callable(self.gain):
            gained: Floats = gained_by(self.gain, self.info(), (found.status != "ok") | self._over)
            kept: Floats = self._value if self._done else gained
            self._value: Floats = np.where(self._over, kept, gained)  # who has fallen gains no more
        else:
            reached = self._distance if self.gain == "progress" else -self._light_distances()
            self._value = np.where(found.status == "ok", reached, np.nan) / self._anatomy.length
        return np.nan_to_num(self._reader.read(self._done, Felt(*now)))

    def _light_distances(self) -> Floats:
        """How far bases are from the light, seen from above, shape (B,) [m]."""
        assert self._robot.light is not None
        found: Floats = np.hypot(*(self._seen[0][:, :2] - self._robot.light[:2]).T)
        return found

    def info(self) -> dict[str, Any]:
        """Commands that are left, where robots are and how they lean; measures after the last command."""
        robot, left = self._robot, np.full(self.count, self.left)
        found = {"left": left, "position": self._seen[0], "lean": self._lean, "distance": self._distance}
        found["energy"] = self._energy
        if robot.light is not None:
            found["light_distance"] = self._light_distances()
        if not self.left:
            found["speed"] = self._distance / (robot.steps * robot.physics.time_step)
            found |= {each.name: own_measure_values(robot, each, self._found) for each in robot.own_measures}
            found |= {name: np.where(self._over, np.nan, found[name]) for name in found if name not in TOLD[:-1]}
        return found

    def motion(self, robot: int) -> "Motion":
        """A robot on its ground, with its light."""
        from robots.articulated.motion import motion_of

        times = np.array([self._done * self.seconds - self._reader.sooner])
        frames = Frames(times, *(each[None] for each in (*self._seen, self._commands)))
        return motion_of(self._robot, frames, self._world, robot)


class ArticulatedEnvironment(RobotEnvironment):
    """Gymnasium environment of a robot from an MJCF or URDF file: actions command its drives, by default at 50 Hz.

    Action, shape (M,): for each drive from -1 to 1, its command, which means its whole range: an angle or a rate, as
    the file says. With ``actions="differences"``, times ``strength``, how its command differs from the rhythm of the
    robot: zero plays the rhythm.

    Observation: what ``senses`` feel, see ``robots.articulated.senses``. Reward: what is gained, see ``Driven``. An
    episode ends with the robot's duration, or when its base leans too far.

    Reset: always in the same way. ``info`` has the commands that are left, the place of the base's centre [m], how far
    it leans [degrees], the distance of the centre of mass along the heading [m], and that from the light [m], if there
    is one; after the last command the robot's measures, too, as ``simulate`` has them.
    """

    def __init__(
        self,
        robot: Given | None = None,
        world: Terrain | str = "flat",
        senses: tuple[str, ...] | None = None,
        actions: str = "commands",
        strength: float = 0.3,
        gain: Gain = "progress",
        most_lean: float | None = None,
        render_mode: str | None = None,
        **compute: Unpack[ComputeOptions],
    ) -> None:
        """Take the robot and its world.

        Args:
            robot: an articulated robot, a design of it, or the file of either; its rhythm is as it starts.
            world: a terrain, or its name.
            senses: names; by default angles, tilt and velocity, then touch, light, and with ``"differences"`` clock,
                as far as the robot has them.
            actions: ``"commands"``, or ``"differences"`` from the rhythm.
            strength: largest difference of a command.
            gain: what rewards count: ``"progress"`` or ``"light"``; or a function of ``info``, as vector environments
                have it, that says what robots have gained so far, shape (B,).
            most_lean: of the base from upright; beyond it the robot has fallen and its episode ends [degrees]. None:
                it may fall.
            render_mode: ``"rgb_array"`` for pictures, or None.
            compute: ``precision`` (``"f32"`` by default), ``device`` and ``threads``.

        Raises:
            ValueError: for values that are not allowed.
        """
        chosen = compute_of(type(self), compute)
        batch = Driven(1, robot, world, senses, actions, strength, gain, most_lean, chosen)
        super().__init__(batch, render_mode)


class ArticulatedVector(RobotVector):
    """Vector environment of copies of an articulated robot in one batch."""

    def __init__(
        self,
        num_envs: int = 1,
        robot: Given | None = None,
        world: Terrain | str = "flat",
        senses: tuple[str, ...] | None = None,
        actions: str = "commands",
        strength: float = 0.3,
        gain: Gain = "progress",
        most_lean: float | None = None,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        **compute: Unpack[ComputeOptions],
    ) -> None:
        """Take the number of robots, and what an ``ArticulatedEnvironment`` takes."""
        chosen = compute_of(type(self), compute)
        batch = Driven(num_envs, robot, world, senses, actions, strength, gain, most_lean, chosen)
        super().__init__(batch, max_episode_steps, render_mode)
