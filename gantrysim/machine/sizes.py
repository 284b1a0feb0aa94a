"""Bounds on sizes in an MJCF, checked before MuJoCo reads it: a few characters can ask for minutes or gigabytes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from gantrysim.base.errors import InputError
from gantrysim.base.input_files import check_regular

_MOST_ELEMENTS = 20_000  # copies by replicate, composite and flexcomp counted each time
_MOST_CELLS = 100_000_000  # of height fields and textures together: as floats 400 MB
_MOST_MEMORY = 4e9  # of <size memory>, [bytes]
_MOST_USER = 100_000  # user values of an element, or of the simulation
_DEEPEST = 10  # files that include one another
_SUFFIX = {"k": 2.0**10, "m": 2.0**20, "g": 2.0**30, "t": 2.0**40, "p": 2.0**50, "e": 2.0**60}
_COPIES = ("replicate", "composite", "flexcomp")
_CELLS = {"hfield": ("nrow", "ncol"), "texture": ("width", "height")}


def check_sizes(file: Path) -> None:
    """Check sizes and files that an MJCF states, included files among them.

    A file that is no XML passes: MuJoCo's own message describes the mistake.

    Raises:
        InputError: too many elements or cells, too much memory, or a named file that is no regular one.
    """
    try:
        root = ElementTree.parse(file).getroot()
    except (ElementTree.ParseError, ValueError, OSError):
        return
    elements = 0.0
    cells = 0.0
    for element, copies in _elements(root, file.parent, 1.0, 1):
        elements += copies
        if element.tag in _CELLS:
            cells += math.prod(_number(element, name) for name in _CELLS[element.tag])
        _check_memory(element)
        _check_file(element, root, file.parent)
        if elements > _MOST_ELEMENTS:
            raise InputError(f"has more than {_MOST_ELEMENTS} elements, copies counted each time: must have fewer")
        if cells > _MOST_CELLS:
            raise InputError(
                f"its height fields and textures have {cells:.3g} cells: must have at most {_MOST_CELLS:.3g}"
            )


def _elements(parent: Element, folder: Path, copies: float, depth: int) -> Iterator[tuple[Element, float]]:
    """Yield all elements, of included files too, with the number of times that each is copied."""
    for child in parent:
        if child.tag == "include" and child.get("file"):
            included = folder / str(child.get("file"))
            check_regular(included)
            if depth < _DEEPEST and included.is_file():
                try:
                    root = ElementTree.parse(included).getroot()
                except (ElementTree.ParseError, ValueError, OSError):
                    continue
                yield from _elements(root, folder, copies, depth + 1)
            continue
        count = math.prod(_numbers(child.get("count", "1"))) if child.tag in _COPIES else 1.0
        yield child, copies * count
        yield from _elements(child, folder, copies * count, depth)


def _check_memory(element: Element) -> None:
    if element.tag != "size":
        return
    for name, text in element.attrib.items():
        if name == "memory":
            memory = _memory(text)
            if memory > _MOST_MEMORY:
                raise InputError(f"size memory = {text[:20]}: must be at most {_MOST_MEMORY:.3g} bytes")
        elif _number(element, name) > _MOST_USER:
            raise InputError(f"size {name[:20]} = {text[:20]}: must be at most {_MOST_USER}")


def _memory(text: str) -> float:
    """Return a size such as "10M" in bytes, 0 for a text that is not a size."""
    plain = text.strip().lower()
    factor = _SUFFIX.get(plain[-1:], 1.0)
    numbers = _numbers(plain[:-1] if plain[-1:] in _SUFFIX else plain)
    return numbers[0] * factor if numbers else 0.0


def _check_file(element: Element, root: Element, folder: Path) -> None:
    """Refuse a mesh, texture or height field in a file that is no regular one, which MuJoCo would wait for."""
    name = element.get("file")
    if not name:
        return
    asset_folders = [""]
    for compiler in root.iter("compiler"):
        asset_folders += [compiler.get(key, "") for key in ("assetdir", "meshdir", "texturedir")]
    for asset_folder in asset_folders:
        check_regular(folder / asset_folder / name)


def _number(element: Element, name: str) -> float:
    return max(_numbers(element.get(name, "")), default=0.0)


def _numbers(text: str) -> list[float]:
    """Return the numbers of an attribute, without those that are none, which MuJoCo refuses."""
    numbers = []
    for word in text.split()[:10]:
        try:
            numbers.append(max(float(word), 0.0))
        except ValueError:
            continue
    return numbers
