"""The family of laboratories: its ranges, its damping law, and that each seed is another one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.testbed import SCENARIOS, family_member, generate
from pliant.testbed.family import FAMILY, FREQUENCY, PRESSURE, RELAXING, SLOW, drawn, member, springpot
from pliant.testbed.plant import Plant
from pliant.testbed.rod import actuator
from pliant.testbed.valve import Iso6358, SupplyRegulator

MEMBERS = [family_member(seed) for seed in range(60)]
BRIEF = replace(SCENARIOS["pulse_119"], duration=0.3)


def test_draws_fill_their_ranges():
    rows = [drawn(seed, 0) for seed in range(300)]
    for name, d in FAMILY.items():
        values = np.array([row[name] for row in rows])
        assert d.low <= values.min() < values.max() <= d.high
        share = np.log(values / d.low) / np.log(d.high / d.low) if d.log else (values - d.low) / (d.high - d.low)
        assert np.abs(np.quantile(share, [0.25, 0.5, 0.75]) - [0.25, 0.5, 0.75]).max() < 0.12, name
        assert d.source


def test_members_are_bodies_that_somebody_would_build_and_no_two_alike():
    assert all(FREQUENCY[0] < m.frequency < FREQUENCY[1] and PRESSURE[0] < m.pressure < PRESSURE[1] for m in MEMBERS)
    assert len({m.body for m in MEMBERS}) == len({m.fibre for m in MEMBERS}) == 60
    assert 3 < sum(isinstance(m.valve, Iso6358) for m in MEMBERS) < 30
    assert all(m.body.cap_curvature >= 50.0 for m in MEMBERS)


def test_the_loss_factor_at_the_first_mode_is_the_drawn_one():
    """From the complex modulus of viscous part and branches, where creep alone does not lose more."""
    exact = 0
    for m in MEMBERS:
        w, b = 2 * np.pi * m.frequency, m.body
        s = 1j * w * np.array(b.prony_time)
        modulus = 1.0 + 1j * w * b.loss_time + np.sum(np.array(b.prony_share) * s / (1.0 + s))
        loss = modulus.imag / modulus.real
        assert loss >= m.loss_factor * (1 - 1e-9)
        exact += abs(loss / m.loss_factor - 1) < 1e-9
        late = sum(x for x, t in zip(b.prony_share, b.prony_time, strict=True) if t > SLOW)
        assert late <= RELAXING + FAMILY["creep"].high + 1e-9
    assert exact > 50


@pytest.mark.parametrize("order", [0.15, 0.3, 0.45])
def test_springpot_branches_follow_the_power_law(order):
    """Loss over frequency against w^order in the middle of the band; 8 branches are half a decade apart."""
    share, times = springpot(order, 0.05, 10.0)
    w = np.geomspace(0.5, 80.0, 30)
    x = np.outer(w, times)
    loss = (share * x / (1 + x**2)).sum(axis=1)
    slope = np.polyfit(np.log(w), np.log(loss), 1)[0]
    assert slope == pytest.approx(order, abs=0.06)
    x = 10.0 * times
    assert float(np.sum(share * x / (1 + x**2))) == pytest.approx(0.05, rel=1e-12)


def test_a_member_records_with_its_own_instruments_at_its_own_pressure():
    who = MEMBERS[3]
    made = generate(BRIEF, 3, 1)
    assert made.recording.attrs["actuator"] == "3"
    assert made.recording.attrs["body_length"] == who.body.length
    assert np.median(np.diff(made.recording["time"])) == pytest.approx(1 / who.rate, rel=1e-3)
    assert made.truth["pressure"].max() < 1.5 * who.pressure * 119 / 180
    assert np.ptp(made.truth["position"].values[:, -1], axis=0).max() > 0.02 * who.body.length
    assert generate(BRIEF, "3", 1).recording.identical(made.recording)


def test_named_actuators_are_as_they_were():
    assert member("b").body == actuator("b")
    assert member("b").adapted(BRIEF) is BRIEF
    assert member("b").valve == SupplyRegulator()
    assert "body_length" not in generate(replace(BRIEF, duration=0.05), "b", 1).recording.attrs


def test_what_is_no_member_is_refused():
    for name in ("d", "", "-1", "1.5"):
        with pytest.raises(InputError, match="unknown actuator"):
            member(name)
    with pytest.raises(InputError, match=">= 0"):
        family_member(-1)
    spool = next(m for m in MEMBERS if isinstance(m.valve, Iso6358))
    with pytest.raises(InputError, match="spool"):
        Plant(spool)
    assert Plant(spool, valve=SupplyRegulator()).parameters == spool.body
