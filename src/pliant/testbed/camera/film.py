"""Film a scenario of the virtual actuator as MP4, with the pressure log and the true motion."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pliant.testbed.camera.scene import Look
from pliant.testbed.camera.shutter import Scene, Shutter, moments
from pliant.testbed.camera.times import tell_gaps
from pliant.testbed.camera.view import View
from pliant.testbed.laboratory import resolved, run_rod
from pliant.testbed.rod import RodParameters
from pliant.testbed.scenarios import Scenario
from pliant.testbed.truth import make_truth, node_positions
from pliant.testbed.valve import read_pressure
from pliant.video.movie import movie

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    Shape = Callable[[NDArray[np.float64]], NDArray[np.float64]]

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
    pressure_time: NDArray[np.float64]
    pressure: NDArray[np.float64]
    length: float

    def centreline(self) -> NDArray[np.float64]:
        """Return the true centrelines (T, N, 2) [m] of the body, base at the origin with its tangent along +y."""
        inside = self.truth["arc_length"].to_numpy() <= self.length * (1.0 + 1e-9)
        return np.asarray(self.truth["position"].to_numpy()[:, inside])


def film(
    case: str | Scenario,
    path: str | Path,
    *,
    body: str | int | RodParameters = "a",
    seed: int = 1,
    view: View | None = None,
    look: Look | None = None,
    shutter: Shutter | None = None,
    progress: Callable[[float], None] | None = None,
) -> Filmed:
    """Film a scenario of the virtual actuator and return the true motion.

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

    def shape(at: NDArray[np.float64]) -> NDArray[np.float64]:
        return node_positions(motion, at)[:, : rod.elements + 1]

    at = film_motion(shape, case.duration, Path(path), Scene(view, look, shutter, rng), progress)
    clock, pressure = read_pressure(motion.time, motion.pressure, lab.transducer, rng)
    attrs = {"scenario": case.name, "seed": seed, "view": str(asdict(view)), "shutter": str(asdict(shutter))}
    return Filmed(make_truth(motion, rod, at, attrs), clock, pressure, rod.length)


def film_motion(
    shape: Shape, duration: float, path: Path, scene: Scene, progress: Callable[[float], None] | None = None
) -> NDArray[np.float64]:
    """Film a moving centreline given as a function of time.

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
    kept = [k for k in range(start.size) if k not in shutter.dropped]
    with movie(path, shutter.rate, scene.view.size) as write:
        for done, k in enumerate(kept):
            if k not in shutter.doubled or not done:
                open_at = start[k] + shutter.exposure * np.array([0.0, 1.0])
                count = moments(scene.view, shape(open_at))
                at = start[k] + shutter.exposure * (np.arange(count) + 0.5) / count
                picture = scene.frame(shape(at), float(start[k]))
            write(picture)
            if progress is not None:
                progress((done + 1) / len(kept))
    tell_gaps(path, np.diff(kept).tolist())
    return np.asarray(start[kept] + 0.5 * shutter.exposure)
