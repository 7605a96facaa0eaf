"""The nonlinear terms of the joints' spring law: parameter names, units and bounds.

A spring's torque is K q (1 + s q + a q^2 ...): the k-th term of the table, counted from 0, adds K c q^(k + 2). The law
is in `equations.elastic`, whose `TERMS` is the number of terms. `SPRING_BOUND` is the parameter which bounds the change
of the slope by the first term.
"""

from __future__ import annotations

from typing import NamedTuple


class SpringTerm(NamedTuple):
    """Symbol, unit and bounds of one nonlinear term of the spring law, such as `stiffening`.

    Its name is that of a field of `Model` and of a parameter of a fit.
    """

    letter: str  # symbol in messages
    unit: str
    most: float  # a larger value means a wrong unit
    fit: tuple[float, float, float]  # lower and upper bound of a fit, typical size


SPRING_TERMS = {
    "stiffening": SpringTerm("s", "1/rad", 1e6, (-10.0, 10.0, 0.2)),
    "cubic_stiffening": SpringTerm("a", "1/rad^2", 1e9, (-100.0, 100.0, 0.5)),
}
SPRING_BOUND = "stiffening_bound"  # field: f, largest change of a spring's slope by the first term, over K


def in_words(count: int = len(SPRING_TERMS)) -> str:
    """Return the spring law with its first `count` terms as text: ``K q (1 + s q + a q^2)``."""
    letters = [term.letter for term in SPRING_TERMS.values()][:count]
    powers = [f"{letter} q" + (f"^{k}" if k > 1 else "") for k, letter in enumerate(letters, 1)]
    return f"K q ({' + '.join(['1', *powers])})"
