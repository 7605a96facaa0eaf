"""Pressure inputs: what they say at a time, where they bend and jump, what they refuse."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.simulation import Chirp, Pulse, Step, Trace, ramp, triangle


def test_pulse_holds_its_level_between_its_edges():
    pulse = Pulse(119e3, 0.12, 2.76)
    assert pulse(np.array([0.0, 0.1199, 0.12, 1.0, 2.8799, 2.88, 3.0])).tolist() == [0, 0, 119e3, 119e3, 119e3, 0, 0]
    assert pulse.jumps.tolist() == [0.12, 0.12 + 2.76]
    assert pulse.breakpoints.tolist() == pulse.jumps.tolist()


def test_step_has_one_edge_only():
    assert Step(1e5, 0.3).jumps.tolist() == [0.3]
    assert Step(1e5)(np.array([-1e-9, 0.0, 1e6])).tolist() == [0.0, 1e5, 1e5]
    assert repr(Step(1e5, 0.3)) == "Step(level=100000.0, start=0.3)"
    with pytest.raises(InputError, match="step: start must be finite, got inf"):
        Step(1e5, np.inf)
    with pytest.raises(TypeError):
        Step(1e5, 0.3, 1.0)  # what ends is a pulse


def test_ramp_and_triangle_are_straight_between_their_corners():
    rise = ramp(1e5, 0.2, 0.5)
    assert rise(np.array([0.0, 0.2, 0.45, 0.7, 9.0])) == pytest.approx([0, 0, 5e4, 1e5, 1e5])
    assert rise.breakpoints.tolist() == [0.2, 0.7]
    assert rise.jumps.size == 0
    saw = triangle(8e4, 2.0, 3, start=1.0)
    assert saw(np.array([0.5, 1.5, 2.0, 2.5, 3.0, 6.0, 7.0, 8.0])) == pytest.approx([0, 4e4, 8e4, 4e4, 0, 8e4, 0, 0])
    assert saw.breakpoints == pytest.approx(np.arange(1.0, 7.5, 1.0))


def test_trace_interpolates_and_jumps_where_a_time_stands_twice():
    trace = Trace([0.0, 1.0, 1.0, 2.0], [0.0, 10.0, 50.0, 70.0])
    assert trace(np.array([-1.0, 0.5, 1.0 - 1e-12, 1.0, 1.5, 2.0, 5.0])) == pytest.approx([0, 5, 10, 50, 60, 70, 70])
    assert trace.jumps.tolist() == [1.0]
    assert trace.breakpoints.tolist() == [0.0, 1.0, 2.0]
    assert trace(np.zeros((2, 3))).shape == (2, 3)
    assert trace(0.5) == pytest.approx(5.0)


def test_trace_of_one_point_is_constant_and_a_jump_at_the_first_time_counts():
    assert Trace([3.0], [7.0])(np.array([0.0, 3.0, 9.0])).tolist() == [7.0, 7.0, 7.0]
    assert Trace([0.0, 0.0], [1.0, 2.0])(np.array([-1e-9, 0.0, 1.0])).tolist() == [1.0, 2.0, 2.0]


def test_trace_keeps_a_copy_and_cannot_be_changed():
    t, p = np.array([0.0, 1.0]), np.array([0.0, 1.0])
    trace = Trace(t, p)
    p[1] = 99.0
    assert trace(1.0) == 1.0
    with pytest.raises(ValueError, match="read-only"):
        trace.pressure[0] = 5.0


@pytest.mark.parametrize(
    "made", [Pulse(119e3, 0.12, 2.76), Step(1e5, 0.3), ramp(1e5, 0.2, 0.5), Trace([3.0], [7.0]),
             Trace([0.0, 1.0, 1.0, 2.0], [0.0, 10.0, 50.0, 70.0]), Trace([0.0, 0.0], [1.0, 2.0])],
)  # fmt: skip
def test_one_time_is_told_as_many_are(made, rng):
    """To the last bit, on either side of every corner: solvers ask one by one, drives for all at once."""
    corners = made.breakpoints
    corners = np.concatenate([corners, np.nextafter(corners, -9.0), np.nextafter(corners, 9.0)])
    times = np.concatenate([corners, rng.uniform(-1.0, 4.0, 200), [-np.inf, np.inf]])
    np.testing.assert_array_equal([made(t) for t in times.tolist()], made(times))
    assert made(0.5).shape == made(np.float64(0.5)).shape == ()


def test_trace_agrees_with_numpy_on_random_points(rng):
    t = np.sort(rng.uniform(0, 3, 200))
    p = rng.normal(size=200)
    ask = rng.uniform(-1, 4, 1000)
    assert Trace(t, p)(ask) == pytest.approx(np.interp(ask, t, p), abs=1e-12)


def test_chirp_sweeps_from_its_first_to_its_last_frequency():
    chirp = Chirp(2e4, 5e4, 0.5, 8.0, 10.0, start=1.0)
    assert chirp(np.array([0.999, 11.0])).tolist() == [0.0, 0.0]
    assert chirp.jumps.tolist() == [1.0, 11.0]
    t = np.linspace(1.0, 11.0, 200_001)[:-1]
    p = chirp(t)
    assert p.max() == pytest.approx(7e4, rel=1e-6)
    assert p.min() == pytest.approx(3e4, rel=1e-6)
    up = t[1:][(p[:-1] < 5e4) & (p[1:] >= 5e4)]
    assert up.size == pytest.approx(10.0 * (0.5 + 8.0) / 2, abs=1)  # mean frequency times duration
    assert 1 / np.diff(up[-2:])[0] == pytest.approx(8.0, rel=0.02)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Pulse(np.nan), "level must be finite"),
        (lambda: Pulse(1e5, np.inf), "start must be finite"),
        (lambda: Pulse(1e5, 0.0, 0.0), "width must be positive"),
        (lambda: Pulse(1e5, 0.0, np.nan), "width must be positive"),
        (lambda: Trace([0, 1, 2], [0, np.nan, 1]), "1 of 3 samples are not"),
        (lambda: Trace([0, np.inf], [0, 1]), "must be finite"),
        (lambda: Trace([0, 2, 1], [0, 1, 2]), "must not decrease"),
        (lambda: Trace([0, 1], [0, 1, 2]), "pressure trace needs"),
        (lambda: Trace([], []), "pressure trace needs"),
        (lambda: Trace([[0, 1]], [[0, 1]]), "pressure trace needs"),
        (lambda: ramp(1e5, 0.0, -1.0), "duration must be a positive time"),
        (lambda: ramp(1e5, 0.0, np.nan), "duration must be a positive time"),
        (lambda: triangle(1e5, 0.0, 3), "positive period"),
        (lambda: triangle(1e5, 1.0, 0), "at least one cycle"),
        (lambda: Chirp(1e4, 0.0, 1.0, 5.0, 0.0), "duration must be a positive time"),
        (lambda: Chirp(1e4, np.nan, 1.0, 5.0, 1.0), "offset must be finite"),
    ],
)
def test_bad_inputs_get_one_clear_sentence(make, words):
    with pytest.raises(InputError, match=words) as caught:
        make()
    assert "\n" not in str(caught.value)
