/* Levant's differentiator of order 5 over a record, with Taylor's terms, as an engineer writes it by hand: times may be
   uneven, and a time that does not increase or a sample that is no number ends it, as in smcaero_nb.differentiators. */
#include <math.h>

long levant_5(const double *t, const double *f, double *out, long n, double L, double gap)
{
    double z0 = f[0], z1 = 0, z2 = 0, z3 = 0, z4 = 0, z5 = 0, h = 0;
    for (long k = 0; k < n; k++) {
        double before = h;
        if (k + 1 < n) h = t[k + 1] - t[k];
        if (!(h > 0 && h < HUGE_VAL && fabs(f[k]) < HUGE_VAL)) return k;
        if (before > gap) { z0 = f[k]; z1 = z2 = z3 = z4 = z5 = 0; }
        out[k] = z0; out[n + k] = z1; out[2*n + k] = z2; out[3*n + k] = z3; out[4*n + k] = z4; out[5*n + k] = z5;
        double e = z0 - f[k], p = pow(fabs(e)/L, 1.0/6), g5 = e > 0 ? L : e < 0 ? -L : 0;
        double g4 = g5*p, g3 = g4*p, g2 = g3*p, g1 = g2*p, g0 = g1*p, h2 = h*0.5, h3 = h*(1.0/3), h4 = h*0.25, h5 = h*0.2;
        z0 += h*(z1 + h2*(z2 + h3*(z3 + h4*(z4 + h5*z5))) - 7.0*g0);
        z1 += h*(z2 + h2*(z3 + h3*(z4 + h4*z5)) - 23.72*g1);
        z2 += h*(z3 + h2*(z4 + h3*z5) - 32.24*g2);
        z3 += h*(z4 + h2*z5 - 20.26*g3);
        z4 += h*(z5 - 6.75*g4);
        z5 += h*(-1.1*g5);
    }
    return n;
}
