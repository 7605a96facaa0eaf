"""The paper: its numbers are those of the documentation, its references are listed, and it is short."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAPER = (ROOT / "paper" / "paper.md").read_text(encoding="utf-8")
BODY = PAPER.split("---\n", 2)[2]


def page(name):
    return (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")


def test_measured_numbers_are_those_of_the_documentation():
    """Errors of the paper are those of pliant beside other models today, and of the fabric arm."""
    pages = {
        "mm": page("comparison").split("## pliant beside other models")[1].split("\n## ")[0]
        + page("case_studies").split("`spatial_pneumatic_arm.toml`")[1].split("\n## ")[0],
        "ns": page("export"), "g": page("benchmarks"),
    }
    section = BODY.split("# Measured accuracy and speed")[1].split("\n# ")[0]
    numbers = re.findall(r"(?<![\w.])(\d+(?:\.\d+)?) (?:(?:and|to) (\d+\.\d+) )?(mm|ns|g)\b", section)
    assert len(numbers) >= 6
    missing = [n for first, second, unit in numbers for n in (first, second)
               if n and not re.search(rf"(?<![\d.]){re.escape(n)}(?![\d.]*\d)", pages[unit])]  # fmt: skip
    assert missing == []


def test_every_reference_is_listed_and_cited():
    listed = set(re.findall(r"^@\w+\{(\w+),", (ROOT / "paper" / "paper.bib").read_text(encoding="utf-8"), re.MULTILINE))
    assert set(re.findall(r"@(\w+)", BODY)) == listed


def test_the_paper_fits_on_two_pages():
    assert len(BODY.split()) <= 1000
