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
from pliant.recording.camera import opencv
from pliant.testbed.camera.scene import Look, View, board, bounds, hand, layers, lighting, painted
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


BLUR_STEP, MOST_STEPS = 2.0, 12  # pixels of motion between two moments of an exposure, and the most moments
NOISE_SHIFT = 97  # pixels by which one picture of noise is moved about, each frame another way


@dataclass(frozen=True)
class Shutter:
    """Exposure and noise of the virtual camera (SI units); 0 switches an imperfection off.

    Attributes
    ----------
    rate : float, Hz
    exposure : float, s
        Exposure time; the shutter opens at the time of the frame.
    defocus : float, pixels
        Standard deviation of the blur.
    noise : float, levels
        Standard deviation of a pixel at full brightness; it scales with the root of the brightness.
    quality : int
        JPEG quality of a first compression of each frame, 1 to 100; 0: none. The film's codec is applied after it.
    dropped : tuple of int
        Numbers of lost frames; the file's frame times show the gaps.
    doubled : tuple of int
        Numbers of frames that are replaced by a copy of the frame before.
    """

    rate: float = 60.0
    exposure: float = 1e-3
    defocus: float = 0.0
    noise: float = 0.0
    quality: int = 0
    dropped: tuple[int, ...] = ()
    doubled: tuple[int, ...] = ()


class Scene:
    """Renders frames of a film; background, light and a picture of noise are computed once."""

    def __init__(self, view: View, look: Look, shutter: Shutter, rng: np.random.Generator) -> None:
        self.view, self.look, self.shutter, self.rng = view, look, shutter, rng
        self.light = lighting(view, look)
        self.board = board(view, look, rng)
        self.still = self._focused(self.board * self.light)
        self.plain = levels(self.still)
        shape = (view.size[1] + NOISE_SHIFT, view.size[0] + NOISE_SHIFT, 3)
        self.grain = rng.standard_normal(shape, dtype=np.float32) if shutter.noise else None

    def _focused(self, picture: Array) -> Array:
        if not self.shutter.defocus:
            return picture
        cv2 = opencv("a virtual camera")
        return np.asarray(cv2.GaussianBlur(picture, (0, 0), self.shutter.defocus))

    def frame(self, shapes: Array, time: float) -> Array:
        """Return the picture (H, W, 3), uint8, of one exposure with H x W pixels.

        `shapes` (M, N, 2) [m] are the body's centrelines at M moments of the exposure, which begins at `time` [s].
        """
        size, margin = self.view.size, 1 + int(4 * self.shutter.defocus)
        drawn = [[*layers(self.view, self.look, s), *hand(self.view, self.look, time)] for s in shapes]
        x0, y0, x1, y1 = box = bounds([layer for moment in drawn for layer in moment], size, margin)
        parts = [painted(moment, box) for moment in drawn]
        colour, cover = (np.mean([part[k] for part in parts], axis=0) for k in (0, 1))
        there = np.s_[y0:y1, x0:x1]
        lit = self._focused((self.board[there] * (1.0 - cover[..., None]) + colour) * self.light[there])
        if self.grain is not None:
            picture = self.still.copy()
            picture[there] = lit
            picture_levels = levels(picture + self._noise(picture))
        else:
            picture_levels = self.plain.copy()
            picture_levels[there] = levels(lit)
        if not self.shutter.quality:
            return picture_levels
        cv2 = opencv("a virtual camera")
        coded = cv2.imencode(".jpg", picture_levels, [cv2.IMWRITE_JPEG_QUALITY, self.shutter.quality])[1]
        return np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR))

    def _noise(self, picture: Array) -> Array:
        h, w = picture.shape[:2]
        y, x = self.rng.integers(0, NOISE_SHIFT, 2)
        level = self.shutter.noise * np.sqrt(np.maximum(picture, 0.0) / 255.0 + 0.02)
        return np.asarray(level * self.grain[y : y + h, x : x + w]) if self.grain is not None else picture


def levels(picture: Array) -> Array:
    """Return the picture rounded and clipped to uint8."""
    return np.asarray(np.clip(picture + 0.5, 0, 255).astype(np.uint8))


def moments(view: View, ends: Array) -> int:
    """Return the number of moments of an exposure at which to draw the body. `ends` (2, N, 2) [m] holds N points of its
    centreline at the start and at the end of the exposure.
    """
    moved = float(np.abs(np.diff(view.pixels(ends), axis=0)).max())
    return min(MOST_STEPS, 1 + int(np.ceil(moved / BLUR_STEP)))


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
