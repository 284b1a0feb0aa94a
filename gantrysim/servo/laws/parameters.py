"""Names of the servo's laws, and their parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gantrysim.base.errors import InputError, between, unknown, whole
from gantrysim.servo.gains import FEED_FORWARD, Parameter
from gantrysim.servo.laws.user import LawName
from gantrysim.stability.motion import Motion

PD, PID, CASCADE = "pd", "pid", "p-pi"
FRICTION, OBSERVER, CONTOUR = "friction", "observer", "contour"
PREVIEW, LEARNING, ZV, ZVD = "preview", "learning", "zv", "zvd"

BASES = {
    PD: "kp and kd alone, without integral and feed-forward",
    PID: "the law of `gantrysim.servo.law`",
    CASCADE: "a position loop that gives a speed, and a PI velocity loop inside it",
}
ADDITIONS = {
    FRICTION: "torque of the friction, from a model that the demand moves",
    OBSERVER: "disturbance observer: the nominal inverse of what the axis did, less what it was told",
    CONTOUR: "cross-coupling: the error across the path is multiplied",
    PREVIEW: "torque sent with the setpoints, by a zero-phase inverse of the linear machine",
    LEARNING: "torque sent with the setpoints, learnt over repeats",
    ZV: "input shaping by two impulses",
    ZVD: "input shaping by three impulses",
}
NOT_PD = ("ki", *FEED_FORWARD)  # gains that PD has not
MOST_REPEATS = 1000
IN_THE_TICK = (CASCADE, FRICTION, OBSERVER, CONTOUR)  # the others change what is sent

LAW_PARAMETERS = (
    Parameter("friction_torque", "N·m", "Coulomb friction that the law friction compensates"),
    Parameter("friction_static", "N·m", "its static friction"),
    Parameter("friction_speed", "u/s", "speed at which it has come down from static to Coulomb, its Stribeck speed"),
    Parameter("friction_stiffness", "N·m/u", "its torque per travel after a reversal"),
    Parameter("observer_bandwidth", "Hz", "cut-off of the disturbance observer"),
    Parameter("observer_inertia", "N·m·s²/u", "torque per acceleration in its model"),
    Parameter("observer_viscous", "N·m·s/u", "torque per speed in its model"),
    Parameter("observer_lag", "s", "time constant of the torque in its model"),
    Parameter("contour_gain", "", "factor by which the law contour adds the error across the path to the error"),
    Parameter("preview_bandwidth", "Hz", "cut-off of the zero-phase preview"),
    Parameter("learning_bandwidth", "Hz", "cut-off of the learning"),
    Parameter("shaper_frequency", "Hz", "frequency that input shaping leaves out"),
    Parameter("shaper_damping", "", "damping ratio of the mode at that frequency"),
)


@dataclass(frozen=True, kw_only=True, repr=False)
class LawParameters:
    """The laws of a servo and their parameters, one value per axis.

    Attributes:
        law: names, one of `BASES` or a user's own first, and any of `ADDITIONS`.
        learning_repeats: number of runs from which the law learning learns.
        motions: linear motion of each axis alone, or of all in one, by which preview and learning invert the machine;
            that of the nominal machine, as are the gains.
    """

    law: tuple[LawName, ...] = (PID,)
    friction_torque: tuple[float, ...] = ()
    friction_static: tuple[float, ...] = ()
    friction_speed: tuple[float, ...] = ()
    friction_stiffness: tuple[float, ...] = ()
    observer_bandwidth: tuple[float, ...] = ()
    observer_inertia: tuple[float, ...] = ()
    observer_viscous: tuple[float, ...] = ()
    observer_lag: tuple[float, ...] = ()
    contour_gain: tuple[float, ...] = ()
    preview_bandwidth: tuple[float, ...] = ()
    learning_bandwidth: tuple[float, ...] = ()
    shaper_frequency: tuple[float, ...] = ()
    shaper_damping: tuple[float, ...] = ()
    learning_repeats: int = 5
    motions: tuple[Motion, ...] = ()

    @property
    def own_law(self) -> LawName | None:
        """A user's own law, None without one."""
        return self.law[0] if is_own(self.law[0]) else None

    def law_values(self, axis: int) -> dict[str, float]:
        """Return the parameters of one axis by name."""
        return {parameter.name: getattr(self, parameter.name)[axis] for parameter in LAW_PARAMETERS}

    def check_laws(self, period: float) -> None:
        """Raise InputError for a law without its parameters, for parameters without their law, or out of bounds.

        Args:
            period: servo period [s].
        """
        nyquist = 0.5 / period
        for name, law in _NEEDED.items():
            values, named = getattr(self, name), any(one in self.law for one in law)
            unit = _UNITS[name]
            least = -1.0 if name == "shaper_frequency" and any(values) else 0.0  # an axis may have no mode
            if named and unit == "Hz" and not all(least < value < nyquist for value in values):
                raise InputError(
                    f"{name} = {_list(values)} Hz: must be above 0 and below half the servo's, {nyquist:g} Hz"
                )
            if any(values) and not named:
                raise InputError(f"{name} = {_list(values)}: has no effect without law = {law[0]!r}; name it in law")
        if max(self.shaper_damping) >= 1:
            raise InputError(f"shaper_damping = {_list(self.shaper_damping)}: must be below 1")
        if (PREVIEW in self.law or LEARNING in self.law) and not self.motions:
            raise InputError(
                "laws 'preview' and 'learning' need motions: take them from Servo.derive, of a machine without delays"
            )
        between("learning_repeats", whole("learning_repeats", self.learning_repeats, 1), 1, MOST_REPEATS)


_UNITS = {parameter.name: parameter.unit for parameter in LAW_PARAMETERS}
_NEEDED = {
    name: (ZV, ZVD) if name.startswith("shaper") else (name.partition("_")[0],) for name in _UNITS
}  # laws of a parameter


def _list(values: Sequence[float]) -> str:
    return " ".join(f"{value:g}" for value in values)


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
    if ZV in names and ZVD in names:
        raise InputError(f"law = {words(names)}: must have at most one of zv, zvd")
    base = bases[0] if bases else PID
    misfits = [name for name in (CONTOUR, PREVIEW, LEARNING) if name in names]
    if is_own(base) and misfits:
        raise InputError(f"law = {words(names)}: {misfits[0]} needs a base whose answer it knows, {', '.join(BASES)}")
    return (base, *(name for name in ADDITIONS if name in names))


def is_own(law: LawName) -> bool:
    """Return whether a law is a user's own."""
    return ":" in law if isinstance(law, str) else callable(law)


def words(names: Sequence[LawName]) -> str:
    """Return the names of laws as text."""
    return ", ".join(name if isinstance(name, str) else getattr(name, "__name__", repr(name)) for name in names)
