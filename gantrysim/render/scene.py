"""The machine of a run with its bead, at any of its ticks; without OpenGL, for pictures and for the viewer."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.bead import BeadSettings
from gantrysim.bead.sweep import Sweep
from gantrysim.errors import InputError, unknown
from gantrysim.machine.machine import WORK, Machine
from gantrysim.render.colours import Scale, errors_along, scale_for
from gantrysim.render.drop import drop_at
from gantrysim.render.workpiece import workpiece
from gantrysim.run import Run

_BEAD = "gantrysim bead"
_PIECE = "gantrysim work piece"
_GLUE = (0.98, 0.58, 0.10, 1.0)
_TURNED = (0.45, 0.47, 0.50, 1.0)
# A coloured bead mostly glows, for its colours are held against a scale: of a texture's colour so much is lit, and the
# rest its own light. The machines' lights add up to about 1.1.
_LIT = 0.3
_GLOW = (1 - 1.1 * _LIT) / _LIT


class Scene:
    """A model of the machine with a bead on its work, under one that climbs a body that carries it, and its data.

    Args:
        machine: the machine that ran.
        run: the record.
        bead: how the glue lies.
        colour: what the bead's colour tells, one of `gantrysim.render.colours.COLOURS`.
        scale: of the colours; by default one that fits the run.

    Attributes:
        model: the compiled machine with the bead.
        data: posed by `pose`.
        mesh: number of the bead's mesh in the model, which is to be uploaded after `pose`.
        scale: of the colours, None where the bead is plain.

    Raises:
        InputError: no such colour.
    """

    def __init__(
        self,
        machine: Machine,
        run: Run,
        bead: BeadSettings | None = None,
        *,
        colour: str = "plain",
        scale: Scale | None = None,
    ) -> None:
        self.machine = machine
        self.scale = scale_for(colour, [run], [bead]) if scale is None else scale
        self._colour = colour
        self._take(run, Sweep(run, bead))
        self.model = _with_bead(machine, self.sweep, self.scale)
        self.data = mujoco.MjData(self.model)
        self.mesh = int(self.model.mesh(_BEAD).id)
        self._vertices = _mesh_part(self.model, self.mesh, "vert")
        self._normals = _mesh_part(self.model, self.mesh, "normal")
        self.pose(0)

    def _take(self, run: Run, sweep: Sweep) -> None:
        self.run, self.sweep = run, sweep
        if self._colour == "error":
            self._errors = errors_along(sweep.bead_trace)

    def show(self, run: Run) -> None:
        """Show another run of the machine from now on, with as many rings of the bead.

        Raises:
            TooFewRingsError: they are too few for the ends of all its stretches.
        """
        self._take(run, Sweep(run, self.sweep.bead_trace.settings, self.sweep))

    def pose(self, tick: int) -> None:
        """Put the machine where it stood at a tick, with the bead laid until then."""
        self.data.qpos[:] = self.machine.to_qpos(self.run.encoder[tick])
        mujoco.mj_forward(self.model, self.data)
        mesh = self.sweep.mesh(tick)
        self._vertices[:], self._normals[:] = mesh.vertices, mesh.normals
        if self.scale is not None:
            bead_trace = self.sweep.bead_trace
            values = mesh.width if self._colour == "width" else np.interp(mesh.place, bead_trace.place, self._errors)
            coordinates = _mesh_part(self.model, self.mesh, "texcoord")
            coordinates[:, 0] = _in_texture(self.scale.share(values)).repeat(len(coordinates) // len(values))
        self._drop = drop_at(self.sweep.bead_trace, tick)

    def decorate(self, scene: mujoco.MjvScene) -> None:
        """Add what is no part of the model, the drop at the nozzle, to a scene that holds the model's geoms."""
        if self._drop is None or scene.ngeom >= scene.maxgeom:
            return
        centre, radius, half_height = self._drop
        work = self.machine.work
        frame = self.data.xmat[work].reshape(3, 3)
        geom = scene.geoms[scene.ngeom]
        size = np.array([radius, radius, half_height])
        position = self.data.xpos[work] + frame @ centre
        colour = np.array(_GLUE, np.float32)
        mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_ELLIPSOID, size, position, frame.ravel(), colour)
        geom.specular, geom.shininess = 0.6, 0.7
        scene.ngeom += 1

    def camera(self, name: str | None = None) -> mujoco.MjvCamera:
        """Return a camera: the named one, by default "overview", or a view of everything where there is none of that.

        Raises:
            InputError: no such camera.
        """
        names = [mujoco.mj_id2name(self.model, mujoco.mjtObj.mjOBJ_CAMERA, i) or "" for i in range(self.model.ncam)]
        view = mujoco.MjvCamera()
        if name is None and "overview" not in names:
            mujoco.mjv_defaultFreeCamera(self.model, view)
            return view
        wanted = name or "overview"
        if not any(names):
            lacking = f"machine {self.machine.name} has none"
            raise InputError(f"unknown camera {wanted!r}: {lacking}; leave the camera out to see all of it")
        if wanted not in names:
            raise unknown("camera", wanted, filter(None, names))
        view.type = mujoco.mjtCamera.mjCAMERA_FIXED
        view.fixedcamid = names.index(wanted)
        return view


def _with_bead(machine: Machine, sweep: Sweep, scale: Scale | None) -> mujoco.MjModel:
    """Compile the machine once more with the bead's mesh on the work, in the work's own frame."""
    spec = machine.spec.copy()
    drawn = sweep.mesh(len(sweep.bead_trace.run.time) - 1)
    mesh = spec.add_mesh(name=_BEAD)
    # the compiler wants a body with a volume; the vertices that are drawn are written afterwards
    mesh.uservert = np.random.default_rng(0).uniform(-1, 1, drawn.vertices.size).astype(np.float32)
    mesh.usernormal = drawn.normals.ravel()
    mesh.userface = sweep.faces().ravel()
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    material = spec.add_material(name=_BEAD, rgba=_GLUE, specular=0.6, shininess=0.7)
    if scale is not None:
        mesh.usertexcoord = np.full(2 * len(drawn.vertices), 0.5, np.float32)
        texture = spec.add_texture(name=_BEAD, type=mujoco.mjtTexture.mjTEXTURE_2D, nchannel=3)
        texture.width, texture.height = len(scale.table), 2
        texture.data = np.stack([scale.table, scale.table]).tobytes()
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = _BEAD
        material.rgba, material.emission, material.specular = (_LIT, _LIT, _LIT, 1), _GLOW, 0.0
    _add_to_work(spec, _BEAD, group=0)
    _add_piece(spec, sweep)
    model = spec.compile()
    geom = model.geom(_BEAD).id
    # the compiler has moved the mesh to its own inertial frame; the drawn vertices lie in the work's
    model.geom_pos[geom] = 0
    model.geom_quat[geom] = (1, 0, 0, 0)
    model.geom_sameframe[geom] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE
    # views and light are scaled to the machine, and to the bead where that is larger
    model.stat.center[:] = machine.model.stat.center
    model.stat.extent = max(
        float(machine.model.stat.extent), 2e-3 * float(np.ptp(sweep.bead_trace.run.nozzle, axis=0).max())
    )
    return model


def _add_piece(spec: mujoco.MjSpec, sweep: Sweep) -> None:
    """Put a body under a bead that climbs."""
    piece = workpiece(sweep.bead_trace.run, sweep.bead_trace.settings)
    if piece is None:
        return
    mesh = spec.add_mesh(name=_PIECE, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    mesh.uservert = piece.vertices.ravel().astype(np.float32)
    mesh.userface = piece.faces.ravel()
    spec.add_material(name=_PIECE, rgba=_TURNED, specular=0.3, shininess=0.4)
    _add_to_work(spec, _PIECE, group=2)


def _add_to_work(spec: mujoco.MjSpec, name: str, group: int) -> None:
    """Put the mesh of a name, with the material of the same, on the work, where it is only seen."""
    mesh = mujoco.mjtGeom.mjGEOM_MESH
    looks = {"type": mesh, "meshname": name, "material": name, "group": group}
    spec.body(WORK).add_geom(name=name, mass=0, contype=0, conaffinity=0, **looks)


def _in_texture(shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where colours lie in a texture of 256: from the middle of the first to that of the last."""
    return (0.5 + 255 * shares) / 256


def _mesh_part(model: mujoco.MjModel, mesh: int, part: str) -> NDArray[np.float32]:
    start = int(getattr(model, f"mesh_{part}adr")[mesh])
    count = int(getattr(model, f"mesh_{part}num")[mesh])
    return getattr(model, f"mesh_{part}")[start : start + count]
