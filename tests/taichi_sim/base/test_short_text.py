"""Texts of what holds arrays: short, and telling their shapes."""

from dataclasses import dataclass

import numpy as np

import morpholab as ml
from robots.robot import Robot
from taichi_sim.base.short_text import ShortText


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


def test_robots_that_are_no_dataclasses_have_texts_too():
    class Own(Robot):
        kind = "vehicle"

    assert "Own object" in repr(Own())
