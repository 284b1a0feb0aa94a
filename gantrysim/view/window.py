"""MuJoCo's viewer as a window that a player draws into."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from traceback import walk_tb
from typing import Any

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.render.legend import colour_bar
from gantrysim.render.scene import Scene
from gantrysim.view.chart import Chart
from gantrysim.view.display import NoDisplayError
from gantrysim.view.texts import Texts

_POLL = 0.05  # interval at which waiting threads check the window and Ctrl-C [s]
_LEAVING = 0.3  # for threads to leave a viewer that has stopped drawing [s]
_NEAR = 0.1  # least distance of the free camera's look-at point, of the machine's size
_PICTURE = 60.0  # for the first picture, slow in software, and for the last [s]

_SMALL = mujoco.mjtFontScale.mjFONTSCALE_100.value
_LARGE = mujoco.mjtFontScale.mjFONTSCALE_150.value
_CORNER = mujoco.mjtGridPos


class WindowClosedError(Exception):
    """The window is closed."""


class ViewerWindow:
    """MuJoCo's passive viewer, which draws the scene in a thread of its own.

    Uploading a mesh blocks until the viewer's thread takes it. Once the window is closed it never does, and then waits
    forever for the blocked uploader, with all of Python. So uploads run in a thread that may be abandoned, and the
    viewer is freed only while no thread is inside it. Methods raise WindowClosedError once the window is closed.

    Args:
        scene: to be shown.
        camera: name of the camera, as for `Scene.camera`.

    Raises:
        InputError: no such camera.
        NoDisplayError: the viewer opens no window.
        WindowClosedError: the window is closed before the first picture.
    """

    def __init__(self, scene: Scene, camera: str | None = None) -> None:
        self._scene = scene
        self._keys: deque[int] = deque()
        self._guard = threading.Lock()  # held by the thread inside the viewer
        view = scene.camera(camera)
        threads = set(threading.enumerate())
        self._handle = self._launch()
        self._threads = [thread for thread in threading.enumerate() if thread not in threads]
        self._requested = threading.Semaphore(0)
        self._uploaded = threading.Semaphore(0)
        threading.Thread(target=self._upload, name="bead", daemon=True).start()
        with self._inside() as handle, handle.lock():
            # Esc frees the viewer's own camera, at the pose of the fixed one
            free_camera = handle.cam
            free_camera.lookat[:], free_camera.distance, free_camera.azimuth, free_camera.elevation = _free_view(
                scene, view
            )
            free_camera.type = view.type
            free_camera.fixedcamid = view.fixedcamid

    def pressed(self) -> list[int]:
        """Return the keys pressed since the last call, by GLFW's codes."""
        with self._inside():
            return [self._keys.popleft() for _ in range(len(self._keys))]

    def pose(self, change: Callable[[], None]) -> None:
        """Change the scene while it is not being drawn, and upload its bead; takes as long as a picture."""
        with self._inside() as handle, handle.lock():
            change()
            if handle.user_scn is not None:
                handle.user_scn.ngeom = 0
                self._scene.decorate(handle.user_scn)
        self._requested.release()
        while not self._uploaded.acquire(timeout=_POLL):
            if not self._handle.is_running():
                raise WindowClosedError

    def show(self, texts: Texts, chart: Chart) -> None:
        """Show the scene with texts and chart."""
        with self._inside() as handle:
            parts = (
                (_LARGE, _CORNER.mjGRID_TOPLEFT, texts.values),
                (_SMALL, _CORNER.mjGRID_BOTTOMLEFT, texts.keys),
                (_LARGE, _CORNER.mjGRID_TOPRIGHT, texts.fault),
            )
            columns = ((size, corner, *map("\n".join, zip(*rows, strict=True))) for size, corner, rows in parts if rows)
            handle.set_texts(list(columns))
            area = handle.viewport
            if area is not None:
                width = round(0.42 * area.width)
                height = round(0.26 * area.height)
                right = area.left + area.width
                handle.set_figures((mujoco.MjrRect(right - width, area.bottom, width, height), chart.figure))
                if self._scene.scale is not None:
                    bar = colour_bar(self._scene.scale, width)
                    handle.set_images((mujoco.MjrRect(right - width, area.bottom + height, *bar.shape[1::-1]), bar))
            handle.sync()

    def pushes(self) -> Floats:
        """Return the mouse's forces and torques on the bodies of the scene, (bodies, 6) [N, N·m]."""
        with self._inside() as handle, handle.lock():
            return np.array(self._scene.data.xfrc_applied)

    def close(self) -> None:
        """Close the window and wait for its thread."""
        with suppress(WindowClosedError), self._inside() as handle:
            handle.close()
        for thread in self._threads:
            thread.join(_PICTURE)

    @contextmanager
    def _inside(self) -> Iterator[Any]:
        while not self._guard.acquire(timeout=_POLL):
            if not self._handle.is_running():
                raise WindowClosedError
        try:
            if not self._handle.is_running():
                raise WindowClosedError
            yield self._handle
        finally:
            self._guard.release()

    def _upload(self) -> None:
        while True:
            self._requested.acquire()
            try:
                with self._inside() as handle:
                    handle.update_mesh(self._scene.mesh)
            except WindowClosedError:
                return
            self._uploaded.release()

    def _launch(self) -> Any:
        """Open the viewer; errors in its thread arrive through `threading.excepthook`."""
        import mujoco.viewer as viewer

        opened: list[Any] = []
        failed: list[str] = []

        def launch() -> None:
            opened.append(
                viewer.launch_passive(
                    self._scene.model,
                    self._scene.data,
                    key_callback=self._keys.append,
                    show_left_ui=False,
                    show_right_ui=False,
                )
            )

        def fail(error: threading.ExceptHookArgs) -> None:
            inside = any(frame.f_globals is vars(viewer) for frame, _ in walk_tb(error.exc_traceback))
            if error.thread is not thread and not inside:
                hook(error)  # of an unrelated thread
                return
            failed.append(" ".join(str(error.exc_value).split()) or error.exc_type.__name__)

        ended = threading.Event()
        simulate = viewer._Simulate
        hook = threading.excepthook
        thread = threading.Thread(target=launch, name="launch", daemon=True)
        viewer._Simulate = _guarded(simulate, self._guard, ended)
        threading.excepthook = fail
        try:
            thread.start()
            end = time.monotonic() + _PICTURE
            while thread.is_alive() and not failed and not ended.is_set() and time.monotonic() < end:
                thread.join(_POLL)
            if ended.is_set():
                thread.join(_LEAVING)
        finally:
            viewer._Simulate = simulate
            threading.excepthook = hook
        if not opened and ended.is_set() and not failed:
            raise WindowClosedError
        if not opened:
            raise NoDisplayError(failed[0] if failed else f"the viewer opened no window in {_PICTURE:g} s")
        return opened[0]


def _guarded(simulate: Any, guard: threading.Lock, ended: threading.Event) -> Any:
    """Return a class of MuJoCo's viewer that signals its end and is freed only while no thread is inside it."""

    class Guarded(simulate):  # type: ignore[misc]
        def render_loop(self) -> None:
            super().render_loop()
            ended.set()

        def destroy(self) -> None:
            if guard.acquire(timeout=_LEAVING):
                try:
                    super().destroy()
                finally:
                    guard.release()
            else:
                _abandoned.append(self)

    return Guarded


_abandoned: list[Any] = []  # viewers with a blocked upload, kept until the process ends


def _free_view(scene: Scene, view: mujoco.MjvCamera) -> tuple[Floats, float, float, float]:
    """Return look-at point [m], distance [m], azimuth and elevation [deg] of a free camera with the view of another."""
    if view.type != mujoco.mjtCamera.mjCAMERA_FIXED:
        return view.lookat.copy(), view.distance, view.azimuth, view.elevation
    position = scene.data.cam_xpos[view.fixedcamid]
    forward = -scene.data.cam_xmat[view.fixedcamid].reshape(3, 3)[:, 2]
    reach = max(float(forward @ (scene.model.stat.center - position)), _NEAR * float(scene.model.stat.extent))
    # the same scale, although a free camera has another field of view
    angles = np.radians([scene.model.cam_fovy[view.fixedcamid], scene.model.vis.global_.fovy])
    fixed, free = np.tan(0.5 * angles)
    distance = float(fixed / free) * reach
    azimuth = float(np.degrees(np.arctan2(forward[1], forward[0])))
    elevation = float(np.degrees(np.arcsin(np.clip(forward[2], -1, 1))))
    return position + reach * forward, distance, azimuth, elevation
