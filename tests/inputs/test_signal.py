"""The energy spectrum of held signals against closed forms, quadrature and a second implementation."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.special import sici

from testbench.core.errors import ChannelError, EstimationError, LimitError
from testbench.inputs import InputSignal, band_share, energy_spectrum, frequency_below, signal, total_energy
from testbench.inputs.signal import held_spectrum

DT = 0.01
OMEGA = np.concatenate([np.geomspace(1e-4, 300.0, 400), -np.geomspace(0.1, 10.0, 5)])


def held(levels: list[float], steps_s: list[float], start_s: float = 0.0, end_s: float = 10.0) -> np.ndarray:
    """Return samples at 100 Hz that take ``levels`` for ``steps_s`` each, from ``start_s``."""
    u = np.zeros(round(end_s / DT))
    edges = np.rint((start_s + np.concatenate([[0.0], np.cumsum(steps_s)])) / DT).astype(int)
    for begin, end, level in zip(edges[:-1], edges[1:], levels, strict=True):
        u[begin:end] = level
    return u


def integral(u: np.ndarray, low: float, high: float, panels: int) -> np.ndarray:
    """Return the integral of |U|^2 over a band by Gauss-Legendre quadrature with 8 nodes per panel."""
    node, weight = np.polynomial.legendre.leggauss(8)
    edges = np.linspace(low, high, panels + 1)
    half = 0.5 * np.diff(edges)
    omega = (0.5 * (edges[:-1] + edges[1:])[:, None] + half[:, None] * node).ravel()
    return (half[:, None] * weight).ravel() @ energy_spectrum(u, DT, omega)


def test_spectrum_of_a_pulse_is_closed_form() -> None:
    A, W = 0.1, 0.7
    got = energy_spectrum(held([A], [W], 1.3), DT, OMEGA)[:, 0]
    np.testing.assert_allclose(got, (2.0 * A * np.sin(OMEGA * W / 2.0) / OMEGA) ** 2, rtol=1e-9, atol=1e-15 * A**2)


def test_spectrum_of_a_doublet_is_closed_form() -> None:
    A, D = 0.1, 0.5
    got = energy_spectrum(held([A, -A], [D, D], 2.0), DT, OMEGA)[:, 0]
    np.testing.assert_allclose(got, (4.0 * A * np.sin(OMEGA * D / 2.0) ** 2 / OMEGA) ** 2, rtol=1e-9, atol=1e-15 * A**2)


def test_spectrum_of_a_3211_is_closed_form() -> None:
    A, D = 0.1, 0.6
    got = energy_spectrum(held([A, -A, A, -A], [3 * D, 2 * D, D, D], 1.0), DT, OMEGA)[:, 0]
    z = np.exp(-1j * OMEGA * D)
    exact = np.abs(A * (1.0 - 2.0 * z**3 + 2.0 * z**5 - 2.0 * z**6 + z**7) / (1j * OMEGA)) ** 2
    # the reference itself loses digits to cancellation below w ~ 1e-3, where it is compared with its scale (A D)^2
    np.testing.assert_allclose(got, exact, rtol=1e-9, atol=1e-12 * (A * D) ** 2)


def test_spectrum_agrees_with_the_hold_times_the_sampled_transform() -> None:
    # U(w) = dt sinc(w dt / 2) sum_k u_k exp(-j w k dt): the textbook form, summed over samples instead of jumps
    u = np.random.default_rng(1).standard_normal((300, 2))
    omega = np.linspace(0.1, 700.0, 211)
    sampled = np.exp(-1j * np.outer(omega, np.arange(300) * DT)) @ u
    exact = (DT * np.sinc(omega * DT / (2.0 * np.pi)))[:, None] ** 2 * np.abs(sampled) ** 2
    np.testing.assert_allclose(energy_spectrum(u, DT, omega), exact, rtol=1e-9, atol=1e-14)


def test_spectrum_at_zero_is_the_area_squared_and_is_reached_continuously() -> None:
    u = held([0.3, -0.1], [1.0, 0.5], 4.0)
    omega = np.array([0.0, 1e-12, 1e-9, 1e-6, 1e-5])
    area = 0.3 * 1.0 - 0.1 * 0.5
    # curvature: the relative change at w is below (w T)^2 with T = 10 s, 1e-8 at 1e-5 rad/s
    np.testing.assert_allclose(energy_spectrum(u, DT, omega)[:, 0], area**2, rtol=1e-8)


def test_spectrum_of_a_doublet_near_zero_keeps_its_digits() -> None:
    A, D = 0.1, 0.5
    omega = np.geomspace(1e-7, 1e-3, 9)
    # |4 A sin^2(w D / 2) / w| = A D^2 w (1 - (w D)^2 / 12 ...)
    got = energy_spectrum(held([A, -A], [D, D], 2.0), DT, omega)[:, 0]
    np.testing.assert_allclose(np.sqrt(got), A * D**2 * omega, rtol=1e-6)


@pytest.mark.parametrize("levels", [[1.0], [1.0, -1.0], [1.0, -2.0, 0.5]])
def test_parseval(levels: list[float]) -> None:
    u = held(levels, [1.0] * len(levels), 1.0)
    jumps = np.diff(u, prepend=0.0, append=0.0)
    W = 2000.0
    # beyond W the mean of |U|^2 is sum J^2 / w^2; what oscillates integrates to less than 1 / W^2 = 2.5e-7
    energy = (integral(u, 0.0, W, 4000)[0] + np.sum(jumps**2) / W) / np.pi
    assert energy == pytest.approx(total_energy(u, DT)[0], rel=1e-6)


def test_total_energy_of_columns() -> None:
    u = np.column_stack([held([2.0], [1.0]), held([-1.0], [3.0])])
    np.testing.assert_allclose(total_energy(u, DT), [4.0, 3.0], rtol=1e-12)


def test_spectrum_does_not_depend_on_the_block_size(monkeypatch: pytest.MonkeyPatch) -> None:
    u = np.random.default_rng(2).standard_normal(200)
    omega = np.linspace(0.0, 50.0, 101)
    whole = energy_spectrum(u, DT, omega)
    monkeypatch.setattr(signal, "_BLOCK", 1000)
    np.testing.assert_allclose(energy_spectrum(u, DT, omega), whole, rtol=1e-12)


def sweep_like() -> np.ndarray:
    t = np.arange(3000) * DT
    return np.sin(0.5 * t + 0.2 * t**2) + 0.01 * np.random.default_rng(3).standard_normal(t.size)


@pytest.mark.parametrize("u", [held([1.0, -1.0], [0.5, 0.5], 1.0), sweep_like()], ids=["few jumps", "many jumps"])
@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (2.0, 2.001), (4.416, 4.784), (5.0, 60.0)])
def test_band_share_agrees_with_quadrature(u: np.ndarray, low: float, high: float) -> None:
    exact = integral(u, low, high, max(4, int(np.ceil((high - low) * 20.0))))[0] / (np.pi * total_energy(u, DT)[0])
    # 1e-9 of the band, or 1e-11 of the whole energy where the band is nearly empty
    assert band_share(u, DT, low, high)[0] == pytest.approx(exact, rel=1e-9, abs=1e-11)


def test_held_spectrum_is_the_integral_of_the_held_samples() -> None:
    u = np.random.default_rng(6).standard_normal((40, 2))
    omega = np.array([-7.0, 0.4, 3.0, 200.0])
    # sample k holds from k dt to (k + 1) dt: the integral of exp(-j w t) over it
    k = np.arange(40)
    each = (np.exp(-1j * np.outer(omega, k * DT)) - np.exp(-1j * np.outer(omega, (k + 1) * DT))) / (1j * omega[:, None])
    np.testing.assert_allclose(held_spectrum(u, DT, omega), each @ u, rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(np.abs(each @ u) ** 2, energy_spectrum(u, DT, omega), rtol=1e-9, atol=1e-13)


def test_band_shares_by_pairs_and_by_fft_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    u = np.random.default_rng(4).standard_normal((400, 2))
    by_pairs = band_share(u, DT, 3.0, 40.0)
    monkeypatch.setattr(signal, "_PAIRS", 0)
    np.testing.assert_allclose(band_share(u, DT, 3.0, 40.0), by_pairs, rtol=1e-9)


def test_band_shares_add_up_to_one() -> None:
    u = sweep_like()
    edges = [0.0, 0.3, 2.0, 9.0, 100.0, np.inf]
    shares = [band_share(u, DT, a, b)[0] for a, b in pairwise(edges)]
    assert sum(shares) == pytest.approx(1.0, abs=1e-9)
    assert min(shares) > 0.0


def test_energy_of_a_pulse_below_its_first_null() -> None:
    # the main lobe of sinc^2 holds 90.28 % of the energy: 2 / pi (Si(2 pi) - sin^2(pi) / pi) with Si(2 pi) = 1.41815
    u = held([0.2], [0.8], 3.0)
    assert band_share(u, DT, 0.0, 2.0 * np.pi / 0.8)[0] == pytest.approx(2.0 / np.pi * 1.4181515761, abs=1e-9)
    assert frequency_below(u, DT, 2.0 / np.pi * 1.4181515761)[0] == pytest.approx(2.0 * np.pi / 0.8, rel=1e-3)


def test_frequency_below_inverts_band_share() -> None:
    u = np.column_stack([held([1.0, -1.0], [0.5, 0.5]), held([1.0], [2.0], 1.0)])
    for share in (0.05, 0.5, 0.95, 0.999, 0.999999):
        frequency = frequency_below(u, DT, share)
        got = [band_share(u, DT, 0.0, f)[i] for i, f in enumerate(frequency)]
        np.testing.assert_allclose(got, share, rtol=1e-9)


def test_frequency_below_means_95_percent_if_no_share_is_given() -> None:
    u = held([1.0, -1.0], [0.5, 0.5], 1.0)
    assert band_share(u, DT, 0.0, frequency_below(u, DT)[0])[0] == pytest.approx(0.95, rel=1e-9)


@pytest.mark.parametrize("omega", [0.3, 6.0, 500.0])
def test_a_pulse_has_below_any_frequency_the_share_of_its_closed_form(omega: float) -> None:
    # of a pulse of length W, x = w W: 2 / pi (Si(x) - (1 - cos x) / x)
    x = omega * 0.8
    exact = 2.0 / np.pi * (sici(x)[0] - (1.0 - np.cos(x)) / x)
    u = held([0.2], [0.8], 3.0)
    assert band_share(u, DT, 0.0, omega)[0] == pytest.approx(exact, rel=1e-9)
    assert band_share(u, DT, omega, np.inf)[0] == pytest.approx(1.0 - exact, rel=1e-7)


def test_frequency_below_goes_beyond_nyquist_instead_of_stopping_there() -> None:
    u = held([1.0], [DT], 1.0)  # one sample: 95 % lies below 2 pi * 2 / dt or so, Nyquist is pi / dt
    assert frequency_below(u, DT, 0.95)[0] > np.pi / DT


def test_frequency_below_scales_with_the_step() -> None:
    slow, fast = held([1.0, -1.0], [1.0, 1.0]), held([1.0, -1.0], [0.5, 0.5])
    assert frequency_below(fast, DT)[0] == pytest.approx(2.0 * frequency_below(slow, DT)[0], rel=1e-9)


@pytest.mark.parametrize("step_s", [0.6, 0.8, 1.0])
def test_3211_of_eolo_has_nine_tenths_of_its_energy_below_10_rad_s(step_s: float) -> None:
    # EOLO paper, section 3.2: "the 3-2-1-1 maneuver has frequency components below 10 rad/s": true of 90 %, not of 95 %
    u = held([1.0, -1.0, 1.0, -1.0], [3 * step_s, 2 * step_s, step_s, step_s], 1.0)
    assert frequency_below(u, DT, 0.90)[0] < 10.0 < frequency_below(u, DT, 0.95)[0]


def test_shares_refuse_what_has_none() -> None:
    u = np.zeros((100, 2))
    u[10:20, 0] = 1.0
    with pytest.raises(EstimationError, match="energy 0 in column 1"):
        band_share(u, DT, 1.0, 2.0)
    with pytest.raises(EstimationError, match="energy nan in column 0"):
        frequency_below(np.array([0.0, np.nan, 1.0]), DT)
    with pytest.raises(LimitError, match="got 5 and 2"):
        band_share(u[:, :1], DT, 5.0, 2.0)
    with pytest.raises(LimitError, match="share"):
        frequency_below(u[:, :1], DT, 1.0)


def test_signals_add_by_channel() -> None:
    t = np.arange(4) * DT
    one = InputSignal(t, np.ones((4, 1)), ("de",))
    two = InputSignal(t, np.column_stack([np.full(4, 2.0), np.full(4, 3.0)]), ("thr", "de"))
    both = one + two
    assert both.channels == ("de", "thr")
    np.testing.assert_array_equal(both.u, np.tile([4.0, 2.0], (4, 1)))


def test_signals_of_different_rates_do_not_add() -> None:
    one = InputSignal(np.arange(4) * DT, np.ones((4, 1)), ("de",))
    with pytest.raises(LimitError, match=r"4 samples every 0\.01 s and 4 every 0\.02 s"):
        one + InputSignal(np.arange(4) * 2 * DT, np.ones((4, 1)), ("de",))


@pytest.mark.parametrize(
    ("t", "u", "channels", "error", "words"),
    [
        (np.arange(3.0), np.zeros((3, 1)), ("elevator",), ChannelError, "elevator"),
        (np.arange(3.0), np.zeros((3, 2)), ("de", "de"), LimitError, "must differ"),
        (np.arange(3.0), np.zeros((4, 1)), ("de",), LimitError, "shape"),
        (np.arange(1.0), np.zeros((1, 1)), ("de",), LimitError, "at least 2"),
        (np.array([0.0, 1.0, 3.0]), np.zeros((3, 1)), ("de",), LimitError, "k dt"),
        (np.arange(1.0, 4.0), np.zeros((3, 1)), ("de",), LimitError, "k dt"),
        (np.arange(3.0), np.full((3, 1), np.nan), ("de",), LimitError, "finite"),
    ],
)
def test_signal_refuses(t: np.ndarray, u: np.ndarray, channels: tuple, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        InputSignal(t, u, channels)


def test_signal_is_read_only() -> None:
    made = InputSignal(np.arange(3.0), np.zeros((3, 1)), ("de",))
    with pytest.raises(ValueError, match="read-only"):
        made.u[0, 0] = 1.0
