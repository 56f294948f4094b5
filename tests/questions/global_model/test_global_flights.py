"""Global models of simulated flights: held-out flights, refusals, and aircraft that have the functions."""

from dataclasses import replace

import numpy as np
import pytest
from global_flights import aircraft_of, at_states, coefficients_of, drawn, given_states, logs, truths

import testbench as tb
from testbench.core.errors import ChannelError, EstimationError
from testbench.questions.global_model.amend import amend, with_functions
from testbench.questions.global_model.answer import global_answer
from testbench.questions.global_model.ask import flights_of, global_model
from testbench.questions.global_model.coefficients import COEFFICIENTS
from testbench.questions.global_model.page import domain_table, held_table, terms_table

H_M = 3000.0


@pytest.fixture(scope="module")
def flown():
    return logs("T38", 1, count=5, duration_s=20.0)


@pytest.fixture(scope="module")
def found(flown):
    return global_model(flown, aircraft_of("T38"), hold_out=["log3"])


def total(aircraft, states, V_ref, h_m, others):
    """Coefficients of an aircraft, and of others with what reactions add, all with the same engines."""
    given = given_states(aircraft, states, V_ref, h_m)
    base, *forces = at_states([aircraft, *others], given, V_ref, h_m)
    out = [coefficients_of(aircraft, base, states)]
    for f in forces:
        more = f.mass_kg[:, None] * f.mean_acceleration - base.mass_kg[:, None] * base.mean_acceleration
        moment = np.einsum("nij,nj->ni", base.inertia, f.rotation - base.rotation)
        out.append(coefficients_of(aircraft, base, states, more, moment))
    return out


def test_functions_are_near_the_tables_and_held_out_flights_follow(found):
    states = drawn(found.model.domain, np.random.default_rng(0), 200)
    (truth,) = total(found.aircraft, states, found.V_ref_m_s, H_M, [])
    for c in COEFFICIENTS:
        value, std = found.model.at(states)[c]
        assert np.mean(np.abs(value - truth[c]) <= 0.08 * np.ptp(truth[c])) > 0.9, c
        assert np.all(std > 0.0)
    assert [f.name for f in found.of_use("validation")] == ["log3"]
    for h in found.held:
        assert h.missed < 1.6 * h.fitted, h
        assert h.r2 > 0.7, h  # noise of the instruments is in it


def test_the_page_says_what_holds_and_where(found):
    said = [line.text for line in global_answer(found)]
    assert "6 coefficients of T38" in said[0]
    assert any("eld-out log3: errors of CL" in s for s in said)
    assert any("gives no value" in s for s in said)
    assert [r[0] for r in held_table(found).rows] == list(COEFFICIENTS)
    assert len(terms_table(found).rows) == sum(len(f.terms) for f in found.model.functions.values())
    assert len(domain_table(found).rows) == len(found.model.domain.alpha)


def test_the_flight_in_the_middle_is_held_out_if_nobody_says(flown):
    some = global_model(flown[:4], aircraft_of("T38"))
    alpha = {n: np.mean(r["alpha"]) for n, _, r in flown[:4]}
    (held,) = some.of_use("validation")
    assert held.name not in (min(alpha, key=alpha.get), max(alpha, key=alpha.get))


def test_errors_of_instruments_widen_the_functions(flown, found):
    wide = global_model(flown, aircraft_of("T38"), hold_out=["log3"], instrument_std={"alpha_scale": 0.05})
    before, after = found.model.functions["CL"], wide.model.functions["CL"]
    i = before.terms.index("alpha")
    assert after.params == pytest.approx(before.params)
    assert after.std[i] == pytest.approx(0.05 * before.params[i], rel=0.2)


def without(flown, channel):
    return [(n, use, r.select([c for c in r.channels if c != channel])) for n, use, r in flown]


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (lambda f: (f[:3], {}), EstimationError, "needs 3 flights to fit"),
        (lambda f: (f, {"hold_out": ["log9"]}), EstimationError, "got 'log9'"),
        (lambda f: ([(n, u, replace(r, kind="truth")) for n, u, r in f], {}), EstimationError, "measured records only"),
        (lambda f: (without(f, "ay"), {}), ChannelError, "lacks ay"),
        (lambda f: (without(f, "dr"), {}), ChannelError, "lacks dr"),
    ],
)  # fmt: skip
def test_what_gives_no_global_model_is_refused(flown, change, error, message):
    given, settings = change(flown)
    with pytest.raises(error, match=message):
        global_model(given, aircraft_of("T38"), **settings)


def test_a_record_of_commands_gets_its_surfaces_from_the_believed_servo(flown):
    commanded = []
    for n, use, r in flown:
        names = tuple(f"{c}_cmd" if c in ("de", "da", "dr") else c for c in r.channels)
        commanded.append((n, use, replace(r, channels=names)))
    some = global_model(commanded, aircraft_of("T38"), hold_out=["log3"])
    assert any("a-priori servo" in note for note in some.notes)
    assert some.model.functions["Cm"].params[0] == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("own_form", [False, True])
def test_an_aircraft_has_the_functions_inside_and_its_own_beyond(found, own_form):
    if own_form:  # the functions of another aircraft, at its speed: what is asked is how they are written
        found, h = replace(found, aircraft=tb.load_aircraft("eolo", "rigid"), V_ref_m_s=16.0), 547.0
    else:
        h = H_M
    base, new = found.aircraft, with_functions(found)
    domain = found.model.domain
    inside = drawn(domain, np.random.default_rng(1), 60)
    slow = {**inside, "V_rel": np.full(60, 0.0)} if own_form else inside
    edge = {k: v.copy() for k, v in inside.items()}
    k = domain.signals.index("beta")
    half, middle = (np.interp(edge["alpha"], domain.alpha, x[:, k]) for x in (domain.half, domain.middle))
    edge["beta"] = middle + 1.25 * half
    beyond = {**inside, "beta": middle + 4.0 * half}
    for states in (slow, edge, beyond):
        share = np.clip((1.5 - domain.distance(states)) / 0.5, 0.0, 1.0)
        believed, amended = total(base, states, found.V_ref_m_s, h, [new])
        for c in COEFFICIENTS:
            aim = share * found.model.functions[c].at(states)[0] + (1.0 - share) * believed[c]
            assert np.allclose(amended[c], aim, atol=2e-5 * np.ptp(aim) + 1e-7), c
    assert np.all(domain.distance(edge) >= 1.0)
    assert np.all(np.clip((1.5 - domain.distance(beyond)) / 0.5, 0.0, 1.0) == 0.0)


def test_the_amended_aircraft_is_written_loaded_and_flies(found, tmp_path):
    done = amend(found, str(tmp_path / "t38_flown"), "jsbsim:T38")
    new, folder = done.new
    assert (folder / "SOURCES.md").read_text("utf-8").count("alpha") > 3
    trimmed = tb.trim(new, tb.FlightCondition(110.0, H_M))
    old = tb.trim(found.aircraft, tb.FlightCondition(110.0, H_M))
    assert trimmed.alpha == pytest.approx(old.alpha, abs=0.01)
    signal = tb.InputSignal([0.0, 0.005], [[0.01], [0.01]], ("de",))
    record = tb.fly(new, trimmed, tb.Manoeuvre("pulse", signal, settle_s=2.0), 100.0)
    assert record.outcome == "completed"
    assert "has these functions inside" in global_answer(done)[1].text


def test_flights_come_from_records_and_descriptions(flown, tmp_path):
    flown[0][2].save(tmp_path / "log1.nc")
    ((name, use, record),), description = flights_of(tmp_path / "log1.nc")
    assert (name, use, description) == ("log1", "identification", None)
    assert np.allclose(record["alpha"], flown[0][2]["alpha"])
    assert truths("T38", count=5, duration_s=20.0)[0].kind == "truth"
