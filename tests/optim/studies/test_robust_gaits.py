"""Gaits for a real floor: waves, and what the study writes."""

import json
import shutil
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from optim.experiments.data import Data
from optim.experiments.tables import read_records, write_records
from optim.studies.beyond.robust_gaits import judgement, report, search, theory
from optim.studies.beyond.robust_gaits.search import best_start, starts_of, waves
from optim.studies.beyond.robust_gaits.settings import NAME, RobustGaits
from optim.studies.beyond.robust_gaits.study import study
from optim.studies.catalogue import STUDIES
from robots.inflatable.design import load_design
from taichi_sim.base.results_folder import ResultsFolder

DATA = Path(__file__).parents[3] / "docs/data/robust-gaits"


def test_waves_are_all_necklaces_once():
    """Of 8 columns with 1 to 4 full ones there are 1 + 4 + 7 + 10."""
    found = waves(4)
    assert [sum(sum(wave) == full for wave in found) for full in (1, 2, 3, 4)] == [1, 4, 7, 10]
    turned = {min(wave[i:] + wave[:i] for i in range(8)) for wave in found}
    assert len(turned) == len(found) == 22


def test_settings_are_checked():
    """In one line."""
    for bad, message in (
        ({"slopes": ()}, "slopes: "),
        ({"slopes": (0.0, 0.0)}, "slopes: "),
        ({"floor": "ice"}, "floor: 'ice'"),
        ({"most_full": 9}, "most_full: 9"),
        ({"friction": (0.7, 0.5)}, "friction: 0.7 of sliding feet is not allowed"),
    ):
        with pytest.raises(ValueError, match="^" + message):
            RobustGaits(**bad)


def test_the_floor_is_one_of_the_settings(morpholab, monkeypatch, tmp_path):
    """Named or by its friction; a folder goes on on its own floor only, and one of before is on wood."""
    seen: list[RobustGaits] = []

    def opened(folder, settings, progress, **options):
        seen.append(settings)
        ResultsFolder(folder, NAME, settings.describe())

    monkeypatch.setitem(STUDIES._loaded, NAME, replace(STUDIES[NAME], run=opened))
    run = f"reproduce {NAME} --quiet --out"
    for folder, floor in (
        ("wood", ""),
        ("wood", "--floor wood"),
        ("acrylic", "--floor acrylic"),
        ("acrylic", "--friction 0.38,0.51"),
        ("own", "--friction 0.3,0.5"),
    ):
        code, _, error = morpholab(f"{run} {folder} {floor}")
        assert (code, error) == (0, ""), error
    pairs = [(each.terrain(9.0).low_friction, each.terrain(9.0).high_friction) for each in seen]
    assert pairs == [(0.56, 0.7), (0.56, 0.7), (0.38, 0.51), (0.38, 0.51), (0.3, 0.5)]
    assert all(
        each.problem(9.0, robust, 1).terrains == (each.terrain(9.0),) for each in seen for robust in (False, True)
    )
    for folder, floor, message in (
        ("wood", "--floor acrylic", 'wood holds robust-gaits of other settings (floor: "wood", not "acrylic")'),
        ("acrylic", "", 'acrylic holds robust-gaits of other settings (floor: "acrylic", not "wood")'),
        ("own", "", "own holds robust-gaits of other settings"),
        ("new", "--floor ice", "floor: 'ice' is unknown"),
    ):
        code, _, error = morpholab(f"{run} {folder} {floor}")
        assert code == 2 and message in error and error.count("\n") == 1, error


def test_folders_of_before_go_on():
    """To the letter: settings that they do not know are described only where they are set."""
    text = json.dumps(STUDIES[NAME].scales["medium"].describe())
    assert sha256(text.encode()).hexdigest()[:16] == "50623be677f1be26"
    assert RobustGaits(friction=(0.56, 0.7)).describe() == RobustGaits().describe()
    own = RobustGaits(friction=(0.3, 0.5)).describe()
    assert own.keys() - RobustGaits().describe().keys() == {"friction"} and "floor" not in own


def test_searches_keep_to_as_many_full_bladders_as_waves_if_asked():
    """Of waves and of the flat body; not by default, and it is one of the settings."""
    free, capped = RobustGaits(), RobustGaits(most_full=2, capped=True)
    for rolls in (True, False):
        for robust in (True, False):
            assert free.problem(0.0, robust, 1, rolls).most_full is None
            assert capped.problem(0.0, robust, 1, rolls).most_full == 2
    assert capped.describe() == {**free.describe(), "most_full": 2, "capped": True}
    problem, full = capped.problem(9.0, True, 1), load_design(DATA / "gaits/robust-0.json")
    wave = {"levels": "00000011", "shift": 1, "settling": 0.0}
    starts = starts_of(problem, RobustGaits(begins=1), wave, [full])
    first, led = (problem.design(problem.space.from_dict(start)) for start in starts)
    assert set(first.schedule.inflation.ravel()) == {0.0, 1.0}  # a screened wave is within it as it is
    assert full.schedule.inflation.sum(axis=0).max() > 4
    assert led.schedule.inflation.sum(axis=0) == pytest.approx(np.full(8, 2.0))
    assert problem.start_values(led).keys() == starts[1].keys()  # which is still a wave


def test_the_page_names_the_floor():
    """A named one by its name, another by its friction."""
    rows = [{"n": 4, "gait": "robust 0°", "precision": "f64", "nominal": None, "mean": None, "worst": None}]
    rows[0] |= {"forward": 1.0, "full": None}
    for settings, told in (
        (RobustGaits(floor="acrylic"), "Speeds on acrylic with bladders"),
        (
            RobustGaits(friction=(0.3, 0.5)),
            "Speeds on a floor of friction 0.3 of sliding and 0.5 of gripping feet with",
        ),
    ):
        assert report.text_of(settings.describe(), rows, [], []).startswith(told)
    for capped, told in ((True, "of levels, at most; searches kept to 2."), (False, "of levels, at most.")):
        assert told in report.text_of(RobustGaits(most_full=2, capped=capped).describe(), rows, [], [])


def test_gaits_without_designs_settings_or_nominal_speeds_are_told_all_the_same(tmp_path):
    """Of committed draws, and of those without what was played without draws, or on the rig."""
    report.rewrite(Data(DATA), tmp_path)
    table = (tmp_path / "table.md").read_text()
    assert table.startswith("Speeds with bladders that weigh, under 64 draws that no search has seen")
    assert "| robust 9° | f64 | 0.3156 | 0.3138 |" in table
    assert "| robust 9°, played twice as long | f64 | 0.3446 | 0.3432 |" in table and "100 % | – | 64 |" in table
    assert "| nominal 9° | f64 | 0.3327 | 0.2388 |" in table and "89 % | 3.9 | 64 |" in table
    assert "| robust 9° | f64 | 0.3156 | 0.1209 | -0.1523 |" in table  # designed, without lag and with it
    shutil.copy(DATA / "screen.csv", tmp_path)
    write_records(tmp_path / "draws.csv", [row for row in read_records(DATA / "draws.csv") if int(row["draw"]) >= 0])
    (tmp_path / "out").mkdir()
    report.rewrite(Data(tmp_path), tmp_path / "out")
    table = (tmp_path / "out" / "table.md").read_text()
    assert "| robust 9° | f64 | – | 0.3138 |" in table and "lag |" not in table


def test_the_steepest_inching_is_told_of_several_floors_and_of_the_studys_own(tmp_path):
    """The documentation has the very table that the command makes."""
    report.rewrite(Data(DATA), tmp_path)
    table = [line for line in (tmp_path / "inching.md").read_text().splitlines() if line.startswith("|")]
    assert table[2] == "| wood | 0.56 | 0.7 | 4.0 | 21.1 |" and len(table) == 8
    assert "\n".join(table) in (DATA.parents[1] / "real-floor.md").read_text()
    own = theory.inching_text(RobustGaits(friction=(0.3, 0.5)).describe())
    assert own.splitlines()[-1] == "| of this study | 0.3 | 0.5 | 5.7 | 16.7 |"
    assert "| of this study |" not in theory.inching_text(RobustGaits(floor="acrylic").describe())


def test_a_gait_without_held_out_draws_is_told(tmp_path):
    """In one line."""
    shutil.copy(DATA / "screen.csv", tmp_path)
    draws = read_records(DATA / "draws.csv")
    write_records(tmp_path / "draws.csv", [*draws, {**draws[0], "gait": "still", "draw": -1}])
    with pytest.raises(ValueError, match=r"draws\.csv: gait still has no held-out draw"):
        report.rewrite(Data(tmp_path), tmp_path / "out")


def test_a_search_may_begin_with_a_wave_and_the_gait_of_the_slope_below_from_any_column():
    """The same cycle, turned; what does not depend on columns stays."""
    settings = RobustGaits(geometry="small")
    problem = settings.problem(11.0, True, 1)
    wave = {"levels": "00100111", "shift": 1, "settling": 100.0}
    below = load_design(DATA / "gaits/robust-13.json")
    starts = starts_of(problem, settings, wave, [below])
    gaits = [problem.design(problem.space.from_dict(start)).schedule for start in starts]
    assert len(starts) == 16 and all(start["shift"] == 1 for start in starts) and starts[3]["settle"] == 100.0
    for first, known in ((gaits[0], gaits[:8]), (gaits[8], gaits[8:])):
        for column, gait in enumerate(known):
            np.testing.assert_array_equal(gait.inflation, np.roll(first.inflation, -column, axis=1))
            np.testing.assert_array_equal(gait.grip, np.roll(first.grip, -column, axis=1))
    np.testing.assert_array_equal(gaits[8].inflation, below.schedule.inflation)
    assert gaits[8].grip.sum() == 1
    assert starts_of(problem, RobustGaits(begins=1), wave, []) == starts[:1]


def test_a_search_begins_with_the_start_that_is_best_in_its_own_problem(monkeypatch, tmp_path):
    """One that fails is no better than any; scores are kept, and not computed again."""
    problem = RobustGaits(geometry="small").problem(11.0, True, 1)
    starts = starts_of(problem, RobustGaits(), {"levels": "00100111", "shift": 1, "settling": 0.0}, [])[:2]
    for scores, best in (([0.2, 0.3], 1), ([0.2, 0.1], 0), ([0.2, np.nan], 0)):
        found = SimpleNamespace(objectives=np.array(scores)[:, None])
        parts = ResultsFolder(tmp_path / f"{scores}", "starts", {})
        monkeypatch.setattr(search, "evaluate_request", lambda problem, request, found=found: found)
        assert best_start(problem, starts, parts, "robust-11") == starts[best]
        monkeypatch.setattr(search, "evaluate_request", None)
        assert best_start(problem, starts, parts, "robust-11") == starts[best]
        assert best_start(problem, starts[:1], parts, "robust-11") == starts[0]


@pytest.mark.slow
@pytest.mark.kernels
def test_the_study_finds_judges_and_goes_on(tmp_path, monkeypatch):
    """A second call computes nothing again."""
    settings = RobustGaits(
        (0.0,),
        geometry="small",
        draws=2,
        held_out=2,
        most_full=1,
        steeper=(3.0,),
        steps=4000,
        warm_up=0,
        budget=1e4,
        population=3,
        precision="f32",
    )
    study(tmp_path, settings, threads=2)
    summary = json.loads((tmp_path / "summary.json").read_text())
    names = [row["gait"] for row in summary["rows"]]
    assert names == ["robust 0°", "nominal 0°", "flat body 0°", "inching 0°", "rolling 0°", "robust 0° on 3°"]
    assert all(row["n"] == 2 and row["worst"] <= row["mean"] for row in summary["rows"])
    draws = read_records(tmp_path / "draws.csv")
    assert len(draws) == 6 * 3 and np.isfinite([row["speed"] for row in draws]).all()
    assert load_design(tmp_path / "gaits" / "flat-body-0.json").pressure == 0
    rig = read_records(tmp_path / "rig.csv")
    assert [(row["gait"], row["rig"]) for row in rig] == [
        (f"{name} 0°", "dissertation-lag") for name in ("robust", "nominal")
    ]
    assert np.isfinite([[row["without_lag"], row["with_lag"]] for row in rig]).all()
    table = (tmp_path / "table.md").read_text()
    assert "| gait | precision | designed | without lag | with lag |" in table
    (tmp_path / "again").mkdir()
    report.rewrite(Data(tmp_path), tmp_path / "again")
    for path in (tmp_path / "again").iterdir():
        assert path.read_bytes() == (tmp_path / path.name).read_bytes(), path.name
    shutil.rmtree(tmp_path / "again")
    monkeypatch.setattr(search, "evaluate_request", None)
    monkeypatch.setattr(judgement, "InflatableRobot", None)
    monkeypatch.setattr(judgement, "play_tables", None)
    study(tmp_path, settings, threads=2)
    assert (tmp_path / "table.md").read_text() == table
    monkeypatch.undo()
    for name, key, why in (  # what cannot be is not believed
        ("screen_0_0", "speeds", "shape"),
        ("starts_robust-0", "scores", "inf"),
        ("judge_robust-0_0", "speeds", "inf"),
        ("rig_robust-0", "speeds", "shape"),
    ):
        (part,) = tmp_path.glob(f"{name}-*.npz")
        values = np.load(part)[key]
        np.savez(part, **{key: values[:, None] if why == "shape" else np.full(values.shape, np.inf)})
        with pytest.warns(UserWarning, match=rf"{name}-.*: is damaged, and as good as missing \({key}: {why}"):
            study(tmp_path, settings, threads=2)
        assert (tmp_path / "table.md").read_text() == table
