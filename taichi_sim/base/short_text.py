"""Short texts: of numbers, and of descriptions and results that hold arrays, for notebooks and the Python prompt."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

LONGEST = 80  # characters of a field
NOTHING = 1e-12  # is told as 0
VAST = 1e12  # numbers from here on are told in six digits
FEW = 4  # entries of an array or a sequence that are written out


def shortest(number: float) -> str:
    """A number in as few digits as say it exactly: six, if they do, or all."""
    short = f"{number:g}"
    return short if float(short) == number else repr(float(number))


def decimal(number: float, sign: str = "") -> str:
    """A number with four decimals, or in three digits where these would not show it, or six if it is vast.

    ``sign`` may be ``"+"``.
    """
    if abs(number) >= VAST:
        return f"{number:{sign}.6g}"
    return f"{number:{sign}.3g}" if is_hidden(number) else f"{number:{sign}z.4f}"


def is_hidden(number: float) -> bool:
    """Whether four decimals would not show a number, though it is not nothing."""
    return NOTHING < abs(number) < 1e-3


def counted(count: int, one: str, several: str = "") -> str:
    """A count and its noun, such as ``1 body`` or ``2 bodies``; ``several`` is the plural (default: with an s)."""
    return f"{count} {one if count == 1 else several or one + 's'}"


def printable(text: str) -> str:
    """A text in which bytes of a file's name that are no UTF-8 are told as escapes, such as ``\\udcff``.

    Pages and pictures cannot hold them as they are.
    """
    return text.encode(errors="backslashreplace").decode()


class ShortText:
    """A dataclass whose text tells the shapes of its arrays instead of what is in them; declare it ``repr=False``."""

    def __repr__(self) -> str:
        if not is_dataclass(self):
            return super().__repr__()
        told = (f"{each.name}={_short(getattr(self, each.name))}" for each in fields(self) if each.repr)
        return f"{type(self).__name__}({', '.join(told)})"


def _short(value: Any) -> str:
    if isinstance(value, np.ndarray) and value.size > FEW:
        return f"<{value.dtype} of shape {value.shape}>"
    if isinstance(value, Mapping) and len(value) > FEW:
        return f"<{len(value)} by name>"
    if isinstance(value, list | tuple) and len(value) > FEW:
        return f"<{len(value)} of {type(value[0]).__name__}>"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{key!r}: {_short(each)}' for key, each in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"({', '.join(map(_short, value))})"
    text = " ".join(repr(value).split())
    return text if len(text) <= LONGEST or isinstance(value, ShortText) else f"{text[: LONGEST - 3]}..."
