"""Gaits with few bladders full at a time: what is searched, and what the study writes."""

import shutil
from pathlib import Path

import pytest

from optim.experiments.tables import read_records, write_records
from optim.studies.beyond.robust_gaits import capped, search
from optim.studies.beyond.robust_gaits.capped import STUDY, CappedGaits
from robots.inflatable.design import INCHING, ROLLING, load_design


def test_searches_keep_to_each_number_of_bladders():
    """Theirs is the study's of gaits for a real floor; what it refuses is refused before any work."""
    settings = CappedGaits(full=(1, 3), slopes=(0.0, 5.0), floor="acrylic", begins=2)
    for full in (1, 3):
        own = settings.searches(full)
        assert (own.most_full, own.capped, own.slopes, own.floor, own.begins) == (full, True, (0.0, 5.0), "acrylic", 2)
        assert own.problem(5.0, True, 1).most_full == full
    for bad, message in (
        ({"full": ()}, r"full: \(\)"),
        ({"full": (2, 1)}, r"full: \(2, 1\)"),
        ({"full": (1, 9)}, "full: 9"),
        ({"full": (1, "a")}, "full: 'a'"),
        ({"floor": "ice"}, "floor: 'ice'"),
        ({"slopes": (0.0, 95.0)}, "slopes: 95"),
    ):
        with pytest.raises(ValueError, match="^" + message):
            CappedGaits(**bad)


def test_searches_begin_where_fewer_bladders_and_less_slope_led(monkeypatch, tmp_path):
    """The gait of the slope below, and that with fewer full bladders on the same slope."""
    led: list[tuple[int, float, list[object]]] = []
    gaits = iter([INCHING, ROLLING] * 2)

    def started(problem, settings, wave, known):
        led.append((settings.most_full, problem.terrains[0].slope, list(known)))
        return [{}]

    monkeypatch.setattr(capped, "screened", lambda *args: [{"slope": slope, "speed": 0.0} for slope in (0.0, 9.0)])
    monkeypatch.setattr(search, "starts_of", started)
    monkeypatch.setattr(search, "refined", lambda *args: next(gaits))
    judged = lambda settings, parts, gaits, *rest: [  # noqa: E731
        {"gait": name, "slope": slope, "precision": "f64", "draw": draw, "speed": 0.1 * draw}
        for name, (_, slope) in gaits.items()
        for draw in (-1, 0, 1)
    ]
    monkeypatch.setattr(capped, "judged", judged)
    capped.study(tmp_path, CappedGaits((1, 2)))
    assert led == [(1, 0.0, []), (1, 9.0, [INCHING]), (2, 0.0, [INCHING]), (2, 9.0, [INCHING, ROLLING])]
    assert load_design(tmp_path / "gaits/2-full-9.json") == load_design(tmp_path / "gaits/1-full-9.json")
    rows = read_records(tmp_path / "draws.csv")
    assert [(int(row["full"]), row["gait"]) for row in rows[::3]] == [
        (1, "1 full 0°"),
        (1, "1 full 9°"),
        (2, "2 full 0°"),
        (2, "2 full 9°"),
    ]


@pytest.mark.slow
@pytest.mark.kernels
def test_a_small_study_runs_and_is_told_from_its_data(morpholab, tmp_path):
    """Gaits within their numbers of bladders; page and summary again from the table of draws."""
    code, _, error = morpholab("reproduce capped-gaits --budget small --out a --quiet")
    assert (code, error) == (0, "")
    for full in (1, 2):
        design = load_design(tmp_path / f"a/gaits/{full}-full-0.json")
        assert design.schedule.inflation.sum(axis=0).max() <= full + 1e-9
    data = tmp_path / "data/capped-gaits"
    data.mkdir(parents=True)
    shutil.copy(tmp_path / "a/draws.csv", data)
    assert morpholab("reproduce capped-gaits --from-data data --out b")[0] == 0
    table = (tmp_path / "b/table.md").read_text()
    assert (
        table.count("| 0° |") == 2 and table.splitlines()[2:] == (tmp_path / "a/table.md").read_text().splitlines()[2:]
    )


def test_damaged_tables_are_refused(morpholab, tmp_path):
    """In one line: no draws that were held out."""
    Path("data/capped-gaits").mkdir(parents=True)
    row = {"full": 1, "gait": "1 full 0°", "slope": 0.0, "precision": "f64", "draw": -1, "speed": 0.2}
    write_records(Path("data/capped-gaits/draws.csv"), [row])
    code, _, error = morpholab("reproduce capped-gaits --from-data data --out b")
    assert code == 2 and "less than two held-out draws" in error and error.count("\n") == 1
    assert set(STUDY.scales) == {"small", "medium", "full"}
