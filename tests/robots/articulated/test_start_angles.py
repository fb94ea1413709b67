"""Angles at which hinges of robots from files start, as commands take them."""

import json

import pytest
from articulated_files import CRAWLER

from robots.articulated import load_robot

pytestmark = [pytest.mark.kernels, pytest.mark.filterwarnings("ignore:model. ignored")]
BENT = "--angles shoulder=-0.2 --angles hip=0.1 --duration 0.2 --threads 1"


@pytest.fixture
def crawler(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    keyframe = '<keyframe><key name="home" qpos="0 0 0.1 1 0 0 0 -0.2 0.1"/></keyframe></mujoco>'
    (tmp_path / "crawler.xml").write_text(CRAWLER.replace("</mujoco>", keyframe))
    return tmp_path


def test_a_command_starts_hinges_at_angles_and_its_design_keeps_them(crawler, morpholab):
    bent = load_robot("crawler.xml", duration=0.2, angles={"shoulder": -0.2, "hip": 0.1})
    straight = load_robot("crawler.xml", duration=0.2)
    came, other = (each.simulate([each.start], each.worlds[0]).measures["distance"][0] for each in (bent, straight))
    code, out, error = morpholab(f"simulate --robot crawler.xml {BENT} --json")
    assert code == 0 and json.loads(out)["distance"] == came != other
    assert "ignored are <keyframe> (angles can be given)" in error
    search = "--method random --climbers 2 --generations 1 --quiet"
    assert morpholab(f"codesign --robot crawler.xml {BENT} {search} --out run")[0] == 0
    assert json.loads((crawler / "run/best.json").read_text())["robot"]["angles"] == bent.angles
    assert morpholab("simulate --robot run/best.json --json")[0] == 0


@pytest.mark.parametrize(
    ("angles", "message"),
    [
        ("--angles knee=0.2", "angles: there is no hinge 'knee'; there are shoulder, hip"),
        ("--angles 0.2", "angles: '0.2' is not allowed; give JOINT=RADIANS, as knee=0.6"),
        ("--angles hip=nan", "angles: 'hip=nan' is not allowed; give JOINT=RADIANS, as knee=0.6"),
        ("--angles hip=1 --angles hip=2", "angles: 'hip' is given twice; give each name once"),
    ],
)
def test_angles_of_no_hinge_and_of_no_number_are_refused(crawler, morpholab, angles, message):
    code, out, error = morpholab(f"simulate --robot crawler.xml {angles}")
    assert (code, out) == (2, "") and message in error.splitlines()[-1]
