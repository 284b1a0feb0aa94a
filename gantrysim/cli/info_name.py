"""What `gantrysim info NAME` prints: one machine, job, controller or key, or all of a kind."""

from __future__ import annotations

import inspect

from gantrysim.base.errors import InputError, meant, nearest, shown
from gantrysim.cli.info import KINDS, keys_table
from gantrysim.cli.machine import describe
from gantrysim.cli.terminal import say, show
from gantrysim.job.key_list import Key, controller_keys, sections
from gantrysim.job.loading import builtin_jobs, job_text
from gantrysim.job.programs import PROGRAMS
from gantrysim.machine.machine import Machine
from gantrysim.machine.models import builtin_models


def show_name(name: str) -> None:
    """Print what a name stands for: a machine, job or controller, a key in full or its last part, or one of `KINDS`.

    Raises:
        InputError: none of these.
    """
    tables = sections()
    if name in builtin_models():
        describe(Machine(name), None)
    elif name in builtin_jobs():
        say(job_text(name).rstrip())
    elif name in PROGRAMS:
        say((inspect.getdoc(PROGRAMS[name]) or "").split("\n\n")[0], wrap=True)
        show(keys_table(f'keys of [program] with controller = "{name}"', controller_keys(name)))
    elif name in KINDS:
        for table in KINDS[name].tables():
            show(table)
    elif named := _named(name, tables):
        for title, keys in named.items():
            show(keys_table(title.replace("`", ""), keys))
    else:
        raise _unknown_name(name, tables)


def _named(name: str, tables: dict[str, list[Key]]) -> dict[str, list[Key]]:
    """Return the keys of a name in full, or else those that end with it, by their tables."""
    in_full = {title: [key for key in keys if key.name == name] for title, keys in tables.items()}
    ending = {title: [key for key in keys if key.name.endswith(f".{name}")] for title, keys in tables.items()}
    named = in_full if any(in_full.values()) else ending
    return {title: keys for title, keys in named.items() if keys}


def _unknown_name(name: str, tables: dict[str, list[Key]]) -> InputError:
    keys = [key.name for table in tables.values() for key in table]
    question = meant(nearest(name, {*builtin_models(), *builtin_jobs(), *PROGRAMS, *KINDS, *keys}))
    return InputError(
        f"unknown name {shown(name)}: {f'{question} ' if question else ''}"
        "gantrysim info lists machines and jobs, gantrysim info keys all keys"
    )
