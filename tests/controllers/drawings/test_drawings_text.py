"""What is refused, in one line; random changes of drawings raise no other error; formats and notes."""

import math
import random
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.controllers.drawings import Drawing
from gantrysim.job.programs import build

from support.drawings import arc, circle, csv, dxf, group, line, polyline, svg
from support.soaked import examples, number_of_examples

SQUARE = csv([(0, 0), (10, 0), (10, 10)])
BLOCKS = group((0, "BLOCK"), (8, "0"), (2, "A"), (70, 0), (10, 0.0), (20, 0.0), (30, 0.0)) + line((0, 0), (3, 0))
BLOCKS += group((0, "ENDBLK"), (8, "0"))
SEEDS = [
    dxf(
        line((0, 0), (10, 0), "BEAD"),
        arc((10.0, 5.0), 5.0, 270.0, 90.0),
        circle((3.0, 3.0), 2.0),
        polyline([(0, 0, 0.5), (10, 0, 0), (10, 10, -1)], closed=True),
        group((0, "INSERT"), (8, "0"), (2, "A"), (10, 1.0), (20, 2.0), (30, 0.0), (41, 2.0), (42, 1.0), (50, 30.0)),
        blocks=BLOCKS,
    ),
    svg(
        '<g id="a" transform="translate(3,4) rotate(20) scale(1,2)"><rect x="1" y="2" width="9" height="5" rx="1"/>'
        '<path d="M1 2C3 4 5 6 9 1Q3 3 8 8A4 2 20 1 0 9 9z m1 1 l3 3"/></g>'
        '<ellipse cx="9" cy="8" rx="7" ry="3"/><polyline points="0,0 5,5 7,1"/><use href="#a" x="5"/>'
    ),
    "x,y,z,glue,speed\n0,0,0,1,30\n10,0,0,1,20\n10,10,2,0,\n0,10,0,1,5\n\n5 , 5\n6,7\n",
    "0 0\n10 0\n20 5\n30 -5\n40 0\n",
]
PIECES = [
    "",
    "0",
    "-1",
    "1e9",
    "1e308",
    "nan",
    "inf",
    "\n",
    ",",
    ";",
    "<",
    ">",
    '"',
    "A",
    "\x00",
    "é",
    "  ",
    "999999999",
]


def attempt(text, **arguments):
    """Whether a drawing is read; any other error than InputError is the test's."""
    try:
        drawing = Drawing(text, unit="mm", **arguments)
        assert np.isfinite(drawing.requested.length)
        assert all("\n" not in note for note in drawing.notes)
        if drawing.duration < 20:
            assert np.isfinite(drawing.setpoints(0.01).position).all()
    except InputError as error:
        message = str(error)
    else:
        return True
    assert "\n" not in message, message[:200]
    assert len(message) < 500, message[:200]
    return False


def mutated(text, choose):
    for _ in range(choose.randint(1, 4)):
        at, end = sorted((choose.randrange(len(text) + 1), choose.randrange(len(text) + 1)))
        end = min(end, at + choose.choice([0, 1, 1, 5, 20]))
        text = text[:at] + choose.choice([*PIECES, text[end : end + 9]]) + text[end:]
    lines = text.splitlines(keepends=True)
    if choose.random() < 0.3 and len(lines) > 2:
        k = choose.randrange(len(lines))
        lines[k] = choose.choice([*PIECES, lines[choose.randrange(len(lines))].strip()]) + "\n"
    return "".join(lines)


@pytest.mark.parametrize("seed", range(len(SEEDS)))
@pytest.mark.filterwarnings("ignore")  # of the libraries that read drawings
def test_changed_drawings_are_read_or_refused_in_one_line(seed):
    choose = random.Random(seed)
    assert attempt(SEEDS[seed])
    count = number_of_examples(60)
    read = sum(attempt(mutated(SEEDS[seed], choose)) for _ in range(count))
    assert read < count


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(len(SEEDS)))
@pytest.mark.filterwarnings("ignore")
def test_many_changed_drawings_are_read_or_refused_in_one_line(seed, record_property):
    choose, read = random.Random(100 + seed), 0
    for _ in range(25_000):
        read += attempt(mutated(SEEDS[seed], choose), curve="spline" if seed > 1 and choose.random() < 0.3 else "lines")
    record_property("attack", "drawings in DXF, SVG and CSV: random changes")
    record_property("tries", 25_000)
    record_property("refused", 25_000 - read)


@given(st.text(max_size=200), st.sampled_from(["auto", "dxf", "svg", "csv"]))
@examples(60)
@pytest.mark.filterwarnings("ignore")
def test_any_text_is_read_or_refused_in_one_line(text, kind):
    attempt(text, format=kind)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no points"),
        ("0,0\n10,x\n", r"line 2: y = 'x': must be a finite number"),
        ("0,0\n10\n", r"line 2: has no y: must have x and y"),
        ("0,0\n10,nan\n", r"line 2: y = 'nan'"),
        ("0,0\n1,2,3,1,5,6\n", r"line 2: 6 values: must be at most 5, x, y, z, glue, speed"),
        ("0,0\n1,2,3,2\n", r"line 2: glue = '2': must be 1 or 0"),
        ("0,0\n1,2,3,1,0\n", r"line 2: speed = 0 mm/s: must be greater than 0 mm/s"),
        ("0,0\n1,2,3,1,1e200\n", r"line 2: speed = 1e\+200 mm/s: must be at most 1e\+06 mm/s"),
        ("x,y,kind\n0,0,dot\n1,1,spot\n", r"line 3: unknown kind 'spot': did you mean dot\? known: dot, arc"),
        ("x,y,kind\n0,0,start\n1,1,arc\n", r"line 3: point of an arc without a point after it"),
        ("x,y,time [h]\n0,0,1\n", r"column time is in 'h': must be in s"),
        ("x,z\n0,0\n", r"line 1: columns x, z: must have x and y"),
        ("x,y,kind\n1,2,dot\n0,0,dot\n", "nothing is traced; ignored: 2 dots; must have"),
        ("0,0\n2e6,0\n", r"line 2: coordinate of 2000000 mm: must be within ± 1e\+06 mm"),
        (svg('<path d="M0 0h2e6"/>'), r"svg: <path>: coordinate of 2000000 mm: must be finite and within ± 1e\+06 mm"),
        ("AutoCAD Binary DXF\r\n\x1a\x00", r"dxf: binary: must be saved as an ASCII DXF"),
        (
            dxf(group((0, "TEXT"), (8, "0"), (10, 0.0), (20, 0.0), (40, 1.0), (1, "a"))),
            "nothing is traced; ignored: 1 TEXT",
        ),
        (dxf(circle((0.0, 0.0), -1.0)), r"dxf: CIRCLE \w+: radius = -1: must be greater than 0"),
        ("0\nSECTION\n2\nENTITIES\n0\nLINE\n", "dxf: .*: must be a valid"),
        ("<svg>", "svg: .*must be well-formed XML"),
        ("<html/>", "svg: document <html>: must be <svg>"),
        ("<svg/>", "svg: must state its namespace"),
        (svg(), "nothing is traced"),
        (svg("<text>a</text>"), "nothing is traced; ignored: 1 <text>"),
        (svg("<g>" * 120 + "</g>" * 120), "nested, or reused, more than 100 deep"),
        (svg('<g id="a"><use href="#a"/><path d="M0 0h1"/></g>'), "nested, or reused, more than 100 deep"),
    ],
)
def test_refused_drawings(text, message):
    with pytest.raises(InputError, match=message) as error:
        Drawing(text, dot_time=0 if "2 dot" in message else None)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"format": "dwg"}, "unknown format 'dwg': known: auto, csv, dxf, svg"),
        ({"unit": "inch"}, "unknown unit 'inch'"),
        ({"curve": "arcs"}, "unknown curve 'arcs'"),
        ({"order": "random"}, "unknown order 'random'"),
        ({"speed": 0}, "speed = 0 mm/s: must be greater than 0 mm/s"),
        ({"travel_speed": 1e200}, r"travel_speed = 1e\+200 mm/s: must be at most 1e\+06 mm/s"),
        ({"travel_speed": -1}, "travel_speed = -1 mm/s"),
        ({"chord_tolerance": 0}, "chord_tolerance = 0 mm: must be greater than 0 mm"),
        ({"corner_tolerance": -1}, "corner_tolerance = -1 mm: must be at least 0 mm"),
        ({"corner_speed": float("nan")}, "corner_speed = nan mm/s: must be finite"),
        ({"velocity": (1, 2)}, "velocity of 2 values: must be three, of x, y and z"),
        ({"acceleration": (1, 0, 1)}, "acceleration of y = 0 mm/s²: must be greater than 0 mm/s²"),
        ({"lift": -1}, "lift = -1 mm"),
        ({"height": float("inf")}, "height = inf mm: must be finite"),
        ({"start": (1,)}, "start = .*: must be two numbers"),
        ({"layers": ("a",)}, "unknown layers: layer or colour 'a': there are none"),
    ],
)
def test_refused_arguments(arguments, message):
    with pytest.raises(InputError, match=message):
        Drawing(SQUARE, **arguments)
    if arguments == {"curve": "arcs"}:
        with pytest.raises(InputError, match='curve = "spline": must be for points of a csv, the drawing is svg'):
            Drawing(svg('<path d="M0 0h9"/>'), curve="spline")


def test_the_format_is_told_by_the_text():
    assert Drawing(SQUARE).kind == "csv"
    assert Drawing(SEEDS[0]).kind == "dxf"
    assert Drawing("\n999\na remark\n" + SEEDS[0]).kind == "dxf"
    assert Drawing(SEEDS[1]).kind == "svg"
    assert Drawing('<?xml version="1.0"?>\n<!-- a remark -->\n' + SEEDS[1]).kind == "svg"
    assert Drawing("\ufeff" + SQUARE).requested.length == 20


def test_many_blocks_in_blocks_are_refused_before_they_fill_the_memory():
    blocks = BLOCKS
    for k in range(1, 12):
        inner = "A" if k == 1 else f"B{k - 1}"
        blocks += group((0, "BLOCK"), (8, "0"), (2, f"B{k}"), (70, 0), (10, 0.0), (20, 0.0), (30, 0.0))
        insert = (0, "INSERT"), (8, "0"), (2, inner), (10, 0.0), (20, 0.0), (30, 0.0)
        blocks += group(*insert, (70, 300), (71, 300), (44, 1.0), (45, 1.0)) + group((0, "ENDBLK"), (8, "0"))
    text = dxf(group((0, "INSERT"), (8, "0"), (2, "B11"), (10, 0.0), (20, 0.0), (30, 0.0)), blocks=blocks)
    with pytest.raises(InputError, match="dxf: references to blocks repeat more than 10000 ent"):
        Drawing(text)


def test_hidden_layers_of_dxf_are_not_traced():
    tables = group((0, "TABLE"), (2, "LAYER"), (70, 2))
    tables += group((0, "LAYER"), (2, "OFF"), (70, 0), (62, -3), (6, "CONTINUOUS"))
    tables += group((0, "LAYER"), (2, "ICE"), (70, 1), (62, 3), (6, "CONTINUOUS"))
    tables += group((0, "LAYER"), (2, "ON"), (70, 0), (62, 5), (6, "CONTINUOUS")) + group((0, "ENDTAB"))
    drawn = [line((0, 0), (length, 0), layer) for layer, length in (("OFF", 1), ("ICE", 2), ("ON", 4))]
    drawing = Drawing(dxf(*drawn, tables=tables))
    assert drawing.requested.length == 4
    assert {"on", "blue", "aci:5", "#0000ff"} <= drawing.sheet.strokes[0].names
    assert any("ignored: 2 invisible" in note for note in drawing.notes)


def test_a_drawing_is_rebuilt_from_its_plain_arguments():
    drawing = Drawing(SQUARE, start=(1, 2), velocity=(100, 100, 50), glue=None)
    again = build("cad.Drawing", drawing.arguments())
    assert np.array_equal(again.setpoints(1e-3).position, drawing.setpoints(1e-3).position)
    assert build("cad.Drawing", {"text": SEEDS[0], "glue": {"bead": False}}).glue == {"bead": False}
    assert build("cad.Drawing", {"text": SEEDS[0], "glue": ["bead"]}).glue == ("bead",)
    assert Drawing.suffixes == (".dxf", ".svg", ".csv", ".pos")


def test_the_page_s_job_is_traced():
    page = (Path(__file__).parents[3] / "docs" / "drawings.md").read_text(encoding="utf-8")
    table = tomllib.loads(re.search(r"```toml\n(.*?)```", page, flags=re.DOTALL)[1])["program"]
    drawing = build(table.pop("controller"), table)
    assert drawing.axes == ("x", "y", "z")
    # two corners of 90 deg: an arc of radius d instead of two lines of length d = tolerance / tan(theta / 4)
    shorter = 2 * (2 - math.pi / 2) * 0.1 / math.tan(math.pi / 8)
    assert sum(leg.length for leg in drawing.route.legs if leg.glue) == pytest.approx(
        210 + math.hypot(40, 5) - shorter, abs=1e-4
    )
    assert drawing.route.corners.rounded == 2


def test_points_in_one_place_and_splines_without_room_are_refused():
    assert Drawing("0,0\n0,0\n1,0\n").requested.length == 1
    far = "\n".join(f"{7e5 * (-1) ** k},{k}" for k in range(30_000))
    with pytest.raises(InputError, match="has points that are too close for its length"):
        Drawing(f"{far}\n0,0\n0.000002,0\n", curve="spline")


def test_curves_without_extent_are_named_and_the_rest_is_traced():
    def curve(kind, handle, *pairs):
        marks = ((100, "AcDbEntity"), (8, "0"), (100, f"AcDb{kind.title()}"))
        return group((0, kind), (5, handle), *marks, *pairs)

    knots = [(40, float(k > 3)) for k in range(8)]
    control = [(10 + 10 * axis, 1.0) for _ in range(4) for axis in range(3)]
    curves = [
        arc((3.0, 3.0), 0.0, 0.0, 90.0, (5, "1A")),
        circle((1.0, 2.0), 0.0, "0", (5, "1B")),
        curve("ELLIPSE", "1C", (10, 1.0), (20, 1.0), (30, 0.0), (11, 0.0), (21, 0.0), (31, 0.0), (40, 0.5)),
        curve("SPLINE", "1D", (71, 3), (72, 8), (73, 4), *knots, *control),
    ]
    read = Drawing(dxf(line((0, 0), (10, 0)), *curves, line((10, 0), (10, 5))))
    assert read.sheet.remarks == ("not traced, as they have no extent: ARC 1A, CIRCLE 1B, ELLIPSE 1C, SPLINE 1D",)
    assert sum(math.dist(*shape.ends) for stroke in read.sheet.strokes for shape in stroke.shapes) == 15
    many = Drawing(dxf(line((0, 0), (10, 0)), *[circle((1.0, 2.0), 0.0)] * 9))
    assert many.sheet.remarks[0].endswith(" and 4 more")


def test_an_arc_of_svg_without_a_radius_is_a_straight_line():
    """SVG 1.1, F.6.2: rx = 0 or ry = 0 is a line to the end point."""
    for radii in ("0 0", "0 5", "5 0"):
        read = Drawing(svg(f'<path d="M1 1A{radii} 0 0 1 5 4"/>'))
        assert read.requested.length == pytest.approx(5)


def test_blocks_whose_heights_are_scaled_by_0_are_traced_flat():
    """Programs for plane drawings write references with a z scale of 0; one with an x scale of 0 has no extent."""
    raised = line((0.0, 0.0, 4.0), (10.0, 0.0, 7.0))
    place = ((10, 0.0), (20, 0.0), (30, 0.0))
    block = group((0, "BLOCK"), (8, "0"), (2, "B"), (70, 0), *place) + raised + circle((0.0, 0.0), 2.0)
    block += group((0, "ENDBLK"), (8, "0"))

    def reference(x, scales):
        given = zip((41, 42, 43), scales, strict=True)
        return group((0, "INSERT"), (8, "0"), (2, "B"), (10, x), (20, 5.0), (30, 1.0), *given)

    read = Drawing(dxf(reference(20.0, (2.0, 2.0, 0.0)), reference(90.0, (0.0, 1.0, 1.0)), blocks=block))
    straight, ring = (stroke.shapes for stroke in read.sheet.strokes)
    np.testing.assert_allclose(straight[0].ends, [(20, 5, 1), (40, 5, 1)], atol=1e-12)
    assert np.linalg.norm(ring[0].u) == pytest.approx(4)
    assert ring[0].circular
    assert [remark for remark in read.sheet.remarks if remark.startswith("not traced, as they have no extent: INSERT")]


def test_an_svg_reads_no_other_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "other.svg").write_text(svg('<path id="a" d="M0 0h50"/>'))
    links = '<use href="other.svg#a"/><image href="other.svg" width="5" height="5"/><path d="M0 0h10"/>'
    assert Drawing(svg(links)).requested.length == pytest.approx(10)
    entity = f'<!DOCTYPE svg [<!ENTITY a SYSTEM "{tmp_path}/other.svg">]>'
    with pytest.raises(InputError, match=r"svg: undefined entity &a;.*: must be well-formed XML"):
        Drawing(f"{entity}{svg('<title>&a;</title>')}", format="svg")


def test_what_references_repeat_is_bounded():
    """Small files: the time to read them must be too."""
    uses = "".join(f'<g id="b{k}">{f"<use href=&quot;#b{k - 1}&quot;/>" * 9}</g>' for k in range(1, 5))
    uses = uses.replace("&quot;", '"')
    message = r"svg: <use> repeats more than 10000 elements: must be fewer, or real copies"
    with pytest.raises(InputError, match=message):
        Drawing(svg(f'<g id="b0"><path d="M0 0h1"/></g>{uses}'))
    drawn = svg('<path d="M0 0h1"/>' * 10_100)
    assert len(Drawing(drawn).sheet.strokes) == 10_100


def test_a_drawing_that_lasts_too_long_is_refused_before_its_profile_is_planned():
    drawing = Drawing(svg('<path d="M0 0h900000' + "v1h-900000v1h900000" * 3 + '"/>'))
    with pytest.raises(InputError, match=r"^126000 s in periods of 0.001 s: makes 1.26e\+08 ticks, at most 5e\+07$"):
        drawing.setpoints(1e-3)
    assert "profile" not in vars(drawing)


def test_setpoints_of_a_long_drawing_are_those_of_its_profile():
    """In blocks: the position at every setpoint, and the glue of the leg that it lies on."""
    drawing = Drawing(dxf(line((0, 0), (60, 0)), line((80, 0), (80, 40))), speed=0.5, lift=2.0)
    setpoints = drawing.setpoints(1e-3)
    time = np.arange(len(setpoints.position)) * 1e-3
    assert time.size > 190_000
    s = drawing.profile.position(time)
    s[-1] = drawing.route.chain.length
    np.testing.assert_array_equal(setpoints.position, drawing.route.chain.position(s))
    legs = np.clip(np.searchsorted(drawing.route.chain.ends, s, side="right"), 0, len(drawing.route.legs) - 1)
    np.testing.assert_array_equal(setpoints.dispense, np.array([leg.glue for leg in drawing.route.legs])[legs])
    assert np.all(np.diff(setpoints.progress) >= 0)
    assert setpoints.progress[-1] == pytest.approx(drawing.requested.length)
