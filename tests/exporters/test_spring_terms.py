"""Every nonlinear term of the springs goes through each part of pliant by the same tests, in the plane and in space."""

from __future__ import annotations

import inspect
import shutil
from dataclasses import fields

import numpy as np
import pytest
from binding import Arm

import pliant
from pliant.batch import simulate_batch
from pliant.equations.spring_terms import SPRING_BOUND, SPRING_TERMS
from pliant.errors import InputError
from pliant.exporters.registry import exporters
from pliant.exporters.state_space import linear_model
from pliant.identification.experiment import Experiment
from pliant.identification.prediction import predict
from pliant.identification.sensitivity import sensitivities
from pliant.mechanics import mechanics_of, springs
from pliant.model import Extension, Model, Space, Station
from pliant.model.features import missing
from pliant.recording import make_recording
from pliant.simulation import Pulse, Stepper, Trace, equilibrium, simulate

LEVEL, STEP = 5e4, 2e-3  # Pa, s
PLANAR = Model(
    link_length=[0.05, 0.05], link_mass=0.02, stiffness=[0.5, 0.4], damping=0.004, torque=[3e-6], tip_mass=0.01,
    gravity=[2.0, -9.0], stations=[Station("tip", 1, 0.05)],
)
EACH_TERM = pytest.mark.parametrize("term", SPRING_TERMS)
EACH_BODY = pytest.mark.parametrize("spatial", [False, True], ids=["plane", "space"])

SLOW_IN_SPACE = pytest.mark.parametrize(  # compiled for each number of coordinates
    "spatial", [pytest.param(False, id="plane"), pytest.param(True, id="space", marks=pytest.mark.slow)]
)


def bent(term: str, spatial: bool, factor: float = 1.0) -> Model:
    """A body whose springs have the term alone, which is `factor` 60 % of the linear torque at 0.3 rad."""
    power = 1 + list(SPRING_TERMS).index(term)
    model = PLANAR.with_(**{term: factor * 0.6 / 0.3**power})
    return model.with_(space=Space(stiffness_ratio=1.3, twist_ratio=0.7, radius=0.01), gravity=[2.0, 1.0, -9.0],
                       cross_gain=0.5) if spatial else model  # fmt: skip


@EACH_TERM
@EACH_BODY
def test_a_term_is_kept_in_files_and_shown(term, spatial, tmp_path):
    model = bent(term, spatial)
    assert pliant.load_model(pliant.save_model(model, tmp_path / "m.json")) == model
    assert f"{SPRING_TERMS[term].letter} in {SPRING_TERMS[term].unit}: " in str(model)
    with pytest.raises(InputError, match=f"model {term}"):
        model.with_(**{term: np.nan})
    if not spatial:
        longer = model.with_(extensions=(Extension(300.0, **{term: 0.3}),))
        assert pliant.load_model(pliant.save_model(longer, tmp_path / "l.json")) == longer
        assert springs.axial_springs_of(longer).terms[list(SPRING_TERMS).index(term)] == 0.3


@EACH_TERM
@EACH_BODY
def test_forces_are_those_of_the_energy_and_the_tangent_is_theirs(term, spatial):
    model = bent(term, spatial)
    chain, q, h = mechanics_of(model), 0.1 * np.cos(np.arange(model.size)) + 0.15, 1e-6
    each = h * np.eye(model.size)
    still, none = np.zeros(model.size), np.zeros(model.size)

    def potential(q):
        energy = chain.energy(chain.coordinates(q), still)
        return energy.elastic + energy.gravity

    def forces(q):
        return -chain.from_joints.T @ chain.static_forces(chain.coordinates(q), none)

    slope = [(potential(q + d) - potential(q - d)) / (2 * h) for d in each]
    np.testing.assert_allclose(forces(q), slope, atol=1e-8)
    tangent = np.array([(forces(q + d) - forces(q - d)) / (2 * h) for d in each]).T
    np.testing.assert_allclose(chain.linear_parts(q)[1], tangent, atol=1e-7)
    linear = mechanics_of(model.with_(**{term: 0.0}))
    assert np.abs(chain.linear_parts(q)[1] - linear.linear_parts(q)[1]).max() > 0.1  # the term is in it


@EACH_TERM
@SLOW_IN_SPACE
def test_a_motion_is_that_of_an_adaptive_solver_of_the_stepper_and_of_a_batch(term, spatial):
    models = [bent(term, spatial, factor) for factor in (1.0, 0.4, 0.2, 0.0, 0.7)]
    times, pulse = np.linspace(0.0, 0.2, 21), Pulse(LEVEL, 0.0, 1.0)
    exact = simulate(models[0], pulse, times=times, method="LSODA", rtol=1e-9)
    runs = [simulate(m, pulse, times=times, time_step=1e-3, check=False) for m in models]
    assert np.abs(runs[0].tip_position - exact.tip_position).max() < 1e-4
    assert np.abs(runs[0].tip_position - runs[3].tip_position).max() > 2e-3
    many = simulate_batch(models, pulse, times=times, time_step=1e-3)
    alike = simulate_batch(models[3], pulse, parameters={term: [getattr(m, term)[0] for m in models]}, times=times,
                           time_step=1e-3)  # fmt: skip
    for i, run in enumerate(runs):
        np.testing.assert_allclose(many.tip_position.values[i], run.tip_position.values, atol=1e-12)
        np.testing.assert_allclose(alike.tip_position.values[i], run.tip_position.values, atol=1e-12)
    stepper = Stepper(models[0], 1e-3)
    stepper.step(LEVEL, 200)
    np.testing.assert_allclose(stepper.tips()[-1], runs[0].tip_position.values[-1].ravel()[-stepper.tips().shape[1] :],
                               atol=1e-9)  # fmt: skip


@EACH_TERM
@EACH_BODY
def test_linear_models_have_the_gain_of_the_equilibria(term, spatial):
    model, h = bent(term, spatial), 5.0
    gain = (equilibrium(model, LEVEL + h) - equilibrium(model, LEVEL - h)) / (2 * h)
    for linear in (pliant.linearise(model, LEVEL), linear_model(model, LEVEL)):
        settled = -np.linalg.solve(linear.A, linear.B).ravel()[: model.size]
        reached = mechanics_of(model).joint_coordinates(settled) - mechanics_of(model).joint_coordinates(0.0 * settled)
        np.testing.assert_allclose(reached, gain, rtol=1e-5, atol=1e-9)


@EACH_TERM
def test_springs_lose_their_stiffness_where_their_slope_first_vanishes(term):
    rng = np.random.default_rng(4)
    terms = np.zeros((len(SPRING_TERMS), 40))
    terms[: list(SPRING_TERMS).index(term) + 1] = rng.uniform(-1.5, 1.0, (list(SPRING_TERMS).index(term) + 1, 40))
    bent = springs.Springs(np.ones(40), terms, np.where(np.arange(40) % 2, 0.7, 0.0))
    angles = np.linspace(0.0, 30.0, 15001)[:, None]
    lost = springs.Springs(*(np.repeat(a[..., None, :], len(angles), axis=-2) for a in (bent.K, terms, bent.bound)))
    gone = lost.slope(np.broadcast_to(angles, lost.K.shape)) <= 0
    first = np.where(gone.any(axis=0), angles[gone.argmax(axis=0), 0], np.inf)
    turn = bent.turn()
    assert 5 < np.isfinite(first).sum() < 40
    np.testing.assert_allclose(np.where(turn < 30.0, turn, np.inf), first, atol=2.1e-3)
    held = np.minimum(0.9 * turn, 2.0)
    np.testing.assert_allclose(bent.bend(bent.torque(held)), held, rtol=1e-9)


@pytest.mark.slow
@EACH_TERM
@EACH_BODY
def test_a_fit_has_the_derivative_of_differences_and_a_filter_follows(term, spatial):
    model, times = bent(term, spatial), np.arange(0.0, 0.4, 0.01)
    seen = simulate(model, Pulse(LEVEL, 0.1, 1.0), times=times, time_step=STEP, check=False)
    tip = seen.station_position.values
    exp = Experiment("e", times, tip, ("tip",), "trace", pressure=Trace([0.0, 0.1, 0.1], [0.0, 0.0, LEVEL]))
    value = float(getattr(model, term)[0])
    _, slopes = sensitivities(model, exp, {term: value}, {term: value}, STEP)
    up, down = (predict(model, exp, {term: value * (1 + s)}, STEP)["position"] for s in (1e-5, -1e-5))
    difference = (up - down) / (2e-5 * value)
    np.testing.assert_allclose(slopes[0][..., : tip.shape[-1]], difference, atol=2e-6 * np.abs(difference).max())
    assert np.abs(difference * value).max() > 1e-3
    recording = make_recording(
        times, tip, station=["tip"], frame="spatial" if spatial else "planar", pressure_time=times,
        pressure=np.where(times >= 0.1, LEVEL, 0.0), source="simulated",
    )
    found = pliant.estimate(recording, model, time_step=STEP)
    wrong = pliant.estimate(recording, model.with_(**{term: 0.0}), time_step=STEP)
    torque = mechanics_of(model).kinds[0].names[2]
    off, far = (np.abs(f[torque].values[-5:]).max() for f in (found, wrong))
    assert off < 0.2 * far


@EACH_TERM
@SLOW_IN_SPACE
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_c_steps_as_the_stepper(term, spatial, tmp_path):
    model = bent(term, spatial)
    arm, stepper = Arm(model, tmp_path), Stepper(model, 1e-3)
    for _ in range(100):
        assert arm.step(LEVEL) == 0
        stepper.step(LEVEL)
    assert arm.angle == pytest.approx(stepper.position, abs=1e-13)


@EACH_TERM
@EACH_BODY
@pytest.mark.parametrize("target", sorted(exporters().keys() - {"c99", "fmu"}))  # their steps are compared above
def test_an_export_differs_by_the_term_or_refuses_it(term, spatial, target, tmp_path):
    exporter = exporters()[target]
    model, options = bent(term, spatial), {"pressure": [LEVEL]} if target == "state-space" else {}
    straight = model.with_(**{term: 0.0})
    paths = [tmp_path / f"{name}{exporter.suffixes[-1]}" for name in ("bent", "straight")]
    pliant.export(straight, target, paths[1], **options)
    lost = set(missing(model, exporter.can)) - set(missing(straight, exporter.can))
    if lost - set(exporter.by_nature):
        with pytest.raises(InputError, match=f"soften|{term}"):
            pliant.export(model, target, paths[0], **options)
        return
    done = pliant.export(model, target, paths[0], **options)
    if lost:
        assert any("no springs" in note for note in done.notes)
    elif target == "state-space":
        one, other = (np.load(path)["A"] for path in paths)
        assert np.abs(one - other).max() > 1.0
    else:
        assert paths[0].read_text() != paths[1].read_text().replace("straight", "bent")


def test_every_term_is_a_field_of_models_and_of_segments():
    named = {*SPRING_TERMS, SPRING_BOUND}
    assert named <= {f.name for f in fields(Model)}
    assert named <= {f.name for f in fields(Extension)}
    assert named <= set(inspect.signature(Model).parameters)
