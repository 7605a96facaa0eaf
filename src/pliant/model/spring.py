"""The terms of the joints' springs beyond the linear one: their names, units and bounds, in one table.

A spring's torque is K q (1 + s q + a q^2 ...): the k-th term of the table, counted from 0, adds K c q^(k + 2). The law
itself is `equations.elastic`, whose `TERMS` says how many there are. `SPRING_BOUND`
bounds what the first does to the slope.
"""

from __future__ import annotations

from typing import NamedTuple


class SpringTerm(NamedTuple):
    """One term: a field of `Model`, and a parameter of a fit with the same name."""

    letter: str  # in sentences
    unit: str
    most: float  # larger ones are a wrong unit
    fit: tuple[float, float, float]  # lower and upper bound of a fit, typical size


SPRING_TERMS = {
    "stiffening": SpringTerm("s", "1/rad", 1e6, (-10.0, 10.0, 0.2)),
    "cubic_stiffening": SpringTerm("a", "1/rad^2", 1e9, (-100.0, 100.0, 0.5)),
}
SPRING_BOUND = "stiffening_bound"  # field: f, what the first term does to a spring's slope at most, in parts of K


def in_words(count: int = len(SPRING_TERMS)) -> str:
    """The law with its first `count` terms: ``K q (1 + s q + a q^2)``."""
    letters = [term.letter for term in SPRING_TERMS.values()][:count]
    powers = [f"{letter} q" + (f"^{k}" if k > 1 else "") for k, letter in enumerate(letters, 1)]
    return f"K q ({' + '.join(['1', *powers])})"
