"""Machines that notice a change of ground by their senses, on courses."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from optim.experiments.data import Data
from optim.experiments.tables import MISSING, read_records, write_records
from optim.studies.beyond.sense_and_switch.machine import Grounds, machine
from optim.studies.beyond.sense_and_switch.noticing import LAST, noticed
from optim.studies.beyond.sense_and_switch.pilots import (
    Crew,
    by_chance,
    exploring,
    fixed,
    knowing_ground,
    samples,
    staying,
)
from optim.studies.beyond.sense_and_switch.report import ratio
from optim.studies.beyond.sense_and_switch.study import FIRST_HELD_OUT, STUDY, SenseAndSwitch
from robots.lattice_robot.repertoire import Played, Repertoire
from robots.world import Terrain

GROUNDS = Grounds(0.12, 8.0, 0.004, 0.05)
DATA = Path(__file__).parents[3] / "docs/data/sense-and-switch"
COURSE = GROUNDS.course(FIRST_HELD_OUT)


def test_courses_that_judge_are_others_than_those_of_training():
    for settings in STUDY.scales.values():
        assert len(settings.training) == settings.trained and max(settings.training) < FIRST_HELD_OUT
        firsts = [int(settings.grounds.course(seed).kinds[1]) for seed in settings.training]
        assert firsts == [1 + number % 3 for number in range(settings.trained)]
    assert Terrain.parse(GROUNDS.world(7).name) == GROUNDS.world(7)
    assert {kind: world.name for kind, world in GROUNDS.pure.items()} == {
        "level": "flat",
        "slope": "ramp:8.0,0.09",
        "ridges": "wave:0.004,0.04",
        "slippery": "patches:0.05,0.05",
    }


def test_the_machine_is_alike_on_both_sides():
    """What is at the left of a muscle is at the right."""
    robot = machine(1)
    x, y, z = robot.body.voxels.T
    regions = {(i, j, k): region for i, j, k, region in zip(x, y, z, robot.body.regions, strict=True)}
    assert all(regions[i, 0, k] == regions[i, 1, k] for i, _, k in regions) and len(robot.parameters) == 30


def test_gaits_differ_from_rest_by_shape_and_wave():
    """At the nodes of the cycle, as the drive has them."""
    robot = machine(1)
    points = np.stack([robot.start, robot.start])
    points[:, :10], points[:, 10:20], points[:, 20:] = 1.1, 0.0, 0.25
    points[1, 10] = 0.2
    repertoire = Repertoire.of(robot, points)
    assert repertoire.nodes.shape == (2, 10, 16) and not repertoire.robot.parameters
    assert np.allclose(repertoire.nodes[0], 0.1) and np.allclose(repertoire.nodes[1, 1:], 0.1)
    assert np.allclose(repertoire.nodes[1, 0, [0, 4, 8]], [0.3, 0.1, -0.1])
    assert np.allclose(repertoire.actions(np.array([[0.5, 0.5]]), 0)[0, :2], [0.2, 0.1])


def test_pilots():
    """Told ones follow the ground, explorers do so half of the time, and draws are those of the seed."""
    middles = np.append(0.0, COURSE.ends[:-1]) + 0.02
    places, felt = middles[:6], np.zeros((6, 1))
    answers = (0, 1, 2, 3)
    guide = knowing_ground(COURSE, answers)
    assert guide(felt, places).tolist() == COURSE.kinds[:6].tolist()
    kept = staying(lambda felt, places: places.astype(int), 3)
    assert [int(kept(felt[:1], np.array([gait]))[0]) for gait in (1, 2, 2, 2, 0, 0)] == [1, 1, 1, 2, 2, 2]
    crew = Crew([(2, fixed(3)), (4, by_chance(4, 4, (1, 2)))])
    first = crew(felt, places)
    assert crew.count == 6 and first[:2].tolist() == [3, 3]
    assert first[2:].tolist() == by_chance(4, 4, (1, 2))(felt[2:], places[2:]).tolist()
    explorer = exploring(COURSE, answers, 4, 6, (0,))
    right = np.mean([explorer(felt, places) == COURSE.kinds[:6] for _ in range(1500)])
    assert right == pytest.approx(0.5 + 0.5 / 4, abs=0.06)


def test_what_is_noticed_of_a_walk():
    """A machine that goes on evenly and changes its gait some looks after the ground; a told one is never late."""
    places = np.linspace(0.0, COURSE.ends[4] - 0.01, 500)[: 500 - LAST]
    places = np.append(places, np.full(LAST, places[-1]))
    kinds = COURSE.kind(places)
    changes, count, right = noticed(COURSE, (0, 1, 2, 3), kinds, places)
    assert [change["looks"] for change in changes] == [0, 0, 0, 0][: len(changes)] and len(changes) >= 3
    assert count == {"switches": len(changes), "false": 0} and right == 1.0
    late = np.concatenate([np.full(7, kinds[0]), kinds[:-7]])
    changes, count, _ = noticed(COURSE, (0, 1, 2, 3), late, places)
    assert {change["looks"] for change in changes} == {7} and count["false"] == 0
    changes, count, right = noticed(COURSE, (0, 1, 2, 3), np.zeros(500, int), places)
    assert {change["looks"] for change in changes if change["to"] != "level"} == {None} and right < 1
    assert noticed(COURSE, (0, 0, 0, 0), np.zeros(500, int), places)[0] == []
    flips = np.arange(500) % 2
    assert noticed(COURSE, (0, 0, 0, 0), flips, places)[1] == {"switches": 499, "false": 250}


def test_samples_are_of_windows_in_which_nothing_changed():
    """And of what was played before them."""
    gaits, places = np.array([[0, 0, 0, 1, 1, 1, 1, 1]]), np.full((1, 8), 0.01)
    felt = np.arange(8.0).reshape(1, 8, 1)
    played = Played(gaits, felt, places, np.array([False]))
    found, playing, kinds = samples(played, COURSE, 3)
    assert playing.tolist() == [0, 1, 1, 1] and not kinds.any()
    assert found[:, 0].tolist() == [1.0, 4.0, 5.0, 6.0]
    lost = Played(gaits, felt, places, np.array([True]))
    assert len(samples(lost, COURSE, 3)[0]) == 0


def test_the_share_that_is_kept_has_an_interval_over_seeds_and_courses():
    """None if all keep the same; wide if a seed differs."""
    whole = np.random.default_rng(0).uniform(0.5, 1.0, (5, 32))
    assert ratio(0.8 * whole, whole) == pytest.approx((0.8, 0.8, 0.8))
    part = whole * np.array([1.0, 1.0, 1.0, 1.0, 0.0])[:, None]
    share, low, high = ratio(part, whole)
    assert low < 0.6 < share < 0.95 < high
    nowhere = whole.copy()
    nowhere[0] = -0.3  # by itself; with the others the mean is above zero
    assert ratio(part, nowhere)[1:] == (None, None)


def test_a_repertoire_that_goes_nowhere_by_some_resample_has_no_interval(tmp_path):
    """Its told machine goes 2 cm in the mean, and backwards on half of the courses."""
    copied = tmp_path / "data"
    shutil.copytree(DATA, copied)
    rows = read_records(copied / "runs.csv")
    shift = [row | {"distance": row["distance"] - 0.075 * (row["seed"] == 4)} for row in rows]
    write_records(copied / "runs.csv", shift)
    out = tmp_path / "out"
    out.mkdir()
    STUDY.rewrite(Data(copied), out)
    table = (out / "table.md").read_text()
    assert f"| 4 | 101% | {MISSING} | 0 | 0 | 0 | 0 | 16 |" in table
    own = [row for row in shift if row["seed"] == 1]
    told, sensing = (sum(row["distance"] for row in own if row["machine"] == name) for name in ("told", "sensing"))
    assert f"| 1 | {sensing / told:.0%} | " in table and "| 186 | 80 | 76 | 0.2 | 16 |" in table


@pytest.mark.parametrize(
    ("table", "lost", "message"),
    [
        ("runs.csv", 3, "runs.csv: it lacks rows of machine sensing, no hysteresis of seed 0, or has others; give "),
        (
            "gaits.csv",
            1,
            "gaits.csv: seed 0 must have gaits level, slope, ridges, slippery, of which one is best_alone",
        ),
    ],
)
def test_tables_that_are_not_whole_are_told(tmp_path, table, lost, message):
    shutil.copytree(DATA, tmp_path / "a")
    rows = read_records(DATA / table)
    write_records(tmp_path / "a" / table, rows[:lost] + rows[lost + 1 :])
    with pytest.raises(ValueError) as error:
        STUDY.rewrite(Data(tmp_path / "a"), tmp_path / "out")
    assert message in str(error.value) and "\n" not in str(error.value)


def test_a_study_without_changes_of_ground_is_told(tmp_path):
    shutil.copytree(DATA, tmp_path / "a")
    (tmp_path / "a/changes.csv").write_text("seed,course,machine,from,to,looks\n")
    STUDY.rewrite(Data(tmp_path / "a"), tmp_path)
    assert json.loads((tmp_path / "summary.json").read_text())["noticed"] == {}


@pytest.mark.kernels
@pytest.mark.slow
def test_the_study_goes_on_where_it_was(tmp_path):
    """To the same bits, with what is missing computed again; with more courses, too."""
    settings = SenseAndSwitch(
        seeds=1, generations=0, further=0, population=4, search_cycles=1, trained=1, held_out=2, cycles=3
    )
    STUDY.run(tmp_path / "a", settings)
    assert all((tmp_path / "a" / name).stat().st_size for name in STUDY.writes)
    names = ("runs.csv", "gaits.csv", "changes.csv", "summary.json", "table.md")
    before = {name: (tmp_path / "a" / name).read_bytes() for name in names}
    (tmp_path / "told").mkdir()
    STUDY.rewrite(Data(tmp_path / "a"), tmp_path / "told")
    told_again = {path.name: path.read_bytes() for path in (tmp_path / "told").iterdir()}
    assert set(told_again) == {"table.md", "summary.json", "course.png"}
    assert all(content == (tmp_path / "a" / name).read_bytes() for name, content in told_again.items())
    for name in ("judged5001", "slope", f"tuned{settings.training[0]}"):
        (lost,) = (tmp_path / "a/parts/0").glob(f"{name}-*.npz")
        lost.unlink()
    STUDY.run(tmp_path / "a", settings)
    assert before == {name: (tmp_path / "a" / name).read_bytes() for name in names}
    rows = read_records(tmp_path / "a/runs.csv")
    assert len(rows) == 18 and all(np.isfinite(row["distance"]) for row in rows)
    summary = json.loads(before["summary.json"])
    assert summary["machines"]["told"]["share"] == 1.0 and summary["machines"]["told"]["false"] == 0
