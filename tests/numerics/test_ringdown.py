"""A ring-down is found where there is one, with its numbers, and not where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.numerics.ringdown import decay_jacobian, decay_residual, ring_down

RATE = 100.0


def decay(
    frequency: float, ratio: float, duration: float = 2.0, *, amplitude: float = 1.0, creep: float = 0.0,
    phase: float = 0.4,
) -> tuple[np.ndarray, np.ndarray]:
    """A damped sine about an offset, with a slow exponential of the given share."""
    t = np.arange(0, duration, 1 / RATE)
    omega = 2 * np.pi * frequency
    sigma = ratio / np.sqrt(1 - ratio**2) * omega
    slow = creep * np.exp(-t / 0.8)
    return t, amplitude * (np.exp(-sigma * t) * np.cos(omega * t + phase) + 3.0 + slow)


@pytest.mark.parametrize(("frequency", "ratio"), [(2.0, 0.02), (5.0, 0.08), (8.3, 0.05), (12.0, 0.2)])
def test_a_clean_decay_gives_its_frequency_and_damping(frequency: float, ratio: float) -> None:
    ring = ring_down(*decay(frequency, ratio))
    assert ring is not None
    assert ring.frequency == pytest.approx(frequency, rel=1e-6)
    assert ring.damping_ratio == pytest.approx(ratio, rel=1e-5)
    assert ring.amplitude == pytest.approx(1.0, rel=1e-5)
    assert ring.explained == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_creep_and_noise_hardly_move_the_numbers(seed: int) -> None:
    t, y = decay(5.0, 0.08, creep=0.5)
    y = y + 0.02 * np.random.default_rng(seed).standard_normal(t.size)
    ring = ring_down(t, y)
    assert ring is not None
    assert ring.frequency == pytest.approx(5.0, rel=0.01)
    assert ring.damping_ratio == pytest.approx(0.08, rel=0.1)
    assert 0.9 < ring.explained <= 1.0


def test_unit_and_origin_of_time_do_not_matter() -> None:
    t, y = decay(5.0, 0.08, creep=0.3)
    small = ring_down(t + 1e3, 1e-6 * y)
    large = ring_down(t, 1e6 * y)
    assert small is not None
    assert large is not None
    assert small.frequency == pytest.approx(large.frequency, rel=1e-9)
    assert 1e6 * small.amplitude == pytest.approx(1e-6 * large.amplitude, rel=1e-6)


def test_a_slow_return_is_no_oscillation() -> None:
    t = np.arange(0, 2, 1 / RATE)
    assert ring_down(t, np.exp(-t / 0.3)) is None
    assert ring_down(t, 1 - np.exp(-t / 0.3) + 0.1 * t) is None


@pytest.mark.parametrize("seed", range(6))
def test_noise_is_no_oscillation(seed: int) -> None:
    t = np.arange(0, 2, 1 / RATE)
    assert ring_down(t, np.random.default_rng(seed).standard_normal(t.size)) is None


def test_fewer_than_two_periods_are_not_enough() -> None:
    assert ring_down(*decay(0.8, 0.05, duration=2.0)) is None
    assert ring_down(*decay(5.0, 0.05, duration=0.15)) is None


def test_too_few_samples_standstill_and_nan_give_none() -> None:
    t, y = decay(5.0, 0.08)
    assert ring_down(t[:15], y[:15]) is None
    assert ring_down(t, np.full(t.size, 4.2)) is None
    assert ring_down(t, np.where(t == t[7], np.nan, y)) is None
    assert ring_down(t[:0], y[:0]) is None


@pytest.mark.parametrize("rates", [(2.0, 2.5, 9.0), (0.8, 3.0, 3.5), (1.0, 1.2, 4.0)])
def test_an_over_damped_return_has_no_frequency(rates: tuple[float, float, float]) -> None:
    """A chain of lags, which a slow exponential and a damped sine would follow, with noise of 0.2 %."""
    t = np.arange(0.0, 6.0, 1 / RATE)
    a, b, c = rates
    y = sum(
        np.exp(-k * t) * p * q / ((p - k) * (q - k)) for k, p, q in ((a, b, c), (b, a, c), (c, a, b))
    )
    assert ring_down(t, y + 2e-3 * np.random.default_rng(0).standard_normal(t.size)) is None


@pytest.mark.parametrize("lag", [0.1, 0.7, 30.0])
def test_the_jacobian_of_the_residual_against_differences(rng, lag):
    t = np.arange(0.0, 3.0, 0.01)
    y = np.exp(-0.8 * t) * np.cos(30.0 * t + 0.3) + 0.4 * np.exp(-t / 0.9) + 0.01 * rng.normal(size=t.size)
    x, step = np.log([28.0, 1.1, lag]), 1e-6
    found = decay_jacobian(x, t, y)
    for k, move in enumerate(step * np.eye(3)):
        numeric = (decay_residual(x + move, t, y) - decay_residual(x - move, t, y)) / (2 * step)
        np.testing.assert_allclose(found[:, k], numeric, atol=1e-7)


def test_noise_in_which_a_column_of_the_jacobian_vanishes_tells_nothing() -> None:
    """The slow exponential of this record shrinks to nothing on the way, where MINPACK steps to what is no number."""
    rng = np.random.default_rng(2328)
    t = 0.013 * np.arange(int(rng.integers(16, 200)))
    assert ring_down(t, rng.normal(size=t.size)) is None


def test_a_decay_that_hardly_swings_is_no_oscillation() -> None:
    t, y = decay(5.0, 0.97)
    assert ring_down(t, y + 1e-3 * np.random.default_rng(0).standard_normal(t.size)) is None
