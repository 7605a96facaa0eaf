"""Measure how well models predict bodies of a random family, at 0.66, 1.3 and 2 times the highest training pressure.

Each seed is a different virtual laboratory (`pliant.testbed.family_member`): body, valve and sensors. It records pulses
of 1.5 s at 60, 119, 180, 234 and 360; pressures are scaled so that 180 is the working pressure. The recordings at 60
and 180 train a model selection. The other recordings are used neither in the fit nor in the choice; only their edge
times are fitted. The rod has 60 elements. A later run goes on from the rows in
results/family_sweep.json.

    python benchmarks/family_sweep.py --first 200 --seeds 20
    python benchmarks/family_sweep.py --figure docs/figures/family_sweep.svg
"""

from __future__ import annotations

import json
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from harness import parser_of, table

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
from pliant.testbed import Member, family_member, generate
from pliant.testbed.scenarios import SCENARIOS, pulse
from pliant.validation.outcome import RecordOutcome

Row = dict[str, Any]
LEVELS = {"low": 60e3, "high": 180e3, "inside": 119e3, "beyond": 234e3, "double": 360e3}
TRAIN, CASES = ("low", "high"), {"inside": "0.66 times", "beyond": "1.3 times", "double": "2 times"}
METRICS = {  # of a held-out pulse: words
    "tip_percent": "tip, RMS, % of length", "shape_percent": "whole shape, RMS, % of length",
    "joints_mrad": "all joint angles, RMS, mrad", "frequency_percent": "frequency, %",
    "damping_percent": "damping ratio, %", "overshoot_points": "overshoot, points",
    "within_band_percent": "within the 95 % band, %",
}
SIGNED = ("frequency_percent", "damping_percent", "overshoot_points")
WIDTH, DURATION = 1.5, 3.5  # s
KEPT = Path(__file__).parent / "results" / "family_sweep.json"


def row_of(seed: int, elements: int = 60, links: int = 5) -> Row:
    """Return all numbers of one seed; missing numbers are NaN, and `message` states the reason."""
    row: Row = {f"{case}_{metric}": np.nan for case in CASES for metric in METRICS} | {"terms": "", "message": ""}
    who = family_member(seed)
    try:
        row |= judged(replace(who, body=replace(who.body, elements=elements)), links)
    except PliantError as problem:
        row["message"] = str(problem)
    return row


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


def judged(who: Member, links: int) -> Row:
    """Return the terms and every metric of every held-out pulse of a member."""
    with tempfile.TemporaryDirectory() as folder:
        study, bodies, shape = recorded(who, Path(folder), links)
        experiments = {name: link_experiment(study, name, body, shape.links) for name, body in bodies.items()}
        model = study_model(study.actuator, None, shape.links)
    train = [experiments[n] for n in TRAIN]
    selection = select_model(train, model, minutes=30)
    row: Row = {"terms": " ".join(selection.terms), "message": ""}
    for case in CASES:
        try:
            failures = Failures("hierarchy")
            result = selection.result
            records = records_of(train, [experiments[case]], result, result.time_step, "travel", failures)
            if failures:
                row["message"] += " ".join(f.sentence for f in failures)
                continue
            record = with_rivals(records[-1], selection.rivals)
            held_out = predict_held_out(experiments[case], result)[1]
            rows = predict(held_out.model, experiments[case], held_out.values, held_out.time_step)["position"]
        except PliantError as problem:
            row["message"] += f"{case}: {problem}. "
            continue
        row |= {f"{case}_{k}": v for k, v in metrics(record, rows, bodies[case], shape.links).items()}
    return row


def metrics(record: RecordOutcome, rows: np.ndarray, body: xr.Dataset, links: Any) -> dict[str, float]:
    """Return the metrics `METRICS` of one held-out pulse."""
    exp, m, percent = record.experiment, record.metrics, 100.0 / float(links.node_arc_length[-1])
    traits = {k: (m[k]["measured"], m[k]["modelled"]) for k in ("frequency_hz", "damping_ratio", "overshoot_percent")}
    share = {k: 100.0 * (b / a - 1.0) if a and b else np.nan for k, (a, b) in traits.items()}
    a, b = traits["overshoot_percent"]
    return {
        "tip_percent": percent * rms(np.linalg.norm((rows - exp.position)[:, -1], axis=-1)),
        "shape_percent": percent * shape_error(rows, exp, body, links),
        "joints_mrad": 1e3 * rms(joint_angles(rows) - joint_angles(exp.position)),
        "frequency_percent": share["frequency_hz"], "damping_percent": share["damping_ratio"],
        "overshoot_points": (b or 0.0) - (a or 0.0), "within_band_percent": m.get("within_band_percent", np.nan),
    }


def joint_angles(tips: np.ndarray) -> np.ndarray:
    """Return joint angles (T, n) [rad] of links with tips (T, n, 2) [m]; the base is at the origin."""
    step = np.diff(tips, axis=1, prepend=0.0)
    return np.diff(np.unwrap(np.arctan2(-step[..., 0], step[..., 1]), axis=1), axis=1, prepend=0.0)


def shape_error(rows: np.ndarray, exp: Experiment, body: xr.Dataset, links: Any) -> float:
    """Return the RMS distance [m] of a spline through the predicted link tips from the measured body."""
    s = body["arc_length"].values
    inside = (s > links.node_arc_length[0]) & (s <= links.node_arc_length[-1])
    frame = np.clip(np.searchsorted(body["time"].values, exp.time), 0, body.sizes["time"] - 1)
    measured = body["position"].values[frame][:, inside, :2]
    origin = np.zeros(2) if links.node_arc_length[0] == 0 else links.base
    drawn = spline_shape(rows + (links.base - origin), links.node_arc_length, s[inside], base=links.base)
    return rms(np.linalg.norm(drawn - (measured + links.base - origin), axis=-1))


def rms(x: np.ndarray) -> float:
    """Return the root mean square of the finite values."""
    return float(np.sqrt(np.nanmean(np.square(x))))


def summary(rows: list[Row]) -> dict[str, dict[str, str]]:
    """Return median, 90th percentile and worst value of every metric and case."""
    lines: dict[str, dict[str, str]] = {words: {} for words in METRICS.values()}
    for name, words in METRICS.items():
        for case, title in CASES.items():
            v = np.array([row[f"{case}_{name}"] for row in rows])
            v = v[np.isfinite(v)]
            size, low = np.abs(v) if name in SIGNED else v, name == "within_band_percent"
            if v.size:
                worst, tail = (size.min(), np.quantile(v, 0.1)) if low else (size.max(), np.quantile(size, 0.9))
                lines[words][title] = f"{np.median(v):.1f}, {tail:.1f}, {worst:.1f} ({v.size})"
    return lines


def figure(rows: list[Row], path: Path) -> None:
    """Draw every seed as a dot and medians as bars, metric by metric."""
    from pliant.plotting import new_figure, save_figure, style

    with style():
        drawn, panels = new_figure(2, 4, height=4.0)
        for panel, (name, words) in zip(panels.flat, METRICS.items(), strict=False):
            for k, case in enumerate(CASES):
                v = np.sort([row[f"{case}_{name}"] for row in rows if np.isfinite(row[f"{case}_{name}"])])
                panel.plot(k + 0.28 * np.linspace(-1, 1, v.size), v, "o", ms=2.5, mfc="none", mec="0.35", mew=0.6)
                panel.plot([k - 0.38, k + 0.38], [np.median(v)] * 2, "k-", lw=1.8)
            panel.set(title=words.rpartition(", ")[0], ylabel=words.rpartition(", ")[2], xticks=range(len(CASES)),
                      xticklabels=["0.66", "1.3", "2"], xlabel="x training maximum")
        for panel in panels.flat[len(METRICS) :]:
            panel.set_axis_off()
        save_figure(drawn, path)


def main() -> None:
    """Compute missing seeds, then print the table, and draw the figure."""
    given = parser_of(__doc__, seeds=40, first=0, figure=Path).parse_args()
    kept: dict[str, Row] = json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.exists() else {}
    names = [str(seed) for seed in range(given.first, given.first + given.seeds)]
    for name in names:
        if name not in kept:
            kept[name] = row_of(int(name))
            KEPT.parent.mkdir(exist_ok=True)
            KEPT.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
            print(name, kept[name]["terms"], kept[name]["message"], flush=True)
    rows = [kept[name] for name in names]
    print(table(summary(rows)))
    if given.figure:
        figure(rows, given.figure)


if __name__ == "__main__":
    main()
