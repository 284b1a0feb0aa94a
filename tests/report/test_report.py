"""The report of a run: its sections, and its numbers against those of the summary."""

import base64
import html
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from gantrysim import Fault, Job, causes_of
from gantrysim.base.quantity import number_text
from gantrysim.faults import EncoderSlip
from gantrysim.glue.bead import Bead
from gantrysim.job.causes import CAUSES
from gantrysim.metrics.analysis import Analysis, torque_ripple
from gantrysim.metrics.budget import LINKS, Budget
from gantrysim.report import page as servo_page
from gantrysim.report.folder import REPORT
from gantrysim.report.headline import contour_sentence
from gantrysim.report.page import write_run_page
from gantrysim.report.summary import summary
from gantrysim.results.run_results import RunResults
from gantrysim.servo.stability.margins import Margins

from support.blank_pictures import save_blank
from support.pages import Page

CAUSE_NAMES = tuple(cause.name for cause in CAUSES)
SMALL = ("diameter=40", "turns=2", "thickness=5")
ALWAYS = ["verdict", "bead-and-path", "error-budget", "errors-over-time", "servo", "job", "versions"]


def reported(folder, job, run=None, video=None):
    run = job.run() if run is None else run
    bead = Bead(run, job.bead, Analysis(run))
    file = folder / "report.html"
    write_run_page(file, RunResults(job, job.built_machine, Budget(bead.analysis), bead), video)
    page = Page(file)
    page.check()
    return page, bead


@pytest.fixture
def blank(monkeypatch):
    """The figures of a test's own page are blank; those of the spiral are drawn."""
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", save_blank)


@pytest.fixture(scope="module")
def spiral(tmp_path_factory):
    job = Job.load("an225", SMALL)
    return job, *reported(tmp_path_factory.mktemp("report"), job)


def test_the_report_of_a_spiral_has_all_sections(spiral):
    _, page, _ = spiral
    assert page.sections == [
        *ALWAYS[:3],
        "spacing-of-neighbouring-turns",
        "bead",
        *ALWAYS[3:],
    ]
    assert len(page.all("figure")) == 8
    assert page.texts("h1") == ["an225 on xy"]
    assert not [one for one in page.all("p") if one.get("role")]


def test_its_numbers_are_those_of_the_summary(spiral):
    job, page, bead = spiral
    numbers = summary(RunResults(job, job.built_machine, Budget(bead.analysis), bead))
    errors = numbers["errors"]
    motion = numbers["motion"]
    text = page.section("error-budget")
    for error in ("contour", "program"):
        rms, largest = (errors[f"{error}_{name}_um"] for name in ("rms", "max"))
        assert f"{error.capitalize()} error, rms {rms:.1f} µm max {largest:.1f} µm" in text
    spacing = [motion[f"spacing_{name}_mm"] for name in ("mean", "std")]
    assert "Turn spacing {:.2f} mm requested 5, std {:.2f}".format(*spacing) in text
    assert f"Path speed {motion['speed_mean_mm_s']:.1f} mm/s" in text
    assert f"Path length {motion['path_length_mm']:.1f} mm in {motion['duration_s']:.2f} s" in text
    rows = {row[0]: row for row in page.rows() if row and len(row) < 8}
    for name, row in (("along", "along the path"), ("x", "x"), ("y", "y")):
        sizes = [f"{errors[f'following_{name}_{size}_um']:.1f}" for size in ("rms", "max")]
        assert rows[row][1:] == ["µm", *sizes]
    for name, version in numbers["versions"].items():
        assert rows[name] == [name, version]
    assert page.all("code")[0]["text"].strip() == job.toml().strip()


def expected_of(part):
    return [100 * part.share, 1e3 * part.rms, 1e3 * part.p95, 1e3 * part.max, part.s, part.time]


def test_its_error_budget_is_that_of_the_run(spiral):
    job, page, bead = spiral
    values = Budget(bead.analysis).values
    rows = page.rows()
    links = {row[0]: row for row in rows if row and row[0] in (*LINKS, "contour")}
    assert list(links) == [*LINKS, "contour"]
    minus = str.maketrans("−", "-")
    for name, part in (*values.parts.items(), ("contour", values.contour)):
        shown = [float(cell.translate(minus)) for cell in links[name][2:8]]
        np.testing.assert_allclose(shown, expected_of(part), atol=0.051)
        point = [float(value) for value in links[name][8].translate(minus).split(", ")]
        np.testing.assert_allclose(point, part.point, atol=0.051)
    shares = [float(links[name][2].translate(minus)) for name in LINKS]
    assert sum(shares) == pytest.approx(100, abs=0.21)
    for name, part in Budget(bead.analysis).servo_by_axis(job.built_machine).items():
        row = next(row for row in rows if row[:1] == [name] and len(row) == 8)
        own = Budget(bead.analysis).values_of(part)
        shown = [float(cell.translate(minus)) for cell in row[1:7]]
        np.testing.assert_allclose(shown, expected_of(own), atol=0.051)
    turns = [row for row in rows if row and len(row) == 9 and row[0].startswith("turn")]
    assert [row[0] for row in turns] == ["turn 1", "turn 2"]
    for row, turn in zip(turns, values.turns, strict=True):
        rms = [1e3 * turn.parts[name].rms for name in (*LINKS, "contour")]
        np.testing.assert_allclose(
            np.array(row[1:], float), [*turn.s, *rms, 1e3 * turn.parts["contour"].max], atol=0.051
        )


def test_its_bead_is_that_of_the_run(spiral):
    _, page, bead = spiral
    values = bead.values
    text = page.section("bead")
    error = f"{values.volume_error_percent:+.2f} % of {values.requested_volume:.1f} requested"
    assert f"Volume {values.volume:.1f} mm³ {error}" in text
    assert f"coverage {100 * values.coverage:.1f} %" in text
    assert f"Turns that overlap {100 * values.overlap_share:.1f} % of their length" in text
    between = "gap" if values.clearance.mean > 0 else "overlap"
    assert f"{between.capitalize()} between turns {abs(values.clearance.mean):.2f} mm" in text
    row = next(row for row in page.rows() if row and row[0] == "bead width")
    expected = (values.width.mean, values.width.std, values.width.min, values.width.max)
    assert row[1:] == ["mm", *(f"{value:.2f}" for value in expected)]


def test_the_same_run_gives_the_same_bytes(spiral, tmp_path):
    job, page, bead = spiral
    assert reported(tmp_path, job, bead.run)[0].text == page.text


def test_the_headline_names_the_link_with_the_largest_share(spiral):
    _, page, bead = spiral
    budget = Budget(bead.analysis)
    parts = budget.values.parts
    text = contour_sentence(budget)
    assert page.texts("p")[3] == text
    assert parts["program"].share > 0.9
    rms = 1e3 * budget.values.contour.rms
    assert text == f"Contour error: {rms:.1f} µm rms, almost all in program (requested path to commanded)."


@pytest.mark.parametrize(
    ("share", "portion"), [(0.95, "almost all"), (0.9, "almost all"), (0.6, "mostly"), (0.5, "the largest share")]
)
def test_the_headline_gives_the_portion_of_the_error(spiral, share, portion):
    budget = Budget(spiral[2].analysis)
    rest = dict.fromkeys(LINKS, replace(budget.part_values["servo"], share=(1 - share) / 3))
    vars(budget)["part_values"] = {**rest, "structure": replace(rest["structure"], share=share)}
    assert contour_sentence(budget).endswith(f" µm rms, {portion} in structure (motor to nozzle).")


def test_the_words_of_the_links_name_no_cause(spiral):
    """A link is where the error lies; its cause may be elsewhere, as count noise that shakes the structure."""
    _, page, bead = spiral
    text = page.section("error-budget") + str(Budget(bead.analysis))
    assert "it does not say what caused it" in text
    rest = text.replace("it does not say what caused it", "")
    for word in ("cause", "friction", "compliance", "backlash", "quantisation", "from the controller"):
        assert word not in rest
    assert "causes" not in page.sections


@pytest.mark.usefixtures("blank")
def test_the_causes_have_a_section_with_their_table_and_plot(tmp_path):
    job = Job.load("an225", (*SMALL, "resolution=0.02"))
    run = job.run()
    causes = causes_of(job, run)
    bead = Bead(run, job.bead, Analysis(run))
    file = tmp_path / "report.html"
    write_run_page(file, RunResults(job, job.built_machine, Budget(bead.analysis), bead, causes))
    page = Page(file)
    page.check()
    assert page.sections[:4] == ["verdict", "bead-and-path", "error-budget", "causes"]
    text = page.section("causes")
    assert "locate the error on the chain; this section finds its causes" in text
    shown = page.rows()
    shown = shown[[row and row[0] for row in shown].index("nothing") :]  # the links' table has a row "program" too
    rows = {row[0]: row[1:] for row in shown if len(row) == 9 and row[0] in ("nothing", *CAUSE_NAMES)}
    assert list(rows) == ["nothing", *CAUSE_NAMES]
    for name, cells in causes.rows:
        shown = [None if cell == "–" else float(cell.replace("−", "-")) for cell in rows[name][:-1]]
        assert [cell is None for cell in shown] == [cell is None for cell in cells]
        assert [cell or 0 for cell in shown] == pytest.approx([cell or 0 for cell in cells], abs=0.051)
    assert rows["sampling"][:-1] == ["–"] * 7  # coarse counts at a short period
    assert [html.unescape(rows[cause.name][-1]) for cause in CAUSES] == [cause.off for cause in CAUSES]
    assert f"Sampling: {causes.effects[1].failure}." in text
    numbers = summary(RunResults(job, job.built_machine, Budget(bead.analysis), bead, causes))["causes"]
    assert list(numbers) == list(CAUSE_NAMES)
    assert numbers["sampling"] == {"without": None, "worth": None, "failure": causes.effects[1].failure}
    for effect in causes.effects:
        for part, errors in (("without", effect.without), ("worth", effect.worth)):
            for name, size in errors.items():
                assert numbers[effect.cause.name][part][name] == {"rms_um": 1e3 * size.rms, "max_um": 1e3 * size.max}
    assert json.loads(json.dumps(numbers, allow_nan=False)) == numbers


@pytest.mark.usefixtures("blank")
def test_a_follower_without_error_gets_a_report(tmp_path):
    job = Job.load("softmc-arc")
    page, bead = reported(tmp_path, job, job.follow())
    assert Budget(bead.analysis).values.contour.rms < 1e-6
    assert page.texts("p")[3] == "Contour error: none, the nozzle follows the requested path exactly."
    assert next(row for row in page.rows() if row and row[0] == "servo")[2:] == ["0"] * 4 + ["–"] * 3


def test_the_headline_of_a_trip_is_what_happened_and_names_no_link():
    job = Job.load("an225", (*SMALL, "following_error_limit=0.03"))
    run = job.run()
    fault = run.fault
    assert (fault.kind, fault.limit) == ("following error", 0.03)
    budget = Budget(run)
    assert budget.values.parts["program"].share > 0.9  # as it is without the trip
    contour = budget.values.contour
    text = contour_sentence(budget)
    assert text == (
        f"Fault: following error on axis {fault.axis} at t = {fault.time:.4f} s: {number_text(fault.value, '.4g')} mm, "
        "limit 0.03 mm. "
        f"Contour error until then: {1e3 * contour.rms:.1f} µm rms, max {1e3 * contour.max:.1f} µm."
    )
    assert summary(RunResults(job, job.built_machine, budget))["headline"] == text


def test_the_headline_of_a_stuck_axis_blames_nothing_else():
    run = Job.load("an225", (*SMALL, 'faults=[{kind="stuck axis", time=1, axis="x"}]')).run()
    text = contour_sentence(Budget(run))
    assert text.startswith(
        "Stuck axis x at t = 1.0000 s: seized until the end. "
        f"Supervision: following error on axis x at t = {run.fault.time:.4f} s: "
        f"{number_text(run.fault.value, '.4g')} mm, limit 5 mm. "
        "Contour error until then: "
    )
    assert not any(link in text for link in LINKS)


def test_the_headline_of_a_fault_that_trips_nothing_or_is_never_reached():
    run = Job.load("softmc-arc").follow()
    slip = EncoderSlip(time=0.5, axis="x", counts=100)
    end = float(run.time[-1])
    assert contour_sentence(Budget(replace(run, injected=(slip,)))) == (
        "Encoder slip on axis x at t = 0.5000 s: +100 counts until the end. "
        f"Supervision: no limit exceeded, complete at t = {end:.4f} s. Contour error: none."
    )
    plain = contour_sentence(Budget(run))
    assert contour_sentence(Budget(replace(run, injected=(replace(slip, time=end + 1),)))) == plain
    assert contour_sentence(Budget(replace(run, injected=(replace(slip, counts=0),)))) == plain


def test_the_summary_says_which_deliberate_faults_the_run_came_to():
    job = Job.load("softmc-arc")
    run = job.follow()
    end = float(run.time[-1])
    slips = tuple(EncoderSlip(time=time, axis="x", counts=0) for time in (0.5, end, end + 1))
    budget = Budget(replace(run, injected=slips))
    faults = summary(RunResults(job, job.built_machine, budget))["injected"]["faults"]
    assert [(fault["time"], fault["reached"]) for fault in faults] == [(0.5, True), (end, True), (end + 1, False)]


def test_the_headline_of_a_fault_without_error():
    run = replace(Job.load("softmc-arc").follow(), fault=Fault("travel", "x", 1.0, 151.0, 150.0, "mm"))
    text = "Fault: travel on axis x at t = 1.0000 s: 151 mm, limit 150 mm. Contour error until then: none."
    assert contour_sentence(Budget(run)) == text


@pytest.mark.usefixtures("blank")
def test_a_fault_is_shown_above_all_else(tmp_path):
    job = Job.load("an225", ("following_error_limit=0.04",))
    page, bead = reported(tmp_path, job)
    assert bead.run.fault is not None
    (warning,) = (one["text"] for one in page.all("p") if one.get("role") == "alert")
    assert warning.strip() == f"Fault: {bead.run.fault}. All values are up to the fault."
    assert page.text.index(str(bead.run.fault)) < page.text.index("<main>")
    assert "spacing-of-neighbouring-turns" not in page.sections


@pytest.mark.usefixtures("blank")
def test_a_run_without_glue_has_no_bead(tmp_path):
    page, bead = reported(tmp_path, Job.load("an225", (*SMALL, "turns=1", "flow=0")))
    assert bead.volume[-1] == 0
    assert page.sections == ALWAYS


@pytest.mark.usefixtures("blank")
@pytest.mark.parametrize("name", ["fanuc-conical", "stage-outline"])
def test_paths_in_space_rotary_axes_and_the_stage_get_a_report(tmp_path, name):
    job = Job.load(name)
    page, bead = reported(tmp_path, job)
    assert set(page.sections) >= {*ALWAYS, "bead"}
    assert ("spacing-of-neighbouring-turns" in page.sections) == (bead.analysis.spacing.distance.size > 0)
    units = {row[0]: row[1] for row in page.rows() if len(row) == 4}
    for axis, unit in zip(bead.run.axes, bead.run.units, strict=True):
        assert units[axis] == {"mm": "µm", "deg": "mdeg"}[unit]
    assert ("notes" in page.sections) == bool(job.notes)
    for note in job.notes:
        assert " ".join(note.split()) in page.section("notes")


@pytest.mark.usefixtures("blank")
def test_a_program_cannot_write_markup_into_the_page(tmp_path):
    text = "N10 G17 G90 G00 X0 Y10\nN20 G01 X20 F3000 (</code><script>alert;</script>&)"
    job = Job(name="mark", machine="xy", program={"controller": "fanuc.Program", "program": text})
    page, _ = reported(tmp_path, job)
    assert page.text.count("<script") == len(page.all("script")) == 2  # the viewer and its data
    assert "(</code><script>alert;</script>&)" in page.all("code")[0]["text"]


def test_the_command_writes_the_report_with_its_video(gantrysim_command, tmp_path, monkeypatch):
    film = b"\x00\x00\x00 ftypisom" + bytes(range(256))
    monkeypatch.setattr("gantrysim.render.save_video", lambda machine, run, file, **keywords: file.write_bytes(film))
    settings = [word for setting in SMALL for word in ("--set", setting)]
    status, printed, _ = gantrysim_command("run", "an225", *settings, "--no-causes", "--no-improve", "--out", tmp_path)
    assert status == 0
    assert "report.html" in printed
    page = Page(tmp_path / "report.html")
    page.check()
    (video,) = page.all("video")
    assert base64.b64decode(video["src"].partition(",")[2]) == (tmp_path / "video.mp4").read_bytes() == film
    contour = json.loads((tmp_path / "summary.json").read_text())["errors"]
    assert f"{contour['contour_rms_um']:.1f} µm" in page.section("error-budget")
    headline = json.loads((tmp_path / "summary.json").read_text())["headline"]
    assert page.texts("p")[3] == headline
    assert headline in " ".join(printed.split())


def test_a_folder_with_a_foreign_report_is_not_written_to(gantrysim_command, tmp_path):
    (tmp_path / REPORT).write_text("mine")
    status, _, messages = gantrysim_command(
        "run", "an225", "--no-video", "--no-causes", "--no-improve", "--out", tmp_path
    )
    assert status == 2
    assert re.search(r"holds report\.html, which no run has written", messages)
    assert (tmp_path / "report.html").read_text() == "mine"


def test_the_servo_section_shows_gains_margins_and_ripple(spiral):
    job, page, bead = spiral
    results = RunResults(job, job.built_machine, Budget(bead.analysis), bead)
    numbers = summary(results)["servo"]
    text = page.section("servo")
    assert summary(results)["unstable_axes"] == []
    for axis in "xy":
        for number in (
            f"{numbers[f'gain_margin_alone_{axis}']:.2f}",
            f"{numbers[f'phase_margin_{axis}_deg']:.1f}",
            f"{numbers[f'delay_margin_{axis}_ms']:.2f}",
            f"{numbers[f'crossover_{axis}_Hz']:.1f}",
            f"{numbers[f'torque_ripple_{axis}_percent']:.2f}",
        ):
            assert number in text, axis
    assert f"Axis y has the smallest gain margin: {numbers['gain_margin_y']:.2f}." in text
    servo = job.built_servo
    assert f"{servo.gains[0].kp:.4g}" in text
    assert f"{servo.gains[1].acceleration_ff:.4g}" in text
    ripple = torque_ripple(bead.run)
    assert [numbers[f"torque_ripple_{axis}_Nm"] for axis in "xy"] == ripple.tolist()
    peak = job.built_machine.axes[0].peak_torque
    assert numbers["torque_ripple_x_percent"] == pytest.approx(100 * ripple[0] / peak)


@pytest.mark.parametrize(("scale", "unstable"), [((1, 6), "y"), ((9, 6), "x, y")])
def test_the_servo_section_names_unstable_axes(spiral, scale, unstable):
    servo, bead = spiral[0].built_servo, spiral[2]
    gains = [f"servo.{name}={np.multiply(servo.per_axis(name), scale).tolist()}" for name in ("kp", "kd")]
    job = Job.load("an225", (*SMALL, *gains))
    section = servo_page.servo_section(RunResults(job, job.built_machine, Budget(bead.analysis), bead))
    assert section.text == [f"Unstable, Coulomb friction neglected: {unstable}.", "Kp, kd as given."]


def test_unknown_and_unbounded_margins_are_left_out(spiral):
    job, _, bead = spiral
    budget = Budget(bead.analysis)
    job = job.model_copy()
    vars(job)["margins"] = None
    unknown = RunResults(job, job.built_machine, budget, bead)
    assert summary(unknown)["servo"]["gain_margin_x"] is summary(unknown)["unstable_axes"] is None
    assert "margins are unknown" in servo_page.servo_section(unknown).text[0]
    boundless = Margins(np.inf, 0.0, 180.0, np.inf, 1.0, 0.0, stable=True, together=np.inf)
    vars(job)["margins"] = (boundless,) * 2
    without_bound = RunResults(job, job.built_machine, budget, bead)
    servo = summary(without_bound)["servo"]
    assert [servo[key] for key in ("gain_margin_x", "delay_margin_x_ms", "phase_margin_x_deg")] == [None, None, 180.0]
    assert servo_page.servo_section(without_bound).table[1].cells[0][1:5] == ["∞", "∞", "0", "180.0"]
