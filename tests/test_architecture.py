"""The walls of the house: who may import whom, where compiled code lives, how long things are, what is never said."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

from pliant.equations.spring_terms import SPRING_TERMS

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src" / "pliant"
MODULES = sorted(p.relative_to(SOURCE).as_posix() for p in SOURCE.rglob("*.py") if "__pycache__" not in p.parts)
MODULE_LINES, BODY_LINES, PARAMETERS, MOST_DOORS = 450, 40, 8, 10

LONGER: dict[str, str] = {}  # "file" or "file::function" that may be longer than the rest, and why
ALLOCATES = {  # kernels that may make arrays, and why
    "equations/motion.py::acceleration_recursive": "the route to read and to check against, not the one to run",
}
DOORS = {  # functions of more than eight parameters, and why
    "estimation/offline.py::estimate": "a public door: options by keyword",
    "identification/from_recording.py::experiment": "a public door: what is known of a recording, by keyword",
    "preprocessing/align.py::align": "a public door: what is known of the setup, by keyword",
    "recording/schema.py::make_recording": "the one schema: each variable that a recording may have, by keyword",
    "simulation/solve.py::simulate": "a public door: options by keyword",
    "cli/contact.py::contact": "typer makes each option of a command from a parameter",
    "cli/estimate.py::estimate": "typer makes each option of a command from a parameter",
    "cli/order.py::order": "typer makes each option of a command from a parameter",
    "cli/shape.py::shape": "typer makes each option of a command from a parameter",
    "cli/simulate.py::simulate": "typer makes each option of a command from a parameter",
}
PLOTS = {"plotting.py", "validation/figures.py", "validation/use_figures.py"}


@cache
def text(name):
    return (SOURCE / name).read_text(encoding="utf-8")


@cache
def tree(name):
    return ast.parse(text(name))


def lines(name):
    return len(text(name).splitlines())


def is_kernel_file(name):
    return name.startswith("equations/") or name.endswith("loops.py") or name == "numerics/ldl.py"


def may_compile(name):
    return name.endswith("loops.py") or name.startswith(("compiler/", "numerics/"))


def statements(node):
    """What stands directly below a node, its expressions left out."""
    return (n for n in ast.iter_child_nodes(node) if isinstance(n, ast.stmt | ast.excepthandler | ast.match_case))


def imports_below(node):
    if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
        return
    if isinstance(node, ast.Import | ast.ImportFrom):
        yield node
    for child in statements(node):
        yield from imports_below(child)


@cache
def imports(name):
    """The statements by which a file imports when it runs, at its top or inside a function."""
    return list(imports_below(tree(name)))


@cache
def imported(name):
    """Names of the modules that a file imports."""
    found = set()
    for node in imports(name):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif node.module and not node.level:
            found.add(node.module)
    return found


def roots(name):
    return {module.split(".")[0] for module in imported(name)}


@cache
def functions(name):
    """Functions of a file by their qualified names."""
    found = {}

    def enter(node, path):
        for child in statements(node):
            named = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
            inner = f"{path}{child.name}" if named else path
            if named and not isinstance(child, ast.ClassDef):
                found[f"{name}::{inner}"] = child
            enter(child, f"{inner}." if named else path)

    enter(tree(name), "")
    return found


def every_function():
    return {key: function for name in MODULES for key, function in functions(name).items()}


def listed(offenders):
    return "\n" + "\n".join(offenders)


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


def test_compiled_code_lives_in_three_places():
    found = [name for name in MODULES if not may_compile(name) and "numba" in roots(name)]
    assert not found, f"numba belongs in compiler, numerics and files named loops.py: {listed(found)}"


def test_only_few_files_draw():
    found = [name for name in MODULES if name not in PLOTS and "matplotlib" in roots(name)]
    assert not found, f"matplotlib belongs in {' and '.join(sorted(PLOTS))}: {listed(found)}"


MECHANICS = ("equations/", "mechanics/", "exporters/")  # the packages that may spell how a chain moves
OWN_MECHANICS = ("basic.py", "testbed/")  # written apart, to compare with; no line is shared
SPRING_FUNCTIONS = {"spring_torque", "spring_slope", "spring_energy"}
INERTIA_FUNCTIONS = {"inertia_absolute", "body_constants", "inertia_from_jacobians"}
CONSTANT_MAKERS = {"model/inertia.py"}  # the constants of the inertia, which checks of a model need as well


def attributes(node):
    return {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute)}


def names_in(node):
    return {n.id for n in ast.walk(node) if isinstance(n, ast.Name)} | attributes(node)


def of_inertia(node):
    """Whether a node is the constants B of a body: those of a linear model have the same letter."""
    return isinstance(node, ast.Attribute) and node.attr == "B" and ast.unparse(node.value).endswith("body")


def asks_extensions(test):
    """Whether a condition asks if there are extensions at all."""
    parts = test.values if isinstance(test, ast.BoolOp) else [test]
    bare = (part.operand if isinstance(part, ast.UnaryOp) else part for part in parts)
    return any(isinstance(part, ast.Attribute) and part.attr == "extensions" for part in bare)


def spelled(node):
    """What a node spells of link kinematics, springs or inertia, instead of asking the mechanics; "" for nothing."""
    own = SPRING_FUNCTIONS | INERTIA_FUNCTIONS
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in {"sin", "cos"}:
        return "the sine or cosine of a link angle" if "phi" in set().union(*map(names_in, node.args)) else ""
    if isinstance(node, ast.BinOp) and attributes(node) & {*SPRING_TERMS, "hardening"}:
        return "arithmetic on the terms of the springs"
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant) and node.slice.value in SPRING_TERMS:
        return "a term of the springs by its name"
    if isinstance(node, ast.ImportFrom) and {a.name for a in node.names} & own:
        return "the law of the springs or the inertia"
    if isinstance(node, ast.Attribute) and node.attr in own:
        return "the law of the springs or the inertia"
    if isinstance(node, ast.BinOp) and any(map(of_inertia, ast.walk(node))):
        return "arithmetic on the constants of the inertia"
    if isinstance(node, ast.If | ast.IfExp) and asks_extensions(node.test):
        return "a branch on whether the body lengthens"
    return ""


def spelled_mechanics(syntax):
    return [(n.lineno, reason) for n in ast.walk(syntax) if (reason := spelled(n))]


def test_mechanics_is_spelled_once():
    """Who needs a position, a slope, an energy or a kind of coordinates asks `mechanics_of(model)`."""
    apart = (*MECHANICS, *OWN_MECHANICS, *CONSTANT_MAKERS)
    asking = [name for name in MODULES if not name.startswith(apart)]
    found = [f"{name}:{line}: {reason}" for name in asking for line, reason in spelled_mechanics(tree(name))]
    assert not found, listed(found)


@pytest.mark.parametrize("text", [
    "x = np.cos(phi)", "x = np.sin(state.phi[i])", "x = K * model.stiffening", "x = q + joints.hardening[0] * q * q",
    "from pliant.equations.elastic import spring_torque", "M = body.B * c", "x = values['cubic_stiffening']",
    "if model.extensions: pass", "inertia.inertia_absolute(c, s, B, I, M)",
])  # fmt: skip
def test_spelled_mechanics_is_found(text):
    assert spelled_mechanics(ast.parse(text))


MAKERS = {"empty", "zeros", "ones", "full", "empty_like", "zeros_like", "ones_like", "array", "copy"}


def allocations(node):
    return MAKERS & {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute)}


def made_in(key, function):
    """Names of what makes arrays in a kernel, where it may not."""
    if not key.partition("::")[0].endswith("loops.py"):
        return allocations(function)
    loops = [n for n in ast.walk(function) if isinstance(n, ast.For | ast.While)]
    return set().union(*map(allocations, loops))


def test_kernels_stay_plain():
    kernels = [name for name in MODULES if is_kernel_file(name)]
    odd = [name for name in kernels if roots(name) & {"math", "xarray", "pandas"}]
    assert not odd, f"math.sin of a symbol is NaN in silence; kernels take np: {listed(odd)}"
    inside = {key: function for name in kernels for key, function in functions(name).items()}
    made = {key: made_in(key, f) for key, f in inside.items() if key not in ALLOCATES}
    makers = [f"{key}: {sorted(names)}" for key, names in made.items() if names]
    assert not makers, f"the caller owns the arrays; these allocate: {listed(makers)}"
    decorated = [key for key, f in inside.items() if f.decorator_list and key.startswith(("equations/", "numerics/"))]
    assert not decorated, f"the text stays plain, compiler.choose.twin compiles: {listed(decorated)}"


def test_modules_are_short():
    long = [f"{name}: {lines(name)}" for name in MODULES if lines(name) > MODULE_LINES and name not in LONGER]
    assert not long, f"a module has at most {MODULE_LINES} lines: {listed(long)}"


def test_functions_are_short():
    bodies = {key: body_lines(function) for key, function in every_function().items()}
    long = [f"{key}: {count}" for key, count in bodies.items() if count > BODY_LINES and key not in LONGER]
    assert not long, f"a function body has at most {BODY_LINES} lines: {listed(long)}"


def parameters(key, function):
    """How many values a caller may give, without the object or class that a method belongs to."""
    given = [a.arg for a in (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs)]
    return len(given) - (given[:1] in (["self"], ["cls"]))


def test_functions_take_few_parameters():
    many = {key for key, f in every_function().items() if parameters(key, f) > PARAMETERS}
    new = sorted(many - set(DOORS))
    assert not new, f"at most {PARAMETERS} parameters; a NamedTuple carries the rest: {listed(new)}"
    assert len(DOORS) <= MOST_DOORS, "no more exceptions: name a door's options in a TypedDict (pliant.options)"
    gone = sorted(set(DOORS) - many)
    assert not gone, f"these need no exception any more, take them off the list: {listed(gone)}"


def module_name(name):
    return ".".join(("pliant", *Path(name).with_suffix("").parts)).removesuffix(".__init__")


@cache
def edges():
    """Module -> the modules of this package that it imports, those inside functions and for types alone too."""
    known = {module_name(name): name for name in MODULES}
    graph = {}
    for module, name in known.items():
        found = set()
        for node in ast.walk(tree(name)):
            if isinstance(node, ast.ImportFrom) and node.module:
                full = {f"{node.module}.{alias.name}" for alias in node.names}
                found |= {f if f in known else node.module for f in full}
            elif isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
        graph[module] = (found & set(known)) - {module}
    return graph


def test_no_module_imports_itself_by_way_of_others():
    graph, circles = edges(), set()
    for start in graph:
        reached, todo = set(), list(graph[start])
        while todo:
            module = todo.pop()
            if module not in reached:
                reached.add(module)
                todo += graph[module]
        if start in reached:
            circles.add(start)
    assert not circles, f"these modules stand in a circle of imports: {listed(sorted(circles))}"


def room(module):
    return ".".join(module.split(".")[:2])


def hidden(path):
    return any(part.startswith("_") and not part.startswith("__") for part in path.split("."))


def test_rooms_share_public_names_only():
    found = [
        f"{name}: from {node.module} import {alias.name}"
        for name in MODULES
        for node in imports(name)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("pliant")
        for alias in node.names
        if hidden(f"{node.module}.{alias.name}") and room(node.module) != room(module_name(name))
    ]
    assert not found, f"a name with an underscore stays in its room: {listed(found)}"


def test_no_public_class_name_stands_twice():
    files = {}
    for name in MODULES:
        for node in tree(name).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                files.setdefault(node.name, []).append(name)
    assert {name: where for name, where in files.items() if len(where) > 1} == {}


def test_exceptions_still_hold():
    """An exception that nobody needs any more goes."""
    bodies = {key: body_lines(function) for key, function in every_function().items()}
    for key in LONGER:
        assert (bodies[key] > BODY_LINES) if "::" in key else (lines(key) > MODULE_LINES), key
    assert set(ALLOCATES) <= set(bodies)


def test_the_page_of_the_whole_paper_is_one_page():
    assert lines("basic.py") <= 150
    assert not {m for m in imported("basic.py") if m.startswith("pliant")}


HEAVY = ("numba", "scipy", "matplotlib", "xarray", "pandas", "h5py", "rich")
NEEDED_BY_FEW = ("numba", "scipy", "matplotlib", "h5py", "rich")


@pytest.mark.parametrize(("statement", "heavy"), [
    ("import pliant", HEAVY),
    ("import pliant.__main__, pliant.cli", HEAVY),
    ("import pliant.errors, pliant.units", HEAVY),
    ("from pliant.recording import readers; readers()", HEAVY),
    ("import pliant.recording, pliant.simulation, pliant.study", NEEDED_BY_FEW),
])  # fmt: skip
def test_light_doors(statement, heavy):
    """Neither the package nor its command's --help pays for what it may not use, nor a study for what only some do."""
    code = f"import sys; {statement}; print([m for m in {heavy!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.stdout.strip(), done.returncode) == ("[]", 0), done.stderr


def test_the_help_page_draws_no_boxes():
    code = "import sys, pliant.__main__ as p; sys.argv = ['', '--help']\ntry: p.main()\nfinally: print(sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "First steps" in done.stdout
    assert not [name for name in HEAVY if f"'{name}'" in done.stdout]


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


def test_files_of_tests_have_names_of_their_own():
    """Two modules of one name are one to Python: which it is depends on the tests that ran before."""
    helpers = (ROOT / "tests").rglob("*.py")
    files = [p for p in helpers if p.name != "conftest.py" and not (p.parent / "__init__.py").exists()]
    names = Counter(p.name for p in (*files, *(ROOT / "benchmarks").glob("*.py")))
    assert [name for name, count in names.items() if count > 1] == []


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
