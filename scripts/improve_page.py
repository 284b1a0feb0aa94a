"""Write the tables of docs/improve.md: the levers, and what to change in every built-in job. Takes some minutes."""

import re
from pathlib import Path

import gantrysim as gs
from gantrysim.job.loading import builtin_jobs
from gantrysim.remedy.bound import bound_of
from gantrysim.remedy.improvement import Improvement
from gantrysim.remedy.levers import LEVERS
from gantrysim.remedy.score import row_burden
from gantrysim.results.row import Row

PAGE = Path(__file__).parent.parent / "docs" / "improve.md"
PLACE = "(<!-- {} written by scripts/improve_page.py -->\n).*?(<!-- end -->)"
EFFORTS = ("a setting", "process", "hardware")
MOST_CAUSES = 2


def table(heads: list[str], rows: list[list[str]]) -> str:
    """Return a table in Markdown."""
    lines = [heads, [" --- "] * len(heads), *rows]
    return "\n".join("|".join(["", *(f" {cell.replace('|', chr(92) + '|')} " for cell in line), ""]) for line in lines)


def levers() -> str:
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


def causes(result: Improvement) -> str:
    """Return what spoils the rows that do not pass, in a phrase."""
    phrases = []
    for row in result.verdict.rows:
        if not row_burden(row):
            continue
        if row.name != "path":
            phrases.append(f"{row.name}: {bound_of(result.base, result.before, row.name)}")
            continue
        found = gs.causes_of(result.base)
        worths = {effect.cause.name: effect.worth["contour"].rms for effect in found.effects if effect.worth}
        largest = sorted(worths, key=lambda name: -worths[name])[:MOST_CAUSES]
        rms = found.errors["contour"].rms
        shares = [f"{name} {1e3 * worths[name]:.0f} µm" for name in largest if worths[name] > 0.1 * rms]
        phrases.append(f"path: {', '.join(shares)} of {1e3 * rms:.0f} µm rms")
    return "; ".join(phrases)


def jobs() -> str:
    rows = []
    passing = 0
    for name in builtin_jobs():
        result = gs.improve(gs.Job.load(name))
        passing += result.improved.state == "pass"
        worst = [before(row) for row in result.verdict.rows if row_burden(row)]
        options = result.lines.get("command line", "")
        rows.append(
            [
                f"`{name}`",
                "; ".join(worst) or result.verdict.headline,
                causes(result),
                f"{result.sentence}{f' `{options}`' if options else ''}",
                result.improved.headline,
                f"{result.before.duration:.1f} → {result.after.duration:.1f}",
            ]
        )
        print(name, result.sentence, flush=True)
    heads = ["job", "before", "caused by", "what to change", "after", "time [s]"]
    return f"{passing} of {len(rows)} jobs end in a pass.\n\n{table(heads, rows)}"


def before(row: Row) -> str:
    """Return the worst value of a row in a phrase."""
    head = f"{row.symbol} {row.state} {row.name}"
    if not row.checks:
        return f"{head}: {row.remark}"
    check = row.checks[0]
    return f"{head}: {check.quantity} {check.value:z{check.form}} {check.unit}".strip()


if __name__ == "__main__":
    text = PAGE.read_text(encoding="utf-8")
    for key, content in (("levers", levers()), ("jobs", jobs())):
        place = re.compile(PLACE.format(key), re.DOTALL)
        text = place.sub(lambda match, content=content: f"{match[1]}\n{content}\n\n{match[2]}", text)
    PAGE.write_text(text, encoding="utf-8")
