"""A rig of six valves, from its file to the table that it plays, and back into the simulator."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robots.hardware import PneumaticRig, read_channels
from robots.inflatable import ROLLING
from robots.lattice_robot import Drive, LatticeRobot, load_robot, save_robot
from taichi_sim.lattice import Material, body_from_array

ROOT = Path(__file__).parents[3]
NAMES = ("v1", "v2", "v3", "v4", "v5", "v6")


@pytest.fixture
def folder(tmp_path):
    """The rig of the docs, and a block whose two halves swell in turn."""
    example = re.search(r'```toml\n(name = "six-valves"\n.*?)```', (ROOT / "docs/hardware.md").read_text(), re.DOTALL)
    (tmp_path / "six-valves.toml").write_text(example[1])
    array = np.ones((4, 2, 1), int)
    halves = np.repeat([0, 0, 1, 1], 2).reshape(array.shape)
    body = body_from_array(array, Material(5e4, 1e3, static_friction=1.0, kinetic_friction=0.5), 0.02, regions=halves)
    drives = (Drive("back", (0,), amplitude=0.1), Drive("front", (1,), amplitude=0.15, phase=0.25))
    save_robot(LatticeRobot(body, drives, cycles=1, settling=0.05), tmp_path / "block.json")
    return tmp_path


@pytest.mark.kernels
def test_a_table_for_six_valves_is_written_and_moves_the_robot_as_designed(morpholab, folder):
    files = "--csv a.csv --plain a.txt --c-header a.h --plot a.png"
    code, out, error = morpholab(f"export block.json --rig six-valves.toml {files} --full-scale 0.8:1.2 --json")
    assert (code, error) == (0, "") and json.loads(out)["clipped"] == []
    table = read_channels("a.csv")
    assert (table.rig, table.channels, table.units) == ("six-valves", NAMES, "kpa")
    assert [wave.name for wave in table.waves] == ["back", "front"] and not table.pressures[:, 2:].any()
    assert [table.pressures[:, line].max() for line in (0, 1)] == pytest.approx([30, 35])
    assert np.loadtxt("a.txt", delimiter=",").shape[1] == 7 and "CHANNELS 6" in Path("a.h").read_text()
    quick = "--threads 1 --quiet --json"
    runs = [f"simulate --robot block.json {quick}{more}" for more in ("", " --channels a.csv")]
    designed, played = (json.loads(morpholab(line)[1]) for line in runs)
    assert played["distance"] == pytest.approx(designed["distance"], rel=1e-4) and designed["distance"] != 0
    assert morpholab(f"view block.json --channels a.csv --frames 5 --out v.html {quick}")[0] == 0
    code, out, _ = morpholab("play a.csv --rig six-valves.toml --to s.csv --format csv --no-wait --rate 200")
    assert code == 0 and Path("s.csv").read_text().splitlines()[0].endswith(",v1,v2,v3,v4,v5,v6")


@pytest.mark.kernels
def test_export_tells_channels_and_lines(morpholab, folder):
    """It called the six lines channels of a robot that has two."""
    code, out, error = morpholab("export block.json --rig six-valves.toml --csv a.csv --full-scale 0.8:1.2")
    assert (code, error) == (0, "") and out.startswith("a.csv: 2 channels on 6 lines, ")


@pytest.mark.kernels
def test_channels_with_names_of_lines_are_not_swapped(morpholab, folder):
    six = (folder / "six-valves.toml").read_text()
    (folder / "named.toml").write_text(six.replace('"v1", "v2", "v3"', '"front", "back", "v3"'))
    (folder / "half.toml").write_text(six.replace('"v1", "v2", "v3"', '"front", "v2", "v3"'))
    line = "export block.json --full-scale 0.8:1.2"
    assert morpholab(f"{line} --rig named.toml --csv a.csv --plain a.txt --c-header a.h --plot a.png")[0] == 0
    columns = dict(zip(read_channels("a.csv").channels, read_channels("a.csv").pressures.T, strict=True))
    assert (columns["back"].max(), columns["front"].max()) == pytest.approx((30, 35))
    assert np.loadtxt("a.txt", delimiter=",")[:, 1:3].max(axis=0) == pytest.approx([35, 30])
    quick = "--threads 1 --quiet --json"
    runs = [f"simulate --robot block.json {quick}{more}" for more in ("", " --channels a.csv")]
    designed, played = (json.loads(morpholab(line)[1]) for line in runs)
    assert played["distance"] == pytest.approx(designed["distance"], rel=1e-4)
    code, _, error = morpholab(f"{line} --rig half.toml --csv b.csv")
    assert code == 2 and error.count("\n") == 1 and not (folder / "b.csv").exists()
    told = "drives: front would be on the line v2 by order, though there is a line front, as back has no line"
    assert f"error: {told}" in error


def test_tables_for_six_valves_in_other_units_and_forms(morpholab, folder):
    line = "export block.json --rig six-valves.toml --full-scale 0.8:1.2"
    assert morpholab(f"{line} --csv psi.csv --units psi --rate 50")[0] == 0
    assert "\ntime_s,section,state,v1_psi,v2_psi,v3_psi,v4_psi,v5_psi,v6_psi\n" in Path("psi.csv").read_text()
    code, out, _ = morpholab(f"{line} --dry-run")
    assert code == 0 and re.search(r" s  v\d +v1 v2\n", out) and "bladder" not in out
    (folder / "slow.toml").write_text((folder / "six-valves.toml").read_text().replace("400.0", "4.0"))
    code, _, error = morpholab(f"{line.replace('six-valves', 'slow')} --csv slow.csv")
    assert code == 2 and re.search(r"error: v\d: \S+ kPa/s at .* is not allowed; the rig's limit is 4 kPa/s", error)
    assert morpholab(f"{line.replace('six-valves', 'slow')} --csv slow.csv --on-violation clip")[0] == 0
    slow = read_channels("slow.csv")
    assert slow.clipped and slow.played_frequency < slow.rhythm.frequency and slow.channels == NAMES


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (
            "export rolling --rig six-valves.toml --csv a.csv",
            "rig: six-valves has lines of its own, v1 and on; a gait of the inflatable robot needs core, bladders and "
            "feet, so give a rig without lines =",
        ),
        ("simulate --table rolling.csv --rig six-valves.toml", "rig: six-valves has 6 lines, the table has 11"),
        (
            "export block.json --rig one.toml --csv a.csv",
            "drives: 2 channels are not allowed; the rig one has 1 line for them: let regions share a wave, or give a "
            "rig of more",
        ),
        (
            "export block.json --rig bad.toml --csv a.csv",
            "bad.toml: lines: 'v1' is not allowed twice",
        ),
    ],
)
def test_what_lines_cannot_play_is_refused_in_one_line(morpholab, folder, line, told):
    (folder / "one.toml").write_text('lines = ["v1"]\n')
    (folder / "bad.toml").write_text('lines = ["v1", "v1"]\n')
    assert morpholab("export rolling --csv rolling.csv")[0] == 0
    code, out, error = morpholab(line)
    assert (code, out) == (2, "") and error.count("\n") == 1 and f": error: {told}" in error
    assert not (folder / "a.csv").exists()


def test_rates_that_fit_are_named_where_samples_make_a_table_longer(morpholab, folder):
    robot = replace(load_robot(folder / "block.json"), frequency=1.0, cycles=4)
    save_robot(robot, folder / "slow.json")
    line = "export slow.json --rig six-valves.toml --csv a.csv"
    told = "\nnote: in whole samples at 50 Hz it takes that long; without --rate 5.5 s; --rate 48 or 64 fits\n"
    assert told in morpholab(f"{line} --rate 50")[1]
    for rate in (48, 64):
        assert "note: " not in morpholab(f"{line} --rate {rate}")[1] and read_channels("a.csv").played_frequency == 1


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ("--robot block.json --table a.csv --rig six-valves.toml", "table: a.csv is not allowed with block.json"),
        ("--robot block.json --table a.csv", "table: a.csv is not allowed with block.json"),
        ("--robot freeform --rig six-valves.toml", "rig: six-valves.toml is not allowed with freeform"),
    ],
)
def test_a_rig_beside_a_robot_of_ones_own_is_refused_with_what_works(morpholab, folder, options, told):
    assert morpholab("export block.json --rig six-valves.toml --csv a.csv --full-scale 0.8:1.2")[0] == 0
    code, out, error = morpholab(f"simulate {options}")
    assert (code, out) == (2, "") and error.count("\n") == 1 and f": error: {told}, a " in error
    kind = "freeform" if "freeform" in options else "lattice"
    works = "export --rig RIG --csv FILE writes a table of its channels for a rig; simulate that by --robot BEST.json"
    assert f"a {kind} robot; {works} --channels FILE, with --rig RIG as the rig plays it, without --table\n" in error


@pytest.mark.kernels
def test_a_rig_plays_the_table_of_a_robot_of_ones_own(morpholab, folder):
    """A lag much longer than a cycle leaves hardly any motion; a rig that is as told plays the rows."""
    assert morpholab("export block.json --rig six-valves.toml --csv a.csv --full-scale 0.8:1.2")[0] == 0
    six = (folder / "six-valves.toml").read_text()
    (folder / "slow.toml").write_text(six.replace("rise_s =", "lag_s = 3.0\nrise_s =", 1))
    asked = "simulate --robot block.json --channels a.csv --threads 1 --json --quiet"
    energies = []
    for rig in ("", " --rig six-valves.toml", " --rig slow.toml"):
        code, out, error = morpholab(asked + rig)
        assert code == 0, error
        energies.append(json.loads(out)["energy"])
    assert energies[1] > 0.2 * energies[0] and energies[2] < 0.02 * energies[0]
    code, _, error = morpholab("simulate --robot block.json --rig six-valves.toml")
    assert code == 2 and "rig: six-valves.toml is not allowed without --channels, whose rows it plays" in error
    code, _, error = morpholab("simulate --robot block.json --channels a.csv --rig dissertation")
    assert code == 2 and "rig: dissertation has 11 lines, the table has 6" in error


def test_a_gait_table_beside_another_robot_is_refused_with_the_robot_to_leave_out(morpholab, folder):
    assert morpholab("export rolling --csv rolling.csv")[0] == 0
    code, _, error = morpholab("simulate --robot rolling.csv --table rolling.csv --rig dissertation")
    assert code == 2 and "table: rolling.csv has a gait by itself; leave --robot rolling.csv out" in error
    code, _, error = morpholab("simulate --robot rover --rig dissertation")
    assert code == 2 and "rig: dissertation is not allowed with rover, a two-wheel vehicle; leave it out" in error


def test_a_pipeline_refuses_a_rig_of_own_lines(folder):
    from optim.pipeline.task import PipelineTask
    from robots.world import Terrain

    with pytest.raises(ValueError, match=r"^rig: six-valves has lines of its own, v1 and on"):
        PipelineTask((Terrain(),), {"rolling": ROLLING}, rig=PneumaticRig.load(folder / "six-valves.toml"))
