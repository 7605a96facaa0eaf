"""Known forces on a body in space: three components in the tracker's axes, and refusals on the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import invoke
from scipy.spatial.transform import Rotation

from pliant.errors import InputError
from pliant.model import Station
from pliant.numerics.curve import spatial_curve
from pliant.preprocessing.side import alignment_of
from pliant.recording import make_recording, write
from pliant.study import load_study
from pliant.study.prepare import all_aligned
from pliant.study.run import prepare_all

TURN = Rotation.random(rng=3)
TIME = np.arange(150) / 50
PULL = [[0.0, 0.0, 0.0], [0.1, -0.2, 0.3]]  # N


def study_of(folder: Path, forces: list[dict[str, Any]], **actuator: Any) -> Path:
    """A fibre that waves in space, and its study."""
    s = np.linspace(0, 0.3, 31)
    wave = np.where(TIME < 1, 0.0, np.sin(4 * (TIME - 1)))[:, None]
    place = spatial_curve(np.stack([4.0 * wave + 0 * s, 1.0 * wave * s / s[-1]], -1), s)[0][..., [0, 2, 1]]
    tracked = TURN.apply(place.reshape(-1, 3)).reshape(place.shape)[:, [0, 15, 30]]
    write(make_recording(TIME, tracked, station=["base", "middle", "tip"]), folder / "one.nc")
    content = {
        "name": "arm", "actuator": {"length": 0.3, "mass": 0.1, "links": 2, "space": True, **actuator},
        "alignment": {"options": {"base": "base", "tangent": list(TURN.apply([0, 0, 1.0]))}},
        "recordings": {"one": {"file": "one.nc", "excitation": "release", "forces": forces}},
        "fits": {"a": {"train": ["one"], "parameters": {"stiffness": "free"}}},
    }
    path = folder / "study.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def test_three_components_are_turned_into_the_base_frame_as_gravity_is(tmp_path: Path) -> None:
    forces = [{"station": "tip", "time_s": [0.0, 0.5], "force_n": PULL},
              {"link": 2, "along": 0.03, "aside": 0.01, "time_s": [0.2], "force_n": [PULL[1]]}]
    study = load_study(study_of(tmp_path, forces, gravity=[0.1, -0.2, 0.3]))
    ready = prepare_all(study, lambda _line: None)
    one, other = ready.experiments["one"].forces
    rotation = np.array(alignment_of(all_aligned(study)["one"].body).rotation)
    np.testing.assert_allclose(one.force, np.array(PULL) @ rotation.T, atol=1e-12)
    np.testing.assert_allclose(one.force[1], ready.model.gravity, atol=1e-12)
    assert other.at == Station("known force", 1, 0.03, 0.0, 0.01)


@pytest.mark.parametrize(("force", "actuator", "sentence"), [
    ([[1.0, 0.0]], {}, "recordings.one.forces.0.force_n.0 has 2 components, but the body moves in space"),
    ([[0.0, 1.0, 0.0]], {"space": False}, "has 3 components, but the body moves in a plane"),
    ([[0.0, 1.0, 0.0], [1.0, 0.0]], {}, "all rows of force_n need the same number of components"),
    ([[0.0, 1.0, 0.0, 2.0]], {}, "recordings.one.forces.0.force_n.0"),
])  # fmt: skip
def test_another_number_of_components_is_refused(
    tmp_path: Path, force: list[list[float]], actuator: dict[str, Any], sentence: str
) -> None:
    pull = {"station": "tip", "time_s": [0.1 * k for k in range(len(force))], "force_n": force}
    result = invoke("run", study_of(tmp_path, [pull], **actuator), "-o", tmp_path / "out")
    assert result.exit_code != 0
    assert isinstance(result.exception, InputError)
    assert sentence in str(result.exception)
    assert not (tmp_path / "out").exists()
