"""Array types that state a shape, as in ``Float[Array, "T S 2"]``: an array (T, S, 2) of floating-point numbers.

They are written as those of jaxtyping: letters and numbers for the dimensions, ``...`` for any number of leading ones,
and a blank before a single one, ``" T"``. To a type checker each is the array type alone, and nothing is checked at run
time.
"""

from typing import Annotated as Float
from typing import Annotated as Inexact

__all__ = ["Float", "Inexact"]  # Inexact: complex numbers too
