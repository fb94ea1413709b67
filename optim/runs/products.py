"""Further files of a run folder: products of its best design, such as pictures, and designs that failed."""

import json
import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from optim.runs.folder import RunFolder
from optim.space import Space
from taichi_sim.base import files
from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import read_json
from taichi_sim.base.records import checked
from taichi_sim.base.results_folder import BEST_DESIGN

PRODUCTS = "products.json"  # checksums of design and file, by the file's name


@dataclass(frozen=True)
class _Products:
    """What ``products.json`` holds."""

    products: dict[str, list[str]]


def make_product(run: RunFolder, name: str, write: Callable[[Path], object]) -> None:
    """Write the file ``name`` by calling ``write``, unless it is undamaged and was made from the present best design.

    Raises:
        RuntimeError: if it cannot be written.
    """
    known, path = _known(run.path), run.path / name
    with run.writing():
        design = files.sha256((run.path / BEST_DESIGN).read_bytes())
        if path.is_file() and known.get(name) == [design, files.sha256(path.read_bytes())]:
            return
        with files.replacing(path) as aside:
            write(aside)
        known[name] = [design, files.sha256(path.read_bytes())]
    run.update_text(PRODUCTS, json.dumps(known, indent=1, sort_keys=True) + "\n")


def known_products(folder: Path) -> dict[str, list[str]]:
    """Checksums of design and file of each product of a run; none if there is no ``products.json``.

    Raises:
        ValueError: if it is damaged; names the file and the field.
    """
    path = folder / PRODUCTS
    return read_json(path, lambda found: checked(_Products, {"products": found}).products) if path.exists() else {}


def _known(folder: Path) -> dict[str, list[str]]:
    """Like :func:`known_products`, but a damaged file gives a warning and no products, which are then made again."""
    try:
        return known_products(folder)
    except ValueError as error:
        warnings.warn(f"{error}; files are made again", stacklevel=2)
        return {}


def save_failed(folder: RunFolder, space: Space, points: Floats, reason: str) -> Path:
    """Write points that killed their workers, shape (N, D), to a new file such as ``failed-1.json``; return its path.

    Its number is above those of all existing files, even if some were deleted.
    """
    designs = [dict(zip(space.names, point, strict=True)) for point in points.tolist()]
    document = {"reason": reason, "generation": folder.lines, "designs": designs}
    taken = (re.fullmatch(r"failed-(\d+)\.json", path.name) for path in folder.path.iterdir())
    number = 1 + max((int(match[1]) for match in taken if match), default=0)
    path = folder.path / f"failed-{number}.json"
    folder.update_text(path.name, json.dumps(document, indent=1) + "\n")
    return path
