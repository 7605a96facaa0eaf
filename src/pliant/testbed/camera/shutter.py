"""Render film frames from a scene: exposure, defocus, sensor noise, and lost or repeated frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pliant.recording.camera import opencv
from pliant.testbed.camera.scene import Look, View, board, bounds, hand, layers, lighting, painted

Array = np.ndarray
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
