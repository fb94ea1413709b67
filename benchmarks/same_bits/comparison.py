"""Compares what two trees computed, bit for bit, and says how far they are apart."""

import fnmatch
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

Arrays = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Difference:
    """How far one array is from the one that it shall be.

    Attributes:
        array: its name.
        relative: largest difference, part of the largest magnitude in the array; infinite where numbers cannot tell.
        absolute: largest difference, in the array's unit.
        what: the difference in words, where it is not one of numbers.
    """

    array: str
    relative: float
    absolute: float
    what: str = ""

    def __str__(self) -> str:
        return f"{self.array}: {self.what or f'relative {self.relative:.2e}, absolute {self.absolute:.2e}'}"


@dataclass(frozen=True)
class Accepted:
    """A deviation that somebody looked at.

    Attributes:
        bound: largest relative difference, see ``Difference``.
        why: what moved the bits.
        absolute: difference that is allowed whatever it is relatively, for arrays that should be zero, in their unit.
    """

    bound: float
    why: str
    absolute: float = 0.0

    def holds(self, difference: Difference) -> bool:
        """Whether an array is no further off than that."""
        return difference.relative <= self.bound or difference.absolute <= self.absolute


@dataclass(frozen=True)
class Verdict:
    """What a comparison of one case came to.

    Attributes:
        case: its name.
        ok: whether it may stay so.
        text: for people, in one line.
    """

    case: str
    ok: bool
    text: str


def differences(old: Arrays, new: Arrays) -> list[Difference]:
    """The arrays that are not the same to the last bit, in the order in which they were computed."""
    found = []
    for name in [*old, *(name for name in new if name not in old)]:
        if name not in new or name not in old:
            found.append(Difference(name, np.inf, np.inf, f"only in the {'old' if name in old else 'new'} tree"))
        elif (one := _difference(name, old[name], new[name])) is not None:
            found.append(one)
    return found


def _difference(name: str, old: np.ndarray, new: np.ndarray) -> Difference | None:
    """How an array differs from the old one; None if it does not."""
    text = old.dtype.kind == new.dtype.kind == "U"  # the width of whose type is that of the longest word
    if old.dtype != new.dtype and not text:
        return Difference(name, np.inf, np.inf, f"{new.dtype} instead of {old.dtype}")
    if old.shape != new.shape:
        return Difference(name, np.inf, np.inf, f"shape {new.shape} instead of {old.shape}")
    same = np.array_equal(old, new) if text else old.tobytes() == new.tobytes()
    if same:
        return None
    if old.dtype.kind != "f":
        places = int((old != new).sum())
        return Difference(name, np.inf, np.inf, f"{places} of {old.size} values differ")
    return _of_numbers(name, old.astype(np.float64), new.astype(np.float64))


def _of_numbers(name: str, old: np.ndarray, new: np.ndarray) -> Difference:
    """How far numbers are apart; infinitely where only one of two is finite, or both are infinite otherwise."""
    alike = (old == new) | (np.isnan(old) & np.isnan(new))
    if alike.all():
        return Difference(name, 0.0, 0.0, "differs in the signs of zeros or in the bits of NaN only")
    both = np.isfinite(old) & np.isfinite(new)
    if not (alike | both).all():
        count = int((~(alike | both)).sum())
        return Difference(name, np.inf, np.inf, f"{count} of {old.size} numbers are finite in one tree only")
    absolute = float(np.abs(new[both] - old[both]).max())
    scale = float(max(np.abs(old[both]).max(), np.abs(new[both]).max()))
    return Difference(name, absolute / scale, absolute)


def judge(case: str, old: Arrays, new: Arrays, accepted: Mapping[str, Accepted]) -> Verdict:
    """Whether a case is the same in both trees, or no further off than what is accepted of it.

    Args:
        case: its name.
        old: arrays of the old tree.
        new: arrays of the new one.
        accepted: by the name of a case, of an array of it (``case:array``), or a pattern of these; the first that fits
            counts.
    """
    found = differences(old, new)
    if not found:
        return Verdict(case, True, f"equal ({len(old)} arrays)")
    allowed = [_accepted(f"{case}:{one.array}", case, accepted) for one in found]
    beyond = [(one, entry) for one, entry in zip(found, allowed, strict=True) if not (entry and entry.holds(one))]
    shown = [one for one, _ in beyond] or found
    worst = max(shown, key=lambda one: one.relative)
    how = f"{len(found)} of {len(old)} arrays differ, first {shown[0]}"
    if worst is not shown[0]:
        how += f"; worst {worst}"
    entry = beyond[0][1] if beyond else allowed[0]
    if entry is None:
        return Verdict(case, False, f"DIFFERS: {how}")
    told = f"{entry.bound:.0e} ({entry.why}): {how}"
    return Verdict(case, not beyond, f"DIFFERS by more than {told}" if beyond else f"within {told}")


def _accepted(name: str, case: str, accepted: Mapping[str, Accepted]) -> Accepted | None:
    """The first entry for an array or for its case."""
    return next((entry for pattern, entry in accepted.items()
                 if fnmatch.fnmatchcase(name if ":" in pattern else case, pattern)), None)  # fmt: skip


def read_accepted(path: Path) -> dict[str, Accepted]:
    """The table of accepted deviations: for a case, an array of it, or a pattern of names, its bound and why.

    Raises:
        ValueError: in one line, for anything else.
    """
    table = json.loads(path.read_text())
    try:
        found = {case: Accepted(float(entry["bound"]), entry["why"], float(entry.get("absolute", 0)))
                 for case, entry in table.items()}  # fmt: skip
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: give a bound and why for each case ({error!r})") from None
    for case, entry in found.items():
        if not (0 <= entry.bound < 1 and 0 <= entry.absolute < np.inf and entry.why.strip()):
            raise ValueError(f"{path}: {case}: give a bound from 0 to 1, and say why")
    return found
