"""A measured trace or a record beside the run: what a dropped file is, and the values of `gantrysim compare`."""

import json
import re

import numpy as np
import pytest

from gantrysim import Job
from gantrysim.compare.comparison import Comparison
from gantrysim.compare.measured import Assignment, Trace
from gantrysim.compare.page import headline
from gantrysim.live.draft import Beside, Draft, Request
from gantrysim.live.store import is_trace
from gantrysim.live.studio import Studio
from gantrysim.tables.reading import read_table

from support.live_jobs import JOB

NO_DIFFERENCE = re.compile(r"difference 0[;.]")
ROWS = "\n".join(f"{0.1 * k:.1f},{k},{2 * k}" for k in range(20))


def lines(names, run):
    """A log of a run's command and encoders, with heads."""
    table = np.column_stack([run.time, run.commanded, run.encoder])
    return "\n".join([",".join(names), *(",".join(f"{value:.6f}" for value in row) for row in table)])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("traces")
    (made / "short.toml").write_text(JOB)
    job = Job.load(made / "short.toml", {"servo.damping": 0.6})
    run = job.run()
    run.save(made / "run.npz")
    (made / "log.csv").write_text(
        lines(["time_s", "commanded_x", "commanded_y", "encoder_x", "encoder_y"], run), encoding="utf-8"
    )
    (made / "own.csv").write_text(lines(["t", "a", "b", "c", "d"], run), encoding="utf-8")
    return made


@pytest.fixture
def show(tmp_path):
    """A function that returns the results of a request, by their engines."""
    studio = Studio(tmp_path)

    def answer(draft, beside, reference=None):
        studio.newest += 1
        results = {}

        def send(kind, content):
            assert kind != "refused", content
            if kind == "result":
                results[content["head"]["engine"]] = content

        studio.answer(Request(studio.newest, "show", draft, reference, beside=beside), send)
        return results

    return answer


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("run.npz", "PK", True),
        ("log.csv", f"time_s,a,b\n{ROWS}", True),
        ("log.csv", f"k,encoder_x,encoder_y\n{ROWS}", True),
        ("log.csv", f"n,PFB x,PCMD x\n{ROWS}", True),
        ("points.csv", f"x,y,z\n{ROWS}", False),
        ("points.csv", ROWS, False),
        # of a table of dots, time is how long each is dispensed
        ("dots.csv", "x,y,time\n" + "\n".join(f"{k},{k},0.2" for k in range(20)), False),
        ("log.txt", f"a,b,c\n{ROWS}", True),
        ("part.txt", "G21 G90\nG1 X1\nM2\n", False),
        ("part.txt", "\n".join(f"G1 X{k} Y{k}" for k in range(20)), False),
        ("part.ngc", f"time_s,a,b\n{ROWS}", False),
        ("job.toml", f"time_s,a,b\n{ROWS}", False),
        ("log.csv", "", False),
        ("long.csv", f"time_s,a,b\n{ROWS}\n" + "\n".join(f"{2 + 0.1 * k:.1f},1,2" for k in range(20_000)), True),
    ],
)
def test_a_log_is_told_from_a_program(name, text, expected):
    assert is_trace(name, text.encode()) == expected
    assert is_trace(name, text.encode("utf-16")) == expected


def test_binary_tables_are_told_by_their_first_bytes():
    assert is_trace("log.hdf5", b"\x89HDF\r\n\x1a\n" + bytes(100))
    assert is_trace("log.dat", b"PAR1" + bytes(100))


def test_the_values_are_those_of_compare(folder, show):
    draft = Draft(str(folder / "short.toml"))
    results = show(draft, Beside(str(folder / "log.csv")))
    # where it lies is not known before the first whole answer
    assert list(results) == ["mujoco"]
    head = results["mujoco"]["head"]
    job = Job.load(folder / "short.toml")
    run = job.run()
    comparison = Comparison.of(Trace.of(read_table(folder / "log.csv"), Assignment({}), run), run, job.built_machine)
    assert head["beside"]["sentence"] == headline(comparison)
    assert not head["beside"]["failed"]
    columns = results["mujoco"]["parts"].columns
    assert {"contour.0", "contour.1", "servo.0", "servo.1"} <= set(columns)
    assert "structure.0" not in columns


def test_a_change_of_the_servo_is_laid_beside_at_once_and_one_of_the_command_later(folder, show):
    draft = Draft(str(folder / "short.toml"))
    beside = Beside(str(folder / "log.csv"))
    show(draft, beside)
    stiffer = Draft(draft.path, values={"servo.damping": 0.6})
    results = show(stiffer, beside, draft)
    assert list(results) == ["loop", "mujoco"]
    # the gains are those of the trace
    sentence = results["loop"]["head"]["beside"]["sentence"]
    assert len(NO_DIFFERENCE.findall(sentence)) == 2, sentence
    names = [run["name"] for run in json.loads(results["loop"]["parts"].fields["runs"])]
    assert names == ["log.csv", "kept", "now"]
    assert "contour.2" in results["loop"]["parts"].columns
    assert list(show(Draft(draft.path, values={"program.speed": 80.0}), beside)) == ["mujoco"]


def test_a_record_of_the_same_run_explains_all(folder, show):
    results = show(Draft(str(folder / "short.toml"), values={"servo.damping": 0.6}), Beside(str(folder / "run.npz")))
    assert len(NO_DIFFERENCE.findall(results["mujoco"]["head"]["beside"]["sentence"])) == 4  # following and torque


def test_columns_of_other_names_are_asked_for_and_taken(folder, show):
    draft = Draft(str(folder / "short.toml"))
    beside = Beside(str(folder / "own.csv"))
    results = show(draft, beside)
    words = results["mujoco"]["head"]["beside"]
    assert words["failed"]
    assert words["sentence"].startswith("own.csv: no position is measured: Columns must name")
    assert "contour" in results["mujoco"]["parts"].columns
    # that it does not fit is known of the next run of the same command
    assert list(show(Draft(draft.path, values={"servo.damping": 0.8}), beside)) == ["loop", "mujoco"]
    named = beside._replace(columns="time=t,commanded.x=a,commanded.y=b,encoder.x=c,encoder.y=d")
    words = show(draft, named)["mujoco"]["head"]["beside"]
    assert not words["failed"]
    assert words["sentence"] == show(draft, Beside(str(folder / "log.csv")))["mujoco"]["head"]["beside"]["sentence"]
