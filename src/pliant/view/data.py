"""What the page's plots draw: arrays of every record, shape, law and forecast, in the units that a reader reads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pliant.identification.experiment import Experiment
from pliant.mechanics import mechanics_of
from pliant.numerics.arcs import arc_lengths
from pliant.units import shown_in
from pliant.validation.curves import autocorrelation, evenly_spaced, laws_of, pressures_of
from pliant.validation.draw import moves_torque
from pliant.validation.outcome import Clocks, FitOutcome, Forecast, RecordOutcome, Shape, StudyOutcome
from pliant.validation.wording import input_words
from pliant.view.packing import Pack

Array = np.ndarray
MOST_NUMBERS = 1_200_000  # of all records in one page; beyond, every second frame, or every third, ...
MOST_FRAMES = 4000  # of a plot of the shape
PROFILES, PLACES = 60, 120  # of the fan of curvatures


def page_data(outcome: StudyOutcome, pack: Pack) -> dict[str, Any]:
    """Notes of all arrays, by what they are of."""
    every = thinning(outcome)
    measured: dict[str, Any] = {}
    for fit in outcome.fits:
        for record in fit.records:
            measured.setdefault(record.name, measured_of(record, every, pack))
    lengthens = mechanics_of(outcome.model).lengthens
    if lengthens:
        for record in (r for f in outcome.fits for r in f.records):
            measured[record.name]["grown"] = grown_of(record.experiment.position, record.experiment, every, pack)
    return {
        "every": every, "records": measured, "turns": outcome.turns, "axes": outcome.axes,
        "fits": [{
            "title": f.title, "records": {r.name: modelled_of(r, every, pack) for r in f.records},
            "grown": {r.name: grown_of(r.modelled, r.experiment, every, pack) for r in f.records}
            if lengthens else {},
        } for f in outcome.fits],
        "shape": shape_of(outcome.shape, pack) if outcome.shape else None,
        "torque": torque_of(outcome.fits, pack) if moves_torque(outcome.fits) else None,
        "forecasts": [forecast_of(f, pack) for f in outcome.forecasts],
        "clocks": [clocks_of(c, pack) for c in outcome.clocks.values()],
    }


def thinning(outcome: StudyOutcome) -> int:
    """Every how manieth frame the page shows, so that its size stays bounded."""
    numbers = 0
    for fit in outcome.fits:
        for r in fit.records:
            each = r.experiment.compared[0].size
            numbers += len(r.modelled) * (2 * each + (2 * each if r.band is not None else 0)
                                          + (0 if r.body is None else r.body[0].size))
    return max(1, int(np.ceil(numbers / MOST_NUMBERS)))


def measured_of(record: RecordOutcome, every: int, pack: Pack) -> dict[str, Any]:
    """Return what a recording showed: s, mm (degrees of angles alone), and inputs in kPa, N, mm or rad."""
    exp, inputs = record.experiment, []
    for name, trace in exp.traces.items():
        seen = np.interp(exp.time[::every], trace.time, trace.pressure, left=np.nan, right=np.nan)
        factor, _ = shown_in(record.unit_of(name))
        inputs.append({"name": f"measured, {name}" if name else "measured", "value": pack.add(factor * seen)})
    word, unit = input_words(record.units)
    return {
        "stations": list(exp.stations), "shown": evenly_spaced(len(exp.stations), 3), "kind": exp.excitation,
        "time": clock(exp.time[::every], pack), "position": pack.add(exp.shown_in[1] * exp.compared[::every]),
        "inputs": inputs, "input": word, "unit": unit,
        "level": shown_in(record.units[0])[0] * exp.level if exp.excitation in ("pulse", "step") else None,
    }


def grown_of(position: Array, exp: Experiment, every: int, pack: Pack) -> dict[str, Any] | None:
    """How much longer the body is than in its first frames, mm, by arcs through the stations; nothing for one point."""
    if exp.without_positions or len(exp.stations) < 2:
        return None
    length = arc_lengths(position)
    return pack.add(1e3 * (length - np.nanmedian(length[:5]))[::every]) if np.isfinite(length[:5]).any() else None


def clock(time: Array, pack: Pack) -> dict[str, Any]:
    """Times to the last digit: float64, as bytes."""
    note = {"at": pack.used, "shape": [time.size], "kind": "float64"}
    pack.put(np.asarray(time, dtype="<f8").tobytes())
    return note


def modelled_of(record: RecordOutcome, every: int, pack: Pack) -> dict[str, Any]:
    """Return what a fit says of a recording: mm (degrees), inputs in the units of `measured_of`.

    With the correlation of its last station's residual.
    """
    exp = record.experiment
    factor = exp.shown_in[1]
    residual = factor * (record.modelled[:, -1] - exp.last_station)
    lag, correlation = zip(*(autocorrelation(exp.time, r) for r in residual.T), strict=True)
    seen = np.isfinite(residual[:, 0]).sum()
    scales = [shown_in(unit)[0] for unit in record.units]
    body = record.body if record.body is not None else np.concatenate(
        [np.zeros((exp.time.size, 1, exp.compared.shape[2])), record.modelled], axis=1)
    return {
        "role": record.role, "position": pack.add(factor * record.modelled[::every]),
        "body": pack.add(1e3 * body[::every]), "pressure": pack.add(scales * record.pressure[::every]),
        "band": [pack.add(factor * edge[::every]) for edge in (record.band.lower, record.band.upper)]
        if record.band is not None else None,
        "level": record.band.level if record.band is not None else None,
        "lag": clock(lag[0], pack), "correlation": pack.add(np.stack(correlation, axis=1)),
        "white": float(1.96 / np.sqrt(max(seen, 1))),
    }


def shape_of(shape: Shape, pack: Pack) -> dict[str, Any]:
    """Errors of each order in time, and the fan of curvatures."""
    order = shape.order
    stretch = -(-order.time.size // MOST_FRAMES)
    starts = np.arange(0, order.time.size, stretch)  # of each stretch of frames, its largest error
    frames = np.unique(np.linspace(0, len(shape.curvature) - 1, min(PROFILES, len(shape.curvature))).astype(int))
    places = np.unique(np.linspace(0, shape.arc_length.size - 1, min(PLACES, shape.arc_length.size)).astype(int))
    return {
        "name": shape.name, "orders": list(order.orders), "used": shape.links.n,
        "bound": None if order.bound is None else 1e3 * order.bound, "time": clock(order.time[starts], pack),
        "error": pack.add(np.stack([1e3 * np.maximum.reduceat(e, starts) for e in order.max_error], axis=1)),
        "arc": clock(1e3 * shape.arc_length[places], pack),
        "curvature": pack.add(shape.curvature[np.ix_(frames, places)].T),
        "rest": pack.add(shape.rest_curvature[places]), "frames": len(shape.curvature),
    }


def torque_of(fits: Sequence[FitOutcome], pack: Pack) -> dict[str, Any]:
    """Torque law of each fit, kPa and mN m, with the levels of its records."""
    known = [law for f in fits for law in laws_of(f)]
    levels = sorted({p for _, _, marks in known for p in marks})
    pressure = np.unique([*pressures_of(known, 100), *levels])
    laws = [
        {"title": title, "value": pack.add(1e3 * np.asarray(chamber.torque_at(pressure))),
         "marks": [marks.get(p) for p in pressure.tolist()]}
        for title, chamber, marks in known
    ]
    return {"pressure": clock(1e-3 * pressure, pack), "laws": laws}


def forecast_of(forecast: Forecast, pack: Pack) -> dict[str, Any]:
    """A forecast's tip and its band, mm; its angle, degrees, where the recordings hold angles alone."""
    half, factor = forecast.half_width, float(np.degrees(1.0)) if forecast.tip.shape[1] == 1 else 1e3
    edges = None if half is None else [pack.add(factor * (forecast.tip + s * half)) for s in (-1, 1)]
    return {"time": clock(forecast.time, pack), "tip": pack.add(factor * forecast.tip), "band": edges}


def clocks_of(c: Clocks, pack: Pack) -> dict[str, Any]:
    """Motion and pressure over each other, in shares of their ranges; the pressure as moved and as logged."""
    time = c.time[:: -(-c.time.size // MOST_FRAMES)]
    moved = c.clock * (1.0 + c.drift) + c.delay
    motion, pressure = (np.interp(time, t, v) for t, v in ((c.time, c.motion), (moved, c.pressure)))
    motion = motion * (np.sign((motion - motion.mean()) @ (pressure - pressure.mean())) or 1.0)
    level = (c.pressure - c.pressure.min()) / max(float(np.ptp(c.pressure)), 1e-300)
    shown = [np.interp(time, t, level, left=np.nan, right=np.nan) for t in (moved, c.clock)]
    return {"time": clock(time, pack), "motion": pack.add((motion - motion.min()) / max(float(np.ptp(motion)), 1e-300)),
            "moved": pack.add(shown[0]), "logged": pack.add(shown[1])}
