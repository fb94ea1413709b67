"""``morpholab view``."""

import json
import re
import sys

import numpy as np
import pytest
from run_products import searched
from stand_in import Simulator

import morpholab as ml
from optim.problems.braitenberg import VehicleProblem
from robots.braitenberg import STARTS, VehicleTask
from robots.hardware import export_csv
from robots.inflatable import INCHING, save_design
from robots.lattice_robot.walker import ACTIVE, PASSIVE, WalkerDesign, save_walker

pytestmark = pytest.mark.kernels

QUICK = "--geometry small --columns 1 --repeats 1 --threads 1 --quiet"


def walker(folder):
    materials = np.full((2, 2, 2), PASSIVE)
    materials[0] = ACTIVE
    save_walker(WalkerDesign(materials), folder / "walker.json")


def vehicles(folder):
    problem = VehicleProblem(task=VehicleTask(STARTS * [0.25, 0.25, 1.0], radius=0.3, time_step=0.1, steps=60))
    searched(problem, folder / "run")


def test_vehicles_side_by_side(morpholab, tmp_path):
    line = "view vehicle rover --environment 3 --controller 1,0.9 --frames 100 --threads 1 --out page.html --quiet"
    code, out, _ = morpholab(f"{line} --json")
    document = json.loads(out)
    assert code == 0 and [robot["name"] for robot in document["robots"]] == ["vehicle 6553", "rover 6553"]
    assert all(50 < robot["frames"] <= 101 for robot in document["robots"])
    assert document["files"] == [{"path": "page.html", "bytes": (tmp_path / "page.html").stat().st_size}]
    page = (tmp_path / "page.html").read_text()
    assert "<title>vehicle, rover</title>" in page and 'id="motion-1"' in page


def test_of_a_run_in_several_worlds_it_says_which_it_shows(morpholab, tmp_path):
    line = (
        "codesign --robot soft-quadruped --terrain flat --terrain hill:5 --method random --climbers 1 --generations 1"
    )
    assert morpholab(f"{line} --threads 1 --quiet --out a")[0] == 0
    shown = "view a --frames 9 --precision f64 --threads 1 --quiet --out"
    assert "; its run has hill:5, too: --terrain shows another" in morpholab(f"{shown} a.html")[1]
    assert "its run" not in morpholab(f"{shown} b.html --terrain hill:5")[1]
    assert "its run" not in morpholab("view vehicle --controller 1,1 --frames 9 --threads 1 --quiet --out c.html")[1]


def test_a_run_is_seen_in_its_own_precision(morpholab, tmp_path):
    """Its best robot may fall in another, where it did not when it was scored."""
    search = "codesign --robot soft-quadruped --method random --climbers 1 --generations 1 --precision f64"
    assert morpholab(f"{search} --threads 1 --quiet --out a")[0] == 0
    pages = []
    for precision in ("", "--precision f64", "--precision f32"):
        assert morpholab(f"view a --frames 9 {precision} --threads 1 --quiet --out page{len(pages)}.html")[0] == 0
        pages.append((tmp_path / f"page{len(pages)}.html").read_bytes())
    assert pages[0] == pages[1] != pages[2]


def test_a_run_is_simulated_in_its_own_precision(morpholab, tmp_path):
    search = "codesign --robot soft-quadruped --method random --climbers 1 --generations 1 --precision f32"
    assert morpholab(f"{search} --threads 1 --quiet --out a")[0] == 0
    best = json.loads((tmp_path / "a" / "log.jsonl").read_text().splitlines()[-1])["best"]
    assert json.loads(morpholab("simulate --robot a --threads 1 --quiet --json")[1])["speed"] == best
    assert ml.simulate(tmp_path / "a", threads=1)["speed"].tolist() == [best]
    assert ml.simulate(tmp_path / "a", threads=1, precision="f64")["speed"].tolist() != [best]


def test_a_folder_that_holds_no_run_hides_no_robot(morpholab, tmp_path):
    (tmp_path / "vehicle").mkdir()
    assert morpholab("view vehicle --frames 5 --out vehicle/page.html --threads 1 --quiet")[0] == 0
    code, _, error = morpholab("view . --out page.html --quiet")
    assert code == 2 and "holds no run; its config.toml is missing" in error


def test_a_quadruped_with_weights_from_a_file(morpholab, tmp_path):
    np.save(tmp_path / "w.npy", np.zeros((5, 8)))
    line = "view legged --controller w.npy --threads 1 --frames 50 --glb walk.glb"
    code, out, error = morpholab(line)
    assert code == 0 and (tmp_path / "walk.glb").read_bytes()[:4] == b"glTF"
    assert "legged quadruped: 9 parts, 48 frames, " in out and error == "legged\n"
    assert re.search(r"walk.glb: \d\d kB\n", out)
    np.save(tmp_path / "w.npy", np.zeros((8, 5)))
    code, _, error = morpholab("view legged --controller w.npy --glb again.glb --quiet")
    assert (code, error) == (
        2,
        "morpholab view: error: controller: w.npy has shape (8, 5), which is not allowed; give (5, 8)\n",
    )


def test_files_of_designs(morpholab, tmp_path):
    save_design(INCHING, tmp_path / "gait.json")
    walker(tmp_path)
    code, out, _ = morpholab(f"view walker.json gait.json --slope 5 --frames 20 --out page.html {QUICK}")
    first, second, _ = out.splitlines()
    assert (
        code == 0 and first.startswith("walker on hill:5: 8 parts, ") and second.startswith("gait on hill:5: 736 parts")
    )


def test_gait_tables_move_as_their_designs_do(morpholab, tmp_path):
    save_design(INCHING, tmp_path / "gait.json")
    export_csv(INCHING, tmp_path / "table.csv")
    _, out, _ = morpholab(f"view gait.json table.csv --frames 20 --out page.html --json {QUICK}")
    first, second = json.loads(out)["robots"]
    assert {**first, "name": "table on flat", "source": "table.csv"} == second


def test_soft_robots_in_water(morpholab, tmp_path):
    walker(tmp_path)
    code, out, _ = morpholab("view walker.json --terrain water --frames 20 --out page.html --threads 1 --quiet")
    assert code == 0 and out.startswith("walker in water: 8 parts, ")
    assert '"ground":{"solid":false,' in (tmp_path / "page.html").read_text()
    code, _, error = morpholab("view walker.json --terrain water --slope 3 --out again.html --quiet")
    assert code == 2 and "slope: 3 is not allowed beside --terrain water; give one of them" in error


def test_the_best_of_a_run_of_gaits(morpholab, tmp_path):
    with pytest.MonkeyPatch.context() as patch:  # evaluated at once, viewed as it is
        drawn = "robots.inflatable.view.picture.save_motion_picture"
        patch.setattr(drawn, lambda design, terrain, path, **_: path.touch())
        patch.setattr("robots.inflatable.simulation.simulate", Simulator())
        search = "--climbers 4 --generations 1 --geometry small --quiet"
        assert morpholab(f"codesign --out runs/a --terrain hill:7 {search}")[0] == 0
    code, out, _ = morpholab("view runs/a --frames 20 --columns 1 --repeats 1 --threads 1 --quiet --out page.html")
    assert code == 0 and out.startswith("a on hill:7: 736 parts")
    quick = "--frames 20 --columns 1 --repeats 1 --threads 1 --quiet"
    code, out, _ = morpholab(f"view runs/a --floor wood {quick} --out wood.html")
    assert code == 0 and out.startswith("a on hill:7, friction 0.56,0.7 (wood): 736 parts")
    code, _, error = morpholab("view runs/a --member 99 --quiet --out other.html")
    assert code == 2 and "member: 99 is not allowed; runs/a keeps 4 designs" in error


def test_the_best_of_a_run_of_vehicles(morpholab, tmp_path):
    vehicles(tmp_path)
    code, out, _ = morpholab("view run --environment 2 --threads 1 --quiet --out page.html")
    assert code == 0 and out.startswith("run: 6 parts, ")


def test_pictures_films_and_folders(morpholab, tmp_path):
    files = "--picture a.png --at 1.5 --strip b.png --gif c.gif --paraview d --seconds 0.5"
    code, out, _ = morpholab(f"view vehicle --threads 1 --frames 30 --quiet --json {files}")
    document = json.loads(out)
    sizes = {file["path"]: file["bytes"] for file in document["files"]}
    assert code == 0 and list(sizes) == ["a.png", "b.png", "c.gif", "d"] and min(sizes.values()) > 5000
    for name in ("a.png", "b.png", "c.gif"):
        assert (tmp_path / name).stat().st_size == sizes[name]
    assert (tmp_path / "d" / "motion.pvd").read_text().count("<DataSet") == document["robots"][0]["frames"]


def test_soft_robots_in_their_colours(morpholab, tmp_path):
    save_design(INCHING, tmp_path / "gait.json")
    for colour in ("friction", "beams"):
        line = f"view gait.json --picture {colour}.png --at 0 --colour {colour} --frames 5 {QUICK}"
        assert morpholab(line)[0] == 0 and (tmp_path / f"{colour}.png").stat().st_size > 10_000


def test_a_pouch_has_feet_that_grip_and_slide(morpholab, tmp_path):
    line = "view pouch --cycles 1 --frames 9 --threads 1 --quiet --strip feet.png --colour friction"
    assert morpholab(line)[0] == 0 and (tmp_path / "feet.png").stat().st_size > 10_000


def test_colours_that_a_robot_does_not_have_write_nothing(morpholab, tmp_path):
    line = "view vehicle --threads 1 --frames 5 --colour strain --picture a.png --out a.html --glb a.glb --quiet"
    code, _, error = morpholab(line)
    refusal = "colour: strain is not allowed for vehicle 6553, which has no lattice; give material"
    assert (code, error) == (2, f"morpholab view: error: {refusal}\n") and not list(tmp_path.iterdir())


@pytest.fixture
def nothing_simulated(monkeypatch):
    """Whatever is refused is refused before any robot is made."""

    def simulated(*_):
        raise AssertionError

    monkeypatch.setattr("optim.commands.view.loaded", simulated)


@pytest.mark.usefixtures("nothing_simulated")
def test_strips_of_beams_are_refused_before_any_work(morpholab):
    code, _, error = morpholab("view rolling --strip a.png --colour beams --quiet")
    told = "colour: beams is not allowed for a strip; give material, strain, contact, friction or channel"
    assert (code, error) == (2, f"morpholab view: error: {told}\n")


@pytest.mark.usefixtures("nothing_simulated")
def test_videos_need_their_extra(morpholab, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    code, _, error = morpholab("view rolling --mp4 a.mp4 --quiet")
    assert code == 2 and "mp4: imageio-ffmpeg is missing; install the extra video (pip install -e " in error


def test_recordings_for_rerun(morpholab, tmp_path):
    pytest.importorskip("rerun", reason="needs the extra rerun")
    code, out, _ = morpholab("view vehicle --threads 1 --frames 30 --quiet --json --rerun a.rrd")
    assert code == 0 and json.loads(out)["files"] == [{"path": "a.rrd", "bytes": (tmp_path / "a.rrd").stat().st_size}]
    assert (tmp_path / "a.rrd").read_bytes()[:3] == b"RRF"
    code, _, error = morpholab("view vehicle --threads 1 --frames 30 --quiet --rerun a.rrd")
    assert code == 2 and "rerun: a.rrd exists; name a new file" in error


@pytest.mark.usefixtures("nothing_simulated")
def test_recordings_need_their_extra(morpholab, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "rerun", None)
    code, _, error = morpholab("view rolling --rerun a.rrd --quiet")
    assert code == 2 and "rerun: rerun-sdk is missing; install the extra rerun (pip install -e " in error
    assert error.count("\n") == 1 and not list(tmp_path.iterdir())


NO_ROBOT = (
    "is no robot (inching, rolling, inflatable, freeform, soft-quadruped, feeling-quadruped, light-seeker, "
    "soft-swimmer, lattice, articulated, pouch, legged, wheeled, whegged, quadruped, "
)
BAD_INPUT = {
    "rolling": "out: there is nothing to write; give --picture, --strip, --gif, --mp4, --paraview, --rerun, ",
    "rolling --out there.html": "out: there.html exists; name a new file",
    "rolling --glb there.html": "glb: there.html exists; name a new file",
    "rolling --out no/page.html": "out: no/page.html cannot be written; there is no folder no",
    "rolling inching --glb a.glb": "glb: 2 robots are not allowed in one file; give one",
    "rolling inching --picture a.png": "picture: 2 robots are not allowed in one file; give one",
    "rolling --picture there.html": "picture: there.html exists; name a new file",
    "rolling --paraview empty": "paraview: empty exists; name a new folder",
    "rolling --picture a.doc": "picture: a.doc is not allowed; give a name that ends in .png or .pdf or .svg",
    "rolling --rerun a.bin": "rerun: a.bin is not allowed; give a name that ends in .rrd",
    "rolling --gif a.png": "gif: a.png is not allowed; give a name that ends in .gif",
    "rolling --picture a.png --title b": "title: no file asked for takes it; give --out",
    "rolling --out a.html --at 1": "at: no file asked for takes it; give --picture",
    "rolling --out a.html --colour strain": "colour: no file asked for takes it; give --picture, --strip, --gif or ",
    "rolling --strip a.png --seconds 5": "seconds: no file asked for takes it; give --gif or --mp4",
    "rolling --strip a.png --colour beams": "colour: beams is not allowed for a strip; give material, strain,",
    "vehicle --picture a.png --at 9999": "at: 9999 s is not allowed; vehicle 6553 moves for 500 s",
    "a b c d e --out a.html": "sources: 5 robots are not allowed; give up to 4",
    "nothing --out a.html": f"source: 'nothing' {NO_ROBOT}",
    "there.html --out a.html": "there.html: it is no file of a robot or a design",
    "vehicle --controller 1 --out a.html": "controller: '1' is not allowed; give two numbers, such as 1,-0.5",
    "vehicle --controller 3,1 --out a.html": "weights: 3.0 is not allowed; give numbers from -1 to 1",
    "vehicle --design 7000 --out a.html": "design: 7000 is not allowed; give a whole number from 1 to 6561",
    "empty --out a.html": "empty",
}


@pytest.mark.parametrize("line", BAD_INPUT)
def test_bad_input_is_told_in_one_line(morpholab, tmp_path, line):
    (tmp_path / "there.html").write_text("mine")
    (tmp_path / "empty").mkdir()
    code, out, error = morpholab(f"view {line} --quiet")
    assert code == 2 and out == "" and error.count("\n") == 1
    assert error.startswith(f"morpholab view: error: {BAD_INPUT[line]}")
    assert (tmp_path / "there.html").read_text() == "mine" and not (tmp_path / "a.html").exists()


INFLATABLE = "it is an option of other kinds (inflatable robot, pouch that feels); leave it out"
SOFT = INFLATABLE.replace("pouch", "freeform robot, lattice robot, pouch").replace("feels", "feels, soft walker")
NOT_OF_THEM = {
    "legged rover --slope 10": f"slope: {SOFT}",
    "walker.json --member 2": "member: it is of runs; leave it out",
    "rolling --member 2": "member: it is of runs; leave it out",
    "rolling --controller 1,1": "controller: it is an option of other kinds (articulated robot, quadruped, two-wheel "
    "vehicle, Braitenberg vehicle); leave it out",
    "inching legged --design 3": "design: it is an option of other kinds (two-wheel vehicle, Braitenberg vehicle); "
    "leave it out",
    "rolling --environment 2": "environment: it is an option of other kinds (quadruped, two-wheel vehicle, Braitenberg "
    "vehicle); leave it out",
    "vehicle --seed 3": "seed: it is an option of other kinds (freeform robot, quadruped); leave it out",
    "legged --seed 3 --controller w.npy": "seed: it is of random weights; leave it out beside --controller",
    "walker.json --geometry small": f"geometry: {INFLATABLE}",
    "run --geometry small": f"geometry: {INFLATABLE}",
    "run --slope 5": f"slope: {SOFT}",
    "run --design 3": "design: vehicle has its own; leave it out",
}


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sources")
    walker(folder)
    vehicles(folder)
    return folder


@pytest.mark.parametrize("line", NOT_OF_THEM)
def test_options_of_other_robots_are_refused(morpholab, monkeypatch, sources, line):
    monkeypatch.chdir(sources)
    code, out, error = morpholab(f"view {line} --out a.html --quiet")
    assert (code, out, error) == (2, "", f"morpholab view: error: {NOT_OF_THEM[line]}\n")
