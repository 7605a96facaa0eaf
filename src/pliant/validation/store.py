"""Writer of `results.nc`, which stores a study's measured and modelled motion so that figures can be drawn later."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pliant.files import whole
from pliant.identification import Experiment
from pliant.validation.outcome import FitOutcome, Forecast, Shape, StudyOutcome
from pliant.validation.wording import input_words

Array = np.ndarray
FILE = "results.nc"
SPACE = ("time", "station", "axis")


def save_results(outcome: StudyOutcome, folder: Path) -> Path:
    """Write ``results.nc`` with a group for each recording and all its fits, the dense shape and each forecast.

    Positions are in m, angles in rad, times in s, and inputs in the SI units of their attribute. Numbers in
    metrics.json are not repeated.
    """
    about = {"schema": "pliant-results", "schema_version": 1, "run_id": outcome.run_id}
    groups: dict[str, xr.Dataset] = {"/": xr.Dataset(attrs=about)}
    named = {r.name: r for f in outcome.fits for r in f.records}
    for k, one in enumerate(named.values()):
        groups[f"/recording_{k}"] = recorded(one.experiment, one.unit_of).assign(modelled(outcome.fits, one.experiment))
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
    """Return the attributes of a variable whose columns are inputs: their common unit, or the unit of each."""
    shown = units if len(set(units)) > 1 else units[:1]
    kind = input_words(units)[0].replace("pressure", "gauge pressure")
    return {"units": ", ".join(shown), "long_name": f"measured {kind}"}


def recorded(exp: Experiment, unit_of: Callable[[str], str] = lambda _name: "Pa") -> xr.Dataset:
    """Return the measured motion and inputs of a recording; `unit_of` returns the SI unit of an input by name."""
    variables: dict[str, Any] = {}
    if exp.without_positions:
        about_angle = {"units": "rad", "long_name": "measured angle", "reference": exp.angle_reference}
        variables["angle"] = (("time", "station"), exp.compared[..., 0], about_angle)
    else:
        variables["position"] = in_metres(SPACE, exp.position, "measured position")
    if exp.pressure is not None:
        samples = exp.pressure.pressure
        if exp.drives:
            samples = np.stack([t.pressure for t in exp.drives.values()], axis=1)
            variables["driven"] = ("driven", list(exp.drives), {"long_name": "input of the model"})
        dims, units = ("pressure_time", "driven")[: samples.ndim], [unit_of(name) for name in exp.drives or ("",)]
        variables["pressure"] = (dims, samples, of_inputs(units))
        variables["pressure_time"] = ("pressure_time", exp.pressure.time, {"units": "s"})
    about = {"name": exp.name, "excitation": exp.excitation, "level": exp.level, "x_sign": exp.x_sign,
             "poses": int(exp.poses)}
    axes = ["angle"] if exp.without_positions else list("xyz"[: exp.dimension])
    coordinates = {"time": ("time", exp.time, {"units": "s"}), "station": list(exp.stations), "axis": axes}
    return xr.Dataset(variables, coordinates, about)


def modelled(fits: Sequence[FitOutcome], exp: Experiment) -> dict[str, Any]:
    """Return the motion under every fit; NaN if a fit does not use the recording or has no band."""
    rows = [next((r for r in f.records if r.name == exp.name), None) for f in fits]
    found: dict[str, Any] = {"fit": [f.name for f in fits]}

    def stack(name: str, dims: tuple[str, ...], units: str, values: list[Array | None]) -> None:
        shape = next((v.shape for v in values if v is not None), None)
        if shape is not None:
            whole = np.stack([np.full(shape, np.nan) if v is None else v for v in values])
            found[name] = (("fit", *dims), whole, {"units": units})

    unit = "rad" if exp.without_positions else "m"
    stack("modelled", SPACE, unit, [r.modelled if r else None for r in rows])
    units = next(r.units for r in rows if r)
    stack("modelled_pressure", ("time", "input"), of_inputs(units)["units"], [r.pressure if r else None for r in rows])
    stack("body", ("time", "point", "axis"), "m", [r.body if r else None for r in rows])
    for part in ("std", "lower", "upper"):
        stack(f"band_{part}", SPACE, unit, [getattr(r.band, part) if r and r.band else None for r in rows])
    found["band_level"] = ("fit", [r.band.level if r and r.band else np.nan for r in rows], {"units": "1"})
    return found


def shaped(shape: Shape) -> dict[str, xr.Dataset]:
    """Return the dense shape, its orders and its links, each as a group of the file."""
    own = {"arc_length": ("place", shape.arc_length, {"units": "m"}),
           "position": in_metres(("frame", "place", "axis"), shape.position),
           "curvature": (("whole_frame", "place"), shape.curvature, {"units": "1/m"}),
           "rest_curvature": ("place", shape.rest_curvature, {"units": "1/m"})}
    order = {"time": ("time", shape.order.time, {"units": "s"}),
             **{k: in_metres(("order", "time"), getattr(shape.order, k)) for k in ("max_error", "mean_error")}}
    return {
        "/shape": xr.Dataset(own, attrs={"name": shape.name, "tip_status": shape.tip_status}),
        "/shape_order": xr.Dataset(order, attrs={"json": plain(shape.order, set(order))}),
        "/shape_links": xr.Dataset(
            {f.name: ([f"{f.name}_{k}" for k in range(v.ndim)], v) for f in fields(shape.links)
             if isinstance(v := getattr(shape.links, f.name), np.ndarray)}, attrs={"json": plain(shape.links, set())}),
    }


def plain(result: Any, but: set[str]) -> str:
    """Return the fields of a dataclass that are not arrays, as JSON; tuples of arrays become lists."""
    found: dict[str, Any] = {}
    for f in fields(result):
        value = getattr(result, f.name)
        if f.name not in but and not isinstance(value, np.ndarray):
            found[f.name] = [v.tolist() if isinstance(v, np.ndarray) else v for v in value] if isinstance(
                value, tuple) else value
    return json.dumps(found)


def forecast_dataset(forecast: Forecast) -> xr.Dataset:
    """Return a forecast's tip motion and its half-width as a data set."""
    units = {"units": "rad" if forecast.tip.shape[1] == 1 else "m"}
    variables: dict[str, Any] = {"tip": (("time", "axis"), forecast.tip, units)}
    if forecast.half_width is not None:
        variables["half_width"] = (("time", "axis"), forecast.half_width, units)
    return xr.Dataset(variables, {"time": ("time", forecast.time, {"units": "s"})}, {"name": forecast.name})
