"""C functions of an exported model whose segments lengthen, or of a model in space.

The module `c_functions` does this for planar models of fixed length. The kernels of planar bodies that lengthen are
those of `equations.extension`, and of `equations.extension_memory` where segments have hysteresis; in space
`equations.spatial_extension_memory`.
"""

from __future__ import annotations

from typing import Any

from pliant.compiler.c import CWriter
from pliant.compiler.c_values import Real
from pliant.compiler.choose import AXIAL, SPATIAL, SPATIAL_AXIAL
from pliant.equations import (
    energy,
    extension,
    inertia,
    motion,
    spatial,
    spatial_points,
    spatial_springs,
    symbols,
    tendon,
)
from pliant.exporters.c_functions import Text, place
from pliant.mechanics import mechanics_of

AXIAL_STEPS: dict[type, dict[Any, Any]] = {symbols.AxialMemoryLaw: AXIAL}  # by the kind of hysteresis
SPATIAL_AXIAL_STEPS: dict[type, dict[Any, Any]] = {symbols.AxialMemoryLaw: SPATIAL_AXIAL}


def turn_matrix(x, y, z, R):  # type: ignore[no-untyped-def]  # a kernel
    """Write the rotation matrix of the rotation vector (x, y, z) [rad] to `R` (3, 3). The vector's length is at most 4
    rad.
    """
    square = x * x + y * y + z * z
    c2, c3, _, _ = spatial.stumpff(square)
    c1 = 1.0 - square * c3
    R[0, 0] = 1.0 - c2 * (y * y + z * z)
    R[1, 1] = 1.0 - c2 * (x * x + z * z)
    R[2, 2] = 1.0 - c2 * (x * x + y * y)
    R[0, 1] = c2 * x * y - c1 * z
    R[1, 0] = c2 * x * y + c1 * z
    R[0, 2] = c2 * x * z + c1 * y
    R[2, 0] = c2 * x * z - c1 * y
    R[1, 2] = c2 * y * z - c1 * x
    R[2, 1] = c2 * y * z + c1 * x


class ExtensibleText(Text):
    """Writer of the C functions of one planar model with segments that lengthen."""

    @property
    def instead(self) -> dict[Any, Any]:
        return {motion.step: extension.step} | AXIAL_STEPS.get(type(self.given.memory), {})

    def update(self) -> str:
        """Return the source of the C function that computes inertia and springs from the parameters."""
        w, n, body, joints = self.writer(), self.model.n, self.given.body, self.given.joints
        rod = self.model.mass_at == "rod"
        mass = [0.0, *place(self.model, "p", "link_mass")]
        centre = w.scratch("centre", (n + 1,))
        for k in range(n + 1):
            w.say(f"{centre[k]} = {w.number(0.5 if rod else 1.0)} * {body.l[k]};")
        w.call(inertia.body_constants, body.l, mass, centre, Real("p->tip_mass"), body.B, body.h)
        for k in range(n):
            if rod:
                square = f"{body.l[k + 1]} * {body.l[k + 1]}"
                w.say(f"{body.B[k + 1, k + 1]} += {mass[k + 1]} * {square} / {w.number(12.0)};")
            w.say(f"{joints.K[k]} = p->stiffness[{k}];")
            w.say(f"{joints.D[k]} = p->damping[{k}];")
            self.curved_spring(w, k, k)
        for s in range(self.model.size - n):
            self.segment(w, s, body.l)
        return self.function("void", "update", f"{self.prefix}_parameters *p", w)

    def energies(self, w: CWriter) -> list[tuple[Any, ...]]:
        parts = self.phi, self.w, self.given.body, self.given.joints, self.workspace(w)
        return [(extension.kinetic_energy, *parts), (energy.elastic_energy, self.phi, self.given.joints),
                (extension.gravity_energy, *parts)]  # fmt: skip


class SpatialText(Text):
    """Writer of the C functions of one model in space."""

    pose = 4

    @property
    def instead(self) -> dict[Any, Any]:
        pulled = dict.fromkeys((motion.step, spatial.step), tendon.step) if self.model.actuation.tendons else {}
        return SPATIAL | SPATIAL_AXIAL_STEPS.get(type(self.given.memory), {}) | pulled

    def held_springs(self, writer: CWriter, springs: Any, rows: dict[str, Any]) -> Any:  # noqa: ARG002  of the interface
        return springs._replace(theta0=writer.scratch("held_theta0", (self.model.size,)))

    def joint_angles(self) -> str:
        """Return the source of the C function that copies all joint coordinates."""
        w = self.writer()
        for i in range(self.model.size):
            w.say(f"q[{i}] = {self.phi[i]};")
        w.say("(void)p;")
        return self.reading("joint_angles", f"q[{self.model.size}]", w)

    def update(self) -> str:
        """Return the source of the C function that computes springs, inertia and rest frames from the parameters."""
        w, body = self.writer(), self.given.body
        w.say(f"{body.length[0]} = p->base_length;")
        for k in range(self.model.n):
            w.say(f"{body.length[k + 1]} = p->link_length[{k}];")
            self.joint(w, k)
            self.rod(w, k)
            turn = (Real(f"p->rest_turn[{k}][{i}]") for i in range(3))
            w.call(turn_matrix, *turn, body.rest[k])
        for s in range(len(self.model.extensions)):
            self.segment(w, s, body.length)
        self.cap(w)
        w.call(turn_matrix, *(Real(f"p->base_tilt[{i}]") for i in range(3)), body.base)
        return self.function("void", "update", f"{self.prefix}_parameters *p", w)

    def joint(self, w: CWriter, k: int) -> None:
        """Write C code that sets the springs and dampers of joint k: two for bending and, if the joint twists, one for
        twist.
        """
        n, joints = self.model.n, self.given.joints
        rows = {2 * k: "", 2 * k + 1: "p->stiffness_ratio * ", 2 * n + k: "p->twist_ratio * "}
        for i, ratio in rows.items():
            if i >= joints.hardening.shape[1] - joints.tied.shape[1]:
                continue
            w.say(f"{joints.K[i]} = {ratio}p->stiffness[{k}];")
            w.say(f"{joints.D[i]} = {ratio}p->damping[{k}];")
            if i == 2 * k:
                self.curved_spring(w, k, i)
                continue
            for row in joints.hardening[:, i]:
                w.say(f"{row} = {w.number(0.0)};")

    def rod(self, w: CWriter, k: int) -> None:
        """Write C code that sets mass and moments of inertia of link k, a round rod."""
        body, m, l = self.given.body, f"p->link_mass[{k}]", f"p->link_length[{k}]"
        w.say(f"{body.mass[k]} = {m};")
        w.say(f"{body.centre[k]} = {w.number(0.5)} * {l};")
        square = "p->radius * p->radius"
        w.say(f"{body.lateral[k]} = {m} * ({l} * {l} / {w.number(12.0)} + {square} / {w.number(4.0)});")
        w.say(f"{body.axial[k]} = {w.number(0.5)} * {m} * {square};")

    def cap(self, w: CWriter) -> None:
        """Write C code that adds the tip mass to the last link."""
        body, k = self.given.body, self.model.n - 1
        m, l, away = f"p->link_mass[{k}]", f"p->link_length[{k}]", w.local("away")
        w.say(f"{body.mass[k]} = {m} + p->tip_mass;")
        w.say(f"{away} = {l} - {body.centre[k]};")
        w.say(f"{body.lateral[k]} += {m} * p->tip_mass / {body.mass[k]} * {away} * {away};")
        w.say(f"{body.centre[k]} = ({m} * {body.centre[k]} + p->tip_mass * {l}) / {body.mass[k]};")
        w.say(f"{body.lateral[k]} += p->tip_inertia;")
        w.say(f"{body.axial[k]} += {w.number(2.0)} * p->tip_inertia;")

    def posed(self) -> tuple[CWriter, Any]:
        """Return a writer for a C function, and scratch arrays. The function begins by computing the poses of all links
        into these arrays.
        """
        w = self.writer()
        work = self.workspace(w)
        w.call(spatial.pose_links, self.phi, self.given.body, work)
        return w, work

    def tips(self) -> str:
        """Return the source of the C function that computes the positions of the link tips."""
        w, work = self.posed()
        for k in range(self.model.n):
            for i in range(3):
                along = f"{work.length[k + 1]} * {work.R[k + 1, i, 2]}"
                w.say(f"tip[{k}][{i}] = {work.r[k + 1, i]} + {along};")
        return self.reading("tips", f"tip[{self.model.n}][3]", w)

    def stations(self) -> str:
        """Return the source of the C function that computes the position of each observed point and the angle of its
        link from +z.
        """
        w, work = self.posed()
        for k, point in enumerate(self.model.points):
            spot = w.scratch(f"place_{k}", (3,))
            lengths = (float(point.aside), float(point.across), float(point.along))
            w.call(spatial_points.point_position, point.link, *lengths, work, spot)
            for i in range(3):
                w.say(f"pose[{k}][{i}] = {spot[i]};")
            x, y, z = work.R[point.link + 1, :, 2]
            w.say(f"pose[{k}][3] = atan2{w.suffix}(sqrt{w.suffix}({x} * {x} + {y} * {y}), {z});")
        return self.reading("stations", f"pose[{len(self.model.points)}][4]", w)

    def energies(self, w: CWriter) -> list[tuple[Any, ...]]:
        g, work = self.given, self.workspace(w)
        return [(spatial_points.kinetic_energy, self.phi, self.w, g.body, work),
                (spatial_springs.elastic_energy, self.phi, g.joints),
                (spatial_points.gravity_energy, self.phi, g.body, work)]  # fmt: skip


TEXTS = {symbols.Body: Text, symbols.ExtensibleBody: ExtensibleText, symbols.SpatialBody: SpatialText}


def text_of(model: Any, prefix: str, *, single: bool) -> Text:
    """Return the writer of a model's C functions, for a planar model with or without segments that lengthen, or a model
    in space.
    """
    return TEXTS[type(mechanics_of(model).body)](model, prefix, single=single)
