"""The table of the documentation is the one that the code makes."""

from __future__ import annotations

from pathlib import Path

from pliant.exporters.table import table

PAGE = Path(__file__).resolve().parents[2] / "docs" / "export.md"


def test_the_page_shows_what_the_code_says():
    shown = PAGE.read_text(encoding="utf-8").split("<!-- table: begin -->")[1].split("<!-- table: end -->")[0]
    assert shown.strip() == table(), "run: python -m pliant.exporters.table, and put it into docs/export.md"
