"""The rows of the report's tables, as texts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from pliant.errors import InputError
from pliant.identification.ladder import Ladder
from pliant.identification.parameters import Parameter, kind_of
from pliant.validation.outcome import FitOutcome, RecordOutcome, Shape, StudyOutcome
from pliant.validation.wording import digits

UNITS = {"mm": "mm", "hz": "Hz", "percent": "%", "s": "s", "deg": "°", "n": "N", "kpa": "kPa", "g": "g"}
LABELS = {
    "rmse_mm": "RMSE", "max_mm": "largest distance", "rmse_percent_of_travel": "RMSE / travel",
    "rmse_percent_of_length": "RMSE / length", "fit_percent": "NRMSE fit",
    "within_band_percent": "within the 95 % band", "frequency_hz": "frequency",
    "damping_ratio": "damping ratio", "overshoot_percent": "overshoot", "steady_state_mm": "steady state",
    "steady_state_error_mm": "steady-state error",
}
PAIRS = ("frequency_hz", "damping_ratio", "overshoot_percent", "steady_state_mm")
SINGLE = ("rmse_mm", "rmse_percent_of_travel", "rmse_percent_of_length", "max_mm", "fit_percent", "within_band_percent")


def first_records(fits: Sequence[FitOutcome]) -> list[tuple[FitOutcome, RecordOutcome]]:
    """Every record with the first fit that holds it, as metrics.json gives them."""
    found: dict[str, tuple[FitOutcome, RecordOutcome]] = {}
    for f in fits:
        for r in f.records:
            found.setdefault(r.name, (f, r))
    return list(found.values())


def record_row(fit: FitOutcome, record: RecordOutcome) -> dict[str, Any]:
    """A row of the table of records: texts only."""
    m = record.metrics
    pairs = {k: m.get(k) or {} for k in PAIRS}
    measured, modelled = (pairs["frequency_hz"].get(who) for who in ("measured", "modelled"))
    off = 100 * (modelled / measured - 1) if measured and modelled else None
    return {
        "name": record.name, "fit": fit.title,
        "single": {k: digits(m.get(k)) for k in SINGLE},
        "pairs": {k: [digits(pairs[k].get(who)) for who in ("measured", "modelled")] for k in PAIRS},
        "frequency_difference": digits(off, 2, "+"),
        "steady_state_error_mm": digits(m.get("steady_state_error_mm"), 2, "+"),
    }


def seen_text(record: RecordOutcome) -> str:
    """How much of a record was compared, in words."""
    m, exp = record.metrics, record.experiment
    frames, missing = m.get("frames", exp.time.size), m.get("points_not_seen", 0)
    return f"{frames} frames compared, {missing} points not seen, travel {digits(1e3 * exp.travel)} mm"


def fit_table(fits: Sequence[FitOutcome], order: Sequence[str]) -> dict[str, Any]:
    """Fits against records, these in the given order: error and role in every cell."""
    used = dict.fromkeys(r.name for f in fits for r in f.records)
    names = list(dict.fromkeys([*(n for n in order if n in used), *used]))
    rows = []
    for f in fits:
        cells = {r.name: (r.role, digits(r.metrics.get("rmse_percent_of_travel")), digits(r.metrics.get("rmse_mm")))
                 for r in f.records}
        free = sum(p.free for p in f.result.parameters)
        rows.append({"fit": f, "cells": [cells.get(n) for n in names], "free": free, "seconds": digits(f.seconds)})
    return {"names": names, "rows": rows}


def parameter_row(p: Parameter) -> dict[str, str]:
    """A row of a parameter table: texts only."""
    source = p.source or ("fitted" if p.free else "given")
    at_bound = p.free and p.value is not None and min(
        abs(p.value - p.lower), abs(p.value - p.upper)) < 1e-6 * (p.scale or 1.0)
    share = digits(100 * p.std / abs(p.value), 2) if p.std is not None and p.value else digits(None)
    power = f"^{p.name[-1]}".replace("^1", "")
    return {
        "name": p.name, "meaning": kind_of(p.name).meaning.replace("^k", power), "unit": p.unit.replace("^k", power),
        "value": digits(p.value, 5, zeros=p.free), "std": digits(p.std, 2), "share": share, "bounds": bounds(p),
        "source": source,
        "state": ("free, at a bound" if at_bound else "free") if p.free else "fixed",
    }


def bounds(p: Parameter) -> str:
    """The bounds of a parameter in words."""
    below, above = math.isfinite(p.lower), math.isfinite(p.upper)
    lower, upper = digits(p.lower, zeros=False), digits(p.upper, zeros=False)
    if below and above:
        return f"{lower} to {upper}"
    return f"≥ {lower}" if below else f"≤ {upper}" if above else "none"


def known_unit(parameter: str) -> str:
    """Unit of a parameter or of a pressure level; nothing for a name that pliant does not know."""
    try:
        return "Pa" if parameter == "level" else kind_of(parameter).unit
    except InputError:
        return ""


def metric_label(key: str) -> tuple[str, str]:
    """Words and unit of a metric from its name: frequency_hz is ("frequency", "Hz")."""
    unit = next((u for part in reversed(key.split("_")) if (u := UNITS.get(part))), "")
    tail = key.rpartition("_")[2]
    words = key.removesuffix(f"_{tail}") if tail in UNITS else key
    return LABELS.get(key, words.replace("_", " ")), unit


def model_facts(outcome: StudyOutcome) -> list[tuple[str, str]]:
    """The body in a few numbers."""
    m = outcome.model
    length, mass = (digits(1e3 * v, 4, zeros=False) for v in (m.length, m.mass))
    gravity = ", ".join(digits(g, zeros=False) for g in m.gravity)
    return [
        ("links", str(m.n)), ("length", f"{length} mm"), ("moving mass", f"{mass} g"),
        ("gravity in the base frame", f"({gravity}) m/s²" if m.gravity.any() else "none"),
    ]


def ladder_rows(ladder: Ladder) -> list[dict[str, Any]]:
    """Rungs of a ladder: texts only."""
    titles = {s.rung.name: s.rung.title for s in ladder.steps}
    freed = {s.rung.name: set(s.freed) for s in ladder.steps}
    rows, before = [], ""
    for s in ladder.steps:
        errors = [digits(sum(e.values()) / len(e)) if e else digits(None) for e in (s.train, s.held_out)]
        added = [n for n in s.freed if n not in freed.get(s.stands_on, ())]
        rows.append({
            "title": s.rung.title, "chosen": s.rung.name == ladder.chosen, "told": s.told,
            "stands_on": titles[s.stands_on] if s.result and s.stands_on not in ("", before) else "",
            "adds": ", ".join(added) or "nothing", "free": str(len(s.freed)), "train": errors[0],
            "held_out": errors[1], "bic": digits(s.bic, 4), "fit": digits(s.seconds), "step": digits(s.step_ns),
        })
        before = s.rung.name
    return rows


def order_rows(shape: Shape) -> list[dict[str, Any]]:
    """Errors and cost of each number of segments: texts only."""
    order = shape.order
    return [
        {
            "n": str(n), "used": n == shape.links.n, "chosen": n == order.chosen,
            "largest": digits(1e3 * worst.max()), "p95": digits(1e3 * np.percentile(worst, 95)),
            "mean": digits(1e3 * mean.mean()), "within": digits(100 * order.fraction_within(n)),
            "operations": str(order.operations(n)),
        }
        for n, worst, mean in zip(order.orders, order.max_error, order.mean_error, strict=True)
    ]


def link_rows(shape: Shape) -> list[list[str]]:
    """Number, length, rest angle, variation of length and distance from the measured tip of each link: texts only."""
    links = shape.links
    columns = (1e3 * links.link_length, np.degrees(links.rest_angle), 100 * links.length_variation,
               1e3 * np.sqrt((links.residual**2).mean(axis=0)))
    return [[str(i + 1), *(digits(float(v)) for v in row)] for i, row in enumerate(zip(*columns, strict=True))]
