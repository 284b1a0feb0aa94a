"""Thin beads drawn wider: the share of the picture that glue covers, counted in pixels, and the room between turns."""

from types import SimpleNamespace

import numpy as np
import pytest

from gantrysim.glue.bead.trace import BeadTrace
from gantrysim.job.job import Job
from gantrysim.job.loading import builtin_jobs
from gantrysim.render import Film, Take
from gantrysim.render.film import clearance, picture_share
from gantrysim.render.fonts import MUTED

from support.films import glue_share, shows

SIZE = (480, 360)
LEAST = 0.08  # of the whole frame, panel and all, that glue covers at the end
THINNEST = ("delta-arc", "fanuc-conical", "softmc-helical")


def last_share(name, *, true_width=False):
    """Factor, share of the last frame of a film that glue covers, and the estimated one of a bead of true width."""
    job = Job.load(name)
    run = job.run()
    bead = BeadTrace.of(run, job.bead)
    with Film([Take(job.built_machine, run, bead=bead)], size=SIZE, true_width=true_width) as film:
        frame = film.frame(film.end)
        (cell,) = film.cells
        (renderer,) = film._renderers
        of_frame = cell.width * cell.height / (SIZE[0] * SIZE[1])
        estimated = of_frame * picture_share(renderer.framing, bead, cell.width / cell.height)
        stated = shows(cell.of(frame), f"bead drawn {film.widening:g} × as wide", film.panel.font.size, MUTED)
        assert stated == (film.widening > 1)
        return film.widening, of_frame * glue_share(renderer), estimated


@pytest.mark.parametrize("name", THINNEST)
def test_a_thin_bead_covers_a_twelfth_of_the_frame(name):
    factor, share, estimated = last_share(name)
    assert 1 < factor <= 4
    assert share >= LEAST
    # part of the bead on a cone is out of sight
    assert share == pytest.approx(factor * estimated, rel=0.2)


def test_a_bead_keeps_its_width_on_request():
    factor, share, estimated = last_share("delta-arc", true_width=True)
    assert factor == 1
    assert share < 0.5 * LEAST
    assert share == pytest.approx(estimated, rel=0.1)


@pytest.mark.soak
@pytest.mark.parametrize("name", builtin_jobs())
def test_the_bead_of_every_built_in_job_covers_a_twelfth_of_the_frame(name):
    _, share, _ = last_share(name)
    # rings of the flanges would reach one another
    assert share >= (0.075 if name == "linuxcnc-flanges" else LEAST)


def line(*ends):
    """Trace of a bead 2 mm wide along straight lines [mm], each from a start to an end."""
    point = np.concatenate([np.linspace(start, end, 200) for start, end in ends])
    steps = np.linalg.norm(np.diff(point, axis=0), axis=1)
    place = np.concatenate([[0.0], np.cumsum(steps)])
    return SimpleNamespace(point=point, place=place, width=np.full(len(point), 2.0), ds=1.0)


def test_the_clearance_is_the_distance_of_neighbouring_lines_in_widths():
    there_and_back = line(([0, 0, 0], [100, 0, 0]), ([100, 7, 0], [0, 7, 0]))
    assert clearance(there_and_back) == pytest.approx(3.5, rel=0.02)
    higher = line(([0, 0, 0], [100, 0, 0]), ([100, 6, 8], [0, 6, 8]))
    assert clearance(higher) == pytest.approx(5.0, rel=0.02)
    corner = line(([0, 0, 0], [100, 0, 0]), ([100, 0, 0], [100, 100, 0]))
    assert clearance(corner) == np.inf
    # a fifth of the bead counts, the near stretches of both turns: 12 mm each of 100
    point = np.concatenate([np.linspace([0, 0, 0], [12, 0, 0], 13), np.linspace([100, 9, 0], [100, 90, 0], 76)])
    point = np.concatenate([point, np.linspace([12, 6, 0], [0, 6, 0], 13)])
    place = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(point, axis=0), axis=1))])
    partly = SimpleNamespace(point=point, place=place, width=np.full(len(point), 2.0), ds=1.0)
    assert clearance(partly) == pytest.approx(3.0)
    nothing = line(([0, 0, 0], [100, 0, 0]))
    nothing.width[:] = 0
    assert clearance(nothing) == np.inf
