"""Vectors, matrices and quaternions as tuples of numbers, unrolled for blocks, compiled or not.

A vector is a tuple of numbers, a matrix a tuple of rows, a quaternion (q_0, q_1, q_2, q_3) with its
scalar first.
"""

from typing import Any

from .signal import generated, leaves, size, solution

__all__ = ["cross", "dot", "quaternion_product", "solve", "times"]

MOST = 4  # maximum number of rows of a matrix to solve with


def _same(a: Any, b: Any, what: str) -> int:
    """The common length of two vectors."""
    if a is None or b is None or len(a) != len(b) or any(q is not None for q in (*a, *b)):
        raise ValueError(f"vec.{what} takes two vectors of the same length; "
                         f"it was given {size(a)} and {size(b)}")
    return len(a)


def _matrix(A: Any, what: str) -> tuple[int, int]:
    """Numbers of rows and columns of a matrix."""
    if A is None or any(q is None or len(q) != len(A[0]) for q in A):
        raise ValueError(f"vec.{what} takes a matrix, a tuple of rows of the same length; "
                         f"it was given {size(A)}")
    return len(A), len(A[0])


def _dot(a: Any, b: Any) -> str:
    n = _same(a, b, "dot")
    return "return " + " + ".join(f"a[{i}]*b[{i}]" for i in range(n))


def _cross(a: Any, b: Any) -> str:
    if _same(a, b, "cross") != 3:
        raise ValueError(f"vec.cross takes vectors of 3 numbers; it was given {size(a)}")
    pairs = (1, 2), (2, 0), (0, 1)
    return "return " + ", ".join(f"a[{i}]*b[{j}] - a[{j}]*b[{i}]" for i, j in pairs)


def _times(A: Any, b: Any) -> str:
    n, m = _matrix(A, "times")
    if b is None or len(b) != m:
        raise ValueError("vec.times takes a matrix and a vector or matrix with as many rows "
                         f"as the first has columns; it was given {size(A)} and {size(b)}")
    if b[0] is None:
        return "return (" + "".join(
            " + ".join(f"A[{i}][{j}]*b[{j}]" for j in range(m)) + ", " for i in range(n)) + ")"
    columns = _matrix(b, "times")[1]
    return "return (" + "".join("(" + "".join(
        " + ".join(f"A[{i}][{j}]*b[{j}][{k}]" for j in range(m)) + ", " for k in range(columns))
        + "), " for i in range(n)) + ")"


def _solve(G: Any, s: Any) -> str:
    n, m = _matrix(G, "solve")
    if n != m or n > MOST or s is None or len(s) != n or len(leaves(s)) != n:
        raise ValueError(f"vec.solve takes a square matrix of up to {MOST} rows and a vector of "
                         f"the same length; it was given {size(G)} and {size(s)}")
    return solution(G, s)


def _quaternion_product(p: Any, q: Any) -> str:
    if _same(p, q, "quaternion_product") != 4:
        raise ValueError("vec.quaternion_product takes quaternions of 4 numbers; "
                         f"it was given {size(p)}")
    return ("return (p[0]*q[0] - p[1]*q[1] - p[2]*q[2] - p[3]*q[3], "
            "p[0]*q[1] + p[1]*q[0] + p[2]*q[3] - p[3]*q[2], "
            "p[0]*q[2] - p[1]*q[3] + p[2]*q[0] + p[3]*q[1], "
            "p[0]*q[3] + p[1]*q[2] - p[2]*q[1] + p[3]*q[0])")


#: Scalar product of two vectors.
dot = generated("a, b", _dot)
#: Vector product of two vectors of 3 numbers.
cross = generated("a, b", _cross)
#: Product A b of a matrix and a vector, or of two matrices.
times = generated("A, b", _times)
#: Solution x of G x = s, up to 4 x 4, by elimination with row exchanges; NaN where G is singular.
solve = generated("G, s", _solve)
#: Product of two quaternions, scalar first: the rotation q followed by p.
quaternion_product = generated("p, q", _quaternion_product)
