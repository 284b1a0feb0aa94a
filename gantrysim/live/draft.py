"""A job as it is being edited, and what the worker is asked to do with it."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple

import tomli_w

from gantrysim.base.errors import InputError, expanded_path
from gantrysim.base.files import replaced_file
from gantrysim.base.input_files import read_text
from gantrysim.job.code import is_trusted
from gantrysim.job.job import Job
from gantrysim.job.loading import builtin_jobs, job_text
from gantrysim.job.overrides import absolute_machine
from gantrysim.live.consent import Code, code_of, make_code_absolute

Task = Literal["show", "improve", "report", "film", "stop", "end"]

_LINE = re.compile(r"\bline (\d+)")
_WORD = re.compile(r"['\"]([^'\"\n]{1,40})['\"]|\b([A-Z]-?\d[\d.]*)\b")
_FULL_OVERRIDE = 100.0  # [%]


@dataclass(frozen=True)
class Draft:
    """A job as it is being edited.

    Attributes:
        path: name of a built-in job, or absolute path of a job or program file.
        text: of the job file, where it has been edited; None for what stands in the file.
        program: text of the program, where it has been edited.
        values: changed by controls and proposals, by their dotted keys.
        override: of the programmed speed [%].
        version: of the file on disk, so that a draft of a changed file differs.
    """

    path: str
    text: str | None = None
    program: str | None = None
    values: Mapping[str, Any] = field(default_factory=dict)
    override: float = _FULL_OVERRIDE
    version: int = 0

    @property
    def name(self) -> str:
        """The file's name, or that of a built-in job."""
        return Path(self.path).name

    def opened(self, scratch: Path, *, allow_code: bool) -> Job:
        """Return the job of the file, without the changes of controls.

        Args:
            scratch: folder for an edited job file.
            allow_code: whether code that the job names may run.

        Raises:
            InputError: an invalid job.
        """
        if self.text is None:
            return Job.load(self.path, allow_code=allow_code)
        file = scratch / f"{Path(self.path).stem}.toml"
        with replaced_file(file) as partial:
            partial.write_text(_standing_alone(self.text, self.path), encoding="utf-8")
        try:
            return Job.load(file, allow_code=allow_code)
        except InputError as error:
            raise InputError(str(error).replace(str(file), self.name)) from None

    def code(self) -> Code | None:
        """Return the code that may not run unasked; None where there is none, or the working folder's is unchanged.

        Raises:
            InputError: a job file that cannot be read.
        """
        text = self.file_text()
        if text is None or (self.text is None and is_trusted(expanded_path(self.path))):
            return None
        return code_of(text, self.path)

    def job(self, opened: Job, latest: Job | None = None) -> Job:
        """Return the job with all changes.

        Args:
            opened: as `opened` returns it.
            latest: job of the same file, with which machine and program are shared where they are the same.

        Raises:
            InputError: an invalid value or program.
        """
        values = dict(self.values)
        if self.program is not None:
            values[f"program.{opened.controller.text_argument}"] = self.program
        job = opened.loaded_with(values, sibling=latest) if values else opened
        if self.override == _FULL_OVERRIDE:
            return job
        speed = job.controller.programmed_speed * self.override / _FULL_OVERRIDE
        return opened.loaded_with(values, speed=speed, sibling=latest)

    def file_text(self) -> str | None:
        """Return the text of the job file; None for a program file.

        Raises:
            InputError: it cannot be read.
        """
        if self.text is not None:
            return self.text
        if self.path in builtin_jobs():
            return job_text(self.path)
        file = expanded_path(self.path)
        if file.suffix.lower() != ".toml":
            return None
        try:
            return read_text(file)
        except OSError as error:
            raise InputError(f"{self.name}: cannot be read: {error.strerror}") from None


class Beside(NamedTuple):
    """A measured trace, or the record of a run, beside the simulated runs.

    Attributes:
        path: of the file.
        version: of the file, as another may come under its name.
        columns: which are which quantities, as `--columns` of `gantrysim compare`; empty to tell by their names.
        period: of the samples, for a log without time [s].
    """

    path: str
    version: int = 0
    columns: str = ""
    period: float | None = None

    @property
    def name(self) -> str:
        """The file's name."""
        return Path(self.path).name


class Request(NamedTuple):
    """What the worker is to do; a newer request ends an older one.

    Attributes:
        number: ascending.
        task: "show" its run, "improve" it, write its "report" or "film", "stop", or "end" the process.
        draft: the job; None to stop.
        reference: job with which its run is compared; None for none.
        folder: to write a report or film to.
        beside: what is measured beside it; None for nothing.
        allowed: code that may run, beside that of the job that the command names.
    """

    number: int
    task: Task
    draft: Draft | None = None
    reference: Draft | None = None
    folder: str = ""
    beside: Beside | None = None
    allowed: frozenset[Code] = frozenset()


class Refusal(NamedTuple):
    """Why a job is refused, for the margin of the text.

    Attributes:
        text: the message, as the command has it.
        line: of the text that is edited, 0 where it is not known.
        word: in that line, as the message quotes it; empty where it quotes none.
    """

    text: str
    line: int
    word: str

    @classmethod
    def of(cls, error: BaseException) -> Refusal:
        """Return the refusal of an error."""
        text = str(error)
        line = _LINE.search(text)
        word = _WORD.search(text, line.end() if line else 0)
        return cls(text, int(line[1]) if line else 0, "" if word is None else word[1] or word[2])


def _standing_alone(text: str, path: str) -> str:
    """Return the text of a job file with absolute paths in place of those relative to its folder.

    Raises:
        InputError: no TOML; with the line.
    """
    name = Path(path).name
    try:
        content = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        message = str(error).replace("(at line", "(line") if isinstance(error, ValueError) else "is nested too deeply"
        raise InputError(f"job {name}: is not TOML: {message}") from None
    folder = Path(path).parent
    make_code_absolute(content, folder)
    program = content.get("program")
    if isinstance(content.get("machine"), str):
        content["machine"] = absolute_machine(content["machine"], folder)
    if isinstance(program, dict) and isinstance(program.get("file"), str):
        program["file"] = str(folder / expanded_path(program["file"]))
    return tomli_w.dumps(content)
