"""Choose the terms of models from training recordings, and print their errors on recordings not used in the choice.

    python benchmarks/selection.py bodies [names]  # virtual actuators, default a b c 901 902 903 904
    python benchmarks/selection.py spatial [STUDY [names]]  # the fabric arm in space, each recording left out

Virtual actuators are trained on pulses of 60 and 180 kPa, and predict the pulse of 119 kPa and the step to 240 kPa.
STUDY is a copy of examples/spatial_pneumatic_arm.toml beside its recordings, which the file says where to find; each
choice has five minutes.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from pliant.recording.netcdf import write_netcdf
from pliant.study import Study, demo_study, load_study, run_study
from pliant.study.schema import SelectionEntry
from pliant.testbed import family_member, generate
from pliant.validation.outcome import StudyOutcome
from pliant.validation.wording import sized

SPATIAL = Path(__file__).parents[1] / "examples" / "spatial_pneumatic_arm.toml"


def chosen(study: Study) -> StudyOutcome:
    """Return the results of a study in which only a model selection and the linear fit are left."""
    entry = SelectionEntry.model_validate({
        "train": ["pulse_60", "pulse_180"], "held_out": ["pulse_119", "step_240"], "minutes": 30})
    fits = {"linear": study.fits["linear"]}
    return run_study(study.model_copy(update={"model_selection": entry, "forecasts": {}, "wiring": None, "fits": fits}))


def virtual(name: str, folder: Path) -> Study:
    """Return the demo's study with new recordings of another virtual actuator."""
    study, recordings, changes = load_study(demo_study()), {}, dict[str, Any]()
    who = family_member(int(name)) if name.isdigit() else name
    for record, entry in study.recordings.items():
        write_netcdf(generate(record, who, seed=1).recording, folder / f"{record}.nc")
        recordings[record] = entry.model_copy(update={"file": f"{record}.nc"})
    if not isinstance(who, str):
        known = who.known()
        changes["actuator"] = study.actuator.model_copy(update={
            "length": known["body_length"], "mass": known["body_mass"], "tip_mass": known["tip_mass"]})
        changes["fibre"] = study.fibre.model_copy(update={
            "body_length": known["body_length"], "cap_curvature": who.body.cap_curvature,
            "cap_length": who.body.cap_length, "gauge_length": known["gauge_length"]})
    return study.model_copy(update={"folder": str(folder), "recordings": recordings, **changes})


def show(name: str, outcome: StudyOutcome, began: float) -> None:
    """Print the chosen terms, and the errors of every fit on the held-out recordings."""
    assert outcome.model_selection is not None
    print(f"{name}: {', '.join(outcome.model_selection.terms) or 'no term'}; {time.process_time() - began:.0f} s CPU")
    for fit in outcome.fits:
        for r in (r for r in fit.records if r.role == "held_out"):
            m = r.metrics
            band = f", {m['within_band_percent']:.0f} % within its band" if r.band is not None else ""
            print(f"  {fit.title[:40]:40} {r.name:10} {m['rmse_percent_of_travel']:6.2f} % of the peak displacement, "
                  f"{m['rmse_percent_of_length']:5.2f} % of length{band}", flush=True)


def spatial(file: str | Path = SPATIAL, *names: str) -> None:
    """Choose the model of the fabric arm without each recording, and print its error there beside the plain map's."""
    study = load_study(file)
    assert study.model_selection is not None
    for held_out in names or tuple(study.recordings):
        began, train = time.monotonic(), [name for name in study.recordings if name != held_out]
        entry = study.model_selection.model_copy(update={"train": train, "held_out": [held_out]})
        outcome = run_study(study.model_copy(update={"model_selection": entry, "fits": {}}))
        assert outcome.model_selection is not None
        (fit,) = outcome.fits
        assert fit.baseline is not None
        (record,) = [r for r in fit.records if r.role == "held_out"]
        plain = fit.baseline.records[held_out]
        print(f"| {held_out} | {sized(record.metrics, 'rmse')[0]:.2f} | {sized(plain, 'rmse')[0]:.2f} | "
              f"{', '.join(outcome.model_selection.terms) or 'no term'} | {time.monotonic() - began:.0f} |", flush=True)


def main(what: str, names: list[str]) -> None:
    """Choose models for the virtual actuators, or for the fabric arm."""
    if what == "spatial":
        spatial(*names)
    for name in names or ["a", "b", "c", "901", "902", "903", "904"] if what == "bodies" else ():
        began = time.process_time()
        with tempfile.TemporaryDirectory() as folder:
            show(name, chosen(virtual(name, Path(folder))), began)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "bodies", sys.argv[2:])
