"""Derivatives of flights by their parameters: against JSBSim, against what is known exactly, and at a kink."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

import testbench as tb
from testbench.aircraft import Aircraft, ScaleCoefficient
from testbench.aircraft.amend import Amendment, Insert, SetProperty
from testbench.aircraft.believed import varied
from testbench.core.errors import LimitError, ModelError
from testbench.core.record import FlightAborted, FloatArray

CONDITIONS = {
    "taurus": tb.FlightCondition(13.0, 100.0),
    "eolo": tb.FlightCondition(16.0, 547.0),
    "jsbsim:c172p": tb.FlightCondition(43.0, 1000.0),
}
KEYS = {
    "taurus": ("coefficient.Cm_alpha", "aircraft.mass_percent"),
    "eolo": ("coefficient.CL_alpha", "condition.V_m_s"),
    "jsbsim:c172p": ("coefficient.Cm_q", "aircraft.Iyy_percent"),
}
JSBSIM_KG_M2 = 1.35594  # in a slug ft2, as FGXMLElement has it; it is 1.3558179483
CHANNELS = ("V", "alpha", "q", "theta", "az")


def doublet(rate_hz: float, duration_s: float = 4.0, amplitude_deg: float = 1.0) -> tb.Manoeuvre:
    t = np.arange(round(duration_s * rate_hz)) / rate_hz
    u = np.deg2rad(amplitude_deg) * (((t > 0.5) & (t < 0.8)).astype(float) - ((t >= 0.8) & (t < 1.1)))
    return tb.Manoeuvre(f"doublet of {amplitude_deg:g} deg", tb.InputSignal(t, u[:, None], ("de",)), settle_s=0.5)


def log_rate(aircraft: Aircraft) -> float:
    return aircraft.rate_hz / max(1, round(aircraft.rate_hz / 50.0))


def by_hand(aircraft: Aircraft, condition: tb.FlightCondition, key: str, step: float) -> FloatArray:
    """Return the central difference (n, m) of two flights by JSBSim, each from a trim of its own."""
    sides = []
    for sign in (1.0, -1.0):
        if key == "condition.V_m_s":
            flies, at = aircraft, tb.FlightCondition(condition.V_m_s + sign * step, condition.h_m)
        else:
            value = (1.0 if key.startswith("coefficient") else 0.0) + sign * step
            flies, at = varied(aircraft, {key: value}, "by hand", ""), condition
        trimmed = tb.trim(flies, at)
        sides.append(tb.fly(flies, trimmed, doublet(trimmed.rate_hz), log_rate(aircraft), CHANNELS).data)
    return (sides[0] - sides[1]) / (2.0 * step)


def jobs(
    aircraft: Aircraft,
    condition: tb.FlightCondition,
    manoeuvres: Sequence[tb.Manoeuvre],
    rate_hz: float = 60.0,
    channels: tuple[str, ...] | None = CHANNELS,
) -> list[tb.Job]:
    trimmed = tb.trim(aircraft, condition)
    return [tb.Job(aircraft, trimmed, m, rate_hz, channels) for m in manoeuvres]


@pytest.mark.parametrize("name", CONDITIONS)
def test_derivatives_are_those_of_jsbsims_flights(name: str) -> None:
    """The step by hand is one on the middle of the ladder, whose own error is below 1e-4 of the largest derivative."""
    aircraft, condition, keys = tb.load_aircraft(name), CONDITIONS[name], KEYS[name]
    flights = jobs(aircraft, condition, [doublet(aircraft.rate_hz)], log_rate(aircraft))
    (found,) = tb.tangents(flights, keys, simulator="batch")
    assert found.flown_by == "batch"
    assert found.flights == 1 + 8 * len(keys)
    assert found.central == (True, True)
    for k, key in enumerate(keys):
        D = by_hand(aircraft, condition, key, 2e-3 * found.parameters[k].large)
        size = np.max(np.abs(D), axis=0)
        apart = np.max(np.abs(found.derivatives[:, :, k] - D), axis=0)
        assert np.all(apart < 1e-4 * size + found.errors[:, k])
        assert np.all(found.relative_errors[:, k] < 1e-3)


@pytest.fixture(scope="module")
def taurus() -> tuple[Aircraft, tb.FlightCondition]:
    return tb.load_aircraft("taurus"), CONDITIONS["taurus"]


def test_what_is_linear_is_exact(taurus: tuple[Aircraft, tb.FlightCondition]) -> None:
    """Before anything has moved, qdot follows Cm0 as qbar S cbar Cm0 / Iyy, and a state follows itself."""
    aircraft, _ = taurus
    keys = ["coefficient.Cm0", "start.theta"]
    (found,) = tb.tangents(jobs(*taurus, [doublet(aircraft.rate_hz)], channels=None), keys, held=True)
    product = ET.fromstring(aircraft.xml).find(".//function[@name='aero/coefficient/Cm0']/product")
    assert product is not None
    Cm0 = float(product.findtext("value") or "nan")
    g = aircraft.geometry
    moment = found.truth["qbar"][0] * g.S_m2 * g.cbar_m * Cm0
    Iyy = aircraft.mass.Iyy * 1.3558179483 / JSBSIM_KG_M2
    assert found.of("qdot", "coefficient.Cm0")[0] == pytest.approx(moment / Iyy, rel=1e-6)
    assert found.of("theta", "start.theta")[0] == pytest.approx(1.0, abs=1e-9)
    assert found.of("alpha", "start.theta")[0] == pytest.approx(0.0, abs=1e-9)
    (moved,) = tb.tangents(jobs(*taurus, [doublet(aircraft.rate_hz)]), ["condition.V_m_s"])
    assert moved.of("V", "condition.V_m_s")[0] == pytest.approx(1.0, abs=1e-9)
    assert not moved.notes


def test_neither_the_order_of_parameters_nor_that_of_flights_changes_a_bit(
    taurus: tuple[Aircraft, tb.FlightCondition],
) -> None:
    aircraft, condition = taurus
    keys, rate = ["coefficient.Cm_q", "coefficient.CL_alpha", "aircraft.mass_percent"], aircraft.rate_hz
    flights = [doublet(rate), doublet(rate, amplitude_deg=0.5)]
    first, second = tb.tangents(jobs(aircraft, condition, flights), keys)
    other, one = tb.tangents(jobs(aircraft, condition, flights[::-1]), keys[::-1])
    for a, b in ((first, one), (second, other)):
        assert np.array_equal(a.derivatives, b.derivatives[:, :, ::-1])
        assert np.array_equal(a.errors, b.errors[:, ::-1])


def test_a_model_that_is_not_translated_has_the_same_derivatives_and_a_sentence(
    taurus: tuple[Aircraft, tb.FlightCondition],
) -> None:
    aircraft, condition = taurus
    chance = '<fcs_function name="fcs/odd"><function><random/></function></fcs_function>'
    term = '<function name="aero/odd"><product><value>0</value><property>fcs/odd</property></product></function>'
    edits = (
        Insert("flight_control/channel[@name='elevator']", chance),
        Insert("aerodynamics/axis[@name='PITCH']", term),
    )
    odd = aircraft.amended(Amendment("odd", "", edits))
    flight, keys = [doublet(aircraft.rate_hz, 2.0)], ["coefficient.Cm_q"]
    (a,), (b,) = (tb.tangents(jobs(flies, condition, flight), keys) for flies in (aircraft, odd))
    assert (a.flown_by, b.flown_by) == ("batch", "jsbsim")
    assert not a.notes
    assert b.notes == ("JSBSim flew doublet of 1 deg and the flights beside it, as it has the function <random>",)
    assert np.all(np.abs(a.derivatives - b.derivatives) <= a.errors + b.errors)


def test_flights_that_batch_and_jsbsim_share_are_all_flown_by_jsbsim() -> None:
    """One that comes near the ground is JSBSim's; a difference of the two simulators is no derivative."""
    aircraft = tb.load_aircraft("taurus")
    aircraft = replace(aircraft, limits={})
    condition = tb.FlightCondition(13.0, 22.5, gamma_rad=-0.05)
    flight = [doublet(aircraft.rate_hz, 20.0, 0.1)]
    (found,) = tb.tangents(jobs(aircraft, condition, flight, channels=None), ["condition.h_m"])
    assert found.flown_by == "jsbsim"
    assert found.truth.provenance["simulator"] == "JSBSim, as it is wanted"
    assert "ground" in found.notes[0]
    assert found.of("h", "condition.h_m")[0] == pytest.approx(1.0, abs=1e-6)


def test_flights_that_are_not_checked_take_the_steps_that_were_found(
    taurus: tuple[Aircraft, tb.FlightCondition],
) -> None:
    aircraft, condition = taurus
    keys, rate = ["coefficient.Cm_q", "aircraft.mass_percent"], aircraft.rate_hz
    flights = [doublet(rate, amplitude_deg=a) for a in (1.0, 0.7, 1.3)]
    exact = tb.tangents(jobs(aircraft, condition, flights), keys)
    quick = tb.tangents(jobs(aircraft, condition, flights), keys, checked=1)
    assert [x.checked for x in quick] == [True, False, False]
    assert [x.flights for x in quick] == [17, 3, 3]
    assert np.array_equal(quick[0].derivatives, exact[0].derivatives)
    for a, b in zip(quick[1:], exact[1:], strict=True):
        assert a.central == (False, False)
        apart = np.max(np.abs(a.derivatives - b.derivatives), axis=0)
        assert np.all(apart < 1e-2 * np.max(np.abs(b.derivatives), axis=0))
        assert np.all(apart < 3.0 * a.errors)  # they were found on another flight


def with_pure_kink(aircraft: Aircraft, x: float) -> Aircraft:
    return aircraft.amended(Amendment("kink", "", (ScaleCoefficient("Cm_q", 1.0 + 0.5 * abs(x)),)))


def test_a_kink_is_told_and_its_error_holds_both_sides(taurus: tuple[Aircraft, tb.FlightCondition]) -> None:
    aircraft, condition = taurus
    flight = jobs(aircraft, condition, [doublet(aircraft.rate_hz)])
    (found,) = tb.tangents(flight, [tb.FlightParameter("size", 0.0, 1.0, with_pure_kink)])
    (smooth,) = tb.tangents(flight, ["coefficient.Cm_q"])
    assert any("kink at size at 0" in n for n in found.notes)
    one_side = 0.5 * np.max(np.abs(smooth.of("q", "coefficient.Cm_q")))
    assert found.errors[found.truth.channels.index("q"), 0] == pytest.approx(one_side, rel=1e-3)
    (beside,) = tb.tangents(flight, [tb.FlightParameter("size", 0.3, 1.0, with_pure_kink)])
    assert not beside.notes


def rate_limited(aircraft: Aircraft, limit_rad_s: float) -> Aircraft:
    return aircraft.amended(Amendment("limit", "", (SetProperty("fcs/elevator-rate-limit-rad_sec", limit_rad_s),)))


def test_the_rate_limit_at_which_a_servo_leaves_it_a_frame_earlier_is_a_kink(
    taurus: tuple[Aircraft, tb.FlightCondition],
) -> None:
    """Bisection finds such a limit; at another one, halfway to the next, the derivative is that of one more frame."""
    aircraft, condition = taurus
    trimmed, rate = tb.trim(aircraft, condition), aircraft.rate_hz
    manoeuvre = doublet(rate, 1.5, 3.0)

    def frames(limit: float) -> int:
        de = tb.fly(rate_limited(aircraft, limit), trimmed, manoeuvre, rate, ("de",))["de"]
        return int(np.sum(np.abs(np.diff(de)) > limit / rate * (1.0 - 1e-9)))

    low, high = 0.5, 0.52
    assert frames(low) > frames(high)
    while high - low > 1e-14:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if frames(middle) > frames(high) else (low, middle)
        if middle in (low, high) and np.nextafter(low, high) >= high:
            break

    def at(limit: float) -> tb.FlightRecord:
        parameter = tb.FlightParameter("limit", limit, 0.5, rate_limited)
        return tb.tangents([tb.Job(aircraft, trimmed, manoeuvre, rate, ("de",))], [parameter], held=True)[0]

    assert any("kink at limit" in n for n in at(high).notes)
    assert not any("kink" in n for n in at(high * 1.004).notes)


def test_a_parameter_with_one_side_has_one_sided_differences(taurus: tuple[Aircraft, tb.FlightCondition]) -> None:
    def only_up(aircraft: Aircraft, x: float) -> Aircraft:
        if x < 0.0:
            raise ModelError("x >= 0 must hold")
        return aircraft.amended(Amendment("up", "", (ScaleCoefficient("Cm_q", 1.0 + x),)))

    aircraft, condition = taurus
    flight = jobs(aircraft, condition, [doublet(aircraft.rate_hz)])
    (up,) = tb.tangents(flight, [tb.FlightParameter("x", 0.0, 1.0, only_up)])
    (both,) = tb.tangents(flight, ["coefficient.Cm_q"])
    assert up.central == (False,)
    assert any("one side only" in n for n in up.notes)
    assert np.all(np.abs(up.derivatives - both.derivatives) <= up.errors + both.errors)


def nowhere(aircraft: Aircraft, x: float) -> Aircraft:
    if x != 0.0:
        raise ModelError("x = 0 must hold")
    return aircraft


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        (["coefficient.Cm_qq"], "did you mean 'Cm_q'"),
        (["aircraft.mass"], "aircraft.mass_percent"),
        (["start.alpha"], "needs a start that is held"),
        (["property.fcs/elevator-rate-limit-rad_sec"], "where its derivative is taken"),
        ([], "one or more"),
        (["coefficient.Cm_q", "coefficient.Cm_q"], "that differ"),
        ([tb.FlightParameter("x", 0.0, 1.0, nowhere)], "x cannot be moved from 0 to either side: x = 0 must hold"),
    ],
)
def test_what_cannot_be_differentiated_by_is_refused(
    taurus: tuple[Aircraft, tb.FlightCondition], parameters: list[str], words: str
) -> None:
    aircraft, condition = taurus
    with pytest.raises((LimitError, ModelError), match=words):
        tb.tangents(jobs(aircraft, condition, [doublet(aircraft.rate_hz)]), parameters)


def test_a_flight_that_leaves_its_limits_has_no_tangents(taurus: tuple[Aircraft, tb.FlightCondition]) -> None:
    aircraft, condition = taurus
    t = np.arange(round(6.0 * aircraft.rate_hz)) / aircraft.rate_hz
    held = tb.Manoeuvre("held", tb.InputSignal(t, np.deg2rad(15.0) * (t > 0.5)[:, None], ("da",)), settle_s=0.5)
    with pytest.raises(FlightAborted, match="manoeuvre 'held'"):
        tb.tangents(jobs(aircraft, condition, [held]), ["coefficient.Cm_q"])


def test_flights_that_differ_in_more_than_their_manoeuvre_are_refused(
    taurus: tuple[Aircraft, tb.FlightCondition],
) -> None:
    (first,) = jobs(*taurus, [doublet(taurus[0].rate_hz)])
    with pytest.raises(LimitError, match="differ in their manoeuvres alone; 'doublet of 1 deg' differs"):
        tb.tangents([first, replace(first, log_rate_hz=30.0)], ["coefficient.Cm_q"])
    assert tb.tangents([], ["coefficient.Cm_q"]) == []
