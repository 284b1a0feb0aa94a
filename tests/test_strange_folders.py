"""Folders of strangers: reading changes nothing, and writing leaves everything outside of them as it is."""

import inspect
import os
import shutil
import sys
import tempfile
import threading
from fnmatch import fnmatchcase
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gantrysim import InputError, Job
from gantrysim.base import files
from gantrysim.base.files import NEW, OLD, PARTIAL, READY, SWAP, complete, held_folder, replaced_file, replaced_files
from gantrysim.exchange.tables import load_record
from gantrysim.report.folder import STUDY_FILES, SavedRun, output_folder
from gantrysim.study import Study
from gantrysim.study.circle.study import CircleStudy
from gantrysim.study.laws.study import LawsStudy
from gantrysim.study.ledger import LEDGER, Ledger
from gantrysim.study.tuning.study import TuningStudy

from support.films import saved, small_job
from support.strangers import half_done, neighbours, tree
from support.studies import SHORT

pytestmark = pytest.mark.skipif(not hasattr(os, "O_NOFOLLOW"), reason="links and pipes as on POSIX")

JOB = Job.load("an225", SHORT).toml()
FASTER = Job.load("an225", [*SHORT, "loop_period=0.02"]).toml()
FILES = ("study.csv", "curves.csv", "study.toml", "job.toml", "report.html")
QUICK = ["--no-video", "--no-report", "--no-causes", "--no-improve"]


@pytest.fixture
def stranger(tmp_path):
    folder = neighbours(tmp_path)
    (folder / "job.toml").write_text(JOB)
    return folder


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    monkeypatch.setattr(files, "_PATIENCE", 0.0)


def listing(folder):
    half_done(folder)
    (folder / SWAP / "names.json").write_text('["../../project", "project"]')


def writing(folder):
    (folder / "plots").symlink_to("../..")
    half_done(folder, new={"plots/x.png": "planted"})


@pytest.mark.parametrize("attack", [listing, writing])
def test_reading_a_stranger_s_folder_changes_nothing(stranger, tmp_path, gantrysim_command, attack):
    attack(stranger)
    before = tree(tmp_path)
    assert gantrysim_command("check", stranger / "job.toml")[0] == 0
    for command in (("export", stranger), ("render", stranger), ("compare", stranger, "--measured", "x.csv")):
        status, _, errors = gantrysim_command(*command)
        assert status == 2
        assert errors.count("\n") == 1
    for read in (SavedRun.load, load_record, lambda folder: Job.load(folder / "missing.toml")):
        with pytest.raises(InputError):
            read(stranger)
    assert tree(tmp_path) == before


@pytest.mark.parametrize("attack", [listing, writing])
def test_writing_to_a_stranger_s_folder_is_refused_in_one_line(stranger, tmp_path, gantrysim_command, attack):
    attack(stranger)
    before = tree(tmp_path)
    for command in (("run", "an225"), ("study", "loop", "an225"), ("tune", "an225")):
        status, _, errors = gantrysim_command(*command, "--out", stranger)
        assert status == 2
        assert errors.count("\n") == 1
        assert errors.startswith(f"error: {stranger}: {SWAP} in it ")
        assert tree(tmp_path) == before


@pytest.mark.parametrize(
    ("command", "name"),
    [
        (("run", "an225"), "thesis.txt"),
        (("run", "an225"), "study.csv"),
        (("study", "loop", "an225"), "thesis.txt"),
        (("study", "loop", "an225"), "run.npz"),
        (("tune", "an225"), "plots/mine.txt"),
    ],
)
@pytest.mark.parametrize("how", ["moved back", "moved in"])
def test_a_planted_file_touches_none_that_the_command_does_not_write(
    stranger, tmp_path, gantrysim_command, command, name, how
):
    file = stranger / name
    file.parent.mkdir(exist_ok=True)
    file.write_text("my own")
    if how == "moved in":
        half_done(stranger, {name: "planted"})
    else:
        half_done(stranger, old={name: "planted"}, is_ready=False)
    before = tree(tmp_path)
    status, _, errors = gantrysim_command(*command, "--out", stranger)
    said = f"error: {stranger}: {SWAP} in it names {name!r}, which this command does not write: nothing is changed; "
    assert (status, errors) == (2, f"{said}remove it, or name another folder\n")
    assert tree(tmp_path) == before


def test_all_that_a_study_writes_may_be_completed():
    """What a killed study leaves complete is moved into place by any study."""
    kinds = [Study, CircleStudy, LawsStudy]
    for kind in kinds:
        kinds += kind.__subclasses__()
    names = {*(f"plots/{name}.png" for kind in kinds for name in kind.plots), *TuningStudy.texts, *FILES}
    assert len(names) > len(FILES) + 5
    assert all(any(fnmatchcase(name, pattern) for pattern in STUDY_FILES) for name in names)


PLAIN = [
    "a",
    "b.txt",
    "é",
    "~",
    "\u202e",
    "a\\b",
    "plots/x",
    "plots/deep/y",
    "out/x",
    "in/x",
    "out",
    "plots",
    "b.txt/c",
]
PLAIN += [f"{PARTIAL}x", SWAP, f"{SWAP}/x"]
LINKS = ["plots", "out", "in", "a", *(f"{SWAP}/{part}" for part in (NEW, READY, OLD, "more", f"{READY}/plots"))]
TARGETS = ["..", "../..", "../../project", "../../project/thesis.txt", ".", "plots", "nowhere", SWAP, "loop"]

texts = st.dictionaries(st.sampled_from(PLAIN), st.just("planted"), max_size=3)
links = st.dictionaries(st.sampled_from(LINKS), st.sampled_from(TARGETS), max_size=2)


@given(is_ready=st.booleans(), new=texts, old=texts, links=links)
@example(is_ready=True, new={"plots/x": "planted"}, old={}, links={"plots": "../.."})
@example(is_ready=True, new={}, old={}, links={f"{SWAP}/{READY}": "../../project"})
@example(is_ready=False, new={}, old={}, links={f"{SWAP}/{OLD}": "../../project"})
@example(is_ready=True, new={"a": "planted"}, old={}, links={f"{SWAP}/{READY}/plots": "../../../project"})
@example(is_ready=True, new={"a": "planted"}, old={}, links={})
@example(is_ready=False, new={"a": "planted"}, old={"b.txt": "planted"}, links={})
def test_whatever_its_hidden_files_name_nothing_outside_of_the_folder_changes(is_ready, new, old, links):
    with tempfile.TemporaryDirectory() as name:
        root = Path(name, "as", "deep", "as", "names", "climb")  # or a fault would reach real files
        stranger = neighbours(root)
        (stranger / "a").write_text("old a")
        try:
            for link, target in links.items():
                if link.startswith(SWAP):
                    continue
                (stranger / link).unlink(missing_ok=True)
                (stranger / link).symlink_to(target)
            half_done(stranger, new, old, is_ready)
        except OSError:  # one name is a folder and a file
            return
        for link, target in links.items():
            place = stranger / link
            if link.startswith(SWAP) and not place.parent.is_symlink():
                place.parent.mkdir(exist_ok=True)
                shutil.rmtree(place) if place.is_dir() else place.unlink(missing_ok=True)
                place.symlink_to(Path("..") / target)
        before = tree(root)
        outside = {path: kind for path, kind in before.items() if not path.startswith("here/stranger/")}
        for read in (SavedRun.load, load_record, lambda folder: Job.load(folder / "job.toml")):
            with pytest.raises(InputError):
                read(stranger)
        assert tree(root) == before
        refused = False
        try:
            complete(stranger, "here")
        except InputError:
            refused = True
        after = tree(root)
        if refused:
            assert after == before
        else:
            assert not (stranger / SWAP).exists()
            assert after.keys() >= {f"here/stranger/{name}" for name in (new if is_ready else old)}
            assert {path: kind for path, kind in after.items() if not path.startswith("here/stranger/")} == outside


@pytest.mark.parametrize("kind", ["link", "file", "other user", "pipe", "link in it", "deep"])
def test_a_hidden_folder_that_no_command_of_this_user_has_left_is_refused(stranger, tmp_path, kind):
    half_done(stranger, {"a": "planted"})
    swap = stranger / SWAP
    if kind == "link":
        swap.rename(tmp_path / "project" / "swap")
        swap.symlink_to("../../project/swap")
    elif kind == "file":
        shutil.rmtree(swap)
        swap.write_text("")
    elif kind == "other user":
        if os.geteuid():
            pytest.skip("only root gives files away")
        os.chown(swap, 65534, 65534)
    elif kind == "pipe":
        os.mkfifo(swap / READY / "b")
    elif kind == "link in it":
        (swap / READY / "b").symlink_to("../../../../project/thesis.txt")
    else:
        (swap / READY / "/".join("d" * 300)).mkdir(parents=True)
    before = tree(tmp_path)
    with pytest.raises(InputError) as caught:
        complete(stranger, "here")
    assert str(stranger) in str(caught.value)
    assert tree(tmp_path) == before


def test_only_real_folders_of_this_user_are_swept(stranger, tmp_path):
    (stranger / f"{PARTIAL}link").symlink_to("../../project")
    os.mkfifo(stranger / f"{PARTIAL}pipe")
    (stranger / f"{PARTIAL}deep" / "/".join("d" * 300)).mkdir(parents=True)
    (stranger / f"{PARTIAL}mine").mkdir()
    (stranger / f"{PARTIAL}mine" / "link").symlink_to("../../../project")
    given_away = stranger / f"{PARTIAL}theirs"
    given_away.mkdir()
    if not os.geteuid():
        os.chown(given_away, 65534, 65534)
    outside = tree(tmp_path / "project")
    most = sys.getrecursionlimit()
    sys.setrecursionlimit(len(inspect.stack()) + 150)  # rather than folders so deep that pytest cannot remove them
    try:
        with held_folder(stranger, "here"):
            pass
    finally:
        sys.setrecursionlimit(most)
    assert not (stranger / f"{PARTIAL}mine").exists()
    assert given_away.exists() == (os.geteuid() == 0)
    assert (stranger / f"{PARTIAL}link").is_symlink()
    assert tree(tmp_path / "project") == outside


def test_a_study_s_progress_is_not_kept_through_a_link(stranger, tmp_path):
    (stranger / LEDGER).symlink_to("../../project/thesis.txt")
    before = tree(tmp_path)
    said = f"cannot be written: {LEDGER} in it is a link: remove it$"
    with pytest.raises(InputError, match=said), Ledger(stranger, {}):
        pytest.fail("begun")
    assert tree(tmp_path) == before


def test_a_link_in_place_of_a_folder_of_the_output_is_refused_before_a_run(stranger, tmp_path, gantrysim_command):
    (stranger / "job.toml").unlink()
    (stranger / "plots").symlink_to("../../project")
    before = tree(tmp_path)
    status, _, errors = gantrysim_command("run", "an225", "--out", stranger)
    said = f"error: --out {stranger}: plots in it is a link, must be a folder: move it away\n"
    assert (status, errors) == (2, said)
    assert tree(tmp_path) == before


def test_a_folder_that_becomes_a_link_while_its_files_are_written_keeps_the_old_files(stranger, tmp_path):
    def written():
        with (
            held_folder(stranger, "here"),
            replaced_files(stranger, ["plots/thesis.txt", "job.toml"], "here") as scratch,
        ):
            (scratch / "plots").mkdir()
            (scratch / "plots" / "thesis.txt").write_text("planted")
            (stranger / "plots").symlink_to("../../project")

    outside = tree(tmp_path / "project")
    with pytest.raises(InputError, match="plots in it is a link"):
        written()
    assert tree(tmp_path / "project") == outside
    assert (stranger / "job.toml").read_text() == JOB


def test_files_of_one_folder_are_not_written_through_a_link_to_another(tmp_path, gantrysim_command):
    folder = saved(tmp_path / "run", small_job())
    aim = tmp_path / "project.txt"
    aim.write_text("mine")
    for command, name in ((("export", folder), "run.csv"), (("render", folder, "--at", 0), "render.png")):
        (folder / name).symlink_to(aim)
        status, _, errors = gantrysim_command(*command)
        assert status == 2
        assert errors == (
            f"error: file {folder / name}: is a link to {aim}, in another folder: name that file, or remove the link\n"
        )
    aim.unlink()  # the link leads to nothing
    assert gantrysim_command("export", folder)[0] == 2
    assert not aim.exists()
    (folder / "compare").symlink_to("..")
    log = tmp_path / "log.csv"
    log.write_text("time [s],x [mm],y [mm]\n" + "".join(f"{0.001 * k},{k},{k}\n" for k in range(99)))
    errors = gantrysim_command("compare", folder, "--measured", log)[2]
    assert errors == f"error: run {folder}: compare in it is a link: name the output folder with --out\n"


def test_a_link_within_a_folder_is_followed(tmp_path):
    (tmp_path / "latest.csv").symlink_to("first.csv")
    with replaced_file(tmp_path / "latest.csv") as partial:
        partial.write_text("new")
    assert (tmp_path / "first.csv").read_text() == "new"
    assert (tmp_path / "latest.csv").is_symlink()


def test_a_reader_says_what_a_killed_command_has_left_and_the_next_writer_completes_it(tmp_path, gantrysim_command):
    folder = saved(tmp_path / "run", small_job())
    half_done(folder, new={"job.toml": FASTER})
    (folder / "job.toml").unlink()
    before = tree(tmp_path)
    said = (
        f"a killed command has left its new files in {folder / SWAP}, not yet in place: any command that writes to the "
        f"folder puts them there, as gantrysim run JOB --out {folder}\n"
    )
    for command, label in (
        (("render", folder), f"run {folder}"),
        (("check", folder / "job.toml"), f"job {folder / 'job.toml'}"),
        (("gains", "an225", "--servo", folder / "job.toml"), f"servo {folder / 'job.toml'}"),
    ):
        assert gantrysim_command(*command)[::2] == (2, f"error: {label}: {said}")
    assert len(load_record(folder).time)  # it is whole
    assert tree(tmp_path) == before
    status, _, errors = gantrysim_command("run", folder / "job.toml", "--out", folder, *QUICK)
    assert (status, errors) == (0, "")
    assert (folder / "job.toml").read_text() == FASTER
    assert not (folder / SWAP).exists()
    assert SavedRun.load(folder).job.program["loop_period"] == 0.02


def test_an_output_folder_is_looked_at_after_what_a_killed_command_has_left_is_complete(tmp_path):
    (tmp_path / "summary.json").write_text("of a run whose record is still on its way")
    half_done(tmp_path, new={"run.npz": "record"})
    with output_folder(tmp_path) as scratch:
        (scratch / "run.npz").write_text("new record")
    assert tree(tmp_path) == {"run.npz": b"new record"}


def test_a_reader_waits_for_a_command_that_replaces_files(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "_PATIENCE", 60.0)
    folder = saved(tmp_path / "run", small_job())
    (folder / SWAP).mkdir()
    moved = tmp_path / "moved"
    (folder / "run.npz").rename(moved)

    def write():
        moved.rename(folder / "run.npz")
        (folder / SWAP).rmdir()

    timer = threading.Timer(0.2, write)
    timer.start()
    assert len(SavedRun.load(folder).run.time)
    timer.join()
