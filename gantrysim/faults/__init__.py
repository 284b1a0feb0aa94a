"""Deliberate faults: what is to fail in a run, when, and by how much.

Times are those of the run. Faults of the encoder, the drive, the axis and the setpoints begin and end with a servo
tick, the first at or after their time; faults of the dispenser at their very time.

A new fault is a file here, and its line in `AnyFault` below.
"""

from dataclasses import fields
from typing import Any, TypeAlias

from gantrysim.faults.air_bubble import ATMOSPHERE, AirBubble
from gantrysim.faults.bus_sag import BusSag
from gantrysim.faults.clogged_nozzle import CloggedNozzle
from gantrysim.faults.dripping_nozzle import DrippingNozzle
from gantrysim.faults.encoder_dropout import EncoderDropout
from gantrysim.faults.encoder_glitch import EncoderGlitch
from gantrysim.faults.encoder_slip import EncoderSlip
from gantrysim.faults.fault import InjectedFault
from gantrysim.faults.lost_packets import LostPackets
from gantrysim.faults.open_winding import OpenWinding
from gantrysim.faults.slipping_axis import SlippingAxis
from gantrysim.faults.stuck_axis import StuckAxis

# In the order in which they act on the same value: an encoder that stands still reports no glitch, an open winding has
# no voltage, and a clogged nozzle holds back its share of what drips too.
AnyFault: TypeAlias = (
    EncoderGlitch
    | EncoderSlip
    | EncoderDropout
    | StuckAxis
    | SlippingAxis
    | BusSag
    | OpenWinding
    | LostPackets
    | DrippingNozzle
    | AirBubble
    | CloggedNozzle
)

KINDS: dict[str, Any] = {  # the dataclasses by kind
    str(next(field.default for field in fields(fault) if field.name == "kind")): fault for fault in AnyFault.__args__
}


def in_acting_order(faults: Any) -> list[InjectedFault]:
    """Return faults in the order in which they act on the same value; those of one kind as they are given."""
    kinds = list(KINDS)
    return sorted(faults, key=lambda fault: kinds.index(fault.kind))
