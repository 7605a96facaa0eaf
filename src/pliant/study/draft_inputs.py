"""The inputs of a drafted study: chambers and tendons, and the channels that drive them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pliant.recording.inputs import RecordedInput
from pliant.study.first_reading import several
from pliant.study.new import FirstLook, azimuths, body_length, chamber_span, tendon_ends
from pliant.study.toml_text import Lines

LINKS = 5
EITHER_WAY = 0.1  # of the largest value: an input that goes so far below 0 too


def placed(looks: Sequence[FirstLook]) -> FirstLook:
    """The first look whose recording could be brought into the base frame; the first of all where none could."""
    return next((look for look in looks if look.aligned is not None), looks[0])


def driven(looks: Sequence[FirstLook]) -> list[str]:
    """Names of the chambers that a recording of several drives."""
    return list(dict.fromkeys(name for look in looks for name in look.chambers))


def chambers_in_plane(out: Lines, looks: Sequence[FirstLook]) -> None:
    """Several chambers of a body in a plane: the side and the joints that each bends, where it moves most alone."""
    for name in driven(looks):
        look = max((one for one in looks if name in one.chambers), key=lambda one: alone(one, name))
        out.text += ["", "[[actuator.chambers]]"]
        out.put("name", name)
        if look.aligned is None or look.turns:
            out.say("joints = [1, 2]  (those that it turns; default: all)", "gain = -1.0  (of one on the other side)")
            continue
        side, begin, end = chamber_span(look.aligned, name)
        shown, part = f"as the stations of {look.path.name} move", f"from {1e3 * begin:.0f} to {1e3 * end:.0f} mm"
        passed = [k for k in joints_up_to(end, body_length(look)) if k not in joints_up_to(begin, body_length(look))]
        if look.dense:
            out.say(f"joints = [...]  (those {part}, {shown}; default: all)")
        elif len(passed) < LINKS:
            out.put("joints", passed, f"that it turns: the body bends {part}, {shown}")
        if side < 0:
            out.put("gain", -1.0, f"it bends the body to the other side, {shown}")


def alone(look: FirstLook, name: str) -> float:
    """Range of a pressure over that of all, 1 where it is the only one that moves."""
    return look.pressure_ranges[name] / sum(look.pressure_ranges.values())


def chambers(out: Lines, look: FirstLook) -> None:
    """The chambers of a body in space, each at the azimuth that the recording shows."""
    if not look.chambers:
        return
    shown = [] if look.aligned is None else azimuths(look.aligned)
    for k, name in enumerate(look.chambers):  # pressures come before other inputs
        out.text += ["", "[[actuator.chambers]]"]
        out.put("name", name)
        out.put("torque", [1e-6], "N m/Pa, scaled by the gains that are fitted")
        azimuth_of(out, round(shown[k]) if shown else None, "as the last station moves")


def tendons(out: Lines, look: FirstLook) -> None:
    """The tendons of a body in space, each where the recording shows that it pulls."""
    if not look.cords:
        return
    shown = [] if look.aligned is None else tendon_ends(look.aligned)[-len(look.cords) :]
    for k, one in enumerate(look.cords):
        out.text += ["", "[[actuator.tendons]]"]
        out.put("name", one.name)
        out.put("driven_by", one.kind, "as the mapping says")
        azimuth_of(out, round(shown[k][0]) if shown else None, "as the stations move")
        if shown and len(passed := joints_up_to(shown[k][1], body_length(look))) < LINKS:
            out.put("joints", passed, f"that it passes: it bends the body up to {1e3 * shown[k][1]:.0f} mm")
        out.ask("lever", "m, distance of the tendons from the axis")
        if one.kind == "angle":
            out.ask("pulley", "m, radius of the motors' pulleys")
            either_way(out, one)
        if not k and one.kind != "tension":
            out.say("line_stiffness = 1000  (N/m, with all that holds it: only its ratio to the body's shows)")


def azimuth_of(out: Lines, azimuth: int | None, source: str) -> None:
    """The azimuth of an input, asked for where the recordings could not be brought into the base frame."""
    out.ask("azimuth_deg", "degrees around the axis; with a recording that begins at rest `pliant new` finds it",
            azimuth, f"from x towards y of the base frame, {source}")


def either_way(out: Lines, one: RecordedInput) -> None:
    """Whether a motor pulls two opposite tendons."""
    seen = one.values[np.isfinite(one.values)]
    if seen.min(initial=0.0) < -EITHER_WAY * seen.max(initial=0.0):
        out.put("pair", True, "its motor turns either way: two opposite tendons; false for one that can hang slack")


def joints_up_to(end: float, length: float | None) -> list[int]:
    """Joints, from 1, in the middle of `LINKS` equal segments of a length, as far as `end` [m] from the base."""
    return [k + 1 for k in range(LINKS) if (k + 0.5) * (length or end) / LINKS < 1.05 * end]


def chamber_parameters(names: Sequence[str], *, space: bool) -> list[tuple[str, str]]:
    """Gains of each input about both axes: size and direction of its torque; in a plane its law."""
    if not space:
        return [(f"{name}.torque_1", "N m/Pa") for name in names]
    return [(f"{name}.gain_{axis}", f"of the torque of {name} about {axis}") for name in names for axis in "xy"]


def channels(out: Lines, look: FirstLook, names: Sequence[str]) -> None:
    """Which channel of a recording drives which input, whether it was measured, and how it was logged."""
    recorded = several(look.recording)
    if driving := [*(name for name in names if name in recorded), *(one.name for one in look.cords)]:
        out.put("drive", {name: name for name in driving}, "input of the model = channel of the recording")
    if look.cords:
        out.put("signal", "measured", 'or "commanded": a set point, which the motor follows with a lag')
    if look.found.input_held:
        out.put("staircase", "lines", "inputs are held between updates: straight lines between their changes")
