"""Rows of the report's tables, formatted as text."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pliant.errors import InputError, PliantError
from pliant.failures import NotComputed
from pliant.identification.parameters import WIDE, Parameter, kind_of
from pliant.identification.result import FitResult
from pliant.model import Model
from pliant.model.summary import PLACEMENT, bending_stiffness, joint_placement
from pliant.selection import ModelSelection
from pliant.simulation import modes
from pliant.units import KIND_OF
from pliant.validation.baseline import better_sentence
from pliant.validation.outcome import Baseline, FitOutcome, RecordOutcome, Shape, StudyOutcome
from pliant.validation.wording import digits, sized

TIED = 0.95  # correlation of errors above which two parameters are reported as a pair
PAIRS = ("frequency_hz", "damping_ratio", "overshoot_percent", "steady_state_mm")
DETAILS = ("frequency_large_hz", "damping_ratio_large", "frequency_small_hz", "damping_ratio_small")
SINGLE = ("rmse_mm", "rmse_percent_of_travel", "rmse_percent_of_length", "max_mm", "fit_percent", "within_band_percent")


def first_records(fits: Sequence[FitOutcome]) -> list[tuple[FitOutcome, RecordOutcome]]:
    """Return a pair (fit, recording) for each recording, with the first fit that uses it."""
    records: dict[str, tuple[FitOutcome, RecordOutcome]] = {}
    for f in fits:
        for r in f.records:
            records.setdefault(r.name, (f, r))
    return list(records.values())


def columns(keys: Sequence[str], *, turns: bool) -> tuple[str, ...]:
    """Return the names of the metrics in the columns of a table. With `turns=True`, for recordings of angles alone,
    metrics in mm are replaced by those in degrees.
    """
    if not turns:
        return tuple(keys)
    return tuple(k.replace("_mm", "_deg") for k in keys if k != "rmse_percent_of_length")


def record_row(fit: FitOutcome, record: RecordOutcome) -> dict[str, Any]:
    """Return the texts of one row in the table of recordings."""
    m = record.metrics
    pairs = {k: m.get(k) or {} for k in columns(PAIRS, turns=record.experiment.without_positions)}
    measured, modelled = (pairs["frequency_hz"].get(who) for who in ("measured", "modelled"))
    off = 100 * (modelled / measured - 1) if measured and modelled else None
    return {
        "name": record.name, "fit": fit.title, "missing": "",
        "plain": digits(sized(fit.baseline.records.get(record.name, {}), "rmse")[0] if fit.baseline else None),
        "notes": [*(n.sentence for n in fit.not_computed if n.record == record.name), *edge_notes(m)],
        "single": {k: digits(m.get(k)) for k in columns(SINGLE, turns=record.experiment.without_positions)},
        "pairs": {k: [digits(pairs[k].get(who)) for who in ("measured", "modelled")] for k in pairs},
        "frequency_difference": digits(off, 2, "+"),
        "steady_state_error": digits(sized(m, "steady_state_error")[0], 2, "+"),
    }


def edge_notes(metrics: dict[str, Any]) -> list[str]:
    """Return a note on the pulse times that were fitted to a held-out recording without measured pressure."""
    fitted = metrics.get("fitted_edges_s") or {}
    times = ", ".join(f"{name} {digits(value, 4)} s" for name, value in fitted.items())
    return [f"Fitted to this record, since its pressure was not measured: {times}."] if times else []


def missing_row(fit: FitOutcome, missing: NotComputed) -> dict[str, Any]:
    """Return the row in the table of recordings for one whose motion could not be computed."""
    return {"name": missing.record, "fit": fit.title, "missing": missing.sentence}


def detail_row(fit: FitOutcome, record: RecordOutcome) -> dict[str, Any]:
    """Return the texts of one row in the table of the metrics of large swings, of small swings and of single joints."""
    m = record.metrics
    pairs = [[digits((m.get(k) or {}).get(who)) for who in ("measured", "modelled")] for k in DETAILS]
    joints = [[digits(v, 2, sign) for v in m.get(k) or ()] for k, sign in (
        ("joint_rmse_mrad", ""), ("joint_steady_error_mrad", "+"))]
    return {"name": record.name, "fit": fit.title, "pairs": pairs, "joints": [", ".join(row) for row in joints]}


def points_text(record: RecordOutcome) -> str:
    """Return a sentence on how many frames of a recording were compared, and how many of its points were not
    measured.
    """
    m, exp = record.metrics, record.experiment
    frames, missing = m.get("frames", exp.time.size), m.get("points_not_seen", 0)
    unit, factor = exp.shown_in
    travel = f"{digits(factor * exp.travel)} {'°' if unit == 'deg' else unit}"
    return f"{frames} frames compared, {missing} points not measured, peak displacement {travel}"


def fit_table(fits: Sequence[FitOutcome], order: Sequence[str]) -> dict[str, Any]:
    """Return the table of fits (rows) and recordings (columns, held-out ones first): error and role in every cell."""
    role: dict[str, str] = {}
    pairs = [(r.name, r.role) for f in fits for r in f.records] + [(m.record, m.role) for f in fits for m in f.missing]
    for name, entry in pairs:
        role[name] = "held_out" if "held_out" in (entry, role.get(name)) else entry
    rank = {n: k for k, n in enumerate(dict.fromkeys([*order, *role]))}
    names = sorted(role, key=lambda n: (role[n] != "held_out", rank[n]))
    rows = []
    for k, f in enumerate(fits):
        cells = {r.name: (r.role, digits(r.metrics.get("rmse_percent_of_travel")), digits(sized(r.metrics, "rmse")[0]),
                          r.name, role[r.name]) for r in f.records}
        free = sum(p.free for p in f.result.parameters)
        missing = {m.record: m.sentence for m in f.missing}
        rows.append({"fit": f, "k": k, "cells": [cells.get(n) for n in names], "free": free,
                     "missing": [missing.get(n, "") for n in names]})
    plain = [plain_row(f.baseline, names, role) for f in fits if f.baseline]
    return {"names": [(n, role[n]) for n in names], "rows": rows,
            "plain": [row for k, row in enumerate(plain) if row not in plain[:k]]}


def plain_row(baseline: Baseline, names: Sequence[str], role: Mapping[str, str]) -> dict[str, Any]:
    """Return the row of a plain map in the table of fits: its error for each of the recordings `names`."""
    cells = [(role[n], digits(m["rmse_percent_of_travel"]), digits(sized(m, "rmse")[0]))
             if (m := baseline.records.get(n)) else None for n in names]
    return {"title": baseline.title, "cells": cells, "coefficients": baseline.coefficients}


def plain_maps(fits: Sequence[FitOutcome]) -> list[dict[str, Any]]:
    """Return the title of each plain map, the fits with which it shares its training recordings, and sentences on it
    and on the records that it predicts better than their models.
    """
    rows: dict[tuple[Any, ...], dict[str, Any]] = {}
    for f in (f for f in fits if f.baseline):
        b: Any = f.baseline
        key = (b.title, b.training_error, b.left_out_error)
        error = "" if b.left_out_error is None else f"{digits(b.left_out_error)} {b.unit} on left-out training data, "
        first = (f"RMS error {error}{digits(b.training_error)} {b.unit} in training; {b.coefficients} coefficients, "
                 f"ridge {b.ridge:g}, {b.frames} training frames. Beyond the range of the training inputs it "
                 f"{'holds its value at their edge' if b.held_at_edge else 'extrapolates'}.")
        entry = rows.setdefault(key, {"title": b.title, "fits": [], "lines": [first, *b.notes]})
        entry["fits"].append(f.title)
        entry["lines"] += [" ".join((f"{f.title}:", s, b.suggestion)).strip() for s in [better_sentence(f)] if s]
        if b.explained:
            parts = ", ".join(f"{name} {100 * value:.0f} %" for name, value in b.explained.items())
            entry["lines"].append(f"{f.title}: fractions of the model's squared residual there, by what explains them "
                                  f"(they overlap): {parts}.")
    return [{**entry, "fits": ", ".join(entry["fits"])} for entry in rows.values()]


def parameter_row(p: Parameter) -> dict[str, str]:
    """Return the texts of one row in the table of parameters."""
    source = p.source or ("fitted" if p.free else "given")
    at_bound = p.free and p.value is not None and min(
        abs(p.value - p.lower), abs(p.value - p.upper)) < 1e-6 * (p.scale or 1.0)
    share = digits(100 * p.std / abs(p.value), 2) if p.std is not None and p.value else digits(None)
    power = f"^{p.name[-1]}".replace("^1", "")
    return {
        "name": p.name, "meaning": kind_of(p.name).meaning.replace("^k", power), "unit": p.unit.replace("^k", power),
        "value": digits(p.value, 5, zeros=p.free), "std": digits(p.std, 2), "share": share, "bounds": bounds(p),
        "interval": interval(p),
        "source": source, "rests_on": p.rests_on.replace("+-", "±"),
        "state": ("free, at a bound" if at_bound else "free") if p.free else "fixed",
    }


def interval(p: Parameter) -> str:
    """Return the 95 % interval of a parameter as text; a dash if it has none."""
    return " to ".join(digits(end, 4) for end in p.interval) if p.interval else digits(None)


def correlation_rows(result: FitResult) -> dict[str, Any] | None:
    """Return names and rows of the table of parameter correlations; None for fewer than two free parameters.

    Each cell is a pair of text and absolute value.
    """
    covariance = result.covariance
    if covariance is None or len(covariance.names) < 2:
        return None
    rows = [
        (name, [("" if hidden else f"{v:.2f}".replace("-", "−"), "0" if hidden else f"{abs(float(v)):.2f}")
                for v, hidden in zip(row, covariance.hidden | covariance.hidden[i], strict=True)])
        for i, (name, row) in enumerate(zip(covariance.names, covariance.correlation, strict=True))
    ]
    return {"names": covariance.names, "rows": rows}


def not_shown(result: FitResult) -> list[str]:
    """Return sentences on what the recordings do not determine about a fit's parameters."""
    free = [p for p in result.parameters if p.free]
    said = [f"{p.name}: the data do not determine it." for p in free if p.std is None]
    for p in (p for p in free if p.value is not None and p.std is not None and abs(p.value) < WIDE * p.std):
        end = "contains zero" if p.lower <= 0.0 <= p.upper else "is cut off by a bound"
        said.append(f"{p.name}: its 95 % interval, {interval(p)}, {end}.")
    covariance = result.covariance
    if covariance is not None:
        visible = [i for i, hidden in enumerate(covariance.hidden) if not hidden]
        tied = [(abs(c), f"{covariance.names[i]} and {covariance.names[j]}", c) for k, i in enumerate(visible)
                for j in visible[:k] if abs(c := float(covariance.correlation[i, j])) > TIED]
        said += [f"{pair} compensate each other: their errors are correlated by {digits(c, 2)}."
                 for _, pair, c in sorted(tied, reverse=True)]
    return said


def bounds(p: Parameter) -> str:
    """Return the bounds of a parameter as text."""
    below, above = math.isfinite(p.lower), math.isfinite(p.upper)
    lower, upper = digits(p.lower, zeros=False), digits(p.upper, zeros=False)
    if below and above:
        return f"{lower} to {upper}"
    return f"≥ {lower}" if below else f"≤ {upper}" if above else "none"


def known_unit(parameter: str) -> str:
    """Return the unit of a parameter, or of the level of an input such as ``left.pressure``; "" for an unknown name."""
    levels = {f".{kind}": unit for unit, kind in KIND_OF.items()}
    if unit := levels.get(parameter[parameter.rfind(".") :]) if "." in parameter else None:
        return unit
    try:
        return "Pa" if parameter == "level" else kind_of(parameter).unit
    except InputError:
        return ""


RUBBER = 1070.0  # kg/m^3, of silicones


def model_facts(outcome: StudyOutcome) -> list[tuple[str, str]]:
    """Return (name, value) pairs that describe the body, by which a person can judge its plausibility."""
    m = outcome.model
    length, mass = (digits(1e3 * v, 4, zeros=False) for v in (m.length, m.mass))
    strength = np.abs(m.gravity).max()
    rounded = np.where(np.abs(m.gravity) < 1e-9 * strength, 0.0, m.gravity)
    gravity = ", ".join(digits(g, zeros=False) for g in rounded)
    section = " to ".join(dict.fromkeys(digits(f(bending_stiffness(m)), 3, zeros=False) for f in (np.min, np.max)))
    return [
        ("links", str(m.n)), ("length", f"{length} mm"), ("moving mass", f"{mass} g"),
        ("bending stiffness EI", f"{section} N m², {PLACEMENT[joint_placement(m)]}"), *plausible(m),
        ("gravity in the base frame", f"({gravity}) m/s²" if m.gravity.any() else "none"),
    ]


def plausible(m: Model) -> list[tuple[str, str]]:
    """Return (name, value) pairs by which to judge the model: its first natural mode, and the thickness and modulus
    that a solid silicone rod of the same mass, length and EI would have.
    """
    area = m.mass / m.length / RUBBER
    modulus = float(np.mean(bending_stiffness(m))) * 4.0 * np.pi / area**2  # I = A^2 / (4 pi) of a disc
    rod = (f"as a solid silicone rod of {RUBBER:.0f} kg/m³: {digits(1e3 * np.sqrt(4 * area / np.pi))} mm thick, "
           f"modulus {digits(1e-6 * modulus)} MPa (soft silicones have 0.03 to 3 MPa)")
    try:
        frequency, damping = modes(m)
    except PliantError:  # the body has no equilibrium under its own weight
        return [("plausibility", rod)]
    return [("first mode", f"{digits(frequency[0])} Hz, damping ratio {digits(damping[0])}"), ("plausibility", rod)]


def selection_rows(selection: ModelSelection) -> list[dict[str, Any]]:
    """Return the texts of the rows in the table of a model selection, one for each step."""
    rows, free = [], set[str]()
    most = max(max(s.train_percent, s.left_out_percent) for s in selection.steps)
    for step in selection.steps:
        rows.append({
            "title": step.title, "chosen": step is selection.steps[-1], "free": str(len(step.free)),
            "train": digits(step.train_percent), "train_share": f"{100 * step.train_percent / most:.0f}%",
            "left_out": digits(step.left_out_percent), "left_share": f"{100 * step.left_out_percent / most:.0f}%",
            "adds": ", ".join(n for n in step.free if n not in free) or "nothing",
            "tried": [{"title": t.title, "reason": t.reason} for t in step.tried if t.cost is not None],
        })
        free = set(step.free)
    return rows


def order_rows(shape: Shape) -> list[dict[str, Any]]:
    """Return the rows of the table that compares numbers of segments, as text: for each number the shape error, and the
    number of operations to evaluate the dynamics once.
    """
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
    """Return for each link, as text: its number, length [mm], rest angle [degrees], range of its measured length [%],
    and the RMS distance [mm] of its measured tip from that of the chain with constant lengths.
    """
    links = shape.links
    columns = (1e3 * links.link_length, np.degrees(links.rest_bend), 100 * links.length_variation,
               1e3 * np.sqrt((links.residual**2).mean(axis=0)))
    return [[str(i + 1), *(digits(float(v)) for v in row)] for i, row in enumerate(zip(*columns, strict=True))]
