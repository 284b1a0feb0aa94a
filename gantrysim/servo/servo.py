"""The sampled servo of a motion controller: period, gains, notch and limits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from inspect import signature
from typing import Any

import numpy as np

from gantrysim.base.display import Shown
from gantrysim.base.errors import InputError, at_least, unknown_text
from gantrysim.servo import notch
from gantrysim.servo.axis_dynamics import AxisDynamics, Lags
from gantrysim.servo.derivation import NoLoopError
from gantrysim.servo.gains import GAIN_NAMES, Gains, PerAxisGains
from gantrysim.servo.law import compensator
from gantrysim.servo.laws.cascade import without_term
from gantrysim.servo.laws.linear import closed, linear_law
from gantrysim.servo.laws.parameters import CASCADE, PID, LawParameters, law_names, words
from gantrysim.servo.laws.user import LawName, linearised, resolved
from gantrysim.servo.remedies import refusal
from gantrysim.servo.servo_design import ServoRequest, check_margins, designed
from gantrysim.servo.servo_values import (
    COMMON,
    DERIVED,
    DRIVE_PERIOD,
    FEEDBACKS,
    FOLLOWING_ERROR_LIMIT,
    LARGEST_SEED,
    LOOPS,
    MAX_FEEDBACK_DELAY,
    UNLESS_GIVEN,
    check_drive_period,
    check_modes,
    check_period,
    check_whole,
    checked,
    drives_of,
)
from gantrysim.stability.compensator import Compensator
from gantrysim.stability.motion import MODES, Drives


@dataclass(frozen=True, repr=False)
class Servo(PerAxisGains, LawParameters, Shown):  # type: ignore[misc]
    """Period, gains and limits of a sampled servo; every gain has one value per axis.

    The output is computed once per period from the quantised position, takes effect `delay` later and is
    held until the next. It is clamped to the torque limit; the error sum is frozen while the output is
    clamped on the side to which the error drives it (anti-windup).

    Attributes:
        period: servo period T [s].
        kp and the other gains: as in `Gains`.
        torque_limit, resolution: as in `DERIVED`.
        following_error_limit: error at which the drives are disabled [mm].
        delay: time from the sample to the output, at most one period [s].
        notch_frequency, notch_width, notch_depth: of the filter between law and clamp, by default none, see
            `gantrysim.servo.notch`.
        current_bandwidth, encoder_noise, interpolation_error, interpolation_error_twice, signal_period, velocity_gain,
            velocity_time: as in `DRIVE`, by default 0.
        feedback: where the encoder of each axis is: on the "motor", the default, or on the "load" behind the axis'
            compliance; "none" of a stepper in open loop, of which the servo knows the microsteps that it has sent.
        mode: what the servo sends to the drive of each axis: "torque", the default; "velocity", where the law's output
            is a velocity [u/s], kp is in 1/s, and all other gains have u/s in place of N·m; "position", where the
            drive works the law itself; or "stepper", of a stepper in open loop, which takes no gains.
        drive_period: of the loops in the drives, a whole fraction of the servo period [s].
        feedback_delay: from the encoder's sample to the servo, in servo periods.
        encoder_seed: of the noise.
        law and its parameters: as in `LawParameters`.
    """

    period: float
    torque_limit: tuple[float, ...]
    resolution: tuple[float, ...]
    following_error_limit: tuple[float, ...]
    delay: float = 0.0
    notch_frequency: tuple[float, ...] = ()
    notch_width: tuple[float, ...] = ()
    notch_depth: tuple[float, ...] = ()
    current_bandwidth: tuple[float, ...] = ()
    encoder_noise: tuple[float, ...] = ()
    interpolation_error: tuple[float, ...] = ()
    interpolation_error_twice: tuple[float, ...] = ()
    signal_period: tuple[float, ...] = ()
    feedback: tuple[str, ...] = ()
    mode: tuple[str, ...] = ()
    velocity_gain: tuple[float, ...] = ()
    velocity_time: tuple[float, ...] = ()
    drive_period: float = DRIVE_PERIOD
    feedback_delay: int = 0
    encoder_seed: int = 0

    def __post_init__(self) -> None:
        check_period(self.period)
        object.__setattr__(self, "law", law_names(self.law))
        for name, value in UNLESS_GIVEN.items():
            if not getattr(self, name):
                object.__setattr__(self, name, (value,) * len(self.kp))
        if at_least("servo delay", self.delay, 0, "s") > self.period:
            raise InputError(f"servo delay = {self.delay:g} s: must be at most the period, {self.period:g} s")
        for field in fields(self):
            if field.name in COMMON:
                continue
            values = tuple(getattr(self, field.name))
            if len(values) != len(self.kp) or not values:
                raise InputError(f"{field.name} has {len(values)} values: must be {len(self.kp)}, one per axis")
            object.__setattr__(self, field.name, tuple(checked(field.name, value) for value in values))
        _ = self.filters
        for once, twice, signal in zip(
            self.interpolation_error, self.interpolation_error_twice, self.signal_period, strict=True
        ):
            if (once or twice) and not signal:
                raise InputError(
                    f"signal_period = {signal:g} mm: must be greater than 0 mm where there is an interpolation error, "
                    f"which is {max(once, twice):g} mm"
                )
        for place, mode in zip(self.feedback, self.mode, strict=True):
            if place == "none" and mode != "stepper":
                raise InputError(f"servo feedback = 'none': a drive in mode {mode!r} needs it; use 'motor' or 'load'")
        for name in GAIN_NAMES:
            for value, mode in zip(getattr(self, name), self.mode, strict=True):
                if value and mode == "stepper":
                    raise InputError(
                        f"{name} = {value:g} in mode 'stepper': must be 0, nothing is fed back; use 'torque'"
                    )
        self._check_loops()
        check_whole("feedback_delay", self.feedback_delay, MAX_FEEDBACK_DELAY)
        check_whole("encoder_seed", self.encoder_seed, LARGEST_SEED)
        self.check_laws(self.period)
        self._check_cascade()
        if self.law != (PID,):
            self.check_torque(f"servo law = {words(self.law)}")

    def _check_loops(self) -> None:
        for value, mode in zip(self.velocity_gain, self.mode, strict=True):
            if bool(value) is not (mode == "velocity"):
                need = "must be greater than 0" if mode == "velocity" else "must be 0, only for mode 'velocity'"
                raise InputError(f"velocity_gain = {value:g} N·m·s/mm in mode {mode!r}: {need}")
        check_drive_period(self.drive_period, self.period, self.mode)

    def _check_cascade(self) -> None:
        """Raise InputError for a gain that has no effect as P-PI has no term for it."""
        if CASCADE not in self.law:
            return
        for gains in self.gains:
            for name in without_term(gains):
                raise InputError(f"{name} = {getattr(gains, name):g}: has no effect in law 'p-pi'; use 'pid'")

    def facts(self) -> dict[str, str]:
        shown = [p for p in DERIVED if p.name not in ("notch_width", "notch_depth") and any(getattr(self, p.name))]
        gains = {f"{p.name} [{p.unit}]": " ".join(f"{value:.4g}" for value in getattr(self, p.name)) for p in shown}
        return {"period": f"{1e3 * self.period:g} ms", "axes": str(self.axes), "law": words(self.law), **gains}

    @property
    def axes(self) -> int:
        """Number of axes."""
        return len(self.kp)

    @cached_property
    def gains(self) -> tuple[Gains, ...]:
        """The gains of each axis."""
        return tuple(Gains(*values) for values in zip(*(getattr(self, name) for name in GAIN_NAMES), strict=True))

    @cached_property
    def filters(self) -> tuple[notch.Coefficients, ...]:
        """The notch of each axis."""
        own = zip(self.notch_frequency, self.notch_width, self.notch_depth, self._periods, strict=True)
        return tuple(notch.coefficients(*values) for values in own)

    @property
    def _periods(self) -> list[float]:
        """The period of each axis' law [s]."""
        return [self.drive_period if mode == "position" else self.period for mode in self.mode]

    @property
    def inner_period(self) -> float:
        """The period of the loops in the drives, 0 where there are none [s]."""
        return self.drive_period if LOOPS & set(self.mode) else 0.0

    @property
    def plain(self) -> bool:
        """Whether the drives are plain: encoders on the motors that only count, no current loop, no feedback delay."""
        errors = (*self.encoder_noise, *self.interpolation_error, *self.interpolation_error_twice)
        return self.drives == Drives() and not self.feedback_delay and not any(errors)

    @property
    def drives(self) -> Drives:
        """What of the drives lies in the loops."""
        drives = drives_of(self.feedback, self.current_bandwidth, self.mode, self.drive_period)
        if "velocity" not in self.mode:
            return drives
        loops = zip(self.velocity_gain, self.velocity_time, strict=True)
        return drives._replace(velocity=tuple((gain, 1 / time if time else 0.0) for gain, time in loops))

    @property
    def lags(self) -> Lags:
        """What makes the loops late."""
        return Lags(self.delay, self.feedback_delay, self.drives)

    def check_torque(self, what: str) -> None:
        """Raise InputError unless the servo sends torques to all drives, which something needs, named in words."""
        check_modes(what, self.mode)

    def compensators(self) -> tuple[Compensator, ...]:
        """Return law, notch and feedback delay of each axis as the stability of its loop depends on them.

        Raises:
            UnknownLoopError: a user's own law that is not linear or couples axes.
        """
        if self.own_law is not None:
            return self._own_compensators(self.own_law)
        return tuple(
            linear_law(self.law, own, filter, self.law_values(a), self.period, self.delay, self.feedback_delay)
            if mode == MODES[0]
            else compensator(own, period).then(filter).delayed(0 if mode == "position" else self.feedback_delay)
            for a, (own, filter, period, mode) in enumerate(
                zip(self.gains, self.filters, self._periods, self.mode, strict=True)
            )
        )

    def _own_compensators(self, law: LawName) -> tuple[Compensator, ...]:
        own, gains = resolved(law), np.array(self.gains)
        return tuple(
            closed(
                linearised(own, gains, a, self.period), self.law_values(a), self.period, self.delay, self.feedback_delay
            )
            for a in range(self.axes)
        )

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
        feedback_delay: int = 0,
        encoder_seed: int = 0,
        law: LawName | Sequence[LawName] = PID,
        learning_repeats: int = LawParameters.learning_repeats,
        drive_period: float | None = None,
        velocity_bandwidth: float | None = None,
        **given: float | Sequence[float] | None,
    ) -> Servo:
        """Return a servo whose gains follow from the axes' inertia, a natural frequency and a damping ratio.

        With the inertia J at the motor, kp = J w^2 and kd = 2 zeta J w place the poles of the continuous
        loop at the natural frequency w; ki = kp / integral_time. Feed-forward supplies the torque for the
        inertia and the viscous friction. All axes get one frequency, so that their lags match and a circle
        stays round: the highest one at which each axis keeps a gain margin of 2 and |S| <= 2, if need be with
        a notch at its mode, see `gantrysim.servo.derivation`. Axes that move each other do so with the loops of
        all of them closed, and with a factor of 2 on the gains of all. Margins are not kept of what is given: a
        frequency, gains or a notch.

        Args:
            axes: the machine's axes.
            period: servo period [s].
            frequency: natural frequency w / 2 pi; by default the highest that keeps the margins [Hz].
            damping: damping ratio zeta.
            feedforward: share of the computed feed-forward, 0 to 1.
            integral_time: kp / ki [s].
            following_error_limit: for every axis [mm].
            delay: from sample to output [s].
            feedback: "motor" or "load", for all axes or one per axis; a stepper in open loop without an encoder takes
                "none" for "motor".
            mode: of the drives, for all axes or one per axis; by default that of its motor. Loops in the drives get
                their gains likewise, see `gantrysim.servo.cascade`.
            feedback_delay: from the encoder to the servo, in servo periods.
            encoder_seed: of the encoders' noise.
            law: names, of `BASES` and `ADDITIONS`.
            learning_repeats: number of runs from which the law learning learns.
            drive_period: of the loops in the drives, by default 0.125 ms, or the servo's if that is no multiple [s].
            velocity_bandwidth: of velocity loops in the drives, by default the highest that keeps the margins [Hz].
            given: any of `DERIVED` to override, one value or one per axis.

        Raises:
            InputError: a value out of its bounds, or no loop that keeps its margins; the message names a value that has
                one, found by trying it.
        """
        _check_keywords(given)
        request = ServoRequest(
            axes=_tuple_of(axes),
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
            given=given,
        )
        try:
            return cls._of(request)
        except NoLoopError as error:
            raise refusal(request, error, cls._of) from None

    @classmethod
    def _of(cls, request: ServoRequest) -> Servo:
        """Return the servo that a request describes, or raise NoLoopError where its loops keep no margins."""
        servo = cls(**designed(request))
        check_margins(request, servo)
        return servo


def _check_keywords(given: Iterable[str]) -> None:
    """Raise TypeError, as Python does, for a keyword that `Servo.derive` does not have."""
    derived = [parameter.name for parameter in DERIVED]
    for name in given:
        if name not in derived:
            named = [key for key, one in signature(Servo.derive).parameters.items() if one.kind is one.KEYWORD_ONLY]
            raise TypeError(f"Servo.derive: {unknown_text('keyword', name, [*named, *derived])}")


def _tuple_of(axes: Any) -> tuple[AxisDynamics, ...]:
    """Return the axes of a machine, or raise InputError for what is likely to be given instead: machine or name."""
    if isinstance(axes, str) or not isinstance(axes, Iterable):
        raise InputError(
            f"axes is of type {type(axes).__name__}: must be the axes of a machine; write Servo.derive(machine.axes)"
        )
    return tuple(axes)
