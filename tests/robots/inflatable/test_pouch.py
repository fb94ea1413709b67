"""The inflatable robot that feels: its bladders, its answers, and derivatives through both."""

import numpy as np
import pytest

from robots.inflatable import ACTUATION, InflatableGeometry
from robots.inflatable.body import BLADDER_REGIONS, SMALL, TWO_CORE
from robots.inflatable.pouch import GAIN, SWING, feeling_pouch
from robots.kind import KINDS
from robots.lattice_robot import Drive, LatticeRobot, save_robot
from robots.lattice_robot.record import robot_of_record
from robots.lattice_robot.reflexes import Reflexes
from robots.robot import Compute, Trial
from robots.world import Terrain

TINY = InflatableGeometry(bladder_columns=1, rows=7, foot_rows=1, closed=True)
LIT = Terrain.parse("flat+light:0.25,0")
EXACT = Compute(precision="f64", threads=1)


def tiny(pressure=6e3):
    """Its waves are quick, so that few steps see all."""
    reflexes = Reflexes(("touch", "tilt", "light", "clock"), gain=GAIN)
    return feeling_pouch(TINY, pressure, reflexes, frequency=8.0, cycles=1, settling=0.02)


def drawn(robot, seed=1):
    """A point with random waves and weights."""
    low, high = (np.array([getattr(each, end) for each in robot.parameters]) for end in ("low", "high"))
    point = np.random.default_rng(seed).uniform(low, high)
    point[:8] *= 0.4  # gently, so that no contact comes or goes within a difference
    point[20:] *= 0.3
    return point


@pytest.mark.parametrize("pressure", [0.0, 6e3])
def test_bladders_lengthen_as_in_the_published_experiment(pressure):
    """By 1/c of what they thicken, with c rising with the pressure; and widen by a twentieth."""
    robot, count = tiny(pressure), len(BLADDER_REGIONS)
    point = robot.start.copy()
    point[:count], point[count : 2 * count] = SWING, 0.25
    across, along, _ = ACTUATION.growth(pressure)
    thick, long, wide = np.asarray(robot.nodes(point[None])[0])[0, :, 0]
    assert thick[0] == pytest.approx(1 + SWING) and thick[8] == pytest.approx(1 - SWING)
    assert long - 1 == pytest.approx(along * (thick - 1)) and wide - 1 == pytest.approx(across * (thick - 1))
    assert pytest.approx(ACTUATION.deflated) == 1 - SWING - GAIN


@pytest.mark.kernels
def test_the_gradient_is_that_of_central_differences():
    """By waves and weights, through touch, tilt, light and time, with contact, over thousands of steps."""
    robot = tiny()
    point = drawn(robot)
    found = robot.run(point[None], Trial(LIT, EXACT, gradients=("remaining",)))
    assert found.steps[0] > 2000
    gradient, step = found.gradients["remaining"][0], 1e-7
    for place in (0, 9, 12, 25, 80, 150, 187):
        both = point + step * np.array([[1.0], [-1.0]]) * np.eye(len(point))[place]
        ahead, behind = robot.simulate(both, LIT, compute=EXACT).measures["remaining"]
        difference = (ahead - behind) / (2 * step)
        assert gradient[place] == pytest.approx(difference, rel=1e-4, abs=1e-7), robot.parameters[place].name


@pytest.mark.kernels
def test_answers_move_bladders_along_all_axes_and_survive_files(tmp_path):
    """A robot whose weights are zero plays its waves; one that answers goes elsewhere; a saved one goes as far."""
    robot = tiny()
    point = drawn(robot)
    silent = np.concatenate([point[:20], np.zeros(len(point) - 20)])
    quiet, answering = robot.simulate([silent, point], LIT, compute=EXACT).measures["remaining"]
    assert quiet != answering
    saved = robot_of_record(robot.design(point).describe())
    assert saved.drives[0].proportions == robot.drives[0].proportions
    assert saved.simulate(np.zeros((1, 0)), LIT, compute=EXACT).measures["remaining"][0] == answering
    save_robot(robot.design(point), tmp_path / "pouch.json")
    assert KINDS["lattice"].build(str(tmp_path / "pouch.json"), {}).simulate((), LIT, compute=EXACT).measures[
        "remaining"
    ] == [answering]


@pytest.mark.kernels
def test_along_an_axis_without_a_part_neither_wave_nor_answer_moves():
    reflexes = Reflexes(("touch", "tilt", "clock"), gain=GAIN)
    regions = tuple(BLADDER_REGIONS.tolist())

    def gone(axes, proportions):
        drive = Drive("bladder", regions, amplitude=0.3, phase=0.1, axes=axes, proportions=proportions)
        robot = LatticeRobot(TINY.body, (drive,), frequency=8.0, cycles=1, settling=0.02, reflexes=reflexes)
        point = np.random.default_rng(2).normal(0.0, 0.5, robot.start.shape)
        return robot.simulate(point[None], Terrain(), compute=EXACT).measures["distance"][0]

    alone = gone("z", ())
    assert gone("zy", (1.0, 0.0)) == alone != gone("zy", (1.0, 0.5))


def test_answers_shrink_a_voxel_by_their_part_along_each_axis():
    """So a robot is refused whose bladders might shrink to nothing along an axis that goes further than the first."""
    reflexes = Reflexes(("tilt",), gain=0.3)

    def robot(along):
        drive = Drive("bladder", (5,), amplitude=0.1, axes="zy", proportions=(1.0, along))
        return LatticeRobot(TINY.body, (drive,), reflexes=reflexes)

    assert robot(1.0).fault(robot(1.0).start) == ""
    assert robot(-4.0).fault(robot(-4.0).start).startswith("bladder shrinks to -0.6 of a voxel")


def test_bad_input_is_told():
    with pytest.raises(ValueError, match=r"^cores: 2 is not allowed; give a geometry of one core"):
        feeling_pouch(TWO_CORE)
    with pytest.raises(ValueError, match=r"^pressure: -1 is not allowed"):
        feeling_pouch(TINY, -1)
    with pytest.raises(ValueError, match=r"^pressure: 1 is not allowed in a geometry that is not closed"):
        feeling_pouch(SMALL, 1.0)
    with pytest.raises(ValueError, match=r"^geometry: 'small' is unknown; choose one of small-closed, closed"):
        KINDS["pouch"].build(None, {"geometry": "small"})
    with pytest.raises(ValueError, match=r"^robot: mine.json is no pouch"):
        KINDS["pouch"].build("mine.json", {})
    assert KINDS["pouch"].build(None, {"pressure": 1e3}).drives[-1].mean == 1e3
