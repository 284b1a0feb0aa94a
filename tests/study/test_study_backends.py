"""Where the cases of studies are run, by name."""

import socket
import sys
import threading

import pytest
from joblib.parallel import get_active_backend

from gantrysim import InputError, Job
from gantrysim.study import on_backend
from gantrysim.study.runner import _finished_lots

from support.studies import SHORT, cases_of


def third_of(cases):
    """Rows of cases, with the thread that measured them."""
    return [{"status": "ok", "third": dict(case.tags)["value"] / 3, "thread": threading.get_ident()} for case in cases]


def active():
    return type(get_active_backend()[0]).__name__


def test_a_backend_holds_inside_the_block():
    before = active()
    for name, kind in {"threading": "ThreadingBackend", "loky": "LokyBackend", None: before}.items():
        with on_backend(name):
            assert active() == kind
        assert active() == before
    with on_backend("threading"), on_backend(None):
        assert active() == "ThreadingBackend"


def test_sequential_cases_run_one_after_another_in_the_caller_s_thread():
    """With rows as they come: the second case is not begun before the first one's row is there."""
    begun = []

    def measure(cases):
        begun.append(len(begun))
        return third_of(cases)

    cases = cases_of(Job.load("an225"), (0.3, 0.6, 0.9))
    with on_backend("sequential"):
        results = _finished_lots(cases, None, measure, lambda cases, *_: [[case] for case in cases])
        for number, ((_, row),) in enumerate(results):
            assert begun == list(range(number + 1))
            assert row["third"] == pytest.approx((0.1, 0.2, 0.3)[number])
            assert row["thread"] == threading.get_ident()
    assert len(begun) == 3


@pytest.mark.parametrize(
    ("name", "text"),
    [
        (
            "lky",
            r"^unknown backend 'lky': did you mean loky\? known: loky, dask=ADDRESS, ",
        ),
        ("ray=tcp://a:1", "^unknown backend 'ray=tcp://a:1': "),
        ("", "^unknown backend '': "),
        ("dask", r"^--backend dask: must be dask=ADDRESS, as in dask=tcp://10\.0\.0\.1:8786$"),
        ("dask=", r"^--backend dask=: must be dask=ADDRESS, as in dask=tcp://10\.0\.0\.1:8786$"),
    ],
)
def test_an_unknown_backend_is_refused(name, text):
    with pytest.raises(InputError, match=text), on_backend(name):
        pass


def test_without_dask_the_error_names_the_package_to_install(monkeypatch):
    monkeypatch.delitem(sys.modules, "gantrysim.study.cluster", raising=False)
    monkeypatch.setitem(sys.modules, "distributed", None)
    text = r'^--backend dask=tcp://a:1: distributed is not installed: pip install "gantrysim\[dask\]"$'
    with pytest.raises(InputError, match=text), on_backend("dask=tcp://a:1"):
        pass


@pytest.fixture
def impatient(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("gantrysim.study.cluster._PATIENCE", 0.5)


@pytest.mark.parametrize(
    ("address", "reason"),
    [
        ("tcp://127.0.0.1:1", "none within 0.5 s"),
        ("nowhere", "missing port number in address 'nowhere'"),
        ("foo://127.0.0.1:8786", "unknown address scheme 'foo'"),
    ],
)
def test_a_scheduler_that_does_not_answer_is_one_line(impatient, gantrysim_command, tmp_path, address, reason):
    settings = [part for setting in SHORT for part in ("--set", setting)]
    command = ("study", "speed", "an225", *settings, "--backend", f"dask={address}", "--out", tmp_path / "out")
    status, printed, said = gantrysim_command(*command)
    assert (status, printed) == (2, "")
    assert said.startswith(f"error: --backend dask={address}: no scheduler answers: {reason}")
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("answer", "reason"), [(b"", "none within 0.5 s"), (b"HTTP/1.1 200 OK\r\n\r\n", "")])
def test_an_address_that_is_not_a_scheduler_is_refused(impatient, answer, reason):
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"

        def serve():
            connection, _ = server.accept()
            with connection:
                connection.sendall(answer)
                while connection.recv(1 << 16):
                    pass

        serving = threading.Thread(target=serve)
        serving.start()
        text = f"^--backend dask={address}: no scheduler answers: {reason}"
        with pytest.raises(InputError, match=text), on_backend(f"dask={address}"):
            pass
        serving.join()


@pytest.mark.parametrize("study", ["circle", "loop", "machine", "repeat", "speed"])
def test_every_study_takes_a_backend(gantrysim_command, tmp_path, study):
    status, _, said = gantrysim_command("study", study, "--backend", "none", "--out", tmp_path / "out")
    assert status == 2
    assert said.startswith("error: unknown backend 'none': ")
