"""Linearised models, continuous and sampled, for control design and export."""

from pliant.linear.linearisation import LinearModel, linearise
from pliant.linear.sampled import Margins, margins

__all__ = ["LinearModel", "Margins", "linearise", "margins"]
