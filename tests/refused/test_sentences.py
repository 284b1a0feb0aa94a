"""Wrong inputs with the whole sentence that each gets, beside right ones at the same bounds, from tables.

A table of a file here is a group of cases, each an input and what comes of it: the sentence of its refusal, or an empty
text where it is accepted. A group says what is called:

    call    a function or class, as "module:name", or a method of one of `given`, as "$job.changed"; "command" for the
            command line. A table as input holds keyword arguments, a list those of "command", a text is the only one.
    key     name of the argument that a text is.
    end     text behind every text.
    always  arguments of all cases.
    then    a method of what was called, and its arguments.
    reads   attribute of what was called that is read.
    shows   attribute of what was called that is compared where the input is accepted.
    file    name of a file that holds the text; the call gets the name.
    edits   path of a file of this project: the input is a table of texts in it and what replaces them.
    beside  files, as a table of names and texts.

In arguments "$name" stands for one of `given`, and a table with "$" for the object of that class.
"""

import importlib
import tomllib
import warnings
from functools import cache
from pathlib import Path

import pytest

import gantrysim as gs

HERE = Path(__file__).parent
ROOT = HERE.parent.parent


def tables():
    """The groups of all files."""
    return [
        pytest.param(group, id=f"{file.stem}-{name}")
        for file in sorted(HERE.glob("*.toml"))
        for name, group in tomllib.loads(file.read_text(encoding="utf-8")).items()
    ]


@cache
def given(name):
    """What "$name" stands for."""
    match name:
        case "none":
            return None
        case "xy":
            return gs.Machine(name)
        case "bandit":
            return gs.env.GainBanditEnv(turns=1, preset="nominal")
        case "axes":
            return given("xy").axes
        case _:
            return gs.Job.load(name)


def named(call):
    """The function, class or method of a name."""
    if call.startswith("$"):
        found = given(call[1:].partition(".")[0])
        path = call.partition(".")[2]
    else:
        module, _, path = call.partition(":")
        found = importlib.import_module(module)
    for part in path.split("."):
        found = getattr(found, part)
    return found


def value_of(value):
    """A value of a table as an argument."""
    if isinstance(value, str) and value.startswith("$"):
        return given(value[1:])
    if isinstance(value, list):
        return [value_of(part) for part in value]
    if isinstance(value, dict):
        arguments = {key: value_of(part) for key, part in value.items() if key != "$"}
        return named(value["$"])(**arguments) if "$" in value else arguments
    return value


def edited(file, changes):
    text = (ROOT / file).read_text(encoding="utf-8")
    for old, new in changes.items():
        assert old in text, f"{file} has no {old!r}"
        text = text.replace(old, new)
    return text


def called(group, value):
    """What is returned for a case's input."""
    function = named(group["call"])
    if "end" in group:
        value += group["end"]
    if "edits" in group:
        value = edited(group["edits"], value)
    if "file" in group:
        Path(group["file"]).write_text(value, encoding="utf-8")
        value = group["file"]
    always = value_of(group.get("always", {}))
    if isinstance(value, dict):
        result = function(**(always | value_of(value)))
    elif "key" in group:
        result = function(**always, **{group["key"]: value_of(value)})
    else:
        result = function(value_of(value), **always)
    if "then" in group:
        method, *arguments = group["then"]
        result = getattr(result, method)(*value_of(arguments))
    if "reads" in group:
        _ = getattr(result, group["reads"])
    return result


def plain(text):
    """A text without the folders of this machine."""
    for folder in (Path.cwd(), ROOT):
        text = text.replace(f"{folder}/", "")
    return text


def outcome(group, value, command):
    """What comes of a case's input, in words."""
    if group["call"] == "command":
        status, _, said = command(*value)
        return plain(" ".join(said.split())) if status else ""
    try:
        with warnings.catch_warnings(action="error"):
            result = called(group, value)
    except gs.GantryError as error:
        return plain(str(error))
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    shown = getattr(result, group["shows"]) if "shows" in group else ""
    return shown if isinstance(shown, str) else "; ".join(map(str, shown))


@pytest.mark.parametrize("group", tables())
def test_sentences(group, gantrysim_command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    for name, text in group.get("beside", {}).items():
        Path(name).write_text(text, encoding="utf-8")
    wrong = []
    for value, expected in group["cases"]:
        got = outcome(group, value, gantrysim_command)
        if got != expected:
            wrong.append(f"{value!r}\n  gives   {got}\n  must be {expected}")
    assert not wrong, "\n".join(wrong)
