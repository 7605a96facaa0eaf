"""Table of the plausibility checks: `python -m pliant.preprocessing.plausibility.table` prints it for the docs."""

from __future__ import annotations

from pliant.preprocessing.plausibility import CHECKS

RUN_BY = {"recording": "each recording", "body": "the stated data of the body", "model": "each fitted model"}


def table() -> str:
    """Return the plausibility checks as a Markdown table, one row per check."""
    rows = [["check", "of", "what is examined", "reported when"], ["---"] * 4]
    rows += [[c.name, RUN_BY[c.subject], c.looks_at, c.threshold] for c in CHECKS]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


if __name__ == "__main__":
    print(table())  # noqa: T201
