"""Change a servo's gains by hand and compare the runs: contour error, following error, torque ripple and margins.

python scripts/tune_by_hand.py [JOB] [CHANGE ...]

A CHANGE is a gain, optionally an axis, and a factor on the job's own gain: "kp 1.2" for all axes, "kd axis y 0.5" (or
"kd y 0.5") for axis y alone, "ff 0"; commas separate several. Each CHANGE is one trial and adds to those before it.
Without any, the script prompts for them until "q". The gains of the last trial go to tuned.toml, for `gantrysim run
--servo`, the errors of all trials to trials.png.
"""

import argparse
import re
from pathlib import Path

import tomli_w
from rich.console import Console
from rich.table import Table

from gantrysim import InputError, Job, Servo, simulate
from gantrysim.base.errors import finite_of, unknown
from gantrysim.base.quantity import UM
from gantrysim.metrics.analysis import THOUSANDTH, Analysis, torque_ripple
from gantrysim.report.plots.style import sheet, thinned_line, turn_colours
from gantrysim.servo.gains import GAIN_NAMES
from gantrysim.servo.request import DERIVED_VALUES
from gantrysim.servo.stability.margins import Plant

BY_HAND = {name: (name,) for name in GAIN_NAMES} | {"ff": ("velocity_ff", "acceleration_ff")}

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("job", nargs="?", default="fanuc-spiral", help="a built-in job or a TOML file")
parser.add_argument("changes", nargs="*", metavar="CHANGE", help='such as "kp 1.2", "kd axis y 0.5" or "kp 2, ff 0"')
parser.add_argument("--out", type=Path, default=Path("out/tune-by-hand"), help="folder for tuned.toml and trials.png")
arguments = parser.parse_args()
console = Console()
try:
    job = Job.load(arguments.job)
    machine, own = job.built_machine, job.built_servo
except InputError as error:
    parser.error(str(error))
plant = Plant.of(machine, own.period, own.delay, drives=own.loop_drives)
trials: list[tuple[str, Servo, Analysis]] = []

table = Table("trial", title=f"{job.name} on {machine.name}", title_justify="left")
following = [f"{axis.name}, rms\n[{THOUSANDTH[axis.unit]}]" for axis in machine.axes]
for column in ("contour,\nrms [µm]", "\nmax [µm]", *following, "torque\nripple", "gain\nmargin", "peak\nof |S|"):
    table.add_column(column, justify="right")


def changed(servo: Servo, line: str) -> Servo:
    """Return the servo with the changes of one trial."""
    names = machine.axis_names
    for change in line.split(","):
        parts = re.fullmatch(r"(\w+)(?: +(?:axis +)?(\w+))? +(\S+)", change.strip())
        if parts is None or parts[1] not in BY_HAND:
            raise unknown("change", change.strip(), [f"{gain} [axis AXIS] FACTOR" for gain in BY_HAND])
        if parts[2] not in (None, *names):
            raise unknown("axis", parts[2], names)
        own_axis = "" if parts[2] is None else f" of axis {parts[2]}"
        factor = finite_of(f"factor of {parts[1]}{own_axis}", parts[3])
        for gain in BY_HAND[parts[1]]:
            axes = zip(names, own.per_axis(gain), servo.per_axis(gain), strict=True)
            gains = [factor * first if parts[2] in (None, name) else now for name, first, now in axes]
            servo = servo.with_values(**{gain: gains})
    return servo


def run_trial(name: str, servo: Servo) -> None:
    """Run the job with a servo, and add its errors and margin to the table."""
    run = simulate(machine, servo, job.setpoints, physics_step=job.simulation.physics_step, dispenser=job.dispenser)
    if run.fault is not None:
        raise InputError(f"{name}: fault: {run.fault}")
    trials.append((name, servo, Analysis(run)))
    values, margins = trials[-1][2].values, plant.margins(servo)
    errors = [values.contour.rms, values.contour.max, *(error.rms for error in values.following.values())]
    ripple = max(torque_ripple(run) / [axis.peak_torque for axis in machine.axes])
    least, most = min(margin.gain for margin in margins), max(margin.sensitivity for margin in margins)
    held = [f"{least:.2f}", f"{most:.2f}"] if all(margin.stable for margin in margins) else ["unstable", "unstable"]
    table.add_row(name, *(f"{UM * error:.1f}" for error in errors), f"{100 * ripple:.2f} %", *held)


def prompt() -> str:
    console.print(table)
    try:
        return console.input("change, such as kp 1.2 or kd axis y 0.5; q to quit: ").strip()
    except EOFError:
        return "q"


run_trial("unchanged", own)
for line in arguments.changes or iter(prompt, "q"):
    try:
        axes = "|".join(machine.axis_names)
        run_trial(re.sub(rf"(\w) +({axes}) +", r"\1 axis \2 ", line), changed(trials[-1][1], line))
    except InputError as error:
        if arguments.changes:
            parser.error(str(error))
        console.print(str(error), style="red", markup=False)

arguments.out.mkdir(parents=True, exist_ok=True)
servo = trials[-1][1]
settings = {name: getattr(job.servo, name) for name in ("period", "delay", "following_error_limit")}
settings |= {each.name: list(servo.per_axis(each.name)) for each in DERIVED_VALUES}
(arguments.out / "tuned.toml").write_text(tomli_w.dumps({"servo": settings}))
with sheet(9.0, 4.5) as figure:
    axes = figure.add_subplot(xlabel="distance along the path [mm]", ylabel="contour error, positive to the left [µm]")
    for (name, _, analysis), colour in zip(trials, turn_colours(len(trials)), strict=True):
        axes.plot(*thinned_line(analysis.nozzle.s, UM * analysis.nozzle.lateral), color=colour, lw=1.0, label=name)
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3)
    figure.savefig(arguments.out / "trials.png")
console.print(table)
console.print(f"gains of the last trial, and errors of all: {arguments.out}/tuned.toml, trials.png", soft_wrap=True)
