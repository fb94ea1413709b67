"""Texts of what holds arrays: short, and telling their shapes."""

from dataclasses import dataclass

import numpy as np
import pytest

import morpholab as ml
from robots.frames import Frames
from robots.hardware import read_csv
from robots.robot import Outcome, Robot
from taichi_sim.base.short_text import ShortText, decimal, printable


@dataclass(frozen=True, repr=False)
class Part(ShortText):
    place: np.ndarray
    names: tuple
    inner: object


def test_arrays_are_told_by_their_shapes():
    inner = Part(np.zeros(2), ("a",), None)
    told = repr(Part(np.zeros((9, 3)), tuple("abcdef"), {"part": inner, "text": "x" * 200}))
    assert told == (
        "Part(place=<float64 of shape (9, 3)>, names=<6 of str>, "
        "inner={'part': Part(place=array([0., 0.]), names=('a'), inner=None), 'text': '" + "x" * 76 + "...})"
    )


def test_robots_have_texts_of_a_few_lines():
    for name in ("soft-quadruped", "rolling", "legged", "vehicle", "freeform"):
        told = repr(ml.robot(name))
        assert len(told) < 1000 and "\n" not in told, name


def test_tables_and_what_comes_of_robots_have_texts_of_one_line(tmp_path):
    """A robot on a rig, too, whose table has hundreds of rows."""
    path = tmp_path / "gait.csv"
    table = ml.export_csv(ml.ROLLING, path, rate=50.0)
    poses = [np.zeros((100, 1, 50, n)) for n in (3, 4, 6, 3)]
    many = Outcome(
        {"speed": np.zeros(1000)}, frames={"positions": poses[0]}, result=Frames(*poses[:2], np.zeros(100), *poses[2:])
    )
    for made in (table, read_csv(path), ml.robot(str(path), rig="dissertation"), many, many.result):
        told = repr(made)
        assert len(told) < 1200 and "\n" not in told and "array([" not in told, told
    assert "pressures=<float64 of shape (2413, 11)>" in repr(table) and "status=<<U2 of shape (1000,)>" in repr(many)
    assert "channels=<11 of Channel>" in repr(ml.PneumaticRig())


def test_robots_that_are_no_dataclasses_have_texts_too():
    class Own(Robot):
        kind = "vehicle"

    assert "Own object" in repr(Own())


def test_what_is_no_utf_8_is_told_as_escapes():
    assert printable("a\udcff \N{BLACK STAR}") == "a\\udcff \N{BLACK STAR}"


@pytest.mark.parametrize(
    ("number", "told"),
    [
        (0.12345, "0.1235"),
        (0.0012, "0.0012"),
        (1.2e-5, "1.2e-05"),
        (-0.0004321, "-0.000432"),
        (0.0, "0.0000"),
        (-0.0, "0.0000"),
        (1e-14, "0.0000"),
    ],
)
def test_numbers_that_four_decimals_would_hide_have_three_digits(number, told):
    assert decimal(number) == told and decimal(1.0, "+") == "+1.0000"


@pytest.mark.parametrize(
    ("number", "told"),
    [(1e12, "1e+12"), (-1.7e308, "-1.7e+308"), (2.0**62, "4.61169e+18"), (999999999999.0, "999999999999.0000")],
)
def test_vast_numbers_have_six_digits(number, told):
    assert decimal(number) == told and decimal(1e300, "+") == "+1e+300"
