"""Lattice robots controlled from outside, a sixteenth of a cycle at a time, as reflexes control them from within."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from robots.control.cyclic import MOMENTS, SEGMENTS
from robots.control.reflexes import senses_among
from robots.control.senses import width_of
from robots.frames import Frames, last_whole
from robots.lattice_robot.measures import Record
from robots.lattice_robot.robot import LatticeRobot
from robots.lattice_robot.rollout import RECORDED, Rollout, frames_from
from robots.lattice_robot.scenes import Scenes, sharing
from robots.lattice_robot.senses import SENSES, Anatomy, LatticeReader, Parts, check_felt
from robots.lattice_robot.simulation import answers_in, channels_of, rollout_of, shares_in, swing_of
from robots.robot import Trial
from robots.world import Terrain
from taichi_sim.base.arrays import Bools, Floats, Ints
from taichi_sim.base.compute import Compute
from taichi_sim.lattice import Felt, LatticeProgram, LatticeResult
from taichi_sim.lattice.program import EVENT


class Episodes:
    """B robots of one kind, side by side in one batch, each in its world; what one does depends on no other.

    Attributes:
        robot: in the first world, with nothing free.
        worlds: W terrains, one of which each robot is in.
        which: the number of the world that each robot is in, shape (B,).
        senses: names of what is felt, see ``robots.lattice_robot.senses``.
        regions: how many muscles an action has a number for, R.
        width: how many numbers are felt.
        steps: actions of an episode.
        own: how many voxels are the robot's, which come first.
        positions: voxel centres after the last action [m], shape (B, V, 3); of a robot that diverged the last whole
            ones.
        seconds: that an action lasts.
        measures: what ``simulate`` tells of robots, by name, shape (B,), after the last action of an episode; NaN of
            robots that diverged. Empty before.
    """

    which: Ints
    positions: Floats
    measures: Mapping[str, Floats]
    _rollout: Rollout

    def __init__(
        self,
        robot: LatticeRobot,
        worlds: Terrain | Sequence[Terrain],
        batch: int,
        senses: Sequence[str],
        compute: Compute,
    ) -> None:
        """Take the robots; the first episode sets up their batch, and starts Taichi.

        Args:
            robot: with reflexes or without; what is free of it is as it starts. Its own reflexes do not act.
            worlds: where all are, or several terrains that can share a batch, see :func:`scenes.sharing`.
            batch: B.
            senses: names in ``SENSES``.
            compute: device, precision and threads.

        Raises:
            ValueError: for senses that are not there, or feel what the robot lacks, robots without muscles to act on,
                and worlds that are too different.
        """
        plain = robot.fixed
        self.worlds = _in_one_batch(plain, [worlds] if isinstance(worlds, Terrain) else worlds)
        lights = [plain.light_in(world) for world in self.worlds]
        self.senses = senses_among(SENSES)("senses", tuple(senses))
        self._lights = None if lights[0] is None else np.array(lights, float)
        self._aimed = plain.target is None
        if plain.reflexes is not None:  # without them it keeps its time steps
            least, most = plain.size_range
            plain = replace(plain, reflexes=None, lowest_size=least, highest_size=most)
        pairs = zip(self.worlds, lights, strict=True)
        self._robots = [
            replace(plain, target=light if self._aimed else plain.target).on(world) for world, light in pairs
        ]
        self.robot = robot = self._robots[0]
        check_felt(self.senses, robot.body, robot.felt_regions)
        if "light" in self.senses and self._lights is None:
            name = self.worlds[0].name
            raise ValueError(f"light: {name} has none to feel; give one, as {name}+light:0.5,0.1")
        channels = channels_of(robot)
        self._swing = np.repeat(swing_of(robot, np.zeros((1, 0))), batch, axis=0)
        self._compute, self._is_ready = compute, False
        self.regions = len(robot.felt_regions)
        self.width = width_of(SENSES, self.senses, Parts.of(robot.body, robot.felt_regions))
        self.steps = (robot.cycle.cycles + 1) * SEGMENTS - 1
        self.seconds = robot.cycle.segment * robot.cycle.time_step
        answers = answers_in(robot, channels)
        self._moves = (answers[None, :] == np.arange(self.regions)[:, None]) * shares_in(robot)
        self._body = robot.placed.robot if robot.placed is not None else robot.body
        self.own = self._body.voxel_count
        self._found: LatticeResult | None = None
        cycle = SEGMENTS * MOMENTS  # parts of it, at the ends of which a simulation records for its measures
        last = cycle * (robot.cycle.cycles + 1)
        self._recorded = (cycle, last, *range(last - cycle, last + 1))
        self._told = [measure.name for measure in robot.measures_in(self.worlds)]

    @property
    def start(self) -> Floats:
        """Where the voxels of each robot were put, shape (B, V, 3) [m]; it has settled when an episode begins."""
        found: Floats = self._rollout.start[:, : self.own]
        return found

    @property
    def lights(self) -> Floats | None:
        """Where each robot's light is, from where its centre starts, shape (B, 2) [m]; None without any."""
        return None if self._lights is None else self._lights[self.which]

    @property
    def next_node(self) -> int:
        """The node of the cycle to which the next action goes."""
        return (self._piece + 2) % SEGMENTS

    def begin(self, seeds: Ints | None = None, which: Ints | None = None) -> Floats:
        """Put all robots where they start, let them settle and play the first piece of the cycle; what they feel.

        Args:
            seeds: of the noise with which each starts, if the robot has any, shape (B,); by default the robot's own.
            which: number of the world in which each is, shape (B,); by default the first.
        """
        places = np.zeros(len(self._swing), np.int64) if which is None else which
        if not self._is_ready or self.robot.perturbation or not np.array_equal(places, self.which):
            self._set_up(seeds, places)
        cycle, self._piece = self.robot.cycle, 0
        self._rollout.engine.restore(self._fresh)
        self.positions, self.measures = self._rollout.start, {}
        self._noted = dict[int, tuple[Floats, ...]]()
        self._found = None
        self._at = self._swing[:, :, 1]
        length = cycle.begin + cycle.segment
        events = self._rollout.program.events
        return self._run(length, events[events["step"] < length])[0]

    def _set_up(self, seeds: Ints | None, which: Ints) -> None:
        """Make the batch; worlds and noise decide on more than where robots start, so others need another."""
        self.which = which.copy()
        robots = [self._robots[number] for number in which]
        if seeds is not None and self.robot.perturbation:
            robots = [replace(robot, seed=seed) for robot, seed in zip(robots, seeds.tolist(), strict=True)]
        terrains = tuple(self.worlds[number] for number in which)
        scenes = Scenes(tuple(robots), terrains, self.lights, self.lights is not None and self._aimed)
        points, trial = np.zeros((len(which), 0)), Trial(terrains[0], self._compute)
        self._rollout = rollout_of(scenes, points, self._swing, trial)
        length, floor = self.robot.length, self._rollout.floor
        anatomy = Anatomy.of(self._body, self.robot.felt_regions, length, floor, self.lights, placed=self.robot.placed)
        self._reader = LatticeReader(self.senses, anatomy, self.start, keeps=False)
        self._rest = np.broadcast_to(np.asarray(self._rollout.channels.rest, float), self._swing.shape[:2])
        self._fresh, self._is_ready = self._rollout.engine.save(), True

    def advance(self, actions: Floats) -> tuple[Floats, Floats, Bools]:
        """Play the next piece.

        Args:
            actions: by how much the scale of each muscle shall differ from its wave at the end of it, along its first
                axis where it has proportions, shape (B, R).

        Returns:
            What is felt, shape (B, width); how far the middle of each robot went along its heading [body lengths],
            shape (B,); and which diverged.
        """
        self._piece += 1
        segment, (batch, count) = self.robot.cycle.segment, self._swing.shape[:2]
        onwards = self._swing[:, :, (self._piece + 1) % SEGMENTS] + actions @ self._moves
        events = np.zeros((batch, count), EVENT)
        events["robot"], events["region"] = np.arange(batch)[:, None], self._rollout.channels.regions
        events["quantity"], events["value"] = self._rollout.channels.quantities, self._rest + self._at
        events["rate"] = (onwards - self._at) / segment
        self._at = onwards
        return self._run(segment, events.ravel())

    @property
    def velocity(self) -> Floats:
        """Velocity of the middle of each robot [m/s], shape (B, 3); 0 for one that diverged."""
        found: Floats = np.nan_to_num(self._rollout.engine.state().velocities[:, : self.own].mean(axis=1))
        return found

    def _note(self, found: LatticeResult) -> None:
        """Keep where a piece has ended and the parts of it, if measures need it, and tell them after the last one."""
        end, steps = (self._piece + 1) * MOMENTS, self.robot.cycle.segment
        for snapshot, part in enumerate((end, *range(end - MOMENTS + 1, end)), start=1):
            if part not in self._recorded or snapshot >= found.positions.shape[1]:
                continue
            if part < end and part % MOMENTS * steps < MOMENTS:  # no step after the begin of the piece
                self._noted[part] = self._noted[end - MOMENTS]
            else:
                kept = found.positions, found.strains, found.sizes
                self._noted[part] = tuple(each[:, snapshot].copy() for each in kept)
        if end == self._recorded[-1]:
            moments = [self._noted[part] for part in self._recorded]
            record = Record(*(np.stack([moment[number] for moment in moments], axis=1) for number in range(3)))
            measures = self._rollout.measured(record, found.status != "ok")
            self.measures = {name: measures[name] for name in self._told}

    def frames(self, robot: int) -> Frames:
        """Where a robot is after the last action, or was last when its numbers were finite; a batch of one."""
        assert self._found is not None
        times = np.array([(self._piece + 1) * self.seconds])
        return frames_from(self.robot.body, self._found, robot, 1, times)

    def _run(self, length: int, events: Any) -> tuple[Floats, Floats, Bools]:
        batch, segment = len(self._swing), self.robot.cycle.segment
        in_last = (self._piece + 1) * MOMENTS > self._recorded[2]
        parts = [length - segment + part * segment // MOMENTS for part in range(1, MOMENTS)] if in_last else []
        shots = np.tile([length - 1, length, *parts], (batch, 1))
        run = self._rollout.engine.run(LatticeProgram(np.full(batch, length), events, shots))
        found, failed = replace(run, **{name: getattr(run, name)[:, :2] for name in RECORDED}), run.status != "ok"
        self._found = found if self._found is None else last_whole(self._found, found)
        now = {name: getattr(found, name)[:, 0].astype(float) for name in ("positions", "orientations", "strains")}
        felt = self._reader.read(self._piece, Felt(**now))
        gone = self._reader.moved.mean(axis=1) @ self.robot.direction / self.robot.length
        place = found.positions[:, 1].copy()
        place[failed] = self.positions[failed]
        self.positions = place
        self._note(run)
        return felt, np.where(failed, 0.0, gone), failed


def _in_one_batch(robot: LatticeRobot, worlds: Sequence[Terrain]) -> tuple[Terrain, ...]:
    """Worlds that robots of one batch can be in.

    Raises:
        ValueError: for none, and those that cannot share one.
    """
    if not worlds:
        raise ValueError("world: none is not allowed; give at least one")
    alike, *others = sharing([robot] * len(worlds), worlds)
    if others:
        first, other = worlds[alike[0]].name, worlds[others[0][0]].name
        told = (
            "all or none with a light, with water, with ground that yields, and with the same props and friction there"
        )
        raise ValueError(f"world: {other} is not allowed beside {first}; give worlds that are {told}")
    return tuple(worlds)
