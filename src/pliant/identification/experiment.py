"""The class `Experiment`: a recording of positions or angles together with the input that caused the motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from pliant.display import Card, Shown, body_svg
from pliant.equations.observation import FURTHER, KINDS, kinds_of
from pliant.errors import InputError
from pliant.identification.experiment_checks import check_excitation, check_experiment
from pliant.identification.parameters import Parameter, for_record
from pliant.identification.starts import AtRest, check_start
from pliant.preprocessing.detectors import without_spikes
from pliant.shapes import Float
from pliant.simulation import BaseMotion, Trace
from pliant.simulation.forces import PointForce, checked

Array = np.ndarray
FIRST_FRAMES = 5  # frames of a body at rest, whose median is the first position
Excitation = Literal["trace", "pulse", "step", "release"]
EDGES_OF: dict[Excitation, tuple[str, ...]] = {  # edge times, which are parameters of a recording
    "trace": (), "pulse": ("start", "stop"), "step": ("start",), "release": ("release",),
}
AngleReference = Literal["rest", "base", "joint", ""]


class FurtherRows(NamedTuple):
    """Measured values of one variable at S stations in T frames, with the constants of its kinds of rows."""

    values: Array  # (T, S), or (T, S, d) for d kinds of rows; NaN where nothing was measured
    constants: Array  # (S, k)
    noise: float | None = None  # known standard deviation of the values
    reference: AngleReference = "base"  # "rest": values are compared by their changes since the first frames

    @property
    def columns(self) -> Array:
        """Return the measured values as (T, S, d), for d kinds of rows."""
        return self.values if self.values.ndim == 3 else self.values[..., None]

    @property
    def compared(self) -> Array:
        """Return the values (T, S, d) that a fit compares: the measured ones, or their changes since the first frames
        where the reference is "rest".
        """
        return self.referenced(self.columns)

    def referenced(self, values: Array) -> Array:
        """Return modelled or measured values (..., T, S, d) from the reference of the measured ones. At each station,
        the first five frames that show the measured value are the reference "rest".
        """
        if self.reference != "rest":
            return values
        shown = np.isfinite(self.columns).all(axis=2)
        first = shown & (np.cumsum(shown, axis=0) <= FIRST_FRAMES)
        mean = np.where(first[..., None], values, 0.0).sum(axis=-3) / np.maximum(first.sum(axis=0), 1)[:, None]
        return np.asarray(values - mean[..., None, :, :])


@dataclass(frozen=True, repr=False)
class Experiment(Shown):
    """An aligned recording, planar or spatial, with the pressure or other input under which it was made.

    Parameters
    ----------
    name : str
    time : array (T,)
        Times of the frames, s.
    position : array (T, S, 2)
        Positions of the observed points in the base frame, m; (T, S, 3) in space. NaN where a point was not seen, and
        throughout in a recording of angles only.
    stations : tuple of str
        Names of the S observed points; the model has points of the same names.
    excitation : {"trace", "pulse", "step", "release"}
        "trace": a measured pressure. "pulse": a pressure of known level between unknown edge times (parameters
        ``start`` and ``stop``). "step": a pressure of known level from ``start`` to the end of the recording.
        "release": a body held by hand in its unloaded shape, or by a force (``hold_force``), and let go at the unknown
        time ``release``.
    pressure : Trace or None
        The measured pressure, Pa.
    level : float
        The nominal level of a pulse or a step, Pa.
    known : dict
        Known values of parameters for this recording alone, such as the tip_mass that the body carried.
    angle : array (T, S) or None
        Observed angles about +z, rad; NaN where an angle was not seen.
    angle_reference : {"rest", "base", "joint", ""}
        Reference of the angles: the rest pose, the base tangent, or the previous station (for the first, the base).
    noise : dict
        Known standard deviation of a station's coordinates, m, by the name of the station.
    angle_noise : float or None
        Known standard deviation of the angles, rad.
    orientation : array (T, S, 4) or None
        For a recording in space: unit quaternions x, y, z, w of the rotations of rigid bodies at the stations since
        the first frame, in the axes of the base frame; NaN where none was seen. A fit compares each with its link's by
        the rotation vector between them.
    orientation_noise : float or None
        Known standard deviation of these rotation vectors, rad.
    arc_length : array (S,) or None
        Arc lengths of the stations, m. Each station is then weighted by the length of body that it represents, so
        that densely placed stations count no more than others.
    held : array (S, 2), (S, 3) in space, or None
        Measured positions of the observed points before a release, m, of a body that was pulled from its unloaded
        shape. None: it was held in the unloaded shape.
    forces : tuple of PointForce
        Known forces at points of the body, such as the pull of a thread.
    angles_alone : bool
        Whether a fit compares the angles only, although the recording has positions.
    own_places : bool
        Whether the positions of the observed points on their links are taken from the first frames of this recording,
        with the chain at rest, in place of the model's. For markers that were attached anew, or a body that crept.
    poses : bool
        Whether each row is a settled pose under the inputs of its time, reached from the row before. The motion
        between rows is not simulated. For a body in space only.
    drives : dict
        Measured pressures by the chamber that each drives, for a model of several chambers; chambers not named stay at
        0 Pa. `pressure` is then the one that changes most.
    input_kinds : dict
        Kind of each recorded input ("pressure", "tension", "displacement", "angle") by the model input that it drives;
        "" stands for the only one. Empty where the kind is unknown.
    further : dict
        Measured values of other kinds, `FurtherRows`, by the variable of their kind in a recording, see
        `equations.observation.KINDS`.
    base : BaseMotion or None
        Prescribed motion of the base, on the clock of the frames; positions and angles are relative to the moved base.
        None: the base rests.
    x_sign : {1, -1}
        -1 where the base frame is turned by pi about the base tangent against the recording's own axes.  # D4
    start : AtRest
        Start state of simulations, `starts.AtRest`, or for a recording of positions under measured inputs
        `starts.AtPose`, where the body was left, or `starts.Moving`, in motion.
    warm_up : float
        Time from the first frame on, s, that is simulated but not compared with the model. For a recording under
        measured inputs whose first motion depends on what happened before it.
    alone : str
        Variable that is compared where the recording has no positions: "angle", or a key of `further`; "" where it has
        positions. Derived from the data.
    travel : float
        Peak displacement of the last station from its first position, m, or its peak rotation, rad, where
        `without_positions`. Derived from the data; spikes of single frames are ignored.
    """

    name: str
    time: Float[Array, " T"]
    position: Float[Array, "T S d"]
    stations: tuple[str, ...]
    excitation: Excitation
    pressure: Trace | None = None
    level: float = 0.0
    known: Mapping[str, float] = field(default_factory=dict)
    angle: Float[Array, "T S"] | None = None
    angle_reference: AngleReference = ""
    noise: Mapping[str, float] = field(default_factory=dict)
    angle_noise: float | None = None
    orientation: Float[Array, "T S 4"] | None = None
    orientation_noise: float | None = None
    arc_length: Float[Array, " S"] | None = None
    held: Float[Array, "S d"] | None = None
    forces: tuple[PointForce, ...] = ()
    angles_alone: bool = False
    own_places: bool = False
    poses: bool = False
    drives: Mapping[str, Trace] = field(default_factory=dict)
    input_kinds: Mapping[str, str] = field(default_factory=dict)
    further: Mapping[str, FurtherRows] = field(default_factory=dict)
    base: BaseMotion | None = None
    x_sign: int = 1
    start: AtRest = field(default_factory=AtRest)
    warm_up: float = 0.0
    alone: str = field(init=False)
    travel: float = field(init=False)

    def __post_init__(self) -> None:
        if not self.name or "." in self.name:
            raise InputError(f"the name of an experiment must be a text without a dot, got {self.name!r}")
        for key, value in self.known.items():
            Parameter(key, value)  # raises InputError for an unknown name or an invalid value
        wanted = (self.time.size, len(self.stations))
        if self.position.shape not in ((*wanted, 2), (*wanted, 3)):
            raise InputError(
                f"experiment {self.name}: positions must be (time, station, 2) = {(*wanted, 2)}, or (time, station, 3) "
                f"in space, got {self.position.shape}"
            )
        object.__setattr__(self, "alone", variable_alone(self))
        check_experiment(self)
        if self.drives:
            object.__setattr__(self, "pressure", self.drives[leading(self.drives)])
        check_excitation(self)
        for k, station in enumerate(self.stations):
            if np.isfinite(self.compared[:, k]).all(axis=1).sum() < (1 if self.poses else 10):
                few = "no pose" if self.poses else "fewer than 10 frames"
                raise InputError(f"experiment {self.name}: station {station!r} was seen in {few}: leave it out")
        pulls = tuple(checked(f"experiment {self.name}", f, self.dimension) for f in self.forces)
        object.__setattr__(self, "forces", pulls)
        steady = self.steady
        steady = steady[np.isfinite(steady).all(axis=1)]
        travel = farthest(steady, poses=self.poses)
        if travel == 0:
            raise InputError(
                f"experiment {self.name}: its last station, {self.stations[-1]!r}, never moves: check the recording, "
                "or choose another last station"
            )
        object.__setattr__(self, "travel", travel)
        check_start(self)

    def card(self) -> Card:
        """Return a display card: a one-line summary of input and frames, with a drawing of the body."""
        level = f"{self.level / 1e3:.4g} kPa"
        done = {"trace": "a measured pressure", "pulse": f"a pulse of {level}", "step": f"a step to {level}",
                "release": "a release"}  # fmt: skip
        extent = f"{self.time.size} frames of {', '.join(self.stations)} over {np.ptp(self.time):.3g} s"
        if self.drives:
            done["trace"] = f"measured pressures of {', '.join(self.drives)}"
        unit, factor = self.shown_in
        travel = f"travel {factor * self.travel:.3g} {unit}"
        title = f"Experiment {self.name!r}: {done[self.excitation]}, {extent}, {travel}"
        return Card(title, drawing="" if self.without_positions else body_svg(self.drawn_poses(), title))

    def drawn_poses(self) -> list[tuple[str, Array]]:
        """Return labelled lines to draw: the measured body at up to five instants, as base and S stations (S + 1, 2)
        [m], and the path of the last station.
        """
        whole = np.flatnonzero(np.isfinite(self.position).all(axis=(1, 2)))
        away = np.linalg.norm(self.position[whole, -1] - self.position[whole[:1], -1], axis=1)
        reached = [whole[np.argmax(away >= f * away.max())] for f in np.linspace(0, 1, 5)] if whole.size else []
        projected = seen_from_side(self.position)
        return [*(("measured", np.vstack([np.zeros((1, 2)), projected[k]])) for k in dict.fromkeys(reached)),
                ("path", projected[:, -1])]

    @property
    def dimension(self) -> int:
        """Return the dimension of the space in which the body moves, 2 or 3."""
        return int(self.position.shape[2])

    @property
    def without_positions(self) -> bool:
        """Return whether the recording has no positions."""
        return bool(self.alone)

    @property
    def axes(self) -> tuple[str, ...]:
        """Return the names of the compared coordinates: x and y, in space z too, or an angle, or the kinds of rows of
        the variable that is compared alone.
        """
        if not self.alone:
            return tuple("xyz"[: self.dimension])
        return tuple(KINDS[kind].name.replace(" ", "_") for kind in kinds_of(self.alone, self.dimension))

    @property
    def compared(self) -> Float[Array, "T S k"]:
        """Return the observed values of S stations in T frames that a fit compares with the model: positions (T, S, 2
        or 3) [m], or, in a recording without positions, angles (T, S, 1) [rad] or values of a further variable
        (T, S, d). They are NaN in the warm-up.
        """
        return np.where(self.warming[:, None, None], np.nan, self.recorded) if self.warm_up else self.recorded

    @property
    def recorded(self) -> Float[Array, "T S k"]:
        """Return `compared` with the recorded values of the warm-up."""
        if self.alone in self.further:
            return self.further[self.alone].compared
        return self.angle[..., None] if self.alone and self.angle is not None else self.position

    @property
    def warming(self) -> Array:
        """Return whether each of T frames (T,) belongs to the warm-up."""
        return np.asarray(self.time < self.time[0] + self.warm_up)

    @property
    def last_station(self) -> Array:
        """Return the observed positions (T, 2 or 3) [m] of the last station in T frames, or its angles (T, 1) [rad] if
        only these were recorded.
        """
        return self.compared[:, -1]

    @property
    def steady(self) -> Array:
        """Return the observed positions (T, 2 or 3) [m] of the last station in T frames, or its angles (T, 1) [rad] if
        only these were recorded, with outliers set to NaN.

        A recording of settled poses is returned unchanged, since successive poses may differ by any amount.
        """
        if self.poses:
            return self.last_station
        return without_spikes(self.last_station[:, None])[:, 0]

    @cached_property
    def oriented(self) -> Array:
        """Return the indices (m,) of the stations whose orientation was observed."""
        if self.orientation is None:
            return np.zeros(0, dtype=int)
        return np.flatnonzero(np.isfinite(self.orientation).all(axis=2).any(axis=0))

    @cached_property
    def framed(self) -> Array:
        """Return the indices (m,) of the stations whose link frame a fit computes: in space, those whose orientation
        was observed, or all if there are measurements of further kinds.
        """
        return np.arange(len(self.stations)) if self.further and self.dimension == 3 else self.oriented

    @property
    def shown_in(self) -> tuple[str, float]:
        """Return the display unit of positions or angles ("mm" or "deg"), and the factor to it from the SI unit."""
        return ("deg", float(np.degrees(1.0))) if self.without_positions else ("mm", 1e3)

    @property
    def traces(self) -> Mapping[str, Trace]:
        """Return the measured inputs in a mapping from the name of the model input that each drives. The key is "" for
        a single input without a name.
        """
        return self.drives or ({} if self.pressure is None else {"": self.pressure})

    @property
    def peak(self) -> float:
        """Return the value [SI] farthest from 0 of the measured input that varies most; the nominal pressure if no
        input was measured.
        """
        return self.pressure.peak if self.pressure is not None else float(self.level)

    def driving(self, name: str) -> Trace | None:
        """Return the measured input that drives the model input `name`, or None.
        A single unnamed input drives any name.
        """
        return self.drives.get(name) if self.drives else self.pressure

    def synchronised(self, values: Mapping[str, float]) -> Experiment:
        """Return the experiment with its measured inputs delayed by the value of the parameter ``start`` [s]."""
        start = {**for_record(values, self.name), **self.known}.get("start", 0.0)
        if self.pressure is None or start == 0.0:
            return self
        moved = {name: Trace(t.time + start, t.pressure) for name, t in self.drives.items()}
        return replace(self, pressure=Trace(self.pressure.time + start, self.pressure.pressure), drives=moved)

    def thinned(self, every: int) -> Experiment:
        """Return the experiment with each `every`-th frame. Its inputs keep all their samples."""
        return self.of_frames(slice(None, None, every))

    def of_frames(self, rows: slice | Float[Array, " T"]) -> Experiment:
        """Return the experiment with the frames that `rows` selects, a slice or T booleans. Its inputs keep all their
        samples.
        """
        further = {name: f._replace(values=f.values[rows]) for name, f in self.further.items()}
        angle, orientation = (None if a is None else a[rows] for a in (self.angle, self.orientation))
        return replace(self, time=self.time[rows], position=self.position[rows], angle=angle, orientation=orientation,
                       further=further)

    def turned(self) -> Experiment:
        """Return the experiment turned by pi about the base tangent, as filmed from behind: x and
        angles change sign.
        """
        mirror = np.array([-1.0, 1.0])
        forces = tuple(f._replace(force=f.force * mirror) for f in self.forces)
        return replace(
            self, position=self.position * mirror, angle=None if self.angle is None else -self.angle,
            held=None if self.held is None else self.held * mirror, forces=forces,
            base=None if self.base is None else self.base.mirrored(),
        )

    @cached_property
    def first_places(self) -> Array:
        """Return the median position (S, 2 or 3) [m] of each of S markers over the first five frames that show the
        marker.
        """
        first_frames = [p[np.isfinite(p).all(axis=1)][:FIRST_FRAMES] for p in np.moveaxis(self.position, 1, 0)]
        return np.array([np.median(p, axis=0) for p in first_frames])

    @property
    def own_parameters(self) -> tuple[str, ...]:
        """Return the names of this recording's edge-time parameters, such as ``name.start``, which no other recording
        shares.
        """
        return tuple(f"{self.name}.{n}" for n in EDGES_OF[self.excitation])

    @property
    def nominal(self) -> bool:
        """Return whether the pressure was not recorded, but is a pulse or step to the stated `level`."""
        return "start" in EDGES_OF[self.excitation]


def variable_alone(exp: Experiment) -> str:
    """Return the variable that is compared in an experiment without positions: "angle", or the first further variable
    that turns with a link; "" where a position is known.
    """
    if np.isfinite(exp.position).any():
        return ""
    turning = [name for name in exp.further if name in FURTHER and KINDS[FURTHER[name]].unit in ("rad", "1")]
    return "angle" if exp.angle is not None else next(iter(turning), "")


def farthest(seen: Array, *, poses: bool) -> float:
    """Return the largest distance [m; angles: rad] of a path (T, d), T points with d coordinates, from its first point.
    A single settled pose is measured from the base.
    """
    if poses and len(seen) == 1:
        return float(np.linalg.norm(seen[0]))
    return float(np.linalg.norm(seen - np.median(seen[: 1 if poses else 5], axis=0), axis=1).max())


def seen_from_side(position: Array) -> Array:
    """Return spatial positions (..., 3) projected to the vertical plane of largest motion; planar ones unchanged."""
    if position.shape[-1] == 2:
        return position
    across = position[..., :2].reshape(-1, 2)
    across = across[np.isfinite(across).all(axis=1)]
    side = np.linalg.eigh(np.cov(across.T))[1][:, -1]
    return np.stack([position[..., :2] @ side, position[..., 2]], axis=-1)


def leading(drives: Mapping[str, Trace]) -> str:
    """Return the name of the chamber whose measured pressure varies most."""
    return max(drives, key=lambda name: float(np.ptp(drives[name].pressure)))
