"""Groups of markers that sit on one rigid part, such as a plate at the tip, by their names and distances."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from pliant.preprocessing.align import DENSE_STATIONS

NUMBERED = re.compile(r"(.*?)[ _.:-]*\d+")  # "Tip - 1" belongs to "Tip"
UNNAMED = re.compile(r"s\d+")  # names of stations that have none in the file
RIGID_SHARE, RIGID_M = 0.02, 1e-3  # permitted change of distances within a rigid part, relative and in metres
LINE = 0.15  # markers narrower than this fraction of their length lie along a body, not on a plate


def clusters(names: Sequence[str]) -> dict[str, list[str]]:
    """Group the names of markers that belong to one rigid part, with the base first: ``Tip - 1``, ``Tip - 2``, ... form
    the group ``tip``.

    The result is empty unless there are at least two groups, one of them with three markers or more.
    """
    groups: dict[str, list[str]] = {}
    for name in names:
        match = NUMBERED.fullmatch(name)
        label = re.sub(r"[^a-z0-9]+", "_", (match[1] if match and match[1] else name).lower()).strip("_")
        groups.setdefault(label or name, []).append(name)
    if len(groups) < 2 or max(map(len, groups.values())) < 3:
        return {}
    return dict(sorted(groups.items(), key=lambda item: "base" not in item[0]))


def one_body(names: Sequence[str]) -> dict[str, list[str]]:
    """Return one group of all markers if their names differ by numbers alone, such as ``Tip - 1``, ``Tip - 2`` and
    ``Tip - 3``; otherwise an empty dict. At least three markers are needed. Names such as ``s000`` are given by a
    reader and say nothing of a plate.
    """
    if all(UNNAMED.fullmatch(name) for name in names):
        return {}
    labels = {match[1].strip(" _.:-").lower() if (match := NUMBERED.fullmatch(name)) else name for name in names}
    label = re.sub(r"[^a-z0-9]+", "_", labels.pop()) or "body"
    return {label: list(names)} if not labels and len(names) >= 3 else {}


def rigid_clusters(recording: xr.Dataset) -> dict[str, list[str]]:
    """Return the groups of markers that can sit on one rigid plate, by their names and distances. Every other marker is
    a station of its own. All markers may be on one plate, if only one rigid body was tracked.

    The result is empty if no group has more than one marker.
    """
    names = [str(s) for s in recording["station"].values]
    groups = clusters(names) or one_body(names)
    plates: dict[str, list[str]] = {}
    for name, markers in groups.items():
        plate = len(markers) < DENSE_STATIONS and rigid(recording, markers)
        plates |= {name: markers} if plate else {m: [m] for m in markers}
    return plates if any(len(markers) > 1 for markers in plates.values()) else {}


def rigid(recording: xr.Dataset, markers: Sequence[str]) -> bool:
    """Return whether markers can sit on one rigid plate: not on a line, and at nearly constant distances."""
    position = recording["position"].sel(station=list(markers)).values
    apart = np.linalg.norm(position[:, :, None] - position[:, None], axis=-1)
    apart = apart[np.isfinite(apart).all(axis=(1, 2))]
    if not len(apart):
        return True  # never visible together: rigidity cannot be tested
    low, high = np.percentile(apart, [5, 95], axis=0)
    still = bool((high - low <= np.maximum(RIGID_M, RIGID_SHARE * high)).all())
    shape = position[np.argmax(np.isfinite(position).all(axis=(1, 2)))]
    size = np.linalg.svd(shape - shape.mean(axis=0), compute_uv=False)
    return still and (len(markers) < 3 or bool(size[1] > LINE * size[0]))


def standing_among(names: Sequence[str], stations: Mapping[str, list[str]], standing: Sequence[str]) -> list[str]:
    """Return the stations that stand still: those whose markers all do."""
    return [n for n in names if {*stations.get(n, [n])} <= {*standing}]


def base_first(
    recording: xr.Dataset, stations: dict[str, list[str]], standing: Sequence[str]
) -> dict[str, list[str]]:
    """Return groups of markers by station, in reverse order if the last stations alone stand still; then also where
    every marker is a station.
    """
    names = list(stations) or [str(s) for s in recording["station"].values]
    still = standing_among(names, stations, standing)
    if not 0 < len(still) < len(names) or still != names[-len(still) :]:
        return stations
    return {name: stations.get(name, [name]) for name in reversed(names)}


def off_curve(motion: np.ndarray) -> float:
    """Return the fraction of the motion (T, 3) of one point that is off a curve (root mean square). A body that bends
    in a plane moves its tip along a curve; the plane itself, which contains the base, one point does not show.

    The curve is a cubic polynomial in the coordinate along which the point moves most.
    """
    known = motion[np.isfinite(motion).all(axis=1)]
    away = known - known.mean(axis=0)
    if len(away) < 10 or not away.any():
        return 0.0
    along, across, _ = (away @ np.linalg.svd(away, full_matrices=False)[2].T).T
    left = across - np.polynomial.Polynomial.fit(along, across, 3)(along)
    return float(np.sqrt(np.mean(left**2) / np.mean((away**2).sum(axis=1))))
