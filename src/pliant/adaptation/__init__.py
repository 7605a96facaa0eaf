"""A fitted model on another day: what belongs to the mounting is fitted anew, what belongs to the body is updated."""

from pliant.adaptation.adapt import adapt_model
from pliant.adaptation.day import DayParts, parts_of_day
from pliant.adaptation.mounting import MOUNTING
from pliant.adaptation.posterior import Posterior, posterior_of
from pliant.adaptation.result import Adaptation, Move

__all__ = ["MOUNTING", "Adaptation", "DayParts", "Move", "Posterior", "adapt_model", "parts_of_day", "posterior_of"]
