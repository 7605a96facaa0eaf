"""The inputs of a drafted study: chambers and tendons of a body in space, and the channels that drive them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pliant.recording.inputs import recorded_inputs
from pliant.study.new import FirstLook, azimuths, body_length, tendon_ends
from pliant.study.toml_text import Lines

LINKS = 5
EITHER_WAY = 0.1  # of the largest value: an input that goes so far below 0 too


def chambers(out: Lines, look: FirstLook) -> None:
    """The chambers of a body in space, each at the azimuth that the recording shows."""
    if not look.chambers or look.aligned is None:
        return
    for name, azimuth in zip(look.chambers, azimuths(look.aligned), strict=True):
        out.text += ["", "[[actuator.chambers]]"]
        out.put("name", name)
        out.put("torque", [1e-6], "N m/Pa, scaled by the gains that are fitted")
        out.put("azimuth_deg", round(azimuth), "from x towards y of the base frame, as the last station moves")


def tendons(out: Lines, look: FirstLook) -> None:
    """The tendons of a body in space, each where the recording shows that it pulls."""
    if not look.cords or look.aligned is None:
        return
    names, first = [one.name for one in recorded_inputs(look.recording)], look.cords[0]
    for name, (azimuth, end) in zip(names, tendon_ends(look.aligned), strict=True):
        if name not in [one.name for one in look.cords]:
            continue
        one = look.cords[[cord.name for cord in look.cords].index(name)]
        out.text += ["", "[[actuator.tendons]]"]
        out.put("name", name)
        out.put("driven_by", one.kind, "as the mapping says")
        out.put("azimuth_deg", round(azimuth), "from x towards y of the base frame, as the stations move")
        passed = joints_up_to(look, end)
        if len(passed) < LINKS:
            out.put("joints", passed, f"that it passes: it bends the body up to {1e3 * end:.0f} mm")
        out.ask("lever", "m, distance of the tendons from the axis")
        if one.kind == "angle":
            out.ask("pulley", "m, radius of the motors' pulleys")
            both = one.values[np.isfinite(one.values)]
            if both.min(initial=0.0) < -EITHER_WAY * both.max(initial=0.0):
                out.put("pair", True,
                        "its motor turns either way: two opposite tendons; false for one that can hang slack")
        if one is first and one.kind != "tension":
            out.say("line_stiffness = 1000  (N/m, with all that holds it: only its ratio to the body's shows)")


def joints_up_to(look: FirstLook, end: float) -> list[int]:
    """Joints, from 1, in the middle of `LINKS` equal segments, as far as `end` [m] from the base."""
    length = body_length(look) or end
    return [k + 1 for k in range(LINKS) if (k + 0.5) * length / LINKS < 1.05 * end]


def chamber_parameters(names: Sequence[str]) -> list[tuple[str, str]]:
    """Gains of each input about both axes: size and direction of its torque."""
    return [(f"{name}.gain_{axis}", f"of the torque of {name} about {axis}") for name in names for axis in "xy"]


def channels(out: Lines, look: FirstLook) -> None:
    """Which channel of a recording drives which input, whether it was measured, and how it was logged."""
    if driving := [*look.chambers, *(one.name for one in look.cords)]:
        out.put("drive", {name: name for name in driving}, "input of the model = channel of the recording")
    if look.cords:
        out.put("signal", "measured", 'or "commanded": a set point, which the motor follows with a lag')
    if look.found.input_held:
        out.put("staircase", "lines", "inputs are held between updates: straight lines between their changes")
