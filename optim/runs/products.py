"""Files made from the best design of a run, made again if the design or a file has changed."""

import json
from collections.abc import Callable
from pathlib import Path

from optim.runs.folder import RunFolder
from taichi_sim.base import files

PRODUCTS = "products.json"


class Products:
    """Files that are made from the best design; ``products.json`` has the checksums of source and files."""

    def __init__(self, run: RunFolder, source: str = "best.json") -> None:
        """Read the checksums of the files made from ``source``."""
        self._run, self._folder, self._source = run, run.path, run.path / source
        try:
            known = json.loads((self._folder / PRODUCTS).read_text(encoding="utf-8"))
            self._known = known if isinstance(known, dict) else {}
        except (OSError, ValueError):  # lost or damaged: all files are made again
            self._known = {}

    def make(self, name: str, write: Callable[[Path], object]) -> None:
        """Write the file ``name`` by calling ``write``, unless it exists undamaged and is made from the current source.

        Raises:
            RuntimeError: if it cannot be written.
        """
        with self._run.writing():
            self._make(name, write)

    def _make(self, name: str, write: Callable[[Path], object]) -> None:
        path, source = self._folder / name, files.sha256(self._source.read_bytes())
        if path.is_file() and self._known.get(name) == [source, files.sha256(path.read_bytes())]:
            return
        with files.replacing(path) as aside:
            write(aside)
        self._known[name] = [source, files.sha256(path.read_bytes())]
        text = json.dumps(self._known, indent=1, sort_keys=True) + "\n"
        with files.replacing(self._folder / PRODUCTS) as aside:
            aside.write_text(text)
