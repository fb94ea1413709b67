"""A run whose robot was designed in several worlds: commands try the first and name the others, or judge all."""

import json
import re

import pytest
from articulated_files import CRAWLER

pytestmark = pytest.mark.kernels
SEARCH = "codesign --robot crawler.xml --duration 0.3 --method random --climbers 2 --generations 1 --quiet --out run"


@pytest.fixture
def run(tmp_path, morpholab):
    """A short search on level ground and on a slope."""
    (tmp_path / "crawler.xml").write_text(CRAWLER)
    code, _, error = morpholab(f"{SEARCH} --terrain flat --terrain hill:5")
    assert code == 0, error
    return tmp_path / "run"


def test_one_is_tried_and_the_others_are_named(run, morpholab):
    code, out, error = morpholab("simulate --robot run")
    assert code == 0 and out.startswith("run on flat: ok")
    assert "note: its run has hill:5, too: --world tries another" in error
    code, out, error = morpholab("simulate --robot run --terrain hill:5")
    assert code == 0 and out.startswith("run on hill:5: ok") and "its run has" not in error
    assert "its run has" not in morpholab("simulate --robot crawler.xml --duration 0.3")[2]


def test_all_are_judged(run, morpholab):
    code, out, _ = morpholab("simulate --robot run --judge --quiet")
    assert code in (0, 1) and re.findall(r"^run on (\S+):", out, re.M) == ["flat", "hill:5"]
    told = json.loads(morpholab("simulate --robot run --judge --quiet --json")[1])
    assert [each["world"] for each in told["worlds"]] == ["flat", "hill:5"]
    alone = json.loads(morpholab("simulate --robot run --judge --quiet --json --terrain hill:5")[1])
    assert alone == told["worlds"][1]


def test_a_design_is_tried_otherwise(run, morpholab):
    steps = []
    for options in ("", "--time-step 0.005", "--duration 0.6"):
        told = json.loads(morpholab(f"simulate --robot run {options} --quiet --json")[1])
        steps.append(told["steps"])
    assert steps == [30, 60, 60]
    slippery = json.loads(morpholab("simulate --robot run/best.json --friction 0.01 --quiet --json")[1])
    usual = json.loads(morpholab("simulate --robot run/best.json --quiet --json")[1])
    assert slippery["distance"] != usual["distance"]
    code, _, error = morpholab("simulate --robot run --slowest 1")
    assert code == 2 and "slowest: crawler has its own; leave it out" in error


def test_a_report_names_all(run, morpholab):
    assert morpholab("report run --out page.html --no-player --quiet")[0] == 0
    assert "<title>run: crawler, on flat ground and up a slope of 5°" in (run.parent / "page.html").read_text()


def test_a_world_that_is_given_twice_is_refused(run, morpholab):
    code, _, error = morpholab("simulate --robot run --terrain flat --terrain hill:5")
    assert code == 2 and error.endswith(
        "argument --terrain: it is given twice, and the command takes one; give it once\n"
    )
