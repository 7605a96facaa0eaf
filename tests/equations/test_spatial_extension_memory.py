"""Hysteresis of segments that lengthen in space: closed forms, the plane's law, energy, derivatives of a step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant.equations import extension_memory, spatial_memory
from pliant.equations.spatial_extension_memory import (
    follow_all,
    relax_all,
    step_with_axial_memory,
    strain_disagreement,
)
from pliant.equations.symbols import AxialMemoryLaw, Past, SpatialHeld
from pliant.mechanics import mechanics_of
from pliant.model import Extension, Memory, Model, Space, chain_model
from pliant.simulation.state import equilibrium, memory_energy, modes, relaxed

SEGMENTS = (Extension(90.0, 2.0, 0.0, 0.1, "near"), Extension(120.0, 2.0, 0.1, None, "far"))
BODY = {"length": 0.2, "mass": 0.15, "links": 3, "joint_placement": "midsegment", "stiffness": 0.9, "damping": 2e-2,
        "torque": [2e-6], "extensions": SEGMENTS}  # fmt: skip
ALL = Memory(
    (0.1, 0.2), (0.3, 2.0), (0.4,), (0.01,), 0.2, 40.0, -20.0, 1.5,
    axial_creep_share=(0.3,), axial_creep_time=(0.2,), axial_slip_share=(0.2, 0.3), axial_slip_strain=(0.01, 0.03),
)
JOINTS = Memory((0.1, 0.2), (0.3, 2.0), (0.4,), (0.01,), 0.2, 40.0, -20.0, 1.5)


def arm(memory: Memory = ALL, gravity: tuple[float, ...] = (2.0, 0.3, 9.81), **more) -> Model:
    space = {name: more.pop(name) for name in ("twist_ratio", "stiffness_ratio", "radius") if name in more}
    return chain_model(**{**BODY, **more}, memory=memory, gravity=gravity, space=Space(**space))


def bar(memory: Memory, damping: float) -> Model:
    """A light straight bar, which lengthens under a force within milliseconds but for its hysteresis."""
    return Model(
        link_length=[0.1], link_mass=[1e-4], stiffness=1.0, damping=1e-3, memory=memory, torque=[1e-8], space=Space(),
        extensions=(Extension(100.0, damping),),
    )


def marched(model: Model, torques, h=2e-3, *, kernel=step_with_axial_memory, law=None, start=None, kind=float):
    """Coordinates (steps, N), states (steps, N, branches) and losses (steps,) of plain steps under torques (steps, N)
    from rest at `start`.
    """
    chain = mechanics_of(model)
    q = np.zeros(model.size) if start is None else start
    x, v = chain.coordinates(q).astype(kind), np.zeros(model.size, kind)
    held = chain.held()
    if kind is complex:
        rows = [a.astype(complex) for a in held[:4]]
        held = SpatialHeld(*rows, held.springs._replace(line=rows[3], theta0=np.zeros(model.size, complex)))
    past = Past(law or model.memory.law(), relaxed(model, q).astype(kind), held)
    body, joints, work = chain.body, chain.joints, chain.workspace(kind)
    rows, states, lost = [], [], []
    for step, torque in zip(np.broadcast_to(h, len(torques)), torques, strict=True):
        lost.append(kernel(x, v, step, torque, body, joints, past, work))
        assert lost[-1].real >= 0.0
        rows.append((x.copy(), v.copy()))
        states.append(past.state.copy())
    return np.array(rows), np.array(states), np.array(lost)


@pytest.mark.parametrize(("share", "time"), [(0.5, 0.4), (1.6, 8.0)])
def test_creep_under_a_force_is_that_of_a_standard_linear_solid(share: float, time: float) -> None:
    """Under a force F the strain jumps to F / (EA (1 + share)), then grows to F / EA in the time (1 + share) T. The
    shares include one whose slow part is larger than the fast one.
    """
    model = bar(Memory(axial_creep_share=(share,), axial_creep_time=(time,)), 0.05)
    h, push = np.full(400, 0.02 * time), np.zeros((400, 3))
    h[:40] = 1e-4  # until the damper rests
    push[:, 2] = 5.0 * 0.1  # 5 N along a segment of 0.1 m
    strain, t = marched(model, push, h)[0][:, 0, 2], np.cumsum(h)
    expected = 0.05 * (1.0 - share / (1.0 + share) * np.exp(-t / (time * (1.0 + share))))
    np.testing.assert_allclose(strain[39:], expected[39:], rtol=2e-3)
    assert strain[-1] > 0.04


@pytest.mark.parametrize(("limit", "left"), [(0.01, 0.3 * 0.01), (0.03, 0.3 * (0.041 - 0.03) / 1.3)])
def test_a_slip_element_leaves_a_set_after_the_first_load(limit: float, left: float) -> None:
    """Loaded to e_1 = F/EA - s y, unloaded to s y where the element slips back, else to s (e_1 - y) / (1 + s)."""
    model, push = bar(Memory(axial_slip_share=(0.3,), axial_slip_strain=(limit,)), 0.5), np.zeros((400, 3))
    push[:, 2] = 0.5 * np.interp(np.arange(400), [0, 80, 160, 240], [0.0, 1.0, 1.0, 0.0])
    strain = marched(model, push, 5e-3)[0][:, 0, 2]
    assert strain[159] == pytest.approx(0.05 - 0.3 * limit, rel=1e-3)
    assert strain[-1] == pytest.approx(left, rel=1e-3)


@pytest.mark.parametrize("push", [0.0, 0.1], ids=["straight", "bent"])
def test_a_motion_in_one_plane_is_that_of_the_planar_chain(rng: np.random.Generator, push: float) -> None:
    """A chain that hangs from its base: random axial forces, without and with random torques."""
    forces = np.repeat(np.hstack([push * rng.normal(0, 1, (5, 3)), rng.normal(0, 0.5, (5, 2))]), 8, axis=0)
    both = np.zeros((40, 8))
    both[:, [0, 2, 4, 6, 7]] = forces
    plane = chain_model(**BODY, gravity=(0.0, 9.81), memory=ALL)
    expected, before, lost = marched(plane, forces, kernel=extension_memory.step_with_axial_memory)
    found, states, loss = marched(arm(gravity=(0.0, 0.0, 9.81)), both)
    np.testing.assert_allclose(found[:, 0, 6:], expected[:, 0, 3:], rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.cumsum(found[:, 0, :6:2], axis=1), expected[:, 0, :3], rtol=0, atol=1e-12)
    np.testing.assert_allclose(states[:, [0, 2, 4, 6, 7]], before, rtol=0, atol=1e-12)
    np.testing.assert_allclose(loss, lost, rtol=1e-6, atol=1e-15)
    assert np.abs(before[:, 3:, 1]).max() == pytest.approx(0.01)  # a segment slipped


def test_no_cycle_of_any_forces_gives_energy(rng: np.random.Generator) -> None:
    """Work = rise of all energies + losses, within the error of the steps; the loss of no step is negative."""
    model = arm(twist_ratio=0.7, stiffness_ratio=1.4, radius=0.02, gravity=(0.0, 0.0, 0.0))
    chain = mechanics_of(model)
    worst = []
    for h in (2e-3, 1e-3):
        draw = np.random.default_rng(5).normal(0, [*[0.1] * 6, *[0.02] * 3, 0.5, 0.5], (3, 11))
        forces = np.repeat(np.vstack([draw, 0.0 * draw]), round(0.02 / h), axis=0)
        motion, states, lost = marched(model, forces, h)
        x, v = np.vstack([np.zeros((1, 11)), motion[:, 0]]), np.vstack([np.zeros((1, 11)), motion[:, 1]])
        mean = np.diff(x, axis=0) / h
        work = np.cumsum(np.sum(forces * np.diff(x, axis=0), axis=1))
        damped = np.cumsum(h * np.sum(chain.joints.D * mean**2, axis=1))
        stored = sum(np.asarray(e) for e in chain.energy(x[1:], v[1:])) + memory_energy(model, x[1:], states)
        gap = work - stored - damped - np.cumsum(lost)
        worst.append(np.abs(gap).max() / work.max())
        assert (stored + damped + np.cumsum(lost) <= np.maximum.accumulate(work) * (1 + 1e-3)).all()
    assert worst[1] < 1e-3
    assert worst[1] < 0.5 * worst[0]
    assert np.cumsum(lost)[-1] > 0.05 * work.max()


def test_every_step_of_a_strain_accounts_for_its_energy(rng: np.random.Generator) -> None:
    """Strains led along random paths by steps of any length: work = rise of what is stored + loss, to rounding."""
    from pliant.equations.memory import memory_stored
    from pliant.equations.spatial_extension_memory import remember_strains, write_strain_lines

    model = arm()
    chain, law = mechanics_of(model), model.memory.axial.law()
    past = Past(law, relaxed(model, np.zeros(8)), chain.held())
    held, K, x, before, total = past.held, chain.joints.K, np.zeros(8), 0.0, 0.0
    for _ in range(300):
        held.x[:], held.dq[:] = x, rng.normal(0, 0.02, 8) * rng.choice([1e-4, 1.0, 5.0])
        h = rng.choice([1e-4, 1e-2, 10.0])
        write_strain_lines(h, chain.joints, past)
        r = held.line[6:, 0] + held.line[6:, 1] * (x + 0.5 * held.dq)[6:]
        lost = remember_strains(h, chain.joints, past)
        x = x + held.dq
        now = sum(K[i] * memory_stored(i, x[i], past.state, law) for i in (6, 7))
        work = np.sum(K[6:] * r * held.dq[6:])
        assert work == pytest.approx(now - before + lost, abs=1e-12)
        assert lost >= 0.0
        total, before = total + work, now
        assert total >= 0.0
        assert (np.abs(past.state[6:, 1:3]) <= law.slip_angle * (1 + 1e-12)).all()
    assert not past.state[:6].any()


def test_branches_of_segments_that_hold_nothing_change_nothing(rng: np.random.Generator) -> None:
    torques = np.repeat(rng.normal(0, [*[0.1] * 6, 0.5, 0.5], (5, 8)), 6, axis=0)
    still = replace(JOINTS, axial_creep_share=(0.0,), axial_creep_time=(1.0,), axial_slip_share=(0.0,),
                    axial_slip_strain=(0.01,))  # fmt: skip
    found, states, _ = marched(arm(still), torques)
    expected, before, _ = marched(arm(JOINTS), torques, kernel=spatial_memory.step_with_memory)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(states[:, :6], before, rtol=0, atol=1e-12)


def test_derivatives_pass_through_the_step(rng: np.random.Generator) -> None:
    """By complex step: of steps in which segments creep, stick and slip, by every number of the law."""
    torques = np.repeat(rng.normal(0, [*[0.2] * 6, 2.0, 2.0], (2, 8)), 2, axis=0)
    model = arm()
    numbers = model.memory.law()

    def end(values, kind=float):
        law = AxialMemoryLaw(*(np.asarray(v).astype(kind)[()] for v in values))
        return marched(model, torques, law=law, kind=kind)[0][-1, 0]

    for name in AxialMemoryLaw._fields:
        value = np.asarray(getattr(numbers, name), dtype=float)
        slope = end(numbers._replace(**{name: value + 1e-20j * value}), complex).imag / 1e-20
        around = [end(numbers._replace(**{name: (value * (1 + e))[()]})) for e in (-1e-6, 1e-6)]
        difference = (around[1] - around[0]) / 2e-6
        assert slope == pytest.approx(difference, rel=1e-4, abs=1e-5 * np.abs(difference).max()), name
        assert np.abs(difference).max() > 1e-9, name


def test_a_sudden_change_moves_what_slips_and_not_what_creeps() -> None:
    model = arm()
    chain, x = mechanics_of(model), np.zeros(8)
    change = np.array([0.006, 0.008, 0.0, 0.0, 0.0, 0.0, 0.02, -0.02])
    past = Past(model.memory.law(), relaxed(model, x), chain.held())
    follow_all(x, change, chain.joints, past)
    np.testing.assert_allclose(past.state[6:], [[0.0, 0.01, 0.02, 0.0], [0.0, -0.01, -0.02, 0.0]], atol=1e-15)
    np.testing.assert_allclose(past.state[:2, :3], [[0.0, 0.0, 0.006], [0.0, 0.0, 0.008]], atol=1e-15)
    relax_all(x + change, chain.joints, past)
    np.testing.assert_allclose(past.state[6:, :2], [[0.02, 0.01], [-0.02, -0.01]], atol=1e-15)
    np.testing.assert_allclose(past.state[:2, :2], [[0.006, 0.006], [0.008, 0.008]], atol=1e-15)


def test_what_is_no_number_finds_no_agreement() -> None:
    model = arm()
    chain = mechanics_of(model)
    parts, past = chain.parts(), Past(model.memory.law(), relaxed(model, np.zeros(8)), chain.held())
    none = np.full(8, np.nan)
    assert step_with_axial_memory(np.zeros(8), np.zeros(8), 1e-3, none, *parts[:2], past, parts[2]) == -1.0
    strains = past._replace(memory=model.memory.axial.law())
    assert np.isnan(strain_disagreement(none, 1e-3, parts[1], strains, parts[2], calm=False))


def test_small_motions_ring_with_all_stiffness_and_rest_with_none() -> None:
    memory = replace(JOINTS, axial_creep_share=(0.5,), axial_creep_time=(1.0,), axial_slip_share=(0.8,),
                     axial_slip_strain=(0.01,))  # fmt: skip
    model = arm(memory, gravity=(0.0, 0.0, 0.0))
    stiffer = tuple(replace(e, stiffness=2.3 * e.stiffness) for e in SEGMENTS)
    joints = 1.0 + JOINTS.instantaneous
    plain = arm(Memory(), gravity=(0.0, 0.0, 0.0), stiffness=0.9 * joints, extensions=stiffer)
    np.testing.assert_allclose(modes(model)[0], modes(plain)[0], rtol=1e-9)
    np.testing.assert_allclose(equilibrium(arm(memory), 5e4), equilibrium(arm(Memory()), 5e4), atol=1e-14)
