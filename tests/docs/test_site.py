"""The site of the documentation: built without a warning, with every page, equations, API and search."""

import json
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from pkgutil import resolve_name

import pytest

import gantrysim

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
CONFIG = tomllib.loads((ROOT / "zensical.toml").read_text(encoding="utf-8"))["project"]


def pages_of(entry):
    """The pages of an entry of the navigation, whatever its depth."""
    if isinstance(entry, str):
        return [entry]
    entries = entry.values() if isinstance(entry, dict) else entry
    return [page for part in entries for page in pages_of(part)]


def documented():
    """The names that the API's pages show."""
    text = "\n".join(page.read_text(encoding="utf-8") for page in sorted((DOCS / "api").glob("*.md")))
    return re.findall(r"^::: (\S+)$", text, flags=re.MULTILINE)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    # copies, as the site is written beside the file that a link leads to
    shutil.copytree(DOCS, folder / "docs")
    shutil.copy(ROOT / "zensical.toml", folder)
    (folder / "gantrysim").symlink_to(ROOT / "gantrysim")
    command = [sys.executable, "-m", "zensical", "build", "--clean", "--strict"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / "site"


def test_every_page_stands_once_in_the_navigation():
    pages = pages_of(CONFIG["nav"])
    assert sorted(pages) == sorted(page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md"))


@pytest.mark.soak
def test_every_page_is_built(site):
    for page in pages_of(CONFIG["nav"]):
        built = site / page.removesuffix("index.md").removesuffix(".md") / "index.html"
        assert built.is_file(), page
    assert "involute" in (site / "search.json").read_text(encoding="utf-8")


@pytest.mark.soak
def test_search_finds_the_codes_of_the_valve(site):
    """By a heading, which search weighs more than text."""
    titles = [item["title"] for item in json.loads((site / "search.json").read_text(encoding="utf-8"))["items"]]
    assert any({"M3", "M5", "glue"} <= set(re.findall(r"\w+", title)) for title in titles)


@pytest.mark.soak
def test_no_page_of_the_site_asks_the_network(site):
    for page in site.rglob("*.html"):
        loaded = re.findall(r'<(?:script|link|img)[^>]+(?:src|href)="(https?:[^"]+)"', page.read_text(encoding="utf-8"))
        assert [address for address in loaded if "canonical" not in address] == [], page


@pytest.mark.soak
def test_equations_are_set_as_equations(site):
    equations = 0
    for page in (DOCS / "theory.md", DOCS / "identification.md"):
        text = (site / page.stem / "index.html").read_text(encoding="utf-8")
        shown = page.read_text(encoding="utf-8").count("\n$$\n") // 2
        assert text.count('<math display="block"') == shown > 0, page
        assert "$" not in re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL)
        assert not any("&amp;" in equation for equation in re.findall(r"<math.*?</math>", text, flags=re.DOTALL))
        equations += shown
    assert equations > 10


@pytest.mark.soak
def test_the_api_s_pages_show_every_public_class_and_function(site):
    shown = {resolve_name(name) for name in documented()}
    public = [getattr(gantrysim, name) for name in gantrysim.__all__ if not name.islower() or "_" in name]
    missing = [thing for thing in public if callable(thing) and thing not in shown and not _is_error(thing)]
    assert missing == []
    for name in documented():
        page = next(page for page in (DOCS / "api").glob("*.md") if f"::: {name}\n" in page.read_text(encoding="utf-8"))
        html = (site / "api" / page.stem / "index.html").read_text(encoding="utf-8")
        assert f'id="{name}"' in html


@pytest.mark.soak
def test_tables_of_docstrings_are_set_as_tables(site):
    html = (site / "api" / "studies" / "index.html").read_text(encoding="utf-8")
    assert "<td>reward_contour</td>" in html
    for page in (site / "api").rglob("*.html"):
        assert "====" not in page.read_text(encoding="utf-8"), page


@pytest.mark.soak
def test_commands_are_marked_for_their_stylesheet(site):
    html = (site / "exchange" / "index.html").read_text(encoding="utf-8")
    blocks = re.findall(r'<div class="(language-(?:sh|text)) highlight">(.*?)</pre>', html, flags=re.DOTALL)
    for kind, block in blocks:
        text = re.sub(r"<.*?>", "", block)
        assert kind == ("language-sh" if text.startswith("gantrysim ") else "language-text"), text
    assert len(blocks) > 5
    assert "stylesheets/commands.css" in html


def _is_error(thing):
    return isinstance(thing, type) and issubclass(thing, Exception)


def test_the_theory_names_tests_that_exist():
    named = re.findall(r"`(tests/[\w/.]+)`", (DOCS / "theory.md").read_text(encoding="utf-8"))
    assert len(named) > 5
    assert [name for name in named if not (ROOT / name).exists()] == []
