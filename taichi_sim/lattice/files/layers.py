"""Decode layers of VoxCAD files: one value for each voxel, x fastest, one layer for each z from the ground up.

``ASCII_READABLE`` has a character a voxel, "0" for 0 and so on through the alphabet of character codes; ``BASE64`` has
bytes, ``ZLIB`` compressed bytes and ``QT_ZLIB`` compressed bytes after their length, all three written in base 64.
"""

import base64
import binascii
import zlib

import numpy as np

from taichi_sim.base.arrays import Bytes, Floats

COMPRESSIONS = ("ASCII_READABLE", "BASE64", "ZLIB", "QT_ZLIB")
_LENGTH = 4  # bytes of Qt's length


def decode_layer(text: str, compression: str, count: int) -> Bytes:
    """Decode the bytes of one layer, shape (count,); it never unpacks many more bytes than ``count``.

    Raises:
        ValueError: for data of another size, or not of this compression; the message does not name the file.
    """
    if compression == "ASCII_READABLE":
        return _of_characters("".join(text.split()), count)
    packed = _of_base64("".join(text.split()), count)
    if compression == "BASE64":
        return _checked(packed, count)
    if compression == "QT_ZLIB" or packed[:_LENGTH] == count.to_bytes(_LENGTH, "big"):
        declared = int.from_bytes(packed[:_LENGTH], "big")
        if declared != count:
            raise ValueError(f"it declares {declared} voxels, not {count}")
        packed = packed[_LENGTH:]
    return _checked(_unpacked(packed, count), count)


def decode_numbers(text: str, count: int) -> Floats:
    """Parse ``count`` numbers separated by commas; a last comma is ignored.

    Raises:
        ValueError: for anything else; the message does not name the file.
    """
    text = text.strip().removesuffix(",")
    found = text.count(",") + 1 if text else 0
    if found != count:
        raise ValueError(f"it has {found} numbers, not {count}")
    try:
        numbers = np.array([float(part) for part in text.split(",")])
    except ValueError:
        raise ValueError("it has words that are no numbers") from None
    if not np.isfinite(numbers).all():
        raise ValueError("it has numbers that are not finite")
    return numbers


def _of_characters(text: str, count: int) -> Bytes:
    if len(text) != count:
        raise ValueError(f"it has {len(text)} voxels, not {count}")
    try:
        codes = np.frombuffer(text.encode("latin-1"), np.uint8)
    except UnicodeEncodeError:
        raise ValueError("it has characters that are no materials") from None
    if codes.min(initial=ord("0")) < ord("0"):
        raise ValueError("it has characters that are no materials")
    return codes - np.uint8(ord("0"))


def _of_base64(text: str, count: int) -> bytes:
    # Nothing that is packed well is much longer than what it holds.
    if len(text) > 2 * count + 1024:
        raise ValueError(f"it has {len(text)} characters for {count} voxels")
    try:
        return base64.b64decode(text, validate=True)
    except binascii.Error:
        raise ValueError("it is not written in base 64") from None


def _unpacked(packed: bytes, count: int) -> bytes:
    """Decompress at most ``count`` + 1 bytes: enough to see that there are too many."""
    try:
        return zlib.decompressobj().decompress(packed, count + 1)
    except zlib.error:
        raise ValueError("it is not compressed by zlib") from None


def _checked(values: bytes, count: int) -> Bytes:
    if len(values) != count:
        more = "more than " if len(values) > count else ""
        raise ValueError(f"it has {more}{min(len(values), count)} voxels, not {count}")
    return np.frombuffer(values, np.uint8)
