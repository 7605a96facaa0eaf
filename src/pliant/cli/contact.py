"""`pliant contact`: find when and where something touched the body, and with what force."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pliant.cli.reading import DRIVE, MAPPING, drives, read_in_base_frame
from pliant.cli.terminal import in_unit

if TYPE_CHECKING:
    import xarray as xr

MEANING = {
    "highest_statistic": "likelihood ratio divided by its threshold; above 1 is a contact",
    "first_onset_s": "estimated start of the force", "first_alarm_s": "time at which the contact was detected",
    "place_mm": "along the body from its base, median during contact",
    "place_95_width_mm": "width of its 95 % interval, median", "normal_force_n": "across the body, median",
    "normal_force_sd_n": "its standard deviation, median", "tangential_force_n": "along the body, median",
    "tangential_hidden_share": "fraction of the tangential force that no joint torque shows; 1: not seen at all",
}


def contact(
    recordings: Annotated[list[Path], typer.Argument(help="Aligned recordings to search; all go into one map.")],
    model: Annotated[Path, typer.Option("--model", help="Model file, or results folder of `pliant run`.")],
    free: Annotated[
        list[Path], typer.Option("--free", metavar="<path>", help="Recording without contact; repeat for several.")
    ],
    false_alarms_per_hour: Annotated[
        float, typer.Option("--false-alarms-per-hour", parser=in_unit("1/h"),
                            help="False alarms that the threshold allows per hour.")
    ] = 1.0,
    drive: Annotated[str, typer.Option(help=DRIVE)] = "",
    mapping: Annotated[list[str] | None, typer.Option(metavar="<path>", help=MAPPING)] = None,
    latency_ms: Annotated[float, typer.Option("--latency-ms", parser=in_unit("ms"),
                                              help="Delay of the shape's time stamps, ms.")] = 0.0,
    half_width_mm: Annotated[float, typer.Option("--half-width-mm", parser=in_unit("mm"),
                                                 help="Distance of the body's surface from its centreline, mm.")] = 0.0,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Contacts of the first file (.nc).")] = None,
    figure: Annotated[Path | None, typer.Option(help="Figure of test statistic, position and force.")] = None,
    chart: Annotated[Path | None, typer.Option("--map", help="Map of all contacts (.nc, .csv or .png).")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Find contacts in recordings; the detection threshold is estimated from recordings without contact.

    Example: pliant contact poke.nc --model model.json --free pulse_60.nc --free pulse_180.nc --figure poke.png
    """
    from pliant.cli.output import print_numbers, save_trajectory, write_figure
    from pliant.cli.terminal import busy
    from pliant.contact import find_contact, free_motion, map_contacts
    from pliant.estimation.noise import default_noise
    from pliant.model import load_model

    loaded, options = load_model(model), dict[str, Any](latency=latency_ms * 1e-3, drive=drives(drive))
    quiet, touched = ([read_in_base_frame(f, mapping) for f in files] for files in (free, recordings))
    options["noise"] = default_noise(loaded, recordings=quiet)  # one for all, since thresholds depend on it
    with busy("finding contact"):
        learnt = free_motion(quiet, loaded, false_alarms_per_hour=false_alarms_per_hour, **options)
        results = [find_contact(recording, loaded, free=learnt, **options) for recording in touched]
    if output is not None:
        save_trajectory(results[0], output)
    if figure is not None:
        from pliant.validation.use_figures import contact_overview

        write_figure(contact_overview(results[0]), figure)
    if chart is not None:
        from pliant.contact.occupancy_map import save_map

        save_map(map_contacts(results, half_width=half_width_mm * 1e-3), chart)
    for path, result in zip(recordings, results, strict=True):
        numbers = report(result) if not json else {"recording": str(path), **report(result)}
        print_numbers(numbers, as_json=json, title=str(path), meaning=MEANING)


def report(result: xr.Dataset) -> dict[str, float | int | str]:
    """Return a dict that summarises the detected contacts: their number, time of onset [s], position [mm] and force
    [N].
    """
    a = result.attrs
    said = "extrapolated beyond it" if a["threshold_extrapolated"] else "within it"
    numbers: dict[str, float | int | str] = {
        "contacts": len(a["alarm_s"]), "frames_in_contact": int(result["in_contact"].sum()),
        "highest_statistic": float(result["statistic"].max()) / a["threshold"],
        "threshold_from": f"{a['free_motion_s']:.3g} s of free motion, {a['false_alarms_per_hour']:g} alarm/h {said}",
    }
    if not a["alarm_s"]:
        return numbers
    touching = result.where(result["in_contact"], drop=True)
    hidden = float(result["hidden_tangential"].values[result["in_contact"].values].mean())
    return numbers | {
        "first_onset_s": a["onset_s"][0], "first_alarm_s": a["alarm_s"][0],
        "place_mm": 1e3 * float(touching["contact_arc_length"].median()),
        "place_95_width_mm": 1e3 * float((touching["arc_high"] - touching["arc_low"]).median()),
        "normal_force_n": float(touching["normal_force"].median()),
        "normal_force_sd_n": float(touching["normal_force_sd"].median()),
        "tangential_force_n": float(touching["tangential_force"].median()),
        "tangential_hidden_share": hidden,
    }
