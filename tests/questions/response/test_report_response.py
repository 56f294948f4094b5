"""The report on measured frequency responses: where they can be believed, table, figures, page."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from testbench.core.record import FlightRecord
from testbench.estimators.frequency.response import estimate_frequency_response
from testbench.page.labels import number
from testbench.questions.identify.scenario import RecordDescription
from testbench.questions.response.answer import response_answer
from testbench.questions.response.page import response_page, response_table

pytestmark = pytest.mark.drawn


@pytest.fixture(scope="module")
def response():
    rng = np.random.default_rng(0)
    u = 0.02 * rng.standard_normal(6000)
    y = lfilter([0.0, 0.1], [1.0, -0.9], u)
    noise = np.stack([1e-4, 1.0] * rng.standard_normal((6000, 2)), axis=0)
    data = np.column_stack([u, y + noise[:, 0], noise[:, 1]])
    record = FlightRecord(np.arange(6000) * 0.02, ("de", "q", "alpha"), data, "measured")
    return estimate_frequency_response([record], ["de"], ["q", "alpha"], window_s=[2.0, 8.0])


def test_the_answer_says_where_each_output_is_coherent(response):
    coherent, noise = response_answer(response)[:2]
    assert coherent.startswith("q: usable (coherence of at least 0.6, error of at most 20 %) from")
    assert noise.startswith("α: nowhere coherent") or "random error" in noise


def test_the_band_that_is_named_spans_the_most_octaves(response):
    w = response.omega_rad_s
    coherence = np.array(response.coherence)
    coherence[:, 0] = np.where((w < 10.0) | (w > 20.0), 0.9, 0.1)  # more lines above, more octaves below
    assert np.sum(w > 20.0) > np.sum(w < 10.0)
    first = response_answer(replace(response, coherence=coherence))[0]
    low, high = w[0], w[w < 10.0][-1]
    assert f"from {number(float(low))} to {number(float(high))} rad/s" in first


def test_the_table_holds_the_response(response):
    table = response_table(response)
    assert len(table.rows) == 2 * response.omega_rad_s.size
    first = table.rows[0]
    assert first[2] == pytest.approx(abs(response.H[0, 0, 0]))


def test_files(response, tmp_path):
    paths = response_page(response, RecordDescription.load("attas_short_period")).write(tmp_path)
    assert {"frequency_response.csv", "response_q_de.png", "response_alpha_de.png", "report.html"} <= {
        p.name for p in paths
    }
