/* The floor under pliant's kernels: the same mathematics written by hand for five links in plain C, every loop of
   constant length so that the compiler unrolls it to straight lines. `floor.py` compiles it and calls it; nothing else
   does. The letters are those of pliant/equations/motion.py. */
#include <math.h>

#define N 5
#define EACH(i, from, to) _Pragma("GCC unroll 8") for (int i = (from); i < (to); i++)
#define INLINE static inline __attribute__((always_inline))

typedef struct {
    double B[N][N], I[N], h[N], gx, gy;
    double base, theta0[N], K[N], D[N], K2[N], unloaded[N], K3[N];
} Chain;

INLINE void factor(double A[N][N], double d[N]) { /* the lower triangle to L, d to the inverse of D */
    EACH(j, 0, N) {
        double low[N], pivot = A[j][j];
        EACH(p, 0, N) if (p < j) { low[p] = A[j][p]; A[j][p] *= d[p]; pivot -= low[p] * A[j][p]; }
        d[j] = 1.0 / pivot;
        EACH(i, 0, N) if (i > j) EACH(p, 0, N) if (p < j) A[i][j] -= A[i][p] * A[j][p];
    }
}

INLINE void solve(double A[N][N], const double d[N], double x[N]) {
    EACH(i, 0, N) EACH(p, 0, N) if (p < i) x[i] -= A[i][p] * x[p];
    EACH(i, 0, N) x[i] *= d[i];
    EACH(k, 0, N) { int i = N - 1 - k; EACH(p, 0, N) if (p > i) x[i] -= A[p][i] * x[p]; }
}

INLINE void springs(const Chain *m, const double phi[N], const double w[N], const double torque[N], double ahead,
                    double t[N + 1], double slope[N]) {
    double angle = m->base, rate = 0.0;
    EACH(i, 0, N) {
        double dq = w[i] - rate, q = phi[i] - angle - m->theta0[i];
        double more = phi[i] - angle - m->unloaded[i] + ahead * dq;
        double bent = (m->K2[i] + m->K3[i] * more) * more * more;
        t[i] = torque[i] - m->K[i] * (q + ahead * dq) - bent - m->D[i] * dq;
        slope[i] = m->K[i] + (2.0 * m->K2[i] + 3.0 * m->K3[i] * more) * more;
        angle = phi[i];
        rate = w[i];
    }
    t[N] = 0.0;
}

INLINE void accelerate(const Chain *m, const double phi[N], const double w[N], const double torque[N], double A[N][N],
                       double d[N], double c[N], double s[N], double slope[N], double a[N]) {
    double t[N + 1];
    EACH(k, 0, N) { c[k] = cos(phi[k]); s[k] = sin(phi[k]); }
    springs(m, phi, w, torque, 0.0, t, slope);
    EACH(k, 0, N) {
        a[k] = t[k] - t[k + 1] - m->h[k] * (m->gx * c[k] + m->gy * s[k]);
        A[k][k] = m->B[k][k] + m->I[k];
    }
    EACH(k, 0, N) EACH(j, 0, N) if (j < k) {
        A[k][j] = m->B[k][j] * (c[k] * c[j] + s[k] * s[j]);
        double lever = m->B[k][j] * (s[k] * c[j] - c[k] * s[j]);
        a[k] -= lever * w[j] * w[j];
        a[j] += lever * w[k] * w[k];
    }
    factor(A, d);
    solve(A, d, a);
}

INLINE void step(const Chain *m, double phi[N], double w[N], double h, const double torque[N]) {
    double half = 0.5 * h, quarter = half * half, c[N], s[N], A[N][N], S[N][N], d[N], t[N + 1], slope[N], r[N], a[N];
    EACH(k, 0, N) { double middle = phi[k] + half * w[k]; c[k] = cos(middle); s[k] = sin(middle); }
    springs(m, phi, w, torque, half, t, slope);
    EACH(k, 0, N) {
        r[k] = h * (t[k] - t[k + 1] - m->h[k] * (m->gx * c[k] + m->gy * s[k]));
        A[k][k] = m->B[k][k] + m->I[k] + quarter * m->h[k] * (m->gy * c[k] - m->gx * s[k])
                  + half * m->D[k] + quarter * slope[k];
        EACH(j, 0, N) if (j < k) {
            A[k][j] = m->B[k][j] * (c[k] * c[j] + s[k] * s[j]);
            S[k][j] = m->B[k][j] * (s[k] * c[j] - c[k] * s[j]);
        }
    }
    EACH(k, 1, N) {
        double implicit = half * m->D[k] + quarter * slope[k];
        A[k - 1][k - 1] += implicit;
        A[k][k - 1] -= implicit;
    }
    factor(A, d);
    EACH(k, 0, N) a[k] = 0.0;
    EACH(stage, 0, 2) { /* the rates of the start, then those of the middle */
        double square[N];
        EACH(k, 0, N) { double rate = w[k] + 0.5 * a[k]; square[k] = h * rate * rate; }
        EACH(k, 0, N) a[k] = r[k];
        EACH(k, 0, N) EACH(j, 0, N) if (j < k) { a[k] -= S[k][j] * square[j]; a[j] += S[k][j] * square[k]; }
        solve(A, d, a);
    }
    EACH(k, 0, N) { phi[k] += h * (w[k] + 0.5 * a[k]); w[k] += a[k]; }
}

void many_steps(long count, const Chain *m, double *phi, double *w, double h, const double *torque) {
    for (long i = 0; i < count; i++) step(m, phi, w, h, torque);
}

void many_accelerations(long count, const Chain *m, double *phi, const double *w, const double *torque, double *a) {
    for (long i = 0; i < count; i++) {
        double A[N][N], d[N], c[N], s[N], slope[N];
        accelerate(m, phi, w, torque, A, d, c, s, slope, a);
        phi[0] += 1e-18 * a[0]; /* so that no call can be left out */
    }
}

void many_jacobians(long count, const Chain *m, double *phi, const double *w, const double *torque, double *a,
                    double a_phi[N][N], double a_w[N][N]) { /* row by variable */
    for (long i = 0; i < count; i++) {
        double A[N][N], d[N], c[N], s[N], slope[N], P[N][N] = {{0}}, W[N][N] = {{0}};
        accelerate(m, phi, w, torque, A, d, c, s, slope, a);
        EACH(k, 0, N) {
            P[k][k] += m->h[k] * (m->gx * s[k] - m->gy * c[k]);
            EACH(j, 0, N) if (j < k) {
                double cosine = m->B[k][j] * (c[k] * c[j] + s[k] * s[j]);
                double sine = m->B[k][j] * (s[k] * c[j] - c[k] * s[j]);
                double by_j = cosine * w[j] * w[j] - sine * a[j], by_k = cosine * w[k] * w[k] + sine * a[k];
                P[j][k] += by_j; P[k][k] -= by_j; P[k][j] += by_k; P[j][j] -= by_k;
                W[j][k] -= 2.0 * sine * w[j]; W[k][j] += 2.0 * sine * w[k];
            }
        }
        EACH(k, 0, N) {
            P[k][k] -= slope[k]; W[k][k] -= m->D[k];
            if (k > 0) {
                P[k - 1][k - 1] -= slope[k]; P[k][k - 1] += slope[k]; P[k - 1][k] += slope[k];
                W[k - 1][k - 1] -= m->D[k]; W[k][k - 1] += m->D[k]; W[k - 1][k] += m->D[k];
            }
        }
        EACH(k, 0, N) { solve(A, d, P[k]); solve(A, d, W[k]); }
        EACH(k, 0, N) EACH(j, 0, N) { a_phi[k][j] = P[k][j]; a_w[k][j] = W[k][j]; }
        phi[0] += 1e-18 * a[0];
    }
}
