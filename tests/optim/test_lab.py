"""The functions of ``import morpholab as ml``: robots and worlds by name, designs, and what is shown of trials."""

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from articulated_files import CRAWLER

import morpholab as ml
from optim import maximise
from optim.cli import main
from optim.problems.robot import RobotProblem
from robots.robot import Measure, Outcome, Parameter, Robot

ROOT = Path(__file__).resolve().parents[2]


def test_robots_and_worlds_come_by_name():
    known = ml.robots()
    assert known["rolling"] == known["inflatable"] == "inflatable robot" and known["vehicle"] == "Braitenberg vehicle"
    assert ml.robot("vehicle", design="162").describe() == ml.robot("vehicle", design=162).describe()
    walker = ml.robot("soft-quadruped")
    assert ml.robot(walker) is walker
    assert ml.robot(ml.robot("rolling"), pressure="9000").gait.pressure == 9000
    assert ml.world(walker, "hill:5").name == "hill:5" and ml.world(walker) == walker.worlds[0]


class Pendulum(Robot):
    """A robot of a kind that no package has registered."""

    kind = "pendulum"
    parameters = (Parameter("push", 0.0, 4.0),)
    measures = (Measure("height", "m"),)

    def run(self, points, trial):
        return Outcome({"height": 4.0 - (points[:, 0] - 3.0) ** 2})


def test_a_robot_whose_kind_is_not_registered_is_for_searches_in_python_alone():
    for call in (ml.simulate, ml.differentiate, ml.view):
        with pytest.raises(ValueError, match=r"^robot: the kind 'pendulum' of Pendulum is not registered; add it by"):
            call(Pendulum())
    best = maximise(RobotProblem(Pendulum()), method="random", generations=1, climbers=8, progress=lambda _: None)
    assert best.score > 0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ml.robot("soft-quadruped", headin=3), "headin: is no option of lattice robot; .*did you mean heading"),
        (lambda: ml.robot("soft-quadruped", heading="north"), "heading: "),
        (lambda: ml.robot(ml.robot("rolling"), presure=9000), "presure: is no option of .*did you mean pressure"),
        (lambda: ml.robot("quadrupd"), "robot: 'quadrupd' is unknown; did you mean quadruped"),
        (lambda: ml.robot("x" * 5000), "robot: 'x+' is unknown"),
        (
            lambda: ml.simulate(None),
            "^robot: None is not allowed; give a robot, or its name or file, such as 'rolling'$",
        ),
        (lambda: ml.robot(3), "^robot: 3 is not allowed; give a robot"),
        (lambda: ml.robot(""), "^robot: '' is not allowed; give a name or a file$"),
        (lambda: ml.simulate("soft-quadruped", where="hil:3"), "terrain: 'hil:3' is unknown"),
        (lambda: ml.simulate("vehicle", {"w9": 1.0}), "designs: 'w9' is unknown; there are l1x, .*w2"),
        (
            lambda: ml.simulate("vehicle", {"w1": (1, 2), "w2": (1, 2, 3)}),
            "designs: give numbers, or arrays of one length",
        ),
        (lambda: ml.simulate("vehicle", np.zeros((2, 3))), r"points: shape \(2, 3\) is not allowed"),
        (
            lambda: ml.simulate("vehicle", [[0.0, 0.0, 0.0, 0.0, 0.0, np.nan]]),
            "^points: nan of w2 is not allowed; give",
        ),
        (
            lambda: ml.simulate("vehicle", {"w1": np.nan}),
            "^designs: nan of w1 is not allowed; give a number from -1 to 1",
        ),
        (
            lambda: ml.simulate("vehicle", {"w1": [0, 3]}),
            "^designs: 3 of w1 is not allowed; give a number from -1 to 1",
        ),
        (lambda: ml.simulate("vehicle", "flat"), "designs: 'flat' is not allowed; of a world say where='flat'$"),
        (lambda: ml.simulate("vehicle", {"w1": [[0.1, 0.2], [0.3, 0.4]]}), "designs: give numbers, or arrays of one"),
        (lambda: ml.simulate("vehicle", {1: 0.5}), "designs: 1 is unknown; there are l1x, .*w2; did you mean w1.$"),
        (
            lambda: ml.simulate("vehicle", np.ma.masked_greater([[0.0, 0.0, 0.0, 0.0, 0.0, 0.5]], 0.1)),
            "^points: nan of w2 is not allowed; give finite numbers$",
        ),
        (
            lambda: ml.simulate("vehicle", {"w2": np.ma.masked_greater([0.0, 0.5], 0.1)}),
            "^designs: nan of w2 is not allowed; give a number from",
        ),
        (lambda: ml.view("vehicle", np.zeros((2, 6))), "design: 2 are not allowed; give one"),
        (lambda: ml.robot("inching", columns=-1), "^columns: .*-1.* is not allowed"),
        (lambda: ml.robot("inching", columns=True), "^columns: .*True.* is not allowed"),
        (lambda: ml.robot("inching", columns=np.float64(1.5)), "^columns: .*1.5.* is not allowed"),
        (lambda: ml.robot("freeform", shape=5), "^shape: "),
        (lambda: ml.robot("freeform", full=-1), "^full: -1 is not allowed; give true or false$"),
        (lambda: ml.robot("inching", calibration=5), "^5: "),
        (
            lambda: ml.simulate("rolling", geometry="small"),
            r"^geometry: is unknown here; what the robot is like is told before, as robot\('rolling', geometry=...\)$",
        ),
        (
            lambda: ml.simulate("rolling", slope=5),
            "^slope: is unknown here; the world is told by its name, as where='flat'$",
        ),
        (
            lambda: ml.robot("rolling", geometry="smal"),
            "^geometry: 'smal' is unknown; choose one of published, small, two",
        ),
        (lambda: ml.robot("rolling", weight="none"), "^weight: 'none' is unknown; choose one of published, physical$"),
        (lambda: ml.simulate("rolling", colour=5), "^colour: is unknown here; there are .*precision"),
        pytest.param(
            lambda: ml.differentiate("vehicle", measures=["solved"]),
            "^measures: solved has no derivatives; there are approach, closest$",
            marks=pytest.mark.kernels,
        ),
        (lambda: ml.simulate("vehicle", where=["1", "2"]), r"^where: \['1', '2'\] is not allowed; give one world"),
        (
            lambda: ml.differentiate("vehicle", measures=["speed"]),
            "^measures: 'speed' is unknown; there are approach, closest, solved$",
        ),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_world_may_be_a_number():
    assert ml.world(ml.robot("vehicle"), 2) == ml.world(ml.robot("vehicle"), "2")


@pytest.mark.kernels
def test_the_folder_of_a_run_is_its_best_design_in_its_world(tmp_path):
    words = "codesign --robot soft-quadruped --terrain hill:3 --method random --climbers 4 --generations 1"
    assert main([*words.split(), "--quiet", "--out", str(tmp_path / "run")]) == 0
    tried = ml.simulate(tmp_path / "run")
    assert tried.world.name == "hill:3" and ml.robot(tmp_path / "run").kind == "lattice"
    assert tried["speed"][0] == ml.simulate(tmp_path / "run" / "best.json", where="hill:3")["speed"][0]


@pytest.mark.kernels
def test_a_single_design_is_told_with_its_picture():
    alone = ml.simulate("vehicle", {"w1": -1.0, "w2": -1.0})
    assert len(alone) == 1 and repr(alone).startswith("Braitenberg vehicle: approach ") and "\n" not in repr(alone)
    shown = alone._repr_html_()
    assert shown.count("<tr>") == 2 and shown.count('src="data:image/png;base64,') == 1
    assert "<th>closest [m]</th>" in shown and f"<td>{alone['closest'][0]:.5g}</td>" in shown
    assert alone.show(height=300)._repr_html_().startswith("<iframe") and len(alone.plot().axes) == 2
    together = ml.simulate("vehicle", {"w1": (-1.0, 0.5), "w2": -1.0})
    assert together["closest"][0] == alone["closest"][0]


@pytest.mark.kernels
def test_several_designs_are_a_table():
    pandas = pytest.importorskip("pandas")
    found = ml.differentiate("vehicle", {"w1": np.linspace(-1, 1, 20)}, measures=["closest"])
    frame = found.to_dataframe()
    assert isinstance(frame, pandas.DataFrame) and len(frame) == 20
    units = frame.attrs["units"]
    assert (units["closest"], units["l1x"], units["w1"]) == ("m", "m", "") and set(units) < set(frame)
    assert np.array_equal(frame["w1"], np.linspace(-1, 1, 20)) and frame["d_closest/d_w1"].abs().max() > 0
    assert repr(found).startswith("20 designs, Braitenberg vehicle: ") and "and 8 more" in found._repr_html_()
    axes = found.plot("closest").axes[0]
    assert axes.get_xlabel() == "w1" and np.array_equal(axes.lines[0].get_ydata(), found["closest"])
    assert found["closest"][found.best("closest")] == np.nanmax(found["closest"])
    with pytest.raises(KeyError, match=r"measure: 'closet' is unknown; .*did you mean closest"):
        found["closet"]
    with pytest.raises(KeyError, match=r"measure: 0 is unknown; there are "):
        found[0]
    assert "closest" in found and "closet" not in found


@pytest.mark.kernels
def test_tables_of_designs_go_by_the_names_of_their_columns():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"w2": [0.5, -0.5], "w1": [0.25, 0.75]}, index=["a", "b"])
    found = ml.simulate("vehicle", frame)
    assert found.columns()["w1"].tolist() == [0.25, 0.75] and found.columns()["w2"].tolist() == [0.5, -0.5]
    assert ml.simulate("vehicle", frame.iloc[1])["closest"][0] == found["closest"][1]


@pytest.mark.kernels
def test_nobody_changes_what_was_tried_and_found():
    points = np.tile(ml.robot("vehicle").start, (2, 1))
    found = ml.simulate("vehicle", points)
    closest, w1 = found["closest"].tolist(), found.columns()["w1"].tolist()
    points[:] = 0.2
    found["closest"][:] = 99
    found.columns()["w1"][:] = 7
    assert found["closest"].tolist() == closest and found.columns()["w1"].tolist() == w1
    with pytest.raises(ValueError, match="read-only"):
        found.points[:] = 0


@pytest.mark.kernels
def test_what_a_world_adds_to_the_measures_is_told_and_drawn():
    robot = ml.robot("soft-quadruped")
    found = ml.simulate(robot, np.stack([robot.start, robot.start]), where="flat+light:0.1,0.05")
    assert "remaining " in repr(found) and "<th>remaining [m]</th>" in found._repr_html_()
    assert found.plot("remaining").axes[0].get_ylabel() == "distance that remains to the target [m]"


@pytest.mark.kernels
@pytest.mark.filterwarnings("ignore:model. ignored")
def test_the_centre_of_mass_is_told_over_time(tmp_path):
    """It ends where measures of a user's own see it, but for the steps after the last frame."""
    own = [ml.OwnMeasure(f"end_{n}", "m", law=lambda m, n=n: m.centres(m.ended)[:, n]) for n in range(3)]
    found = ml.simulate(dataclasses.replace(ml.robot("soft-quadruped"), own_measures=own))
    times, places = found.centre_of_mass()
    assert places.shape == (len(times), 3) and (np.diff(times) > 0).all()
    assert places[-1] == pytest.approx([found[f"end_{n}"][0] for n in range(3)], abs=5e-4)
    (tmp_path / "crawler.xml").write_text(CRAWLER)
    found = ml.simulate(ml.robot(tmp_path / "crawler.xml", duration=0.2))
    way = np.diff(found.centre_of_mass()[1][[0, -1], 0])
    assert way == pytest.approx(found["distance"], abs=1e-9)
    with pytest.raises(ValueError, match="centre_of_mass: masses of Braitenberg vehicle are not known; replay"):
        ml.simulate("vehicle").centre_of_mass()


@pytest.mark.kernels
def test_a_precision_that_is_not_usual_is_told():
    assert repr(ml.simulate("vehicle", precision="f32")).endswith(" (in f32)")
    assert repr(ml.simulate("vehicle", {"w1": [0.1, 0.2]}, precision="f32")).endswith(" (in f32)")
    assert "f64" not in repr(ml.simulate("vehicle"))


def test_a_folder_of_the_name_of_a_package_does_not_hide_the_lab(tmp_path):
    """Unless it was imported before, which is said in one line."""
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots/__init__.py").touch()
    (tmp_path / "try.py").write_text(
        f"import sys; sys.path.append({str(ROOT)!r})\n"
        "if sys.argv[1:]: import robots\n"
        "import morpholab as ml\n"
        "print(ml.robots()['rolling'])\n"
    )
    run = [sys.executable, "try.py"]
    fine = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert fine.stdout == "inflatable robot\n", fine.stderr
    other = subprocess.run([*run, "first"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert other.returncode == 1 and other.stderr.splitlines()[-1] == (
        f"ImportError: robots: {tmp_path / 'robots'} was imported and hides the lab's package; "
        "import morpholab before it, or rename that folder"
    )


def test_an_option_that_may_be_repeated_takes_one_text_or_several(tmp_path):
    """And what is wrong with one of them is told by its name."""
    mesh = tmp_path / "box.stl"
    trimesh.creation.box((40, 20, 20)).export(mesh)
    for regions in (f"legs={mesh}", [f"legs={mesh}"]):
        assert [drive.name for drive in ml.robot(mesh, pitch=10, region=regions).drives] == ["legs"]
    with pytest.raises(ValueError, match=r"^region: 'legs' is not allowed; give NAME=FILE"):
        ml.robot(mesh, pitch=10, region=[f"legs={mesh}", "legs"])


def test_a_problem_takes_a_robot_and_says_so():
    with pytest.raises(ValueError, match=r"^robot: 'crawler.xml' is not allowed; give a Robot, as morpholab"):
        ml.RobotProblem("crawler.xml")
