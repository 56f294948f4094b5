"""Flights in which nothing was designed: an autopilot steers through gusts, and what excitation there is is used."""

import numpy as np
import pytest

from testbench.questions.identify.ask import identify
from testbench.questions.identify.scenario import RecordDescription
from testbench.questions.importing.ask import MOST_WINDOWS, WINDOW_S, import_log, write_import
from testbench.questions.importing.page import import_answer
from testbench.questions.importing.recipe import propose

Z_ALPHA, M_ALPHA, M_Q, M_DE, V, LAG_S = -2.0, -12.0, -2.5, -15.0, 18.0, 0.04
TRUTH = {"Z_alpha": V * Z_ALPHA, "M_alpha": M_ALPHA, "M_q": M_Q, "M_de": M_DE, "tau_de": LAG_S}


def steered(path, duration_s=90.0, gust_m_s=0.6, seed=1):
    """A table of a short period under pitch feedback, in gusts of first order, with white noise, at 50 Hz."""
    rng = np.random.default_rng(seed)
    dt, each = 0.01, 2
    A = np.array([[Z_ALPHA, 1.0, 0.0], [M_ALPHA, M_Q, 0.0], [0.0, 1.0, 0.0]])
    drawn = rng.standard_normal((round(duration_s / dt), 3))
    x, u, de, gust, wanted, rows = np.zeros(3), 0.0, 0.0, 0.0, 0.0, []
    for k, (a, b, c) in enumerate(drawn.tolist()):
        if k % 200 == 0:
            wanted = np.radians(4.0) * a
        if k % each == 0:
            u = -0.8 * (wanted - x[2] - 0.002 * b) + 0.15 * (x[1] + 0.0035 * c)
            rows.append((k * dt, u, x[0] + gust / V, x[1], x[2]))
        for _ in range(2):
            half = 0.5 * dt
            de += half / LAG_S * (u - de)
            x = x + half * (A @ (x + np.array([gust / V, 0.0, 0.0])) + np.array([0.0, M_DE * de, 0.0]))
        gust += -gust * V / 30.0 * dt + gust_m_s * np.sqrt(2.0 * V / 30.0 * dt) * a
    table = np.array(rows)
    table[:, 2:] += (0.0017, 0.0035, 0.0017) * rng.standard_normal((len(table), 3))
    table = np.column_stack([table, V + 0.2 * rng.standard_normal(len(table))])
    head = "t [s],elevator command [rad],alpha [rad],q [rad/s],theta [rad],V [m/s]"
    np.savetxt(path, table, "%.6f", ",", header=head, comments="")
    return path


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return import_log(steered(tmp_path_factory.mktemp("steered") / "f.csv"))


def test_a_flight_without_designed_inputs_is_cut_in_windows_of_the_most_excitation(found):
    assert not any(m.cut_s for m in found.search.manoeuvres)
    assert found.fed_back == "de_cmd moves most of the time"
    ((axis, own),) = found.members.items()
    assert axis == "whole"
    assert len(own) == min(MOST_WINDOWS, int(90.0 / WINDOW_S))
    starts = [record.provenance["cut_from_record_s"][0] for _, record in own.values()]
    assert starts == sorted(starts)
    assert any("identified by filter error" in text for _, text in import_answer(found))


def test_controls_that_answer_the_motion_are_identified_by_filter_error_and_noise_is_no_state(found, tmp_path):
    """An airspeed that is nothing but noise had equations of its own, and made all others unknown."""
    (path,) = (p for p in write_import(found, tmp_path) if p.suffix == ".toml")
    text = path.read_text(encoding="utf-8")
    assert 'method = "filter_error"\nprocess_noise = ["alpha"]' in text
    assert 'outputs = ["alpha", "q"]' in text
    records = [record for _, record in found.members["whole"].values()]
    assert propose(["de_cmd"], records, 50.0).estimators[0][1]["method"] == "output_error"


@pytest.mark.slow
def test_derivatives_of_a_steered_flight_in_gusts_are_right_within_their_errors(found, tmp_path):
    (path,) = (p for p in write_import(found, tmp_path) if p.suffix == ".toml")
    derivatives = {d.name: d for d in identify(RecordDescription.load(path)).derivatives}
    for name, value in TRUTH.items():
        assert abs(derivatives[name].value - value) < 3.0 * derivatives[name].std, name
    assert derivatives["M_de"].determined


def test_a_surface_that_jumps_within_a_sample_is_said_to_be_a_command(tmp_path):
    t = np.arange(0.0, 20.0, 0.02)
    steps = np.radians(3.0) * (1.0 * ((t >= 5.0) & (t < 6.0)) - 1.0 * ((t >= 6.0) & (t < 7.0)))
    smooth = np.convolve(steps, np.exp(-np.arange(20) / 5.0), mode="full")[: t.size] * (1.0 - np.exp(-0.2))
    for name, de, jumps in (("command", steps, 1), ("surface", smooth, 0)):
        table = np.column_stack([t, de, 0.1 * np.sin(t)])
        path = tmp_path / f"{name}.csv"
        np.savetxt(path, table, "%.6f", ",", header="t [s],elevator [rad],q [rad/s]", comments="")
        said = [text for _, text in import_answer(import_log(path)) if text.startswith("a command? ")]
        assert len(said) == jumps, name
    assert "jumps by 6 deg within a sample (300 deg/s)" in import_log(tmp_path / "command.csv").jumps[0]
