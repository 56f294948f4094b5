"""Output error: exact data, several records, biases, delays, priors, bounds, starts, and what it refuses."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from parametric_cases import ATTAS_SHORT_PERIOD, CASES, flights, fly, inputs, truth
from scipy.optimize import least_squares
from scipy.signal import cont2discrete

from testbench.core.errors import ChannelError, EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators import estimate
from testbench.estimators.parametric import output_error
from testbench.estimators.parametric.likelihood import held_inputs
from testbench.estimators.parametric.structure import LinearStructure, Matrices, Parameter
from testbench.estimators.parametric.structures import Trim, flexible, longitudinal, short_period
from testbench.estimators.parametric.structures.written import Packaged
from testbench.estimators.settings import OutputError, OutputErrorEntry

SHORT = short_period()
DT = 0.04


def short_flight(samples: int = 400, seed: int = 0, noise: float = 0.0, x0=(0.01, -0.02)) -> FlightRecord:
    p = np.array([ATTAS_SHORT_PERIOD[name] for name in SHORT.parameter_names])
    return fly(SHORT, p, inputs(SHORT, samples, seed), DT, np.array(x0), noise * np.array([1.0, 2.0]), seed + 50)


def off(model, true: dict[str, float]) -> float:
    """Return the largest deviation from the true values, relative to each, or to 1/1000 of the largest near zero."""
    largest = max(abs(v) for v in true.values())
    return max(abs(model.values[n] - v) / max(abs(v), 1e-3 * largest) for n, v in true.items())


@pytest.mark.sampled(2)
@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("name", list(CASES))
def test_exact_data_are_recovered_from_two_records_of_different_length(name, held):
    case = CASES[name]
    lengths = (300, 200)
    hold = case.structure.inputs if held else ()
    records = flights(case, lengths, held=held)
    model = output_error.estimate(records, case.structure, OutputError(held=hold))
    true = dict(zip(case.structure.parameter_names, truth(case), strict=True))
    assert off(model, {n: v for n, v in true.items() if case.structure.free[list(true).index(n)]}) < 1e-8
    assert model.diagnostics["converged"]
    for found, expected in zip(model.diagnostics["initial_states"], case.starts, strict=True):
        assert found == pytest.approx(expected, rel=1e-8, abs=1e-9)
    for record in records:
        y = record.columns(case.structure.outputs)
        assert np.abs(model.simulate(record) - y).max(axis=0) == pytest.approx(0.0, abs=1e-8 * np.abs(y).max())


def test_constants_and_lines_of_outputs_are_recovered():
    # a gyro that reads wrong, each record differently
    shifted = []
    for seed, (bias, slope) in enumerate(((0.02, 0.001), (-0.01, 0.003))):
        r = short_flight(300 + 50 * seed, seed)
        t = r.t_s - r.t_s.mean()
        shifted.append(r.with_columns({"q": r["q"] + bias + slope * t}))
    with pytest.raises(EstimationError, match="Z_0"):  # a steady gyro error and steady forces are one and the same
        output_error.estimate(shifted, SHORT, OutputError(output_biases=("q",), output_trends=("q",)))
    fixed = SHORT.with_parameters({"Z_0": ATTAS_SHORT_PERIOD["Z_0"]}, fixed=("Z_0",))
    model = output_error.estimate(shifted, fixed, OutputError(output_biases=("q",), output_trends=("q",)))
    assert off(model, ATTAS_SHORT_PERIOD) < 1e-8
    assert np.array(model.diagnostics["offsets"]) == pytest.approx(np.array([[0.02, 0.001], [-0.01, 0.003]]), abs=1e-9)
    assert model.simulate(shifted[0]) == pytest.approx(shifted[0].columns(("alpha", "q")), abs=1e-9)


def test_constants_of_inputs_are_recovered():
    records = [short_flight(300, 1), short_flight(250, 2)]
    wrong = [r.with_columns({"de": r["de"] - b}) for r, b in zip(records, (0.01, -0.02), strict=True)]
    fixed = SHORT.with_parameters(
        {"Z_0": ATTAS_SHORT_PERIOD["Z_0"], "M_0": ATTAS_SHORT_PERIOD["M_0"]}, fixed=("Z_0", "M_0")
    )
    model = output_error.estimate(wrong, fixed, OutputError(input_biases=("de",)))
    assert off(model, ATTAS_SHORT_PERIOD) < 1e-8
    assert np.ravel(model.diagnostics["input_biases"]) == pytest.approx([0.01, -0.02], abs=1e-9)
    assert model.biased_inputs == ("de",)
    assert model.simulate(wrong[1]) == pytest.approx(wrong[1].columns(("alpha", "q")), abs=1e-9)


def test_samples_that_were_not_taken_change_nothing():
    r = short_flight()
    gone = np.random.default_rng(0).random((len(r), 3)) < 0.3
    gone[:, 0] = False
    data = r.data + 5.0 * gone
    model = output_error.estimate([replace(r, data=data, valid=~gone)], SHORT)
    assert off(model, ATTAS_SHORT_PERIOD) < 1e-8


def test_known_delays_are_undone():
    lag = 3
    command = inputs(SHORT, 400, 0)
    felt = np.concatenate([np.repeat(command[:1], lag, axis=0), command[:-lag]])
    p = np.array([ATTAS_SHORT_PERIOD[name] for name in SHORT.parameter_names])
    record = fly(SHORT, p, felt, DT, np.zeros(2)).with_columns({"de": command[:, 0]})
    assert off(output_error.estimate([record], SHORT), ATTAS_SHORT_PERIOD) > 0.02
    model = output_error.estimate([record], SHORT, OutputError(delays_s={"de": lag * DT}))
    assert model.delays_s == (lag * DT,)
    assert off(model, ATTAS_SHORT_PERIOD) < 1e-8
    assert model.simulate(record) == pytest.approx(record.columns(("alpha", "q")), abs=1e-9)


def test_shuffled_channels_and_scaled_signals_change_nothing():
    r = short_flight(noise=1e-3)
    model = output_error.estimate([r], SHORT)
    shuffled = output_error.estimate([r.select(("q", "de", "alpha"))], SHORT)
    assert shuffled.params.tolist() == model.params.tolist()
    tiny = FlightRecord(r.t_s, r.channels, 1e-6 * r.data, "measured")
    scaled = output_error.estimate([tiny], SHORT)
    constants = np.array([name.endswith("_0") for name in SHORT.parameter_names])
    factor = np.where(constants, 1e-6, 1.0)
    assert scaled.params == pytest.approx(factor * model.params, rel=1e-7)
    assert np.sqrt(np.diag(scaled.covariance)) == pytest.approx(factor * np.sqrt(np.diag(model.covariance)), rel=1e-5)


def test_the_same_data_give_the_same_bytes():
    records = flights(CASES["lateral_directional"], noise=0.02, seed=3)
    one, other = (
        output_error.estimate(records, CASES["lateral_directional"].structure, OutputError(starts=2)) for _ in range(2)
    )
    assert one.params.tobytes() == other.params.tobytes()
    assert one.covariance.tobytes() == other.covariance.tobytes()


def simulated(p: np.ndarray, u: np.ndarray, x0: np.ndarray) -> np.ndarray:
    """The short period written out: matrices, first-order hold from SciPy, and a loop."""
    Z_0, Z_a, Z_q, Z_de, M_0, M_a, M_q, M_de = p
    A, B = np.array([[Z_a, 1.0 + Z_q], [M_a, M_q]]), np.array([[Z_de, Z_0], [M_de, M_0]])
    Ad, Bd, Cd, Dd, _ = cont2discrete((A, B, np.eye(2), np.zeros((2, 2))), DT, method="foh")
    v = np.column_stack([u, np.ones(len(u))])
    # SciPy's state is x - (its direct term) v
    z, out = x0 - Dd @ v[0], np.empty((len(u), 2))
    for k in range(len(u)):
        out[k] = Cd @ z + Dd @ v[k]
        z = Ad @ z + Bd @ v[k]
    return out


def test_a_second_implementation_finds_the_same():
    records = [short_flight(300, 3, noise=2e-3), short_flight(200, 4, noise=2e-3)]
    model = output_error.estimate(records, SHORT)
    std = np.sqrt(np.diag(model.noise_covariance))

    def residuals(z: np.ndarray) -> np.ndarray:
        parts = []
        for i, r in enumerate(records):
            y = simulated(z[:8], r["de"], z[8 + 2 * i : 10 + 2 * i])
            parts.append(((r.columns(("alpha", "q")) - y) / std).ravel())
        return np.concatenate(parts)

    found = least_squares(residuals, np.concatenate([SHORT.values, np.zeros(4)]), x_scale="jac", xtol=1e-14, ftol=1e-15)
    assert model.params == pytest.approx(found.x[:8], rel=1e-6, abs=1e-8)
    information = np.linalg.inv(found.jac.T @ found.jac)[:8, :8]
    assert model.covariance_plain == pytest.approx(information, rel=1e-4, abs=1e-6 * np.abs(information).max())


@dataclass(frozen=True, eq=False, kw_only=True)
class Line(LinearStructure):
    """alpha = a + b de: a regression in the clothes of a structure."""

    def matrices(self, params):
        zero = np.zeros((*params.shape[:-1], 1, 1), params.dtype)
        return Matrices(zero - 1.0, zero, zero, params[..., 1][..., None, None], zero[..., 0], params[..., :1])


def test_priors_reduce_to_the_formula_of_bayes():
    rng = np.random.default_rng(5)
    u = 0.1 * rng.standard_normal(60)
    y = 0.3 + 2.0 * u + 0.05 * rng.standard_normal(60)
    r = FlightRecord(np.arange(60) * 0.1, ("de", "alpha"), np.column_stack([u, y]), "measured")
    believed, std = np.array([0.25, 2.3]), np.array([0.01, 0.1])
    line = Line(
        name="line",
        states=("q",),
        inputs=("de",),
        outputs=("alpha",),
        parameters=tuple(Parameter(n, v, prior_std=s) for n, v, s in zip(("a", "b"), believed, std, strict=True)),
    )
    model = output_error.estimate([r], line, OutputError(initial_states="zero"))
    X = np.column_stack([np.ones(60), u])
    R = model.noise_covariance[0, 0]
    inverse = np.diag(std**-2.0)
    used = R * 58.0 / 60.0  # the search weighs with the maximum likelihood variance, errors with the unbiased one
    mean = np.linalg.solve(X.T @ X / used + inverse, X.T @ y / used + inverse @ believed)
    assert model.params == pytest.approx(mean, rel=1e-6)
    assert model.covariance_plain == pytest.approx(np.linalg.inv(X.T @ X / R + inverse), rel=1e-8)
    v = y - X @ model.params
    assert used == pytest.approx(np.mean(v**2), rel=2e-3)


def test_bounds_hold_and_are_reported():
    r = short_flight(noise=1e-3)
    bounded = SHORT.with_parameters({"M_q": -3.0}, bounds={"M_q": (-5.0, -2.5), "M_alpha": (-100.0, 0.0)})
    model = output_error.estimate([r], bounded)
    assert model.values["M_q"] == -2.5
    assert model.diagnostics["at_bound"] == ["M_q"]
    assert model.standard_errors["M_q"] == 0.0
    assert model.status != "good"
    assert any("bound" in sentence and "M_q" in sentence for sentence in model.advice)


def test_fixed_parameters_keep_their_values():
    r = short_flight(noise=1e-3)
    model = output_error.estimate([r], SHORT.with_parameters({"Z_q": 0.1042}, fixed=("Z_q",)))
    assert model.values["Z_q"] == 0.1042
    assert model.standard_errors["Z_q"] == 0.0
    free = output_error.estimate([r], SHORT)
    assert model.standard_errors["Z_alpha"] < free.standard_errors["Z_alpha"]


def rate_alone() -> tuple[Packaged, FlightRecord]:
    """The pitch rate alone, so that equation error, which needs all states, cannot give a start."""
    known = {"Z_0": 0.0, "Z_q": 0.0, "Z_de": 0.0}
    s = short_period(("q",)).with_parameters(known, fixed=tuple(known))
    p = np.array([{**ATTAS_SHORT_PERIOD, **known}[n] for n in s.parameter_names])
    return s, fly(s, p, inputs(s, 400, 1), DT, np.zeros(2), noise=1e-3, seed=3)


def test_a_search_that_ends_nowhere_is_said():
    s, r = rate_alone()
    with pytest.raises(EstimationError, match="start from other values"):
        output_error.estimate([r], s.with_parameters({"M_alpha": 20.0}), OutputError(starts=1))


@pytest.mark.parametrize("M_alpha", [20.0, 5.0])
def test_a_false_minimum_is_left_for_a_better_one_and_said(M_alpha):
    s, r = rate_alone()
    model = output_error.estimate([r], s.with_parameters({"M_alpha": M_alpha}))
    assert model.values["M_alpha"] == pytest.approx(-4.9265, rel=0.05)
    first, *others = model.diagnostics["starts"]
    assert first > min(others) + 1000.0  # measured: 1330 and 4040
    assert [(a.severity, a.code) for a in model.advice] == [("note", "starts_disagree")]


def test_python_starts_from_equation_error_as_a_scenario_does():
    r = short_flight(400, noise=1e-3)
    far = SHORT.with_parameters({"M_alpha": 20.0})
    model = output_error.estimate([r], far, OutputError(starts=1))
    entry = OutputErrorEntry(structure="short_period", start={"M_alpha": 20.0})
    assert model.values["M_alpha"] == pytest.approx(-4.9265, rel=0.05)
    assert np.array_equal(estimate(entry, [r], ["de"], ["alpha", "q"]).params, output_error.estimate([r], far).params)


def test_several_starts_are_kept_and_the_best_wins():
    r = short_flight(400, noise=1e-3)
    bounded = SHORT.with_parameters({"M_alpha": 20.0}, bounds={"M_alpha": (-50.0, 20.0)})
    model = output_error.estimate([r], bounded, OutputError(starts=4))
    assert model.values["M_alpha"] == pytest.approx(-4.9265, rel=0.05)
    assert model.diagnostics["cost"] == min(model.diagnostics["starts"])


def test_a_fit_that_looks_good_takes_one_start():
    model = output_error.estimate([short_flight(400, noise=1e-3)], SHORT)
    assert len(model.diagnostics["starts"]) == 1
    assert model.status == "good"


def test_full_noise_covariance_uses_that_errors_go_together():
    p = np.array([ATTAS_SHORT_PERIOD[name] for name in SHORT.parameter_names])
    clean = fly(SHORT, p, inputs(SHORT, 600, 1), DT, np.zeros(2))
    rng = np.random.default_rng(2)
    v = rng.multivariate_normal([0.0, 0.0], [[1e-6, 1.8e-6], [1.8e-6, 4e-6]], 600)  # correlation 0.9
    noisy = FlightRecord(clean.t_s, clean.channels, clean.data + np.column_stack([np.zeros(600), v]), "measured")
    full = output_error.estimate([noisy], SHORT, OutputError(noise="full"))
    R = full.noise_covariance
    # correlation of 600 pairs: standard error (1 - 0.81) / sqrt(600) = 0.008
    assert R[0, 1] / np.sqrt(R[0, 0] * R[1, 1]) == pytest.approx(0.9, abs=0.04)
    deviation = (full.params - p) / np.sqrt(np.diag(full.covariance_plain))
    assert np.max(np.abs(deviation)) < 4.5  # false alarm 8 x 7e-6


def test_initial_states_from_the_record_or_from_trim():
    r = short_flight(x0=(0.01, -0.02))
    taken = output_error.estimate([r], SHORT, OutputError(initial_states="record"))
    assert off(taken, ATTAS_SHORT_PERIOD) < 1e-8
    trimmed = output_error.estimate([short_flight(x0=(0.0, 0.0))], SHORT, OutputError(initial_states="zero"))
    assert off(trimmed, ATTAS_SHORT_PERIOD) < 1e-8
    q_only = short_period(("q",))
    with pytest.raises(EstimationError, match="lacks 'alpha'"):
        output_error.estimate([r.select(("de", "q"))], q_only, OutputError(initial_states="record"))


def test_model_tells_modes_poles_and_response():
    model = output_error.estimate([short_flight(noise=1e-3)], SHORT)
    (mode,) = model.modes()
    A = np.array([[-0.4834, 1.1042], [-4.9265, -2.0057]])
    pole = np.linalg.eigvals(A)[0]
    assert abs(mode.wn_rad_s - abs(pole)) < 4.0 * mode.wn_std
    assert abs(mode.zeta + pole.real / abs(pole)) < 4.0 * mode.zeta_std
    assert sorted(model.poles()["alpha, q"].imag) == pytest.approx([-mode.pole.imag, mode.pole.imag])
    w = np.array([0.5, 3.0])
    response = model.frequency_response(w)
    s = model.linear()
    for k in range(2):
        assert response[k] == pytest.approx(s.C @ np.linalg.solve(1j * w[k] * np.eye(2) - s.A, s.B) + s.D)
    described = model.to_dict()
    assert described["parameters"]["M_q"]["value"] == model.values["M_q"]
    assert described["structure"] == "short_period"
    assert np.asarray(model.to_control().B) == pytest.approx(s.B)


def test_inputs_that_are_not_told_apart_are_named():
    two = longitudinal(Trim(15.0), controls=("de", "dr"))
    u = inputs(two, 300, 1)
    u[:, 1] = 2.0 * u[:, 0]
    r = fly(two, two.values, u, 0.025, np.zeros(4), noise=1e-3)
    with pytest.raises(EstimationError, match=r"(?=.*M_de)(?=.*M_dr).*not identifiable"):
        output_error.estimate([r], two)


def test_what_cannot_be_estimated_is_refused():
    r = short_flight()
    with pytest.raises(EstimationError, match="truth"):
        output_error.estimate([replace(r, kind="truth")], SHORT)
    with pytest.raises(EstimationError, match="never moves"):
        output_error.estimate([r.with_columns({"de": np.zeros(len(r))})], SHORT)
    with pytest.raises(EstimationError, match="output 'alpha' never moves"):
        output_error.estimate([r.with_columns({"alpha": np.zeros(len(r))})], SHORT)
    with pytest.raises(ChannelError, match="alpha"):
        output_error.estimate([r.select(("q", "de"))], SHORT)
    with pytest.raises(EstimationError, match="no free parameter"):
        output_error.estimate([r], SHORT.with_parameters(free=()))
    few = np.ones((len(r), 3), bool)
    few[4:, 1:] = False
    with pytest.raises(EstimationError, match="valid samples"):
        output_error.estimate([replace(r, valid=few)], SHORT)
    with pytest.raises(EstimationError, match="at least one record"):
        output_error.estimate([], SHORT)
    with pytest.raises(EstimationError, match="got 'theta'"):
        output_error.estimate([r], SHORT, OutputError(output_biases=("theta",)))
    with pytest.raises(EstimationError, match="got 'dr'"):
        output_error.estimate([r], SHORT, OutputError(input_biases=("dr",)))
    with pytest.raises(EstimationError, match="got 'dr'"):
        output_error.estimate([r], SHORT, OutputError(delays_s={"dr": 0.1}))
    with pytest.raises(EstimationError, match="got 'dr'"):
        output_error.estimate([r], SHORT, OutputError(held=("dr",)))
    with pytest.raises(EstimationError, match="starts: must be greater than or equal to 1, got 0"):
        output_error.estimate([r], SHORT, OutputError(starts=0))
    with pytest.raises(EstimationError, match="M_alfa"):
        output_error.estimate([r], SHORT.with_parameters({"M_alfa": 1.0}))
    gone = np.ones((len(r), 3), bool)
    gone[5, 2] = False
    with pytest.raises(EstimationError, match="full noise covariance"):
        output_error.estimate([replace(r, valid=gone)], SHORT, OutputError(noise="full"))


def test_a_start_that_diverges_is_said():
    s, r = rate_alone()
    with pytest.raises(EstimationError, match="diverges"):
        output_error.estimate([r], s.with_parameters({"M_q": 1e4}), OutputError(starts=1))


def test_commands_are_held_and_deflections_are_not():
    assert held_inputs(("de_cmd", "thr"), None)[0].tolist() == [True, False]
    assert held_inputs(("de", "thr"), ("thr",))[0].tolist() == [False, True]


def test_an_unstable_aircraft_is_estimated():
    """Negative static stability, e.g. a fighter that a pilot or an autopilot keeps in the air for some seconds."""
    s = short_period().with_parameters({"M_alpha": 1.0})
    true = {**ATTAS_SHORT_PERIOD, "M_alpha": 3.0, "M_0": 0.01}
    p = np.array([true[name] for name in s.parameter_names])
    r = fly(s, p, inputs(s, 150, 3), DT, np.zeros(2), noise=1e-3, seed=1)
    model = output_error.estimate([r], s)
    assert max(model.poles()["alpha, q"].real) > 0.5
    deviation = [(model.values[n] - v) / model.standard_errors[n] for n, v in true.items()]
    assert np.max(np.abs(deviation)) < 4.5  # false alarm 8 x 7e-6


def test_doubts_are_said_in_words():
    quiet = output_error.estimate([short_flight(noise=1e-4)], SHORT)
    assert all("do not separate these estimates" not in s for s in quiet.advice)
    r = short_flight(noise=1e-3)
    drift = np.convolve(np.random.default_rng(3).standard_normal(len(r) + 19), np.ones(20) / 20.0, "valid")
    coloured = output_error.estimate([r.with_columns({"alpha": r["alpha"] + 5e-3 * drift})], SHORT)
    assert coloured.status != "good"
    assert any("alpha are not white" in s for s in coloured.advice)
    assert np.max(coloured.diagnostics["error_inflation"]) > 1.5


def test_flexible_structure_with_measured_mode_frees_its_shape():
    s = flexible(Trim(16.0), wn_rad_s=(28.9,), outputs=("q", "az", "eta_1"))
    free = dict(zip(s.parameter_names, s.free, strict=True))
    assert free["phi_1"]
    assert free["slope_1"]
    unmeasured = flexible(Trim(16.0), wn_rad_s=(28.9,), outputs=("q", "az"))
    free = dict(zip(unmeasured.parameter_names, unmeasured.free, strict=True))
    assert not free["phi_1"]
    assert free["slope_1"]


def test_errors_that_colour_widens_much_are_said_not_to_be_believed():
    r = short_flight(800, noise=1e-3)
    bent = r["alpha"] + 0.3 * np.abs(r["alpha"]) + 0.1 * np.sin(0.7 * r.t_s)  # what the structure does not have
    model = output_error.estimate([r.with_columns({"alpha": bent})], SHORT)
    assert np.max(model.diagnostics["error_inflation"]) > 5.0
    said = [a for a in model.advice if a.code == "coloured_residuals"]
    assert len(said) == 1
    assert "not reliable" in said[0]
    assert "corrected" not in said[0]
