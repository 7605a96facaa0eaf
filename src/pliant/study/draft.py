"""The text of a first study: every entry with its unit and its reason, open questions marked."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict, Unpack

import numpy as np

from pliant.errors import InputError
from pliant.options import with_defaults
from pliant.preprocessing.alignment import alignment_of
from pliant.preprocessing.plausibility import Case
from pliant.preprocessing.plausibility.together import beside
from pliant.preprocessing.quality import standing_stations
from pliant.study.doubts import of_body
from pliant.study.draft_inputs import (
    LINKS,
    chamber_parameters,
    chambers,
    chambers_in_plane,
    channels,
    driven,
    placed,
    tendons,
)
from pliant.study.first_reading import with_logs
from pliant.study.new import (
    FirstLook,
    body_length,
    excitation,
    from_one_side,
    held_out,
    in_space,
    look_with_log,
    moved,
)
from pliant.study.toml_text import Lines, key, relative

NEARLY_PLANAR = 0.1  # of the motion, out of its best plane: more is worth a comment


@dataclass(frozen=True)
class Draft:
    """A drafted study.

    Attributes
    ----------
    text : str
        TOML.
    questions : tuple of str
        What only the user knows; each stands as "?" in the text.
    doubts : tuple of str
        What looks wrong in recordings or body; each stands as a comment in the text.
    """

    text: str
    questions: tuple[str, ...]
    doubts: tuple[str, ...] = ()


class StatedBody(TypedDict, total=False):
    """A body's data as a user states them.

    Attributes
    ----------
    length, mass, diameter : float, optional
        m, kg and m, outer.
    gravity : 3 floats, optional
        In the axes of the tracker, m/s^2.
    """

    length: float | None
    mass: float | None
    diameter: float | None
    gravity: Sequence[float] | None


UNKNOWN = StatedBody(length=None, mass=None, diameter=None, gravity=None)


def draft_study(
    files: Sequence[str | Path], study: str | Path, *, mapping: Mapping[str, Any] | None = None,
    level: float | None = None, space: bool | None = None, **body: Unpack[StatedBody],
) -> Draft:
    """Look at recordings of one actuator and draft their study.

    Parameters
    ----------
    files : sequence of str or Path
        Recordings of the same actuator in the same set-up; a log of pressure alone goes with the one whose name it
        begins with.
    study : str or Path
        Where the study will lie; file names in it are relative to that folder. Nothing is written.
    mapping : dict, optional
        What the files do not say themselves; see `pliant.read`.
    level : float, optional
        Nominal gauge pressure of recordings that hold none, Pa.
    space : bool, optional
        Whether the body moves in space or bends in a plane. Default: as the recordings show.
    **body
        What is known of the body; see `StatedBody`.

    Returns
    -------
    Draft

    Raises
    ------
    InputError
        When a file cannot be read or holds no positions, or two files share a name.
    """
    stated = with_defaults(draft_study, body, UNKNOWN)
    length, mass, diameter, gravity = stated["length"], stated["mass"], stated["diameter"], stated["gravity"]
    looks = looks_at(files, mapping, space)
    names = [look.name for look in looks]
    if not names or len(set(names)) < len(names):
        raise InputError(f"a study needs recordings whose file names differ, got {', '.join(names) or 'none'}")
    first, title, out = looks[0], Path(study).stem, Lines()
    out.say('Written by `pliant new` from the files. Entries that only you can know are marked "?".',
            "Every entry is explained in docs/studies.md. SI units, except where a name says otherwise.")
    doubts = look_doubts(looks, Case(length=length, mass=mass, diameter=diameter, gravity=tuple(gravity or ()) or None))
    out.say(*(f"! {line}" for line in doubts))
    out.put("name", title)
    out.put("title", title.replace("_", " "))
    out.put("step", 2e-3, "s, of the integration")
    camera(out, looks)
    units(out, looks)
    actuator(out, first, length, mass, diameter)
    in_which_space(out, looks)
    weight(out, looks, gravity)
    if first.capped:
        fibre(out, first, length)
    elif not first.turns:
        alignment(out, first)
    if first.dense:
        reduction(out, looks)
    if spatial_study(looks):
        chambers(out, placed(looks))
    else:
        chambers_in_plane(out, looks)
    tendons(out, placed(looks))
    names = driven(looks)
    for look in looks:
        recording(out, look, Path(study).parent, level)
        channels(out, look, names)
    fit(out, looks)
    selection(out, looks)
    out.table("targets")
    out.say("what the verdict holds the predictions against; take a line away and it is not judged")
    out.put("rmse_percent_of_travel", 5.0)
    return Draft("\n".join(out.text) + "\n", tuple(dict.fromkeys(out.questions)), doubts)


def looks_at(
    files: Sequence[str | Path], mapping: Mapping[str, Any] | None, space: bool | None
) -> list[FirstLook]:
    """First looks at the recordings, all of them in the plane or in space; in space where one of them shows it."""
    pairs = with_logs([Path(f) for f in files])
    looks = [look_with_log(shape, log, mapping) for shape, log in pairs]
    spatial = any(look.spatial or look.cords for look in looks) if space is None else space
    if spatial:
        return [in_space(look) for look in looks]
    return from_one_side(looks) if len(driven(looks)) > 1 else looks


def in_which_space(out: Lines, looks: Sequence[FirstLook]) -> None:
    """Whether the body moves in space: what the recordings show, and what the other choice would mean."""
    share = 100 * max(look.out_of_plane for look in looks)
    shown = f"{share:.0f} % of the motion is out of its best plane"
    if spatial_study(looks):
        out.put("space", True, f"{shown}; without this line the study is in that plane and leaves it out")
    elif 0.01 * share > NEARLY_PLANAR and not looks[0].turns:
        out.say(f"space = true  ({shown} and left out: take the # away for a study in space)")


def spatial_study(looks: Sequence[FirstLook]) -> bool:
    """Whether the recordings were looked at in space, as those of tendons always are."""
    return any(look.cords or (look.aligned is not None and look.aligned.attrs["frame"] == "spatial") for look in looks)


def look_doubts(looks: Sequence[FirstLook], case: Case) -> tuple[str, ...]:
    """Return the warnings about the recordings and the body, without duplicates."""
    said: dict[str, str] = {}
    for look in looks:
        said |= {f"{look.name} {check}": f"{look.path.name}: {line}" for check, line in look.found.doubts.items()}
        for check, line in of_body(case, look.grouped, look.aligned if look.scaled else None).items():
            said.setdefault(check, line)
    return (*said.values(), *beside({look.name: look.aligned for look in looks if look.aligned is not None}))


def camera(out: Lines, looks: Sequence[FirstLook]) -> None:
    """The camera, where points are pixels and nothing says how large one is."""
    if not any("camera" in look.made_up for look in looks):
        return
    out.table("camera")
    out.say("points of a tracker: what follows was found at 30 frames a second and 1 pixel per mm, for want of these")
    out.ask("rate_hz", "frames a second of the video")
    out.ask("pixels_per_mm", "or instead scale, plane or board: see docs/your_own_data.md")


def units(out: Lines, looks: Sequence[FirstLook]) -> None:
    """Units of angle and pressure that no file states."""
    asked = {k for look in looks for k in look.made_up if k != "camera"}
    if not asked:
        return
    out.table("mapping")
    out.say("what follows was found as if these were degrees and kPa")
    for name, known in (("angle_unit", "deg or rad"), ("pressure_unit", "gauge: kPa, bar, mbar, psi, Pa")):
        if name in asked:
            out.ask(name, known)


def actuator(
    out: Lines, look: FirstLook, length: float | None, mass: float | None, diameter: float | None = None
) -> None:
    """The body."""
    out.table("actuator")
    comment = "m, as you stated"
    if length is None and (length := body_length(look)) is not None:
        along = "along the stations" if look.dense else "from base to tip at rest"
        comment = f"m, {along} in {look.path.name}: correct it where you know better"
    out.ask("length", "m, of the part that bends", length, comment)
    out.ask("mass", "kg, of the part that bends: weigh it, or density times volume; K, D and torque share its scale",
            mass, "kg, as you stated")
    if diameter is not None:
        out.put("diameter", diameter, "m, outer, as you stated: density, modulus and torque are checked with it")
    else:
        out.say("diameter = 0.03  (m, outer, where you know it: density, modulus and torque are checked with it)")
    if look.turns:
        out.say("links = 2  (default: one for each angle, which is all that angles support)")
    elif not look.dense:
        out.put("links", LINKS)
        out.put("joint_placement", "midsegment", "five links then ring within 1 % of a continuous beam")
    out.say("tip_mass = 0.006  (kg, a cap or a load at the tip: take the # away where there is one)")


def weight(out: Lines, looks: Sequence[FirstLook], gravity: Sequence[float] | None) -> None:
    """Gravity: asked for where a body is let go, since its weight is then all that drives it."""
    released = any(excitation(look) == "release" for look in looks)
    if released or gravity is not None:
        out.ask("gravity", f"m/s^2 in the axes of the tracker; {hanging(looks)}: it moves the released body",
                None if gravity is None else [float(g) for g in gravity], "m/s^2 in the axes of the tracker")
    else:
        axes = "m/s^2, x and y of the base frame, +y along the base" if looks[0].turns else \
            f"m/s^2 in the axes of the tracker; {hanging(looks)}"
        out.say(f"gravity = {down(looks)}  ({axes}; needed unless the body lies flat)")


def down(looks: Sequence[FirstLook]) -> list[float]:
    """Gravity of a body that hangs: along the tracker's axis nearest to its base tangent, or along +y of angles."""
    if looks[0].turns:
        return [0.0, 9.81]
    seen = [look.aligned for look in looks if look.aligned is not None and "alignment" in look.aligned.attrs]
    tangent = np.array(alignment_of(seen[0]).base_tangent if seen else [0.0, 0.0, -1.0])
    nearest = int(np.argmax(np.abs(tangent)))
    return [float(9.81 * np.sign(tangent[k])) if k == nearest else 0.0 for k in range(len(tangent))]


def hanging(looks: Sequence[FirstLook]) -> str:
    """Return in words what the entry `down` assumes."""
    return f"{down(looks)} if the body hangs at rest"


def fibre(out: Lines, look: FirstLook, length: float | None) -> None:
    """A fibre whose tip a cap marks."""
    out.table("fibre")
    out.say("the end cap's curvature marks the tip; the base is one body length back along the fibre")
    out.ask("body_length", "m, of the body along the fibre", length, "m, as you stated")
    out.put("cap_curvature", float(look.recording.attrs["cap_curvature"]), "1/m, as the file says")
    out.put("cap_length", float(look.recording.attrs["cap_length"]), "m, as the file says")


def alignment(out: Lines, look: FirstLook) -> None:
    """From the tracker's frame to the base frame."""
    if look.recording.attrs["frame"] == "planar":
        if not look.dense:
            out.table("alignment.options")
            out.put("base", look.base, "the recording is planar already; this station stands still and is not fitted")
        return
    if look.stations:
        out.table("alignment.stations")
        out.say("markers on one rigid part make one station, base first, tip last; grouped by their names")
        for name, markers in look.stations.items():
            out.put(name, markers)
    out.table("alignment.options")
    out.put("base", look.options["base"])
    tangent = "the first stations lie along the base tangent" if look.dense else \
        "from base to tip at rest; or the body's axis in the tracker, such as \"+x\" or [1.0, 0.0, 0.0]"
    out.put("tangent", look.options["tangent"], tangent)
    if "undo_jumps" in look.options:
        out.put("undo_jumps", True, "the orientation of a marker cluster jumps: counted and undone")
    if look.problem:
        out.say(f"The alignment fails so far: {look.problem}")
        out.questions.append(f"alignment: {look.problem}")
    elif look.aligned is not None:
        out.say(*[line for line in str(look.aligned.attrs["history"]).splitlines()
                  if line.startswith(("aligned", "out of plane", "the plane is", "the base moved"))])


def reduction(out: Lines, looks: Sequence[FirstLook]) -> None:
    """From a dense shape to links."""
    out.table("reduction")
    widest = max(looks, key=lambda look: look.widest)
    out.put("recording", widest.name, "its shape decides: it moves most")
    out.put("bound_mm", 3.0, "the lowest number of links whose shape errs less than this in every frame")
    out.say("links = 5  (instead, a number of your own)")


def recording(out: Lines, look: FirstLook, folder: Path, level: float | None) -> None:
    """One file: what is in it, and what drove it."""
    out.table(f"recordings.{key(look.name)}")
    out.say(*look.found.summary().splitlines())
    out.put("file", relative(look.path, folder))
    if look.log is not None:
        out.put("pressure_file", relative(look.log, folder), "its clock is brought onto that of the shape")
    if look.mapping:
        out.put("mapping", look.mapping)
    if (moving := moving_beside(look)) is not None:
        out.put("stations", moving, f"what moves, tip last; the others stand still, as {look.base} does")
    kind, when = excitation(look), moved(look)
    if kind == "release":
        out.put("excitation", "release", "no pressure, and the body does not return: read as held and let go"
                + (f" ({when})" if when else ""))
        out.say('if a pressure moved it after all: nominal_pressure = 20.0 and pressure_unit = "kPa" instead')
    elif kind in ("pulse", "step"):
        edges = "a pulse of one level, its edges" if kind == "pulse" else "a step to one level, its start"
        out.say(f"the pressure was not recorded: {edges} found from the motion and fitted"
                + (f" ({when})" if when else ""))
        if kind == "step":
            out.put("excitation", "step", "the body does not return: the end of the pulse was not recorded")
        value, said = (level, "as you stated") if level is not None else (look.highest_pa, "read off the file's name")
        out.ask("nominal_pressure", f"kPa gauge, the level of the pulse in {look.path.name}",
                None if value is None else value / 1e3, said)
        out.put("pressure_unit", "kPa")


def moving_beside(look: FirstLook) -> list[str] | None:
    """The stations to compare with where others than the base stand still too; None where only the base does."""
    if look.dense or look.turns or look.aligned is None:
        return None
    names = [str(s) for s in look.aligned["station"].values if str(s) != look.base]
    still = set(standing_stations(look.aligned)) & set(names)
    return [n for n in names if n not in still] if 0 < len(still) < len(names) else None


def fit(out: Lines, looks: Sequence[FirstLook]) -> None:
    """Return the lines of a fit: free parameters, training and held-out recordings."""
    held = held_out(looks)
    out.table("fits.first")
    out.put("train", [look.name for look in looks if look.name != held])
    if held:
        out.put("held_out", [held], "never seen by the fit; the verdict rests on it")
    else:
        out.say('a model is judged by what it predicts: record one more and name it here, held_out = ["another"]')
    out.table("fits.first.parameters")
    out.say('"free": the start value is estimated from the recordings')
    for name, meaning in free_parameters(looks, held):
        out.put(name, "free", meaning)
    if held and looks[0].turns:
        out.table("fits.midsegment")
        out.say("stiffness of few links depends on where joints are assumed to sit: the held-out record may tell where")
        out.put("title", "Joints in the middle of their segments")
        out.put("like", "first")
        out.put("joint_placement", "midsegment")
        out.table("fits.three_links")
        out.say("an angle decides one link; more stand for a body that bends evenly, where that predicts as well")
        out.put("title", "Three links")
        out.put("like", "first")
        out.put("links", 3)
        out.put("joint_placement", "midsegment")


def selection(out: Lines, looks: Sequence[FirstLook]) -> None:
    """The hierarchy of models, to be taken where a record is held out of a body that one pressure bends in a plane."""
    held = held_out(looks)
    if not held or spatial_study(looks) or driven(looks) or {excitation(look) for look in looks} == {"release"}:
        return
    train = ", ".join(f'"{look.name}"' for look in looks if look.name != held)
    names = [n for n, _ in free_parameters(looks, held) if n in ("start", "sensor_lag", "base_angle") or "." in n]
    common = ", ".join(f'{key(n)} = "free"' for n in names)
    out.text.append("")
    out.say("take the # away, and creep, hysteresis and other terms are added one by one as far as the held-out record",
            "is predicted better: a minute or two")
    out.text += ["# [model_selection]", f"# train = [{train}]", f'# held_out = ["{held}"]',
                 f"# common = {{ {common} }}  # free with every model"]


def free_parameters(looks: Sequence[FirstLook], held: str | None) -> list[tuple[str, str]]:
    """Names and meanings of what the recordings can tell."""
    kinds, first = {excitation(look) for look in looks}, looks[0]
    levels = {round(look.highest_pa, -2) for look in looks if look.name != held and look.highest_pa is not None}
    free = [("stiffness", "N m/rad, of every joint"), ("damping", "N m s/rad, of every joint")]
    if named := [*driven(looks), *(one.name for one in first.cords)]:
        return free + chamber_parameters(named, space=spatial_study(looks)) + place_parameters(looks, kinds)
    if kinds != {"release"}:
        free += [("torque_1", "N m/Pa")]
        free += [("torque_2", "N m/Pa^2, seen because more than one level is trained on")] if len(levels) > 1 else []
    if "trace" in kinds:
        free += [("sensor_lag", "s, time constant of the angle's sensor") if first.turns else
                 ("start", "s, the clock of the pressure against that of the shape")]
    if kinds & {"pulse", "step"}:
        free += [("valve_rise", "s, time constant of the pressure")]
    if "pulse" in kinds:
        free += [("valve_fall", "s")]
    if spatial_study(looks) and kinds != {"release"}:
        free += [("gain_y", "of the torque about y over that about x")]
    return free + place_parameters(looks, kinds)


def place_parameters(looks: Sequence[FirstLook], kinds: Collection[str]) -> list[tuple[str, str]]:
    """The error of the base tangent and the place of the last station, where they are markers."""
    first = looks[0]
    if first.dense or first.recording.attrs["frame"] == "planar" or set(kinds) == {"release"}:
        return []
    tip = (list(first.stations) or [str(s) for s in first.recording["station"].values])[-1]
    place = [(f"{tip}.along", "m, where the last station sits"), (f"{tip}.across", "m")]
    if spatial_study(looks):
        tilts = [(f"base_tilt_{axis}", f"rad, error of the tangent about {axis}") for axis in "xy"]
        return [*tilts, *place, (f"{tip}.aside", "m")]
    return [("base_angle", "rad, error of the tangent"), *place]
