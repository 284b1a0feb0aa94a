"""A job with what its file and its caller leave open, chosen for its program; and the same with further values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from gantrysim.base.user_code import is_code
from gantrysim.job.first_try import OpenValues, choice_note, glue_changes, machine_of
from gantrysim.job.given import Given
from gantrysim.job.program_place import fit_changes

if TYPE_CHECKING:
    from gantrysim.job.job import Job


def chosen_job(kind: type[Job], given: Given, content: dict[str, Any], speed: float | None) -> Job:
    """Return the job of a content, with a machine, glue and a place for its program where nobody gave any.

    Args:
        kind: class of the job.
        given: what the job is loaded from.
        content: of it, with the values that were given.
        speed: of the program's fastest motion; None for its own [mm/s].

    Raises:
        InputError: an invalid key or value.
    """
    job = kind.of_content(content, given.label)
    with job.located():
        job = job.with_called_files()
    if speed is not None:
        job = job.at_speed(speed)
    return with_choices(job, OpenValues.of(content, given.dialect)).with_given(given)


def loaded_with(job: Job, values: Mapping[str, Any], *, in_file: bool = False, speed: float | None = None) -> Job:
    """Return a job as it is loaded with further values: what nobody gives is chosen again, and may be another.

    Args:
        job: the job; one that was not loaded gives every value itself.
        values: by their full dotted keys, after the caller's options.
        in_file: whether the values stand in the job's file, and no options are given.
        speed: of the program's fastest motion, in place of the one that the caller gave [mm/s].

    Raises:
        InputError: an invalid key or value.
    """
    given = job.given
    if given is None:
        changed = job.changed(values)
        return changed if speed is None else changed.at_speed(speed)
    content = given.with_values(values, in_file=in_file)
    if speed is None and not in_file:
        speed = given.speed
    return chosen_job(type(job), given, content, speed)


def with_choices(job: Job, open_values: OpenValues) -> Job:
    """Return a job with a machine and glue for its program, where nobody gave any; its first note says so."""
    name = job.program["controller"]
    if open_values.machine:
        with job.located():
            job = job.changed({"machine": machine_of(name, job.controller)}).sharing(job)
    if open_values.glue:
        job = job.changed(glue_changes(job, job.built_machine)).sharing(job)
    if not is_code(name):
        changes = fit_changes(job, job.built_machine, job.controller, open_values)
        job = job.changed(changes).sharing(job) if changes else job
    note = choice_note(open_values, job, job.controller)
    return job.with_choice(note) if note else job
