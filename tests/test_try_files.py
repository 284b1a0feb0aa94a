"""The script that counts which program files run: kinds by path and text, outcomes and reasons."""

import subprocess
import sys
from importlib import util
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parent.parent / "scripts" / "try_files.py"

FILES = {
    "part.ngc": ("ordinary", "G21\nG0 X1\nG1 X9 F60\nM2\n"),
    "caller.ngc": ("ordinary", "o<a> sub\nG1 X#1\no<a> endsub\no<a> call [3]\n"),
    "print.gcode": ("ordinary", "M104 S200\nG1 X5 E1 F600\nG1 X9 A3 E2\n"),
    "curve.nc": ("NURBS", "G0 X0 Y0\nG5.2 X1 Y2 P1\nX3 Y0 P1\nG5.3\nM2\n"),
    "turned.nc": ("other axes", "G1 X5 F60\nX9 A45.\n"),
    "standing.nc": ("ordinary", "G1 X5 A0.00 F60\nX9\n"),
    "threads.ngc": ("lathe", "G0 X1 Z1\nG76 P1 Z-2 I-1 J1 K2 Q29\n"),
    "lathe/part.ngc": ("lathe", "G0 X1 Z1\nG1 X3 F9\n"),
    "remap/part.ngc": ("own words", "G0 X1\nG1 X3 F9\n"),
    "words.ngc": ("own words", "M428\nG0 X1\nG1 X3 F9\n"),
    "fanuc.nc": ("ordinary", "O1\nG68 X1 R9\nG01 X3 F9\nM98 P2\nM30\nO2\nX9\nM99\n"),
    "sub.ngc": ("subroutine", "(X1)\no<sub> sub\nG1 X#1\no<sub> endsub\n"),
    "bad/part.ngc": ("error test", "G1 X1\n"),
    "error-test.nc": ("error test", "G0 X1\n"),
    "terror.nc": ("ordinary", "G0 X1\n"),
    "letter.nc": ("not G-code", "Dear X1,\nthis is\na letter\n"),
    "stream.nc": ("not G-code", "G0 X1\u00b6G0 X1\u00b61\n"),
}


@pytest.fixture(scope="module")
def script():
    spec = util.spec_from_file_location("try_files", SCRIPT)
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", FILES)
def test_the_kind_follows_from_path_and_text(script, name, tmp_path):
    kind, text = FILES[name]
    file = tmp_path / name
    file.parent.mkdir(exist_ok=True)
    file.write_text(text)
    assert script.kind_of(file, tmp_path) == kind


def test_alike_reasons_are_one(script):
    file = Path("a.nc")
    texts = ("a.nc: line 3: radius = 1.5 mm: must be 'x'", "a.nc: line 40 of sub: radius = 2 mm: must be 'y'")
    assert {script.reason(text, file) for text in texts} == {"radius = # mm: must be '..'"}


@pytest.mark.soak
def test_the_tables_count_what_runs(tmp_path):
    (tmp_path / "good.ngc").write_text("G0 X1\nG1 X9 F60\nM2\n")
    (tmp_path / "slow.ngc").write_text("G1 X9\nM2\n")
    (tmp_path / "turned.ngc").write_text("G1 X9 A9 F9\nM2\n")
    arguments = [sys.executable, str(SCRIPT), str(tmp_path), "--processes", "1", "--list"]
    output = subprocess.run(arguments, capture_output=True, text=True, check=True).stdout
    assert "     1 of    2 run  ordinary" in output
    assert "     0 of    1 run  other axes" in output
    assert "     1  a motion at feed must have an F above #, in its block or before" in output
    assert "slow.ngc: line 1: a motion at feed" in output
