"""Compute bending, twist and common strain (tension, temperature) from the strain of the cores of one fibre.

Core c at radius r_c and angle theta_c, counted from m1 towards m2, has the strain
eps_c = eps_0 - r_c (k1 cos theta_c + k2 sin theta_c) + g_c phi',  g_c = (2 pi r_c^2 / P) / (1 + (2 pi r_c / P)^2)
with the curvature vector (k1, k2), the twist rate phi' and the pitch P of a spun fibre (no g_c without spin).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

WELL_POSED = 1e-9  # least ratio of singular values of the scaled columns
COMMON_MODES = ("centre", "least-squares")


@dataclass(frozen=True)
class CoreLayout:
    """Positions of the cores in the cross-section of a multicore fibre: distance from the axis [m] and angle [rad].

    Attributes
    ----------
    radius : (C,) array, m
        Distance of each core from the fibre's axis; 0 for a centre core.
    angle : (C,) array, rad
        Angle of each core from m1 towards m2, at the first gauge.
    pitch : float, m, optional
        Length of one turn of a spun fibre, positive for a right-handed helix; None for straight cores.
    """

    radius: Array
    angle: Array
    pitch: float | None = None

    def __post_init__(self) -> None:
        radius, angle = np.asarray(self.radius, dtype=np.float64), np.asarray(self.angle, dtype=np.float64)
        if radius.ndim != 1 or radius.shape != angle.shape or not np.isfinite([radius, angle]).all():
            raise InputError(f"radius and angle must be finite and of equal length (one per core), but their shapes "
                             f"are {radius.shape}, {angle.shape}")
        if (radius < 0).any() or self.pitch == 0:
            raise InputError("core radii must not be negative, and pitch must not be zero: use None for straight cores")
        object.__setattr__(self, "radius", radius)
        object.__setattr__(self, "angle", angle)

    @classmethod
    def symmetric(
        cls, outer: int, radius: float, *, centre: bool = True, first_angle: float = 0.0, pitch: float | None = None
    ) -> CoreLayout:
        """Return the positions of `outer` evenly spaced cores at the distance `radius` [m] from the fibre's axis,
        preceded by a centre core where `centre` is True.
        """
        angle = first_angle + 2 * np.pi * np.arange(outer) / outer
        lead = [0.0] if centre else []
        return cls(np.array([*lead, *([radius] * outer)]), np.array([*lead, *angle]), pitch)

    @property
    def twist_gain(self) -> Array:
        """Return the axial strain (C,) of each of C cores per rad/m of fibre twist; 0 for straight cores."""
        if self.pitch is None:
            return np.zeros_like(self.radius)
        turn = 2 * np.pi / self.pitch
        return turn * self.radius**2 / (1 + (turn * self.radius) ** 2)


@dataclass(frozen=True)
class FibreState:
    """Curvature, twist and common strain over time at each gauge along a multicore fibre.

    Attributes
    ----------
    curvature : (T, G, 2) array, 1/m
        (k1, k2) in the frame that does not rotate about the tangent (Bishop).
    twist : (T, G) array, rad/m
        Twist rate; zero where the layout cannot measure it.
    common : (T, G) array
        Strain that is common to all cores.
    residual : (T, G) array
        Root mean square over the cores of the residual strain; zero where there are as many unknowns as cores.
    curvature_gain : float, 1/m
        Standard deviation of one curvature component per unit standard deviation of the strain of a core.
    sees_twist : bool
        Whether the layout measures twist.
    """

    curvature: Array
    twist: Array
    common: Array
    residual: Array
    curvature_gain: float
    sees_twist: bool


def curvature_from_strain(
    strain: ArrayLike, gauge_position: ArrayLike, layout: CoreLayout, *, common_mode: str = "least-squares"
) -> FibreState:
    """Compute the curvature (two components), the twist and the strain common to all cores at each gauge, from the
    strain (T, C, G) of C cores at G gauges over T frames.

    Parameters
    ----------
    strain : (T, C, G) array
        Strain of each core and gauge relative to the straight, untwisted fibre. NaN stays NaN at its gauge.
    gauge_position : (G,) array, m
    layout : CoreLayout
    common_mode : {"least-squares", "centre"}
        Whether the common strain is estimated from all cores, or is that of the centre core. The first averages noise
        over all cores. With straight symmetric cores both give the same curvature.

    Returns
    -------
    FibreState

    Raises
    ------
    InputError
        When the cores are too few or badly positioned, or the centre core is missing that `common_mode` needs.

    Notes
    -----
    Spin and twist turn the cores along the fibre. The curvature is turned back by 2 pi s / P + int phi' ds, counted
    from the first gauge.
    """
    values, s = np.asarray(strain, dtype=np.float64), np.asarray(gauge_position, dtype=np.float64)
    if values.ndim != 3 or values.shape[1] != layout.radius.size or values.shape[2] != s.size:
        raise InputError(
            f"strain must have the shape (time, {layout.radius.size} cores, {s.size} gauges), not {values.shape}"
        )
    if common_mode not in COMMON_MODES:
        raise InputError(f"common_mode must be one of {', '.join(COMMON_MODES)}, not {common_mode!r}")
    solve, sees_twist = _solver(layout, common_mode)
    unknowns = np.einsum("uc,tcg->utg", solve, values)
    twist = unknowns[3] if sees_twist else np.zeros_like(unknowns[0])
    design = _design(layout, sees_twist=sees_twist)
    left = values - np.einsum("cu,utg->tcg", design, unknowns[: design.shape[1]])
    spin = _accumulated(twist, s) if sees_twist else np.zeros_like(twist)
    if layout.pitch is not None:
        spin = spin + 2 * np.pi * (s - s[0]) / layout.pitch
    c, w = np.cos(spin), np.sin(spin)
    curvature = np.stack([c * unknowns[1] - w * unknowns[2], w * unknowns[1] + c * unknowns[2]], axis=2)
    gain = float(np.sqrt(np.square(solve[1:3]).sum() / 2))
    return FibreState(curvature, twist, unknowns[0], np.sqrt(np.square(left).mean(axis=1)), gain, sees_twist)


def _design(layout: CoreLayout, *, sees_twist: bool) -> Array:
    """Return the strain (C, 3 or 4) of the cores per unit of eps_0, k1, k2 and, where measured, twist."""
    r, theta = layout.radius, layout.angle
    columns = [np.ones_like(r), -r * np.cos(theta), -r * np.sin(theta)]
    return np.stack([*columns, layout.twist_gain] if sees_twist else columns, axis=1)


def _solver(layout: CoreLayout, common_mode: str) -> tuple[Array, bool]:
    """Return the matrix (3 or 4, C) from strains to unknowns, and whether twist is among the unknowns."""
    centre = np.flatnonzero(layout.radius == 0)
    if common_mode == "centre" and centre.size == 0:
        raise InputError("common_mode='centre' needs a core at radius 0: use 'least-squares'")
    for sees_twist in (True, False):
        design = _design(layout, sees_twist=sees_twist)
        if sees_twist and layout.pitch is None:
            continue
        if common_mode == "least-squares":
            if _is_well_posed(design, sees_twist=sees_twist):
                return _pseudo_inverse(design), sees_twist
            continue
        outer = np.flatnonzero(layout.radius > 0)
        if _is_well_posed(design[outer, 1:], sees_twist=sees_twist):
            share = np.zeros((1, layout.radius.size))
            share[0, centre] = 1.0 / centre.size
            difference = np.eye(layout.radius.size)[outer] - share
            return np.concatenate((share, _pseudo_inverse(design[outer, 1:]) @ difference)), sees_twist
    raise InputError(
        f"{layout.radius.size} core(s) at these positions cannot separate bending from tension: three cores that "
        "are not on one line are needed"
    )


def _pseudo_inverse(design: Array) -> Array:
    scale = np.abs(design).max(axis=0)
    inverse = np.linalg.pinv(design / scale) / scale[:, None]
    return np.asarray(inverse, dtype=np.float64)


def _is_well_posed(design: Array, *, sees_twist: bool) -> bool:
    scale = np.abs(design).max(axis=0)
    bending = slice(design.shape[1] - 3, design.shape[1] - 1) if sees_twist else slice(-2, None)
    scale[bending] = scale[bending].max()  # one scale for both directions, or cores on a line would pass
    if design.shape[0] < design.shape[1] or (scale == 0).any():
        return False
    singular = np.linalg.svd(design / scale, compute_uv=False)
    return bool(singular[-1] > WELL_POSED * singular[0])


def _accumulated(rate: Array, s: Array) -> Array:
    total = np.zeros_like(rate)
    np.cumsum((rate[:, 1:] + rate[:, :-1]) / 2 * np.diff(s), axis=1, out=total[:, 1:])
    return total
