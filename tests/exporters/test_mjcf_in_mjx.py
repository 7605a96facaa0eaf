"""The exported MJCF in MJX, MuJoCo's version in JAX, and in MuJoCo Warp: the same motion as in MuJoCo."""

from __future__ import annotations

import numpy as np
import pytest
from target_models import in_space, paper

import pliant
from pliant.model import Memory

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install -e '.[test]'")

BODIES = {"plane": paper, "creep": lambda: paper().with_(memory=Memory((0.1,), (0.3,))), "space": lambda: in_space(3)}


def begun(body, folder):
    """The model and the data of an exported body, at its keyframe and under inputs."""
    pliant.export(BODIES[body](), "mjcf", folder / "body.xml")
    m = mujoco.MjModel.from_xml_path(str(folder / "body.xml"))
    d = mujoco.MjData(m)
    mujoco.mj_resetDataKeyframe(m, d, 0)
    d.ctrl[:] = 3e4 * np.linspace(1.0, 0.3, m.nu)
    return m, d


@pytest.mark.slow  # JAX compiles the step
@pytest.mark.parametrize("body", list(BODIES))
def test_the_motion_is_that_of_mujoco(body, tmp_path):
    mjx = pytest.importorskip("mujoco.mjx", reason="MJX is not installed: pip install mujoco-mjx")
    jax = pytest.importorskip("jax", reason="jax is not installed: pip install -e '.[jax]'")
    m, d = begun(body, tmp_path)
    start = d.qpos.copy()
    with jax.enable_x64(True):
        fixed, moving, step = mjx.put_model(m), mjx.put_data(m, d), jax.jit(mjx.step)
        for _ in range(100):
            mujoco.mj_step(m, d)
            moving = step(fixed, moving)
        np.testing.assert_allclose(np.asarray(moving.qpos), d.qpos, atol=1e-12)
    assert np.abs(d.qpos - start).max() > 0.01


@pytest.mark.slow  # Warp compiles the step for minutes
@pytest.mark.parametrize("body", list(BODIES))
def test_the_motion_in_warp_is_that_of_mujoco(body, tmp_path):
    warp = pytest.importorskip("mujoco_warp", reason="MuJoCo Warp is not installed: pip install mujoco-warp")
    m, d = begun(body, tmp_path)
    start = d.qpos.copy()
    fixed, moving = warp.put_model(m), warp.put_data(m, d)
    for _ in range(100):
        mujoco.mj_step(m, d)
        warp.step(fixed, moving)
    np.testing.assert_allclose(moving.qpos.numpy()[0], d.qpos, atol=1e-7)  # single precision
    assert np.abs(d.qpos - start).max() > 0.01
