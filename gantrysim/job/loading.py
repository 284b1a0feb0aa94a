"""Where a job comes from: a built-in one, a TOML file, or a program file of a controller, in which dialect."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

from gantrysim.base.errors import InputError, expanded_path, unknown
from gantrysim.base.files import check_whole
from gantrysim.base.input_files import check_inside, check_regular, read_text, read_toml, validated_model
from gantrysim.base.user_code import absolute_code, is_code
from gantrysim.controllers.controller import Controller
from gantrysim.job.code import CONTROLLER, absolute_value
from gantrysim.job.overrides import LIST_OF_KEYS
from gantrysim.job.programs import program_class, reader, suffixes
from gantrysim.job.settings import ServoSettings

# calls of subprograms of G-code, which may lie in files beside it
_CALL = re.compile(r"\bO\s*(?:<([^<>\n]+)>|(\d+))\s*CALL|(?:\bM\s*98|\bG\s*65)[^\n;(]*?P\s*(\d+)", re.IGNORECASE)
_LONGEST_NUMBER = 4  # digits of a program's number; those before are repetitions
_COMMENT = re.compile(r"\([^()\n]*\)|;.*")
_SUFFIXES = (".ngc", ".nc", ".tap", ".cnc", ".eia", ".txt", ".mpf", "")
_MOST_FILES = 200  # files

# names of dialects in the registry
LINUXCNC = "linuxcnc.Program"
SLICER = "slicer.Program"
FANUC = "fanuc.Program"
# of files that several controls and senders use for their own dialects; .ngc is LinuxCNC's alone
SHARED_SUFFIXES = (".nc", ".tap", ".gcode", ".g", ".gco", ".cnc", ".txt", ".mpf", ".h", ".gc", ".eia", ".iso", ".ncc")
_LOOKED_AT = 200_000  # characters of a text: a slicer's first layer is longer than its header
_LEAST_SHARE = 0.5  # of the lines that have to be blocks
_BLOCK = re.compile(
    r"^\s*/?\s*(?:N\s*\d+\s*)?(?:(?:[GMTSFXYZIJKRE]\s*[-+]?[\d.]|[XYZIJKRSFE]\s*[#\[]).*|O\s*[\d<].*|(?:WH(?:ILE)?|IF)\s*\[.*|(?:GO(?:TO)?|END?)\s*\d.*|#[\d<].*|%|[$?!~].*)$",
    re.IGNORECASE,
)
_MOTION = re.compile(r"(?<![A-Z])(?:G\s*0*[0-3](?![\d.])|[XYZ]\s*[-+]?[\d.#\[])", re.IGNORECASE)
_O_NUMBER = re.compile(r"\s*O\s*\d{1,8}\s*$", re.IGNORECASE)
_FANUC_WORDS = re.compile(
    r"^\s*/?\s*(?:N\s*\d+\s*)?(?:WH(?:ILE)?\s*\[.*\]\s*DO\s*\d|GO(?:TO)?\s*[\d#\[]|IF\s*\[.*\]\s*(?:GO|TH))",
    re.IGNORECASE | re.MULTILINE,
)
_FANUC_CODES = re.compile(
    r"^\s*/?\s*(?:N\s*\d+\s*)?[^(;\n]*?(?:(?<![A-Z_])G\s*0*(?:50\.1|51\.1|65|68|69)(?![\d.])|,\s*[RC]\s*[\d.#\[])",
    re.IGNORECASE | re.MULTILINE,
)
_EXTRUDING_MOVE = re.compile(r"^\s*(?:N\s*\d+\s*)?G\s*\d[^(;\n]*?[\s\d.]E\s*[-+]?[\d.]", re.IGNORECASE | re.MULTILINE)
# M100 to M199 may be a machine's own in LinuxCNC: of them those of heaters alone
_FIRMWARE = re.compile(
    r"^\s*(?:N\s*\d+\s*)?(?:M\s*0*(?:1[78]|8[234]|104|109|140|190|20[1-8]|22[01]|30[0-4]|40[0-2]|42[01]"
    r"|50[0-4]|600|851|90[067]|91[345])(?!\d)|[A-Z]+_[A-Z_]+(?:\s|$))",
    re.IGNORECASE | re.MULTILINE,
)


def subprogram_files(text: str, folder: Path) -> dict[str, str]:
    """Return the texts of the subprograms that a program calls and that lie in files beside it, by their names.

    Args:
        text: of the program.
        folder: of its file. A name is never looked for in another folder.

    Raises:
        InputError: a file that is too long, or a link that leaves the folder.
    """
    texts: dict[str, str] = {}
    missing = _called_names(text)
    looked_for: set[str] = set()
    while missing and len(texts) < _MOST_FILES:
        name = missing.pop()
        looked_for.add(name)
        file = _file(name, folder)
        if file is None:
            continue
        texts[name] = read_text(file, errors="replace")
        missing |= _called_names(texts[name]) - looked_for
    return dict(sorted(texts.items()))


def _called_names(text: str) -> set[str]:
    """Return the names that O words call and the numbers that M98 and G65 do."""
    if "98" not in text and "65" not in text and "call" not in text.lower():
        return set()
    names = {"".join(match).strip().lower() for match in _CALL.findall(_COMMENT.sub("", text))}
    # FANUC puts the repetitions before the number
    return names | {name[-_LONGEST_NUMBER:].lstrip("0") or "0" for name in names if name.isdigit()}


def _file(name: str, folder: Path) -> Path | None:
    if Path(name).name != name:
        return None
    # a number is written as a file's name with or without its zeros
    names = (name, str(int(name)), f"{int(name):04}", f"O{int(name):04}") if name.isdigit() else (name,)
    for file_name in names:
        for suffix in _SUFFIXES:
            file = folder / f"{file_name}{suffix}"
            if file.is_file():
                check_inside(file, folder)
                return file
    return None


class JobSource(NamedTuple):
    """The content of a job's file.

    Attributes:
        content: values by section.
        folder: from which its relative paths start.
        label: of the job in messages.
        dialect: what its program file was recognised as, by its content; None where suffix or caller decides.
    """

    content: dict[str, Any]
    folder: Path
    label: str
    dialect: Recognised | None = None


def builtin_jobs() -> list[str]:
    """Return the names of the built-in jobs."""
    return list(_builtin_names())


@cache
def _builtin_names() -> tuple[str, ...]:
    names = (item.name for item in files("gantrysim.jobs").iterdir())
    return tuple(sorted(Path(name).stem for name in names if name.endswith(".toml")))


def job_text(name: str) -> str:
    """Return the TOML of a built-in job."""
    return (files("gantrysim.jobs") / f"{name}.toml").read_text(encoding="utf-8")


def read_job(job: str, controller: str | None = None, *, allow_code: bool = False) -> JobSource:
    """Return the content of a job.

    Args:
        job: name of a built-in job, path of a TOML file, or path of a program file.
        controller: that reads the program file, by default the one of the file's suffix; G-code in a file whose suffix
            several controls share is recognised by its content.
        allow_code: whether a controller of the user's own that the job names may be imported; one that `controller`
            names always may.

    Raises:
        InputError: an unknown job, a file that cannot be read, or one that no controller reads.
    """
    if job in builtin_jobs():
        if controller is not None:
            raise _own_program(job, controller)
        return JobSource(tomllib.loads(job_text(job)), Path(), f"job {job}")
    if not job:
        raise unknown("job", job, builtin_jobs())
    path = expanded_path(job)
    if not path.exists():
        check_whole(path.parent, f"job {job}")
    # it may be in place now
    if not path.exists():
        if path.suffix:
            raise InputError(f"job {job}: no such file; built-in jobs: {', '.join(builtin_jobs())}")
        raise unknown("job", job, builtin_jobs())
    # before its content is looked at
    check_regular(path, f"job {job}")
    if controller is not None:
        controller = absolute_code(controller, Path())
    if _is_program(path, controller):
        name = re.sub(r"[^\w .+-]", "_", path.stem) or "program"
        table, dialect = _program({"file": path.name}, path.parent, controller, allow_code=allow_code)
        return JobSource({"name": name, **table}, path.parent, job, dialect)
    content = read_toml(path, f"job {job}")
    folder = path.parent
    dialect = None
    program = content.get("program")
    if isinstance(program, dict) and "controller" in program:
        program["controller"] = absolute_value(CONTROLLER, program["controller"], folder)
    if isinstance(program, dict) and "file" in program:
        table, dialect = _program(program, folder, controller, allow_code=allow_code)
        content |= table
    elif controller is not None:
        raise _own_program(job, controller)
    return JobSource(content, folder, f"job {job}", dialect)


def _own_program(job: str, controller: str) -> InputError:
    return InputError(f"--controller {controller}: job {job} has a program of its own; it is for program files")


def _is_program(path: Path, controller: str | None) -> bool:
    """Return whether a file is a program and not a job in TOML.

    Raises:
        InputError: a file that is neither.
    """
    suffix = path.suffix.lower()
    if suffix == ".toml":
        return False
    if suffix in suffixes() or controller is not None:
        return True
    try:
        text = read_text(path, errors="replace")
    except OSError:
        # read again as a job, which raises with its label
        return False
    if is_gcode(text):
        return True
    try:
        tomllib.loads(text)
    except (ValueError, RecursionError):
        if suffix:
            raise InputError(
                f"{path}: is neither a job in TOML nor G-code, and {suffix} is not a suffix of a program file: "
                f"{', '.join(suffixes())}; --controller NAME reads it as a program"
            ) from None
    return False


def _program(
    table: Mapping[str, Any], folder: Path, controller: str | None, *, allow_code: bool
) -> tuple[dict[str, Any], Recognised | None]:
    """Return the program's table with the text of its file, and the file's name for messages; and its dialect."""
    file = table["file"]
    if not isinstance(file, str):
        raise InputError(f"program.file = {file!r:.60}: must be the path of a program file")
    path = folder / expanded_path(file)
    named = controller if controller is not None else table.get("controller")
    try:
        text = read_text(path, errors="replace")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    arguments = {key: value for key, value in table.items() if key != "file"}
    dialect = None
    if is_code(named) and controller is None and not allow_code:
        name = named
        # the class may have another, but must not be looked at
        text_argument = Controller.text_argument
    else:
        suffix = path.suffix.lower()
        if named is None and (suffix in SHARED_SUFFIXES or suffix not in suffixes()) and is_gcode(text):
            dialect = recognised_dialect(text)
        name = reader(path.suffix, named) if dialect is None else dialect.controller
        text_argument = program_class(name).text_argument
        if text_argument in arguments:
            raise InputError(f"program.file = {file!r:.60} and program.{text_argument}: must be one of the two")
        text = program_class(name).with_files(text, path.parent)
        if dialect is not None and suffix in suffixes() and name == reader(suffix):
            dialect = None  # as the suffix has it
    if name in (LINUXCNC, FANUC) and "subprograms" not in arguments:
        beside = subprogram_files(text, path.parent)
        if beside:
            arguments["subprograms"] = beside
    shown = file.encode("utf-8", "surrogateescape").decode("utf-8", "replace")  # a name need not be text
    return {"program": {**arguments, "controller": name, text_argument: text}, "source": shown}, dialect


def servo_table(file: Path) -> dict[str, Any]:
    """Return the table [servo] of a TOML file, with keys and types checked."""
    label = f"servo {file}"
    content = read_toml(expanded_path(file), label)
    table = content.get("servo")
    if not isinstance(table, dict):
        raise InputError(f"{label}: has no table [servo]; it has: {', '.join(content) or 'nothing'}")
    validated_model(ServoSettings, table, label, listed=LIST_OF_KEYS)
    return table


class Recognised(NamedTuple):
    """The dialect of a text.

    Attributes:
        controller: that reads it.
        reason: in words, as of "as it begins with an O number".
    """

    controller: str
    reason: str


def is_gcode(text: str) -> bool:
    """Return whether most lines of a text, without comments, are blocks of G-code, and one of them a motion."""
    lines = [line for line in _COMMENT.sub("", text[:_LOOKED_AT]).splitlines() if line.strip()]
    blocks = [line for line in lines if _BLOCK.match(line)]
    return len(blocks) > _LEAST_SHARE * len(lines) and any(_MOTION.search(line) for line in blocks)


def recognised_dialect(text: str) -> Recognised:
    """Return the dialect of a text of G-code."""
    head = _COMMENT.sub("", text[:_LOOKED_AT])
    code = [line for line in head.splitlines() if line.strip() and not line.strip().startswith("%")]
    if code and _O_NUMBER.match(code[0]):
        return Recognised(FANUC, "it begins with an O number")
    if _FANUC_WORDS.search(head):
        return Recognised(FANUC, "it has WHILE, IF or GOTO without O words")
    if _FANUC_CODES.search(head):
        return Recognised(FANUC, "it has words of FANUC's alone, as G65, G68, G51.1 or ,R")
    if _EXTRUDING_MOVE.search(head):
        return Recognised(SLICER, "its moves feed material by E")
    if _FIRMWARE.search(head):
        return Recognised(SLICER, "it has codes of printers' firmware")
    return Recognised(LINUXCNC, "it has no O number and feeds no material by E")
