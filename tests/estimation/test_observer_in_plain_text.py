"""The loops of the adaptive observer in plain text, against sums and recursions written out by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pliant.equations.memory import memory_angle
from pliant.estimation import adaptive_observer_loops
from pliant.estimation.adaptive_observer_loops import rest_shift
from pliant.estimation.contract import State
from pliant.model import Memory


def test_a_state_has_no_strains_unless_it_is_told():
    rest = State(1.0, np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2), np.eye(6))
    assert rest.strain.size == rest.strain_rate.size == rest.strain_shift.size == 0
    assert (rest.torque_scale, rest.fault, rest.consistent) == (1.0, "", True)
    assert not State(1.0, *[np.zeros(2)] * 4, np.eye(6), fault="off").consistent


def test_a_rest_shift_without_memory_pulls_as_the_shift_and_the_memory_do(rng):
    """K (q - own) + K r = K (1 + left) (q - shift), where all of the memory follows the joint from now on."""
    angle, own, theta0 = rng.normal(size=(3, 3))
    law = Memory((0.1, 0.2), (1.0, 2.0), (0.3,), (10.0,)).law()
    states = rng.normal(size=(3, 3)) * 0.1
    shift, left, base = np.empty(3), 0.6, 0.4
    rest_shift(angle, own, states, base, theta0, law, left, shift)
    q = np.diff(angle, prepend=base) - theta0
    held = np.array([memory_angle(i, q[i], states, law) for i in range(3)])
    np.testing.assert_allclose((1 + left) * (q - shift), q - own + held, rtol=1e-12)


@pytest.mark.parametrize(
    ("rate", "taken", "slope", "failed"),
    [
        (99.0, 0.0, 1.0, False),
        (-99.0, 3.0, 1e-9, False),
        (101.0, 0.0, 1.0, True),
        (-101.0, 0.0, 1.0, True),
        (0.0, -1.0, 1.0, True),
        (0.0, 0.0, 0.0, True),
        (0.0, 0.0, -1.0, True),
        (np.nan, 0.0, 1.0, True),
    ],
)
def test_steps_of_an_observer_fail_where_its_model_does(monkeypatch, rate, taken, slope, failed):
    """It turns too far, its memory does not agree or a spring softens away, in any step and any joint."""
    loops, steps = adaptive_observer_loops, []
    monkeypatch.setattr(loops, "held_torques", lambda h, p, c, slow, tau: steps.append(c.gain.copy()))
    monkeypatch.setattr(loops, "step_with_memory", lambda *_: taken)
    monkeypatch.setattr(loops, "tangent", lambda i, angle, springs: slope if i == 1 else 1.0)
    state = SimpleNamespace(angle=np.zeros(3), rate=np.array([0.0, rate, 0.0]), own_shift=np.array([0.1, 0.2, 0.3]),
                            factor=np.array([1.5, 0.0]), memory=None, slow=None)  # fmt: skip
    own = SimpleNamespace(gain=np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), law=None, rubber=None)
    joints = SimpleNamespace(theta0=np.array([1.0, 2.0, 3.0]))
    model = SimpleNamespace(joints=joints, chambers=own, memory=None, body=None)
    work = SimpleNamespace(springs=SimpleNamespace(theta0=np.zeros(3)), gain=np.zeros((2, 3)), held=None,
                           work=SimpleNamespace(tau=None))  # fmt: skip
    assert loops.ahead(state, np.zeros(2), model, 3, 0.01, work) is failed
    np.testing.assert_allclose(work.springs.theta0, [1.1, 2.2, 3.3])
    assert len(steps) == 3
    np.testing.assert_allclose(steps[0], 1.5 * own.gain)


def test_sensitivity_to_the_factor_grows_with_the_torque_and_fades_with_the_model(rng):
    n, periods = 2, 3
    F, G, by = 0.3 * rng.normal(size=(6, 6)), rng.normal(size=(6, 2)), rng.normal(size=6)
    law, pressure = np.array([[1e-6, 2e-12], [3e-6, 0.0]]), np.array([2e4, 5e4])
    push = law[:, 0] * pressure + law[:, 1] * pressure**2
    chambers = SimpleNamespace(law=law, rubber=np.zeros((2, 6)))
    gains = SimpleNamespace(F=F, G=G, growth=0.01)
    state = SimpleNamespace(sensitivity=by.copy(), factor=np.array([1.0, 0.2]))
    adaptive_observer_loops.learn_ahead(state, gains, periods, pressure, chambers, np.empty(3 * n))
    expected = by
    for _ in range(periods):
        expected = F @ expected + G @ push
    np.testing.assert_allclose(state.sensitivity, expected, rtol=1e-12)
    assert state.factor.tolist() == [1.0, pytest.approx(0.23)]
    known = SimpleNamespace(sensitivity=by.copy(), factor=np.array([1.0, 0.0]))
    adaptive_observer_loops.learn_ahead(known, gains, periods, pressure, chambers, np.empty(3 * n))
    assert known.sensitivity.tolist() == by.tolist()  # a factor that is known is not learnt


@pytest.mark.parametrize("value", [0.0, 0.499, 0.501, -0.501, np.nan])
@pytest.mark.parametrize("failed", [False, True])
def test_a_frame_is_followed_lost_or_parts_from_the_model(monkeypatch, value, failed):
    loops, calls = adaptive_observer_loops, []
    monkeypatch.setattr(loops, "learn_ahead", lambda *_: calls.append("learn"))
    monkeypatch.setattr(loops, "ahead", lambda state, p, model, count, h, work: calls.append(count) or failed)
    monkeypatch.setattr(loops, "correct_all", lambda *_: calls.append("correct"))
    monkeypatch.setattr(loops, "rest_shift", lambda *_: calls.append("shift"))
    state = SimpleNamespace(innovation=np.zeros(2), angle=np.array([0.1, 0.3]), own_shift=None, memory=None,
                            rest_shift=None)  # fmt: skip
    model = SimpleNamespace(chambers=None, memory=None, instantaneous=0.0,
                            joints=SimpleNamespace(base_angle=0.0, theta0=None))  # fmt: skip
    pace, work = SimpleNamespace(parts=4, h=0.1, largest=0.5), SimpleNamespace(weight=None, move=None)
    values = np.array([0.1, 0.2 + value])
    outcome = loops.follow(2, None, values, state, model, None, pace, work)
    lost = np.isnan(value)
    named = loops.FRAME_LOST if lost else loops.PARTED if abs(value) > 0.5 else loops.FOLLOWED
    assert outcome == (loops.STEP_FAILED if failed else named)
    assert calls == ["learn", 8, *["correct"] * (not lost), "shift"]
    if not lost:
        np.testing.assert_allclose(state.innovation, [0.0, value], atol=1e-15)  # links add up
    calls.clear()
    loops.follow(0, None, values, state, model, None, pace, work)
    assert calls == [*["correct"] * (not lost), "shift"]
