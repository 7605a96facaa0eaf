"""Terms that settled shapes show, chosen before the first fit of a motion: a shape is solved in a fraction of the time
that the motion between two of them takes.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Collection, Sequence

from pliant.identification.parameters import apply
from pliant.selection.first_model import determined
from pliant.selection.fitted import FitSetting, FittedModel
from pliant.selection.search import Search
from pliant.selection.terms import Term, terms_for

OF_THE_PATH = ("slip", "tendon_friction", "entry_friction")  # depend on the motion between the shapes


def with_static_terms(
    still: FittedModel, shapes: FitSetting, names: Collection[str], stated: frozenset[str], seconds: float,
    notify: Callable[[str], None],
) -> tuple[FittedModel, list[Term]]:
    """Return the fit of settled shapes with the terms that these show, and the terms.

    Parameters
    ----------
    still : FittedModel
        The first model, fitted to the shapes.
    names : collection of str
        Names of the terms that may be added. Those that the shapes cannot show, and those that replace a parameter of
        the first model, are left out.
    stated : frozenset of str
        Names of parameters that are the same in every model.
    seconds : float
        Time limit.
    """
    model = apply(still.model, still.values)
    offered = terms_for(model, shapes.experiments)
    terms = [t.on(model) for t in offered
             if t.name in names and t.name not in OF_THE_PATH and not t.replaces]  # fmt: skip
    if not terms:
        return still, []
    began = clock.monotonic()
    search = Search(shapes, still.model, determined(still, shapes), terms, began, began + seconds,
                    lambda line: notify(f"settled shapes, {line}"), stated=stated)  # fmt: skip
    search.choose()
    return search.best, search.chosen


def in_order(terms: Sequence[Term], chosen: Sequence[Term]) -> list[Term]:
    """Return the terms with those that are chosen in their place."""
    by_name = {t.name: t for t in chosen}
    return [by_name.get(t.name, t) for t in terms]
