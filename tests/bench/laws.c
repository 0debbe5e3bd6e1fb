/* Laws on their chain, sigma' = xi - v with xi = sin t, as an engineer writes them by hand, each with the sums, extremes,
   chattering and divergence tests that smcaero_nb gives with every run.

   long law(P, dt, n, every, k_tail, rec, acc): P holds the law's parameters, its initial states, then the plant's.
   A row of rec: t r y e e_hat sigma v u d, states of the plant, states of the law, low and high of sigma, of u, integral of v.
   acc: sums of |e|, |u|; maxima of |e|, |sigma|, |u| from k_tail on; variation of u, its turns; sum of |v|. */
#include <math.h>

typedef struct { double se, su, me, ms, mu, variation, turns, last, held, slo, shi, ulo, uhi, sv, iv, v; } watch;

static inline double sign(double s) { return (s > 0) - (s < 0); }
static inline double larger(double a, double b) { return a > b ? a : b; }

/* sigma, v and u of a sample; 0 if the run has diverged */
static inline int driven(watch *w, double s, double v, double u)
{
    if (!(fabs(s) + fabs(v) + fabs(u) <= 1e12)) return 0;
    double step = u - w->held;
    if (step != 0) {
        w->variation += fabs(step);
        if (step*w->last < 0) w->turns += 1;
        w->last = step;
    }
    w->held = u;
    w->v = v;
    w->sv += fabs(v);
    if (s < w->slo) w->slo = s;
    if (s > w->shi) w->shi = s;
    if (u < w->ulo) w->ulo = u;
    if (u > w->uhi) w->uhi = u;
    w->ms = larger(fabs(s), w->ms);
    w->mu = larger(fabs(u), w->mu);
    return 1;
}

static inline double *extremes(watch *w, double *o, double s, double u)
{
    o[0] = w->slo; o[1] = w->shi; o[2] = w->ulo; o[3] = w->uhi; o[4] = w->iv;
    w->slo = w->shi = s; w->ulo = w->uhi = u;
    return o + 5;
}

static inline void sums(const watch *w, double *acc)
{
    acc[0] = w->se; acc[1] = w->su; acc[2] = w->me; acc[3] = w->ms; acc[4] = w->mu; acc[5] = w->variation; acc[6] = w->turns; acc[7] = w->sv;
}

/* A chain of order 1: CONTROL makes v of s and advances the law's states, STORE puts them at *o++. */
#define ORDER_1(CONTROL, STORE) \
    watch w = {0}; \
    w.slo = w.ulo = HUGE_VAL; w.shi = w.uhi = -HUGE_VAL; \
    long k, row = 0; \
    for (k = 0; k <= n; k++) { \
        double t = k*dt, y = -x, e = 0 - y, d = sin(t), s = e, v; \
        if (!(fabs(x) + fabs(e) + fabs(d) <= 1e12)) break; \
        if (k == k_tail) w.me = w.ms = w.mu = 0; \
        w.iv += dt*w.v; \
        CONTROL \
        if (!driven(&w, s, v, v)) break; \
        w.me = larger(fabs(e), w.me); \
        if (k == row) { \
            double *o = rec; \
            *o++ = t; *o++ = 0; *o++ = y; *o++ = e; *o++ = e; *o++ = s; *o++ = v; *o++ = v; *o++ = d; *o++ = x; \
            STORE \
            rec = extremes(&w, o, s, v); \
            row = row + every < n ? row + every : n; \
            if (k == n) break; \
        } \
        w.se += fabs(e); w.su += fabs(v); \
        x += dt*(d - v); \
    } \
    sums(&w, acc); \
    return k;

long sign_smc(const double *P, double dt, long n, long every, long k_tail, double *rec, double *acc)
{
    const double rho = P[0];
    double x = P[1];
    ORDER_1(v = rho*sign(s);, )
}

long super_twisting(const double *P, double dt, long n, long every, long k_tail, double *rec, double *acc)
{
    const double lam = P[0], beta = P[1];
    double z = P[2], x = P[3];
    ORDER_1(v = lam*sqrt(fabs(s))*sign(s) + z; z += dt*beta*sign(s);, *o++ = z;)
}

long adaptive_super_twisting(const double *P, double dt, long n, long every, long k_tail, double *rec, double *acc)
{
    const double gamma = P[0], mu = P[1], lam_min = P[2], eps = P[3], eta = P[4];
    double lam = P[5], z = P[6], x = P[7];
    ORDER_1(v = lam*sqrt(fabs(s))*sign(s) + z;
            z += dt*eps*lam*sign(s);
            lam += dt*(lam > lam_min ? (fabs(s) > mu ? gamma : -gamma) : eta);, *o++ = lam; *o++ = z;)
}
