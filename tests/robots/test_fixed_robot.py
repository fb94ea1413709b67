"""A robot of one point offers all that the robot offers: whatever is public of robots is asked of it, or named here."""

import copy
import inspect
import pickle
from dataclasses import dataclass, replace

import numpy as np
import pytest
from articulated_files import CRAWLER
from hopper import Hopper

from optim.problems.robot_designing import RobotDesigning
from robots.abilities import FORMER
from robots.articulated.reflexes import DriveReflexes
from robots.articulated.robot import ArticulatedRobot
from robots.delegation import first_argument, public_members
from robots.outcome import Outcome
from robots.robot import FixedRobot, Measure, Place, Robot, Trial, load_design

OWN = {
    "parameters": "nothing is free",
    "start": "has no numbers",
    "points": "have no numbers",
    "design": "is itself",
    "differentiable": "derivatives are by parameters",
    "differentiate": "derivatives are by parameters",
    "run": "completes the points, and asks for no gradients",
    "run_in": "the robots of its variants are asked",
    "simulate": "leads to run",
    "simulate_in": "leads to run_in",
    "perturbed": "is a fixed robot again",
    "at_horizon": "is a fixed robot again",
    "changed": "is a fixed robot again",
    "describe": "the values belong to it",
    "document": "the values belong to it",
    "has_table": "there is no table",
    "can_be_judged": "there is no such check",
    "table": "is of a robot of which nothing is free",
    "rig_report": "is of a robot of which nothing is free",
    "judge": "is of a robot of which nothing is free",
    "pictured": "there is no such picture",
    "save_picture": "is of a robot of which nothing is free",
}
MEMBERS = public_members(Robot)
POINT = [300.0, 0.05]  # of a hopper
ASKED = sorted(MEMBERS.keys() - OWN.keys())


pytestmark = pytest.mark.filterwarnings("ignore:model. ignored")


class Answer:
    """What a member of the robot below was asked: its name, and with what."""

    def __init__(self, name, given=(), settings=None):
        self.name, self.given, self.settings = name, list(given), settings or {}


def answering(name):
    if inspect.isfunction(MEMBERS[name]):
        return lambda self, *given, **settings: Answer(name, given, settings)
    return property(lambda self: Answer(name))


Answering = type("Answering", (Robot,), {name: answering(name) for name in ASKED} | {"parameters": Hopper.parameters})


def test_what_is_not_asked_of_the_robot_is_named_with_a_reason():
    own = {name for name in vars(FixedRobot) if not name.startswith("_")} - set(ASKED)
    assert own == OWN.keys() and len(ASKED) >= 25
    assert {"feels", "readings", "felt_over_time", "measures_in", "spoken", "facts", "kind", "measures"} <= set(ASKED)


@pytest.mark.parametrize("name", ASKED)
def test_every_public_member_is_asked_of_the_robot_at_its_point(name):
    fixed = FixedRobot(Answering(), POINT)
    member = getattr(fixed, name)
    if not inspect.isfunction(MEMBERS[name]):
        assert isinstance(member, Answer) and member.name == name
        return
    first = first_argument(MEMBERS[name])
    given, wanted = {"points": (np.empty((3, 0)), [POINT] * 3), "point": ((), POINT)}.get(first, ("given", "given"))
    by_place, by_name = member(given, "more", also=1), member(also=1, **{first or "any": given})
    for answer, got in ((by_place, by_place.given.pop(0)), (by_name, by_name.settings.pop(first or "any"))):
        assert answer.name == name and answer.settings == {"also": 1} and np.array_equal(got, wanted)
    assert by_place.given == ["more"] and not by_name.given


@pytest.mark.parametrize("old", FORMER)
def test_a_class_that_says_something_by_a_former_name_is_refused(old):
    with pytest.raises(TypeError, match=rf"^Mine: {old} is called {FORMER[old]} now; rename it$"):
        type("Mine", (Robot,), {old: True})
    with pytest.raises(TypeError, match=rf"^Mine: {old} is called {FORMER[old]} now; rename it$"):
        type("Mine", (RobotDesigning,), {old: True})


def test_points_are_always_the_first_argument():
    """Only there are they completed."""
    for name, member in MEMBERS.items():
        names = list(inspect.signature(member).parameters)[1:] if inspect.isfunction(member) else []
        assert not {"point", "points"} & set(names[1:]), name


def test_points_of_another_shape_are_refused():
    fixed = Hopper().design(POINT)
    for wrong in (POINT, [[1.0], [2.0]]):
        with pytest.raises(ValueError, match=r"points: shape .* is not allowed; give finite numbers of \(N, 0\)"):
            fixed.columns(wrong)
    with pytest.raises(ValueError, match="points: shape"):
        fixed.facts_of(POINT)


def numbers(outcome):
    return {name: values.tolist() for name, values in outcome.measures.items()}


@pytest.fixture
def feeling():
    robot = ArticulatedRobot(
        CRAWLER, name="crawler", duration=0.1, reflexes=DriveReflexes(("clock", "angles"), gain=0.4)
    )
    return robot, robot.design(robot.start)


def test_a_robot_with_reflexes_feels_as_a_design_too(feeling):
    robot, fixed = feeling
    assert fixed.feels and fixed.horizons == robot.horizons and not fixed.differentiable
    assert fixed.facts() == robot.facts() and len(fixed.facts()) == 6
    spoken, longer = fixed.at_horizon(2)
    assert spoken == "2 seconds" and isinstance(longer, FixedRobot)
    assert longer.steps == replace(robot, duration=2.0).steps and longer.point.tolist() == robot.start.tolist()


@pytest.mark.kernels
def test_a_design_reads_and_does_what_the_robot_does_at_its_point(feeling):
    robot, fixed = feeling
    (world,) = robot.worlds
    assert fixed.readings((), world, 5).tolist() == robot.readings(robot.start, world, 5).tolist()
    wanted = numbers(robot.simulate(robot.start, world))
    (found,) = fixed.run_in(fixed.points(()), [world], Trial(world, gradients=("speed",)))
    for outcome in (found, *fixed.simulate_in([world]), fixed.simulate((), world)):
        assert numbers(outcome) == wanted and not outcome.gradients


def test_a_design_is_repeated_as_often_as_there_are_points():
    hopper = Hopper()
    found = hopper.design(POINT).simulate(np.empty((3, 0)), Place())
    assert found.measures["height"].tolist() == hopper.simulate([POINT] * 3, Place()).measures["height"].tolist()


def test_a_design_has_no_gradients(feeling):
    robot, fixed = feeling
    with pytest.raises(ValueError, match=r"^robot: articulated robot has no gradients; nothing of it is free$"):
        fixed.differentiate((), *robot.worlds)


def test_copies_and_pickles_are_the_same_design(feeling):
    _, fixed = feeling
    for other in (copy.copy(fixed), copy.deepcopy(fixed), pickle.loads(pickle.dumps(fixed))):
        assert isinstance(other, FixedRobot) and isinstance(other, Robot)
        assert other.point.tolist() == fixed.point.tolist() and other.name == "crawler" == fixed.name
    assert "ArticulatedDesign" in repr(fixed)


def test_a_design_keeps_its_values_when_the_array_changes():
    given = np.array(POINT)
    fixed = Hopper().design(given)
    given[:] = 0.0
    assert fixed.point.tolist() == POINT


def test_a_design_tells_its_values_and_of_which_robot(feeling, tmp_path):
    robot, fixed = feeling
    values = dict(zip([p.name for p in robot.parameters], robot.start.tolist(), strict=True))
    assert fixed.describe() == {"robot": robot.describe(), "values": values} and fixed.document() == {"values": values}
    fixed.save((), tmp_path / "fixed.json")
    robot.save(robot.start, tmp_path / "robot.json")
    assert (tmp_path / "fixed.json").read_bytes() == (tmp_path / "robot.json").read_bytes()
    assert load_design(tmp_path / "fixed.json").describe() == fixed.describe()
    assert fixed.design(()) is fixed and fixed.start.tolist() == []


@dataclass(frozen=True)
class Shaken(Robot):
    """A robot that a draw shakes, and that judges several worlds as one batch."""

    shake: float = 0.0

    kind = "hopper"
    measures = (Measure("sum"),)
    parameters = Hopper.parameters

    def perturbed(self, drawn):
        return replace(self, shake=drawn)

    def run_in(self, points, worlds, trial, variants=()):
        assert not trial.gradients
        return [Outcome({"sum": points.sum(axis=1) + each.shake}) for each in variants or [self] * len(worlds)]


def test_variants_of_a_design_are_tried_in_the_robots_own_batch():
    fixed = Shaken().design([300.0, 0.5])
    found = fixed.simulate_in([Place(), Place()], draws=[1.0, 2.0])
    assert [outcome.measures["sum"].tolist() for outcome in found] == [[301.5], [302.5]]


def test_a_class_of_fixed_robots_may_answer_for_itself():
    class Named(FixedRobot):
        name = "mine"

        def spoken(self, outcome):
            return f"so {super().spoken(outcome)}"

    fixed = Named(Hopper(), POINT)
    assert fixed.name == "mine" and fixed.spoken(fixed.simulate((), Place())).startswith("so height ")
    assert type(fixed.at_horizon(3)[1]) is Named
