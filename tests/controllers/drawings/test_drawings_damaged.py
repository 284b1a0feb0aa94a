"""Damaged drawings in DXF: what is repaired has the geometry that was drawn; everything else is refused."""

import io
import math

import ezdxf
import pytest

from gantrysim.base.errors import InputError
from gantrysim.controllers.drawings import Drawing

from support.drawings import circle, dxf, group, line
from support.soaked import suite_runs

LENGTH = 50 + 10 * math.pi + 50 + 20
CHANGES = {
    "a value or code that is no number": lambda lines, k: [*lines[:k], f"#{lines[k]}", *lines[k + 1 :]],
    "a decimal comma": lambda lines, k: [*lines[:k], "1,5", *lines[k + 1 :]],
    "an empty line": lambda lines, k: [*lines[:k], "", *lines[k + 1 :]],
    "a line left out": lambda lines, k: [*lines[:k], *lines[k + 1 :]],
    "a line twice": lambda lines, k: [*lines[: k + 1], *lines[k:]],
    "an early end": lambda lines, k: lines[:k],
}


@pytest.fixture(scope="module")
def lines():
    """The lines of a drawing of a line, a half circle and two more lines, as ezdxf writes it."""
    document = ezdxf.new("R2010", units=4)
    model = document.modelspace()
    model.add_line((0, 0), (50, 0))
    model.add_arc((50, 10), 10, -90, 90)
    model.add_lwpolyline([(50, 20), (0, 20), (0, 0)])
    stream = io.StringIO()
    document.write(stream)
    return stream.getvalue().splitlines()


def section(lines, name):
    begin = next(k for k in range(2, len(lines)) if lines[k] == name and lines[k - 2] == "SECTION")
    return begin, next(k for k in range(begin, len(lines)) if lines[k] == "ENDSEC")


def read(lines):
    return Drawing("\n".join(lines) + "\n", corner_tolerance=0)


def test_a_drawing_that_ends_after_its_entities_is_traced_with_a_remark(lines):
    _, end = section(lines, "ENTITIES")
    drawing = read(lines[: end + 40])
    assert drawing.requested.length == pytest.approx(LENGTH, abs=1e-9)
    (remark,) = drawing.sheet.remarks
    assert remark.startswith("damaged: DXFStructureError: missing ENDSEC tag; repaired: ")
    assert remark.endswith("; compare it with what was drawn")


def test_a_wrong_handle_is_repaired(lines):
    k = next(k for k in range(section(lines, "ENTITIES")[0], len(lines)) if lines[k].strip() == "5") + 1
    drawing = read([*lines[:k], "wrong", *lines[k + 1 :]])
    assert drawing.requested.length == pytest.approx(LENGTH, abs=1e-9)
    assert drawing.sheet.remarks[0].startswith("damaged: ")


@pytest.mark.parametrize("name", suite_runs(CHANGES, 0, 3))
def test_no_repair_changes_or_loses_an_entity(lines, name):
    begin, end = section(lines, "ENTITIES")
    undamaged = read(lines).sheet.strokes
    refused = 0
    for k in range(begin + 1, end):
        try:
            drawing = read(CHANGES[name](lines, k))
        except InputError:
            refused += 1
            continue
        if any(remark.startswith("damaged") for remark in drawing.sheet.remarks):
            shapes = [[shape.ends for shape in stroke.shapes] for stroke in drawing.sheet.strokes]
            assert str(shapes) == str([[shape.ends for shape in stroke.shapes] for stroke in undamaged])
    assert refused > 0.5 * (end - begin)


def test_coordinates_without_a_pair_are_refused_though_they_could_be_left_out():
    pairs = ((8, "0"), (10, 0.0), (30, 0.0), (11, 5.0), (21, 0.0), (31, 0.0))
    with pytest.raises(InputError, match=r"^dxf: Missing required y coordinate.*: must be a valid ASCII DXF$"):
        Drawing(dxf(group((0, "LINE"), *pairs), line((0, 0), (1, 0))))


@pytest.mark.parametrize(
    ("entity", "missing"),
    [
        (circle((1.0, 1.0), 2.0).rpartition("40\n")[0], "radius"),
        (group((0, "LINE"), (8, "0"), (10, 1.0), (20, 2.0)), "end"),
        (group((0, "ARC"), (8, "0"), (10, 1.0), (20, 2.0), (40, 3.0)), "start_angle, end_angle"),
    ],
)
def test_an_entity_without_a_dimension_is_refused_not_drawn_with_a_default(entity, missing):
    with pytest.raises(InputError, match=rf"^dxf: \w+ \w+: {missing} is missing: must be stated$"):
        Drawing(dxf(entity, line((0, 0), (1, 0))))
