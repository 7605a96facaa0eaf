"""The checks as a table: `python -m pliant.preprocessing.plausibility.table` prints it for the documentation."""

from __future__ import annotations

from pliant.preprocessing.plausibility import CHECKS

RUN_BY = {"recording": "each recording", "body": "what is stated of the body", "model": "each fitted model"}


def table() -> str:
    """The table in Markdown: a row for each check."""
    rows = [["check", "of", "what is looked at", "named when"], ["---"] * 4]
    rows += [[c.name, RUN_BY[c.subject], c.looks_at, c.threshold] for c in CHECKS]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


if __name__ == "__main__":
    print(table())  # noqa: T201
