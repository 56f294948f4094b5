"""Filter error: gain and derivatives against independent computations, simulated turbulence, the HFB-320 flight."""

import numpy as np
import pytest
from parametric_cases import FILTER_ERROR_HFB, HFB
from recorded import flight_data
from scipy.linalg import expm, solve_discrete_are
from studies.filter_error_study import TRUE as GUST_TRUE
from studies.filter_error_study import flight as gust_flight
from studies.filter_error_study import structure as gust_structure

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators.parametric import filter_error, output_error
from testbench.estimators.parametric.kalman.forms import _Gust, chi_bar_square, with_gust
from testbench.estimators.parametric.kalman.innovations import sampled_noise, steady_gain
from testbench.estimators.parametric.kalman.likelihood import FilterLikelihood
from testbench.estimators.parametric.likelihood import Driven, Layout, Likelihood, stretch
from testbench.estimators.parametric.response import Sampling
from testbench.estimators.parametric.structure import STEP
from testbench.estimators.parametric.structures import roll_yaw_rates
from testbench.estimators.parametric.structures.aerodynamic import aerodynamic_longitudinal
from testbench.estimators.parametric.structures.longitudinal import short_period
from testbench.estimators.settings import FilterError

TRUE = {"Z_0": 0.0, "Z_alpha": -0.9, "Z_q": 0.0, "Z_de": -0.1, "M_0": 0.0, "M_alpha": -5.0, "M_q": -1.8, "M_de": -7.0}
FREE = ("Z_alpha", "M_alpha", "M_q", "M_de")
F, G, DT = np.array([0.01, 0.04]), np.array([1e-3, 4e-3]), 0.04
A = np.array([[-0.9, 1.0], [-5.0, -1.8]])
B = np.array([[-0.1], [-7.0]])


def structure(values=TRUE, free=FREE):
    return short_period().with_parameters(values, free=free)


def flight(seed, N=500, turbulence=F, noise=G, missing=0.0):
    """Inputs that change linearly between samples, process noise white in continuous time."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(N)
    u = np.zeros((N, 1))
    for begin, end, sign in (
        (1, 2.5, 1),
        (2.5, 3.5, -1),
        (3.5, 4, 1),
        (4, 4.5, -1),
        (9, 10, -1),
        (10, 11, 1),
        (15, 17, 1),
    ):
        u[(t >= begin) & (t < end)] = 0.05 * sign
    u[1:] = 0.5 * (u[1:] + u[:-1])  # a step takes two samples: it runs linearly and is not held
    M = np.zeros((4, 4))
    M[:2, :2], M[:2, 2:3], M[2, 3] = A, B, 1.0
    E = expm(M * DT)
    Phi, step, ramp = E[:2, :2], E[:2, 2], E[:2, 3]
    _, Q = sampled_noise(A, turbulence, DT)
    root = np.linalg.cholesky(Q + 1e-18 * np.eye(2)) if np.any(turbulence) else np.zeros((2, 2))
    x, X = np.zeros(2), np.zeros((N, 2))
    for k in range(N - 1):
        x = Phi @ x + step * u[k, 0] + ramp * (u[k + 1, 0] - u[k, 0]) / DT + root @ rng.standard_normal(2)
        X[k + 1] = x
    y = X + noise * rng.standard_normal(X.shape)
    valid = np.ones((N, 3), bool)
    valid[:, 1:] = rng.uniform(size=(N, 2)) >= missing
    return FlightRecord(t, ("de", "alpha", "q"), np.hstack([u, y]), "measured", valid=valid)


def likelihood_of(records, s, biases=()):
    layout = Layout(np.flatnonzero(s.free), True, (0,), 2, len(biases))
    parts = [stretch(r, s, np.zeros(1), FilterError(output_biases=biases)) for r in records]
    return FilterLikelihood(Likelihood(s, parts, layout, Sampling(DT, np.zeros(1, bool))), [0, 1], np.zeros(2))


def test_process_noise_of_a_sample_is_the_integral():
    Phi, Q = sampled_noise(A, F, DT)
    s = (np.arange(2000) + 0.5) * DT / 2000
    slices = np.array([expm(A * v) * F for v in s])
    np.testing.assert_allclose(Phi, expm(A * DT), rtol=1e-13)
    np.testing.assert_allclose(Q, np.einsum("kij,klj->il", slices, slices) * DT / 2000, rtol=1e-6)


def test_gain_solves_the_riccati_equation_and_its_derivative_is_exact():
    C = np.array([[1.0, 0.0], [0.0, 1.0], [-5.0, -1.8]])
    noise = np.array([1e-3, 4e-3, 0.1])

    def gain(a, f):
        z = np.array([[[a, 1.0], [-5.0, -1.8]]], complex)
        return steady_gain(z, C[None].astype(complex), np.array([[f, 0.04]], complex), noise, DT).K[0]

    Phi, Q = sampled_noise(A, F, DT)
    P = solve_discrete_are(Phi.T, C.T, Q, np.diag(noise**2))
    K = P @ C.T @ np.linalg.inv(C @ P @ C.T + np.diag(noise**2))
    np.testing.assert_allclose(gain(-0.9, 0.01).real, K, rtol=1e-9)
    rows = np.tile(A.astype(complex), (3, 1, 1))
    rows[0, 0, 0] += 1j * STEP
    noises = np.tile(F.astype(complex), (3, 1))
    noises[1, 0] += 1j * STEP
    exact = steady_gain(rows, np.tile(C.astype(complex), (3, 1, 1)), noises, noise, DT).K.imag / STEP
    # central differences with a step of 1e-5 of the value: truncation 1e-10, rounding 1e-11 relative
    h = 1e-5
    np.testing.assert_allclose(
        exact[0], (gain(-0.9 + h, 0.01) - gain(-0.9 - h, 0.01)).real / (2 * h), rtol=1e-5, atol=1e-9
    )
    h = 1e-7
    np.testing.assert_allclose(
        exact[1], (gain(-0.9, 0.01 + h) - gain(-0.9, 0.01 - h)).real / (2 * h), rtol=1e-4, atol=1e-7
    )


def test_kc_stays_below_one_however_strong_the_process_noise():
    for f in (1e-6, 1.0, 1e6):
        K = steady_gain(A[None].astype(complex), np.eye(2)[None].astype(complex), np.full((1, 2), f, complex), G, DT).K
        eigenvalues = np.linalg.eigvals(K[0].real)
        assert np.all(eigenvalues.real <= 1.0 + 1e-12)
        assert np.all(eigenvalues.real >= 0.0)


def test_an_input_that_acts_late_is_found_in_turbulence():
    late_s, plain = 0.08, flight(4)
    diagonal = {"process_noise_model": "diagonal", "against_none": False}
    t, u = plain.t_s, plain["de"]
    early = plain.with_columns({"de": np.interp(t + late_s, t, u)})  # logged before it acts
    found = filter_error.estimate([early], structure(), FilterError(late_std_s={"de": 0.1}, **diagonal))
    (time,), (error,) = (found.diagnostics[key] for key in ("lateness_s", "lateness_std_s"))
    assert abs(time["de"] - late_s) < 4.0 * error["de"] < late_s  # by chance 6e-5
    assert found.delays_s == (time["de"],)
    for name in FREE:  # as above, 3e-4 for all four
        assert abs(found.values[name] - TRUE[name]) < 4.0 * found.standard_errors[name], name


def test_derivatives_by_lateness_agree_with_differences_of_two_inputs():
    s = roll_yaw_rates()
    rng, n = np.random.default_rng(7), 120
    data = np.column_stack([0.05 * np.sin(np.arange(n)[:, None] * [0.1, 0.17, 0.2]), rng.normal(0.0, 0.02, (n, 2))])
    record = FlightRecord(DT * np.arange(n), ("da", "dr", "beta", "p", "r"), data, "measured")
    given = FilterError(late_std_s={"da": 0.02, "dr": 0.02}, input_biases=("dr",))
    base = Likelihood.over([record], s, Driven(np.zeros(len(s.inputs)), np.zeros(len(s.inputs), bool)), given)
    like, R = FilterLikelihood(base, [0, 1], np.zeros(2)), np.array([1e-4, 1e-4])
    point = like.start(s.values + 0.1)
    point[[like.names().index(f"lateness of {name}") for name in ("da", "dr")]] = 0.005  # between two samples
    (part,) = like.evaluate(point, R)
    for name in ("bias of dr", "lateness of da", "lateness of dr"):
        j, step = like.names().index(name), np.zeros(point.size)
        step[j] = 0.05 * DT  # over which the estimator takes lateness; the filter is linear in a bias
        (ahead,) = like.evaluate(point + step, R)
        np.testing.assert_allclose(part.dv.values[:, :, j], (ahead.v - part.v) / step[j], rtol=1e-6, atol=1e-9)


def test_derivatives_of_the_innovations_agree_with_differences():
    s = structure()
    like = likelihood_of([flight(1, 80, missing=0.2), flight(2, 60)], s, biases=("q",))
    rng = np.random.default_rng(3)
    point = like.start(s.values)
    point += 0.05 * np.abs(point) * rng.standard_normal(point.size) + 1e-3 * rng.standard_normal(point.size)
    R = np.array([1e-5, 4e-5])
    exact = like.evaluate(point, R)
    for j in range(point.size):
        h = 1e-5 * max(1.0, abs(point[j]))
        step = np.zeros(point.size)
        step[j] = h
        ahead, behind = like.evaluate(point + step, R), like.evaluate(point - step, R)
        for i in range(2):
            difference = (ahead[i].v - behind[i].v) / (2 * h)
            scale = np.abs(difference).max() + 1e-6
            # truncation h^2 and rounding 1e-16 / h: both below 1e-9 of sensitivities of order one
            felt = exact[i].dv.values[:, :, exact[i].dv.columns == j].sum(axis=2)  # none of another record's own
            np.testing.assert_allclose(felt, difference, atol=1e-6 * scale)


@pytest.mark.parametrize("missing", [0.0, 0.2])
def test_parameters_and_process_noise_reach_the_truth_within_their_errors(missing):
    start = {**TRUE, "Z_alpha": -0.5, "M_alpha": -3.0, "M_q": -1.0, "M_de": -4.0}
    records = [flight(10, 500, missing=missing), flight(11, 400, missing=missing)]
    model = filter_error.estimate(records, structure(start))
    assert model.diagnostics["converged"]
    for name in FREE:
        # 4 standard errors: 6e-5 false alarms per parameter
        assert abs(model.values[name] - TRUE[name]) < 4.0 * model.standard_errors[name], name
        assert model.standard_errors[name] < 0.2 * abs(TRUE[name])
    for name, f in zip(("alpha", "q"), F, strict=True):
        value, std = model.diagnostics["process_noise"][name]
        # F and G share one factor of scale: what noise is not split as the innovations are comes on top of the errors
        assert 0.6 * f < value < 1.6 * f
        assert 0.0 < std < 0.5 * value
    assert model.diagnostics["kc_eigenvalue"] < 1.0
    if not missing:  # the gain is that of complete samples, so that innovations after a gap are not quite white
        assert np.all(model.diagnostics["whiteness_p"] > 1e-3)  # white: 1e-3 false alarms per output


@pytest.mark.slow
def test_in_turbulence_filter_error_scatters_less_than_output_error():
    strong = 4.0 * F
    errors = {"filter": [], "output": []}
    for seed in range(8):
        record = flight(100 + seed, 400, turbulence=strong)
        for name, kind in (("filter", filter_error), ("output", output_error)):
            model = kind.estimate([record], structure())
            errors[name].append([model.values[n] - TRUE[n] for n in FREE])
    spread = {name: np.sqrt(np.mean(np.square(e), axis=0)) for name, e in errors.items()}
    # Both scatter; the filter's weights are right. Over 8 flights a ratio of two such deviations scatters by 35 %.
    assert np.all(spread["filter"] < 0.9 * spread["output"])


@pytest.mark.slow
def test_standard_errors_are_those_of_the_scatter():
    estimates, claimed = [], []
    for seed in range(16):
        model = filter_error.estimate([flight(200 + seed, 300)], structure())
        estimates.append([model.values[n] for n in FREE])
        claimed.append(np.sqrt(np.diag(model.covariance_plain))[structure().free])
    ratio = np.std(estimates, axis=0, ddof=1) / np.sqrt(np.mean(np.square(claimed), axis=0))
    # 15 degrees of freedom: chi lies in 0.4 to 1.75 times its mean with 1e-3 outside, for each of four parameters
    assert np.all((ratio > 0.4) & (ratio < 1.75))


def test_without_turbulence_it_is_output_error():
    record = flight(20, 500, turbulence=np.zeros(2))
    by_output_error = output_error.estimate([record], structure())
    free, chosen = (
        filter_error.estimate([record], structure(), FilterError(process_noise_model=m)) for m in ("diagonal", "auto")
    )
    for name in FREE:
        # process noise that is not there is estimated as a little: within a third of a standard error
        error = by_output_error.standard_errors[name]
        assert abs(free.values[name] - by_output_error.values[name]) < 0.34 * error
        assert abs(chosen.values[name] - by_output_error.values[name]) < 0.01 * error
        assert chosen.standard_errors[name] == pytest.approx(error, rel=0.01)
    assert all(v < 0.3 * f for (v, _), f in zip(free.diagnostics["process_noise"].values(), F, strict=True))
    assert chosen.diagnostics["process_noise_model"] == "none"
    assert chosen.diagnostics["process_noise"] == {}
    assert [a.code for a in chosen.advice] == ["no_process_noise"]
    assert chosen.status == "good"


@pytest.mark.slow
def test_the_likelihood_ratio_has_the_false_alarms_that_it_states_and_finds_weak_turbulence():
    seen = {"calm": [], "turbulent": []}
    for seed in range(40):
        for name, turbulence in (("calm", 0.0 * F), ("turbulent", 0.3 * F)):
            record = flight(500 + seed, 250, turbulence=turbulence)
            model = filter_error.estimate([record], structure(), FilterError(process_noise_model="diagonal"))
            seen[name].append(model.diagnostics["process_noise_ratio"][1])
    calm, turbulent = np.array(seen["calm"]), np.array(seen["turbulent"])
    # 1 % of 40: more than 4 with a probability of 7e-5; 10 % of 40: more than 12 with one of 1e-4
    assert np.sum(calm < 0.01) <= 4
    assert np.sum(calm < 0.1) <= 12
    assert np.mean(turbulent < 0.01) > 0.9


def test_chi_bar_square_of_one_variance_is_half_a_chi_square():
    rng = np.random.default_rng(4)
    drawn = np.maximum(rng.standard_normal((200_000, 2)), 0.0) ** 2  # what Self and Liang find for orthogonal scores
    for x in (0.5, 2.0, 6.0):
        for n in (1, 2):
            share = np.mean(drawn[:, :n].sum(axis=1) > x)
            assert chi_bar_square(x, n) == pytest.approx(share, abs=5e-3)  # four standard errors of the share
    assert chi_bar_square(-0.1, 2) == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("sensor", ["inertial", "vane"])
def test_a_gust_in_both_equations_is_chosen_and_its_intervals_hold_the_truth(sensor):
    held, taken, values = [], [], []
    for seed in range(10):
        model = filter_error.estimate([gust_flight(seed, sensor)], gust_structure(), FilterError(held=()))
        taken.append(model.diagnostics["process_noise_model"])
        held.append([abs(model.values[n] - v) < 1.96 * model.standard_errors[n] for n, v in GUST_TRUE.items()])
        values.append([model.values[n] / v for n, v in GUST_TRUE.items()])
    if sensor == "inertial":
        assert taken.count("gust, inertial") >= 9
        assert np.allclose(np.mean(values, axis=0)[[0, 2]], 1.0, atol=0.08)  # diagonal: 0.86 and 0.85
    else:  # a vane's angle is shaken by itself, nearly: all of these say the same
        assert set(taken) <= {"gust, vane", "diagonal", "full"}
    # 50 intervals: of right ones fewer than 40 hold the truth in 1e-4 of the cases
    assert np.sum(held) >= 40


def test_gust_derivatives_agree_with_differences_and_a_linear_gust_with_a_general_one():
    s = with_gust(gust_structure(), "inertial", np.pi / 0.04)
    rng = np.random.default_rng(5)
    x, u, params = rng.standard_normal((3, 3)), rng.standard_normal((3, 1)), np.tile(s.values, (3, 1))
    np.testing.assert_allclose(_Gust.derivative(s, x, u, params), s.derivative(x, u, params), atol=1e-13)
    np.testing.assert_allclose(_Gust.output(s, x, u, params), s.output(x, u, params), atol=1e-13)
    one = _Gust.derivative(s, x[0], u[0], params[0])  # one state, and many of many
    np.testing.assert_allclose(one, s.derivative(x, u, params)[0], atol=1e-13)
    np.testing.assert_allclose(
        _Gust.derivative(s, x[None], u[None], params), s.derivative(x, u, params)[None], atol=1e-13
    )
    assert s.output(np.array([1.0, 0.0, 0.0]), np.zeros(1), s.values)[0] == 0.0  # inertial alpha does not feel it
    vane = with_gust(gust_structure(), "vane", np.pi / 0.04)
    assert vane.output(np.array([1.0, 0.0, 0.0]), np.zeros(1), s.values)[0] == 1.0


def test_a_gust_has_its_size_and_asks_for_a_flow_angle():
    record = gust_flight(3, "inertial")
    model = filter_error.estimate([record], gust_structure(), FilterError(process_noise_model="gust"))
    assert model.diagnostics["gust"]["rms"] == pytest.approx(0.02, rel=0.6)  # three correlation times: hardly more
    assert set(model.structure.states) == {"alpha", "q"}
    other = np.random.default_rng(1).standard_normal((50, 5))
    rates = FlightRecord(DT * np.arange(50), ("da", "dr", "beta", "p", "r"), other, "measured")
    with pytest.raises(EstimationError, match="flow angle"):
        filter_error.estimate([rates], roll_yaw_rates(("p", "r")), FilterError(process_noise_model="gust"))
    with pytest.raises(EstimationError, match="named states"):
        filter_error.estimate([record], gust_structure(), FilterError(process_noise_model="gust", process_noise=["q"]))


def test_shared_process_noise_is_found_with_its_correlation():
    together = np.array([[0.0, 0.02], [0.0, 0.08]])
    model = filter_error.estimate(
        [flight(60, 600, turbulence=together)], structure(), FilterError(process_noise_model="full")
    )
    assert model.diagnostics["process_noise_correlation"][0, 1] > 0.8
    for name in FREE:
        assert abs(model.values[name] - TRUE[name]) < 4.0 * model.standard_errors[name]  # 6e-5 false alarms each


def test_fixed_process_noise_is_kept_and_names_are_checked():
    record = flight(21, 300)
    model = filter_error.estimate([record], structure(), FilterError(fixed_process_noise={"alpha": 0.0}))
    assert set(model.diagnostics["process_noise"]) == {"q"}
    for wrong, word in (
        ({"process_noise": ["theta"]}, "theta"),
        ({"fixed_process_noise": {"q": -1.0}}, "q"),
        ({"process_noise": ["q"], "fixed_process_noise": {"q": 1.0}}, "both"),
        ({"output_biases": ["r"]}, "'r'"),
    ):
        with pytest.raises(EstimationError, match=word):
            filter_error.estimate([record], structure(), FilterError(**wrong))
    with pytest.raises(EstimationError, match="free"):
        filter_error.estimate([record], structure(free=()))


@pytest.mark.slow
def test_hfb_320_in_turbulence_gives_the_printed_coefficients():
    file = flight_data() / "hfb320" / "hfb320_1_10.asc"
    if not file.is_file():
        pytest.skip("hfb320/hfb320_1_10.asc is missing from the folder of flight records")
    table = np.loadtxt(file)
    columns = {"de": 1, "thrust": 3, "V": 4, "alpha": 5, "theta": 6, "q": 7, "qdot": 8, "ax": 9, "az": 10}
    record = FlightRecord(0.1 * np.arange(len(table)), tuple(columns), table[:, list(columns.values())], "measured")
    model = filter_error.estimate([record], aerodynamic_longitudinal(HFB))
    assert model.diagnostics["converged"]
    for name, printed in FILTER_ERROR_HFB.items():
        # Cm_V is zero within its standard error of 0.007: it is held to a third of that instead
        assert model.values[name] == pytest.approx(printed, rel=0.05, abs=0.0025 if name == "Cm_V" else 0.0), name
    # its attitude is smooth to far below the other channels: the filter says that it takes it as it comes
    assert any("almost exactly" in sentence for sentence in model.advice)


def test_attas_short_period_in_calm_air_agrees_with_output_error():
    from scipy.io import loadmat

    files = [flight_data() / "attas" / f"fAttasElv{i}.mat" for i in (1, 2)]
    for file in files:
        if not file.is_file():
            pytest.skip(f"attas/{file.name} is missing from the folder of flight records")
    tables = [loadmat(file)[file.stem] for file in files]
    records = [
        FlightRecord(DT * np.arange(len(t)), ("de", "alpha", "q"), np.deg2rad(t[:, [21, 12, 7]]), "measured")
        for t in tables
    ]
    both = [kind.estimate(records, short_period()) for kind in (filter_error, output_error)]
    assert both[0].diagnostics["converged"]
    for name in both[0].values:
        # it weighs the same data otherwise: both lie within two of the larger of their standard errors
        assert abs(both[0].values[name] - both[1].values[name]) < 2.5 * max(m.standard_errors[name] for m in both), name
    assert both[0].modes()[0].wn_rad_s == pytest.approx(2.53, rel=0.02)
    # noise is split between turbulence and measurement: innovations are smaller than free-run residuals
    assert np.all(both[0].diagnostics["residual_std"] < 0.5 * both[1].diagnostics["residual_std"])


def test_the_order_of_outputs_and_of_records_changes_nothing():
    records = [flight(40, 300), flight(41, 200)]
    one = filter_error.estimate(records, structure())
    other = filter_error.estimate(records[::-1], short_period(("q", "alpha")).with_parameters(TRUE, free=FREE))
    for name in FREE:
        # both ends lie within 1/1000 of a standard error of the minimum for variances settled to 0.3 %
        assert abs(one.values[name] - other.values[name]) < 0.02 * one.standard_errors[name]
        assert one.standard_errors[name] == pytest.approx(other.standard_errors[name], rel=0.02)
