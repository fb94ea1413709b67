"""Files through which a search and its workers speak in a shared folder: data alone, written aside and renamed.

=================== ================================================================================
``search.json``     what the search is about; its time of change is the search's sign of life
``open/``           parts of a generation that wait for a worker, one a file
``claimed/``        parts that a worker has taken, by renaming; the time of change is its sign of life
``done/``           answers, one a part
``stop``            there once the search has ended: workers end, too
=================== ================================================================================

A part is named by the checksum of what is asked, so an answer fits whoever asks the same again. Everything has a
checksum and nothing is a pickle: reading it runs no code.
"""

import contextlib
import json
import os
import time
from collections.abc import Mapping
from dataclasses import astuple, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from optim.problem import Evaluation, Minibatch, Request
from optim.runs.environment import cpu_model, versions
from optim.runs.plug_ins import packages_of
from optim.runs.workers.pool import Died
from optim.runs.workers.service import Raised
from taichi_sim.base import files
from taichi_sim.base.disk_faults import told_as
from taichi_sim.base.parsing import parse_json

SEARCH, STOP = "search.json", "stop"
OPEN, CLAIMED, DONE = "open", "claimed", "done"
FORM = "morpholab search for workers 1"
EXPECTED = 16  # workers, if nobody says how many
BEATS = 10  # signs of life in the time after which silence is noticed
_ENDING, _OF_WORKER = ".npz", "@"
_LONGEST_NAP, _SHORTEST_NAP, _SHARE = 1.0, 0.01, 0.02  # s, s, of the time waited so far
_DETAIL = "detail-"  # and its number: archives do not take every name
_ERRORS = {kind.__name__: kind for kind in (ValueError, OSError, MemoryError)}


@dataclass(frozen=True)
class Offer:
    """What a search tells its workers.

    Attributes:
        problem: its description, as run folders keep it.
        versions: of what results depend on, where the search runs.
        processor: model of the CPU there.
        silence: time without a sign of life after which a worker has lost its part [s].
        ground_files: checksums of the files of heights that the problem needs, by their names.
    """

    problem: dict[str, Any]
    versions: dict[str, str | None]
    processor: str
    silence: float
    ground_files: dict[str, str] = field(default_factory=dict)

    @classmethod
    def here(cls, problem: dict[str, Any], silence: float, ground_files: Mapping[str, str] | None = None) -> "Offer":
        """The offer of a search on this machine."""
        needed = versions(packages_of(problem))
        return cls(json.loads(json.dumps(problem)), needed, cpu_model(), silence, dict(ground_files or {}))

    @property
    def digest(self) -> str:
        """Checksum of all that answers depend on."""
        files = {"ground_files": self.ground_files} if self.ground_files else {}
        return _digest_of({"problem": self.problem, "versions": self.versions, **files})

    def write(self, folder: Path) -> None:
        """Write the offer to a folder of workers."""
        record = {**vars(self)}
        files.write_record(folder / SEARCH, FORM, {**record, "sha256": _digest_of(record)})

    @classmethod
    def read(cls, folder: Path) -> "Offer":
        """The offer in a folder of workers.

        Raises:
            ValueError: if it is unreadable, damaged, or of another version.
        """

        def build(record: dict[str, Any]) -> Offer:
            known = {name: value for name, value in record.items() if name not in ("format", "sha256")}
            if _digest_of(known) != record["sha256"]:
                raise ValueError("the checksum does not match")
            return cls(**known)

        return files.read_record(folder / SEARCH, FORM, build)


@dataclass(frozen=True)
class Gone:
    """Answer of a worker whose process died with the part; the text says how."""

    how: str


@dataclass(frozen=True)
class Unread:
    """Answer of a worker that could not read the part; the text says why."""

    why: str


Told = Evaluation | Raised | Gone | Unread


def make_folders(folder: Path) -> None:
    """Make a folder for workers.

    Raises:
        ValueError: if it cannot be made.
        RuntimeError: if the disk is full or broken.
    """
    with told_as(f"workers-dir: {folder} cannot be written", begun=False):
        for name in (OPEN, CLAIMED, DONE):
            (folder / name).mkdir(parents=True, exist_ok=True)


def part_path(folder: Path, state: str, part: str) -> Path:
    """Where the file of a part is that is open or done."""
    return folder / state / f"{part}{_ENDING}"


def parts_in(folder: Path, state: str) -> list[str]:
    """Names of the parts that are open, claimed (with their workers) or done; unfinished files are left out."""
    names = os.listdir(folder / state)
    return [name.removesuffix(_ENDING) for name in names if name.endswith(_ENDING) and not name.startswith(files.ASIDE)]


def part_of_claim(claim: str) -> tuple[str, str]:
    """The part and the worker in the name of a claim."""
    part, _, worker = claim.partition(_OF_WORKER)
    return part, worker


def claim_part(folder: Path, part: str, worker: str) -> Path | None:
    """Take a part by renaming its file, which succeeds for one worker alone; the claim, or None if it was too late."""
    claim = part_path(folder, CLAIMED, f"{part}{_OF_WORKER}{worker}")
    try:
        os.rename(part_path(folder, OPEN, part), claim)
    except FileNotFoundError:
        return None
    touch(claim)
    return claim


def touch(path: Path) -> None:
    """Give a sign of life: set a file's time of change by the clock of the disk, if it is still there."""
    with contextlib.suppress(FileNotFoundError):
        os.utime(path)


def claim_any(folder: Path, worker: str) -> tuple[str, Path] | None:
    """Take any open part; its name and the claim, or None if none is open. Workers begin at different ones."""
    for part in sorted(parts_in(folder, OPEN), key=lambda name: files.sha256(f"{worker} {name}".encode())):
        if claim := claim_part(folder, part, worker):
            return part, claim
    return None


def give_back(folder: Path, claim: Path) -> bool:
    """Let others have a claimed part; whether it was still claimed."""
    part, _ = part_of_claim(claim.name.removesuffix(_ENDING))
    with contextlib.suppress(FileNotFoundError):
        os.rename(claim, part_path(folder, OPEN, part))
        return True
    return False


def end_workers(folder: Path) -> None:
    """Tell the workers of a folder that the search has ended."""
    files.write_text(folder / STOP, "the search has ended\n")


def nap(waited: float) -> None:
    """Sleep for a fiftieth of the time waited so far [s], at most a second: quick answers soon, long waits cheaply."""
    time.sleep(min(_LONGEST_NAP, max(_SHORTEST_NAP, _SHARE * waited)))


def packed_request(request: Request, search: str) -> tuple[str, bytes]:
    """Name and file of a part of the search with this digest."""
    content = files.pack(
        {
            "search": np.array(search),
            "wants": np.array(request.wants),
            "sharpness": np.array(request.sharpness, float),
            "minibatch": np.array(astuple(request.minibatch) if request.minibatch else (), np.int64),
            "points": request.points,
        }
    )
    return files.sha256(content)[:32], content


def unpacked_request(content: bytes) -> tuple[str, Request]:
    """Digest of the search, and the request.

    Raises:
        ValueError: if the file is damaged.
    """
    try:
        found = files.unpack(content)
        wants: Any = str(found["wants"])
        minibatch = Minibatch(*found["minibatch"].tolist()) if found["minibatch"].size else None
        return str(found["search"]), Request(found["points"], wants, float(found["sharpness"]), minibatch)
    except files.UNREADABLE as error:
        raise ValueError(files.why_unread(error)) from None


def packed_answer(part: str, worker: str, told: Told) -> bytes:
    """File of an answer.

    Raises:
        ValueError: if the evaluation's details are no plain arrays.
    """
    about: dict[str, Any] = {"part": part, "worker": worker, "kind": type(told).__name__}
    arrays: dict[str, Any] = {}
    if isinstance(told, Evaluation):
        arrays = {"objectives": told.objectives, "status": np.asarray(told.status, str)}
        about["details"] = list(told.details)
        for number, (name, values) in enumerate(told.details.items()):
            detail = arrays[f"{_DETAIL}{number}"] = np.asarray(values)
            if detail.dtype.hasobject:
                raise ValueError(f"details: {name} is no plain array, so it cannot go through a folder of workers")
        if told.gradients is not None:
            arrays["gradients"] = told.gradients
    elif isinstance(told, Raised):
        kind = next((k for k, each in _ERRORS.items() if isinstance(told.error, each)), "RuntimeError")
        plain = kind in _ERRORS or type(told.error) is RuntimeError
        text = str(told.error) if plain else f"{type(told.error).__name__}: {told.error}"
        about |= {"error": kind, "text": text, "notes": list(getattr(told.error, "__notes__", []))}
    else:
        about["text"] = told.how if isinstance(told, Gone) else told.why
    return files.pack({"about": np.array(json.dumps(about)), **arrays})


def unpacked_answer(content: bytes, part: str, count: int) -> tuple[str, Told]:
    """Who answered, and what, about the ``count`` points of a part.

    Raises:
        ValueError: if the file is damaged or about something else.
    """
    try:
        found = files.unpack(content)
        about = parse_json(str(found["about"]))
        # The suffix tells equal parts of a generation from each other.
        if about["part"].partition("-")[0] != part.partition("-")[0]:
            raise ValueError("it is the answer to another part")
        return str(about["worker"]), _told(about, found, count)
    except files.UNREADABLE as error:
        raise ValueError(files.why_unread(error)) from None


def _told(about: dict[str, Any], found: dict[str, Any], count: int) -> Told:
    if about["kind"] == Raised.__name__:
        error = _ERRORS.get(about["error"], RuntimeError)(about["text"])
        for each in about["notes"]:
            error.add_note(str(each))
        return Raised(error)
    if about["kind"] == Gone.__name__:
        return Gone(str(about["text"]))
    if about["kind"] == Unread.__name__:
        return Unread(str(about["text"]))
    if about["kind"] != Evaluation.__name__:
        raise ValueError(f"it is a {about['kind']}")
    if len(found["objectives"]) != count:
        raise ValueError(f"it is about {len(found['objectives'])} points, not {count}")
    details = {str(name): found[f"{_DETAIL}{number}"] for number, name in enumerate(about["details"])}
    return Evaluation(found["objectives"], found["status"], details, found.get("gradients"))


def died(worker: str, gone: Gone) -> Died:
    """The death of a process of a worker, as the pool hears of it."""
    return Died(f"{gone.how}, on {worker}")


def _digest_of(record: dict[str, Any]) -> str:
    return files.sha256(json.dumps(record, sort_keys=True).encode())
