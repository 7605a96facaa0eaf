"""The results of a study as data classes, which metrics, figures and report share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

import numpy as np
import xarray as xr

from pliant.adaptation.result import Adaptation
from pliant.display import Card, Shown
from pliant.failures import NotComputed
from pliant.identification import Band, Experiment, FitResult
from pliant.identification.fit import parameter_dict
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.model.file import model_to_dict
from pliant.plain import by_name, plain, records_of
from pliant.preprocessing.lag_model import body_course, pressure_course
from pliant.preprocessing.sync import Delay
from pliant.reduction import LinkPlacement, OrderResult
from pliant.selection import ModelSelection

Array = np.ndarray
Role = Literal["train", "held_out", "forecast"]


@dataclass(frozen=True)
class RecordOutcome:
    """The comparison of one recording with the model of a fit."""

    name: str
    role: Role
    experiment: Experiment
    modelled: Array  # (T, S, 2) m; (T, S, 1) rad of angles alone
    pressure: Array  # (T, C) modelled inputs behind the valves or motors, in `units`
    metrics: dict[str, Any]
    band: Band | None = None  # prediction band, of a held-out recording
    body: Array | None = None  # (T, n + 2, 2) m, modelled base, first joint and link tips
    inputs: Mapping[str, str] = field(default_factory=dict)  # inputs of the model: name and SI unit; empty: pressures
    baseline: Array | None = None  # as `modelled`, predicted by the plain map of the fit

    def unit_of(self, name: str) -> str:
        """Return the SI unit of the model's input with this name, or of its first input for the empty name."""
        return self.inputs.get(name) or next(iter(self.inputs.values()), "Pa")

    @property
    def units(self) -> tuple[str, ...]:
        """Return the SI units of the model's inputs, in the order of the columns of `pressure`."""
        return tuple(self.inputs.values()) or ("Pa",) * self.pressure.shape[-1]


@dataclass(frozen=True)
class Baseline:
    """A plain map fitted to a fit's training recordings, and its errors on every recording; see `plain_map`."""

    title: str
    degree: int
    lags_s: tuple[float, ...]
    ridge: float
    held_at_edge: bool  # of the training inputs
    inputs: tuple[str, ...]
    coefficients: int
    frames: int
    unit: str  # of the errors: mm or deg
    left_out_error: float | None  # None for a single training frame
    training_error: float
    notes: tuple[str, ...]
    records: dict[str, dict[str, Any]]  # metrics by recording, as of a model
    outside_percent: dict[str, float]  # of each recording's frames beyond the range of the training inputs
    better: tuple[str, ...] = ()  # held-out recordings that it predicts better than the model
    explained: dict[str, float] = field(default_factory=dict)  # fraction of the model's residual there
    suggestion: str = ""  # what that residual suggests


@dataclass(frozen=True)
class FitOutcome:
    """The results of one fit of the study: its parameters and its predictions of each recording."""

    name: str
    title: str
    result: FitResult
    records: tuple[RecordOutcome, ...]
    seconds: float
    not_computed: tuple[NotComputed, ...] = ()  # recordings, bands, ... of this fit
    baseline: Baseline | None = None  # a plain map fitted to the same training recordings

    @property
    def missing(self) -> tuple[NotComputed, ...]:
        """Return the recordings of this fit whose motion could not be computed."""
        there = {r.name for r in self.records}
        return tuple(f for f in self.not_computed if f.record and f.record not in there)

    def record_dicts(self) -> dict[str, dict[str, Any]]:
        """Return the role and the metrics of each recording by its name, with the reason if a result could not be
        computed.
        """
        rows: dict[str, dict[str, Any]] = {r.name: {"role": r.role, **r.metrics} for r in self.records}
        for f in self.not_computed:
            if f.record:
                row = rows.setdefault(f.record, {"role": f.role})
                row["not_computed"] = " ".join(filter(None, (row.get("not_computed"), f.sentence)))
        return rows

    def to_dict(self) -> dict[str, Any]:
        """Return the fit as plain values, for metrics.json."""
        return {
            "title": self.title, "status": self.result.status, "notes": list(self.result.notes),
            "converged": self.result.converged, "bic": self.result.bic, "time_step_s": self.result.time_step,
            "not_computed": plain(self.not_computed), "records": self.record_dicts(),
            "parameters": {p.name: parameter_dict(p) for p in self.result.parameters},
            "timing": {
                "fit_s": self.seconds, "optimiser_s": self.result.seconds, "simulated_sets": self.result.evaluations,
            },
            "model": model_to_dict(self.result.model),
            "covariance": plain(self.result.covariance),
        }


@dataclass(frozen=True)
class Shape:
    """Results of the reduction of one recording with many points along the body to a chain: the body's curvature, and
    the number and placement of the links.
    """

    name: str
    arc_length: Array  # (S,) m
    position: Array  # (T, S, 2) m
    curvature: Array  # (T, S) 1/m
    rest_curvature: Array  # (S,) 1/m
    order: OrderResult
    links: LinkPlacement
    tip_status: str  # how the tip was found


@dataclass(frozen=True)
class Clocks:
    """Correction of a pressure's clock to that of a shape."""

    message: str
    time: Array  # (T,) s
    motion: Array  # (T,) one time series that represents the motion of the shape
    clock: Array  # (P,) s, as logged
    pressure: Array  # (P,)
    delay: float  # s
    drift: float

    @classmethod
    def of(cls, recording: xr.Dataset, found: Delay) -> Clocks:
        """Return the clock correction that `sync` found for a recording, together with the recording's motion and
        pressure on the original clocks.
        """
        motion, pressure = body_course(recording), pressure_course(recording)
        return cls(found.summary(), motion.time, motion.values[:, 0], pressure.time, pressure.values[:, 0],
                   found.delay_s, found.drift)  # fmt: skip


@dataclass(frozen=True)
class Forecast:
    """A prediction for a case that was not recorded."""

    name: str
    title: str
    stated: dict[str, float]  # stated changes, by parameter name
    time: Array  # (T,) s
    tip: Array  # (T, 2 or 3) m; without positions the values of `Experiment.compared`
    numbers: dict[str, float]  # frequency_hz, static_drop_mm, ... with the unit in the name
    interval: dict[str, float] = field(default_factory=dict)  # half-widths at 95 % of the numbers
    half_width: Array | None = None  # as `tip`, of the 95 % band about it
    extrapolates: tuple[str, ...] = ()  # inputs, combinations of inputs and loads beyond the training recordings
    rows: tuple[str, ...] = ()  # names of the columns of `tip` where they are neither positions nor an angle

    @property
    def axes(self) -> tuple[str, ...]:
        """Return the names of the columns of `tip`: x and y, in space z too, or an angle, or `rows`."""
        return self.rows or (("angle",) if self.tip.shape[1] == 1 else tuple("xyz"[: self.tip.shape[1]]))

    @property
    def shown_in(self) -> tuple[str, float]:
        """Return the display unit of the tip ("mm" or "deg"), and the factor to it from the SI unit."""
        return ("mm", 1e3) if self.axes[0] in tuple("xyz") else ("deg", float(np.degrees(1.0)))


class WiringRow(NamedTuple):
    """The result of fitting one wiring of recorded pressures to chambers."""

    name: str
    train_percent: float | None  # mean error of training recordings, % of peak displacement; None: not fitted
    behind: float | None  # how much 2 ln L is below the best wiring's
    reason: str = ""  # why it could not be fitted


@dataclass(frozen=True)
class Wirings:
    """The compared wirings of recorded pressures to chambers, the most likely first."""

    fit: str
    rows: tuple[WiringRow, ...]

    @property
    def winner(self) -> WiringRow:
        """Return the most likely wiring."""
        return self.rows[0]

    @property
    def sentence(self) -> str:
        """Return a sentence on the best wiring and on how much worse the second best is."""
        fitted = [r for r in self.rows if r.train_percent is not None]
        said = (f"Wiring {fitted[0].name!r} fits the training records best, with an error of "
                f"{fitted[0].train_percent:.2f} % of the peak displacement")
        if len(fitted) < 2:
            return f"{said}. No other wiring could be fitted."
        return (f"{said}. The second best of {len(fitted)} is {fitted[1].name!r} with {fitted[1].train_percent:.2f} %; "
                f"its 2 ln L is lower by {fitted[1].behind:.0f}.")

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison of wirings as plain values, for JSON."""
        return {"fit": self.fit, "sentence": self.sentence, "wirings": by_name(self.rows)}

    @classmethod
    def from_dict(cls, content: dict[str, Any] | None) -> Wirings | None:
        """Return the comparison of wirings from the result of `to_dict`; None if `content` is None."""
        return None if content is None else cls(content["fit"], records_of(WiringRow, content["wirings"]))


class Headline(NamedTuple):
    """A sentence on how well the first fit predicts the recordings, and the warnings about this fit."""

    state: Literal["good", "beware", "missed", "open"]  # met; met with warnings; missed; no target was stated
    sentence: str
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, repr=False)
class StudyOutcome(Shown):
    """All results of `pliant run`."""

    name: str
    title: str
    description: str
    model: Model  # of the first fit
    fits: tuple[FitOutcome, ...]
    forecasts: tuple[Forecast, ...] = ()
    shape: Shape | None = None
    verdict: tuple[str, ...] = ()  # sentences with their numbers, the most important first
    findings: dict[str, tuple[str, ...]] = field(default_factory=dict)  # on reading and aligning each recording
    timing: dict[str, float] = field(default_factory=dict)
    provenance: dict[str, str] = field(default_factory=dict)
    model_selection: ModelSelection | None = None
    headline: Headline | None = None
    clocks: dict[str, Clocks] = field(default_factory=dict)  # by recording, if the pressure's clock was corrected
    failed: tuple[NotComputed, ...] = ()  # fits, forecasts and intervals that could not be computed
    run_id: str = ""  # the same in metrics.json and results.nc of a run
    wirings: Wirings | None = None
    adaptations: dict[str, Adaptation] = field(default_factory=dict)  # other days, by the name of the adapted fit
    doubts: tuple[str, ...] = ()  # warnings on the input, see `pliant.preprocessing.plausibility`

    @property
    def not_computed(self) -> tuple[NotComputed, ...]:
        """Return what could not be computed: whole fits and forecasts, then recordings and bands of each fit."""
        return (*self.failed, *(n for f in self.fits for n in f.not_computed))

    @property
    def turns(self) -> bool:
        """Return whether the recordings hold angles and no positions."""
        return any(r.experiment.without_positions for f in self.fits for r in f.records)

    @property
    def axes(self) -> tuple[str, ...]:
        """Return the names of the compared coordinates, see `Experiment.axes`."""
        first = next((r.experiment for f in self.fits for r in f.records), None)
        return tuple("xyz"[: mechanics_of(self.model).dimension]) if first is None else first.axes

    def card(self) -> Card:
        """Return the headline, and a table with the errors of every recording under each fit, for display."""
        rows, unit = [], "deg" if self.turns else "mm"
        mapped = any(f.baseline for f in self.fits)
        for f in self.fits:
            for r in f.records:
                errors = (r.metrics.get(k) for k in (f"rmse_{unit}", "rmse_percent_of_travel", f"max_{unit}"))
                numbers = ["" if v is None else f"{v:.3g}" for v in errors]
                if mapped:
                    error = f.baseline.records.get(r.name, {}).get(f"rmse_{unit}") if f.baseline else None
                    numbers.append("" if error is None else f"{error:.3g}")
                rows.append([r.name, f.title, r.role.replace("_", " "), *numbers])
            empty = [""] * (2 + mapped)
            rows += [[m.record, f.title, m.role.replace("_", " "), "not computed", *empty] for m in f.missing]
        head = ["record", "fit", "role", f"RMSE {unit}", "% of travel", f"largest {unit}"]
        head += [f"plain map {unit}"] if mapped else []
        sentences = (self.headline.sentence, *self.headline.warnings) if self.headline else self.verdict
        return Card(self.title, sentences, head, rows)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of metrics.json: metrics of each recording under the first fit that predicts it, and all
        fits.
        """
        rows = {f.name: f.record_dicts() for f in self.fits}
        whole = [(f.name, r.name) for f in self.fits for r in f.records]
        missing = [(f.name, m.record) for f in self.fits for m in f.missing]
        records: dict[str, Any] = {}
        for fit, name in (*whole, *missing):
            records.setdefault(name, {"fit": fit, **rows[fit][name]})
        return {
            "schema": "pliant-metrics", "schema_version": 1, "run_id": self.run_id, "study": self.name,
            "title": self.title, "description": self.description,
            "headline": plain(self.headline), "verdict": list(self.verdict),
            "records": records,
            "parameters": {p.name: parameter_dict(p) for p in self.fits[0].result.parameters},
            "fits": {f.name: f.to_dict() for f in self.fits},
            "baseline": {f.name: plain(f.baseline) for f in self.fits if f.baseline},
            "model_selection": self.model_selection.to_dict() if self.model_selection else None,
            "wiring": self.wirings.to_dict() if self.wirings else None,
            "order": self.shape.order.to_dict() if self.shape else None,
            "forecasts": {
                f.name: {"title": f.title, "stated": f.stated, **f.numbers, "half_width_95": f.interval,
                         "extrapolates": list(f.extrapolates)}
                for f in self.forecasts
            },
            "adaptations": {k: a.to_dict() for k, a in self.adaptations.items()},
            "findings": plain(self.findings),
            "clocks": {k: {"delay_s": c.delay, "drift": c.drift, "message": c.message} for k, c in self.clocks.items()},
            "not_computed": plain(self.failed),
            "timing": self.timing, "provenance": self.provenance,
        }


def in_recorded_axes(outcome: StudyOutcome, like: Mapping[str, str], signs: Mapping[str, int]) -> StudyOutcome:
    """Return the results of a study with all positions in the axes of the recordings instead of the base frame, for
    tables, figures and files.

    Models and their parameters stay in the base frame, where positive angles bend the body towards -x.

    Parameters
    ----------
    outcome : StudyOutcome
        Results with all positions in the base frame.
    like : dict
        Name of the template recording of each forecast.
    signs : dict
        Direction (1 or -1) of each recording's x axis in the base frame, see `pliant.preprocessing.side`.
    """
    if all(sign > 0 for sign in signs.values()):
        return outcome
    fits = tuple(
        replace(f, records=tuple(turned_record(r) if signs[r.name] < 0 else r for r in f.records)) for f in outcome.fits
    )
    forecasts = tuple(turned_forecast(f) if signs[like[f.name]] < 0 else f for f in outcome.forecasts)
    shape = outcome.shape
    if shape is not None and signs[shape.name] < 0:
        shape = turned_shape(shape)
    return replace(outcome, fits=fits, forecasts=forecasts, shape=shape)


def mirrored(position: np.ndarray) -> np.ndarray:
    """Return positions (..., 2) with the sign of x changed."""
    return position * np.array([-1.0, 1.0])


def turned_record(record: RecordOutcome) -> RecordOutcome:
    """Return the results of a recording with its positions turned by half a turn about the base tangent."""
    return replace(
        record, experiment=record.experiment.turned(), modelled=mirrored(record.modelled),
        band=None if record.band is None else turned_band(record.band),
        body=None if record.body is None else mirrored(record.body),
        baseline=None if record.baseline is None else mirrored(record.baseline),
    )


def turned_band(band: Band) -> Band:
    """Return a prediction band turned by half a turn about the base tangent, so that the limits of x change places."""
    edges = np.stack([mirrored(band.lower), mirrored(band.upper)])
    return replace(band, position=mirrored(band.position), lower=edges.min(axis=0), upper=edges.max(axis=0))


def turned_forecast(forecast: Forecast) -> Forecast:
    """Return the results of a forecast turned by half a turn about the base tangent."""
    return replace(forecast, tip=mirrored(forecast.tip))


def turned_shape(shape: Shape) -> Shape:
    """Return the recorded points along a body, and the links fitted to them, turned by half a turn about the base
    tangent.
    """
    links = replace(
        shape.links, base=mirrored(shape.links.base), tips=mirrored(shape.links.tips),
        rest_angle=-shape.links.rest_angle, joint_angle=-shape.links.joint_angle,
    )
    return replace(
        shape, position=mirrored(shape.position), curvature=-shape.curvature, rest_curvature=-shape.rest_curvature,
        links=links,
    )
