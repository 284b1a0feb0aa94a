"""Notes on a run of programs: what was ignored, assumed, handled and printed."""

from __future__ import annotations

from gantrysim.controllers.trio.basic.process import State
from gantrysim.controllers.trio.basic.words import NOTED

_SHOWN = 20  # printed lines, and handled errors


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
