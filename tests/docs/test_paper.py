"""The paper: its numbers are those of the documentation, its references are listed, and it is short."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAPER = (ROOT / "paper" / "paper.md").read_text(encoding="utf-8")
BODY = PAPER.split("---\n", 2)[2]


def test_measured_numbers_are_those_of_the_documentation():
    pages = "".join((ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8") for name in (
        "benchmarks", "comparison", "export"))
    section = BODY.split("# Measured accuracy and speed")[1].split("\n# ")[0]
    numbers = re.findall(r"(?<![\w.])(\d+(?:\.\d+)?) (?:and (\d+\.\d+) )?(mm|ns|g)\b", section)
    assert len(numbers) >= 6
    missing = [n for first, second, _ in numbers for n in (first, second)
               if n and not re.search(rf"(?<![\d.]){re.escape(n)}(?![\d.]*\d)", pages)]  # fmt: skip
    assert missing == []


def test_every_reference_is_listed_and_cited():
    listed = set(re.findall(r"^@\w+\{(\w+),", (ROOT / "paper" / "paper.bib").read_text(encoding="utf-8"), re.MULTILINE))
    assert set(re.findall(r"@(\w+)", BODY)) == listed


def test_the_paper_fits_on_two_pages():
    assert len(BODY.split()) <= 1000
