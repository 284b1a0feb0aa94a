"""What a servo is made of, axis by axis, and its values by the keys of a job file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from gantrysim.base.errors import InputError, unknown_text
from gantrysim.servo.drive_settings import DriveSettings
from gantrysim.servo.gains import Gains
from gantrysim.servo.laws import LAW_PARAMETERS, PID, LawValues
from gantrysim.servo.laws.selection import Laws, law_names
from gantrysim.servo.notch import Notch
from gantrysim.servo.servo_values import checked, per_axis

_NOTCH = "notch_"  # before the keys of a notch
_OF_ALL_LAWS = ("law", "learning_repeats", "motions")  # keys


class Parts(NamedTuple):
    """Gains, drives, notches and laws of a servo.

    Attributes:
        gains: of each axis.
        drives: of each axis.
        notches: of each axis.
        laws: of all axes.
    """

    gains: tuple[Gains, ...]
    drives: tuple[DriveSettings, ...]
    notches: tuple[Notch, ...]
    laws: Laws

    @property
    def modes(self) -> tuple[str, ...]:
        """Command mode of each axis' drive."""
        return tuple(drive.mode for drive in self.drives)

    def completed(self) -> Parts:
        """Return the parts with every value checked, and with notches and laws where none are given.

        Raises:
            InputError: not as many values as there are axes, or a value out of its bounds.
        """
        axes = len(self.gains)
        if not axes:
            raise InputError("gains has 0 values: must be one per axis, at least one")
        notches = self.notches or (Notch(),) * axes
        parameters = self.laws.parameters or (LawValues(),) * axes
        for name, values in (("drives", self.drives), ("notches", notches), ("laws", parameters)):
            if len(values) != axes:
                raise InputError(f"{name} has {len(values)} values: must be {axes}, one per axis")
        return Parts(
            _checked(self.gains),
            _checked(self.drives),
            _checked(notches, _NOTCH),
            replace(self.laws, parameters=_checked(parameters)),
        )

    def check(self, period: float) -> None:
        """Raise InputError for values that contradict each other.

        Args:
            period: servo period [s].
        """
        for drive, gains in zip(self.drives, self.gains, strict=True):
            _check_drive(drive, gains)
        self.laws.check(period)
        base = self.laws.base
        for gains in self.gains:
            for name in base.without_term(gains):
                value = getattr(gains, name)
                raise InputError(f"{name} = {value:g}: has no effect in law {base.name!r}; use {PID.name!r}")

    def with_values(self, values: Mapping[str, Any]) -> Parts:
        """Return the parts with other values.

        Args:
            values: by key, one for all axes or one per axis.

        Raises:
            InputError: as many values as there are axes are needed, or a value is none of those allowed.
        """
        return Parts(
            _changed(self.gains, values),
            _changed(self.drives, values),
            _changed(self.notches, values, _NOTCH),
            self._changed_laws(values),
        )

    def _changed_laws(self, values: Mapping[str, Any]) -> Laws:
        laws = self.laws
        parameters = _changed(laws.parameters, values)
        return replace(
            laws,
            names=law_names(values.get("law", laws.names)),
            parameters=parameters,
            learning_repeats=values.get("learning_repeats", laws.learning_repeats),
            motions=tuple(values.get("motions", laws.motions)),
        )

    def per_axis(self, name: str) -> tuple[Any, ...]:
        """Return the values of all axes by key, or raise InputError for no key of an axis."""
        for parts, prefix in ((self.gains, ""), (self.drives, ""), (self.notches, _NOTCH), (self.laws.parameters, "")):
            field = name.removeprefix(prefix)
            if name.startswith(prefix) and field in parts[0]._fields:
                return tuple(getattr(part, field) for part in parts)
        raise InputError(unknown_text("value of the servo", name, sorted(KEYS_OF_AXES)))

    def values(self) -> dict[str, Any]:
        """Return all values by key: one per axis but for law, learning_repeats and motions."""
        return {
            **_values(self.gains),
            **_values(self.notches, _NOTCH),
            **_values(self.drives),
            **_values(self.laws.parameters),
            "law": self.laws.names,
            "learning_repeats": self.laws.learning_repeats,
            "motions": self.laws.motions,
        }


KEYS_OF_AXES = frozenset(
    (*Gains._fields, *DriveSettings._fields, *(_NOTCH + name for name in Notch._fields), *LawValues._fields)
)
KEYS = KEYS_OF_AXES.union(_OF_ALL_LAWS)


def check_keys(keys: Iterable[str], others: Sequence[str]) -> None:
    """Raise TypeError, as Python does, for a key that neither the parts of a servo nor its other values have."""
    known = KEYS.union(others)
    for key in keys:
        if key not in known:
            raise TypeError(f"Servo.with_values: {unknown_text('keyword', key, sorted(known))}")


def law_values(values: Mapping[str, float]) -> Any:
    """Return the parameters of one axis' laws, 0 for those that are not given."""
    return LawValues(**{parameter.name: values.get(parameter.name, 0.0) for parameter in LAW_PARAMETERS})


def _changed(parts: tuple[Any, ...], values: Mapping[str, Any], prefix: str = "") -> tuple[Any, ...]:
    for name in parts[0]._fields:
        key = prefix + name
        if key in values:
            of_axes = per_axis(key, values[key], len(parts))
            parts = tuple(part._replace(**{name: value}) for part, value in zip(parts, of_axes, strict=True))
    return parts


def _values(parts: tuple[Any, ...], prefix: str = "") -> dict[str, tuple[Any, ...]]:
    return {prefix + name: tuple(getattr(part, name) for part in parts) for name in parts[0]._fields}


def _checked(parts: tuple[Any, ...], prefix: str = "") -> tuple[Any, ...]:
    """Return the values of all axes, each checked; errors as of `checked`."""
    return tuple(
        type(part)(*(checked(prefix + name, value) for name, value in part._asdict().items())) for part in parts
    )


def _check_drive(drive: DriveSettings, gains: Gains) -> None:
    """Raise InputError for settings of a drive that contradict each other, or the gains."""
    error = max(drive.interpolation_error, drive.interpolation_error_twice)
    if error and not drive.signal_period:
        raise InputError(
            f"signal_period = {drive.signal_period:g} mm: must be greater than 0 mm where there is an interpolation "
            f"error, which is {error:g} mm"
        )
    if drive.feedback == "none" and drive.mode != "stepper":
        raise InputError(f"servo feedback = 'none': a drive in mode {drive.mode!r} needs it; use 'motor' or 'load'")
    for name, gain in gains._asdict().items():
        if gain and drive.mode == "stepper":
            raise InputError(f"{name} = {gain:g} in mode 'stepper': must be 0, nothing is fed back; use 'torque'")
    if bool(drive.velocity_gain) is not (drive.mode == "velocity"):
        need = "must be greater than 0" if drive.mode == "velocity" else "must be 0, only for mode 'velocity'"
        raise InputError(f"velocity_gain = {drive.velocity_gain:g} N·m·s/mm in mode {drive.mode!r}: {need}")
