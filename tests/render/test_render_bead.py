"""The bead in a picture, pixel by pixel: where the height map has glue, in the colours of its scale, and the drop."""

import dataclasses

import mujoco
import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from gantrysim import Dispenser, InputError, Job, Machine, Servo, Verdict, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.glue.bead import Bead, BeadSettings
from gantrysim.glue.bead.height_map import HeightMap
from gantrysim.glue.bead.trace import BeadTrace
from gantrysim.metrics.analysis import Analysis
from gantrysim.render import Renderer
from gantrysim.render.colours import COLOURS, chosen_colour, errors_along, scale_for
from gantrysim.render.scene import Scene
from gantrysim.results.checks import Check, Row
from gantrysim.results.colours import SHARE

from support.pinhole import in_sight, on_work, to_pixels
from support.soaked import suite_runs

SIZE = (1600, 1200)
SMALL = (320, 240)
SHADES = 10  # of 255, by which a colour may differ from its scale's where it is lit
FLOW = 150.0  # [mm³/s]
SPEED = 100.0  # [mm/s]
GAP = 0.5  # [mm]
ROWS = ("path", "glue", "stability", "machine")


@pytest.fixture(scope="module")
def run(xy):
    """The record alone of a spiral that ends in a stop, off the middle of the table, with errors from a slow loop."""
    spiral = MoveSpiral(80, 2, 12, SPEED, loop_period=0.2, acceleration=1000)
    run = simulate(xy, Servo.derive(xy.axes), spiral.setpoints(1e-3).hold(0.1), dispenser=Dispenser(flow=FLOW))
    return run.replaced(rig=None)


@pytest.fixture(scope="module")
def dry(run):
    return dataclasses.replace(run, flow=np.zeros(len(run.time)))


def seen_from_above(renderer, machine, step=2):
    """Every few pixels' place on the work, (h, w, 2) [mm], where a ray through it meets the surface in plain sight."""
    data, camera = renderer.data, renderer.view.fixedcamid
    width, height = renderer.size
    rows, columns = np.mgrid[0:height:step, 0:width:step]
    focal = 0.5 * height / np.tan(0.5 * np.radians(renderer.model.cam_fovy[camera]))
    rays = (
        np.stack([columns + 0.5 - 0.5 * width, 0.5 * height - rows - 0.5, np.full(rows.shape, -focal)], axis=-1)
        @ data.cam_xmat[camera].reshape(3, 3).T
    )
    eye = data.cam_xpos[camera]
    surface = data.xpos[machine.work][2] - 1e-3 * GAP
    there = eye + rays * ((surface - eye[2]) / rays[..., 2])[..., None]
    return rows, columns, 1e3 * (there - data.xpos[machine.work])


@pytest.mark.parametrize("share", suite_runs([0.4, 1.0]))
def test_glue_is_seen_where_the_height_map_has_it_and_nowhere_else(xy, run, dry, share):
    tick = int(share * (len(run.time) - 1))
    part = slice(0, tick + 1)
    so_far = dataclasses.replace(
        run,
        **{
            f.name: getattr(run, f.name)[part]
            for f in dataclasses.fields(run)
            if isinstance(getattr(run, f.name), np.ndarray)
        },
    )
    deposit = HeightMap.of(BeadTrace(so_far))
    height_at = RegularGridInterpolator((deposit.y, deposit.x), deposit.height, bounds_error=False, fill_value=0.0)
    pictures = []
    for record in (dry, run):
        with Renderer(xy, record, "top", SIZE) as renderer:
            pictures.append(renderer.frame(tick).astype(int))
            rows, columns, place = seen_from_above(renderer, xy)
            near = np.linalg.norm(place[..., :2], axis=2) < 70
            visible = np.zeros(rows.shape, bool)
            visible[near] = in_sight(renderer, on_work(xy, renderer, place[near] + [0, 0, 1e-3]))
    glue = (np.abs(pictures[1] - pictures[0]).max(axis=2) > 40)[rows, columns]
    height = height_at(place[..., 1::-1])
    pixel = np.abs(np.diff(place[0, :2, 0]))[0] / 2
    around = [
        height_at(place[..., 1::-1] + offset) for offset in 2 * pixel * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    ]
    surely = visible & (np.min([height, *around], axis=0) > 0.5 * GAP)
    never = visible & (np.max([height, *around], axis=0) < 1e-6)
    assert surely.sum() > 60
    assert never.sum() > 5000
    assert glue[surely].mean() > 0.995
    assert not glue[never].any()


def laid_stations(machine, run, renderer, bead_trace, tick):
    """Stations of the bead that are laid and in plain sight, on top of the bead, and their pixels."""
    top = bead_trace.point.copy()
    top[:, 2] += bead_trace.height - GAP
    world = on_work(machine, renderer, top)
    pixels = np.floor(to_pixels(renderer, world)).astype(int)
    inside = ((pixels >= 2) & (pixels < np.array(renderer.size) - 2)).all(axis=1)
    laid = (bead_trace.place > 5) & (bead_trace.place < bead_trace.length[tick] - 8) & inside
    laid[laid] = in_sight(renderer, world[laid])
    return np.flatnonzero(laid), pixels


@pytest.mark.parametrize("colour", suite_runs(["width", "error"], 0))
def test_the_colour_of_the_bead_is_that_of_the_scale(xy, run, colour):
    tick = len(run.time) - 1
    run = dataclasses.replace(run, flow=run.flow * (1 + 0.2 * np.sin(4 * run.time)))
    with Renderer(xy, run, "top", SIZE, colour=colour) as renderer:
        picture = renderer.frame(tick).astype(int)
        bead_trace = BeadTrace(run, stations=1250)
        stations, pixels = laid_stations(xy, run, renderer, bead_trace, tick)
        scale = renderer.scene.scale
    if colour == "width":
        values = bead_trace.width
    else:
        analysis = Analysis(run)
        values = 1e3 * np.interp(bead_trace.place, bead_trace.length[analysis.ticks], analysis.nozzle.distance)
    share = scale.share(values)
    assert np.ptp(share[stations]) > 0.3  # much of the scale is used
    wanted = scale.table[np.round(255 * share[stations]).astype(int)].astype(int)
    shown = picture[pixels[stations, 1], pixels[stations, 0]]
    # in the shadow it is darker, by one factor for all three colours
    lit = shown.sum(axis=1) > 0.95 * wanted.sum(axis=1)
    assert lit.sum() > 300
    assert (np.abs(shown - wanted)[lit].max(axis=1) <= SHADES).mean() > 0.97
    darker = shown[~lit] / wanted[~lit]
    assert (darker > 0.75).mean() > 0.9


def test_a_plain_bead_has_no_scale(xy, run):
    assert scale_for("plain", [run]) is None
    assert Scene(xy, run).scale is None


def test_an_unknown_colour_is_refused(xy, run):
    with pytest.raises(InputError, match="unknown colour 'red'"):
        Scene(xy, run, colour="red")
    assert COLOURS == ("plain", "verdict", "width", "error")


def test_the_scale_of_the_error_begins_at_zero_and_holds_all_but_the_rarest(run):
    scale = scale_for("error", [run])
    error = 1e3 * Analysis(run).nozzle.distance
    assert (scale.title, scale.unit, scale.low) == ("contour error", "µm", 0.0)
    assert np.percentile(error, 90) < scale.high
    assert scale.high <= 1.1 * error.max()
    assert scale.above == (errors_along(BeadTrace(run)).max() > scale.high)
    assert not scale.below
    assert scale.high == float(f"{scale.high:.2g}")


def test_the_scale_of_the_width_spans_three_tolerances_around_the_nominal_width(run):
    scale = scale_for("width", [run])
    nominal = float(Bead(run).nominal_section.width[0])
    assert (scale.low, scale.high) == pytest.approx((0.7 * nominal, 1.3 * nominal))  # 10 % by default
    assert scale.above  # the blob at the stop
    assert scale.share(np.array([0.9, 1.0, 1.1]) * nominal) == pytest.approx([1 / 3, 0.5, 2 / 3])


def test_the_scale_of_the_error_of_a_job_ends_at_ten_tolerances():
    job = Job.load("an225", ["tolerance.path_max=0.05"])
    run = job.follow()
    scale = scale_for("error", [dataclasses.replace(run, job=job)])
    assert (scale.low, scale.high, scale.colours) == (0.0, pytest.approx(500.0), SHARE)
    assert scale.labels() == ("0", "50", "≥ 500")
    assert scale.share(np.array([0.0, 50.0, 500.0])) == pytest.approx([0, 0.4, 1])


def judged(**usages):
    checks = {
        name: Check(name=name, quantity=name, value=usage, limit=1.0, unit="", source="given")
        for name, usage in usages.items()
    }
    return Verdict(tuple(Row.of(name, [checks[name]] if name in checks else []) for name in ROWS))


@pytest.mark.parametrize(
    ("verdicts", "colour"),
    [
        ([judged(path=10.0, glue=8.0)], "error"),
        ([judged(path=0.6, glue=9.0)], "width"),
        ([judged(path=0.3, glue=0.7)], "width"),  # a pass: what uses more of its limit
        ([judged(path=1.5, stability=9.0)], "error"),  # stability has no place on a bead
        ([judged(path=1.5, glue=1.1), judged(glue=4.0)], "width"),
        ([None], "error"),
        ([Verdict((), fault="following error")], "error"),
    ],
)
def test_the_colour_is_what_the_verdict_is_due_to(run, verdicts, colour):
    assert chosen_colour(None, [run] * len(verdicts), verdicts) == colour
    assert chosen_colour("plain", [run] * len(verdicts), verdicts) == "plain"


def test_a_verdict_needs_a_job(run):
    with pytest.raises(InputError, match="colour verdict: the run has no job and no rig"):
        chosen_colour("verdict", [run])


@pytest.mark.parametrize("colour", ["width", "error"])
def test_a_run_without_glue_has_a_scale(dry, colour):
    scale = scale_for(colour, [dry])
    assert scale.low < scale.high
    assert scale.below is (colour == "width")  # narrower than asked


def test_several_runs_have_one_scale(run):
    better = dataclasses.replace(run, nozzle=run.commanded_tip + 0.1 * (run.nozzle - run.commanded_tip) + [0.02, 0, 0])
    both = scale_for("error", [run, better])
    assert scale_for("error", [better, run]).high == both.high
    singles = [scale_for("error", [one]).high for one in (run, better)]
    assert min(singles) <= both.high <= max(singles)


def test_the_width_scale_of_several_runs_is_centred_on_the_first(run):
    """Of runs whose nominal widths differ."""
    beads = BeadSettings(), BeadSettings(contact_angle=90.0)
    nominal = [float(BeadTrace(run, bead).nominal_section.width[0]) for bead in beads]
    assert abs(nominal[0] - nominal[1]) > 0.1
    for order in ((0, 1), (1, 0)):
        scale = scale_for("width", [run, run], [beads[k] for k in order])
        assert 0.5 * (scale.low + scale.high) == pytest.approx(nominal[order[0]])


def test_a_share_is_linear_and_clipped(run):
    scale = scale_for("error", [run])
    values = np.array([-1, 0, 0.25, 0.5, 1, 2]) * scale.high
    assert scale.share(values) == pytest.approx([0, 0, 0.25, 0.5, 1, 1])


def drops(machine, scene, tick):
    """The extra geoms of a scene at a tick."""
    scene.pose(tick)
    drawn = mujoco.MjvScene(scene.model, maxgeom=400)
    scene.decorate(drawn)
    return [(np.array(g.pos), np.array(g.size)) for g in drawn.geoms[: drawn.ngeom]]


def test_the_drop_has_the_size_of_the_flow(xy, run):
    slow = Dispenser(flow=FLOW, closing=0.03)
    setpoints = MoveSpiral(80, 2, 12, SPEED).setpoints(1e-3).hold(0.3)
    run = simulate(xy, Servo.derive(xy.axes), setpoints, dispenser=slow)
    scene = Scene(xy, run)
    free = 1e-3 * np.sqrt(FLOW / SPEED / np.pi)  # radius of the free thread [m]
    tick = len(run.time) // 2
    ((centre, size),) = drops(xy, scene, tick)
    tip = scene.data.site("nozzle").xpos
    np.testing.assert_allclose(centre[:2], tip[:2], atol=3e-5)  # the encoder's place and the nozzle's
    assert size[0] == size[1] == pytest.approx(free, rel=1e-3)
    assert centre[2] - size[2] == pytest.approx(tip[2] - 1e-3 * GAP, abs=2e-5)  # to the surface
    assert centre[2] + size[2] == pytest.approx(tip[2] + free, abs=2e-5)  # up the needle
    stop = int(np.flatnonzero(run.flow > 0.5 * FLOW)[-1])
    radii = [drops(xy, scene, k)[0][1][0] for k in range(stop, stop + 60, 10)]
    assert (np.diff(radii) < 0).all()
    flowing = np.sqrt(run.flow[stop : stop + 60 : 10] / FLOW)
    assert np.array(radii) == pytest.approx(free * flowing, rel=1e-3)
    assert not drops(xy, scene, len(run.time) - 1) or drops(xy, scene, len(run.time) - 1)[0][1][0] < 0.05 * free


def test_a_drop_is_at_least_as_wide_as_the_face_that_it_wets(xy, run):
    wide = dataclasses.replace(run, face=2.4)
    ((_, size),) = drops(xy, Scene(xy, wide), len(run.time) // 2)
    assert size[0] == pytest.approx(1.2e-3, rel=1e-2)


@pytest.mark.parametrize(("face", "length"), [(0.82, 25.4), (2.1, 12.7), (0.31, 38.1)])
@pytest.mark.parametrize("name", ["xy", "xyz", "stage"])
def test_the_needle_is_drawn_in_its_size_from_the_tip_to_its_hub(run, name, face, length):
    machine = Machine(name)
    sized = dataclasses.replace(run, axes=machine.axis_names, face=face, needle_length=length)
    sized = dataclasses.replace(sized, encoder=np.zeros((len(run.time), len(machine.axes))))
    scene = Scene(machine, sized)
    model, data = scene.model, scene.data
    needle, site = model.geom("needle").id, data.site("nozzle")
    assert 2e3 * model.geom_size[needle, :2] == pytest.approx([face, length])
    axis = data.geom_xmat[needle].reshape(3, 3)[:, 2]
    ends = data.geom_xpos[needle] + np.outer([-1, 1], axis * model.geom_size[needle, 1])
    np.testing.assert_allclose(ends[np.linalg.norm(ends - site.xpos, axis=1).argmin()], site.xpos, atol=1e-9)

    def bottom(part):
        """Height of a part's lower end over the tip [mm]."""
        geom = scene.model.geom(part).id
        return 1e3 * (data.geom_xpos[geom, 2] - site.xpos[2] - model.geom_size[geom, 1])

    # hub and barrel follow
    assert bottom("hub") == pytest.approx(36.0 + length - 25.4)
    assert bottom("syringe") == pytest.approx(45.5 + length - 25.4)


def test_a_leaning_needle_keeps_its_length(run):
    machine = Machine("xyzr")
    sized = dataclasses.replace(run, encoder=np.zeros((len(run.time), 4)), face=1.27, needle_length=12.7)
    model = Scene(machine, sized).model
    assert 2e3 * model.geom("needle").size[:2] == pytest.approx([1.27, 25.4], rel=1e-3)


def test_high_above_the_surface_the_drop_hangs(xy, run):
    nozzle, flow = run.nozzle.copy(), run.flow.copy()
    nozzle[-100:, 2] += np.linspace(0, 10, 100)
    flow[-100:] = FLOW
    scene = Scene(xy, dataclasses.replace(run, nozzle=nozzle, flow=flow))
    free = 1e-3 * np.sqrt(FLOW / SPEED / np.pi)
    for tick, height in ((-90, GAP + nozzle[-90, 2]), (-1, 1e3 * 3 * free)):
        ((centre, size),) = drops(xy, scene, len(run.time) + tick)
        origin = scene.data.xpos[xy.work]
        assert centre[2] - size[2] == pytest.approx(origin[2] + 1e-3 * (nozzle[tick, 2] - height), abs=2e-5)
        assert centre[2] + size[2] == pytest.approx(origin[2] + 1e-3 * nozzle[tick, 2] + free, abs=2e-5)


def test_a_dry_run_has_no_drop_and_no_bead(xy, dry):
    scene = Scene(xy, dry)
    assert drops(xy, scene, len(dry.time) // 2) == []
    vertices = scene.model.mesh_vert[scene.model.mesh_vertadr[scene.mesh] :]
    assert np.ptp(vertices, axis=0).max() == 0


def test_another_run_is_drawn_with_the_same_mesh(xy, run, dry):
    """Frames of a renderer that has shown another run are those of a renderer of its own, but for the rings."""
    with Renderer(xy, dry, "top", SMALL, BeadSettings(), "error", scale_for("error", [run])) as renderer:
        renderer.show(run)
        shown = renderer.frame(len(run.time) - 1)
    with Renderer(xy, run, "top", SMALL, BeadSettings(), "error", scale_for("error", [run])) as renderer:
        np.testing.assert_array_equal(renderer.frame(len(run.time) - 1), shown)


@pytest.mark.parametrize("size", suite_runs([[300, 400], [240, 240], [320, 240], [640, 240]], 0))
def test_a_narrow_picture_is_as_wide_as_one_of_four_to_three(xy, run, size):
    """The view's half angle across is that of 4:3, or more."""
    with Renderer(xy, run, "overview", size) as renderer:
        half = np.tan(0.5 * np.radians(renderer.model.cam_fovy[renderer.view.fixedcamid]))
        model = Scene(xy, run).model
        framed = np.tan(0.5 * np.radians(model.cam_fovy[renderer.view.fixedcamid]))
        across = half * size[0] / size[1]
        assert across >= framed * 4 / 3 - 1e-9
        assert half >= framed - 1e-9
        assert min(across / (framed * 4 / 3), half / framed) == pytest.approx(1)
        assert renderer.frame(0).shape == (size[1], size[0], 3)
