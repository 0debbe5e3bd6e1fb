"""Samples of foreign kinds: refused by one checker wherever arrays enter, or taken as they are."""

import datetime
import decimal
import fractions

import numpy as np
import pytest

from smcaero_nb import ParameterError
from smcaero_nb.differentiators import differentiate, lipschitz, trial
from smcaero_nb.prd import Record, identify
from smcaero_nb.records import numbers

T = np.arange(200)*0.01
Y = np.where(T > 0.5, (T - 0.5)**2, 0.0)
#: Each takes the times and samples of a record.
TAKERS = {
    "trial": lambda t, y: trial((t, y)),
    "differentiate": lambda t, y: differentiate(t, y, 1.0, 1),
    "lipschitz": lambda t, y: lipschitz(t, y, 1),
    "Record": lambda t, y: Record(t, y, 0.5),
    "identify": lambda t, y: identify((t, y, 0.5, 1.0)),
}


class Metres(np.ndarray):
    """An array with a unit, as of pint or astropy."""

    unit = "mm"


class Variable:
    """A variable of a file, as of netCDF4: an array where one is asked for, masked in part."""

    def __init__(self, q):
        self.q = q

    def __len__(self):
        return len(self.q)

    def __array__(self, dtype=None, copy=None):
        return np.ma.masked_array(self.q, self.q == self.q[7], dtype)


def each(q, wrong):
    """A list of the samples with one of another kind among them."""
    return [*q[:7].tolist(), wrong, *q[8:].tolist()]


#: {what: (a record's column made into that, what is said of it)}
WRONG = {
    "masked": (lambda q: np.ma.masked_array(q, q == q[7]), "is masked in part"),
    "masked by another library": (Variable, "is masked in part"),
    "masked in a list": (lambda q: each(q, np.ma.masked), "is masked in part"),
    "complex": (lambda q: q + 0.0j, "holds complex numbers"),
    "complex in a list": (lambda q: each(q, 1j), "holds complex numbers"),
    "dates": (lambda q: np.arange(len(q)).astype("M8[s]"), "holds dates"),
    "durations": (lambda q: np.arange(len(q)).astype("m8[ms]"), "holds durations"),
    "a duration in a list": (lambda q: each(q, np.timedelta64(1, "ms")), "holds durations"),
    "dates of Python": (lambda q: each(q, datetime.date(2026, 1, 1)), "it holds datetime.date"),
    "switches": (lambda q: q > 1.0, "holds switches"),
    "a switch in a list": (lambda q: each(q, True), "holds switches"),
    "text that looks like numbers": (lambda q: q.astype(str), "holds text"),
    "a text in a list": (lambda q: each(q, "nan"), "holds text"),
    "bytes": (lambda q: q.astype("S8"), "holds text"),
    "None": (lambda q: each(q, None), "it holds None"),
    "decimals": (lambda q: each(q, decimal.Decimal(1)), r"it holds Decimal\('1'\)"),
    "fields": (lambda q: q.view([("value", float)]), "holds fields"),
    "a unit": (lambda q: q.view(Metres), "carries a unit"),
    "whole numbers beyond 2**53": (lambda q: np.arange(len(q)) + 2**60, "which float64 would round"),
    "whole numbers without end": (lambda q: each(q, 10**400), "holds a number beyond 1e308"),
    "rows of different lengths": (lambda q: [[1.0], [2.0, 3.0]], "must be real numbers"),
    "a column": (lambda q: q[:, None], "they have the shapes"),
    "a generator": (lambda q: (v for v in q), "in an array or a list; it holds <generator"),
    "a set": (lambda q: set(q.tolist()), "in an array or a list"),
    "a dict": (lambda q: dict.fromkeys(q.tolist()), "in an array or a list"),
    "a number": (lambda q: 1.0, "they have the shapes"),
    "nothing": (lambda q: [], "they have the shapes"),
    "NaN": (lambda q: each(q, np.nan), r"\[7\] = nan.* is not allowed"),
    "infinity": (lambda q: each(q, np.inf), r"\[7\] = inf.* is not allowed"),
}
RIGHT = {
    "a list": np.ndarray.tolist,
    "a tuple": tuple,
    "objects": lambda q: q.astype(object),
    "longer floats": lambda q: q.astype(np.longdouble),
    "a masked array without a mask": np.ma.masked_array,
    "arrays of one": lambda q: [np.array(v) for v in q],
    "fractions": lambda q: [fractions.Fraction(v) for v in q.tolist()],
    "strides": lambda q: np.repeat(q, 2)[::2],
}


@pytest.mark.parametrize("taker", TAKERS)
@pytest.mark.parametrize("kind", WRONG)
def test_what_is_no_sample_is_refused_and_named(kind, taker):
    make, said = WRONG[kind]
    for k, name in enumerate("ty"):
        with pytest.raises(ParameterError, match=said) as why:
            TAKERS[taker](*(make(q) if i == k else q for i, q in enumerate((T, Y))))
        assert len(str(why.value)) < 300
        assert f" {name}" in str(why.value) or f" {name.replace('y', 'f')}" in str(why.value)


@pytest.mark.parametrize("kind", RIGHT)
def test_real_numbers_in_any_container_are_taken_for_what_they_are(kind):
    assert np.array_equal(numbers("test", "t", RIGHT[kind](Y)), Y)
    made = differentiate(RIGHT[kind](T), RIGHT[kind](Y), 2.0, 1)
    assert np.array_equal(made, differentiate(T, Y, 2.0, 1))
    assert np.array_equal(Record(RIGHT[kind](T), RIGHT[kind](Y), 0.5).y, Y)


def test_whole_numbers_that_float64_holds_are_taken():
    times = [2**53 - 1, 2**53, 2**53 + 2]
    assert numbers("test", "t", times).tolist() == times
    assert numbers("test", "t", np.array(times)).tolist() == times
    with pytest.raises(ParameterError, match="9007199254740993, which float64 would round; subtract"):
        numbers("test", "t", [0, 2**53 + 1])


@pytest.mark.parametrize("signal", [5, "text", (T,), {}, object()])
def test_a_signal_that_is_no_pair_is_refused_when_the_trial_is_made(signal):
    with pytest.raises(ParameterError, match="trial: signal = .* is not allowed|holds text"):
        trial(signal)


def test_a_library_whose_arrays_raise_gets_a_sentence():
    class Elsewhere:
        def __array__(self, dtype=None, copy=None):
            raise RuntimeError("on another device")

    with pytest.raises(ParameterError, match="t must be real numbers, in one row.*on another device"):
        numbers("test", "t", Elsewhere())
