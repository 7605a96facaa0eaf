"""Further solvers for the common problem: CVODE, IDA and IDAS on the same equations, and a step in Python on Pinocchio.
"""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
from speed.methods import STEPS, TOLERANCES, Method, in_pieces
from speed.problem import Problem

from pliant.compiler.twin import rebuild
from pliant.equations import motion
from pliant.equations.symbols import Workspace
from pliant.mechanics import mechanics_of


def cvode(problem: Problem) -> list[Method]:
    """Solve by SUNDIALS CVODE (scikit-sundae) with the compiled right-hand side and Jacobian, called from Python."""
    if find_spec("sksundae") is None:
        return []
    from sksundae.cvode import CVODE

    def piece(rhs, y, times, rtol):
        def rate(t, y, out):
            out[:] = rhs.rate(t, y)

        def jacobian(t, y, _yp, out):
            out[:] = rhs.jacobian(t, y)

        solver = CVODE(rate, jacfn=jacobian, rtol=rtol, atol=1e-3 * rtol, max_num_steps=1_000_000)
        return np.asarray(solver.solve(times, y).y)

    return [in_pieces("CVODE (scikit-sundae)", problem, piece)]


def ida(problem: Problem) -> list[Method]:
    """Solve y' - f(y) = 0 by SUNDIALS IDA (scikit-sundae) with the compiled right-hand side and Jacobian."""
    if find_spec("sksundae") is None:
        return []
    from sksundae.ida import IDA

    def piece(rhs, y, times, rtol):
        identity = np.eye(len(y))

        def residual(t, y, yp, out):
            out[:] = yp - rhs.rate(t, y)

        def jacobian(t, y, _yp, _res, cj, out):
            out[:] = cj * identity - rhs.jacobian(t, y)

        solver = IDA(residual, jacfn=jacobian, rtol=rtol, atol=1e-3 * rtol, max_num_steps=1_000_000)
        return np.asarray(solver.solve(times, y, np.array(rhs.rate(times[0], y))).y)

    return [in_pieces("IDA (scikit-sundae)", problem, piece)]


def idas(problem: Problem) -> list[Method]:
    """Solve by CasADi's IDAS on the kernels traced into symbols; everything runs in C++."""
    if find_spec("casadi") is None:
        return []
    import casadi as ca

    if hasattr(ca.GlobalOptions, "setNumpyMode"):
        ca.GlobalOptions.setNumpyMode(-1)
    model, n = problem.model, problem.model.n
    y, torque = ca.SX.sym("y", 2 * n), ca.SX.sym("torque")

    class Shim:
        cos, sin = staticmethod(ca.cos), staticmethod(ca.sin)

    def symbols(*shape):
        made = np.empty(shape, dtype=object)
        for index in np.ndindex(*shape):
            made[index] = ca.SX(0)
        return made

    shapes = {"A": (n, n), "S": (n, n), "t": (n + 1,)}
    work = Workspace(*(symbols(*shapes.get(field, (n,))) for field in Workspace._fields))
    phi, w, a = symbols(n), symbols(n), symbols(n)
    for k in range(n):
        phi[k], w[k] = y[k], y[n + k]
    plain = rebuild(motion.acceleration, lambda f: f, {"np": Shim})
    tau = symbols(n)
    tau[:] = [gain * torque for gain in model.joint_gain]
    plain(phi, w, tau, mechanics_of(model).body, mechanics_of(model).joints, work, a)
    ode = {"x": y, "p": torque, "ode": ca.vertcat(*w, *a)}
    made: dict[tuple[float, int], list] = {}

    def solve(rtol):
        rows, now = [np.zeros((1, 2 * n))], np.zeros(2 * n)
        for k, (times, level) in enumerate(problem.pieces):
            key = (rtol, k)
            if key not in made:
                options = {"reltol": rtol, "abstol": 1e-3 * rtol, "max_num_steps": 1_000_000}
                made[key] = ca.integrator("pulse", "idas", ode, 0.0, (times[1:] - times[0]).tolist(), options)
            found = np.asarray(made[key](x0=now, p=level)["xf"]).T
            rows.append(found)
            now = found[-1]
        return problem.tips(np.diff(np.concatenate(rows)[:, :n], axis=1, prepend=0.0))

    return [Method("CasADi IDAS", [t for t in TOLERANCES if 1e-9 < t < 2e-5], solve)]


def pinocchio(problem: Problem) -> list[Method]:
    """Solve by the same implicit midpoint rule, written in Python with Pinocchio's algorithms."""
    if find_spec("pinocchio") is None:
        return []
    import pinocchio as pin

    m, n = problem.model, problem.model.n
    chain, joint, before = pin.Model(), 0, 0.0
    chain.gravity = pin.Motion.Zero()
    for i in range(n):
        place = pin.SE3(np.eye(3), np.array([0.0, before, 0.0]))
        joint = chain.addJoint(joint, pin.JointModelRZ(), place, f"joint_{i}")
        mass = pin.Inertia(float(m.link_mass[i]), np.array([0.0, m.link_length[i], 0.0]), np.zeros((3, 3)))
        chain.appendBodyToJoint(joint, mass, pin.SE3.Identity())
        before = float(m.link_length[i])
    data = chain.createData()

    def solve(h):
        count = max(1, round(1e-2 / h))
        h = 1e-2 / count
        q, v = np.zeros(n), np.zeros(n)
        rows = [q]
        implicit = np.diag(0.5 * h * m.damping + 0.25 * h * h * m.stiffness)
        for times, torque in problem.pieces:
            for _ in range((times.size - 1) * count):
                middle = q + 0.5 * h * v
                A = pin.crba(chain, data, middle) + implicit
                A = np.triu(A) + np.triu(A, 1).T
                force = torque - m.stiffness * middle - m.damping * v
                dv = np.linalg.solve(A, h * (force - pin.nonLinearEffects(chain, data, middle, v)))
                dv = np.linalg.solve(A, h * (force - pin.nonLinearEffects(chain, data, middle, v + 0.5 * dv)))
                q, v = q + h * (v + 0.5 * dv), v + dv
                rows.append(q)
        return problem.tips(np.array(rows[::count]))

    return [Method("Pinocchio, step in Python", [h for h in STEPS if h >= 4e-4], solve)]


def all_peers(problem: Problem) -> list[Method]:
    """Return the installed solvers; a solver that cannot be loaded is named and left out."""
    found = []
    for make in (cvode, ida, idas, pinocchio):
        try:
            found += make(problem)
        except Exception as error:  # noqa: BLE001  a peer's trouble must not end the race
            print(f"left out: {make.__name__}: {type(error).__name__}: {error}")
    return found
