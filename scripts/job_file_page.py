"""Write docs/job-file.md: every key of a job with its default and meaning, from the docstrings of the code."""

from collections.abc import Iterable
from pathlib import Path

from gantrysim.job.key_list import Key, sections

PAGE = Path(__file__).parent.parent / "docs" / "job-file.md"

HEAD = """# Job file

A job describes a run completely, in TOML. `gantrysim run JOB` takes a built-in job or a file; `--set KEY=VALUE` changes
a value, by its full key (`--set servo.damping=0.7`) or by its last part where that is unique (`--set damping=0.7`).
`job.toml` in every output folder holds all keys with the values that were used. Lengths are in mm, angles in deg, times
in s. The [tutorial](tutorial.md) has an example; `python scripts/job_file_page.py` writes this page from the code, and
`gantrysim info keys` prints it; `gantrysim info servo.damping` prints one key.
"""


def section(title: str, keys: Iterable[Key]) -> str:
    """Return a heading and a table."""
    cells = [(f"`{key.name}`", key.default, " ".join(key.meaning.split()).replace("|", r"\|")) for key in keys]
    table = [("key", "default", "meaning"), ("---", "---", "---"), *cells]
    return f"\n## {title}\n\n" + "".join(f"| {' | '.join(row)} |\n" for row in table)


def page() -> str:
    """Return the page."""
    return HEAD + "".join(section(title, keys) for title, keys in sections().items())


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
