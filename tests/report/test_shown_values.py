"""Every number of a run's report, its summary and the command's tables against the value that it stands for.

All values of the run are replaced by different ones, so that one shown in the place of another, scaled or rounded
otherwise, is noticed.
"""

import dataclasses
import math

import numpy as np
import pytest
from matplotlib.figure import Figure

from gantrysim import Job
from gantrysim.base.quantity import with_minus
from gantrysim.cli.tables import links_table, outcome_table
from gantrysim.glue.bead import Bead
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import DESCRIPTIONS, LINKS, Budget
from gantrysim.report.page import write_run_page
from gantrysim.report.plots.budget import draw_budget
from gantrysim.report.rows import motion_rows
from gantrysim.report.summary import summary
from gantrysim.results.run_results import RunResults

from support.distinct import distinct
from support.pages import Page

RANGE = ("mean", "std", "min", "max")
RIPPLE = np.array([0.012345, 0.067891])  # [N·m]


class Shown:
    """A run whose values are all different, with its report, summary and tables."""

    def __init__(self, folder, patch):
        self.job = Job.load("an225", ("diameter=40", "turns=2", "thickness=5"))
        self.machine = self.job.built_machine
        self.run = self.job.run()
        self.bead = Bead(self.run, self.job.bead, Analysis(self.run))
        budget = Budget(self.bead.analysis)
        parts = distinct(budget.values.parts)
        self.budget = dataclasses.replace(distinct(budget.values), parts=parts)
        self.by_axis = {axis: distinct(parts["servo"]) for axis in "xy"}
        self.analysis = vars(self.bead.analysis)["values"] = distinct(budget.analysis.values)
        self.glue = vars(self.bead)["values"] = distinct(self.bead.values)
        self.margins = vars(self.job)["margins"] = distinct(self.job.margins, 3.0, 9.0)
        patch.setattr(Budget, "values", self.budget)
        patch.setattr(Budget, "contour_values", self.budget.contour)
        patch.setattr(Budget, "lag_values", self.budget.lag)
        patch.setattr(Budget, "part_values", parts)
        patch.setattr(Budget, "servo_by_axis", lambda budget, machine: self.by_axis)
        patch.setattr(Budget, "values_of", lambda budget, part: part)
        patch.setattr("gantrysim.results.run_results.torque_ripple", lambda run: RIPPLE)
        patch.setattr("gantrysim.report.sections.drawn_plot", lambda *_: Figure())
        self.drawn = Budget(self.bead.analysis)
        results = RunResults(self.job, self.machine, self.drawn, self.bead)
        write_run_page(folder / "report.html", results)
        self.page = Page(folder / "report.html")
        self.summary = summary(results)
        self.links = cells(links_table("an225", self.machine, self.drawn))
        self.caption = links_table("an225", self.machine, self.drawn).caption
        self.outcome = cells(outcome_table(self.bead.analysis, self.glue, self.margins))


@pytest.fixture
def run_to_fault(tmp_path):
    """Analysis of a run whose x seizes half a second after its begin, and whose command goes on until the limit."""
    file = tmp_path / "line.toml"
    file.write_text(
        'name = "line"\nmachine = "xy"\n[program]\ncontroller = "linuxcnc.Program"\ntext = "G1 X40 F1200"\n'
        '[dispenser]\narea = 1.0\n[[faults]]\nkind = "stuck axis"\naxis = "x"\ntime = 0.5\n',
        encoding="utf-8",
    )
    job = Job.load(file)
    return Analysis(job.run())


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        yield Shown(tmp_path_factory.mktemp("shown"), patch)


def cells(table):
    """Rows of a table of the command."""
    return list(zip(*([*column.cells] for column in table.columns), strict=True))


def um(value):
    return f"{1e3 * value:.1f}"


def places(part):
    return ", ".join(f"{value:.1f}" for value in part.point)


def part_cells(part):
    return {
        "share [%]": f"{100 * part.share:.1f}",
        "rms [µm]": um(part.rms),
        "95 % [µm]": um(part.p95),
        "max [µm]": um(part.max),
        "at s [mm]": f"{part.s:.1f}",
        "t [s]": f"{part.time:.3f}",
        "x, y, z [mm]": places(part),
    }


def part_entry(part):
    return {
        "rms_um": 1e3 * part.rms,
        "p95_um": 1e3 * part.p95,
        "max_um": 1e3 * part.max,
        "share_percent": 100 * part.share,
        "at_max": {"s_mm": part.s, "time_s": part.time, "point_mm": list(part.point)},
    }


def test_the_error_budget_in_page_table_and_summary(shown):
    tables, values = shown.page.tables(), shown.budget
    links = values.rows
    table = tables["Error normal to the requested path, its share of the mean square, and where it is largest"]
    assert table == {link: {"span": DESCRIPTIONS[link], **part_cells(part)} for link, part in links.items()}
    table = tables["Servo part by axis, to first order"]
    assert table == {axis: part_cells(part) for axis, part in shown.by_axis.items()}
    lag = f"not part of the contour error: {um(values.lag.rms)} µm rms, max {um(values.lag.max)} µm."
    assert lag in shown.page.section("error-budget")
    assert tables["By turn of the path&#39;s tangent, and before and after the turns"] == {
        turn.name: {
            "from s [mm]": f"{turn.s[0]:.1f}",
            "to s [mm]": f"{turn.s[1]:.1f}",
            **{f"{link}, rms [µm]": um(turn.parts[link].rms) for link in links},
            "contour, max [µm]": um(turn.parts["contour"].max),
        }
        for turn in values.turns
    }

    def row(name, part, span):
        return (name, um(part.rms), um(part.p95), um(part.max), f"{100 * part.share:.1f} %", span)

    rows = [row(link, part, DESCRIPTIONS[link]) for link, part in links.items()]
    rows[2:2] = [row(f"  by {axis}", part, "") for axis, part in shown.by_axis.items()]
    assert shown.links == rows
    at = values.contour
    place = f"t = {at.time:.2f} s, x = {at.point[0]:.1f}, y = {at.point[1]:.1f} mm"
    assert shown.caption.endswith(f"largest contour error at {place}")
    assert shown.summary["error_budget"] == {
        **{link: part_entry(part) for link, part in links.items()},
        "servo_by_axis": {axis: part_entry(part) for axis, part in shown.by_axis.items()},
        "turns": [
            {
                "turn": turn.turn,
                "name": turn.name,
                "s_mm": list(turn.s),
                **{link: {"rms_um": 1e3 * size.rms, "max_um": 1e3 * size.max} for link, size in turn.parts.items()},
            }
            for turn in values.turns
        ],
    }


def test_the_headline(shown):
    values = shown.budget
    link = max(values.parts, key=lambda name: values.parts[name].share)
    text = shown.page.texts("p")[3]
    assert text.startswith(f"Contour error: {um(values.contour.rms)} µm rms, almost all in {link} (")
    if values.lag.max > values.contour.max:
        assert f"up to {um(values.lag.max)} µm from its command, {um(values.lag.rms)} µm rms." in text


def test_speed_spacing_and_errors(shown):
    values = shown.analysis
    facts = shown.page.facts()
    speed, spacing = values.speed, values.spacing
    for name in ("contour", "program"):
        error = shown.budget.rows[name]
        assert facts[f"{name.capitalize()} error, rms"] == (f"{um(error.rms)} µm", f"max {um(error.max)} µm")
    sizes = f"std {spacing.std:.2f}, {spacing.min:.2f} to {spacing.max:.2f}"
    assert facts["Turn spacing"] == (f"{spacing.mean:.2f} mm", f"requested 5, {sizes}")
    assert facts["Path speed"] == (f"{speed.mean:.1f} mm/s", f"{speed.min:.1f} to {speed.max:.1f}")
    assert facts["Path length"] == (f"{values.path_length:.1f} mm", f"in {values.duration:.2f} s")
    errors = {**values.following, "along the path": values.following_along}
    assert shown.page.tables()["Following error, commanded to encoder; rms and max in the row&#39;s unit"] == {
        name: {"unit": "µm", "rms": um(error.rms), "max": um(error.max)} for name, error in errors.items()
    }
    told = {name: rest for name, *rest in shown.outcome}
    for axis, error in values.following.items():
        assert told[f"following error {axis}"] == [f"{um(error.rms)} µm", f"max {um(error.max)} µm"]
    assert told["turn spacing"] == [f"{spacing.mean:.2f} mm", f"requested 5, {sizes}"]
    assert told["path speed"] == [f"{speed.mean:.1f} mm/s", f"{speed.min:.1f} to {speed.max:.1f}"]
    assert told["path length"] == [f"{values.path_length:.1f} mm", f"in {values.duration:.2f} s"]
    assert told["end point"] == ["", "x {:.3f}, y {:.3f}, z {:.3f} mm".format(*values.end_point)]


def test_a_path_length_until_a_fault_is_that_of_the_command(run_to_fault):
    """A stuck axis stands while its command goes on: 20 mm/s for the time to the fault."""
    told = {name: (value, remark) for name, value, remark in motion_rows(run_to_fault)}
    length, remark = told["path length"]
    run = run_to_fault.run
    assert remark == f"commanded in {run.time[-1]:.2f} s, until the fault"
    assert float(length.removesuffix(" mm")) == pytest.approx(20 * run.time[-1], abs=1.0)
    assert np.ptp(run.nozzle[:, 0]) < 12.0


def test_stability_and_torque_ripple(shown):
    peaks = [axis.peak_torque for axis in shown.machine.axes]
    caption = next(text for text in shown.page.tables() if text.startswith("Stability margins at the home position"))
    rows = shown.page.tables()[caption]
    for axis, margins, ripple, peak in zip("xy", shown.margins, RIPPLE, peaks, strict=True):
        assert rows[axis] == {
            "gain margin alone": f"{margins.gain:.2f}",
            "gain margin with all it moves": f"{margins.together:.2f}",
            "lower gain margin": f"{margins.gain_lower:.2f}",
            "phase margin [deg]": f"{margins.phase:.1f}",
            "delay margin [ms]": f"{1e3 * margins.delay:.2f}",
            "peak of |S|": f"{margins.sensitivity:.2f}",
            "crossover [Hz]": f"{margins.crossover:.1f}",
            "torque ripple [N·m]": f"{ripple:.2g}",
            "relative torque ripple [%]": f"{100 * ripple / peak:.2f}",
        }
    least = {axis: min(one.gain, one.together) for axis, one in zip("xy", shown.margins, strict=True)}
    axis = min(least, key=least.get)
    phase = shown.margins["xy".index(axis)].phase
    assert f"Axis {axis} has the smallest gain margin: {least[axis]:.2f}." in shown.page.section("servo")
    told = {name: rest for name, *rest in shown.outcome}
    assert told["gain margin"] == [f"{least[axis]:.2f}", f"of {axis}, the smallest; phase margin {phase:.0f} deg"]


def test_the_gains(shown):
    servo, table = shown.job.built_servo, shown.page.tables()["Gains"]
    for a, axis in enumerate("xy"):
        for name, cells in table.items():
            assert cells[f"{axis} [mm]"] == f"{servo.per_axis(name)[a]:.4g}"


def test_the_bead(shown):
    values = shown.glue
    facts = shown.page.facts()
    ranges = {
        "cross-section": (values.section, "mm²"),
        "bead width": (values.width, "mm"),
        "clearance of turns": (values.clearance, "mm"),
        "missing at start": (values.missing_at_start, "mm"),
        "excess at stop": (values.excess_at_stop, "mm"),
        "visible delay at start": (values.delay_at_start, "mm"),
        "visible overrun at stop": (values.overrun_at_stop, "mm"),
    }
    caption = "The bead while the dispenser is on; missing and excess glue as a length of nominal bead"
    assert shown.page.tables()[caption] == {
        name: {"unit": unit, **{one: f"{getattr(sizes, one):.2f}" for one in RANGE}}
        for name, (sizes, unit) in ranges.items()
    }
    volumes = {
        "ramps": values.ramp_error,
        "starts": values.start_error,
        "running": values.running_error,
        "stops": values.stop_error,
    }
    whole, error = values.requested_volume, values.volume - values.requested_volume
    caption = "Volume beyond the nominal section along the path; the parts sum to the error"
    table = shown.page.tables()[caption]
    for name, volume in (*volumes.items(), ("error", error)):
        cells = [cell.replace("−", "-") for cell in table[name].values()]
        # to a hundred-thousandth of some 900 mm³: a part that is but rounding is zero
        assert cells[0] == f"{volume:+.{5 - math.ceil(math.log10(whole))}f}"
        assert cells[1] == f"{100 * volume / whole:.3f}"
    heads = ["volume [mm³]", "of the requested volume [%]", "description"]
    assert [*table] == [*volumes, "error"]
    assert [*table["ramps"]] == heads
    words = {"ramps": "while the path speed ramps", "starts": "until the flow has settled", "running": "flow limit"}
    words |= {"stops": "from when the dispenser closes", "error": "beyond the requested one"}
    for name, word in words.items():
        assert word in table[name]["description"]
    percent = with_minus(f"{100 * error / whole:+.2f}")
    width, clearance = values.width, values.clearance
    missing, excess = values.missing_at_start, values.excess_at_stop
    told = {name: rest for name, *rest in shown.outcome}
    nominal = f"nominal section {values.nominal:.2f} mm²"
    assert told["bead width"] == [f"{width.mean:.2f} mm", f"{width.min:.2f} to {width.max:.2f}; {nominal}"]
    sizes = f"clearance {clearance.min:.2f} to {clearance.max:.2f}; coverage {100 * values.coverage:.1f} %"
    assert told["gap between turns"] == [f"{clearance.mean:.2f} mm", sizes]
    gap = f"of their length, a gap on {100 * values.gap_share:.1f} %"
    assert told["turns that overlap"] == [f"{100 * values.overlap_share:.1f} %", gap]
    assert told["missing at start"] == [f"{missing.mean:.2f} mm", "length of nominal bead"]
    assert told["excess at stop"] == [f"{excess.mean:.2f} mm", "length of nominal bead"]
    assert told["volume"] == [f"{values.volume:.4g} mm³", f"{percent} % of {whole:.4g} requested"]
    digits = 5 - math.ceil(math.log10(whole))
    assert told["volume error"] == [
        with_minus(f"{error:+.{digits}f} mm³"),
        ", ".join(f"{name} {with_minus(f'{volume:+.{digits}f}')}" for name, volume in volumes.items()),
    ]
    assert told["height map"][1].startswith(f"glue stands {100 * values.ridge:.3g} % above the nozzle")
    same = {f"{name[0].upper()}{name[1:]}": rest for name, *rest in shown.outcome}
    for name, texts in facts.items():
        if not name.endswith("error, rms"):
            assert list(texts) == same[name]


@pytest.mark.parametrize(("sign", "words"), [(1, ("gap", "missing", "excess")), (-1, ("overlap", "excess", "missing"))])
def test_the_words_for_either_sign(shown, sign, words):
    turned = {
        name: dataclasses.replace(one, mean=sign * one.mean)
        for name in ("clearance", "missing_at_start", "excess_at_stop")
        for one in (getattr(shown.glue, name),)
    }
    glue = dataclasses.replace(shown.glue, **turned)
    told = {name: rest[0] for name, *rest in cells(outcome_table(shown.bead.analysis, glue, shown.margins))}
    between, start, stop = words
    assert told[f"{between} between turns"] == f"{shown.glue.clearance.mean:.2f} mm"
    assert told[f"{start} at start"] == f"{shown.glue.missing_at_start.mean:.2f} mm"
    assert told[f"{stop} at stop"] == f"{shown.glue.excess_at_stop.mean:.2f} mm"


def test_the_bars_of_the_budget(shown):
    figure = Figure()
    draw_budget(figure, shown.drawn)
    parts = shown.budget.parts
    assert [text.get_text() for text in figure.axes[0].texts] == [f"{100 * parts[link].share:.1f} %" for link in LINKS]
    assert [bar.get_width() for bar in figure.axes[0].patches] == [100 * parts[link].share for link in LINKS]
    turns = {str(turn.turn): 1e3 * turn.parts["contour"].rms for turn in shown.budget.turns}
    heights = {}
    for bar in figure.axes[1].patches:
        number = str(round(bar.get_x() + 0.5 * bar.get_width()))
        heights[number] = heights.get(number, 0.0) + bar.get_height()
    assert heights == pytest.approx(turns)
