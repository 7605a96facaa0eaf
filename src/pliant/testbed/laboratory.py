"""Generate recordings of a scenario together with the true motion, cached by a digest of all settings."""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr

from pliant.errors import InputError, PliantError
from pliant.recording import make_recording, read
from pliant.recording.netcdf import write_netcdf
from pliant.testbed import fibre as fibre_sensor
from pliant.testbed.family import Member, member
from pliant.testbed.fibre import FibreSensor, body_angle, stretched
from pliant.testbed.rod import RodParameters
from pliant.testbed.scenarios import Scenario, obstacle_rows, scenario
from pliant.testbed.stepping import RodMotion, simulate
from pliant.testbed.truth import make_truth, read_truth, write_truth
from pliant.testbed.valve import Iso6358, PressureSensor, SupplyRegulator, read_pressure, supply_pressure

Array = np.ndarray
Output = Literal["position", "strain", "markers", "angle"]
SUPPLY_STEP = 1.25e-5  # s, of the valve's equations
RECORD = 1e-3  # s between two kept states


BASE = ((0.02, -0.01, 0.0), (-0.02, -0.01, 0.0), (0.0, -0.01, 0.02))  # m, markers on the clamp


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


@dataclass(frozen=True)
class MotionCapture:
    """A motion-capture system with markers on the convex side of the body and on the clamp (SI units)."""

    markers: int = 5
    stand_off: float = 0.014  # m, from the centreline
    noise: float = 5e-5  # m, each axis
    drop_out: float = 0.002  # probability, each marker and frame
    rate: float = 100.0  # Hz


def marker_names(mocap: MotionCapture) -> list[str]:
    """Return the names of the markers: three on the base, then those on the body from base to tip."""
    return [f"base_{k + 1}" for k in range(len(BASE))] + [f"body_{k + 1}" for k in range(mocap.markers)]


def marker_positions(motion: RodMotion, p: RodParameters, mocap: MotionCapture, at: Array) -> Array:
    """Return the true positions (T, M, 3) [m] of M markers in the actuator's frame at T times `at` (T,) [s]."""
    s, theta = body_angle(motion, p, at)
    half = 0.5 * (theta[:, 1:] + theta[:, :-1])
    step = np.diff(stretched(motion, p, at), axis=1)
    zero = np.zeros((at.size, 1))
    x = np.concatenate([zero, np.cumsum(-np.sin(half) * step, axis=1)], axis=1)
    y = np.concatenate([zero, np.cumsum(np.cos(half) * step, axis=1)], axis=1)
    on = np.round(np.arange(1, mocap.markers + 1) / mocap.markers * (s.size - 1)).astype(int)
    out = np.zeros((at.size, len(BASE) + mocap.markers, 3))
    out[:, : len(BASE)] = BASE
    out[:, len(BASE) :, 0] = x[:, on] + mocap.stand_off * np.cos(theta[:, on])
    out[:, len(BASE) :, 1] = y[:, on] + mocap.stand_off * np.sin(theta[:, on])
    return out


def observe_markers(
    motion: RodMotion, p: RodParameters, mocap: MotionCapture, at: Array, rng: np.random.Generator
) -> Array:
    """Return noisy positions (T, M, 3) [m] of M markers at T times `at` (T,) [s], in a laboratory frame of random pose.
    Lost markers are NaN.
    """
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_quat(rng.standard_normal(4)).as_matrix()
    shift = rng.uniform(-0.5, 0.5, 3)
    out = marker_positions(motion, p, mocap, at) @ turn.T + shift
    out += mocap.noise * rng.standard_normal(out.shape)
    out[rng.random(out.shape[:2]) < mocap.drop_out] = np.nan
    return np.asarray(out)


@dataclass(frozen=True)
class Laboratory:
    """Valve, sensors and recorded output of a virtual laboratory: everything except the actuator.

    `valve` holds for every chamber, or is a tuple with one valve for each chamber.
    """

    valve: SupplyRegulator | Iso6358 | tuple[SupplyRegulator | Iso6358, ...] = field(default_factory=SupplyRegulator)
    transducer: PressureSensor = field(default_factory=PressureSensor)
    fibre: FibreSensor = field(default_factory=FibreSensor)
    mocap: MotionCapture = field(default_factory=MotionCapture)
    angle: AngleSensor = FLEX
    output: Output = "position"

    @classmethod
    def of(cls, who: Member, output: Output = "position") -> Laboratory:
        """Return a laboratory with the valve, the pressure transducer and the fibre sensor of the family member
        `who`.
        """
        return cls(who.valve, who.transducer, who.fibre, output=output)


@dataclass(frozen=True)
class LaboratoryExperiment:
    """A recording of the virtual laboratory and the true motion that it observed."""

    recording: xr.Dataset
    truth: xr.Dataset


@cache
def source_digest() -> str:
    """Return the SHA-256 digest of the test bed's source code; recordings made by another version are regenerated."""
    files = sorted(p for p in Path(__file__).parent.rglob("*.py") if p.name not in ("bundle.py", "__init__.py"))
    return hashlib.sha256(b"".join(p.read_bytes() for p in files)).hexdigest()


def content_key(case: Scenario, rod: RodParameters, seed: int, lab: Laboratory) -> str:
    """Return a digest of all settings and code that determine a recording's content."""
    valve = [type(v).__name__ for v in one_each(lab.valve, rod, "valve")]
    settings = json.dumps([asdict(case), asdict(rod), int(seed), asdict(lab), valve], sort_keys=True)
    return hashlib.sha256((settings + source_digest()).encode()).hexdigest()[:32]


def one_each(given: Any, rod: RodParameters, what: str) -> tuple[Any, ...]:
    """Return a tuple with one item for each chamber: `given` itself when it is a tuple, else `given` repeated."""
    each = given if isinstance(given, tuple) else (given,) * len(rod.chambers)
    if len(each) != len(rod.chambers):
        raise InputError(
            f"got {len(each)} {what}s for a body of {len(rod.chambers)} chamber(s): give one, or one for each chamber"
        )
    return each


def run_rod(
    case: Scenario, rod: RodParameters, lab: Laboratory, progress: Callable[[float], None] | None = None
) -> RodMotion:
    """Simulate the actuator's true motion in a scenario."""
    stride = max(1, round(RECORD / case.time_step))
    steps = int(np.ceil(case.duration / (case.time_step * stride))) * stride
    fine = max(1, round(case.time_step / SUPPLY_STEP))  # the valve's own grid: edges stay where they are
    time = np.asarray(np.arange(steps * fine + 1) * (case.time_step / fine), dtype=float)
    loads = np.zeros((steps, len(rod.chambers) + 3))
    both = zip(one_each(case.command, rod, "command"), one_each(lab.valve, rod, "valve"), strict=True)
    for c, (command, valve) in enumerate(both):
        loads[:, c] = supply_pressure(command, time, valve)[fine::fine]
    if case.pushes:
        push_arcs, *force = np.array(case.pushes).T
        loads[:, -3:-1] = np.stack([np.interp(time[fine::fine], push_arcs, f) for f in force], axis=1)
    rows = obstacle_rows(case.obstacles)
    return simulate(
        replace(rod, gravity=case.gravity), loads, case.time_step, stride=stride, obstacles=rows, progress=progress
    )


def resolved(
    case: str | Scenario, body: str | int | RodParameters | Member, lab: Laboratory | None, output: Output = "position"
) -> tuple[Scenario, Member, Laboratory]:
    """Return the scenario, the body with its instruments, and the laboratory as objects. The scenario is scaled to the
    body if the body belongs to the family. Without `lab`, the laboratory has the body's instruments.
    """
    case = scenario(case) if isinstance(case, str) else case
    if isinstance(body, RodParameters):
        return case, Member("custom", body), lab or Laboratory(output=output)
    who = body if isinstance(body, Member) else member(body)
    return who.adapted(case), who, lab or Laboratory.of(who, output)


def generate(
    case: str | Scenario, body: str | int | RodParameters | Member = "a", seed: int = 1, *,
    lab: Laboratory | None = None, progress: Callable[[float], None] | None = None,
) -> LaboratoryExperiment:
    """Simulate a scenario and return its recording together with the true motion.

    Parameters
    ----------
    case : str or Scenario
        Name from `pliant.testbed.scenarios.SCENARIOS`, or ``pulse_<kPa>_<ms>ms``; ``pulse_120+60_<ms>ms`` gives a
        pressure for each chamber. Where a scenario has one command, every chamber follows it.
    body : str, int, Member or RodParameters
        Actuator "a", "b" or "c"; "two_segment", "antagonistic" or "lengthening", with two chambers; a seed of the
        family (7 or "7"), which has its own valve and sensors and replaces the scenario's 180 kPa by its working
        pressure; or parameters of your own.
    seed : int
        Seed of the sensors: their systematic errors depend on the seed, their noise on seed and scenario.
    lab : Laboratory, optional
        Default: the laboratory that belongs to the body.
    progress : callable, optional
        Called with the completed fraction of the simulation.

    Returns
    -------
    LaboratoryExperiment

    Raises
    ------
    InputError
        For an unknown name, a negative seed or a wrong number of valves or commands.
    SimulationError
        When the simulation does not converge.
    """
    case, who, lab = resolved(case, body, lab)
    rod = who.body
    if seed < 0:
        raise InputError(f"a seed must be >= 0, got {seed}")
    motion = run_rod(case, rod, lab, progress)
    rate = {"markers": lab.mocap.rate, "angle": lab.angle.rate}.get(lab.output, case.rate)
    frame_times = np.arange(0.0, case.duration - 0.5 * RECORD, 1.0 / rate)
    attrs = {"scenario": case.name, "actuator": who.name, "seed": int(seed),
             "content_key": content_key(case, rod, seed, lab)}  # fmt: skip
    if who.name.isdecimal():
        attrs |= who.known()
    rod = replace(rod, gravity=case.gravity)
    recording = record(motion, rod, lab, frame_times, seed=seed, attrs=attrs)
    settings = {"laboratory": json.dumps(asdict(lab)), "scenario_settings": json.dumps(asdict(case))}
    truth = make_truth(motion, rod, frame_times, attrs | settings)
    return LaboratoryExperiment(recording, truth)


def record(
    motion: RodMotion, rod: RodParameters, lab: Laboratory, at: Array, *, seed: int, attrs: dict[str, Any],
) -> xr.Dataset:
    """Return the recording that the laboratory's instruments make of a rod's motion at the T times `at` (T,) [s]."""
    stream = zlib.crc32(str(attrs["scenario"]).encode())
    specimen = np.random.default_rng([seed, 1])  # stays with the instruments from one scenario to the next
    rng = np.random.default_rng([seed, stream])
    clock, pressure = read_pressure(motion.time, motion.pressure, lab.transducer, rng)
    common: dict[str, Any] = {
        "pressure": pressure, "pressure_time": clock, "source": f"testbed {attrs['scenario']}",
        "source_format": "testbed", "history": f"recorded by the virtual laboratory as {lab.output}",
        "chamber": [c.name for c in rod.chambers] if pressure.ndim == 2 else None,
    }  # fmt: skip
    if lab.output == "angle":  # one log: both are sampled together
        reading = observe_angle(motion, rod, lab.angle, at, specimen, rng)
        common |= {"pressure": np.apply_along_axis(lambda p: np.interp(at, clock, p), 0, pressure), "pressure_time": at}
        return make_recording(at, angle=reading[:, None], station=["tip"], frame="planar", attrs=dict(attrs), **common)
    if lab.output == "markers":
        position = observe_markers(motion, rod, lab.mocap, at, rng)
        return make_recording(at, position, station=marker_names(lab.mocap), attrs=dict(attrs), **common)
    sensor = lab.fibre
    kappa = fibre_sensor.sensed_curvature(motion, rod, sensor, at, specimen, rng)
    stamps = fibre_sensor.time_stamps(at, sensor, rng)
    lost = fibre_sensor.drop_frames(at.size, sensor, rng)
    known = dict(attrs) | {"cap_curvature": rod.cap_curvature, "cap_length": rod.cap_length}
    if lab.output == "strain":
        strain = fibre_sensor.core_strain(kappa, sensor, rng)
        strain[lost] = np.nan
        gauges = np.arange(strain.shape[2]) * sensor.spacing
        known |= {"core_radius": [0.0] + [sensor.core_radius] * 3, "core_angle": list(fibre_sensor.CORE_ANGLE)}
        return make_recording(stamps, strain=strain, gauge_position=gauges, attrs=known, **common)
    position = fibre_sensor.place(fibre_sensor.integrate_shape(kappa, sensor.spacing), sensor, specimen)
    position[lost] = np.nan
    names = [f"{k:03d}" for k in range(position.shape[1])]
    return make_recording(stamps, position, station=names, attrs=known, **common)


def is_current(path: Path, key: str, reader: Callable[[Path], xr.Dataset] = read) -> bool:
    """Return True if the file `path` already holds the recording, or what else `reader` reads, whose content has the
    digest `key`.
    """
    try:
        return path.is_file() and bool(reader(path).attrs.get("content_key") == key)
    except PliantError:
        return False


def generate_file(
    case: str | Scenario, path: str | Path, *, body: str | int | RodParameters | Member = "a", seed: int = 1,
    lab: Laboratory | None = None, truth: str | Path | None = None, progress: Callable[[float], None] | None = None,
) -> bool:
    """Generate a recording as a netCDF file and, optionally, the true motion as another. Files that are up to date are
    kept.

    Returns
    -------
    bool
        True when the scenario was simulated, False when the files were current.
    """
    path = Path(path)
    if path.suffix not in (".nc", ".nc4"):
        raise InputError(f"recordings of the test bed are netCDF: give a name ending in .nc, not {path.name!r}")
    if truth is not None and Path(truth).resolve() == path.resolve():
        raise InputError(f"recording and true motion need two different files, both are {path}")
    adapted, who, settings = resolved(case, body, lab)
    key = content_key(adapted, who.body, seed, settings)
    if is_current(path, key) and (truth is None or is_current(Path(truth), key, read_truth)):
        return False
    experiment = generate(case, body, seed, lab=lab, progress=progress)
    if truth is not None:
        write_truth(experiment.truth, Path(truth))
    write_netcdf(experiment.recording, path, float32=True, compress=True)
    return True


def generate_set(
    cases: Iterable[tuple[str, str, int]], folder: str | Path, *, lab: Laboratory | None = None,
    progress: Callable[[int, int, str], None] | None = None,
) -> list[Path]:
    """Generate the recording of each (scenario, actuator, seed) as a file in `folder`, and its true motion as a file in
    the subfolder ``truth``. Return the paths of the recordings.

    Files that are current are kept, so that an interrupted run can be repeated. `progress` is called with the number of
    files done, their total number and the file's name.
    """
    folder = Path(folder)
    (folder / "truth").mkdir(parents=True, exist_ok=True)
    todo, paths = list(cases), []
    for done, (case, body, seed) in enumerate(todo):
        path = folder / f"{case}-{body}-{seed}.nc"
        if progress is not None:
            progress(done, len(todo), path.name)
        generate_file(case, path, body=body, seed=seed, lab=lab, truth=folder / "truth" / path.name)
        paths.append(path)
    return paths
