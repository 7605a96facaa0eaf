/* The floor under the step in space: the mathematics of pliant/equations/spatial.py written by hand in plain C for L links
   with or without twist (-DL=5 -DTWIST=0), every loop of constant length. benchmarks/space_speed.py compiles and calls it. */
#include <math.h>
#include <string.h>

#ifndef L
#define L 5
#endif
#ifndef TWIST
#define TWIST 0
#endif
#define N ((2 + TWIST) * L)
#define EACH(i, from, to) _Pragma("GCC unroll 16") for (int i = (from); i < (to); i++)
#define INLINE static inline __attribute__((always_inline))
#define SERIES 14

typedef struct { double x, y, z; } V;
typedef struct { double xx, yx, yy, zx, zy, zz; } Sym;
typedef struct {
    double length[L + 1], mass[L], centre[L], lateral[L], axial[L];
    V rest[L][3], base[3], g; /* columns */
    double K[N], D[N], K2[N], K3[N];
} Chain;

static const double C4[SERIES] = { /* (-1)^j / (2 j + 4)! */
    0.041666666666666664, -0.001388888888888889, 2.48015873015873e-05, -2.755731922398589e-07, 2.08767569878681e-09,
    -1.1470745597729725e-11, 4.779477332387385e-14, -1.5619206968586225e-16, 4.110317623312165e-19,
    -8.896791392450574e-22, 1.6117375710961184e-24, -2.4795962632247976e-27, 3.279889237069838e-30,
    -3.7699876288159054e-33,
};
static const double C5[SERIES] = { /* (-1)^j / (2 j + 5)! */
    0.008333333333333333, -0.0001984126984126984, 2.7557319223985893e-06, -2.505210838544172e-08,
    1.6059043836821613e-10, -7.647163731819816e-13, 2.8114572543455206e-15, -8.22063524662433e-18,
    1.9572941063391263e-20, -3.868170170630684e-23, 6.446950284384474e-26, -9.183689863795546e-29,
    1.1309962886447716e-31, -1.216125041553518e-34,
};

INLINE V add(V a, V b) { return (V){a.x + b.x, a.y + b.y, a.z + b.z}; }
INLINE V sub(V a, V b) { return (V){a.x - b.x, a.y - b.y, a.z - b.z}; }
INLINE V times(double s, V a) { return (V){s * a.x, s * a.y, s * a.z}; }
INLINE V mad(V a, double s, V b) { return (V){a.x + s * b.x, a.y + s * b.y, a.z + s * b.z}; }
INLINE double dot(V a, V b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
INLINE V cross(V a, V b) { return (V){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
INLINE V mix(const V m[3], double a, double b, double c) { return mad(mad(times(a, m[0]), b, m[1]), c, m[2]); }

typedef struct {
    V R[L + 1][3], P[L][3], r[L + 1], S[N], C[L];
    Sym J[L];
    double c3[L], d2[L], d3[L], q[N];
} Pose;

INLINE void pose(const Chain *m, Pose *p) {
    EACH(i, 0, 3) p->R[0][i] = m->base[i];
    p->r[0] = (V){0, 0, 0};
    EACH(k, 0, L) {
        p->r[k + 1] = mad(p->r[k], m->length[k], p->R[k][2]);
        V *P = p->P[k], *R = p->R[k + 1];
        EACH(j, 0, 3) P[j] = mix(p->R[k], m->rest[k][j].x, m->rest[k][j].y, m->rest[k][j].z);
        double a = p->q[2 * k], b = p->q[2 * k + 1], y = a * a + b * b, c4 = C4[SERIES - 1], c5 = C5[SERIES - 1];
        EACH(j, 1, SERIES) { c4 = c4 * y + C4[SERIES - 1 - j]; c5 = c5 * y + C5[SERIES - 1 - j]; }
        double c3 = 1.0 / 6 - y * c5, c2 = 0.5 - y * c4, c1 = 1 - y * c3, ab = a * b;
        p->c3[k] = c3; p->d2[k] = c4 - 0.5 * c3; p->d3[k] = 1.5 * c5 - 0.5 * c4;
        p->S[2 * k] = mix(P, 1 - c3 * b * b, c3 * ab, -c2 * b);
        p->S[2 * k + 1] = mix(P, c3 * ab, 1 - c3 * a * a, c2 * a);
        R[2] = mix(P, c1 * b, -c1 * a, 1 - c2 * y);
        R[0] = mix(P, 1 - c2 * b * b, c2 * ab, -c1 * b);
        R[1] = mix(P, c2 * ab, 1 - c2 * a * a, c1 * a);
        if (TWIST) {
            double c = cos(p->q[2 * L + k]), s = sin(p->q[2 * L + k]);
            V x = R[0], z = R[1];
            p->S[2 * L + k] = R[2];
            R[0] = mad(times(c, x), s, z);
            R[1] = mad(times(c, z), -s, x);
        }
    }
}

INLINE void composites(const Chain *m, Pose *p) {
    double mass = 0;
    EACH(i, 0, L) {
        int k = L - 1 - i;
        V z = p->R[k + 1][2];
        double l = m->length[k + 1], own = m->mass[k] * m->centre[k];
        double across = m->lateral[k] + own * m->centre[k] + mass * l * l, turn = m->axial[k] - across;
        Sym J = {across + turn * z.x * z.x, turn * z.y * z.x, across + turn * z.y * z.y, turn * z.z * z.x, turn * z.z * z.y,
                 across + turn * z.z * z.z};
        V C = times(own + mass * l, z);
        if (k < L - 1) {
            V c = times(l, p->C[k + 1]);
            double along = 2 * dot(z, c);
            Sym n = p->J[k + 1];
            J.xx += n.xx + along - 2 * z.x * c.x;
            J.yx += n.yx - (z.y * c.x + z.x * c.y);
            J.yy += n.yy + along - 2 * z.y * c.y;
            J.zx += n.zx - (z.z * c.x + z.x * c.z);
            J.zy += n.zy - (z.z * c.y + z.y * c.z);
            J.zz += n.zz + along - 2 * z.z * c.z;
            C = add(C, p->C[k + 1]);
        }
        p->J[k] = J; p->C[k] = C;
        mass += m->mass[k];
    }
}

INLINE int link_of(int i) { return i < 2 * L ? i / 2 : i - 2 * L; }

INLINE void inertia(const Chain *m, Pose *p, double quarter, double A[N][N]) {
    V F[N], M[N], E[N];
    composites(m, p);
    EACH(j, 0, N) {
        int k = link_of(j);
        V s = p->S[j], f = cross(s, p->C[k]), r = p->r[k + 1];
        Sym J = p->J[k];
        V Js = {J.xx * s.x + J.yx * s.y + J.zx * s.z, J.yx * s.x + J.yy * s.y + J.zy * s.z,
                J.zx * s.x + J.zy * s.y + J.zz * s.z};
        E[j] = cross(r, s); F[j] = f; M[j] = add(Js, cross(mad(r, quarter, m->g), f));
    }
    EACH(j, 0, N) EACH(i, 0, N) {
        int k = link_of(j), before = link_of(i);
        if (before < k || (before == k && i <= j)) A[i > j ? i : j][i > j ? j : i] = dot(p->S[i], M[j]) + dot(E[i], F[j]);
    }
    EACH(k, 0, L) {
        V s = p->S[2 * k], t = p->S[2 * k + 1], C = p->C[k];
        A[2 * k + 1][2 * k] += 0.5 * quarter * (dot(s, C) * dot(t, m->g) - dot(s, m->g) * dot(t, C));
    }
}

INLINE void turn_on(V *omega, V *alpha, V axis) { *alpha = add(*alpha, cross(*omega, axis)); *omega = add(*omega, axis); }

INLINE void inertial(const Chain *m, const Pose *p, const double v[N], double f[N]) {
    V omega = {0, 0, 0}, alpha = {0, 0, 0}, lift = times(-1, m->g), F[L], M[L];
    EACH(k, 0, L) {
        double a = p->q[2 * k], b = p->q[2 * k + 1], da = v[2 * k], db = v[2 * k + 1], kappa = a * db - b * da;
        double growth = 2 * (a * da + b * db), c3 = p->c3[k], d3 = p->d3[k] * growth;
        alpha = add(alpha, mix(p->P[k], kappa * (d3 * b + c3 * db), -kappa * (d3 * a + c3 * da), kappa * p->d2[k] * growth));
        turn_on(&omega, &alpha, mad(times(da, p->S[2 * k]), db, p->S[2 * k + 1]));
        if (TWIST) turn_on(&omega, &alpha, times(v[2 * L + k], p->S[2 * L + k]));
        V z = p->R[k + 1][2], dz = cross(omega, z), u = add(cross(alpha, z), cross(omega, dz));
        double reach = m->mass[k] * m->centre[k], across = m->lateral[k] + reach * m->centre[k];
        M[k] = cross(z, mad(times(reach, lift), across, u));
        M[k] = mad(mad(M[k], m->axial[k] * dot(alpha, z), z), m->axial[k] * dot(omega, z), dz);
        F[k] = mad(times(m->mass[k], lift), reach, u);
        lift = mad(lift, m->length[k + 1], u);
    }
    EACH(i, 0, L) {
        int k = L - 1 - i;
        if (k < L - 1) {
            M[k] = add(add(M[k], M[k + 1]), cross(times(m->length[k + 1], p->R[k + 1][2]), F[k + 1]));
            F[k] = add(F[k], F[k + 1]);
        }
        f[2 * k] = dot(p->S[2 * k], M[k]);
        f[2 * k + 1] = dot(p->S[2 * k + 1], M[k]);
        if (TWIST) f[2 * L + k] = dot(p->S[2 * L + k], M[k]);
    }
}

INLINE void law(const Chain *m, int i, double x, double *more, double *slope) { /* beyond the linear spring */
    *more = (m->K2[i] + m->K3[i] * x) * x; /* torque over angle */
    *slope = (2 * m->K2[i] + 3 * m->K3[i] * x) * x;
}

INLINE void springs(const Chain *m, const double q[N], const double v[N], const double torque[N], double half, double t[N],
                    double A[N][N]) {
    double quarter = half * half, more, slope;
    EACH(k, 0, L) {
        int i = 2 * k, j = i + 1;
        double a = q[i], b = q[j], ratio = m->K[j] / (m->K[i] + 1e-60), size = sqrt(a * a + ratio * b * b + 1e-24);
        law(m, i, size, &more, &slope);
        double inverse = 1 / size, u = a * inverse, w = ratio * b * inverse, steeper = slope - more;
        t[i] = torque[i] - (m->K[i] + more) * a - m->D[i] * v[i];
        t[j] = torque[j] - (m->K[j] + more * ratio) * b - m->D[j] * v[j];
        A[i][i] += half * m->D[i] + quarter * (m->K[i] + more + steeper * u * u);
        A[j][i] += quarter * steeper * u * w;
        A[j][j] += half * m->D[j] + quarter * (m->K[j] + more * ratio + steeper * w * w);
    }
    EACH(i, 2 * L, N) {
        law(m, i, q[i], &more, &slope);
        t[i] = torque[i] - (m->K[i] + more) * q[i] - m->D[i] * v[i];
        A[i][i] += half * m->D[i] + quarter * (m->K[i] + slope);
    }
}

INLINE void factor(double A[N][N]) { /* L below the diagonal, inverse of D on it, D L^T above it */
    EACH(j, 0, N) {
        double pivot = A[j][j];
        EACH(p, 0, N) if (p < j) pivot -= A[j][p] * A[p][j];
        A[j][j] = pivot = 1 / pivot;
        EACH(i, 0, N) if (i > j) {
            double value = A[i][j];
            EACH(p, 0, N) if (p < j) value -= A[i][p] * A[p][j];
            A[j][i] = value;
            A[i][j] = value * pivot;
        }
    }
}

INLINE void solve(double A[N][N], double b[N]) {
    EACH(i, 0, N) EACH(p, 0, N) if (p < i) b[i] -= A[i][p] * b[p];
    EACH(i, 0, N) b[i] *= A[i][i];
    EACH(k, 0, N) EACH(i, 0, N - 1 - k) b[i] -= A[N - 1 - k][i] * b[N - 1 - k];
}

INLINE void step(const Chain *m, double x[N], double v[N], double h, const double torque[N]) {
    Pose p;
    double half = 0.5 * h, A[N][N], t[N], f[N], a[N], middle[N];
    EACH(i, 0, N) p.q[i] = x[i] + half * v[i];
    pose(m, &p);
    inertia(m, &p, half * half, A);
    springs(m, p.q, v, torque, half, t, A);
    factor(A);
    EACH(i, 0, N) middle[i] = v[i];
    EACH(stage, 0, 2) { /* the rates of the start, then those of the middle */
        inertial(m, &p, middle, f);
        EACH(i, 0, N) a[i] = h * (t[i] - f[i]);
        solve(A, a);
        EACH(i, 0, N) middle[i] = v[i] + 0.5 * a[i];
    }
    EACH(i, 0, N) { x[i] += h * (v[i] + 0.5 * a[i]); v[i] += a[i]; }
}

void many_steps(long count, const Chain *m, double *x, double *v, double h, const double *torque) {
    for (long i = 0; i < count; i++) step(m, x, v, h, torque);
}
