"""Folders that come from elsewhere, with hidden files as a killed command leaves them, and what is around them."""

import os
from pathlib import Path

from gantrysim.base.files import NEW, OLD, READY, SWAP


def tree(root):
    """Everything below a folder by its name: the text of a file, the target of a link, or the kind."""
    found = {}
    for where, folders, files in os.walk(root):
        for name in (*folders, *files):
            path = Path(where) / name
            if path.is_symlink():
                kind = path.readlink()
            elif path.is_file():
                kind = path.read_bytes()
            else:
                kind = "folder" if path.is_dir() else "other"
            found[str(path.relative_to(root))] = kind
    return found


def half_done(folder, new=(), old=(), is_ready=True):
    """Write the hidden folder of a command that was killed, with texts by name; once it is ready old ones are away."""
    swap = folder / SWAP
    for part, texts in ((READY if is_ready else NEW, dict(new)), (OLD, dict(old))):
        (swap / part).mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            (swap / part / name).parent.mkdir(parents=True, exist_ok=True)
            (swap / part / name).write_text(text)


def neighbours(root):
    """Make a project that is nobody else's, and beside it a stranger's folder, which is returned."""
    (root / "project" / "deep").mkdir(parents=True)
    (root / "project" / "thesis.txt").write_text("three years of work")
    (root / "project" / "deep" / "data.txt").write_text("measured once")
    (root / "here" / "stranger").mkdir(parents=True)
    return root / "here" / "stranger"
