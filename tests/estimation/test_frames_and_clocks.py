"""What a frame must hold, how the clocks of shape and pressure meet, and rates before anything was seen."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.estimation import KalmanFilter, Noise, estimate, kalman, offline
from pliant.estimation.differences import Differences
from pliant.estimation.measurement import check_frame, flips, rows_of
from pliant.mechanics import mechanics_of
from pliant.model import Extension, Station, chain_model
from pliant.recording import make_recording
from pliant.simulation import Pulse

ARM = chain_model(length=0.3, mass=0.05, links=3, stiffness=[1.0, 1.5, 2.0], damping=0.01, torque=[1e-6])
DEEP = ARM.with_(space=True, gravity=np.zeros(3))
ENDS = (Station("a", 0, 0.1), Station("b", 2, 0.1))
ROWS = rows_of(DEEP, ENDS, angle=True)  # x, y, z and three turns of each


def test_an_orientation_is_three_rows_of_one_link_in_order():
    values, variance = np.zeros(12), np.ones(12)
    check_frame(DEEP, ROWS, values, variance)
    check_frame(DEEP, ROWS[:3], values[:3], variance[:3])  # positions alone
    check_frame(DEEP, ROWS[3:6], np.full(3, np.nan), variance[:3])
    mixed = ROWS.copy()
    mixed[10, 1] = 0.0
    wrong = {
        "two of three": np.delete(ROWS, 4, axis=0),
        "another order": ROWS[[0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 9, 11]],
        "of two links": mixed,
        "apart": ROWS[[0, 1, 3, 2, 4, 5, 6, 7, 8, 9, 10, 11]],
        "one": ROWS[3:4],
    }
    for rows in wrong.values():
        with pytest.raises(InputError, match="an orientation needs three consecutive rows of one link"):
            check_frame(DEEP, rows, np.zeros(len(rows)), np.ones(len(rows)))
    for rows, v, s in ((ROWS[:, :4], values, variance), (ROWS, values[1:], variance), (ROWS, values, variance[1:])):
        with pytest.raises(InputError, match=r"a frame needs rows \(m, 5\), m values and m variances, got"):
            check_frame(DEEP, rows, v, s)


@pytest.mark.parametrize(("size", "good"), [(3.13, True), (-3.13, True), (3.3, False), (-3.3, False)])
def test_an_orientation_turns_by_half_a_turn_at_most(size, good):
    """The second one of two, about a slanted axis; a position may be of any size."""
    values = np.zeros(12)
    values[:3] = 99.0
    values[9:] = size * np.array([2.0, -1.0, 2.0]) / 3.0
    if good:
        check_frame(DEEP, ROWS, values, np.ones(12))
        return
    with pytest.raises(InputError, match="a rotation vector of at most half a turn"):
        check_frame(DEEP, ROWS, values, np.ones(12))


def test_a_flip_is_an_orientation_that_was_there_and_was_not_taken():
    values, seen = np.zeros((4, 12)), np.zeros((4, 12))
    seen[0, 3:6] = seen[0, 9:] = np.nan  # both
    seen[1, 3:6] = np.nan
    values[1, 5] = np.nan  # lost, in its last number
    seen[2, 9:] = np.nan
    values[2, 9] = np.nan
    seen[3, :3] = np.nan  # a position is none
    assert flips(ROWS, values, seen) == 2
    assert [flips(ROWS, values[k], seen[k]) for k in range(4)] == [2, 0, 0, 0]
    seen[2, 3:6] = np.nan
    values[2, 4] = np.nan
    assert flips(ROWS, values, seen) == 2


def test_a_filter_counts_the_flips_of_its_frames(monkeypatch):
    monkeypatch.setattr(kalman, "flips", lambda *_: 2)
    live = KalmanFilter(ARM, Noise())
    for k in range(3):
        live.push_frame(0.01 * k, rows_of(ARM, ARM.points[-1:]), np.array([0.0, 0.3]), np.full(2, 1e-6))
    assert live.counts.flipped == 6


def test_frames_that_are_stamped_late_are_of_earlier_pressures(monkeypatch):
    """A latency takes the frames to the clock of the pressure, back in time."""
    time = 1.0 + np.arange(30) / 100
    recording = make_recording(time, np.tile([0.0, 0.3], (30, 1, 1)), station=["link_3"], frame="planar")
    asked = []

    def planned(model, source, times, step):
        asked.append((times, step))
        raise InterruptedError

    monkeypatch.setattr(offline, "drive_plan", planned)
    for latency in (0.0, 0.004):
        with pytest.raises(InterruptedError):
            estimate(recording, ARM, pressure=Pulse(0.0), latency=latency)
        np.testing.assert_allclose(asked[-1][0], time - latency, rtol=0, atol=1e-12)
        assert asked[-1][1] == 5e-3


def test_rates_before_the_first_frame_are_as_uncertain_as_the_filter_passes():
    made = Differences(ARM, cutoff=20.0)
    n = ARM.n
    sums = np.tril(np.ones((n, n)))
    found, omega = made.state(0.0).covariance, 2 * np.pi * 20.0
    np.testing.assert_allclose(found[:n, :n], np.pi**2 * sums @ sums.T)
    np.testing.assert_allclose(found[n:, n:], (omega * np.pi) ** 2 * sums @ sums.T)


def test_the_first_joint_moves_with_a_base_that_lengthens():
    """A straight body whose base is 10 % longer: tips as much further on, and no rest angle."""
    parts = (Extension(50.0, 0.0, 0.0, 0.05, "base"), Extension(50.0, 0.0, 0.05, None, "body"))
    body = ARM.with_(base_length=0.05, base_angle=0.2, extensions=parts)
    along = np.array([-np.sin(0.2), np.cos(0.2)])
    for strain in (0.0, 0.1):
        aside = 0.05 * (1 + strain) * along + 0.01 * np.array([along[1], -along[0]])
        lean = np.arctan2(0.01, 0.1)  # the first link leads aside by 10 mm over 100
        tips = np.stack([aside + s * along for s in (0.1, 0.2, 0.3)])
        found = mechanics_of(body).with_rest_shape(np.array([0.0, 0.0, 0.0, strain, 0.4]), tips).rest_angle
        np.testing.assert_allclose(found, [-lean, lean, 0.0], atol=1e-12)
