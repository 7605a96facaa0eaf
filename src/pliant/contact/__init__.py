"""Contact detection from shape: whether, where and how hard a body is touched, and a map of the obstacles."""

from __future__ import annotations

from pliant.contact.contact import find_contact, free_motion
from pliant.contact.locate import locate
from pliant.contact.occupancy_map import map_contacts
from pliant.contact.residual import momentum_residual, static_residual

__all__ = ["find_contact", "free_motion", "locate", "map_contacts", "momentum_residual", "static_residual"]
