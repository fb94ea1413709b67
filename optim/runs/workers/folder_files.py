"""Files through which a search and its workers communicate in a shared folder.

=================== ================================================================================
``search.json``     description of the search; its modification time is the search's sign of life
``open/``           parts of a generation that wait for a worker, one file each
``claimed/``        parts that a worker has taken, by renaming; the modification time is its sign of life
``done/``           answers, one file per part
``stop``            exists once the search has ended, so that workers end, too
=================== ================================================================================

Files are written under a temporary name and renamed. A part is named by the checksum of its request, so its answer
also serves a later search that makes the same request. All files have checksums and none is a pickle, so reading
them runs no code.
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
EXPECTED = 16  # workers, by default
BEATS = 10  # signs of life within the time after which a worker counts as silent
_ENDING, _OF_WORKER = ".npz", "@"
_LONGEST_NAP, _SHORTEST_NAP, _SHARE = 1.0, 0.01, 0.02  # s, s, fraction of the time waited so far
_DETAIL = "detail-"  # followed by a number, as archives do not accept every name
_ERRORS = {kind.__name__: kind for kind in (ValueError, OSError, MemoryError, KeyboardInterrupt)}


@dataclass(frozen=True)
class Offer:
    """Description of a search for its workers, the content of ``search.json``.

    Attributes:
        problem: description of the problem, as in run folders.
        versions: versions, on the machine of the search, of packages on which results depend.
        processor: model of its CPU.
        silence: time without a sign of life after which a worker loses its part [s].
        ground_files: checksums of the files of heights that the problem needs, by name.
    """

    problem: dict[str, Any]
    versions: dict[str, str | None]
    processor: str
    silence: float
    ground_files: dict[str, str] = field(default_factory=dict)

    @classmethod
    def here(cls, problem: dict[str, Any], silence: float, ground_files: Mapping[str, str] | None = None) -> "Offer":
        """Make the offer of a search on this machine."""
        needed = versions(packages_of(problem))
        return cls(json.loads(json.dumps(problem)), needed, cpu_model(), silence, dict(ground_files or {}))

    @property
    def digest(self) -> str:
        """Checksum of everything on which answers depend."""
        files = {"ground_files": self.ground_files} if self.ground_files else {}
        return _digest_of({"problem": self.problem, "versions": self.versions, **files})

    def write(self, folder: Path) -> None:
        """Write the offer to a folder of workers."""
        record = {**vars(self)}
        files.write_record(folder / SEARCH, FORM, {**record, "sha256": _digest_of(record)})

    @classmethod
    def read(cls, folder: Path) -> "Offer":
        """Read the offer in a folder of workers.

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
    """Answer of a worker whose process died while it evaluated the part; the text says how."""

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
    """Path of the file of a part in the folder of a state, such as open or done."""
    return folder / state / f"{part}{_ENDING}"


def parts_in(folder: Path, state: str) -> list[str]:
    """Names of the parts in a state: open, claimed (with their workers) or done; unfinished files are left out."""
    names = os.listdir(folder / state)
    return [name.removesuffix(_ENDING) for name in names if name.endswith(_ENDING) and not name.startswith(files.ASIDE)]


def part_of_claim(claim: str) -> tuple[str, str]:
    """Split the name of a claim into part and worker."""
    part, _, worker = claim.partition(_OF_WORKER)
    return part, worker


def claim_part(folder: Path, part: str, worker: str) -> Path | None:
    """Claim a part by renaming its file, which only one worker can do; None if another one was first."""
    claim = part_path(folder, CLAIMED, f"{part}{_OF_WORKER}{worker}")
    try:
        os.rename(part_path(folder, OPEN, part), claim)
    except FileNotFoundError:
        return None
    touch(claim)
    return claim


def touch(path: Path) -> None:
    """Give a sign of life: set a file's modification time by the clock of the disk, if the file still exists."""
    with contextlib.suppress(FileNotFoundError):
        os.utime(path)


def claim_any(folder: Path, worker: str) -> tuple[str, Path] | None:
    """Claim any open part; return its name and the claim, or None if no part is open.

    Workers try parts in different orders, so that they seldom compete.
    """
    for part in sorted(parts_in(folder, OPEN), key=lambda name: files.sha256(f"{worker} {name}".encode())):
        if claim := claim_part(folder, part, worker):
            return part, claim
    return None


def give_back(folder: Path, claim: Path) -> bool:
    """Make a claimed part open again; return whether it was still claimed."""
    part, _ = part_of_claim(claim.name.removesuffix(_ENDING))
    with contextlib.suppress(FileNotFoundError):
        os.rename(claim, part_path(folder, OPEN, part))
        return True
    return False


def end_workers(folder: Path) -> None:
    """Tell the workers of a folder that the search has ended."""
    files.write_text(folder / STOP, "the search has ended\n")


def nap(waited: float) -> None:
    """Sleep for a fiftieth of the time waited so far [s], between 0.01 s and 1 s, so that long waits cost little."""
    time.sleep(min(_LONGEST_NAP, max(_SHORTEST_NAP, _SHARE * waited)))


def packed_request(request: Request, search: str) -> tuple[str, bytes]:
    """Name of a part and content of its file, for a search with the given digest."""
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
    """Read the digest of the search and the request from the file of a part.

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
    """Content of the file of an answer."""
    about: dict[str, Any] = {"part": part, "worker": worker, "kind": type(told).__name__}
    arrays: dict[str, Any] = {}
    if isinstance(told, Evaluation):
        arrays = {"objectives": told.objectives, "status": np.asarray(told.status, str)}
        about["details"] = list(told.details)
        for number, values in enumerate(told.details.values()):
            arrays[f"{_DETAIL}{number}"] = np.asarray(values)
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
    """Read the worker and its answer about the ``count`` points of a part.

    Raises:
        ValueError: if the file is damaged or answers something else.
    """
    try:
        found = files.unpack(content)
        about = parse_json(str(found["about"]))
        # The suffix distinguishes equal parts of a generation.
        if about["part"].partition("-")[0] != part.partition("-")[0]:
            raise ValueError("it is the answer to another part")
        return str(about["worker"]), _answer(about, found, count)
    except files.UNREADABLE as error:
        raise ValueError(files.why_unread(error)) from None


def _answer(about: dict[str, Any], found: dict[str, Any], count: int) -> Told:
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
    """Make the exception that reports the death of a worker's process to the pool."""
    return Died(f"{gone.how}, on {worker}")


def _digest_of(record: dict[str, Any]) -> str:
    return files.sha256(json.dumps(record, sort_keys=True).encode())
