"""Rehearsals of a resume: every built-in method goes on alike from its own checkpoints, and none is changed by that."""

import gc
import json
import weakref
from dataclasses import replace

import numpy as np
import pytest
from searching import CELL_GRID

from optim.problem import Evaluation
from optim.runs import loop, open_run, run_search
from optim.runs.rehearsal import Rehearsal, _alike
from optim.search import METHODS, build_method, check_settings
from optim.search.random_search import RandomSearch
from optim.space import Space

GENERATIONS = 10
SETTINGS = {"population": 6, "climbers": 6, "candidates": 6}


class Relaxed:
    """A quick problem of cells, with a relaxation, where a method's every phase works; some points fail."""

    space = Space(tuple(replace(each, step=each.step or 0.3) for each in CELL_GRID.variables))
    objective_names = ("score",)

    def describe(self):
        return {"size": self.space.size}

    def evaluate(self, points):
        return self.evaluate_relaxed(self.space.validate(points), np.inf, gradients=False)

    def evaluate_relaxed(self, points, sharpness, gradients):
        away = (points - self.space.low) / self.space.span - 0.4
        scores = -(away**2).sum(axis=1)
        return Evaluation(
            np.where(points[:, -1] < 0.05, np.nan, scores), gradients=-2 * away / self.space.span if gradients else None
        )

    def check_minibatch(self, size):
        pass

    def in_minibatch(self, minibatch):
        return self

    def save(self, point, path):
        path.write_text(json.dumps(self.space.to_dict(point)))


def search(folder, name, rehearsed, monkeypatch):
    monkeypatch.setattr(loop, "REHEARSED", rehearsed)
    settings = {"seed": 3}
    for setting, value in SETTINGS.items():
        try:
            check_settings(name, {setting: value})
        except ValueError:
            continue
        settings[setting] = value
    config = {"problem": {"size": 2}, "method": {"name": name, **settings}, "generations": GENERATIONS}
    with open_run(folder, config) as run:
        run_search(Relaxed(), build_method(name, Relaxed.space, settings), run, GENERATIONS)
    return (folder / "log.jsonl").read_bytes()


@pytest.mark.parametrize("name", METHODS.builtin)
def test_a_built_in_method_goes_on_alike_and_to_the_same_bits(name, tmp_path, monkeypatch):
    plain = search(tmp_path / "plain", name, 0, monkeypatch)
    assert search(tmp_path / "rehearsed", name, GENERATIONS + 1, monkeypatch) == plain


ALIVE = weakref.WeakSet()


class Counted(RandomSearch):
    """A method that knows its living instances, copies among them."""

    def __setattr__(self, name, value):
        super().__setattr__(name, value)
        ALIVE.add(self)

    def __setstate__(self, state):
        self.__dict__.update(state)
        ALIVE.add(self)


def instances(folder, generations):
    """How many instances there are after each generation of a run, which begins or goes on."""
    counts = {}

    def count(last):
        gc.collect()
        counts[last.generation] = len(ALIVE)

    ALIVE.clear()
    with open_run(folder, {"problem": {}, "method": {"name": "random"}, "generations": 6}, resume=True) as run:
        run_search(Relaxed(), Counted(Relaxed.space), run, generations, count)
    return counts


def test_copies_are_let_go_after_the_first_generations(tmp_path):
    counts = instances(tmp_path / "a", 5)
    assert min(counts[0], counts[1]) > 1 and [counts[each] for each in (2, 3, 4, 5)] == [1] * 4
    assert instances(tmp_path / "a", 6) == {5: 1, 6: 1}


@pytest.mark.parametrize(
    ("one", "other", "alike"),
    [
        (10**10, 10**10 + 1, False),
        (np.array([True]), np.array([False]), False),
        (1, np.array(1.0), True),
        (1.0, 1.0 + 1e-12, True),
        (np.array([1.0, np.nan]), np.array([1.0, np.nan]), True),
        (np.array([1j, complex(np.nan, 0)]), np.array([1j * (1 + 1e-12), complex(np.nan, 0)]), True),
        (np.array([1j]), np.array([1.001j]), False),
        ([np.zeros(2), np.zeros(3)], [np.zeros(2), np.zeros(3)], True),
        ([np.zeros(2), np.zeros(3)], [np.zeros(2), np.ones(3)], False),
        ([np.zeros(2), np.zeros(3)], None, False),
    ],
)
def test_whole_numbers_are_alike_to_the_last_and_others_but_for_last_bits(one, other, alike):
    assert _alike(one, other) == alike


class Slotted:
    """A method of its own class, without a dictionary of attributes, which forgets how often it was told anything."""

    __slots__ = ("count",)
    wants, sharpness, minibatch = "points", 0.0, None

    def __init__(self):
        self.count = 0

    def ask(self):
        return np.full((1, Relaxed.space.size), float(self.count))

    def tell(self, points, evaluation):
        self.count += 1

    def state(self):
        return {}

    def restore(self, state):
        pass


def test_a_method_with_slots_is_refused_as_any_other():
    method = Slotted()
    rehearsal = Rehearsal("slotted", method)
    method.tell(None, None)
    with pytest.raises(ValueError, match="it asks for other points; all that changes must be in arrays"):
        rehearsal.check(method, method.state())
