"""What an experiment holds beside its positions must go with them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError

if TYPE_CHECKING:
    from pliant.identification.experiment import Experiment


def check_extras(exp: Experiment) -> None:
    """Refuse angles, noise levels and arc lengths that do not go with the positions."""
    if exp.angle is not None and exp.angle.shape != exp.position.shape[:2]:
        raise InputError(
            f"experiment {exp.name}: angles must be (time, station) = {exp.position.shape[:2]}, got {exp.angle.shape}"
        )
    if exp.angle is not None and exp.angle_reference not in ("rest", "base", "joint"):
        raise InputError(f"experiment {exp.name}: say what angles are measured from: angle_reference rest, base, joint")
    if exp.angles_alone and exp.angle is None:
        raise InputError(f"experiment {exp.name} compares angles alone, but has none")
    if strange := [s for s in exp.noise if s not in exp.stations]:
        raise InputError(f"experiment {exp.name} has a noise level for {strange[0]!r}, which is no station of it")
    levels = [*exp.noise.values(), *([] if exp.angle_noise is None else [exp.angle_noise])]
    if bad := [v for v in levels if not (np.isfinite(v) and v > 0)]:
        raise InputError(f"experiment {exp.name}: noise levels must be positive, in m and rad, got {bad[0]}")
    if exp.own_places and (exp.excitation == "release" or exp.angles_alone):
        raise InputError(f"experiment {exp.name}: own_places are read off places of a body at rest, not let go")
    if exp.held is not None and (exp.excitation != "release" or exp.held.shape != exp.position.shape[1:]):
        raise InputError(f"experiment {exp.name}: a held pose (station, 2) goes with a release alone")
    if exp.arc_length is not None and not (
        exp.arc_length.shape == (len(exp.stations),) and np.all(np.diff(exp.arc_length) > 0)
    ):
        raise InputError(f"experiment {exp.name}: arc_length must rise from station to station, one number for each")
