"""Code that a job names, and the question on the terminal whether it may run.

A page cannot be asked: what speaks for it may be what the code's author sent. Whoever started the server can.
"""

from __future__ import annotations

import asyncio
import hashlib
import os
import sys
import tomllib
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, TextIO

from gantrysim.base.errors import InputError
from gantrysim.base.input_files import opened_file
from gantrysim.job.code import CONTROLLER, absolute_value, named_code

_YES = ("y", "yes")


class Code(NamedTuple):
    """Code that a job names: another job, or other code, is asked for anew.

    Attributes:
        job: path of the job's file.
        entries: each after its key, as "servo.law = /home/me/laws.py:pd".
        digests: of the files of code, empty for a module by its name.
    """

    job: str
    entries: tuple[str, ...]
    digests: tuple[str, ...]

    @property
    def question(self) -> str:
        """Of what is asked for, without characters that could move a terminal's cursor."""
        lines = [f"job {self.job}, opened in the workbench, would run code of its own on this machine:"]
        lines += [f"  {entry}" for entry in self.entries]
        plain = ("".join(letter if letter.isprintable() else "?" for letter in line) for line in lines)
        return "\n".join([*plain, "run it? [y/N] "])


def code_of(text: str, path: str) -> Code | None:
    """Return the code that the text of a job file names; None without any, or for a text that is no job.

    Args:
        text: of the file.
        path: of the file, from whose folder relative paths start.
    """
    try:
        content = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError):
        return None
    make_code_absolute(content, Path(path).parent)
    entries = named_code(content)
    return Code(path, entries, tuple(map(_digest, entries))) if entries else None


def make_code_absolute(content: dict[str, Any], folder: Path) -> None:
    """Make the files of code in the content of a job absolute."""
    for key in (CONTROLLER, "servo.law"):
        section, name = key.split(".")
        table = content.get(section)
        if isinstance(table, dict) and name in table:
            table[name] = absolute_value(key, table[name], folder)


def _digest(entry: str) -> str:
    place = entry.partition(" = ")[2].rpartition(":")[0]
    try:
        with opened_file(Path(place)) as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except (OSError, InputError, ValueError):
        return ""


def _drop_typed(keyboard: TextIO) -> None:
    """Drop what was typed before a question: it is no answer."""
    try:
        import termios  # there is none on Windows
    except ImportError:
        return
    with suppress(termios.error):
        termios.tcflush(keyboard.fileno(), termios.TCIFLUSH)


class Terminal:
    """Questions on a terminal, one after the other, while the server goes on."""

    def __init__(self, keyboard: TextIO | None = None, screen: TextIO | None = None) -> None:
        self._keyboard = sys.stdin if keyboard is None else keyboard
        self._screen = sys.stdout if screen is None else screen
        self._lock = asyncio.Lock()

    @property
    def is_interactive(self) -> bool:
        """Whether somebody can answer: a process in the background would be stopped where it reads."""
        if not (self._keyboard.isatty() and self._screen.isatty()):
            return False
        try:
            return os.tcgetpgrp(self._keyboard.fileno()) == os.getpgrp()
        except (AttributeError, OSError):  # Windows; a terminal that does not control this process
            return False

    async def ask(self, question: str) -> bool:
        """Return whether the answer is yes."""
        loop = asyncio.get_running_loop()
        async with self._lock:
            _drop_typed(self._keyboard)
            print(question, end="", file=self._screen, flush=True)
            answer: asyncio.Future[str] = loop.create_future()

            def read() -> None:
                if not answer.done():
                    answer.set_result(self._keyboard.readline())

            loop.add_reader(self._keyboard.fileno(), read)
            try:
                return (await answer).strip().lower() in _YES
            finally:
                loop.remove_reader(self._keyboard.fileno())
