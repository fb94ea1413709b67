"""Bodies that leave bladders out: voxels, programs, files, tables, and what they do."""

import dataclasses
import json

import numpy as np
import pytest
from graded import GRIPPING, LOW, QUICK, TINY, tabled

from robots.hardware import export_csv, read_csv
from robots.hardware.table import design_hash
from robots.inflatable import InflatableDesign, differentiate, load_design, save_design, simulate
from robots.inflatable.body import FIRST_BLADDER, PUBLISHED, SMALL, InflatableGeometry
from robots.inflatable.design import ROLLING
from robots.inflatable.journeys import Leg, simulate_journey
from robots.inflatable.layout import (
    EVERY_BLADDER,
    WAYS_TO_LIE,
    different_layouts,
    laid,
    layout_from_mask,
    layout_mask,
    layout_of,
    told_layout,
)
from robots.inflatable.materials import RegionMaterials
from robots.inflatable.pouch import feeling_pouch
from robots.inflatable.program import build_program
from robots.inflatable.robot import InflatableRobot
from robots.world import Terrain

FEW = (1, 3, 6)


def moving(bladders=FEW, seed=0, columns=2, **tables):
    """A graded gait of a body that has these bladders alone."""
    rng = np.random.default_rng(seed)
    times = {"motion_steps": np.full(columns, 200), "settle_steps": np.full(columns, 60)}
    gait = tabled(rng.uniform(0.2, 0.9, (8, columns)), rng.uniform(0.1, 0.9, (2, columns)), 1, **times)
    return InflatableDesign(2e3, 0.0, dataclasses.replace(gait, **tables)).with_layout(bladders)


def test_a_body_has_the_voxels_of_its_bladders_alone():
    """Whatever is left out takes nothing else along: skins, links between them and the order of voxels stay."""
    whole = SMALL.body
    regions = np.asarray(whole.regions)
    for bladders in (FEW, (2,), (8,), ()):
        body = dataclasses.replace(SMALL, bladders=bladders).body
        kept = np.isin(regions, [*range(FIRST_BLADDER), *(place + FIRST_BLADDER - 1 for place in bladders)])
        shift = 0 if any(place > 4 for place in bladders) else SMALL.bladder_layers  # it lies on its skin
        assert np.array_equal(body.voxels, whole.voxels[kept] - [0, 0, shift]) and body.voxels[:, 2].min() == 0
        assert np.array_equal(body.regions, regions[kept])
        assert np.array_equal(body.cut_links, whole.cut_links)
        assert np.array_equal(body.pressure_normals, whole.pressure_normals[kept])
    assert dataclasses.replace(PUBLISHED, bladders=EVERY_BLADDER) == PUBLISHED
    assert dataclasses.replace(SMALL, bladders=(1,)).time_step == SMALL.time_step


def test_layouts_that_are_one_body_are_told_once():
    """76 of 256, as Burnside counts them: each of three ways to lie keeps 16, as it is all do."""
    found = different_layouts()
    orbits = {frozenset(laid(layout, way) for way in WAYS_TO_LIE) for layout in found}
    assert len(found) == len(orbits) == (256 + 3 * 16) // 4
    assert set().union(*orbits) == {layout_from_mask([n >> k & 1 for k in range(8)]) for n in range(256)}
    assert laid((1, 5), "turned round") == (4, 8) and laid((1, 2), "upside down") == (7, 8)
    assert laid((1, 2), "both") == (5, 6)


def test_ways_to_lie_are_those_of_the_voxels():
    """Columns that change sides, and sides that change, as places of voxels say."""
    for way, mirrored in (("turned round", [1, 0]), ("upside down", [0, 1]), ("both", [1, 1])):
        for place in EVERY_BLADDER:
            places = []
            for layout in ((place,), laid((place,), way)):
                body = dataclasses.replace(SMALL, bladders=layout).body
                centres = body.voxels[:, [0, 2]] - body.voxels[: 2 * SMALL.columns * SMALL.rows, [0, 2]].mean(axis=0)
                places.append(centres[np.asarray(body.regions) >= FIRST_BLADDER].mean(axis=0))
            assert places[1] == pytest.approx(np.where(mirrored, -1, 1) * places[0])


def test_words_for_layouts_come_back():
    for layout in (FEW, (), EVERY_BLADDER):
        assert layout_of(told_layout(layout)) == layout
        assert layout_from_mask(layout_mask(layout)) == layout
    assert layout_of("6, 1,3") == FEW
    for text, message in (
        ("9", "^bladders: 9 is not allowed; give a whole number, at most 8"),
        ("1,1", "^bladders: 1,1 is not allowed; give places from 1 to 8, none twice"),
        ("top", "^bladders: 'top' is not allowed; give a whole number, at least 1"),
    ):
        with pytest.raises(ValueError, match=message):
            layout_of(text)
    with pytest.raises(ValueError, match=r"^bladders: '12' is not allowed; give places from 1 to 8"):
        InflatableGeometry(bladders="12")


def test_what_fills_a_bladder_that_is_not_there_is_refused():
    message = r"^bladders: bladder 2 is not there \(there are: 1,3,6\), but column 7 of the gait fills it; leave it"
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(ROLLING, bladders=FEW)
    with pytest.raises(ValueError, match=message):
        simulate(ROLLING, geometry=dataclasses.replace(SMALL, bladders=FEW))
    with pytest.raises(ValueError, match=message):
        simulate_journey([Leg(ROLLING, Terrain())], geometry=dataclasses.replace(SMALL, bladders=FEW))
    fewer = ROLLING.with_layout(FEW)
    assert np.array_equal(fewer.schedule.inflation, ROLLING.schedule.inflation * layout_mask(FEW)[:, None])
    assert fewer.schedule.skip_idle and ROLLING.with_layout(EVERY_BLADDER).schedule == ROLLING.schedule
    with pytest.raises(ValueError, match=r"^bladders: 1,2 and 1,3,6 are not allowed in one batch; give one batch to"):
        simulate([fewer, ROLLING.with_layout((1, 2))], geometry=SMALL)
    with pytest.raises(ValueError, match=r"^legs: a gait with bladders of its own is not allowed in a journey"):
        simulate_journey([Leg(ROLLING.with_layout(()), Terrain())])
    with pytest.raises(ValueError, match=r"^bladders: 1,3,6 is not allowed in a robot whose waves drive eight; give"):
        feeling_pouch(dataclasses.replace(SMALL, bladders=FEW), 0.0)


def test_programs_say_nothing_of_regions_without_voxels():
    """Not even of the last, after which a body has no regions; all others are told what they are told in any body."""
    for bladders in (FEW, (8,), ()):
        design = moving(bladders)
        few = build_program([design], Terrain(5.0), QUICK, None, dataclasses.replace(TINY, bladders=bladders)).events
        every = build_program([dataclasses.replace(design, bladders=None)], Terrain(5.0), QUICK, None, TINY).events
        absent = [place + FIRST_BLADDER - 1 for place in EVERY_BLADDER if place not in bladders]
        assert np.array_equal(few, every[~np.isin(every["region"], absent)])


def test_files_and_tables_keep_the_layout(tmp_path):
    made = RegionMaterials(modulus=(0.9,) * 13)
    for given in (moving(), dataclasses.replace(moving(()), materials=made), ROLLING.with_layout((1, 8))):
        save_design(given, tmp_path / "gait.json")
        assert load_design(tmp_path / "gait.json") == given
        assert json.loads((tmp_path / "gait.json").read_text())["format"] == "morpholab-inflatable-design-3"
        export_csv(given, tmp_path / "gait.csv", rate=None, on_violation="clip")
        assert read_csv(tmp_path / "gait.csv").design == given
        assert read_csv(tmp_path / "gait.csv").played().bladders == given.bladders
        assert design_hash(given) != design_hash(dataclasses.replace(given, bladders=None))
    save_design(moving(), tmp_path / "gait.json")
    record = json.loads((tmp_path / "gait.json").read_text())
    (tmp_path / "gait.json").write_text(json.dumps({**record, "bladders": [1, 3]}))
    with pytest.raises(ValueError, match=r"bladder 6 is not there \(there are: 1,3\), but column 1 of the gait fills"):
        load_design(tmp_path / "gait.json")


def test_files_of_earlier_commits_have_every_bladder(tmp_path):
    save_design(ROLLING, tmp_path / "gait.json")
    assert "bladders" not in json.loads((tmp_path / "gait.json").read_text())
    assert load_design(tmp_path / "gait.json").bladders is None
    assert InflatableRobot(ROLLING).parts[0] == PUBLISHED


@pytest.mark.kernels
def test_a_body_that_is_turned_round_goes_the_other_way():
    """A mirrored body with the mirrored gait does the mirrored motion: numbers and places of bladders agree.

    As nearly as with all bladders, within 5 %: contacts are listed in one order, whichever way the robot lies.
    """
    design = moving(columns=3)
    mirror = np.array(WAYS_TO_LIE["turned round"]) - 1
    turned = design.schedule.levels.copy()
    turned[:8] = turned[mirror]
    other = InflatableDesign(
        2e3, 0.0, dataclasses.replace(design.schedule, levels=turned), None, laid(FEW, "turned round")
    )
    options = {"geometry": GRIPPING, "actuation": LOW, "threads": 1}
    here, there = (simulate(each, Terrain(), **options) for each in (design, other))
    assert here.status.tolist() == there.status.tolist() == ["ok"]
    assert there.displacement[0] == pytest.approx([-1, 1] * here.displacement[0], rel=0.1)
    every = simulate(dataclasses.replace(design, bladders=None), Terrain(), **options)
    assert abs(every.distance[0] - here.distance[0]) > 1e-3 * abs(here.distance[0])  # empty bladders weigh something
    assert here.body.voxel_count < every.body.voxel_count


@pytest.mark.kernels
def test_gradients_of_bodies_with_few_bladders_are_those_of_differences():
    options = {"geometry": GRIPPING, "actuation": LOW, "threads": 1}
    design = moving()
    run = differentiate(design, Terrain(5.0), **options)
    absent = ~layout_mask(FEW)
    assert not run.inflation[0][absent].any() and run.inflation[0][~absent].all()
    h = 1e-6
    for bladder, column in ((0, 0), (5, 1)):
        ends = []
        for sign in (-1, 1):
            levels = design.schedule.levels.copy()
            levels[bladder, column] += sign * h
            moved = dataclasses.replace(design, schedule=dataclasses.replace(design.schedule, levels=levels))
            ends.append(simulate(moved, Terrain(5.0), **options).distance[0])
        assert run.inflation[0, bladder, column] == pytest.approx((ends[1] - ends[0]) / (2 * h), rel=1e-4)


def test_a_robot_plays_the_gait_without_the_bladders_that_options_leave_out():
    robot = InflatableRobot(ROLLING).changed({"geometry": "small", "bladders": FEW})
    assert robot.gait == ROLLING.with_layout(FEW)
    assert robot.parts[0] == dataclasses.replace(SMALL, bladders=FEW)
    assert robot.document()["bladders"] == [1, 3, 6]
    assert ("Bladders", "1,3,6") in robot.facts_of([])
    assert robot.changed({"bladders": ()}).parts[0].body.voxel_count == 2 * SMALL.columns * SMALL.rows


@pytest.mark.kernels
@pytest.mark.parametrize("bladders", [(1, 4, 6), (8,), (2, 8)])
def test_bodies_of_any_bladders_can_be_shown(bladders):
    """The highest region is that of the last bladder, which may be missing."""
    robot = InflatableRobot(moving(bladders, columns=1)).changed({"geometry": "small", "bladders": bladders})
    replay = robot.replay((), Terrain(), frames=4)
    assert len(replay.motion.nodes) == robot.parts[0].body.voxel_count
