"""Compiled loops of the Kalman filter: prediction with exact Jacobians, correction, and whole recordings.

The state is (phi, w) or (phi, w, d): absolute angles [rad] and rates [rad/s] of the links, and a disturbance torque
[N m] of each joint, a random walk. With S extensible segments, strains, strain rates and their disturbances follow the
links' entries, so that n + S replaces n. In space the N joint coordinates replace the n angles. Hysteresis and creep
states move with the estimate; their uncertainty is left to the disturbance.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.linearised import step_jacobian
from pliant.equations.memory import follow_change, step_with_memory
from pliant.equations.observation import motion_of, observe_rows
from pliant.equations.symbols import Past
from pliant.estimation.symbols import FilterFrame

FADE = 0.1  # s, decay time of the recent motion


def predict(state, model, h, torque, noise, workspace):
    """Advance the filter's state and covariance in place by one step h [s], under the mean torques (n,) [N m] of n
    joints.

    Writes the Jacobian of the step to workspace.J, one row for each variable. Returns -1 if the step failed, else 0.
    """
    phi, w, d, P, memory_state = state
    gain, body, joints, law, remembers = model
    n = len(phi)
    N = P.shape[0]
    springs = joints
    tau = workspace.work.tau
    for i in range(len(tau)):
        tau[i] = torque[i]
    for i in range(n):
        tau[i] += d[i]
    if remembers:
        for i in range(n):
            workspace.phi[i] = phi[i]
            workspace.w[i] = w[i]
        taken = step_with_memory(
            workspace.phi, workspace.w, h, tau, body, joints, Past(law, memory_state, workspace.held),
            workspace.work,
        )
        if not taken >= 0.0:
            return -1
        springs = workspace.held.springs
    step_jacobian(phi, w, h, tau, body, springs, workspace.slopes)
    for i in range(n):
        if not abs(w[i]) * h <= 1.0:
            return -1
    propagate(P, N, n, workspace.J, workspace.W)
    recall(motion_of(w, joints), h, noise.recent)
    add_noise(P, n, h, gain, noise, workspace.J, workspace.G)
    return 0


def moved(J, B, N, n, W):
    """Write to W the first 2n rows of the product F B, where F (N, N) is the Jacobian of a time step and B (N, N) any
    matrix. The N filter states are n angles, n rates and, if they are estimated, n disturbance torques.

    The columns of F = [[A, G], [0, 1]] are the rows of J (3n, 2n). The other rows of F B are those of B. Used for the
    covariance and for the transition of a whole frame.
    """
    for a in range(2 * n):
        for b in range(N):
            W[a, b] = 0.0
        for v in range(N):
            f = J[v, a]
            for b in range(N):
                W[a, b] += f * B[v, b]


def propagate(P, N, n, J, W):
    """Replace the covariance P (N, N) of the N filter states by F P F^T in place, where F is the Jacobian of a time
    step.
    """
    m = 2 * n
    moved(J, P, N, n, W)
    for a in range(m):
        for b in range(a + 1):
            P[a, b] = 0.0
        for v in range(N):
            f = W[a, v]
            for b in range(a + 1):
                P[a, b] += f * J[v, b]
        for b in range(a):
            P[b, a] = P[a, b]
        for b in range(m, N):
            P[a, b] = W[a, b]
            P[b, a] = W[a, b]


def add_noise(P, n, h, gain, noise, J, G):
    """Add the process noise of one step h [s] to the covariance P (N, N) of the N filter states: white torque noise,
    and the random walk of the disturbance torques.

    `G` (2n,) is workspace.
    """
    each, common, random_walk, motion_growth, recent = noise
    m = 2 * n
    for i in range(n):
        for a in range(m):
            f = each[i] / h * J[m + i, a]
            for b in range(m):
                P[a, b] += f * J[m + i, b]
    for c in range(len(common)):
        if not common[c] > 0.0:
            continue
        for a in range(m):
            G[a] = 0.0
            for i in range(gain.shape[1]):
                G[a] += gain[c, i] * J[m + i, a]
        for a in range(m):
            for b in range(m):
                P[a, b] += common[c] / h * G[a] * G[b]
    for i in range(P.shape[0] - m):
        P[m + i, m + i] += random_walk[i] * (1.0 + motion_growth * recent[0]) * h


def recall(power, h, recent):
    """Update in place the recent peak of the joints' mean square rate [rad^2/s^2], whose present value is `power`. The
    peak decays with the time constant `FADE`.
    """
    recent[0] = max(power, recent[0] / (1.0 + h / FADE))


def update(state, model, frame, workspace):
    """Correct the filter's state by a measured frame, one value after another. Missing values are skipped.

    All rows are linearised about the prediction, which gives the same estimate as a joint update without factoring a
    matrix. Each innovation is independent of those before it. Writes them to `frame.innovation`, scaled to unit
    variance. Returns (number of rows used, normalised innovation squared, log of the determinant of the innovations'
    covariance).

    Source: Bierman, Factorization Methods for Discrete Sequential Estimation (1977), Sec. V
    """
    phi, P = state.angle, state.covariance
    z, R, innovation = frame.values, frame.variance, frame.innovation
    n = len(phi)
    N = P.shape[0]
    H, gain, change = workspace.H, workspace.gain, workspace.change
    observe_rows(phi, frame, workspace.sight, workspace.seen, H)
    used = 0
    square = 0.0
    logdet = 0.0
    for a in range(N):
        change[a] = 0.0
    for r in range(len(z)):
        innovation[r] = np.nan
        nu = z[r] - workspace.seen[r]
        if not np.isfinite(nu):
            continue
        S = R[r]
        for a in range(N):
            gain[a] = 0.0
        for k in range(n):
            slope = H[r, k]
            if slope != 0.0:
                nu -= slope * change[k]
                for a in range(N):
                    gain[a] += slope * P[k, a]
        for k in range(n):
            S += H[r, k] * gain[k]
        share = 1.0 / S
        for a in range(N):
            f = share * gain[a]
            change[a] += f * nu
            for b in range(N):
                P[a, b] -= f * gain[b]
        used += 1
        square += nu * nu * share
        logdet += np.log(S)
        innovation[r] = nu * np.sqrt(share)
    correct(state, model, change, workspace)
    return used, square, logdet


def correct(state, model, change, workspace):
    """Add a correction (N,) to the N filter states. The friction states of the joints (slip elements, Bouc-Wen) are
    updated for the change of the angles; creep states do not change.
    """
    phi, w, d, _P, memory_state = state
    joints, law, remembers = model.joints, model.memory, model.remembers
    n = len(phi)
    if remembers:
        follow_change(phi, change, joints, Past(law, memory_state, workspace.held))
    for a in range(n):
        phi[a] += change[a]
        w[a] += change[n + a]
    for a in range(2 * n, len(change)):
        d[a - 2 * n] += change[a]


def predict_span(state, model, prediction, workspace):
    """Advance the filter's state and covariance by several steps under constant torque; return -1 if a step failed,
    else 0.
    """
    for _ in range(prediction.steps):
        if predict(state, model, prediction.h, prediction.torque, prediction.noise, workspace) < 0:
            return -1
    return 0


def many_frames(count, state, model, prediction, frame, workspace):
    """Filter `count` identical frames, so that a benchmark can measure the time per frame."""
    for _ in range(count):
        predict_span(state, model, prediction, workspace)
        update(state, model, frame, workspace)


def filter_record(state, model, plan, noise, frames, out, workspace):
    """Filter a whole recording; write predictions, estimates, covariances and innovations of each frame to `out`.

    `plan` is (h, torque, first step of each frame); `frames` has values (T, m). `out` receives, frame by frame, the
    prediction and the estimate (T, N), their covariances (T, N, N), the transition from the frame before (T, N, N),
    whitened innovations (T, m) and (rows used, their sum of squares, log of the determinant, recent motion). Returns
    the frame at which a step failed, or -1.
    """
    h, torque, begin = plan
    z = frames.values
    n = len(state.angle)
    N = state.covariance.shape[0]
    for f in range(z.shape[0]):
        for a in range(N):
            for b in range(N):
                out.transition[f, a, b] = 1.0 if a == b else 0.0
        for k in range(begin[f], begin[f + 1]):
            if predict(state, model, h[k], torque[k], noise, workspace) < 0:
                return f
            chain_transition(out.transition[f], N, n, workspace.J, workspace.W)
        store(state, out.predicted[f], out.predicted_covariance[f])
        frame = FilterFrame(
            frames.base_angle, frames.chain, frames.wide, frames.rows, z[f], frames.variance, out.innovation[f]
        )
        used, square, logdet = update(state, model, frame, workspace)
        out.score[f, 0] = used
        out.score[f, 1] = square
        out.score[f, 2] = logdet
        out.score[f, 3] = noise.recent[0]
        store(state, out.estimate[f], out.covariance[f])
    return -1


def chain_transition(F, N, n, J, W):
    """Multiply, in place, the transition matrix F (N, N) of the N filter states from the left by the Jacobian of the
    next time step.
    """
    moved(J, F, N, n, W)
    for a in range(2 * n):
        for b in range(N):
            F[a, b] = W[a, b]


def store(state, x, C):
    """Copy the N filter states to x (N,) and their covariance to C (N, N)."""
    phi, w, d, P, _memory = state
    n = len(phi)
    for a in range(P.shape[0]):
        if a < n:
            x[a] = phi[a]
        elif a < 2 * n:
            x[a] = w[a - n]
        else:
            x[a] = d[a - 2 * n]
        for b in range(P.shape[0]):
            C[a, b] = P[a, b]


def joint_values(points, ends, out):
    """Write to `out` (n,) [rad] the angles of n links, each relative to the link before, computed from S points (S, 2)
    [m] on the body.

    The first angle is relative to +y; all are NaN if a point is lost. `ends` holds for each end of a link the index of
    the point before it (n + 1,) and the weight of the point after it (n + 1,). Angles are unwrapped.
    """
    left, share = ends
    for k in range(len(points)):
        if not (np.isfinite(points[k, 0]) and np.isfinite(points[k, 1])):
            for i in range(len(out)):
                out[i] = np.nan
            return
    before = 0.0
    for i in range(len(left) - 1):
        j = left[i]
        k = left[i + 1]
        x = (1.0 - share[i + 1]) * points[k, 0] + share[i + 1] * points[k + 1, 0]
        y = (1.0 - share[i + 1]) * points[k, 1] + share[i + 1] * points[k + 1, 1]
        x = x - ((1.0 - share[i]) * points[j, 0] + share[i] * points[j + 1, 0])
        y = y - ((1.0 - share[i]) * points[j, 1] + share[i] * points[j + 1, 1])
        turn = np.arctan2(-x, y)
        if i > 0:
            turn = turn - 2.0 * np.pi * np.round((turn - before) / (2.0 * np.pi))
        out[i] = turn - before
        before = turn
