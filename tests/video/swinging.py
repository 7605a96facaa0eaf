"""A film of a swinging body, drawn by OpenCV alone: low frame rate, clutter, a camera that sets its exposure itself."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

SIZE, BASE, LENGTH = (320, 240), np.array([160.0, 222.0]), 165.0
PLACES = np.linspace(0.12, 0.95, 6)


def line_at(time: float, hz: float) -> np.ndarray:
    """Centreline (41, 2) in pixels; at rest for the first 0.2 s."""
    swing = max(time - 0.2, 0.0)
    angle = 1.2 * np.exp(-0.35 * swing) * np.sin(2 * np.pi * hz * swing) * np.linspace(0, 1, 41)
    step = np.stack([np.sin(angle), -np.cos(angle)], 1) * LENGTH / 40
    return BASE + np.concatenate([[[0, 0]], np.cumsum(step[:-1], 0)])


def at_places(line: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(PLACES, np.linspace(0, 1, len(line)), line[:, k]) for k in (0, 1)], 1)


def film(
    path: Path, *, hz: float, dots: bool, frames: int = 45, gain: Callable[[float], float] = lambda _: 1.0,
    hidden: range = range(0),
) -> np.ndarray:
    """Write a film of 30 frames a second; the true places (T, 6, 2) of the dots in pixels come back."""
    rng = np.random.default_rng(3)
    board = np.full((SIZE[1], SIZE[0], 3), 165, np.uint8)
    for _ in range(20):
        left, top = (int(v) for v in rng.integers(0, SIZE))
        grey = int(rng.integers(120, 200))
        cv2.rectangle(board, (left, top), (left + 20, top + 15), (grey, grey, grey), -1)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 30.0, SIZE)
    truth = []
    for k in range(frames):
        line, picture = line_at(k / 30, hz), board.copy()
        truth.append(at_places(line))
        cv2.polylines(picture, [np.round(line * 16).astype(np.int32)], False, (45, 40, 38), 18, cv2.LINE_AA, 4)
        for x, y in np.round(truth[-1] * 16).astype(int).tolist() if dots else []:
            cv2.circle(picture, (x, y), 5 * 16, (60, 40, 200), -1, cv2.LINE_AA, 4)
        if k in hidden:
            cv2.rectangle(picture, (60, 20), (280, 160), (120, 150, 150), -1)
        noisy = picture * gain(k / 30) + rng.normal(0, 2, picture.shape)
        writer.write(np.clip(noisy, 0, 255).astype(np.uint8))
    writer.release()
    return np.array(truth)
