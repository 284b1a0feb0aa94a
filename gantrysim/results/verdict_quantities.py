"""Values of the verdict that no other result has, as people see them."""

from __future__ import annotations

from typing import Any

from gantrysim.base.quantity import Quantity

BEAD_WIDTH_ERROR = Quantity[Any](
    "bead_width_error",
    "bead width error",
    "%",
    ".1f",
    "Largest deviation of the bead's width from the nominal one, away from starts and stops",
    (),
)
# of a `BeadWidth`
WIDTH_SHARE = Quantity[Any](
    "width_out_of_tolerance",
    "width out of tolerance",
    "%",
    ".1f",
    "Share of the length between starts and stops whose width is out of tolerance",
    ("share",),
    100.0,
)
BLOBS = Quantity[Any]("blobs", "blobs", "", ".0f", "Number of contiguous stretches that are too wide", ("blobs",), 1)
GAPS = Quantity[Any]("gaps", "gaps", "", ".0f", "Number of contiguous stretches that are too narrow", ("gaps",), 1)
TURN_CLEARANCE_ERROR = Quantity[Any](
    "turn_clearance_error",
    "clearance of turns off by",
    "mm",
    ".3f",
    "Largest deviation of the clearance of neighbouring turns from the requested one",
    (),
)
# of a `Ploughing`
PLOUGHED = Quantity[Any](
    "bead_ploughed",
    "bead ploughed by the needle",
    "mm",
    ".1f",
    "Length of bead that the needle has passed through after laying it, each piece counted once",
    ("length",),
)
PASSES = Quantity[Any](
    "passes_through_glue",
    "passes through glue",
    "",
    ".0f",
    "Number of passes of the needle through glue",
    ("passes",),
    1,
)
PLOUGHED_DEPTH = Quantity[Any](
    "plough_depth",
    "depth of the needle",
    "mm",
    ".2f",
    "Greatest depth of the needle's face below the top of glue that it passes through",
    ("depth",),
)
TORQUE_RESERVE = Quantity[Any](
    "torque_reserve", "torque reserve", "%", ".1f", "Share of an axis' torque limit that remains unused", ()
)
SPEED_RESERVE = Quantity[Any](
    "speed_reserve", "speed reserve", "%", ".1f", "Share of an axis' speed limit that remains unused", ()
)
STEPS_LOST = Quantity[Any](
    "full_steps_lost", "full steps lost", "", ".0f", "Largest distance of a stepper from its command, in full steps", ()
)

VERDICT_VALUES = (
    BEAD_WIDTH_ERROR,
    WIDTH_SHARE,
    BLOBS,
    GAPS,
    TURN_CLEARANCE_ERROR,
    PLOUGHED,
    PASSES,
    PLOUGHED_DEPTH,
    TORQUE_RESERVE,
    SPEED_RESERVE,
    STEPS_LOST,
)
