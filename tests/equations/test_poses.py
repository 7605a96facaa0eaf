"""Recordings as settled poses: against the equilibrium, closed forms of friction, differences, a truth found again."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

import pliant.equations.poses as kernels
from pliant.compiler.twin import makes_arrays, reached
from pliant.equations.poses import TURN
from pliant.errors import InputError, SimulationError
from pliant.identification import Experiment, poses
from pliant.identification.fit import fit
from pliant.identification.from_recording import experiment
from pliant.identification.parameters import Parameter
from pliant.identification.prediction import predict
from pliant.identification.prediction_bands import prediction_band, residual_noise
from pliant.identification.sensitivity import sensitivities
from pliant.mechanics import mechanics_of
from pliant.model import Memory, Space, Station, Tendon, chain_model
from pliant.recording import make_recording
from pliant.simulation import Trace, equilibrium

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

AZIMUTHS = {"left": 0.3, "right": 2.4, "low": 4.5}
STEP = 1e-3  # s, that nothing here takes

RUBBING = ("friction", "entry_friction", "slip_share_1", "slip_angle_1")


def robot(friction=0.0, **options):
    """A hanging chain with three tendons drawn in by lengths and a fourth, to the middle, by a tension."""
    cord = {"lever": 5e-3, "friction": friction, "slip_rate": 1e-5, "taper": 0.01, "at": [0.05, 0.15]}
    tendons = [
        Tendon.at_azimuth(at, [1, 1], driven_by="displacement", name=name, pretension=-0.5, line_stiffness=3e3, **cord)
        for name, at in AZIMUTHS.items()
    ]
    tendons.append(Tendon.at_azimuth(1.0, [1, 0], driven_by="tension", name="short", **cord))
    made = chain_model(length=0.2, mass=0.02, links=2, joint_placement="midsegment", stiffness=0.02, damping=1e-3,
                       chambers=tendons, space=Space(), gravity=(0.0, 3.0, 9.0), **options)  # fmt: skip
    return made.with_(stations=[Station("middle", 0, 0.02), Station("tip", 1, 0.05, 2e-3, 1e-3)])


def recording(count, seed=1, name="b"):
    """Random inputs for so many poses; tendons go slack and taut."""
    rng = np.random.default_rng(seed)
    time = np.arange(float(count))
    drives = {key: Trace(time, 2e-3 * rng.normal(size=count)) for key in AZIMUTHS}
    drives["short"] = Trace(time, np.abs(rng.normal(size=count)))
    place = 0.1 * rng.normal(size=(count, 2, 3))
    return Experiment(name, time, place, ("middle", "tip"), "trace", drives=drives, poses=True)


def values_at(exp, row):
    return [trace.pressure[row] for trace in exp.drives.values()]


def test_poses_without_friction_are_the_equilibria_of_their_rows():
    model, exp = robot(), recording(6)
    chain = mechanics_of(model)
    x = np.array([equilibrium(model, values_at(exp, row)) for row in range(6)])
    wanted = chain.stations(x)[0]
    assert np.abs(predict(model, exp, {}, STEP)["position"] - wanted).max() < 1e-10
    slack = [values_at(exp, row)[0] * 3e3 - 0.5 for row in range(6)]
    assert min(slack) < 0.0 < max(slack)


def test_friction_holds_against_the_way_to_each_pose():
    """One joint: K theta = g T (1 + exp(-mu theta)) / 2 while pulled in, exp(+mu theta) while let out."""
    mu, K, lever = 0.5, 0.02, 5e-3
    pull = Tendon.at_azimuth(0.0, [1], driven_by="tension", name="pull", lever=lever, friction=mu, slip_rate=1e-9)
    model = chain_model(length=0.1, mass=0.01, links=1, joint_placement="midsegment", stiffness=K, damping=1e-3,
                        chambers=[pull], space=Space(), gravity=(0.0, 0.0, 0.0))  # fmt: skip
    model = model.with_(stations=[Station("tip", 0, 0.05)])
    tension = np.array([1.5, 3.0, 2.0])
    time = np.arange(3.0)
    exp = Experiment("b", time, 0.01 * np.arange(9.0).reshape(3, 1, 3), ("tip",), "trace",
                     drives={"pull": Trace(time, tension)}, poses=True)  # fmt: skip
    found = predict(model, exp, {}, STEP)["position"][:, 0]
    theta = np.arctan2(found[:, 0], found[:, 2] - model.base_length)
    for angle, T, run in zip(theta, tension, (1.0, 1.0, -1.0), strict=True):
        wanted = brentq(lambda a, T=T, run=run: K * a - lever * T * (1 + np.exp(-mu * run * a)) / 2, 0.0, 3.0)
        assert angle == pytest.approx(wanted, rel=1e-6)


def bends(tension, **cord):
    """Bend [rad] of one joint, K = 0.02 N m/rad and lever 5 mm, at each of the tensions of one tendon, in order."""
    pull = Tendon.at_azimuth(0.0, [1], driven_by="tension", name="pull", lever=5e-3, **cord)
    model = chain_model(length=0.1, mass=0.01, links=1, joint_placement="midsegment", stiffness=0.02, damping=1e-3,
                        chambers=[pull], space=Space(), gravity=(0.0, 0.0, 0.0))  # fmt: skip
    model = model.with_(stations=[Station("tip", 0, 0.05)])
    time = np.arange(float(len(tension)))
    exp = Experiment("b", time, 0.01 * np.arange(3.0 * time.size).reshape(-1, 1, 3), ("tip",), "trace",
                     drives={"pull": Trace(time, np.array(tension))}, poses=True)  # fmt: skip
    path = predict(model, exp, {}, STEP)["position"][:, 0]
    return np.arctan2(path[:, 0], path[:, 2] - model.base_length)


@pytest.mark.parametrize(("mu", "entry"), [(0.5, 0.0), (0.0, 0.4), (0.3, 0.2)])
def test_a_cycle_of_poses_is_that_of_a_capstan_and_an_entry_that_stick(mu, entry):
    """Loaded, held, unloaded, held, loaded again; the loop closes where it began, and no pose creeps."""
    tension = [1.5, 3.0, 3.0, 2.9, 2.9, 1.5, 1.5, 1.5, 3.0, 1.5, 3.0]
    angle, runs, wanted = 0.0, np.zeros(2), []
    for T in tension:

        def moved(a, last=angle, runs=runs):
            return np.clip(runs + np.array([1.0, 0.5]) * (a - last) / TURN, -1.0, 1.0)

        def net(a, T=T, moved=moved):
            into, along = moved(a)
            return 0.02 * a - 5e-3 * (T - into * min(entry, T)) * (1.0 + np.exp(-mu * along * a)) / 2.0

        angle, runs = (end := brentq(net, -1.0, 3.0, xtol=1e-14)), moved(end)
        wanted.append(end)
    found = bends(tension, friction=mu, entry_friction=entry)
    assert found == pytest.approx(wanted, abs=1e-8)
    assert found[2] == pytest.approx(found[1], abs=1e-9)  # held: no creep
    assert found[3] == pytest.approx(found[1], abs=2 * TURN)  # sticks
    assert found[7] == pytest.approx(found[5], abs=1e-9)
    assert found[5] - found[0] > 0.02  # the bend that friction keeps
    assert found[[9, 10]] == pytest.approx(found[[5, 8]], abs=1e-6)  # a loop, and no drift
    free = [5e-3 * T / 0.02 for T in tension]
    assert found[0] < free[0] < found[5]


def test_a_joint_with_slip_keeps_a_bend_once_nothing_pulls():
    """One joint with K = 0.02 N m/rad and one slip element of half of it that slips at 0.1 rad: its loop, by hand."""
    pull = Tendon.at_azimuth(0.7, [1], driven_by="tension", name="pull", lever=5e-3)
    slip = Memory(slip_share=(0.5,), slip_angle=(0.1,))
    model = chain_model(length=0.1, mass=0.01, links=1, joint_placement="midsegment", stiffness=0.02, damping=1e-3,
                        chambers=[pull], space=Space(), memory=slip)  # fmt: skip
    model = model.with_(stations=[Station("tip", 0, 0.05)])
    torque = np.array([0.001, 0.003, 0.007, 0.007, 0.006, 0.0, 0.0, 0.007])  # sticks, slips, held, back, back to none
    exp = Experiment("b", np.arange(8.0), 0.01 * np.arange(24.0).reshape(8, 1, 3), ("tip",), "trace",
                     drives={"pull": Trace(np.arange(8.0), torque / 5e-3)}, poses=True)  # fmt: skip
    found = predict(model, exp, {}, STEP)["position"][:, 0]
    bend = np.arctan2(np.hypot(found[:, 0], found[:, 1]), found[:, 2] - model.base_length)
    wanted = [0.001 / 0.03, 0.1, 0.3, 0.3, 0.3 - 0.001 / 0.03, 0.001 / 0.02, 0.001 / 0.02, 0.3]
    assert bend == pytest.approx(wanted, abs=1e-9)
    assert np.arctan2(found[:, 1], found[:, 0]) == pytest.approx(0.7, abs=1e-9)


PARAMETERS = {
    "stiffness": 0.02, "left.lever": 5e-3, "right.pretension": -0.5, "low.gain_x": 0.9, "friction": 0.3,
    "left.line_stiffness": 3e3, "base_tilt_x": 0.1, "base_tilt_z": -0.2, "tip.along": 0.05, "base_z": 0.01,
    "mass": 0.02, "low.taper": 0.02, "entry_friction": 0.2, "spacing": 0.02,
    "slip_share_1": 0.4, "slip_angle_1": 0.02,
}  # fmt: skip


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_derivatives_against_differences(friction):
    """Of the pose itself and, where it rubs, of the way that led there."""
    slip = Memory(slip_share=(0.4,), slip_angle=(0.02,)) if friction else Memory()
    model, exp = robot(friction, memory=slip), recording(4)
    values = {name: value for name, value in PARAMETERS.items() if friction or name not in RUBBING}
    sizes = {name: max(abs(value), 1e-2) for name, value in values.items()}
    rows, slopes = sensitivities(model, exp, values, sizes, STEP)
    assert np.abs(rows - predict(model, exp, values, STEP)["position"]).max() < 1e-14
    for name, slope in zip(values, slopes, strict=True):
        h = 1e-4 * sizes[name]
        ends = [predict(model, exp, {**values, name: values[name] + d}, STEP)["position"] for d in (-h, h)]
        wanted = (ends[1] - ends[0]) / (2 * h)
        assert np.abs(slope - wanted).max() < 1e-5 * np.abs(wanted).max(), name


@pytest.mark.slow
def test_parameters_are_found_again_from_poses_of_the_equilibrium():
    truth, blind = robot(), robot()
    exp = recording(40, seed=3)
    chain = mechanics_of(truth)
    x = np.array([equilibrium(truth, values_at(exp, row)) for row in range(40)])
    place = chain.stations(x)[0] + 1e-4 * np.random.default_rng(4).normal(size=(40, 2, 3))
    seen = Experiment("b", exp.time, place, exp.stations, "trace", drives=exp.drives, poses=True)
    given = {"stiffness": (0.02, 0.03), "left.pretension": (-0.5, 0.0), "right.gain_y": (np.cos(2.4), -0.5),
             "taper": (0.01, 0.0)}  # fmt: skip
    found = fit([seen], blind, [Parameter(name, start) for name, (_, start) in given.items()], time_step=STEP, starts=1)
    for p in found.parameters:
        assert p.std is not None
        assert abs(p.value - given[p.name][0]) < 4.0 * p.std
        assert p.std < 0.05 * abs(given[p.name][0])
    assert found.rmse["b"] == pytest.approx(np.sqrt(3.0) * 1e-4, rel=0.15)
    lone = Experiment("lone", seen.time[:1], place[:1], seen.stations, "trace", drives=seen.drives, poses=True)
    modelled = predict(blind, lone, found.values, STEP)["compared"]
    noise = residual_noise([seen], found, lone, modelled, weighting="metre")
    assert noise == pytest.approx(1e-4, rel=0.3)  # that of the places above
    band = prediction_band(lone, found, noise=noise, training=[seen])
    assert (band.std > noise).all()
    assert (band.std < 1.5 * noise).all()


def test_a_pose_without_a_stable_rest_is_named(monkeypatch):
    monkeypatch.setattr(poses, "twin", lambda kernel: kernel)
    monkeypatch.setattr(kernels, "ROUNDS", 1)
    with pytest.raises(SimulationError, match="pose 1 of 2 has no stable equilibrium"):
        predict(robot(), recording(2), {}, STEP)


def test_kernels_of_poses_make_no_arrays():
    assert not [k for k in reached(kernels.settle_all) | reached(kernels.show_all) if makes_arrays(k)]


def test_poses_are_those_of_a_body_in_space_under_measured_inputs():
    exp = recording(2)
    flat = chain_model(length=0.1, mass=0.01, links=2, stiffness=0.02, damping=1e-3, torque=(1e-6,))
    alone = Experiment("b", exp.time, exp.position, exp.stations, "trace", exp.drives["left"], poses=True)
    with pytest.raises(InputError, match="poses need a model in space"):
        predict(flat, alone, {}, STEP)
    with pytest.raises(InputError, match="poses need a body in space under measured inputs"):
        Experiment("b", exp.time, exp.position, exp.stations, "release", poses=True)
    with pytest.raises(InputError, match="was seen in no pose"):
        Experiment("b", exp.time, np.nan * exp.position, exp.stations, "trace", drives=exp.drives, poses=True)


def test_a_body_that_stands_still_is_one_pose_under_stated_inputs():
    place = np.array([0.01, 0.02, 0.3]) + np.array([-1e-4, 0.0, 5e-2])[:, None, None] * np.ones((3, 1, 3))
    still = make_recording(time=np.arange(3.0), position=place, station=["tip"], frame="spatial")
    made = experiment("still", still, poses="median", inputs={"pull": 3.0})
    assert made.poses
    assert made.position == pytest.approx(np.array([[[0.01, 0.02, 0.3]]]))
    assert made.drives["pull"](made.time) == pytest.approx(3.0)
    assert made.travel == pytest.approx(np.linalg.norm([0.01, 0.02, 0.3]))
