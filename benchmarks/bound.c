/* The bound: one iteration of dynamic relaxation in plain C, double precision, one thread; the same arithmetic and the same data
 * layout as the kernels (natural triangle, isotropic tension field, follower pressure, gather, kinetic energy). */
#include <math.h>

static void corner_forces(int tri_count, const int *node, const double *X, const double *u, const double *L, const double *volume,
                          const double *G, double c11, double c12, double c33, double E, double pressure, double *corner) {
    for (int t = 0; t < tri_count; t++) {
        const int *n = node + 3 * t;
        const double *g = G + 9 * t;
        double rest[3][3], side[3][3], delta[3], factor[3];
        for (int a = 0; a < 3; a++) {
            int i = n[(a + 1) % 3], j = n[(a + 2) % 3];
            double growth = 0, square = 0;
            for (int c = 0; c < 3; c++) {
                rest[a][c] = X[3 * j + c] - X[3 * i + c];
                double s = u[3 * j + c] - u[3 * i + c];
                side[a][c] = rest[a][c] + s;
                growth += (rest[a][c] + side[a][c]) * s;
                square += side[a][c] * side[a][c];
            }
            double l = sqrt(square), L_a = L[3 * t + a], reciprocal = 1.0 / (l * (l + L_a));
            delta[a] = growth * l * reciprocal;
            factor[a] = (l + L_a) * reciprocal;
        }
        double ex = g[0] * delta[0] + g[1] * delta[1] + g[2] * delta[2];
        double ey = g[3] * delta[0] + g[4] * delta[1] + g[5] * delta[2];
        double exy = g[6] * delta[0] + g[7] * delta[1] + g[8] * delta[2];
        double sx = c11 * ex + c12 * ey, sy = c12 * ex + c11 * ey, sxy = c33 * exy;
        if (!(sx + sy >= 0 && sx * sy >= sxy * sxy)) {
            double m = 0.5 * (ex + ey), d = 0.5 * (ex - ey), h = 0.5 * exy, r = sqrt(d * d + h * h);
            double tension = m + r > 0 ? E * (m + r) : 0, c = r > 0 ? d / r : 0, s = r > 0 ? h / r : 0;
            sx = tension * 0.5 * (1 + c), sy = tension * 0.5 * (1 - c), sxy = tension * 0.5 * s;
        }
        for (int a = 0; a < 3; a++)
            factor[a] *= volume[t] * (g[a] * sx + g[3 + a] * sy + g[6 + a] * sxy);
        double p = pressure / 6.0;
        double push[3] = {p * (side[1][1] * side[2][2] - side[1][2] * side[2][1]), p * (side[1][2] * side[2][0] - side[1][0] * side[2][2]),
                          p * (side[1][0] * side[2][1] - side[1][1] * side[2][0])};
        double *f = corner + 9 * t;
        for (int c = 0; c < 3; c++) {
            double p0 = factor[0] * side[0][c], p1 = factor[1] * side[1][c], p2 = factor[2] * side[2][c];
            f[c] = p2 - p1 + push[c];
            f[3 + c] = p0 - p2 + push[c];
            f[6 + c] = p1 - p0 + push[c];
        }
    }
}

double iterate(int count, int tri_count, int node_count, const int *node, const double *X, double *u, const double *L, const double *volume,
               const double *G, double c11, double c12, double c33, double E, double pressure, const int *start, const int *list,
               const double *load, const double *mass, const int *held, double *v, double *force, double *corner) {
    double kinetic = 0;
    for (int k = 0; k < count; k++) {
        corner_forces(tri_count, node, X, u, L, volume, G, c11, c12, c33, E, pressure, corner);
        kinetic = 0;
        for (int i = 0; i < node_count; i++) {
            double f[3] = {load[3 * i], load[3 * i + 1], load[3 * i + 2]};
            for (int c = start[i]; c < start[i + 1]; c++)
                for (int d = 0; d < 3; d++)
                    f[d] += corner[3 * list[c] + d];
            for (int d = 0; d < 3; d++) {
                f[d] *= 1 - held[3 * i + d];
                force[3 * i + d] = f[d];
                v[3 * i + d] += f[d] / mass[i];
                kinetic += 0.5 * mass[i] * v[3 * i + d] * v[3 * i + d];
            }
        }
        for (int i = 0; i < 3 * node_count; i++)
            u[i] += v[i];
    }
    return kinetic;
}
