"""A Move Spiral as a program in Trio BASIC, with its speeds by place in TABLE."""

from __future__ import annotations

from collections.abc import Sequence

_HEAD = """\
' Spiral inwards: two virtual axes run circles, the real ones follow with a ratio x that falls
ax=0: ay=1{real}
cx={virtual}: cy={virtual}+1{rising}
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
n=1: x=1: i=0
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
  WA(lasts*x)
UNTIL MTYPE=0
CANCEL AXIS(ax)
CANCEL AXIS(ay)
{cancelled}"""


def spiral_listing(
    *,
    diameter: float,
    turns: int,
    thickness: float,
    loop_period: float,
    speeds: Sequence[tuple[float, float]],
    clockwise: bool,
    height: float,
    mode: int,
    acceleration: float | None,
    deceleration: float | None,
) -> str:
    """Return the program; arguments as of `MoveSpiral`.

    Args:
        diameter: outer diameter [mm].
        turns: number of circles.
        thickness: distance between neighbouring turns [mm].
        loop_period: time of a pass at x = 1 [s].
        speeds: pairs of a ratio x, falling from 1, and the path speed there [1, mm/s].
        clockwise: direction of rotation.
        height: climbed over all circles, 0 for a flat spiral [mm].
        mode: of MHELICAL.
        acceleration: ACCEL of the virtual axes, None to leave it [mm/s²].
        deceleration: DECEL of the virtual axes, None to leave it [mm/s²].
    """
    side = 0.5 * diameter if clockwise else -0.5 * diameter
    arc = f"0,0,{_number(side)},0,{int(clockwise)}"
    virtual = 3 if height else 2
    limits = {"ACCEL": acceleration, "DECEL": deceleration}
    ramps = "".join(f"{name}={_number(value)}\n" for name, value in limits.items() if value is not None)
    # the last speed holds: beyond the end of the circles x is above -1
    pairs = [*speeds, (-1.0, speeds[-1][1])]
    head = _HEAD.format(
        real=": az=2   ' real axes" if height else "   ' real axes",
        virtual=virtual,
        rising=": cz=cx+2   ' virtual axes" if height else "   ' virtual axes",
        diameter=_number(diameter),
        turns=turns,
        thickness=_number(thickness),
        lasts=_number(1000 * loop_period),
    )
    loop = _LOOP.format(
        connected="CONNECT(1,cz) AXIS(az)\n" if height else "",
        base="cx,cy,cz" if height else "cx,cy",
        ramps=ramps,
        first=_number(speeds[0][1]),
        circle=f"MHELICAL({arc},{_number(height / turns)},{mode})" if height else f"MOVECIRC({arc})",
        cancelled="CANCEL AXIS(az)\n" if height else "",
    )
    table = "".join(f"TABLE({2 * k},{ratio:.15g},{_number(speed)})\n" for k, (ratio, speed) in enumerate(pairs))
    return f"{head}' ratio x and path speed there, mm/s\n{table}{loop}"


def _number(value: float) -> str:
    return f"{value:.12g}"
