"""The viewer's window: where there is no display, and under Xvfb where that is installed."""

import os
import shutil
import signal
import subprocess
import sys
import time
import warnings

import glfw
import mujoco
import numpy as np
import pytest

from gantrysim.base.errors import GantryError
from gantrysim.render.colours import Scale, scale_for
from gantrysim.render.opengl import offscreen_context
from gantrysim.render.panel import BAR_HEIGHT, colour_bar
from gantrysim.render.scene import Scene
from gantrysim.render.view.texts import Chart, Texts
from gantrysim.render.view.window import NoDisplayError, ViewerWindow, WindowClosedError, check_display, free_view
from gantrysim.report.folder import SavedRun
from gantrysim.results.colours import MAGNITUDE

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


def test_without_a_display_that_glfw_opens_there_is_no_window(monkeypatch):
    monkeypatch.setattr("glfw.init", lambda: False)
    for environment in ({"DISPLAY": ":0"}, {"WAYLAND_DISPLAY": "wayland-0"}):
        with pytest.raises(NoDisplayError, match=r"^cannot open a window: GLFW finds no display; "):
            check_display("linux", environment)
    with pytest.raises(NoDisplayError, match=r"^cannot open a window: GLFW finds no display; "):
        check_display("darwin", {})


@pytest.mark.parametrize(
    ("messages", "reason"),
    [
        (["(65550) b'X11: Failed to open display :9'"], "X11: Failed to open display :9"),
        (['(65543) b"GLX: No GLXFBConfigs returned"'], "GLX: No GLXFBConfigs returned"),
        (["no library is found"], "no library is found"),
        (["(65544) b'Wayland: none'", "(65544) b'Wayland: none'", "X11: none"], "Wayland: none; X11: none"),
    ],
)
def test_the_reason_is_what_glfw_warns_of(monkeypatch, messages, reason):
    def init():
        for message in messages:
            warnings.warn(message, stacklevel=2)
        return False

    monkeypatch.setattr("glfw.init", init)
    with pytest.raises(NoDisplayError) as error:
        check_display("linux", {"DISPLAY": ":9"})
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
def test_command_with_a_display_that_is_gone_is_one_line():
    process = command("an225", DISPLAY=":4242")
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 2
    assert out == ""
    assert err == f"error: cannot open a window: X11: Failed to open display :4242{HINT}\n"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="asks for X11")
def test_command_without_a_display_is_one_line(gantrysim_command, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    said = f"error: cannot open a window: neither DISPLAY nor WAYLAND_DISPLAY is set{HINT}\n"
    assert gantrysim_command("view", "an225") == (2, "", said)


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
    fixed = scene.camera(camera)
    free = free_view(scene, fixed)
    (stood, ahead, slope), (stands, looks, edge) = seen(scene, fixed), seen(scene, free)
    assert looks == pytest.approx(ahead, abs=VIEW)
    reach = float((free.lookat - stood) @ ahead)
    assert stood + reach * ahead == pytest.approx(free.lookat, abs=VIEW)
    assert np.linalg.norm(free.lookat - stands) * edge == pytest.approx(reach * slope, rel=VIEW)
    again = free_view(scene, free)
    assert np.array_equal(again.lookat, free.lookat)
    assert (again.distance, again.azimuth, again.elevation) == (free.distance, free.azimuth, free.elevation)


class Screen:
    """Stands for GLFW and its window: an offscreen context, a mouse, and keys."""

    size = (400, 300)

    def __init__(self):
        vars(self).update({name: value for name, value in vars(glfw).items() if name.isupper()})
        self.callbacks = {}
        self.down = set()
        self.cursor = (0.0, 0.0)
        self.time = 0.0
        self.closed = False
        self.shown = 0

    def __getattr__(self, name):
        if name.startswith("set_"):
            return lambda _, callback: self.callbacks.update({name: callback})
        return lambda *_: {"get_window_content_scale": (1.0, 1.0)}.get(name, self.size)

    def make_context_current(self, _):
        self.context = offscreen_context(*self.size)

    def terminate(self):
        self.context.free()

    def poll_events(self):
        pass

    def window_should_close(self, _):
        return self.closed

    def swap_buffers(self, _):
        self.shown += 1

    def get_time(self):
        return self.time

    def get_cursor_pos(self, _):
        return self.cursor

    def get_key(self, _, key):
        return key in self.down

    get_mouse_button = get_key

    def press(self, key):
        self.callbacks["set_key_callback"](None, key, 0, glfw.PRESS, 0)

    def button(self, button, is_down, modifiers=0):
        (self.down.add if is_down else self.down.discard)(button)
        self.callbacks["set_mouse_button_callback"](None, button, int(is_down), modifiers)

    def move(self, x, y):
        self.callbacks["set_cursor_pos_callback"](None, x, y)
        self.cursor = (x, y)


LEFT = glfw.MOUSE_BUTTON_LEFT
RIGHT = glfw.MOUSE_BUTTON_RIGHT
TEXTS = Texts((("time", "1 s"),), (("Space", "pause"),), ())


@pytest.fixture
def opened(saved, monkeypatch):
    """A window on a screen that is none, and the screen."""
    screen = Screen()
    monkeypatch.setattr("gantrysim.render.view.window.glfw", screen)
    monkeypatch.setattr("gantrysim.render.view.window.open_window", lambda *_: None)
    run = SavedRun.load(saved)
    window = ViewerWindow(Scene(run.machine, run.run), "overview")
    window.pose(lambda: None)
    window.show(TEXTS, Chart())
    yield window, screen
    window.close()


def view_of(window):
    """Where the camera of a window stands and where it looks."""
    drawn = window._drawn.camera[0]
    return np.array(drawn.pos), np.array(drawn.forward)


def looked(window):
    window.show(TEXTS, Chart())
    return view_of(window)


def test_keys_arrive_once_and_a_closed_window_is_told(opened):
    window, screen = opened
    assert window.take_pressed_keys() == []
    screen.press(glfw.KEY_SPACE)
    screen.press(glfw.KEY_UP)
    assert window.take_pressed_keys() == [glfw.KEY_SPACE, glfw.KEY_UP]
    assert window.take_pressed_keys() == []
    assert screen.shown == 1
    screen.closed = True
    with pytest.raises(WindowClosedError):
        window.take_pressed_keys()


def test_a_minimised_window_shows_nothing_and_still_reads_keys(opened):
    window, screen = opened
    screen.size = (0, 0)
    window.show(TEXTS, Chart())
    screen.press(glfw.KEY_SPACE)
    assert window.take_pressed_keys() == [glfw.KEY_SPACE]
    assert screen.shown == 1


def test_brackets_go_round_the_cameras_and_escape_keeps_the_view(opened):
    window, screen = opened
    first = looked(window)
    views = []
    for _ in range(window._scene.model.ncam):
        screen.press(glfw.KEY_RIGHT_BRACKET)
        views.append(looked(window))
    assert window.take_pressed_keys() == []
    np.testing.assert_array_equal(views[-1], first)
    assert len({tuple(stood) for stood, _ in views}) == len(views) > 2
    screen.press(glfw.KEY_LEFT_BRACKET)
    np.testing.assert_array_equal(looked(window), views[-2])
    screen.press(glfw.KEY_ESCAPE)
    np.testing.assert_allclose(looked(window)[1], views[-2][1], atol=VIEW)
    screen.press(glfw.KEY_LEFT_BRACKET)  # the last of the machine
    last = looked(window)
    screen.press(glfw.KEY_ESCAPE)
    screen.press(glfw.KEY_RIGHT_BRACKET)
    screen.press(glfw.KEY_LEFT_BRACKET)
    np.testing.assert_array_equal(looked(window), last)


def test_the_mouse_turns_moves_and_zooms_the_view(opened):
    window, screen = opened
    stood, ahead = looked(window)
    screen.move(200, 150)  # without a button
    np.testing.assert_array_equal(looked(window), (stood, ahead))
    screen.button(RIGHT, True)
    screen.move(230, 150)
    screen.button(RIGHT, False)
    moved, still_ahead = looked(window)
    np.testing.assert_allclose(still_ahead, ahead, atol=VIEW)
    assert np.linalg.norm(moved - stood) > 1e-3
    screen.callbacks["set_scroll_callback"](None, 0.0, 1.0)
    nearer, _ = looked(window)
    assert (nearer - moved) @ ahead > 1e-3
    screen.button(LEFT, True)
    screen.move(260, 180)
    screen.button(LEFT, False)
    assert np.linalg.norm(looked(window)[1] - ahead) > 1e-2


def test_a_selected_body_is_pushed_until_the_button_is_released(opened):
    window, screen = opened
    model = window._scene.model
    data = window._scene.data
    assert not window.pushes().any()
    screen.move(200, 150)
    for at in (1.0, 1.1):
        screen.time = at
        screen.button(LEFT, True)
        screen.button(LEFT, False)
    body = window._perturbation.select
    assert body > 0
    screen.button(RIGHT, True, glfw.MOD_CONTROL)
    screen.move(230, 150)
    wrench = window.pushes()
    assert np.flatnonzero(wrench.any(axis=1)).tolist() == [body]
    across = np.cross(view_of(window)[1], np.array(window._drawn.camera[0].up))
    force = wrench[body, :3] / np.linalg.norm(wrench[body, :3])
    assert force @ across > 0.9  # to the right, as the mouse
    screen.button(RIGHT, False)
    assert not window.pushes().any()
    screen.cursor = (0, 0)
    screen.time = 5.0
    screen.button(LEFT, True)
    screen.button(RIGHT, True)
    assert window._perturbation.select == body  # two clicks, but no double one
    assert model.nbody == len(wrench) == len(data.xpos)


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
    bar = colour_bar(Scale("contour error", "µm", 0.0, 15.07, False, True, MAGNITUDE), 300)
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


@pytest.mark.parametrize("live", [False, True])
def test_window_shows_the_bead_grow_and_ends(display, saved, live):
    process = command(saved / "job.toml" if live else saved, "--speed", "0.25", DISPLAY=display)
    try:
        until(process, lambda: glue(grabbed(display)) > 0)
        before = glue(grabbed(display))
        until(process, lambda: glue(grabbed(display)) > before + BEAD)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
    assert (process.returncode, err) == (130, "interrupted\n")
    assert not grabbed(display).any()
