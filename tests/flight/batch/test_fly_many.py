"""Flights of a batch against the same flights by JSBSim."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import testbench as tb
from testbench.aircraft import Aircraft
from testbench.aircraft.amend import Amendment, Insert
from testbench.core.errors import ChannelError, LimitError, Refusal
from testbench.core.processes import processes
from testbench.core.record import FlightAborted
from testbench.flight.air import Air, Gust
from testbench.flight.batch import check
from testbench.flight.batch.check import TOLERANCE, difference, judged
from testbench.flight.batch.fly import fly_jobs
from testbench.flight.batch.functions import Functions
from testbench.flight.batch.jobs import BATCH, Job, Tally
from testbench.flight.condition import Start, TrimmedFlight
from testbench.questions.campaign.targets import change_aircraft

CONDITIONS = {
    "taurus": tb.FlightCondition(13.0, 100.0),
    "eolo": tb.FlightCondition(16.0, 547.0),
    "b1": tb.FlightCondition(200.0, 3000.0),
}


@pytest.fixture(scope="module")
def taurus() -> tuple[Aircraft, TrimmedFlight]:
    aircraft = tb.load_aircraft("taurus")
    return aircraft, tb.trim(aircraft, CONDITIONS["taurus"])


def doublet(rate_hz: float, amplitude_deg: float, control: str = "de", duration_s: float = 4.0) -> tb.Manoeuvre:
    t = np.arange(round(duration_s * rate_hz)) / rate_hz
    u = np.deg2rad(amplitude_deg) * (((t > 0.5) & (t < 0.8)).astype(float) - ((t >= 0.8) & (t < 1.1)))
    return tb.Manoeuvre(f"{control} {amplitude_deg:g}", tb.InputSignal(t, u[:, None], (control,)), settle_s=0.5)


def flown(
    aircraft: Aircraft | Sequence[Aircraft], trimmed: TrimmedFlight | Sequence[TrimmedFlight], *more: object
) -> list[tb.FlightRecord]:
    return tb.fly_many(aircraft, trimmed, *more, simulator="batch")  # type: ignore[arg-type]


@pytest.mark.parametrize("name", CONDITIONS)
def test_a_batch_flies_as_jsbsim_does(name: str) -> None:
    aircraft = tb.load_aircraft(name)
    trimmed = tb.trim(aircraft, CONDITIONS[name])
    rate = trimmed.rate_hz
    manoeuvres = [doublet(rate, 1.0, c) for c in aircraft.controls if c != "thr"]
    records = flown(aircraft, trimmed, manoeuvres, rate)
    for record, manoeuvre in zip(records, manoeuvres, strict=True):
        truth = tb.fly(aircraft, trimmed, manoeuvre, rate)
        assert record.channels == truth.channels
        assert len(record) == len(truth)
        worst, channel = difference(record, truth)
        assert worst < TOLERANCE, channel
        assert record.provenance["simulator"] == BATCH


def test_the_judge_finds_the_packaged_aircraft_equal_to_jsbsim() -> None:
    for name, condition in CONDITIONS.items():
        aircraft = tb.load_aircraft(name)
        verdict = judged(aircraft, tb.trim(aircraft, condition))
        assert verdict.model is not None, verdict.reason
        assert verdict.worst < TOLERANCE


def test_moving_air_is_the_same_in_a_batch(taurus: tuple[Aircraft, TrimmedFlight]) -> None:
    aircraft, _ = taurus
    airs = [
        Air(wind_north_m_s=-3.0, wind_east_m_s=1.0, wind_down_m_s=-0.2, turbulence_rms_m_s=(0.4, 0.4, 0.3), seed=3),
        Air(wind_north_m_s=-3.0, wind_east_m_s=1.0, wind_down_m_s=-0.2, gust=Gust("down", -0.5, 0.3, 0.6)),
    ]
    trimmed = tb.trim(aircraft, CONDITIONS["taurus"], air=airs[0])
    manoeuvre = doublet(trimmed.rate_hz, 1.0)
    records = flown(aircraft, trimmed, manoeuvre, trimmed.rate_hz, None, airs)
    for record, air in zip(records, airs, strict=True):
        truth = tb.fly(aircraft, trimmed, manoeuvre, trimmed.rate_hz, air=air)
        worst, channel = difference(record, truth)
        assert worst < TOLERANCE, channel


def test_no_bit_depends_on_what_flies_beside(taurus: tuple[Aircraft, TrimmedFlight]) -> None:
    aircraft, trimmed = taurus
    manoeuvres = [doublet(trimmed.rate_hz, 0.07 * k, duration_s=2.0 + 0.01 * k) for k in range(1, 71)]
    together = flown(aircraft, trimmed, manoeuvres, trimmed.rate_hz)
    backwards = flown(aircraft, trimmed, manoeuvres[::-1], trimmed.rate_hz)[::-1]
    for k in (0, 31, 69):
        (alone,) = flown(aircraft, trimmed, [manoeuvres[k]], trimmed.rate_hz)
        for other in (together[k], backwards[k]):
            assert np.array_equal(alone.data, other.data)


def test_a_flight_that_leaves_its_limits_ends_alone(taurus: tuple[Aircraft, TrimmedFlight]) -> None:
    aircraft, trimmed = taurus
    t = np.arange(round(6.0 * trimmed.rate_hz)) / trimmed.rate_hz
    held = tb.InputSignal(t, np.deg2rad(15.0) * (t > 0.5)[:, None], ("da",))
    mild, wild = doublet(trimmed.rate_hz, 1.0, "da", 6.0), tb.Manoeuvre("held", held, settle_s=0.5)
    first, second = flown(aircraft, trimmed, [mild, wild], 60.0, ("phi", "p", "h"))
    with pytest.raises(FlightAborted) as caught:
        tb.fly(aircraft, trimmed, wild, 60.0, ("phi", "p", "h"))
    assert first.outcome == "completed"
    assert second.outcome == "aborted"
    assert second.reason == caught.value.reason
    assert caught.value.record is not None
    assert len(second) == len(caught.value.record)
    assert second.channels == ("phi", "p", "h")


def test_aircraft_that_differ_in_numbers_share_a_program(taurus: tuple[Aircraft, TrimmedFlight]) -> None:
    aircraft, _ = taurus
    varied = [
        change_aircraft(
            aircraft,
            {"aircraft.mass_percent": 2.0 * k, "aircraft.Iyy_percent": 5.0 * k, "aircraft.cg_x_m": 0.001 * k,
             "coefficient.Cm_q": 1.0 + 0.1 * k},
        )
        for k in (-1, 1)
    ]  # fmt: skip
    trims = [tb.trim(a, CONDITIONS["taurus"]) for a in varied]
    models = [judged(a, t).model for a, t in zip(varied, trims, strict=True)]
    assert models[0] is not None
    assert models[1] is not None
    assert models[0].program is models[1].program
    manoeuvre = doublet(trims[0].rate_hz, 1.0)
    for record, a, t in zip(flown(varied, trims, manoeuvre, t_rate(trims)), varied, trims, strict=True):
        worst, channel = difference(record, tb.fly(a, t, manoeuvre, t.rate_hz))
        assert worst < TOLERANCE, channel


def t_rate(trims: Sequence[TrimmedFlight]) -> float:
    return trims[0].rate_hz


def test_a_wrong_translation_is_caught_and_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A product that loses its last factor must not fly; what shows it is named."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    right = Functions._many

    def wrong(self: Functions, op: object, values: Sequence[object]) -> object:
        return right(self, op, values[:-1] if len(values) == 6 else values)  # type: ignore[arg-type]

    monkeypatch.setattr(Functions, "_many", wrong)
    monkeypatch.setattr(check, "_JUDGED", type(check._JUDGED)())
    monkeypatch.setattr(check, "_BASES", {})
    monkeypatch.setattr(check, "_REFUSED", {})
    aircraft = tb.load_aircraft("taurus")
    verdict = judged(aircraft, tb.trim(aircraft, CONDITIONS["taurus"]))
    assert verdict.model is None
    assert re.search(r"its (flight|\w+) departs from JSBSim's by", verdict.reason)


def test_a_model_that_is_not_translated_is_flown_by_jsbsim(taurus: tuple[Aircraft, TrimmedFlight]) -> None:
    """What matters to the flight counts: the same component feeding nothing is no obstacle."""
    aircraft, trimmed = taurus
    sensor = '<fcs_function name="fcs/odd"><function><random/></function></fcs_function>'
    idle = aircraft.amended(Amendment("idle", "", (Insert("flight_control/channel[@name='elevator']", sensor),)))
    assert judged(idle, trimmed).model is not None
    term = '<function name="aero/odd"><product><value>1e-9</value><property>fcs/odd</property></product></function>'
    odd = idle.amended(Amendment("odd", "", (Insert("aerodynamics/axis[@name='PITCH']", term),)))
    verdict = judged(odd, trimmed)
    assert verdict.model is None
    assert verdict.reason == "it has the function <random>"
    manoeuvre, told = doublet(trimmed.rate_hz, 1.0), Tally()
    records = fly_jobs([Job(odd, trimmed, manoeuvre, 60.0)] * 8, flown=told)
    assert told.batch == 0
    assert told.reasons == {verdict.reason: 8}
    assert isinstance(records[0], tb.FlightRecord)
    assert records[0].provenance["simulator"] == f"JSBSim, as {verdict.reason}"
    with pytest.raises(LimitError, match="<random>"):
        flown(odd, trimmed, manoeuvre, 60.0)


def test_one_flight_alone_is_flown_by_jsbsim(taurus: tuple[Aircraft, TrimmedFlight]) -> None:
    aircraft, trimmed = taurus
    (record,) = tb.fly_many(aircraft, trimmed, [doublet(trimmed.rate_hz, 1.0)], 60.0)
    assert record.provenance["simulator"] == "JSBSim, as fewer than 8 flights at once are not worth a batch"


def test_a_flight_that_comes_near_the_ground_is_flown_by_jsbsim() -> None:
    aircraft = replace(tb.load_aircraft("taurus"), limits={})
    trimmed = tb.trim(aircraft, tb.FlightCondition(13.0, 30.0, gamma_rad=-0.05))
    told = Tally()
    manoeuvres = [doublet(trimmed.rate_hz, 0.1, duration_s=s) for s in (5.0, 43.0)]
    records = fly_jobs([Job(aircraft, trimmed, m, 60.0) for m in manoeuvres], "batch", told)
    assert (told.batch, told.jsbsim) == (1, 1)
    assert "ground" in next(iter(told.reasons))
    truth = tb.fly(aircraft, trimmed, manoeuvres[1], 60.0)
    assert isinstance(records[1], tb.FlightRecord)
    assert np.array_equal(records[1].data, truth.data)


def test_a_verdict_is_kept(taurus: tuple[Aircraft, TrimmedFlight], monkeypatch: pytest.MonkeyPatch) -> None:
    aircraft, trimmed = taurus
    judged(aircraft, trimmed)
    monkeypatch.setattr(check, "_JUDGED", type(check._JUDGED)())
    monkeypatch.setattr(check, "_BASES", {})
    monkeypatch.setattr(check, "_REFUSED", {})
    monkeypatch.setattr(check, "compared", lambda *_: pytest.fail("it has flown again"))
    assert judged(aircraft, trimmed).model is not None


def test_one_flight_in_so_many_is_flown_by_both(
    taurus: tuple[Aircraft, TrimmedFlight], monkeypatch: pytest.MonkeyPatch
) -> None:
    aircraft, trimmed = taurus
    monkeypatch.setattr("testbench.flight.batch.fly.BOTH", 4)
    told = Tally()
    jobs = [Job(aircraft, trimmed, doublet(trimmed.rate_hz, 0.1 * k), 60.0) for k in range(1, 33)]
    fly_jobs(jobs, "batch", told)
    assert 0 < told.both < 20  # 8 expected; fewer than 1 or more than 19 of 32 have a chance below 1e-4
    assert told.worst < TOLERANCE


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"log_rate_hz": 100.0}, LimitError, "log rate"),
        ({"channels": ("nonsense",)}, ChannelError, "nonsense"),
        ({"simulator": "bach"}, LimitError, "batch"),
        ({"manoeuvre": [doublet(240.0, 15.0)]}, LimitError, "reduce the amplitude"),
        ({"manoeuvre": [doublet(200.0, 1.0)]}, LimitError, "sampled"),
        ({"air": [None, None]}, LimitError, "one length"),
    ],
)
def test_what_breaks_a_law_is_refused(
    taurus: tuple[Aircraft, TrimmedFlight], change: dict[str, object], error: type[Exception], words: str
) -> None:
    aircraft, trimmed = taurus
    asked: dict[str, object] = {
        "aircraft": aircraft, "trimmed": trimmed, "manoeuvre": [doublet(240.0, 1.0)], "log_rate_hz": 60.0,
        "simulator": "batch",
    }  # fmt: skip
    with pytest.raises(error, match=words):
        tb.fly_many(**(asked | change))  # type: ignore[arg-type]


def test_what_jsbsim_flies_is_dealt_to_processes(taurus: tuple[Aircraft, TrimmedFlight]) -> None:
    """In order, counted, bit for bit, with what breaks a law in its place."""
    aircraft, trimmed = taurus
    rate = trimmed.rate_hz
    jobs = [Job(aircraft, trimmed, doublet(rate, a, duration_s=1.5), rate) for a in (1.0, 2.0, 900.0, 3.0)]
    alone, dealt = Tally(), Tally()
    one_by_one = fly_jobs(jobs, "jsbsim", alone)
    with processes(2):
        found = fly_jobs(jobs, "jsbsim", dealt)
    assert dealt == alone
    assert dealt.jsbsim == len(jobs)
    assert isinstance(found[2], LimitError)
    assert str(found[2]) == str(one_by_one[2])
    for one, other in zip(one_by_one, found, strict=True):
        if isinstance(one, tb.FlightRecord):
            assert isinstance(other, tb.FlightRecord)
            assert np.array_equal(one.data, other.data)
            assert one.provenance == other.provenance


@pytest.mark.parametrize("heavy_first", [True, False])
def test_forces_per_mass_are_read_by_the_mass_of_each_aircraft(
    taurus: tuple[Aircraft, TrimmedFlight], heavy_first: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One model, two masses said of it: az of the second was that of the first, 1.5 times too small."""
    aircraft, trimmed = taurus
    monkeypatch.setattr(check, "_JUDGED", type(check._JUDGED)())
    heavy = replace(aircraft, mass=replace(aircraft.mass, mass_kg=1.5 * aircraft.mass.mass_kg))
    for each in (heavy, aircraft) if heavy_first else (aircraft, heavy):
        model = judged(each, trimmed).model
        assert model is not None
        assert model.factors[model.channels.index("az")] == each.source_of("az")[1]


def without_numbers(aircraft: Aircraft, function: str) -> Aircraft:
    """An aircraft with a function of alpha that is too small to matter, but must have a value."""
    of_alpha = function.format("<property>aero/alpha-rad</property>")
    term = f'<function name="aero/odd"><product><value>1e-9</value>{of_alpha}</product></function>'
    return aircraft.amended(Amendment("odd", "", (Insert("aerodynamics/axis[@name='PITCH']", term),)))


STOPS = "<ifthen><product><value>7.14</value>{}</product><value>1</value><value>2</value></ifthen>"


@pytest.mark.parametrize(
    ("function", "reason"),
    [
        (
            "<pow><difference><value>0.14</value>{}</difference><value>0.5</value></pow>",
            "pdot ceased to be a finite number",
        ),
        ("<acos><product><value>7.14</value>{}</product></acos>", "pdot ceased to be a finite number"),
        (
            "<ifthen><product><value>7.14</value>{}</product><value>1</value><value>2</value></ifthen>",
            "JSBSim stopped: Malformed conditional check in function definition",
        ),
    ],
    ids=["power of what is below 0", "arc cosine beyond 1", "condition beyond 1, at which JSBSim stops"],
)
def test_a_flight_for_which_a_function_has_no_number_fails_alone(
    taurus: tuple[Aircraft, TrimmedFlight], function: str, reason: str
) -> None:
    """Above alpha = 0.14 the function has no value: of eight flights the last goes there."""
    aircraft = without_numbers(taurus[0], function)
    trimmed = tb.trim(aircraft, CONDITIONS["taurus"])
    rate = trimmed.rate_hz
    jobs = [Job(aircraft, trimmed, doublet(rate, x), rate) for x in (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 4.0)]
    assert judged(aircraft, trimmed).model is not None
    for simulator, ends in (("auto", "pdot ceased to be a finite number"), ("jsbsim", reason)):
        told = Tally()
        *others, last = fly_jobs(jobs, simulator, told)
        assert (told.batch, told.jsbsim) == ((8, 0) if simulator == "auto" else (0, 8))
        assert isinstance(last, tb.FlightRecord)
        assert (last.outcome, last.reason) == ("aborted", ends)
        assert last.t_s[-1] == pytest.approx(1.581, abs=0.003)
        for other, alone in zip(others, fly_jobs(jobs[:7], simulator, fewest=1), strict=True):
            assert isinstance(other, tb.FlightRecord)
            assert other.outcome == "completed"
            assert np.array_equal(other.data, alone.data)


def test_a_flight_that_begins_where_a_function_has_no_number_fails_alone(
    taurus: tuple[Aircraft, TrimmedFlight],
) -> None:
    """Begun there JSBSim stops before the flight does; the model must be deleted without the end of this process."""
    aircraft = without_numbers(taurus[0], STOPS)
    trimmed = tb.trim(aircraft, CONDITIONS["taurus"])
    still = doublet(trimmed.rate_hz, 0.1, duration_s=1.2)
    jobs = [Job(aircraft, trimmed, still, trimmed.rate_hz, start=Start(alpha=x)) for x in (0.0, 0.05)]
    for simulator in ("batch", "jsbsim"):
        first, second = fly_jobs(jobs, simulator)
        assert isinstance(first, tb.FlightRecord)
        assert first.outcome == "completed"
        assert isinstance(second, Refusal)
        assert {"batch": "finite", "jsbsim": "conditional"}[simulator] in str(second)
