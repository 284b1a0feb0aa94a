"""Write the tables of docs/improve.md, and the programs with speeds by place in docs/by-place. Takes three minutes."""

import re
from pathlib import Path

import gantrysim as gs
from gantrysim.job.loading import builtin_jobs
from gantrysim.remedy.bounds import bound_of
from gantrysim.remedy.by_place import SpeedByPlace, write_by_place
from gantrysim.remedy.improvement import Improvement
from gantrysim.remedy.levers import LEVERS
from gantrysim.results.checks import PASS, Row
from gantrysim.results.glue import ploughing_reason
from gantrysim.results.score import row_burden
from gantrysim.results.verdict import GLUE, PATH

PAGE = Path(__file__).parent.parent / "docs" / "improve.md"
PLACE = "(<!-- {} written by scripts/improve_page.py -->\n).*?(<!-- end -->)"
PARTS = PAGE.parent / "by-place"
# jobs with the levers that their machine has; None for all
PART_LEVERS = {
    "an225": None,
    "softmc-helical": None,
    "by-place/gasket.toml": ("flow by speed", "lag compensation", "slower"),
    "by-place/frame.toml": ("flow by speed", "lag compensation", "slower"),
}
PART_HEADS = [
    "part",
    "as it is [s]",
    "everywhere alike [s]",
    "by place [s]",
    "speeds [mm/s]",
    "contour error, 95 % [µm]",
]
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
            f"{lever.cost}; above 1: {lever.cost_above}" if lever.cost_above else lever.cost,
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


def cause_of(result: Improvement, row: Row) -> str:
    """Return what spoils a row that does not pass."""
    if row.name == PATH:
        return path_causes(result.base)
    ploughed = ploughing_reason(row) if row.name == GLUE else ""
    return f"the program link: {ploughed}" if ploughed else bound_of(result.base, row.name)


def caused_by(result: Improvement) -> str:
    """Return what spoils the rows that do not pass, in a phrase for each."""
    return "; ".join(f"{row.name}: {cause_of(result, row)}" for row in result.verdict.rows if row_burden(row))


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


def part_row(name: str) -> list[str]:
    """Write the program of a part with speeds by place, and return its row."""
    job = gs.Job.load(str(PAGE.parent / name) if name.endswith(".toml") else name)
    result = gs.improve(job, levers=PART_LEVERS[name], fastest=False, by_place=True)
    by_place = result.by_place
    assert isinstance(by_place, SpeedByPlace), by_place
    files = write_by_place(by_place, PARTS / f"{job.name}-by-place", job)
    links = ", ".join(f"[`{file.suffix}`](by-place/{file.name})" for file in files)
    speeds = [speed for _, _, speed in by_place.rows]
    before, after, best = (
        next(check.value for check in outcome.verdict["path"].checks if check.name == "path_p95")
        for outcome in (result.before, result.after, by_place.outcome)
    )
    return [
        f"{f'[{job.name}]({name})' if name.endswith('.toml') else f'`{job.name}`'}: {links}",
        f"{result.before.duration:.2f}, {result.verdict.state}",
        f"{result.after.duration:.2f}, {result.improved.state}",
        f"{by_place.outcome.duration:.2f}, {by_place.outcome.state}",
        f"{len(speeds)}, {min(speeds):.3g} to {max(speeds):.3g}",
        f"{before:.1f}, {after:.1f}, {best:.1f}",
    ]


def parts_table() -> str:
    return table(PART_HEADS, [part_row(name) for name in PART_LEVERS])


def jobs_table() -> str:
    rows = [job_row(name) for name in builtin_jobs()]
    passing = sum(row[HEADS.index("after")].endswith(PASS) for row in rows)
    return f"{passing} of {len(rows)} jobs end in a pass.\n\n{table(HEADS, rows)}"


if __name__ == "__main__":
    text = PAGE.read_text(encoding="utf-8")
    for key, content in (("levers", levers_table()), ("parts", parts_table()), ("jobs", jobs_table())):
        place = re.compile(PLACE.format(key), re.DOTALL)
        text = place.sub(lambda match, content=content: f"{match[1]}\n{content}\n\n{match[2]}", text)
    PAGE.write_text(text, encoding="utf-8")
