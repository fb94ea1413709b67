"""The section of a report on the pneumatic rig, of runs that design how lattice robots are driven."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from run_products import searched

from optim.problems.lattice_robot import LatticeRobotProblem
from robots.hardware import Channel, OwnLines, PneumaticRig
from robots.lattice_robot import Drive, Free, LatticeRobot
from robots.lattice_robot.reflexes import Reflexes
from taichi_sim.lattice import Material, body_from_array

FOAM = Material(5e4, 1000.0, static_friction=1.0, kinetic_friction=0.5, name="foam")
RIG = PneumaticRig(
    name="two",
    channels=(Channel(0.1, 0.1, 0.0, 20.0, 500.0),) * 2,
    lines=OwnLines(("left", "right"), off_kpa=(0.0, 0.0), on_kpa=(20.0, 20.0)),
)


def crawler(**settings):
    """A bar of four voxels, of which both ends swell, in turn if nothing else is found."""
    body = body_from_array(np.ones((4, 1, 1), int), FOAM, 0.01, regions=np.array([1, 0, 0, 2])[:, None, None])
    drive = Drive("ends", (1, 2), amplitude=0.1, phase=(0.0, Free(0.0, 0.5)))
    return LatticeRobot(body, (drive,), **{"cycles": 1, "settling": 0.02, "frequency": 2.0, **settings})


@pytest.fixture
def reported(morpholab, tmp_path):
    """Reports a run of a robot: the text of the page, and what machines read of the design."""

    def report(robot, more=""):
        if not (tmp_path / "a").exists():
            searched(LatticeRobotProblem(robot, threads=1), tmp_path / "a", generations=0)
        code, out, error = morpholab(f"report a --no-player --out page.html --json --quiet {more}")
        assert code == 0, error
        text = re.sub("<[^>]*>", "", (tmp_path / "page.html").read_text())
        (tmp_path / "page.html").unlink()
        return " ".join(text.split()), json.loads(out)["design"]

    return report


@pytest.mark.kernels
def test_a_rig_of_own_lines_plays_designed_drives(morpholab, reported, tmp_path):
    RIG.save(tmp_path / "two.toml")
    text, design = reported(crawler(), "--rig two.toml")
    assert "On the pneumatic rig" in text and "It keeps every limit of this rig." in text
    names = {name for channel in design["rig"]["channels"] for name in channel["names"]}
    assert not design["rig"]["exceeded"] and names == {"left", "right"}
    assert "states of 0.031 s each" in text  # a sixteenth of a cycle
    assert morpholab("export a --csv gait.csv --rig two.toml")[0] == 0
    text, design = reported(crawler())
    assert "the default rig" in text and design["rig"]["channels"]


@pytest.mark.kernels
def test_drives_that_the_usual_rig_cannot_play_have_no_section(morpholab, reported, tmp_path):
    friction = Drive("grip", (1, 2), "friction", mean=0.5, amplitude=(0.1, Free(0.1, 0.3)))
    robot = replace(crawler(), drives=(friction,))
    text, design = reported(robot)
    assert "On the pneumatic rig" not in text and "rig" not in design
    RIG.save(tmp_path / "two.toml")
    text, design = reported(robot, "--rig two.toml")
    assert "no line plays grip (friction)" in text and design["rig"] is None


@pytest.mark.kernels
def test_a_robot_that_decides_is_played_by_no_rig(morpholab, tmp_path):
    robot = crawler(reflexes=Reflexes(("touch",)))
    with pytest.raises(ValueError, match=r"^robot: one with reflexes has no table of channels"):
        robot.filled(robot.start).rig_report(None)
    searched(LatticeRobotProblem(robot, threads=1), tmp_path / "a", generations=0)
    code, _, error = morpholab("report a --rig dissertation --out b.html --quiet")
    assert (code, error) == (2, "morpholab report: error: rig: no rig plays designs of a; leave it out\n")
