"""What a law of the servo is: its name, parameters, part of the tick, and effect on the stability of the loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.axis_dynamics import AxisDynamics
from gantrysim.servo.gains import Gains, Parameter
from gantrysim.servo.stability.linear_system import Compensator

# Points of the servo tick at which a law acts, in their order
ERROR = "error"  # after the measurement: changes the error to which the law answers, `row.law_error` and `law_change`
FEEDFORWARD = "feedforward"  # after the base law: adds to `row.feedforward`
DISTURBANCE = "disturbance"  # after all feed-forward, of what the law has measured
DEMAND = "demand"  # after the torque demand is known, `row.torque`

Tick = Callable[[Any, Any], None]  # of the row, and the laws of all axes


class Timing(NamedTuple):
    """When a servo samples and acts.

    Attributes:
        period: servo period T [s].
        delay: from sample to output [s].
        feedback_delay: from the encoder to the servo [servo periods].
    """

    period: float
    delay: float = 0.0
    feedback_delay: int = 0


@dataclass(frozen=True)
class LawDesign:
    """What the parameters of an axis' laws follow from.

    Attributes:
        axis: the axis.
        frequency: natural frequency of its loop [Hz].
        lag: time constant of the torque [s].
        period: servo period [s].
        slowest_swing: returns frequency [Hz] and damping ratio of the closed loop's slowest mode that swings, 0 without
            one; it takes time, and only input shaping needs it.
    """

    axis: AxisDynamics
    frequency: float
    lag: float
    period: float
    slowest_swing: Callable[[], tuple[float, float]]


class Law:
    """A law that is added to a base. Each one is a file with a subclass and its one object, named in `LAWS`.

    Attributes:
        name: as in a job file.
        meaning: in a few words.
        parameters: one value per axis each, 0 where the law is not used.
        state: of one axis in the tick, besides the parameters: names and NumPy types, 0 at the start.
        stages: what the law does at points of the tick. A function of the row and of the laws of all axes, whose fields
            are parameters and state; plain Python that numba can compile.
        answers_to_position: whether the law feeds back the measured position, so that margins depend on it.
        needs_known_base: whether it needs the linear response of the base law, which a user's own law need not have.
        excludes: names of laws that cannot be used beside it.
        same_nozzle_axes: whether the axes must be coordinates of the nozzle.
        inverts_machine: whether it needs the linear motion of the nominal machine, `Laws.motions`.
    """

    name: ClassVar[str]
    meaning: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    state: ClassVar[tuple[tuple[Any, ...], ...]] = ()
    stages: ClassVar[tuple[tuple[str, Tick], ...]] = ()
    answers_to_position: ClassVar[bool] = False
    needs_known_base: ClassVar[bool] = False
    excludes: ClassVar[tuple[str, ...]] = ()
    same_nozzle_axes: ClassVar[bool] = False
    inverts_machine: ClassVar[bool] = False

    def derived(self, design: LawDesign) -> dict[str, float]:
        """Return the parameters of one axis that follow from it and the loop, by name."""
        return {}

    def check(self, values: Mapping[str, Sequence[float]], period: float) -> None:
        """Raise InputError for parameters out of their bounds; each is finite and not negative.

        Frequencies are above 0 and below half the servo's.

        Args:
            values: of the parameters, one per axis each, by name.
            period: servo period [s].
        """
        nyquist = 0.5 / period
        for parameter in self.parameters:
            frequencies = values[parameter.name]
            if parameter.unit == "Hz" and not all(0 < frequency < nyquist for frequency in frequencies):
                raise InputError(
                    f"{parameter.name} = {in_words(frequencies)} Hz: must be above 0 and below half the servo's, "
                    f"{nyquist:g} Hz"
                )

    def start(self, values: Mapping[str, float], timing: Timing) -> dict[str, Any]:
        """Return the fields of one axis at the start of a run, by name: by default the parameters themselves."""
        return {parameter.name: values[parameter.name] for parameter in self.parameters}

    def error_gain(self, values: Mapping[str, float]) -> float:
        """Return by how much the law multiplies the error of one axis, at most; for the margins."""
        return 1.0

    def closed_around(self, law: Compensator, values: Mapping[str, float], timing: Timing) -> Compensator:
        """Return base law and notch of one axis with this law closed around them, as they answer to a position."""
        return law

    def sent(self, values: Mapping[str, Sequence[float]], setpoints: Setpoints) -> Setpoints:
        """Return the setpoints as the law sends them to the servo.

        Args:
            values: of the parameters, one per axis each, by name.
            setpoints: the program's own.
        """
        return setpoints

    def torque(self, invert: Callable[[Floats], Floats], position: Floats) -> Floats | None:
        """Return torques that the law sends with the setpoints, (n, axes) [N·m], None for none.

        Args:
            invert: returns the torques with which the linear machine under its servo follows setpoints.
            position: the setpoints, (n, axes) [u].
        """
        return None


class BaseLaw(Law):
    """A law that makes the torque demand from the following error; a servo has one.

    Attributes:
        unused_gains: gains that must be 0, as the law has no term for them; in words what to use instead.
    """

    unused_gains: ClassVar[tuple[str, ...]] = ()

    @staticmethod
    def tick(row: Any, axis: int, gains: Gains) -> tuple[float, float]:
        """Return the torque demand of one axis before the notch [N·m], and the law's integral after this tick.

        Args:
            row: the servo's values at this tick, among them `law_error`, `law_change` and `integral`.
            axis: number of the axis.
            gains: of the axis.
        """
        raise NotImplementedError

    def compensator(self, gains: Gains, period: float, error_gain: float = 1.0) -> Compensator:
        """Return the law of one axis as it answers to a position alone, with all demands at zero.

        Args:
            gains: of the axis.
            period: servo period [s].
            error_gain: by how much the error counts, of an added law.
        """
        raise NotImplementedError

    def without_term(self, gains: Gains) -> tuple[str, ...]:
        """Return the names of gains that are not 0 and have no effect in this law."""
        return ()


def in_words(values: Sequence[float]) -> str:
    """Return values of all axes as text: one where they are the same."""
    shown = [f"{value:g}" for value in values]
    return ", ".join(shown if len(set(shown)) > 1 else shown[:1])
