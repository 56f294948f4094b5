"""Real-time regression: it ends at the derivatives, follows a change, and its errors are the scatter."""

import numpy as np
import pytest

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators.contract import STRUCTURE, flight
from testbench.estimators.parametric.recursive_fourier import estimate
from testbench.estimators.parametric.structures import short_period
from testbench.estimators.settings import RecursiveFourier

BAND = (0.05, 0.8)
TRUE = {"M_alpha": -8.0, "M_q": -3.0, "M_de": -12.0, "Z_alpha": -1.5, "Z_q": 1.0, "Z_de": -0.1}


def smooth(n=2000, dt=0.01, change=1.0):
    """A record of the short period that is exact: a steady periodic answer; the elevator loses power half way."""
    structure = short_period()
    params = np.array([TRUE.get(p.name, 0.0) for p in structure.parameters])
    m = structure.matrices(params)
    t, x, u = np.arange(n) * dt, np.zeros((n, 2)), np.zeros(n)
    for line, phase in ((2, 0.0), (5, 1.0), (9, 2.5), (14, 0.4)):
        w = 2.0 * np.pi * line / 10.0
        X = np.linalg.solve(1j * w * np.eye(2) - m.A, m.B[:, 0])
        u += 0.02 * np.cos(w * t + phase)
        x += 0.02 * np.real(np.exp(1j * (w * t + phase))[:, None] * X)
    u = np.where(t < 10.0, u, u / change)
    return FlightRecord(t, (*structure.states, "de"), np.column_stack([x, u]), "measured"), structure


def test_exact_data_give_the_derivatives_at_every_update():
    record, structure = smooth()
    model = estimate([record], structure, RecursiveFourier(band_hz=(0.15, 1.5), held=()))
    for name, value in TRUE.items():
        assert model.values[name] == pytest.approx(value, rel=5e-3, abs=2e-3), name  # measured at most 1e-3
    history = model.diagnostics["history"]
    assert history["t_s"][-1] == pytest.approx(19.99)
    assert np.allclose(np.diff(history["t_s"]), 1.0)
    assert np.array_equal(history["params"][-1], [model.values[n] for n in history["names"]])
    true = np.array([TRUE.get(n, 0.0) for n in history["names"]])
    late = history["t_s"] > 5.0
    assert np.allclose(history["params"][late], true, rtol=2e-2, atol=2e-2)


def test_bias_and_drift_of_the_sensors_do_not_matter():
    record, structure = smooth()
    t = record.t_s
    shifted = record.with_columns({"q": record["q"] + 0.05, "alpha": record["alpha"] + 0.02, "de": record["de"] - 0.03})
    one, other = (estimate([r], structure, RecursiveFourier(band_hz=(0.15, 1.5), held=())) for r in (record, shifted))
    for name in TRUE:
        assert other.values[name] == pytest.approx(one.values[name], rel=1e-6, abs=1e-8), name
    assert t.size == 2000


def test_forgetting_follows_a_change():
    record, structure = smooth(4000, change=0.5)  # from 10 s on twice the elevator does what the elevator did
    kept = estimate([record], structure, RecursiveFourier(band_hz=(0.15, 1.5), held=()))
    fading = estimate([record], structure, RecursiveFourier(band_hz=(0.15, 1.5), held=(), forgetting=0.997))
    assert fading.values["M_de"] == pytest.approx(0.5 * TRUE["M_de"], rel=0.02)
    assert abs(kept.values["M_de"] - 0.5 * TRUE["M_de"]) > 5.0 * abs(fading.values["M_de"] - 0.5 * TRUE["M_de"])
    history = fading.diagnostics["history"]
    at = history["names"].index("M_de")
    before = history["params"][np.searchsorted(history["t_s"], 9.0), at]
    assert before == pytest.approx(TRUE["M_de"], rel=0.02)


def test_errors_are_the_scatter():
    found, stated = [], []
    for seed in range(40):
        records = [flight(100 + 10 * seed + i, n, 0.05) for i, n in enumerate((300, 200))]
        model = estimate(records, STRUCTURE, RecursiveFourier(band_hz=BAND, held=("de",)))
        names = [n for n, e in model.standard_errors.items() if e > 0.0 and not n.endswith("_0")]
        found.append([model.values[n] for n in names])
        stated.append([model.standard_errors[n] for n in names])
    ratio = np.std(found, axis=0, ddof=1) / np.sqrt(np.mean(np.square(stated), axis=0))
    # A standard deviation of 40 seeds is known to 11 %. Measured 1.01 to 1.30: the motion between samples of 0.1 s is
    # taken for a straight line, which errs by the input, and differs from seed to seed.
    assert np.all((ratio > 0.5) & (ratio < 1.6)), dict(zip(names, ratio, strict=True))


def test_errors_shrink_as_data_come_in_and_records_are_remembered():
    model = estimate(
        [flight(1, 300, 0.05), flight(2, 300, 0.05)],
        STRUCTURE,
        RecursiveFourier(band_hz=BAND, held=("de",), update_s=5.0),
    )
    history = model.diagnostics["history"]
    assert set(history["record"]) == {0, 1}
    first, last = (np.median(history["std"][history["record"] == r], axis=0) for r in (0, 1))
    assert np.median(last / first) < 0.9


def test_what_cannot_be_done_is_refused():
    record = flight(1, 300)
    with pytest.raises(EstimationError, match="band_hz: low < high must hold"):
        estimate([record], STRUCTURE, RecursiveFourier(band_hz=(1.0, 0.5)))
    with pytest.raises(EstimationError, match="update_s >= the sample time"):
        estimate([record], STRUCTURE, RecursiveFourier(band_hz=BAND, update_s=0.01))
    with pytest.raises(EstimationError, match="never determine"):
        estimate([record], STRUCTURE, RecursiveFourier(band_hz=BAND, held=("de",), forgetting=0.5))
