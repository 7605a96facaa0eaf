"""Short texts that figures and report share: roles of recordings (training or held out), labels of metrics,
formatted numbers.
"""

from __future__ import annotations

import math
from typing import Any

from pliant.text import escaped
from pliant.units import quantity
from pliant.validation.metrics import ANGLES, METRICS

ROLE = {"train": "training", "held_out": "held out", "forecast": "forecast"}
NO_PLACES = "The recordings hold angles and no positions: shapes, order and path are left out."
DASH = "–"


def digits(value: Any, count: int = 3, sign: str = "", *, zeros: bool = True) -> str:
    """Return a number with `count` significant digits, without exponent below a million; a dash if it is not finite.

    With `zeros`, trailing zeros are kept, as for measured numbers; without, they are dropped, as for stated numbers.
    """
    if value is None or isinstance(value, bool) or not math.isfinite(value):
        return DASH
    text = f"{value:{sign}{'#' if zeros else ''}.{count}g}"
    if "e" in text and 1 <= abs(value) < 1e6:
        text = f"{value:{sign}.0f}"
    mantissa, e, power = text.partition("e")
    return (mantissa.rstrip(".") + (f"e{int(power)}" if e else "")).replace("-", "−")


def clip(text: str, width: int = 60) -> str:
    """Return a user's text on one line of at most `width` printable characters, which XML and SVG allow."""
    line = escaped(" ".join(text.split()), "line")
    return line if len(line) <= width else f"{line[: width - 1]}…"


def readable(name: str) -> str:
    """Return the name of a station or recording with blanks instead of underscores: ``link_5`` becomes "link 5"."""
    return " ".join(name.replace("_", " ").split()) or name


def sized(metrics: dict[str, Any], name: str) -> tuple[Any, str]:
    """Return the value of the metric `name` and its unit: mm if positions were compared, degrees if angles were
    compared.
    """
    return (metrics[f"{name}_deg"], "°") if f"{name}_deg" in metrics else (metrics.get(f"{name}_mm"), "mm")


def span(low: float, high: float, digits: str = ".2g") -> str:
    """Return a range as text, or one number if both ends read alike."""
    first, last = f"{low:{digits}}", f"{high:{digits}}"
    return first if first == last else f"{first} to {last}"


def metric_label(key: str) -> tuple[str, str]:
    """Split the name of a metric into words and unit: "frequency_hz" gives ("frequency", "Hz")."""
    words, unit = quantity(key)
    metric = METRICS.get(key) or ANGLES.get(key)
    return (metric.label if metric else "") or words, unit or "%" * ("_percent_" in key)
