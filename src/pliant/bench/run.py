"""The parts of `pliant bench` by name, and output of their results as text or JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from time import perf_counter
from typing import Any

from pliant.bench import kernels, startup
from pliant.bench.meaning import MEANING
from pliant.bench.timing import machine
from pliant.errors import InputError
from pliant.files import write_text
from pliant.version import __version__

Part = Callable[[], dict[str, Any]]
PARTS: dict[str, Part] = {"kernels": kernels.kernels, "startup": startup.startup}


def measure(
    parts: Mapping[str, Part], meaning: Mapping[str, str] = MEANING, *,
    message: Callable[[str], None] = lambda _line: None,
) -> dict[str, Any]:
    """Measure the parts one after the other and return their results.

    Parameters
    ----------
    parts : mapping
        Function that measures each part, by the part's name.
    meaning : mapping
        Description of each number, by its name.
    message : callable
        Called with the results of each part as text.

    Returns
    -------
    dict
        Every number by its name, the facts of the machine under ``machine``, and the version under ``pliant``.
    """
    results: dict[str, Any] = {"pliant": __version__, "machine": machine()}
    for name, job in parts.items():
        start = perf_counter()
        numbers = job()
        results |= numbers
        message("\n".join([f"{name} ({perf_counter() - start:.1f} s)", *lines(numbers, meaning)]))
    return results


def chosen(name: str | None) -> dict[str, Part]:
    """Return the part with this name, or all for None; InputError for an unknown name."""
    if name is None:
        return PARTS
    if name not in PARTS:
        raise InputError(f"unknown part {name!r} of the benchmark: use one of {', '.join(PARTS)}")
    return {name: PARTS[name]}


def lines(numbers: Mapping[str, Any], meaning: Mapping[str, str] = MEANING) -> list[str]:
    """Return a line of text for each number: its name in the JSON, its value and its description."""
    return [f"  {name:<30} {shown(value):<12} {meaning.get(name, '')}".rstrip() for name, value in numbers.items()]


def shown(value: Any) -> str:
    """Return a number as text with four digits; for a dictionary, its numbers in one line."""
    if isinstance(value, dict):
        return ", ".join(f"{k} {shown(v)}" for k, v in value.items())
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def write(results: Mapping[str, Any], path: str | Path) -> Path:
    """Write the results as a JSON file, atomically."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_text(path, json.dumps(results, indent=1) + "\n")
