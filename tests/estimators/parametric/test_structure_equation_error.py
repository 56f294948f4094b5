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
from testbench.estimators.parametric.structures import Trim, longitudinal, short_period
from testbench.estimators.regression.smoothing import SineSeries
from testbench.estimators.settings import EquationError
from testbench.questions.compare.benchmark.flights import doublets

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
    # A step of a held input leaves a corner in the state, which no smooth derivative follows: 2 % before the correction
    # for it, 0.05 % after. Taken as running linearly, the input comes half a sample early: 7 to 10 %.
    data = records([steps(1500, 3, width), steps(1200, 4, width)], held=True)
    met = worst(equation_error.estimate(data, short_period(), EquationError(held=("de",))))
    assert met < 1e-3
    assert worst(equation_error.estimate(data, short_period(), EquationError(held=()))) > 0.05


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
    model = equation_error.estimate([r], short_period(), EquationError(cutoff_hz=cutoff))
    series = {name: SineSeries.of(r[name], DT).smoothed(cutoff) for name in ("alpha", "q", "de")}
    X = np.column_stack([*(s.values for s in series.values()), np.ones(len(r))])
    goals = np.column_stack([series["alpha"].derivative, series["q"].derivative])
    fit, (_, energy), *_ = np.linalg.lstsq(X, goals, rcond=None)
    terms = ("alpha", "q", "de", "1")
    # the regression knows nothing of the noise in its terms
    bias = dict(zip(model.values, model.diagnostics["noise_bias"], strict=True))
    assert np.all(
        model.diagnostics["smoothing_bias"] == 0.0
    )  # one cut-off for all: nothing is lost from one state alone
    biased = {name: value + bias[name] for name, value in model.values.items()}
    assert dict(zip(terms, fit[:, 1], strict=True)) == pytest.approx(
        {"alpha": biased["M_alpha"], "q": biased["M_q"], "de": biased["M_de"], "1": biased["M_0"]}, rel=1e-8
    )
    ours = SHORT.matrices(np.array(list(biased.values())))
    assert np.allclose(fit[:2].T, ours.A, rtol=1e-7)
    assert np.allclose(fit[2:3].T, ours.B, rtol=1e-7)
    # plain standard errors: the same formula, degrees of freedom aside (4 and 8 of 900)
    plain = np.sqrt(np.diag(model.covariance_plain))[-3:]
    assert plain == pytest.approx(np.sqrt(energy / (len(r) - 4) * np.diag(np.linalg.inv(X.T @ X)))[:3], rel=0.01)


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
        equation_error.estimate(data, longitudinal(Trim(15.0), outputs=("alpha", "q")))
    with pytest.raises(EstimationError, match="no free parameter"):
        equation_error.estimate(data, short_period().with_parameters(free=()))
    with pytest.raises(EstimationError, match="more than twice as many samples as its 8 parameters, got 16"):
        equation_error.estimate([data[0].between(0.0, 0.32)], short_period())
    still = data[0].with_columns({"alpha": np.zeros(900), "q": np.zeros(900)})
    with pytest.raises(EstimationError, match="not identifiable"):
        equation_error.estimate([still], short_period())


def noisy(clean, share, seed):
    """The record with noise on alpha and q of these shares of their deviations."""
    size = np.array(share) * clean.columns(("alpha", "q")).std(axis=0)
    e = size * np.random.default_rng(seed).standard_normal((len(clean), 2))
    return clean.with_columns({"alpha": clean["alpha"] + e[:, 0], "q": clean["q"] + e[:, 1]})


def test_bias_by_noise_is_taken_out_and_said_with_its_size():
    """Hardly smoothed, noise of the states draws derivatives towards zero as errors in variables say."""
    off, said, sentences = [], [], []
    clean = records([smooth_input(900, 1)])[0]
    for seed in range(12):
        model = equation_error.estimate([noisy(clean, (0.3, 0.3), seed)], short_period(), EquationError(cutoff_hz=12.0))
        off.append(model.params - SHORT.values)
        said.append(model.diagnostics["noise_bias"])
        sentences.extend(a for a in model.advice if a.code == "noisy_terms")
    error = np.std(off, axis=0, ddof=1) / np.sqrt(12)
    for name in ("M_alpha", "M_q", "M_de"):
        i = SHORT.parameter_names.index(name)
        assert abs(np.mean(said, axis=0)[i]) > 0.015 * abs(SHORT.values[i]), name
        # mean of twelve: false alarm below 1e-3 for three
        assert abs(np.mean(off, axis=0)[i]) < 4.5 * error[i], name
    assert len(sentences) == 12
    assert {a.severity for a in sentences} <= {"doubt", "note"}
    assert all("of its errors" in a for a in sentences)


def test_what_is_cut_off_from_one_state_alone_does_not_bias_the_others():
    """A noisy alpha loses its steps' corners, and M_q and M_de with them: 4 and 2 % before the correction."""
    clean = records([steps(900, 3), steps(700, 4)], held=True)
    off, smoothing, held = [], [], []
    for seed in range(12):
        model = equation_error.estimate([noisy(r, (0.3, 0.03), seed + i) for i, r in enumerate(clean)], short_period())
        error = np.sqrt(np.diag(model.covariance))
        off.append(model.params - SHORT.values)
        smoothing.append(model.diagnostics["smoothing_bias"])
        held.append(np.abs(off[-1]) < 1.96 * error)
    q, de = (SHORT.parameter_names.index(name) for name in ("M_q", "M_de"))
    taken = np.abs(np.mean(smoothing, axis=0))
    assert taken[q] > 0.03 * abs(SHORT.values[q])
    assert taken[de] > 0.02 * abs(SHORT.values[de])
    assert np.all(np.abs(np.mean(off, axis=0))[[q, de]] < 0.6 * taken[[q, de]])
    # 96 intervals of 95 %, eight of a flight: fewer than 85 % by chance in less than one of 1000, were they independent
    assert np.mean(held) > 0.85


def test_the_busiest_stretch_of_a_long_record_tells_the_bias(monkeypatch):
    u = np.concatenate([steps(1500, 3), np.zeros((1500, 1))])  # what moves is in the first half
    data = records([u], held=True)
    structure = short_period().with_parameters({"M_q": -2.0}, prior_std={"M_q": 0.5})
    whole = equation_error.estimate(data, structure, EquationError(held=("de",)))
    monkeypatch.setattr(equation_error, "_LONGEST", 1600)
    part = equation_error.estimate(data, structure, EquationError(held=("de",)))
    error = np.sqrt(np.diag(whole.covariance))
    bias, there = (m.diagnostics["smoothing_bias"] for m in (whole, part))
    derivatives = [
        i for i, n in enumerate(whole.values) if n not in structure.trim_constants
    ]  # quiet flight tells those
    assert np.max((np.abs(bias) / error)[derivatives]) > 10.0
    assert np.max((np.abs(there - bias) / error)[derivatives]) < 0.2
    assert not np.array_equal(there, bias)
    monkeypatch.setattr(equation_error, "_MOST", 3000)  # one record of four, like all others
    several = equation_error.estimate(
        data * 4, structure.with_parameters(prior_std={"M_q": 0.25}), EquationError(held=("de",))
    )
    assert several.diagnostics["smoothing_bias"] == pytest.approx(there, rel=1e-3, abs=1e-6)


def test_an_unstable_aircraft_is_corrected_where_its_response_is_told():
    unstable = short_period().with_parameters({**VALUES, "M_alpha": 20.0})
    assert np.max(np.linalg.eigvals(unstable.matrices(unstable.values).A).real) > 2.0
    (r,) = records([steps(150, 3)], held=True, structure=unstable)
    model = equation_error.estimate([r], short_period(), EquationError(held=("de",)))
    i = unstable.parameter_names.index("M_alpha")
    assert abs(model.diagnostics["smoothing_bias"][i]) > 1.5
    assert model.values["M_alpha"] == pytest.approx(20.0, abs=0.5)
    assert model.values["M_q"] == pytest.approx(VALUES["M_q"], abs=0.15)


def test_where_noise_decides_it_is_said_and_the_estimate_is_kept():
    unstable = short_period().with_parameters({**VALUES, "M_alpha": 20.0})
    (r,) = records([steps(300, 3)], held=True, structure=unstable)  # grown so far that one direction is all there is
    model = equation_error.estimate([r], short_period(), EquationError(held=("de",)))
    assert np.all(np.abs(model.diagnostics["noise_bias"]) <= 1e-4 * np.maximum(np.abs(model.params), 1.0))
    assert [a.severity for a in model.advice if "half or more of the information on" in a] == ["doubt"]


def test_a_response_that_diverges_is_said():
    """Noise of a derivative that only grows: the response of what is found leaves the record far behind."""
    rng = np.random.default_rng(2)
    t = np.arange(400) * DT
    x = np.column_stack([np.sin(t) * 1e-3 + rng.standard_normal(400) * 1e-3, np.exp(3.0 * t[::-1])])
    record = FlightRecord(t, ("de", "alpha", "q"), np.column_stack([steps(400, 5)[:, 0], x]), "measured")
    model = equation_error.estimate(
        [record], short_period().with_parameters({"M_q": 40.0}, fixed=["M_q"]), EquationError(held=("de",))
    )
    assert np.all(model.diagnostics["smoothing_bias"] == 0.0)
    assert any("attenuation by smoothing is not corrected" in a for a in model.advice)


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
