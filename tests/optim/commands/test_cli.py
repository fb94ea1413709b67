"""The command line, with a stand-in for the simulator."""

import json
import re

import numpy as np
import pytest

from optim.problems.inflatable.problem import GaitProblem
from optim.runs.config import read_config
from robots import inflatable
from robots.hardware import export_csv, read_csv
from robots.inflatable import INCHING, ROLLING, load_design, save_design
from robots.inflatable.schedule import GaitSchedule
from robots.world import Terrain

pytestmark = pytest.mark.usefixtures("simulator")


# simulate


def test_simulate_says_how_fast(morpholab, simulator):
    code, out, _ = morpholab("simulate --gait rolling")
    assert code == 0
    way = r"distance 0.40\d+ m, 0.0000 m to the (left|right), speed 0.1000 BL/s"
    assert re.search(rf"rolling on flat: ok after [\d,]+ steps\n{way}", out)
    (call,) = simulator.calls
    assert call.designs == [ROLLING] and call.terrain == Terrain()
    assert (call.precision, call.device, call.threads, call.seed, call.perturbation) == (
        "f64",
        "cpu",
        None,
        0,
        0.0,
    )
    assert call.geometry is inflatable.NAMED_GEOMETRIES["published"] and call.actuation == inflatable.ACTUATION


def test_simulate_takes_every_option(morpholab, simulator):
    code, out, _ = morpholab(
        "simulate --gait inching --slope 15 --pressure 300 --orientation 45 --precision f32 "
        "--threads 2 --device cpu --columns 3 --repeats 1 --geometry small --weight physical "
        "--perturbation 1e-6 --seed 4 --json"
    )
    (call,) = simulator.calls
    schedule = GaitSchedule(INCHING.schedule.bits[:, :3], repeats=1)
    assert call.designs == [inflatable.InflatableDesign(300.0, 45.0, schedule)] and call.terrain == Terrain(15.0)
    assert (call.precision, call.threads, call.seed, call.perturbation) == ("f32", 2, 4, 1e-6)
    assert call.geometry is inflatable.NAMED_GEOMETRIES["small"] and call.actuation.weight == "physical"
    document = json.loads(out)  # nothing of the chatter
    assert code == 0 and document["status"] == "ok" and document["terrain"] == "hill:15"
    assert document["speed_simulated"] == 2 * document["speed"] == document["distance"] / 2
    assert document["sideways"] == pytest.approx(0.0, abs=1e-12)


def test_simulate_writes_a_folder(morpholab, tmp_path):
    save_design(ROLLING, tmp_path / "my.json")
    code, out, _ = morpholab("simulate --gait my.json --out out --record-every 100 --json")
    assert code == 0
    assert load_design(tmp_path / "out/design.json") == ROLLING
    assert json.loads((tmp_path / "out/result.json").read_text()) == json.loads(out)
    assert read_csv(tmp_path / "out/gait.csv").schedule() == ROLLING.schedule
    assert (tmp_path / "out/robot.png").exists()
    assert np.load(tmp_path / "out/frames.npz")["times"].shape == (3,)
    code, out, error = morpholab("simulate --gait rolling --out out")
    assert (code, out, error) == (
        2,
        "",
        "morpholab simulate: error: out: out exists and is not empty; name a new folder\n",
    )


def test_of_a_run_and_of_several_seeds_the_best_design_is_simulated(morpholab, simulator, tmp_path):
    search = "codesign --terrain flat --geometry small --columns 4 --climbers 2 --generations 1 --quiet --seeds 0-2"
    best = [run["best"] for run in json.loads(morpholab(f"{search} --out g --json")[1])["runs"]]
    first = f"g/seed-{best.index(max(best))}"
    told = f"note: g has runs of several seeds; the best one is {first}\n"
    for flag, name in (("--robot", first), ("--gait", first), ("--robot", "g")):
        code, out, error = morpholab(f"simulate {flag} {name} --quiet")
        assert code == 0 and f"\n{name} on flat: ok" in out and (told in error) == (name == "g")
        assert simulator.calls[-1].designs == [load_design(tmp_path / first / "best.json")]
        assert simulator.calls[-1].geometry is inflatable.NAMED_GEOMETRIES["small"]
    code, _, error = morpholab("export g --csv g.csv --on-violation clip")
    assert code == 0 and told in error
    assert read_csv(tmp_path / "g.csv").schedule() == load_design(tmp_path / first / "best.json").schedule
    code, _, error = morpholab("simulate --robot g --gait rolling")
    assert code == 2 and "gait: g is a robot by itself; leave it out" in error


def test_a_table_of_channels_is_no_gait(morpholab, tmp_path):
    (tmp_path / "a.csv").write_text("# schema=morpholab-channels-1\n")
    code, _, error = morpholab("simulate --gait a.csv")
    assert (
        code == 2 and "error: a.csv: it has channels of a robot of another kind, and no gait; use it as --cha" in error
    )
    assert error.endswith("with the robot that it drives: --robot BEST.json --channels FILE.csv\n")


def test_simulate_reports_a_failure(morpholab, simulator):
    simulator.diverges = lambda design, terrain: True
    code, out, _ = morpholab("simulate --gait rolling --json")
    assert code == 1 and json.loads(out)["status"] == "diverged" and json.loads(out)["speed"] is None
    code, out, _ = morpholab("simulate --gait rolling")
    assert code == 1 and "diverged" in out


# bad input


BAD_SIMULATE = [
    ("--slope nan", "argument --slope: nan is not allowed; give a number from -45 to"),
    ("--slope steep", "argument --slope: 'steep' is not allowed"),
    ("--slope 50", "argument --slope: 50 is not allowed"),
    ("--pressure -1", "argument --pressure: -1 is not allowed"),
    ("--pressure 16000", "pressure: 16000.0 is not allowed; give a number from 0 to"),
    ("--orientation 91", "argument --orientation: 91 is not allowed"),
    ("--columns 9", "columns: 9 is not allowed; the gait has 8"),
    ("--columns 0", "argument --columns: 0 is not allowed; give a whole number, at least 1"),
    ("--repeats 1.5", "argument --repeats: 1.5 is not allowed; give a whole number"),
    ("--seed -1", "argument --seed: -1 is not allowed"),
    ("--threads 0", "argument --threads: 0 is not allowed"),
    ("--geometry big", "argument --geometry: invalid choice: 'big'"),
    ("--record-every 5", "record-every: the poses need a folder; give --out"),
    (f"--seed {'9' * 400}", f"argument --seed: {'9' * 100}... is not allowed; give a whole number, at most"),
    (f"--slope {'9' * 400}", f"argument --slope: {'9' * 100}... is not allowed; give a number from -45"),
    ("--repeats 1000000", "repeats: 1000000 is not allowed; give a whole number, at most 100000"),
    ("--out broken.json/x", "out: broken.json is a file; name a new folder"),
]
BAD_CODESIGN = [
    ("--terrain flat", "terrains: flat, flat given"),
    ("--free legs", "free: 'legs' is unknown; give some of orientation,shape,control"),
    ("--free ''", "free: '' is unknown"),
    ("--free control,control", "free: control,control is not allowed; give none twice"),
    ("--free orientation --encoding bits", "encoding: 'bits' is not used; the control is fixed"),
    ("--method best", "argument --method: 'best' is unknown; choose one of borg, cma"),
    ("--climbers 0", "argument --climbers: 0 is not allowed"),
    ("--generations -1", "argument --generations: -1 is not allowed"),
    ("--pressure 5", "pressure: 5 would fix what is free; take shape out of --free"),
    ("--gait rolling", "gait: rolling is not used"),
    ("--start-pressure 13000", "argument --start-pressure: 13000 is not allowed"),
    ("--free shape --start-orientation 5", "start: orientation not free to change"),
    ("--method random --start-pressure 5", "start: method random does not take it"),
]
BAD_LINES = [
    ("simulate --gait rollin", "gait: 'rollin' is neither a known gait (inching, rolling) nor a file"),
    ("simulate", "gait: none is given; name a gait or a design"),
    ("simulate --gait broken.json", "broken.json: "),
    ("codesign --out new", "terrain: none given; say where"),
    ("codesign --out new --resume", "out: new holds no run to continue; `morpholab status .` lists"),
    ("codesign --out new --task gone.toml", "task: gone.toml cannot be read (No such file or directory)"),
    ("codesign --out new --terrain hill:abc", "argument --terrain: 'hill:abc' is unknown"),
    (
        f"codesign --out new --terrain {'b' * 300}.npy:0.1",
        "argument --terrain: " + "b" * 300 + ".npy: cannot be used (File name",
    ),
    ("codesign --out new --terrain hill:nan", "argument --terrain: slope: nan is not allowed"),
    ("codesign --out new --terrain hill:5+water:0", "argument --terrain: slope: 5.0 is not allowed with water"),
    ("codesign --out broken.json --terrain flat", "out: broken.json is a file; name a new folder"),
    ("codesign --out new --terrain flat --columns 1e16", "columns: 10000000000000000 is not allowed; give a whole"),
    ("codesign --out new --terrain flat --encoding graded --steps 1e12", "steps: 1000000000000 is not allowed; give a"),
    ("gradient-check --out broken.json/x", "out: broken.json is a file; name a new folder"),
    ("reproduce --out new", "out: new is not allowed without a study; name one first"),
    ("calibrate --example new/a.toml", "path: new/a.toml cannot be written; there is no folder new"),
    ("export rolling --csv a.csv --plot new/x.png", "plot: new/x.png cannot be written; there is no folder new"),
    ("export rolling --csv a.png --plot a.png", "plot: a.png is the table, too; name another file"),
    ("export rolling --csv .", "csv: . is a folder; name a file"),
    ("export nothing --csv a.csv", "source: 'nothing' is no robot (inching, rolling, "),
    ("export broken.json --csv a.csv", "broken.json: "),
    ("codesign --out new --terrain flat --workers 100000", "argument --workers: 100000 is not allowed; give a whole"),
    ("view rolling --out page.png", "out: page.png is not allowed; give a name that ends in .html or .htm"),
    ("walk", "argument COMMAND: invalid choice: 'walk'"),
    ("simulate --gait rolling --prec f64", "unrecognized arguments: --prec f64; give --precision"),
    ("simulat --gait rolling", "argument COMMAND: invalid choice: 'simulat' ("),
    ("simulate --gait rolling --terain flat", "unrecognized arguments: --terain flat; did you mean --terrain?"),
    ("simulate --robot articulated --fricton=0.5", "unrecognized arguments: --fricton=0.5; did you mean --friction?"),
    (
        "simulate rolling",
        "unrecognized arguments: rolling; name a robot as --robot rolling or a gait as --gait rolling\n",
    ),
    ("gradient-check rover", "unrecognized arguments: rover; name a robot as --robot rover or a gait as "),
    ("view --robot rover --out a.html", "--robot: is no option here; give the robot by itself: morpholab view rover"),
    ("export --gait=rolling --csv a.csv", "--gait: is no option here; give the robot by itself: morpholab export rol"),
    ("simulate --robot rover --orientaton 2", "unrecognized arguments: --orientaton 2\n"),  # of others
    (
        "simulate --robot soft-quadruped --friction 0.5,0.4",
        "argument --friction: '0.5,0.4' is not allowed; give one number, of the body of a mesh, or friction of the "
        "ground as --ground-friction STATIC,KINETIC",
    ),
    ("view rolling --picture a.png --at 99", "at: 99 s is not allowed; rolling moves for 19.8 s"),
    ("view soft-quadruped --picture a.png --at 2", "at: 2 s is not allowed; soft quadruped moves for 1.25 s"),
    ("view rover --picture a.png --at 140", "at: 140 s is not allowed; rover 6553 moves for 125 s"),
    ("view quadruped --picture a.png --at 60", "at: 60 s is not allowed; legged quadruped moves for 49.95 s"),
    ("view vehicle --picture a.png --at 99999", "at: 99999 s is not allowed; vehicle 6553 moves for 500 s"),
    ("simulate --gait rolling --device cup", "argument --device: invalid choice: 'cup' (choose from "),
    ("", "the following arguments are required: COMMAND"),
]
BAD_LINES += [(f"simulate --gait rolling {options}", message) for options, message in BAD_SIMULATE]
BAD_LINES += [(f"codesign --out new --terrain flat {options}", message) for options, message in BAD_CODESIGN]


@pytest.mark.parametrize(
    "line",
    [
        "codesign --terrain flat --out",
        "track r --tensorboard",
        "work",
        "report r --rig",
        "calibrate --example",
        "export",
        "simulate --gait inching --calibration",
        "codesign --out a --task",
        "play",
    ],
)
def test_an_empty_path_is_not_the_working_directory(morpholab, tmp_path, line):
    code, _, error = morpholab(f"{line} ''")
    assert code == 2 and "'' is not allowed; give a path" in error and error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_what_was_likely_meant_ends_a_refusal(morpholab):
    for line, meant in (("simulat --gait rolling", "simulate"), ("simulate --gait rolling --device cup", "cpu")):
        assert morpholab(line)[2].endswith(f"); did you mean {meant}?\n")


def test_help_tells_how_to_see_the_options_of_a_robot(morpholab):
    for command in ("simulate", "codesign", "measure", "gradient-check"):
        assert "add --robot FILE, or --robot KIND, to see those" in " ".join(morpholab(f"{command} --help")[1].split())
    assert "--robot" not in morpholab("status --help")[1]


@pytest.mark.parametrize(("line", "message"), BAD_LINES)
def test_bad_input_is_one_line(morpholab, simulator, tmp_path, line, message):
    (tmp_path / "broken.json").write_text('{"pressure": ')
    code, out, error = morpholab(line)
    assert (code, out) == (2, "")
    assert error.startswith("morpholab") and f"error: {message}" in error and error.count("\n") == 1
    assert simulator.calls == [] and [path.name for path in tmp_path.iterdir()] == ["broken.json"]


# export (see test_export_command too) and bench


def test_any_design_that_a_search_keeps_can_be_exported(morpholab, tmp_path):
    both = "--terrain flat --terrain hill:15 --method nsga2 --population 8 --generations 1 --seed 2"
    morpholab(f"codesign --out runs/a {both} --geometry small --columns 1 --repeats 1 --quiet")
    front = json.loads((tmp_path / "runs/a/front.json").read_text())["designs"]
    problem = GaitProblem.from_description(read_config(tmp_path / "runs/a")["problem"])
    for number, kept in enumerate(front, 1):
        assert morpholab(f"export runs/a --member {number} --csv a.csv")[0] == 0
        export_csv(problem.design(problem.space.from_dict(kept["point"])), tmp_path / "b.csv", seed=2)
        assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    code, _, error = morpholab(f"export runs/a --member {len(front) + 1} --csv a.csv")
    assert code == 2 and f"runs/a keeps {len(front)} designs\n" in error
    assert "as runs/a/best.json is the file of one" in morpholab("export runs/a/best.json --member 1 --csv a.csv")[2]


def test_versions_are_told(morpholab):
    code, out, _ = morpholab("--version")
    assert (
        code == 0
        and re.match(r"morpholab \d+\.\d+\.\d+\S*, python 3\.\d+\.\d+, numpy \d", out)
        and out.count("\n") == 1
    )


def test_bench_forwards_its_options(morpholab, monkeypatch, tmp_path):
    seen = []
    (tmp_path / "lanes.py").touch()
    monkeypatch.setattr("robots.bench.lattice.main", lambda args: seen.append(args) or {"speed": 1})
    code, out, _ = morpholab("bench --quick --precision f32 --prototype lanes.py --json")
    assert code == 0 and json.loads(out) == {"speed": 1}
    assert (seen[0].quick, seen[0].precision, str(seen[0].prototype)) == (True, "f32", "lanes.py")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("vehicle --prototype lanes.py", "prototype: it is of the inflatable benchmark; leave it out with vehicle"),
        ("rigid --precision f32", "precision: it is of the inflatable benchmark; leave it out with rigid"),
        (
            "--device vulkan --against tree",
            "against: it is not of the benchmark of a device; leave it out with --device",
        ),
        ("inflatable --rigid-prototype a.py", "rigid-prototype: it is of the rigid benchmark; leave it out with"),
    ],
)
def test_bench_refuses_options_of_other_robots(morpholab, line, message):
    code, out, error = morpholab(f"bench {line}")
    assert (code, out) == (2, "") and f"error: {message}" in error and error.count("\n") == 1


@pytest.mark.parametrize(
    ("program", "expected"),
    [
        (None, (2, "error: prototype: lanes.py is no file\n")),
        ("raise SystemExit('no such precision')", (1, "failed: lanes.py ended with code 1: no such precision\n")),
        ("print('fast')", (2, "error: prototype: lanes.py prints no number after f32: on its last line\n")),
    ],
)
def test_a_reference_program_that_does_not_work_is_one_line(morpholab, tmp_path, program, expected):
    if program is not None:
        (tmp_path / "lanes.py").write_text(program)
    code, _, error = morpholab("bench inflatable --quick --precision f32 --prototype lanes.py")
    assert (code, error.partition("bench: ")[2]) == expected


@pytest.mark.kernels
def test_bench_refuses_a_device_that_is_not_there(morpholab):
    expected = "morpholab bench: error: device: 'metal' is not available on this machine; use 'cpu'\n"
    assert morpholab("bench --device metal") == (2, "", expected)
