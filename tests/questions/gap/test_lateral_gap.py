"""Lateral-directional flight: hidden truths in roll and yaw are named, and longitudinal records pay nothing for it.

False alarms: a case without an effect is named with probability 1e-3 (fit.FALSE_ALARM), and an estimate
lies four standard errors off with probability 6e-5; seeds are fixed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap.hidden_truths import NOTHING, measure_truth, scaled_sensor, yaw_damper
from gap_fits import check_sizes, fits
from gap_flights import believe as believe_longitudinal
from gap_flights import measure as measure_longitudinal
from studies.blind.truth import Truth

from testbench.core.paths import SCENARIOS
from testbench.core.record import FlightRecord
from testbench.core.scenario.base import Manoeuvre
from testbench.core.scenario.inputs import Doublet, StandardMultistep
from testbench.effects import EFFECTS, library
from testbench.flight import FlightCondition, load_aircraft
from testbench.questions.gap.ask import run_gap
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.air import listen
from testbench.questions.gap.evidence.check import check_instruments
from testbench.questions.gap.evidence.commanded import moves_laterally
from testbench.questions.gap.evidence.locate import locate_regions
from testbench.questions.gap.explain import Naming
from testbench.questions.gap.name import Sought, _Asker, name_effect, not_sought
from testbench.questions.gap.plan import Foreseen, as_record, family, usual_sizes
from testbench.questions.gap.priors import LATERAL_PRIORS, PRIORS, priors_of
from testbench.questions.gap.records import Said, load_flights
from testbench.questions.gap.result import TOLERANCE
from testbench.questions.gap.search.point import Point, retune
from testbench.questions.gap.workflow import GapSearch, find_gap, in_measured_air
from testbench.sensors import load_suite

CONDITIONS = {"eolo": FlightCondition(16.0, 547.0), "taurus": FlightCondition(15.0, 100.0)}
RATE_HZ = 100.0
FEW = ("yaw_damper", "rudder_lag", "beta_scale", "r_scale")
# The rudder of the taurus is seven times as powerful as that of the eolo.
RUDDER = {
    aircraft: Manoeuvre(
        name="rudder 3211",
        use="identification",
        duration_s=10.0,
        input=(StandardMultistep(signal="3211", control="dr", amplitude_deg=amplitude, step_s=0.5),),
    )
    for aircraft, amplitude in (("eolo", 6.0), ("taurus", 2.0))
}
AILERON = Manoeuvre(
    name="aileron doublet",
    use="identification",
    duration_s=10.0,
    input=(Doublet(signal="doublet", control="da", amplitude_deg=4.0, period_s=1.6),),
)
ELEVATOR = Manoeuvre(
    name="elevator doublet",
    use="identification",
    duration_s=6.0,
    input=(Doublet(signal="doublet", control="de", amplitude_deg=2.0, period_s=1.0),),
)


def believe(aircraft: str) -> Believed:
    suite = replace(load_suite("eolo_gap_lateral"), rate_hz=50.0)
    return Believed(load_aircraft(aircraft, "rigid"), suite, CONDITIONS[aircraft], RATE_HZ)


def hidden(aircraft: str, truth: Truth, seed: int = 3, spec=None) -> list[FlightRecord]:
    b, spec = believe(aircraft), spec or (RUDDER[aircraft], AILERON)
    return list(measure_truth(aircraft, truth, b.suite, b.condition, spec, seed, RATE_HZ).values())


NAMED: dict[tuple[str, int], tuple[Truth, Naming]] = {}  # a truth is kept, so that no other gets its id


def named(aircraft: str, truth: Truth) -> Naming:
    if (aircraft, id(truth)) not in NAMED:
        b = believe(aircraft)
        lib = library(b.suite)
        found = name_effect(b, hidden(aircraft, truth), Sought({n: lib[n] for n in FEW}, pairs=False))
        NAMED[aircraft, id(truth)] = truth, found
    return NAMED[aircraft, id(truth)][1]


DAMPER = yaw_damper(0.3, 2.0)


@pytest.mark.parametrize("aircraft", [pytest.param("taurus", marks=pytest.mark.slow), "eolo"])
def test_a_hidden_yaw_damper_is_named_with_its_gain(aircraft):
    naming = named(aircraft, DAMPER)
    assert (naming.outcome, naming.names) == ("named", ("yaw_damper",)), naming.sentence
    best = naming.best
    for name, true in (("gain_s", 0.3), ("washout_rad_s", 0.5)):
        assert abs(best.values[name] - true) < 4.0 * best.errors[name], best.size
        assert best.errors[name] < 0.3 * true
    assert set(best.nuisances) == set(PRIORS) | set(LATERAL_PRIORS)


@pytest.mark.parametrize(("channel", "gain"), [("beta", 1.2), pytest.param("r", 1.1, marks=pytest.mark.slow)])
def test_a_scale_error_of_a_lateral_sensor_is_named(channel, gain):
    naming = named("taurus", scaled_sensor(channel, gain))
    assert (naming.outcome, naming.names) == ("named", (f"{channel}_scale",)), naming.sentence
    assert abs(naming.best.values["scale"] - gain) < 4.0 * naming.best.errors["scale"]


@pytest.mark.slow
def test_lateral_coefficients_off_by_their_priors_are_no_gap():
    """As far as one deviation each, of either sign; without re-tuning them the residual would be far from noise."""
    b = believe("eolo")
    signs = [(-1.0) ** i for i in range(len(LATERAL_PRIORS))]
    off = {n: 1.0 + s * d for s, (n, d) in zip(signs, LATERAL_PRIORS.items(), strict=True)}
    records = recorded(b.with_nuisances(off), hidden("eolo", NOTHING))
    naming = name_effect(b, records, Sought({n: library(b.suite)[n] for n in FEW}))
    assert (naming.outcome, naming.best) == ("no gap", None), naming.sentence
    assert naming.chi2_believed > 1.2 * naming.chi2_tuned


def test_re_tuning_rests_at_the_noise_where_cross_derivatives_are_far_off():
    """Tangents bend over tens of degrees: with those of the believed values alone, ten rounds end far above noise."""
    b = believe("taurus")
    off = b.with_nuisances({"Cn_da": 0.5, "Cl_beta": 1.2, "Cn_dr": 1.1, "Cn_beta": 0.85})
    records = tuple(recorded(off, hidden("taurus", NOTHING)))
    start = Point.at(b, b, records)
    tuned = retune(start)
    assert start.chi2 > 10.0 * start.exact.size
    # White noise alone: chi-square over n samples scatters by sqrt(2 n), here five of it (3e-7); priors cost some.
    assert tuned.chi2 < tuned.exact.size + 5.0 * np.sqrt(2.0 * tuned.exact.size)
    assert tuned.by_name["Cn_da"] == pytest.approx(0.5, abs=0.05)


def recorded(model: Believed, commands: list[FlightRecord], noise: int = 5) -> list[FlightRecord]:
    """What the sensors of ``model`` would have read of the commands of records, with white noise."""
    out = []
    for i, c in enumerate(commands):
        names = [n for n in c.channels if n.endswith("_cmd")]
        y = model.predict(c)
        y = y + model.noise_std * np.random.default_rng(noise + i).standard_normal(y.shape)
        data = np.column_stack([y, c.columns(names)])
        out.append(FlightRecord(t_s=c.t_s, channels=(*model.outputs, *names), data=data, kind="measured"))
    return out


@pytest.fixture(scope="module")
def base() -> Point:
    b = believe("taurus")
    return retune(Point.at(b, b, tuple(hidden("taurus", NOTHING))))


def test_lateral_records_screen_out_what_they_cannot_show(base):
    lib = library(base.believed.suite)
    silent = ("actuator_lag", "transport_delay", "thrust_lag", "surface_scale", "r_bias", "beta_bias")
    shown = ("yaw_damper", "rudder_lag", "aileron_lag", "beta_scale", "beta_position", "ay_position", "r_lag")
    asker = _Asker(base.believed, base.records, "simulated")
    near = asker.near([lib[n] for n in (*silent, *shown) if not not_sought(base, lib[n])])
    seen = {one.effect.name for one in near}
    assert {n: n not in seen for n in (*silent, *shown)} == {
        **dict.fromkeys(silent, True),
        **dict.fromkeys(shown, False),
    }


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("name", "true"),
    [
        pytest.param("yaw_damper", {"gain_s": 0.2, "washout_rad_s": 0.4}, marks=pytest.mark.slow),
        ("yaw_damper", {"gain_s": -0.01, "washout_rad_s": 1.5}),
        ("rudder_lag", {"lag_rad_s": 12.0}),
        ("aileron_lag", {"lag_rad_s": 15.0}),
        ("p_cross", {"share": 0.06}),
        ("q_cross", {"share": -0.08}),
        ("r_cross", {"share": -0.04}),
        ("ay_cross", {"share": 0.05}),
    ],
)
def test_a_lateral_effect_is_recovered_from_data_without_noise_that_it_made(name, true, base):
    b = base.believed
    effect = library(b.suite)[name]
    records = [
        replace(r, data=np.column_stack([b.with_effect(effect, true).predict(r), r.data[:, len(b.outputs) :]]))
        for r in base.records
    ]
    start = Point.at(b, b, tuple(records))
    (found,) = fits(b, records, effect)
    assert found.chi2 < max(0.001 * start.chi2, 0.1)
    check_sizes(found, true, 0.03)


def test_a_yaw_damper_without_gain_changes_nothing_and_damps_with_the_sign_of_its_words():
    b, record = believe("taurus"), hidden("taurus", NOTHING)[0]
    effect = EFFECTS["yaw_damper"]
    plain, r = b.predict(record), b.outputs.index("r")
    same = b.with_effect(effect, {"gain_s": 0.0, "washout_rad_s": 1.0}).predict(record)
    assert np.max(np.abs(same - plain) / np.ptp(plain, axis=0)) < 1e-6  # a term of size zero still rounds
    damped, urged = (
        b.with_effect(effect, {"gain_s": g, "washout_rad_s": 0.3}).predict(record)[:, r] for g in (0.1, -0.03)
    )
    last = slice(-200, None)  # long after the input
    assert np.ptp(damped[last]) < 0.7 * np.ptp(plain[last, r])
    assert np.ptp(plain[last, r]) < 0.7 * np.ptp(urged[last])


def test_longitudinal_records_are_re_tuned_as_ever_and_not_asked_for_lateral_effects():
    b = believe_longitudinal()
    records = tuple(measure_longitudinal(b, 4, duration_s=4.0))
    assert not moves_laterally(records)
    assert priors_of(records) is PRIORS
    point = Point.at(b, b, records)
    for name in ("yaw_damper", "rudder_lag", "aileron_lag"):
        assert "neither aileron nor rudder" in not_sought(point, EFFECTS[name])
    still = replace(believe("eolo"), condition=b.condition)
    assert priors_of(hidden("eolo", NOTHING, spec=(ELEVATOR,))) is PRIORS, "commands held count not"
    assert still.outputs != b.outputs


def test_where_lateral_motion_alone_is_read_longitudinal_coefficients_are_believed():
    """They would show in turns alone: real records of aileron and rudder took CD to 180 times its value."""
    suite = load_suite("eolo_alpha_beta")
    lateral = tuple(s for s in suite.sensors if s.channel in ("beta", "p", "r", "phi", "da", "dr"))
    believed = Believed(load_aircraft("eolo", "rigid"), replace(suite, sensors=lateral), CONDITIONS["eolo"], RATE_HZ)
    assert set(believed.priors_of([as_record(believed, RUDDER["eolo"])])) == set(LATERAL_PRIORS)


def test_lateral_tangents_are_those_of_flights(base):
    """Against differences of flights: a sign or a swapped column would be off by more than the whole of it.

    The linear ones are up to a fifth off where the taurus sideslips by 8 deg; residuals are those of flights always.
    """
    for name in ("Cn_beta", "Cl_da", "Cn_dr", "Cl_p"):
        i = list(base.priors).index(name)
        step = 0.02 * np.eye(len(base.priors))[i]
        up, down = (base.moved(base.model, base.nuisances + s * step).exact for s in (1.0, -1.0))
        flown = (up - down) / 0.04
        assert np.linalg.norm(base.tangents[:, i] - flown) < 0.3 * np.linalg.norm(flown), name


def test_the_check_of_the_instruments_takes_lateral_kinematics():
    """With the wings level believed, a turn would be blamed on the alpha vane."""
    b = believe("taurus")
    found = check_instruments(b.suite, hidden("taurus", scaled_sensor("beta", 1.2)))
    assert found.fault.name == "beta_scale"


def test_a_plan_with_the_rudder_sees_a_yaw_damper_and_may_add_lateral_manoeuvres():
    b = believe("taurus")
    effects = tuple(EFFECTS[n] for n in ("yaw_damper", "actuator_lag"))
    points = usual_sizes(effects)
    rudder = Foreseen.of(b, [as_record(b, RUDDER["taurus"])], points)
    assert len(rudder.coefficients) == len(PRIORS) + len(LATERAL_PRIORS)
    assert set(rudder.effects) == {"yaw_damper"}
    assert rudder.few.at_usual_size(rudder.few.sums)["yaw_damper"] > 0.9
    elevator = Foreseen.of(b, [as_record(b, ELEVATOR)], points)
    assert set(elevator.effects) == {"actuator_lag"}
    names = {m.name for m, _ in family(b, [RUDDER["taurus"]])}
    assert {"rudder 3211", "aileron doublet", "turn"} <= names
    assert not {"rudder 3211", "aileron doublet", "turn"} & {m.name for m, _ in family(b, [ELEVATOR])}
    added = family(b, [RUDDER["taurus"]])
    assert added[-1][1].endswith("for 1 s into a turn, held for 18 s")
    times = {m.name: m.duration_s for m, _ in added}
    assert [times[n] for n in ("rudder 3211", "aileron doublet", "short rudder doublets", "turn")] == [12, 12, 12, 20]
    aileron = next(m.input[0] for m, _ in added if m.name == "aileron doublet")
    assert aileron.amplitude_deg == pytest.approx(2.0)  # where none was flown or planned


def test_residuals_are_located_over_sideslip_and_rudder_where_they_move(base):
    residuals = [base.believed.residuals(r) for r in base.records]
    taken = [base.believed.taken(r) for r in base.records]
    quantities = {m.quantity for m in locate_regions(base.records, residuals, base.believed.outputs, taken)}
    assert {"beta", "p", "r", "da_cmd", "dr_cmd"} <= quantities
    only = hidden("taurus", NOTHING, spec=(ELEVATOR,))
    flat, every = np.ones((len(only[0]), 10)), np.ones((len(only[0]), 10), bool)
    quantities = {m.quantity for m in locate_regions(only, [flat], base.believed.outputs, [every])}
    assert not quantities & {"beta", "p", "r", "da_cmd", "dr_cmd"}


def test_what_moves_roll_and_yaw_alone_is_not_immaterial():
    """A damper moves none of the longitudinal channels: those alone would call it immaterial."""
    assert {"beta", "p", "r", "phi"} <= set(TOLERANCE)


@pytest.mark.slow
def test_records_of_rudder_and_aileron_are_read_from_files_and_named(tmp_path):
    suite = load_suite("eolo_gap_lateral")
    few = {n: library(suite)[n] for n in FEW[:2]}
    specs = [m.model_copy(update={"duration_s": 6.0}) for m in (RUDDER["taurus"], AILERON, RUDDER["taurus"])]
    specs[2] = specs[2].model_copy(update={"name": "again"})
    records = measure_truth("taurus", DAMPER, suite, CONDITIONS["taurus"], specs, 7, 300.0)
    files = [r.save(tmp_path / f"{i}.nc") for i, r in enumerate(records.values())]
    flights = load_flights("taurus", files, said=Said("eolo_gap_lateral"), wings="rigid")
    assert list(flights.held_out) == ["again"]
    finding = find_gap(flights.believed, flights.naming, flights.held_out, GapSearch(effects=few))
    assert finding.naming.names == ("yaw_damper",)
    assert not finding.immaterial
    assert finding.shrink[0].removed > 0.95


@pytest.mark.slow
def test_the_case_of_the_scenario_is_solved_among_the_whole_library():
    finding = run_gap(SCENARIOS / "gap" / "yaw_damper.toml").finding
    assert finding.naming.names[0] == "yaw_damper", finding.naming.sentence
    assert set(finding.naming.names) <= {"yaw_damper", "filtered_yaw_damper"}  # which holds it, with a lag of nothing
    best = finding.naming.best
    assert abs(best.values["gain_s"] - 0.3) < 4.0 * best.errors["gain_s"]
    assert finding.shrink[0].removed > 0.9


@pytest.mark.slow
def test_in_turbulence_nothing_lateral_is_named_and_a_slow_rudder_is():
    """False alarm of the first 1e-3; the rudder's corner lies four standard errors off with probability 6e-5."""
    b, few = believe("eolo"), ("yaw_damper", "rudder_lag", "aileron_lag", "beta_scale")
    effects = {n: library(b.suite)[n] for n in few}
    inputs = (RUDDER["eolo"].input[0], AILERON.input[0])
    slow = b.with_effect(EFFECTS["rudder_lag"], {"lag_rad_s": 5.0})
    nothing, late = (measure_longitudinal(truth, 31, 0.25, inputs, 10.0) for truth in (b, slow))
    moved, by_late = (in_measured_air(b, records, listen(b, records))[0] for records in (nothing, late))
    assert name_effect(moved, nothing, Sought(effects, pairs=False)).outcome == "no gap"
    naming = name_effect(by_late, late, Sought(effects, pairs=False))
    assert naming.names == ("rudder_lag",), naming.sentence
    best = naming.best
    assert abs(best.values["lag_rad_s"] - 5.0) < 4.0 * best.errors["lag_rad_s"]
