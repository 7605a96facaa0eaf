"""Payne's curve laid out in slip elements: closed forms of its backbone and its loops, and its numbers found again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from pliant.errors import InputError
from pliant.identification import Experiment, Parameter, fit, predict, sensitivities
from pliant.identification.initial_guess import prepare
from pliant.identification.parameters import apply
from pliant.model import Memory, Model, Station
from pliant.model.memory import payne
from pliant.simulation import Trace, simulate

BAND = (1e-3, 1.0)  # rad
CURVE = {"payne_share": 4.0, "payne_angle": 0.02, "payne_exponent": 0.4, "payne_low": 1e-3, "payne_high": 0.7}
TIMES = np.arange(0.0, 1.6, 0.01)


def loading(x: Any, share: float, angle: float, exponent: float) -> Any:
    """The torque of first loading, over K: Kraus' stiffness at this amplitude times the amplitude."""
    return share * x / (1.0 + (x / angle) ** (2.0 * exponent))


def laid(x: Any, made: Any) -> Any:
    """The same of the elements, each stretched until it slips, and of the spring."""
    return made.spring * x + np.minimum(np.asarray(x)[..., None], made.slip_angle) @ np.array(made.slip_share)


@pytest.mark.parametrize("exponent", [0.1, 0.3, 0.5])
@pytest.mark.parametrize("angle", [3e-3, 0.05])
def test_the_elements_load_as_krauss_curve_does(exponent: float, angle: float) -> None:
    made, law = payne(2.0, angle, exponent, *BAND), (2.0, angle, exponent)
    assert len(made.slip_share) == 10
    assert min(made.slip_share) > 0
    assert np.all(np.diff(made.slip_angle) > 0)
    edges = np.geomspace(*BAND, 10)
    assert laid(edges, made) == pytest.approx(loading(edges, *law), rel=1e-12)
    slope = np.imag(loading(edges * (1 + 1e-30j), *law)) / (1e-30 * edges)  # by complex step
    stuck = made.spring + (np.array(made.slip_angle) > edges[:, None]) @ np.array(made.slip_share)
    assert stuck == pytest.approx(slope, rel=1e-10)
    assert sum(made.slip_share) + made.spring == pytest.approx(2.0, rel=1e-14)
    x = np.geomspace(*BAND, 400)
    ratio = laid(x, made) / loading(x, *law)
    assert ratio.min() > 1 - 1e-12
    assert ratio.max() < 1.035


@pytest.mark.parametrize(("exponent", "amplitude"), [(0.5, 0.05), (0.5, 0.3), (0.3, 0.05), (0.3, 0.3)])
def test_a_joint_loses_what_masings_rule_says(exponent: float, amplitude: float) -> None:
    """A joint led slowly back and forth: 8 (int_0^A f dx - A f(A) / 2) K a cycle, for the hyperbola in closed form."""
    law = (3.0, 0.05, exponent)
    area = quad(loading, 0.0, amplitude, args=law, epsrel=1e-11)[0]
    if exponent == 0.5:
        closed = 3.0 * 0.05**2 * (amplitude / 0.05 - np.log1p(amplitude / 0.05))
        assert area == pytest.approx(closed, rel=1e-10)
    expected = 8.0 * (area - 0.5 * amplitude * loading(amplitude, *law))
    made = payne(*law, 2e-3, 0.5)
    model = Model(link_length=[0.05], link_mass=0.06, stiffness=1.0, damping=2e-3, torque=[1e-6],
                  memory=Memory(slip_share=made.slip_share, slip_angle=made.slip_angle))  # fmt: skip
    top = amplitude + float(laid(amplitude, made) - made.spring * amplitude)  # torque over K that leads it there
    t = np.linspace(0.0, 40.0, 2001)
    wave = Trace(t, 1e6 * top * np.interp(t, [0, 5, 15, 25, 35, 40], [0, 1, -1, 1, -1, -1]))
    run = simulate(model, wave, times=[0.0, 5.0, 25.0], time_step=2e-3)
    assert run.joint_angle.values[1:, 0] == pytest.approx(amplitude, rel=0.02)
    lost = np.diff(run.memory_dissipation.values)[-1]
    assert lost == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("exponent", [0.2, 0.4])
def test_small_loops_grow_and_large_ones_flatten_with_the_powers_of_the_curve(exponent: float) -> None:
    """Far below the angle the loss goes as A^(2 + 2m), far above as A^(2 - 2m): slopes of the elements' loss."""
    for angle, power in ((1e3, 2 + 2 * exponent), (1e-9, 2 - 2 * exponent)):
        made = payne(1.0, angle, exponent, 1e-4, 1.0)
        share, limit = np.array(made.slip_share), np.array(made.slip_angle)
        x = np.geomspace(3e-3, 0.3, 7)  # whole periods of the layout
        lost = 4.0 * np.sum(share * limit * np.maximum(x[:, None] - limit, 0.0), axis=1)
        assert np.polyfit(np.log(x), np.log(lost), 1)[0] == pytest.approx(power, abs=0.05)


def chain(**changes: Any) -> Model:
    """Three links that hang, with a mass at their end."""
    entries: dict[str, Any] = {
        "link_length": np.full(3, 0.1), "link_mass": 0.05, "stiffness": 0.15, "damping": 2e-3, "torque": [4e-7],
        "tip_mass": 0.1, "gravity": [0.0, 9.81], "stations": (Station("tip", 2, 0.1),),
    }
    return Model(**entries | changes)


def released(x: float, name: str = "r") -> Experiment:
    """A body whose tip a hand holds aside, at x [m], and lets go."""
    seen = np.full((TIMES.size, 1, 2), [x, 0.28])
    seen[11:] = [0.0, 0.3]
    return Experiment(name, TIMES, seen, ("tip",), "release", held=seen[:1, 0])


def test_the_band_is_that_of_the_recordings_swings_and_fixed() -> None:
    exp = released(0.06)
    model, listed = prepare([exp], chain(), ["payne_share", "payne_angle", "payne_exponent", "stiffness"])
    named = {p.name: p for p in listed}
    even = 2 * np.hypot(0.06, 0.02) / 0.3 / 3  # turn of a joint of a body bent evenly
    assert named["payne_low"].value == pytest.approx(0.01 * even)
    assert named["payne_high"].value == pytest.approx(2.0 * even)
    assert not named["payne_low"].free
    assert not named["payne_high"].free
    values = {p.name: p.value for p in listed}
    once = apply(model, values)
    assert len(once.memory.slip_share) == 8
    assert apply(once, values).memory == once.memory


@pytest.mark.parametrize(("values", "sentence"), [
    ({"payne_share": 0.1, "payne_angle": 0.2}, "payne_exponent, payne_low, payne_high is missing"),
    (CURVE | {"slip_share_1": 0.1, "slip_angle_1": 0.1}, "leave out either"),
    (CURVE | {"payne_low": 0.8}, "0 < low < high in rad"),
    (CURVE | {"payne_low": 1e-6}, "choose a narrower band"),
    (CURVE | {"payne_exponent": 0.6}, "0 < exponent <= 0.5"),
    (CURVE | {"payne_share": np.nan}, "share >= 0"),
    (CURVE | {"payne_angle": 1e-12}, "Payne's curve slip_angle must have a size"),
])
def test_a_curve_that_makes_no_sense_is_told(values: dict[str, float], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        apply(chain(), values)


def test_a_band_is_not_fitted() -> None:
    free = ["payne_share", "payne_angle", "payne_exponent", Parameter("payne_high", 0.5)]
    with pytest.raises(InputError, match="cannot be fitted"):
        prepare([released(0.06)], chain(), free)


def test_every_number_of_the_curve_agrees_with_differences() -> None:
    values = {"stiffness": 0.15, **CURVE, "r.release": 0.1033}
    for name in ("stiffness", "payne_share", "payne_angle", "payne_exponent"):
        value = values[name]
        _, slopes = sensitivities(chain(), released(0.06), values, {name: abs(value)}, 1e-3)
        d = 1e-6 * abs(value)
        high, low = (predict(chain(), released(0.06), {**values, name: value + side * d}, 1e-3)["position"]
                     for side in (1, -1))
        expected = (high - low) / (2 * d)
        assert np.abs(slopes[0, ..., :2] - expected).max() < 1e-3 * np.abs(expected).max(), name


def test_the_curve_comes_back_from_two_releases() -> None:
    values, made = {**CURVE, "payne_low": 4e-3}, []
    for name, x, at in (("r", 0.08, 0.1033), ("s", 0.03, 0.0871)):
        exp = released(x, name)
        seen = predict(chain(), exp, {**values, f"{name}.release": at}, 4e-3)["position"]
        noise = 5e-5 * np.random.default_rng(3).standard_normal(seen.shape)
        made.append(replace(exp, position=seen + noise))
    band = [Parameter(n, values[n], free=False) for n in ("payne_low", "payne_high")]
    found = fit(made, chain(), ["stiffness", "damping", "payne_share", "payne_angle", "payne_exponent", *band],
                time_step=4e-3, starts=1)  # fmt: skip
    truth = {**values, "stiffness": 0.15, "damping": 2e-3}
    for p in found.parameters:
        if p.name in truth and p.free:
            assert p.std is not None
            assert p.std < 0.5 * truth[p.name], p
            assert abs(p.value - truth[p.name]) < 4 * p.std, p
