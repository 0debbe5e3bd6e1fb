/* The lander under off-pulse control (1-SMC Lander), as an engineer writes it by hand: the sampled control every `every_sample`
   steps, the plant in Euler steps, sums and extremes over every step, rows, divergence and touchdown. Same order of operations
   as the kit, for the loop is chaotic.
   P: surfaces (c_0 c_int a_b e_I w_max)x2; laws (gamma rho_max delta_1 delta_2 delta_3 t_1 t_2 a omega)x2 rho(0)x2; allocation m J
   l_a g_0 s_min; thrusters (low high)x2; perturbations phi_a phi_d omega; plant m J l_a g_m offset eff stuck left right l_d;
   plant's initial states x4. */
#include <math.h>

#define COLUMNS 47
static double clip(double u, double low, double high) { double q = u < high ? u : high; return q > low ? q : low; }
static double sgn(double s) { return s > 0 ? 1.0 : s < 0 ? -1.0 : 0.0; }

long run(const double *P, double dt, double tau, long m, long n, long every, long k_tail, double *rec, double *acc, long *rows)
{
    const double *S[2] = {P, P + 5}, *L[2] = {P + 10, P + 19}, *A = P + 30, *U[2] = {P + 35, P + 37}, *D = P + 39, *V = P + 42;
    double th = P[52], om = P[53], x = P[54], v = P[55];
    double w[2] = {0, 0}, rho[2] = {P[28], P[29]}, s[2] = {0, 1}, sigma[2] = {0, 0}, vc[2] = {0, 0}, u[2] = {0, 0};
    double slo[2], shi[2], ulo[2], uhi[2], iv[2] = {0, 0}, sv[2] = {0, 0}, held[2] = {0, 0}, last[2] = {0, 0};
    double var[2] = {0, 0}, turns[2] = {0, 0}, ms[2] = {0, 0}, mu[2] = {0, 0}, se[4] = {0, 0, 0, 0}, eh[4] = {0, 0, 0, 0}, su[2] = {0, 0}, me[4] = {0, 0, 0, 0};
    const double a = 1.0/1440.0, b = -11.0/48.0, half_pi = 0.5*3.141592653589793, J = V[1], mass = V[0];
    const double arm_l = V[4] - V[9], arm_r = V[4] + V[9];
    long k, sample = 0, row = 0;
    for (int c = 0; c < 2; c++) { slo[c] = ulo[c] = HUGE_VAL; shi[c] = uhi[c] = -HUGE_VAL; }
    *rows = 0;
    for (k = 0; k <= n; k++) {
        double t = k*dt, xc = ((a*t + b)*t - 10.0)*t + 6000.0, vr = (3.0*a*t + 2.0*b)*t - 10.0;
        double e[4] = {half_pi - th, 0.0 - om, xc - x, vr - v};
        double wave = sin(D[2]*t), d0 = D[0]*wave, d1 = D[1]*wave;
        if (!(fabs(th) + fabs(om) + fabs(x) + fabs(v) + fabs(e[0]) + fabs(e[1]) + fabs(e[2]) + fabs(e[3]) + fabs(d0) + fabs(d1) <= 1e12
              && x >= -1e6 && x <= 1e6)) break;
        if (!(x > 0)) n = row = k;
        if (k == sample) {
            sample += m;
            for (int c = 0; c < 2; c++) {
                const double *q = S[c], *l = L[c], e0 = e[2*c], size = fabs(e0), e_L = q[2]/(q[0]*q[0]);
                iv[c] += tau*vc[c];
                eh[2*c] = e[2*c]; eh[2*c + 1] = e[2*c + 1];
                sigma[c] = e[2*c + 1] + (size <= e_L ? q[0]*e0 : copysign(sqrt(2.0*q[2]*(size - 0.5*e_L)), e0)) + w[c];
                w[c] = size < q[3] ? clip(w[c] + tau*q[1]*e0, -q[4], q[4]) : 0.0;
                double delta = t < l[5] ? l[2] : t < l[6] ? l[3] : l[4], bar = sigma[c] + l[7]*sin(l[8]*t), now = fabs(sigma[c]);
                s[c] = fabs(bar) > delta ? sgn(bar) : c == 1 || s[c]*bar > 0 ? s[c] : 0.0;
                vc[c] = rho[c]*s[c];
                double ahead = now > delta ? rho[c] + tau*l[0]*now : rho[c];
                rho[c] = ahead < l[1] ? ahead : l[1];
            }
            double sine = sin(th), u_a = A[1]*vc[0]/A[2];
            double u_d = sine <= 0 ? 0.0 : A[0]*(vc[1] + A[3])/(sine > A[4] ? sine : A[4]) - u_a;
            u[0] = clip(u_a, U[0][0], U[0][1]);
            u[1] = clip(u_d, U[1][0], U[1][1]);
            if (!(fabs(sigma[0]) + fabs(sigma[1]) + fabs(vc[0]) + fabs(vc[1]) + fabs(u[0]) + fabs(u[1]) + fabs(w[0]) + fabs(w[1])
                  + fabs(rho[0]) + fabs(rho[1]) <= 1e12)) break;
            for (int c = 0; c < 2; c++) {
                double step = u[c] - held[c];
                if (step != 0) {
                    var[c] += fabs(step);
                    if (step*last[c] < 0) turns[c] += 1;
                    last[c] = step;
                }
                held[c] = u[c];
                sv[c] += fabs(vc[c]);
                if (sigma[c] < slo[c]) slo[c] = sigma[c];
                if (sigma[c] > shi[c]) shi[c] = sigma[c];
                if (u[c] < ulo[c]) ulo[c] = u[c];
                if (u[c] > uhi[c]) uhi[c] = u[c];
                if (fabs(sigma[c]) > ms[c]) ms[c] = fabs(sigma[c]);
                if (fabs(u[c]) > mu[c]) mu[c] = fabs(u[c]);
            }
        }
        if (k == k_tail) me[0] = me[1] = me[2] = me[3] = 0;
        for (int i = 0; i < 4; i++) if (fabs(e[i]) > me[i]) me[i] = fabs(e[i]);
        if (k == row) {
            double *o = rec + *rows*COLUMNS;
            const double out[COLUMNS] = {t, half_pi, 0, xc, vr, th, om, x, v, e[0], e[1], e[2], e[3], eh[0], eh[1], eh[2], eh[3], sigma[0],
                sigma[1], vc[0], vc[1], u[0], u[1], d0, d1, th, om, x, v, w[0], w[1], rho[0], s[0], rho[1], s[1], u[0], u[1],
                slo[0], shi[0], slo[1], shi[1], ulo[0], uhi[0], ulo[1], uhi[1], iv[0], iv[1]};
            for (int i = 0; i < COLUMNS; i++) o[i] = out[i];
            for (int c = 0; c < 2; c++) { slo[c] = shi[c] = sigma[c]; ulo[c] = uhi[c] = u[c]; }
            ++*rows;
            row = row + every < n ? row + every : n;
            if (k == n) break;
        }
        for (int i = 0; i < 4; i++) se[i] += fabs(e[i]);
        su[0] += fabs(u[0]); su[1] += fabs(u[1]);
        double attitude = V[5]*u[0] + V[6], half = 0.5*u[1], ul = V[7]*half/6.0, ur = V[8]*half/6.0;
        double alpha = (V[2]*attitude + arm_l*ul + arm_r*ur)/J + d0, acc_x = sin(th)*(attitude + ul + ur)/mass - V[3] + d1;
        th += dt*om; om += dt*alpha; x += dt*v; v += dt*acc_x;
    }
    for (int i = 0; i < 4; i++) { acc[i] = se[i]; acc[4 + i] = me[i]; }
    for (int c = 0; c < 2; c++) {
        acc[8 + c] = su[c]; acc[10 + c] = var[c]; acc[12 + c] = turns[c]; acc[14 + c] = sv[c]; acc[16 + c] = ms[c]; acc[18 + c] = mu[c];
    }
    return k;
}
