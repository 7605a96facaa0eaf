"""The Jacobian of a step in space, and what a filter sees, against differences through the kernels' own texts."""

import numpy as np
import pytest
from oracles.derivatives import plain_slopes

from pliant.equations import linearised, tendon
from pliant.mechanics import mechanics_of
from pliant.model import Space, Station, Tendon, chain_model

CORDS = [Tendon.at_azimuth(a, np.ones(2), driven_by="displacement", lever=8e-3, line_stiffness=2e3, pretension=0.5,
                           friction=0.2, slip_rate=0.01, name=str(a)) for a in (0.4, 2.5, 4.6)]  # fmt: skip


@pytest.fixture
def bent(rng):
    space = Space(stiffness_ratio=1.4, twist_ratio=0.8, radius=0.02, rest_turn=rng.normal(0, 0.2, (2, 3)))
    model = chain_model(length=0.3, mass=0.1, links=2, stiffness=0.5, damping=5e-3, gravity=(1.0, -2.0, -9.0),
                        cubic_stiffening=0.4, space=space, chambers=CORDS, stations=[Station("m", 1, 0.1, 0.01, -0.02)])
    return model, rng.normal(0, 0.4, 6), rng.normal(0, 3.0, 6), np.append(rng.normal(0, 0.05, 6), [1.5, -2.0, 0.3])


def stepped(chain, x, v, torque):
    x, v = x.copy(), v.copy()
    tendon.step(x, v, 4e-3, torque, chain.body, chain.joints, chain.workspace())
    return np.append(x, v)


def test_the_jacobian_of_a_step_in_space_is_that_of_differences(bent, monkeypatch):
    model, x, v, torque = bent
    chain = mechanics_of(model)
    slopes, after, rates = plain_slopes(chain.workspace(complex)), x.copy(), v.copy()
    monkeypatch.setattr(linearised, "step", tendon.step)  # as its twin does: `choose.jacobian_twin`
    linearised.step_jacobian(after, rates, 4e-3, torque, chain.body, chain.joints, slopes)
    assert np.allclose(np.append(after, rates), stepped(chain, x, v, torque), rtol=0, atol=1e-12)
    places = [(by, i) for by, count in enumerate((6, 6, 9)) for i in range(count)]  # the last 3: commands of tendons
    assert slopes.J.shape == (len(places), 12)
    for row, (by, i) in enumerate(places):
        ends, size = [], (1e-5, 1e-4, 1e-4)[by]
        for sign in (1, -1):
            moved = [x.copy(), v.copy(), torque.copy()]
            moved[by][i] += sign * size
            ends.append(stepped(chain, *moved))
        difference = (ends[0] - ends[1]) / (2 * size)
        assert np.abs(slopes.J[row] - difference).max() < 1e-6 * (1.0 + np.abs(difference).max())


