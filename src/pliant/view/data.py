"""Arrays that the report's plots show, in display units, and how they are packed into the page."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pliant.identification.experiment import Experiment
from pliant.mechanics import mechanics_of
from pliant.numerics.curve import arc_lengths
from pliant.units import input_words, shown_in
from pliant.validation.curves import autocorrelation, evenly_spaced, laws_of, pressures_of
from pliant.validation.draw import moves_torque
from pliant.validation.outcome import Clocks, FitOutcome, Forecast, RecordOutcome, Shape, StudyOutcome

Array = np.ndarray
MOST_NUMBERS = 1_200_000  # limit for all recordings of a page; above it, only every second (third, ...) frame is shown
MOST_FRAMES = 4000  # limit for a plot of the dense shape
PROFILES, PLACES = 60, 120  # curvature profiles, and positions along each
LEVELS = 65_000  # number of integer levels for an array's range; -32768 marks missing values
GAP = -32_768
MARGIN = 0.3  # of the range of measured and modelled values: beyond, the plain map is not drawn


def page_data(outcome: StudyOutcome, pack: Pack) -> dict[str, Any]:
    """Add all arrays of the page to `pack`. Return their descriptions, which say where each lies in the page's data,
    grouped by what the arrays show.
    """
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
    """Return k such that a page with only every k-th frame of the recordings stays below its size limit."""
    numbers = 0
    for fit in outcome.fits:
        for r in fit.records:
            each = r.experiment.compared[0].size
            numbers += len(r.modelled) * (2 * each + (2 * each if r.band is not None else 0)
                                          + (0 if r.baseline is None else each)
                                          + (0 if r.body is None else r.body[0].size))
    return max(1, int(np.ceil(numbers / MOST_NUMBERS)))


def measured_of(record: RecordOutcome, every: int, pack: Pack) -> dict[str, Any]:
    """Return the measured motion [mm, degrees for angles alone] and inputs [kPa, N, mm or rad] of a recording."""
    exp, inputs = record.experiment, []
    for name, trace in exp.traces.items():
        pressure = np.interp(exp.time[::every], trace.time, trace.pressure, left=np.nan, right=np.nan)
        factor, _ = shown_in(record.unit_of(name))
        inputs.append({"name": f"measured, {name}" if name else "measured", "value": pack.add(factor * pressure)})
    word, unit = input_words(record.units)
    return {
        "stations": list(exp.stations), "shown": evenly_spaced(len(exp.stations), 3), "kind": exp.excitation,
        "time": clock(exp.time[::every], pack), "position": pack.add(exp.shown_in[1] * exp.compared[::every]),
        "inputs": inputs, "input": word, "unit": unit,
        "level": shown_in(record.units[0])[0] * exp.level if exp.nominal else None,
    }


def grown_of(position: Array, exp: Experiment, every: int, pack: Pack) -> dict[str, Any] | None:
    """Return the growth of the body's length since its first frames [mm], along arcs through the stations.

    The result is None for a single station or for angles alone.
    """
    if exp.without_positions or len(exp.stations) < 2:
        return None
    length = arc_lengths(position)
    return pack.add(1e3 * (length - np.nanmedian(length[:5]))[::every]) if np.isfinite(length[:5]).any() else None


def clock(time: Array, pack: Pack) -> dict[str, Any]:
    """Add an array of times [s] to `pack` in full precision (float64). Return its description, which says where it lies
    in the page's data.
    """
    note = {"at": pack.used, "shape": [time.size], "kind": "float64"}
    pack.put(np.asarray(time, dtype="<f8").tobytes())
    return note


def modelled_of(record: RecordOutcome, every: int, pack: Pack) -> dict[str, Any]:
    """Return the motion that a fit predicts for a recording [mm, or degrees for angles alone].

    It includes the band of the prediction and the autocorrelation of the last station's residual.
    """
    exp = record.experiment
    factor = exp.shown_in[1]
    residual = factor * (record.modelled[:, -1] - exp.last_station)
    lag, correlation = zip(*(autocorrelation(exp.time, r) for r in residual.T), strict=True)
    count = np.isfinite(residual[:, 0]).sum()
    scales = [shown_in(unit)[0] for unit in record.units]
    body = record.body if record.body is not None else np.concatenate(
        [np.zeros((exp.time.size, 1, exp.compared.shape[2])), record.modelled], axis=1)
    return {
        "role": record.role, "position": pack.add(factor * record.modelled[::every]),
        "plain": None if record.baseline is None else pack.add(factor * visible(record)[::every]),
        "body": pack.add(1e3 * body[::every]), "pressure": pack.add(scales * record.pressure[::every]),
        "driven": list(record.inputs) if len(record.inputs) > 1 else [],
        "band": [pack.add(factor * edge[::every]) for edge in (record.band.lower, record.band.upper)]
        if record.band is not None else None,
        "level": record.band.level if record.band is not None else None,
        "lag": clock(lag[0], pack), "correlation": pack.add(np.stack(correlation, axis=1)),
        "white": float(1.96 / np.sqrt(max(count, 1))),
    }


def visible(record: RecordOutcome) -> Array:
    """Return the prediction (T, S, d) of the plain map, NaN where it is so far from measured and modelled values that
    it would set the scale of the plot.
    """
    points = np.concatenate([record.experiment.compared, record.modelled])
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    margin, baseline = MARGIN * (high - low), np.asarray(record.baseline)
    return np.where((baseline >= low - margin) & (baseline <= high + margin), baseline, np.nan)


def shape_of(shape: Shape, pack: Pack) -> dict[str, Any]:
    """Return the shape error over time for each number of segments, and curvature profiles along the body in many
    frames.
    """
    order = shape.order
    stretch = -(-order.time.size // MOST_FRAMES)
    starts = np.arange(0, order.time.size, stretch)  # start of each interval, whose largest error is shown
    frames = np.unique(np.linspace(0, len(shape.curvature) - 1, min(PROFILES, len(shape.curvature))).astype(int))
    stations = np.unique(np.linspace(0, shape.arc_length.size - 1, min(PLACES, shape.arc_length.size)).astype(int))
    return {
        "name": shape.name, "orders": list(order.orders), "used": shape.links.n,
        "bound": None if order.bound is None else 1e3 * order.bound, "time": clock(order.time[starts], pack),
        "error": pack.add(np.stack([1e3 * np.maximum.reduceat(e, starts) for e in order.max_error], axis=1)),
        "arc": clock(1e3 * shape.arc_length[stations], pack),
        "curvature": pack.add(shape.curvature[np.ix_(frames, stations)].T),
        "rest": pack.add(shape.rest_curvature[stations]), "frames": len(shape.curvature),
    }


def torque_of(fits: Sequence[FitOutcome], pack: Pack) -> dict[str, Any]:
    """Return for the page the torque law of each fit, torque [mN m] against pressure [kPa], with a mark at the highest
    pressure of each of its recordings.
    """
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
    """Return the predicted motion of the tip in a forecast, with its band [mm, or degrees for angles alone]."""
    half, factor = forecast.half_width, forecast.shown_in[1]
    edges = None if half is None else [pack.add(factor * (forecast.tip + s * half)) for s in (-1, 1)]
    return {"time": clock(forecast.time, pack), "tip": pack.add(factor * forecast.tip), "band": edges}


def clocks_of(c: Clocks, pack: Pack) -> dict[str, Any]:
    """Return the body's motion and the pressure, each scaled to 0 to 1, on one time axis [s]. The pressure is given
    twice: by the clock of its log, and by the corrected clock.
    """
    time = c.time[:: -(-c.time.size // MOST_FRAMES)]
    moved = c.clock * (1.0 + c.drift) + c.delay
    motion, pressure = (np.interp(time, t, v) for t, v in ((c.time, c.motion), (moved, c.pressure)))
    motion = motion * (np.sign((motion - motion.mean()) @ (pressure - pressure.mean())) or 1.0)
    level = (c.pressure - c.pressure.min()) / max(float(np.ptp(c.pressure)), 1e-300)
    logs = [np.interp(time, t, level, left=np.nan, right=np.nan) for t in (moved, c.clock)]
    return {"time": clock(time, pack), "motion": pack.add((motion - motion.min()) / max(float(np.ptp(motion)), 1e-300)),
            "moved": pack.add(logs[0]), "logged": pack.add(logs[1])}


@dataclass
class Pack:
    """A collection of arrays packed into one block of bytes for a page. The description of an array says where in the
    block it is.

    Values are rounded to 1/65 000 of their range, such as 3 um for 0.2 m, and stored as differences along the first
    axis, which compress well.
    """

    parts: list[bytes] = field(default_factory=list)
    used: int = 0

    def add(self, values: Any) -> dict[str, Any]:
        """Add an array of any shape and return its description: position in the data, shape and scale."""
        array = np.asarray(values, dtype=float)
        finite = np.isfinite(array)
        low, high = (float(f(array[finite])) if finite.any() else 0.0 for f in (np.min, np.max))
        scale = (high - low) / LEVELS or 1.0
        levels = np.full(array.shape, GAP, dtype=np.int64)
        levels[finite] = np.rint((array[finite] - low) / scale) - LEVELS // 2
        steps = np.diff(levels, axis=0, prepend=0).astype(np.uint16)  # differences may overflow, which their sum undoes
        note = {"at": self.used, "shape": list(array.shape), "low": low, "scale": scale}
        self.put(steps.astype("<u2").tobytes())
        return note

    def put(self, content: bytes) -> None:
        """Append raw bytes to the packed data; their number must be even."""
        self.parts.append(content)
        self.used += len(content)

    def text(self) -> str:
        """Return all arrays as one compressed block in base64; the same arrays give the same text."""
        return base64.b64encode(zlib.compress(b"".join(self.parts), 9)).decode()
