"""What the worker computes: the run of a draft, first quickly and then by MuJoCo, what to change in it, its report."""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from gantrysim.base.errors import GantryError, InputError
from gantrysim.compare.runs.compared_run import ComparedRun
from gantrysim.compare.runs.compared_runs import ComparedRuns
from gantrysim.compare.runs.overlay_data import OverlayData
from gantrysim.engine.linear import Engine
from gantrysim.glue.bead import Bead
from gantrysim.job.job import Job
from gantrysim.job.loaded import needle_face
from gantrysim.live.beside import Companion
from gantrysim.live.consent import Code
from gantrysim.live.controls import controls_of
from gantrysim.live.draft import Draft, Refusal, Request
from gantrysim.live.packing import NOTHING, Parts
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.remedy.improve import improve
from gantrysim.remedy.improvement import Improvement, values_to_set
from gantrysim.remedy.report import changes_of
from gantrysim.report.encoding import MOST_ROWS
from gantrysim.report.headline import headline
from gantrysim.report.viewer_data import ViewerData
from gantrysim.report.writing import write_report
from gantrysim.results.checks import Row
from gantrysim.results.run_results import RunResults
from gantrysim.results.verdict import Verdict, stability_row

QUICK_ENGINE: Engine = "loop"
WHOLE_ENGINE: Engine = "mujoco"
QUICK_ROWS = 4_000  # of a quick answer
_FILM = "film.mp4"
_SIMULATED = 0.1  # share of a film's time in which its run is simulated
_PACE = 0.05  # between two messages of a task's progress [s]
REST_TIME = 0.15  # without a newer request, after which the whole answer is computed [s]

Send = Callable[[str, dict[str, Any]], None]


class CodeError(InputError):
    """A job names code that nobody has allowed yet."""

    def __init__(self, code: Code) -> None:
        super().__init__(f"would run code of its own, {', '.join(code.entries)}")
        self.code = code


class StaleError(Exception):
    """A newer request has come."""


class Studio:
    """Computes answers to requests, one after the other.

    Args:
        scratch: folder for files of its own.
        allow_code: path of the file whose code may run; empty for none.
    """

    def __init__(self, scratch: Path, allow_code: str = "") -> None:
        self.newest = 0  # number of the newest request, set from another thread
        self.arrived = threading.Event()
        self._scratch = scratch
        self._allow_code = allow_code
        self._opened: tuple[tuple[Any, ...], Job] | None = None
        self._latest: Job | None = None
        self._reference: tuple[Draft, RunResults] | None = None
        self._allowed: frozenset[Code] = frozenset()
        self._companion = Companion()

    def answer(self, request: Request, send: Send) -> None:
        """Compute the answer to a request, and send it in parts.

        Raises:
            StaleError: a newer request has come.
        """
        assert request.draft is not None
        self._allowed = request.allowed

        def go_on(*_: Any) -> None:
            if self.newest != request.number:
                raise StaleError

        try:
            go_on()
            if request.task == "improve":
                self._improve(request.draft, send, go_on)
            elif request.task == "report":
                self._report(request.draft, Path(request.folder), send, go_on)
            elif request.task == "film":
                self._film(request.draft, Path(request.folder), send, go_on)
            else:
                self._show(request, send, go_on)
        except CodeError as error:
            go_on()
            send("code", {"code": error.code, "text": str(error), "task": request.task})
        except GantryError as error:
            go_on()
            send("refused", {**Refusal.of(error)._asdict(), "task": request.task})

    def _open(self, draft: Draft) -> Job:
        code = draft.code()
        # each time, as a change of a value imports code again, which may be another by now
        allow_code = self._allows(draft, code)
        key = (draft.path, draft.text, draft.version, code)
        if self._opened is None or self._opened[0] != key:
            self._opened = (key, draft.opened(self._scratch, allow_code=allow_code))
            self._latest = None
        return self._opened[1]

    def _allows(self, draft: Draft, code: Code | None) -> bool:
        """Return whether the code of a job may run.

        Raises:
            CodeError: it may not unless somebody is asked.
        """
        if draft.path == self._allow_code and draft.text is None:
            return True
        if code is not None and code not in self._allowed:
            raise CodeError(code)
        return code is not None

    def _job(self, draft: Draft, opened: Job | None = None) -> Job:
        if opened is None:
            opened = self._open(draft)
        job = draft.job(opened, self._latest)
        shared = job.sharing(opened if self._latest is None else self._latest)
        self._latest = shared
        return shared

    def _show(self, request: Request, send: Send, go_on: Callable[..., None]) -> None:
        draft = request.draft
        assert draft is not None
        opened = self._open(draft)
        send("text", _texts(draft, opened))
        job = self._job(draft, opened)
        controls = controls_of(job, opened, draft.override)
        send("controls", {"controls": [control._asdict() for control in controls]})
        job.check_program()
        go_on()
        limits = job.limits(needle_face(job.built_machine, job.dispenser.needle))
        send("margins", {"row": _row(stability_row(job, job.margins, limits))})
        self._run(request, job, QUICK_ENGINE, send, go_on)
        self.arrived.clear()
        if self.newest == request.number and not self.arrived.wait(REST_TIME):
            # a full collection, of the whole process, would else take 50 ms of one answer in ten; nobody waits here
            gc.collect()
            # takes a tenth of a quick answer, which has no height map
            job.check_fit()
            self._run(request, job, job.simulation.engine or WHOLE_ENGINE, send, go_on)

    def _run(self, request: Request, job: Job, engine: Engine, send: Send, go_on: Callable[..., None]) -> None:
        run = job.run(_paced_progress("simulate", send, go_on), engine=engine)
        most = QUICK_ROWS if engine == QUICK_ENGINE else MOST_ROWS
        head: dict[str, Any] = {"engine": engine, "name": job.name, "time": float(run.time[-1])}
        if run.fault is not None and not run.dispense.any():
            send("result", {"head": head | _verdict(Verdict.of_fault(run)), "parts": NOTHING, "toml": job.toml()})
            return
        results = _results(job, run)
        go_on()
        reference = None if request.reference is None else self._reference_results(request.reference, go_on)
        runs: tuple[ComparedRun, ...] = ()
        if request.beside is not None:
            laid = self._companion.lay(request.beside, results, reference, anew=engine != QUICK_ENGINE)
            if laid is None:
                return
            runs, head["beside"] = laid
        head |= _verdict(results.verdict) | {"sentence": headline(results)}
        if reference is not None:
            head["kept"] = _verdict(reference.verdict)
        if reference is not None and not runs:
            runs = (ComparedRun.of(reference, "kept"), ComparedRun.of(results, "now"))
        if runs:
            content = OverlayData(ComparedRuns(runs), most, in_space=True).content()
        else:
            content = ViewerData(results, most, flat_in_space=True).content()
        go_on()
        send("result", {"head": head, "parts": Parts.of(content), "toml": job.toml()})

    def _reference_results(self, draft: Draft, go_on: Callable[..., None]) -> RunResults:
        if self._reference is None or self._reference[0] != draft:
            opened = draft.opened(self._scratch, allow_code=self._allows(draft, draft.code()))
            job = draft.job(opened)
            self._reference = (draft, _results(job, job.run(go_on, engine=QUICK_ENGINE)))
        return self._reference[1]

    def _improve(self, draft: Draft, send: Send, go_on: Callable[..., None]) -> None:
        job = self._job(draft)
        job.check_fit()

        def progress(done: int, known: int, name: str) -> None:
            go_on()
            send("progress", {"share": done / max(known, 1), "task": f"improve: {name}, {done} of {known}"})

        improvement = improve(job, fastest=False, by_place=False, progress=progress)
        go_on()
        send("proposals", self._proposals(draft, improvement))

    def _proposals(self, draft: Draft, improvement: Improvement) -> dict[str, Any]:
        """Return the sentence on what to change, and each proposal with the values that it sets."""
        opened = self._open(draft)
        text_key = f"program.{opened.controller.text_argument}"

        def proposal(label: str, cells: Sequence[str], values: Mapping[str, Any], *, is_whole: bool) -> dict[str, Any]:
            others = {key: value for key, value in values.items() if key != text_key}
            return {
                "label": label,
                "usages": list(cells[2:-2]),
                "cost": cells[-1],
                "values": others,
                "program": values.get(text_key),
                "is_whole": is_whole,
            }

        proposals = []
        whole = self._whole_values(draft, opened, improvement)
        if whole is not None:
            cells = improvement.combined_rows[-1]
            proposals.append(
                proposal(improvement.words_of(improvement.combination), (*cells[:-1], "together"), whole, is_whole=True)
            )
        for trial, cells in zip(improvement.trials, improvement.trial_rows, strict=True):
            if not trial.failure:
                label = " ".join(filter(None, cells[:2]))
                proposals.append(proposal(label, cells, trial.changes, is_whole=False))
        return {
            "sentence": improvement.sentence,
            "heads": [row.name for row in improvement.verdict.rows] if not improvement.verdict.unjudged else [],
            "proposals": proposals,
        }

    def _whole_values(self, draft: Draft, opened: Job, improvement: Improvement) -> dict[str, Any] | None:
        """Return the values of the best combination, at the program's own speed; None where nothing is changed."""
        if not improvement.combination:
            return None
        plain = replace(draft, override=100.0, program=None)
        base = dict(draft.values)

        def loaded(changes: Mapping[str, Any]) -> Job:
            return replace(plain, values=base | dict(changes)).job(opened)

        return values_to_set(improvement.job, loaded)

    def _report(self, draft: Draft, folder: Path, send: Send, go_on: Callable[..., None]) -> None:
        job = self._job(draft)
        job.check_fit()

        progress = _paced_progress("report", send, go_on)
        run = job.run(progress)
        page = write_report(job, run, folder / job.name, changes=changes_of, progress=progress)
        send("written", {"folder": str(folder / job.name), "page": "" if page is None else str(page)})

    def _film(self, draft: Draft, folder: Path, send: Send, go_on: Callable[..., None]) -> None:
        job = self._job(draft)
        job.check_fit()

        run = job.run(_paced_progress("film: simulate", send, go_on, (0.0, _SIMULATED)))
        file = folder / _FILM
        folder.mkdir(exist_ok=True)
        run.film(file, progress=_paced_progress("film: draw", send, go_on, (_SIMULATED, 1.0)))
        send("film", {"name": job.name, "file": str(file)})


def _paced_progress(
    task: str, send: Send, go_on: Callable[..., None], part: tuple[float, float] = (0.0, 1.0)
) -> Callable[[float], None]:
    """Return a function of the completed share of a task, which sends it as a part of the whole now and then."""
    first, last = part
    sent = time.monotonic()

    def progress(share: float) -> None:
        nonlocal sent
        go_on()
        now = time.monotonic()
        # each message takes the server and the page half a millisecond of an answer's time
        if now - sent >= _PACE:
            sent = now
            send("progress", {"share": first + (last - first) * share, "task": task})

    return progress


def _results(job: Job, run: Any) -> RunResults:
    analysis = Analysis(run)
    return RunResults(job, job.built_machine, Budget(analysis), Bead(run, job.bead, analysis))


def _row(row: Row) -> dict[str, Any]:
    return {"name": row.name, "state": row.state, "symbol": row.symbol, "texts": list(row.texts)}


def _verdict(verdict: Verdict) -> dict[str, Any]:
    return {"state": verdict.state, "headline": verdict.headline, "rows": [_row(row) for row in verdict.rows]}


def _texts(draft: Draft, opened: Job) -> dict[str, Any]:
    """Return the texts that may be edited: of the program, where it has one, and of the job file."""
    text = opened.program.get(opened.controller.text_argument, "")
    program = draft.program if draft.program is not None else text if isinstance(text, str) and text else None
    return {
        "name": opened.name,
        "file": draft.name,
        "controller": opened.program["controller"],
        "program": program,
        "job": draft.file_text(),
    }
