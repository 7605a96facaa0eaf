"""Where a fit begins: near enough to the truth, read off the recording alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pliant.identification import Experiment, Parameter, experiment
from pliant.identification.edges import edges
from pliant.identification.initial_guess import estimate, free_decay, last_jump
from pliant.model import Model, Valve, chain_model
from pliant.preprocessing.align import align
from pliant.preprocessing.clusters import assemble
from pliant.recording import read
from pliant.simulation import Trace, modes


def start_of(model: Model, exp: Experiment | list[Experiment], *names: str | Parameter) -> dict[str, float]:
    """Estimated values by name."""
    listed = [Parameter(n) if isinstance(n, str) else n for n in names]
    _, filled = estimate(model, exp if isinstance(exp, list) else [exp], listed)
    return {p.name: float(p.value) for p in filled if p.value is not None}


@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_edges_show_in_the_motion(truth: Model, pulse: Any, rng: np.random.Generator, noise: float) -> None:
    quick = truth.with_(valve=Valve())
    exp = pulse(quick, stop=0.7512, times=np.arange(0, 1.2, 0.01))
    found = edges(replace(exp, position=exp.position + noise * rng.standard_normal(exp.position.shape)))
    assert found["start"] == pytest.approx(0.1234, abs=0.03)
    assert found["stop"] == pytest.approx(0.7512, abs=0.05)


def test_a_release_shows_in_the_motion(truth: Model, released: Any) -> None:
    assert edges(released(truth.with_(gravity=[4.0, 0.0])))["release"] == pytest.approx(0.2071, abs=0.04)


def test_a_trace_needs_no_edges_but_its_last_jump_starts_the_decay(truth: Model, traced: Any) -> None:
    exp = traced(truth)
    assert edges(exp) == {}
    assert 0.5 <= last_jump(exp) <= 0.52
    noise = 200.0 * np.random.default_rng(3).standard_normal(400)
    clock = np.linspace(0, 1, 400)
    noisy = replace(exp, pressure=Trace(clock, exp.pressure(clock) + noise))
    assert 0.49 <= last_jump(noisy) <= 0.53


def test_stiffness_and_damping_come_from_the_ring_down(truth: Model, traced: Any) -> None:
    exp = traced(truth, times=np.arange(0, 1.5, 0.01))
    ring = free_decay(exp)
    assert ring is not None
    far = truth.with_(stiffness=20.0, damping=0.5)
    found = start_of(far, exp, "stiffness", "damping")
    assert found["stiffness"] == pytest.approx(0.9, rel=0.05)
    assert found["damping"] == pytest.approx(6e-3, rel=0.3)
    each = start_of(far, exp, "stiffness_1", "stiffness_3", "damping_2", "t.stiffness")
    assert [each[n] for n in ("stiffness_1", "stiffness_3", "t.stiffness")] == [found["stiffness"]] * 3
    assert each["damping_2"] == found["damping"]


def test_a_known_load_is_counted_in_the_start(truth: Model, released: Any) -> None:
    hanging = truth.with_(gravity=[6.0, 0.0])
    loaded = released(hanging, known={"tip_mass": 0.03})
    assert start_of(hanging.with_(stiffness=5.0), loaded, "stiffness")["stiffness"] == pytest.approx(0.9, rel=0.1)


def test_torque_comes_from_the_plateaus(truth: Model, traced: Any) -> None:
    curved = truth.with_(torque=[3e-7, 3e-12])
    exps = [traced(curved, "low", 6e4), traced(curved, "high", 1.5e5)]
    blank = truth.with_(torque=[0.0])
    found = start_of(blank, exps, "torque_1", "torque_2")
    assert found == pytest.approx({"torque_1": 3e-7, "torque_2": 3e-12}, rel=0.2)
    given = start_of(blank, exps, Parameter("torque_1", 3e-7, free=False), "torque_2")
    assert given["torque_2"] == pytest.approx(3e-12, rel=0.2)


def test_what_the_model_has_is_the_start_where_the_data_say_nothing(truth: Model, traced: Any) -> None:
    dead = truth.with_(damping=0.5)  # far over-damped: no ring-down
    exp = traced(dead)
    assert free_decay(exp) is None
    found = start_of(dead, exp, "stiffness", "damping", "gain", "mass", "valve_rise_time")
    assert found == pytest.approx(
        {"stiffness": 0.9, "damping": 0.5, "gain": 1.0, "mass": 0.047, "valve_rise_time": 0.02}
    )


def test_a_start_outside_its_bounds_moves_onto_them(truth: Model, traced: Any) -> None:
    assert start_of(truth, traced(truth), Parameter("stiffness", upper=0.5))["stiffness"] == 0.5


@pytest.fixture(scope="module")
def arm(shared_data: Path) -> Experiment:
    """The measured 300 mbar pulse of a silicone arm."""
    raw = read(shared_data / "pneumatic_arm_pulses" / "300mbar_V3.c3d").assign_attrs(nominal_pressure=3e4)
    clusters = {"base": [f"Base - {i}" for i in range(1, 5)], "tip": [f"Tip - {i}" for i in range(1, 4)]}
    planar = align(assemble(raw, clusters), base="base", tangent=[1.0, 0.0, 0.0], origin_offset=[0.0, 0.0355, 0.0])
    return experiment("arm", planar, stations=("tip",))


def test_a_measured_pulse_gives_sensible_starts(arm: Experiment) -> None:
    found = edges(arm)
    assert 2.5 < found["stop"] - found["start"] < 3.5  # pulses of about 3 s
    ring = free_decay(arm)
    assert ring is not None
    assert 7.0 < ring.frequency < 9.0  # about 8 Hz
    model = chain_model(length=0.102, mass=0.15, links=5, joint_placement="midsegment", gravity=[0.0, 9.81],
                        stiffness=1.0, damping=1e-3, torque=[0.0])
    start = start_of(model, arm, "stiffness", "damping", "torque_1", "tip.along")
    assert modes(model.with_(stiffness=start["stiffness"]))[0][0] == pytest.approx(ring.frequency, rel=1e-3)
    assert 0 < start["damping"] < 0.1 * start["stiffness"]
    assert start["torque_1"] > 0
    assert abs(start["tip.along"]) < 0.05
