"""Parts of gaits that count: after a warm-up, stage by stage; slip of feet; whether a gait walks."""

import dataclasses

import numpy as np
import pytest
from graded import QUICK, TINY, retabled, settling

from optim.problems.inflatable.problem import GaitProblem
from robots.inflatable import INCHING, Frames, InflatableResult
from robots.inflatable import robustness as judgement
from robots.inflatable.body import FOOT_1, FOOT_2
from robots.inflatable.design import InflatableDesign
from robots.inflatable.gradient import differentiate
from robots.inflatable.robustness import GaitJudgement, harder, judge_gait
from robots.inflatable.simulation import reordered, simulate
from robots.inflatable.slip import slip_under_load
from robots.inflatable.timing import Counting, GaitTimeline, counted_steps, cycle_starts, gait_steps, stage_starts
from robots.world import Terrain

ROBOT = {"geometry": TINY, "actuation": QUICK, "precision": "f64"}


def gait(seed: int = 0, repeats: int = 2) -> InflatableDesign:
    levels = np.random.default_rng(seed).uniform(0.1, 0.9, (10, 2))
    return InflatableDesign(2e3, 40.0, settling(levels, [60, 40], repeats, [90, 90]))


@pytest.mark.kernels
def test_stages_add_up_to_the_distance_and_what_warms_up_does_not_count():
    whole = simulate([gait(), gait(1)], **ROBOT)
    staged = simulate([gait(), gait(1)], counting=Counting(stages=4), **ROBOT)
    assert staged.stages.shape == (2, 4) and whole.stages.shape == (2, 1)
    np.testing.assert_allclose(staged.stages.sum(axis=1), whole.distance, atol=1e-15)
    np.testing.assert_array_equal(staged.distance, whole.distance)
    warm = int(gait_steps(gait().schedule, QUICK)) // 2
    later = simulate([gait(), gait(1)], counting=Counting(warm), **ROBOT)
    np.testing.assert_allclose(later.distance, staged.stages[:, 2:].sum(axis=1), atol=1e-15)
    assert later.steps.tolist() == [warm, warm]


def test_what_counts_after_a_warm_up_is_whole_cycles():
    """A cycle begins at every hundredth step, but for the first, which is shorter."""
    cycles = [0, *range(60, 660, 100)]
    assert stage_starts(cycles, 660, 0, 2) == [0, 330]
    assert stage_starts(cycles, 660, 1, 1) == [60]
    assert stage_starts(cycles, 660, 61, 1) == [160]
    assert stage_starts(cycles, 660, 61, 2) == [260, 460]  # of five cycles two each
    assert stage_starts(cycles, 660, 300, 5) == [360, 420, 480, 540, 600]  # three cycles are too few
    assert stage_starts([0], 660, 60, 2) == [60, 360]


@pytest.mark.kernels
def test_the_steps_of_a_result_are_those_of_the_cycles_that_count():
    levels = np.zeros((10, 2))
    levels[:4, 1], levels[8:] = 0.6, 1.0
    design = InflatableDesign(0.0, 90.0, settling(levels, [300, 300], 4))
    warm = cycle_starts(design.schedule, QUICK)[1] + 1
    found = simulate(design, counting=Counting(warm), **ROBOT)
    assert found.steps[0] == gait_steps(design.schedule, QUICK) - cycle_starts(design.schedule, QUICK)[2]


@pytest.mark.kernels
@pytest.mark.parametrize(
    "design", [gait(repeats=4), dataclasses.replace(INCHING, schedule=INCHING.schedule.cut(2, 4))], ids=["own", "none"]
)
def test_what_counts_after_a_warm_up_is_counted_by_its_share_of_the_time(design):
    """Of gaits with times of their own and without: half of a gait is not half as fast."""
    warm = cycle_starts(design.schedule, QUICK)[2]
    whole, later = (simulate(design, counting=Counting(each), **ROBOT) for each in (0, warm))
    share = (whole.steps[0] - warm) / whole.steps[0]
    seconds = counted_steps(design.schedule, QUICK) * TINY.time_step
    assert 0.4 < share < 0.6
    assert whole.speed[0] == whole.distance[0] / TINY.body_length / seconds
    assert later.speed[0] == pytest.approx(later.distance[0] / TINY.body_length / (share * seconds), rel=1e-12)


@pytest.mark.kernels
def test_frames_are_the_same_with_stages():
    plain = simulate(gait(), record_every=50, **ROBOT).frames
    staged = simulate(gait(), record_every=50, counting=Counting(stages=3), **ROBOT).frames
    np.testing.assert_array_equal(plain.positions, staged.positions)
    np.testing.assert_array_equal(plain.times, staged.times)


@pytest.mark.kernels
def test_the_gradient_is_that_of_the_worst_stage_times_their_number():
    design, count, h = gait(2), 3, 1e-6
    found = differentiate(design, counting=Counting(50, count), **ROBOT)
    sides = []
    for step in (h, -h):
        levels = design.schedule.inflation.copy()
        levels[2, 1] += step
        moved = dataclasses.replace(design, schedule=retabled(design.schedule, inflation=levels))
        sides.append(simulate(moved, counting=Counting(50, count), **ROBOT).stages.min() * count)
    assert found.inflation[0, 2, 1] == pytest.approx((sides[0] - sides[1]) / (2 * h), rel=1e-4)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"warm_up": -1}, r"^warm_up: -1 is not allowed; "),
        ({"warm_up": 10**6}, r"^warm_up: 1000000 is not allowed; a gait takes \d+ steps$"),
        ({"stages": 0}, r"^stages: 0 is not allowed; "),
    ],
)
def test_bad_parts_are_refused_in_one_line(options, message):
    with pytest.raises(ValueError, match=message):
        simulate(gait(), counting=Counting(**options), **ROBOT)


def slid(way: np.ndarray, depth: float, feet: tuple[int, ...]) -> InflatableResult:
    """Frames in which the voxels of some feet, so deep in the floor, move along x."""
    body = TINY.body
    places = np.repeat(body.start_positions[None, None].astype(float), len(way), axis=0)
    places[..., 2] = 1.0  # in the air
    mine = np.isin(body.regions, [(FOOT_1, FOOT_2)[foot] for foot in feet])
    places[:, 0, mine, 2] = -depth
    places[:, 0, mine, 0] += np.asarray(way)[:, None]
    sizes = np.full((*places.shape[:3], 3), TINY.voxel_size)
    frames = Frames(places, np.zeros((*places.shape[:3], 4)), 0.1 * np.arange(len(way)), np.zeros(1), sizes)
    one = np.ones(1)
    return InflatableResult(
        one, one, one, np.array(["ok"]), one[:, None], np.array([9]), 1e-3, frames, body, np.zeros((1, 2))
    )


def on_ground(result: InflatableResult, ground: str, height: float, degrees: float) -> InflatableResult:
    """The frames on a plane over the floor that rises along x: as deep in it, and moving as far along it."""
    nz, rise, places = np.cos(np.deg2rad(degrees)), np.tan(np.deg2rad(degrees)), result.frames.positions.copy()
    starts = places[:1, ..., 0]
    places[..., 0] = starts + 0.003 + nz * (places[..., 0] - starts)  # between nodes of the ground
    places[..., 2] = height + rise * places[..., 0] + places[..., 2] / nz + 0.5 * TINY.voxel_size * (1 / nz - 1)
    frames = dataclasses.replace(result.frames, positions=places)
    return dataclasses.replace(result, frames=frames, terrains=np.array([Terrain(ground=ground)], dtype=object))


@pytest.fixture
def tell(monkeypatch):
    """Tells both feet how much to grip for 500 steps, the last of which they settle."""

    def told(*feet, settles=300):
        levels = np.append(np.ones(8), feet)[:, None]
        played = GaitTimeline(np.array([0, 500]), np.array([settles]), levels, np.zeros(2))
        monkeypatch.setattr("robots.inflatable.slip.gait_timeline", lambda *_: played)

    return told


@pytest.mark.parametrize(("told", "expected"), [(1.0, 0.05), (0.0, 0.02), (0.5, 0.035)])
def test_slip_counts_as_far_as_a_foot_grips(tell, told, expected):
    """The foot slides by 10 mm in each of five steps; it is told something in the first three, and settles then."""
    tell(told, told)
    slip = slip_under_load(slid(0.01 * np.arange(6), 1e-4, (0,)), INCHING)
    assert slip == pytest.approx([expected, 0.0])


@pytest.mark.parametrize(("ground", "height", "degrees"), [("raised.npy:0.1", 0.05, 0.0), ("ramp:20,-2", 0.0, 20.0)])
def test_feet_slip_along_the_ground_they_are_on(tell, tmp_path, monkeypatch, ground, height, degrees):
    """A raised plane, and a slope, which they slip along as far as along the floor."""
    monkeypatch.chdir(tmp_path)
    np.save("raised.npy", np.full((5, 5), 0.05))
    tell(1, 1)
    design, told = dataclasses.replace(INCHING, orientation=0.0), slid(0.01 * np.arange(6), 1e-3, (0,))
    raised = on_ground(told, ground, height + 2 * np.tan(np.deg2rad(degrees)), degrees)  # ramps begin 2 m behind
    assert slip_under_load(raised, design) == pytest.approx([0.05, 0.0])


@pytest.mark.kernels
def test_results_of_a_batch_keep_the_ground_of_each_robot():
    """However they are put in order: the longest gait is first here, and runs last."""
    grounds = [Terrain(), Terrain(5.0), Terrain(ground="rough:0.01")]
    found = simulate([gait(repeats=3 - n) for n in range(3)], grounds, **ROBOT)
    assert [each.name for each in found.terrains] == [each.name for each in grounds]
    assert [each.name for each in reordered(found, np.array([2, 0])).terrains] == ["rough:0.01", "flat"]


def test_a_foot_in_the_air_does_not_slip(tell):
    tell(1, 1)
    assert slip_under_load(slid(0.01 * np.arange(6), -1e-4, (0, 1)), INCHING).tolist() == [0.0, 0.0]


def test_each_foot_grips_as_far_as_it_is_told(tell):
    tell(0.25, 0.75, settles=500)
    assert slip_under_load(slid(0.01 * np.arange(6), 1e-4, (0, 1)), INCHING) == pytest.approx([0.0125, 0.0375])


def test_slip_is_that_of_the_load(tell):
    """Half of the foot's voxels bear three times as much and stay; a quarter of the load slides."""
    tell(1, 1)
    result = slid(0.01 * np.arange(6), 1e-4, (1,))
    mine = np.flatnonzero(TINY.body.regions == FOOT_2)
    heavy = mine[: len(mine) // 2]
    result.frames.positions[:, 0, heavy] = result.frames.positions[:1, 0, heavy]
    result.frames.positions[:, 0, heavy, 2] = -3e-4
    light = len(mine) - len(heavy)
    expected = 0.05 * light / (light + 3 * len(heavy))
    assert slip_under_load(result, INCHING) == pytest.approx([0.0, expected])


def test_slip_needs_frames():
    result = dataclasses.replace(slid(np.zeros(3), 1e-4, (0,)), frames=None)
    with pytest.raises(ValueError, match=r"^frames: nothing was recorded; simulate with record_every$"):
        slip_under_load(result, INCHING)


def judged(**changes) -> GaitJudgement:
    usual = {
        "speeds": np.full(8, 0.03),
        "hard_speeds": np.zeros(8),
        "slip": np.tile([0.05, 0.01], (8, 1)),
        "distances": np.full(8, 0.1),
        "steps": 180_000,
    }
    return GaitJudgement(**usual | changes)


def test_a_gait_that_slides_for_its_living_is_not_physical():
    assert judged().physical and judged().slip_ratio == pytest.approx(0.3)
    for changes, fault in (
        ({"slip": np.full((8, 2), 0.1)}, "feet slip 1.00 of the way while they grip, more than 0.75"),
        ({"hard_speeds": np.full(8, -0.02)}, "-0.0200 BL/s remain with friction 0.2 of sliding feet"),
        ({"steps": 186_720}, "takes 186,720 steps, more than 186,719"),
        ({"level": True}, "0.0000 BL/s remain with friction 0.2 of sliding feet"),
    ):
        (found,) = judged(**changes).faults
        assert found.startswith(fault)
    assert judged(level=True).faults[0].endswith("less than 0.0075")
    assert judged(level=True, hard_speeds=np.full(8, 0.0076)).physical
    still = judged(distances=np.zeros(8))
    assert not still.physical and still.to_document()["slip_ratio"] is None
    one = judged(distances=np.array([0.0] + [0.1] * 7))
    assert one.slip_ratio == pytest.approx(8 * 0.03 / 0.7) and one.to_document()["slip_deviation"] is None


@pytest.mark.parametrize(
    "lost",
    [
        {"speeds": np.array([np.nan] + [0.03] * 7), "distances": np.array([np.nan] + [0.1] * 7)},
        {"hard_speeds": np.array([np.nan] * 8)},
    ],
)
def test_a_gait_that_diverged_is_that_and_nothing_else(lost):
    found = judged(**lost)
    assert found.diverged and found.faults == ("a run diverged",)
    document = found.to_document()
    assert None in (document["speed"], document["hard_speed"])
    assert not np.isnan([value for value in document.values() if isinstance(value, float)]).any()


def test_harder_conditions_are_never_easier():
    assert harder(Terrain(15.0))[0].low_friction == 0.2
    assert harder(Terrain(15.0, low_friction=0.8))[0].low_friction == 0.8


@pytest.mark.parametrize("runs", [0, 1, 2.5])
def test_a_judgement_takes_several_runs(runs):
    with pytest.raises(ValueError, match=rf"^runs: {runs} is not allowed; give a whole number, at least 2$"):
        judge_gait(INCHING, runs=runs)


@pytest.mark.kernels
def test_a_judgement_simulates_under_both_conditions(monkeypatch):
    """Of a small robot: noisy runs with and without weight, the latter watched."""
    monkeypatch.setattr(judgement, "RECORD_EVERY", 5)
    short = INCHING.schedule.cut(2, 2)
    design = dataclasses.replace(INCHING, schedule=short)
    quick = {"inflation_rate": 0.03, "pressure_ramp": 50.0, "hold_steps": 200, "settle_steps": 100}
    actuation, parts = dataclasses.replace(QUICK, **quick), []
    found = judge_gait(
        design, Terrain(5.0), geometry=TINY, actuation=actuation, runs=2, precision="f32", progress=parts.append
    )
    assert found.steps == gait_steps(design.schedule, actuation) < 3000
    assert found.speeds.shape == found.hard_speeds.shape == (2,) and found.slip.shape == (2, 2)
    assert (found.slip > 0).any() and np.isfinite(found.slip_ratios).all()
    assert not np.array_equal(found.speeds, found.hard_speeds)
    assert parts == sorted(parts) and parts[-1] == pytest.approx(1.0)


def test_there_are_no_harder_conditions_in_water_and_that_is_said_before_any_simulation(monkeypatch):
    monkeypatch.setattr("robots.inflatable.simulation.simulate", None)
    for refused in (
        lambda: judge_gait(INCHING, Terrain.water(), geometry=TINY, runs=2),
        lambda: GaitProblem((Terrain.water(),), encoding="graded", columns=2, hard=True),
    ):
        with pytest.raises(ValueError, match=r"^terrain: water is not allowed with harder conditions, which are"):
            refused()


@pytest.mark.kernels
@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_a_batch_of_gaits_of_any_lengths_is_each_of_them_alone(precision):
    """Robots of like length are simulated side by side; noise and frames are still each one's own."""
    gaits_ = [
        InflatableDesign(pressure, 60.0, settling(np.full((10, 2), 0.5), [settle, 20]))
        for pressure, settle in ((2000.0, 10), (0.0, 300), (1000.0, 150))
    ]
    options = {"geometry": TINY, "actuation": QUICK, "precision": precision, "threads": 1}
    together = simulate(gaits_, Terrain(5.0), **options, record_every=100)
    for place, design in enumerate(gaits_):
        alone = simulate(design, Terrain(5.0), **options, record_every=100)
        assert alone.distance[0] == together.distance[place] and alone.steps[0] == together.steps[place]
        count = int(np.isfinite(together.frames.positions[:, place, 0, 0]).sum())
        np.testing.assert_array_equal(alone.frames.positions[:count, 0], together.frames.positions[:count, place])
    noisy = simulate(gaits_, Terrain(5.0), **options, perturbation=1e-6)
    first = simulate(gaits_[:1], Terrain(5.0), **options, perturbation=1e-6)
    assert noisy.distance[0] == first.distance[0] != together.distance[0]
