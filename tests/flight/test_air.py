from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import welch

from testbench.core.constants import DEG_RAD, FT_M
from testbench.core.errors import LimitError, ScenarioError
from testbench.core.paths import SCENARIOS
from testbench.flight import FlightCondition, Manoeuvre, fly, trim
from testbench.flight.air import Air, Gust, scale_lengths, turbulence, turbulence_rms
from testbench.inputs.signal import InputSignal
from testbench.questions.run.ask import run
from testbench.questions.run.scenario import Scenario

CONDITION = FlightCondition(16.0, 547.0)
WIND = ("wind_north", "wind_east", "wind_down")
RMS, LENGTHS, V = (0.8, 0.6, 0.5), (200.0, 200.0, 100.0), 20.0


def pulse(rate_hz: float, duration_s: float = 4.0) -> Manoeuvre:
    n = round(rate_hz * duration_s)
    u = np.zeros((n, 1))
    u[: round(0.5 * rate_hz)] = 1.0 * DEG_RAD
    return Manoeuvre("pulse", InputSignal(np.arange(n) / rate_hz, u, ("de",)), settle_s=1.0)


@pytest.fixture(scope="module")
def series():
    """Samples every 0.02 time constants of w (0.01 of u and v): 2^19 of them."""
    return turbulence(2**19, 10.0, V, RMS, LENGTHS, np.random.default_rng(5))


def test_the_rms_is_the_one_asked_for(series):
    """Variance of the sample variance: 2 sigma^4 / T times int R^2 dt, which is 1 (u) or 5/8 (v, w) of L / V.

    Bounds at 4.5 standard deviations: false alarms 2e-5 for the three together.
    """
    T = len(series) / 10.0
    for i, share in enumerate((1.0, 5 / 8, 5 / 8)):
        scatter = np.sqrt(2.0 * share * LENGTHS[i] / V / T)
        assert np.mean(series[:, i] ** 2) / RMS[i] ** 2 == pytest.approx(1.0, abs=4.5 * scatter)
    # u, v and w are independent: a correlation coefficient scatters by about sqrt(L / V / T)
    correlation = np.corrcoef(series.T)[np.triu_indices(3, 1)]
    assert np.max(np.abs(correlation)) < 4.5 * np.sqrt(10.0 / T)


def dryden_psd(f_hz, V_m_s, rms_m_s, length_m, component):
    """Return the one-sided spectral density, (m/s)^2/Hz, of gust component "u", "v" or "w" met at airspeed V.

    MIL-F-8785C, 3.7.1.2, with Omega = 2 pi f / V and S(f) = 2 pi / V Phi(Omega), integral over f >= 0 = rms^2:

        Phi_u = rms^2 2 L / pi / (1 + (L Omega)^2),
        Phi_v = Phi_w = rms^2 L / pi (1 + 3 (L Omega)^2) / (1 + (L Omega)^2)^2.
    """
    x2 = (length_m * 2.0 * np.pi * np.asarray(f_hz, float) / V_m_s) ** 2
    low = 2.0 * rms_m_s**2 * length_m / V_m_s
    if component == "u":
        return np.asarray(2.0 * low / (1.0 + x2))
    return np.asarray(low * (1.0 + 3.0 * x2) / (1.0 + x2) ** 2)


def test_the_spectra_are_dryden_s_up_to_the_nyquist_frequency(series):
    """Welch's estimate over Dryden's density, folded as sampling folds it, averaged over 12 bands of frequency.

    A band's mean of M segments and m bins scatters by about sqrt(1.5 / (M m)) (a Hann window ties neighbours together).
    Bounds at 4.5 standard deviations, all 36 bands: false alarms 3e-4.
    """
    rate, size = 10.0, 4096
    f, got = welch(series, rate, nperseg=size, noverlap=0, detrend=False, axis=0)
    edges = np.unique(np.round(np.geomspace(4, size // 2, 13)).astype(int))
    folds = np.arange(-500, 501)[:, None] * rate
    for i, component in enumerate("uvw"):
        exact = dryden_psd(np.abs(f + folds), V, RMS[i], LENGTHS[i], component).sum(axis=0)
        for low, high in pairwise(edges):
            ratio = np.mean(got[low:high, i] / exact[low:high])
            scatter = np.sqrt(1.5 / (len(series) // size * (high - low)))
            assert ratio == pytest.approx(1.0, abs=4.5 * scatter), (component, f[low])


def test_the_density_integrates_to_the_variance():
    f = np.geomspace(1e-6, 1e5, 200_001)
    for component, rms, length in zip("uvw", RMS, LENGTHS, strict=True):
        density = dryden_psd(f, V, rms, length, component)
        # cut at both ends: 1e-6 of the corner below, V / (L f) above
        assert np.trapezoid(density, f) == pytest.approx(rms**2, rel=1e-4)


def test_steps_much_shorter_than_the_time_constant_are_exact():
    """At 1e-4 time constants a step the mean square of the increment is 2 (1 - R): 2 d for u, 3 d for v and w.

    Increments are all but white, so that it scatters by sqrt(2 / n); 4.5 of that: false alarms 2e-5.
    """
    n, d = 200_000, 1e-4
    x = turbulence(n, 1.0 / d, 1.0, (1.0, 1.0, 1.0), (1.0, 1.0, 1.0), np.random.default_rng(2))
    R = np.exp(-d) * np.array([1.0, 1.0 - d / 2.0, 1.0 - d / 2.0])
    assert np.mean(np.diff(x, axis=0) ** 2, axis=0) / (2.0 * (1.0 - R)) == pytest.approx(1.0, abs=4.5 * np.sqrt(2 / n))


def test_scale_lengths_and_intensities_follow_the_specification():
    assert scale_lengths(1000.0 * FT_M) == pytest.approx((304.8, 304.8, 304.8))
    assert scale_lengths(999.9999 * FT_M) == pytest.approx((304.8, 304.8, 304.8), rel=1e-6)
    assert scale_lengths(1500.0 * FT_M) == pytest.approx((1375.0 * FT_M,) * 3)
    assert scale_lengths(5000.0) == pytest.approx((533.4, 533.4, 533.4))
    # at 200 ft: 0.177 + 0.000823 * 200 = 0.3416; 200 / 0.3416^1.2 = 725.78 ft; 1 / 0.3416^0.4 = 1.5368
    assert scale_lengths(200.0 * FT_M) == pytest.approx((725.78 * FT_M, 725.78 * FT_M, 200.0 * FT_M), rel=1e-4)
    assert turbulence_rms(2.0, 200.0 * FT_M) == pytest.approx((3.0736, 3.0736, 2.0), rel=1e-4)
    assert turbulence_rms(2.0, 1000.0) == pytest.approx((2.0, 2.0, 2.0))


def test_a_seed_gives_the_same_bits_and_another_seed_other_air():
    air = Air(turbulence_rms_m_s=(1.0, 1.0, 1.0), seed=3)
    first = air.velocities(2000, 100.0, CONDITION)
    assert np.array_equal(first, Air(turbulence_rms_m_s=(1.0, 1.0, 1.0), seed=3).velocities(2000, 100.0, CONDITION))
    assert np.array_equal(first[:1200], air.velocities(1200, 100.0, CONDITION))
    other = Air(turbulence_rms_m_s=(1.0, 1.0, 1.0), seed=4).velocities(2000, 100.0, CONDITION)
    assert np.max(np.abs(first - other)) > 0.1
    assert np.array_equal(first[0], np.zeros(3))  # the trim is calm
    assert np.max(np.abs(np.diff(first[:10], axis=0))) < 0.05  # and nothing jumps after it


def test_a_wind_of_whole_numbers_is_a_wind():
    whole, floats = Air(3, 0, -1, (1, 1, 1), 100, seed=3), Air(3.0, 0.0, -1.0, (1.0, 1.0, 1.0), 100.0, seed=3)
    assert np.array_equal(whole.velocities(200, 100.0, CONDITION), floats.velocities(200, 100.0, CONDITION))


def test_a_gust_is_the_cosine_it_is_said_to_be():
    t = np.arange(-100, 400) / 100.0
    gust = Gust("down", -2.0, start_s=0.5, duration_s=1.0)
    w = gust.velocity(t, 16.0)
    inside = (t > 0.5) & (t < 1.5)
    assert np.all(w[~inside] == 0.0)
    assert w[inside] == pytest.approx(-1.0 * (1.0 - np.cos(2.0 * np.pi * (t[inside] - 0.5))), abs=1e-12)
    assert w[200] == pytest.approx(-2.0)  # the peak, half way through
    by_length = Gust("down", -2.0, start_s=0.5, length_m=16.0).velocity(t, 16.0)
    assert np.array_equal(by_length, w)
    shifted = Air(wind_east_m_s=3.0, gust=gust).velocities(500, 100.0, CONDITION, settle_s=1.0)
    assert shifted == pytest.approx(np.column_stack([0.0 * w, 3.0 + 0.0 * w, w]), abs=1e-12)


@pytest.mark.parametrize("wind", [(-8.0, 0.0, 0.0), (0.0, 5.0, 0.0), (4.0, -3.0, 0.5), (1 / 3, 0.0, -1.0)])
def test_a_steady_wind_changes_the_ground_speed_and_not_the_airspeed(eolo, eolo_trim, wind):
    air = Air(*wind)
    trimmed = trim(eolo, CONDITION, air=air)
    state = trimmed.state
    assert state["V"] == pytest.approx(16.0, abs=1e-9)
    assert state["beta"] == pytest.approx(0.0, abs=1e-9)
    assert state["Vg"] == pytest.approx(np.hypot(16.0 + wind[0], wind[1]), abs=1e-6)
    assert state["hdot"] == pytest.approx(-wind[2], abs=1e-6)
    assert [state[n] for n in WIND] == pytest.approx(wind, abs=1e-9)
    # the Earth's rotation alone tells them apart: 2 Omega W = 1.5e-4 W m/s2 against g
    assert trimmed.alpha == pytest.approx(eolo_trim.alpha, abs=1e-4)
    n = 2500
    rest = Manoeuvre("rest", InputSignal(np.arange(n) / 500.0, np.zeros((n, 1)), ("de",)), settle_s=0.0)
    record = fly(eolo, trimmed, rest, 50.0, air=air)
    # a vertical wind of 1 m/s carries the aircraft 5 m up or down, where the air is 5e-4 thinner or denser
    for name in ("V", "alpha", "theta"):
        assert np.ptp(record[name]) < (5e-3 if wind[2] else 2e-5) * max(1.0, abs(record[name][0]))


def test_the_aircraft_s_motion_within_the_air_is_that_of_still_air(eolo, eolo_trim):
    """To 1e-3: a head wind changes the centrifugal force of the flight round the Earth, V^2 / R."""
    still = fly(eolo, eolo_trim, pulse(500.0), 100.0)
    air = Air(wind_north_m_s=-8.0)
    windy = fly(eolo, trim(eolo, CONDITION, air=air), pulse(500.0), 100.0, air=air)
    for name in ("V", "alpha", "q", "theta", "eta_1"):
        assert np.std(windy[name] - still[name]) < 1e-3 * np.std(still[name])


def test_still_air_is_no_air(eolo, eolo_trim):
    assert np.array_equal(
        fly(eolo, eolo_trim, pulse(500.0), 100.0).data, fly(eolo, eolo_trim, pulse(500.0), 100.0, air=Air()).data
    )


def test_the_flight_meets_the_air_that_was_made(eolo):
    """The record's wind is the series; airspeed, attitude and speed over the ground add up to it frame by frame."""
    air = Air(-3.0, 2.0, 0.2, turbulence_rms(0.4, 547.0), gust=Gust("down", -1.0, 0.2, duration_s=0.3), seed=7)
    trimmed = trim(eolo, CONDITION, air=air)
    manoeuvre = pulse(500.0)
    record = fly(eolo, trimmed, manoeuvre, 100.0, air=air)
    made = air.velocities(5 * len(record), 500.0, CONDITION, manoeuvre.settle_s)[::5]
    assert record.columns(WIND) == pytest.approx(made, abs=1e-9)
    u, v, w, theta, phi = (record[n] for n in ("u", "v", "w", "theta", "phi"))
    climb = u * np.sin(theta) - (v * np.sin(phi) + w * np.cos(phi)) * np.cos(theta) - record["wind_down"]
    assert record["hdot"] == pytest.approx(climb, abs=1e-9)
    assert np.std(record["alpha"]) > 0.2 * DEG_RAD
    assert record.provenance["air"]["seed"] == 7
    again = fly(eolo, trimmed, manoeuvre, 100.0, air=air)
    assert np.array_equal(record.data, again.data)


def test_a_rising_gust_raises_the_angle_of_attack(eolo, eolo_trim):
    air = Air(gust=Gust("down", -0.5, start_s=0.0, duration_s=0.1))
    n = 500
    rest = Manoeuvre("rest", InputSignal(np.arange(n) / 500.0, np.zeros((n, 1)), ("de",)), settle_s=1.0)
    record = fly(eolo, eolo_trim, rest, 500.0, air=air)
    peak = 525
    assert record["wind_down"][peak] == pytest.approx(-0.5)
    # 0.05 s of a lift of this size moves the aircraft along with the air by less than half the gust
    assert 0.5 < (record["alpha"][peak] - record["alpha"][0]) * 16.0 / 0.5 <= 1.0
    assert np.max(np.abs(record["alpha"][:500] - record["alpha"][0])) < 1e-6  # calm before it


@pytest.mark.parametrize(
    ("make", "law"),
    [
        (lambda: Air(turbulence_rms_m_s=(1.0, -1.0, 1.0)), r"three finite values >= 0 \(u, v, w\), got"),
        (lambda: Air(wind_east_m_s=float("nan")), "component of a wind must be finite"),
        (lambda: Air(height_m=1.0), r"height_m >= 3.048 \(10 ft\) must hold .* got 1; give the height above ground"),
        (lambda: Air(seed=-1), "seed >= 0 must hold, got -1"),
        (lambda: Gust("dwon", 1.0, duration_s=1.0), "got 'dwon'; did you mean 'down'"),
        (lambda: Gust("down", float("inf"), duration_s=1.0), "amplitude of a gust must be finite"),
        (lambda: Gust("down", 1.0), "either duration_s or length_m, got neither"),
        (lambda: Gust("down", 1.0, duration_s=1.0, length_m=2.0), "either duration_s or length_m, got both"),
        (lambda: Gust("down", 1.0, start_s=-1.0, duration_s=1.0), "0 <= start_s must hold"),
        (lambda: Gust("down", 1.0, duration_s=0.0), "duration_s > 0 or length_m > 0 must hold for a gust, got 0"),
    ],
)
def test_faults_are_named(make, law):
    with pytest.raises(LimitError, match=law):
        make()


def test_a_wind_that_was_not_trimmed_in_is_refused(eolo, eolo_trim):
    with pytest.raises(LimitError, match=r"got 5, 0, 0 m/s .* after a trim in 0, 0, 0; call trim\(..., air=air\)"):
        fly(eolo, eolo_trim, pulse(500.0), 100.0, air=Air(wind_north_m_s=5.0))


def scenario_with(tmp_path, air: str):
    text = (SCENARIOS / "taurus_doublet.toml").read_text(encoding="utf-8")
    path = tmp_path / "windy.toml"
    path.write_text(text.replace("[simulation]", f"{air}\n[simulation]"), encoding="utf-8")
    return Scenario.load(path)


def test_a_scenario_runs_in_wind_and_turbulence(tmp_path):
    windy = "[air]\nwind_north_m_s = -4.0\nturbulence_rms_m_s = 0.2\nheight_m = 60.0\n[air.gust]\n"
    scenario = scenario_with(tmp_path, windy + 'axis = "down"\namplitude_m_s = -0.5\nstart_s = 50.0\nlength_m = 30.0\n')
    result = run(scenario)
    truth = result.flights[0].truth
    assert truth["V"][0] == pytest.approx(12.0)
    assert truth["Vg"][0] == pytest.approx(8.0)
    horizontal, _, vertical = turbulence_rms(0.2, 60.0)
    made = Air(-4.0, 0.0, 0.0, (horizontal, horizontal, vertical), 60.0, Gust("down", -0.5, 50.0, length_m=30.0), 1)
    rate = truth.provenance["simulation_rate_hz"]
    every = round(rate * truth.dt_s)
    exact = made.velocities(every * len(truth), rate, FlightCondition(12.0, 100.0), 2.0)[::every]
    assert truth.columns(WIND) == pytest.approx(exact, abs=1e-9)
    assert np.isfinite(result.table["mrse_percent"]).all()
    other = run(scenario, seed=2).flights[0].truth
    assert np.max(np.abs(other["wind_down"] - truth["wind_down"])) > 0.1


def test_faults_of_a_scenario_s_air_are_reported_together(tmp_path):
    with pytest.raises(ScenarioError) as caught:
        scenario_with(
            tmp_path,
            "[air]\nwind_nort_m_s = 1.0\nturbulence_rms_m_s = -1.0\nheight_m = 1.0\n"
            '[air.gust]\naxis = "up"\namplitude_m_s = 1.0\nduration_s = 1.0\n',
        )
    text = str(caught.value)
    assert "air.wind_nort_m_s: unknown key 'wind_nort_m_s'; did you mean 'wind_north_m_s'?" in text
    assert "air.turbulence_rms_m_s: must be 0 to 100 m/s, got -1" in text
    assert "air.height_m: must be greater than or equal to 3.048" in text
    assert "air.gust.axis: must be one of north, east, down, got 'up'" in text
    with pytest.raises(ScenarioError, match="either duration_s or length_m"):
        scenario_with(tmp_path, '[air]\n[air.gust]\naxis = "down"\namplitude_m_s = 1.0\n')
