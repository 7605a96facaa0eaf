"""The paper's Secs. II and III-A on a made-up fibre: strain, shape, tip by the cap, order, links."""

import numpy as np

from pliant.preprocessing.cap import find_tip
from pliant.preprocessing.cut import cut_body
from pliant.recording import make_recording
from pliant.reduction import links_of, select_order
from pliant.sensing import CoreLayout, curvature_from_strain, shape_from_strain

SPACING, LEAD, LENGTH, CAP, CAP_CURVATURE = 0.8e-3, 0.04, 0.1688, 0.03, -40.0


def made_up_strain(rng, frames=60):
    """Strain of a centre and three outer cores: straight lead, moving body, cap, straight tail."""
    s = np.arange(0, 0.27, SPACING)
    t = np.arange(frames) / 75
    x = np.clip((s - LEAD) / LENGTH, 0, 1)
    on_body, on_cap = (s >= LEAD) & (s < LEAD + LENGTH), (s >= LEAD + LENGTH) & (s < LEAD + LENGTH + CAP)
    bend = 3 + 6 * (1 - np.exp(-8 * t) * np.cos(30 * t))
    kappa = bend[:, None] * (1 + 0.3 * np.sin(7 * x)) * on_body + CAP_CURVATURE * on_cap
    layout = CoreLayout.symmetric(3, 35e-6)
    strain = 1e-4 - 35e-6 * kappa[:, None, :] * np.cos(layout.angle)[None, :, None]
    strain[:, 0] = 1e-4
    strain += 1e-6 * rng.normal(size=strain.shape)
    return layout, make_recording(t, strain=strain, gauge_position=s)


def test_from_strain_to_links(rng):
    layout, fibre = made_up_strain(rng)
    s = fibre["gauge_position"].values
    state = curvature_from_strain(fibre["strain"].values, s, layout)
    tip = find_tip(state.curvature[..., 0], SPACING, cap_curvature=CAP_CURVATURE, cap_length=CAP)
    assert tip.found, tip.status
    assert abs(tip.arc_length - (LEAD + LENGTH)) < SPACING
    body = cut_body(shape_from_strain(fibre, layout), LEAD, tip.arc_length)
    assert "cut to the body" in body.attrs["history"]
    order = select_order(body, bound=1e-3)
    assert order.chosen is not None
    assert order.frames == 60
    assert order.notes[0] == "arc length: as recorded"
    flat = make_recording(
        body["time"].values, body["position"].values[..., :2], arc_length=body["arc_length"].values, frame="planar"
    )
    links = links_of(flat, order.chosen, length="mean")
    assert links.residual.max() < 0.02 * LENGTH
    assert np.abs(links.joint_angle).max() < 1.0
