"""A window that a player draws into: MuJoCo's drawing functions in a window of GLFW."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Mapping
from typing import Any

import glfw
import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import GantryError
from gantrysim.render.panel import colour_bar
from gantrysim.render.scene import Scene
from gantrysim.render.view.texts import Chart, Texts

# Windows with OpenGL, by GLFW, or the reason why there is none.

_HINT = "`gantrysim render RUN_DIR` makes a video"
_SAMPLES = 4  # of a pixel, for smooth edges


class NoDisplayError(GantryError, RuntimeError):
    """No display to open a window on, with the reason."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"cannot open a window: {reason}; {_HINT}")


def check_display(platform: str = sys.platform, environment: Mapping[str, str] = os.environ) -> None:
    """Check that a window with OpenGL can be opened, by opening a hidden one.

    Args:
        platform: as `sys.platform`.
        environment: environment variables.

    Raises:
        NoDisplayError: no display.
    """
    import glfw

    if platform.startswith("linux") and not (environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY")):
        raise NoDisplayError("neither DISPLAY nor WAYLAND_DISPLAY is set")
    open_window(16, 16, visible=False)
    glfw.terminate()


def open_window(width: int, height: int, *, visible: bool = True) -> Any:
    """Return a new window of GLFW with an OpenGL context; `glfw.terminate` closes it.

    Args:
        width: of the window [pixels of the screen].
        height: of the window [pixels of the screen].
        visible: whether it is shown.

    Raises:
        NoDisplayError: no display, or one without OpenGL.
    """
    import glfw

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        if glfw.init():
            glfw.window_hint(glfw.VISIBLE, visible)
            glfw.window_hint(glfw.SAMPLES, _SAMPLES)
            window = glfw.create_window(width, height, "gantrysim", None, None)
            if window:
                return window
            glfw.terminate()
    reasons = dict.fromkeys(_message(str(warning.message)) for warning in caught)
    raise NoDisplayError("; ".join(reasons) or "GLFW finds no display")


def _message(warning: str) -> str:
    """Return the message of a GLFW warning such as "(65550) b'X11: Failed to open display :9'"."""
    text = warning.partition(") ")[2] or warning
    return text.removeprefix("b").strip("'\"")


_FIRST_SIZE = (1000, 720)  # of the window at first [pixels of the screen]
_MOST_GEOMS = 2000
_LEAST_DISTANCE = 0.1  # least distance of the free camera's look-at point, of the machine's size
_DOUBLE_CLICK = 0.3  # longest time between its clicks [s]
_FONT = 150  # its size on a usual display [%]
_ZOOM = 0.05  # per step of the mouse wheel, of the distance

_CATEGORIES = mujoco.mjtCatBit.mjCAT_ALL.value
_FIXED_CAMERA = mujoco.mjtCamera.mjCAMERA_FIXED
_TRANSLATE = mujoco.mjtPertBit.mjPERT_TRANSLATE.value
_ROTATE = mujoco.mjtPertBit.mjPERT_ROTATE.value
_CORNER = mujoco.mjtGridPos
_MOUSE = mujoco.mjtMouse


class WindowClosedError(Exception):
    """The window is closed."""


class ViewerWindow:
    """A window that shows a scene; the mouse moves the camera and pushes bodies.

    All of it happens in the thread that opens it and calls its methods, as mouse and keys are read by
    `take_pressed_keys`. MuJoCo's own passive viewer draws in a thread of its own, in which closing it while a mesh is
    uploaded blocks all of Python for good.

    Args:
        scene: to be shown.
        camera: name of the camera, as for `Scene.camera`.

    Raises:
        InputError: no such camera.
        NoDisplayError: no window can be opened.
    """

    def __init__(self, scene: Scene, camera: str | None = None) -> None:
        self._scene = scene
        self._camera = scene.camera(camera)
        self._option = mujoco.MjvOption()
        self._perturbation = mujoco.MjvPerturb()
        self._keys: list[int] = []
        self._clicked: tuple[int, float] | None = None
        self._window = open_window(*_FIRST_SIZE)
        glfw.make_context_current(self._window)
        glfw.swap_interval(1)
        self._context = mujoco.MjrContext(scene.model, self._font_scale())
        self._drawn = mujoco.MjvScene(scene.model, maxgeom=_MOST_GEOMS)
        self._cursor = glfw.get_cursor_pos(self._window)
        glfw.set_key_callback(self._window, self._key)
        glfw.set_mouse_button_callback(self._window, self._button)
        glfw.set_cursor_pos_callback(self._window, self._move)
        glfw.set_scroll_callback(self._window, self._scroll)

    def take_pressed_keys(self) -> list[int]:
        """Return the keys pressed since the last call, by GLFW's codes.

        Raises:
            WindowClosedError: the window is closed.
        """
        glfw.poll_events()
        if glfw.window_should_close(self._window):
            raise WindowClosedError
        keys = self._keys
        self._keys = []
        return keys

    def pose(self, change: Callable[[], None]) -> None:
        """Change the scene, and upload its bead."""
        change()
        mujoco.mjr_uploadMesh(self._scene.model, self._context, self._scene.mesh)

    def show(self, texts: Texts, chart: Chart) -> None:
        """Show the scene with texts and chart; takes until the screen shows it."""
        scene = self._scene
        context = self._context
        area = mujoco.MjrRect(0, 0, *glfw.get_framebuffer_size(self._window))
        if area.width == 0 or area.height == 0:  # minimised
            return
        mujoco.mjv_updateScene(
            scene.model, scene.data, self._option, self._perturbation, self._camera, _CATEGORIES, self._drawn
        )
        scene.decorate(self._drawn)
        mujoco.mjr_render(area, self._drawn, context)
        for corner, rows in (
            (_CORNER.mjGRID_TOPLEFT, texts.values),
            (_CORNER.mjGRID_BOTTOMLEFT, texts.keys),
            (_CORNER.mjGRID_TOPRIGHT, texts.fault),
        ):
            if rows:
                names, values = ("\n".join(column) for column in zip(*rows, strict=True))
                mujoco.mjr_overlay(mujoco.mjtFont.mjFONT_NORMAL, corner, area, names, values, context)
        width = round(0.42 * area.width)
        height = round(0.32 * area.height)
        edge = area.width - width
        mujoco.mjr_figure(mujoco.MjrRect(edge, 0, width, height), chart.figure, context)
        if scene.scale is not None:
            bar = colour_bar(scene.scale, width)
            place = mujoco.MjrRect(edge, height, width, bar.shape[0])
            mujoco.mjr_drawPixels(np.ascontiguousarray(bar[::-1]).ravel(), None, place, context)
        glfw.swap_buffers(self._window)

    def pushes(self) -> Floats:
        """Return the mouse's forces and torques on the bodies of the scene, (bodies, 6) [N, N·m]."""
        data = self._scene.data
        data.xfrc_applied[:] = 0.0
        mujoco.mjv_applyPerturbForce(self._scene.model, data, self._perturbation)
        return np.array(data.xfrc_applied)

    def close(self) -> None:
        """Close the window."""
        self._context.free()
        glfw.terminate()

    def _font_scale(self) -> int:
        """Return the size of the font for that of the display's, one of MuJoCo's [%]."""
        scale = float(glfw.get_window_content_scale(self._window)[0])
        return int(np.clip(50 * round(_FONT * scale / 50), 100, 300))

    def _key(self, _window: Any, key: int, _scan_code: int, action: int, _modifiers: int) -> None:
        if action != glfw.PRESS:
            return
        if key == glfw.KEY_ESCAPE:
            self._camera = free_view(self._scene, self._camera)
        elif key in (glfw.KEY_LEFT_BRACKET, glfw.KEY_RIGHT_BRACKET):
            self._switch_camera(1 if key == glfw.KEY_RIGHT_BRACKET else -1)
        else:
            self._keys.append(key)

    def _switch_camera(self, step: int) -> None:
        """Look through the next or the last camera of the machine, if it has any."""
        count = self._scene.model.ncam
        if count == 0:
            return
        present = self._camera.fixedcamid if self._camera.type == _FIXED_CAMERA else min(-step, 0)
        self._camera.type = _FIXED_CAMERA
        self._camera.fixedcamid = (present + step) % count

    def _button(self, window: Any, button: int, action: int, modifiers: int) -> None:
        self._perturbation.active = 0
        if action != glfw.PRESS:
            return
        now = glfw.get_time()
        if self._clicked is not None and self._clicked[0] == button and now - self._clicked[1] < _DOUBLE_CLICK:
            self._select(window)
        self._clicked = (button, now)
        if modifiers & glfw.MOD_CONTROL and self._perturbation.select > 0:
            mujoco.mjv_initPerturb(self._scene.model, self._scene.data, self._drawn, self._perturbation)
            self._perturbation.active = _TRANSLATE if button == glfw.MOUSE_BUTTON_RIGHT else _ROTATE

    def _select(self, window: Any) -> None:
        """Select the body under the cursor; none where there is only the world."""
        scene = self._scene
        width, height = glfw.get_window_size(window)
        x, y = glfw.get_cursor_pos(window)
        point = np.zeros(3)
        geom, flex, skin = (np.zeros(1, np.int32) for _ in range(3))
        place = (width / height, x / width, 1.0 - y / height)
        body = mujoco.mjv_select(scene.model, scene.data, self._option, *place, self._drawn, point, geom, flex, skin)
        self._perturbation.select = max(body, 0)
        if body > 0:
            offset = point - scene.data.xpos[body]
            self._perturbation.localpos = scene.data.xmat[body].reshape(3, 3).T @ offset

    def _move(self, window: Any, x: float, y: float) -> None:
        buttons = (glfw.MOUSE_BUTTON_LEFT, glfw.MOUSE_BUTTON_RIGHT, glfw.MOUSE_BUTTON_MIDDLE)
        turns, moves, zooms = (glfw.get_mouse_button(window, button) == glfw.PRESS for button in buttons)
        is_shifted = glfw.PRESS in (glfw.get_key(window, key) for key in (glfw.KEY_LEFT_SHIFT, glfw.KEY_RIGHT_SHIFT))
        height = glfw.get_window_size(window)[1]
        step = ((x - self._cursor[0]) / height, (y - self._cursor[1]) / height)
        self._cursor = (x, y)
        if moves:
            action = _MOUSE.mjMOUSE_MOVE_H if is_shifted else _MOUSE.mjMOUSE_MOVE_V
        elif turns:
            action = _MOUSE.mjMOUSE_ROTATE_H if is_shifted else _MOUSE.mjMOUSE_ROTATE_V
        else:
            action = _MOUSE.mjMOUSE_ZOOM
        scene = self._scene
        if self._perturbation.active:
            mujoco.mjv_movePerturb(scene.model, scene.data, action, *step, self._drawn, self._perturbation)
        elif turns or moves or zooms:
            self._move_camera(action, *step)

    def _scroll(self, _window: Any, _across: float, along: float) -> None:
        # upwards comes nearer, as on a page
        self._move_camera(_MOUSE.mjMOUSE_ZOOM, 0.0, _ZOOM * along)

    def _move_camera(self, action: mujoco.mjtMouse, across: float, down: float) -> None:
        """Move the camera by shares of the window's height; a fixed one becomes free."""
        if self._camera.type == _FIXED_CAMERA:
            self._camera = free_view(self._scene, self._camera)
        mujoco.mjv_moveCamera(self._scene.model, action, across, down, self._camera)


def free_view(scene: Scene, view: mujoco.MjvCamera) -> mujoco.MjvCamera:
    """Return a free camera with the view of another."""
    free = mujoco.MjvCamera()
    if view.type != _FIXED_CAMERA:
        free.lookat[:] = view.lookat
        free.distance = view.distance
        free.azimuth = view.azimuth
        free.elevation = view.elevation
        return free
    position = scene.data.cam_xpos[view.fixedcamid]
    forward = -scene.data.cam_xmat[view.fixedcamid].reshape(3, 3)[:, 2]
    reach = max(float(forward @ (scene.model.stat.center - position)), _LEAST_DISTANCE * float(scene.model.stat.extent))
    # the same scale, although a free camera has another field of view
    angles = np.radians([scene.model.cam_fovy[view.fixedcamid], scene.model.vis.global_.fovy])
    fixed, free_tangent = np.tan(0.5 * angles)
    free.lookat[:] = position + reach * forward
    free.distance = float(fixed / free_tangent) * reach
    free.azimuth = float(np.degrees(np.arctan2(forward[1], forward[0])))
    free.elevation = float(np.degrees(np.arcsin(np.clip(forward[2], -1, 1))))
    return free
