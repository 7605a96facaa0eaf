"""Cases of a topic, and the table of their numbers: on the screen, or in the page that shows it.

A case measures some data, pliant or a peer, and may have goals. `measured` runs the chosen cases and prints one row of
a Markdown table for each. With `--write`, the table replaces the one that follows `<!-- TOPIC -->` in
docs/benchmarks.md.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

PAGE = Path(__file__).resolve().parents[1] / "docs" / "benchmarks.md"


@dataclass(frozen=True)
class Case:
    """What is measured: `measure` returns numbers by column; a goal is a limit, and whether less is better."""

    name: str
    measure: Callable[..., Mapping[str, Any]]
    goals: Mapping[str, tuple[float, bool]] = field(default_factory=dict)


def in_standard_errors(result: Any, truth: Mapping[str, float]) -> dict[str, float]:
    """Return the error of every parameter of a fit whose standard error is stated, in standard errors."""
    return {p.name: (p.value - truth[p.name]) / p.std for p in result.parameters
            if p.name in truth and p.value is not None and p.std}  # fmt: skip


def as_text(value: Any) -> str:
    """Return a cell: numbers with three digits, pairs with a slash, nothing for None."""
    if isinstance(value, tuple | list):
        return " / ".join(map(as_text, value))
    return "" if value is None else f"{value:.3g}" if isinstance(value, float) else str(value)


def table(rows: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the rows as a Markdown table whose columns are those of all rows."""
    columns = list(dict.fromkeys(name for row in rows.values() for name in row))
    lines = ["| " + " | ".join(["", *columns]) + " |", "|" + "---|" * (len(columns) + 1)]
    lines += [f"| {name} | " + " | ".join(as_text(row.get(c)) for c in columns) + " |" for name, row in rows.items()]
    return "\n".join(lines)


def missed(case: Case, row: Mapping[str, Any]) -> list[str]:
    """Return a sentence for every goal that a row does not reach."""
    return [
        f"{case.name}: {column} is {as_text(row[column])}, the goal {'at most' if less else 'at least'} {limit:g}"
        for column, (limit, less) in case.goals.items()
        if row.get(column) is not None and (row[column] > limit if less else row[column] < limit)
    ]


def put(topic: str, text: str, page: Path = PAGE) -> None:
    """Replace the table of a topic in the page by `text`."""
    pattern = re.compile(rf"(<!-- {re.escape(topic)} -->\n)(?:\|[^\n]*\n)*")
    whole, count = pattern.subn(lambda m: m[1] + text + "\n", page.read_text(encoding="utf-8"))
    if count != 1:
        raise SystemExit(f"{page.name} has {count} marks <!-- {topic} -->, where one is expected")
    page.write_text(whole, encoding="utf-8")


def parser_of(document: str | None, **defaults: Any) -> argparse.ArgumentParser:
    """Return the parser of a script from docstring and the defaults of its options, or the types of those without."""
    parser = argparse.ArgumentParser(description=document, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in defaults.items():
        kind, value = (default, None) if isinstance(default, type) else (type(default), default)
        parser.add_argument(f"--{name}", type=kind, default=value, help="default: %(default)s")
    return parser


def measured(document: str | None, topics: Mapping[str, Sequence[Case]], **options: Any) -> None:
    """Run the topics or cases named on the command line (default all), and show a table for each topic.

    The keywords are the options that every measure takes, with their defaults.
    """
    parser = parser_of(document, **options)
    known = [*topics, *(case.name for cases in topics.values() for case in cases)]
    parser.add_argument("names", nargs="*", help=f"topics or cases, of: {'; '.join(known)}. Default: all")
    parser.add_argument("--write", action="store_true", help=f"put the tables into docs/{PAGE.name}")
    given = vars(parser.parse_args())
    names, write = given.pop("names") or list(topics), given.pop("write")
    if unknown := [name for name in names if name not in known]:
        parser.error(f"there is no topic or case {unknown[0]!r}: use some of {', '.join(known)}")
    for topic, cases in topics.items():
        rows, short = {}, []
        for case in cases:
            if topic in names or case.name in names:
                rows[case.name] = dict(case.measure(**given))
                short += missed(case, rows[case.name])
                print(f"{case.name}: " + ", ".join(f"{k} {as_text(v)}" for k, v in rows[case.name].items()), flush=True)
        if rows:
            print("\n".join(["", topic, table(rows), *short, ""]))
        if rows and write:
            put(topic, table(rows))
