"""Write the tables of docs/improve.md: the levers, and what to change in every built-in job. Takes two minutes."""

import re
from pathlib import Path

import gantrysim as gs
from gantrysim.job.loading import builtin_jobs
from gantrysim.remedy.by_place import SpeedByPlace
from gantrysim.remedy.improvement import Improvement, bound_of
from gantrysim.remedy.levers import LEVERS
from gantrysim.results.checks import PASS
from gantrysim.results.row import Row
from gantrysim.results.score import row_burden

PAGE = Path(__file__).parent.parent / "docs" / "improve.md"
PLACE = "(<!-- {} written by scripts/improve_page.py -->\n).*?(<!-- end -->)"
EFFORTS = ("a setting", "process", "hardware")
MOST_CAUSES = 2
LEAST_WORTH = 0.1  # of the contour error
HEADS = ["job", "before", "caused by", "what to change", "after", "time [s]", "by place [s]"]


def line(cells: list[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def table(heads: list[str], rows: list[list[str]]) -> str:
    """Return a table in Markdown."""
    return "\n".join([line(heads), "|" + " --- |" * len(heads), *map(line, rows)])


def levers_table() -> str:
    rows = [
        [
            lever.name,
            lever.meaning,
            lever.cost,
            EFFORTS[lever.effort],
            ", ".join(lever.rows),
            ", ".join(lever.causes) or "any",
        ]
        for lever in LEVERS
    ]
    return table(["lever", "what it changes", "cost", "takes", "acts on", "against"], rows)


def worst_value(row: Row) -> str:
    """Return the worst value of a row in a phrase."""
    head = f"{row.symbol} {row.name}"
    if not row.checks:
        return f"{head}: {row.remark}"
    check = row.checks[0]
    return f"{head}: {check.quantity} {check.value:z{check.form}} {check.unit}".strip()


def path_causes(job: gs.Job) -> str:
    """Return the largest causes of the contour error in a phrase."""
    causes = gs.causes_of(job)
    rms = causes.errors["contour"].rms
    worths = {effect.cause.name: effect.worth["contour"].rms for effect in causes.effects if effect.worth}
    largest = sorted(worths, key=lambda name: -worths[name])[:MOST_CAUSES]
    shares = [f"{name} {1e3 * worths[name]:.0f} µm" for name in largest if worths[name] > LEAST_WORTH * rms]
    return f"{', '.join(shares)} of {1e3 * rms:.0f} µm rms"


def caused_by(result: Improvement) -> str:
    """Return what spoils the rows that do not pass, in a phrase for each."""
    phrases = []
    for row in result.verdict.rows:
        if row_burden(row):
            cause = path_causes(result.base) if row.name == "path" else bound_of(result.base, result.before, row.name)
            phrases.append(f"{row.name}: {cause}")
    return "; ".join(phrases)


def by_place_time(result: Improvement) -> str:
    """Return the time with a speed for each stretch, and the number of speeds; a dash where none was looked for."""
    by_place = result.by_place
    if isinstance(by_place, SpeedByPlace):
        return f"{by_place.outcome.duration:.1f}, {by_place.changes} speeds"
    return "–" if by_place is None else by_place


def job_row(name: str) -> list[str]:
    """Return the row of a built-in job."""
    result = gs.improve(gs.Job.load(name), fastest=False)
    worst = [worst_value(row) for row in result.verdict.rows if row_burden(row)]
    options = result.lines.get("command line", "")
    return [
        f"`{name}`",
        "; ".join(worst) or result.verdict.headline,
        caused_by(result),
        f"{result.sentence}{f' `{options}`' if options else ''}",
        result.improved.headline,
        f"{result.before.duration:.1f} → {result.after.duration:.1f}",
        by_place_time(result),
    ]


def jobs_table() -> str:
    rows = [job_row(name) for name in builtin_jobs()]
    passing = sum(row[HEADS.index("after")].endswith(PASS) for row in rows)
    return f"{passing} of {len(rows)} jobs end in a pass.\n\n{table(HEADS, rows)}"


if __name__ == "__main__":
    text = PAGE.read_text(encoding="utf-8")
    for key, content in (("levers", levers_table()), ("jobs", jobs_table())):
        place = re.compile(PLACE.format(key), re.DOTALL)
        text = place.sub(lambda match, content=content: f"{match[1]}\n{content}\n\n{match[2]}", text)
    PAGE.write_text(text, encoding="utf-8")
