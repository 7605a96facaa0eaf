"""Fits of a chain in space: derivatives against differences, parameters found again from another's motion."""

from dataclasses import replace

import numpy as np
import pytest
from space_cases import (
    AZIMUTHS,
    LINKS,
    OF_AXIAL_MEMORY,
    OF_MEMORY,
    OF_SEGMENTS,
    OF_TENDONS,
    SOUND,
    STEP,
    TIME,
    TRACES,
    arm,
    rich_arm,
)

import pliant
from pliant.errors import InputError
from pliant.identification.experiment import Experiment
from pliant.identification.fit import fit
from pliant.identification.prediction import predict
from pliant.identification.sensitivity import sensitivities
from pliant.model import Chamber, Extension, Memory, Space, Station
from pliant.simulation import Trace
from pliant.simulation.forces import PointForce


def record(position=None, *, name="r", **more):
    still = np.tile([0.0, 0.0, 0.1], (TIME.size, 2, 1))
    still[:, 1, 0] += np.linspace(0, 0.1, TIME.size)
    return Experiment(name, TIME, still if position is None else position, ("mid", "tip"), **more)


EXCITED = {
    "trace": {"excitation": "trace", "drives": TRACES},
    "own_places": {"excitation": "trace", "drives": TRACES, "own_places": True},
    "release": {"excitation": "release"},
    "held": {"excitation": "release", "held": np.array([[0.01, -0.01, 0.18], [0.05, -0.03, 0.28]])},
    "rich": {"excitation": "trace",
             "drives": {n: Trace(TIME, (1e-7 if n in ("red", "cord") else 1.0) * t.pressure)
                        for n, t in {**TRACES, "cord": TRACES["red"]}.items()},
             "forces": (PointForce(np.zeros(1), np.array([[0.1, 0.0, 0.3]]), "mid"),)},
    "held remembers": {"excitation": "release", "held": np.array([[0.01, -0.01, 0.19], [0.05, -0.03, 0.29]])},
    "forces": {"excitation": "trace", "drives": TRACES,
               "forces": (PointForce(np.array([0.0, 1.0]), np.array([[0.0, 0.1, 0.0], [0.2, 0.0, 0.1]]), "tip"),)},
}  # fmt: skip
EXCITED["rich remembers"] = EXCITED["rich"]


@pytest.mark.slow  # compiles the motion on dual numbers
@pytest.mark.parametrize("kind", EXCITED)
def test_derivatives_of_a_motion_in_space_are_those_of_differences(kind):
    exp, values, model = record(**EXCITED[kind]), dict(SOUND), arm()
    if kind in ("release", "held", "held remembers"):
        values |= {"release": 0.13, "release_time": 0.05} | ({"hold_force": 0.3} if kind == "release" else {})
        del values["start"]
    if kind.startswith("held"):  # few joints, whose pose two points decide
        places = [Station("mid", 0, 0.11, 0.0, 0.01), Station("tip", 1, 0.07)]
        model = arm(links=2, space=Space(stiffness_ratio=1.2), stations=places)
        del values["twist_ratio"]
    if kind == "held remembers":
        whole = Extension(60.0, 0.4, 0.0, None, "whole")
        model = model.with_(extensions=(whole,), chambers=[replace(c, axial_gain=30.0) for c in model.chambers])
        values = {k: v for k, v in values.items() if k in ("stiffness", "damping", "release", "release_time", "start")}
        values |= {"axial_stiffness": 55.0} | OF_MEMORY
    if kind.endswith("remembers"):  # the segments
        values |= OF_AXIAL_MEMORY
    if kind.startswith("rich"):  # tendons, segments that lengthen and memory: one motion compiled for all
        model = rich_arm()
        values |= OF_TENDONS | OF_SEGMENTS | OF_MEMORY
        del values["red.torque_1"]
    if kind == "own_places":  # those of the model's places do nothing then
        values = {k: v for k, v in values.items() if "." not in k or k.startswith(("red", "green", "blue"))}
    sizes = {name: abs(value) for name, value in values.items()}
    _, slopes = sensitivities(model, exp, values, sizes, STEP)
    for (name, value), slope in zip(values.items(), slopes, strict=True):
        h = 1e-5 * max(abs(value), 1e-4)
        up, down = (predict(model, exp, {**values, name: value + s * h}, STEP)["position"] for s in (1, -1))
        difference = (up - down) / (2 * h)
        assert np.abs(slope - difference).max() <= 2e-6 * np.abs(difference).max() + 1e-9, name
        assert name not in OF_AXIAL_MEMORY or np.abs(difference).max() > 1e-5, name


@pytest.mark.slow
def test_a_pulled_body_whose_segment_slipped_begins_in_equilibrium():
    """A hand holds the stretched slip elements of joints and segment too: nothing moves until it lets go."""
    whole = Extension(60.0, 0.4, 0.0, None, "whole")
    places = [Station("mid", 0, 0.11, 0.0, 0.01), Station("tip", 1, 0.07)]
    model = arm(links=2, space=Space(stiffness_ratio=1.2), stations=places, extensions=(whole,))
    held = record(**EXCITED["held remembers"])
    values = {"release": 0.1, "release_time": 8.0, "slip_share_1": 0.3, "slip_angle_1": 0.02}
    values |= {"axial_slip_share_1": 0.6, "axial_slip_strain_1": 0.004}
    position = predict(model, held, values, STEP)["position"]
    assert np.abs(position[TIME < 0.2] - position[0]).max() < 2e-5
    assert np.abs(position - position[0]).max() > 2e-4  # 8 s of letting go have begun


@pytest.mark.slow
def test_the_slow_creep_of_a_fabric_arm_that_hangs_is_found_again():
    """An arm that grows by a step of pressure for 24 s, its slow part larger than the fast one: time constant 8 s."""
    time = np.arange(0.0, 24.0, 0.1)
    push = {"blue": Trace([0.0, 1.0, 1.02, 24.0], [0.0, 0.0, 60e3, 60e3])}
    chamber = Chamber(torque=(2e-6,), joint_gain=0.2, cross_gain=0.1, axial_gain=40.0, name="blue")
    whole = Extension(60.0, 2.0, 0.0, None, "whole")
    places = [Station("mid", 0, 0.11), Station("tip", 1, 0.07)]
    start = arm(links=2, space=Space(), stations=places, gravity=(0.0, 0.0, 9.81), extensions=(whole,),
                chambers=[chamber], damping=3e-2)  # fmt: skip
    truth = start.with_(memory=Memory(axial_creep_share=(1.5,), axial_creep_time=(3.2,)))
    motion = pliant.simulate(truth, push["blue"], times=time, time_step=5e-3, check=False)
    seen = motion.station_position.values + np.random.default_rng(1).normal(0, 1e-4, (time.size, 2, 3))
    exp = Experiment("r", time, seen, ("mid", "tip"), "trace", drives=push)
    result = fit([exp], start, ["stiffness", "axial_stiffness", "axial_creep_share_1", "axial_creep_time_1"],
                 time_step=2e-2)  # fmt: skip
    found = {p.name: p.value for p in result.parameters}
    assert result.converged
    assert found["axial_stiffness"] == pytest.approx(60.0, rel=0.01)
    assert found["axial_creep_share_1"] == pytest.approx(1.5, rel=0.02)
    assert found["axial_creep_time_1"] == pytest.approx(3.2, rel=0.02)  # (1 + 1.5) 3.2 s = 8 s
    assert result.rmse["r"] < 1.5e-4 * np.sqrt(3)


@pytest.mark.slow
def test_stiffnesses_twist_and_azimuths_are_found_again():
    """The recording comes from a chain of twice as many links, so that the fit's own equations did not make it."""
    rng = np.random.default_rng(1)
    time = np.arange(0.0, 2.0, 0.02)
    traces = [Trace(time, 40e3 * (1 + np.sin(2 * np.pi * f * time + f))) for f in (0.7, 1.1, 1.9)]
    places = [Station("mid", 2, 0.05), Station("tip", 5, 0.025)]
    finer = arm(links=2 * LINKS, stiffness=2 * 0.5, damping=2 * 5e-3, stations=places)
    motion = pliant.simulate(finer, traces, times=time, time_step=STEP, check=False)
    seen = motion.station_position.values + rng.normal(0, 1e-4, (time.size, 2, 3))
    exp = Experiment("r", time, seen, ("mid", "tip"), "trace", drives=dict(zip(AZIMUTHS, traces, strict=True)))
    start = arm(stiffness=0.4, stations=[Station("mid", 1, 0.025), Station("tip", 2, 0.05)])
    gains = [f"{name}.gain_{axis}" for name in AZIMUTHS for axis in "xy"]
    result = fit([exp], start, ["damping", "stiffness", "stiffness_ratio", *gains], time_step=STEP)
    assert result.converged
    found = {p.name: p.value for p in result.parameters}
    assert found["stiffness_ratio"] == pytest.approx(1.2, rel=0.01)
    for name, a in AZIMUTHS.items():
        azimuth = np.arctan2(found[f"{name}.gain_x"], -found[f"{name}.gain_y"]) % (2 * np.pi)
        assert azimuth == pytest.approx(a, abs=0.02)
    assert result.rmse["r"] < 0.03 * exp.travel


@pytest.mark.parametrize(("name", "sentence"), [
    ("rest_angle", "needs a chain in a plane"), ("rest_turn_x_9", "joints 1 to 3"),
    ("gravity_angle", "needs a chain in a plane"),
])  # fmt: skip
def test_parameters_of_the_plane_are_refused_in_space(name, sentence):
    with pytest.raises(InputError, match=sentence):
        fit([record(**EXCITED["trace"])], arm(), [name])


def test_parameters_of_space_are_refused_in_the_plane():
    position = record(**EXCITED["trace"]).position[..., :2]
    flat = Experiment("r", TIME, position, ("mid", "tip"), "trace", Trace(TIME, 0 * TIME))
    model = pliant.chain_model(length=0.3, mass=0.1, links=3, stiffness=0.5, damping=5e-3, torque=(1e-6,))
    with pytest.raises(InputError, match="needs a chain in space"):
        fit([flat], model, ["base_tilt_x"])


def test_a_chain_that_does_not_twist_has_no_twist_ratio_to_fit():
    with pytest.raises(InputError, match="cannot twist"):
        fit([record(**EXCITED["trace"])], arm(space=True), ["twist_ratio"])
