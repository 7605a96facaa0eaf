"""Convex quadratic programs of constant size that are solved repeatedly by OSQP (optional extra ``mpc``)."""

from __future__ import annotations

import numpy as np

from pliant.plugins import optional

Array = np.ndarray
ACCURACY = 1e-5  # tolerance of OSQP's primal and dual residuals, absolute and relative
MOST = 5000  # iterations; random problems take 55, one in a hundred more than 800
APART = 100  # iterations between two changes of the step size: at 25 it cycled on one problem in a thousand
HUGE = 1e20  # limit of gradient and Hessian, beyond which the prediction counts as not finite


class QuadraticProgram:
    """Solver of the quadratic program min 1/2 z^T H z + g^T z with bounds 0 <= z <= highest and low <= D z <= high. It
    is set up once and solves many programs that differ in H, g, low and high.

    Each solve starts from the last multipliers, and a second time from zero multipliers if it fails. The sparsity
    pattern never changes. The cost is divided by the geometric mean of its curvatures, so that a step size of 1 suits.

    Parameters
    ----------
    highest : array (Z,)
        Upper bounds of z.
    change : array (R, Z)
        Matrix D; no rows if there are only bounds.

    Attributes
    ----------
    status : str
        OSQP's status of the last problem.

    Raises
    ------
    InputError
        When OSQP is not installed.

    Source: Stellato et al., Math. Program. Comput. 12(4), 2020 (OSQP)
    """

    def __init__(self, highest: Array, change: Array) -> None:
        from scipy import sparse

        osqp = optional("osqp", "predictive control needs OSQP: pip install 'pliant[mpc]'")

        size = len(highest)
        self._upper = np.triu_indices(size)
        order = np.lexsort(self._upper)  # by columns, as OSQP holds them
        self._upper = self._upper[0][order], self._upper[1][order]
        whole = sparse.csc_matrix((np.ones(len(order)) + size * (self._upper[0] == self._upper[1]), self._upper))
        rows = sparse.csc_matrix(np.vstack([np.eye(size), change]))
        self._low, self._high = np.zeros(rows.shape[0]), np.append(highest, np.zeros(len(change)))
        self._solved, self._solver, self.status = osqp.SolverStatus.OSQP_SOLVED, osqp.OSQP(), ""
        self._solver.setup(
            whole, np.zeros(size), rows, self._low, self._high, verbose=False, eps_abs=ACCURACY, eps_rel=ACCURACY,
            max_iter=MOST, rho=1.0, adaptive_rho=1, adaptive_rho_interval=APART, check_termination=5, polishing=False,
            scaling=0,
        )

    def solve(self, H: Array, g: Array, low: Array, high: Array, start: Array) -> Array | None:
        """Return the solution z (Z,) of the quadratic program in Z unknowns, or None if it could not be solved
        accurately.

        `low` and `high` (R,) bound D z, and `start` (Z,) is the initial guess.
        """
        if not (np.abs(H).max() < HUGE and np.abs(g).max() < HUGE):
            self.status = "the prediction is not finite"
            return None
        size, (sign, logarithm) = len(g), np.linalg.slogdet(H)
        if sign <= 0:
            self.status = "the cost is not convex"
            return None
        mean = np.exp(logarithm / size)
        self._low[size:], self._high[size:] = low, high
        self._solver.update(Px=H[self._upper] / mean, q=g / mean, l=self._low, u=self._high)
        self._solver.warm_start(x=start)
        for _ in range(2):
            made = self._solver.solve(raise_error=False)
            self.status = str(made.info.status)
            if made.info.status_val == self._solved and np.isfinite(made.x).all():
                return np.array(made.x)
            self._solver.update_settings(rho=1.0)
            self._solver.warm_start(x=start, y=np.zeros(len(self._low)))
        return None
