"""The nonlinear terms of the springs: names, units and bounds of their parameters.

A spring's torque is K q (1 + s q + a q^2 ...): the k-th term of the table, counted from 0, adds K c q^(k + 2). The
kernels of `elastic` read the number of terms from this table. `SPRING_BOUND` is the parameter which bounds the change
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
    axial: tuple[float, float, float]  # the same for axial springs, whose unit is 1


SPRING_TERMS = {
    "stiffening": SpringTerm("s", "1/rad", 1e6, (-10.0, 10.0, 0.2), (-100.0, 100.0, 2.0)),
    "cubic_stiffening": SpringTerm("a", "1/rad^2", 1e9, (-100.0, 100.0, 0.5), (-1e4, 1e4, 50.0)),
}
SPRING_BOUND = "stiffening_bound"  # field: f, largest change of a spring's slope by the first term, over K


def in_words(count: int = len(SPRING_TERMS), law: str = "K q") -> str:
    """Return the spring law with its first `count` terms as text: ``K q (1 + s q + a q^2)``.

    `law` is the linear law, whose last word is the symbol of the angle or strain.
    """
    symbol = law.rsplit(maxsplit=1)[-1]
    letters = [term.letter for term in SPRING_TERMS.values()][:count]
    powers = [f"{letter} {symbol}" + (f"^{k}" if k > 1 else "") for k, letter in enumerate(letters, 1)]
    return f"{law} ({' + '.join(['1', *powers])})"
