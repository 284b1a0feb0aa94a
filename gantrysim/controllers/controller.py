"""The base class of the motion controllers: the questions that the rest of the program asks them."""

from __future__ import annotations

import os
import pathlib
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, positive
from gantrysim.controllers.speeds import Stretches
from gantrysim.paths.path import Path
from gantrysim.record.run import Run
from gantrysim.record.setpoints import Setpoints

if TYPE_CHECKING:
    from gantrysim.controllers.loop_theory import LoopTheory


class Controller(ABC):
    """A motion controller with its program: a frozen dataclass, checked on construction.

    The fields of a subclass are the keys of the table [program] in a job file.

    Attributes:
        speed_scaling: description of what `arguments_at` changes.
        commands_axes: whether the setpoints are axis positions of a machine that turns its work, instead of positions
            in the work frame.
        suffixes: suffixes of the program files that the controller reads by default.
        text_argument: name of the argument that takes the content of a program file.
        ramp_arguments: dotted names of the arguments that limit acceleration and jerk; all may be scaled by one factor.
        assumed_acceleration: of a program file whose job states none; 0 where the controller has a default [mm/s²].
        loop_words: regular expression of the words that begin a loop in the program's text, in a language that runs its
            lines while the axes move; empty for any other.
        corner_argument: dotted name of the argument that rounds corners, more strongly the larger it is; None for a
            controller without one.
        flow_output: output of the program that is the set point of the flow; empty for none.
    """

    speed_scaling: ClassVar[str] = "the program's speed"
    commands_axes: ClassVar[bool] = False
    suffixes: ClassVar[tuple[str, ...]] = ()
    text_argument: ClassVar[str] = "text"
    loop_words: ClassVar[str] = ""
    ramp_arguments: ClassVar[tuple[str, ...]] = ()
    assumed_acceleration: ClassVar[float] = 0.0
    corner_argument: ClassVar[str | None] = None
    flow_output: str = ""

    @property
    @abstractmethod
    def requested(self) -> Path:
        """The requested path in the work frame."""

    @property
    def corner_cut(self) -> float:
        """Largest distance of the path from corners that are rounded without a tolerance; 0 without any [mm]."""
        return 0.0

    @property
    @abstractmethod
    def duration(self) -> float:
        """Duration of the motion [s]."""

    @property
    @abstractmethod
    def axes(self) -> tuple[str, ...]:
        """Names of the axes that move."""

    @abstractmethod
    def setpoints(self, period: float) -> Setpoints:
        """Return the commanded positions of the axes at every servo period [s]."""

    @abstractmethod
    def with_speeds(self, change: Callable[[float], float]) -> dict[str, Any]:
        """Return the arguments that contain a speed, by dotted name, with every speed changed.

        Args:
            change: function from a programmed path speed to the new one [mm/s].
        """

    def stretches(self, period: float) -> Stretches:
        """Return the stretches of the requested path to which the program can give a speed of their own.

        Args:
            period: of the servo [s].

        Raises:
            InputError: the program has no way to do that.
        """
        raise InputError(
            f"{type(self).__name__}: states one speed for its whole path, so that none can be set by place"
        )

    def with_stretch_speeds(self, speeds: Mapping[int, float]) -> dict[str, Any]:
        """Return the arguments that must change for stretches to have other speeds, by dotted name.

        Args:
            speeds: programmed path speeds by `Stretches.places`, of all places with a speed [mm/s].

        Raises:
            InputError: the program has no way to do that.
        """
        raise InputError(
            f"{type(self).__name__}: states one speed for its whole path, so that none can be set by place"
        )

    def with_stretch_flows(self, values: Mapping[int, float]) -> dict[str, Any]:
        """Return the arguments that must change for stretches to have other set points of the flow, by dotted name.

        Args:
            values: of `flow_output`, by `Stretches.places`.

        Raises:
            InputError: the program names no such output, or cannot set it where a stretch begins.
        """
        raise InputError(f"{type(self).__name__}: has no output for the flow whose value each stretch can have")

    @property
    def program_text(self) -> str:
        """The program in the controller's language; empty where it has no text."""
        text = getattr(self, self.text_argument, "")
        return text if isinstance(text, str) else ""

    @property
    def program_suffix(self) -> str:
        """Suffix of a file with `program_text`."""
        return self.suffixes[0] if self.suffixes else ".txt"

    @property
    def feeds_material(self) -> bool:
        """Whether the program states the amount of material that it feeds, by E."""
        return False

    @property
    def filament(self) -> float | None:
        """Diameter of the filament that E feeds, as the program states it [mm]; None where it does not, or has no E."""
        return None

    def with_advance(self, time: float) -> dict[str, Any] | None:
        """Return the arguments, by name, that set the pressure advance of the extruder [s].

        Returns:
            None for a program without E, or one that sets its pressure advance itself.
        """
        return None

    @property
    def advance_words(self) -> str:
        """The line that sets the pressure advance in the firmware's words; empty for a controller without E."""
        return ""

    def release(self) -> None:
        """Free the memory of a long program's intermediate results, which are recomputed on demand."""
        return

    @classmethod
    def with_files(cls, content: str, folder: pathlib.Path) -> str:
        """Return the content of a program file together with the files that it names, if the language has such.

        Args:
            content: content of the program file.
            folder: folder of the program file.
        """
        return content

    @property
    def called_files(self) -> frozenset[str]:
        """Names of the files of subprograms that the program has called, of those in `subprograms`."""
        return frozenset()

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on the program before it runs."""
        return ()

    @property
    def dryness(self) -> str:
        """Why the program lays no glue, in words, if it lays none."""
        return (
            "the program has no moves at feed but those straight up or down, or nothing in it switches the valve on, "
            "by the keys of its controller"
        )

    def line_at(self, time: float) -> int | None:
        """Return the line of the program's text that is active at a time [s], None if it is not known."""
        return None

    def lines_at(self, times: Floats) -> NDArray[np.intp]:
        """Return the lines of the program's text that are active at times [s], 0 where it is not known, (n,)."""
        # most controllers know none, and a run has a time for every tick
        if type(self).line_at is Controller.line_at:
            return np.zeros(times.size, np.intp)
        return np.array([self.line_at(time) or 0 for time in times.tolist()], np.intp)

    @classmethod
    def loop_theory(cls, arguments: Mapping[str, Any]) -> LoopTheory | None:
        """Return the closed forms of the errors caused by the program's loop, None for a program without a loop.

        Args:
            arguments: all arguments of the program; the controller may refuse them.
        """
        return None

    def loop_line(self) -> tuple[int, str] | None:
        """Return number and text of the line that begins the first loop in the program's text; None without one.

        The text alone sets the time of its passes: no argument does.
        """
        text = getattr(self, self.text_argument, None)
        if not self.loop_words or not isinstance(text, str):
            return None
        for number, line in enumerate(text.splitlines(), start=1):
            code = line.partition("'")[0]
            if re.search(self.loop_words, code, re.IGNORECASE):
                return number, code.strip()
        return None

    @property
    def free_running(self) -> bool:
        """Whether the program may start between two servo ticks."""
        return False

    @property
    def programmed_speed(self) -> float:
        """The fastest programmed path speed [mm/s].

        Raises:
            InputError: the program states no speed.
        """
        speeds: list[float] = []

        def note(speed: float) -> float:
            speeds.append(speed)
            return speed

        self.with_speeds(note)
        if not speeds:
            raise InputError("program: states no path speed")
        return max(speeds)

    def arguments(self) -> dict[str, Any]:
        """Return the arguments as plain values, omitting those that are None."""
        arguments: dict[str, Any] = _plain(self)
        return arguments

    def arguments_at(self, speed: float) -> dict[str, Any]:
        """Return the arguments that must change for the program to run at another speed, by dotted name.

        They are not checked: the controller may refuse the program at that speed.

        Args:
            speed: speed of the fastest motion; slower motions change in proportion [mm/s].

        Raises:
            InputError: the program states no speed, or the speed is not positive.
        """
        factor = positive("speed", speed, "mm/s") / self.programmed_speed
        return self.with_speeds(lambda programmed: programmed * factor)

    def with_lift(self, height: float) -> dict[str, Any] | None:
        """Return the arguments, by dotted name, that lift the needle during moves without glue.

        Args:
            height: height above the work [mm].

        Returns:
            None for a controller without such an argument, or a program that sets the height itself.
        """
        return None

    def write_record(self, run: Run, file: str | os.PathLike[str]) -> bool:
        """Write the controller's own record of a run, if it keeps one, and return whether it was written."""
        return False


def _plain(value: Any) -> Any:
    """Return dataclasses, dicts and tuples as dicts and lists without what is None; a job's arguments are small."""
    if is_dataclass(value):
        value = {item.name: getattr(value, item.name) for item in fields(value)}
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value
