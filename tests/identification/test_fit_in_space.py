"""Fits of a chain in space: derivatives against differences, parameters found again from another's motion."""

import numpy as np
import pytest

import pliant
from pliant.errors import InputError
from pliant.identification.experiment import Experiment
from pliant.identification.fit import fit
from pliant.identification.prediction import predict
from pliant.identification.sensitivity import sensitivities
from pliant.model import Chamber, Space, Station, Tendon
from pliant.simulation import Trace
from pliant.simulation.forces import PointForce

LINKS, STEP = 3, 4e-3
TIME = np.arange(0.0, 0.6, 0.02)
AZIMUTHS = {"red": 1.5, "green": 3.6, "blue": 5.7}
TRACES = {name: Trace(TIME, 30e3 * (1.0 + np.sin(2 * np.pi * f * TIME + f)))
          for name, f in zip(AZIMUTHS, (0.9, 1.7, 2.3), strict=True)}  # fmt: skip
SOUND = {
    "stiffness": 0.6, "damping": 6e-3, "cubic_stiffening": 0.3, "stiffness_ratio": 1.3, "twist_ratio": 0.8,
    "mass": 0.09, "base_tilt_x": 0.05, "base_tilt_y": -0.08, "rest_turn_x_2": 0.06, "rest_turn_z_1": -0.1,
    "tip_mass": 0.004,
    "red.gain_x": 1.1, "red.gain_y": -0.2, "green.cross_gain_2": 0.7, "blue.joint_gain_1": -0.4, "red.torque_1": 2.1e-6,
    "green.valve_rise": 0.03, "base_z": 1e-3, "base_x": -2e-3, "tip.aside": 3e-3, "mid.across": 1e-3, "mid.along": 0.05,
    "latency": 4e-3, "sensor_lag": 0.02, "start": 2e-3,
}  # fmt: skip


def arm(**more):
    chambers = [Chamber(torque=(2e-6,), joint_gain=np.sin(a), cross_gain=-np.cos(a), name=name)
                for name, a in AZIMUTHS.items()]  # fmt: skip
    values = {
        "length": 0.3, "mass": 0.1, "links": LINKS, "joint_placement": "midsegment", "stiffness": 0.5, "damping": 5e-3,
        "chambers": chambers, "gravity": (1.0, 0.5, -9.81),
        "space": Space(stiffness_ratio=1.2, twist_ratio=0.7, radius=0.02),
        "stations": [Station("mid", 1, 0.04, 0.0, 0.01), Station("tip", 2, 0.05)],
    }  # fmt: skip
    return pliant.chain_model(**(values | more))


def record(position=None, *, name="r", **more):
    still = np.tile([0.0, 0.0, 0.1], (TIME.size, 2, 1))
    still[:, 1, 0] += np.linspace(0, 0.1, TIME.size)
    return Experiment(name, TIME, still if position is None else position, ("mid", "tip"), **more)


EXCITED = {
    "trace": {"excitation": "trace", "drives": TRACES},
    "own_places": {"excitation": "trace", "drives": TRACES, "own_places": True},
    "release": {"excitation": "release"},
    "held": {"excitation": "release", "held": np.array([[0.01, -0.01, 0.18], [0.05, -0.03, 0.28]])},
    "tendons": {"excitation": "trace", "drives": {n: Trace(TIME, 1e-7 * t.pressure) for n, t in TRACES.items()}},
    "forces": {"excitation": "trace", "drives": TRACES,
               "forces": (PointForce(np.array([0.0, 1.0]), np.array([[0.0, 0.1, 0.0], [0.2, 0.0, 0.1]]), "tip"),)},
}  # fmt: skip


@pytest.mark.slow  # compiles the motion on dual numbers
@pytest.mark.parametrize("kind", EXCITED)
def test_derivatives_of_a_motion_in_space_are_those_of_differences(kind):
    exp, values, model = record(**EXCITED[kind]), dict(SOUND), arm()
    if kind in ("release", "held"):
        values |= {"release": 0.13, "release_time": 0.05} | ({} if kind == "held" else {"hold_force": 0.3})
        del values["start"]
    if kind == "held":  # few joints, whose pose two points decide
        places = [Station("mid", 0, 0.11, 0.0, 0.01), Station("tip", 1, 0.07)]
        model = arm(links=2, space=Space(stiffness_ratio=1.2), stations=places)
        del values["twist_ratio"]
    if kind == "tendons":
        cord = {"driven_by": "displacement", "lever": 8e-3, "line_stiffness": 2e3, "pretension": 0.5}
        cords = [Tendon.at_azimuth(a, np.ones(LINKS), name=n, pair=n == "red", **cord) for n, a in AZIMUTHS.items()]
        model = arm(chambers=cords)
        values |= {"line_stiffness": 1.8e3, "blue.pretension": 0.3, "green.lever": 7e-3}
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


@pytest.mark.slow
def test_stiffnesses_twist_and_azimuths_are_found_again():
    """The recording comes from a chain of twice as many links, so that the fit's own equations did not make it."""
    rng = np.random.default_rng(1)
    time = np.arange(0.0, 2.0, 0.02)
    traces = [Trace(time, 40e3 * (1 + np.sin(2 * np.pi * f * time + f))) for f in (0.7, 1.1, 1.9)]
    places = [Station("mid", 2, 0.05), Station("tip", 5, 0.025)]
    finer = arm(links=2 * LINKS, stiffness=2 * 0.5, damping=2 * 5e-3, stations=places)
    motion = pliant.simulate(finer, traces, times=time, step=STEP, check=False)
    seen = motion.station_position.values + rng.normal(0, 1e-4, (time.size, 2, 3))
    exp = Experiment("r", time, seen, ("mid", "tip"), "trace", drives=dict(zip(AZIMUTHS, traces, strict=True)))
    start = arm(stiffness=0.4, stations=[Station("mid", 1, 0.025), Station("tip", 2, 0.05)])
    gains = [f"{name}.gain_{axis}" for name in AZIMUTHS for axis in "xy"]
    result = fit([exp], start, ["damping", "stiffness", "stiffness_ratio", *gains], step=STEP)
    assert result.converged
    found = {p.name: p.value for p in result.parameters}
    assert found["stiffness_ratio"] == pytest.approx(1.2, rel=0.01)
    for name, a in AZIMUTHS.items():
        azimuth = np.arctan2(found[f"{name}.gain_x"], -found[f"{name}.gain_y"]) % (2 * np.pi)
        assert azimuth == pytest.approx(a, abs=0.02)
    assert result.rmse["r"] < 0.03 * exp.travel


@pytest.mark.parametrize(("name", "sentence"), [
    ("rest_angle", "belongs to a chain in a plane"), ("rest_turn_x_9", "joints 1 to 3"),
    ("gravity_angle", "belongs to a chain in a plane"),
])  # fmt: skip
def test_parameters_of_the_plane_are_refused_in_space(name, sentence):
    with pytest.raises(InputError, match=sentence):
        fit([record(**EXCITED["trace"])], arm(), [name])


def test_parameters_of_space_are_refused_in_the_plane():
    position = record(**EXCITED["trace"]).position[..., :2]
    flat = Experiment("r", TIME, position, ("mid", "tip"), "trace", Trace(TIME, 0 * TIME))
    model = pliant.chain_model(length=0.3, mass=0.1, links=3, stiffness=0.5, damping=5e-3, torque=(1e-6,))
    with pytest.raises(InputError, match="belongs to a chain in space"):
        fit([flat], model, ["base_tilt_x"])


def test_a_chain_that_does_not_twist_has_no_twist_ratio_to_fit():
    with pytest.raises(InputError, match="does not twist"):
        fit([record(**EXCITED["trace"])], arm(space=True), ["twist_ratio"])
