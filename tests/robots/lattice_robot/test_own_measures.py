"""Measures of a user's own: what their laws see, their gradients beside differences, and what is refused."""

import asyncio
import dataclasses
import sys

import numpy as np
import pytest
from made_records import recorded
from plug_in import install

from morpholab import OwnMeasure
from optim import maximise
from optim.problems.goals import WORDS
from optim.problems.robot import RobotProblem
from robots.freeform import FreeformActuation, FreeformRobot, Grid
from robots.lattice_robot import Drive, Free, LatticeRobot, load_robot, save_robot
from robots.lattice_robot.soft_motion import SoftMotion, law_of
from robots.own_measures import OF_OBJECTIVES, OWN_MEASURES
from robots.robot import KINDS
from robots.world import Terrain
from taichi_sim.base.compute import Compute
from taichi_sim.lattice import Material, body_from_array

FINE = Compute(precision="f64")
RUBBER = Material(1e5, 1e3, static_friction=1.0, kinetic_friction=0.8, internal_damping=1.0, name="rubber")
BODY = body_from_array(np.ones((4, 2, 1), int), RUBBER, 0.01, regions=np.indices((4, 2, 1)).sum(0) % 3)
PACKAGE = """
from morpholab import OwnMeasure


def side(motion):
    return motion.ended[:, 0, 1] * 1.0


SIDE = OwnMeasure("side", "m", law=side)
"""
SPACE = {"amplitude": (Free(0.0, 0.2),) * 3, "phase": (Free(0.0, 1.0),) * 3}
SETTINGS = {"cycles": 1, "settling": 0.05, "frequency": 8.0}


class Panic(BaseException):
    """What goes past handlers of failures, as those of Rust do."""


def raised(error):
    raise error


def speed(motion):
    """What the lab's own speed is."""
    way = motion.centres(motion.ended) - motion.centres(motion.began)
    return (way @ motion.heading) / motion.length / motion.duration


def of_everything(motion):
    """A number to which all that moves adds its part."""
    stretched = (motion.strains**2).sum(axis=(1, 2))
    grown = (motion.sizes[..., 0] * motion.times[None, :, None]).sum(axis=(1, 2))
    return (
        np.sqrt(1e-6 + motion.positions[..., 2].mean(axis=(1, 2)) ** 2) + stretched + grown * motion.masses.sum(axis=1)
    )


OWN = OwnMeasure("own_speed", "BL/s", law=speed), OwnMeasure("everything", law=of_everything)


@pytest.fixture
def bar():
    """A bar of three muscles, all free, with both measures."""
    return LatticeRobot(
        BODY, (Drive("muscle", (0, 1, 2), **SPACE),), moduli={0: Free(5e4, 2e5)}, own_measures=OWN, **SETTINGS
    )


@pytest.fixture
def packaged(tmp_path, monkeypatch):
    """An installed package that has a measure under its name, and another one under a wrong name."""
    install(
        tmp_path / "site", "side_lab", OWN_MEASURES.group, {"side": "side_lab:SIDE", "odd": "side_lab:SIDE"}, PACKAGE
    )
    monkeypatch.syspath_prepend(tmp_path / "site")
    yield OWN_MEASURES["side"]
    for name in ("side", "odd"):
        OWN_MEASURES._loaded.pop(name, None)


def far_from_ties(robot, count=4):
    rng = np.random.default_rng(3)
    low, high = (np.array([getattr(p, end) for p in robot.parameters]) for end in ("low", "high"))
    return low + (high - low) * rng.uniform(0.3, 0.7, (count, len(low)))


def relative_error(robot, points, name, steps=(1e-6, 1e-7, 1e-8)):
    """Of the gradient along a direction, at the best of some differences; the median, as some cross jumps."""
    spans = np.array([p.high - p.low for p in robot.parameters])
    way = np.random.default_rng(5).normal(size=points.shape) * spans
    exact = (robot.differentiate(points, Terrain(), measures=[name], compute=FINE).gradients[name] * way).sum(axis=1)
    errors = []
    for step in steps:
        sides = (robot.simulate(points + sign * step * way, Terrain(), compute=FINE) for sign in (1, -1))
        plus, minus = (each.measures[name] for each in sides)
        errors.append(np.abs((plus - minus) / (2 * step) / exact - 1.0))
    return np.median(np.min(errors, axis=0))


@pytest.mark.kernels
def test_a_law_sees_what_the_lab_measures_by(bar):
    points = far_from_ties(bar)
    found = bar.simulate(points, Terrain(slope=5.0), compute=FINE).measures
    np.testing.assert_allclose(found["own_speed"], found["speed"], rtol=1e-12)
    slopes = bar.differentiate(points, Terrain(), measures=["own_speed", "speed"], compute=FINE).gradients
    np.testing.assert_allclose(slopes["own_speed"], slopes["speed"], rtol=1e-9, atol=1e-12)


@pytest.mark.kernels
def test_gradients_are_what_differences_say(bar):
    assert relative_error(bar, far_from_ties(bar), "everything") < 1e-6


@pytest.mark.kernels
def test_freeform_robots_have_them_too_and_search_by_them():
    grid, drive = Grid((4, 2, 2)), FreeformActuation(frequency=8.0, cycles=1, settling=0.05)
    robot = FreeformRobot(grid, actuation=drive, full=True, own_measures=OWN)
    assert relative_error(robot, far_from_ties(robot), "everything") < 1e-6
    mixed = dataclasses.replace(robot, full=False)
    between = mixed.differentiate(far_from_ties(mixed), Terrain(), measures=["own_speed", "speed"], sharpness=2.0)
    np.testing.assert_allclose(between.gradients["own_speed"], between.gradients["speed"], rtol=1e-4, atol=1e-6)
    problem = RobotProblem(robot, objective=("own_speed", "minimise:0.1*everything", "everything <= 9"), summed=True)
    best = maximise(problem, method="gradient", climbers=1, generations=2, seed=1, progress=False)
    assert np.isfinite(best.score) and robot.design(best.point).own_measures == OWN


def test_no_moment_comes_twice_where_steps_are_long():
    constants, record = recorded()
    record.positions[0, :, 0, 0] = np.arange(record.positions.shape[1])
    moments = np.arange(65) * 3 // 4  # three steps in each sixteenth of a cycle
    seen = SoftMotion.of(record, dataclasses.replace(constants, moments=1e-3 * moments))
    assert seen.times == pytest.approx(1e-3 * np.arange(49)) and seen.positions.shape == (1, 49, 3, 3)
    assert (moments[(seen.positions[0, :, 0, 0] - 2).astype(int)] == np.arange(49)).all()


def test_moments_begin_with_the_robot_where_it_stands():
    constants, record = recorded()
    seen = SoftMotion.of(record, dataclasses.replace(constants, raised=np.array([[0.5, 0.0, 0.0]])))
    assert seen.times[0] == 0 and seen.times[-1] == pytest.approx(0.25) and seen.positions.shape == (1, 65, 3, 3)
    assert (np.diff(seen.times) > 0).all()
    assert seen.start[0, :, 2] == pytest.approx(constants.body.start_positions[:, 2] + [0.5, 0.0, 0.0])
    assert seen.masses == pytest.approx(np.full((1, 3), 1e-3))
    assert seen.centres(seen.began)[0] == pytest.approx(constants.body.start_positions.mean(axis=0))


@pytest.mark.parametrize(
    ("law", "told"),
    [
        (lambda motion: 1.0, r"gives float64 of shape \(\); give a number for each robot, shape \(1,\)"),
        (lambda motion: motion.ended, r"gives float64 of shape \(1, 3, 3\)"),
        (lambda motion: np.array(["a"]), r"gives <U1 of shape \(1,\)"),
        (lambda motion: sys.exit(0), "fails: SystemExit: 0$"),
        (lambda motion: raised(Panic("a\nb")), "fails: Panic: a b$"),
        (lambda motion: raised(GeneratorExit()), "fails: GeneratorExit$"),
        (lambda motion: raised(asyncio.CancelledError()), "fails: CancelledError$"),
        (lambda motion: motion.nothing, "fails: AttributeError: .* no attribute 'nothing'; it has .*positions"),
    ],
)
def test_what_a_law_gets_wrong_is_told_in_one_line(law, told):
    constants, record = recorded()
    with pytest.raises(ValueError, match=rf"^own_measures: wrong {told}"):
        law_of(OwnMeasure("wrong", law=law))(record, constants)


def test_an_interrupt_passes_a_law():
    constants, record = recorded()
    with pytest.raises(KeyboardInterrupt):
        law_of(OwnMeasure("slow", law=lambda motion: raised(KeyboardInterrupt())))(record, constants)


def test_what_is_no_measure_is_refused(bar):
    assert set(OF_OBJECTIVES) == set(WORDS)
    with pytest.raises(ValueError, match=r"^name: 'My speed' is not allowed; give lower-case letters, digits"):
        OwnMeasure("My speed", law=speed)
    with pytest.raises(ValueError, match=r"^name: 'worst' is not allowed; it says how worlds are combined$"):
        OwnMeasure("worst", law=speed)
    with pytest.raises(ValueError, match=r"^law: 3 is no function"):
        OwnMeasure("three", law=3)
    for given, told in (
        ("side", "'side' is not allowed; give a tuple, such as"),
        (("side",), "'side' is unknown; no installed package has measures"),
        ((OWN[0], OWN[0]), "own_speed is given twice; give each once"),
        ((OwnMeasure("speed", law=speed),), "speed is a measure that the robot has anyway; call yours otherwise"),
        ((speed,), "<function speed at .*> is not allowed; give an OwnMeasure, or the name"),
    ):
        with pytest.raises(ValueError, match=f"^own_measures: {told}"):
            dataclasses.replace(bar, own_measures=given)


def test_files_hold_names_and_no_code(bar, packaged, tmp_path):
    with pytest.raises(ValueError, match=r"^own_measures: own_speed is not kept in files, which hold no code; name it"):
        save_robot(bar, tmp_path / "own.json")
    with pytest.raises(ValueError, match=r"^own_measures: the package's measure 'odd' calls itself 'side'; give both"):
        dataclasses.replace(bar, own_measures=("odd",))
    named = dataclasses.replace(bar, own_measures=("side",))
    assert named.own_measures == (packaged,) and [m.name for m in named.measures][-1] == "side"
    save_robot(named, tmp_path / "named.json")
    assert load_robot(tmp_path / "named.json").own_measures == (packaged,)
    named.save(far_from_ties(named)[0], tmp_path / "best.json")
    assert load_robot(tmp_path / "best.json").own_measures == ()
    assert load_robot(tmp_path / "best.json").changed({"own_measures": ["side"]}).own_measures == (packaged,)
    freeform = KINDS["freeform"].build(None, {"shape": (4, 2, 2), "own_measures": ["side"]})
    assert KINDS["freeform"].from_description(freeform.describe()).own_measures == (packaged,)
    with pytest.raises(ValueError, match=r"^own_measures: 'sides' is unknown; did you mean side\?"):
        dataclasses.replace(bar, own_measures=("sides",))


@pytest.mark.kernels
def test_one_measure_needs_no_list(bar):
    found = bar.differentiate(far_from_ties(bar, 1), Terrain(), measures="own_speed", compute=FINE)
    assert list(found.gradients) == ["own_speed"]


@pytest.mark.kernels
def test_a_robot_of_which_a_measure_is_not_finite_fails_alone(bar):
    """The square root of a way back is none, and has no derivative: the others of the batch keep theirs."""
    points = far_from_ties(bar, 6)
    ways = bar.simulate(points, Terrain(), compute=FINE).measures["distance"]
    bound = np.median(ways)
    root = OwnMeasure("root", law=lambda m: np.sqrt((m.centres(m.ended) - m.centres(m.began)) @ m.heading - bound))
    found = dataclasses.replace(bar, own_measures=(root,)).differentiate(
        points, Terrain(), measures="root", compute=FINE
    )
    fine = ways > bound
    assert 0 < fine.sum() < 6 and np.array_equal(found.status == "ok", fine)
    assert np.array_equal(np.isfinite(found.gradients["root"]).all(axis=1), fine)
    assert np.array_equal(np.isfinite(found.measures["speed"]), fine)


@pytest.mark.kernels
def test_a_law_cannot_change_what_others_see(bar):
    def greedy(motion):
        ended = motion.ended
        ended -= motion.began
        return ended[:, 0, 0]

    spoilt = dataclasses.replace(bar, own_measures=(OwnMeasure("greedy", law=greedy), *OWN))
    with pytest.raises(ValueError, match=r"^own_measures: greedy fails: ValueError: .*read-only"):
        spoilt.simulate(far_from_ties(bar), Terrain(), compute=FINE)


@dataclasses.dataclass
class Law:
    """A law with a setting, of which no hash is known."""

    factor: float

    def __call__(self, motion):
        return self.factor * motion.ended[:, 0, 2]


@pytest.mark.kernels
def test_laws_need_no_hash_and_are_judged_over_draws(bar):
    robot = dataclasses.replace(bar, own_measures=(OwnMeasure("height", "m", law=Law(2.0)),))
    problem = RobotProblem(robot, objective="height", uncertain="friction=10%,slope=1", draws=2, precision="f64")
    assert np.isfinite(problem.evaluate(far_from_ties(bar)).objectives).all()
