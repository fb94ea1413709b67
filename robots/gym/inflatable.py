"""The inflatable shape-changing robot as an environment, one or a batch: each step plays one column of a gait.

Source: Powers 2021 dissertation, ch. 5; a sequence of actions does what a schedule of these columns does, bit for bit.
"""

from typing import TYPE_CHECKING, Any, Literal, Unpack

import gymnasium
import numpy as np

from robots.frames import frames_of, last_whole
from robots.gym.batch import SEEDS, Batch, Observation
from robots.gym.environment import RobotEnvironment, RobotVector, compute_of
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
from robots.inflatable.design import InflatableDesign, Pressure, checked_pressure, each_pressure, highest_pressure
from robots.inflatable.layout import check_every_bladder
from robots.inflatable.program import RobotEvents
from robots.inflatable.schedule import ROWS, GaitSchedule
from robots.inflatable.simulation import engine_of, read_poses, travel_directions
from robots.inflatable.timing import nominal_steps, play
from robots.world import Terrain
from taichi_sim.autodiff.arrays import value_of
from taichi_sim.base.arrays import Bools, Floats, Ints
from taichi_sim.base.checks import choice, number
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.lattice import LatticeEngine, LatticeResult, ProgramBuilder
from taichi_sim.lattice.engine import SavedLattice
from taichi_sim.lattice.faces import half_extents

if TYPE_CHECKING:
    from robots.view.motion import Motion

Actions = Literal["bits", "continuous"]

FARTHEST = 100.0  # bodies' lengths in a step: displacements are cut off there
_LOW = np.array([0.0] * ROWS + [-1.0] * 6 + [-FARTHEST] * 2)
_HIGH = np.array([1.0] * (ROWS + 6) + [FARTHEST] * 2)


class Pancakes(Batch):
    """Inflatable robots of one design side by side; columns of each last as long as its own bladders need."""

    def __init__(
        self,
        count: int,
        pressure: Pressure,
        orientation: float,
        slope: float,
        actions: Actions,
        geometry: InflatableGeometry | str,
        actuation: InflatableActuation,
        perturbation: float,
        compute: Compute,
    ) -> None:
        """Take what a ``PancakeEnvironment`` takes."""
        if isinstance(geometry, str):
            geometry = NAMED_GEOMETRIES[choice("geometry", geometry, NAMED_GEOMETRIES)]
        check_every_bladder(geometry.bladders, "in this environment, whose actions fill eight")
        spaces = {
            "bits": gymnasium.spaces.MultiBinary(ROWS),
            "continuous": gymnasium.spaces.Box(0.0, 1.0, (ROWS,), np.float64),
        }
        acted = spaces[choice("actions", actions, spaces)]
        self._pressure = checked_pressure(pressure)
        each_pressure(self._pressure, geometry)
        self._heading = number("orientation", orientation, 0.0, 90.0, "degrees")
        self._ahead = travel_directions(np.array([self._heading]))[0]
        self._terrain = Terrain(slope)
        self._geometry, self._actuation = geometry, actuation.on(self._terrain)
        self._perturbation = number("perturbation", perturbation, 0.0, geometry.voxel_size, "m")
        self.choices = SEEDS if self._perturbation else 0
        self._compute = compute
        self._engine: LatticeEngine | None = None
        self._ready: tuple[LatticeResult, SavedLattice] | None = None
        observed = gymnasium.spaces.Box(_LOW, _HIGH, dtype=np.float64)
        super().__init__(count, observed, acted, nominal_steps(1, self._actuation) * geometry.time_step)

    def begin(self, which: Ints, ways: Ints) -> Observation:
        """The first episode initialises all robots, later ones restore that state; with noise each initialises."""
        assert len(which) == self.count
        if self._engine is None:
            self._engine = engine_of(self._geometry, [self._terrain] * self.count, self._actuation, self._compute)
        if self._ready is None or self._perturbation:
            self._engine.reset()
            if self._perturbation:
                body = self._geometry.body
                starts = [body.scattered(self._perturbation, seed, [0])[0] for seed in ways.tolist()]
                self._engine.set_positions(np.array(starts))
            builder, steps = ProgramBuilder(self.count), self._actuation.initial_steps(highest_pressure(self._pressure))
            self._events(builder, np.arange(self.count)).initialise(steps)
            program = builder.build(steps, np.full((self.count, 1), steps))
            self._ready = self._engine.run(program), self._engine.save()
        self._seen, saved = self._ready
        self._engine.restore(saved)
        self._levels = np.full((self.count, BLADDER_COUNT), self._actuation.deflated)
        self._grips, self._steps = np.ones((self.count, 2)), np.zeros(self.count, np.int64)
        self._columns: list[Floats] = []
        self._place = self._start = self._middles(self._seen)
        return self._observation(self._seen, np.zeros((self.count, 2)))

    def _events(self, builder: ProgramBuilder, robots: Any) -> RobotEvents:
        """What writes the events of a robot, or of several, into a program."""
        own = self._pressure, self._heading, self._terrain
        return RobotEvents.of(builder, robots, *own, self._actuation, self._geometry)

    def advance(self, actions: Floats) -> tuple[Observation, Floats, Bools, Bools]:
        """Play one column."""
        assert self._engine
        bits, builder = (actions > 0.5).astype(float), ProgramBuilder(self.count)
        lengths, levels, first = np.zeros(self.count, np.int64), self._levels.copy(), not self._columns
        for robot, own in enumerate(bits):
            gait = GaitSchedule(own[:, None], repeats=1)
            (column,), lengths[robot] = play(gait, self._actuation, levels=self._levels[robot])
            events = self._events(builder, robot)
            if first:
                events.tilt_skin(0)
            events.play_column(column, 0, first=first)
            levels[robot] = value_of(column.motion.ends)
        found = self._engine.run(builder.build(lengths, lengths[:, None]))
        failed = found.status != "ok"
        self._levels, self._grips = levels, bits[:, BLADDER_COUNT:]
        self._columns.append(bits)
        self._steps = self._steps + found.steps
        self._seen = last_whole(self._seen, found)
        before, self._place = self._place, self._middles(self._seen)
        (x, y), (ahead, aside) = (self._place - before)[:, :2].T / self._geometry.body_length, self._ahead
        moved = np.stack([x * ahead + y * aside, y * ahead - x * aside], axis=1)
        return self._observation(self._seen, moved), moved[:, 0], np.zeros(self.count, bool), failed

    def _middles(self, found: LatticeResult) -> Floats:
        """Middles of the robots, by which distances are measured: the means of all corners of exposed faces [m]."""
        middles: Floats = read_poses(found, self._geometry, 1)[0][:, 0]
        return middles

    def _observation(self, found: LatticeResult, moved: Floats) -> Observation:
        a, body = self._actuation, self._geometry.body
        inflation = (self._levels - a.deflated) / (a.inflated - a.deflated)
        height, regions = body.voxels[:, 2], kinds_of(np.asarray(body.regions))
        skin = regions < FIRST_BLADDER
        upper, lower = skin & (height == height[skin].max()), skin & (height == height[skin].min())
        pairs, units = ((regions == FOOT_1, regions == FOOT_2), (lower, upper)), []
        for places in found.positions[:, 0]:  # one by one, so that sums have the same bits in every batch
            axes = [places[last].mean(axis=0) - places[first].mean(axis=0) for first, last in pairs]
            units.append(np.concatenate([axis / max(float(np.linalg.norm(axis)), 1e-12) for axis in axes]))
        return np.concatenate([inflation, self._grips, units, moved], axis=1)

    def info(self) -> dict[str, Any]:
        """Distances since the start, speeds and time steps."""
        (x, y), (ahead, aside) = (self._place - self._start)[:, :2].T, self._ahead
        distance, played = x * ahead + y * aside, np.inf
        if self._columns:
            played = nominal_steps(len(self._columns), self._actuation) * self._geometry.time_step
        return {"distance": distance, "speed": distance / self._geometry.body_length / played, "steps": self._steps}

    def motion(self, robot: int) -> "Motion":
        """A robot, whose bladders and feet show the column that it has just played."""
        from robots.inflatable.view.motion import Recording, inflatable_motion

        body, run = self._geometry.body, self._seen
        times = self._steps[robot, None] * self._geometry.time_step
        frames = frames_of(run, half_extents(body, run.strains, run.sizes), 0, times)
        played = [column[robot] for column in self._columns] or [np.zeros(ROWS)]
        design = InflatableDesign(self._pressure, self._heading, GaitSchedule(np.stack(played, axis=1), repeats=1))
        shown = Recording(frames, body, self._geometry.time_step)
        return inflatable_motion(shown, design, self._terrain, actuation=self._actuation, robot=robot)


class PancakeEnvironment(RobotEnvironment):
    """Gymnasium environment in which the inflatable robot rolls or inches, one column of a gait at a time.

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
        actions: Actions = "bits",
        geometry: InflatableGeometry | str = "published",
        actuation: InflatableActuation = ACTUATION,
        perturbation: float = 0.0,
        render_mode: str | None = None,
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
            render_mode: ``"rgb_array"`` for pictures, or None.
            compute: ``precision`` (``"f32"`` by default, as in searches), ``device`` and ``threads``, see
                ``robots.inflatable.simulate``.

        Raises:
            ValueError: for values that are not allowed.
        """
        chosen = compute_of(type(self), compute)
        own = pressure, orientation, slope, actions, geometry, actuation, perturbation
        super().__init__(Pancakes(1, *own, chosen), render_mode)


class PancakeVector(RobotVector):
    """Vector environment of inflatable robots in one batch, each of which plays a column in every step."""

    def __init__(
        self,
        num_envs: int = 1,
        pressure: Pressure = 0.0,
        orientation: float = 90.0,
        slope: float = 0.0,
        actions: Actions = "bits",
        geometry: InflatableGeometry | str = "published",
        actuation: InflatableActuation = ACTUATION,
        perturbation: float = 0.0,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        **compute: Unpack[ComputeOptions],
    ) -> None:
        """Take the number of robots, and what a ``PancakeEnvironment`` takes."""
        chosen = compute_of(type(self), compute)
        own = pressure, orientation, slope, actions, geometry, actuation, perturbation
        super().__init__(Pancakes(num_envs, *own, chosen), max_episode_steps, render_mode)
