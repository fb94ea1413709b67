"""Objectives by name: goals with weights and signs, combined over worlds, summed or side by side."""

import json

import numpy as np
import pytest
from plug_in import install

from optim.maximising import maximise
from optim.problem import Objective, objectives_of
from optim.problems import problem_of_description
from optim.problems.goals import Goal, named
from optim.problems.limits import Limit
from optim.problems.objectives import OBJECTIVES, RobotObjective
from optim.problems.robot import RobotProblem
from robots.freeform.grid import Grid
from robots.freeform.robot import FreeformRobot
from robots.lattice_robot.presets import light_seeker
from robots.robot import Measure, Outcome, Parameter, Place, Robot
from robots.world import Terrain

POINTS = np.array([[0.5, 2.0], [1.5, 1.0], [-1.0, 0.3]])


class Cart(Robot):
    """Its speed and cost are plain functions of two numbers, and depend on where it is."""

    kind = "freeform"
    parameters = (Parameter("push", -2.0, 2.0), Parameter("gear", 0.1, 3.0))
    measures = (Measure("speed", "m/s"), Measure("cost", "J", "work of the motor"), Measure("heat", "J"))
    worlds = (Place("flat"), Place("steep"))
    differentiable = True
    asked = None

    def run(self, points, trial):
        self.asked = trial.gradients
        push, gear = points.T
        load = 3.0 if trial.world.name == "steep" else 1.0
        measures = {"speed": push * gear - load * push**2, "cost": load * push**2 + gear, "heat": load * gear}
        slopes = {
            "speed": np.stack([gear - 2 * load * push, push], axis=1),
            "cost": np.stack([2 * load * push, np.ones(len(push))], axis=1),
        }
        return Outcome(measures, gradients={n: slopes[n] for n in trial.gradients if n in slopes})


class Spread(RobotObjective):
    """How much the measure differs between worlds."""

    def values(self, outcomes, measure):
        return np.ptp([outcome.measures[measure.name] for outcome in outcomes], axis=0)[:, None]


class Root(RobotObjective):
    """The root of a measure, with its slopes."""

    def objective(self, measure):
        return Objective(f"root {measure.name}", measure.unit)

    def score(self, outcome, measure):
        return np.sqrt(outcome.measures[measure.name])

    def slopes(self, outcome, measure):
        return 0.5 * super().slopes(outcome, measure) / self.score(outcome, measure)[:, None]


@pytest.fixture
def packaged(tmp_path, monkeypatch):
    """Objectives of an installed package."""
    install(tmp_path, "kit", "morpholab.objectives", {"spread": "kit:Spread", "root": "kit:Root"})
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(OBJECTIVES, "_loaded", {**OBJECTIVES._loaded, "spread": Spread, "root": Root})


def judged(*objective, **settings):
    """A problem, and what its objectives are called."""
    problem = RobotProblem(Cart(), objective=objective, **settings)
    return problem, [(one.name, one.unit) for one in objectives_of(problem)]


def test_goals_are_written_in_one_way():
    assert Goal.of("minimise:0.10*energy") == Goal("energy", 0.1, minimised=True)
    assert Goal.of("1*speed").text == "speed" and Goal.of("2.0*speed").text == "2*speed"
    assert Goal.of("minimise:0.10*energy").text == "minimise:0.1*energy"
    assert named(["0.5*speed", "worst"]) == ("worst", "0.5*speed") and named("each") == named(["each"]) == "each"
    assert named(["speed"], "each") == ("each", "speed")


def test_each_goal_is_an_objective_and_the_worst_of_a_minimised_one_is_the_largest():
    problem, told = judged("worst", "speed", "minimise:0.5*cost")
    assert told == [("worst speed", "m/s"), ("minus 0.5*worst cost", "J")]
    found = problem.evaluate(POINTS)
    flat, steep = (Cart().simulate(POINTS, world).measures for world in Cart.worlds)
    assert np.array_equal(found.objectives[:, 0], np.minimum(flat["speed"], steep["speed"]))
    assert np.array_equal(found.objectives[:, 1], -0.5 * np.maximum(flat["cost"], steep["cost"]))
    assert np.array_equal(found.details["cost_steep"], steep["cost"])
    problem, told = judged("each", "speed", "minimise:cost")
    assert [name for name, _ in told] == ["speed_flat", "speed_steep", "minus cost_flat", "minus cost_steep"]
    assert np.array_equal(problem.evaluate(POINTS).objectives[:, 3], -steep["cost"])
    assert problem.curves["cost_steep"] == "cost [J] steep"


@pytest.mark.parametrize("word", ["mean", "worst"])
def test_a_sum_is_one_objective_with_a_gradient(word):
    problem, told = judged(word, "2*speed", "minimise:0.5*cost", summed=True)
    two, half = ("worst speed", "worst cost") if word == "worst" else ("speed", "cost")
    assert told == [(f"2*{two} minus 0.5*{half}", "")]
    apart = judged(word, "2*speed", "minimise:0.5*cost")[0].evaluate(POINTS).objectives
    found = problem.evaluate_relaxed(POINTS, np.inf, gradients=True)
    assert np.array_equal(found.objectives[:, 0], apart.sum(axis=1))
    assert problem.robot.asked == ("speed", "cost")
    for n, step in enumerate(1e-6 * np.eye(2)):
        up, down = (problem.evaluate(POINTS + way * step).objectives[:, 0] for way in (1, -1))
        assert found.gradients[:, n] == pytest.approx((up - down) / 2e-6, rel=1e-6, abs=1e-7)


def test_a_measure_by_itself_is_judged_and_differentiated_as_ever():
    old = RobotProblem(Cart(), objective="worst", measure="cost")
    new, told = judged("worst", "cost")
    assert told == [("worst cost", "J")]
    first, second = (each.evaluate_relaxed(POINTS, np.inf, gradients=True) for each in (old, new))
    assert np.array_equal(first.objectives, second.objectives) and np.array_equal(first.gradients, second.gradients)
    assert new.robot.asked == ("cost",)


def test_a_part_without_a_gradient_is_named(packaged):
    for objective, name in ((("speed", "minimise:heat"), "heat"), (("speed", "spread"), "speed")):
        with pytest.raises(ValueError, match=f"^objective: {name} has no gradient; choose another method$"):
            judged(*objective, summed=True)[0].evaluate_relaxed(POINTS, np.inf, gradients=True)
    with pytest.raises(ValueError, match="several have no single gradient"):
        judged("speed", "cost")[0].evaluate_relaxed(POINTS, np.inf, gradients=True)


def test_objectives_of_packages_are_named_among_others(packaged):
    problem, told = judged("worst", "speed", "minimise:0.5*root", measure="cost")
    assert told == [("worst speed", "m/s"), ("minus 0.5*worst root cost", "J")]
    flat, steep = (Cart().simulate(POINTS, world).measures["cost"] for world in Cart.worlds)
    assert np.array_equal(problem.evaluate(POINTS).objectives[:, 1], -0.5 * np.sqrt(np.maximum(flat, steep)))
    problem, told = judged("minimise:root", "speed", measure="cost", summed=True)
    assert told == [("minus root cost plus speed", "")]
    found = problem.evaluate_relaxed(POINTS, np.inf, gradients=True)
    up, down = (problem.evaluate(POINTS + way * np.array([1e-6, 0])).objectives[:, 0] for way in (1, -1))
    assert found.gradients[:, 0] == pytest.approx((up - down) / 2e-6, rel=1e-6)
    problem, told = judged("minimise:spread", "speed", measure="cost")
    assert np.array_equal(problem.evaluate(POINTS).objectives[:, 0], -np.ptp([flat, steep], axis=0))
    with pytest.raises(ValueError, match="spread combines worlds in its own way; give mean instead of worst"):
        judged("worst", "speed", "spread")
    with pytest.raises(ValueError, match=r"'sped' is unknown; did you mean speed\? all .* objectives: root, spread"):
        judged("sped", "cost")


@pytest.mark.parametrize(
    "objective, settings, why",
    [
        (["sped"], {}, "'sped' is unknown; did you mean speed\\? all measures: speed, cost, heat"),
        (["0*speed"], {}, "'0\\*speed' is not allowed; give NAME, WEIGHT\\*NAME, .* finite weight above 0$"),
        (["-1*speed"], {}, "what shall be low is minimise:NAME"),
        (["inf*speed"], {}, "finite weight"),
        (["nan*speed"], {}, "finite weight"),
        (["much*speed"], {}, "finite weight"),
        (["maximise:speed"], {}, "give NAME"),
        (["2*"], {}, "give NAME"),
        (["speed", 3], {}, "give names"),
        ([RobotObjective], {}, "one of your own gets its by an entry point"),
        (["speed", "minimise:0.5*speed"], {}, "speed is given twice"),
        (["mean", "worst", "speed"], {}, "mean and worst both say"),
        (["minimise:worst"], {}, "worst says how worlds are combined"),
        (["each", "speed", "cost"], {"summed": True}, "each needs a method for several objectives"),
    ],
)
def test_what_is_no_objective_is_refused_in_one_line(objective, settings, why):
    with pytest.raises(ValueError, match=rf"^objective: .*{why}") as caught:
        judged(*objective, **settings)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("objective", [("cost",), ("worst", "speed", "minimise:0.1*cost")])
def test_an_objective_of_a_package_takes_no_measure_of_the_robot(tmp_path, monkeypatch, objective):
    install(tmp_path, "cost-kit", "morpholab.objectives", {"cost": "cost_kit:Spread"})
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ValueError, match=r"^objective: 'cost' is both a measure of the robot and an objective of an "):
        judged(*objective)
    assert judged("speed")[1] == [("speed", "m/s")]


def test_a_measure_that_no_objective_is_about_is_refused():
    with pytest.raises(ValueError, match=r"^measure: 'cost' is not used"):
        judged("speed", measure="cost")


def test_worlds_may_be_given_by_name():
    robot = FreeformRobot(Grid((4, 2, 2)))
    for given in (["flat", "hill:5"], (Terrain(), "hill:5")):
        assert RobotProblem(robot, given).worlds == (Terrain(), Terrain(5.0))
    assert RobotProblem(robot, "hill:5").worlds == (Terrain(5.0),) and RobotProblem(robot).worlds == (Terrain(),)
    with pytest.raises(ValueError, match=r"^terrain: 'flatt' is unknown; give"):
        RobotProblem(robot, ["flatt"])


def test_descriptions_say_goals_and_old_ones_are_as_they_were():
    robot = FreeformRobot(Grid((4, 2, 2)))
    old = RobotProblem(robot, objective="worst", measure="energy")
    assert list(old.describe()) == ["kind", "robot", "worlds", "objective", "measure", "precision", "device"]
    assert old.describe()["objective"] == "worst"
    worlds = Terrain(), Terrain.parse("hill:10")
    new = RobotProblem(robot, worlds, ("0.50*speed", "minimise:energy", "worst"), summed=True)
    assert new.describe()["objective"] == ["worst", "0.5*speed", "minimise:energy"]
    for problem in (old, new):
        description = json.loads(json.dumps(problem.describe()))
        again = problem_of_description(description)
        assert again.describe() == description and objectives_of(again) == objectives_of(problem)
    told = dict(new.facts())["Objective"]
    assert told == (
        "0.5 × speed along its heading (BL/s) minus work of the muscles in the last cycle (J) in the worst world"
    )


@pytest.mark.kernels
def test_a_problem_that_is_read_again_judges_to_the_same_bits():
    """Also where a body was made from an array in another order: what a search goes on with is read from its folder."""
    worlds = (Terrain(light=(0.1, 0.04)),)
    made = RobotProblem(light_seeker(1), worlds, objective=("mean", "minimise:remaining"), threads=1)
    again = RobotProblem.from_description(json.loads(json.dumps(made.describe())))
    points = made.space.sample(np.random.default_rng(1), 8)
    assert np.array_equal(made.evaluate(points).objectives, again.evaluate(points).objectives)
    assert all(body.voxels.flags.c_contiguous for body in (made.robot.body, again.robot.body))


class TestLimits:
    def test_are_written_in_one_way(self):
        assert Limit.of("2.0*cost<=3").text == "2*cost <= 3" and Limit.of(" cost >= 0.10 ").text == "cost >= 0.1"
        exact = 0.1 + 0.2
        assert Limit.of(Limit.of(f"{exact!r}*cost >= {exact!r}").text) == Limit.of(f"{exact!r}*cost >= {exact!r}")
        assert named(["cost<=3", "speed", "worst", "cost <= 3"]) == ("worst", "speed", "cost <= 3")

    def test_cost_ten_for_all_that_is_missing_and_nothing_where_they_are_kept(self):
        problem, told = judged("speed", "cost <= 2", worlds=(Place("flat"),), summed=True)
        found = problem.evaluate(POINTS)
        push, gear = POINTS.T
        cost, speed = push**2 + gear, push * gear - push**2
        expected = speed - 10 * np.maximum(cost / 2 - 1, 0)
        np.testing.assert_allclose(found.objectives[:, 0], expected, rtol=1e-15)
        assert told == [("speed where cost <= 2", "m/s")] and (cost <= 2).tolist() == [False, False, True]
        floor, _ = judged("speed", "3*cost >= 2", worlds=(Place("flat"),), summed=True)
        expected = speed - 30 * np.maximum(1 - cost / 2, 0)
        np.testing.assert_allclose(floor.evaluate(POINTS).objectives[:, 0], expected, rtol=1e-15)

    def test_of_zero_count_in_units_of_the_measure(self):
        problem, _ = judged("speed", "speed >= 0", worlds=(Place("flat"),), summed=True)
        push, gear = POINTS.T
        speed = push * gear - push**2
        assert (speed < 0).any()
        found = problem.evaluate(POINTS).objectives[:, 0]
        np.testing.assert_allclose(found, speed + 10 * np.minimum(speed, 0), rtol=1e-15)

    def test_are_kept_in_every_world_by_the_mean_or_in_the_worst(self):
        costs = np.array([push**2 * np.array([1.0, 3.0]) + gear for push, gear in POINTS]).T  # (W, N)
        lost = 10 * np.maximum(costs / 2 - 1, 0)
        for word, over in (("mean", np.mean), ("worst", np.max)):
            plain, bound = (judged(word, "speed", *more, summed=True)[0] for more in ((), ("cost <= 2",)))
            gap = plain.evaluate(POINTS).objectives[:, 0] - bound.evaluate(POINTS).objectives[:, 0]
            np.testing.assert_allclose(gap, over(lost, axis=0), rtol=1e-12, atol=1e-12)

    def test_lower_every_column_of_a_front_alike(self):
        problem, told = judged("speed", "minimise:heat", "cost <= 2", worlds=(Place("flat"),))
        plain, _ = judged("speed", "minimise:heat", worlds=(Place("flat"),))
        gap = plain.evaluate(POINTS).objectives - problem.evaluate(POINTS).objectives
        push, gear = POINTS.T
        lost = 10 * np.maximum((push**2 + gear) / 2 - 1, 0)
        np.testing.assert_allclose(gap, np.stack([lost, lost], axis=1), rtol=1e-12, atol=1e-12)
        assert told == [("speed where cost <= 2", "m/s"), ("minus heat where cost <= 2", "J")]

    def test_what_is_broken_is_told_of_every_world_of_what_is_raised_and_of_draws(self):
        def broken(problem, point):
            found = problem.evaluate(np.atleast_2d(point))
            return problem.limits_broken({name: float(values[0]) for name, values in found.details.items()})

        problem, _ = judged("speed", "cost <= 2", summed=True)
        assert broken(problem, [0.5, 1.0]) == [] == broken(problem, [0.1, 1.9])
        assert broken(problem, [0.7, 1.0]) == ["cost <= 2: 2.47 on steep"]
        assert broken(judged("speed", "speed >= 100", worlds=(Place("flat"),))[0], [1.0, 2.0]) == ["speed >= 100: 1"]
        # The mean of two draws keeps what one of them breaks.
        single, _ = judged("speed", "cost <= 2", worlds=(Place("flat"),), summed=True)
        assert single.limits_broken({"speed": 1.0, "cost": 1.9, "lost_to_limits": 0.3}) == [
            "cost <= 2: not in all of 1 draws"
        ]

    @pytest.mark.parametrize("limit", ["cost <= 2", "cost >= 2", "2*speed >= 0", "speed <= 0"])
    def test_have_exact_gradients(self, limit):
        problem, _ = judged("speed", limit, worlds=(Place("flat"),), summed=True)
        found, step = problem.evaluate_relaxed(POINTS, np.inf, gradients=True), 1e-6
        for axis in range(2):
            aside = np.zeros(2)
            aside[axis] = step
            ends = [problem.evaluate(POINTS + way * aside).objectives[:, 0] for way in (1, -1)]
            np.testing.assert_allclose(found.gradients[:, axis], (ends[0] - ends[1]) / (2 * step), rtol=1e-7, atol=1e-7)

    def test_a_search_ends_where_the_limit_is_just_kept(self):
        problem, _ = judged("speed", "cost <= 1", worlds=(Place("flat"),), summed=True)
        best = maximise(problem, "cma", seed=0, generations=60, progress=False)
        push, gear = best.point
        # The most of push * gear - push^2 on push^2 + gear = 1: 1 - 3 push^2 - 2 push = 0, so push = 1 / 3.
        np.testing.assert_allclose([push, gear], [1 / 3, 8 / 9], atol=2e-3)

    def test_are_kept_by_descriptions(self):
        problem = RobotProblem(FreeformRobot(Grid((3, 2, 2))), objective=("speed", "0.3*mass <= 2"), summed=True)
        again = problem_of_description(json.loads(json.dumps(problem.describe())))
        assert again.objective == ("mean", "speed", "0.3*mass <= 2")
        assert again.objective_names == ("speed where mass <= 2",)

    @pytest.mark.parametrize(
        ("given", "reason"),
        [
            (("cost <= 2",), "'?cost <= 2'? is a limit; name what is raised or minimised within it, too"),
            (("speed", "cost <= x"), "'cost <= x' is not allowed; a limit is MEASURE >= NUMBER"),
            (("speed", "cost <= nan"), "'cost <= nan' is not allowed; a limit is"),
            (("speed", "-1*cost <= 1"), "'-1\\*cost <= 1' is not allowed; a limit is"),
            (("speed", "minimise:cost <= 1"), "'minimise:cost <= 1' is not allowed; a limit is"),
            (("speed", "costs <= 1"), "'costs' is unknown; did you mean cost"),
            (("speed", "nothing <= 1"), "'nothing' is unknown; choose one of the measures: speed, cost, heat$"),
        ],
    )
    def test_refuses(self, given, reason):
        with pytest.raises(ValueError, match=rf"^objective: {reason}"):
            RobotProblem(Cart(), objective=given)
