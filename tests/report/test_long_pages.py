"""Pages of long runs stay small: of a long program its ends are shown, of a path that covers itself an image."""

from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

from gantrysim.report.figures import inline_svg
from gantrysim.report.page import job_section


def test_of_a_long_program_the_page_shows_both_ends_and_says_so():
    program = "\n".join(f"G1 X{k}" for k in range(200_000))
    text = f'name = "long"\n\n[program]\ntext = """\n{program}\n"""\nspeed = 1'
    section = job_section(SimpleNamespace(toml=lambda: text))
    lines = section.code.split("\n")
    assert len(section.code) < 20_000
    assert lines[:6] == ['name = "long"', "", "[program]", 'text = """', "G1 X0", "G1 X1"]
    assert lines[-2:] == ['"""', "speed = 1"]
    missing = len(text.split("\n")) - (len(lines) - 1)
    assert f"{missing:,} lines between are left out. job.toml beside this page is whole" in section.text
    assert sum(f"{missing:,} lines" in line for line in lines) == 1
    short = 'name = "short"\n[program]\ntext = "G1 X1"'
    assert job_section(SimpleNamespace(toml=lambda: short)).code == short


@pytest.mark.soak
def test_a_path_that_covers_itself_becomes_an_image_and_a_smooth_one_stays_a_path():
    figure = Figure()
    axes = figure.subplots()
    axes.plot(*np.random.default_rng(1).random((2, 20_000)), label="path")
    covered = inline_svg(figure, "f1", "a path")
    assert len(covered) < 1_000_000
    assert "<image" in covered
    assert "path" in covered.partition("</title>")[2]  # the legend's and axes' texts stay
    figure = Figure()
    axes = figure.subplots()
    angle = np.linspace(0, 20 * np.pi, 20_000)
    axes.plot(angle * np.cos(angle), angle * np.sin(angle))
    smooth = inline_svg(figure, "f1", "a spiral")
    assert "<image" not in smooth
    assert len(smooth) < 100_000
