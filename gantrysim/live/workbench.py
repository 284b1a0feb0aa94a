"""The state of the workbench, one for all its tabs: the draft with its history, the latest answer, the proposals."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from gantrysim.base.errors import GantryError, InputError, positive, unknown
from gantrysim.base.input_files import read_toml
from gantrysim.job.loading import builtin_jobs
from gantrysim.live.consent import Code
from gantrysim.live.controls import OVERRIDE, Control, checked_values
from gantrysim.live.draft import Beside, Draft, Request, Task
from gantrysim.live.packing import NOTHING, Parts
from gantrysim.live.store import Saved, Store
from gantrysim.live.worker import Message

_MOST_STEPS = 200  # of the history
_LONGEST_TEXT = 1 << 24  # of a program or job that is edited [characters]
_OUTPUT = "out"  # folder of reports, as of the command
# kinds of messages that a new tab needs
_SHOWN = ("text", "controls", "margins", "proposals", "written", "film", "refused")

AskForCode = Callable[[Code, Callable[[bool], None]], None]
Tell = Callable[[str, dict[str, Any]], None]


class Workbench:
    """The state, changed by what a page asks for and by the worker's messages.

    Args:
        store: of files.
        path: of the job that is opened first.
        ask: sends a request to the worker.
        tell: sends a message to all tabs.
        ask_for_code: asks whether code may run, and calls back with the answer; None where nobody can be asked.

    Attributes:
        head: of the latest result.
        parts: of the viewer's content of the latest result.
        is_stale: whether what is shown is of a former draft.
    """

    def __init__(
        self,
        store: Store,
        path: str,
        ask: Callable[[Request], None],
        tell: Tell,
        ask_for_code: AskForCode | None = None,
    ) -> None:
        self.head: dict[str, Any] = {}
        self.parts: Parts = NOTHING
        self.is_stale = True
        self._store = store
        self._ask = ask
        self._tell = tell
        self._ask_for_code = ask_for_code
        self._answers: dict[Code, bool | None] = {}  # None while it is asked
        self._draft = self._fresh(path)
        self._history: list[Draft] = []
        self._undone: list[Draft] = []
        self._is_dragging = False
        self._kept: Draft | None = None
        self._filmed: Draft | None = None
        self._beside: Beside | None = None
        self._saved: Saved | None = None
        self._toml = ""  # of the latest result's job
        self._number = 0
        self._task: Task | None = None
        self._messages: dict[str, dict[str, Any]] = {}

    @property
    def draft(self) -> Draft:
        """The job as it is being edited."""
        return self._draft

    def state(self) -> dict[str, Any]:
        """Return what a page shows beside the worker's messages."""
        return {
            "jobs": self._store.names(),
            "folder": str(self._store.folder),
            "path": self._draft.path,
            "changed": self._draft != self._fresh(self._draft.path),
            "can_undo": bool(self._history),
            "can_redo": bool(self._undone),
            "kept": self._kept is not None,
            "beside": None if self._beside is None else {**self._beside._asdict(), "name": self._beside.name},
            "filmed": self._filmed == self._draft,
            "saved": "" if self._saved is None else self._saved.file.name,
            "busy": self._task or "",
            "number": self._number,
        }

    def film(self, number: str) -> tuple[Path, str] | None:
        """Return the file and the name of a film that was made; None where it is not the latest one's number."""
        film = self._messages.get("film", {})
        return (Path(film["file"]), film["name"]) if film and str(film["number"]) == number else None

    def messages(self) -> list[tuple[str, dict[str, Any]]]:
        """Return the messages that a new tab needs."""
        return [("state", self.state()), *((kind, self._messages[kind]) for kind in _SHOWN if kind in self._messages)]

    def open(self, path: str) -> None:
        """Open a job or program file, or a built-in job."""
        self._messages.pop("proposals", None)
        self._kept = None
        self._beside = None
        self._change(self._fresh(path))

    def lay_beside(self, path: str) -> None:
        """Show a measured trace, or the record of a run, beside the simulated run."""
        self._beside = Beside(path, version_of(path))
        self._start("show")

    def reload(self) -> None:
        """Take over what stands in the file now, with the page's controls; edits of its text can be undone to."""
        self._change(replace(self._draft, text=None, program=None, version=version_of(self._draft.path)))

    def do(self, order: Mapping[str, Any]) -> None:
        """Do what a page asks for.

        Args:
            order: with the name of what to do under "do", and its values.

        Raises:
            InputError: an order that cannot be done.
        """
        orders: dict[str, Callable[[Mapping[str, Any]], None]] = {
            "open": lambda order: self.open(self._store.path(_text(order, "kind"), _text(order, "name"))),
            "set": self._set,
            "program": lambda order: self._change(replace(self._draft, program=_text(order, "text"))),
            "job": lambda order: self._change(replace(self._draft, text=_text(order, "text"), program=None, values={})),
            "undo": lambda _: self._step(self._history, self._undone),
            "redo": lambda _: self._step(self._undone, self._history),
            "reset": lambda _: self._change(self._fresh(self._draft.path)),
            "keep": self._keep,
            "columns": self._name_columns,
            "apart": lambda _: self._take_away(),
            "improve": lambda _: self._start("improve"),
            "report": lambda _: self._start("report"),
            "film": lambda _: self._start("film"),
            "stop": lambda _: self._start("stop"),
            "try": self._try,
            "save": self._save,
            "unsave": lambda _: self._unsave(),
        }
        name = order.get("do")
        if not isinstance(name, str) or name not in orders:
            raise unknown("order", str(name), orders)
        orders[name](order)

    def receive(self, message: Message) -> None:
        """Take a message of the worker; those of older requests are dropped."""
        if message.number not in (0, self._number):
            return
        if message.kind == "result":
            self.head = {**message.content["head"], "number": message.number}
            self.parts = message.content["parts"]
            self._toml = message.content["toml"]
            self.is_stale = False
            self._messages.pop("refused", None)
            self._tell("result", {})
            return
        if message.kind == "film":
            self._filmed = self._draft
            message = message._replace(content={**message.content, "number": message.number})
        if message.kind == "code":
            message = self._code_refusal(message)
        if message.kind == "done":
            self._task = None
            self._tell("state", self.state())
            return
        if message.kind == "text" and self._messages.get("text") == message.content:
            return
        if message.kind in _SHOWN:
            self._messages[message.kind] = message.content
        self._tell(message.kind, message.content)

    def _fresh(self, path: str) -> Draft:
        return Draft(path, version=0 if path in builtin_jobs() else version_of(path))

    def _change(self, draft: Draft, *, is_step: bool = True) -> None:
        if draft == self._draft and self._task == "show":
            return
        if is_step and draft != self._draft:
            self._history = [*self._history[-_MOST_STEPS:], self._draft]
            self._undone = []
        self._draft = draft
        self._start("show")

    def _start(self, task: Task) -> None:
        self._number += 1
        self._task = None if task == "stop" else task
        if task == "show":
            self.is_stale = True
        for kind in ("refused", "written"):
            self._messages.pop(kind, None)
        folder = self._store.films if task == "film" else self._store.folder / _OUTPUT
        allowed = frozenset(code for code, is_allowed in self._answers.items() if is_allowed)
        self._ask(Request(self._number, task, self._draft, self._kept, str(folder), self._beside, allowed))
        self._tell("state", self.state())

    def _code_refusal(self, message: Message) -> Message:
        """Return the refusal of a job whose code may not run yet, and ask for it where that can be."""
        code = message.content["code"]
        if self._ask_for_code is None:
            reason = (
                "it is asked for on the terminal, and gantrysim live was not started from one: start it in the job's "
                "folder, or with --allow-code for this job"
            )
        elif code in self._answers:
            reason = "is asked for on the terminal" if self._answers[code] is None else "was refused on the terminal"
        else:
            self._answers[code] = None
            self._ask_for_code(code, partial(self._take_consent, code))
            reason = "answer on the terminal that started gantrysim live"
        text = f"job {Path(code.job).name} {message.content['text']}: {reason}"
        content = {"text": text, "line": 0, "word": "", "task": message.content["task"]}
        return message._replace(kind="refused", content=content)

    def _take_consent(self, code: Code, is_allowed: bool) -> None:
        self._answers[code] = is_allowed
        # a job that was opened since goes on
        if self._draft.path == code.job:
            self._start("show")

    def start(self) -> None:
        """Simulate the first job."""
        self._start("show")

    def _set(self, order: Mapping[str, Any]) -> None:
        values = order.get("values")
        if not isinstance(values, dict):
            raise InputError("values: must be a table")
        checked = checked_values(values, self._controls())
        override = checked.pop(OVERRIDE, self._draft.override)
        remaining = {key: value for key, value in ({**self._draft.values, **checked}).items() if value is not None}
        # a drag of a slider is one step
        is_step = not self._is_dragging
        self._is_dragging = bool(order.get("dragging"))
        draft = replace(self._draft, values=remaining, override=100.0 if override is None else override)
        self._change(draft, is_step=is_step)

    def _controls(self) -> list[Control]:
        return [Control(**control) for control in self._messages.get("controls", {}).get("controls", ())]

    def _step(self, source: list[Draft], target: list[Draft]) -> None:
        if not source:
            raise InputError("nothing to undo" if source is self._history else "nothing to redo")
        target.append(self._draft)
        self._draft = source.pop()
        self._start("show")

    def _keep(self, order: Mapping[str, Any]) -> None:
        self._kept = self._draft if order.get("on") else None
        self._start("show")

    def _name_columns(self, order: Mapping[str, Any]) -> None:
        """Take over which columns of the trace are which quantities: as text, never as a file's name."""
        if self._beside is None:
            raise InputError("no trace lies beside the run")
        columns = _text(order, "columns").strip()
        if columns and "=" not in columns:
            raise InputError(f"columns {columns}: must be as in time=t,encoder.x=px")
        period = order.get("period")
        if period is not None:
            period = positive("period", period, "s")
        self._beside = self._beside._replace(columns=columns, period=period)
        self._start("show")

    def _take_away(self) -> None:
        self._beside = None
        self._start("show")

    def _try(self, order: Mapping[str, Any]) -> None:
        proposals = self._messages.get("proposals", {}).get("proposals", [])
        number = order.get("number")
        if not isinstance(number, int) or not 0 <= number < len(proposals):
            raise InputError(f"proposal {number}: there are {len(proposals)}")
        proposal = proposals[number]
        draft = replace(self._draft, values={**self._draft.values, **proposal["values"]})
        if proposal["program"] is not None:
            draft = replace(draft, program=proposal["program"])
        self._change(replace(draft, override=100.0) if proposal["is_whole"] else draft)

    def _save(self, order: Mapping[str, Any]) -> None:
        if self.is_stale or not self._toml:
            raise InputError("save: the job is not simulated yet, or is refused")
        self._saved = self._store.save(_text(order, "name"), self._toml)
        self._tell("state", self.state())

    def _unsave(self) -> None:
        if self._saved is None:
            raise InputError("nothing was saved")
        self._store.restore(self._saved)
        self._saved = None
        self._tell("state", self.state())


def version_of(path: str) -> int:
    """Return a number that changes with a file, and with the program file that a job file names; 0 where it is gone."""
    version = 0
    for file in (Path(path), *_program_files(Path(path))):
        try:
            status = file.stat()
        except OSError:
            return 0
        version += status.st_mtime_ns + status.st_size
    return version


def _program_files(file: Path) -> tuple[Path, ...]:
    """Return the program file that a job file names; nothing for another file, or while it is being written."""
    if file.suffix.lower() != ".toml":
        return ()
    try:
        named = read_toml(file, file.name)["program"]["file"]
    except (GantryError, OSError, KeyError, TypeError):
        return ()
    return (file.parent / named,) if isinstance(named, str) else ()


def _text(order: Mapping[str, Any], name: str) -> str:
    value = order.get(name)
    if not isinstance(value, str) or len(value) > _LONGEST_TEXT:
        raise InputError(f"{name}: must be a text of at most {_LONGEST_TEXT:,} characters")
    return value
