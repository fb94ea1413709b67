"""A task for the pipeline, on a tiny robot, that is decided in seconds."""

import numpy as np
from graded import TINY, settling

from optim.pipeline import run as pipeline_run
from optim.pipeline import task as pipeline_task
from optim.pipeline.plans import Plan
from optim.pipeline.task import read_task
from robots.inflatable import NAMED_GEOMETRIES, transition
from robots.inflatable.design import InflatableDesign, save_design

RIG = """
name = "quick"
[channels.core]
rise_s = 0.2
fall_s = 0.1
slew_kpa_per_s = 1000.0
"""
TASK = """
terrains = ["flat", "hill:5"]
gaits = ["round.json", "flat.json"]
geometry = "small"
precision = "f32"
runs = 2
rig = "rig.toml"
[limits]
least_speed = 1e-12
moved = 10.0
shape_error = 0.05
next_speed = 0.0
"""
# More of a task: searches, whose gaits take too many steps for what comes after them.
SEARCHES = """
most_steps = 5000
[search]
method = "hill-climb"
climbers = 2
generations = 2
encoding = "graded"
columns = 2
steps = 500
"""


def write_task(folder, more=""):
    """Write a task whose fastest plan changes shape, whatever small strokes come to, and return its path."""
    levels = np.zeros((10, 2))
    levels[:4, 0], levels[8:, 0] = 0.05, 1.0
    for name, pressure in (("round", 400.0), ("flat", 0.0)):
        save_design(InflatableDesign(pressure, 90.0, settling(levels, [50, 50], 2)), folder / f"{name}.json")
    (folder / "rig.toml").write_text(RIG)
    (folder / "task.toml").write_text(TASK + more)
    return folder / "task.toml"


def task_of(folder, text):
    """Read a task from a file with this text."""
    path = folder / "task.toml"
    path.write_text(text)
    return read_task(path)


def decided(monkeypatch):
    """The plan, and a single way to change shape that takes a moment."""
    monkeypatch.setitem(NAMED_GEOMETRIES, "small", TINY)
    monkeypatch.setattr(pipeline_run, "rank_plans", lambda *_: [Plan(("round", "flat"), 0.1)])
    monkeypatch.setattr(pipeline_run, "check_working", lambda *_: None)
    monkeypatch.setattr(pipeline_task, "WAYS", pipeline_task.WAYS[:1])
    monkeypatch.setattr(transition, "SETTLING_TIME", 0.05)
    monkeypatch.setattr(transition, "full_stroke_steps", lambda actuation: 400)
