"""Checks of what comes from outside."""

import re
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Annotated, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robots.inflatable import ROLLING, InflatableDesign, simulate
from robots.world import Terrain
from taichi_sim.base import checks
from taichi_sim.base.checks import choice, number, whole_number
from taichi_sim.base.files import read_record


@given(st.integers(0, 2**63 - 1))
def test_whole_numbers_keep_every_digit(value):
    """As floats, those beyond 2^53 are others."""
    assert whole_number("seed", value, 0) == value
    assert whole_number("seed", np.int64(value), 0) == value


@given(st.one_of(st.integers(), st.floats(), st.text(), st.booleans(), st.none(), st.lists(st.integers())))
def test_anything_is_a_number_or_refused_in_one_line(value):
    for check in (lambda: number("field", value, -5.0, 5.0, "m"), lambda: whole_number("field", value, 0, 10)):
        try:
            found = check()
        except ValueError as error:
            assert str(error).startswith("field: ") and "\n" not in str(error)
        else:
            assert found == value and not isinstance(value, bool)


@pytest.mark.parametrize("digits", [309, 5000])
@pytest.mark.parametrize("check", [number, lambda field, value: whole_number(field, value, 0)])
def test_numbers_that_no_float_can_be_are_refused_briefly(check, digits):
    with pytest.raises(ValueError, match=r"^mass: .* is not allowed; give a (finite|whole) number") as error:
        check("mass", 10**digits)
    assert len(str(error.value)) < 200


@pytest.mark.parametrize("value", ["smal", 3, ["small"], {}, None])
def test_a_name_must_be_known(value):
    assert choice("geometry", "small", ("small", "published")) == "small"
    with pytest.raises(ValueError, match=r"^geometry: .* is unknown; choose one of small, published$"):
        choice("geometry", value, ("small", "published"))


@dataclass(frozen=True)
class Disk:
    radius: checks.Positive
    slope: Annotated[float, partial(number, low=-80.0, high=80.0, unit="degrees")] = 0.0
    corners: Annotated[int, partial(whole_number, low=3)] = 100
    surface: Literal["smooth", "rough"] | None = None
    mass: checks.NotNegative | None = None
    name: str = ""

    def __post_init__(self) -> None:
        checks.check_fields(self)


def test_fields_are_checked_by_their_types():
    disk = Disk(2, corners=4.0, surface="rough")
    assert (disk.radius, disk.corners, disk.surface, disk.mass) == (2.0, 4, "rough", None)
    assert isinstance(disk.radius, float) and isinstance(disk.corners, int)
    for wrong, message in (
        ({"radius": 0.0}, "radius: 0.0 is not allowed; give a positive finite number"),
        ({"radius": None}, "radius: None is not allowed; give a positive finite number"),
        ({"slope": 90.0}, "slope: 90.0 is not allowed; give a number from -80 to 80 degrees"),
        ({"corners": 2}, "corners: 2 is not allowed; give a whole number, at least 3"),
        ({"surface": "blue"}, "surface: 'blue' is unknown; choose one of smooth, rough"),
        ({"mass": -1}, "mass: -1 is not allowed; give a finite number, at least 0"),
    ):
        with pytest.raises(ValueError, match=f"^{message}$"):
            Disk(**{"radius": 1.0, **wrong})


def test_arrays_have_the_shape_that_is_asked_for():
    given = np.ones((4, 3))
    found = checks.numbers("starts", given, "B", 3)
    assert np.array_equal(found, given) and found is not given
    for wrong, message in (
        ("abc", "starts: 'abc' is not allowed; give numbers of shape (B, 3)"),
        ([["1", "2", "3"]], "starts: [['1', '2', '3']] is not allowed; give numbers of shape (B, 3)"),
        ([[10**400, 1, 2]], f"starts: [[1{'0' * 97}... is not allowed; give numbers of shape (B, 3)"),
        (np.ones(3), "starts: shape (3,) is not allowed; give (B, 3)"),
        (np.ones((0, 3)), "starts: shape (0, 3) is not allowed; give (B, 3)"),
        ([[1.0, np.nan, 2.0]], "starts: nan is not allowed; give finite numbers"),
        (np.ones((1, 3), bool), "starts: array([[ True, True, True]]) is not allowed; give numbers of shape (B, 3)"),
        ([[1, 0.5, True]], "starts: [[1, 0.5, True]] is not allowed; give numbers of shape (B, 3)"),
        ([np.array([1.0, 2.0, 3.0]), (1, np.True_, 2)], "starts: [array([1., 2., 3.]), (1, np.True_, 2)] is not al"),
        (np.array([[1, 0.5, True]], object), "starts: array([[1, 0.5, True]], dtype=object) is not allowed; give num"),
        (np.ones((1, 3), complex), "starts: array([[1.+0.j, 1.+0.j, 1.+0.j]]) is not allowed; give numbers of shape"),
        ([[1, 2, 3j]], "starts: [[1, 2, 3j]] is not allowed; give numbers of shape (B, 3)"),
    ):
        with pytest.raises(ValueError, match=f"^{re.escape(message)}") as error:
            checks.numbers("starts", wrong, "B", 3)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "value", [np.ones(2, np.float32), np.ones(2, np.int8), [1, 2.0], (np.float64(1), np.int64(2)), [Fraction(1, 2), 1]]
)
def test_arrays_may_be_of_any_kind_of_real_numbers(value):
    assert np.array_equal(checks.numbers("x", value, 2), [float(each) for each in value])


def test_settings_are_of_their_very_kind():
    assert checks.integer("climbers", 3, 1) == 3 and checks.positive("rate", 2, 5.0) == 2.0
    assert checks.flag("verify", True) and checks.table("start", {"x": 1}) == {"x": 1}
    for check, message in (
        (lambda: checks.integer("climbers", 3.0, 1), "climbers: 3.0 is not allowed; give a whole number, at least 1"),
        (lambda: checks.positive("rate", 0.0, 5.0), "rate: 0.0 is not allowed; give a positive number, at most 5"),
        (lambda: checks.number("vacuum", 1, high=0.0), "vacuum: 1 is not allowed; give a finite number, at most 0"),
        (lambda: checks.flag("verify", 1), "verify: 1 is not allowed; give true or false"),
        (lambda: checks.table("start", [1]), r"start: \[1\] is not allowed; give values by name"),
    ):
        with pytest.raises(ValueError, match=f"^{message}$"):
            check()


@pytest.mark.parametrize("text", ["[" * 100_000, '{"format": "a", "x": 1' + "0" * 400 + "}", '{"format": "a"}', "3"])
def test_a_file_that_cannot_be_understood_is_named(tmp_path, text):
    path = tmp_path / "design.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=f"^{re.escape(str(path))}: ") as error:
        read_record(path, "a", lambda record: float(record["x"]))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"terrain": "flat"}, "terrain: 'flat' is not allowed; give a Terrain"),
        ({"terrain": [Terrain(), "flat"]}, "terrain: 'flat' is not allowed; give a Terrain"),
        ({"geometry": "small"}, "geometry: 'small' is not allowed; give an InflatableGeometry"),
        ({"actuation": "physical"}, "actuation: 'physical' is not allowed; give an InflatableActuation"),
    ],
)
def test_names_that_only_commands_know_are_refused(options, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        simulate([ROLLING, ROLLING], **options)


def test_a_pressure_of_too_many_digits_is_refused():
    with pytest.raises(ValueError, match=r"^pressure: 1000"):
        InflatableDesign(10**400, 0.0, ROLLING.schedule)


def test_a_record_gives_a_name_once(tmp_path):
    path = tmp_path / "design.json"
    path.write_text('{"format": "a", "parts": [{"x": 1, "y": 2, "x": 3}]}')
    with pytest.raises(ValueError) as error:
        read_record(path, "a", lambda record: record)
    assert str(error.value) == f"{path}: 'x' is given twice, which is not allowed; give it once"
    path.write_text('{"format": "a", "parts": [{"x": 1}, {"x": 3}]}')
    assert read_record(path, "a", lambda record: record["parts"]) == [{"x": 1}, {"x": 3}]


def test_texts_among_numbers_of_any_size_are_no_numbers():
    """Whole numbers beyond 64 bits make an array of objects, in which a text would be read as a number."""
    for value in ([10**30, "2"], np.array([1, "2"], object)):
        with pytest.raises(ValueError, match=r"^x: .* give numbers of shape \(2,\)"):
            checks.numbers("x", value, 2)
    assert checks.numbers("x", [10**30, 2], 2).tolist() == [1e30, 2.0]
