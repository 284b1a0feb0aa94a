"""Drawings as PNG files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_LEVEL = 3  # of the compression: two thirds of the time of the usual 6, a tenth longer


def write_png(file: Path, pixels: NDArray[np.uint8], resolution: float) -> None:
    """Write an opaque picture as a PNG file.

    Args:
        file: to write.
        pixels: red, green and blue, (height, width, 3) or more.
        resolution: of the picture [dpi], which sets its size where it is included.
    """
    from PIL import Image  # slow to import

    picture = Image.fromarray(np.ascontiguousarray(pixels[..., :3]))
    picture.save(file, "PNG", compress_level=_LEVEL, dpi=(resolution, resolution))
