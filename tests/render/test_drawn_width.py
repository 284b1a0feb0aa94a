"""The bead as a film draws it: as wide as the record says, with its end card and its worst place."""

import numpy as np
import pytest

from gantrysim import Job
from gantrysim.glue.bead import Bead
from gantrysim.glue.bead.sweep import SIDES
from gantrysim.render import Film, Take
from gantrysim.render.film import STATES
from gantrysim.render.fonts import rgb
from gantrysim.render.scene import mesh_part
from gantrysim.results.colours import FAULT

from support.films import shows

SIZE = (480, 270)
PART = "G21 G90 G61\nF3000\nG0 X0 Y0\nM3\nG1 X40\nG3 X50 Y10 R10\nG1 Y30\nM5\nM2\n"
AWAY = 3.0  # from corners and ends, where the sections of a mesh are those of a bead [mm]


@pytest.fixture(scope="module")
def part(tmp_path_factory):
    file = tmp_path_factory.mktemp("part") / "part.ngc"
    file.write_text(PART)
    return Job.load(file)


@pytest.fixture(scope="module")
def film(part):
    run = part.run()
    with Film([Take(part.built_machine, run, part.name, part.bead)], size=SIZE) as opened:
        yield opened


def drawn_widths(film):
    """Place along the trace [mm] and width [mm] of the sections that the meshes of a film's last picture have."""
    (renderer,) = film._renderers
    scene = renderer.scene
    renderer.frame(len(scene.run.time) - 1)
    sections = [
        mesh_part(scene.model, scene.model.geom_dataid[geom], "vert").reshape(-1, SIDES + 1, 3)
        for geom in scene.bead_geoms
        if scene.model.geom_group[geom] == 0
    ]
    vertices = np.concatenate([sections[0], *(section[1:] for section in sections[1:])])
    width = 1e3 * np.linalg.norm(vertices[:, -1, :2] - vertices[:, 0, :2], axis=1)
    middle = 1e3 * vertices[:, SIDES // 2, :2]
    return middle, width


def test_the_bead_is_drawn_as_wide_as_the_record_says(part, film):
    (renderer,) = film._renderers
    bead = Bead(renderer.scene.run, part.bead)
    middle, width = drawn_widths(film)
    away = np.linalg.norm(middle[:, None] - bead.point[None, :, :2], axis=2)
    station = away.argmin(axis=1)
    # of the straight lines
    x, y = middle.T
    straight = ((y < 1) & (x > AWAY) & (x < 40 - AWAY)) | ((x > 49) & (y > 10 + AWAY) & (y < 30 - AWAY))
    assert straight.sum() > 10
    assert width[straight] == pytest.approx(bead.width[station[straight]], rel=0.01)
    assert np.median(width[straight]) == pytest.approx(float(bead.nominal_section.width[0]), rel=0.02)


def test_no_frame_is_empty_and_the_inset_shows_the_needle_and_the_bead(film):
    (cell,) = film.cells
    for time in (0.0, 0.5 * film.end, film.end):
        assert cell.of(film.frame(time, 1.0)).std() > 10
    (renderer,) = film._renderers
    place = renderer._inset.viewport
    picture = cell.of(film.frame(0.5 * film.end))[::-1]
    inset = picture[place.bottom : place.bottom + place.height, place.left : place.left + place.width]
    # the bead is pale on a dark table, and at least a sixth of the inset high
    assert (inset.min(axis=2) > 110).any(axis=1).sum() > place.height / 6


def test_a_film_ends_with_its_verdict(part, film):
    (verdict,) = film._verdicts
    card = film.end_card()
    assert card.shape == (SIZE[1], SIZE[0], 3)
    assert card.mean() < 0.5 * film.frame(film.end).mean()
    (colour,) = {row.state: STATES[row.state] for row in verdict.rows if row.state == verdict.state}.values()
    assert np.all(card == rgb(colour), axis=2).sum() > 100


def test_the_worst_place_is_marked_once_the_run_has_come_to_it(part):
    strict = part.changed({"tolerance.path_max": 0.001})
    run = strict.run()
    place = run.verdict.worst_place
    assert run.verdict.worst_row.name == "path"
    with Film([Take(strict.built_machine, run, "strict", strict.bead)], size=SIZE) as film:
        (cell,) = film.cells
        before, after = (cell.of(film.frame(time)).astype(int) for time in (place.time - 0.01, place.time + 0.01))
        card = cell.of(film.end_card()).astype(int)
        column, row = film._renderers[0].pixel_of(place.point)
    red = [np.abs(picture - rgb(FAULT)).max(axis=2) < 8 for picture in (before, after)]
    assert not red[0].any()
    rows, columns = np.nonzero(red[1])
    assert rows.size > 20
    assert np.hypot(rows - row, columns - column).min() < 12
    # nor does it shine through the card at the end, whose own red is bright
    faint = card[rows, columns]
    assert np.median(faint[:, 0] - faint[:, 1]) < 8
    check = run.verdict.worst_check
    text = f"{check.quantity} {check.value:.1f} {check.unit}"
    assert shows(after.astype(np.uint8), text, film.panel.font.size, FAULT)


def test_a_pass_through_glue_is_drawn_once_the_needle_has_made_it(tmp_path):
    """Two strokes that cross at (20, 0), the second one from below."""
    file = tmp_path / "cross.ngc"
    file.write_text("G21 G90 G61\nF3000\nG0 X0 Y0\nM3\nG1 X40\nM5\nG0 X20 Y-20\nM3\nG1 Y20\nM5\nM2\n")
    job = Job.load(file)
    run = job.run()
    ((begin, end),) = run.verdict["glue"].values["passes_through_glue_s"]
    with Film([Take(job.built_machine, run, job.name, job.bead)], size=SIZE) as film:
        (cell,) = film.cells
        before, after = (cell.of(film.frame(time)).astype(int) for time in (begin - 0.01, end + 0.001))
        ways = [film._renderers[0].pixel_of((20.0, y, float(run.nozzle[-1, 2]))) for y in (-0.5, 0.0, 0.5)]
    red = [np.abs(picture - rgb(FAULT)).max(axis=2) < 8 for picture in (before, after)]
    assert not red[0].any()
    assert red[1].any()
    for column, row in ways:
        assert red[1][round(row) - 2 : round(row) + 3, round(column) - 2 : round(column) + 3].any()
