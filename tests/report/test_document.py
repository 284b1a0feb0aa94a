"""The page: text, tables, figures and video in one self-contained file."""

import base64
import io
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from PIL import Image
from svgelements import Path as SvgPath

from gantrysim import InputError
from gantrysim.report import Column, Section, Table, write_page
from gantrysim.report.document import LEAD, lead_of
from gantrysim.report.figures import description, inline_svg
from gantrysim.report.plots.style import INK, sheet, thinned_line

from support.pages import Page

EVIL = "<script>alert('&')</script>"
CUT = 0.0101 * 2**0.5  # of a point's distance from where it is [pt]
SIMPLIFIED = 0.25  # [pt]
DENSE_SIZE = 150_000  # of the figure of a line of noise [bytes]
POINT = 72  # to the inch


def plot(title="Error <of> x"):
    with sheet(5.0, 3.0) as figure:
        axes = figure.add_subplot()
        axes.plot([0, 1, 2], [0.5, -1, 2], "o-", label="first")
        axes.imshow(np.arange(6.0).reshape(2, 3), extent=(0, 1, 0, 1), aspect="auto")
        axes.set(title=title, xlabel="time [s]", ylabel="error [µm]")
        axes.legend()
    return figure


def test_a_page_of_every_kind_of_section_is_self_contained(tmp_path):
    sections = [
        Section("Text", ["One.", "Two."], figure=plot()),
        Section("Same figure twice", figure=[plot(), plot()]),
        Section("Table", table=Table(["", "rms [µm]"], [["x", 1.0]])),
        Section("Same name!"),
        Section("Same name?", facts=[("Speed", "98 mm/s", "")], code="a  =  1\n"),
    ]
    write_page(tmp_path / "page.html", "Title", "below it", sections)
    page = Page(tmp_path / "page.html")
    page.check()
    assert page.sections == ["text", "same-figure-twice", "table", "same-name", "same-name-5"]
    assert page.texts("h1") == ["Title"]
    assert [(link["href"], link["text"]) for link in page.all("a")] == [
        (f"#{name}", section.title) for name, section in zip(page.sections, sections, strict=True)
    ]
    described = "Error <of> x: error [µm] against time [s] (first)"
    titles = [one["text"] for one in page.all("title") if "svg" in one["inside"]]
    assert titles == [f"Text: {described}", *[f"Same figure twice: {described}"] * 2]
    assert page.all("code")[0]["text"].rstrip("\n") == "a  =  1"
    assert {one["tag"] for one in page.elements} >= {"image", "path", "text", "use"}
    assert "clipPath" in page.text
    assert [item.name for item in tmp_path.iterdir()] == ["page.html"]
    assert "http" not in page.text


def test_text_is_escaped_everywhere(tmp_path):
    table = Table([EVIL, Column(EVIL)], [[EVIL, 1.0]], EVIL, {EVIL: "#123456"})
    sections = [
        Section(EVIL, EVIL, facts=[(EVIL, EVIL, EVIL)], table=table, code=EVIL),
        Section("Figure", figure=plot(EVIL)),
        Section(EVIL),
    ]
    write_page(tmp_path / "page.html", EVIL, EVIL, sections, warning=EVIL)
    page = Page(tmp_path / "page.html")
    page.check()
    assert "<script" not in page.text
    for tag, count in (("h1", 1), ("h2", 3), ("p", 4), ("dt", 1), ("dd", 2), ("th", 2), ("td", 2), ("caption", 1)):
        assert len(page.all(tag)) == count
        assert EVIL in page.texts(tag)
    assert page.texts("code") == [EVIL]
    assert page.texts("a")[0] == EVIL
    assert page.texts("title") == [EVIL, f"Figure: {EVIL}: error [µm] against time [s] (first)"]
    assert page.all("p")[2]["role"] == "alert"


def test_the_same_content_gives_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        write_page(tmp_path / name, "Title", "", [Section("Figure", figure=plot())])
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_a_video_is_embedded_unchanged(tmp_path):
    video = bytes(range(256)) * 5
    file = tmp_path / "film.mp4"
    file.write_bytes(video)
    missing = Section("None", video=tmp_path / "none")
    write_page(tmp_path / "page.html", "Title", "", [Section("Video", video=file), missing])
    page = Page(tmp_path / "page.html")
    page.check()
    (element,) = page.all("video")
    kind, _, content = element["src"].partition(",")
    assert kind == "data:video/mp4;base64"
    assert base64.b64decode(content, validate=True) == video
    assert page.sections == ["video"]
    assert "controls" in element


def test_numbers_are_right_aligned_and_formatted(tmp_path):
    table = Table(
        ["name", "count", Column("rms [µm]", ".2f"), "spacing [mm]", "none"],
        [
            ["a", 3, -1.234, 10.07641, None],
            ["b", np.int64(-12), float("nan"), 1e-7, None],
            ["c", True, float("inf"), None, None],
            ["d", 0, -0.001, -0.0, None],
        ],
    )
    write_page(tmp_path / "page.html", "Title", "", [Section("Table", table=table)])
    page = Page(tmp_path / "page.html")
    assert page.rows()[1:] == [
        ["a", "3", "−1.23", "10.08", "–"],
        ["b", "−12", "–", "1e-07", "–"],
        ["c", "yes", "∞", "–", "–"],
        ["d", "0", "0", "0", "–"],
    ]
    assert [cell.get("class") for cell in page.all("td")[:5]] == ["short", "number", "number", "number", "short"]
    assert [cell.get("class") for cell in page.all("th")] == [None, "number", "number", "number", None]


def test_rows_are_marked_with_the_colours_of_their_first_cells(tmp_path):
    table = Table(["link", "share"], [["program", 0.9], ["sum", "program"]], colours={"program": "#e69f00"})
    write_page(tmp_path / "page.html", "Title", "", [Section("Table", table=table)])
    assert [mark["style"] for mark in Page(tmp_path / "page.html").all("span")] == ["background: #e69f00"]


def test_a_row_of_another_number_of_cells_is_refused():
    with pytest.raises(InputError, match=r"^table row \[1\]: has 1 cells, must have 2$"):
        Table(["a", "b"], [[1]])


def test_a_page_that_fails_leaves_the_earlier_one(tmp_path, monkeypatch):
    file = tmp_path / "page.html"
    file.write_text("earlier")
    write = type(file).write_text

    def half(self, text, *arguments, **keywords):
        write(self, text[: len(text) // 2], *arguments, **keywords)
        raise OSError("disk full")

    monkeypatch.setattr(type(file), "write_text", half)
    with pytest.raises(OSError, match="disk full"):
        write_page(file, "Title", "", [Section("Text", "One.")])
    assert [item.name for item in tmp_path.iterdir()] == ["page.html"]
    assert file.read_text() == "earlier"


def test_progress_is_reported_per_section(tmp_path):
    shares = []
    write_page(tmp_path / "page.html", "T", "", [Section("a"), Section("b")], progress=shares.append)
    assert shares == [0.5, 1.0]


def test_coordinates_are_cut_to_hundredths_of_a_point():
    figure = Figure(figsize=(4.0, 3.0))
    axes = figure.add_subplot()
    axes.add_patch(Circle((0.3, 0.6), 0.2, color="#ff0000"))  # curves, closed
    axes.fill([0, 0.2, 0.1, -0.3], [1, 2, -1.5, 0.25], color="#00ff00")
    axes.plot(*np.random.default_rng(1).normal(size=(2, 100)))  # a line, of too few points to be simplified
    file = io.BytesIO()
    with rc_context({"svg.fonttype": "none"}):
        figure.savefig(file, format="svg", transparent=True)
    texts = (file.getvalue().decode(), inline_svg(figure, "f", ""))
    paths = [re.findall(r'<path[^>]* d="([^"]*)"', text) for text in texts]
    for long, short in zip(*paths, strict=True):
        ends = [[complex(s.end) for s in SvgPath(d) if s.end is not None] for d in (long, short)]
        np.testing.assert_allclose(*ends, atol=CUT)
        assert [type(piece) for piece in SvgPath(long)] == [type(piece) for piece in SvgPath(short)]
        assert len(short) < 0.8 * len(long)
        assert not re.search(r"\.\d{3}", short)


def points(svg, colour):
    """The points of the line of a colour."""
    (d,) = re.findall(rf'<path d="([^"]*)"[^>]*stroke: {colour}', svg)
    return np.array([[segment.end.x, segment.end.y] for segment in SvgPath(d)])


def test_a_line_keeps_its_coordinates():
    x = np.linspace(0, 10, 200)
    figure = Figure(figsize=(5.0, 3.0))
    axes = figure.add_subplot()
    axes.plot(x, np.sin(x), color="#ff0000")
    svg = inline_svg(figure, "f", "sine")
    drawn = points(svg, "#ff0000")
    expected = axes.transData.transform(np.stack([x, np.sin(x)], axis=1)) * POINT / figure.dpi
    expected[:, 1] = 3.0 * POINT - expected[:, 1]
    np.testing.assert_allclose(drawn[[0, -1]], expected[[0, -1]], atol=CUT)
    off = np.abs(np.interp(expected[:, 0], drawn[:, 0], drawn[:, 1]) - expected[:, 1])
    assert off.max() < 2 * SIMPLIFIED  # measured upright, of a line that is at most as steep as 60 degrees
    assert drawn.shape[0] < x.size
    assert 'viewBox="0 0 360 216"' in svg
    assert not re.search(r'<svg[^>]* (width|height)="', svg)


def test_an_image_keeps_every_pixel():
    values = np.add.outer(np.sin(np.arange(300) / 20), np.cos(np.arange(400) / 30))
    values[:40] = np.nan  # transparent
    figure = Figure(figsize=(4.0, 3.0))
    figure.add_axes((0, 0, 1, 1)).imshow(values, interpolation="none", cmap="viridis")
    file = io.BytesIO()
    figure.savefig(file, format="svg", dpi=150, transparent=True)
    texts = (file.getvalue().decode(), inline_svg(figure, "f", ""))
    (before,), (after,) = (re.findall(r"data:image/png;base64,([^\"]+)", text) for text in texts)
    pixels = [Image.open(io.BytesIO(base64.b64decode(image))).convert("RGBA") for image in (before, after)]
    np.testing.assert_array_equal(*pixels)


def test_black_and_ink_become_the_colour_of_the_page_but_not_in_a_text():
    svg = inline_svg(plot('id="#000000"'), "f", "x")
    assert "currentColor" in svg
    for ink in (INK, "#000000"):
        assert ink not in svg.replace('>id="#000000"<', "")
    assert '>id="#000000"<' in svg
    assert "10px" in svg
    assert ">time [s]<" in svg  # text, not outlines


def test_a_users_matplotlibrc_does_not_change_a_page():
    plain = inline_svg(plot(), "f", "x")
    with rc_context({"svg.fonttype": "path", "savefig.bbox": "tight", "savefig.dpi": 30}):
        assert inline_svg(plot(), "f", "x") == plain


def test_a_line_of_noise_stays_small():
    noise = np.random.default_rng(1).normal(size=100_000)
    with sheet(10.0, 3.0) as figure:
        figure.add_subplot().plot(*thinned_line(np.arange(noise.size) * 1e-3, noise))
    assert len(inline_svg(figure, "f", "noise")) < DENSE_SIZE


@given(st.integers(4001, 12000), st.integers(0, 2**32 - 1), st.floats(0, 0.3))
def test_a_thinned_line_keeps_its_envelope_its_ends_and_its_gaps(count, seed, missing):
    random = np.random.default_rng(seed)
    x, y = np.cumsum(random.random(count)), random.normal(size=count)
    y[random.random(count) < missing] = np.nan
    thin_x, thin_y = thinned_line(x, y)
    at = np.searchsorted(x, thin_x)
    np.testing.assert_array_equal(x[at], thin_x)
    np.testing.assert_array_equal(y[at], thin_y)
    assert (np.diff(at) > 0).all()
    assert (at[0], at[-1]) == (0, count - 1)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(y)), at[np.isnan(thin_y)])
    size = -(-count // 1000)
    for low in range(0, count, size):
        own, kept = y[low : low + size], thin_y[(at >= low) & (at < low + size)]
        if not np.isnan(own).all():
            assert (np.nanmin(own), np.nanmax(own)) == (np.nanmin(kept), np.nanmax(kept))
    assert np.isfinite(thin_y).sum() <= 4 * 1000


def test_a_short_line_is_not_thinned():
    x = np.arange(4000.0)
    assert thinned_line(x, x)[0] is x


def test_a_figure_without_labels_is_described_by_its_section(tmp_path):
    write_page(tmp_path / "page.html", "Title", "", [Section("Nothing here", figure=Figure())])
    assert Page(tmp_path / "page.html").texts("title") == ["Title", "Nothing here"]


def test_a_figure_is_described_by_its_labels():
    assert description(plot("Error")) == "Error: error [µm] against time [s] (first)"
    assert description(Figure()) == ""


@pytest.mark.parametrize(
    ("text", "lead"),
    [
        ("It passes. It costs nothing.", "It passes."),
        ("a " * 12 + "b; " + "c " * 20 + "d.", "a " * 12 + "b."),
        ("a " * 8 + "b, (c; " + "d " * 30 + "e).", "a " * 8 + "b."),
        ("Set it: " + "a " * 10 + "b, " + "c " * 30 + "d.", "Set it: " + "a " * 10 + "b."),
        # 30 words are taken whole, and a clause of 8 words by itself
        ("a " * 10 + "b; " + "c " * 18 + "d. E.", "a " * 10 + "b; " + "c " * 18 + "d."),
        ("a " * 10 + "b; " + "c " * 19 + "d. E.", "a " * 10 + "b."),
        ("a " * 7 + "b; " + "c " * 10 + "d, " + "e " * 30 + "f.", "a " * 7 + "b."),
        ("a " * 6 + "b; " + "c " * 10 + "d, " + "e " * 30 + "f.", "a " * 6 + "b; " + "c " * 10 + "d."),
    ],
)
def test_a_page_begins_with_one_short_sentence(text, lead):
    assert lead_of(text) == lead
    assert len(lead.split()) <= LEAD
