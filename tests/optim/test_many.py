"""Many robots that differ in all, simulated as one table: here, by processes, and going on after an interruption."""

import warnings

import numpy as np
import pytest
from tossers import GRAVITY, InFeet, Namesake, Roller, Tosser
from voxel_files import vxa

import morpholab as ml
from optim.many import PART, files_of, try_all
from optim.problems.many_robots import ManyRobots
from taichi_sim.base.compute import Compute


def test_each_robot_is_tried_and_the_best_is_told():
    found = ml.simulate_all([Tosser(1.0), Tosser(3.0), Tosser(9.0, breaks=True), Roller(), Tosser()])
    heights = [1 / 2 / GRAVITY, 9 / 2 / GRAVITY, np.nan, np.nan, 4 / 2 / GRAVITY]
    np.testing.assert_allclose(found["height"], heights)
    np.testing.assert_array_equal(found["distance"], [np.nan] * 3 + [7.0, np.nan])
    assert found.status.tolist() == ["ok", "ok", "diverged", "ok", "ok"] and found.failed == 1
    assert found.ranking() == [1, 4, 0] and found.best() == 1 and found.best("distance") == 3
    assert list(found.columns()) == ["source", "kind", "world", "status", "steps", "height", "flight", "distance"]
    assert repr(found) == f"5 robots, 1 failed; best tosser: height {9 / 2 / GRAVITY:.4f} m"
    assert found._repr_html_().count("<tr>") == 4  # its head, and those that have a height
    assert "flight" in found and "flights" not in found and len(found) == 5
    with pytest.raises(KeyError, match="'hight' is unknown; there are height, flight, distance; did you mean height"):
        found["hight"]


def test_measures_that_are_called_as_other_columns_keep_them_apart(tmp_path):
    found = ml.simulate_all([Namesake(1.0)])
    assert list(found.values) == ["height", "steps [no unit]", "status [s]"] and found.status.tolist() == ["ok"]
    assert found.steps.tolist() == [0] and found["steps [no unit]"].tolist() == [1.5]
    assert list(found.columns())[3:] == ["status", "steps", "height", "steps [no unit]", "status [s]"]
    assert "<th>status [s]</th>" in found._repr_html_() and "<th>height [m]</th>" in found._repr_html_()


def test_a_robot_that_refuses_its_world_has_failed_and_says_why():
    found = ml.simulate_all([Tosser(1.0), Tosser(2.0, refuses=True)])
    assert found.status.tolist() == ["ok", "floor: too soft to toss from"] and found.ranking() == [0]


def test_of_none_that_succeeds_none_is_the_best():
    found = ml.simulate_all([Tosser(1.0, breaks=True)])
    assert repr(found) == "1 robot, 1 failed"
    with pytest.raises(ValueError, match="robots: none of 1 succeeded; the first: diverged"):
        found.best()


def test_as_a_data_frame_they_have_units():
    pytest.importorskip("pandas")
    table = ml.simulate_all([Tosser(1.0), Roller()]).to_dataframe()
    assert table["source"].tolist() == ["tosser", "tosser"]
    assert table.attrs["units"] == {"height": "m", "flight": "s", "distance": "m"}


@pytest.mark.parametrize(
    ("sources", "how", "message"),
    [
        ([], {}, "sources: no robot is given; name one at least"),
        ("nowhere", {}, "sources: nowhere is no folder; give one, or a list of robots"),
        ([Tosser()], {"workers": 0}, "workers: 0 is not allowed"),
        (Tosser(), {}, "sources: .*Tosser.* is not allowed; give a list of robots, or a folder"),
        (None, {}, "sources: None is not allowed; give a list of robots, or a folder"),
        (["a.vxa"], {}, "a.vxa"),
        (["vehicle"], {"where": "moon"}, "moon"),
    ],
)
def test_what_is_not_allowed_is_refused(sources, how, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=message):
        ml.simulate_all(sources, **how)


def test_a_folder_stands_for_the_files_of_robots_in_it(tmp_path):
    ones = np.ones((2, 1, 1), int)
    for name in ("b.vxa", "a.vxa", "base.vxa"):
        (tmp_path / name).write_text(vxa(ones))
    (tmp_path / "c.json").write_text("{")  # which may be a robot that is damaged
    (tmp_path / "result.json").write_text('{"speed": 1}')
    for name in ("own.py", "gait.csv", "readme.txt"):
        (tmp_path / name).write_text("import sys; sys.exit(3)")
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "d.vxa").write_text(vxa(ones))
    named = [path.removeprefix(f"{tmp_path}/") for path in files_of(tmp_path)]
    assert named == ["a.vxa", "b.vxa", "base.vxa", "c.json"]
    (tmp_path / "a.vxd").write_text("<VXD></VXD>")
    assert "base.vxa" not in {path.rpartition("/")[2] for path in files_of(tmp_path)}
    for path in (*tmp_path.glob("*.vx*"), tmp_path / "c.json"):
        path.unlink()
    with pytest.raises(ValueError, match=r"has no files of robots, such as \.vxa"):
        files_of(tmp_path)


@pytest.mark.long
def test_processes_give_the_same_and_survive_a_robot_that_kills_them(capfd):
    robots = [Tosser(float(speed)) for speed in range(1, 40)]
    here, there = ml.simulate_all(robots), ml.simulate_all(robots, workers=2)
    np.testing.assert_array_equal(here["height"], there["height"])
    found = ml.simulate_all([*robots[:20], Tosser(5.0, kills=True), *robots[20:]], workers=2)
    assert found.failed == 1 and "killed" in found.status[20]
    np.testing.assert_array_equal(np.delete(found["height"], 20), here["height"])
    assert "worker died" in capfd.readouterr().err


@pytest.mark.kernels
def test_an_interrupted_table_goes_on_with_the_same_bits(tmp_path):
    designs = range(1, 3 * PART, 2)
    vehicles = [ml.robot("vehicle", design=design) for design in designs]
    robots = [each.design(each.start) for each in vehicles]
    whole = ml.simulate_all(robots)
    many = ManyRobots([str(design) for design in designs], robots, [each.worlds[0] for each in robots], Compute())
    told = []

    def stop(done):
        told.append(done)
        if len(told) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        try_all(many, None, tmp_path / "a", stop)
    (part,) = (tmp_path / "a").glob("part-*.npz")
    told += ["now"]
    again = try_all(many, None, tmp_path / "a", told.append)
    assert told[3:] == pytest.approx([PART / len(robots), 1.0])  # only what was missing
    for name in whole.values:
        np.testing.assert_array_equal(again[name], whole[name])
    part.write_bytes(b"damaged")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mended = try_all(many, None, tmp_path / "a", lambda _: None)
    assert "part-" in str(caught[0].message)
    np.testing.assert_array_equal(mended["approach"], whole["approach"])
    other = ManyRobots(many.sources[:-1], many.robots[:-1], many.worlds[:-1], Compute())
    with pytest.raises(ValueError, match="holds robots of other settings"):
        try_all(other, None, tmp_path / "a", lambda _: None)


def test_what_is_measured_in_other_units_is_another_measure():
    found = ml.simulate_all([Tosser(1.0), InFeet(1.0)])
    assert list(found.values) == ["height [m]", "flight", "height [ft]"]
    np.testing.assert_allclose(found["flight"], 2 / GRAVITY)
    np.testing.assert_allclose(found["height [ft]"], [np.nan, 1 / 2 / GRAVITY / 0.3048])
    assert found.ranking() == [0] and repr(found) == f"2 robots; best tosser: height [m] {1 / 2 / GRAVITY:.4f}"
