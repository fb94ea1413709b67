"""Names and patterns by which users choose among what has a name."""

import pytest

from taichi_sim.base.names import choices_of, joined, matching


def test_what_is_spelled_so_goes_before_patterns():
    names = ["leg[1]", "leg1", "leg2"]
    assert (
        matching("leg[1]", names) == [0] and matching("leg[12]", names) == [1, 2] and matching("*", names) == [0, 1, 2]
    )
    assert matching("arm", names) == []


def test_each_name_has_one_choice_at_most():
    assert choices_of("sizes", "body", ["a1", "", "b", "a2"], ["a*", "b"]) == [0, -1, 1, 0]
    assert choices_of("sizes", "body", ["a"], []) == [-1]
    for patterns, message in (
        (["c"], "sizes: 'c' is no body; give one of a, b, or a pattern of them"),
        (["a", "*"], "sizes: 'a' and '*' are both a; give each body once"),
    ):
        with pytest.raises(ValueError) as told:
            choices_of("sizes", "body", ["a", "b", ""], patterns)
        assert str(told.value) == message
    with pytest.raises(ValueError, match=r"^sizes: 'a' is no body; the robot has none$"):
        choices_of("sizes", "body", [""], ["a"])


def test_values_that_are_given_one_by_one_are_joined():
    assert joined("sizes", [{"a": 1.0}, {"b": 2.0}]) == {"a": 1.0, "b": 2.0}
    with pytest.raises(ValueError, match=r"^sizes: 'a' is given twice; give each name once$"):
        joined("sizes", [{"a": 1.0}, {"a": 1.0}])
    with pytest.raises(ValueError, match=r"^sizes: 0\.5 is not allowed; give values by names$"):
        joined("sizes", [0.5])
