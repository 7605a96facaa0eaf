"""The result of a fitted model on another day: what moved, the error before and after, and the verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from pliant.display import Card, Shown
from pliant.identification.fit import FitResult
from pliant.plain import by_name, plain, record_of, records_of

Verdict = Literal["same arm", "re-mounted", "changed body", "another arm", "another of the kind"]
FAR = 4.0  # standard deviations: a larger move of a parameter of the body may be a change of the body


class Move(NamedTuple):
    """The change of one parameter from the earlier day to the new one, SI.

    Attributes
    ----------
    name : str
    belongs : {"body", "mounting"}
    unit : str
    before, after : float
    old_std : float or None
        Standard error of the earlier fit; None for a parameter that was not free there.
    prior_std : float
        Standard deviation of the prior of the new day.
    std : float or None
        Standard error of the new fit; None if the recordings and the prior do not determine the parameter.
    moved : float or None
        Change over `old_std`; of a gain, without the part that all gains have in common.
    """

    name: str
    belongs: Literal["body", "mounting"]
    unit: str
    before: float
    after: float
    old_std: float | None
    prior_std: float
    std: float | None
    moved: float | None

    @property
    def clear(self) -> bool:
        """Return whether the change exceeds three standard errors of the difference."""
        doubt = (self.std or self.prior_std) ** 2 + (self.old_std or 0.0) ** 2
        return abs(self.after - self.before) > 3.0 * doubt**0.5


class DayError(NamedTuple):
    """RMS error of one recording of the new day under the earlier and the adapted model, and the day's peak
    displacement, m; rad of angles alone.
    """

    name: str
    role: Literal["fitted", "judged"]
    before: float
    after: float
    travel: float


@dataclass(frozen=True, repr=False)
class Adaptation(Shown):
    """A fitted model on another day.

    Attributes
    ----------
    verdict : str
        "same arm", "re-mounted", "changed body", "another arm", or "another of the kind".
    sentence : str
        The verdict with its reason.
    changed : tuple of str
        Parameters of the body that changed (`pliant.adaptation.change.body_change`).
    moves : tuple of Move
        All parameters, those of the mounting first.
    errors : tuple of DayError
        Errors of the recordings: those whose beginning was fitted, then those that judge.
    seconds : float
        Duration of the motion that was fitted, s.
    result : FitResult
        The adapted model, its parameters and their covariance.
    """

    verdict: Verdict
    sentence: str
    changed: tuple[str, ...]
    moves: tuple[Move, ...]
    errors: tuple[DayError, ...]
    seconds: float
    result: FitResult

    def to_dict(self) -> dict[str, Any]:
        """Return verdict, moves and errors as plain values for JSON; the fit has a table of its own."""
        unit, factor = self.result.shown_in
        errors = {e.name: {"role": e.role, f"before_{unit}": factor * e.before, f"after_{unit}": factor * e.after,
                           f"travel_{unit}": factor * e.travel} for e in self.errors}  # fmt: skip
        return {**plain(self, but=("result",)), "moves": by_name(self.moves), "errors": errors}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any], result: FitResult) -> Adaptation:
        """Return the adaptation from the result of `to_dict` and its fit."""
        unit, factor = result.shown_in
        errors = tuple(DayError(n, e["role"], *(e[f"{k}_{unit}"] / factor for k in ("before", "after", "travel")))
                       for n, e in content["errors"].items())  # fmt: skip
        moves = records_of(Move, content["moves"])
        return record_of(cls, {**content, "moves": moves, "errors": errors, "result": result})

    def card(self) -> Card:
        """Return a display card: verdict, errors before and after, and the table of moves."""
        unit, factor = self.result.shown_in
        lines = [
            f"{e.name} ({e.role}): {factor * e.before:.3g} {unit} before, {factor * e.after:.3g} {unit} after, "
            f"{100 * e.after / e.travel:.2g} % of the peak displacement" for e in self.errors
        ]
        rows = [
            [m.name, m.belongs, f"{m.before:.4g}", f"{m.after:.4g}", "" if m.std is None else f"+- {m.std:.2g}",
             "" if m.moved is None else f"{m.moved:+.1f}", m.unit] for m in self.moves
        ]
        head = ["parameter", "belongs to", "before", "after", "std. error", "moved by old sd", "unit"]
        return Card(self.sentence, lines, head, rows)
