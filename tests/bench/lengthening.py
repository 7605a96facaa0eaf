"""Compare the parameters of a fitted chain that lengthens with those of the virtual rod, and test its predictions.

Motion capture records the body `lengthening` with noise and lost markers, and pressure sensors record both chambers:
pulses of 50 and 120 kPa in one chamber, then in the other, and one of 60 kPa in both. The three markers of the base,
whose positions on the base are known, define the frame. A chain of six links with one axial strain is trained on these
recordings, with marker positions from the first frames, and predicts pulses in both chambers. The fitted parameters are
compared with the true values of the rod, which shares no code with the chain.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.spatial.transform import Rotation

from pliant.identification import Experiment, FitResult, fit, predict_held_out
from pliant.model import Model
from pliant.recording import make_recording
from pliant.recording.netcdf import write_netcdf
from pliant.study.run import prepare_all
from pliant.study.schema import Study
from pliant.testbed import Laboratory, generate
from pliant.testbed.laboratory import BASE
from pliant.testbed.rod import CHAMBERS, RodParameters, actuator, build_body

LINKS = 6
TRAIN = {"left_50": "pulse_50+0_1500ms", "left_120": "pulse_120+0_1500ms", "right_50": "pulse_0+50_1500ms",
         "right_120": "pulse_0+120_1500ms", "both_60": "pulse_60+60_1500ms"}  # fmt: skip
HELD_OUT = {"both_100": "pulse_100+100_1500ms", "uneven": "pulse_130+60_1500ms", "overlapping": "overlapping"}
RUBBER = ("stiffness", "damping", "stiffening", "axial_stiffness", "axial_damping")


def planar(recording: xr.Dataset) -> xr.Dataset:
    """Return the recording in the frame of its base, whose mean marker positions are fitted to the known ones (Kabsch).
    """
    position, known = recording["position"].values, np.array(BASE)
    seen = np.nanmean(position[:, : len(BASE)], axis=0)
    turn, _ = Rotation.align_vectors(known - known.mean(axis=0), seen - seen.mean(axis=0))
    placed = turn.apply((position - seen.mean(axis=0)).reshape(-1, 3)).reshape(position.shape) + known.mean(axis=0)
    return make_recording(
        recording["time"].values, placed[:, len(BASE) :, :2], frame="planar",
        station=recording["station"].values[len(BASE) :].tolist(), pressure=recording["pressure"].values,
        pressure_time=recording["pressure_time"].values, chamber=recording["chamber"].values.tolist(),
        source=recording.attrs["source"],
    )


def recorded(seed: int, names: Iterable[str], rod: RodParameters | None = None) -> tuple[dict[str, Experiment], Model]:
    """Return the recordings of the body, and the chain with estimated parameters."""
    rod = rod or actuator("lengthening")
    cases, chambers = {**TRAIN, **HELD_OUT}, [c.name for c in CHAMBERS["lengthening"]]
    with tempfile.TemporaryDirectory() as folder:
        recordings = {}
        for name in names:
            made = generate(cases[name], replace(rod, gravity=(0.0, 0.0)), seed, lab=Laboratory(output="markers"))
            write_netcdf(planar(made.recording), Path(folder) / f"{name}.nc")
            recordings[name] = {"file": f"{name}.nc", "drive": {c: c for c in chambers}, "own_places": True}
        joints = list(range(1, LINKS + 1))
        study = Study.model_validate({
            "name": "lengthening", "folder": folder, "fits": {}, "recordings": recordings,
            "actuator": {
                "length": rod.length, "mass": rod.mass, "tip_mass": rod.cap_mass, "links": LINKS,
                "joint_placement": "midsegment", "extensions": [{"stiffness": 400.0, "damping": 1.0}],
                "chambers": [{"name": name, "joints": joints, "joint_gain": sign}
                             for name, sign in zip(chambers, (1.0, -1.0), strict=True)],
            },
        })  # fmt: skip
        ready = prepare_all(study, lambda _line: None)
        return ready.experiments, ready.model


def taught(train: Iterable[Experiment], model: Model, more: Iterable[str] = ()) -> FitResult:
    """Fit the chain to some recordings: one law, one axial gain and one pair of edges for each chamber."""
    own = [f"{c.name}.{name}" for c in model.chambers for name in ("torque_1", "axial_gain", "valve_rise_time")]
    return fit(list(train), model, [*RUBBER, *own, "base_angle", *more], starts=1)


def truth(rod: RodParameters) -> dict[str, float]:
    """Return the rod's true values: EA, its viscosity, and thrust over moment per pressure of each chamber."""
    body = build_body(rod)
    found = {"axial_stiffness": rod.axial_stiffness, "axial_damping": rod.loss_time * rod.axial_stiffness}
    lever = np.abs(body.gain @ body.weight) / rod.length
    return found | {f"{c.name}.axial_gain": c.push * rod.chamber_area / g
                    for c, g in zip(rod.chambers, lever, strict=True)}  # fmt: skip


def missed(exp: Experiment, fitted: FitResult) -> tuple[float, float, float]:
    """Return the RMS error of all markers in % of the peak displacement, and the modelled and measured extension, mm.
    """
    made = predict_held_out(exp, fitted)[0]["position"]
    error = 100.0 * float(np.sqrt(np.nanmean(np.sum((made - exp.position) ** 2, axis=-1)))) / exp.travel
    far = [np.linalg.norm(rows[:, -1], axis=-1) for rows in (made, exp.position)]
    return error, *(1e3 * float(np.nanmax(f) - np.nanmedian(f[:5])) for f in far)
