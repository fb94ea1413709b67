"""The inflatable shape-changing robot as an environment: each step plays one column of a gait.

Source: Powers 2021 dissertation, ch. 5; a sequence of actions does what a schedule of these columns does, bit for bit.
"""

from typing import Any, Literal, Unpack

import gymnasium
import numpy as np

from robots.gym.environment import Observation, RobotEnvironment
from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.body import (
    BLADDER_COUNT,
    FIRST_BLADDER,
    FOOT_1,
    FOOT_2,
    NAMED_GEOMETRIES,
    InflatableGeometry,
    kinds_of,
)
from robots.inflatable.design import Pressure, checked_pressure, each_pressure, highest_pressure
from robots.inflatable.program import RobotEvents
from robots.inflatable.schedule import ROWS, GaitSchedule
from robots.inflatable.simulation import engine_of, read_poses, travel_directions
from robots.inflatable.timing import nominal_steps, play
from robots.world import Terrain
from taichi_sim.autodiff.arrays import value_of
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import choice, number
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.lattice import LatticeEngine, LatticeResult, ProgramBuilder

FARTHEST = 100.0  # bodies' lengths in a step: displacements are cut off there
_LOW = np.array([0.0] * ROWS + [-1.0] * 6 + [-FARTHEST] * 2)
_HIGH = np.array([1.0] * (ROWS + 6) + [FARTHEST] * 2)


class PancakeEnvironment(RobotEnvironment):
    """Roll or inch in a direction, one column of a gait at a time.

    Action: bladders 1 to 8 and feet 1 and 2, shape (10,): on (inflated, gripping) or off. With
    ``actions="continuous"`` numbers from 0 to 1, of which those above a half are on. A step lasts until the slowest
    bladder is done and the body has settled.

    Observation, shape (18,): how far the bladders are inflated, 8 numbers from 0 to 1; whether the feet gripped, 2;
    unit vector from foot 1 to foot 2, 3; unit vector from the lower to the upper skin, 3; displacement in the last
    step, along the direction of travel and to the left of it, 2 [body lengths].

    Reward: displacement along the direction of travel [body lengths].

    Reset: flat bladders, core at its pressure. The seed matters with a perturbation only. ``info`` has the distance
    since then [m], the speed by the published convention [body lengths/s] and the time steps run.
    """

    def __init__(
        self,
        pressure: Pressure = 0.0,
        orientation: float = 90.0,
        slope: float = 0.0,
        actions: Literal["bits", "continuous"] = "bits",
        geometry: InflatableGeometry | str = "published",
        actuation: InflatableActuation = ACTUATION,
        perturbation: float = 0.0,
        render_mode: None = None,
        **compute: Unpack[ComputeOptions],
    ) -> None:
        """Take the design and the terrain.

        Args:
            pressure: pressure of the core [Pa], or one for each of several.
            orientation: heading [degrees]: 0 rolls, 90 inches.
            slope: [degrees].
            actions: bits, or numbers.
            geometry: geometry of the body, or its name.
            actuation: rates and friction.
            perturbation: standard deviation of noise on the start positions [m].
            render_mode: None.
            compute: ``precision`` (``"f32"`` by default, as in searches), ``device`` and ``threads``, see
                ``robots.inflatable.simulate``.

        Raises:
            ValueError: for values that are not allowed.
        """
        if isinstance(geometry, str):
            geometry = NAMED_GEOMETRIES[choice("geometry", geometry, NAMED_GEOMETRIES)]
        spaces = {
            "bits": gymnasium.spaces.MultiBinary(ROWS),
            "continuous": gymnasium.spaces.Box(0.0, 1.0, (ROWS,), np.float64),
        }
        super().__init__(_LOW, _HIGH, spaces[choice("actions", actions, spaces)], render_mode)
        self.pressure = checked_pressure(pressure)
        each_pressure(self.pressure, geometry)
        self._heading = number("orientation", orientation, 0.0, 90.0, "degrees")
        self._ahead = travel_directions(np.array([self._heading]))[0]
        self._terrain = Terrain(slope)
        self.geometry, self.actuation = geometry, actuation.on(self._terrain)
        self._perturbation = number("perturbation", perturbation, 0.0, geometry.voxel_size, "m")
        self._compute = Compute.given({"precision": "f32", **compute})
        self._engine: LatticeEngine | None = None
        self._ready: Any = None

    def _begin(self, options: dict[str, Any]) -> Observation:
        """The first episode initialises the robot, later ones restore that state."""
        if options:
            raise ValueError(f"options: {next(iter(options))!r} is unknown; there are none")
        if self._engine is None:
            self._engine = engine_of(self.geometry, [self._terrain], self._compute)
        self._levels = np.full(BLADDER_COUNT, self.actuation.deflated)
        self._grips, self._columns, self._steps = np.ones(2), 0, 0
        if self._ready is None or self._perturbation:
            self._engine.reset()
            if self._perturbation:
                drawn = int(self.np_random.integers(2**31))
                self._engine.set_positions(self.geometry.body.scattered(self._perturbation, drawn, [0]))
            builder, events = self._events()
            steps = self.actuation.initial_steps(highest_pressure(self.pressure))
            events.initialise(steps)
            self._ready = self._engine.run(builder.build(steps, np.array([[steps]]))), self._engine.save()
        found, saved = self._ready
        self._engine.restore(saved)
        self._place = self._start = self._middle(found)
        return self._observation(found, np.zeros(2))

    def _events(self) -> tuple[ProgramBuilder, RobotEvents]:
        """An empty program, and what writes the robot's events into it."""
        builder = ProgramBuilder(1)
        own = self.pressure, self._heading, self._terrain
        return builder, RobotEvents.of(builder, 0, *own, self.actuation, self.geometry)

    def _advance(self, action: Floats) -> tuple[Observation, float, bool, bool]:
        """Play one column."""
        assert self._engine
        bits = (action > 0.5).astype(float)
        (column,), steps = play(GaitSchedule(bits[:, None], repeats=1), self.actuation, levels=self._levels)
        builder, events = self._events()
        if self._columns == 0:
            events.tilt_skin(0)
        events.play_column(column, 0, first=self._columns == 0)
        found = self._engine.run(builder.build(steps, np.array([[steps]])))
        self._levels, self._grips = value_of(column.motion.ends), bits[BLADDER_COUNT:]
        self._columns, self._steps = self._columns + 1, self._steps + int(found.steps[0])
        if str(found.status[0]) != "ok":
            return _LOW, 0.0, False, True
        before, self._place = self._place, self._middle(found)
        ahead, left = self._ahead, np.array([-self._ahead[1], self._ahead[0]])
        moved = (self._place - before)[:2] / self.geometry.body_length
        moved = np.array([moved @ ahead, moved @ left])
        return self._observation(found, moved), float(moved[0]), False, False

    def _middle(self, found: LatticeResult) -> Observation:
        """Middle of the robot, by which distances are measured: the mean of all corners of exposed faces [m]."""
        middle: Observation = read_poses(found, self.geometry, 1)[0][0, 0]
        return middle

    def _observation(self, found: LatticeResult, moved: Observation) -> Observation:
        a, body, places = self.actuation, self.geometry.body, found.positions[0, 0]
        inflation = (self._levels - a.deflated) / (a.inflated - a.deflated)
        height, regions = body.voxels[:, 2], kinds_of(np.asarray(body.regions))
        skin = regions < FIRST_BLADDER
        upper, lower = skin & (height == height[skin].max()), skin & (height == height[skin].min())
        axes = [
            places[last].mean(axis=0) - places[first].mean(axis=0)
            for first, last in ((regions == FOOT_1, regions == FOOT_2), (lower, upper))
        ]
        units = [axis / max(float(np.linalg.norm(axis)), 1e-12) for axis in axes]
        return np.concatenate([inflation, self._grips, *units, moved])

    def _info(self) -> dict[str, Any]:
        distance = float((self._place - self._start)[:2] @ self._ahead)
        played = nominal_steps(self._columns, self.actuation) * self.geometry.time_step if self._columns else np.inf
        return {"distance": distance, "speed": distance / self.geometry.body_length / played, "steps": self._steps}
