"""Damaged MJCF: an element or attribute removed, repeated or replaced is refused in one line, or simulated."""

import copy
import random
import warnings
import xml.etree.ElementTree as ET
from importlib.resources import as_file, files

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import InputError, Machine, Servo, simulate
from gantrysim.machine.machine import builtin_models
from gantrysim.machine.quiet import quiet
from gantrysim.paths.arcs import ArcChain
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.stability.margins import margins_of

from support.soaked import examples

VALUES = ("0", "-1", "nan", "inf", "1e300", "1e-300", "", "abc", "1 2", "0 0 0", "1e15", "-0.001", "1e5", "x", "none")
OPTIONS = ("timestep", "gravity", "integrator", "solver", "iterations", "tolerance", "density", "viscosity")


def text_of(name: str) -> str:
    with as_file(files("gantrysim.models") / f"{name}.xml") as file:
        return file.read_text()


def option_of(root: ET.Element) -> ET.Element:
    """The element option, made where it is in an included file; the last of several holds."""
    return ET.SubElement(root, "option")


def damaged(rng: random.Random, text: str) -> str:
    root = ET.fromstring(text)
    elements = list(root.iter())
    kind = rng.choice(("remove", "repeat", "option", "without", "value", "value", "value"))
    if kind in ("remove", "repeat"):
        parent = rng.choice([element for element in elements if len(element)])
        child = rng.choice(list(parent))
        parent.remove(child) if kind == "remove" else parent.append(copy.deepcopy(child))
    elif kind == "option":
        option_of(root).set(rng.choice(OPTIONS), rng.choice(VALUES))
    else:
        element = rng.choice([element for element in elements if element.attrib])
        name = rng.choice(list(element.attrib))
        parts = element.attrib.pop(name).split()
        if kind == "value":
            if len(parts) > 1 and rng.random() < 0.5:
                parts[rng.randrange(len(parts))] = rng.choice(VALUES)
            else:
                parts = [rng.choice(VALUES)]
            element.set(name, " ".join(parts))
    return ET.tostring(root, encoding="unicode")


def attempt(folder, text: str) -> bool:
    """Whether a model is simulated; else it is refused in one line. Nothing is left in the working folder."""
    file = folder / "model.xml"
    file.write_text(text, encoding="utf-8")
    refused = ""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            machine = Machine(file)
            servo = Servo.derive(machine.axes)
            margins_of(machine, servo)
            position = np.zeros((40, len(machine.axes)))
            path = ArcChain((0, 0), 0.3, [0.0], [5.0])
            run = simulate(machine, servo, Setpoints(servo.period, machine.axis_names, position, [True] * 40, path))
            assert np.isfinite(run.nozzle).all()
        except InputError as error:
            refused = str(error)
    assert "\n" not in refused
    assert len(refused) < 700
    assert [item.name for item in folder.iterdir() if item.is_file()] == ["model.xml"]
    return not refused


@pytest.fixture
def folder(tmp_path, monkeypatch):
    models = files("gantrysim.models")
    (tmp_path / "parts").mkdir()
    for part in (models / "parts").iterdir():
        if part.is_file():
            (tmp_path / "parts" / part.name).write_bytes(part.read_bytes())
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", ["xy", "stage"])
def test_the_undamaged_model_is_simulated(folder, name):
    assert attempt(folder, text_of(name))


def test_some_damage(folder):
    @given(seed=st.integers(0, 1 << 30))
    @examples(12)
    def run(seed):
        rng = random.Random(seed)
        attempt(folder, damaged(rng, text_of(rng.choice(("xy", "xyz", "stage")))))

    run()


def test_what_mujoco_warns_of_at_every_step_reaches_no_file(folder):
    text = text_of("delta").replace('solref="0.0005 1"', 'solref="-1"', 1)
    assert text != text_of("delta")
    attempt(folder, text)


@pytest.mark.soak
@pytest.mark.parametrize("name", builtin_models())
def test_much_damage(folder, name, record_property):
    simulated = sum(attempt(folder, damaged(random.Random(seed), text_of(name))) for seed in range(300))
    assert 30 < simulated < 270
    record_property("attack", "MJCF of the built-in machines: elements removed, attributes replaced")
    record_property("tries", 300)
    record_property("refused", 300 - simulated)


@pytest.mark.parametrize("value", ["0", "-0.001", "nan", "inf", "1e300", "1e-300", "2", "5e-8"])
def test_a_timestep_that_is_none(folder, value):
    root = ET.fromstring(text_of("xy"))
    option_of(root).set("timestep", value)
    with pytest.raises(InputError, match=r"timestep = |XML contains a 'NaN'"):
        Machine(_written(folder, root))
    assert not attempt(folder, ET.tostring(root, encoding="unicode"))


def _written(folder, root):
    file = folder / "model.xml"
    file.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    return file


def test_a_warning_of_mujoco_is_an_error_in_our_words_and_writes_no_log(folder):
    root = ET.fromstring(text_of("xy"))
    ET.SubElement(root.find("worldbody"), "geom", size="0.001", pos="nan 0 0")
    with pytest.raises(InputError, match=r"model .*model.xml: MuJoCo warns: XML contains a 'NaN'"):
        Machine(_written(folder, root))
    assert not (folder / "MUJOCO_LOG.TXT").exists()


def test_the_handler_of_a_user_is_there_again_after_a_machine_was_built(folder):
    mine: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(mine.append)
    try:
        own = mujoco.get_mju_user_warning()
        with quiet() as outer:
            with quiet() as inner:
                Machine("xy")
            assert (inner, outer) == ([], [])
        assert mujoco.get_mju_user_warning() == own
        spec = mujoco.MjSpec.from_string('<mujoco><worldbody><geom size="1" pos="nan 0 0"/></worldbody></mujoco>')
        assert len(mine) == 1
        with quiet() as said:
            mujoco.MjSpec.from_string('<mujoco><worldbody><geom size="1" pos="nan 0 0"/></worldbody></mujoco>')
        assert len(mine) == 1
        assert "NaN" in said[0]
        assert spec is not None
    finally:
        mujoco.set_mju_user_warning(before)


def test_a_fluid_that_stops_all_motion_is_refused(folder):
    root = ET.fromstring(text_of("xyz"))
    option_of(root).set("viscosity", "1e300")
    assert not attempt(folder, ET.tostring(root, encoding="unicode"))
