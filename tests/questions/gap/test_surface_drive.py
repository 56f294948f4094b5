"""Recorded surfaces drive the believed model where no command is recorded, and wherever a case wants it.

False names: an effect gains what names it by noise with a probability below 1e-3; seeds are fixed.
"""

from __future__ import annotations

import csv
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from commands import ends
from gap.hidden_truths import NOTHING, late_command, measure_truth, rate_feedback, roughness, slow_servo

from testbench.aircraft.seams import control_path
from testbench.core.constants import DEG_RAD
from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord
from testbench.core.scenario.base import Manoeuvre
from testbench.core.scenario.inputs import Doublet, StandardMultistep
from testbench.effects import EFFECTS
from testbench.effects.servo import corner_of
from testbench.flight import FlightCondition, fly, load_aircraft, trim
from testbench.flight import Manoeuvre as Flown
from testbench.inputs import build
from testbench.inputs.signal import InputSignal
from testbench.questions.gap.ask import GapResult
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.drive import BYPASS, drive_records, driven, driven_by
from testbench.questions.gap.evidence.air import AirFound, in_air
from testbench.questions.gap.evidence.commanded import (
    begins_quietly,
    commands,
    jumps,
    moves_laterally,
    quiet_samples,
    surface_noise,
)
from testbench.questions.gap.export import amended_files
from testbench.questions.gap.workflow import GapSearch, find_gap
from testbench.sensors import load_suite
from testbench.sensors.sensor import Sensor
from testbench.sensors.suite import SensorSuite

NOISE_RAD = 0.1 * DEG_RAD
STILL_AIR = AirFound(False, 0.0, 547.0, 0.0, 10.0, 1.0)
FEW = {n: EFFECTS[n] for n in ("actuator_lag", "pitch_damper", "transport_delay", "drag_increment", "q_lag")}
LATE = late_command(0.06)
SLOW = slow_servo(8.0)
STOCK = "jsbsim:c172p"
CONDITIONS = {"eolo": FlightCondition(16.0, 547.0), STOCK: FlightCondition(50.0, 1000.0)}


def believe(noise_rad: float = NOISE_RAD, aircraft: str = "eolo", also_command: bool = False) -> Believed:
    suite = load_suite("eolo_gap")
    kept = tuple(s for s in suite.sensors if also_command or s.channel != "de_cmd")
    suite = replace(suite, rate_hz=50.0, sensors=(*kept, Sensor("de", noise_std=noise_rad)))
    return Believed(load_aircraft(aircraft, "rigid"), suite, CONDITIONS[aircraft], 100.0)


def measure(b: Believed, hidden, seed: int = 3, amplitudes=(2.0, 3.0)) -> dict[str, FlightRecord]:
    inputs = [
        StandardMultistep(signal="3211", control="de", amplitude_deg=a, step_s=s, start_s=0.5)
        for a, s in zip(amplitudes, (0.4, 0.3), strict=False)
    ]
    specs = [
        Manoeuvre(name=f"elevator {i}", use="identification", duration_s=6.0, input=(step,))
        for i, step in enumerate(inputs)
    ]
    name = "eolo" if b.aircraft.adapter is None else STOCK
    return measure_truth(name, hidden, b.suite, b.condition, specs, seed, b.rate_hz)


@cache
def of_nothing(noise_rad: float) -> dict[str, FlightRecord]:
    return measure(believe(noise_rad), NOTHING)


def measured_by(truth: Believed) -> list[FlightRecord]:
    """Return what the sensors of a truth read of two multisteps and a doublet, after two seconds of quiet flight."""
    at, out = trim(truth.aircraft, truth.condition, truth.rate_hz), []
    inputs = [StandardMultistep(signal="3211", control="de", amplitude_deg=3.0, step_s=s) for s in (0.4, 0.7)]
    for seed, spec in enumerate([*inputs, Doublet(signal="doublet", control="de", amplitude_deg=3.0, period_s=1.6)], 1):
        coarse = build((spec,), 7.0, truth.suite.rate_hz)
        u = np.repeat(coarse.u, round(truth.rate_hz / truth.suite.rate_hz), axis=0)
        signal = InputSignal(np.arange(len(u)) / truth.rate_hz, u, coarse.channels)
        flown = fly(truth.aircraft, at, Flown("flight", signal, 2.0), truth.suite.rate_hz)
        out.append(truth.suite.measure(flown, seed))
    return out


def record(**columns: np.ndarray) -> FlightRecord:
    t = np.arange(len(next(iter(columns.values())))) * 0.02
    return FlightRecord(t, tuple(columns), np.column_stack(list(columns.values())), "measured")


def suite_of(**noise: float) -> SensorSuite:
    return SensorSuite("some", "some", 50.0, tuple(Sensor(n, noise_std=s) for n, s in noise.items()))


RAMP = np.clip(np.arange(100) - 50, 0, 20) * 0.005
REST = np.zeros(100)


def test_a_surface_stands_in_place_of_a_command_that_is_not_recorded():
    found = drive_records(suite_of(q=0.1, de=1e-3), {"one": record(q=REST, de=RAMP + 0.1, thr_cmd=REST)})["one"]
    assert dict(surface_noise(found)) == {"de": 1e-3}
    names, u = commands(found)
    assert names == ("de", "thr")
    assert u[:, 0] == pytest.approx(RAMP, abs=1e-4)  # what moves by less than the noise counts as quiet flight
    assert driven_by([found]) == (
        "The recorded deflections of elevator drive the a-priori model, and measured commands otherwise."
    )


def test_commands_that_are_recorded_drive_unless_surfaces_are_wanted():
    both = {"one": record(q=REST, de=RAMP, de_cmd=2.0 * RAMP)}
    suite = suite_of(q=0.1, de=1e-3)
    assert drive_records(suite, both) == both
    assert drive_records(suite, both, "surface")["one"]["de_cmd"] == pytest.approx(RAMP)


@pytest.mark.parametrize("noise", [1e-4, 1e-3, 9e-3])
def test_quiet_flight_ends_where_a_noisy_surface_begins_to_move_and_not_where_it_stands_out_of_its_noise(noise):
    t = np.arange(400) * 0.02
    slow = 0.035 * (1.0 - np.exp(-8.0 * np.clip(t - 3.0, 0.0, None)))  # passes five of the largest noise never
    ends = []
    for seed in range(20):
        de = 0.1 - slow - 2.0 * slow * (t > 4.0) + noise * np.random.default_rng(seed).standard_normal(400)
        flown = record(q=np.zeros(400), de=de)
        ends.append(0.02 * quiet_samples(drive_records(suite_of(q=0.1, de=noise), {"one": flown})["one"]))
    assert np.median(ends) == pytest.approx(3.02, abs=0.1)
    assert min(ends) > 2.8


def test_what_is_certain_of_the_surface_s_sensor_is_taken_out_and_lost_samples_are_bridged():
    sensor = Sensor("de", noise_std=1e-3, bias=0.02, scale=2.0, delay_s=0.04)
    late = np.concatenate([RAMP[:1], RAMP[:1], RAMP[:-2]])
    given = record(q=REST, de=2.0 * late + 0.02)
    valid = np.ones((100, 2), bool)
    valid[60:63, 1] = False
    given = replace(given, data=np.where(valid, given.data, 7.0), valid=valid)
    found = drive_records(SensorSuite("some", "some", 50.0, (sensor,)), {"one": given})["one"]
    assert found["de_cmd"][:-3] == pytest.approx(RAMP[:-3])
    assert surface_noise(found)["de"] == pytest.approx(0.5e-3)


def test_noise_of_a_surface_is_no_movement():
    rng = np.random.default_rng(1)
    shaken = [1e-3 * rng.standard_normal(100) for _ in range(2)]
    found = drive_records(suite_of(q=0.1, de=1e-3, da=1e-3), {"one": record(q=REST, de=RAMP + shaken[0], da=shaken[1])})
    assert begins_quietly(found["one"])
    assert not moves_laterally([found["one"]])
    assert "da_cmd" not in found["one"]  # it never stirs, and the elevator drives
    names, u = commands(found["one"])
    assert names == ("de",)
    assert np.abs(u[:45]).max() < 5e-3


def test_surfaces_that_jump_between_two_samples_are_known():
    step = np.where(np.arange(100) > 50, 0.05, 0.0)
    suite = suite_of(q=0.1, de=1e-3)
    jumped = jumps(drive_records(suite, {"one": record(q=REST, de=step)})["one"], "de")
    assert np.flatnonzero(jumped).tolist() == [50]
    assert jumped[50] == pytest.approx(0.05)
    assert not jumps(drive_records(suite, {"one": record(q=REST, de=RAMP)})["one"], "de").any()


@pytest.mark.parametrize(
    ("records", "drive", "said"),
    [
        ({"one": record(q=REST)}, "both", "must hold what drives the model.*got q "),
        ({"one": record(q=REST, de=RAMP)}, "command", 'de could drive it: set drive = "both"'),
        ({"a": record(q=REST, de=RAMP), "b": record(q=REST, de_cmd=RAMP)}, "both", "'b': de must be recorded, as 'a'"),
        ({"a": record(q=REST, de=RAMP), "b": record(q=REST, de_cmd=RAMP)}, "surface", "'b': de must be recorded"),
    ],
)
def test_records_that_nothing_drives_are_refused(records, drive, said):
    with pytest.raises(RecordError, match=said):
        drive_records(suite_of(q=0.1, de=1e-3), records, drive)


def test_the_model_flies_by_surfaces_as_it_does_by_commands_whatever_its_servo():
    """Twelve times slower than believed: by surfaces the residuals are those of the right servo."""
    b = believe(0.0, also_command=True)
    records = measure(b, NOTHING, amplitudes=(2.0,))
    slow = b.with_effect(EFFECTS["actuator_lag"], {"lag_rad_s": 2.0})
    driving, recorded, paths = driven(slow, records, "surface")
    (one,) = records
    right, wrong, found = (m.residuals(r[one]) for m, r in ((b, records), (slow, records), (driving, recorded)))
    assert float(np.sum(wrong**2)) > 3.0 * float(np.sum(right**2))
    assert np.abs(found - right).max() < 0.5  # of the noise: what lies between two samples of the surface
    assert float(np.mean((found - right) ** 2)) < 0.1 * np.sqrt(2.0 / right.size)  # a tenth of what noise scatters by
    assert paths[0].why == 'drive = "surface" asks for it'
    assert "de" not in driving.outputs


def test_noise_of_the_surface_is_taken_out_as_a_gust_would_be():
    """Half a degree: five times that of any other test. White residuals leave no more than their number."""
    noise = 5.0 * NOISE_RAD
    driving, recorded, _ = driven(believe(noise), of_nothing(noise), "both")
    n = sum(int(driving.taken(r).sum()) for r in recorded.values())
    plain, white = (
        sum(float(np.sum(m.residuals(r) ** 2)) for r in recorded.values())
        for m in (driving, in_air(driving, STILL_AIR))
    )
    assert plain > n + 8.0 * np.sqrt(2.0 * n)
    assert abs(white - n) < 4.0 * np.sqrt(2.0 * n)


def test_nothing_of_the_servo_is_left_in_the_model_that_surfaces_drive():
    b = believe()
    driving, _, paths = driven(b, of_nothing(NOISE_RAD), "both")
    assert corner_of(driving.aircraft, "de") > 10.0 * corner_of(b.aircraft, "de")
    assert driving.aircraft.amendments[-1].name == BYPASS
    assert control_path(driving.aircraft, "de").lag == control_path(b.aircraft, "de").lag
    (path,) = paths
    assert (path.control, path.why) == ("de", "its command, de_cmd, is not recorded")
    assert {"actuator_lag", "pitch_damper", "transport_delay", "free_play", "clock_offset"} <= set(path.effects)
    assert not {"surface_scale", "drag_increment"} & set(path.effects)


def test_a_model_that_turns_the_surface_itself_cannot_be_driven_by_it():
    damped = believe().with_effect(EFFECTS["pitch_damper"], {"gain_s": 0.1})
    with pytest.raises(RecordError, match="cannot drive a model that moves it by feedback"):
        driven(damped, of_nothing(NOISE_RAD), "both")


@pytest.mark.parametrize("hidden", [SLOW, rate_feedback(0.1)], ids=["slow servo", "feedback"])
def test_what_is_wrong_with_a_servo_is_not_seen_and_names_nothing(hidden):
    b = believe()
    finding = find_gap(b, measure(b, hidden, amplitudes=(2.0,)), {}, GapSearch(effects=FEW))
    assert (finding.naming.outcome, finding.naming.names) == ("no gap", ())
    effects = {f.effect.name for f in finding.naming.ranking if not f.coefficients}
    assert effects <= {"drag_increment", "q_lag"}
    assert finding.sentences[1].startswith("the path of the elevator could not be seen: its command, de_cmd, is not")


@pytest.mark.parametrize("hidden", [pytest.param(NOTHING, marks=pytest.mark.slow), SLOW], ids=["none", "slow servo"])
def test_pieces_of_flights_are_cut_and_searched_by_their_surface_alone(hidden):
    """They begin while the elevator rests after its first step, and the aircraft does not: from trim it would stall."""
    b, pieces = believe(), {}
    for name, given in measure(b, hidden, seed=11, amplitudes=(3.0, 3.0)).items():
        moved = int(np.flatnonzero(np.abs(given["de"] - given["de"][:20].mean()) > 0.02)[0])
        pieces[name] = given.between(float(given.t_s[moved]) + 0.2, float(given.t_s[-1]))
    finding = find_gap(b, pieces, {}, GapSearch(effects=FEW))
    assert finding.naming.outcome == "no gap"
    assert len(finding.windows) == len(pieces)
    assert "is not recorded" in finding.paths[0].why


def test_what_the_air_feels_is_named_by_surfaces_alone_and_the_servo_stays_in_its_files():
    b = believe()
    finding = find_gap(b, measure(b, roughness(0.04), amplitudes=(3.0,)), {}, GapSearch(effects=FEW))
    best = finding.naming.best
    assert best is not None, finding.sentences
    assert finding.naming.names == ("drag_increment",)
    assert abs(best.values["CD"] - 0.04) < 4.0 * best.errors["CD"]
    files = amended_files(GapResult("some", "", "", "eolo", {}, finding))
    changed = [line for line in files["model.diff"].splitlines() if line.startswith(("+", "-"))]
    assert not any("lag-rad_sec" in line or "rate-limit" in line for line in changed)
    assert not any("recorded" in text for text in files.values())


@pytest.mark.slow
@pytest.mark.parametrize("aircraft", ["eolo", STOCK])
@pytest.mark.parametrize("hidden", [NOTHING, LATE, SLOW], ids=["none", "late", "slow servo"])
@pytest.mark.parametrize("noise_rad", [0.0, NOISE_RAD, 5.0 * NOISE_RAD])
def test_the_whole_library_finds_no_gap_where_only_the_path_differs(aircraft, hidden, noise_rad):
    """A stock model without a servo moves its surface in jumps, a servo in none: neither is a gap."""
    b = believe(noise_rad, aircraft)
    finding = find_gap(b, measure(b, hidden, seed=11), {})
    assert finding.naming.outcome == "no gap", finding.sentences[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "values"),
    [("alpha_dot", {"Cm_alphadot": -8.0}), ("curved_moment", {"Cm_alpha2": -3.0}), ("az_lag", {"lag_s": 0.06})],
)
def test_the_whole_library_names_what_a_stock_model_lacks_by_its_surface_alone(effect, values):
    """c172p with a servo of 10 rad/s that the model does not have, either."""
    b = believe(aircraft=STOCK)
    truth = b.with_effect(EFFECTS[effect], values).with_effect(EFFECTS["actuator_lag"], {"lag_rad_s": 10.0})
    *records, held_out = measured_by(truth)
    finding = find_gap(b, {f"flight {i}": r for i, r in enumerate(records)}, {"held out": held_out})
    best = finding.naming.best
    assert effect in finding.naming.names, finding.sentences[0]
    assert best is not None
    (name, value), *_ = values.items()
    assert abs(best.values[name] - value) < 4.0 * best.errors[name]


def test_throttle_and_elevator_may_be_driven_by_what_was_recorded_of_both():
    found = drive_records(suite_of(q=0.1, de=1e-3), {"one": record(q=REST, de=RAMP, thr=0.5 + 10.0 * RAMP)})["one"]
    assert commands(found)[0] == ("de", "thr")


@pytest.mark.slow
def test_records_that_hold_surfaces_alone_become_a_case_that_names_what_is_missing(tmp_path, monkeypatch, capsys):
    """By the command line: a case is made of the records, checked, and asked; commands alone would not do."""
    monkeypatch.chdir(tmp_path)
    b = believe()
    records = measure(b, roughness(0.05))
    for i, given in enumerate(records.values()):
        given.select([n for n in given.channels if not n.endswith("_cmd")]).save(f"flight_{i}.nc")
    flown = [f"flight_{i}.nc" for i in range(len(records))]
    assert (
        ends(monkeypatch, capsys, "gap", "new", "mine.toml", "--aircraft", "eolo", "--wings", "rigid", *flown)[0] == 0
    )
    text = (tmp_path / "mine.toml").read_text(encoding="utf-8")
    few = text.replace('# effects = ["actuator_lag"]', 'effects = ["actuator_lag", "drag_increment", "q_lag"]')
    (tmp_path / "mine.toml").write_text(few, encoding="utf-8")
    assert ends(monkeypatch, capsys, "check", "mine.toml")[0] == 0
    status, lines = ends(monkeypatch, capsys, "gap", "mine.toml", "--workers", "1")
    assert status == 0, lines
    results = tmp_path / "results" / "gap_mine"
    (first, *_) = csv.DictReader((results / "tables" / "ranking.csv").read_text(encoding="utf-8").splitlines())
    assert first["effect"] == EFFECTS["drag_increment"].title
    page = (results / "report.html").read_text(encoding="utf-8")
    assert "path of the elevator could not be seen" in page
    assert "The recorded deflections of elevator drive the a-priori model" in page
    with_commands = few.replace('drive = "both"', 'drive = "command"')
    (tmp_path / "mine.toml").write_text(with_commands, encoding="utf-8")
    status, lines = ends(monkeypatch, capsys, "gap", "mine.toml", "--workers", "1")
    assert status != 0
    assert 'de could drive it: set drive = "both"' in " ".join(" ".join(lines).split())
    plain = ["gap", "eolo", *flown, "--wings", "rigid", "--sensors", "mine_sensors.toml"]
    status, lines = ends(monkeypatch, capsys, *plain, "--drive", "command")
    assert status != 0
    assert "could drive it" in " ".join(" ".join(lines).split())
