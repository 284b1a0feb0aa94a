"""Offscreen pictures and video of a run, from its record: the machine, and the bead growing behind the nozzle."""

from __future__ import annotations

import ctypes.util
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.bead import BeadSettings
from gantrysim.bead.sweep import Sweep
from gantrysim.errors import GantryError, InputError, positive, unknown, whole
from gantrysim.machine import WORK, Machine
from gantrysim.run import Run

__all__ = ["NoOpenGLError", "Renderer", "save_video"]

Image = NDArray[np.uint8]

_BEAD = "gantrysim bead"
_BEAD_COLOUR = (0.98, 0.58, 0.10, 1.0)
_LONGEST_VIDEO = 60.0  # [s]
_PACKAGES = "libegl1 (with libgl1-mesa-dri) or libosmesa6"


class NoOpenGLError(GantryError, RuntimeError):
    """No OpenGL library that renders without a display."""


def _gl_context(width: int, height: int) -> Any:
    """Return an offscreen context: EGL, else OSMesa, or what MUJOCO_GL asks for."""
    asked = os.environ.get("MUJOCO_GL", "").lower()
    if asked in ("off", "false", "0", "disable", "disabled"):
        raise NoOpenGLError(f"MUJOCO_GL is {asked}")
    wanted = [asked] if asked in ("egl", "osmesa") else ["egl", "osmesa"]
    failures = ""
    for backend in wanted:
        if ctypes.util.find_library({"egl": "EGL", "osmesa": "OSMesa"}[backend]) is None:
            continue
        try:
            if backend == "egl":
                from mujoco.egl import GLContext
            else:
                from mujoco.osmesa import GLContext
            context = GLContext(width, height)
            context.make_current()
            return context
        except (ImportError, RuntimeError, AttributeError) as error:
            failures += f" ({backend}: {' '.join(str(error).split())})"
    raise NoOpenGLError(f"no OpenGL that needs no display{failures}: install Debian package {_PACKAGES}")


class Renderer:
    """Draws a run at any of its ticks. Use it as a context manager.

    Args:
        machine: the machine that ran.
        run: the record.
        camera: name of a camera of the machine; by default "overview", or a view of everything where there is none.
        size: width and height of the pictures [pixels].
        bead: how the glue lies.

    Raises:
        InputError: no such camera.
        NoOpenGLError: no EGL and no OSMesa.
    """

    def __init__(
        self,
        machine: Machine,
        run: Run,
        camera: str | None = None,
        size: tuple[int, int] = (640, 480),
        bead: BeadSettings | None = None,
    ) -> None:
        width, height = (
            whole(f"{name} of the picture", n, 1) for name, n in zip(("width", "height"), size, strict=True)
        )
        self.size = (width, height)
        self._machine, self._run = machine, run
        self.bead = Sweep(run, bead)
        self.model = _with_bead(machine, self.bead, width, height)
        self.data = mujoco.MjData(self.model)
        self.view = _view(self.model, camera)
        self._gl = _gl_context(width, height)
        self._context = mujoco.MjrContext(self.model, mujoco.mjtFontScale.mjFONTSCALE_150.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._scene = mujoco.MjvScene(self.model, maxgeom=2000)
        self._option = mujoco.MjvOption()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Free the OpenGL context."""
        self._gl.make_current()
        self._context.free()
        self._gl.free()

    def show(self, run: Run) -> None:
        """Draw another run of the machine from now on, with as many rings of the bead."""
        self._run, self.bead = run, Sweep(run, self.bead.strand.settings, self.bead.rings)

    def pose(self, tick: int) -> None:
        """Put the machine where it stood at a tick, with the bead laid until then."""
        self.data.qpos[:] = self._machine.to_qpos(self._run.encoder[tick])
        mujoco.mj_forward(self.model, self.data)
        mesh = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_MESH, _BEAD)
        vertices, normals = self.bead.mesh(tick)
        _mesh_part(self.model, mesh, "vert")[:] = vertices
        _mesh_part(self.model, mesh, "normal")[:] = normals
        self._gl.make_current()
        mujoco.mjr_uploadMesh(self.model, self._context, mesh)

    def frame(self, tick: int) -> Image:
        """Return the picture at a tick, (height, width, 3)."""
        self.pose(tick)
        width, height = self.size
        mujoco.mjv_updateScene(
            self.model, self.data, self._option, None, self.view, mujoco.mjtCatBit.mjCAT_ALL.value, self._scene
        )
        viewport = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(viewport, self._scene, self._context)
        image = np.empty((height, width, 3), np.uint8)
        mujoco.mjr_readPixels(image, None, viewport, self._context)
        return image[::-1]


def save_video(
    machine: Machine,
    run: Run,
    file: Path,
    *,
    camera: str | None = None,
    size: tuple[int, int] = (800, 600),
    fps: float = 25.0,
    speed: float | None = None,
    bead: BeadSettings | None = None,
    progress: Callable[[float], None] | None = None,
) -> int:
    """Write an MP4 of a run and return its number of frames.

    Args:
        machine: the machine that ran.
        run: the record.
        file: to write.
        camera: name of a camera of the machine, as for `Renderer`.
        size: width and height, even numbers [pixels].
        fps: frames per second.
        speed: seconds of the run in a second of video; by default 1, and more where the video would be longer than
            a minute.
        bead: how the glue lies.
        progress: called after each frame with the share that is done, 0 to 1.
    """
    import imageio.v2 as imageio

    if any(value % 2 for value in size):
        raise InputError(f"size of the video = {size[0]} x {size[1]}: must be even numbers of pixels")
    if speed is None:
        speed = max(1.0, float(np.ceil(run.time[-1] / _LONGEST_VIDEO)))
    per_frame = positive("speed of the video", speed) / positive("frames per second", fps, "1/s")
    ticks = list(_frame_ticks(run, per_frame))
    with (
        Renderer(machine, run, camera, size, bead) as renderer,
        imageio.get_writer(file, fps=fps, codec="libx264", quality=8, macro_block_size=1) as writer,
    ):
        for done, tick in enumerate(ticks, 1):
            writer.append_data(renderer.frame(tick))
            if progress is not None:
                progress(done / len(ticks))
    return len(ticks)


def _frame_ticks(run: Run, per_frame: float) -> Iterator[int]:
    for k in range(round(float(run.time[-1]) / per_frame) + 1):
        yield min(round(k * per_frame / run.period), len(run.time) - 1)


def _view(model: mujoco.MjModel, camera: str | None) -> mujoco.MjvCamera:
    """Return the named camera; without a name the one called overview, else a free one that sees machine and bead."""
    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_CAMERA, i) or "" for i in range(model.ncam)]
    view = mujoco.MjvCamera()
    if camera is None and "overview" not in names:
        mujoco.mjv_defaultFreeCamera(model, view)
        return view
    wanted = camera or "overview"
    if wanted not in names:
        raise unknown("camera", wanted, names)
    view.type = mujoco.mjtCamera.mjCAMERA_FIXED
    view.fixedcamid = names.index(wanted)
    return view


def _with_bead(machine: Machine, bead: Sweep, width: int, height: int) -> mujoco.MjModel:
    """Compile the machine once more with the bead's mesh on the work, in the work's own frame."""
    spec = machine.spec.copy()
    vertices, normals = bead.mesh(len(bead.strand.run.time) - 1)
    faces = bead.faces()
    mesh = spec.add_mesh(name=_BEAD)
    # the compiler wants a body with a volume; the vertices that are drawn are written afterwards
    mesh.uservert = np.random.default_rng(0).uniform(-1, 1, vertices.size).astype(np.float32)
    mesh.usernormal = normals.ravel()
    mesh.userface = faces.ravel()
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    spec.add_material(name=_BEAD, rgba=_BEAD_COLOUR, specular=0.6, shininess=0.7)
    work = spec.body(WORK)
    work.add_geom(
        name=_BEAD,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=_BEAD,
        material=_BEAD,
        mass=0,
        contype=0,
        conaffinity=0,
        group=0,
    )
    spec.visual.global_.offwidth = max(int(spec.visual.global_.offwidth), width)
    spec.visual.global_.offheight = max(int(spec.visual.global_.offheight), height)
    model = spec.compile()
    geom = model.geom(_BEAD).id
    # the compiler has moved the mesh to its own inertial frame; the drawn vertices lie in the work's
    model.geom_pos[geom] = 0
    model.geom_quat[geom] = (1, 0, 0, 0)
    model.geom_sameframe[geom] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE
    # views and light are scaled to the machine, and to the bead where that is larger
    model.stat.center[:] = machine.model.stat.center
    model.stat.extent = max(
        float(machine.model.stat.extent), 2e-3 * float(np.ptp(bead.strand.run.nozzle, axis=0).max())
    )
    return model


def _mesh_part(model: mujoco.MjModel, mesh: int, part: str) -> NDArray[np.float32]:
    start = int(getattr(model, f"mesh_{part}adr")[mesh])
    count = int(getattr(model, f"mesh_{part}num")[mesh])
    array: NDArray[np.float32] = getattr(model, f"mesh_{part}")[start : start + count]
    return array
