"""All parts of the benchmark by name, and what they found as lines or JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

from pliant.bench.meaning import MEANING
from pliant.bench.timing import machine
from pliant.errors import InputError
from pliant.files import write_text
from pliant.version import __version__

Part = Callable[[], dict[str, Any]]
NAMES = ("kernels", "experiment", "fit", "batch", "realtime", "startup")


def part(name: str, seconds: float) -> Part:
    """The measuring function of one part; `seconds` is for the real-time run."""
    from pliant.bench import batches, fitting, kernels, race, realtime, startup

    parts: dict[str, Part] = {
        "kernels": kernels.kernels, "experiment": race.experiment, "fit": fitting.fitting, "batch": batches.batches,
        "realtime": lambda: realtime.realtime(seconds), "startup": startup.startup,
    }
    if name not in parts:
        raise InputError(f"unknown part {name!r} of the benchmark: use one of {', '.join(NAMES)}")
    return parts[name]


def measure(
    names: Sequence[str] = NAMES, *, seconds: float = 10.0, tell: Callable[[str], None] = lambda _line: None,
) -> dict[str, Any]:
    """Measure the named parts, one after the other.

    Returns
    -------
    dict
        Every number by its name, ``machine`` and ``pliant``; `tell` gets each part's numbers when they are there.
    """
    jobs = {name: part(name, seconds) for name in names}
    found: dict[str, Any] = {"pliant": __version__, "machine": machine()}
    for name, job in jobs.items():
        start = perf_counter()
        numbers = job()
        found |= numbers
        tell("\n".join([f"{name} ({perf_counter() - start:.1f} s)", *lines(numbers)]))
    return found


def lines(numbers: dict[str, Any]) -> list[str]:
    """One line a number: its name in the JSON, its value, what it means."""
    return [f"  {name:<30} {shown(value):<12} {MEANING.get(name, '')}".rstrip() for name, value in numbers.items()]


def shown(value: Any) -> str:
    """A number to four digits; a method's own numbers in one line."""
    if isinstance(value, dict):
        return ", ".join(f"{k} {shown(v)}" for k, v in value.items())
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def write(found: dict[str, Any], path: str | Path) -> Path:
    """Write what was found as JSON, whole or not at all."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_text(path, json.dumps(found, indent=1) + "\n")
