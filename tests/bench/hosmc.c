/* The chain of three integrators under the rational quasi-continuous law, as an engineer writes it by hand.
   -DBARE: without the sums, extremes and the divergence test that smcaero_nb gives with every run. */
#include <math.h>

/* P: alpha L lam, xi_0 xi_1 omega, initial state; the law acts every m steps and v is held between */
long run(const double *P, double dt, long n, long m, long every, long k_tail, double *rec, double *acc)
{
    const double alpha = P[0], L = P[1], L1 = L*P[2], L2 = L1*P[2], L3 = L2*P[2], xi0 = P[3], xi1 = P[4], w = P[5];
    double x0 = P[6], x1 = P[7], x2 = P[8], y0 = 0, y1 = 0, y2 = 0, v = 0;
#ifndef BARE
    double se0 = 0, se1 = 0, se2 = 0, su = 0, me0 = 0, me1 = 0, me2 = 0, ms0 = 0, ms1 = 0, ms2 = 0, mu = 0;
    double tv = 0, turns = 0, last = 0, held = 0, sv = 0, iv = 0;
    double lo0 = INFINITY, hi0 = -INFINITY, lo1 = INFINITY, hi1 = -INFINITY, lo2 = INFINITY, hi2 = -INFINITY;
    double ulo = INFINITY, uhi = -INFINITY;
#endif
    long k, row = 0, sample = 0;
    for (k = 0; k <= n; k++) {
        double t = k*dt, xi = xi0 + xi1*cos(w*t);
#ifndef BARE
        if (k == k_tail) me0 = me1 = me2 = ms0 = ms1 = ms2 = mu = 0;
        if (!(fabs(x0) + fabs(x1) + fabs(x2) + fabs(x0) + fabs(x1) + fabs(x2) + fabs(xi) <= 1e12)) break;
#endif
        if (k == sample) {
            sample += m;
            y0 = x0; y1 = x1; y2 = x2;
#ifndef BARE
            iv += m*dt*v;
#endif
            double s0 = y0/L, s1 = y1/L1, s2 = y2/L2, b = s1*sqrt(fabs(s1)), c = s2*s2*s2, d = fabs(c) + fabs(b) + fabs(s0);
            v = d > 0 ? alpha*L3*((c + b + s0)/d) : 0;
#ifndef BARE
            if (!(fabs(y0) + fabs(y1) + fabs(y2) + fabs(v) + fabs(v) <= 1e12)) break;
            double step = v - held;
            if (step != 0) {
                tv += fabs(step);
                if (step*last < 0) turns += 1;
                last = step;
            }
            held = v;
            sv += fabs(v);
            if (y0 < lo0) lo0 = y0;
            if (y0 > hi0) hi0 = y0;
            if (y1 < lo1) lo1 = y1;
            if (y1 > hi1) hi1 = y1;
            if (y2 < lo2) lo2 = y2;
            if (y2 > hi2) hi2 = y2;
            if (v < ulo) ulo = v;
            if (v > uhi) uhi = v;
            if (fabs(y0) > ms0) ms0 = fabs(y0);
            if (fabs(y1) > ms1) ms1 = fabs(y1);
            if (fabs(y2) > ms2) ms2 = fabs(y2);
            if (fabs(v) > mu) mu = fabs(v);
#endif
        }
#ifndef BARE
        if (fabs(x0) > me0) me0 = fabs(x0);
        if (fabs(x1) > me1) me1 = fabs(x1);
        if (fabs(x2) > me2) me2 = fabs(x2);
#endif
        if (k == row) {
            double *o = rec; rec += 29;
            o[0] = t; o[1] = 0; o[2] = -x0; o[3] = -x1; o[4] = -x2; o[5] = x0; o[6] = x1; o[7] = x2; o[8] = y0; o[9] = y1;
            o[10] = y2; o[11] = y0; o[12] = y1; o[13] = y2; o[14] = v; o[15] = v; o[16] = xi; o[17] = x0; o[18] = x1; o[19] = x2;
#ifndef BARE
            o[20] = lo0; o[21] = hi0; o[22] = lo1; o[23] = hi1; o[24] = lo2; o[25] = hi2; o[26] = ulo; o[27] = uhi; o[28] = iv;
            lo0 = hi0 = y0; lo1 = hi1 = y1; lo2 = hi2 = y2; ulo = uhi = v;
#endif
            row = row + every < n ? row + every : n;
            if (k == n) break;
        }
#ifndef BARE
        se0 += fabs(x0); se1 += fabs(x1); se2 += fabs(x2); su += fabs(v);
#endif
        double rate = xi - v;
        x0 += dt*x1; x1 += dt*x2; x2 += dt*rate;
    }
#ifndef BARE
    acc[0] = se0; acc[1] = se1; acc[2] = se2; acc[3] = su; acc[4] = me0; acc[5] = me1; acc[6] = me2; acc[7] = ms0; acc[8] = ms1;
    acc[9] = ms2; acc[10] = mu; acc[11] = tv; acc[12] = turns; acc[13] = sv;
#endif
    return k;
}
