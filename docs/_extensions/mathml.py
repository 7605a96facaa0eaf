"""Formulas as MathML at build time: pages need no script and no network to show them."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert

# first letters of the mathematical alphabets: browsers take the letters, not the attribute mathvariant
ALPHABETS = {
    "bold": {"A": 0x1D400, "a": 0x1D41A, "Α": 0x1D6A8, "α": 0x1D6C2, "0": 0x1D7CE},
    "bold-italic": {"A": 0x1D468, "a": 0x1D482, "Α": 0x1D71C, "α": 0x1D736},
    "double-struck": {"A": 0x1D538, "a": 0x1D552, "0": 0x1D7D8},
}
LETTER = re.compile(r'<m([in]) mathvariant="([a-z-]+)">(&#x[0-9A-F]+;|.)</m[in]>')
OPERATOR = re.compile(r"<mo />\s*<mrow>((?:<m[in]>\w</m[in]>)+)</mrow>")


def styled(match: re.Match[str]) -> str:
    """A letter of the alphabet that its attribute asks for."""
    kind, variant, text = match.groups()
    letter = chr(int(text[3:-1], 16)) if text.startswith("&#x") else text
    for first, code in ALPHABETS.get(variant, {}).items():
        if 0 <= ord(letter) - ord(first) < 26 and letter.isalnum():
            return f"<m{kind}>&#x{code + ord(letter) - ord(first):X};</m{kind}>"
    return f"<m{kind}>{text}</m{kind}>"


def upright(match: re.Match[str]) -> str:
    """The name of an operator as one word."""
    return f"<mi>{re.sub('<[^>]+>', '', match[1])}</mi><mo>&#x2061;</mo>"


def mathml(formula: str, display: str) -> str:
    """A formula of LaTeX as MathML."""
    return OPERATOR.sub(upright, LETTER.sub(styled, convert(formula, display=display)))


def inline(self: Any, node: nodes.math) -> None:
    """A formula in a line."""
    self.body.append(mathml(node.astext(), "inline"))
    raise nodes.SkipNode


def block(self: Any, node: nodes.math_block) -> None:
    """A formula on a line of its own."""
    self.body.append(f'<div class="math-block">{mathml(node.astext(), "block")}</div>')
    raise nodes.SkipNode


def setup(app: Any) -> dict[str, Any]:
    """Make this the renderer of formulas."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
