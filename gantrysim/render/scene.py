"""Model of a machine with the bead of a run, posed at any tick; without OpenGL, for pictures and for the viewer."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import unknown
from gantrysim.engine.arguments import check_argument
from gantrysim.glue.bead import BeadSettings
from gantrysim.glue.bead.sweep import SIDES, Mesh, Sweep, faces
from gantrysim.glue.bead.trace import BeadTrace
from gantrysim.machine.machine import NEEDLE, NOZZLE, WORK, Machine
from gantrysim.machine.quiet import quiet
from gantrysim.record.run import Run, check_run
from gantrysim.render.colours import BY_WIDTH, PLAIN, Scale, chosen_colour, scale_for, values_along
from gantrysim.render.workpiece import workpiece

# The mesh of a growing bead in a MuJoCo model, in pieces: a picture uploads those that its glue has changed.

_RINGS = 64  # of a piece: of fewer, more geoms are drawn; of more, more rings are uploaded with every picture
_SHOWN = 0  # group of geoms that pictures show
_ABSENT_GROUP = 5  # group of geoms that no picture shows
_CORNERS = SIDES + 1  # vertices of a ring

Singles = NDArray[np.float32]


def piece_slices(rings: int, in_pieces: bool) -> list[slice]:
    """Return the rings of each piece of a mesh; neighbours share one."""
    step = _RINGS if in_pieces else rings
    return [slice(first, min(first + step, rings - 1) + 1) for first in range(0, rings - 1, step)]


def add_pieces(spec: mujoco.MjSpec, name: str, pieces: list[slice], textured: bool) -> list[str]:
    """Add the meshes of a bead's pieces to a model that is still to be compiled, and return their names."""
    names = [f"{name} {number}" if number else name for number in range(len(pieces))]
    # the compiler requires a volume; the drawn vertices are written later
    generator = np.random.default_rng(0)
    for piece_name, piece in zip(names, pieces, strict=True):
        rings = piece.stop - piece.start
        vertices = rings * _CORNERS
        mesh = spec.add_mesh(name=piece_name, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
        mesh.uservert = generator.uniform(-1, 1, 3 * vertices).astype(np.float32)
        mesh.usernormal = np.tile([0.0, 0.0, 1.0], vertices)
        mesh.userface = faces(rings).ravel()
        if textured:
            mesh.usertexcoord = np.full(2 * vertices, 0.5, np.float32)
    return names


class BeadMesh:
    """Writes a bead into the meshes of its pieces.

    Args:
        model: compiled, with the meshes of `add_pieces`, each shown by a geom of its name.
        names: of the pieces.
        pieces: their rings.

    Attributes:
        meshes: numbers of the meshes.
        geoms: numbers of the geoms.
    """

    def __init__(self, model: mujoco.MjModel, names: list[str], pieces: list[slice]) -> None:
        self._model = model
        self._pieces = pieces
        self.meshes = [int(model.mesh(name).id) for name in names]
        self.geoms = [int(model.geom(name).id) for name in names]
        self._laid = 0  # rings
        self._written = np.full((pieces[-1].stop, 6 * _CORNERS + 1), np.nan, np.float32)

    def write(self, bead: Mesh, coordinates: Singles) -> list[int]:
        """Show a bead, and return the meshes that have to be uploaded for it.

        Args:
            bead: its rings that are laid.
            coordinates: of the rings in the texture of colours, (rings,).
        """
        laid = len(bead.place)
        vertices = bead.vertices.reshape(laid, -1)
        rows = np.hstack([vertices, bead.normals.reshape(laid, -1), coordinates[:, None]])
        changed = np.any(rows != self._written[:laid], axis=1)
        self._written[:laid] = rows
        self._written[laid:] = np.nan
        uploads = []
        for number, piece in enumerate(self._pieces):
            is_laid = piece.start < laid - 1 or number == 0
            self._model.geom_group[self.geoms[number]] = _SHOWN if is_laid else _ABSENT_GROUP
            has_end = self._laid != laid and laid < piece.stop
            if is_laid and (has_end or changed[piece].any()):
                self._write_piece(number, rows[piece])
                uploads.append(self.meshes[number])
        self._laid = laid
        return uploads

    def _write_piece(self, number: int, rows: Singles) -> None:
        """Write the rings of a piece; those not yet laid collapse onto the last one."""
        rings = self._pieces[number].stop - self._pieces[number].start
        rows = np.concatenate([rows, rows[-1:].repeat(rings - len(rows), axis=0)])
        corners = 3 * _CORNERS
        mesh = self.meshes[number]
        mesh_part(self._model, mesh, "vert")[:] = rows[:, :corners].reshape(-1, 3)
        mesh_part(self._model, mesh, "normal")[:] = rows[:, corners : 2 * corners].reshape(-1, 3)
        texture_places = mesh_part(self._model, mesh, "texcoord")
        if len(texture_places):
            texture_places[:, 0] = rows[:, -1].repeat(_CORNERS)


def mesh_part(model: mujoco.MjModel, mesh: int, part: str) -> Singles:
    """Return the vert, normal or texcoord of a mesh, as rows that can be written."""
    start = int(getattr(model, f"mesh_{part}adr")[mesh])
    count = int(getattr(model, f"mesh_{part}num")[mesh])
    return np.asarray(getattr(model, f"mesh_{part}")[start : start + count])


_BEAD = "gantrysim bead"
GLOSS = "gantrysim gloss"  # light that the crest of a bead reflects into the camera
_GLOSS_SPECULAR = 0.8
_PIECE = "gantrysim work piece"
_GLUE = (0.98, 0.58, 0.10, 1.0)
_TURNED_COLOUR = (0.45, 0.47, 0.50, 1.0)
# A coloured bead mostly glows, so that its colours match the scale: _LIT of a colour is lit, the rest is emitted. The
# machines' lights add up to about 1.1.
_LIT = 0.3
_GLOW = (1 - 1.1 * _LIT) / _LIT
# wet glue reflects lights in small bright spots, whatever its colour
_WET_SPECULAR = 1.0
_WET_SHININESS = 0.3
_WET_LIT = 0.45
_WET_GLOW = 0.75 / _WET_LIT - 1.1
_WETTED = 1.0  # height that a drop climbs up the needle, in radii of the free thread
_ON_AXIS = 1e-4  # distance of parts in line with the needle [m]
_HANGS = 3.0  # length that a drop hangs down, in radii of the free thread


class Scene:
    """The machine with the bead on its work, the body under a climbing bead, and the drop at the needle.

    Args:
        machine: the machine of the run.
        run: the record.
        bead: settings of the bead, or the bead itself.
        colour: quantity that colours the bead, one of `gantrysim.render.colours.COLOURS`.
        scale: of the colours; by default one that fits the run.
        in_pieces: whether the bead has several meshes, so that less is uploaded for a picture; they have to be drawn by
            `draw_bead`.

    Attributes:
        model: the compiled machine with the bead.
        data: posed by `pose`.
        mesh: number of the bead's mesh in the model, or of its first piece, to be uploaded after `pose`.
        bead_geoms: numbers of the geoms that show the bead.
        scale: of the colours, None for a plain bead.

    Raises:
        InputError: no such colour.
    """

    def __init__(
        self,
        machine: Machine,
        run: Run,
        bead: BeadSettings | BeadTrace | None = None,
        *,
        colour: str = "plain",
        scale: Scale | None = None,
        in_pieces: bool = False,
    ) -> None:
        check_argument("machine", machine)
        check_run(run)
        self.machine = machine
        colour = chosen_colour(colour, [run])
        self.scale = scale_for(colour, [run], [bead]) if scale is None else scale
        self._colour = colour
        self._set_run(run, Sweep(run, bead))
        self._in_pieces = in_pieces
        pieces = piece_slices(self.sweep.rings, in_pieces)
        self.model, names = _with_bead(machine, self.sweep, self.scale, pieces)
        self.data = mujoco.MjData(self.model)
        self._bead = BeadMesh(self.model, names, pieces)
        self.mesh = self._bead.meshes[0]
        self.bead_geoms = self._bead.geoms
        self.pose(0)

    def _set_run(self, run: Run, sweep: Sweep) -> None:
        self.run = run
        self.sweep = sweep
        if self._colour not in (PLAIN, BY_WIDTH):
            self._along = values_along(self._colour, sweep.bead_trace)

    def show(self, run: Run) -> None:
        """Show another run of the machine from now on, with the same needle and number of bead rings.

        Raises:
            TooFewRingsError: too few rings for the ends of its stretches.
        """
        self._set_run(run, Sweep(run, self.sweep.bead_trace.settings, self.sweep))

    def make_wet(self) -> None:
        """Let the bead shine in the light `GLOSS`; a coloured one then shows its scale less exactly."""
        material = self.model.material(_BEAD).id
        self.model.mat_specular[material] = _WET_SPECULAR
        self.model.mat_shininess[material] = _WET_SHININESS
        if self.scale is not None:
            # a texture multiplies the specular light too: what is lit to the full would not shine
            self.model.mat_rgba[material, :3] = _WET_LIT
            self.model.mat_emission[material] = _WET_GLOW
        self.model.light_active[self.model.light(GLOSS).id] = 1

    def pose(self, tick: int) -> None:
        """Pose the machine at a tick, with the bead laid until then."""
        self.data.qpos[:] = self.machine.to_qpos(self.run.encoder[tick])
        with quiet():
            mujoco.mj_forward(self.model, self.data)
        self._laid = self.sweep.laid(tick)
        self._drop = _drop_at(self.sweep, tick)
        if not self._in_pieces:
            self.draw_bead()

    def draw_bead(self) -> list[int]:
        """Draw the bead of the present pose, and return the meshes to be uploaded."""
        return self._bead.write(self._laid, self._texture_places())

    def _texture_places(self) -> NDArray[np.float32]:
        """Return the places of the laid rings in the texture of colours, (rings,)."""
        mesh = self._laid
        if self.scale is None:
            return np.zeros(mesh.place.size, np.float32)
        bead_trace = self.sweep.bead_trace
        values = mesh.width if self._colour == BY_WIDTH else np.interp(mesh.place, bead_trace.place, self._along)
        # from the first texel's middle to the last one's
        places = (0.5 + 255 * self.scale.share(values)) / 256
        return places.astype(np.float32)

    def decorate(self, scene: mujoco.MjvScene) -> None:
        """Add the drop at the nozzle, which is not part of the model, to a scene that holds the model's geoms."""
        if self._drop is None or scene.ngeom >= scene.maxgeom:
            return
        centre, radius, half_height = self._drop
        work = self.machine.work
        frame = self.data.xmat[work].reshape(3, 3)
        geom = scene.geoms[scene.ngeom]
        size = np.array([radius, radius, half_height])
        position = self.data.xpos[work] + frame @ centre
        colour = np.array(_GLUE, np.float32)
        glow = 0.0
        if self.scale is not None and self._laid.place.size:
            last = round(float(self._texture_places()[-1]) * len(self.scale.table) - 0.5)
            colour[:3] = _LIT / 255 * self.scale.table[last]
            glow = _GLOW
        mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_ELLIPSOID, size, position, frame.ravel(), colour)
        geom.emission = glow
        geom.specular = _WET_SPECULAR
        geom.shininess = _WET_SHININESS
        scene.ngeom += 1

    @property
    def _cameras(self) -> list[str]:
        """Names of the machine's cameras, empty for one without."""
        return [mujoco.mj_id2name(self.model, mujoco.mjtObj.mjOBJ_CAMERA, i) or "" for i in range(self.model.ncam)]

    def camera(self, name: str | None = None) -> mujoco.MjvCamera:
        """Return the named camera, by default "overview", or a view of everything on a machine without that.

        Raises:
            InputError: no such camera.
        """
        names = self._cameras
        view = mujoco.MjvCamera()
        if name is None and "overview" not in names:
            mujoco.mjv_defaultFreeCamera(self.model, view)
            return view
        requested = name or "overview"
        if requested not in names:
            raise unknown("camera", requested, filter(None, names))
        view.type = mujoco.mjtCamera.mjCAMERA_FIXED
        view.fixedcamid = names.index(requested)
        return view


def _with_bead(
    machine: Machine, sweep: Sweep, scale: Scale | None, pieces: list[slice]
) -> tuple[mujoco.MjModel, list[str]]:
    """Return the compiled machine with a bead, and the body under a climbing one, in the work's frame; and its pieces.

    The pieces are named.
    """
    spec = machine.spec.copy()
    run = sweep.bead_trace.run
    names = add_pieces(spec, _BEAD, pieces, scale is not None)
    material = spec.add_material(name=_BEAD, rgba=_GLUE, specular=0.6, shininess=0.7)
    if scale is not None:
        texture = spec.add_texture(name=_BEAD, type=mujoco.mjtTexture.mjTEXTURE_2D, nchannel=3)
        texture.width = len(scale.table)
        texture.height = 2
        texture.data = np.stack([scale.table, scale.table]).tobytes()
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = _BEAD
        material.rgba = (_LIT, _LIT, _LIT, 1)
        material.emission = _GLOW
        material.specular = 0.0
    for name in names:
        _add_to_work(spec, name, _BEAD, group=0)
    if machine.needle is not None:
        _fit_needle(spec, run)
    # it moves with the camera, see `Renderer.frame`
    spec.worldbody.add_light(
        name=GLOSS,
        active=False,
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        castshadow=False,
        ambient=np.zeros(3),
        diffuse=np.zeros(3),
        specular=np.full(3, _GLOSS_SPECULAR),
    )
    level = float(machine.tip(np.zeros(len(machine.axes)))[2])
    piece = workpiece(run, sweep.bead_trace, level)
    if piece is not None:
        mesh = spec.add_mesh(name=_PIECE, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
        mesh.uservert = piece.vertices.ravel().astype(np.float32)
        mesh.userface = piece.faces.ravel()
        spec.add_material(name=_PIECE, rgba=_TURNED_COLOUR, specular=0.3, shininess=0.4)
        _add_to_work(spec, _PIECE, _PIECE, group=2)
    model = spec.compile()
    for name in names:
        geom = model.geom(name).id
        # the compiler moves the mesh to its inertial frame; the drawn vertices are in the work's
        model.geom_pos[geom] = 0
        model.geom_quat[geom] = (1, 0, 0, 0)
        model.geom_sameframe[geom] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE
    # views and light are scaled to the machine, or to a larger bead
    model.stat.center[:] = machine.model.stat.center
    model.stat.extent = max(float(machine.model.stat.extent), 2e-3 * float(np.ptp(run.nozzle, axis=0).max()))
    return model, names


def _fit_needle(spec: mujoco.MjSpec, run: Run) -> None:
    """Draw the needle in the size of the run's, with the parts in line with it moved along.

    A needle that leans keeps its length, as its tip has to lie on the axis of rotation.
    """
    needle = spec.geom(NEEDLE)
    tip = spec.site(NOZZLE).pos
    needle.size[0] = 0.5e-3 * run.face
    ends = needle.fromto.reshape(2, 3)
    if np.isnan(ends).any():
        return
    end = ends[np.linalg.norm(ends - tip, axis=1).argmax()]
    length = float(np.linalg.norm(end - tip))
    axis = (end - tip) / length
    if np.hypot(axis[0], axis[1]) * length > _ON_AXIS:
        return
    for geom in needle.parent.geoms:
        points = geom.fromto.reshape(2, 3) - tip
        along = points @ axis
        aside = np.linalg.norm(points - along[:, None] * axis, axis=1)
        above_needle = (aside < _ON_AXIS) & (along > 0.5 * length)
        moved = points + (1e-3 * run.needle_length - length) * axis * above_needle[:, None]
        if not np.isnan(moved).any():
            geom.fromto = (moved + tip).ravel()


def _add_to_work(spec: mujoco.MjSpec, name: str, material: str, group: int) -> None:
    """Add a mesh with a material to the work, without mass or contacts."""
    looks = {"type": mujoco.mjtGeom.mjGEOM_MESH, "meshname": name, "material": material, "group": group}
    spec.body(WORK).add_geom(name=name, mass=0, contype=0, conaffinity=0, **looks)


def _drop_at(sweep: Sweep, tick: int) -> tuple[Floats, float, float] | None:
    """Return the glue between the needle's tip and the bead at a tick, an ellipsoid, or None while none flows.

    It is centre in the work frame, (3,) [m], radius and half height [m]. The radius follows the free thread of glue,
    of the nominal section A, or the needle's face where that is larger:

        r = max(sqrt(A / pi), f / 2) sqrt(Q / Q0),

    with the flow Q and the largest flow of the run, Q0. It wets the needle and reaches down to the surface, or hangs
    freely where the nozzle is high above it.
    """
    bead_trace = sweep.bead_trace
    run = bead_trace.run
    flow = float(run.flow[tick])
    section = bead_trace.nominal if bead_trace.nominal > 0 else float(bead_trace.area.max())
    if flow <= 0 or section <= 0:
        return None
    radius = max(float(np.sqrt(section / np.pi)), 0.5 * run.face) * float(np.sqrt(flow / bead_trace.most_flow))
    tip = run.nozzle[tick]
    height = float(tip[2] - sweep.surface[tick])
    top = _WETTED * radius
    bottom = min(max(height, 0.0), _HANGS * radius)
    centre = tip + np.array([0.0, 0.0, 0.5 * (top - bottom)])
    return 1e-3 * centre, 1e-3 * radius, 0.5e-3 * (top + bottom)
