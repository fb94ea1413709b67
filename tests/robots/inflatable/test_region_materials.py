"""What a robot's regions are made of, paces and core pressures of columns: descriptions, files, tables, programs."""

import dataclasses
import json

import numpy as np
import pytest
from graded import QUICK, TINY, TINY_TWO, tabled
from program_values import values_after

from robots.hardware import PneumaticRig, export_csv, gait_table, read_csv
from robots.inflatable import InflatableDesign, load_design, save_design
from robots.inflatable.body import PUBLISHED, bodies_of
from robots.inflatable.journeys import Leg, simulate_journey
from robots.inflatable.materials import RegionMaterials
from robots.inflatable.program import build_program
from robots.inflatable.robot import InflatableRobot
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.simulation import checked_designs
from robots.inflatable.timing import approach, gait_timeline, play
from robots.world import Terrain
from taichi_sim.lattice import Quantity

FEET = ((1.5, 1.2), (0.2, 0.1))
MADE = RegionMaterials(FEET, (0.9,) * 13, ((1.05,) * 13, (0.95,) * 13))


def gait(**tables):
    return tabled(np.full((8, 2), 0.5), np.ones((2, 2)), **tables)


def design(materials=MADE, pressure=2e3, **tables):
    made = dataclasses.replace(gait(settle_steps=[5, 6]), **tables)
    return InflatableDesign(pressure, 30.0, made, materials)


def test_files_keep_materials_and_pace(tmp_path):
    pace = np.linspace(0.1, 1, 16).reshape(8, 2)
    for given in (
        design(),
        design(RegionMaterials(friction=FEET), pace=pace),
        design(None, pace=pace),
        InflatableDesign(0.0, 0.0, GaitSchedule(np.eye(10)[:, :3]), RegionMaterials(modulus=(1.1,) * 13)),
    ):
        save_design(given, tmp_path / "gait.json")
        assert load_design(tmp_path / "gait.json") == given
        form = json.loads((tmp_path / "gait.json").read_text())["format"]
        assert form == ("morpholab-graded-design-1" if given.materials is None else "morpholab-inflatable-design-2")
    assert design(RegionMaterials()) != design()
    save_design(design(RegionMaterials(), pace=None), tmp_path / "plain.json")
    assert "materials" not in (tmp_path / "plain.json").read_text()


def test_core_pressures_of_each_core_come_back_from_files(tmp_path):
    several = design(None, (1e3, 2e3), core_pressure=np.array([[1e3, 2e3], [3e3, 4e3]]))
    save_design(several, tmp_path / "gait.json")
    assert load_design(tmp_path / "gait.json") == several
    assert gait_timeline(several).pressures.tolist() == [[1e3, 2e3], *[[1e3, 3e3], [2e3, 4e3]] * 2]
    assert GaitSchedule(gait().levels, core_pressure=[[5.0, 6.0]]).core_pressure.shape == (2,)


def test_tables_of_a_rig_keep_materials_and_slow_strokes_down(tmp_path):
    pace = np.full((8, 2), 0.5)
    slow, quick = design(pace=pace), design()
    export_csv(slow, tmp_path / "slow.csv", rate=None)
    table = read_csv(tmp_path / "slow.csv")
    assert table.design == slow and table.played().materials == MADE
    again = table.played().schedule
    assert again.levels == pytest.approx(slow.schedule.levels, abs=1e-6) and np.array_equal(again.pace, pace)
    seconds = [gait_table(each, PneumaticRig(), rate=None).seconds for each in (slow, quick)]
    assert seconds[0] > seconds[1]
    for cores, fine in ((np.full((2, 2), 1e3), True), (np.array([[1e3, 2e3], [3e3, 4e3]]), False)):
        several = InflatableRobot(design(None, (1e3, 1e3), core_pressure=cores), "two-core")
        assert several.has_table == fine
        if fine:
            assert gait_table(several.gait, rate=None).design.schedule.core_pressure.shape == (2,)
        else:
            with pytest.raises(ValueError, match=r"^core_pressure: 2 rows are not allowed; a rig has one line"):
                gait_table(several.gait, rate=None)


def test_a_pace_stretches_strokes_exactly():
    level, half = np.full(8, QUICK.deflated), np.full(8, 0.5)
    whole, slow = (approach(level, half, False, QUICK, pace) for pace in (None, np.full(8, 0.4)))
    assert np.array_equal(whole.ends, slow.ends)
    times = [motion.moving + motion.arrival for motion in (whole, slow)]
    assert times[1] == pytest.approx(times[0] / 0.4, rel=1e-12)
    ones = dataclasses.replace(gait(), pace=np.ones((8, 2)))
    assert [c.motion_steps for c in play(ones, QUICK)[0]] == [c.motion_steps for c in play(gait(), QUICK)[0]]


def test_programs_say_friction_and_sizes():
    program = build_program([design()], Terrain(), QUICK, None, PUBLISHED)
    events = program.events
    assert values_after(program, 0, 2, Quantity.KINETIC_FRICTION, np.array([1]))[0] == FEET[0][0]
    feet = events[(events["region"] == 3) & (events["quantity"] == Quantity.STATIC_FRICTION)]["value"]
    assert set(feet[1:]) == {FEET[0][1]} and feet[0] == QUICK.high_friction
    sliding = dataclasses.replace(gait(), levels=np.concatenate([gait().inflation, np.zeros((2, 2))]))
    slid = build_program([InflatableDesign(0.0, 0.0, sliding, MADE)], Terrain(), QUICK, None, PUBLISHED).events
    assert FEET[1][0] in slid[(slid["region"] == 2) & (slid["quantity"] == Quantity.KINETIC_FRICTION)]["value"]
    for region, across in ((4, PUBLISHED.foot_seam_scale * 1.05), (0, 1.05), (5, 1.05)):
        assert values_after(program, 0, region, Quantity.SCALE, np.array([1]))[0] == pytest.approx(across)
    assert values_after(program, 0, 5, Quantity.SCALE + 2, np.array([1]))[0] == QUICK.deflated


def test_programs_in_two_parts_do_the_same():
    """Values of all channels, carried on over the cut or not, and derivatives gathered from both."""
    given = [design(core_pressure=np.array([1e3, 2e3])), design(pace=np.full((8, 2), 0.3))]
    program = build_program([dataclasses.replace(d, materials=None) for d in given], Terrain(5.0), QUICK, 50, TINY)
    cuts = program.lengths // 2
    first, rest = program.split(cuts)
    assert np.array_equal(first.lengths + rest.program.lengths, program.lengths)
    at = np.where(rest.program.snapshots < 0, first.snapshots, rest.program.snapshots + cuts[:, None])
    assert np.array_equal(at, program.snapshots) and (first.snapshots < cuts[:, None]).all()
    rates = np.zeros(len(program.events))
    for robot, cut in enumerate(cuts.tolist()):
        for region in (0, 2, 5, 12):
            for quantity in (Quantity.SCALE, Quantity.SCALE + 1, Quantity.PRESSURE, Quantity.KINETIC_FRICTION):
                steps = np.arange(cut + 1, program.lengths[robot], 7)
                whole = values_after(program, robot, region, quantity, steps)
                part = values_after(rest.program, robot, region, quantity, steps - cut)
                assert (whole is None) == (part is None) and (whole is None or whole == pytest.approx(part, rel=1e-12))
    seeds = np.random.default_rng(0).normal(size=(2, len(rest.program.events)))
    values, rates = rest.gather(*seeds)
    total = (values * program.events["value"] + rates * program.events["rate"]).sum()
    assert total == pytest.approx((seeds * [rest.program.events["value"], rest.program.events["rate"]]).sum())
    with pytest.raises(ValueError, match=r"^steps: \[-1, 0\] are not allowed; give one from 0 to each"):
        program.split([-1, 0])


def test_bodies_of_one_geometry_share_a_topology_however_many_others_were_built():
    soft = bodies_of(TINY, [(0.5,) * 13])[0]
    for number in range(70):  # more than are kept
        assert dataclasses.replace(TINY, density=1000.0 + number).body.voxel_count
    assert bodies_of(TINY, [(0.5,) * 13])[0].topology is TINY.body.topology
    assert soft.topology is not TINY.body.topology  # both bodies were built anew


def test_bodies_differ_by_their_moduli_only_where_some_have_them():
    assert bodies_of(TINY, [None, None]) == [TINY.body]
    soft, plain = bodies_of(TINY, [(0.5,) * 13, None])
    assert soft.topology is plain.topology is TINY.body.topology
    assert {m.youngs_modulus for m in soft.materials[:5]} == {TINY.youngs_modulus / 2}
    assert [m.youngs_modulus for m in plain.materials[4:6]] == [TINY.youngs_modulus, TINY.bladder_modulus]
    assert (
        len(TINY_TWO.region_names)
        == TINY_TWO.region_count
        == 18
        == len(bodies_of(TINY_TWO, [(1.0,) * 18])[0].materials)
    )


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: RegionMaterials(friction=((1.0, 1.0),)), r"friction: shape \(1, 2\) is not allowed; give 2 rows"),
        (lambda: RegionMaterials(friction=((1.0,), (0.5,))), r"friction: shape \(2, 1\) is not allowed"),
        (lambda: RegionMaterials(friction=((0.1, 1.0), (0.2, 0.1))), "friction: 0.2 of sliding foot 1 is not allowed"),
        (lambda: RegionMaterials(modulus=(1.0, 2.0)), "modulus: 2.0 is not allowed; give a number from 0.5 to 1.4"),
        (lambda: RegionMaterials(modulus=("a",)), r"modulus: \[\('a',\)\] is not allowed; give numbers from 0.5"),
        (lambda: RegionMaterials(size=((1.0,), (1.0, 2.0))), "size: .* is not allowed; give numbers from 0.85 to 1.15"),
        (lambda: RegionMaterials.of({"colour": 1}), "materials: 'colour' cannot be read"),
        (lambda: design("soft"), "materials: str is not allowed; give RegionMaterials"),
        (
            lambda: design(pace=np.zeros((8, 2))),
            "pace: 0.0 of bladder1, column 1 is not allowed; give numbers from 0.1",
        ),
        (lambda: design(core_pressure=np.full((2, 2), -1.0)), "core_pressure: -1.0 of core 1, column 1 is not allowed"),
        (lambda: design(pace=np.ones((8, 2))).schedule.project(), "steps: times of its own are not allowed"),
        (
            lambda: dataclasses.replace(gait(), pace=np.ones((8, 2))).project(),
            "pace: one per stroke is not allowed; on and off",
        ),
        (
            lambda: checked_designs([design(RegionMaterials(modulus=(1.0,) * 5))], PUBLISHED, QUICK),
            "modulus: 5 regions are not allowed; a body with this geometry has 13",
        ),
        (
            lambda: checked_designs(
                [design(RegionMaterials(modulus=(1.4,) * 13))],
                dataclasses.replace(PUBLISHED, time_step_safety=1.2),
                QUICK,
            ),
            "modulus: 1.4 is not allowed with this geometry, whose time step is too long for it; at most 1.23",
        ),
        (
            lambda: checked_designs([design(None, core_pressure=np.ones((2, 2)))], PUBLISHED, QUICK),
            "core_pressure: 2 rows are not allowed; give one row, or 1, one a core",
        ),
        (lambda: simulate_journey([Leg(design(), Terrain())]), "legs: a gait with materials is not allowed"),
    ],
)
def test_what_is_not_allowed_is_refused_in_one_line(build, message):
    with pytest.raises(ValueError, match=f"^{message}[^\n]*$"):
        build()
