"""A small film of a bending body whose true centreline is known at every moment."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pliant.testbed.camera import Look, Scene, Shutter, View, film_motion

LENGTH = 0.17
VIEW = View().scaled(640)


def bent(at: np.ndarray) -> np.ndarray:
    """Centrelines (M, 101, 2) of a body that swings at 2 Hz and bends more at its tip than at its base."""
    bend = 0.35 + 0.6 * (1.0 - np.cos(2 * np.pi * 2.0 * np.maximum(at - 0.1, 0.0)))
    s = np.linspace(0.0, 1.0, 101)
    angle = bend[:, None] * (0.6 * s + 0.4 * s**2)
    step = LENGTH / 100 * np.stack([-np.sin(angle), np.cos(angle)], axis=2)
    step = 0.5 * (step[:, 1:] + step[:, :-1])
    return np.concatenate([np.zeros((len(at), 1, 2)), np.cumsum(step, axis=1)], axis=1)


def filmed(path: Path, look: Look | None = None, shutter: Shutter | None = None, view: View = VIEW,
           duration: float = 0.8) -> np.ndarray:  # fmt: skip
    """Write a film; the times of the middle of its exposures come back."""
    scene = Scene(view, look or Look(), shutter or Shutter(), np.random.default_rng(5))
    return film_motion(bent, duration, path, scene)


def true_stations(at: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Places (T, S, 2) [m] at shares of the length."""
    lines = bent(at)
    s = np.linspace(0.0, 1.0, lines.shape[1])
    return np.stack([[np.interp(shares, s, line[:, k]) for line in lines] for k in (0, 1)], axis=2)
