"""Sizes of an MJCF that would take minutes or gigabytes, and numbers whose products are none."""

import os
import re
from importlib.resources import files

import mujoco
import pytest

from gantrysim import InputError, Machine


@pytest.fixture(scope="module")
def text():
    spec = mujoco.MjSpec.from_file(str(files("gantrysim.models") / "xy.xml"))
    spec.compile()
    return spec.to_xml()


def written(folder, text, content):
    file = folder / "model.xml"
    file.write_text(text.replace("<worldbody>", f"{content}<worldbody>", 1))
    return file


SIZES = {
    "height field": (
        '<asset><hfield name="h" nrow="30000" ncol="30000" size="1 1 1 1"/></asset>',
        "its height fields and textures have 9e.08 cells: must have at most 1e.08",
    ),
    "texture": (
        '<asset><texture name="q" type="2d" builtin="flat" width="90000" height="90000"/></asset>',
        "have 8.1e.09 cells",
    ),
    "replicate": (
        '<worldbody><replicate count="999"><replicate count="999"><site/></replicate></replicate></worldbody>',
        "has more than 20000 elements, copies counted each time: must have fewer",
    ),
    "flexcomp": (
        '<worldbody><flexcomp name="f" type="grid" count="900 900 900" dim="3"/></worldbody>',
        "has more than 20000 elements",
    ),
    "memory": ('<size memory="100T"/>', "size memory = 100T: must be at most 4e.09 bytes"),
    "user": ('<size nuserdata="2000000000"/>', "size nuserdata = 2000000000: must be at most 100000"),
}


@pytest.mark.parametrize(("content", "message"), SIZES.values(), ids=SIZES.keys())
def test_a_size_is_refused_before_anything_is_allocated(tmp_path, text, content, message):
    with pytest.raises(InputError, match=message):
        Machine(written(tmp_path, text, content))


def test_sizes_in_included_files_count(tmp_path, text):
    (tmp_path / "more.xml").write_text(f"<mujoco>{SIZES['height field'][0]}</mujoco>")
    with pytest.raises(InputError, match=r"9e.08 cells"):
        Machine(written(tmp_path, text, '<include file="more.xml"/>'))


def test_a_file_that_includes_itself_is_refused(tmp_path, text):
    with pytest.raises(InputError, match=r"model.xml: "):
        Machine(written(tmp_path, text, '<include file="model.xml"/>'))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes")
@pytest.mark.parametrize("content", ['<include file="pipe"/>', '<asset><mesh name="m" file="pipe"/></asset>'])
def test_a_file_of_an_mjcf_that_is_a_named_pipe(tmp_path, text, content):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="pipe: is a named pipe: must be a regular file"):
        Machine(written(tmp_path, text, content))


@pytest.mark.parametrize("gear", ["1e308", "1e-308", "1e-7", "1e10"])
def test_a_gear_without_bounds(tmp_path, text, gear):
    changed = re.sub(r'gear="[^"]*"', f'gear="{gear}"', text)
    assert changed != text
    with pytest.raises(InputError, match=r"gear of 'x' = .*: must be 1e-06 to 1e.09"):
        Machine(written(tmp_path, changed, ""))
