"""Measure how well models predict bodies of a random family, at 0.66, 1.3 and 2 times the highest training pressure.

    python benchmarks/family_sweep.py -o results/family_sweep --seeds 40            # resumes where it stopped
    python benchmarks/family_sweep.py -o results/family_sweep --seeds 40 --scheduler processes
    python benchmarks/family_sweep.py -o results/family_sweep --seeds 40 --figure docs/figures/family_sweep

Each seed is a different virtual laboratory (`pliant.testbed.family_member`): body, valve and sensors. It records pulses
of 1.5 s at 60, 119, 180, 234 and 360; pressures are scaled so that 180 is the working pressure. The recordings at 60
and 180 train a model selection (`pliant.selection.select_model`). The other recordings are used neither in the fit nor
in the choice; only their edge times are fitted. The rod has 60 elements.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import chunks
import numpy as np
import xarray as xr

from pliant.errors import PliantError
from pliant.failures import Failures
from pliant.identification import Experiment, predict, predict_held_out
from pliant.recording.netcdf import write_netcdf
from pliant.reduction import spline_shape
from pliant.selection import select_model
from pliant.study.body import study_model
from pliant.study.dense import link_experiment, shape_of
from pliant.study.fits import records_of, with_rivals
from pliant.study.prepare import all_aligned
from pliant.study.schema import Study
from pliant.sweep.store import Arrays
from pliant.testbed import Member, family_member, generate
from pliant.testbed.scenarios import SCENARIOS, pulse
from pliant.validation.outcome import RecordOutcome

LEVELS = {"low": 60e3, "high": 180e3, "inside": 119e3, "beyond": 234e3, "double": 360e3}
TRAIN, HELD_OUT = ("low", "high"), ("inside", "beyond", "double")
CASES = {"inside": "interpolation (0.66)", "beyond": "1.3 x", "double": "2 x"}
METRICS = {  # of a held-out pulse: words, unit
    "tip_percent": ("tip, RMS", "% of length"), "shape_percent": ("whole shape, RMS", "% of length"),
    "joints_mrad": ("all joint angles, RMS", "mrad"), "joint_bias_mrad": ("worst joint at the plateau", "mrad"),
    "frequency_percent": ("frequency", "%"), "damping_percent": ("damping ratio", "%"),
    "overshoot_points": ("overshoot", "points"), "within_band_percent": ("within the 95 % band", "%"),
}
SIGNED = ("frequency_percent", "damping_percent", "overshoot_points")
WIDTH, DURATION = 1.5, 3.5  # s
COMMON = np.linspace(0.0, DURATION - 0.2, 100)  # s, where residuals of all seeds are kept


@dataclass(frozen=True)
class Seeds(chunks.OneByOne):
    """Chunks of one seed each."""

    first: int = 0
    elements: int = 60
    links: int = 5

    def work(self, chunk: int) -> Arrays:
        """Compute all numbers of one seed; missing numbers are NaN, and `told` states the reason."""
        seed, began = self.first + chunk, time.process_time()
        who = family_member(seed)
        who = replace(who, body=replace(who.body, elements=self.elements))
        found: dict[str, Any] = {f"{case}_{m}": np.nan for case in HELD_OUT for m in METRICS} | {"told": ""}
        found["terms"] = ""
        found |= {f"{case}_normalised": np.full((COMMON.size, 2 * self.links), np.nan) for case in HELD_OUT}
        try:
            found |= judged(who, self.links)
        except PliantError as problem:
            found["told"] = str(problem)
        body = who.body
        found |= {
            "seed": seed, "length": body.length, "pressure": who.pressure, "frequency": who.frequency,
            "loss": who.loss_factor, "slip": body.slip_share, "relaxes": sum(body.prony_share),
            "swell": body.gain_slope, "locking": body.locking, "rate": who.rate, "noise": who.fibre.noise,
            "spool": type(who.valve).__name__,
            "failed": bool(found["told"]), "cpu_s": time.process_time() - began,
        }
        return {name: np.array([value]) for name, value in found.items()}


def recorded(who: Member, folder: Path, links: int) -> tuple[Study, dict[str, xr.Dataset], Any]:
    """Return the study of a member, its dense shapes in their plane, and the chain fitted to the strongest training
    shape.
    """
    for name, level in LEVELS.items():
        case = replace(SCENARIOS["pulse_119"], name=name, command=pulse(level, WIDTH), duration=DURATION)
        write_netcdf(generate(case, who, 1).recording, folder / f"{name}.nc")
    known = who.known()
    study = Study.model_validate({
        "name": "family_sweep", "folder": str(folder), "fits": {}, "reduction": {"recording": "high", "links": links},
        "actuator": {"length": known["body_length"], "mass": known["body_mass"], "tip_mass": known["tip_mass"]},
        "fibre": {"body_length": known["body_length"], "cap_curvature": who.body.cap_curvature,
                  "cap_length": who.body.cap_length, "gauge_length": known["gauge_length"]},
        "recordings": {name: {"file": f"{name}.nc"} for name in LEVELS},
    })  # fmt: skip
    aligned = all_aligned(study)
    assert study.reduction is not None
    shape = shape_of("high", aligned["high"].body, aligned["high"].tip, study.reduction)
    return study, {name: a.body for name, a in aligned.items()}, shape


def judged(who: Member, links: int) -> dict[str, Any]:
    """Return terms, training error and every metric of every held-out pulse of a member."""
    with tempfile.TemporaryDirectory() as folder:
        study, bodies, shape = recorded(who, Path(folder), links)
        experiments = {name: link_experiment(study, name, body, shape.links) for name, body in bodies.items()}
        model = study_model(study.actuator, None, shape.links)
    train = [experiments[n] for n in TRAIN]
    selection = select_model(train, model, minutes=30)
    found: dict[str, Any] = {"terms": " ".join(selection.terms), "train_percent": selection.steps[-1].train_percent,
                             "told": ""}
    for case in HELD_OUT:
        try:
            failures = Failures("hierarchy")
            records = records_of(
                train, [experiments[case]], selection.result, selection.result.time_step, "travel", failures
            )
            if failures:
                found["told"] += " ".join(f.sentence for f in failures)
                continue
            record = with_rivals(records[-1], selection.rivals)
            held = predict_held_out(experiments[case], selection.result)[1]
            rows = predict(held.model, experiments[case], held.values, held.time_step)["position"]
        except PliantError as problem:
            found["told"] += f"{case}: {problem}. "
            continue
        found |= {f"{case}_{k}": v for k, v in metrics(record, rows, bodies[case], shape.links).items()}
        found[f"{case}_normalised"] = normalised(record)
    return found


def normalised(record: RecordOutcome) -> np.ndarray:
    """Return residuals over their predicted standard deviation at the times `COMMON`, (100, 2 links)."""
    assert record.band is not None
    exp, rows = record.experiment, (record.experiment.compared - record.band.position) / record.band.std
    time = exp.time - exp.time[0]
    columns = rows.reshape(time.size, -1).T
    return np.stack([np.interp(COMMON, time[np.isfinite(c)], c[np.isfinite(c)]) for c in columns], axis=1)


def metrics(record: RecordOutcome, rows: np.ndarray, body: xr.Dataset, links: Any) -> dict[str, float]:
    """Return the metrics `METRICS` of one held-out pulse."""
    exp, m, length = record.experiment, record.metrics, float(links.node_arc_length[-1])
    off = 100.0 / length
    angle = joint_angles(rows) - joint_angles(exp.position)
    plateau = (exp.time > WIDTH - 0.3) & (exp.time < WIDTH + 0.1)  # the pulse begins at 0.12 s
    traits = {k: (m[k]["measured"], m[k]["modelled"]) for k in ("frequency_hz", "damping_ratio", "overshoot_percent")}
    share = {k: 100.0 * (b / a - 1.0) if a and b else np.nan for k, (a, b) in traits.items()}
    a, b = traits["overshoot_percent"]
    return {
        "tip_percent": off * rms(np.linalg.norm((rows - exp.position)[:, -1], axis=-1)),
        "shape_percent": off * shape_error(rows, exp, body, links), "joints_mrad": 1e3 * rms(angle),
        "joint_bias_mrad": 1e3 * float(np.abs(np.nanmean(angle[plateau], axis=0)).max()),
        "frequency_percent": share["frequency_hz"], "damping_percent": share["damping_ratio"],
        "overshoot_points": (b or 0.0) - (a or 0.0), "within_band_percent": m.get("within_band_percent", np.nan),
    }


def joint_angles(tips: np.ndarray) -> np.ndarray:
    """Return joint angles (T, n) [rad] of links with tips (T, n, 2) [m]; the base is at the origin."""
    step = np.diff(tips, axis=1, prepend=0.0)
    return np.diff(np.unwrap(np.arctan2(-step[..., 0], step[..., 1]), axis=1), axis=1, prepend=0.0)


def shape_error(rows: np.ndarray, exp: Experiment, body: xr.Dataset, links: Any) -> float:
    """Return the RMS distance [m], over body and time, of a spline through the predicted link tips from the measured
    body.
    """
    s = body["arc_length"].values
    inside = (s > links.node_arc_length[0]) & (s <= links.node_arc_length[-1])
    at = np.clip(np.searchsorted(body["time"].values, exp.time), 0, body.sizes["time"] - 1)
    seen = body["position"].values[at][:, inside, :2]
    origin = np.zeros(2) if links.node_arc_length[0] == 0 else links.base
    drawn = spline_shape(rows + (links.base - origin), links.node_arc_length, s[inside], base=links.base)
    return rms(np.linalg.norm(drawn - (seen + links.base - origin), axis=-1))


def rms(x: np.ndarray) -> float:
    """Return the root mean square of the finite values."""
    return float(np.sqrt(np.nanmean(np.square(x))))


def table(samples: xr.Dataset) -> str:
    """Return median, 90th percentile and worst value of every metric and case; quartiles of signed metrics."""
    lines = []
    for name, (words, unit) in METRICS.items():
        for case, title in CASES.items():
            v = samples[f"{case}_{name}"].values
            v = v[np.isfinite(v)]
            if not v.size:
                continue
            low = name == "within_band_percent"
            size = np.abs(v) if name in SIGNED else v
            worst = v[np.argmin(size) if low else np.argmax(size)]
            tail = np.quantile(size, 0.1 if low else 0.9)
            side = "above" if low else "within"
            lines.append(f"{words:<28} {title:<22} median {np.median(v):+7.2f}, nine in ten {side} {tail:6.2f}, "
                         f"worst {worst:+8.2f} {unit} ({v.size})")  # fmt: skip
    return "\n".join(lines)


def held_by_bands(samples: xr.Dataset, many: int = 5000) -> str:
    """Compare the fraction of each record within the prediction band with the fractions of a perfect band.

    A perfect band's residuals are normal, of the standard deviation told at each time and coordinate, and hang together
    from time to time and from coordinate to coordinate as those of the seeds do: weighted sums of these.
    """
    lines, draw = [], np.random.default_rng(0)
    for case, title in CASES.items():
        z = samples[f"{case}_normalised"].values
        z = z[np.isfinite(z).all(axis=(1, 2))].reshape(-1, z.shape[1] * z.shape[2])
        patterns = z / np.sqrt(len(z) * np.mean(z**2, axis=0))
        perfect = np.array([np.mean(np.abs(w @ patterns) <= 1.96) for w in draw.standard_normal((many, len(z)))])
        held = samples[f"{case}_within_band_percent"].values
        for words, v in (("held", held[np.isfinite(held)]), ("a perfect band", 100.0 * perfect)):
            lines.append(f"{title:<22} {words:<15} {v.mean():5.1f} % on average; 92 to 98 % in "
                         f"{100 * np.mean((v >= 92) & (v <= 98)):3.0f} %, more in {100 * np.mean(v > 98):3.0f} %, 90 % "
                         f"and more in {100 * np.mean(v >= 90):3.0f} % of the records")  # fmt: skip
    return "\n".join(lines)


def worst(samples: xr.Dataset, many: int = 5) -> str:
    """Return the seeds with the largest errors at 1.3 times the pressure, seeds without any prediction first."""
    missed = np.nan_to_num(samples["beyond_tip_percent"].values, nan=np.inf)
    lines = []
    for k in np.argsort(-missed)[:many]:
        row = samples.isel(sample=int(k))
        told = str(row["told"].values)
        numbers = ", ".join(f"{n} {float(row[n]):.3g}" for n in (
            "inside_tip_percent", "beyond_tip_percent", "double_tip_percent", "length", "frequency", "loss", "slip",
            "relaxes", "swell", "locking", "rate", "noise"))  # fmt: skip
        lines.append(f"seed {int(row['seed'])}, {row['terms'].values!s}, {row['spool'].values!s}: {numbers} {told}")
    return "\n".join(lines)


def figure(samples: xr.Dataset, path: Path) -> None:
    """Draw every seed as a dot and medians as bars, metric by metric."""
    from pliant.plotting import new_figure, style

    shown = [n for n in METRICS if n != "joint_bias_mrad"]
    with style():
        made, panels = new_figure(2, 4, height=4.0)
        for panel, name in zip(panels.flat, shown, strict=False):
            words, unit = METRICS[name]
            for k, case in enumerate(CASES):
                v = samples[f"{case}_{name}"].values
                v = np.sort(v[np.isfinite(v)])
                panel.plot(k + 0.28 * np.linspace(-1, 1, v.size), v, "o", ms=2.5, mfc="none", mec="0.35", mew=0.6)
                panel.plot([k - 0.38, k + 0.38], [np.median(v)] * 2, "k-", lw=1.8)
            panel.set(title=words, ylabel=unit, xticks=range(len(CASES)), xticklabels=["0.66", "1.3", "2"])
            panel.set_xlabel("x highest taught")
            if name in SIGNED:
                panel.axhline(0.0, color="0.6", lw=0.6)
            if name == "within_band_percent":
                panel.axhline(95.0, color="0.6", lw=0.6)
        for panel in panels.flat[len(shown):]:
            panel.set_axis_off()
        for ending in (".png", ".svg"):
            made.savefig(path.with_suffix(ending), dpi=200)


def main() -> None:
    """Compute missing seeds, then print the table and the five worst seeds, and draw the figure."""
    parser = chunks.options(__doc__, "family_sweep", 40)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--figure", type=Path, help="path without ending")
    args = parser.parse_args()
    seeds = Seeds(args.seeds, args.first)
    key = {"sweep": "family", "first": args.first, "elements": seeds.elements}
    key |= {"late": True} if args.late else {}
    samples = chunks.samples(seeds, key, args)
    print(f"{samples.sizes['sample']} seeds, {int(samples['failed'].sum())} with a prediction that was refused, "
          f"{float(samples['cpu_s'].median()):.0f} s of processor a seed (median)")
    print(table(samples))
    print(held_by_bands(samples))
    print(worst(samples))
    if args.figure:
        figure(samples, args.figure)


if __name__ == "__main__":
    main()
