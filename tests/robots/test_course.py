"""Courses of stretches of different ground."""

import numpy as np
import pytest

from robots.course import KINDS, LONGEST, RIDGE, SHORTEST, Course
from robots.ground import Ground
from robots.world import Terrain
from taichi_sim.ground.relief import ground_tables

COURSES = [Course(seed, 0.3, 10.0, 0.006, 0.1) for seed in range(20)]


def test_stretches_are_drawn_from_the_seed():
    """Every second one is level, all are about as long as said, and the other kinds are met alike."""
    for course in COURSES:
        lengths = np.diff(np.append(0.0, course.ends))
        assert not course.kinds[::2].any() and course.kinds[1::2].all() and course.ends[-1] >= 4
        assert lengths.min() >= SHORTEST * 0.3 - RIDGE / 2 and lengths.max() <= LONGEST * 0.3 + RIDGE / 2
    kinds = np.concatenate([course.kinds[1::2] for course in COURSES])
    assert np.allclose(np.bincount(kinds)[1:] / len(kinds), 1 / 3, atol=0.1)
    assert np.array_equal(COURSES[3].kinds, Course(3.0, 0.3, 20.0, 0.0, 1.0).kinds)
    assert len({tuple(course.kinds[:8]) for course in COURSES}) > 15


def test_each_kind_is_what_it_says():
    """Slopes rise by their angle, ridges begin and end at the ground, and only slippery ground is; no steps between."""
    x = np.linspace(-0.5, 4.0, 45_001)
    for course in COURSES[:4]:
        height, friction, kind = course.height(x), course.friction(x), course.kind(x)
        assert np.abs(np.diff(height)).max() < 1e-4 and not height[x < 0].any()
        rise = np.diff(height) / np.diff(x)
        inside = kind[1:] == kind[:-1]
        assert np.allclose(rise[inside & (kind[1:] == KINDS.index("slope"))], np.tan(np.radians(10)))
        for name in ("level", "slippery"):
            assert np.allclose(rise[inside & (kind[1:] == KINDS.index(name))], 0.0)
        ridges = kind == KINDS.index("ridges")
        if ridges.any():
            assert np.ptp(height[course.stretch(x) == course.stretch(x[ridges][:1])]) == pytest.approx(0.006, rel=1e-3)
        assert set(friction[kind == KINDS.index("slippery")]) <= {0.1} and set(friction[kind == 0]) == {1.0}


def test_a_course_is_a_ground_by_name():
    """With heights and friction at once; numbers that are left out are as usual."""
    relief, course = Ground("course:5,0.3,10,0.006,0.1").relief(0, 0.01), Course(5, 0.3, 10, 0.006, 0.1)
    x = relief.origin[0] + 0.005 * np.arange(0, 1000, 7)
    assert np.allclose(relief.height(x, 0.2), course.height(x), atol=1e-9)
    assert np.allclose(relief.factor(x, 0.2), course.friction(x))
    assert Terrain.parse("hill:2+course:5").name == "hill:2+course:5"
    assert "slippery" in Terrain.parse("course:5").spoken


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("course", "'course' lacks SEED; give course:SEED[,LENGTH][,DEGREES][,RIDGE][,FACTOR]"),
        ("course:1.5", "SEED 1.5 of 'course:1.5' is not allowed; give a whole number"),
        ("course:1,0", "LENGTH 0 of 'course:1,0' is not allowed; give at least 0.0001"),
        ("course:1,0.2,10,-1", "RIDGE -1 of 'course:1,0.2,10,-1' is not allowed; give at least 0"),
        ("course:1,0.2,10,0,0,0", "at most 5 numbers"),
    ],
)
def test_bad_input(text, message):
    """One line."""
    with pytest.raises(ValueError) as refused:
        Terrain.parse(text)
    assert message in str(refused.value) and "\n" not in str(refused.value)


def test_what_is_too_steep_is_refused():
    """As of any ground."""
    with pytest.raises(ValueError, match=r"DEGREES 85 of .* is not allowed; give at most 80"):
        Ground("course:1,0.2,85").relief(0, 0.01)


def test_the_table_of_a_ground_is_converted_once():
    """However often a run begins; in double precision it is the table itself."""
    tables = ground_tables("floor", [Ground("course:1").relief(0, 0.05)])
    assert tables.numbers(np.float32) is tables.numbers(np.float32) and tables.numbers(np.float64) is tables.relief
    assert np.array_equal(tables.numbers(np.float32), tables.relief.astype(np.float32))
