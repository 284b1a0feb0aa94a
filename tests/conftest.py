"""Machines and paths that several tests share."""

import gc
import os
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# Before NumPy and SciPy are loaded, here and in processes of the tests: their matrices are small, and threads that wait
# for one another on busy cores take a hundred times as long as one alone.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# the date on pages and cards
os.environ["SOURCE_DATE_EPOCH"] = "1700000000"
# else the command's console would keep to that width, whatever a test sets
os.environ.pop("COLUMNS", None)

# A job in the background of a shell begins with Ctrl-C ignored, one of nohup with SIGHUP. The command respects that,
# but its tests need the signals.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

from gantrysim import Machine
from gantrysim.cli.main import main
from gantrysim.paths.arcs import ArcChain

from support.blank_pictures import save_blank
from support.browser import Browser, chromium
from support.built_machines import built_once
from support.fresh import FreshProcesses
from support.parsed_app import parsed_app
from support.shared_opengl import shared_opengl
from support.soaked import WHOLE, number_of_examples

settings.register_profile(
    "any machine",
    max_examples=number_of_examples(50),
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("any machine")

RIGID = """
<mujoco model="rigid">
  <option timestep="0.0005" integrator="Euler" gravity="0 0 0"/>
  <size nuser_jnt="1" nuser_sensor="1"/>
  <default>
    <joint type="slide" damping="{damping}" range="-{travel} {travel}" user="{speed}"/>
    <dcmotor gear="{gear}" motorconst="0.03 0.03" resistance="0.3" inductance="{inductance} 0" input="ff"
      controller="0 0 0 0 0 {voltage}" armature="1.5e-5" saturation="0 {current} 0"/>
  </default>
  <worldbody>
    <body name="work"/>
    <body name="bridge">
      <joint name="y" axis="0 1 0"/>
      <geom type="sphere" size="0.01" mass="3"/>
      <body name="carriage">
        <joint name="x" axis="1 0 0"/>
        <geom type="sphere" size="0.01" mass="1"/>
        <site name="nozzle"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <dcmotor name="x" joint="x"/>
    <dcmotor name="y" joint="y"/>
  </actuator>
  <sensor>
    <actuatorpos name="x" actuator="x" user="10000"/>
    <actuatorpos name="y" actuator="y" user="10000"/>
  </sensor>
</mujoco>
"""

RIGID_DEFAULTS = {
    "damping": 12.0,  # [N·s/m]
    "travel": 0.15,  # [m]
    "speed": 1.0,  # [m/s]
    "gear": 628.3185307179587,  # 2 pi / 10 mm [rad/m]
    "inductance": 3e-4,  # [H], L/R = 1 ms
    "voltage": 24.0,  # [V]
    "current": 30.0,  # [A]
}


def pytest_configure(config):
    marker = "validates(what, against, tolerance): a row of docs/validation.md; scripts/validation_page.py writes them"
    config.addinivalue_line("markers", marker)


def pytest_collection_finish(session):
    """Keep the garbage collector from what all tests share, and call it rarely: it took a tenth of their time."""
    gc.freeze()
    gc.set_threshold(10_000)


@pytest.fixture(scope="module", autouse=True)
def _frozen_imports() -> Iterator[None]:
    """Keep the garbage collector from what the tests of a module have imported, compiled and cached.

    The workbench collects before each answer, which took half a second towards the end of the suite.
    """
    yield
    _, middle, old = gc.get_count()
    # that is, since the last time by which a generation has grown
    if middle or old:
        gc.collect()
        gc.freeze()


@pytest.fixture
def rigid(tmp_path: Path) -> Callable[..., Machine]:
    """A rigid two-axis machine without friction but viscous; keywords replace RIGID_DEFAULTS."""

    def build(**changes: float) -> Machine:
        file = tmp_path / "rigid.xml"
        file.write_text(RIGID.format(**{**RIGID_DEFAULTS, **changes}))
        return Machine(file)

    return build


@pytest.fixture(scope="session", autouse=True)
def _built_machines() -> Iterator[None]:
    """Jobs share their built-in machines, see `support.built_machines`; the soak builds each."""
    if WHOLE:
        yield
        return
    with built_once():
        yield


@pytest.fixture(scope="session", autouse=True)
def _shared_opengl() -> Iterator[None]:
    """Renderers share an OpenGL context, see `support.shared_opengl`; in the soak each has its own."""
    if WHOLE:
        yield
        return
    with shared_opengl():
        yield


@pytest.fixture(scope="session")
def fresh(tmp_path_factory) -> Iterator[FreshProcesses]:
    """Fresh processes, see `support.fresh`."""
    processes = FreshProcesses(tmp_path_factory.mktemp("fresh"))
    yield processes
    processes.close()


@pytest.fixture(scope="session")
def _chromium(tmp_path_factory) -> Iterator[Browser]:
    with chromium(tmp_path_factory.mktemp("chromium")) as opened:
        yield opened


@pytest.fixture
def browser(_chromium) -> Iterator[Browser]:
    """The browser that all tests of this process share, as if it had just begun: on paper of no colour scheme."""
    _chromium.media()
    _chromium.messages()
    yield _chromium
    # a page left open would go on drawing
    _chromium.driver.get("about:blank")


@pytest.fixture(scope="session")
def xy() -> Machine:
    return Machine("xy")


@pytest.fixture(scope="session")
def xyz() -> Machine:
    return Machine("xyz")


@pytest.fixture
def circle() -> Callable[..., ArcChain]:
    """A circle about the origin, counter-clockwise from (radius, 0), of several turns in one arc."""

    def build(radius: float, turns: float = 1.0) -> ArcChain:
        return ArcChain((radius, 0.0), 1.5707963267948966, [1 / radius], [6.283185307179586 * radius * turns])

    return build


@pytest.fixture(scope="module")
def blank_pictures() -> Iterator[None]:
    """Figures that tests of a module, and its fixtures, write are blank, see `support.blank_pictures`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("matplotlib.figure.Figure.savefig", save_blank)
        yield


@pytest.fixture
def gantrysim_command(request, monkeypatch, capsys):
    """Run the command in this process: exit status, standard output, standard error.

    Its figures are blank, see `support.blank_pictures`, but in tests marked `drawn` and in the soak.
    """
    if not WHOLE and not any(request.node.get_closest_marker(name) for name in ("drawn", "soak")):
        monkeypatch.setattr("matplotlib.figure.Figure.savefig", save_blank)

    monkeypatch.setattr("gantrysim.cli.main.app", parsed_app())

    def command(*arguments):
        monkeypatch.setattr(sys, "argv", ["gantrysim", *map(str, arguments)])
        status = 0
        try:
            main()
        except SystemExit as stop:
            status = stop.code or 0
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return command
