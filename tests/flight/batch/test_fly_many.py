"""Flights of a batch against the same flights by JSBSim.

Flights that are given away as they are flown: the same records, made when they are wanted, in memory that stays.

A flight that begins off its trim: JSBSim and the batch agree, and it is where it was told to be.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import psutil
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
from testbench.flight.trim import horizon_rates
from testbench.questions.campaign.draws import change_aircraft

CONDITIONS = {
    "taurus": tb.FlightCondition(13.0, 100.0),
    "eolo": tb.FlightCondition(16.0, 547.0),
    "b1": tb.FlightCondition(200.0, 3000.0),
}


@pytest.fixture(scope="module")
def trimmed_taurus() -> tuple[Aircraft, TrimmedFlight]:
    aircraft = tb.load_aircraft("taurus")
    return aircraft, tb.trim(aircraft, CONDITIONS["taurus"])


def doublet(rate_hz: float, amplitude_deg: float, control: str = "de", duration_s: float = 4.0) -> tb.Manoeuvre:
    t = np.arange(round(duration_s * rate_hz)) / rate_hz
    u = np.deg2rad(amplitude_deg) * (((t > 0.5) & (t < 0.8)).astype(float) - ((t >= 0.8) & (t < 1.1)))
    return tb.Manoeuvre(f"{control} {amplitude_deg:g}", tb.InputSignal(t, u[:, None], (control,)), settle_s=0.5)


def flown(aircraft: Aircraft, trimmed: TrimmedFlight, manoeuvres: Sequence[tb.Manoeuvre], *more: Any) -> list[Any]:
    return tb.fly_many([Job(aircraft, trimmed, m, *more) for m in manoeuvres], "batch")


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


def test_moving_air_is_the_same_in_a_batch(trimmed_taurus: tuple[Aircraft, TrimmedFlight]) -> None:
    aircraft, _ = trimmed_taurus
    airs = [
        Air(wind_north_m_s=-3.0, wind_east_m_s=1.0, wind_down_m_s=-0.2, turbulence_rms_m_s=(0.4, 0.4, 0.3), seed=3),
        Air(wind_north_m_s=-3.0, wind_east_m_s=1.0, wind_down_m_s=-0.2, gust=Gust("down", -0.5, 0.3, 0.6)),
    ]
    trimmed = tb.trim(aircraft, CONDITIONS["taurus"], air=airs[0])
    manoeuvre = doublet(trimmed.rate_hz, 1.0)
    records = tb.fly_many([Job(aircraft, trimmed, manoeuvre, trimmed.rate_hz, air=air) for air in airs], "batch")
    for record, air in zip(records, airs, strict=True):
        truth = tb.fly(aircraft, trimmed, manoeuvre, trimmed.rate_hz, air=air)
        worst, channel = difference(record, truth)
        assert worst < TOLERANCE, channel


def test_no_bit_depends_on_what_flies_beside(trimmed_taurus: tuple[Aircraft, TrimmedFlight]) -> None:
    aircraft, trimmed = trimmed_taurus
    manoeuvres = [doublet(trimmed.rate_hz, 0.07 * k, duration_s=2.0 + 0.01 * k) for k in range(1, 71)]
    together = flown(aircraft, trimmed, manoeuvres, trimmed.rate_hz)
    backwards = flown(aircraft, trimmed, manoeuvres[::-1], trimmed.rate_hz)[::-1]
    for k in (0, 31, 69):
        (alone,) = flown(aircraft, trimmed, [manoeuvres[k]], trimmed.rate_hz)
        for other in (together[k], backwards[k]):
            assert np.array_equal(alone.data, other.data)


def test_a_flight_that_leaves_its_limits_ends_alone(trimmed_taurus: tuple[Aircraft, TrimmedFlight]) -> None:
    aircraft, trimmed = trimmed_taurus
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


def test_aircraft_that_differ_in_numbers_share_a_program(trimmed_taurus: tuple[Aircraft, TrimmedFlight]) -> None:
    aircraft, _ = trimmed_taurus
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
    jobs = [Job(a, t, manoeuvre, trims[0].rate_hz) for a, t in zip(varied, trims, strict=True)]
    for record, a, t in zip(tb.fly_many(jobs, "batch"), varied, trims, strict=True):
        worst, channel = difference(record, tb.fly(a, t, manoeuvre, t.rate_hz))
        assert worst < TOLERANCE, channel


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


def test_a_model_that_is_not_translated_is_flown_by_jsbsim(trimmed_taurus: tuple[Aircraft, TrimmedFlight]) -> None:
    """What matters to the flight counts: the same component feeding nothing is no obstacle."""
    aircraft, trimmed = trimmed_taurus
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
        flown(odd, trimmed, [manoeuvre], 60.0)


def test_one_flight_alone_is_flown_by_jsbsim(trimmed_taurus: tuple[Aircraft, TrimmedFlight]) -> None:
    aircraft, trimmed = trimmed_taurus
    (record,) = tb.fly_many([Job(aircraft, trimmed, doublet(trimmed.rate_hz, 1.0), 60.0)])
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


def test_a_verdict_is_kept(trimmed_taurus: tuple[Aircraft, TrimmedFlight], monkeypatch: pytest.MonkeyPatch) -> None:
    aircraft, trimmed = trimmed_taurus
    judged(aircraft, trimmed)
    monkeypatch.setattr(check, "_JUDGED", type(check._JUDGED)())
    monkeypatch.setattr(check, "_BASES", {})
    monkeypatch.setattr(check, "_REFUSED", {})
    monkeypatch.setattr(check, "compared", lambda *_: pytest.fail("it has flown again"))
    assert judged(aircraft, trimmed).model is not None


def test_one_flight_in_so_many_is_flown_by_both(
    trimmed_taurus: tuple[Aircraft, TrimmedFlight], monkeypatch: pytest.MonkeyPatch
) -> None:
    aircraft, trimmed = trimmed_taurus
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
        ({"manoeuvre": doublet(240.0, 15.0)}, LimitError, "reduce the amplitude"),
        ({"manoeuvre": doublet(200.0, 1.0)}, LimitError, "sampled"),
    ],
)
def test_what_breaks_a_law_is_refused(
    trimmed_taurus: tuple[Aircraft, TrimmedFlight], change: dict[str, object], error: type[Exception], words: str
) -> None:
    aircraft, trimmed = trimmed_taurus
    job = {"manoeuvre": doublet(240.0, 1.0), "log_rate_hz": 60.0} | change
    simulator: Any = job.pop("simulator", "batch")
    with pytest.raises(error, match=words):
        tb.fly_many([Job(aircraft, trimmed, **job)], simulator)  # type: ignore[arg-type]


def test_what_jsbsim_flies_is_dealt_to_processes(trimmed_taurus: tuple[Aircraft, TrimmedFlight]) -> None:
    """In order, counted, bit for bit, with what breaks a law in its place."""
    aircraft, trimmed = trimmed_taurus
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
    trimmed_taurus: tuple[Aircraft, TrimmedFlight], heavy_first: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One model, two masses said of it: az of the second was that of the first, 1.5 times too small."""
    aircraft, trimmed = trimmed_taurus
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
    trimmed_taurus: tuple[Aircraft, TrimmedFlight], function: str, reason: str
) -> None:
    """Above alpha = 0.14 the function has no value: of eight flights the last goes there."""
    aircraft = without_numbers(trimmed_taurus[0], function)
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
    trimmed_taurus: tuple[Aircraft, TrimmedFlight],
) -> None:
    """Begun there JSBSim stops before the flight does; the model must be deleted without the end of this process."""
    aircraft = without_numbers(trimmed_taurus[0], STOPS)
    trimmed = tb.trim(aircraft, CONDITIONS["taurus"])
    still = doublet(trimmed.rate_hz, 0.1, duration_s=1.2)
    jobs = [Job(aircraft, trimmed, still, trimmed.rate_hz, start=Start(alpha=x)) for x in (0.0, 0.05)]
    for simulator in ("batch", "jsbsim"):
        first, second = fly_jobs(jobs, simulator)
        assert isinstance(first, tb.FlightRecord)
        assert first.outcome == "completed"
        assert isinstance(second, Refusal)
        assert {"batch": "finite", "jsbsim": "conditional"}[simulator] in str(second)


@pytest.fixture(scope="module")
def trimmed(taurus: Aircraft) -> TrimmedFlight:
    return tb.trim(taurus, tb.FlightCondition(13.0, 100.0))


def pulses(aircraft: Aircraft, trimmed: TrimmedFlight, duration_s: float = 1.0) -> Iterator[tb.Job]:
    """Make flights without end, each a little different."""
    t = np.arange(round(duration_s * trimmed.rate_hz)) / trimmed.rate_hz
    k = 0
    while True:
        u = 1e-3 * (1.0 + k % 97) / 97.0 * (t < 0.3)
        signal = tb.InputSignal(t, u[:, None], ("de",))
        yield tb.Job(aircraft, trimmed, tb.Manoeuvre(f"pulse {k}", signal, 0.0), 60.0, ("q", "alpha"))
        k += 1


def test_records_are_those_of_one_call_in_their_order(taurus: Aircraft, trimmed: TrimmedFlight) -> None:
    jobs = list(islice(pulses(taurus, trimmed), 70))
    told = Tally()
    stream = list(tb.fly_stream(jobs, flown=told, at_once=32))
    together = tb.fly_many(jobs, "batch")
    assert (told.batch, told.jsbsim) == (70, 0)  # the last block holds six flights only
    for a, b in zip(stream, together, strict=True):
        assert isinstance(a, tb.FlightRecord)
        assert a.provenance["manoeuvre"] == b.provenance["manoeuvre"]
        assert np.array_equal(a.data, b.data)


def test_flights_are_made_when_they_are_wanted(taurus: Aircraft, trimmed: TrimmedFlight) -> None:
    made = 0

    def counted() -> Iterator[tb.Job]:
        nonlocal made
        for job in pulses(taurus, trimmed):
            made += 1
            yield job

    stream = tb.fly_stream(counted(), at_once=16)
    assert made == 0
    next(stream)
    assert made == 16


def test_a_few_flights_are_flown_by_jsbsim_and_told_how_many(taurus: Aircraft, trimmed: TrimmedFlight) -> None:
    told = Tally()
    records = list(tb.fly_stream(islice(pulses(taurus, trimmed), 3), flown=told))
    assert [BATCH in str(r.provenance) for r in records if isinstance(r, tb.FlightRecord)] == [False] * 3
    assert told.reasons == {"fewer than 8 flights at once are not worth a batch": 3}


def test_a_flight_that_breaks_a_law_is_its_error_and_the_others_fly(taurus: Aircraft, trimmed: TrimmedFlight) -> None:
    jobs = list(islice(pulses(taurus, trimmed), 10))
    jobs[4] = replace(jobs[4], log_rate_hz=100.0)
    found = list(tb.fly_stream(jobs))
    assert isinstance(found[4], LimitError)
    assert sum(isinstance(x, Refusal) for x in found) == 1
    with pytest.raises(LimitError, match="at_once >= 1"):
        next(tb.fly_stream(jobs, at_once=0))


def most_memory(stream: Iterator[tb.FlightRecord | Refusal], flights: int) -> float:
    """Consume flights; return the most memory that the process was seen to have meanwhile, MB."""
    process, most, greatest = psutil.Process(), 0, 0.0
    for k, record in enumerate(islice(stream, flights)):
        assert isinstance(record, tb.FlightRecord)
        greatest = max(greatest, float(np.max(np.abs(record["q"]))))
        if k % 250 == 0:
            most = max(most, process.memory_info().rss)
    assert greatest > 0.0
    return most / 2**20


@pytest.mark.slow
def test_a_hundred_thousand_flights_take_no_more_memory_than_ten_thousand(
    taurus: Aircraft, trimmed: TrimmedFlight
) -> None:
    """Held together, the records alone of 90 000 more flights would take some hundreds of MB."""
    stream = tb.fly_stream(pulses(taurus, trimmed))
    early = most_memory(stream, 10_000)
    late = most_memory(stream, 90_000)
    assert late - early < 8.0


START = tb.Start(V_m_s=0.8, alpha=0.02, beta=0.03, p=0.1, q=-0.05, r=0.03, phi=0.3, theta=0.05, h_m=20.0)


def trimmed_and_moved(name: str, duration_s: float = 3.0):
    aircraft = tb.load_aircraft(name)
    trimmed = tb.trim(aircraft, tb.FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m))
    t = np.arange(round(duration_s * trimmed.rate_hz)) / trimmed.rate_hz
    names = tuple(aircraft.controls)
    u = np.column_stack([0.01 + 0.01 * np.sin((3.0 + i) * t) for i in range(len(names))])
    return aircraft, trimmed, tb.Manoeuvre("by hand", tb.InputSignal(t, u, names), 0.0)


@pytest.mark.parametrize("name", ["eolo", "c172p", "f16"])
def test_both_simulators_agree_from_a_start(name: str) -> None:
    aircraft, trimmed, manoeuvre = trimmed_and_moved(name)
    rate = trimmed.rate_hz / round(trimmed.rate_hz / 50.0)
    truth = tb.fly(aircraft, trimmed, manoeuvre, rate, start=START)
    flown = tb.fly_many([Job(aircraft, trimmed, manoeuvre, rate, start=s) for s in (START, None)], "batch")
    assert difference(flown[0], truth)[0] <= TOLERANCE
    assert difference(flown[1], tb.fly(aircraft, trimmed, manoeuvre, rate))[0] <= TOLERANCE
    assert flown[0].provenance["start"]["phi"] == 0.3
    assert "start" not in flown[1].provenance


def test_moments_about_stability_axes_are_jsbsim_s_in_a_sideslip() -> None:
    """Those axes turn with the angle of attack alone; wind axes, from which lift and drag come, turn with both."""
    aircraft, trimmed, manoeuvre = trimmed_and_moved("taurus")
    xml = aircraft.xml
    for axis in ("ROLL", "PITCH", "YAW"):
        xml = xml.replace(f'<axis name="{axis}">', f'<axis name="{axis}" frame="STABILITY">')
    turned = replace(aircraft, xml=xml)
    rate = trimmed.rate_hz / round(trimmed.rate_hz / 50.0)
    truth = tb.fly(turned, trimmed, manoeuvre, rate, start=START)
    (flown,) = tb.fly_many([Job(turned, trimmed, manoeuvre, rate, start=START)], "batch")
    assert difference(flown, truth)[0] <= TOLERANCE
    assert difference(tb.fly(aircraft, trimmed, manoeuvre, rate, start=START), truth)[0] > 1e-3


def test_a_flight_begins_where_it_is_told() -> None:
    aircraft, trimmed, manoeuvre = trimmed_and_moved("eolo", 0.5)
    record = tb.fly(aircraft, trimmed, manoeuvre, trimmed.rate_hz, start=START)
    condition, still = trimmed.condition, horizon_rates(trimmed.condition.h_m, 0.0, 0.0, np.array([16.0, 0.0, 0.0]))
    wanted = {
        "V": condition.V_m_s + START.V_m_s,
        "h": condition.h_m + START.h_m,
        "alpha": trimmed.alpha + START.alpha,
        "beta": trimmed.beta + START.beta,
        "theta": trimmed.theta + START.theta,
        "phi": trimmed.phi + START.phi,
        "p": START.p,
        "q": START.q,
        "r": START.r,
        "de": trimmed.controls["de"] + 0.01,  # the servo stands where the first command holds it
    }
    assert np.max(np.abs(still)) < 1e-5
    assert {n: float(record[n][0]) for n in wanted} == pytest.approx(wanted, abs=1e-5)


def test_a_start_at_rest_is_the_trim_with_the_first_commands() -> None:
    aircraft, trimmed, manoeuvre = trimmed_and_moved("eolo", 1.0)
    still = tb.Manoeuvre(
        "still", tb.InputSignal(manoeuvre.signal.t_s, 0.0 * manoeuvre.signal.u, ("de", "da", "dr", "thr"))
    )
    free, trim = (tb.fly(aircraft, trimmed, still, trimmed.rate_hz, start=s) for s in (tb.Start(), None))
    assert difference(free, trim)[0] <= TOLERANCE


def test_a_start_without_airspeed_is_refused_by_both() -> None:
    aircraft, trimmed, manoeuvre = trimmed_and_moved("eolo", 0.1)
    start = tb.Start(V_m_s=-20.0)
    with pytest.raises(LimitError, match="airspeed above 0 m/s, got -4 m/s"):
        tb.fly(aircraft, trimmed, manoeuvre, trimmed.rate_hz, start=start)
    with pytest.raises(LimitError, match="airspeed above 0 m/s, got -4 m/s"):
        tb.fly_many([Job(aircraft, trimmed, manoeuvre, trimmed.rate_hz, start=start)], "batch")
