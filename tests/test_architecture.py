"""The walls of the house: who may import whom, where compiled code lives, how long things are, what is never said."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src" / "pliant"
MODULES = sorted(p.relative_to(SOURCE).as_posix() for p in SOURCE.rglob("*.py") if "__pycache__" not in p.parts)
TREES = {name: ast.parse((SOURCE / name).read_text(encoding="utf-8")) for name in MODULES}
MODULE_LINES, BODY_LINES = 300, 40

LONGER = {  # "file" or "file::function" that may be longer than the rest, and why
    "recording/schema.py": "the one schema: its variables, their units and every check of them on one page",
}
ALLOCATES = {  # kernels that may make arrays, and why
    "equations/motion.py::acceleration_recursive": "the route to read and to check against, not the one to run",
}
PLOTS = {"plotting.py", "validation/figures.py"}


def is_kernel_file(name):
    return name.startswith("equations/") or name.endswith("loops.py") or name == "numerics/ldl.py"


def may_compile(name):
    return name.endswith("loops.py") or name.startswith(("compiler/", "numerics/"))


def imported(node):
    """Names of the modules that a tree imports when it runs, at its top or inside a function."""
    if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
        return
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
        yield node.module
    for child in ast.iter_child_nodes(node):
        yield from imported(child)


def roots(name):
    return {module.split(".")[0] for module in imported(TREES[name])}


def functions(tree):
    return [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)]


def body_lines(function):
    """Lines of a function from its first statement behind the docstring to its last."""
    body = function.body[1:] if ast.get_docstring(function) is not None else function.body
    return body[-1].end_lineno - body[0].lineno + 1 if body else 0


def test_data_moves_one_way():
    tool = Path(sys.executable).with_name("lint-imports")
    if not tool.exists():
        pytest.skip("import-linter is not installed beside this Python; pip install -e '.[dev]'")
    done = subprocess.run([tool, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]


@pytest.mark.parametrize("name", [name for name in MODULES if not may_compile(name)])
def test_compiled_code_lives_in_three_places(name):
    assert "numba" not in roots(name), "numba belongs in compiler, numerics and files named loops.py"


@pytest.mark.parametrize("name", [name for name in MODULES if name not in PLOTS])
def test_only_two_files_draw(name):
    assert "matplotlib" not in roots(name), f"matplotlib belongs in {' and '.join(sorted(PLOTS))}"


MAKERS = {"empty", "zeros", "ones", "full", "empty_like", "zeros_like", "ones_like", "array", "copy"}


def allocations(node):
    return MAKERS & {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute)}


@pytest.mark.parametrize("name", [name for name in MODULES if is_kernel_file(name)])
def test_kernels_stay_plain(name):
    assert not roots(name) & {"math", "xarray", "pandas"}, "math.sin of a symbol is NaN in silence; kernels take np"
    for function in functions(TREES[name]):
        loops = [n for n in ast.walk(function) if isinstance(n, ast.For | ast.While)]
        made = set().union(*map(allocations, loops)) if name.endswith("loops.py") else allocations(function)
        allowed = f"{name}::{function.name}" in ALLOCATES
        assert allowed or not made, f"{function.name} allocates with {sorted(made)}: the caller owns the arrays"
        if name.startswith(("equations/", "numerics/")):
            assert not function.decorator_list, f"{function.name}: the text stays plain, compiler.choose.twin compiles"


@pytest.mark.parametrize("name", MODULES)
def test_modules_are_short(name):
    lines = len((SOURCE / name).read_text(encoding="utf-8").splitlines())
    assert lines <= MODULE_LINES or name in LONGER, f"{lines} lines; a module has at most {MODULE_LINES}"


@pytest.mark.parametrize("name", MODULES)
def test_functions_are_short(name):
    long = {f"{name}::{f.name}": body_lines(f) for f in functions(TREES[name]) if body_lines(f) > BODY_LINES}
    assert set(long) <= set(LONGER), f"a function body has at most {BODY_LINES} lines: {long}"


def test_exceptions_still_hold():
    """An exception that nobody needs any more goes."""
    bodies = {f"{name}::{f.name}": body_lines(f) for name in MODULES for f in functions(TREES[name])}
    for key in LONGER:
        if "::" in key:
            assert bodies[key] > BODY_LINES, key
        else:
            assert len((SOURCE / key).read_text(encoding="utf-8").splitlines()) > MODULE_LINES, key
    assert set(ALLOCATES) <= set(bodies)


def test_the_page_of_the_whole_paper_is_one_page():
    assert len((SOURCE / "basic.py").read_text(encoding="utf-8").splitlines()) <= 150
    assert not {m for m in imported(TREES["basic.py"]) if m.startswith("pliant")}


@pytest.mark.parametrize("statement", ["import pliant", "import pliant.__main__", "import pliant.errors, pliant.units"])
def test_light_doors(statement):
    """Neither the package nor its command's --help pays for what it may not use."""
    heavy = ("numba", "scipy", "matplotlib", "xarray", "pandas", "h5py")
    code = f"import sys; {statement}; print([m for m in {heavy!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.stdout.strip(), done.returncode) == ("[]", 0), done.stderr


def tracked():
    git = shutil.which("git")
    if git is None or not (ROOT / ".git").exists():
        pytest.skip("not a git checkout: which files are tracked is not known")
    listed = subprocess.run([git, "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [ROOT / name for name in listed.split("\0") if name and (ROOT / name).is_file()]


def text_of(path):
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return ""


def test_no_machine_is_named():
    """Paths of one machine, and hosts of package registries, have no place in what others check out."""
    machine = re.compile(r"(?<![\w.~/])/(?:" + "work|home|root|Users|mnt" + r")/\w")
    registry = re.compile("|".join([r"pypi\.o" + "rg", "python" + "hosted", "arti" + "factory", "index" + "-url"]))
    found = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()[:80]}"
        for path in tracked()
        for number, line in enumerate(text_of(path).splitlines(), 1)
        if machine.search(line) or registry.search(line)
    ]
    assert not found, "\n".join(found)
