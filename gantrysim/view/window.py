"""MuJoCo's viewer as a window that a player draws into."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import ModuleType, TracebackType
from typing import Any, Protocol

import mujoco
import numpy as np

from gantrysim.arrays import Floats
from gantrysim.render.scene import Scene
from gantrysim.view.bar import colour_bar
from gantrysim.view.chart import Chart
from gantrysim.view.display import NoDisplayError
from gantrysim.view.panel import Panel

_POLL = 0.05  # how often one that waits looks whether the window is still there, and Ctrl-C may come [s]
_LEAVING = 0.3  # that who is inside has to leave a viewer that draws no more [s]
_NEAR = 0.1  # of the machine's size, what a view turns about at least
_PICTURE = 60.0  # for the first one, which may take long in software, and for the last [s]

_SMALL, _LARGE = mujoco.mjtFontScale.mjFONTSCALE_100.value, mujoco.mjtFontScale.mjFONTSCALE_150.value
_CORNER = mujoco.mjtGridPos


class WindowClosedError(Exception):
    """The window is closed."""


class Window(Protocol):
    """What a player needs of a window; each of these raises WindowClosedError once it is closed."""

    def pressed(self) -> list[int]:
        """Return the keys that were pressed since, by GLFW's numbers."""

    def pose(self, change: Callable[[], None]) -> None:
        """Have the scene changed while nobody draws it, and its bead sent to where it is drawn."""

    def show(self, panel: Panel, chart: Chart) -> None:
        """Show the scene, with texts and chart."""

    def pushes(self) -> Floats:
        """Return the forces and torques of the mouse on the bodies of the scene, (bodies, 6) [N, N·m]."""

    def close(self) -> None:
        """Close it."""


class ViewerWindow:
    """MuJoCo's interactive viewer in its passive form: it draws in a thread of its own, what others pose.

    Uploading a mesh blocks until the viewer's thread takes it, which it never does once the window is closed; and that
    thread then waits for ever, all of Python with it, for those who wait for the upload. So uploads go through a
    thread that may be left behind, and the viewer is freed only when nobody is inside it.

    Args:
        scene: to be shown.
        camera: name of the camera, as `Scene.camera` has it.

    Raises:
        InputError: no such camera.
        NoDisplayError: the viewer opens no window.
        WindowClosedError: it is closed before the first picture.
    """

    def __init__(self, scene: Scene, camera: str | None = None) -> None:
        self._scene = scene
        self._keys: deque[int] = deque()
        self._guard = threading.Lock()  # held by who is inside the viewer
        view = scene.camera(camera)
        threads = set(threading.enumerate())
        self._handle = self._launch()
        self._threads = [thread for thread in threading.enumerate() if thread not in threads]
        self._wanted, self._sent = threading.Semaphore(0), threading.Semaphore(0)
        threading.Thread(target=self._upload, name="bead", daemon=True).start()
        with self._inside() as handle, handle.lock():
            # Esc frees the view: from where the fixed camera stands
            handle.cam.lookat[:], handle.cam.distance, handle.cam.azimuth, handle.cam.elevation = _free(scene, view)
            handle.cam.type, handle.cam.fixedcamid = view.type, view.fixedcamid

    def pressed(self) -> list[int]:
        """Return the keys that were pressed since, by GLFW's numbers."""
        with self._inside():
            return [self._keys.popleft() for _ in range(len(self._keys))]

    def pose(self, change: Callable[[], None]) -> None:
        """Have the scene changed while nobody draws it, and its bead sent to where it is drawn.

        It takes as long as a picture.
        """
        with self._inside() as handle, handle.lock():
            change()
            if handle.user_scn is not None:
                handle.user_scn.ngeom = 0
                self._scene.decorate(handle.user_scn)
        self._wanted.release()
        while not self._sent.acquire(timeout=_POLL):
            if not self._handle.is_running():
                raise WindowClosedError

    def show(self, panel: Panel, chart: Chart) -> None:
        """Show the scene, with texts and chart."""
        with self._inside() as handle:
            texts = [
                (_LARGE, _CORNER.mjGRID_TOPLEFT, *_columns(panel.figures)),
                (_SMALL, _CORNER.mjGRID_BOTTOMLEFT, *_columns(panel.keys)),
            ]
            if panel.fault:
                texts.append((_LARGE, _CORNER.mjGRID_TOPRIGHT, *_columns(panel.fault)))
            handle.set_texts(texts)
            area = handle.viewport
            if area is not None:
                width, height = round(0.42 * area.width), round(0.26 * area.height)
                right = area.left + area.width
                handle.set_figures((mujoco.MjrRect(right - width, area.bottom, width, height), chart.figure))
                if self._scene.scale is not None:
                    bar = colour_bar(self._scene.scale, width)
                    handle.set_images((mujoco.MjrRect(right - width, area.bottom + height, *bar.shape[1::-1]), bar))
            handle.sync()

    def pushes(self) -> Floats:
        """Return the forces and torques of the mouse on the bodies of the scene, (bodies, 6) [N, N·m]."""
        with self._inside() as handle, handle.lock():
            forces: Floats = np.array(self._scene.data.xfrc_applied)
        return forces

    def close(self) -> None:
        """Close it and wait until its thread is done."""
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
            self._wanted.acquire()
            try:
                with self._inside() as handle:
                    handle.update_mesh(self._scene.mesh)
            except WindowClosedError:
                return
            self._sent.release()

    def _launch(self) -> Any:
        """Open the viewer; its thread tells what goes wrong there only by an exception of its own."""
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
            if error.thread is not thread and not _comes_from(viewer, error.exc_traceback):
                hook(error)  # of a thread that has nothing to do with the window
                return
            failed.append(" ".join(str(error.exc_value).split()) or error.exc_type.__name__)

        ended = threading.Event()
        simulate, hook = viewer._Simulate, threading.excepthook
        thread = threading.Thread(target=launch, name="launch", daemon=True)
        viewer._Simulate, threading.excepthook = _freed_when_left(simulate, self._guard, ended), fail
        try:
            thread.start()
            end = time.monotonic() + _PICTURE
            while thread.is_alive() and not failed and not ended.is_set() and time.monotonic() < end:
                thread.join(_POLL)
            if ended.is_set():
                thread.join(_LEAVING)
        finally:
            viewer._Simulate, threading.excepthook = simulate, hook
        if not opened and ended.is_set() and not failed:
            raise WindowClosedError
        if not opened:
            raise NoDisplayError(failed[0] if failed else f"the viewer opened none in {_PICTURE:g} s")
        return opened[0]


def _comes_from(module: ModuleType, trace: TracebackType | None) -> bool:
    """Return whether an error has come through a function of a module."""
    while trace is not None:
        if trace.tb_frame.f_globals is vars(module):
            return True
        trace = trace.tb_next
    return False


def _freed_when_left(simulate: Any, guard: threading.Lock, ended: threading.Event) -> Any:
    """Return MuJoCo's viewer, which tells when it draws no more, and is freed when nobody is inside it, or never."""

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
                _left.append(self)

    return Guarded


_left: list[Any] = []  # viewers that an upload still waits in; the end of the process frees them


def _columns(rows: tuple[tuple[str, str], ...]) -> tuple[str, str]:
    return "\n".join(row[0] for row in rows), "\n".join(row[1] for row in rows)


def _free(scene: Scene, view: mujoco.MjvCamera) -> tuple[Floats, float, float, float]:
    """Return a free camera's look-at point [m], distance [m], azimuth and elevation [deg] that sees as another does."""
    if view.type != mujoco.mjtCamera.mjCAMERA_FIXED:
        return view.lookat.copy(), view.distance, view.azimuth, view.elevation
    position = scene.data.cam_xpos[view.fixedcamid]
    forward = -scene.data.cam_xmat[view.fixedcamid].reshape(3, 3)[:, 2]
    reach = max(float(forward @ (scene.model.stat.center - position)), _NEAR * float(scene.model.stat.extent))
    # as large as there, although a free camera has another angle of view
    angles = np.radians([scene.model.cam_fovy[view.fixedcamid], scene.model.vis.global_.fovy])
    fixed, free = np.tan(0.5 * angles)
    distance = float(fixed / free) * reach
    azimuth = float(np.degrees(np.arctan2(forward[1], forward[0])))
    elevation = float(np.degrees(np.arcsin(np.clip(forward[2], -1, 1))))
    return position + reach * forward, distance, azimuth, elevation
