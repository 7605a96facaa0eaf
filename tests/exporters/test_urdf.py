"""URDF: another library finds the same places, and the file says what is lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pliant
from pliant.exporters.urdf import EXPORTER
from pliant.mechanics import mechanics_of
from pliant.model import Extension


def test_places_of_links_and_points(model, tmp_path):
    yourdfpy = pytest.importorskip("yourdfpy", reason="yourdfpy is not installed: pip install 'pliant[export]'")
    done = pliant.export(model, "urdf", tmp_path / "arm.urdf")
    robot = yourdfpy.URDF.load(str(done.files[0]), build_scene_graph=True, load_meshes=False)
    assert robot.validate()
    q = np.linspace(0.2, -0.1, model.n)
    robot.update_cfg(dict(zip([f"q_{i + 1}" for i in range(model.n)], q, strict=True)))
    places, _ = mechanics_of(model).stations(mechanics_of(model).coordinates(q))
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


def test_no_difference_of_a_motion_that_it_does_not_hold(tmp_path, monkeypatch):
    """What is left out of springs and pressures is told, never measured; what it could not hold at all is refused."""
    from pliant.actuators import chen2018

    model = chen2018.model(torque=[6e-7, 1e-13], stiffening=-0.1)
    done = pliant.export(model, "urdf", tmp_path / "arm.urdf", approximate=True)
    assert (done.difference, done.left_out) == (None, ())
    longer = model.with_(extensions=(Extension(300.0, name="arm"),))
    rigid = replace(EXPORTER, can=EXPORTER.can - {"lengthening"})
    monkeypatch.setattr("pliant.exporters.registry.exporters", lambda: {"urdf": rigid})
    for approximate in (False, True):
        with pytest.raises(pliant.InputError, match="segment arm that lengthens: not expressible in urdf, which"):
            pliant.export(longer, "urdf", tmp_path / "longer.urdf", approximate=approximate)
    assert [f.name for f in tmp_path.iterdir()] == ["arm.urdf"]
