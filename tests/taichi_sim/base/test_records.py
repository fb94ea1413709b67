"""Records that are read back are what their types say, or the field that is not is named."""

from dataclasses import dataclass

import pytest

from taichi_sim.base.records import checked


@dataclass(frozen=True)
class Line:
    number: int
    score: float | None
    details: dict[str, float]
    scores: list[float]
    note: str = ""


GOOD = {"number": 1, "score": None, "details": {"a": 1}, "scores": [1, 0.5]}


def test_what_fits_is_taken():
    assert checked(Line, GOOD) == Line(1, None, {"a": 1}, [1, 0.5])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"number": True}, "number: True is not allowed; it must be a whole number"),
        ({"score": float("nan")}, "score: nan is not allowed; it must be a finite number or null"),
        ({"score": 10**400}, "score: 1"),
        ({"details": {"a": "b"}}, r"details: .* it must be a table, each a finite number"),
        ({"scores": 3}, "scores: 3 is not allowed; it must be a list, each a finite number"),
        ({"other": 3}, "'other' is unknown; fields are number, score, details, scores, note"),
    ],
)
def test_the_field_that_does_not_fit_is_named(change, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        checked(Line, GOOD | change)


def test_a_missing_field_and_what_is_no_record_are_named():
    with pytest.raises(ValueError, match=r"^number is missing$"):
        checked(Line, {name: value for name, value in GOOD.items() if name != "number"})
    with pytest.raises(ValueError, match=r"^\[\] is not allowed; it must be a record$"):
        checked(Line, [])
