/* The launch vehicle under quasi sliding mode control (eq69), as an engineer writes it by hand.
   -DBARE: without the sums, extremes and the divergence test that smcaero_nb gives with every run. */
#include <math.h>

/* P: I C_Na qbar S l_a l_g R S_n I_n phi_g psi_g psi_s omega_b zeta_b tau_act omega_e zeta_e, c1 c0, rho eps, G0,
      unit of the command, f0 f1 omega_f */
long run(const double *P, double dt, long n, long every, long k_tail, double *rec, double *acc)
{
    const double I = P[0], a = P[1]*P[2]*P[3]*P[4]/I, K = P[5]*P[6]/I, J = (P[5]*P[7] + P[8])/I;
    const double c2 = P[11]*(P[7]*P[9] - P[8]*P[10]), c0b = P[11]*P[6]*P[9];
    const double db = 2*P[13]*P[12], kb = P[12]*P[12], tau = P[14], ke = P[15]*P[15], de = 2*P[16]*P[15];
    const double c1 = P[17], c0 = P[18], rho = P[19], eps = P[20], G0 = P[21], unit = P[22], f0 = P[23], f1 = P[24], w = P[25];
    double x1 = 0, b = 0, bd = 0, th = 0, q = 0, eta = 0, etad = 0, ie = 0;
#ifndef BARE
    double se = 0, sd = 0, su = 0, me = 0, md = 0, ms = 0, mu = 0, tv = 0, turns = 0, last = 0, held = 0, sv = 0, iv = 0, vh = 0;
    double slo = 0, shi = 0, ulo = 0, uhi = 0;
#endif
    long k, row = 0;
    for (k = 0; k <= n; k++) {
        double t = k*dt, c = 0;
        if (t >= 2) c -= 1.2;
        if (t >= 6) c += 2.3;
        if (t >= 10) c -= 1.2;
        double r = c*unit, y = th + eta, dy = q + etad, e = r - y, ed = -dy, f = f0 + f1*sin(w*t);
#ifndef BARE
        if (!(fabs(x1) + fabs(b) + fabs(bd) + fabs(th) + fabs(q) + fabs(eta) + fabs(etad) + fabs(e) + fabs(ed) + fabs(f) <= 1e12
              && y >= -10 && y <= 10)) break;
#endif
#ifndef BARE
        iv += dt*vh;
#endif
        double s = ed + c1*e + c0*ie, v = rho*s/(fabs(s) + eps), u = v/G0;
        ie += dt*e;
#ifndef BARE
        if (!(fabs(s) + fabs(v) + fabs(u) + fabs(ie) <= 1e12)) break;
        double step = u - held;
        if (step != 0) {
            tv += fabs(step);
            if (step*last < 0) turns += 1;
            last = step;
        }
        held = u;
        vh = v;
        sv += fabs(v);
        if (s < slo) slo = s;
        if (s > shi) shi = s;
        if (u < ulo) ulo = u;
        if (u > uhi) uhi = u;
        if (k == k_tail) me = md = ms = mu = 0;
        if (fabs(s) > ms) ms = fabs(s);
        if (fabs(u) > mu) mu = fabs(u);
#endif
        if (k == row) {
            double *o = rec; rec += 25;
            o[0] = t; o[1] = r; o[2] = y; o[3] = dy; o[4] = e; o[5] = ed; o[6] = e; o[7] = ed; o[8] = s; o[9] = v; o[10] = u; o[11] = f;
            o[12] = x1; o[13] = b; o[14] = bd; o[15] = th; o[16] = q; o[17] = eta; o[18] = etad; o[19] = ie;
#ifndef BARE
            o[20] = slo; o[21] = shi; o[22] = ulo; o[23] = uhi; o[24] = iv;
            slo = shi = s; ulo = uhi = u;
#endif
            row = row + every < n ? row + every : n;
            if (k == n) break;
        }
#ifndef BARE
        se += fabs(e); sd += fabs(ed); su += fabs(u);
        if (fabs(e) > me) me = fabs(e);
        if (fabs(ed) > md) md = fabs(ed);
#endif
        double bdd = ke*(x1 - b) - de*bd, qd = a*th - K*b - J*bdd, etadd = c2*bdd + c0b*b - db*etad - kb*eta;
        x1 += dt*((u + f - x1)/tau);
        b += dt*bd; bd += dt*bdd; th += dt*q; q += dt*qd; eta += dt*etad; etad += dt*etadd;
    }
#ifndef BARE
    acc[0] = se; acc[1] = sd; acc[2] = su; acc[3] = me; acc[4] = md; acc[5] = ms; acc[6] = mu; acc[7] = tv; acc[8] = turns; acc[9] = sv;
#endif
    return k;
}
