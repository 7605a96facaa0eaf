"""States in which a recording begins: at rest under its first inputs, where the body was left, or in motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.identification.held_pose import pose_through, rates_through
from pliant.identification.plans import ModelAt, Plans
from pliant.mechanics import mechanics_of
from pliant.preprocessing.detectors import white_noise
from pliant.simulation import equilibrium

Array = np.ndarray  # an experiment, which imports this module, is of type Any here
LEAST_FRAMES, LEAST_TIME = 7, 0.05  # of the first frames from which position and velocity are estimated; s
EARLY = 5  # first frames that must move too: a motion that begins later starts from rest
LEAST_PATH = 0.01  # of the peak displacement, in the first frames: less is no motion
LATEST = 1.0  # s after the start, by which the first frames end
STEADY = 0.5  # speed in the first five frames over that in all first frames, at least
ABOVE_NOISE = 10.0  # path in the first frames over the noise of a coordinate


class StartState(NamedTuple):
    """State of a chain at the start of a simulation: coordinates and their rates (N,) [rad, rad/s; strains]."""

    x: Array
    rate: Array


class FirstMotion(NamedTuple):
    """Positions [m] and velocities [m/s] (S, d) of S stations at the first frame."""

    position: Array
    velocity: Array


class AtRest:
    """The start of a recording of a body at rest: the equilibrium under its first inputs."""

    from_rest = True

    def state(
        self, model_at: ModelAt, _exp: Any, _params: Mapping[str, float], inputs: Array, load: Array | None,
        _plans: Plans,
    ) -> StartState:
        """Return the equilibrium under constant `inputs` (C,) [SI] and the link loads of known forces, if there are
        any.
        """
        chain = mechanics_of(model_at.model)
        x = model_at.at_rest(inputs) if load is None else chain.coordinates(
            equilibrium(model_at.model, inputs, link_load=load))  # fmt: skip
        return StartState(x, np.zeros(chain.size))


class AtPose(AtRest):
    """The start of a recording of a body that stands where it was left, in the pose that its first frames show.

    What the stations leave open is as in the equilibrium under the first inputs. Creep is relaxed at the pose: what
    happened before the recording goes on in the motion for as long as the creep lasts.
    """

    from_rest = False

    def state(
        self, model_at: ModelAt, exp: Any, params: Mapping[str, float], inputs: Array, load: Array | None,
        plans: Plans,
    ) -> StartState:
        """Return the state in which the chain is nearest to the equilibrium under `inputs` (C,) [SI] and `load`, and
        its S points are and move as the first frames of the experiment show.
        """
        first, chain = self.shown(exp), model_at.carrying(exp.stations)
        shift = np.array([params.get(f"base_{axis}", 0.0) for axis in "xyz"[: exp.dimension]])
        x = super().state(model_at, exp, params, inputs, load, plans).x
        q = pose_through(chain, first.position - shift, plans.poses, chain.joint_coordinates(x))
        rate = rates_through(chain, q, first.velocity) if first.velocity.any() else np.zeros(q.size)
        return StartState(chain.coordinates(q), chain.from_joints @ rate)

    def shown(self, exp: Any) -> FirstMotion:
        """Return the positions of the stations of an experiment in the first frames that show them, at rest."""
        places = [place[time <= time[0] + LEAST_TIME].mean(axis=0)
                  for time, place in (distinct_frames(exp, k) for k in range(len(exp.stations)))]  # fmt: skip
        return FirstMotion(np.array(places), np.zeros((len(places), exp.dimension)))


class Moving(AtPose):
    """The start of a recording in motion: the pose and the rates that its first frames show.

    What the stations leave open is as in the equilibrium under the first inputs, and as little in motion as possible.
    Creep is relaxed at the pose.
    """

    def shown(self, exp: Any) -> FirstMotion:
        """Return the positions and velocities of the stations of an experiment at its first frame."""
        return first_motion(exp)


def first_motion(exp: Any) -> FirstMotion:
    """Return the positions and velocities of the stations of an experiment at its first frame: those of a parabola
    through the first frames of each station, at least `LEAST_FRAMES` and those within `LEAST_TIME`.

    Frames that repeat the one before, as of a tracker that is slower than the log, are not used.
    """
    points, rates = zip(*(parabola(*first_frames(exp, k), exp.time[0]) for k in range(len(exp.stations))), strict=True)
    return FirstMotion(np.array(points), np.array(rates))


def parabola(time: Array, position: Array, start: float) -> tuple[Array, Array]:
    """Return position (d,) [m] and velocity (d,) [m/s] at `start` [s] of the parabola nearest to K positions (K, d)."""
    scale = time[-1] - start
    powers = ((time - start) / scale)[:, None] ** np.arange(3)
    constant, slope, _ = np.linalg.lstsq(powers, position)[0]
    return constant, slope / scale


def first_frames(exp: Any, station: int) -> tuple[Array, Array]:
    """Return times (K,) [s] and positions (K, d) [m] of the first distinct frames of a station."""
    time, position = distinct_frames(exp, station)
    count = max(LEAST_FRAMES, int(np.searchsorted(time, exp.time[0] + LEAST_TIME)))
    return time[:count], position[:count]


def distinct_frames(exp: Any, station: int) -> tuple[Array, Array]:
    """Return times (K,) [s] and positions (K, d) [m] of the frames that show a station, without those that repeat the
    frame before.
    """
    complete = np.isfinite(exp.position[:, station]).all(axis=1)
    position, time = exp.position[complete, station], exp.time[complete]
    other = np.append(True, (np.diff(position, axis=0) != 0).any(axis=1))
    return time[other], position[other]


def begins_in_motion(exp: Any) -> bool:
    """Return whether the last station of an experiment moves in its first frames: by more than their noise, by more
    than 1 % of the peak displacement, and no slower in the first five of them.

    False where the simulation does not begin with the recording's inputs, the first frames come too late, or a station
    has too few distinct ones.
    """
    if not may_move(exp):
        return False
    if min(len(first_frames(exp, k)[0]) for k in range(len(exp.stations))) < LEAST_FRAMES:
        return False
    time, position = first_frames(exp, len(exp.stations) - 1)
    if time[-1] - exp.time[0] > LATEST:
        return False
    noise = float(white_noise(distinct_frames(exp, len(exp.stations) - 1)[1][:, None]).max())
    path = float(np.linalg.norm(position[-1] - position[0]))
    early = float(np.linalg.norm(position[EARLY - 1] - position[0])) / (time[EARLY - 1] - time[0])
    steady = early > STEADY * path / (time[-1] - time[0])
    return path > max(ABOVE_NOISE * noise, LEAST_PATH * exp.travel) and bool(steady)


def may_move(exp: Any) -> bool:
    """Return whether an experiment can begin in motion: measured inputs and positions, on links that are known."""
    return exp.excitation == "trace" and not (exp.poses or exp.own_places or exp.without_positions)


def last_of_first_frames(exp: Any) -> float:
    """Return the time [s] of the first frame of the station that is seen last."""
    return float(max(distinct_frames(exp, k)[0][0] for k in range(len(exp.stations))))


def check_start(exp: Any) -> None:
    """Raise InputError if an experiment that does not begin at rest has no measured inputs or positions, or if one that
    begins in motion shows a station in too few frames.
    """
    if exp.start.from_rest:
        return
    if not may_move(exp):
        raise InputError(
            f"experiment {exp.name}: only a recording of positions under measured inputs can begin in motion or in a "
            "pose, without poses and own_places: leave out start, or the others"
        )
    if (late := last_of_first_frames(exp) - exp.time[0]) > LATEST and not isinstance(exp.start, Moving):
        raise InputError(f"experiment {exp.name}: a station is first seen {late:.3g} s after the start, too late for a "
                         "start in the pose of the first frames: leave out start, or the station")  # fmt: skip
    for k, station in enumerate(exp.stations if isinstance(exp.start, Moving) else ()):
        if len(first_frames(exp, k)[0]) < LEAST_FRAMES:
            raise InputError(
                f"experiment {exp.name}: station {station!r} shows fewer than {LEAST_FRAMES} different positions, too "
                "few for a start in motion: leave out start"
            )


def start_note(exp: Any) -> str:
    """Return sentences on the start and the warm-up of an experiment, '' for one that begins at rest and has none."""
    notes = []
    if isinstance(exp.start, Moving):
        speed = 1e3 * np.linalg.norm(first_motion(exp).velocity[-1])
        notes.append(f"the recording begins in motion ({exp.stations[-1]} at {speed:.3g} mm/s): its simulation starts "
                     "from the pose and the rates of the first frames, not at rest under the first inputs")  # fmt: skip
    elif not exp.start.from_rest:
        compared = "" if exp.warm_up else "; these frames count in its error too, as no warm_up is stated"
        notes.append("its simulation starts where the body was left, in the pose of the first frames, not at rest "
                     f"under the first inputs{compared}")  # fmt: skip
    if exp.warm_up:
        notes.append(f"the first {exp.warm_up:.4g} s, {int(exp.warming.sum())} of {exp.time.size} frames, are a "
                     "warm-up: they are simulated, but have no weight in fits and errors")  # fmt: skip
    return "; ".join(notes)
