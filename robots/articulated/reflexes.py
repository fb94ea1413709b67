"""Reflexes of articulated robots: what they feel changes the commands of their rhythms, while they move.

Whenever a command is due the robot is read. A network makes of what it feels by how much every drive's command differs
from its rhythm, or how oscillators shift the rhythm. Without weights the rhythm plays, to the bit. All of it has exact
derivatives, but for the sense of touch, which is a step.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Self

import numpy as np

from robots.articulated.senses import SENSES, Anatomy, DriveReader
from robots.control.networks import LayeredNetwork
from robots.control.reflex_loop import AnsweringLoop
from robots.control.reflexes import Answering, senses_among
from robots.control.senses import width_of
from taichi_sim.autodiff.arrays import value_of
from taichi_sim.base.arrays import Floats
from taichi_sim.base.options import value_of as number_in
from taichi_sim.rigid.feedback import Felt

PARTS = ("amplitude", "phase", "offset")  # of a drive's rhythm


@dataclass(frozen=True)
class DriveReflexes(Answering):
    """Reflexes of an articulated robot: its senses, and a network, with free weights, that changes its commands.

    Attributes are those of ``Answering``, and:
        senses: names in ``SENSES`` of ``robots.articulated.senses``.
        gain: largest change of a command by a network; commands stay from -1 to 1.
        delay: delay from a reading to its answer [commands].
        noise: noise of the readings, drawn from the robot's seed, and the same for all robots of a batch.

    Example:
        >>> DriveReflexes.parse("tilt,clock+hidden:8,4+gain:0.3").hidden
        (8, 4)
    """

    senses: Annotated[tuple[str, ...], senses_among(SENSES)] = ("angles", "tilt", "velocity", "clock")

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse reflexes: senses, then what differs from the defaults, as in ``touch,tilt+hidden:8+gain:0.3``.

        Raises:
            ValueError: for anything else.
        """
        senses, *rest = text.split("+")
        given: dict[str, Any] = {}
        for each in rest:
            name, _, value = each.partition(":")
            if name == "oscillators" and not value:
                given["kind"] = name
            elif name == "hidden":
                given[name] = tuple(number_in(part) for part in value.split(","))
            elif name in ("gain", "limit", "noise", "delay", "coupling"):
                given[name] = number_in(value)
            else:
                allowed = "give oscillators, hidden:8, gain:0.3, limit, noise, delay or coupling"
                raise ValueError(f"reflexes: {each!r} is not allowed; {allowed}")
        return cls(tuple(senses.split(",")), **given)


@dataclass(frozen=True, eq=False)
class Rhythms:
    """What B robots do without reflexes.

    Attributes:
        points: frequency, then amplitude, phase and offset of each drive, (B, 1 + 3 M).
        commands: over time, (B, K, M).
        span: time that each command is kept [s].
    """

    points: Floats
    commands: Floats
    span: float


def network_of(reflexes: DriveReflexes, anatomy: Anatomy) -> LayeredNetwork:
    """The network of some reflexes that answers for a robot's drives.

    Raises:
        ValueError: for senses without sensors, and weights that are not as many.
    """
    for name in reflexes.senses:
        if not SENSES[name].width(anatomy):
            where = {"light": "a light"}.get(name, "some in the model")
            raise ValueError(f"senses: {name} is not allowed without sensors of it; give {where}")
    network = reflexes.network_of(width_of(SENSES, reflexes.senses, anatomy), anatomy.drives)
    reflexes.check_weights(network.weight_count)
    return network


def changed_command(wave: Any, added: Any) -> Any:
    """A rhythm's command with something added: it stays from -1 to 1, unless the rhythm itself goes beyond."""
    low, high = np.minimum(value_of(wave), -1.0), np.maximum(value_of(wave), 1.0)
    return np.minimum(np.maximum(wave + added, low), high)


class ReflexLoop(AnsweringLoop):
    """The reflexes of B robots in a run: decides the commands of their drives, and takes derivatives back.

    Attributes are those of ``AnsweringLoop``, and once all decisions were taken back:
        by_points: derivatives by the points of rhythms, but through their commands, (B, 1 + 3 M).
        by_commands: by the commands of rhythms, shape as theirs.
    """

    reader: DriveReader

    def __init__(
        self, reflexes: DriveReflexes, anatomy: Anatomy, weights: Floats, rhythms: Rhythms, start: Floats, seed: int = 0
    ) -> None:
        """Set up; ``start`` is the place of the bases at the start, (B, 3) or (1, 3) [m], ``seed`` that of noise."""
        self.anatomy, self.rhythms, self.seed = anatomy, rhythms, seed
        first = np.broadcast_to(start, (len(weights), 3))
        reader = DriveReader(reflexes.senses, anatomy, rhythms.span, rhythms.points, first)
        super().__init__(reflexes, weights, network_of(reflexes, anatomy), reader)

    def _forget(self) -> None:
        super()._forget()
        self.by_points, self.by_commands = np.zeros(self.rhythms.points.shape), np.zeros(self.rhythms.commands.shape)

    def seeds_of_noise(self, number: int) -> tuple[int, ...]:
        """What the noise of a reading is drawn from."""
        # Of seed 0 these are the numbers of ``default_rng(number)``, which earlier versions drew.
        return number, self.seed

    def answer(self, number: int, weights: Any, felt: Any, given: Sequence[Any], state: Sequence[Any]) -> Sequence[Any]:
        """A command, given the points of the rhythms and their command."""
        points, wave = given
        if self.oscillators is None:
            added = self.network.answer(weights, felt)
        else:
            span = points[:, :1] * self.rhythms.span
            state = self.oscillators.step(weights, felt, span, *state)
            drives = points[:, 1:].reshape(len(points), self.anatomy.drives, len(PARTS))
            angle = 2 * np.pi * (span * number + drives[:, :, 1])
            larger = (1.0 + state[1]) * np.sin(angle + 2 * np.pi * state[0])
            added = drives[:, :, 0] * (larger - np.sin(angle))
        return changed_command(wave, added), *state

    def decide(self, number: int, felt: Felt) -> Floats:
        """The command of all drives, (B, M)."""
        given = self.rhythms.points, self.rhythms.commands[:, number]
        (commands,) = self.decided(number, self.reader.read(number, felt), *given)
        return np.asarray(commands)

    def pull_back(self, number: int, commands: Floats) -> Felt:
        """Derivatives by what was felt, from those by the command."""
        by_felt, (by_points, by_wave) = self.taken_back(number, commands)
        self.by_points += by_points
        self.by_commands[:, number] += by_wave
        felt, by_points = self.reader.pull_back(number, by_felt)
        self.by_points += by_points
        return felt
