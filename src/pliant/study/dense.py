"""Preparation of dense shapes, which have points all along the body: find tip and body, align, choose the number of
links, place them, and build the experiment (Secs. II and III-A of the paper).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr

from pliant.errors import InputError
from pliant.identification import Experiment, experiment
from pliant.preprocessing.align import align
from pliant.preprocessing.cap import find_tip
from pliant.preprocessing.curvature import curvature_of
from pliant.preprocessing.cut import cut_body
from pliant.preprocessing.side import ATTRIBUTE as SIDE
from pliant.preprocessing.side import alignment_of, x_sign
from pliant.recording import make_recording
from pliant.recording.inputs import input_arguments, keep_base
from pliant.reduction import LinkPlacement, OrderResult, links_of, select_order
from pliant.study.aligned import known_forces, known_values
from pliant.study.schema import Fibre, Reduction, Study
from pliant.validation.outcome import Shape

SAME_LENGTH = 0.01  # relative difference that two videos may show in the length of one body
REST_S = 0.1  # the rest shape is the mean of the first frames, before the pressure


def body_of_fibre(
    raw: xr.Dataset, fibre: Fibre, *, space: bool = False, normal: np.ndarray | None = None
) -> tuple[xr.Dataset, str]:
    """Cut the actuator's body out of the shape of a whole fibre; return it in the base frame, with a sentence on how
    its tip was found.

    Parameters
    ----------
    raw : xarray.Dataset
        Positions along the fibre in the tracker's frame, starting with the lead.
    fibre : Fibre
    space : bool
        Keep three dimensions instead of projecting the body onto its plane of bending.
    normal : (3,) array, optional
        Normal of the plane of bending (in space: the x axis), if another recording determines it.

    Raises
    ------
    InputError
        When the cap is not found, or the body would begin before the start of the fibre.
    """
    first = str(raw["station"].values[0])
    whole = align(raw, base=first, tangent="clamp", clamp_length=fibre.clamp_length, rest=fibre.rest, space=space)
    frame = alignment_of(whole)
    start, side, tip_status = (fibre.start, 1.0, "") if fibre.start is not None else before_cap(whole, fibre)
    cut = cut_body(raw, start, start + fibre.body_length)
    plane = side * np.array(frame.normal) if normal is None else normal
    base = str(cut["station"].values[0])
    body = align(cut, base=base, tangent=frame.base_tangent, plane=plane, bend=None, space=space)
    ends = f"the body lies {1e3 * start:.1f} to {1e3 * (start + fibre.body_length):.1f} mm along the fibre, as stated"
    return body, tip_status or ends


def before_cap(whole: xr.Dataset, fibre: Fibre) -> tuple[float, float, str]:
    """Find the cap at the fibre's tip. Return the arc length [m] along the fibre at which the body's base lies, the
    side to which the cap bends (1 or -1), and a sentence on the cap.

    The base lies one body length before the cap. In space, the cap is found by the magnitude of its curvature.
    """
    space, frame = whole.attrs["frame"] == "spatial", alignment_of(whole)
    kappa = curvature_of(whole, method="savgol", window=15)
    kappa = kappa.sel(time=slice(*frame.rest_s))  # at rest: in a bent body the fibre slides in its lumen
    s = kappa["arc_length"].values
    cap = float(fibre.cap_curvature or 0.0)
    candidates = [find_tip(
        side * kappa.values, float(np.median(np.diff(s))), cap_curvature=abs(cap) if space else cap,
        cap_length=float(fibre.cap_length or 0.0), gauge_length=fibre.gauge_length,
    ) for side in ((1.0,) if space else (1.0, -1.0))]  # the cap decides the side, since a curled body cannot
    mirrored = not space and candidates[1].found and not candidates[0].found
    tip = candidates[mirrored]
    if not tip.found:
        raise InputError(f"{tip.status} Check cap_curvature and cap_length, or state start in [fibre].")
    if tip.arc_length < fibre.body_length:
        raise InputError(
            f"the tip lies {1e3 * tip.arc_length:.1f} mm along the fibre, less than the body's "
            f"{1e3 * fibre.body_length:.1f} mm: correct body_length in [fibre]"
        )
    return tip.arc_length - fibre.body_length, -1.0 if mirrored else 1.0, tip.status


def shape_of(name: str, body: xr.Dataset, tip_status: str, reduction: Reduction) -> Shape:
    """Compute the curvature of a recorded shape, choose the number of links and place them on it. Return all results as
    a `Shape`.
    """
    order: OrderResult = select_order(
        body, max_order=max(reduction.max_order, reduction.links or 2), bound=1e-3 * reduction.bound_mm,
        boundary=reduction.boundary, placement=reduction.placement,
    )
    n = reduction.links or order.chosen
    if n is None:
        raise InputError(f"recording {name}: {order.reason} In [reduction] raise max_order or bound_mm or state links.")
    links = links_of(body, node_arc_length=nodes_of(order, n, reduction))
    kappa = curvature_of(body, method="spline" if body.attrs["frame"] == "spatial" else "basis")
    clock = kappa["time"].values
    rest = np.nanmean(kappa.values[clock <= clock[0] + REST_S], axis=0)
    return Shape(
        name, kappa["arc_length"].values, body["position"].values, kappa.values, rest, order, links, tip_status
    )


def nodes_of(order: OrderResult, n: int, reduction: Reduction) -> np.ndarray:
    """Return the arc lengths (n + 1,) [m] of n joints and the tip. With the joint placement "midsegment" the joints lie
    in the middle of equal segments, otherwise where the selection of the number of links placed them.
    """
    if reduction.joint_placement == "midsegment":
        return np.asarray(order.length / n * np.append(np.arange(n) + 0.5, n))
    if n not in order.orders:
        return np.array([0.0, order.length])
    return np.asarray(order.node_arc_length[order.orders.index(n)])


def scaled_nodes(nodes: np.ndarray, body: xr.Dataset) -> np.ndarray:
    """Return the arc lengths (n + 1,) [m] of n joints and the tip, scaled to the body length in this recording. If that
    differs from the tip's arc length by 1 % or more, which is too much for a measurement error, return them unchanged.
    """
    if "arc_length" not in body.coords:
        return nodes
    length = float(body["arc_length"].to_numpy()[-1])
    return nodes * (length / nodes[-1]) if abs(length / nodes[-1] - 1.0) < SAME_LENGTH else nodes


def link_experiment(study: Study, name: str, body: xr.Dataset, chain: LinkPlacement) -> Experiment:
    """Return the experiment of a recorded dense shape, observed at the tips of links whose joints lie at the same arc
    lengths as in `chain`.
    """
    entry = study.recordings[name]
    links = links_of(body, node_arc_length=scaled_nodes(chain.node_arc_length, body))
    base = links.base if chain.node_arc_length[0] == 0 else 0.0  # else links.base is the first joint, not the base
    tips = make_recording(
        links.time, links.tips - base, station=[f"link_{i + 1}" for i in range(links.n)], frame=body.attrs["frame"],
        nominal_pressure=body.attrs.get("nominal_pressure"), source=str(body.attrs.get("source", "")),
        **input_arguments(body),
    )
    tips = keep_base(body, tips.assign_attrs({SIDE: x_sign(body)}))
    forces = known_forces(entry, body)
    observed = experiment(name, tips, excitation=entry.excitation, known=known_values(entry, body), forces=forces,
                          drive=entry.drive)
    if not entry.angles:
        return observed
    angle = links.joint_angle + links.rest_angle
    return replace(observed, angle=angle, angle_reference="joint", angles_alone=entry.angles == "only")
