"""Table of the model features that each export target supports, for the documentation.

`python -m pliant.exporters.table` prints it.
"""

from __future__ import annotations

from pliant.exporters.registry import BUILT_IN, Exporter, exporters
from pliant.model.features import FEATURES


def cell(exporter: Exporter, key: str) -> str:
    """Return how an export target treats the feature `key`: "yes" (exported), "left out" (always omitted, with a note)
    or "no" (an error, or omitted in an approximate export).
    """
    return "yes" if key in exporter.can else "left out" if key in exporter.by_nature else "no"


def table() -> str:
    """Return the table of supported features in Markdown, with a row for each feature and a column for each target."""
    targets = [e for name, e in exporters().items() if name in BUILT_IN]
    rows = [["", *(e.name for e in targets)], ["---"] * (len(targets) + 1)]
    rows += [[f.title, *(cell(e, key) for e in targets)] for key, f in FEATURES.items()]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


if __name__ == "__main__":
    print(table())  # noqa: T201
