"""What motions are worth: measures of made-up records, whose values are known, and of robots."""

import dataclasses

import numpy as np
import pytest
from made_records import BAR, EDGE, MODULUS, RUBBER, recorded

from optim.problems.robot import RobotProblem
from robots.control.cyclic import LAST_CYCLE
from robots.freeform import FreeformActuation, FreeformRobot, Grid, Palette, Tissue
from robots.lattice_robot import Drive, Free, LatticeRobot, load_robot
from robots.lattice_robot.measures import measure
from robots.lattice_robot.robustness import STARTS, trust_in
from robots.lattice_robot.simulation import simulate
from robots.lattice_robot.squeeze import squeezed_forces
from robots.robot import Trial
from robots.trust import FINER, Trust
from robots.world import Terrain
from taichi_sim.base.compute import Compute
from taichi_sim.lattice import LatticeBody, LatticeEngine, ProgramBuilder, Quantity, body_from_array


def test_speed_is_that_of_the_centre_of_mass():
    constants, record = recorded(density=[1e3, 1e3, 2e3])
    record.positions[0, 1] += [[0.01, 0.5, 0.0], [0.01, 0.0, 0.2], [0.03, 0.0, 0.0]]
    assert measure("distance", record, constants)[0] == pytest.approx(0.02)
    assert measure("speed", record, constants)[0] == pytest.approx(0.02 / 0.03 / 0.5)


def test_a_jump_is_the_highest_centre_of_mass_in_the_last_cycle():
    constants, record = recorded()
    record.positions[0, 0, :, 2] += 9.0  # before the last cycle
    record.positions[0, LAST_CYCLE.start + 5, :, 2] += 0.02
    record.positions[0, LAST_CYCLE.start + 6, 0, 2] += 0.03
    assert measure("jump", record, constants)[0] == pytest.approx(0.02)


@pytest.mark.kernels
@pytest.mark.parametrize("frequency", [1.0, 2.0])
def test_a_hop_between_the_nodes_of_a_cycle_counts(frequency):
    """A block that its muscles throw up is at its highest a while after the node at which they stop."""
    block = LatticeBody(np.argwhere(np.ones((2, 2, 3))), (RUBBER,), np.zeros(12, int), EDGE)
    legs = Drive("legs", (0,), amplitude=0.3, knots=(0.0,) * 4 + (1.0,) * 4 + (0.0,) * 8)
    robot = LatticeRobot(block, (legs,), frequency=frequency, cycles=1)
    found = robot.simulate(np.zeros((1, 0)), Terrain(), record_every=1)
    cycle = 16 * robot.cycle.segment
    heights = found.frames["positions"][-cycle - 1 :, 0, :, 2].mean(axis=1) - block.start_positions[:, 2].mean()
    assert heights[:: robot.cycle.segment].max() < 0.97 * heights.max()
    assert found.measures["jump"][0] == pytest.approx(heights.max(), rel=0.04)
    assert found.measures["jump"][0] >= heights[:: robot.cycle.segment].max()


@pytest.mark.kernels
@pytest.mark.parametrize("heading", [0.0, 30.0])
@pytest.mark.parametrize("shape", [(1, 1, 1), (3, 3, 2)])
def test_a_robot_that_does_nothing_stays_where_it_is(shape, heading):
    """Feet that carry nothing yet do not creep, as they would if rounding pulled the robot aside."""
    soft = dataclasses.replace(RUBBER, youngs_modulus=1e4)
    body = LatticeBody(np.argwhere(np.ones(shape)), (soft,), np.zeros(np.prod(shape), int), EDGE)
    robot = LatticeRobot(body, (Drive("still", (0,), amplitude=0.0),), frequency=2.0, cycles=1, heading=heading)
    found = robot.simulate(np.zeros((1, 0)), Terrain(), record_every=50)
    places = found.frames["positions"][..., :2]
    assert np.ptp(places.mean(axis=-2), axis=0).max() < 1e-12


@pytest.mark.parametrize("degrees", [-170.0, -20.0, 0.0, 35.0])
def test_turning_is_the_angle_of_a_rigid_motion(degrees):
    constants, record = recorded(density=[1e3, 2e3, 1e3])
    cosine, sine = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    record.positions[0, LAST_CYCLE.stop - 1] = BAR.start_positions @ turn.T + [0.3, -0.1, 0.2]
    assert measure("turning", record, constants)[0] == pytest.approx(4 * degrees)


def test_energy_is_the_positive_work_against_the_links():
    constants, record = recorded()
    stiffness, squeeze, growth = MODULUS * EDGE**2, 0.1, 0.002
    record.strains[0, LAST_CYCLE, 0] = -squeeze  # a link under pressure lengthens, then shortens again
    record.sizes[0, LAST_CYCLE.start + 4 : LAST_CYCLE.start + 9, :2, 0] += growth
    assert measure("energy", record, constants)[0] == pytest.approx(stiffness * squeeze * growth)
    record.strains[0, LAST_CYCLE, 0] = squeeze  # a link under tension: now shortening is work
    assert measure("energy", record, constants)[0] == pytest.approx(stiffness * squeeze * growth)
    record.strains[:] = 0.0
    assert measure("energy", record, constants)[0] == 0.0


def test_energy_is_a_measure_of_robots_with_muscles():
    """What friction or pressure does is not counted, so it would be 0, and free, as an objective."""
    muscles, feet = Drive("muscles", (0,), amplitude=0.1), Drive("feet", (0,), "friction", mean=0.5, amplitude=0.1)
    warm = Drive("warmth", (0,), "temperature", amplitude=0.1)
    for drives, has in (((muscles, feet), True), ((warm,), True), ((feet,), False)):
        robot = LatticeRobot(BAR, drives)
        for measures in (robot.measures, robot.measures_in([Terrain()])):
            assert ("energy" in [each.name for each in measures]) is has
    searched = dataclasses.replace(feet, amplitude=Free(0.0, 0.1))
    with pytest.raises(
        ValueError, match=r"^objective: 'energy' is unknown; choose one of the measures: speed, distance"
    ):
        RobotProblem(LatticeRobot(BAR, (searched,)), objective=("minimise:energy",))


def test_payload_is_what_nothing_drives():
    constants, record = recorded(density=[1e3, 2e3, 4e3], driven=[1.0, 0.5, 0.0])
    assert measure("mass", record, constants)[0] == pytest.approx(7e3 * EDGE**3)
    assert measure("payload", record, constants)[0] == pytest.approx(5e3 * EDGE**3)


def test_remaining_is_the_way_to_the_target():
    constants, record = recorded(target=(0.05, 0.02))
    assert "remaining" in constants.names
    record.positions[0, 1] += [0.01, 0.05, 0.0]
    assert measure("remaining", record, constants)[0] == pytest.approx(np.hypot(0.04, 0.03))


def test_remaining_to_a_light_counts_from_the_middle_of_the_voxels():
    """A light lies from there, so an uneven robot whose centre of mass is on it has nothing left."""
    constants, record = recorded(density=[1e3, 2e3, 3e3], target=(0.02, 0.0), is_light=True)
    centre = (np.array([1.0, 2.0, 3.0]) / 6) @ BAR.start_positions[:, 0]
    record.positions[0, 1, :, 0] += BAR.start_positions[:, 0].mean() + 0.02 - centre
    assert measure("remaining", record, constants)[0] == pytest.approx(0.0, abs=1e-15)
    counted_from_mass = dataclasses.replace(constants, is_light=False)
    assert measure("remaining", record, counted_from_mass)[0] == pytest.approx(centre - 0.01)
    even, record = recorded(density=[600.1] * 3, target=(0.0217, 0.01), is_light=True)
    same = dataclasses.replace(even, is_light=False)
    assert measure("remaining", record, even)[0] == measure("remaining", record, same)[0]


@pytest.mark.kernels
def test_an_uneven_robot_is_as_far_from_a_light_as_the_light_is_shown():
    """It lies still: the light is placed from the middle of its voxels, what remains is from its centre of mass."""
    heavy = dataclasses.replace(RUBBER, density=8e3, name="heavy")
    body = LatticeBody(np.argwhere(np.ones((8, 2, 1))), (RUBBER, heavy), [0] * 12 + [1] * 4, EDGE)
    robot = LatticeRobot(body, (Drive("still", (1,)),), settling=0.05, cycles=1)
    found = simulate(robot, terrain=Terrain.parse("flat+light:0.1,0"))
    densities, x = np.array([1e3] * 12 + [8e3] * 4), body.start_positions[:, 0]
    centre = densities @ x / densities.sum()
    assert found.measures["remaining"][0] == pytest.approx(x.mean() + 0.1 - centre, abs=1e-4)
    aimed = simulate(dataclasses.replace(robot, target=(0.1, 0.0)))
    assert aimed.measures["remaining"][0] == pytest.approx(0.1, abs=1e-4)


def robot(**settings):
    array = np.ones((4, 2, 2), int)
    array[1:3, :, 0] = 0
    regions = np.arange(16).reshape(array.shape) % 2
    body = body_from_array(array, (RUBBER,), EDGE, regions=regions)
    given = {"cycles": 1, "frequency": 12.0, "settling": 0.02} | settings
    return LatticeRobot(body, (Drive("legs", (0, 1), amplitude=0.15, phase=(0.1, 0.4)),), **given)


@pytest.mark.kernels
def test_robots_tell_all_their_measures():
    made_robot = robot(target=(0.1, 0.0), reference_length=0.08)
    found = made_robot.simulate((), Terrain()).measures
    assert set(found) == {m.name for m in made_robot.measures} and "remaining" in found
    assert found["mass"][0] == pytest.approx(12 * 1e3 * EDGE**3) and found["payload"][0] == 0
    assert found["energy"][0] > 0
    assert found["speed"][0] == pytest.approx(found["distance"][0] / 0.08 * 12)


@pytest.mark.kernels
def test_what_no_temperature_swells_is_payload_also_in_a_file_of_voxels(tmp_path):
    """Regions of such a file are told apart by phase alone, so that passive voxels share those of active ones."""
    passive = dataclasses.replace(RUBBER, density=2e3)
    array = np.array([[[1, 2]], [[2, 2]], [[1, 2]]])
    swollen = LatticeRobot(
        body_from_array(array, (RUBBER, passive), EDGE, regions=array - 1),
        (Drive("legs", (0,), amplitude=0.1),),
        **{"cycles": 1, "frequency": 12.0, "settling": 0.02},
    )
    swollen.save_voxels(tmp_path / "legs.vxa")
    heated = load_robot(tmp_path / "legs.vxa")
    warm = {drive.quantity for drive in heated.drives}
    both = [each.simulate((), Terrain()).measures["payload"][0] for each in (swollen, heated)]
    assert warm == {"temperature"} and both == pytest.approx([4 * 2e3 * EDGE**3] * 2)


@pytest.mark.kernels
@pytest.mark.parametrize("things", ["", "+light:0.1,0.05", "+light:0.1,0.05+box:0.02,0.02,0.02,0.1,0"])
def test_people_are_told_all_that_the_world_adds(things):
    outcome = robot().simulate((), Terrain.parse(f"flat{things}"))
    told = [each.split()[:-2] for each in robot().spoken(outcome).split(", ")]
    assert [" ".join(name) for name in told] == [name.replace("_", " ") for name in outcome.measures]


@pytest.mark.kernels
def test_noise_is_the_same_for_all_points_and_differs_by_seed():
    speeds = [robot(perturbation=1e-5, seed=seed).simulate((), Terrain()).measures["speed"][0] for seed in (0, 0, 1)]
    assert speeds[0] == speeds[1] != speeds[2]
    assert speeds[0] != robot().simulate((), Terrain()).measures["speed"][0]


@pytest.mark.kernels
def test_trust_is_told_for_people_and_machines():
    trust = trust_in(robot(), Terrain(), compute=Compute())
    assert len(trust.speeds) == STARTS and np.ptp(trust.speeds) > 0
    others = [*(f"{p:g} of the friction" for p in (0.5, 0.625, 0.75, 0.875)), "half the time step", "balanced links"]
    assert list(trust.changed) == others
    document = robot().judge(Terrain(), compute=Compute()).document
    assert document["speeds"] == trust.speeds.tolist() and document["kept"] == trust.kept
    plain = robot()
    balanced = dataclasses.replace(plain, body=dataclasses.replace(plain.body, links="balanced"))
    assert balanced.simulate((), Terrain()).measures["speed"][0] != plain.simulate((), Terrain()).measures["speed"][0]
    assert list(trust_in(balanced, Terrain(), compute=Compute()).changed) == others[:-1]
    water = trust_in(robot(), Terrain.water(), compute=Compute())
    assert list(water.changed) == ["half the time step"]


@pytest.mark.kernels
def test_a_part_of_the_friction_is_that_of_driven_friction_too():
    labels = np.arange(6).repeat(4).reshape(6, 2, 2) // 2
    waves = {"regions": (0, 1, 2), "quantity": "friction", "phase": (0.25, 0.0, 0.75)}

    def inchworm(part):
        static, kinetic = part * RUBBER.static_friction, part * RUBBER.kinetic_friction
        rubber = dataclasses.replace(RUBBER, static_friction=static, kinetic_friction=kinetic)
        body = body_from_array(np.ones((6, 2, 2), int), rubber, EDGE, regions=labels)
        feet = Drive("feet", mean=0.6 * part, amplitude=(0.5 * part, 0.1 * part, 0.5 * part), **waves)
        muscle = Drive("muscle", (1,), amplitude=0.2)
        return LatticeRobot(body, (muscle, feet), cycles=1, settling=0.1, perturbation=1e-6, seed=1)

    trust = trust_in(inchworm(1.0), Terrain(), seed=1, compute=Compute())
    assert trust.changed["0.5 of the friction"] == simulate(inchworm(0.5), [[]]).measures["speed"][0] != trust.speeds[0]


def test_trust_names_what_breaks_a_robot():
    trust = Trust(np.array([1.0, 0.9, 1.1]), {"ice": 0.1, "sand": 0.6, "half the time step": 0.8})
    assert trust.kept == pytest.approx(0.6) and trust.broken_by == ("ice",)
    assert "less than half with ice" in trust.judgement.text and not trust.judgement.failed
    assert dataclasses.replace(trust, speeds=np.zeros(3)).judgement.failed


def test_a_robot_that_goes_backwards_is_trusted_as_its_mirror_image_is():
    forwards = Trust(np.array([1.0, 0.9, 1.1]), {"ice": 0.1, "sand": 0.6, "half the time step": -0.8})
    backwards = Trust(-forwards.speeds, {name: -speed for name, speed in forwards.changed.items()})
    assert backwards.kept == forwards.kept
    assert backwards.broken_by == forwards.broken_by == ("ice", "half the time step")
    assert backwards.judgement.failed is forwards.judgement.failed
    steady = Trust(np.array([-0.0841]), {"0.5 of the friction": -0.0879, "half the time step": -0.0850}, (FINER,))
    assert steady.kept > 1 and not steady.broken_by and not steady.judgement.failed
    for way in (1, -1):
        guess = Trust(way * np.array([0.02, 0.03, 0.04]), {FINER: way * 0.058, "ice": way * 0.09}, (FINER,))
        assert guess.unsettled_by == ("half the time step",) and not steady.unsettled_by
        assert "; more than half as fast again with half the time step, so" in guess.judgement.text


def squeezing(ratio, fixed=None, cycles=1, **fields):
    """A block of 5 x 5 x 5 voxels of a Poisson's ratio that swells and shrinks by 5 %."""
    rubber = dataclasses.replace(RUBBER, poissons_ratio=ratio)
    voxels = np.argwhere(np.ones((5, 5, 5)))
    body = LatticeBody(voxels, (rubber,), [0] * len(voxels), EDGE, fixed=fixed)
    return LatticeRobot(body, (Drive("all", (0,), amplitude=0.05, phase=0.1, **fields),), settling=0.1, cycles=cycles)


@pytest.mark.kernels
@pytest.mark.parametrize("ratio", [0.0, 0.3, 0.45])
def test_energy_of_a_held_cube_is_that_of_hooke(ratio):
    """All strains are those of the muscles, so stress is E / (1 - 2 nu) of them along each axis."""
    robot = squeezing(ratio, fixed=np.ones((125, 6), bool))
    work = MODULUS / (1 - 2 * ratio) * 0.05**2 * len(robot.body.topology.links) * EDGE**3
    assert simulate(robot).measures["energy"][0] == pytest.approx(work, rel=0.08)


@pytest.mark.kernels
def test_energy_with_a_poissons_ratio_has_the_engines_forces_and_gradients():
    """Of a free body, whose links along an axis may be one: differences of an amplitude, and of a modulus."""
    rubber = dataclasses.replace(RUBBER, poissons_ratio=0.3)
    soft = dataclasses.replace(rubber, youngs_modulus=4e4, poissons_ratio=0.1, name="soft")
    voxels = np.argwhere(np.ones((4, 2, 1)))
    body = LatticeBody(voxels, (rubber, soft), [0] * 4 + [1] * 4, EDGE)
    drives = (Drive("a", (0,), amplitude=Free(0.0, 0.2, 0.1), phase=0.1),)
    robot = LatticeRobot(body, drives, {"soft": Free(2e4, 8e4, 4e4)}, settling=0.05, cycles=1, frequency=20.0)
    trial = Trial(Terrain.water(), Compute(), gradients=("energy",))
    start = np.array(robot.start)
    slope = robot.run(start[None], trial).gradients["energy"][0]
    for place, step in ((0, 1e-6), (1, 1.0)):
        moved = np.array([start + step * np.eye(2)[place], start - step * np.eye(2)[place]])
        above, below = robot.run(moved, dataclasses.replace(trial, gradients=())).measures["energy"]
        assert slope[place] == pytest.approx((above - below) / (2 * step), rel=1e-4)


@pytest.mark.kernels
def test_forces_with_a_poissons_ratio_are_alike_along_a_held_bar():
    """Of two unlike materials, one of which swells: at rest each of its links carries the same."""
    rubber = dataclasses.replace(RUBBER, poissons_ratio=0.3)
    soft = dataclasses.replace(rubber, youngs_modulus=4e4, poissons_ratio=0.1, name="soft")
    fixed = np.zeros((8, 6), bool)
    fixed[[0, 7]] = True
    body = LatticeBody([(x, 0, 0) for x in range(8)], (rubber, soft), [0] * 4 + [1] * 4, EDGE, fixed=fixed)
    engine = LatticeEngine(body, self_contact=False, threads=1)
    swollen = ProgramBuilder(1)
    swollen.set(Quantity.SCALE, 1.05, regions=[0])
    strains = engine.run(swollen.build(5000, [[5000]])).strains
    index = body.material_index[None]
    modulus, ratio = np.array([1e5, 4e4])[index], np.array([0.3, 0.1])[index]
    forces = squeezed_forces(body, strains, modulus, ratio, False)[0, 0]
    assert forces == pytest.approx(forces.mean(), rel=1e-6) and forces.mean() < -0.1
    assert np.ptp(strains) > 0.01


@pytest.mark.kernels
def test_a_heading_on_level_ground_leaves_a_body_with_a_poissons_ratio_as_it_is():
    """The sines of 180 and 90 degrees are 0 but for rounding, and a voxel asks whether anything pulls along an axis."""
    rubber = dataclasses.replace(RUBBER, poissons_ratio=0.45)
    body = LatticeBody(np.argwhere(np.ones((6, 4, 2))), (rubber,), np.zeros(48, int), EDGE, regions=np.arange(48) // 24)
    muscles = Drive("muscles", (0, 1), amplitude=0.2, phase=(0.07, 0.3), axes="xy")
    alike, *others = (
        LatticeRobot(body, (muscles,), settling=0.1, cycles=1, heading=heading).simulate(
            np.zeros((1, 0)), Terrain(), record_every=500
        )
        for heading in (0.0, 90.0, 200.0)
    )
    for other in others:
        np.testing.assert_array_equal(other.frames["positions"], alike.frames["positions"])
        assert other.measures["energy"] == alike.measures["energy"]


@pytest.mark.kernels
@pytest.mark.parametrize("sharpness", [np.inf, 1.5])
def test_masses_have_the_bits_of_a_batch_of_one(sharpness):
    """Of cells of several densities, which are no round numbers."""
    kinds = (1033.7, True), (1471.3, False)
    tissues = [Tissue(dataclasses.replace(RUBBER, density=density), muscle) for density, muscle in kinds]
    muscles = FreeformActuation(amplitude=0.25, cycles=1, settling=0.0, frequency=50.0)
    robot = FreeformRobot(Grid((5, 4, 3)), palette=Palette(tuple(tissues)), actuation=muscles)
    low, high = np.array([(each.low, each.high) for each in robot.parameters]).T
    points = np.tile(low + (high - low) * np.random.default_rng(0).uniform(0.35, 0.9, len(low)), (5, 1))
    strong = [number for number, each in enumerate(robot.parameters) if "amplitude" in each.name]
    points[:, strong] *= np.linspace(0.8, 1.0, 5)[:, None]  # all have the same cells
    trial = Trial(Terrain(), sharpness=sharpness)
    together = robot.run(points, trial).measures
    for row, point in enumerate(points):
        alone = robot.run(point[None], trial).measures
        assert all(alone[name][0] == together[name][row] for name in ("mass", "payload"))
