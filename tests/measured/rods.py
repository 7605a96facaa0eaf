"""Compare chains in space with rods: the 45 degree bend, the roll-up, a helix, 500 static shapes and 10 free decays.

The shapes and decays are those of a Cosserat rod simulated by another program, `../shared/data/spatial_rod_reference`.
A chain has n joints in the middle of n segments; each joint swings and twists. The parameters of the chain are those of
the rod; nothing is fitted. Errors are distances of the tip in % of the length.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from pliant.compiler.choose import twin
from pliant.compiler.trace import spatial_workspace
from pliant.equations import spatial, spatial_points, spatial_springs
from pliant.equations.elastic import ROWS
from pliant.equations.symbols import SpatialBody, SpatialJoints, SpatialWorkspace

Array = np.ndarray
DATA = Path()  # a test sets the folder of the reference
ALONG_X = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # a base whose tangent z is x of the file
BEND = {300.0: (58.60, 22.14, 40.36), 450.0: (52.05, 18.40, 48.57), 600.0: (46.90, 15.56, 53.60)}  # load, tip
PERIOD = 0.005  # s, between rows of a decay
TINY = 1e-20


class Rod(NamedTuple):
    """A straight round rod, SI units."""

    length: float
    radius: float
    modulus: float
    poisson: float
    density: float

    @property
    def bending(self) -> float:
        """E I, N m^2."""
        return self.modulus * np.pi * self.radius**4 / 4

    @property
    def torsion(self) -> float:
        """G J, N m^2."""
        return self.bending / (1 + self.poisson)


RODS = {
    "SpringSteel": Rod(0.6, 0.8e-3, 200e9, 0.33, 7870.0),
    "TPU": Rod(0.4, 5e-3, 70e6, 0.40, 1200.0),
}


class Chain(NamedTuple):
    """The arrays that the kernels take."""

    body: SpatialBody
    joints: SpatialJoints

    @property
    def n(self) -> int:
        """Number of links."""
        return len(self.body.mass)

    def work(self, kind: type = float) -> SpatialWorkspace:
        """Scratch arrays."""
        return spatial_workspace(self.n, len(self.joints.K) // self.n, kind=kind)


def chain(n: int, length: float, bending: float, torsion: float, *, turn: float = 0.0) -> Chain:
    """Return a chain without mass; in its rest shape every joint turns by `turn` [rad] in the plane x-y."""
    links = np.full(n + 1, length / n)
    links[0] = links[-1] = length / n / 2
    rest = np.tile(Rotation.from_rotvec([0.0, turn, 0.0]).as_matrix(), (n, 1, 1))
    none = np.zeros(n)
    K = np.append(np.full(2 * n, bending), np.full(n, torsion)) * n / length
    joints = SpatialJoints(
        0.0, np.zeros(3 * n), K, np.zeros(3 * n), np.zeros((ROWS, 3 * n)), np.zeros(n), np.zeros((0, 3)),
        np.zeros((n, 0)),
    )
    tendons = *np.zeros((2, 0, 3 * n)), *np.zeros((5, 0)), np.zeros((3 * n, n + 1)), np.zeros((n + 1, 0))
    return Chain(SpatialBody(links, none, none, none, none, rest, ALONG_X, 0.0, 0.0, 0.0, *tendons), joints)


def heavy(rod: Rod, n: int, gravity: Array, damping_time: float = 0.0) -> Chain:
    """Return the chain of a rod; damping_time [s] is the ratio of its damping to its stiffness."""
    light = chain(n, rod.length, rod.bending, rod.torsion)
    links, area = light.body.length[1:], np.pi * rod.radius**2
    mass, moment = rod.density * area * links, rod.density * area * rod.radius**2 / 4 * links
    gx, gy, gz = map(float, gravity)
    body = light.body._replace(
        mass=mass, centre=links / 2, lateral=mass * links**2 / 12 + moment, axial=2 * moment, gx=gx, gy=gy, gz=gz
    )
    return Chain(body, light.joints._replace(D=damping_time * light.joints.K))


def of_kind(record: tuple, kind: type) -> tuple:
    """Return a record with numbers of a given type."""
    return type(record)(*(np.asarray(a, kind) if isinstance(a, np.ndarray) else kind(a) for a in record))


class Statics:
    """Equilibria of a chain by Newton's method on the kernels, with slopes by complex steps."""

    def __init__(self, chain: Chain) -> None:
        self.chain, self.work, self.size = chain, chain.work(complex), 3 * chain.n
        self.joints, self.still = of_kind(chain.joints, complex), np.zeros(self.size, complex)
        self.kernels = [twin(kernel) for kernel in (
            spatial.pose_links, spatial_springs.joint_torques, spatial.inertial_forces, spatial_points.add_pose_loads,
        )]  # fmt: skip

    def forces(self, x: Array, body: SpatialBody, load: Array) -> Array:
        """Return the sum of springs, weight and loads at x, complex, N m."""
        pose, springs, weight, add_loads = self.kernels
        work = self.work
        pose(x, body, work)
        springs(x, self.still, self.joints, self.still, 0.0, work.t)
        weight(x, self.still, body, work, work.f)
        left = work.t - work.f
        add_loads(load, body, work, left)
        return left

    def equilibrium(self, load: Array, parts: int = 4) -> Array:
        """Return coordinates at equilibrium; load (n + 1, 3, 5) and weight grow in equal parts."""
        x, body = np.zeros(self.size), self.chain.body
        for k in range(1, parts + 1):
            share = k / parts
            part = of_kind(body._replace(gx=share * body.gx, gy=share * body.gy, gz=share * body.gz), complex)
            pull = (share * load).astype(complex)
            for _ in range(60):
                moved = [self.forces(x + 1j * TINY * e, part, pull) for e in np.eye(self.size)]
                slope = np.stack([f.imag for f in moved], axis=1) / TINY
                change = -np.linalg.solve(slope, moved[0].real)
                size = np.abs(change).max()
                x = x + change * min(1.0, 0.5 / max(size, 1e-300))
                if size < (1e-11 if k == parts else 1e-3):
                    break
            else:
                raise RuntimeError(f"no equilibrium at {100 * share:.0f} % of the load")
        return x

    def tip(self, x: Array) -> Array:
        """Position (3,) of the tip, m."""
        self.kernels[0](x.astype(complex), of_kind(self.chain.body, complex), self.work)
        return (self.work.r[-1] + self.chain.body.length[-1] * self.work.R[-1, :, 2]).real


def add_wrench(load: Array, link: int, along: float, wrench: Array, share: float = 1.0) -> None:
    """Add moment (first three) and force (last three) at a point on the axis of a link, 0 the first behind a joint."""
    load[link + 1, :, 2] += share * along * wrench[3:]
    load[link + 1, :, 3] += share * wrench[3:]
    load[link + 1, :, 4] += share * wrench[:3]


def wrenches(chain: Chain, middle: Array, tip: Array) -> Array:
    """Return loads of wrenches at half the length and at the tip; a wrench at a joint acts half on either side."""
    load, n, length = np.zeros((chain.n + 1, 3, 5)), chain.n, chain.body.length
    if n % 2:
        add_wrench(load, n // 2, 0.0, middle, 0.5)
        add_wrench(load, n // 2 - 1, length[n // 2], middle, 0.5)
    else:
        add_wrench(load, n // 2 - 1, length[n // 2] / 2, middle)
    add_wrench(load, n - 1, length[-1], tip)
    return load


def bend(n: int, force: float) -> Array:
    """Return the tip of the 45 degree bend under a force out of its plane: radius 100, section 1 x 1, E 1e7, G 0.5e7.
    """
    arc = chain(n, 25 * np.pi, 1e7 / 12, 0.5e7 * 0.1406, turn=np.pi / 4 / n)
    load = np.zeros((n + 1, 3, 5))
    add_wrench(load, n - 1, arc.body.length[-1], np.array([0, 0, 0, 0, 0, force]))
    statics = Statics(arc)
    return statics.tip(statics.equilibrium(load, 6))


def end_moment(n: int, bending: float, moment: Array) -> tuple[Array, Array]:
    """Return the tip of a straight rod of length 1 along x under a moment at its end, and the exact tip.

    The tangent turns about the moment by |moment| / bending for each unit of length: a circle or a helix.
    """
    rod, load = chain(n, 1.0, bending, 0.6 * bending), np.zeros((n + 1, 3, 5))
    add_wrench(load, n - 1, 0.0, np.append(moment, np.zeros(3)))
    statics = Statics(rod)
    rate = np.linalg.norm(moment) / bending
    axis, tangent = moment / np.linalg.norm(moment), np.array([1.0, 0.0, 0.0])
    along = (tangent @ axis) * axis
    round_axis = np.sin(rate) * (tangent - along) + (1 - np.cos(rate)) * np.cross(axis, tangent)
    return statics.tip(statics.equilibrium(load, 10)), along + round_axis / rate


def static_shapes(rod: str) -> Iterator[tuple[Array, Array, Array, Array]]:
    """Return gravity, wrenches at the middle and the tip, and the tip, of every static shape of a rod."""
    with (DATA / f"statics_{rod}.csv").open(encoding="utf-8") as file:
        rows = list(csv.reader(file))[2:]
    for k in range(0, len(rows), 6):
        values = np.array([row[1:] for row in rows[k : k + 6]], dtype=float)
        yield values[3:, 0], values[:, 1], values[:, 2], values[3:, -1]


def static_errors(name: str, n: int, every: int = 1) -> Array:
    """Return distances of tips, % of the length."""
    rod, errors = RODS[name], []
    for gravity, middle, tip, expected in list(static_shapes(name))[::every]:
        made = heavy(rod, n, gravity)
        statics = Statics(made)
        found = statics.tip(statics.equilibrium(wrenches(made, middle, tip)))
        errors.append(100 * np.linalg.norm(found - expected) / rod.length)
    return np.array(errors)


def free_decay(name: str, number: int, n: int, seconds: float = 4.0) -> tuple[Array, Array]:
    """Return tips (T, 3) of a released chain and of the rod, every 5 ms.

    The `damping ratio` of the files is the ratio of damping to stiffness, in seconds.
    """
    rows = np.loadtxt(DATA / f"release_{name}_{number}.txt")
    made = heavy(RODS[name], n, rows[0, 10:13], rows[0, 0])
    x = Statics(made).equilibrium(wrenches(made, rows[1, 1:7], rows[1, 7:13]))
    v, still, work, inner = np.zeros(3 * n), np.zeros(3 * n), made.work(), 10
    step, pose = twin(spatial.step), twin(spatial.pose_links)
    tips = np.empty((round(seconds / PERIOD) + 1, 3))
    for row in tips:
        pose(x, made.body, work)
        row[:] = work.r[-1] + made.body.length[-1] * work.R[-1, :, 2]
        for _ in range(inner):
            step(x, v, PERIOD / inner, still, *made, work)
    return tips, rows[2 : 2 + len(tips), 10:13]


def decay_errors(name: str, number: int, n: int) -> tuple[float, float]:
    """Return the rms error of the tip over the first second in % of its amplitude, and of the first frequency, %.

    The amplitude is the largest distance from the mean of the motion's last second.
    """
    found, expected = free_decay(name, number, n)
    second = round(1.0 / PERIOD) + 1
    amplitude = np.linalg.norm(expected - expected[-second:].mean(axis=0), axis=1).max()
    rms = np.sqrt(((found - expected)[:second] ** 2).sum(axis=1).mean())
    return 100 * rms / amplitude, 100 * (frequency(found, expected) / frequency(expected, expected) - 1)


def frequency(tips: Array, reference: Array) -> float:
    """Return the first frequency, Hz: the highest peak along the main direction of the reference motion."""
    direction = np.linalg.svd(reference - reference.mean(axis=0), full_matrices=False)[2][0]
    moved = tips @ direction
    spectrum = np.abs(np.fft.rfft((moved - moved.mean()) * np.hanning(moved.size), 64 * moved.size))
    return float(np.argmax(spectrum) / (64 * moved.size * PERIOD))
