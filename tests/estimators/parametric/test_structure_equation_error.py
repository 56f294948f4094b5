"""Equation error for structures: near exact on fine data, the regression of the same signals, gaps, refusals."""

import numpy as np
import pytest
from parametric_cases import CASES, fly, truth
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators import estimate
from testbench.estimators.parametric import equation_error, output_error
from testbench.estimators.parametric.structures import longitudinal, short_period
from testbench.estimators.regression import Recipe, RegressionData, linear_model
from testbench.estimators.regression.equation_error import equation_error as regress
from testbench.estimators.regression.smoothing import SineSeries
from tests.studies.advice_cases import doublets

DT = 0.02
VALUES = {"Z_alpha": -1.6, "Z_q": -0.03, "Z_de": -0.2, "M_alpha": -9.0, "M_q": -2.4, "M_de": -11.0}
SHORT = short_period().with_parameters({**VALUES, "Z_0": 0.01, "M_0": -0.02})


def smooth_input(n, seed):
    t = np.arange(n) * DT
    rng = np.random.default_rng(seed)
    lines = 2.0 * np.pi * np.array([0.2, 0.45, 0.8, 1.3, 1.9])
    return 0.02 * np.sum(np.sin(np.outer(t, lines) + rng.uniform(0.0, 6.3, lines.size)), axis=1)[:, None]


def steps(n, seed, width=25):
    rng = np.random.default_rng(seed)
    return 0.03 * np.repeat(rng.choice([-1.0, 0.0, 1.0], n // width + 1), width)[:n, None]


def records(u, noise=0.0, held=False, structure=SHORT):
    x0 = np.zeros(len(structure.states))
    return [fly(structure, structure.values, part, DT, x0, noise, 7 + i, held) for i, part in enumerate(u)]


def worst(model, structure=SHORT):
    true = structure.values
    return float(np.max(np.abs(model.params - true) / np.maximum(np.abs(true), 0.3)))


def test_smooth_noise_free_data_give_the_parameters():
    # 0.27 % is left by the ends, where cubics stand in for the derivative's continuation
    model = equation_error.estimate(records([smooth_input(900, 1), smooth_input(700, 2)]), short_period())
    assert worst(model) < 4e-3
    assert not any("biases" in sentence for sentence in model.advice)  # there is no noise to speak of


def test_smooth_data_that_begin_and_end_at_rest_are_recovered_exactly():
    """Sampled they are band-limited to 1e-9, and their derivatives, that of their sine series, are exact."""

    def pulses(t):
        return 0.05 * np.exp(-(((t - 6.0) / 1.2) ** 2)) * np.sin(1.2 * np.pi * (t - 6.0)) + 0.03 * np.exp(
            -(((t - 8.0) / 1.5) ** 2)
        )

    plain = short_period().with_parameters(VALUES)
    m, t = plain.matrices(plain.values), np.arange(501) * 0.05
    solved = solve_ivp(
        lambda s, x: m.A @ x + m.B[:, 0] * pulses(s), (0.0, t[-1]), [0.0, 0.0], "DOP853", t, rtol=1e-13, atol=1e-16
    )
    y = solved.y.T @ m.C.T + np.outer(pulses(t), m.D[:, 0])
    record = FlightRecord(t, ("de", *plain.outputs), np.column_stack([pulses(t), y]), "measured")
    model = equation_error.estimate([record], short_period())
    assert {n: model.values[n] for n in VALUES} == pytest.approx(VALUES, rel=1e-7)


@pytest.mark.parametrize("width", [25, 50])
def test_held_steps_are_met_half_way(width):
    # A step of a held input leaves a corner in the state, which no smooth derivative follows: 2 % are left. Taken as
    # running linearly, the input comes half a sample early: 7 to 10 %.
    data = records([steps(1500, 3, width), steps(1200, 4, width)], held=True)
    met = worst(equation_error.estimate(data, short_period(), held=("de",)))
    assert met < 0.03
    assert worst(equation_error.estimate(data, short_period(), held=())) > 3.0 * met


def test_nonlinear_structures_take_their_steps():
    case = CASES["aerodynamic_longitudinal"]
    n = 400
    t = np.arange(n) * 0.05
    u = np.column_stack([0.02 * np.sin(1.1 * t) + 0.02 * np.sin(2.9 * t + 1.0), 11500.0 + 200.0 * np.sin(0.3 * t)])
    assert case.structure.inputs == ("de", "thrust")
    flown = [fly(case.structure, truth(case), u, 0.05, x0) for x0 in case.starts]
    model = equation_error.estimate(flown, case.structure)
    found = {name: model.values[name] for name in ("CL_alpha", "Cm_alpha", "Cm_q", "Cm_de")}
    assert all(found[name] == pytest.approx(case.truth[name], rel=0.03) for name in found)


def test_it_is_the_regression_of_the_same_signals():
    cutoff, (r,) = 4.0, records([smooth_input(900, 5)], noise=np.array([2e-3, 4e-3]))
    model = equation_error.estimate([r], short_period(), cutoff_hz=cutoff)
    series = {name: SineSeries.of(r[name], DT).smoothed(cutoff) for name in ("alpha", "q", "de")}
    names = (*series, "qdot", "alphadot")
    columns = [*(s.values for s in series.values()), series["q"].derivative, series["alpha"].derivative]
    everywhere = np.ones((len(r), len(names)), bool)
    data = RegressionData(r.t_s, names, np.stack(columns, axis=1), everywhere, {}, Recipe())
    fit = regress(data, "qdot", ("alpha", "q", "de"))
    assert dict(zip(fit.terms, fit.params, strict=True)) == pytest.approx(
        {
            "alpha": model.values["M_alpha"],
            "q": model.values["M_q"],
            "de": model.values["M_de"],
            "1": model.values["M_0"],
        },
        rel=1e-8,
    )
    linear = linear_model([data], states=("alpha", "q"), inputs=("de",))
    ours = model.linear()
    assert np.allclose(linear.A, ours.A, rtol=1e-7)
    assert np.allclose(linear.B, ours.B, rtol=1e-7)
    # plain standard errors: the same formula, degrees of freedom aside (4 and 8 of 900)
    plain = np.sqrt(np.diag(model.covariance_plain))[-3:]
    assert plain == pytest.approx(fit.std_plain[:3], rel=0.01)


def test_noise_biases_it_and_output_error_started_from_it_is_free_of_that():
    noise = np.array([0.02, 0.03])
    data = records([smooth_input(900, 8), smooth_input(900, 9)], noise=noise)
    first = equation_error.estimate(data, short_period())
    refined = output_error.estimate(data, short_period().with_parameters(first.values))
    z = np.abs(refined.params - SHORT.values) / np.sqrt(np.diag(refined.covariance))
    assert z.max() < 4.0  # eight parameters: false alarm 5e-4
    assert any("noise" in sentence for sentence in first.advice)
    assert worst(first) > worst(refined)


def test_samples_that_were_not_taken_are_bridged_and_do_not_count():
    (r,) = records([smooth_input(900, 1)])
    valid, data = np.ones(r.data.shape, bool), r.data.copy()
    valid[300:308, 2], data[300:308, 2] = False, data[299, 2]
    spoilt = FlightRecord(r.t_s, r.channels, data, "measured", valid=valid)
    held = FlightRecord(r.t_s, r.channels, data, "measured")
    assert worst(equation_error.estimate([spoilt], short_period())) < 0.01  # 0.7 %
    assert worst(equation_error.estimate([held], short_period())) > 0.02  # 3.1 %


def test_bounds_are_kept_and_said_and_priors_count():
    data = records([smooth_input(900, 1)])
    bounded = equation_error.estimate(data, short_period().with_parameters(bounds={"M_q": (-2.2, 0.0)}))
    assert bounded.values["M_q"] == -2.2
    assert any("M_q ended on a bound" in sentence for sentence in bounded.advice)
    sure = short_period().with_parameters({"M_q": -2.0}, prior_std={"M_q": 1e-9})
    assert equation_error.estimate(data, sure).values["M_q"] == pytest.approx(-2.0, abs=1e-3)


def test_what_it_cannot_do_is_refused():
    data = records([smooth_input(900, 1)])
    with pytest.raises(EstimationError, match=r"needs every state .* lacks 'V'; sense it, or use output error"):
        equation_error.estimate(data, longitudinal(15.0, outputs=("alpha", "q")))
    with pytest.raises(EstimationError, match="no free parameter"):
        equation_error.estimate(data, short_period().with_parameters(free=()))
    with pytest.raises(EstimationError, match="more than twice as many samples as its 8 parameters, got 16"):
        equation_error.estimate([data[0].between(0.0, 0.32)], short_period())
    still = data[0].with_columns({"alpha": np.zeros(900), "q": np.zeros(900)})
    with pytest.raises(EstimationError, match="not identifiable"):
        equation_error.estimate([still], short_period())


def test_bias_by_noise_is_said_with_its_size():
    """Hardly smoothed, noise of the states draws derivatives towards zero as errors in variables say."""
    off, said, sentences = [], [], []
    for seed in range(12):
        clean = records([smooth_input(900, 1)])[0]
        noise = np.random.default_rng(seed).standard_normal((900, 2)) * 0.3 * clean.columns(("alpha", "q")).std(axis=0)
        noisy = clean.with_columns({"alpha": clean["alpha"] + noise[:, 0], "q": clean["q"] + noise[:, 1]})
        model = equation_error.estimate([noisy], short_period(), cutoff_hz=12.0)
        off.append(model.params - SHORT.values)
        said.append(model.diagnostics["noise_bias"])
        sentences.extend(a for a in model.advice if a.code == "noisy_terms")
    error = np.std(off, axis=0) / np.sqrt(12)
    bias, expected = np.mean(off, axis=0), np.mean(said, axis=0)
    for name in ("M_alpha", "M_q", "M_de"):
        i = SHORT.parameter_names.index(name)
        # four standard errors of the mean, and a third for what is beyond first order in the noise
        assert abs(expected[i] - bias[i]) < 4.0 * error[i] + 0.33 * abs(bias[i]), name
    at = SHORT.parameter_names.index("M_alpha")
    assert expected[at] > 0.02 * abs(SHORT.values[at])
    assert len(sentences) == 12
    assert {a.severity for a in sentences} <= {"doubt", "note"}
    assert all("of its errors" in a for a in sentences)


def test_held_inputs_do_not_bias_control_derivatives():
    # Without noise: the mean of the values before and after a sample had M_de 2 % and M_q 3 % too large here.
    A, B, dt, N = np.array([[-1.8, 1.0], [-14.0, -2.6]]), np.array([-0.12, -18.0]), 0.02, 900
    block = expm(np.block([[A, B[:, None]], [np.zeros((1, 3))]]) * dt)
    de = doublets(N)
    x = np.zeros((N, 2))
    for k in range(N - 1):
        x[k + 1] = block[:2, :2] @ x[k] + block[:2, 2] * de[k]
    record = FlightRecord(np.arange(N) * dt, ("de", "alpha", "q"), np.column_stack([de, x]), "measured")
    found = estimate("equation_error", [record], ["de"], ["alpha", "q"], structure="short_period", held=["de"])
    assert found.values["M_de"] == pytest.approx(-18.0, rel=0.005)
    assert found.values["M_q"] == pytest.approx(-2.6, rel=0.01)
