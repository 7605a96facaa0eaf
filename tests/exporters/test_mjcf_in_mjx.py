"""The exported MJCF in MJX, MuJoCo's version in JAX: the same motion as in MuJoCo."""

from __future__ import annotations

import numpy as np
import pytest
from target_models import in_space, paper

import pliant
from pliant.model import Memory

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install -e '.[test]'")
mjx = pytest.importorskip("mujoco.mjx", reason="MJX is not installed: pip install mujoco-mjx")
jax = pytest.importorskip("jax", reason="jax is not installed: pip install -e '.[jax]'")


@pytest.mark.slow  # JAX compiles the step
@pytest.mark.parametrize("body", [paper, lambda: paper().with_(memory=Memory((0.1,), (0.3,))), lambda: in_space(3)],
                         ids=["plane", "creep", "space"])  # fmt: skip
def test_the_motion_is_that_of_mujoco(body, tmp_path):
    model = body()
    pliant.export(model, "mjcf", tmp_path / "body.xml")
    m = mujoco.MjModel.from_xml_path(str(tmp_path / "body.xml"))
    d = mujoco.MjData(m)
    mujoco.mj_resetDataKeyframe(m, d, 0)
    start = d.qpos.copy()
    d.ctrl[:] = 3e4 * np.linspace(1.0, 0.3, m.nu)
    with jax.enable_x64(True):
        fixed, moving, step = mjx.put_model(m), mjx.put_data(m, d), jax.jit(mjx.step)
        for _ in range(100):
            mujoco.mj_step(m, d)
            moving = step(fixed, moving)
        np.testing.assert_allclose(np.asarray(moving.qpos), d.qpos, atol=1e-12)
    assert np.abs(d.qpos - start).max() > 0.01
