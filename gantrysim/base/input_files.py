"""Reading the files of a user: only regular ones, as others may have no end, or never begin; TOML, validated.

Every problem is an InputError in one line that begins with a label.
"""

from __future__ import annotations

import codecs
import os
import stat
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from io import BufferedReader
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any, TypeVar, get_args, get_type_hints

from gantrysim.base.errors import InputError, meant_names, nearest
from gantrysim.base.files import check_whole

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError
    from pydantic_core import ErrorDetails

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)

_MOST_BYTES = 1 << 28  # length of a job or program [bytes]
_PART = 1 << 20
_SHOWN = 80  # characters of a wrong value
_MANY_KEYS = 20  # keys of a table, which are not listed where the message says where all are
_NAMED_PROBLEMS = 8  # problems of one file that are named,
_KEYS_LENGTH = 400  # and characters of these
_INTEGERS = 1 << 63
Model = TypeVar("Model", bound="BaseModel")


def check_regular(file: Path, label: str = "") -> None:
    """Raise InputError where a file exists and is no regular one; a missing file passes.

    Args:
        file: to be read.
        label: of the file in the error; its path by default.
    """
    try:
        mode = file.stat().st_mode
    except OSError:  # opening it reports the reason
        return
    _check_mode(mode, label or str(file))


def check_inside(file: Path, folder: Path) -> None:
    """Raise InputError where a file in a folder is a link that leaves it: results that are sent on hold its text."""
    target = file.resolve()
    if not target.is_relative_to(folder.resolve()):
        raise InputError(f"{file}: is a link to {target}, outside the folder: put a copy of the file in its place")


def opened_file(file: Path, label: str = "") -> BufferedReader:
    """Return a regular file, open for reading.

    Args:
        file: to be read.
        label: of the file in the error; its path by default.

    Raises:
        InputError: a folder, a pipe, a socket or a device.
        OSError: a file that cannot be opened.
    """
    # without O_NONBLOCK the call would wait for a writer of a named pipe; regular files ignore it
    number = os.open(file, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    try:
        _check_mode(os.fstat(number).st_mode, label or str(file))
    except InputError:
        os.close(number)
        raise
    return os.fdopen(number, "rb")


def _check_mode(mode: int, label: str) -> None:
    for is_kind, name in _KINDS:
        if is_kind(mode):
            raise InputError(f"{label}: is {name}: must be a regular file")


def read_text(file: Path, errors: str = "strict", label: str = "", most: int | None = None) -> str:
    """Return the text of a file in UTF-8, or in UTF-16 with the mark of the byte order.

    Args:
        file: to be read.
        errors: what becomes of bytes that are no text, as `open` takes it.
        label: of the file in errors; its path by default.
        most: length that it may have; by default that of a job or program [bytes].

    Raises:
        InputError: no regular file, or one that is too long.
        OSError: a file that cannot be read.
    """
    longest = _MOST_BYTES if most is None else most
    content = bytearray()
    with opened_file(file, label) as stream:
        # in parts: a call takes memory for as much as it is asked for
        while part := stream.read(_PART):
            content += part
            if len(content) > longest:
                raise InputError(f"{label or file}: is longer than {longest:.3g} bytes")
    return decoded_text(content, errors)


def decoded_text(content: bytes | bytearray, errors: str = "strict") -> str:
    """Return text in UTF-8, or in UTF-16 with the mark of the byte order, with lines that end in a line feed."""
    # programs of Windows write a mark before text of two bytes a character
    marked = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    text = content.decode("utf-16" if marked else "utf-8", errors)
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_toml(file: Path, label: str) -> dict[str, Any]:
    """Return the content of a TOML file."""
    if not file.exists():
        check_whole(file.parent, label)
    try:
        text = read_text(file, label=label)
    except FileNotFoundError:
        raise InputError(f"{label}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{label}: cannot be read: {error}") from None
    try:
        return toml_content(text, label)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{label}: is not TOML: {error}") from None


def toml_content(text: str, label: str) -> dict[str, Any]:
    """Return the content of a TOML text, whose integers have at most 64 bits as TOML requires.

    Raises:
        InputError: an integer beyond, or values that are nested too deeply.
        tomllib.TOMLDecodeError: a text that is not TOML.
    """
    beyond = f"{label}: has an integer beyond 64 bits: must be {-_INTEGERS} to {_INTEGERS - 1}"
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except ValueError:  # Python reads no integer of more than 4,300 digits
        raise InputError(beyond) from None
    except RecursionError:
        raise InputError(f"{label}: is nested too deeply") from None
    if not _within_64_bits(content):
        raise InputError(beyond)
    return content


def _within_64_bits(content: dict[str, Any]) -> bool:
    """Whether every integer of a content has at most 64 bits; larger ones, if hexadecimal, cannot even be printed."""
    waiting: list[Any] = [content]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            waiting += value.values()
        elif isinstance(value, list):
            waiting += value
        elif isinstance(value, int) and not -_INTEGERS <= value < _INTEGERS:
            return False
    return True


def validated_model(
    model: type[Model],
    content: dict[str, Any],
    label: str,
    keys: Callable[[], Iterable[str]] | None = None,
    context: Mapping[str, Any] | None = None,
    listed: str = "",
) -> Model:
    """Return a model with these values.

    Args:
        model: class of the model.
        content: values by name.
        label: with which a message begins.
        keys: returns the dotted names of all keys, where they depend on the content; by default the model's fields.
        context: for the validators of the model.
        listed: where all keys are listed, for the message on an unknown one.

    Raises:
        InputError: an unknown key, or a value that is refused.
    """
    from pydantic import ValidationError

    try:
        return model.model_validate(content, context=context)
    except ValidationError as error:
        known = field_names(model) if keys is None else keys()
        raise InputError(f"{label}: {one_line(error, known, listed, content=content)}") from None


def field_names(kind: type[Any], prefix: str = "") -> Iterator[str]:
    """Yield the dotted names of the fields of a model or dataclass, nested ones included."""
    from pydantic import BaseModel

    hints = get_type_hints(kind)
    for name in getattr(kind, "model_fields", None) or [field.name for field in fields(kind)]:
        yield f"{prefix}{name}"
        for part in (hints[name], *get_args(hints[name])):
            if isinstance(part, type) and (is_dataclass(part) or issubclass(part, BaseModel)):
                yield from field_names(part, f"{prefix}{name}.")


def one_line(
    error: ValidationError, known: Iterable[str] = (), listed: str = "", *, content: Any = None, located: bool = False
) -> str:
    """Return the first problems that pydantic found, in one line, and the number of the others.

    Args:
        error: of a model.
        known: dotted names of its keys, of which the nearest to an unknown one are named.
        listed: where all of them are listed, if anywhere.
        content: the values that were refused, by name.
        located: whether what a validator refuses is named with its place, as where several tables are alike.
    """
    names = tuple(known)
    problems: dict[str, str] = {}
    hints = set[str]()
    for item in error.errors():
        context = item.get("ctx", {})
        place = [part for part in _keys_of_place(item["loc"], content) if not _is_kind(part)]
        # of a union, the class that a value might be
        where = ".".join(place[:-1] if place and place[-1] == context.get("class_name") else place)
        cause = context.get("error")
        if item["type"] == "value_error" and isinstance(cause, Exception):
            # of a list of tables, too, which has several alike
            is_located = located or any(part.isdigit() for part in place)
            text = _located_text(where, str(cause)) if is_located and where else str(cause)
        elif item["type"] == "union_tag_invalid":
            kind = context["discriminator"].strip("'")
            text = f"{where}.{kind} = {context['tag']!r:.60}: must be one of {context['expected_tags']}"
        elif item["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
            hint = _meant_keys(where, names, _MANY_KEYS if listed else None)
            key = where if len(where) <= _SHOWN else f"{where[:_SHOWN]}..."
            text = f"unknown key {key}{'' if hint in hints else hint}"  # a list of keys once
            hints.add(hint)
        elif item["type"] in ("missing", "missing_argument"):
            text = f"{where} is missing"
        else:
            text = f"{where} = {shorten(repr(item['input']), _SHOWN)}: {_must_be(item)}"
        problems.setdefault(where or text, text)
    texts = list(dict.fromkeys(problems.values()))
    named = 1
    while named < min(len(texts), _NAMED_PROBLEMS) and len("; ".join(texts[: named + 1])) <= _KEYS_LENGTH:
        named += 1
    others = [f"and {len(texts) - named} more"] if len(texts) > named else []
    line = "; ".join([*texts[:named], *others])
    if not listed or not any(text.startswith("unknown key") for text in texts):
        return line
    return f"{line} {listed}" if line.endswith("?") else f"{line}; {listed}"


def _located_text(where: str, text: str) -> str:
    """Return a text with the place of what it is about, whose last part it may name itself."""
    name = where.rpartition(".")[2]
    tail = text.removeprefix(name)
    return f"{where}{tail}" if tail != text and tail.startswith((":", " =")) else f"{where}: {text}"


def _keys_of_place(place: Iterable[int | str], content: Any) -> Iterator[str]:
    """Yield the parts of a place but for the `kind` of a table, which pydantic names after it and which is no key."""
    within = content
    for part in place:
        if isinstance(within, Mapping) and part not in within and within.get("kind") == part:
            continue
        if isinstance(within, Mapping):
            within = within.get(part)
        elif isinstance(within, list | tuple) and isinstance(part, int) and part < len(within):
            within = within[part]
        yield str(part)


def _is_kind(part: str) -> bool:
    """Return whether a part of a place is the kind by which pydantic tells apart what a value may be, and no key."""
    kinds = ("float", "list[", "literal[", "constrained-", "function-")
    return part in ("str", "int", "bool") or part.startswith(kinds)


_MUST_BE = {
    "number": ("float_parsing", "float_type"),
    "whole number": ("int_parsing", "int_type", "int_from_float"),
    "text": ("string_type",),
    "true or false": ("bool_parsing", "bool_type"),
    "list": ("list_type", "tuple_type"),
    "table": ("dict_type", "dataclass_type", "model_type", "dataclass_exact_type"),
}
_WITHOUT_ARTICLE = ("text", "true or false")
_BOUNDS = {"gt": "greater than", "ge": "at least", "lt": "below", "le": "at most"}


def _must_be(item: ErrorDetails) -> str:
    """Return what a value must be that pydantic refuses, in words."""
    for words, kinds in _MUST_BE.items():
        if item["type"] in kinds:
            return f"must be {words}" if words in _WITHOUT_ARTICLE else f"must be a {words}"
    context = item.get("ctx", {})
    for name, words in _BOUNDS.items():
        if name in context:
            return f"must be {words} {context[name]:g}"
    if item["type"] == "literal_error":
        return f"must be {context['expected']}"
    return f"{item['msg'][:1].lower()}{item['msg'][1:]}"


def _meant_keys(where: str, known: Sequence[str], most: int | None) -> str:
    """Return the end of a message on an unknown key: which of the same table are nearest, or else all of them.

    Args:
        where: the key.
        known: all keys.
        most: number of keys of a table above which they are not listed; None for any number.
    """
    *tables, wrong = where.split(".")
    beside = _keys_in(tables, known)
    if wrong in beside:
        return ": is a key of another kind"
    if near := nearest(wrong, sorted(beside)):
        return f": {meant_names(near)}"
    if not beside or (most is not None and len(beside) > most):
        return ""
    return f": known: {', '.join(sorted(beside))}"


def _keys_in(tables: Iterable[str], known: Iterable[str]) -> set[str]:
    """Return the keys of a table, given its name by the tables around it."""
    prefix = "".join(f"{table}." for table in tables)
    return {name.removeprefix(prefix).partition(".")[0] for name in known if name.startswith(prefix)}
