"""What stands in a job file: read with the caller's replacements, checked, changed and written back."""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from collections.abc import Iterable, Mapping
from copy import deepcopy
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

import tomli_w
from pydantic import BaseModel, Field, PrivateAttr, ValidationInfo, field_validator, model_validator

from gantrysim.base.errors import InputError, check_type, expanded_path, short_text, unknown
from gantrysim.base.input_files import validated_model
from gantrysim.base.user_code import is_code
from gantrysim.controllers.controller import Controller
from gantrysim.faults import KINDS, AnyFault, InjectedFault
from gantrysim.glue.bead import BeadSettings
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.job.code import absolute_value, is_trusted, named_code, refusal
from gantrysim.job.loading import Recognised, read_job, servo_table
from gantrysim.job.overrides import (
    LIST_OF_KEYS,
    TABLES,
    Override,
    absolute_machine,
    change,
    known_keys,
    override,
    set_placement,
    settings_of,
)
from gantrysim.job.programs import PROGRAMS, build, program_class, reject_booleans
from gantrysim.job.settings import MACHINE, STRICT, ServoSettings, SimulationSettings, laid_over
from gantrysim.job.tolerance import ToleranceSettings
from gantrysim.machine.geometry import Geometry

# keys of a validation's context
_ALLOW_CODE = "allow_code"  # without it, code may run: the caller names it
_NAME = re.compile(r"\w[\w .+-]*")  # which files and folders can have
_BUILT = "built"  # list of the controller with the program: empty where it is yet to be built


class JobContent(BaseModel):
    """The tables and values of a job file, see `gantrysim.job.job.Job`."""

    model_config = STRICT

    name: str
    machine: str = MACHINE
    travel: dict[str, tuple[float, float]] = {}
    names: dict[str, str] = {}
    program: dict[str, Any]
    servo: ServoSettings = ServoSettings()
    dispenser: Dispenser = Dispenser()
    bead: BeadSettings = BeadSettings()
    simulation: SimulationSettings = SimulationSettings()
    geometry: Geometry | None = None
    tolerance: ToleranceSettings | None = None
    faults: tuple[Annotated[AnyFault, Field(discriminator="kind")], ...] = ()
    source: str | None = None
    _choice: tuple[str, ...] = PrivateAttr(())  # a sentence on what was chosen where nothing was given, or none
    _refusal: str = PrivateAttr("")  # why code that the job names may not run; empty where it may

    @classmethod
    def of_content(
        cls,
        content: dict[str, Any],
        label: str,
        refusal: str = "",
        *,
        is_record: bool = False,
        controller: Controller | None = None,
    ) -> Self:
        """Return the job with the values of a file.

        Args:
            content: of the file.
            label: of the job in messages.
            refusal: why code that the file names may not run; empty where it may. A program whose controller is such
                code is taken as it stands, unchecked.
            is_record: whether the job has run. The code of its controller then does not run here, allowed or not: a
                record is read wherever it lies.
            controller: with the program of the content, where it has been built for another job.

        Raises:
            InputError: an invalid key or value.
        """
        allow_code = not refusal and not is_record
        built = [] if controller is None else [controller]
        context = {_ALLOW_CODE: allow_code, _BUILT: built}
        job = validated_model(cls, content, label, lambda: _keys(content, allow_code=allow_code), context, LIST_OF_KEYS)
        job._refusal = refusal
        # a program may take longer to read than the rest of the job
        if built:
            (job.__dict__["controller"],) = built
        return job

    @model_validator(mode="before")
    @classmethod
    def _reject_booleans(cls, values: Any) -> Any:
        for section, kind in TABLES.items():
            table = values.get(section) if isinstance(values, dict) else None
            if isinstance(table, dict):
                reject_booleans(kind, table, f"{section}.")
        return values

    @field_validator("faults", mode="before")
    @classmethod
    def _check_kinds(cls, value: Any) -> Any:
        if not isinstance(value, list | tuple) or not all(isinstance(table, dict | InjectedFault) for table in value):
            raise InputError(f"faults = {value!r:.60}: must be tables, [[faults]]")
        for n, table in enumerate(value):
            if isinstance(table, dict):
                if "kind" not in table:
                    raise InputError(f"faults.{n}.kind is missing: must be one of {', '.join(KINDS)}")
                if table["kind"] not in KINDS:
                    raise unknown("fault", str(table["kind"]), KINDS)
                reject_booleans(KINDS[table["kind"]], table, f"faults.{n}.")
        return value

    @field_validator("name")
    @classmethod
    def _check_name(cls, value: str) -> str:
        if not _NAME.fullmatch(value):
            raise InputError(
                f"name = {short_text(value)}: must be of letters, digits, spaces and any of _ . + -, and begin with a "
                "letter, a digit or _"
            )
        return value

    @field_validator("program")
    @classmethod
    def _check_program(cls, value: dict[str, Any], info: ValidationInfo) -> dict[str, Any]:
        values = dict(value)
        if "controller" not in values:
            raise InputError(f"program.controller is missing: must be one of {', '.join(PROGRAMS)}")
        name = str(values.pop("controller"))
        if is_code(name) and not (info.context or {}).get(_ALLOW_CODE, True):
            return value
        built: list[Controller] = (info.context or {}).get(_BUILT, [])
        if not built:
            built.append(build(name, values))
        return {"controller": name, **built[0].arguments()}

    def changed(self, values: Mapping[str, Any]) -> Self:
        """Return the job with other values by their full dotted keys, as in {"program.loop_period": 0.01}.

        None removes a key, which restores its default.

        Raises:
            InputError: an invalid key or value.
        """
        check_type("values", values, Mapping, "a mapping of keys to values", 'write {"program.speed": 80.0}')
        content = self.model_dump(exclude_none=True)
        for key, value in values.items():
            change(content, key, value, known_keys(content, allow_code=not self._refusal))
        same_program = not any(key.partition(".")[0] == "program" for key in values)
        return self._with(content, self.__dict__.get("controller") if same_program else None)

    def with_called_files(self) -> Self:
        """Return the job with those subprograms alone that its program calls: the others are nobody's business.

        Raises:
            InputError: a program that its controller refuses.
        """
        texts = self.program.get("subprograms")
        if not texts or is_code(self.program["controller"]):
            return self
        called = self.controller.called_files
        if len(called) == len(texts):
            return self
        return self.changed({"program.subprograms": {name: texts[name] for name in texts if name in called} or None})

    def with_choice(self, note: str) -> Self:
        """Return the job with a first note, on what was chosen for it; a changed job has none."""
        job = self.model_copy()
        job._choice = (note,)
        return job

    def with_given(self, given: Given) -> Self:
        """Return the job with what it was loaded from."""
        return self.model_copy(update={"given": given})

    @cached_property
    def given(self) -> Given | None:
        """What the job was loaded from; None for one that was not loaded, or was changed since."""
        return None

    def with_overrides(self, overrides: Iterable[str] | Mapping[str, Any]) -> Self:
        """Return the job with changed values, as `load` takes them.

        Raises:
            InputError: an invalid key or value.
        """
        content = self.model_dump(exclude_none=True)
        for setting in settings_of(overrides):
            override(content, setting, known_keys(content, allow_code=not self._refusal))
        return self._with(content)

    def _with(self, content: dict[str, Any], controller: Controller | None = None) -> Self:
        return self.of_content(content, f"job {self.name}", self._refusal, controller=controller)

    def check_code(self) -> None:
        """Raise InputError where the job names code of its own that may not run."""
        self.check_law()
        self.check_controller()

    def check_law(self) -> None:
        """Raise InputError where the servo's law is code that may not run."""
        if self._refusal and named_code({"servo": {"law": self.servo.law}}):
            raise InputError(self._refusal)

    def check_controller(self) -> None:
        """Raise InputError where the controller is code that may not run."""
        if self._refusal and named_code({"program": self.program}):
            raise InputError(self._refusal)

    @cached_property
    def controller(self) -> Controller:
        """The motion controller with its program."""
        self.check_controller()
        values = {key: value for key, value in self.program.items() if key != "controller"}
        return build(self.program["controller"], values)

    @property
    def digest(self) -> str:
        """SHA-256 of what `toml` returns, see `content_digest`."""
        return content_digest(tomllib.loads(self.toml()))

    def toml(self) -> str:
        """Return the job as TOML, with every default; a job without travel, names or faults has no table of them."""
        content = self.model_dump(exclude_none=True)
        for key in ("faults", "names", "travel"):
            if not content[key]:
                del content[key]
        return tomli_w.dumps(content, multiline_strings=True)


def _keys(content: Mapping[str, Any], *, allow_code: bool) -> list[str]:
    """Return the dotted keys of a job file with this content, for messages on others."""
    tables = content if isinstance(content.get("program"), dict) else {**content, "program": {}}
    return ["source", *known_keys(dict(tables), allow_code=allow_code)]


def content_digest(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a job file's values, without its machine: that may move, and has a digest of its own."""
    values = {key: value for key, value in content.items() if key != "machine"}
    return hashlib.sha256(json.dumps(values, sort_keys=True, default=str).encode()).hexdigest()


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
