"""The record of a run: arrays with one row per servo tick, saved to and loaded from a file, and evaluated.

The rooms that judge and draw a run lie above this one and import it. Loading a record must need nothing of them, nor of
MuJoCo: a saved run is read on machines that only evaluate it. So each is imported where it is first used, as pandas
imports the library that draws its plots. The contracts in pyproject.toml name these imports as exceptions.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.columns import Column, OptionalColumn
from gantrysim.base.display import Shown
from gantrysim.base.errors import InputError, expanded_path, wrong_type
from gantrysim.base.extras import extra
from gantrysim.base.files import replaced_file
from gantrysim.base.input_files import opened_file
from gantrysim.base.progress import Progress
from gantrysim.faults import InjectedFault
from gantrysim.paths.path import Path
from gantrysim.record.named_columns import column, column_names, frame
from gantrysim.record.run_file import Fault

if TYPE_CHECKING:
    import pathlib

    import pandas
    from matplotlib.figure import Figure

    from gantrysim.engine.rig import Rig
    from gantrysim.job.basis import Basis
    from gantrysim.job.job import Job
    from gantrysim.metrics.budget import Budget
    from gantrysim.report.notebook import RunView
    from gantrysim.results.verdict import Verdict


_LONGEST_REASON = 300  # characters of a damaged text


@dataclass(frozen=True, eq=False, repr=False)
class Run(Shown):
    """The record of a run, one row per servo tick, at the time of its sample. All arrays are read-only.

    `run["encoder_x"]` is a column by its name in `columns`, with or without its unit; `len(run)` counts the ticks.
    `verdict`, `budget`, `plot`, `report` and `film` evaluate the run.

    Attributes:
        machine: name of the machine.
        axes: names of the axes.
        units: units of the axes, "mm" or "deg"; u below.
        requested: the requested path, in the work frame.
        period: servo period [s].
        gap: height of the nozzle above the work where its z is 0 [mm].
        time: times of the servo ticks, (n,) [s].
        commanded: setpoints, DPOS, (n, axes) [u].
        encoder: measured positions, MPOS, in whole encoder counts, (n, axes) [u].
        motor: exact positions of the motors, (n, axes) [u].
        commanded_tip, encoder_tip, motor_tip: nozzle positions of a rigid machine at `commanded`, `encoder` and
            `motor`, in the work frame, (n, 3) [mm].
        geometric_tip: nozzle positions of a rigid machine with geometric errors at `motor`, (n, 3) [mm]; None for an
            ideal geometry.
        nozzle: position of the nozzle's tip in the work frame, (n, 3) [mm].
        demand: torque demand of the servo, after limiting, (n, axes) [N·m].
        torque: electromagnetic torque of the motor, (n, axes) [N·m].
        current: motor current, (n, axes) [A]; nan for an ideal torque source.
        voltage: terminal voltage at the tick's torque demand, (n, axes) [V]; nan for an ideal torque source.
        flow: mean flow out of the nozzle over the period after the tick, (n,) [mm³/s]; the volume laid is
            sum(flow[:-1]) * period.
        flow_demand: flow requested by the program over the same period, (n,) [mm³/s].
        dispense: dispenser command, (n,).
        progress: arc length along the requested path for which the command stands, never falling, (n,) [mm]; None where
            the setpoints do not state it.
        extrusion, extruder: material that the program has fed by E, and the position to which pressure advance sends
            the extruder's motor, (n,) [mm]; None as in `Setpoints`.
        analogue: set point of the flow, as the program sets it by an output, (n,); None as in `Setpoints`.
        face: outer diameter of the needle at its tip [mm].
        needle_length: length of the needle [mm].
        fault: the `Fault` that ended the run early, or None.
        injected: deliberate faults.
        job_sha256, machine_sha256: digests of the job, `Job.digest`, and of the machine, `Machine.digest`, saved with
            the record; empty for a record outside an output folder.
        job: the `Job` of the run, from `Job.run` or `SavedRun.load`, else None.
        rig: machine, servo and dispenser of a run from `simulate`, whose verdict, report and film have default
            tolerances; None with a job, and of a loaded or pickled record. Job and rig are not part of the file.
    """

    machine: str
    axes: tuple[str, ...]
    units: tuple[str, ...]
    requested: Path
    period: float
    gap: float
    time: Column[Floats] = Column()
    commanded: Column[Floats] = Column()
    commanded_tip: Column[Floats] = Column()
    encoder: Column[Floats] = Column()
    encoder_tip: Column[Floats] = Column()
    motor: Column[Floats] = Column()
    motor_tip: Column[Floats] = Column()
    nozzle: Column[Floats] = Column()
    demand: Column[Floats] = Column()
    torque: Column[Floats] = Column()
    current: Column[Floats] = Column()
    voltage: Column[Floats] = Column()
    flow: Column[Floats] = Column()
    flow_demand: Column[Floats] = Column()
    dispense: Column[NDArray[np.bool_]] = Column()
    geometric_tip: OptionalColumn[Floats] = OptionalColumn()
    progress: OptionalColumn[Floats] = OptionalColumn()
    extrusion: OptionalColumn[Floats] = OptionalColumn()
    extruder: OptionalColumn[Floats] = OptionalColumn()
    analogue: OptionalColumn[Floats] = OptionalColumn()
    face: float = 0.82  # of the 21 gauge needle of the built-in machines
    needle_length: float = 25.4
    fault: Fault | None = None
    injected: tuple[InjectedFault, ...] = ()
    job_sha256: str = ""
    machine_sha256: str = ""
    job: Job | None = None
    rig: Rig | None = None

    def __post_init__(self) -> None:
        for name, value in list(vars(self).items()):
            if isinstance(value, np.ndarray) and _writable(value):
                # the caller may go on writing to the array
                copied = value.copy()
                copied.flags.writeable = False
                object.__setattr__(self, name, copied)

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the record to a NumPy .npz file, with a SHA-256 of its content, replacing an earlier file at the end.

        Raises:
            InputError: the file cannot be written.
        """
        # with all kinds of paths, which few processes need
        from gantrysim.record.run_file import write_record

        # by path it would add a suffix
        with replaced_file(file) as partial, partial.open("wb") as stream:
            write_record(stream, {k: value for k, value in self._values().items() if k not in ("job", "rig")})

    def replaced(self, **changes: Any) -> Run:
        """Return the record with some fields replaced; columns in temporary files are not read into memory."""
        return Run(**self._values() | changes)

    def _values(self) -> dict[str, Any]:
        """Return the fields by name; columns in temporary files as they are stored."""
        return {field.name: vars(self)[field.name] for field in fields(self)}

    def __getstate__(self) -> dict[str, Any]:
        # without budget and verdict, which are computed again, and without the rig: its machine cannot be pickled
        return self._values() | {"rig": None}

    def __len__(self) -> int:
        return int(vars(self)["time"].shape[0])

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column by its name in `columns`, with or without its unit, (n,), read-only.

        Raises:
            InputError: no column has this name.
        """
        return column(self, name)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns, as in `to_frame`."""
        return column_names(self)

    def __str__(self) -> str:
        facts = [f"{name:8} {text}" for name, text in self.facts().items()]
        return "\n".join([self._verdict_text(), *facts])

    def _verdict_text(self) -> str:
        try:
            return str(self.verdict)
        except InputError as error:  # of a run without glue, or a loaded record
            return f"no verdict: {error}"

    @cached_property
    def budget(self) -> Budget:
        """The `Budget` of the contour error.

        Raises:
            InputError: the dispenser is never on.
        """
        from gantrysim.metrics.budget import Budget

        return Budget(self)

    @cached_property
    def verdict(self) -> Verdict:
        """The `Verdict`: path, glue, stability and machine against the job's tolerances, or default ones.

        Raises:
            InputError: the run has neither a job nor a rig, or its dispenser is never on.
        """
        basis = self.known_basis("verdict")
        from gantrysim.results.verdict import Verdict

        return Verdict.of(basis, self)

    @property
    def known_verdict(self) -> Verdict | None:
        """The verdict; None where nothing can be judged: no glue, no job or rig, or code that may not run."""
        is_judged = self.basis is not None and (self.fault is not None or bool(self.dispense.any()))
        try:
            return self.verdict if is_judged else None
        except InputError:  # a saved job that names code which may not run here: its loops are unknown
            return None

    def plot(self) -> Figure:
        """Return a matplotlib figure: the plan, coloured by the error, beside the error budget.

        Raises:
            InputError: the dispenser is never on.
        """
        from gantrysim.report.plots.plan import overview

        return overview(self.budget)

    def report(
        self,
        folder: str | os.PathLike[str],
        *,
        causes: bool = True,
        improve: bool = True,
        progress: Progress = None,
    ) -> pathlib.Path | None:
        """Write the files of `gantrysim run` without the film into a folder.

        Args:
            folder: to write to; files of an earlier run are replaced.
            causes: whether to run the job again with one cause of error at a time switched off.
            improve: whether to simulate what may improve the two worst rows of a verdict that is no pass.
            progress: as in `simulate`.

        A run without a job has no job.toml, no causes and no changes; the page states that its tolerances are defaults.

        Returns:
            The path of report.html; None for a run that a fault ended before its dispenser was on, which has no page.

        Raises:
            InputError: the run has neither a job nor a rig, or the folder cannot be written.
        """
        basis = self.known_basis("report")
        from gantrysim.remedy.report import changes_of
        from gantrysim.report.writing import write_report

        return write_report(basis, self, folder, causes, changes_of if improve else None, progress)

    def view(self) -> RunView:
        """Return a widget for a notebook: the verdict, and the page's viewer of bead, path, strips and program.

        In Jupyter, VS Code and marimo; the last line of a cell shows it.

        Raises:
            MissingPackageError: anywidget is not installed.
            InputError: the run has neither a job nor a rig, or its dispenser is never on.
        """
        from gantrysim.report.notebook import run_view

        return run_view(self)

    def film(self, file: str | os.PathLike[str], **options: Any) -> int:
        """Write a film of the run, MP4 or GIF, and return its number of frames.

        Args:
            file: to be written.
            options: keywords of `gantrysim.render.save_video`.

        Raises:
            InputError: the run has neither a job nor a rig, or as `gantrysim.render.save_video`.
        """
        expanded_path(file)
        basis = self.known_basis("film")
        from gantrysim.render import save_video

        values: dict[str, Any] = {"bead": basis.bead, "label": basis.name, "verdict": self.known_verdict, **options}
        return save_video(basis.built_machine, self, file, **values)

    @cached_property
    def basis(self) -> Basis | None:
        """What judges the run: its job, or its rig with default tolerances; None for a record without either."""
        if self.job is not None or self.rig is None:
            return self.job
        from gantrysim.job.basis import RigBasis

        return RigBasis(self.rig, self)

    def known_basis(self, name: str) -> Basis:
        """Return `basis`, or raise InputError with what to write before calling the method of this name."""
        if self.basis is None:
            raise InputError(
                f"run.{name}: the record has neither its job nor its machine and servo: write run.replaced(job=job), "
                f"or run.replaced(rig=gantrysim.Rig(machine, servo, dispenser)), with .{name} behind it"
            )
        return self.basis

    def to_frame(self) -> pandas.DataFrame:
        """Return a pandas DataFrame with a row per servo tick; `attrs` describe the run.

        See `gantrysim.record.named_columns`.

        Raises:
            InputError: pandas is not installed.
        """
        return frame(self)

    def _repr_html_(self) -> str:
        return self._html

    @cached_property
    def _html(self) -> str:
        from gantrysim.report.run_html import run_html

        return run_html(self, super()._repr_html_())

    def facts(self) -> dict[str, str]:
        return {
            "machine": self.machine,
            "axes": ", ".join(f"{axis} [{unit}]" for axis, unit in zip(self.axes, self.units, strict=True)),
            "ticks": f"{len(self.time)} of {1e3 * self.period:g} ms",
            "path": f"{self.requested.length:.4g} mm",
            "fault": "none" if self.fault is None else str(self.fault),
        }

    @classmethod
    def load(cls, file: str | os.PathLike[str]) -> Run:
        """Read a record written by `save`.

        Members, types and shapes are checked before they are read, then the SHA-256, then that all numbers are finite
        and all times are multiples of the period.

        Raises:
            InputError: a missing or damaged file, or one that is not a record in the current format.
        """
        from gantrysim.record.run_file import read_record

        if not isinstance(file, str | os.PathLike):
            raise wrong_type("file", file, "a path, as text or pathlib.Path")
        try:
            with opened_file(expanded_path(file)) as stream:
                return cls(**read_record(stream))
        except (OSError, InputError) as error:
            reason = str(error.strerror if isinstance(error, OSError) else error)[:_LONGEST_REASON]
            raise InputError(f"run {file}: is not a record of a run, or is damaged: {reason}") from None


def _writable(array: NDArray[Any]) -> bool:
    """Return whether the memory of an array can be written to through it or through the array that it is a view of."""
    memory = array.base if isinstance(array.base, np.ndarray) else array
    return bool(array.flags.writeable or memory.flags.writeable or not memory.flags.owndata)


def check_run(value: Any) -> None:
    """Raise InputError for anything but a run, with what to write instead of a file, a folder or a job."""
    if isinstance(value, Run):
        return
    advice = "gantrysim.simulate(machine, servo, setpoints) and gantrysim.Job.load(file).run() return one"
    if isinstance(value, str | os.PathLike):
        advice = "a record is read by gantrysim.Run.load"
    elif not isinstance(value, type) and callable(getattr(value, "run", None)):  # a job
        advice = "write .run() behind it"
    raise wrong_type("run", value, "a Run", advice)


class Runs(list[Run]):
    """The records of several runs: a list with a table of their figures."""

    def to_frame(self) -> pandas.DataFrame:
        """Return a pandas DataFrame with a row per run, in order: its `gantrysim.figures`.

        Raises:
            InputError: pandas is not installed.
        """
        # before the figures, which take longer
        with extra("tables", "Runs.to_frame"):
            import pandas
        from gantrysim.study.cases import figures

        return pandas.DataFrame([figures(run) for run in self])
