"""A robot of the user's own under ``codesign``, ``gradient-check`` and ``view``."""

import json
import re
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest
import trimesh
from articulated_files import CRAWLER

from optim.problems.user_file import load_problem
from robots.hardware import read_channels
from robots.lattice_robot.links import LINKS_OPTION, USUAL
from robots.robot import find_robot
from taichi_sim.lattice.body import LINK_LAWS, USUAL_LINKS

EXAMPLES = Path(__file__).parents[3] / "examples"
MINE = """
from robots.lattice_robot import Drive, Free, LatticeRobot
from taichi_sim.lattice import Material, body_from_array

rubber = Material(5e4, 1e3, static_friction=1.0, kinetic_friction=0.5)
array = [[[1, 1], [0, 1]], [[0, 1], [0, 2]], [[1, 2], [1, 2]]]
robot = LatticeRobot(
    body_from_array(array, (rubber, rubber), 0.02),
    (Drive("front", (0,), amplitude=Free(0.0, 0.2), phase=Free(0.0, 1.0, 0.3)), Drive("back", (1,), amplitude=0.1)),
    cycles=1,
    settling=0.05,
)
"""
QUICK = "--threads 1 --quiet"


@pytest.fixture
def mine(tmp_path):
    (tmp_path / "my_robot.py").write_text(MINE)


@pytest.mark.kernels
def test_a_users_file_is_designed_continued_and_seen(morpholab, tmp_path, mine):
    search = f"codesign --robot my_robot.py --climbers 4 --out runs/x {QUICK}"
    code, out, error = morpholab(f"{search} --generations 1 --terrain hill:3 --json")
    assert code == 0 and error == ""
    document = json.loads(out)
    assert set(document["best_point"]) == {"front_amplitude", "front_phase"} and document["evaluations"] == 8
    assert document["files"] == ["best.json", "gait.csv"]
    (tmp_path / "my_robot.py").rename(tmp_path / "gone.py")  # the run knows its robot
    code, out, _ = morpholab(f"codesign --resume --generations 2 --out runs/x {QUICK}")
    assert code == 0 and out.startswith("best speed: ")
    config = tomllib.loads((tmp_path / "runs/x/config.toml").read_text())
    assert config["problem"]["worlds"] == [{"slope": 3.0}] and "drives" in json.loads(config["problem"]["robot"])
    shown = "view runs/x runs/x/best.json gone.py --frames 20 --precision f64 --out page.html"
    code, out, _ = morpholab(f"{shown} {QUICK}")
    assert code == 0 and [line.partition(":")[0] for line in out.splitlines()[:3]] == [
        "x on hill",
        "best on flat",
        "gone on flat",
    ]
    (tmp_path / "gone.py").write_text(MINE.replace("0.1)", "0.2)"))
    code, _, error = morpholab(f"codesign --resume --robot gone.py --out runs/x {QUICK}")
    assert code == 2 and "robot: gone.py is not the robot of the run in runs/x; leave it out" in error


@pytest.mark.kernels
def test_what_serves_instead_of_a_target_is_told_and_works(morpholab, mine):
    code, _, error = morpholab(f"codesign --robot my_robot.py --target 1,0 --out a {QUICK}")
    told = "target: it is an option of other kinds (freeform robot); give --terrain flat+light:X,Y, or set target of a "
    assert code == 2 and told in error and error.endswith("so search with --objective minimise:remaining\n")
    search = "--terrain flat+light:1,0 --objective minimise:remaining --climbers 1 --generations 0 --out a --json"
    code, out, error = morpholab(f"codesign --robot my_robot.py {search} {QUICK}")
    assert code == 0 and -1.1 < json.loads(out)["best"] < -0.9, error


DRIFT = """
import dataclasses
from morpholab import OwnMeasure

def sideways(motion):
    from power_of_mine import POWER

    return (motion.centres(motion.ended) - motion.centres(motion.began))[:, 1] ** POWER

robot = dataclasses.replace(robot, own_measures=(OwnMeasure("drift", "m^2", law=sideways),))
"""


@pytest.mark.kernels
def test_a_measure_that_only_a_users_file_defines_is_searched(morpholab, tmp_path):
    """A run folder tells of it without its code: the file is given again to go on, and what is seen lacks it."""
    (tmp_path / "my_robot.py").write_text(MINE + DRIFT)
    (tmp_path / "power_of_mine.py").write_text("POWER = 2\n")
    search = f"codesign --robot my_robot.py --climbers 2 --generations 1 --objective minimise:drift {QUICK} --json"
    code, out, error = morpholab(f"{search} --out a")
    assert code == 0 and json.loads(out)["best"] < 0 and error == ""
    assert morpholab(f"{search} --out b --workers 1")[0] == 0
    assert Path("a/best.json").read_bytes() == Path("b/best.json").read_bytes()
    (tmp_path / "task.toml").write_text('robot = "my_robot.py"\nobjective = "minimise:drift"\nclimbers = 2\n')
    assert morpholab(f"codesign --task task.toml --generations 1 --out c {QUICK}")[0] == 0
    assert Path("a/best.json").read_bytes() == Path("c/best.json").read_bytes()
    further = f"codesign --resume --out a --generations 2 {QUICK}"
    again = "give --robot my_robot.py again, which alone defines drift"
    assert morpholab(further)[::2] == (2, f"morpholab codesign: error: robot: is missing for the run in a; {again}\n")
    assert morpholab(f"{further} --robot my_robot.py")[0] == 0
    code, out, error = morpholab(f"{further} --robot my_robot.py --workers-dir w")
    assert code == 2 and "is not told by data alone" in error
    assert morpholab(f"view a --frames 20 --out a.html {QUICK}")[0] == 0
    assert morpholab("report a --out report.html --quiet")[0] == 0 and "drift" in Path("report.html").read_text()
    (tmp_path / "my_robot.py").write_text(MINE + DRIFT.replace("** POWER", "** 4"))
    code, _, error = morpholab(f"{further} --robot my_robot.py")
    assert code == 2 and f"robot: my_robot.py is not the robot of the run in a; {again}" in error


def test_every_law_of_links_is_an_option():
    assert LINKS_OPTION.choices == LINK_LAWS and USUAL == USUAL_LINKS


@pytest.mark.kernels
def test_a_run_keeps_the_law_of_links_with_which_it_was_begun(morpholab, tmp_path, mine):
    """And so do its designs; what is saved of a robot with the usual one says nothing of it."""
    search = f"codesign --robot my_robot.py --climbers 2 --generations 1 {QUICK} --json"
    found, best = [], {}
    for law in ("alike", "balanced"):
        best[law] = json.loads(morpholab(f"{search} --links {law} --out {law}")[1])["best"]
        for name in ("config.toml", "best.json"):
            assert ("balanced" in (tmp_path / law / name).read_text()) == (law == "balanced")
    for options in ("alike/best.json", "alike/best.json --links balanced", "balanced/best.json"):
        found.append(json.loads(morpholab(f"simulate --robot {options} {QUICK} --json")[1])["speed"])
    assert [found[0], found[2]] == list(best.values()) and found[0] != found[1]
    (tmp_path / "grid.py").write_text(
        "from robots.freeform import *\nrobot = FreeformRobot(Grid((3, 2, 2)), full=True)\n"
    )
    more = "--climbers 2 --generations 0 --links balanced --out grid"
    assert morpholab(f"codesign --robot grid.py {more} {QUICK}")[0] == 0
    assert "balanced" in (tmp_path / "grid" / "best.json").read_text()
    code, _, error = morpholab(f"export balanced --voxels b.vxa {QUICK}".replace("--threads 1 --quiet", ""))
    assert code == 2 and "links: balanced is not allowed in a .vxa" in error
    code, _, error = morpholab(f"simulate --robot my_robot.py --links tight {QUICK}")
    assert code == 2 and "argument --links: invalid choice: 'tight'" in error


@pytest.mark.kernels
def test_a_search_is_the_same_with_workers(morpholab, mine):
    lines = [f"codesign --robot my_robot.py --climbers 4 --generations 1 --out {name} --quiet" for name in ("a", "b")]
    assert morpholab(f"{lines[0]} --threads 1")[0] == 0 and morpholab(f"{lines[1]} --workers 1 --threads 1")[0] == 0
    assert Path("a/best.json").read_bytes() == Path("b/best.json").read_bytes()


def test_modules_beside_a_users_file_are_its_own(morpholab, tmp_path, monkeypatch):
    """Also where the user's program, or the file of another folder, has imported one of the same name."""
    programs = ModuleType("cycles_of_mine")
    programs.__file__, programs.COUNT = str(tmp_path / "cycles_of_mine.py"), 9
    monkeypatch.setitem(sys.modules, "cycles_of_mine", programs)
    for folder, cycles in (("a", 1), ("b", 2), ("a", 1)):
        (tmp_path / folder).mkdir(exist_ok=True)
        (tmp_path / folder / "cycles_of_mine.py").write_text(f"COUNT = {cycles}\n")
        mine = MINE.replace("cycles=1", "cycles=COUNT")
        (tmp_path / folder / "mine.py").write_text(f"from cycles_of_mine import COUNT\n{mine}")
        assert find_robot(f"{folder}/mine.py")[0].build(f"{folder}/mine.py", {}).cycles == cycles
        assert sys.modules["cycles_of_mine"] is programs


def test_functions_of_a_users_problem_import_the_modules_beside_it(tmp_path):
    lines = (
        "bounds = {'x': (0, 1)}",
        "def evaluate(points):",
        "    import slope_of_mine",
        "    return slope_of_mine.of(points)",
    )
    problems = []
    for folder, slope in (("a", 1.0), ("b", 2.0)):
        (tmp_path / folder).mkdir()
        module = f"CALLS = []\ndef of(points):\n    CALLS.append(1)\n    return {slope} * len(CALLS) * points[:, 0]\n"
        (tmp_path / folder / "slope_of_mine.py").write_text(module)
        (tmp_path / folder / "problem.py").write_text("\n".join(lines))
        problems.append(load_problem(tmp_path / folder / "problem.py"))
    assert [problem.evaluate([[0.5]]).objectives[0, 0] for problem in (*problems, *problems)] == [0.5, 1.0, 1.0, 2.0]


@pytest.mark.filterwarnings("ignore:model. ignored")
def test_a_robot_without_gradients_leaves_no_folder(morpholab, tmp_path):
    (tmp_path / "crawler.xml").write_text(CRAWLER)
    lines = "from robots.articulated import load_robot", "from morpholab import RobotProblem"
    (tmp_path / "crawling.py").write_text("\n".join([*lines, "problem = RobotProblem(load_robot('crawler.xml'))"]))
    for given in ("--robot crawler.xml", "--problem crawling.py"):
        code, _, error = morpholab(f"codesign {given} --method gradient --out new --quiet")
        assert code == 2 and "error: friction: 1 has no derivatives; give inf" in error
        assert not (tmp_path / "new").exists()


@pytest.mark.kernels
def test_a_picture_of_a_moment_is_within_the_motion(morpholab, mine):
    shown = "view my_robot.py --frames 9 --precision f64 --picture"
    assert morpholab(f"{shown} a.png --at 0.45 {QUICK}")[0] == 0
    assert "error: at: 0.55 s is not allowed; robot moves for 0.5 s\n" in morpholab(f"{shown} b.png --at 0.55")[2]


@pytest.mark.kernels
def test_an_objective_that_is_the_same_in_all_designs_is_noted(morpholab, mine):
    search = "codesign --robot my_robot.py --method nsga2 --population 4 --generations 0 --threads 1"
    code, _, error = morpholab(f"{search} --objective speed --objective mass --out a")
    told = r"note: objective: mass tells no design from another so far: it is 0.\d+ kg in all 4 designs that the search"
    assert code == 0 and len(re.findall(told, error)) == error.count("note: ") == 1
    assert "note: " not in morpholab(f"{search} --objective speed --objective energy --out b")[2]


@pytest.mark.kernels
@pytest.mark.filterwarnings("ignore:model. ignored")
def test_a_users_file_may_set_a_robot_of_another_kind(morpholab, tmp_path):
    """It is told in the world of that kind."""
    (tmp_path / "crawler.xml").write_text(CRAWLER)
    source = "from robots.articulated import load_robot\nrobot = load_robot('crawler.xml', duration=0.1)\n"
    (tmp_path / "dog.py").write_text(source)
    code, out, error = morpholab("simulate --robot dog.py --threads 1 --json --quiet")
    assert code == 0 and json.loads(out)["world"] == "flat", error
    direct = json.loads(morpholab("simulate --robot crawler.xml --duration 0.1 --threads 1 --json --quiet")[1])
    assert {**json.loads(out), "robot": ""} == {**direct, "robot": ""}


@pytest.mark.kernels
@pytest.mark.filterwarnings("ignore:model. ignored")
def test_a_robot_of_a_file_is_simulated_and_designed_on_sand(morpholab, tmp_path):
    (tmp_path / "crawler.xml").write_text(CRAWLER)
    asked = "--robot crawler.xml --duration 0.3 --threads 1 --quiet --json"
    code, out, error = morpholab(f"simulate {asked} --terrain sand:2e5")
    assert code == 0 and json.loads(out)["world"] == "sand:2e5" and json.loads(out)["status"] == "ok", error
    search = "--method hill-climb --climbers 2 --generations 2 --out dunes"
    code, out, error = morpholab(f"codesign {asked} --terrain rough:0.02+sand:2e5 {search}")
    assert code == 0 and Path("dunes/best.json").exists(), error


HOPPER = """
from robots.robot import Measure, Outcome, Parameter, Robot

class Hopper(Robot):
    kind = "hopper"
    parameters = (Parameter("push", 0.0, 40.0),)
    measures = (Measure("height", "m"),)

    def run(self, points, trial):
        return Outcome({"height": points[:, 0]})

robot = Hopper()
"""


@pytest.mark.parametrize(
    "command",
    [
        "codesign --robot hopper.py --out r",
        "simulate --robot hopper.py",
        "measure --robot hopper.py --success 'height >= 1' --out r",
        "view hopper.py --out h.html",
        "gradient-check --robot hopper.py",
    ],
)
def test_a_robot_of_a_kind_that_is_not_registered_is_told_where_to_do_so(morpholab, tmp_path, command):
    (tmp_path / "hopper.py").write_text(HOPPER)
    code, out, error = morpholab(f"{command} --quiet")
    told = "hopper.py: robot: the kind 'hopper' of Hopper is not registered; add it by an entry point, see docs/ext"
    assert code == 2 and out == "" and error.count("\n") == 1 and told in error and not (tmp_path / "r").exists()


@pytest.mark.kernels
def test_gradients_of_a_users_file_are_checked_and_followed(morpholab, mine):
    line = f"gradient-check --robot my_robot.py --horizons 1 --directions 2 --samples 2 --json {QUICK}"
    code, out, _ = morpholab(line)
    (horizon,) = json.loads(out)["horizons"]
    assert code == 0 and horizon["name"] == "1 cycle" and min(horizon["errors"]) < 1e-4
    search = "--method gradient --climbers 2 --generations 2"
    code, out, _ = morpholab(f"codesign --robot my_robot.py {search} --out c --json {QUICK}")
    assert code == 0 and json.loads(out)["best"] is not None


@pytest.mark.kernels
def test_a_mesh_is_designed_and_leaves_as_parts_table_and_voxels(morpholab, tmp_path):
    box = trimesh.creation.box((60, 20, 20))
    box.export(tmp_path / "body.stl")
    half = trimesh.creation.box((30, 20, 20))
    half.apply_translation([15, 0, 0])
    half.export(tmp_path / "half.stl")
    robot = "--robot body.stl --pitch 10 --region front=half.stl,amplitude=0.05:0.2 --cycles 1 --settling 0.05"
    code, out, error = morpholab(f"codesign {robot} --climbers 2 --generations 1 --out a {QUICK} --json")
    assert code == 0 and error == "" and set(json.loads(out)["best_point"]) == {"front_amplitude", "front_phase"}
    code, out, _ = morpholab("export a --parts parts.3mf --voxels body.vxl.json --csv t.csv --on-violation clip --json")
    document = json.loads(out)
    assert code == 0 and document["parts"]["written"] == ["body: 12 cm^3", "body, channel front: 12 cm^3"]
    assert read_channels("t.csv").waves[0].name == "front" and Path("body.vxl.json").is_file()
    assert read_channels("a/gait.csv").pressures.tolist() == read_channels("t.csv").pressures.tolist()
    assert morpholab("export a/best.json --parts mould --mould draft=3,wall=5 --voxels best.vxa")[0] == 0
    assert {path.name for path in Path("mould").iterdir()} == {"mould_lower.stl", "mould_upper.stl"}
    assert morpholab(f"view best.vxa --frames 5 --precision f64 --out v.html {QUICK}")[0] == 0
    (tmp_path / "fast.toml").write_text("[channels.bladder]\nslew_kpa_per_s = 1e5\n")
    assert morpholab("export a --csv fast.csv --rig fast.toml --full-scale 0.5:1.5")[0] == 0
    simulations = [f"simulate --robot a/best.json --threads 1 --json{more}" for more in ("", " --channels fast.csv")]
    own, played = (json.loads(morpholab(line)[1]) for line in simulations)
    assert played["distance"] == pytest.approx(own["distance"], rel=1e-4) and own["distance"] != 0
    code, out, _ = morpholab("export a --csv t.csv --dry-run --full-scale 0.5:1.5 --on-violation clip")
    assert code == 0 and "bladder1" in out


@pytest.mark.kernels
def test_a_mesh_without_muscles_is_seen_at_rest(morpholab, tmp_path):
    trimesh.creation.box((60, 20, 20)).export(tmp_path / "body.stl")
    body = "body.stl --pitch 10 --cycles 1 --settling 0.05"
    code, out, error = morpholab(f"view {body} --out a.html --picture a.png --strip b.png --frames 5 {QUICK}")
    assert code == 0 and out.startswith("body on flat: 24 parts, 5 frames")
    assert all(Path(name).is_file() for name in ("a.html", "a.png", "b.png"))
    note = "note: drives: nothing moves body, which rests; give a drive an amplitude, or of a mesh mark a muscle"
    assert error.count("\n") == 1 and note in error
    code, out, error = morpholab("codesign --robot body.stl --pitch 10 --out r")
    assert code == 2 and note in error and "error: robot: nothing of it is free to change; make some value" in error


def test_a_mesh_is_exported_with_what_makes_it_a_robot(morpholab, tmp_path):
    trimesh.creation.box((60, 20, 20)).export(tmp_path / "body.stl")
    half = trimesh.creation.box((30, 20, 20))
    half.apply_translation([15, 0, 0])
    half.export(tmp_path / "half.stl")
    line = "export body.stl --pitch 10 --region front=half.stl,amplitude=0.1 --parts parts.3mf --json"
    code, out, error = morpholab(line)
    assert (code, error) == (0, "")
    assert json.loads(out)["parts"]["written"] == ["body: 12 cm^3", "body, channel front: 12 cm^3"]


@pytest.mark.kernels
def test_phases_that_settle_at_rest_are_named(morpholab, tmp_path):
    (tmp_path / "tied.py").write_text(MINE.replace("Free(0.0, 1.0, 0.3)", "0.5"))
    line = f"gradient-check --robot tied.py --horizons 1 --directions 2 --samples 2 {QUICK}"
    code, _, error = morpholab(line)
    assert code == 0 and error.count("\n") == 1
    assert "note: phases: all are 0 or 0.5 (that of front, that of back), so nothing moves" in error


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("codesign --robot my_robot.py --pitch 5 --out r", "pitch: robot has its own; leave it out"),
        ("codesign --robot body.stl --out r", "pitch: body.stl is a mesh; give the edge of its voxels"),
        (
            "codesign --robot body.stl --pitch 10 --region a --out r",
            "argument --region: 'a' is not allowed; give NAME=",
        ),
        ("codesign --robot empty.stl --pitch 10 --region a=body.stl --out r", "mesh: "),
        ("codesign --robot body.stl --pitch 0 --region a=body.stl --out r", "pitch: 0.0 is not allowed"),
        ("export body.stl --parts a.3mf", "pitch: body.stl is a mesh; give the edge of its voxels"),
        ("export my_robot.py --pitch 5 --parts a.3mf", "pitch: robot has its own; leave it out"),
        ("export rolling --pitch 5 --csv a.csv", "pitch: it is an option of other kinds (lattice robot); leave it out"),
        ("export my_robot.py --mould draft=2", "mould: it needs a place; give --parts as well"),
        ("export my_robot.py --voxels a.vxa --rig dissertation", "rig: it shapes a table of pressures"),
        ("export my_robot.py --parts a.3mf --full-scale 0.1", "full-scale: it shapes a table of pressures"),
        ("export my_robot.py --parts a.3mf --mould draft=80", "draft: 80.0 is not allowed; give a number from 0 to 45"),
        ("export my_robot.py --parts a.3mf --mould wall=-1", "wall: -0.001 is not allowed; give a positive"),
        ("export my_robot.py --parts a.3mf --mould pull=x", "pull: undercut at voxel ("),
        ("export my_robot.py --parts a.step", "parts: a.step is not allowed; give a file that ends in .3mf or .stl"),
        ("export my_robot.py --csv a.csv", "bladder1: "),
        (
            "export my_robot.py --csv a.csv --full-scale none",
            "full-scale: 'none' is not allowed; give a positive number",
        ),
        ("simulate --robot my_robot.py --channels no.csv", "no.csv: cannot be read"),
        ("export rolling --parts a.stl", "parts: inflatable robot has no surfaces to print; leave it out"),
        ("export rolling --voxels a.vxa", "voxels: inflatable robot has no such file; leave it out"),
        ("export rolling --csv a.csv --full-scale 1", "full-scale: the rig's map says what pressures stand for"),
        ("codesign --robot none.py --out r", "robot: none.py is no file"),
        (
            "codesign --robot my_robot.py --free shape --out r",
            "free: it is an option of other kinds",
        ),
        ("codesign --robot my_robot.py --start-pressure 5 --out r", "start-pressure: it is an option of other kinds"),
        ("codesign --robot my_robot.py --terrain flat --terrain flat --out r", "terrain: flat, flat; give none twice"),
        ("gradient-check --robot my_robot.py --gait rolling", "gait: my_robot.py is a robot by itself; leave it out"),
        ("gradient-check --robot my_robot.py --horizons 0,1", "horizons: '0,1' is not allowed; give whole numbers"),
        ("codesign --robot fixed.py --out r", "robot: nothing of it is free to change; make some value Free"),
        ("view broken.py --quiet --out a.html", "broken.py: NameError: name 'x' is not defined"),
        ("view bomb.vxa --quiet --out a.html", "bomb.vxa: file: a document type is not allowed"),
    ],
)
def test_bad_input_is_told_in_one_line(morpholab, tmp_path, mine, line, message):
    fixed = MINE.replace("Free(0.0, 0.2)", "0.1").replace("Free(0.0, 1.0, 0.3)", "0.1")
    (tmp_path / "fixed.py").write_text(fixed)
    (tmp_path / "broken.py").write_text("x")
    (tmp_path / "bomb.vxa").write_text('<!DOCTYPE a [<!ENTITY b "b">]><VXA/>')
    trimesh.creation.box((60, 20, 20)).export(tmp_path / "body.stl")
    (tmp_path / "empty.stl").write_text("solid\nendsolid\n")
    code, out, error = morpholab(line)
    assert code == 2 and out == "" and error.count("\n") == 1 and message in error


def test_the_examples_are_short_and_load():
    from robots.robot import KINDS

    files = sorted(EXAMPLES.glob("*.py"))
    assert [path.stem for path in files] == ["flat_array", "freeform", "inchworm", "starfish", "voxel_walker"]
    for path in files:
        assert len(path.read_text().splitlines()) <= 40, path
        assert KINDS["lattice"].build(str(path), {}).parameters, path


@pytest.mark.kernels
def test_the_walker_of_voxcad_walks():
    from robots.lattice_robot import load_robot, simulate

    robot = load_robot(EXAMPLES / "voxel_walker.vxa")
    assert (robot.body.voxel_count, robot.body.region_count) == (48, 10)
    assert robot.drives[0].phase == pytest.approx((0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.25, 0.35, 0.65, 0.75))
    found = simulate(robot, threads=1)
    assert found.status[0] == "ok" and found.distance[0] > 0.03  # of 0.12 m of body, in a second


@pytest.mark.kernels
def test_friction_of_the_ground_is_in_the_run_and_in_the_command_of_its_report(morpholab, tmp_path, mine):
    run = "codesign --robot my_robot.py --terrain hill:3 --ground-friction 0.6,0.3 --climbers 2 --generations 0"
    assert morpholab(f"{run} --out a {QUICK}")[0] == 0
    config = tomllib.loads((tmp_path / "a/config.toml").read_text())["problem"]
    assert config["worlds"] == [{"slope": 3.0, "static_friction": 0.6, "kinetic_friction": 0.3}]
    assert morpholab("report a --no-player --quiet --out page.html")[0] == 0
    page = (tmp_path / "page.html").read_text()
    assert "--terrain hill:3 --ground-friction 0.6,0.3 " in page and "friction 0.6 static, 0.3 kinetic" in page
    best = "simulate --gait a/best.json --terrain hill:3 --precision f64 --threads 1 --json"
    speeds = [json.loads(morpholab(f"{best} {more}")[1])["speed"] for more in ("--ground-friction 0.6,0.3", "")]
    logged = json.loads((tmp_path / "a/log.jsonl").read_text().splitlines()[-1])["best"]
    assert speeds[0] == logged != speeds[1]
    code, _, error = morpholab(f"{best} --floor wood")
    assert code == 2 and "floor: it is an option of other kinds (inflatable robot); leave it out" in error


@pytest.mark.parametrize("command", ["simulate", "measure --success 'speed >= 1' --out new", "codesign --out new"])
def test_the_folder_of_a_run_is_told_its_design(morpholab, tmp_path, command):
    (tmp_path / "runs/x").mkdir(parents=True)
    code, _, error = morpholab(f"{command} --robot runs/x")
    assert code == 2 and error.endswith("error: robot: runs/x is a folder; give a file of a robot or a design\n")
    (tmp_path / "runs/x/best.json").write_text("{}")
    code, _, error = morpholab(f"{command} --robot runs/x")
    assert code == 2 and error.endswith("error: robot: runs/x is a folder; give runs/x/best.json\n")
    assert not (tmp_path / "new").exists()


def test_the_folder_of_a_run_is_no_gait(morpholab, tmp_path):
    (tmp_path / "x").mkdir()
    (tmp_path / "x/best.json").write_text("{}")
    assert "error: gait: x is a folder; give x/best.json\n" in morpholab("simulate --gait x")[2]


FEELING = """
import numpy as np
from robots.lattice_robot import Drive, Free, LatticeRobot, Reflexes
from taichi_sim.lattice import Material, body_from_array

rubber = Material(5e4, 1e3, static_friction=1.0, kinetic_friction=0.5, internal_damping=1.0)
filled = np.ones((4, 3, 3), int)
filled[1:3, 1, 1] = 0
places = np.stack(np.indices(filled.shape), axis=-1)
outward = (places == np.array(filled.shape) - 1).astype(int) - (places == 0)
outward[filled == 0] = 0
body = body_from_array(filled, (rubber,), 0.02, regions=filled - 1 + (places[..., 0] > 1), pressure_normals=outward)
wave = Drive("muscle", (0, 1), amplitude=0.1, phase=(0.1, 0.4))
reflexes = Reflexes(("pressure", "clock"))
robot = LatticeRobot(body, (wave, Drive("core", (0, 1), "pressure", mean=500.0)), cycles=1, reflexes=reflexes)
"""


@pytest.mark.kernels
def test_a_robot_that_feels_its_chamber_is_designed_measured_and_seen(morpholab, tmp_path):
    """A weight for each number that is felt, and one more, of either muscle; and the search goes on."""
    (tmp_path / "feeling.py").write_text(FEELING)

    def ask(line):
        code, out, error = morpholab(f"{line} --quiet")
        assert code == 0, error
        return out

    found = json.loads(ask("codesign --robot feeling.py --climbers 2 --generations 0 --out run --json --threads 1"))
    assert list(found["best_point"]) == [f"reflex_{number + 1}" for number in range(8)]
    words = "--controllers 2 --success speed>=-9 --precision f64 --out measured --json --threads 1"
    assert json.loads(ask(f"measure --robot feeling.py {words}"))["each"][0]["count"] == 2
    (tmp_path / "feeling.py").unlink()
    found = json.loads(ask("codesign --resume --generations 1 --out run --json --threads 1"))
    told = json.loads(ask("simulate --robot run/best.json --precision f64 --json --threads 1"))
    assert told["speed"] == found["best"]
    ask("view run/best.json --frames 5 --precision f64 --out seen.html --threads 1")
    ask("report run --frames 5 --out page.html")
    assert "feels pressure and clock" in (tmp_path / "page.html").read_text()


@pytest.mark.parametrize(
    "line",
    [
        "simulate --robot {}",
        "gradient-check --robot {}",
        "codesign --robot {} --out out",
        "codesign --task task.toml --out out",
        "measure --robot {} --success speed>=0 --out out",
        "view {} --out out.html",
    ],
)
@pytest.mark.parametrize("name", ["open.py", "open.json"])
def test_a_robot_without_a_chamber_to_feel_is_refused_in_one_line(morpholab, tmp_path, line, name):
    """By the file and in it: what it lacks, before any work."""
    source = FEELING.replace("outward[filled == 0] = 0", "outward[:] = 0").replace("mean=500.0", "mean=0.0")
    source = source.replace(', Drive("core", (0, 1), "pressure", mean=0.0)', ",")
    (tmp_path / "open.py").write_text(source)
    (tmp_path / "task.toml").write_text(f'robot = "{name}"\n')
    if name.endswith("json"):
        from robots.lattice_robot import load_robot, save_robot

        (tmp_path / "plain.py").write_text(source.replace('"pressure", "clock"', '"strain", "clock"'))
        save_robot(load_robot(tmp_path / "plain.py"), tmp_path / name)
        record = json.loads((tmp_path / name).read_text())
        record["reflexes"]["senses"] = ["pressure", "clock"]
        (tmp_path / name).write_text(json.dumps(record))
    code, out, error = morpholab(line.format(name))
    assert code == 2 and not out and not list(tmp_path.glob("out*"))
    assert error.count("\n") == 1 and "senses: pressure is not allowed for a body without a chamber; give " in error
