"""Shapes of drawings against closed forms; the same shape in every format; units; rotation, scale and mirror."""

import io
import math
from itertools import pairwise

import ezdxf
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.special import ellipe

from gantrysim.base.errors import InputError
from gantrysim.controllers.drawings import Drawing
from gantrysim.controllers.placement import Placement
from gantrysim.paths.pieces import Coil

from support import drawings
from support.drawings import arc, circle, csv, dxf, farthest, line, polyline, sampled, svg
from support.soaked import examples

EXACT = 1e-9  # of lines and arcs [mm]
SAMPLING = 1e-6  # of the brute force [mm]


def path(text, **arguments):
    return Drawing(text, **arguments).requested


def written(document):
    stream = io.StringIO()
    document.write(stream)
    return stream.getvalue()


def flat(points):
    return np.pad(np.asarray(points, float), ((0, 0), (0, 1)))


@pytest.mark.parametrize(
    ("text", "clockwise"),
    [(dxf(circle((30.0, 20.0), 10.0)), False), (svg('<circle cx="30" cy="80" r="10"/>'), True)],
    ids=["dxf", "svg"],
)
def test_a_circle_is_one_arc(text, clockwise):
    found = path(text)
    assert found.length == pytest.approx(20 * math.pi, abs=1e-6)
    (piece,) = found.pieces
    assert isinstance(piece, Coil)
    assert (piece.angle < 0) == clockwise
    assert np.linalg.norm(sampled(found)[:, :2] - [30, 20], axis=1) == pytest.approx(10, abs=1e-6)
    assert found.position(0)[0] == pytest.approx([40, 20, 0], abs=1e-6)


def test_an_arc_runs_counter_clockwise_and_with_the_normal_down_clockwise_about_the_mirrored_centre():
    up = path(dxf(arc((5.0, 3.0), 2.0, 30.0, 120.0)))
    assert up.length == pytest.approx(math.pi, abs=EXACT)
    angle = np.radians(30 + 90 * np.linspace(0, 1, 7))
    expected = np.stack([5 + 2 * np.cos(angle), 3 + 2 * np.sin(angle)], axis=1)
    assert up.position(np.linspace(0, up.length, 7))[:, :2] == pytest.approx(expected, abs=EXACT)
    down = path(dxf(arc((5.0, 3.0), 2.0, 30.0, 120.0, (210, 0.0), (220, 0.0), (230, -1.0))))
    assert down.position(np.linspace(0, down.length, 7))[:, :2] == pytest.approx(expected * [-1, 1], abs=EXACT)


@given(st.floats(-3, 3).filter(lambda bulge: abs(bulge) > 1e-3), st.floats(-50, 50), st.floats(-50, 50))
@examples(40)
def test_a_bulge_is_the_tangent_of_a_quarter_of_the_angle(bulge, x, y):
    found = path(dxf(polyline([(1, 2, bulge), (x + 60, y, 0)])))
    chord = math.hypot(x + 59, y - 2)
    angle = 4 * math.atan(abs(bulge))
    assert found.length == pytest.approx(chord * angle / (2 * math.sin(angle / 2)), rel=1e-9)
    # to the right of the chord where the bulge is positive
    expected = flat(drawings.bulge_points((1, 2), (x + 60, y), bulge))
    assert found.position(np.linspace(0, found.length, len(expected))) == pytest.approx(expected, abs=1e-7)


@given(st.floats(1, 40), st.floats(0.05, 0.99), st.floats(0, 2 * math.pi), st.floats(1e-3, 0.5))
@examples(10)
def test_an_ellipse_has_its_perimeter_and_stays_within_the_tolerance(a, ratio, turned, tolerance):
    document = ezdxf.new("R2000")
    document.header["$INSUNITS"] = 4
    major = (a * math.cos(turned), a * math.sin(turned))
    document.modelspace().add_ellipse((3, 4), major_axis=(*major, 0), ratio=ratio)
    drawing = Drawing(written(document), chord_tolerance=tolerance)
    perimeter = 4 * a * ellipe(1 - ratio**2)
    # a deviation changes the length by at most itself times the curve's total turn
    assert drawing.route.chain.length == pytest.approx(perimeter, abs=2 * math.pi * tolerance)
    assert drawing.requested.length == pytest.approx(perimeter, abs=0.2 * math.pi * tolerance)
    t = np.linspace(0, 2 * math.pi, 20_001)
    u, v = np.array(major), ratio * np.array([-major[1], major[0]])
    curve = flat([3, 4] + np.cos(t)[:, None] * u + np.sin(t)[:, None] * v)
    for chain, bound in ((drawing.route.chain, tolerance), (drawing.requested, 0.1 * tolerance)):
        assert farthest(sampled(chain), curve) <= bound + 1e-6 * a
        assert farthest(curve, sampled(chain)) <= bound + 1e-4 * bound + 1e-5 * a
    assert not drawing.route.chain.corners.size


@given(
    st.lists(st.tuples(st.integers(-40, 40), st.integers(-40, 40)), min_size=3, max_size=8, unique=True), st.booleans()
)
@example([(0, 3), (0, 0), (12, 0), (-1, 0), (0, 33), (0, 2)], True)
@example([(0, 8), (0, 0), (-28, 0), (0, -3), (1, 0)], True)
@examples(6)
def test_a_spline_passes_through_the_points_and_is_the_cubic_one_along_the_chords(points, closed):
    points = [*points, points[0]] if closed else points
    drawing = Drawing(csv(points), curve="spline", chord_tolerance=0.02)
    found = drawing.requested
    places = flat(points)
    at = np.append(0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1)))
    spline = CubicSpline(at, places, bc_type="periodic" if closed and len(points) > 3 else "natural")
    t = np.linspace(0, at[-1], 100_001)
    curve = spline(t)
    speed = np.maximum(np.linalg.norm(spline(t, 1), axis=1), 1e-12)
    radius = 1 / np.maximum(np.abs(np.cross(spline(t, 1), spline(t, 2))[:, 2]) / speed**3, 1e-12).max()
    for chain, bound in ((drawing.route.chain, 0.02), (found, 0.002)):
        # where it turns round within the tolerance, as at a cusp, up to a fifth more was seen
        most = 1.2 * bound if radius < bound else bound + 1e-4
        points_of_chain = sampled(chain, 0.005)
        assert farthest(points_of_chain, curve) <= most
        assert farthest(curve, points_of_chain) <= most
    ends = found.position(np.append(0, found.ends))
    assert max(np.linalg.norm(ends - place, axis=1).min() for place in places) < EXACT


@pytest.mark.parametrize("weights", [None, [1, 2, 0.5, 3, 1, 1]])
def test_a_dxf_spline_follows_the_library_s_own_points(weights):
    document = ezdxf.new("R2000")
    document.header["$INSUNITS"] = 4
    control = [(0, 0), (10, 20), (25, -5), (40, 30), (50, 0), (60, 10)]
    spline = document.modelspace().add_open_spline([(*at, 0) for at in control])
    if weights:
        spline.weights = weights
    drawing = Drawing(written(document))
    tool = spline.construction_tool()
    curve = np.array([tuple(at) for at in tool.points(np.linspace(0, tool.max_t, 4001))])
    assert farthest(sampled(drawing.route.chain), curve) <= 0.01 + 1e-4
    assert farthest(curve, sampled(drawing.route.chain)) <= 0.01 + 1e-4
    assert not drawing.route.chain.corners.size


@pytest.mark.parametrize(
    ("commands", "control"),
    [
        ("M 10 10 C 20 90 60 -40 90 50", [(10, 10), (20, 90), (60, -40), (90, 50)]),
        ("M 10 10 Q 60 90 90 20", [(10, 10), (60, 90), (90, 20)]),
        ("M 10 10 C 10 10 60 90 90 20", [(10, 10), (10, 10), (60, 90), (90, 20)]),
        ("M 20 20 C 90 90 10 90 80 20", [(20, 20), (90, 90), (10, 90), (80, 20)]),
        ("M 20 20 C 90 80 10 80 80 20", [(20, 20), (90, 80), (10, 80), (80, 20)]),
        ("M 10 50 C 90 50 10 50 50 50", [(10, 50), (90, 50), (10, 50), (50, 50)]),
    ],
    ids=["cubic", "quadratic", "no first derivative", "loop", "near a cusp", "to and fro"],
)
def test_bezier_curves_are_those_of_de_casteljau(commands, control):
    chain = Drawing(svg(f'<path d="{commands}"/>'), corner_tolerance=0).route.chain
    t = np.linspace(0, 1, 20_001)[:, None]
    points = [np.array(at, float) + 0 * t for at in control]
    while len(points) > 1:
        points = [(1 - t) * a + t * b for a, b in pairwise(points)]
    curve = flat(points[0] * [1, -1] + [0, 100])
    assert farthest(sampled(chain), curve) <= 0.01 + 1e-4
    assert farthest(curve, sampled(chain)) <= 0.01 + 1e-4


def test_a_curve_in_space_is_within_the_tolerance_and_without_corners():
    points = [(0, 0, 0), (20, 5, 3), (35, 20, 10), (20, 40, 4)]
    drawing = Drawing(csv(points), curve="spline", corner_tolerance=0)
    places = np.array(points, float)
    at = np.append(0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1)))
    curve = CubicSpline(at, places, bc_type="natural")(np.linspace(0, at[-1], 20_001))
    assert farthest(sampled(drawing.route.chain), curve) <= 0.01 + 1e-4
    assert farthest(curve, sampled(drawing.route.chain)) <= 0.01 + 1e-4
    assert not drawing.route.chain.corners.size
    assert drawing.axes == ("x", "y", "z")


def test_every_shape_of_svg_has_its_length():
    shapes = {
        '<rect x="10" y="20" width="30" height="12"/>': 84,
        '<rect x="10" y="20" width="30" height="12" rx="4"/>': 84 - 8 * 4 + 2 * math.pi * 4,
        '<circle cx="50" cy="50" r="7"/>': 14 * math.pi,
        '<ellipse cx="50" cy="50" rx="20" ry="10"/>': 4 * 20 * ellipe(0.75),
        '<line x1="10" y1="10" x2="40" y2="50"/>': 50,
        '<polyline points="0,0 30,0 30,40 70,70"/>': 120,
        '<polygon points="0,0 30,0 30,40"/>': 120,
        '<path d="M 10 10 h 20 v 15 a 5 5 0 0 1 -5 5 z"/>': 35 + 2.5 * math.pi + 25,
        '<path d="M 0 0 A 25 25 0 0 1 50 0"/>': 25 * math.pi,
    }
    for shape, length in shapes.items():
        assert path(svg(shape)).length == pytest.approx(length, abs=0.01), shape


# a closed outline of two lines and two arcs: (x, y, bulge)
OUTLINE = [(20, 10, 0), (60, 10, 1), (60, 40, 0), (20, 40, 0.5)]


def outline(unit=1.0):
    return dxf(polyline([(unit * x, unit * y, bulge) for x, y, bulge in OUTLINE], closed=True))


def outline_svg():
    # a bulge of 1 is a half circle of radius 15, of 0.5 an arc of radius c (1 + b^2) / (4 b) = 18.75, y down
    d = "M 20 90 L 60 90 A 15 15 0 0 0 60 60 L 20 60 A 18.75 18.75 0 0 0 20 90"
    return svg(f'<path d="{d}"/>')


def test_the_same_outline_in_dxf_svg_and_csv_gives_the_same_setpoints():
    from_dxf, from_svg = (Drawing(text).setpoints(1e-3) for text in (outline(), outline_svg()))
    assert from_svg.position == pytest.approx(from_dxf.position, abs=1e-5)
    straight = [(20, 10), (60, 10), (75, 25), (20, 40), (20, 10)]
    drawn = [
        csv(straight),
        "\n".join("{:g}\t{:g}".format(*at).replace(".", ",") for at in straight),
        "X [mm]; Y [mm]\n# corners\n" + "\n".join("{:g};{:g}".format(*at) for at in straight),
        dxf(*(line(a, b) for a, b in pairwise(straight))),
        dxf(polyline([(*at, 0) for at in straight[:-1]], closed=True)),
        svg('<polygon points="20,90 60,90 75,75 20,60"/>'),
        svg('<g transform="translate(0,100) scale(1,-1)"><path d="M20 10H60L75 25L20 40Z"/></g>'),
    ]
    first, *others = (Drawing(text).setpoints(1e-3) for text in drawn)
    for other in others:
        assert other.position == pytest.approx(first.position, abs=1e-5)
        assert other.dispense.tolist() == first.dispense.tolist()


@given(st.floats(-180, 180), st.floats(0.2, 5), st.floats(-30, 30), st.floats(-30, 30), st.booleans(), st.booleans())
@examples(30)
def test_rotation_scale_and_mirror_of_the_drawing_move_the_path(angle, scale, x, y, mirrored, drawn_as_svg):
    plain = path(outline_svg() if drawn_as_svg else outline())
    turn = scale * np.exp(1j * math.radians(angle))
    placed = path(outline_svg() if drawn_as_svg else outline(), placement=Placement(x, y, angle, scale))
    s = np.linspace(0, plain.length, 301)
    expected = plain.position(s)[:, :2] @ [1, 1j] * turn + complex(x, y)
    assert placed.position(scale * s)[:, :2] @ [1, 1j] == pytest.approx(expected, abs=1e-7)
    if drawn_as_svg:
        return
    # the same by moving the vertices; a mirror changes the sign of the bulges
    moved = []
    for px, py, bulge in OUTLINE:
        z = (px - 1j * py if mirrored else px + 1j * py) * turn + complex(x, y)
        moved.append((z.real, z.imag, -bulge if mirrored else bulge))
    found = path(dxf(polyline(moved, closed=True)))
    source = plain.position(s)[:, :2] @ [1, -1j if mirrored else 1j]
    assert found.position(scale * s)[:, :2] @ [1, 1j] == pytest.approx(source * turn + complex(x, y), abs=1e-7)


@pytest.mark.parametrize(("code", "factor"), [(1, 25.4), (2, 304.8), (4, 1), (5, 10), (6, 1000), (13, 1e-3)])
def test_a_dxf_s_units(code, factor):
    assert path(dxf(line((0, 0), (2, 0)), insunits=code)).length == pytest.approx(2 * factor, rel=1e-12)
    assert path(dxf(line((0, 0), (2, 0)), insunits=code), unit="cm").length == pytest.approx(20, rel=1e-12)


def test_a_drawing_without_units_is_in_mm_and_says_so():
    for insunits in (0, None):
        drawing = Drawing(dxf(line((0, 0), (2, 0)), insunits=insunits))
        assert drawing.requested.length == 2
        assert any("$INSUNITS" in note for note in drawing.notes)
    # as many a program writes it: the entities alone
    plain = dxf(line((0, 0), (2, 0)))
    bare = Drawing("0\nSECTION\n" + plain[plain.index("2\nENTITIES") :])
    assert bare.requested.length == 2
    assert any("$INSUNITS" in note for note in bare.notes)
    with pytest.raises(InputError, match=r"\$INSUNITS = 99: must be one of 1, 2, 3"):
        Drawing(dxf(line((0, 0), (2, 0)), insunits=99))


@pytest.mark.parametrize(
    ("head", "unit", "length"),
    [
        ('width="50mm" height="50mm" viewBox="0 0 100 100"', "auto", 5),
        ('width="2in" height="2in" viewBox="0 0 100 100"', "auto", 5.08),
        ('width="100" height="100"', "auto", 10 * 25.4 / 96),
        ("", "auto", 10 * 25.4 / 96),
        ('viewBox="0 0 100 100"', "auto", 10 * 25.4 / 96),
        ('width="100%" height="100%" viewBox="0 0 100 100"', "auto", 10 * 25.4 / 96),
        ('width="50mm" height="50mm" viewBox="0 0 100 100"', "mm", 10),
        ("", "in", 254),
        ('width="72pt" height="72pt" viewBox="0 0 72 72"', "auto", 10 * 25.4 / 72),
    ],
)
def test_an_svg_s_units_and_origin(head, unit, length):
    text = f'<svg xmlns="http://www.w3.org/2000/svg" {head}><path d="M0 0h10"/></svg>'
    drawing = Drawing(text, unit=unit)
    assert drawing.requested.length == pytest.approx(length, rel=1e-9)
    assert any("25.4/96" in note for note in drawing.notes) == (abs(length - 10 * 25.4 / 96) < 1e-9)
    page = 10 * length if "0 0 100" in head or 'height="100"' in head else 72 * length / 10 if "pt" in head else 0
    assert drawing.requested.position(0)[0] == pytest.approx([0, page, 0], abs=1e-9)


def test_a_csv_s_units():
    assert path("0,0\n1,0", unit="in").length == 25.4


def block(name, *entities):
    head = drawings.group((0, "BLOCK"), (8, "0"), (2, name), (70, 0), (10, 0.0), (20, 0.0), (30, 0.0))
    return head + "".join(entities) + drawings.group((0, "ENDBLK"), (8, "0"))


def insert(name, x, y, layer="0", *more):
    return drawings.group((0, "INSERT"), (8, layer), (2, name), (10, float(x)), (20, float(y)), (30, 0.0), *more)


def test_blocks_are_placed_scaled_turned_and_nested():
    blocks = block("A", circle((1.0, 0.0), 1.0), line((0, 0), (4, 0), "OWN")) + block("B", insert("A", 5, 0))
    outer = insert("B", 10, 20, "GLUE", (41, 2.0), (42, 2.0), (50, 90.0))
    drawing = Drawing(dxf(outer, blocks=blocks), corner_tolerance=0)
    ring, straight = drawing.sheet.strokes
    # (1, 0) + (5, 0), doubled, turned, shifted
    assert ring.shapes[0].centre == pytest.approx([10, 32, 0], abs=EXACT)
    assert np.hypot(*ring.shapes[0].u[:2]) == pytest.approx(2)
    assert np.array(straight.shapes[0].ends) == pytest.approx(np.array([[10, 30, 0], [10, 38, 0]]), abs=EXACT)
    # entities on layer 0 are on the layer of the reference
    assert "glue" in ring.names
    assert "own" in straight.names
    uneven = Drawing(dxf(insert("A", 0, 0, "0", (41, 3.0), (42, 1.0)), blocks=blocks))
    assert uneven.requested.length > 4 * 3 * ellipe(1 - 1 / 9)


def test_an_array_of_blocks():
    array = insert("A", 0, 0, "0", (70, 3), (71, 2), (44, 10.0), (45, 20.0))
    drawing = Drawing(dxf(array, blocks=block("A", line((0, 0), (1, 0)))))
    starts = sorted(stroke.start[:2].tolist() for stroke in drawing.sheet.strokes)
    assert np.array(starts) == pytest.approx(np.array([[0, 0], [0, 20], [10, 0], [10, 20], [20, 0], [20, 20]]))


def test_a_block_in_itself_is_refused():
    text = dxf(insert("A", 0, 0), blocks=block("A", line((0, 0), (1, 0)), insert("A", 1, 1)))
    with pytest.raises(InputError, match="blocks nested more than 32 deep"):
        Drawing(text)


def test_every_rule_of_a_style_sheet_counts():
    text = svg(
        "<style>.a{stroke:#f00} /* .b{stroke:#123456} */ .b{stroke:#00f}\n.c { display : none }</style>"
        '<path class="a" d="M0 0h1"/><path class="b" d="M0 9h2"/><path class="c" d="M0 18h4"/>'
    )
    first, second = Drawing(text).sheet.strokes
    assert "#ff0000" in first.names
    assert "#0000ff" in second.names


def test_reused_and_hidden_elements_of_svg():
    ns = 'xmlns:xlink="http://www.w3.org/1999/xlink"'
    text = svg(
        '<defs><path id="p" d="M0 0h10"/></defs><symbol id="s"><path d="M0 0v5"/></symbol>'
        '<clipPath id="c"><rect width="9" height="9"/></clipPath><g style="display:none"><path d="M0 0h3"/></g>'
        '<path visibility="hidden" d="M0 0h2"/><use href="#p" x="3" y="4"/>'
        f'<use {ns} xlink:href="#p" transform="rotate(90)"/><use href="#s" x="50" y="50"/><text>no</text>'
    )
    drawing = Drawing(text)
    ends = [np.array(stroke.shapes[0].ends)[:, :2].tolist() for stroke in drawing.sheet.strokes]
    expected = [[[3, 96], [13, 96]], [[0, 100], [0, 90]], [[50, 50], [50, 45]]]
    assert np.array(ends) == pytest.approx(np.array(expected), abs=1e-6)
    assert any("1 <clipPath>, 1 <text>, 1 invisible" in note for note in drawing.notes)


@given(st.lists(st.floats(-2, 2), min_size=6, max_size=6), st.floats(1, 20), st.floats(1, 20), st.floats(-90, 90))
@examples(30)
def test_any_affine_transform_of_an_ellipse(matrix, rx, ry, turned):
    a, b, c, d, e, f = matrix
    if abs(a * d - b * c) < 0.05:
        return
    d_text = f"M {-rx} 0 A {rx} {ry} 0 1 1 {rx} 0"
    text = svg(f'<g transform="matrix({a} {b} {c} {d} {e} {f}) rotate({turned})"><path d="{d_text}"/></g>')
    chain = Drawing(text).requested
    t = np.linspace(math.pi, 2 * math.pi, 20_001)  # y down: over the top
    r = math.radians(turned)
    p = np.stack([rx * np.cos(t), ry * np.sin(t)])
    p = np.array([[math.cos(r), -math.sin(r)], [math.sin(r), math.cos(r)]]) @ p
    x, y = np.array([[a, c], [b, d]]) @ p + [[e], [f]]
    curve = np.stack([x, 100 - y, 0 * x], axis=1)
    assert farthest(sampled(chain), curve) <= 1e-3 + 1e-4
    assert farthest(curve, sampled(chain)) <= 1e-3 + 1e-4
    assert chain.position(0)[0] == pytest.approx(curve[0], abs=SAMPLING)


@pytest.mark.parametrize("stray", [0.0, 1e-7, 1e-6])
@pytest.mark.parametrize("finish", ["40 20", "60.{} 40.{}"], ids=["one handle", "both handles"])
def test_a_handle_that_lies_on_its_end_but_for_rounding_gives_no_direction(stray, finish):
    """A Bézier curve whose handle is at its end sets out for the other handle, wherever rounding moves the first."""
    away = f"{10 - stray:.7f} {10 - stray:.7f}"
    digits = f"{stray:.7f}"[2:]
    found = Drawing(svg(f'<path d="M 10 10 C {away} {finish.format(digits, digits)} 60 40"/>'), corner_tolerance=0)
    chain = found.route.chain
    clean = Drawing(svg(f'<path d="M 10 10 C 10 10 {finish.format("0", "0")} 60 40"/>'), corner_tolerance=0).route.chain
    assert len(chain.pieces) == len(clean.pieces)
    assert not chain.corners.size
    target = complex(30, -10) if finish == "40 20" else complex(50, -30)  # y of SVG is downwards
    assert chain.heading(np.array([1e-3]))[0] == pytest.approx(np.angle(target), abs=2e-3)


TRANSFORMS = (
    "transalte(10, 0)",
    "translate(10, 0",
    "translate(10) foo(3)",
    "rotate(30 5)",
    "matrix(1 0 0 1 5)",
    "rotate(abc)",
)


@pytest.mark.parametrize("misspelt", TRANSFORMS)
def test_a_misspelt_transform_is_left_out_whole_and_named(misspelt):
    drawing = Drawing(svg(f'<path id="seal" transform="{misspelt}" d="M1 1 L9 1"/><path d="M9 1 L9 9"/>'))
    assert drawing.requested.length == pytest.approx(16, abs=EXACT)
    (note,) = (note for note in drawing.notes if "transform" in note)
    assert f"<path> seal: {misspelt}" in note


@pytest.mark.parametrize(
    "right", ["translate(10-5)", " rotate(.5turn)scale(1) ", "skewX(0),scale(1 1)", "none", "translate(1px,2mm)"]
)
def test_a_transform_in_any_writing_of_its_own_is_read(right):
    assert not any("transform" in note for note in Drawing(svg(f'<path transform="{right}" d="M1 1 L9 1"/>')).notes)
