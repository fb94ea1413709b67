"""Reflexes: what a lattice robot feels changes how far its muscles swing, while it moves.

Sixteen times in every cycle the robot is read. A network makes of what it feels by how much every muscle shall differ
from its wave a sixteenth of a cycle later, or how oscillators shift its wave; muscles go there in a straight line.
Without weights the robot plays its waves, to the bit. All of it has exact derivatives: by weights, by waves, and
through what was felt.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np

from robots.control.cyclic import SEGMENTS, Cycle
from robots.control.networks import LayeredNetwork
from robots.control.oscillators import reach, waves_shifted
from robots.control.reflexes import Answering, senses_among
from robots.lattice_robot.props import Placed
from robots.world import checked_place
from taichi_sim.autodiff.arrays import trace, value_of
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.ground.relief import planes_below
from taichi_sim.lattice import Decision, Felt, LatticeBody, LatticeProgram, Relief

SENSES = {
    "strain": "mean strain of the links within every driven region",
    "touch": "how much of every driven region is on the ground",
    "tilt": "how far the body leans along x and along y",
    "slip": "how fast every driven region slides over the ground that it touches",
    "velocity": "of the body along x and along y",
    "light": "at every driven region, by the inverse square of the distance to a light",
    "clock": "sine and cosine of the time in the cycle",
}
STILL = 1e-6  # m: a slip far below this has no direction
STRAIN, TOUCH, SPEED = 0.05, 0.1, 1.0  # for a feeling of 1: strain; edges above the ground, for 1/e; lengths per cycle


@dataclass(frozen=True)
class Reflexes(Answering):
    """What a lattice robot feels, and what answers in its muscles; its weights are free.

    Attributes are those of ``Answering``, and:
        senses: names in ``SENSES``.
        gain: of a network, most by which an answer changes a muscle's scale.
        delay: 0 to 15 readings.
        light: place (x, y) of the light, from where the body's centre starts [m]; None is that of the terrain.

    Raises:
        ValueError: for unknown senses, layers without nodes, a light that no sense sees, and a network's coupling.
    """

    senses: Annotated[tuple[str, ...], senses_among(SENSES)] = ("strain", "touch", "tilt", "velocity", "clock")
    delay: Annotated[int, partial(checks.whole_number, low=0, high=SEGMENTS - 1)] = 0
    light: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.light is not None:
            object.__setattr__(self, "light", checked_place("light", self.light))
            if "light" not in self.senses:
                raise ValueError(f"light: {self.light} is not allowed without the sense light; give both, or neither")

    def width(self, regions: int) -> int:
        """How many numbers are felt of a body with so many driven regions."""
        each = {
            "strain": regions,
            "touch": regions,
            "slip": regions,
            "light": regions,
            "tilt": 2,
            "velocity": 2,
            "clock": 2,
        }
        return sum(each[name] for name in self.senses)

    def network(self, regions: int) -> LayeredNetwork:
        """What answers, or modulates oscillators, for a body with so many driven regions."""
        return self.network_of(self.width(regions), regions)

    def weight_count(self, regions: int) -> int:
        """How many weights there are, K."""
        return self.network(regions).weight_count

    def least(self, nodes: Floats, shares: Floats) -> float:
        """Bound below the values that answers can bring muscles to.

        Args:
            nodes: values of their waves, shape (C, 16).
            shares: how far an answer moves each, shape (C,).
        """
        if self.kind == "network":
            return float((nodes.min(axis=1) - self.gain * np.abs(shares)).min())
        return min(float(each.mean()) - (1.0 + self.gain) * reach(each) for each in nodes)

    def check(self, regions: int) -> None:
        """Refuse weights that do not fit a body with so many driven regions, or none to drive.

        Raises:
            ValueError: that tells how many there are, and should be.
        """
        if not regions:
            raise ValueError("reflexes: no drive changes a scale; give a Drive of a region's scale")
        self.check_weights(self.weight_count(regions))


@dataclass(frozen=True, eq=False)
class Feeling:
    """The reflexes of B robots of a batch.

    Attributes:
        reflexes: of all.
        weights: shape (B, K).
        regions: that are driven, R of them, in the order of answers.
        answers: which answer moves each channel, -1 for none, shape (C,).
        shares: how far a network's answer moves each channel, shape (C,).
        lights: where each robot's light is, from where its centre starts [m], shape (B, 2); None is the reflexes'.
        seed: of the noise.
    """

    reflexes: Reflexes
    weights: Floats
    regions: tuple[int, ...]
    answers: Ints
    shares: Floats
    lights: Floats | None = None
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Anatomy:
    """What senses know of the body.

    Attributes:
        members: which voxels are in each driven region, as shares that add up to 1, shape (R, V).
        links: which links are within each, likewise, shape (R, L).
        edge: of a voxel [m].
        length: in which speeds are told [m].
        reliefs: uneven ground below each of B robots, or None.
        origin: mean of the voxel centres before noise, shape (3,).
        lights: see ``Feeling``.
        placed: the robot among props, which it does not feel but by touching them; None without.
    """

    members: Floats
    links: Floats
    edge: float
    length: float
    reliefs: Sequence[Relief] | None
    origin: Floats
    lights: Floats | None = None
    placed: Placed | None = None

    @classmethod
    def of(
        cls,
        body: LatticeBody,
        regions: Sequence[int],
        length: float,
        reliefs: Sequence[Relief] | None,
        lights: Floats | None = None,
    ) -> "Anatomy":
        """The anatomy of a body that is driven in some regions."""
        every, ends = np.asarray(body.regions), body.topology.links
        members = np.array([every == region for region in regions], float)
        within = np.array([(every[ends] == region).all(axis=1) for region in regions], float).reshape(-1, len(ends))
        return cls(
            members / members.sum(axis=1, keepdims=True),
            within / np.maximum(within.sum(axis=1, keepdims=True), 1.0),
            body.voxel_size,
            length,
            reliefs,
            body.start_positions.mean(axis=0),
            lights,
        )

    def clearance(self, positions: Any) -> Any:
        """Height of voxel centres above where they would touch the ground [edges], shape (B, V)."""
        x, y, z = positions[:, :, 0], positions[:, :, 1], positions[:, :, 2]
        if self.reliefs is None:
            return z / self.edge
        height, nz = planes_below(self.reliefs, x, y)
        return (z - height) * nz / self.edge - 0.5 * (1.0 - nz)

    def nearness(self, positions: Any) -> Any:
        """1 where a voxel is on the ground, 1/e at ``TOUCH`` edges above it, shape (B, V)."""
        above = self.clearance(positions)
        return np.exp(-np.where(value_of(above) > 0, above, 0.0 * above) / TOUCH)


def felt_by(reflexes: Reflexes, anatomy: Anatomy, phase: float, per_reading: float, before: Any, now: Any) -> Any:
    """What robots feel, shape (B, width); arrays may be traced.

    Args:
        reflexes: senses.
        anatomy: of the body.
        phase: of the cycle, 0 to 1.
        per_reading: cycles since the reading before.
        before: voxel centres at that reading, shape (B, V, 3).
        now: positions (B, V, 3), orientations (B, V, 4) and strains (B, L).
    """
    positions, orientations, strains = now
    batch, found = len(positions), list[Any]()
    for name in reflexes.senses:
        if name == "strain":
            found.append((strains[:, None, :] * anatomy.links).sum(axis=2) / STRAIN)
        elif name == "touch":
            found.append((anatomy.nearness(positions)[:, None, :] * anatomy.members).sum(axis=2))
        elif name == "slip":
            touching = anatomy.nearness(positions)[:, None, :] * anatomy.members
            gone = [((positions - before)[:, None, :, axis] * touching).sum(axis=2) for axis in (0, 1)]
            away = np.sqrt(gone[0] * gone[0] + gone[1] * gone[1] + STILL * STILL) - STILL
            found.append(away / (anatomy.length * per_reading * SPEED))
        elif name == "tilt":
            w, x, y, z = (orientations[:, :, part].mean(axis=1) for part in range(4))
            found += [(2 * (x * z + w * y))[:, None], (2 * (y * z - w * x))[:, None]]
        elif name == "velocity":
            found.append((positions - before).mean(axis=1)[:, :2] / (anatomy.length * per_reading * SPEED))
        elif name == "light":
            found.append(_light(reflexes, anatomy, positions))
        else:
            angle = 2 * np.pi * phase
            found.append(np.broadcast_to([np.sin(angle), np.cos(angle)], (batch, 2)))
    return np.concatenate(found, axis=1)


def _light(reflexes: Reflexes, anatomy: Anatomy, positions: Any) -> Any:
    """Brightness at the middle of every driven region: 1 at the light, 1/2 a length away from it."""
    places: Floats = np.array([reflexes.light], float) if anatomy.lights is None else anatomy.lights
    total = 0.0
    for axis in (0, 1):
        middle = (positions[:, None, :, axis] * anatomy.members).sum(axis=2)
        total = total + ((middle - (anatomy.origin[axis] + places[:, axis, None])) / anatomy.length) ** 2
    return 1.0 / (1.0 + total)


class ReflexLoop:
    """The reflexes of B robots in a run: decides how their muscles go on, and takes derivatives back.

    Attributes:
        by_weights: derivatives of a cost by the weights, shape (B, K), once all decisions were taken back.
        by_swing: by what waves add to the channels at the nodes of a cycle, shape (B, C, 16).
        readings: what was felt, so far, shape (B, width) each.
    """

    def __init__(
        self, feeling: Feeling, anatomy: Anatomy, cycle: Cycle, rest: Floats, swing: Floats, first: Floats
    ) -> None:
        """Set up.

        Args:
            feeling: of the robots.
            anatomy: of the body.
            cycle: when what happens.
            rest, swing: what channels hold without waves, shape (B, C), and what waves add, shape (B, C, 16).
            first: voxel centres at the start, shape (B, V, 3).
        """
        self.reflexes, self.weights, self.anatomy, self.cycle = feeling.reflexes, feeling.weights, anatomy, cycle
        self.seed = feeling.seed
        self.rest, self.swing, self.first = rest, swing, first
        self.moves = (feeling.answers[None, :] == np.arange(len(feeling.regions))[:, None]).astype(float)  # (R, C)
        self.shares = self.moves * feeling.shares
        self.network = self.reflexes.network(len(feeling.regions))
        self.oscillators = self.reflexes.oscillators_of(self.network)
        self.decisions: Sequence[Decision] = []
        self.keeps = False  # what was felt, for derivatives
        self.begin()

    def plan(self, program: LatticeProgram) -> LatticeProgram:
        """The program with a reading just before each piece of a cycle but the first."""
        cycle, slots = self.cycle, program.snapshots.shape[1]
        batch, channels = self.swing.shape[:2]
        pieces, size = (cycle.cycles + 1) * SEGMENTS, batch * channels
        base = len(program.events) - pieces * size
        steps = [cycle.begin + piece * cycle.segment - 1 for piece in range(1, pieces)]
        self.decisions = [
            Decision(step, slots + number, base + (number + 1) * size + np.arange(size))
            for number, step in enumerate(steps)
        ]
        more = np.tile(np.array(steps, program.snapshots.dtype), (batch, 1))
        return LatticeProgram(program.lengths, program.events, np.concatenate([program.snapshots, more], axis=1))

    def begin(self) -> None:
        """Forget what was felt and decided."""
        self._at, self._before = self.swing[:, :, 1], self.first
        self._state: Sequence[Floats] = self.oscillators.start(len(self.swing)) if self.oscillators else ()
        self.readings = list[Floats]()  # at every reading
        self._given: dict[int, tuple[tuple[Floats, ...], tuple[Floats, ...]]] = {}  # to feel, and to answer
        self._forget()

    def _forget(self) -> None:
        """Begin to take derivatives back."""
        self.by_weights, self.by_swing = np.zeros(self.weights.shape), np.zeros(self.swing.shape)
        self._by_at, self._by_before = np.zeros(self.swing.shape[:2]), np.zeros(self.first.shape)
        self._by_state = list(self.oscillators.start(len(self.swing)) if self.oscillators else ())
        self._by_felt: dict[int, Floats] = {}

    def _feel(self, number: int, before: Any, *now: Any) -> Any:
        """What is felt at a reading, shape (B, width)."""
        phase = ((number + 1) % SEGMENTS) / SEGMENTS
        felt = felt_by(self.reflexes, self.anatomy, phase, 1 / SEGMENTS, before, now)
        if not self.reflexes.noise:
            return felt
        drawn = np.random.default_rng((self.seed, number)).normal(0.0, self.reflexes.noise, felt.shape[1])
        return felt + drawn

    def _answer(self, node: int, weights: Any, swing: Any, at: Any, felt: Any, *state: Any) -> tuple[Any, ...]:
        """Value and rate of the channels, where they go at a node of the cycle, and the oscillators' state there."""
        if self.oscillators is None:
            added = (self.network.answer(weights, felt)[:, :, None] * self.shares).sum(axis=1)
        else:
            state = self.oscillators.step(weights, felt, 1 / SEGMENTS, *state)
            lead, growth = ((each[:, :, None] * self.moves).sum(axis=1) for each in state[:2])
            added = waves_shifted(swing, node, lead, growth)
        onwards = swing[:, :, node] + added
        return self.rest + at, (onwards - at) / self.cycle.segment, onwards, *state

    def decide(self, number: int, felt: Felt) -> tuple[Floats, Floats]:
        """Value and rate of every channel in the next piece of the cycle."""
        if number == 0:
            self.begin()
        now = [np.nan_to_num(each) for each in (felt.positions, felt.orientations, felt.strains)]
        if self.anatomy.placed is not None:
            now = list(self.anatomy.placed.own_part(*now))
        sensed = self._before, *now
        self.readings.append(self._feel(number, *sensed))
        late = number - self.reflexes.delay
        heard = self.readings[late] if late >= 0 else np.zeros(self.readings[0].shape)
        asked = self.weights, self.swing, self._at, heard, *self._state
        if self.keeps:
            self._given[number] = sensed, asked
        values, rates, self._at, *self._state = self._answer(_node(number), *asked)
        self._before = now[0]
        return values.ravel(), rates.ravel()

    def pull_back(self, number: int, values: Floats, rates: Floats) -> Felt:
        """Derivatives by what was felt, from those by the values and rates."""
        if number == len(self.decisions) - 1:
            self._forget()
        shape, (sensed, asked) = self.swing.shape[:2], self._given[number]
        seeds = values.reshape(shape), rates.reshape(shape), self._by_at, *self._by_state
        _, way = trace(partial(self._answer, _node(number)), *asked)
        by_weights, by_swing, self._by_at, by_heard, *self._by_state = way(*seeds)
        self._by_felt[number - self.reflexes.delay] = by_heard  # nobody hears of readings below 0
        self.by_weights += by_weights
        self.by_swing += by_swing
        if number == 0:
            self.by_swing[:, :, 1] += self._by_at
        by_before, felt = self._by_before, [np.zeros(each.shape) for each in sensed[1:]]
        if number in self._by_felt:
            _, way = trace(lambda *arrays: self._feel(number, *arrays), *sensed)
            self._by_before, *felt = way(self._by_felt.pop(number))
        else:
            self._by_before = np.zeros(self.first.shape)
        felt[0] = felt[0] + by_before
        return Felt(*(felt if self.anatomy.placed is None else self.anatomy.placed.widened(*felt)))


def _node(number: int) -> int:
    """The node of the cycle where channels go after a decision."""
    return (number + 2) % SEGMENTS
