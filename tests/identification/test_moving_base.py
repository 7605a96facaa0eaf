"""Fits of recordings whose base moves as an input: the parameters, the derivatives, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.identification import Experiment, Parameter, fit, predict, sensitivities
from pliant.model import Extension, Memory, Model, Space
from pliant.simulation import BaseMotion, Pulse, Trace, simulate

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

TIME = np.linspace(0.0, 1.5, 301)
STATIONS = (("middle", 1, 0.02, 0.004), ("tip", 2, 0.04, 0.0))


def body(*, space=False, **more):
    """Three links that hang from the base."""
    return Model(**{
        "link_length": [0.04] * 3, "link_mass": [0.01] * 3, "stiffness": 0.3, "damping": 3e-3, "torque": [1e-6],
        "base_length": 0.02, "gravity": (0.5, 0.3, 9.81) if space else (0.5, 9.81),
        "space": Space(radius=0.005) if space else None, "stations": STATIONS,
    } | more)  # fmt: skip


def shaken(*, space=False):
    """A base that starts at rest, as one on the arm of a robot."""
    ease = 1.0 - np.exp(-((TIME / 0.2) ** 3))
    turn = 0.3 * ease * np.sin(5.0 * TIME)
    place = 0.04 * ease[:, None] * np.column_stack([np.sin(9 * TIME), np.sin(7 * TIME), np.sin(4 * TIME)])
    if not space:
        return BaseMotion(TIME, place[:, :2], angle=turn)
    from scipy.spatial.transform import Rotation

    about = Rotation.from_rotvec(np.column_stack([turn, 0.7 * turn, -turn]))
    return BaseMotion(TIME, place, quaternion=about.as_quat())


def recorded(model, base, level=3e4):
    """What a tracker on the base would record: positions relative to it."""
    pressure = Trace(TIME, level * (TIME > 0.7))
    run = simulate(model, pressure, times=TIME, time_step=1e-3, base=base)
    return Experiment("shaken", TIME, run.station_position.values, ("middle", "tip"), "trace", pressure, base=base)


@pytest.mark.parametrize("space", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_fit_finds_the_body_that_its_base_shakes(space):
    model = body(space=space)
    exp = recorded(model, shaken(space=space))
    start = model.with_(stiffness=0.25, damping=4e-3, torque=[0.8e-6])
    result = fit([exp], start, [Parameter(n) for n in ("stiffness", "damping", "torque_1")], time_step=2e-3)
    assert result.values["stiffness"] == pytest.approx(0.3, rel=2e-3)
    assert result.values["damping"] == pytest.approx(3e-3, rel=2e-2)
    assert result.values["torque_1"] == pytest.approx(1e-6, rel=2e-3)
    blind = fit([replace(exp, base=None)], start, [Parameter(n) for n in ("stiffness", "damping", "torque_1")],
                time_step=2e-3)  # fmt: skip
    assert blind.rmse["shaken"] > 30 * result.rmse["shaken"]


CASES = {
    "plain": {}, "lengthening": {"extensions": (Extension(stiffness=20.0, damping=0.2),)},
    "remembering": {"memory": Memory((0.2,), (0.3,), boucwen_share=0.2, boucwen_beta=20.0, boucwen_gamma=5.0)},
    "in space": {"space": True}, "lengthening in space": {
        "space": True, "extensions": (Extension(stiffness=20.0, damping=0.2),)},
}  # fmt: skip


@pytest.mark.parametrize("case", [
    pytest.param(case, marks=pytest.mark.slow) if "space" in case else case for case in CASES
])  # fmt: skip
def test_derivatives_are_those_of_differences(case):
    options = CASES[case]
    model, base = body(**options), shaken(space=options.get("space", False))
    exp = recorded(model, base)
    values = {"stiffness": 0.28, "damping": 3.2e-3, "tip_mass": 0.002, "latency": 0.01}
    sizes = {"stiffness": 0.1, "damping": 1e-3, "tip_mass": 5e-3, "latency": 0.01}
    rows, slopes = sensitivities(model, exp, values, sizes, 2e-3)
    for k, (name, size) in enumerate(sizes.items()):
        ends = [predict(model, exp, values | {name: values[name] + sign * 1e-3 * size}, time_step=2e-3)["position"]
                for sign in (-1, 1)]  # fmt: skip
        difference = (ends[1] - ends[0]) / (2e-3 * size)
        d = exp.dimension
        assert slopes[k, ..., :d] == pytest.approx(difference[..., :d], abs=2e-4 * np.abs(difference).max()), name
    assert np.isfinite(rows).all()


def test_base_at_rest_gives_the_numbers_of_a_fixed_base():
    exp = recorded(body(), None)
    still = replace(exp, base=BaseMotion(TIME, np.zeros((TIME.size, 2))))
    one, other = (sensitivities(body(), e, {"stiffness": 0.28}, {"stiffness": 0.1}, 2e-3) for e in (exp, still))
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)


def test_prediction_is_that_of_the_simulation():
    exp = recorded(body(), shaken())
    found = predict(body(), exp, {}, time_step=1e-3)
    assert np.abs(found["position"] - exp.position).max() < 1e-9


@pytest.mark.parametrize(("change", "message"), [
    ({"base": BaseMotion(TIME, np.zeros((TIME.size, 3)))}, "has 3 coordinates, but the positions have 2"),
    ({"base": BaseMotion(TIME[5:], np.zeros((TIME.size - 5, 2)))}, r"is known from 0\.025 to 1\.5 s only"),
    ({"excitation": "release", "pressure": None}, "for a motion under inputs, not for a release"),
])  # fmt: skip
def test_motions_that_do_not_fit_are_refused(change, message):
    exp = recorded(body(), shaken())
    with pytest.raises(InputError, match=message):
        replace(exp, **change)


def test_mirrored_experiment_mirrors_its_base():
    exp = recorded(body(gravity=(0.0, 9.81)), shaken())
    turned = exp.turned()
    mirror = body(gravity=(0.0, 9.81), torque=[-1e-6], stations=(("middle", 1, 0.02, -0.004), STATIONS[1]))
    found = predict(mirror, turned, {}, time_step=1e-3)
    assert np.abs(found["position"] - turned.position).max() < 1e-9


def test_pulse_of_unknown_edges_on_a_moving_base():
    model, base = body(), shaken()
    run = simulate(model, Pulse(level=3e4, start=0.2, width=0.6), times=TIME, time_step=1e-3, base=base)
    exp = Experiment("p", TIME, run.station_position.values, ("middle", "tip"), "pulse", level=3e4, base=base)
    values = {"p.start": 0.2113, "p.stop": 0.7912}
    rows, slopes = sensitivities(model, exp, values, {"p.start": 0.01}, 2e-3)
    ends = [predict(model, exp, values | {"p.start": 0.2113 + sign * 1e-4}, time_step=2e-3)["position"]
            for sign in (-1, 1)]  # fmt: skip
    difference = (ends[1] - ends[0]) / 2e-4
    assert slopes[0][..., :2] == pytest.approx(difference[..., :2], abs=1e-2 * np.abs(difference).max())
    assert rows.shape[0] == TIME.size
