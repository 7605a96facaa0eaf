"""Known forces of a recording, as a study file states them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from pliant.errors import InputError
from pliant.model import Station
from pliant.simulation.forces import PointForce


class KnownForce(BaseModel):
    """A known force at a point of the body, such as a pulling thread, linearly interpolated between the stated
    times.
    """

    model_config = ConfigDict(extra="forbid")

    station: str | None = None  # name of a point of the model
    link: int | None = Field(None, ge=1)  # or a link, numbered from 1
    along: float | None = None  # m, position on that link from its joint
    across: float = 0.0  # m, to the left of the link
    aside: float = 0.0  # m, out of the plane, in space
    time_s: list[float]
    # (x, y) in the axes of a planar recording, in the base frame of a tracked one; in space (x, y, z) of the tracker
    force_n: list[Annotated[list[float], Field(min_length=2, max_length=3)]]

    @model_validator(mode="after")
    def one_place(self) -> KnownForce:
        """Check that the force acts either at a station or at a position on a link, not both."""
        if (self.station is None) == (self.link is None) or (self.link is None) != (self.along is None):
            raise ValueError("a known force needs either station, or link with along (and across)")
        return self

    @model_validator(mode="after")
    def one_length(self) -> KnownForce:
        """Check that all rows of force_n have the same number of components."""
        if len({len(row) for row in self.force_n}) > 1:
            raise ValueError("all rows of force_n need the same number of components: (x, y), or (x, y, z) in space")
        return self

    def in_base_frame(self, x_sign: int, rotation: np.ndarray | None = None) -> PointForce:
        """Return the force in the base frame.

        Two components are multiplied by `x_sign` (1 or -1), the direction of the recording's x axis there, and 1. Three
        are turned by `rotation` (3, 3) from the tracker's axes; without it they are in the base frame.
        """
        point = (self.link or 1) - 1, self.along or 0.0, self.across, self.aside
        force = np.array(self.force_n, dtype=float)
        if force.shape[-1] == 2:
            force = force * [x_sign, 1.0]
        elif rotation is not None:
            force = force @ rotation.T
        return PointForce(np.array(self.time_s), force, self.station or Station("known force", *point))


def check_forces(forces: Mapping[str, Sequence[KnownForce]], *, space: bool) -> None:
    """Raise InputError if a known force of a recording has two components for a body in `space`, or three for one in a
    plane. `forces` holds the forces of each recording.
    """
    where, components = ("in space", "(x, y, z)") if space else ("in a plane", "(x, y)")
    for name, listed in forces.items():
        for k, force in enumerate(listed):
            if wrong := [i for i, row in enumerate(force.force_n) if len(row) != 2 + space]:
                raise InputError(
                    f"recordings.{name}.forces.{k}.force_n.{wrong[0]} has {len(force.force_n[wrong[0]])} components, "
                    f"but the body moves {where} (`space` in [actuator]): state {components}"
                )
