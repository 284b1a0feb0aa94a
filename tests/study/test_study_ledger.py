"""The file of a study's finished rows."""

import json
from hashlib import sha256

import pytest

from gantrysim import InputError
from gantrysim.study import Ledger
from gantrysim.study.ledger import LEDGER


def test_the_ledger_ignores_a_line_that_was_cut_off(tmp_path):
    with Ledger(tmp_path, {"study": "x"}) as ledger:
        ledger.add("one", {"value": 1 / 3})
        ledger.add("two", {"value": 2.0})
    whole = (tmp_path / LEDGER).read_bytes()
    for cut in (3, 1):  # in the middle of the last line, and before its end
        (tmp_path / LEDGER).write_bytes(whole[:-cut])
        with Ledger(tmp_path, {"study": "x"}) as ledger:
            assert (ledger.resumed, "one" in ledger, "two" in ledger) == (1, True, False)
            assert ledger["one"] == {"value": 1 / 3}
            ledger.add("two", {"value": 2.0})
        assert (tmp_path / LEDGER).read_bytes() == whole


def test_a_row_is_on_disk_as_soon_as_it_is_finished_and_half_a_row_is_removed(tmp_path):
    checksum = sha256(b'["one", {"value": 1}]').hexdigest()[:16].encode()
    with Ledger(tmp_path, {"study": "x"}) as ledger:
        ledger.add("one", {"value": 1})
        assert (tmp_path / LEDGER).read_bytes().endswith(b'["one", {"value": 1}, "%s"]\n' % checksum)
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
        for bit in (1, 4, 16):
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
        ledger.add("one", {"value": 1})
    with Ledger(tmp_path, {"study": "x"}) as ledger:
        assert ledger.resumed == 1


@pytest.mark.parametrize(
    "row",
    ["[]", "5", '{"status": 5}', '"ok"', "null",
     '{"a": {}}', '{"a": [[1]]}', '{"a": NaN}', '{"a": 1e999}', '{"a": [-1e101]}',
     f'{{"a": 1{"0" * 400}}}'],
)  # fmt: skip
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
        ledger.add("one", {"value": 1})
        with pytest.raises(KeyError), ledger.blamed():
            ledger["one"]["status"]
    said = rf"^{tmp_path / LEDGER}: its rows do not fit the study \(KeyError: 'status'\): remove this file to run all"
    with Ledger(tmp_path, {"study": "x"}) as ledger, pytest.raises(InputError, match=said), ledger.blamed():
        ledger["one"]["status"]


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
