"""Film a scenario of the virtual actuator as MP4, with the pressure log and the true motion."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr

from pliant.errors import InputError
from pliant.files import whole
from pliant.testbed.camera.scene import Look, View
from pliant.testbed.camera.shutter import Scene, Shutter, moments
from pliant.testbed.laboratory import resolved, run_rod
from pliant.testbed.rod import RodParameters
from pliant.testbed.scenarios import Scenario
from pliant.testbed.truth import make_truth, node_positions
from pliant.testbed.valve import read_pressure
from pliant.video.overlay import movie

Array = np.ndarray
Shape = Callable[[Array], Array]
INSIDE = (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"edts")  # boxes that hold boxes
DURATION = {b"mvhd": 16, b"tkhd": 20, b"elst": 8, b"mdhd": 16}  # offset of the duration in a box (version 0)


@dataclass(frozen=True)
class Filmed:
    """The pressure log and the true motion that belong to a film file.

    Attributes
    ----------
    truth : xarray.Dataset
        Dataset of `pliant.testbed.truth.make_truth` at the middle of each frame's exposure, without lost frames.
    pressure_time, pressure : arrays (P,), s and Pa
        Times and readings of the pressure sensor.
    length : float, m
        Length of the body, without the edge that carries the cap.
    """

    truth: xr.Dataset
    pressure_time: Array
    pressure: Array
    length: float

    def centreline(self) -> Array:
        """Return the body's true centrelines (T, N, 2) [m], with N points from base to tip at T times. The base is at
        the origin, its tangent along +y.
        """
        inside = self.truth["arc_length"].to_numpy() <= self.length * (1.0 + 1e-9)
        return np.asarray(self.truth["position"].to_numpy()[:, inside])


def film(
    case: str | Scenario, path: str | Path, *, body: str | int | RodParameters = "a", seed: int = 1,
    view: View | None = None, look: Look | None = None, shutter: Shutter | None = None,
    progress: Callable[[float], None] | None = None,
) -> Filmed:
    """Film a scenario of the virtual actuator as an MP4 file. Return the pressure log and the true motion.

    Parameters
    ----------
    case, body : as `pliant.testbed.generate`
    path : Path
        The .mp4 file to write. An interrupted run leaves no partial file.
    seed : int
        Seed of the background and of all noise.
    view, look, shutter : optional
        Position of the camera, appearance of the scene, exposure and noise.
    progress : callable, optional
        Called with the completed fraction.

    Raises
    ------
    InputError
        For unknown names, a path that does not end in .mp4, or without OpenCV.
    """
    case, who, lab = resolved(case, body, None)
    rod = replace(who.body, gravity=case.gravity)
    view, look, shutter = view or View(), look or Look(), shutter or Shutter()
    motion = run_rod(case, rod, lab)
    rng = np.random.default_rng([seed, zlib.crc32(case.name.encode())])

    def shape(at: Array) -> Array:
        return node_positions(motion, at)[:, : rod.elements + 1]

    at = film_motion(shape, case.duration, Path(path), Scene(view, look, shutter, rng), progress)
    clock, pressure = read_pressure(motion.time, motion.pressure, lab.transducer, rng)
    attrs = {"scenario": case.name, "seed": seed, "view": str(asdict(view)), "shutter": str(asdict(shutter))}
    return Filmed(make_truth(motion, rod, at, attrs), clock, pressure, rod.length)


def film_motion(
    shape: Shape, duration: float, path: Path, scene: Scene, progress: Callable[[float], None] | None = None
) -> Array:
    """Film a moving centreline, given as a function of time, as an MP4 file. Return the times of its frames.

    Parameters
    ----------
    shape : callable
        ``shape(at (M,)) -> (M, N, 2)``: centrelines [m] at times [s], base first.
    duration : float, s
    path : Path
        MP4 to write.

    Returns
    -------
    array (T,), s
        Middle of the exposure of each frame in the file.
    """
    shutter = scene.shutter
    start = np.arange(0.0, duration - shutter.exposure, 1.0 / shutter.rate)
    recorded = [k for k in range(start.size) if k not in shutter.dropped]
    with movie(path, shutter.rate, scene.view.size) as write:
        for done, k in enumerate(recorded):
            if k not in shutter.doubled or not done:
                open_at = start[k] + shutter.exposure * np.array([0.0, 1.0])
                count = moments(scene.view, shape(open_at))
                instants = start[k] + shutter.exposure * (np.arange(count) + 0.5) / count
                picture = scene.frame(shape(instants), float(start[k]))
            write(picture)
            if progress is not None:
                progress((done + 1) / len(recorded))
    write_frame_gaps(path, np.diff(recorded).tolist())
    return np.asarray(start[recorded] + 0.5 * shutter.exposure)


def write_frame_gaps(path: Path, steps: list[int]) -> None:
    """Rewrite the frame times of an evenly spaced MP4 file so that lost frames appear as longer frames.

    OpenCV's writer cannot do this.

    `steps` gives the time from each frame to the next, as a multiple of the frame period.

    Parameters
    ----------
    path : Path
        MP4 file as OpenCV writes it: one track, with the index behind the pictures.
    steps : list of int
        One entry fewer than there are frames; if all are 1, the file is unchanged.
    """
    if all(step == 1 for step in steps):
        return
    content = path.read_bytes()
    longer = (sum(steps) + 1) / (len(steps) + 1)
    with whole(path) as draft:
        draft.write_bytes(b"".join(_boxes(content, [*steps, 1], longer)))


def _boxes(content: bytes, steps: list[int], longer: float) -> Iterator[bytes]:
    position = 0
    while position + 8 <= len(content):
        size, kind = struct.unpack_from(">I4s", content, position)
        if not 8 <= size <= len(content) - position:
            raise InputError("the film is not an MP4 file as OpenCV writes it: film it again")
        inner = content[position + 8 : position + size]
        if kind in INSIDE:
            inner = b"".join(_boxes(inner, steps, longer))
        elif kind == b"stts":
            inner = _table(inner, steps)
        elif kind in DURATION:
            inner = _longer(inner, DURATION[kind], longer)
        yield struct.pack(">I4s", len(inner) + 8, kind) + inner
        position += size


def _table(inner: bytes, steps: list[int]) -> bytes:
    count, tick = struct.unpack_from(">II", inner, 8)
    if count != len(steps):
        raise InputError(f"the film has {count} frames, expected {len(steps)}: film it again")
    rows = [(1, tick * step) for step in steps]
    return inner[:4] + struct.pack(">I", len(rows)) + b"".join(struct.pack(">II", *row) for row in rows)


def _longer(inner: bytes, at: int, longer: float) -> bytes:
    duration = struct.unpack_from(">I", inner, at)[0]
    return inner[:at] + struct.pack(">I", round(duration * longer)) + inner[at + 4 :]
