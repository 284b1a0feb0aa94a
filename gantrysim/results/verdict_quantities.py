"""Values of the verdict that no other result has, as people see them."""

from __future__ import annotations

from typing import Any

from gantrysim.base.quantity import Quantity

BEAD_WIDTH_ERROR = Quantity[Any](
    "bead_width_error",
    label="bead width error",
    unit="%",
    form=".1f",
    meaning="Largest deviation of the bead's width from the nominal one, away from starts and stops",
    path=(),
)
# of a `BeadWidth`
WIDTH_SHARE = Quantity[Any](
    "width_out_of_tolerance",
    label="width out of tolerance",
    unit="%",
    form=".1f",
    meaning="Share of the length between starts and stops whose width is out of tolerance",
    path=("share",),
    factor=100.0,
)
BLOBS = Quantity[Any](
    "blobs",
    label="blobs",
    unit="",
    form=".0f",
    meaning="Number of contiguous stretches that are too wide",
    path=("blobs",),
    factor=1,
)
GAPS = Quantity[Any](
    "gaps",
    label="gaps",
    unit="",
    form=".0f",
    meaning="Number of contiguous stretches that are too narrow",
    path=("gaps",),
    factor=1,
)
TURN_CLEARANCE_ERROR = Quantity[Any](
    "turn_clearance_error",
    label="clearance of turns off by",
    unit="mm",
    form=".2f",
    meaning="Largest deviation of the clearance of neighbouring turns from the requested one",
    path=(),
)
# of a `Ploughing`
PLOUGHED = Quantity[Any](
    "bead_ploughed",
    label="bead ploughed",
    unit="mm",
    form=".1f",
    meaning="Length of bead that the needle has passed through after laying it, each piece counted once",
    path=("length",),
)
PASSES = Quantity[Any](
    "passes_through_glue",
    label="passes through glue",
    unit="",
    form=".0f",
    meaning="Number of passes of the needle through glue",
    path=("passes",),
    factor=1,
)
PLOUGHED_DEPTH = Quantity[Any](
    "plough_depth",
    label="depth of the needle",
    unit="mm",
    form=".2f",
    meaning="Greatest depth of the needle's face below the top of glue that it passes through",
    path=("depth",),
)
# of dots
DOT_VOLUME_ERROR = Quantity[Any](
    "dot_volume_error",
    label="volume of a dot off by",
    unit="%",
    form=".1f",
    meaning="Largest deviation of a dot's volume from the requested one",
    path=(),
)
DOT_PLACE_ERROR = Quantity[Any](
    "dot_place_error",
    label="dot off its place by",
    unit="mm",
    form=".3f",
    meaning="Largest distance of a dot from its commanded place in plan view",
    path=(),
)
DOT_STRING = Quantity[Any](
    "dot_string",
    label="glue of a dot drawn into a string",
    unit="%",
    form=".1f",
    meaning="Largest share of a dot's glue that flows while the needle is away: it lifts before the valve has closed",
    path=(),
)
TORQUE_RESERVE = Quantity[Any](
    "torque_reserve",
    label="torque reserve",
    unit="%",
    form=".1f",
    meaning="Share of an axis' torque limit that remains unused",
    path=(),
)
SPEED_RESERVE = Quantity[Any](
    "speed_reserve",
    label="speed reserve",
    unit="%",
    form=".1f",
    meaning="Share of an axis' speed limit that remains unused",
    path=(),
)
STEPS_LOST = Quantity[Any](
    "full_steps_lost",
    label="full steps lost",
    unit="",
    form=".0f",
    meaning="Largest distance of a stepper from its command, in full steps",
    path=(),
)
# of a `gantrysim.glue.dispenser.driven.Load`, by its name
LOADS = {
    name: Quantity[Any](
        f"dispenser_{name}",
        label=f"{name} of the dispenser's motor",
        unit=unit,
        form=".4g",
        meaning=f"Largest {name} that the commanded flow asks of {what}; its place is where it first exceeds the limit",
        path=("value",),
    )
    for name, unit, what in (
        ("force", "N", "the motor of a piston"),
        ("torque", "N·m", "the motor of a pump"),
        ("speed", "mm/s, rev/s", "a motor that follows E, of a piston or a pump"),
    )
}

VERDICT_VALUES = (
    BEAD_WIDTH_ERROR,
    WIDTH_SHARE,
    BLOBS,
    GAPS,
    TURN_CLEARANCE_ERROR,
    PLOUGHED,
    PASSES,
    PLOUGHED_DEPTH,
    DOT_VOLUME_ERROR,
    DOT_PLACE_ERROR,
    DOT_STRING,
    TORQUE_RESERVE,
    SPEED_RESERVE,
    STEPS_LOST,
    *LOADS.values(),
)
