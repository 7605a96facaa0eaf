"""Change the code of the package at random, run the quick tests that execute each change, and print unnoticed changes.

    python tests/mutation/mutants.py --count 34 --seed 1 model validation estimation batch preprocessing video

A mutant changes one operator, comparison, number, sign, condition or statement. The program first records which quick
tests execute which line; the record takes as long as the tests, and is kept while neither source nor tests change. The
tests that execute a mutant run in order of their time, until one fails or they have taken `--budget` seconds. A mutant
is killed if a test fails or if the time runs out. The tests that killed mutants run at the end on the unchanged code,
where none may fail.
"""

from __future__ import annotations

import argparse
import ast
import copy
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from executed_lines import Executed
from quick_tests import ROOT, Copy, imported, kept_record

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


class Mutant(NamedTuple):
    """One change of one file."""

    module: str  # as src/pliant/model/quantity.py
    start: tuple[int, int]  # line and byte of it
    end: tuple[int, int]
    text: str  # what stands there now

    def apply(self, source: str) -> str:
        """Return the changed source."""
        lines = source.encode().splitlines(keepends=True)
        (first, a), (last, b) = self.start, self.end
        head, tail = lines[first - 1][:a], lines[last - 1][b:]
        return b"".join([*lines[: first - 1], head + self.text.encode() + tail, *lines[last:]]).decode()

    def told(self, source: str) -> str:
        """Return the change in words."""
        was = source.encode().splitlines()[self.start[0] - 1].decode().strip()
        return f"{self.module}:{self.start[0]}: {was}  ->  {self.text}"


def changed(node: ast.AST) -> Iterator[ast.AST]:
    """Return the node with one change."""
    yield from CHANGES.get(type(node), lambda _node: iter(()))(node)


def operated(node: ast.BinOp) -> Iterator[ast.AST]:
    """Replace an arithmetic operator, such as plus by minus."""
    if type(node.op) in BINARY and not isinstance(node.left, ast.Constant | ast.List):
        yield ast.BinOp(node.left, BINARY[type(node.op)](), node.right)


def compared(node: ast.Compare) -> Iterator[ast.AST]:
    """Replace a comparison, such as less than by at most, or by the opposite order."""
    for k, op in enumerate(node.ops):
        if type(op) not in COMPARED:
            continue
        ops = [COMPARED[type(op)]() if i == k else o for i, o in enumerate(node.ops)]
        yield ast.Compare(node.left, ops, node.comparators)
    if isinstance(node.ops[0], ast.Lt | ast.LtE | ast.Gt | ast.GtE):
        yield ast.UnaryOp(ast.Not(), node)


def joined(node: ast.BoolOp) -> Iterator[ast.AST]:
    """Replace `and` by `or`, and the reverse."""
    yield ast.BoolOp(ast.And() if isinstance(node.op, ast.Or) else ast.Or(), node.values)


def bare(node: ast.UnaryOp) -> Iterator[ast.AST]:
    """Remove the sign or the `not`."""
    if isinstance(node.op, ast.Not | ast.USub):
        yield node.operand


def chosen_else(node: ast.IfExp) -> Iterator[ast.AST]:
    """Exchange the two branches of a condition."""
    yield ast.IfExp(ast.UnaryOp(ast.Not(), node.test), node.body, node.orelse)


def moved(node: ast.Constant) -> Iterator[ast.AST]:
    """Replace a number by another one."""
    if isinstance(node.value, bool):
        yield ast.Constant(not node.value)
    elif isinstance(node.value, int):
        yield ast.Constant(node.value + 1)
    elif isinstance(node.value, float):
        yield ast.Constant(1.5 * node.value or 1.0)


def removed(node: ast.AugAssign | ast.Expr) -> Iterator[ast.AST]:
    """Remove a statement."""
    if isinstance(node, ast.AugAssign) or isinstance(node.value, ast.Call):
        yield ast.Pass()


def whole(node: ast.Subscript) -> Iterator[ast.AST]:
    """Replace a slice by all elements."""
    if isinstance(node.ctx, ast.Load) and isinstance(node.slice, ast.Slice):
        yield node.value


def renamed(node: ast.Call) -> Iterator[ast.Call]:
    """Replace a function by its opposite, such as min by max."""
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
    """Return nodes whose change affects behaviour: no annotations, texts, imports for types, or decorators.

    Nor the `strict` of a zip, which only guards against lengths that differ where none do.
    """
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_comment") or isinstance(node, ast.JoinedStr):
            continue
        if isinstance(node, ast.keyword) and node.arg == "strict":
            continue
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield child
                yield from mutable(child)


def mutants(module: str, source: str) -> list[Mutant]:
    """Return every mutant of a file."""
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
    """Draw mutants of each subpackage with a seed; each position in the text has the same probability."""
    rng, chosen = np.random.default_rng(seed), []
    for name in subpackages:
        files = sorted((ROOT / "src" / "pliant" / name).rglob("*.py"))
        every = [m for f in files for m in mutants(str(f.relative_to(ROOT)), f.read_text())]
        picked = rng.choice(len(every), min(count, len(every)), replace=False)
        chosen += [every[k] for k in sorted(picked)]
    return chosen


def statement(tree: ast.Module, line: int) -> tuple[range, set[str]]:
    """Return the lines of the statement around a line (the head of a compound one), and names defined at import.

    These are the constants that it sets, or the class or function whose body or head it is part of.
    """
    lines, names, inside = range(line, line + 1), set[str](), False
    for node in (n for n in ast.walk(tree) if isinstance(n, ast.stmt)):
        body = getattr(node, "body", None)
        last = max(body[0].lineno - 1 if isinstance(body, list) else node.end_lineno or 0, node.lineno)
        if node.lineno <= line <= last:
            lines = range(node.lineno, last + 1)
            set_here = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            parts = [part for target in set_here if target for part in ast.walk(target)]
            names |= {part.id for part in parts if isinstance(part, ast.Name)}
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.lineno <= line <= (node.end_lineno or 0):
            names.add(node.name)
            inside |= isinstance(node, ast.FunctionDef) and node.body[0].lineno <= line
    return lines, set() if inside else names


def mentions(source: str, names: set[str]) -> list[int]:
    """Return the lines of functions that mention some names."""
    return [line for name in names for line in lines_by_name(source).get(name, [])]


@cache
def lines_by_name(source: str) -> dict[str, list[int]]:
    """Return the lines of functions that mention each name."""
    found: dict[str, list[int]] = {}
    for function in (f for f in ast.walk(ast.parse(source)) if isinstance(f, ast.FunctionDef)):
        for node in (n for statement in function.body for n in ast.walk(statement)):
            if isinstance(name := getattr(node, "id", getattr(node, "attr", None)), str):
                found.setdefault(name, []).append(node.lineno)
    return found


def compiled(module: str) -> bool:
    """Return whether Numba compiles a module, so that the record of executed lines is incomplete."""
    return module.endswith("_loops.py") or module.split("/")[2] in ("equations", "numerics")


def users(module: str, root: Path) -> set[str]:
    """Return the modules that import a module, directly or through compiled modules."""
    every = {str(p.relative_to(root)): imported(p.read_text()) for p in (root / "src").rglob("*.py")}
    found, todo = set[str](), [module]
    while todo:
        name = ".".join(Path(todo.pop()).with_suffix("").parts[1:])
        new = {m for m, names in every.items() if name in names} - found
        found |= new
        todo += [m for m in new if compiled(m)]
    return found


def tests_of(mutant: Mutant, copied: Copy, record: Executed) -> list[str]:
    """Return quick tests that may notice a mutant, first those that import its module or belong to its package.

    Those that executed its statement; where importing executes it, those that executed a line of the package that
    mentions what it names, or anything of its module where no line does. Of what Numba compiles there is no record:
    all that executed anything of the modules that use it. In both cases also tests of files that import the module.
    """
    sources = {str(p.relative_to(copied.root)): p.read_text() for p in (copied.root / "src").rglob("*.py")}
    lines, names = statement(ast.parse(sources[mutant.module]), mutant.start[0])
    chosen = set() if names else record.of(mutant.module, lines)
    for module, source in sources.items() if names else ():
        chosen |= record.of(module, mentions(source, names))
    if names and not chosen:
        chosen = record.inside(mutant.module, sources[mutant.module])
    for module in users(mutant.module, copied.root) if compiled(mutant.module) else ():
        chosen |= record.inside(module, sources[module])
    name = ".".join(Path(mutant.module).with_suffix("").parts[1:])
    files = (copied.root / "tests").rglob("test_*.py")
    direct = {str(f.relative_to(copied.root)) for f in files if name in imported(f.read_text())}
    if names or compiled(mutant.module):
        chosen |= {test for test in record.seconds if test.partition("::")[0] in direct}
    near = f"tests/{Path(mutant.module).parts[2]}/"

    def rank(test: str) -> tuple[bool, bool, float]:
        return test.partition("::")[0] not in direct, not test.startswith(near), record.seconds[test]

    return sorted(chosen, key=rank)


def ordered(tests: list[str], seconds: dict[str, float], budget: float) -> list[str]:
    """Return tests up to a total time in seconds; tests of one file stay together."""
    until = np.cumsum([seconds[test] for test in tests])
    tests = tests[: max(int(np.searchsorted(until, budget)), 1)]
    files = list(dict.fromkeys(test.partition("::")[0] for test in tests))
    return sorted(tests, key=lambda test: files.index(test.partition("::")[0]))


def tried(mutant: Mutant, copied: Copy, record: Executed, budget: float) -> tuple[str, str]:
    """Return the test that killed a mutant, or nothing, and a remark."""
    every = tests_of(mutant, copied, record)
    if not every:
        return "", "no quick test executes it"
    tests = ordered(every, record.seconds, budget)
    limit = 60.0 + 10.0 * sum(record.seconds[test] for test in tests)
    with copied.changed(mutant.module, mutant.apply((copied.root / mutant.module).read_text())):
        code, failed = copied.run(tests, limit)
    if code == 0:
        return "", f"{len(tests)} of {len(every)} quick tests pass"
    if code == -1:
        return "time", f"no end after {limit:.0f} s"
    return (failed[0] if failed else "import"), failed[0] if failed else f"exit code {code}"


def main() -> None:
    """Draw mutants, try them, and print the result."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("subpackages", nargs="+", help="folders of src/pliant")
    parser.add_argument("--count", type=int, default=20, help="mutants of each")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--budget", type=float, default=60.0, help="s that the tests of one mutant take unchanged")
    parser.add_argument("--tests", nargs="+", default=["tests"], help="may kill: the quick ones of these")
    parser.add_argument("--record", type=Path, default=ROOT / "results" / "executed_lines.json")
    parser.add_argument("--list", action="store_true", help="only list them")
    wish = parser.parse_args()
    chosen = drawn(wish.subpackages, wish.count, wish.seed)
    if wish.list:
        for mutant in chosen:
            print(mutant.told((ROOT / mutant.module).read_text()))
        return
    count, killed, killers = Counter[str](), Counter[str](), {}
    with tempfile.TemporaryDirectory() as folder:
        copied = Copy(Path(folder))
        record = kept_record(wish.record, copied, wish.tests)
        copied.prepare()
        for mutant in chosen:
            began = time.perf_counter()
            killer, told = tried(mutant, copied, record, wish.budget)
            count[name := Path(mutant.module).parts[2]] += 1
            killed[name] += bool(killer)
            killers[killer] = name
            change = mutant.told((ROOT / mutant.module).read_text())
            print(f"{'killed' if killer else 'SURVIVED'}: {told}\n    {change}  [{time.perf_counter() - began:.0f} s]",
                  flush=True)  # fmt: skip
        _, doubtful = copied.run([test for test in killers if test in record.seconds], 3600.0, first=False)
    print("\n| subpackage | mutants | killed |\n|---|---|---|")
    for name in count:
        print(f"| {name} | {count[name]} | {killed[name]} |")
    print(f"| all | {count.total()} | {killed.total()} |")
    if doubtful:
        print("These tests fail unchanged as well, so what they killed does not count: " + ", ".join(doubtful))


if __name__ == "__main__":
    main()
