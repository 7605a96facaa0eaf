"""Energy that appears or disappears is reported, and a motion that keeps it is not."""

from __future__ import annotations

import re
import warnings
from collections import deque

import numpy as np
import pytest

import pliant
from pliant.actuators import chen2018
from pliant.mechanics import mechanics_of
from pliant.model import Memory, Model
from pliant.simulation.balance import EnergyWarning, energy_defects
from pliant.simulation.time_step import AccuracyWarning

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


LIGHT_TIP = Model(
    link_length=[0.013, 0.013, 0.076, 0.092, 0.119], link_mass=[0.011, 0.0056, 0.032, 0.0069, 0.027],
    stiffness=[0.042] * 5, damping=0.0, torque=[4e-8], gravity=[-0.26, -0.63],
    memory=Memory(creep_share=(0.36,), creep_time=(4.2,)),
)  # fmt: skip
THROWN = {"initial_angle": [0.33, 0.40, -0.29, 0.40, -0.75], "initial_rate": [-1.24, -0.54, 0.09, 0.25, -0.76]}


def test_energy_that_the_tip_does_not_show_shortens_the_step_or_is_reported():
    """Short links turn fast and hardly move the tip: its error is below 1 % where more of the energy is lost."""
    how = {"duration": 0.1, **THROWN}
    for step in (1e-3, 5e-4):
        with pytest.warns(EnergyWarning, match=r"loses .* of its energy.*use time_step=0\.0002 or leave it out"):
            motion = pliant.simulate(LIGHT_TIP, pliant.Step(0.0), time_step=step, **how)
        assert motion.attrs["energy_loss"] > 0.01
        assert motion.attrs["tip_error"] < 0.01 * LIGHT_TIP.length
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for step in (None, 2e-4):
            motion = pliant.simulate(LIGHT_TIP, pliant.Step(0.0), time_step=step, **how)
            assert max(motion.attrs["energy_gain"], motion.attrs["energy_loss"]) < 0.01
            assert motion.attrs["step_s"] == 2e-4


@pytest.mark.parametrize(("method", "more", "advice"), [
    ("extrapolated", {"time_step": 2e-3}, r"use time_step="), ("accurate", {"tolerance": 0.5}, r"use time_step="),
    ("LSODA", {"rtol": 0.1}, r"use method='accurate'"),
])  # fmt: skip
def test_every_method_keeps_the_promise(method, more, advice):
    """Each method, too coarse for this motion, reports the missing energy."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        motion = pliant.simulate(LIGHT_TIP, pliant.Step(0.0), duration=0.1, method=method, **more, **THROWN)
    assert max(motion.attrs["energy_gain"], motion.attrs["energy_loss"]) > 0.01
    (warning,) = caught
    assert issubclass(warning.category, AccuracyWarning)
    assert re.search(rf"its energy with.*{advice}", str(warning.message))


def test_energies_of_the_returned_motion_are_those_of_the_balance():
    motion = pliant.simulate(LIGHT_TIP, pliant.Step(0.0), duration=0.05, **THROWN)
    assert energy_defects(motion) == (motion.attrs["energy_gain"], motion.attrs["energy_loss"])
    assert {"memory_energy", "memory_dissipation"} <= set(motion)


def test_nothing_at_all_gains_nothing():
    motion = pliant.simulate(chen2018.model(), pliant.Step(0.0), duration=0.1)
    assert energy_defects(motion) == (0.0, 0.0)
