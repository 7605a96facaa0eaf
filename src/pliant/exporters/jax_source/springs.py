"""Nonlinear springs: torque, slope, curvature and energy. `hardening` (terms + 1, k) holds the coefficients of the
terms, and in its last row the factor R that bounds the change of the slope by the first term.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from pliant.equations.elastic import spring_curvature, spring_energy, spring_slope, spring_torque
from pliant.exporters.jax_source.structure import CURVED, SPRING_BOUND, SPRING_TERMS


def hardening_of(p, K, prefix=""):
    """Return the coefficients (terms + 1, k) of springs of linear stiffness K (k,), from the parameters of a model."""
    terms = [K * p[prefix + name] for name in SPRING_TERMS]
    bound, first = p[prefix + SPRING_BOUND], p[prefix + SPRING_TERMS[0]]
    bounded = bound > 0
    root = jnp.where(bounded, 4.0 / 3.0 * first / jnp.where(bounded, bound, 1.0), 0.0)
    return jnp.stack([*terms, root * root])


def axial_constants(p, length):
    """Return stiffness, damping (S,) and `hardening` (terms + 1, S or 0) of the segments that lengthen."""
    whole = length @ p["share"]
    K, D = p["axial_stiffness"] * whole, p["axial_damping"] * whole
    return K, D, hardening_of(p, K, "axial_") if CURVED else jnp.zeros((len(SPRING_TERMS) + 1, 0), K.dtype)


class SpringCoefficients(NamedTuple):
    """Springs of the equations: their linear stiffnesses (k,) and the coefficients `hardening` (terms + 1, k)."""

    K: jnp.ndarray
    hardening: jnp.ndarray


EVERY = slice(None)


def curved_part(hardening):
    """Return springs without their linear part."""
    return SpringCoefficients(jnp.zeros(1, hardening.dtype), hardening)


def nonlinear_torque(hardening, bend):
    """Return the torque of a spring beyond its linear part K q, at `bend` from its unloaded shape."""
    return spring_torque(EVERY, curved_part(hardening), bend, bend)


def nonlinear_slope(hardening, bend):
    """Return the derivative of `nonlinear_torque` by the bend."""
    return spring_slope(EVERY, curved_part(hardening), bend)


def curvature(hardening, bend):
    """Return the second and the third derivative of `nonlinear_torque`."""
    return spring_curvature(EVERY, curved_part(hardening), bend)


def nonlinear_energy(hardening, bend):
    """Return the energy of a spring beyond that of its linear part."""
    return spring_energy(EVERY, curved_part(hardening), bend, bend)
