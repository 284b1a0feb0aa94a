"""The files of a program with speeds by place: a job, and the program for the controller."""

from __future__ import annotations

from pathlib import Path

from gantrysim.base.errors import InputError
from gantrysim.base.files import replaced_file
from gantrysim.job.job import Job
from gantrysim.remedy.by_place import SpeedByPlace

BY_PLACE = "by-place"  # end of the names


def write_by_place(by_place: SpeedByPlace, stem: Path, base: Job) -> list[Path]:
    """Write STEM.toml, for `gantrysim run`, and the program in the controller's language where it has one.

    Args:
        by_place: the program.
        stem: path of the files without their suffixes.
        base: the job as it was loaded, whose files stay.

    Returns:
        The paths, that of the job first.

    Raises:
        InputError: one of them is the file from which the job was loaded.
    """
    job = by_place.job
    contents = {stem.with_name(f"{stem.name}.toml"): job.toml()}
    text = job.controller.program_text
    if text:
        contents[stem.with_name(f"{stem.name}{_suffix(base)}")] = text
    for path in contents:
        if path.exists() and any(file.exists() and path.samefile(file) for file in _files_of(base)):
            raise InputError(f"{path}: is a file of the job; give another name")
    for path, content in contents.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        with replaced_file(path) as partial:
            partial.write_text(content, encoding="utf-8")
    return list(contents)


def _files_of(job: Job) -> list[Path]:
    """Return the files from which a job was loaded: its own, and that of its program."""
    if job.given is None:
        return []
    file = Path(job.given.label.removeprefix("job "))
    source = job.given.file.get("source")
    return [file] if source is None else [file, file.parent / str(source)]


def _suffix(base: Job) -> str:
    """Return the suffix of the program's own file, else one that its controller reads."""
    suffix = Path(base.given.program_file).suffix if base.given is not None and base.given.program_file else ""
    return suffix or base.controller.program_suffix
