"""The discretisations, written out as lines of Python for the order at hand.

`explicit`, `implicit` and `matching` take n_d, n_f and the names of the states x_0..x_n; they
return lines that compute the next states, called n_0..n_n, from the states, the sample f, tau and
L, and the text of the estimates. All of them share

    x_i' = x_(i+1) - lambda_(n-i) g_i - (f where x_(i+1) is z_0),
    g_i = L p^(n-i) sign(s),   p = (|s|/L)^(1/(n+1)),

which is L^((i+1)/(n+1)) |s|^((n-i)/(n+1)) sign(s) with one root instead of n.
"""

import functools
import math

import numpy as np

from .coefficients import LAMBDA

__all__ = ["METHODS", "newton"]


def root(x, n):
    """Text of x^(1/n); square roots where they do, as they are the same compiled and plain."""
    if n in (1, 2, 4, 8):
        return f"math.sqrt({root(x, n//2)})" if n > 1 else x
    return f"({x})**{1.0/n!r}"


def error(n_f, x):
    """Lines of s, w_1 or z_0 - f, and of p."""
    return [f"s = {x[0]}" + ("" if n_f else " - f"), f"p = {root('abs(s)/L', len(x))}"]


def gains(n, top):
    """Lines of g_n = top, g_(n-1) = g_n p, ..."""
    return [f"g_{n} = {top}"] + [f"g_{i} = g_{i + 1}*p" for i in reversed(range(n))]


def tail(n_f, x, i):
    """Text of tau x_(i+1) - tau f..., the motion of x_i without its correction.

    It has Taylor's terms for z, Euler's for w.
    """
    if i < n_f:
        return f"tau*({x[i + 1]}" + (" - f)" if i == n_f - 1 else ")")
    text = ""
    for j in reversed(range(i + 1, len(x))):
        rest = f"({x[j]} + {text})" if text else x[j]
        text = (f"tau*{1.0/(j - i)!r}*" if j > i + 1 else "tau*") + rest
    return text


def explicit(n_d, n_f, x, taylor=True):
    """Euler's step, with Taylor's terms in the rows of z."""
    n, lam = n_d + n_f, LAMBDA[n_d + n_f]
    lines = error(n_f, x) + gains(n, "L*((s > 0.0)*1.0 - (s < 0.0)*1.0)")
    for i in range(n + 1):
        motion = tail(n_f, x if taylor else x[:i + 2], i)
        lines.append(f"n_{i} = {x[i]} + {motion + ' ' if motion else ''}- tau*{lam[n - i]!r}*g_{i}")
    return lines, x[n_f:]


NEWTON = '''
r = {root}
X = min(c/{first!r}, max(r - {shift!r}, 0.3*r))  # nearly the root for small and large c
for _ in range(100):
    q, slope = {last!r} + X, 1.0
    {horner}
    step = (q*X - c)/(slope*X + q)
    X -= step
    if abs(step) <= 1e-9*X:  # the next one would be its square
        break
return X
'''


def newton(n):
    """Body of a function of c > 0: the X > 0 with X (lambda_1 + X (lambda_2 + ... + X)) = c.

    The left-hand side is convex and rises.
    """
    lam = LAMBDA[n]
    if n == 0:
        return "return c"
    horner = [f"slope = slope*X + q\n    q = q*X + {lam[i]!r}" for i in reversed(range(1, n))]
    return NEWTON.format(first=lam[1], last=lam[n], shift=lam[n]/(n + 1), root=root("c", n + 1),
                         horner="\n    ".join(horner) or "pass").strip()


def implicit(n_d, n_f, x):
    """Backward Euler: one unknown, s of the next sample.

    The estimates are freed of the bias of backward differences.
    """
    n, lam = n_d + n_f, LAMBDA[n_d + n_f]
    total = ""
    for i in reversed(range(n + 1)):
        term = f"{x[i]} - f" if i == n_f else x[i]
        total = f"{term} + tau*({total})" if total else term
    lines = [f"h = {'*'.join(['tau']*(n + 1))}", f"b = {total}", f"c = abs(b)/(h*L) - {lam[0]!r}"]
    lines += ["p = tau*newton(c) if c > 0.0 else 0.0",
              *gains(n, f"L*((b > 0.0)*1.0 - (b < 0.0)*1.0) if c > 0.0 else b/h*{1.0/lam[0]!r}")]
    for i in reversed(range(n + 1)):
        minus_f = " - f" if i == n_f - 1 else ""
        lines.append(f"n_{i} = {x[i]} + tau*({f'n_{i + 1}{minus_f} ' if i < n else ''}- "
                     f"{lam[n - i]!r}*g_{i})")
    # Stirling numbers of the first kind, without signs
    stirling = [np.atleast_1d(np.poly(-np.arange(j)))[::-1].tolist() for j in range(n_d + 1)]
    y = []
    for i in range(n_d + 1):
        share = {j: math.factorial(i)/math.factorial(j)*stirling[j][i]
                 for j in range(i + 1, n_d + 1)}
        terms = [f"{c!r}*{'*'.join(['tau']*(j - i))}*n_{n_f + j}" for j, c in share.items() if c]
        y.append(" + ".join([f"n_{n_f + i}", *terms]))
    return lines, y


def matching(n_d, n_f, x):
    """Step whose error has the eigenvalues exp(tau p_j/p), by Ackermann's formula.

    The p_j are the roots of s^(n+1) + lambda_n s^n + ... + lambda_0.
    In terms of D = Phi - I and of exp(...) - 1: the expansion in powers of Phi and of exp(...)
    cancels where tau is small.
    """
    n = n_d + n_f
    D = np.zeros((n + 1, n + 1))  # for tau = 1; powers of tau scale it
    for i in range(n + 1):
        for j in range(i + 1, n + 1 if i >= n_f else i + 2):
            D[i, j] = 1.0/math.factorial(j - i)
    O = np.array([np.linalg.matrix_power(D, k)[0] for k in range(n + 1)])
    V = np.linalg.solve(O, np.eye(n + 1)[:, -1])
    V = np.array([np.linalg.matrix_power(D, k)@V for k in range(n + 1)]).T
    lines = [*error(n_f, x), "q = tau/p if p > 1e-4*tau else 1e4"]
    a = ["1.0"]  # coefficients of the polynomial in D, highest power first
    for k, q in enumerate(q for q in np.roots([1.0, *LAMBDA[n][::-1]]).tolist() if q.imag >= 0.0):
        if q.imag > 0.0:
            lines += [f"d, c = math.expm1({q.real!r}*q), math.sin({0.5*q.imag!r}*q)",
                      f"i = (1.0 + d)*math.sin({q.imag!r}*q)",
                      "d -= 2.0*(1.0 + d)*c*c"]
            factor = ["1.0", "-2.0*d", "(d*d + i*i)"]
        else:
            lines.append(f"d = math.expm1({q.real!r}*q)")
            factor = ["1.0", "-d"]
        new = []
        for m in range(len(a) + len(factor) - 1):
            terms = [(a[m - j], factor[j]) for j in range(len(factor)) if 0 <= m - j < len(a)]
            new.append(" + ".join("*".join(t for t in pair if t != "1.0") or "1.0"
                                  for pair in terms))
        lines += [f"a{k}_{m} = {t}" for m, t in enumerate(new)]
        a = [f"a{k}_{m}" for m in range(len(new))]
    for i in range(n + 1):
        terms = [f"{float(V[i, k])!r}*{a[n + 1 - k]}" for k in range(n + 1) if V[i, k]]
        motion = tail(n_f, x, i)
        lines.append(f"n_{i} = {x[i]} + {motion + ' ' if motion else ''}- ({' + '.join(terms)})*s"
                     + "/tau"*i)
    return lines, x[n_f:]


#: {method: (the lines of its step, what its help says of it)}
METHODS = {
    "levant": (explicit, """Explicit steps with Taylor's terms, of samples before t: without noise
    the error of z_i is of the order tau^({order} - i)."""),
    "implicit": (implicit, """Backward Euler steps, solved for the next s, and estimates freed of
    the bias of backward differences. They use the sample at t. Without noise z_0 is exact, the
    error of z_i of the order tau^({order} - i), and nothing chatters."""),
    "matching": (matching, """Explicit steps, of samples before t, with the eigenvalues exp(tau p_j
    (L/|s|)^(1/{N})), p_j the roots of the polynomial with the coefficients (1, lambda_{n}, ...,
    lambda_0): without noise the error of z_i is of the order tau^({order} - i)."""),
    "euler": (functools.partial(explicit, taylor=False), """Euler's steps, for teaching. Without
    Taylor's terms z_1, z_2, ... have errors of the order tau, whatever n_d."""),
}
