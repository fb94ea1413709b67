"""Problems that users define in a Python file, which they give to the command."""

import contextlib
import dataclasses
import json
import runpy
import tempfile
from collections.abc import Iterator, Mapping
from functools import cached_property, partial
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, cast

from numpy.typing import ArrayLike

from optim.problem import (
    DESIGN,
    FILE,
    Evaluation,
    Minibatch,
    Objective,
    Problem,
    check_kind,
    design_in,
    has_minibatches,
    objectives_of,
)
from optim.problems import problem_of_description
from optim.problems.function import PlainProblem, problem_of
from optim.problems.robot import RobotProblem
from optim.problems.robot_designing import RobotDesigning
from optim.space import Space, Variable
from robots.own_measures import RobotFile, of_file
from taichi_sim.base.files import content_of, sha256, why_unread
from taichi_sim.base.foreign import blamed, modules_beside, users_code
from taichi_sim.base.short_text import counted

CHECKS = ("check_mixtures", "check_gradients", "check_true_gradients")  # of a search, which some problems have
TOLD = ("descriptors", "detail_names", "gradient_horizon")  # what some problems tell a search
GIVEN = ("name", "unit", "gradient")  # what a file may say beside its function and bounds


class FileProblem(PlainProblem):
    """A problem defined in a Python file, which is run to build it, here and in every worker process.

    Attributes:
        file: name of the file, without its folder.
        source: its content.
    """

    def __init__(self, file: str, source: bytes, folder: str) -> None:
        """Run the source.

        Args:
            file: name of the file, for messages.
            source: Python that sets ``problem``; or ``bounds`` and a function ``evaluate``, and perhaps ``name``,
                ``unit`` and ``gradient``, as :func:`optim.problem_of` takes them.
            folder: from where it imports modules beside it.

        Raises:
            ValueError: if that fails, or the source defines no problem.
        """
        self.file, self.source, self._folder = file, source, folder
        self._modules: dict[str, ModuleType] = {}  # beside the file, of which another folder has some of the same names
        names, self._run_as = _run(file, source, folder, self._modules)
        self._problem = _defined(names, file)
        self._kept: dict[str, str] | None = None
        super().__init__(self._problem.space, objectives_of(self._problem))
        self._offer()

    def _offer(self) -> None:
        """Have the abilities that not every problem has, if the file's has them."""
        if hasattr(self._problem, "evaluate_relaxed"):
            self.evaluate_relaxed = self._evaluate_relaxed
        for name in CHECKS:
            if hasattr(self._problem, name):
                setattr(self, name, partial(self._check, name))
        for name in TOLD:
            if hasattr(self._problem, name):
                setattr(self, name, getattr(self._problem, name))
        if has_minibatches(self._problem):
            self.in_minibatch, self.check_minibatch = self._in_minibatch, self._check_minibatch

    def __reduce__(self) -> tuple[type["FileProblem"], tuple[str, bytes, str]]:
        return FileProblem, (self.file, self.source, self._folder)

    @contextlib.contextmanager
    def _at_work(self) -> Iterator[None]:
        """Run functions of the file inside: they are blamed for what they raise, and may import modules beside it."""
        with blamed(self.file, self._run_as), modules_beside(self._folder, self._modules):
            yield

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Evaluate points, shape (N, D)."""
        with self._at_work():
            return self._problem.evaluate(points)

    def _evaluate_relaxed(self, points: ArrayLike, sharpness: float, gradients: bool) -> Evaluation:
        with self._at_work():
            return self._problem.evaluate_relaxed(points, sharpness, gradients)  # type: ignore[attr-defined]

    def _check(self, name: str) -> None:
        with self._at_work():
            getattr(self._problem, name)()

    def _in_minibatch(self, minibatch: Minibatch) -> "FileProblem":
        part = object.__new__(type(self))  # a copy would run the source again
        part.__dict__.update(self.__dict__)
        with self._at_work():
            part._problem = self._problem.in_minibatch(minibatch)  # type: ignore[attr-defined]
        part._offer()
        return part

    def _check_minibatch(self, size: int) -> None:
        with self._at_work():
            self._problem.check_minibatch(size)  # type: ignore[attr-defined]

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write a point as the problem does; as values by name if it says nothing else."""
        save = getattr(self._problem, "save", None)
        if save is None:
            super().save(point, path)
        else:
            save(point, path)

    def describe(self) -> dict[str, Any]:
        """The file's name and checksum, variables and objectives, as JSON values; not its source, nor where it is.

        A problem of a robot is described, too, where data can, so that designs can be seen without the file.
        """
        design = self._design() if self._kept is None else self._kept
        return {"kind": FILE, "file": self.file, "sha256": sha256(self.source), **self.table(), **design}

    def keep_design(self, description: Mapping[str, Any]) -> None:
        """Describe the robot as the run that continues does, with which maybe an earlier version began."""
        self._kept = {DESIGN: description[DESIGN]} if DESIGN in description else {}

    def _design(self) -> dict[str, str]:
        """The description of the problem of a robot; nothing if it is none, or not told by data."""
        problem = self._problem
        if not isinstance(problem, RobotDesigning):
            return {}
        try:
            if isinstance(problem, RobotProblem):  # measures of the file's own are of this file
                robot = of_file(problem.robot, RobotFile(self.file, sha256(self.source)))
                problem = dataclasses.replace(problem, robot=robot)
            described = problem.describe()
            problem_of_description(described)
        except (ValueError, NotImplementedError):
            return {}
        return {DESIGN: json.dumps(described, separators=(",", ":"))}


class RecordedProblem(PlainProblem):
    """A problem from a file as its run folder records it: enough to read the run, but not to evaluate points."""

    def __init__(self, description: Mapping[str, Any]) -> None:
        """Read what :meth:`FileProblem.describe` described.

        Raises:
            ValueError: if the description is damaged.
        """
        check_kind(description, FILE)
        try:
            self.file, self.checksum = str(description["file"]), str(description["sha256"])
            self._design = design_in(description)
            space = Space(tuple(Variable(**variable) for variable in description["variables"]))
            names, units = description["objective_names"], description["objective_units"]
            super().__init__(space, [Objective(str(name), str(unit)) for name, unit in zip(names, units, strict=True)])
        except (KeyError, TypeError) as error:
            raise ValueError(f"problem: its description is damaged ({error})") from None

    @cached_property
    def designed(self) -> RobotDesigning | None:
        """The problem of a robot, for what can be seen of its designs; None if the run does not tell of one."""
        return None if self._design is None else cast(RobotDesigning, problem_of_description(self._design))

    @property
    def subject(self) -> str:
        """Name of the file that defines the problem."""
        return f"problem of {self.file}"

    def facts(self) -> list[tuple[str, str]]:
        """The file and the objectives, for a report."""
        objectives = ", ".join(objective.label for objective in objectives_of(self))
        return [
            ("Problem", f"{self.file}, SHA-256 {self.checksum[:12]}"),
            ("Objectives" if len(self.objective_names) > 1 else "Objective", f"{objectives}, maximised"),
            ("Free", counted(self.space.size, "variable")),
        ]

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Refuse: only the file can evaluate."""
        raise ValueError(f"problem: only its file {self.file} can evaluate; give it with --problem")

    def save(self, point: ArrayLike, path: Path) -> None:
        """Refuse: only the file knows how designs are saved."""
        raise NotImplementedError


def load_problem(path: Path) -> FileProblem:
    """Load a problem by running its Python file.

    Raises:
        ValueError: if it cannot be read, fails, or defines no problem.
    """
    try:
        source = content_of(path)
    except OSError as error:
        raise ValueError(f"problem: {path} cannot be read ({why_unread(error)})") from None
    return FileProblem(path.name, source, str(path.absolute().parent))


def check_file(problem: FileProblem, known: Mapping[str, Any], folder: Path) -> None:
    """Raise a one-line ValueError unless a problem is of the file with which the run in a folder began.

    Its robot is described as the run does from then on.
    """
    found, recorded = sha256(problem.source), RecordedProblem(known).checksum
    if found != recorded:
        raise ValueError(
            f"problem: {problem.file} is not the file of the run in {folder} (SHA-256 {found[:12]}..., the run has "
            f"{recorded[:12]}...); give it as it was, or start a new run"
        )
    problem.keep_design(known)


def _run(file: str, source: bytes, folder: str, kept: dict[str, ModuleType]) -> tuple[SimpleNamespace, str]:
    """The names that a source defines, with the folder on the path of modules; and the path under which it ran."""
    with tempfile.TemporaryDirectory() as aside:
        copy = Path(aside) / file  # what is run is what was read, whatever becomes of the file
        copy.write_bytes(source)
        with users_code(f"problem: {file}"), modules_beside(folder, kept):
            return SimpleNamespace(**runpy.run_path(str(copy), run_name="morpholab_problem")), str(copy)


def _defined(names: SimpleNamespace, file: str) -> Problem:
    """The problem that a file sets, or that of its function."""
    problem: Problem | None = getattr(names, "problem", None)
    try:
        if problem is not None:
            missing = [name for name in ("space", "evaluate") if not hasattr(problem, name)]
            if missing:
                raise ValueError(f"problem: {' and '.join(missing)} missing; derive it from optim.Problem")
            return problem
        if not (hasattr(names, "bounds") and hasattr(names, "evaluate")):
            raise ValueError("it sets neither problem nor bounds and a function evaluate")
        given = {name: getattr(names, name) for name in GIVEN if hasattr(names, name)}
        return problem_of(names.evaluate, names.bounds, **given)
    except (ValueError, TypeError, AttributeError) as error:
        raise ValueError(f"problem: {file}: {error}") from None
