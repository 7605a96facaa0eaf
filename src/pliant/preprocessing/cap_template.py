"""Template of the curvature of body, cap and tail as a sensor of finite gauge length measures it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

REFINEMENTS = 5  # without noise the fourth is exact to rounding


class CapTemplate:
    """Curvature of body, cap and tail averaged over the gauge length `width`, to be located in a fibre."""

    def __init__(self, spacing: float, cap_curvature: float, cap_length: float, width: float, tail: float) -> None:
        self.spacing, self.cap_curvature, self.cap_length = spacing, cap_curvature, cap_length
        self.width, self.tail = width, tail
        side = max(3, int(np.ceil((cap_length / 2 + width) / spacing)))
        self.before = side
        self.samples = 2 * side + int(np.ceil(cap_length / spacing)) + 1
        self.s = (np.arange(self.samples) - side) * spacing  # 0 is the edge between body and cap

    def shares(self, edge: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the fractions (T, M) of body and of tail in every sample, for cap edges at `edge` (T,) [m]."""
        low = self.s - self.width / 2
        body = np.clip((edge[:, None] - low) / self.width, 0.0, 1.0)
        tail = np.clip((low + self.width - edge[:, None] - self.cap_length) / self.width, 0.0, 1.0)
        return body, tail

    def locate(self, kappa: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the tip positions (T,) [m], and body, plateau and tail curvature with their standard error (4, T)."""
        body, tail = (share[0] for share in self.shares(np.zeros(1)))
        fixed = self.cap_curvature * (1 - body - tail) + self.tail * tail
        weight = float(body @ body)
        b = (kappa @ self._sliding(body, kappa.shape[1]) - fixed @ body) / weight
        squared = np.square(kappa) @ self._sliding(np.ones_like(body), kappa.shape[1])
        squared += fixed @ fixed - weight * b**2 - 2 * kappa @ self._sliding(fixed, kappa.shape[1])
        best = squared.argmin(axis=1)
        rows = np.arange(len(kappa))
        window = kappa[rows[:, None], best[:, None] + np.arange(self.samples)]
        edge, mean = self._refine(window, b[rows, best])
        return (best + self.before) * self.spacing + edge, self._levels(window, edge, mean)

    def _sliding(self, weights: NDArray[np.float64], stations: int) -> NDArray[np.float64]:
        """Return a matrix (S, S - M + 1) whose columns hold the weights at every position of the window."""
        columns = np.arange(stations - self.samples + 1)
        matrix = np.zeros((stations, columns.size))
        matrix[columns[None, :] + np.arange(self.samples)[:, None], columns[None, :]] = weights[:, None]
        return matrix

    def _refine(
        self, window: NDArray[np.float64], mean: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Refine the edge (at most one sample from 0) and the mean curvature of the body by Gauss-Newton."""
        edge = np.zeros(len(window))
        for _ in range(REFINEMENTS):
            body, tail = self.shares(edge)
            residual = window - mean[:, None] * body - self.tail * tail - self.cap_curvature * (1 - body - tail)
            on_body, on_tail = (body > 0) & (body < 1), (tail > 0) & (tail < 1)
            slope = (mean[:, None] - self.cap_curvature) * on_body + (self.cap_curvature - self.tail) * on_tail
            slope = slope / self.width
            a11, a12, a22 = (slope * slope).sum(1), (slope * body).sum(1), (body * body).sum(1)
            g1, g2 = (slope * residual).sum(1), (body * residual).sum(1)
            determinant = a11 * a22 - a12**2
            safe = determinant + (determinant == 0)  # 0 where no sample lies across an edge: the mean has settled
            edge = np.clip(edge + (a22 * g1 - a12 * g2) / safe, -self.spacing, self.spacing)
            mean = mean + (a11 * g2 - a12 * g1) / safe
        return edge, mean

    def _levels(
        self, window: NDArray[np.float64], edge: NDArray[np.float64], mean: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the measured curvature of body, plateau and tail, and the standard error of the plateau.

        A cap of two gauge lengths or more holds a whole sample, and so does the tail.
        """
        body, tail = self.shares(edge)
        inside, behind = 1 - body - tail > 0.999, tail > 0.999
        plateau = (window * inside).sum(1) / inside.sum(1)
        end = (window * behind).sum(1) / behind.sum(1)
        scatter = np.where(inside, window - plateau[:, None], np.where(behind, window - end[:, None], 0.0))
        freedom = np.maximum(inside.sum(1) + behind.sum(1) - 2, 1)
        return np.stack([mean, plateau, end, np.sqrt(np.square(scatter).sum(1) / freedom / inside.sum(1))])
