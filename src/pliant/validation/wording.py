"""Short texts that figures and report share: roles, numbers, headings."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from pliant.text import escaped
from pliant.units import quantity, shown_in

INPUTS = {"Pa": "pressure", "N": "tension", "m": "displacement", "rad": "motor angle"}  # by SI unit
ROLE = {"train": "training", "held_out": "held out", "forecast": "forecast"}
NO_PLACES = "The recordings hold angles and no places: shapes, order and path are left out."
DASH = "–"
LABELS = {
    "rmse_mm": "RMSE", "rmse_deg": "RMSE", "max_mm": "largest distance", "max_deg": "largest difference",
    "rmse_percent_of_travel": "RMSE / travel",
    "rmse_percent_of_length": "RMSE / length", "fit_percent": "NRMSE fit",
    "within_band_percent": "within the 95 % band", "frequency_hz": "frequency",
    "damping_ratio": "damping ratio", "overshoot_percent": "overshoot", "steady_state_mm": "steady state",
    "steady_state_error_mm": "steady-state error", "steady_state_deg": "steady state",
    "steady_state_error_deg": "steady-state error", "sensor_step_deg": "step of the sensor",
    "frequency_large_hz": "frequency, large swings", "damping_ratio_large": "damping ratio, large swings",
    "frequency_small_hz": "frequency, small swings", "damping_ratio_small": "damping ratio, small swings",
    "joint_rmse_mrad": "joints, RMSE", "joint_steady_error_mrad": "joints, steady error",
}


def input_words(units: Iterable[str]) -> tuple[str, str]:
    """Return what inputs of some SI units are called together, and the units in which they are shown."""
    kinds = list(dict.fromkeys(units))
    word = INPUTS[kinds[0]] if len(kinds) == 1 else "input"
    return word, ", ".join(shown_in(unit)[1] for unit in kinds)


def digits(value: Any, count: int = 3, sign: str = "", *, zeros: bool = True) -> str:
    """A number with `count` significant digits, written out below a million; a dash where there is none.

    With `zeros` trailing ones are kept, as for what was measured; without, dropped, as for what was stated.
    """
    if value is None or isinstance(value, bool) or not math.isfinite(value):
        return DASH
    text = f"{value:{sign}{'#' if zeros else ''}.{count}g}"
    if "e" in text and 1 <= abs(value) < 1e6:
        text = f"{value:{sign}.0f}"
    mantissa, e, power = text.partition("e")
    return (mantissa.rstrip(".") + (f"e{int(power)}" if e else "")).replace("-", "−")


def clip(text: str, width: int = 60) -> str:
    """User text on one line of at most `width` printable characters: XML, and so SVG, forbids control characters."""
    line = escaped(" ".join(text.split()), "line")
    return line if len(line) <= width else f"{line[: width - 1]}…"


def readable(name: str) -> str:
    """Return a name of a station or record as a person writes it: ``link_5`` is "link 5"."""
    return " ".join(name.replace("_", " ").split()) or name


def sized(metrics: dict[str, Any], name: str) -> tuple[Any, str]:
    """A metric of a length or of an angle, whichever was compared, and its unit: ``rmse_mm`` or ``rmse_deg``."""
    return (metrics[f"{name}_deg"], "°") if f"{name}_deg" in metrics else (metrics.get(f"{name}_mm"), "mm")


def metric_label(key: str) -> tuple[str, str]:
    """Words and unit of a metric from its name: frequency_hz is ("frequency", "Hz")."""
    words, unit = quantity(key)
    return LABELS.get(key, words), unit or "%" * ("_percent_" in key)
