"""Programs, drawings, traces and records of strangers make nothing else be opened, started or imported."""

import io
import json
import os
import sys
import zipfile
from pathlib import Path

import ezdxf
import numpy as np
import pytest

import gantrysim
from gantrysim import InputError, Run

from support.films import small_job

SECRET = "/etc/passwd"
MODELS = Path(gantrysim.__file__).parent / "models"
SVG = f"""<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" width="10mm" height="10mm">
<style>@import url("file://{SECRET}");</style><image xlink:href="{SECRET}" width="5" height="5"/>
<use xlink:href="{SECRET}#a"/><path d="M0 0L5 5"/></svg>"""
ENTITY = f'<!DOCTYPE svg [<!ENTITY e SYSTEM "file://{SECRET}">]>' + SVG.replace("L5 5", "L5 5&e;")
PROGRAMS = {
    "image.svg": SVG,
    "entity.svg": ENTITY,
    "sub.ngc": f"O<{SECRET}> CALL\nO<sub> CALL\nM98 Psub\nG1 X5 F300\nM2\n",
    "sub.gcode": f"M32 {SECRET}\nG1 X5 F300\n",
    "open.bas": f'OPEN #40 AS "{SECRET}" FOR INPUT(0)\nINCLUDE "{SECRET}"\nRUN "{SECRET}"\n',
    "load.prg": f'Program\nLoad "{SECRET}"\nOpen "{SECRET}" Mode "r" As #1\nEnd Program\n',
}
# a fresh process, as a hook cannot be taken away: it loads every file twice, for what Python itself opens once
SCRIPT = """
import json, sys
from gantrysim import InputError, Job
seen = []
files = sys.argv[1:]

def load():
    for file in files:
        seen.clear()
        try:
            Job.load(file).controller.setpoints(1e-3)
        except InputError:
            pass
        yield file, list(seen)

def hook(event, arguments):
    if event in ("open", "subprocess.Popen", "os.system", "os.exec", "socket.connect", "os.mkdir"):
        seen.append([event, str(arguments[0])])

for _ in load():
    pass
sys.addaudithook(hook)
print(json.dumps(dict(load())))
"""


def dxf():
    document = ezdxf.new()
    space = document.modelspace()
    space.add_line((0, 0), (10, 0))
    space.add_image(document.add_image_def(SECRET, (10, 10)), (0, 0), (1, 1))
    document.add_xref_def(SECRET, "other")
    space.add_blockref("other", (0, 0))
    text = io.StringIO()
    document.write(text)
    return text.getvalue()


def test_programs_and_drawings_open_no_other_file(fresh, tmp_path):
    for name, text in {**PROGRAMS, "xref.dxf": dxf()}.items():
        (tmp_path / name).write_text(text)
    files = sorted(map(str, tmp_path.iterdir()))
    done = fresh.run(SCRIPT, tmp_path, *files)
    assert done.status == 0, done.error
    for file, seen in json.loads(done.output.splitlines()[-1]).items():
        assert {event for event, path in seen if path == file} == {"open"}, file  # sub.ngc calls itself
        # files of Python and of the built-in machines, and what says how much memory there is
        own = (sys.prefix, str(MODELS), "/proc/", "/sys/")
        others = [path for _, path in seen if path != file and not path.startswith(own)]
        assert not [path for path in others if not path.isdigit()], file  # a number is that of a file opened before
    assert sorted(map(str, tmp_path.iterdir())) == files


class Planted:
    def __reduce__(self):
        return os.mkdir, ("planted",)


def test_a_pickle_in_a_record_is_not_read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    small_job().follow().save("run.npz")
    planted = io.BytesIO()
    np.save(planted, np.array([Planted()], dtype=object), allow_pickle=True)
    with zipfile.ZipFile("run.npz") as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    for name in members:
        with zipfile.ZipFile("bad.npz", "w") as archive:
            for member, content in members.items():
                archive.writestr(member, planted.getvalue() if member == name else content)
        with pytest.raises(InputError, match="is damaged"):
            Run.load("bad.npz")
    assert not Path("planted").exists()
