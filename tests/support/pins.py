"""Answers of the package that are pinned in files, and what differs from them.

Numbers are pinned with seven digits and compared to a millionth of their own scale: of themselves, or of the largest
one in the list that they stand in, as coordinates and residuals near zero have that of their neighbours. Of a text the
words and whole numbers are compared as they are, and decimal numbers to a unit of their last digit.
"""

import json
import math
import re
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parent.parent / "pinned"
TOLERANCE = 1e-6
DIGITS = 7
ZERO = 1e-9  # below which a number without neighbours is rounding
WIDTH = 120  # of a line in a file
SHORT = 20  # characters of a text that shares a line with others

NUMBER = re.compile(r"(?<![\w.])[-−+]?\d+(?:[.,]\d+)?(?:e[-+]?\d+)?")


def pinned(value):
    """A value as JSON holds it: numbers with seven digits, arrays as lists, dataclasses as tables."""
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, np.generic | np.ndarray):
        return pinned(value.tolist())
    if isinstance(value, int):
        return value
    if isinstance(value, float):
        if not math.isfinite(value):
            return str(value)
        short = float(f"{value:.{DIGITS}g}")
        return int(short) if short == int(short) and abs(short) < 1e15 else short
    if is_dataclass(value):
        return {item.name: pinned(getattr(value, item.name)) for item in fields(value)}
    if hasattr(value, "_asdict"):
        return pinned(value._asdict())
    if isinstance(value, dict):
        return {str(key): pinned(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [pinned(item) for item in value]
    return str(value)


def saved(room):
    """The pinned answers of a room, by case."""
    file = FOLDER / f"{room}.json"
    return json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}


def write(room, answers):
    """Pin the answers of a room."""
    (FOLDER / f"{room}.json").write_text(f"{dumped(answers)}\n", encoding="utf-8")


def dumped(value, indent=0):
    """JSON of which a list or table of numbers is one line, and any other item has a line of its own."""
    line = json.dumps(value, ensure_ascii=False, separators=(",", ": "))
    items = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    is_flat = not any(isinstance(item, dict) or (isinstance(item, str) and len(item) > SHORT) for item in items)
    if not isinstance(value, dict | list) or not value or (is_flat and len(line) + indent <= WIDTH):
        return line
    inside = " " * (indent + 1)
    if isinstance(value, dict):
        items = [
            f"{inside}{json.dumps(key, ensure_ascii=False)}: {dumped(item, indent + 1)}" for key, item in value.items()
        ]
        return "{\n" + ",\n".join(items) + "\n" + " " * indent + "}"
    return "[\n" + ",\n".join(f"{inside}{dumped(item, indent + 1)}" for item in value) + "\n" + " " * indent + "]"


def differences(before, after, where="", scale=0.0, tolerance=TOLERANCE):
    """Every place at which two values differ, a line each."""
    if isinstance(before, dict) and isinstance(after, dict):
        lines = []
        for key in dict.fromkeys([*before, *after]):
            place = f"{where} / {key}" if where else key
            if key not in before:
                lines.append(f"{place}: new: {shown(after[key])}")
            elif key not in after:
                lines.append(f"{place}: gone: {shown(before[key])}")
            else:
                lines += differences(before[key], after[key], place, 0.0, tolerance)
        return lines
    if isinstance(before, list) and isinstance(after, list):
        if len(before) != len(after):
            return [f"{where}: {shown(before)} -> {shown(after)}"]
        scale = max([scale, *(abs(item) for item in before if is_number(item))])
        pairs = enumerate(zip(before, after, strict=True))
        return [line for k, (a, b) in pairs for line in differences(a, b, f"{where}[{k}]", scale, tolerance)]
    if is_number(before) and is_number(after):
        bound = max(ZERO, tolerance * max(scale, abs(before), abs(after)))
        return [] if abs(before - after) <= bound else [f"{where}: {before} -> {after}"]
    if isinstance(before, str) and isinstance(after, str):
        return [] if same_text(before, after) else [f"{where}: {text_change(before, after)}"]
    return [] if before == after else [f"{where}: {shown(before)} -> {shown(after)}"]


def is_number(value):
    return isinstance(value, int | float) and not isinstance(value, bool)


def same_text(before, after):
    """Whether two texts have the same words, and the same numbers but for a unit of a decimal's last digit."""
    if before == after:
        return True
    if NUMBER.sub("#", before) != NUMBER.sub("#", after):
        return False
    return all(near_in_text(a, b) for a, b in zip(NUMBER.findall(before), NUMBER.findall(after), strict=True))


def near_in_text(before, after):
    if before == after:
        return True
    a, b = (text.replace("−", "-") for text in (before, after))
    if not ("." in a and "." in b) or "e" in a + b or len(a.partition(".")[2]) != len(b.partition(".")[2]):
        return False
    return abs(float(a) - float(b)) <= 1.01 * 10.0 ** -len(a.partition(".")[2])


def text_change(before, after):
    """The lines of a text that differ."""
    old, new = before.splitlines() or [""], after.splitlines() or [""]
    if len(old) != len(new):
        gone = [line for line in old if line not in new]
        come = [line for line in new if line not in old]
        return "".join(f"\n    - {line}" for line in gone) + "".join(f"\n    + {line}" for line in come)
    unlike = [(a, b) for a, b in zip(old, new, strict=True) if not same_text(a, b)]
    return "".join(f"\n    - {a}\n    + {b}" for a, b in unlike)


def shown(value):
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) < 300 else f"{text[:300]}..."
