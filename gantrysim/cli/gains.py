"""The command `gantrysim gains`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gantrysim.base.errors import InputError, expanded_path
from gantrysim.cli.options import AllowCode, JobArgument, Model, ServoFile, Settings
from gantrysim.cli.terminal import say, show, warn

if TYPE_CHECKING:
    from rich.table import Table

    from gantrysim.job.job import Job
    from gantrysim.servo.servo import Servo

_SHAPER = "klipper"

Export = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Write the gains for trio, linuxcnc, linuxcnc-ini, softmc or fanuc, or the input shapers of the "
        "machine's first modes for klipper.",
    ),
]
Source = Annotated[
    tuple[str, Path] | None,
    typer.Option(
        "--from",
        metavar="NAME FILE",
        help="Read the gains of such a file, and write them as a table \\[servo]; from linuxcnc-ini and klipper also "
        "the limits of speed and acceleration.",
    ),
]


def gains(
    job: JobArgument = "an225",
    export: Export = None,
    source: Source = None,
    out: Annotated[Path | None, typer.Option(help="File to write; by default the standard output.")] = None,
    model: Model = None,
    settings: Settings = None,
    servo: ServoFile = None,
    allow_code: AllowCode = False,
) -> None:
    """Show a job's servo gains in the parameters and units of motion controllers; write or read them.

    Without --export or --from, a table lists every controller's parameters, their units, and how they follow from the
    servo's gains. If a controller has no parameter for a gain, notch or law, the export is refused; nothing is dropped
    silently. Settings that are not gains, such as limits, are listed in notes and in the file.

    Exit status: 0, 2 for bad input or a gain for which the controller has no parameter.
    """
    from gantrysim.base.files import replaced_file
    from gantrysim.exchange.gains import DIALECTS, dialect, export_gains
    from gantrysim.exchange.shaper import klipper
    from gantrysim.job.job import Job

    if export is not None and source is not None:
        raise InputError("--export and --from: must be one of them")
    if export is not None and export != _SHAPER:
        dialect(export)
    loaded = Job.load(job, settings or (), model, servo, allow_code=allow_code)
    axes = loaded.built_machine.axes
    if export is None and source is None:
        show(_table(loaded))
        return
    notes: list[str] = []
    if source is not None:
        content, notes = _read(loaded, *source)
    elif export == _SHAPER:
        content, notes = klipper(axes)
    else:
        content, notes = export_gains(str(export), axes, loaded.built_servo)
    if out is None:
        say(content, end="")
    else:
        with replaced_file(out) as partial:
            partial.write_text(content, encoding="utf-8")
        say(f"written to {out}")
    named = source[0] if source is not None else export
    if named in DIALECTS and not any(note.startswith("no gains") for note in notes):
        warn(f"note: assumed of {named}: {DIALECTS[named].assumes}")
    for note in notes:
        warn(f"note: {note}")


def _read(job: Job, name: str, file: Path) -> tuple[str, list[str]]:
    """Return the tables that a controller's file gives a job, and notes."""
    from gantrysim.exchange.dialect import program_lines
    from gantrysim.exchange.gains import dialect, reasons_without_gains, sign_of_velocity_drives
    from gantrysim.exchange.printer_config import PrinterConfig
    from gantrysim.study.tuning.servo import servo_toml

    label = f"--from {name} {file}"
    if name == _SHAPER:
        try:
            config = PrinterConfig.load(expanded_path(file))
            return config.tables([axis.name for axis in job.built_machine.axes], job.built_servo.modes)
        except InputError as error:
            raise InputError(f"--from {name}: {error}") from None
    chosen = dialect(name)
    try:
        text = chosen.file_text(expanded_path(file))
        limits = chosen.limits(text)
    except InputError as error:
        raise InputError(f"--from {name}: {error}") from None
    comments = [f"{limit.in_words()}" for limit in limits]
    if limits and not chosen.has_gains(text):
        head = [f"# Limits of speed and acceleration, from {file.name}.", *(f"# {comment}" for comment in comments)]
        note = "no gains: its drives take positions or steps and close their loops themselves; these are its limits"
        return "\n".join([*head, "", *program_lines(limits)]) + "\n", [note]
    if not chosen.has_gains(text):
        why = reasons_without_gains(name, text, job.built_machine.axes, job.built_servo)
        raise InputError(f"{label}: has neither gains nor limits of speed in a section of a joint or axis{why}")
    axes = job.built_machine.axes
    servo, notes = _labelled_gains(name, text, job, label)
    sign = sign_of_velocity_drives(axes, servo) if job.servo.mode is None and set(servo.modes) == {"torque"} else ""
    if sign:
        job = job.changed({"servo.mode": "velocity"})
        servo, notes = _labelled_gains(name, text, job, label)
        notes.insert(
            0, f"read as gains of velocity drives: {sign}; --set servo.mode='\"torque\"' reads them as torques"
        )
    comments.insert(0, f"Gains in the parameters of {name}, from {file.name}, drives in mode {', '.join(servo.modes)}.")
    return servo_toml(job, servo, comments), notes


def _labelled_gains(name: str, text: str, job: Job, label: str) -> tuple[Servo, list[str]]:
    """Return the servo with the gains of a text, and notes; errors name the file."""
    from gantrysim.exchange.gains import read_gains

    axes = job.built_machine.axes
    servo = job.built_servo
    try:
        return read_gains(name, text, axes, servo, label)
    except InputError as error:
        if str(error).startswith(label):
            raise
        raise InputError(f"{label}: {error}") from None


def _table(job: Job) -> Table:
    from rich.table import Table

    from gantrysim.exchange.dialect import SYMBOLS, AxisServo
    from gantrysim.exchange.gains import DIALECTS, unsaid

    machine = job.built_machine
    axis_servos = AxisServo.of(machine.axes, job.built_servo)
    table = Table(
        title=f"Servo gains of {job.name}, u the unit of the axis", title_justify="left", box=None, padding=(0, 1, 0, 0)
    )
    for heading in ("controller", "parameter", "unit", "from"):
        table.add_column(heading, no_wrap=heading != "from", overflow="fold")
    for axis in axis_servos:
        table.add_column(f"{axis.name}\n\\[{axis.unit}]", justify="right", no_wrap=True)
    table.caption = SYMBOLS
    table.caption_justify = "left"
    for name, chosen in DIALECTS.items():
        try:
            rows = list(zip(*(chosen.words(axis) for axis in axis_servos), strict=True))
        except InputError as error:
            table.add_row(name, "", "", str(error))
            continue
        for k, words in enumerate(rows):
            values = (f"{word.value:.4g}" for word in words)
            table.add_row(name if k == 0 else "", words[0].name, words[0].unit, words[0].formula, *values)
        if lost := unsaid(chosen, axis_servos, job.built_servo):
            table.add_row("", "", "", f"no export: no parameter for {', '.join(lost)}")
        table.add_section()
    return table
