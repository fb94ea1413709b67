"""Files made from the best design of a run, made again if the design or a file has changed."""

import json
from collections.abc import Callable
from pathlib import Path

from optim.runs.folder import RunFolder
from taichi_sim.base import files

PRODUCTS = "products.json"  # checksums of design and file, by the file's name


def make_product(run: RunFolder, name: str, write: Callable[[Path], object]) -> None:
    """Write the file ``name`` by calling ``write``, unless it exists undamaged and is made from the best design.

    Raises:
        RuntimeError: if it cannot be written.
    """
    path, design = run.path / name, files.sha256((run.path / "best.json").read_bytes())
    try:
        known = json.loads((run.path / PRODUCTS).read_text(encoding="utf-8"))
    except (OSError, ValueError):  # lost or damaged: all files are made again
        known = None
    known = known if isinstance(known, dict) else {}
    if path.is_file() and known.get(name) == [design, files.sha256(path.read_bytes())]:
        return
    with run.writing():
        with files.replacing(path) as aside:
            write(aside)
        known[name] = [design, files.sha256(path.read_bytes())]
    run.update_text(PRODUCTS, json.dumps(known, indent=1, sort_keys=True) + "\n")
