"""Searches that decide which bladders a body has, or design for a body that lacks some."""

import dataclasses
import functools
import json

import numpy as np
import pytest
from graded import GRIPPING
from linear_robot import Linear
from run_products import log

from optim.problems.inflatable.encodings import ENCODINGS
from optim.problems.inflatable.problem import GaitProblem
from robots import inflatable
from robots.inflatable import INCHING, NAMED_GEOMETRIES, load_design
from robots.inflatable.layout import EVERY_BLADDER, layout_from_mask, layout_mask
from robots.world import Terrain

FEW = (1, 3, 6)
FLAT = Terrain()


def problem(**settings):
    given = {"columns": 3, "geometry": "small", "more": ("bladders",), "threads": 1}
    return GaitProblem((FLAT,), **{**given, **settings})


@pytest.fixture
def linear(monkeypatch):
    stand_in = Linear()
    monkeypatch.setattr("robots.inflatable.simulation.simulate", stand_in.simulate)
    return stand_in


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_points_say_which_bladders_there_are_and_leave_the_others_empty(encoding, tmp_path):
    made = problem(encoding=encoding)
    names = made.space.names
    assert names[2:10] == tuple(f"has_bladder{place}" for place in EVERY_BLADDER)
    for point in made.space.sample(np.random.default_rng(0), 6):
        design = made.design(point)
        assert design.bladders == layout_from_mask(point[2:10])
        assert not design.schedule.inflation[~layout_mask(design.bladders)].any()
        whole = made.design(np.concatenate([point[:2], np.ones(8), point[10:]]))
        assert np.array_equal(whole.schedule.grip, design.schedule.grip)
        if encoding != "codes" and not encoding.startswith("graded"):
            kept = layout_mask(design.bladders)
            assert np.array_equal(whole.schedule.inflation[kept], design.schedule.inflation[kept])
        made.save(point, tmp_path / "best.json")
        assert load_design(tmp_path / "best.json") == design
        assert made.robot_of(point).parts[0].bladders == design.bladders


@pytest.mark.parametrize("encoding", ["codes", "bits", "graded"])
def test_genes_of_bladders_that_are_not_there_say_nothing(encoding):
    """Nor do they take time or air from the others: not of how often a gait is played, nor of what may be full."""
    more = {"most_full": 2.0} if encoding == "graded" else {}
    made = problem(encoding=encoding, more=(), bladders=FEW, **more)
    silent = [
        number
        for number, name in enumerate(made.space.names)
        if any(f"bladder{place}" in name.split("_") for place in EVERY_BLADDER if place not in FEW)
    ]
    assert len(silent) == 5 * {"codes": 2, "bits": 3, "graded": 3}[encoding]
    points = made.space.sample(np.random.default_rng(1), 5)
    others = made.space.sample(np.random.default_rng(2), 5)
    others[:, [n for n in range(made.space.size) if n not in silent]] = np.delete(points, silent, axis=1)
    for point, other in zip(points, others, strict=True):
        assert made.design(point) == made.design(other) and not np.array_equal(point, other)
        assert made.relaxed_design(point, 1.0) == made.relaxed_design(other, 1.0)


def test_descriptions_come_back_and_those_of_earlier_commits_have_every_bladder():
    for made in (problem(), problem(more=(), bladders=[6, 1, 3]), problem(more=(), bladders=())):
        described = json.loads(json.dumps(made.describe()))
        again = GaitProblem.from_description(described)
        assert again.describe() == described and again.space == made.space and again.bladders == made.bladders
    earlier = problem(more=()).describe()
    assert "bladders" not in earlier and "bladders" not in earlier["free"]
    assert GaitProblem.from_description(earlier).design(problem(more=()).space.low).bladders is None
    assert ("Fixed", "bladders 1,3,6") in problem(more=(), bladders=FEW).facts()
    for settings, message in (
        ({"bladders": FEW}, "^bladders: 1,3,6 would fix what is free; give one of both"),
        ({"bladders": (0,), "more": ()}, "^bladders: 0 is not allowed; give a whole number, at least 1"),
    ):
        with pytest.raises(ValueError, match=message):
            problem(**settings)


def test_searches_start_at_gaits_of_bodies_that_lack_bladders():
    gait = INCHING.with_layout(FEW)
    made = problem(encoding="bits", columns=INCHING.schedule.columns)
    start = made.space.from_dict(made.start_values(gait))
    assert made.design(start) == dataclasses.replace(gait, schedule=made.design(start).schedule)
    assert made.design(made.space.from_dict(made.start_values(INCHING))).bladders == EVERY_BLADDER
    fixed = problem(encoding="bits", columns=INCHING.schedule.columns, more=(), bladders=FEW)
    assert fixed.design(fixed.space.from_dict(fixed.start_values(gait))).bladders == FEW
    with pytest.raises(ValueError, match=r"^start: bladders 1,3,6 are not those of the search; free them, or give"):
        problem(encoding="bits", columns=INCHING.schedule.columns, more=()).start_values(gait)


def test_bodies_of_a_generation_are_judged_layout_by_layout(linear):
    told = []
    made = problem(encoding="graded", steps=60_000, progress=told.append)
    points = made.space.sample(np.random.default_rng(0), 6)
    points[[0, 2, 5], 2:10] = layout_mask(FEW)
    points[[1, 4], 2:10] = 1.0
    judged = made.evaluate(points)
    assert [len(call.designs) for call in linear.calls] == [3, 2, 1]
    assert all(len({design.bladders for design in call.designs}) == 1 for call in linear.calls)
    assert told == pytest.approx([3 / 6, 5 / 6, 1.0])  # of robots, whatever their bodies
    alone = [made.evaluate(point).objectives[0, 0] for point in points]
    assert judged.objectives[:, 0].tolist() == alone
    assert made.columns_of(points[:2])["Bladders"] == ["1,3,6", "1,2,3,4,5,6,7,8"]


@pytest.fixture
def tiny(monkeypatch):
    """The small robot of commands, smaller and driven quickly."""
    monkeypatch.setitem(NAMED_GEOMETRIES, "small", GRIPPING)
    drive = functools.partial(
        inflatable.InflatableActuation, inflation_rate=0.05, pressure_ramp=100.0, hold_steps=50, settle_steps=30
    )
    monkeypatch.setattr("robots.calibration.properties.InflatableActuation", drive)


@pytest.mark.kernels
def test_a_robot_of_a_generation_does_what_it_does_alone(tiny):
    """Bit for bit, whatever bodies are judged beside it; and slopes are those of its own body."""
    made = problem(encoding="graded", columns=1, steps=100, precision="f64", ramp_steps=60)
    points = made.space.sample(np.random.default_rng(4), 4)
    points[:, 2:10] = [layout_mask(FEW), np.ones(8), layout_mask(FEW), np.zeros(8)]
    together = made.evaluate(points)
    assert together.status.tolist() == ["ok"] * 4
    assert together.objectives[:, 0].tolist() == [made.evaluate(point).objectives[0, 0] for point in points]
    slopes = made.evaluate_relaxed(points, 0.0, True).gradients
    named = dict(zip(made.space.names, slopes.T, strict=True))
    assert all(not named[f"has_bladder{place}"].any() for place in EVERY_BLADDER)
    inside = {place: (points[:, made.space.names.index(f"bladder{place}_1")]) for place in EVERY_BLADDER}
    for place, levels in inside.items():
        has = points[:, 1 + place] > 0
        assert np.array_equal(named[f"bladder{place}_1"] != 0, has & (levels > 0) & (levels < 1)), place


@pytest.mark.kernels
def test_evolution_decides_which_bladders_exist_and_goes_on_where_it_stopped(morpholab, tiny, tmp_path):
    line = (
        "codesign --terrain flat --geometry small --free control,bladders --columns 1 --repeats 1 --method genetic "
        "--population 4 --seed 3 --threads 1 --quiet"
    )
    with pytest.MonkeyPatch.context() as patch:
        drawn = "robots.inflatable.view.picture.save_motion_picture"
        patch.setattr(drawn, lambda design, terrain, path, **_: path.write_text("drawn"))
        assert morpholab(f"{line} --generations 1 --out a")[0] == 0
        assert morpholab(f"{line} --generations 0 --out b")[0] == 0
        assert morpholab("codesign --resume --generations 1 --out b --quiet")[0] == 0
        assert morpholab(f"{line} --free control --bladders 1,3,6 --generations 0 --out c")[0] == 0
    assert (tmp_path / "a/log.jsonl").read_bytes() == (tmp_path / "b/log.jsonl").read_bytes()
    point = log(tmp_path / "a")[-1]["best_point"]
    best = load_design(tmp_path / "a/best.json")
    assert best.bladders == layout_from_mask([point[f"has_bladder{place}"] for place in EVERY_BLADDER])
    assert load_design(tmp_path / "c/best.json").bladders == FEW
    code, out, _ = morpholab("simulate --gait a/best.json --geometry small --threads 1 --json")
    assert code == 0 and json.loads(out)["bladders"] == list(best.bladders)


@pytest.mark.usefixtures("simulator")
def test_what_contradicts_itself_is_refused_in_one_line(morpholab):
    line = "codesign --terrain flat --generations 1 --quiet --out a"
    for more, told in (
        ("--free control,bladders --bladders 1,2", "bladders: 1,2 would fix what is free"),
        ("--bladders 1,9", "9 is not allowed; give a whole number, at most 8"),
        ("--free control,bladders --method gradient", "has_bladder1: an integer has no gradient; leave it to another"),
    ):
        code, _, error = morpholab(f"{line} {more}")
        assert code == 2 and told in error and error.strip().count("\n") == 0, error
