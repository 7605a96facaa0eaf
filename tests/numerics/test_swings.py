"""Swings of a decay whose frequency and damping are known."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.numerics.ringdown import swings, turning_points

TIME = np.arange(0.0, 8.0, 0.01)


def decay(frequency: float, ratio: float) -> np.ndarray:
    w = 2 * np.pi * frequency  # of the damped motion, let go at rest
    sigma = ratio / np.sqrt(1 - ratio**2) * w
    return np.exp(-sigma * TIME) * (np.cos(w * TIME) + sigma / w * np.sin(w * TIME))


@pytest.mark.parametrize(("frequency", "ratio"), [(1.3, 0.05), (2.1, 0.15), (1.3, 0.3)])
def test_a_linear_decay_rings_alike_at_both_sizes(frequency: float, ratio: float) -> None:
    large, small = swings(TIME, 7.0 + 30.0 * decay(frequency, ratio))
    for found in (large, small):
        assert found.frequency == pytest.approx(frequency, rel=0.01)
        assert found.damping_ratio == pytest.approx(ratio, rel=0.02)
    assert large.amplitude > 5 * small.amplitude


def test_a_body_that_stiffens_as_it_calms_rings_faster_when_small() -> None:
    phase = 2 * np.pi * np.cumsum(1.3 + 0.8 * (1 - np.exp(-TIME / 3))) * 0.01
    noise = np.random.default_rng(1).normal(0.0, 1e-3, TIME.size)
    large, small = swings(TIME, np.exp(-0.8 * TIME) * np.cos(phase) + noise)
    assert large.frequency < 1.5
    assert small.frequency > 1.7
    assert large.damping_ratio > 1.15 * small.damping_ratio


def test_noise_and_stillness_have_no_swings() -> None:
    noise = np.random.default_rng(0).normal(0.0, 1.0, TIME.size)
    at, _ = turning_points(TIME, decay(1.3, 0.1) + 1e-3 * noise, 0.05)
    assert np.diff(at)[1:-1] == pytest.approx(0.5 / 1.3, rel=0.1)
    assert swings(TIME, np.zeros(TIME.size))[0].frequency is None
    assert swings(TIME, 1 - np.exp(-TIME))[1].frequency is None
