"""Robots that feel the pressure in their chambers: Boyle's law, chambers apart, derivatives, and bodies without any."""

import dataclasses
import itertools
import json

import numpy as np
import pytest
from pouches import lopsided, shell, two_boxes

from robots.inflatable import InflatableGeometry
from robots.inflatable.body import TWO_CORE
from robots.inflatable.pouch import GAIN, feeling_pouch
from robots.lattice_robot import Drive, Free, LatticeRobot, differentiate, load_robot, simulate
from robots.lattice_robot.episodes import Episodes
from robots.lattice_robot.record import robot_of_record
from robots.lattice_robot.reflexes import Reflexes
from robots.lattice_robot.senses import LEAST_VOLUME, RISE, Anatomy, LatticeReader
from robots.lattice_robot.walker import WalkerDesign, walker_robot
from robots.robot import Compute
from robots.world import Terrain
from taichi_sim.lattice import Felt, LatticeBody

MUSCLES = (0, 1, 2)
EXACT = Compute(precision="f64", threads=1)
TWO = two_boxes(chambers=np.where(two_boxes().voxels[:, 0] < 4, 7, 4))


def box(**options) -> LatticeBody:
    """A hollow box of 4 x 3 x 3 voxels, in three muscles along it."""
    return shell((4, 3, 3), **{"regions": np.minimum(shell((4, 3, 3)).voxels[:, 0], 2)} | options)


def squeezing(reflexes=None, body=None, **settings) -> LatticeRobot:
    """A box whose muscles squeeze what is in it, at a pressure that stays."""
    wave = Drive("muscle", MUSCLES, amplitude=Free(0, 0.2, 0.15), phase=(0.1, 0.4, 0.8))
    core = Drive("core", MUSCLES, "pressure", mean=2e3)
    given = {"cycles": 1, "frequency": 100.0, "settling": 0.0, **settings}
    return LatticeRobot(body or box(), (wave, core), reflexes=reflexes, **given)


def weighted(robot: LatticeRobot, seed: int = 1) -> np.ndarray:
    """A point with random weights."""
    count = robot.weights_of(robot.start[None]).shape[1]
    return np.concatenate([robot.start[:-count], np.random.default_rng(seed).normal(size=count) * 0.8])


def reader_of(body: LatticeBody, robots: int = 1) -> LatticeReader:
    """Reads the pressures in robots that were put down as built."""
    anatomy = Anatomy.of(body, (0,), 0.1, True)
    return LatticeReader(("pressure",), anatomy, np.tile(body.start_positions, (robots, 1, 1)))


def at(body: LatticeBody, *places) -> Felt:
    """What there is to feel of robots whose voxels are at places."""
    count = len(places)
    others = np.zeros((count, body.voxel_count, 4)), np.zeros((count, len(body.topology.links)))
    return Felt(np.array(places, float), *others)


# what is read


def test_a_squeezed_box_reads_by_boyles_law():
    """V before over V, less 1, since the last reading; the first has none before it, whatever the settling did."""
    body = box()
    reader, built = reader_of(body), body.start_positions
    volumes = [0.5, 1.0, 0.88, 0.88, 2.0]
    changes = [(0.5, 1, 1), (1, 1, 1), (0.8, 1.1, 1), (1, 1.1, 0.8), (1, 1, 2)]
    found = [reader.read(number, at(body, built * change + 0.1))[0, 0] for number, change in enumerate(changes)]
    expected = [0.0, *(before / now - 1 for before, now in itertools.pairwise(volumes))]
    assert found == pytest.approx([each / RISE for each in expected], abs=1e-9)
    assert reader.read(0, at(body, built))[0, 0] == 0.0  # another episode begins


def test_chambers_are_read_apart_in_the_order_of_their_labels():
    """The second box, whose skin looks inwards, has the lower label; what is squeezed reads more."""
    lower = TWO.voxels[:, 0] >= 5
    reader, built = reader_of(TWO), TWO.start_positions
    assert reader.read(0, at(TWO, built)).shape == (1, 2)
    for chamber, rows in enumerate((lower, ~lower)):
        squeezed = np.where(rows[:, None], built * [1, 0.8, 1], built)
        reader.read(1, at(TWO, built))
        found = reader.read(2, at(TWO, squeezed))[0]
        assert found[chamber] == pytest.approx(0.25 / RISE) and found[1 - chamber] == pytest.approx(0.0, abs=1e-9)
    assert Reflexes(("pressure", "clock")).width(TWO, (0,)) == 4
    assert Reflexes(("strain", "clock")).width(TWO, (0,)) == 3  # chambers count for nothing else
    assert Reflexes(("pressure",)).weight_count(TWO, (0,)) == 3


def test_flat_tubes_and_lost_robots_read_finite_numbers():
    """What is flat or inside out counts as a tenth as large as it was built, and changes nothing there."""
    body = lopsided()
    built, flat = body.start_positions, body.start_positions * [1, 1, 0]
    inverted, lost = body.start_positions * [1, 1, -1], np.full(built.shape, np.nan)
    reader = reader_of(body, 4)
    assert not reader.read(0, at(body, built, built, built, lost)).any()
    most, none = (1 / LEAST_VOLUME - 1) / RISE, (LEAST_VOLUME - 1) / RISE
    assert reader.read(1, at(body, flat, inverted, lost, built))[:, 0] == pytest.approx([most, most, most, none])
    assert not reader.pull_back(1, np.ones((4, 1))).positions[:3].any()
    assert np.isfinite(reader.pull_back(0, None).positions).all()


def test_readings_have_derivatives():
    """Through both readings of each rise, against central differences."""
    rng = np.random.default_rng(0)
    places = TWO.start_positions + rng.normal(0, 1e-3, (5, 2, TWO.voxel_count, 3))
    ways, seeds = rng.normal(0, 1e-2, places.shape), rng.normal(size=(5, 2, 2))
    reader = reader_of(TWO, 2)

    def cost(step):
        return sum(
            (seeds[number] * reader.read(number, at(TWO, *(each + step * way)))).sum()
            for number, (each, way) in enumerate(zip(places, ways, strict=True))
        )

    expected = (cost(1e-5) - cost(-1e-5)) / 2e-5
    cost(0.0)
    back = [reader.pull_back(number, seeds[number]).positions for number in reversed(range(5))]
    assert sum((got * way).sum() for got, way in zip(back, ways[::-1], strict=True)) == pytest.approx(
        expected, rel=1e-7
    )


# robots


@pytest.mark.kernels
def test_the_gradient_is_that_of_central_differences():
    """By the weights and the wave, to 1e-6 over hundreds of steps, in water, which has no jumps."""
    robot, water = squeezing(Reflexes(("pressure", "clock"), (2,))), Terrain.water()
    point = weighted(robot)
    found = differentiate(robot, point[None], water, threads=1)
    assert 200 < found.steps[0] < 500
    feels = [place for place, name in enumerate(robot.free) if name in ("reflex_1", "reflex_4")]  # weights of pressure
    assert np.abs(found.gradient[0, feels]).min() > 1e-3 * np.abs(found.gradient[0]).max()
    moves = 1e-6 * np.eye(len(point))
    run = simulate(robot, point + np.concatenate([moves, -moves]), water, threads=1)
    expected = np.subtract(*np.split(run.distance, 2)) / 2e-6
    assert found.gradient[0] == pytest.approx(expected, rel=1e-6, abs=1e-6 * np.abs(expected).max())


@pytest.mark.kernels
def test_robots_of_a_batch_have_their_own():
    """Each does what it does alone, to the bit; without weights each plays its waves."""
    robot = squeezing(Reflexes(("pressure",), gain=0.2))
    points = np.stack([robot.start, weighted(robot, 1), weighted(robot, 2)])
    together = simulate(robot, points, threads=1).distance
    assert len(set(together.tolist())) == 3
    assert np.array_equal(together, [simulate(robot, point[None], threads=1).distance[0] for point in points])
    assert together[0] == simulate(squeezing(), threads=1).distance[0]


@pytest.mark.kernels
def test_beside_props_a_robot_feels_its_own_chambers():
    """A box that it never meets changes nothing."""
    robot = squeezing(Reflexes(("pressure", "clock")))
    points = np.stack([weighted(robot, seed) for seed in range(3)])
    worlds = Terrain(), Terrain.parse("flat+box:0.02,0.02,0.02,0.5,0.0,ground,20000")
    alone, beside = (robot.felt_over_time(points, world, EXACT) for world in worlds)
    assert alone.shape == (3, 3, 31) and np.abs(alone[:, 0]).max() > 0.01
    assert beside == pytest.approx(alone, rel=1e-9, abs=1e-12)


@pytest.mark.kernels
def test_a_saved_design_moves_as_before(tmp_path):
    """With a weight for each chamber."""
    robot = squeezing(Reflexes(("pressure", "tilt")))
    again = robot_of_record(json.loads(json.dumps(robot.describe())))
    assert list(again.free) == list(robot.free) and again.reflexes == robot.reflexes
    point = weighted(robot)
    robot.save(point, tmp_path / "best.json")
    best = load_robot(tmp_path / "best.json")
    assert len(best.reflexes.weights) == (1 + 2 + 1) * len(MUSCLES)
    assert simulate(best, threads=1).distance[0] == simulate(robot, point[None], threads=1).distance[0]


@pytest.mark.kernels
def test_the_inflatable_robot_feels_its_core():
    """A flat tube that inflates while it settles: not before the first reading, and then as bladders squeeze it."""
    geometry = InflatableGeometry(bladder_columns=1, rows=7, foot_rows=1, closed=True)
    reflexes = Reflexes(("pressure", "clock"), gain=GAIN)
    robot = feeling_pouch(geometry, 6e3, reflexes, frequency=8.0, cycles=1, settling=0.1)
    felt = robot.felt_over_time(robot.start[None], Terrain(), EXACT)[0, 0]
    assert felt.shape == (31,) and felt[0] == 0 and 0.05 < felt.std() < 5


@pytest.mark.kernels
def test_environments_feel_chambers():
    """The pressure in each, from outside."""
    robot = squeezing()
    episodes = Episodes(robot, Terrain(), 2, ("pressure", "clock"), EXACT)
    felt = episodes.begin()
    assert felt.shape == (2, 3) == (2, episodes.width) and not felt[:, 0].any()
    felt, _, _ = episodes.advance(np.array([[-0.2] * 3, [0.2] * 3]))
    felt, _, _ = episodes.advance(np.array([[-0.2] * 3, [0.2] * 3]))
    assert felt[0, 0] > felt[1, 0]  # the first is squeezed


def test_several_cores_are_several_numbers():
    body = TWO_CORE.body
    assert len(Anatomy.of(body, (0,), 0.1, True).chambers) == 2
    assert Reflexes(("pressure", "velocity")).width(body, (0, 1)) == 4


# bodies that lack what is felt

OPEN = np.where((box().voxels == [3, 1, 1]).all(axis=1)[:, None], 0, box().pressure_normals)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (box(pressure_normals=None), "without a chamber; give pressure_normals, out of a skin that is closed"),
        (box(pressure_normals=OPEN), r"whose chamber is open: voxel \(\d, \d, \d\) is [^;]*; give a skin that is"),
        (two_boxes(), "whose chamber 0 encloses no volume; give one that does"),
    ],
    ids=["none", "open", "empty"],
)
def test_robots_without_a_closed_chamber_are_refused_in_one_line(body, message):
    """From Python, as a record, and in environments; without the sense they may be."""
    plain = LatticeRobot(body, (Drive("muscle", (0,), amplitude=0.1),), cycles=1)
    line = f"^senses: pressure is not allowed for a body {message}[^\n]*$"
    feeling = plain.describe() | {"reflexes": dataclasses.asdict(Reflexes(("tilt", "pressure")))}
    for make in (
        lambda: dataclasses.replace(plain, reflexes=Reflexes(("tilt", "pressure"))),
        lambda: robot_of_record(feeling),
        lambda: Episodes(plain, Terrain(), 1, ("pressure",), EXACT),
    ):
        with pytest.raises(ValueError, match=line):
            make()
    assert dataclasses.replace(plain, reflexes=Reflexes(("tilt",))).free


def test_a_walker_has_no_chamber():
    walker = walker_robot(WalkerDesign(np.full((3, 2, 2), 2)))
    with pytest.raises(ValueError, match=r"^senses: pressure is not allowed for a body without a chamber; [^\n]*$"):
        dataclasses.replace(walker, reflexes=Reflexes(("pressure",)))
