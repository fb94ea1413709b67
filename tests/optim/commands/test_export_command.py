import json
import os
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from robots.hardware import KPA_PER_UNIT, PneumaticRig, export_csv, gait_table, read_csv
from robots.hardware.channel_table import PressureScale, Rhythm, Wave, channel_table
from robots.hardware.plain_files import write_plain
from robots.hardware.stream import Stream
from robots.inflatable import INCHING, ROLLING, save_design

SHORT = "--method hill-climb --climbers 2 --generations 1 --geometry small --columns 2 --repeats 1 --quiet"
FRAGILE = "[channels.bladder]\nmaximum_kpa = 15.0\n"


@pytest.fixture
def folder(tmp_path):
    save_design(ROLLING, tmp_path / "rolling.json")
    (tmp_path / "fragile.toml").write_text(FRAGILE)
    return tmp_path


def test_export_from_a_run_and_from_a_design(morpholab, simulator, folder):
    assert morpholab(f"codesign --out runs/a --terrain flat {SHORT} --seed 5")[0] == 0
    assert morpholab("export runs/a --csv a.csv")[0] == 0
    assert (folder / "a.csv").read_bytes() == (folder / "runs/a/gait.csv").read_bytes()
    assert read_csv(folder / "a.csv").seed == 5
    code, out, _ = morpholab("export runs/a/best.json --csv b.csv --units psi --json")
    assert code == 0 and json.loads(out)["units"] == "psi" and read_csv(folder / "b.csv").units == "psi"
    (folder / "rig.toml").write_text("shortest_state_s = -1.0\n")
    code, _, error = morpholab("export runs/a --csv c.csv --rig rig.toml")
    assert code == 2 and "shortest_state_s: -1.0 is not allowed" in error and not (folder / "c.csv").exists()


def test_a_gait_table_is_a_gait(morpholab, folder, simulator):
    export_csv(ROLLING, folder / "gait.csv", units="psi", rate=10.0)
    outs = [morpholab(f"simulate --gait {gait} --json")[1] for gait in ("rolling", "gait.csv", "gait.csv --from-rows")]
    first, *others = [{k: v for k, v in json.loads(out).items() if k != "gait"} for out in outs]
    assert first == others[0] == others[1]
    assert morpholab("export gait.csv --csv again.csv --units psi --rate 10")[0] == 0
    assert (folder / "again.csv").read_bytes() == (folder / "gait.csv").read_bytes()
    assert morpholab("export rolling --csv named.csv --units psi --rate 10")[0] == 0
    assert (folder / "named.csv").read_bytes() == (folder / "gait.csv").read_bytes()
    code, _, error = morpholab("simulate --gait rolling --from-rows")
    assert (code, error) == (
        2,
        "morpholab simulate: error: from-rows: 'rolling' has no rows; name a gait table (.csv)\n",
    )


def test_a_table_stays_one_for_its_rig(morpholab, folder):
    """What has 35 kPa in its core has no more in other units or forms; a rig that is not known is asked for."""
    assert morpholab("export rolling --rig dissertation-gentle --csv gentle.csv")[0] == 0
    assert morpholab("export gentle.csv --csv again.csv --plain again.txt")[0] == 0
    assert (folder / "again.csv").read_bytes() == (folder / "gentle.csv").read_bytes()
    assert np.loadtxt(folder / "again.txt", delimiter=",")[:, 1].max() == 35
    assert morpholab("export gentle.csv --rig dissertation --plain other.txt")[0] == 0
    assert np.loadtxt(folder / "other.txt", delimiter=",")[:, 1].max() == 50
    (folder / "mine.toml").write_text("supply_kpa = 60\n")
    assert morpholab("export rolling --rig mine.toml --csv mine.csv")[0] == 0
    code, _, error = morpholab("export mine.csv --plain mine.txt")
    assert code == 2 and "rig: the table is for 'mine', whose limits are not known; give its .toml file" in error
    assert morpholab("export mine.csv --rig mine.toml --plain mine.txt")[0] == 0


def test_a_table_is_in_the_units_of_its_rig(morpholab, folder):
    """Of a gait, of channels, and in Python; --units has the last word."""
    (folder / "psi.toml").write_text('units = "psi"\n')
    out = morpholab("export rolling --rig psi.toml --csv psi.csv --plain psi.txt --json")[1]
    assert json.loads(out)["units"] == "psi" and read_csv(folder / "psi.csv").units == "psi"
    assert np.loadtxt(folder / "psi.txt", delimiter=",")[:, 1].max() == pytest.approx(50 / KPA_PER_UNIT["psi"])
    assert morpholab("export rolling --rig psi.toml --csv kpa.csv --units kpa")[0] == 0
    assert read_csv(folder / "kpa.csv").pressures[:, 0].max() == 50
    rig = PneumaticRig.load(folder / "psi.toml")
    assert gait_table(ROLLING, rig).units == "psi" and gait_table(ROLLING).units == "kpa"
    wave = Wave("legs", np.array([0.0, 1.0]), PressureScale(0.0, 1.0, 0.0, 10.0), {})
    assert channel_table("mine", [wave], Rhythm(0.1, 1, 5.0, 2), rig).units == "psi"


def test_a_damaged_table_is_no_gait(morpholab, folder):
    export_csv(ROLLING, folder / "gait.csv")
    text = (folder / "gait.csv").read_text()
    (folder / "gait.csv").write_text(text.replace("# seed=unknown", "# seed=7"))
    code, _, error = morpholab("simulate --gait gait.csv")
    assert code == 2 and error.startswith("morpholab simulate: error: gait.csv: checksum does not fit;")


def test_what_exceeds_limits_is_refused_or_clipped_as_asked(morpholab, folder):
    code, _, error = morpholab("export rolling.json --csv a.csv --rig fragile.toml")
    assert code == 2 and not (folder / "a.csv").exists()
    assert error == (
        "morpholab export: error: bladder8: 20 kPa at 13 s is not allowed; the rig's limit is 15 kPa "
        "(15 more; a dry run names all); --on-violation clip keeps the limits\n"
    )
    code, out, _ = morpholab("export rolling.json --dry-run --rig fragile.toml")
    assert code == 2 and out.count("kPa at") == 16 and out.endswith("--on-violation clip keeps the limits\n")
    code, out, _ = morpholab("export rolling.json --csv a.csv --rig fragile.toml --on-violation clip")
    assert code == 0 and "clipped 16 times" in out
    assert read_csv(folder / "a.csv").pressures[:, 1:9].max() == 15.0


def test_a_rate_too_slow_for_the_gait_is_told(morpholab, folder):
    code, out, _ = morpholab("export rolling.json --csv a.csv --rate 0.3")
    assert (
        code == 0
        and "note: in whole samples at 0.3 Hz it takes that long; without --rate 48.2 s; --rate 1 fits\n" in f"{out}\n"
    )
    assert "note" not in morpholab("export rolling.json --csv a.csv --rate 100")[1]


def test_a_dry_run_tells_when_what_happens_and_writes_no_table(morpholab, folder):
    code, out, _ = morpholab("export rolling.json --csv a.csv --dry-run")
    lines = out.splitlines()
    assert code == 0 and not (folder / "a.csv").exists() and len(lines) == 1 + 18 + 1
    assert lines[1].split() == ["0", "prefix", "0.00", "s", "11.50", "s", "core", "core", "foot1", "foot2"]
    assert lines[-1] == "prefix 27.5 s, main 16 s, suffix 4.7 s; main played 1 time: 48.2 s in all"
    document = json.loads(morpholab("export rolling.json --dry-run --json")[1])
    assert document["seconds"] == pytest.approx(48.2) and document["loops"] == 1 and document["csv"] is None
    assert [state["waits_for"] for state in document["states"]][:3] == ["core", "bladder8", "bladder7"]


def test_the_plot_is_a_picture(morpholab, folder):
    assert morpholab("export rolling.json --plot gait.png --dry-run")[0] == 0
    assert (folder / "gait.png").read_bytes()[1:4] == b"PNG"
    code, _, error = morpholab("export rolling.json --plot gait.txt")
    assert code == 2 and "plot: gait.txt is not allowed; give a file that ends in .pdf, .png, .svg" in error


def test_there_must_be_something_to_write(morpholab, folder):
    code, _, error = morpholab("export rolling.json")
    assert code == 2 and "csv: is missing; name the file to write, or ask for --dry-run or --plot" in error
    assert "--voxels or --model, what drives of a file's robot are told by --commands" in error


def test_the_chart_marks_what_every_state_waits_for():
    from robots.hardware.gait_chart import gait_chart

    table = gait_table(INCHING, PneumaticRig())
    axes = gait_chart(table).axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()][:2] == ["core", "bladder 1"]
    assert {"prefix", "main, played 1×", "suffix", "−80 to 50"} <= {text.get_text() for text in axes.texts}
    assert axes.get_xlim() == (0.0, table.times[-1])


def test_plain_numbers_and_a_c_header(morpholab, folder):
    assert morpholab("export rolling --csv g.csv --plain p.csv --c-header gait.h --units psi")[0] == 0
    table = read_csv(folder / "g.csv")
    numbers = np.loadtxt(folder / "p.csv", delimiter=",")
    assert numbers.shape[1] == 12 and (np.diff(numbers[:, 0]) > 0).all()
    for line in range(11):
        np.testing.assert_allclose(
            np.interp(table.times, numbers[:, 0], numbers[:, 1 + line]), table.pressures[:, line]
        )
    for options, told in (
        ("--csv a.csv --plain a.csv", "plain: a.csv is the table, too"),
        ("--c-header 2-gaits.h", "c-header: 2-gaits is not allowed"),
    ):
        code, _, error = morpholab(f"export rolling {options}")
        assert code == 2 and told in error


@pytest.mark.parametrize("rate", [None, 20.0])
@pytest.mark.parametrize("repeats", [1, 2, 4])
def test_plain_numbers_play_all_cycles(tmp_path, repeats, rate):
    design = replace(INCHING, schedule=replace(INCHING.schedule, repeats=repeats))
    table = gait_table(design, rate=rate)
    write_plain(table, tmp_path / "gait.txt")
    times, *lines = np.loadtxt(tmp_path / "gait.txt", delimiter=",").T
    assert times[-1] == pytest.approx(table.seconds, rel=1e-8) and (np.diff(times) > 0).all()
    stream = Stream(table, PneumaticRig.load("dissertation"), table.loops, 20.0)
    for sample in stream:
        played = [np.interp(sample.time_s, times, line) for line in lines]
        assert sample.pressures == pytest.approx(played, abs=1e-6)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
def test_the_c_header_compiles_and_holds_the_table(morpholab, folder):
    assert morpholab("export rolling --csv g.csv --c-header gait.h")[0] == 0
    (folder / "a.c").write_text(
        '#include <stdio.h>\n#include "gait.h"\nint main(void) {\n'
        "  for (int row = GAIT_MAIN_BEGIN; row < GAIT_MAIN_END; row++)\n"
        '    printf("%.6g %.6g\\n", gait_time_s[row], gait_pressure[row][GAIT_CHANNELS - 1]);\n}\n'
    )
    subprocess.run(["gcc", "-std=c99", "-Wall", "-Werror", "-o", folder / "a", folder / "a.c"], check=True)
    said = subprocess.run([folder / "a"], capture_output=True, text=True, check=True).stdout
    table = read_csv(folder / "g.csv")
    rows = np.array(table.sections) == "main"
    expected = np.column_stack([table.times[rows], table.pressures[rows, -1]])
    np.testing.assert_allclose(np.array([line.split() for line in said.splitlines()], float), expected, rtol=1e-5)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("gait.csv --csv gait.csv", "csv: gait.csv is the source, which is only read; name another file"),
        ("gait.csv --plain gait.csv", "plain: gait.csv is the source, which is only read; name another file"),
        ("gait.csv --csv link.csv", "csv: link.csv is the source, which is only read; name another file"),
        (
            "rolling --rig fragile.toml --csv fragile.toml",
            "csv: fragile.toml is the rig, which is only read; name another file",
        ),
        (
            "rolling --calibration kept.json --csv kept.json",
            "csv: kept.json is the calibration, which is only read; name another file",
        ),
        ("rolling --csv new.csv --plain run/config.toml", "plain: run/config.toml exists; name a new file"),
        ("rolling --csv run/gait.csv", "csv: run/gait.csv is a file of the run in {folder}/run; name another file"),
        ("rolling --csv new.csv --c-header rolling.json", "c-header: rolling.json exists; name a new file"),
        ("rolling --plot old.png", "plot: old.png exists; name a new file"),
        ("rolling --parts run", "parts: run exists and is not empty; name a new folder"),
        ("rolling --parts old.stl", "parts: old.stl exists; name a new file"),
        ("rolling --csv deep/../new.csv --plain new.csv", "plain: new.csv is the table, too; name another file"),
        (
            "rolling --plain new.csv --c-header ./new.csv",
            "c-header: new.csv is that of --plain, too; name another file",
        ),
    ],
)
def test_nothing_that_is_read_or_kept_is_replaced(morpholab, folder, line, told):
    """Only what help says is replaced, which is the table; and no output takes the place of another."""
    export_csv(ROLLING, folder / "gait.csv")
    (folder / "link.csv").symlink_to("gait.csv")
    for name in ("deep", "run"):
        (folder / name).mkdir()
    for name in ("run/config.toml", "run/environment.json", "run/gait.csv", "old.png", "old.stl", "kept.json"):
        (folder / name).write_text("kept")
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    said = told.replace("{folder}", str(folder.resolve()))
    assert morpholab(f"export {line}") == (2, "", f"morpholab export: error: {said}\n")
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("option", ["csv", "plain", "c-header", "plot", "voxels"])
def test_pipes_are_no_files_to_write(morpholab, folder, option):
    name = "pipe.png" if option == "plot" else "pipe.vxa" if option == "voxels" else "pipe"
    os.mkfifo(folder / name)
    told = f"morpholab export: error: {option}: {name} is a pipe or device; name a file\n"
    assert morpholab(f"export rolling --{option} {name}") == (2, "", told) and (folder / name).is_fifo()


def test_a_table_goes_where_a_link_leads(morpholab, folder):
    (folder / "link.csv").symlink_to("target.csv")
    for _ in range(2):
        assert morpholab("export rolling --csv link.csv")[0] == 0
        assert (folder / "link.csv").is_symlink() and read_csv(folder / "target.csv").seconds > 0
        (folder / "target.csv").write_text("old")
