"""Simulate soft and rigid robots, differentiate through them, and design bodies and behaviours together.

These are the names that most programs need. Each is imported when it is first used.
"""

import sys
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

PACKAGES = "taichi_sim", "robots", "optim"
_PLACE = Path(__file__).resolve().parents[1]


class _BesideThis:
    """Finds the lab's packages beside this one, also where a folder of the same name is nearer, such as ``robots/``."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: ModuleType | None = None) -> ModuleSpec | None:
        """The place of one of the lab's packages; nothing of all others."""
        return PathFinder.find_spec(name, [str(_PLACE)], target) if name in PACKAGES else None


for _name in PACKAGES:
    _other = getattr(sys.modules.get(_name), "__file__", None)
    if _other is not None and Path(_other).resolve().parents[1] != _PLACE:
        raise ImportError(
            f"{_name}: {Path(_other).parent} was imported and hides the lab's package; import morpholab before it, or "
            "rename that folder"
        )
sys.meta_path.insert(0, _BesideThis)

from taichi_sim.base.lazy import exported_names  # noqa: E402 - found beside this package

if TYPE_CHECKING:
    from optim.explorer import explore as explore
    from optim.lab import Trials as Trials
    from optim.lab import differentiate as differentiate
    from optim.lab import simulate as simulate
    from optim.lab import view as view
    from optim.many import RobotTrials as RobotTrials
    from optim.many import simulate_all as simulate_all
    from optim.maximising import Maximum as Maximum
    from optim.maximising import maximise as maximise
    from optim.measures import homeostasis as homeostasis
    from optim.measures import learnability as learnability
    from optim.measures import resistance as resistance
    from optim.named import robot as robot
    from optim.named import robots as robots
    from optim.named import world as world
    from optim.problem import Evaluation as Evaluation
    from optim.problem import Problem as Problem
    from optim.problems.function import problem_of as problem_of
    from optim.problems.robot import RobotProblem as RobotProblem
    from optim.runs import open_run as open_run
    from optim.runs import run_search as run_search
    from optim.runs.evaluations import evaluations as evaluations
    from optim.search import METHODS as METHODS
    from optim.search import build_method as build_method
    from optim.space import Space as Space
    from optim.space import Variable as Variable
    from robots.braitenberg import VehicleBody as VehicleBody
    from robots.freeform import FreeformActuation as FreeformActuation
    from robots.freeform import FreeformRobot as FreeformRobot
    from robots.freeform import Grid as Grid
    from robots.freeform import Palette as Palette
    from robots.freeform import Tissue as Tissue
    from robots.hardware import PneumaticRig as PneumaticRig
    from robots.hardware import export_csv as export_csv
    from robots.hardware import read_csv as read_csv
    from robots.inflatable import INCHING as INCHING
    from robots.inflatable import ROLLING as ROLLING
    from robots.inflatable import InflatableDesign as InflatableDesign
    from robots.lattice_robot import Drive as Drive
    from robots.lattice_robot import Free as Free
    from robots.lattice_robot import LatticeRobot as LatticeRobot
    from robots.own_measures import OwnMeasure as OwnMeasure
    from robots.quadruped import LEGGED as LEGGED
    from robots.quadruped import WHEELED as WHEELED
    from robots.quadruped import WHEGGED as WHEGGED
    from robots.robot import KINDS as KINDS
    from robots.robot import Robot as Robot
    from robots.robot import RobotKind as RobotKind
    from robots.schedule import GaitSchedule as GaitSchedule
    from robots.world import Terrain as Terrain
    from taichi_sim.base.compute import Compute as Compute
    from taichi_sim.lattice import LatticeBody as LatticeBody
    from taichi_sim.lattice import LatticeEngine as LatticeEngine
    from taichi_sim.lattice import LatticeProgram as LatticeProgram
    from taichi_sim.lattice import Material as Material
    from taichi_sim.lattice import body_from_array as body_from_array

__getattr__, __dir__, __all__ = exported_names(__name__)
