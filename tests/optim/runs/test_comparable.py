"""Which runs are set side by side, and what is told of their trials."""

import json
import warnings
from pathlib import Path
from types import SimpleNamespace

import pytest

from optim.runs.comparable import check_comparable


def run(name: str, kind: str = "articulated", worlds: str = "flat", **robot):
    return SimpleNamespace(
        path=Path(name), config={"problem": {"kind": kind, "robot": json.dumps(robot), "worlds": [worlds]}}
    )


@pytest.mark.parametrize(
    ("kind", "one", "other", "told"),
    [
        (
            "articulated",
            {"duration": 2.0, "slip": None},
            {"duration": 1.0, "slip": 0.01},
            r"duration \(2.0, 1.0\), slip \(usual, 0.01",
        ),
        ("lattice", {"cycles": 2, "heading": 0.0}, {"cycles": 2, "heading": 90.0}, r"heading \(0.0, 90.0\)"),
        ("freeform", {"actuation": {"cycles": 2}}, {"actuation": {"cycles": 3}}, r"cycles \(2, 3\)"),
        ("walker", {"actuation": {"cycles": 2}}, {"actuation": {"cycles": 3}}, r"cycles \(2, 3\)"),
    ],
)
def test_robots_that_were_tried_otherwise_are_told(kind, one, other, told):
    with pytest.warns(UserWarning, match=rf"^the runs differ in {told}.*: their scores may not mean the same$"):
        check_comparable([run("a", kind, **one), run("b", kind, **other)])


def test_other_bodies_are_no_matter():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_comparable([run("a", duration=2.0, model="light"), run("b", duration=2.0, model="heavy")])


def test_level_ground_of_earlier_versions_is_that_of_today():
    check_comparable([run("a"), run("b", worlds="ground")])


def test_trials_of_what_is_held_are_told():
    held = SimpleNamespace(path=Path("b"), config=json.loads(json.dumps(run("b", duration=1.0).config)))
    inner = json.loads(held.config["problem"]["robot"])
    held.config["problem"]["robot"] = json.dumps({"robot": inner, "held": {"front_size": 2.0}})
    with pytest.warns(UserWarning, match=r"^the runs differ in duration \(2.0, 1.0\)"):
        check_comparable([run("a", duration=2.0), held])


def test_other_worlds_are_refused():
    with pytest.raises(ValueError, match=r"^run: a and b are judged differently"):
        check_comparable([run("a"), run("b", worlds="hill:5")])
