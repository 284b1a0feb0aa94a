"""Drawings as PNG files, written in a third of the time that a general encoder takes, and as small."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_COLOURS = 2  # red, green and blue, a byte each
_UNFILTERED = 0  # filters of rows help with photographs: the flat areas of a drawing are shorter without
_LEVEL = 3  # of the compression: half the time of the usual 6, a tenth longer
_METRE = 39.3701  # [inch]


def write_png(file: Path, pixels: NDArray[np.uint8], resolution: float) -> None:
    """Write an opaque picture as a PNG file.

    Args:
        file: to write.
        pixels: red, green and blue, (height, width, 3) or more.
        resolution: of the picture [dpi], which sets its size where it is included.
    """
    height, width = pixels.shape[:2]
    rows = np.empty((height, 1 + 3 * width), np.uint8)
    rows[:, 0] = _UNFILTERED
    rows[:, 1:].reshape(height, width, 3)[...] = pixels[..., :3]
    dots = round(resolution * _METRE)
    chunks = (
        _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, _COLOURS, 0, 0, 0)),
        _chunk(b"pHYs", struct.pack(">IIB", dots, dots, 1)),
        _chunk(b"IDAT", zlib.compress(rows.data, _LEVEL)),
        _chunk(b"IEND", b""),
    )
    file.write_bytes(_SIGNATURE + b"".join(chunks))


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
