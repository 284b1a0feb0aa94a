"""Content of a job to be loaded: its file, with the caller's replacements."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any, NamedTuple

from gantrysim.base.errors import InputError, expanded_path
from gantrysim.job.code import absolute_value, is_trusted, named_code, refusal
from gantrysim.job.loading import read_job, servo_table
from gantrysim.job.overrides import Override, absolute_machine, change, known_keys, override, set_placement
from gantrysim.job.programs import program_class
from gantrysim.job.recognition import Recognised
from gantrysim.job.settings import laid_over


class Request(NamedTuple):
    """Arguments of `Job.load`, which describes them."""

    job: str
    overrides: tuple[Override, ...] = ()
    machine: str | None = None
    servo: Path | None = None
    controller: str | None = None
    placement: Mapping[str, float] | None = None
    allow_code: bool = False


class Reading(NamedTuple):
    """A job that was read.

    Attributes:
        content: values by section, paths of files made absolute.
        label: of the job in messages.
        refusal: why the code that it names may not run unless the caller allows it; empty where it may.
        dialect: what its program file was recognised as, by its content; None where suffix or caller decides.
        file: the content without the caller's replacements.
    """

    content: dict[str, Any]
    label: str
    refusal: str
    dialect: Recognised | None
    file: dict[str, Any]


class _Author(NamedTuple):
    """A file that names code.

    Attributes:
        file: the file.
        label: of the file in messages.
        code: that it names, as `named_code` returns it.
    """

    file: Path
    label: str
    code: tuple[str, ...]


def read_with_overrides(request: Request) -> Reading:
    """Read a job and replace values in it; no code runs that may not.

    Raises:
        InputError: an unknown job, or an invalid key or value.
    """
    job = request.job
    file = expanded_path(job)
    allow_code = request.allow_code or is_trusted(file)
    content, folder, label, dialect = read_job(job, request.controller, allow_code=allow_code)
    for section in ("program", "servo", "dispenser", "bead", "simulation", "geometry"):
        if not isinstance(content.get(section, {}), dict):
            raise InputError(f"job {job}: {section} = {content[section]!r:.60}: must be a table, [{section}]")
    alone = _without_options(content, folder)
    program = content.get("program", {})
    # a controller that the caller names is code of the caller's own
    jobs_program = program if request.controller is None else {}
    _make_law_absolute(content, folder)
    jobs_servo = content.get("servo", {})
    authors = [_Author(file, label, named_code({"program": jobs_program, "servo": jobs_servo}))]
    if request.servo is not None:
        given = {"servo": servo_table(request.servo)}
        _make_law_absolute(given, request.servo.parent)
        content["servo"] = laid_over(jobs_servo, given["servo"])
        if "law" in given["servo"]:
            authors = [_Author(file, label, named_code({"program": jobs_program}))]
        authors.append(_Author(expanded_path(request.servo), f"servo {request.servo}", named_code(given)))
    _override(content, request, authors)
    if request.machine is not None:
        content["machine"] = absolute_machine(request.machine, Path())
    else:
        _make_machine_absolute(content, folder)
    return Reading(content, label, _refusal(content, authors), dialect, alone)


def _without_options(content: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return a copy of the content of a job's file, paths of files made absolute."""
    alone = deepcopy(content)
    _make_law_absolute(alone, folder)
    _make_machine_absolute(alone, folder)
    return alone


def _make_machine_absolute(content: dict[str, Any], folder: Path) -> None:
    if isinstance(content.get("machine"), str):
        content["machine"] = absolute_machine(content["machine"], folder)


def _make_law_absolute(content: dict[str, Any], folder: Path) -> None:
    servo = content.get("servo", {})
    if "law" in servo:
        content["servo"] = {**servo, "law": absolute_value("servo.law", servo["law"], folder)}


def _override(content: dict[str, Any], request: Request, authors: list[_Author]) -> None:
    """Replace values in the content of a job file.

    Raises:
        InputError: an invalid key or value, or a key of a controller whose code may not run.
    """

    def keys() -> list[str]:
        return known_keys(content, allow_code=request.allow_code or not _is_refused(content, authors))

    try:
        if request.placement:
            set_placement(content, request.placement, keys())
        for setting in request.overrides:
            override(content, setting, keys())
    except InputError:
        # the key may be a field of the class that is not looked at
        if not request.allow_code and _is_refused(content, authors):
            raise InputError(_refusal(content, authors)) from None
        raise


def _is_refused(content: dict[str, Any], authors: list[_Author]) -> bool:
    """Return whether the controller's code may not run."""
    controller = named_code({"program": content.get("program")})
    return any(set(controller) & set(author.code) and not is_trusted(author.file) for author in authors)


def _refusal(content: dict[str, Any], authors: list[_Author]) -> str:
    """Return why code that a file names, and that no override has replaced, may not run; empty where it may."""
    present = named_code(content)
    for author in authors:
        reason = refusal(tuple(entry for entry in author.code if entry in present), author.file)
        if reason:
            return f"{author.label} {reason}"
    return ""


# What the caller of `Job.load` gave, before anything was chosen: so that a job can be loaded with further values.


class Given(NamedTuple):
    """What a job was loaded from.

    Attributes:
        file: content of the job's file alone.
        content: the same with the caller's options.
        label: of the job in messages.
        program_file: the program file that was loaded in place of a job file; empty for a job file.
        controller: that the caller named for it; None where suffix or content decided.
        dialect: what the program file was recognised as by its content; None where suffix or caller decides.
        text_key: dotted key of the program's text, where it comes from a program file; empty otherwise.
        speed: of the program's fastest motion that the caller gave; None for the program's own [mm/s].
    """

    file: dict[str, Any]
    content: dict[str, Any]
    label: str
    program_file: str = ""
    controller: str | None = None
    dialect: Recognised | None = None
    text_key: str = ""
    speed: float | None = None

    @classmethod
    def of(cls, read: Reading, request: Request, speed: float | None) -> Given:
        """Return what was given: a job that was read, by a request, at a speed."""
        controller = read.content.get("program", {}).get("controller")
        text_key = ""
        if "source" in read.file and controller is not None:
            text_key = f"program.{program_class(controller).text_argument}"
        # the content of a program file is that of a job file that names it
        program_file = request.job if read.label == request.job else ""
        return cls(read.file, read.content, read.label, program_file, request.controller, read.dialect, text_key, speed)

    def with_values(self, values: Mapping[str, Any], *, in_file: bool) -> dict[str, Any]:
        """Return the content with further values by their full dotted keys.

        Args:
            values: to set.
            in_file: whether they stand in the job's file and no options are given; a text in place of that of a
                program file then begins a new table [program]. Otherwise they are options after the caller's.

        Raises:
            InputError: a key that the job does not have.
        """
        content = deepcopy(self.file if in_file else self.content)
        if in_file and self.text_key in values:
            content["program"] = {"controller": content["program"]["controller"]}
            content.pop("source", None)
        for key, value in values.items():
            change(content, key, value, known_keys(content, allow_code=True))
        return content
