"""Determine the base frame of an alignment: the tangent of the body at its base and the plane of bending."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pliant.errors import InputError, shown
from pliant.preprocessing import detectors
from pliant.preprocessing.rotations import angle_about, continuous, from_matrix, mean_rotation
from pliant.preprocessing.side import alignment_of
from pliant.recording import append_history
from pliant.recording.inputs import inputs_at, with_base_motion
from pliant.recording.vocabulary import says_base

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import ArrayLike, NDArray

AXIS_NAME = re.compile(r"(base:)?([+-])([xyz])")
DENSE = 10  # stations: from here on the end of the body was detected in a picture, not marked
TANGENTS = "'chord', 'clamp', an axis of the tracker such as '+x', an axis of the base such as 'base:+z', or a vector"
PARALLEL = 0.05  # sine of the angle below which a normal is parallel to the tangent


def unit_vector(value: ArrayLike, what: str) -> NDArray:
    """Return three numbers divided by their norm, as a unit vector (3,). Raise InputError where they are not finite or
    all zero; `what` is the name of the option for the error message.
    """
    try:
        vector = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{what} must be three numbers, not {shown(value)}") from None
    if vector.shape != (3,) or not np.isfinite(vector).all() or not np.abs(vector).max() > 0:
        raise InputError(f"{what} must be three finite numbers that are not all zero, not {shown(value)}")
    vector = vector / np.abs(vector).max()  # the square of 1e200 is infinite
    return vector / np.linalg.norm(vector)


def base_tangent(
    option: Any, rest: NDArray, base: int, rotation: NDArray | None, clamp_length: float | None
) -> NDArray:
    """Return the unit tangent (3,) of the body at the base, in tracker coordinates, from the positions of the stations
    at rest or a stated direction.

    Parameters
    ----------
    option : str or 3 numbers
        ``"chord"``: from the base to the last station. ``"clamp"``: line through the stations within
        `clamp_length` of the base, by default the first three. With ten stations or more the default is the second to
        the fourth, since the end of a line found in a picture is its least certain point. ``"+x"``: axis of the
        tracker. ``"base:+z"``: axis of the base station's orientation at rest. Or a vector of three numbers.
    rest : (S, 3) array, m
        Positions of the stations at rest.
    base : int
        Index of the base station.
    rotation : (3, 3) array or None
        Orientation of the base at rest.
    clamp_length : float or None, m
    """
    if not isinstance(option, str):
        return unit_vector(option, "tangent")
    if option == "chord":
        if base == len(rest) - 1:
            raise InputError("the last station is the base, so there is no chord: set base to the first station, or "
                             "tangent to an axis such as '+y'")
        return unit_vector(rest[-1] - rest[base], "the chord from the base to the last station")
    if option == "clamp":
        return _clamp_tangent(rest[base:], clamp_length)
    axis = named_axis(option, rotation)
    if axis is None:
        raise InputError(f"tangent must be {TANGENTS}, not {option!r}")
    return axis


def named_axis(name: Any, rotation: NDArray | None) -> NDArray | None:
    """Return the unit vector (3,), in tracker coordinates, of an axis that is named as a text: "+x" of the tracker, or
    "base:+x" of the base station at rest. Return None for any other text or object.

    Parameters
    ----------
    name : str or object
    rotation : (3, 3) array or None
        Orientation of the base at rest.

    Raises
    ------
    InputError
        When the axis is of the base and the base has no orientation.
    """
    match = AXIS_NAME.fullmatch(name) if isinstance(name, str) else None
    if match is None:
        return None
    axis = np.zeros(3)
    axis["xyz".index(match.group(3))] = 1.0 if match.group(2) == "+" else -1.0
    if match.group(1) is None:
        return axis
    if rotation is None:
        raise InputError(f"the axis {name!r} needs the orientation of the base station, which has none at rest: "
                         "choose another axis")
    return rotation @ axis


def _clamp_tangent(body: NDArray, clamp_length: float | None) -> NDArray:
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(body, axis=0), axis=1))])
    if clamp_length is None and len(body) >= DENSE:
        body, arc = body[1:], arc[1:]
    count = min(3, len(body)) if clamp_length is None else int((arc <= clamp_length).sum())
    if count < 2:
        raise InputError(
            f"tangent = 'clamp' needs two stations in the clamp, but there is {count}"
            + ("" if clamp_length is None else f" within {1e3 * clamp_length:.3g} mm: increase clamp_length")
        )
    points = body[:count]
    direction = np.linalg.svd(points - points.mean(0))[2][0]
    return direction if direction @ (points[-1] - points[0]) > 0 else -direction


def input_normal(recording: xr.Dataset, tangent: NDArray, position: NDArray, pose: NDArray) -> NDArray:
    """Return the unit normal (3,) of the plane in which the first actuation input of a recording bends the body.

    The displacement of the station that moves most is fitted as linear in all inputs. The direction of the bending is
    that of the first input's coefficients, perpendicular to the tangent. A positive input bends the body about the
    normal in the positive sense.

    Parameters
    ----------
    recording : xarray.Dataset
        Recording with measured inputs: its pressures, then its others.
    tangent : (3,) array
    position : (T, S, 3) array, m
    pose : (S, 3) array, m
        Stations at rest.

    Raises
    ------
    InputError
        When no input was measured, or the first input causes no motion perpendicular to the tangent.
    """
    inputs = inputs_at(recording, recording["time"].values)
    if not inputs.shape[1]:
        raise InputError("plane = 'input' needs a measured input, but the recording holds none: set plane to "
                         "'motion', 'body' or a normal")
    across = (position - pose) @ (np.eye(3) - np.outer(tangent, tangent))
    moved = across[:, int(np.argmax(np.nan_to_num(detectors.rms_deviation(across))))]
    known = np.isfinite(moved).all(-1) & np.isfinite(inputs).all(-1)
    size = np.abs(inputs[known]).max(axis=0, initial=0.0)
    design = np.column_stack([np.ones(int(known.sum())), inputs[known] / np.where(size > 0, size, 1.0)])
    gain = np.linalg.lstsq(design, moved[known], rcond=None)[0][1]
    if np.linalg.norm(gain) < max(6.0 * still_noise(position), 1e-6):
        raise InputError("the first input causes no motion across the base tangent beyond the noise: set plane to "
                         "'motion', 'body' or a normal")
    return np.cross(tangent, gain / np.linalg.norm(gain))


def bending_normal(
    option: Any, tangent: NDArray, position: NDArray, about: dict[str, NDArray], noise: float
) -> tuple[NDArray, float]:
    """Return the unit normal (3,) of the plane of bending, perpendicular to the base tangent, and the flatness of the
    motion (0 planar, 1 without a preferred plane).

    Parameters
    ----------
    option : {"motion", "body"} or 3 numbers
        Plane of the displacements from rest ("motion"), plane of all points of the body ("body"), or the normal.
    tangent : (3,) array
    position : (T, S, 3) array, m
    about : dict
        Reference of the displacements: ``motion`` the mean positions of the stations (S, 3), ``body`` the origin
        (3,), m.
    noise : float, m
        Noise of the positions; a smaller motion defines no plane.

    Returns
    -------
    normal : (3,) array
    ratio : float
        Second over first singular value perpendicular to the tangent: 0 for planar data, 1 where no plane is preferred.
    """
    if not isinstance(option, str):
        normal = unit_vector(option, "plane, a normal,")
        normal = normal - (normal @ tangent) * tangent
        if np.linalg.norm(normal) < PARALLEL:
            raise InputError("plane, given as a normal, must not be parallel to the base tangent: give a direction "
                             "across the body")
        return normal / np.linalg.norm(normal), 0.0
    if option not in ("motion", "body"):
        raise InputError(f"plane must be 'motion', 'body', 'input', an axis such as '+x', or a normal of three "
                         f"numbers, not {option!r}")
    square = np.eye(3) - np.outer(tangent, tangent)
    scatter = np.zeros((3, 3))
    for rows in detectors.seen_points(position, about[option]):
        across = rows @ square
        scatter += across.T @ across
    values, directions = np.linalg.eigh(scatter)
    values = np.sqrt(np.clip(values, 0.0, None))
    main = square @ directions[:, 2]
    largest = max((np.abs(rows @ main).max(initial=0.0) for rows in detectors.seen_points(position, about[option])),
                  default=0.0)
    if largest < max(6.0 * noise, 1e-6):
        what = "no station moves" if option == "motion" else "the body does not bend"
        raise InputError(f"{what} across the base tangent beyond the noise: set plane to the normal of the plane, or "
                         "tangent if it points along the motion")
    normal = np.cross(directions[:, 2], tangent)
    normal = normal * (np.sign(normal[np.argmax(np.abs(normal))]) or 1.0)
    return normal, float(values[1] / values[2])


def base_rotation_at_rest(matrices: NDArray | None, base: int, window: NDArray) -> NDArray | None:
    """Return the mean rotation matrix (3, 3) of the base station while the body is at rest, from the rotation matrices
    (T, S, 3, 3) of S stations over T frames; None where its orientation is unknown.
    """
    matrix = np.full((3, 3), np.nan) if matrices is None else mean_rotation(matrices[window, base])
    return matrix if np.isfinite(matrix).all() else None


def still_noise(position: NDArray) -> float:
    """Return the median over the stations of the position noise [m]; 0 where it cannot be determined."""
    noise = detectors.by_blocks(detectors.noise_level, position)
    noise = noise[np.isfinite(noise)]
    return float(np.median(noise)) if noise.size else 0.0


BASE_SHARE = 0.1  # of the largest peak displacement: a base that moves less is taken to be at rest
STILL_SHARE = 0.2  # of the base's peak displacement: a station that moves less is not carried by it


class BaseRest(NamedTuple):
    """The base station at rest, in the tracker's frame."""

    station: int  # its index
    position: NDArray  # (3,) m
    axes: Any  # (3, 3)


def with_base_input(
    aligned: xr.Dataset, tracked: tuple[NDArray, Any, BaseRest], cutoff: float | str,
) -> xr.Dataset:
    """Return an aligned recording with the motion of its base station as an input, see `with_base_motion`.

    Parameters
    ----------
    aligned : xarray.Dataset
        Positions and angles relative to the moved base.
    tracked : tuple
        Positions (T, S, 3) [m] and orientations (T, S, 3, 3) of the stations in the tracker's frame, and the base
        station at rest.
    cutoff : float (Hz) or "auto"
        Smoothing of the motion for its derivatives.
    """
    position, matrices, rest = tracked
    report = alignment_of(aligned)
    axes, origin = np.array(report.rotation), np.array(report.origin)
    turned = turns_of_base(position, matrices, rest)
    moved = (position[:, rest.station] + turned @ (origin - rest.position) - origin) @ axes.T
    rotation = axes @ turned @ axes.T
    unknown = int((~np.isfinite(moved).all(axis=1)).sum())
    lines = [f"the pose of the base is unknown in {unknown} of {len(moved)} frames"] if unknown else []
    if rest.axes is None:
        lines.append("the base has no orientation in this recording, and is taken as one that does not turn")
    if report.frame == "spatial":
        quaternion, _ = continuous(from_matrix(rotation)[:, None])
        done = with_base_motion(aligned, moved, quaternion=quaternion[:, 0], cutoff=cutoff)
        return append_history(done, *lines)
    angle = angle_about(rotation, np.array([0.0, 0.0, 1.0]))
    finite = np.isfinite(angle)
    angle[finite] = np.unwrap(angle[finite])
    tilt = np.degrees(np.arccos(np.clip(rotation[finite, 2, 2], -1.0, 1.0)).max(initial=0.0))
    lines.append(f"the base leaves the plane by up to {1e3 * np.nanmax(np.abs(moved[:, 2])):.3g} mm and {tilt:.3g} "
                 "degrees, which is left out")  # fmt: skip
    return append_history(with_base_motion(aligned, moved[:, :2], angle=angle, cutoff=cutoff), *lines)


def turns_of_base(position: NDArray, matrices: Any, rest: BaseRest) -> NDArray:
    """Return the rotation (T, 3, 3) of the base station since rest, in the tracker's frame; none if it has no
    orientation.
    """
    if rest.axes is None:
        return np.broadcast_to(np.eye(3), (len(position), 3, 3))
    return np.asarray(matrices[:, rest.station] @ rest.axes.T)


def is_turned(stations: xr.Dataset, index: int) -> bool:
    """Return whether the orientation of a station is known."""
    return "quaternion" in stations and bool(
        np.isfinite(stations["quaternion"].values[:, index]).all(axis=-1).any())


def base_is_moved(stations: xr.Dataset, index: int) -> bool:
    """Return whether the base station of a recording before its alignment moves by more than a tenth of the largest
    peak displacement, and carries all other stations along. Without an orientation it must have the name of a base:
    the first disk of a body that no station holds moves too.
    """
    if stations.sizes["station"] < 2 or not (
        is_turned(stations, index) or says_base(str(stations["station"].values[index]))
    ):
        return False
    travel = np.nan_to_num(detectors.travel(detectors.without_spikes(stations["position"].values)))
    return bool(travel[index] > BASE_SHARE * travel.max() and travel.min() >= STILL_SHARE * travel[index])
