"""Count which program files of a folder gantrysim checks, and why it refuses the others.

    python scripts/try_files.py FOLDER [FOLDER ...] [--exclude PATTERN] [--list]

Every file is loaded and planned as `gantrysim check FILE` does, with nothing else given. The table lists the reasons
of refusal, most frequent first; numbers and names in a reason are replaced, so that alike ones are counted together.
"""

from __future__ import annotations

import argparse
import fnmatch
import re
import signal
from collections import defaultdict
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from types import FrameType

from gantrysim.base.errors import GantryError, text_of
from gantrysim.job.job import Job

SUFFIXES = (".ngc", ".nc", ".gcode", ".g", ".gco", ".cnc", ".tap", ".mpf")
LIMIT = 60  # of a file [s]
RUNS = "runs"
WIDEST = 110  # characters of a reason


class _TooSlowError(Exception):
    pass


def outcome(file: Path, limit: int = LIMIT) -> str:
    """Return `RUNS`, or why the check of a file ended without a plan."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise _TooSlowError

    signal.signal(signal.SIGALRM, interrupt)
    signal.alarm(limit)
    try:
        Job.load(str(file)).plan()
    except GantryError as error:
        return str(error)
    except _TooSlowError:
        return f"not checked within {limit} s"
    except Exception as error:  # a crash is what this script looks for
        return f"CRASH {text_of(error)}"
    finally:
        signal.alarm(0)
    return RUNS


def reason(text: str, file: Path) -> str:
    """Return a message without the file's name, numbers and quoted names."""
    bare = text.replace(f"{file}: ", "").replace(f"{file.name}: ", "")
    bare = re.sub(r"line \d+( of [^:]*)?: ", "", bare, count=1)
    bare = re.sub(r"'[^']*'", "'..'", bare)
    bare = re.sub(r"subroutines \([^)]*\)", "subroutines (..)", bare)
    return re.sub(r"(?<![A-Za-z])-?\d[\d.]*(e[-+]?\d+)?", "#", bare)[:WIDEST]


def program_files(folders: Iterable[Path], suffixes: Iterable[str], excluded: Iterable[str]) -> list[Path]:
    """Return the program files in folders, sorted; a pattern excludes paths."""
    files = {file for folder in folders for file in folder.rglob("*") if file.suffix.lower() in suffixes}
    return sorted(f for f in files if f.is_file() and not any(fnmatch.fnmatch(str(f), pattern) for pattern in excluded))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--suffixes", default=",".join(SUFFIXES), help="of the files, separated by commas")
    parser.add_argument("--exclude", action="append", default=[], metavar="PATTERN", help="as in */remap/*")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--limit", type=int, default=LIMIT, help="of a file [s]")
    parser.add_argument("--list", action="store_true", help="print the files below each reason, with the whole message")
    options = parser.parse_args()
    files = program_files(options.folders, options.suffixes.split(","), options.exclude)
    with ProcessPoolExecutor(options.processes) as pool:
        outcomes = list(pool.map(partial(outcome, limit=options.limit), files))
    by_reason: dict[str, list[str]] = defaultdict(list)
    for file, text in zip(files, outcomes, strict=True):
        by_reason[reason(text, file)].append(f"{file}: {text}")
    good = len(by_reason.pop(RUNS, []))
    print(f"{good:6} of {len(files)} run")
    for name, cases in sorted(by_reason.items(), key=lambda item: -len(item[1])):
        print(f"{len(cases):6}  {name}")
        for case in cases if options.list else ():
            print(f"{'':8}{case}")


if __name__ == "__main__":
    main()
