"""PD: position error and its change alone, without integral and feed-forward."""

from __future__ import annotations

from gantrysim.servo.gains import FEED_FORWARD
from gantrysim.servo.laws.pid import Pid


class Pd(Pid):
    """PID whose other gains are 0, so that its tick and its stability are those of PID."""

    name = "pd"
    meaning = "kp and kd alone, without integral and feed-forward"
    unused_gains = ("ki", *FEED_FORWARD)


PD = Pd()
