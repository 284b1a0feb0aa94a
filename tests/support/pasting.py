"""Lines to paste as a stranger uses them: as options of a command, or in the job's file; and the verdicts compared."""

import shlex
import tomllib

import tomli_w

from gantrysim import Job, Verdict
from gantrysim.job.loading import builtin_jobs, job_text


def checked_values(verdict):
    """Every row of a verdict: its name and state, and of each check the name, state, value and limit."""
    return [
        (row.name, row.state, [(check.name, check.state, check.value, check.limit) for check in row.checks])
        for row in verdict.rows
    ]


def verdict_of(job):
    return Verdict.of(job, job.run())


def with_options(name, text, options=(), **arguments):
    """The job of a name or file with the printed options after the ones that were typed."""
    words = shlex.split(text)
    given = dict(arguments)
    settings = list(options)
    while words:
        option, value, *words = words
        if option == "--set":
            settings.append(value)
        else:
            assert option == "--speed"
            given["speed"] = float(value)
    return Job.load(name, settings, **given)


def merged(content, lines):
    """The content of a job file with printed lines typed into it, a table that is there gets the values."""
    result = dict(content)
    for key, value in lines.items():
        is_table = isinstance(value, dict) and isinstance(result.get(key), dict)
        result[key] = merged(result[key], value) if is_table else value
    return result


def in_job_file(name, text, folder):
    """The job of a file in a folder, with the printed lines; a program file alone has the lines as its job file."""
    lines = tomllib.loads(text)
    content = {}
    if str(name) in builtin_jobs():
        content = tomllib.loads(job_text(name))
    elif str(name).endswith(".toml"):
        content = tomllib.loads(name.read_text())
        if "in place of the whole table" in text:
            del content["program"]
    file = folder / "pasted.toml"
    file.write_text(tomli_w.dumps(merged(content, lines)))
    return Job.load(file)
