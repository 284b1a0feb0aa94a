"""Attacks on the workbench's server, each refused: other sites, foreign names, missing tokens, code, paths, sizes."""

import json

import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from gantrysim import InputError
from gantrysim.live.app import Hub, app_of
from gantrysim.live.controls import Control, checked_values
from gantrysim.live.draft import Draft
from gantrysim.live.serving import TOKEN, Guard, opened
from gantrysim.live.store import LONGEST_UPLOAD, Store
from gantrysim.live.worker import Message

PORT = 8123
OWN = f"http://127.0.0.1:{PORT}"
SOCKET = f"ws://127.0.0.1:{PORT}/socket"
ELSEWHERE = "https://attacker.example"


class NoWorker:
    """In place of the process: nothing here is to be simulated."""

    asked = ()

    def __init__(self, receive, allow_code=""):
        self.allow_code = allow_code

    def ask(self, request):
        NoWorker.asked = (*NoWorker.asked, request)

    def close(self):
        pass


@pytest.fixture
def served(tmp_path, monkeypatch):
    """The guard and a browser that has not entered; the folder has a job and a file beside it."""
    monkeypatch.setattr("gantrysim.live.app.Worker", NoWorker)
    NoWorker.asked = ()
    folder = tmp_path / "jobs"
    scratch = tmp_path / "scratch"
    folder.mkdir()
    scratch.mkdir()
    (tmp_path / "secret.toml").write_text("[program]\n")
    guard = Guard(app_of(Hub(folder, "an225", scratch)), "127.0.0.1", PORT)
    with TestClient(guard, OWN, follow_redirects=False) as client:
        yield guard, client


@pytest.fixture
def entered(served):
    guard, client = served
    assert client.get("/", params={TOKEN: guard.token}).status_code == 303
    return client


@pytest.fixture
def filmed(tmp_path, monkeypatch):
    """A browser that has entered, a workbench with a film, and its address."""
    monkeypatch.setattr("gantrysim.live.app.Worker", NoWorker)
    film = tmp_path / "film.mp4"
    film.write_bytes(bytes(range(100)))
    hub = Hub(tmp_path, "an225", tmp_path)
    guard = Guard(app_of(hub), "127.0.0.1", PORT)
    with TestClient(guard, OWN, follow_redirects=False) as client:
        client.get("/", params={TOKEN: guard.token})
        hub.workbench.receive(Message(0, "film", {"name": 'a"\n<b>', "file": str(film)}))
        yield client


def test_a_film_is_given_in_parts_under_its_number_alone(filmed):
    answer = filmed.get("/film", params={"number": "0"}, headers={"range": "bytes=10-19"})
    assert (answer.status_code, answer.content) == (206, bytes(range(10, 20)))
    assert answer.headers["content-type"] == "video/mp4"
    assert answer.headers["cross-origin-resource-policy"] == "same-origin"
    assert "\n" not in answer.headers["content-disposition"]
    for number in ("", "1", "00", "../film.mp4", "/etc/passwd", "0\0"):
        assert filmed.get("/film", params={"number": number}).status_code == 404
    assert filmed.get("/film/0").status_code == 404
    assert filmed.get("/film", params={"number": "0"}, headers={"range": "bytes=900-"}).status_code == 416


def test_a_film_is_given_to_no_foreign_name_and_nothing_is_posted_there(filmed):
    answer = filmed.get("/film", params={"number": "0"}, headers={"host": f"attacker.example:{PORT}"})
    assert answer.status_code == 421
    assert filmed.post("/film", params={"number": "0"}, headers={"origin": ELSEWHERE}).status_code == 403
    assert filmed.post("/film", params={"number": "0"}, headers={"origin": OWN}).status_code == 405
    filmed.cookies.clear()
    assert filmed.get("/film", params={"number": "0"}).status_code == 403


def socket_refused(client, **headers):
    try:
        with client.websocket_connect(SOCKET, headers=headers):
            return False
    except WebSocketDisconnect as closed:
        return closed.code == 1008


def test_the_first_address_sets_a_strict_cookie_and_hides_the_token(served):
    guard, client = served
    answer = client.get("/", params={TOKEN: guard.token})
    cookie = answer.headers["set-cookie"]
    assert answer.status_code == 303
    assert answer.headers["location"] == "/"
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    assert guard.token not in cookie
    assert client.get("/").status_code == 200


@pytest.mark.parametrize("path", ["/", "/workbench.js", "/workbench.css", "/viewer3d.js", "/film", "/socket", "/none"])
def test_nothing_is_served_without_the_cookie(served, path):
    _, client = served
    assert client.get(path).status_code == 403
    client.cookies.set(f"gantrysim_{PORT}", "guessed")
    assert client.get(path).status_code == 403


@pytest.mark.parametrize("token", ["", "wrong", "a" * 5000, "é"])
def test_a_wrong_token_is_refused(served, token):
    _, client = served
    answer = client.get("/", params={TOKEN: token})
    assert answer.status_code == 403
    assert "set-cookie" not in answer.headers


@pytest.mark.parametrize(
    "host",
    [
        f"attacker.example:{PORT}",
        "127.0.0.1",
        "127.0.0.1:1",
        f"127.0.0.1.attacker.example:{PORT}",
        f"10.0.0.5:{PORT}",
        "",
    ],
)
def test_a_foreign_name_that_points_here_is_refused(entered, host):
    """DNS rebinding: the browser sends the attacker's name, and would send its cookies."""
    assert entered.get("/", headers={"host": host}).status_code == 421
    assert socket_refused(entered, host=host, origin=f"http://{host}")


@pytest.mark.parametrize("host", [f"127.0.0.1:{PORT}", f"localhost:{PORT}", f"[::1]:{PORT}"])
def test_the_names_of_this_machine_are_admitted(entered, host):
    assert entered.get("/", headers={"host": host}).status_code == 200


def test_an_open_server_admits_addresses_but_no_foreign_names(tmp_path):
    guard = Guard(app_of(Hub(tmp_path, "an225", tmp_path)), "0.0.0.0", PORT)
    client = TestClient(guard, OWN)
    assert client.get("/", headers={"host": f"192.168.1.7:{PORT}"}).status_code == 403  # without the cookie
    assert client.get("/", headers={"host": f"attacker.example:{PORT}"}).status_code == 421


@pytest.mark.parametrize("origin", [ELSEWHERE, "null", "", f"http://127.0.0.1:{PORT + 1}", f"https://127.0.0.1:{PORT}"])
def test_another_sites_websocket_and_upload_are_refused(entered, origin):
    assert socket_refused(entered, origin=origin)
    answer = entered.post("/upload", params={"name": "a.ngc"}, content=b"G1 X1\n", headers={"origin": origin})
    assert answer.status_code == 403
    assert len(NoWorker.asked) == 1


def test_the_pages_own_websocket_is_admitted(entered):
    assert not socket_refused(entered, origin=OWN)


def test_a_websocket_and_an_upload_without_origin_are_refused(entered):
    assert socket_refused(entered)
    assert entered.post("/upload", params={"name": "a.ngc"}, content=b"G1 X1\n").status_code == 403


def test_a_websocket_without_the_cookie_is_refused(served):
    _, client = served
    assert socket_refused(client, origin=OWN)


def test_the_page_admits_no_inline_script_no_frame_and_no_other_source(entered):
    answer = entered.get("/")
    policy = dict(part.strip().split(" ", 1) for part in answer.headers["content-security-policy"].split(";"))
    assert policy["default-src"] == "'none'"
    assert policy["script-src"] == "'self'"
    assert policy["style-src"] == "'self'"
    assert policy["frame-ancestors"] == "'none'"
    assert "unsafe" not in answer.headers["content-security-policy"]
    assert answer.headers["x-content-type-options"] == "nosniff"
    page = answer.text
    assert page.count("<script") == page.count('<script src="/workbench.js"')
    assert " onclick" not in page
    assert " style=" not in page


def test_an_upload_that_is_too_long_is_refused(entered, tmp_path):
    content = b"x" * (LONGEST_UPLOAD + 1)
    assert (
        entered.post("/upload", params={"name": "a.ngc"}, content=content, headers={"origin": OWN}).status_code == 413
    )
    assert list((tmp_path / "scratch").iterdir()) == []


@pytest.mark.parametrize(
    ("name", "stored"),
    [
        ("../../etc/passwd", "passwd"),
        ("..\\..\\boot.ini", "boot.ini"),
        ("<img src=x onerror=alert(1)>.ngc", "_img src_x onerror_alert_1__.ngc"),
        ("..", "program.txt"),
        ("", "program.txt"),
        ("a\0b.ngc", "a_b.ngc"),
    ],
)
def test_a_dropped_file_stays_in_the_temporary_folder(entered, tmp_path, name, stored):
    assert (
        entered.post("/upload", params={"name": name}, content=b"G1 X1\n", headers={"origin": OWN}).status_code == 200
    )
    assert [file.name for file in (tmp_path / "scratch").iterdir()] == [stored]
    assert NoWorker.asked[-1].draft.path == str(tmp_path / "scratch" / stored)


def test_a_dropped_trace_is_no_job_and_its_columns_name_no_file(entered, tmp_path):
    log = "time,encoder_x\n" + "\n".join(f"{0.1 * k:.1f},{k}" for k in range(10))
    answer = entered.post("/upload", params={"name": "../<b>.csv"}, content=log, headers={"origin": OWN})
    assert answer.status_code == 200
    request = NoWorker.asked[-1]
    assert request.draft.path == "an225"
    assert request.beside.path == str(tmp_path / "scratch" / "_b_.csv")
    with entered.websocket_connect(SOCKET, headers={"origin": OWN}) as socket:
        assert socket.receive_json()["jobs"]["dropped"] == []
        for columns in ("/etc/passwd", "../secret.toml", 5, "x" * (1 << 25)):
            socket.send_json({"do": "columns", "columns": columns})
            assert socket.receive_json()["kind"] == "remark"
        socket.send_json({"do": "columns", "columns": "time=t", "period": "soon"})
        assert socket.receive_json()["kind"] == "remark"
    assert NoWorker.asked[-1] is request


def test_only_listed_jobs_are_opened(tmp_path):
    store = Store(tmp_path, tmp_path)
    for kind, name in (
        ("folder", "../secret.toml"),
        ("folder", "/etc/passwd"),
        ("built-in", "../x"),
        ("other", "an225"),
    ):
        with pytest.raises(InputError, match="unknown job"):
            store.path(kind, name)


@pytest.mark.parametrize("name", ["../out", "a/b", "", ".hidden", "a\nb", "a" * 101, "C:\\x"])
def test_a_job_is_saved_under_a_plain_name_in_the_folder_alone(tmp_path, name):
    with pytest.raises(InputError, match="file name"):
        Store(tmp_path, tmp_path).save(name, "x")
    assert list(tmp_path.iterdir()) == []


def test_a_page_names_no_code_and_no_file():
    law = Control("servo.law", "servo", "law", "", "", ["pid"], ["pid"], options=("pid", "pd"), additions=("zv",))
    damping = Control("servo.damping", "servo", "damping", "", "", 1.0, 1.0, 0.2, 2.0)
    machine = Control("machine", "machine", "machine", "", "", "xy", "xy", options=("xy", "xyz"))
    known = [law, damping, machine]
    refused = [
        {"servo.law": ["/tmp/evil.py:law"]},
        {"servo.law": ["pid", "/tmp/evil.py:law"]},
        {"servo.law": "/tmp/evil.py:law"},
        {"machine": "/etc/passwd"},
        {"program.controller": "/tmp/evil.py:Controller"},
        {"servo.damping": "one"},
        {"servo.damping": 1e9},
        {"servo.damping": float("nan")},
        {"servo.damping": True},
    ]
    for values in refused:
        with pytest.raises(InputError):
            checked_values(values, known)
    assert checked_values({"servo.law": ["pd", "zv"], "servo.damping": 0.7, "machine": None}, known) == {
        "servo.law": ["pd", "zv"],
        "servo.damping": 0.7,
        "machine": None,
    }


@pytest.mark.parametrize("table", ['[servo]\nlaw = "evil.py:law"', '[program]\ncontroller = "evil.py:Controller"'])
def test_code_of_a_dropped_or_edited_job_does_not_run(tmp_path, monkeypatch, table):
    dropped = tmp_path / "dropped"
    scratch = tmp_path / "scratch"
    dropped.mkdir()
    scratch.mkdir()
    (dropped / "evil.py").write_text("raise SystemExit('it ran')\n")
    program = (
        ""
        if "program" in table
        else '\n[program]\ncontroller = "trio.MoveSpiral"\ndiameter = 50.0\nturns = 1\nthickness = 5.0'
    )
    text = f'name = "x"\n{table}{program}\n'
    (dropped / "x.toml").write_text(text)
    monkeypatch.chdir(tmp_path)
    for draft in (Draft(str(dropped / "x.toml")), Draft(str(dropped / "x.toml"), text)):
        with pytest.raises(InputError, match="--allow-code"):
            draft.opened(scratch, allow_code=False)


@pytest.mark.parametrize(
    "order",
    [
        "",
        "[]",
        "null",
        "{",
        '{"do": 1}',
        '{"do": "receive"}',
        '{"do": "__class__"}',
        '{"do": "open"}',
        '{"do": "try", "number": "0"}',
        '{"do": "set", "values": {"name": "x"}}',
        '{"do": "program", "text": 5}',
        "[" * 100_000,
    ],
)
def test_a_malformed_order_is_answered_by_a_remark_and_changes_nothing(entered, order):
    with entered.websocket_connect(SOCKET, headers={"origin": OWN}) as socket:
        assert socket.receive_json()["kind"] == "state"
        socket.send_text(order)
        answer = json.loads(socket.receive_text())
        assert answer["kind"] == "remark"
        assert answer["text"]
    assert len(NoWorker.asked) == 1


def test_an_unknown_job_is_refused_before_anything_listens(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="unknown job"):
        opened("nothing.ngc")
    assert opened("an225") == (tmp_path, "an225")
    assert opened(str(tmp_path)) == (tmp_path, "an225")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("nothing.ngc",), "unknown job 'nothing.ngc'"),
        (("an225", "--host", "203.0.113.1"), "--host 203.0.113.1 --port 0: cannot be bound"),
    ],
)
def test_the_command_refuses_in_one_line(gantrysim_command, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    status, output, errors = gantrysim_command("live", *arguments, "--no-browser")
    assert (status, output) == (2, "")
    assert message in errors.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []
