"""``--hold``: a body that was found is measured, and searched on, with its sizes as the best design has them."""

import json

import numpy as np
import pytest
from articulated_files import CRAWLER

from morpholab import build_method, open_run, run_search
from optim.problems import problem_of_run
from optim.problems.robot import RobotProblem
from optim.runs.config import read_config, settings_of
from robots.articulated.robot import ArticulatedRobot
from robots.free import Free
from robots.partly_fixed import held_at
from robots.robot import Place

BODY = "--robot crawler.xml --duration 0.3 --body-sizes front=0.5:2"
OWN = """
from morpholab import OwnMeasure, robot as robot_of

def sideways(motion):
    return motion.places[:, 0, 1]

robot = robot_of(
    "crawler.xml", duration=0.3, body_sizes="front=0.5:2", own_measures=(OwnMeasure("drift", "m", law=sideways),)
)
"""
TRIED = "--success 'speed >= 0.01' --controllers 12 --quiet --json"


@pytest.fixture
def crawler(tmp_path):
    """The robot's file, in the folder where commands run."""
    (tmp_path / "crawler.xml").write_text(CRAWLER)
    return tmp_path


@pytest.mark.kernels
def test_a_found_body_is_measured_with_the_controllers_of_any(crawler, morpholab):
    line = f"codesign {BODY} --method cma --population 4 --generations 2 --terrain hill:2 --quiet --out run"
    assert morpholab(line)[0] == 0
    code, out, error = morpholab(f"measure --robot run --hold '*_size' {TRIED} --out found")
    assert code == 0, error
    size = json.loads((crawler / "run" / "best.json").read_text())["values"]["front_size"]
    held = json.loads((crawler / "found" / "measures.json").read_text())
    assert held["robot"]["held"] == {"front_size": size} and held["environments"] == ["hill:2"]  # as in the run
    fixed = BODY.replace("0.5:2", repr(size))
    code, alone, error = morpholab(f"measure {fixed} --environments hill:2 {TRIED} --out fixed")
    assert code == 0, error
    found, alone = json.loads(out), json.loads(alone)
    assert found["learnability"] == alone["learnability"] and found["resistance"] == alone["resistance"]


@pytest.mark.kernels
def test_of_a_robot_without_a_run_starting_values_are_held(crawler, morpholab):
    code, _, error = morpholab(f"measure {BODY} --hold '*_size' --hold frequency {TRIED} --out a")
    assert code == 0, error
    robot = ArticulatedRobot(CRAWLER, duration=0.3, body_sizes={"front": 1.0})
    held = json.loads((crawler / "a" / "measures.json").read_text())["robot"]["held"]
    assert held["front_size"] == 1.0 and held["frequency"] == robot.start[0] and len(held) == 2
    assert np.isfinite(json.loads((crawler / "a" / "metrics.json").read_text())["learnability"]["value"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--hold size", "hold: size matches none of frequency, "),
        ("--hold '*'", "hold: all 8 parameters are held; leave some free"),
    ],
)
def test_what_cannot_be_held_is_refused(options, message, crawler, morpholab):
    code, out, error = morpholab(f"measure {BODY} {options} {TRIED} --out a")
    assert code == 2 and not out and f"error: {message}" in error


@pytest.mark.kernels
def test_a_run_of_which_nothing_is_held_is_refused(crawler, morpholab):
    assert (
        morpholab(f"codesign {BODY} --method random --generations 1 --climbers 2 --terrain flat --quiet --out run")[0]
        == 0
    )
    code, _, error = morpholab(f"measure --robot run {TRIED} --out a")
    assert code == 2 and "hold: nothing of the best design of run; name what is no controller, of frequency, " in error


@pytest.mark.kernels
def test_a_search_with_parameters_held_goes_on_and_its_design_is_the_robots(crawler, morpholab):
    robot = ArticulatedRobot(CRAWLER, duration=0.3, body_sizes={"front": Free(0.5, 2.0)})
    held = held_at(robot, [*robot.start[:-1], 1.5], ["*_size"])
    problem, folder = RobotProblem(held, ["flat"]), crawler / "run"
    settings = {"climbers": 2, "seed": 0}
    with open_run(folder, settings_of(problem, "random", settings, 2)) as run:
        run_search(problem, build_method("random", problem.space, settings), run, 2)
    assert problem_of_run(folder, read_config(folder)).describe() == problem.describe()
    code, out, error = morpholab("codesign --resume --generations 3 --quiet --json --out run")
    assert code == 0, error
    assert json.loads((folder / "best.json").read_text())["values"]["front_size"] == 1.5
    best = json.loads(morpholab("status run --json")[1])[0]["best"]
    code, out, _ = morpholab("simulate --robot run --quiet --json")
    assert code == 0 and json.loads(out)["speed"] == pytest.approx(best)


FOUND = f"codesign {BODY} --method cma --population 4 --generations 1 --terrain hill:2 --quiet --out run"
FEW = "--method random --climbers 2 --quiet"


def held_in(folder):
    """What a run holds, by name, of the outermost robot."""
    return json.loads(read_config(folder)["problem"]["robot"])["held"]


@pytest.mark.kernels
def test_a_search_goes_on_from_the_body_of_another_one(crawler, morpholab):
    assert morpholab(FOUND)[0] == 0
    size = json.loads((crawler / "run" / "best.json").read_text())["values"]["front_size"]
    code, _, error = morpholab(f"codesign --robot run --hold '*_size' {FEW} --generations 1 --out gait")
    assert code == 0, error
    problem = problem_of_run(crawler / "gait", read_config(crawler / "gait"))
    assert held_in(crawler / "gait") == {"front_size": size} and [world.name for world in problem.tried_in] == [
        "hill:2"
    ]
    assert "front_size" not in problem.space.names and "frequency" in problem.space.names
    assert morpholab("report gait --no-player --quiet --out page.html")[0] == 0
    assert f"front_size = {size:.4g}" in (crawler / "page.html").read_text()
    for more in ("", "--robot run --hold '*_size'", "--robot run", BODY):  # as much as is said again of the robot
        code, _, error = morpholab(f"codesign --resume {more} --generations 2 --quiet --out gait")
        assert code == 0, error
    for more in ("--method random", "--terrain flat --duration 0.2"):  # other worlds and options, once more held
        line = f"codesign --robot gait --hold frequency {more} --climbers 2 --generations 0 --quiet --out again"
        assert morpholab(line)[0] == 0
        found = problem_of_run(crawler / "again", read_config(crawler / "again"))
        assert [world.name for world in found.tried_in] == (["flat"] if "flat" in more else ["hill:2"])
        assert len(found.space.names) == 6 and found.offered.robot.held == {"front_size": size}
        (crawler / "again").rename(crawler / f"again-{len(more)}")


@pytest.mark.kernels
def test_starting_values_of_a_file_are_held_in_a_search(crawler, morpholab):
    code, _, error = morpholab(f"codesign {BODY} --hold '*_size' --hold 'a_*' {FEW} --generations 0 --out a")
    assert code == 0, error
    assert set(held_in(crawler / "a")) == {"front_size", "a_amplitude", "a_phase", "a_offset"}
    assert held_in(crawler / "a")["front_size"] == 1.0


@pytest.mark.kernels
def test_other_parameters_than_those_held_are_refused_where_a_run_goes_on(crawler, morpholab):
    assert morpholab(FOUND)[0] == 0
    assert morpholab(f"codesign --robot run --hold '*_size' {FEW} --generations 0 --out gait")[0] == 0
    for line, message in (
        ("--resume --hold frequency --out gait", "hold: the run in gait holds front_size; leave it out"),
        ("--resume --hold frequency --out run", "hold: nothing is held in the run in run; leave it out"),
        (f"--resume {BODY.replace('2', '3')} --out gait", "robot: crawler.xml is not the robot of the run in gait"),
        (
            "--robot run --out new",
            "hold: nothing of the best design of run; name what shall stay as it is, of frequency",
        ),
        ("--robot run --hold weight --out new", "hold: weight matches none of frequency, "),
        ("--robot inflatable --hold frequency --out new", "hold: it is an option of other kinds"),
    ):
        code, _, error = morpholab(f"codesign {line}")
        assert code == 2 and f"error: {message}" in error and not (crawler / "new").exists(), line


@pytest.mark.kernels
def test_what_a_run_held_stays_held_without_another_word(crawler, morpholab):
    assert morpholab(FOUND)[0] == 0
    assert morpholab(f"codesign --robot run --hold '*_size' {FEW} --generations 0 --out gait")[0] == 0
    size = held_in(crawler / "gait")
    for hold, out in (("", "same"), ("--hold '*_size'", "again"), ("--hold '*_size' --hold frequency", "more")):
        code, _, error = morpholab(f"codesign --robot gait {hold} {FEW} --generations 0 --out {out}")
        assert code == 0, error
        code, _, error = morpholab(f"codesign --resume {hold} --generations 1 --quiet --out {out}")
        assert code == 0, error
    assert held_in(crawler / "same") == held_in(crawler / "again") == size
    assert held_in(crawler / "more").keys() == {"frequency"}
    code, _, error = morpholab(f"measure --robot gait {TRIED} --out m")
    assert code == 0, error
    code, _, error = morpholab("codesign --resume --hold frequency --out same")
    assert code == 2 and "hold: the run in same holds front_size; leave it out" in error


@pytest.mark.kernels
def test_weights_of_a_vehicle_are_held(crawler, morpholab):
    code, _, error = morpholab(f"codesign --robot vehicle --design 162 --hold w1 {FEW} --generations 0 --out a")
    assert code == 0, error
    assert problem_of_run(crawler / "a", read_config(crawler / "a")).space.names == ("w2",)
    assert morpholab(f"codesign --robot vehicle --design 162 {FEW} --generations 0 --out b")[0] == 0
    code, _, error = morpholab(f"codesign --robot b {FEW} --generations 0 --out c")
    assert code == 2 and "hold: nothing of the best design of b; name what shall stay as it is, of w1, w2" in error


@pytest.mark.kernels
def test_gaits_of_the_inflatable_robot_go_on_from_no_run(crawler, morpholab):
    search = "--terrain flat --geometry small --method random --climbers 1 --generations 0 --quiet"
    assert morpholab(f"codesign {search} --out a")[0] == 0
    code, _, error = morpholab(f"codesign --robot a {search} --out b")
    assert code == 2 and "robot: a is a run; inflatable robot goes on from none, give a/best.json" in error


@pytest.mark.kernels
def test_level_ground_of_earlier_versions_is_that_of_today(crawler, morpholab):
    """A run that calls it ``ground`` goes on with that name, and one from it begins with today's."""
    robot = ArticulatedRobot(CRAWLER, duration=0.3, body_sizes={"front": Free(0.5, 2.0)})
    problem, folder = RobotProblem(robot, [Place("ground"), "hill:5"]), crawler / "run"
    with open_run(folder, settings_of(problem, "random", {"climbers": 2, "seed": 0}, 0)) as run:
        run_search(problem, build_method("random", problem.space, {"climbers": 2, "seed": 0}), run, 0)
    assert read_config(folder)["problem"]["worlds"] == ["ground", "hill:5"]
    line = "codesign --resume --terrain flat --terrain hill:5 --generations 1 --quiet --out run"
    code, _, error = morpholab(line)
    assert code == 0, error
    assert read_config(folder)["problem"]["worlds"] == ["ground", "hill:5"]
    assert morpholab(f"codesign --robot run --hold '*_size' {FEW} --generations 0 --out next")[0] == 0
    assert read_config(crawler / "next")["problem"]["worlds"] == ["flat", "hill:5"]


@pytest.mark.kernels
def test_a_measure_of_ones_own_goes_on_with_what_is_held(crawler, morpholab):
    (crawler / "own.py").write_text(OWN)
    line = "codesign --robot own.py --objective drift --hold '*_size' --terrain flat"
    assert morpholab(f"{line} {FEW} --generations 0 --out a")[0] == 0
    code, _, error = morpholab("codesign --resume --generations 1 --quiet --out a")
    assert code == 2 and "robot: is missing for the run in a; give --robot " in error
    for more in ("", "--hold '*_size'"):
        code, _, error = morpholab(f"codesign --resume --robot own.py {more} --generations 1 --quiet --out a")
        assert code == 0, error


@pytest.mark.kernels
def test_more_of_a_run_is_free_where_options_say_so_while_its_gait_is_held(crawler, morpholab):
    assert morpholab(f"codesign --robot crawler.xml --duration 0.3 {FEW} --generations 0 --out gait")[0] == 0
    line = f"codesign --robot gait --hold '*' --body-sizes front=0.5:2 --hinge-stiffness rear=0.5:4 {FEW}"
    code, _, error = morpholab(f"{line} --generations 0 --out body")
    assert code == 0, error
    assert held_in(crawler / "body") == json.loads((crawler / "gait/best.json").read_text())["values"]
    problem = problem_of_run(crawler / "body", read_config(crawler / "body"))
    assert problem.space.names == ("front_size", "rear_stiffness")
    code, _, error = morpholab(f"{line} --generations 1 --resume --out body")
    assert code == 0, error
    again = line.replace("front", "rear").replace("gait", "body").replace("'*'", "rear_stiffness")
    code, _, error = morpholab(f"{again} --generations 0 --out new")
    assert code == 2 and "error: body_sizes: the run has front=0.5:2; give that, too, or free it by this name" in error
    again = again.replace("--hinge", "--body-sizes front=0.5:2 --hinge")
    code, _, error = morpholab(f"{again} --generations 0 --out new")
    assert code == 0, error
    problem = problem_of_run(crawler / "new", read_config(crawler / "new"))
    assert set(problem.space.names) == {"front_size", "rear_size"}


@pytest.mark.kernels
def test_what_a_run_has_fixed_stays_so_where_more_is_free(crawler, morpholab):
    """Its front was back at size 1, and weights of one sense became those of another, without a word."""
    body = "--robot crawler.xml --duration 0.3 --body-sizes front=1.5 --reflexes touch"
    assert morpholab(f"codesign {body} {FEW} --generations 0 --out gait")[0] == 0
    line = f"codesign --robot gait --hold frequency {FEW} --generations 0 --out new"
    for more, message in (
        ("--body-sizes rear=0.5:2", "body_sizes: the run has front=1.5; give that, too, or free it by this name"),
        (
            "--body-sizes front=2 --body-sizes rear",
            "body_sizes: the run has front=1.5; give that, too, or free it by this name",
        ),
        ("--reflexes tilt", "reflexes: the run has its own; leave it out"),
    ):
        code, _, error = morpholab(f"{line} {more}")
        assert code == 2 and f"error: {message}" in error and not (crawler / "new").exists(), more
    assert morpholab(f"codesign {BODY} {FEW} --generations 0 --out body")[0] == 0
    narrow = (
        f"codesign --robot body --hold '*' --body-sizes front=2.5:3 --body-sizes rear {FEW} --generations 0 --out new"
    )
    code, _, error = morpholab(narrow)
    assert (
        code == 2 and "error: hold: front_size of body is " in error and "beyond 2.5 to 3; give a range that" in error
    )
    code, _, error = morpholab(f"{line} --body-sizes front=1.5 --body-sizes rear=0.5:2 --reflexes touch")
    assert code == 0, error
    robot = problem_of_run(crawler / "new", read_config(crawler / "new")).offered.robot
    assert robot.body_sizes["front"] == 1.5 and robot.parameters[-1].name == "rear_size"
