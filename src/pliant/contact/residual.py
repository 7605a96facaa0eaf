"""Torques that pressure and material do not explain: by the momentum observer, and from the shape at rest."""

from __future__ import annotations

import numpy as np

from pliant.compiler.choose import twin
from pliant.equations import contact, elastic
from pliant.errors import InputError
from pliant.mechanics import mechanics_of
from pliant.model import Model, fixed_length
from pliant.model.statics import joint_torques_over

Array = np.ndarray


def momentum_residual(
    model: Model, time: Array, angle: Array, rate: Array, pressure: Array, *, bandwidth: float = 40.0
) -> Array:
    """External joint torques (T, n) by the generalized-momentum observer, N m.

    r = K_O [p - p(0) - int(p_dot of the model + r) dt],  so that dr/dt = K_O (tau_ext - r)

    Parameters
    ----------
    model : Model
    time : array (T,)
        s.
    angle, rate : array (T, n)
        Absolute link angles [rad] and rates [rad/s]; no acceleration is needed.
    pressure : array (T,), (T, C) of several chambers
        Pa at these times.
    bandwidth : float
        K_O, 1/s: fast observers see early and are noisy.

    Raises
    ------
    InputError
        When lengths do not agree or the bandwidth is not positive.

    Source: De Luca and Mattone (2003); memory of the joints counts as external here
    """
    T, n = np.shape(angle)
    if np.shape(rate) != (T, n) or np.shape(pressure)[:1] != (T,) or np.shape(time) != (T,) or not bandwidth > 0:
        raise InputError(f"the observer needs rates (T, n), pressures and times (T,) beside angles {np.shape(angle)}")
    body, joints, _ = mechanics_of(fixed_length(model)).parts()
    momentum, momentum_rate = twin(contact.momentum), twin(contact.momentum_rate)
    torques = twin(elastic.joint_torques)
    p, rates, t = np.empty((T, n)), np.empty((T, n)), np.empty(n + 1)
    tau = joint_torques_over(model.actuation, pressure)
    for k in range(T):
        momentum(angle[k], rate[k], body, p[k])
        torques(angle[k], rate[k], joints, tau[k], 0.0, t)
        momentum_rate(angle[k], rate[k], t, body, rates[k])
    r = np.zeros((T, n))
    for k in range(1, T):
        h = float(time[k] - time[k - 1])
        unexplained = (p[k] - p[k - 1]) / h - 0.5 * (rates[k] + rates[k - 1])
        keep = np.exp(-bandwidth * h)  # exact for a torque that is constant between two frames
        r[k] = keep * r[k - 1] + (1.0 - keep) * unexplained
    return np.asarray(np.cumsum(r[:, ::-1], axis=1)[:, ::-1])


def static_residual(model: Model, angle: Array, pressure: Array) -> Array:
    """External joint torques (T, n) of a body at rest: K q - tau and gravity, from its shape alone, N m.

    Parameters
    ----------
    model : Model
    angle : array (T, n)
        Absolute link angles, rad. Of a body that lengthens (T, n + S), its strains behind them: so is what is returned.
        In space coordinates (T, N).
    pressure : array (T,), (T, C) of several chambers
        Pa.

    Raises
    ------
    InputError
        When a shape has other than n angles and S strains.
    """
    if np.shape(angle)[1:] != (model.size,):
        counted = mechanics_of(model).counted
        raise InputError(f"shapes at rest hold {counted}, (T, {model.size}), got {np.shape(angle)}")
    tau = joint_torques_over(model.actuation, pressure)
    chain = mechanics_of(model)
    unexplained = [chain.static_forces(x, t) for x, t in zip(angle, tau, strict=True)]
    return np.asarray(-np.array(unexplained) @ chain.from_joints)
