"""Files that the lab reads back, damaged field by field: one line that names the file and the field, and no memory."""

import hashlib
import io
import json
import shutil
import tracemalloc
import zipfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from optim.experiments.tables import read_records
from optim.runs import checkpoint
from optim.runs.config import SEAL, read_config
from optim.runs.history import begun, read_histories
from optim.runs.robust import checked_robust, read_robust
from optim.search import build_method
from optim.space import Space, Variable
from robots.calibration import load_calibration
from taichi_sim.base import files
from taichi_sim.base.parsing import DEEPEST
from taichi_sim.base.results_folder import ResultsFolder, load_parts, read_settings

CONFIG = """format = 1
generations = 2

[problem]
kind = "x"

[method]
name = "cma"

[[objectives]]
name = "speed"
unit = "m/s"
"""
INTERVALS = {f"{name}{end}": 0.5 for name in ("mean", "cvar", "worst") for end in ("", "_low", "_high")}
JUDGED = {
    **{"uncertain": "friction=20%", "draws": 32, "failed": 0, "measure": "speed", "unit": "BL/s", "risk": "mean"},
    **{"share": 0.1, "sd": 0.2},
    **INTERVALS,
}
ROBUST = {"risk": "mean", "terrains": {"flat": JUDGED}}
PROPERTIES = {"friction": 1.0, "low_friction": 0.1, "modulus": 4e5, "inflation_rate": 2.0}
CALIBRATION = {"format": "morpholab-calibration-1", "geometry": "small", "properties": PROPERTIES}


def told(read, *given):
    """The line that a reader refuses with."""
    with pytest.raises(ValueError, match=r".") as refused:
        read(*given)
    assert "\n" not in str(refused.value)
    return str(refused.value)


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("generations = 2\n", "", "generations is missing"),
        ("[problem]", "wings = 2\n[problem]", "'wings' is unknown; fields are format, problem"),
        ("generations = 2", 'generations = "2"', "generations: '2' is not allowed; it must be a whole number"),
        ("generations = 2", "generations = true", "generations: True is not allowed; it must be a whole number"),
        (
            "generations = 2",
            "generations = -1",
            "generations: -1 is not allowed; it must be a whole number, at",
        ),
        ("generations = 2", "generations = 1e300", "generations: 1e+300 is not allowed"),
        ("generations = 2", "generations = nan", "generations: nan is not allowed"),
        ("generations = 2", "generations = 99999999999", "generations: 99999999999 is not allowed"),
        ("format = 1", "format = 2", "was written by a newer morpholab (format 2"),
        ("format = 1", "format = 0", "format: 0 is not allowed"),
        ("format = 1\n", "", "format is missing"),
        ('name = "cma"', "name = 3", "method.name: 3 is not allowed; it must be a text"),
        ('name = "cma"', "", "method.name: None is not allowed"),
        ('unit = "m/s"', "unit = 1", "objectives[0].unit: 1 is not allowed; it must be a text"),
        ('name = "speed"', "", "objectives[0].name is missing"),
        ("[[objectives]]", "[objectives]", "objectives: {'name': 'speed', 'unit': 'm/s'} is not allowed"),
        ("[method]", "[method", "cannot be read (Expected"),
        ("generations = 2", f"generations = {'[' * 20_000}", "cannot be read"),
    ],
)
def test_settings_of_runs(tmp_path, before, after, message):
    assert before in CONFIG
    text = CONFIG.replace(before, after)
    (tmp_path / "config.toml").write_text(f"{text}{SEAL}{files.sha256(text.encode())}\n")
    assert told(read_config, tmp_path).startswith(f"{tmp_path / 'config.toml'}: {message}")


def test_whole_settings_are_taken(tmp_path):
    (tmp_path / "config.toml").write_text(f"{CONFIG}{SEAL}{files.sha256(CONFIG.encode())}\n")
    assert read_config(tmp_path)["objectives"] == [{"name": "speed", "unit": "m/s"}]


def test_one_bad_folder_does_not_hide_others(tmp_path):
    for name in "abc":
        (tmp_path / name).mkdir()
        (tmp_path / name / "config.toml").write_text(f"{CONFIG}{SEAL}{files.sha256(CONFIG.encode())}\n")
    (tmp_path / "b/config.toml").write_text(CONFIG)
    (tmp_path / "c/log.jsonl").mkdir()
    with pytest.warns(UserWarning, match="the run is left out") as notes:
        histories, damaged = read_histories([tmp_path / name for name in "abc"], lambda history: history)
    assert [history.path.name for history in histories] == ["a"] and len(notes) == 2
    assert "checksum is missing" in damaged[0] and "log.jsonl: cannot be read" in damaged[1]
    assert "checksum is missing" in told(read_histories, [tmp_path / "b"], begun)
    assert "a has no complete generation yet" in told(read_histories, [tmp_path / "a", tmp_path / "b"], begun)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"share": None}, "terrains.flat.share is missing"),
        ({"wings": 2}, "terrains.flat: 'wings' is unknown"),
        ({"mean": "fast"}, "terrains.flat.mean: 'fast' is not allowed; it must be a finite number"),
        ({"worst_low": float("nan")}, "terrains.flat.worst_low: nan is not allowed"),
        ({"worst_low": 10**400}, "terrains.flat.worst_low: 1000"),
        ({"sd": -1}, "terrains.flat.sd: -1 is not allowed; it must be a finite number, at least 0"),
        ({"share": 1.5}, "terrains.flat.share: 1.5 is not allowed; it must be a finite number, at least 0, at most 1"),
        ({"draws": -32}, "terrains.flat.draws: -32 is not allowed; it must be a whole number, at least 0"),
        ({"failed": 40}, "terrains.flat: 'measure' is unknown"),
    ],
)
def test_judgements_over_draws(tmp_path, change, message):
    path = tmp_path / "robust.json"
    judged = {name: value for name, value in {**JUDGED, **change}.items() if value is not None}
    path.write_text(json.dumps({**ROBUST, "terrains": {"flat": judged}}))
    assert told(checked_robust, tmp_path).startswith(f"{path}: {message}")
    with pytest.warns(UserWarning, match="it is left out"):
        assert read_robust(tmp_path) == {}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (json.dumps(ROBUST)[:-30], "it is no JSON (Unterminated"),
        ("[]", "[] is not allowed; it must be a record"),
        ('{"risk": "mean"}', "terrains is missing"),
        ('{"risk": "mean", "terrains": {"flat": 3}}', "terrains: {'flat': 3} is not allowed"),
        ("[" * 100_000, "it is no JSON"),
    ],
)
def test_judgements_that_are_none(tmp_path, text, message):
    (tmp_path / "robust.json").write_text(text)
    assert told(checked_robust, tmp_path).startswith(f"{tmp_path / 'robust.json'}: {message}")


def test_whole_judgements_are_taken(tmp_path):
    (tmp_path / "robust.json").write_text(json.dumps(ROBUST))
    assert checked_robust(tmp_path) == ROBUST["terrains"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "morpholab-gait-1"}, "it is not of the format 'morpholab-calibration-1'"),
        ({"geometry": "huge"}, "geometry: 'huge' is unknown"),
        ({"geometry": None}, "geometry: None is not allowed; it must be a text"),
        ({"properties": 3}, "properties: 3 is not allowed; it must be a record"),
        ({"properties": {**PROPERTIES, "wings": 2}}, "properties: 'wings' is unknown"),
        ({"properties": {}}, "properties.friction is missing"),
        ({"properties": {**PROPERTIES, "modulus": "soft"}}, "properties.modulus: 'soft' is not allowed"),
        ({"properties": {**PROPERTIES, "modulus": -4e5}}, "properties.modulus: -400000.0 is not allowed"),
        ({"properties": {**PROPERTIES, "modulus": 1e300}}, "properties.modulus: 1e+300 is not allowed"),
        ({"properties": {**PROPERTIES, "modulus": float("nan")}}, "properties.modulus: nan is not allowed"),
    ],
)
def test_calibrations(tmp_path, change, message):
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps({**CALIBRATION, **change}))
    assert told(load_calibration, path).startswith(f"{path}: {message}")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"a,b\n1\n", "row 2 is none of the table; it must have 2 cells"),
        (b"a,b\n1,2\n1,2,3\n", "row 3 is none of the table; it must have 2 cells"),
        (b"a,b\n" + b"1" * 200_000 + b",2\n", "is no table (field larger than field limit (131072))"),
        (b"a,b\n\xff,2\n", "cannot be read (it is damaged)"),
    ],
)
def test_tables(tmp_path, content, message):
    (tmp_path / "t.csv").write_bytes(content)
    assert told(read_records, tmp_path / "t.csv") == f"{tmp_path / 't.csv'}: {message}"


def test_a_cell_that_is_nested_too_deep_is_a_text(tmp_path):
    (tmp_path / "t.csv").write_text(f"a,b\n{'(' * 5000},1\n")
    assert read_records(tmp_path / "t.csv") == [{"a": "(" * 5000, "b": 1}]


def header_of(shape, dtype="<f8"):
    """An array's file that has a header alone."""
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": dtype, "fortran_order": False, "shape": shape})
    return file.getvalue()


def zipped(**entries):
    """An archive of files, compressed."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, entry in entries.items():
            archive.writestr(name.replace("_npy", ".npy"), entry)
    return content.getvalue()


ARRAYS = {
    "huge": (zipped(points_npy=header_of((10**12, 4))), "points: its header tells of shape (1000000000000, 4)"),
    "overflowing": (zipped(points_npy=header_of((2**62, 2**62))), "points: its header tells of shape"),
    "negative": (zipped(points_npy=header_of((-1, -8))), "points: its header tells of shape (-1, -8)"),
    "half": (
        zipped(points_npy=header_of((4,)) + b"0" * 16),
        "points: its header tells of shape (4,), 32 bytes",
    ),
    "objects": (zipped(points_npy=header_of((1,), "|O") + b"0" * 8), "points: object is not allowed, give numbers"),
    "letters without a width": (zipped(points_npy=header_of((10**12,), "<U0")), "points: <U0 is not allowed"),
    "no array": (zipped(points="text"), "points is no array"),
    "cut off": (zipped(points_npy=header_of((100,)) + bytes(800))[:-1], "not a zip file"),
}


@pytest.mark.parametrize("harm", ARRAYS)
def test_parts_of_studies(tmp_path, harm):
    content, message = ARRAYS[harm]
    folder = ResultsFolder(tmp_path / "a", "study", {})
    (tmp_path / "a/part-0.npz").write_bytes(content)
    tracemalloc.start()
    try:
        with pytest.warns(UserWarning, match=r"part-0.npz: is damaged, and as good as missing \(.") as notes:
            assert list(folder.load("part")) == []
        assert tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()
    assert message in str(notes[0].message)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({}, "speeds is missing"),
        ({"speeds": np.zeros((2, 2))}, r"speeds: float64 of shape \(2, 2\) is not allowed; give type and axes f1"),
        ({"speeds": np.zeros(2, int)}, r"speeds: int64 of shape \(2,\) is not allowed"),
    ],
)
def test_arrays_of_parts(tmp_path, arrays, message):
    folder = ResultsFolder(tmp_path / "a", "study", {})
    folder.add("part", b"", other=np.zeros(1), **arrays)
    with pytest.warns(UserWarning, match=message):
        assert list(folder.load("part", speeds="f1")) == []
    assert len(list(folder.load("part"))) == 1


def test_parts_of_other_settings_are_as_good_as_missing(tmp_path):
    """Parts that were copied from another folder; those of earlier versions tell no settings, and are taken."""
    folders = {name: ResultsFolder(tmp_path / name, "study", {"x": x}) for name, x in (("a", 1), ("b", 2), ("c", 1))}
    folders["a"].add("part", b"", speeds=np.ones(2))
    (part,) = (tmp_path / "a").glob("part-*.npz")
    for name in "bc":
        shutil.copy(part, tmp_path / name)
    for name in "ac":
        (found,) = folders[name].load("part", speeds="f1")
        assert found.keys() == {"speeds"} and np.array_equal(found["speeds"], np.ones(2))
    for load in (folders["b"].load, partial(load_parts, tmp_path / "b")):
        with pytest.warns(UserWarning, match=r"b/part-.*good as missing \(it is a part of a study of other settings\)"):
            assert list(load("part")) == []
    np.savez_compressed(tmp_path / "b" / part.name, speeds=np.ones(2))
    assert len(list(folders["b"].load("part", speeds="f1"))) == 1
    digest = header_of((32,), "|u1") + hashlib.sha256((tmp_path / "a/study.json").read_bytes()).digest()
    (tmp_path / "b" / part.name).write_bytes(zipped(**{"settings/../a/study_npy": digest}))
    with pytest.warns(UserWarning, match="of other settings"):
        assert list(folders["b"].load("part")) == []


def test_what_refuses_a_part_makes_it_a_damaged_one(tmp_path):
    folder = ResultsFolder(tmp_path / "a", "study", {})
    folder.add("part", b"", speeds=np.ones(2))

    def check(arrays):
        raise ValueError(f"speeds: {len(arrays['speeds'])} are not allowed")

    with pytest.warns(UserWarning, match=r"good as missing \(speeds: 2 are not allowed\)"):
        assert list(folder.load("part", check, speeds="f1")) == []


@pytest.mark.parametrize("replaced", [False, True])
def test_work_whose_folder_was_moved_adds_nothing_to_another(tmp_path, replaced):
    folder = ResultsFolder(tmp_path / "a", "study", {"x": 1})
    folder.add("part", b"1", speeds=np.ones(2))
    (tmp_path / "a").rename(tmp_path / "moved")
    if replaced:
        ResultsFolder(tmp_path / "a", "study", {"x": 2})
    with pytest.raises(
        RuntimeError, match=r"a: the folder was moved or replaced, or its study\.json changed, in use; "
    ):
        folder.add("part", b"2", speeds=np.ones(2))
    assert list(tmp_path.glob("a/*.npz")) == [] and len(list(tmp_path.glob("moved/*.npz"))) == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"format": "morpholab-study-1"', "study.json: it is no JSON"),
        ('{"format": "morpholab-study-2"}', "study.json: it is not of the format 'morpholab-study-1'"),
        ("[]", "study.json: it is not of the format"),
    ],
)
def test_settings_of_studies(tmp_path, text, message):
    assert told(read_settings, tmp_path, "study") == f"{tmp_path}: holds no study"
    (tmp_path / "study.json").write_text(text)
    assert message in told(read_settings, tmp_path, "study")


DEEP = {  # than parsers go; and than they are asked to go, as functions that walk along documents may not go as far
    "far": lambda start, end: start * 100_000,
    "just": lambda start, end: start * (DEEPEST + 1) + "0" + end * (DEEPEST + 1),
}


@pytest.mark.parametrize("how", DEEP)
@pytest.mark.parametrize(
    ("line", "file"),
    [
        ("sweep --designs 1 --out a", "a/sweep.json"),
        ("pipeline deep.toml --out b", "deep.toml"),
        ("calibrate deep.toml", "deep.toml"),
        ("simulate --robot deep.json", "deep.json"),
        ("simulate --robot freeform --palette deep.json", "deep.json"),
        ("simulate --gait deep.json", "deep.json"),
        ("tasks deep.toml", "deep.toml"),
        ("simulate --robot quadruped --controller deep.json", "deep.json"),
        ("play deep.csv --rig deep.toml --dry-run", "deep.toml"),
        ("export a --csv b.csv", "a/config.toml"),
    ],
)
def test_what_is_nested_too_deep_is_named(morpholab, tmp_path, line, file, how):
    path = tmp_path / file
    path.parent.mkdir(exist_ok=True)
    path.write_text("a = " * (path.suffix == ".toml") + DEEP[how]("[", "]"))
    code, out, error = morpholab(line)
    assert (code, out) == (2, "") and error.count("\n") == 1 and "recursion" not in error
    assert Path(file).name in error


SPACE = Space((Variable("x", -1.0, 1.0, step=0.1), Variable("y", -1.0, 1.0, step=0.1)))
METHODS = ("cma", "hill-climb", "nsga2", "map-elites")


@dataclass(frozen=True)
class Stored:
    """A method after its first generation, and its state."""

    method: object
    state: dict


def stored(name):
    from optim.problem import Evaluation

    settings = {"seed": 1}
    if name == "map-elites":
        settings["descriptors"] = ["x", "y"]
    method = build_method(name, SPACE, settings)
    points = method.ask()
    details = {"x": points[:, 0], "y": points[:, 1]}
    method.tell(points, Evaluation(points.sum(axis=1), details=details))
    return Stored(build_method(name, SPACE, settings), method.state())


HARMS = {
    "missing": (lambda state: state.pop("generation"), "state: generation is missing"),
    "unknown": (lambda state: state.update(wings=np.zeros(1)), "state: 'wings' is unknown"),
    "a text": (lambda state: state.update(points=np.full(state["points"].shape, "x")), "state: points of type <U1"),
    "whole": (lambda state: state.update(points=state["points"].astype(int)), "state: points of type int64"),
    "shape": (lambda state: state.update(points=state["points"].T[:1]), "state: points of shape"),
    "infinite": (lambda state: state.update(points=state["points"] * np.inf), "state: points that are infinite"),
    "before": (lambda state: state.update(generation=np.array(-1)), "state: generation: -1 is not allowed"),
    "axes": (lambda state: state.update(generation=np.zeros(3, int)), "state: generation of shape (3,), expected ()"),
}


@pytest.mark.parametrize("harm", HARMS)
@pytest.mark.parametrize("name", METHODS)
def test_states_of_searches(tmp_path, name, harm):
    known, (damage, message) = stored(name), HARMS[harm]
    checkpoint.restore(tmp_path, known.method, dict(known.state))
    state = dict(known.state)
    damage(state)
    assert told(checkpoint.restore, tmp_path, known.method, state).startswith(f"{tmp_path}: checkpoint.npz: {message}")
