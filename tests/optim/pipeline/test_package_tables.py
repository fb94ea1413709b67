"""Tables of packages: from every gait to every other within the limits of the rig, and what replays of them tell."""

import dataclasses
import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from small_pipeline import task_of

from optim.pipeline import changes, tables
from optim.pipeline import run as pipeline_run
from optim.pipeline.handover import Handover, shape_change
from optim.pipeline.plans import Plan
from optim.pipeline.tables import check_changes, package_tables
from optim.pipeline.task import WAYS, SearchSettings
from optim.pipeline.trials import NoWorkingGait, State
from robots.hardware import PneumaticRig, export_csv, gait_table, read_csv
from robots.inflatable import INCHING, ROLLING
from robots.inflatable.design import save_design

EXAMPLE = Path(__file__).parents[3] / "examples" / "pipeline" / "flat-and-hill"
ROUND = dataclasses.replace(INCHING, pressure=ROLLING.pressure)  # inching in the shape of rolling
TASK = "terrains = ['flat', 'hill:15']\ngaits = ['rolling', 'inching']\n"
SLOW = "[channels.core]\nslew_kpa_per_s = 20.0\n"  # 130 kPa in 4.7 s are too fast for it


def states_of(task, *designs):
    return [State(t, n, d, [0.1]) for t, (n, d) in zip(task.terrains, designs, strict=True)]


def test_a_change_of_shape_begins_where_the_gait_before_ends(tmp_path):
    task = task_of(tmp_path, TASK)
    states = states_of(task, ("rolling", ROLLING), ("inching", INCHING))
    ways = {("flat", "hill-15"): (ROLLING, INCHING, WAYS[0]), ("hill-15", "flat"): (INCHING, ROLLING, WAYS[2])}
    shapes = {pair: shape_change(*each, task.core_times, task.robot) for pair, each in ways.items()}
    made = package_tables(states, shapes, task)
    assert made.files["flat-to-hill-15"].timing[1].slowest == "bladder1"
    own = "hill-15-to-flat-entry"  # after feet that slide
    assert made.entries == {("flat", "hill-15"): "hill-15", ("hill-15", "flat"): own}
    assert set(made.files) == {"flat", "hill-15", "flat-to-hill-15", "hill-15-to-flat", own}
    assert {table.seed for table in made.files.values()} == {None}


def test_a_gait_is_entered_from_another_of_its_shape(tmp_path):
    """Rolling ends with bladder 1 full, and inching begins without it."""
    save_design(ROUND, tmp_path / "round.json")
    task = task_of(tmp_path, TASK.replace("inching", "round.json"))
    pair, back = ("flat", "hill-15"), ("hill-15", "flat")
    made = package_tables(states_of(task, ("rolling", ROLLING), ("round", ROUND)), {pair: None, back: None}, task)
    assert made.entries[pair] == "flat-to-hill-15-entry"
    entry = made.files[made.entries[pair]]
    assert entry.start.levels[0] == 1.0 and entry.design == ROUND
    assert entry.timing[1].end_s - entry.timing[1].start_s >= 2.0
    everywhere = package_tables(states_of(task, ("rolling", ROLLING), ("rolling", ROLLING)), {pair: None}, task)
    assert everywhere.entries[pair] == "flat-to-hill-15-entry"


def test_tables_that_do_not_join_are_not_written(tmp_path, monkeypatch):
    task = task_of(tmp_path, TASK)
    made = Handover(None, gait_table(ROLLING, task.rig))  # as if all lines were as it likes them
    monkeypatch.setattr(tables, "handover", lambda *_: made)
    states = states_of(task, ("rolling", ROLLING), ("rolling", ROLLING))
    with pytest.raises(ValueError, match=r"^tables: flat to hill-15: bladder1: 20 to 0 kPa at 20 kPa/s; the rig's"):
        package_tables(states, {("flat", "hill-15"): None}, task)


def test_the_seed_is_that_of_a_search(tmp_path):
    task = dataclasses.replace(task_of(tmp_path, f"{TASK}seed = 7"), search=SearchSettings("genetic", 1))
    states = states_of(task, ("rolling", ROLLING), ("found-hill-15", INCHING))
    files = package_tables(states, {}, task).files
    assert files["flat"].seed is None and files["hill-15"].seed == 7
    alone = dataclasses.replace(task, search=None)  # of a file called so
    assert package_tables(states, {}, alone).files["hill-15"].seed is None


# rigs that refuse to go from a gait to another


def test_a_rig_that_cannot_change_the_shape_is_refused_as_the_task_is_read(tmp_path, morpholab):
    (tmp_path / "slow.toml").write_text(SLOW)
    message = r"^gaits: from rolling to inching: core: 27\.6596 kPa/s at .*; the rig's limit is 20 kPa/s; give a rig"
    with pytest.raises(ValueError, match=message):
        task_of(tmp_path, f"{TASK}rig = 'slow.toml'")
    code, _, error = morpholab(f"pipeline {tmp_path / 'task.toml'} --out {tmp_path / 'out'} --quiet")
    assert code == 2 and error.count("\n") == 1 and not (tmp_path / "out").exists()
    one = "terrains = ['flat']\ngaits = ['rolling', 'inching']\nrig = 'slow.toml'"
    assert list(task_of(tmp_path, one).gaits) == ["rolling", "inching"]  # there no shape changes


def test_ways_that_the_rig_cannot_play_are_not_tried(tmp_path, monkeypatch):
    """Feet of this rig may come from 0 to 50 kPa in a second, not from -80."""
    (tmp_path / "feet.toml").write_text("[channels.foot]\nslew_kpa_per_s = 100.0\n")
    levels = ROLLING.schedule.levels.copy()
    levels[8:] = 1.0
    grips = dataclasses.replace(ROLLING, schedule=type(ROLLING.schedule)(levels, 2))
    for name, pressure in (("round", ROLLING.pressure), ("flat", 0.0)):
        save_design(dataclasses.replace(grips, pressure=pressure), tmp_path / f"{name}.json")
    task = task_of(tmp_path, "terrains = ['flat', 'hill:15']\ngaits = ['round.json', 'flat.json']\nrig = 'feet.toml'")
    states = states_of(task, *task.gaits.items())
    assert list(task.ways_between(*(state.design for state in states))) == list(WAYS[:2])
    played = list[str]()
    monkeypatch.setattr(changes, "cached", lambda _, key, *__: played.append(key))
    monkeypatch.setattr(changes, "_judged", lambda *_: SimpleNamespace(faults=("bad",), next_speed=1.0))
    changes.find_change(*states, SimpleNamespace(task=task, folder=None))
    assert len(played) == 4  # two ways on two terrains


def test_plans_that_the_rig_cannot_play_are_left_out(tmp_path):
    """Of gaits that searches find, too, of which nothing is known as the task is read."""
    (tmp_path / "slow.toml").write_text(SLOW)
    task = task_of(tmp_path, "terrains = ['flat', 'hill:15']\ngaits = ['rolling']\nrig = 'slow.toml'")
    found = {"rolling": ROLLING, "found-hill-15": INCHING}
    changing, single = Plan(("rolling", "found-hill-15"), 0.2), Plan(("rolling", "rolling"), 0.1)
    assert pipeline_run._playable([changing, single], found, task) == [single]
    with pytest.raises(NoWorkingGait, match=r"from rolling to found-hill-15: core: 27\.6"):
        pipeline_run._playable([changing], found, task)


# replays


@pytest.fixture
def package(tmp_path):
    shutil.copytree(EXAMPLE, tmp_path / "p")
    return tmp_path / "p"


def test_the_example_keeps_the_limits_of_its_rig(package):
    assert [str(each) for each in check_changes(package)] == [
        "flat to hill-15: tables are within the limits of the rig dissertation",
        "hill-15 to flat: tables are within the limits of the rig dissertation",
    ]


def made_earlier(package):
    """A package without a rig and entries, whose change of shape begins with empty bladders."""
    machine = json.loads((package / "machine.json").read_text())
    for change in machine["changes"]:
        del change["entry"]
    (package / "machine.json").write_text(json.dumps(machine))
    (package / "rig.toml").unlink()
    path = package / "tables/flat-to-hill-15.csv"
    export_csv(read_csv(path).design, path)
    return package


def test_a_package_of_an_earlier_version_is_checked_too(package, morpholab, monkeypatch):
    found = check_changes(made_earlier(package))
    told = (
        "flat to hill-15: tables are beyond the limits of the rig dissertation: "
        "bladder1: 20 to 0 kPa at 16.2 kPa/s; the rig's limit is 15 kPa/s"
    )
    assert str(found[0]) == told and found[1].faults == ()
    monkeypatch.setattr("optim.pipeline.machine.replay_package", lambda *_: [])
    code, text, _ = morpholab(f"pipeline --replay {package} --quiet")
    assert code == 1 and told in text
    assert json.loads(morpholab(f"pipeline --replay {package} --quiet --json")[1])["changes"][1]["faults"] == []


def test_a_rig_that_is_not_known_is_asked_for(package):
    (package / "rig.toml").unlink()
    mine = dataclasses.replace(PneumaticRig(), name="mine")
    for path in (package / "tables").iterdir():
        table = read_csv(path)
        export_csv(table.design, path, mine, start=table.start)
    unknown = check_changes(package)
    assert str(unknown[0]) == "flat to hill-15: not checked, as the rig is not known; name it with --rig"
    assert [(each.rig, each.faults) for each in check_changes(package, mine)] == [("mine", ())] * 2


def test_a_table_of_a_changed_package_keeps_its_start(package, morpholab, tmp_path):
    """A rig that wants rows at a rate gets those of the same change."""
    table = package / "tables/flat-to-hill-15.csv"
    assert morpholab(f"export {table} --csv {tmp_path / 'rows.csv'} --rate 50")[0] == 0
    rows = read_csv(tmp_path / "rows.csv")
    assert rows.start == read_csv(table).start and np.ptp(rows.times[rows.states == 1]) > 2.3


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("entry", "../../secret.csv", "entry: '../../secret.csv' is not allowed; it must be in the package"),
        ("table", "/secret.csv", "table: '/secret.csv' is not allowed"),
        ("table", 3, "is damaged"),
        ("to", "moon", "to: 'moon' is unknown"),
    ],
)
def test_a_damaged_change_is_one_line(package, morpholab, field, value, message):
    machine = json.loads((package / "machine.json").read_text())
    machine["changes"][0][field] = value
    (package / "machine.json").write_text(json.dumps(machine))
    code, _, error = morpholab(f"pipeline --replay {package} --quiet")
    assert code == 2 and message in error and error.count("\n") == 1
