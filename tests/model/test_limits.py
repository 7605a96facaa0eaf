"""The bounds of a model's numbers, at their edges; walls that soften; what is no chamber."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.model import Chamber, Model
from pliant.model.actuation_input import rest_growth
from pliant.model.memory import payne, springpot
from pliant.model.parts import declared
from pliant.model.quantity import MOST_TERMS

LIMITS = {d.name: d.quantity for d in declared() if math.isfinite(d.quantity.most)}
SIZES = {"link_length": 0.1, "link_mass": 0.05, "stiffness": 0.5}


@pytest.mark.parametrize("name", LIMITS)
def test_each_bound_is_itself_allowed_and_nothing_beyond(name):
    limit = LIMITS[name]
    for size in (limit.least, limit.most):
        limit.check_limit("model", name, size)
        limit.check_limit("model", name, -size)
    with pytest.raises(InputError, match=f"model {name} must have a size of .*check its unit"):
        limit.check_limit("model", name, math.nextafter(limit.most, math.inf))
    if limit.least > 0.0:
        with pytest.raises(InputError, match="must have a size"):
            limit.check_limit("model", name, -math.nextafter(limit.least, 0.0))
    if limit.least == 0.0 or limit.zero:
        limit.check_limit("model", name, 0.0)
    else:
        with pytest.raises(InputError, match="must have a size"):
            limit.check_limit("model", name, 0.0)


def test_bounds_are_powers_of_ten():
    """They are generous on purpose; one that is none was typed in error. An exponent of the hysteresis ends at 50."""
    sizes = [v for name, x in LIMITS.items() for v in (x.least, x.most) if v and name != "boucwen_exponent"]
    assert all(math.log10(v) == pytest.approx(round(math.log10(v)), abs=1e-12) for v in sizes)
    assert LIMITS["boucwen_exponent"].most == 50.0


def test_a_wall_at_rest_grows_as_its_limit_says():
    """1 / (1 - p / limit), without end from the limit on; a limit of 0 is none."""
    pressure = np.array([0.0, 2e4, 5e4, 9e4, 1e5, 2e5])
    np.testing.assert_allclose(rest_growth(pressure, 1e5), [1.0, 1.25, 2.0, 10.0, np.inf, np.inf])
    np.testing.assert_array_equal(rest_growth(pressure, 0.0), 1.0)
    np.testing.assert_allclose(rest_growth(np.full(2, 5e4), np.array([2e5, 0.0])), [4.0 / 3.0, 1.0])


@pytest.mark.parametrize("chambers", [("low",), (Chamber([1e-6], name="low"), "high"), ({"torque": [1e-6]},)])
def test_what_is_no_chamber_is_refused(chambers):
    with pytest.raises(InputError, match="chambers must be Chamber objects"):
        Model(**SIZES, damping=1e-3, chambers=chambers)


@pytest.mark.parametrize("changes", [
    {"share": -0.1}, {"share": math.inf}, {"order": 0.0}, {"order": 1.0}, {"order": 1.5}, {"low": 0.0}, {"low": 10.0},
    {"low": 11.0}, {"high": math.inf},
])  # fmt: skip
def test_a_springpot_that_is_none_is_refused(changes):
    with pytest.raises(InputError, match="a springpot needs share >= 0, 0 < order < 1 and 0 < low < high in Hz"):
        springpot(**{"share": 0.2, "order": 0.3, "low": 0.1, "high": 10.0} | changes)


@pytest.mark.parametrize("changes", [
    {"share": -0.1}, {"share": math.inf}, {"angle": 0.0}, {"angle": math.inf}, {"exponent": 0.0}, {"exponent": 0.51},
    {"low": 0.0}, {"low": 0.1}, {"low": 0.2}, {"high": math.inf},
])  # fmt: skip
def test_a_curve_of_payne_that_is_none_is_refused(changes):
    with pytest.raises(InputError, match="Payne's curve needs share >= 0, angle > 0"):
        payne(**{"share": 2.0, "angle": 0.02, "exponent": 0.4, "low": 1e-3, "high": 0.1} | changes)


def test_bands_as_wide_as_the_branches_of_a_memory_reach():
    """Two branches a decade and one more; three slip elements a decade and one more."""
    decades = (MOST_TERMS - 1) / 2 - 1
    assert len(springpot(0.2, 0.3, 1e-3, 1e-3 * 10**decades).creep_share) == MOST_TERMS
    with pytest.raises(InputError, match=f"needs {MOST_TERMS + 1} branches"):
        springpot(0.2, 0.3, 1e-3, 1.01e-3 * 10**decades)
    decades = (MOST_TERMS - 1) / 3
    assert len(payne(2.0, 0.02, 0.4, 1e-4, 1e-4 * 10**decades).slip_share) == MOST_TERMS
    with pytest.raises(InputError, match=f"needs {MOST_TERMS + 1} slip elements"):
        payne(2.0, 0.02, 0.4, 1e-4, 1.01e-4 * 10**decades)
    assert springpot(0.0, 0.3, 0.1, 10.0).creep_share[0] == payne(0.0, 0.02, 0.5, 1e-3, 0.1).slip_share[0] == 0.0
