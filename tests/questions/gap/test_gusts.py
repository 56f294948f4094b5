"""A gust met in one manoeuvre: it flies in that record only, is found where it is, and not where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_fits import fits
from scipy.stats import binom, chi2
from studies.blind.flights import SETTLE_S, fly_truth
from studies.blind.run import believe
from studies.blind.truth import Truth
from studies.blind.truths import TRUTHS

from testbench.core.door import read_toml
from testbench.core.errors import ModelError
from testbench.core.record import FlightRecord
from testbench.core.scenario.air import AirSpec
from testbench.effects import EFFECTS
from testbench.effects.base import MetGust
from testbench.flight.air import Gust
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.export import air_text
from testbench.questions.gap.name import Sought, name_effect
from testbench.questions.gap.search.gust_search import GustSearch
from testbench.questions.gap.search.point import Point
from testbench.questions.gap.starts import called, manoeuvre_of, record_key
from testbench.questions.gap.workflow import GapSearch, find_gap

GUST = EFFECTS["gust"]
FEW = {n: EFFECTS[n] for n in ("gust", "actuator_lag", "alpha_scale", "rate_limit")}
TRUE = Gust("down", -2.2, 4.0, 1.1)  # 6 s into the record: flights settle for 2 s
FACTORS = {"Cm_q": 1.1, "CL_alpha": 0.97}


def quiet(n: int = 400) -> FlightRecord:
    """A record without a command or a reading."""
    names = ("de_cmd", "thr_cmd")
    return FlightRecord(t_s=np.arange(n) / 50.0, channels=names, data=np.zeros((n, 2)), kind="measured")


def meeting(believed: Believed, record: FlightRecord, gust: Gust) -> Believed:
    return replace(believed, gusts=(MetGust(record_key(record), "m", gust),))


@pytest.fixture(scope="module")
def believed() -> Believed:
    return believe("taurus")


@pytest.fixture(scope="module")
def flights() -> dict[str, FlightRecord]:
    return fly_truth("taurus", Truth(gust=TRUE, factors=FACTORS), "short", 5)


@pytest.fixture(scope="module")
def calm() -> dict[str, FlightRecord]:
    return fly_truth("taurus", Truth(factors=FACTORS), "short", 5)


@pytest.fixture(scope="module")
def held_out() -> dict[str, FlightRecord]:
    return fly_truth("taurus", Truth(factors=FACTORS), "held_out", 6)


@pytest.fixture(scope="module")
def finding(believed, flights, held_out):
    return find_gap(believed, flights, held_out, GapSearch(effects=FEW))


def test_a_gust_flies_in_its_own_record_and_in_no_other(believed, flights, held_out):
    first, second = flights.values()
    met = meeting(believed, first, Gust("down", 2.0, 3.0, 1.0))
    assert np.max(np.abs(met.predict(first) - believed.predict(first))) > 0.1
    again = replace(first, data=first.data + 1e-9)  # the same manoeuvre with other noise
    for record in (second, again, *held_out.values()):
        assert np.array_equal(met.predict(record), believed.predict(record))


def test_a_record_that_met_two_gusts_is_refused(believed, flights):
    first = next(iter(flights.values()))
    met = meeting(believed, first, Gust("down", 2.0, 3.0, 1.0))
    with pytest.raises(ModelError, match="a record can hold one gust, got 2 in m"):
        replace(met, gusts=met.gusts * 2).predict(first)


def test_a_manoeuvre_is_called_by_its_provenance_or_its_number():
    record = quiet()
    assert manoeuvre_of(record, 3) == "record 3"
    assert manoeuvre_of(replace(record, provenance={"manoeuvre": "sweep"}), 3) == "sweep"
    flown = replace(record, provenance={"truth": {"manoeuvre": "pull"}})
    assert manoeuvre_of(flown, 3) == "pull"
    of_a_log = called({"climb out, 3 to 8 s": record, "log 7": flown})
    assert [manoeuvre_of(r, 3) for r in of_a_log.values()] == ["climb out, 3 to 8 s", "pull"]


@pytest.mark.parametrize("axis", ["down", "north"])
def test_a_gust_is_recovered_from_data_without_noise_that_it_made(believed, axis):
    record = fly_truth("taurus", Truth(), "short", 7)["doublets of two sizes"]
    other = fly_truth("taurus", Truth(), "short", 7)["3211"]
    true = Gust(axis, 1.7, 6.53, 0.83)
    exact = []
    for r, model in ((other, believed), (record, meeting(believed, record, true))):
        data = r.data.copy()
        data[:, [r.channels.index(c) for c in believed.outputs]] = model.predict(r)
        exact.append(replace(r, data=data))
    start = Point.at(believed, believed, tuple(exact))
    (found,) = fits(believed, exact, GUST)
    assert found is not None
    # 1 % of each: the descent ends where another round promises a thousandth of what is left
    assert found.chi2 < 1e-3 * start.chi2
    assert found.values["amplitude_m_s"] == pytest.approx(true.amplitude_m_s, rel=0.01)
    assert found.values["start_s"] == pytest.approx(true.start_s, abs=0.01 * 0.83)
    assert found.values["duration_s"] == pytest.approx(true.duration_s, rel=0.01)
    assert f"'{exact[1].provenance['manoeuvre']}'" in found.effect.title


def test_the_score_at_a_place_is_that_of_an_ordinary_regression(believed, calm):
    """The same as |r|^2 less what least squares leave with the response there as one more column: rounding only."""
    records = tuple(calm.values())
    point = Point.at(believed, believed, records)
    found, p = GustSearch.at(point), len(believed.outputs)
    k, m, s = 1, 11, 130  # the second record, the vertical gust of 0.9 s, 2.6 s
    axis, duration = found.places[m]
    longest = max(records, key=len)
    first = meeting(believed, longest, Gust(axis, 1.0, 0.0, duration)).predict(longest) - believed.predict(longest)
    change = np.zeros((len(records[k]), p))
    change[s:] = first[: len(records[k]) - s]
    d = np.zeros(point.exact.size)
    d[len(records[0]) * p :] = believed.in_noise_units(records[k], change).ravel()
    left = point.tuned(d)[0] - point.tuned(np.zeros_like(d))[0]  # the price of re-tuning is a part of it
    assert found.information[k][m, s] == pytest.approx(float(left @ left), rel=1e-6)


def test_noise_alone_stands_out_no_more_often_than_stated(believed, calm):
    """Bonferroni's bound: at most 5 % of white residuals exceed the threshold of 5 %. Of 400, more than binom.isf(1e-6)
    would be a false alarm of 1e-6 where the bound is sharp; fewer than one in 400, of a threshold that is far too
    high, has a probability of 1e-3 where 1.7 % exceed it, as measured in 2000."""
    records = tuple(calm.values())
    point = Point.at(believed, believed, records)
    search, p = GustSearch.at(point), len(believed.outputs)
    rng = np.random.default_rng(2)
    cuts = np.cumsum([len(r) * p for r in records])[:-1]
    threshold, exceeded = chi2.isf(0.05 / search.looks, 1), 0
    for _ in range(400):
        white = [rng.standard_normal((len(r), p)) for r in records]
        noise = np.concatenate([(w - w.mean(axis=0)).ravel() for w in white])
        left = (point.tuned(noise)[0] - point.tuned(np.zeros_like(noise))[0])[: noise.size]
        best = search.best([part.reshape(-1, p) for part in np.split(left, cuts)])
        exceeded += best is not None and best.gain > threshold
    assert 1 <= exceeded <= binom.isf(1e-6, 400, 0.05)


def test_a_gust_is_named_in_its_manoeuvre_with_its_size(finding):
    assert finding.naming.names == ("gust",), finding.naming.sentence
    best = finding.naming.best
    for name, true in (("amplitude_m_s", -2.2), ("start_s", 6.0), ("duration_s", 1.1)):
        assert abs(best.values[name] - true) < 4.0 * best.errors[name]  # false alarm 6e-5 each
    assert "gust in manoeuvre '3211', vertical" in finding.sentences[0]
    assert any("a gust does not occur twice" in s for s in finding.sentences)
    assert not finding.immaterial


def test_manoeuvres_held_out_and_the_aircraft_are_untouched(finding, held_out):
    tuned = finding.believed.with_nuisances(finding.naming.best.nuisances)
    assert finding.amended.aircraft.xml == tuned.aircraft.xml
    for record in held_out.values():
        assert np.array_equal(finding.amended.predict(record), tuned.predict(record))


def test_the_air_is_written_as_a_scenario_reads_it(finding, tmp_path):
    from gap.gap_fits import write_amended

    from testbench.questions.gap.ask import GapResult

    result = GapResult("case", "title", "", "taurus", {}, finding)
    paths = write_amended(result, tmp_path)
    assert sorted(p.name for p in paths) == ["air.diff", "air_3211.toml"], "no aircraft, no suite"
    met = finding.amended.gusts[0]
    spec = AirSpec(**read_toml(tmp_path / "air_3211.toml")["air"]).gust
    assert (spec.axis, spec.amplitude_m_s) == ("down", met.gust.amplitude_m_s)
    assert (spec.start_s, spec.duration_s) == (met.gust.start_s, met.gust.duration_s)
    assert "length_m = 30.0" in air_text(replace(met, gust=Gust("north", 1.0, 0.5, length_m=30.0)))


def test_calm_flights_are_no_gap(believed, calm):
    """False alarm 1e-3 for all effects together, and as much for energy left over; the seed is fixed."""
    naming = name_effect(believed, list(calm.values()), Sought(FEW))
    assert naming.outcome == "no gap", naming.sentence
    assert "no gust stands out" in naming.rejected["gust"]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("kind", "sizes"), [("slow servo", {"lag_rad_s": 12.0}), ("frozen attitude", {"length_s": 0.8})]
)
def test_what_recurs_in_several_manoeuvres_or_in_one_channel_is_no_gust(believed, kind, sizes):
    records = list(fly_truth("taurus", TRUTHS[kind](sizes, "taurus"), "short", 8).values())
    naming = name_effect(believed, records, Sought({"gust": GUST}))
    assert naming.weighed["gust"] < 0.01
    assert naming.weighed.unknown > 0.9, naming.sentence


@pytest.mark.parametrize(
    "gust",
    [Gust("down", 0.12, 5.0, 0.8), Gust("down", 0.12, 0.6, 0.8), Gust("down", 2.5, 0.6, 0.8)],
    ids=["in quiet flight", "beside a command", "large, beside a command"],
)
def test_a_gust_is_named_with_its_place_wherever_it_is(believed, gust):
    records = list(fly_truth("taurus", Truth(gust=gust), "short", 8).values())
    naming = name_effect(believed, records, Sought({"gust": GUST}))
    assert naming.names == ("gust",), naming.sentence
    assert abs(naming.best.values["start_s"] - SETTLE_S - gust.start_s) < 4.0 * naming.best.errors["start_s"] + 0.05
