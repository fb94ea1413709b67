"""Heights from images: greys of all depths are from black to white."""

import struct
import zlib

import numpy as np
import pytest

from robots.ground import Ground


def grey_png(bits, values):
    """A PNG of greys of so many bits, shape (H, W)."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = b""
    for row in values:
        told = "".join(format(int(value), f"0{bits}b") for value in row)
        told += "0" * (-len(told) % 8)
        rows += b"\0" + bytes(int(told[at : at + 8], 2) for at in range(0, len(told), 8))
    height, width = values.shape
    head = struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0)
    parts = chunk(b"IHDR", head), chunk(b"IDAT", zlib.compress(rows)), chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


@pytest.mark.parametrize("bits", [1, 2, 4, 8, 16])
def test_white_is_as_high_as_told_whatever_the_depth(tmp_path, monkeypatch, bits):
    monkeypatch.chdir(tmp_path)
    most = 2**bits - 1
    (tmp_path / "white.png").write_bytes(grey_png(bits, np.full((11, 21), most)))
    relief = Ground("white.png:0.01,0.05").relief(0, 0.05)
    assert relief.height(np.zeros(1), np.zeros(1)) == pytest.approx(0.01, rel=1e-6)
    values = np.full((11, 21), most // 2)
    (tmp_path / "grey.png").write_bytes(grey_png(bits, values))
    relief = Ground("grey.png:0.01,0.05").relief(0, 0.05)
    assert relief.height(np.zeros(1), np.zeros(1)) == pytest.approx(0.01 * (most // 2) / most, rel=1e-6)
