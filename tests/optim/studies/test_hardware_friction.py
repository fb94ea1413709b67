"""The study of measured speeds: conditions, sets of parameters, factors, and what its page tells."""

import csv
import math
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from optim import cli
from optim.experiments.data import Data
from optim.experiments.tables import write_records
from optim.studies.chapter5 import hardware_friction
from optim.studies.chapter5.gaits import GaitRuns
from optim.studies.chapter5.hardware_friction import HardwareFriction
from optim.studies.chapter5.hardware_speeds import (
    MEASURED,
    MEASURED_FEET,
    SIMULATOR,
    effects_of,
    rows_of,
    sets_of,
    verdict,
)
from robots.calibration import load_calibration, read_measurements
from robots.inflatable.kind import load_gait

DOCS = Path(__file__).parents[3] / "docs"
FEW = HardwareFriction(GaitRuns(precision="f32", copies=2), inflations=(0.5, 1.0), pressures=(8e3, 12e3), rigs=())


def copies_of(ratios, **parameters):
    """Two copies of each condition, near so many times the measured speed."""
    usual = {"weight": "physical", "inflation": 1.0, "timing": SIMULATOR, "ground": MEASURED_FEET}
    about = {**usual, **parameters}
    return [
        {
            **about,
            "condition": measured.name,
            "pressure": about.get("pressure", 12e3) if measured.gait.pressure else 0.0,
            "measured": measured.speed,
            "speed": ratio * measured.speed * nearly,
        }
        for measured, ratio in zip(MEASURED, ratios, strict=True)
        for nearly in (0.99, 1.01)
    ]


def test_the_measured_conditions_are_simulated_on_their_floors_for_all_parameters(simulator, tmp_path):
    summary = hardware_friction.study(tmp_path / "a", FEW)
    assert len(simulator.calls) == 4  # weights times strokes, all conditions beside each other
    drives = [(call.actuation.weight, round(call.actuation.inflated, 9)) for call in simulator.calls]
    assert drives == [("published", 1.35), ("published", 2.5), ("physical", 1.35), ("physical", 2.5)]
    played = simulator.calls[0]
    feet = [(terrain.slope, terrain.low_friction, terrain.high_friction) for terrain in played.terrain[::2]]
    assert feet == [(0, 0.56, 0.7), (0, 0.38, 0.51), (0, 0.56, 0.7), (0, 0.56, 0.7), (14, 0.56, 0.7)]
    assert [design.pressure for design in played.designs[::2]] == [0, 0, 8e3, 12e3, 0]
    assert len(summary["rows"]) == 4 * 5 and len(summary["sets"]) == 4 * 2
    for name in hardware_friction.STUDY.writes:
        assert (tmp_path / "a" / name).stat().st_size > 100, name
    with open(tmp_path / "a/copies.csv") as file:
        copies = list(csv.DictReader(file))
    assert len(copies) == 4 * 5 * 2 and {row["copy"] for row in copies} == {"0", "1"}
    simulator.calls.clear()
    assert hardware_friction.study(tmp_path / "a", FEW) == summary and not simulator.calls


def test_rigs_play_the_gaits_as_tables_of_as_many_cycles(simulator, tmp_path, monkeypatch):
    calls = []

    def play_tables(plays, **settings):
        calls.append((plays, settings["actuation"].weight))
        return SimpleNamespace(speed_simulated=[0.01 + 0.001 * play.copy for play in plays])

    monkeypatch.setattr("robots.hardware.rig_play.play_tables", play_tables)
    rigs = ("dissertation", "dissertation-lag")
    summary = hardware_friction.study(tmp_path / "a", replace(FEW, rigs=rigs))
    assert [weight for _, weight in calls] == ["published", "physical"]
    plays = calls[0][0]
    assert len(plays) == 2 * 4 * 2 and [play.copy for play in plays[:2]] == [0, 1]
    assert [play.rig.name for play in plays[::8]] == list(rigs) and {play.table.loops for play in plays} == {1}
    assert [(play.terrain.slope, play.terrain.low_friction) for play in plays[:8:2]] == [
        *((0, 0.56), (0, 0.38), (0, 0.56)),
        (14, 0.56),
    ]
    timings = [one["timing"] for one in summary["sets"]]
    assert {name: timings.count(name) for name in rigs} == dict.fromkeys(rigs, 2) and len(timings) == 12


def test_rows_have_means_intervals_and_ratios():
    row = rows_of(copies_of([1.2, 1.0, 1.0, 1.0]))[0]
    assert (row["condition"], row["n"]) == ("inching, wood", 2) and row["mean"] == pytest.approx(0.012)
    assert row["low"] < 0.012 < row["high"] and row["ratio"] == pytest.approx(1.2)
    lost = [{**copy, "speed": math.nan} for copy in copies_of([1.0] * 4)]
    assert [rows_of(lost)[0][name] for name in ("n", "mean", "low", "ratio")] == [0, None, None, None]


def test_the_factor_is_the_largest_on_flat_ground_and_a_stretch_of_all_times_is_taken_out():
    (one,) = sets_of(rows_of(copies_of([1.0, 4.0, 2.0, -9.0])))
    assert one["factor"] == pytest.approx(4.0)
    assert (one["stretch"], one["factor_rescaled"]) == (pytest.approx(2.0), pytest.approx(2.0))
    (backwards,) = sets_of(rows_of(copies_of([-1.0, 1.0, 1.0, 1.0])))
    assert backwards["factor"] is backwards["stretch"] is backwards["factor_rescaled"] is None


def test_sets_are_sorted_and_the_verdict_counts_those_that_agree():
    copies = copies_of([3.0, 3.0, 3.0, -1.0]) + copies_of([1.1, 1.4, 0.9, 1.0], weight="published")
    sets = sets_of(rows_of(copies + copies_of([-1.0] * 4, inflation=0.5)))
    assert [one["weight"] for one in sets] == ["published", "physical", "physical"]
    text = verdict(sets)
    assert "As simulated, 1 of 3 sets are within a factor of 1.5" in text and "is within 1.40." in text
    assert "With all times stretched alike, 2 of 3" in text and text.endswith("Up the slope 1 of 3 go forward.")
    assert "No set of parameters goes forward" in verdict(sets[2:])


def test_effects_compare_sets_that_differ_in_one_parameter():
    copies = copies_of([1.0, 1.0, 1.0, -1.0]) + copies_of([2.0, 1.0, 0.5, -1.0], inflation=0.5)
    (effect,) = effects_of(sets_of(rows_of(copies)))
    assert effect["parameter"] == "inflation" and effect["inching up 14°, wood"] is None
    assert [effect[m.name] for m in MEASURED[:3]] == pytest.approx([2.0, 1.0, 2.0])


def test_grounds_change_what_is_not_measured_of_the_floor(simulator, tmp_path):
    grounds = {MEASURED_FEET: {}, "slippery": {"low_friction": 0.1}}
    summary = hardware_friction.study(tmp_path / "a", replace(FEW, weights=("physical",), grounds=grounds))
    lows = [{terrain.low_friction for terrain in call.terrain} for call in simulator.calls]
    assert lows == [{0.56, 0.38}, {0.1}] * 2 and {one["ground"] for one in summary["sets"]} == set(grounds)


def test_the_committed_speeds_make_the_tables_of_the_docs_and_nothing_is_played(simulator, tmp_path):
    data, docs = DOCS / "data/hardware-friction", (DOCS / "hardware-speeds.md").read_text()
    shutil.copytree(data, tmp_path / "a")
    summary = hardware_friction.study(tmp_path / "a", hardware_friction.STUDY.scales["medium"])
    assert not simulator.calls and summary["best"]["factor"] < 1.5
    told = (tmp_path / "a/hardware.md").read_text().splitlines()
    assert [line for line in told if line.startswith("|") and line not in docs] == [] and verdict(
        summary["sets"]
    ) in docs
    assert (tmp_path / "a/copies.csv").read_bytes() == (data / "copies.csv").read_bytes()
    for row in summary["rows"]:  # the cost of a rig
        if row["inflation"] == 1.0 and row["pressure"] in (0.0, 12e3) and "14°" not in row["condition"]:
            assert f"{row['mean']:.4f} ({row['low']:.4f} to {row['high']:.4f})" in docs


def test_nearby_sets_of_the_docs_are_those_of_the_data(simulator, tmp_path):
    shutil.copytree(DOCS / "data/hardware-friction/near", tmp_path / "a")
    near = HardwareFriction(
        GaitRuns(precision="f32", copies=2), ("physical",), inflations=(0.8, 0.95), pressures=(10e3, 12e3), rigs=()
    )
    sets = hardware_friction.study(tmp_path / "a", near)["sets"]
    docs = (DOCS / "hardware-speeds.md").read_text()
    told = (tmp_path / "a/hardware.md").read_text().splitlines()
    lines = [line for line in told if line.startswith("| simulator | physical | feet as measured")]
    assert not simulator.calls and len(lines) == len(sets) == 4 and all(line in docs for line in lines)


def test_nearby_sets_are_told_again_from_their_table(simulator, tmp_path, capsys):
    out, data = tmp_path / "out", DOCS / "data/hardware-friction/near"
    assert cli.main(["reproduce", "hardware-friction", "--from-data", str(data), "--out", str(out)]) == 0
    told, docs = (out / "hardware.md").read_text().splitlines(), (DOCS / "hardware-speeds.md").read_text()
    lines = [line for line in told if line.startswith("| simulator | physical | feet as measured")]
    assert len(lines) == 4 and all(line in docs for line in lines) and not simulator.calls
    assert {path.name for path in out.iterdir()} == set(hardware_friction.STUDY.writes) - {"copies.csv"}


def test_tables_of_copies_of_which_nothing_can_be_told_are_refused(tmp_path):
    for copies, message in (
        (copies_of([1.0] * 4)[2:], "copies.csv: no parameters have speeds in all conditions, which are inching, wood;"),
        ([{**copies_of([1.0] * 4)[0], "measured": 0}], "copies.csv: measured: 0 is not allowed; give a positive"),
        ([{**copies_of([1.0] * 4)[0], "condition": "rolling, ice"}], "row 2 has 'rolling, ice' as condition; allowed"),
    ):
        write_records(tmp_path / "copies.csv", copies)
        with pytest.raises(ValueError) as error:
            hardware_friction.rewrite(Data(tmp_path), tmp_path / "out")
        assert message in str(error.value) and "\n" not in str(error.value)


def test_the_dissertations_calibration_is_that_of_its_measurements():
    data = DOCS / "data/hardware-friction"
    properties, geometry = load_calibration(data / "calibration.json")
    assert geometry == "published" and (properties.friction, properties.low_friction) == pytest.approx(
        (0.70, 0.56), abs=1e-3
    )
    found = read_measurements(data / "dissertation.toml", load_gait)
    assert [float(np.mean(one.values)) for one in found.experiments] == pytest.approx([0.70, 0.56])


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"weights": ("heavy",)}, "weights: 'heavy' is unknown; choose one of published, physical"),
        ({"inflations": (0.0,)}, "inflations: 0.0 is not allowed; give a number from 0.1 to 1"),
        ({"inflations": (1.0, 1.0)}, "inflations: .* is not allowed; give one or more different values"),
        ({"pressures": ()}, "pressures: .* is not allowed; give one or more different values"),
        ({"grounds": {}}, "grounds: {} is not allowed; give at least one, by its name"),
        ({"grounds": {"steep": {"slope": 3.0}}}, "grounds: 'slope' is unknown; choose one of high_friction, "),
        ({"grounds": {"odd": {"low_friction": -1.0}}}, "low_friction: -1.0 is not allowed"),
        ({"rigs": ("bench",)}, "rigs: 'bench' is unknown; choose one of dissertation, "),
        ({"pressures": (2e4,)}, "pressures: 20000.0 is not allowed; give a number from 1 to 15000 Pa"),
    ],
)
def test_bad_settings_are_one_line(setting, message):
    with pytest.raises(ValueError, match=message) as error:
        HardwareFriction(**setting)
    assert "\n" not in str(error.value)
