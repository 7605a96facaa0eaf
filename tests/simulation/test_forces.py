"""Forces at points of the body: the rest under them, their work, and the same motion one step at a time."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.model import Chamber, Extension
from pliant.simulation import Pulse, Stepper, equilibrium, simulate
from pliant.simulation.forces import PointForce

FORCE = np.array([0.3, -0.2])


def held(force=FORCE, start=0.1, stop=np.inf, at="tip"):
    """A force that sets in and, some time, ends."""
    stop = min(stop, 1e6)
    zero = np.zeros(2)
    return PointForce(np.array([start, start, stop, stop]), np.array([zero, force, force, zero]), at)


@pytest.fixture
def lengthening(paper):
    """The paper's beside a chamber that lengthens its two segments."""
    near, far = Extension(20.0, 0.5, 0.0, 0.09, "near"), Extension(15.0, 0.4, 0.09, None, "far")
    return paper.with_(chambers=(Chamber.at_offset(4e-5, 0.016, np.ones(5)),), extensions=(near, far))


@pytest.fixture(params=["paper", "lengthening"])
def body(request):
    """With a point at its tip."""
    paper = request.getfixturevalue(request.param)
    return paper.with_(stations=[("middle", 2, 0.01, 0.003), ("tip", 4, float(paper.link_length[-1]), 0.0)])


def test_it_ends_at_the_rest_under_the_force(body):
    run = simulate(body, Pulse(4e4, 0.1, 1e6), duration=20.0, time_step=2e-3, forces=[held()])
    rest = equilibrium(body, 4e4, FORCE)
    assert run.joint_angle.values[-1] == pytest.approx(rest[:5], abs=1e-8)
    if body.extensions:
        assert run.axial_strain.values[-1] == pytest.approx(rest[5:], abs=1e-8)
        assert not np.allclose(rest[5:], equilibrium(body, 4e4)[5:], rtol=0.05), "the force stretches it"
    assert not run.joint_angle.values[0].any(), "the force sets in after the start"
    before = simulate(body, Pulse(0.0), duration=0.2, forces=[held(start=-1.0)])
    assert np.ptp(before.joint_angle.values, axis=0) == pytest.approx(0.0, abs=1e-9), "at rest under it from the start"


@pytest.mark.parametrize("at", ["middle", "tip"])
def test_its_work_is_in_the_balance(body, at):
    run = simulate(body, Pulse(4e4, 0.0, 0.3), duration=0.6, time_step=5e-5, forces=[held(stop=0.4, at=at)])
    stored = run.kinetic_energy + run.elastic_energy + run.gravitational_energy
    gap = stored - stored[0] - run.input_work + run.dissipated_energy
    assert np.abs(gap.values).max() < 1e-4 * float(run.input_work.max())
    alone = simulate(body, Pulse(0.0), duration=0.6, time_step=5e-5, forces=[held(stop=10.0, at=at)])
    way = alone.station_position.sel(station=at).values
    assert alone.input_work.values[-1] == pytest.approx(float(FORCE @ (way[-1] - way[0])), rel=1e-4)


@pytest.mark.parametrize("which", ["paper", "awkward", "lengthening"])
def test_the_stepper_moves_alike(request, which):
    model = request.getfixturevalue(which)
    point, stepper = model.points[-1].name, Stepper(model, 1e-3)
    stepper.push(FORCE, point)
    angles = []
    for _ in range(150):
        angles.append(stepper.step(3e4)[0].copy())
        strain = stepper.strain.copy()
    run = simulate(model, Pulse(3e4, 0.0, 1.0), duration=0.15, time_step=1e-3, forces=[held(start=0.0, at=point)],
                   initial_angle=equilibrium(model))  # fmt: skip
    phi = model.base_angle + np.cumsum(run.joint_angle.values + model.rest_angle, axis=1)
    assert phi[1:] == pytest.approx(np.array(angles), abs=1e-10)
    if model.extensions:
        assert run.axial_strain.values[-1] == pytest.approx(strain, abs=1e-10)


def test_what_is_no_force_is_refused(body):
    with pytest.raises(InputError, match="forces need method='midpoint' or method='accurate', got 'Radau'"):
        simulate(body, Pulse(0.0), duration=0.1, method="Radau", forces=[held()])
    with pytest.raises(InputError, match="acts at 'nowhere'"):
        simulate(body, Pulse(0.0), duration=0.1, forces=[held(at="nowhere")])
    with pytest.raises(InputError, match=r"a known force needs one row \[fx, fy\] for each time"):
        simulate(body, Pulse(0.0), duration=0.1, forces=[PointForce([0.0, 1.0], [[0.0, 0.1]], "tip")])
    with pytest.raises(InputError, match="a known force and its times must be finite"):
        simulate(body, Pulse(0.0), duration=0.1, forces=[held(force=np.array([np.nan, 0.0]))])
    with pytest.raises(InputError, match="the times of a known force must not decrease"):
        simulate(body, Pulse(0.0), duration=0.1, forces=[PointForce([1.0, 0.0], [[0.0, 0.1], [0.0, 0.1]], "tip")])
