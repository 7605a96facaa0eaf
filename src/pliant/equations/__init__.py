"""Equations of Section III of the paper by Chen, Galloway and Godage: one plain function per equation, in the paper's
order and notation.

Source: Y. Chen, K. C. Galloway, I. S. Godage, "Efficient Reduced-Order Models for Soft Actuators".

    section     Sec. III-C   A, d, tau = p A d
    chain       Eqs. (1)-(3) angles, rotations and positions of the links
    velocity    Eq. (4)      body velocities, Jacobians, Hessian
    inertia     Eq. (5)      M
    coriolis    Eq. (5)      C
    elastic     Eq. (5)      K q, D dq, gravity, tau
    motion      Eq. (5)      acceleration, its derivatives, one implicit step
    energy                   kinetic, elastic, gravitational energy and power

A kernel is a plain Python function on scalars and arrays, which writes its results into arrays of its caller. The same
source runs on floats, on complex numbers (derivatives by complex step), on symbols, and compiled
(`pliant.compiler.choose.twin`). Index 0 is the first link here, i = 1 in the paper. All quantities are SI.
"""
