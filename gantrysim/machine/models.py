"""The file of a machine: built-in, MJCF or table."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from gantrysim.base.errors import InputError, expanded, unknown
from gantrysim.base.input_files import check_regular


def builtin_models() -> list[str]:
    """Return the names of the machines included in gantrysim."""
    names = [item.name for item in files("gantrysim.models").iterdir()]
    return sorted(Path(name).stem for name in names if name.endswith(".xml"))


def model_file(model: str | Path) -> Path:
    """Return the file of a machine.

    Args:
        model: name of a built-in machine, or path of an MJCF file or of a machine's table in TOML.

    Raises:
        InputError: an unknown name, or a path without a regular file.
    """
    text = str(model)
    builtin = builtin_models()
    if text in builtin:
        return Path(str(files("gantrysim.models") / f"{text}.xml"))
    path = expanded(text)
    check_regular(path, f"model {text}")
    if path.is_file():
        return path.resolve()
    if path.suffix or path.parent != Path():
        raise InputError(f"model {text}: no such file; built-in models: {', '.join(builtin)}")
    raise unknown("model", text, builtin)
