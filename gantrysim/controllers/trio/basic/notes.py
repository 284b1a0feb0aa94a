"""Notes on a run of programs: what was ignored, assumed, handled and printed."""

from __future__ import annotations

from gantrysim.controllers.trio.basic.moves import Arc
from gantrysim.controllers.trio.basic.process import State
from gantrysim.controllers.trio.basic.words import NOTED

_SHOWN = 20  # printed lines, and handled errors
_OFF_CIRCLE = 1e-3  # distance of an arc's stated end from its circle that rounding does not explain [mm]


def notes_of(state: State, stop_after: float, valve: int, stated: bool) -> tuple[str, ...]:
    """Return the notes.

    Args:
        state: of the controller at the end.
        stop_after: time at which programs are stopped [s].
        valve: number of the output that opens the valve.
        stated: whether the program or the job states the requested path.
    """
    notes = []
    if state.stopped:
        notes.append(
            f"stopped at {stop_after:g} s (stop_after), at line {state.stopped}: the program had not ended; its "
            "processes end there, and the axes come to rest"
        )
    notes += [remark for code in state.programs.values() for remark in code.remarks]
    notes += _off_circle(state)
    notes += [f"{error}: the program went on at its ON BASICERROR" for error in state.handled[:_SHOWN]]
    if len(state.handled) > _SHOWN:
        notes.append(f"ON BASICERROR: {len(state.handled) - _SHOWN} more errors")
    for reason in dict.fromkeys(NOTED[name] for name in sorted(state.ignored)):
        names = [name for name in sorted(state.ignored) if NOTED[name] == reason]
        notes.append(f"{', '.join(names)}: accepted without effect, {reason}")
    if valve not in state.switched:
        notes.append(
            f"OP({valve}) is never switched: the dispenser is on while the axes move, but not straight up or down"
        )
    if not stated:
        notes.append("the moves alone do not state the axes' path: the commanded trace is the requested path")
    for line in state.printed[:_SHOWN]:
        channel = "" if line.channel is None else f"#{line.channel}"
        notes.append(f"PRINT{channel} at {line.time:.3f} s: {line.text}")
    unshown = len(state.printed) - _SHOWN + state.unlogged
    return (*notes, f"PRINT: {unshown} more lines") if unshown > 0 else tuple(notes)


def _off_circle(state: State) -> list[str]:
    """Return a note on the arcs whose stated ends do not lie on their circles, by the worst of them."""
    off = [
        (move.shape.off_circle, move)
        for move in state.motion.loaded
        if isinstance(move.shape, Arc) and move.shape.off_circle > _OFF_CIRCLE
    ]
    if not off:
        return []
    worst, move = max(off, key=lambda pair: pair[0])
    return [
        f"line {move.line}: the arc's stated end lies {worst:.4g} mm off its circle ({len(off)} such arcs): as on the "
        "controller, the stated end gives the angle alone, and the arc ends on the circle"
    ]
