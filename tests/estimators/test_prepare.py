"""prepare: gaps, bias, filter, decimation."""

import numpy as np
import pytest

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators.prepare import prepare

T = np.arange(0.0, 20.0, 0.02)


def record(q, de=None, valid=None, t=T):
    de = np.sin(t) if de is None else de
    return FlightRecord(t, ("q", "de"), np.column_stack([q, de]), "measured", valid=valid, provenance={"seed": 3})


def test_trim_mean_and_trend_remove_what_they_say():
    q = 2.0 + 0.5 * T + np.where(T < 5.0, 0.0, np.sin(T - 5.0))
    trim = prepare(record(q), bias="trim", trim_s=2.0)
    assert trim["q"][:100].mean() == pytest.approx(0.0, abs=1e-12)
    assert np.allclose(trim["q"], q - q[:100].mean(), atol=1e-12)
    assert prepare(record(q), bias="mean", trim_s=0.0)["q"].mean() == pytest.approx(0.0, abs=1e-12)
    assert np.abs(prepare(record(2.0 + 0.5 * T), bias="trend", trim_s=0.0)["q"]).max() < 1e-12
    assert np.array_equal(prepare(record(q), bias="none", trim_s=0.0)["q"], q)
    assert trim.provenance["prepared"]["bias"] == "trim"
    assert trim.provenance["prepared"]["removed"]["q"] == pytest.approx(q[:100].mean())
    assert trim.provenance["seed"] == 3
    assert trim.kind == "measured"


def test_gaps_are_interpolated_and_stay_marked():
    q = 3.0 + 0.1 * T
    valid = np.ones((T.size, 2), bool)
    valid[100:140, 0] = False
    valid[-5:, 0] = False
    valid[7::10, 0] = False
    spoilt = np.where(valid[:, 0], q, 99.0)
    out = prepare(record(spoilt, valid=valid), bias="none", trim_s=0.0)
    assert np.allclose(out["q"][:-5], q[:-5], atol=1e-12)
    assert np.allclose(out["q"][-5:], q[-6], atol=1e-12)  # held beyond the last valid sample
    assert np.array_equal(out.valid, valid)
    # the bias comes from samples that were taken
    out = prepare(record(np.where(valid[:, 0], 1.0, 99.0), valid=valid), bias="trim", trim_s=3.0)
    assert np.abs(out["q"]).max() < 1e-12


def test_lowpass_has_no_phase_and_treats_all_channels_alike():
    slow, fast = np.sin(2 * np.pi * 0.5 * T), np.sin(2 * np.pi * 15.0 * T)
    out = prepare(record(slow + fast, de=slow + fast), bias="none", trim_s=0.0, lowpass_hz=5.0)
    inside = slice(100, -100)  # away from the ends
    # gain of the filter run twice: 1 / (1 + tan-warped (f/fc)^8), below 1e-3 off at 0.5 Hz and above 5 Hz at 15 Hz
    assert np.abs(out["q"] - slow)[inside].max() < 1e-3
    assert np.array_equal(out["q"], out["de"])
    assert prepare(record(np.ones(T.size)), bias="none", trim_s=0.0, lowpass_hz=5.0)["q"] == pytest.approx(
        1.0, abs=1e-9
    )
    half = prepare(record(np.sin(2 * np.pi * 5.0 * T)), bias="none", trim_s=0.0, lowpass_hz=5.0)["q"]
    assert np.std(half[inside]) == pytest.approx(0.5 / np.sqrt(2.0), rel=0.01)  # -6 dB at the cut-off


def test_decimation_keeps_every_so_many_samples():
    out = prepare(record(T), bias="none", trim_s=0.0, decimate=5)
    assert out.dt_s == pytest.approx(0.1)
    assert np.array_equal(out["q"], T[::5])


def test_refusals_say_law_value_and_fix():
    with pytest.raises(EstimationError, match=r"at least 2 valid samples of channel 'q'.*trim_s = 0.01 s.*got 1"):
        prepare(record(T), bias="trim", trim_s=0.01)
    with pytest.raises(EstimationError, match="Nyquist frequency = 25 Hz"):
        prepare(record(T), bias="none", trim_s=0.0, lowpass_hz=25.0)
    with pytest.raises(EstimationError, match="more than 15 samples, got 10"):
        prepare(record(np.ones(10), t=T[:10]), bias="none", trim_s=0.0, lowpass_hz=5.0)
    with pytest.raises(EstimationError, match="decimate >= 1"):
        prepare(record(T), bias="none", trim_s=0.0, decimate=0)
    valid = np.ones((T.size, 2), bool)
    valid[:, 0] = False
    with pytest.raises(EstimationError, match="channel 'q' must hold at least one valid sample"):
        prepare(record(T, valid=valid), bias="none", trim_s=0.0)
