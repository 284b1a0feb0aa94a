"""The file of a study's finished rows."""

import json
from hashlib import sha256

import pytest

from gantrysim import InputError, Job
from gantrysim.study import Ledger, StudyInterrupted, run_study
from gantrysim.study.ledger import LEDGER

from support.soaked import WHOLE
from support.studies import SHORT, Counted, Toy, cases_of, content


def test_the_ledger_ignores_a_line_that_was_cut_off(tmp_path):
    with Ledger(tmp_path, {"study": "x"}) as ledger:
        ledger.add("one", {"status": "ok", "value": 1 / 3})
        ledger.add("two", {"status": "ok", "value": 2.0})
    whole = (tmp_path / LEDGER).read_bytes()
    for cut in (3, 1):  # in the middle of the last line, and before its end
        (tmp_path / LEDGER).write_bytes(whole[:-cut])
        with Ledger(tmp_path, {"study": "x"}) as ledger:
            assert (ledger.resumed, "one" in ledger, "two" in ledger) == (1, True, False)
            assert ledger["one"] == {"status": "ok", "value": 1 / 3}
            ledger.add("two", {"status": "ok", "value": 2.0})
        assert (tmp_path / LEDGER).read_bytes() == whole


def test_a_row_is_on_disk_as_soon_as_it_is_finished_and_half_a_row_is_removed(tmp_path):
    checksum = sha256(b'["one", {"status": "ok"}]').hexdigest()[:16].encode()
    with Ledger(tmp_path, {"study": "x"}) as ledger:
        ledger.add("one", {"status": "ok"})
        assert (tmp_path / LEDGER).read_bytes().endswith(b'["one", {"status": "ok"}, "%s"]\n' % checksum)
    whole = (tmp_path / LEDGER).read_bytes()
    (tmp_path / LEDGER).write_bytes(whole + b'["two", {"val')
    with Ledger(tmp_path, {"study": "x"}):
        assert (tmp_path / LEDGER).read_bytes() == whole


def test_no_damage_of_a_byte_changes_a_row(tmp_path):
    """Rows are as they were written, or run again."""
    rows = {name: {"status": "ok", "value": k + 0.125, "curve": [1.5, 2.0 * k]} for k, name in enumerate("abcd")}
    with Ledger(tmp_path, {"study": "x"}) as ledger:
        for name, row in rows.items():
            ledger.add(name, row)
    whole, found = (tmp_path / LEDGER).read_bytes(), set()
    for at in range(len(whole)):
        for bit in (1, 4, 16) if WHOLE else (4,):
            (tmp_path / LEDGER).write_bytes(whole[:at] + bytes([whole[at] ^ bit]) + whole[at + 1 :])
            with Ledger(tmp_path, {"study": "x"}) as ledger:
                kept = {name: ledger[name] for name in rows if name in ledger}
                assert len(ledger) == ledger.resumed == len(kept)
                assert kept.items() <= rows.items()
                found.add(len(kept))
    assert found == {0, 1, 2, 3}


@pytest.mark.parametrize("found", [b"", b"{", b'{"study"', b"\xff\xfe\n", b"nonsense\n"])
def test_a_ledger_without_a_complete_first_line_starts_empty(tmp_path, found):
    (tmp_path / LEDGER).write_bytes(found)
    with Ledger(tmp_path, {"study": "x"}) as ledger:
        assert (ledger.resumed, ledger.discarded) == (0, None)
        ledger.add("one", {"status": "ok"})
    with Ledger(tmp_path, {"study": "x"}) as ledger:
        assert ledger.resumed == 1


@pytest.mark.parametrize(
    "row",
    [
        "[]",
        "5",
        '{"status": 5}',
        '"ok"',
        "null",
        "{}",
        '{"value": 1.0}',
        '{"status": "ok", "a": {}}',
        '{"status": "ok", "a": [[1]]}',
        '{"status": "ok", "a": NaN}',
        '{"status": "ok", "a": 1e999}',
        '{"status": "ok", "a": [-1e101]}',
        f'{{"status": "ok", "a": 1{"0" * 400}}}',
    ],
)
def test_a_row_that_no_study_writes_is_run_again_though_its_checksum_is_right(tmp_path, row):
    with Ledger(tmp_path, {"study": "x"}) as ledger:
        ledger.add("one", {"status": "ok", "value": 1, "none": None, "is": True, "curve": [1.5, None]})
        ledger.add("two", {"status": "ok"})
    good = (tmp_path / LEDGER).read_text().splitlines()
    checksum = sha256(json.dumps(["two", json.loads(row)]).encode()).hexdigest()[:16]
    (tmp_path / LEDGER).write_text("\n".join([*good[:2], f'["two", {row}, "{checksum}"]']) + "\n")
    with Ledger(tmp_path, {"study": "x"}) as ledger:
        assert (ledger.resumed, "one" in ledger, "two" in ledger) == (1, True, False)


def test_rows_that_do_not_fit_their_study_are_named(tmp_path):
    with Ledger(tmp_path, {"study": "x"}) as ledger:
        ledger.add("one", {"status": "ok"})
        with pytest.raises(KeyError), ledger.blamed():
            ledger["one"]["value"]
    said = rf"^{tmp_path / LEDGER}: its rows do not fit the study \(KeyError: 'value'\): remove this file to run all"
    with Ledger(tmp_path, {"study": "x"}) as ledger, pytest.raises(InputError, match=said), ledger.blamed():
        ledger["one"]["value"]


def _row(index):
    return {"status": "ok", "name": "x", "count": 3, "is": True, "third": index / 3, "curve": [1.0], "none": None}


_WRONG = {"name": 5, "count": 5.0, "is": 1, "third": "y", "curve": 2.0}
_MISFITS = [
    *(
        {name: value for name, value in _row(1).items() if name != left_out}
        for left_out in _row(1)
        if left_out != "status"
    ),
    *({**_row(1), name: value} for name, value in _WRONG.items()),
    {**_row(1), "more": 1.0},
]


@pytest.mark.parametrize("misfit", _MISFITS)
@pytest.mark.parametrize("at", [0, 2])
def test_a_row_unlike_the_others_is_run_again_and_written_once_more(tmp_path, misfit, at):
    job = Job.load("an225", SHORT)
    cases = cases_of(job)
    rows = {case.key: _row(index) for index, case in enumerate(cases)}
    with Ledger(tmp_path, {"study": "x"}) as ledger:
        for index, (key, row) in enumerate(rows.items()):
            ledger.add(key, misfit if index == at else row)
    with Ledger(tmp_path, {"study": "x"}) as ledger:
        assert ledger.forget_misfits(cases)
        assert [case.key in ledger for case in cases] == [index != at for index in range(4)]
        assert ledger.resumed == 3
        ledger.add(cases[at].key, _row(at))
        assert not ledger.forget_misfits(cases)
    with Ledger(tmp_path, {"study": "x"}) as ledger:
        assert {key: ledger[key] for key in rows} == rows


def test_a_resumed_study_with_rows_unlike_the_others_ends_like_an_uninterrupted_one(tmp_path):
    job = Job.load("an225", SHORT)
    whole = tmp_path / "whole"
    broken = tmp_path / "broken"
    expected = run_study(Toy(job), whole, workers=1)
    with pytest.raises(StudyInterrupted):
        run_study(Toy(job, Counted(interrupted_at=2)), broken, workers=1)
    lines = (broken / LEDGER).read_text().splitlines()
    key, row, _ = json.loads(lines[1])
    del row["pair"]
    checksum = sha256(json.dumps([key, row]).encode()).hexdigest()[:16]
    lines[1] = json.dumps([key, row, checksum])
    (broken / LEDGER).write_text("\n".join(lines) + "\n")
    rest = Toy(job)
    outcome = run_study(rest, broken, workers=1)
    assert rest.measure.seen == [0.4, 0.3, 0.51]
    assert (outcome.resumed, outcome.rows) == (1, expected.rows)
    assert content(broken) == content(whole)


def test_rows_of_another_study_are_discarded_with_the_reason(tmp_path):
    with Ledger(tmp_path, {"study": "x", "version": 1}) as ledger:
        ledger.add("one", {"value": 1})
    with Ledger(tmp_path, {"study": "x", "version": 2}) as ledger:
        assert (ledger.resumed, len(ledger), ledger.discarded) == (0, 0, "they differ in version")
    with Ledger(tmp_path, {"study": "x", "version": 2}) as ledger:
        assert ledger.discarded is None
    (tmp_path / LEDGER).write_text("[1]\n")
    with Ledger(tmp_path, {"study": "x"}) as ledger:
        assert ledger.discarded == "they are not of a study"
