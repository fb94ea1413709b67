"""Robots that feel: senses, answers, and derivatives through both."""

import dataclasses
import json

import numpy as np
import pytest

from robots.control.senses import Sense
from robots.lattice_robot import Drive, Free, LatticeRobot, differentiate, load_robot, save_robot, simulate
from robots.lattice_robot.episodes import Episodes
from robots.lattice_robot.record import robot_of_record
from robots.lattice_robot.reflexes import Reflexes
from robots.lattice_robot.senses import SENSES, Anatomy, LatticeReader
from robots.robot import Compute, Trial
from robots.world import Terrain
from taichi_sim.lattice import Felt, Material, Relief, body_from_array

SOFT = Material(1e5, 1e3, static_friction=1.0, kinetic_friction=0.8, collision_damping=0.5)
EVERY = tuple(name for name in SENSES if name != "pressure")  # which test_pressure_sense.py feels, in chambers


def legs(reflexes=None, **settings) -> LatticeRobot:
    """Eighteen voxels in three muscles, without symmetry."""
    regions = np.arange(18).reshape(6, 3, 1) % 3
    array = np.ones((6, 3, 1), int)
    array[5, 2, 0] = 0
    body = body_from_array(array, SOFT, 0.01, regions=regions)
    drive = Drive("legs", (0, 1, 2), amplitude=Free(0, 0.2, 0.1), phase=(0.1, 0.4, Free(0, 1, 0.8)))
    given = {"cycles": 1, "settling": 0.05, "frequency": 4.0, **settings}
    return LatticeRobot(body, (drive,), reflexes=reflexes, **given)


def weighted(robot: LatticeRobot, seed: int = 1) -> np.ndarray:
    """A point with random weights."""
    point = robot.start.copy()
    weights = [n for n, name in enumerate(robot.free) if name.startswith("reflex")]
    point[weights] = np.random.default_rng(seed).normal(size=len(weights)) * 0.8
    return point


@pytest.mark.kernels
def test_without_weights_a_robot_plays_its_waves():
    """To the bit."""
    plain, feeling = simulate(legs()), simulate(legs(Reflexes(EVERY[:4], hidden=(3,))))
    assert plain.distance[0] == feeling.distance[0] and plain.steps[0] == feeling.steps[0]


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("ground", "hidden", "late"),
    [
        ("rough:0.004,0.03", (4,), {"noise": 0.05, "delay": 2}),
        *(pytest.param(ground, (), {}, marks=pytest.mark.slow) for ground in (None, "rough:0.004,0.03")),
        pytest.param(None, (4,), {"noise": 0.05, "delay": 2}, marks=pytest.mark.slow),
    ],
)
def test_the_gradient_is_that_of_central_differences(ground, hidden, late):
    """By weights, waves and a modulus, through every sense, on a slope, with contact, over thousands of steps."""
    # Acceleration magnifies every jump 256 times: in the others differences agree with derivatives below 1e-10 only.
    senses = EVERY if ground and late else tuple(name for name in EVERY if name != "acceleration")
    robot = legs(Reflexes(senses, hidden, light=(0.1, 0.03), **late), moduli={0: Free(8e4, 1.2e5)})
    terrain, point = Terrain(2.0, ground=ground), weighted(robot)
    found = differentiate(robot, point[None], terrain, threads=1)
    assert found.steps[0] > 2000
    rng = np.random.default_rng(0)
    span = np.array([free.high - free.low for free in robot.free.values()])
    directions = rng.normal(size=(6, len(point))) * span
    directions[:2, : -robot.weights_of(point[None]).shape[1] - 1] = 0  # weights alone
    errors = []
    for step in (1e-7, 1e-8, 1e-9):  # feet stick and slip: larger ones meet jumps
        run = simulate(robot, point + step * np.concatenate([directions, -directions]), terrain, threads=1)
        expected = (run.distance[:6] - run.distance[6:]) / (2 * step)
        errors.append(np.abs(directions @ found.gradient[0] - expected) / np.abs(expected))
    assert np.min(errors, axis=0).max() < 1e-4, errors
    assert found.distance[0] == simulate(robot, point[None], terrain, threads=1).distance[0]


@pytest.mark.slow
@pytest.mark.kernels
def test_the_gradient_through_acceleration_is_that_of_central_differences():
    """In water, which has no jumps; on the ground much weight on it magnifies them."""
    robot, water = legs(Reflexes(("acceleration",), (4,), gain=0.02)), Terrain.parse("water")
    point = weighted(robot)
    found = differentiate(robot, point[None], water, threads=1)
    directions, errors = np.random.default_rng(0).normal(size=(3, len(point))), []
    for step in (1e-7, 1e-8, 1e-9):  # its curvature is large, too
        run = simulate(robot, point + step * np.concatenate([directions, -directions]), water, threads=1)
        expected = (run.distance[:3] - run.distance[3:]) / (2 * step)
        errors.append(np.abs(directions @ found.gradient[0] - expected) / np.abs(expected))
    assert np.min(errors, axis=0).max() < 1e-4, errors


@pytest.mark.kernels
def test_reflexes_matter_and_robots_of_a_batch_have_their_own():
    """Each does what it does alone."""
    robot = legs(Reflexes(("strain", "tilt"), gain=0.2))
    points = np.stack([robot.start, weighted(robot, 1), weighted(robot, 2)])
    together = simulate(robot, points).distance
    assert np.ptp(together) > 1e-5
    assert np.array_equal(together, [simulate(robot, point[None]).distance[0] for point in points])


def test_a_design_is_written_and_read(tmp_path):
    """Its weights are fixed then; nothing is free of it."""
    robot = legs(Reflexes(("light", "clock"), (2,), light=(0.2, 0.0)))
    again = robot_of_record(json.loads(json.dumps(robot.describe())))
    assert again.reflexes == robot.reflexes and list(again.free) == list(robot.free)
    point = weighted(robot)
    robot.save(point, tmp_path / "best.json")
    best = load_robot(tmp_path / "best.json")
    assert not best.free and best.reflexes.weights == tuple(robot.weights_of(point[None])[0])
    save_robot(legs(), tmp_path / "plain.json")
    assert "reflexes" not in json.loads((tmp_path / "plain.json").read_text())
    assert ("Reflexes", "feels light and clock, 2 hidden nodes") in robot.facts()


def felt(name: str, positions=None, turned=None, strains=None, ground=None, before=None, light=None):
    """What a robot feels by one sense, on level ground, uneven ground, or without any (False)."""
    robot = legs()
    at = robot.body.start_positions[None] if positions is None else positions
    quaternions = np.tile([1.0, 0, 0, 0], (1, at.shape[1], 1)) if turned is None else turned
    links = len(robot.body.topology.links)
    now = Felt(at, quaternions, np.zeros((1, links)) if strains is None else strains)
    lights = None if light is None else np.array([light])
    floor = [ground] if isinstance(ground, Relief) else ground is None
    anatomy = Anatomy.of(robot.body, (0, 1, 2), robot.length, floor, lights)
    return LatticeReader((name,), anatomy, at if before is None else before).read(3, now)[0]


def test_senses_feel_what_they_say():
    """Touch, tilt, velocity, light and the clock, by hand."""
    robot = legs()
    start = robot.body.start_positions[None]
    assert felt("touch") == pytest.approx([1, 1, 1])
    assert felt("touch", start + np.array([0, 0, 0.001])) == pytest.approx(np.exp([-1, -1, -1]))
    raised = Relief(np.full((2, 2), 0.02), 10.0, (-5.0, -5.0))
    assert felt("touch", start + np.array([0, 0, 0.021]), ground=raised) == pytest.approx(np.exp([-1, -1, -1]))
    lean = np.tile([np.cos(0.1), 0, np.sin(0.1), 0], (1, start.shape[1], 1))  # 0.2 rad about y
    assert felt("tilt", turned=lean) == pytest.approx([np.sin(0.2), 0])
    moved = start - np.array([0.03, 0, 0])
    assert felt("velocity", before=moved) == pytest.approx([0.03 / robot.length * 16, 0])
    assert felt("slip", before=moved) == pytest.approx([0.03 / robot.length * 16] * 3, rel=1e-4)
    assert felt("slip") == pytest.approx([0, 0, 0], abs=1e-12)
    above = np.array([0, 0, 0.001])
    assert felt("slip", start + above, before=moved) == pytest.approx(np.exp(-1) * felt("slip", before=moved), rel=1e-3)
    for name in ("touch", "slip"):
        assert felt(name, before=moved, ground=False).tolist() == [0, 0, 0]
    bright = felt("light", light=(10 * robot.length, 0.0))
    assert bright == pytest.approx([1 / 101] * 3, rel=0.2) and np.ptp(bright) > 0
    assert felt("clock") == pytest.approx([1, 0], abs=1e-12)
    assert felt("strain") == pytest.approx([0, 0, 0])


def test_slip_is_along_the_ground():
    """On a ramp up a plane as on the floor; what leads off the ground does not count."""
    robot, slope = legs(), np.radians(30)
    start = robot.body.start_positions[None]
    ramp = Relief(10 * np.tan(slope) * np.array([[-0.5, -0.5], [0.5, 0.5]]), 10.0, (-5.0, -5.0))
    up, side, off = np.array([[np.cos(slope), 0, np.sin(slope)], [0, 1, 0], [-np.sin(slope), 0, np.cos(slope)]])
    on = start * [1, 1, 0]
    on[..., 2] = np.tan(slope) * on[..., 0] + 0.5 * robot.body.voxel_size * (1 / np.cos(slope) - 1)
    for way, along in ((0.03 * up, 0.03), (0.03 * up - 0.04 * side, 0.05), (0.03 * up + 0.02 * off, 0.03)):
        found = felt("slip", on, before=on - way, ground=ramp)
        assert found == pytest.approx([along / robot.length * 16] * 3, rel=1e-3)
    assert felt("slip", on, before=on - 0.02 * off, ground=ramp) == pytest.approx([0, 0, 0], abs=1e-9)
    level, ways = Relief(np.zeros((2, 2)), 10.0, (-5.0, -5.0)), np.random.default_rng(0).normal(size=start.shape) * 1e-3
    assert np.array_equal(felt("slip", before=start - ways, ground=level), felt("slip", before=start - ways))


def reader_of(*names: str, robots: int = 1, floor: bool | list[Relief] = True, **given) -> LatticeReader:
    """Reads senses of legs that were put elsewhere."""
    robot = legs()
    anatomy = Anatomy.of(robot.body, (0, 1, 2), robot.length, floor, np.array([[0.1, 0.03]]))
    first = np.tile(robot.body.start_positions + 0.02, (robots, 1, 1))
    return LatticeReader(names, anatomy, first, **given)


def test_acceleration_is_that_of_a_fall():
    """In lengths a cycle^2: -g along z before a body touches, 0 at a constant speed and at the first two readings."""
    robot, span = legs(), 1 / (16 * 4.0)  # s between readings
    still, speed = robot.body.start_positions, np.array([0.3, -0.2, 0.5])
    rest = np.zeros((1, len(still), 4)), np.zeros((1, len(robot.body.topology.links)))
    for gravity in (np.array([0, 0, -9.81]), np.zeros(3)):
        reader = reader_of("acceleration")
        for number in range(5):
            time = number * span
            felt = reader.read(number, Felt((still + speed * time + gravity * time * time / 2)[None], *rest))
            expected = gravity / 4.0**2 / robot.length if number > 1 else np.zeros(3)
            assert felt[0] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("uneven", [False, True])
def test_what_readings_remember_has_derivatives(uneven):
    """Through both readings before, of each sense alone, also where nothing depends on a reading."""
    rng, robot = np.random.default_rng(0), legs()
    hills = [Relief(rng.normal(size=(9, 9)) * 0.3 - 0.5, 1.0, (-4.0, -4.0)) for _ in range(2)]
    count, links = robot.body.voxel_count, len(robot.body.topology.links)
    shapes, heard = ((2, count, 3), (2, count, 4), (2, links)), (0, 2, 3, 5)
    given = [[rng.normal(size=shape) for shape in shapes] for _ in range(6)]
    along = [[rng.normal(size=shape) for shape in shapes] for _ in range(6)]
    for name in EVERY:
        reader = reader_of(name, robots=2, floor=hills if uneven else True)
        seeds = rng.normal(size=(6, *reader.read(0, Felt(*given[0])).shape))

        def cost(step, reader=reader, seeds=seeds):
            felt = [
                reader.read(number, Felt(*(x + step * d for x, d in zip(now, ways, strict=True))))
                for number, (now, ways) in enumerate(zip(given, along, strict=True))
            ]
            return sum((seeds[number] * felt[number]).sum() for number in heard)

        expected = (cost(1e-6) - cost(-1e-6)) / 2e-6
        cost(0.0)
        found = 0.0
        for number in reversed(range(6)):
            back = reader.pull_back(number, seeds[number] if number in heard else None)
            found += sum((got * way).sum() for got, way in zip(vars(back).values(), along[number], strict=True))
        assert found == pytest.approx(expected, rel=1e-6, abs=1e-6), name


def test_a_sense_is_one_entry_of_the_table(monkeypatch):
    """Its width, its reading and its name follow; without a reading there is none."""
    sense = Sense("height of the middle [m]", lambda parts: 1, lambda moment: moment.positions.mean(axis=1)[:, 2:])
    monkeypatch.setitem(SENSES, "height", sense)
    assert Reflexes(("clock", "height")).width(legs().body, (0, 1, 2)) == 3
    assert felt("height", legs().body.start_positions[None] + [0, 0, 0.5]) == pytest.approx([0.5])
    with pytest.raises(TypeError, match="read"):
        Sense("nothing", lambda parts: 1)


@pytest.mark.parametrize("name", EVERY)
def test_a_sense_is_as_wide_as_it_says(name):
    """In the table and at a reading."""
    assert len(felt(name, light=(0.1, 0.0))) == Reflexes((name,)).width(legs().body, (0, 1, 2))


@pytest.mark.kernels
def test_a_fluid_has_no_ground_to_touch():
    """Neither where robots swim by reflexes nor in environments."""
    robot, water = legs(Reflexes(("touch", "slip"))), Terrain.water()
    readings = robot.felt_over_time(weighted(robot)[None], water, Compute(threads=1))
    assert readings.shape[:2] == (1, 6) and not readings.any()
    episodes = Episodes(robot, water, 1, ("touch", "slip"), Compute(threads=1))
    assert not episodes.begin().any()


@pytest.mark.kernels
def test_what_is_felt_may_be_noisy_and_late():
    """Noise is drawn with the robot's seed, alike for all robots; what is late by all readings is not felt at all."""
    point = weighted(legs(Reflexes(("strain", "touch"))))

    def moved(points=point[None], seed=0, **late):
        return simulate(legs(Reflexes(("strain", "touch"), **late), seed=seed), points).distance

    assert moved()[0] != moved(noise=0.1)[0] == moved(noise=0.1)[0] != moved(seed=1, noise=0.1)[0]
    assert moved(np.tile(point, (2, 1)), noise=0.1).tolist() == [moved(noise=0.1)[0]] * 2
    assert len({moved(delay=delay)[0] for delay in (0, 1, 2)}) == 3
    assert Reflexes(("strain",), delay=2).spoken == "feels strain, 2 readings late"


@pytest.mark.kernels
def test_the_light_may_be_the_terrains():
    """It is felt and aimed at like the reflexes' own, ahead of a robot that heads somewhere."""
    own, felt = (Reflexes(("light", "clock"), light=light) for light in ((0.05, 0.02), None))
    points = weighted(legs(own))[None]
    there = simulate(dataclasses.replace(legs(own), target=(0.05, 0.02)), points)
    given = simulate(legs(felt), points, Terrain.parse("flat+light:0.05,0.02"))
    assert there.distance[0] == given.distance[0]
    assert there.measures["remaining"][0] == given.measures["remaining"][0] > 0
    assert "remaining" in [each.name for each in legs(felt).measures]
    assert legs(felt, heading=90.0).light_in(Terrain(light=(2.0, 1.0))) == pytest.approx((-1.0, 2.0))


@pytest.mark.kernels
@pytest.mark.parametrize("names", [(), ("remaining",)])
def test_worlds_that_differ_in_their_light_make_one_batch(names):
    """With the bits of one world after the other."""
    robot = legs(Reflexes(("light", "clock"), (3,)))
    worlds = [Terrain(2.0, light=light) for light in ((0.05, 0.02), (0.04, -0.03), (-0.05, 0.0))]
    points = np.stack([weighted(robot, 1), weighted(robot, 2)])
    trial = Trial(worlds[0], Compute(threads=1), gradients=names)
    together = robot.run_in(points, worlds, trial)
    for world, found in zip(worlds, together, strict=True):
        alone = robot.run(points, dataclasses.replace(trial, world=world))
        assert (found.measures["remaining"] == alone.measures["remaining"]).all() and found.status.tolist() == [
            "ok"
        ] * 2
        for name in names:
            np.testing.assert_allclose(found.gradients[name], alone.gradients[name], rtol=1e-9, atol=1e-12)
    assert len({each.measures["remaining"][0] for each in together}) == 3


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Reflexes(("smell",)), "senses: 'smell'"),
        (lambda: Reflexes(()), r"senses: \(\) is not allowed; give one or more of strain"),
        (lambda: Reflexes(("tilt", "tilt")), "senses: .* none twice"),
        (lambda: Reflexes(("tilt",), (0,)), "hidden: 0"),
        (lambda: Reflexes(("tilt",), gain=-1.0), "gain: -1"),
        (lambda: Reflexes(("tilt",), noise=-1.0), "noise: -1"),
        (lambda: Reflexes(("tilt",), delay=16), "delay: 16"),
        (lambda: Reflexes(("tilt",), 8), "hidden: 8 is not allowed"),
        (lambda: Reflexes(("light",), light=(1.0, np.nan)), "light: nan"),
        (lambda: Reflexes(("light",), light=5), "light: 5 is not allowed"),
        (lambda: Reflexes(("tilt",), weights=3.0), "weights: 3.0 is not allowed"),
        (lambda: legs(Reflexes(("light",))).on(Terrain()), r"light: flat has none to feel; give one, as flat\+light:"),
        (lambda: Reflexes(("tilt",), light=(1.0, 0.0)), "light: .* is not allowed without the sense light"),
        (lambda: legs(Reflexes(("tilt",), weights=(1.0, 2.0))), "weights: 2 are not allowed; give 9"),
        (lambda: legs(Reflexes(("tilt",), weights=(np.nan,) * 9)), "weights: nan"),
        (
            lambda: dataclasses.replace(legs(), drives=(Drive("rub", (0,), "friction"),), reflexes=Reflexes()),
            "reflexes: no drive",
        ),
    ],
)
def test_bad_input(make, message):
    """One line each."""
    with pytest.raises(ValueError, match="^" + message):
        make()


def test_reflexes_have_no_table_for_a_rig():
    """They decide while the robot moves."""
    robot = legs(Reflexes(("tilt",)))
    assert not robot.has_table and legs().has_table
    with pytest.raises(ValueError, match=r"^robot: one with reflexes has no table of channels"):
        robot.table()
