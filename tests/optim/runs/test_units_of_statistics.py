"""Which units comparisons count: runs, or climbers where each is a sample of its own."""

from dataclasses import replace
from pathlib import Path

import pytest

from optim.runs.comparison import curves, shared_end, spoken_axis, standing
from optim.runs.differences import differences_at
from optim.runs.generation import Generation
from optim.runs.history import History

SCORES = {"a": [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]], "b": [[1.1, 1.2, 1.3], [1.4, 1.5, 1.6]]}


def history(name, method, scores=None, **settings):
    """A run of some climbers that cost 10 evaluations each a generation."""
    scores, rest = scores or SCORES[name], (None, None, None)
    generations = [
        Generation(n, 10 * len(row) * (n + 1), 0, max(row), *rest[:2], row, *rest[:2], {})
        for n, row in enumerate(scores)
    ]
    config = {"problem": {}, "method": {"name": method, "tag": name, **settings}, "generations": len(scores) - 1}
    return History(Path(name), config, tuple(generations), (1.0,) * len(scores), None, False)


@pytest.mark.parametrize(
    ("method", "unit"),
    [("hill-climb", "climbers"), ("generating-set", "climbers"), ("race", "runs"), ("stochastic", "runs")],
)
def test_climbers_are_units_where_each_is_a_sample_of_its_own(method, unit):
    """Those of a race return about the best of all, and those of stochastic ascent move in the same minibatches."""
    found = curves([history(name, method) for name in "ab"], "generations")
    assert [curve.unit for curve in found] == [unit, unit]
    assert bool(differences_at(found, shared_end(found, "generations"))) is (unit == "climbers")


def test_of_methods_that_are_not_installed_the_run_is_the_unit():
    mixed = curves([history("a", "hill-climb"), history("b", "of a package")], "generations")
    assert [curve.unit for curve in mixed] == ["runs", "runs"]


def test_a_climber_is_charged_its_own_evaluations():
    """A run of four climbers is no slower than one of two that has done as much with each."""
    few, many = history("a", "hill-climb"), history("b", "hill-climb", [[0.1] * 4, [0.5] * 4])
    found = curves([few, many], "evaluations")
    assert [curve.x.tolist() for curve in found] == [[10.0, 20.0], [10.0, 20.0]]
    assert standing(found[1], shared_end(found, "evaluations")).mean == 0.5
    assert spoken_axis(found, "evaluations") == "evaluations of each climber"
    whole = curves([few, history("b", "race")], "evaluations")
    assert whole[0].x.tolist() == [30.0, 60.0] and spoken_axis(whole, "evaluations") == "evaluations"
    assert curves([few, many], "generations")[1].x.tolist() == [0.0, 1.0]


def test_groups_that_settings_would_tell_at_length_have_the_names_of_their_folders():
    """Those of several seeds have that of the folder of all, as each begins with a run called seed-0."""

    def run(folder, seed):
        base = history("a", "race", SCORES["a"] if seed else SCORES["b"])
        config = {**base.config, "seed": seed, "problem": {"a setting": f"with a value that is long enough, {folder}"}}
        return replace(base, path=Path(folder) / f"seed-{seed}", config=config)

    runs = [run(folder, seed) for folder in ("legs", "none") for seed in range(2)]
    assert [curve.label for curve in curves(runs, "generations")] == ["race (legs)", "race (none)"]
    assert [curve.label for curve in curves(runs[1:3], "generations")] == ["race (seed-1)", "race (seed-0)"]
    beside = [replace(each, path=Path("runs") / "-".join(each.path.parts)) for each in runs]
    assert [curve.label for curve in curves(beside, "generations")] == ["race (legs-seed-0)", "race (none-seed-0)"]
