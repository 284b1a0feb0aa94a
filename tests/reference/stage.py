"""The machine `stage`: a table that turns, x on it, y on x, each axis two masses; its equations are in `kernels`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .kernels import follow_table
from .law import Law
from .mjcf import Body, Drive
from .two_mass import STEP, Plant, within_current

AXES = 3  # th, x, y
PER_SI = np.array([180 / math.pi, 1e3, 1e3])  # degrees and millimetres
NEEDLE = (-200.0, 0.0)  # [mm]

# what turns with the table, and the slides that carry it: position in the state of its x and y, or -1
CARRIED = {"table": (-1, -1), "x_nut": (1, -1), "x_slide": (4, -1), "y_nut": (4, 2), "y_slide": (4, 5)}


def follow_stage(
    drives: Sequence[Drive], bodies: dict[str, Body], laws: Sequence[Law], setpoints: np.ndarray, step: float = STEP
) -> tuple[np.ndarray, np.ndarray]:
    """Return load positions (n, 3) [deg, mm, mm], and torque demands and motor torques (n, 6) [N·m], at the ticks.

    Args:
        drives: th, x and y.
        bodies: by name.
        laws: the servos of the axes.
        setpoints: commanded positions, one per period, (n, 3) [deg, mm, mm].
        step: longest step of the integration [s].
    """
    masses = np.array([bodies[name] for name in CARRIED])
    slides = np.array(list(CARRIED.values()))
    numbers = np.array([within_current(law, drive).numbers() for law, drive in zip(laws, drives, strict=True)])
    table, *others = drives
    plants = tuple(Plant.of(drive) for drive in (table, *(replace(slide, nut=0.0) for slide in others)))
    rows = follow_table(plants, masses, slides, numbers, laws[0].steps(step), np.ascontiguousarray(setpoints), PER_SI)
    return rows[:, :AXES], rows[:, AXES:]


def on_the_work(position: np.ndarray) -> np.ndarray:
    """Return the needle in the work frame, (n, 2) [mm]: R(-th) K + (x, y)."""
    angle = np.radians(position[:, 0])
    x, y = NEEDLE
    turned = np.stack([np.cos(angle) * x + np.sin(angle) * y, -np.sin(angle) * x + np.cos(angle) * y], axis=1)
    return turned + position[:, 1:]
