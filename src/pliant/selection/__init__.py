"""Selection of the terms of a model from training recordings alone."""

from pliant.selection.result import ModelSelection, SelectionStep, TriedTerm
from pliant.selection.select import select_model
from pliant.selection.terms import TERMS, Term, terms_for

__all__ = ["TERMS", "ModelSelection", "SelectionStep", "Term", "TriedTerm", "select_model", "terms_for"]
