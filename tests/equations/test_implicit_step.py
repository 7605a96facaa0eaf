"""`motion.step`: the rule that it says it is, its order, its stability, its energy, and its agreement with others."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from oracles.chains import PAPER_GAIN, SIZES, paper_chain, random_chain, random_state, workspace
from oracles.derivatives import complex_step
from scipy.integrate import solve_ivp

from pliant import basic
from pliant.compiler.choose import twin
from pliant.compiler.twin import rebuild
from pliant.equations.chain import tips
from pliant.equations.energy import elastic_energy, gravity_energy, kinetic_energy
from pliant.equations.motion import acceleration, centrifugal, step

TORQUE = 119e3 * PAPER_GAIN


def run(chain, phi, w, h, steps, torque=TORQUE):
    """Trajectory (steps + 1, 2, n) of the compiled step."""
    phi, w, args = phi.copy(), w.copy(), (chain.body(), chain.joints(), workspace(chain.n))
    compiled, out = twin(step), np.empty((steps + 1, 2, chain.n))
    out[0] = phi, w
    for k in range(steps):
        compiled(phi, w, h, chain.drive(torque), *args)
        out[k + 1] = phi, w
    return out


def right_hand_side(chain, torque=TORQUE):
    args = (chain.drive(torque), chain.body(), chain.joints(), workspace(chain.n))
    compiled, n = twin(acceleration), chain.n

    def rate(_, x):
        a = np.empty(n)
        compiled(x[:n], x[n:], *args, a)
        return np.concatenate([x[n:], a])

    return rate


def reference(chain, phi, w, times, torque=TORQUE, method="DOP853"):
    run = solve_ivp(
        right_hand_side(chain, torque), (0, times[-1]), np.r_[phi, w], method, times, rtol=3e-13, atol=1e-14
    )
    return run.y.T.reshape(len(times), 2, chain.n)


def tip(chain, phi):
    p = np.zeros((chain.n, 2))
    tips(phi, chain.l, 0.0, 0.0, p)
    return p[-1]


def energy(chain, phi, w):
    c, s, body = np.cos(phi), np.sin(phi), chain.body()
    stored = elastic_energy(phi, chain.joints()) + gravity_energy(c, s, body)
    return kinetic_energy(c, s, w, body) + stored


@pytest.mark.parametrize("n", SIZES)
@pytest.mark.parametrize("h", [1e-4, 3e-3, 0.1])
def test_the_rule_written_out_in_joint_angles(rng, n, h):
    """Both solves, with M, C and gravity of the readable twin: a change of coordinates must change nothing."""
    chain, (q, dq) = random_chain(rng, n), random_state(rng, n)
    actuator = chain.actuator()
    middle = q + h / 2 * dq
    slope = complex_step(lambda at: -basic.gravity(at, actuator), middle)
    A = basic.inertia(middle, actuator) + h / 2 * np.diag(chain.D) + h * h / 4 * (np.diag(chain.K) + slope)
    held = chain.gain * TORQUE - chain.K * middle - chain.D * dq + basic.gravity(middle, actuator)
    change = np.zeros(n)
    for _ in range(2):
        rate = dq + change / 2
        change = np.linalg.solve(A, h * (held - basic.coriolis(middle, rate, actuator) @ rate))
    phi, w = chain.phi(q), np.cumsum(dq)
    step(phi, w, h, chain.drive(TORQUE), chain.body(), chain.joints(), workspace(n))
    scale = np.abs(change).max()
    assert np.diff(w, prepend=0.0) == pytest.approx(dq + change, abs=1e-9 * scale)
    assert phi == pytest.approx(chain.phi(q + h * (dq + change / 2)), abs=1e-9 * h * scale + 1e-13)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_second_order_on_a_fast_unequal_chain_under_gravity(rng, n):
    chain = random_chain(rng, n)._replace(K=np.full(n, 1.0), D=np.full(n, 2e-3))
    q, dq = random_state(rng, n)
    phi, w, end = chain.phi(q), 2 * np.cumsum(dq), 0.05
    expected = reference(chain, phi, w, [end])[0]
    steps = np.array([200, 400, 800, 1600])
    errors = [np.abs(run(chain, phi, w, end / k, k)[-1] - expected)[0].max() for k in steps]
    order = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order == pytest.approx(2.0, abs=0.1), errors


def test_without_the_second_solve_it_would_be_first_order(rng):
    """The test above can fail: the centrifugal force at the old rate alone leaves an error that falls as h."""
    chain = random_chain(rng, 2)._replace(K=np.full(2, 1.0), D=np.full(2, 2e-3))
    q, dq = random_state(rng, 2)
    args = (chain.body(), chain.joints(), workspace(2))
    old: list[np.ndarray] = []

    def at_old_rate(S, square, r, a):
        if old:  # the second solve, which would take the mean rate
            centrifugal(S, old.pop(), r, a)
        else:
            old.append(square.copy())
            centrifugal(S, square, r, a)

    first_order = rebuild(step, lambda f: f, {"centrifugal": at_old_rate})
    start, end, errors = (chain.phi(q), 2 * np.cumsum(dq)), 0.05, []
    expected = reference(chain, *start, [end])[0]
    for k in (200, 800):
        phi, w = start[0].copy(), start[1].copy()
        for _ in range(k):
            first_order(phi, w, end / k, chain.drive(TORQUE), *args)
        errors.append(np.abs(phi - expected[0]).max())
    assert np.log(errors[0] / errors[1]) / np.log(4) == pytest.approx(1.0, abs=0.2)


@cache
def step_response(mass):
    """One second of the paper's actuator after the pressure rises, at 1 kHz."""
    return reference(paper_chain(mass), np.zeros(5), np.zeros(5), np.arange(1001) * 1e-3)


@pytest.mark.parametrize("mass", ["tip", "rod"])
@pytest.mark.parametrize(("h", "bound_mm"), [(1e-3, 0.012), (2e-3, 0.045), (4e-3, 0.17)])
def test_tip_error_on_the_papers_step(mass, h, bound_mm):
    chain, stride = paper_chain(mass), round(h / 1e-3)
    found = run(chain, np.zeros(5), np.zeros(5), h, 1000 // stride)[:, 0]
    expected = step_response(mass)[::stride, 0]
    error = [tip(chain, a)[0] - tip(chain, b)[0] for a, b in zip(found, expected, strict=True)]
    assert np.abs(error).max() * 1e3 < bound_mm


@pytest.mark.parametrize("mass", ["tip", "rod", "middle"])
@pytest.mark.parametrize("pressure", [119e3, 240e3])
@pytest.mark.parametrize("h", [1e-5, 1e-4, 1e-3, 4e-3, 0.01, 0.03, 0.1])
def test_stable_at_any_step(mass, pressure, h):
    """Never beyond twice the static bend (a spring suddenly loaded), and settled there or on the way."""
    chain, seconds = paper_chain(mass), max(0.2, min(10.0, 3e3 * h))
    torque = pressure * PAPER_GAIN
    found = run(chain, np.zeros(5), np.zeros(5), h, round(seconds / h), torque)
    bend = found[:, 0, -1] / (5 * torque / chain.K[0])
    assert np.isfinite(found).all()
    assert bend.max() < 2.0
    assert bend.min() > -0.5
    if seconds >= 3.0 and h <= 0.01:
        assert bend[-1] == pytest.approx(1.0, abs=2e-3)


def test_a_stiff_chain_at_a_long_step_dies_out():
    """Poles of -2.5e5 1/s at h = 0.1 s; the trapezoidal rule reflects them, so the decay is slow but sure."""
    chain = paper_chain("middle")
    found = run(chain, np.full(5, 0.1), np.zeros(5), 0.1, 3000, 0.0)[:, 0]
    assert np.abs(found[-100:]).max() < 0.05 * np.abs(found[:100]).max()


def test_explicit_rk4_needs_a_step_below_its_limit():
    """Stable at 0.4 ms (mass at the tips) and 0.15 ms (rods), not at a tenth more than the limit: hence implicit."""
    for mass, stable, unstable in (("tip", 4.0e-4, 4.5e-4), ("rod", 1.5e-4, 1.6e-4)):
        rate, last = right_hand_side(paper_chain(mass)), []
        for h in (stable, unstable):
            x = np.zeros(10)
            with np.errstate(all="ignore"):
                for _ in range(600):
                    k1 = rate(0, x)
                    k2 = rate(0, x + h / 2 * k1)
                    k3 = rate(0, x + h / 2 * k2)
                    x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(0, x + h * k3))
            last.append(np.abs(x[5:]).max())
        assert last[0] < 30.0
        assert not last[1] < 30.0


@pytest.mark.parametrize("h", [1e-4, 1e-2, 1.0])
def test_one_undamped_link_keeps_its_energy_exactly(h):
    chain = paper_chain(n=1, D=np.zeros(1))
    found = run(chain, np.array([0.4]), np.array([3.0]), h, 2000, 0.0)
    energies = [energy(chain, *state) for state in found]
    assert np.ptp(energies) < 1e-11 * energies[0]


@pytest.mark.parametrize("h", [1e-4, 1e-2, 0.1])
def test_small_undamped_motion_keeps_its_energy(rng, h):
    chain = paper_chain("rod", D=np.zeros(5))
    found = run(chain, 1e-7 * rng.normal(size=5), np.zeros(5), h, 2000, 0.0)
    energies = [energy(chain, *state) for state in found]
    assert np.ptp(energies) < 1e-7 * energies[0]


def test_large_undamped_motion_drifts_at_least_with_the_square_of_the_step():
    chain = paper_chain("rod", D=np.zeros(5))
    start, drifts = (np.linspace(0.2, 0.8, 5), np.zeros(5)), []
    for h in (4e-4, 2e-4, 1e-4):
        energies = [energy(chain, *state) for state in run(chain, *start, h, round(0.5 / h), 0.0)]
        drifts.append(np.abs(np.array(energies) / energies[0] - 1).max())
    assert drifts[-1] < 1e-2
    assert np.log2(drifts[0] / drifts[2]) / 2 > 1.7, drifts


@pytest.mark.parametrize("h", [1e-4, 1e-3])
def test_damping_lets_the_stored_energy_only_fall(h):
    """Under constant pressure E - p V decreases: V = A d sum(q), so p V = torque sum(q)."""
    chain = paper_chain()
    found = run(chain, np.zeros(5), np.zeros(5), h, round(1.0 / h))
    left = np.array([energy(chain, *state) - TORQUE * state[0][-1] for state in found])
    assert np.diff(left).max() < 1e-12 * np.ptp(left)
    assert left[-1] == left.min()


def test_accurate_integration_keeps_the_energy(rng):
    """Not of the step but of the equations: without dampers the right-hand side conserves energy."""
    chain = random_chain(rng, 5)._replace(D=np.zeros(5))
    q, dq = random_state(rng, 5)
    found = reference(chain, chain.phi(q), np.cumsum(dq), np.linspace(0, 0.2, 20), 0.0)
    energies = [energy(chain, *state) for state in found]
    assert np.ptp(energies) < 1e-8 * np.abs(energies).max()


@pytest.mark.slow
def test_radau_and_the_step_meet_the_explicit_reference():
    """Radau by its own error control; the step by Richardson extrapolation of two step lengths."""
    chain, times = paper_chain(), [0.05, 0.1]
    expected = step_response("tip")[[50, 100], 0]
    radau = reference(chain, np.zeros(5), np.zeros(5), times, method="Radau")[:, 0]
    assert radau == pytest.approx(expected, abs=1e-10)
    coarse, fine = (run(chain, np.zeros(5), np.zeros(5), h, round(0.1 / h))[-1, 0] for h in (4e-5, 2e-5))
    assert (4 * fine - coarse) / 3 == pytest.approx(expected[1], abs=1e-8)


@pytest.mark.slow
def test_pulse_of_the_readable_twin():
    """The paper's pulse by pliant.basic (LSODA, the paper's recursion in spirit) and by the compiled step."""
    chain = paper_chain()
    times, angles = basic.pulse(basic.paper(), end=3.2, rtol=1e-4)
    h, phi, w, q, at = 2e-4, np.zeros(5), np.zeros(5), [np.zeros(5)], [0.0]
    for t0, t1, torque in ((0, 0.12, 0.0), (0.12, 2.88, TORQUE), (2.88, 3.2, 0.0)):
        found = run(chain, phi, w, h, round((t1 - t0) / h), torque)
        phi, w = found[-1]
        q.extend(np.diff(found[1:, 0], prepend=0.0))
        at.extend(t0 + h * np.arange(1, len(found)))
    for i in range(5):
        assert np.interp(times, at, np.array(q)[:, i]) == pytest.approx(angles[:, i], abs=1e-4)  # of 0.05 rad
