"""Gaussian prior of several parameters of a fit together, such as the posterior of an earlier fit."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pliant.errors import InputError
from pliant.identification.parameters import Parameter
from pliant.shapes import Float

Array = np.ndarray
LEAST_EIGENVALUE = 1e-6  # of a correlation matrix; a smaller one is rounding, or a direction that was not determined


@dataclass(frozen=True, eq=False)
class JointPrior:
    """Gaussian prior of P parameters with a covariance, SI units.

    Attributes
    ----------
    names : tuple of str
    mean : array (P,)
    covariance : array (P, P)

    Raises
    ------
    InputError
        When the shapes do not fit each other, or a number is not finite or a variance not positive.
    """

    names: tuple[str, ...]
    mean: Float[Array, " P"]
    covariance: Float[Array, "P P"]

    def __post_init__(self) -> None:
        size = len(self.names)
        if self.mean.shape != (size,) or self.covariance.shape != (size, size):
            raise InputError(f"a prior of {size} parameters needs a mean ({size},) and a covariance ({size}, {size}), "
                             f"got {self.mean.shape} and {self.covariance.shape}")  # fmt: skip
        if not (np.isfinite(self.mean).all() and np.isfinite(self.covariance).all()):
            raise InputError("a prior needs finite means and covariances")
        if not (np.diag(self.covariance) > 0).all():
            worst = self.names[int(np.argmin(np.diag(self.covariance)))]
            raise InputError(f"a prior needs a positive variance of every parameter: that of {worst} is not")

    @property
    def std(self) -> dict[str, float]:
        """Return the standard deviation (SI) of each parameter by name."""
        return dict(zip(self.names, map(float, np.sqrt(np.diag(self.covariance))), strict=True))

    @property
    def means(self) -> dict[str, float]:
        """Return the mean (SI) of each parameter by name."""
        return dict(zip(self.names, map(float, self.mean), strict=True))

    def of(self, names: Collection[str]) -> JointPrior:
        """Return the marginal prior of those parameters that are in `names`."""
        index = [i for i, name in enumerate(self.names) if name in names]
        return JointPrior(tuple(self.names[i] for i in index), self.mean[index], self.covariance[np.ix_(index, index)])

    def widened(self, variances: Mapping[str, float]) -> JointPrior:
        """Return the prior with the given variances (SI) added to those of the parameters named."""
        added = np.array([variances.get(name, 0.0) for name in self.names])
        return JointPrior(self.names, self.mean, self.covariance + np.diag(added))

    def rows(self, free: Sequence[Parameter], scale: Array) -> tuple[Array, Array]:
        """Return R residuals A x - b of unit variance, as A (R, P) and b (R,), for the scaled values x (P,) of the free
        parameters of a fit. Parameters of the prior that are not free are left out.
        """
        listed = [p.name for p in free]
        joint_prior = self.of(listed)
        std = np.sqrt(np.diag(joint_prior.covariance))
        size, turn = np.linalg.eigh(joint_prior.covariance / np.outer(std, std))
        root = (turn / np.sqrt(np.maximum(size, LEAST_EIGENVALUE))).T / std  # W with W C W' = 1
        columns = [listed.index(name) for name in joint_prior.names]
        rows = np.zeros((len(columns), len(listed)))
        rows[:, columns] = root * scale[columns]
        return rows, root @ joint_prior.mean
