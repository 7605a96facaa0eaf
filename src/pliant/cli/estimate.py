"""`pliant estimate`: estimate joint angles, rates and unknown torques of a recording, with their uncertainty."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pliant.cli.reading import (
    DRIVE,
    LEVELS,
    MAPPING,
    BaseCutoff,
    BaseFile,
    BaseMapping,
    base_motion,
    drives,
    levels,
    read_in_base_frame,
)
from pliant.cli.terminal import in_unit

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

    from pliant.simulation.inputs import Input

MEANING = {
    "frames_skipped": "frames without any station of the model", "frames_in_part": "frames with some stations missing",
    "orientations_flipped": "orientations more than 90 degrees from the estimate, as of flipped markers; not used",
    "normalised_innovation": "squared innovations divided by their predicted variance; 1 if the assumed noise is right",
    "normalised_innovation_95_low": "lower end of the 95 % range of this ratio if the noise is right",
    "normalised_innovation_95_high": "upper end of that range",
    "innovation_correlation": "correlation from frame to frame; 0 if the model's errors are random",
    "largest_rate_rad_s": "largest rate of a joint, smoothed",
    "typical_rate_sd_rad_s": "standard deviation of a joint rate, median",
    "largest_disturbance_mn_m": "largest joint torque that the model does not explain",
    "typical_disturbance_sd_mn_m": "its standard deviation, median",
    "largest_axial_strain_percent": "largest strain of an extensible segment, smoothed",
    "typical_axial_strain_sd_percent": "standard deviation of a strain, median",
    "largest_axial_disturbance_n": "largest axial force on a segment that the model does not explain",
}


def estimate(
    recording: Annotated[Path, typer.Argument(help="Aligned recording.")],
    model: Annotated[Path, typer.Option("--model", help="Model file, or results folder of `pliant run`.")],
    disturbance: Annotated[bool, typer.Option(help="Also estimate an unknown torque on each joint.")] = True,
    level: Annotated[
        str | None, typer.Option(help=f"Commanded pulse, {LEVELS}. Default: the measured inputs.")
    ] = None,
    start: Annotated[float, typer.Option(parser=in_unit("s"), help="Start of that pulse, s.")] = 0.12,
    width: Annotated[float, typer.Option(parser=in_unit("s"), help="Width of that pulse, s.")] = 2.76,
    drive: Annotated[str, typer.Option(help=DRIVE)] = "",
    mapping: Annotated[list[str] | None, typer.Option(metavar="<path>", help=MAPPING)] = None,
    latency_ms: Annotated[float, typer.Option("--latency-ms", parser=in_unit("ms"),
                                              help="Delay of the shape's time stamps, ms.")] = 0.0,
    lag: Annotated[int, typer.Option(help="Lag of the smoother, frames.")] = 10,
    base: BaseFile = None,
    base_mapping: BaseMapping = None,
    base_cutoff_hz: BaseCutoff = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="States and their covariances (.nc).")] = None,
    figure: Annotated[Path | None, typer.Option(help="Figure of angles, rates and innovations.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Estimate joint angles and rates with an extended Kalman filter and a smoother, on a base that rests or moves. On
    a moving base, the recording is in the axes of the moved base.

    Example: pliant estimate arm.nc --model results/arm/model.json --latency-ms 4 -o states.nc --figure states.png
    """
    from pliant.cli.output import print_numbers, save_trajectory, write_figure
    from pliant.cli.terminal import busy
    from pliant.estimation import estimate as filter_recording
    from pliant.model import load_model
    from pliant.simulation import Pulse

    recorded, body = read_in_base_frame(recording, mapping), load_model(model)
    pressure: list[Input] | None = None
    if level is not None:
        pressure = [Pulse(high, start, width) for high in levels(body, level)]
    motion = base_motion(base, body, base_mapping, base_cutoff_hz)
    with busy("estimating"):
        estimated = filter_recording(
            recorded, body, pressure=pressure, disturbance=disturbance, latency=latency_ms * 1e-3, lag=lag,
            drive=drives(drive), base=motion,
        )
    if output is not None:
        save_trajectory(estimated, output)
    if figure is not None:
        from pliant.validation.use_figures import estimate_overview

        write_figure(estimate_overview(estimated), figure)
    print_numbers(report(estimated), as_json=json, title=str(recording), meaning=MEANING)


def of_joints(estimated: xr.Dataset, name: str, end: str = "") -> np.ndarray:
    """Return one variable of an estimate, such as the joint rates, as an array (T, N) of all N joints over T frames.

    In space, N counts all joints about one axis, then all joints about the next.
    """
    import numpy as np

    from pliant.simulation.result import ENDINGS

    parts = [estimated[f"{name}{axis}{end}"] for axis in ENDINGS if f"{name}{axis}{end}" in estimated]
    return np.concatenate([part.values for part in parts], axis=1) if parts else np.zeros((estimated.sizes["time"], 0))


def report(estimated: xr.Dataset) -> dict[str, float | int | str]:
    """Return a dict that summarises an estimate: the number of frames, whether the innovations are as large and as
    white as the filter assumes, the largest joint rates [rad/s] and the largest disturbance torques [mN m].
    """
    import numpy as np

    a = estimated.attrs
    low, high = a["nis_bounds"]
    ratio, correlation, bound = a["nis_ratio"], a["innovation_correlation"], a["innovation_correlation_bound"]
    consistent = "as large as predicted"
    if not low <= ratio <= high:
        said, noise = ("larger", "low") if ratio > high else ("smaller", "high")
        consistent = f"{said} than predicted (assumed noise too {noise})"
    white = "white" if abs(correlation) <= bound else "not white: the model's errors are correlated from frame to frame"
    numbers: dict[str, float | int | str] = {
        "frames": a["frames"], "frames_skipped": a["frames_skipped"], "frames_in_part": a["frames_in_part"],
        "normalised_innovation": ratio, "normalised_innovation_95_low": low, "normalised_innovation_95_high": high,
        "innovation_correlation": correlation, "innovations_are": f"{consistent}; {white}",
        "largest_rate_rad_s": float(np.abs(of_joints(estimated, "smooth_joint_rate")).max()),
        "typical_rate_sd_rad_s": float(np.median(of_joints(estimated, "joint_rate", "_sd"))),
    }
    if a["orientations_flipped"]:
        numbers["orientations_flipped"] = a["orientations_flipped"]
    if (torque := of_joints(estimated, "disturbance")).size:
        numbers["largest_disturbance_mn_m"] = 1e3 * float(np.abs(torque).max())
        numbers["typical_disturbance_sd_mn_m"] = 1e3 * float(np.median(of_joints(estimated, "disturbance", "_sd")))
    if "axial_strain" in estimated:
        numbers["largest_axial_strain_percent"] = 100.0 * float(abs(estimated["smooth_axial_strain"]).max())
        numbers["typical_axial_strain_sd_percent"] = 100.0 * float(estimated["axial_strain_sd"].median())
    if "axial_disturbance" in estimated:
        numbers["largest_axial_disturbance_n"] = float(abs(estimated["axial_disturbance"]).max())
    return numbers
