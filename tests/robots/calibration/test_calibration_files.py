"""Files of measurements."""

import dataclasses

import numpy as np
import pytest
from laboratory import STEP, drag

from robots.calibration import (
    Diameter,
    Gait,
    read_measurements,
    write_measurements,
)
from robots.inflatable import INCHING, ROLLING
from robots.inflatable.design import InflatableDesign
from robots.world import Terrain


def test_another_kind_of_file_is_told_which_is_wanted(tmp_path):
    (tmp_path / "a.csv").write_text("time_s,distance_mm\n0.5,1.8\n")
    with pytest.raises(ValueError, match=r"^\S*a.csv: is no file of measurements \(.*\); these are TOML .*") as error:
        read_measurements(tmp_path / "a.csv", None)
    assert str(error.value).endswith("calibrate --example FILE writes one") and "\n" not in str(error.value)


GOOD = """
geometry = "small"

[[drag]]
load_n = 0.5
displacement_mm = [1, 2, 3]
force_n = [0.3, 0.31, 0.29]
force_sd_mn = 5

[[diameter]]
pressure_psi = [0.1, 0.2]
width_cm = [11.0, 10.5]

[[gait]]
gait = "inching"
terrain = "hill:5"
columns = 2
repeats = 1
speed_mm_per_s = 12.0
speed_sd_mm_per_s = 1.0
"""


def named(name):
    return {"inching": INCHING}[name]


def test_a_file_says_what_was_measured(tmp_path):
    (tmp_path / "a.toml").write_text(GOOD)
    found = read_measurements(tmp_path / "a.toml", named)
    foot, pouch, gait = found.experiments
    assert found.geometry == "small" and foot.grips and foot.load == 0.5
    assert foot.at == pytest.approx([1e-3, 2e-3, 3e-3]) and foot.deviations == pytest.approx([5e-3] * 3)
    assert pouch.side == "width" and pouch.at == pytest.approx([689.4757, 1378.9514]) and pouch.deviations is None
    assert pouch.values == pytest.approx([0.11, 0.105])
    assert gait.at.tolist() == [np.inf] and gait.mean_speed and gait.values == pytest.approx([0.012])
    assert gait.terrain == Terrain(5.0) and gait.design == STEP


def test_a_gait_may_be_measured_on_a_known_floor_and_bladders_may_weigh(tmp_path):
    ground = 'terrain = "hill:5"\nfloor = "wood"\nbladder_friction = 0.3'
    (tmp_path / "a.toml").write_text('weight = "physical"\n' + GOOD.replace('terrain = "hill:5"', ground))
    found = read_measurements(tmp_path / "a.toml", named)
    gait = found.experiments[-1]
    assert gait.terrain == Terrain(5.0, 0.7, 0.56, bladder_friction=0.3) and found.weight == "physical"
    assert gait.informs == ("inflation_rate", "modulus")
    (tmp_path / "usual.toml").write_text(GOOD)
    usual = read_measurements(tmp_path / "usual.toml", named)
    assert usual.weight == "published" and usual.experiments[-1].informs[1:3] == ("friction", "low_friction")
    write_measurements(tmp_path / "b.toml", "small", found.experiments, found.weight, named)
    again = read_measurements(tmp_path / "b.toml", named)
    assert again.experiments[-1].terrain == gait.terrain and again.weight == "physical"


def test_files_come_back(tmp_path):
    experiments = [
        dataclasses.replace(drag(grips=False), deviations=np.full(6, 1e-3)),
        Diameter(np.array([1e3, 2e3]), np.array([0.03, 0.04]), "height"),
        Gait(np.array([0.5, 1.0]), np.array([0.01, 0.02]), INCHING, "inching"),
        Gait(np.array([np.inf]), np.array([0.01]), InflatableDesign(2e3, 10.0, INCHING.schedule.cut(2, 1)), "inching"),
    ]
    write_measurements(tmp_path / "b.toml", "small", experiments)
    for given, read in zip(experiments, read_measurements(tmp_path / "b.toml", named).experiments, strict=True):
        assert type(given) is type(read) and given.title == read.title
        for name in ("at", "values", "deviations"):
            a, b = getattr(given, name), getattr(read, name)
            assert (a is None and b is None) or b == pytest.approx(a, rel=1e-5)
        assert not isinstance(given, Gait) or read.design == given.design


@pytest.mark.parametrize(
    ("gait", "message"),
    [
        (
            Gait(np.array([0.5, np.inf]), np.ones(2), INCHING, "inching"),
            "times of inching on flat are infinite in part",
        ),
        (
            Gait(np.ones(1), np.ones(1), ROLLING, "inching"),
            "inching on flat does not play the gait inching; save",
        ),
        (Gait(np.ones(1), np.ones(1), ROLLING), "'gait' is neither a known gait"),
    ],
)
def test_gaits_that_no_file_tells_are_refused(gait, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        write_measurements(tmp_path / "a.toml", "small", [gait])
    assert not (tmp_path / "a.toml").exists()


BAD = [
    ("displacement_mm", "displacement_inch", "drag 1: displacement_inch: is not allowed; name the unit, as one of"),
    ("force_n =", "force =", "drag 1: force: is not allowed; name the unit, as one of force_n, force_mn"),
    ("force_n = [0.3, 0.31, 0.29]", "", "drag 1: column force is missing; give one of force_n, force_mn"),
    ("load_n = 0.5", "", "drag 1: column load is missing"),
    ("load_n = 0.5", "load_n = 0", "drag 1: load: 0 is not allowed; it must be positive"),
    ("0.31, 0.29", "0.31", "drag 1: force: 2 values are not allowed for 3 points; give as many"),
    ("0.31", "nan", "drag 1: force_n: nan is not allowed; give a finite number"),
    ("0.31", '"0.31"', "drag 1: force_n: '0.31' is not allowed; give a finite number"),
    (
        "[0.3, 0.31, 0.29]",
        "[-0.3, 0.31, -0.29]",
        "drag 1: force: a mean of -0.0933 N is not allowed; ",
    ),
    ("[11.0, 10.5]", "[11.0, -10.5]", "diameter 1: width_cm: -10.5 is not allowed; give a finite number, at least 0"),
    ("force_sd_mn = 5", "force_sd_mn = 0", "drag 1: force_sd: is not allowed; give one positive number"),
    ("[1, 2, 3]", "[-1, 2, 3]", "drag 1: displacement_mm: -1 is not allowed; give a finite number, at least 0"),
    ("load_n = 0.5", 'load_n = 0.5\nfoot = "left"', "drag 1: foot: 'left' is unknown; choose one of grips, slides"),
    ("load_n = 0.5", "load_n = 0.5\nweight = 1", "drag 1: 'weight' is unknown"),
    ("width_cm = [11.0, 10.5]", "", "diameter 1: give one column of width or height"),
    ("[0.1, 0.2]", "[0.1, 20]", "diameter 1: pressure: 137895.14 is not allowed"),
    ('"inching"', '"crawling"', "gait 1: gait: 'crawling' is neither a known gait"),
    ("columns = 2", "columns = 20", "gait 1: columns: 20 is not allowed; the gait has 8"),
    ("columns = 2", 'floor = "gravel"', "gait 1: floor: gravel is not allowed, as no friction on it was published"),
    (
        "columns = 2",
        "friction = 0.5",
        "gait 1: friction: 0.5 is not allowed; give that of sliding and of gripping feet",
    ),
    ("columns = 2", "seam_friction = -1", "gait 1: seam_friction: -1 is not allowed"),
    ('geometry = "small"', 'weight = "none"', "weight: 'none' is unknown; choose one of published, physical"),
    ("hill:5", "moon", "gait 1: terrain: 'moon' is unknown"),
    ("speed_mm_per_s = 12.0", "", "gait 1: column speed is missing"),
    ('geometry = "small"', 'geometry = "large"', "geometry: 'large' is unknown; choose one of published, small"),
    ("columns = 2", "pressure_kpa = -3", "a.toml: gait 1: pressure_kpa: -3 is not allowed; give a finite number"),
    ('"inching"', '""', "gait 1: gait is missing; name inching, rolling or the file of a gait"),
    ("[[gait]]", "[[walk]]", "'walk' is unknown; give geometry and tables [[drag]], [[diameter]], [[gait]]"),
    ("[[drag]]", "[[drag]", "Expected ']]'"),
]


@pytest.mark.parametrize(("old", "new", "message"), BAD)
def test_bad_measurements_are_one_line(morpholab, tmp_path, old, new, message):
    assert old in GOOD
    (tmp_path / "a.toml").write_text(GOOD.replace(old, new, 1))
    code, out, error = morpholab("calibrate a.toml")
    assert (code, out) == (2, "") and error.count("\n") == 1
    assert error.startswith("morpholab calibrate: error: a.toml: ") and message in error
