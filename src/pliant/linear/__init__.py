"""Linearised models, continuous and sampled: what control and export share."""

from pliant.linear.linearisation import LinearModel, linearise
from pliant.linear.sampled import Margins, margins

__all__ = ["LinearModel", "Margins", "linearise", "margins"]
