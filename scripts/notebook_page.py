"""Write docs/start/notebook.md: the notebook of the examples with what its cells print and show."""

import ast
import io
import json
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

from PIL import Image

ROOT = Path(__file__).parent.parent
NOTEBOOK = ROOT / "examples" / "first_run.ipynb"
PAGE = ROOT / "docs" / "start" / "notebook.md"
PICTURES = ROOT / "docs" / "pictures"
WIDTH = 1000  # of a picture [pixels]
NOTE = "`python scripts/notebook_page.py` wrote this page from the notebook `examples/first_run.ipynb`."


def value_of(source: str, names: dict[str, Any]) -> tuple[Any, str]:
    """Run a cell; return the value of its last line, if that is an expression, and what it printed."""
    tree = ast.parse(source)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    printed = io.StringIO()
    with redirect_stdout(printed):
        exec(compile(tree, "cell", "exec"), names)
        value = eval(compile(ast.Expression(last.value), "cell", "eval"), names) if last else None
    return value, printed.getvalue()


def shown(value: Any, picture: Path) -> str:
    """Return a value as a notebook shows it: a picture, which is written, a table in HTML, or its text."""
    if hasattr(value, "_repr_png_"):
        image = Image.open(io.BytesIO(value._repr_png_())).convert("RGB")
        image = image.resize((WIDTH, round(WIDTH * image.height / image.width)), Image.Resampling.LANCZOS)
        image.save(picture, optimize=True)
        return f"![Plan and error budget of the run](../pictures/{picture.name})\n"
    if hasattr(value, "_repr_html_"):
        return f"{value._repr_html_()}\n"
    return f"```text\n{value!r}\n```\n"


def page(folder: Path) -> str:
    """Return the page; its pictures are written into a folder."""
    names: dict[str, Any] = {}
    parts = []
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    for number, cell in enumerate(cells):
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(f"{source}\n")
            continue
        parts.append(f"```python\n{source}\n```\n")
        value, printed = value_of(source, names)
        if printed:
            parts.append(f"```text\n{printed}```\n")
        if value is not None:
            parts.append(shown(value, folder / f"notebook-{number}.png"))
    title, *others = parts
    return "\n".join([title, f"{NOTE}\n", *others])


if __name__ == "__main__":
    PAGE.write_text(page(PICTURES), encoding="utf-8")
