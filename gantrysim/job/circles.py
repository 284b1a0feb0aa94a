"""A program that runs a circle, for a job that tests a machine whatever its controller is."""

from __future__ import annotations

from typing import Any


def circle_program(radius: float, speed: float, acceleration: float, angle: float) -> dict[str, Any]:
    """Return a program that runs along a circle about the zero of the axes x and y, from the positive x axis on.

    softMC's CIRCLE takes any angle in one command, so that nothing stops the motion between two turns.

    Args:
        radius: of the circle [mm].
        speed: along it [mm/s].
        acceleration: along it at start and end [mm/s²].
        angle: of the motion, counter-clockwise positive [deg].
    """
    return {
        "controller": "softmc.Program",
        "program": f"Circle G1 Angle={angle:.10g} CircleCenter={{0, 0}}",
        "start": [radius, 0.0],
        "group": {"velocity": speed, "acceleration": acceleration},
    }
