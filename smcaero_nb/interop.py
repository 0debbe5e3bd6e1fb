"""Plants from python-control: a linear system becomes a block that runs at the speed of C."""

import keyword
import re
from typing import Any

import numpy as np

from .core import Block, Param, ParameterError, block
from .core.card import Output, Plant
from .core.family import family, written
from .core.signal import generated, leaves
from .core.zeros import named, unstable, zeros

__all__ = ["from_control"]


def _total(u, d):
    paths, many = leaves(u), leaves(d)
    if d is not None and len(many) != len(paths):
        raise ValueError(f"the perturbation has {len(many)} components, but the input has "
                         f"{len(paths)}")
    sums = (f"u{q} + d{'' if d is None else many[i]}, " for i, q in enumerate(paths))
    return f"return ({''.join(sums)})"


#: The inputs of a plant, each with its perturbation; a single number perturbs them all.
total = generated("u, d", _total)


#: Way out for systems that are not linear equations, by the name of their class.
OTHERS = {
    "NonlinearIOSystem":
        " Its equations are Python that cannot be compiled into a loop. Write them as a plant:\n\n"
        "@block(state=dict(x0=0.0, x1=0.0))\n"
        "def plant(x, u, d):\n"
        "    return x[1], -x[0] + u + d\n\n"
        "or take its linearisation, sys.linearize(x0, u0)",
    "FrequencyResponseData":
        " Its samples are not equations; fit a transfer function to them, and give that",
}


def matrices(sys: Any, owner: str = "interop.from_control") -> tuple:
    """A, B, C, D and the names of the states of a continuous proper system; see `from_control`."""
    import control  # it takes a second to import, so only here

    if not isinstance(sys, (control.TransferFunction, control.StateSpace)):
        way = next((q for n, q in OTHERS.items() if isinstance(sys, getattr(control, n))), "")
        raise ParameterError(f"{owner}: sys = {type(sys).__name__} is not allowed; it must be a "
                             "control.TransferFunction or control.StateSpace" + "."*bool(way) + way)
    if not control.isctime(sys):
        step = "of unspecified length" if sys.dt is True else f"of {sys.dt:g} s"
        raise ParameterError(f"{owner}: sys is discrete-time, with steps {step}; a plant is "
                             "continuous (dt = 0): the engine integrates dx/dt. Give the system "
                             "that it was made of, as it was before control.c2d; a sampled "
                             "controller or filter is a block with memory, @block(state=...)")
    if isinstance(sys, control.StateSpace):
        a, names = (sys.A, sys.B, sys.C, sys.D), sys.state_labels
    else:
        a = _realised(sys.num, sys.den, owner)
        names = [f"x{i}" for i in range(len(a[0]))]
    if not all(np.isfinite(q).all() for q in a):
        raise ParameterError(f"{owner}: sys has a coefficient that is not a finite number")
    return *(np.asarray(q, float) for q in a), names


def _realised(num, den, owner):
    """Controllable companion forms, one per input and denominator.

    They are sparse, and minimal for one input and output.
    """
    chains = {}  # (input, denominator): {output: numerator}
    D = np.zeros((len(num), len(num[0])))
    for i, row in enumerate(num):
        for j, q in enumerate(row):
            b, a = (np.trim_zeros(np.atleast_1d(p), "f") for p in (q, den[i][j]))
            if len(b) > len(a):
                raise ParameterError(f"{owner}: sys is improper from input {j + 1} to "
                                     f"output {i + 1}: degree {len(b) - 1} over {len(a) - 1}; the "
                                     "numerator's may be at most the denominator's")
            b, a = np.concatenate([np.zeros(len(a) - len(b)), b])/a[0], a/a[0]
            D[i, j] = b[0]
            if len(a) > 1 and b.any():
                chains.setdefault((j, tuple(a[1:])), {})[i] = b[1:] - b[0]*a[1:]
    n = sum(len(a) for _, a in chains)
    A, B, C, at = np.zeros((n, n)), np.zeros((n, D.shape[1])), np.zeros((len(D), n)), 0
    for (j, a), rows in chains.items():
        m = len(a)
        A[at:at + m - 1, at + 1:at + m] += np.eye(m - 1)
        A[at + m - 1, at:at + m] = -np.array(a[::-1])
        B[at + m - 1, j] = 1.0
        for i, b in rows.items():
            C[i, at:at + m] = b[::-1]
        at += m
    return A, B, C, D


def _identifiers(names):
    """Names that can be arguments in Python, each once."""
    made = []
    for i, name in enumerate(names):
        s = re.sub(r"\W+", "_", str(name), flags=re.ASCII).strip("_") or f"x{i}"
        s = f"x_{s}" if s[0].isdigit() or keyword.iskeyword(s) else s
        made.append(next(q for q in (s, *(f"{s}_{j}" for j in range(i, i + len(names) + 1)))
                         if q not in made))
    return made


def _row(coefficients, names):
    """Text of a sum of products, without those that are zero."""
    terms = [n if c == 1.0 else f"{float(c)!r}*{n}"
             for c, n in zip(coefficients, names, strict=True) if c != 0.0]
    return " + ".join(terms) or "0.0"


DOC = r"""Linear plant {name}: {n} states, {m} input(s), {p} output(s).

    .. math:: \dot x = A x + B (u + d)

    Parameters
    ----------
    x : tuple of {n} float
        State.
    u, d : float or tuple of {m} float
        Inputs and their perturbation; a perturbation that is one number acts on every input.

    Returns
    -------
    tuple of {n} float
        Derivative of the state.

    Notes
    -----
    Made by `interop.from_control`. Not in the paper.{zeros}
    """


def from_control(sys: Any) -> Block:
    r"""Plant block of a linear system of python-control.

    .. math:: \dot x = A x + B (u + d), \qquad y = C x + D (u + d)

    Parameters
    ----------
    sys : control.TransferFunction or control.StateSpace
        Continuous (dt = 0) and proper, with any number of inputs and outputs.

    Returns
    -------
    Block
        A plant, with the states of `sys` by name (``x0``, ``x1``, ... of a transfer function), all
        0 at the start unless set. Its attribute `y` is the block of the output stage:
        ``ClosedLoop(plant, output=plant.y, ...)``. With one input, u is a float, with several a
        tuple of them. With one output, y is a float; with several it is ``((y0,), (y1,), ...)``,
        one channel per output, each without derivatives.

    Raises
    ------
    ParameterError
        If the system is improper, discrete-time, without states or of another kind.

    Notes
    -----
    The sums are written out without the zeros of A, B, C, D, and compile into the loop like any
    other block. Unless `simulate` is given another method, the plant is advanced exactly from step
    to step; its attribute `A` serves for that. A transfer function is realised in controllable
    companion form, one for each input and denominator: minimal for one input and output, not always
    for more. The coefficients are constants: another system is another block, and compiles anew.

    With a direct feedthrough (D other than 0: relative degree 0) a sample measures y under the
    control of the sample before, and its own acts from then on: no loop is algebraic. But feedback
    of a gain K then settles only if K D is less than 1 in size (its eigenvalues), however short the
    sampling step; put the lag of the actuator or of the sensor in series.

    Not in the paper.

    Examples
    --------
    >>> import control
    >>> plant = from_control(control.tf([1.0], [1.0, 2.0, 5.0], name="mass"))
    >>> plant
    mass(x0=0, x1=0)
    >>> plant((0.5, 0.0), 1.0, 0.0)
    (0.0, -1.5)
    """
    A, B, C, D, labels = matrices(sys)
    if not len(A):
        raise ParameterError("interop.from_control: sys has no states; a plant needs at least one")
    return linear(A, B, C, D, _identifiers(labels), sys.name)


vars(from_control)["card"] = Plant()  # as of `linear`, which makes the block: `catalogue` lists it


@family(card=Plant())
def linear(A, B, C, D, states, name):
    """Plant block of x' = A x + B (u + d), with its output y as attribute; see `from_control`."""
    x, u = [f"x{i}" for i in range(len(A))], [f"u{j}" for j in range(len(B[0]))]
    rates = ", ".join(_row([*a, *b], x + u) for a, b in zip(A, B, strict=True))
    f = written(_identifiers([name])[0], "x, u, d", _unpacked(x, u) + f"return ({rates},)",
                {"__name__": __name__, "total": total},
                DOC.format(name=name, n=len(A), m=len(u), p=len(C), zeros=_warned(A, B, C, D)))
    plant = block(f, state={s: (0.0, Param(_symbol(s))) for s in states})
    vars(plant).update(y=linear_output(C, D, name), A=np.array(A, float))
    return plant


def _warned(A, B, C, D):
    """What zeros in the right half plane do, as a paragraph of a docstring."""
    found = unstable(zeros(*(np.array(q, float) for q in (A, B, C, D))))
    return (f"\n\n    It has {named(found)} in the right half plane: while y is held at zero, as "
            f"in sliding mode,\n    the other states grow as exp({found[0].real:.3g} t)."
            if found else "")


@family(card=Output())
def linear_output(C, D, name):
    """Output block y = C x + D (u + d); see `from_control`."""
    x, u = [f"x{i}" for i in range(len(C[0]))], [f"u{j}" for j in range(len(D[0]))]
    ys = [_row([*c, *d], x + u) for c, d in zip(C, D, strict=True)]
    y = ys[0] if len(ys) == 1 else "(" + "".join(f"({q},), " for q in ys) + ")"
    asked, acting, equation = "x", [], "y = C x"
    if np.any(D):
        asked, acting, equation = "x, u, d", u, "y = C x + D (u + d)"
    return block(written(
        f"output_of_{_identifiers([name])[0]}", asked, _unpacked(x, acting) + f"return {y}",
        {"__name__": __name__, "total": total},
        f"Output of {name}: {equation}.\n\n    .. math:: {equation}\n    "))


def _unpacked(x, u):
    """Lines that name the states and, where there are any, the inputs with their perturbation."""
    return f"{', '.join(x)}, = x\n" + f"{', '.join(u)}, = total(u, d)\n"*bool(u)


def _symbol(state):
    """LaTeX symbol of a state."""
    if re.match(r"^[a-zA-Z]_?\d+$", state):
        return re.sub(r"^([a-zA-Z])_?(\d+)$", r"\1_{\2}", state)
    return r"\mathrm{" + state.replace("_", r"\_") + "}"
