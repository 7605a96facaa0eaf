"""What a recording sees of the links: rows of angles and coordinates, dense curves compressed to link tips."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr

from pliant.errors import InputError
from pliant.estimation.measurement_loops import ALONG_X, ALONG_Y, ALONG_Z, ANGLE, JOINT
from pliant.estimation.noise import Noise
from pliant.mechanics import mechanics_of
from pliant.model import Model, Station, fixed_length
from pliant.recording.schema import check_recording
from pliant.reduction import links_of
from pliant.reduction.body import body_of
from pliant.simulation import state

Array = np.ndarray
AXES = (ALONG_X, ALONG_Y, ALONG_Z)
PLAIN = 0.5  # correlation of the pressure with the tip's x, of the wrong sign, from which a recording is refused


class Measurement(NamedTuple):
    """A measurement over time: rows (m, 4) of (kind, link, along, across), values (T, m), variances (m,)."""

    time: Array  # (T,) s, as stamped
    rows: Array  # in space (m, 5), with aside behind
    value: Array  # NaN where a row is missing
    variance: Array
    label: tuple[str, ...]
    notes: tuple[str, ...]


def rows_of(model: Model, stations: tuple[Station, ...], *, position: bool = True, angle: bool = False) -> Array:
    """Rows (m, 4) that see x and y, and the angle, of stations on links, in the model's base frame.

    In space rows (m, 5) that see x, y and z; there is no angle.

    Raises
    ------
    InputError
        When a station sits on the base, or an angle is wanted in space.
    """
    rows: list[tuple[float, ...]] = []
    if angle and model.space is not None:
        raise InputError(f"{model.name!r} moves in space, where a link has no one angle: give positions of stations")
    for s in stations:
        if not 0 <= s.link < model.n:
            raise InputError(f"station {s.name!r} sits on the base and tells nothing of the links: leave it out")
        if position:
            rows += [(kind, s.link, s.along, s.across, s.aside) for kind in AXES[: mechanics_of(model).dimension]]
        if angle:
            rows.append((ANGLE, s.link, 0.0, 0.0, 0.0))
    wide = np.array(rows, dtype=float).reshape(-1, 5)
    return wide[:, : row_width(model)]


def row_width(model: Model) -> int:
    """Return how many numbers a row of a measurement has: kind, link, along, across; in space aside too."""
    return 4 if model.space is None else 5


def measurement_of(
    recording: xr.Dataset, model: Model, noise: Noise, stations: tuple[str, ...] | None = None
) -> Measurement:
    """What an aligned recording sees of a model.

    Stations that the model knows are taken as they are, with their angles where recorded. A recording of none of them
    but of a dense curve, base first, is compressed to the angles between links that divide the
    curve's length as the model's do. In space only the positions of the model's stations are taken.

    Raises
    ------
    InputError
        When the recording is not aligned in the plane, or in space, as the model is; bends to the other side than the
        model; or shows neither the model's stations nor a dense curve (which tells nothing of a body that lengthens).
    """
    check_recording(recording)
    space = model.space is not None
    frame = "spatial" if space else "planar"
    if recording.attrs.get("frame") != frame:
        raise InputError(f"a {frame} recording is needed, not the frame {recording.attrs.get('frame')!r}: align it by "
                         f"`pliant shape RECORDING {'--space ' * space}-o aligned.nc`, or pliant.align")
    if not space and bends_away(recording, model):
        raise InputError("under pressure the recorded body bends to the other side than the model: turn the recording "
                         "into the base frame by `pliant shape RECORDING -o aligned.nc`, or pliant.align")  # D4
    names = [str(s) for s in recording["station"].values]
    wanted = stations or tuple(p.name for p in model.points if p.link >= 0 and p.name in names)
    known = {p.name: p for p in model.points}
    if missing := [s for s in wanted if s not in names or s not in known]:
        raise InputError(f"station {missing[0]!r} is not in both recording and model; the model has {', '.join(known)}")
    if wanted:
        return from_stations(recording, model, noise, tuple(known[s] for s in wanted))
    if len(names) >= 3 * model.n and not space:
        return from_curve(recording, model, noise)
    raise InputError(
        f"the recording shows {', '.join(names[:5])}, the model's stations are {', '.join(known)}: name them alike"
        + ("" if space else f", or record a curve of at least {3 * model.n} points, base first")
    )


def bends_away(recording: xr.Dataset, model: Model) -> bool:
    """Return whether the measured pressure of the only chamber bends the body to the other side than the model."""
    if "pressure" not in recording or "position" not in recording or model.actuation.count > 1:
        return False
    pressure = recording["pressure"].values.reshape(recording.sizes["pressure_time"], -1)
    x = recording["position"].values[:, -1, 0]
    seen = np.isfinite(x)
    level = np.interp(recording["time"].values, recording["pressure_time"].values, pressure[:, 0])[seen]
    if pressure.shape[1] > 1 or not (level.size and np.ptp(level) > 0 and np.ptp(x[seen]) > 0):
        return False
    torque = model.torque_at(float(level.max())) * model.joint_gain.sum()
    return bool(np.corrcoef(level, x[seen])[0, 1] * np.sign(torque) > PLAIN)


def from_stations(recording: xr.Dataset, model: Model, noise: Noise, stations: tuple[Station, ...]) -> Measurement:
    """Coordinates, and angles where recorded, of named stations."""
    names = [s.name for s in stations]
    angled = "angle" in recording and model.space is None
    axes = recording["axis"].values
    position = recording["position"].sel(station=names).values.astype(float)
    columns, variance, label = [], [], []
    turned = angles_of(recording, model, stations) if angled else None
    for k, s in enumerate(stations):
        columns += list(position[:, k].T)
        variance += [noise.stations.get(s.name, noise.position) ** 2] * axes.size
        label += [f"{s.name} {axis}" for axis in axes]
        if turned is not None:
            columns.append(turned[:, k])
            variance.append(noise.angle**2)
            label.append(f"{s.name} angle")
    rows = rows_of(model, stations, angle=angled)
    time = recording["time"].values.astype(float)
    return Measurement(time, rows, np.stack(columns, axis=1), np.array(variance), tuple(label), ())


def angles_of(recording: xr.Dataset, model: Model, stations: tuple[Station, ...]) -> Array:
    """Recorded angles (T, S) as absolute link angles, rad."""
    angle = recording["angle"].sel(station=[s.name for s in stations])
    turned = angle.values.astype(float)
    if str(angle.attrs.get("reference", "base")) == "rest":
        turned = turned + mechanics_of(model).coordinates(state.equilibrium(model))[[s.link for s in stations]]
    return np.asarray(turned)


def from_curve(recording: xr.Dataset, model: Model, noise: Noise) -> Measurement:
    """Angles between the links laid through a dense curve; frames with missing points are left out and counted.

    A fibre's curvature errs from point to point, so angles between neighbouring links err independently of each other;
    the tips, which are sums of them, do not.
    """
    fixed_length(
        model, f"a dense curve does not show which of its points belong to which link of {model.name!r}, which "
        "lengthens: record stations that the model knows, or leave its extensions out",
    )
    body = body_of(recording)
    share = np.append(0.0, np.cumsum(model.link_length)) + model.base_length
    share = share / share[-1]
    links = links_of(recording, node_arc_length=share * body.arc_length[-1])
    rows = np.array([(JOINT, i, 0.0, 0.0) for i in range(model.n)])
    time = recording["time"].values.astype(float)
    value = np.full((time.size, model.n), np.nan)
    value[np.isin(time, links.time)] = links.joint_angle + links.rest_angle
    notes = (f"curve of {body.arc_length.size} points compressed to {model.n} joint angles", *links.notes)
    label = tuple(f"joint_{i + 1}" for i in range(model.n))
    return Measurement(time, rows, value, np.full(model.n, noise.angle**2), label, notes)
