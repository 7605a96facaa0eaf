"""A body that is held in several orientations: each recording states its own gravity."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import invoke
from small_study import AXES, HEADER, ORIGIN, STIFFNESS, STUDY, TIMES, TORQUE, body, write_recording

from pliant.identification import Experiment, predict
from pliant.identification.parameters import apply
from pliant.model import Station, chain_model
from pliant.simulation import Trace, simulate
from pliant.study import load_study
from pliant.study.run import prepare_all

DOWN = {"hanging": [0.0, 9.81], "lying": [-9.81, 0.0], "upright": [0.0, -9.81]}  # m/s^2 in the base frame
TRACE = Trace([0.2, 0.21, 0.9, 0.91], [0.0, 9e4, 9e4, 0.0])


def write(folder) -> None:
    """The body in three orientations of the room, each in a frame that is fixed to its base."""
    for k, (name, gravity) in enumerate(DOWN.items()):
        model = body().with_(gravity=np.array(gravity))
        tip = simulate(model, TRACE, times=TIMES, time_step=5e-4)["station_position"].values[:, 0]
        seen = np.stack([np.zeros((TIMES.size, 3)), np.column_stack([tip, np.zeros(TIMES.size)])], axis=1) @ AXES.T
        seen = seen + ORIGIN + 2e-5 * np.random.default_rng(k).standard_normal(seen.shape)
        columns = np.column_stack([TIMES, TRACE(TIMES) / 1e3, seen.reshape(TIMES.size, -1)])
        write_recording(folder / f"{name}.csv", columns, HEADER)


def study_of(folder, *, stated: bool):
    """The study file of the three recordings, with the gravity of each in the tracker's axes."""
    write(folder)
    turned = {name: (AXES @ [*gravity, 0.0]).tolist() for name, gravity in DOWN.items()}
    options = {"base": "base", "tangent": AXES[:, 1].tolist(), "plane": AXES[:, 2].tolist()}
    records = {n: {"file": f"{n}.csv", **({"gravity": turned[n]} if stated else {})} for n in DOWN}
    fit = {**STUDY["fits"]["linear"], "train": ["hanging", "lying"], "held_out": ["upright"]}
    content = {**STUDY, "alignment": {"options": options}, "recordings": records, "fits": {"linear": fit}}
    (folder / "study.json").write_text(json.dumps(content))
    return folder / "study.json"


def test_the_gravity_of_a_recording_is_known_in_its_base_frame(tmp_path):
    ready = prepare_all(load_study(study_of(tmp_path, stated=True)), lambda _line: None)
    for name, gravity in DOWN.items():
        known = ready.experiments[name].known
        shown = [known["gravity_x"] * np.sign(known["gravity_x"] * gravity[0] or 1.0), known["gravity_y"]]
        assert shown == pytest.approx(gravity, abs=2e-2)  # x may point to the other side


@pytest.mark.slow
@pytest.mark.parametrize("stated", [True, False])
def test_each_recording_has_the_gravity_that_it_states(tmp_path, stated):
    done = invoke("run", study_of(tmp_path, stated=stated), "-o", tmp_path / "out", "--quiet")
    assert done.exit_code == 0, done.exception
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    error = metrics["records"]["upright"]["rmse_percent_of_travel"]
    values = {name: p["value"] for name, p in metrics["fits"]["linear"]["parameters"].items()}
    assert (error < 0.5) is stated
    if stated:
        assert values["stiffness"] == pytest.approx(STIFFNESS, rel=0.02)
        assert abs(values["torque_1"]) == pytest.approx(TORQUE, rel=0.02)


def test_a_body_in_space_takes_three_components():
    model = chain_model(length=0.2, mass=0.05, links=2, stiffness=0.3, damping=1e-2, space=True, torque=[1e-6],
                        stations=(Station("tip", 1, 0.1),))  # fmt: skip
    down = np.array([5.0, -3.0, 7.0])
    time = np.linspace(0.0, 3.0, 40)
    place = np.zeros((40, 1, 3))
    place[20:] = 0.01
    exp = Experiment("one", time, place, ("tip",), "trace", Trace([0.0, 3.0], [0.0, 0.0]),
                     known={f"gravity_{axis}": float(g) for axis, g in zip("xyz", down, strict=True)})  # fmt: skip
    seen = np.asarray(predict(model, exp, {}, 2e-3)["compared"])
    alone = np.asarray(predict(model.with_(gravity=down), exp.__class__(
        "two", time, exp.position, ("tip",), "trace", exp.pressure), {}, 2e-3)["compared"])  # fmt: skip
    assert seen == pytest.approx(alone, abs=1e-12)
    assert abs(seen[0, 0, 0]) > 5e-3
    assert apply(model.with_(gravity=down), {"gravity_y": 1.0}).gravity.tolist() == [5.0, 1.0, 7.0]
