"""The mesh of a growing bead in a MuJoCo model, in pieces: a picture uploads those that its glue has changed."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.glue.bead.rings import SIDES, Mesh, faces

_RINGS = 64  # of a piece: of fewer, more geoms are drawn; of more, more rings are uploaded with every picture
_SHOWN = 0  # group of geoms that pictures show
_ABSENT = 5  # group of geoms that no picture shows
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

    def write(self, bead: Mesh, factor: float, coordinates: Singles) -> list[int]:
        """Show a bead, and return the meshes that have to be uploaded for it.

        Args:
            bead: its rings that are laid.
            factor: by which it is drawn wider than it is.
            coordinates: of the rings in the texture of colours, (rings,).
        """
        laid = len(bead.place)
        vertices = bead.widened(factor).reshape(laid, -1)
        rows = np.hstack([vertices, bead.normals.reshape(laid, -1), coordinates[:, None]])
        changed = np.any(rows != self._written[:laid], axis=1)
        self._written[:laid] = rows
        self._written[laid:] = np.nan
        uploads = []
        for number, piece in enumerate(self._pieces):
            is_laid = piece.start < laid - 1 or number == 0
            self._model.geom_group[self.geoms[number]] = _SHOWN if is_laid else _ABSENT
            has_end = self._laid != laid and laid < piece.stop
            if is_laid and (has_end or changed[piece].any()):
                self._write_piece(number, rows[piece])
                uploads.append(self.meshes[number])
        self._laid = laid
        return uploads

    def hide(self) -> None:
        """Show no bead until the next one is written."""
        self._model.geom_group[self.geoms] = _ABSENT

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
