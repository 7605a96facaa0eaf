"""A virtual body in space: PyElastica's Cosserat rod with three chambers, observed by markers or a multicore fibre.

It shares no code with pliant's models: shear, stretch and twist are computed by PyElastica, which ``pip install
'pliant[bench]'`` installs. ``python -m pliant.testbed.space`` generates the bundled recordings.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.plugins import optional
from pliant.recording import make_recording

if TYPE_CHECKING:
    from collections.abc import Callable

    import xarray as xr

Array = np.ndarray

DURATION, RATE = 6.0, 50.0  # s, Hz
QUIET = 0.5  # s without pressure at the beginning
TRACKER = np.array([[0.0, 0.8, 0.6], [1.0, 0.0, 0.0], [0.0, 0.6, -0.8]])  # tracker's axes from those of the world
ORIGIN = np.array([0.31, -0.12, 1.04])  # m, of the world in the tracker's frame
SEED = 1  # of the bundled recordings
FIBRE = "mixed"  # the bundled motion that the fibre records too


@dataclass(frozen=True)
class BodyInSpace:
    """A hanging silicone cylinder with three chambers, in a sleeve that nearly prevents lengthening (SI units).

    The chambers lie at the angles `azimuth` about the axis, measured from x of the base frame towards y, at the
    distance `offset` from it. Their pressures follow the command with a first-order lag.
    """

    length: float = 0.17
    radius: float = 0.015
    density: float = 1080.0
    youngs_modulus: float = 5e5
    sleeve: float = 10.0  # axial stiffness over that of the silicone alone
    damping: float = 1.2  # 1/s, force per mass and velocity
    azimuth: tuple[float, ...] = (np.pi / 2, np.pi * 7 / 6, np.pi * 11 / 6)
    area: float = 1e-4  # m^2, of one chamber
    offset: float = 9e-3  # m
    lag: float = 0.03  # s
    elements: int = 24
    time_step: float = 5e-5  # s, half of the limit of the stretch wave

    @property
    def torque(self) -> float:
        """Bending moment per pressure of one chamber, N m/Pa."""
        return self.area * self.offset

    @property
    def bending_stiffness(self) -> float:
        """Bending stiffness EI, N m^2."""
        return self.youngs_modulus * np.pi * self.radius**4 / 4

    @property
    def mass(self) -> float:
        """Mass of the body, kg."""
        return self.density * np.pi * self.radius**2 * self.length


@dataclass(frozen=True)
class Instruments:
    """Noise (standard deviations) and positions of the instruments that record the body."""

    marker_noise: float = 1e-4  # m
    pressure_noise: float = 150.0  # Pa
    curvature_noise: float = 0.05  # 1/m
    aside: tuple[float, float] = (0.012, -0.009)  # m, of the markers from the axis
    elements: tuple[int, ...] = (7, 15, 23)  # that carry a marker


class MotionInSpace(NamedTuple):
    """True motion of a body in the world frame, whose z axis points up; the rod hangs along -z."""

    time: Array  # (T,) s
    pressure: Array  # (T, 3) Pa
    position: Array  # (T, E + 1, 3) m, nodes
    directors: Array  # (T, E, 3, 3) rows d1, d2 and the tangent
    curvature: Array  # (T, E - 1, 2) 1/m, towards d1 and d2


def one_by_one(time: Array) -> Array:
    """Return the pressures (T, 3) [Pa] of three chambers at T times. One chamber after another is filled with 90 kPa
    for 1 s, and 0.7 s without pressure follow each time.
    """
    start = QUIET + 1.7 * np.arange(3)
    return np.where((time[:, None] >= start) & (time[:, None] < start + 1.0), 90e3, 0.0)


def around(time: Array) -> Array:
    """Return the pressures (T, 3) [Pa] of three chambers at T times. The direction of bending turns about the body's
    axis once every 2 s, until all chambers are vented at 4.5 s.
    """
    phase = np.pi * (time - QUIET)[:, None] - 2 * np.pi / 3 * np.arange(3)
    rise = np.clip((time - QUIET) / 0.3, 0.0, 1.0) * (time < 4.5)
    return 50e3 * (1.0 + np.cos(phase)) * rise[:, None]


def mixed(time: Array) -> Array:
    """Return the pressures (T, 3) [Pa] of three chambers at T times. Each oscillates with its own frequency, two of
    them also receive a rectangular pulse, and all are vented at 5 s.
    """
    t = np.maximum(time - QUIET, 0.0)[:, None]
    waves = 25e3 * np.sin(np.pi * np.array([0.45, 0.7, 0.31]) * t) ** 2
    steps = 45e3 * np.stack([(time > 2.0) & (time < 3.2), 0 * time, (time > 3.0) & (time < 4.2)], axis=-1)
    return (waves + steps) * (time < 5.0)[:, None]


COMMANDS: dict[str, Callable[[Array], Array]] = {"one_by_one": one_by_one, "around": around, "mixed": mixed}


def simulate_in_space(name: str, body: BodyInSpace | None = None) -> MotionInSpace:
    """Return the true motion of the body under the pressures of a named command: "one_by_one", "around" or "mixed".

    Raises
    ------
    InputError
        For an unknown command, or where PyElastica is not installed.
    """
    body = body or BodyInSpace()
    if name not in COMMANDS:
        raise InputError(f"unknown command {name!r} for a body in space: use one of {', '.join(COMMANDS)}")
    missing = "the virtual body in space needs PyElastica: pip install 'pliant[bench]'"
    elastic_rod = optional("pliant.testbed.elastic_rod", missing)
    time = body.time_step * np.arange(round(DURATION / body.time_step) + 1)
    pressure = lagged(COMMANDS[name](time), body.time_step / body.lag)
    return MotionInSpace(*elastic_rod.integrate(body, pressure, every=round(1.0 / (RATE * body.time_step))))


def lagged(command: Array, part: float) -> Array:
    """Return the pressures (T, C) of C chambers at T times, which follow `command` (T, C) with a first-order lag.
    `part` is the time step divided by the time constant.
    """
    from scipy.signal import lfilter

    keep = np.exp(-part)
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], command, axis=0))


def marker_recording(motion: MotionInSpace, seed: int, seen: Instruments | None = None, name: str = "") -> xr.Dataset:
    """Return the recording of a motion-capture system and three pressure sensors.

    The positions (T, 4, 3) [m] are those of the base and three markers, in the tracker's frame.
    """
    seen = seen or Instruments()
    rng = np.random.default_rng(seed)
    middle = 0.5 * (motion.position[:, 1:] + motion.position[:, :-1])[:, list(seen.elements)]
    aside = np.einsum("i,tsij->tsj", np.array(seen.aside), motion.directors[:, list(seen.elements), :2])
    markers = np.concatenate([motion.position[:, :1], middle + aside], axis=1) @ TRACKER.T + ORIGIN
    markers = markers + seen.marker_noise * rng.standard_normal(markers.shape)
    pressure = motion.pressure + seen.pressure_noise * rng.standard_normal(motion.pressure.shape)
    return make_recording(
        motion.time, markers, station=["base", *(f"m{k + 1}" for k in range(len(seen.elements) - 1)), "tip"],
        pressure=pressure, chamber=["red", "green", "blue"], source=f"PyElastica, {name}, seed {seed}",
        attrs={"synthetic": "true"},
    )  # fmt: skip


def fibre_table(
    motion: MotionInSpace, seed: int, body: BodyInSpace | None = None, seen: Instruments | None = None
) -> str:
    """Return the CSV text that a multicore fibre's interrogator exports.

    The columns are time [s] and the curvature towards x and y [1/m] at each arc length [mm].
    """
    body, seen = body or BodyInSpace(), seen or Instruments()
    rng = np.random.default_rng(seed)
    kappa = motion.curvature + seen.curvature_noise * rng.standard_normal(motion.curvature.shape)
    arc = 1e3 * body.length / body.elements * np.arange(1, body.elements)
    names = [f"{axis}_{s:.2f}" for s in arc for axis in ("kx", "ky")]
    rows = np.column_stack([motion.time, kappa.reshape(len(kappa), -1)])
    return "\n".join([",".join(["t", *names]), *(",".join(f"{v:.3f}" for v in row) for row in rows)]) + "\n"


def main() -> None:
    """Write all bundled recordings of a body in space; takes about a minute."""
    from pliant.recording.netcdf import write_netcdf
    from pliant.testbed.bundle import FOLDER, rounded

    for number, name in enumerate(COMMANDS):
        motion = simulate_in_space(name)
        recording = rounded(marker_recording(motion, SEED + number, name=name))
        write_netcdf(recording, FOLDER / f"space_{name}.nc", float32=True, compress=True)
        if name == FIBRE:
            half = motion._replace(**{field: getattr(motion, field)[::2] for field in motion._fields})
            (FOLDER / "space_fibre.csv").write_text(fibre_table(half, SEED), encoding="utf-8")


if __name__ == "__main__":
    main()
