"""Where points appear in a picture: a pinhole of the camera's field of view, worked out without OpenGL."""

import mujoco
import numpy as np


def to_pixels(renderer, points):
    """Columns and rows at which world points [m] appear, (n, 2): a pinhole of the camera's field of view."""
    width, height = renderer.size
    frame = renderer.data.cam_xmat[renderer.view.fixedcamid].reshape(3, 3)
    seen = (points - renderer.data.cam_xpos[renderer.view.fixedcamid]) @ frame
    focal = 0.5 * height / np.tan(0.5 * np.radians(renderer.model.cam_fovy[renderer.view.fixedcamid]))
    column = 0.5 * width + focal * seen[:, 0] / -seen[:, 2]
    row = 0.5 * height - focal * seen[:, 1] / -seen[:, 2]
    return np.stack([column, row], axis=1)


def in_sight(renderer, points):
    """Whether nothing but the work lies between the camera and each point [m]."""
    model, data = renderer.model, renderer.data
    eye = data.cam_xpos[renderer.view.fixedcamid].copy()
    bead = renderer.scene.bead_geoms
    visible = []
    for point in points:
        way = point - eye
        geom = np.full(1, -1, np.int32)
        shown = model.geom_group[bead].copy()
        model.geom_group[bead] = 5
        groups = np.array([1, 1, 1, 0, 0, 0], np.uint8)
        distance = mujoco.mj_ray(model, data, eye, way / np.linalg.norm(way), groups, 1, -1, geom, None)
        model.geom_group[bead] = shown
        visible.append(geom[0] < 0 or distance > np.linalg.norm(way) - 1e-3)
    return np.array(visible)


def on_work(machine, renderer, points):
    """World coordinates [m] of points of the work frame [mm]."""
    origin, frame = renderer.data.xpos[machine.work], renderer.data.xmat[machine.work].reshape(3, 3)
    return origin + 1e-3 * points @ frame.T
