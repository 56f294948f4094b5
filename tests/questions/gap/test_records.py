"""Records of a user: what they must hold, what is taken from them, and what is said where they do not do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_flights import believe, measure

from testbench.core.errors import RecordError, ScenarioError
from testbench.questions.gap.records import Said, load_flights
from testbench.sensors import load_suite, suite_toml


@pytest.fixture(scope="module")
def flown():
    return measure(believe(), 3, duration_s=6.0)


@pytest.fixture
def files(flown, tmp_path):
    out = []
    for name, record in zip("ab", flown, strict=True):
        record.save(tmp_path / f"{name}.nc")
        out.append(tmp_path / f"{name}.nc")
    return out


def test_suite_and_condition_are_taken_from_the_records(files):
    flights = load_flights("eolo", files, wings="rigid")
    assert (list(flights.naming), list(flights.held_out)) == (["a"], ["b"])
    assert flights.believed.suite.name == "eolo_gap"
    # 400 samples with a noise of 0.2 m/s: five standard errors; the pitot's believed bias of 0.3 m/s is taken out.
    assert flights.believed.condition.V_m_s == pytest.approx(16.0, abs=0.05)
    assert flights.believed.condition.h_m == 547.0
    assert flights.believed.rate_hz == 500.0
    notes = " ".join(flights.notes)
    for words in ("the last record, 'b'", "eolo_gap", "design altitude, 547 m", "quiet flight"):
        assert words in notes


def test_what_is_held_out_may_be_among_the_records(files):
    flights = load_flights("eolo", files, [files[0]], Said(V_m_s=16.0, h_m=500.0))
    assert (list(flights.naming), list(flights.held_out)) == (["b"], ["a"])
    assert (flights.believed.condition.V_m_s, flights.believed.condition.h_m) == (16.0, 500.0)


def test_one_record_alone_names_and_says_that_nothing_judges(files):
    flights = load_flights("eolo", files[:1])
    assert not flights.held_out
    assert any("no record is held out" in note for note in flights.notes)


def test_records_of_a_description_are_used_as_it_says(files, tmp_path):
    units = {"V": "m/s", "az": "m/s2", "q": "rad/s", "thr_cmd": "1"}
    channels = "".join(
        f'[[channel]]\nname = "{c}"\ncolumn = "{c}"\nunit = "{units.get(c, "rad")}"\n'
        for c in ("V", "alpha", "q", "theta", "az", "de_cmd", "thr_cmd")
    )
    file = tmp_path / "flights.toml"
    file.write_text(
        'title = "t"\nsource = "s"\nrights = "r"\n[time]\ncolumn = "t"\n'
        '[[record]]\nname = "one"\nfile = "a.nc"\nuse = "identification"\n'
        '[[record]]\nname = "two"\nfile = "b.nc"\nuse = "validation"\n'
        f'{channels}[identification]\ninputs = ["de_cmd"]\noutputs = ["q"]\n'
        '[[identification.estimators]]\nmethod = "dsr_e"\norder = 2\npast_horizon = 5\nfuture_horizon = 5\n',
        encoding="utf-8",
    )
    flights = load_flights("eolo", [file], said=Said("eolo_gap"))
    assert (list(flights.naming), list(flights.held_out)) == (["one"], ["two"])


@pytest.mark.parametrize(
    ("change", "options", "message"),
    [
        ({"kind": "truth"}, {}, "measured records only"),
        ({"outcome": "aborted", "reason": "stalled"}, {}, "must be complete"),
        ({"provenance": {}}, {}, "give --sensors"),
        ({}, {"sensors": "eolo_alpha"}, "lacks de"),
        ({}, {"V_m_s": 18.0}, "within 5 % of the airspeed of its condition"),
    ],
)
def test_a_record_that_does_not_do_is_refused_in_one_sentence(flown, tmp_path, change, options, message):
    replace(flown[0], **change).save(tmp_path / "x.nc")
    with pytest.raises(RecordError, match=message) as caught:
        load_flights("eolo", [tmp_path / "x.nc"], said=Said(**options))
    assert "x" in str(caught.value) or "--sensors" in str(caught.value)


def test_the_rate_must_be_that_of_the_sensors(flown, tmp_path):
    flown[0].decimate(2).save(tmp_path / "x.nc")
    with pytest.raises(RecordError, match="rate of the assumed sensors, 100 Hz"):
        load_flights("eolo", [tmp_path / "x.nc"])


def test_a_clock_that_is_a_little_off_is_put_right_and_said(flown, tmp_path):
    """801 samples at 100.01 Hz instead of 100 Hz are 0.08 of a sample off at the end; at 100.2 Hz 1.6 samples."""
    replace(flown[0], t_s=flown[0].t_s / 1.0001).save(tmp_path / "x.nc")
    flights = load_flights("eolo", [tmp_path / "x.nc"], wings="rigid")
    assert np.array_equal(flights.naming["x"].t_s, np.arange(len(flown[0])) / 100.0)
    assert np.array_equal(flights.naming["x"].data, flown[0].data)
    assert any("clock of 'x' runs at 100.01 Hz" in note for note in flights.notes)
    assert np.isfinite(flights.believed.residuals(flights.naming["x"])).all()
    replace(flown[0], t_s=flown[0].t_s / 1.002).save(tmp_path / "x.nc")
    with pytest.raises(RecordError, match=r"100 Hz .*, got 100\.2 Hz"):
        load_flights("eolo", [tmp_path / "x.nc"])


def test_a_manoeuvre_may_be_flown_again(flown, tmp_path):
    for i, record in enumerate(flown):
        replace(record, provenance={**record.provenance, "manoeuvre": "doublet"}).save(tmp_path / f"{i}.nc")
    flights = load_flights("eolo", [tmp_path / "0.nc", tmp_path / "1.nc"])
    assert (list(flights.naming), list(flights.held_out)) == (["doublet"], ["doublet (2)"])


def test_a_sensor_without_noise_is_refused(files, tmp_path):
    text = suite_toml(load_suite("eolo_gap"))
    theta = text.index('channel = "theta"')
    end = text.find("[[sensor]]", theta)
    loud = [line for line in text[theta:end].splitlines() if not line.startswith(("noise_std", "quantum"))]
    (tmp_path / "silent.toml").write_text(text[:theta] + "\n".join(loud) + "\n" + text[end:], encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"must have noise_std or quantum > 0.*got none for theta"):
        load_flights("eolo", files, said=Said(str(tmp_path / "silent.toml")))


def test_files_that_are_no_records_are_refused(files, tmp_path):
    (tmp_path / "flight.ulg").write_bytes(b"x")
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "a.nc").write_bytes(files[0].read_bytes())
    with pytest.raises(RecordError, match="testbench import"):
        load_flights("eolo", [tmp_path / "flight.ulg"])
    with pytest.raises(RecordError, match="must be a file that exists"):
        load_flights("eolo", [tmp_path / "none.nc"])
    with pytest.raises(RecordError, match="measured records must differ, got 'a' twice"):
        load_flights("eolo", [files[0], tmp_path / "sub" / "a.nc"])
    with pytest.raises(RecordError, match="at least one record must be left"):
        load_flights("eolo", files, files)
    with pytest.raises(ScenarioError, match="did you mean 'eolo_gap'"):
        load_flights("eolo", files, said=Said("eolo_gab"))
