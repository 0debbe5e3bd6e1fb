"""A differentiator tried on a signal, text files of numbers, and choices of texts as parameters."""

import io
import math
import warnings
from typing import Annotated, Literal

import numpy as np
import pytest

import smcaero_nb as smc
from smcaero_nb import BlockError, ClosedLoop, Param, ParameterError, block, channels
from smcaero_nb.differentiators import Signal, Trial, differentiate, lipschitz, read_csv, trial
from smcaero_nb.records import Table


def named(text, name="log.csv"):
    """An open file."""
    stream = io.BytesIO(text if isinstance(text, bytes) else text.encode())
    stream.name = name
    return stream


# ---- signals of known derivatives ----------------------------------------------------------------
def test_truth_is_that_of_two_tones():
    found = trial().with_(n_d=4, a_1=2.0, omega_1=3.0, a_2=-0.5, omega_2=0.7, tau=0.02,
                          duration=10.0, L=1e3)()
    t = found.t
    assert isinstance(found, Trial) and len(t) == 501 and t[-1] == pytest.approx(10.0)
    assert found.L == 1e3
    a, b, c, d = np.sin(3.0*t), np.cos(3.0*t), np.cos(0.7*t), np.sin(0.7*t)
    for i, (sine, cosine) in enumerate([(a, c), (b, -d), (-a, -c), (-b, d), (a, c)]):
        exact = 2.0*3.0**i*sine - 0.5*0.7**i*cosine
        np.testing.assert_allclose(found.truth[i], exact, atol=1e-11*3.0**i)
    np.testing.assert_array_equal(found.f, found.truth[0])  # without noise
    np.testing.assert_array_equal(found.estimates, differentiate(t, found.f, 1e3, 4))


def test_a_still_signal_has_still_derivatives():
    found = trial().with_(omega_1=0.0, omega_2=0.0, a_2=3.0)()
    assert (found.truth[0] == 3.0).all() and not found.truth[1:].any() and found.errors.max() < 1e-9


@pytest.mark.parametrize("method, wanted", [("levant", [4, 3, 2, 1]), ("matching", [4, 3, 2, 1]),
                                            ("euler", [None, 1, 1, 1]),
                                            ("implicit", [math.nan, 3, 2, 1])])
def test_slopes_show_the_order_of_the_method(method, wanted):
    found = trial().with_(n_d=3, method=method)()
    assert found.sizes.shape == (4, 5)
    assert np.all(found.tau == 1e-2*np.array([4.0, 2.0, 1.0, 0.5, 0.25]))
    for slope, order in zip(found.slopes, wanted, strict=True):
        assert order is None or slope == pytest.approx(order, abs=0.2, nan_ok=True)
    late = len(found.t)//2
    wanted = np.abs(found.estimates - found.truth)[:, late:].max(1)
    np.testing.assert_array_equal(found.errors, wanted)
    assert str(found) == "L = 2; maximum errors in the second half: " + ", ".join(
        f"|z_{i} - f^({i})| {e:.2g}" for i, e in enumerate(wanted))


def test_noise_takes_the_slopes_and_is_that_of_its_seed():
    noisy = trial().with_(eps=0.1, n_d=1)
    one, two = noisy(), noisy()
    np.testing.assert_array_equal(one.f, two.f)
    noise = one.f - one.truth[0]
    assert 0.09 < np.abs(noise).max() <= 0.1 and abs(noise.mean()) < 0.01
    assert np.abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.1  # white
    assert max(one.slopes) < 0.5
    np.testing.assert_allclose(trial().with_(eps=0.05, n_d=1)().f - one.truth[0], 0.5*noise,
                               atol=1e-14)


def test_a_tone_is_a_cosine_and_a_filter_takes_it_away():
    tone = trial().with_(noise="tone", eps=0.5, omega_n=1000.0, tau=1e-3)
    found = tone()
    np.testing.assert_allclose(found.f - found.truth[0], 0.5*np.cos(1000.0*found.t), atol=1e-12)
    assert tone.with_(n_f=3)().errors[1] < 0.1*found.errors[1]


def test_jitter_moves_the_times_and_implicit_refuses_them():
    found = trial().with_(jitter=0.9)()
    steps = np.diff(found.t)
    off = np.abs(found.t - 0.01*np.arange(len(found.t)))
    assert steps.min() > 0.0 and 0.004 < off.max() <= 0.0045 and np.ptp(steps) > 0.01
    with pytest.raises(ParameterError, match="method = 'implicit' needs even steps"):
        trial().with_(jitter=0.5, method="implicit")()


def test_the_bound_is_found_or_doubted():
    found = trial().with_(found=True, n_d=1)()  # |f''| <= 1 + 0.5/4
    assert found.L == lipschitz(found.t, found.f, 1) and 1.1 < found.L < 2.5
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        trial().with_(found=True, n_d=1)()
        trial().with_(n_d=1, L=1.126)()
    with pytest.warns(UserWarning, match="L is chosen automatically"):
        assert trial().with_(found=True, n_d=1, L=0.1)().L == found.L
    with pytest.warns(UserWarning, match=r"L = 1 is less than the 1.12 that derivative 2 of f may "
                                         r"reach"):
        trial().with_(n_d=1, L=1.0)()


@pytest.mark.parametrize("changes, said", [
    (dict(tau=0.5),
     r"tau = 0.5 s is not allowed; with T = 20 s it must be from 4e-05 to 0.2 s \(500000 to 100 "
     r"samples\)"),
    (dict(tau=1e-6), "from 4e-05 to 0.2 s"),
    (dict(tau=0.01, duration=0.5), "with T = 0.5 s it must be from 1e-06 to 0.005 s"),
    (dict(n_f=12, n_d=3), "n_f = 12 is not allowed; it must be a whole number from 0 to 9"),
])
def test_what_cannot_be_tried_is_refused(changes, said):
    with pytest.raises(ParameterError, match=said):
        trial().with_(**changes)()


def test_the_limits_said_are_those_kept():
    assert len(trial().with_(tau=0.2)().t) == 101


# ---- records -------------------------------------------------------------------------------------
def test_a_record():
    t = np.arange(500)*0.01
    f = np.sin(t)
    found = trial((t, f))()
    assert found.truth is None and found.L == lipschitz(t, f, 2)
    np.testing.assert_array_equal(found.estimates, differentiate(t, f, "auto", 2))
    assert str(found) == f"500 samples, L = {found.L:.3g}" and all(map(math.isnan, found.slopes))
    assert found.sizes.shape == (3, len(found.tau)) and np.isnan([found.tau, *found.sizes]).all()
    assert np.isnan(found.errors).all()
    assert found.estimates[1][300:] == pytest.approx(np.cos(t[300:]), abs=0.01)
    said = trial((t, f)).with_(found=False, L=5.0, n_d=1, method="implicit")()
    np.testing.assert_array_equal(said.estimates, differentiate(t, f, 5.0, 1, method="implicit"))
    with pytest.raises(ParameterError, match="samples without a gap are too few; n_d = 12 needs"):
        trial((t[:20], f[:20])).with_(n_d=12)()


def test_a_record_is_the_callers_to_change_afterwards():
    t, f = np.arange(200)*0.01, np.ones(200)
    made = trial((t, f))
    f[:] = np.nan
    assert (made().f == 1.0).all()


@pytest.mark.parametrize("start, tau", [(0.0, 0.01), (1.7e9, 1e-3), (-5.0, 1.0/3.0)])
def test_csv_there_and_back(start, tau):
    t = start + tau*np.arange(400)
    found = trial((t, np.sin(np.arange(400)*0.01)))()
    text = found.to_csv()
    assert text.splitlines()[0] == "t [s],f,z_0 [f],z_1 [f/s],z_2 [f/s^2]"
    table = np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1)
    np.testing.assert_allclose(table.T[1:], [found.f, *found.estimates], rtol=1e-9, atol=1e-12)
    back = read_csv(named(text, "own.csv"))
    assert isinstance(back, Signal) and back.name == "own"
    assert "own.csv: 400 rows, 5 columns, delimiter comma" in back.about
    np.testing.assert_allclose(back.t - start, t - start, atol=1e-5*tau)  # also of times since 1970
    np.testing.assert_allclose(back.f, found.f, rtol=1e-9)
    if not start:
        np.testing.assert_allclose(trial(back)().estimates, found.estimates, atol=1e-3)


def test_columns_of_a_signal():
    text = "row;time [ms];position (mm);f\n" + "".join(f"{k};{k};{k/2};{3*k}\n".replace(".", ",")
                                                       for k in range(10))
    back = read_csv(named(text), t="time", f="position")
    np.testing.assert_allclose(back.t, 1e-3*np.arange(10))
    np.testing.assert_allclose(back.f, np.arange(10)/2)
    assert "t = 'time' [ms], f = 'position' [mm]" in back.about
    with pytest.raises(ParameterError, match="f = 'speed' does not exist; the columns are row, "
                                             "time, position, f"):
        read_csv(named(text), f="speed")


def test_a_log_in_hours():
    """Ten daily turns, a sample per minute: a mask has to take the bound of 2.8e-16 f/s^4."""
    t, rng, omega = np.arange(0.0, 240.0, 1.0/60.0), np.random.default_rng(0), 2.0*np.pi/86400.0
    f = 10.0*np.sin(3600.0*omega*t) + 0.05*rng.standard_normal(len(t))
    text = "t [h],f\n" + "".join(f"{a!r},{b!r}\n"
                                 for a, b in zip(t.tolist(), f.tolist(), strict=True))
    mask = smc.ui.mask(trial(read_csv(named(text))).with_(n_d=3))
    for found, L in ((True, "2"), (False, "2.8e-16")):
        mask.entries["L"].value, mask.widgets["found"].value = L, found
        tried = mask.target()
        assert 1.0 <= tried.L/2.79e-16 < 2.0
        assert np.abs(tried.estimates[1]/omega - 10.0*np.cos(omega*tried.t))[len(t)//2:].max() < 1.0
    mask.widgets["L"].value = 10.0  # its slider starts where it did
    assert mask.target.values["L"] == 10.0 and mask.widgets["L"].min == -2.0


# ---- text files ----------------------------------------------------------------------------------
ROWS = ((0.0, 1.5), (0.1, -2.5), (0.2, 1e-3))


@pytest.mark.parametrize("text", [
    "t,f\n0,1.5\n0.1,-2.5\n0.2,1e-3\n",
    "t,f\r\n0,1.5\r\n0.1,-2.5\r\n0.2,1e-3\r\n",
    "t,f\r0,1.5\r0.1,-2.5\r0.2,1e-3",
    "\ufefft,f\n0,1.5\n0.1,-2.5\n0.2,1e-3\n",
    '"t","f"\n"0","1.5"\n"0.1","-2.5"\n"0.2","1e-3"\n',
    '"t [s]";"f, filtered (V)"\n"0";"1,5"\n"0,1";"-2,5"\n"0,2";"1e-3"\n',
    "# a log\n\nt,f,\n0,1.5,\n0.1,-2.5,\n% a remark\n0.2,1e-3,\n",
    "t , f\n 0 , 1.5 \n 0.1 , -2.5 \n 0.2 , 1e-3 \n",
    "t\tf\n0\t1,5\n0,1\t-2,5\n0,2\t0,001\n",
    "  t   f\n  0  +1.5\n 0.1 -2.5\n 0.2 1E-3",
    "t [ms];f [V]\n0;1,5\n100;-2,5\n200;0,001\n",
    "t (μs),f\n0,1.5\n1e5,-2.5\n2e5,1e-3\n",
    "t,f,f 2\n0,1.5,x\n0.1,-2.5,y\n0.2,1e-3,z\n",
], ids=["plain", "crlf", "cr", "bom", "quotes", "decimal commas in quotes", "trailing comma",
        "blanks about", "tabs", "blanks",
        "ms", "mu", "texts in another column"])
def test_the_same_numbers_in_many_forms(text):
    table = Table("test", named(text))
    assert table.names[0] == "t" and table.names[1].startswith("f")
    np.testing.assert_allclose(np.column_stack([table.times("t"),
                                                table.column("f", table.names[1])[0]]), ROWS,
                               atol=1e-15)
    assert table.name == "log" and table.file == "log.csv"


@pytest.mark.parametrize("text, said", [
    (b"", "log.csv: a line of names and lines of numbers are needed"),
    ("t,f\n", "a line of names and lines of numbers are needed"),
    ("0,1\n1,2\n2,3\n",
     r"line 1: the first line must hold the names of the columns, not numbers \(0, 1\)"),
    ("value\n1\n2\n", r"only one column \('value'\) was found; time and output are needed"),
    ("t,f\n0,1\n1,nan\n", r"line 3: column 2 \('f'\): 'nan' is not a finite number"),
    ("t,f\n0,1\n\n1,\n", r"line 4: column 2 \('f'\): '' is not a finite number"),
    ("t,f\n0,1e999\n1,2\n", "'1e999' is not a finite number"),
    ("t;f\n0;1.234.5\n1;2\n", r"'1.234.5' is not a finite number"),
    ("t,f\n0,1\n1,2,3\n", "line 3: 3 columns, but 2 names; the delimiter is comma"),
    ("t,f\n0,1\n0,2\n", r"line 3: column 1 \('t'\): 0 after 0; times must increase"),
    ("t,f\n1,1\n0,2\n", r"line 3: column 1 \('t'\): 0 after 1; times must increase"),
    ("t [d],f\n0,1\n1,2\n",
     r"the unit of time \[d\] is not known; it must be one of s, sec, seconds, ms"),
    ("t,f,f\n0,1,2\n1,2,3\n", r"f = 'f' names 2 columns; give each its own name"),
    # names without a word: the signal is not the time
    ("[s],(V)\n0,1\n1,2\n", "names 2 columns"),
    ('t,f\n"0,1\n1,2\n', "line 2: 1 columns, but 2 names"),
    # longer than a field of module csv may be
    ("t,f\n0,\"" + "9"*200_000 + "\"\n1,2\n", "is not a finite number"),
    (b"t,f\n0,\xb0\n", "line 2: column 2"),
    (b"\xff\xfet\x00,\x00f\x00\n", "cannot be read"),
])
def test_bad_files_are_refused_by_line_and_column(text, said):
    with pytest.raises(ParameterError, match=said) as why:
        read_csv(named(text))
    assert str(why.value).startswith("differentiators.read_csv: log.csv")
    assert len(str(why.value)) < 300


@pytest.mark.parametrize("text, line, other", [
    ("t;f\n0;0,5\n1;1.234\n", 3, 2), ("t;f\n0;1.234\n1;0,5\n", 2, 3),
    ("t\tf\n0.5\t1,234\n1\t2\n", 2, 2),
    ("t f\n0.5 1\n1 -12,345\n", 3, 2), ("t;f\n0;1.234\n1;5,678\n", 2, 3),
    ("t;f\n0;1.234,5\n1;0.5\n", 3, 2), ("t;f;g\n0;1.5;0\n1;2;1.234,5\n", 2, 3),
    ("t;f;g\n0;1.234;1,234.5\n1;2;1.234,5\n", 2, 2),
])
def test_a_number_that_may_have_a_separator_of_thousands_is_refused(text, line, other):
    said = (rf"line {line}: column [12] .* may mean thousands or decimals, "
            rf".* \(line {other}\); write")
    with pytest.raises(ParameterError, match=said):
        read_csv(named(text))


@pytest.mark.parametrize("text, values", [
    ("t;f\n0;1.234,5\n1;1.234\n2;0,25\n3;-1.234.567,0\n4;12\n",
     [1234.5, 1234.0, 0.25, -1234567.0, 12.0]),
    ("t;f\n0;1,234.5\n1;1,234\n2;0.25\n3;1.234\n", [1234.5, 1234.0, 0.25, 1.234]),
    ("t\tf\n0\t1,234\n1\t0,5\n", [1.234, 0.5]), ("t;f\n0;1.234\n1;0.5\n", [1.234, 0.5]),
    ("t;f\n0.5;1,5\n1.5;0,123\n", [1.5, 0.123]),  # a zero before it: no thousands
    ("t;f\n0;1,5e3\n1;2.5\n", [1500.0, 2.5]), ("t,f\n0,1.234\n1,2\n", [1.234, 2.0]),
])
def test_numbers_whose_marks_are_clear_are_read_for_what_they_are(text, values):
    assert read_csv(named(text)).f.tolist() == values


def test_a_long_file_is_read_in_reasonable_time():
    """100 000 lines take 0.25 s; the bound is generous, but tells a quadratic reader."""
    import time

    text = "t,f\n" + "".join(f"{k},{k}.5\n" for k in range(100_000))
    began = time.perf_counter()
    assert len(read_csv(named(text)).t) == 100_000
    assert time.perf_counter() - began < 5.0


# ---- parameters that are a choice ----------------------------------------------------------------
@block(check=lambda v: "mode b needs k > 1" if v["mode"] == "b" and v["k"] <= 1.0 else None)
def chosen(mode: Annotated[Literal["a", "b"], Param("mode", help="which")] = "a", k: float = 1.0):
    """Something with a choice."""
    return mode, k


def test_a_choice_of_texts():
    assert chosen() == ("a", 1.0) and chosen.with_(mode="b", k=2.0)() == ("b", 2.0)
    assert repr(chosen.with_(k=3.0)) == "chosen(mode=a, k=3)"
    for wrong in ("c", "A", "", 1, 1.0, None, True):
        with pytest.raises(ParameterError, match=r"chosen: mode = .* is not allowed; it must be "
                                                 r"one of 'a', 'b'"):
            chosen.with_(mode=wrong)
    with pytest.raises(ParameterError, match="mode b needs k > 1"):
        chosen.with_(mode="b")
    assert channels(one=chosen,
                    two=chosen).with_(two__k=2.0).with_(two__mode="b").values["two__mode"] == "b"


def test_a_default_that_is_no_choice_is_refused():
    with pytest.raises(ParameterError,
                       match="mode = 'z' is not allowed; it must be one of 'a', 'b'"):
        @block
        def wrong(mode: Literal["a", "b"] = "z"):
            return mode


def test_the_trial_offers_every_method():
    for method in smc.differentiators.methods.METHODS:
        assert trial().with_(method=method).values["method"] == method
    with pytest.raises(ParameterError, match="one of " + ", ".join(
            map(repr, smc.differentiators.methods.METHODS))):
        trial().with_(method="none")


def test_the_choices_are_part_of_what_is_compiled():
    def make(texts):
        @block
        def f(mode: Annotated[Literal[texts], Param("m")] = "a"):
            return mode

        return f

    assert make(("a", "b")).content() != make(("a", "c")).content()


def test_a_loop_refuses_a_choice_of_texts():
    @block(state=dict(x=1.0))
    def plant(x, u, d):
        return u

    @block
    def law(sigma, mode: Annotated[Literal["a", "b"], Param("mode")] = "a"):
        return -sigma

    with pytest.raises(BlockError, match="law 'law': mode is a choice of texts; a stage has "
                                         "numbers and switches only"):
        ClosedLoop(plant, law=law)
