"""Feet with friction of their own rub otherwise on harder floors and where friction is drawn, as other feet do."""

import dataclasses

import numpy as np
import pytest
from graded import GRIPPING, QUICK, TINY

from optim.problems.inflatable.draws import Draws, UncertainDraws
from optim.problems.inflatable.problem import GaitProblem
from robots.inflatable import robustness
from robots.inflatable.actuation import InflatableActuation
from robots.inflatable.design import INCHING
from robots.inflatable.materials import RegionMaterials
from robots.inflatable.robot import InflatableRobot
from robots.inflatable.robustness import judge_gait
from robots.inflatable.rubbing import Rubbing
from robots.inflatable.variations import Conditions, with_friction
from robots.uncertainty import Perturbation, Risk, Uncertainty
from robots.world import Terrain

PUBLISHED = ((2.0, 2.0), (1e-4, 1e-4))  # what feet have without friction of their own


SHORT = dataclasses.replace(INCHING, schedule=INCHING.schedule.cut(2, 2))


def with_feet(friction, design=SHORT):
    return dataclasses.replace(design, materials=RegionMaterials(friction=friction))


def test_the_friction_of_feet_is_changed_within_what_is_allowed():
    design = with_feet(((1.0, 3.0), (0.1, 0.9)))
    assert np.allclose(Rubbing(1.5, 2.0).of(design).materials.friction, ((1.5, 4.0), (0.2, 1.8)))
    assert np.allclose(Rubbing(0.5, 2.0, least=0.4).of(design).materials.friction, ((0.5, 1.5), (0.5, 1.5)))
    assert Rubbing(0.5).of(SHORT) is SHORT and not Rubbing(0.5).slopes(SHORT).any()


@pytest.mark.parametrize("change", [Rubbing(1.5, 2.0), Rubbing(0.5, 2.0, 0.4), Rubbing(least=0.2), Rubbing(0.2, 1.0)])
def test_its_slopes_are_those_of_differences(change):
    rows, step = np.array(((1.0, 3.0), (0.1, 0.9))), 1e-6
    slopes = change.slopes(with_feet(rows))
    for row, foot in np.ndindex(2, 2):
        ends = []
        for sign in (1, -1):
            moved = rows.copy()
            moved[row, foot] += sign * step
            ends.append(np.array(change.of(with_feet(moved)).materials.friction))
        by = (ends[0] - ends[1]) / (2 * step)
        assert np.allclose(by[:, foot], slopes[:, row, foot], atol=1e-9) and not by[:, 1 - foot].any()


@pytest.mark.kernels
def test_harder_conditions_are_as_hard_for_feet_with_friction_of_their_own(monkeypatch):
    monkeypatch.setattr(robustness, "RECORD_EVERY", 20)
    options = {"geometry": TINY, "actuation": QUICK, "runs": 2, "seed": 1, "precision": "f64"}
    plain, own = judge_gait(SHORT, **options), judge_gait(with_feet(PUBLISHED), **options)
    assert np.array_equal(plain.speeds, own.speeds)
    assert np.array_equal(plain.hard_speeds, own.hard_speeds)  # sliding feet had 1e-4 there
    assert own.hard_friction == plain.hard_friction == 0.2


@pytest.mark.kernels
def test_drawn_friction_reaches_feet_with_friction_of_their_own():
    terrain, uncertainty = Terrain(high_friction=1.0, low_friction=0.3), Uncertainty.parse("sliding=90%")
    found = []
    for design in (SHORT, with_feet(((1.0, 1.0), (0.3, 0.3)))):
        robot = InflatableRobot(design, "small")
        draws = [robot.perturbed(drawn) for drawn in uncertainty.draw(2, actuators=8)]
        places = [each.drawn_terrain(terrain, each.drawn) for each in draws]
        found.append([each.simulate((), place).measures["speed"][0] for each, place in zip(draws, places, strict=True)])
    assert found[0] == found[1] and found[0][0] != found[0][1]


def test_searches_over_draws_and_harder_conditions_change_the_feet_of_designs():
    drawn = Perturbation(gripping=0.5, sliding=2.0)
    over = UncertainDraws(1, uncertainty=Uncertainty.parse("sliding=50%"), risk=Risk())
    object.__setattr__(over, "drawn", [drawn])
    design, drive = with_feet(((1.0, 1.0), (0.1, 0.4))), InflatableActuation(skin_friction=0.5)
    (copy,), (place,) = (copies := over.copies([design], Terrain(), drive)).designs, copies.terrains
    assert np.allclose(copy.materials.friction, ((0.5, 0.5), (0.2, 0.5)))
    assert np.allclose(copies.by_friction[0, 1], [[0.0, 0.5], [2.0, 0.0]])  # the second foot's is held at its grip
    assert place.skin_friction == 0.25 and place.high_friction == 1.0 and place.low_friction == 2e-4
    (spread, _, _) = Draws(3, spread=1.0).copies([design], Terrain(), drive, 0.2).designs
    assert np.allclose(spread.materials.friction, ((0.5, 0.5), (0.1, 0.2)))  # half of the least, and of its own
    conditions = GaitProblem((Terrain(),), hard=True).conditions
    assert [each.least_friction for each in conditions] == [0.0, 0.2]


def test_a_part_of_the_friction_is_that_of_all_parts():
    drive = InflatableActuation(bladder_friction=0.6, skin_friction=0.5, seam_friction=1.5)
    own = with_feet(((1.0, 1.0), (0.3, 0.5)))
    given = Conditions(own, Terrain(), GRIPPING, drive)
    part = with_friction(given, 0.8)
    there = drive.on(part.terrain)
    assert (there.bladder_friction, there.skin_friction, there.seam_friction) == pytest.approx((0.48, 0.4, 1.2))
    assert np.allclose(part.design.materials.friction, ((0.8, 0.8), (0.24, 0.4)))
    assert given.friction == pytest.approx((0.4, 1.0)) and part.friction == pytest.approx((0.32, 0.8))
