"""Inner formulas of the estimators against their matrix form, written out with NumPy."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.estimation import kalman_loops
from pliant.estimation.adaptive_observer_loops import correct_all
from pliant.estimation.kalman_loops import add_noise, chain_transition, joint_values, propagate, update
from pliant.estimation.offline import smooth


def test_noise_of_torques_that_joints_share_is_one_random_number_for_all(rng):
    n, N, h, walk = 3, 8, 2e-3, np.array([0.2, 0.5])
    J = rng.normal(size=(3 * n, 2 * n))
    own, common, gain = rng.uniform(0.1, 1.0, n), np.array([0.7, 0.0]), rng.normal(size=(2, n))
    P = np.zeros((N, N))
    add_noise(P, n, h, gain, (own, common, walk, 3.0, np.array([4.0])), J, np.empty(2 * n))
    rates = J[2 * n :].T  # (2n, n): what a torque at each joint does to the state
    expected = rates @ np.diag(own / h) @ rates.T + common[0] / h * np.outer(rates @ gain[0], rates @ gain[0])
    np.testing.assert_allclose(P[: 2 * n, : 2 * n], expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(P[2 * n :, 2 * n :], np.diag(walk) * (1.0 + 3.0 * 4.0) * h, rtol=1e-12)


def test_the_factor_is_corrected_by_recursive_least_squares(rng):
    n = 3
    gain, root = rng.normal(size=(3 * n, n)), rng.normal(size=(n, n))
    precision, innovation, by = root @ root.T, rng.normal(size=n), rng.normal(size=3 * n)
    start = {name: rng.normal(size=n) for name in ("angle", "rate", "own_shift")}
    p = 0.3
    state = SimpleNamespace(innovation=innovation.copy(), sensitivity=by.copy(), factor=np.array([1.1, p]),
                            **{k: v.copy() for k, v in start.items()})  # fmt: skip
    correct_all(state, SimpleNamespace(gain=gain, precision=precision), np.empty(3 * n), np.empty(3 * n))
    seen = by[:n]
    step = p * seen @ precision @ innovation / (1.0 + p * seen @ precision @ seen)
    assert state.factor[0] == pytest.approx(1.1 + step, rel=1e-12)
    assert state.factor[1] == pytest.approx(p / (1.0 + p * seen @ precision @ seen), rel=1e-12)
    left = by - gain @ seen
    np.testing.assert_allclose(state.sensitivity, left, rtol=1e-12, atol=1e-13)
    moved = gain @ innovation + left * step
    found = np.concatenate([state.angle, state.rate, state.own_shift]) - np.concatenate(list(start.values()))
    np.testing.assert_allclose(found, moved, rtol=1e-10, atol=1e-13)


def joint_covariance(rng, N):
    root = rng.normal(size=(N, N))
    return root @ root.T


def whole_jacobian(J, N, m):
    """F = [[A, G], [0, 1]] from its first m columns, row by variable."""
    F = np.eye(N)
    F[:m] = J[:N].T
    return F


@pytest.mark.parametrize("disturbed", [True, False])
def test_a_covariance_and_a_transition_move_by_the_whole_jacobian(rng, disturbed):
    n = 3
    m, N = 2 * n, (3 if disturbed else 2) * n
    P, J, F = joint_covariance(rng, N), rng.normal(size=(3 * n, m)), rng.normal(size=(N, N))
    whole = whole_jacobian(J, N, m)
    moved_P, moved_F = P.copy(), F.copy()
    propagate(moved_P, N, n, J, np.empty((N, N)))
    np.testing.assert_allclose(moved_P, whole @ P @ whole.T, rtol=1e-12, atol=1e-12)
    chain_transition(moved_F, N, n, J, np.empty((N, N)))
    np.testing.assert_allclose(moved_F, whole @ F, rtol=1e-12, atol=1e-12)


def test_a_frame_corrects_row_by_row_as_all_rows_at_once_do(rng, monkeypatch):
    n, rows = 3, 5
    N = 3 * n
    P, H, R = joint_covariance(rng, N), rng.normal(size=(rows, n)), rng.uniform(0.5, 2.0, rows)
    H[1, 0] = 0.0
    seen, z = rng.normal(size=rows), rng.normal(size=rows)
    z[3] = np.nan  # one that is missing

    def observed(phi, frame, sight, value, slopes):
        value[:], slopes[:] = seen, H

    monkeypatch.setattr(kalman_loops, "observe_rows", observed)
    state = SimpleNamespace(angle=np.zeros(n), covariance=P.copy())
    frame = SimpleNamespace(values=z, variance=R, innovation=np.empty(rows))
    work = SimpleNamespace(H=np.empty((rows, n)), gain=np.empty(N), change=np.empty(N), sight=None, seen=np.empty(rows))
    kept = {}
    monkeypatch.setattr(kalman_loops, "correct", lambda *_: kept.update(change=work.change.copy()))
    used, square, logdet = update(state, None, frame, work)
    good = np.isfinite(z)
    whole = np.concatenate([H, np.zeros((rows, N - n))], axis=1)[good]
    S = whole @ P @ whole.T + np.diag(R[good])
    K = np.linalg.solve(S, whole @ P).T
    nu = (z - seen)[good]
    assert used == 4
    assert square == pytest.approx(nu @ np.linalg.solve(S, nu))
    assert logdet == pytest.approx(np.linalg.slogdet(S)[1])
    np.testing.assert_allclose(kept["change"], K @ nu, atol=1e-12)
    np.testing.assert_allclose(state.covariance, P - K @ S @ K.T, atol=1e-11)
    np.testing.assert_allclose(frame.innovation[good], np.linalg.solve(np.linalg.cholesky(S), nu), atol=1e-12)
    assert np.isnan(frame.innovation[3])


@pytest.mark.parametrize("lag", [0, 1, 3, 30])
def test_a_smoother_is_the_plain_recursion(rng, lag):
    """Rauch, Tung and Striebel over the frames up to `lag` later, frame by frame."""
    T, N = 9, 4
    F = rng.normal(size=(T, N, N)) * 0.5 + np.eye(N)
    C = np.array([joint_covariance(rng, N) for _ in range(T)])
    ahead = np.array([F[k] @ C[k - 1] @ F[k].T + joint_covariance(rng, N) for k in range(T)])
    x, predicted = rng.normal(size=(2, T, N))
    out = SimpleNamespace(estimate=x, covariance=C, predicted=predicted, predicted_covariance=ahead, transition=F)
    found, spread = smooth(out, lag)
    for k in range(T):
        last = min(k + lag, T - 1)
        state, cover = x[last], C[last]
        for j in range(last - 1, k - 1, -1):
            G = C[j] @ F[j + 1].T @ np.linalg.inv(ahead[j + 1])
            state, cover = x[j] + G @ (state - predicted[j + 1]), C[j] + G @ (cover - ahead[j + 1]) @ G.T
        np.testing.assert_allclose(found[k], state, rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose(spread[k], cover, rtol=1e-7, atol=1e-7)
    with pytest.raises(InputError, match="at least 0, got -1"):
        smooth(out, -1)


def test_link_angles_follow_a_body_that_winds_up(rng):
    """Chords of 0.1 m between ends that lie between points; each angle is the nearest to that of the link before."""
    turn = np.array([0.5, 1.8, 1.2, 0.9, -2.9, 0.3])
    angle = np.cumsum(turn)
    chords = 0.1 * np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    ends = np.concatenate([np.zeros((1, 2)), np.cumsum(chords, axis=0)])
    left, share = np.arange(7) * 2, rng.uniform(0.2, 0.8, 7)
    points = rng.normal(size=(14, 2))
    points[1::2] = (ends - (1 - share[:, None]) * points[::2]) / share[:, None]
    out = np.empty(6)
    joint_values(points, (left, share), out)
    np.testing.assert_allclose(out, turn, atol=1e-9)
    points[4, 1] = np.nan
    joint_values(points, (left, share), out)
    assert np.isnan(out).all()
