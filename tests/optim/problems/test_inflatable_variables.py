"""The inflatable robot with a hundred variables: spaces, descriptions, slopes by every gene, and relaxed judgements."""

import dataclasses
import json

import numpy as np
import pytest
from linear_robot import Linear

from optim.problems.inflatable.draws import Draws, eased
from optim.problems.inflatable.problem import GaitProblem
from optim.problems.inflatable.settings import GAIT_PARTS, MATERIAL_PARTS, MORE_PARTS
from robots.inflatable import INCHING, InflatableActuation, load_design
from robots.inflatable.materials import RegionMaterials
from robots.world import Terrain

HUNDRED = (*GAIT_PARTS, *MATERIAL_PARTS)
FLAT, HILL = Terrain(), Terrain(15.0)


def problem(*terrains, **settings):
    given = {"columns": 3, "encoding": "graded", "geometry": "small", "more": HUNDRED, "steps": 60_000}
    return GaitProblem(terrains or (FLAT,), **{**given, **settings})


@pytest.fixture
def linear(monkeypatch):
    stand_in = Linear()
    monkeypatch.setattr("robots.inflatable.simulation.simulate", stand_in.simulate)
    monkeypatch.setattr("robots.inflatable.gradient.differentiate", stand_in.differentiate)
    return stand_in


def test_a_hundred_variables_have_names():
    names = problem().space.names
    assert len(names) == 105 and names[:4] == ("orientation", "pressure", "grip_1", "grip_2")
    for name in (
        "slide_2",
        "modulus_skin",
        "modulus_bladder8",
        "width_footseam",
        "length_bladder1",
        "core1_3",
        "pace8_1",
    ):
        assert name in names
    assert problem(geometry="two-core").space.size == 105 + 1 + 3 * 5 + 3
    assert problem(more=("friction",), encoding="codes", steps=None).space.size == 26


@pytest.mark.parametrize(
    "settings", [{}, {"more": ()}, {"more": MORE_PARTS}, {"more": ("size", "friction")}, {"window": 1, "draws": 2}]
)
def test_descriptions_come_back(settings):
    made = problem(**settings)
    described = json.loads(json.dumps(made.describe()))
    again = GaitProblem.from_description(described)
    assert again.describe() == described and again.space == made.space and again.free == made.free
    assert set(described["free"]) - {"orientation", "shape", "control"} == set(made.more)
    assert not {"window", "draws", "noise", "friction_spread", "gentle"} & set(problem().describe())


@pytest.mark.parametrize("geometry", ["small", "two-core"])
def test_points_are_designs_and_designs_are_starts(geometry, tmp_path):
    made = problem(geometry=geometry)
    for point in made.space.sample(np.random.default_rng(0), 5):
        design = made.design(point)
        again = made.design(made.space.from_dict(made.start_values(design)))
        assert again.schedule == design.schedule and again.orientation == design.orientation
        assert np.allclose([*again.materials.given["size"]], design.materials.given["size"], atol=0)
        assert again.materials == design.materials
        made.save(point, tmp_path / "best.json")
        assert load_design(tmp_path / "best.json") == design
    plain = dataclasses.replace(problem(columns=1), more=()).design(problem(columns=1, more=()).space.low)
    start = problem(columns=1).start_values(plain)
    assert start["modulus_seam"] == start["width_skin"] == start["pace1_1"] == 1.0 and start["grip_1"] == 2.0
    with pytest.raises(ValueError, match=r"^start: friction of the regions is not free; free it"):
        problem(more=()).start_values(dataclasses.replace(INCHING, materials=RegionMaterials(((1.0, 1.0), (0.1, 0.1)))))


FREED = (
    {},
    {"geometry": "two-core"},
    {"more": ("pace", "bladders")},
    {"more": ("core", "size")},
    {"more": (), "most_full": 2.5},
    {"more": (), "encoding": "graded-wave"},
    {"more": ("size", "bladders"), "encoding": "graded-wave", "columns": 5, "most_full": 2.5},
)
DRAWN = (
    {},
    {"draws": 3, "friction_spread": 0.5, "noise": 1e-6},
    {"draws": 3, "uncertain": "sliding=80%,gripping=40%,timing=20%"},
    {"hard": True},
)
EACH_ONCE = {(n, n % len(DRAWN)) for n in range(len(FREED))} | {(2, m) for m in range(len(DRAWN))}


@pytest.mark.long
@pytest.mark.parametrize(
    ("settings", "draws"),
    [
        pytest.param(FREED[n], DRAWN[m], marks=() if (n, m) in EACH_ONCE else pytest.mark.slow, id=f"{n}-{m}")
        for n in range(len(FREED))
        for m in range(len(DRAWN))
    ],
)
def test_slopes_by_every_gene_are_those_of_the_speed(linear, settings, draws):
    made = problem(FLAT, HILL, **settings, **draws, warm_up=1000)
    space = made.space.relaxed()
    points = space.sample(np.random.default_rng(3), 2)
    exact = made.evaluate_relaxed(points, 2.0, gradients=True)
    assert exact.objectives == pytest.approx(made.evaluate_relaxed(points, 2.0, gradients=False).objectives)
    flat = np.array([name.startswith(("settle", "has_bladder", "shift")) for name in space.names])
    assert not exact.gradients[:, flat].any()
    for point, gradient in zip(points, exact.gradients, strict=True):
        reach = 1e-5 * space.span[~flat]
        steps = np.diag(1e-5 * space.span)[~flat]
        moved = made.evaluate_relaxed(np.concatenate([point + steps, point - steps]), 2.0, gradients=False)
        up, down = moved.objectives[:, 0].reshape(2, -1)
        assert gradient[~flat] == pytest.approx((up - down) / (2 * reach), rel=1e-5, abs=1e-9)


def test_relaxed_gaits_are_means_of_draws_and_true_ones_are_not(linear):
    made = problem(HILL, draws=3, friction_spread=0.5, noise=1e-6, window=2, more=(), warm_up=1000)
    points = made.space.sample(np.random.default_rng(0), 4)
    relaxed, true = made.evaluate_relaxed(points, 0.0, gradients=True), made.evaluate(points)
    drawn, plain = linear.calls
    assert len(drawn.designs) == 12 and drawn.seed == (0, 1, 2) * 4 and drawn.counting.window == 2
    assert [t.high_friction for t in drawn.terrain[:3]] == pytest.approx([2 / 1.5, 2.0, 3.0])
    assert len(plain.designs) == 4 and plain.terrain == HILL and "seed" not in vars(plain)
    assert np.array_equal(made.evaluate_relaxed(points[2:], 0.0, gradients=True).objectives, relaxed.objectives[2:])
    steps = made.robot_steps(points, true)
    assert np.array_equal(made.robot_steps(points, relaxed, relaxed=True) > 2 * steps, np.full(4, True))


def test_friction_of_parts_is_spread_with_that_of_feet():
    drive = InflatableActuation(skin_friction=1.0)
    grounds = Draws(3, 0.0, 0.5).copies([INCHING], Terrain(seam_friction=0.6), drive).terrains
    assert [t.seam_friction for t in grounds] == pytest.approx([0.4, 0.6, 0.9])
    assert [t.skin_friction for t in grounds] == pytest.approx([1 / 1.5, 1.0, 1.5])
    assert [t.bladder_friction for t in grounds] == [None] * 3


def test_one_copy_that_fails_fails_its_gait():
    status = Draws(2).first_failure(np.array(["ok", "ok", "ok", "diverged", "torn", "diverged"]))
    assert status.tolist() == ["ok", "diverged", "torn"]


def test_gentle_slopes_rise_with_the_sharpness(linear):
    assert eased(HILL, 2.0, 8.0).slope == 15 / 4 and eased(HILL, 8.0, 8.0) == eased(HILL, 0.0, 8.0) == HILL
    assert eased(FLAT, 1.0, 8.0) == FLAT
    made = problem(HILL, gentle=8.0, more=())
    made.evaluate_relaxed(made.space.low, 4.0, gradients=True)
    made.evaluate(made.space.low)
    assert [call.terrain.slope for call in linear.calls] == [7.5, 15.0]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"more": ("pace",), "encoding": "bits", "steps": None}, "free: pace is not allowed with encoding 'bits'"),
        (
            {"more": ("core",), "schedule": INCHING.schedule, "steps": None},
            "free: core is not allowed with a fixed gait",
        ),
        ({"terrains": (Terrain(high_friction=1.0),)}, "free: friction is not allowed on flat, which has its own"),
        ({"more": ("colour",)}, "free: 'colour' is unknown; choose one of core, pace, friction, modulus, size"),
        ({"noise": 1e-6}, "noise: 1e-06 is not allowed with a single draw; give draws"),
        ({"friction_spread": 0.2}, "friction_spread: 0.2 is not allowed with a single draw"),
        ({"window": -1}, "window: -1 is not allowed"),
    ],
)
def test_what_contradicts_itself_is_refused_in_one_line(settings, message):
    terrains = settings.pop("terrains", (FLAT,))
    with pytest.raises(ValueError, match=f"^{message}[^\n]*$"):
        problem(*terrains, **settings)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (
            "--free control,colour",
            "free: 'colour' is unknown; give some of orientation,shape,control,core,pace,friction",
        ),
        ("--free control,pace --encoding bits", "free: pace is not allowed with encoding 'bits'"),
        ("--friction-spread 0.5", "friction_spread: 0.5 is not allowed with a single draw"),
    ],
)
def test_commands_refuse_bad_input_before_any_work(morpholab, tmp_path, line, message):
    code, out, error = morpholab(f"codesign --terrain flat --out {tmp_path / 'a'} --quiet {line}")
    assert (code, out) == (2, "") and f"error: {message}" in error and error.count("\n") == 1
    assert not (tmp_path / "a").exists()


def test_a_search_of_a_hundred_variables_runs_and_goes_on(morpholab, linear, monkeypatch, tmp_path):
    picture = lambda design, terrain, path, **_: path.write_text("drawn")  # noqa: E731
    monkeypatch.setattr("robots.inflatable.view.picture.save_motion_picture", picture)
    free = "orientation,shape,control,core,pace,friction,modulus,size"
    line = f"codesign --terrain flat --free {free} --encoding graded --columns 3 --geometry small --steps 60000"
    method = "--warm-up 1000 --window 1 --method gradient-hill-climb --climbers 2 --set blind=mutate --quiet"
    for folder, generations in (("whole", 4), ("cut", 2)):
        code, _, error = morpholab(f"{line} {method} --generations {generations} --out {tmp_path / folder}")
        assert code == 0, error
    assert morpholab(f"codesign --resume --generations 4 --quiet --out {tmp_path / 'cut'}")[0] == 0
    logs = [(tmp_path / folder / "log.jsonl").read_bytes() for folder in ("whole", "cut")]
    assert logs[0] == logs[1]
    best = load_design(tmp_path / "whole" / "best.json")
    assert set(best.materials.given) == {"friction", "modulus", "size"} and best.schedule.pace.shape == (8, 3)
