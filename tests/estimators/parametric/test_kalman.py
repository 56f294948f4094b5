"""EKF and UKF: against the linear filter, on simulated short periods, and on recorded flights."""

import numpy as np
import pytest
from recorded import flight_data
from scipy.linalg import expm

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators.parametric import output_error
from testbench.estimators.parametric.kalman import ekf, ukf
from testbench.estimators.parametric.kalman.augmented import Gaussian
from testbench.estimators.parametric.structures.longitudinal import short_period
from testbench.estimators.settings import ExtendedFilter, UnscentedFilter

TRUE = {"Z_0": 0.0, "Z_alpha": -0.9, "Z_q": -0.02, "Z_de": -0.1, "M_0": 0.0, "M_alpha": -5.0, "M_q": -1.8, "M_de": -7.0}
FREE = ("Z_alpha", "M_alpha", "M_q", "M_de")
NOISE = np.array([2e-3, 4e-3])
DT = 0.04


def structure(free=FREE, values=TRUE):
    return short_period().with_parameters(values, free=free)


def transition(A, h):
    """exp(A h), and its integrals that an input which is held and one which runs linearly multiply."""
    one, inverse = np.eye(2), np.linalg.inv(A)
    Phi = expm(A * h)
    step = inverse @ (Phi - one)
    ramp = inverse @ (step - h * one) / h
    return Phi, step, ramp


def matrices():
    A = np.array([[TRUE["Z_alpha"], 1.0 + TRUE["Z_q"]], [TRUE["M_alpha"], TRUE["M_q"]]])
    return A, np.array([[TRUE["Z_de"]], [TRUE["M_de"]]])


def flight(seed, N=400, process=(0.0, 0.0), missing=0.0, noise=NOISE):
    """3-2-1-1 on the short period; process noise per square root of a second, added as the filters take it."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(N)
    u = np.zeros((N, 1))
    for begin, end, sign in (
        (1.0, 2.5, 1),
        (2.5, 3.5, -1),
        (3.5, 4.0, 1),
        (4.0, 4.5, -1),
        (9.0, 10.0, -1),
        (10.0, 11.0, 1),
    ):
        u[(t >= begin) & (t < end)] = 0.03 * sign
    u[1:] = 0.5 * (u[1:] + u[:-1])  # a step takes two samples: it runs linearly and is not held
    A, B = matrices()
    Phi, step, ramp = transition(A, DT)
    x, X = np.zeros(2), np.zeros((N, 2))
    half = np.array(process) * np.sqrt(DT / 2)
    for k in range(N):
        X[k] = x
        if k < N - 1:
            x = Phi @ (x + half * rng.standard_normal(2)) + step @ B @ u[k] + ramp @ B @ (u[k + 1] - u[k])
            x = x + half * rng.standard_normal(2)
    y = X + noise * rng.standard_normal(X.shape)
    valid = np.ones((N, 3), bool)
    valid[:, 1:] = rng.uniform(size=(N, 2)) >= missing
    return FlightRecord(t, ("de", "alpha", "q"), np.hstack([u, y]), "measured", valid=valid), X


def linear_filter(record, process):
    """Textbook Kalman filter of the same discrete model, started from the first sample; states (N, 2)."""
    A, B = matrices()
    Phi, step, ramp = transition(A, DT)
    u, y, valid = record.data[:, :1], record.data[:, 1:], record.valid[:, 1:]
    half = np.diag(np.array(process) ** 2 * DT / 2)
    x, P = y[0].copy(), np.diag((3.0 * NOISE) ** 2)
    out, covariances = np.zeros(y.shape), np.zeros((len(y), 2, 2))
    for k in range(len(y)):
        rows = valid[k]
        C, R = np.eye(2)[rows], np.diag(NOISE**2)[np.ix_(rows, rows)]
        K = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
        x = x + K @ (y[k][rows] - C @ x)
        P = P - K @ C @ P
        out[k], covariances[k] = x, P
        if k < len(y) - 1:
            x = Phi @ x + step @ B @ u[k] + ramp @ B @ (u[k + 1] - u[k])
            P = Phi @ (P + half) @ Phi.T + half
    return out, covariances


NOISES = {"alpha": NOISE[0], "q": NOISE[1]}
KINDS = ((ekf, ExtendedFilter), (ukf, UnscentedFilter))


def test_with_known_parameters_the_ekf_is_the_linear_filter():
    process = (0.01, 0.05)
    record, _ = flight(1, process=process, missing=0.3)
    model = ekf.estimate(
        [record],
        structure(free=()),
        ExtendedFilter(measurement_noise=NOISES, process_noise=dict(zip(("alpha", "q"), process, strict=True))),
    )
    x, P = linear_filter(record, process)
    track = model.diagnostics["tracks"][0]
    # 400 samples of a contracting filter: rounding does not grow
    np.testing.assert_allclose(track.states, x, atol=1e-14)
    np.testing.assert_allclose(track.covariance, P, rtol=1e-10, atol=1e-18)


def test_on_a_linear_model_the_ukf_is_the_ekf():
    process = {"alpha": 0.01, "q": 0.05}
    record, _ = flight(2, process=tuple(process.values()), missing=0.3)
    both = [
        kind.estimate([record], structure(free=()), given(measurement_noise=NOISES, process_noise=process, smooth=True))
        for kind, given in KINDS
    ]
    a, b = (model.diagnostics["tracks"][0] for model in both)
    # sigma points are differences of numbers near 0.1 divided by steps of 0.1 sqrt(2): a few digits of 16 go
    np.testing.assert_allclose(b.states, a.states, atol=1e-13)
    np.testing.assert_allclose(b.covariance, a.covariance, rtol=1e-8, atol=1e-16)
    np.testing.assert_allclose(b.smoothed, a.smoothed, atol=1e-12)


def test_the_smoother_is_least_squares_over_the_whole_record():
    # Without process noise the smoothed path is the one path that fits all samples best: with the parameters fixed, the
    # initial state is a weighted linear least-squares problem.
    record, _ = flight(3, N=120)
    model = ekf.estimate([record], structure(free=()), ExtendedFilter(measurement_noise=NOISES, smooth=True))
    A, B = matrices()
    Phi, step, ramp = transition(A, DT)
    u, y = record.data[:, :1], record.data[:, 1:]
    path, power = np.zeros((120, 2)), np.zeros((120, 2, 2))
    power[0] = np.eye(2)
    for k in range(119):
        path[k + 1] = Phi @ path[k] + step @ B @ u[k] + ramp @ B @ (u[k + 1] - u[k])
        power[k + 1] = Phi @ power[k]
    weight = 1.0 / NOISE
    left = np.vstack([(power * weight[:, None]).reshape(-1, 2), np.diag(1.0 / (3.0 * NOISE))])
    right = np.concatenate([((y - path) * weight).ravel(), y[0] / (3.0 * NOISE)])
    x0 = np.linalg.lstsq(left, right, rcond=None)[0]
    np.testing.assert_allclose(model.diagnostics["tracks"][0].smoothed, path + power @ x0, atol=1e-9)


@pytest.mark.parametrize(("kind", "given"), KINDS, ids=("ekf", "ukf"))
def test_parameters_reach_the_truth_within_their_errors(kind, given):
    start = {**TRUE, "Z_alpha": -0.5, "M_alpha": -3.0, "M_q": -1.0, "M_de": -4.0}
    records = [flight(seed, missing=0.1)[0] for seed in (4, 5)]
    model = kind.estimate(records, structure(values=start), given(measurement_noise=NOISES))
    for name in FREE:
        # 4 standard errors: 6e-5 false alarms per parameter, 5e-4 in all
        assert abs(model.values[name] - TRUE[name]) < 4.0 * model.standard_errors[name], name
        assert model.standard_errors[name] < 0.1 * abs(TRUE[name])
    assert model.advice == ()  # linear equations, white innovations of the expected size: nothing to say
    first, last = model.diagnostics["tracks"][0].parameters_std[[0, -1]]
    assert np.all(last < 0.2 * first)


def test_noise_not_given_is_taken_from_the_record():
    model = ekf.estimate([flight(6)[0]], structure())
    told = model.settings["measurement_noise"]
    # third differences of 400 samples give the variance to some 11 %; manoeuvre steps in q add to it
    assert told["alpha"] == pytest.approx(NOISE[0], rel=0.3)
    assert told["q"] == pytest.approx(NOISE[1], rel=0.6)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("kind", "given"), KINDS, ids=("ekf", "ukf"))
def test_errors_are_consistent_over_seeds(kind, given):
    """Sum of normalised squared errors (states and parameters at the end) over 20 flights: chi square."""
    from scipy.stats import chi2

    process = (0.004, 0.02)
    deviation = {"Z_alpha": 0.1, "M_alpha": 0.5, "M_q": 0.2, "M_de": 0.5}
    total, count = 0.0, 0
    for seed in range(20):
        rng = np.random.default_rng(1000 + seed)
        record, X = flight(2000 + seed, N=250, process=process)
        start = {**TRUE, **{n: TRUE[n] + s * rng.standard_normal() for n, s in deviation.items()}}
        model = kind.estimate(
            [record],
            structure(values=start),
            given(
                measurement_noise=NOISES,
                process_noise=dict(zip(("alpha", "q"), process, strict=True)),
                initial_std={**deviation, "alpha": 3.0 * NOISE[0], "q": 3.0 * NOISE[1]},
            ),
        )
        track = model.diagnostics["tracks"][0]
        error = np.concatenate([track.states[-1] - X[-1], [model.values[n] - TRUE[n] for n in FREE]])
        total += error @ np.linalg.solve(track.covariance[-1], error)
        count += error.size
    # two-sided, 1e-3 false alarms each for filters that are exactly Gaussian
    assert chi2.ppf(5e-4, count) < total < chi2.ppf(1 - 5e-4, count)


def test_a_drifting_parameter_is_followed():
    rng = np.random.default_rng(7)
    N = 1500
    t = DT * np.arange(N)
    M_de = -7.0 + 3.0 * (t > 30.0)
    u = 0.02 * np.sign(np.sin(2 * np.pi * 0.4 * t))[:, None]
    A, _ = matrices()
    Phi, step, ramp = transition(A, DT)
    x, X = np.zeros(2), np.zeros((N, 2))
    for k in range(N - 1):
        now = np.array([[TRUE["Z_de"]], [M_de[k]]])
        x = Phi @ x + step @ now @ u[k] + ramp @ now @ (u[k + 1] - u[k])
        X[k + 1] = x
    data = np.hstack([u, X + NOISE * rng.standard_normal(X.shape)])
    record = FlightRecord(t, ("de", "alpha", "q"), data, "measured")
    model = ekf.estimate(
        [record],
        structure(free=("M_de",)),
        ExtendedFilter(measurement_noise=NOISES, parameter_drift={"M_de": 0.3}, smooth=True),
    )
    track = model.diagnostics["tracks"][0]
    before, after = track.smoothed[t < 25.0, 2].mean(), track.smoothed[t > 35.0, 2].mean()
    # drift of 0.3 per root second leaves deviations near 0.2 at any time, far less in the mean of 25 s
    assert before == pytest.approx(-7.0, abs=0.15)
    assert after == pytest.approx(-4.0, abs=0.15)


def test_innovations_larger_than_expected_are_said():
    model = ekf.estimate(
        [flight(8)[0]], structure(), ExtendedFilter(measurement_noise={"alpha": NOISE[0] / 4, "q": NOISE[1]})
    )
    assert model.status != "good"
    assert any("alpha" in sentence and "measurement_noise" in sentence for sentence in model.advice)


def test_names_and_settings_that_cannot_be_are_refused():
    record, _ = flight(9, N=60)
    for wrong in (
        {"measurement_noise": {"r": 1.0}},
        {"process_noise": {"theta": 1.0}},
        {"parameter_drift": {"Z_de": 1.0}},
        {"initial_std": {"M_q": 0.0}},
    ):
        with pytest.raises(EstimationError):
            ekf.estimate([record], structure(), ExtendedFilter(**wrong))
    with pytest.raises(EstimationError, match="alpha"):
        ukf.estimate([record], structure(), UnscentedFilter(alpha=0.0))


@pytest.mark.parametrize("rounding", [0.0, 1e-12, -1e-12])
def test_sigma_points_of_a_singular_covariance_hold_it_whatever_rounding_made_of_it(rounding):
    tilt = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.3, 0.4, np.sqrt(0.75)]])
    exact = tilt @ np.diag([4.0, 1e-2, 0.0]) @ tilt.T
    points = ukf.UnscentedKalmanFilter().points(Gaussian(np.ones(3), exact + rounding * np.diag([0.0, 0.0, 1.0])))
    spread = ukf.UnscentedKalmanFilter().weights(3)[0]
    d = points - points[0]
    assert points[0] == pytest.approx(np.ones(3), abs=0.0)
    assert np.allclose(d.T @ d / (2.0 * spread), exact, rtol=0.0, atol=1e-11)


def test_a_covariance_that_is_not_positive_beyond_rounding_is_refused():
    covariance = np.array([[1.0, 1.1], [1.1, 1.0]])
    with pytest.raises(EstimationError, match="no longer positive"):
        ukf.UnscentedKalmanFilter().points(Gaussian(np.zeros(2), covariance))


def attas():
    from scipy.io import loadmat

    files = [flight_data() / "attas" / f"fAttasElv{i}.mat" for i in (1, 2)]
    for file in files:
        if not file.is_file():
            pytest.skip(f"attas/{file.name} is missing from the folder of flight records")
    tables = [loadmat(file)[file.stem] for file in files]
    return [
        FlightRecord(DT * np.arange(len(t)), ("de", "alpha", "q"), np.deg2rad(t[:, [21, 12, 7]]), "measured")
        for t in tables
    ]


def test_attas_short_period_agrees_with_output_error():
    records = attas()
    reference = output_error.estimate(records, short_period())
    noise = dict(zip(reference.outputs, reference.diagnostics["residual_std"].tolist(), strict=True))
    for kind, given in KINDS:
        model = kind.estimate(records, short_period(), given(measurement_noise=noise))
        for name, value in reference.values.items():
            # same data, same weights: what is left is the wide but finite initial belief and the order of linearising
            assert abs(model.values[name] - value) < reference.standard_errors[name], name
        mode = model.modes()[0]
        assert mode.wn_rad_s == pytest.approx(2.53, rel=0.01)
        assert mode.zeta == pytest.approx(0.493, rel=0.02)
        assert model.status != "good"  # real residuals are coloured, which the filter's own errors do not know
        assert any("not white" in sentence for sentence in model.advice)
