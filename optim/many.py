"""Simulate many robots of unlike bodies, such as a folder of files, here or spread over processes."""

import hashlib
import html
import json
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from optim.interrupts import CTRL_C, EndedBySignals
from optim.named import of_run, robot, run_in, world
from optim.notebook_tables import MOST_ROWS, data_frame, html_table
from optim.problem import OK, Evaluate, Request, evaluate_request
from optim.problems.many_robots import STEPS, ManyRobots
from optim.progress import Update, shown_progress
from robots.robot import KINDS, Measure, Robot, World, kind_of_file
from taichi_sim.base.arrays import Arrays, Floats, Ints, copied
from taichi_sim.base.checks import nearest, shown, whole_number
from taichi_sim.base.compute import Compute, ComputeOptions, available_threads
from taichi_sim.base.files import read_text, write_text
from taichi_sim.base.parsing import json_text, parse_json
from taichi_sim.base.results_folder import ResultsFolder
from taichi_sim.base.short_text import counted

PART = 16  # robots whose results are kept together; a kill loses at most one part of each process
SKIPPED = ".py", ".csv"  # of a folder: files of Python are code, which is run only if it is named
TEMPLATE = "base.vxa"  # beside .vxd files, each of which replaces parts of it
KILLED = "killed.json"  # robots that killed their workers


@dataclass(frozen=True, eq=False, repr=False)
class RobotTrials:
    """Results of simulating N robots, as :func:`simulate_all` returns them.

    ``trials["speed"]`` gives the values of a measure, shape (N,), NaN for robots that failed or do not have it; an
    unknown name raises a KeyError. Notebooks show a table of the best ones.

    Attributes:
        sources: what the robots were called or made from.
        robots: the robots, with nothing free.
        worlds: the world of each.
        status: ``"ok"``, or why the robot failed, shape (N,).
        steps: time steps simulated, shape (N,).
        measures: all measures that any of them has.
        values: of each measure by name, shape (N,).
    """

    sources: tuple[str, ...]
    robots: tuple[Robot, ...]
    worlds: tuple[World, ...]
    status: NDArray[np.str_]
    steps: Ints
    measures: tuple[Measure, ...]
    values: Mapping[str, Floats]

    def __len__(self) -> int:
        return len(self.robots)

    def __getitem__(self, name: str) -> Floats:
        """Values of a measure, shape (N,)."""
        if name not in self.values:
            raise KeyError(
                f"measure: {name!r} is unknown; there are {', '.join(self.values)}{nearest(name, list(self.values))}"
            )
        return self.values[name].copy()

    __iter__ = None  # they have a length and names, and are neither a list nor a mapping

    def __contains__(self, name: object) -> bool:
        """Whether some robot has a measure of this name."""
        return name in self.values

    @property
    def failed(self) -> int:
        """Number of robots that failed."""
        return int(np.count_nonzero(self.status != OK))

    def ranking(self, measure: str | None = None) -> list[int]:
        """Return the numbers of the robots by a measure, the highest first, those that have none left out.

        Args:
            measure: its name; by default the first one of the first robot.

        Raises:
            KeyError: for an unknown measure.
        """
        values = self[self.measures[0].name if measure is None else measure]
        order = np.argsort(-values, kind="stable")
        return [number for number in order.tolist() if not np.isnan(values[number])]

    def best(self, measure: str | None = None) -> int:
        """Return the number of the robot with the highest value of a measure, see :meth:`ranking`.

        Raises:
            KeyError: for an unknown measure.
            ValueError: if no robot succeeded.
        """
        if not (order := self.ranking(measure)):
            raise ValueError(f"robots: none of {len(self)} succeeded; the first: {self.status[0]}")
        return order[0]

    def columns(self) -> dict[str, Any]:
        """Return the columns of the table of robots by name, shape (N,) each: source, kind, world, status, measures."""
        return {
            "source": np.array(self.sources),
            "kind": np.array([each.kind for each in self.robots]),
            "world": np.array([place.name for place in self.worlds]),
            "status": self.status,
            STEPS: self.steps,
            **self.values,
        }

    def to_dataframe(self) -> Any:
        """Return a pandas DataFrame with a row for each robot; ``attrs["units"]`` tells units by column.

        Raises:
            ValueError: if pandas is not installed.
        """
        return data_frame(self.columns(), self._units)

    @property
    def _units(self) -> dict[str, str]:
        return {measure.name: measure.unit for measure in self.measures}

    def __repr__(self) -> str:
        told = [f"{counted(len(self), 'robot')}, {self.failed} failed" if self.failed else counted(len(self), "robot")]
        if order := self.ranking():
            first = self.measures[0]
            told.append(f"best {self.sources[order[0]]}: {first.value(self[first.name][order[0]])}")
        return "; ".join(told)

    def _repr_html_(self) -> str:
        shown = (self.ranking() or range(len(self)))[:MOST_ROWS]
        more = f"<p>and {len(self) - len(shown)} more</p>" if len(self) > len(shown) else ""
        return f"<p>{html.escape(repr(self))}</p>{html_table(self.columns(), self._units, shown)}{more}"


def simulate_all(
    sources: "Iterable[str | PathLike[str] | Robot] | str | PathLike[str]",
    where: "str | World | None" = None,
    *,
    workers: int | None = None,
    folder: str | PathLike[str] | None = None,
    **how: Unpack[ComputeOptions],
) -> RobotTrials:
    """Simulate many robots, which may differ in all, each as it starts in a search or was designed.

    Args:
        sources: a list of robots, or of names, files and run folders that :func:`robot` makes one from; or a folder of
            files, of which :func:`files_of` tells which are taken.
        where: the world of all of them, or its name; by default each one's usual one, or the first one of its run.
        workers: processes that share the robots; None is this one. A script that uses them needs
            ``if __name__ == "__main__":``, as those of Python's multiprocessing do.
        folder: where results are kept part by part, so that the same call goes on after an interruption; None is
            nowhere.
        how: ``precision``, ``threads`` (of each process) and ``device``, see :class:`Compute`.

    Raises:
        ValueError: for no robots, and for what is not allowed; a robot that fails is not an error but has a status.
    """
    if isinstance(sources, Robot) or not isinstance(sources, Iterable | PathLike):
        raise ValueError(f"sources: {shown(sources)} is not allowed; give a list of robots, or a folder")
    if isinstance(sources, str | PathLike):
        given: list[Any] = [fspath(sources)] if run_in(sources) else list(files_of(Path(fspath(sources))))
    else:
        given = list(sources)
    names = [each.name if isinstance(each, Robot) else fspath(each) for each in given]
    robots, worlds = list[Robot](), list[World]()
    for each in given:
        run = run_in(each)
        found, place = (robot(each), None) if run is None else of_run(run, elsewhere=where is not None)
        robots.append(found.design(found.start) if found.parameters else found)
        worlds.append(world(robots[-1], where) if place is None or where is not None else place)
    many = ManyRobots(names, robots, worlds, Compute(**how))
    with EndedBySignals(CTRL_C), shown_progress(counted(len(robots), "robot"), 1.0) as update:
        return try_all(many, workers, None if folder is None else Path(fspath(folder)), update)


def try_all(many: ManyRobots, workers: int | None, folder: Path | None, update: Update) -> RobotTrials:
    """Simulate many robots, part by part.

    Args:
        many: the robots.
        workers: processes that share them; None is this one.
        folder: where parts are kept; None is nowhere.
        update: told the fraction that is done.

    Raises:
        ValueError: for no robots, or a folder that holds something else.
    """
    if not many.robots:
        raise ValueError("sources: no robot is given; name one at least")
    count = 1 if workers is None else whole_number("workers", workers, 1)
    kept = None if folder is None else ResultsFolder(folder, "robots", _settings(many))
    done = _Done(many)
    for part in kept.load("part", done.check) if kept is not None else ():
        done.take(part)
    missing, size = done.missing, PART * count
    with _evaluating(many, workers, folder) if len(missing) else nullcontext(None) as evaluate:
        for first in range(0, len(missing), size):
            update(1 - (len(missing) - first) / len(many.robots))
            numbers = missing[first : first + size]
            request = Request(numbers[:, None].astype(float))
            found = evaluate_request(many, request) if evaluate is None else evaluate(request)
            arrays = {"numbers": numbers, "status": np.asarray(found.status), **found.details}
            done.take(arrays)
            if kept is not None:
                kept.add("part", numbers.tobytes(), **arrays)
    update(1.0)
    shared = tuple(many.sources), tuple(many.robots), tuple(many.worlds)
    return RobotTrials(*shared, done.status.astype(str), done.steps, many.measures, done.values)


def files_of(folder: Path) -> list[str]:
    """List the files of robots in a folder by name, without those in folders in it.

    Files of Python are left out, as they are code, and so are tables, and the ``base.vxa`` of ``.vxd`` files.

    Raises:
        ValueError: if it is no folder, or has no such files.
    """
    if not folder.is_dir():
        raise ValueError(f"sources: {folder} is no folder; give one, or a list of robots")
    files = sorted(path for path in folder.iterdir() if path.is_file() and path.suffix.lower() not in SKIPPED)
    if any(path.suffix.lower() == ".vxd" for path in files):
        files = [path for path in files if path.name != TEMPLATE]
    found = [path for path in files if _is_of_a_robot(path)]
    if not found:
        raise ValueError(f"sources: {folder} has no files of robots, such as .vxa, .vxd, .xml, .urdf or .json")
    return [str(path) for path in found]


def _is_of_a_robot(path: Path) -> bool:
    """Whether a file is one of a robot, or could be one that is damaged."""
    try:
        kind_of_file(path)
    except ValueError:
        return path.suffix.lower() == ".json" and not _is_json(path)
    return True


def _is_json(path: Path) -> bool:
    try:
        parse_json(read_text(path))
    except ValueError:
        return False
    return True


class _Done:
    """What is known of each of many robots so far."""

    def __init__(self, many: ManyRobots) -> None:
        count = len(many.robots)
        self.status, self.steps = np.full(count, "", object), np.zeros(count, np.int64)
        self.values = {measure.name: np.full(count, np.nan) for measure in many.measures}

    @property
    def missing(self) -> Ints:
        """Numbers of the robots that are not known."""
        return np.flatnonzero(self.status == "")

    def check(self, part: Arrays) -> None:
        """Refuse a part that is none of these robots'."""
        numbers = part["numbers"]
        for name in ("numbers", "status", STEPS, *self.values):
            if part[name].shape != numbers.shape or numbers.ndim != 1:
                raise ValueError(f"{name}: shape {part[name].shape} is not allowed; give {numbers.shape}")
        if numbers.dtype.kind != "i" or not ((numbers >= 0) & (numbers < len(self.status))).all():
            raise ValueError("numbers: give whole ones, of the robots")

    def take(self, part: Arrays) -> None:
        """Note what a part tells."""
        numbers = part["numbers"]
        self.status[numbers], self.steps[numbers] = part["status"].astype(object), part[STEPS]
        for name, values in self.values.items():
            values[numbers] = copied(part[name], name)


@contextmanager
def _evaluating(many: ManyRobots, workers: int | None, folder: Path | None) -> Iterator[Evaluate | None]:
    """What simulates a part; None for this process itself."""
    if workers is None:
        yield None
        return
    from optim.notes import note
    from optim.runs.workers import open_workers

    threads = many.compute.threads or max(1, available_threads() // workers)

    def save_failed(points: Floats, reason: str) -> Path:
        path = (Path(tempfile.mkdtemp(prefix="morpholab-")) if folder is None else folder) / KILLED
        killers = [many.sources[number] for number in points[:, 0].astype(int)]
        write_text(path, json.dumps({"reason": reason, "robots": killers}, indent=1) + "\n")
        return path

    told = replace(many, compute=replace(many.compute, threads=threads))
    with open_workers(told, count=workers, threads=threads, part=PART, save_failed=save_failed, note=note) as evaluate:
        yield evaluate


def _settings(many: ManyRobots) -> dict[str, Any]:
    """Everything on which results depend: a digest of each robot, and how it is simulated."""
    described = [
        {"name": Path(source).name, "world": place.name, "digest": _digest(each, place)}
        for source, each, place in zip(many.sources, many.robots, many.worlds, strict=True)
    ]
    return {"precision": many.compute.precision, "device": many.compute.device, "robots": described}


def _digest(tried: Robot, place: World) -> str:
    """What tells whether a robot and its world are as before."""
    kind = KINDS.of(tried)
    text = json_text([kind.name, tried.describe(), kind.world_record(place)])
    return hashlib.sha256(text.encode()).hexdigest()[:16]
