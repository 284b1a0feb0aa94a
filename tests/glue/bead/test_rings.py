"""Rings of a bead's mesh, by hand."""

import math

import numpy as np
import pytest

from gantrysim.glue.bead.sweep import SIDES, faces, joined_meshes, rings

ANGLE = math.radians(60.0)


def ring(radius=2.0, flat=1.0, groove=0.0, heading=0.0, turned=0.0, point=(10.0, 20.0, 3.0), count=1):
    """Rings of one section about one point [mm]."""
    shape = tuple(np.full(count, value) for value in (radius, flat, groove))
    points = np.tile(point, (count, 1))
    return rings(points, np.full(count, heading), shape, np.full(count, turned), np.arange(count) * 1.0, ANGLE)


@pytest.mark.parametrize(("heading", "across"), [(0.0, (0, -1)), (math.pi / 2, (1, 0))])
def test_a_ring_is_two_segments_beside_a_flat(heading, across):
    """To the right of the trace and to its left, as high as the segments, and on the surface at the rims."""
    mesh = ring(heading=heading)
    vertices = 1e3 * mesh.vertices.astype(float) - [10.0, 20.0, 3.0]
    place = vertices[:, :2] @ across
    width = 2 * 2.0 * math.sin(ANGLE) + 1.0
    assert mesh.width.tolist() == pytest.approx([width])
    assert np.abs(vertices[:, :2] @ (across[1], -across[0])).max() == pytest.approx(0, abs=1e-4)
    assert np.sort(place)[[0, -1]] == pytest.approx([-width / 2, width / 2], rel=1e-4)
    height = 2.0 * (1 - math.cos(ANGLE))
    beside = np.maximum(np.abs(place) - 0.5, 0.0)
    assert vertices[:, 2] == pytest.approx(np.sqrt(4.0 - beside**2) - 2.0 * math.cos(ANGLE), abs=1e-4)
    assert vertices[:, 2].max() == pytest.approx(height, rel=1e-4)
    assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(np.ones(SIDES + 1), rel=1e-5)
    # normals of a circle point away from its centre
    centre = np.column_stack([np.sign(place) * 0.5, np.full(place.size, -2.0 * math.cos(ANGLE))])
    out = np.column_stack([place, vertices[:, 2]]) - centre
    seen = np.column_stack([mesh.normals[:, :2] @ across, mesh.normals[:, 2]])
    assert seen[np.abs(place) > 1e-6] == pytest.approx((out / 2.0)[np.abs(place) > 1e-6], abs=1e-3)


def test_the_floor_of_a_groove_lies_below_its_rims():
    vertices = 1e3 * ring(groove=0.3).vertices.astype(float) - [10.0, 20.0, 3.0]
    height = 2.0 * (1 - math.cos(ANGLE))
    on_the_flat = np.abs(vertices[:, 1]) < 0.5 + 1e-4
    assert sorted(set(np.round(vertices[on_the_flat, 2], 4))) == pytest.approx([height - 0.3, height], abs=1e-3)


def test_parts_padding_and_joins_keep_rings_whole():
    mesh = joined_meshes([ring(point=(k, 0.0, 0.0)) for k in range(4)])
    assert mesh.centre[:, 0].tolist() == pytest.approx([0, 1e-3, 2e-3, 3e-3])
    part = mesh.part(slice(1, 3))
    assert np.array_equal(part.vertices, mesh.vertices[SIDES + 1 : 3 * (SIDES + 1)])
    assert np.array_equal(part.normals, mesh.normals[SIDES + 1 : 3 * (SIDES + 1)])
    assert np.array_equal(part.centre, mesh.centre[1:3])
    longer = part.of_length(5)
    assert longer.vertices.shape == longer.normals.shape == (5 * (SIDES + 1), 3)
    assert (longer.place.size, longer.width.size, len(longer.centre)) == (5, 5, 5)
    assert np.array_equal(longer.vertices[: 2 * (SIDES + 1)], part.vertices)
    assert np.all(longer.vertices[2 * (SIDES + 1) :] == part.vertices[-1])
    assert np.all(longer.centre[2:] == part.centre[-1])


def test_faces_are_two_triangles_to_a_side():
    triangles = faces(3)
    assert triangles.shape == (2 * 2 * SIDES, 3)
    assert set(triangles.ravel()) == set(range(3 * (SIDES + 1)))
    # every triangle has corners on two rings that follow one another
    rows = triangles // (SIDES + 1)
    assert np.all(rows.max(axis=1) - rows.min(axis=1) == 1)
