"""Faults on purpose: what is to fail in a run, when, and by how much.

Times are those of the run. Faults of the encoder, the drive, the axis and the setpoints begin and end with a servo
tick, the first at or after their time; faults of the dispenser at their very time.
"""

from gantrysim.faults.drive import (
    BusSag,
    EncoderDropout,
    EncoderGlitch,
    EncoderSlip,
    LostPackets,
    OpenWinding,
    SlippingAxis,
    StuckAxis,
)
from gantrysim.faults.fault import InjectedFault
from gantrysim.faults.kinds import KINDS, AnyFault, check_faults, fault_of
from gantrysim.faults.nozzle import ATMOSPHERE, AirBubble, CloggedNozzle, DrippingNozzle
