"""Errors of the domain: one line that names the quantity, its value and the bound."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from pathlib import Path
from reprlib import Repr

import numpy as np

_EXACT_INTEGERS = 2.0**53  # up to which floats tell whole numbers apart
_LISTED_NAMES = 3  # names that are listed first
_SIMILAR_NAME = 0.5  # ratio of similarity from which a name may be meant
_MESSAGE_LENGTH = 1900  # characters of a message
_shortened = Repr()
_shortened.maxstring = _shortened.maxother = 80  # characters of a value or name in a message


def short_text(value: object) -> str:
    """Return a value in one line, shortened."""
    # arrays have several lines
    return _shortened.repr(value).replace("\n", " ")


class GantryError(Exception):
    """Base of every error that gantrysim raises on purpose; its text has a bounded length, whatever it quotes."""

    def __init__(self, text: str = "", *arguments: object) -> None:
        super().__init__(shortened_message(text), *arguments)


class InputError(GantryError, ValueError):
    """A value that the user gave lies outside its bounds."""


def shortened_message(text: str) -> str:
    """Return a message without its middle where it is too long: its begin has the place, its end the bound."""
    return (
        text if len(text) <= _MESSAGE_LENGTH else f"{text[: _MESSAGE_LENGTH // 2]} ... {text[-_MESSAGE_LENGTH // 2 :]}"
    )


class AxisError(InputError):
    """An InputError about an axis that a program moves and no axis of its controller can follow."""


class TimedError(InputError):
    """An InputError about a moment of a program.

    Attributes:
        time: of the setpoint [s].
    """

    def __init__(self, text: str, time: float = 0.0) -> None:
        super().__init__(text)
        self.time = time


def text_of(error: BaseException) -> str:
    """Return an error in one line, with its type where it is none of the domain."""
    text = " ".join(str(getattr(error, "strerror", None) or error).split())
    return text if isinstance(error, GantryError) else f"{type(error).__name__}: {text}".removesuffix(": ")


def expanded_path(path: str | os.PathLike[str]) -> Path:
    """Return a path with ~ as the home folder, or raise InputError where there is none, or no such path can be."""
    if not isinstance(path, str | os.PathLike):
        raise wrong_type("path", path, "a path, as text or pathlib.Path")
    if "\0" in os.fspath(path):
        raise InputError(f"{short_text(os.fspath(path))}: has a zero character, which no path can have")
    try:
        expanded = Path(path).expanduser()
        # fails for too long a name, or in a folder that may not be entered
        expanded.exists()
    except RuntimeError:
        raise InputError(f"{os.fspath(path)}: no such home folder") from None
    except OSError as error:
        raise InputError(f"{short_text(os.fspath(path))}: {error.strerror}") from None
    return expanded


def finite(name: str, value: float, unit: str = "") -> float:
    """Return `value` as a float, or raise InputError where it is not a finite number."""
    try:
        # "200" is no number, though it can be read as one
        if isinstance(value, bool | str | bytes):
            raise TypeError
        number = float(value)
    except (TypeError, ValueError):
        raise InputError(f"{name} = {short_text(value)}: must be a number") from None
    except OverflowError:  # of an integer of more than 308 digits
        raise InputError(f"{name}: must be finite, at most {sys.float_info.max:.4g}") from None
    if not math.isfinite(number):
        raise InputError(f"{name} = {_quantity(number, unit)}: must be finite")
    return number


def finite_of(name: str, text: str, unit: str = "") -> float:
    """Return the number that a text states, or raise InputError where it states no finite one."""
    try:
        number = float(text)
    except ValueError:
        raise InputError(f"{name} = {short_text(text)}: must be a number") from None
    return finite(name, number, unit)


def positive(name: str, value: float, unit: str = "", most: float = math.inf) -> float:
    """Return `value` as a float, or raise InputError where it is not finite, above zero and at most `most`."""
    number = finite(name, value, unit)
    if number <= 0:
        raise InputError(f"{name} = {_quantity(number, unit)}: must be greater than {_quantity(0, unit)}")
    return _at_most(name, number, most, unit)


def at_least(name: str, value: float, bound: float, unit: str = "", most: float = math.inf) -> float:
    """Return `value` as a float, or raise InputError where it is not finite and from `bound` to `most`."""
    number = finite(name, value, unit)
    if number < bound:
        raise InputError(f"{name} = {_quantity(number, unit, bound)}: must be at least {_quantity(bound, unit)}")
    return _at_most(name, number, most, unit)


def between(name: str, value: float, low: float, high: float, unit: str = "") -> float:
    """Return `value` as a float, or raise InputError where it is not finite and from `low` to `high`."""
    number = finite(name, value, unit)
    if not low <= number <= high:
        shown = _quantity(number, unit, low if number < low else high)
        raise InputError(f"{name} = {shown}: must be {low:g} to {_quantity(high, unit)}")
    return number


def plane_point(name: str, value: Sequence[float], unit: str = "mm") -> tuple[float, float]:
    """Return `value` as two floats, x and y, or raise InputError where it is not two finite numbers."""
    numbers = np.ravel(np.asarray(value, object))
    if numbers.size != 2:
        raise InputError(f"{name} = {value}: must be two numbers, x and y [{unit}]")
    return finite(f"{name} x", numbers[0], unit), finite(f"{name} y", numbers[1], unit)


def space_point(name: str, value: Sequence[float], unit: str = "mm") -> tuple[float, float, float]:
    """Return `value` as x, y and z, z being 0 where it is left out, or raise InputError."""
    numbers = tuple(value)
    if len(numbers) not in (2, 3):
        raise InputError(f"{name} of {len(numbers)} numbers: must be x, y[, z]")
    coordinates = [finite(f"{name} {axis}", number, unit) for axis, number in zip("xyz", numbers, strict=False)]
    x, y, z = [*coordinates, 0.0][:3]
    return x, y, z


def whole_number(name: str, value: float, bound: int) -> int:
    """Return `value` as an int, or raise InputError where it is no whole number or below `bound`."""
    number = at_least(name, value, bound, most=_EXACT_INTEGERS)
    if number != int(number):
        raise InputError(f"{name} = {number:g}: must be a whole number")
    return int(number)


def wrong_type(name: str, value: object, wanted: str, advice: str = "") -> InputError:
    """Return the error for a value of a wrong type.

    Args:
        name: of the argument.
        value: given.
        wanted: what it must be, in words.
        advice: what to write instead, where that is known.
    """
    remedy = f"; {advice}" if advice else ""
    return InputError(f"{name} is of type {type(value).__name__}: must be {wanted}{remedy}")


def check_type(name: str, value: object, kind: type, wanted: str, advice: str = "") -> None:
    """Raise the error of `wrong_type` for anything but a `kind`."""
    if not isinstance(value, kind):
        raise wrong_type(name, value, wanted, advice)


def check_one_of(kind: str, name: object, known: Sequence[str]) -> None:
    """Raise the error of `unknown` for anything but one of the `known` names."""
    if not isinstance(name, str) or name not in known:
        raise unknown(kind, name, known)


def unknown(kind: str, name: object, known: Iterable[str]) -> InputError:
    """Return the error for a `name` that is none of the `known` ones, with the nearest first."""
    return InputError(unknown_text(kind, name, known))


def unknown_text(kind: str, name: object, known: Iterable[str]) -> str:
    """Return the text of `unknown`, for errors of other types."""
    names = sorted(known)
    if not names:
        return f"unknown {kind} {short_text(name)}: there are none"
    near = nearest(name, names) if isinstance(name, str) else []
    hint = f"did you mean {near[0]}? " if near else ""
    listed = [*near, *(other for other in names if other not in near)]
    return f"unknown {kind} {short_text(name)}: {hint}known: {', '.join(listed)}"


def meant_names(names: Sequence[str]) -> str:
    """Return the question that suggests names, as "did you mean a, b or c?"; empty without any."""
    *others, last = names or [""]
    return f"did you mean {', '.join(others)} or {last}?" if others else f"did you mean {last}?" if last else ""


def nearest(name: str, names: Iterable[str]) -> list[str]:
    """Return the names nearest to a wrong one, nearest first; in any case, and dotted ones by their last part too."""
    wrong = name.casefold()
    spellings: dict[str, list[str]] = {}  # as they are compared
    for known in names:
        whole = known.casefold()
        for spelling in dict.fromkeys((whole, whole.rpartition(".")[2])):
            spellings.setdefault(spelling, []).append(known)
    close = get_close_matches(wrong, spellings, n=_LISTED_NAMES, cutoff=_SIMILAR_NAME)
    return list(dict.fromkeys(known for spelling in close for known in spellings[spelling]))[:_LISTED_NAMES]


def _at_most(name: str, number: float, most: float, unit: str) -> float:
    if number > most:
        raise InputError(f"{name} = {_quantity(number, unit, most)}: must be at most {_quantity(most, unit)}")
    return number


def _quantity(value: float, unit: str, bound: float = math.nan) -> str:
    """Return a value in words, with all digits where it would read as the bound that it misses."""
    digits = f"{value:g}" if f"{value:g}" != f"{bound:g}" else repr(value).removesuffix(".0")
    return f"{digits} {unit}".rstrip()
