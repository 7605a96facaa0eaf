"""Terms that settled shapes show, chosen before the first fit of a motion: a shape is solved in a fraction of the time
that the motion between two of them takes.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Collection, Sequence

from pliant.identification.parameters import apply
from pliant.selection.first_model import determined
from pliant.selection.fitted import FitSetting, FittedModel
from pliant.selection.search import INTERRUPTED, Search
from pliant.selection.terms import TERMS, Term, terms_for

OF_THE_PATH = ("slip", "tendon_friction", "entry_friction")  # depend on the motion between the shapes


def with_static_terms(
    still: FittedModel, shapes: FitSetting, names: Collection[str], others: Sequence[Term], stated: frozenset[str],
    seconds: float, notify: Callable[[str], None],
) -> tuple[FittedModel, list[Term], bool]:
    """Return the fit of settled shapes with the terms that these show, the terms, and whether an interrupt (Ctrl-C)
    ended the choice.

    Parameters
    ----------
    still : FittedModel
        The first model, fitted to the shapes.
    names : collection of str
        Names of the usual terms that may be added, as `terms_for` gives them at the values of `still`.
    others : sequence of Term
        Further terms that may be added. Terms that the shapes cannot show, and those that replace a parameter of the
        first model, are left out.
    stated : frozenset of str
        Names of parameters that are the same in every model.
    seconds : float
        Time limit.
    """
    model = apply(still.model, still.values)
    usual = terms_for(model, shapes.experiments, only=tuple(TERMS))
    offered = [*(t for t in usual if t.name in names), *others]
    terms = [t.on(model) for t in offered if t.name not in OF_THE_PATH and not t.replaces]
    if not terms:
        return still, [], False
    began, search, stopped = clock.monotonic(), None, False
    try:
        search = Search(shapes, still.model, determined(still, shapes), terms, began, began + seconds,
                        lambda line: notify(f"settled shapes, {line}"), stated=stated)  # fmt: skip
        search.choose()
    except KeyboardInterrupt:
        notify(INTERRUPTED)
        stopped = True
    return (still, [], stopped) if search is None else (search.best, search.chosen, stopped)


def in_order(terms: Sequence[Term], chosen: Sequence[Term]) -> list[Term]:
    """Return the terms with those that are chosen in their place."""
    by_name = {t.name: t for t in chosen}
    return [by_name.get(t.name, t) for t in terms]
