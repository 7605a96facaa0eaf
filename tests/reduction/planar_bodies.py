"""Synthetic planar bodies whose curvature is known; base at the origin, base tangent +y."""

from __future__ import annotations

import numpy as np

from pliant.recording import make_recording

LENGTH = 0.1688


def arc_points(curvature, s):
    """Points (S, 2) of a circular arc that starts along +y and bends about +z."""
    if curvature == 0:
        return np.stack([np.zeros_like(s), s], axis=1)
    return np.stack([np.cos(curvature * s) - 1, np.sin(curvature * s)], axis=1) / curvature


def body_points(curvature, s):
    """Points (T, S, 2) for curvature(s) given as (T, S) on the stations, integrated on a tenfold finer grid."""
    fine = np.linspace(0, s[-1], 10 * (s.size - 1) + 1)
    kappa = np.array([np.interp(fine, s, row) for row in curvature])
    h = fine[1]
    phi = np.concatenate((np.zeros((len(kappa), 1)), np.cumsum((kappa[:, 1:] + kappa[:, :-1]) / 2 * h, axis=1)), axis=1)
    middle = (phi[:, 1:] + phi[:, :-1]) / 2
    steps = np.stack([-np.sin(middle), np.cos(middle)], axis=-1) * h
    points = np.concatenate((np.zeros((len(kappa), 1, 2)), np.cumsum(steps, axis=1)), axis=1)
    return np.array([[np.interp(s, fine, p[:, a]) for a in range(2)] for p in points]).transpose(0, 2, 1)


def wavy(frames=12, stations=212, bend=1.5, seed=0):
    """A bending body with uneven curvature that moves: planar recording, arc length known."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0, LENGTH, stations)
    x = s / LENGTH
    t = np.arange(frames) / 75
    uneven = 1 + 0.3 * np.sin(7 * x + rng.uniform(0, 6)) + 0.15 * np.cos(13 * x)
    kappa = bend / LENGTH * (0.6 + 0.4 * np.sin(30 * t))[:, None] * uneven
    kappa = kappa + 4 * np.sin(40 * t)[:, None] * np.cos(3 * np.pi * x)
    return make_recording(t, body_points(kappa, s), arc_length=s, frame="planar"), kappa


def arc(angle, stations=212, length=LENGTH):
    """One frame of a circular arc of `angle` rad."""
    s = np.linspace(0, length, stations)
    return make_recording([0.0], arc_points(angle / length, s)[None], arc_length=s, frame="planar")
