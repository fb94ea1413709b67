"""Lattice robots as Gymnasium environments, one or a batch: actions change how muscles follow their waves."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import gymnasium
import numpy as np

from robots.control.reflexes import senses_among
from robots.gym.batch import SEEDS, Batch, Gain, Observation, checked_gain, gained_by
from robots.gym.environment import FARTHEST, RobotEnvironment, RobotVector, compute_of, named_world
from robots.lattice_robot.episodes import Episodes
from robots.lattice_robot.robot import LatticeRobot
from robots.lattice_robot.senses import SENSES
from robots.lattice_robot.simulation import LatticeRobotResult
from robots.robot import find_robot_doing, make_robot
from robots.world import Terrain
from taichi_sim.base.arrays import Bools, Floats, Ints, along
from taichi_sim.base.checks import number, shown, whole_number
from taichi_sim.base.compute import Compute, ComputeOptions

if TYPE_CHECKING:
    from robots.view.motion import Motion

# What is felt by default is fixed: a policy that was learned expects these numbers in this order.
USUAL_SENSES = ("strain", "touch", "tilt", "slip", "velocity", "clock")
LIT_SENSES = ("strain", "touch", "tilt", "slip", "velocity", "light", "clock")  # where there is a light
GAINS = ("progress", "light", "prop", "turn", "rise")

Worlds = Terrain | str | Sequence[Terrain | str]


def _lattice_robot(given: LatticeRobot | str | Path, cycles: int | None) -> LatticeRobot:
    """The robot that is given, or that a name or a file means, for so many cycles, its own if None.

    Raises:
        ValueError: for anything else, and robots of other kinds.
    """
    found: object = given
    if isinstance(given, str | Path):
        found = make_robot(*find_robot_doing(str(given)), {})
    if not isinstance(found, LatticeRobot):
        raise ValueError(f"robot: {shown(given)} is no lattice robot; give a LatticeRobot, or its name or file")
    return found if cycles is None else replace(found, cycles=cycles)


def _worlds(given: Worlds) -> list[Terrain]:
    """The terrains that are given, or that names mean.

    Raises:
        ValueError: for anything else.
    """
    several: Sequence[object] = given if isinstance(given, list | tuple) else [given]
    return [named_world(each, "give a terrain, its name, or several of them") for each in several]


class Rewarded(Batch):
    """Robots and what they gain with every action.

    Attributes:
        episodes: of the robots.
        gain: what rewards count: progress along the heading, towards the light, or of the prop, or the rise of the
            middle above all before [body lengths]; or turning to the left [rad]; or a function's, see ``checked_gain``.
    """

    def __init__(
        self,
        batch: int,
        robot: LatticeRobot | str | Path,
        world: Worlds,
        senses: tuple[str, ...] | None,
        gain: Gain,
        strength: float,
        cycles: int | None,
        compute: Compute,
    ) -> None:
        """Take what a ``LatticeRobotEnvironment`` takes."""
        worlds, found = _worlds(world), _lattice_robot(robot, cycles)
        lit = all(found.light_in(terrain) for terrain in worlds)
        feels = (LIT_SENSES if lit else USUAL_SENSES) if senses is None else senses_among(SENSES)("senses", senses)
        count = whole_number("num_envs", batch, 1)
        if (own := found.fixed.reflexes) is not None and np.any(own.weights):
            warnings.warn(
                f"the reflexes of {found.name} do not act in an environment; its actions change its waves instead",
                stacklevel=2,
            )
        self.episodes = Episodes(found, worlds, count, feels, compute)
        self.gain = checked_gain(gain, GAINS)
        if self.gain == "light" and not lit:
            raise ValueError("gain: light is not allowed without one; give a world such as flat+light:0.1,0.05")
        if self.gain == "prop" and self.episodes.robot.placed is None:
            raise ValueError(
                "gain: prop is not allowed without one; give a world such as flat+box:0.02,0.02,0.02,0.07,0"
            )
        self._strength = number("strength", strength, 0.0, 0.5)
        if len(worlds) > 1:
            self.choices, self.option = len(worlds), "world"
        self._given, self._left = found, self.episodes.steps
        observed = gymnasium.spaces.Box(-FARTHEST, FARTHEST, (self.episodes.width,), np.float64)
        acted = gymnasium.spaces.Box(-1.0, 1.0, (self.episodes.regions,), np.float64)
        super().__init__(count, observed, acted, self.episodes.seconds)

    @property
    def left(self) -> int:
        """Steps until the cycles are over."""
        return self._left

    def way(self, options: dict[str, Any], generator: np.random.Generator) -> int:
        """The world in which an episode begins, and the seed of the noise there, as one number."""
        world = super().way(options, generator)
        noise = int(generator.integers(SEEDS)) if self._given.perturbation else 0
        return noise * len(self.episodes.worlds) + world

    def begin(self, which: Ints, ways: Ints) -> Observation:
        """Begin an episode of all robots; what they feel, shape (B, width)."""
        assert len(which) == self.count
        seeds, worlds = np.divmod(ways, len(self.episodes.worlds))
        felt, e = self.episodes.begin(seeds, worlds), self.episodes
        self._before = e.positions[:, : e.own]
        self._left, self._heights = e.steps, self._middles()[:, 2]
        self._start, self._turned = e.start.mean(axis=1), np.zeros(self.count)  # from which the light is told
        self._value = self._values()
        return felt

    def _values(self) -> Floats:
        """What robots have gained since the start, shape (B,): rewards are how it grows."""
        if callable(self.gain):
            return gained_by(self.gain, self.info(), ~np.isfinite(self._middles().sum(axis=1)))
        if self.gain == "turn":
            return self._turns()
        robot = self.episodes.robot
        if self.gain == "light":
            reached = -self._light_distances()
        elif self.gain == "rise":
            self._heights = np.fmax(self._heights, self._middles()[:, 2])
            reached = self._heights
        else:
            reached = along(self._prop_middles() if self.gain == "prop" else self._middles(), robot.direction)
        found: Floats = reached / robot.length
        return found

    def _turns(self) -> Floats:
        """How far robots have turned to the left since the start, seen from above, shape (B,) [rad]."""
        e = self.episodes
        before, now = self._before[..., :2], e.positions[:, : e.own, :2]
        (x0, y0), (x1, y1) = (np.moveaxis(each - each.mean(axis=1, keepdims=True), -1, 0) for each in (before, now))
        self._turned = self._turned + np.arctan2((x0 * y1 - y0 * x1).sum(axis=1), (x0 * x1 + y0 * y1).sum(axis=1))
        self._before = e.positions[:, : e.own]
        return self._turned

    def advance(self, actions: Floats) -> tuple[Observation, Floats, Bools, Bools]:
        """Play the next piece of the cycle."""
        felt, _, failed = self.episodes.advance(self._strength * actions)
        self._left -= 1
        before, self._value = self._value, self._values()
        return np.nan_to_num(felt), self._value - before, np.zeros(self.count, bool), failed

    def info(self) -> dict[str, Any]:
        """Steps that are left, where robots are and how fast, with prop and light; measures after the last step."""
        e = self.episodes
        found = {"left": np.full(self.count, self._left), "position": self._middles(), "velocity": e.velocity}
        if len(e.worlds) > 1:
            found["world"] = e.which.copy()
        if e.robot.placed is not None:
            found["prop_position"] = self._prop_middles()
        if e.lights is not None:
            found["light_distance"] = self._light_distances()
        return {**found, **e.measures}

    def _middles(self) -> Floats:
        """Means of the robots' voxel centres, shape (B, 3) [m]."""
        e = self.episodes
        found: Floats = e.positions[:, : e.own].mean(axis=1).astype(float)
        return found

    def _prop_middles(self) -> Floats:
        """Middles of the first prop, shape (B, 3) [m]."""
        e = self.episodes
        assert e.robot.placed is not None
        found: Floats = e.positions[:, e.robot.placed.of(1)].mean(axis=1).astype(float)
        return found

    def _light_distances(self) -> Floats:
        """How far the middles are from the light, seen from above, shape (B,) [m]."""
        lights = self.episodes.lights
        assert lights is not None
        found: Floats = np.hypot(*(self._middles()[:, :2] - self._start[:, :2] - lights).T)
        return found

    def motion(self, robot: int) -> "Motion":
        """A robot, with props and light."""
        from robots.lattice_robot.motion import lattice_robot_motion

        none, e = np.array([""]), self.episodes
        shown = LatticeRobotResult({}, none, none, np.zeros(1, int), e.seconds, (e.robot.body,), (e.frames(robot),))
        terrain = e.worlds[e.which[robot]]
        return lattice_robot_motion(shown, self._given, terrain, name=self._given.name)


class LatticeRobotEnvironment(RobotEnvironment):
    """Gymnasium environment of a lattice robot: actions change its muscles' waves sixteen times a cycle.

    Action, shape (R,): for each driven region from -1 to 1, times ``strength``: the difference of its scale from the
    wave a sixteenth of a cycle later, to which it goes in a straight line. All zero play the waves, to the bit.

    Observation: what ``senses`` feel, see ``robots.lattice_robot.senses``. Reward: what is gained, see ``Rewarded``.
    An episode ends with the robot's cycles.

    Reset: with several worlds the seed draws one, or the option ``world`` says its number, which ``info`` tells; and it
    matters for a robot with a ``perturbation`` of its start. ``info`` has the steps that are left,
    position and velocity of the robot's middle [m, m/s], the position of the first prop [m] and the distance from the
    light [m], where there are any; after the last step of the cycles the robot's measures, too, as ``simulate`` has
    them: they count the cycles after the first, where rewards count all.
    """

    def __init__(
        self,
        robot: LatticeRobot | str | Path = "soft-quadruped",
        world: Worlds = "flat",
        senses: tuple[str, ...] | None = None,
        gain: Gain = "progress",
        strength: float = 0.1,
        cycles: int | None = None,
        render_mode: str | None = None,
        **compute: Unpack[ComputeOptions],
    ) -> None:
        """Take the robot and its world.

        Args:
            robot: with its waves; what is free of it is as it starts. Or its name, or file.
            world: a terrain, or its name; or several, of which each episode is in one.
            senses: names; by default strain, touch, tilt, slip, velocity and clock, and light before clock where there
                is one.
            gain: what rewards count: ``"progress"``, ``"light"``, ``"prop"``, ``"turn"`` or ``"rise"``; or a function
                of ``info``, as vector environments have it, that says what robots have gained so far, shape (B,).
            strength: largest difference of a scale.
            cycles: that count, after a first one, and with it the length of an episode; the robot's own by default.
            render_mode: ``"rgb_array"`` for pictures, or None.
            compute: ``precision`` (``"f32"`` by default), ``device`` and ``threads``.

        Raises:
            ValueError: for values that are not allowed.
        """
        chosen = compute_of(type(self), compute)
        super().__init__(Rewarded(1, robot, world, senses, gain, strength, cycles, chosen), render_mode)


class LatticeRobotVector(RobotVector):
    """Vector environment of copies of a lattice robot, each in a world of several; all episodes are equally long."""

    def __init__(
        self,
        num_envs: int = 1,
        robot: LatticeRobot | str | Path = "soft-quadruped",
        world: Worlds = "flat",
        senses: tuple[str, ...] | None = None,
        gain: Gain = "progress",
        strength: float = 0.1,
        cycles: int | None = None,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        **compute: Unpack[ComputeOptions],
    ) -> None:
        """Take the number of robots, and what a ``LatticeRobotEnvironment`` takes."""
        chosen = compute_of(type(self), compute)
        batch = Rewarded(num_envs, robot, world, senses, gain, strength, cycles, chosen)
        super().__init__(batch, max_episode_steps, render_mode)
