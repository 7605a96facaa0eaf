"""Branches that find no agreement with the motion end a march, a step and a hold, whoever asked for them."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.actuators import chen2018
from pliant.equations.memory import step_with_memory
from pliant.equations.symbols import Past
from pliant.errors import SimulationError
from pliant.mechanics import mechanics_of
from pliant.model import Memory
from pliant.simulation import Pulse, Stepper, initial_value, march_loops, simulate, stepper

MODEL = chen2018.model(links=2).with_(memory=Memory(slip_share=(0.2,), slip_angle=(0.01,)))


@pytest.fixture(params=[1, 4])
def failing(request, monkeypatch):
    """The loops as plain text, whose branches agree until the step of that index; the body moves on quietly."""
    number, count = request.param, []

    def fails(phi, w, h, torque, body, joints, past, work):
        count.append(0)
        taken = step_with_memory(phi, w, h, torque, body, joints, past, work)
        return -1.0 if len(count) == number + 1 else taken

    monkeypatch.setattr(march_loops, "step_with_memory", fails)
    for module in (initial_value, stepper):
        monkeypatch.setattr(module, "twin", lambda kernel, *_: kernel)
    return number, count


def test_a_march_names_the_time_and_the_step(failing):
    words = f"{1e-3 * (failing[0] + 1):.6g} s after the start the iteration .* does not converge .* step of 1 ms"
    with pytest.raises(SimulationError, match=words):
        simulate(MODEL, Pulse(3e4, 0.0, 1.0), times=1e-3 * np.arange(9), time_step=1e-3)


def test_a_stepper_stops_there(failing):
    number, count = failing
    arm = Stepper(MODEL, 1e-3)
    count.clear()  # it has taken a step of no time, to compile
    began = arm.time
    with pytest.raises(SimulationError, match="use a shorter step"):
        arm.step(3e4, steps=9)
    assert arm.time - began == pytest.approx(1e-3 * (number + 1))


def test_a_held_step_says_so(failing):
    number, count = failing
    arm, past = Stepper(MODEL, 1e-3), Past(MODEL.memory.law(), np.zeros((2, 1)), mechanics_of(MODEL).held())
    count.clear()
    phi, w, command = np.zeros(2), np.zeros(2), np.array([3e4])
    chain, work = (mechanics_of(MODEL).body, mechanics_of(MODEL).joints), mechanics_of(MODEL).workspace()
    ended = [
        march_loops.held_step_with_memory(phi, w, 1e-3, command, arm._drives, chain, past, work) for _ in range(5)
    ]
    assert ended == [-1 if k == number else 0 for k in range(5)]
