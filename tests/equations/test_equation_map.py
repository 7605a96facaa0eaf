"""docs/equations.md stays true: labels, functions and tests that it names exist, and none is missing from it."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from pliant.equations.symbols import Body, Held, Joints, MemoryLaw, Workspace

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
ROOM = ROOT / "src" / "pliant" / "equations"
PAGE = (ROOT / "docs" / "equations.md").read_text(encoding="utf-8")
LABELS = {"eq:Ti", "eq:T^i", "eq:Rp^i", "eq:wvi_recursive", "eq:eom", "A", "d", "tau"}  # of Sec. III


def rows():
    """First cell -> (functions, tests), of every table row of the page."""
    found = {}
    for line in PAGE.splitlines():
        cells = re.split(r"(?<!\\)\|", line.strip("|"))
        if line.startswith("| ") and len(cells) == 4 and "`" in cells[2]:
            name = re.sub(r" \(\d\)|`", "", cells[0]).strip()
            found[name] = (re.findall(r"`([\w.]+)`", cells[2]), re.findall(r"`([\w.:]+)`", cells[3]))
    return found


ROWS = rows()


def functions(path):
    return [f for f in ast.parse(path.read_text(encoding="utf-8")).body if isinstance(f, ast.FunctionDef)]


KERNELS = {
    f"{path.stem}.{f.name}": ast.get_docstring(f) or ""
    for path in sorted(ROOM.glob("*.py"))
    if not path.stem.startswith("_")
    for f in functions(path)
    if f.name not in ("start", "in_words")  # of a fit, and the name of a law: no equations
}


def test_every_label_of_the_paper_has_a_row():
    assert set(ROWS) >= LABELS


@pytest.mark.parametrize("row", sorted(ROWS))
def test_functions_and_tests_of_a_row_exist(row):
    kernels, tests = ROWS[row]
    assert kernels
    assert tests
    assert set(kernels) <= set(KERNELS)
    for name in tests:
        file, test = name.split("::")
        (path,) = HERE.parent.rglob(file)
        assert test in {f.name for f in functions(path)}, name


def test_every_kernel_stands_in_a_row():
    assert set(KERNELS) == {k for kernels, _ in ROWS.values() for k in kernels}


def test_a_kernel_that_cites_a_label_stands_in_its_row():
    cited = {(label, k) for k, text in KERNELS.items() for label in re.findall(r"\[(eq:[^\]]+)\]", text)}
    assert {label for label, _ in cited} == {label for label in LABELS if label.startswith("eq:")}
    missing = {(label, k) for label, k in cited if label not in ROWS or k not in ROWS[label][0]}
    assert not missing


def test_every_kernel_says_what_and_from_where():
    """A first line, a formula or a unit, and for what the paper prints, its place."""
    assert not [k for k, text in KERNELS.items() if not text]
    for row in LABELS:
        for kernel in ROWS[row][0]:
            assert re.search(r"^(Paper|Source): ", KERNELS[kernel], re.MULTILINE), kernel


def test_labels_cited_elsewhere_exist():
    for path in (ROOT / "src" / "pliant").rglob("*.py"):
        for label in re.findall(r"\[(eq:[^\]]+)\]", path.read_text(encoding="utf-8")):
            assert label in LABELS, f"{path.name}: {label}"


def test_notation_knows_every_parameter():
    notation = (ROOT / "docs" / "notation.md").read_text(encoding="utf-8")
    for name in (*Body._fields, *Joints._fields, *MemoryLaw._fields, *Held._fields, *Workspace._fields):
        assert f"`{name}`" in notation, name
