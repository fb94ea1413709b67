"""Forgetting: methods on tasks whose answers are known, levels of bodies, and the study itself on vehicles."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from optim import cli
from optim.experiments.tables import read_records, write_records
from optim.measures.factorial import two_way
from optim.studies.beyond.forgetting import methods
from optim.studies.beyond.forgetting import study as of_study
from optim.studies.beyond.forgetting.families import FAMILIES, LOST, Learning
from optim.studies.beyond.forgetting.methods import METHODS, Recipe, shortened, train
from optim.studies.beyond.forgetting.report import analyse, contrasts, verdict
from optim.studies.beyond.forgetting.study import (
    MEASURES,
    NEEDED,
    STUDY,
    Effort,
    Forgetting,
    levels_of,
    means_over_starts,
    measure,
)

DATA = Path(__file__).parents[3] / "docs/data/forgetting"
RECIPE = Recipe(steps=60, rate=0.1, strength=10.0, replay=2)


class Parabolas:
    """Each environment wants a point, and weighs how far coordinates are from it."""

    def __init__(self, wanted: list[list[float]], weights: list[list[float]]) -> None:
        self.wanted, self.weights, self.looks = np.array(wanted), np.array(weights), [0, 0]

    def values(self, points):
        return -(self.weights * (points[:, None] - self.wanted) ** 2).sum(axis=2)

    def look(self, points, environment):
        self.looks[environment] += len(points)
        away = points - self.wanted[environment]
        return self.values(points)[:, environment], -2 * self.weights[environment] * away


def finals(task: Parabolas, recipe: Recipe = RECIPE, count: int = 3) -> dict[str, np.ndarray]:
    """What remains by method, (N, 2); all start at one place."""
    found = train(task, np.full((count, 2), 0.5), recipe)
    assert found["learned"][:, 0] == pytest.approx(0.0, abs=1e-3)
    return dict(zip(METHODS, found["final"], strict=True))


def test_where_environments_mind_different_coordinates():
    """A minds the first, B the second and, little, the first: only the plain way, and replay less so, forget."""
    found = finals(Parabolas([[0.1, 0.5], [0.9, 0.9]], [[1.0, 0.0], [0.1, 1.0]]))
    assert (found["plain"][:, 0] < -0.3).all()
    assert (found["frozen"][:, 0] > -1e-3).all() and (found["elastic"][:, 0] > -0.01).all()
    assert (found["replay"][:, 0] > found["plain"][:, 0]).all()
    assert (found["frozen"][:, 1] > -0.1).all() and (found["elastic"][:, 1] > -0.1).all()


def test_the_pull_of_elastic_weights():
    """In one coordinate that matters, B's slope is 2 (0.9 - x), and ends at the pull's balance with it."""
    task = Parabolas([[0.1, 0.0], [0.9, 0.0]], [[1.0, 0.0], [1.0, 0.0]])
    after = methods.learn_second(task, np.array([[0.1, 0.0]]), np.array([[1.0, 0.0]]), replace(RECIPE, steps=300))
    pull = RECIPE.strength * 2  # the mean weight matters half as much
    assert after[1, 0] == pytest.approx(0.1 + 2 * 0.8 / (2 + pull), abs=0.02)
    assert after[0, 0] == pytest.approx(0.9, abs=1e-3) and after[3, 0] == pytest.approx(0.1)


def test_the_return_to_what_was_learned_first():
    """A minds the first coordinate, which B moves only in the plain way: the others are back at the first look.

    Where B undoes A and the plain way has moved farther from it than the start was, nothing is saved.
    """
    found = train(Parabolas([[0.1, 0.5], [0.9, 0.9]], [[1.0, 0.0], [0.1, 1.0]]), np.full((3, 2), 0.5), RECIPE)
    plain, elastic, _, frozen = found["again"]
    assert (found["first"] > 0.05).all() and (found["first"] < 0.5).all()
    assert (plain > found["first"]).all() and elastic == pytest.approx(1 / 60) and frozen == pytest.approx(1 / 60)


def test_steps_that_are_needed():
    """Of four looks the second is high enough, or the first, or none."""
    heights = [
        np.array([0.0, 2.0, 0.0]),
        np.array([1.0, 2.0, 0.1]),
        np.array([2.0, 2.0, 0.2]),
        np.array([2.0, 3.0, 0.3]),
    ]
    assert methods.share_needed(heights, np.array([1.0, 1.5, 5.0])) == pytest.approx([0.5, 0.25, 1.0])


def test_all_ways_take_as_many_gradients():
    """As many for each way, of which those that learn A first share its part."""
    task = Parabolas([[0.1, 0.5], [0.9, 0.9]], [[1.0, 0.0], [0.1, 1.0]])
    finals(task, replace(RECIPE, steps=50), count=4)
    assert sum(task.looks) == 4 * 50 * (1 + 4 + 2 + 4)


def test_gradients_are_shortened_whatever_their_length():
    """To a length of one, where squares would overflow, too; short ones stay."""
    found = shortened(np.array([[3e200, 4e200], [0.3, 0.4], [0.0, 0.0]]))
    assert found == pytest.approx(np.array([[0.6, 0.8], [0.3, 0.4], [0.0, 0.0]]))


@pytest.mark.parametrize(
    ("succeeded", "why"),
    [
        (np.ones((3, 2), bool), r"succeeded: shape \(3, 2\) is not allowed; give \(4, 2\)"),
        (np.full((4, 2), 7), "succeeded: 7 is not allowed; give whole numbers from 0 to 1"),
    ],
)
def test_controllers_that_were_not_tried_so_are_tried_again(tmp_path, monkeypatch, succeeded, why):
    tried = {"succeeded": np.array([[True, True], [True, False], [False, False], [False, True]])}
    monkeypatch.setattr(of_study, "_tried", lambda *_: tried)
    effort = Effort(1, controllers=4)
    row = measure(tmp_path, "vehicle", effort, 0, {}, None)
    assert (row["M_L"], row["any"]) == (0.25, 3)
    (part,) = tmp_path.glob("measured/vehicle-0/tried-*.npz")
    np.savez(part, succeeded=succeeded)
    with pytest.warns(UserWarning, match=rf"tried-.*: is damaged, and as good as missing \({why}"):
        assert measure(tmp_path, "vehicle", effort, 0, {}, None) == row


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"final": np.zeros((4, 2, 2))}, r"final: shape \(4, 2, 2\) is not allowed; give \(5, 2, 2\)"),
        ({"learned": np.full((2, 2), np.nan)}, "learned: nan is not allowed; give finite numbers"),
        ({"first": np.array([0.5, 2.0])}, "first: 2.0 is not allowed; give 0.25 to 1"),
        ({"again": np.zeros((4, 2))}, "again: 0.0 is not allowed; give 0.25 to 1"),
    ],
)
def test_what_nobody_can_have_learned_is_learned_again(tmp_path, monkeypatch, changed, why):
    learned = {"start": np.zeros((2, 2)), "learned": np.ones((2, 2)), "final": np.full((5, 2, 2), LOST)}
    learned |= {"first": np.array([0.25, 1.0]), "again": np.full((4, 2), 0.5)}
    monkeypatch.setattr(of_study, "_learned", lambda *_: learned)
    effort = Effort(1, starts=2, steps=4)
    rows = of_study.learn(tmp_path, "vehicle", effort, 0, {}, None)
    (part,) = tmp_path.glob("learned/vehicle-0/trained-*.npz")
    np.savez(part, **learned | changed)
    with pytest.warns(UserWarning, match=rf"trained-.*: is damaged, and as good as missing \({why}"):
        assert of_study.learn(tmp_path, "vehicle", effort, 0, {}, None) == rows


def test_levels_are_the_ends_of_what_was_measured():
    """Bodies that are unable in B are left out where there are enough others."""
    metrics = [{"body": n, "M_CI": n / 10, "M_L": 0.1, "some_a": 1, "some_b": int(n > 1)} for n in range(8)]
    assert levels_of(metrics, 2) == {"high": [7, 6], "low": [2, 3]}
    assert levels_of(metrics, 4) == {"high": [7, 6, 5, 4], "low": [0, 1, 2, 3]}


def test_what_is_said_follows_from_the_values():
    """Made-up runs in which only bodies count, only methods do, or a method helps one level of bodies alone."""
    rng = np.random.default_rng(0)
    ways = ("plain", "elastic", "replay", "frozen")

    def runs(worse):
        return [
            {"level": level, "body": n, "method": way, "worse": worse(level, way) + 0.05 * rng.normal()}
            for level in ("high", "low")
            for n in range(10)
            for way in ways
        ]

    bodies = runs(lambda level, way: float(level == "high"))
    assert verdict(analyse(bodies, "worse"), 0.5) == "the body explains more; no interaction shown"
    assert contrasts(bodies, "worse")["body"][1].low > 0.8
    of_methods = runs(lambda level, way: float(way == "replay"))
    assert verdict(analyse(of_methods, "worse"), None) == "the method explains more; no interaction shown"
    assert contrasts(of_methods, "worse")["adds"][0] == "replay" and contrasts(of_methods, "worse")["body"][1].high < 0
    mixed = analyse(runs(lambda level, way: float(level == "high" and way == "replay")), "worse")
    assert mixed.interaction.omega_low > 0.2 and verdict(mixed, mixed.interaction.p).endswith("methods differ by body")


def with_starts(row):
    """Three starts whose mean is that of a row, as far as it is written."""
    apart = dict.fromkeys((*MEASURES, *NEEDED), 0.25)
    return [
        {**row, "start": start}
        | {name: row[name] + (start - 1) * by for name, by in apart.items() if row[name] is not None}
        for start in range(3)
    ]


def test_starts_are_kept_and_told_by_their_means():
    """Means of starts; a table of an earlier version, which has no starts, stays as it is."""
    older = read_records(DATA / "runs.csv")
    assert "start" not in older[0] and means_over_starts(older) == older
    newer = [{**one, "failed": one["start"]} for row in older for one in with_starts(row)]
    assert len(newer) == 3 * len(older) and newer[0]["final_a"] < newer[2]["final_a"] - 0.4
    assert means_over_starts(newer) == [{**row, "failed": 3} for row in older]


@pytest.mark.long
def test_a_table_with_starts_is_told_from_data(tmp_path):
    """As that of their means is, which is committed."""
    folder = tmp_path / "forgetting"
    shutil.copytree(DATA, folder)
    write_records(folder / "runs.csv", [one for row in read_records(DATA / "runs.csv") for one in with_starts(row)])
    assert cli.main(["reproduce", "forgetting", "--from-data", str(tmp_path), "--out", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out/table.md").read_bytes() == (DATA / "table.md").read_bytes()


@pytest.mark.kernels
def test_gradients_are_those_of_the_share_that_is_covered():
    """By central differences, in a vehicle; what is covered is 1 at the light and 0 at the start."""
    family = FAMILIES["vehicle"]
    task = Learning(family, family.body(0))
    point = np.random.default_rng(4).random((1, task.space.size))
    for environment in (0, 1):
        values, slopes = task.look(point, environment)
        assert values[0] == task.values(point)[0, environment]
        step = 1e-6 * np.eye(task.space.size)
        known = (task.values(point + step) - task.values(point - step))[:, environment] / 2e-6
        assert slopes[0] == pytest.approx(known, abs=1e-4)
    for each in FAMILIES.values():
        probe = np.array([0.01, 0.0101])
        value, slope = each.covered(probe)
        assert np.diff(value) / 1e-4 == pytest.approx(slope.mean(), rel=1e-3)


@pytest.mark.kernels
def test_the_study_goes_on_where_it_was(tmp_path, monkeypatch):
    """To the same tables; a study of other settings is refused."""
    out = Effort(0)
    settings = Forgetting(Effort(2, measured=2, controllers=32, starts=2, steps=3), out, out)
    told = []
    STUDY.run(tmp_path / "a", settings, told.append)
    assert told == sorted(told) and told[-1] == 1.0
    first = {name: (tmp_path / "a" / name).read_bytes() for name in ("runs.csv", "bodies.csv", "table.md")}
    lost = next((tmp_path / "a/learned").glob("*/*.npz"))
    lost.unlink()
    STUDY.run(tmp_path / "a", settings)
    assert {name: (tmp_path / "a" / name).read_bytes() for name in first} == first
    rows = read_records(tmp_path / "a/runs.csv")
    assert len(rows) == 4 * 2 * len(METHODS) and all(row["failed"] == 0 for row in rows)
    assert [row["start"] for row in rows] == 4 * len(METHODS) * [0, 1]
    assert all(row["learned_a"] >= row["start_a"] for row in rows)
    assert all(row["worse"] == min(row["final_a"], row["final_b"]) for row in rows)
    rows = means_over_starts(rows)
    assert all((tmp_path / "a" / name).stat().st_size for name in STUDY.writes)
    summary = json.loads((tmp_path / "a/summary.json").read_text())
    by_hand = [
        [[r["worse"] for r in rows if (r["level"], r["method"]) == (level, way)] for way in list(METHODS)[:4]]
        for level in ("high", "low")
    ]
    assert summary["analyses"]["vehicle worse"]["rows"]["omega"] == pytest.approx(two_way(by_hand, True).rows.omega)
    write_records(tmp_path / "a/runs.csv", rows)  # as folders of earlier versions have it, beside what was trained
    monkeypatch.setattr(of_study, "train", None)
    STUDY.run(tmp_path / "a", settings)
    assert {name: (tmp_path / "a" / name).read_bytes() for name in first} == first
    with pytest.raises(ValueError, match="of other settings"):
        STUDY.run(tmp_path / "a", replace(settings, vehicle=replace(settings.vehicle, starts=1)))
