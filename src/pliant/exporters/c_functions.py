"""C functions of an exported planar model, translated from the same kernels that simulate it in Python.

The kernels of `pliant.Stepper` are interpreted on the names of two C structs, state and parameters.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pliant.compiler.c import CWriter
from pliant.compiler.c_values import Real, cells
from pliant.compiler.trace import CURVED
from pliant.equations import energy, inertia, laws, motion, observation, symbols
from pliant.equations.elastic import ROWS, TERMS
from pliant.equations.spring_terms import SPRING_BOUND, SPRING_TERMS
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.model.extension import CURVES
from pliant.model.features import named
from pliant.model.parts import declared
from pliant.numerics.ldl import ldl_solve
from pliant.simulation import march_loops
from pliant.simulation.chamber_course import lag_of
from pliant.simulation.pressure_loops import UNLIMITED

Array = np.ndarray
IN_SPACE = ("length", "mass", "centre", "lateral", "axial", "rest", "base")  # derived fields of the body
COMPUTED = {  # by `update` from the other parameters: fields of inertia and springs for each kind of body
    symbols.Body: ("B", "I", "h"), symbols.ExtensibleBody: ("K", "D", "B", "h"),
    symbols.SpatialBody: ("K", "D", *IN_SPACE),
}
DERIVED = (*dict.fromkeys(name for own in COMPUTED.values() for name in own), "hardening")  # all of them
FORM = 5  # index of the law's number in a chamber's constants, which is fixed in the code
UNIT = {  # of each parameter; one unit for each column where they differ
    **{d.name: d.quantity.unit for d in declared()}, "dead_time": "s", "valve": "s, s, Pa/s, Pa/s",
    "rubber": "1, s, Pa, s, 1", "boucwen": "1, 1/rad^n, 1/rad^n, 1", "tendon_stiffness": "N/m", "beyond": "1",
    "chord": "m", "share": "1", "tied": "1",
}
LIMITS = {  # in place of constants of these names, in single precision: what it can reach, and numbers that it can hold
    "AGREE": 2e-6,  # rad, see `equations.memory`
    "AGREED": 1e-5, "NEAR": 1e-3, "FAR": 1e30,  # see `equations.tendon`
    "NO_STIFFNESS": 1e-30,  # N m/rad, see `equations.spatial_springs`
}


class Names(NamedTuple):
    """A model's constants as C expressions, such as ``p->damping[0]``, or as plain numbers where the C code fixes a
    value.
    """

    body: Any  # `symbols.Body`, or `SpatialBody`
    joints: Any  # `symbols.Joints`, or `SpatialJoints`
    memory: symbols.MemoryLaw
    drives: march_loops.Drives


def parameters(model: Model) -> dict[str, Array]:
    """Return the fields of the C struct of parameters as {name: array}, in SI units."""
    return {name: value for name, value in constants(model).items() if value.size}


def constants(model: Model) -> dict[str, Array]:
    """Return all constants of a model that the simulation kernels take as {name: array}, in SI units. The array of a
    feature that the model lacks may be empty.
    """
    actuation = model.actuation.kernel()
    memory = model.memory.law()
    lags = np.array([lag_of(c.valve) for c in model.chambers])
    branches = {f: getattr(memory, f) for f in memory._fields if not f.startswith("boucwen")}
    stored: dict[str, Any] = {
        "link_length": model.link_length, "link_mass": model.link_mass, "tip_mass": model.tip_mass,
        "tip_inertia": model.tip_inertia,
        "stiffness": model.stiffness, "damping": model.damping,
        **{t: getattr(model, t) for t in (*SPRING_TERMS, SPRING_BOUND)},
        **rest_shape(model), "base_length": model.base_length, "gravity": model.gravity,
        "torque": actuation.law, "joint_gain": actuation.gain, "valve": lags,
        "rubber": actuation.rubber[:, :FORM], **branches,
        "boucwen": np.array([getattr(memory, f) for f in memory._fields if f not in branches]),
        "dead_time": np.array([c.valve.dead_time for c in model.chambers]),
    }
    derived = {"hardening": np.zeros((ROWS, mechanics_of(model).joints.hardening.shape[1]))} | derived_constants(model)
    return {k: np.asarray(v, dtype=float) for k, v in (stored | derived).items()}


def rest_shape(model: Model) -> dict[str, Any]:
    """Return the parameters of a model's rest shape and of its extensible segments as {name: value}. For a model in
    space the dict also holds the radius, the stiffness ratios, and the constants of tendons.
    """
    chain = mechanics_of(model)
    curves = CURVES if chain.laws & CURVED else ()
    segments = model.extensions
    axial = {f"axial_{field}": np.array([getattr(e, field) or 0.0 for e in segments])
             for field in ("stiffness", "damping", *curves)}  # fmt: skip
    beside = {f: v for f, v in chain.body._asdict().items() if f not in (*DERIVED, "l", "gx", "gy", "gz")}
    return {**chain.shape_constants, **axial, **beside}


def derived_constants(model: Model) -> dict[str, Any]:
    """Return {name: array} of the constants that the C code computes from other parameters."""
    chain = mechanics_of(model)
    fields = chain.joints._asdict() | chain.body._asdict()
    return {name: fields[name] for name in COMPUTED[type(chain.body)]}


def place(model: Model, who: str, field: str) -> Any:
    """Return the C expression of each element of a parameter, such as ``p->stiffness[0]``: an array of expressions, or
    a single one for a scalar parameter.

    `who` is the name of the struct pointer, e.g. "p".
    """
    value = constants(model)[field]
    return cells(f"{who}->{field}", value.shape) if value.ndim else Real(f"{who}->{field}")


def chain_names(model: Model) -> tuple[Any, Any]:
    """Return the inertia constants and the spring constants of a model as C expressions, grouped like the arguments of
    the kernels.
    """
    def of(field: str) -> Any:
        return place(model, "p", field)

    gravity, kind = of("gravity"), type(mechanics_of(model).body)
    if kind is symbols.ExtensibleBody:
        length = np.array([of("base_length"), *of("link_length")], dtype=object)
        inertia_of = {"B": of("B"), "h": of("h"), "tip_inertia": of("tip_inertia")}
        body: Any = symbols.ExtensibleBody(l=length, share=of("share"), gx=gravity[0], gy=gravity[1], **inertia_of)
        springs = [of(f) for f in ("base_angle", "rest_angle", "K", "D", "hardening", "rest_angle")]
        return body, symbols.ExtensibleJoints(*[*springs, mechanics_of(model).joints.rest])
    if kind is symbols.Body:
        springs = [of(f) for f in ("base_angle", "rest_angle", "stiffness", "damping", "hardening", "rest_angle")]
        return symbols.Body(of("B"), of("I"), of("h"), gravity[0], gravity[1]), symbols.Joints(*springs)
    weight = dict(zip(("gx", "gy", "gz"), gravity, strict=True))
    body = symbols.SpatialBody(*(weight[f] if f in weight else of(f) for f in symbols.SpatialBody._fields))
    tied = {f: of(f) for f in ("K", "D", "hardening", "tied")}
    return body, mechanics_of(model).joints._replace(**tied)


def names(model: Model) -> Names:
    """Return all constants of a model as C expressions, grouped like the arguments of the kernels."""
    C = model.actuation.count

    def of(field: str) -> Any:
        return place(model, "p", field)

    body, joints = chain_names(model)
    law = model.memory.law()
    smooth = [f for f in law._fields if f.startswith("boucwen")]
    memory = law._replace(**{f: of(f) for f in law._fields if f not in smooth})
    if law.boucwen_share:
        memory = memory._replace(**dict(zip(smooth, of("boucwen"), strict=True)))
    valve, rubber = of("valve"), of("rubber")
    for c, chamber in enumerate(model.chambers):
        lag = lag_of(chamber.valve)
        for k in range(4):
            unlimited = k >= 2 and lag[k] >= UNLIMITED
            valve[c, k] = lag[k] if unlimited or (k < 2 and not any(lag[:2])) else valve[c, k]
        kernel = chamber.kernel()[1:]
        rubber[c] = [rubber[c, k] if kernel[k - k % 2] else kernel[k] for k in range(FORM)]
    forms = model.actuation.kernel().rubber[:, FORM:].astype(object)
    actuation = symbols.ActuationConstants(of("torque"), of("joint_gain"), np.hstack([rubber, forms]))
    drives = march_loops.Drives(actuation, valve, cells("s->pressure", (C,)), cells("s->chamber", (C, 2)))
    return Names(body, joints, memory, drives)


class Text:
    """Writer of the C functions of one planar model.

    Attributes
    ----------
    pose : int
        Count of numbers that describe an observed point: its position and an angle.
    """

    pose = 3

    def __init__(self, model: Model, prefix: str, *, single: bool) -> None:
        self.model, self.prefix, self.single = model, prefix, single
        self.kind = f"{prefix}_real"
        self.given = names(model)
        self.phi, self.w = cells("s->angle", (model.size,)), cells("s->rate", (model.size,))
        self.remembered = mechanics_of(model).memory_shape

    @property
    def instead(self) -> dict[Any, Any]:
        """Kernels of planar chains of fixed length, with the kernels that replace them for this kind of model."""
        return {}

    def writer(self) -> CWriter:
        """Return a writer for a new C function whose body is still empty."""
        return CWriter(self.single, LIMITS if self.single else {}, f"{self.prefix}_", self.instead)

    def workspace(self, writer: CWriter) -> Any:
        """Declare the kernels' scratch arrays as local variables of a C function, and return them."""
        example = mechanics_of(self.model).workspace()
        return type(example)(*(writer.scratch(f"work_{f}", v.shape) for f, v in example._asdict().items()))

    def past(self, writer: CWriter) -> symbols.Past:
        """Return the hysteresis argument of the kernels: the law, the states in the C struct, and scratch arrays, which
        are declared as local variables of the C function.
        """
        example, joints = mechanics_of(self.model).held(), self.given.joints
        arrays = {f: v for f, v in example._asdict().items() if isinstance(v, np.ndarray)}
        rows = {f: writer.scratch(f"held_{f}", v.shape) for f, v in arrays.items()}
        springs = joints._replace(**{f: rows[f] for f in ("theta0", "K", "rest", "line") if f in rows})
        springs = self.held_springs(writer, springs, rows)
        memory = cells("s->memory", self.remembered)
        return symbols.Past(self.given.memory, memory, example._replace(springs=springs, **rows))

    def held_springs(self, writer: CWriter, springs: Any, rows: dict[str, Array]) -> Any:  # noqa: ARG002  of the interface
        """Return the spring constants during a step with hysteresis, and complete the scratch arrays `rows` of this
        step, by name.
        """
        if "rest" not in rows:
            rows["K"][self.model.n :] = self.given.joints.K[self.model.n :]  # of segments, which have no hysteresis
        return springs

    def step(self) -> str:
        """Return the source of the C function for one time step of length h under constant commands. It returns 0, or
        -1 on failure.
        """
        w, g = self.writer(), self.given
        command = cells("command", (self.model.actuation.count,))
        work = self.workspace(w)
        if self.model.memory:
            failed = w.call(
                march_loops.held_step_with_memory, self.phi, self.w, Real("h"), command, g.drives,
                (g.body, g.joints), self.past(w), work,
            )
        else:
            failed = w.call(
                march_loops.held_step, self.phi, self.w, Real("h"), command, g.drives, g.body, g.joints, work
            )
        w.say(f"return {failed} < 0 ? -1 : 0;")
        return self.function(
            "static int", "move", f"{self.state}, {self.constants}, {self.kind} h, const {self.kind} *command", w
        )

    @property
    def state(self) -> str:
        """Declaration of the state as an argument of a C function."""
        return f"{self.prefix}_state *s"

    @property
    def constants(self) -> str:
        """Declaration of the parameters as an argument of a C function."""
        return f"const {self.prefix}_parameters *p"

    def function(self, returns: str, name: str, arguments: str, writer: CWriter) -> str:
        """Return the source of a C function with the given result type, name and arguments, and the
        body in `writer`.
        """
        return f"{returns} {self.prefix}_{name}({arguments})\n{{\n{writer.body(self.kind)}\n}}\n"

    def reading(self, name: str, output: str, writer: CWriter) -> str:
        """Return the source of a C function that reads the state and writes its results to the array `output`."""
        return self.function("void", name, f"const {self.state}, {self.constants}, {self.kind} {output}", writer)

    def update(self) -> str:
        """Return the source of the C function that computes the constants of inertia and of the nonlinear springs from
        the masses, lengths and stiffness parameters.
        """
        w, n, rod = self.writer(), self.model.n, self.model.mass_at == "rod"
        l, m = place(self.model, "p", "link_length"), place(self.model, "p", "link_mass")
        centre = w.scratch("centre", (n,))
        for k in range(n):
            w.say(f"{centre[k]} = {w.number(0.5 if rod else 1.0)} * {l[k]};")
            inertia_of = f"{m[k]} * {l[k]} * {l[k]} / {w.number(12.0)}" if rod else w.number(0.0)
            w.say(f"p->I[{k}] = {inertia_of};")
            self.curved_spring(w, k, k)
        w.say(f"p->I[{n - 1}] += p->tip_inertia;")
        w.call(inertia.body_constants, l, m, centre, Real("p->tip_mass"), self.given.body.B, self.given.body.h)
        return self.function("void", "update", f"{self.prefix}_parameters *p", w)

    def curved_spring(self, w: CWriter, k: int, i: int, kind: str = "") -> None:
        """Write C code that sets the nonlinear spring terms of joint k, whose angle is coordinate i; with `kind`
        "axial_" those of segment k, whose strain is coordinate i.

        The terms are those of `Springs.hardening`.
        """
        stiffness = self.given.joints.K[i] if kind else f"p->stiffness[{k}]"
        for j, term in enumerate(SPRING_TERMS):
            w.say(f"{self.given.joints.hardening[j, i]} = {stiffness} * p->{kind}{term}[{k}];")
        row, first = self.given.joints.hardening[TERMS, i], next(iter(SPRING_TERMS))
        w.say(f"{row} = {w.number(0.0)};")
        w.say(f"if (p->{kind}{SPRING_BOUND}[{k}] > {w.number(0.0)}) {{")
        inverse = f"({w.number(1.0)} / p->{kind}{SPRING_BOUND}[{k}])"
        w.say(f"    {row} = {w.number(4.0 / 3.0)} * p->{kind}{first}[{k}] * {inverse};")
        w.say(f"    {row} = {row} * {row};")
        w.say("}")

    def segment(self, w: CWriter, s: int, length: Array) -> None:
        """Write C code that sets the spring and damper of extensible segment s, in proportion to its unstretched
        length.

        `length` (n + 1,) holds the C expressions of the lengths of base part and links.
        """
        joints, share, whole = self.given.joints, self.given.body.share, w.local("whole")
        i = self.model.size - len(self.model.extensions) + s
        w.say(f"{whole} = {' + '.join(f'{l} * {share[k, s]}' for k, l in enumerate(length))};")
        w.say(f"{joints.K[i]} = p->axial_stiffness[{s}] * {whole};")
        w.say(f"{joints.D[i]} = p->axial_damping[{s}] * {whole};")
        if i < joints.hardening.shape[1]:
            self.curved_spring(w, s, i, "axial_")

    def placed(self) -> tuple[CWriter, Any]:
        """Return a writer for a C function, and scratch arrays. The function begins by computing directions, stretches
        and joints of all links into these arrays.
        """
        w, n = self.writer(), self.model.n
        links, share = w.scratch("links", (5, n + 1)), getattr(self.given.body, "share", np.zeros((n + 1, 0)))
        base, length = (place(self.model, "p", f) for f in ("base_length", "link_length"))
        chain = symbols.ObservedChain(base, length, share)
        w.call(observation.place_links, self.phi, Real("p->base_angle"), chain, links)
        return w, links

    def tips(self) -> str:
        """Return the source of the C function that computes the positions of the link tips."""
        w, links = self.placed()
        for k, length in enumerate(place(self.model, "p", "link_length")):
            for axis in range(2):
                w.say(f"tip[{k}][{axis}] = {w.call(observation.position, axis, k, length, 0.0, links)};")
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

    def joint_angles(self) -> str:
        """Return the source of the C function that computes the joint angles relative to the rest shape, and copies the
        strains of segments that lengthen.
        """
        w = self.writer()
        for k in range(self.model.n):
            before = self.phi[k - 1] if k else "p->base_angle"
            w.say(f"q[{k}] = {self.phi[k]} - {before} - p->rest_angle[{k}];")
        for i in range(self.model.n, self.model.size):
            w.say(f"q[{i}] = {self.phi[i]};")
        return self.reading("joint_angles", f"q[{self.model.size}]", w)

    def energy(self) -> str:
        """Return the source of the C function that computes kinetic, elastic and gravitational energy."""
        w = self.writer()
        for k, (kernel, *arguments) in enumerate(self.energies(w)):
            w.say(f"joule[{k}] = {w.call(kernel, *arguments)};")
        return self.reading("energy", "joule[3]", w)

    def energies(self, w: CWriter) -> list[tuple[Any, ...]]:
        """Return the kernels of kinetic, elastic and gravitational energy, each followed by its arguments."""
        n, g = self.model.n, self.given
        c, s = w.scratch("cosine", (n,)), w.scratch("sine", (n,))
        for k in range(n):
            pair = w.cosine_and_sine(self.phi[k])
            w.say(f"{c[k]} = {pair[0]};")
            w.say(f"{s[k]} = {pair[1]};")
        return [(energy.kinetic_energy, c, s, self.w, g.body), (energy.elastic_energy, self.phi, g.joints),
                (energy.gravity_energy, c, s, g.body)]  # fmt: skip

    def linearise(self) -> str:
        """Return the source of the C function that computes the matrices A (2n, 2n) and B (2n, C) of the model
        linearised at the present state, for n links and C chambers. For a body that lengthens or moves in space, which
        the export target `state_space` linearises, return an empty text.

        Hysteresis elements act as springs, as before they slip.
        """
        if not isinstance(self.given.body, symbols.Body):
            return ""
        w, n, g = self.writer(), self.model.n, self.given
        work, tau = self.workspace(w), w.scratch("tau", (n,))
        out = symbols.Slopes(w.scratch("a", (n,)), w.scratch("by_angle", (n, n)), w.scratch("by_rate", (n, n)))
        slope = self.law(w, tau)
        w.call(motion.acceleration_jacobian, self.phi, self.w, tau, g.body, g.joints, work, out)
        self.stiff_memory(w, work, out)
        for i in range(n):
            for j in range(2 * n):
                w.say(f"A[{i}][{j}] = {w.number(float(j == n + i))};")
            for j in range(n):
                w.say(f"A[{n + i}][{j}] = {out.a_phi[j, i]};")
                w.say(f"A[{n + i}][{n + j}] = {out.a_w[j, i]};")
        answer, C = w.scratch("answer", (n,)), self.model.actuation.count
        for c in range(C):
            gain = g.drives.actuation.gain[c]
            for i in range(n):
                after = f" - {gain[i + 1]}" if i + 1 < n else ""
                w.say(f"{answer[i]} = ({gain[i]}{after}) * {slope[c]};")
            w.call(ldl_solve, work.A, answer)
            for i in range(n):
                w.say(f"B[{i}][{c}] = {w.number(0.0)};")
                w.say(f"B[{n + i}][{c}] = {answer[i]};")
        return self.reading("linearise", f"A[{2 * n}][{2 * n}], {self.kind} B[{2 * n}][{C}]", w)

    def law(self, w: CWriter, tau: Array) -> Array:
        """Write C code that computes the joint torques `tau`. Return one C variable for each chamber: the derivative of
        its torque law with respect to its pressure.

        The viscoelastic lag is held constant.
        """
        actuation, pressure = self.given.drives.actuation, self.given.drives.pressure
        slope = w.scratch("slope", (self.model.actuation.count,))
        for c in range(slope.size):
            chamber_law = pressure[c], actuation.law[c], actuation.rubber[c, FORM]
            w.say(f"{slope[c]} = {w.call(laws.law_slope, *chamber_law)};")
            torque = w.keep(w.call(laws.law_torque, *chamber_law), f"torque_{c}")
            for i in range(self.model.n):
                before = f"{tau[i]} + " if c else ""
                w.say(f"{tau[i]} = {before}{actuation.gain[c, i]} * {torque};")
        return slope

    def stiff_memory(self, w: CWriter, work: symbols.Workspace, out: symbols.Slopes) -> None:
        """Write C code that adds the stiffness of the hysteresis elements, which act as springs until they slip, to the
        derivatives `out` of the link accelerations with respect to the link angles.
        """
        m, n = self.given.memory, self.model.n
        smooth = [m.boucwen_share] if named(self.model, ("boucwen",)) else []
        shares = [*m.creep_share, *m.slip_share, *smooth]
        if not shares:
            return
        share = w.keep(Real(f"({' + '.join(shares)})"), "share")
        row = w.scratch("row", (n,))
        for i in range(n):
            for k in range(n):
                w.say(f"{row[k]} = {w.number(0.0)};")
            for joint in (i, i + 1):
                if joint < n:
                    w.say(f"{row[i]} += {share} * p->stiffness[{joint}];")
                    other = joint - 1 if joint == i else joint
                    if other >= 0:
                        w.say(f"{row[other]} -= {share} * p->stiffness[{joint}];")
            w.call(ldl_solve, work.A, row)
            for k in range(n):
                w.say(f"{out.a_phi[i, k]} -= {row[k]};")
