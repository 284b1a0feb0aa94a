"""Packages of the extras: nothing else needs them, and where they are missing one line says what to install."""

import ast
import re
import sys
import tomllib
from pathlib import Path

import pytest

from gantrysim.base.errors import InputError
from gantrysim.base.extras import MissingPackageError, extra
from gantrysim.job.loading import builtin_jobs

from support.syntax import nodes_of, tree_of

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
IMPORTED = {"distributed": "dask", "pil": "pillow"}  # packages that are imported by another name
WITH = {"llvmlite": "numba", "markupsafe": "jinja2"}  # parts of a package, installed with it
# modules that import packages of an extra at their top, and are themselves imported for that purpose alone
WHOLE = {
    "engine/device.py": "cuda",
    "env": "learning",
    "live": "live",
    "report/notebook.py": "notebook",
    "study/cluster.py": "dask",
}
GIGABYTES = {"cuda"}  # extras that are asked for by their names alone
SHORT = ("--set", "turns=1", "--set", "loop_period=0.005", "--no-causes", "--no-improve")
SVG = """<svg xmlns="http://www.w3.org/2000/svg" width="50mm" height="50mm" viewBox="0 0 50 50">
<path d="M 5 5 L 45 5" stroke="red"/></svg>"""
DXF = "0\nSECTION\n2\nENTITIES\n0\nLINE\n8\n0\n10\n5\n20\n5\n11\n45\n21\n5\n0\nENDSEC\n0\nEOF\n"
POINTS = "x, y\n0, 0\n40, 0\n40, 30\n"


def distribution(requirement):
    """The normalised name of the package that a requirement, or an import, names."""
    name = re.match(r"[\w.-]+", requirement)[0].lower().replace("_", "-")
    return IMPORTED.get(name, name)


CORE = {distribution(requirement) for requirement in PROJECT["dependencies"]}
EXTRAS = {
    name: {distribution(requirement) for requirement in requirements}
    for name, requirements in PROJECT["optional-dependencies"].items()
    if name != "all"
}
EXTRAS["rl"] |= EXTRAS["learning"]  # gantrysim[learning]
OPTIONAL = set().union(*EXTRAS.values()) - CORE - {"gantrysim"}
MODULES = sorted({name.replace("-", "_") for name in OPTIONAL} | {"distributed"})
BLOCKED = f"import sys\nsys.modules.update(dict.fromkeys({MODULES}))\n"


class Imports(ast.NodeVisitor):
    """The packages that a file imports, each with the extra in whose block that is, None outside of any."""

    def __init__(self):
        self.imported = set()
        self.extra = None

    def visit(self, node):
        # an expression holds no import
        if not isinstance(node, ast.expr):
            super().visit(node)

    def visit_Import(self, node):
        self.imported |= {(alias.name.partition(".")[0], self.extra) for alias in node.names}

    def visit_ImportFrom(self, node):
        if node.level == 0:
            self.imported.add((node.module.partition(".")[0], self.extra))

    def visit_If(self, node):
        if ast.unparse(node.test) != "TYPE_CHECKING":
            self.generic_visit(node)

    def visit_With(self, node):
        calls = [item.context_expr for item in node.items if isinstance(item.context_expr, ast.Call)]
        names = [call.args[0].value for call in calls if ast.unparse(call.func) == "extra"]
        outer = self.extra
        self.extra = names[0] if names else outer
        self.generic_visit(node)
        self.extra = outer


def imports_of(file):
    """The distributions that a file imports, with the extra that the import names."""
    visitor = Imports()
    visitor.visit(tree_of(file.read_text(encoding="utf-8")))
    return {
        (distribution(package), name)
        for package, name in visitor.imported
        if package not in sys.stdlib_module_names and package != "gantrysim"
    }


def test_every_import_is_of_a_package_that_its_installation_holds():
    undeclared = set()
    used = set()
    for file in (ROOT / "gantrysim").rglob("*.py"):
        name = file.relative_to(ROOT / "gantrysim").as_posix()
        whole = next((extra for start, extra in WHOLE.items() if name.startswith(start)), None)
        for package, stated in imports_of(file):
            used.add(package)
            if WITH.get(package, package) not in CORE and package not in EXTRAS.get(stated or whole, ()):
                # parts of a reader that is open: `with extra` stands where the reading begins
                undeclared.add((name, package, stated))
    assert undeclared <= {
        ("controllers/drawings/dxf.py", "ezdxf", None),
        ("controllers/drawings/svg.py", "svgelements", None),
        ("render/encoding.py", "imageio-ffmpeg", None),
    }
    assert used >= CORE - {"gantrysim"}


def test_what_needs_an_extra_names_one_that_there_is_and_the_purpose_after_it():
    """`with extra("tables", "Bead.to_frame")`: the words are not exchanged, whose message is seen by few."""
    calls = [
        (file.name, node.args[0].value, ast.unparse(node.args[1]))
        for file in (ROOT / "gantrysim").rglob("*.py")
        if "extra(" in (text := file.read_text(encoding="utf-8"))
        for node in nodes_of(text)
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "extra"
    ]
    assert len(calls) > 8
    assert [call for call in calls if call[1] not in EXTRAS or call[2].strip("'") in EXTRAS] == []


def test_all_installs_every_extra_but_those_of_gigabytes():
    (everything,) = PROJECT["optional-dependencies"]["all"]
    assert set(re.search(r"\[(.*)\]", everything)[1].split(",")) == set(EXTRAS) - GIGABYTES


def test_every_module_is_imported_without_the_extras(fresh, tmp_path):
    modules = [
        ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for file in sorted((ROOT / "gantrysim").rglob("*.py"))
        if not any(file.relative_to(ROOT / "gantrysim").as_posix().startswith(start) for start in WHOLE)
    ]
    assert len(modules) > 500
    assert {"ezdxf", "gymnasium", "imageio_ffmpeg", "pandas", "svgelements"} <= set(MODULES)
    done = fresh.run(
        f"{BLOCKED}from importlib import import_module\nfor name in sys.argv[1:]: import_module(name)",
        tmp_path,
        *(module for module in modules if module != "gantrysim.__main__"),
    )
    assert done == (0, "", "")


def test_a_job_imports_its_own_controller_alone(fresh, tmp_path):
    """All controllers together take as long to import as a job takes to run."""
    names = "name for name in sys.modules if name.startswith('gantrysim.controllers.')"
    code = f"import sys, gantrysim\ngantrysim.Job.load('an225').setpoints\nprint(*sorted({names}))"
    done = fresh.run(code, tmp_path)
    rooms = {name.split(".")[2] for name in done.output.split()}
    assert rooms == {"controller", "loop_theory", "speeds", "trio"}, done.error
    assert "gantrysim.controllers.trio.basic" not in done.output.split()


def test_every_built_in_job_but_the_drawing_is_loaded_without_the_extras(fresh, tmp_path):
    code = """
import gantrysim as gs
for name in sys.argv[1:]:
    try:
        gs.Job.load(name)
    except gs.InputError as error:
        print(error)
"""
    done = fresh.run(BLOCKED + code, tmp_path, *builtin_jobs())
    said = 'job svg-gasket: svg: svgelements is not installed: pip install "gantrysim[drawings]"\n'
    assert done == (0, said, "")


@pytest.mark.parametrize(
    ("name", "package", "install"),
    [
        ("gs.env.BeadWidthEnv", "gymnasium", "learning"),
        ("import_module('gantrysim.env.sb3')", "stable_baselines3", "rl"),
    ],
)
def test_an_environment_without_its_library_says_what_to_install(fresh, tmp_path, name, package, install):
    code = f"""
from importlib import import_module
import gantrysim as gs
try:
    {name}
except gs.InputError as error:
    print(isinstance(error, ImportError), error)
"""
    done = fresh.run(f"import sys\nsys.modules[{package!r}] = None\n{code}", tmp_path)
    assert done.error == ""
    assert done.output.startswith("True gantrysim.env")
    assert done.output.endswith(f': {package} is not installed: pip install "gantrysim[{install}]"\n')


def test_a_view_in_a_notebook_says_what_to_install(fresh, tmp_path):
    code = """
import sys
sys.modules["anywidget"] = None
import gantrysim as gs
try:
    gs.Run.view(None)
except gs.InputError as error:
    print(isinstance(error, ImportError), error)
"""
    said = 'True run.view: anywidget is not installed: pip install "gantrysim[notebook]"\n'
    assert fresh.run(code, tmp_path) == (0, said, "")


@pytest.mark.parametrize(
    ("file", "text", "package"),
    [("part.svg", SVG, "svgelements"), ("part.dxf", DXF, "ezdxf"), ("part.csv", POINTS, None)],
)
def test_a_drawing_without_its_library_ends_in_one_line(gantrysim_command, tmp_path, monkeypatch, file, text, package):
    for name in ("svgelements", "ezdxf"):
        monkeypatch.setitem(sys.modules, name, None)
    (tmp_path / file).write_text(text)
    status, _, errors = gantrysim_command("check", tmp_path / file)
    if package is None:
        assert (status, errors) == (0, "")
        return
    said = f'{file[5:8]}: {package} is not installed: pip install "gantrysim[drawings]"'
    assert (status, errors) == (2, f"error: {tmp_path / file}: {said}\n")


def test_layers_of_points_need_no_library_of_drawings(monkeypatch):
    from gantrysim.controllers.drawings import Drawing

    monkeypatch.setitem(sys.modules, "svgelements", None)
    with pytest.raises(InputError, match="unknown layers: layer or colour 'red'"):
        Drawing(text=POINTS, speed=50.0, layers=["red"])


def test_without_an_encoder_a_run_goes_on_and_a_film_is_refused(gantrysim_command, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    said = 'no encoder: imageio_ffmpeg is not installed: pip install "gantrysim[film]"\n'
    status, printed, errors = gantrysim_command("run", "an225", "--out", tmp_path / "out", *SHORT, "--no-report")
    assert (status, errors) == (0, f"no video: {said}")
    assert "Contour error: " in printed
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == ["job.toml", "run.npz", "summary.json"]
    assert gantrysim_command("render", tmp_path / "out", "--size", "300x200") == (2, "", f"error: {said}")


def test_the_jobs_are_listed_without_the_extras(gantrysim_command, monkeypatch):
    monkeypatch.setitem(sys.modules, "svgelements", None)
    status, printed, errors = gantrysim_command("info", "jobs")
    assert (status, errors) == (0, "")
    assert all(name in printed for name in builtin_jobs())


def importing(error, *arguments):
    """Raise an error of an import inside the block of an extra."""
    with extra(*arguments):
        raise error


def test_a_package_that_is_there_but_broken_is_named_with_its_reason():
    install = r'pip install "gantrysim\[drawings\]"$'
    with pytest.raises(MissingPackageError, match=f"^dxf: ImportError: no libfoo: {install}"):
        importing(ImportError("no libfoo"), "drawings", "dxf")


def test_the_message_names_an_alternative():
    error = ModuleNotFoundError("No module named 'mcap'", name="mcap.writer")
    text = r'^--format mcap: mcap is not installed: pip install "gantrysim\[tables\]", or choose csv$'
    with pytest.raises(MissingPackageError, match=text):
        importing(error, "tables", "--format mcap", "or choose csv")
