"""Every estimator keeps the same contract: on a chain that moves as the model does, each tells where it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant import plugins
from pliant.errors import InputError
from pliant.estimation import EstimatorKind, KalmanFilter, LinkAngles, Setting, State, estimators, frozen
from pliant.estimation import contract as registered
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Memory, chain_model
from pliant.simulation import Trace, simulate

PERIOD = 4e-3
CLOCK = PERIOD * np.arange(150)
PRESSURE = 8e4 * np.clip(CLOCK / 0.2, 0, 1)
BOUNDS = {"observer": (2e-3, 0.2), "filter": (2e-3, 0.1), "differences": (2e-3, 0.7)}  # rad, rad/s: differences lag


@pytest.fixture(scope="module")
def body():
    memory = Memory(creep_share=(0.1,), creep_time=(0.2,))
    return chain_model(
        length=0.15, mass=0.06, links=3, stiffness=1.2, damping=6e-3, torque=[1.2e-6], memory=memory
    )


@pytest.fixture(scope="module")
def moved(body):
    """A simulated motion, and the points of its body (T, n + 1, 2) that a sensor shows."""
    run = simulate(body, Trace(CLOCK, PRESSURE), times=CLOCK, time_step=1e-3)
    tips = run.tip_position.values
    base = np.broadcast_to(body.first_joint, (len(tips), 1, 2))
    return run, np.concatenate([base, tips], axis=1)


def ends(body):
    return body.base_length + np.append(0.0, np.cumsum(body.link_length))


def shown(kind, body, points, frames):
    """An estimator after so many frames, and its state then."""
    made, link_angles = kind.make(Setting(body, PERIOD, 0)), LinkAngles(body, ends(body))
    for k in range(frames):
        made.push_pressure(CLOCK[k], float(PRESSURE[k]))
        made.push_frame(CLOCK[k], *link_angles.frame(points[k]))
    return made, made.state(CLOCK[frames - 1])


@pytest.fixture(scope="module")
def under_two_pressures():
    """Opposite chambers of the two halves of a body that pulls a tenth less than the model of it."""
    halves = [Chamber(torque=[1.2e-6], joint_gain=[1.0, 1.0, 0.0, 0.0], name="low"),
              Chamber(torque=[0.9e-6], joint_gain=[0.0, 0.0, -1.0, -0.8], name="high")]  # fmt: skip
    body = chain_model(length=0.16, mass=0.06, links=4, stiffness=1.2, damping=6e-3, torque=[0.0])
    body = body.with_(chambers=halves)
    weaker = body.with_(chambers=[replace(c, torque=0.9 * c.torque) for c in halves])
    both = np.stack([PRESSURE, 6e4 * np.sin(2.5 * CLOCK) ** 2], axis=1)
    run = simulate(weaker, [Trace(CLOCK, row) for row in both.T], times=CLOCK, method="LSODA")
    return body, both, run, np.concatenate([np.zeros((CLOCK.size, 1, 2)), run.tip_position.values], axis=1)


@pytest.mark.parametrize("name", registered.BUILT_IN)
def test_every_estimator_finds_a_motion_under_two_pressures(name, under_two_pressures):
    body, both, run, points = under_two_pressures
    made, link_angles = estimators()[name].make(Setting(body, PERIOD, 0)), LinkAngles(body, ends(body))
    for time, pressures, shape in zip(CLOCK, both, points, strict=True):
        made.push_pressure(time, pressures)
        made.push_frame(time, *link_angles.frame(shape))
    found, (angle, rate) = made.state(CLOCK[-1]), BOUNDS[name]
    np.testing.assert_allclose(mechanics_of(body).joint_angles(found.angle), run.joint_angle.values[-1], atol=angle)
    np.testing.assert_allclose(found.rate, np.cumsum(run.joint_rate.values[-1]), atol=2 * rate)
    if name == "observer":
        assert found.torque_scale == pytest.approx(0.9, abs=0.05)


@pytest.mark.parametrize("name", registered.BUILT_IN)
def test_every_estimator_finds_the_motion(name, body, moved):
    run, points = moved
    angle, rate = BOUNDS[name]
    for frames in (40, 150):
        found = shown(estimators()[name], body, points, frames)[1]
        q, dq = run.joint_angle.values[frames - 1], run.joint_rate.values[frames - 1]
        assert isinstance(found, State)
        assert found.time == CLOCK[frames - 1]
        np.testing.assert_allclose(mechanics_of(body).joint_angles(found.angle), q, atol=angle)
        np.testing.assert_allclose(np.diff(found.rate, axis=-1, prepend=0.0), dq, atol=rate)
        assert np.linalg.eigvalsh(found.covariance).min() >= -1e-12 * np.abs(found.covariance).max()
        assert found.covariance.shape[0] in (2 * body.n, 3 * body.n)
        assert (found.consistent, found.fault) == (True, "")


@pytest.mark.parametrize("name", ["observer", "filter"])
def test_rest_shifts_are_those_of_the_model_without_memory(name, body, moved):
    """K (q - shift) = tau of the frozen model where the body stands still: what crept is in the shift."""
    frames = 150
    found = shown(estimators()[name], body, moved[1], frames)[1]
    q = mechanics_of(body).joint_angles(found.angle)
    held = frozen(body).stiffness * (q - found.rest_shift)
    tau = np.asarray(body.torque_at(float(PRESSURE[-1]))) * found.torque_scale
    np.testing.assert_allclose(held, np.broadcast_to(tau, held.shape), rtol=0.05)
    assert np.all(np.abs(found.rest_shift) > 1e-3)


@pytest.mark.parametrize("name", registered.BUILT_IN)
def test_a_state_stays_what_it_was(name, body, moved):
    """Frames that come later change no state that was told; a lost one changes no angle that is only seen."""
    made, found = shown(estimators()[name], body, moved[1], 40)
    kept = [np.array(part) for part in found]
    link_angles = LinkAngles(body, ends(body))
    for k in range(40, 60):
        made.push_pressure(CLOCK[k], float(PRESSURE[k]))
        lost = np.full_like(moved[1][k], np.nan) if k == 50 else moved[1][k]
        made.push_frame(CLOCK[k], *link_angles.frame(lost))
    for before, now in zip(kept, found, strict=True):
        np.testing.assert_array_equal(before, np.array(now))
    later = made.state(CLOCK[59])
    assert np.abs(later.angle - found.angle).max() > 1e-3
    assert np.isfinite(later.rate).all()


@pytest.mark.parametrize("name", ["observer", "filter"])
def test_a_body_elsewhere_is_told(name, body, moved):
    """A shape that the model cannot be in at once: the state says why it is not to be trusted."""
    made, _ = shown(estimators()[name], body, moved[1], 40)
    rows, values, variance = LinkAngles(body, ends(body)).frame(moved[1][40])
    made.push_frame(CLOCK[40], rows, values + np.array([1.5, 0.0, 0.0]), variance)
    found = made.state(CLOCK[40])
    assert not found.consistent
    assert "0.5 rad" in found.fault


@pytest.mark.parametrize("name", ["observer", "differences"])
def test_rows_that_are_no_link_angles_are_refused(name, body):
    made = estimators()[name].make(Setting(body, PERIOD, 0))
    with pytest.raises(InputError, match="use KalmanFilter, which accepts any"):
        made.push_frame(0.0, np.array([[1.0, 2.0, 0.05, 0.0]]), np.zeros(1), np.ones(1))


@pytest.mark.parametrize("name", ["observer", "filter"])
def test_more_pressures_than_chambers_are_refused(name, body):
    made = estimators()[name].make(Setting(body, PERIOD, 0))
    made.push_pressure(0.0, np.array([1e4]))
    with pytest.raises(InputError, match=r"expected 1 pressure\(s\) .* got shape \(2,\)"):
        made.push_pressure(PERIOD, np.array([1e4, 2e4]))


def test_link_angles_are_those_of_their_formula(body, rng):
    """The compiled angles against NumPy's, on shapes with turns beyond half a circle; a lost point loses all."""
    s = np.linspace(0.0, ends(body)[-1], 40)
    link_angles = LinkAngles(body, s)
    for _ in range(20):
        phi = np.cumsum(rng.uniform(-0.2, 0.3, s.size))
        points = np.cumsum(0.15 / s.size * np.stack([-np.sin(phi), np.cos(phi)], axis=1), axis=0)
        frame = link_angles.frame(points)
        np.testing.assert_allclose(np.cumsum(frame.values), link_angles(points), rtol=1e-12, atol=1e-12)
    points[7, 1] = np.nan
    assert np.isnan(link_angles.frame(points).values).all()
    with pytest.raises(InputError, match="a shape must have 40 points"):
        link_angles.frame(points[:30])


def test_a_filter_begins_with_its_first_event(body):
    """Whatever the clock says: no time before it is predicted through."""
    late = KalmanFilter(body, time=-np.inf)
    late.push_pressure(1e6, 2e4)
    assert late.state(1e6 + 0.01).time == 1e6 + 0.01
    assert np.isfinite(late.state(1e6 + 0.02).covariance).all()


def test_every_built_in_estimator_and_controller_loads():
    from pliant.control import contract as controllers

    assert {n: k.name for n, k in estimators().items()} == {n: n for n in registered.BUILT_IN}
    assert {n: k.name for n, k in controllers.controllers().items()} == {n: n for n in controllers.BUILT_IN}


def test_an_installed_package_brings_an_estimator(monkeypatch):
    point = {"mine": f"{__name__}:MINE"}
    monkeypatch.setattr(plugins, "installed", lambda group: point if group == registered.GROUP else {})
    assert registered.estimator_kind("mine") is MINE
    point["mine"] = f"{__name__}:PERIOD"
    with pytest.raises(InputError, match="must name an object of the class EstimatorKind"):
        registered.estimator_kind("mine")
    point["mine"] = "nowhere:MINE"
    with pytest.raises(InputError, match="cannot be loaded"):
        registered.estimator_kind("mine")


def test_an_estimator_for_another_version_is_named(monkeypatch, tmp_path):
    (tmp_path / "old_estimator.py").write_text(
        "from pliant.estimation.contract import EstimatorKind\n"
        "ESTIMATOR = EstimatorKind('mine', None, fixed_length=True)\n", encoding="utf-8")  # fmt: skip
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(plugins, "installed", lambda group: {"mine": "old_estimator:ESTIMATOR"})
    with pytest.raises(InputError, match=r"'mine' of .* cannot be loaded: .*'fixed_length'; update or remove its pack"):
        registered.estimators()


MINE = EstimatorKind("mine", lambda setting: setting)
