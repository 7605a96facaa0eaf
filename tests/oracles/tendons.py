"""Random tendons on a chain in space, and their paths worked out with rotation matrices of SciPy."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from pliant.equations import spatial, tendon
from pliant.equations.symbols import TendonConstants, Tendons, TendonWorkspace

GUIDES = 4


def tendon_workspace(law, kind=float):
    """Scratch arrays for the tendons of `law`."""
    (count, size), guides = law.gain.shape, len(law.link)
    shapes = {"l": (count,), "gradient": (count, size), "p": (guides, 3), "u": (guides, 3), "beyond": (guides, size)}
    shapes |= {"T": (count,), "slope": (count,), "t": (size,), "A": (size, size)}
    return TendonWorkspace(*(np.zeros(shapes.get(f, (guides,)), kind) for f in TendonWorkspace._fields))


def random_tendons(rng, chain, *, friction=0.4, stiffness=2e3, pretension=2.0):
    """Three tendons with guides on random links, the first from the base part to the tip, and a cord along the arcs."""
    n, size = chain.n, len(chain.x)
    link = np.sort(rng.integers(-1, n, (3, GUIDES)), axis=1)
    link[0, 0], link[0, -1] = -1, n - 1
    point = np.concatenate([rng.uniform(-0.02, 0.02, (3, GUIDES, 2)), rng.uniform(0.0, 0.03, (3, GUIDES, 1))], axis=2)
    first, gain = np.array([0, 4, 8, 12, 12]), np.zeros((4, size))
    gain[3, : 2 * n] = rng.normal(0, 0.01, 2 * n)
    whole = np.full(4, 1.0)
    law = TendonConstants(
        stiffness * whole, pretension * whole,
        rng.uniform(0.1, 0.2, 4), gain, friction * whole, 1e-3 * whole, first, link.ravel(),
        point.reshape(-1, 3),
    )  # fmt: skip
    return at_rest(law, chain)


def at_rest(law, chain):
    """The same tendons, as long in the rest shape as they are there."""
    cords = measured(law, chain, np.zeros(len(chain.x)))
    return law._replace(rest_length=np.where(np.diff(law.first) > 1, cords.l, law.rest_length))


def measured(law, chain, x, kind=float):
    """The workspace of tendons at coordinates x."""
    work, cords = chain.work(kind), tendon_workspace(law, kind)
    spatial.pose_links(x, chain.body, work)
    tendon.measure_tendons(x, law, work, cords)
    return cords


def tendons(law, drive, kind=float):
    return Tendons(np.asarray(drive, float), law, tendon_workspace(law, kind))


def guide_positions(law, chain, x):
    """Positions (G, 3) of all guides by rotation vectors of SciPy, link by link."""
    turn, start = Rotation.from_matrix(chain.body.base), np.zeros(3)
    frames = [(turn, start)]
    for k in range(chain.n):
        start = start + chain.body.length[k] * turn.as_matrix()[:, 2]
        turn = turn * Rotation.from_matrix(chain.body.rest[k]) * Rotation.from_rotvec([*x[2 * k : 2 * k + 2], 0.0])
        if len(x) > 2 * chain.n:
            turn = turn * Rotation.from_rotvec([0.0, 0.0, x[2 * chain.n + k]])
        frames.append((turn, start))
    return np.array([
        frames[link + 1][1] + frames[link + 1][0].apply([aside, -across, along])
        for link, (aside, across, along) in zip(law.link, law.point, strict=True)
    ])  # fmt: skip


def path_lengths(law, chain, x):
    """Lengths (C,) of all tendons from `guide_positions`."""
    p = guide_positions(law, chain, x)
    return np.array([
        np.linalg.norm(np.diff(p[a:b], axis=0), axis=1).sum() + law.gain[c] @ x + (law.rest_length[c] if a == b else 0)
        for c, (a, b) in enumerate(zip(law.first[:-1], law.first[1:], strict=True))
    ])  # fmt: skip
