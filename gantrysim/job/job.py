"""A job: program, machine, servo and dispenser in one file that says all there is to say of a run."""

from __future__ import annotations

import math
import os
import tomllib
from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

import tomli_w
from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model, field_validator

from gantrysim.bead import BeadSettings
from gantrysim.controllers.programs import Controller, arguments, build, dotted, keys
from gantrysim.controllers.servo import DERIVED, FOLLOWING_ERROR_LIMIT, Parameter, Servo
from gantrysim.controllers.setpoints import Setpoints
from gantrysim.engine.simulate import perfect_follower, simulate
from gantrysim.errors import InputError, at_least, unknown
from gantrysim.job.overrides import change, machine_in_full, override
from gantrysim.machine.dispenser import Dispenser
from gantrysim.machine.machine import Machine
from gantrysim.run import Run

_STRICT = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=True)

PerAxis = float | list[float] | None


def _setting(default: Any, description: str) -> Any:
    return Field(default=default, description=description)


class _Derivation(BaseModel):
    model_config = _STRICT

    period: float = _setting(1e-3, "servo period [s]")
    frequency: float | None = _setting(
        None, "natural frequency of the loop, by default what the lags leave room for [Hz]"
    )
    damping: float = _setting(1.0, "damping ratio of the loop")
    feedforward: float = _setting(1.0, "share of the computed velocity and acceleration feed-forward")
    integral_time: float = _setting(math.inf, "kp / ki; inf for no integral term [s]")
    following_error_limit: float = _setting(FOLLOWING_ERROR_LIMIT, "error at which the drives are disabled [mm or deg]")
    delay: float = _setting(0.0, "from the encoder's sample to the torque demand [s]")


def _per_axis(parameter: Parameter) -> Any:
    unit = "mm or deg" if parameter.unit == "u" else parameter.unit.replace("u", "mm")
    return PerAxis, _setting(None, f"{parameter.meaning} [{unit}]")


_PER_AXIS: dict[str, Any] = {parameter.name: _per_axis(parameter) for parameter in DERIVED}


class ServoSettings(create_model("_ServoSettings", __base__=_Derivation, **_PER_AXIS)):  # type: ignore[misc]
    """Arguments of `Servo.derive`; one that is given, as a number or a list of one per axis, is not derived."""


class SimulationSettings(BaseModel):
    """Longest physics step, by default the machine's own, and how long the last position is held at the end [s]."""

    model_config = _STRICT

    physics_step: float | None = None
    settle: float = 0.25


class Job(BaseModel):
    """All there is to say of a run; read from TOML, written back with every default spelt out.

    Attributes:
        name: of the job: letters, digits, spaces and any of _ . + -
        machine: a built-in machine, or the path of an MJCF file; a relative one is taken from the folder of
            the job file.
        program: the controller's name as `controller`, and its arguments.
        servo: arguments of `Servo.derive`.
        dispenser: arguments of `Dispenser`.
        bead: how the glue lies, and the grid on which it is looked at, as in `BeadSettings`.
        simulation: physics step and settling time.
    """

    model_config = _STRICT

    name: Annotated[str, Field(pattern=r"^[\w][\w .+-]*$")]
    machine: str = "xy"
    program: dict[str, Any]
    servo: ServoSettings = ServoSettings()
    dispenser: Dispenser = Dispenser()
    bead: BeadSettings = BeadSettings()
    simulation: SimulationSettings = SimulationSettings()

    @field_validator("program")
    @classmethod
    def _known_program(cls, value: dict[str, Any]) -> dict[str, Any]:
        values = dict(value)
        name = str(values.pop("controller", None))
        return {"controller": name, **arguments(build(name, values))}

    @classmethod
    def load(
        cls,
        job: str | os.PathLike[str],
        overrides: Iterable[str] = (),
        machine: str | None = None,
        servo: str | os.PathLike[str] | None = None,
    ) -> Job:
        """Return a built-in job by its name, or the job in a TOML file.

        Args:
            job: name or path.
            overrides: "key=value" with a TOML value; the key is dotted, as in program.loop_period, or its
                last parts alone where they are unique.
            machine: a machine to take instead of the job's.
            servo: a TOML file whose table [servo] is taken instead of the job's, before the overrides.

        Raises:
            InputError: no such job, or a key or value that is not in order.
        """
        text, folder = _read(str(job))
        try:
            content = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise InputError(f"job {job}: is not TOML: {error}") from None
        for section in ("program", "servo", "dispenser", "bead", "simulation"):
            if not isinstance(content.get(section, {}), dict):
                raise InputError(f"job {job}: {section} = {content[section]!r}: must be a table, [{section}]")
        if servo is not None:
            content["servo"] = _servo_table(Path(servo))
        for setting in overrides:
            override(content, setting, _known_keys(content))
        if machine is not None:
            content["machine"] = machine_in_full(machine, Path())
        elif isinstance(content.get("machine"), str):
            content["machine"] = machine_in_full(content["machine"], folder)
        try:
            loaded = cls(**content)
        except ValidationError as error:
            raise InputError(f"job {job}: {one_line(error)}") from None
        if servo is not None:
            loaded._check_axes(Path(servo))
        return loaded

    def _check_axes(self, servo: Path) -> None:
        """See that a servo's file has as many values as the machine has axes."""
        axes = self.built_machine.axis_names
        for name, value in self.servo:
            if isinstance(value, list) and len(value) != len(axes):
                raise InputError(
                    f"servo {servo}: {name} has {len(value)} values: must be one or {len(axes)}, of the axes "
                    f"{', '.join(axes)} of machine {self.built_machine.name}"
                )

    def changed(self, values: Mapping[str, Any]) -> Job:
        """Return the job with other values, by their full dotted keys, as in {"program.loop_period": 0.01}.

        None takes a key away, so that its default holds.

        Raises:
            InputError: a key or value that is not in order.
        """
        content = self.model_dump(exclude_none=True)
        for key, value in values.items():
            change(content, key, value, _known_keys(content))
        try:
            return Job(**content)
        except ValidationError as error:
            raise InputError(f"job {self.name}: {one_line(error)}") from None

    def overridden(self, overrides: Iterable[str]) -> Job:
        """Return the job with values changed by "key=value", as `load` takes them.

        Raises:
            InputError: a key or value that is not in order.
        """
        content = self.model_dump(exclude_none=True)
        for setting in overrides:
            override(content, setting, _known_keys(content))
        try:
            return Job(**content)
        except ValidationError as error:
            raise InputError(f"job {self.name}: {one_line(error)}") from None

    def __deepcopy__(self, memo: dict[int, Any] | None = None) -> Job:
        return self  # it never changes, and a machine that is built cannot be copied

    def __getstate__(self) -> dict[Any, Any]:
        state = super().__getstate__()
        # what is built of it is built again: a compiled machine can be sent nowhere
        return {
            **state,
            "__dict__": {key: value for key, value in self.__dict__.items() if key in type(self).model_fields},
        }

    def toml(self) -> str:
        """Return the job as TOML, with every default spelt out."""
        return tomli_w.dumps(self.model_dump(exclude_none=True), multiline_strings=True)

    @cached_property
    def controller(self) -> Controller:
        """The motion controller with its program."""
        values = {key: value for key, value in self.program.items() if key != "controller"}
        return build(self.program["controller"], values)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the controller has to say of the program."""
        return self.controller.notes

    @cached_property
    def built_machine(self) -> Machine:
        """The machine, compiled."""
        return Machine(self.machine)

    @cached_property
    def built_servo(self) -> Servo:
        """The servo with its gains."""
        return Servo.derive(self.built_machine.axes, **dict(self.servo))

    @cached_property
    def setpoints(self) -> Setpoints:
        """The program's setpoints, with what is waited for the dispenser's start lead and, at the end, the machine."""
        settle = at_least("settle", self.simulation.settle, 0, "s")
        return self.dispenser.held_back(self.controller.setpoints(self.built_servo.period)).hold(settle)

    def run(self, progress: Callable[[float], None] | None = None, machine: Machine | None = None) -> Run:
        """Run the job and return the record.

        Args:
            progress: as in `simulate`.
            machine: to run on instead of the job's own, as one that is `perturbed`; the servo is still that of the
                job's machine.
        """
        return simulate(
            self.built_machine if machine is None else machine,
            self.built_servo,
            self.setpoints,
            physics_step=self.simulation.physics_step,
            dispenser=self.dispenser,
            progress=progress,
        )

    def follow(self) -> Run:
        """Return the record of a machine that does exactly what the job's program commands, see `perfect_follower`."""
        return perfect_follower(self.built_machine, self.setpoints, dispenser=self.dispenser)


def builtin_jobs() -> list[str]:
    """Return the names of the jobs that come with gantrysim."""
    return sorted(Path(item.name).stem for item in files("gantrysim.jobs").iterdir() if item.name.endswith(".toml"))


def job_text(name: str) -> str:
    """Return the TOML of a built-in job."""
    return (files("gantrysim.jobs") / f"{name}.toml").read_text(encoding="utf-8")


def _read(job: str) -> tuple[str, Path]:
    if job in builtin_jobs():
        return job_text(job), Path()
    path = Path(job).expanduser()
    try:
        return path.read_text(encoding="utf-8"), path.parent
    except FileNotFoundError:
        raise unknown("job", job, builtin_jobs()) from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"job {job}: cannot be read: {error}") from None


def _servo_table(file: Path) -> dict[str, Any]:
    """Return the table [servo] of a TOML file, its keys and the kinds of its values checked."""
    try:
        content = tomllib.loads(file.expanduser().read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"servo {file}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"servo {file}: cannot be read: {error}") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"servo {file}: is not TOML: {error}") from None
    table = content.get("servo")
    if not isinstance(table, dict):
        raise InputError(f"servo {file}: has no table [servo]; it has: {', '.join(content) or 'nothing'}")
    try:
        ServoSettings(**table)
    except ValidationError as error:
        raise InputError(f"servo {file}: {one_line(error)}") from None
    return table


def _known_keys(content: dict[str, Any]) -> list[str]:
    sections: dict[str, type[BaseModel]] = {"servo": ServoSettings, "simulation": SimulationSettings}
    known = ["name", "machine", "program.controller"]
    known += [f"{section}.{key}" for section, model in sections.items() for key in model.model_fields]
    known += [f"dispenser.{key}" for key in dotted(Dispenser)] + [f"bead.{key}" for key in dotted(BeadSettings)]
    return known + [f"program.{key}" for key in keys(str(content.get("program", {}).get("controller")))]


def one_line(error: ValidationError) -> str:
    """Return what pydantic finds wrong, in one line."""
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
            text = f"{where} = {item['input']!r}: {item['msg'][:1].lower()}{item['msg'][1:]}"
        problems.setdefault(where or text, text)
    return "; ".join(dict.fromkeys(problems.values()))
