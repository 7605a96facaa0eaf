"""Names of a chain's coordinates, and of the parameters that only chains in a plane or only chains in space have."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any

import numpy as np

from pliant.mechanics.records import CoordinateKind, strain_kind
from pliant.model import Model, Space
from pliant.shapes import Float

Array = np.ndarray


class Naming(ABC):
    """Names and groups of the N coordinates of a chain of n links, and of the parameters of its shape at rest.

    Attributes
    ----------
    frame : str
        Where base, axes and positive angles are, in words.
    turning_part : str
        What has hysteresis states of its own in a joint: "joint", or in space each "turn".
    """

    model: Model
    n: int
    size: int
    frame: str
    turning_part: str

    @cached_property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of the N coordinates x that the kernels use, such as "phi_1" or "bend_x_1"."""

    @cached_property
    @abstractmethod
    def rate_names(self) -> tuple[str, ...]:
        """Names of the N rates v that the kernels use, such as "w_1" or "bend_rate_x_1"."""

    @cached_property
    @abstractmethod
    def joint_names(self) -> tuple[str, ...]:
        """Names of the N joint coordinates q (joint angles, then strains), such as "q_1"."""

    @cached_property
    @abstractmethod
    def kinds(self) -> tuple[CoordinateKind, ...]:
        """Groups of coordinates of the same kind (joint angles, strains), in the order of their rows in q."""

    @property
    def labels(self) -> dict[str, list[Any]]:
        """Labels along each dataset dimension that belongs to coordinates: {"joint": [1, 2, ...], "segment": [...]}."""
        return {kind.over: kind.labels for kind in self.kinds}

    @property
    def counted(self) -> str:
        """The number of coordinates of each kind in words, such as "5 joint angles and 1 strain"."""
        counts = ((len(kind.labels), *kind.noun.partition(" about ")) for kind in self.kinds)
        return " and ".join(f"{count} {noun}{'s' * (count > 1)}{about}{axis}" for count, noun, about, axis in counts)

    @property
    def lengthens(self) -> bool:
        """Whether the actuator has segments that lengthen."""
        return bool(self.model.extensions)

    @property
    def lever(self) -> Float[Array, " N"]:
        """Factors (N,) from forces as stored in datasets to generalized forces [N m]: 1 for the torque [N m] of a joint
        angle, the segment's length [m] for the axial force [N] of a strain.
        """
        lever = np.empty(self.size)
        for kind in self.kinds:
            lever[kind.rows] = kind.lever
        return lever

    def gathered(self, data: Any, which: int) -> Float[Array, "T N"]:
        """Return one quantity of a dataset (the coordinates, their rates, the disturbances or the forces) for all N
        coordinates at T instants, as an array (T, N).

        `which` is the index of the quantity in `CoordinateKind.names`.
        """
        columns = [(kind.rows, np.asarray(data[kind.names[which]])) for kind in self.kinds]
        values = np.empty((len(columns[0][1]), self.size))
        for rows, column in columns:
            values[:, rows] = column
        return values

    @property
    @abstractmethod
    def coordinate_words(self) -> str:
        """What the kernels' coordinates are before the strains, in words."""

    @property
    @abstractmethod
    def rest_values(self) -> dict[str, float]:
        """Parameters of the shape at rest that link tips show, by their names in fits, such as {"rest_angle_1": 0.1}
        [rad].
        """

    @property
    def angle_values(self) -> dict[str, float]:
        """Parameters of the base and the rest shape that angles or orientations determine without positions."""
        return self.rest_values

    @property
    @abstractmethod
    def base_values(self) -> dict[str, float]:
        """Parameters of the direction of the clamped base, by their names in fits, such as {"base_angle": 0.1}
        [rad].
        """


class PlanarNaming(Naming):
    """Names of a chain in a plane."""

    frame = "base at the origin, its tangent along +y, the body in the x-y plane; positive angles bend towards -x"
    turning_part = "joint"

    @cached_property
    def names(self) -> tuple[str, ...]:
        return self._named("phi", "strain")

    @cached_property
    def rate_names(self) -> tuple[str, ...]:
        return self._named("w", "strain_rate")

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        return self._named("q", "strain")

    def _named(self, joint: str, segment: str) -> tuple[str, ...]:
        turns = (f"{joint}_{i + 1}" for i in range(self.n))
        return (*turns, *(f"{segment}_{e.name}" for e in self.model.extensions))

    @cached_property
    def kinds(self) -> tuple[CoordinateKind, ...]:
        joints = CoordinateKind(
            "joint", "joint angle", list(range(1, self.n + 1)), slice(0, self.n),
            ("joint_angle", "joint_rate", "disturbance", "external_torque"), ("rad", "rad/s", "N m"),
            ("memory_state", "memory_torque", "memory"), np.ones(self.n),
        )
        return (joints, *strain_kind(self.model))

    @property
    def coordinate_words(self) -> str:
        return "absolute angle of each link from the base tangent +y"

    @property
    def rest_values(self) -> dict[str, float]:
        return {f"rest_angle_{i + 1}": float(angle) for i, angle in enumerate(self.model.rest_angle)}

    @property
    def base_values(self) -> dict[str, float]:
        return {"base_angle": self.model.base_angle}


class SpatialNaming(Naming):
    """Names of a chain in space."""

    frame = "base at the origin, its tangent along +z"
    turning_part = "turn"

    @cached_property
    def space(self) -> Space:
        """Properties of the model that exist only in space, such as radius, stiffness ratios and base tilt."""
        return self.model.space or Space()

    @cached_property
    def names(self) -> tuple[str, ...]:
        return self._named("bend", "twist", "strain")

    @cached_property
    def rate_names(self) -> tuple[str, ...]:
        return self._named("bend_rate", "twist_rate", "strain_rate")

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        return self.names

    def _named(self, bend: str, twist: str, strain: str) -> tuple[str, ...]:
        bends = [f"{bend}_{axis}_{k + 1}" for k in range(self.n) for axis in "xy"]
        twists = [f"{twist}_{k + 1}" for k in range(self.n) if self.space.turns == 3]
        return (*bends, *twists, *(f"{strain}_{e.name}" for e in self.model.extensions))

    @cached_property
    def kinds(self) -> tuple[CoordinateKind, ...]:
        n, labels = self.n, list(range(1, self.n + 1))
        rows = {"x": slice(0, 2 * n, 2), "y": slice(1, 2 * n, 2), "twist": slice(2 * n, 3 * n)}
        turns = tuple(
            CoordinateKind(
                "joint", "joint twist" if axis == "twist" else f"joint angle about {axis}", labels, rows[axis],
                (f"joint_angle_{axis}", f"joint_rate_{axis}", f"disturbance_{axis}", f"external_torque_{axis}"),
                ("rad", "rad/s", "N m"), (f"memory_state_{axis}", f"memory_torque_{axis}", "memory"), np.ones(n),
            )
            for axis in ("x", "y", "twist")[: self.space.turns]
        )
        return (*turns, *strain_kind(self.model))

    @property
    def coordinate_words(self) -> str:
        return ", ".join(self.joint_names)

    @property
    def rest_values(self) -> dict[str, float]:
        rows = enumerate(self.space.rest_of(self.n))
        return {f"rest_turn_{axis}_{i + 1}": float(v) for i, row in rows for axis, v in zip("xy", row, strict=False)}

    @property
    def angle_values(self) -> dict[str, float]:
        return self.base_values | self.rest_values

    @property
    def base_values(self) -> dict[str, float]:
        return {f"base_tilt_{axis}": float(v) for axis, v in zip("xyz", self.space.base_tilt, strict=True)}
