"""Emulator of a distributed fibre sensor: gauges measure curvature along a lumen, which is integrated to a shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pliant.errors import InputError
from pliant.testbed.rod import RodParameters
from pliant.testbed.stepping import RodMotion
from pliant.testbed.truth import node_positions

Array = np.ndarray
FINE = 850  # intervals of the body on which the angle is integrated
CORE_ANGLE = (0.0, 0.0, 2.0 * np.pi / 3.0, 4.0 * np.pi / 3.0)


@dataclass(frozen=True)
class FibreSensor:
    """Settings of the emulated fibre sensor (SI units); 0 switches an imperfection off.

    Values marked * are standard deviations over specimens: one value is drawn per seed and held for the whole
    recording.
    """

    spacing: float = 0.8e-3  # m
    gauge: float = 2.4e-3  # m, length over which a gauge averages
    offset: float = 1.5e-3  # m, lumen above the inextensible layer
    lead_in: float = 0.016  # m of straight fibre in the clamp
    tail: float = 0.020  # m of straight fibre behind the cap
    noise: float = 0.2  # 1/m, white, each sample and frame
    bias: float = 0.05  # 1/m, smooth along the fibre, wandering in time
    bias_length: float = 0.04  # m
    bias_time: float = 5.0  # s
    gain_error: float = 0.004  # *
    twist: float = 0.03  # rad, * roll at the end of the fibre, a random walk
    out_of_plane: float = 1.5e-3  # m, * at the tip
    misalignment: float = 0.009  # rad, * about each axis, of the sensor's frame
    displacement: float = 0.5e-3  # m, * along each axis, of the sensor's frame
    jitter: float = 2.0e-4  # s, of the time stamps
    drop_out: float = 0.004  # probability that a frame starts a drop-out
    drop_out_length: float = 1.5  # frames, mean
    latency: float = 4.0e-3  # s by which the time stamps are late
    core_radius: float = 35e-6  # m, of the outer cores (strain output)
    strain_drift: float = 1e-5  # common strain from temperature and tension

    def __post_init__(self) -> None:
        """Raise InputError for settings that are impossible for a fibre."""
        for name in ("spacing", "gauge", "lead_in", "tail", "bias_length", "bias_time", "core_radius"):
            if not getattr(self, name) > 0:
                raise InputError(f"fibre setting {name} must be > 0, got {getattr(self, name)}")
        if not 0.0 <= self.drop_out < 1.0 or self.drop_out_length < 1.0:
            raise InputError(
                "a fibre needs 0 <= drop_out < 1 (a probability) and drop_out_length >= 1 frame, "
                f"got {self.drop_out} and {self.drop_out_length}"
            )
        for name in ("noise", "bias", "jitter", "gain_error", "twist"):
            if getattr(self, name) < 0:
                raise InputError(
                    f"fibre setting {name} is a standard deviation and must be >= 0, got {getattr(self, name)}"
                )


def station_position(p: RodParameters, sensor: FibreSensor) -> Array:
    """Return the arc lengths (G,) [m] of the fibre's G sample points, measured from the actuator's base."""
    count = round((sensor.lead_in + p.length + p.cap_length + sensor.tail) / sensor.spacing)
    return np.asarray(-sensor.lead_in + sensor.spacing * np.arange(count + 1))


def body_angle(motion: RodMotion, p: RodParameters, at: Array) -> tuple[Array, Array]:
    """Return the arc lengths (F,) [m] of F points along the body, and the tangent angles (T, F) [rad] at these points
    and at T times `at` [s].
    """
    index = np.clip(np.searchsorted(motion.time, at) - 1, 0, motion.time.size - 2)
    share = np.clip((at - motion.time[index]) / (motion.time[1] - motion.time[0]), 0.0, 1.0)[:, None]
    kappa = (1.0 - share) * motion.curvature[index] + share * motion.curvature[index + 1]
    s = np.linspace(0.0, p.length, FINE + 1)
    vertex = motion.arc_length[: kappa.shape[1]]
    step = vertex[1] - vertex[0]
    left = np.clip((s / step).astype(int), 0, vertex.size - 2)
    blend = np.clip(s / step - left, 0.0, 1.0)
    fine = (1.0 - blend) * kappa[:, left] + blend * kappa[:, left + 1]
    steps = 0.5 * (fine[:, 1:] + fine[:, :-1]) * (p.length / FINE)
    return s, np.concatenate([np.zeros((at.size, 1)), np.cumsum(steps, axis=1)], axis=1)


def stretched(motion: RodMotion, p: RodParameters, at: Array) -> Array:
    """Return the arc lengths (T, F) [m] of F points along the stretched body at T times `at` [s]."""
    s = np.linspace(0.0, p.length, FINE + 1)
    if not any(c.push for c in p.chambers):
        return np.tile(s, (at.size, 1))
    edge = np.linalg.norm(np.diff(node_positions(motion, at)[:, : p.elements + 1], axis=1), axis=2)
    grown = np.concatenate([np.zeros((at.size, 1)), np.cumsum(edge, axis=1)], axis=1)
    return np.stack([np.interp(s, motion.arc_length[: p.elements + 1], row) for row in grown])


def gauge_curvature(motion: RodMotion, p: RodParameters, sensor: FibreSensor, at: Array) -> Array:
    """Return the true in-plane curvature (T, G) [1/m] of the fibre at T times, averaged over the length of each of G
    gauges.

    The fibre is fixed at the base and slides in its lumen. It needs the length ``(1 + offset kappa) ds`` for a length
    ``ds`` of the body, so that the fibre position of the body's tip changes.
    """
    theta, along = body_angle(motion, p, at)[1], stretched(motion, p, at)
    station = station_position(p, sensor)
    half = 0.5 * sensor.gauge
    out = np.empty((at.size, station.size))
    far = 2.0 * p.length
    for frame in range(at.size):
        sigma = along[frame] + sensor.offset * theta[frame]
        tip, angle = sigma[-1], theta[frame, -1]
        hook = angle + p.cap_curvature * p.cap_length
        knots = np.concatenate([[-far], sigma, [tip + p.cap_length, tip + far]])
        turned = np.concatenate([[0.0], theta[frame], [hook, hook]])
        ahead = np.interp(station + half, knots, turned)
        out[frame] = (ahead - np.interp(station - half, knots, turned)) / sensor.gauge
    return out


def wandering_bias(sensor: FibreSensor, station: Array, at: Array, rng: np.random.Generator) -> Array:
    """Return a random error (T, G) [1/m] for the curvatures that G gauges read at T times. It is smooth along the fibre
    and an Ornstein-Uhlenbeck process in time.
    """
    waves = 24
    wave = rng.standard_normal(waves) / sensor.bias_length
    shape = np.vstack([np.cos(np.outer(wave, station)), np.sin(np.outer(wave, station))])
    keep = np.exp(-np.diff(at, prepend=at[0]) / sensor.bias_time)
    kick = np.sqrt(1.0 - keep**2)
    kick[0] = 1.0
    drive = rng.standard_normal((at.size, 2 * waves))
    level = np.zeros(2 * waves)
    out = np.empty((at.size, 2 * waves))
    for frame in range(at.size):
        level = (keep[frame] if frame else 0.0) * level + kick[frame] * drive[frame]
        out[frame] = level
    return np.asarray(sensor.bias / np.sqrt(waves) * out @ shape)


def sensed_curvature(
    motion: RodMotion, p: RodParameters, sensor: FibreSensor, at: Array, specimen: np.random.Generator,
    rng: np.random.Generator,
) -> Array:
    """Return the curvatures (2, T, G) [1/m] that G gauges read at T times, in the nominal bending plane and out of this
    plane.
    """
    true = gauge_curvature(motion, p, sensor, at)
    station = station_position(p, sensor)
    gain = 1.0 + sensor.gain_error * specimen.standard_normal()
    arch = 2.0 * sensor.out_of_plane * specimen.standard_normal() / p.length**2
    roll = sensor.twist * np.cumsum(specimen.standard_normal(station.size)) / np.sqrt(station.size)
    out = np.stack([gain * true * np.cos(roll), gain * true * np.sin(roll) + arch])
    for k in range(2):
        out[k] += wandering_bias(sensor, station, at, rng) + sensor.noise * rng.standard_normal(true.shape)
    return out


def integrate_shape(kappa: Array, spacing: float) -> Array:
    """Return the positions (T, G, 3) [m] of G points along the fibre at T times, by integration of its curvatures
    `kappa` (2, T, G) [1/m] in two planes. The fibre starts at the origin along +x.

    The first curvature turns the tangent towards +y, the second towards +z. The frame does not roll about the tangent.
    """
    _, frames, stations = kappa.shape
    tangent, m1, m2 = (np.tile(axis, (frames, 1)) for axis in np.eye(3))
    out = np.zeros((frames, stations, 3))
    middle = 0.5 * (kappa[:, :, 1:] + kappa[:, :, :-1]) * spacing
    for k in range(stations - 1):
        a1, a2 = middle[0, :, k, None], middle[1, :, k, None]
        angle = np.maximum(np.hypot(a1, a2), 1e-15)
        u1, u2 = a1 / angle, a2 / angle
        u = u1 * m1 + u2 * m2
        c, s = np.cos(angle), np.sin(angle)
        out[:, k + 1] = out[:, k] + spacing * (s / angle * tangent + (1.0 - c) / angle * u)
        bend = (c - 1.0) * u - s * tangent
        tangent, m1, m2 = c * tangent + s * u, m1 + u1 * bend, m2 + u2 * bend
    return out


def core_strain(kappa: Array, sensor: FibreSensor, rng: np.random.Generator) -> Array:
    """Return the strains (T, 4, G) in the fibre's four cores (one at the centre, three around it) at T times and G
    gauges. `kappa` (2, T, G) [1/m] holds the fibre's curvatures in two planes.
    """
    drift = sensor.strain_drift * np.cumsum(rng.standard_normal(kappa.shape[1])) / np.sqrt(kappa.shape[1])
    cores = [np.zeros(kappa.shape[1:])]
    cores += [-sensor.core_radius * (kappa[0] * np.cos(a) + kappa[1] * np.sin(a)) for a in CORE_ANGLE[1:]]
    return np.asarray(np.stack(cores, axis=1) + drift[:, None, None])


def place(position: Array, sensor: FibreSensor, specimen: np.random.Generator) -> Array:
    """Rotate and shift positions (..., 3) [m] into the sensor's slightly misaligned frame."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec(sensor.misalignment * specimen.standard_normal(3)).as_matrix()
    return np.asarray(position @ turn.T + sensor.displacement * specimen.standard_normal(3))


def drop_frames(frames: int, sensor: FibreSensor, rng: np.random.Generator) -> Array:
    """Return a mask (T,) of T frames that is True for lost ones. Frames are lost in bursts of geometrically distributed
    length.
    """
    lost = np.zeros(frames, dtype=bool)
    for first in np.flatnonzero(rng.random(frames) < sensor.drop_out):
        lost[first : first + rng.geometric(1.0 / sensor.drop_out_length)] = True
    return lost


def time_stamps(at: Array, sensor: FibreSensor, rng: np.random.Generator) -> Array:
    """Return the recorded times (T,) [s] of T frames: the true times plus a latency and a random jitter of at most a
    third of the frame period.
    """
    limit = np.diff(at).min() / 3.0 if at.size > 1 else np.inf
    return at + sensor.latency + np.clip(sensor.jitter * rng.standard_normal(at.size), -limit, limit)
