"""Structures from equations as text: exact derivatives, exact recovery, the packaged ones again, and refusals."""

import pickle
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from parametric_cases import ATTAS_SHORT_PERIOD
from scipy.integrate import solve_ivp

import testbench as tb
from testbench.core.contract import Law
from testbench.core.errors import EstimationError
from testbench.core.paths import SCENARIOS
from testbench.core.record import FlightRecord
from testbench.estimators.contract import tried
from testbench.estimators.equations import read_equations
from testbench.estimators.parametric import equation_error, filter_error, output_error
from testbench.estimators.parametric.kalman import ekf, ukf
from testbench.estimators.parametric.response import Sampling, respond
from testbench.estimators.parametric.structure import LinearStructure
from testbench.estimators.parametric.structures import Trim, short_period
from testbench.estimators.parametric.structures.written import structure_from_equations, written
from testbench.estimators.settings import EquationError, FilterError, OutputError
from testbench.evaluation.derivatives import Derivative, true_parameters

DT, N = 0.02, 500


class Example(NamedTuple):
    """A packaged example, true values that are not its start values, where it starts, and its feedback (m, n)."""

    truth: dict[str, float]
    x0: dict[str, float]
    level: dict[str, float]
    outputs: tuple[str, ...]
    feedback: dict[str, float] = {}


EXAMPLES = {
    "bent_short_period": Example(
        {"Z_alpha": -1.8, "Z_de": -0.3, "M_alpha": -14.0, "M_alpha2": 40.0, "M_q": -2.6, "M_de": -18.0,
         "M_de_alpha": 60.0},
        {},
        {},
        ("alpha", "q", "az"),
    ),
    "body_axes": Example(
        {"CL_0": 0.25, "CL_alpha": 4.9, "CD_0": 0.035, "CD_k": 0.06, "Cm_0": 0.04, "Cm_alpha": -0.7, "Cm_q": -12.0,
         "Cm_de": -1.1},
        {"u": 25.0, "w": 1.4, "theta": 0.05},
        {},
        ("V", "alpha", "q", "theta", "ax", "az"),
    ),
    "rates_alone": Example(
        {"L_beta": -10.0, "L_p": -7.0, "L_r": 1.3, "L_da": 25.0, "L_dr": 1.5, "N_beta": 7.0, "N_p": -0.4, "N_r": -1.0,
         "N_da": -0.8, "N_dr": -5.0},
        {},
        {},
        ("p", "r"),
    ),
    "engine": Example(
        {"speed_0": 60.0, "speed_1": 380.0, "speed_2": 50.0, "tau": 0.35, "k_T": 2.4e-5},
        {"motor_speed": 250.0},
        {"thr": 0.5},
        ("motor_speed", "thrust"),
    ),
    "unstable": Example(
        {"Z_alpha": -1.2, "Z_de": -0.15, "M_alpha": 4.0, "M_alpha3": -30.0, "M_q": -1.3, "M_de": -9.0},
        {},
        {},
        ("alpha", "q"),
        {"alpha": 1.2, "q": 0.5},
    ),
}  # fmt: skip


def made(name):
    """Return the structure of a packaged example, for the outputs that its record has."""
    return written(read_equations(SCENARIOS / "structures" / f"{name}.toml"), name, EXAMPLES[name].outputs)


def flown(name, std=0.0, gust=0.0, n=N):
    """Return a record of an example with its true values, integrated far finer than it is sampled."""
    example, s = EXAMPLES[name], made(name)
    rng = np.random.default_rng(4)
    truth = s.with_parameters(example.truth).values
    t = DT * np.arange(n)
    level = np.array([example.level.get(i, 0.0) for i in s.inputs])
    waves = np.stack([np.sin(2.2 * t + j) + np.sin((5.1 + j) * t) + np.sin(0.7 * t) for j in range(len(s.inputs))], 1)
    u = level + 0.06 * waves * (4.0 if name == "engine" else 1.0)
    x = np.array([example.x0.get(state, 0.0) for state in s.states])
    K = np.array([example.feedback.get(state, 0.0) for state in s.states])
    X, moved = np.empty((n, x.size)), u.copy()
    for k in range(n):
        X[k] = x
        # the autopilot holds its part of the elevator from sample to sample; the rest runs linearly
        ahead = u[min(k + 1, n - 1)] + K @ x
        moved[k] = u[k] + K @ x
        w = gust * rng.standard_normal(x.size) if gust else np.zeros(x.size)

        end = moved[k] if K.any() else ahead

        def rate(time, y, start=moved[k], end=end, wind=w):
            return s.derivative(y, start + (end - start) * time / DT, truth) + wind

        x = solve_ivp(rate, (0.0, DT), x, rtol=1e-10, atol=1e-12).y[:, -1]
    y = s.output(X, moved, truth)
    y = y + std * rng.standard_normal(y.shape)
    return FlightRecord(t, (*s.inputs, *s.outputs), np.hstack([moved, y]), "measured")


@pytest.fixture(scope="module")
def records():
    return {name: flown(name) for name in EXAMPLES}


@pytest.mark.parametrize("name", EXAMPLES)
def test_exact_data_give_the_parameters_of_every_example_back(records, name):
    n = 150 if name == "unstable" else N  # a simulation from its first sample shows e-fold errors each 0.6 s
    record = records[name].between(0.0, n * DT)
    held = ("de",) if EXAMPLES[name].feedback else ()
    model = output_error.estimate([record], made(name), OutputError(held=held, substeps=2))
    for parameter, value in EXAMPLES[name].truth.items():
        assert model.values[parameter] == pytest.approx(value, rel=2e-5, abs=1e-6), parameter


@pytest.mark.parametrize("name", EXAMPLES)
def test_derivatives_are_those_of_differences(name):
    rng = np.random.default_rng(1)
    s = made(name)
    example = EXAMPLES[name]
    for _ in range(5):
        x = np.array([example.x0.get(n, 0.0) for n in s.states]) + 0.1 * rng.standard_normal(len(s.states))
        u = 0.3 + 0.1 * rng.standard_normal(len(s.inputs))
        params = s.with_parameters(example.truth).values
        j = s.jacobians(x, u, params)
        for f, by in ((s.derivative, j[:3]), (s.output, j[3:])):
            for i, exact in enumerate(by):
                at = [x, u, params]
                for column in range(exact.shape[1]):
                    h = 1e-6 * max(abs(at[i][column]), 1e-3)
                    low, high = (
                        [*at[:i], at[i] + sign * h * np.eye(at[i].size)[column], *at[i + 1 :]] for sign in (-1, 1)
                    )
                    near = (f(*high) - f(*low)) / (2.0 * h)
                    np.testing.assert_allclose(exact[:, column], near, rtol=1e-5, atol=1e-5 * (1 + np.abs(near).max()))


OWN_SHORT_PERIOD = {
    "states": ["alpha", "q"],
    "equations": {
        "alpha_dot": "Z_0 + Z_alpha*alpha + (1 + Z_q)*q + Z_de*de",
        "q_dot": "M_0 + M_alpha*alpha + M_q*q + M_de*de",
    },
    "outputs": {"qdot": "q_dot"},
    "parameters": {"Z_0": 0, "Z_alpha": -1, "Z_q": 0, "Z_de": 0, "M_0": 0, "M_alpha": -4, "M_q": -2, "M_de": -5},
}


def test_the_packaged_short_period_as_text_is_the_same_bit_for_bit():
    own, packaged = structure_from_equations(**OWN_SHORT_PERIOD), short_period(("alpha", "q", "qdot"))
    assert isinstance(own, LinearStructure)
    assert own.parameter_names == packaged.parameter_names
    values = packaged.with_parameters(ATTAS_SHORT_PERIOD).values
    for params in (values, values + 1e-30j * np.eye(8)):
        for a, b in zip(own.matrices(params), packaged.matrices(params), strict=True):
            np.testing.assert_array_equal(a, b)
    u = 0.1 * np.sign(np.sin(0.1 * np.arange(200)))[:, None]
    y = respond(packaged, values, (), u, Sampling(0.04, np.array([False])), np.zeros(2)).y
    y = y + 0.003 * np.random.default_rng(0).standard_normal(y.shape)
    record = FlightRecord(0.04 * np.arange(200), ("de", "alpha", "q", "qdot"), np.hstack([u, y]), "measured")
    for method in (equation_error, output_error, filter_error, ekf, ukf):
        a, b = method.estimate([record], own), method.estimate([record], packaged)
        np.testing.assert_array_equal(a.params, b.params)
        np.testing.assert_array_equal(a.covariance, b.covariance)


@pytest.mark.slow
def test_filter_error_and_equation_error_know_an_unstable_aircraft_in_gusts():
    """Output error does not: its simulation from the first sample departs. Within 5 errors, false alarm 3e-6 in all."""
    record = flown("unstable", std=1e-3, gust=0.05, n=700)
    truth = EXAMPLES["unstable"].truth
    model = filter_error.estimate([record], made("unstable"), FilterError(held=("de",)))
    for name, value in truth.items():
        assert abs(model.values[name] - value) < 5.0 * model.standard_errors[name], name
    first = equation_error.estimate([record], made("unstable"), EquationError(held=("de",)))
    assert first.values["M_alpha"] == pytest.approx(truth["M_alpha"], rel=0.25)
    assert first.values["M_de"] == pytest.approx(truth["M_de"], rel=0.25)


@pytest.mark.parametrize("method", [ekf, ukf])
def test_kalman_filters_take_equations_that_bend(method):
    record = flown("bent_short_period", std=1e-3)
    record = record.select(("de", "alpha", "q"))
    s = written(read_equations(SCENARIOS / "structures" / "bent_short_period.toml"), "bent", ("alpha", "q"))
    model = method.estimate([record], s)
    for name in ("Z_alpha", "M_alpha", "M_q", "M_de", "M_alpha2"):
        assert abs(model.values[name] - EXAMPLES["bent_short_period"].truth[name]) < 5.0 * model.standard_errors[name]


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_law_of_structures_holds_of_every_example(name):
    laws: list[Law] = list(tried(str(SCENARIOS / "structures" / f"{name}.toml")))
    assert len(laws) == 5
    assert [law.sentence for law in laws if not law.holds] == []


MORE = {
    "a lift that stalls": (
        {
            "states": ["alpha", "q"],
            "equations": {"alpha_dot": "q + Z*alpha + stall*max(alpha - 0.05, 0)", "q_dot": "M*alpha + M_q*q + D*de"},
        },
        {"Z": -2.0, "stall": 1.5, "M": -12.0, "M_q": -2.0, "D": -15.0},
    ),
    "derivatives that follow the measured dynamic pressure": (
        {
            "states": ["alpha", "q"],
            "inputs": ["de"],
            "equations": {"alpha_dot": "q + Z*qbar/V*alpha", "q_dot": "qbar*(M*alpha + M_q*q/V + D*de)"},
        },
        {"Z": -0.3, "M": -0.06, "M_q": -0.3, "D": -0.1},
    ),
    "a roll damped by its square": (
        {"states": ["p", "phi"], "equations": {"p_dot": "L_p*p + L_pp*abs(p)*p + L_da*da", "phi_dot": "p"}},
        {"L_p": -3.0, "L_pp": -2.0, "L_da": 30.0},
    ),
    "a servo that nobody senses": (
        {
            "states": ["alpha", "q", "surface"],
            "equations": {
                "alpha_dot": "q + Z*alpha",
                "q_dot": "M*alpha + M_q*q + D*surface",
                "surface_dot": "(de_cmd - surface)/lag",
            },
        },
        {"Z": -2.0, "M": -12.0, "M_q": -2.0, "D": -15.0, "lag": 0.08},
    ),
    "a bank that turns gravity": (
        {
            "states": ["beta", "p", "r", "phi"],
            "equations": {
                "beta_dot": "Y*beta - r + 0.5*sin(phi)",
                "p_dot": "L_beta*beta + L_p*p + L_da*da",
                "r_dot": "N_beta*beta + N_r*r + N_dr*dr",
                "phi_dot": "p",
            },
        },
        {"Y": -0.5, "L_beta": -8.0, "L_p": -5.0, "L_da": 20.0, "N_beta": 6.0, "N_r": -1.0, "N_dr": -4.0},
    ),
    "a lag downwash, one derivative in another equation": (
        {
            "states": ["alpha", "q"],
            "equations": {"alpha_dot": "q + Z*alpha", "q_dot": "M*alpha + M_adot*alpha_dot + D*tanh(de/0.1)"},
        },
        {"Z": -2.0, "M": -12.0, "M_adot": -1.5, "D": -1.5},
    ),
}


@pytest.mark.parametrize("name", MORE)
def test_other_equations_of_the_kind_are_recovered_from_exact_data(name):
    given, truth = MORE[name]
    s = structure_from_equations(**given, parameters={key: 1.2 * value for key, value in truth.items()})
    t = DT * np.arange(N)
    waves = {c: 0.08 * np.sin((2.2 + i) * t) + 0.06 * np.sin((5.1 + i) * t) for i, c in enumerate(s.inputs)}
    waves |= {"qbar": 250.0 + 40.0 * np.sin(0.9 * t), "V": 20.0 + 1.6 * np.sin(0.9 * t)}
    u = np.stack([waves[i] for i in s.inputs], axis=1)
    values = s.with_parameters(truth).values
    held = np.array([i.endswith("_cmd") for i in s.inputs])
    y = respond(s, values, (), u, Sampling(DT, held, 4), np.zeros(len(s.states))).y
    record = FlightRecord(t, (*s.inputs, *s.outputs), np.hstack([u, y]), "measured")
    model = output_error.estimate([record], s, OutputError(substeps=4))
    for key, value in truth.items():
        assert model.values[key] == pytest.approx(value, rel=1e-6), key


def test_only_what_is_used_of_outputs_counts():
    equations = read_equations(SCENARIOS / "structures" / "engine.toml")
    assert "k_T" in written(equations, "e", ("thrust",)).parameter_names
    assert "k_T" not in written(equations, "e", ("motor_speed",)).parameter_names


def test_linear_ones_are_recognised_through_definitions_and_trim():
    given = {
        "states": ["alpha", "q"],
        "definitions": {"lift": "gain*(Z_alpha*alpha + Z_de*de)/V_trim", "gain": "scale^2", "unused": "alpha^2"},
        "equations": {"alpha_dot": "q - lift", "q_dot": "-(M*(alpha - q/3)) + alpha_dot*M_w - 2"},
        "parameters": {"Z_alpha": 3, "Z_de": 0.5, "M": 4, "M_w": -0.2, "scale": {"value": 2, "free": False}},
        "outputs": {"az": "-V_trim*lift"},
    }
    with pytest.raises(EstimationError, match="uses V_trim, but no trim is known"):
        structure_from_equations(**given)
    s = structure_from_equations(**given, trim=Trim(20.0))
    assert isinstance(s, LinearStructure)
    a, d = 4.0 * 3.0 / 20.0, 4.0 * 0.5 / 20.0
    m = s.matrices(s.values)
    np.testing.assert_allclose(m.A, [[-a, 1.0], [-4.0 + 0.2 * a, 4.0 / 3.0 - 0.2]], rtol=1e-14)
    np.testing.assert_allclose(m.B, [[-d], [0.2 * d]], rtol=1e-14)
    np.testing.assert_allclose(m.bx, [0.0, -2.0])
    np.testing.assert_allclose(m.C, [[1.0, 0.0], [0.0, 1.0], [-20.0 * a, 0.0]])
    np.testing.assert_allclose(m.D, [[0.0], [0.0], [-20.0 * d]])
    bent = structure_from_equations(
        **{**given, "equations": {**given["equations"], "q_dot": "M*alpha + M_w*q*q"}}, trim=Trim(20.0)
    )
    assert not isinstance(bent, LinearStructure)


def test_a_structure_is_pickled_and_its_copies_compute_the_same():
    for s in (made("body_axes"), made("rates_alone")):
        again = pickle.loads(pickle.dumps(s))
        x, u = np.full(len(s.states), 0.3), np.full(len(s.inputs), 0.1)
        np.testing.assert_array_equal(again.derivative(x, u, s.values), s.derivative(x, u, s.values))
        first = s.parameter_names[0]
        assert s.with_parameters({first: 1.5}).values[0] == 1.5


def test_states_begin_where_initial_says():
    s = made("body_axes")
    record = flown("body_axes", n=5)
    np.testing.assert_allclose(s.initial_state(record), [25.0, 1.4, 0.0, 0.05])
    np.testing.assert_allclose(s.initial_state(record, measured=False), [25.0, 1.4, 0.0, 0.0])
    with pytest.raises(EstimationError, match=r"initial\.u needs channel 'V', which the record lacks"):
        s.initial_state(record.select(("de", "alpha", "q")))


# --- from an entry, and what is wrong ---------------------------------------------------------------------------------


def test_an_entry_takes_a_file_and_says_whose_it_is(records):
    record = records["bent_short_period"]
    model = tb.estimate("output_error", [record], ["de"], ["alpha", "q"], structure="structures/bent_short_period.toml")
    assert model.structure.name == "bent_short_period"
    assert model.outputs == ("alpha", "q")
    assert model.values["M_alpha2"] == pytest.approx(40.0, rel=1e-3)
    assert model.provenance["structure"]["file"].endswith("bent_short_period.toml")


def test_speeds_removed_as_trim_are_doubted_where_equations_mean_the_whole_speed(records):
    record = records["body_axes"]
    asked, channels = {"structure": "structures/body_axes.toml"}, ["V", "alpha", "q", "theta"]
    whole = tb.estimate("output_error", [record], ["de"], channels, **asked)
    assert "trim_removed" not in [a.code for a in whole.advice]
    removed = {"prepared": {"removed": {"V": 3.0}}}
    shifted = replace(record, provenance=removed)
    model = tb.estimate("output_error", [shifted], ["de"], channels, **asked)
    (said,) = [a for a in model.advice if a.code == "trim_removed"]
    assert said.severity == "doubt"
    assert "take V as a whole, but 3 was removed from it as trim" in said


def test_equations_without_a_value_at_the_start_say_which_and_where(records):
    record = records["bent_short_period"]
    given = {
        "states": ("alpha", "q"),
        "equations": {"alpha_dot": "q + Z*alpha", "q_dot": "M*de + N*log(alpha)"},
        "parameters": {"Z": -1, "M": -5, "N": 1},
    }
    with pytest.raises(EstimationError, match="'q_dot' of structure 'mine' must have a finite value and slope"):
        tb.estimate("output_error", [record], ["de"], ["alpha", "q"], structure="mine", equations=given)


RIGHT = {
    "states": ["alpha", "q"],
    "equations": {"alpha_dot": "Z*alpha + q", "q_dot": "M*alpha + D*de"},
    "parameters": {"Z": -1.0, "M": -4.0, "D": -5.0},
}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"equations": {"alpha_dot": "Z*alpha + q"}}, "equations: state 'q' needs an equation 'q_dot'"),
        ({"equations": {**RIGHT["equations"], "V_dot": "1"}}, "equations.V_dot: must be the derivative of a state"),
        ({"equations": {**RIGHT["equations"], "qdot": "1"}}, "did you mean 'q_dot'?"),
        (
            {"equations": {"alpha_dot": "Z*alfa + q", "q_dot": "M*alpha + D*de"}},
            "equations.alpha_dot: 'alfa' at character 3 ('alfa + q') is no state, input, parameter, constant, "
            "definition or channel; did you mean 'alpha'?",
        ),
        ({"parameters": {**RIGHT["parameters"], "X": 1.0}}, "parameters.X: no equation and no output uses it"),
        ({"inputs": ["de", "da"]}, "inputs.da: no equation and no output uses it"),
        ({"inputs": ["elevator"]}, "inputs: an input must be a channel, got 'elevator'"),
        ({"outputs": {"thetta": "q"}}, "outputs.thetta: an output must be a channel; did you mean 'theta'?"),
        ({"outputs": {"az": "Z*alpha +"}}, "outputs.az: a number, a name or a bracket must stand here, at char"),
        ({"definitions": {"L": "2*K", "K": "L"}, "outputs": {"az": "L"}}, "no quantity may need itself, got L needs K"),
        ({"constants": {"Z": 1.0}}, "names must differ, got 'Z', which stands under parameters too"),
        ({"constants": {"sin": 1.0}}, "a name must not be one that has its meaning"),
        ({"constants": {"2a": 1.0}}, "a name must be letters, digits and _"),
        ({"parameters": {**RIGHT["parameters"], "Z": "-1"}}, "parameters.Z: must be a number or a table"),
        ({"parameters": {**RIGHT["parameters"], "Z": {"value": 1.0, "hihg": 2.0}}}, "did you mean 'high'?"),
        ({"parameters": {**RIGHT["parameters"], "Z": {"value": 1.0, "high": 0.0}}}, "low <= value <= high must hold"),
        ({"initial": {"w": 1.0}}, "initial.w: must be a state"),
        ({"initial": {"q": "alpha_dot"}}, "initial.q: 'alpha_dot' at character 1"),
        ({"equations": {"alpha_dot": "Z*alpha + q", "q_dot": "M*alpha + D*exec('x')"}}, "no function 'exec'"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_key_place_and_nearest_name(change, said):
    with pytest.raises(EstimationError) as error:
        structure_from_equations(**{**RIGHT, **change})
    assert said in str(error.value)


def test_states_that_are_no_channels_need_an_output():
    with pytest.raises(EstimationError, match="no state is a channel, so that an output needs an equation"):
        structure_from_equations(states=["s"], equations={"s_dot": "a*s + de"}, parameters={"a": -1})


def test_own_parameters_have_no_truth_of_the_packaged_names():
    """Z_alpha of one's own may be per speed or not: the aircraft's Z_alpha does not stand beside it as the truth."""
    known = [Derivative("Z_alpha", "m/s2", "", -90.0, None)]
    assert true_parameters("short_period", known, 15.0) == {"Z_alpha": -6.0}
    assert true_parameters("mine", known, 15.0) == {}
