"""A robot some of whose parameters are held does what the robot does at the whole points."""

import inspect
import json
import pickle

import numpy as np
import pytest
from hopper import Hopper
from tossers import Tosser

import morpholab as ml
from optim.problems.robot import RobotProblem
from optim.problems.robot_designing import seeded
from robots.delegation import public_members
from robots.partly_fixed import PartlyFixed, held_at, robot_of_description
from robots.robot import KINDS, Place, Robot, Trial

POINT = [300.0, 0.05]  # of a hopper: stiffness and stroke
HELD = held_at(Hopper(), POINT, ["stiff*"])
STROKES = np.array([[0.02], [0.05], [0.08]])
WHOLE = np.column_stack([np.full(3, POINT[0]), STROKES])


def test_what_is_held_is_no_parameter():
    assert [each.name for each in HELD.parameters] == ["stroke"] and HELD.held == {"stiffness": 300.0}
    assert HELD.start.tolist() == [Hopper().start[1]] and HELD.points([0.03]).shape == (1, 1)
    assert HELD.describe() == {"robot": Hopper().describe(), "held": {"stiffness": 300.0}}


def test_it_does_what_the_robot_does():
    hopper, place = Hopper(), Place()
    wanted = hopper.simulate(WHOLE, place).measures
    tried = (HELD.simulate(STROKES, place), *HELD.run_in(STROKES, [place, place], Trial(place)))
    for found in tried:
        assert {name: values.tolist() for name, values in found.measures.items()} == {
            name: values.tolist() for name, values in wanted.items()
        }
    slopes = HELD.differentiate(STROKES, place).gradients["height"]
    assert slopes.tolist() == hopper.differentiate(WHOLE, place).gradients["height"][:, 1:].tolist()


def test_designs_files_and_longer_trials_are_the_robots(tmp_path):
    point = [0.08]
    HELD.save(point, tmp_path / "own.json")
    Hopper().save([300.0, 0.08], tmp_path / "whole.json")
    assert (tmp_path / "own.json").read_bytes() == (tmp_path / "whole.json").read_bytes()
    assert HELD.design(point).point.tolist() == [300.0, 0.08]
    spoken, longer = HELD.at_horizon(2)
    assert spoken == "2 s" and longer.steps == 2 * HELD.steps and longer.held == HELD.held
    again = pickle.loads(pickle.dumps(HELD))
    assert again.simulate(point, Place()).measures["height"] == HELD.simulate(point, Place()).measures["height"]


def test_every_member_whose_points_are_the_robots_completes_them():
    for name, member in public_members(Robot).items():
        if inspect.isfunction(member) and {"point", "points"} & set(inspect.signature(member).parameters):
            assert name in vars(PartlyFixed), name


@pytest.mark.parametrize(
    ("patterns", "message"),
    [
        (["stif"], r"hold: stif matches none of stiffness, stroke; did you mean stiffness\?"),
        (["*"], "hold: all 2 parameters are held; leave some free"),
    ],
)
def test_what_cannot_be_held_is_refused(patterns, message):
    with pytest.raises(ValueError, match=message):
        held_at(Hopper(), POINT, patterns)


def test_the_only_parameter_cannot_be_held():
    with pytest.raises(ValueError, match=r"^hold: toss is the only parameter; leave it free$"):
        held_at(Tosser(), [2.0], ["*"])


def test_an_unknown_name_is_refused():
    with pytest.raises(ValueError, match=r"held: 'strok' is no free parameter; did you mean stroke"):
        PartlyFixed(Hopper(), {"strok": 0.1})


@pytest.mark.parametrize("name", ["vehicle", "walker", "soft-quadruped", "freeform", "legged"])
def test_robots_of_all_kinds_start_where_they_do_and_are_built_again(name):
    robot = ml.robot(name)
    first, second = (parameter.name for parameter in robot.parameters[:2])
    held = held_at(robot, robot.start, first)
    assert held.start.tolist() == robot.start[1:].tolist()
    kind = KINDS.of(robot)
    twice = held_at(held, held.start, second) if len(held.parameters) > 1 else held
    described = json.loads(json.dumps(twice.describe(), default=lambda value: value.tolist()))
    again = robot_of_description(kind, described)
    assert isinstance(again, PartlyFixed) and again.held == twice.held
    assert json.dumps(again.describe(), default=str) == json.dumps(twice.describe(), default=str)
    assert [each.name for each in again.parameters] == [each.name for each in twice.parameters]


def test_a_held_robot_is_seeded_as_any():
    robot = ml.robot("freeform")
    problem = RobotProblem(held_at(robot, robot.start, robot.parameters[0].name))
    five = seeded(problem.describe(), 0, 5)
    assert json.loads(five["robot"])["robot"]["seed"] == 5 and json.loads(five["robot"])["held"] == problem.robot.held


def test_of_a_design_nothing_can_be_held():
    robot = ml.robot("vehicle")
    with pytest.raises(ValueError, match=r"^hold: nothing of .* is free; give the run that designed it, or its file$"):
        held_at(robot.design(robot.start), (), "w1")
