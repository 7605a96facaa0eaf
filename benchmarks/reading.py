"""Print a sample by seed of what pliant says, to be read by somebody who wrote none of it.

    python benchmarks/reading.py --seed 1                      # 40 docstrings, 40 messages, 40 sentences
    python benchmarks/reading.py --count 0                     # all messages of the code
"""

from __future__ import annotations

import argparse
import ast
import random
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src" / "pliant"
ERRORS = ("InputError", "PliantError", "FitError", "SimulationError", "Refused")
CALLS = {"notify": "progress", "mention": "progress", "warn": "warning", "say": "output"}
VERDICT = ("study/verdict.py", "failures.py")
SHORTEST = 25  # characters of a sentence
CODE = re.compile(r"^(```|:::).*?^\1[^\n]*$|\A---\n.*?^---$|^\$\$.*?\$\$[^\n]*$|<!--.*?-->",
                  re.MULTILINE | re.DOTALL)  # also the head of a page, formulas and remarks  # fmt: skip
NO_TEXT = re.compile(r"^(?:\||#|\(\S+\)=$|<)[^\n]*$|^!\[[^\]]*\]\([^)]*\)", re.MULTILINE)  # table, heading, picture
ITEM = re.compile(r"\n\s*(?:[-*]|\d+\.) +|\n(?=\[\^)")  # begins an item of a list or a footnote
RUN_IN = re.compile(r"^\*\*[^*]*(?:[.:!?]\*\*|\*\*(?: \([^)]*\))?\.)\s*")  # a heading that begins a paragraph
END = re.compile(r"[.!?][*)\"]*\s+(?=\S)")  # of a sentence
KEPT = re.compile(r"(?:\b[A-Z]|\b(?:Sec|Secs|Eq|Eqs|Fig|Figs|Ref|No|vs|cf|e\.g|i\.e|et al)|\.\.)\.$")  # no end of one
VERBS = ("is are was were has have had does do did can cannot must may shows? gives? holds? takes? prints? measures? "
         "compares? writes? needs? counts? runs? uses? contains? differs? comes? follows?")  # fmt: skip
VERB = re.compile(rf"\b(?:{VERBS.replace(' ', '|')})\b")


class Message(NamedTuple):
    """One text of the package: its kind, its position and its words."""

    kind: str
    place: str
    text: str


def text_of(node: ast.AST) -> str:
    """Return the text of a string expression, with inserted values as {name}; '' for anything else."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(str(v.value) if isinstance(v, ast.Constant) else f"{{{ast.unparse(v.value)}}}"
                       for v in node.values if isinstance(v, ast.Constant | ast.FormattedValue))  # fmt: skip
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return text_of(node.left) + text_of(node.right)
    if isinstance(node, ast.IfExp):
        return f"{text_of(node.body)} | {text_of(node.orelse)}"
    return ""


def name_of(call: ast.Call) -> str:
    """Return the last part of the name that is called."""
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


def messages(path: Path) -> Iterator[Message]:
    """Yield every message of a file: arguments of errors, messages and warnings, and sentences of a verdict."""
    place = path.relative_to(SOURCE).as_posix()
    tree = ast.parse(path.read_text(encoding="utf-8"))
    taken = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and node.args:
            name = name_of(node)
            kind = "error" if name in ERRORS else CALLS.get(name, "")
            if kind and (text := text_of(node.args[0])):
                taken.add(node.args[0])
                yield Message(kind, f"{place}:{node.lineno}", " ".join(text.split()))
    if place in VERDICT or place.startswith("preprocessing/plausibility/"):
        for node in ast.walk(tree):
            text = text_of(node) if isinstance(node, ast.JoinedStr) and node not in taken else ""
            if len(text) > SHORTEST:
                yield Message("verdict", f"{place}:{node.lineno}", " ".join(text.split()))


def all_messages() -> list[Message]:
    """Return every message of the package, sorted by kind and position."""
    return sorted({m for path in SOURCE.rglob("*.py") for m in messages(path)})


def docstrings() -> list[Message]:
    """Return the first paragraph of the docstring of every public name."""
    found = []
    for path in sorted(SOURCE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module) and (doc := ast.get_docstring(node)):
                name = getattr(node, "name", "module")
                if not name.startswith("_"):
                    place = f"{path.relative_to(SOURCE).as_posix()}: {name}"
                    found.append(Message("docstring", place, " ".join(doc.partition("\n\n")[0].split())))
    return found


def blocks(page: str) -> Iterator[str]:
    """Yield each paragraph and list item of a page on one line, and each footnote that is a sentence."""
    for block in re.split(r"\n\s*\n", NO_TEXT.sub("\n\n", CODE.sub("\n\n", page))):
        for part in re.split(ITEM, "\n" + block):
            text = RUN_IN.sub("", " ".join(part.split()))
            note = re.match(r"\[\^[\w-]+\]: ", text)
            if not note:
                yield text
            elif re.match(r"[A-Z]", text[note.end() :]) and VERB.search(text):
                yield text[note.end() :]


def cut(text: str) -> list[str]:
    """Return the sentences of a paragraph; initials, abbreviations and three dots end none."""
    parts, start = [], 0
    for end in END.finditer(text):
        if not KEPT.search(text[: end.start() + 1]):
            parts.append(text[start : end.end()].strip())
            start = end.end()
    return [part.strip("*") if part.count("*") % 2 else part for part in (*parts, text[start:].strip())]


def sentences() -> list[Message]:
    """Return the sentences of the documentation, without code, tables and formulas."""
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    found = [(page.name, part) for page in pages for block in blocks(page.read_text("utf-8")) for part in cut(block)]
    return [Message("sentence", name, part) for name, part in found if len(part) > SHORTEST]


def main() -> None:
    """Print the sample."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=40, help="of each kind; 0: all messages alone")
    asked = parser.parse_args()
    rng, texts = random.Random(asked.seed), all_messages()
    pools = [rng.sample(pool, asked.count) for pool in (docstrings(), texts, sentences())] if asked.count else [texts]
    for pool in pools:
        for k, m in enumerate(pool, 1):
            print(f"{k:2d}. [{m.kind}] {m.place}\n    {m.text}")


if __name__ == "__main__":
    main()
