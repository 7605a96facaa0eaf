"""Tendons of a chain in space against the spatial tendons of MuJoCo: lengths, levers and poses at rest."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pliant import equilibrium
from pliant.mechanics import mechanics_of

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'pliant[bench]'")
GAP = 2e-3  # m
LEVELS = {"tension": [(8.0, 5.0)], "displacement": [(6e-3, 2e-3), (6e-3, -5e-3)]}  # N; m, the second one slack


@pytest.fixture(scope="module")
def bench():
    import tendons_mujoco

    return tendons_mujoco


def bent(made, bends, twists):
    """MuJoCo's arm at bends (n, 2) and twists (n,) of its joints, rad."""
    data = mujoco.MjData(made)
    swing = Rotation.from_rotvec(np.column_stack([bends, 0.0 * twists]))
    turned = swing * Rotation.from_rotvec(np.outer(twists, [0.0, 0.0, 1.0]))
    data.qpos[:] = turned.as_quat(scalar_first=True).ravel()
    mujoco.mj_forward(made, data)
    return data


def test_lengths_at_random_bends_differ_by_chords(bench, rng):
    """Each joint's chord is 2 e cos(theta/2) - 2 s sin(theta/2) / theta long, where pliant's arc draws in s = g . x."""
    model = bench.arm("tension", 5)
    made = bench.in_mujoco(model, GAP)
    for _ in range(5):
        bends = rng.uniform(-0.15, 0.15, (5, 2))
        x = np.append(bends, np.zeros(5))
        longer = bent(made, bends, np.zeros(5)).ten_length - made.tendon_length0
        theta = np.linalg.norm(bends, axis=1)
        arcs = (model.actuation.levers * x)[:, :10].reshape(2, 5, 2).sum(axis=2)
        chords = (2.0 * GAP * (np.cos(theta / 2) - 1.0) - 2.0 * arcs * np.sin(theta / 2) / theta).sum(axis=1)
        assert longer == pytest.approx(chords, abs=1e-14)
        most = (GAP * theta**2 / 4 + np.abs(arcs) * theta**2 / 24).sum(axis=1)
        assert (np.abs(longer + model.actuation.levers @ x) <= most).all()


def test_lengths_and_levers_with_twist(bench, rng):
    """The script's term of chords makes pliant's lengths MuJoCo's; its slopes make pliant's torques MuJoCo's."""
    model = bench.arm("displacement", 5)
    made, level = bench.in_mujoco(model, GAP), np.array([6e-3, 1e-3])
    x = np.append(rng.uniform(-0.15, 0.15, 10), rng.uniform(-0.05, 0.05, 5))
    data = bent(made, x[:10].reshape(5, 2), x[10:])
    excess = bench.chord_excess(x, model, GAP).sum(axis=1)
    assert data.ten_length - made.tendon_length0 == pytest.approx(excess - model.actuation.levers @ x, abs=1e-14)
    assert np.abs(excess).min() > 1e-6
    h = 1e-6
    torque = bench.with_chords(x, level, model, GAP)
    for i in range(15):
        ends = [bench.chord_excess(x + s * h * np.eye(15)[i], model, GAP).sum(axis=1) for s in (1, -1)]
        data.ctrl[:] = level
        mujoco.mj_forward(made, data)
        assert data.actuator_force @ (ends[0] - ends[1]) / (2 * h) == pytest.approx(torque[i], abs=1e-6)


@pytest.mark.parametrize(("driven_by", "level"), [(kind, level) for kind in LEVELS for level in LEVELS[kind]])
def test_arms_at_rest_differ_by_chords(bench, driven_by, level):
    """The difference is that of the chords, to rounding; with rods and gaps half as long, a quarter of it is left."""
    far = []
    for rods in (5, 10):
        model, gap, level = bench.arm(driven_by, rods), bench.LENGTH / rods / 20, np.array(level)
        there = bench.shown(model, bench.at_rest(bench.in_mujoco(model, gap), level))
        stations = mechanics_of(model).stations
        assert stations(bench.rest_with_chords(model, level, gap))[0] == pytest.approx(there, abs=1e-11)
        far.append(np.abs(stations(equilibrium(model, level))[0] - there).max())
    assert far[0] < 1e-3
    assert far[0] / far[1] == pytest.approx(4.0, rel=0.1)


def test_an_actuator_pulls_as_the_spring_of_a_tendon(bench):
    """MuJoCo's own spring of a tendon, with a range of lengths in which it is slack, ends in the same pose."""
    model, level = bench.arm("displacement", 5), np.array([6e-3, -5e-3])
    made = bench.in_mujoco(model, GAP)
    driven = bench.at_rest(made, level)
    assert driven.actuator_force[0] < 0.0 == driven.actuator_force[1]
    springs = bench.in_mujoco(model, GAP)
    springs.actuator_gainprm[:] = springs.actuator_biasprm[:] = 0.0
    springs.tendon_stiffness[:] = bench.ELASTIC["line_stiffness"]
    longest = springs.tendon_length0 - level - bench.ELASTIC["pretension"] / bench.ELASTIC["line_stiffness"]
    springs.tendon_lengthspring[:] = np.column_stack([np.zeros(2), longest])
    assert bench.at_rest(springs, 0.0 * level).qpos == pytest.approx(driven.qpos, abs=1e-11)
