"""The plots of the pages of start and of tasks, each a function that draws one; scripts/pictures.py saves them."""

import csv
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

import gantrysim as gs
from gantrysim.base.arrays import Floats
from gantrysim.base.quantity import UM
from gantrysim.compare.comparison import Comparison
from gantrysim.compare.measured import Assignment, Trace
from gantrysim.glue.bead import Bead
from gantrysim.machine.perturbation import Perturbation
from gantrysim.metrics.analysis import Analysis
from gantrysim.report.plots.style import COLOURS, thinned_line
from gantrysim.results.colours import BAD, GOOD, INK, NEAR, RUNS
from gantrysim.study.machine import MachineStudy
from gantrysim.study.run import run_study
from gantrysim.study.speed import SpeedStudy
from gantrysim.study.tuning import TuningStudy
from gantrysim.tables.reading import read_table

ROOT = Path(__file__).parent.parent
BEFORE, AFTER, THIRD, FOURTH = RUNS[:4]
GLUE = {"dispenser.flow": 0.0, "dispenser.area": 3.0}  # of fanuc-spiral, in proportion to the speed
LEADS = {"dispenser.start_lead": 0.012, "dispenser.stop_lead": 0.012}


def titled_block(page: str, title: str) -> str:
    """Return the file that a page shows under a title."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    return text.partition(f'title="{title}"\n')[2].partition("```\n")[0]


def error_along(axes, run, label: str, colour: str) -> None:
    """Draw the distance of the nozzle from the path over the length of the path."""
    nozzle = Analysis(run).nozzle
    largest = UM * nozzle.distance.max()
    text = f"{label}: at most {largest:.0f} µm"
    axes.plot(*thinned_line(nozzle.s, UM * nozzle.distance), color=colour, lw=1.3, label=text)


def label_error(axes) -> None:
    axes.set(xlabel="distance along the path [mm]", ylabel="contour error [µm]", ylim=(0, None))
    axes.margins(x=0.01)
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)


def verdict(figure: Figure) -> None:
    """Draw the share of its limit that every check uses."""
    job = gs.Job.load("fanuc-spiral")
    checks = [(row.name, check) for row in gs.Verdict.of(job, job.run()).rows for check in row.checks]
    axes = figure.add_subplot()
    colours = {"pass": GOOD, "warn": NEAR, "fail": BAD}
    shares = [100 * check.usage for _, check in checks]
    places = np.arange(len(checks))
    axes.barh(places, shares, color=[colours[check.state] for _, check in checks], height=0.65)
    axes.set_yticks(places, [f"{row}: {check.quantity}" for row, check in checks])
    axes.invert_yaxis()
    for limit, name in ((80, "warn"), (100, "fail")):
        axes.axvline(limit, color=INK, lw=1.2, ls="--")
        side, shift = ("right", -3) if name == "warn" else ("left", 3)
        axes.annotate(
            name, (limit, -0.9), (shift, 0), textcoords="offset points", ha=side, va="center", annotation_clip=False
        )
    axes.grid(axis="y", visible=False)
    axes.set(xlabel="share of the limit that is used [%]", xlim=(0, 1.08 * max(shares)))


def friction(figure: Figure) -> None:
    axes = figure.add_subplot()
    job = gs.Job.load("delta-arc")
    error_along(axes, job.run(), "PID", BEFORE)
    error_along(axes, job.changed({"servo.law": ["pid", "friction"]}).run(), "PID and friction", AFTER)
    label_error(axes)


def flow(figure: Figure) -> None:
    """Draw the width of the bead at the start, on the way and at the stop, after each of the three steps."""
    job = gs.Job.load("fanuc-spiral")
    compensated = {**GLUE, "dispenser.advance": 0.04}
    steps = (
        ("fixed flow", {}, BEFORE),
        ("flow by speed", GLUE, THIRD),
        ("lag compensated", compensated, FOURTH),
        ("with leads", {**compensated, **LEADS}, AFTER),
    )
    panels = figure.subplots(1, 3, sharey=True, width_ratios=(1, 1.4, 1))
    for label, changes, colour in steps:
        changed = job.changed(changes)
        bead = Bead(changed.run(), changed.bead)
        dispensed = bead.length[bead.run.dispense]
        begin = dispensed[0]
        end = dispensed[-1] - begin
        for panel in panels:
            panel.plot(bead.place - begin, bead.width, color=colour, lw=1.5, label=label)
    nominal = float(bead.nominal_section.width[0])
    parts = (("start", (-3, 22)), ("on the way", (0, end)), ("stop", (end - 20, end + 5)))
    for panel, (title, limits) in zip(panels, parts, strict=True):
        panel.axhspan(0.9 * nominal, 1.1 * nominal, color=COLOURS["requested"], alpha=0.2, lw=0)
        panel.set(xlim=limits, title=title, xlabel="along the bead [mm]")
    panels[0].set(ylabel="width of the bead [mm]", ylim=(0, 6.9))
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)


def speed(figure: Figure) -> None:
    """Draw the closest limit over the speed, from the runs of the study."""
    study = SpeedStudy(gs.Job.load("softmc-arc", ["dispenser.advance=0.025", "servo.law=pd"]))
    with tempfile.TemporaryDirectory() as folder:
        run_study(study, Path(folder))
        with (Path(folder) / "study.csv").open(encoding="utf-8", newline="") as stream:
            rows = [row for row in csv.DictReader(stream) if row["status"] == "ok"]
    speeds = np.array([float(row["speed_mm_s"]) for row in rows])
    limits = ("path", "glue", "stability", "machine")
    usage = np.array([max(float(row[f"{name}_limit_use_percent"] or "inf") for name in limits) for row in rows])
    order = speeds.argsort()
    axes = figure.add_subplot()
    axes.plot(speeds[order], usage[order], color=COLOURS["requested"], lw=1.2)
    within = usage <= 100
    axes.plot(speeds[within], usage[within], "o", color=GOOD, label="within the tolerance")
    axes.plot(speeds[~within], usage[~within], "x", mew=2, color=BAD, label="out of tolerance")
    axes.axhline(100, color=INK, lw=1.2, ls="--")
    axes.set(xlabel="programmed speed [mm/s]", ylabel="closest limit, used [%]", ylim=(0, 250), xlim=(0, 600))
    axes.legend()


def seal_beside_another(perturbation: Perturbation, columns: Callable[[gs.Run], dict[str, Floats]]) -> Comparison:
    """Compare columns of a run of the seal on a machine that differs, in µm, with the simulation of the nominal one."""
    job = gs.Job.load(ROOT / "examples" / "seal.ngc")
    run = job.run()
    machine = job.built_machine
    other = job.run(machine=machine.perturbed(perturbation))
    log = {"time": UM * other.time, **columns(other)}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "trace.csv"
        heads = [name.replace(".", "_") for name in log]
        np.savetxt(file, np.column_stack(list(log.values())), delimiter=",", header=",".join(heads), comments="")
        units = [f"{name}={head}[{'ms' if name == 'time' else 'um'}]" for name, head in zip(log, heads, strict=True)]
        given = Assignment.parse(",".join(units))
        trace = Trace.of(read_table(file, given.blocks), given, run)
    return Comparison.of(trace, run, machine)


def draw_comparison(figure: Figure, comparison: Comparison) -> None:
    """Draw the error along the path, measured and simulated, and what the model does not explain."""
    upper, lower = figure.subplots(2, sharex=True, height_ratios=(2, 1))
    for budget, label, colour in (
        (comparison.measured, "measured", BEFORE),
        (comparison.simulated, "simulated", AFTER),
    ):
        s = budget.analysis.nozzle.s
        upper.plot(*thinned_line(s, UM * budget.contour.lateral), color=colour, lw=1.1, label=label)
    s = comparison.measured.analysis.nozzle.s
    lower.plot(*thinned_line(s, UM * comparison.difference["contour"][:, 0]), color=FOURTH, lw=1.1)
    upper.set(ylabel="error [µm]")
    upper.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    lower.set(ylabel="difference [µm]", xlabel="distance along the path [mm]")


def measured_nozzle(figure: Figure) -> None:
    def columns(run: gs.Run) -> dict[str, Floats]:
        noise = np.random.default_rng(1).normal(0, 0.5, (len(run.time), 2))
        return dict(zip("xy", (UM * run.nozzle[:, :2] + noise).T, strict=True))

    draw_comparison(figure, seal_beside_another(Perturbation(friction=1.5, payload=0.5), columns))


def measured_axes(figure: Figure) -> None:
    def columns(run: gs.Run) -> dict[str, Floats]:
        axes = run.axes
        commanded = {f"commanded.{axis}": UM * run.commanded[:, k] for k, axis in enumerate(axes)}
        return {**commanded, **{f"encoder.{axis}": UM * run.encoder[:, k] for k, axis in enumerate(axes)}}

    draw_comparison(figure, seal_beside_another(Perturbation(friction=2.0), columns))


def gains(figure: Figure) -> None:
    """Draw where the gains of each controller act: before the drive's torque, or before its speed."""
    axes = figure.add_subplot()
    axes.set(xlim=(0, 10), ylim=(0.2, 4.1))
    axes.axis("off")
    rows = (
        (3.1, "torque drive", "PID", "P, I, D: torque per error\n[N·m/mm, DAC per edge]", "torque"),
        (1.1, "velocity drive", "position loop", "KPP, 1825: speed per error\n[1/s, 0.01/s]", "speed"),
    )
    for height, title, loop, words, sent in rows:
        axes.text(0.05, height + 0.55, title, weight="bold", va="bottom")
        boxes = ((0.1, "demand\n− encoder"), (2.6, loop), (5.6, "drive"), (8.1, "motor"))
        for left, text in boxes:
            shape = FancyBboxPatch(
                (left, height - 0.35), 1.7, 0.7, boxstyle="round,pad=0.04", fc="#eef2f6", ec=INK, lw=1.1
            )
            axes.add_patch(shape)
            axes.text(left + 0.85, height, text, ha="center", va="center")
        for begin, end, text in ((1.85, 2.55, "error"), (4.35, 5.55, sent), (7.35, 8.05, "current")):
            axes.annotate("", (end, height), (begin, height), arrowprops={"arrowstyle": "->", "color": INK})
            axes.text(0.5 * (begin + end), height + 0.08, text, ha="center", va="bottom", fontsize=9)
        axes.text(3.45, height - 0.5, words, ha="center", va="top", color=AFTER, fontsize=9)
    axes.text(
        6.45, 0.6, "KVP, KVI: torque per\nspeed error, in the drive", ha="center", va="top", color=AFTER, fontsize=9
    )


def cluster(figure: Figure) -> None:
    """Draw the largest contour error of many machines of one build."""
    limit = 55.0  # [µm]
    study = MachineStudy(gs.Job.load("fanuc-spiral"), samples=64, tolerance=limit)
    with tempfile.TemporaryDirectory() as folder:
        run_study(study, Path(folder))
        with (Path(folder) / "study.csv").open(encoding="utf-8", newline="") as stream:
            rows = [row for row in csv.DictReader(stream) if row["status"] == "ok"]
    largest = np.array([float(row["contour_max_um"]) for row in rows])
    axes = figure.add_subplot()
    edges = np.arange(limit - 25, limit + 30, 2.5)
    axes.hist(largest[largest <= limit], edges, color=GOOD, label="within the tolerance")
    axes.hist(largest[largest > limit], edges, color=BAD, label="out of tolerance")
    axes.axvline(limit, color=INK, lw=1.2, ls="--")
    axes.set(xlabel="largest contour error of a machine [µm]", ylabel="machines")
    axes.legend()


def law(figure: Figure) -> None:
    """Draw the contour error with the law of the page, and with the servo's own."""
    axes = figure.add_subplot()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "flip.py"
        file.write_text(titled_block("laws.md", "flip.py"), encoding="utf-8")
        job = gs.Job.load("softmc-arc")
        error_along(axes, job.run(), "pid", BEFORE)
        changed = gs.Job.load("softmc-arc", [f'servo.law="{file}:pid"'], allow_code=True)
        error_along(axes, changed.run(), "flip.py:pid", AFTER)
    label_error(axes)


def agent(figure: Figure) -> None:
    """Draw the error of the bead's width over an episode, with the agent of the example and without."""
    code = (ROOT / "examples" / "train_agent.py").read_text(encoding="utf-8")
    names: dict[str, Any] = {}
    exec(code.partition("\ndef mean_return")[0], names)  # the training
    axes = figure.add_subplot()
    policies = (
        ("pressure left alone", BEFORE, lambda _: np.zeros(1, np.float32)),
        ("agent", AFTER, lambda seen: names["agent"].predict(seen, deterministic=True)[0]),
    )
    for label, colour, policy in policies:
        environment = names["gymnasium"].make(names["TASK"])
        observation, _ = environment.reset(seed=1003)
        errors = []
        done = False
        while not done:
            observation, _, terminated, truncated, info = environment.step(policy(observation))
            errors.append(100 * info["width_rms"])
            done = terminated or truncated
        axes.plot(0.1 * np.arange(1, len(errors) + 1), errors, color=colour, lw=1.4, label=label)
    axes.set(xlabel="time [s]", ylabel="error of the width, rms [%]", ylim=(0, None))
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)


def tune(figure: Figure) -> None:
    """Draw the contour error with derived and with tuned gains."""
    job = gs.Job.load("softmc-arc")
    study = TuningStudy(job, budget=40)
    with tempfile.TemporaryDirectory() as folder:
        rows = run_study(study, Path(folder)).rows
    axes = figure.add_subplot()
    error_along(axes, job.run(), "derived gains", BEFORE)
    error_along(axes, study.run(study.history(rows).best.servo), "tuned gains", AFTER)
    label_error(axes)


def improvement(figure: Figure) -> None:
    """Draw the shares of the limits of path and glue that a job uses, with each lever at its best setting."""
    result = gs.improve(gs.Job.load("delta-arc"))
    bars = {"unchanged": shares_of(result.verdict)}
    for trial in result.trials:
        if trial.outcome.verdict is None:
            continue
        shares = shares_of(trial.outcome.verdict)
        name = trial.lever.name
        bars[name] = min(bars.get(name, shares), shares, key=sum)
    bars["best combination"] = shares_of(result.improved)
    axes = figure.add_subplot()
    places = np.arange(len(bars))
    for row, (name, shift, colour) in enumerate((("path", -0.2, AFTER), ("glue", 0.2, THIRD))):
        axes.barh(places + shift, [both[row] for both in bars.values()], color=colour, height=0.36, label=name)
    axes.set_yticks(places, list(bars))
    axes.invert_yaxis()
    axes.axvline(100, color=INK, lw=1.2, ls="--")
    axes.grid(axis="y", visible=False)
    axes.set(xlabel="share of the limit that is used [%]")
    axes.legend(loc="lower right")


def shares_of(verdict: gs.Verdict) -> tuple[float, ...]:
    """Return the largest shares of the limits of path and glue [%]."""
    return tuple(100 * max(check.usage for check in verdict[row].checks) for row in ("path", "glue"))


# name of the picture: what draws it, and its width and height [inch]
PAGE_PLOTS: dict[str, tuple[Callable[[Figure], None], float, float]] = {
    "how-to-verdict": (verdict, 7.2, 3.6),
    "how-to-friction": (friction, 7.2, 3.2),
    "how-to-flow": (flow, 7.2, 3.4),
    "how-to-speed": (speed, 7.2, 3.2),
    "how-to-measured": (measured_nozzle, 7.2, 4.0),
    "start-trace": (measured_axes, 7.2, 4.0),
    "how-to-gains": (gains, 7.2, 3.6),
    "how-to-cluster": (cluster, 7.2, 3.0),
    "how-to-law": (law, 7.2, 3.2),
    "how-to-agent": (agent, 7.2, 3.0),
    "how-to-improve": (improvement, 7.2, 4.6),
    "how-to-tune": (tune, 7.2, 3.2),
}
