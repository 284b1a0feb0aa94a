"""The content of a page's viewer: its numbers against those of the run, its thinning, its colours and its bundle."""

import base64
import gzip
import hashlib
import json
import math
from functools import partial
from importlib.resources import files
from inspect import getclosurevars
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import Job
from gantrysim.glue.bead import Bead
from gantrysim.glue.bead.trace import LEVEL_CLIMB, climb, leaves_plane
from gantrysim.job.basis import program_lines, program_lines_at
from gantrysim.machine.machine import Machine
from gantrysim.machine.outline import outline
from gantrysim.metrics.analysis import Analysis, path_speed
from gantrysim.metrics.budget import Budget
from gantrysim.remedy.report import changes_of
from gantrysim.report.encoding import encoded_ascending, encoded_numbers, encoded_runs, shown_rows
from gantrysim.report.page import write_run_page
from gantrysim.report.viewer_data import MOTION, POSES, Series, ViewerData, pose_ticks
from gantrysim.report.writing import write_report
from gantrysim.results.run_results import RunResults

from support.jobs import job_run
from support.viewer_jobs import climbing_job, viewer_job

WEB = files("gantrysim.report") / "web"
BUNDLE = "viewer.min.js"
SPACE_BUNDLE = "viewer3d.min.js.gz"
LARGEST_SPACE = 200_000  # of the 3-D view in a page [bytes]
LARGEST = 1_000_000  # of a page without film, causes and changes [bytes]
STEPS = 65_534
TINY = 1e-300  # steps below it are no numbers
LINKS = ("program", "servo", "encoder", "geometry", "structure", "corner", "contour")


def decoded(column, rows):
    """The values of a column as gantrysim/report/web/data.js reads them."""
    data = base64.b64decode(column.get("data", ""))
    match column["kind"]:
        case "runs":
            return np.repeat(column["values"], column["counts"]).astype(float)
        case "ascending":
            steps = np.frombuffer(data, "<u2") if data else np.ones(rows - 1)
            return np.cumsum(np.concatenate([[column["first"]], steps])).astype(float)
        case "u16":
            codes = np.frombuffer(data, "<u2").astype(int)
        case "d8":
            differences = np.frombuffer(data, "i1").tolist()
            jumps = iter(np.frombuffer(base64.b64decode(column["jumps"]), "<u2").tolist())
            codes = [0]
            for difference in differences:
                codes.append(next(jumps) if difference == -128 else codes[-1] + difference)
            codes = np.array(codes[1:])
    return np.where(codes == 65535, np.nan, column["offset"] + column["scale"] * codes)


def as_json(content):
    return json.loads(json.dumps(content, allow_nan=False))


NUMBERS = st.one_of(st.just(float("nan")), st.floats(-1e6, 1e6))


@given(st.lists(NUMBERS, min_size=1, max_size=60), st.booleans())
def test_a_column_comes_back_within_half_a_step(numbers, smooth):
    values = np.array(numbers)
    if smooth:  # differences of a byte
        values = np.nancumsum(np.nan_to_num(values) * 1e-6)
    column = as_json(encoded_numbers(values))
    back = decoded(column, values.size)
    np.testing.assert_array_equal(np.isnan(back), np.isnan(values))
    known = values[~np.isnan(values)]
    if known.size:
        assert (
            np.abs(back[~np.isnan(back)] - known).max()
            <= 0.5 * np.ptp(known) / STEPS + 1e-12 * np.abs(known).max() + TINY
        )


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=60), st.floats(1e-3, 10))
def test_a_column_of_a_resolution_comes_back_within_half_of_it_and_its_extremes_exactly(numbers, resolution):
    values = np.array(numbers)
    back = decoded(as_json(encoded_numbers(values, resolution)), values.size)
    assert np.abs(back - values).max() <= 0.5 * max(resolution, np.ptp(values) / STEPS) + 1e-9
    assert (back.min(), back.max()) == pytest.approx((values.min(), values.max()), abs=1e-9)


def test_a_smooth_column_takes_a_byte_a_value_and_its_extremes_are_exact():
    values = 60 * np.sin(np.linspace(0, 20, 5000))
    values[100:200] = np.nan
    column = as_json(encoded_numbers(values))
    assert column["kind"] == "d8"
    assert len(column["data"]) == pytest.approx(5000 * 4 / 3, abs=4)
    back = decoded(column, 5000)
    for extreme in (np.nanargmin, np.nanargmax):
        assert back[extreme(values)] == pytest.approx(values[extreme(values)], abs=1e-12)
    noise = as_json(encoded_numbers(np.random.default_rng(1).normal(size=5000)))
    assert noise["kind"] == "u16"


@given(st.lists(st.integers(1, 65535), max_size=30), st.integers(0, 10**9))
def test_ticks_and_lines_come_back_exactly(steps, first):
    ticks = np.cumsum([first, *steps])
    np.testing.assert_array_equal(decoded(as_json(encoded_ascending(ticks)), ticks.size), ticks)
    lines = np.repeat(steps or [0], 3)
    np.testing.assert_array_equal(decoded(as_json(encoded_runs(lines)), lines.size), lines)


@given(st.integers(0, 2**32 - 1), st.integers(300, 3000), st.integers(20, 200), st.booleans())
def test_thinning_keeps_the_extremes_of_every_column(seed, rows, most, sparse):
    random = np.random.default_rng(seed)
    places = np.flatnonzero(random.random(rows) < 0.4) if sparse else None
    smooth = np.cumsum(random.normal(size=rows))
    values = random.normal(size=rows if places is None else places.size)
    values[random.random(values.size) < 0.1] = np.nan
    state = np.zeros(rows, bool)
    state[rows // 3 : rows // 2] = True
    shown = shown_rows(rows, [(None, smooth), (places, values)], 2, [state], most)
    assert shown[0] == 0
    assert shown[-1] == rows - 1
    assert np.all(np.diff(shown) > 0)
    assert shown.size <= max(most, 0) + 10
    inside = set(shown.tolist())
    assert {int(smooth.argmin()), int(smooth.argmax())} <= inside
    known = np.flatnonzero(~np.isnan(values))
    if known.size:
        where = known if places is None else places[known]
        assert {int(where[values[known].argmin()]), int(where[values[known].argmax()])} <= inside
    if most >= 40:
        assert {rows // 3 - 1, rows // 3, rows // 2 - 1, rows // 2} <= inside
    # between neighbouring rows shown no column leaves the range of its bucket's rows shown
    size = -(-rows * 6 // most)
    for first in range(0, rows, size):
        bucket = smooth[first : first + size]
        there = smooth[[row for row in shown if first <= row < first + size]]
        assert there.min() == bucket.min()
        assert there.max() == bucket.max()


def test_poses_are_spread_over_the_run_and_no_more_than_its_ticks():
    for ticks, poses in ((1, 1), (2, 2), (POSES, POSES), (POSES + 1, POSES), (50 * POSES, POSES)):
        chosen = pose_ticks(SimpleNamespace(time=np.arange(ticks)))
        assert (chosen.size, np.unique(chosen).size) == (poses, poses)
        assert (chosen[0], chosen[-1]) == (0, ticks - 1)
        assert np.diff(chosen).size < 2 or np.ptp(np.diff(chosen)) <= 1


@pytest.mark.parametrize("state", [None, np.zeros(400_000, bool)])
def test_no_two_rows_shown_are_further_apart_than_16_bits_hold(state):
    shown = shown_rows(400_000, [], 0, [] if state is None else [state], 2)
    assert np.diff(shown).max() == 65_534
    np.testing.assert_array_equal(decoded(encoded_ascending(shown), shown.size), shown)


def test_few_rows_are_all_shown():
    assert shown_rows(100, [], 0, [], 100).size == 100


@pytest.fixture(scope="module")
def shown():
    job = viewer_job()
    run = job.run()
    bead = Bead(run, job.bead, Analysis(run))
    return RunResults(job, job.built_machine, Budget(bead.analysis), bead)


def test_the_columns_are_those_of_the_run(shown):
    content = as_json(ViewerData(shown).content())
    run = shown.budget.analysis.run
    ticks = shown.budget.analysis.ticks
    rows = content["rows"]
    assert rows == content["ticks"] == len(run.time)
    column = {name: decoded(one, rows) for name, one in content["columns"].items()}
    np.testing.assert_allclose(content["start"] + content["period"] * column["tick"], run.time, atol=1e-9)
    np.testing.assert_array_equal(column["dispense"], run.dispense)
    nozzle = shown.budget.analysis.nozzle
    expected = {
        "s": nozzle.s,
        "dx": nozzle.offset[:, 0],
        "dy": nozzle.offset[:, 1],
        "contour": 1e3 * shown.budget.contour.lateral,
        **{name: 1e3 * part.lateral for name, part in shown.budget.parts.items()},
    }
    for name, values in expected.items():
        assert np.isnan(np.delete(column[name], ticks)).all()
        np.testing.assert_allclose(column[name][ticks], values, atol=admitted(content, name, values))
    bead = shown.bead
    everywhere = {
        "x": run.nozzle[:, 0],
        "y": run.nozzle[:, 1],
        "flow": run.flow,
        "speed": path_speed(run),
        "width": np.interp(bead.length, bead.place, bead.width),
    }
    for name, values in everywhere.items():
        np.testing.assert_allclose(column[name], values, atol=admitted(content, name, values))
    assert {series["name"] for series in content["series"]} == expected.keys() | everywhere.keys()
    line_at = program_lines(shown.job, len(run.time))
    assert column["line"].tolist() == [line_at(time) or 0 for time in run.time.tolist()]
    text = shown.job.program["text"].split("\n")
    assert content["program"] == {str(number): line for number, line in enumerate(text, 1) if number < len(text)}


def admitted(content, name, values):
    """Half a step of 16 bits, or of a tenth of the last digit shown; of offsets, magnified 1000 times, of 0.01 µm."""
    decimals = next(series["decimals"] for series in content["series"] if series["name"] == name)
    finest = {"dx": 1e-5, "dy": 1e-5, **dict.fromkeys("sxyz", 0.0)}.get(name, 0.1 * 10.0**-decimals)
    return 0.51 * max(np.ptp(values) / STEPS, finest)


def test_a_thinned_run_keeps_its_largest_errors(shown):
    content = as_json(ViewerData(shown, most=400).content())
    rows = content["rows"]
    assert rows < content["ticks"] / 2
    for name in ("contour", "program", "servo", "encoder", "structure"):
        values = 1e3 * {"contour": shown.budget.contour, **shown.budget.parts}[name].lateral
        back = decoded(content["columns"][name], rows)
        assert np.nanmin(back) == pytest.approx(values.min(), abs=1e-9)
        assert np.nanmax(back) == pytest.approx(values.max(), abs=1e-9)
    lines = decoded(content["columns"]["line"], rows)
    ticks = np.arange(content["ticks"])
    known = program_lines_at(shown.job, ticks.size, shown.budget.analysis.run.time)
    # every change of the line and of the dispenser is between two neighbouring ticks that are both shown
    rows_shown = set(decoded(content["columns"]["tick"], rows).astype(int).tolist())
    for state in (known, shown.budget.analysis.run.dispense):
        changes = np.flatnonzero(np.diff(state))
        assert changes.size > 2
        assert set(changes.tolist()) | set((changes + 1).tolist()) <= rows_shown
    assert set(lines) == set(known)


@pytest.mark.parametrize(
    ("largest", "decimals"), [(0.0, 2), (1e-12, 2), (0.04, 2), (9.9, 2), (10.0, 1), (99.0, 1), (100.0, 0), (5e4, 0)]
)
def test_a_column_is_read_in_three_digits_of_its_largest_value(largest, decimals):
    values = np.array([0.0, -largest, math.nan])
    assert Series("x", "x", "mm", MOTION, lambda: values).content(values)["decimals"] == decimals
    assert Series("x", "x", "mm", "", lambda: values).content(values)["decimals"] == 2  # a place


def test_a_column_is_read_only_when_it_is_wanted(shown):
    """The columns of a long run lie in files: those that a series held would all be in memory together."""
    for series in ViewerData(shown).series:
        held = (
            series.values.args
            if isinstance(series.values, partial)
            else getclosurevars(series.values).nonlocals.values()
        )
        assert not any(isinstance(value, np.ndarray) for value in held), series.name


@pytest.mark.soak
def test_the_page_of_ten_thousand_samples_is_small(tmp_path):
    job = Job.load("an225")
    bead = Bead(job_run("an225"), job.bead, Analysis(job_run("an225")))
    write_run_page(tmp_path / "report.html", RunResults(job, job.built_machine, Budget(bead.analysis), bead))
    assert (tmp_path / "report.html").stat().st_size < LARGEST
    assert 'id="viewer-3d"' not in (tmp_path / "report.html").read_text(encoding="utf-8")


@pytest.mark.soak
@pytest.mark.parametrize("name", ["an225-3d", "fanuc-spiral", "fanuc-conical", "softmc-helical"])
def test_the_whole_page_of_the_longest_jobs_is_small(name, tmp_path):
    """With causes and changes, without the film."""
    page = write_report(Job.load(name), job_run(name), tmp_path, changes=changes_of)
    assert page.stat().st_size < LARGEST


@pytest.mark.parametrize("name", ["trio-basic", "softmc-basic"])
def test_lines_at_many_times_are_those_at_each(name):
    controller = Job.load(name).controller
    times = np.linspace(0, 2, 40)
    assert controller.lines_at(times).tolist() == [controller.line_at(time) or 0 for time in times.tolist()]


def test_the_bundles_are_built_from_their_sources():
    sources = sorted(file.name for file in WEB.iterdir() if file.name.endswith(".js") and file.name != BUNDLE)
    digest = hashlib.sha256(b"".join((WEB / name).read_bytes() for name in sources)).hexdigest()
    bundles = {"uplot": (WEB / BUNDLE).read_bytes(), "three": gzip.decompress((WEB / SPACE_BUNDLE).read_bytes())}
    for library, bundle in bundles.items():
        head = bundle.decode().partition("\n")[0]
        assert digest in head, "scripts/build_web.sh builds it again"
        assert f"MIT, see LICENSE.{library}" in head
        assert "MIT License" in (WEB / f"LICENSE.{library}").read_text(encoding="utf-8")
    assert "</script" not in bundles["uplot"].decode()
    assert b"http" not in bundles["uplot"]
    assert len(base64.b64encode((WEB / SPACE_BUNDLE).read_bytes())) < LARGEST_SPACE


@pytest.mark.parametrize("name", ["climb", "stage", "delta"])
def test_the_outlines_needle_ends_at_the_nozzle(name):
    job = climbing_job() if name == "climb" else Job.load({"stage": "stage-outline", "delta": "delta-arc"}[name])
    machine = job.built_machine
    positions = job.run().encoder[::97] if name == "climb" else np.random.default_rng(1).uniform(0, 9, (20, 4))
    positions = positions[:, : len(machine.axes)]
    parts = outline(machine, positions)
    ((part, needle),) = [(part, solid) for part in parts for solid in part.solids if solid.needle]
    ends = [needle.position + sign * needle.size[1] * rotated(needle.rotation, [0, 0, 1]) for sign in (-1, 1)]
    distances = []
    for end in ends:
        place = part.position + np.array([rotated(quaternion, end) for quaternion in part.rotation])
        distances.append(np.linalg.norm(place - machine.tip(positions), axis=1))
    assert np.min(distances, axis=0).max() < 1e-3
    assert all(np.sum(part.rotation[1:] * part.rotation[:-1], axis=1).min() > 0 for part in parts)


@pytest.mark.parametrize("name", ["xyzr", "stage", "delta"])
def test_the_outlines_solids_lie_where_mujoco_has_their_geoms(name):
    machine = Machine(name)
    positions = np.random.default_rng(2).uniform(0, 9, (5, len(machine.axes)))
    positions[:, 0] = 4.0  # of an axis that stands still, away from its home
    parts = outline(machine, positions)
    model = machine.model
    data = mujoco.MjData(model)
    # others are planes, and meshes, of which a box is shown
    kinds = (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_CAPSULE)
    geoms = np.flatnonzero(np.isin(model.geom_type, [int(kind) for kind in kinds]) & (model.geom_rbound > 0.012))
    assert geoms.size > 10
    for pose, position in enumerate(positions):
        data.qpos[:] = machine.to_qpos(position)
        mujoco.mj_kinematics(model, data)
        turn = data.xmat[machine.work].reshape(3, 3)
        centres = 1e3 * (data.geom_xpos[geoms] - data.xpos[machine.work]) @ turn
        places = [
            part.position[pose] + rotated(part.rotation[pose], solid.position)
            for part in parts
            for solid in part.solids
        ]
        apart = np.linalg.norm(np.array(places)[:, None] - centres, axis=2)
        assert apart.min(axis=0).max() < 1e-9


def test_joints_at_many_positions_are_those_at_each():
    machine = Machine("delta")
    positions = np.random.default_rng(3).uniform(0, 9, (4, len(machine.axes)))
    assert np.array_equal(machine.to_qpos(positions), [machine.to_qpos(position) for position in positions])


def rotated(quaternion, vector):
    """A vector turned by a quaternion w, x, y, z."""
    w = quaternion[0]
    axis = np.array(quaternion[1:])
    return np.array(vector) + 2 * np.cross(axis, np.cross(axis, vector) + w * np.array(vector))


def test_a_page_has_the_third_dimension_where_the_bead_climbs(shown):
    run = climbing_job().run()
    assert leaves_plane(run)
    assert not leaves_plane(shown.budget.analysis.run)
    flat = run.nozzle[run.dispense][:, 2] * (0.999 / 16)
    assert climb(flat) < LEVEL_CLIMB
    assert ViewerData(shown).content()["space"] is None


def test_a_flat_bead_has_the_third_dimension_where_it_is_asked_for(shown):
    content = ViewerData(shown, flat_in_space=True).content()
    # z is zero, which the page knows
    assert "z" not in content["columns"]
    height = decoded(content["columns"]["height"], content["rows"])
    assert height.max() == pytest.approx(shown.bead.height.max(), rel=1e-4)
    assert len(content["solids"]) == len(content["space"]["parts"])
    assert content["space"]["gap"] == shown.bead.gap


def test_corners_that_the_nozzle_does_not_reach_are_sent():
    """The map draws the requested path through the feet of the nozzle, which leave out the tip of a rounded corner."""
    text = "G21 G90\nF3600\nG0 X0 Y0\nG1 X40 Y0\nG1 X11.33 Y20.075\nM2"
    job = Job(name="corner", machine="xy", program={"controller": "linuxcnc.Program", "text": text})
    bead = Bead(job.run(), job.bead, None)
    analysis = Analysis(bead.run)
    content = ViewerData(
        RunResults(job, job.built_machine, Budget(analysis), Bead(bead.run, job.bead, analysis))
    ).content()
    assert content["corners"] == [[40.0, 40.0, 0.0]]
    feet = decoded(content["columns"]["x"], content["rows"]) - decoded(content["columns"]["dx"], content["rows"])
    assert np.nanmax(feet) < 35


def test_a_path_of_too_many_corners_is_drawn_without_them():
    path = SimpleNamespace(corners=np.arange(11.0), position=lambda s: np.zeros((s.size, 3)))
    run = SimpleNamespace(requested=path)
    results = SimpleNamespace(budget=SimpleNamespace(analysis=SimpleNamespace(run=run)))
    assert len(ViewerData(results, most=11).corners()) == 11
    assert ViewerData(results, most=10).corners() == []


def crossed_stroke(*places):
    """What a run shows of a stroke along x, that others cross at these places [mm]."""
    across = "".join(f"G0 X{x} Y-20\nM3\nG1 Y20 F600\nM5\n" for x in places)
    text = f"G21 G90 G64\nG0 X-20 Y0\nM3\nG1 X20 F600\nM5\n{across}M2\n"
    program = {"controller": "linuxcnc.Program", "text": text}
    content = {"name": "cross", "machine": "xy", "program": program, "dispenser": {"area": 1.0}}
    job = Job.of_content(content, "job cross")
    run = job.run()
    bead = Bead(run, job.bead, Analysis(run))
    return RunResults(job, job.built_machine, Budget(bead.analysis), bead)


def test_the_rows_in_which_the_needle_is_in_its_own_bead_are_those_of_the_verdicts_passes():
    """A stroke along x, that a second one crosses at its middle: the needle is in the bead for its width and a face."""
    results = crossed_stroke(0)
    bead = results.bead
    run = bead.run
    content = as_json(ViewerData(results).content())
    rows = content["rows"]
    ploughed = decoded(content["columns"]["ploughed"], rows) > 0
    y = decoded(content["columns"]["y"], rows)[ploughed]
    half = 0.5 * (bead.nominal_section.width[0] + run.face)
    # a bead that is pressed has its widest chord below the needle's face; a dispensing face counts on its axis alone
    assert -half <= y.min() < y.max() <= half
    assert y.max() - y.min() > 0.3 * bead.nominal_section.width[0]
    (times,) = results.verdict["glue"].values["passes_through_glue_s"]
    np.testing.assert_allclose(run.time[ploughed][[0, -1]], times, atol=run.period)


@pytest.mark.parametrize(("places", "ending"), [((0,), " mm"), ((-8, 8), " mm in all")])
def test_the_length_of_several_passes_is_said_to_be_their_sum(places, ending):
    value = ViewerData(crossed_stroke(*places)).content()["worst_value"]
    assert value.startswith("bead ploughed ")
    assert value.endswith(ending)
