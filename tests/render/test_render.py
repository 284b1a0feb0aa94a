"""Pictures that show what the record says: bead, nozzle, frames."""

import ctypes.util
import dataclasses
import os
import re
import subprocess
import sys

import imageio.v2 as imageio
import mujoco
import numpy as np
import pytest

from gantrysim import Dispenser, InputError, Machine, Servo, simulate
from gantrysim.base.errors import unknown
from gantrysim.cli import main as cli
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.render import Film, NoOpenGLError, Renderer, Take, save_video
from gantrysim.render.opengl import _egl_failure, offscreen_context
from gantrysim.render.renderer import checked_size

from support.blank_pictures import save_blank
from support.pinhole import in_sight, on_work, to_pixels
from support.soaked import suite_runs

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


@pytest.mark.parametrize("camera", suite_runs(["top", "overview"], 1))
@pytest.mark.parametrize("share", suite_runs([0.5, 1.0], 0))
def test_the_bead_is_drawn_along_the_trace(xy, run, dry, camera, share):
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


@pytest.mark.parametrize("camera", suite_runs(["side", "overview", "nozzle"], 0))
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


@pytest.mark.parametrize("camera", suite_runs(CAMERAS, 0))
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


def test_the_video_has_its_frames_its_length_and_its_picture(xy, run, tmp_path):
    seen = []
    file = tmp_path / "video.mp4"
    count = save_video(xy, run, file, size=(480, 360), fps=5.0, colour="plain", progress=seen.append)
    with imageio.get_reader(file) as reader:
        frames = [np.asarray(frame) for frame in reader]
        rate = reader.get_meta_data()["fps"]
    assert rate == 5.0
    assert len(frames) == count == int(np.ceil(run.time[-1] * 5)) + 1 + 5  # and the end card
    assert len(seen) == count - 5
    assert seen[-1] == 1.0
    assert all(frame.shape == (360, 480, 3) and frame.mean() > 30 for frame in frames[:-5])
    orange = [((f[..., 0] > 150) & (f[..., 2] < 90)).sum() for f in frames[:-5]]
    assert orange[-1] > orange[len(orange) // 2] > orange[0]


def test_bad_pictures_are_refused(xy, run, tmp_path):
    with pytest.raises(InputError, match="unknown camera 'topp': did you mean top"):
        Renderer(xy, run, "topp")
    with pytest.raises(InputError, match="size of the video = 321 x 240: must be even"):
        save_video(xy, run, tmp_path / "video.mp4", size=(321, 240))
    with pytest.raises(InputError, match="width of the picture = 0: must be at least 1"):
        Renderer(xy, run, size=(0, 10))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("size", [(20000, 400), (400, 20000), (8193, 1), (100000, 100000)])
def test_a_picture_too_large_is_refused_before_anything_is_made(xy, run, monkeypatch, size):
    monkeypatch.setattr("gantrysim.render.renderer.Scene", lambda *_, **__: pytest.fail("a scene was made"))
    side, pixels = ("width", size[0]) if size[0] > 8192 else ("height", size[1])
    text = f"^{side} of the picture = {pixels} pixels: must be at most 8192 pixels$"
    with pytest.raises(InputError, match=text):
        Renderer(xy, run, size=size)
    text = text.replace("picture", "film")
    with pytest.raises(InputError, match=text):
        Film([Take(xy, run)], size=size)


def test_the_largest_picture_is_one(xy, run):
    assert checked_size("picture", (8192, 1)) == (8192, 1)


def test_opengl_that_cannot_draw_the_size_is_refused_in_one_line_and_freed(xy, run, monkeypatch):
    """Wider than software draws, which is 16384 pixels, and so low that it takes little memory."""
    freed, made = [], []

    def watched(width, height):
        context = offscreen_context(width, height)
        made.append(context)
        free = context.free
        context.free = lambda: (freed.append(context), free())
        return context

    monkeypatch.setattr("gantrysim.render.renderer._LARGEST_SIDE", 200000)
    monkeypatch.setattr("gantrysim.render.renderer.offscreen_context", watched)
    with pytest.raises(NoOpenGLError, match=r"^OpenGL cannot draw pictures of 100000 x 2 pixels: Offscreen.*not com"):
        Renderer(xy, run, size=(100000, 2))
    assert len(made) == 1
    assert made[0] in freed
    with Renderer(xy, run, size=(64, 48)) as renderer:  # and the next one works
        assert renderer.frame(0).std() > 0


class Context:
    """What MuJoCo has on macOS and Windows."""

    def __init__(self, width, height):
        self.size, self.current = (width, height), False

    def make_current(self):
        self.current = True


@pytest.mark.parametrize("platform", ["darwin", "win32"])
def test_macos_and_windows_use_their_own_opengl(monkeypatch, platform):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr("mujoco.gl_context.GLContext", Context)
    monkeypatch.setattr(ctypes.util, "find_library", lambda name: pytest.fail(f"looked for {name}"))
    context = offscreen_context(30, 20, platform)
    assert isinstance(context, Context)
    assert (context.size, context.current) == ((30, 20), True)
    monkeypatch.setenv("MUJOCO_GL", "off")
    with pytest.raises(NoOpenGLError, match=r"^MUJOCO_GL is off$"):
        offscreen_context(30, 20, platform)


@pytest.mark.parametrize("error", [RuntimeError("no pixel\nformat"), ImportError("no pixel format"), OSError(1, "no")])
def test_macos_and_windows_without_opengl_need_no_debian_package(monkeypatch, error):
    def refuse(*_):
        raise error

    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr("mujoco.gl_context.GLContext", refuse)
    with pytest.raises(NoOpenGLError) as refused:
        offscreen_context(30, 20, "darwin")
    assert str(refused.value) == f"no offscreen OpenGL: {' '.join(str(error).split())}"


@pytest.mark.parametrize(
    ("trial", "reason"), [("print(1); raise SystemExit('first line\\nno EGL')", "no EGL"), ("1/0", "division by zero")]
)
def test_an_egl_that_fails_in_a_process_of_its_own_is_not_tried_in_this_one(monkeypatch, trial, reason):
    def refuse(*_):
        raise RuntimeError("no OSMesa\neither")

    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(ctypes.util, "find_library", lambda name: f"lib{name}.so")
    monkeypatch.setattr("gantrysim.render.opengl._context", refuse)
    monkeypatch.setattr("gantrysim.render.opengl._TRIAL", trial)
    _egl_failure.cache_clear()
    try:
        with pytest.raises(NoOpenGLError) as refused:
            offscreen_context(30, 20, "linux")
        monkeypatch.setattr("gantrysim.render.opengl._TRIAL", "raise SystemExit(3)")
        _egl_failure.cache_clear()
        assert _egl_failure() == "no reason given"
    finally:
        _egl_failure.cache_clear()
    causes = re.findall(r" \((\w+): ([^)]*)\)", str(refused.value).partition(": install Debian package ")[0])
    assert [name for name, _ in causes] == ["egl", "osmesa"]
    assert causes[0][1].endswith(reason)
    assert causes[1][1] == "no OSMesa either"


def test_a_machine_without_cameras_says_so(rigid):
    machine = rigid()
    run = simulate(machine, Servo.derive(machine.axes), MoveSpiral(60, 1, 10, 100).setpoints(1e-3))
    with pytest.raises(InputError, match=r"^unknown camera 'top': there are none$"):
        Renderer(machine, run, "top")
    source = machine.source
    source.write_text(source.read_text().replace("<worldbody>", '<worldbody><camera name="front"/><camera/>'))
    with pytest.raises(InputError, match=r"^unknown camera 'top': known: front$"):
        Renderer(Machine(source), run, "top")


def test_an_unknown_name_without_alternatives():
    assert str(unknown("thing", "a", [])) == "unknown thing 'a': there are none"


@pytest.fixture
def no_opengl(monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    find = ctypes.util.find_library
    monkeypatch.setattr(ctypes.util, "find_library", lambda name: None if name in ("EGL", "OSMesa") else find(name))


def test_without_opengl_the_error_names_the_package(xy, run, no_opengl):
    with pytest.raises(NoOpenGLError, match="install Debian package libegl1"):
        Renderer(xy, run)


def test_without_opengl_the_command_does_everything_but_the_video(no_opengl, tmp_path, monkeypatch, capsys):
    arguments = [
        "gantrysim",
        "run",
        "--out",
        str(tmp_path),
        "--no-causes",
        "--no-improve",
        "--set",
        "diameter=40",
        "--set",
        "turns=1",
    ]
    monkeypatch.setattr(sys, "argv", arguments)
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", save_blank)
    cli.app(standalone_mode=False)
    assert sorted(item.name for item in tmp_path.iterdir()) == [
        "card.png",
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


def test_the_machine_is_posed_by_its_encoders(xy, run):
    with Renderer(xy, run) as renderer:
        renderer.scene.pose(2000)
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


def test_mujoco_gl_off_means_no_video(xy, run, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "off")
    with pytest.raises(NoOpenGLError, match="MUJOCO_GL is off"):
        Renderer(xy, run)


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


PICTURE = """
import sys
from gantrysim import Dispenser, Machine, Servo, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.render import Renderer

machine = Machine("xy")
setpoints = MoveSpiral(40, 1, 10, 100).setpoints(1e-3)
run = simulate(machine, Servo.derive(machine.axes), setpoints, dispenser=Dispenser(flow=100.0))
with Renderer(machine, run, "overview", (160, 120)) as renderer:
    sys.stdout.buffer.write(renderer.frame(len(run.time) - 1).tobytes())
"""


@pytest.mark.skipif(ctypes.util.find_library("OSMesa") is None, reason="OSMesa is not installed")
def test_osmesa_replaces_a_broken_egl():
    def picture(**environment):
        clean = {name: value for name, value in os.environ.items() if name not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")}
        done = subprocess.run(
            [sys.executable, "-c", PICTURE], env={**clean, **environment}, capture_output=True, check=True
        )
        return np.frombuffer(done.stdout, np.uint8).reshape(120, 160, 3).astype(int)

    broken = picture(MUJOCO_EGL_DEVICE_ID="999")
    assert broken.std() > 20
    assert np.abs(broken - picture(MUJOCO_GL="osmesa")).max() == 0
