"""Each fault that is put into a clean recording is found, counted and named; a clean one is left in peace."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pliant.preprocessing.quality import quality
from pliant.recording import make_recording

TIME = np.arange(600) / 100


@pytest.fixture
def position(rng):
    """A ten-station body ringing at 5 Hz after a step at 1 s; noise 0.05 mm, base nearly still."""
    ringing = np.where(TIME > 1, 1 - np.exp(-2 * (TIME - 1)) * np.cos(2 * np.pi * 5 * (TIME - 1)), 0.0)
    s = np.linspace(0, 1, 10)
    place = np.zeros((600, 10, 3))
    place[..., 0] = 0.17 * s
    place[..., 1] = 0.015 * s**2 * ringing[:, None]
    return place + 5e-5 * rng.normal(size=place.shape)


def test_a_clean_recording_has_no_findings_but_a_still_base(position):
    q = quality(make_recording(TIME, position))
    assert q.rate_hz == pytest.approx(100)
    assert not any([q.spikes, q.station_jumps, q.frame_jumps_s, q.stretched, q.gaps, q.missing])
    assert q.noise_m["s005"] == pytest.approx(5e-5, rel=0.15)
    assert q.out_of_plane_share < 0.02
    assert "standing still: s000" in q.summary()
    json.dumps(q.to_dict())


def test_spikes_jumps_and_drop_outs_are_counted(position):
    position[300, 7] += [0, 0.004, 0]
    position[320:, 4] += [0, 0, 0.003]
    position[400:] += [0.002, 0.003, 0]
    position[10:15, 2] = np.nan
    q = quality(make_recording(TIME, position))
    assert q.spikes == {"s007": 1}
    assert q.station_jumps == {"s004": 1}
    assert q.frame_jumps_s == (4.0,)
    assert q.missing == {"s002": 5}


def test_repeated_frames_and_gaps(position):
    position[101:105] = position[100]
    time = TIME.copy()
    time[200:] += 0.1
    q = quality(make_recording(time, position))
    assert q.repeated_frames == 4
    assert q.gaps == (pytest.approx((1.99, 0.11)),)
    assert not q.frame_jumps_s


def test_stretched_spacing(position):
    position[50:60, 5:] += [0.0015, 0, 0]
    assert quality(make_recording(TIME, position)).stretched == {"s004-s005": 10}


def test_sign_flips(position):
    quaternion = np.zeros((600, 10, 4))
    quaternion[..., 3] = 1
    quaternion[100:200, 3] *= -1
    assert quality(make_recording(TIME, position, quaternion=quaternion)).sign_flips == {"s003": 2}


def test_nothing_moves(rng):
    q = quality(make_recording(TIME, [[0, 0, 0], [0, 0, 0.2]] + 1e-5 * rng.normal(size=(600, 2, 3))))
    assert "no station moves beyond its noise" in q.findings
    assert any("hardly moves" in sentence for sentence in q.findings)


@pytest.mark.parametrize(
    ("factor", "pressure", "sentence"),
    [
        (1, 15.0, "read as Pa"),
        (1, 1e8, "check its unit"),
        (1000, 1e5, "length_unit"),
        (1e-3, 1e5, "length_unit"),
    ],
)
def test_suspicious_units(position, factor, pressure, sentence):
    ds = make_recording(TIME, position * factor, pressure=np.linspace(0, pressure, 600))
    assert any(sentence in s for s in quality(ds).findings)


def test_missing_pressure_single_frame_and_strain():
    q = quality(make_recording([0, 1], np.zeros((2, 1, 3)), pressure=[np.nan, 5e4]))
    assert "1 samples of pressure are missing" in q.summary()
    quality(make_recording([0], np.zeros((1, 1, 3))))
    quality(make_recording([0, 1], np.full((2, 1, 3), np.nan)))
    strain = np.zeros((2, 1, 5))
    strain[0, 0, 1] = np.nan
    assert quality(make_recording([0, 1], strain=strain, gauge_position=np.arange(5.0))).missing == {"core000": 1}
