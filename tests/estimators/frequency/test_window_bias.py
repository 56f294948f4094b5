"""What windows do to a response: computed, covered by what is stated, and made small by the windows that are named."""

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from testbench.core.constants import DEG_RAD
from testbench.core.record import FlightRecord
from testbench.estimators.frequency.response import estimate_frequency_response
from testbench.estimators.frequency.window_bias import biased_response, law_through_windows, response_with_bias

DT = 0.02
N = 4500  # 90 s


def true(w, wn, zeta, delay=0.0, lead=0.5):
    s = 1j * w
    return wn**2 * (1.0 + lead * s) / (s**2 + 2.0 * zeta * wn * s + wn**2) * np.exp(-s * delay)


def sweep(n=N, low=0.3, high=18.0):
    t, rate = np.arange(n) * DT, np.log(high / low)
    edge = np.minimum(1.0, np.minimum(t, t[-1] - t) / 2.0)
    return 0.05 * edge * np.sin(low * t[-1] / rate * (np.exp(t / t[-1] * rate) - 1.0))


def shaken(rng, n=N):
    return lfilter(*butter(2, 18.0 * DT / np.pi), 0.2 * rng.standard_normal(n))


def answer(u, law):
    """Exact answer to u, from rest: a whole transform with 300 s of rest behind."""
    size = len(u) + round(300.0 / DT)
    w = 2.0 * np.pi * np.fft.rfftfreq(size, DT)
    return np.fft.irfft(law(w) * np.fft.rfft(u, size), size)[: len(u)]


def record(rng, inputs, laws, noise=0.05):
    y = sum(answer(u, law) for u, law in zip(inputs, laws, strict=True))
    y = y + noise * np.std(y) * rng.standard_normal(len(y))
    names = [*("de", "da")[: len(inputs)], "q"]
    return FlightRecord(np.arange(len(y)) * DT, names, np.column_stack([*inputs, y]), "measured")


def held(found, truth, i=0, j=0, stated=True):
    """Return where gain and phase lie within what is stated: (k,)."""
    miss = found.H[:, i, j] / truth
    chance = found.diagnostics["interval_factor"] * found.random_error[:, i, j]
    within = chance + found.window_allowance[:, i, j] if stated else chance
    return (np.abs(np.abs(miss) - 1.0) <= within) & (np.abs(np.angle(miss)) <= within)


FEW = [(1.0, 0.7, 0.3), (3.0, 0.7, 0.3), (6.0, 0.2, 0.3), (12.0, 0.05, 0.0)]
ALL = [(wn, zeta, delay) for wn in (1.0, 3.0, 6.0, 12.0) for zeta in (0.05, 0.2, 0.7) for delay in (0.0, 0.1, 0.3)]


@pytest.mark.parametrize("cases", [FEW, pytest.param([*ALL, *ALL[::-1]], marks=pytest.mark.slow)])
def test_stated_errors_hold_the_truth_where_responses_are_usable(cases):
    rng = np.random.default_rng(5)
    counts, before = {w: np.zeros(2) for w in (2.0, 5.0, 10.0, 20.0)}, np.zeros(2)
    for number, (wn, zeta, delay) in enumerate(cases):
        u = sweep() if number % 2 else shaken(rng)
        flown = record(rng, [u], [lambda w: true(w, wn, zeta, delay)])  # noqa: B023 (called at once)
        law = law_through_windows([flown], ("de",), "q")
        for window, count in counts.items():
            found = biased_response([flown], ("de",), ("q",), [law], [window])
            truth, usable = true(found.omega_rad_s, wn, zeta, delay), found.usable[:, 0, 0]
            count += usable.sum(), (usable & held(found, truth)).sum()
            coherent = found.coherence[:, 0] >= 0.6
            before += coherent.sum(), (coherent & held(found, truth, stated=False)).sum()
    for window, (usable, good) in counts.items():
        assert usable >= 3 * len(cases), window
        assert good >= 0.9 * usable, window
    assert before[1] < 0.85 * before[0]  # the random error alone, at the coherent points


@pytest.mark.sampled(2)
@pytest.mark.parametrize("window", [2.0, 5.0])
def test_the_bias_that_is_computed_is_the_bias_without_noise(window):
    rng = np.random.default_rng(6)
    u, law = shaken(rng), lambda w: true(w, 6.0, 0.2)
    found = response_with_bias([record(rng, [u], [law])], ("de",), ("q",), window_s=[window])
    clean = record(rng, [u], [law], noise=0.0)
    exact = estimate_frequency_response([clean], ("de",), ("q",), window_s=window, delay_s=found.delay_s)
    bias = exact.H[:, 0, 0] / law(exact.omega_rad_s) - 1.0
    band = exact.omega_rad_s < 15.0
    assert np.abs(bias[band]).max() > 0.1
    assert np.abs(found.window_bias[band, 0, 0] - bias[band]).max() < 0.03  # measured 0.011 and 0.008


def test_a_pure_delay_is_found_taken_out_and_put_back():
    rng = np.random.default_rng(7)
    flown = record(rng, [sweep()], [lambda w: true(w, 6.0, 0.7, 0.3)])
    found = response_with_bias([flown], ("de",), ("q",), window_s=[2.0])
    plain = estimate_frequency_response([flown], ("de",), ("q",), window_s=2.0)
    band = (found.omega_rad_s > 3.0) & (found.omega_rad_s < 12.0)
    truth = true(found.omega_rad_s, 6.0, 0.7, 0.3)[band]
    assert found.delay_s[0, 0] == pytest.approx(0.3, abs=DT)
    miss, without = (np.abs(r.H[band, 0, 0] / truth - 1.0).max() for r in (found, plain))
    assert without > 0.15  # 0.3 s of 2 s
    assert miss < 0.5 * without  # the memory of the response itself remains


def test_longer_windows_are_named_after_they_helped():
    rng = np.random.default_rng(8)
    flown = record(rng, [shaken(rng)], [lambda w: true(w, 3.0, 0.1)])
    short = response_with_bias([flown], ("de",), ("q",), window_s=[2.0])
    (said,) = [a for a in short.advice if a.code == "short_windows"]
    assert "tried on these records" in said
    assert said.severity == "doubt"
    window = float(said.split("with windows of ")[1].split(" s")[0])
    assert window > 4.0
    better = response_with_bias([flown], ("de",), ("q",), window_s=[window])
    near = [np.abs(r.omega_rad_s - 3.0) < 0.8 for r in (short, better)]
    share = [r.usable[rows, 0, 0].mean() for r, rows in zip((short, better), near, strict=True)]
    assert share[1] > share[0]
    strong = record(rng, [shaken(rng)], [lambda w: true(w, 12.0, 0.9, lead=0.0)])
    enough = response_with_bias([strong], ("de",), ("q",), window_s=[10.0])
    assert not [a for a in enough.advice if a.code == "short_windows"]


@pytest.mark.slow
def test_two_inputs_and_several_records():
    rng = np.random.default_rng(9)
    laws = [lambda w: true(w, 3.0, 0.2, 0.1), lambda w: 0.7 * true(w, 3.0, 0.2, 0.2, 0.0)]
    flown = [record(rng, [shaken(rng, 2500), shaken(rng, 2500)], laws) for _ in range(3)]
    found = response_with_bias(flown, ("de", "da"), ("q",), window_s=[10.0])
    for j, law in enumerate(laws):
        usable = found.usable[:, 0, j]
        assert usable.sum() >= 5
        assert held(found, law(found.omega_rad_s), 0, j)[usable].mean() >= 0.9


def test_an_output_that_no_input_moves_is_nowhere_usable():
    rng = np.random.default_rng(10)
    r = record(rng, [sweep()], [lambda w: true(w, 3.0, 0.5)])
    r = r.with_columns({"q": rng.standard_normal(N)})
    assert law_through_windows([r], ("de",), "q") is None
    found = response_with_bias([r], ("de",), ("q",), window_s=[5.0])
    assert not found.usable.any()
    assert np.all(found.window_allowance == 1.0)


def test_a_flight_of_taurus_agrees_with_its_linearisation(taurus, taurus_trim):
    """The sweep of a simulated flight; short period at 5 rad/s, windows of 2 s."""
    from testbench.flight import linearise
    from testbench.flight.simulate import Manoeuvre, fly
    from testbench.inputs.signal import InputSignal

    n = round(40.0 * taurus_trim.rate_hz)
    t = np.arange(n) / taurus_trim.rate_hz
    u = np.interp(t, np.arange(2000) * DT, sweep(2000, 1.0, 20.0)) * (0.6 * DEG_RAD / 0.05)
    truth = fly(taurus, taurus_trim, Manoeuvre("sweep", InputSignal(t, u[:, None], ("de",))), 60.0)
    q = truth["q"] + 0.1 * DEG_RAD * np.random.default_rng(11).standard_normal(len(truth))
    flown = FlightRecord(truth.t_s, ("de", "q"), np.column_stack([truth["de"] - truth["de"][0], q]), "measured")
    linear = linearise(taurus, taurus_trim)
    for window in (2.0, 5.0):
        found = response_with_bias([flown], ("de",), ("q",), window_s=[window])
        exact = linear.frequency_response(found.omega_rad_s, ["q"], ["de"])[:, 0, 0]
        usable = found.usable[:, 0, 0]
        assert usable.sum() >= 3
        assert held(found, exact)[usable].mean() >= 0.9, window
