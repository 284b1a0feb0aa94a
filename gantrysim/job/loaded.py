"""A job that is loaded from a file, with what its file and its caller leave open chosen for its program."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from gantrysim.base.errors import InputError, TimedError
from gantrysim.base.user_code import is_code
from gantrysim.job.content import JobContent
from gantrysim.job.first_try import OpenValues, choice_note, glue_changes, machine_of
from gantrysim.job.fitting import check_servo_file
from gantrysim.job.given import Given
from gantrysim.job.overrides import settings_of
from gantrysim.job.program_place import fit_changes, share_text
from gantrysim.job.reading import Request, read_with_overrides
from gantrysim.machine.machine import Machine
from gantrysim.machine.travel import travel_edit


class LoadedJob(JobContent):
    """A job with its machine, see `gantrysim.job.job.Job`."""

    @classmethod
    def load(
        cls,
        job: str | os.PathLike[str],
        overrides: Iterable[str] | Mapping[str, Any] = (),
        machine: str | None = None,
        servo: str | os.PathLike[str] | None = None,
        *,
        controller: str | None = None,
        placement: Mapping[str, float] | None = None,
        speed: float | None = None,
        allow_code: bool = False,
    ) -> Self:
        """Return a built-in job, the job in a TOML file, or one that runs a program file.

        A file that names its own code, a law or a controller, is refused unless `allow_code` is true or the file lies
        in the current working folder. Code that the overrides name may run.

        Args:
            job: name of a built-in job, or path.
            overrides: values by their keys, such as {"program.loop_period": 0.002}, None for the default; or texts
                "key=value" with a TOML value. A key is dotted, or its last parts if they are unique.
            machine: machine to use instead of the job's.
            servo: TOML file whose table [servo] replaces the job's, before the overrides.
            controller: controller that reads a program file, such as "fanuc"; by default chosen by the file's suffix.
            placement: placement of the program on the work, attributes of `Placement` by name.
            speed: speed of the program's fastest motion, see `at_speed` [mm/s].
            allow_code: whether code that the job or the servo file names may run, wherever the file lies.

        Raises:
            InputError: an unknown job, an invalid key or value, or code that may not run.
        """
        table = None if servo is None else Path(servo)
        request = Request(str(job), settings_of(overrides), machine, table, controller, placement, allow_code)
        read = read_with_overrides(request)
        if read.refusal and not allow_code:
            raise InputError(read.refusal)
        chosen = cls.of_given(Given.of(read, request, speed), read.content, speed)
        if table is not None:
            check_servo_file(table, chosen.servo, chosen.built_machine)
        return chosen

    @classmethod
    def of_record(cls, file: Path) -> Self:
        """Return the job of a saved run; its own code is refused only if the job is run again."""
        read = read_with_overrides(Request(str(file)))
        return cls.of_content(read.content, read.label, read.refusal, is_record=True)

    @classmethod
    def of_given(cls, given: Given, content: dict[str, Any], speed: float | None) -> Self:
        """Return the job of a content, with a machine, glue and a place for its program where nobody gave any.

        Args:
            given: what the job is loaded from.
            content: of it, with the values that were given.
            speed: of the program's fastest motion; None for its own [mm/s].

        Raises:
            InputError: an invalid key or value.
        """
        job = cls.of_content(content, given.label)
        with job.located():
            job = job.with_called_files()
        if speed is not None:
            job = job.at_speed(speed)
        return job._with_choices(OpenValues.of(content, given.dialect)).with_given(given)

    def loaded_with(self, values: Mapping[str, Any], *, in_file: bool = False, speed: float | None = None) -> Self:
        """Return the job as it is loaded with further values: what nobody gives is chosen again, and may be another.

        A job that was not loaded gives every value itself.

        Args:
            values: by their full dotted keys, after the caller's options.
            in_file: whether the values stand in the job's file, and no options are given.
            speed: of the program's fastest motion, in place of the one that the caller gave [mm/s].

        Raises:
            InputError: an invalid key or value.
        """
        if self.given is None:
            changed = self.changed(values)
            return changed if speed is None else changed.at_speed(speed)
        content = self.given.with_values(values, in_file=in_file)
        if speed is None and not in_file:
            speed = self.given.speed
        return self.of_given(self.given, content, speed)

    def _with_choices(self, open_values: OpenValues) -> Self:
        """Return the job with a machine and glue for its program, where nobody gave any; its first note says so."""
        name = self.program["controller"]
        job = self
        if open_values.machine:
            with self.located():
                job = job.changed({"machine": machine_of(name, job.controller)}).sharing(job)
        if open_values.glue:
            job = job.changed(glue_changes(job, job.built_machine)).sharing(job)
        if not is_code(name):
            changes = fit_changes(job, job.built_machine, job.controller, open_values)
            job = job.changed(changes).sharing(job) if changes else job
        note = choice_note(open_values, job, job.controller, job.built_machine.gap)
        return job.with_choice(note) if note else job

    def at_speed(self, speed: float) -> Self:
        """Return the job with its program at another speed.

        Args:
            speed: speed of the fastest motion; slower motions change in proportion [mm/s].

        Raises:
            InputError: the program states no speed, or the speed is not positive.
        """
        with self.located():
            arguments = self.controller.arguments_at(speed)
        return self.changed({f"program.{key}": _without_noise(value) for key, value in arguments.items()})

    @contextmanager
    def located(self) -> Iterator[None]:
        """Name the program's file, and the line where it is known, in errors that the program causes."""
        try:
            yield
        except InputError as error:
            text = str(error)
            line = None
            if isinstance(error, TimedError):
                line = self.controller.line_at(error.time - self._wait)
            if line is not None:
                text = f"line {line}: {text}"
            if not text.startswith("line "):
                raise
            raise InputError(f"{self.source or 'program'}: {text}") from None

    def sharing(self, other: Self) -> Self:
        """Return the job with machine, controller and servo shared with `other` where both jobs specify the same.

        The servo is shared only if `other` has built it, as it may be refused.
        """
        built: dict[str, Any] = {}
        if all(getattr(self, key) == getattr(other, key) for key in ("machine", "names", "travel", "geometry")):
            built["built_machine"] = other.built_machine
        if self.program == other.program:
            built["controller"] = other.controller
        elif not is_code(self.program["controller"]):
            share_text(self.program, other.program, self.controller, other.controller)
            built["controller"] = self.controller
        if "built_machine" in built and self.servo == other.servo:
            built |= {name: other.__dict__[name] for name in ("built_servo", "margins") if name in other.__dict__}
        return self.model_copy(update=built)

    @cached_property
    def built_machine(self) -> Machine:
        """The compiled machine."""
        machine = Machine(self.machine, self.names)
        if self.travel:
            machine = machine.edited(travel_edit(machine.plain_axes, self.travel))
        return machine if self.geometry is None else machine.with_geometry(self.geometry)

    @property
    def _wait(self) -> float:
        """Time for which the dispenser holds the program back [s]."""
        return 0.0


def _without_noise(value: Any) -> Any:
    """Return a number without the last digits of floating point, so that a speed makes the value that it came from."""
    return float(f"{value:.12g}") if isinstance(value, float) else value
