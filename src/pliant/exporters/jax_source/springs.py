"""Nonlinear springs: torque, slope, curvature and energy. `hardening` (terms + 1, k) holds the coefficients of the
terms, and in its last row the factor R that bounds the change of the slope by the first term.
"""

from __future__ import annotations

import jax.numpy as jnp

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


def bounded_factor(hardening, bend):
    """Return r = 1 / sqrt(1 + R bend^2), which falls from 1 as a bounded spring bends."""
    return 1.0 / jnp.sqrt(1.0 + hardening[-1] * bend * bend)


def nonlinear_torque(hardening, bend):
    """Return the torque of a spring beyond its linear part K q, at `bend` from its unloaded shape."""
    more = 0.0 * bend
    for row in hardening[-2:0:-1]:
        more = (more + row) * bend
    r = bounded_factor(hardening, bend)
    more = more + hardening[0] * (r * (2.0 + r) / (1.0 + r) * (2.0 / 3.0))
    return more * bend * bend


def nonlinear_slope(hardening, bend):
    """Return the derivative of `nonlinear_torque` by the bend."""
    more = 0.0 * bend
    for k in range(hardening.shape[0] - 2, 0, -1):
        more = (more + (k + 2.0) * hardening[k]) * bend
    r = bounded_factor(hardening, bend)
    return (more + hardening[0] * (r * (2.0 + r * r) * (2.0 / 3.0))) * bend


def curvature(hardening, bend):
    """Return the second and the third derivative of `nonlinear_torque`."""
    second, third = 0.0 * bend, 0.0 * bend
    for k in range(hardening.shape[0] - 2, 0, -1):
        third = third * bend + (k + 2.0) * (k + 1.0) * k * hardening[k]
        second = (second + (k + 2.0) * (k + 1.0) * hardening[k]) * bend
    r = bounded_factor(hardening, bend)
    first = 2.0 * hardening[0] * r**5
    return second + first, third - 5.0 * hardening[-1] * bend * r * r * first


def nonlinear_energy(hardening, bend):
    """Return the energy of a spring beyond that of its linear part."""
    root = jnp.sqrt(1.0 + hardening[-1] * bend * bend)
    cube = bend * bend * bend
    more = hardening[0] * cube * ((2.0 / 3.0) / (1.0 + root))
    for k in range(1, hardening.shape[0] - 1):
        more = more + hardening[k] * cube * bend**k / (k + 3.0)
    return more
