"""The result of a fit and its assessment in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.display import Card, Shown
from pliant.identification.experiment import Experiment
from pliant.identification.parameters import Parameter
from pliant.identification.uncertainty import Covariance
from pliant.model import Model

if TYPE_CHECKING:  # an optimiser is imported when one runs
    from scipy.optimize import OptimizeResult

Array = np.ndarray
DENSEST, LIGHTEST = 3000.0, 300.0  # kg/m^3: no silicone body lies beyond
USELESS = 0.3  # of a training record's peak displacement: an error beyond is no model of it


@dataclass(frozen=True, repr=False)
class FitResult(Shown):
    """A fitted model with what made it.

    Attributes
    ----------
    model : Model
        With the shared parameters put in.
    parameters : tuple of Parameter
        Free and fixed, with values and standard errors.
    status : str
        One sentence: how the optimisation ended and what to think of it.
    rmse : dict
        Euclidean error over stations and time of each training record, m; rad where `turns`.
    turns : bool
        Whether the records were compared by angles alone.
    evaluations : int
        Simulated parameter sets.
    seconds : float
        Wall time.
    converged : bool
        Whether the optimiser ended at an optimum that follows every training record to 30 % of its peak displacement.
    covariance : Covariance or None
        Of the free parameters; from the sandwich where residuals are coloured.
    notes : tuple of str
        What is not physical about the optimum, and how far residuals are correlated.
    bic : float or None
        Bayesian information criterion, counting correlated residuals once; lower is better, on the same recordings.
    """

    model: Model
    parameters: tuple[Parameter, ...]
    status: str
    rmse: dict[str, float]
    evaluations: int
    seconds: float
    converged: bool
    covariance: Covariance | None = None
    notes: tuple[str, ...] = ()
    bic: float | None = None
    turns: bool = False

    @property
    def values(self) -> dict[str, float]:
        """Value of every parameter by name."""
        return {p.name: float(p.value) for p in self.parameters if p.value is not None}

    @property
    def shown_in(self) -> tuple[str, float]:
        """The unit in which a reader reads the errors, and how many of it make one SI unit."""
        return ("deg", float(np.degrees(1.0))) if self.turns else ("mm", 1e3)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, for JSON."""
        unit, factor = self.shown_in
        return {
            "status": self.status, "converged": self.converged, "notes": list(self.notes),
            "evaluations": self.evaluations, "seconds": self.seconds, "bic": self.bic,
            f"rmse_{unit}": {k: factor * v for k, v in self.rmse.items()},
            "parameters": {p.name: parameter_dict(p) for p in self.parameters},
            "covariance": covariance_dict(self.covariance) if self.covariance else None,
        }

    def card(self) -> Card:
        """Status, parameters with standard errors, errors of the training records."""
        rows = [
            [p.name, "" if p.value is None else f"{p.value:.5g}", "" if p.std is None else f"+- {p.std:.2g}",
             p.unit.replace("^k", f"^{p.name[-1]}").replace("^1", ""), p.rests_on]
            for p in self.parameters
        ]
        unit, factor = self.shown_in
        errors = ", ".join(f"{name} {factor * value:.3g} {unit}" for name, value in self.rmse.items())
        lines = [*self.notes, *([f"RMSE of the training records: {errors}"] if errors else [])]
        return Card(self.status, lines, ["parameter", "value", "std. error", "unit", "rests on"], rows)


def covariance_dict(c: Covariance) -> dict[str, Any]:
    """A covariance as plain values, SI."""
    hidden = [bool(h) for h in c.hidden]
    return {"names": list(c.names), "matrix": c.matrix.tolist(), "hidden": hidden, "source": c.source}


def parameter_dict(p: Parameter) -> dict[str, Any]:
    """A parameter as plain values."""
    return {
        "value": p.value, "unit": p.unit, "free": p.free, "std": p.std, "source": p.source,
        "lower": p.lower if np.isfinite(p.lower) else None, "upper": p.upper if np.isfinite(p.upper) else None,
        "scale": p.scale, "prior": p.prior, "prior_std": p.prior_std, "rests_on": p.rests_on,
    }


def far_off(experiments: Sequence[Experiment], rmse: Mapping[str, float]) -> str:
    """Return a sentence on training records whose error exceeds `USELESS` of their peak displacement, or ''."""
    missed = {e.name: rmse[e.name] / e.travel for e in experiments if rmse[e.name] > USELESS * e.travel}
    if not missed:
        return ""
    listed = ", ".join(f"{name} by {100 * part:.0f} %" for name, part in missed.items())
    return (
        f"the model does not follow what it was fitted to ({listed} of the peak displacement): check the moments of "
        "the edges, the signs and units of the recordings and the start values"
    )


def status_sentence(best: OptimizeResult, parameters: Sequence[Parameter], far: str = "") -> str:
    """Return the end of the fit in words; `far` is what `far_off` says of its optimum."""
    if far:
        return f"The fit failed: {far}."
    end = {
        0: "stopped at the limit of evaluations before it converged: raise max_evaluations",
        1: "converged: the gradient vanished", 2: "converged: the cost no longer fell",
        3: "converged: the parameters no longer moved", 4: "converged: neither cost nor parameters moved",
    }.get(best.status, best.message)
    at_bound = [p.name for p in parameters if p.free and touches_bound(p)]
    unseen = [p.name for p in parameters if p.free and p.std is None]
    notes = ""
    if at_bound:
        notes += f"; at a bound: {', '.join(at_bound)}"
    if unseen:
        notes += f"; the data do not show: {', '.join(unseen)}"
    if getattr(best, "doubt", ""):
        notes += f"; {best.doubt}"
    return f"The fit {end}{notes}."


def touches_bound(p: Parameter) -> bool:
    """Whether the value lies on one of its bounds, to a millionth of its scale."""
    return p.value is not None and min(abs(p.value - p.lower), abs(p.value - p.upper)) < 1e-6 * (p.scale or 1.0)


def cautions(
    model: Model, parameters: Sequence[Parameter], experiments: Sequence[Experiment], section_area: float | None,
) -> list[str]:
    """Sentences about an optimum that no soft body has, and about the correlation that hides in it."""
    values = {p.name: float(p.value) for p in parameters if p.value is not None}
    free = {p.name for p in parameters if p.free}
    none = sorted(n for n in free if n.startswith("damping") and values[n] <= 1e-9 * model.stiffness.mean())
    found = [f"{n} is zero, as of no body: something else takes up the decay, or the step is too long." for n in none]
    if section_area is not None:
        density = float(model.link_mass.sum()) / (section_area * float(model.link_length.sum()))
        if not LIGHTEST <= density <= DENSEST:
            found.append(
                f"the mass and the section make {1e-3 * density:.1f} t/m3, no density of silicone: mass has taken up "
                "another effect, such as a lag of the pressure that is not in the model."
            )
    for exp in experiments:
        lag = max(max(c.valve.rise_time, c.valve.fall_time) for c in model.chambers)
        width = pulse_width(exp, values)
        if lag > width and {n.rpartition(".")[2] for n in free} & {"valve_rise", "valve_fall"}:
            found.append(
                f"the valve's lag of {lag:.3g} s is longer than the pulse of {exp.name}, {width:.3g} s: it has taken "
                "up another effect, such as creep."
            )
            break
    if model.actuation.count > 1:  # those on opposite sides bend opposite ways
        return [sentence[0].upper() + sentence[1:] for sentence in found]
    gain = float((model.joint_gain * model.torque_at(max(e.peak for e in experiments))).min()) if experiments else 1.0
    if gain < 0 and any(n.startswith(("torque_", "gain")) for n in free):
        found.append("the torque is negative at the highest pressure: model and recordings bend opposite ways.")
    return [sentence[0].upper() + sentence[1:] for sentence in found]


def pulse_width(exp: Experiment, values: dict[str, float]) -> float:
    """Return how long the pressure was on, s; the length of the recording if it is no pulse."""
    if exp.excitation == "pulse":
        return values[f"{exp.name}.stop"] - values[f"{exp.name}.start"]
    return float(np.inf) if exp.excitation == "release" else float(np.ptp(exp.time))
