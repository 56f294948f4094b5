"""evaluate: scores of data sets, matches, responses, and verdicts in words."""

from dataclasses import fields

import numpy as np
import pytest
from scipy.signal import cont2discrete

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators.state_space import StateSpaceModel
from testbench.evaluation import Evaluation, TrueSystem, _pole_verdict, evaluate
from testbench.evaluation.modes import match_poles

DT = 0.05
A_S = np.array([[-1.2, 1.0], [-6.6, -2.5]])
POLE = complex(*(lambda s: (s.real, abs(s.imag)))(np.linalg.eigvals(A_S)[0]))


def model(scale=1.0, A=None, **changes):
    a, b = cont2discrete((A_S, np.array([[-0.1], [-8.0]]), np.eye(2), np.zeros((2, 1))), DT)[:2]
    settings = {
        "method": "dsr_e",
        "inputs": ("de",),
        "outputs": ("alpha", "q"),
        "dt_s": DT,
        "A": a if A is None else A,
        "B": scale * b,
        "C": np.eye(2),
        "D": np.zeros((2, 1)),
    }
    return StateSpaceModel(**{**settings, **changes})


def record(seed, n=200, noise=0.0, valid=None):
    rng = np.random.default_rng(seed)
    u = 0.05 * np.repeat(rng.standard_normal((n // 5, 1)), 5, axis=0)
    x, y, m = rng.standard_normal(2) * 0.05, np.empty((n, 2)), model()
    for k in range(n):
        y[k] = x
        x = m.A @ x + m.B @ u[k]
    y = y + noise * y.std(axis=0) * rng.standard_normal(y.shape)
    return FlightRecord(np.arange(n) * DT, ("de", "alpha", "q"), np.hstack([u, y]), "measured", valid=valid)


def test_the_true_model_scores_perfectly():
    omega = np.geomspace(0.1, 200.0, 30)  # reaches beyond the Nyquist frequency of 62.8 rad/s
    result = evaluate(
        model(),
        [record(1), record(2)],
        [record(3)],
        TrueSystem({"short period": POLE}, lambda w: model().frequency_response(np.minimum(w, np.pi / DT)), omega),
    )
    assert np.all(result.identification.mrse_percent < 1e-8)
    assert np.all(result.validation.fit_percent > 100.0 - 1e-8)
    assert result.validation.mrse_mean < 1e-8
    assert [len(s.predictions) for s in (result.identification, result.validation)] == [2, 1]
    assert result.identification.predictions[0].shape == (200, 2)
    (match,) = result.poles
    assert match.name == "short period"
    assert match.outputs == "alpha, q"
    assert abs(match.wn_error_percent) < 1e-8
    assert result.bode.relative_percent == pytest.approx([0.0, 0.0], abs=1e-9)
    assert result.omega_rad_s.max() <= np.pi / DT
    assert result.unstable == ()
    text = " | ".join(result.verdicts)
    assert "validation: MRSE" in text
    assert "all outputs predicted well" in text
    assert "short period (alpha, q): found; wn" in text
    assert "within 1 dB" in text


def test_figures_pool_the_records_of_a_set():
    first, second = record(1, noise=0.3), record(2, noise=0.1)
    both = evaluate(model(), [first, second], [])
    alone = [evaluate(model(), [r], []) for r in (first, second)]
    y = [r.columns(("alpha", "q")) for r in (first, second)]
    size = [np.sum(v**2, axis=0) for v in y]
    error = [(a.identification.mrse_percent / 100.0) ** 2 * s for a, s in zip(alone, size, strict=True)]
    assert both.identification.mrse_percent == pytest.approx(100.0 * np.sqrt(sum(error) / sum(size)))


def test_a_wrong_model_is_told_so():
    result = evaluate(
        model(scale=-1.0),
        [record(1)],
        [record(2)],
        TrueSystem(
            {"short period": POLE, "phugoid": 0.2j},
            model().frequency_response(np.array([1.0, 2.0])),
            np.array([1.0, 2.0]),
        ),
    )
    assert np.all(result.validation.mrse_percent > 100.0)
    text = " | ".join(result.verdicts)
    assert "alpha, q no better than predicting no motion at all" in text
    assert "phugoid (alpha, q): not found; no pole of the model lies near 0.2 rad/s" in text
    assert result.bode.magnitude_db == pytest.approx([0.0, 0.0], abs=1e-9)
    assert result.bode.relative_percent == pytest.approx([200.0, 200.0])


def test_unstable_model_gives_numbers_and_says_so():
    result = evaluate(model(A=np.diag([1.2, 0.9])), [record(1, n=5000)], [record(2)])
    for scores in (result.identification, result.validation):
        assert not np.any(np.isnan(scores.mrse_percent))
    assert any("the model is unstable (poles at 3.65 rad/s)" in v for v in result.verdicts)


def test_an_overflowing_prediction_is_infinite_and_says_so():
    class Overflowing(StateSpaceModel):
        def simulate(self, record):
            growing = np.exp(np.linspace(0.0, 800.0, len(record)))  # beyond 1e308
            return np.column_stack([growing - growing, growing])

    m = model()
    overflowing = Overflowing(**{f.name: getattr(m, f.name) for f in fields(m)})
    result = evaluate(overflowing, [record(1)], [record(2)])
    assert np.array_equal(result.validation.mrse_percent, [np.inf, np.inf])
    assert np.array_equal(result.validation.fit_percent, [-np.inf, -np.inf])
    assert any("prediction of alpha, q diverges" in v for v in result.verdicts)


def test_invalid_samples_do_not_count():
    valid = np.ones((200, 3), bool)
    valid[50:80, 1] = False
    clean = record(1)
    spoilt = FlightRecord(clean.t_s, clean.channels, np.where(valid, clean.data, 7.0), "measured", valid=valid)
    assert np.all(evaluate(model(), [spoilt], []).identification.mrse_percent < 1e-8)


def test_no_validation_is_said_not_hidden():
    result = evaluate(model(), [record(1)], [])
    assert result.validation.predictions == ()
    assert np.all(np.isnan(result.validation.mrse_percent))
    assert "validation: no records, so the prediction of the model is unknown" in result.verdicts
    with pytest.raises(EstimationError, match="identified from, got none"):
        evaluate(model(), [], [record(1)])


def test_wrong_questions_are_refused():
    with pytest.raises(EstimationError, match="needs the frequencies omega"):
        evaluate(model(), [record(1)], [], TrueSystem(response=np.ones((1, 2, 1))))
    with pytest.raises(EstimationError, match=r"shape \(frequencies, outputs, inputs\) = \(1, 2, 1\)"):
        evaluate(model(), [record(1)], [], TrueSystem({}, np.ones((1, 1, 1)), np.array([1.0])))
    with pytest.raises(EstimationError, match="0 such frequencies"):
        evaluate(model(), [record(1)], [], TrueSystem({}, np.ones((1, 2, 1)), np.array([1e3])))


def test_verdicts_follow_the_figures():
    result = evaluate(model(), [record(1)], [record(2)])
    stored = {f.name for f in fields(Evaluation)}
    assert "verdicts" not in stored
    assert len(result.verdicts) == 2


@pytest.mark.parametrize(
    ("true", "found", "words"),
    [
        (-2.0 + 0j, -2.08 + 0j, "slow (q): found; -2.08 1/s (+4 %)"),
        (-2.0 + 0j, -2.0 + 0.3j, "slow (q): found; wn 2.02 rad/s (+1.1 %), zeta off by -0.011"),
        (-2.0 + 0.3j, -2.0 + 0j, "slow (q): found; wn 2 rad/s (-1.1 %), zeta off by +0.011"),
        (-2.0 + 0j, -3.0 + 0j, "slow (q): found, with an error; -3 1/s (+50 %)"),
        (-2.0 + 0j, None, "slow (q): not found; no pole of the model lies near -2 1/s"),
        (0j, 0.001j, "slow (q): not found; no pole of the model lies near 0 rad/s"),
        (0j, 1e-6 + 0j, "slow (q): found at 1e-06 rad/s, true pole at the origin"),
    ],
)
def test_a_pole_is_told_as_a_root_only_beside_a_root(true, found, words):
    (match,) = match_poles([] if found is None else [found], {"slow": true}, "q")
    assert _pole_verdict(match) == words
