"""The search's side of a shared folder: hands out parts to workers on any machine, and collects their answers."""

import contextlib
import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from optim.problem import FILE, Evaluation, Problem, Request
from optim.problems import problem_of_description
from optim.runs.config import GROUND_FILES, keep_ground_files
from optim.runs.folder_lock import locked
from optim.runs.workers import folder_files as protocol
from optim.runs.workers.folder_files import CLAIMED, DONE, OPEN, Gone, Offer, Unread
from optim.runs.workers.pool import Died
from optim.runs.workers.service import Answer, Raised
from robots.robot import lost_in
from taichi_sim.base import files
from taichi_sim.base.locks import HeldLock

LOSSES = 10  # silent workers of one part that count as one death: preempted nodes are more likely than deadly designs
DAMAGES = 3  # damaged files of one part, after which the search ends
LATE = 1.25  # multiple of the median time after which a part is also given to an idle worker
FEWEST = 3  # answers from which a median time is taken
LOOK_EVERY = 0.25  # s between checks of which parts are claimed
NOTE_AFTER = 30.0  # s within which some worker should have taken a part


@dataclass(eq=False)
class Seat:
    """Place for one part in the folder, which the pool treats as a worker; any worker may claim the part.

    Attributes:
        folder: the shared folder.
        part: name of the part; None while there is none.
        content: content of its file.
        count: number of its points.
        fresh: whether the place is new and still has to give the pool its first answer, None.
        answered: the worker that answered, and its answer; None until then.
        losses: number of workers that fell silent while they had the part.
        damages: number of damaged files of the part.
        copies: number of further workers to which the part was given.
    """

    folder: "SharedFolder"
    part: str | None = None
    content: bytes = b""
    count: int = 0
    fresh: bool = True
    answered: tuple[str, Evaluation | Raised | Gone] | None = None
    losses: int = 0
    damages: int = 0
    copies: int = 0

    def submit(self, request: Request) -> None:
        """Put a request into the folder."""
        self.losses, self.damages, self.copies = 0, 0, 0
        self.answered, self.count = None, len(request.points)
        self.folder.put(self, request)

    def answer(self) -> Answer:
        """Return the answer; raises ``Died`` if the worker's process died, or too many workers fell silent."""
        if self.fresh:
            self.fresh = False
            return None
        if self.answered is None:
            raise Died("its place in the folder is gone")
        worker, told = self.answered
        self.kill()
        if isinstance(told, Gone):
            raise protocol.died(worker, told)
        return told

    def kill(self) -> None:
        """Take the part out of the folder."""
        self.folder.withdraw(self)
        self.part, self.answered = None, None


@dataclass(eq=False)
class SharedFolder:
    """Hands out the parts of a search through a folder, and takes parts back from silent workers.

    Clocks of other machines do not matter: a worker is silent if the modification time of its claim stays the same.

    Attributes:
        path: the folder.
        offer: description of the search.
        note: called with a line about silent workers and damaged files.
        lock: lock of the folder; checked before anything is written there.
        inherited: parts that were already claimed when the folder was opened, for an earlier search.
    """

    path: Path
    offer: Offer
    note: Callable[[str], None]
    lock: HeldLock
    inherited: set[str] = field(default_factory=set)
    _pending: dict[str, Seat] = field(default_factory=dict)
    _signs: dict[str, tuple[int, float]] = field(default_factory=dict)  # of claims: modification time, when it was seen
    _missing: dict[str, float] = field(default_factory=dict)  # parts without any file: since when
    _begun: dict[str, float] = field(default_factory=dict)  # claimed parts: since when
    _untimed: set[str] = field(default_factory=set)  # parts whose duration is unknown, as an earlier search began them
    _times: deque[float] = field(default_factory=lambda: deque(maxlen=50))  # durations of the last parts [s]
    _looked: float = 0.0
    _helped: float = 0.0
    _since: float = field(default_factory=time.monotonic)
    _met: bool = False  # whether any worker has been seen

    @property
    def cores(self) -> int:
        """Number of workers to expect by default."""
        return protocol.EXPECTED

    def start(self) -> Seat:
        """Make a place for a part."""
        return Seat(self)

    def ready(self, workers: Sequence[Seat], wait: bool) -> list[Seat]:
        """List the places that have an answer; with ``wait``, wait for at least one.

        Raises:
            RuntimeError: if the folder was moved or replaced.
        """
        begun = time.monotonic()
        while True:
            self.lock.check()
            self._gather()
            found = [seat for seat in workers if seat.fresh or seat.answered is not None]
            if found or not wait:
                return found
            if time.monotonic() - self._helped > LOOK_EVERY:
                self._help()
            if time.monotonic() - self._looked > self.offer.silence / protocol.BEATS:
                self._look_after()
            protocol.nap(time.monotonic() - begun)

    def put(self, seat: Seat, request: Request) -> None:
        """Put a request into the folder, unless a worker answered or claimed the same part for an earlier search.

        Raises:
            RuntimeError: if the disk is full or broken, or the folder was moved or replaced.
        """
        self.lock.check()
        name, seat.content = protocol.packed_request(request, self.offer.digest)
        part, number = name, 1
        while part in self._pending:  # several parts of a request may be equal
            number += 1
            part = f"{name}-{number}"
        seat.part = part
        self._pending[part] = seat
        # Later claims do not count: the previous worker of a part that is repeated may still have to remove its claim.
        claimed = part in self.inherited
        self.inherited.discard(part)
        if claimed or protocol.part_path(self.path, DONE, part).exists():
            self._untimed.add(part)
        else:
            self._write(seat)

    def withdraw(self, seat: Seat) -> None:
        """Remove all files of the part that a place has."""
        if seat.part is None or self._pending.pop(seat.part, None) is None:
            return
        self._missing.pop(seat.part, None)
        self._begun.pop(seat.part, None)
        self._untimed.discard(seat.part)
        if not self.lock.found_at_path:  # the folder there now is not this search's
            return
        for state in (OPEN, DONE):
            protocol.part_path(self.path, state, seat.part).unlink(missing_ok=True)
        if seat.losses or seat.copies or seat.answered is None:  # otherwise its worker has removed the claim
            for claim in protocol.parts_in(self.path, CLAIMED):
                if protocol.part_of_claim(claim)[0] == seat.part:
                    protocol.part_path(self.path, CLAIMED, claim).unlink(missing_ok=True)

    def _write(self, seat: Seat) -> None:
        if seat.part is not None:
            files.write_bytes(protocol.part_path(self.path, OPEN, seat.part), seat.content)

    def _gather(self) -> None:
        """Read the answers that have arrived; a damaged one is removed and its part is handed out again."""
        for part in protocol.parts_in(self.path, DONE):
            seat, path = self._pending.get(part), protocol.part_path(self.path, DONE, part)
            if seat is None or seat.answered is not None:
                continue
            try:
                content = files.content_of(path, files.LARGEST_UNPACKED)
                worker, told = protocol.unpacked_answer(content, part, seat.count)
                if isinstance(told, Unread):
                    raise ValueError(f"{worker} could not read the part: {told.why}")
            except FileNotFoundError:
                continue
            except (OSError, ValueError) as error:
                self._mend(seat, path, files.why_unread(error))
                continue
            self._met = True
            seat.answered = worker, told
            if part not in self._untimed:
                self._times.append(time.monotonic() - self._begun[part] if part in self._begun else LOOK_EVERY)

    def _mend(self, seat: Seat, path: Path, why: str) -> None:
        """Hand out a part again whose answer is damaged.

        Raises:
            RuntimeError: if that has happened ``DAMAGES`` times.
        """
        seat.damages += 1
        if seat.damages == DAMAGES:
            raise RuntimeError(f"{path}: is damaged, {DAMAGES} times by now ({why}); the folder cannot be relied on")
        self.note(f"{path} is damaged ({why}): its part is judged again")
        path.unlink(missing_ok=True)
        self._write(seat)

    def _help(self) -> None:
        """Give a part that takes longer than others also to an idle worker; the first answer counts.

        Its own worker may be slow, or dead, which is certain only after long silence. Workers are idle if no part is
        open.
        """
        self._helped = now = time.monotonic()
        claimed = {protocol.part_of_claim(claim)[0] for claim in protocol.parts_in(self.path, CLAIMED)}
        self._begun = {part: self._begun.get(part, now) for part in claimed if part in self._pending}
        if len(self._times) < FEWEST or protocol.parts_in(self.path, OPEN):
            return
        late = LATE * float(np.median(self._times)) + LOOK_EVERY
        for part, since in self._begun.items():
            seat = self._pending[part]
            if seat.answered is None and now - since > late * 2**seat.copies:
                seat.copies += 1
                self._write(seat)

    def _look_after(self) -> None:
        """Give a sign of life, take parts back from silent workers, and hand out again parts that have vanished."""
        self._looked = now = time.monotonic()
        protocol.touch(self.path / protocol.SEARCH)
        claims = {claim: protocol.part_of_claim(claim) for claim in protocol.parts_in(self.path, CLAIMED)}
        self._signs = {claim: sign for claim, sign in self._signs.items() if claim in claims}
        for claim, (part, worker) in claims.items():
            self._met = True
            seat = self._pending.get(part)
            if seat is not None and seat.answered is None:
                self._listen(claim, worker, seat, now)
        known = {part for part, _ in claims.values()}
        known |= {*protocol.parts_in(self.path, OPEN), *protocol.parts_in(self.path, DONE)}
        for part, seat in self._pending.items():
            if part in known or seat.answered is not None:
                self._missing.pop(part, None)
            elif now - self._missing.setdefault(part, now) > self.offer.silence:
                self._missing.pop(part)
                self.note(f"part {part} has vanished from {self.path}: it is put there again")
                self._write(seat)
        if not self._met and now - self._since > NOTE_AFTER:
            self._met = True
            self.note(f"no worker has come yet; start some, on any machine, by: morpholab work {self.path}")

    def _listen(self, claim: str, worker: str, seat: Seat, now: float) -> None:
        """Record a sign of life of a claim; if it has been silent for long, make its part open again."""
        path = protocol.part_path(self.path, CLAIMED, claim)
        try:
            changed = path.stat().st_mtime_ns
        except FileNotFoundError:
            return
        last, seen = self._signs.get(claim, (None, now))
        if changed != last:
            self._signs[claim] = changed, now
        elif now - seen > self.offer.silence:
            del self._signs[claim]
            if protocol.give_back(self.path, path):
                seat.losses += 1
                self.note(f"{worker} has been silent for {self.offer.silence:g} s: its part is given to others")
            if seat.losses == LOSSES:
                seat.answered = worker, Gone(f"its workers fell silent {LOSSES} times")


@contextlib.contextmanager
def open_shared_folder(
    path: Path, problem: Problem, silence: float, note: Callable[[str], None]
) -> Iterator[SharedFolder]:
    """Open a folder for the workers of a search, and keep other searches off it.

    Raises:
        ValueError: if the folder cannot be written, another search uses it, or data alone do not describe the problem.
    """
    description = problem.describe()
    if description.get("kind") != FILE and not _is_told_by(description):
        raise ValueError(
            f"workers-dir: a problem of kind {description.get('kind')!r} is not told by data alone, which is all that "
            "goes through a folder; give it as a file, with --problem"
        )
    protocol.make_folders(path)
    with locked(path, "workers-dir") as lock:
        for state in (OPEN, DONE):  # parts of an earlier search would keep workers busy
            for name in os.listdir(path / state):
                if state == OPEN or name.startswith(files.ASIDE):
                    (path / state / name).unlink(missing_ok=True)
        (path / protocol.STOP).unlink(missing_ok=True)
        keep_ground_files(problem, path)
        offer = Offer.here(description, silence, getattr(problem, GROUND_FILES, {}))
        offer.write(path)
        claimed = {protocol.part_of_claim(claim)[0] for claim in protocol.parts_in(path, CLAIMED)}
        yield SharedFolder(path, offer, note, lock, claimed)
        for state in (CLAIMED, DONE):  # duplicate or late answers, and claims of dead workers
            for part in protocol.parts_in(path, state) if lock.found_at_path else ():
                protocol.part_path(path, state, part).unlink(missing_ok=True)


def _is_told_by(description: dict[str, object]) -> bool:
    """Whether a problem built from a description has that same description again."""
    try:
        built = problem_of_description(description)
        return built.describe() == description and not lost_in(getattr(built, "offered", None))
    except ValueError:
        return False
