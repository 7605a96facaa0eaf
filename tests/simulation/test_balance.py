"""Energy from nothing is told, and what is whole is not accused of it."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest

import pliant
from pliant.actuators import chen2018
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.simulation.balance import EnergyWarning, energy_gain, held_energy

HEAVY = Model(
    link_length=[0.02] * 3, link_mass=[0.7] * 3, stiffness=[2.2] * 3, damping=0.0, torque=[1e-6], tip_mass=1.9
)
BENT = np.array([0.6, -0.6, 0.6])


def test_a_chain_that_gains_energy_is_told():
    with pytest.warns(EnergyWarning, match="of its energy from nothing: the step of 0.5 ms is too long"):
        motion = pliant.simulate(HEAVY, pliant.step(0.0), duration=3.0, step=5e-4, initial_angle=BENT)
    total = motion.kinetic_energy + motion.elastic_energy
    assert motion.attrs["energy_gain"] > 0.01
    assert motion.attrs["energy_gain"] == pytest.approx(float((total.max() - total[0]) / total.max()), rel=0.5)


def test_a_shorter_step_is_the_cure():
    motion = pliant.simulate(HEAVY, pliant.step(0.0), duration=1.0, step=5e-5, initial_angle=BENT)
    assert motion.attrs["energy_gain"] < 2e-3


def test_a_stepper_tells_it_too():
    stepper = pliant.Stepper(HEAVY, step=5e-4)
    stepper.angle[:] = mechanics_of(HEAVY).coordinates(BENT)
    with pytest.warns(EnergyWarning, match="within 256 steps under 0 Pa"):
        deque((stepper.step(0.0) for _ in range(6000)), maxlen=0)
    assert stepper.energy_gain > 0.01


@pytest.mark.parametrize("pressure", [0.0, 8e4])
@pytest.mark.parametrize("damping", [0.0, 7.8e-3])
def test_a_motion_that_is_whole_is_not_accused(pressure, damping):
    """The work that a held pressure can still do counts as stored: a swing about the new rest gains nothing."""
    model = chen2018.model(damping=damping)
    stepper = pliant.Stepper(model, step=1e-3)
    for _ in range(3000):
        stepper.step(pressure)
    assert stepper.energy_gain < 2e-3
    motion = pliant.simulate(model, pliant.Pulse(level=119e3, start=0.1, width=0.4), duration=1.5)
    assert motion.attrs["energy_gain"] < 2e-3


def test_the_energy_of_a_held_pressure_falls_by_what_the_dampers_take():
    """Against the balance that `simulate` integrates: the same loss between two instants."""
    model = chen2018.model()
    stepper = pliant.Stepper(model, step=1e-3)
    for _ in range(50):
        stepper.step(5e4)
    first = held_energy(model, stepper.angle, stepper.rate, 5e4)
    q, dq = mechanics_of(model).joint_angles(stepper.angle), np.diff(stepper.rate, axis=-1, prepend=0.0)
    for _ in range(200):
        stepper.step(5e4)
    last = held_energy(model, stepper.angle, stepper.rate, 5e4)
    motion = pliant.simulate(model, pliant.step(5e4), duration=0.2, initial_angle=q, initial_rate=dq)
    assert last.energy - first.energy == pytest.approx(-float(motion.dissipated_energy[-1]), rel=1e-2)


def test_nothing_at_all_gains_nothing():
    motion = pliant.simulate(chen2018.model(), pliant.step(0.0), duration=0.1)
    assert energy_gain(motion) == 0.0
