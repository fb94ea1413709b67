"""``morpholab reproduce``: every study in its catalogue exists, one runs whole, and mistakes are one line."""

import json
from dataclasses import replace
from inspect import signature

import pytest
from plug_in import install

from optim.studies.catalogue import STUDIES
from optim.studies.chapter3 import rover_success, sweep_study
from optim.studies.chapter3.sweep_study import SensorPlacement
from optim.studies.chapter3.sweep_table import sample_designs
from optim.studies.chapter4 import training
from optim.studies.chapter4.training import Training, TrainingInBodies
from robots.braitenberg import Sweep
from robots.world import Terrain
from taichi_sim.base.files import sha256
from taichi_sim.base.results_folder import ResultsFolder


@pytest.mark.parametrize("name", STUDIES)
def test_every_study_is_there_and_takes_what_it_says(name):
    study = STUDIES[name]
    taken = signature(study.run).parameters
    assert list(taken)[:3] == ["folder", "settings", "progress"] and {"small", "full"} <= set(study.scales)
    assert study.options == {"sweep_folder", "jobs"} & set(taken)
    assert study.source and study.title and study.writes


def test_studies_are_listed(morpholab):
    code, out, _ = morpholab("reproduce")
    assert code == 0 and all(f"{name}: " in out for name in STUDIES)
    assert list(json.loads(morpholab("reproduce --json")[1])) == list(STUDIES)


@pytest.mark.kernels
def test_a_study_writes_what_it_says(morpholab, tmp_path, monkeypatch):
    monkeypatch.setitem(sweep_study.STUDY.scales, "small", SensorPlacement(2, Sweep(weights=7, steps=800)))
    code, out, _ = morpholab("reproduce sensor-placement --out a --quiet")
    assert code == 0 and all((tmp_path / "a" / name).is_file() for name in STUDIES["sensor-placement"].writes)
    assert "table.csv" in out
    table = (tmp_path / "a/table.csv").read_text().splitlines()
    assert [line.split(",")[0] for line in table] == [
        "design",
        *map(str, sorted([*sweep_study.NOTABLE, *sample_designs(2)])),
    ]
    code, out, error = morpholab("reproduce sensor-placement --from-data a --out b")
    names = sorted(path.name for path in (tmp_path / "a").iterdir() if path.suffix in (".csv", ".npz", ".png"))
    assert set(STUDIES["sensor-placement"].writes) <= set(names)
    assert (code, out) == (0, f"b: {', '.join(names)}\n"), error
    assert all((tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes() for name in names)
    (tmp_path / "a/table.csv").unlink()
    assert (
        "from-data: a has no table of a sweep; give one"
        in morpholab("reproduce sensor-placement --from-data a --out c")[2]
    )


STUDY = """
from optim.experiments.study import Study


def study(folder, settings, progress=None):
    folder.mkdir()
    (folder / "hops.txt").write_text(settings * "hop ")
    progress(1.0)


HOPS = Study("how often a hopper hops", "nowhere", {"small": 2, "full": 3}, study, ("hops.txt",), "no time")
"""


def test_a_study_of_an_installed_package_is_listed_and_runs(morpholab, tmp_path, monkeypatch):
    install(tmp_path / "site", "hopping-kit", STUDIES.group, {"hops": "hopping_kit:HOPS"}, STUDY)
    monkeypatch.syspath_prepend(tmp_path / "site")
    assert "hops: how often a hopper hops (nowhere; full: no time)\n" in morpholab("reproduce")[1]
    code, out, error = morpholab("reproduce hops --out a --quiet --budget full")
    assert (code, out, error) == (0, "a: hops.txt\n", "")
    assert (tmp_path / "a/hops.txt").read_text() == "hop hop hop "
    assert "budget: 'medium' is unknown" in morpholab("reproduce hops --out b --budget medium")[2]
    code, _, error = morpholab("reproduce hops --from-data a --out b")
    assert code == 2 and "from-data: study hops is not told from tables; " in error and not (tmp_path / "b").exists()
    STUDIES._loaded.pop("hops")


def test_hunts_take_the_friction_of_the_ground(morpholab, monkeypatch):
    able = {name for name in STUDIES if STUDIES[name].has_ground}
    assert able == {"gait-hunt", "gait-climb", "robust-gaits", "capped-gaits", "robust-searches"}
    seen = []
    for name in ("gait-hunt", "gait-climb"):
        seen_by = lambda folder, settings, progress, **options: seen.append(settings)  # noqa: E731
        monkeypatch.setitem(STUDIES._loaded, name, replace(STUDIES[name], run=seen_by))
        for ground in ("", "--floor wood", "--friction 0.1,1"):
            assert morpholab(f"reproduce {name} --out a --quiet {ground}")[0] == 0
    pairs = [(settings.terrain, settings.about_hill) for settings in seen]
    hills = [Terrain(15.0), Terrain(15.0, 0.7, 0.56), Terrain(15.0, 1.0, 0.1)]
    told = [{}, {"friction": [0.56, 0.7]}, {"friction": [0.1, 1.0]}]
    assert pairs == 2 * [(hill, {"slope": 15.0, **more}) for hill, more in zip(hills, told, strict=True)]


@pytest.mark.parametrize("name", STUDIES)
def test_a_folder_of_something_else_is_refused_before_any_work(morpholab, tmp_path, name):
    (tmp_path / "a").mkdir()
    (tmp_path / "a/notes.txt").write_text("mine")
    code, _, error = morpholab(f"reproduce {name} --out a --quiet")
    assert code == 2 and error.endswith("out: a holds something else; name a new folder\n")
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("reproduce training --out a --floor wood", "floor: study training has its own; leave it out"),
        ("reproduce training --out a --friction 0.1,1", "friction: study training has its own; leave it out"),
        ("reproduce gait-hunt --out a --floor gravel", "floor: gravel is not allowed, as no friction on it"),
        ("reproduce --floor wood", "floor: wood is not allowed without a study; name one first"),
        (
            "reproduce trainings --out a",
            "study: 'trainings' is unknown; did you mean training? all of them: sensor-placement",
        ),
        ("reproduce training", "out: none given; name a folder for the results"),
        ("reproduce co-optimisation --out a --sweep b", "sweep: study co-optimisation reads none; leave it out"),
        (
            "reproduce training --out a --jobs 2",
            "jobs: 2 is not allowed with study training; freeform, gait-hunt, gait-climb",
        ),
        ("reproduce gait-hunt --out a --jobs 0", "argument --jobs: 0 is not allowed; give a whole number, at least 1"),
    ],
)
def test_mistakes_are_one_line(morpholab, line, message):
    code, _, error = morpholab(line)
    assert code == 2 and message in error and error.count("\n") == 1


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SensorPlacement(0), "sample: 0 is not allowed; give a whole number, at least 1"),
        (lambda: TrainingInBodies(7000), "sample: 7000 is not allowed; give at most 6561"),
        (lambda: TrainingInBodies(weights=1), "weights: 1 is not allowed"),
    ],
)
def test_settings_that_are_not_allowed_are_one_line(make, message):
    with pytest.raises(ValueError) as raised:
        make()
    assert str(raised.value).startswith(message) and "\n" not in str(raised.value)


OF_1_0 = {  # digests of the settings that folders of full budgets of version 1.0 know
    "sensor-placement": "d9edafbcc3f58289",
    "training": "23d195c66ec99923",
    "co-optimisation": "40c531ab0f1252d6",
    "search-comparison": "fe78272121f923ae",
    "homeostasis-of-bodies": "ebf9956deedf4342",
    "reality-gap": "87c1fae93cc34656",
    "homeostasis-objective": "cb3458160b7f9c4f",
    "rover-success": "c68824aefe950e0a",
    "rover-pre-optimisation": "737a075da372df0e",
    "shape-change": "165dd6f221d403fd",
    "friction-sweeps": "52242830a194b45a",
    "slope-sweep": "e71203e403ce2e0c",
    "hand-gait-sensitivity": "a5773d5308fa4e49",
    "soft-robot-metrics": "cca7f9391024b558",
}


@pytest.mark.parametrize("name", OF_1_0)
def test_folders_of_version_1_0_go_on(monkeypatch, tmp_path, name):
    """The first folder that a study opens has the settings that it had, to the letter; of the rover, the long one."""

    class Opened(Exception):
        """Ends the study before any work."""

    def opened(_, path, kind, settings):
        raise Opened(json.dumps(settings))

    monkeypatch.setattr(ResultsFolder, "__init__", opened)
    monkeypatch.setattr(rover_success, "overlaps_of", lambda *_, **__: None)  # of the theory, which goes first
    with pytest.raises(Opened) as settings:
        STUDIES[name].reproduce(tmp_path / "a")
    assert sha256(str(settings.value).encode())[:16] == OF_1_0[name]


def test_folders_know_their_study_by_these_settings_in_this_order():
    """A folder of before goes on only where the text of its settings is the same."""
    placement = sweep_study.STUDY.scales["small"].describe()
    assert list(placement) == ["weights", "radius", "time_step", "steps", "precision", "bodies"]
    assert (placement["weights"], placement["bodies"]) == (41, 100)
    trained = training.STUDY.scales["small"].describe()
    assert list(trained) == [*Training().describe(), "bodies", "weights"]
    assert (trained["repetitions"], trained["bodies"], trained["weights"]) == (2, 20, 41)
