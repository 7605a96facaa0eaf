"""The fibre sensor's emulator: exact without imperfections, and each imperfection as large as it was set."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.testbed import fibre
from pliant.testbed.fibre import FibreSensor
from pliant.testbed.laboratory import MotionCapture, marker_names, marker_positions, observe_markers
from pliant.testbed.rod import RodParameters
from pliant.testbed.stepping import RodMotion

P = RodParameters()
IDEAL = FibreSensor(
    offset=0.0, noise=0.0, bias=0.0, gain_error=0.0, twist=0.0, out_of_plane=0.0, misalignment=0.0, displacement=0.0,
    jitter=0.0, drop_out=0.0, latency=0.0, strain_drift=0.0,
)  # fmt: skip


def arc(kappa, frames=5, spacing=1e-2):
    """A motion whose shape stays a circle of one curvature."""
    s = np.append(np.linspace(0, P.length, 101), 0.18)
    blank = np.zeros((frames, s.size, 2))
    return RodMotion(
        np.arange(frames) * spacing, s, blank, blank, np.full((frames, 101), kappa), blank, np.zeros(frames),
        np.zeros(frames), np.zeros((frames, 5)), 1.0,
    )  # fmt: skip


def sense(sensor, motion=None, seed=0):
    motion = motion or arc(8.0)
    rng = np.random.default_rng(seed)
    return fibre.sensed_curvature(motion, P, sensor, motion.time, np.random.default_rng([seed, 9]), rng)


def test_ideal_fibre_traces_clamp_arc_cap_and_tail():
    station = fibre.station_position(P, IDEAL)
    kappa = sense(IDEAL)[0][0]
    clear = 0.6 * IDEAL.gauge
    parts = [(-1.0, 0.0, 0.0), (0.0, P.length, 8.0), (P.length, 0.2, P.cap_curvature), (0.2, 1.0, 0.0)]
    for start, stop, value in parts:
        inside = (station > start + clear) & (station < stop - clear)
        assert inside.sum() > 10
        assert kappa[inside] == pytest.approx(value, abs=1e-9)
    shape = fibre.integrate_shape(sense(IDEAL), IDEAL.spacing)[0]
    body = (station > 0.003) & (station < 0.168)
    turned = 8.0 * station[body]
    exact = np.column_stack([IDEAL.lead_in + np.sin(turned) / 8.0, (1 - np.cos(turned)) / 8.0, 0 * turned])
    assert np.abs(shape[body] - exact).max() < 2e-5


def test_integration_is_exact_for_a_circle_in_any_plane():
    n, kappa = 501, 2 * np.pi / 0.4
    for roll in (0.0, 0.7, 2.0):
        curvature = kappa * np.array([np.cos(roll), np.sin(roll)])[:, None, None] * np.ones((2, 1, n))
        shape = fibre.integrate_shape(curvature, 0.4 / (n - 1))[0]
        assert shape[-1] == pytest.approx(np.zeros(3), abs=1e-13)
        assert np.linalg.norm(shape[(n - 1) // 2]) == pytest.approx(2 / kappa, rel=1e-4)


def test_fibre_beside_the_neutral_layer_feels_less_curvature_and_slides():
    sensor = replace(IDEAL, offset=0.003)
    station = fibre.station_position(P, sensor)
    kappa = sense(sensor)[0][0]
    inside = (station > 0.01) & (station < 0.16)
    assert kappa[inside] == pytest.approx(8.0 / (1 + 0.003 * 8.0), rel=1e-6)
    edge = np.interp(30.0, kappa[200:240], station[200:240])  # half way up to the cap's curvature
    assert edge == pytest.approx(P.length + 0.003 * 8.0 * P.length, abs=1e-4)


def test_white_noise_and_its_effect_on_the_tip():
    sensor = replace(IDEAL, noise=0.2)
    motion = arc(0.0, frames=1500)
    noise = sense(sensor, motion)
    true = fibre.gauge_curvature(motion, P, sensor, motion.time)
    assert np.std(noise[0] - true) == pytest.approx(0.2, rel=0.01)
    assert np.std(noise[1]) == pytest.approx(0.2, rel=0.01)
    assert abs(np.mean((noise[0] - true)[1:] * (noise[0] - true)[:-1])) < 0.01 * 0.04
    station = fibre.station_position(P, sensor)
    tip = np.argmin(np.abs(station - P.length))
    shape = fibre.integrate_shape(noise[:, :, : tip + 1], sensor.spacing)
    expected = 0.2 * np.sqrt(sensor.spacing * (station[tip] - station[0]) ** 3 / 3)
    assert np.std(shape[:, -1, 1]) == pytest.approx(expected, rel=0.06)


def test_bias_is_smooth_along_the_fibre_and_wanders_slowly(rng):
    sensor = replace(IDEAL, bias=0.05, bias_time=2.0)
    station = fibre.station_position(P, sensor)
    at = np.arange(400) * 0.1
    runs = np.array([fibre.wandering_bias(sensor, station, at, rng) for _ in range(40)])
    assert np.std(runs) == pytest.approx(0.05, rel=0.06)
    lagged = np.mean(runs[:, 10:] * runs[:, :-10]) / np.mean(runs**2)
    assert lagged == pytest.approx(np.exp(-1.0 / 2.0), abs=0.06)
    apart = round(sensor.bias_length / sensor.spacing)
    along = np.mean(runs[:, :, apart:] * runs[:, :, :-apart]) / np.mean(runs**2)
    assert along == pytest.approx(np.exp(-0.5), abs=0.12)


@pytest.mark.slow
def test_systematic_errors_have_their_spread_and_stay_within_a_specimen():
    seeds = range(150)
    gain = [sense(replace(IDEAL, gain_error=0.01), seed=s)[0, 0, 100] / 8.0 - 1 for s in seeds]
    assert np.std(gain) == pytest.approx(0.01, rel=0.2)
    roll = [np.arctan2(*sense(replace(IDEAL, twist=0.03), seed=s)[::-1, 0, 231]) for s in seeds]
    expected = 0.03 * np.sqrt(232 / fibre.station_position(P, IDEAL).size)
    assert np.std(roll) == pytest.approx(expected, rel=0.2)
    heights = []
    for s in seeds:
        shape = fibre.integrate_shape(sense(replace(IDEAL, out_of_plane=1.5e-3), arc(0.0), s)[:, :1], IDEAL.spacing)
        heights.append(shape[0, 232, 2])
    assert np.std(heights) == pytest.approx(1.5e-3, rel=0.35)
    poses = [fibre.place(np.eye(3), replace(IDEAL, displacement=5e-4), np.random.default_rng(s))[0] for s in seeds]
    assert np.std(np.array(poses) - [1, 0, 0], axis=0) == pytest.approx(np.full(3, 5e-4), rel=0.2)
    tilts = [fibre.place(np.eye(3), replace(IDEAL, misalignment=0.009), np.random.default_rng(s)) for s in seeds]
    assert np.std([t[0, 1] for t in tilts]) == pytest.approx(0.009, rel=0.2)
    assert np.array_equal(
        sense(FibreSensor(noise=0, bias=0), seed=4)[1, 0], sense(FibreSensor(noise=0, bias=0), seed=4)[1, 1]
    )


def test_drop_outs_jitter_and_latency(rng):
    sensor = FibreSensor(drop_out=0.01, drop_out_length=2.0, jitter=3e-4, latency=5e-3)
    lost = fibre.drop_frames(100_000, sensor, rng)
    assert lost.mean() == pytest.approx(0.02, rel=0.12)
    at = np.arange(20_000) / 75.0
    stamps = fibre.time_stamps(at, sensor, rng)
    assert np.mean(stamps - at) == pytest.approx(5e-3, abs=1e-5)
    assert np.std(stamps - at) == pytest.approx(3e-4, rel=0.03)
    assert np.diff(stamps).min() > 0
    wild = fibre.time_stamps(at, replace(sensor, jitter=0.05), rng)
    assert np.diff(wild).min() > 0


def test_core_strain_gives_the_curvature_back():
    sensor = replace(IDEAL, noise=0.3, strain_drift=1e-5)
    kappa = sense(sensor)
    strain = fibre.core_strain(kappa, sensor, np.random.default_rng(1))
    assert strain.shape == (5, 4, kappa.shape[2])
    outer, angle = strain[:, 1:] - strain[:, :1], np.array(fibre.CORE_ANGLE[1:])
    back = (
        -2.0
        / (3 * sensor.core_radius)
        * np.stack([np.einsum("tcg,c->tg", outer, np.cos(angle)), np.einsum("tcg,c->tg", outer, np.sin(angle))])
    )
    assert back == pytest.approx(kappa, abs=1e-8)
    assert np.abs(strain[:, 0]).max() > 0  # temperature and tension


def test_markers_are_rigid_on_the_clamp_noisy_and_sometimes_lost(rng):
    mocap = MotionCapture(markers=4, noise=5e-5, drop_out=0.01)
    motion = arc(8.0, frames=1000)
    true = marker_positions(motion, P, mocap, motion.time)
    seen = observe_markers(motion, P, mocap, motion.time, rng)
    assert seen.shape == (1000, 7, 3) == true.shape
    assert len(marker_names(mocap)) == 7
    radius = np.linalg.norm(true[0, 3:, :2] - [-1 / 8.0, 0.0], axis=1)
    assert radius == pytest.approx(np.full(4, 1 / 8.0 + mocap.stand_off), rel=1e-5)
    assert np.isnan(seen[:, :, 0]).mean() == pytest.approx(0.01, rel=0.35)
    assert np.array_equal(np.isnan(seen[..., 0]), np.isnan(seen[..., 2]))
    assert np.nanstd(seen, axis=0) == pytest.approx(np.full((7, 3), 5e-5), rel=0.12)
    gap = np.linalg.norm(np.nanmean(seen, axis=0)[0] - np.nanmean(seen, axis=0)[6])
    assert gap == pytest.approx(np.linalg.norm(true[0, 0] - true[0, 6]), abs=2e-5)


@pytest.mark.parametrize("change", [{"gauge": 0.0}, {"noise": -1.0}, {"drop_out": 1.0}, {"drop_out_length": 0.5}])
def test_settings_without_sense_are_refused(change):
    with pytest.raises(InputError):
        replace(IDEAL, **change)
