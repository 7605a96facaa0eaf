"""Energy that appears or disappears is reported, and a motion that keeps it is not."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest

import pliant
from pliant.actuators import chen2018
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.simulation.accuracy import AccuracyWarning
from pliant.simulation.balance import EnergyWarning, energy_defects

HEAVY = Model(
    link_length=[0.02] * 3, link_mass=[0.7] * 3, stiffness=[2.2] * 3, damping=0.0, torque=[1e-6], tip_mass=1.9
)
BENT = np.array([0.6, -0.6, 0.6])


def test_a_chain_that_gains_energy_is_reported():
    with pytest.warns(AccuracyWarning, match="of its energy without a source: the step of 0.5 ms is too long"):
        motion = pliant.simulate(HEAVY, pliant.Step(0.0), duration=3.0, time_step=5e-4, initial_angle=BENT)
    total = motion.kinetic_energy + motion.elastic_energy
    assert motion.attrs["energy_gain"] > 0.01
    assert motion.attrs["energy_gain"] == pytest.approx(float((total.max() - total[0]) / total.max()), rel=0.5)


def test_a_shorter_step_is_the_cure():
    motion = pliant.simulate(HEAVY, pliant.Step(0.0), duration=1.0, time_step=5e-5, initial_angle=BENT, check=False)
    assert motion.attrs["energy_gain"] < 2e-3


def test_a_stepper_reports_it_too():
    stepper = pliant.Stepper(HEAVY, time_step=5e-4)
    stepper.angle[:] = mechanics_of(HEAVY).coordinates(BENT)
    with pytest.warns(EnergyWarning, match="of its energy without a source: the step of 0.5 ms"):
        deque((stepper.step(0.0) for _ in range(6000)), maxlen=0)
    assert stepper.energy_gain > 0.01


@pytest.mark.parametrize("pressure", [0.0, 8e4])
@pytest.mark.parametrize("damping", [1e-4, 7.8e-3])
def test_a_motion_that_keeps_its_energy_is_not_reported(pressure, damping):
    """Under a held pressure, under a changing one, and under a force that comes and goes."""
    model = chen2018.model(damping=damping)
    stepper = pliant.Stepper(model, time_step=2e-4)
    for k in range(60):
        stepper.push(np.array([0.0, 0.02 * (k % 3)]))
        stepper.step(pressure * (1 + k % 4), 50)
    assert max(stepper.energy_gain, stepper.energy_loss) < 5e-3
    motion = pliant.simulate(model, pliant.Pulse(level=119e3, start=0.1, width=0.4), duration=1.5)
    assert max(motion.attrs["energy_gain"], motion.attrs["energy_loss"]) < 2e-3


def energy(model: Model, q: np.ndarray, dq: np.ndarray) -> float:
    """Energy of a chain of one chamber without gravity by its definition, J."""
    x, v = mechanics_of(model).coordinates(q), np.cumsum(dq)
    return float(0.5 * v @ mechanics_of(model).inertia(x) @ v + 0.5 * model.stiffness @ q**2)


def test_a_stepper_balances_what_the_dampers_take():
    """The balance against energies by their definitions: work of a held pressure less the losses."""
    model = chen2018.model()
    stepper = pliant.Stepper(model, time_step=1e-3)
    stepper.step(5e4, 50)
    q, dq = mechanics_of(model).joint_angles(stepper.angle), np.diff(stepper.rate, prepend=0.0)
    before, total = energy(model, q, dq), stepper._watch.total.copy()
    motion = pliant.simulate(model, pliant.Step(5e4), duration=0.2, initial_angle=q, initial_rate=dq, time_step=1e-3)
    stepper.step(5e4, 200)
    after = energy(model, mechanics_of(model).joint_angles(stepper.angle), np.diff(stepper.rate, prepend=0.0))
    work, dampers, _ = stepper._watch.total - total
    assert after - before == pytest.approx(work - dampers, rel=1e-2)
    assert dampers == pytest.approx(float(motion.dissipated_energy[-1]), rel=1e-9)


def test_nothing_at_all_gains_nothing():
    motion = pliant.simulate(chen2018.model(), pliant.Step(0.0), duration=0.1)
    assert energy_defects(motion) == (0.0, 0.0)
