"""C functions of an exported planar model whose segments lengthen.

The kernels are those of `equations.extension`, and of `equations.extension_memory` where segments have hysteresis.
"""

from __future__ import annotations

from typing import Any

from pliant.compiler.c import CWriter
from pliant.compiler.c_values import Real
from pliant.compiler.choose import AXIAL
from pliant.equations import extension, inertia, motion, observation, symbols
from pliant.equations.energy import elastic_energy
from pliant.exporters.c_functions import LIMITS, Text, place


class ExtensibleText(Text):
    """Writer of the C functions of one planar model with segments that lengthen."""

    def writer(self) -> CWriter:
        instead: dict[Any, Any] = {motion.step: extension.step} | (AXIAL if self.model.memory.has_axial else {})
        return CWriter(self.single, LIMITS if self.single else {}, f"{self.prefix}_", instead)

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
            if any(e.curved for e in self.model.extensions):
                self.curved_spring(w, s, n + s, "axial_")
        return self.function("void", "update", f"{self.prefix}_parameters *p", w)

    def placed(self) -> tuple[CWriter, Any]:
        """Return a writer for a C function, and scratch arrays. The function begins by computing directions, stretches
        and joints of all links into these arrays.
        """
        w, length = self.writer(), self.given.body.l
        links = w.scratch("links", (5, self.model.n + 1))
        chain = symbols.ObservedChain(length[0], length[1:], self.given.body.share)
        w.call(observation.place_links, self.phi, Real("p->base_angle"), chain, links)
        return w, links

    def tips(self) -> str:
        """Return the source of the C function that computes the positions of the link tips."""
        w, links = self.placed()
        for k in range(self.model.n):
            for axis in range(2):
                end = w.call(observation.position, axis, k, self.given.body.l[k + 1], 0.0, links)
                w.say(f"tip[{k}][{axis}] = {end};")
        return self.reading("tips", f"tip[{self.model.n}][2]", w)

    def stations(self) -> str:
        """Return the source of the C function that computes the position of each observed point and the absolute angle
        of its link.
        """
        w, links = self.placed()
        for k, point in enumerate(self.model.points):
            for axis in range(2):
                spot = w.call(observation.position, axis, point.link, float(point.along), float(point.across), links)
                w.say(f"pose[{k}][{axis}] = {spot};")
            w.say(f"pose[{k}][2] = {self.phi[point.link] if point.link >= 0 else 'p->base_angle'};")
        return self.reading("stations", f"pose[{len(self.model.points)}][3]", w)

    def energy(self) -> str:
        """Return the source of the C function that computes kinetic, elastic and gravitational energy."""
        w, g = self.writer(), self.given
        parts = self.phi, self.w, g.body, g.joints, self.workspace(w)
        w.say(f"joule[0] = {w.call(extension.kinetic_energy, *parts)};")
        w.say(f"joule[1] = {w.call(elastic_energy, self.phi, g.joints)};")
        w.say(f"joule[2] = {w.call(extension.gravity_energy, *parts)};")
        return self.reading("energy", "joule[3]", w)

    def linearise(self) -> str:
        """Return an empty text, since the C code of a body that lengthens has no function for linearisation.

        The export target `state_space` linearises such a model.
        """
        return ""
