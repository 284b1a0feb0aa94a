"""A Move Spiral as a program in Trio BASIC, with its speeds by place in TABLE."""

from __future__ import annotations

import math
from dataclasses import dataclass

_HEAD = """\
' Spiral inwards: two virtual axes run circles, the real ones follow with a ratio x that falls
ax=0: ay=1{real}
cx={virtual}: cy={next}{rising}
outer={diameter}: turns={turns}: pitch={thickness}   ' mm
lasts={lasts}   ' time of a pass at the outer diameter, ms
fall=2*pitch*(lasts/1000)/(PI*outer^2)   ' of the ratio, per pass and mm/s
"""

_LOOP = """\
CONNECT(1,cx) AXIS(ax)
CONNECT(1,cy) AXIS(ay)
{connected}BASE({base})
{ramps}MERGE=ON
SPEED={first}
n=1: x=1: i=0{begin}
{circle}
REPEAT
  WHILE x<=TABLE(2*i+2)
    i=i+1
  WEND
  v=TABLE(2*i+1)+(TABLE(2*i)-x)/(TABLE(2*i)-TABLE(2*i+2))*(TABLE(2*i+3)-TABLE(2*i+1))
  IF x-fall*v>=1/65536 THEN x=x-fall*v
  SPEED=v/x   ' so that the real axes keep v
  IF n<turns AND NTYPE=0 THEN
    {circle}
    n=n+1
  ENDIF
  CONNECT(x,cx) AXIS(ax)
  CONNECT(x,cy) AXIS(ay)
  {wait}
UNTIL MTYPE=0
CANCEL AXIS(ax)
CANCEL AXIS(ay)
{cancelled}"""

# TICKS counts down at every tick of the servo
_EXACT_WAIT = """due=due-lasts*x
  WAIT UNTIL TICKS<=due OR MTYPE=0   ' TICKS of 1 ms, as at SERVO_PERIOD=1000"""


@dataclass(frozen=True)
class SpiralListing:
    """The program of a spiral; fields as of `MoveSpiral`, but for the speeds.

    Attributes:
        diameter: outer diameter [mm].
        turns: number of circles.
        thickness: distance between neighbouring turns [mm].
        loop_period: time of a pass at x = 1 [s].
        clockwise: direction of rotation.
        height: climbed over all circles, 0 for a flat spiral [mm].
        mhelical_mode: of MHELICAL.
        wait_resolution: above 0, passes end by WA, which rounds its time down; else at a tick of the servo [s].
        acceleration: ACCEL, inf to leave it [mm/s²].
        deceleration: DECEL, None for ACCEL [mm/s²].
        speeds: pairs of a ratio x, falling from 1, and the path speed there [1, mm/s].
    """

    diameter: float
    turns: int
    thickness: float
    loop_period: float
    clockwise: bool
    height: float
    mhelical_mode: int
    wait_resolution: float
    acceleration: float
    deceleration: float | None
    speeds: tuple[tuple[float, float], ...]

    @property
    def text(self) -> str:
        """The program."""
        diameter = self.diameter
        height = self.height
        side = 0.5 * diameter if self.clockwise else -0.5 * diameter
        arc = f"0,0,{_number(side)},0,{int(self.clockwise)}"
        virtual = 3 if height else 2
        deceleration = self.acceleration if self.deceleration is None else self.deceleration
        limits = {"ACCEL": self.acceleration, "DECEL": deceleration}
        ramps = "".join(f"{name}={_number(value)}\n" for name, value in limits.items() if math.isfinite(value))
        rounds_waits = self.wait_resolution > 0
        # the last speed holds: beyond the end of the circles x is above -1
        pairs = [*self.speeds, (-1.0, self.speeds[-1][1])]
        head = _HEAD.format(
            real=": az=2   ' real axes" if height else "   ' real axes",
            virtual=virtual,
            next=virtual + 1,
            rising=f": cz={virtual + 2}   ' virtual axes" if height else "   ' virtual axes",
            diameter=_number(diameter),
            turns=self.turns,
            thickness=_number(self.thickness),
            lasts=_number(1000 * self.loop_period),
        )
        loop = _LOOP.format(
            connected="CONNECT(1,cz) AXIS(az)\n" if height else "",
            base="cx,cy,cz" if height else "cx,cy",
            ramps=ramps,
            first=_number(self.speeds[0][1]),
            begin="" if rounds_waits else ": due=0: TICKS=0",
            wait="WA(lasts*x)" if rounds_waits else _EXACT_WAIT,
            circle=f"MHELICAL({arc},{_number(height / self.turns)},{self.mhelical_mode})"
            if height
            else f"MOVECIRC({arc})",
            cancelled="CANCEL AXIS(az)\n" if height else "",
        )
        table = "".join(f"TABLE({2 * k},{ratio:.15g},{_number(speed)})\n" for k, (ratio, speed) in enumerate(pairs))
        return f"{head}' ratio x and path speed there, mm/s\n{table}{loop}"


def _number(value: float) -> str:
    return f"{value:.12g}"
