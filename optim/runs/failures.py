"""Files of designs that killed the processes that evaluated them, kept for a closer look."""

import json
import re
from pathlib import Path

from optim.runs.folder import RunFolder
from optim.space import Space
from taichi_sim.base.arrays import Floats


def save_failed(folder: RunFolder, space: Space, points: Floats, reason: str) -> Path:
    """Write failed points, shape (N, D), to a new file ``failed-1.json`` and so on, and return its path.

    Its number is above those of all existing files, even if some were deleted.
    """
    designs = [dict(zip(space.names, point, strict=True)) for point in points.tolist()]
    document = {"reason": reason, "generation": folder.lines, "designs": designs}
    taken = (re.fullmatch(r"failed-(\d+)\.json", path.name) for path in folder.path.iterdir())
    number = 1 + max((int(match[1]) for match in taken if match), default=0)
    path = folder.path / f"failed-{number}.json"
    folder.update_text(path.name, json.dumps(document, indent=1) + "\n")
    return path
