"""Estimate external joint torques, which the model does not explain, from a motion or from shapes at rest."""

from __future__ import annotations

import numpy as np

from pliant.compiler.choose import twin
from pliant.equations import contact, elastic
from pliant.errors import InputError
from pliant.mechanics import mechanics_of
from pliant.mechanics.lengths import check_lengths
from pliant.model import Model
from pliant.model.features import (
    HYSTERESIS,
    IN_SPACE,
    LAWS,
    LENGTHENS,
    SPRINGS,
    TENDONS,
    VALVES,
    WALLS,
    Consumer,
)
from pliant.shapes import Float

Array = np.ndarray
EXTERNAL = dict.fromkeys(
    HYSTERESIS | {"axial_memory", "space_memory", "tendon_friction"}, "its torques count as external"
) | dict.fromkeys(VALVES, "pressures are those behind the valves")
MOMENTUM_RESIDUAL = Consumer(
    "momentum_residual", SPRINGS | LAWS, EXTERNAL,
    dict.fromkeys(LENGTHENS | IN_SPACE | TENDONS, "use pliant.estimate, whose disturbance is the external torque"),
)
STATIC_RESIDUAL = Consumer("static_residual", SPRINGS | LAWS | WALLS | LENGTHENS | IN_SPACE | TENDONS, EXTERNAL)


def momentum_residual(
    model: Model, time: Float[Array, " T"], angle: Float[Array, "T N"], rate: Float[Array, "T N"],
    pressure: Float[Array, "T C"], *, bandwidth: float = 40.0,
) -> Float[Array, "T N"]:
    """Estimate the external torques (T, n) [N m] of n joints over T frames by a generalised-momentum observer.

    r = K_O [p - p(0) - int(p_dot of the model + r) dt],  so that dr/dt = K_O (tau_ext - r)

    Parameters
    ----------
    model : Model
    time : array (T,)
        Times, s.
    angle, rate : array (T, n)
        Absolute link angles [rad] and rates [rad/s]; accelerations are not needed.
    pressure : array (T,), (T, C) for several chambers
        Pressure at these times, Pa.
    bandwidth : float
        Observer gain K_O, 1/s. A high bandwidth responds faster but amplifies noise.

    Raises
    ------
    InputError
        When lengths do not agree, the bandwidth is not positive, the body is in space or lengthens, or a chamber has
        a lagging pressure or a hyperelastic wall.

    Source: De Luca and Mattone (2003); hysteresis of the joints counts as external here
    """
    MOMENTUM_RESIDUAL.check(model)
    chain = mechanics_of(model)
    check_lengths(chain, x=angle)
    T, n = np.shape(angle)
    if np.shape(rate) != (T, n):
        raise InputError(f"the rates must have the shape {(T, n)} of the angles, got {np.shape(rate)}")
    if np.shape(pressure)[:1] != (T,) or np.shape(time) != (T,):
        raise InputError(
            f"the observer needs a time and a pressure for each of {T} rows of angles, got the shapes {np.shape(time)} "
            f"and {np.shape(pressure)}"
        )
    if not bandwidth > 0:
        raise InputError(f"the bandwidth of the observer must be above 0 1/s, got {bandwidth}")
    body, joints, _ = chain.parts()
    momentum, momentum_rate = twin(contact.momentum), twin(contact.momentum_rate)
    torques = twin(elastic.joint_torques)
    p, rates, t = np.empty((T, n)), np.empty((T, n)), np.empty(n + 1)
    tau = model.actuation.joint_torques_over(pressure)
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


def static_residual(model: Model, angle: Float[Array, "T N"], pressure: Float[Array, "T C"]) -> Float[Array, "T N"]:
    """Return the external torques (T, n) [N m] of n joints for T shapes of a body at rest: stiffness torque - actuation
    torque - torque of the weight.

    Parameters
    ----------
    model : Model
    angle : array (T, n)
        Absolute link angles, rad. For an extensible body (T, n + S), followed by its strains, and so is the result. In
        space coordinates (T, N).
    pressure : array (T,), (T, C) for several chambers
        Gauge pressure of each shape, Pa.

    Raises
    ------
    InputError
        When a shape does not have n angles and S strains, or there is not one row of pressures for each shape.
    """
    STATIC_RESIDUAL.check(model)
    if np.shape(angle)[1:] != (model.size,):
        counted = mechanics_of(model).counted
        raise InputError(f"each shape at rest must hold {counted}, (T, {model.size}), got shape {np.shape(angle)}")
    if np.shape(pressure)[:1] != np.shape(angle)[:1]:
        raise InputError(f"{len(angle)} shapes at rest need as many rows of inputs, got shape {np.shape(pressure)}")
    tau = model.actuation.joint_torques_over(pressure)
    chain = mechanics_of(model)
    unexplained = [chain.static_forces(x, t) for x, t in zip(angle, tau, strict=True)]
    return np.asarray(-np.array(unexplained) @ chain.from_joints)
