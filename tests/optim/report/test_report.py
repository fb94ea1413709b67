"""``morpholab report``: pages that say what the files say, and need nothing else."""

import base64
import json
import re
from dataclasses import asdict, replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
from run_products import Kite, log, searched
from stand_in import Simulator

from optim.experiments.results import write_json
from optim.experiments.tables import write_table
from optim.problems.braitenberg import VehicleProblem
from optim.problems.lattice_robot import LatticeRobotProblem
from optim.problems.walker import WalkerProblem
from optim.studies.chapter2.settings import Interference
from robots.braitenberg import STARTS, VehicleTask
from robots.inflatable import NAMED_GEOMETRIES, load_design
from robots.inflatable.timing import nominal_steps
from robots.lattice_robot import load_robot
from robots.lattice_robot.walker import WalkerActuation
from robots.world import Terrain
from taichi_sim.base.results_folder import ResultsFolder

ROOT = Path(__file__).resolve().parents[3]
SIZE = "--geometry small --columns 4 --quiet"
VOID = {"meta", "img", "br", "hr", "input", "link"}


class Page(HTMLParser):
    """A page: whether its elements close, and what tests read of it."""

    def __init__(self, text):
        super().__init__()
        self.open, self.elements, self.numbers, self.words, self.scripts = [], [], [], [], {}
        self.feed(text)
        self.close()
        assert self.open == []
        names = [attributes["id"] for _, attributes in self.elements if attributes.get("id")]
        assert len(set(names)) == len(names)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.elements.append((tag, attributes))
        if tag == "data":
            self.numbers.append(float(attributes["value"]))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open[-1:] == ["script"]:
            name = self.elements[-1][1].get("id")
            self.scripts[name] = self.scripts.get(name, "") + data
        elif self.open[-1:] != ["style"]:
            self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]


@pytest.fixture
def reported(morpholab, tmp_path):
    """Reports runs without a player: the page and the document."""

    def report(line, more="--no-player"):
        code, out, error = morpholab(f"report {line} {more} --out page.html --json --quiet")
        assert (code, error) == (0, ""), error
        text = (tmp_path / "page.html").read_text()
        (tmp_path / "page.html").unlink()
        page = Page(text)
        assert_alone_and_accessible(page, text)
        return page, json.loads(out)

    return report


def assert_alone_and_accessible(page, text):
    for tag, attributes in page.elements:
        loads = [attributes.get(name) or "" for name in ("src", "href", "xlink:href", "action", "data")]
        assert all(load == "" or load.startswith(("#", "data:")) for load in loads), (tag, loads)
        assert tag != "link" and "@import" not in text
    assert all(attributes.get("alt") for attributes in page.all("img"))
    assert all(attributes.get("aria-label") for attributes in page.all("svg"))
    assert all(attributes.get("scope") in ("row", "col") for attributes in page.all("th"))
    assert page.all("html")[0]["lang"] == "en" and len(page.all("h1")) == 1
    links = {attributes["href"] for attributes in page.all("a")}
    assert links == {f"#{attributes['id']}" for attributes in page.all("section")}


def design(morpholab, out, more="--climbers 5", terrains="--terrain flat --terrain hill:15", generations=4):
    line = f"codesign {SIZE} {terrains} --generations {generations} {more} --out {out}"
    assert morpholab(line)[0] == 0


def about(page):
    """What the player in a page is told of its motions."""
    (player,) = page.all("iframe")
    return json.loads(Page(player["srcdoc"]).scripts["about"])


@pytest.mark.long
@pytest.mark.usefixtures("simulator")
def test_a_page_says_what_the_files_say(morpholab, reported, tmp_path):
    design(morpholab, "runs/a")
    page, document = reported("runs/a")
    lines, best = log(tmp_path / "runs/a"), load_design(tmp_path / "runs/a/best.json")
    last = lines[-1]
    assert (document["best"], document["evaluations"], document["state"]) == (last["best"], 25, "finished")
    assert document["design"]["pressure"] == best.pressure and document["design"]["orientation"] == best.orientation
    geometry, seconds = NAMED_GEOMETRIES["small"], nominal_steps(8) * NAMED_GEOMETRIES["small"].time_step
    for terrain in document["design"]["terrains"]:
        speed = last["best_details"][f"speed_{terrain['terrain']}"]
        assert terrain["speed"] == speed in page.numbers
        assert terrain["distance"] == pytest.approx(speed * geometry.body_length * seconds)
        assert terrain["distance"] in page.numbers
    assert {best.pressure / 1000, best.orientation, last["best"], 25.0} <= set(page.numbers)
    assert {line[name] for line in lines for name in ("best", "mean", "median", "evaluations")} <= set(page.numbers)
    told = [
        "Terrains flat, hill:15",
        "Free orientation, shape, control",
        "Method hill-climb",
        "Settings bounds reflect, climbers 5, streams climbers",
        "Seed 0",
        "4 of 4",
        "25 (0 failed)",
        "morpholab export runs/a --csv gait.csv",
        "--gait runs/a/best.json --terrain hill:15 --geometry small",
    ]
    assert [words for words in told if words not in page.text] == []
    about = json.loads((tmp_path / "runs/a/environment.json").read_text())
    assert f"numpy {about['versions']['numpy']}" in page.text
    files = {path.name for path in (tmp_path / "runs/a").iterdir() if not path.name.startswith(".")}
    assert all(name in page.text for name in files)


def test_a_copied_command_has_the_friction_of_the_run(morpholab, simulator, reported):
    ground = "--floor wood --bladder-friction 0.3 --weight physical"
    design(morpholab, "a", f"--climbers 2 {ground}", "--terrain hill:15", 1)
    page, document = reported("a")
    (line,) = re.findall(r"morpholab (simulate --gait \S+ --terrain .*?) Watch it", page.text)
    assert "--terrain hill:15 --friction 0.56,0.7 --bladder-friction 0.3 " in line and "--weight physical" in line
    assert "up a slope of 15°, friction 0.56,0.7 (wood), bladder friction 0.3" in page.text
    assert "Terrains hill:15 with friction 0.56,0.7 with bladder friction 0.3" in page.text
    (terrain,) = document["design"]["terrains"]
    assert (terrain["terrain"], terrain["friction"], terrain["bladder_friction"]) == ("hill:15", [0.56, 0.7], 0.3)
    code, out, _ = morpholab(f"{line} --json")
    assert code == 0 and json.loads(out)["friction"] == [0.56, 0.7]
    assert simulator.calls[-1].terrain == Terrain(15.0, 0.7, 0.56, bladder_friction=0.3)
    assert simulator.calls[-1].actuation.weight == "physical"


@pytest.mark.usefixtures("simulator")
def test_a_page_without_a_player_has_no_address_and_is_small(morpholab, tmp_path):
    design(morpholab, "a", terrains="--terrain flat")
    code, out, error = morpholab("report a --no-player --out page.html")
    text = (tmp_path / "page.html").read_text()
    assert (code, error) == (0, "") and re.match(r"page.html: \d+ kB\n", out) and len(text) < 300_000
    assert "http:" not in text and "https:" not in text and "<iframe" not in text
    assert morpholab("report a --no-player --out again.html")[0] == 0
    assert (tmp_path / "again.html").read_text() == text


def test_an_interrupted_run_says_how_far_it_came(morpholab, simulator, reported):
    simulator.interrupt_at = 3
    assert morpholab(f"codesign {SIZE} --terrain flat --climbers 5 --generations 4 --out cut")[0] == 130
    page, document = reported("cut")
    assert document["state"] == "interrupted" and document["generation"] == 1
    assert "It was interrupted after generation 1 of 4." in page.text
    assert "morpholab codesign --resume --out cut" in page.text


@pytest.mark.usefixtures("simulator")
def test_damage_that_can_be_read_around_is_told(morpholab, reported, tmp_path):
    design(morpholab, "a")
    for name in ("environment.json", "best.json", "timing.jsonl", "checkpoint.npz"):
        path = tmp_path / "a" / name
        path.write_bytes(path.read_bytes().replace(b":", b": ", 1)[:-20])
    page, document = reported("a")
    assert document["generation"] == 3 and document["best"] == log(tmp_path / "a")[3]["best"]
    assert [note.split()[0] for note in document["damages"]] == [
        "checkpoint.npz",
        "environment.json",
        "timing.jsonl",
        "best.json",
    ]
    assert all(note in page.text for note in document["damages"])


def test_a_run_in_which_all_failed_has_no_best_design(morpholab, simulator, reported):
    simulator.diverges = lambda design, terrain: True
    assert morpholab(f"codesign {SIZE} --terrain flat --climbers 2 --generations 1 --out a")[0] == 1
    page, document = reported("a")
    assert document["best"] is None and document["design"] is None
    assert "Every evaluation has failed." in page.text and "The best design" not in page.text


@pytest.mark.usefixtures("simulator")
def test_a_rig_that_cannot_play_the_gait(morpholab, reported, tmp_path):
    design(morpholab, "a", "--climbers 2 --pressure 8000 --free orientation,control", generations=1)
    (tmp_path / "rig.toml").write_text("[channels.core]\nmaximum_kpa = 30.0\n")
    page, document = reported("a", "--no-player --rig rig.toml")
    assert document["design"]["rig"]["exceeded"] and "exceeds a limit of this rig, and is refused" in page.text
    assert "exceeded (highest pressure)" in page.text and 30.0 in page.numbers
    code, _, error = morpholab("export a --csv gait.csv --rig rig.toml")
    assert code == 2 and "core: 33.3333 kPa" in error
    _, document = reported("a")
    assert not document["design"]["rig"]["exceeded"] and morpholab("export a --csv gait.csv")[0] == 0


@pytest.mark.long
@pytest.mark.usefixtures("simulator")
def test_several_runs_are_compared_as_compare_does(morpholab, reported):
    for seed in range(3):
        design(morpholab, f"runs/climb{seed}", f"--climbers 5 --seed {seed}")
        design(morpholab, f"runs/random{seed}", f"--method random --climbers 5 --seed {seed}", generations=3)
    page, document = reported("runs")
    compared = json.loads(morpholab("compare runs --json")[1])
    assert document["comparison"]["at"] == compared["at"] == 20
    assert document["comparison"]["groups"] == compared["groups"]
    assert document["comparison"]["differences"] == compared["differences"]
    effect = compared["differences"][0]["effect"]
    assert {effect["superiority"], effect["difference"], compared["groups"][0]["low"]} <= set(page.numbers)
    best = max(json.loads(morpholab("status runs --json")[1]), key=lambda run: run["best"])
    assert document["folder"] == best["folder"] and f"The best design is that of {best['folder']}" in page.text
    assert page.text.startswith("6 runs: inflatable robot")


@pytest.mark.long
@pytest.mark.usefixtures("simulator")
def test_fronts_and_elites(morpholab, reported, tmp_path):
    design(morpholab, "front", "--method borg --population 12")
    page, document = reported("front")
    members = json.loads((tmp_path / "front/front.json").read_text())["designs"]
    assert {value for member in members for value in member["objectives"]} <= set(page.numbers)
    assert "The Pareto front" in page.text and document["best"] in page.numbers
    design(morpholab, "elites", "--method map-elites --population 12", terrains="--terrain flat")
    page, _ = reported("elites")
    assert "The elites" in page.text and "elites by orientation and pressure" in str(page.all("svg"))


TWO = """
import numpy as np
bounds = {"x": (0, 1), "y": (0, 1)}
name = ["gain", "cost"]


def evaluate(points):
    x, y = points.T
    return np.column_stack([x - 0.2 * y**2, -(x**2) - 0.3 * y**2])
"""


@pytest.mark.long
def test_a_page_says_where_the_best_design_is_not_in_the_front(morpholab, reported, tmp_path):
    """NSGA-II forgets it, as the front has more designs than the population."""
    pytest.importorskip("pymoo")
    (tmp_path / "two.py").write_text(TWO)
    told = "The best design of the run, with a better mean, is not among them."
    for method, forgets in (("nsga2", True), ("borg --set epsilons=1e-6", False)):
        out = method[:4]
        line = f"codesign --problem two.py --method {method} --population 8 --generations 40 --out {out}"
        assert morpholab(line)[0] == 0
        members = json.loads((tmp_path / out / "front.json").read_text())["designs"]
        best = max(sum(member["objectives"]) / 2 for member in members)
        page, document = reported(out)
        assert (document["best"] > best) == forgets == (told in page.text)


@pytest.mark.long
@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("nothing --out a.html", "run: nothing does not exist; a report takes folders of runs, or one of a sweep, of"),
        ("empty --out a.html", "run: empty holds no run; a report takes folders of runs"),
        ("a --out a.txt", "out: a.txt is not allowed; its name must end in .html or .htm"),
        ("a --out there.html", "out: there.html exists; name a new file"),
        ("a --out no/where.html", "out: no/where.html cannot be written; there is no folder no"),
        ("none --out b.html", "run: none has no complete generation yet; continue it with --resume"),
        ("a steep --out b.html", 'run: a and steep are judged differently (terrains [{"slope": 0.0}] and [{"'),
        ("a --no-player --frames 9 --out b.html", "frames: there are none without a player"),
        ("a --frames 1 --out b.html", "argument --frames: 1 is not allowed"),
        ("a --rig a/best.json --out b.html", "rig: 'a/best.json' is neither a preset"),
        ("a --by seconds --out b.html", "by: a is not compared with others; leave it out"),
        ("broken --out b.html", "config.toml: is not as it was written"),
        (
            "unknown --out b.html",
            "unknown: robot: 'kite' is unknown; choose one of inflatable, ",
        ),
        ("a/best.json --out b.html", "run: a/best.json holds no run; a report takes"),
    ],
)
def test_what_cannot_be_reported_is_one_line(morpholab, simulator, tmp_path, line, message):
    (tmp_path / "empty").mkdir()
    (tmp_path / "there.html").write_text("mine")
    for name, terrain in (("a", "flat"), ("steep", "hill:30"), ("broken", "flat")):
        design(morpholab, name, "--climbers 2", f"--terrain {terrain}", generations=0)
    with (tmp_path / "broken/config.toml").open("a") as file:
        file.write("\n")
    simulator.calls, simulator.interrupt_at = [], 1
    assert morpholab(f"codesign {SIZE} --terrain flat --out none")[0] == 130
    simulator.interrupt_at = None
    searched(Kite(), tmp_path / "unknown")
    code, out, error = morpholab(f"report {line} --quiet")
    assert (code, out) == (2, "") and message in error and error.count("\n") == 1
    assert (tmp_path / "there.html").read_text() == "mine" and not (tmp_path / "b.html").exists()


@pytest.mark.kernels
def test_a_vehicle_in_motion(reported, tmp_path, monkeypatch):
    task = VehicleTask(STARTS, radius=0.5, time_step=0.5, steps=300)
    problem = VehicleProblem(task=task, threads=1)
    searched(problem, tmp_path / "a")
    page, document = reported("a", "--frames 40")
    (player,) = page.all("iframe")
    assert player["title"] and [motion["name"] for motion in about(page)] == [f"environment {n}" for n in (1, 2, 3, 4)]
    closest = [one["closest"] for one in document["design"]["environments"]]
    assert -sum(closest) == pytest.approx(document["best"], rel=1e-9) and set(closest) <= set(page.numbers)
    assert "Success matrix of the best body" in str(page.all("svg")) and document["frames"] <= 41
    monkeypatch.setattr("optim.report.assembly.MOST_BYTES", 1_000)
    _, smaller = reported("a", "--frames 40")
    assert smaller["bytes"] < document["bytes"] and len(smaller["notes"]) > 2 and smaller["frames"] == 2


@pytest.mark.kernels
def test_a_walker_in_motion(morpholab, reported, tmp_path):
    drive = WalkerActuation(settling=0.05, cycles=1)
    searched(WalkerProblem((2, 2, 1), actuation=drive, threads=1), tmp_path / "a", generations=0)
    why = "rig: no rig plays designs of a; leave it out"
    code, _, error = morpholab("report a --rig dissertation --out b.html --quiet")
    assert (code, error) == (2, f"morpholab report: error: {why}\n")
    page, document = reported("a", "--frames 20")
    last = log(tmp_path / "a")[-1]
    (terrain,) = document["design"]["terrains"]
    assert terrain["speed"] == terrain["replayed"] == last["best"] and terrain["distance"] in page.numbers
    assert len(page.all("iframe")) == 1 and "lattice of 2 x 2 x 1 voxels" in page.text


@pytest.mark.kernels
def test_a_robot_of_ones_own_in_motion(reported, tmp_path):
    robot = replace(load_robot(ROOT / "examples/inchworm.py"), cycles=1, settling=0.02)
    searched(LatticeRobotProblem(robot, threads=1), tmp_path / "a", generations=0)
    page, document = reported("a", "--frames 20")
    last = log(tmp_path / "a")[-1]
    (terrain,) = document["design"]["terrains"]
    assert terrain["speed"] == terrain["replayed"] == last["best"]
    assert document["design"]["values"] == last["best_point"] and set(robot.free) <= set(page.text.split())
    assert len(page.all("iframe")) == 1 and "robot: 24 voxels of 10 mm" in page.text


@pytest.mark.kernels
def test_the_best_gait_in_motion(morpholab, reported, tmp_path, monkeypatch):
    with monkeypatch.context() as quick:
        quick.setattr("robots.inflatable.simulation.simulate", Simulator())
        quick.setattr("robots.inflatable.view.picture.save_motion_picture", lambda *a, **_: a[2].write_text(""))
        line = f"codesign {SIZE} --columns 1 --repeats 1 --terrain flat --climbers 2 --generations 0 --threads 1"
        assert morpholab(f"{line} --out a")[0] == 0
    page, document = reported("a", "--frames 12")
    (terrain,) = document["design"]["terrains"]
    assert terrain["speed"] == log(tmp_path / "a")[-1]["best"] and abs(terrain["replayed"]) < 1
    assert {terrain["speed"], terrain["replayed"]} <= set(page.numbers) and 11 <= document["frames"] <= 13
    (strip,) = page.all("img")
    assert strip["alt"].startswith("Six poses of the best design on flat ground")
    assert [motion["name"] for motion in about(page)] == ["on flat ground"]


BRIEF = "--radius 1 --time-step 0.5 --steps 1000 --quiet"


@pytest.mark.kernels
def test_sweeps_and_training_have_pages(morpholab, reported, tmp_path):
    assert morpholab(f"sweep --designs 162,6553 --weights 9 {BRIEF} --out swept")[0] == 0
    page, document = reported("swept")
    rows = [line.split(",") for line in (tmp_path / "swept/table.csv").read_text().splitlines()[1:]]
    assert (document["kind"], document["bodies"], document["controllers each"]) == ("sweep", len(rows), 81)
    assert {float(cell) for row in rows for cell in row[1:]} <= set(page.numbers)
    assert len(page.all("svg")) == len(document["matrices"]) > 1
    methods = "--methods nes,random --repetitions 2 --budget-evaluations 8"
    assert morpholab(f"train --sample 3 {methods} {BRIEF} --out trained")[0] == 0
    page, document = reported("trained")
    assert document == document | {"kind": "training", "bodies": 3, "methods": ["nes", "random"]}
    assert page.text.count("random") >= 1 and "budget 8" in page.text
    code, _, error = morpholab("report swept trained --out b.html")
    assert code == 2 and "run: swept is a study; report it alone" in error


def test_a_study_of_interference_has_a_page(morpholab, reported, tmp_path):
    folder, settings = tmp_path / "a", Interference(population=3, steps=30)
    ResultsFolder(folder / "runs", "interference", asdict(settings))
    write_json(folder / "summary.json", {"runs": 2, "generations": 1, **asdict(settings)})
    header = ("definition", "measure", "fitness", "robot", "runs", "mean", "low")
    write_table(folder / "tables.csv", header, [("defined", "M1", "sum", "legged", 2, 9.0625, None)])
    (folder / "curves.png").write_bytes(b"a picture")
    page, document = reported("a")
    assert document == document | {"kind": "interference", "runs": 2, "generations": 1, "population": 3}
    assert "defined M1 sum legged 2 9.062" in page.text and 9.0625 in page.numbers
    assert base64.b64decode(page.all("img")[0]["src"].partition(",")[2]) == b"a picture"
    (tmp_path / "a/summary.json").unlink()
    code, _, error = morpholab("report a --out b.html")
    assert code == 2 and "run: a is a study of interference that has no tables yet" in error


@pytest.mark.usefixtures("simulator")
def test_a_folder_whose_name_is_no_utf_8(morpholab, tmp_path):
    for seed, name in enumerate("ab"):
        design(morpholab, f"runs/{name}", f"--climbers 5 --seed {seed}", "--terrain flat", generations=1)
        (tmp_path / "runs" / name).rename(tmp_path / f"runs/{name}\udcff")
    code, out, error = morpholab("report runs/a\udcff --no-player --quiet --json --out page.html")
    assert (code, error) == (0, "") and json.loads(out)["bytes"] == (tmp_path / "page.html").stat().st_size
    assert "runs/a\\udcff" in (tmp_path / "page.html").read_text()
    assert morpholab("report runs --no-player --quiet --out several.html")[0] == 0
    assert "runs/b\\udcff" in (tmp_path / "several.html").read_text()
