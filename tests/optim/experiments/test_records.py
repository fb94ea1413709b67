"""What studies are made of: settings that check themselves, parts, records, pages."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from optim.experiments.allowed import Allowed
from optim.experiments.results import computed, computed_arrays
from optim.experiments.study import Count, Settings, Several, Whole
from optim.experiments.tables import cell, column, distinct, markdown, page, read_records, select, write_columns
from taichi_sim.base.results_folder import ResultsFolder

ROWS = [
    {"gait": "rolling", "slope": 0, "speed": 0.17},
    {"gait": "inching", "slope": 0, "speed": 0.06},
    {"gait": "rolling", "slope": 15, "speed": None},
]


@dataclass(frozen=True)
class Hops(Settings):
    hops: Count = 3
    robots: Several = 2
    seed: Whole = 0
    precision: Literal["f32", "f64"] = "f64"
    threads: int | None = None


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"hops": 0}, "hops: 0 is not allowed; give a whole number, at least 1"),
        ({"robots": 1}, "robots: 1 is not allowed; give a whole number, at least 2"),
        ({"seed": -1}, "seed: -1 is not allowed; give a whole number, at least 0"),
        ({"seed": 1.0}, "seed: 1.0 is not allowed; give a whole number, at least 0"),
        ({"precision": "f16"}, "precision: 'f16' is unknown; choose one of f32, f64"),
    ],
)
def test_settings_are_refused_in_one_line(given, message):
    with pytest.raises(ValueError) as error:
        Hops(**given)
    assert str(error.value) == message


def test_settings_describe_what_results_depend_on():
    assert Hops(threads=4).describe() == {"hops": 3, "robots": 2, "seed": 0, "precision": "f64"}


def test_parts_are_computed_once_each_with_its_share_of_the_progress(tmp_path):
    calls, seen = [], []

    def part(number):
        def compute(progress):
            calls.append(number)
            if progress:
                progress(0.5)
            return np.full(2, number)

        return compute

    for _ in range(2):
        folder = ResultsFolder(tmp_path / "a", "hops", {})
        allowed = dict.fromkeys(("one", "two"), Allowed((2,), kind="i"))
        found = computed_arrays(folder, "heights", {"one": part(1), "two": part(2)}, seen.append, allowed)
        assert [each.tolist() for each in found] == [[1, 1], [2, 2]]
    assert calls == [1, 2] and seen == [0.25, 0.5, 0.75, 1.0, 0.5, 1.0]
    assert list(computed(None, {"x": lambda _: {"a": np.ones(1)}}, None, "{}", len)) == ["x"]


def test_records_are_chosen_and_gathered_by_column():
    assert select(ROWS, gait="rolling", slope=0) == ROWS[:1] and select(ROWS, slope=7) == []
    assert distinct(ROWS, "gait") == ["rolling", "inching"]
    np.testing.assert_array_equal(column(ROWS, "speed"), [0.17, 0.06, np.nan])
    assert column([], "speed").shape == (0,)


@pytest.mark.parametrize("name", ["a.csv", "a.csv.gz"])
def test_columns_are_read_as_written(tmp_path: Path, name):
    write_columns(tmp_path / name, {"n": np.arange(2), "x": [0.5, None], "name": ("one", "two")})
    assert read_records(tmp_path / name) == [{"n": 0, "x": 0.5, "name": "one"}, {"n": 1, "x": None, "name": "two"}]
    with pytest.raises(ValueError):
        write_columns(tmp_path / name, {"n": [1], "x": [1, 2]})


@pytest.mark.parametrize("align", ["l", "lrr"])
def test_a_table_has_an_alignment_for_each_column(align):
    with pytest.raises(ValueError):
        markdown(("a", "b"), align, [(1, 2)])


def test_a_page_leaves_out_what_is_empty():
    table = markdown(("a", "b"), "lr", [(1, cell(0.25)), (2, cell(None)), (3, cell(None, missing=""))])
    assert page("First.", "", table, []) == "First.\n\n| a | b |\n| --- | ---: |\n| 1 | 0.2500 |\n| 2 | – |\n| 3 |  |\n"
