"""Bodies that evolve for learning, and loops of evolution and learning."""

import json
import re

import numpy as np
import pytest

from optim.problems.robot import RobotProblem
from optim.search import build_method
from optim.studies.beyond.body_and_learning.bodies import WORLDS, columns_of, walker
from optim.studies.beyond.evolving_bodies import STUDY, metrics
from optim.studies.beyond.evolving_bodies.bodies import GENES, EvolvableWalker, body_of, code, drawn_body, stands
from optim.studies.beyond.evolving_bodies.loops import ARMS as LOOPS
from optim.studies.beyond.evolving_bodies.metrics import ARMS, _chosen
from optim.studies.beyond.evolving_bodies.report import write_report
from optim.studies.beyond.evolving_bodies.study import EvolvingBodies
from robots.robot import Trial
from taichi_sim.base.compute import Compute

HERE = Compute(precision="f32", threads=1)


def genes_of(number):
    return np.concatenate([part.ravel() for part in columns_of(number)]).astype(float)


def test_genes_are_columns_of_the_walker():
    assert np.array_equal(body_of(genes_of(5), 1).body.voxels, walker(5, 1).body.voxels)
    drawn = [drawn_body(np.random.default_rng(seed)) for seed in range(20)]
    assert all(stands(genes) for genes in drawn) and len({code(genes) for genes in drawn}) > 15
    assert not stands([0] * 6 + [1] * 6) and not stands([2, 1, 1, 1, 1, 1] + [1] * 6)


def test_where_no_body_stands_evolution_is_as_good_as_drawing(monkeypatch):
    """Nothing that fell may be chosen."""
    drawn = metrics.evolve(None, STUDY.scales["small"].evolving, "drawn", 3)
    monkeypatch.setattr(metrics, "stands", lambda genes: False)
    found = metrics.evolve(None, STUDY.scales["small"].evolving, "both", 3)
    assert stands(found["genes"]) and np.array_equal(found["genes"], drawn["genes"]) and found["tried"] == 1


@pytest.mark.kernels
def test_a_batch_of_bodies_does_what_each_does():
    """With gradients by the controller and none by the body; what does not stand is invalid."""
    evolvable = EvolvableWalker(1)
    rng, size = np.random.default_rng(0), len(evolvable.parameters) - GENES
    points = np.array([[*genes_of(n), *rng.uniform(0, 0.2, size)] for n in (3, 4, 3)])
    points = np.vstack([points, [0] * 6 + [1] * 6 + [0.1] * size])
    found = evolvable.run(points, Trial(WORLDS[0], HERE, gradients=("remaining",)))
    assert found.status.tolist() == ["ok", "ok", "ok", "invalid"] and "two longest legs" in found.reason[3]
    for row, number in ((0, 3), (1, 4), (2, 3)):
        alone = walker(number, 1).run(points[row : row + 1, GENES:], Trial(WORLDS[0], HERE, gradients=("remaining",)))
        assert found.measures["remaining"][row] == alone.measures["remaining"][0]
        assert np.array_equal(found.gradients["remaining"][row, GENES:], alone.gradients["remaining"][0])
        assert not found.gradients["remaining"][row, :GENES].any()
    problem = RobotProblem(evolvable, (WORLDS[0],), objective="minimise:remaining", precision="f64", threads=1)
    search = build_method("lamarckian", problem.space, {"population": 2, "learning": 2, "inherit": False})
    assert search.wants == "gradients" and problem.design(points[0]).kind == "lattice"


def test_the_best_together_is_chosen_among_those_that_none_dominates():
    assert _chosen(np.array([[1.0, 0.0], [0.9, 0.9], [0.0, 1.0], [0.8, 0.8]])) == 1
    assert _chosen(np.array([[1.0], [3.0], [2.0]])) == 1


def test_what_was_found_is_told_with_intervals(tmp_path):
    rng = np.random.default_rng(0)
    names = ("fastest", "M_L", "M_CI", "evolution", "nes", "gradient")
    solved = {"evolution_solved": 2, "nes_solved": 1, "gradient_solved": 0}
    bodies = [
        {"arm": arm, "seed": seed, **{name: more + rng.random() for name in names}, **solved}
        for arm, more in zip(ARMS, (0.0, 2.0, -1.0), strict=True)
        for seed in range(5)
    ]
    runs = [
        {
            "search": arm,
            "seed": seed,
            "nearer": None if seed == 4 else 0.005 if arm == "fixed" else 0.01,
            "evaluations": 10 * seed,
        }
        for arm in LOOPS
        for seed in range(5)
    ]
    write_report(tmp_path, bodies, runs, EvolvingBodies().describe())
    table = (tmp_path / "table.md").read_text()
    difference = next(line for line in table.splitlines() if line.startswith("| for speed and M_CI less those"))
    assert all(1.0 < float(each) < 3.0 for each in re.findall(r"\| \+([\d.]+) ", difference)[1:])
    assert "of at most 64, 64, 16 evaluations" in table and "| drawn | 10 of 10 | 5 of 10 | 0 of 10 |" in table
    assert f"| {LOOPS['flat'].label} | 0.80 (0.24 to 1.36) | - | 20 |" in table
    assert f"| {LOOPS['fixed'].label} | 0.40 (0.12 to 0.68) | -0.40 (-0.68 to -0.12) | 20 |" in table
    assert json.loads((tmp_path / "summary.json").read_text())["loops"]["flat"] == pytest.approx(0.008)
    assert (tmp_path / "evolving.png").stat().st_size > 5000
    # Searches of seeds that have not ended are not told.
    write_report(tmp_path, bodies, [run for run in runs if run["seed"] < 3][:-1], EvolvingBodies().describe())
    assert f"| {LOOPS['flat'].label} | 1.00 (1.00 to 1.00) | - | 5 |" in (tmp_path / "table.md").read_text()
    write_report(tmp_path, bodies, runs[:1], EvolvingBodies().describe())
    assert "Searches" not in (tmp_path / "table.md").read_text()
    assert json.loads((tmp_path / "summary.json").read_text())["loops"] == {}


@pytest.mark.slow
def test_the_study_goes_on_where_it_was(tmp_path):
    """After a part was lost."""
    settings = STUDY.scales["small"]
    STUDY.run(tmp_path, settings)
    first = (tmp_path / "bodies.csv").read_bytes()
    (lost,) = (tmp_path / "parts/both-1").glob("held_out-*.npz")
    lost.unlink()
    STUDY.run(tmp_path, settings)
    assert (tmp_path / "bodies.csv").read_bytes() == first
