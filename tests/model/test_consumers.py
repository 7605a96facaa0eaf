"""Every feature of a model and every consumer of models: the result agrees with `simulate`, or the model is refused.

The models are made here, one for each feature. A new feature without a model, and a new consumer that refuses without
naming the feature, fail.
"""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from pliant.batch.batch import simulate_batch
from pliant.batch.stepper import BATCH_STEPPER, batch_stepper
from pliant.contact.residual import MOMENTUM_RESIDUAL, STATIC_RESIDUAL, momentum_residual, static_residual
from pliant.control.design import design_outputs
from pliant.control.tuning import Limits
from pliant.control.valve import CONTROL
from pliant.errors import InputError
from pliant.estimation.adaptive_observer import OBSERVER, AdaptiveObserver
from pliant.estimation.kalman import FILTER, KalmanFilter
from pliant.exporters.registry import export, exporters
from pliant.linear.linearisation import LINEARISE, linearise
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, Memory, Model, Space, Station, Tendon, Valve, chain_model
from pliant.model.features import ALL, FEATURES, LATER_TERMS, VALVES, named
from pliant.simulation import Pulse, Stepper, Trace, equilibrium, modes, simulate
from pliant.simulation.extrapolation import EXTRAPOLATED
from pliant.simulation.reference import SCIPY
from pliant.simulation.stepper import STEPPER

LAW = {"torque": (2e-6,), "name": "left"}
LONG = {"length": 0.2, "mass": 0.05, "links": 2, "stiffness": 1.0, "damping": 8e-3}
LEVEL, UPPER = 6e4, 6.06e4  # Pa, of a pressure and of one slightly above
ENDS = {name: one.suffixes[0] for name, one in exporters().items()}


def planar(**more) -> Model:
    return chain_model(**LONG, **({} if "chambers" in more else LAW_OF_ONE), **more)


LAW_OF_ONE = {"torque": (2e-6,)}


def with_valve(**valve) -> Model:
    return planar(valve=Valve(**valve))


def with_chamber(**more) -> Model:
    return planar(chambers=(Chamber(**LAW | more),))


def spatial(**more) -> Model:
    chambers = more.pop("chambers", (Chamber(**LAW, joint_gain=(1.0, 1.0), cross_gain=(0.3, 0.3)),))
    space = {"radius": 0.01} | more.pop("space", {})
    return Model(link_length=[0.1, 0.1], link_mass=0.025, stiffness=1.0, damping=8e-3, chambers=chambers,
                 space=Space(**space), **more)  # fmt: skip


def tendon(azimuth: float, name: str, **more) -> Tendon:
    constants = {"driven_by": "displacement", "lever": 0.01, "line_stiffness": 2e3, "pretension": 5.0}
    return Tendon.at_azimuth(azimuth, np.ones(2), name=name, **constants | more)


def pulled(**more) -> Model:
    return spatial(chambers=(tendon(0.4, "near", **more), tendon(0.4 + np.pi, "far", **more)))


WHOLE = Extension(300.0, 1.0, 0.0, 0.2, "whole")
MODELS = {
    "springs": planar(), "drive": planar(), "law": planar().with_(torque=(2e-6, 4e-12)),
    "chambers": planar(chambers=(Chamber(**LAW), Chamber(torque=(1e-6,), joint_gain=(0.0, -1.0), name="right"))),
    "points": planar(stations=(Station("middle", 0, 0.05, 0.004),)), "gravity": planar(gravity=(0.0, -9.81)),
    "lengthening": planar(extensions=(WHOLE,)),
    "curved_segments": planar(extensions=(replace(WHOLE, stiffening=-0.3, cubic_stiffening=0.5),)),
    "axial_memory": planar(extensions=(WHOLE,), memory=Memory(axial_creep_share=(0.2,), axial_creep_time=(50.0,))),
    "softening": planar(stiffening=-0.2, cubic_stiffening=0.3),
    "bounded": planar(stiffening=-0.5, stiffening_bound=0.6),
    **{term: planar(**{term: 0.2}) for term in LATER_TERMS},
    "own_law": with_chamber(law="saturating", torque=(2e-6, 3e5)),
    "lagging_law": with_chamber(torque=(2e-6, 4e-12), valve=Valve(rise_time=0.03, fall_time=0.03)),
    "dead_time": with_valve(dead_time=0.02), "two_lags": with_valve(rise_time=0.02, fall_time=0.05),
    "lag": with_valve(rise_time=0.03, fall_time=0.03), "second_order": with_valve(natural_frequency=6.0),
    "rates": with_valve(rise_rate=1e6, fall_rate=1e6), "opening": with_valve(opening_time=0.1),
    "settling": with_valve(settle_share=0.4, settle_time=0.1), "dead_band": with_valve(dead_band=5e3),
    "swelling": with_chamber(torque=(2e-6, 8e-12), swell_share=0.4, swell_time=50.0),
    "inflation": with_chamber(inflation_limit=3e5, inflation_time=0.1),
    "creep": planar(memory=Memory((0.3,), (50.0,))), "slip": planar(memory=Memory((), (), (0.3,), (0.1,))),
    "boucwen": planar(memory=Memory(boucwen_share=0.2, boucwen_beta=0.5, boucwen_gamma=0.5)),
    "space": spatial(), "twist": spatial(space={"twist_ratio": 0.7}), "soft_swing": spatial(stiffening=-0.2),
    "space_memory": spatial(memory=Memory((0.3,), (50.0,))), "space_lengthening": spatial(extensions=(WHOLE,)),
    "tied_segments": spatial(extensions=(replace(WHOLE, stiffens_bending=True, stiffening=-0.3),)),
    "tendons": pulled(), "tendon_friction": pulled(friction=0.2, slip_rate=1e-2),
    "remembering_segments": spatial(
        chambers=(Chamber(**LAW, joint_gain=(1.0, 1.0), cross_gain=(0.3, 0.3), axial_gain=40.0),), extensions=(WHOLE,),
        memory=Memory((0.3,), (50.0,), axial_creep_share=(0.2,), axial_creep_time=(50.0,)),
    ),
    "slack": pulled(pretension=0.0), "loose": pulled(pretension=-1.0),
    "pair_pretension": spatial(chambers=(tendon(0.4, "near", pair=True),)),
    "tendon_chords": pulled(spacing=0.02), "base_motion": planar(moving_base=True),
}  # fmt: skip
MORE = {"slack": "tendons", "loose": "tendons", "remembering_segments": "axial_memory"}  # more models of a feature
LATE_OR_SLOW = {"creep", "space_memory", "axial_memory", "swelling"}  # slow beside the 0.3 s of these motions


def levels(model: Model, share: float = 1.0) -> np.ndarray:
    """A value of each input: `share` of 60 kPa or of a displacement of 4 mm for the first, less for others."""
    first = {"Pa": LEVEL, "m": 4e-3}
    return np.array([share * first[unit] / (1.0 + 2.0 * c) for c, unit in enumerate(model.actuation.units)])


def feature_of(key: str) -> str:
    return MORE.get(key, key)


def carried_or_refused(consumer, key: str, run) -> bool:
    """Whether a consumer takes a model; if it does not, its refusal names the features and says what to do."""
    model = MODELS[key]
    lacks = consumer.lacks(model)
    if not lacks:
        return True
    with pytest.raises(InputError) as refusal:
        run()
    assert all(name in str(refusal.value) for name in named(model, lacks))
    assert len(str(refusal.value)) < 400
    return False


def test_there_is_a_model_of_every_feature():
    assert set(MODELS) - set(MORE) == set(FEATURES) == ALL
    assert all(FEATURES[feature_of(key)].names(model) for key, model in MODELS.items())


def quiet(run):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return run()


@pytest.mark.slow
@pytest.mark.parametrize("key", MODELS)
def test_a_linear_model_answers_a_small_step_as_the_model_does(key):
    """From rest under constant inputs, the first rises by a hundredth. Two lags enter as their mean: not compared."""
    model = MODELS[key]
    if not carried_or_refused(LINEARISE, key, lambda: linearise(model, levels(model))) or key == "two_lags":
        return
    linear, low, h = linearise(model, levels(model)), levels(model), 1e-3
    high = low + 0.01 * levels(model) * (np.arange(low.size) == 0)
    if model.chambers[0].valve.rise_rate:
        high = low + 0.001 * (high - low)
    times = np.arange(300) * h
    inputs = [Trace([-1.0, 0.0, 1e-9, 9.0], [a, a, b, b]) for a, b in zip(low, high, strict=True)]
    run = quiet(lambda: simulate(model, inputs, times=times, time_step=2e-4, check=False))
    tip = run.tip_position.values[:, -1]
    change = linear.B @ (high - low)
    move = expm(np.block([[linear.A, change[:, None]], [np.zeros((1, len(change) + 1))]]) * h)
    state, rows = np.append(np.zeros(len(change)), 1.0), []
    late = round(linear.dead_times[0] / h)
    for k in range(times.size):
        rows.append(linear.C[: tip.shape[1]] @ state[:-1])
        state = move @ state if k >= late else state
    moved = tip - tip[0]
    assert np.abs(moved).max() > 1e-7
    assert np.abs(moved - rows).max() < 0.03 * np.abs(moved).max()


@pytest.mark.parametrize("key", ["tendons", "slack", "loose", "pair_pretension"])
def test_modes_of_a_shape_are_those_under_the_inputs_that_hold_it(key):
    """And those of the linear model without dampers: a tendon that holds the shape is taut, one that hangs is not."""
    model = MODELS[key]
    undamped = model.with_(damping=1e-12)
    for share in (0.5, 1.0):
        far = share * np.array([4e-3, 1e-3] if model.actuation.count > 1 else [-2e-3])
        shape = equilibrium(model, far)
        by_shape, by_inputs = modes(model, shape)[0], modes(model, shape, pressure=far)[0]
        np.testing.assert_allclose(by_shape, by_inputs, rtol=1e-6)
        roots = np.sort(np.abs(linearise(undamped, far).poles()))[::2]
        np.testing.assert_allclose(by_inputs, roots / (2 * np.pi), rtol=1e-6)
        bare = np.sort(np.abs(linearise(spatial().with_(damping=1e-12), 0.0).poles()))[::2] / (2 * np.pi)
        assert not np.allclose(by_inputs, bare, rtol=1e-3)


@pytest.mark.parametrize("pretension", [0.5, -2.0])
@pytest.mark.parametrize("pairs", [1, 3])
def test_shapes_of_a_body_that_pairs_shorten_are_held_whichever_tendons_are_slack(pairs, pretension):
    """The sum of both tensions of a pair shortens the body, and depends on which of the two is slack."""
    cords = [Tendon.at_azimuth(2.0 * np.pi * k / pairs, np.ones(4), name=name, lever=8e-3, driven_by="displacement",
                               line_stiffness=2e3, pretension=pretension, pair=True, spacing=0.03)
             for k, name in enumerate("abc"[:pairs])]  # fmt: skip
    model = chain_model(length=0.12, mass=0.05, links=4, stiffness=0.05, damping=1e-3, space=True, chambers=cords,
                        gravity=[0.0, 0.0, 9.81], extensions=[Extension(500.0, 1.0)])  # fmt: skip
    rng, agree = np.random.default_rng(0), 0
    for _ in range(10):
        commands = rng.uniform(-3e-3, 3e-3, pairs)
        shape = equilibrium(model, commands)
        agree += np.allclose(modes(model, shape)[0], modes(model, shape, pressure=commands)[0], rtol=1e-6)
    assert agree >= 8  # other tensions of the three pairs may hold the same shape


def test_a_shape_that_no_tendon_holds_is_refused():
    with pytest.raises(InputError, match=r"no values of the inputs .* hold this shape"):
        modes(MODELS["slack"], [0.3, 0.0, -0.3, 0.2])


@pytest.mark.slow
@pytest.mark.parametrize("key", MODELS)
def test_solvers_and_steppers_follow_the_march(key):
    model, p = MODELS[key], levels(MODELS[key])
    times, step = np.arange(101) * 1e-3, 1e-3
    inputs = [Pulse(level, 0.0, 9.0) for level in p]

    def tip(**how):
        return quiet(lambda: simulate(model, inputs, times=times, check=False, **how)).tip_position.values[:, -1]

    fine, same = tip(time_step=1e-4), tip(time_step=step)
    moved = np.abs(fine - fine[0]).max()
    if set(FEATURES) - SCIPY and not missing_for(SCIPY, model):
        assert np.abs(tip(method="LSODA") - fine).max() < 0.01 * moved
    else:
        with pytest.raises(InputError, match="use method='midpoint'"):
            tip(method="LSODA")
    if carried_or_refused(EXTRAPOLATED, key, lambda: tip(method="extrapolated", time_step=step)):
        assert np.abs(tip(method="extrapolated", time_step=step) - fine).max() < 0.01 * moved
    batch = quiet(lambda: simulate_batch([model] * 2, [inputs] * 2 if p.size > 1 else inputs[0], times=times,
                                         time_step=step, variables=("tip_position",)))  # fmt: skip
    np.testing.assert_allclose(batch.tip_position.values[1, :, -1], same, atol=1e-9)
    if not carried_or_refused(STEPPER, key, lambda: Stepper(model, step)):
        carried_or_refused(BATCH_STEPPER, key, lambda: batch_stepper([model], 2, step))
        return
    stepper = quiet(lambda: Stepper(model, step))
    for _ in range(100):
        stepper.step(p)
    np.testing.assert_allclose(stepper.tips()[-1], same[-1], atol=1e-9)
    if carried_or_refused(BATCH_STEPPER, key, lambda: batch_stepper([model], 2, step)):
        chains = quiet(lambda: batch_stepper([model], 2, step))
        assert not chains.hold(np.stack([p, p]), 100).any()
        np.testing.assert_allclose(chains.position[1], stepper.position, atol=1e-9)


def missing_for(can, model) -> tuple[str, ...]:
    return tuple(k for k, feature in FEATURES.items() if k not in can and feature.names(model))


def ideal(model: Model) -> Model:
    """The model behind its valves."""
    return model.with_(chambers=tuple(replace(c, valve=Valve()) for c in model.chambers))


@pytest.mark.slow
@pytest.mark.parametrize("key", MODELS)
def test_estimators_without_frames_move_as_a_stepper(key):
    """Their pressures are those behind the valves, as they say."""
    model, p, step = MODELS[key], levels(MODELS[key]), 1e-3
    if ideal(model).moving_base:
        assert not carried_or_refused(FILTER, key, lambda: KalmanFilter(model))
        return
    stepper = quiet(lambda: Stepper(ideal(model), step))
    for _ in range(60):
        stepper.step(p)
    if carried_or_refused(FILTER, key, lambda: KalmanFilter(model)):
        seen = KalmanFilter(model, time_step=step)
        seen.push_pressure(0.0, p)
        for k in range(1, 61):
            seen.advance(k * step)
        np.testing.assert_allclose(seen.angle, stepper.angle, atol=1e-7)
    if carried_or_refused(OBSERVER, key, lambda: AdaptiveObserver(model, 4e-3)):
        assert set(OBSERVER.by_nature) == VALVES


@pytest.mark.parametrize("key", MODELS)
def test_residuals_vanish_without_contact(key):
    model, p = MODELS[key], levels(MODELS[key])
    each = np.stack([0.0 * p, p, 0.5 * p[::-1] if p.size > 1 else 0.5 * p])
    if carried_or_refused(STATIC_RESIDUAL, key, lambda: static_residual(model, np.zeros((1, model.size)), each[:1])):
        chain = mechanics_of(model)
        shapes = np.stack([chain.coordinates(equilibrium(model, row)) for row in each])
        size = np.abs(chain.joints.K).max()
        assert np.abs(static_residual(model, shapes, each)).max() < 1e-9 * size
        with pytest.raises(InputError, match="rows of inputs"):
            static_residual(model, shapes, each[:2])
    assert carried_or_refused(
        MOMENTUM_RESIDUAL, key,
        lambda: momentum_residual(model, np.arange(2.0), np.zeros((2, model.size)), np.zeros((2, model.size)), each[:2])
    ) is not (model.space is not None or bool(model.extensions) or key in ("swelling", "inflation", "base_motion"))


@pytest.mark.slow
@pytest.mark.parametrize("key", [k for k, m in MODELS.items() if not MOMENTUM_RESIDUAL.lacks(m)])
def test_a_momentum_observer_sees_nothing_in_a_free_motion(key):
    """But hysteresis, which counts as external."""
    model, p = MODELS[key], levels(MODELS[key])
    if model.memory:
        return
    times = np.arange(301) * 1e-3
    run = quiet(lambda: simulate(model, [Pulse(level, 0.0, 9.0) for level in p], times=times, time_step=2e-4,
                                 check=False))  # fmt: skip
    chain = mechanics_of(model)
    angle, rate = (np.cumsum(run[name].values, axis=1) for name in ("joint_angle", "joint_rate"))
    angle = chain.coordinates(run["joint_angle"].values)
    found = momentum_residual(model, times, angle, rate, run.pressure.values)
    torque = np.abs(model.actuation.joint_torques(p)).max()
    assert np.abs(found[50:]).max() < 0.03 * torque


@pytest.mark.parametrize("key", MODELS)
def test_controllers_and_exports_take_a_model_or_name_what_they_lack(key, tmp_path, monkeypatch):
    monkeypatch.setattr("pliant.exporters.fmu.compiled", lambda *_: (None, "not compiled"))
    model = MODELS[key]
    still = np.zeros((1, 1))
    if carried_or_refused(CONTROL, key, lambda: design_outputs(model, ("tip_x",), still, Limits(1e5), 8e-3)):
        assert not LINEARISE.lacks(model)
    for target, exporter in exporters().items():
        lacks = tuple(k for k in missing_for(exporter.can, model) if k not in exporter.by_nature)
        if lacks:
            with pytest.raises(InputError) as refusal:
                export(model, target, tmp_path / f"arm{ENDS[target]}")
            assert all(name in str(refusal.value) for name in named(model, lacks))
