"""The file `results.nc` of a study's measured and modelled motion: written by a run, read with `metrics.json`."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pliant.adaptation.result import Adaptation
from pliant.equations.observation import FURTHER
from pliant.errors import InputError, clipped
from pliant.failures import NotComputed
from pliant.files import content_of, whole
from pliant.identification import Band, Experiment, FitResult, Parameter
from pliant.identification.experiment import FurtherRows
from pliant.identification.uncertainty import Covariance
from pliant.model import Model
from pliant.model.file import read_model
from pliant.plain import plain, record_of
from pliant.recording.inputs import CUTOFF
from pliant.recording.netcdf import read_groups
from pliant.recording.rules import CONSTANTS
from pliant.reduction import LinkPlacement, OrderResult
from pliant.selection import ModelSelection
from pliant.simulation import BaseMotion, Trace
from pliant.units import input_words
from pliant.validation.outcome import (
    Baseline,
    Clocks,
    FitOutcome,
    Forecast,
    Headline,
    RecordOutcome,
    Shape,
    StudyOutcome,
    Wirings,
)

Array = np.ndarray
FILE = "results.nc"
SPACE = ("time", "station", "axis")
BROKEN = (OSError, ValueError, LookupError, RuntimeError, TypeError, AttributeError, ArithmeticError, StopIteration)
Groups = Mapping[str, xr.Dataset]


def save_results(outcome: StudyOutcome, folder: Path) -> Path:
    """Write ``results.nc`` with groups of arrays: one for each recording with its motion under all fits, those of the
    shape that determined the links, and one for each forecast.

    Positions are in m, angles in rad, times in s, and inputs in the SI units of their attribute. Numbers in
    metrics.json are not repeated.
    """
    about = {"schema": "pliant-results", "schema_version": 1, "run_id": outcome.run_id}
    groups: dict[str, xr.Dataset] = {"/": xr.Dataset(attrs=about)}
    named = {r.name: r for f in outcome.fits for r in f.records}
    for k, record in enumerate(named.values()):
        measured = recorded(record.experiment, record.unit_of)
        groups[f"/recording_{k}"] = measured.assign(modelled(outcome.fits, record.experiment))
    if outcome.shape:
        groups |= shaped(outcome.shape)
    for k, f in enumerate(outcome.forecasts):
        groups[f"/forecast_{k}"] = forecast_dataset(f)
    for k, (name, c) in enumerate(outcome.clocks.items()):
        groups[f"/clocks_{k}"] = xr.Dataset(
            {"time": ("frame", c.time, {"units": "s"}), "motion": ("frame", c.motion),
             "clock": ("sample", c.clock, {"units": "s"}), "pressure": ("sample", c.pressure)}, attrs={"name": name})
    packed = {"zlib": True, "complevel": 1, "shuffle": True}
    encoding = {
        path: {str(v): packed for v, a in recording.data_vars.items() if a.ndim} for path, recording in groups.items()
    }
    with whole(folder / FILE) as draft:
        xr.DataTree.from_dict(groups).to_netcdf(draft, engine="h5netcdf", encoding=encoding)
    return folder / FILE


def in_metres(dims: Sequence[str], values: Array, name: str = "") -> tuple[Sequence[str], Array, dict[str, str]]:
    """Return a variable of an xarray data set with the unit m and, if given, a long name."""
    return dims, values, {"units": "m", **({"long_name": name} if name else {})}


def of_inputs(units: Sequence[str]) -> dict[str, str]:
    """Return the netCDF attributes (units, long name) of a variable whose columns are inputs of the model."""
    listed = units if len(set(units)) > 1 else units[:1]
    kind = input_words(units)[0].replace("pressure", "gauge pressure")
    return {"units": ", ".join(listed), "long_name": f"measured {kind}"}


def names_of_inputs(units: Collection[str]) -> tuple[str, str]:
    """Return the name of the variable that holds inputs of these SI units, and that of their time, as in recordings."""
    return ("pressure", "pressure_time") if set(units) <= {"Pa"} else ("actuation", "input_time")


def recorded(exp: Experiment, unit_of: Callable[[str], str] = lambda _name: "Pa") -> xr.Dataset:
    """Return the measured motion and inputs of a recording; `unit_of` returns the SI unit of an input by name."""
    variables: dict[str, Any] = {}
    if exp.alone in exp.further:
        rows = exp.further[exp.alone]
        about_rows = {"units": "1", "long_name": f"measured {exp.alone}", "reference": rows.reference}
        variables[exp.alone] = (SPACE[: rows.values.ndim], rows.values, about_rows)
        variables[f"{exp.alone}{CONSTANTS}"] = (("station", "constant"), rows.constants, {"units": "SI"})
    elif exp.alone:
        about_angle = {"units": "rad", "long_name": "measured angle", "reference": exp.angle_reference}
        variables["angle"] = (("time", "station"), exp.compared[..., 0], about_angle)
    else:
        variables["position"] = in_metres(SPACE, exp.position, "measured position")
    if exp.pressure is not None:
        samples = exp.pressure.pressure
        if exp.drives:
            samples = np.stack([t.pressure for t in exp.drives.values()], axis=1)
            variables["driven"] = ("driven", list(exp.drives), {"long_name": "input of the model"})
        units = [unit_of(name) for name in exp.drives or ("",)]
        name, clock = names_of_inputs(units)
        variables[name] = ((clock, "driven")[: samples.ndim], samples, of_inputs(units))
        variables[clock] = (clock, exp.pressure.time, {"units": "s"})
    if exp.base is not None:
        turn = "base_angle" if exp.dimension == 2 else "base_quaternion"
        how = {} if exp.base.cutoff is None else {CUTOFF: exp.base.cutoff}
        variables["base_position"] = (("base_time", "axis"), exp.base.position, {"units": "m"} | how)
        variables[turn] = (("base_time", "component"), exp.base.turn, {"units": "rad" if exp.dimension == 2 else "1"})
        variables["base_time"] = ("base_time", exp.base.time, {"units": "s"})
    about = {"name": exp.name, "excitation": exp.excitation, "level": exp.level, "x_sign": exp.x_sign,
             "poses": int(exp.poses)}
    coordinates = {"time": ("time", exp.time, {"units": "s"}), "station": list(exp.stations), "axis": list(exp.axes)}
    return xr.Dataset(variables, coordinates, about)


def modelled(fits: Sequence[FitOutcome], exp: Experiment) -> dict[str, Any]:
    """Return the modelled motion of a recording under every fit, with NaN where a fit does not use the recording or has
    no band.
    """
    rows = [next((r for r in f.records if r.name == exp.name), None) for f in fits]
    variables: dict[str, Any] = {"fit": [f.name for f in fits]}

    def stack(name: str, dims: tuple[str, ...], units: str, values: list[Array | None]) -> None:
        shape = next((v.shape for v in values if v is not None), None)
        if shape is not None:
            whole = np.stack([np.full(shape, np.nan) if v is None else v for v in values])
            variables[name] = (("fit", *dims), whole, {"units": units})

    unit = "rad" if exp.without_positions else "m"
    stack("modelled", SPACE, unit, [r.modelled if r else None for r in rows])
    units = next(r.units for r in rows if r)
    variable, listed = f"modelled_{names_of_inputs(units)[0]}", of_inputs(units)["units"]
    stack(variable, ("time", "input"), listed, [r.pressure if r else None for r in rows])
    stack("baseline", SPACE, unit, [r.baseline if r else None for r in rows])
    stack("body", ("time", "point", "axis"), "m", [r.body if r else None for r in rows])
    for part in ("std", "lower", "upper"):
        stack(f"band_{part}", SPACE, unit, [getattr(r.band, part) if r and r.band else None for r in rows])
    variables["band_level"] = ("fit", [r.band.level if r and r.band else np.nan for r in rows], {"units": "1"})
    return variables


def shaped(shape: Shape) -> dict[str, xr.Dataset]:
    """Return three groups of the file: recorded points along the body with their curvature, the errors of each number
    of links, and the chosen links.
    """
    profile = {"arc_length": ("place", shape.arc_length, {"units": "m"}),
           "position": in_metres(("frame", "place", "axis"), shape.position),
           "curvature": (("whole_frame", "place"), shape.curvature, {"units": "1/m"}),
           "rest_curvature": ("place", shape.rest_curvature, {"units": "1/m"})}
    order = {"time": ("time", shape.order.time, {"units": "s"}),
             **{k: in_metres(("order", "time"), getattr(shape.order, k)) for k in ("max_error", "mean_error")}}
    links = {name: v for name, v in vars(shape.links).items() if isinstance(v, np.ndarray)}
    return {
        "/shape": xr.Dataset(profile, attrs={"name": shape.name, "tip_status": shape.tip_status}),
        "/shape_order": xr.Dataset(order, attrs={"json": json.dumps(plain(shape.order, order))}),
        "/shape_links": xr.Dataset(
            {name: ([f"{name}_{k}" for k in range(v.ndim)], v) for name, v in links.items()},
            attrs={"json": json.dumps(plain(shape.links, links))}),
    }


def forecast_dataset(forecast: Forecast) -> xr.Dataset:
    """Return the predicted motion of the tip and the half-width of its band, for a forecast, as a data set."""
    units = {"units": "m" if forecast.shown_in[0] == "mm" else "rad"}
    variables: dict[str, Any] = {"tip": (("time", "axis"), forecast.tip, units)}
    if forecast.half_width is not None:
        variables["half_width"] = (("time", "axis"), forecast.half_width, units)
    about = {"name": forecast.name, **({"rows": json.dumps(forecast.rows)} if forecast.rows else {})}
    return xr.Dataset(variables, {"time": ("time", forecast.time, {"units": "s"})}, about)


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


def load_fit(folder: Path, name: str = "") -> tuple[str, str, FitResult]:
    """Read one fit of a run from its folder, the first one by default. Return its name, its title and its result.

    Raises
    ------
    InputError
        When the folder was not written by `pliant run`, or has no such fit.
    """
    fits = metrics_of(folder)["fits"]
    name = name or next(iter(fits))
    if name not in fits:
        raise InputError(f"{folder} has no fit {name!r}: it has {', '.join(fits)}")
    entry = fits[name]
    try:
        result = result_of(entry, read_model(json.dumps(entry["model"]), f"metrics.json, model of fit {name}"))
        unit, factor = result.shown_in
        rmse = {n: r[f"rmse_{unit}"] / factor for n, r in entry["records"].items()
                if r["role"] == "train" and f"rmse_{unit}" in r}  # fmt: skip
    except BROKEN as error:
        reason = clipped(f"{type(error).__name__}: {error}")
        raise InputError(f"{folder}: fit {name} of metrics.json cannot be read ({reason}); run the study again"
                         ) from None
    return name, entry["title"], replace(result, rmse=rmse)


def held_out_errors(folder: Path, name: str) -> tuple[float, ...]:
    """Return the RMS errors [m; angles: rad] of the held-out recordings of one fit of a run, from its folder."""
    records = metrics_of(folder)["fits"][name]["records"].values()
    rows = [r for r in records if r["role"] == "held_out"]
    return tuple(r[f"rmse_{unit}"] / factor for r in rows for unit, factor in (("mm", 1e3), ("deg", np.degrees(1.0)))
                 if r.get(f"rmse_{unit}") is not None)  # fmt: skip


def metrics_of(folder: Path) -> dict[str, Any]:
    """Return the content of metrics.json; InputError if it cannot be read or was not written by `pliant run`."""
    path = folder / "metrics.json"
    try:
        metrics: dict[str, Any] = json.loads(content_of(path, "result"))
    except InputError as error:
        cure = "name a folder that `pliant run` has written"
        if (folder / FILE).exists():
            cure = "a run was interrupted while it replaced its files: run the study again"
        raise InputError(f"{error}; {cure}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is not valid JSON: {clipped(str(error))}; run the study again") from None
    if not isinstance(metrics, dict) or metrics.get("schema") != "pliant-metrics":
        raise InputError(f"{path} is not a metrics.json of `pliant run`: name a folder that it has written")
    return metrics


def groups_of(folder: Path) -> Groups:
    """Read results.nc from the folder of a run, and return its groups by name."""
    path = folder / FILE
    if not path.is_file():
        raise InputError(f"{folder} has no {FILE}: it was written by an older pliant; run the study again")
    loaded = read_groups(path)
    if str(loaded["/"].attrs.get("schema")) != "pliant-results":
        raise InputError(f"{path} is not a results.nc of `pliant run`: name a folder that it has written")
    return loaded


def restored(metrics: dict[str, Any], groups: Groups) -> StudyOutcome:
    """Return the results of a study from the content of metrics.json and results.nc."""
    recordings = {
        str(recording.attrs["name"]): (experiment_of(recording), recording)
        for name, recording in groups.items()
        if name.startswith("/recording_")
    }
    maps = {name: record_of(Baseline, entry) for name, entry in metrics.get("baseline", {}).items()}
    fits = tuple(replace(fit_of(i, name, entry, recordings), baseline=maps.get(name))
                 for i, (name, entry) in enumerate(metrics["fits"].items()))
    forecasts = tuple(
        forecast_of(n, e, groups[f"/forecast_{k}"]) for k, (n, e) in enumerate(metrics["forecasts"].items())
    )
    stored = metrics["headline"]
    headline = record_of(Headline, stored) if stored else None
    model = fits[0].result.model.with_(name=metrics["study"])
    return StudyOutcome(
        metrics["study"], metrics["title"], metrics["description"], model, fits, forecasts, shape_of(groups),
        tuple(metrics["verdict"]), {k: tuple(v) for k, v in metrics["findings"].items()}, metrics["timing"],
        metrics["provenance"], selection_of(metrics["model_selection"], fits), headline,
        clocks={n: clocks_of(n, e, groups) for n, e in metrics["clocks"].items()}, failed=failures_of(metrics),
        run_id=metrics.get("run_id", ""), wirings=Wirings.from_dict(metrics.get("wiring")),
        adaptations={n: Adaptation.from_dict(e, next(f.result for f in fits if f.name == n))
                     for n, e in metrics.get("adaptations", {}).items()},
    )


def experiment_of(recording: xr.Dataset) -> Experiment:
    """Return a recording stored in results.nc as the `Experiment` that the fits used."""
    arrays = {str(name): variable.values for name, variable in recording.variables.items()}
    trace, drives = None, {}
    name, clock = ("actuation", "input_time") if "actuation" in arrays else ("pressure", "pressure_time")
    if "driven" in arrays:
        columns = zip(arrays["driven"], arrays[name].T, strict=True)
        drives = {str(input_name): Trace(arrays[clock], samples) for input_name, samples in columns}
    elif name in arrays:
        trace = Trace(arrays[clock], arrays[name])
    stations = tuple(str(s) for s in arrays["station"])
    angles: dict[str, Any] = {}
    if "angle" in arrays:
        reference = recording["angle"].attrs["reference"]
        angles = {"angle": arrays["angle"], "angle_reference": reference, "angles_alone": True}
    further = {n: FurtherRows(arrays[n], arrays[n + CONSTANTS], reference=recording[n].attrs["reference"])
               for n in FURTHER if n in arrays}  # fmt: skip
    size = next((rows.columns.shape[2] for rows in further.values()), 2)
    position = arrays.get("position", np.full((recording.sizes["time"], len(stations), size), np.nan))
    base = None
    if "base_time" in arrays:
        flat = "base_angle" in arrays
        turn = {"angle": arrays["base_angle"][:, 0]} if flat else {"quaternion": arrays["base_quaternion"]}
        cutoff = recording["base_position"].attrs.get(CUTOFF)
        base = BaseMotion(arrays["base_time"], arrays["base_position"], **turn, cutoff=cutoff)
    return Experiment(
        str(recording.attrs["name"]), arrays["time"], position, stations, recording.attrs["excitation"], trace,
        float(recording.attrs["level"]), drives=drives, x_sign=int(recording.attrs["x_sign"]), base=base,
        poses=bool(recording.attrs["poses"]), further=further, **angles,
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
        under_fit = recording.isel(fit=i)
        metrics = {key: value for key, value in numbers.items() if key not in ("role", "not_computed")}
        body, baseline = (under_fit[k].values if k in under_fit and under_fit[k].notnull().any() else None
                          for k in ("body", "baseline"))
        records.append(RecordOutcome(record, numbers["role"], exp, under_fit["modelled"].values,
                                     modelled_inputs(under_fit), metrics, band_of(under_fit, exp), body,
                                     dict(zip(actuation.names, actuation.units, strict=True)), baseline))
    return FitOutcome(name, entry["title"], result, tuple(records), entry["timing"]["fit_s"], failures_of(entry))


def modelled_inputs(recording: xr.Dataset) -> Array:
    """Return the modelled inputs (T, C) [SI] of a recording stored in results.nc."""
    return recording["modelled_actuation" if "modelled_actuation" in recording else "modelled_pressure"].values


def failures_of(entry: Mapping[str, Any]) -> tuple[NotComputed, ...]:
    """Return the results that could not be computed, as stored in metrics.json for one fit or for the whole study."""
    return tuple(NotComputed(**n) for n in entry.get("not_computed", ()))


def result_of(entry: dict[str, Any], model: Model) -> FitResult:
    """Return the result of the optimisation of a fit."""
    parameters = tuple(
        Parameter(name, p["value"], -np.inf if p["lower"] is None else p["lower"],
                  np.inf if p["upper"] is None else p["upper"], p["free"], p["unit"], p["scale"], p["source"], p["std"],
                  p.get("prior"), p.get("prior_std"))
        for name, p in entry["parameters"].items()
    )
    covariance = None if entry["covariance"] is None else Covariance.from_dict(entry["covariance"])
    return FitResult(
        model, parameters, entry["status"], {}, entry["timing"]["simulated_sets"], entry["timing"]["optimiser_s"],
        entry["converged"], covariance, tuple(entry["notes"]), entry["bic"],
        turns=any("rmse_deg" in r for r in entry["records"].values()), time_step=entry["time_step_s"],
    )


def band_of(recording: xr.Dataset, exp: Experiment) -> Band | None:
    """Return the prediction band of a recording; None if it has none."""
    level = float(recording["band_level"])
    if np.isnan(level):
        return None
    std, lower, upper = (recording[f"band_{part}"].values for part in ("std", "lower", "upper"))
    return Band(recording["modelled"].values, std, lower, upper, level, *exp.shown_in)


def shape_of(groups: Groups) -> Shape | None:
    """Return the recorded points along the body and the links fitted to them; None if the study has none."""
    if "/shape" not in groups:
        return None
    body, order, links = (groups[name] for name in ("/shape", "/shape_order", "/shape_links"))
    facts, chain = (json.loads(group.attrs["json"]) | {str(k): v.values for k, v in group.variables.items()}
                    for group in (order, links))
    arc, position, curvature, rest = (body[k].values for k in ("arc_length", "position", "curvature", "rest_curvature"))
    return Shape(str(body.attrs["name"]), arc, position, curvature, rest, record_of(OrderResult, facts),
                 record_of(LinkPlacement, chain), str(body.attrs["tip_status"]))


def selection_of(content: dict[str, Any] | None, fits: Sequence[FitOutcome]) -> ModelSelection | None:
    """Return the model selection stored in metrics.json; None if there is none."""
    if content is None:
        return None
    (result,) = (fit.result for fit in fits if fit.name == "model_selection")
    return ModelSelection.from_dict(content, result)


def clocks_of(name: str, entry: dict[str, Any], groups: Groups) -> Clocks:
    """Return the stored correction of a pressure's clock to the clock of the shape."""
    recording = next(g for k, g in groups.items() if k.startswith("/clocks_") and g.attrs["name"] == name)
    time, motion, clock, pressure = (recording[k].values for k in ("time", "motion", "clock", "pressure"))
    return Clocks(entry["message"], time, motion, clock, pressure, entry["delay_s"], entry["drift"])


def forecast_of(name: str, entry: dict[str, Any], recording: xr.Dataset) -> Forecast:
    """Return a prediction for a case that was not recorded."""
    apart = {"title", "stated", "half_width_95", "extrapolates"}
    return Forecast(
        name, entry["title"], entry["stated"], recording["time"].values, recording["tip"].values,
        {k: v for k, v in entry.items() if k not in apart}, entry["half_width_95"],
        recording["half_width"].values if "half_width" in recording else None, tuple(entry.get("extrapolates", ())),
        tuple(json.loads(recording.attrs.get("rows", "[]"))),
    )
