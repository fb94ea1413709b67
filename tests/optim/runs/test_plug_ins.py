"""Runs know the versions of packages of users that they need."""

import json
import re
import sys
import types

import pytest
from plug_in import install

from optim.problems.objectives import OBJECTIVES
from optim.runs.environment import LAWS, PRESENT_LAWS, differences, other_version, versions
from optim.runs.plug_ins import packages_of
from optim.runs.workers.folder_files import Offer
from optim.search import METHODS
from robots.robot import KINDS

MODULE = """
from optim.problems.objectives import RobotObjective
from optim.search.population import PopulationSearch
from robots.robot import Measure, Outcome, Parameter, Robot, RobotKind


class Slider(Robot):
    kind = "slider"
    parameters = (Parameter("push", 0.0, 1.0, step=0.1),)
    measures = (Measure("way", "m"),)

    def run(self, points, trial):
        return Outcome({"way": points[:, 0]})


class SliderKind(RobotKind):
    name, title = "slider", "slider"

    def build(self, source, options):
        return Slider()


class Squared(RobotObjective):
    def score(self, outcome, measure):
        return outcome.measures[measure.name] ** 2


class Sampling(PopulationSearch):
    def ask(self):
        return self._starts() if self.generation == 0 else self.space.sample(self._generator(1), self.population)

    def _take(self, points, evaluation):
        self.points, self.objectives = points, evaluation.objectives
"""
GROUPS = ((KINDS, "slider", "SliderKind"), (OBJECTIVES, "squared", "Squared"), (METHODS, "sampling", "Sampling"))
SEARCH = "codesign --robot slider --objective squared --method sampling --population 3 --quiet --out a"


@pytest.fixture
def slider(tmp_path, monkeypatch):
    """Packages with a robot, an objective and a method, installed."""
    site = tmp_path / "site"
    for registry, name, attribute in GROUPS:
        install(site, f"kit_of_{name}", registry.group, {name: f"slider_kit:{attribute}"})
    install(site, "unrelated", KINDS.group, {"unrelated": "nowhere:Kind"})
    (site / "slider_kit.py").write_text(MODULE)
    monkeypatch.syspath_prepend(site)
    yield site
    for registry, name, _ in GROUPS:
        registry._loaded.pop(name, None)
    sys.modules.pop("slider_kit", None)


def release(site, package, version):
    """Install another version of a package."""
    path = site / f"{package}-1.0.dist-info/METADATA"
    path.write_text(path.read_text().replace("Version: 1.0", f"Version: {version}"))


def test_a_run_notes_other_versions_of_the_packages_that_it_needs(slider, morpholab, tmp_path):
    assert morpholab(f"{SEARCH} --generations 1")[::2] == (0, "")
    known = json.loads((tmp_path / "a/environment.json").read_text())["versions"]
    added = {name: version for name, version in known.items() if name not in versions()}
    assert list(added) == ["kit_of_sampling", "kit_of_slider", "kit_of_squared"]
    (code,) = set(added.values())  # one module defines all three
    assert re.fullmatch(r"1\.0 \(code [0-9a-f]{8}\)", code)
    assert morpholab("codesign --resume --generations 2 --quiet --out a")[::2] == (0, "")
    for package in added:
        release(slider, package, "2.0")
    told = ", ".join(f"{package} {code}, now {code.replace('1.0', '2.0')}" for package in sorted(added))
    assert morpholab("codesign --resume --generations 3 --quiet --out a")[::2] == (
        0,
        f"morpholab codesign: note: a: began elsewhere ({told}); results may differ\n",
    )


def test_an_edited_package_of_the_same_version_is_noticed(slider, morpholab, tmp_path):
    assert morpholab(f"{SEARCH} --generations 1")[::2] == (0, "")
    before = versions(["kit_of_slider"])["kit_of_slider"]
    (slider / "slider_kit.py").write_text(MODULE.replace("points[:, 0]", "2 * points[:, 0]"))
    after = versions(["kit_of_slider"])["kit_of_slider"]
    assert before != after
    code, _, error = morpholab("codesign --resume --generations 2 --quiet --out a")
    assert code == 0
    assert f"kit_of_slider {before}, now {after}" in error


def test_code_in_every_file_of_a_package_counts(tmp_path, monkeypatch):
    install(tmp_path, "deep_kit", KINDS.group, {"deep": "deep_package.inner:Kind"})
    inner = tmp_path / "deep_package/inner.py"
    inner.parent.mkdir()
    (inner.parent / "__init__.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    found = []
    for text in ("x = 1", "x = 2", "x = 1"):
        inner.write_text(text)
        found.append(versions(["deep_kit"])["deep_kit"])
    assert found[0] == found[2] != found[1]
    assert versions(["no_such_kit"])["no_such_kit"] is None


def test_runs_that_noted_no_code_are_not_told_to_have_begun_elsewhere():
    before = {"versions": {"kit": "1.0", LAWS: PRESENT_LAWS}}
    assert differences(before, {"versions": {"kit": "1.0 (code 0a1b2c3d)", LAWS: PRESENT_LAWS}}) == []
    assert differences(before, {"versions": {"kit": "2.0 (code 0a1b2c3d)", LAWS: PRESENT_LAWS}}) == ["kit 1.0, now 2.0"]


def test_laws_that_changed_are_told():
    """Folders of before name none."""
    before, now = {"versions": {"numpy": versions()["numpy"]}}, {"versions": versions()}
    assert f"laws 1, now {PRESENT_LAWS}" in differences(before, now)
    assert differences({"versions": versions()}, {"versions": versions()}) == []
    assert differences({}, {}) == [] and differences({}, {"versions": versions()}) == []


def test_code_of_other_distributions_does_not_count(tmp_path, monkeypatch):
    install(tmp_path, "spread_kit", KINDS.group, {"spread": "company.kit.robots:Kind"})
    (tmp_path / "company/kit").mkdir(parents=True)
    (tmp_path / "company/other").mkdir()
    for name in ("kit/__init__.py", "kit/robots.py", "other/robots.py"):
        (tmp_path / "company" / name).write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    before = versions(["spread_kit"])
    (tmp_path / "company/other/robots.py").write_text("x = 1")
    assert versions(["spread_kit"]) == before
    (tmp_path / "company/kit/robots.py").write_text("x = 1")
    assert versions(["spread_kit"]) != before


def test_a_module_made_by_hand_has_no_code(tmp_path, monkeypatch):
    install(tmp_path, "odd_kit", KINDS.group, {"odd": "odd_module:Kind"})
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(sys.modules, "odd_module", types.ModuleType("odd_module"))
    assert versions(["odd_kit"])["odd_kit"].startswith("1.0 (code ")


def test_workers_need_the_version_of_what_they_judge_by(slider, tmp_path):
    problem = {"kind": "slider", "robot": "{}", "objective": ["mean", "minimise:2*squared", "way"]}
    assert packages_of(problem) == ["kit_of_slider", "kit_of_squared"]
    offer = Offer.here(problem, 1.0)
    release(slider, "kit_of_squared", "1.1")
    name, here, there = other_version(versions(packages_of(problem)), offer.versions)
    assert (name, here[:10], there[:10]) == ("kit_of_squared", "1.1 (code ", "1.0 (code ")


def test_problems_of_files_and_built_in_ones_need_none(slider):
    assert packages_of({"kind": "file", "objective": "what:ever"}) == []
    assert packages_of({"kind": "quadruped", "robot": "{}", "objective": "worst"}, "cma") == []
