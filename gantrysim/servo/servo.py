"""The sampled servo of a motion controller: period, gains, drives, notches, laws and limits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Unpack

from gantrysim.base.display import Shown
from gantrysim.base.errors import InputError
from gantrysim.servo import notch
from gantrysim.servo.axis_dynamics import AxisDynamics, Lags
from gantrysim.servo.derivation import NoLoopError
from gantrysim.servo.drive_settings import DRIVE_PERIOD, FEEDBACKS, LOOPS, DriveSettings, drives_in_loops
from gantrysim.servo.gains import Gains
from gantrysim.servo.laws import PID
from gantrysim.servo.laws.law import Timing
from gantrysim.servo.laws.selection import PID_ALONE, Laws, words
from gantrysim.servo.laws.user import LawName
from gantrysim.servo.notch import Notch
from gantrysim.servo.remedies import refusal
from gantrysim.servo.request import (
    DERIVED_VALUES,
    FOLLOWING_ERROR_LIMIT,
    LARGEST_SEED,
    GivenValues,
    Parts,
    ServoRequest,
    axes_of,
    check_drive_period,
    check_keys,
    check_keywords,
    check_modes,
    check_timing,
    check_whole,
    checked_value,
    per_axis,
)
from gantrysim.servo.servo_design import check_margins, designed_parts, margins_at
from gantrysim.servo.stability.linear_system import Compensator
from gantrysim.servo.stability.motion import MODES, Drives

_COMMON_KEYS = ("period", "delay", "drive_period", "feedback_delay", "encoder_seed")  # keys of values for all axes


@dataclass(frozen=True, kw_only=True, repr=False)
class Servo(Shown):
    """A sampled servo: its law, computed from the encoders once per period, and its timing.

    The output is computed once per period from the quantised position, takes effect after `delay` and is held until the
    next one. It is clamped to the torque limit; meanwhile the error sum is frozen (anti-windup).

    Attributes:
        period: servo period T [s].
        gains: gains of each axis.
        drives: drive and encoder of each axis.
        notches: notch of each axis, a filter between law and clamp, by default none; see `gantrysim.servo.notch`.
        laws: names and parameters of the laws, by default `pid` alone.
        following_error_limit: following error of each axis at which the drives are disabled [mm or deg].
        delay: delay from the sample to the output, at most one period [s].
        drive_period: sampling period of the loops inside the drives, the servo period over a whole number [s].
        feedback_delay: delay from the encoder's sample to the servo, in servo periods.
        encoder_seed: random seed of the encoder noise.

    Raises:
        InputError: a value out of its bounds.
    """

    period: float
    gains: tuple[Gains, ...]
    drives: tuple[DriveSettings, ...]
    following_error_limit: tuple[float, ...]
    notches: tuple[Notch, ...] = ()
    laws: Laws = PID_ALONE
    delay: float = 0.0
    drive_period: float = DRIVE_PERIOD
    feedback_delay: int = 0
    encoder_seed: int = 0

    def __post_init__(self) -> None:
        limits = tuple(checked_value("following_error_limit", limit) for limit in self.following_error_limit)
        if len(limits) != len(self.gains):
            raise InputError(f"following_error_limit has {len(limits)} values: must be {self.axes}, one per axis")
        # the servo is frozen, so that its completed values are set behind its back
        object.__setattr__(self, "following_error_limit", limits)
        for name, values in self.parts.completed()._asdict().items():
            object.__setattr__(self, name, values)
        check_timing(self.period, self.delay, self.feedback_delay)
        check_whole("encoder_seed", self.encoder_seed, LARGEST_SEED)
        _ = self.filters
        self.parts.check(self.period)
        check_drive_period(self.drive_period, self.period, self.modes)
        if self.laws.names != (PID.name,):
            self.check_torque(f"servo law = {words(self.laws.names)}")

    def facts(self) -> dict[str, str]:
        values = self.values()
        shown = [p for p in DERIVED_VALUES if p.name not in ("notch_width", "notch_depth") and any(values[p.name])]
        facts = {"period": f"{1e3 * self.period:g} ms", "axes": str(self.axes), "law": words(self.laws.names)}
        return facts | {f"{p.name} [{p.unit}]": " ".join(f"{value:.4g}" for value in values[p.name]) for p in shown}

    @property
    def axes(self) -> int:
        """Number of axes."""
        return len(self.gains)

    @property
    def parts(self) -> Parts:
        """Gains, drives, notches and laws."""
        return Parts(self.gains, self.drives, self.notches, self.laws)

    def values(self) -> dict[str, Any]:
        """Return all values by the keys of a job file's [servo]; values per axis are tuples."""
        return {
            **{name: getattr(self, name) for name in (*_COMMON_KEYS, "following_error_limit")},
            **self.parts.values(),
        }

    def per_axis(self, name: str) -> tuple[Any, ...]:
        """Return a value of all axes, (axes,).

        Args:
            name: key of the value in a job file, such as "kp".

        Raises:
            InputError: an unknown key.
        """
        return self.following_error_limit if name == "following_error_limit" else self.parts.per_axis(name)

    def with_values(self, **values: Any) -> Servo:
        """Return the servo with other values; nothing else is derived again.

        Args:
            values: new values by the keys of a job file's [servo], one for all axes or one per axis.

        Raises:
            InputError: a value out of its bounds.
            TypeError: an unknown key.
        """
        check_keys(values, (*_COMMON_KEYS, "following_error_limit"))
        common = {name: values[name] for name in _COMMON_KEYS if name in values}
        limit = values.get("following_error_limit", self.following_error_limit)
        common["following_error_limit"] = per_axis("following_error_limit", limit, self.axes)
        return replace(self, **common, **self.parts.with_values(values)._asdict())

    @property
    def modes(self) -> tuple[str, ...]:
        """Command mode of each axis' drive."""
        return tuple(drive.mode for drive in self.drives)

    @cached_property
    def filters(self) -> tuple[notch.Coefficients, ...]:
        """The notch of each axis as a filter at the rate of its law."""
        return tuple(
            notch.coefficients(*values, self._law_period(mode))
            for values, mode in zip(self.notches, self.modes, strict=True)
        )

    def _law_period(self, mode: str) -> float:
        """Return the period of the law of an axis, which a drive in position mode works itself [s]."""
        return self.drive_period if mode == "position" else self.period

    @property
    def inner_period(self) -> float:
        """The period of the loops in the drives, 0 where there are none [s]."""
        return self.drive_period if LOOPS & set(self.modes) else 0.0

    @property
    def plain(self) -> bool:
        """Whether the drives are plain: noiseless encoders on the motors, no current loop, no feedback delay."""
        ideal = all(drive.ideal_encoder for drive in self.drives)
        return ideal and self.loop_drives == Drives() and not self.feedback_delay

    @property
    def loop_drives(self) -> Drives:
        """Dynamics of the drives inside the loops."""
        return drives_in_loops(self.drives, self.drive_period)

    @property
    def timing(self) -> Timing:
        """Period and delays of the servo."""
        return Timing(self.period, self.delay, self.feedback_delay)

    @property
    def lags(self) -> Lags:
        """Delays of the loops in addition to the sampling period."""
        return Lags(self.delay, self.feedback_delay, self.loop_drives)

    def check_torque(self, what: str) -> None:
        """Raise InputError, naming what needs it, unless the servo sends torques to all drives."""
        check_modes(what, self.modes)

    def compensators(self) -> tuple[Compensator, ...]:
        """Return law, notch and feedback delay of each axis as a linear system, for the stability of its loop.

        Raises:
            UnknownLoopError: a user-defined law that is not linear or couples axes.
        """
        return tuple(self._compensator(a) for a in range(self.axes))

    def _compensator(self, axis: int) -> Compensator:
        mode = self.modes[axis]
        if mode == MODES[0]:
            return self.laws.compensator(axis, self.gains, self.filters[axis], self.timing)
        law = PID.compensator(self.gains[axis], self._law_period(mode)).then(self.filters[axis])
        return law.delayed(0 if mode == "position" else self.feedback_delay)

    @classmethod
    def derive(
        cls,
        axes: Iterable[AxisDynamics],
        period: float = 1e-3,
        *,
        frequency: float | None = None,
        damping: float = 1.0,
        feedforward: float = 1.0,
        integral_time: float = math.inf,
        following_error_limit: float = FOLLOWING_ERROR_LIMIT,
        delay: float = 0.0,
        feedback: str | Sequence[str] = FEEDBACKS[0],
        mode: str | Sequence[str] | None = None,
        drive_period: float | None = None,
        velocity_bandwidth: float | None = None,
        feedback_delay: int = 0,
        encoder_seed: int = 0,
        law: LawName | Sequence[LawName] = PID.name,
        learning_repeats: int = Laws.learning_repeats,
        **given: Unpack[GivenValues],
    ) -> Servo:
        """Return a servo whose gains follow from the axes' inertia, a natural frequency and a damping ratio.

        With the inertia J at the motor, kp = J w^2 and kd = 2 zeta J w place the poles of the continuous loop at the
        natural frequency w; ki = kp / integral_time. Feed-forward supplies the torque for inertia and viscous friction.
        All axes get the same frequency, so that their lags match and a circle stays round: the highest at which each
        axis keeps a gain margin of 2 and |S| <= 2, if necessary with a notch at its mode, see `derivation`. Coupled
        axes keep both with all loops closed, the margin for a common factor on all gains. Given values, such as a
        frequency, gains or a notch, are used whatever the margins. Loops in the drives: see
        `gantrysim.servo.servo_design`.

        Args:
            axes: the machine's axes.
            period: servo period [s].
            frequency: natural frequency w / 2 pi of the loop, by default the highest that keeps the margins [Hz].
            damping: damping ratio zeta of the loop.
            feedforward: fraction of the computed velocity and acceleration feed-forward that is applied.
            integral_time: integral time kp / ki; inf for no integral term [s].
            following_error_limit: following error at which the drives are disabled, on every axis [mm or deg].
            delay: delay from the encoder's sample to the torque demand [s].
            feedback: location of the encoders, "motor" or "load", for all axes or one per axis; "none" for a stepper in
                open loop without an encoder.
            mode: command mode of the drives, for all axes or one per axis; by default that of the machine's drives.
            drive_period: sampling period of the loops in the drives; by default 0.125 ms, or the servo's if not a
                multiple [s].
            velocity_bandwidth: bandwidth of velocity loops in the drives, by default the highest that keeps the margins
                [Hz].
            feedback_delay: delay from the encoder's sample to the servo, in servo periods.
            encoder_seed: random seed of the encoder noise.
            law: one name or several, from `BASES` and `ADDITIONS`, or a law itself.
            learning_repeats: number of runs that the law `learning` learns from.
            given: values from `DERIVED_VALUES` to override, one for all axes or one per axis.

        Raises:
            InputError: a value out of bounds, or no loop that keeps its margins; the message names a value with one.
        """
        check_keywords(given, cls.derive)
        request = ServoRequest(
            axes=axes_of(axes),
            period=period,
            frequency=frequency,
            damping=damping,
            feedforward=feedforward,
            integral_time=integral_time,
            following_error_limit=following_error_limit,
            delay=delay,
            feedback=feedback,
            mode=mode,
            feedback_delay=feedback_delay,
            encoder_seed=encoder_seed,
            law=law,
            learning_repeats=learning_repeats,
            drive_period=drive_period,
            velocity_bandwidth=velocity_bandwidth,
            given=dict(given),
        )
        try:
            return cls._of(request)
        except NoLoopError as error:
            raise refusal(request, error, lambda changed: cls._of(changed).parts) from None

    @classmethod
    def _of(cls, request: ServoRequest) -> Servo:
        """Return the servo of a request, or raise NoLoopError where its loops keep no margins."""
        request = request.checked()
        servo = cls(
            period=request.period,
            **designed_parts(request)._asdict(),
            following_error_limit=(request.following_error_limit,) * len(request.axes),
            delay=request.delay,
            drive_period=request.inner_period,
            feedback_delay=request.feedback_delay,
            encoder_seed=request.encoder_seed,
        )
        if request.keeps_margins:
            check_margins(request, margins_at(request.axes, servo))
        return servo
