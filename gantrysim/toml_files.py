"""Reading and validating TOML files; every problem is an InputError in one line that begins with a label."""

from __future__ import annotations

import tomllib
from pathlib import Path
from textwrap import shorten
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from gantrysim.errors import InputError
from gantrysim.files import settle

_MOST = 1 << 28  # length of a job or program [bytes]
_SHOWN = 80  # characters of a wrong value
Model = TypeVar("Model", bound=BaseModel)


def read_text(file: Path, errors: str = "strict") -> str:
    """Return the text of a file in UTF-8, or raise InputError where it has no end, as a device may.

    Args:
        file: to be read.
        errors: what becomes of bytes that are no text, as `open` takes it.
    """
    with file.open("rb") as stream:
        content = stream.read(_MOST + 1)
    if len(content) > _MOST:
        raise InputError(f"{file}: is longer than {_MOST:.3g} bytes")
    text = content.decode("utf-8", errors)
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_toml(file: Path, label: str) -> dict[str, Any]:
    """Return the content of a TOML file."""
    settle(file.parent, label)
    try:
        return tomllib.loads(read_text(file))
    except FileNotFoundError:
        raise InputError(f"{label}: no such file") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{label}: is not TOML: {error}") from None
    except RecursionError:
        raise InputError(f"{label}: is nested too deeply") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{label}: cannot be read: {error}") from None


def validated(model: type[Model], content: dict[str, Any], label: str) -> Model:
    """Return a model with these values."""
    try:
        return model(**content)
    except ValidationError as error:
        raise InputError(f"{label}: {one_line(error)}") from None


def one_line(error: ValidationError) -> str:
    """Return the problems that pydantic found, in one line."""
    problems: dict[str, str] = {}
    for item in error.errors():
        where = ".".join(str(part) for part in item["loc"] if not str(part).startswith(("float", "list")))
        cause = item.get("ctx", {}).get("error")
        if item["type"] == "value_error" and isinstance(cause, Exception):
            text = str(cause)
        elif item["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
            text = f"unknown key {where}"
        elif item["type"] in ("missing", "missing_argument"):
            text = f"{where} is missing"
        else:
            text = f"{where} = {shorten(repr(item['input']), _SHOWN)}: {item['msg'][:1].lower()}{item['msg'][1:]}"
        problems.setdefault(where or text, text)
    return "; ".join(dict.fromkeys(problems.values()))
