"""Pictures that show what the record says: bead, nozzle, frames."""

import ctypes.util
import dataclasses
import sys

import imageio.v2 as imageio
import mujoco
import numpy as np
import pytest

from gantrysim import Dispenser, InputError, Machine, Servo, cli, simulate
from gantrysim.bead import BeadSettings
from gantrysim.bead.sweep import Sweep
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.render import NoOpenGLError, Renderer, save_video

SIZE = (640, 480)
FLOW = 150.0  # [mm³/s]
CAMERAS = ("overview", "top", "nozzle", "side")


@pytest.fixture(scope="module")
def run(xy):
    setpoints = MoveSpiral(100, 2, 15, 100).setpoints(1e-3).hold(0.05)
    return simulate(xy, Servo.derive(xy.axes), setpoints, dispenser=Dispenser(flow=FLOW))


@pytest.fixture(scope="module")
def dry(run):
    """The same run without glue."""
    return dataclasses.replace(run, flow=np.zeros(len(run.time)))


def to_pixels(renderer, points):
    """Columns and rows at which world points [m] appear, (n, 2): a pinhole of the camera's field of view."""
    width, height = renderer.size
    frame = renderer.data.cam_xmat[renderer.view.fixedcamid].reshape(3, 3)
    seen = (points - renderer.data.cam_xpos[renderer.view.fixedcamid]) @ frame
    focal = 0.5 * height / np.tan(0.5 * np.radians(renderer.model.cam_fovy[renderer.view.fixedcamid]))
    column = 0.5 * width + focal * seen[:, 0] / -seen[:, 2]
    row = 0.5 * height - focal * seen[:, 1] / -seen[:, 2]
    return np.stack([column, row], axis=1)


def in_sight(renderer, points):
    """Whether nothing but the work lies between the camera and each point [m]."""
    model, data = renderer.model, renderer.data
    eye = data.cam_xpos[renderer.view.fixedcamid].copy()
    bead = model.geom("gantrysim bead").id
    visible = []
    for point in points:
        way = point - eye
        geom = np.full(1, -1, np.int32)
        shown = model.geom_group[bead]
        model.geom_group[bead] = 5
        groups = np.array([1, 1, 1, 0, 0, 0], np.uint8)
        distance = mujoco.mj_ray(model, data, eye, way / np.linalg.norm(way), groups, 1, -1, geom, None)
        model.geom_group[bead] = shown
        visible.append(geom[0] < 0 or distance > np.linalg.norm(way) - 1e-3)
    return np.array(visible)


def on_work(xy, renderer, points):
    """World coordinates [m] of points of the work frame [mm]."""
    origin, frame = renderer.data.xpos[xy.work], renderer.data.xmat[xy.work].reshape(3, 3)
    return origin + 1e-3 * points @ frame.T


def bead_pixels(xy, run, dry, tick, camera):
    """Pixels that differ between a frame with and one without glue, and the renderer's projection of the trace."""
    with Renderer(xy, dry, camera, SIZE) as renderer:
        bare = renderer.frame(tick).astype(int)
    with Renderer(xy, run, camera, SIZE) as renderer:
        glued = renderer.frame(tick).astype(int)
        trace = run.nozzle[::40].copy()
        trace[:, 2] -= 0.5 - 0.25  # half way up the bead
        world = on_work(xy, renderer, trace)
        pixels, visible = to_pixels(renderer, world), in_sight(renderer, world)
    return np.abs(glued - bare).max(axis=2) > 40, glued, pixels, visible


def neighbourhood(mask, pixels, reach):
    """Whether the mask is set within `reach` pixels of each of the pixels."""
    height, width = mask.shape
    hits = []
    for column, row in np.round(pixels).astype(int):
        low, left = max(row - reach, 0), max(column - reach, 0)
        hits.append(mask[low : min(row + reach, height) + 1, left : min(column + reach, width) + 1].any())
    return np.array(hits)


@pytest.mark.parametrize("camera", ["top", "overview"])
@pytest.mark.parametrize("share", [0.5, 1.0])
def test_the_bead_is_exactly_where_the_deposit_is(xy, run, dry, camera, share):
    tick = int(share * (len(run.time) - 1))
    mask, picture, pixels, visible = bead_pixels(xy, run, dry, tick, camera)
    laid = np.arange(0, len(run.time), 40) < tick
    assert visible[laid].mean() > 0.5  # the bridge hides the rest
    # every visible point of the trace that has been laid shows glue
    assert neighbourhood(mask, pixels[laid & visible], 1).mean() > 0.97
    # and no point that is still to come, a bead's width away from what has been laid
    ahead = ~laid & (
        np.linalg.norm(run.nozzle[::40, None, :2] - run.nozzle[None, :tick:40, :2], axis=2).min(axis=1) > 5
    )
    if share < 1:
        assert ahead.sum() > 50
        assert not neighbourhood(mask, pixels[ahead], 1).any()
    # all glue lies on the trace: a bead of 3.8 mm, seen, is at most so many pixels away from it
    rows, columns = np.nonzero(mask)
    away = np.linalg.norm(np.stack([columns, rows], axis=1)[:, None] - pixels[laid][None], axis=2).min(axis=1)
    assert (away < 6).mean() > 0.99
    # it has the glue's colour: red over green over blue
    red, green, blue = picture[mask].mean(axis=0)
    assert red > 1.2 * green > 1.2 * blue


@pytest.mark.parametrize("camera", ["side", "overview", "nozzle"])
def test_the_nozzle_follows_the_log(xy, dry, camera):
    with Renderer(xy, dry, camera, SIZE) as renderer:
        model = renderer.model
        site = model.site("nozzle")
        body = int(model.site_bodyid[site.id])
        geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] == body]
        # the needle is the geom whose lower end is the site: paint it so that nothing else has its colour
        ends = [model.geom_pos[g] - [0, 0, model.geom_size[g, 1]] for g in geoms]
        needle = geoms[int(np.argmin([np.linalg.norm(end - model.site_pos[site.id]) for end in ends]))]
        material = renderer.model.material("gantrysim bead").id
        model.geom_matid[needle] = material
        model.mat_rgba[material] = (1, 0, 1, 1)
        model.mat_emission[material] = 1
        model.geom_size[needle, 0] = 0.002  # thick enough to see from afar
        for tick in (0, 1500, 3500, len(dry.time) - 1):
            picture = renderer.frame(tick).astype(int)
            magenta = (picture[..., 0] > 120) & (picture[..., 2] > 120) & (picture[..., 1] < 90)
            assert magenta.any()
            tip = to_pixels(renderer, on_work(xy, renderer, dry.nozzle[tick][None]))[0]
            rows, columns = np.nonzero(magenta)
            lowest = rows > rows.max() - 3
            reach = 2.5 if camera != "nozzle" else 20.0  # a thick needle's rim, seen from near
            assert abs(columns[lowest].mean() - tip[0]) < reach
            assert abs(rows.max() - tip[1]) < reach + 2


@pytest.mark.parametrize("camera", CAMERAS)
def test_frames_are_neither_black_nor_blank_and_repeat(xy, run, camera):
    pictures = []
    for _ in range(2):
        with Renderer(xy, run, camera, SIZE) as renderer:
            pictures.append(renderer.frame(len(run.time) // 2))
    np.testing.assert_array_equal(pictures[0], pictures[1])
    picture = pictures[0].astype(float)
    assert picture.shape == (480, 640, 3)
    assert 30 < picture.mean() < 225
    assert picture.std() > 20
    assert (picture.max(axis=2) < 5).mean() < 0.2
    assert (picture.min(axis=2) > 250).mean() < 0.2


@pytest.mark.parametrize("tick_share", [0.0, 0.3, 1.0])
def test_the_mesh_conserves_the_volume_of_the_glue(run, tick_share):
    tick = int(tick_share * (len(run.time) - 1))
    bead = Sweep(run)
    vertices, normals = bead.mesh(tick)
    corners = vertices.astype(float)[bead.faces()] * 1e3
    # divergence theorem, with the flat base of each section closing the surface: it lies at z = -gap
    corners[..., 2] += 0.5
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    laid = float((run.flow[:-1] * np.diff(run.time))[:tick].sum())
    assert volume == pytest.approx(laid, rel=0.01, abs=0.5)  # less what facets cut off the sides
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)


def test_the_video_has_its_frames_its_length_and_its_picture(xy, run, tmp_path):
    seen = []
    count = save_video(xy, run, tmp_path / "video.mp4", size=(320, 240), fps=5.0, progress=seen.append)
    with imageio.get_reader(tmp_path / "video.mp4") as reader:
        frames = [np.asarray(frame) for frame in reader]
        rate = reader.get_meta_data()["fps"]
    assert rate == 5.0
    assert len(frames) == count == round(run.time[-1] * 5) + 1
    assert len(seen) == count
    assert seen[-1] == 1.0
    assert all(frame.shape == (240, 320, 3) and frame.mean() > 30 for frame in frames)
    orange = [((f[..., 0] > 150) & (f[..., 2] < 90)).sum() for f in map(np.asarray, frames)]
    assert orange[-1] > orange[len(orange) // 2] > orange[0]


def test_bad_pictures_are_refused(xy, run, tmp_path):
    with pytest.raises(InputError, match="unknown camera 'topp': did you mean top"):
        Renderer(xy, run, "topp")
    with pytest.raises(InputError, match="size of the video = 321 x 240: must be even"):
        save_video(xy, run, tmp_path / "video.mp4", size=(321, 240))
    with pytest.raises(InputError, match="width of the picture = 0: must be at least 1"):
        Renderer(xy, run, size=(0, 10))
    assert not list(tmp_path.iterdir())


@pytest.fixture
def no_opengl(monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    find = ctypes.util.find_library
    monkeypatch.setattr(ctypes.util, "find_library", lambda name: None if name in ("EGL", "OSMesa") else find(name))


def test_without_opengl_the_error_names_the_package(xy, run, no_opengl):
    with pytest.raises(NoOpenGLError, match="install Debian package libegl1"):
        Renderer(xy, run)


def test_without_opengl_the_command_does_everything_but_the_video(no_opengl, tmp_path, monkeypatch, capsys):
    arguments = ["gantrysim", "run", "--out", str(tmp_path), "--set", "diameter=40", "--set", "turns=1"]
    monkeypatch.setattr(sys, "argv", arguments)
    cli.app(standalone_mode=False)
    assert sorted(item.name for item in tmp_path.iterdir()) == [
        "job.toml",
        "plots",
        "report.html",
        "run.npz",
        "summary.json",
    ]
    message = capsys.readouterr().err
    assert message.startswith("no video: ")
    assert "libegl1" in message
    assert message.count("\n") == 1


def test_the_machine_stands_where_its_encoders_say(xy, run):
    with Renderer(xy, run) as renderer:
        renderer.pose(2000)
        joints = [renderer.data.joint(name).qpos[0] for name in run.axes]
    np.testing.assert_allclose(joints, 1e-3 * run.encoder[2000], atol=1e-12)


def test_the_camera_is_overview_or_else_one_that_sees_everything(xy, run, rigid):
    with Renderer(xy, run) as renderer:
        assert mujoco.mj_id2name(renderer.model, mujoco.mjtObj.mjOBJ_CAMERA, renderer.view.fixedcamid) == "overview"
    machine = rigid()
    servo = Servo.derive(machine.axes)
    other = simulate(machine, servo, MoveSpiral(60, 1, 10, 100).setpoints(1e-3), dispenser=Dispenser(flow=FLOW))
    with Renderer(machine, other, size=(2000, 1500)) as renderer:  # larger than the model's own buffer
        assert renderer.view.type == mujoco.mjtCamera.mjCAMERA_FREE
        assert renderer.frame(len(other.time) - 1).std() > 3


def section_areas(rings):
    """Areas of polygons across a trace, (r,), of rings (r, v, 3): by strips between the vertices."""
    across = np.einsum("rvi,ri->rv", rings - rings[:, :1], rings[:, -1] - rings[:, 0])
    across /= np.linalg.norm(rings[:, -1] - rings[:, 0], axis=1)[:, None]
    height = rings[..., 2] - rings[:, :1, 2]
    return np.sum(0.5 * (height[:, 1:] + height[:, :-1]) * np.diff(across, axis=1), axis=1)


def test_a_section_is_no_higher_than_the_gap_and_holds_the_glue(run):
    area = FLOW / 100
    for gap in (0.3, 0.5, 5.0):
        bead = Sweep(run, BeadSettings(gap=gap))
        vertices, normals = bead.mesh(len(run.time) - 1)
        rings = 1e3 * vertices.reshape(-1, 11, 3).astype(float)
        middle = rings[len(rings) // 2]
        # a drop at 60 deg: A = w^2 / (8 sin^2 60) (2 pi / 3 - sin 120), h = w/2 tan 30
        drop = np.sqrt(area / 0.2047) * np.tan(np.pi / 6) / 2
        assert middle[:, 2].max() + gap == pytest.approx(min(gap, drop), rel=1e-3)
        assert section_areas(middle[None])[0] == pytest.approx(area, rel=0.02)
        assert np.linalg.norm(middle[0] - middle[-1]) == pytest.approx(bead.strand.width[len(rings) // 2 - 1], rel=1e-3)
        top = normals.reshape(-1, 11, 3)[len(rings) // 2][5]
        np.testing.assert_allclose(top, [0, 0, 1], atol=1e-6)


def test_a_long_trace_gets_more_rings(run):
    long = dataclasses.replace(run, nozzle=run.nozzle * [20, 20, 1])
    assert Sweep(run).rings == 1250
    chord = np.linalg.norm(np.diff(long.nozzle, axis=0), axis=1).sum() / Sweep(long).rings
    assert 1.0 < chord <= 2.0


def test_a_long_run_is_shown_faster(xy, run, tmp_path):
    slow = dataclasses.replace(run, time=run.time * 30, period=run.period * 30)  # 133 s
    count = save_video(xy, slow, tmp_path / "video.mp4", size=(160, 120), fps=1.0)
    assert count == round(slow.time[-1] / 3) + 1
    assert (
        save_video(xy, run, tmp_path / "video.mp4", size=(160, 120), fps=2.0, speed=4.0) == round(run.time[-1] / 2) + 1
    )


def test_mujoco_gl_off_means_no_video(xy, run, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "off")
    with pytest.raises(NoOpenGLError, match="MUJOCO_GL is off"):
        Renderer(xy, run)


def test_glue_of_a_dwell_is_drawn_where_it_was_laid(run):
    dwell = 200
    nozzle = np.concatenate([np.repeat(run.nozzle[:1], dwell, axis=0), run.nozzle])
    still = dataclasses.replace(
        run,
        time=np.arange(len(nozzle)) * run.period,
        nozzle=nozzle,
        flow=np.concatenate([np.full(dwell, FLOW), run.flow]),
    )
    bead = Sweep(still)
    vertices, _ = bead.mesh(len(nozzle) - 1)
    rings = 1e3 * vertices.reshape(-1, 11, 3).astype(float)[1:-1]
    width = np.linalg.norm(rings[:, 0] - rings[:, -1], axis=1)
    area = section_areas(rings)
    length = np.linalg.norm(np.diff(nozzle, axis=0), axis=1).sum()
    drawn = np.trapezoid(area, dx=length / (bead.rings - 1))
    assert drawn == pytest.approx(still.flow[:-1].sum() * run.period, rel=0.01)
    # the heap spreads no further than it is wide, to either side twice
    usual = area[len(area) // 2]
    assert area[0] > 2 * usual
    near = np.linspace(0, length, bead.rings) < 2.5 * width.max()
    assert area[~near][:-9] == pytest.approx(np.full((~near).sum() - 9, usual), rel=0.05)


def test_the_gap_is_measured_down_the_work_however_the_machine_stands(xy, rigid):
    assert rigid().gap == 0.5  # has no work piece to measure to
    assert xy.gap == pytest.approx(0.5, abs=1e-6)
    source = rigid().source
    content = source.read_text().replace(
        '<body name="work"/>',
        '<body name="work"><geom type="box" size="0.2 0.2 0.01" pos="0 0 -0.0113" contype="0" conaffinity="0"/></body>',
    )
    content = content.replace("<worldbody>", '<worldbody><body name="bench" pos="0.3 -0.2 0.5" euler="20 -30 70">')
    source.write_text(content.replace("</worldbody>", "</body></worldbody>"))
    assert Machine(source).gap == pytest.approx(1.3, abs=1e-6)
