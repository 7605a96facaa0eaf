"""Noise levels of the model and the sensors that state estimators assume."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields

import numpy as np
import xarray as xr

from pliant.equations.observation import ALONG_X, ANGLE, KINDS
from pliant.errors import InputError
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.preprocessing.angles import sensor_noise

Array = np.ndarray
TORQUE_SHARE = 2e-5  # rad sqrt(s): torque noise over stiffness, tuned on one virtual actuator
ALONE_SHARE = 8e-4  # rad sqrt(s): torque noise over stiffness, without a disturbance state
WALK_SHARE = 3e-3  # rad/sqrt(s): random walk of the disturbance over stiffness, tuned on the same
MOTION_GROWTH = 30.0  # s^2/rad^2, tuned on the same


@dataclass(frozen=True)
class Noise:
    """Noise levels of sensors and model that an estimator assumes, as standard deviations in SI units.

    Torques are those of one joint. For the strain of an extensible segment they are scaled by its stiffness, and the
    initial strain is as uncertain as an initial angle.

    Parameters
    ----------
    position : float
        Measured coordinate, including the deviation of the body from a chain of straight links, m.
    angle : float
        Measured angle, or component of an orientation's rotation vector in space, rad.
    torque : float
        Square root of the spectral density of the unmodelled torque, N m sqrt(s).
    pressure : float
        Square root of the spectral density of the pressure sensor's noise, Pa sqrt(s).
    random_walk : float
        Growth of the disturbance torque, N m/sqrt(s); 0 leaves the disturbance out of the state.
    motion_growth : float
        Growth of the disturbance's variance with motion, per mean square of the joint rates, s^2/rad^2: the model errs
        more while the body moves.
    initial_angle, initial_rate, initial_disturbance : float
        Uncertainty of the initial state, rad, rad/s, N m.
    stations : mapping
        Measured coordinate by station, m, where it differs from `position`.
    further : mapping
        Measured value of another kind by its variable in the recording, where it differs from the default in
        `equations.observation.KINDS`.

    Raises
    ------
    InputError
        When a number is negative or not finite, or one that must be positive is zero.
    """

    position: float = KINDS[ALONG_X].noise
    angle: float = KINDS[ANGLE].noise
    torque: float = 3e-3
    pressure: float = 0.0
    random_walk: float = 0.0
    motion_growth: float = 0.0
    initial_angle: float = 0.05
    initial_rate: float = 0.2
    initial_disturbance: float = 0.0
    stations: Mapping[str, float] = field(default_factory=dict)
    further: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        levels = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("stations", "further")}
        for part in ("stations", "further"):
            levels |= {f"{part}[{name}]": value for name, value in getattr(self, part).items()}
        positive = {"position", "angle", "torque", "initial_angle", "initial_rate"}
        for name, value in levels.items():
            if not (np.isfinite(value) and value >= 0) or (value == 0 and (name in positive or "[" in name)):
                sign = "positive" if name in positive or "[" in name else "not negative"
                raise InputError(
                    f"noise {name} must be finite and {sign} (a standard deviation in SI units), got {value}"
                )

    def of_row(self, kind: int, station: str) -> float:
        """Return the standard deviation of a measured value at a station, by its number in
        `equations.observation.KINDS`.
        """
        row = KINDS[kind]
        if row.variable == "position":
            return self.stations.get(station, self.position)
        return {"angle": self.angle, "quaternion": self.angle, **self.further}.get(row.variable, row.noise)

    def densities(self, model: Model) -> tuple[Array, Array, Array, float]:
        """Return the spectral densities of the process noise: of each joint's torque, of each chamber's torque due to
        its pressure noise, and of the random walk of each disturbance torque. The last number [s^2/rad^2], times the
        mean square joint rate, is the relative increase of the random walk's density.
        """
        common = np.array([(float(c.lever_at(0.0)) * self.pressure) ** 2 for c in model.chambers])
        size = scales(model) ** 2
        return self.torque**2 * size, common, self.random_walk**2 * size, float(self.motion_growth)

    def states(self, model: Model) -> int:
        """Return the number of filter states: angles, rates and, if it is estimated, the disturbance torques."""
        return model.size * (3 if self.random_walk > 0 or self.initial_disturbance > 0 else 2)

    def initial(self, model: Model) -> Array:
        """Return the covariance (N, N) of the filter's N states at the start."""
        levels = np.outer([self.initial_angle, self.initial_rate, self.initial_disturbance], np.ones(model.size))
        levels[2] *= scales(model)
        return np.diag(levels.ravel()[: self.states(model)] ** 2)


def scales(model: Model) -> Array:
    """Return factors (N,) for the N joint coordinates: the noise of each coordinate's force, divided by that of a
    joint's bending torque.

    A factor is 1 for the bending of joints. For strains of segments, and in space for bending about y and for twist, it
    is their stiffness over the joints' mean.
    """
    chain = mechanics_of(model)
    size = chain.joints.K / float(np.mean(model.stiffness))
    size[chain.kinds[0].rows] = 1.0
    return np.asarray(size)


def default_noise(model: Model, *, disturbance: bool = True, recordings: Sequence[xr.Dataset] = ()) -> Noise:
    """Return default noise levels in proportion to the model's stiffness. With `disturbance`, they make an estimator
    also estimate a disturbance torque of each joint.

    Without a disturbance, model errors are described by white torque noise, which fits them less well. If the
    `recordings` hold angles alone, the noise of an angle is the one that they show, where that is larger than the
    default: sensors of inclination are noisier than trackers.
    """
    stiffness = float(np.mean(model.stiffness))
    alone = [r["angle"].values for r in recordings if "angle" in r and "position" not in r]
    levels = [float(np.sqrt(np.mean(sensor_noise(angle) ** 2))) for angle in alone]
    angle = max([Noise.angle, *levels])
    if not disturbance:
        return Noise(torque=ALONE_SHARE * stiffness, angle=angle)
    return Noise(
        angle=angle, torque=TORQUE_SHARE * stiffness, random_walk=WALK_SHARE * stiffness, motion_growth=MOTION_GROWTH,
        initial_disturbance=0.01 * stiffness,
    )
