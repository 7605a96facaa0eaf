"""Parameters of the virtual body in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class BodyInSpace:
    """A hanging silicone cylinder with three chambers, in a sleeve that nearly prevents lengthening (SI units).

    The chambers lie at the angles `azimuth` about the axis, measured from x of the base frame towards y, at the
    distance `offset` from it. Their pressures follow the command with a first-order lag.
    """

    length: float = 0.17
    radius: float = 0.015
    density: float = 1080.0
    youngs_modulus: float = 5e5
    sleeve: float = 10.0  # axial stiffness over that of the silicone alone
    damping: float = 1.2  # 1/s, force per mass and velocity
    azimuth: tuple[float, ...] = (np.pi / 2, np.pi * 7 / 6, np.pi * 11 / 6)
    area: float = 1e-4  # m^2, of one chamber
    offset: float = 9e-3  # m
    lag: float = 0.03  # s
    elements: int = 24
    time_step: float = 5e-5  # s, half of the limit of the stretch wave

    @property
    def torque(self) -> float:
        """Bending moment per pressure of one chamber, N m/Pa."""
        return self.area * self.offset

    @property
    def bending_stiffness(self) -> float:
        """Bending stiffness EI, N m^2."""
        return self.youngs_modulus * np.pi * self.radius**4 / 4

    @property
    def mass(self) -> float:
        """Mass of the body, kg."""
        return self.density * np.pi * self.radius**2 * self.length
