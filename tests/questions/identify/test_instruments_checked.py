"""What identify does where kinematics contradict an instrument: nothing is determined, nothing is amended unseen."""

import numpy as np
import pytest
from changed_flights import LONGITUDINAL, changed_aircraft, described, flown, steps
from plain_fits import plain_fits
from typer.testing import CliRunner

from testbench.cli import app
from testbench.core.errors import EstimationError, ScenarioError
from testbench.questions.identify.amend.ask import amend
from testbench.questions.identify.answer import identify_answer
from testbench.questions.identify.ask import identify
from testbench.questions.identify.scenario import RecordDescription

pytestmark = pytest.mark.usefixtures("plain_fits")

V, H, SCALE = 15.0, 100.0, 0.85
NOISE = {"V": 0.05, "alpha": 0.05, "q": 0.1, "theta": 0.05, "az": 0.05, "h": 0.1}
FACTORS = {"Cm_q": 0.6, "Cm_alpha": 1.25}


def written(folder, gyro):
    """Return the description of two flights whose pitch-rate gyro has a scale."""
    truth = changed_aircraft("taurus", FACTORS)
    flights = [flown(truth, V, H, {"de": steps(1.0, 0.24, 0.5)}, 6.0)]
    flights.append(flown(truth, V, H, {"de": steps(1.0, 0.4, 0.5, (1, 1))}, 6.0))
    flights = [f.with_columns({"q": gyro * f["q"]}) for f in flights]
    outputs = ["V", "alpha", "q", "theta", "az"]
    file = described(folder, "pitch", flights, "taurus", ["de"], outputs, LONGITUDINAL, NOISE)
    text = file.read_text(encoding="utf-8").replace(', "theta", "az"]', ', "theta"]')
    file.write_text(text, encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return written(tmp_path_factory.mktemp("flights"), SCALE)


@pytest.fixture(scope="module", params=[True, pytest.param(False, marks=pytest.mark.slow)], ids=["plain", "mended"])
def found(request, file):
    with plain_fits(request.param):
        return identify(RecordDescription.load(file))


def test_the_first_line_names_the_instrument_and_nothing_is_determined(found):
    assert identify_answer(found)[0].text.startswith("Kinematics show that the pitch-rate gyro reads")
    assert found.instruments.fault.name == "q_scale"
    assert abs(found.instruments.fault.estimate - (SCALE - 1.0)) < 4.0 * found.instruments.fault.std
    assert not any(d.determined for d in found.derivatives)
    assert {d.believed for d in found.derivatives} >= {"q contradicted"}


def test_the_estimate_without_the_error_stands_beside_and_is_that_of_a_sound_gyro(found, tmp_path):
    sound = identify(RecordDescription.load(written(tmp_path, 1.0)))
    assert (sound.contradicted, sound.corrected) == ("", ())
    was, now, true = ({d.name: d for d in x} for x in (found.derivatives, found.corrected, sound.derivatives))
    for name in ("M_de", "M_alpha"):
        assert abs(now[name].value - true[name].value) < 3.0 * now[name].std, name
        assert abs(was[name].value - true[name].value) > 0.1 * abs(true[name].value), name
        assert now[name].determined, name
        assert now[name].std > now[name].stated  # the error of the correction is in it
    assert "After correction of the records (q_scale" in identify_answer(found)[1].text


def test_nothing_is_amended_until_the_error_is_taken_out(found, file, tmp_path):
    with pytest.raises(EstimationError, match=r"pitch-rate gyro reads .*correct = \{ q_scale = -0\.1"):
        amend([found], str(tmp_path / "mine"))
    assert not (tmp_path / "mine").exists()
    size = found.instruments.fault.estimate
    file = file.with_name("mended.toml")
    text = file.with_name("pitch.toml").read_text(encoding="utf-8")
    file.write_text(f"correct = {{ q_scale = {size:.4g} }}\n{text}", encoding="utf-8")
    mended = identify(RecordDescription.load(file))
    assert mended.contradicted == ""
    assert np.isclose(
        mended.flights[0].measured["recorded"].provenance["corrected"]["errors"]["q_scale"], 1.0 + size, 1e-3
    )
    made = amend([mended], str(tmp_path / "mine"))["mended"]
    assert "M_de" in {a.name for a in made.aims}


def test_a_correction_of_no_channel_is_refused(file):
    with pytest.raises(ScenarioError, match=r"correct.gyro: must be CHANNEL_KIND"):
        RecordDescription.load(_with(file, "correct = { gyro = 0.1 }"))


def _with(file, line):
    other = file.with_name("other.toml")
    other.write_text(f"{line}\n{file.read_text(encoding='utf-8')}", encoding="utf-8")
    return other


def test_compatibility_takes_a_log_and_says_what_to_look_at(tmp_path):
    truth = changed_aircraft("taurus", FACTORS)
    f = flown(truth, V, H, {"de": steps(4.0, 0.24, 1.0)}, 12.0)
    rng, names = np.random.default_rng(2), ["V", "alpha", "q", "theta", "az"]
    units = {"V": "m/s", "az": "m/s2", "q": "rad/s"}
    noise = {"V": 0.05, "alpha": 1e-3, "q": 2e-3, "theta": 1e-3, "az": 0.05}
    columns = [f[c] * (SCALE if c == "q" else 1.0) + noise[c] * rng.standard_normal(len(f)) for c in names]
    head = ",".join(["time [s]", "de [rad]", *(f"{c} [{units.get(c, 'rad')}]" for c in names)])
    np.savetxt(
        tmp_path / "log.csv", np.column_stack([f.t_s, f["de"], *columns])[::2], "%.8g", ",", header=head, comments=""
    )
    done = CliRunner().invoke(app, ["compatibility", str(tmp_path / "log.csv"), "-o", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    said = " ".join(done.output.split())
    assert "Kinematics show that the pitch-rate gyro reads" in said
    assert "To decide:" in said
