"""Freeform robots whose friction, muscles and period are not known exactly."""

from dataclasses import replace

import numpy as np
import pytest

from robots.freeform import FreeformActuation, FreeformRobot, Grid
from robots.freeform.trials import try_variants
from robots.lattice_robot.record import robot_of_record
from robots.robot import Trial
from robots.uncertainty import Perturbation, Uncertainty
from robots.world import Terrain
from taichi_sim.base.compute import Compute

HILL, WATER = Terrain(5.0), Terrain.water()


def robot(amplitude: float = 0.25, full: bool = True) -> FreeformRobot:
    muscles = FreeformActuation(amplitude=amplitude, cycles=1, settling=0.02)
    return FreeformRobot(Grid((3, 2, 2)), actuation=muscles, full=full)


def drawn(level: float, **more) -> Perturbation:
    return Perturbation(levels=(level,) * 12, **more)


def test_amplitudes_friction_and_period_are_multiplied():
    point = robot().start
    fixed, changed = (
        each.design(point) for each in (robot(), robot().perturbed(drawn(1.5, gripping=0.8, timing=1.25)))
    )
    assert changed.frequency == pytest.approx(fixed.frequency / 1.25)
    for name in ("static_friction", "kinetic_friction"):
        assert getattr(changed.body.materials[0], name) == 0.8 * getattr(fixed.body.materials[0], name)
    amplitudes = [[np.max(drive.amplitude) for drive in each.drives] for each in (fixed, changed)]
    assert np.array_equal(amplitudes[1], 1.5 * np.array(amplitudes[0]))


def strongest(made: FreeformRobot) -> np.ndarray:
    """The start of a robot, with all muscles as strong as they may be."""
    return np.array([p.high if "amplitude" in p.name else p.start for p in made.parameters])


def test_no_factor_moves_a_muscle_by_more_than_half_an_edge():
    strong = robot(0.45)
    changed = strong.perturbed(drawn(1.4))
    (drive,) = changed.design(strongest(strong)).drives
    assert drive.amplitude == (0.5,) * 12 and changed.largest_size == pytest.approx(1.5)
    design = strong.design(strongest(strong))
    for judged in (design, robot_of_record(design.describe())):  # as files have it, too
        (sizes,) = judged.perturbed(drawn(1.9)).nodes(np.zeros((1, 0)))
        assert 0.5 <= sizes.min() < 0.53 and 1.47 < sizes.max() <= 1.5
        assert judged.perturbed(drawn(1.9)).cycle.time_step == judged.cycle.time_step


@pytest.mark.kernels
@pytest.mark.parametrize("world", [HILL, WATER])
@pytest.mark.parametrize("level", [0.9, 1.4, 2.0])
def test_a_search_draws_what_a_judge_draws(level, world):
    """Of muscles that may go further than half an edge, too, whose factors are clipped, and in water."""
    strong, draw = robot(0.45), drawn(level)
    point = strongest(strong)[None]
    searched = strong.perturbed(draw).run(point, Trial(world))
    judged = strong.design(point[0]).perturbed(draw).simulate(np.zeros((1, 0)), world)
    assert searched.status[0] == "ok" and searched.measures["speed"][0] == judged.measures["speed"][0]


@pytest.mark.kernels
@pytest.mark.parametrize("sharpness", [np.inf, 20.0])
def test_muscles_that_are_drawn_far_gain_no_energy(sharpness):
    """Muscles far beyond half an edge gave 30 times the energy of a third of the time step."""
    muscles = FreeformActuation(amplitude=0.5, cycles=1, settling=0.02, frequency=8.0)
    made = FreeformRobot(Grid((4, 2, 2)), actuation=muscles)
    point = strongest(made)
    phases = [number for number, p in enumerate(made.parameters) if "phase" in p.name]
    point[phases] = np.linspace(0.75, 0.85, len(phases))
    slower = replace(made, actuation=replace(muscles, time_step_safety=3.9))
    draw, trial = Perturbation(levels=(1.6,) * 16), Trial(Terrain(), sharpness=sharpness)
    found, expected = (each.perturbed(draw).run(point[None], trial).measures["energy"] for each in (made, slower))
    assert found == pytest.approx(expected, rel=0.02)


@pytest.mark.kernels
@pytest.mark.parametrize("sharpness", [np.inf, 2.0])
def test_gradients_of_clipped_muscles_are_those_of_differences(sharpness):
    """By all variables, of muscles of which some are clipped: these have no derivative by their amplitude."""
    made = robot(0.4, full=sharpness == np.inf)
    kinds = [parameter.name.split("_")[0] for parameter in made.parameters]
    generator, point = np.random.default_rng(3), made.start.copy()
    for kind, ends in (("amplitude", (0.2, 0.4)), ("phase", (0.1, 0.9)), ("presence", (0.6, 0.9))):
        where = np.flatnonzero(np.array(kinds) == kind)
        point[where] = generator.uniform(*ends, len(where))
    levels = generator.uniform(1.2, 2.0, 12)
    changed = made.perturbed(Perturbation(levels=tuple(levels)))
    amplitudes = np.flatnonzero(np.array(kinds) == "amplitude")
    clipped = point[amplitudes] * levels > 0.5
    assert 3 <= clipped.sum() <= 9
    trial = Trial(WATER, Compute(threads=1), sharpness=sharpness)
    exact = changed.run(point[None], replace(trial, gradients=("energy", "distance")))
    slopes = {}
    for step in (1e-6, 1e-7, 1e-8):  # the wider ones may lie across a kink
        moved = step * np.eye(len(point))
        for name, found in changed.run(point + np.concatenate([moved, -moved]), trial).measures.items():
            slopes.setdefault(name, []).append((found[: len(point)] - found[len(point) :]) / (2 * step))
    for name, gradient in exact.gradients.items():
        every = np.array(slopes[name])
        assert np.abs(every - gradient).min(axis=0).max() < 1e-6 * np.abs(every).max()
        by_amplitude = np.abs(gradient[0, amplitudes]) > 1e-12 * np.abs(gradient).max()  # of rounding there is some
        assert np.array_equal(by_amplitude, ~clipped)


def test_all_draws_have_the_time_step_of_the_widest():
    made = robot(0.25)
    draws = Uncertainty.parse("levels=40%").draw(5, actuators=made.actuators)
    steps = {made.perturbed(draw).cycle_on(WATER).time_step for draw in draws}
    assert steps == {robot(0.35).cycle_on(WATER).time_step}
    assert {made.perturbed(draw).cycle for draw in draws} == {made.cycle}


@pytest.mark.kernels
@pytest.mark.parametrize(("terrain", "links"), [(WATER, "alike"), (Terrain(), "balanced")])
def test_draws_with_other_time_steps_share_no_batch(terrain, links):
    made = replace(robot(0.25), links=links)
    variants = [made.perturbed(drawn(level)) for level in (0.8, 1.8)]
    found = try_variants(variants, made.start[None], [terrain] * 2, Trial(terrain))
    assert found[0].time_step > found[1].time_step
    for variant, together in zip(variants, found, strict=True):
        alone = variant.run(made.start[None], Trial(terrain))
        assert np.array_equal(alone.measures["energy"], together.measures["energy"])


@pytest.mark.kernels
@pytest.mark.parametrize("channels", [1, 2])
def test_mixtures_draw_a_factor_for_each_channel(channels):
    """So an almost sharp mixture does what the robot does that can be built, in every draw."""
    muscles = FreeformActuation(amplitude=0.25, cycles=1, settling=0.02, frequency=8.0, channels=channels)
    made = FreeformRobot(Grid((4, 2, 2)), actuation=muscles)
    names, point = [parameter.name for parameter in made.parameters], strongest(made)
    front = made.grid.places[:, 0] > 1
    point[[name.startswith("phase") for name in names]] = np.where(front & (channels > 1), 0.1, 0.35)
    point[names.index("presence_1_1_2")] = 0.0  # so that channels are not numbered as if all cells were there
    draws = Uncertainty.parse("levels=40%").draw(4, actuators=made.actuators)
    variants = [made.perturbed(draw) for draw in draws]
    energies = [
        [
            found.measures["energy"][0]
            for found in made.run_in(
                point[None], [WATER] * 4, Trial(WATER, Compute(threads=1), sharpness=sharpness), variants
            )
        ]
        for sharpness in (np.inf, 30.0)
    ]
    assert energies[1] == pytest.approx(energies[0], rel=0.03)
    assert np.std(energies[0]) > 0.1 * np.mean(energies[0])


def test_what_is_drawn_is_no_part_of_a_description():
    assert robot().describe() == robot().perturbed(drawn(1.1)).describe()


@pytest.mark.kernels
@pytest.mark.parametrize("full", [True, False])
def test_levels_are_those_of_the_actuation_multiplied_by_hand(full):
    found, expected = (
        each.run(each.start[None], Trial(HILL, gradients=("speed",), sharpness=np.inf if full else 2.0))
        for each in (robot(full=full).perturbed(drawn(1.5)), robot(0.375, full))
    )
    assert found.status[0] == "ok"
    assert np.array_equal(found.measures["speed"], expected.measures["speed"])
    # Amplitudes are told in edges: the same change of one is a larger change of what muscles do.
    by_hand = [1.5 if "amplitude" in parameter.name else 1.0 for parameter in robot(full=full).parameters]
    assert found.gradients["speed"] == pytest.approx(expected.gradients["speed"] * by_hand, rel=1e-9)


@pytest.mark.kernels
@pytest.mark.parametrize("gradients", [(), ("speed",)])
@pytest.mark.parametrize("sharpness", [np.inf, 2.0])
def test_draws_in_several_worlds_share_a_batch_with_the_bits_of_one_after_the_other(sharpness, gradients):
    """Of two designs of other cells, and of mixtures; on a hill, and on ground with a friction of its own."""
    free, generator = robot(full=False), np.random.default_rng(2)
    ends = np.array([(each.low, each.high) for each in free.parameters]).T
    points = generator.uniform(*ends, (2, len(free.parameters)))
    draws = [drawn(0.8, gripping=0.7, slope=1.0), drawn(1.2), drawn(1.1, timing=0.8)]
    grounds = [HILL, Terrain(static_friction=0.6, kinetic_friction=0.4), HILL]
    worlds = [free.drawn_terrain(ground, draw) for draw, ground in zip(draws, grounds, strict=True)]
    trial = Trial(HILL, Compute(threads=1), gradients=gradients, sharpness=sharpness)
    variants = [free.perturbed(draw) for draw in draws]
    for draw, world, found in zip(draws, worlds, free.run_in(points, worlds, trial, variants), strict=True):
        alone = free.perturbed(draw).run(points, replace(trial, world=world))
        assert found.status.tolist() == alone.status.tolist() and "ok" in found.status
        for mine, other in ((found.measures, alone.measures), (found.gradients, alone.gradients)):
            assert mine.keys() == other.keys()
            assert all(np.array_equal(mine[name], other[name], equal_nan=True) for name in mine)
