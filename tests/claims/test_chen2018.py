"""Every number that the paper prints of its actuator and its model, and what follows from them.

Source: Y. Chen, K. C. Galloway, I. S. Godage, "Efficient Reduced-Order Models for Soft Actuators". What the
paper prints is named so in a test's docstring; everything else is computed from what it prints.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import argrelextrema

from pliant.actuators import chen2018
from pliant.equations.chamber import bladder_area, lever_arm
from pliant.mechanics import mechanics_of
from pliant.model import Valve
from pliant.simulation import Pulse, equilibrium, modes, simulate

TURN = 5 * 0.0793333 / 1.6067  # rad, of the tip at 119 kPa
PAPER_PULSE = Pulse(chen2018.PULSE_PRESSURE, chen2018.PULSE_START, chen2018.PULSE_WIDTH)


def pulse_run(pressure=PAPER_PULSE, **changes):
    return simulate(chen2018.model(**changes), pressure, duration=4.5)


@pytest.fixture(scope="module")
def run():
    """The paper's pulse with the printed K_b and D."""
    return pulse_run()


def plateau(signal, **changes):
    """Rest and pressurised value of a signal of the state, from the statics."""
    model = chen2018.model(**changes)
    rows = [mechanics_of(model).coordinates(equilibrium(model, p)) for p in (0.0, chen2018.PULSE_PRESSURE)]
    return [float(signal(mechanics_of(model).tips(phi)[-1])) for phi in rows]


def overshoot(signal, rest, held):
    """Percent of the way from rest to its final value by which a signal shoots past it."""
    return 100 * (np.max((np.asarray(signal) - rest) / (held - rest)) - 1)


def ringing(run, signal, begin=0.12, end=2.88):
    """Frequency, Hz, from the spacing of the first extrema after an edge."""
    during = (run.time.values > begin) & (run.time.values < end)
    t, y = run.time.values[during], np.asarray(signal)[during]
    peaks = np.sort(np.concatenate([argrelextrema(y, kind)[0] for kind in (np.greater, np.less)]))
    return 1 / (2 * np.diff(t[peaks[:7]]).mean())


def settling(run, signal, held, span, begin=0.12, end=2.88):
    """Time after the edge from which on a signal stays within 5 % of its change, s."""
    during = (run.time.values > begin) & (run.time.values < end)
    outside = np.abs(np.asarray(signal)[during] - held) > 0.05 * abs(span)
    return run.time.values[during][np.flatnonzero(outside)[-1]] - begin


def tip_x(run):
    return run.tip_position.values[:, -1, 0]


def test_dimensions_as_printed():
    """Printed: 17 cm, 69 g, radii of 14 and 10 mm, 212 points 0.8 mm apart, five links."""
    model = chen2018.model()
    assert model.n == 5
    assert model.length == pytest.approx(0.17)
    assert model.mass == pytest.approx(0.069)
    assert model.link_length == pytest.approx(np.full(5, 0.034))
    assert model.link_mass == pytest.approx(np.full(5, 0.0138))
    assert (chen2018.OUTER_RADIUS, chen2018.INNER_RADIUS) == (0.014, 0.010)
    assert pytest.approx(0.1688) == (chen2018.POINTS - 1) * chen2018.SPACING


def test_stiffness_and_damping_as_printed():
    """Printed: K_b = 1.6067, D = 1e-3 diag(8, 8, 8, 8, 8)."""
    model = chen2018.model()
    assert model.stiffness.tolist() == [1.6067] * 5
    assert model.damping.tolist() == [8e-3] * 5


def test_bladder_area():
    """Printed: A = pi r2^2 / 2."""
    assert bladder_area(chen2018.INNER_RADIUS) == pytest.approx(1.5708e-4, rel=1e-5)


def test_lever_arm():
    """Printed: d = 4 r2 / (3 pi)."""
    assert lever_arm(chen2018.INNER_RADIUS) == pytest.approx(4.2441e-3, rel=1e-5)


def test_torque_gain():
    """Printed: tau = p A d; A d = 2/3 r2^3."""
    assert chen2018.model().torque.tolist() == pytest.approx([6.6667e-7], rel=1e-5)
    assert chen2018.model().torque_at(119e3) == pytest.approx(0.07933, abs=5e-6)
    assert chen2018.model().torque_at(240e3) == pytest.approx(0.160, abs=5e-6)


@pytest.mark.parametrize(
    ("pressure", "degrees", "total", "tip"),
    [(119e3, 2.8291, 14.1, (-25.029, 167.729)), (240e3, 5.7057, 28.5, (-49.540, 160.863))],
)
def test_static_shape(pressure, degrees, total, tip):
    model = chen2018.model()
    q = equilibrium(model, pressure)
    assert np.degrees(q) == pytest.approx(np.full(5, degrees), abs=5e-5)
    assert np.degrees(q.sum()) == pytest.approx(total, abs=0.05)
    assert 1e3 * mechanics_of(model).tips(mechanics_of(model).coordinates(q))[-1] == pytest.approx(tip, abs=6e-4)


def test_gravity_across_the_plane_would_not_be_negligible():
    model = chen2018.model(gravity=[-9.81, 0.0], mass_at="rod")
    q = equilibrium(model)
    assert np.degrees(q[0]) == pytest.approx(2.05, abs=0.02)
    assert -1e3 * mechanics_of(model).tips(mechanics_of(model).coordinates(q))[-1, 0] == pytest.approx(11.0, abs=0.5)


def test_it_rings_at_about_5_hz(run):
    """Printed: "oscillation frequency about 5 Hz"."""
    assert ringing(run, tip_x(run)) == pytest.approx(5.00, abs=0.05)
    assert ringing(run, tip_x(run), 2.88, 4.5) == pytest.approx(5.00, abs=0.05)


def test_it_is_under_damped(run):
    """Printed: "the system is under-damped"; the first mode has a damping ratio of 0.078."""
    f, zeta = modes(chen2018.model())
    assert f[0] == pytest.approx(5.0062, abs=5e-5)
    assert zeta[0] == pytest.approx(0.078, abs=5e-4)
    during = (run.time.values > 0.12) & (run.time.values < 2.88)
    away = np.abs(tip_x(run)[during] - plateau(lambda tip: tip[0])[1])
    peaks = away[argrelextrema(away, np.greater)[0]][1:8]  # half a period apart
    decrement = -np.polyfit(np.arange(peaks.size), np.log(peaks), 1)[0]
    assert decrement / np.hypot(decrement, np.pi) == pytest.approx(0.078, abs=2e-3)


def test_overshoot_and_peak_of_the_tip(run):
    rest, held = plateau(lambda tip: tip[0])
    assert 1e3 * held == pytest.approx(-25.0, abs=0.05)
    assert 1e3 * tip_x(run).min() == pytest.approx(-42.9, abs=0.1)
    assert overshoot(tip_x(run), rest, held) == pytest.approx(71, abs=1)


def test_overshoot_of_the_tips_angle(run):
    q = run.joint_angle.values.sum(axis=1)
    assert overshoot(q, 0.0, TURN) == pytest.approx(56, abs=1)


def test_it_settles_in_about_a_second(run):
    """Printed, in the figure: it "achieves steady state" within the pulse."""
    held = plateau(lambda tip: tip[0])[1]
    assert settling(run, run.joint_angle.sum("joint"), TURN, TURN) == pytest.approx(1.02, abs=0.03)
    assert settling(run, tip_x(run), held, held) == pytest.approx(1.12, abs=0.03)
    assert tip_x(run)[run.time.values < 2.88][-1] == pytest.approx(held, abs=1e-4)


def test_it_rings_about_rest_after_release(run):
    assert tip_x(run)[run.time.values > 2.88].max() > 0.010
    assert np.abs(run.tip_position[-1] - run.tip_position[0]).max() < 0.5e-3


def test_a_pulse_of_240_kpa_rings_alike():
    big = pulse_run(Pulse(240e3, 0.12, 2.76))
    assert ringing(big, tip_x(big)) == pytest.approx(5.0, abs=0.1)
    assert overshoot(tip_x(big), 0.0, -49.540e-3) == pytest.approx(71, abs=5)


def test_with_a_bend_at_rest_of_34_degrees():
    """The paper's actuator is curved at rest, by how much it does not print."""
    changes = {"rest_angle": np.radians(34 / 5)}
    bent = pulse_run(**changes)
    rest, held = plateau(lambda tip: tip[0], **changes)
    y_rest, y_held = plateau(lambda tip: tip[1], **changes)
    assert 1e3 * np.array([rest, held, y_rest, y_held]) == pytest.approx([-58.4, -79.8, 157.1, 144.7], abs=0.05)
    assert 1e3 * tip_x(bent).min() == pytest.approx(-94.2, abs=0.1)
    assert overshoot(tip_x(bent), rest, held) == pytest.approx(67, abs=1)
    assert ringing(bent, tip_x(bent)) == pytest.approx(5.1, abs=0.06)


def test_with_links_that_are_uniform_rods():
    rods = pulse_run(mass_at="rod")
    rest, held = plateau(lambda tip: tip[0], mass_at="rod")
    assert modes(chen2018.model(mass_at="rod"))[0][0] == pytest.approx(5.9156, abs=5e-5)
    assert ringing(rods, tip_x(rods)) == pytest.approx(5.9, abs=0.06)
    assert overshoot(tip_x(rods), rest, held) == pytest.approx(66, abs=1)
    assert settling(rods, rods.joint_angle.sum("joint"), TURN, TURN) == pytest.approx(0.70, abs=0.02)


@pytest.mark.parametrize(("lag", "percent"), [(0.01, 68), (0.03, 50), (0.05, 32), (0.1, 9)])
def test_lag_of_the_valve_takes_the_overshoot(lag, percent):
    slow = pulse_run(valve=Valve(rise_time=lag, fall_time=lag))
    assert overshoot(tip_x(slow), *plateau(lambda tip: tip[0])) == pytest.approx(percent, abs=1)


def test_the_first_joint_begins_the_wrong_way(run):
    """A uniform torque throws the outer links first; the reaction turns the first joint back. The tip does not."""
    begin = (run.time.values > 0.12) & (run.time.values < 0.12 + 0.02)
    first, last = run.joint_angle.values[begin][:, 0], run.joint_angle.values[begin][:, -1]
    assert first.min() < -1e-4
    assert last.min() > 0
    assert tip_x(run)[begin].max() < 0
    assert run.joint_angle.values[run.time.values < 1.0][:, 0].max() > 0.05


def test_all_five_tips_ring_with_it(run):
    """Printed: the oscillation is seen "not only at the tip, but also along the length of the arm"."""
    for i in range(5):
        x = run.tip_position.values[:, i, 0]
        assert ringing(run, x, begin=0.3) == pytest.approx(5.0, abs=0.1)
    reach = [float(np.ptp(run.tip_position.values[:, i, 0])) for i in range(5)]
    assert np.all(np.diff(reach) > 0)
