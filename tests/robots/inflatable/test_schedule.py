import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from robots.inflatable.schedule import ROWS, GaitSchedule

INCHING = "/".join(["10101010"] * 4 + ["00000000"] * 4 + ["01010101", "10101010"])

any_schedule = st.builds(
    GaitSchedule,
    st.integers(1, 12).flatmap(lambda columns: arrays(bool, (ROWS, columns))),
    st.integers(1, 4),
)


@st.composite
def codes(draw):
    columns = draw(st.integers(1, 20))
    half = st.lists(st.integers(0, columns), min_size=ROWS, max_size=ROWS)
    return draw(half), draw(half), columns


def literal_row(f: int, phi: int, columns: int) -> list[bool]:
    """The published rule, word for word: columns counted from 1, every integer k."""
    if f == 0:
        return [True] * columns
    on = {phi + 1 + k * (f + 1) for k in range(-columns - 1, columns + 1)}
    return [column in on for column in range(1, columns + 1)]


@given(codes())
def test_codes_follow_the_published_rule(code):
    f, phi, columns = code
    bits = GaitSchedule.from_codes(f, phi, columns).bits
    assert bits.tolist() == [literal_row(*row, columns) for row in zip(f, phi, strict=True)]


@given(codes())
def test_a_schedule_made_of_codes_survives_its_own_codes(code):
    schedule = GaitSchedule.from_codes(*code, repeats=3)
    assert GaitSchedule.from_codes(*schedule.to_codes(), columns=schedule.columns, repeats=3) == schedule


@pytest.mark.parametrize("columns", range(1, 8))
def test_to_codes_finds_the_smallest_code_of_every_row_that_has_one(columns):
    smallest: dict[tuple[bool, ...], tuple[int, int]] = {}
    for code in itertools.product(range(columns + 1), repeat=2):
        smallest.setdefault(tuple(literal_row(*code, columns)), code)
    for row in itertools.product([False, True], repeat=columns):
        schedule = GaitSchedule(np.array([row] * ROWS))
        if row in smallest:
            f, phi = schedule.to_codes()
            assert set(zip(f.tolist(), phi.tolist(), strict=True)) == {smallest[row]}
        else:
            with pytest.raises(ValueError, match=r"^schedule: [01]+ of bladder1 has no \(f, phi\) code; .*$"):
                schedule.to_codes()


def test_the_row_without_a_code_is_named():
    with pytest.raises(ValueError, match="11010000 of foot2 has no"):
        GaitSchedule.from_text(INCHING[:-8] + "11010000").to_codes()


def test_codes_of_the_inching_gait():
    f, phi = GaitSchedule.from_text(INCHING).to_codes()
    assert f.tolist() == [1, 1, 1, 1, 8, 8, 8, 8, 1, 1]
    assert phi.tolist() == [0, 0, 0, 0, 8, 8, 8, 8, 1, 0]


@given(any_schedule)
def test_every_schedule_survives_its_text(schedule):
    copy = GaitSchedule.from_text(schedule.to_text(), schedule.repeats)
    assert copy == schedule
    assert hash(copy) == hash(schedule)
    assert eval(repr(schedule)) == schedule


@given(any_schedule)
def test_played_repeats_the_columns(schedule):
    played = schedule.played
    assert played.shape == (ROWS, schedule.columns * schedule.repeats)
    for start in range(0, played.shape[1], schedule.columns):
        assert np.array_equal(played[:, start : start + schedule.columns], schedule.bits)


def test_equality_is_by_content():
    schedule = GaitSchedule.from_text(INCHING)
    assert schedule == GaitSchedule(schedule.bits.astype(float))
    assert schedule != GaitSchedule.from_text(INCHING, repeats=1)
    assert schedule != GaitSchedule(~schedule.bits)
    assert schedule != INCHING


def test_bits_are_a_read_only_copy():
    given_bits = np.zeros((ROWS, 3), bool)
    schedule = GaitSchedule(given_bits)
    given_bits[:] = True
    assert not schedule.bits.any()
    with pytest.raises(ValueError, match="read-only"):
        schedule.bits[0, 0] = True


@pytest.mark.parametrize(
    ("bits", "message"),
    [
        (np.zeros((9, 8)), r"shape \(9, 8\) is not allowed"),
        (np.zeros((10, 0)), r"shape \(10, 0\) is not allowed"),
        (np.zeros(10), r"shape \(10,\) is not allowed"),
        ([[0, 1]] * 9 + [[0]], r"[^\n]* is not allowed; give numbers of shape \(10, T\)"),
        (np.full((10, 2), np.nan), "nan is not allowed; give finite numbers"),
        ([[0, 1]] * 9 + [[0, 2]], "2.0 of foot2, column 2 is not allowed"),
        (np.full((10, 2), 1.5), "1.5 of bladder1, column 1 is not allowed"),
        (np.full((10, 2), "1"), r"[^\n]* is not allowed; give numbers of shape \(10, T\)"),
    ],
)
def test_bad_bits_are_refused_in_one_line(bits, message):
    with pytest.raises(ValueError, match=f"^schedule: {message}.*$"):
        GaitSchedule(bits)


@pytest.mark.parametrize("repeats", [0, -1, 1.5, math.nan, "2", True])
def test_bad_repeats_are_refused(repeats):
    with pytest.raises(ValueError, match=r"^repeats: .* is not allowed; give a whole number, at least 1$"):
        GaitSchedule(np.zeros((ROWS, 2)), repeats)


@pytest.mark.parametrize("value", [-1, 9, 0.5])
@pytest.mark.parametrize("field", ["f", "phi"])
def test_a_code_out_of_range_is_refused(field, value):
    code = {"f": [0] * ROWS, "phi": [0] * ROWS}
    code[field][8] = value
    with pytest.raises(ValueError, match=rf"^{field}: .* of foot1 is not allowed; .* 0 to 8$"):
        GaitSchedule.from_codes(**code)


def test_a_code_of_the_wrong_shape_is_refused():
    with pytest.raises(ValueError, match=r"^phi: shape \(9,\) is not allowed"):
        GaitSchedule.from_codes([0] * 10, [0] * 9)
    with pytest.raises(ValueError, match=r"^f: nan is not allowed; give finite numbers$"):
        GaitSchedule.from_codes([math.nan] * 10, [0] * 10)
    with pytest.raises(ValueError, match=r"^f: 'many' is not allowed"):
        GaitSchedule.from_codes("many", [0] * 10)
    with pytest.raises(ValueError, match=r"^columns: 0 is not allowed"):
        GaitSchedule.from_codes([0] * 10, [0] * 10, columns=0)


@pytest.mark.parametrize("text", ["", "10/10", "12/" * 9 + "10", "10/" * 9 + "1", "/" * 9])
def test_bad_text_is_refused(text):
    with pytest.raises(ValueError, match=r"^schedule: .* is not allowed"):
        GaitSchedule.from_text(text)
