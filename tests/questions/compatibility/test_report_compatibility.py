"""The report on the compatibility of recorded data: answer, tables, figure, corrected records, page."""

import io

import numpy as np
import pytest
from rich.console import Console

from testbench.core.record import FlightRecord, load_record
from testbench.flight import Manoeuvre, fly
from testbench.inputs.signal import InputSignal
from testbench.questions.compatibility.answer import compatibility_answer
from testbench.questions.compatibility.ask import compatibility
from testbench.questions.compatibility.page import compatibility_page, error_tables
from testbench.questions.identify.scenario import RecordDescription

pytestmark = pytest.mark.drawn

CHANNELS = {"V": 0.05, "alpha": 0.002, "theta": 0.002, "q": 0.002, "ax": 0.02, "az": 0.02}
GYRO_BIAS, GRAVITY_M_S2 = 0.02, 9.7803


@pytest.fixture(scope="module")
def flights(taurus, taurus_trim):
    n = 3000
    u = np.zeros((n, 1))
    for start in (200, 1000, 1800):
        u[start : start + 100], u[start + 100 : start + 200] = 0.05, -0.05
    rate = taurus_trim.rate_hz
    truth = fly(taurus, taurus_trim, Manoeuvre("doublets", InputSignal(np.arange(n) / rate, u, ("de",)), 0.0), 40.0)
    noise = np.random.default_rng(3).standard_normal((len(truth), len(CHANNELS))) * list(CHANNELS.values())
    data = truth.columns(CHANNELS) + noise
    data[:, list(CHANNELS).index("q")] += GYRO_BIAS
    return {"doublets": FlightRecord(truth.t_s, tuple(CHANNELS), data, "measured")}


@pytest.fixture(scope="module")
def result(flights):
    return compatibility(list(flights.values()), GRAVITY_M_S2)


def test_the_answer_names_the_error(result):
    assert list(result.every.found) == ["q_bias"]
    size, std = result.every.found["q_bias"]
    assert size == pytest.approx(GYRO_BIAS, abs=4.0 * std)
    assert std < 0.01 * GYRO_BIAS
    lines = compatibility_answer(result)
    assert lines[0].text.startswith("With all errors estimated at once, the pitch-rate gyro reads 1.1")
    assert lines[0].text.endswith("deg/s too much.")
    assert lines[1].text.startswith("Kinematics do not contradict")
    table = error_tables(result.every)[0]
    assert {row[0] for row in table.rows if row[4]} == {"q_bias"}
    before, after = result.every.rms("theta")
    assert after < 0.1 * before


def test_gravity_taken_wrong_is_a_small_bias_and_is_said(flights):
    lines = compatibility_answer(compatibility(list(flights.values()), GRAVITY_M_S2 + 0.03))
    assert any(line.kind == "note" and "az_bias may be gravity: 9.8103 m/s² was assumed" in line.text for line in lines)


def test_files_and_page(result, flights, tmp_path):
    described = RecordDescription.load("attas_short_period")
    paths = compatibility_page(result, flights, described).write(tmp_path)
    assert paths[-1].name == "report.html"
    assert {"instrument_errors.csv", "residuals.csv", "rebuilt.png", "doublets_corrected.nc"} <= {p.name for p in paths}
    page = paths[-1].read_text(encoding="utf-8")
    assert "pitch-rate gyro reads 1.1" in page
    assert 'src="http' not in page
    corrected = load_record(tmp_path / "records" / "doublets_corrected.nc")
    removed = flights["doublets"]["q"] - corrected["q"]
    assert np.allclose(removed, result.every.sizes["q_bias"], atol=1e-12)


def test_the_terminal_shows_the_errors(result, flights, tmp_path):
    stream = io.StringIO()
    page = compatibility_page(result, flights, RecordDescription.load("attas_short_period"))
    page.show(Console(file=stream, width=100), tmp_path)
    text = stream.getvalue()
    assert "pitch-rate gyro" in text
    assert "report.html" in text
