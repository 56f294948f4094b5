"""Records without quiet trim flight: cut into windows, started freely, and searched as others are.

Noise is drawn with fixed seeds. A statistical bound states with which probability a right program would fail it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_flights import ELEVATOR, THROTTLE, believe, measure
from hand_flown import hand_flown
from real_aircraft import (
    ATTAS_H,
    ATTAS_V,
    HFB_RHO,
    altitude_m,
    attas,
    attas_record,
    fine_noise,
    hfb320,
    hfb320_record,
    quiet_noise,
)
from real_aircraft import believe as believe_real
from recorded import flight_data
from scipy.stats import chi2
from studies.blind.flights import suite

import testbench.questions.gap.flights as flights_module
from testbench.core.constants import DEG_RAD
from testbench.core.errors import LimitError, RecordError
from testbench.core.record import FlightAborted, FlightRecord
from testbench.core.scenario.inputs import StandardMultistep, Sweep
from testbench.effects import EFFECTS, library
from testbench.flight import FlightCondition, Manoeuvre, Start, fly, load_aircraft, trim
from testbench.inputs import build
from testbench.inputs.signal import InputSignal
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.air import listen
from testbench.questions.gap.evidence.commanded import (
    begins_quietly,
    commands,
    freed,
    key_of_start,
    quiet_samples,
    starts_freely,
)
from testbench.questions.gap.name import Sought, name_effect
from testbench.questions.gap.scenario import windows_of
from testbench.questions.gap.search.point import Point, fly_together
from testbench.questions.gap.starts import FreeStart, record_key
from testbench.questions.gap.windows import (
    LEAD_S,
    LONGEST_S,
    _surviving,
    begin_freely,
    cut,
    in_windows,
    level,
    longest,
    nearly_trimmed,
)
from testbench.questions.gap.workflow import GapSearch, find_gap

RARE = 1e-4
LARGE = StandardMultistep(signal="3211", control="de", amplitude_deg=11.0, step_s=0.5)
SOUGHT = ("actuator_lag", "transport_delay", "free_play", "pitch_damper", "curved_moment")


@pytest.fixture(scope="module")
def believed():
    return believe()


@pytest.fixture(scope="module")
def flown(believed):
    """A hand-flown record of 9 s that lacks nothing."""
    return hand_flown(believed, 3, 11.0)


@pytest.fixture(scope="module")
def begun(believed, flown):
    parts = cut(believed, {"by hand": flown}, 4.5)
    return begin_freely(believed, parts.records), tuple(parts.records.values())


def test_a_record_without_quiet_flight_is_cut_and_says_so(believed, flown):
    found = cut(believed, {"by hand": flown})
    assert not begins_quietly(flown)
    (note,) = found.notes
    assert note.startswith(
        "'by hand' does not begin with quiet flight: it is cut into 1 window of 8.5 s (nothing grows"
    )
    assert note.endswith(", each with a free initial state")
    found = cut(believed, {"by hand": flown}, 3.0)
    parts, lead = list(found.records.values()), round(LEAD_S / flown.dt_s)
    assert list(found.records) == ["by hand, 2 to 5.32 s", "by hand, 4.83 to 8.16 s", "by hand, 7.67 to 10.99 s"]
    assert all(starts_freely(p) for p in parts)
    compared = [p.valid[:, p.channels.index("q")] for p in parts]
    assert all(not v[:lead].any() and v[lead:].all() for v in compared)
    assert sum(int(v.sum()) for v in compared) == len(flown) - lead  # every sample once, but those before the first
    levels = [p.columns(["de_cmd"])[:, 0] - commands(p)[1][:, commands(p)[0].index("de")] for p in parts]
    assert np.ptp(np.concatenate(levels)) < 1e-12  # all windows of a record count from one level
    assert levels[0][0] == pytest.approx(flown["de_cmd"].mean())


def test_quiet_trim_flight_is_used_where_it_is(believed):
    (record,) = measure(believed, 5, inputs=(ELEVATOR,), duration_s=6.0)
    found = cut(believed, {"3211": record})
    assert found.records["3211"] is record
    assert found.notes == ()
    held = record.between(2.6, 8.0)  # the elevator rests here, the aircraft does not: a step has just been made
    assert begins_quietly(held)
    assert "turns as it begins (q -" in cut(believed, {"3211": held}).notes[0]


@pytest.fixture(scope="module")
def too_strong(believed):
    """A record of an aircraft whose elevator is believed to be twice as strong: from trim, the belief leaves limits."""
    return measure(believed.with_nuisances({"Cm_de": 0.5}), 5, inputs=(LARGE,), duration_s=8.0)[0]


def test_a_record_that_the_believed_aircraft_cannot_fly_from_trim_is_cut(believed, too_strong):
    (note,) = cut(believed, {"3211": too_strong}).notes
    assert note.startswith("'3211' cannot be flown from trim to its end: it is cut into 1 window of 9.51 s")
    (note,) = cut(believed, {"3211": too_strong}, share=0.5).notes
    assert "2 windows of 4.76 s (in longer ones the a-priori model leaves its limits)" in note


@pytest.mark.slow
def test_windows_are_as_short_as_the_believed_aircraft_can_fly(believed, too_strong):
    there, given, _ = in_windows(believed, {"3211": too_strong}, {}, "auto", lambda text: None)
    assert "4 windows of 2.38 s (in longer ones the a-priori model leaves its limits)" in given.notes[0]
    assert all(np.isfinite(there.predict(r)).all() for r in given.records.values())
    with pytest.raises(FlightAborted, match="left its limits"):  # a length that was asked for stays
        in_windows(believed, {"3211": too_strong}, {}, 9.0, lambda text: None)


def test_commands_beyond_a_control_if_counted_from_trim_are_cut_and_refused_if_they_swing_by_more(believed):
    """The throttle comes back from a step that began before the record: counted from trim, that is less than none."""
    (record,) = measure(believed, 5, inputs=(ELEVATOR,), duration_s=8.0)
    late = (record.t_s > 4.0)[:, None] * (np.array(record.channels) == "thr_cmd")
    (note,) = cut(believed, {"piece": replace(record, data=record.data - 0.4 * late)}).notes
    assert note.startswith("'piece' commands more than a control has, if counted from trim: it is cut")
    percent = {"percent": replace(record, data=record.data - 40.0 * late)}
    assert cut(believed, percent).notes == ()
    with pytest.raises(LimitError, match=r"<= 100 % must hold for eolo.*'percent'"):
        find_gap(believed, percent, percent)


def test_a_control_that_is_held_in_the_midst_of_a_manoeuvre_rests_but_the_aircraft_is_not_in_trim():
    """A glider rolls steadily, by less than counts as a turn, and its aileron is the trim of no other start."""
    plain = suite(every_axis=True)
    plain = replace(plain, sensors=tuple(s for s in plain.sensors if s.channel != "thr_cmd"))
    glider = load_aircraft("jsbsim:sgs233", "rigid", commanded_at="surface")
    believed = Believed(glider, plain, FlightCondition(35.0, 800.0), 100.0)
    steps = StandardMultistep(signal="3211", control="da", amplitude_deg=3.0, step_s=0.6)
    (whole,) = measure(believed, 5, inputs=(steps,), duration_s=8.0)
    held = whole.between(3.2, 10.0)
    assert begins_quietly(held)
    assert cut(believed, {"whole": whole}).notes == ()
    (note,) = cut(believed, {"held": held}).notes
    assert note.startswith("'held' is not in trimmed flight as it begins (another start leaves 0.0")
    (window,) = tuple(cut(believed, {"held": held}).records.values())
    there = begin_freely(believed, {"held": window})
    left = float(np.sum(there.residuals(window) ** 2))
    assert left < chi2.isf(RARE, int(np.count_nonzero(there.taken(window))))


def test_windows_of_an_unstable_aircraft_are_short(believed, flown):
    unstable = believed.with_nuisances({"Cm_alpha": -2.0})
    growing = float(unstable.linear.poles().real.max())
    length, why = longest(unstable, flown)
    assert length == pytest.approx(np.log(30.0) / growing)
    assert length < LONGEST_S
    assert why == f"its fastest unstable mode doubles in {np.log(2.0) / growing:.2g} s"


def test_what_cannot_be_cut_is_refused(believed, flown):
    with pytest.raises(RecordError, match=r"at least 2.5 s long to start freely, got 1.99 s \(record 'short'\)"):
        cut(believed, {"short": flown.between(2.0, 4.0)})
    with pytest.raises(RecordError, match="a window must be at least 2 s long, got windows = 1"):
        cut(believed, {"long": flown}, 1.0)
    with pytest.raises(RecordError, match=r"0\.5 s of quiet flight, got 0\.05 s; cut it earlier, or let it be cut"):
        find_gap(believed, {"a": flown}, {}, GapSearch(windows="off"))
    with pytest.raises(RecordError, match="--windows must be auto, off, or a length of at least 2 s, got 'soon'"):
        windows_of("soon")
    assert [windows_of(t) for t in (None, "auto", "off", "4.5")] == [None, "auto", "off", 4.5]


def test_a_free_start_is_projected_out_as_least_squares_would():
    rng = np.random.default_rng(1)
    columns, r = rng.standard_normal((40, 2, 3)) * [1.0, 5.0, 1e-3], rng.standard_normal((40, 2))
    free = FreeStart(("V_m_s", "q", "de"), np.zeros(3), np.array([2.0, 0.1, 0.05]), np.zeros(3), columns)
    found = free.directions(lambda c: c, ("still", b""))
    G = columns.reshape(-1, 3)
    z = np.linalg.solve(G.T @ G + np.eye(3), G.T @ r.ravel())
    left = r.ravel() - G @ z
    assert found.best(r) == pytest.approx(z)
    assert np.sum(found.taken_out(r) ** 2) == pytest.approx(left @ left + z @ z)
    assert found.lost == pytest.approx(np.trace(G @ np.linalg.solve(G.T @ G + np.eye(3), G.T)))
    assert free.shift(np.array([2.0, 0.0, 0.05])) == pytest.approx(columns[..., 0] + columns[..., 2])
    assert free.start(np.array([1.0, 0.2, 0.0])).q == 0.2
    assert free.offsets(np.array([1.0, 0.2, 0.3])) == {"de": 0.3}


def test_a_window_that_lacks_nothing_leaves_noise(begun):
    believed, records = begun
    point = Point.at(believed, believed, records)
    taken = sum(int(np.count_nonzero(believed.taken(r))) for r in records)
    assert 4 * len(records) < taken - point.samples <= 6 * len(records)  # of six parameters each
    low, high = chi2.ppf([RARE, 1.0 - RARE], point.samples)
    assert low < point.chi2 < high


def test_a_start_is_asked_for_before_it_is_known(believed, flown):
    (part,) = cut(believed, {"by hand": flown}).records.values()
    with pytest.raises(RecordError, match="the start of a window must be known before it is flown"):
        believed.predict(part)


def test_nothing_is_said_of_the_air_without_quiet_flight(begun):
    believed, records = begun
    found = listen(believed, records)
    assert not found.moves
    assert found.sentence.startswith("no record begins with quiet flight")


def test_a_wrong_coefficient_is_measured_from_a_hand_flown_record(believed):
    truth = believed.with_nuisances({"Cm_alpha": 1.3})
    records = cut(believed, {"by hand": hand_flown(truth, 3, 7.0)}).records
    began = begin_freely(believed, records)
    naming = name_effect(began, list(records.values()), Sought({}))
    value, error = naming.measured["Cm_alpha"]
    assert error < 0.1  # an unknown motion may be beside it
    assert abs(value - 1.3) < 4.0 * error  # 6e-5
    assert chi2.sf(naming.chi2_tuned, naming.samples) > RARE


def searched(believed, truth, seed):
    """Return what is found in two hand-flown records, a third held out, none of which begins quietly."""
    records = {f"flight {k}": hand_flown(truth, 10 * seed + k, 13.0) for k in range(3)}
    held = {"flight 2": records.pop("flight 2")}
    known = library(believed.suite, believed.aircraft)
    return find_gap(believed, records, held, GapSearch(effects={n: known[n] for n in SOUGHT}))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_no_gap_is_found_where_there_is_none(believed, seed):
    """By FALSE_ALARM one case in a thousand would be called a gap, six of them once in 170 runs of other seeds."""
    found = searched(believed, believed, seed)
    assert found.naming.outcome == "no gap"
    assert found.naming.coefficients == ()
    assert len(found.windows) == 3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "values", "within"),
    [("actuator_lag", {"lag_rad_s": 6.0}, 0.05), ("free_play", {"width_rad": 0.02}, 0.1)],
)
def test_an_effect_is_named_from_hand_flown_records_and_the_gap_shrinks(believed, effect, values, within):
    known = library(believed.suite, believed.aircraft)
    found = searched(believed, believed.with_effect(known[effect], values), 1)
    assert found.naming.names == (effect,)
    (name, value), *_ = values.items()
    assert found.naming.best.values[name] == pytest.approx(value, rel=within)
    assert all(s.removed > 0.8 for s in found.shrink if s.visible)
    assert any(s.visible for s in found.shrink)


@pytest.mark.slow
def test_a_search_from_free_starts_goes_on_with_the_same_answer(believed, tmp_path, monkeypatch):
    """Of fits whose flights were begun anew as they moved, too."""
    truth = believed.with_effect(library(believed.suite, believed.aircraft)["actuator_lag"], {"lag_rad_s": 10.0})
    records = {f"flight {k}": hand_flown(truth, 70 + k, 13.0) for k in range(2)}
    known = library(believed.suite, believed.aircraft)
    how = GapSearch(effects={n: known[n] for n in SOUGHT}, search_file=tmp_path / "search.jsonl")

    def answer():
        found = find_gap(believed, records, {}, how)
        rows = found.naming.weighed.table.rows
        return found.sentences, [(r.name, r.log_evidence, r.posterior.values.tolist()) for r in rows]

    whole = answer()
    lines = how.search_file.read_text("utf-8").splitlines(keepends=True)
    assert len(lines) > 2
    assert any('"moved": [[' in line for line in lines)
    for count in (1, len(lines) // 2, len(lines)):
        how.search_file.write_text("".join(lines[:count]), encoding="utf-8")
        for name in ("_TRIMS", "_NEAR", "_LINEAR", "_FLOWN"):
            monkeypatch.setattr(f"testbench.questions.gap.flights.{name}", flights_module._Kept(512))
        assert answer() == whole


@pytest.mark.slow
def test_an_unstable_aircraft_is_searched_in_short_windows(believed):
    unstable = believed.with_nuisances({"Cm_alpha": -2.0})
    record = hand_flown(unstable, 7, 14.0, gains=(1.0, 0.25))
    found = find_gap(unstable, {"by hand": record}, {}, GapSearch(effects={}))
    assert "its fastest unstable mode doubles in" in found.windows[0]
    assert found.naming.outcome == "no gap"
    assert found.naming.coefficients == ()


def test_what_is_known_of_a_start_follows_its_record(begun):
    """Readings may be replaced, as control flights do: the start is that of the record they replace."""
    believed, (record, *_) = begun
    other = record.with_columns({"q": record["q"] + 0.01})
    assert isinstance(other, FlightRecord)
    assert believed.free_start_of(other) is believed.free_start_of(record)
    assert replace(believed, free_starts={}).with_nuisances({"Cm_q": 1.1}).free_starts == {}


QUICK = StandardMultistep(signal="3211", control="de", amplitude_deg=4.0, step_s=0.25)


@pytest.fixture(scope="module")
def slewing(believed):
    """An elevator of 7 deg/s, and what it flew from 0.3 s after a step of 4 deg on: it is still on its way."""
    truth = believed.with_effect(EFFECTS["rate_limit"], {"limit_rad_s": 7.0 * DEG_RAD})
    return truth, cut(truth, {"piece": begun_late(truth, QUICK, 7.0)}).records


def begun_late(truth, spec, duration_s: float) -> FlightRecord:
    """Return what is flown of an input from 0.3 s after its first step on."""
    (record,) = measure(truth, 3, inputs=(spec,), duration_s=duration_s)
    moved = int(np.flatnonzero(np.abs(record["de_cmd"] - record["de_cmd"][0]) > 0.01)[0])
    return record.between(float(record.t_s[moved]) + 0.3, float(record.t_s[-1]))


def test_a_surface_begins_where_it_is_and_not_where_it_is_commanded(slewing):
    """It lags by 2 deg as the piece begins; taken for where it is commanded, it misfitted by ten times the noise."""
    truth, records = slewing
    began = begin_freely(truth, records)
    (window,) = records.values()
    free = began.free_starts[key_of_start(window)]
    assert free.names[-1] == "de_began"
    found = float(free.origin[-1])
    assert 0.5 * DEG_RAD < abs(found) < 6.0 * DEG_RAD
    point = Point.at(began, began, (window,))
    assert chi2.sf(point.chi2, point.samples) > RARE
    held = replace(free, origin=np.where(np.arange(free.origin.size) == free.origin.size - 1, 0.0, free.origin))
    there = replace(began, free_starts={key_of_start(window): held})
    assert there.cost_of_start(window, held.origin) > 2.0 * began.cost_of_start(window, free.origin)


def test_controls_that_are_not_moved_begin_where_they_are_commanded(begun):
    believed, (record, *_) = begun
    free = believed.free_starts[key_of_start(record)]
    moving = {n for n in ("de", "thr") if np.ptp(record[f"{n}_cmd"]) > 1e-3}
    assert set(free.began(free.origin)) == moving
    assert set(free.offsets(free.origin)) == {"de", "thr"}


def test_a_start_is_sought_from_its_own_origin_too_where_its_neighbour_began_far_off(begun):
    """A neighbour that lacks an effect may begin 8 deg off; a step from there need not come back."""
    believed, (record, *_) = begun
    key = key_of_start(record)
    free = believed.free_starts[key]
    far = free.origin + 3.9 * free.std * np.where(np.arange(free.origin.size) % 2, 1.0, -1.0)
    there = believed.beginning({key: far})
    fly_together([there], [record])
    assert there.begun(record) == pytest.approx(free.origin, abs=0.3 * float(free.std.max()))
    assert there.cost_of_start(record, there.begun(record)) <= believed.cost_of_start(record, free.origin) + 0.1


def test_starts_that_a_poor_model_was_caught_in_are_left_again(believed):
    """A sweep from where the model without the drag had begun: the true one left 1.7 times the noise from there."""
    truth = believed.with_effect(EFFECTS["drag_increment"], {"CD": 0.06})
    sweep = Sweep(signal="sweep", control="de", amplitude_deg=4.0, f_start_hz=0.3, f_end_hz=6.0, sweep_s=10.0)
    records = cut(believed, {"piece": begun_late(truth, sweep, 12.0)}).records
    poor = begin_freely(believed, records)
    anew, again = (begin_freely(before, records, truth).free_starts for before in (believed, poor))
    for window in records.values():
        key = key_of_start(window)
        costs = [replace(truth, free_starts=s).cost_of_start(window, s[key].origin) for s in (anew, again)]
        assert costs[1] < costs[0] + 1.0


def test_a_start_that_fits_the_beginning_and_leaves_the_limits_goes_back_until_it_flies(believed, flown):
    """A small aircraft from its plan, its aileron yaw 42 times: 80 % more throttle fitted the first 3 s alone."""
    window = freed(flown, record_key(flown), level(flown))
    key = key_of_start(window)
    told = replace(begin_freely(believed, {"": window}).free_starts[key])
    k = told.names.index("theta")
    diving = replace(told, origin=told.origin + 1.5 * np.eye(len(told.names))[k])
    there = replace(believed, free_starts={key: diving})
    with pytest.raises(FlightAborted):
        there.read_from(window, diving.origin)
    back = _surviving(believed, {"": window}, {key: told}, {key: diving})[key].origin
    assert replace(believed, free_starts={key: replace(told, origin=back)}).read_from(window, back).shape[0]
    assert told.origin[k] <= back[k] < diving.origin[k]
    assert np.delete(back, k) == pytest.approx(np.delete(told.origin, k))


def after_another(truth: Believed, seed: int, rest_s: float = 2.0) -> FlightRecord:
    """Return a 3-2-1-1 that begins a rest after a throttle doublet: the phugoid dies away as the commands rest."""
    rate, step = truth.suite.rate_hz, round(truth.rate_hz / truth.suite.rate_hz)
    pulse, steps = build((THROTTLE,), 5.0, rate).u, build((ELEVATOR,), 12.0, rate).u
    u = np.zeros((len(pulse) + round(rest_s * rate) + len(steps), 2))
    u[: len(pulse), 1], u[-len(steps) :, 0] = pulse[:, 0], steps[:, 0]
    signal = InputSignal(np.arange(len(u) * step) / truth.rate_hz, np.repeat(u, step, axis=0), ("de", "thr"))
    trimmed = trim(truth.aircraft, truth.condition, truth.rate_hz)
    flown = fly(truth.aircraft, trimmed, Manoeuvre("after another", signal, 0.0), rate)
    return truth.suite.measure(flown, seed).between(len(pulse) / rate, float(flown.t_s[-1]))


@pytest.mark.parametrize("lag_rad_s", [None, 25.0])
def test_a_phugoid_that_dies_away_as_the_commands_rest_is_not_flown_from_trim(believed, lag_rad_s):
    truth = believed if lag_rad_s is None else believed.with_effect(EFFECTS["actuator_lag"], {"lag_rad_s": lag_rad_s})
    record = after_another(truth, 4)
    assert begins_quietly(record)
    found = cut(believed, {"second": record})
    assert "its quiet flight has another initial state" in found.notes[0]
    began = begin_freely(truth, found.records)
    left = sum(float(np.sum(began.residuals(r) ** 2)) for r in found.records.values())
    samples = sum(int(np.count_nonzero(began.taken(r))) for r in found.records.values())
    assert left < chi2.isf(RARE, samples) < float(np.sum(truth.residuals(record) ** 2))


@pytest.mark.parametrize("rms_m_s", [0.0, 0.1, 0.25])
@pytest.mark.parametrize(
    ("effect", "values"), [("actuator_lag", {"lag_rad_s": 8.0}), ("drag_increment", {"CD": 0.02}), ("", {})]
)
def test_turbulence_and_what_the_model_lacks_are_no_other_start(believed, rms_m_s, effect, values):
    truth = believed.with_effect(EFFECTS[effect], values) if effect else believed
    records = {f"{i}": r for i, r in enumerate(measure(truth, 21, rms_m_s))}
    assert cut(believed, records).notes == ()


@pytest.mark.slow
def test_real_records_that_were_wrong_or_refused_are_cut_and_fly(tmp_path):
    """HFB-320 from 5 s on: commands rest for a while, the aircraft does not. ATTAS from within its 3-2-1-1."""
    data = flight_data()
    record = hfb320_record(data)
    speed = float(record["V"][: quiet_samples(record)].mean())
    hfb = believe_real(hfb320(tmp_path / "hfb320"), record, fine_noise(record), speed, altitude_m(HFB_RHO))
    assert cut(hfb, {"3211": record}).notes == ()  # trimmed, in turbulence: as before
    later = record.between(5.0, 30.0)
    assert begins_quietly(later)
    found = cut(hfb, {"later": later})
    assert "'later' is not in trimmed flight as it begins (another start leaves 0.0" in found.notes[0]
    from_trim = np.sum(hfb.residuals(later) ** 2)
    began = begin_freely(hfb, found.records)
    assert sum(np.sum(began.residuals(r) ** 2) for r in found.records.values()) < 0.1 * from_trim
    finding = find_gap(hfb, {"later": later}, {}, GapSearch(effects={"alpha_lag": EFFECTS["alpha_lag"]}))
    assert finding.naming.outcome in ("unexplained", "partial"), finding.naming.sentence
    assert not any("the a-priori C" in s for s in finding.sentences)  # turbulence that is not known pulled at them

    whole = attas_record(data, "fAttasElv1")
    aircraft = attas(tmp_path / "attas")
    model = believe_real(aircraft, whole, quiet_noise([whole]), ATTAS_V, ATTAS_H)
    moved = np.flatnonzero(np.abs(whole["de_cmd"] - whole["de_cmd"][0]) > 0.01)
    piece = whole.between(whole.t_s[moved[0] + 20], whole.t_s[-1])
    found = cut(model, {"Elv1": piece})
    assert "does not begin with quiet flight" in found.notes[0]
    began = begin_freely(model, found.records)
    (window, *_) = found.records.values()
    left = window["q"] - window["q"].mean() - (began.predict(window)[:, 1] - began.predict(window)[:, 1].mean())
    assert np.std(left) < 0.25 * np.std(window["q"])


def test_a_record_that_begins_nearly_at_trim_is_no_gap(believed):
    """The start lies off trim by one prior standard deviation in two states: their price is left, and hardly more."""
    trimmed = trim(believed.aircraft, believed.condition, believed.rate_hz)
    u = build((ELEVATOR.model_copy(update={"start_s": 1.0}),), 9.0, believed.suite.rate_hz)
    step = round(believed.rate_hz / believed.suite.rate_hz)
    fine = InputSignal(np.arange(len(u.t_s) * step) / believed.rate_hz, np.repeat(u.u, step, axis=0), u.channels)
    off = Start(V_m_s=0.003 * believed.condition.V_m_s, theta=0.1 * DEG_RAD)
    flown = fly(believed.aircraft, trimmed, Manoeuvre("off trim", fine, 0.0), believed.suite.rate_hz, start=off)
    record = replace(believed.suite.without_errors().measure(flown, 1), kind="measured")
    left = [float(np.sum(b.residuals(record) ** 2)) for b in (believed, nearly_trimmed(believed, [record]))]
    assert left[1] < 4.0 < 0.05 * left[0]
