"""The program that finds gaits which climb: kinds, halving, rungs left behind, and that it goes on."""

import dataclasses
import json

import numpy as np
import pytest
from graded import retabled, settling, tabled
from hill import Hill, strides
from hypothesis import given
from hypothesis import strategies as st

from optim.experiments.data import Data
from optim.runs.generation import Generation
from optim.runs.history import History
from optim.studies.beyond.gait_hunt import climb
from optim.studies.beyond.gait_hunt.program import (
    APART,
    GRADED,
    RUNGS,
    Plan,
    Program,
    Step,
    best_of_kinds,
    difference,
    heading_of,
)
from robots.inflatable import INCHING, NAMED_GEOMETRIES, ROLLING, sideways, simulation
from robots.inflatable.design import InflatableDesign, load_design
from robots.inflatable.simulation import simulate
from robots.inflatable.timing import gait_steps
from robots.world import Terrain

BODY = NAMED_GEOMETRIES["published"]
PLAN = Plan(
    looks=6, kept=4, kinds=3, population=4, rounds=(1, 2), leads=(0.0, 2 / 3), headings=3, refined=4, generations=1
)
FEW = climb.Climb((0,), PLAN, finalists=2, runs=2)


class Slopes(Hill):
    """Stands in for the simulator: the less of the core is full and the more the top moves, the steeper it climbs."""

    def __call__(self, designs, terrain=None, **options):
        found = super().__call__(designs, terrain, **options)
        way = np.deg2rad(80.0)
        found.displacement = strides(designs, 4)[:, None] * [np.cos(way), np.sin(way)]
        return found

    def speeds(self, designs, terrain, actuation):
        heavy = np.array([design.pressure for design in designs]) / 12e3 + terrain.slope / 15
        away = np.abs(np.array([design.orientation for design in designs]) - 80) / 80
        return 0.1 * strides(designs, 4) - 0.05 * (heavy + away)


@pytest.fixture
def slopes(monkeypatch):
    stand_in = Slopes()
    monkeypatch.setattr(simulation, "simulate", stand_in)
    return stand_in


def cycle(levels, pressure=0.0, orientation=90.0) -> InflatableDesign:
    table = np.asarray(levels, float)
    gait = tabled(table, np.array([[0.0, 1.0], [1.0, 0.0]]), 2, None, np.full(2, 100), np.zeros(2))
    return InflatableDesign(pressure, orientation, gait)


def cycle_of_quick_strokes(orientation) -> InflatableDesign:
    """A gait of few steps."""
    levels = np.zeros((10, 2))
    levels[:4, 0], levels[8, 1], levels[9, 0] = 0.05, 1.0, 1.0
    return InflatableDesign(0.0, orientation, settling(levels, [50, 50]))


def test_a_kind_is_what_moves_when():
    """Not where the cycle begins, nor the heading, but the core's shape."""
    assert difference(INCHING, INCHING, BODY) == 0.0
    assert difference(INCHING, ROLLING, BODY) > APART
    top = np.zeros((8, 2))
    top[:4, 0] = 1.0
    later = retabled(cycle(top[:, ::-1]).schedule, grip=np.array([[1.0, 0.0], [0.0, 1.0]]))
    assert difference(cycle(top), InflatableDesign(0.0, 20.0, later), BODY) == 0.0
    assert difference(cycle(top), cycle(top, 6000.0), BODY) == 0.5
    half = np.zeros((8, 2))
    half[:4, 0] = 0.5
    assert difference(cycle(top), cycle(half), BODY) == pytest.approx(0.5 * np.sqrt(4 / 20))


@given(st.integers(0, 10_000), st.integers(1, 6))
def test_kinds_lie_apart_and_the_best_is_one(seed, count):
    generator = np.random.default_rng(seed)
    designs = [cycle(generator.random((8, 2)) * generator.integers(0, 2)) for _ in range(12)]
    scores = np.where(generator.random(12) < 0.2, np.nan, generator.normal(size=12))
    chosen = best_of_kinds(designs, scores, count, BODY)
    assert len(chosen) <= count and np.isfinite(scores[chosen]).all()
    assert (np.diff(scores[chosen]) <= 0).all()
    if np.isfinite(scores).any():
        assert scores[chosen[0]] == np.nanmax(scores)
    if len(chosen) < count:  # all others are of the kind of one of them
        rest = [n for n in range(12) if np.isfinite(scores[n]) and n not in chosen]
        assert all(min(difference(designs[n], designs[one], BODY) for one in chosen) < APART for n in rest)
    for place, one in enumerate(chosen):
        assert all(difference(designs[one], designs[other], BODY) >= APART for other in chosen[:place])


@given(st.floats(-180.0, 180.0))
def test_robots_are_turned_to_where_they_get_furthest(angle):
    way = np.deg2rad(angle)
    headings = np.deg2rad(np.linspace(0.0, 90.0, 901))
    found = np.deg2rad(heading_of(np.array([np.cos(way), np.sin(way)])))
    assert 0.0 <= found <= np.pi / 2 + 1e-12
    assert np.cos(way - found) >= np.cos(way - headings).max() - 1e-12


@pytest.mark.kernels
def test_on_flat_ground_the_heading_changes_no_way():
    """Why a look tells the best heading."""
    headings = [0.0, 45.0, 90.0]
    found = simulate([cycle_of_quick_strokes(heading) for heading in headings], geometry=NAMED_GEOMETRIES["small"])
    np.testing.assert_allclose(found.displacement, found.displacement[[0, 0, 0]], rtol=1e-6)  # but for rounding
    ways = np.deg2rad(headings)
    along = found.displacement @ np.array([np.cos(ways), np.sin(ways)])
    np.testing.assert_allclose(found.distance, np.diagonal(along), atol=1e-15)
    left = sideways(found.displacement, headings)
    np.testing.assert_allclose(found.distance**2 + left**2, (found.displacement**2).sum(axis=1), rtol=1e-12)
    assert left[0] == pytest.approx(found.displacement[0, 1]) and left[2] == pytest.approx(-found.displacement[2, 0])


def test_all_of_the_ladder_has_the_friction_of_the_ground(tmp_path):
    made = Program(tmp_path, PLAN, 0, 15.0, ground=Terrain(0.0, 0.7, 0.56))._on(RUNGS, GRADED)
    assert made.terrains == tuple(Terrain(slope, 0.7, 0.56) for slope in (0.0, 5.0, 10.0, 15.0))
    assert Program(tmp_path, PLAN, 0, 15.0)._on(RUNGS, GRADED).terrains[0] == Terrain()


@pytest.mark.long
def test_the_program_halves_kinds_and_leads_the_best_uphill(slopes, tmp_path):
    program = Program(tmp_path / "run", PLAN, 0, 15.0)
    facing, finish, firm = program.run()
    steps = program.steps
    assert (facing, finish, firm) == (steps["heading"], steps["finish"], steps["firm"])
    assert list(steps)[:3] == ["look-empty", "look-any", "turn"] and list(steps)[-3:] == ["heading", "finish", "firm"]
    assert {"kind-1", "kind-2", "kind-3", "lead-1", "lead-2"} <= set(steps)
    kinds = [steps[f"kind-{k}"] for k in (1, 2, 3)]
    lengths = [len(kind.history.generations) for kind in kinds]
    assert sorted(lengths) == [2, 4, 4]  # one was left after the first round, two went on
    early = [kind.history.generations[1].best for kind in kinds]
    assert lengths[int(np.argmin(early))] == 2
    assert steps["look-empty"].problem.pressure == 0.0 and steps["look-any"].problem.pressure is None
    assert steps["turn"].design.orientation == pytest.approx(80.0) and steps["turn"].last.evaluations == 4 * PLAN.kept
    assert steps["heading"].problem.free == ("orientation",)
    assert [t.name for t in finish.problem.terrains] == ["hill:15"]
    assert finish.score >= steps["lead-2"].last.best_details["speed_hill:15"]
    assert "speed_hill:15_hard" not in finish.last.best_details
    details = firm.last.best_details
    assert firm.score == pytest.approx(np.mean([details["speed_hill:15"], details["speed_hill:15_hard"]]))
    assert firm.history.config["method"]["start"] == firm.problem.start_values(finish.design)
    assert sum(step.last.evaluations for step in program.steps.values()) == PLAN.evaluations
    near = [step.history.config["method"]["seed"] for name, step in steps.items() if name[:4] in ("kind", "lead")]
    assert len(near) == len(set(near)) == 5


@pytest.mark.long
def test_leads_go_by_the_mean_of_a_slope_and_the_steepest_one_from_the_others_best(slopes, tmp_path):
    program = Program(tmp_path / "run", PLAN, 0, 15.0)
    program.run()
    first, second = program.steps["lead-1"], program.steps["lead-2"]
    assert [[t.slope for t in step.problem.terrains] for step in (first, second)] == [[0.0, 15.0], [10.0, 15.0]]
    for step in (first, second):
        assert not step.problem.ladder and set(step.speeds) == {t.name for t in step.problem.terrains}
        assert step.score == pytest.approx(np.mean(list(step.speeds.values())))
    assert second.history.config["method"]["start"] == second.problem.start_values(first.design)


def test_speeds_of_a_step_are_of_the_slopes_on_which_its_best_was_tried(tmp_path):
    """Also downhill, where all count; on a ladder not beyond the slope that it does not climb."""

    def step(ladder: bool) -> Step:
        problem = dataclasses.replace(Program(tmp_path, PLAN, 0, 15.0)._on(RUNGS, GRADED), ladder=ladder)
        details = dict(
            zip(("speed_flat", "speed_hill:5", "speed_hill:10", "speed_hill:15"), (0.03, 0.01, 0.0, -0.01), strict=True)
        )
        last = Generation(0, 1, 0, 0.0, 0.0, 0.0, None, problem.space.to_dict(problem.space.low), details, {})
        return Step("kind-1", problem, History(tmp_path, {}, (last,), (1.0,), None, False), 1.0)

    assert step(ladder=True).speeds == {"flat": 0.03, "hill:5": 0.01}
    assert list(step(ladder=False).speeds.values()) == [0.03, 0.01, 0.0, -0.01]


def test_a_seed_with_which_every_gait_fails_ends_as_such(slopes, tmp_path, monkeypatch):
    def lost(designs, *given, **options):
        found = slopes(designs, *given, **options)
        found.status[:], found.speed[:], found.stages[:] = "diverged", np.nan, np.nan
        return found

    monkeypatch.setattr(simulation, "simulate", lost)
    climb.study(tmp_path / "lost", FEW)
    (row,) = json.loads((tmp_path / "lost/summary.json").read_text())["seeds"]
    assert row["speed"] is None and row["found_by"] is None and not row["stays"] and row["robot_steps"] > 0
    assert not list((tmp_path / "lost/gaits").iterdir())


@pytest.mark.long
def test_a_study_of_the_program_goes_on_to_the_same_tables(slopes, tmp_path):
    seen = []
    climb.study(tmp_path / "whole", FEW, seen.append)
    assert seen == sorted(seen) and seen[-1] == 1.0
    known = {name: (tmp_path / "whole" / name).read_bytes() for name in ("steps.csv", "table.md")}
    row = json.loads((tmp_path / "whole" / "summary.json").read_text())["seeds"][0]
    design = load_design(tmp_path / "whole" / "gaits" / "seed-0.json")
    last = ("heading", "finish", "firm")
    kept = [json.loads((tmp_path / "whole" / "runs" / f"seed-0-{step}.json").read_text()) for step in last]
    fastest = [max(np.mean(speeds) for speeds, _ in one["speeds"]) for one in kept]  # all stay
    assert row["speed"] == max(fastest) and row["found_by"] == last[int(np.argmax(fastest))]
    assert design.orientation == row["orientation"] and gait_steps(design.schedule) <= 186_719
    assert (tmp_path / "whole" / "climb.png").stat().st_size > 1000
    calls = slopes.calls
    climb.study(tmp_path / "whole", FEW)
    assert slopes.calls == calls  # all is kept, and halving decides as it did
    assert known == {name: (tmp_path / "whole" / name).read_bytes() for name in known}
    (tmp_path / "told").mkdir()
    climb.rewrite(Data(tmp_path / "whole"), tmp_path / "told")
    assert slopes.calls == calls  # made from the tables alone
    for name in ("summary.json", "table.md"):
        assert (tmp_path / "told" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


@pytest.mark.long
def test_a_program_that_was_killed_goes_on_to_the_same_gait(slopes, tmp_path, monkeypatch):
    climb.study(tmp_path / "whole", FEW)
    whole = slopes.calls

    def killed(*given, **options):
        if slopes.calls > whole // 2:
            raise KeyboardInterrupt
        return slopes(*given, **options)

    slopes.calls = 0
    with monkeypatch.context() as patch:
        patch.setattr(simulation, "simulate", killed)
        with pytest.raises(KeyboardInterrupt):
            climb.study(tmp_path / "parts", FEW)
    climb.study(tmp_path / "parts", FEW)
    for name in ("steps.csv", "table.md", "gaits/seed-0.json"):
        assert (tmp_path / "parts" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_a_folder_of_something_else_is_refused(tmp_path):
    (tmp_path / "letter.txt").write_text("hello")
    with pytest.raises(ValueError, match=r"^out: .* holds something else; name a new folder$"):
        climb.study(tmp_path, climb.STUDY.scales["small"])
