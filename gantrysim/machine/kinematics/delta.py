"""A delta robot: three arms at rest, and rods of fixed length that carry a platform which never tilts.

Arm k turns by the angle a about a hinge at s_k; its elbow is at s_k + R(a) e_k. A rod of the length L_k joins it to the
platform at p_k + u, with p_k the joint at home and u the platform's displacement. As the platform does not turn, the
rods of a parallelogram are parallel, and one of them stands for both:

    |p_k + u - s_k - R(a) e_k| = L_k,    k = 1, 2, 3

Forward, u is the lower intersection of three spheres about s_k + R(a) e_k - p_k. Inverse, with d = p_k + u - s_k, e
divided into e' along the hinge's unit vector n and e" across it, and R(a) e = e' + cos(a) e" + sin(a) n x e,

    A cos(a) + B sin(a) = C,    A = d.e",    B = d.(n x e),    C = (|d|^2 + |e|^2 - L^2) / 2 - d.e'

has the solutions a = atan2(B, A) +- acos(C / sqrt(A^2 + B^2)), of which each arm keeps the branch that it has at home.
(Clavel's robot; the equations of two links in a plane and of trilateration.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.machine.kinematics.base import DEG, MM, Coordinate, Kinematics, UnreachableError

LEAST_ANGLE = 5.0  # between arm and rod in the arm's plane, and a straight line [deg]
LEAST_VOLUME = 0.1  # det of the rods' unit vectors, 1 where they are at right angles to each other

_ARMS = 3
_SAME_DIRECTION = 1e-6  # of directions
_AXES = "xyz"


@dataclass(frozen=True, eq=False, kw_only=True)
class Delta(Kinematics):
    """Kinematics of a delta robot; coordinates x, y and z of the nozzle in the work frame, then the other axes.

    The MJCF has a platform on three slides, along any directions, which are the followers; their ranges limit x, y and
    z. Three tendon equalities hold the lengths of rods between a site on an arm and one on the platform.

    Attributes:
        coordinates, followers: as of `Kinematics`.
        arms: column of each arm's axis, (3,).
        names_of_arms: names of these axes.
        others: columns of the other axes.
        shoulder, hinge, elbow: s, n and e of each arm, (3, 3) [mm].
        joint: p of each rod at home, (3, 3) [mm].
        rod: lengths L, (3,) [mm].
        branch: sign of acos of each arm, (3,).
        side: sign of the forward solution.
        sense: sign of the determinant of the rods' vectors; beyond a position where it is zero, forward kinematics have
            the other solution.
        slides: direction of each slide, (3, 3).
        work: rotation from the world to the work frame, (3, 3).
        home: nozzle in the work frame with all axes at zero, (3,) [mm].
    """

    coordinates: tuple[Coordinate, ...]
    followers: tuple[int, ...]
    arms: tuple[int, ...]
    names_of_arms: tuple[str, ...]
    others: tuple[int, ...]
    shoulder: Floats
    hinge: Floats
    elbow: Floats
    joint: Floats
    rod: Floats
    branch: Floats
    side: float
    sense: float
    slides: Floats
    work: Floats
    home: Floats

    @classmethod
    def of(cls, model: mujoco.MjModel, driven: Sequence[int], nozzle: int, work: int) -> Delta:
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        rods = [_rod(model, tendon, driven) for tendon in _held_tendons(model)]
        platforms = {int(model.site_bodyid[site]) for _, _, site in rods}
        if len(rods) != _ARMS or len({arm for arm, _, _ in rods}) != _ARMS or len(platforms) != 1:
            raise InputError(
                f"kinematics 'delta': {len(rods)} rods (tendon equalities) hold {len(platforms)} bodies: must be "
                f"{_ARMS}, one from each of {_ARMS} axes to one platform"
            )
        rods.sort()
        arms = tuple(arm for arm, _, _ in rods)
        hinges = [driven[arm] for arm in arms]
        followers = _slides(model, platforms.pop(), driven)
        frame = data.xmat[work].reshape(3, 3).T
        home = MM * frame @ (data.site_xpos[nozzle] - data.xpos[work])
        slides = data.xaxis[list(followers)].copy()
        if np.abs(frame @ slides.T - np.eye(3)).max() > _SAME_DIRECTION:
            raise InputError("kinematics 'delta': the slides of its platform must be along x, y and z of the work")
        shoulder = MM * data.xanchor[hinges]
        elbow_at = MM * data.site_xpos[[elbow for _, elbow, _ in rods]]
        joint = MM * data.site_xpos[[site for _, _, site in rods]]
        elbow = elbow_at - shoulder
        hinge = data.xaxis[hinges].copy()
        others = tuple(a for a in range(len(driven)) if a not in arms)
        of_platform = [Coordinate.of(model, slide, _AXES[k], home[k]) for k, slide in enumerate(followers)]
        of_others = [Coordinate.of(model, driven[a]) for a in others]
        kinematics = cls(
            coordinates=(*of_platform, *of_others),
            followers=followers,
            arms=arms,
            names_of_arms=tuple(mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, joint) or "" for joint in hinges),
            others=others,
            shoulder=shoulder,
            hinge=hinge,
            elbow=elbow,
            joint=joint,
            rod=np.linalg.norm(joint - elbow_at, axis=1),
            branch=np.ones(_ARMS),
            side=1.0,
            sense=float(np.sign(np.linalg.det(joint - elbow_at))),
            slides=slides,
            work=frame,
            home=home,
        )
        return kinematics._at_home()

    def _at_home(self) -> Delta:
        """Return the kinematics with the branches that have all axes at zero at home."""
        angle, _ = self._plane(np.zeros((1, 3)))
        centres = self._centres(np.zeros((1, _ARMS)))
        normal = np.cross(centres[:, 1] - centres[:, 0], centres[:, 2] - centres[:, 0])[0]
        return replace(self, branch=-np.sign(angle[0]), side=float(-np.sign(normal @ centres[0, 0])))

    def forward(self, axes: Floats) -> Floats:
        u = self._platform(axes[:, self.arms] / DEG)
        return np.concatenate([u @ self.work.T + self.home, axes[:, self.others]], axis=1)

    def follow(self, axes: Floats) -> Floats:
        return self._platform(axes[:, self.arms] / DEG) @ self.slides.T / MM

    def inverse(self, position: Floats) -> Floats:
        self.check_travel(position)
        u = (position[:, :3] - self.home) @ self.work
        angle, cosine = self._plane(u)
        axes = np.empty((len(position), _ARMS + len(self.others)))
        self._check_reach(position, u, cosine)
        axes[:, self.arms] = DEG * (angle + self.branch * np.arccos(cosine))
        axes[:, self.others] = position[:, 3:]
        self._check_singular(position, u, axes[:, self.arms] / DEG)
        return axes

    def _plane(self, u: Floats) -> tuple[Floats, Floats]:
        """Return atan2(B, A) and C / sqrt(A^2 + B^2) of each arm, (n, 3)."""
        d = self.joint + u[:, None] - self.shoulder
        along = _dot(self.elbow, self.hinge)[:, None] * self.hinge
        across = np.cross(self.hinge, self.elbow)
        A = _dot(d, self.elbow - along)  # noqa: N806
        B = _dot(d, across)  # noqa: N806
        C = 0.5 * (_dot(d, d) + _dot(self.elbow, self.elbow) - self.rod**2) - _dot(d, along)  # noqa: N806
        return np.arctan2(B, A), C / np.hypot(A, B)

    def _centres(self, angle: Floats) -> Floats:
        """Return the centres of the spheres, (n, 3 arms, 3)."""
        a = angle[:, :, None]
        along = _dot(self.elbow, self.hinge)[:, None] * self.hinge
        turned = along + np.cos(a) * (self.elbow - along) + np.sin(a) * np.cross(self.hinge, self.elbow)
        return self.shoulder + turned - self.joint

    def _platform(self, angle: Floats) -> Floats:
        """Return u at angles of the arms [rad], (n, 3); where the spheres do not meet, the nearest of their plane."""
        centres = self._centres(angle)
        first, second, third = (centres[:, k] for k in range(_ARMS))
        # trilateration in the frame of the first centre: i towards the second, j in their plane, k across it
        to_second = second - first
        to_third = third - first
        length = np.sqrt(_dot(to_second, to_second))
        i = to_second / length[:, None]
        reach = _dot(i, to_third)
        j = to_third - reach[:, None] * i
        height = np.sqrt(_dot(j, j))
        j /= height[:, None]
        x = (self.rod[0] ** 2 - self.rod[1] ** 2 + length**2) / (2 * length)
        y = (self.rod[0] ** 2 - self.rod[2] ** 2 + reach**2 + height**2 - 2 * reach * x) / (2 * height)
        z = self.side * np.sqrt(np.maximum(self.rod[0] ** 2 - x**2 - y**2, 0.0))
        return first + x[:, None] * i + y[:, None] * j + z[:, None] * np.cross(i, j)

    def _check_reach(self, position: Floats, u: Floats, cosine: Floats) -> None:
        out = np.abs(cosine) > 1
        if out.any():
            row = int(out.any(axis=1).argmax())
            k = int(out[row].argmax())
            place = f"{self.position_text(position[row])}: out of reach of {self.names_of_arms[k]}"
            rod = self.rod[k]
            beside = abs(float(self.hinge[k] @ (self.joint[k] + u[row] - self.shoulder[k] - self.elbow[k])))
            if beside > rod:
                raise UnreachableError(
                    f"{place}, {beside:.4g} mm beside the plane in which it turns, must be at most {rod:.4g} mm", row
                )
            distance, low, high = self._span(u[row], k)
            raise UnreachableError(
                f"{place}, {distance:.4g} mm from its shoulder, must be {low:.4g} to {high:.4g} mm", row
            )

    def _span(self, u: Floats, k: int) -> tuple[float, float, float]:
        """Return the distance from shoulder to platform in an arm's plane, and its bounds [mm]."""
        n = self.hinge[k]
        d = self.joint[k] + u - self.shoulder[k]
        e = self.elbow[k]
        arm = float(np.linalg.norm(np.cross(n, e)))
        rod = float(np.sqrt(max(self.rod[k] ** 2 - (n @ (d - e)) ** 2, 0.0)))
        return float(np.linalg.norm(np.cross(n, d))), abs(arm - rod), arm + rod

    def _check_singular(self, position: Floats, u: Floats, angle: Floats) -> None:
        """Raise UnreachableError near a position at which arms or platform lose a direction of motion.

        With arm and rod in a line the arm would have to move infinitely fast; with the rods parallel or in one plane
        the platform could move although the arms stand.
        """
        centres = self._centres(angle)
        # from elbow to platform, (n, 3, 3)
        rods = u[:, None] - centres
        unit = rods / self.rod[:, None]
        elbow = centres + self.joint - self.shoulder
        # both projected to the plane in which the arm turns
        rod_in_plane = rods - _dot(rods, self.hinge)[..., None] * self.hinge
        arm_in_plane = elbow - _dot(elbow, self.hinge)[..., None] * self.hinge
        squares = _dot(arm_in_plane, arm_in_plane) * _dot(rod_in_plane, rod_in_plane)
        sine = _dot(np.cross(arm_in_plane, rod_in_plane), self.hinge) / np.sqrt(squares)
        from_line = DEG * np.arcsin(np.minimum(np.abs(sine), 1.0))
        volume = self.sense * np.linalg.det(unit)
        near = (from_line < LEAST_ANGLE).any(axis=1) | (volume < LEAST_VOLUME)
        if near.any():
            row = int(near.argmax())
            k = int(from_line[row].argmin())
            text = f"{self.position_text(position[row])}: near a singularity, "
            angle_from_line = from_line[row, k]
            if angle_from_line < LEAST_ANGLE:
                text += (
                    f"{self.names_of_arms[k]} and its rod are {angle_from_line:.3g} deg from a line, "
                    f"at least {LEAST_ANGLE:g}"
                )
            else:
                text += (
                    f"the rods are almost parallel or in one plane, det = {volume[row]:.3g}, at least {LEAST_VOLUME:g}"
                )
            raise UnreachableError(text, row)


def _dot(a: Floats, b: Floats) -> Floats:
    """Return scalar products of vectors along the last axis."""
    return np.sum(a * b, axis=-1)


def _held_tendons(model: mujoco.MjModel) -> list[int]:
    """Return the tendons of constant length."""
    return [
        int(model.eq_obj1id[e])
        for e in range(model.neq)
        if model.eq_type[e] == mujoco.mjtEq.mjEQ_TENDON and model.eq_obj2id[e] < 0 and model.eq_active0[e]
    ]


def _rod(model: mujoco.MjModel, tendon: int, driven: Sequence[int]) -> tuple[int, int, int]:
    """Return the axis that moves one end of a rod, and the sites on the arm and on the platform."""
    first = int(model.tendon_adr[tendon])
    count = int(model.tendon_num[tendon])
    wraps = range(first, first + count)
    if count == 2 and all(model.wrap_type[w] == mujoco.mjtWrap.mjWRAP_SITE for w in wraps):
        ends = [int(model.wrap_objid[w]) for w in wraps]
        axes = [_axis_above(model, int(model.site_bodyid[site]), driven) for site in ends]
        for arm, elbow, platform in ((axes[0], ends[0], ends[1]), (axes[1], ends[1], ends[0])):
            if arm is not None and axes[ends.index(platform)] is None:
                return arm, elbow, platform
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TENDON, tendon) or tendon
    raise InputError(f"kinematics 'delta': tendon {name!r} must join a site on an arm and one on the platform")


def _axis_above(model: mujoco.MjModel, body: int, driven: Sequence[int]) -> int | None:
    """Return the axis of the only driven hinge that carries a body, None if there is none."""
    while body:
        first = int(model.body_jntadr[body])
        count = int(model.body_jntnum[body])
        for joint in range(first, first + count):
            if joint in driven:
                return list(driven).index(joint)
        body = int(model.body_parentid[body])
    return None


def _slides(model: mujoco.MjModel, platform: int, driven: Sequence[int]) -> tuple[int, ...]:
    first = int(model.body_jntadr[platform])
    count = int(model.body_jntnum[platform])
    joints = tuple(range(first, first + count))
    slides = [model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE and joint not in driven for joint in joints]
    if count != _ARMS or not all(slides):
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, platform) or platform
        raise InputError(f"kinematics 'delta': the platform {name!r} must have three slides that no motor drives")
    return joints
