"""The result of a fit, with its status, warnings and summaries for display."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.display import Card, Shown
from pliant.identification.experiment import Experiment
from pliant.identification.names import stem_of
from pliant.identification.parameters import Parameter, values_of
from pliant.identification.prediction import LONGEST
from pliant.identification.uncertainty import Covariance
from pliant.model import Model
from pliant.plain import plain

if TYPE_CHECKING:  # an optimiser is imported when one runs
    from scipy.optimize import OptimizeResult

Array = np.ndarray
DENSEST, LIGHTEST = 3000.0, 300.0  # kg/m^3: plausible densities of a silicone body
USELESS = 0.3  # of a training recording's peak displacement: a larger error means that the fit failed


@dataclass(frozen=True, repr=False)
class FitResult(Shown):
    """Result of a fit: model, parameter values with standard errors, errors of the recordings, and warnings.

    Attributes
    ----------
    model : Model
        The model with the shared parameters put in.
    parameters : tuple of Parameter
        Free and fixed parameters, with values and standard errors.
    status : str
        One sentence that says how the optimisation ended and how far to trust the result.
    rmse : dict
        Root-mean-square Euclidean error over stations and time, by training recording, m; rad where `turns`.
    turns : bool
        Whether the recordings were compared by angles only.
    evaluations : int
        Number of simulated parameter sets.
    seconds : float
        Wall time, s.
    converged : bool
        Whether the optimiser converged, no value ends at a bound other than 0, the error of every training recording
        is below 30 % of its peak displacement, and the cost is not above that of a smaller fit which this one contains.
    covariance : Covariance or None
        Covariance of the free parameters; the sandwich estimator where residuals are coloured.
    notes : tuple of str
        Warnings about an unphysical optimum, and the correlation time of the residuals.
    bic : float or None
        Bayesian information criterion with correlated residuals counted as fewer; lower is better, on the same
        recordings.
    time_step : float
        Time step of the fit, s, and default of predictions with it.
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
    time_step: float = LONGEST

    @property
    def values(self) -> dict[str, float]:
        """Return the values (SI) of all parameters by name."""
        return values_of(self.parameters)

    @property
    def shown_in(self) -> tuple[str, float]:
        """Return the display unit of the errors ("mm" or "deg"), and the factor to it from the SI unit."""
        return ("deg", float(np.degrees(1.0))) if self.turns else ("mm", 1e3)

    def to_dict(self) -> dict[str, Any]:
        """Return the result of the fit as a dictionary of plain numbers and strings for JSON."""
        unit, factor = self.shown_in
        return {
            "status": self.status, "converged": self.converged, "notes": list(self.notes),
            "evaluations": self.evaluations, "seconds": self.seconds, "bic": self.bic,
            "time_step_s": self.time_step,
            f"rmse_{unit}": {k: factor * v for k, v in self.rmse.items()},
            "parameters": {p.name: parameter_dict(p) for p in self.parameters},
            "covariance": covariance_dict(self.covariance) if self.covariance else None,
        }

    def card(self) -> Card:
        """Return a display card: status, table of parameters with standard errors, and training errors."""
        rows = [
            [p.name, "" if p.value is None else f"{p.value:.5g}", "" if p.std is None else f"+- {p.std:.2g}",
             p.unit.replace("^k", f"^{p.name[-1]}").replace("^1", ""), p.rests_on]
            for p in self.parameters
        ]
        unit, factor = self.shown_in
        errors = ", ".join(f"{name} {factor * value:.3g} {unit}" for name, value in self.rmse.items())
        lines = [*self.notes, *([f"RMSE of the training recordings: {errors}"] if errors else [])]
        return Card(self.status, lines, ["parameter", "value", "std. error", "unit", "rests on"], rows)


def covariance_dict(c: Covariance) -> dict[str, Any]:
    """Return a covariance of fitted parameters as a dictionary of plain numbers and strings for JSON, in SI units."""
    hidden = [bool(h) for h in c.hidden]
    return {"names": list(c.names), "matrix": c.matrix.tolist(), "hidden": hidden, "source": c.source}


def parameter_dict(p: Parameter) -> dict[str, Any]:
    """Return a fitted parameter as a dictionary of plain numbers and strings for JSON."""
    bounds = {name: bound if np.isfinite(bound) else None for name, bound in (("lower", p.lower), ("upper", p.upper))}
    return {**plain(p, but=("name", "shrink")), **bounds, "rests_on": p.rests_on}


def far_off(experiments: Sequence[Experiment], rmse: Mapping[str, float]) -> str:
    """Return a phrase on recordings whose fit error exceeds 30 % of their peak displacement; '' if there is none."""
    missed = {e.name: rmse[e.name] / e.travel for e in experiments if rmse[e.name] > USELESS * e.travel}
    if not missed:
        return ""
    listed = ", ".join(f"{name} {100 * part:.0f} %" for name, part in missed.items())
    return (
        f"failed: the model does not follow its training recordings (error {listed} of the peak displacement): check "
        "the times of the edges, the signs and units of the recordings and the start values"
    )


def status_sentence(best: OptimizeResult, parameters: Sequence[Parameter], failure: str = "") -> str:
    """Return a sentence on how the optimiser ended, with warnings.

    A `failure`, a phrase such as "failed: ...", is stated instead. Values at a bound are no optimum and are
    stated with a remedy, except at 0, where a term has no effect.
    """
    if failure:
        return f"The fit {failure}."
    end = {
        0: "stopped at the limit of evaluations before it converged: raise max_evaluations",
        1: "converged: the gradient vanished", 2: "converged: the cost no longer fell",
        3: "converged: the parameters no longer moved", 4: "converged: neither cost nor parameters moved",
    }.get(best.status, best.message)
    at_bound = [p.name for p in parameters if p.free and touches_bound(p)]
    unseen = [p.name for p in parameters if p.free and p.std is None]
    stopped = [stop for p in parameters if (stop := stopped_at(p))]
    notes = ""
    if stopped:
        end = "did not reach an optimum within the bounds"
    if at_bound:
        notes += f"; at a bound: {', '.join(at_bound)}"
    if stopped:
        notes += (f"; {', '.join(stopped)}: the recordings do not determine such a value; hold it constant at a known "
                  "one, state a narrower prior, or widen its bounds")  # fmt: skip
    if unseen:
        notes += f"; the data do not show the effect of: {', '.join(unseen)} (hold these constant)"
    if getattr(best, "doubt", ""):
        notes += f"; {best.doubt}"
    return f"The fit {end}{notes}."


def stopped_at(p: Parameter) -> str:
    """Return a phrase on the bound other than 0 at which a fitted parameter ends; '' if it ends at none."""
    value = p.value
    if value is None or not (p.free and touches_bound(p)):
        return ""
    side, bound = min((("lower", p.lower), ("upper", p.upper)), key=lambda pair: abs(value - pair[1]))
    if bound == 0.0:
        return ""
    known = f", in spite of its prior {p.prior:.3g} +- {p.prior_std:.2g}" if p.prior_std and p.prior is not None else ""
    return f"{p.name} ends at its {side} bound of {bound:.4g} {p.unit}".removesuffix(" 1") + known


def touches_bound(p: Parameter) -> bool:
    """Return whether the value of a parameter lies on one of its bounds, within a millionth of its scale."""
    return p.value is not None and min(abs(p.value - p.lower), abs(p.value - p.upper)) < 1e-6 * (p.scale or 1.0)


def cautions(
    model: Model, parameters: Sequence[Parameter], experiments: Sequence[Experiment], section_area: float | None,
) -> list[str]:
    """Return warnings about an unphysical fit: zero damping, implausible density, or a lag longer than a pulse."""
    values = values_of(parameters)
    free = {p.name: stem_of(p.name) for p in parameters if p.free}
    none = sorted(n for n, stem in free.items() if stem == "damping" and values[n] <= 1e-9 * model.stiffness.mean())
    texts = [f"{n} is zero, which no real body has: another parameter accounts for the decay, or the time step is too "
             "long." for n in none]  # fmt: skip
    if section_area is not None:
        density = float(model.link_mass.sum()) / (section_area * float(model.link_length.sum()))
        if not LIGHTEST <= density <= DENSEST:
            texts.append(
                f"the mass and the section give a density of {1e-3 * density:.1f} t/m3, implausible for silicone: the "
                "mass compensates for another effect, such as a lag of the pressure that is not in the model."
            )
    for exp in experiments:
        lag = max(max(c.valve.rise_time, c.valve.fall_time) for c in model.chambers)
        width = pulse_width(exp, values)
        if lag > width and {*free.values()} & {"valve_rise_time", "valve_fall_time"}:
            texts.append(
                f"the valve's lag of {lag:.3g} s is longer than the pulse of {exp.name}, {width:.3g} s: it compensates "
                "for another effect, such as creep."
            )
            break
    if model.actuation.count > 1:  # those on opposite sides bend opposite ways
        return [sentence[0].upper() + sentence[1:] for sentence in texts]
    gain = float((model.joint_gain * model.torque_at(max(e.peak for e in experiments))).min()) if experiments else 1.0
    if gain < 0 and {*free.values()} & {"torque", "gain"}:
        texts.append("the torque is negative at the highest pressure: model and recordings bend opposite ways.")
    return [sentence[0].upper() + sentence[1:] for sentence in texts]


def pulse_width(exp: Experiment, values: dict[str, float]) -> float:
    """Return the duration [s] of an experiment's pressure pulse: for a step the length of the recording, for a release
    infinity.
    """
    if exp.excitation == "pulse":
        return values[f"{exp.name}.stop"] - values[f"{exp.name}.start"]
    return float(np.inf) if exp.excitation == "release" else float(np.ptp(exp.time))
