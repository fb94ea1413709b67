"""Mistakes in packages of users: each is told in one line that says where it is, and disables nothing else."""

import sys

import pytest
from plug_in import install

from optim.problems.objectives import OBJECTIVES
from optim.search import METHODS
from optim.studies.catalogue import STUDIES
from robots.robot import KINDS

MODULE = """
import numpy as np

from optim.problems.objectives import RobotObjective
from optim.search.population import PopulationSearch
from robots.robot import Measure, Option, Outcome, Parameter, Robot, RobotKind


class Base(Robot):
    kind = "base"
    parameters = (Parameter("a", 0.0, 1.0), Parameter("b", 0.0, 1.0))
    measures = (Measure("height", "m"), Measure("mass", "kg"))
    differentiable = True


def kind_of(title, run, **more):
    made = type("Of" + title.capitalize(), (Base,), {"kind": title, "run": run, **more})
    globals()[made.__name__] = made  # where workers find it
    return type(title.capitalize(), (RobotKind,), {"name": title, "title": title, "build": lambda *_: made()})


def both(p):
    return {"height": p[:, 0], "mass": p[:, 1]}


def fail():
    raise RuntimeError("my own fault")


Sound = kind_of("sound", lambda s, p, t: Outcome(both(p), gradients={"height": np.ones_like(p)}))
Lacking = kind_of("lacking", lambda s, p, t: Outcome({"height": p[:, 0]}))
Short = kind_of("short", lambda s, p, t: Outcome({"height": p[:1, 0], "mass": p[:1, 0]}))
Steep = kind_of("steep", lambda s, p, t: Outcome(both(p), gradients={"height": np.ones((len(p), 1))}))
Flat = kind_of("flat", lambda s, p, t: Outcome(both(p), gradients={"height": np.ones(2)}))
Failing = kind_of("failing", lambda s, p, t: fail())
Table = kind_of("table", lambda s, p, t: both(p))
Wide = kind_of("wide", lambda s, p, t: Outcome({"height": p, "mass": p[:, 0]}))
Unequal = kind_of("unequal", lambda s, p, t: Outcome(both(p), ["ok"]))
Unjudged = kind_of("unjudged", lambda s, p, t: Outcome({}), measures=())
Unlike = kind_of("unlike", lambda s, p, t: Outcome(both(p + np.ones(7))))
Refusing = kind_of("refusing", lambda s, p, t: refuse(ValueError("world: I know none")))
Fileless = kind_of("fileless", lambda s, p, t: open("/nowhere/at/all"))
Speechless = kind_of("speechless", lambda s, p, t: refuse(Speechlessness()))
Voiceless = kind_of("voiceless", lambda s, p, t: refuse(Voicelessness()))
Leaving = kind_of("leaving", lambda s, p, t: refuse(SystemExit("bye")))
Complex = kind_of("complex", lambda s, p, t: Outcome({"height": p[:, 0], "mass": p[:, 1] + 1j}))
Wordy = kind_of("wordy", None, parameters=["push", "stroke"])
Untold = kind_of("untold", None, measures=None)
Motionless = kind_of("motionless", lambda s, p, t: Outcome(both(p)), steps=10, motion=lambda *_: None)


def refuse(error):
    raise error


class Speechlessness(Exception):
    def __str__(self):
        return 1 / 0


class Voicelessness(Speechlessness, ValueError):
    pass


class Askless(PopulationSearch):
    def ask(self):
        return None

    def _take(self, points, evaluation):
        pass


class Nothing(RobotKind):
    name, title = "nothing", "nothing"

    def build(self, source, options):
        return None


class Clashing(Sound):
    name, title = "clashing", "clashing"
    options = (
        Option("seed", "which may be shared", int, commands=("codesign",)),
        Option("measure", "of a designer", commands=("codesign",)),
        Option("record_every", "of the command", commands=("simulate",)),
        Option("far_from_all", "of nobody else", int),
    )


class Abstract(RobotKind):
    name, title = "abstract", "abstract"


class Scalar(RobotObjective):
    def score(self, outcome, measure):
        return np.float64(1.0)


class Level(RobotObjective):
    def score(self, outcome, measure):
        return outcome.measures[measure.name]

    def slopes(self, outcome, measure):
        return np.ones(len(outcome.status))


NUMBER = 3
"""
KINDS_OF_IT = (
    "Sound",
    "Lacking",
    "Short",
    "Steep",
    "Flat",
    "Failing",
    "Table",
    "Wide",
    "Unequal",
    "Unjudged",
    "Unlike",
    "Refusing",
    "Fileless",
    "Speechless",
    "Voiceless",
    "Leaving",
    "Complex",
    "Wordy",
    "Untold",
    "Motionless",
    "Nothing",
    "Clashing",
    "Abstract",
)
GROUPS = (
    (KINDS, {**{name.lower(): name for name in KINDS_OF_IT}, "number": "NUMBER", "lost": "Nowhere"}),
    (OBJECTIVES, {"scalar": "Scalar", "level": "Level", "three": "NUMBER"}),
    (STUDIES, {"number": "NUMBER"}),
    (METHODS, {"askless": "Askless"}),
)


@pytest.fixture
def faulty(tmp_path, monkeypatch):
    """Packages with mistakes, installed; their module."""
    site = tmp_path / "site"
    for number, (registry, points) in enumerate(GROUPS):
        install(site, f"faulty{number}", registry.group, {name: f"faulty_kit:{what}" for name, what in points.items()})
    (site / "faulty_kit.py").write_text(MODULE)
    monkeypatch.syspath_prepend(site)
    yield site / "faulty_kit.py"
    for registry, points in GROUPS:
        for name in points:
            registry._loaded.pop(name, None)
    sys.modules.pop("faulty_kit", None)


def refused(morpholab, line):
    """What a command says in its one line that it cannot do."""
    code, _, error = morpholab(line)
    assert code in (1, 2) and error.count("\n") == 1
    return error.partition(": ")[2]


SIZES = "(3,) for points of (3, 2)\n"
MISTAKES = {
    "lacking": "error: robot: faulty_kit.OfLacking.run returns an Outcome without the measure mass; it has height\n",
    "short": f"error: robot: faulty_kit.OfShort.run returns height of shape (1,); give {SIZES}",
    "table": "error: robot: faulty_kit.OfTable.run returns a value of type dict; return an Outcome\n",
    "failing": "failed: {module}, line 27: RuntimeError: my own fault\n",
    "flat": "line 34: TypeError: gradients of height of shape (2,) are not allowed; give (3, parameters)\n",
    "wide": "line 37: TypeError: measures of shapes height (3, 2), mass (3,) are not allowed; "
    "an Outcome has one number of each for each point\n",
    "unequal": "line 38: TypeError: status of shape (1,) is not allowed; give (3,), one for each point\n",
    "unjudged": "returns a robot without measures; name one at least, by which it is judged\n",
    "unlike": "failed: {module}, line 40: ValueError: operands could not be broadcast together",
    "refusing": "error: world: I know none\n",
    "fileless": "failed: {module}, line 42: FileNotFoundError: [Errno 2] No such file or directory: '/nowhere",
    "speechless": "failed: {module}, line 53: Speechlessness\n",
    "voiceless": "failed: {module}, line 53: Voicelessness\n",
    "leaving": "failed: {module}, line 53: SystemExit: bye\n",
    "complex": "line 46: TypeError: measures of mass are complex, which is not allowed; give real numbers\n",
    "wordy": "returns a robot whose parameters are ['push', 'stroke']; give a tuple of Parameter objects\n",
    "untold": "returns a robot without measures; name one at least, by which it is judged\n",
    "nothing": "error: robot: faulty_kit.Nothing.build returns a value of type NoneType; return a Robot\n",
    "abstract": "error: robot: 'abstract' cannot be made: Can't instantiate abstract class",
    "number": "error: robot: 'number' of the package faulty0 is of type int; give an instance of RobotKind or a class",
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_of_a_kind_of_robot_is_told_where_it_is(faulty, morpholab, name):
    line = f"codesign --robot {name} --method genetic --population 3 --generations 0 --quiet --out a"
    assert MISTAKES[name].format(module=faulty) in refused(morpholab, line)


@pytest.mark.parametrize("name", ["unlike", "speechless", "leaving", "fileless"])
def test_workers_tell_where_a_mistake_of_a_kind_is(faulty, morpholab, name):
    line = f"codesign --robot {name} --method genetic --population 3 --generations 0 --workers 2 --quiet --out a"
    assert MISTAKES[name].format(module=faulty) in refused(morpholab, line)


def test_a_motion_and_points_of_other_types_are_told(faulty, morpholab):
    told = refused(morpholab, "view motionless --quiet --out a.html")
    assert told == "error: robot: faulty_kit.OfMotionless.motion returns a value of type NoneType; return a Motion\n"
    told = refused(morpholab, "codesign --robot sound --method askless --generations 1 --quiet --out a")
    assert told == (
        "error: method: faulty_kit.Askless.ask returns a value of type NoneType; return an array of shape (N, D)\n"
    )


def test_gradients_for_a_part_of_the_parameters_are_told(faulty, morpholab):
    told = refused(morpholab, "codesign --robot steep --method gradient --climbers 3 --generations 1 --quiet --out a")
    assert told.endswith("returns a gradient of height of shape (3, 1); give (3, 2) for points of (3, 2)\n")


def test_a_mistake_of_an_objective_is_told_where_it_is(faulty, morpholab):
    line = "codesign --robot sound --objective {} --method {} --generations 1 --quiet --out a"
    assert "faulty_kit.Scalar.score returns a value of shape (); " in refused(
        morpholab, line.format("scalar", "random")
    )
    told = refused(morpholab, line.format("2*scalar --objective mass", "random"))
    assert "faulty_kit.Scalar.score returns a value of shape (); " in told
    told = refused(morpholab, line.format("level", "gradient"))
    assert "objective: faulty_kit.Level.slopes returns a value of shape (" in told
    assert "'three' of the package faulty1 is of type int; " in refused(morpholab, line.format("three", "random"))


def test_a_broken_package_is_left_out_of_what_is_about_others(faulty, morpholab, tmp_path):
    code, out, error = morpholab("reproduce")
    assert code == 0 and "sensor-placement: " in out
    assert error == (
        "morpholab reproduce: note: study: 'number' of the package faulty2 is of type int; give an instance of Study; "
        "it is left out\n"
    )
    assert "study: 'number' of the package faulty2 is of type int" in refused(morpholab, "reproduce number --out a")
    (tmp_path / "other.json").write_text('{"format": "something"}')
    for robot, told in (("inchin", "did you mean inching?"), ("other.json", "it is no file of a robot or a design")):
        code, _, error = morpholab(f"simulate --robot {robot}")
        *notes, last = error.splitlines()
        assert code == 2 and told in last
        assert any("'lost' of the package faulty0 cannot be imported" in note for note in notes)
        assert all(note.endswith("; it is left out") for note in notes)
    assert "'lost' of the package faulty0 cannot be imported (" in refused(morpholab, "simulate --robot lost")


@pytest.mark.parametrize("name", ["weight", "mass_world"])
def test_descriptors_that_no_trial_tells_are_refused_before_any_work(faulty, morpholab, tmp_path, name):
    search = "codesign --robot sound --method map-elites --population 300 --generations 1 --quiet"
    ranges = f"""--set 'descriptors=["a","{name}"]' --set 'ranges={{"{name}":[0,1]}}'"""
    told = refused(morpholab, f"{search} {ranges} --out a")
    assert told == f"error: descriptors: {name} is no detail of the evaluation; it has mass\n"
    assert not (tmp_path / "a").exists()
    ranges = ranges.replace(name, "mass")
    assert morpholab(f"{search} {ranges} --out a")[0] == 0


def test_options_that_are_called_as_those_of_commands_are_refused(faulty, morpholab):
    """Where they are given; without them the kind is as good as any."""
    told = "error: {}: clashing has such an option, as the command has; have its package rename it\n"
    line = "codesign --robot clashing --method random --climbers 2 --generations 0 --quiet --out a"
    assert refused(morpholab, f"{line} --measure mass") == told.format("measure")
    assert refused(morpholab, "simulate --robot clashing --record-every 5 --out s") == told.format("record-every")
    assert morpholab(line)[::2] == morpholab("simulate --robot clashing")[::2] == (0, "")


def test_broken_packages_are_not_told_of_where_they_do_not_matter(faulty, morpholab):
    line = "codesign --robot sound --method genetic --population 3 --generations 1 --quiet --out a"
    assert morpholab(line)[::2] == (0, "")
