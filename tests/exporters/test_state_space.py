"""State space: files that others read, creep's states against the stepped model."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import pliant
from pliant.actuators import chen2018
from pliant.exporters.state_space import control_system, linear_model, matrices
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, Memory, Valve, chain_model
from pliant.simulation import Stepper


def test_a_library_takes_what_linearise_gives():
    from scipy.signal import StateSpace

    linear = pliant.linearise(chen2018.model(), 5e4)
    system = StateSpace(linear.A, linear.B, linear.C, linear.D)
    assert system.inputs == 1
    assert linear.B.shape == (10, 1)
    assert linear.D.shape == (8, 1)


def test_creep_as_states_follows_small_steps():
    """A step of 200 Pa about a rest under pressure, over seconds in which creep flows."""
    model = chen2018.model(
        gravity=[1.0, -9.0], torque=[6.6e-7, 5e-13], stiffening=-0.2,
        memory=Memory(creep_share=(0.3, 0.2), creep_time=(0.05, 0.8)), valve=Valve(rise_time=0.02, fall_time=0.02),
    )
    from scipy.linalg import expm

    linear, h = linear_model(model, 6e4), 1e-3
    N = linear.A.shape[0]
    block = np.zeros((N + 1, N + 1))
    block[:N, :N], block[:N, N] = linear.A, linear.B[:, 0] * 200.0
    move = expm(block * h)
    x, stepper = np.zeros(N), Stepper(model, h, 6e4)
    rest = stepper.angle.copy()
    worst = size = 0.0
    for _ in range(1500):
        x = move[:N, :N] @ x + move[:N, N]
        stepper.step(60200.0)
        worst = max(worst, np.abs(stepper.angle - rest - x[:5]).max())
        size = max(size, np.abs(x[:5]).max())
    assert worst < 5e-3 * size
    flowed = pliant.linearise(model, 6e4)
    assert abs(linear.static_gain("angle_sum")) > 1.3 * abs(flowed.static_gain("angle_sum"))


@pytest.mark.parametrize("suffix", [".mat", ".npz"])
@pytest.mark.parametrize("period", [0.0, 4e-3])
def test_files_hold_everything(model, suffix, period, tmp_path):
    model = model.with_(memory=Memory(creep_share=(0.1,), creep_time=(1.0,)))
    path = tmp_path / f"arm{suffix}"
    pliant.export(model, "state-space", path, pressure=5e4, period=period)
    if suffix == ".npz":
        found = dict(np.load(path))
        names = list(found["state"])
        told = json.loads(str(found["pliant"]))
    else:
        from scipy.io import loadmat

        found = loadmat(path, squeeze_me=True)
        names = list(found["state"])
        told = json.loads(str(found["pliant"]))
    N = len(names)
    B, D = (np.reshape(found[k], (-1, 1)) for k in "BD")
    assert found["A"].shape == (N, N)
    assert B.shape == (N, 1)
    assert D.shape == (found["C"].shape[0], 1)
    assert not D.any()
    assert told["name"] == model.name
    assert found["operating_state"][: model.n] == pytest.approx(
        mechanics_of(model).coordinates(pliant.equilibrium(model, 5e4)), abs=1e-12
    )
    assert len(found["state_unit"]) == N
    assert float(np.squeeze(found["dead_time"])) == (0.0 if period else model.valve.dead_time)
    gain = linear_model(model, 5e4).static_gain("tip_y")
    inverse = np.eye(N) - found["A"] if period else -found["A"]
    assert float(found["C"][1] @ np.linalg.solve(inverse, B[:, 0])) == pytest.approx(gain, rel=1e-8)


def test_a_body_that_lengthens_and_creeps_follows_small_steps(tmp_path):
    """Read back from its file: a step of 200 Pa, its strain and its tip against the stepped model."""
    from scipy.linalg import expm

    beside = Chamber.at_offset(2e-4, 0.02, np.ones(3), valve=Valve(rise_time=0.02, fall_time=0.02))
    model = chain_model(
        length=0.2, mass=0.1, links=3, stiffness=1.0, damping=0.01, chambers=(beside,), gravity=[1.0, -9.0],
        extensions=(Extension(150.0, 0.4, name="arm"),), memory=Memory(creep_share=(0.3,), creep_time=(0.1,)),
    )
    path, h = tmp_path / "arm.npz", 1e-3
    pliant.export(model, "state-space", path, pressure=3e4)
    kept = np.load(path)
    states, outputs = list(kept["state"]), list(kept["output"])
    units = dict(zip(states, kept["state_unit"], strict=True))
    assert (units["strain_arm"], units["strain_rate_arm"]) == ("1", "1/s")
    assert kept["output_unit"][outputs.index("strain_arm")] == "1"
    stepper = Stepper(model, h, 3e4)
    strain, tip = stepper.strain.copy(), stepper.tips()[-1]
    assert kept["operating_state"][states.index("strain_arm")] == pytest.approx(strain[0], rel=1e-12)
    N = len(states)
    block = np.zeros((N + 1, N + 1))
    block[:N, :N], block[:N, N] = kept["A"], kept["B"][:, 0] * 200.0
    move, x, far = expm(block * h), np.zeros(N), []
    for _ in range(600):
        x = move[:N, :N] @ x + move[:N, N]
        stepper.step(30200.0)
        moved = np.append(stepper.tips()[-1] - tip, stepper.strain - strain)
        far.append((moved, kept["C"][[0, 1, outputs.index("strain_arm")]] @ x))
    real, linear = np.moveaxis(far, 1, 0)
    assert (np.abs(real - linear).max(axis=0) < 1e-2 * np.abs(real).max(axis=0)).all()


def test_python_control_takes_it():
    control = pytest.importorskip("control", reason="python-control is not installed: pip install 'pliant[export]'")
    model = chen2018.model(valve=Valve(dead_time=0.01))
    system = control_system(model, 5e4)
    assert system.dcgain()[0, 0] == pytest.approx(linear_model(model, 5e4).static_gain("tip_x"))
    sampled = control_system(model, 5e4, 4e-3)
    assert sampled.dt == 4e-3
    assert sampled.dcgain()[0, 0] == pytest.approx(system.dcgain()[0, 0])
    assert sampled.state_labels[-1] == "command_3_periods_ago"
    assert control.isdtime(sampled, strict=True)


LAG = Valve(rise_time=0.02, fall_time=0.02)
DEAD = (6e-3, 2e-3, 0.0)  # s: one and a half periods, half a period, none


def body_of(chambers, lengthens):
    """Four links under so many chambers, every one behind another dead time; two segments may lengthen."""
    valves = replace(LAG, dead_time=DEAD[0]), Valve(dead_time=DEAD[1]), replace(LAG, dead_time=DEAD[2])
    gains = ([1, 1, 0, 0], [-1, -1, -0.5, 0], [0, 0, 1, 1])
    extensions = (Extension(150.0, 0.4, 0.0, 0.1, "near"), Extension(120.0, 0.3, 0.1, None, "far"))
    if lengthens:
        each = [Chamber.at_offset(2e-4, 0.02 * np.sign(g[0] + g[3]), np.abs(g) > 0, valve=v, name=f"c.{k}")
                for k, (g, v) in enumerate(zip(gains, valves, strict=True))]  # fmt: skip
    else:
        each = [Chamber([4e-6], joint_gain=g, valve=v, name=f"c.{k}")
                for k, (g, v) in enumerate(zip(gains, valves, strict=True))]  # fmt: skip
    return chain_model(
        length=0.2, mass=0.2, links=4, joint_placement="midsegment", stiffness=1.0, damping=0.02,
        chambers=each[:chambers], gravity=[1.0, -9.0], extensions=extensions if lengthens else (),
    )


def stepped(body, at, commands, period, fine=40):
    """Outputs of the nonlinear model, against its rest, under commands (K, C), delayed by hand."""
    bare = body.with_(chambers=tuple(replace(c, valve=replace(c.valve, dead_time=0.0)) for c in body.chambers))
    stepper, late = Stepper(bare, period / fine, at), [round(fine * c.valve.dead_time / period) for c in body.chambers]

    def outputs():
        x = np.append(stepper.angle, stepper.strain)
        return np.concatenate([stepper.tips()[-1], [x[body.n - 1]], mechanics_of(bare).joint_coordinates(x)])

    rest, rows = outputs(), []
    for k in range(len(commands)):
        rows.append(outputs() - rest)
        for j in range(k * fine, (k + 1) * fine):
            sent = [(j - d) // fine for d in late]
            stepper.step(at + np.array([commands[s, c] if s >= 0 else 0.0 for c, s in enumerate(sent)]))
    return np.array(rows)


@pytest.mark.parametrize("lengthens", [False, True], ids=["fixed", "lengthens"])
@pytest.mark.parametrize("chambers", [1, 2, 3])
def test_python_control_steps_every_chamber_as_the_model_moves(chambers, lengthens):
    """Steps of 20 Pa of one chamber after the other, by python-control and on the whole model."""
    control = pytest.importorskip("control", reason="python-control is not installed: pip install 'pliant[export]'")
    body, at, period = body_of(chambers, lengthens), np.array([3e4, 1e4, 2e4])[:chambers], 4e-3
    system = control_system(body, at, period)
    names = [f"pressure_c_{k}" for k in range(chambers)] if chambers > 1 else ["pressure"]
    assert (system.ninputs, system.input_labels) == (chambers, names)
    assert np.shape(system.B) == (len(system.state_labels), chambers)
    waiting = [name for name in system.state_labels if name.startswith("command")]
    assert len(waiting) == [2, 3, 3][chambers - 1]
    assert len(set(system.state_labels)) == len(system.state_labels)
    continuous = control_system(body, at)
    np.testing.assert_allclose(system.dcgain(), continuous.dcgain(), rtol=1e-8, atol=1e-12)
    told = matrices(body, at, period)
    assert told["dead_time"].tolist() == [0.0] * chambers
    held = dict(zip(told["state"], told["operating_state"], strict=True))
    assert [held[name] for name in held if name.startswith("command")] == [3e4, 3e4, 1e4][: len(waiting)]
    count = 20
    commands = 20.0 * (np.arange(count * chambers)[:, None] >= count * np.arange(chambers))
    clock = period * np.arange(len(commands))
    found = control.forced_response(system, clock, commands.T).outputs.reshape(len(system.output_labels), -1).T
    real = stepped(body, at, commands, period)
    assert (np.abs(found - real).max(axis=0) <= 5e-3 * np.abs(real).max(axis=0)).all()


def test_every_chamber_is_an_input(tmp_path):
    valve = Valve(rise_time=0.02, fall_time=0.02, dead_time=5e-3)
    low = Chamber([6e-7], joint_gain=[1, 1, 1, 0, 0], name="low", valve=valve)
    body = chen2018.model().with_(chambers=(low, Chamber([5e-7], joint_gain=[0, 0, 0, 1, 1], name="high")))
    path = tmp_path / "arm.npz"
    pliant.export(body, "state-space", path, pressure=[2e4, 5e4])
    found = np.load(path)
    assert found["B"].shape == (11, 2)
    assert found["input"].tolist() == ["pressure_low", "pressure_high"]
    assert found["dead_time"].tolist() == [5e-3, 0.0]
    assert found["operating_input"].tolist() == [2e4, 5e4]
    assert found["operating_state"][list(found["state"]).index("pressure_low")] == 2e4
    with pytest.raises(pliant.InputError, match="separated by commas, got 'fast'"):
        pliant.export(body, "state-space", path, pressure="fast")
