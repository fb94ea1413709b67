"""Search methods by name: built-in ones are imported when they are used, others come with installed packages."""

import subprocess
import sys

import pytest
from plug_in import install

from optim.search import METHODS, build_method, default_settings, takes_several
from optim.space import Space, Variable

SPACE = Space((Variable("x", -5.0, 5.0, step=0.5),))
METHOD = '''
from dataclasses import dataclass

import numpy as np

from optim.search.base import number
from optim.search.population import PopulationSearch


@dataclass(eq=False, kw_only=True)
class Annealing(PopulationSearch):
    """Children of the population, taken with a chance that falls."""

    cooling: float = number(0.5, 0.0, 1.0)

    def ask(self):
        if self.generation == 0:
            return self._starts()
        steps = self._generator(1).normal(0, 0.5, self.points.shape)
        return self.space.reflect(self.space.round(self.points + steps))

    def _take(self, points, evaluation):
        scores, before = evaluation.objectives[:, 0], self.objectives[:, 0]
        luck = self._generator(2).random(len(points)) < self.cooling ** self.generation
        taken = ~(scores < before) | luck
        self.points = np.where(taken[:, None], points, self.points)
        self.objectives = np.where(taken[:, None], evaluation.objectives, self.objectives)
'''


@pytest.fixture
def annealing(tmp_path, monkeypatch):
    """A package with a method, installed."""
    install(tmp_path / "site", "annealing-kit", METHODS.group, {"annealing": "annealing_kit:Annealing"}, METHOD)
    monkeypatch.syspath_prepend(tmp_path / "site")
    yield
    METHODS._loaded.pop("annealing", None)
    sys.modules.pop("annealing_kit", None)


def test_importing_the_package_imports_no_method():
    program = "import sys, optim.search; print(*(n for n in sys.modules if n.startswith(('optim.search.', 'cmaes'))))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) == {"optim.search.method"}


def test_classes_are_found_in_the_package():
    import optim.search
    from optim.search import CMAESWithMargin

    assert CMAESWithMargin is METHODS["cma"]
    with pytest.raises(AttributeError, match="no attribute 'Annealing'"):
        optim.search.Annealing  # noqa: B018


def test_a_name_that_is_nearly_right(annealing):
    with pytest.raises(ValueError, match=r"method: 'cmaes' is unknown; did you mean cma\? all of them: borg, .*anneal"):
        build_method("cmaes", SPACE, {})


def test_methods_of_packages_are_as_good_as_built_in_ones(annealing):
    method = build_method("annealing", SPACE, {"population": 5, "cooling": 0.25})
    assert method.ask().shape == (5, 1) and not takes_several("annealing")
    assert default_settings("annealing") == {"population": 60, "seed": 0, "cooling": 0.5}
    with pytest.raises(ValueError, match="cooling: 2 is not allowed; give a number from 0 to 1"):
        build_method("annealing", SPACE, {"cooling": 2})
    with pytest.raises(ValueError, match=r"colling: method annealing does not take it; .*; did you mean cooling"):
        build_method("annealing", SPACE, {"colling": 1})


def test_runs_by_methods_of_packages_go_on_to_the_same_bits(annealing, morpholab, simulator, tmp_path):
    search = "codesign --terrain flat --geometry small --method annealing --population 4 --set cooling=0.3 --quiet"
    assert morpholab(f"{search} --generations 4 --out whole")[::2] == (0, "")
    assert morpholab(f"{search} --generations 2 --out parts")[0] == 0
    assert morpholab("codesign --resume --generations 4 --quiet --out parts")[0] == 0
    assert (tmp_path / "whole/log.jsonl").read_bytes() == (tmp_path / "parts/log.jsonl").read_bytes()
    assert "annealing" in morpholab("status whole")[1]
    METHODS._loaded.pop("annealing")
    sys.path.remove(str(tmp_path / "site"))
    code, _, error = morpholab("codesign --resume --generations 5 --quiet --out parts")
    assert code == 2 and error.startswith("morpholab codesign: error: method: 'annealing' is unknown; ")


KEPT = '''
import ctypes

import numpy as np

from optim.search.population import PopulationSearch


class Wandering(PopulationSearch):
    """A population that wanders, by steps of a size that it may remember."""

    def ask(self):
        steps = self._generator(1).normal(0, 0.1, self.points.shape)
        return self.space.reflect(self._starts() + steps * self.size())

    def size(self):
        return 1.0

    def _take(self, points, evaluation):
        self.points, self.objectives = points, evaluation.objectives
        self.remember(points)


class Lister(Wandering):
    arrays = ("archive",)

    def __post_init__(self):
        super().__post_init__()
        self.archive = []

    def remember(self, points):
        self.archive.append(points[0])


class Noner(Wandering):
    arrays = ("elite",)

    def __post_init__(self):
        super().__post_init__()
        self.elite = None

    def remember(self, points):
        self.elite = points[0]


class Dicter(Wandering):
    arrays = ("memo",)

    def __post_init__(self):
        super().__post_init__()
        self.memo = {}

    def remember(self, points):
        self.memo[self.generation] = 1.0


class Forgetful(Wandering):
    def __post_init__(self):
        super().__post_init__()
        self.heat = 1.0

    def remember(self, points):
        self.heat *= 0.8

    def size(self):
        return self.heat


class Drawing(Wandering):
    def __post_init__(self):
        super().__post_init__()
        self.random = np.random.default_rng(self.seed)

    def remember(self, points):
        self.points = self.points + self.random.normal(0, 0.1, self.points.shape) * (self.generation > 0)


class Shelving(Wandering):
    """Needs, to be told anything, what only an instance has that was told something before."""

    def remember(self, points):
        if self.generation == 0:
            self.shelf = {}
        self.shelf[self.generation] = points[0]


class Asking(Shelving):
    def size(self):
        return len(self.shelf) if self.generation else 1.0


class Pointing(Wandering):
    """Holds a pointer of C, which cannot be copied: a ValueError."""

    def __post_init__(self):
        super().__post_init__()
        self.pointer = ctypes.pointer(ctypes.c_int(1))

    def remember(self, points):
        pass


class Faulty(Wandering):
    def remember(self, points):
        raise RuntimeError("my own fault")


class Ending(Wandering):
    """Has two generations to ask for."""

    def ask(self):
        if self.generation > 1:
            raise ValueError("all points were asked for")
        return super().ask()

    def remember(self, points):
        pass


class Missing(Wandering):
    arrays = ("nowhere",)

    def remember(self, points):
        pass


class Keeping(Wandering):
    """Remembers all of it, and draws from nothing but streams."""

    arrays = ("archive", "heat")

    def __post_init__(self):
        super().__post_init__()
        self.archive, self.heat = np.empty((0, self.space.size)), 1.0

    def remember(self, points):
        self.archive, self.heat = np.vstack([self.archive, points[:1]]), self.heat * 0.8

    def size(self):
        return self.heat / (1 + len(self.archive))
'''
HILL = "bounds = {'x': (0, 1), 'y': (0, 1)}\ndef evaluate(points):\n    return -points[:, 0] ** 2\n"
MORE = ("shelving", "asking", "pointing", "faulty", "ending")
OF_STATE = "cannot be restored from its own checkpoint: state: "


@pytest.fixture
def wandering(tmp_path, monkeypatch):
    """A package with methods that keep what changes in several ways, and the file of a problem."""
    names = ("lister", "noner", "dicter", "forgetful", "drawing", "missing", "keeping", *MORE)
    points = {name: f"wandering_kit:{name.capitalize()}" for name in names}
    install(tmp_path / "site", "wandering-kit", METHODS.group, points, KEPT)
    monkeypatch.syspath_prepend(tmp_path / "site")
    (tmp_path / "hill.py").write_text(HILL)
    yield
    for name in names:
        METHODS._loaded.pop(name, None)
    sys.modules.pop("wandering_kit", None)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("lister", f"method: lister {OF_STATE}archive of shape (1, 2), expected (0,)"),
        ("noner", f"method: noner {OF_STATE}elite of type NoneType is not allowed; give a number or an array"),
        ("dicter", "state: memo of type dict is not allowed; give a number or an array"),
        ("missing", "state: nowhere of type NoneType is not allowed; give a number or an array"),
        (
            "forgetful",
            "does not go on alike from its checkpoint: it asks for other points; heat of it must be in arrays",
        ),
        (
            "shelving",
            "shelving does not go on alike from its checkpoint: its tell fails (AttributeError: 'Shelving' object has "
            "no attribute 'shelf'); all that changes must be in arrays",
        ),
        ("asking", "its ask fails (AttributeError: 'Asking' object has no attribute 'shelf'); "),
        ("drawing", "does not go on alike from its checkpoint: points becomes another one; "),
    ],
)
def test_a_method_whose_state_is_not_whole_is_refused_before_a_generation_is_lost(
    wandering, morpholab, tmp_path, name, told
):
    search = f"codesign --problem hill.py --method {name} --population 3 --generations 5 --quiet --out a"
    code, _, error = morpholab(search)
    assert code == 2 and told in error and error.count("\n") == 1
    assert name in ("drawing", "shelving") or not (tmp_path / "a/log.jsonl").exists()


def test_a_method_whose_state_is_whole_goes_on_to_the_same_bits(wandering, morpholab, tmp_path):
    search = "codesign --problem hill.py --method keeping --population 3 --quiet"
    assert morpholab(f"{search} --generations 6 --out whole")[::2] == (0, "")
    assert morpholab(f"{search} --generations 2 --out parts")[0] == 0
    assert morpholab("codesign --resume --problem hill.py --generations 6 --quiet --out parts")[0] == 0
    assert (tmp_path / "whole/log.jsonl").read_bytes() == (tmp_path / "parts/log.jsonl").read_bytes()


@pytest.mark.parametrize(("name", "generations"), [("pointing", 4), ("ending", 1)])
def test_a_rehearsal_stops_no_run_of_which_nothing_can_be_compared(wandering, morpholab, name, generations):
    search = f"codesign --problem hill.py --method {name} --population 3 --generations {generations} --quiet --out a"
    assert morpholab(search)[::2] == (0, "")


def test_a_fault_of_the_method_itself_is_told_as_such(wandering, morpholab):
    code, _, error = morpholab("codesign --problem hill.py --method faulty --population 3 --quiet --out a")
    assert code == 1 and error.endswith("RuntimeError: my own fault\n") and "wandering_kit.py, line" in error
