"""Build, write and read the dataset of the rod's true motion, which tests compare with the fitted model."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pliant.errors import InputError, shown
from pliant.files import whole
from pliant.recording.netcdf import read_groups
from pliant.testbed.rod import RodParameters, build_body, material_fields
from pliant.testbed.stepping import RodMotion

Array = np.ndarray
SCHEMA = "pliant-truth"
ENERGY = ["kinetic", "elastic", "memory", "weight", "contact"]


def joint_rates(motion: RodMotion, nodes: Array, at: Array) -> Array:
    """Return the true joint rates (T, n) [rad/s] of a chain of n links along the rod, at T times `at` [s].

    The joints lie at the arc lengths `nodes` (n + 1,) [m]. The rates follow from the rod's velocities, without a finite
    difference in time.
    """
    x, v = (np.stack([[np.interp(nodes, motion.arc_length, row[:, k]) for k in (0, 1)] for row in field])
            for field in (motion.position, motion.velocity))  # fmt: skip
    d, u = np.diff(x, axis=2), np.diff(v, axis=2)
    w = (d[:, 0] * u[:, 1] - d[:, 1] * u[:, 0]) / np.sum(d**2, axis=1)
    dq = np.diff(w, axis=1, prepend=0.0)
    return np.stack([np.interp(at, motion.time, row) for row in dq.T], axis=1)


def node_positions(motion: RodMotion, at: Array) -> Array:
    """Return the positions (T, V, 2) [m] of the rod's V nodes at T times `at` (T,) [s], by cubic Hermite
    interpolation.
    """
    step = motion.time[1] - motion.time[0]
    index = np.clip(np.searchsorted(motion.time, at) - 1, 0, motion.time.size - 2)
    u = np.clip((at - motion.time[index]) / step, 0.0, 1.0)[:, None, None]
    x0, x1 = motion.position[index], motion.position[index + 1]
    v0, v1 = motion.velocity[index] * step, motion.velocity[index + 1] * step
    change = x1 - x0
    return np.asarray(x0 + u * v0 + u**2 * (3 * change - 2 * v0 - v1) + u**3 * (v0 + v1 - 2 * change))


def make_truth(motion: RodMotion, p: RodParameters, at: Array, attrs: dict[str, Any]) -> xr.Dataset:
    """Return a dataset of the rod's true states at the times `at` (T,) [s], at which the shape sensor takes its T
    frames.

    `position` [m] and the obstacles' `force` [N] (time, node, axis) are in the actuator's frame: base at the origin,
    tangent +y. `curvature` [1/m] has the dimensions (time, vertex), and `energy` [J] has (record, store). `pressure`
    [Pa] and `volume` [m3] have the dimension (record), or (record, chamber) for several chambers; `gain` [N m/Pa]
    likewise has (vertex) or (chamber, vertex). Stiffness and rest curvature have the dimension (vertex). The attribute
    `parameters` holds all parameters as JSON.
    """
    nearest = np.clip(np.searchsorted(motion.time, at), 0, motion.time.size - 1)
    body = build_body(p)
    s = motion.arc_length[: body.weight.size]
    fields = material_fields(p, s)
    each, gain = ((), body.gain[0]) if len(p.chambers) == 1 else (("chamber",), body.gain)
    recording = xr.Dataset(
        {
            "position": (("time", "node", "axis"), node_positions(motion, at), {"units": "m"}),
            "force": (("time", "node", "axis"), motion.force[nearest], {"units": "N"}),
            "curvature": (("time", "vertex"), motion.curvature[nearest], {"units": "1/m"}),
            "pressure": (("record", *each), motion.pressure, {"units": "Pa"}),
            "volume": (("record", *each), motion.volume, {"units": "m3"}),
            "energy": (("record", "store"), motion.energy, {"units": "J"}),
            "stiffness": ("vertex", fields["stiffness"], {"units": "N m2"}),
            "gain": ((*each, "vertex"), gain, {"units": "N m/Pa"}),
            "rest_curvature": ("vertex", fields["rest_curvature"], {"units": "1/m"}),
        },
        coords={
            "time": ("time", at, {"units": "s", "long_name": "true time of the shape's frames"}),
            "record_time": ("record", motion.time, {"units": "s"}),
            "arc_length": ("node", motion.arc_length, {"units": "m"}),
            "vertex_position": ("vertex", s, {"units": "m"}),
            "axis": ["x", "y"],
            "store": ENERGY,
        } | ({"chamber": [c.name for c in p.chambers]} if each else {}),
    )
    recording.attrs = {"schema": SCHEMA, "schema_version": 1, "parameters": json.dumps(asdict(p)), **attrs}
    return recording


def write_truth(recording: xr.Dataset, path: Path) -> None:
    """Write a dataset of true motion as compressed single-precision netCDF; an interruption leaves no partial file."""
    encoding = {
        str(name): {"dtype": "float32", "zlib": True, "complevel": 4, "shuffle": True, "_FillValue": None}
        for name in recording.data_vars
    }
    with whole(path) as temporary:
        recording.to_netcdf(temporary, engine="h5netcdf", encoding=encoding)


def read_truth(path: Path) -> xr.Dataset:
    """Read a dataset of true motion from a file that `write_truth` wrote.

    Raises
    ------
    InputError
        When the file does not exist or is not a truth file of the test bed.
    """
    try:
        loaded = read_groups(path)["/"]
    except InputError as error:
        raise InputError(f"cannot read the file of true motion {path}: {error}") from None
    if str(schema := loaded.attrs.get("schema")) != SCHEMA:
        raise InputError(f"{path} is not a file of true motion: its schema is {shown(schema)}, not {SCHEMA!r}; name a "
                         "file of write_truth")
    return loaded
