"""Vectors and matrices as tuples: numpy is the oracle, compiled and plain agree to the last bit."""

import numpy as np
import pytest
from numba import njit

import smcaero_nb as smc
from smcaero_nb import ClosedLoop, block, simulate, vec

RNG = np.random.default_rng(5)


def rows(a):
    return tuple(map(rows, a)) if np.ndim(a) else float(a)


def agree(f, *given):
    """What a function gives, compiled and plain."""
    plain = f(*given)
    assert njit(lambda *a: f(*a))(*given) == plain
    return plain


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_products_and_solutions_are_those_of_numpy(n):
    for _ in range(20):
        A, B = RNG.normal(size=(2, n, n))
        a, b = RNG.normal(size=(2, n))
        assert agree(vec.dot, rows(a), rows(b)) == pytest.approx(a@b, rel=1e-12, abs=1e-13)
        assert agree(vec.times, rows(A), rows(b)) == pytest.approx(A@b, rel=1e-12, abs=1e-13)
        np.testing.assert_allclose(agree(vec.times, rows(A), rows(B)), A@B, rtol=1e-12, atol=1e-13)
        x, within = np.linalg.solve(A, b), 1e-13*np.linalg.cond(A)
        assert agree(vec.solve, rows(A), rows(b)) == pytest.approx(x, rel=within, abs=within)


def test_cross_and_quaternion_products():
    for _ in range(20):
        (a, b), (p, q) = RNG.normal(size=(2, 3)), RNG.normal(size=(2, 4))
        assert agree(vec.cross, rows(a), rows(b)) == pytest.approx(np.cross(a, b), abs=1e-14)
        expected = [p[0]*q[0] - p[1:]@q[1:], *(p[0]*q[1:] + q[0]*p[1:] + np.cross(p[1:], q[1:]))]
        assert agree(vec.quaternion_product, rows(p), rows(q)) == pytest.approx(expected, abs=1e-14)


def test_rows_are_exchanged_and_a_singular_matrix_gives_nan():
    assert vec.solve(((0.0, 1.0), (1.0, 0.0)), (2.0, 3.0)) == (3.0, 2.0)
    assert np.isnan(vec.solve(((1.0, 2.0), (2.0, 4.0)), (1.0, 1.0))).any()


@pytest.mark.parametrize("call, said", [
    (lambda: vec.dot((1.0, 2.0), (1.0, 2.0, 3.0)), "given 2 numbers and 3 numbers"),
    (lambda: vec.cross((1.0, 2.0), (1.0, 2.0)), "vectors of 3 numbers"),
    (lambda: vec.times(((1.0, 2.0), (3.0,)), (1.0, 2.0)), "rows of the same length"),
    (lambda: vec.times(((1.0, 2.0),), (1.0, 2.0, 3.0)), "1 rows of 2 and 3 numbers"),
    (lambda: vec.solve(((1.0, 2.0),), (1.0,)), "a square matrix of up to 4 rows"),
    (lambda: vec.solve(rows(np.eye(5)), rows(np.ones(5))), "a square matrix of up to 4 rows"),
    (lambda: vec.quaternion_product((1.0, 2.0), (1.0, 2.0)), "quaternions of 4 numbers")])
def test_shapes_that_do_not_fit_are_named(call, said):
    with pytest.raises(ValueError, match=said):
        call()


def test_a_rigid_body_keeps_its_energy_and_momentum():
    """Free rotation of a body with a full inertia matrix: |h| and the energy stay."""
    J = np.array([[1200.0, 100.0, -200.0], [100.0, 2200.0, 300.0], [-200.0, 300.0, 3100.0]])
    inertia = rows(J)

    @block(state=dict(p=0.1, q=-0.2, r=0.05))
    def body(x):
        w = x[0], x[1], x[2]
        gyro = vec.cross(w, vec.times(inertia, w))
        return vec.solve(inertia, (-gyro[0], -gyro[1], -gyro[2]))

    law = block(lambda sigma: (0.0, 0.0, 0.0))
    loop = ClosedLoop(body, law=law)
    runs = [simulate(loop, 20.0, 1e-2, method="rk4", jit=jit) for jit in (True, False)]
    w = np.array([runs[0].x.p, runs[0].x.q, runs[0].x.r])
    np.testing.assert_array_equal(w, [runs[1].x.p, runs[1].x.q, runs[1].x.r])
    h = J@w
    assert np.ptp(np.linalg.norm(h, axis=0)) < 1e-7*np.linalg.norm(h[:, 0])
    assert np.ptp((w*h).sum(axis=0)) < 1e-7*(w[:, 0]@h[:, 0])


def test_vec_is_public():
    assert smc.vec is vec and "solve" in vec.__all__
