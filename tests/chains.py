"""Chains that several rooms test with."""

from __future__ import annotations

from typing import Any

from pliant.model import Model


def awkward_chain(**changes: Any) -> Model:
    """Three unequal links, curved at rest, with a cap, gravity, a base and a torque law that is not a line."""
    return Model(
        link_length=[0.05, 0.03, 0.06], link_mass=[0.02, 0.01, 0.015], stiffness=[1.1, 0.8, 0.5],
        damping=[6e-3, 4e-3, 5e-3], torque=[5e-7, 2e-12], rest_angle=[0.2, 0.3, -0.1], joint_gain=[1.0, 0.8, 1.2],
        tip_mass=0.006, base_length=0.02, base_angle=0.3, gravity=[3.0, -9.0], **changes,
    )
