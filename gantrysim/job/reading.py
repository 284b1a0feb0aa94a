"""The content of a job as it is to be loaded: its file, then what the caller replaces in it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from gantrysim.base.errors import InputError, expanded
from gantrysim.job.code import named_code, refusal
from gantrysim.job.loading import read_job, servo_table
from gantrysim.job.overrides import absolute_law, absolute_machine, known_keys, override, place


class Reading(NamedTuple):
    """A job that was read.

    Attributes:
        content: values by section, paths of files made absolute.
        label: of the job in messages.
        refusal: why the code that it names may not run unless the caller allows it; empty where it may.
    """

    content: dict[str, Any]
    label: str
    refusal: str


def read_with_overrides(
    job: str,
    overrides: Iterable[str] = (),
    machine: str | None = None,
    servo: Path | None = None,
    controller: str | None = None,
    placement: Mapping[str, float] | None = None,
) -> Reading:
    """Read a job and replace values in it; see `Job.load` for the arguments.

    Raises:
        InputError: an unknown job, or an invalid key or value.
    """
    content, folder, label = read_job(job, controller)
    for section in ("program", "servo", "dispenser", "bead", "simulation", "geometry"):
        if not isinstance(content.get(section, {}), dict):
            raise InputError(f"job {job}: {section} = {content[section]!r:.60}: must be a table, [{section}]")
    # file that names the law, if any does
    author = expanded(job)
    author_label = label
    if servo is not None:
        content["servo"] = servo_table(servo)
        author = expanded(servo)
        author_label = f"servo {servo}"
    if "law" in content.get("servo", {}):
        beside = folder if servo is None else servo.parent
        content["servo"] = {**content["servo"], "law": absolute_law(content["servo"]["law"], beside)}
    code = named_code(content)
    place(content, placement or {}, known_keys(content))
    for setting in overrides:
        override(content, setting, known_keys(content))
    if machine is not None:
        content["machine"] = absolute_machine(machine, Path())
    elif isinstance(content.get("machine"), str):
        content["machine"] = absolute_machine(content["machine"], folder)
    unasked = tuple(name for name in named_code(content) if name in code)  # an override is the caller's own
    reason = refusal(unasked, author)
    return Reading(content, label, f"{author_label} {reason}" if reason else "")
