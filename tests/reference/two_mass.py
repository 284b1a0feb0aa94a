"""An axis as two masses on a spring; its equations are in `kernels`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from .kernels import follow_axis
from .law import Law
from .mjcf import Drive

STEP = 10e-6  # of the integration [s]


@dataclass(frozen=True)
class Motion:
    """An axis at the instants of the samples, (n,) each.

    Attributes:
        load: position of the load [mm].
        demand: torque demand, after its limit [N·m].
        torque: of the motor, K i [N·m].
    """

    load: np.ndarray
    demand: np.ndarray
    torque: np.ndarray


class Plant(NamedTuple):
    """The numbers of the equations, as compiled code takes them."""

    motor: float  # nut + rotor gear² [kg]
    load: float
    drag: float  # damping + rotor_damping gear² [N·s/m]
    stiffness: float
    flex_damping: float
    gear: float
    constant: float
    resistance: float
    inductance: float
    bus: float
    bristle: float
    bristle_damping: float
    coulomb: float
    static: float
    stribeck: float

    @classmethod
    def of(cls, drive: Drive) -> Plant:
        return cls(
            drive.nut + drive.rotor * drive.gear**2,
            drive.load,
            drive.damping + drive.rotor_damping * drive.gear**2,
            *(getattr(drive, name) for name in cls._fields[3:]),
        )


def within_current(law: Law, drive: Drive) -> Law:
    """Return the law with its torque limited to that of the drive's current limit."""
    return replace(law, limit=min(law.limit, drive.constant * drive.current))


def follow(drive: Drive, law: Law, setpoints: np.ndarray, step: float = STEP) -> Motion:
    """Return the motion of an axis that starts at rest at its first setpoint.

    Args:
        drive: the axis, a slide.
        law: its servo.
        setpoints: commanded positions, one per period, (n,) [mm].
        step: longest step of the integration; it is shortened so as to divide period and delay [s].
    """
    numbers = within_current(law, drive).numbers()
    return Motion(*follow_axis(Plant.of(drive), numbers, law.steps(step), np.ascontiguousarray(setpoints)).T)
