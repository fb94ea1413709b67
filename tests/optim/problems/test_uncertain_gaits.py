"""Inflatable gaits judged under uncertainty: common draws, risk, its gradient, descriptions and bad input."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from linear_robot import Linear

from optim.problems.inflatable.problem import GaitProblem
from robots.inflatable import INCHING
from robots.inflatable.perturbed import perturbed_design, perturbed_drive
from robots.inflatable.timing import counted_steps, gait_steps
from robots.uncertainty import Perturbation, Uncertainty
from robots.world import Terrain

HILL = Terrain(9.0, high_friction=0.7, low_friction=0.5)
UNKNOWN = "friction=20%,slope=1"


def problem(**settings):
    given = {"columns": 3, "encoding": "graded", "geometry": "small", "steps": 60_000, "draws": 5}
    return GaitProblem(**{"terrains": (HILL,), **given, "uncertain": UNKNOWN, **settings})


@pytest.fixture
def linear(monkeypatch):
    stand_in = Linear()
    monkeypatch.setattr("robots.inflatable.simulation.simulate", stand_in.simulate)
    monkeypatch.setattr("robots.inflatable.gradient.differentiate", stand_in.differentiate)
    return stand_in


def test_all_gaits_share_the_draws_in_one_batch(linear):
    made = problem()
    points = made.space.sample(np.random.default_rng(0), 3)
    together = made.evaluate(points)
    (call,) = linear.calls
    assert len(call.designs) == 15 and call.terrain[:5] == call.terrain[5:10] == call.terrain[10:]
    drawn = Uncertainty.parse(UNKNOWN).draw(5)
    assert call.terrain[:5] == [one.on(HILL, made.actuation) for one in drawn]
    assert np.array_equal(made.evaluate(points[1:]).objectives, together.objectives[1:])


@pytest.mark.parametrize("risk", ["cvar:0.5", "worst"])
def test_several_terrains_have_a_risk_each(linear, monkeypatch, risk):
    """The score is the mean of these; other robots have one risk, of the means over terrains."""

    def steep(designs, terrains, **options):
        found = linear.differentiate(designs, terrains, **options).result
        found.stages = found.stages - [[abs(each.slope)] for each in terrains]  # as bad uphill as downhill
        return found

    monkeypatch.setattr("robots.inflatable.simulation.simulate", steep)
    terrains = HILL, dataclasses.replace(HILL, slope=-9.0)
    points = problem().space.sample(np.random.default_rng(0), 3)
    both = problem(risk=risk, terrains=terrains).evaluate(points).objectives
    alone = [problem(risk=risk, terrains=(each,)).evaluate(points).objectives for each in terrains]
    usual = problem(risk="mean", terrains=terrains).evaluate(points).objectives
    assert both == pytest.approx(np.mean(alone, axis=0), rel=1e-12) and not np.allclose(*alone)
    assert (both < usual).all()


@pytest.mark.long
@pytest.mark.parametrize("unknown", [UNKNOWN, "levels=30%,timing=10%,slope=1"])
@pytest.mark.parametrize("risk", ["mean", "cvar:0.5", "worst"])
def test_risk_has_exact_gradients(linear, risk, unknown):
    made = problem(uncertain=unknown, risk=risk, warm_up=1000)  # counts the same steps on both sides of a difference
    points = made.space.relaxed().sample(np.random.default_rng(3), 2)
    exact = made.evaluate_relaxed(points, 2.0, gradients=True)
    assert exact.objectives == pytest.approx(made.evaluate_relaxed(points, 2.0, gradients=False).objectives)
    for number, reach in enumerate(1e-5 * made.space.span):
        if made.space.names[number].startswith("settle"):
            continue
        step = np.where(np.arange(made.space.size) == number, reach, 0.0)
        up, down = (made.evaluate_relaxed(points + s, 2.0, gradients=False) for s in (step, -step))
        slope = (up.objectives - down.objectives)[:, 0] / (2 * reach)
        assert exact.gradients[:, number] == pytest.approx(slope, rel=1e-5, abs=1e-9), made.space.names[number]


@pytest.mark.parametrize(
    ("risk", "simulated"), [("worst", [15, 3]), ("cvar:0.4", [15, 6]), ("cvar:0.3", [15, 6]), ("mean", [15])]
)
def test_slopes_are_taken_in_the_draws_that_weigh(linear, risk, simulated):
    made = problem(risk=risk, uncertain="levels=30%,timing=10%,slope=1")
    points = made.space.relaxed().sample(np.random.default_rng(0), 3)
    told = []
    dataclasses.replace(made, progress=told.append).evaluate_relaxed(points, 1.0, gradients=True)
    assert [len(call.designs) for call in linear.calls] == simulated
    assert told[-1] == 1.0 and told == sorted(told)


@pytest.mark.parametrize("at", ["simulate", "differentiate"])
def test_a_draw_that_fails_fails_its_gait_whether_it_weighs_or_not(linear, monkeypatch, at):
    def fail_one(self, designs, terrain, **options):
        found = Linear._run(self, designs, terrain, options)
        place = 1 if (len(designs) == 10) == (at == "simulate") else None
        if place is not None:
            found.result.status = np.where(np.arange(len(designs)) == place, "diverged", "ok")
            found.result.stages[place] = found.result.distance[place] = np.nan
        return found if len(designs) < 10 else found.result

    made = problem(risk="worst")
    for name, module in (("simulate", "simulation"), ("differentiate", "gradient")):
        monkeypatch.setattr(f"robots.inflatable.{module}.{name}", lambda *a, **k: fail_one(linear, *a, **k))
    judged = made.evaluate_relaxed(made.space.relaxed().sample(np.random.default_rng(0), 2), 1.0, gradients=True)
    assert judged.status.tolist() == (["diverged", "ok"] if at == "simulate" else ["ok", "diverged"])


@pytest.mark.parametrize("settings", [{}, {"encoding": "codes", "steps": None}, {"encoding": "bits", "steps": None}])
def test_levels_and_timing_of_all_gaits_are_drawn(linear, monkeypatch, settings):
    monkeypatch.setattr(GaitProblem, "speeds", lambda self, result: result.distance)
    made = problem(uncertain="levels=5%,timing=5%", **settings)
    points = made.space.sample(np.random.default_rng(0), 2)
    made.evaluate(points)
    (call,) = linear.calls
    drawn = Uncertainty.parse("levels=5%,timing=5%").draw(5, actuators=8)
    assert call.designs == [perturbed_design(made.design(point), one) for point in points for one in drawn]
    assert call.actuation == [perturbed_drive(made.actuation, one) for _ in points for one in drawn]


@pytest.mark.parametrize("timing", [0.6, 1.0, 1.4])
def test_slopes_count_the_time_by_which_speeds_of_drawn_timing_are_counted(timing):
    """A slope is of the distance over a time, which has to be that of the speed."""
    made = problem(steps=None, uncertain="timing=40%")
    drawn, design = Perturbation(timing=timing), made.design(made.space.sample(np.random.default_rng(0), 1)[0])
    schedule, drive = perturbed_design(design, drawn).schedule, perturbed_drive(made.actuation, drawn)
    result = SimpleNamespace(steps=np.array([gait_steps(schedule, drive)]), status=np.array(["ok"]))
    assert made._counted(result, [drive])[0] == counted_steps(schedule, drive)


@pytest.mark.parametrize("pace", [None, 0.1])
def test_slopes_of_a_given_gait_count_the_time_that_slow_strokes_take(pace):
    columns = INCHING.schedule.columns
    schedule = dataclasses.replace(INCHING.schedule, pace=None if pace is None else np.full((8, columns), pace))
    given = {"schedule": schedule, "columns": columns, "repeats": schedule.repeats}
    made = GaitProblem((Terrain(),), geometry="small", **given)
    result = SimpleNamespace(steps=np.array([gait_steps(schedule, made.actuation)]), status=np.array(["ok"]))
    assert made._counted(result)[0] == counted_steps(schedule, made.actuation)


def test_the_worst_counts_no_more_than_cvar_and_the_mean(linear):
    points = problem().space.sample(np.random.default_rng(1), 4)
    worst, tail, mean = (problem(risk=r).evaluate(points).objectives for r in ("worst", "cvar:0.5", "mean"))
    assert (worst <= tail).all() and (tail <= mean).all() and (worst < mean).any()


def test_descriptions_come_back_and_are_as_ever_without():
    made = problem(risk="cvar:0.2")
    assert GaitProblem.from_description(made.describe()).describe() == made.describe()
    assert ("Uncertain", "friction=0.2,slope=1.0: cvar:0.2 of 5 draws") in made.facts()
    plain = dataclasses.replace(made, uncertain="", risk="mean", draws=1)
    assert not {"uncertain", "risk", "draws"} & set(plain.describe())


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"uncertain": "", "risk": "worst"}, "risk: worst is not allowed without uncertain"),
        ({"uncertain": "mud=1"}, "uncertain: 'mud' is unknown"),
        ({"risk": "cvar:2"}, "risk: 'cvar:2' is not allowed"),
        ({"draws": 1}, "uncertain: friction=0.2,slope=1.0 is not allowed with a single draw; give draws"),
        ({"friction_spread": 0.2}, "friction_spread: 0.2 is not allowed beside uncertain"),
    ],
)
def test_what_contradicts_itself_is_refused(settings, message):
    with pytest.raises(ValueError) as error:
        problem(**settings)
    assert str(error.value).startswith(message) and "\n" not in str(error.value)
