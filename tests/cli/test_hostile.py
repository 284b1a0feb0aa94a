"""Input made to break its readers: one line that names the quantity, and in a time that its length bounds."""

import math
import os
import re

import pytest

from support.soaked import suite_runs

DIGITS = "1" * 5000
SQUARE = "x,y\n0,0\n10,0\n10,10\n"


def refused(gantrysim_command, *arguments):
    """Run a command that must refuse its input in one line; return that line."""
    status, output, errors = gantrysim_command(*arguments)
    assert (status, output, errors.count("\n")) == (2, "", 1), errors[-500:]
    assert errors.startswith("error: ")
    assert len(errors) < 1000
    return errors


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_study_refuses_what_its_job_refuses_in_one_line(gantrysim_command, folder):
    line = refused(gantrysim_command, "study", "circle", "--radius", "1e-9", "--out", "new")
    assert line == "error: radius = 1e-09 mm: must be at least 1e-06 mm\n"
    line = refused(gantrysim_command, "study", "circle", "--speed", "1e308", "--out", "new")
    assert "speed = 1e+308 mm/s: must be at most 1e+06 mm/s" in line
    line = refused(gantrysim_command, "study", "circle", "--radius", "1e-6", "--out", "new")
    assert "circle of radius 1e-06 mm at 100 mm/s: line 1" in line
    assert "must be greater than 0 mm" in line
    assert list(folder.iterdir()) == []


INTEGERS = {"of 5,000 digits": DIGITS, "of 5,000 hexadecimal digits": "0x" + "f" * 5000, "of 65 bits": str(1 << 64)}


@pytest.mark.parametrize("value", INTEGERS.values(), ids=INTEGERS.keys())
def test_an_integer_beyond_64_bits(gantrysim_command, folder, value):
    (folder / "big.toml").write_text(f"x = [{{a = {value}}}]\n")
    bound = "has an integer beyond 64 bits: must be -9223372036854775808 to 9223372036854775807"
    assert f"job big.toml: {bound}" in refused(gantrysim_command, "check", "big.toml")
    assert f"--set program.speed: {bound}" in refused(gantrysim_command, "check", "an225", "--set", f"speed={value}")


def test_labels_of_5000_digits(gantrysim_command, folder):
    (folder / "a.nc").write_text(f"G00 X1\nN{DIGITS}\nGOTO 5\n")
    assert "N11111111111111111111: must have 8 digits at most" in refused(
        gantrysim_command, "check", "a.nc", "--controller", "fanuc"
    )
    (folder / "a.ngc").write_text(f"F100\no{DIGITS} if [1]\nG1 X1\no{DIGITS} endif\nm2\n")
    assert "line 2: line of 5008 characters: must be at most 1000" in refused(gantrysim_command, "check", "a.ngc")
    (folder / "a.ngc").write_text(" " * 100_000 + "\nG1 X1 F100\nm2\n")
    assert "line 1: line of 100000 characters" in refused(gantrysim_command, "check", "a.ngc")


WORDS = {
    "linuxcnc": f"[JOINT_{DIGITS}]\nP = 1\n",
    "trio": f"P_GAIN AXIS({DIGITS}) = 1\nBASE({DIGITS})\nP_GAIN = 1\n",
    "fanuc": f"N01825Q1 A{DIGITS}P3000\n",
}


@pytest.mark.parametrize("name", WORDS)
def test_numbers_of_axes_of_5000_digits(gantrysim_command, folder, name):
    (folder / "gains.txt").write_text(WORDS[name])
    refused(gantrysim_command, "gains", "an225", "--from", name, "gains.txt")


READERS = {
    "a.toml": ("check", "a.toml"),
    "a.nc": ("check", "a.nc"),
    "a.svg": ("check", "a.svg"),
    "a.xml": ("check", "an225", "--machine", "a.xml"),
    "machine.toml": ("check", "an225", "--machine", "machine.toml"),
    "servo.toml": ("run", "an225", "--servo", "servo.toml"),
    "gains.txt": ("gains", "an225", "--from", "trio", "gains.txt"),
    "log.csv": ("identify", "log.csv", "--machine", "xy"),
    "law.py": ("run", "an225", "--set", "law=law.py:law", "--no-report"),
}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes")
@pytest.mark.parametrize("name", READERS)
def test_a_named_pipe_is_refused_and_not_waited_for(gantrysim_command, folder, name):
    os.mkfifo(folder / name)
    line = refused(gantrysim_command, *READERS[name])
    assert f"{name}" in line
    assert "is a named pipe: must be a regular file" in line


def test_a_record_that_is_a_named_pipe(folder):
    from gantrysim import InputError, Run

    os.mkfifo("run.npz")
    with pytest.raises(InputError, match="is a named pipe: must be a regular file"):
        Run.load("run.npz")


def zigzag(rows, step, height):
    return "x,y\n" + "".join(f"{step * k:.9g},{height * (k % 2):.9g}\n" for k in range(rows))


DRAWINGS = {
    "tiny tolerance": (zigzag(40, 1.0, 30.0), "corner_tolerance=1e-12"),
    "tiny tolerance of a spline": (zigzag(40, 1.0, 30.0), "corner_tolerance=1e-12", "curve=spline"),
    "tiny zigzag": (zigzag(60, 1e-5, 1e-5), "curve=spline"),
    "sharp zigzag": (zigzag(60, 1e-9, 10.0), "curve=spline"),
    "blends that use up their lines": (
        "x,y\n" + "".join(f"{0.01 * k:.3f},{10 * math.sin(0.001 * k):.6f}\n" for k in range(3000)),
    ),
}


@pytest.mark.parametrize(
    ("text", "settings"), suite_runs([(t, s) for t, *s in DRAWINGS.values()], 0, 3), ids=DRAWINGS.keys()
)
def test_a_route_has_a_leg_for_every_piece_of_its_chain(text, settings):
    from gantrysim.controllers.drawings import Drawing

    values = dict(setting.split("=") for setting in settings)
    if "corner_tolerance" in values:
        values["corner_tolerance"] = float(values["corner_tolerance"])
    drawing = Drawing(text=text, **values)
    assert len(drawing.route.legs) == len(drawing.route.chain.pieces)
    assert math.isfinite(drawing.duration)


def svg(content, attributes=""):
    head = '<svg xmlns="http://www.w3.org/2000/svg" width="100mm" height="100mm" viewBox="0 0 100 100"'
    return f"{head} {attributes}>{content}</svg>"


LINE = '<path d="M0 0 L10 0"/>'
LONG = {
    "blanks in a style": (svg(f"<style>a{' ' * 30_000}</style>{LINE}"), None),
    "a comment in a style": (svg(f"<style>{'/*' * 30_000}</style>{LINE}"), None),
    "braces in a style": (svg(f"<style>{'a{' * 30_000}</style>{LINE}"), None),
    "an attribute": (svg(f'<path style="{" " * 20_000}" d="M0 0 L1 0"/>'), "style of 20000 characters"),
    "an image": (svg(f'<image href="data:{"A" * 200_000}"/>{LINE}'), None),
    "digits": (svg(f'<polyline points="{"1" * 30_000}"/>'), "number of 30000 characters in points"),
    "commands": (svg(f'<path d="M0 0 {"L1 1 2 2 " * 250_000}"/>'), "1000002 numbers in paths and points"),
    "a width": (svg(LINE).replace('"100mm"', f'"{"1" * 9_000} x"', 1), None),
    "brackets in a head": (f"x{'[' * 100_000},y\n0,0\n1,1\n", None),
    "blanks in a head": (f"x{' ' * 50_000}a,y\n0,0\n1,1\n", "must have x and y"),
    "underscores in a head": (f"x{'_ ' * 50_000}a,y\n0,0\n1,1\n", "must have x and y"),
    "blanks in a cell": (f"0{' ' * 50_000}0,1\n1,1\n", "must have x and y"),
    "digits in a cell": (f"{'1' * 50_000}x,1\n1,1\n", "must have x and y"),
}


@pytest.mark.parametrize(("text", "message"), LONG.values(), ids=LONG.keys())
def test_a_drawing_with_a_long_text_is_read_or_refused_at_once(text, message):
    from gantrysim import InputError
    from gantrysim.controllers.drawings import Drawing

    if message is None:
        assert Drawing(text=text).route.legs
        return
    with pytest.raises(InputError, match=message):
        Drawing(text=text)


def test_a_style_sheet_still_hides_and_colours():
    from gantrysim.controllers.drawings import Drawing

    sheet = "<style>/* x{ */ .a { stroke : #ff0000 ; } .b{visibility:hidden}</style>"
    text = svg(sheet + '<path class="a" d="M0 0 L10 0"/><path class="b" d="M0 5 L10 5"/>')
    assert Drawing(text=text, layers=("#ff0000",)).route.chain.length == pytest.approx(10)


def test_heads_of_100000_brackets_or_blanks():
    from gantrysim.tables.units import name_and_unit

    for filler in ("[", "(", "]", " ", "[ ", " ]", "[]", "x["):
        for last in ("", "x", "]", ")"):
            name_and_unit(f"a{filler * 100_000}{last}")


HEADS = {
    "x position [mm]": ("x position", "mm"),
    " x_torque( N·m ) ": ("x_torque", "N·m"),
    "time": ("time", ""),
    "a [b] c": ("a [b] c", ""),
    "MPOS AXIS(0) [mm]": ("MPOS AXIS(0)", "mm"),
    "a [b [c]": ("a", "b [c"),
}


@pytest.mark.parametrize("head", HEADS)
def test_name_and_unit_of_a_head(head):
    from gantrysim.tables.units import name_and_unit

    assert name_and_unit(head) == HEADS[head]


def test_no_help_loses_a_unit_in_brackets():
    """The command's help is markup, in which [mm] without a backslash is a tag and vanishes."""
    from typer.main import get_command

    from gantrysim.cli.main import app

    commands = list(get_command(app).commands.values())
    commands += [command for group in commands for command in getattr(group, "commands", {}).values()]
    options = [(command.name, option) for command in commands for option in command.params]
    assert len(options) > 50
    for name, option in options:
        assert not re.findall(r"(?<!\\)\[[^\]]*\]", getattr(option, "help", None) or ""), (name, option.name)


@pytest.mark.parametrize("command", [("run",), ("study", "circle"), ("compare",), ("study", "laws")])
def test_the_help_of_a_command_shows_units(gantrysim_command, command):
    _, output, _ = gantrysim_command(*command, "--help")
    assert ("[kg]" if "laws" in command else "[mm]") in output


@pytest.mark.parametrize("size", [(100.0, 60.0), (100.0, 50.0), (50.0, 100.0), (100.0, 10.0)])
def test_the_title_of_a_plan_lies_on_its_sheet(size):
    from gantrysim import Machine
    from gantrysim.engine.simulate import perfect_follower
    from gantrysim.metrics.analysis import Analysis
    from gantrysim.paths.chain import Chain
    from gantrysim.paths.pieces import Line
    from gantrysim.record.setpoints import Setpoints
    from gantrysim.report.plots.plan import draw_plan, plan_extent
    from gantrysim.report.plots.style import sheet, view_height

    wide, high = size
    path = Chain([Line((0, 0, 0), (wide, 0, 0)), Line((wide, 0, 0), (wide, high, 0))])
    analysis = Analysis(perfect_follower(Machine("xy"), Setpoints.along(path, 100, 0.001)))
    with sheet(7.0, view_height(*plan_extent(analysis), 7.0)) as figure:
        axes = draw_plan(figure, analysis)
        figure.canvas.draw()
        top = axes.title.get_window_extent().y1
        assert top <= figure.bbox.height
