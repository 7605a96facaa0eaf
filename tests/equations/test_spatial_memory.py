"""Hysteresis of joints in space: the plane's law in any direction, circles against closed forms, energy, rotation."""

from itertools import pairwise

import numpy as np
import pytest
from test_memory import ALL, blank, follow, law

import pliant
from pliant.equations import memory as planar
from pliant.equations import spatial, spatial_memory
from pliant.equations.memory import memory_stored
from pliant.equations.spatial_memory import disagreement, remember, step_with_memory, write_lines, yielded
from pliant.equations.symbols import MemoryLaw, Past, SpatialHeld, SpatialJoints
from pliant.mechanics import mechanics_of
from pliant.model import Memory, Space
from pliant.simulation import state

LAW = Memory((0.1, 0.2), (0.05, 1.0), (0.5, 2.0), (0.005, 0.02), 0.3, 40.0, -20.0, 1.5)
BODY = {"length": 0.3, "mass": 0.1, "links": 3, "joint_placement": "midsegment", "stiffness": 0.5, "damping": 2e-3,
        "torque": (1e-6,), "tip_mass": 0.01}  # fmt: skip


def one_joint(memory, ratio=1.0, *, twist=False):
    """Springs and scratch arrays of one joint with K = 1, its swing as stiff about y as `ratio` says."""
    m = 3 if twist else 2
    K, line = np.array([1.0, ratio, 0.7][:m]), np.zeros((m, 3))
    joints = SpatialJoints(0.0, np.zeros(m), K, np.zeros(m), np.zeros((3, m)), np.zeros(1), line, np.zeros((1, 0)))
    return joints, Past(memory, blank(memory, m), SpatialHeld(np.zeros(m), np.zeros(m), np.zeros(m), line, joints))


def led(joints, past, path, h=1e-3):
    """Mean r (steps, m) over each step of a joint led along `path` (steps + 1, m), and the loss of each step."""
    rows, lost = [], []
    for x, end in pairwise(path):
        past.held.x[:], past.held.dq[:] = x, end - x
        write_lines(h, joints, past)
        middle, line = 0.5 * (x + end), past.held.line
        other = middle[[1, 0, *range(2, middle.size)]]
        rows.append(line[:, 0] + line[:, 1] * middle + line[:, 2] * other)
        lost.append(remember(h, joints, past))
    return np.array(rows), np.array(lost)


def stored(joints, past, q):
    return sum(joints.K[i] * memory_stored(i, q[i], past.state, past.memory) for i in range(len(q)))


@pytest.mark.parametrize("azimuth", [0.0, 0.4, 1.9])
@pytest.mark.parametrize("ratio", [1.0, 2.5])
def test_a_bend_in_any_direction_has_the_law_of_the_plane(rng, azimuth, ratio):
    path = np.concatenate([[0.0], np.cumsum(rng.normal(0, 0.02, 200))])
    along = np.array([np.cos(azimuth), np.sin(azimuth) / np.sqrt(ratio)])
    joints, past = one_joint(ALL, ratio)
    r, lost = led(joints, past, path[:, None] * along)
    expected, loss, _ = follow(ALL, path)
    assert r == pytest.approx(expected[:, None] * along, rel=1e-12, abs=1e-14)
    assert lost == pytest.approx(loss, rel=1e-12, abs=1e-16)


@pytest.mark.parametrize("ratio", [1.0, 2.5])
@pytest.mark.parametrize(("memory", "limit", "share"), [
    (law(slip=[(0.7, 0.04)]), 0.04, 0.7), (law(boucwen=(0.5, 20.0, 5.0, 1.0)), 0.04, 0.5),
    (law(boucwen=(0.5, 400.0, -100.0, 2.0)), 300.0**-0.5, 0.5),
])  # fmt: skip
def test_a_circle_loses_what_the_closed_form_says(memory, limit, share, ratio):
    """A stretch of the size L dragged round a circle of radius X trails it by psi, sin psi = L / X: each turn loses
    2 pi K share L sqrt(X^2 - L^2). Slip elements return to their limit at the end of each step: first order."""
    radius, steps = 0.1, 800
    angle = np.linspace(0.0, 8 * np.pi, 4 * steps + 1)
    path = radius * np.stack([np.cos(angle), np.sin(angle) / np.sqrt(ratio)], axis=1)
    joints, past = one_joint(memory, ratio)
    r, lost = led(joints, past, path - path[0])
    work = np.sum(joints.K * r * np.diff(path, axis=0), axis=1)
    expected = 2 * np.pi * share * limit * np.sqrt(radius**2 - limit**2)
    close = 1e-4 if memory.boucwen_share else 3e-3
    assert lost[-steps:].sum() == pytest.approx(expected, rel=close)
    assert work[-steps:].sum() == pytest.approx(expected, rel=close)


@pytest.mark.parametrize("h", [1e-4, 1e-2, 10.0])
def test_every_step_accounts_for_its_energy(rng, h):
    """Work = rise of what is stored + loss, the loss never negative, and no stretch beyond its limit."""
    turns = rng.normal(0, 0.03, (300, 3)) * rng.choice([1e-4, 1.0, 5.0], (300, 1))
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(turns, axis=0)])
    joints, past = one_joint(ALL, 1.7, twist=True)
    total = before = 0.0
    for k in range(300):
        r, lost = led(joints, past, path[k : k + 2], h)
        work, now = np.sum(joints.K * r * turns[k]), stored(joints, past, path[k + 1])
        assert work == pytest.approx(now - before + lost[0], abs=1e-13)
        assert lost[0] >= 0.0
        total, before = total + work, now
        assert total >= 0.0  # nothing was stored at first: no way gives energy
        slip = past.state[:, 2:4]
        assert (np.sqrt(slip[0] ** 2 + 1.7 * slip[1] ** 2) <= ALL.slip_angle * (1 + 1e-12)).all()
        assert (np.abs(slip[2]) <= ALL.slip_angle * (1 + 1e-12)).all()


def test_lines_are_tangents_of_what_the_branches_deliver(rng):
    """Slopes by differences of the mean r of a step; symmetric once each has its stiffness."""
    joints, past = one_joint(law(slip=[(0.7, 0.04), (0.2, 0.5)]), 1.7)
    past.state[:] = rng.normal(0, 0.01, past.state.shape)
    x, dq = rng.normal(0, 0.1, 2), np.array([0.05, -0.07])

    def mean(turn):
        rows, _ = led(joints, Past(past.memory, past.state.copy(), past.held), np.stack([x, x + turn]))
        return rows[0]

    mean(dq)
    line = past.held.line.copy()
    slope = np.array([(mean(dq + e) - mean(dq - e)) / 1e-6 for e in np.eye(2) * 1e-6]).T
    assert slope == pytest.approx(np.array([[line[0, 1], line[0, 2]], [line[1, 2], line[1, 1]]]), abs=1e-8)
    assert line[0, 2] * joints.K[0] == pytest.approx(line[1, 2] * joints.K[1], rel=1e-12)
    assert abs(line[0, 2]) > 0.01
    assert yielded(0.03, 0.0, 1.7, 0.04) == (1.0, 0.0, 0.0)


def chain_in_space(memory=LAW, **space):
    return pliant.chain_model(**BODY, gravity=(0.0, 0.0, -9.81), space=Space(**space), memory=memory)


def marched(model, torques, h=2e-3, kernel=step_with_memory, kind=float, law_of=None):
    """Coordinates after each step of a chain from rest under torques (steps, N)."""
    chain = mechanics_of(model)
    parts = chain.body, chain.joints, chain.workspace(kind)
    memory = law_of or model.memory.law()
    start = np.zeros(model.size)
    held = chain.held()
    if kind is complex:
        rows = [a.astype(complex) for a in held[:4]]
        held = SpatialHeld(*rows, held.springs._replace(line=rows[3], theta0=np.zeros(model.size, complex)))
    past = Past(memory, state.relaxed(model, start).astype(kind), held)
    x, v = chain.coordinates(start).astype(kind), start.astype(kind)
    rows = []
    for torque in torques:
        assert kernel(x, v, h, torque, *parts[:2], past, parts[2]).real >= 0.0
        rows.append(x.copy())
    return np.array(rows), past


def test_a_motion_in_one_plane_is_that_of_the_planar_chain(rng):
    push = np.repeat(0.2 * rng.normal(0, 1, (4, 3)), 8, axis=0)
    both = np.zeros((32, 6))
    both[:, ::2] = push
    plane = pliant.chain_model(**BODY, gravity=(0.0, -9.81), memory=LAW)
    expected, before = marched(plane, push, kernel=planar.step_with_memory)
    x, past = marched(chain_in_space(), both)
    assert np.cumsum(x[:, ::2], axis=1) == pytest.approx(expected, abs=1e-13)
    assert not x[:, 1::2].any()
    assert past.state[::2] == pytest.approx(before.state, abs=1e-13)
    assert np.abs(before.state[:, 2]).max() == LAW.slip_angle[0]  # it slipped


def test_a_base_turned_about_its_axis_moves_the_same_way_turned(rng):
    torques = np.repeat(0.1 * rng.normal(0, 1, (5, 6)), 6, axis=0)
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.kron(np.eye(3), [[c, -s], [s, c]])
    x, past = marched(chain_in_space(), torques)
    turned, other = marched(chain_in_space(), torques @ turn.T)
    assert turned == pytest.approx(x @ turn.T, abs=1e-10)
    assert other.state == pytest.approx(turn @ past.state, abs=1e-10)
    assert np.hypot(*past.state[:2, 2]) == pytest.approx(LAW.slip_angle[0])


def test_branches_that_hold_nothing_change_no_bit(rng):
    torques = 0.2 * rng.normal(0, 1, (6, 6))
    x, _ = marched(chain_in_space(Memory((0.0,), (1.0,), (0.0,), (0.1,))), torques)
    model = chain_in_space(Memory())
    chain = mechanics_of(model)
    now, v = np.zeros(6), np.zeros(6)
    for row, torque in zip(x, torques, strict=True):
        spatial.step(now, v, 2e-3, torque, *chain.parts())
        assert np.array_equal(row, now)


def test_an_agreement_is_found_for_strong_branches(rng):
    """Newton's method and, where that cycles, half-way moves; disagreement in the end is below what is asked for."""
    strong = Memory(slip_share=(3.0, 2.0, 5.0), slip_angle=(0.004, 0.05, 0.001), boucwen_share=2.0)
    torques = np.repeat(0.2 * rng.normal(0, [*[1.0] * 6, *[0.1] * 3], (4, 9)), 6, axis=0)
    model = chain_in_space(strong, twist_ratio=0.7, stiffness_ratio=0.5, radius=0.02)
    _, past = marched(model, torques)
    size = np.sqrt(past.state[0:6:2, :3] ** 2 + 0.5 * past.state[1:6:2, :3] ** 2)
    limit = np.array(strong.slip_angle)
    assert (size <= limit * (1 + 1e-12)).all()
    assert (size[:, [0, 2]] > 0.999 * limit[[0, 2]]).any(axis=0).all()


def test_what_is_no_number_finds_no_agreement():
    model = chain_in_space()
    chain = mechanics_of(model)
    parts, past = chain.parts(), Past(LAW.law(), state.relaxed(model, np.zeros(6)), chain.held())
    assert step_with_memory(np.zeros(6), np.zeros(6), 1e-3, np.full(6, np.nan), *parts[:2], past, parts[2]) == -1.0
    assert np.isnan(disagreement(np.full(6, np.nan), 1e-3, parts[1], past, parts[2], calm=False))


def test_derivatives_pass_through_the_step(rng):
    """By complex step: of steps with creep, sticking and slipping elements and Bouc-Wen, by every number of the law."""
    torques = np.repeat(rng.normal(0, [*[0.2] * 6, *[0.02] * 3], (2, 9)), 2, axis=0)
    model, numbers = chain_in_space(twist_ratio=0.7, stiffness_ratio=1.3, radius=0.02), LAW.law()

    def end(values, kind=float):
        memory = MemoryLaw(*(np.asarray(v).astype(kind)[()] for v in values))
        return marched(model, torques, kind=kind, law_of=memory)[0][-1]

    for name in MemoryLaw._fields:
        value = np.asarray(getattr(numbers, name), dtype=float)
        slope = end(numbers._replace(**{name: value + 1e-20j * value}), complex).imag / 1e-20
        around = [end(numbers._replace(**{name: (value * (1 + e))[()]})) for e in (-1e-6, 1e-6)]
        difference = (around[1] - around[0]) / 2e-6
        assert slope == pytest.approx(difference, rel=1e-4, abs=1e-5 * np.abs(difference).max()), name
        assert np.abs(difference).max() > 1e-9, name


def test_creep_rests_where_the_chain_is():
    past = Past(LAW.law(), np.ones((6, 5)), None)
    spatial_memory.relax(np.arange(6.0), None, past)
    assert np.array_equal(past.state[:, :2], np.repeat(np.arange(6.0)[:, None], 2, axis=1))
    assert (past.state[:, 2:] == 1.0).all()
