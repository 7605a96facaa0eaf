"""Reader of a study's results from `metrics.json` and `results.nc`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pliant.errors import InputError, clipped
from pliant.failures import NotComputed
from pliant.identification import Band, Experiment, FitResult, ModelSelection, Parameter
from pliant.identification.stage_fit import Step
from pliant.identification.stages import Stage
from pliant.identification.uncertainty import Covariance
from pliant.model import Model
from pliant.model.file import read_model
from pliant.recording.netcdf import read_groups
from pliant.reduction import LinkPlacement, OrderResult
from pliant.simulation import Trace
from pliant.validation.outcome import (
    Clocks,
    FitOutcome,
    Forecast,
    Headline,
    RecordOutcome,
    Shape,
    StudyOutcome,
    Wirings,
)
from pliant.validation.store import FILE

BROKEN = (OSError, ValueError, LookupError, RuntimeError, TypeError, AttributeError, ArithmeticError, StopIteration)
Groups = Mapping[str, xr.Dataset]


def load_outcome(folder: str | Path) -> StudyOutcome:
    """Read the results of `pliant run` from its folder: all numbers, curves and sentences of its report.

    Parameters
    ----------
    folder : str or Path
        Folder with metrics.json and results.nc.

    Raises
    ------
    InputError
        When a file is absent, was not written by `pliant run`, or has another schema.
    """
    folder = Path(folder)
    metrics = metrics_of(folder)
    groups = groups_of(folder)
    if str(metrics.get("run_id", "")) != str(groups["/"].attrs.get("run_id", "")):
        raise InputError(f"{folder}: metrics.json and results.nc are from different runs; run the study again")
    try:
        return restored(metrics, groups)
    except BROKEN as error:
        reason = clipped(f"{type(error).__name__}: {error}")
        raise InputError(f"{folder}: metrics.json and results.nc do not belong together ({reason}); run the study again"
                         ) from None


def metrics_of(folder: Path) -> dict[str, Any]:
    """Return the content of metrics.json; InputError if it cannot be read or was not written by `pliant run`."""
    path = folder / "metrics.json"
    try:
        metrics: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        reason, cure = error.strerror or error, "name a folder that `pliant run` has written"
        if (folder / FILE).exists():
            cure = "a run was interrupted while it replaced its files: run the study again"
        raise InputError(f"cannot read {path}: {reason}; {cure}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is not valid JSON: {clipped(str(error))}; run the study again") from None
    if not isinstance(metrics, dict) or metrics.get("schema") != "pliant-metrics":
        raise InputError(f"{path} is not a metrics.json of `pliant run`")
    return metrics


def groups_of(folder: Path) -> Groups:
    """Return the groups of results.nc, read into memory."""
    path = folder / FILE
    if not path.is_file():
        raise InputError(f"{folder} has no {FILE}: it was written by an older pliant; run the study again")
    loaded = read_groups(path)
    if str(loaded["/"].attrs.get("schema")) != "pliant-results":
        raise InputError(f"{path} is not a results.nc of `pliant run`")
    return loaded


def restored(metrics: dict[str, Any], groups: Groups) -> StudyOutcome:
    """Return the outcome of a study from the content of both files."""
    recordings = {
        str(recording.attrs["name"]): (experiment_of(recording), recording)
        for name, recording in groups.items()
        if name.startswith("/recording_")
    }
    fits = tuple(fit_of(i, name, entry, recordings) for i, (name, entry) in enumerate(metrics["fits"].items()))
    forecasts = tuple(
        forecast_of(n, e, groups[f"/forecast_{k}"]) for k, (n, e) in enumerate(metrics["forecasts"].items())
    )
    stored = metrics["headline"]
    headline = Headline(**{**stored, "warnings": tuple(stored["warnings"])}) if stored else None
    model = fits[0].result.model.with_(name=metrics["study"])
    return StudyOutcome(
        metrics["study"], metrics["title"], metrics["description"], model, fits, forecasts, shape_of(groups),
        tuple(metrics["verdict"]), {k: tuple(v) for k, v in metrics["findings"].items()}, metrics["timing"],
        metrics["provenance"], selection_of(metrics["model_selection"], fits[0].result), headline,
        clocks={n: clocks_of(n, e, groups) for n, e in metrics["clocks"].items()}, failed=failures_of(metrics),
        run_id=metrics.get("run_id", ""), wirings=Wirings.from_dict(metrics.get("wiring")),
    )


def experiment_of(recording: xr.Dataset) -> Experiment:
    """Return a recording as the fit used it."""
    trace = None
    drives = {}
    if "driven" in recording:
        times = recording["pressure_time"].values
        drives = {
            str(c): Trace(times, recording["pressure"].values[:, k]) for k, c in enumerate(recording["driven"].values)
        }
    elif "pressure" in recording:
        trace = Trace(recording["pressure_time"].values, recording["pressure"].values)
    stations = tuple(str(s) for s in recording["station"].values)
    seen: dict[str, Any] = {}
    if "angle" in recording:
        seen = {
            "angle": recording["angle"].values,
            "angle_reference": recording["angle"].attrs["reference"],
            "angles_alone": True,
        }
    place = (
        recording["position"].values
        if "position" in recording
        else np.full((recording.sizes["time"], len(stations), 2), np.nan)
    )
    return Experiment(
        str(recording.attrs["name"]), recording["time"].values, place, stations, recording.attrs["excitation"], trace,
        float(recording.attrs["level"]), drives=drives, x_sign=int(recording.attrs["x_sign"]),
        poses=bool(recording.attrs["poses"]), **seen,
    )


def fit_of(
    i: int, name: str, entry: dict[str, Any], recordings: Mapping[str, tuple[Experiment, xr.Dataset]],
) -> FitOutcome:
    """Return the outcome of fit number `i` with its recordings."""
    result = result_of(entry, read_model(json.dumps(entry["model"]), f"metrics.json, model of fit {name}"))
    records, actuation = [], result.model.actuation
    for record, numbers in entry["records"].items():
        if set(numbers) <= {"role", "not_computed"}:
            continue  # its motion could not be computed
        exp, recording = recordings[record]
        own = recording.isel(fit=i)
        metrics = {key: value for key, value in numbers.items() if key not in ("role", "not_computed")}
        body = own["body"].values if "body" in own and own["body"].notnull().any() else None
        records.append(RecordOutcome(record, numbers["role"], exp, own["modelled"].values,
                                     own["modelled_pressure"].values, metrics, band_of(own, exp), body,
                                     dict(zip(actuation.names, actuation.units, strict=True))))
    return FitOutcome(name, entry["title"], result, tuple(records), entry["timing"]["fit_s"], failures_of(entry))


def failures_of(entry: Mapping[str, Any]) -> tuple[NotComputed, ...]:
    """Return the results that could not be computed, of a fit or of the study."""
    return tuple(NotComputed(**n) for n in entry.get("not_computed", ()))


def result_of(entry: dict[str, Any], model: Model) -> FitResult:
    """Return the result of the optimisation of a fit."""
    parameters = tuple(
        Parameter(name, p["value"], -np.inf if p["lower"] is None else p["lower"],
                  np.inf if p["upper"] is None else p["upper"], p["free"], p["unit"], p["scale"], p["source"], p["std"],
                  p.get("prior"), p.get("prior_std"))
        for name, p in entry["parameters"].items()
    )
    stored = entry["covariance"]
    covariance = None if stored is None else Covariance(**{
        **stored, "names": tuple(stored["names"]), **{k: np.array(stored[k]) for k in ("matrix", "white", "hidden")}})
    return FitResult(
        model, parameters, entry["status"], {}, entry["timing"]["simulated_sets"], entry["timing"]["optimiser_s"],
        entry["converged"], covariance, tuple(entry["notes"]), entry["bic"],
        turns=any("rmse_deg" in r for r in entry["records"].values()),
    )


def band_of(recording: xr.Dataset, exp: Experiment) -> Band | None:
    """Return the prediction band of a recording; None if it has none."""
    level = float(recording["band_level"])
    if np.isnan(level):
        return None
    std, lower, upper = (recording[f"band_{part}"].values for part in ("std", "lower", "upper"))
    return Band(recording["modelled"].values, std, lower, upper, level, *exp.shown_in)


def shape_of(groups: Groups) -> Shape | None:
    """Return the dense shape that determined the chain; None if there is none."""
    if "/shape" not in groups:
        return None
    own, order, links = (groups[name] for name in ("/shape", "/shape_order", "/shape_links"))
    facts: dict[str, Any] = json.loads(order.attrs["json"])
    facts |= {k: tuple(facts[k]) for k in ("orders", "stations_between", "notes")}
    facts["node_arc_length"] = tuple(np.array(nodes) for nodes in facts["node_arc_length"])
    facts |= {k: order[k].values for k in ("time", "max_error", "mean_error")}
    chain: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in json.loads(
        links.attrs["json"]).items()}
    chain |= {str(k): v.values for k, v in links.data_vars.items()}
    arc, position, curvature, rest = (own[k].values for k in ("arc_length", "position", "curvature", "rest_curvature"))
    return Shape(str(own.attrs["name"]), arc, position, curvature, rest, OrderResult(**facts), LinkPlacement(**chain),
                 str(own.attrs["tip_status"]))


def selection_of(content: dict[str, Any] | None, result: FitResult) -> ModelSelection | None:
    """Return a model selection with the content that its table and figure need.

    The fit results of single stages are not stored; `result` stands for each.
    """
    if content is None:
        return None
    steps = [
        Step(Stage(name, r["title"]), None if r["step_ns"] is None else result, tuple(r["free"]), r["train_percent"],
             r["held_out_percent"], r["fit_s"], float("nan") if r["step_ns"] is None else r["step_ns"], r["stands_on"],
             bic=r["bic"], reason=r["reason"], open=r.get("not_determined", ""),
             given=tuple(r.get("as_given", ())))
        for name, r in content["stages"].items()
    ]
    return ModelSelection(tuple(steps), content["chosen"], content["reason"])


def clocks_of(name: str, entry: dict[str, Any], groups: Groups) -> Clocks:
    """Return the correction of a pressure's clock."""
    recording = next(g for k, g in groups.items() if k.startswith("/clocks_") and g.attrs["name"] == name)
    time, motion, clock, pressure = (recording[k].values for k in ("time", "motion", "clock", "pressure"))
    return Clocks(entry["message"], time, motion, clock, pressure, entry["delay_s"], entry["drift"])


def forecast_of(name: str, entry: dict[str, Any], recording: xr.Dataset) -> Forecast:
    """Return a prediction for a case that was not recorded."""
    apart = {"title", "stated", "half_width_95"}
    return Forecast(
        name, entry["title"], entry["stated"], recording["time"].values, recording["tip"].values,
        {k: v for k, v in entry.items() if k not in apart}, entry["half_width_95"],
        recording["half_width"].values if "half_width" in recording else None,
    )
