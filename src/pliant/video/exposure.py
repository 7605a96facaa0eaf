"""Compensate changes of brightness in a video whose camera sets exposure or white balance automatically."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pliant.video.reel import Reel

Array = np.ndarray
SAMPLES = 32  # frames in which brightness is compared
STEADY = 0.02  # relative change of brightness that noise and a moving body explain


def even_exposure(reel: Reel) -> tuple[Reel, list[str]]:
    """Return the video with all frames adjusted to its median brightness, per colour, and a history line.

    Brightness is the median ratio of a frame to the median frame, so that moving objects have no influence while they
    cover less than half of the picture. A video of steady brightness is returned unchanged.
    """
    parts = np.array([p[:: reel.coarse, :: reel.coarse] for p in reel.pictures(SAMPLES)])
    probe = replace(reel, reference=np.median(parts, axis=0).astype(np.float32))
    gains = np.array([probe.gain(part) for part in parts])
    change = float(np.abs(gains - 1.0).max())
    if change <= STEADY:
        return reel, []
    return probe, [f"brightness changes by up to {100 * change:.0f} % and was compensated: lock the camera's exposure"]
