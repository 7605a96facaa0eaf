"""The drawing of a raw recording: what it shows, and that no recording breaks it."""

from __future__ import annotations

import re

import numpy as np
import pytest

from pliant.preprocessing.labels import on_plane, recording_svg
from pliant.preprocessing.quality import quality
from pliant.recording import make_recording

T = np.linspace(0.0, 1.0, 50)
TURN = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]


def swinging(stations: int = 3) -> np.ndarray:
    """A straight body (T, S, 3) of 0.1 m that swings by 0.5 rad in the plane of x and y of turned axes."""
    angle = 0.5 * np.sin(np.pi * T)
    along = np.linspace(0.0, 0.1, stations)
    flat = along[None, :, None] * np.stack([np.sin(angle), np.cos(angle), 0.0 * angle], axis=1)[:, None]
    return flat @ TURN.T + [1.0, 2.0, -3.0]


def test_the_plane_of_motion_keeps_every_distance_of_a_planar_motion():
    position = swinging()
    seen = on_plane(position - position[0, 0], np.arange(T.size))
    assert seen[0] == pytest.approx(np.array([[0.0, 0.0], [0.0, 0.05], [0.0, 0.1]]), abs=1e-12)
    assert seen[25, -1] == pytest.approx([0.1 * np.sin(0.5), 0.1 * np.cos(0.5)], rel=1e-2)
    assert np.linalg.norm(seen, axis=2) == pytest.approx(np.linalg.norm(position - position[0, 0], axis=2), abs=1e-12)


def test_a_notebook_shows_the_body_and_its_findings():
    found = quality(make_recording(T, swinging()))
    page = found._repr_html_()
    assert page.count("<svg") == 1
    assert 3 <= len(re.findall('stroke="#999"', page)) <= 5  # instants of the body
    assert page.count('stroke="#c1440e"') == 1  # path of the last station
    assert 'aria-label="50 frames of 3 station(s)' in page
    assert "drawing" not in found.to_dict()
    assert "svg" not in found.summary()


@pytest.mark.parametrize("position", [
    np.full((50, 2, 3), np.nan), swinging()[:, :1], swinging()[:1], np.zeros((50, 3, 3)),
    np.repeat(swinging()[:1], 50, axis=0), np.where(np.arange(50)[:, None, None] == 7, np.nan, swinging()),
])  # fmt: skip
def test_no_recording_breaks_the_drawing(position):
    drawn = recording_svg(make_recording(T[: len(position)], position), "<b>")
    assert drawn == "" or (drawn.startswith("<svg") and "nan" not in drawn and "<b>" not in drawn)


def test_a_long_dense_recording_is_thinned():
    position = np.repeat(swinging(200), 100, axis=0)
    drawn = recording_svg(make_recording(np.arange(len(position)) / 100, position), "long")
    assert len(drawn) < 20_000


def test_a_log_without_a_shape_has_no_drawing():
    log = make_recording(pressure=[0.0, 1e4, 0.0], pressure_time=[0.0, 1.0, 2.0])
    assert quality(log).drawing == ""
