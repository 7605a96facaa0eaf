"""Linearisation of a model about equilibrium, as a state space from commanded pressures to tip and joint outputs.

State: absolute link angles phi (n,) and the strains (S,) of extensible segments, their rates (n + S,), then for each
valve the pressure, its rate if the valve is of second order, and the part of the pressure that settles late. All are
deviations from the equilibrium. Hysteresis and creep enter as in `pliant.modes`: creep does not flow, slip elements
stick. The slow part is left to integral action of a controller.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pliant.equations.symbols import Slopes
from pliant.errors import InputError
from pliant.mechanics import mechanics_of
from pliant.model import Model, Station, Valve
from pliant.model.features import LAWS, SPRINGS, TENDONS, Consumer
from pliant.shapes import Float
from pliant.simulation import state
from pliant.simulation.state import TINY

Array = np.ndarray
ENDINGS = ("", "_rate", "_settling")  # of the names of a valve's states: pressure, its rate, its late part
HELD = "it is held, as in `pliant.modes`"
SMALL: dict[str, str] = {  # features that enter a linear model in simplified form
    "two_lags": "the mean of both times is used", "rates": "a limited rate does not act on small deviations",
    "swelling": "the lagged pressure is held", **dict.fromkeys(("creep", "slip", "boucwen"), HELD),
    **dict.fromkeys(("axial_memory", "space_memory"), HELD),
}
NOT_LINEAR = {
    "opening": "flow through a valve opening (opening_time) cannot be linearised: set opening_time to 0 and give the "
               "valve a rise_time",
    "dead_band": "set dead_band to 0: a command beyond the band acts as one without it",
    "inflation": "fit a torque law without inflation_limit for linear models and controllers",
}  # fmt: skip
LINEARISE = Consumer(
    "linearise", SPRINGS | LAWS | TENDONS | {
        "lag", "dead_time", "second_order", "settling", "lengthening", "curved_segments", "tied_segments", "space",
        "twist", "soft_swing", "space_lengthening",
    }, SMALL, NOT_LINEAR,
)


@dataclass(frozen=True)
class LinearModel:
    """A linear state-space model dx/dt = A x + B u(t - dead_time), y = C x + D u, about an equilibrium.

    Attributes
    ----------
    A, B, C, D : array (K, K), (K, chambers), (outputs, K), (outputs, chambers)
        System matrices in SI units (rad, rad/s, Pa, Pa/s). u are the commanded pressures, Pa. D is zero: no output
        responds at once.
    outputs : tuple of str
        Names of the rows of C: tip_x, tip_y [m], angle_sum, q_1 ... q_n [rad], strain_SEGMENT.
    states : tuple of str
        Names of the states.
    angle : array (n,)
        Absolute link angles at the equilibrium, rad.
    pressures : array (chambers,)
        Pressures of the equilibrium, Pa.
    dead_times : array (chambers,)
        Dead time of each chamber's valve, s.
    strain : array (S,)
        Strains of the extensible segments at the equilibrium.
    """

    A: Float[Array, "K K"]
    B: Float[Array, "K C"]
    C: Float[Array, "m K"]
    outputs: tuple[str, ...]
    states: tuple[str, ...]
    angle: Float[Array, " N"]
    pressures: Float[Array, " C"]
    dead_times: Float[Array, " C"]
    strain: Float[Array, " S"] = field(default_factory=lambda: np.zeros(0))

    @property
    def pressure(self) -> float:
        """Return the equilibrium pressure of the only chamber, Pa; raise InputError if there are several."""
        return float(self._only(self.pressures))

    @property
    def dead_time(self) -> float:
        """Return the dead time of the only chamber's valve, s; raise InputError if there are several."""
        return float(self._only(self.dead_times))

    def _only(self, values: Array) -> Any:
        if values.size > 1:
            raise InputError(
                f"this linear model has {values.size} pressures, so it has no single pressure or dead time: use "
                "`pressures` and `dead_times`, or a model with one chamber"
            )
        return values[0]

    @property
    def D(self) -> Array:
        """Return the feedthrough matrix D (outputs, chambers) from pressures to outputs, which is zero."""
        return np.zeros((self.C.shape[0], self.B.shape[1]))

    @property
    def n(self) -> int:
        """Return the number of links; in space the number of joint coordinates."""
        return self.angle.size

    @property
    def position(self) -> Array:
        """Return the equilibrium coordinates (n + S,): n absolute angles [rad], then S strains."""
        return np.concatenate([self.angle, self.strain])

    def row(self, output: str) -> Array:
        """Return the row (N,) of the output matrix C for N states and the named output, such as "tip_x".

        Raises
        ------
        InputError
            For an unknown output.
        """
        if output not in self.outputs:
            raise InputError(f"unknown output {output!r}: use one of {', '.join(self.outputs)}")
        return self.C[self.outputs.index(output)]

    def poles(self) -> Array:
        """Return the N poles [1/s] of the linear model, slowest first."""
        values = np.linalg.eigvals(self.A)
        return values[np.argsort(np.abs(values))]

    def static_gain(self, output: str, chamber: int = 0) -> float:
        """Return the static gain from a commanded pressure to an output, in units of the output per Pa."""
        return float(-self.row(output) @ np.linalg.solve(self.A, self.B[:, chamber]))


def linearise(model: Model, pressure: float | Float[Array, " C"] = 0.0) -> LinearModel:
    """Linearise a model, valves included, about its equilibrium under constant pressures.

    Parameters
    ----------
    model : Model
        For a valve with different time constants for rise and fall, their mean is used. A limited rate has no effect on
        small deviations. Lagged pressure is held constant, as creep is. Friction of tendons acts as a viscous damper,
        which holds for slip far below `slip_rate`. A tendon that is slack at the equilibrium has no effect.
    pressure : float, array (C,) for several chambers
        Gauge pressure of the equilibrium, Pa.

    Returns
    -------
    LinearModel
        The states of several valves are called ``pressure_CHAMBER``; the part of the pressure that settles late is
        called ``pressure_settling``.

    Raises
    ------
    InputError, SimulationError
        When the pressure is not finite, the model has no equilibrium there, or a valve has a dead band or an opening
        time, or a chamber a hyperelastic wall.

    Examples
    --------
    >>> import pliant
    >>> arm = pliant.chain_model(length=0.17, mass=0.069, mass_at="tip", stiffness=1.6, damping=8e-3, torque=[6.7e-7])
    >>> linear = pliant.linearise(arm, pressure=0.0)  # doctest: +SKIP
    >>> linear.poles()  # doctest: +SKIP

    Examples
    --------
    >>> import pliant
    >>> from pliant.actuators import chen2018
    >>> pliant.linearise(chen2018.model()).A.shape  # five angles, five rates
    (10, 10)
    """
    LINEARISE.check(model)
    chain = mechanics_of(model)
    x = chain.coordinates(state.equilibrium(model, pressure))
    a_x, a_v, a_tau = derivatives(model, x, model.actuation.joint_torques(pressure))
    n, N = model.size - len(model.extensions), model.size
    A, B = np.block([[np.zeros((N, N)), np.eye(N)], [a_x, a_v]]), np.zeros((2 * N, 0))
    states = [*chain.names, *chain.rate_names]
    pressures = model.actuation.pressures(pressure)
    called = [model.actuation.labels(f"{{kind}}{ending}") for ending in ENDINGS]
    for k, (chamber, by_torque, p) in enumerate(zip(model.chambers, a_tau, pressures, strict=True)):
        drive = np.zeros(A.shape[0])
        drive[N : 2 * N] = by_torque * chamber.torque_slope(float(p))
        A, column, names = behind_valve(A, drive, chamber.valve)
        B = np.column_stack([np.pad(B, ((0, len(names)), (0, 0))), column])
        states += [called[ENDINGS.index(name)][k] for name in names]
    C, outputs = output_rows(model, x, A.shape[0])
    late = np.array([c.valve.dead_time for c in model.chambers])
    return LinearModel(A, B, C, outputs, tuple(states), x[:n], pressures, late, x[n:])


def derivatives(model: Model, x: Array, torque: Array) -> tuple[Array, Array, Array]:
    """Return the derivatives of a chain's N accelerations at the equilibrium x with respect to its coordinates (N, N),
    its rates (N, N) and C actuation torques (C, N).

    `x` (N,) are the coordinates, `torque` the actuation torques [N m]. At equilibrium, derivatives of the inertia and
    terms quadratic in the rates vanish.
    """
    chain = mechanics_of(model)
    M, R = chain.inertia(x), chain.to_joints
    slope = chain.static_slope(x, torque=torque) - R.T @ np.diag(chain.stuck_stiffness) @ R
    damping = R.T @ np.diag(chain.joints.D) @ R
    if model.actuation.tendons_rub:
        damping = damping + rubbing(model, x, torque)
    push = model.actuation.gain @ R
    for c in model.actuation.tendons:  # which may hang slack
        push[c] = chain.static_forces(x, torque + 1j * TINY * model.actuation.columns[c]).imag / TINY
    return np.linalg.solve(M, slope), -np.linalg.solve(M, damping), np.linalg.solve(M, push.T).T


def rubbing(model: Model, x: Array, torque: Array) -> Array:
    """Return the damping matrix (N, N) of the friction of tendons at rest at x (N,), under inputs (N + R,)."""
    chain, still = mechanics_of(model), np.zeros(model.size)
    out = Slopes(still.copy(), np.zeros((model.size, model.size)), np.zeros((model.size, model.size)))
    chain.acceleration_jacobian()(x, still, torque, *chain.parts(), out)
    return np.asarray(-chain.inertia(x) @ out.a_w.T - np.diag(chain.joints.D))


def behind_valve(A: Array, B: Array, valve: Valve) -> tuple[Array, Array, tuple[str, ...]]:
    """Append a valve's states to the state space A, B, so that its input becomes the commanded pressure.
    The endings of the new states' names are returned too, see `ENDINGS`.
    """
    share, time = valve.settle_share, valve.settle_time
    if share:  # the late part follows the pressure before it
        N = A.shape[0]
        slow, drive = np.zeros((N + 1, N + 1)), np.append((1.0 - share) * B, 1.0 / time)
        slow[:N, :N], slow[:N, N], slow[N, N] = A, share * B, -1.0 / time
        A, B, names = behind_valve(slow, drive, replace(valve, settle_share=0.0))
        return A, B, (ENDINGS[2], *names)
    lag = 0.5 * (valve.rise_time + valve.fall_time)
    N = A.shape[0]
    order = 2 if valve.natural_frequency else int(lag > 0)
    whole, drive = np.zeros((N + order, N + order)), np.zeros(N + order)
    whole[:N, :N] = A
    if not order:
        return whole, B.copy(), ()
    whole[:N, N] = B
    if order == 1:
        whole[N, N], drive[N] = -1.0 / lag, 1.0 / lag
        return whole, drive, ENDINGS[:1]
    omega = 2 * np.pi * valve.natural_frequency
    whole[N, N + 1] = 1.0
    whole[N + 1, N:], drive[N + 1] = [-(omega**2), -2 * valve.damping_ratio * omega], omega**2
    return whole, drive, ENDINGS[:2]


def output_rows(model: Model, x: Array, states: int) -> tuple[Array, tuple[str, ...]]:
    """Return the output matrix C (outputs, N) for N states, and the names of the outputs: tip position, bending angle
    (in the plane only), joint coordinates.
    """
    n, N, chain = model.n, model.size, mechanics_of(model)
    if chain.dimension == 3:
        C = np.zeros((3 + N, states))
        C[:3, :N] = chain.position_jacobian(x, Station("tip", n - 1, float(model.link_length[-1])))
        C[3:, :N] = np.eye(N)
        return C, ("tip_x", "tip_y", "tip_z", *chain.joint_names)
    C = np.zeros((3 + N, states))
    C[:2, :N] = chain.position_jacobian(x, Station("tip", n - 1, float(model.link_length[-1])))
    C[2, n - 1] = 1.0
    C[3:, :N] = chain.to_joints
    return C, ("tip_x", "tip_y", "angle_sum", *chain.joint_names)
