"""Emulator of a flex sensor or IMU: one bending angle, quantised and delayed, sampled together with the pressure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pliant.errors import InputError
from pliant.testbed.fibre import body_angle
from pliant.testbed.rod import RodParameters
from pliant.testbed.stepping import RodMotion

Array = np.ndarray
FINE = 1e-3  # s, on which the sensor's lag is taken


@dataclass(frozen=True)
class AngleSensor:
    """Settings of the emulated sensor, which measures one angle of the body relative to its base (SI units).

    Values marked * are standard deviations over specimens.
    """

    name: str = "flex"
    place: float = 1.0  # position as a fraction of the body's length
    lag: float = 0.08  # s, first order
    step: float = float(np.deg2rad(0.8))  # rad, resolution
    noise: float = float(np.deg2rad(0.1))  # rad, white, before quantisation
    drift: float = 0.0  # rad after a second, a random walk
    gain_error: float = 0.01  # *
    zero: float = 0.2  # rad, * reading of a straight body
    rate: float = 20.0  # Hz

    def __post_init__(self) -> None:
        """Raise InputError for settings that are impossible for a sensor."""
        if not 0 < self.place <= 1 or not self.rate > 0:
            raise InputError(
                f"an angle sensor needs 0 < place <= 1 and rate > 0, got place {self.place} and rate {self.rate}"
            )
        for name in ("lag", "step", "noise", "drift", "gain_error", "zero"):
            if getattr(self, name) < 0:
                raise InputError(f"angle sensor setting {name} must be >= 0, got {getattr(self, name)}")


FLEX = AngleSensor()
IMU = AngleSensor(
    "imu", lag=0.02, step=float(np.deg2rad(0.06)), drift=float(np.deg2rad(0.05)), gain_error=0.0, zero=0.1
)


def observe_angle(
    motion: RodMotion, p: RodParameters, sensor: AngleSensor, at: Array, specimen: np.random.Generator,
    rng: np.random.Generator,
) -> Array:
    """Return the sensor's readings (T,) [rad] at the times `at` (T,) [s]."""
    time = np.arange(0.0, at[-1] + FINE, FINE)
    s, theta = body_angle(motion, p, time)
    true = theta[:, np.argmin(np.abs(s - sensor.place * p.length))]
    late = true.copy()
    keep = np.exp(-FINE / sensor.lag) if sensor.lag > 0 else 0.0
    rise = (1.0 - keep) * sensor.lag / FINE
    for k in range(1, time.size):
        late[k] = keep * late[k - 1] + (rise - keep) * true[k - 1] + (1.0 - rise) * true[k]
    readings = (1.0 + sensor.gain_error * specimen.standard_normal()) * np.interp(at, time, late)
    readings += sensor.zero * specimen.standard_normal() + sensor.noise * rng.standard_normal(at.size)
    readings += sensor.drift * np.cumsum(rng.standard_normal(at.size) * np.sqrt(np.diff(at, prepend=at[0])))
    return np.asarray(np.round(readings / sensor.step) * sensor.step if sensor.step > 0 else readings)
