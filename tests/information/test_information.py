"""The linearised aircraft as a structure, and the Fisher information of an input through sensors.

Targets of other parameters, where they are known in closed form, and which samples of a simulated record count.

Turbulence in the information: the filter makes its outputs white, and what misleads an estimator is found.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from testbench.core.errors import ChannelError, EstimationError
from testbench.core.paths import SCENARIOS
from testbench.core.record import FlightRecord
from testbench.core.scenario.air import AirSpec
from testbench.estimators.parametric import output_error
from testbench.estimators.parametric.kalman.innovations import sampled_noise
from testbench.estimators.parametric.response import Sampling, respond
from testbench.estimators.settings import OutputError
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.flight import linearise, load_aircraft
from testbench.information.aircraft_structure import aircraft_structure, parameter_names
from testbench.information.fisher import Experiment, accuracy, cost
from testbench.information.targets import Targets, targets
from testbench.information.turbulence import Turbulence
from testbench.questions.design.pose import limits_of, place, problem_of
from testbench.questions.design.scenario import DesignScenario
from testbench.sensors import Sensor, load_suite

FREE = ("X_V", "Z_alpha", "Z_de", "M_alpha", "M_q", "M_de")
OUTPUTS = ("V", "alpha", "q", "theta", "az")
NOISE = (0.2, 0.005, 0.01, 0.005, 0.1)
DT, N = 0.02, 500


@pytest.fixture(scope="module")
def linear(taurus, taurus_trim):
    return linearise(taurus, taurus_trim)


def structure(linear, trimmed, free=FREE, inputs=("de_cmd",), outputs=OUTPUTS, modes=(), plane="longitudinal"):
    return aircraft_structure(linear, trimmed, plane, modes, inputs, outputs, free)


def sensors(**other):
    return tuple(Sensor(c, noise_std=s, **other) for c, s in zip(OUTPUTS, NOISE, strict=True))


def doublet():
    u = np.zeros((N, 1))
    u[50:75], u[75:100] = 0.05, -0.05
    return u


def test_true_parameters_give_the_linearised_aircraft_and_are_the_derivatives_of_the_tables(linear, taurus_trim):
    s = structure(linear, taurus_trim)
    m = s.matrices(s.true)
    rows = [linear.states.index(x) for x in s.states]
    np.testing.assert_array_equal(m.A, linear.A[np.ix_(rows, rows)])
    table = {d.name: d.held for d in dimensional_derivatives(linear, taurus_trim)}
    for name, value in zip(FREE, s.true, strict=True):
        assert value == pytest.approx(table[name], rel=1e-9)


def test_lateral_parameters_are_the_derivatives_of_the_tables(linear, taurus_trim):
    names = parameter_names(linear.inputs, "lateral", ())
    s = structure(linear, taurus_trim, names, ("da_cmd", "dr_cmd"), ("p", "r", "beta", "ay"), plane="lateral")
    table = {d.name: d.held for d in dimensional_derivatives(linear, taurus_trim)}
    for name, value in zip(names, s.true, strict=True):
        assert value == pytest.approx(table[name], rel=1e-9, abs=1e-7)


def test_a_changed_derivative_changes_what_accelerometers_feel(linear, taurus_trim):
    s = structure(linear, taurus_trim)
    params = s.true.copy()
    params[FREE.index("Z_alpha")] *= 1.1
    m = s.matrices(params)
    row, az = s.states.index("w"), OUTPUTS.index("az")
    np.testing.assert_allclose(m.C[az] - s.C0[az], m.A[row] - s.A0[row], rtol=1e-9, atol=1e-12)
    assert np.abs(m.C[az] - s.C0[az]).max() > 0.1


def test_modal_parameters_are_frequency_and_damping(eolo, eolo_trim):
    linear = linearise(eolo, eolo_trim)
    s = structure(linear, eolo_trim, ("omega_1", "zeta_1", "Q1_de"), modes=(1, 5, 7), outputs=("q",))
    row, column = s.states.index("etadot_1"), s.states.index("eta_1")
    assert s.true[0] == pytest.approx(np.sqrt(-s.A0[row, column]))
    params = s.true * np.array([1.1, 1.0, 1.0])
    assert s.matrices(params).A[row, column] == pytest.approx(1.21 * s.A0[row, column])


def rigid_pair(A) -> tuple[complex, complex]:
    """The two roots that lie farthest out apart from the servo's: those of the short period, split or not."""
    poles = sorted(np.linalg.eigvals(A), key=abs)
    fast = [p for p in poles if abs(p) > 2.0 and abs(p + 50.0) > 15.0]
    return complex(fast[0]), complex(fast[1])


@pytest.mark.parametrize("stiffness", [1.0, 0.02])
def test_a_mode_keeps_frequency_and_damping_where_it_splits(linear, taurus_trim, stiffness):
    """Values and slopes of wn = sqrt(s1 s2) and zeta, against differences of the eigenvalues of changed matrices."""
    s = structure(linear, taurus_trim)
    params = s.true * np.where(np.array(FREE) == "M_alpha", stiffness, 1.0)
    m = s.matrices(params)
    s = replace(s, A0=m.A, C0=m.C, true=params)
    a, b = rigid_pair(m.A)
    assert (a.imag == 0.0) == (stiffness < 1.0)
    aim = targets(s, {}, {"short period": (a, b)}, (0.01, 0.01))
    assert aim.names == ("wn of short period", "zeta of short period")

    def quantities(params) -> np.ndarray:
        one, two = rigid_pair(s.matrices(params).A)
        wn = np.sqrt((one * two).real)
        return np.array([wn, -(one + two).real / (2.0 * wn)])

    np.testing.assert_allclose(aim.values, quantities(params), rtol=1e-9)
    for k in range(len(FREE)):
        step = np.zeros(len(FREE))
        step[k] = 1e-5 * abs(params[k])
        slope = (quantities(params + step) - quantities(params - step)) / (2.0 * step[k])
        np.testing.assert_allclose(aim.jacobian[:, k], slope, rtol=1e-4, atol=1e-8)
    if stiffness == 1.0:  # a pair is what one of its poles is
        alone = targets(s, {}, {"short period": a}, (0.01, 0.01))
        np.testing.assert_allclose(alone.jacobian, aim.jacobian, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(alone.values, aim.values, rtol=1e-12)


def test_a_root_that_grows_has_no_frequency(linear, taurus_trim):
    s = structure(linear, taurus_trim)
    params = s.true * np.where(np.array(FREE) == "M_alpha", -1.0, 1.0)
    m = s.matrices(params)
    s = replace(s, A0=m.A, C0=m.C, true=params)
    poles = np.linalg.eigvals(m.A).real
    with pytest.raises(EstimationError, match="the short period has split into real roots of which one grows"):
        targets(s, {}, {"short period": (complex(poles.max()), complex(poles.min()))}, (0.01, 0.01))


def test_information_is_that_of_the_sensitivities(linear, taurus_trim):
    s = structure(linear, taurus_trim)
    u = doublet()
    r = respond(s, s.true, range(len(FREE)), u, Sampling(DT, np.ones(1, bool)), np.zeros(len(s.states)))
    W = (r.dparams / np.array(NOISE)[:, None]).reshape(-1, len(FREE))
    found = Experiment(s, sensors(), DT, N, biases=False).information(u)
    np.testing.assert_allclose(found, W.T @ W, rtol=1e-8)
    # offsets: the Schur complement is least squares on sensitivities less their mean
    centred = (r.dparams - r.dparams.mean(axis=0)) / np.array(NOISE)[:, None]
    W = centred.reshape(-1, len(FREE))
    np.testing.assert_allclose(Experiment(s, sensors(), DT, N).information(u), W.T @ W, rtol=1e-7)


def test_a_fine_input_seen_by_slow_sensors(linear, taurus_trim):
    s, stride = structure(linear, taurus_trim), 4
    u = np.zeros((N, 1))
    u[51:76], u[76:101] = 0.05, -0.05  # edges off the sensors' samples
    r = respond(s, s.true, range(len(FREE)), u, Sampling(DT, np.ones(1, bool)), np.zeros(len(s.states)))
    y, S = Experiment(s, sensors(), DT, N // stride, stride).response(u)
    np.testing.assert_allclose(y, r.y[::stride], atol=1e-10 * np.abs(r.y).max())
    np.testing.assert_allclose(S, r.dparams[::stride], atol=1e-9 * np.abs(r.dparams).max())


def test_slow_sensors_and_lost_samples_tell_less_and_lag_shapes(linear, taurus_trim):
    s, u = structure(linear, taurus_trim), doublet()
    full = Experiment(s, sensors(), DT, N, biases=False).information(u)
    lost = Experiment(s, sensors(dropout=0.25), DT, N, biases=False).information(u)
    np.testing.assert_allclose(lost, 0.75 * full, rtol=1e-12)
    slow = Experiment(s, sensors(rate_hz=10.0), DT, N, biases=False).information(u)
    np.testing.assert_allclose(np.diag(slow), np.diag(full) / 5.0, rtol=0.2)  # a fifth of the samples
    lagged = Experiment(s, sensors(lag_s=0.2), DT, N, biases=False).information(u)
    assert np.all(np.diag(lagged) < np.diag(full))
    quantised = tuple(Sensor(c, quantum=n * np.sqrt(12.0)) for c, n in zip(OUTPUTS, NOISE, strict=True))
    np.testing.assert_allclose(Experiment(s, quantised, DT, N, biases=False).information(u), full, rtol=1e-9)


def test_predicted_errors_are_the_scatter_of_output_error_estimates(linear, taurus_trim):
    s, u = structure(linear, taurus_trim), doublet()
    predicted = accuracy(Experiment(s, sensors(), DT, N).information(u)).std
    y = respond(s, s.true, (), u, Sampling(DT, np.ones(1, bool)), np.zeros(len(s.states))).y
    found = []
    for seed in range(60):
        noise = np.random.default_rng(seed).standard_normal(y.shape) * np.array(NOISE)
        record = FlightRecord(np.arange(N) * DT, ("de_cmd", *OUTPUTS), np.hstack([u, y + noise]), "measured")
        found.append(
            output_error.estimate([record], s, OutputError(initial_states="zero", output_biases=OUTPUTS)).params
        )
    z = (np.array(found) - s.true) / predicted
    # 6 x 60 squared deviates, correlated among parameters: at worst chi-square of 60 per parameter. The 1e-4 limits
    # of chi-square with 60 degrees of freedom over 60 are 0.47 and 1.82; six of them: false alarm 1e-3
    assert np.all((np.mean(z**2, axis=0) > 0.47) & (np.mean(z**2, axis=0) < 1.82))


def test_costs():
    M, G = np.diag([4.0, 16.0]), np.eye(2)
    assert cost(M, G, "worst") == pytest.approx(0.5)
    assert cost(M, G, "E") == pytest.approx(0.5)
    assert cost(M, G, "A") == pytest.approx(np.sqrt((0.25 + 0.0625) / 2.0))
    assert cost(M, G, "D") == pytest.approx(64.0**-0.25)
    assert cost(4.0 * M, G, "D") == pytest.approx(0.5 * cost(M, G, "D")), "scales as 1 / amplitude"
    assert cost(M, np.diag([4.0, 1.0]), "worst") == pytest.approx(2.0), "in units of the wanted errors"
    assert cost(M, np.array([[1.0, 2.0]]), "worst") == pytest.approx(np.sqrt(0.25 + 4.0 * 0.0625))
    assert cost(np.diag([1.0, 0.0]), G, "D") == np.inf


def test_what_is_not_known_has_no_finite_error():
    found = accuracy(np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 4.0]]))
    assert list(np.isinf(found.std)) == [True, True, False]
    assert found.std[2] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("error", "law", "change"),
    [
        (EstimationError, "did you mean 'M_alpha'|'M_alpha'", {"free": ("M_alhpa",)}),
        (EstimationError, "omega_1 and zeta_1 go together", {"free": ("omega_1",), "modes": (1,)}),
        (ChannelError, "no channel 'alhpa'", {"outputs": ("alhpa",)}),
    ],
)
def test_unknown_names(eolo, eolo_trim, error, law, change):
    linear = linearise(eolo, eolo_trim)
    with pytest.raises(error, match=law):
        structure(linear, eolo_trim, **change)


def test_a_sensor_without_noise_is_refused(linear, taurus_trim):
    s = structure(linear, taurus_trim, outputs=("q",), free=("M_q",))
    with pytest.raises(EstimationError, match="'q' is free of noise"):
        Experiment(s, (Sensor("q"),), DT, N)
    with pytest.raises(EstimationError, match="must divide that of the suite"):
        Experiment(s, (Sensor("q", noise_std=0.1, rate_hz=30.0),), DT, N)


def matrices(p):
    """A mode of frequency p[0] and damping ratio p[1] beside one of 20 rad/s and 0.02 that stays."""
    A = np.zeros((4, 4), np.result_type(p, float))
    A[0, 1] = A[2, 3] = 1.0
    A[1, 0], A[1, 1] = -(p[0] ** 2), -2.0 * p[1] * p[0]
    A[3, 2], A[3, 3] = -400.0, -0.8
    return SimpleNamespace(A=A)


STRUCTURE = SimpleNamespace(matrices=matrices, parameter_names=("w", "z"))


@pytest.mark.parametrize("zeta", [0.4, 0.98, 1.2])
def test_targets_and_slopes_of_other_parameters(zeta):
    """The mode that is followed may have split into two real roots; the other mode may not be taken for it."""
    near = (-3.0 + 1.0j) if zeta < 1.0 else (-5.6 + 0.0j, -1.6 + 0.0j)
    modes = {"short period": near}
    aim = Targets(("zeta of short period", "w", "wn of short period"), None, None, None, modes)
    p = np.array([3.0, zeta])
    np.testing.assert_allclose(aim.at(STRUCTURE, p), [zeta, 3.0, 3.0], rtol=1e-12)
    np.testing.assert_allclose(aim.slopes(STRUCTURE, p), [[0.0, 1.0], [1.0, 0.0], [1.0, 0.0]], atol=1e-7)
    np.testing.assert_allclose(aim.slopes(STRUCTURE, p, [1]), [[0.0, 1.0], [0.0, 0.0], [0.0, 0.0]], atol=1e-7)


def test_a_mode_that_splits_into_a_root_that_grows_has_no_frequency():
    aim = Targets(("wn of m", "zeta of m"), None, None, None, {"m": (-2.0 + 0.0j, 1.0 + 0.0j)})
    grows = SimpleNamespace(matrices=lambda p: SimpleNamespace(A=np.diag([-2.0, 1.0])), parameter_names=())
    assert np.isnan(aim.at(grows, np.zeros(0))).all()


def test_a_real_root_is_a_frequency_without_a_damping_ratio():
    def of(p):
        A = np.zeros((*np.shape(p)[:-1], 2, 2), np.result_type(p))
        A[..., 0, 0], A[..., 1, 1] = p[..., 0], -3.0
        return SimpleNamespace(A=A)

    one = SimpleNamespace(
        matrices=of,
        parameter_names=("a",), parameters=("a",), true=np.array([-0.5]), A0=np.diag([-0.5, -3.0]),
    )  # fmt: skip
    found = targets(one, {"a": 0.1}, {"subsidence": -0.5 + 0.0j}, (0.02, 0.03))
    assert found.names == ("a", "wn of subsidence")
    np.testing.assert_allclose(found.values, [-0.5, 0.5])
    np.testing.assert_allclose(found.wanted, [0.05, 0.01])
    np.testing.assert_allclose(found.jacobian, [[1.0], [-1.0]])
    np.testing.assert_allclose(found.gradient, [[20.0], [-100.0]])


@pytest.fixture(scope="module")
def case():
    """EOLO with its air data boom, as designed for in light turbulence."""
    scenario = DesignScenario.load(SCENARIOS / "design" / "eolo_short_period.toml")
    aircraft = load_aircraft(scenario.aircraft)
    at, suite = place(scenario, aircraft), load_suite(scenario.suites[0])
    return problem_of(scenario, at, suite, limits_of(scenario, aircraft, at.trimmed), starts=True)


@pytest.fixture(scope="module")
def input_(case):
    u = np.zeros((case.experiment.samples * case.experiment.stride, 1))
    u[round(2.0 * case.rate_hz) : round(3.0 * case.rate_hz)] = 0.02
    u[round(3.0 * case.rate_hz) : round(4.0 * case.rate_hz)] = -0.02
    return u


def test_the_filter_makes_what_turbulence_does_white(case):
    """Outputs of the model itself, driven by white noise: innovations of variance one without correlation.

    Over 2000 samples a variance scatters by 3 %, a correlation by 2 %; 15 % and 10 % are five of each.
    """
    e = case.experiment
    n, dt = e.samples, e.dt_s * e.stride
    whitener = e.turbulence.whitener(e.sigma, dt, n)
    Phi, Q = sampled_noise(e.turbulence.A, e.turbulence.F, dt)
    rng = np.random.default_rng(5)
    values, vectors = np.linalg.eigh(Q)
    half = vectors * np.sqrt(np.maximum(values, 0.0))
    x, y = np.zeros(len(Phi)), np.empty((n, len(e.sigma)))
    for k in range(n):
        y[k] = e.turbulence.C @ x + e.sigma * rng.standard_normal(e.sigma.size)
        x = Phi @ x + half @ rng.standard_normal(len(Phi))
    size = 2 * n
    v = np.fft.irfft(
        np.einsum("fij,fj->fi", np.fft.rfft(whitener, size, axis=0), np.fft.rfft(y, size, axis=0)), size, axis=0
    )[:n]
    v = v[200:]  # the steady gain is not that of the first samples
    np.testing.assert_allclose(v.std(axis=0), 1.0, atol=0.15)
    for lag in (1, 2, 5):
        assert np.abs(v[lag:].T @ v[:-lag] / len(v)).max() < 0.1
    assert np.abs(np.corrcoef(y[200:].T)).max() > 0.5  # the outputs themselves are not


def test_turbulence_costs_information_and_nearly_none_costs_nearly_nothing(case, input_):
    windy = case.targets.errors(accuracy(case.experiment.information(input_)))
    still = replace(case.experiment, turbulence=None)
    calm = case.targets.errors(accuracy(still.information(input_)))
    assert (windy > 1.2 * calm).all()
    t = case.experiment.turbulence
    tiny = replace(still, turbulence=Turbulence(t.A, 1e-6 * t.F, t.C))
    np.testing.assert_allclose(case.targets.errors(accuracy(tiny.information(input_))), calm, rtol=1e-3)


def test_still_air_has_no_turbulence(case):
    e = case.experiment
    assert Turbulence.of(e.structure, e.sensors, AirSpec(), 100.0, 16.0, 0.0) is None


@pytest.mark.parametrize("windy", [True, False])
def test_another_parameter_misleads_by_its_difference(case, input_, windy):
    """The outputs of the aircraft with M_q and M_de changed a little, offsets added: the change is found."""
    e = case.experiment if windy else replace(case.experiment, turbulence=None)
    s = e.structure
    change = np.zeros(s.true.size)
    for name in ("M_q", "M_de"):
        k = s.parameter_names.index(name)
        change[k] = 1e-4 * s.true[k]
    m, start = len(s.inputs), np.zeros(len(s.states))
    u = np.vstack([np.zeros((1, m)), input_])
    y0, y1 = (
        respond(s, s.true + c, (), u, Sampling(e.dt_s, np.ones(m, bool)), start).y for c in (0.0 * change, change)
    )
    difference = np.hstack([e._sensed((y1 - y0)[:, i : i + 1], i) for i in range(len(e.sensors))])
    found = e.misled(input_, difference[1:][:: e.stride] + np.arange(1.0, len(e.sensors) + 1.0))
    np.testing.assert_allclose(found, change, rtol=0.02, atol=1e-6 * np.abs(s.true).max())
