"""Random mutants of the package's text, each tried on the quick tests of its subpackage; survivors are printed.

    python benchmarks/mutants.py --count 30 --seed 1 model validation estimation

A mutant changes one operator, comparison, number, sign, condition or statement. Its tests are the quick ones of
`tests/SUBPACKAGE` and all others that import its module by name; those that import it come first, and the first
failure ends the run. Killed means that a test failed or that the time ran out. Nothing in the working tree is changed:
source, tests and compiled kernels are copied to a folder of their own.
"""

from __future__ import annotations

import argparse
import ast
import copy
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

ROOT = Path(__file__).parents[1]
BINARY = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.MatMult: ast.Add,
}
COMPARED = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is,
}
SWAPPED = {"min": "max", "max": "min", "any": "all", "all": "any", "floor": "ceil", "ceil": "floor", "sin": "cos",
           "cos": "sin", "argmax": "argmin", "argmin": "argmax", "mean": "sum", "sum": "mean"}  # fmt: skip
LIMIT = 300.0  # s for the tests of a mutant


class Mutant(NamedTuple):
    """One change of one file."""

    module: str  # as src/pliant/model/limits.py
    start: tuple[int, int]  # line and byte of it
    end: tuple[int, int]
    text: str  # what stands there now

    def apply(self, source: str) -> str:
        """The changed source."""
        lines = source.encode().splitlines(keepends=True)
        (first, a), (last, b) = self.start, self.end
        head, tail = lines[first - 1][:a], lines[last - 1][b:]
        return b"".join([*lines[: first - 1], head + self.text.encode() + tail, *lines[last:]]).decode()

    def told(self, source: str) -> str:
        """The change in words."""
        was = source.encode().splitlines()[self.start[0] - 1].decode().strip()
        return f"{self.module}:{self.start[0]}: {was}  ->  {self.text}"


def changed(node: ast.AST) -> Iterator[ast.AST]:
    """The node with one change of its own."""
    yield from CHANGES.get(type(node), lambda _node: iter(()))(node)


def operated(node: ast.BinOp) -> Iterator[ast.AST]:
    """Plus for minus."""
    if type(node.op) in BINARY and not isinstance(node.left, ast.Constant | ast.List):
        yield ast.BinOp(node.left, BINARY[type(node.op)](), node.right)


def compared(node: ast.Compare) -> Iterator[ast.AST]:
    """At most for less than; the opposite of an order."""
    for k, op in enumerate(node.ops):
        if type(op) not in COMPARED:
            continue
        ops = [COMPARED[type(op)]() if i == k else o for i, o in enumerate(node.ops)]
        yield ast.Compare(node.left, ops, node.comparators)
    if isinstance(node.ops[0], ast.Lt | ast.LtE | ast.Gt | ast.GtE):
        yield ast.UnaryOp(ast.Not(), node)


def joined(node: ast.BoolOp) -> Iterator[ast.AST]:
    """Or for and."""
    yield ast.BoolOp(ast.And() if isinstance(node.op, ast.Or) else ast.Or(), node.values)


def bare(node: ast.UnaryOp) -> Iterator[ast.AST]:
    """Without its sign, or its not."""
    if isinstance(node.op, ast.Not | ast.USub):
        yield node.operand


def chosen_else(node: ast.IfExp) -> Iterator[ast.AST]:
    """The other branch."""
    yield ast.IfExp(ast.UnaryOp(ast.Not(), node.test), node.body, node.orelse)


def moved(node: ast.Constant) -> Iterator[ast.AST]:
    """Another number."""
    if isinstance(node.value, bool):
        yield ast.Constant(not node.value)
    elif isinstance(node.value, int):
        yield ast.Constant(node.value + 1)
    elif isinstance(node.value, float):
        yield ast.Constant(1.5 * node.value or 1.0)


def removed(node: ast.AugAssign | ast.Expr) -> Iterator[ast.AST]:
    """Nothing in place of a statement."""
    if isinstance(node, ast.AugAssign) or isinstance(node.value, ast.Call):
        yield ast.Pass()


def whole(node: ast.Subscript) -> Iterator[ast.AST]:
    """All in place of a slice."""
    if isinstance(node.ctx, ast.Load) and isinstance(node.slice, ast.Slice):
        yield node.value


def renamed(node: ast.Call) -> Iterator[ast.Call]:
    """A call of the opposite function: max for min."""
    function = copy.deepcopy(node.func)
    if isinstance(function, ast.Name) and function.id in SWAPPED:
        function.id = SWAPPED[function.id]
    elif isinstance(function, ast.Attribute) and function.attr in SWAPPED:
        function.attr = SWAPPED[function.attr]
    else:
        return
    yield ast.Call(function, node.args, node.keywords)


CHANGES: dict[type, Callable] = {
    ast.BinOp: operated, ast.Compare: compared, ast.BoolOp: joined, ast.UnaryOp: bare, ast.IfExp: chosen_else,
    ast.Constant: moved, ast.Call: renamed, ast.AugAssign: removed, ast.Expr: removed, ast.Subscript: whole,
}


def mutable(node: ast.AST) -> Iterator[ast.AST]:
    """Nodes whose change is one of behaviour: no annotations, texts, imports for types, or decorators."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_comment") or isinstance(node, ast.JoinedStr):
            continue
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield child
                yield from mutable(child)


def mutants(module: str, source: str) -> list[Mutant]:
    """Every mutant of a file."""
    found = []
    for node in mutable(ast.parse(source)):
        if not hasattr(node, "end_lineno"):
            continue
        for other in changed(node):
            text = ast.unparse(ast.fix_missing_locations(other))
            text = f"({text})" if isinstance(other, ast.expr) else text
            found.append(
                Mutant(module, (node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset), text)
            )
    return found


def drawn(subpackages: list[str], count: int, seed: int) -> list[Mutant]:
    """So many mutants of each subpackage, drawn with a seed, each place of the text with the same chance."""
    rng, chosen = np.random.default_rng(seed), []
    for name in subpackages:
        files = sorted((ROOT / "src" / "pliant" / name).rglob("*.py"))
        every = [m for f in files for m in mutants(str(f.relative_to(ROOT)), f.read_text())]
        picked = rng.choice(len(every), min(count, len(every)), replace=False)
        chosen += [every[k] for k in sorted(picked)]
    return chosen


def imported(path: Path) -> set[str]:
    """Modules and names that a test imports, as pliant.model.limits."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{a.name}" for a in node.names)}
        elif isinstance(node, ast.Import):
            names |= {a.name for a in node.names}
    return names


def tests_of(module: str, root: Path) -> list[str]:
    """Test files for a module in a copy of the tests, those that import it by name first."""
    parts = Path(module).with_suffix("").parts[1:]
    every = [f for f in sorted((root / "tests").rglob("test_*.py")) if "journey" not in f.parts]
    direct = [f for f in every if ".".join(parts) in imported(f)]
    folder = root / "tests" / parts[1]
    beside = [f for f in every if folder in f.parents and f not in direct]
    return [str(f.relative_to(root)) for f in (*sorted(direct, key=lambda f: folder not in f.parents), *beside)]


class Copy:
    """Source, tests and compiled kernels in a folder of their own."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "pliant"
        for name in ("src", "tests"):
            shutil.copytree(ROOT / name, self.root / name, ignore=shutil.ignore_patterns("__pycache__"))
        for name in (p.name for p in ROOT.iterdir() if p.name not in ("src", "tests") and not p.name.startswith(".")):
            (self.root / name).symlink_to(ROOT / name)
        if (ROOT.parent / "shared").exists():
            (folder / "shared").symlink_to((ROOT.parent / "shared").resolve())
        kernels = Path(os.environ.get("NUMBA_CACHE_DIR", Path.home() / ".cache" / "pliant"))
        if kernels.exists():
            shutil.copytree(kernels, folder / "kernels")
        self.environment = {
            **os.environ, "PYTHONPATH": str(self.root / "src"), "NUMBA_CACHE_DIR": str(folder / "kernels"),
            "PYTHONDONTWRITEBYTECODE": "1",
        }

    def run(self, tests: list[str], limit: float) -> str:
        """Passed, killed (with the first failing test), or time ran out."""
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-n0", "-p", "no:randomly", "-p", "no:cacheprovider",
                   "-m", "not slow", "--tb=no", *tests]  # fmt: skip
        try:
            done = subprocess.run(command, cwd=self.root, env=self.environment, capture_output=True, text=True,
                                  timeout=limit, check=False)  # fmt: skip
        except subprocess.TimeoutExpired:
            return "killed: time"
        if done.returncode in (0, 5):  # 5: there is no quick test
            return "passed"
        if done.returncode > 2:
            raise RuntimeError(f"pytest could not run {' '.join(tests)}: {done.stderr[-500:]}")
        failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
        return f"killed: {failed[0][:150] if failed else f'exit code {done.returncode}'}"

    def mutated(self, mutant: Mutant, limit: float) -> str:
        """What the tests say of a mutant."""
        path = self.root / mutant.module
        source = path.read_text()
        try:
            path.write_text(mutant.apply(source))
            return self.run(tests_of(mutant.module, self.root), limit)
        finally:
            path.write_text(source)


def main() -> None:
    """Draw, try, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("subpackages", nargs="+", help="folders of src/pliant")
    parser.add_argument("--count", type=int, default=20, help="mutants of each")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--limit", type=float, default=LIMIT, help="s for the tests of one mutant")
    parser.add_argument("--list", action="store_true", help="only list them")
    wish = parser.parse_args()
    chosen = drawn(wish.subpackages, wish.count, wish.seed)
    if wish.list:
        for mutant in chosen:
            print(mutant.told((ROOT / mutant.module).read_text()))
        return
    tried, killed, sound = Counter[str](), Counter[str](), dict[str, str]()
    with tempfile.TemporaryDirectory() as folder:
        copied = Copy(Path(folder))
        for mutant in chosen:
            if mutant.module not in sound:
                sound[mutant.module] = copied.run(tests_of(mutant.module, copied.root), 2 * wish.limit)
            if sound[mutant.module] != "passed":
                print(f"left out, its tests fail unchanged ({sound[mutant.module]}): {mutant.module}", flush=True)
                continue
            name, began = Path(mutant.module).parts[2], time.perf_counter()
            outcome = copied.mutated(mutant, wish.limit)
            tried[name] += 1
            killed[name] += outcome != "passed"
            told = mutant.told((ROOT / mutant.module).read_text())
            print(f"{outcome if outcome != 'passed' else 'SURVIVED'}\n    {told}  "
                  f"[{time.perf_counter() - began:.0f} s]", flush=True)  # fmt: skip
    print("\n| subpackage | mutants | killed |\n|---|---|---|")
    for name in tried:
        print(f"| {name} | {tried[name]} | {killed[name]} |")
    print(f"| all | {tried.total()} | {killed.total()} |")


if __name__ == "__main__":
    main()
