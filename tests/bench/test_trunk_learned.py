"""The learned models of the benchmark find systems of their own kind again."""

from __future__ import annotations

import benchmark_scripts
import numpy as np
import pytest

trunk = benchmark_scripts.loaded("trunk_learned")
RNG = np.random.default_rng(5)
ANGLES = np.cumsum(RNG.standard_normal((400, 6)), axis=0) * 0.05
HALF = np.arange(400) < 250


def test_a_cubic_map_is_found_and_a_linear_one_is_not_enough():
    weight = RNG.standard_normal((84, 9))
    run = trunk.Run(ANGLES, trunk.monomials(3, ANGLES) @ weight)
    cubic, linear = (trunk.Static(d, (), 0.0).fit(run, HALF).predict(run) for d in (3, 1))
    assert max(trunk.off(cubic, run, ~HALF)) < 1e-6
    assert min(trunk.off(linear, run, ~HALF)) > 0.1


def test_linear_dynamics_run_freely_through_what_they_have_not_seen():
    turn = np.kron(np.eye(3), 0.9 * np.array([[0.9, 0.3, 0.0], [-0.3, 0.9, 0.0], [0.0, 0.0, 0.8]]))
    push = RNG.standard_normal((9, 6))
    places = np.zeros((400, 9))
    for k in range(1, 400):
        places[k] = turn @ places[k - 1] + push @ ANGLES[k]
    run = trunk.Run(ANGLES, places)
    model = trunk.Linear(1, 9, 1, 0.0).fit(run, HALF)
    assert max(trunk.off(model.predict(run), run, ~HALF)) < 1e-6
    gaps = places.copy()
    gaps[100:120, 6:] = np.nan  # a frozen tip: its frames teach nothing and are not judged
    lost = trunk.Run(ANGLES, gaps)
    assert max(trunk.off(trunk.Linear(1, 9, 1, 0.0).fit(lost, HALF).predict(lost), lost, HALF)) < 1e-6


def test_monomials_and_lags():
    values = np.array([[2.0, 3.0], [5.0, 7.0]])
    np.testing.assert_array_equal(trunk.monomials(2, values), [[1, 2, 3, 4, 6, 9], [1, 5, 7, 25, 35, 49]])
    np.testing.assert_array_equal(trunk.shifted(values, (0, 1)), [[2, 3, 2, 3], [5, 7, 2, 3]])
    assert trunk.monomials(3, np.zeros((1, 6))).shape == (1, 84)


def test_the_choice_of_an_order_is_made_inside_the_training_blocks():
    run = trunk.Run(ANGLES, trunk.monomials(1, ANGLES) @ RNG.standard_normal((7, 9)))
    block = np.arange(400) // 25
    spoilt = trunk.Run(run.angles, np.where(HALF[:, None], run.places, RNG.standard_normal((400, 9))))
    makers = [lambda: trunk.Static(3, (), 1e3), lambda: trunk.Static(1, (), 0.0)]
    assert trunk.chosen(makers, spoilt, HALF, block).degree == 1
    model = trunk.chosen(makers, spoilt, HALF, block)
    assert trunk.off(model.predict(run), run, ~HALF)[1] == pytest.approx(0, abs=1e-6)
