"""Derivatives that the data decide and that predict nothing else: said first, with the cause."""

from types import SimpleNamespace

import numpy as np
import pytest

from testbench.core.record import FlightRecord
from testbench.questions.identify.answer import identify_answer
from testbench.questions.identify.ask import identify
from testbench.questions.identify.scenario import RecordDescription
from testbench.questions.identify.unpredicted import _beyond_noise, missed

pytestmark = pytest.mark.usefixtures("plain_and_mended")

RATE = 50.0
DESCRIPTION = """title = "Two records"
source = "simulated here"
rights = "free"
trim_s = 1.5
[time]
column = "t"
[[record]]
name = "fit"
file = "fit.csv"
use = "identification"
[[record]]
name = "kept"
file = "kept.csv"
use = "validation"
{channels}
[preparation]
bias = "trim"
[identification]
inputs = [{inputs}]
outputs = ["alpha", "q"]
[[identification.estimators]]
method = "output_error"
structure = {structure}
"""
UNITS = {"alpha": "rad", "q": "rad/s", "de": "rad", "da": "rad"}


def flown(path, seed, size=0.03, stiffness=-12.0, gust=0.0, offset=0.0, bend=0.0, da=0.0):
    """Write 12 s of a short period with noise: a 3-2-1-1 from 2 s on, and what differs from the first flight."""
    n, fine = round(12.0 * RATE), 10
    t, rng = np.arange(n) / RATE, np.random.default_rng(seed)
    u, at, sign = np.zeros((n, 2)), 2.0, 1.0
    for k in (3, 2, 1, 1):
        inside = (t >= at - 1e-9) & (t < at + 0.3 * k - 1e-9)
        u[inside, 0] = size * sign
        at, sign = at + 0.3 * k, -sign
    u[:, 1] = da * np.sin(2.5 * t) * (t > 2.0)
    x, w, y, h = np.zeros(2), 0.0, np.zeros((n, 2)), 1.0 / RATE / fine
    for k in range(n):
        y[k] = x
        w = 0.95 * w + gust * rng.standard_normal()
        for _ in range(fine):
            alpha = x[0] + w
            force = stiffness * alpha - 6.0 * x[1] - 20.0 * u[k, 0] / (1.0 + bend * u[k, 0] ** 2) + 8.0 * u[k, 1]
            x = x + h * np.array([-2.0 * alpha + 0.8 * x[1] - 0.8 * u[k, 0], force])
    y += np.array([5e-4, 1e-3]) * rng.standard_normal(y.shape)
    y[t > 1.6] += offset
    head = "t,alpha,q,de,da"
    np.savetxt(path, np.column_stack([t, y, u]), delimiter=",", header=head, comments="", fmt="%.7g")


def identified(folder, inputs=("de",), **kept):
    flown(folder / "fit.csv", 1, da=-5e-6 * (len(inputs) - 1))
    flown(folder / "kept.csv", 2, **kept)
    named = "".join(
        f'[[channel]]\nname = "{n}"\ncolumn = "{n}"\nunit = "{u}"\n'
        for n, u in UNITS.items()
        if n != "da" or n in inputs
    )
    structure = '"short_period"' if len(inputs) == 1 else '"longitudinal"\nshort = true\nV_m_s = 20.0'
    text = DESCRIPTION.format(channels=named, inputs=", ".join(f'"{n}"' for n in inputs), structure=structure)
    (folder / "records.toml").write_text(text, encoding="utf-8")
    return identify(RecordDescription.load(folder / "records.toml"))


CAUSES = {
    "another aircraft": ({"stiffness": -30.0}, "fitted to them alone M_alpha would be −30"),
    "gusts": ({"gust": 0.01, "size": 0.004}, "no values of these derivatives reproduce alpha"),
    "beyond where it is linear": (
        {"size": 0.3, "bend": 100.0},
        "de moves by 17 deg in them and by 1.7 deg in the records",
    ),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("cause", CAUSES)
def test_a_model_that_does_not_predict_says_so_first_with_the_cause(tmp_path, cause):
    kept, said = CAUSES[cause]
    found = identified(tmp_path, **kept)
    assert all(d.determined for d in found.derivatives), "or there would be nothing to warn of"
    (failed,) = found.missed
    lines = identify_answer(found)
    assert lines[0].kind == "lead"
    assert lines[0].text.startswith("The model does not predict its validation records: MRSE of ")
    assert lines[1].kind == "wrong"
    assert said in failed.why
    assert lines[2].text.startswith("6 of 6 derivatives determined")
    assert lines[2].kind == "finding"


def test_a_bias_of_the_sensors_in_the_records_kept_back_is_no_fault_of_the_model(tmp_path):
    found = identified(tmp_path, offset=0.08)
    assert found.missed == ()


def test_noise_that_is_most_of_a_small_motion_is_no_fault_of_the_model(tmp_path):
    found = identified(tmp_path, size=0.0006)
    assert np.any(found.cases[0].evaluation.validation.mrse_percent > 50.0)
    assert found.missed == ()


def test_a_control_that_rested_before_is_named(tmp_path):
    kept = {"da": 0.1, "size": 0.01}
    found = identified(tmp_path, ("de", "da"), **kept)
    assert "da moves in them and rests in the records of the fit" in found.missed[0].why


def test_a_model_that_predicts_says_nothing(tmp_path):
    found = identified(tmp_path)
    assert found.missed == ()
    assert identify_answer(found)[0].text.startswith("6 of 6 derivatives determined")


def test_a_record_in_which_nothing_moves_tests_nothing(tmp_path):
    found = identified(tmp_path, size=0.0)
    (case,) = found.cases
    assert case.evaluation.validation.mrse_mean > 50.0
    assert case.evaluation.untested == ("alpha", "q")
    assert found.missed == ()
    verdict = case.evaluation.verdicts[1]
    assert "alpha, q err there no more than in the fit, and move too little to test it" in verdict
    assert "no better than" not in verdict
    assert any("no control moves in the held-out records" in note for note in found.notes)


def test_a_model_of_which_nothing_is_decided_says_that_first(tmp_path):
    found = identified(tmp_path, stiffness=-30.0)
    assert [m.case for m in found.missed] == [0]
    assert missed(found.cases, ["de"], decided=()) == ()


def test_gusts_that_the_filter_counts_on_are_not_held_against_its_derivatives(tmp_path):
    found = identified(tmp_path, gust=0.01, size=0.004)
    assert [m.case for m in found.missed] == [0], "output error leaves gusts out"
    flown(tmp_path / "fit.csv", 1, gust=0.01, size=0.004)
    file = tmp_path / "records.toml"
    file.write_text(file.read_text("utf-8").replace("output_error", "filter_error"), "utf-8")
    found = identify(RecordDescription.load(file))
    (case,) = found.cases
    assert case.model.settings["process_noise"]
    assert max(case.evaluation.validation.mrse_percent) > 50.0
    assert found.missed == ()


def test_white_noise_beside_a_slow_error_is_taken_out():
    n, rng = 2000, np.random.default_rng(0)
    t = np.arange(n) / RATE
    slow, white = 0.3 * np.sin(0.5 * t), rng.standard_normal(n)
    record = FlightRecord(t, ("V",), (slow + white)[:, None], "measured")
    rms = np.array([np.sqrt(np.mean((slow + white) ** 2))])
    scores = SimpleNamespace(mrse_percent=np.array([100.0]), rms_error=rms, predictions=[np.zeros((n, 1))])
    case = SimpleNamespace(
        evaluation=SimpleNamespace(validation=scores), model=SimpleNamespace(outputs=("V",)), validation=[record]
    )
    share = np.std(slow) / rms[0]
    assert 100.0 * share - 10.0 < _beyond_noise(case)[0] < 100.0 * share + 10.0
