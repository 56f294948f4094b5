"""Output error on recorded flights against results printed in Jategaonkar, Flight Vehicle System Identification."""

import os
from pathlib import Path

import numpy as np
import pytest
from parametric_cases import ATTAS_RATES, ATTAS_SHORT_PERIOD, FILTER_ERROR_HFB, HFB

from testbench.core.constants import DEG_RAD
from testbench.core.record import FlightRecord
from testbench.estimators.parametric import output_error
from testbench.estimators.parametric.structures import aerodynamic_longitudinal, roll_yaw_rates, short_period
from testbench.estimators.settings import OutputError
from testbench.logs.layout import ENVIRONMENT

FOLDER = Path(os.environ.get(ENVIRONMENT) or Path(__file__).resolve().parents[4] / "shared" / "flight_data")


def need(file: str) -> Path:
    if not (FOLDER / file).is_file():
        pytest.skip(f"recorded flight '{file}' is missing in '{FOLDER}'; set {ENVIRONMENT} to its folder")
    return FOLDER / file


def attas(name: str) -> np.ndarray:
    from scipy.io import loadmat

    content = loadmat(need(f"attas/fAttas{name}.mat"))
    return next(value for key, value in content.items() if not key.startswith("__"))


def short_period_records() -> list[FlightRecord]:
    out = []
    for name in ("Elv1", "Elv2"):
        k = attas(name)
        data = DEG_RAD * k[:, [12, 7, 21]]
        out.append(FlightRecord(0.04 * np.arange(len(k)), ("alpha", "q", "de"), data, "measured"))
    return out


def lateral_records(whole: bool) -> list[FlightRecord]:
    """Two runs; each is two flights of 30 s glued together, which are one record only if ``whole``."""
    out = []
    for name in ("AilRud1", "AilRud2"):
        k = attas(name)
        joint = np.flatnonzero(np.abs(np.diff(k[:, 0]) - 0.04) > 0.02) + 1
        for part in [k] if whole else np.split(k, joint):
            da = 0.5 * (part[:, 28] - part[:, 27])
            data = DEG_RAD * np.column_stack([part[:, 6], part[:, 8], da, part[:, 29], part[:, 13]])
            t = 0.04 * np.arange(len(part))
            out.append(FlightRecord(t, ("p", "r", "da", "dr", "beta"), data, "measured"))
    return out


def test_attas_short_period_is_the_printed_one():
    model = output_error.estimate(short_period_records(), short_period())
    for name, printed in ATTAS_SHORT_PERIOD.items():
        assert model.values[name] == pytest.approx(printed, rel=0.01), name
    (mode,) = model.modes()
    assert mode.wn_rad_s == pytest.approx(2.53, rel=0.01)
    assert mode.zeta == pytest.approx(0.493, rel=0.01)


def test_attas_lateral_derivatives_are_the_printed_ones():
    """Printed with each run as one record, its initial state from the first sample, in spite of the joint: so here."""
    model = output_error.estimate(lateral_records(whole=True), roll_yaw_rates(), OutputError(initial_states="record"))
    for name, printed in ATTAS_RATES.items():
        assert model.values[name] == pytest.approx(printed, rel=0.005), name


def test_attas_lateral_derivatives_of_the_four_flights_apart_agree_within_their_errors():
    model = output_error.estimate(lateral_records(whole=False), roll_yaw_rates())
    # the same data but for the joint: one standard error is far more than that can move an estimate
    for name, printed in ATTAS_RATES.items():
        assert abs(model.values[name] - printed) < model.standard_errors[name], name


def test_errors_of_attas_derivatives_are_corrected_for_coloured_residuals():
    model = output_error.estimate(short_period_records(), short_period())
    assert model.status != "good"
    assert any("not white" in sentence for sentence in model.advice)
    # each of the two runs alone: two samples of the same aircraft
    apart = [output_error.estimate([record], short_period()) for record in short_period_records()]
    free = [name for name in ATTAS_SHORT_PERIOD if not name.endswith("_0")]  # trims of the runs differ
    difference = np.array([apart[0].values[n] - apart[1].values[n] for n in free])
    corrected = np.array([np.hypot(*(m.standard_errors[n] for m in apart)) for n in free])
    index = [list(ATTAS_SHORT_PERIOD).index(n) for n in free]
    white = np.array([np.hypot(*(np.sqrt(m.covariance_plain[i, i]) for m in apart)) for i in index])
    assert np.sqrt(np.mean((difference / white) ** 2)) > 2.0
    # six correlated deviations: with true standard errors their root mean square passes 2 once in 1e4 were they free
    assert np.sqrt(np.mean((difference / corrected) ** 2)) < 2.0


def hfb() -> FlightRecord:
    k = np.loadtxt(need("hfb320/hfb320_1_10.asc"))
    channels = ("V", "alpha", "theta", "q", "qdot", "ax", "az", "de", "thrust")
    return FlightRecord(0.1 * np.arange(len(k)), channels, k[:, [4, 5, 6, 7, 8, 9, 10, 1, 3]], "measured")


@pytest.mark.slow
def test_hfb_320_in_turbulence_is_biased_as_printed_for_output_error():
    model = output_error.estimate([hfb()], aerodynamic_longitudinal(HFB))
    # printed to three figures ("about"): 1 %
    for name, printed in {"CL_alpha": 3.34, "CD_alpha": 0.245, "Cm_q": -26.8}.items():
        assert model.values[name] == pytest.approx(printed, rel=0.01), name
        # and far from what an estimator that knows of the turbulence finds
        assert abs(model.values[name] - FILTER_ERROR_HFB[name]) > 0.2 * abs(FILTER_ERROR_HFB[name])
    assert model.status != "good"
    assert any("turbulence" in sentence for sentence in model.advice)
