"""Figures written without being rendered, for tests of what a command does beside its pictures."""

import io
from pathlib import Path

from matplotlib import rcParams
from PIL import Image


def save_blank(figure, file, *, format=None, dpi=None, **_):
    """Write a blank picture in place of `Figure.savefig`, of the kind and size that it would write.

    The figure is composed as ever. To lay it out and to render it takes three quarters of the time of a run's command.
    """
    kind = format or Path(file).suffix.removeprefix(".") or "png"
    width, height = figure.get_size_inches()
    if kind == "svg":
        # in points, as matplotlib's
        text = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {72 * width:g} {72 * height:g}">\n</svg>\n'
        if isinstance(file, io.TextIOBase):
            file.write(text)
        else:
            Path(file).write_text(text, encoding="utf-8")
        return
    resolution = dpi or rcParams["savefig.dpi"]
    if resolution == "figure":
        resolution = figure.dpi
    size = (round(resolution * width), round(resolution * height))
    Image.new("RGB", size, "white").save(file, format=kind)
