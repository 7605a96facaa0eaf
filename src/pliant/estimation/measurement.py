"""Conversion of a recording to filter measurements: positions and angles of stations, or angles of a body curve."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import xarray as xr

from pliant.equations.observation import JOINT, KINDS, TURN_X, TURN_Y, TURN_Z
from pliant.equations.observation import kinds_of as kinds_by_variable
from pliant.errors import InputError
from pliant.estimation.noise import Noise
from pliant.identification.experiment import FIRST_FRAMES
from pliant.identification.observation import check_direction, modelled_rows, points_at
from pliant.identification.residuals import measured_turns
from pliant.mechanics import mechanics_of
from pliant.mechanics.spatial import SpatialChain
from pliant.model import Model, Station, fixed_length
from pliant.model.features import RESTING, Consumer
from pliant.recording.inputs import base_moves
from pliant.recording.schema import check_recording, recorded_further
from pliant.reduction import links_of
from pliant.reduction.body import body_of
from pliant.simulation import state

Array = np.ndarray
TURNS = (TURN_X, TURN_Y, TURN_Z)
MEASURED_IN = {d: [kind for kind, row in KINDS.items() if d in row.constants] for d in (2, 3)}
IS_TURN = np.isin(list(KINDS), TURNS)  # of each kind, by its number
IN_METRES = np.array([row.unit == "m" for row in KINDS.values()])  # of each kind, by its number
HALF_TURN = np.pi + 1e-6  # rad: no rotation vector is longer
PLAIN = 0.5  # correlation of pressure and tip x with the wrong sign, above which a recording is rejected


ESTIMATE = Consumer("an estimate from a recording", RESTING, remedy={
    "base_motion": "state the motion of its base by estimate(..., base=BaseMotion(...)) or --base FILE, or set "
                   "moving_base to false for a body whose base rests",
})  # fmt: skip


class Measurement(NamedTuple):
    """Measured values of a recording that the filter compares with the model: m quantities in T frames, with their
    variances. Each row (m, 4) describes a quantity: its kind, its link, and its distances along and across the link
    [m].
    """

    time: Array  # (T,) s, as stamped
    rows: Array  # in space (m, 5), followed by aside; then the constants of the kinds, where they have any
    value: Array  # NaN where a row is missing
    variance: Array
    label: tuple[str, ...]
    notes: tuple[str, ...]


def rows_of(
    model: Model, stations: tuple[Station, ...], *, position: bool = True, angle: bool = False,
    further: Mapping[str, Array] | None = None,
) -> Array:
    """Return rows (m, 4) that define m measured quantities: x, y and optionally the angle of each station. Each row
    holds the kind, the link, and the distances along and across the link [m].

    Each row is (kind, link, along, across). In space, rows (m, 5) for x, y and z, with aside as the last entry. With
    `angle`, three more rows for the orientation of the station's link, whose values are the rotation vector [rad] of
    the link's frame (x aside, z along the link) in the base frame.

    `further` holds the constants (S, k) of the rows at each of S stations, by the variable of their kinds in a
    recording. They are the last columns of the rows.

    Raises
    ------
    InputError
        When a station sits on the base.
    """
    dimension, width, further = mechanics_of(model).dimension, row_width(model), further or {}
    turned = ["angle" if dimension == 2 else "quaternion"] * angle
    extra = (0.0,) * max((c.shape[1] for c in further.values()), default=0)
    rows: list[tuple[float, ...]] = []
    for k, s in enumerate(stations):
        if not 0 <= s.link < model.n:
            raise InputError(f"station {s.name!r} lies on the base and does not depend on the links: leave it out")
        for variable in (*["position"] * position, *turned, *further):
            offsets = (0.0, 0.0, 0.0) if variable in turned else (s.along, s.across, s.aside)
            constants = further[variable][k] if variable in further else ()
            behind = (*constants, *extra)[: len(extra)]
            rows += [(*(kind, s.link, *offsets)[:width], *behind) for kind in kinds_of(variable, dimension)]
    return np.array(rows, dtype=float).reshape(-1, width + len(extra))


def kinds_of(variable: str, dimension: int) -> list[int]:
    """Return the numbers of the kinds of rows that measure a variable of a recording, in a space of 2 or 3 dimensions.

    Raises
    ------
    InputError
        When there is none.
    """
    kinds = kinds_by_variable(variable, dimension)
    if not kinds:
        raise InputError(f"{variable} cannot be measured in {dimension} dimensions: leave it out of the recording")
    return kinds


def row_width(model: Model) -> int:
    """Return the number of columns that define a measured quantity: 4 (its kind, its link, and its distances along and
    across the link), in space 5 (also its distance to the side).
    """
    return mechanics_of(model).row_width


def check_frame(model: Model, rows: Array, values: Array, variance: Array) -> None:
    """Raise InputError if a measured frame is invalid: its rows, values and variances differ in number, a row has an
    unknown kind or link, or an orientation does not have three successive rows or exceeds half a turn.

    Raises
    ------
    InputError
        With the reason in one sentence.
    """
    wide = row_width(model)
    if rows.ndim != 2 or len(rows) != values.size or rows.shape[1] < wide or variance.shape != values.shape:
        raise InputError(
            f"a frame needs rows (m, {wide}), m values and m variances, got rows {rows.shape}, values {values.shape} "
            f"and variances {variance.shape}"
        )
    if not has_orientations(rows.tobytes(), model.n, wide - 2, rows.shape[1]):
        return
    turned = values[IS_TURN[rows[:, 0].astype(int)]].reshape(-1, 3)
    if (np.linalg.norm(np.nan_to_num(turned), axis=1) > HALF_TURN).any():
        raise InputError(
            "an orientation must be a rotation vector of at most half a turn (pi rad): convert it by "
            "scipy.spatial.transform.Rotation.as_rotvec"
        )


@lru_cache(256)  # the rows of a sensor are the same in every frame
def has_orientations(content: bytes, links: int, dimension: int, wide: int) -> bool:
    """Return whether rows of a measurement contain orientations. `content` are the bytes of an array (m, `wide`).

    Raises
    ------
    InputError
        When a row has an unknown kind or link, or an orientation does not have three successive rows of one link, or
        the rows have other columns than their kinds need.
    """
    rows = np.frombuffer(content).reshape(-1, wide)
    known = np.isin(rows[:, 0], MEASURED_IN[dimension]) & np.isin(rows[:, 1], range(links))
    if not known.all():
        raise InputError(
            f"a row must begin with a kind of measurement, in {dimension} dimensions "
            f"{', '.join(f'{kind} ({KINDS[kind].meaning})' for kind in MEASURED_IN[dimension])}, and a link from 0 to "
            f"{links - 1}, got {rows[~known][0, :2].tolist()}: make rows with rows_of"
        )
    columns = dimension + 2 + max((KINDS[kind].constants[dimension] for kind in rows[:, 0]), default=0)
    if wide != columns:
        raise InputError(f"a frame needs rows (m, {columns}) for the kinds that it measures, got rows {rows.shape}")
    turns = np.flatnonzero(np.isin(rows[:, 0], TURNS))
    if not turns.size:
        return False
    threes = rows[turns, :2].reshape(-1, 3, 2) if turns.size % 3 == 0 else np.empty((0, 3, 2))
    if not (len(threes) and (threes[..., 0] == TURNS).all() and (threes[..., 1] == threes[:, :1, 1]).all()
            and (np.diff(turns.reshape(-1, 3)) == 1).all()):  # fmt: skip
        raise InputError("an orientation needs three consecutive rows of one link: make them with rows_of")
    return True


def flips(rows: Array, values: Array, seen: Array) -> int:
    """Return how many measured orientations the filter rejected because a marker appeared flipped. `values` (..., m)
    holds the m measured values of each frame.

    These are the orientations that were given but are NaN in `seen` (..., m).
    """
    turned = IS_TURN[rows[:, 0].astype(int)]
    if not turned.any():
        return 0
    measured, predicted = (a[..., turned].reshape(*a.shape[:-1], -1, 3) for a in (values, seen))
    return int((np.isfinite(measured).all(axis=-1) & np.isnan(predicted[..., 0])).sum())


def measurement_of(
    recording: xr.Dataset, model: Model, noise: Noise, stations: tuple[str, ...] | None = None,
    inputs: Array | None = None, *, carried: bool = False,
) -> Measurement:
    """Return the filter's measurement from an aligned recording: m measured quantities, their values (T, m) in T
    frames, and their variances (m,).

    Positions of the model's stations are used, with their angles where recorded, or angles alone. A dense curve, base
    first, without any of these stations is compressed to the angles between links that divide the curve's length as
    the model's do. In space, the positions of the model's stations are used, with orientations of rigid bodies there.
    A recording holds these as rotations since its rest; they are added to the model's equilibrium without input.
    Values of further variables that count from the first frames are added to those in equilibrium under `inputs` (C,)
    [SI], those of the first frame; default: none. `carried`: whether the motion of the base is given to the filter.

    Raises
    ------
    InputError
        When the recording is not aligned, is planar for a model in space or the reverse, bends to the other side than
        the model, or shows neither the model's stations nor a dense curve (which is not enough for an extensible body),
        or when its base moves as an input and `carried` is false.
    """
    if observed := observed_stations(recording, model, stations, carried=carried):
        return from_stations(recording, model, noise, observed, inputs)
    return from_curve(recording, model, noise)


def observed_stations(
    recording: xr.Dataset, model: Model, stations: tuple[str, ...] | None = None, *, carried: bool = False,
) -> tuple[Station, ...]:
    """Return the model's stations that a recording shows; () for a dense curve. Raise InputError where a recording
    shows neither, as `measurement_of` does.
    """
    check_recording(recording)
    if not carried:
        if base_moves(recording):
            raise InputError("the recording is in the axes of a base that moves: state the motion of the base by "
                             "estimate(..., base=BaseMotion(...)) or --base FILE")
        ESTIMATE.check(model)
    space = model.space is not None
    frame = "spatial" if space else "planar"
    if recording.attrs.get("frame") != frame:
        raise InputError(f"a {frame} recording is needed, not the frame {recording.attrs.get('frame')!r}: align it by "
                         f"`pliant shape RECORDING {'--space ' * space}-o aligned.nc`, or pliant.align")
    if not space and bends_away(recording, model):
        raise InputError("under pressure the recorded body and the model bend to opposite sides: turn the recording "
                         "into the base frame by `pliant shape RECORDING -o aligned.nc`, or pliant.align")  # D4
    names = [str(s) for s in recording["station"].values]
    wanted = stations or tuple(p.name for p in model.points if p.link >= 0 and p.name in names)
    known = {p.name: p for p in model.points}
    if missing := [s for s in wanted if s not in names or s not in known]:
        raise InputError(
            f"station {missing[0]!r} is not in both recording and model; the model has {', '.join(known)}: "
            "give the station the same name in both, or leave it out"
        )
    if wanted or (len(names) >= 3 * model.n and not space and "position" in recording):
        return tuple(known[s] for s in wanted)
    raise InputError(
        f"no station of the recording ({', '.join(names[:5])}) is one of the model's ({', '.join(known)}): "
        "name them alike"
        + ("" if space else f", or record a curve of at least {3 * model.n} points, base first")
    )


def bends_away(recording: xr.Dataset, model: Model) -> bool:
    """Return whether the recorded pressure bends the body to the opposite side of what the model predicts."""
    if "pressure" not in recording or "position" not in recording or model.actuation.kinds != ("pressure",):
        return False
    pressure = recording["pressure"].values.reshape(recording.sizes["pressure_time"], -1)
    x = recording["position"].values[:, -1, 0]
    finite = np.isfinite(x)
    level = np.interp(recording["time"].values, recording["pressure_time"].values, pressure[:, 0])[finite]
    if pressure.shape[1] > 1 or not (level.size and np.ptp(level) > 0 and np.ptp(x[finite]) > 0):
        return False
    torque = model.torque_at(float(level.max())) * model.joint_gain.sum()
    return bool(np.corrcoef(level, x[finite])[0, 1] * np.sign(torque) > PLAIN)


def from_stations(
    recording: xr.Dataset, model: Model, noise: Noise, stations: tuple[Station, ...], inputs: Array | None = None,
) -> Measurement:
    """Return the filter's measurement of named stations: recorded positions, and recorded angles or orientations."""
    names, space = [s.name for s in stations], model.space is not None
    further = recorded_further(recording, names)
    recorded = {}  # (T, S, k), by variable
    if "position" in recording:
        recorded["position"] = recording["position"].sel(station=names).values.astype(float)
    if "angle" in recording and not space:
        recorded["angle"] = angles_of(recording, model, stations)[..., None]
    if "quaternion" in recording and space:
        recorded["quaternion"] = orientations_of(recording, model, stations)
    if "gravity" in further:
        check_direction("the recording", further["gravity"][1], model.gravity)
    for name, (of_name, fixed) in further.items():
        measured = of_name if of_name.ndim == 3 else of_name[..., None]
        if recording[name].attrs.get("reference") == "rest":
            measured = measured + at_rest(model, stations, name, fixed, inputs) - first_of(measured)
        recorded[name] = measured
    columns, rows, label, variance = [], [], [], []
    for k, s in enumerate(stations):
        values = {n: v[:, k] for n, v in recorded.items() if n != "quaternion" or np.isfinite(v[:, k]).any()}
        columns += [column for value in values.values() for column in value.T]
        turned = bool({"angle", "quaternion"} & set(values))
        constants = {n: c[k : k + 1] for n, (_, c) in further.items()}
        station_rows = rows_of(model, (s,), position="position" in values, angle=turned, further=constants)
        rows.append(station_rows)
        label += [f"{s.name} {KINDS[kind].name}" for kind in station_rows[:, 0]]
        variance += [noise.of_row(kind, s.name) ** 2 for kind in station_rows[:, 0]]
    time, value = recording["time"].values.astype(float), np.stack(columns, axis=1)
    return Measurement(time, np.concatenate(rows), value, np.array(variance), tuple(label), ())


def at_rest(
    model: Model, stations: tuple[Station, ...], variable: str, constants: Array, inputs: Array | None = None,
) -> Array:
    """Return the values (S, d) of a further variable at S stations of the model in equilibrium under `inputs` (C,)."""
    chain = mechanics_of(model.with_(stations=stations))
    rest = state.equilibrium(model, 0.0 if inputs is None else inputs if inputs.size > 1 else float(inputs[0]))
    rows = points_at(chain, chain.coordinates(rest))
    values = modelled_rows(rows[None], variable, constants, planar=chain.dimension == 2)[0]
    return values[:, : len(kinds_of(variable, chain.dimension))]


def first_of(values: Array) -> Array:
    """Return the mean (S, d) of the first five known values of S stations in T frames (T, S, d); NaN without one."""
    known = np.isfinite(values).all(axis=2)
    first = known & (np.cumsum(known, axis=0) <= FIRST_FRAMES)
    mean = np.where(first[..., None], values, 0.0).sum(axis=0)
    return np.asarray(mean / np.where(known.any(axis=0), first.sum(axis=0), np.nan)[:, None])


def angles_of(recording: xr.Dataset, model: Model, stations: tuple[Station, ...]) -> Array:
    """Return the recorded angles (T, S) [rad] of S stations over T frames, converted to absolute link angles."""
    angle = recording["angle"].sel(station=[s.name for s in stations])
    turned = angle.values.astype(float)
    if str(angle.attrs.get("reference", "base")) == "rest":
        turned = turned + mechanics_of(model).coordinates(state.equilibrium(model))[[s.link for s in stations]]
    return np.asarray(turned)


def orientations_of(recording: xr.Dataset, model: Model, stations: tuple[Station, ...]) -> Array:
    """Return the recorded orientations (T, S, 3) [rad] of S stations' links as rotation vectors over T frames.

    A recording holds rotations since its rest, in the axes of the base frame. Missing orientations are NaN.
    """
    from scipy.spatial.transform import Rotation

    chain = SpatialChain(model)
    links = chain.posed(chain.coordinates(state.equilibrium(model))).R[[s.link + 1 for s in stations]]
    quaternion = recording["quaternion"].sel(station=[s.name for s in stations]).values.astype(float)
    turns, measured = measured_turns(quaternion)
    vectors = Rotation.from_matrix((turns @ links).reshape(-1, 3, 3)).as_rotvec().reshape(*measured.shape, 3)
    vectors[~measured] = np.nan
    return np.asarray(vectors)


def from_curve(recording: xr.Dataset, model: Model, noise: Noise) -> Measurement:
    """Return the filter's measurement from a recorded curve of many points along the body: the angle between each link
    and the one before. Incomplete frames are NaN.

    The curvature of a sensor fibre has independent errors from point to point. Angles between neighbouring links
    therefore have independent errors too, whereas the tips, which are sums of them, have not.
    """
    fixed_length(
        model, f"a dense curve does not show which of its points belong to which link of the extensible model "
        f"{model.name!r}: record stations of the model, or leave its extensions out",
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
