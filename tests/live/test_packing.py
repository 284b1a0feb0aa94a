"""Binary messages of a viewer's content: a page decodes what the report's page has, and only changes are sent."""

import base64
import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from gantrysim.live.packing import Parts, message
from gantrysim.report.encoding import encoded_ascending, encoded_numbers, encoded_runs


def unpacked(content, before=None):
    """The content as gantrysim/live/web/link.js puts it together, bytes in base64 as the report's page has them."""
    length = int.from_bytes(content[:4], "little")
    header = json.loads(content[4 : 4 + length])
    body = content[4 + length :]
    for column in header["columns"].values():
        for name in ("data", "jumps"):
            if name in column:
                offset, size = column[name]
                column[name] = base64.b64encode(body[offset : offset + size]).decode()
    same = header["same"]
    earlier = before or {"columns": {}}
    columns = {name: earlier["columns"][name] for name in same["columns"]}
    fields = {name: earlier[name] for name in same["fields"]}
    return {**fields, **header["fields"], "columns": {**columns, **header["columns"]}}


@pytest.fixture
def content():
    values = np.cumsum(np.random.default_rng(1).standard_normal(500))
    return {
        "rows": 500,
        "period": 0.001,
        "series": [{"name": "contour", "label": "contour <b>"}],
        "columns": {
            "tick": encoded_ascending(np.arange(500)),
            "dispense": encoded_runs(np.arange(500) > 20),
            "contour": encoded_numbers(values),
            "s": encoded_numbers(np.linspace(0.0, 100.0, 500)),
        },
    }


def test_a_page_decodes_the_content_of_the_report(content):
    assert unpacked(message({}, Parts.of(content))) == content


def test_only_what_changed_is_sent(content):
    before = Parts.of(content)
    changed = {**content, "period": 0.002, "columns": {**content["columns"]}}
    changed["columns"]["contour"] = encoded_numbers(np.arange(500.0) ** 2)
    del changed["columns"]["s"]
    del changed["series"]
    whole = message({}, Parts.of(changed))
    part = message({}, Parts.of(changed), before)
    assert len(part) < len(whole)
    header = json.loads(part[4 : 4 + int.from_bytes(part[:4], "little")])
    assert header["fields"] == {"period": 0.002}
    assert list(header["columns"]) == ["contour"]
    assert unpacked(part, content) == changed


def test_the_same_again_sends_no_column(content):
    parts = Parts.of(content)
    again = message({"number": 3}, parts, Parts.of(content))
    header = json.loads(again[4:])
    assert header["number"] == 3
    assert header["columns"] == {}
    assert header["fields"] == {}
    assert unpacked(again, content) == content


def test_the_bundle_is_built_from_its_sources():
    package = Path(__file__).parents[2] / "gantrysim"
    sources = sorted(
        file.relative_to(package).as_posix()
        for folder in ("live/web", "report/web")
        for file in (package / folder).glob("*.js")
        if not file.name.endswith(".min.js")
    )
    digest = hashlib.sha256(b"".join((package / name).read_bytes() for name in sources)).hexdigest()
    bundle = (package / "live" / "web" / "workbench.min.js").read_text(encoding="utf-8")
    assert digest in bundle.partition("\n")[0], "scripts/build_web.sh builds it again"
