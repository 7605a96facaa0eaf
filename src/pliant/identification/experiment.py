"""One recording as an experiment: what was done, what was seen, and what the model says of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
import xarray as xr

from pliant.display import Card, Shown
from pliant.errors import InputError
from pliant.identification.drives import check_drives, drives_of, leading
from pliant.identification.edges import held_pose, steady
from pliant.identification.experiment_checks import check_extras
from pliant.identification.following import moved
from pliant.identification.forward_model import set_up
from pliant.identification.parameters import Parameter, for_record
from pliant.identification.recorded import (
    Excitation,
    default_excitation,
    dense_arc_length,
    one_chamber,
    recorded_angles,
    recorded_places,
)
from pliant.model import Model
from pliant.recording.schema import check_recording
from pliant.simulation import Trace
from pliant.simulation.forces import PointForce, checked

Array = np.ndarray
FIRST_FRAMES = 5  # of a body at rest: their median tells where its points are
Held = Literal["unloaded", "measured"]
Angles = bool | Literal["only"]
AngleReference = Literal["rest", "base", "joint", ""]


@dataclass(frozen=True, repr=False)
class Experiment(Shown):
    """A planar recording with the excitation that made it.

    Parameters
    ----------
    name : str
    time : array (T,)
        s.
    position : array (T, S, 2)
        Observed points in the base frame, m; NaN where a point was not seen, and throughout where angles alone were.
    stations : tuple of str
        Names of the S points; the model carries points of the same names.
    excitation : {"trace", "pulse", "step", "release"}
        A measured pressure; a pressure of known level between unknown edges (parameters ``start`` and ``stop``); one
        that lasts until the recording ends (``start`` alone); or a body held by hand in its unloaded shape, or by a
        force (``hold_force``), and let go at an unknown time (``release``).
    pressure : Trace or None
        The measured pressure, Pa.
    level : float
        The nominal level of a pulse or a step, Pa.
    known : dict
        Parameters of this recording alone whose values are known, such as the tip_mass that it carried.
    angle : array (T, S) or None
        Observed angles about +z, rad; NaN where an angle was not seen.
    angle_reference : {"rest", "base", "joint", ""}
        What the angles are measured from: the rest pose, the base tangent, or the station before (the first: the base).
    noise : dict
        Standard deviation of a station's coordinates where it is known, m; by name.
    angle_noise : float or None
        Standard deviation of the angles where it is known, rad.
    arc_length : array (S,) or None
        Of the stations, m: each then counts by the length that it stands for, so that a crowd counts no more.
    held : array (S, 2) or None
        Where a release held the observed points, m, when not in the unloaded shape: the hand's pose is then taken as
        measured, pulled there from the unloaded shape.
    forces : tuple of PointForce
        Known forces at points of the body, such as a thread that pulls.
    angles_alone : bool
        Whether a fit compares the angles and leaves the positions to the eye.
    own_places : bool
        Whether the places of the observed points are read off this recording's own first frames, with the chain at
        rest there, in place of the model's: of markers that were set anew, or a body that crept in between.
    drives : dict
        Measured pressures by the chamber of the model that each drives, where it has several; those not named rest at
        0 Pa. `pressure` is then the one that moves most.
    placeless : bool
        Whether no place was observed, so that everything rests on the angles; found from the data.
    travel : float
        Largest displacement of the last station from its rest, m, or its largest turn, rad, where `placeless`; found
        from the data, spikes of single frames passed over.
    """

    name: str
    time: Array
    position: Array
    stations: tuple[str, ...]
    excitation: Excitation
    pressure: Trace | None = None
    level: float = 0.0
    known: Mapping[str, float] = field(default_factory=dict)
    angle: Array | None = None
    angle_reference: AngleReference = ""
    noise: Mapping[str, float] = field(default_factory=dict)
    angle_noise: float | None = None
    arc_length: Array | None = None
    held: Array | None = None
    forces: tuple[PointForce, ...] = ()
    angles_alone: bool = False
    own_places: bool = False
    drives: Mapping[str, Trace] = field(default_factory=dict)
    placeless: bool = field(init=False)
    travel: float = field(init=False)

    def __post_init__(self) -> None:
        if not self.name or "." in self.name:
            raise InputError(f"an experiment has a name without a dot, got {self.name!r}")
        for key, value in self.known.items():
            Parameter(key, value)  # refuses what is not known, not finite or not possible
        if self.position.shape != (self.time.size, len(self.stations), 2):
            raise InputError(
                f"experiment {self.name}: positions must be (time, station, 2) = "
                f"{(self.time.size, len(self.stations), 2)}, got {self.position.shape}"
            )
        object.__setattr__(self, "placeless", self.angle is not None and not np.isfinite(self.position).any())
        check_extras(self)
        if self.drives:
            check_drives(self)
            object.__setattr__(self, "pressure", self.drives[leading(self.drives)])
        if (self.excitation == "trace") != (self.pressure is not None):
            raise InputError(f"experiment {self.name}: excitation 'trace', and it alone, goes with a measured pressure")
        if self.excitation in ("pulse", "step") and not self.level > 0:
            raise InputError(
                f"experiment {self.name}: a {self.excitation} needs its nominal level in Pa, got {self.level}"
            )
        for k, station in enumerate(self.stations):
            if np.isfinite(self.compared[:, k]).all(axis=1).sum() < 10:
                raise InputError(f"experiment {self.name}: station {station!r} was seen in fewer than 10 frames")
        object.__setattr__(self, "forces", tuple(checked(f"experiment {self.name}", f) for f in self.forces))
        seen = steady(self)
        seen = seen[np.isfinite(seen).all(axis=1)]
        travel = float(np.linalg.norm(seen - np.median(seen[:5], axis=0), axis=1).max())
        if travel == 0:
            raise InputError(f"experiment {self.name}: its last station, {self.stations[-1]!r}, never moves")
        object.__setattr__(self, "travel", travel)

    def card(self) -> Card:
        """What was done and how much was seen."""
        level = f"{self.level / 1e3:.4g} kPa"
        done = {"trace": "a measured pressure", "pulse": f"a pulse of {level}", "step": f"a step to {level}",
                "release": "a release"}  # fmt: skip
        seen = f"{self.time.size} frames of {', '.join(self.stations)} over {np.ptp(self.time):.3g} s"
        if self.drives:
            done["trace"] = f"measured pressures of {', '.join(self.drives)}"
        unit, factor = self.shown_in
        travel = f"travel {factor * self.travel:.3g} {unit}"
        return Card(f"Experiment {self.name!r}: {done[self.excitation]}, {seen}, {travel}")

    @property
    def compared(self) -> Array:
        """What a model is compared by: places (T, S, 2), m; angles (T, S, 1), rad, where no place was observed."""
        return self.angle[..., None] if self.placeless and self.angle is not None else self.position

    @property
    def last_station(self) -> Array:
        """What was observed of the last station: places (T, 2), m, or angles (T, 1), rad."""
        return self.compared[:, -1]

    @property
    def shown_in(self) -> tuple[str, float]:
        """The unit in which a reader reads what is compared, and how many of it make one SI unit."""
        return ("deg", float(np.degrees(1.0))) if self.placeless else ("mm", 1e3)

    def synchronised(self, values: Mapping[str, float]) -> Experiment:
        """The experiment with its measured pressure on the clock of the shape, as the parameter ``start`` has it."""
        start = {**for_record(values, self.name), **self.known}.get("start", 0.0)
        if self.pressure is None or start == 0.0:
            return self
        moved = {name: Trace(t.time + start, t.pressure) for name, t in self.drives.items()}
        return replace(self, pressure=Trace(self.pressure.time + start, self.pressure.pressure), drives=moved)

    @cached_property
    def first_places(self) -> Array:
        """Where the observed points (S, 2) are in their first frames, m."""
        seen = [p[np.isfinite(p).all(axis=1)][:FIRST_FRAMES] for p in np.moveaxis(self.position, 1, 0)]
        return np.array([np.median(p, axis=0) for p in seen])

    @property
    def own_parameters(self) -> tuple[str, ...]:
        """Names of the parameters that belong to this recording alone and cannot be carried to another."""
        names = {"trace": (), "pulse": ("start", "stop"), "step": ("start",), "release": ("release",)}[self.excitation]
        return tuple(f"{self.name}.{n}" for n in names)


def experiment(
    name: str, recording: xr.Dataset, *, stations: tuple[str, ...] | None = None, excitation: Excitation | None = None,
    known: Mapping[str, float] | None = None, noise: Mapping[str, float] | None = None,
    angles: Angles = False,
    held: Held = "unloaded", own_places: bool = False,
    forces: Sequence[PointForce] = (), drive: Mapping[str, str | int] | None = None,
) -> Experiment:
    """An experiment from an aligned (planar) recording.

    Parameters
    ----------
    name : str
        Without a dot: parameters of this recording alone are called ``name.parameter``.
    recording : xarray.Dataset
        Schema of `pliant.recording.schema`, frame "planar".
    stations : tuple of str, optional
        Which to use, in order; the last one is the tip. Default: all.
    excitation : {"trace", "pulse", "step", "release"}, optional
        Default: "trace" when the recording has a measured pressure, "pulse" when it has a nominal one.
    noise : dict, optional
        Standard deviation of coordinates by station, m, where it is known.
    angles : bool or "only"
        Whether to fit the recorded angles too, or them alone.
    held : {"unloaded", "measured"}
        Where a body that is let go was held: in its unloaded shape, or pulled aside, as the recording shows it in the
        moments before the release.
    own_places : bool
        Whether to read the places of the stations off this recording's own first frames; see `Experiment`.
    forces : sequence of PointForce
        Known forces at points of the body.
    drive : dict, optional
        Of a model of several chambers: chamber of the model to the chamber of the recording that drives it, by name or
        index (from 0). Chambers that it leaves out rest at 0 Pa.

    Raises
    ------
    InputError
        When the recording is not planar, has no pressure of either kind and is not a release, or lacks a station.
    """
    check_recording(recording)
    if recording.attrs.get("frame") != "planar":
        raise InputError(f"recording {name} is in the frame {recording.attrs.get('frame')!r}: align it first")
    available = [str(s) for s in recording.station.values]
    used = tuple(stations or available)
    if missing := [s for s in used if s not in available]:
        raise InputError(f"recording {name} has no station {missing[0]!r}; it has {', '.join(available)}")
    excitation = excitation or default_excitation(name, recording)
    trace, drives = None, {}
    if drive and excitation != "release":
        drives = drives_of(name, recording, drive)
    elif excitation == "trace":
        pressure = recording["pressure"]
        trace = Trace(recording["pressure_time"].values, one_chamber(name, pressure))
    made = Experiment(
        name, recording.time.values.astype(float), recorded_places(recording, used), used, excitation, trace,
        float(recording.attrs.get("nominal_pressure", 0.0)), dict(known or {}),
        **recorded_angles(name, recording, used, wanted=bool(angles) or "position" not in recording),
        noise=dict(noise or {}),
        arc_length=dense_arc_length(recording, used), forces=tuple(forces),
        angles_alone=angles == "only" or "position" not in recording, drives=drives,
        own_places=own_places,
    )
    return replace(made, held=held_pose(made)) if held == "measured" else made


def predict(model: Model, exp: Experiment, values: Mapping[str, float], step: float) -> dict[str, Any]:
    """What the model says of an experiment: positions (T, S, 2) [m], angles (T, S) [rad], which of them are `compared`,
    pressure (T,) [Pa], (T, C) of several chambers.

    `values` holds parameter values by name; those of the experiment `exp` overrule shared ones. `step` is that of the
    integration, s.
    """
    made = set_up(model, exp, values, step)
    rows = moved(made, made.numbers, exp.time.size)
    return {"position": rows[..., :2], "angle": turned(exp, rows), "compared": compared_of(exp, rows),
            "pressure": made.pressure, "model": made.model}  # fmt: skip


def predict_body(model: Model, exp: Experiment, values: Mapping[str, float], step: float) -> Array:
    """Where the whole chain is: base, first joint and link tips (T, n + 2, 2) [m]; arguments as of `predict`."""
    made = set_up(model, exp, values, step)
    along = np.concatenate([[0.0, made.model.base_length], made.model.link_length])
    carrier = np.concatenate([[-1, -1], np.arange(made.model.n)])
    chain = made._replace(carrier=carrier)
    own = made.numbers._replace(along=along, across=0 * along, sensor_lag=np.zeros(0))  # no sensor sees the chain
    return moved(chain, own, exp.time.size)[..., :2]


def compared_of(exp: Experiment, rows: Array) -> Array:
    """What is compared (..., T, S, 2 or 1) of observed rows (..., T, S, 3); see `Experiment.compared`."""
    return turned(exp, rows)[..., None] if exp.placeless else rows[..., :2]


def turned(exp: Experiment, rows: Array) -> Array:
    """Angles (..., T, S) [rad] of observed rows (..., T, S, 3), from where the experiment's are measured."""
    angle = rows[..., 2]
    if exp.angle_reference == "joint":
        return np.diff(angle, axis=-1, prepend=0.0)
    return angle - angle[..., :1, :] if exp.angle_reference == "rest" else angle
