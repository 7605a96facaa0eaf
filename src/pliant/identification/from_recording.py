"""Construction of an `Experiment` for a fit from an aligned recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import xarray as xr

from pliant.equations.observation import FURTHER
from pliant.errors import InputError
from pliant.identification.drives import drives_of, driving, only_input
from pliant.identification.edges import held_pose
from pliant.identification.experiment import AngleReference, Excitation, Experiment, FurtherRows
from pliant.identification.starts import AtPose, AtRest, Moving, begins_in_motion
from pliant.preprocessing.side import x_sign
from pliant.recording.inputs import CUTOFF, base_moves
from pliant.recording.rules import shape_variable
from pliant.recording.schema import check_recording, recorded_further
from pliant.simulation import BaseMotion, Trace
from pliant.simulation.forces import PointForce

Array = np.ndarray
Held = Literal["unloaded", "measured"]
Poses = bool | Literal["median"]
Angles = bool | Literal["only"]
Start = Literal["rest", "pose", "moving"]
STARTS: dict[Start, AtRest] = {"rest": AtRest(), "pose": AtPose(), "moving": Moving()}


def experiment(
    name: str, recording: xr.Dataset, *, stations: tuple[str, ...] | None = None, excitation: Excitation | None = None,
    known: Mapping[str, float] | None = None, noise: Mapping[str, float] | None = None,
    angles: Angles = False,
    held: Held = "unloaded", own_places: bool = False,
    forces: Sequence[PointForce] = (), drive: Mapping[str, str | int] | None = None,
    poses: Poses = False, inputs: Mapping[str, float] | None = None, start: Start | None = None,
    warm_up: float = 0.0,
) -> Experiment:
    """Return an `Experiment` for a fit from an aligned recording in the plane or in space.

    Parameters
    ----------
    name : str
        Without a dot: parameters of this recording alone are called ``name.parameter``.
    recording : xarray.Dataset
        Schema of `pliant.recording.schema`, frame "planar" or "spatial".
    stations : tuple of str, optional
        Stations to use, in order from the base; the last one is the tip. Default: all.
    excitation : {"trace", "pulse", "step", "release"}, optional
        Default: "trace" when the recording has a measured pressure, "pulse" when it has a nominal one.
    known : dict, optional
        Values of parameters for this recording alone, such as the tip_mass that the body carried, SI.
    noise : dict, optional
        Known standard deviation of coordinates by station, m.
    angles : bool or "only"
        True fits the recorded angles too (in space, the orientations of rigid bodies); "only" fits nothing else.
    held : {"unloaded", "measured"}
        For a release, the pose in which the body was held: its unloaded shape, or the positions that the recording
        shows in the last 0.05 s before the release.
    own_places : bool
        Whether to take the positions of the stations on their links from this recording's own first frames; see
        `Experiment`.
    forces : sequence of PointForce
        Known forces at points of the body.
    drive : dict, optional
        For a model of several chambers: maps each chamber of the model to the recorded pressure that drives it, by
        name or index (from 0). Chambers not listed stay at 0 Pa.
    poses : bool or "median"
        True: each row is a settled pose, without motion between rows. "median": all rows show one pose, and their
        median is used.
    inputs : dict, optional
        Constant value of each input of the model, SI, for a recording without inputs; others are 0.
    start : {"rest", "pose", "moving"}, optional
        Whether the simulation of the recording starts at rest under its first inputs, at rest in the pose of its first
        frames, or with the pose and the rates of these. Default: "moving" if they show a motion, see
        `starts.begins_in_motion`; else "rest".
    warm_up : float
        Time from the first frame on, s, that is simulated but not compared with the model.

    Raises
    ------
    InputError
        When the recording is not aligned, has no pressure of either kind and is not a release, or lacks a station.
    """
    check_recording(recording)
    if recording.attrs.get("frame") not in ("planar", "spatial"):
        raise InputError(
            f"recording {name} is in the frame {recording.attrs.get('frame')!r}: align it first, by `pliant shape` or "
            "pliant.align"
        )
    available = [str(s) for s in recording.station.values]
    used = tuple(stations or available)
    if missing := [s for s in used if s not in available]:
        raise InputError(
            f"recording {name} has no station {missing[0]!r}; it has {', '.join(available)}: use these names"
        )
    excitation = excitation or ("trace" if inputs else default_excitation(name, recording))
    if poses == "median":
        recording = one_pose(recording)
    trace, drives, kinds = None, {}, {}
    angles_alone = shape_variable(recording) == "angle"
    if inputs:
        ends = recording.time.values[[0, -1]] + [0.0, 1.0]
        drives = {to: Trace(ends, np.full(2, float(value))) for to, value in inputs.items()}
    elif drive and excitation != "release":
        drives = drives_of(name, recording, drive)
        kinds = {to: signal.kind for to, signal in driving(name, recording, drive).items()}
    elif excitation == "trace":
        signal = only_input(name, recording)
        trace, kinds = Trace(signal.time, np.array(signal.values)), {"": signal.kind}
    exp = Experiment(
        name, recording.time.values.astype(float), recorded_places(recording, used), used, excitation, trace,
        float(recording.attrs.get("nominal_pressure", 0.0)), dict(known or {}),
        **recorded_angles(name, recording, used, wanted=bool(angles) or angles_alone),
        noise=dict(noise or {}),
        arc_length=dense_arc_length(recording, used), forces=tuple(forces),
        angles_alone=angles == "only" or angles_alone, drives=drives,
        own_places=own_places, poses=bool(poses), input_kinds=kinds, x_sign=x_sign(recording), warm_up=warm_up,
        further=further_of(recording, used), base=base_of(recording),
    )
    exp = replace(exp, start=STARTS[start or ("moving" if begins_in_motion(exp) else "rest")])
    return replace(exp, held=held_pose(exp)) if held == "measured" else exp


def one_pose(recording: xr.Dataset) -> xr.Dataset:
    """Return the recording of a body at rest as a single row, the median of the recorded positions and of values of
    further variables. A direction of gravity is scaled to unit length again.
    """
    first = recording.isel(time=slice(0, 1))
    names = [name for name in ("position", *FURTHER) if name in recording]
    medians = {name: recording[name].median("time").values[None] for name in names}
    if "gravity" in medians:
        medians["gravity"] /= np.linalg.norm(medians["gravity"], axis=-1, keepdims=True)
    return first.assign({name: first[name].copy(data=values) for name, values in medians.items()})


def base_of(recording: xr.Dataset) -> BaseMotion | None:
    """Return the motion of the base that a recording holds as an input; None if it holds none."""
    if not base_moves(recording):
        return None
    turn = {name: recording[f"base_{name}"].values for name in ("angle", "quaternion") if f"base_{name}" in recording}
    return BaseMotion(recording.time.values, recording["base_position"].values, **turn,
                      cutoff=recording.attrs.get(CUTOFF))  # fmt: skip


def recorded_places(recording: xr.Dataset, stations: tuple[str, ...]) -> Array:
    """Return the recorded positions (T, S, 2), in space (T, S, 3), [m] of S stations in T frames. They are NaN for a
    recording without positions.
    """
    if "position" not in recording:
        dimension = 2 if recording.attrs["frame"] == "planar" else 3
        return np.full((recording.sizes["time"], len(stations), dimension), np.nan)
    return np.asarray(recording["position"].sel(station=list(stations)).values, dtype=float)


def recorded_angles(name: str, recording: xr.Dataset, stations: tuple[str, ...], *, wanted: bool) -> dict[str, Any]:
    """Return the recorded angles with their reference, or orientations in space, as keyword
    arguments of `Experiment`.
    """
    if not wanted:
        return {}
    if recording.attrs.get("frame") == "spatial":
        if "quaternion" not in recording:
            raise InputError(f"recording {name} has no orientations to fit: set angles to false")
        return {"orientation": recording["quaternion"].sel(station=list(stations)).values.astype(float)}
    if "angle" not in recording:
        raise InputError(f"recording {name} has no angles to fit: set angles to false")
    angle = recording["angle"]
    reference = str(angle.attrs.get("reference", "base"))
    return {"angle": angle.sel(station=list(stations)).values.astype(float), "angle_reference": reference}


def further_of(recording: xr.Dataset, stations: tuple[str, ...]) -> dict[str, FurtherRows]:
    """Return the values of further variables of a recording at its stations, with their reference: "base" where they
    state none.
    """
    further = {}
    for name, (values, constants) in recorded_further(recording, stations).items():
        reference: AngleReference = "rest" if recording[name].attrs.get("reference") == "rest" else "base"
        further[name] = FurtherRows(values, constants, reference=reference)
    return further


def dense_arc_length(recording: xr.Dataset, stations: tuple[str, ...]) -> Array | None:
    """Return the arc lengths (S,) [m] of S stations if these were recorded and rise from station to station; None
    otherwise.
    """
    if "arc_length" not in recording.coords or len(stations) < 2:
        return None
    s = recording["arc_length"].sel(station=list(stations)).values.astype(float)
    return s if np.all(np.diff(s) > 0) else None


def default_excitation(name: str, recording: xr.Dataset) -> Excitation:
    """Return the excitation that a recording implies: "trace" for a measured pressure, "pulse" for a nominal one."""
    if {"pressure", "actuation"} & set(recording):
        return "trace"
    if "nominal_pressure" in recording.attrs:
        return "pulse"
    raise InputError(
        f"recording {name} has neither a measured pressure nor a nominal level: state nominal_pressure, "
        "or excitation 'release' for a body that was let go"
    )
