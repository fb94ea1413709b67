"""Measures of a user's own of articulated robots: what laws see, and their gradients beside differences."""

import math

import numpy as np
import pytest
from articulated_files import CRAWLER
from crawlers import some_points

from morpholab import OwnMeasure
from optim.problems.robot import RobotProblem
from robots.articulated import ArticulatedRobot
from robots.articulated.loading import robot_of_record
from robots.articulated.worlds import GROUND
from robots.robot import load_design
from robots.world import Terrain
from taichi_sim.base.compute import Compute

FINE = Compute(precision="f64")
pytestmark = pytest.mark.filterwarnings("ignore:model. ignored")


def way(motion):
    """What the lab's own distance is."""
    return (motion.centres(motion.places) - motion.centres(motion.start_places)) @ motion.heading


def pose(motion):
    """A number to which all that is known of the end adds its part."""
    last = motion.places[:, -1]
    return (
        last[:, 2]
        + 0.3 * last[:, 1] ** 2
        + np.sin(motion.turns[:, 1, 2])
        + 0.5 * motion.angles[:, 0] * motion.angles[:, 1]
    )


OWN = OwnMeasure("way", "m", law=way), OwnMeasure("pose", law=pose)


def crawler(**settings):
    given = {"duration": 0.2, "friction": math.inf, "heading": 20.0, "own_measures": OWN, **settings}
    return ArticulatedRobot(CRAWLER, **given)


@pytest.mark.kernels
def test_a_law_sees_what_the_lab_measures_by():
    robot = crawler()
    points = some_points(robot, 3, 1)
    found = robot.differentiate(points, GROUND, measures=["way", "distance", "speed"], compute=FINE)
    np.testing.assert_allclose(found.measures["way"], found.measures["distance"], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(found.gradients["way"], found.gradients["distance"], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.gradients["speed"] * 0.2, found.gradients["distance"], rtol=1e-12)
    assert list(robot.differentiate(points, GROUND, measures=["pose"], compute=FINE).gradients) == ["pose"]


@pytest.mark.kernels
@pytest.mark.parametrize(("controller", "world"), [("rhythm", GROUND), ("network", Terrain(slope=5.0))])
def test_gradients_are_what_differences_say(controller, world):
    robot = crawler(controller=controller, light=(3.0, 1.0, 0.2))
    points, step = some_points(robot, 2, 3), 1e-6
    exact = robot.differentiate(points, world, measures=["pose"], compute=FINE).gradients["pose"]
    for n, moved in enumerate(step * np.eye(points.shape[1])):
        ends = [robot.simulate(points + sign * moved, world, compute=FINE).measures["pose"] for sign in (1, -1)]
        assert exact[:, n] == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-4, abs=1e-8)


@pytest.mark.kernels
def test_reflexes_have_the_gradients_of_several_measures_at_once():
    from robots.articulated.reflexes import DriveReflexes

    robot = crawler(reflexes=DriveReflexes(("angles",)))
    points = some_points(robot, 2, 5)
    both = robot.differentiate(points, GROUND, measures=["pose", "distance"], compute=FINE).gradients
    for name in both:
        alone = robot.differentiate(points, GROUND, measures=[name], compute=FINE).gradients[name]
        np.testing.assert_array_equal(both[name], alone)


def test_they_are_searched_and_kept_by_name(tmp_path):
    problem = RobotProblem(crawler(), objective=("distance", "minimise:0.1*pose"), summed=True)
    assert problem.objective_names == ("distance minus 0.1*pose",)
    with pytest.raises(ValueError, match=r"^own_measures: way is not kept in files, which hold no code; name it"):
        crawler().describe()
    with pytest.raises(ValueError, match=r"^own_measures: distance is a measure that the robot has anyway"):
        crawler(own_measures=(OwnMeasure("distance", law=way),))
    plain = crawler(own_measures=())
    crawler().save(crawler().start, tmp_path / "design.json")
    plain.save(plain.start, tmp_path / "plain.json")
    assert (tmp_path / "design.json").read_bytes() == (tmp_path / "plain.json").read_bytes()
    assert "own_measures" not in plain.describe() and robot_of_record(plain.describe()).describe() == plain.describe()


def test_saved_designs_take_measures_again(tmp_path):
    robot = crawler()
    robot.save(robot.start, tmp_path / "design.json")
    again = load_design(tmp_path / "design.json").changed({"own_measures": OWN})
    names = ["speed", "distance", "energy", "mass", "torque_limits", "way", "pose"]
    assert [measure.name for measure in again.measures] == names
    with pytest.raises(ValueError, match=r"^heading: articulated robot has its own; leave it out$"):
        load_design(tmp_path / "design.json").changed({"own_measures": OWN, "heading": 1.0})
