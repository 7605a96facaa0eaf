"""Measure time and memory of the order selection for 10,000 frames x 212 points x n = 2 ... 8 on one core.

Run this file as a script; it sets the number of threads of the linear algebra to one before NumPy is loaded.
"""

# ruff: noqa: E402
from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"

import time
import tracemalloc

import numpy as np

from pliant.recording import make_recording
from pliant.reduction import select_order

FRAMES, STATIONS, LENGTH = 10_000, 212, 0.1688
TARGET_S = 2.0


def body(frames: int = FRAMES, axes: int = 2):
    """Return a body that bends and oscillates, as a planar recording or, with three axes, in the axes of a tracker."""
    s = np.linspace(0, LENGTH, STATIONS)
    t = np.arange(frames)[:, None] / 75
    kappa = (8 + 4 * np.sin(31 * t)) * (1 + 0.3 * np.sin(7 * s / LENGTH)) + 10 * np.sin(3 * t) * np.cos(19 * s)
    phi = np.cumsum(kappa * s[1], axis=1)
    points = np.cumsum(np.stack([-np.sin(phi), np.cos(phi), 0 * phi], axis=2)[..., :axes] * s[1], axis=1)
    return make_recording(t[:, 0], points, arc_length=s, frame="planar" if axes == 2 else "tracker")


def timed(recording, repeats: int = 3, **options) -> float:
    """Return the best wall-clock time of a few runs, s."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        select_order(recording, bound=1e-3, **options)
        times.append(time.perf_counter() - start)
    return min(times)


def peak_memory(recording) -> float:
    """Return the peak memory of a selection in addition to the recording, in multiples of its positions."""
    tracemalloc.start()
    select_order(recording, bound=1e-3)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / recording["position"].nbytes


def main() -> None:
    """Print one line per case."""
    for axes in (2, 3):
        recording = body(axes=axes)
        for options in ({}, {"boundary": "natural"}, {"placement": "best"}, {"metric": "closest"}):
            seconds = timed(recording, repeats=1 if "metric" in options else 3, **options)
            said = ", ".join(map(str, options.values())) or "clamped+not-a-knot, equal, arc"
            print(f"order selection {FRAMES} x {STATIONS} x {axes}, n = 2...8, {said}: {seconds:.2f} s")
        print(f"  memory above the recording: {peak_memory(recording):.2f} times its positions")
    seconds = timed(body())
    print(f"target {TARGET_S:.0f} s on one core: {'met' if seconds < TARGET_S else 'MISSED'} ({seconds:.2f} s)")


if __name__ == "__main__":
    main()
