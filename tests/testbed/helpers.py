"""Small tools of the test bed's tests: the rod's matrices, and chains that share nothing with the rod."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from pliant.compiler.choose import twin
from pliant.testbed.rod import build_body, material_fields
from pliant.testbed.stepping import _clock, _work, rest_state
from pliant.testbed.stepping_loops import gather

NO_OBSTACLE = np.zeros((0, 7))


def gradient_and_hessian(p, x, load, state=None, obstacles=NO_OBSTACLE):
    """Gradient (2V-2,) and Hessian of the static potential at the nodes `x`."""
    body = build_body(p)
    state = state or rest_state(body)
    work = _work(body)
    clock = _clock(body, 1e6, static=True)
    assert twin(gather)(x, np.array(load, float), body, obstacles, state, clock, 1.0, work)
    n = work.gradient.size
    dense = np.zeros((n, n))
    for d in range(6):
        dense += np.diag(work.band[d:, d], -d) + (np.diag(work.band[d:, d], d) if d else 0.0)
    return work.gradient.copy(), dense


def mass_matrix(p):
    body = build_body(p)
    mass = np.diag(np.repeat(body.mass[1:], 2))
    mass[-4:, -4:] += body.cap_mass
    return mass


def rod_frequencies(p, count=3):
    """Natural frequencies about the rest shape, Hz."""
    state = rest_state(build_body(p))
    _, stiffness = gradient_and_hessian(p, state.x.copy(), (0.0, 0.0, 0.0, 0.0))
    values = eigh(stiffness, mass_matrix(p), eigvals_only=True, subset_by_index=[0, count - 1])
    return np.sqrt(values) / (2.0 * np.pi)


def hinge_chain(p, links):
    """Rigid links with joints in the middle of equal segments: a stub, whole links, half a link at the tip.

    Returns lengths, joint stiffness, rest turns, moment per pressure and link masses.
    """
    h = p.length / links
    f = material_fields(p, (np.arange(links) + 0.5) * h)
    length = np.full(links, h)
    length[-1] = h / 2
    return length, f["stiffness"] / h, f["rest_curvature"] * h, f["gain"], p.mass * length / p.length


def chain_statics(p, links, load):
    """Nodes at the ends of the segments under pressure, tip force and weight: Newton in absolute link angles."""
    length, stiff, rest, gain, mass = hinge_chain(p, links)
    place = (np.arange(links) + 0.5) / links
    push = sum(pressure * c.gain * gain * ((place > c.start) & (place < c.stop))
               for c, pressure in zip(p.chambers, load[:-3], strict=True))  # fmt: skip
    beyond = np.cumsum(mass[::-1])[::-1] - mass / 2  # mass that a link carries, half its own included
    force = np.array(load[-3:-1]) + np.outer(beyond, p.gravity)
    phi = np.cumsum(rest)
    for _ in range(60):
        torque = stiff * (np.diff(phi, prepend=0.0) - rest) - push
        along = -np.sin(phi) * force[:, 0] + np.cos(phi) * force[:, 1]
        across = -np.cos(phi) * force[:, 0] - np.sin(phi) * force[:, 1]
        g = torque - np.append(torque[1:], 0.0) - length * across
        k = np.diag(stiff + np.append(stiff[1:], 0.0) + length * along)
        k -= np.diag(stiff[1:], 1) + np.diag(stiff[1:], -1)
        step = np.linalg.solve(k, g)
        phi = phi - step * min(1.0, 0.2 / np.abs(step).max())
        if np.abs(step).max() < 1e-12:
            break
    h = length[0]
    direction = np.column_stack([-np.sin(phi), np.cos(phi)])
    stub = np.array([[0.0, h / 2]])
    joint = np.vstack([stub, stub + np.cumsum(h * direction[:-1], axis=0)])
    return np.vstack([[0.0, 0.0], joint + h / 2 * direction])


def chain_modes(p, links=150):
    """First two frequencies of a hinge chain about its bent rest shape, Hz; the cap as points of its arc."""
    length, stiff, rest, _, mass = hinge_chain(p, links)
    phi = np.cumsum(rest)
    normal = np.column_stack([-np.cos(phi), -np.sin(phi)])
    tip = np.zeros((links + 1, 2, links))  # of the links' far ends, derivative by the link angles
    for k in range(links):
        tip[k + 1 :, :, k] = length[k] * normal[k]
    middle = 0.5 * (tip[1:] + tip[:-1])
    m = np.einsum("i,iak,ial->kl", mass, middle, middle, optimize=True) + np.diag(mass * length**2 / 12)
    if p.cap_mass:
        arc = (np.arange(40) + 0.5) / 40 * p.cap_length
        place = phi[-1] + p.cap_curvature * arc / 2
        chord = 2 * np.sin(p.cap_curvature * arc / 2) / p.cap_curvature
        points = np.repeat(tip[-1][None], 40, axis=0)
        points[:, :, -1] -= chord[:, None] * np.column_stack([np.cos(place), np.sin(place)])
        m += p.cap_mass / 40 * np.einsum("iak,ial->kl", points, points, optimize=True)
    relative = np.eye(links) - np.eye(links, k=-1)
    stiffness = relative.T @ np.diag(stiff) @ relative
    return np.sqrt(eigh(stiffness, m, eigvals_only=True, subset_by_index=[0, 1])) / (2 * np.pi)
