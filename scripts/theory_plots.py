"""The plots of the pages of theory, each a function that draws one; scripts/pictures.py saves them."""

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure

import gantrysim as gs
from gantrysim.controllers.trio import Basic, MoveSpiral
from gantrysim.glue.bead.section import Section
from gantrysim.identify.identification import identify
from gantrysim.identify.log import Log
from gantrysim.identify.plan import excitation
from gantrysim.identify.whole_run import fitted_machine
from gantrysim.machine.perturbation import Perturbation
from gantrysim.metrics.analysis import Analysis
from gantrysim.report.plots.style import COLOURS
from gantrysim.results.colours import INK, RUNS
from gantrysim.servo.stability.margins import Plant

BEFORE, AFTER, THIRD = RUNS[:3]
POINTS = {"textcoords": "offset points"}


def involute(figure: Figure) -> None:
    """Draw the spiral of a slow loop beside the path that is meant, and the error of three loops along it."""
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.3))
    machine = gs.Machine("xy")
    period = gs.Servo.derive(machine.axes).period
    for loop, colour in ((2.0, BEFORE), (1.0, THIRD), (0.5, AFTER)):
        spiral = MoveSpiral(diameter=120, turns=2, thickness=20, speed=100, loop_period=loop)
        setpoints = spiral.setpoints(period)
        run = gs.perfect_follower(machine, setpoints)
        nozzle = Analysis(run).nozzle
        right.plot(nozzle.s, nozzle.distance, color=colour, lw=1.3, label=f"T = {loop:g} s")
        if colour == BEFORE:
            line = run.requested.position(np.linspace(0, run.requested.length, 2000))
            left.plot(line[:, 0], line[:, 1], color=COLOURS["requested"], lw=1.2, label="involute")
            left.plot(run.nozzle[:, 0], run.nozzle[:, 1], color=BEFORE, lw=1.2, label="arcs, T = 2 s")
    left.set(xlabel="x [mm]", ylabel="y [mm]")
    left.set_aspect("equal", adjustable="datalim")
    right.set(xlabel="distance along the path [mm]", ylabel="error [mm]", ylim=(0, None))
    for axes in (left, right):
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, fontsize="small", handlelength=1.2)


def margins(figure: Figure) -> None:
    """Draw the open loop of an axis around -1, and its sensitivity."""
    machine = gs.Machine("xy")
    servo = gs.Servo.derive(machine.axes, integral_time=0.03)
    plant = Plant.of(machine, servo.period, servo.delay, drives=servo.loop_drives)
    frequency = np.geomspace(2, 500, 3000)
    loop = plant.loop(servo, frequency)[:, 1]
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.3))
    circle = np.exp(1j * np.linspace(0, 2 * np.pi, 200))
    left.plot(loop.real, loop.imag, color=AFTER, lw=1.4, label="L, axis y")
    left.fill(-1 + 0.5 * circle.real, 0.5 * circle.imag, color=BEFORE, alpha=0.2, lw=0, label="|S| > 2")
    left.plot(-1, 0, "+", color=INK, ms=9, mew=1.5)
    left.set(xlim=(-2.6, 0.6), ylim=(-1.6, 1.6), xlabel="real part", ylabel="imaginary part")
    left.set_aspect("equal")
    left.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2, fontsize="small")
    sensitivity = np.abs(1 / (1 + loop))
    right.loglog(frequency, sensitivity, color=AFTER, lw=1.4)
    right.axhline(2, color=BEFORE, lw=1.2, ls="--")
    peak = int(sensitivity.argmax())
    text = f"{sensitivity[peak]:.2f} at {frequency[peak]:.0f} Hz"
    right.annotate(text, (frequency[peak], sensitivity[peak]), (-6, 14), textcoords="offset points", ha="center")
    right.set(xlabel="frequency [Hz]", ylabel="|S|", ylim=(0.01, 4))


def budget(figure: Figure) -> None:
    """Draw the four points of a tick beside a path, with their feet."""
    axes = figure.add_subplot()
    radius = 10.0
    angles = np.radians(np.linspace(50, 130, 200))
    axes.plot(radius * np.cos(angles), radius * np.sin(angles), color=COLOURS["requested"], lw=2)
    axes.annotate("requested path", radius * np.array([np.cos(angles[6]), np.sin(angles[6])]), (8, 4), **POINTS)
    points = (
        ("command", 76, 0.35, COLOURS["program"], (8, 2), "program", (-34, 6)),
        ("encoder", 88, 1.5, COLOURS["servo"], (10, -2), "servo", (26, 6)),
        ("motor", 95, 1.15, COLOURS["encoder"], (10, -14), "encoder", (-2, 10)),
        ("nozzle", 106, 1.9, COLOURS["structure"], (-10, 8), "structure", (-4, -18)),
    )
    last = None
    for name, angle, offset, colour, shift, link, place in points:
        direction = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        foot = radius * direction
        point = (radius + offset) * direction
        axes.plot(*np.stack([foot, point]).T, color=colour, lw=1.2, ls=":")
        axes.plot(*foot, "o", ms=4, color=COLOURS["requested"])
        axes.plot(*point, "o", ms=7, color=colour)
        axes.annotate(name, point, shift, ha="left" if shift[0] > 0 else "right", **POINTS)
        start = foot if last is None else last
        axes.annotate("", point, start, arrowprops={"arrowstyle": "->", "color": colour, "lw": 1.6})
        middle = 0.5 * (start + point)
        axes.annotate(link, middle, place, color=colour, weight="bold", ha="center", **POINTS)
        last = point
    axes.set_aspect("equal")
    axes.set(xlim=(-6.2, 7.2), ylim=(7.5, 12.6))
    axes.axis("off")


def sections(figure: Figure) -> None:
    """Draw a bead that rests freely, one pressed flat, and one with a groove."""
    gap = 0.5  # [mm]
    face = 1.2
    offset = np.linspace(-2.4, 2.4, 2000)
    panels = figure.subplots(1, 3, sharey=True)
    for panel, area, title in zip(panels, (0.35, 1.1, 2.4), ("free", "pressed", "groove"), strict=True):
        section = Section(np.array([area]), np.array([gap]), 60.0, face)
        panel.fill_between(offset, section.profile(offset)[0], color="#e0a030", lw=0)
        panel.axhline(0, color=INK, lw=1.2)
        needle = ([-face / 2, face / 2, face / 2, -face / 2], [gap, gap, 1.4, 1.4])
        panel.fill(*needle, color=COLOURS["requested"], alpha=0.5, lw=0)
        panel.set(title=f"{title}, A = {area:g} mm²", xlabel="[mm]", xlim=(-2.4, 2.4), ylim=(-0.1, 1.4))
        panel.set_aspect("equal")
        panel.grid(visible=False)
    panels[0].set(ylabel="height [mm]")


def identified(figure: Figure) -> None:
    """Draw the friction of an axis: of the nominal model, of the machine that made the log, and as fitted."""
    machine = gs.Machine("xy")
    true = machine.perturbed(Perturbation(friction=1.3, payload=0.3))
    moves = Basic(excitation(machine, "trio")[0]).setpoints(0.001)
    moves_of_x = slice(4000)  # the program moves one axis after the other
    x = gs.Setpoints(0.001, ("x",), moves.position[moves_of_x, :1], moves.dispense[moves_of_x], moves.requested)
    log = Log.of(gs.simulate(true, gs.Servo.derive(machine.axes, 0.001), x))
    log = Log(("x",), log.period, log.position[:, :1], log.torque[:, :1], held=True)
    fitted = fitted_machine(identify(machine, log)).axes[0]
    speed = np.geomspace(0.05, 300, 400)
    axes = figure.add_subplot()
    for axis, label, style, colour, width in (
        (machine.axes[0], "model before", "--", COLOURS["requested"], 2),
        (true.axes[0], "machine of the log", "-", THIRD, 4),
        (fitted, "fitted", "-", AFTER, 1.4),
    ):
        stick = (axis.friction.static - axis.coulomb) * np.exp(-((speed / axis.friction.speed) ** 2))
        torque = axis.coulomb + stick + axis.viscous * speed
        axes.semilogx(speed, 1e3 * torque, style, color=colour, lw=width, label=label)
    axes.set(xlabel="speed [mm/s]", ylabel="friction [mN·m]", ylim=(0, None))
    axes.legend()


# name of the picture: what draws it, and its width and height [inch]
THEORY_PLOTS: dict[str, tuple[Callable[[Figure], None], float, float]] = {
    "theory-involute": (involute, 7.2, 3.4),
    "theory-servo": (margins, 7.2, 3.4),
    "theory-budget": (budget, 7.2, 2.8),
    "theory-bead": (sections, 7.2, 1.7),
    "theory-identification": (identified, 7.2, 3.2),
}
