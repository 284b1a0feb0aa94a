"""The command `gantrysim`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import metadata
from typing import Annotated, Any

import typer
from pydantic import ValidationError
from typer.core import TyperGroup

from gantrysim.base import signals
from gantrysim.base.errors import GantryError, InputError, short_text, shortened_message
from gantrysim.base.input_files import one_line
from gantrysim.cli.check import check
from gantrysim.cli.compare import compare
from gantrysim.cli.compile import compile_ahead
from gantrysim.cli.export import export
from gantrysim.cli.gains import gains
from gantrysim.cli.identify import identify_app
from gantrysim.cli.improve import improve
from gantrysim.cli.live import live
from gantrysim.cli.machine import ForJob, describe, machine_app
from gantrysim.cli.options import AllowCode
from gantrysim.cli.render import render as render_command
from gantrysim.cli.replay import replay
from gantrysim.cli.run import run
from gantrysim.cli.show import show_run
from gantrysim.cli.study import study_app
from gantrysim.cli.terminal import INPUT_ERROR, interruptible, show, spell_out, tell_compiling, warn
from gantrysim.cli.tune import tune
from gantrysim.cli.view import view


class _Commands(TyperGroup):
    """The commands; an interrupt ends them with a message and a status, where typer itself has 130 for all.

    Interrupts wait while arguments are read: typer does it with pydantic, which would drop them.
    """

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        for command in _below(self):
            command.make_context = signals.deferred()(command.make_context)
            # typer wraps the lines of a paragraph again
            command.help = "\n\n".join(" ".join(part.split()) for part in (command.help or "").split("\n\n"))

    def make_context(self, *arguments: Any, **named: Any) -> Any:
        with _reported_errors(), signals.deferred():
            return super().make_context(*arguments, **named)

    def invoke(self, ctx: Any) -> Any:
        with _reported_errors(), interruptible():
            return super().invoke(ctx)


def _below(group: Any) -> Iterator[Any]:
    for command in group.commands.values():
        yield command
        if isinstance(command, TyperGroup):
            yield from _below(command)


@contextmanager
def _reported_errors() -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt as interrupt:
        warn(": ".join(["interrupted", *map(str, interrupt.args)]))
        raise typer.Exit(signals.status()) from None


app = typer.Typer(
    cls=_Commands,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Simulate a glue-dispensing gantry; locate the bead's error from program to nozzle, and find its causes.",
)
app.add_typer(study_app, name="study")
app.add_typer(machine_app, name="machine")
app.add_typer(identify_app, name="identify")
app.command()(run)
app.command("show")(show_run)
app.command()(check)
app.command()(improve)
app.command()(tune)
app.command()(gains)
app.command()(export)
app.command()(compare)
app.command()(replay)
app.command("render")(render_command)
app.command()(view)
app.command()(live)
app.command("compile")(compile_ahead)


@app.callback(invoke_without_command=True)
def _main(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    if version:
        typer.echo(metadata.version("gantrysim"))
    elif context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command()
def info(
    name: Annotated[
        str | None,
        typer.Argument(
            help="A machine, job, controller, or key of a job; or machines, jobs, servo, glue, gains, keys."
        ),
    ] = None,
    model: Annotated[
        str | None,
        typer.Option("--machine", "--model", help="Describe this machine alone: built-in, MJCF file or table."),
    ] = None,
    job: ForJob = None,
    allow_code: AllowCode = False,
) -> None:
    """List the built-in machines, jobs and controllers, and what else can be shown.

    With NAME, show one thing, as in gantrysim info an225 or gantrysim info servo.damping, or all of a kind, as in
    gantrysim info machines or gantrysim info gains. With --model, size the drives of one machine.
    """
    if name is not None:
        if model is not None or job is not None:
            raise InputError(f"{short_text(name)}: give either NAME or --model")
        from gantrysim.cli.info import show_name

        show_name(name)
        return
    if model is not None:
        from gantrysim.machine.machine import Machine

        describe(Machine(model), job, allow_code=allow_code)
        return
    if job is not None:
        raise InputError("--job: needs --model")
    from gantrysim.cli.info import overview_table

    show(overview_table())


def main() -> None:
    """Run the command; bad input ends it with one line and exit status 2."""
    signals.forget()
    spell_out()
    tell_compiling()
    if sys.flags.optimize > 1 and {"info", "--help"} & set(sys.argv[1:]):
        warn("descriptions of commands and keys are missing: Python drops them under PYTHONOPTIMIZE=2 and -OO")
    try:
        status = app(standalone_mode=False)
    except (GantryError, typer.TyperException) as error:
        text = error.format_message() if hasattr(error, "format_message") else str(error)
        # the name of an error's class, before the library's own words on a choice
        text = text.replace("Value error, ", "")
        # of a group without its command, whose help has been printed, there is none
        warn(shortened_message(" ".join(text.splitlines())) or "a command is missing", "error")
        status = INPUT_ERROR
    except ValidationError as error:  # a job that a study or an environment makes of its options
        warn(shortened_message(one_line(error)), "error")
        status = INPUT_ERROR
    except OSError as error:
        where = f" ({error.filename})" if error.filename else ""
        warn(f"{error.strerror}{where}", "error")
        status = INPUT_ERROR
    sys.exit(status)
