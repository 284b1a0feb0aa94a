"""The viewer's window: where there is no display, and under Xvfb where that is installed."""

import ctypes
import os
import shutil
import signal
import subprocess
import sys
import threading
import time

import mujoco
import numpy as np
import pytest

from gantrysim.base.errors import GantryError
from gantrysim.render.colours import Scale, scale_for
from gantrysim.render.legend import BAR_HEIGHT, colour_bar
from gantrysim.render.scene import Scene
from gantrysim.report.saved import SavedRun
from gantrysim.view.display import NoDisplayError, check_display
from gantrysim.view.window import _free_view, _guarded

from support.films import shows
from support.views import write_run

PATIENCE = 90.0  # with a first picture in software, or with the end of a process [s]
HINT = "; `gantrysim render RUN_DIR` makes a video"
VIEW = 1e-5  # relative, and of a direction, in single precision
BEAD = 60  # pixels of its colour, that prove a bead


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("run"))


def test_no_display():
    with pytest.raises(NoDisplayError) as error:
        check_display("linux", {"HOME": "/"})
    reason = "neither DISPLAY nor WAYLAND_DISPLAY is set"
    assert str(error.value) == f"cannot open a window: {reason}{HINT}"
    assert isinstance(error.value, GantryError)


def test_wayland_is_a_display_where_glfw_opens_a_window(monkeypatch):
    monkeypatch.setattr("gantrysim.view.display._opens_window", lambda: True)
    check_display("linux", {"WAYLAND_DISPLAY": "wayland-0"})
    monkeypatch.setattr("gantrysim.view.display._opens_window", lambda: False)
    with pytest.raises(NoDisplayError, match=r"^cannot open a window: GLFW finds no display; "):
        check_display("linux", {"WAYLAND_DISPLAY": "wayland-0"})


def test_macos_wants_its_own_interpreter():
    with pytest.raises(NoDisplayError) as error:
        check_display("darwin", {})
    reason = "on macOS MuJoCo's viewer needs its own interpreter, mjpython -m gantrysim view"
    assert str(error.value) == f"cannot open a window: {reason}{HINT}"


def command(*arguments, **environment):
    here = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    # warnings as errors would say whatever GLFW warns of
    return subprocess.Popen(
        [sys.executable, "-m", "gantrysim", "view", *map(str, arguments)],
        env=here | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="asks for X11")
@pytest.mark.parametrize(
    ("environment", "reason"),
    [
        ({}, "neither DISPLAY nor WAYLAND_DISPLAY is set"),
        ({"DISPLAY": ":4242"}, "X11: Failed to open display :4242"),
    ],
)
def test_command_without_a_display_is_one_line(environment, reason):
    process = command("an225", **environment)
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 2
    assert out == ""
    assert err == f"error: cannot open a window: {reason}{HINT}\n"


def test_viewer_is_freed_only_while_no_thread_is_inside(monkeypatch):
    monkeypatch.setattr("gantrysim.view.window._LEAVING", 0.1)
    left = []
    monkeypatch.setattr("gantrysim.view.window._abandoned", left)
    freed = []

    class Simulate:
        def destroy(self):
            freed.append(self)

        def render_loop(self):
            assert not ended.is_set()

    guard = threading.Lock()
    ended = threading.Event()
    viewer = _guarded(Simulate, guard, ended)()
    viewer.render_loop()
    assert ended.is_set()
    with guard:
        viewer.destroy()
    assert (freed, left) == ([], [viewer])
    viewer.destroy()
    assert freed == [viewer]
    assert not guard.locked()


def seen(scene, view):
    """Where a view stands, where it looks, and the slope of its upper edge."""
    drawn = mujoco.MjvScene(scene.model, 1000)
    mujoco.mjv_updateScene(
        scene.model, scene.data, mujoco.MjvOption(), None, view, mujoco.mjtCatBit.mjCAT_ALL.value, drawn
    )
    eyes = drawn.camera
    pos = 0.5 * (np.array(eyes[0].pos) + np.array(eyes[1].pos))  # of both eyes
    return pos, np.array(eyes[0].forward), eyes[0].frustum_top / eyes[0].frustum_near


@pytest.mark.parametrize("camera", ["overview", "side", "top"])
def test_freed_camera_has_the_view_of_the_fixed_one(saved, camera):
    run = SavedRun.load(saved)
    scene = Scene(run.machine, run.run)
    fixed, free = scene.camera(camera), mujoco.MjvCamera()
    free.lookat[:], free.distance, free.azimuth, free.elevation = _free_view(scene, fixed)
    (stood, ahead, slope), (stands, looks, edge) = seen(scene, fixed), seen(scene, free)
    assert looks == pytest.approx(ahead, abs=VIEW)
    reach = float((free.lookat - stood) @ ahead)
    assert stood + reach * ahead == pytest.approx(free.lookat, abs=VIEW)
    assert np.linalg.norm(free.lookat - stands) * edge == pytest.approx(reach * slope, rel=VIEW)
    again = mujoco.MjvCamera()
    again.lookat[:], again.distance, again.azimuth, again.elevation = _free_view(scene, free)
    assert np.array_equal(again.lookat, free.lookat)
    assert (again.distance, again.azimuth, again.elevation) == (free.distance, free.azimuth, free.elevation)


def test_colour_bar_goes_from_low_to_high(saved):
    run = SavedRun.load(saved)
    scale = scale_for("width", [run.run], [run.job.bead])
    bar = colour_bar(scale, 300)
    assert bar.shape == (BAR_HEIGHT, 300, 3)
    assert bar.dtype == np.uint8
    assert np.array_equal(bar[-1, [0, 150, 299]], scale.table[[0, 128, 255]])
    assert np.array_equal(bar[-12], bar[-1])
    lettered = bar[:-12]
    ink = (lettered != lettered[0, 0]).any(axis=2).any(axis=0)
    assert ink[:60].any()
    assert ink[100:200].any()
    assert ink[-60:].any()
    assert not ink[:5].any()
    assert not ink[-5:].any()


def test_the_colour_bar_labels_its_ends():
    table = np.zeros((256, 3), np.uint8)
    bar = colour_bar(Scale("contour error", "µm", 0.0, 15.07, False, True, table), 300)
    for text, there in (("≥ 15.1", True), ("0.0", True), ("≤", False)):
        part = bar[:22, 150:] if text.startswith("≥") else bar[:22, :150]
        assert shows(part, text, 12, "#ebebeb", paper="#14171c") is there, text


@pytest.fixture(scope="module")
def display(tmp_path_factory):
    """A display of its own by Xvfb; else the one there is."""
    if not sys.platform.startswith("linux"):
        pytest.skip("asks for X11")
    if shutil.which("Xvfb") is None:
        if not os.environ.get("DISPLAY"):
            pytest.skip("neither Xvfb nor a display")
        yield os.environ["DISPLAY"]
        return
    read, write = os.pipe()
    screen = ["-screen", "0", "1024x768x24", "-noreset", "-displayfd", str(write)]
    server = subprocess.Popen(["Xvfb", *screen], pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    with os.fdopen(read) as number:
        name = f":{number.readline().strip()}"
    yield name
    server.terminate()
    server.wait(PATIENCE)


def grabbed(display):
    from PIL import ImageGrab

    return np.asarray(ImageGrab.grab(xdisplay=display).convert("RGB")).astype(int)


def glue(picture):
    """Number of pixels as orange as the glue."""
    red, green, blue = np.moveaxis(picture, -1, 0)
    return int(np.count_nonzero((red > 140) & (green > 0.35 * red) & (green < 0.75 * red) & (blue < 0.35 * red)))


def until(process, condition):
    end = time.monotonic() + PATIENCE
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.1)


class _Message(ctypes.Structure):
    """XClientMessageEvent."""

    _fields_ = (
        ("type", ctypes.c_int),
        ("serial", ctypes.c_ulong),
        ("send_event", ctypes.c_int),
        ("display", ctypes.c_void_p),
        ("window", ctypes.c_ulong),
        ("message_type", ctypes.c_ulong),
        ("format", ctypes.c_int),
        ("data", ctypes.c_long * 5),
        ("rest", ctypes.c_long * 24),
    )


def ask_to_close(display):
    """Ask every window to close, as a window manager does."""
    x11 = ctypes.CDLL("libX11.so.6")
    x11.XOpenDisplay.restype, x11.XInternAtom.restype, x11.XDefaultRootWindow.restype = (
        ctypes.c_void_p,
        ctypes.c_ulong,
        ctypes.c_ulong,
    )
    server = ctypes.c_void_p(x11.XOpenDisplay(display.encode()))
    root, children = ctypes.c_ulong(), ctypes.POINTER(ctypes.c_ulong)()
    count = ctypes.c_uint()
    other = ctypes.c_ulong()
    x11.XQueryTree(
        server,
        ctypes.c_ulong(x11.XDefaultRootWindow(server)),
        *map(ctypes.byref, (root, other, children, count)),
    )
    protocols, delete = (x11.XInternAtom(server, name, 0) for name in (b"WM_PROTOCOLS", b"WM_DELETE_WINDOW"))
    for window in children[: count.value]:
        message = _Message(type=33, window=window, message_type=protocols, format=32)
        message.data[0] = delete
        x11.XSendEvent(server, ctypes.c_ulong(window), 0, ctypes.c_long(0), ctypes.byref(message))
    x11.XCloseDisplay(server)


@pytest.mark.parametrize("live", [False, True])
def test_window_shows_the_bead_grow_and_ends(display, saved, live):
    process = command(saved / "job.toml" if live else saved, "--speed", "0.25", DISPLAY=display)
    try:
        until(process, lambda: glue(grabbed(display)) > 0)
        before = glue(grabbed(display))
        until(process, lambda: glue(grabbed(display)) > before + BEAD)
        if live:
            ask_to_close(display)
        else:
            process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
    assert (process.returncode, err) == ((0, "") if live else (130, "interrupted\n"))
    assert not grabbed(display).any()
