"""The camera's projection from the plane of bending to pixels, by a pinhole model with lens distortion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

Array = np.ndarray
CORNERS_MM = ((-120.0, -20.0), (60.0, -20.0), (60.0, 180.0), (-120.0, 180.0))  # corners of a sheet behind the body


@dataclass(frozen=True)
class View:
    """Position and optics of a camera that looks at the plane of bending.

    Attributes
    ----------
    size : (width, height), pixels
    pixels_per_mm : float
        Scale in the middle of the picture.
    centre : (float, float), m
        Point of the plane (base at the origin, tangent +y) in the middle of the picture.
    distance : float, m
        Distance from the camera to `centre`; it sets the strength of the perspective.
    aside, tilt : float, rad
        Angles by which the camera stands beside and above the normal of the plane.
    coefficients : tuple of float
        Distortion coefficients of the lens in OpenCV's order; empty: no distortion.
    """

    size: tuple[int, int] = (1920, 1080)
    pixels_per_mm: float = 4.8
    centre: tuple[float, float] = (-0.035, 0.082)
    distance: float = 0.9
    aside: float = 0.0
    tilt: float = 0.0
    coefficients: tuple[float, ...] = ()

    @property
    def focal(self) -> float:
        """Focal length, pixels."""
        return 1e3 * self.pixels_per_mm * self.distance

    def scaled(self, width: int) -> Self:
        """Return the same view with a picture `width` pixels wide."""
        share = width / self.size[0]
        size = (width, round(share * self.size[1] / 2) * 2)
        return replace(self, size=size, pixels_per_mm=share * self.pixels_per_mm)

    def pixels(self, plane: Array) -> Array:
        """Return the pixel coordinates (x to the right, y down) of points `plane` (..., 2) [m] in the plane of
        bending.
        """
        x, y = plane[..., 0] - self.centre[0], self.centre[1] - plane[..., 1]
        across, depth = x * np.cos(self.aside), x * np.sin(self.aside)
        down, behind = y * np.cos(self.tilt) - depth * np.sin(self.tilt), y * np.sin(self.tilt)
        away = self.distance + depth * np.cos(self.tilt) + behind
        seen = np.stack(_bent(across / away, down / away, self.coefficients), axis=-1)
        return np.asarray(self.focal * seen + 0.5 * (np.array(self.size) - 1.0))

    def table(self) -> dict[str, Any]:
        """Return this camera's ``[camera]`` table for a mapping that describes how to read a film: four points of the
        plane in pixels and mm, and the lens if it distorts.
        """
        corners = self.pixels(1e-3 * np.array(CORNERS_MM))
        table: dict[str, Any] = {"plane": {"pixels": corners.tolist(), "mm": [list(c) for c in CORNERS_MM]}}
        if self.coefficients:
            middle = [0.5 * (n - 1.0) for n in self.size]
            table["lens"] = {"focal": [self.focal, self.focal], "centre": middle, "coefficients": [*self.coefficients]}
        return table


def _bent(x: Array, y: Array, coefficients: tuple[float, ...]) -> tuple[Array, Array]:
    """Return normalised image coordinates distorted by OpenCV's lens model (k1, k2, p1, p2, k3)."""
    k1, k2, p1, p2, k3 = (*coefficients, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
    r2 = x**2 + y**2
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2), y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
