"""Which dialect of G-code a text is in, where the suffix of its file does not decide it."""

from __future__ import annotations

import re
from typing import NamedTuple

LINUXCNC = "linuxcnc.Program"
SLICER = "slicer.Program"
FANUC = "fanuc.Program"
# of files that several controls and senders use for their own dialects; .ngc is LinuxCNC's alone
SHARED_SUFFIXES = (".nc", ".tap", ".gcode", ".g", ".gco", ".cnc", ".txt", ".mpf", ".h", ".gc", ".eia", ".iso", ".ncc")

_COMMENT = re.compile(r"\([^()\n]*\)|;.*")
_LOOKED_AT = 200_000  # characters of a text: a slicer's first layer is longer than its header
_LEAST_SHARE = 0.5  # of the lines that have to be blocks
_BLOCK = re.compile(
    r"^\s*/?\s*(?:N\s*\d+\s*)?(?:(?:[GMTSFXYZIJKRE]\s*[-+]?[\d.]|[XYZIJKRSFE]\s*[#\[]).*|O\s*[\d<].*|(?:WH(?:ILE)?|IF)\s*\[.*|(?:GO(?:TO)?|END?)\s*\d.*|#[\d<].*|%|[$?!~].*)$",
    re.IGNORECASE,
)
_MOTION = re.compile(r"(?<![A-Z])(?:G\s*0*[0-3](?![\d.])|[XYZ]\s*[-+]?[\d.#\[])", re.IGNORECASE)
_O_NUMBER = re.compile(r"\s*O\s*\d{1,8}\s*$", re.IGNORECASE)
_FANUC_WORDS = re.compile(
    r"^\s*/?\s*(?:N\s*\d+\s*)?(?:WH(?:ILE)?\s*\[.*\]\s*DO\s*\d|GO(?:TO)?\s*[\d#\[]|IF\s*\[.*\]\s*(?:GO|TH))",
    re.IGNORECASE | re.MULTILINE,
)
_FANUC_CODES = re.compile(
    r"^\s*/?\s*(?:N\s*\d+\s*)?[^(;\n]*?(?:(?<![A-Z_])G\s*0*(?:50\.1|51\.1|65|68|69)(?![\d.])|,\s*[RC]\s*[\d.#\[])",
    re.IGNORECASE | re.MULTILINE,
)
_FED = re.compile(r"^\s*(?:N\s*\d+\s*)?G\s*\d[^(;\n]*?[\s\d.]E\s*[-+]?[\d.]", re.IGNORECASE | re.MULTILINE)
# M100 to M199 may be a machine's own in LinuxCNC: of them those of heaters alone
_FIRMWARE = re.compile(
    r"^\s*(?:N\s*\d+\s*)?(?:M\s*0*(?:1[78]|8[234]|104|109|140|190|20[1-8]|22[01]|30[0-4]|40[0-2]|42[01]"
    r"|50[0-4]|600|851|90[067]|91[345])(?!\d)|[A-Z]+_[A-Z_]+(?:\s|$))",
    re.IGNORECASE | re.MULTILINE,
)


class Recognised(NamedTuple):
    """The dialect of a text.

    Attributes:
        controller: that reads it.
        reason: in words, as of "as it begins with an O number".
    """

    controller: str
    reason: str


def is_gcode(text: str) -> bool:
    """Return whether most lines of a text, without comments, are blocks of G-code, and one of them a motion."""
    lines = [line for line in _COMMENT.sub("", text[:_LOOKED_AT]).splitlines() if line.strip()]
    blocks = [line for line in lines if _BLOCK.match(line)]
    return len(blocks) > _LEAST_SHARE * len(lines) and any(_MOTION.search(line) for line in blocks)


def recognised_dialect(text: str) -> Recognised:
    """Return the dialect of a text of G-code."""
    head = _COMMENT.sub("", text[:_LOOKED_AT])
    code = [line for line in head.splitlines() if line.strip() and not line.strip().startswith("%")]
    if code and _O_NUMBER.match(code[0]):
        return Recognised(FANUC, "it begins with an O number")
    if _FANUC_WORDS.search(head):
        return Recognised(FANUC, "it has WHILE, IF or GOTO without O words")
    if _FANUC_CODES.search(head):
        return Recognised(FANUC, "it has words of FANUC's alone, as G65, G68, G51.1 or ,R")
    if _FED.search(head):
        return Recognised(SLICER, "its moves feed material by E")
    if _FIRMWARE.search(head):
        return Recognised(SLICER, "it has codes of printers' firmware")
    return Recognised(LINUXCNC, "it has no O number and feeds no material by E")
