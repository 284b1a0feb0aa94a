"""What the caller of `Job.load` gave, before anything was chosen: so that a job can be loaded with further values."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Any, NamedTuple

from gantrysim.job.overrides import change, known_keys
from gantrysim.job.programs import program_class
from gantrysim.job.reading import Reading, Request
from gantrysim.job.recognition import Recognised


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
