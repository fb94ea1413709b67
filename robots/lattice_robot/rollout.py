"""A batch of lattice bodies that repeat a cycle: what they do, and how that depends on the cycle and the materials."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from robots.control.cyclic import (
    FRAMES_FROM,
    SEGMENTS,
    Cycle,
    build_cyclic_program,
    cycle_events,
    surroundings,
    without_rounding,
)
from robots.frames import Frames
from robots.lattice_robot.held import held_up
from robots.lattice_robot.measures import Constants, Record, measure
from robots.lattice_robot.props import Placed
from robots.lattice_robot.reflexes import Feeling, ReflexLoop
from robots.lattice_robot.senses import Anatomy
from robots.lattice_robot.soft_motion import law_of
from robots.own_measures import OwnMeasure
from robots.robot import Progress
from robots.world import Medium, Terrain, medium_of, one_each, standing
from taichi_sim.autodiff.arrays import trace
from taichi_sim.base.arrays import Bools, Floats, Ints
from taichi_sim.base.compute import Compute
from taichi_sim.lattice import LatticeBody, LatticeEngine, LatticeResult, Quantity, Relief
from taichi_sim.lattice.faces import half_extents
from taichi_sim.lattice.gradient import Tape
from taichi_sim.lattice.material_gradient import add_to_columns

RECORDED = ("positions", "orientations", "strains", "sizes")
_ALIKE = {"speed": "distance"}  # measures that take the way back of another one
RECORDING = 0.3  # part of a differentiation's time that goes before the way back


def ahead(heading: float) -> Floats:
    """Direction of a heading [degrees] from x towards y, shape (3,)."""
    angle = np.deg2rad(heading)
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def turned(place: tuple[float, float], heading: float) -> tuple[float, float]:
    """A place ahead and to the left [m] of a robot that heads somewhere [degrees], as (x, y) [m]."""
    (along, across), (x, y, _) = place, ahead(heading).tolist()
    return along * x - across * y, along * y + across * x


def footprint_of(body: LatticeBody, direction: Floats) -> tuple[float, float]:
    """Rear and front of a body along a direction, shape (3,), at its start [m]."""
    along, half = body.start_positions @ direction, body.voxel_size / 2
    return float(along.min()) - half, float(along.max()) + half


@dataclass(frozen=True, eq=False)
class Aim:
    """What a robot's motion is measured by.

    Attributes:
        heading: direction of travel [degrees] from x towards y.
        length: in which speeds are told [m].
        target: point (x, y) [m] that it should come near, from where its centre of mass starts, or that of each robot
            of a batch, shape (B, 2); None for none.
        placed: the robot among props, of which its motion is measured; None without.
        is_light: whether the target is a light, which lies from where the middle of the voxels starts.
        own_measures: of the user.
    """

    heading: float
    length: float
    target: tuple[float, float] | Floats | None = None
    placed: Placed | None = None
    is_light: bool = False
    own_measures: tuple[OwnMeasure, ...] = ()

    @property
    def direction(self) -> Floats:
        """Direction of travel, shape (3,)."""
        return ahead(self.heading)


@dataclass(frozen=True, eq=False)
class Channels:
    """The C channels that a cycle drives, see ``taichi_sim.lattice.program``.

    Attributes:
        regions: of each channel, shape (C,).
        quantities: of each channel, shape (C,).
        rest: their values before anything moves, broadcast to shape (B, C).
        feeling: reflexes of the robots that change the cycle, or None.
    """

    regions: ArrayLike
    quantities: ArrayLike
    rest: ArrayLike
    feeling: Feeling | None = None

    def driven(self, regions: Ints, expansions: Floats) -> Floats:
        """Which voxels are driven, 1 or 0, shape (B, V); by a temperature those alone whose material expands.

        Args:
            regions: of the voxels, shape (V,).
            expansions: thermal expansion of each voxel [1/K], shape (B, V).
        """
        heated = np.asarray(self.quantities) == Quantity.TEMPERATURE
        warm, others = (np.isin(regions, np.asarray(self.regions)[which]) for which in (heated, ~heated))
        return ((warm & (expansions != 0)) | others).astype(float)


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of one measure of each of B robots; NaN for robots that diverged.

    Attributes:
        swing: by what the cycle adds to the channels at its nodes, shape (B, C, 16).
        materials: by the numbers of the materials, name to shape (B, M).
        weights: by those of reflexes, shape (B, K), K 0 without.
        driven: by how much of each voxel is driven, shape (B, V).
    """

    swing: Floats
    materials: Mapping[str, Floats]
    driven: Floats
    weights: Floats

    def over(self, number: float) -> "Slopes":
        """The derivatives of the measure over a number."""
        materials = {name: found / number for name, found in self.materials.items()}
        return Slopes(self.swing / number, materials, self.driven / number, self.weights / number)


class Rollout:
    """Bodies with the same voxels, each on its terrain, ready to move.

    Attributes:
        bodies: one for each robot.
        cycle: when what happens.
        channels: that the cycle drives.
        engine: that moves them, where they start.
        program: that it is given.
        start: voxel centres at the start [m], shape (B, V, 3).
        floor: whether there is level ground, or the uneven ground below each.
        reliefs: that uneven ground, or None.
    """

    def __init__(
        self,
        bodies: Sequence[LatticeBody],
        channels: Channels,
        swing: Floats,
        cycle: Cycle,
        terrain: Terrain | Sequence[Terrain],
        aim: Aim,
        compute: Compute,
        record_every: int | None = None,
        starts: Floats | None = None,
        driven: Floats | None = None,
    ) -> None:
        """Write the program and set up the engine.

        Args:
            bodies: B of them; they may differ in the values of their materials only.
            channels: that the cycle drives.
            swing: what the cycle adds to them at its nodes, shape (B, C, 16).
            cycle: when what happens.
            terrain: where all are, or each; with the same around all of them.
            aim: what the motion is measured by.
            compute: device, precision and threads.
            record_every: steps between frames; None for none.
            starts: voxel centres at the start [m], shape (B, V, 3); those of the bodies by default.
            driven: how much of each voxel is driven, 0 to 1, shape (B, V); by default as the channels say.
        """
        self.bodies, self.cycle, self._aim, self.channels = tuple(bodies), cycle, aim, channels
        self._swing, self._record_every = swing, record_every
        first = self.bodies[0]
        terrains = one_each(terrain, len(self.bodies))
        around = without_rounding(surroundings(terrains, aim.heading))
        pulls = [np.broadcast_to(around[Quantity.ACCELERATION + axis], len(self.bodies)) for axis in range(3)]
        self._pulled = np.stack(pulls, axis=1) != 0
        self.program = build_cyclic_program(
            channels.regions,
            channels.quantities,
            channels.rest,
            swing,
            cycle,
            around,
            first.region_count,
            record_every,
        )
        same = all(body is first for body in self.bodies)
        self._snapshots = self.program.snapshots.shape[1]
        medium = medium_of(terrains, [aim.heading] * len(self.bodies), first.voxel_size)
        self.engine = LatticeEngine(
            first if same else self.bodies,
            len(self.bodies),
            time_step=cycle.time_step,
            **medium,
            compute=compute,
        )
        level = np.tile(first.start_positions, (len(self.bodies), 1, 1)) if starts is None else starts
        self.floor: bool | Sequence[Relief] = medium["floor"]
        self.reliefs = None if isinstance(self.floor, bool) else self.floor
        self.start = self._standing(level, medium)
        if starts is not None or self.reliefs is not None:
            self.engine.set_positions(self.start)
        raised = 0.0 if self.reliefs is None else self.start[:, :, 2] - level[:, :, 2]
        self.program = replace(self.program, events=np.concatenate([*self._held(raised), self.program.events]))
        self._loop = None if channels.feeling is None else self._reflex_loop(channels.feeling)
        if self._loop is not None:
            self.program = self._loop.plan(self.program)
        self._constants = self._constants_of(driven, raised)

    def _standing(self, level: Floats, medium: Medium) -> Floats:
        """Voxel centres at the start [m] on the robots' ground, by those on level ground, shape (B, V, 3) each."""
        placed = self._aim.placed
        if placed is None or self.reliefs is None:
            return standing(level, medium, self.bodies[0].voxel_size)
        return np.array([placed.standing(each, relief) for each, relief in zip(level, self.reliefs, strict=True)])

    def _held(self, raised: Floats | float) -> list[Any]:
        """Events that hold what the world holds where it starts, voxels so much higher than on level ground [m]."""
        placed, robot = self._aim.placed, self.bodies[0] if self._aim.placed is None else self._aim.placed.robot
        up = [held_up(robot, raised[:, 0])] if isinstance(raised, np.ndarray) else []
        return up if placed is None else [placed.holding(self.start), *up]

    def _reflex_loop(self, feeling: Feeling) -> ReflexLoop:
        """The loop that reads the senses and changes the cycle by what the reflexes answer."""
        aim, swing = self._aim, self._swing
        robot = self.bodies[0] if aim.placed is None else aim.placed.robot
        anatomy = Anatomy.of(robot, feeling.regions, aim.length, self.floor, feeling.lights, aim.placed)
        rest = np.broadcast_to(np.asarray(self.channels.rest, float), swing.shape[:2])
        return ReflexLoop(feeling, anatomy, self.cycle, rest, swing, self.start[:, : robot.voxel_count])

    def _constants_of(self, driven: Floats | None, raised: Floats | float) -> Constants:
        """What measures know of the robots, of which the ground raises voxels where they start [m], shape (B, V)."""
        first, aim, cycle = self.bodies[0], self._aim, self.cycle
        moduli, densities, expansions, ratios = (
            # Rows in memory as in a batch of one, for sums of the same bits.
            np.ascontiguousarray(
                np.array([[getattr(m, field) for m in body.materials] for body in self.bodies])[:, first.material_index]
            )
            for field in ("youngs_modulus", "density", "thermal_expansion", "poissons_ratio")
        )
        if driven is None:
            driven = self.channels.driven(np.asarray(first.regions), expansions)
        driven = np.ascontiguousarray(driven)
        moments = cycle.time_step * cycle.moments.astype(float)
        about = aim.direction, aim.length, cycle.duration, cycle.frequency, moments
        laws = {each.name: law_of(each) for each in aim.own_measures}
        seen = aim.target, aim.placed, raised, aim.is_light
        return Constants(densities, moduli, driven, first, *about, *seen, ratios, self._pulled, laws)

    def run(self, progress: Progress | None = None) -> "Moved":
        """Let the robots move."""
        return self._moved(self.engine.run(self.program, progress, self._loop), {})

    @property
    def felt(self) -> Floats:
        """What the reflexes felt at every reading of the run, shape (B, S, T); S is 0 without reflexes."""
        readings = [] if self._loop is None else self._loop.readings
        return np.stack(readings, axis=-1) if readings else np.zeros((len(self.bodies), 0, 0))

    def differentiate(
        self,
        names: Sequence[str],
        memory: float = 1e9,
        progress: Progress | None = None,
        horizon: float | None = None,
    ) -> "Moved":
        """Let the robots move, with the derivatives of some measures.

        Args:
            names: of the measures.
            memory: bound for what is kept of the way there [B].
            progress: called now and then with the fraction done.
            horizon: of the derivatives [s], None for exact ones; see :mod:`taichi_sim.lattice.fading`.
        """
        told = progress or (lambda _: None)
        if self._loop:
            self._loop.reader.keeps = True
        tape = self.engine.record(self.program, memory, lambda f: told(RECORDING * f), self._loop)
        ways = list(dict.fromkeys(_ALIKE.get(name, name) for name in names))
        share = (1 - RECORDING) / len(ways)
        found = {}
        for number, name in enumerate(ways):
            done = RECORDING + number * share
            found[name] = self._back(tape, name, horizon, lambda f, done=done: told(done + share * f))  # type: ignore[misc]
        if "speed" in names:
            found["speed"] = found["distance"].over(self._constants.length * self._constants.duration)
        return self._moved(tape.result, {name: found[name] for name in names})

    def _back(self, tape: Tape, name: str, horizon: float | None, progress: Progress) -> Slopes:
        """Derivatives of one measure."""
        ok = tape.result.status == "ok"
        fields = [np.where(np.isfinite(each), each, 0.0) for each in Record.of(tape.result).arrays]
        _, pull = trace(self._measured(name), *fields, *self._constants.materials)
        with np.errstate(all="ignore"):  # of robots of which a user's own measure has no derivative
            parts = pull(ok.astype(float))
        ok = ok & np.all([np.isfinite(part).reshape(len(ok), -1).all(axis=1) for part in parts], axis=0)
        *seeds, density, modulus, ratio, driven = (
            np.where(ok.reshape(-1, *[1] * (part.ndim - 1)), part, 0.0) for part in parts
        )
        zeros = [np.zeros(each.shape) for each in (tape.result.positions, tape.result.strains, tape.result.sizes)]
        for cotangents, seed in zip(zeros, seeds, strict=True):
            cotangents[:, : seed.shape[1]] = seed
        positions, strains, sizes = zeros
        back = tape.pull_back(positions, strains=strains, sizes=sizes, progress=progress, horizon=horizon)
        (values, _), pull_back = trace(lambda swing: cycle_events(self.cycle, self.channels.rest, swing), self._swing)
        by_events = [each[-values.size :].reshape(values.shape).copy() for each in (back.values, back.rates)]
        weights: Floats = np.zeros((len(self.bodies), 0))
        if self._loop:  # which has decided the events of all pieces but the first
            for each in by_events:
                each[len(values) - (self.cycle.cycles + 1) * SEGMENTS + 1 :] = 0.0
            weights = self._loop.by_weights.copy()
        swing = pull_back(*by_events)[0]
        if self._loop:
            swing = swing + self._loop.by_swing
        materials = {field: np.array(found) for field, found in back.materials.items()}
        for field, direct in (("density", density), ("youngs_modulus", modulus), ("poissons_ratio", ratio)):
            add_to_columns(materials[field], self.bodies[0].material_index, direct)
        for found in (swing, driven, weights, *materials.values()):
            found[~ok] = np.nan
        return Slopes(swing, materials, driven, weights)

    def _measured(self, name: str) -> Callable[..., Any]:
        """The measure as a function of arrays, which may be traced."""

        def found(*arrays: Any) -> Any:
            names = "density", "modulus", "poissons_ratio", "driven"
            known = replace(self._constants, **dict(zip(names, arrays[3:], strict=True)))
            return measure(name, Record(*arrays[:3]), known)

        return found

    def measured(self, record: Record, lost: Bools) -> dict[str, Floats]:
        """The measures of robots that moved so, by name, shape (B,); NaN of those that are lost."""
        measures = {name: measure(name, record, self._constants) for name in self._constants.names}
        for values in measures.values():
            values[lost] = np.nan
        return measures

    def _moved(self, run: LatticeResult, slopes: Mapping[str, Slopes]) -> "Moved":
        kept = {name: getattr(run, name)[:, : self._snapshots] for name in RECORDED}
        run = replace(run, **kept)
        measures = self.measured(Record.of(run), run.status != "ok")
        unknown = (run.status == "ok") & ~np.isfinite(list(measures.values())).all(axis=0)  # a user's own measure
        for values in measures.values():
            values[unknown] = np.nan
        run = replace(run, status=np.where(unknown, "diverged", run.status))
        frames: tuple[Frames | None, ...] = (None,) * len(self.bodies)
        if self._record_every:
            interval = self._record_every * self.cycle.time_step
            times = np.arange(run.positions.shape[1] - FRAMES_FROM) * interval
            frames = tuple(frames_from(body, run, row, FRAMES_FROM, times) for row, body in enumerate(self.bodies))
        return Moved(measures, run.status, run.steps, frames, slopes)


@dataclass(frozen=True, eq=False)
class Moved:
    """What B robots did.

    Attributes:
        measures: by name, shape (B,) each; NaN unless the status is "ok".
        status: "ok" or "diverged", shape (B,).
        steps: time steps simulated, shape (B,).
        frames: recorded poses of each, times from the start of the cycles; None where not asked for.
        slopes: derivatives of the measures that were asked for, by name.
    """

    measures: Mapping[str, Floats]
    status: Any
    steps: Any
    frames: tuple[Frames | None, ...]
    slopes: Mapping[str, Slopes]


def frames_from(body: LatticeBody, run: LatticeResult, robot: int, first: int, times: Floats) -> Frames:
    """The snapshots of one robot of a batch from number ``first`` on, at times [s], as the frames of a batch of one."""
    positions, orientations, strains, sizes = (
        each[robot, first:, None] for each in (run.positions, run.orientations, run.strains, run.sizes)
    )
    return Frames(positions, orientations, times, half_extents(body, strains, sizes), sizes)
