"""Fit the examples with one term added, removed or replaced: the tables of "Hysteresis and creep".

Usage: python benchmarks/variants.py [beam|trunk|swings|pulses|left_out|stiffening|levels|parts ...]; the
recordings come by `pliant data fetch`.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from pliant.identification.initial_guess import last_edge
from pliant.numerics.ringdown import turning_points
from pliant.study import demo_study, load_study, run_study
from pliant.study.prepare import all_aligned, load_recording
from pliant.study.run import prepare_all
from pliant.study.schema import AlignmentEntry, Fit

EXAMPLES = Path(__file__).parents[1] / "examples"


def free(*names: str) -> dict[str, str]:
    return dict.fromkeys(names, "free")


FRAME = free("stiffness", "base_angle", "tip.along", "tip.across")
VISCOUS, SPRINGPOT = free("damping"), {"damping": {"value": 0.0, "free": False},
                                       **free("fractional_share", "fractional_order")}  # fmt: skip
EACH = free("alone.release_time", "load52.release_time")
PAYNE = free("payne_share", "payne_angle", "payne_exponent")
BOTH = {
    "viscous, at once": VISCOUS,
    "viscous, each release_time": {**VISCOUS, **EACH},
    "springpot, at once": SPRINGPOT,
    "springpot, one release_time": {**SPRINGPOT, **free("release_time")},
    "springpot, each release_time": {**SPRINGPOT, **EACH},
    "the same, clamp gives way": {**SPRINGPOT, **EACH, **free("load52.base_turn")},
    "viscous, creep, springs that soften, each release_time, clamp gives way":
        {**VISCOUS, **EACH, **free("load52.base_turn", "creep_share_1", "creep_time_1", "stiffening")},
    "springpot of order 0.1, dashpot, springs that soften, each release_time, clamp gives way":
        {**VISCOUS, **EACH, **free("load52.base_turn", "stiffening", "fractional_share"),
         "fractional_order": {"value": 0.1, "free": False}},
    "slip and dashpot, each release_time, clamp gives way":
        {**VISCOUS, **EACH, **free("load52.base_turn", "slip_share_1", "slip_angle_1")},
    "Payne and dashpot, each release_time, clamp gives way":
        {**VISCOUS, **PAYNE, **EACH, **free("load52.base_turn")},
    "Payne and springpot, each release_time, clamp gives way":
        {**SPRINGPOT, **PAYNE, **EACH, **free("load52.base_turn")},
    "Payne of the loaded beam alone and dashpot, each release_time, clamp gives way":
        {**VISCOUS, **EACH, **free("load52.base_turn"), "payne_share": {"value": 0.0, "free": False},
         "load52.payne_share": {"value": 0.3}, "payne_angle": {"value": 0.0015}, "payne_exponent": {"value": 0.45}},
    "slip and springpot, each release_time, clamp gives way":
        {**SPRINGPOT, **EACH, **free("load52.base_turn", "slip_share_1", "slip_angle_1")},
}
ONE = {"viscous, at once": VISCOUS, "springpot, release_time": {**SPRINGPOT, **free("release_time")}}
PULSES = free("damping", "torque_1", "torque_2", "start", "stiffening")
DETAIL = {
    "one K": free("stiffness"), "K of each joint": free("stiffness_*"),
    "and one creep branch": free("stiffness_*", "creep_share_1", "creep_time_1"),
}
STIFF_WHEN_SMALL = {"stiffness": {"value": 0.1}, "damping": {"value": 0.005}, "payne_share": {"value": 30.0},
                    "payne_angle": {"value": 0.009}, "payne_exponent": "free"}  # from elsewhere a fit ends higher
BEYOND = {
    "as it is": {}, "springs that soften": free("stiffening"), "K of each joint": free("stiffness_*"), "Payne": PAYNE,
    "springs that soften, then stiffen": free("stiffening", "cubic_stiffening"),
}
SLIP = free("slip_share_1", "slip_angle_1", "slip_share_2", "slip_angle_2")


def beam() -> None:
    """Fit the released beam to both loads, and to each load to predict the other."""
    study = load_study(EXAMPLES / "silicone_cantilever.toml")
    held = {name: r.model_copy(update={"held": "unloaded"}) for name, r in study.recordings.items()}
    study = study.model_copy(update={"recordings": held})
    fits = [Fit(title=f"both: {name}", train=["alone", "load52"], parameters={**FRAME, **more})
            for name, more in BOTH.items()]
    fits += [Fit(title=f"{here} to {there}: {name}", train=[here], held_out=[there], parameters={**FRAME, **more})
             for here, there in (("alone", "load52"), ("load52", "alone")) for name, more in ONE.items()]
    for fit in fits:
        forecasts = study.forecasts if "load52" in fit.train else {}
        show(study.model_copy(update={"fits": {"fit": fit}, "forecasts": forecasts}))


def trunk() -> None:
    """Fit the hanging trunk with friction, with all trials moved to one rest position, and with Payne's curve."""
    study = load_study(EXAMPLES / "trunk_free_decay.toml")
    plain = study.fits["unknown_mass"]
    slipping = plain.model_copy(update={"title": "two slip elements", "parameters": {**plain.parameters, **SLIP}})
    show(study.model_copy(update={"fits": {"plain": plain}, "forecasts": {}}))
    show(study.model_copy(update={"fits": {"slip": slipping}, "forecasts": {}}))
    one_rest = slipping.model_copy(update={"title": "two slip elements, all trials moved to one rest"})
    rest = AlignmentEntry.model_validate({**study.alignment.model_dump(), "common_rest": True})
    show(study.model_copy(update={"fits": {"slip": one_rest}, "forecasts": {}, "alignment": rest}))
    near = {"stiffness": {"value": 0.3}, "damping": {"value": 0.01}, "payne_share": {"value": 10.0},
            "payne_angle": {"value": 0.01}, "payne_exponent": "free"}
    own = plain.model_copy(update={"title": "Payne, each trial its rest", "parameters": {**plain.parameters, **near}})
    show(study.model_copy(update={"fits": {"fit": own}, "forecasts": {}}))
    for name, more in (("viscous", {}), ("Payne", STIFF_WHEN_SMALL)):
        entries = {**plain.parameters, **more, **free("rest_angle_*")}
        fit = plain.model_copy(update={"title": f"{name}, one rest, rest angles free", "parameters": entries})
        show(study.model_copy(update={"fits": {"fit": fit}, "forecasts": {}, "alignment": rest}))


def swings() -> None:
    """Print half swings of the free decays with frequency and damping ratio, and the rest positions of the trunk."""
    for name, least in (("silicone_cantilever", 0.25), ("trunk_free_decay", 2.0)):  # mm that a swing must span
        study = load_study(EXAMPLES / f"{name}.toml")
        for exp in prepare_all(study, lambda _line: None).experiments.values():
            after = (exp.time > last_edge(exp) + 0.03) & np.isfinite(exp.last_station).all(axis=1)
            place = exp.last_station[after]
            along = 1e3 * place @ np.linalg.svd(place - place.mean(axis=0), full_matrices=False)[2][0]
            at, value = turning_points(exp.time[after], along, least)
            way = np.abs(np.diff(value))
            decrement = np.append(np.log(way[:-1] / way[1:]) / np.pi, np.nan)
            print(f"{exp.name}: half swing mm, Hz, damping ratio to the next")
            for half, hz, ratio in zip(0.5 * way, 0.5 / np.diff(at), decrement / np.hypot(1.0, decrement), strict=True):
                print(f"  {half:6.2f} {hz:5.2f} {ratio:6.3f}")
    trials = [load_recording(study, name).position.values[:, -1][:, [0, 2]] for name in study.recordings]
    rests = 1e3 * np.array([t[-50:].mean(axis=0) for t in trials])
    pulls = 1e3 * np.array([t[:3].mean(axis=0) for t in trials]) - rests
    away, pull = rests - rests.mean(axis=0), pulls - pulls.mean(axis=0)
    share = np.sum(away * pull) / np.sum(pull**2)
    left = [float(np.sqrt(np.mean(np.sum(a**2, axis=1)))) for a in (away, away - share * pull)]
    print("trunk's tip at rest, mm rms about its mean, and with a share of the pull off:", np.round(left, 2), share)


def pulses() -> None:
    """Predict the pneumatic arm at 400 mbar from 100, 200, 300, with creep instead of settling and one term more."""
    study = load_study(EXAMPLES / "pneumatic_arm_pulses.toml")
    plain = study.fits["no_settling_beyond"]
    for name, more in BEYOND.items():
        kept = {k: v for k, v in plain.parameters.items() if not (k == "stiffness" and "stiffness_*" in more)}
        fit = plain.model_copy(update={"title": f"400 beyond, {name}", "parameters": {**kept, **more}})
        show(study.model_copy(update={"fits": {"fit": fit}}))


def left_out() -> None:
    """Predict each pulse of the pneumatic arm from the three others, with four sets of terms."""
    study = load_study(EXAMPLES / "pneumatic_arm_pulses.toml")
    sets = {"settling, creep and softening": "together_beyond", "and a bounded stretch": "bounded_beyond",
            "settling": "inflating_beyond", "creep": "no_settling_beyond"}  # fmt: skip
    fits = {}
    for name, source in sets.items():
        for level in study.recordings:
            others = [r for r in study.recordings if r != level]
            changes = {"title": f"{name}, {level} left out", "train": others, "held_out": [level]}
            fits[f"{source}_{level}"] = study.fits[source].model_copy(update=changes)
    outcome = run_study(study.model_copy(update={"fits": fits}))
    for fit in outcome.fits:
        (record,) = (r for r in fit.records if r.role == "held_out")
        print(f"{fit.title}: {record.metrics['rmse_percent_of_travel']:.2f} % of peak displacement, "
              f"{record.metrics['within_band_percent']:.0f} % within the band", flush=True)  # fmt: skip


def stiffening() -> None:
    """Predict the demo's actuator at 240 kPa from 60 and 180, with and without springs that stiffen again."""
    study = load_study(demo_study()).model_copy(update={"model_selection": None})
    pulses = {"train": ["pulse_60", "pulse_180"], "held_out": ["step_240"]}
    for name, more in DETAIL.items():
        for last in ({}, free("cubic_stiffening")):
            fit = Fit(title=f"{name}{', cubic' * bool(last)}", parameters={**PULSES, **more, **last}, **pulses)
            show(study.model_copy(update={"fits": {"fit": fit}}))


def levels() -> None:
    """Print the error of interpolating the tip's measured time series between the eight levels, without a model."""
    bodies = [one.body for one in all_aligned(load_study(EXAMPLES / "pneumatic_arm_levels.toml")).values()]
    level = np.array([b.attrs["nominal_pressure"] for b in bodies])
    tips = np.stack([b.position.sel(station="tip").to_numpy() for b in bodies])
    tips = tips - tips[:, :5].mean(axis=1, keepdims=True)
    for nearest, degree in ((2, 1), (4, 2), (4, 3), (7, 3), (7, 4)):
        missed = []
        for k in range(1, len(level) - 1):
            others = np.delete(np.arange(len(level)), k)
            others = np.sort(others[np.argsort(abs(level[others] - level[k]), kind="stable")[:nearest]])
            law = np.polyfit(level[others] / level[-1], tips[others].reshape(nearest, -1), degree)
            made = (np.vander([level[k] / level[-1]], degree + 1) @ law).reshape(tips[k].shape)
            error, travel = np.linalg.norm(made - tips[k], axis=1), np.linalg.norm(tips[k], axis=1).max()
            missed.append(100.0 * np.sqrt(np.mean(error**2)) / travel)
        print(f"degree {degree}, {nearest} levels: % of travel {np.round(missed, 1)}, mean {np.mean(missed):.1f}")


def parts() -> None:
    """Print the errors of the levels left out in turn: whole, first swing, what follows it, and rest displacement.

    The first swing is the first 0.3 s after the tip has passed a tenth of its peak displacement.
    """
    study = load_study(EXAMPLES / "pneumatic_arm_levels.toml")
    fits = {name: fit for name, fit in study.fits.items() if fit.held_out}
    rows = []
    for fit in run_study(study.model_copy(update={"fits": fits, "forecasts": {}})).fits:
        (record,) = (r for r in fit.records if r.role == "held_out")
        exp, first = record.experiment, 0.3  # s
        off = np.linalg.norm(record.modelled[:, -1] - exp.position[:, -1], axis=1)
        moved = np.linalg.norm(exp.position[:, -1] - exp.position[0, -1], axis=1)
        since = exp.time - exp.time[np.argmax(moved > 0.1 * exp.travel)]
        spans = (np.isfinite(since), (since >= 0.0) & (since < first), since >= first)
        at_rest = record.metrics["steady_state_mm"]
        errors = [np.sqrt(np.mean(off[span] ** 2)) for span in spans]
        errors.append(1e-3 * (at_rest["modelled"] - at_rest["measured"]))
        rows.append(100.0 * np.array(errors) / exp.travel)
        print(f"{record.name}: % of peak displacement: whole, first swing, later, at rest {np.round(rows[-1], 1)}",
              flush=True)  # fmt: skip
    rows = np.abs(rows)
    print(f"means {np.round(np.mean(rows, axis=0), 1)}, of the six between {np.round(np.mean(rows[1:-1], axis=0), 1)}")


def show(study: object) -> None:
    """Run a study of one fit, and print a line for each recording, parameter with its error, and forecast."""
    outcome = run_study(study).to_dict()
    ((_, fit),) = outcome["fits"].items()
    print(fit["title"])
    for name, m in fit["records"].items():
        kept = {k: m.get(k) for k in ("rmse_percent_of_travel", "rmse_percent_of_length", "frequency_large_hz",
                                      "frequency_small_hz", "frequency_hz", "damping_ratio", "steady_state_mm",
                                      "overshoot_percent", "max_mm")}
        print(f"  {m['role']:8} {name:10} {rounded(kept)}")
    print("  parameters", rounded({n: [p["value"], p["std"]] for n, p in fit["parameters"].items() if p["free"]}))
    for forecast in outcome.get("forecasts", {}).values():
        print("  forecast  ", rounded({k: forecast[k] for k in ("frequency_hz", "steady_state_mm")}))
    print(flush=True)


def rounded(content: object) -> str:
    """Return numbers rounded to four digits."""
    return json.dumps(json.loads(json.dumps(content), parse_float=lambda text: float(f"{float(text):.4g}")))


if __name__ == "__main__":
    tables = {"beam": beam, "trunk": trunk, "swings": swings, "pulses": pulses, "left_out": left_out,
              "stiffening": stiffening, "levels": levels, "parts": parts}
    for asked in sys.argv[1:] or tables:
        tables[asked]()
