"""The model at work: state from shape, contact, map, release."""

from __future__ import annotations

from pliant.runtime.contact import find_contact, free_motion
from pliant.runtime.estimation import estimate
from pliant.runtime.estimator import Estimator
from pliant.runtime.locate import locate
from pliant.runtime.mapping import map_contacts
from pliant.runtime.noise import Noise, default_noise
from pliant.runtime.release import release_of
from pliant.runtime.residual import momentum_residual, static_residual
from pliant.runtime.sight import rows_of

__all__ = [
    "Estimator", "Noise", "default_noise", "estimate", "find_contact", "free_motion", "locate", "map_contacts",
    "momentum_residual", "release_of", "rows_of", "static_residual",
]
