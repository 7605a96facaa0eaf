"""The parts of `pliant bench` by name, and their numbers as lines or JSON."""

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
    """Measure the parts, one after the other.

    Parameters
    ----------
    parts : mapping
        Function that measures each part, by the part's name.
    meaning : mapping
        What each number means, by the number's name.
    message : callable
        Gets the numbers of each part as text when they are there.

    Returns
    -------
    dict
        Every number by its name, ``machine`` and ``pliant``.
    """
    results: dict[str, Any] = {"pliant": __version__, "machine": machine()}
    for name, job in parts.items():
        start = perf_counter()
        numbers = job()
        results |= numbers
        message("\n".join([f"{name} ({perf_counter() - start:.1f} s)", *lines(numbers, meaning)]))
    return results


def chosen(name: str | None) -> dict[str, Part]:
    """The part of this name, or all; InputError where there is no such part."""
    if name is None:
        return PARTS
    if name not in PARTS:
        raise InputError(f"unknown part {name!r} of the benchmark: use one of {', '.join(PARTS)}")
    return {name: PARTS[name]}


def lines(numbers: Mapping[str, Any], meaning: Mapping[str, str] = MEANING) -> list[str]:
    """One line a number: its name in the JSON, its value, what it means."""
    return [f"  {name:<30} {shown(value):<12} {meaning.get(name, '')}".rstrip() for name, value in numbers.items()]


def shown(value: Any) -> str:
    """A number to four digits; a method's own numbers in one line."""
    if isinstance(value, dict):
        return ", ".join(f"{k} {shown(v)}" for k, v in value.items())
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def write(results: Mapping[str, Any], path: str | Path) -> Path:
    """Write the numbers as JSON, whole or not at all."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_text(path, json.dumps(results, indent=1) + "\n")
