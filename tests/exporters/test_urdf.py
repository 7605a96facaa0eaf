"""URDF: another library finds the same places, and the file says what is lost."""

from __future__ import annotations

import numpy as np
import pytest

import pliant
from pliant.exporters.features import MEMORY, without
from pliant.simulation import state


def reduced(model):
    return without(model, (*MEMORY, "softening", "law", "dead_time", "lag"))


def test_places_of_links_and_points(model, tmp_path):
    yourdfpy = pytest.importorskip("yourdfpy", reason="yourdfpy is not installed: pip install 'pliant[export]'")
    model = reduced(model)
    done = pliant.export(model, "urdf", tmp_path / "arm.urdf")
    robot = yourdfpy.URDF.load(str(done.files[0]), build_scene_graph=True, load_meshes=False)
    assert robot.validate()
    q = np.linspace(0.2, -0.1, model.n)
    robot.update_cfg(dict(zip([f"q_{i + 1}" for i in range(model.n)], q, strict=True)))
    places, _ = state.stations(model, state.absolute(model, q))
    names = {link.name for link in robot.robot.links}
    for point, place in zip(model.points, places, strict=True):
        name = f"{point.name}_point" if f"{point.name}_point" in names else point.name
        assert robot.get_transform(name)[:3, 3] == pytest.approx([*place, 0.0], abs=1e-9)
    masses = [link.inertial.mass for link in robot.robot.links if link.inertial]
    assert sum(masses) == pytest.approx(model.mass)


def test_it_says_what_is_lost(tmp_path):
    from pliant.actuators import chen2018

    done = pliant.export(chen2018.model(), "urdf", tmp_path / "arm.urdf")
    assert "no springs and no pressure" in done.notes[0]
    assert "no springs and no pressure" in done.files[0].read_text(encoding="utf-8")
