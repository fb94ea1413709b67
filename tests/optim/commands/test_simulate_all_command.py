"""``morpholab simulate-all``: a folder of robots as a ranking and a table."""

import json
import shutil

import numpy as np
import pytest
from articulated_files import CRAWLER
from voxel_files import vxa

from optim.cli import build_parser
from optim.experiments.tables import read_records
from robots.robot import KINDS

BODIES = {"long": (4, 1, 1), "square": (2, 2, 1), "flat": (3, 2, 1)}


@pytest.fixture
def bodies(tmp_path):
    """A folder of three voxel robots, a damaged one, and what is none."""
    folder = tmp_path / "bodies"
    folder.mkdir()
    for name, shape in BODIES.items():
        (folder / f"{name}.vxa").write_text(vxa(np.ones(shape, int)))
    (folder / "notes.txt").write_text("of the evolution")
    return folder


@pytest.mark.kernels
def test_a_folder_becomes_a_ranking_and_a_table(bodies, morpholab):
    code, out, err = morpholab("simulate-all bodies --out a --json --quiet")
    assert code == 0 and not err
    told = json.loads(out)
    rows = {row["source"]: row for row in told["robots"]}
    assert list(rows) == [f"bodies/{name}.vxa" for name in sorted(BODIES)]
    for name in BODIES:
        alone = json.loads(morpholab(f"simulate --robot bodies/{name}.vxa --json --quiet")[1])
        assert {each: rows[f"bodies/{name}.vxa"][each] for each in ("speed", "distance", "steps", "status")} == {
            each: alone[each] for each in ("speed", "distance", "steps", "status")
        }
    speeds = [rows[source]["speed"] for source in told["ranking"]]
    assert speeds == sorted(speeds, reverse=True) and len(speeds) == 3 and told["measure"] == "speed"
    table = read_records(bodies.parent / "a" / "scores.csv")
    assert [row["speed"] for row in table] == [row["speed"] for row in told["robots"]]
    assert [row["kind"] for row in table] == ["lattice"] * 3 and {row["world"] for row in table} == {"flat"}
    parts = sorted((bodies.parent / "a").glob("part-*.npz"))
    code, out, _ = morpholab("simulate-all bodies --out a --best 1 --measure distance --quiet")
    first = max(table, key=lambda row: row["distance"])["source"]
    assert code == 0 and out.splitlines()[1].startswith(f"  {first}  distance ") and out.count("distance") == 1
    assert sorted((bodies.parent / "a").glob("part-*.npz")) == parts  # none is simulated again


@pytest.mark.kernels
def test_a_folder_for_results_is_none_of_the_robots(bodies, morpholab):
    """Whether it is there already or not, so that options of the robots are known when the command goes on."""
    for name, swing in (("narrow", "0.4"), ("wide", "0.8")):
        (bodies / f"{name}.xml").write_text(CRAWLER.replace("0.8", swing))
    (bodies.parent / "empty").mkdir()
    robots, tables = "bodies/narrow.xml bodies/wide.xml", []
    for folder in ("a", "a", "empty"):
        code, _, err = morpholab(f"simulate-all --quiet --duration 0.1 --out {folder} {robots}")
        assert (code, err) == (0, "")
        tables.append((bodies.parent / folder / "scores.csv").read_text())
    assert tables[0] == tables[1] == tables[2]
    code, _, err = morpholab("simulate-all bodies/narrow.xml nothing --duration 0.1 --out a")
    assert code == 2 and "error: source: 'nothing' is no robot" in err


BAD = """
from morpholab import OwnMeasure, robot as robot_of

class Panic(BaseException):
    pass

def law(motion):
    raise Panic("fell")

robot = robot_of("bodies/narrow.xml", duration=0.1, own_measures=(OwnMeasure("drift", law=law),))
"""


@pytest.mark.kernels
@pytest.mark.parametrize("workers", ["", "--workers 2"])
def test_what_a_law_raises_costs_its_robot_alone(bodies, morpholab, workers):
    (bodies / "narrow.xml").write_text(CRAWLER.replace("0.8", "0.4"))
    (bodies / "bad.py").write_text(BAD)
    (bodies / "good.py").write_text(BAD.replace('raise Panic("fell")', "return motion.places[:, 0, 0]"))
    code, out, err = morpholab(f"simulate-all bodies/bad.py bodies/good.py --quiet --out a {workers}")
    assert (code, err) == (0, "") and out.startswith("2 robots, 1 failed\n  bodies/good.py  speed ")
    assert "\n  bodies/bad.py: own_measures: drift fails: Panic: fell\n" in out
    (bodies / "bad.py").write_text(BAD.replace('raise Panic("fell")', "raise KeyboardInterrupt"))
    code, out, err = morpholab(f"simulate-all bodies/bad.py bodies/good.py --quiet {workers}")
    assert (code, out, err) == (130, "", "morpholab simulate-all: interrupted\n")


@pytest.mark.kernels
def test_what_is_damaged_in_a_folder_is_left_out_and_told(bodies, morpholab):
    (bodies / "bad.json").write_text("{")
    (bodies / "bad.vxa").write_text("<VXA>")
    code, out, err = morpholab("simulate-all bodies --terrain hill:2")
    assert code == 1 and out.startswith("3 robots\n")
    assert "left out: bodies/bad.json: " in err and "left out: bodies/bad.vxa: " in err
    code, _, err = morpholab("simulate-all bodies bodies/bad.vxa")
    assert code == 2 and err.splitlines()[-1].startswith("morpholab simulate-all: error: bodies/bad.vxa: ")


@pytest.mark.kernels
def test_robots_of_several_kinds_are_ranked_by_what_they_have(bodies, morpholab):
    code, out, _ = morpholab("simulate-all vehicle legged bodies/long.vxa --quiet")
    assert code == 0 and out.startswith("3 robots, 1 without approach\n") and out.count("approach") == 3


@pytest.mark.parametrize(
    ("line", "kinds"),
    [
        ("view legged --title vehicle --out rolling", {"quadruped"}),
        ("view vehicle --design 5 --title=legged", {"vehicle"}),
        ("view --quiet legged vehicle --terrain rolling", {"quadruped", "vehicle"}),
        ("export vehicle --csv legged --dry-run", {"vehicle"}),
    ],
)
def test_what_an_option_takes_names_no_robot(line, kinds):
    command, *words = line.split()
    parser = build_parser(command)._actions[-1].choices[command]
    parser._add_kinds(words)
    titles = {group.title for group in parser._action_groups}
    assert {name for name in KINDS.builtin if KINDS[name].title in titles} == kinds


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("simulate-all", "the following arguments are required: ROBOT"),
        ("simulate-all nothing", "source: 'nothing' is no robot"),
        ("simulate-all empty", "sources: empty has no files of robots, such as .vxa"),
        ("simulate-all empty bodies --duration 0.1", "sources: empty has no files of robots, such as .vxa"),
        ("simulate-all bodies --measure sped", "measure: 'sped' is unknown; there are speed, distance"),
        ("simulate-all bodies --terrain hil:5", "argument --terrain: 'hil:5' is unknown"),
        ("simulate-all bodies --design 5", "design: it is an option of other kinds"),
        ("simulate-all bodies --workers 0", "argument --workers: 0 is not allowed"),
        ("simulate-all bodies --out bodies", "out: bodies holds something else; name a new folder"),
        ("simulate-all broken", "sources: none of 1 file can be used; broken/a.vxa: "),
    ],
)
def test_bad_lines_are_refused_before_any_work(line, message, bodies, morpholab):
    (bodies.parent / "empty").mkdir()
    (bodies.parent / "broken").mkdir()
    (bodies.parent / "broken" / "a.vxa").write_text("<VXA>")
    code, out, err = morpholab(line)
    assert code == 2 and not out and f"error: {message}" in err.splitlines()[-1]


@pytest.mark.kernels
def test_a_folder_of_other_robots_is_not_mixed_with_it(bodies, morpholab):
    assert morpholab("simulate-all bodies --out a --quiet")[0] == 0
    shutil.copy(bodies / "long.vxa", bodies / "more.vxa")
    code, _, err = morpholab("simulate-all bodies --out a --quiet")
    assert code == 2 and "out: a holds robots of other settings" in err
