"""Fits and filters compare the direction of gravity in the axes of links, without positions; the arm is MuJoCo's."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from pliant.errors import InputError
from pliant.estimation import estimate
from pliant.identification import Parameter, design, experiment, fit, prediction_band
from pliant.identification.observation import modelled_rows, points_at
from pliant.identification.problem import Problem
from pliant.identification.residuals import Observations, noise_ratio
from pliant.mechanics import mechanics_of
from pliant.model import Model, Space, Station, chain_model
from pliant.recording import make_recording
from pliant.simulation import Trace, simulate

Array = np.ndarray
GRAVITY = {2: np.array([3.0, 9.0]), 3: np.array([3.0, -2.0, 9.0])}
TIMES = np.arange(0.0, 1.2, 0.02)
PRESSURE = 3e4 * np.sin(3.0 * TIMES) ** 2
FREE = [Parameter("stiffness", 0.2), Parameter("damping", 0.01)]


def body(dimension: int) -> Model:
    stations = (Station("mid", 0, 0.03), Station("tip", 1, 0.05))
    space = Space(radius=0.01) if dimension == 3 else None
    return chain_model(length=0.2, mass=0.06, links=2, stiffness=0.3, damping=0.02, torque=[1e-6], space=space,
                       gravity=GRAVITY[dimension]).with_(stations=stations)  # fmt: skip


def down(dimension: int) -> Array:
    return GRAVITY[dimension] / np.linalg.norm(GRAVITY[dimension])


def recorded(dimension: int, gravity: Array, pressure: Array = PRESSURE, **more: object) -> xr.Dataset:
    return make_recording(
        TIMES, station=["mid", "tip"], pressure=pressure, frame="planar" if dimension == 2 else "spatial",
        further={"gravity": gravity, "gravity_constants": np.tile(down(dimension), (2, 1))}, **more,
    )


def simulated(dimension: int, pressure: Array) -> tuple[Array, Array]:
    """Gravity (T, S, d) in the axes of both links, and the tip (T, d), under a pressure."""
    model = body(dimension)
    chain = mechanics_of(model)
    run = simulate(model, Trace(TIMES, pressure), times=TIMES, time_step=2e-3, check=False)
    x = chain.coordinates(chain.gathered(run, 0))
    frames = np.array([chain.link_frames(row)[1:] for row in x])
    if dimension == 2:  # the interface states the axis to the left first
        frames = np.stack([-frames[..., 0], frames[..., 1]], axis=-1)
    return np.einsum("tsij,i->tsj", frames, down(dimension)), chain.tips(x)[:, -1]


@pytest.fixture(scope="module", params=[2, 3])
def seen(request: pytest.FixtureRequest) -> tuple[int, Array, Array]:
    """The dimension, gravity (T, S, d) in the axes of both links, and the tip (T, d), simulated."""
    return request.param, *simulated(request.param, PRESSURE)


def test_modelled_rows_turn_gravity_into_the_axes_of_the_link(seen: tuple[int, Array, Array]) -> None:
    dimension, gravity, _ = seen
    chain = mechanics_of(body(dimension))
    run = simulate(body(dimension), Trace(TIMES, PRESSURE), times=TIMES[:2], time_step=2e-3, check=False)
    rows = points_at(chain, chain.coordinates(chain.gathered(run, 0))[0])[None]
    found = modelled_rows(rows, "gravity", np.tile(down(dimension), (2, 1)), planar=dimension == 2)[0]
    np.testing.assert_allclose(found[:, :dimension], gravity[0], atol=1e-12)
    assert np.isnan(found[:, dimension:]).all()


@pytest.mark.parametrize("reference", ["rest", "base"])
def test_a_recording_of_inclinations_is_an_experiment(seen: tuple[int, Array, Array], reference: str) -> None:
    dimension, gravity, _ = seen
    exp = experiment("e", recorded(dimension, gravity, angle_reference=reference))
    assert exp.without_positions
    assert exp.axes == ("gravity_x", "gravity_y", "gravity_z")[:dimension]
    assert exp.shown_in[0] == "deg"
    assert exp.compared.shape == gravity.shape
    change = exp.compared - gravity
    np.testing.assert_allclose(change, np.broadcast_to(change[:1], change.shape), atol=1e-12)
    assert (np.abs(change).max() > 0.1) == (reference == "rest")
    observed = Observations(exp, "travel")
    assert observed.count == gravity.size == observed.is_compared.sum()
    assert noise_ratio(observed, np.zeros(observed.count)) == 0.0
    with pytest.raises(InputError, match="own_places"):
        experiment("e", recorded(dimension, gravity), own_places=True)


def test_a_constant_offset_of_a_sensor_has_no_effect_from_rest(seen: tuple[int, Array, Array]) -> None:
    dimension, gravity, _ = seen
    biased = gravity + 0.03
    plain, moved = (experiment("e", recorded(dimension, g / np.linalg.norm(g, axis=-1, keepdims=True)))
                    for g in (gravity, biased))  # fmt: skip
    off = np.abs(moved.compared - plain.compared).max()
    assert off < 0.3 * 0.03
    absolute = [experiment("e", recorded(dimension, g, angle_reference="base"))
                for g in (gravity, biased / np.linalg.norm(biased, axis=-1, keepdims=True))]
    assert np.abs(absolute[1].compared - absolute[0].compared).max() > 2.0 * off


def test_another_direction_of_gravity_is_refused(seen: tuple[int, Array, Array]) -> None:
    dimension, gravity, _ = seen
    recording = recorded(dimension, gravity)
    exp, other = experiment("e", recording), body(dimension).with_(gravity=-GRAVITY[dimension])
    with pytest.raises(InputError, match="correct down in the mapping of the recording, or gravity"):
        fit([exp], other, FREE)
    with pytest.raises(InputError, match="correct down in the mapping of the recording, or gravity"):
        estimate(recording, other)
    with pytest.raises(InputError, match="gravity_y cannot be estimated from recordings of inclination"):
        fit([exp], body(dimension), [*FREE, Parameter("gravity_y", 1.0)])


@pytest.mark.parametrize("reference", ["rest", "base"])
def test_a_filter_on_inclinations_follows_the_tip(seen: tuple[int, Array, Array], reference: str) -> None:
    dimension, gravity, tip = seen
    softer = body(dimension).with_(stiffness=0.33)
    out = estimate(recorded(dimension, gravity, angle_reference=reference), softer)
    off = np.linalg.norm(out.tip_position.values[10:, -1] - tip[10:], axis=1)
    free = simulate(softer, Trace(TIMES, PRESSURE), times=TIMES, time_step=2e-3, check=False)
    alone = np.linalg.norm(free.station_position.values[10:, -1] - tip[10:], axis=1)
    assert off.max() < 1.5e-3
    assert off.max() < 0.5 * alone.max()


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_filter_begins_under_the_first_inputs(dimension: int) -> None:
    pressure = np.full(TIMES.size, 8e3)
    gravity, tip = simulated(dimension, pressure)
    out = estimate(recorded(dimension, gravity, pressure, angle_reference="rest"), body(dimension))
    assert np.linalg.norm(out.tip_position.values[:, -1] - tip, axis=1).max() < 1e-4


@pytest.mark.slow  # loads the compiler of dual numbers
@pytest.mark.parametrize("reference", ["rest", "base"])
def test_the_derivatives_of_a_fit_are_those_of_differences(seen: tuple[int, Array, Array], reference: str) -> None:
    dimension, gravity, _ = seen
    exp = experiment("e", recorded(dimension, gravity, angle_reference=reference))
    problem = Problem([exp], body(dimension), [*FREE, Parameter("gain", 1.1)], 2e-3, "travel")
    J = problem.data_jacobian(problem.start)
    for k in range(3):
        h = 1e-6 * np.eye(3)[k]
        slope = (problem.data_residual(problem.start + h) - problem.data_residual(problem.start - h)) / 2e-6
        np.testing.assert_allclose(J[:, k], slope, atol=1e-5 * np.abs(slope).max())


@pytest.mark.slow  # fits, on dual numbers
def test_a_fit_with_inclinations_alone_has_a_band(seen: tuple[int, Array, Array]) -> None:
    dimension, gravity, _ = seen
    noisy = gravity + 1e-3 * np.random.default_rng(1).standard_normal(gravity.shape)
    exp = experiment("e", recorded(dimension, noisy / np.linalg.norm(noisy, axis=-1, keepdims=True)))
    found = fit([exp], body(dimension), FREE, time_step=2e-3)
    assert found.turns
    assert found.values["stiffness"] == pytest.approx(0.3, rel=0.01)
    assert found.values["damping"] == pytest.approx(0.02, rel=0.05)
    band = prediction_band(exp, found)
    assert band.std.shape == gravity.shape
    assert np.isfinite(band.std).all()
    assert np.isfinite(prediction_band(exp, found, training=[exp]).std).all()
    proposed = design(found, [exp]).proposals
    assert proposed
    assert all(np.isfinite([*one.std.values()]).all() for one in proposed)


@pytest.mark.slow  # MuJoCo's steps in Python
def test_stiffness_and_damping_of_mujocos_arm_follow_from_inclinations_alone() -> None:
    pytest.importorskip("mujoco")
    from oracles import inertial

    times, up, tip = inertial.measured()
    model = inertial.arm()
    recording = make_recording(
        times, station=["mid", "tip"], frame="spatial", pressure=inertial.pressures(times), chamber=["left", "right"],
        angle_reference="base", further={
            "gravity": -up @ inertial.AXES.T / np.linalg.norm(up, axis=-1, keepdims=True),
            "gravity_constants": np.tile(inertial.DOWN, (2, 1))},
    )  # fmt: skip
    exp = experiment("e", recording, drive={"left": "left", "right": "right"})
    found = fit([exp], model, [Parameter("stiffness", 0.12), Parameter("damping", 1.2e-3)])
    assert found.values["stiffness"] == pytest.approx(0.08, rel=2e-3)
    assert found.values["damping"] == pytest.approx(6e-4, rel=0.3)
    out = estimate(recording, found.model.with_(stiffness=0.09))
    assert np.linalg.norm(out.tip_position.values[10:, -1] - tip[10:], axis=1).max() < 2e-3 < 0.1 * np.ptp(tip[:, 1])


def test_settled_poses_of_inclinations_are_one_pose_each(seen: tuple[int, Array, Array]) -> None:
    dimension, gravity, _ = seen
    if dimension == 2:
        with pytest.raises(InputError, match="poses need a body in space"):
            experiment("e", recorded(dimension, gravity, angle_reference="base"), poses="median", inputs={"": 1e4})
        return
    with pytest.raises(InputError, match='state reference = "base"'):
        experiment("e", recorded(dimension, gravity), poses="median", inputs={"": 1e4})
    exp = experiment("e", recorded(dimension, gravity, angle_reference="base"), poses="median", inputs={"": 1e4})
    np.testing.assert_allclose(np.linalg.norm(exp.further["gravity"].values, axis=-1), 1.0, atol=1e-12)
    assert exp.compared.shape == (1, 2, 3)
