"""The table of features by target: `python -m pliant.exporters.table` prints it for the documentation."""

from __future__ import annotations

from pliant.exporters.features import FEATURES
from pliant.exporters.registry import BUILT_IN, Exporter, exporters


def cell(exporter: Exporter, key: str) -> str:
    """Return "yes", "left out" (and reported), or "no" (refused unless approximate)."""
    return "yes" if key in exporter.can else "left out" if key in exporter.by_nature else "no"


def table() -> str:
    """The table in Markdown: a row for each feature, a column for each target."""
    targets = [e for name, e in exporters().items() if name in BUILT_IN]
    rows = [["", *(e.name for e in targets)], ["---"] * (len(targets) + 1)]
    rows += [[f.title, *(cell(e, key) for e in targets)] for key, f in FEATURES.items()]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


if __name__ == "__main__":
    print(table())  # noqa: T201
