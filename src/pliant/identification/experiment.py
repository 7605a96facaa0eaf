"""One recording as an experiment: its excitation and its observed rows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from pliant.display import Card, Shown
from pliant.drawing import body_svg
from pliant.errors import InputError
from pliant.identification.parameters import Parameter, for_record
from pliant.identification.recorded import Excitation
from pliant.preprocessing.detectors import without_spikes
from pliant.simulation import Trace
from pliant.simulation.forces import PointForce, checked

Array = np.ndarray
UNIT = 1e-3  # largest difference of a quaternion's length from 1
FIRST_FRAMES = 5  # of a body at rest: their median tells where its points are
AngleReference = Literal["rest", "base", "joint", ""]


@dataclass(frozen=True, repr=False)
class Experiment(Shown):
    """An aligned recording, in a plane or in space, with the excitation that made it.

    Parameters
    ----------
    name : str
    time : array (T,)
        s.
    position : array (T, S, 2)
        Observed points in the base frame, m; (T, S, 3) in space; NaN where a point was not seen, and throughout where
        angles alone were.
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
    orientation : array (T, S, 4) or None
        Of a recording in space, unit quaternions x, y, z, w of the turns of rigid bodies at the stations since the
        first frame, in the axes of the base frame; NaN where none was seen. Each is compared with its link's by the
        rotation vector between them.
    orientation_noise : float or None
        Standard deviation of these rotation vectors where it is known, rad.
    arc_length : array (S,) or None
        Of the stations, m: each then counts by the length that it stands for, so that a crowd counts no more.
    held : array (S, 2), (S, 3) in space, or None
        Where a release held the observed points, m, when not in the unloaded shape: the hand's pose is then taken as
        measured, pulled there from the unloaded shape.
    forces : tuple of PointForce
        Known forces at points of the body, such as a thread that pulls.
    angles_alone : bool
        Whether a fit compares the angles and leaves the positions to the eye.
    own_places : bool
        Whether the places of the observed points are read off this recording's own first frames, with the chain at
        rest there, in place of the model's: of markers that were set anew, or a body that crept in between.
    poses : bool
        Whether each row is a settled pose under the inputs of its moment, reached from the one before: nothing between
        rows is simulated. Of a body in space.
    drives : dict
        Measured pressures by the chamber of the model that each drives, where it has several; those not named rest at
        0 Pa. `pressure` is then the one that moves most.
    input_kinds : dict
        Kind of each recorded input ("pressure", "tension", "displacement", "angle") by the input of the model that it
        drives, "" the only one; empty where that is not known.
    x_sign : {1, -1}
        -1 where the base frame is turned by pi about the base tangent against the recording's own axes.  # D4
    without_positions : bool
        Whether no place was observed, so that everything rests on the angles; found from the data.
    travel : float
        Largest displacement of the last station from its rest, m, or its largest turn, rad, where `without_positions`;
        found from the data, spikes of single frames passed over.
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
    orientation: Array | None = None
    orientation_noise: float | None = None
    arc_length: Array | None = None
    held: Array | None = None
    forces: tuple[PointForce, ...] = ()
    angles_alone: bool = False
    own_places: bool = False
    poses: bool = False
    drives: Mapping[str, Trace] = field(default_factory=dict)
    input_kinds: Mapping[str, str] = field(default_factory=dict)
    x_sign: int = 1
    without_positions: bool = field(init=False)
    travel: float = field(init=False)

    def __post_init__(self) -> None:
        if not self.name or "." in self.name:
            raise InputError(f"an experiment has a name without a dot, got {self.name!r}")
        for key, value in self.known.items():
            Parameter(key, value)  # refuses what is not known, not finite or not possible
        wanted = (self.time.size, len(self.stations))
        if self.position.shape not in ((*wanted, 2), (*wanted, 3)):
            raise InputError(
                f"experiment {self.name}: positions must be (time, station, 2) = {(*wanted, 2)}, or (time, station, 3) "
                f"in space, got {self.position.shape}"
            )
        object.__setattr__(self, "without_positions", self.angle is not None and not np.isfinite(self.position).any())
        check_extras(self)
        check_orientation(self)
        check_poses(self)
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
            if np.isfinite(self.compared[:, k]).all(axis=1).sum() < (1 if self.poses else 10):
                few = "no pose" if self.poses else "fewer than 10 frames"
                raise InputError(f"experiment {self.name}: station {station!r} was seen in {few}")
        pulls = tuple(checked(f"experiment {self.name}", f, self.dimension) for f in self.forces)
        object.__setattr__(self, "forces", pulls)
        seen = self.steady
        seen = seen[np.isfinite(seen).all(axis=1)]
        travel = farthest(seen, poses=self.poses)
        if travel == 0:
            raise InputError(f"experiment {self.name}: its last station, {self.stations[-1]!r}, never moves")
        object.__setattr__(self, "travel", travel)

    def card(self) -> Card:
        """Return a summary of the excitation and of the frames."""
        level = f"{self.level / 1e3:.4g} kPa"
        done = {"trace": "a measured pressure", "pulse": f"a pulse of {level}", "step": f"a step to {level}",
                "release": "a release"}  # fmt: skip
        seen = f"{self.time.size} frames of {', '.join(self.stations)} over {np.ptp(self.time):.3g} s"
        if self.drives:
            done["trace"] = f"measured pressures of {', '.join(self.drives)}"
        unit, factor = self.shown_in
        travel = f"travel {factor * self.travel:.3g} {unit}"
        title = f"Experiment {self.name!r}: {done[self.excitation]}, {seen}, {travel}"
        return Card(title, drawing="" if self.without_positions else body_svg(self.drawn_poses(), title))

    def drawn_poses(self) -> list[tuple[str, Array]]:
        """The body at five instants from the first to the farthest, and the path of the last station, to draw."""
        whole = np.flatnonzero(np.isfinite(self.position).all(axis=(1, 2)))
        away = np.linalg.norm(self.position[whole, -1] - self.position[whole[:1], -1], axis=1)
        reached = [whole[np.argmax(away >= f * away.max())] for f in np.linspace(0, 1, 5)] if whole.size else []
        shown = seen_from_side(self.position)
        return [*(("measured", np.vstack([np.zeros((1, 2)), shown[k]])) for k in dict.fromkeys(reached)),
                ("path", shown[:, -1])]

    @property
    def dimension(self) -> int:
        """Dimension of the space that the body moves in, 2 or 3."""
        return int(self.position.shape[2])

    @property
    def compared(self) -> Array:
        """Return the observed values that a model is compared with: positions (T, S, 2), m; angles (T, S, 1), rad."""
        return self.angle[..., None] if self.without_positions and self.angle is not None else self.position

    @property
    def last_station(self) -> Array:
        """Return the observations of the last station: positions (T, 2), m, or angles (T, 1), rad."""
        return self.compared[:, -1]

    @property
    def steady(self) -> Array:
        """The last station as observed (T, 2) [m], or (T, 1) [rad], with spikes of single frames made NaN.

        Poses that follow each other have none.
        """
        if self.poses:
            return self.last_station
        return without_spikes(self.last_station[:, None])[:, 0]

    @cached_property
    def oriented(self) -> Array:
        """Indices (m,) of the stations whose orientation was observed."""
        if self.orientation is None:
            return np.zeros(0, dtype=int)
        return np.flatnonzero(np.isfinite(self.orientation).all(axis=2).any(axis=0))

    @property
    def shown_in(self) -> tuple[str, float]:
        """The unit in which a reader reads what is compared, and how many of it make one SI unit."""
        return ("deg", float(np.degrees(1.0))) if self.without_positions else ("mm", 1e3)

    @property
    def traces(self) -> Mapping[str, Trace]:
        """Measured inputs by the input of the model that each drives; "" for the one that nobody named."""
        return self.drives or ({} if self.pressure is None else {"": self.pressure})

    @property
    def peak(self) -> float:
        """Value farthest from 0 of the input that moves most, as measured, or its nominal level, SI."""
        return self.pressure.peak if self.pressure is not None else float(self.level)

    def driving(self, name: str) -> Trace | None:
        """Return what was measured of the input `name` of a model: the only trace where none has a name."""
        return self.drives.get(name) if self.drives else self.pressure

    def synchronised(self, values: Mapping[str, float]) -> Experiment:
        """The experiment with its measured pressure on the clock of the shape, as the parameter ``start`` has it."""
        start = {**for_record(values, self.name), **self.known}.get("start", 0.0)
        if self.pressure is None or start == 0.0:
            return self
        moved = {name: Trace(t.time + start, t.pressure) for name, t in self.drives.items()}
        return replace(self, pressure=Trace(self.pressure.time + start, self.pressure.pressure), drives=moved)

    def turned(self) -> Experiment:
        """Return the experiment turned by pi about the base tangent, from the base frame to other axes or back."""
        mirror = np.array([-1.0, 1.0])
        forces = tuple(f._replace(force=f.force * mirror) for f in self.forces)
        return replace(
            self, position=self.position * mirror, angle=None if self.angle is None else -self.angle,
            held=None if self.held is None else self.held * mirror, forces=forces,
        )

    @cached_property
    def first_places(self) -> Array:
        """Median positions (S, 2) of the observed points in their first frames, m."""
        seen = [p[np.isfinite(p).all(axis=1)][:FIRST_FRAMES] for p in np.moveaxis(self.position, 1, 0)]
        return np.array([np.median(p, axis=0) for p in seen])

    @property
    def own_parameters(self) -> tuple[str, ...]:
        """Names of the parameters that belong to this recording alone and cannot be carried to another."""
        names = {"trace": (), "pulse": ("start", "stop"), "step": ("start",), "release": ("release",)}[self.excitation]
        return tuple(f"{self.name}.{n}" for n in names)


def farthest(seen: Array, *, poses: bool) -> float:
    """Return how far places (T, d) [m] lie from the first ones; of a lone pose, how far from the base."""
    if poses and len(seen) == 1:
        return float(np.linalg.norm(seen[0]))
    return float(np.linalg.norm(seen - np.median(seen[: 1 if poses else 5], axis=0), axis=1).max())


def seen_from_side(position: Array) -> Array:
    """Return positions (..., 2) as they are; of positions in space (..., 3) the view in which they move most."""
    if position.shape[-1] == 2:
        return position
    across = position[..., :2].reshape(-1, 2)
    across = across[np.isfinite(across).all(axis=1)]
    side = np.linalg.eigh(np.cov(across.T))[1][:, -1]
    return np.stack([position[..., :2] @ side, position[..., 2]], axis=-1)


def check_extras(exp: Experiment) -> None:
    """Refuse angles, noise levels and arc lengths that do not go with the positions."""
    if exp.dimension == 3 and exp.angle is not None:
        raise InputError(f"experiment {exp.name}: angles belong to a recording in a plane, and this one is in space")
    if exp.angle is not None and exp.angle.shape != exp.position.shape[:2]:
        raise InputError(
            f"experiment {exp.name}: angles must be (time, station) = {exp.position.shape[:2]}, got {exp.angle.shape}"
        )
    if exp.angle is not None and exp.angle_reference not in ("rest", "base", "joint"):
        raise InputError(f"experiment {exp.name}: say what angles are measured from: angle_reference rest, base, joint")
    if exp.angles_alone and exp.angle is None:
        raise InputError(f"experiment {exp.name} compares angles alone, but has none")
    if strange := [s for s in exp.noise if s not in exp.stations]:
        raise InputError(f"experiment {exp.name} has a noise level for {strange[0]!r}, which is no station of it")
    levels = [*exp.noise.values(), *(v for v in (exp.angle_noise, exp.orientation_noise) if v is not None)]
    if bad := [v for v in levels if not (np.isfinite(v) and v > 0)]:
        raise InputError(f"experiment {exp.name}: noise levels must be positive, in m and rad, got {bad[0]}")
    if exp.own_places and (exp.excitation == "release" or exp.angles_alone):
        raise InputError(f"experiment {exp.name}: own_places are read off places of a body at rest, not let go")
    if exp.held is not None and (exp.excitation != "release" or exp.held.shape != exp.position.shape[1:]):
        raise InputError(f"experiment {exp.name}: a held pose (station, axis) goes with a release alone")
    if exp.arc_length is not None and not (
        exp.arc_length.shape == (len(exp.stations),) and np.all(np.diff(exp.arc_length) > 0)
    ):
        raise InputError(f"experiment {exp.name}: arc_length must rise from station to station, one number for each")


def check_poses(exp: Experiment) -> None:
    """Refuse poses of what settles otherwise than under measured inputs in space."""
    if exp.poses and (exp.excitation != "trace" or exp.dimension == 2 or exp.forces or exp.own_places):
        raise InputError(
            f"experiment {exp.name}: poses are those of a body in space under measured inputs (excitation 'trace'), "
            "without forces and own_places"
        )


def check_orientation(exp: Experiment) -> None:
    """Refuse orientations that are none, or go with a recording in a plane."""
    orientation = exp.orientation
    if orientation is None:
        return
    if exp.dimension == 2:
        raise InputError(f"experiment {exp.name}: orientations belong to a recording in space; in a plane give angles")
    if orientation.shape != (*exp.position.shape[:2], 4):
        raise InputError(
            f"experiment {exp.name}: orientations must be (time, station, 4) = {(*exp.position.shape[:2], 4)}, got "
            f"{orientation.shape}"
        )
    if (np.abs(np.linalg.norm(orientation, axis=2) - 1.0) > UNIT).any():
        raise InputError(f"experiment {exp.name}: orientations must be unit quaternions x, y, z, w")


def check_drives(exp: Experiment) -> None:
    """Refuse pressures of chambers that do not share their times, or go beside another excitation."""
    if exp.excitation != "trace":
        raise InputError(
            f"experiment {exp.name}: pressures of chambers go with excitation 'trace', not {exp.excitation!r}"
        )
    first = next(iter(exp.drives.values()))
    if not all(np.array_equal(first.time, t.time) for t in exp.drives.values()):
        raise InputError(f"experiment {exp.name}: the pressures of its chambers must share their times")


def leading(drives: Mapping[str, Trace]) -> str:
    """The chamber whose pressure moves most."""
    return max(drives, key=lambda name: float(np.ptp(drives[name].pressure)))
