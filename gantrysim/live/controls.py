"""Values of a job that the workbench changes: the controls of its page, with their bounds and present values."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

from gantrysim.base.errors import InputError, between, unknown
from gantrysim.job.job import Job
from gantrysim.job.key_list import controller_keys, sections
from gantrysim.job.overrides import known_keys
from gantrysim.job.programs import PROGRAMS
from gantrysim.job.settings import has_loop_gains
from gantrysim.machine.machine import builtin_models
from gantrysim.servo.laws import ADDITIONS, BASES

OVERRIDE = "override"  # of the programmed speed: no key of the job [%]
LAW = "servo.law"
MACHINE = "machine"
_OVERRIDES = (10.0, 300.0)  # of the programmed speed [%]


class _Kind(NamedTuple):
    """A number that may be changed.

    Attributes:
        key: full and dotted, of a job file.
        group: under which the page lists it.
        label: in a word or two.
        unit: of the value in the job file.
        low, high: bounds of the slider; of a value with `is_ratio`, as factors of the job's own value.
        is_ratio: whether the slider is logarithmic, about the job's own value.
        default: where the slider stands while the job has no value, or zero under a logarithmic slider.
    """

    key: str
    group: str
    label: str
    unit: str
    low: float
    high: float
    is_ratio: bool = False
    default: float = 0.0


_RATIO = (0.1, 10.0)
_PROGRAM = "program"
_SERVO = "servo"
_GLUE = "glue"
_PLACEMENT = "placement"
_MACHINE = "machine"
_GROUPS = (_PROGRAM, _SERVO, _GLUE, _PLACEMENT, _MACHINE)  # in the order of the page

_KINDS = (
    _Kind("program.acceleration", _PROGRAM, "acceleration", "mm/s²", *_RATIO, is_ratio=True),
    _Kind("program.group.acceleration", _PROGRAM, "acceleration", "mm/s²", *_RATIO, is_ratio=True),
    _Kind("program.initial_acceleration", _PROGRAM, "acceleration", "mm/s²", *_RATIO, is_ratio=True),
    _Kind("program.corner_tolerance", _PROGRAM, "corner tolerance", "mm", 0.0, 1.0),
    _Kind("program.corner_radius", _PROGRAM, "corner radius", "mm", *_RATIO, is_ratio=True),
    _Kind("program.blend_time", _PROGRAM, "blend time", "s", 0.0, 0.1),
    _Kind("program.loop_period", _PROGRAM, "program loop", "s", 0.002, 0.2),
    _Kind("servo.frequency", _SERVO, "frequency", "Hz", 0.25, 4.0, is_ratio=True),
    _Kind("servo.damping", _SERVO, "damping ratio", "", 0.2, 2.0, default=1.0),
    _Kind("servo.integral_time", _SERVO, "integral time", "s", *_RATIO, is_ratio=True, default=0.03),
    _Kind("servo.period", _SERVO, "servo period", "s", 0.25, 4.0, is_ratio=True),
    _Kind("dispenser.flow", _GLUE, "flow", "mm³/s", *_RATIO, is_ratio=True),
    _Kind("dispenser.area", _GLUE, "cross-section", "mm²", *_RATIO, is_ratio=True),
    _Kind("dispenser.advance", _GLUE, "advance", "s", 0.0, 0.2),
    _Kind("dispenser.start_lead", _GLUE, "start lead", "s", 0.0, 0.2),
    _Kind("dispenser.stop_lead", _GLUE, "stop lead", "s", 0.0, 0.2),
    _Kind("bead.gap", _GLUE, "needle height", "mm", 0.25, 4.0, is_ratio=True),
    _Kind("program.placement.x", _PLACEMENT, "x", "mm", -200.0, 200.0),
    _Kind("program.placement.y", _PLACEMENT, "y", "mm", -200.0, 200.0),
    _Kind("program.placement.rotate", _PLACEMENT, "rotation", "deg", -180.0, 180.0),
)
_OPTIONAL = {"dispenser.flow", "dispenser.area"}  # shown where the job has them


class Control(NamedTuple):
    """A control of the page.

    Attributes:
        key: of the job, or `OVERRIDE`.
        group: under which the page lists it.
        label: in a word or two.
        unit: of the value.
        meaning: in a few words.
        value: of the job as it is, a number, a name, or names of laws.
        initial: of the job as it was opened, to which it is reset.
        low, high: bounds of a number.
        is_ratio: whether the slider is logarithmic.
        options: names to choose from; empty for a number.
        additions: names of which any may be added to the first.
    """

    key: str
    group: str
    label: str
    unit: str
    meaning: str
    value: Any
    initial: Any
    low: float = 0.0
    high: float = 0.0
    is_ratio: bool = False
    options: tuple[str, ...] = ()
    additions: tuple[str, ...] = ()


def controls_of(job: Job, opened: Job, override: float) -> list[Control]:
    """Return the controls of a job.

    Args:
        job: as it is.
        opened: the same as it was opened, about whose values the sliders reach.
        override: of the programmed speed [%].
    """
    controls = [*_override(opened, override), *_choices(job, opened), *_numbers(job, opened)]
    return sorted(controls, key=lambda control: _GROUPS.index(control.group))


def checked_values(values: Mapping[str, Any], controls: Sequence[Control]) -> dict[str, Any]:
    """Return values that a page sends, by the keys of its controls; None restores the job's own value.

    No other key is admitted, nor a text in place of a number: a page names no code and no file.

    Raises:
        InputError: a key without a control, or a value beyond its bounds.
    """
    by_key = {control.key: control for control in controls}
    checked = {}
    for key, value in values.items():
        if key not in by_key:
            raise unknown("control", key, by_key)
        checked[key] = None if value is None else _checked_value(by_key[key], value)
    return checked


def _checked_value(control: Control, value: Any) -> Any:
    if control.additions:
        if not isinstance(value, list) or not value:
            raise InputError(f"{control.key}: must be a list of names")
        for name, known in zip(value, (control.options, *[control.additions] * (len(value) - 1)), strict=True):
            _check_name(control.key, name, known)
        return list(dict.fromkeys(value))
    if control.options:
        _check_name(control.key, value, control.options)
        return value
    return between(control.key, value, control.low, control.high, control.unit)


def _check_name(key: str, name: Any, known: Sequence[str]) -> None:
    if name not in known:
        raise unknown(key, str(name), known)


def _choices(job: Job, opened: Job) -> Iterator[Control]:
    machines = tuple(dict.fromkeys([opened.machine, *builtin_models()]))
    yield Control(MACHINE, _MACHINE, "machine", "", "", job.machine, opened.machine, options=machines)
    law = [job.servo.law] if isinstance(job.servo.law, str) else list(job.servo.law)
    initial = [opened.servo.law] if isinstance(opened.servo.law, str) else list(opened.servo.law)
    # a law of the user's own is not chosen here
    if initial[0] in BASES and set(initial[1:]) <= set(ADDITIONS):
        yield Control(
            LAW, _SERVO, "law", "", "law of the servo", law, initial, options=tuple(BASES), additions=tuple(ADDITIONS)
        )


def _override(opened: Job, override: float) -> Iterator[Control]:
    try:
        speed = opened.controller.programmed_speed
    except InputError:
        return
    meaning = f"of the programmed speed, {speed:.4g} mm/s"
    yield Control(OVERRIDE, _PROGRAM, "speed override", "%", meaning, override, 100.0, *_OVERRIDES, is_ratio=True)


def _numbers(job: Job, opened: Job) -> Iterator[Control]:
    known = set(known_keys(opened.model_dump(exclude_none=True), allow_code=False))
    contents = [(a_job, a_job.model_dump()) for a_job in (opened, job)]
    meanings = _meanings(opened.program["controller"])
    for kind in _KINDS:
        if kind.key not in known:
            continue
        initial, value = (_number(a_job, content, kind) for a_job, content in contents)
        if initial is None or value is None or (kind.key in _OPTIONAL and initial <= 0):
            continue
        if kind.key == "servo.frequency" and has_loop_gains(opened.servo.model_dump(exclude_none=True)):
            continue
        low = kind.low * initial if kind.is_ratio else min(kind.low, initial)
        high = kind.high * initial if kind.is_ratio else max(kind.high, initial)
        if kind.group == _PLACEMENT:
            low = initial + kind.low
            high = initial + kind.high
        yield Control(
            kind.key,
            kind.group,
            kind.label,
            kind.unit,
            meanings.get(kind.key, ""),
            value,
            initial,
            float(f"{low:.12g}"),
            float(f"{high:.12g}"),
            kind.is_ratio,
        )


def _number(job: Job, content: Mapping[str, Any], kind: _Kind) -> float | None:
    """Return the value of a job where it is one number, or what the job derives it as; None where there is none."""
    value: Any = content
    for name in kind.key.split("."):
        value = value.get(name) if isinstance(value, Mapping) else None
    if kind.key == "servo.frequency" and value is None:
        gains = job.built_servo.gains[0]
        value = math.sqrt(gains.kp / job.built_machine.axes[0].inertia) / (2 * math.pi) if gains.kp > 0 else None
    if kind.key == "bead.gap" and value is None:
        value = job.built_machine.gap
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return kind.default or None
    if kind.is_ratio and value <= 0:
        return kind.default or None
    return float(f"{value:.6g}")


@cache
def _meanings(controller: str) -> dict[str, str]:
    """Return the meanings of the keys of a job with a controller."""
    of_program = controller_keys(controller) if controller in PROGRAMS else []
    return {key.name: key.meaning for keys in (*sections().values(), of_program) for key in keys}
