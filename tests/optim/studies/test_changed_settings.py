"""Settings of studies that ``morpholab reproduce --set`` changes: kinds, refusals, and with what the study is run."""

import json
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest

from optim.experiments.study import changed
from optim.studies.beyond.robust_gaits.capped import CappedGaits
from optim.studies.catalogue import STUDIES

# Values of no sense by the kind of a setting, which must not wait for the middle of a run to be refused.
SENSELESS = {
    "str": ["xyzzy", 3],
    "int": [-1, "x", True],
    "float": [float("nan"), "x", 10**400],
    "tuple": ["xyzzy", [None], [[0]]],
    "dict": [3, {"xyzzy": 5}],
    "bool": [1, "yes"],
    "NoneType": ["xyzzy"],
}


def settings_of(settings, before=""):
    """Every setting that can be changed, by name, and those in settings, with their values."""
    fixed = tuple(f"{before}{name}." for name in getattr(settings, "fixed", ()))
    for each in fields(settings):
        value = getattr(settings, each.name)
        if each.init and is_dataclass(value):
            for name, inner in settings_of(value, f"{before}{each.name}."):
                if not f"{name}.".startswith(fixed):
                    yield name, inner
        elif each.init and not isinstance(value, np.ndarray):
            yield before + each.name, value


@pytest.mark.parametrize("name", [name for name, _ in STUDIES.usable()])
def test_no_study_takes_what_makes_no_sense(name):
    settings = STUDIES.find(name).scales["small"]
    for each, present in settings_of(settings):
        for value in SENSELESS[type(present).__name__]:
            with pytest.raises(ValueError) as error:
                changed(settings, {each: value})
            told = str(error.value)
            assert "\n" not in told and each.rpartition(".")[2] in told, (each, value)
            assert told.startswith(each.rpartition(".")[0]), (each, told)


@pytest.mark.parametrize("name", [name for name, _ in STUDIES.usable()])
def test_every_study_takes_the_values_that_it_has(name):
    settings = STUDIES.find(name).scales["small"]
    present = {each: json.loads(json.dumps(value, default=dict)) for each, value in settings_of(settings)}
    assert dict(settings_of(changed(settings, present))) == dict(settings_of(settings))


def test_values_of_json_become_those_of_settings():
    told = changed(CappedGaits(), {"full": [4], "slopes": [0, 5], "floor": "acrylic", "budget": 3})
    assert told == replace(CappedGaits(), full=(4,), slopes=(0.0, 5.0), floor="acrylic", budget=3.0)
    assert changed(CappedGaits(), {"full": 4}).full == (4,) and isinstance(told.slopes[1], float)


def test_settings_in_settings_have_both_names():
    present = STUDIES.find("slope-sweep").scales["small"]
    told = changed(present, {"robot.copies": 3, "robot.geometry.closed": True, "robot.noise": 0})
    robot = replace(present.robot, copies=3, noise=0.0, geometry=replace(present.robot.geometry, closed=True))
    assert told == replace(present, robot=robot)


def test_forgetting_needs_a_robot():
    settings = STUDIES.find("forgetting").scales["small"]
    none = {f"{robot}.bodies": 0 for robot in ("vehicle", "quadruped", "walker")}
    assert changed(settings, {"vehicle.bodies": 0}).vehicle.bodies == 0
    with pytest.raises(ValueError, match=r"^bodies: 0 of every robot are not allowed; give some of one$"):
        changed(settings, none)


def test_the_command_runs_the_study_with_them(morpholab, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    seen = []
    study = replace(STUDIES.find("capped-gaits"), run=lambda folder, settings, progress: seen.append(settings))
    monkeypatch.setattr(type(STUDIES), "find", lambda self, name: study)
    line = (
        "reproduce capped-gaits --budget medium --out a --set floor=acrylic --set full=[4] --set slopes=[0,5] --quiet"
    )
    assert morpholab(line)[0] == 0
    assert seen == [CappedGaits((4,), (0.0, 5.0), "acrylic")]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("capped-gaits --out a --set seeds=1", "set: 'seeds' is unknown; choose one of full, slopes"),
        ("slope-sweep --out a --set robot.copy=4", "robot.seed; did you mean robot.copies?"),
        ("capped-gaits --out a --set full", "set: 'full' is not allowed; give NAME=VALUE"),
        ("capped-gaits --out a --set held_out=0.5", "held_out: 0.5 is not allowed; give a value such as 4"),
        ("capped-gaits --out a --from-data . --set full=1", "set: ['full=1'] is not allowed with --from-data"),
        ("capped-gaits --out a --set full=1 --set full=2", "set: full is given twice; leave one out"),
        ("capped-gaits --out a --floor wood --set floor=acrylic", "set: floor is not allowed beside --floor"),
        ("capped-gaits --out a --friction 0.1,0.9", "friction: (0.1, 0.9) is not allowed; give that of a floor, wood"),
        ("rover-sweep --out a --set grid=3", "set: 'grid' is unknown; choose one of bodies, seed"),
        ("rover-sweep --out a --set grid.xyzzy=3", "set: 'grid.xyzzy' is unknown; choose one of bodies, seed"),
        ("slope-sweep --out a --set robot.copies=0", "robot.copies: 0 is not allowed"),
        ("training --out a --set training.task.radius=0.2", "set: 'training.task.radius' is unknown; choose one of"),
        ("hardware-friction --out a --set robot.actuation.weight=1", "set: 'robot.actuation.weight' is unknown"),
        ("co-optimisation --out a --set threads=0", "threads: 0 is not allowed"),
        ("--set full=1", "set: ['full=1'] is not allowed without a study"),
    ],
)
def test_what_is_wrong_is_one_line_and_leaves_nothing(morpholab, monkeypatch, tmp_path, line, message):
    monkeypatch.chdir(tmp_path)
    code, _, error = morpholab(f"reproduce {line} --quiet")
    assert code == 2 and message in error and len(error.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())
