"""Bodies that lengthen through a fit: exact derivatives, the truth found again, what does not show, names."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.identification import Experiment, fit, identifiability, predict
from pliant.identification.sensitivity import sensitivities
from pliant.identification.torque_start import extension_starts, grown
from pliant.model import Chamber, Extension, Model, Valve, chain_model
from pliant.simulation import Trace, simulate

TIMES = np.arange(0.0, 1.0, 0.01)
STEP = 2e-3
VALUES = {"stiffness": 0.9, "damping": 2e-2, "torque_1": 2e-6, "axial_gain": 60.0, "axial_stiffness": 90.0,
          "axial_damping": 2.0}  # fmt: skip


@pytest.fixture(scope="module")
def body() -> Model:
    """A hanging body of three links that lengthens by 6 % and bends by half a radian."""
    return chain_model(
        length=0.2, mass=0.15, links=3, joint_placement="midsegment", stiffness=0.9, damping=2e-2, gravity=[0.0, 9.81],
        chambers=(Chamber([2e-6], axial_gain=60.0, valve=Valve(rise_time=0.03, fall_time=0.05)),),
        extensions=(Extension(90.0, 2.0),), stations=(("mid", 1, 0.03, 0.01), ("tip", 2, 0.033, -0.02)),
    )


@pytest.fixture(scope="module")
def seen(body: Model) -> Experiment:
    """Two levels of pressure, without noise."""
    pressure = Trace([0.1, 0.12, 0.4, 0.42, 0.7, 0.72], np.array([0.0, 4e4, 4e4, 8e4, 8e4, 0.0]))
    motion = simulate(body, pressure, times=TIMES, time_step=STEP)
    return Experiment("r", TIMES, motion.station_position.values, ("mid", "tip"), "trace", pressure)


@pytest.mark.parametrize("name", [*VALUES, "base_angle", "mass"])
def test_derivatives_agree_with_differences(body: Model, seen: Experiment, name: str) -> None:
    values = {**VALUES, "base_angle": 0.1, "mass": 0.15}
    size = 1e-5 * values[name]
    _, slopes = sensitivities(body, seen, values, {name: values[name]}, STEP)
    ends = [predict(body, seen, {**values, name: values[name] + d}, STEP)["position"] for d in (size, -size)]
    expected = (ends[0] - ends[1]) / (2 * size)
    assert np.abs(slopes[0, ..., :2] - expected).max() < 3e-6 * np.abs(expected).max()


def test_the_truth_is_found_again(body: Model, seen: Experiment) -> None:
    """Dynamics alone tell axial stiffness: the body swings and bounces. Gain and law begin from statics."""
    start = body.with_(extensions=(Extension(120.0, 1.0),), chambers=(body.chamber,))
    found = fit([seen], start, [n for n in VALUES if n != "torque_1"], time_step=STEP, starts=1)
    for name, value in VALUES.items():
        if name in found.values:
            assert found.values[name] == pytest.approx(value, rel=1e-5)


def test_a_gain_begins_where_the_body_lengthens_as_it_was_seen_to(body: Model, seen: Experiment) -> None:
    assert grown(seen) == pytest.approx(8e4 * 2e-6 * 60.0 / 90.0, rel=0.3)  # arcs through two points beside the body
    named = body.with_(chambers=(replace(body.chamber, name="left"),))
    starts = extension_starts(named, [seen], {})
    assert starts["axial_gain"] == starts["left.axial_gain"] == pytest.approx(60.0, rel=0.3)  # said of all, or of one


def test_places_off_the_first_frames(body: Model, seen: Experiment) -> None:
    """Markers set anew: their places follow from where they hang, and the motion from them."""
    moved = body.with_(stations=(("mid", 1, 0.05, -0.02), ("tip", 2, 0.02, 0.01)))
    other = Experiment("o", TIMES, seen.position, seen.stations, "trace", seen.pressure, own_places=True)
    told = predict(moved, other, {}, STEP)["position"]
    np.testing.assert_allclose(told, seen.position, atol=1e-9)
    assert np.abs(predict(moved, seen, {}, STEP)["position"] - seen.position).max() > 0.01


def test_what_cannot_be_told_is_said(body: Model, seen: Experiment) -> None:
    """Where neither inertia nor weight shows, axial stiffness, damping and gain have one scale too many."""
    free = body.with_(gravity=[0.0, 0.0], link_mass=0.02 * body.link_mass, damping=0.2)
    motion = simulate(free, seen.pressure, times=TIMES, time_step=STEP)
    light = Experiment("light", TIMES, motion.station_position.values, ("mid", "tip"), "trace", seen.pressure)
    told = identifiability([light], free, ["axial_stiffness", "axial_damping", "axial_gain"], time_step=STEP)
    assert {"axial_stiffness", "axial_gain"} <= set(told.directions[0].names)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [("body.gain", "'body' is a segment, whose parameters are axial_stiffness, axial_damping"),
     ("nobody.axial_stiffness", "is called 'nobody'")],
)  # fmt: skip
def test_names(body: Model, seen: Experiment, name: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        fit([seen], body, [name])
    with pytest.raises(InputError, match="the model has no extensible segment"):
        fit([seen], body.with_(extensions=()), ["axial_stiffness"])
