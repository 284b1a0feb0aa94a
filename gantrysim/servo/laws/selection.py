"""The laws that a servo uses, with their parameters, and as a linear system, for the stability of their loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from gantrysim.base.errors import InputError, between, unknown, whole_number
from gantrysim.servo.gains import Gains
from gantrysim.servo.laws import ADDITIONS, BASES, LAW_PARAMETERS, LAWS, LEARNING, PID, BaseLaw, Law, LawValues
from gantrysim.servo.laws.law import Timing, in_words
from gantrysim.servo.laws.user import LawName, linearised_law, resolved_law
from gantrysim.servo.notch import Coefficients
from gantrysim.servo.stability.linear_system import Compensator
from gantrysim.servo.stability.motion import Motion

MOST_REPEATS = 1000


@dataclass(frozen=True)
class Laws:
    """The laws of a servo.

    Attributes:
        names: one of `BASES` or a user's own first, and any of `ADDITIONS`.
        parameters: of each axis, by name; 0 for those of laws that are not used.
        learning_repeats: number of runs from which the law learning learns.
        motions: linear motion of each axis alone, or of all in one, by which preview and learning invert the machine;
            that of the nominal machine, as are the gains.
    """

    names: tuple[LawName, ...] = (PID.name,)
    parameters: tuple[LawValues, ...] = ()
    learning_repeats: int = 5
    motions: tuple[Motion, ...] = field(default=(), repr=False)

    @property
    def user(self) -> LawName | None:
        """A user's own law, None without one."""
        return self.names[0] if is_own(self.names[0]) else None

    @property
    def base(self) -> BaseLaw:
        """The base law; PID in place of a user's own, see `base_law`."""
        return base_law(self.names)

    @cached_property
    def added(self) -> tuple[Law, ...]:
        """The laws added to the base, in the order in which they act."""
        return tuple(added_laws(self.names))

    @property
    def runs(self) -> int:
        """Number of runs that one simulation takes: with learning one more than it has repeats to learn from."""
        return self.learning_repeats + 1 if LEARNING.name in self.names else 1

    def values(self, axis: int) -> dict[str, float]:
        """Return the parameters of one axis by name."""
        values: dict[str, float] = self.parameters[axis]._asdict()
        return values

    def per_axis(self, name: str) -> tuple[float, ...]:
        """Return a parameter of all axes."""
        return tuple(getattr(values, name) for values in self.parameters)

    def by_name(self) -> dict[str, tuple[float, ...]]:
        """Return the parameters of all axes by name."""
        return {parameter.name: self.per_axis(parameter.name) for parameter in LAW_PARAMETERS}

    def check(self, period: float) -> None:
        """Raise InputError for a law without its parameters, for parameters without their law, or out of bounds.

        Args:
            period: servo period [s].
        """
        values = self.by_name()
        for law in self.added:
            law.check(values, period)
        for parameter in LAW_PARAMETERS:
            takers = [law.name for law in LAWS if parameter in law.parameters]
            if any(values[parameter.name]) and not any(name in self.names for name in takers):
                raise InputError(
                    f"{parameter.name} = {in_words(values[parameter.name])}: has no effect without law = "
                    f"{takers[0]!r}; name it in law"
                )
        if any(law.inverts_machine for law in self.added) and not self.motions:
            named = " and ".join(repr(law.name) for law in LAWS if law.inverts_machine)
            raise InputError(f"laws {named} need motions: take them from Servo.derive, of a machine without delays")
        between("learning_repeats", whole_number("learning_repeats", self.learning_repeats, 1), 1, MOST_REPEATS)

    def compensator(self, axis: int, gains: Sequence[Gains], notch: Coefficients, timing: Timing) -> Compensator:
        """Return the laws of one axis as they answer to a position alone, with all demands at zero.

        Args:
            axis: number of the axis.
            gains: of all axes.
            notch: of the axis.
            timing: of the servo.

        Raises:
            UnknownLoopError: a user's own law that is not linear or couples axes.
        """
        if self.user is None:
            return linear_law(self.names, gains[axis], notch, self.values(axis), timing)
        law = linearised_law(resolved_law(self.user), np.array(gains), axis, timing.period)
        return closed_around(law, self.names, self.values(axis), timing)


PID_ALONE = Laws()


def law_names(given: LawName | Sequence[LawName]) -> tuple[LawName, ...]:
    """Return the names of a law in one order, its base first.

    Args:
        given: names of additions, and of at most one base, by default pid; a base may be a user's own law, a function
            or its name as "module:function" or "path/to/file.py:function".

    Raises:
        InputError: an unknown name, one that is given twice, or two that exclude each other.
    """
    names = (given,) if isinstance(given, str) or callable(given) else tuple(given)
    known = (*BASES, *ADDITIONS)
    for name in names:
        if not is_own(name) and name not in known:
            raise unknown("law", str(name), known)
    if len(set(names)) < len(names):
        raise InputError(f"law = {words(names)}: must name each law once")
    bases = [name for name in names if name in BASES or is_own(name)]
    if len(bases) > 1:
        raise InputError(f"law = {words(names)}: must have at most one of {', '.join(BASES)} and of your own")
    added = added_laws(names)
    for law in added:
        excluded = [name for name in law.excludes if name in names]
        if excluded:
            raise InputError(f"law = {words(names)}: must have at most one of {law.name}, {', '.join(law.excludes)}")
    base = bases[0] if bases else PID.name
    misfits = [law.name for law in added if law.needs_known_base]
    if is_own(base) and misfits:
        raise InputError(
            f"law = {words(names)}: {misfits[0]} needs a base law with a known response, {', '.join(BASES)}"
        )
    return (base, *(law.name for law in added))


def is_own(law: LawName) -> bool:
    """Return whether a law is a user's own."""
    return ":" in law if isinstance(law, str) else callable(law)


def words(names: Sequence[LawName]) -> str:
    """Return the names of laws as text."""
    return ", ".join(name if isinstance(name, str) else getattr(name, "__name__", repr(name)) for name in names)


def linear_law(
    names: Sequence[LawName], gains: Gains, notch: Coefficients, values: Mapping[str, float], timing: Timing
) -> Compensator:
    """Return the laws of one axis as they answer to a position alone, with all demands at zero.

    Friction compensation and torques that are sent with the setpoints do not answer to a position.

    Args:
        names: of the laws, a base of the ladder first.
        gains: of the axis.
        notch: of the axis.
        values: parameters of the laws that answer to a position, by name.
        timing: of the servo.
    """
    error_gain = 1.0
    for law in added_laws(names):
        if law.answers_to_position:
            error_gain *= law.error_gain(values)
    base = base_response(names, gains, notch, timing.period, error_gain)
    return closed_around(base, names, values, timing)


def base_response(
    names: Sequence[LawName], gains: Gains, notch: Coefficients, period: float, error_gain: float = 1.0
) -> Compensator:
    """Return base law and notch of one axis, without the laws added to them and without the feedback's delay."""
    return base_law(names).compensator(gains, period, error_gain).then(notch)


def closed_around(
    base: Compensator, names: Sequence[LawName], values: Mapping[str, float], timing: Timing
) -> Compensator:
    """Return a base law with the laws added to it, and with the feedback's delay; see `linear_law`."""
    law = base
    for added in added_laws(names):
        if added.answers_to_position:
            law = added.closed_around(law, values, timing)
    return law.delayed(timing.feedback_delay)


def base_law(names: Sequence[LawName]) -> BaseLaw:
    """Return the base law; PID where it is a user's own, whose loop is designed as that of PID."""
    return BASES.get(str(names[0]), PID)


def added_laws(names: Sequence[LawName]) -> list[Law]:
    """Return the laws that are added to the base, in the order in which they act."""
    return [law for name, law in ADDITIONS.items() if name in names]
