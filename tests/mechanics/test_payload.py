"""A payload with a moment of inertia: closed forms in the plane and in space, and the mass matrix of MuJoCo."""

from __future__ import annotations

import numpy as np
import pytest

import pliant
from pliant.exporters.mjcf import mjcf
from pliant.exporters.provenance import Provenance
from pliant.mechanics import mechanics_of
from pliant.model import Extension, Model, Space

M, L, CAP, J = 0.05, 0.2, 0.3, 4e-4  # kg, m, kg, kg m^2
ROD = M * L * L / 3.0 + CAP * L * L  # about the joint, with a point mass at the tip


def rod(**more) -> Model:
    """One link on one joint, with a payload that has a moment of inertia."""
    given = {"link_length": L, "link_mass": M, "stiffness": 2.0, "damping": 1e-3, "torque": [1e-6], "tip_mass": CAP}
    return Model(**{**given, "tip_inertia": J, **more})


def inertia(model, x=None):
    chain = mechanics_of(model)
    return chain.inertia(np.zeros(chain.size) if x is None else np.asarray(x))


def test_a_rod_with_a_payload_swings_at_the_frequency_of_the_closed_form():
    for model in (rod(), rod(space=Space())):
        assert inertia(model)[0, 0] == pytest.approx(ROD + J, rel=1e-12)
        M, K = mechanics_of(model).linear_parts(np.zeros(model.size))
        assert np.sqrt(K[0, 0] / M[0, 0]) == pytest.approx(np.sqrt(2.0 / (ROD + J)), rel=1e-9)


def test_a_payload_turns_about_the_link_as_a_flat_disc():
    twisting = rod(space=Space(radius=0.01, twist_ratio=0.7))
    assert inertia(twisting)[2, 2] == pytest.approx(M * 0.01**2 / 2.0 + 2.0 * J, rel=1e-12)


@pytest.mark.parametrize("space", [None, Space(radius=0.01)])
def test_a_payload_does_not_lengthen_with_its_link(space):
    whole = [Extension(500.0, 1.0, name="whole")]
    light, disc = (inertia(rod(tip_inertia=value, space=space, extensions=whole)) for value in (0.0, J))
    assert disc[-1, -1] == pytest.approx(L * L * (M / 3.0 + CAP), rel=1e-12)  # of the strain
    changed = np.zeros_like(disc)
    changed[: len(disc) - 1, : len(disc) - 1] = J * np.eye(len(disc) - 1)
    assert disc - light == pytest.approx(changed, abs=1e-15)
    longer = np.append(np.zeros(len(disc) - 1), 0.3)
    light, disc = (inertia(rod(tip_inertia=value, space=space, extensions=whole), longer) for value in (0.0, J))
    assert disc - light == pytest.approx(changed, abs=1e-15)


def test_energy_of_a_payload_is_that_of_its_turn():
    model = pliant.chain_model(length=0.3, mass=0.06, links=3, stiffness=0.4, damping=1e-3, torque=[1e-6])
    rng = np.random.default_rng(2)
    for space, point in ((None, model), (Space(), model.with_(space=Space(), gravity=[0.0, 0.0, 0.0]))):
        chains = [mechanics_of(point.with_(tip_mass=0.1, tip_inertia=value)) for value in (0.0, J)]
        x, v = rng.normal(0, 0.4, (2, 1, chains[0].size))
        gained = np.diff([chain.energy(x, v).kinetic[0] for chain in chains])[0]
        if space is None:
            assert gained == pytest.approx(0.5 * J * v[0, -1] ** 2, rel=1e-9)
            continue
        h = 1e-6
        frames = [chains[0].link_frames(x + s * h * v)[0, -1] for s in (-1.0, 1.0)]
        turn = (frames[1] - frames[0]) / (2 * h) @ chains[0].link_frames(x)[0, -1].T
        omega, axis = np.array([turn[2, 1], turn[0, 2], turn[1, 0]]), chains[0].directions(x)[0, -1]
        assert gained == pytest.approx(0.5 * J * (omega @ omega + (omega @ axis) ** 2), rel=1e-6)


@pytest.mark.parametrize("space", [None, Space(radius=0.01)])
def test_the_mass_matrix_is_that_of_mujoco(space):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'pliant[bench]'")
    model = pliant.chain_model(length=0.3, mass=0.06, links=2, stiffness=0.4, damping=1e-3, torque=[1e-6],
                               tip_mass=0.1, tip_inertia=J, space=space, name="arm")  # fmt: skip
    m = mujoco.MjModel.from_xml_string(mjcf(model, Provenance(model, "mjcf", "test"), time_step=1e-3, highest=1e5))
    d, full = mujoco.MjData(m), np.zeros((m.nv, m.nv))
    mujoco.mj_forward(m, d)
    for row, unit in zip(full, np.eye(m.nv), strict=True):
        mujoco.mj_mulM(m, d, row, unit)
    chain = mechanics_of(model)
    to_joints = chain.from_joints
    expected = to_joints.T @ chain.inertia(np.zeros(chain.size)) @ to_joints
    assert np.sort(np.diag(full)) == pytest.approx(np.sort(np.diag(expected)), rel=1e-3)
    without = to_joints.T @ inertia(model.with_(tip_inertia=0.0)) @ to_joints
    assert np.abs(np.diag(expected) - np.diag(without)).max() > 0.01 * np.diag(expected).max()
