"""Metrics of soft bodies against learning in them, and one controller for many bodies."""

import json
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from optim.experiments.figures import figure
from optim.experiments.tables import read_records
from optim.measures.sampled import sampled_metrics
from optim.measures.statistics import spearman
from optim.studies.beyond.body_and_learning import pouches, report, study, universal
from optim.studies.beyond.body_and_learning.bodies import WORLDS, described, walker
from optim.studies.beyond.body_and_learning.learning import LEARNERS, single_runs
from optim.studies.beyond.body_and_learning.pouches import pouch
from optim.studies.beyond.body_and_learning.report import correlations, foretold, possible, write_report
from optim.studies.beyond.body_and_learning.study import STUDY, BodyAndLearning, body_part
from optim.studies.beyond.body_and_learning.universal import Controller


def test_walkers_differ_in_their_bodies_and_share_their_controllers():
    """As many muscles in all of them, so that a point of one is a point of another."""
    robots = [walker(number) for number in range(12)]
    assert len({robot.body.voxel_count for robot in robots}) > 3
    assert len({tuple(p.name for p in robot.parameters) for robot in robots}) == 1
    told = np.array([described(number) for number in range(12)])
    assert told.shape == (12, 13) and (np.abs(told) <= 1).all() and (told[:, -1] == 1).all()
    assert np.ptp([np.hypot(*world.light) for world in WORLDS]) < 1e-4  # as far away in every world


def test_pouches_differ_in_their_bodies_and_share_their_controllers():
    robots = [pouch(number) for number in range(12)]
    assert len({robot.body.voxel_count for robot in robots}) > 6
    assert len({tuple(p.name for p in robot.parameters) for robot in robots}) == 1
    assert all(0 < robot.drives[-1].mean < 12e3 and robot.felt_regions == tuple(range(5, 13)) for robot in robots)
    assert pouches.STUDY.scales["medium"].robot(3).describe() == robots[3].describe()


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"evaluations": np.array([3, 999])}, "evaluations: 999 is not allowed; give whole numbers from 1 to 16"),
        ({"solved": np.array([True])}, r"solved: shape \(1,\) is not allowed; give \(2,\)"),
    ],
)
def test_learning_that_no_search_can_have_done_is_done_again(tmp_path, monkeypatch, changed, why):
    settings = STUDY.scales["small"]
    measured = SimpleNamespace(sampled=sampled_metrics(np.zeros((4, 2), bool)), felt=None)
    monkeypatch.setattr(study, "measure_body", lambda *_: measured)
    possible = {"evaluations": np.array([2, 4]), "solved": np.array([True, True])}
    monkeypatch.setattr(study, "learn", lambda *_: possible)
    row = body_part(tmp_path, settings, 0, {}, None)
    (part,) = tmp_path.glob("parts/000/learned_evolution-*.npz")
    np.savez(part, **possible | changed)
    with pytest.warns(UserWarning, match=rf"learned_evolution-.*: is damaged, and as good as missing \({why}"):
        assert body_part(tmp_path, settings, 0, {}, None)["evolution"] == row["evolution"] == 3.0


def test_what_metrics_foretell():
    """Of bodies in which evaluations follow M_L, those held out are foretold; noise foretells nothing."""
    rng = np.random.default_rng(0)
    every = rng.integers(1, 100, 80)
    rows = [
        {"M_L": a / 256, "M_CI": a / 200, "all": a, "any": 200, "felt": np.nan, "voxels": v, "evolution": 300 / a}
        for a, v in zip(every, rng.integers(40, 80, 80), strict=True)
    ]
    assert foretold(rows, "evolution").r == pytest.approx(1.0)
    found = correlations(rows, ("evolution",))
    assert found["M_L", "evolution"].r == pytest.approx(-1.0)
    assert abs(found["voxels", "evolution"].r) < 0.3 and found["felt", "evolution"].r is None


def made_up(bodies: int, unknown: int) -> list[dict]:
    """Bodies that need the more evaluations the greater their distance is, which those that need most do not know."""
    return [
        {"M_L": 0.01 * (30 - n), "M_CI": 0.02 * (30 - n), "all": 30 - n, "any": 50, "voxels": n % 5}
        | {"felt": np.nan if n >= bodies - unknown else 1.0 + n}
        | dict.fromkeys(LEARNERS, 10.0 + n)
        | dict.fromkeys((f"{name}_solved" for name in LEARNERS), 2)
        for n in range(bodies)
    ]


def test_each_row_tells_of_how_many_bodies_it_is(tmp_path):
    """Three of twenty have no distance: its row is of 17, that of bodies held out of ten, others of all."""
    write_report(tmp_path, made_up(20, 3), {name: each.title for name, each in LEARNERS.items()}, {"repetitions": 2})
    table = (tmp_path / "table.md").read_text()
    lines = [line.split(" | ") for line in table.splitlines() if line.startswith("| ")]
    told = {cells[0].strip("| "): cells[1] for cells in lines}
    assert told["M_L"] == told["M_CI"] == told["voxels"] == "20" and told["distance (homeostasis)"] == "17"
    assert told["foretold by M_L and M_CI, held-out bodies"] == "10"
    assert "each other 1.00 (1.00 to 1.00), n = 20;" in table and "distance -1.00 (-1.00 to -1.00), n = 17." in table
    assert "unknown in 3 of 20 bodies" in table
    assert told["evolution"] == "19.5 (16.7 to 22.3)" and table.count("40 of 40") == len(LEARNERS)
    write_report(tmp_path, made_up(20, 0), {name: each.title for name, each in LEARNERS.items()}, {"repetitions": 2})
    assert "unknown" not in (tmp_path / "table.md").read_text()


def test_runs_tell_how_reliable_their_means_are(tmp_path):
    """Rows with single runs have a table of it, older rows with means alone have none."""
    titles = {name: each.title for name, each in LEARNERS.items()}
    rows = [row | {f"{name}_runs": [row[name] - 3, row[name] + 3] for name in LEARNERS} for row in made_up(20, 0)]
    write_report(tmp_path, rows, titles, {"repetitions": 2})
    within, between = 18, 2 * np.var(np.arange(20), ddof=1)
    single, mean = (between - within) / (between + within), 1 - within / between
    table = (tmp_path / "table.md").read_text()
    assert f"| gradients | {within**0.5:.1f} | {single:.2f} (" in table
    assert table.count(f"| {mean:.2f} |") == len(LEARNERS)
    write_report(tmp_path, made_up(20, 0), titles, {"repetitions": 2})
    assert "reliable" not in (tmp_path / "table.md").read_text()


@pytest.mark.parametrize(
    ("runs", "why"),
    [
        ([9, 11, 10], r"evolution_runs: lists of \[2, 3\] runs are not allowed"),
        ([9, 12], "evolution_runs: the means of a row are not evolution"),
    ],
)
def test_runs_that_cannot_be_those_of_a_row_are_refused(runs, why):
    rows = [row | {"evolution_runs": [row["evolution"]] * 2} for row in made_up(4, 0)]
    assert single_runs(rows, "evolution").shape == (4, 2)
    rows[0]["evolution_runs"] = runs
    with pytest.raises(ValueError, match=why):
        single_runs(rows, "evolution")


def test_coefficients_hide_no_body(tmp_path, monkeypatch):
    """The body that needs most lies in the upper right corner of a panel, where its coefficient is written."""
    drawn = []

    @contextmanager
    def kept(*args, **kwargs):
        with figure(*args, **kwargs) as (whole, panels):
            yield whole, panels
        whole.draw_without_rendering()
        drawn.append(panels)

    monkeypatch.setattr(report, "figure", kept)
    write_report(tmp_path, made_up(20, 0), {name: each.title for name, each in LEARNERS.items()}, {"repetitions": 2})
    for axes in drawn[0].flat:
        (bodies,), (told,) = axes.collections, [text for text in axes.texts if text.get_text().startswith("$r_s")]
        box = told.get_window_extent().padded(np.sqrt(bodies.get_sizes()[0]) / 2)  # by the radius of a point
        assert not any(box.contains(*place) for place in axes.transData.transform(bodies.get_offsets()))


def test_what_bodies_that_are_left_out_could_change():
    """Three of the slowest without a distance: the greatest keeps the order, the least turns it for them."""
    rows = made_up(20, 3)
    low, high = possible(rows, "felt", "evolution")
    assert correlations(rows, ("evolution",))["felt", "evolution"].r == pytest.approx(1.0)
    ends = [[value] * 3 + [1.0 + n for n in range(17)] for value in (0.0, 99.0)]
    order = [row["evolution"] for row in rows[17:] + rows[:17]]
    assert [low, high] == pytest.approx([spearman(values, order, "two-sided").r for values in ends])
    assert low < 0.5 < 0.99 < high and possible(made_up(20, 0), "felt", "evolution") is None


@pytest.mark.slow
@pytest.mark.kernels
@pytest.mark.parametrize("kind", [BodyAndLearning, pouches.PouchesAndLearning])
def test_the_study_goes_on_where_it_was(tmp_path, kind):
    """To the same rows."""
    settings = kind(bodies=2, controllers=4, repetitions=1, budget=4, cycles=1, nearer=0.001)
    STUDY.run(tmp_path / "a", settings)
    first = read_records(tmp_path / "a/bodies.csv")
    for name in ("controllers0", "learned_nes"):
        (lost,) = (tmp_path / "a/parts/001").glob(f"{name}-*.npz")
        lost.unlink()
    STUDY.run(tmp_path / "a", settings)
    rows = read_records(tmp_path / "a/bodies.csv")
    assert [str(row) for row in rows] == [str(row) for row in first]
    assert all(1 <= row[name] <= LEARNERS[name].evaluations(settings.budget) for row in rows for name in LEARNERS)
    assert (tmp_path / "a/evaluations.png").stat().st_size > 1000
    summary = json.loads((tmp_path / "a/summary.json").read_text())
    assert summary["bodies"] == 2 and set(summary["held_out"]) == set(LEARNERS)
    with pytest.raises(ValueError, match="of other settings"):
        STUDY.run(tmp_path / "a", replace(settings, budget=5))


def test_a_controller_that_is_told_the_body_learns_what_depends_on_it():
    """Points that should be 0.2 in one body and 0.8 in the other; the one told nothing ends between."""
    bodies = [np.array([-1.0, 1.0]), np.array([1.0, 1.0])]
    wanted = [0.2, 0.8]

    def trained(told: list[np.ndarray]) -> list[float]:
        controller = Controller(np.full(3, 0.5), 2, 0.02)
        for _ in range(200):
            controller.step(
                told, [2 * (want - controller.point(body)) for body, want in zip(told, wanted, strict=True)]
            )
        return [float(controller.point(body)[0]) for body in told]

    assert np.allclose(trained(bodies), wanted, atol=0.03)
    assert np.allclose(trained([np.array([0.0, 1.0])] * 2), 0.5, atol=0.03)


def test_points_stay_in_their_ranges():
    """And are not pushed beyond."""
    controller, one = Controller(np.array([0.99]), 1, 0.1), np.ones(1)
    for _ in range(20):
        controller.step([one], [np.ones(1)])
    assert controller.point(one) == 1.0 and controller.weights[0, 0] < 1.6


@pytest.mark.slow
@pytest.mark.kernels
def test_universal_control_goes_on_where_it_was(tmp_path):
    """Seeds that are whole are not trained again; all kinds are told."""
    settings = replace(universal.STUDY.scales["small"], trained=2, gradients=2, batch=1, tested=1, seeds=1)
    universal.STUDY.run(tmp_path / "a", settings)
    first = (tmp_path / "a/runs.csv").read_text()
    universal.STUDY.run(tmp_path / "a", settings)
    assert (tmp_path / "a/runs.csv").read_text() == first
    rows = read_records(tmp_path / "a/runs.csv")
    assert [row["arm"] for row in rows] == list(universal.ARMS) and all(row["failed"] == 0 for row in rows)
    assert "universal, told the body" in (tmp_path / "a/table.md").read_text()


@pytest.mark.parametrize(
    ("part", "changed", "why"),
    [
        ("trained_told", {"weights": np.zeros((2, 2))}, r"weights: shape \(2, 2\) is not allowed; give \(\d+, 13\)"),
        ("tested_told", {"speeds": np.zeros(3)}, r"speeds: shape \(3,\) is not allowed; give \(2,\)"),
        ("tested_each", {"speeds": np.array([0.1, np.inf])}, "speeds: inf is not allowed; give finite numbers"),
        ("tested_each", {"seconds": np.array(np.nan)}, "seconds: nan is not allowed; give finite numbers"),
    ],
)
def test_what_no_training_can_have_found_is_found_again(tmp_path, monkeypatch, part, changed, why):
    settings = replace(universal.STUDY.scales["small"], tested=2)
    size = universal.Walks(settings.cycles).space.size
    trained = {"weights": np.zeros((size, len(described(0)))), "seconds": np.array(2.0)}
    tested = {"speeds": np.array([0.1, np.nan]), "seconds": np.array(3.0)}
    monkeypatch.setattr(universal, "train", lambda *_: trained)
    monkeypatch.setattr(universal, "test", lambda *_: {"speeds": tested["speeds"]})
    monkeypatch.setattr(universal, "train_each", lambda *_: tested)
    rows = universal.seed_part(tmp_path, settings, 0, {}, None)
    assert [row["failed"] for row in rows] == [1] * len(rows)
    (path,) = tmp_path.glob(f"parts/0/{part}-*.npz")
    np.savez(path, **(trained if part.startswith("trained") else tested) | changed)
    with pytest.warns(UserWarning, match=rf"{part}-.*: is damaged, and as good as missing \({why}"):
        assert universal.seed_part(tmp_path, settings, 0, {}, None) == rows


def test_a_universal_training_meets_every_body():
    """As often as any other, but for a last round that ends early; seeds meet them in their own order."""
    settings = replace(universal.STUDY.scales["medium"], trained=7, gradients=25, batch=5)
    drawn = universal.drawn_bodies(settings, 0)
    assert drawn.shape == (5, 5)
    met = np.unique(drawn, return_counts=True)[1]
    assert len(met) == 7 and set(met) <= {3, 4}
    assert not np.array_equal(drawn, universal.drawn_bodies(settings, 1))
    medium = universal.STUDY.scales["medium"]
    bodies = [
        [described(n).tobytes() for n in some.tolist()] for some in (medium.numbers_trained, medium.numbers_tested)
    ]
    assert list(map(len, map(set, bodies))) == [500, 100] and not set(bodies[0]) & set(bodies[1])
    assert len(np.unique(universal.drawn_bodies(medium, 0))) == medium.trained == 500
