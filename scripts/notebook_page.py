"""Write docs/start/notebook.md: the notebook of the examples with what its cells print and show."""

import ast
import base64
import io
import json
import re
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
        return f"{with_files(value._repr_html_(), picture)}\n"
    return f"```text\n{value!r}\n```\n"


def with_files(html: str, picture: Path) -> str:
    """Return HTML whose picture stands in a file: thousands of characters have no place on a page that people edit."""

    def photo(match: re.Match[str]) -> str:
        file = picture.with_suffix(".jpg")
        file.write_bytes(base64.b64decode(match[1]))
        return f'src="../../pictures/{file.name}"'

    def drawing(match: re.Match[str]) -> str:
        file = picture.with_suffix(".svg")
        # a picture of its own has no colour of text
        file.write_text(match[0].replace("currentColor", "#0072b2") + "\n", encoding="utf-8")
        size = " ".join(re.findall(r'(?:width|height)="\d+"', match[0])[:2])
        return f'<img src="../../pictures/{file.name}" alt="{match[1]}" {size}/>'

    html = re.sub(r'src="data:image/jpeg;base64,([^"]*)"', photo, html)
    return re.sub(r'<svg [^>]*aria-label="([^"]*)".*</svg>', drawing, html, flags=re.DOTALL)


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
