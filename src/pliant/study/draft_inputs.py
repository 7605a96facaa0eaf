"""Tables of a generated study file for its inputs: chambers, tendons and the channels that drive them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pliant.recording.inputs import RecordedInput
from pliant.study.first_reading import several
from pliant.study.new import FirstLook, azimuths, body_length, chamber_span, tendon_ends
from pliant.study.toml_text import Lines

LINKS = 5
EITHER_WAY = 0.1  # an input that falls below minus this fraction of its maximum has both signs


def placed(looks: Sequence[FirstLook]) -> FirstLook:
    """Return the first recording that could be aligned in the base frame, or the first of all if none could."""
    return next((look for look in looks if look.aligned is not None), looks[0])


def driven(looks: Sequence[FirstLook]) -> list[str]:
    """Return the names of the chambers in recordings with several chambers, without duplicates."""
    return list(dict.fromkeys(name for look in looks for name in look.chambers))


def chambers_in_plane(out: Lines, looks: Sequence[FirstLook]) -> None:
    """Write the chambers of a body in a plane, with the side and joints that each bends.

    Each chamber is judged by the recording in which its pressure varies most, compared with the other pressures.
    """
    for name in driven(looks):
        look = max((one for one in looks if name in one.chambers), key=lambda one: alone(one, name))
        out.text += ["", "[[actuator.chambers]]"]
        out.put("name", name)
        if look.aligned is None or look.turns:
            out.say("joints = [1, 2]  (the joints that it bends; default: all)",
                    "gain = -1.0  (for a chamber on the other side)")
            continue
        side, begin, end = chamber_span(look.aligned, name)
        shown, part = f"as the stations of {look.path.name} move", f"from {1e3 * begin:.0f} to {1e3 * end:.0f} mm"
        passed = [k for k in joints_up_to(end, body_length(look)) if k not in joints_up_to(begin, body_length(look))]
        if look.dense:
            out.say(f"joints = [...]  (the joints {part}, {shown}; default: all)")
        elif len(passed) < LINKS:
            out.put("joints", passed, f"the joints that it bends: the body bends {part}, {shown}")
        if side < 0:
            out.put("gain", -1.0, f"it bends the body to the other side, {shown}")


def alone(look: FirstLook, name: str) -> float:
    """Return the range of one pressure divided by the sum of all pressure ranges; 1 if no other pressure varies."""
    return look.pressure_ranges[name] / sum(look.pressure_ranges.values())


def chambers(out: Lines, look: FirstLook) -> None:
    """Write the chambers of a body in space, each with the azimuth that the recording shows."""
    if not look.chambers:
        return
    shown = [] if look.aligned is None else azimuths(look.aligned)
    for k, name in enumerate(look.chambers):  # pressures come before other inputs
        out.text += ["", "[[actuator.chambers]]"]
        out.put("name", name)
        out.put("torque", [1e-6], "N m/Pa, multiplied by the fitted gains")
        azimuth_of(out, round(shown[k]) if shown else None, "as the last station moves")


def tendons(out: Lines, look: FirstLook) -> None:
    """Write the tendons of a body in space, with the azimuth and the joints that the recording shows for each."""
    if not look.cords:
        return
    shown = [] if look.aligned is None else tendon_ends(look.aligned)[-len(look.cords) :]
    for k, one in enumerate(look.cords):
        out.text += ["", "[[actuator.tendons]]"]
        out.put("name", one.name)
        out.put("driven_by", one.kind, "as the mapping states")
        azimuth_of(out, round(shown[k][0]) if shown else None, "as the stations move")
        if shown and len(passed := joints_up_to(shown[k][1], body_length(look))) < LINKS:
            out.put("joints", passed, f"the joints that it passes: it bends the body up to {1e3 * shown[k][1]:.0f} mm")
        out.ask("lever", "m, distance of the tendons from the axis")
        if one.kind == "angle":
            out.ask("pulley", "m, radius of the motors' pulleys")
            either_way(out, one)
        if not k and one.kind != "tension":
            out.say("line_stiffness = 1000  (N/m, with its mounts: only its ratio to the body's is determined)")


def azimuth_of(out: Lines, azimuth: int | None, source: str) -> None:
    """Write the azimuth [degrees] of an input, or an open question if it is None."""
    out.ask("azimuth_deg", "degrees around the axis; `pliant new` estimates it from a recording that begins at rest",
            azimuth, f"from x towards y of the base frame, {source}")


def either_way(out: Lines, one: RecordedInput) -> None:
    """Write `pair = true` if the input of a tendon takes both signs: its motor pulls two opposite tendons."""
    seen = one.values[np.isfinite(one.values)]
    if seen.min(initial=0.0) < -EITHER_WAY * seen.max(initial=0.0):
        out.put("pair", True, "its motor turns both ways: two opposite tendons; false for one that can be slack")


def joints_up_to(end: float, length: float | None) -> list[int]:
    """Return the numbers, from 1, of the joints up to `end` [m], each in the middle of one of 5 equal segments.

    The segments divide `length` [m], or `end` if the length is None. A margin of 5 % is added to `end`.
    """
    return [k + 1 for k in range(LINKS) if (k + 0.5) * (length or end) / LINKS < 1.05 * end]


def chamber_parameters(names: Sequence[str], *, space: bool) -> list[tuple[str, str]]:
    """Return (name, comment) of the torque parameters of each input: gains about x and y in space, torque_1
    in a plane.
    """
    if not space:
        return [(f"{name}.torque_1", "N m/Pa") for name in names]
    return [(f"{name}.gain_{axis}", f"of the torque of {name} about {axis}") for name in names for axis in "xy"]


def channels(out: Lines, look: FirstLook, names: Sequence[str]) -> None:
    """Write which channel of a recording drives which input, and whether it was measured and held between updates."""
    recorded = several(look.recording)
    if driving := [*(name for name in names if name in recorded), *(one.name for one in look.cords)]:
        out.put("drive", {name: name for name in driving}, "input of the model = channel of the recording")
    if look.cords:
        out.put("signal", "measured", 'or "commanded" for a set point, which the motor follows with a lag')
    if look.found.input_held:
        out.put("staircase", "lines", "the log holds inputs between updates; the model joins the changes by lines")
