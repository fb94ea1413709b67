"""What arrays of a study's parts may hold, so that a damaged file is refused and its part computed again."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_sim.base.arrays import Arrays
from taichi_sim.base.checks import within

KINDS = {"f": "numbers", "b": "truth values", "i": "whole numbers", "u": "whole numbers"}


@dataclass(frozen=True)
class Allowed:
    """What one array of a part may be.

    Attributes:
        shape: of the array; a letter stands for any length, the same wherever it stands in a part.
        low: least of its numbers.
        high: greatest of its numbers.
        failed: stands for what failed or is not known, such as NaN; None if all is known.
        kind: of its type: ``"f"`` for floats, ``"b"`` for truth values, ``"i"`` and ``"u"`` for whole numbers.
    """

    shape: tuple[int | str, ...]
    low: float = -np.inf
    high: float = np.inf
    failed: float | None = None
    kind: str = "f"

    def check(self, name: str, found: NDArray[Any], lengths: dict[str, int] | None = None) -> None:
        """Refuse an array that this cannot be by a ValueError that names it, its value and what is allowed.

        ``lengths`` of letters are those of arrays before, and this one's are added.
        """
        if found.dtype.kind != self.kind:
            raise ValueError(f"{name}: type {found.dtype} is not allowed; give {KINDS[self.kind]}")
        lengths = {} if lengths is None else lengths
        if found.ndim == len(self.shape):
            for length, letter in zip(found.shape, self.shape, strict=True):
                if isinstance(letter, str):
                    lengths.setdefault(letter, length)
        shape = tuple(lengths.get(each, each) if isinstance(each, str) else each for each in self.shape)
        if found.shape != shape:
            raise ValueError(f"{name}: shape {found.shape} is not allowed; give {shape}")
        if self.kind == "b":
            return
        known = found if self.failed is None else found[~np.isclose(found, self.failed, 0, 0, equal_nan=True)]
        if not (finite := np.isfinite(known)).all():
            raise ValueError(f"{name}: {known[~finite][0]} is not allowed; give finite numbers")
        within(name, known, self.low, self.high)


def check_arrays(allowed: Mapping[str, Allowed], arrays: Arrays) -> None:
    """Refuse the arrays of a part that lack one of these, or have one that is not allowed, by a ValueError."""
    lengths: dict[str, int] = {}
    for name, each in allowed.items():
        if name not in arrays:
            raise ValueError(f"{name} is missing")
        each.check(name, arrays[name], lengths)
