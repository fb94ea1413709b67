"""Uncertain quantities, their draws, and measures of risk."""

import numpy as np
import pytest
from scipy import stats

from robots.inflatable.actuation import InflatableActuation
from robots.lattice_robot.presets import soft_quadruped
from robots.tail_interval import tail_interval
from robots.uncertainty import HELD_OUT, Perturbation, Risk, Uncertainty, interval_of, spoken, summary
from robots.world import Terrain

FEET = InflatableActuation(high_friction=0.7, low_friction=0.5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("mud=1", "uncertain: 'mud' is unknown; choose from friction, sliding, gripping, slope, levels, timing"),
        ("friction=-5%", "uncertain: friction=-5% is not allowed; give 0% to 100%"),
        ("sliding=120%", "uncertain: sliding=120% is not allowed; give 0% to 100%"),
        ("slope=-1", "uncertain: slope=-1 is not allowed; give 0 to 45 degrees"),
        ("slope=nan", "uncertain: slope=nan is not allowed; give 0 to 45 degrees"),
        ("slope=1,slope=2", "uncertain: slope is given twice; give it once"),
        ("levels=101%", "uncertain: levels=101% is not allowed; give 0% to 100%"),
        ("timing=60%", "uncertain: timing=60% is not allowed; give 0% to 50%"),
        ("friction=much", "uncertain: 'friction=much' is not allowed; give such as friction=20%"),
    ],
)
def test_bad_uncertainty_is_refused_in_one_line(text, message):
    with pytest.raises(ValueError) as error:
        Uncertainty.parse(text)
    assert str(error.value) == message


def test_a_slope_is_not_drawn_under_water_that_is_level():
    shore, robot = Terrain.parse("ramp:-10,0+water:-0.005"), soft_quadruped(1)
    with pytest.raises(ValueError, match=r"^uncertain: slope=2.0 is not allowed with water, which is level"):
        Uncertainty(slope=2.0).check(robot, shore)
    Uncertainty(friction=0.1).check(robot, shore)


def test_only_what_needs_ground_is_refused_in_a_fluid():
    water, robot = Terrain.water(), soft_quadruped(1)
    with pytest.raises(ValueError, match=r"in water, which has no ground; leave out friction, slope$"):
        Uncertainty(friction=0.1, slope=1.0, timing=0.05).check(robot, water)
    drive = Uncertainty(levels=0.05, timing=0.05)
    drive.check(robot, water)
    (one,) = drive.draw(1, actuators=robot.actuators)
    assert robot.drawn_terrain(water, one) == one.on(water, FEET) == water


@pytest.mark.parametrize("text", ["cvar:0", "cvar:1.5", "cvar:x", "median", "cvar"])
def test_bad_risk_is_refused(text):
    with pytest.raises(ValueError, match=r"risk: .* give mean, worst or cvar:SHARE with a share in \(0, 1\]"):
        Risk.parse(text)


def test_texts_come_back():
    found = Uncertainty.parse("friction=20%, slope=1")
    assert found == Uncertainty(friction=0.2, slope=1.0) == Uncertainty.parse(found.text)


def test_draws_are_common_within_bounds_and_disjoint_from_held_out_ones():
    unknown = Uncertainty(friction=0.2, slope=1.0)
    drawn, held_out = unknown.draw(64), unknown.draw(64, HELD_OUT)
    assert drawn == unknown.draw(64) and not set(drawn) & set(held_out)
    assert all(0.8 <= one.sliding == one.gripping <= 1.2 and abs(one.slope) <= 1 for one in drawn)
    apart = Uncertainty(sliding=0.2).draw(8)
    assert all(one.gripping == 1 and one.slope == 0 for one in apart) and len({one.sliding for one in apart}) == 8


def test_actuators_are_drawn_each_and_leave_the_ground_as_it_was():
    ground, both = Uncertainty(friction=0.2), Uncertainty(friction=0.2, levels=0.05, timing=0.1)
    drawn = both.draw(16, actuators=8)
    assert [(one.sliding, one.gripping) for one in drawn] == [(one.sliding, one.gripping) for one in ground.draw(16)]
    assert all(one.levels == () and one.timing == 1 for one in ground.draw(16, actuators=8))
    assert len({level for one in drawn for level in one.levels}) == 16 * 8
    assert all(0.95 <= level <= 1.05 for one in drawn for level in one.levels)
    assert all(0.9 <= one.timing <= 1.1 for one in drawn) and len({one.timing for one in drawn}) == 16
    assert Uncertainty.parse(both.text) == both


def test_a_terrain_takes_what_is_drawn():
    (one,) = Uncertainty(friction=0.2, slope=1.0).draw(1)
    found = one.on(Terrain(9.0), FEET)
    assert found == Terrain(9.0 + one.slope, 0.7 * one.gripping, 0.5 * one.sliding)
    parts = one.on(Terrain(bladder_friction=0.3, seam_friction=0.9), FEET)
    assert (parts.bladder_friction, parts.seam_friction) == (0.3 * one.gripping, 0.9 * one.gripping)
    assert parts.skin_friction is None


def test_friction_of_parts_goes_with_that_of_gripping_feet():
    drawn = Perturbation(sliding=0.5, gripping=1.2).on(Terrain(bladder_friction=0.5), InflatableActuation(2.0, 0.1))
    assert drawn == Terrain(0.0, 2.4, 0.05, bladder_friction=0.6)
    own = Perturbation(gripping=0.5).on(
        Terrain(seam_friction=0.8), InflatableActuation(skin_friction=0.6, seam_friction=0.2)
    )
    assert (own.skin_friction, own.seam_friction) == (0.3, 0.4)  # a robot's own parts are drawn, too


def test_risk_is_that_of_numpy():
    scores = np.random.default_rng(1).normal(size=(3, 20))
    assert Risk.parse("mean").of(scores) == pytest.approx(scores.mean(axis=1))
    assert Risk.parse("worst").of(scores) == pytest.approx(scores.min(axis=1))
    assert Risk.parse("cvar:0.2").of(scores) == pytest.approx(np.sort(scores)[:, :4].mean(axis=1))
    assert np.isnan(Risk.parse("cvar:0.2").of([1.0, np.nan, 3.0, 4.0]))


@pytest.mark.parametrize("text", ["mean", "cvar:0.3", "worst"])
def test_weights_are_the_derivatives(text):
    scores, risk = np.random.default_rng(2).normal(size=7), Risk.parse(text)
    moved = [(risk.of(scores + step) - risk.of(scores - step)) / 2e-6 for step in 1e-6 * np.eye(7)]
    assert risk.weights(scores) == pytest.approx(moved, abs=1e-6)


def test_summary():
    found = summary([1.0, 2.0, 3.0, 4.0, 5.0], 0.4)
    assert (found["mean"], found["cvar"], found["worst"]) == (3.0, 1.5, 1.0)
    assert found["mean_low"] < 3.0 < found["mean_high"]
    assert found["cvar_low"] <= 1.5 < found["cvar_high"] and found["worst_low"] == 1.0 <= found["worst_high"]


@pytest.mark.parametrize("draws", [2, 5, 400])
def test_intervals_of_the_mean_are_those_of_students_t(draws):
    scores = np.random.default_rng(4).normal(size=draws)
    expected = stats.t.interval(0.95, draws - 1, scores.mean(), stats.sem(scores))
    assert tail_interval(scores, 1.0) == pytest.approx(expected)
    found = summary(scores.tolist(), 0.2)
    assert (found["mean_low"], found["mean_high"]) == pytest.approx(expected)


def test_the_interval_of_a_short_tail_by_hand():
    """The worst 2.5 of five: 1, 2 and half of 3, mean 1.8; they lie 2, 1, 0, 0, 0 below 3, deviation sqrt(0.8)."""
    half = stats.t.isf(0.025, 1.5) * np.sqrt(0.8) / (0.5 * np.sqrt(5))
    assert tail_interval(np.array([5.0, 3.0, 1.0, 4.0, 2.0]), 0.5) == pytest.approx((1.8 - half, 1.8 + half))
    assert tail_interval(np.array([2.0, 2.0, 2.0, 2.0]), 0.5) == (2.0, 2.0)
    outlier = np.append(np.zeros(63), -1.0)  # in a third of resamples there is none: deviation 1 / (0.2 * 64) and 11.8
    half = stats.t.isf(0.025, 11.8) / 12.8
    assert tail_interval(outlier, 0.2) == pytest.approx((-1 / 12.8 - half, -1 / 12.8 + half))


TOO_FEW = ("disaster", 16)  # in a fifth of samples there is none at all
DISASTER = stats.norm.isf(1 / 9)  # beside disasters, a tenth of all, the worst fifth has a ninth of the other draws
DRAWN = {
    "normal": (lambda rng, size: rng.normal(size=size), -stats.norm.pdf(stats.norm.isf(0.2)) / 0.2),
    "uniform": (lambda rng, size: rng.uniform(-1, 1, size), -0.8),
    "exponential": (lambda rng, size: -rng.exponential(size=size), -1 - np.log(5)),
    "disaster": (
        lambda rng, size: np.where(rng.random(size) < 0.1, -3.0, 0.0) + rng.normal(0, 0.3, size),
        -(0.3 + 0.27 * stats.norm.pdf(DISASTER)) / 0.2,
    ),
}


@pytest.mark.parametrize(("name", "draws"), [(n, d) for n in DRAWN for d in (64, 16) if (n, d) != TOO_FEW])
def test_intervals_of_the_tail_hold_it_about_as_often_as_they_say(name, draws):
    """The CVaR in closed form; bootstrap percentiles held that of normal scores in 90 % of 64 draws and 71 % of 16."""
    make, true = DRAWN[name]
    samples = make(np.random.default_rng(0), (400, draws))
    ends = np.array([tail_interval(sample, 0.2) for sample in samples])
    held = np.mean((ends[:, 0] <= true) & (true <= ends[:, 1]))
    assert held > (0.93 if draws == 64 else 0.88)


def test_a_worst_draw_alone_has_no_interval():
    """Nor has the CVaR where it is the worst draw; its text says what stands beside it."""
    scores = np.random.default_rng(3).normal(size=5)
    judged = {"measure": "speed", "unit": "m/s", "draws": 5, "failed": 0, "risk": "mean", "share": 0.2}
    judged |= summary(scores.tolist(), 0.2)
    assert judged["worst"] == judged["cvar"] == judged["worst_low"] == scores.min()
    assert [interval_of(judged, name) is None for name in ("mean", "cvar", "worst")] == [False, True, True]
    text = spoken(judged)
    assert text.count("95 % interval") == 1 and text.count("of resampled draws") == 2


def test_texts_of_risk_come_back():
    assert [Risk.parse(text).text for text in ("mean", "cvar:0.25", "worst")] == ["mean", "cvar:0.25", "worst"]


def test_nothing_is_told_with_a_minus():
    judged = {
        "measure": "speed",
        "unit": "m/s",
        "draws": 2,
        "failed": 0,
        "risk": "mean",
        **summary([-1e-9, -2e-9], 0.2),
    }
    assert "-0.0000" not in spoken({**judged, "share": 0.2})


def test_the_text_of_a_risk_is_exact():
    assert Risk.parse(Risk(0.123456789).text) == Risk(0.123456789)
    assert [Risk(share).text for share in (0.0, 0.2, 1.0)] == ["worst", "cvar:0.2", "mean"]
