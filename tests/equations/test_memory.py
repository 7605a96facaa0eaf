"""Creep, slip and Bouc-Wen: closed loop areas, return points, energy at every step; no memory, no difference."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from oracles.chains import SIZES, paper_chain, random_chain, random_state, workspace
from scipy.integrate import quad, solve_ivp

from pliant.compiler.choose import twin
from pliant.equations.memory import (
    agreement,
    boucwen_decay,
    creep_lines,
    friction_line,
    friction_lines,
    hold_start,
    memory_angle,
    memory_stored,
    remember,
    size,
    step_with_memory,
    stretched,
)
from pliant.equations.motion import step
from pliant.equations.symbols import Held, Joints, MemoryLaw, Past

TORQUE = 0.08


def law(creep=(), slip=(), boucwen=(0.0, 30.0, 20.0, 1.0)):
    """A memory of (share, time) and (share, angle) pairs and Bouc-Wen numbers."""
    rows = [np.array([pair[k] for pair in pairs], dtype=float) for pairs in (creep, slip) for k in (0, 1)]
    return MemoryLaw(*rows, *map(float, boucwen))


def blank(memory, n=1, kind=float):
    return np.zeros((n, len(memory.creep_share) + len(memory.slip_share) + 1), kind)


def scratch(joints):
    n = len(joints.K)
    K, theta0 = joints.K.copy(), joints.theta0.copy()
    return Held(*(np.zeros(n, K.dtype) for _ in range(8)), K, theta0, joints._replace(theta0=theta0, K=K))


def follow(memory, path, h=1e-3, state=None):
    """r over each step, states after it, and loss of each step, of one joint of K = 1 led along `path`."""
    state = blank(memory) if state is None else state
    one, rows = np.ones(1), []
    for a, b in pairwise(path):
        slope, offset, q, dq = np.zeros(1), np.zeros(1), np.array([a]), np.array([b - a])
        creep_lines(q, h, state, memory, slope, offset)
        friction_lines(q, dq, state, memory, slope, offset)
        r = slope[0] * (q[0] + 0.5 * dq[0]) + offset[0]
        lost = remember(q, dq, h, one, state, memory)
        rows.append((r, lost, state.copy()))
    r, lost, states = zip(*rows, strict=True)
    return np.array(r), np.array(lost), np.array(states)


def turning(*corners, steps=400):
    """Angles that run straight from corner to corner."""
    parts = [np.linspace(a, b, steps + 1)[1:] for a, b in pairwise(corners)]
    return np.concatenate([[corners[0]], *parts])


@pytest.mark.parametrize("amplitude", [0.02, 0.05, 0.1])
def test_one_slip_element_closes_the_loop_of_its_formula(amplitude):
    """Area 4 f (X - x) with f = share x; nothing below the angle at which it slips."""
    share, limit = 0.7, 0.04
    path = turning(0.0, amplitude, -amplitude, amplitude)
    r, lost, _ = follow(law(slip=[(share, limit)]), path)
    cycle = slice(400, None)
    area = (r * np.diff(path))[cycle].sum()
    assert area == pytest.approx(4 * share * limit * max(amplitude - limit, 0.0), abs=1e-15)
    assert lost[cycle].sum() == pytest.approx(area, abs=1e-15)


@pytest.mark.parametrize(("frequency", "time"), [
    (0.2, 1.0), (2.0, 0.1), pytest.param(5.0, 3.0, marks=pytest.mark.slow),
])
def test_a_creep_branch_closes_the_loop_of_its_formula(frequency, time):
    """pi X^2 K w tau / (1 + w^2 tau^2) once the start has died out, to the square of the step."""
    share, amplitude, w = 0.4, 0.1, 2 * np.pi * frequency
    expected = np.pi * amplitude**2 * share * w * time / (1 + (w * time) ** 2)
    errors = []
    for per_cycle in (200, 400):
        cycles = int(np.ceil(1 + 22 * time * frequency))
        t = np.arange(cycles * per_cycle + 1) / (per_cycle * frequency)
        path = amplitude * np.sin(w * t)
        r, lost, _ = follow(law(creep=[(share, time)]), path, t[1])
        last = slice(-per_cycle, None)
        area = (r * np.diff(path))[last].sum()
        assert lost[last].sum() == pytest.approx(area, rel=1e-6)
        errors.append(abs(area / expected - 1))
    assert errors[1] < 3e-4
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("numbers", [(1.0, 30.0, 20.0, 1.0), (0.5, 30.0, -25.0, 1.0), (0.8, 2e3, 1e3, 2.0)])
def test_bouc_wen_against_quadrature(numbers):
    """From -z0 to z0 and back: the angle to any z is the integral of dz / (1 - (beta +- gamma) |z|^n)."""
    share, beta, gamma, n = numbers
    limit = (1 / (beta + gamma)) ** (1 / n)
    reach = 0.9 * limit
    up, _ = quad(lambda z: 1 / (1 - (beta + gamma) * z**n), 0, reach)
    down, _ = quad(lambda z: 1 / (1 + (beta - gamma) * z**n), 0, reach)
    _, _, states = follow(law(boucwen=numbers), turning(0.0, up, up - down, steps=4000))
    assert states[3999, 0, 0] == pytest.approx(reach, rel=1e-6)
    assert states[-1, 0, 0] == pytest.approx(0.0, abs=1e-6 * limit)
    far = turning(0.0, *([8 * limit, -8 * limit] * 3), steps=4000)
    r, lost, states = follow(law(boucwen=numbers), far)
    assert np.abs(states).max() <= limit * (1 + 1e-12)

    def back(_, y):  # along the way back, with the work done on the branch
        z = y[0]
        return [-1.0 - beta * abs(z) ** (n - 1) * z + gamma * abs(z) ** n, -share * z]

    top = states[3999, 0, 0]
    assert top == pytest.approx(limit, rel=1e-3)
    work = solve_ivp(back, (0, 16 * limit), [top, 0.0], "DOP853", rtol=1e-10, atol=1e-14).y[1, -1]
    assert (r * np.diff(far))[4000:8000].sum() == pytest.approx(work, rel=1e-5)
    assert lost.min() >= 0.0


def test_slip_elements_return_to_the_point_that_they_left():
    """Return-point memory: a small loop inside a large one leaves no trace."""
    memory = law(slip=[(0.3, 0.01), (0.2, 0.03), (0.1, 0.08)])
    outer = turning(0.0, 0.1, -0.06, 0.02)
    _, _, before = follow(memory, outer)
    _, _, after = follow(memory, np.concatenate([outer, turning(0.02, -0.03, 0.015, -0.02, 0.02)[1:]]))
    assert after[-1] == pytest.approx(before[-1], abs=1e-15)


def test_a_branch_after_a_turn_is_the_first_one_twice_as_large():
    """Masing's rule: from the turn at X on, r(X) - r falls as twice the first loading at half the way."""
    memory = law(slip=[(0.3, 0.01), (0.2, 0.03), (0.1, 0.08)])
    state = blank(memory)
    follow(memory, turning(0.0, 0.1), state=state)
    top = memory_angle(0, 0.1, state, memory)
    for way in np.linspace(0.0, 0.2, 41):
        down, fresh = state.copy(), blank(memory)
        follow(memory, turning(0.1, 0.1 - way), state=down)
        follow(memory, turning(0.0, way / 2), state=fresh)
        first = memory_angle(0, way / 2, fresh, memory)
        assert top - memory_angle(0, 0.1 - way, down, memory) == pytest.approx(2 * first, abs=1e-14)


ALL = law([(0.4, 0.05), (0.2, 2.0)], [(0.3, 0.01), (0.5, 0.1)], (0.6, 40.0, -35.0, 1.7))


@pytest.mark.parametrize("h", [1e-4, 1e-2, 10.0])
def test_every_step_accounts_for_its_energy(rng, h):
    """r dq = rise of what is stored + what is lost, and the loss is never negative, whatever the turns."""
    path = np.concatenate([[0.0], np.cumsum(rng.normal(0, 0.03, 600) * rng.choice([1e-4, 1.0, 5.0], 600))])
    r, lost, states = follow(ALL, path, h)
    stored = [0.0, *(memory_stored(0, q, s, ALL) for q, s in zip(path[1:], states, strict=True))]
    assert r * np.diff(path) == pytest.approx(np.diff(stored) + lost, abs=1e-13 * max(stored))
    assert lost.min() >= 0.0
    assert np.sum(r * np.diff(path)) > -stored[0]


def test_stretch_and_line_of_one_element():
    assert stretched(0.02, 0.01, 0.05) == pytest.approx(0.03)
    assert stretched(0.02, 0.1, 0.05) == 0.05
    assert stretched(0.02, -0.1, 0.05) == -0.05
    assert friction_line(0.02, 0.3, 0.01, 2.0, 0.05) == (2.0, pytest.approx(2.0 * (0.02 - 0.3)))
    assert friction_line(0.02, 0.3, 0.1, 2.0, 0.05) == (0.0, pytest.approx(0.07))
    assert friction_line(0.02, 0.3, -0.1, 2.0, 0.05) == (0.0, pytest.approx(-0.03))


def test_decay_solves_its_equation(rng):
    """z_m (1 + x) = z + dq/2 with x from z_m itself; on complex numbers the derivative follows."""
    for n in (1.0, 1.5, 3.0):
        memory = law(boucwen=(1.0, 50.0, -30.0, n))
        for z, dq in rng.normal(0, 0.3, (50, 2)):
            x = boucwen_decay(z, dq, memory)
            middle = (z + dq / 2) / (1 + x)
            rate = 50.0 - 30.0 * np.sign(dq * middle)
            assert x == pytest.approx(0.5 * abs(dq) * rate * abs(middle) ** (n - 1), rel=1e-12)
            slope = boucwen_decay(z, dq + 1e-20j, memory).imag / 1e-20
            around = [boucwen_decay(z, dq * (1 + e), memory) for e in (-1e-6, 1e-6)]
            assert slope == pytest.approx((around[1] - around[0]) / (2e-6 * dq), rel=1e-5)
    assert (size(-2.0), size(3.0), size(-2.0 + 1j)) == (2.0, 3.0, 2.0 - 1j)


def states_after(kernel, chain, memory, phi, w, h, count, state=None, torque=TORQUE):
    phi, w, joints = phi.copy(), w.copy(), chain.joints()
    state = blank(memory, chain.n) if state is None else state
    args = (chain.body(), joints, Past(memory, state, scratch(joints)), workspace(chain.n))
    lost = [kernel(phi, w, h, chain.drive(torque), *args) for _ in range(count)]
    return phi, w, state, np.array(lost)


@pytest.mark.parametrize("n", SIZES)
def test_no_memory_is_the_plain_step_bit_for_bit(rng, n):
    chain, (q, dq) = random_chain(rng, n), random_state(rng, n)
    phi, w = chain.phi(q), np.cumsum(dq)
    for memory in (law(), law([(0.0, 1.0)], [(0.0, 0.01)])):
        found = states_after(step_with_memory, chain, memory, phi, w, 1e-3, 5)
        plain = phi.copy(), w.copy()
        for _ in range(5):
            step(*plain, 1e-3, chain.drive(TORQUE), chain.body(), chain.joints(), workspace(n))
        assert np.array_equal(found[0], plain[0])
        assert np.array_equal(found[1], plain[1])
        assert not found[3].any()


@pytest.mark.parametrize("n", [1, 3, 8])
@pytest.mark.parametrize("h", [1e-4, 1e-3, 4e-3])
def test_the_step_takes_what_the_branches_deliver(rng, n, h):
    """Strong random branches on random fast chains: an agreement is always found, and the loss is never negative."""
    kernel, taken = twin(step_with_memory), 0
    for _ in range(40):
        chain, (q, dq) = random_chain(rng, n), random_state(rng, n)
        pairs = [list(zip(rng.uniform(0, 5, 4), 10 ** rng.uniform(-4, 0, 4), strict=True)) for _ in range(2)]
        beta = 10 ** rng.uniform(0, 3)
        memory = law(*pairs, (rng.choice([0.0, 3.0]), beta, rng.uniform(-1, 1) * beta, rng.choice([1.0, 1.5, 2.0])))
        phi, w, state = chain.phi(q), 0.2 * np.cumsum(dq), None
        for _ in range(60):
            phi, w, state, lost = states_after(kernel, chain, memory, phi, w, h, 1, state)
            if np.abs(w).max() * h > 1.0:  # too fast for this step, with or without memory
                break
            assert lost[0] >= 0.0
            assert (np.abs(state[:, 4:8]) <= memory.slip_angle).all()
            taken += 1
    assert taken > 100


def test_one_link_keeps_account_of_all_its_energy():
    """One link has no configuration in its inertia: kinetic + elastic + stored = work - losses to the last digits."""
    chain = paper_chain(n=1, D=np.zeros(1))
    phi, w, state, joints = np.array([0.3]), np.array([2.0]), blank(ALL), chain.joints()
    state[0, :2] = 0.3
    held, work, lost, before, totals = scratch(joints), workspace(1), 0.0, phi[0], []
    supplied = 0.0
    inertia = chain.body().B[0, 0] + chain.body().I[0]
    for _ in range(3000):
        lost += step_with_memory(phi, w, 1e-3, np.full(1, TORQUE), chain.body(), joints, Past(ALL, state, held), work)
        supplied += TORQUE * (phi[0] - before)
        before = phi[0]
        spring = 0.5 * joints.K[0] * phi[0] ** 2 + joints.K[0] * memory_stored(0, phi[0], state, ALL)
        totals.append(0.5 * inertia * w[0] ** 2 + spring + lost - supplied)
    assert np.ptp(totals) < 1e-10 * max(totals)


@pytest.mark.parametrize("memory", [law([(0.4, 0.05), (0.2, 2.0)]), law(boucwen=(0.6, 20.0, 10.0, 1.0))])
def test_second_order_against_an_adaptive_solver(memory):
    """The states of creep or Bouc-Wen as equations of their own beside the joint's, by DOP853."""
    chain = paper_chain(n=1)
    I, K, D = chain.body().B[0, 0], chain.K[0], chain.D[0]
    P = len(memory.creep_share)

    def rate(_, y):
        q, w, xi, z = y[0], y[1], y[2 : 2 + P], y[-1]
        pull = memory.creep_share @ (q - xi) + memory.boucwen_share * z
        dz = w - memory.boucwen_beta * abs(w) * z - memory.boucwen_gamma * w * abs(z)
        return np.concatenate([[w, (TORQUE - K * (q + pull) - D * w) / I], (q - xi) / memory.creep_time, [dz]])

    end = 0.04
    exact = solve_ivp(rate, (0, end), np.zeros(3 + P), "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    steps = np.array([50, 100, 200, 400])
    found = [states_after(step_with_memory, chain, memory, np.zeros(1), np.zeros(1), end / k, k) for k in steps]
    errors = [abs(phi[0] - exact[0]) for phi, *_ in found]
    assert -np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.15), errors


def test_slip_turns_back_where_the_formula_says():
    """A link that must overcome one rigid-plastic element settles within the band that friction leaves."""
    chain, share, limit = paper_chain(n=1), 0.5, 0.02
    memory = law(slip=[(share, limit)])
    phi, w, state, _ = states_after(twin(step_with_memory), chain, memory, np.zeros(1), np.zeros(1), 1e-3, 4000)
    assert abs(w[0]) < 1e-3
    assert phi[0] + share * state[0, 0] == pytest.approx(TORQUE / chain.K[0], rel=1e-3)
    assert abs(phi[0] - TORQUE / chain.K[0]) <= share * limit * (1 + 1e-4)


def test_twin_is_the_plain_text(rng):
    chain, (q, dq) = random_chain(rng, 4), random_state(rng, 4)
    plain = states_after(step_with_memory, chain, ALL, chain.phi(q), np.cumsum(dq), 1e-3, 30)
    compiled = states_after(twin(step_with_memory), chain, ALL, chain.phi(q), np.cumsum(dq), 1e-3, 30)
    for a, b in zip(plain, compiled, strict=True):
        assert b == pytest.approx(a, rel=1e-8, abs=1e-12)


def test_derivatives_pass_through_the_step(rng):
    """By complex step: of ten steps with creep, sticking and slipping elements and Bouc-Wen, by the shares."""
    chain, (q, dq) = random_chain(rng, 3), random_state(rng, 3)
    phi, w = chain.phi(q), 0.3 * np.cumsum(dq)

    def moved(memory, kind=float):
        joints = Joints(*(np.asarray(a).astype(kind)[()] for a in chain.joints()))
        body = type(chain.body())(*(np.asarray(v).astype(kind)[()] for v in chain.body()))
        memory = MemoryLaw(*(np.asarray(v).astype(kind)[()] for v in memory))
        p, v = phi.astype(kind), w.astype(kind)
        args = (body, joints, Past(memory, blank(memory, 3, kind), scratch(joints)), workspace(3, kind))
        for _ in range(10):
            step_with_memory(p, v, 1e-3, chain.drive(TORQUE), *args)
        return p

    for name in ("creep_share", "creep_time", "slip_share", "slip_angle", "boucwen_share", "boucwen_beta"):
        value = np.asarray(getattr(ALL, name), dtype=float)
        slope = moved(ALL._replace(**{name: value + 1e-20j * value}), complex).imag / 1e-20
        around = [moved(ALL._replace(**{name: (value * (1 + e))[()]})) for e in (-1e-6, 1e-6)]
        assert slope == pytest.approx((around[1] - around[0]) / 2e-6, rel=1e-4, abs=1e-9), name


def test_a_disagreement_is_told_and_leaves_the_chain_where_it_was():
    """With the turns of the guess taken for those made, the difference is what the elements would deliver otherwise."""
    chain, memory = paper_chain(n=2), law(slip=[(1.0, 0.01)])
    joints, work, state = chain.joints(), workspace(2), blank(law(slip=[(1.0, 0.01)]), 2)
    held, phi, w = scratch(joints), np.array([0.1, 0.3]), np.array([1.0, -2.0])
    hold_start(phi, w, 1e-3, joints, held)
    assert held.q == pytest.approx([0.1, 0.2])
    assert held.dq == pytest.approx([1e-3, -3e-3])
    held.slope[:] = held.offset[:] = 0.0  # as if the elements were not there
    assert agreement(w, 1e-3, Past(memory, state, held), work, calm=False) == pytest.approx(0.5 * 3e-3)
