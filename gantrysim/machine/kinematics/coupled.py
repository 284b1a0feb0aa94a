"""Motors that share coordinates through belts or screws: CoreXY, H-bot, a gantry with two motors on one axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.machine.kinematics.base import Coordinate, Kinematics, per_si_of

_SINGULAR_VALUE = 1e-9  # smallest singular value of the coupling, relative to the largest


@dataclass(frozen=True, eq=False, kw_only=True)
class Coupled(Kinematics):
    """Fixed tendons couple driven joints d and followers f, which no motor drives.

        D d + F f = l,    so that    f = F^-1 (l - D d)

    with a row of coefficients per tendon, whose length l is its spring's at rest, or its equality constraint's.
    A follower that is a slide is a coordinate, and so is every axis that no tendon couples; a follower that is a hinge,
    such as the skew of a bridge, is zero in every program.

    Attributes:
        coordinates, followers: as of `Kinematics`.
        constant: f with all axes at zero, (followers,) [m or rad].
        gain: f per axis position, (followers, axes) [m or rad per mm or deg].
        coordinate_gain: coordinate per axis position, (coordinates, axes).
        origin: coordinates with all axes at zero, (coordinates,).
        axis_gain: axis position per coordinate, (axes, coordinates).
        level: axes that hold every follower that is a hinge at zero with the coordinates at `origin`, (axes,).
    """

    coordinates: tuple[Coordinate, ...]
    followers: tuple[int, ...]
    constant: Floats
    gain: Floats
    coordinate_gain: Floats
    origin: Floats
    axis_gain: Floats
    level: Floats

    @classmethod
    def of(cls, model: mujoco.MjModel, driven: Sequence[int], nozzle: int, work: int) -> Coupled:
        rows, lengths = _tendons(model)
        touched = np.flatnonzero(np.any(rows, axis=0)).tolist()
        followers = tuple(joint for joint in touched if joint not in driven)
        tied = [a for a, joint in enumerate(driven) if joint in touched]
        if not followers or len(rows) != len(followers) or len(tied) != len(rows):
            raise InputError(
                f"kinematics 'coupled': {len(rows)} fixed tendons with stiffness or an equality join {len(tied)} axes "
                f"and {len(followers)} other joints: must be as many of each"
            )
        F = rows[:, followers]  # noqa: N806
        D = np.zeros((len(rows), len(driven)))  # noqa: N806
        if _singular(F):
            raise InputError("kinematics 'coupled': its tendons do not determine the joints that follow the axes")
        for a in tied:
            D[:, a] = rows[:, driven[a]] / per_si_of(model, driven[a])
        constant = np.linalg.solve(F, lengths).astype(np.float64)
        gain = -np.linalg.solve(F, D).astype(np.float64)
        # rows: coordinate or hinge = gain . axes + value with all axes at zero
        coordinate_rows = []
        hinge_rows = []
        for f, joint in enumerate(followers):
            per_si = per_si_of(model, joint)
            if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
                coordinate_rows.append((Coordinate.of(model, joint), per_si * gain[f], per_si * constant[f]))
            else:
                hinge_rows.append((gain[f], constant[f]))
        untied = [a for a in range(len(driven)) if a not in tied]
        coordinate_rows += [(Coordinate.of(model, driven[a]), np.eye(len(driven))[a], 0.0) for a in untied]
        # x, y and z first, then the others by name
        coordinate_rows.sort(key=lambda row: ("xyz".find(row[0].name) % 4, row[0].name))
        coordinates, coordinate_gain, origin = zip(*coordinate_rows, strict=True)
        square = np.array([*coordinate_gain, *(row for row, _ in hinge_rows)])
        if _singular(square):
            raise InputError("kinematics 'coupled': its tendons do not determine the axes from the coordinates")
        inverse = np.linalg.inv(square)
        count = len(coordinates)
        level = -inverse[:, count:] @ np.array([value for _, value in hinge_rows])
        return cls(
            coordinates=coordinates,
            followers=followers,
            constant=constant,
            gain=gain,
            coordinate_gain=np.array(coordinate_gain),
            origin=np.array(origin),
            axis_gain=inverse[:, :count],
            level=level,
        )

    def forward(self, axes: Floats) -> Floats:
        return axes @ self.coordinate_gain.T + self.origin

    def inverse(self, position: Floats) -> Floats:
        self.check_travel(position)
        return (position - self.origin) @ self.axis_gain.T + self.level

    def follow(self, axes: Floats) -> Floats:
        return axes @ self.gain.T + self.constant


def _singular(matrix: Floats) -> bool:
    values = np.linalg.svd(matrix, compute_uv=False)
    return bool(values[-1] <= _SINGULAR_VALUE * values[0])


def _tendons(model: mujoco.MjModel) -> tuple[Floats, Floats]:
    """Return coefficients of all joints, (tendons, joints), and lengths, (tendons,), of the tendons that couple."""
    equal = {
        int(model.eq_obj1id[e]): float(model.eq_data[e, 0])
        for e in range(model.neq)
        if model.eq_type[e] == mujoco.mjtEq.mjEQ_TENDON and model.eq_obj2id[e] < 0 and model.eq_active0[e]
    }
    rows = []
    lengths = []
    for tendon in range(model.ntendon):
        first = int(model.tendon_adr[tendon])
        count = int(model.tendon_num[tendon])
        wraps = range(first, first + count)
        if any(model.wrap_type[w] != mujoco.mjtWrap.mjWRAP_JOINT for w in wraps):
            continue
        if tendon in equal:
            lengths.append(float(model.tendon_length0[tendon]) + equal[tendon])
        elif model.tendon_stiffness[tendon] > 0:
            lengths.append(float(model.tendon_lengthspring[tendon].mean()))
        else:
            continue
        row = np.zeros(model.njnt)
        # a tendon may name a joint twice
        for w in wraps:
            row[int(model.wrap_objid[w])] += float(model.wrap_prm[w])
        rows.append(row)
    return np.array(rows).reshape(-1, model.njnt), np.array(lengths)
