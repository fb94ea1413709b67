"""The command calibrate, from a file of measurements to a robot."""

import json
import shutil

import numpy as np
import pytest
from measurements import GRIPPING, SLIDING

from optim.calibration import calibrate, report
from robots.calibration import (
    NAMES,
    Properties,
    load_calibration,
)
from robots.inflatable import SMALL

DRAGS = GRIPPING + SLIDING


@pytest.mark.kernels
def test_a_calibration_goes_from_a_file_to_simulate(morpholab, tmp_path, monkeypatch):
    (tmp_path / "a.toml").write_text(DRAGS)
    code, out, _ = morpholab("calibrate a.toml --out fit --json --quiet --threads 1")
    record = json.loads(out)
    assert code == 0 and set(record["fitted"]) == {"friction", "low_friction"} and record["warnings"] == []
    assert record["properties"]["friction"] == pytest.approx(0.8, rel=0.03)
    assert record["properties"]["low_friction"] == pytest.approx(0.2, rel=0.03)
    low, high = record["fitted"]["friction"]["interval_95"]
    assert low < 0.8025 < high and high - low == pytest.approx(2 * 1.96 * 0.01, rel=0.1)  # 0.01 N / 0.5 N / sqrt(4)
    assert (tmp_path / "fit/calibration.png").stat().st_size > 5000
    properties, geometry = load_calibration(tmp_path / "fit/calibration.json")
    assert geometry == "small" and vars(properties) == record["properties"]
    used = {}
    monkeypatch.setattr("robots.inflatable.simulation.simulate", lambda *_, **given: used.update(given) or stand_in())
    code, _, _ = morpholab("simulate --gait inching --calibration fit/calibration.json")
    assert code == 0 and used["geometry"] == SMALL
    assert used["actuation"].high_friction == properties.friction


@pytest.mark.kernels
def test_a_calibration_that_a_kill_has_cut_off_can_be_repeated(morpholab, tmp_path, monkeypatch):
    """Its numbers are there, but not its picture."""
    save, fitted = report.save_calibration, []

    def calibrated(*given):
        fitted[:] = fitted or [calibrate(*given)]
        return fitted[0]

    def killed(*given):
        shutil.copytree(tmp_path / "fit", tmp_path / "killed")
        save(*given)

    def full(*given):
        raise RuntimeError("the disk is full")

    monkeypatch.setattr("optim.calibration.calibrate", calibrated)
    monkeypatch.setattr(report, "save_calibration", full)
    (tmp_path / "a.toml").write_text(DRAGS[: DRAGS.rindex("[[drag]]")])
    code, out, error = morpholab("calibrate a.toml --out part --quiet --threads 1")
    assert (code, error) == (1, "morpholab calibrate: failed: the disk is full\n") and "friction" in out
    assert [path.name for path in (tmp_path / "part").iterdir()] == ["calibration.json"]  # the work is not lost
    monkeypatch.setattr(report, "save_calibration", killed)
    assert morpholab("calibrate a.toml --out fit --quiet --threads 1")[0] == 0
    assert {path.name for path in (tmp_path / "killed").iterdir()} == {"calibration.json", ".aside-claim"}
    monkeypatch.setattr(report, "save_calibration", save)
    assert morpholab("calibrate a.toml --out killed --quiet --threads 1")[::2] == (0, "")
    whole, again = ({path.name: path.read_bytes() for path in (tmp_path / n).iterdir()} for n in ("fit", "killed"))
    assert again == whole


@pytest.mark.parametrize("weight", ["published", "physical"])
def test_the_robot_that_is_fitted_has_the_weight_of_the_file(morpholab, tmp_path, monkeypatch, weight):
    used = []

    def stopped(experiments, laboratory, *others):
        used.append(laboratory)
        raise ValueError("seen: enough")

    monkeypatch.setattr("optim.calibration.calibrate", stopped)
    (tmp_path / "a.toml").write_text(f'weight = "{weight}"\n{DRAGS}')
    assert morpholab("calibrate a.toml --quiet")[0] == 2
    assert used[0].drive(Properties.of()).weight == used[0].actuation.weight == weight


def stand_in():
    """What ``simulate`` needs of a result."""
    numbers = dict.fromkeys(("distance", "speed", "speed_simulated"), np.array([0.1]))
    numbers["displacement"] = np.array([[0.0, 0.1]])
    return type("Result", (), {**numbers, "status": np.array(["ok"]), "steps": np.array([3]), "frames": None})


BAD_LINES = [
    ("calibrate", "data: give either a file of measurements, or --example FILE"),
    ("calibrate a.toml --example b.toml", "data: give either"),
    ("calibrate --example b.toml --out d", "out: it is of a fit; leave it out with --example"),
    ("calibrate --example b.toml --fit modulus", "fit: it is of a fit; leave it out with --example"),
    ("calibrate none.toml", "none.toml: cannot be read"),
    ("calibrate empty.toml", "empty.toml: holds no experiment"),
    ("calibrate --example a.toml", "path: a.toml exists; name a new file"),
    ("calibrate a.toml --geometry small", "geometry: small is not allowed beside a.toml"),
    ("calibrate a.toml --fit inflation_rate", "fit: inflation_rate does not act in these experiments; add a gait"),
    ("calibrate a.toml --fit mass", "fit: 'mass' is unknown"),
    ("calibrate a.toml --bounds friction=2:1", "bounds: 'friction=2:1' is not allowed; give friction=LOW:HIGH"),
    ("calibrate a.toml --fit modulus --bounds friction=1:2", "bounds: 'friction=1:2' is not used; fitted are modulus"),
    ("calibrate a.toml --bounds mass=1:2", "bounds: 'mass' is unknown"),
    ("calibrate a.toml --out a.toml", "out: a.toml is a file; name a new folder"),
    ("simulate --gait inching --calibration a.toml", "a.toml: "),
    ("simulate --gait inching --calibration wrong.json", "wrong.json: geometry: 'large' is unknown"),
]


@pytest.mark.parametrize(("line", "message"), BAD_LINES)
def test_bad_lines_are_one_line(morpholab, tmp_path, line, message):
    (tmp_path / "a.toml").write_text(DRAGS)
    (tmp_path / "empty.toml").write_text("")
    (tmp_path / "wrong.json").write_text(
        '{"format": "morpholab-calibration-1", "geometry": "large", '
        '"properties": {"friction": 1, "low_friction": 1, "modulus": 1, "inflation_rate": 1}}'
    )
    code, out, error = morpholab(line)
    assert (code, out) == (2, "") and error.count("\n") == 1 and f"error: {message}" in error


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_the_example_gives_its_truth_back(morpholab, tmp_path, seed):
    code, out, _ = morpholab(f"calibrate --example rig.toml --seed {seed} --quiet --json")
    truth = json.loads(out)["truth"]
    assert code == 0 and set(truth) == set(NAMES)
    code, out, _ = morpholab("calibrate rig.toml --quiet --json")
    assert code == 0
    for name, found in json.loads(out)["fitted"].items():
        assert found["after"] == pytest.approx(truth[name], rel=0.05)
