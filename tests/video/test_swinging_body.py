"""Films of a person's kind: 30 frames a second, fast swings, a hand, a camera that changes its exposure."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from swinging import film

from pliant.errors import InputError
from pliant.video import Tracking, track_video

CAMERA = {"pixels_per_mm": 1.0}
DOTS = Tracking("dots", colour="#c8283c")


def in_pixels(ds):
    return ds["position"].to_numpy()[..., :2] * (1e3, -1e3)


def off_by(places, truth):
    """Largest distance from the truth; where the picture's origin lies does not count."""
    error = places - truth
    return np.nanmax(np.linalg.norm(error - np.nanmedian(error, axis=(0, 1)), axis=2))


def test_dots_that_pass_their_neighbours_places_from_frame_to_frame_are_followed(tmp_path: Path) -> None:
    truth = film(tmp_path / "f.mp4", hz=2.5, dots=True)
    steps = np.linalg.norm(np.diff(truth, axis=0), axis=2)
    assert steps.max() > 1.5 * np.linalg.norm(np.diff(truth[0], axis=0), axis=1).max()  # as it was lost before
    places = in_pixels(track_video(tmp_path / "f.mp4", CAMERA, DOTS))
    assert np.isfinite(places).all()
    assert off_by(places, truth) < 1.5


def test_dots_are_found_again_where_they_come_back(tmp_path: Path) -> None:
    hidden = range(15, 24)
    truth = film(tmp_path / "f.mp4", hz=1.5, dots=True, hidden=hidden)
    ds = track_video(tmp_path / "f.mp4", CAMERA, DOTS)
    assert "9 of 45 frames are gaps: the body was hidden or not found" in ds.attrs["history"]
    assert "0 frames repeat the previous frame" in ds.attrs["history"]
    places = in_pixels(ds)
    seen = np.isfinite(places).all(axis=(1, 2))
    assert not seen[list(hidden)].any()
    assert np.delete(seen, list(hidden)).all()
    assert off_by(places, truth) < 1.5


def test_exposure_that_drifts_is_compensated_and_named(tmp_path: Path) -> None:
    ends = []
    for name, gain in (("steady.mp4", lambda _: 1.0), ("drifts.mp4", lambda t: 1.0 + 0.3 * np.sin(4.0 * t))):
        film(tmp_path / name, hz=1.5, dots=False, gain=gain, frames=26)
        ds = track_video(tmp_path / name, CAMERA)
        ends.append(in_pixels(ds)[:, -1])
        assert ("lock the camera's exposure" in ds.attrs["history"]) == (name == "drifts.mp4")
    assert np.isfinite(ends).all()
    assert np.sqrt(np.mean(np.sum((ends[0] - ends[1]) ** 2, axis=1))) < 0.75  # pixels, of a tip 18 pixels wide


def test_a_still_film_is_refused_with_the_remedy(tmp_path: Path) -> None:
    film(tmp_path / "f.mp4", hz=0.0, dots=False, frames=12)
    with pytest.raises(InputError, match="lock the camera's exposure and check the contrast"):
        track_video(tmp_path / "f.mp4", CAMERA)
