"""What parts of a study cost, over all the processes that worked on it: wall time and CPU time."""

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from taichi_sim.base.files import append_line, complete_lines, keep_lines


class Costs:
    """A file of costs, a line for each piece of work that was completed; a kill loses at most the last."""

    def __init__(self, path: Path) -> None:
        """Go on with the file, if there is one."""
        self._path = path
        keep_lines(path, len(complete_lines(path)))  # a torn last line

    @contextmanager
    def of(self, part: str) -> Iterator[None]:
        """Measure a piece of work on a part, and note it when it is complete."""
        wall, cpu = time.perf_counter(), time.process_time()
        yield
        spent = {"wall": round(time.perf_counter() - wall, 3), "cpu": round(time.process_time() - cpu, 3)}
        append_line(self._path, json.dumps({"part": part, **spent}))

    def total(self) -> dict[str, dict[str, float]]:
        """Seconds of wall time and of CPU time (of all threads), by part, and of ``"all"``."""
        found: dict[str, dict[str, float]] = {}
        for line in complete_lines(self._path):
            entry = json.loads(line)
            for part in (entry["part"], "all"):
                sums = found.setdefault(part, {"wall": 0.0, "cpu": 0.0})
                for clock in sums:
                    sums[clock] = round(sums[clock] + entry[clock], 3)
        return found
