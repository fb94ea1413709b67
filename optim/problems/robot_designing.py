"""The interface of problems whose points are robots, beyond evaluation: for commands and reports."""

import dataclasses
import json
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from numpy.typing import ArrayLike

from optim.problem import Problem
from robots.abilities import refuse_former_names
from robots.ground_files import ground_files, keep_ground_files, kept_in
from robots.partly_fixed import inner_description
from robots.robot import KINDS, Facts, Robot, World
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import Compute
from taichi_sim.base.parsing import parse_json


@dataclass(frozen=True, eq=False, kw_only=True)
class RobotDesigning(Problem):
    """A problem whose points are robots, with what commands and reports need beyond evaluation.

    Attributes:
        precision: ``"f32"`` or ``"f64"``.
        device: ``"cpu"``, ``"cuda"``, ``"vulkan"`` or ``"metal"``.
        threads: CPU threads, all available if None; changes no result, so it is not part of the description.
        progress: called now and then during an evaluation with the fraction done; not part of it either.
    """

    precision: str = "f64"
    device: str = "cpu"
    threads: int | None = None
    progress: Callable[[float], None] | None = None

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        refuse_former_names(cls)

    uncertain = ""  # what is drawn for every judgement, if anything
    draws = 1

    @property
    def offered(self) -> Robot | None:
        """The robot with its free parameters; None if the designed numbers are not all parameters of one robot."""
        return None

    @property
    def plays_on_rigs(self) -> bool:
        """Whether rigs can play its robots; ``rig_report`` of each says whether they do."""
        return self.offered is not None and self.offered.plays_on_rigs

    @property
    @abstractmethod
    def robot_kind(self) -> str:
        """Name of the kind of robot."""

    @property
    @abstractmethod
    def tried_in(self) -> tuple[World, ...]:
        """The worlds in which robots are tried."""

    @property
    def ground_files(self) -> dict[str, str]:
        """SHA-256 of each file of heights on which robots are tried, by its name, as it is now.

        Raises:
            ValueError: for a file that is missing or cannot be read.
        """
        return ground_files(self.tried_in)

    def keep_ground_files(self, folder: Path) -> None:
        """Copy the :attr:`ground_files` to a folder, for :meth:`kept_in`."""
        keep_ground_files(self.tried_in, folder)

    def kept_in(self, folder: Path) -> Self:
        """Return the problem with its ground files read from a folder that keeps copies of them."""
        changed: dict[str, Any] = {}
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if isinstance(value, Terrain):
                changed[field.name] = kept_in(folder, value)
            elif isinstance(value, tuple) and any(isinstance(each, Terrain) for each in value):
                changed[field.name] = tuple(kept_in(folder, each) for each in value)
        return dataclasses.replace(self, **changed)

    @abstractmethod
    def robot_of(self, point: ArrayLike) -> Robot:
        """Return the robot of a point, shape (D,), with nothing free."""

    @property
    def compute(self) -> Compute:
        """Device, precision and threads of the simulations."""
        return Compute(self.device, self.precision, self.threads)

    @property
    @abstractmethod
    def subject(self) -> str:
        """Description of the robot and its worlds, in a few words."""

    @abstractmethod
    def facts(self) -> Facts:
        """Rows for a report: the robot, its worlds, the objective and the simulation."""

    @classmethod
    @abstractmethod
    def settings_of(cls, description: Mapping[str, Any]) -> dict[str, Any]:
        """Convert a description from :meth:`describe` to the fields of the problem.

        Raises:
            KeyError, TypeError: if something is missing or of another type.
            ValueError: for what is not allowed.
        """

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> Self:
        """Build the problem from a description that :meth:`describe` gave, without running any code in it.

        Raises:
            ValueError: that names what is missing, unknown or not allowed.
        """
        try:
            settings = cls.settings_of(description)
            if unknown := settings.keys() - {field.name for field in dataclasses.fields(cls)}:
                raise KeyError(", ".join(sorted(unknown)))
            return cls(**settings)
        except (KeyError, TypeError) as error:
            raise ValueError(f"problem: its description is damaged ({error})") from None

    def columns_of(self, points: Floats) -> Mapping[str, Sequence[str]]:
        """Columns of a table of several points, shape (C, D), beside the objectives: values by name."""
        return {name: [f"{value:.4g}" for value in points[:, n]] for n, name in enumerate(self.space.names)}

    @property
    def curves(self) -> Mapping[str, str]:
        """Details of evaluations to plot over a search, with a label for each."""
        return {}

    @property
    def descriptors(self) -> Mapping[str, tuple[float, float]]:
        """Details that tell designs apart, with their lowest and highest values, as axes of a map of elites."""
        return {}

    def logged(self, point: ArrayLike, best: float | None, details: Mapping[str, Any]) -> list[dict[str, float]]:
        """Measures of the best point in each world, by name, for the log.

        Args:
            point: shape (D,).
            best: its score.
            details: of its evaluation.
        """
        single = len(self.tried_in) == 1
        found = []
        for world in self.tried_in:
            measures: dict[str, float] = {}
            for measure in self.robot_of(point).measures:
                name = measure.name if single else f"{measure.name}_{world.name}"
                value = best if single and (measure.name,) == self.objective_names else details.get(name)
                if isinstance(value, int | float):
                    measures[measure.name] = value
            found.append(measures)
        return found

    def command_options(self, folder: Path) -> dict[str, Any]:
        """Options, by name, with which a command makes the robot of a design that the run in a folder saved."""
        return {}

    def products(self, point: ArrayLike) -> Mapping[str, Callable[[Path], None]]:
        """Functions that write further files about a run's best point, shape (D,), by the names of the files."""
        return {}

    def prepare(self, folder: Path) -> None:
        """Write what a new run folder needs beside the run itself."""


def subject_of(name: str, worlds: Sequence[World]) -> str:
    """Describe a robot and its worlds in a few words."""
    several = len(worlds) > 1
    places = " and ".join(world.spoken or f"on {world.name}" for world in worlds if several or world.spoken)
    return f"{name}, {places}" if places else name


def seeded(description: Mapping[str, Any], before: int, seed: int) -> dict[str, Any]:
    """Replace the seed ``before`` in the description of a search's problem, also in robots that have a seed."""
    options = {option.name for option in KINDS.find(description["kind"]).options} if "robot" in description else set()
    whole = parse_json(description["robot"]) if "seed" in options else {}
    robot = inner_description(whole)
    if robot.get("seed") != before:
        return dict(description)
    robot["seed"] = seed
    return {**description, "robot": json.dumps(whole, separators=(",", ":"))}
