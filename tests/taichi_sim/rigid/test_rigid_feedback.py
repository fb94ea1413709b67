"""Commands that are decided on the way: against those given beforehand, and derivatives through decisions."""

import numpy as np
import pytest

from robots.quadruped import LEGGED
from taichi_sim.rigid import Network, Physics, RigidEngine
from taichi_sim.rigid.feedback import Felt

pytestmark = pytest.mark.kernels

LIGHT = np.array([[3.0, 1.0, 0.15]])
STEPS, HOLD, COUNT = 23, 5, 5


def robots(friction: float = np.inf, **given) -> RigidEngine:
    """Quadrupeds with touch and light sensors."""
    world = Physics(0.05, -1.0, 0.01, friction=friction)
    return RigidEngine(LEGGED.tree(), world, LEGGED.senses(), Network(), threads=1, **given)


def some_commands(batch: int = 3) -> np.ndarray:
    """Their commands over time."""
    return np.random.default_rng(4).uniform(-1, 1, (batch, COUNT, 8))


class Linear:
    """Commands that differ from given ones by a linear function of what is felt."""

    def __init__(self, commands: np.ndarray, gain: float, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        self.commands, self.gain, self.felt = commands, gain, list[Felt]()
        self.maps = [rng.normal(size=(size, 8)) for size in (3, 4, 8, 5)]
        self.by_gain = 0.0

    def decide(self, number: int, felt: Felt) -> np.ndarray:
        """The command."""
        self.felt = [*self.felt[:number], felt]
        parts = felt.position, felt.orientation, felt.angles, felt.readings
        return self.commands[:, number] + self.gain * sum(x @ m for x, m in zip(parts, self.maps, strict=True))

    def pull_back(self, number: int, commands: np.ndarray) -> Felt:
        """Derivatives by what was felt."""
        felt = self.felt[number]
        parts = felt.position, felt.orientation, felt.angles, felt.readings
        self.by_gain += (commands * sum(x @ m for x, m in zip(parts, self.maps, strict=True))).sum(1)
        return Felt(*(self.gain * commands @ m.T for m in self.maps))


@pytest.mark.parametrize(
    "given",
    [
        {},
        *(pytest.param(one, marks=pytest.mark.slow) for one in ({"width": 1}, {"precision": "f32"}, {"friction": 0.5})),
    ],
)
def test_decided_commands_do_what_given_ones_do(given):
    """To the bit: ends, frames, and where a gradient comes out."""
    engine, commands = robots(**given), some_commands()
    told = {"commands": commands, "hold": HOLD, "lights": LIGHT}
    plain = engine.run(STEPS, record_every=4, **told)
    fed = engine.run(STEPS, record_every=4, feedback=Linear(commands, 0.0), **told)
    for name in ("position", "angles", "readings", "velocities", "closest", "residual", "steps", "status"):
        assert np.array_equal(getattr(plain, name), getattr(fed, name)), name
    for name in ("times", "position", "angles", "readings", "neurons"):
        assert np.array_equal(getattr(plain.frames, name), getattr(fed.frames, name)), name
    if "friction" not in given:
        aim = np.ones((3, 3))
        open_loop = engine.record(STEPS, **told).pull_back(position=aim)
        closed = engine.record(STEPS, feedback=Linear(commands, 0.0), **told).pull_back(position=aim)
        for name in ("commands", "lights", "masses", "points", "position", "carried"):
            assert np.array_equal(getattr(open_loop, name), getattr(closed, name)), name


def test_derivatives_go_through_decisions():
    """By how much decisions heed what is felt, by commands, and by the light, which is felt too."""
    engine, commands, rng = robots(), some_commands(), np.random.default_rng(1)
    aim, along, gain, shift = rng.normal(size=3), rng.normal(size=commands.shape), 0.02, 1e-6

    def cost(commands=commands, gain=gain, lights=LIGHT) -> np.ndarray:
        told = {"commands": commands, "hold": HOLD, "lights": lights}
        return engine.run(STEPS, feedback=Linear(commands, gain), **told).position @ aim

    feedback = Linear(commands, gain)
    tape = engine.record(STEPS, commands=commands, hold=HOLD, lights=LIGHT, feedback=feedback)
    assert np.array_equal(tape.result.position @ aim, cost())
    found = tape.pull_back(position=np.tile(aim, (3, 1)))
    for got, expected in (
        (feedback.by_gain, cost(gain=gain + shift) - cost(gain=gain - shift)),
        ((found.commands * along).sum((1, 2)), cost(commands + shift * along) - cost(commands - shift * along)),
        (found.lights @ aim, cost(lights=LIGHT + shift * aim) - cost(lights=LIGHT - shift * aim)),
    ):
        assert got == pytest.approx(expected / (2 * shift), rel=1e-6, abs=1e-10)
    again = tape.pull_back(position=np.tile(aim, (3, 1)))
    assert np.array_equal(again.commands, found.commands)


def test_in_a_run_of_no_steps_nothing_is_decided():
    """Robots are where they start, and derivatives are those of the start."""
    engine, feedback = robots(), Linear(some_commands(), 1.0)
    tape = engine.record(0, commands=some_commands(), hold=HOLD, feedback=feedback)
    assert not feedback.felt and np.array_equal(tape.result.position, np.repeat(engine.rest().position, 3, 0))
    found = tape.pull_back(position=np.ones((3, 3)))
    assert np.array_equal(found.position, np.ones((3, 3))) and not found.commands.any()


def test_robots_that_run_in_parts_decide_together(monkeypatch):
    """With the bits of one part."""
    commands = some_commands(40)
    told = {"commands": commands, "hold": HOLD, "lights": LIGHT}
    whole = robots().run(STEPS, feedback=Linear(commands, 0.1), **told)
    monkeypatch.setattr("taichi_sim.rigid.engine.BLOCKS_AT_ONCE", 2)
    parts = robots().run(STEPS, feedback=Linear(commands, 0.1), **told)
    assert np.array_equal(whole.position, parts.position) and np.ptp(whole.position[:, 0]) > 0


def test_bad_input():
    """One line each."""
    with pytest.raises(ValueError, match=r"^feedback: not allowed without commands"):
        robots().run(5, feedback=Linear(some_commands(), 0.1))
    wrong = Linear(some_commands(), 0.0)
    wrong.decide = lambda number, felt: np.zeros((3, 7))
    with pytest.raises(ValueError, match=r"^commands: shape \(3, 7\) is not allowed; give \(3, 8\)"):
        robots().run(5, commands=some_commands(), feedback=wrong)
