"""Planning of the pressure commands that move the tip to a new position as fast as the limits allow, or along a path.

The command is computed by optimisation on the model. The tip's motion follows from the sampled linear model about the
target. What the linear model omits, hysteresis included, is corrected by simulating the full model under the command.
The cost weights the tip's error and the changes of the command, under 0 <= p <= highest, with the valve's lag and dead
time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pliant.control.steady_inputs import Equilibria, bounded_least_squares
from pliant.control.tuning import Limits
from pliant.control.valve import SupplyValve, behind_supply, supply_of, valve_under
from pliant.errors import InputError
from pliant.estimation.adaptive_observer import frozen
from pliant.linear.linearisation import LinearModel, linearise
from pliant.linear.sampled import periods_late, sample
from pliant.model import Model, Valve
from pliant.simulation import Trace, simulate

Array = np.ndarray
STEP = 2e-3  # s, longest time step of the model
RESTS = 9  # number of equilibria at which the model is linearised
COARSER = 4  # steps of the valve's equation per linear piece of pressure
ROUNDS = 8  # corrections by the full model
CLOSE = 5e-3  # error, as a fraction of the step, below which a step is complete
AFTER = 0.2  # s for which the tip must stay there
LONGEST = 0.4  # s, longest duration of a step
SHARE = 0.9  # of the highest pressure that a trajectory may use; the remainder is left to the feedback
SLACK = 1.25  # duration of a step relative to the shortest: more suits a body that differs from the model
SMOOTH = 2e-3  # weight of a change of the command relative to its static effect on the tip


@dataclass(frozen=True)
class Trajectory:
    """Planned pressure commands and the model's motion under them, for each control period. The last row is kept
    afterwards.

    Attributes
    ----------
    target : array (K,)
        Pressure [Pa] at which the design's model holds the target.
    lead : array (K, N + 1)
        Deviation of angles, rates, valve states and delayed commands, then of the command, from the equilibrium with
        the present hysteresis states [rad, rad/s, Pa, Pa/s], delayed as the shape is.
    displacement : array (K,)
        Displacement of the tip along the motion from its rest without pressure [m], delayed as the shape is.
    wanted : array (K,)
        Target displacement [m].
    period : float
        Control period [s].
    """

    target: Array
    lead: Array
    displacement: Array
    wanted: Array
    period: float

    def at(self, time_s: float) -> int:
        """Return the row index of the trajectory at a time [s]; the last row after its end."""
        return min(max(round(time_s / self.period), 0), self.target.size - 1)


class Planner:
    """Planner of tip trajectories for one actuator with one chamber.

    Parameters
    ----------
    model : Model
        Model of the body with its hysteresis and its valve.
    family : Equilibria
        Equilibria of ``frozen(model)``.
    limits : Limits
    period, latency : float
        Control period, and age of a shape at its arrival [s].
    valve : SupplyValve, optional
        The rig's valve; default: the model's.
    """

    def __init__(
        self, model: Model, family: Equilibria, limits: Limits, period: float, *, latency: float = 0.0,
        valve: SupplyValve | None = None,
    ) -> None:
        self.model, self.family, self.limits, self.ceiling = model, family, limits, SHARE * limits.highest
        self.period, self.latency = period, latency
        self.valve = valve or supply_of(model.valve)
        linear = linearise(frozen(model, 0.5), 0.5 * self.ceiling)
        plant = sample(linear, period)
        self._plant = plant, self._row(linear, plant.A.shape[0])
        about = [linearise(frozen(model), float(p)) for p in np.linspace(0.0, family.pressure[-1], RESTS)]
        rows = np.array([self._row(linear, model.n) for linear in about])
        gains = [[linear.static_gain(x) for x in ("tip_x", "tip_y")] for linear in about]
        slopes = [family.at(linear.pressure)[2] @ gain for linear, gain in zip(about, gains, strict=True)]
        self._slopes = np.array([float(linear.pressure) for linear in about]), rows, np.array(slopes)

    def _row(self, linear: LinearModel, size: int) -> Array:
        """Return the row (size,) that gives the tip's displacement along its path from the state."""
        way, row = self.family.at(linear.pressure)[2], np.zeros(size)
        count = min(size, linear.A.shape[0])
        row[:count] = (way[0] * linear.row("tip_x") + way[1] * linear.row("tip_y"))[:count]
        return row

    def steps(self, time: Array, displacement: Array, duration: float) -> Trajectory:
        """Plan the fastest trajectory of the tip to each of several set-points within the limits.

        Parameters
        ----------
        time, displacement : array (k,)
            Times [s], and target displacement [m] from each time on; 0 before the first.
        duration : float
            Duration [s].

        Raises
        ------
        InputError
            When the times do not increase by at least a period, or a displacement is out of reach.
        """
        period, family = self.period, self.family
        periods = np.rint(np.asarray(time, dtype=float) / period).astype(int)
        if periods.size == 0 or periods[0] < 0 or np.any(np.diff(periods) <= 0):
            raise InputError(
                "the times of the set-points must begin at 0 s or later and increase by at least one control period"
            )
        K = max(round(duration / period), int(periods[-1]) + 2)
        wanted = np.append(0.0, displacement)[np.searchsorted(periods, np.arange(K), side="right")]
        target = np.array([family.pressure_for(float(d)) for d in wanted])
        command = np.zeros(K)
        for first, last in zip(periods, np.append(periods[1:], K), strict=True):
            command = self._fastest(target, wanted, command, int(first), int(last))
        return self._followed(target, wanted, command)

    def path(self, displacement: Array) -> Trajectory:
        """Plan a trajectory in which the tip follows a path, given by its displacements (K,) [m] in K control periods.

        Raises
        ------
        InputError
            When a displacement is out of reach.
        """
        wanted = np.asarray(displacement, dtype=float)
        target = np.array([self.family.pressure_for(float(d)) for d in wanted])
        command = np.clip(target, 0.0, self.ceiling)
        block = round(0.4 / self.period)
        for _ in range(ROUNDS // 2):
            for first in range(0, wanted.size, block):
                part = slice(first, min(first + 2 * block, wanted.size))
                left = (wanted - self._tip(command))[part]
                before = float(command[first - 1]) if first else 0.0
                command[part] = self._nearest(np.eye(left.size), np.ones(left.size), left, command[part], before)
        return self._followed(target, wanted, command)

    def _fastest(self, target: Array, wanted: Array, command: Array, first: int, last: int) -> Array:
        """Return commands that move the tip to its new target from period `first` on, in as few periods as possible."""
        size = abs(float(wanted[first] - (wanted[first - 1] if first else 0.0)))
        if size == 0.0:
            return command
        few, many = 2, min(round(LONGEST / self.period), last - first - 1)
        while many - few > 1:
            middle = (few + many) // 2
            if self._moved(target, wanted, command, first, middle)[1] <= CLOSE * size:
                many = middle
            else:
                few = middle
        count = min(round(SLACK * many), last - first - 1)
        later = first + count + round(AFTER / self.period)
        commands = self._moved(target, wanted, command, first, count)[0]
        for _ in range(2):  # then the pressures that hold the tip against creep
            commands[later:] = np.clip(self._hold(target, self._run(commands, 0.0)[2])[later:], 0.0, self.ceiling)
        return commands

    def _moved(self, target: Array, wanted: Array, command: Array, first: int, count: int) -> tuple[Array, float]:
        """Return commands with `count` free periods from `first` on, constant ones after, and the largest error [m]."""
        end = min(first + count + round(AFTER / self.period), target.size)
        commands, before = command.copy(), float(command[first - 1]) if first else 0.0
        commands[first:] = min(float(target[first]), self.ceiling)
        part = slice(first, end)
        free = np.eye(end - first, count + 1)
        free[count:, count] = 1.0
        weight = (np.arange(end - first) >= count).astype(float)
        size, worst = abs(float(wanted[first] - (wanted[first - 1] if first else 0.0))), np.inf
        left = wanted[:end] - self._tip(commands[:end])
        for _ in range(ROUNDS):
            commands[part] = self._nearest(free, weight, left[part], commands[part], before)
            commands[end:] = commands[end - 1]
            left = wanted[:end] - self._tip(commands[:end])
            worst = float(np.abs(left)[first + count :].max(initial=0.0))
            if worst <= 0.5 * CLOSE * size:
                break
        return commands, worst

    def _step_response(self, count: int) -> Array:
        """Return the tip's displacement (count,) [m/Pa] at the ends of the periods for a unit command in the first."""
        plant, row = self._plant
        x, out = plant.B[:, 0].copy(), np.empty(count)
        for k in range(count):
            out[k] = row @ x
            x = plant.A @ x
        return out

    def _nearest(self, free: Array, weight: Array, left: Array, command: Array, before: float) -> Array:
        """Return commands (K,) spanned by `free` (K, F) that, in the linear model, remove the errors `left` (K,) [m].

        Changes from one command to the next are weighted too, and the weight is increased until the slew limit is met.
        """
        from scipy.linalg import toeplitz

        K = left.size
        response = self._step_response(K)
        effect = np.vstack([np.zeros((1, K)), toeplitz(response, np.zeros(K))[:-1]]) * weight[:, None]
        size = abs(float(response.sum()))
        aim, effect = (weight * left + effect @ command) / size, effect @ free / size
        change, behind = (np.eye(K) - np.eye(K, k=-1)) @ free, np.append(before, np.zeros(K - 1))
        reach, cost = self.limits.slew * self.period, SMOOTH
        start = np.linalg.lstsq(free, command)[0]
        for _ in range(12):
            H = effect.T @ effect + cost**2 * change.T @ change
            start = bounded_least_squares(H, effect.T @ aim + cost**2 * change.T @ behind, start, self.ceiling)
            commands = free @ start
            if np.abs(np.diff(commands, prepend=before)).max() <= reach * 1.001:
                break
            cost *= 2.0
        return np.asarray(commands)

    def _run(self, command: Array, late: float) -> tuple[Array, Array, Array, Array]:
        """Simulate the full model; return angles, rates and rest shifts (K, n) and tips (K, 2) for every period."""
        model, edge = self.model, np.arange(command.size) * self.period
        if self.valve is None:
            levels = np.stack([np.append(0.0, command[:-1]), command], axis=1).ravel()
            late, drive = late + model.valve.dead_time, Trace(np.repeat(edge, 2), levels)
        else:
            late, model = late + self.valve.dead_time, model.with_(valve=Valve())
            drive = Trace(*(row[::COARSER] for row in behind_supply(self.valve, command, self.period)))
        model = model.with_(valve=replace(model.valve, dead_time=late))
        moved = simulate(model, drive, times=edge, time_step=STEP, check=False)
        q, dq = np.asarray(moved["joint_angle"].values), np.asarray(moved["joint_rate"].values)
        angle = model.base_angle + np.cumsum(q + model.rest_angle, axis=1)
        c, remembered = model.memory.instantaneous, np.asarray(moved.get("memory_torque", np.zeros_like(q)))
        shift = (c * q - remembered / model.stiffness) / (1.0 + c)
        return angle, np.cumsum(dq, axis=1), shift, np.asarray(moved["tip_position"].values)[:, -1]

    def _tip(self, command: Array) -> Array:
        """Return the tip's displacement (K,) [m] under the commands, by simulation of the full model."""
        return np.asarray(np.linalg.norm(self._run(command, 0.0)[3] - self.family.tip[0], axis=1))

    def _hold(self, target: Array, shift: Array) -> Array:
        """Return the pressures (K,) [Pa] that hold the tip where it rests under `target`, for shifts (K, n) of rest."""
        grid, rows, slopes = self._slopes
        by_angle = np.stack([np.interp(target, grid, row) for row in rows.T], axis=1)
        moved = np.einsum("kn,kn->k", by_angle, np.cumsum(shift, axis=1))
        return np.asarray(target - moved / np.interp(target, grid, slopes))

    def _followed(self, target: Array, wanted: Array, command: Array) -> Trajectory:
        """Return the trajectory of a series of commands: the model's motion under them, delayed as the shape is."""
        family, n, K = self.family, self.model.n, command.size
        angle, rate, shift, tip = self._run(command, self.latency)
        hold = self._hold(target, shift)
        valve = valve_under(self.model.valve, self.valve, command, self.period, self.latency)
        D, order = periods_late(self.model.valve.dead_time + self.latency, self.period)[2], valve.shape[1]
        lead = np.zeros((K, 2 * n + order + D + 1))
        rest = np.array([family.at(p)[0] for p in hold])
        lead[:, :n], lead[:, n : 2 * n] = angle - rest - np.cumsum(shift, axis=1), rate
        lead[:, 2 * n : 2 * n + order] = valve
        if order:
            lead[:, 2 * n] -= hold
        sent = np.concatenate([np.zeros(D), command])
        for age in range(D):
            lead[:, 2 * n + order + age] = sent[D - 1 - age : D - 1 - age + K] - hold
        lead[:, -1] = command - hold
        far = np.linalg.norm(tip - family.tip[0], axis=1)
        rest_far = np.interp(target[-1], family.pressure, family.displacement)
        return Trajectory(  # the last row once more, at rest
            np.append(target, target[-1]), np.vstack([lead, np.zeros_like(lead[-1])]), np.append(far, rest_far),
            np.append(wanted, wanted[-1]), self.period,
        )
