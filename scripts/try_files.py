"""Count which program files of a folder gantrysim checks, and why it refuses the others.

    python scripts/try_files.py FOLDER [FOLDER ...] [--exclude PATTERN] [--list]

Every file is loaded and planned as `gantrysim check FILE` does, with nothing else given. The first table counts the
files by their kind, which follows from path and text alone, whether they run or not:

- error test: a word of the path is bad, fail, error or invalid, so that a refusal is expected
- not G-code: fewer than half of its lines are blocks of G-code, or characters outside comments that no controller reads
  (a sender's own format)
- own words: for a machine whose configuration defines words (remap in the path, or G and M codes that are neither
  LinuxCNC's nor a printer's nor FANUC's)
- lathe: lathe in the path, or diameters, threads and lathe cycles (G7, G33, G70 to G72.2, G76)
- NURBS: curves of G5.2 or G6.2
- other axes: a word of A, B, C, U, V or W that is not 0, in a dialect where it moves an axis
- subroutine: without subroutines of its text no word of X, Y or Z is left, nor a call
- ordinary: all others, among them files that need a probe or a subroutine that is missing

The second table lists the reasons for which ordinary files are refused, most frequent first, then those of the other
kinds; numbers and names in a reason are replaced, so that alike ones are counted together.
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
from gantrysim.controllers.fanuc.codes import g_codes
from gantrysim.controllers.gcode.codes import CODES
from gantrysim.job.job import Job
from gantrysim.job.loading import FANUC, LINUXCNC, SLICER, is_gcode, recognised_dialect

SUFFIXES = (".ngc", ".nc", ".gcode", ".g", ".gco", ".cnc", ".tap", ".mpf")
LIMIT = 60  # of the computing time of a file [s]
RUNS = "runs"
WIDEST = 110  # characters of a reason
ORDINARY = "ordinary"
KINDS = (ORDINARY, "NURBS", "other axes", "lathe", "own words", "subroutine", "error test", "not G-code")
COMMENT = re.compile(r"\([^()\n]*\)|;.*")
ERROR_TEST = re.compile(r"(?<![a-z])(?:bad|fail|error|invalid)(?![a-z])")
CODE = re.compile(r"(?<![A-Z_<#])([GM])\s*0*(\d+(?:\.\d)?)(?![\d.])", re.IGNORECASE)
LATHE_CODES = {"G7", "G33", "G70", "G71", "G71.1", "G71.2", "G72", "G72.1", "G72.2", "G76"}
NURBS_CODES = {"G5.2", "G6.2"}
OTHER_AXIS = re.compile(r"(?<![A-Z_<#\[])[ABCUVW]\s*(?:[#\[]|[-+]?(?!0*\.?0*(?![\d.]))[\d.])", re.IGNORECASE)
SUBROUTINE = re.compile(
    r"^\s*O\s*(<[^>\n]*>|\d+)\s*SUB\b.*?^\s*O\s*\1\s*ENDSUB", re.IGNORECASE | re.MULTILINE | re.DOTALL
)
MOVING = re.compile(r"(?<![A-Z_<])[XYZ]\s*[-+]?[\d.#\[]|\bCALL\b|M\s*98|[@^]\s*[-\d.#\[]", re.IGNORECASE)


class _TooSlowError(Exception):
    pass


def outcome(file: Path, limit: int = LIMIT) -> str:
    """Return `RUNS`, or why the check of a file ended without a plan."""
    interrupted = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal interrupted
        interrupted = True
        raise _TooSlowError

    signal.signal(signal.SIGPROF, interrupt)
    signal.setitimer(signal.ITIMER_PROF, limit)
    try:
        Job.load(str(file)).plan()
    except GantryError as error:
        return str(error)
    except Exception as error:  # a crash is what this script looks for
        # compiled code turns the interruption into an error of its own
        return f"not checked within {limit} s" if interrupted else f"CRASH {text_of(error)}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    return RUNS


def reason(text: str, file: Path) -> str:
    """Return a message without the file's name, numbers and quoted names."""
    bare = text.replace(f"{file}: ", "").replace(f"{file.name}: ", "")
    bare = re.sub(r"line \d+( of [^:]*)?: ", "", bare, count=1)
    bare = re.sub(r"'[^']*'", "'..'", bare)
    bare = re.sub(r"subroutines \([^)]*\)", "subroutines (..)", bare)
    return re.sub(r"(?<![A-Za-z])-?\d[\d.]*(e[-+]?\d+)?", "#", bare)[:WIDEST]


def kind_of(file: Path, folder: Path) -> str:
    """Return the kind of a file, as the head of this script defines it."""
    path = str(file.relative_to(folder)).lower()
    text = COMMENT.sub("", file.read_text(errors="replace"))
    if ERROR_TEST.search(path):
        return "error test"
    if not text.isascii() or (not is_gcode(text) and MOVING.search(text)):
        return "not G-code"
    if not is_gcode(text):
        return "subroutine"
    codes = {f"{letter.upper()}{number}" for letter, number in CODE.findall(text)}
    dialect = recognised_dialect(text).controller
    known = {*CODES["LinuxCNC"], *CODES["slicer"], "M98", "M99"}
    if dialect == FANUC:
        known |= {f"G{float(name[1:]):g}" for name in g_codes()}
    if "remap" in path or (dialect in (LINUXCNC, FANUC) and codes - known):
        return "own words"
    if "lathe" in path or codes & LATHE_CODES:
        return "lathe"
    if codes & NURBS_CODES:
        return "NURBS"
    if not MOVING.search(SUBROUTINE.sub("", text)):
        return "subroutine"
    if dialect != SLICER and OTHER_AXIS.search(text):
        return "other axes"
    return ORDINARY


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
    parser.add_argument("--limit", type=int, default=LIMIT, help="of the computing time of a file [s]")
    parser.add_argument("--list", action="store_true", help="print the files below each reason, with the whole message")
    options = parser.parse_args()
    suffixes = options.suffixes.split(",")
    files = {file: folder for folder in options.folders for file in program_files([folder], suffixes, options.exclude)}
    with ProcessPoolExecutor(options.processes) as pool:
        outcomes = list(pool.map(partial(outcome, limit=options.limit), files))
    by_kind: dict[str, list[tuple[Path, str]]] = {kind: [] for kind in KINDS}
    for (file, folder), text in zip(files.items(), outcomes, strict=True):
        by_kind[kind_of(file, folder)].append((file, text))
    for kind, cases in by_kind.items():
        print(f"{sum(text == RUNS for _, text in cases):6} of {len(cases):4} run  {kind}")
    for kind, cases in by_kind.items():
        print_reasons(kind, cases, with_files=options.list)


def print_reasons(kind: str, cases: Iterable[tuple[Path, str]], *, with_files: bool) -> None:
    """Print why files of a kind are refused."""
    by_reason: dict[str, list[str]] = defaultdict(list)
    for file, text in cases:
        if text != RUNS:
            by_reason[reason(text, file)].append(f"{file}: {text}")
    print(f"\n{kind}, refused:")
    for name, refused in sorted(by_reason.items(), key=lambda item: -len(item[1])):
        print(f"{len(refused):6}  {name}")
        for case in refused if with_files else ():
            print(f"{'':8}{case}")


if __name__ == "__main__":
    main()
