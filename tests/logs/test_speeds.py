"""Airspeed in another unit is questioned by what else tells speed; wind, thin air and gentle flights are not."""

import numpy as np
import pytest
from recorded import flight_data

from testbench.core.atmosphere import air_density
from testbench.core.constants import FT_M, G0_M_S2, KT_M_S
from testbench.core.paths import SCENARIOS
from testbench.logs.plausible import implausible, signals_of
from testbench.logs.read import read_records
from testbench.questions.identify.scenario import RecordDescription

T = np.arange(0.0, 60.0, 0.02)
UNITS = [("kt", KT_M_S), ("ft/s", FT_M), ("km/h", 1.0 / 3.6)]
WITNESSES = {
    "pressure": ("V", "h", "qbar"),
    "ground": ("V", "Vg", "psi"),
    "curve": ("V", "alpha", "theta", "phi", "q", "az"),
    "curve without bank": ("V", "alpha", "theta", "q", "az"),
    "climb": ("V", "alpha", "theta", "h"),
}


def flight(seed: int = 0, V: float = 22.0, h: float = 300.0, wind: float = 6.0) -> dict[str, np.ndarray]:
    """A flight that pitches, turns and climbs, consistent as a flight is, with noise of instruments; SI units."""
    rng = np.random.default_rng(seed)
    slow, quick = np.sin(0.25 * T), np.sin(2.0 * T)
    alpha, theta = 0.06 + 0.03 * quick, 0.1 + 0.12 * slow + 0.02 * quick
    thetadot, alphadot = 0.03 * np.cos(0.25 * T) + 0.04 * np.cos(2.0 * T), 0.06 * np.cos(2.0 * T)
    psi, course = 1.0 + 0.08 * T, 2.0
    clean = {
        "V": V + 0 * T, "alpha": alpha, "theta": theta, "phi": 0.1 * slow, "psi": psi, "q": thetadot,
        "az": -V * (thetadot - alphadot) - G0_M_S2 * np.cos(theta) * np.cos(0.1 * slow),
        "h": h + np.cumsum(V * np.sin(theta - alpha)) * 0.02, "qbar": 0.5 * air_density(h) * V**2 + 0 * T,
        "Vg": np.sqrt(V**2 + wind**2 + 2.0 * V * wind * np.cos(psi - course)),
    }  # fmt: skip
    size = {"V": 0.01 * V, "az": 0.2, "h": 0.5, "qbar": 5.0, "Vg": 0.2}
    return {name: x + size.get(name, 0.003) * rng.normal(size=T.size) for name, x in clean.items()}


def asked(channels: dict[str, np.ndarray]) -> list[tuple[str, str]]:
    return [(q.channel, q.unit) for q in implausible({name: (T, x) for name, x in channels.items()})]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("V", "h", "wind"), [(22.0, 300.0, 6.0), (80.0, 3000.0, 20.0), (220.0, 10_000.0, 50.0)])
def test_a_flight_raises_no_question(seed, V, h, wind):
    whole = flight(seed, V, h, wind)
    assert asked(whole) == []
    for names in WITNESSES.values():
        assert asked({name: whole[name] for name in names}) == []


@pytest.mark.parametrize("witness", WITNESSES)
@pytest.mark.parametrize(("unit", "factor"), UNITS)
def test_airspeed_in_another_unit_is_questioned_by_each_witness_alone(witness, unit, factor):
    whole = flight()
    channels = {name: whole[name] for name in WITNESSES[witness]}
    channels["V"] = channels["V"] / factor
    found = asked(channels)
    assert [name for name, _ in found] == ["V"]
    # The curve and the ground speed tell the speed to some percent; ft/s and km/h are 9 % apart.
    assert found[0][1] == unit or (witness.startswith(("ground", "curve")) and {unit, found[0][1]} == {"ft/s", "km/h"})


@pytest.mark.parametrize("witness", [w for w in WITNESSES if w != "ground"])
@pytest.mark.parametrize(("wrong", "right"), [("km/h", "kt"), ("kt", "m/s"), ("km/h", "m/s"), ("ft/s", "kt")])
def test_airspeed_for_which_another_unit_is_set_is_questioned_though_it_flies(witness, wrong, right):
    factors = {"m/s": 1.0, **dict(UNITS)}
    channels = {name: x for name, x in flight(V=80.0).items() if name in WITNESSES[witness]}
    channels["V"] = channels["V"] * factors[wrong] / factors[right]
    (question,) = implausible({name: (T, x) for name, x in channels.items()})
    assert (question.channel, question.unit) == ("V", "")
    assert "another unit set than its own" in question.means
    times = float(question.means.split("makes ")[1].split(")")[0])  # units whose ratios lie close cannot be told apart
    assert times == pytest.approx(factors[wrong] / factors[right], rel=0.15)


@pytest.mark.parametrize(("unit", "factor"), UNITS)
def test_turns_tell_the_unit_of_airspeed(unit, factor):
    rng = np.random.default_rng(2)
    phi = 0.5 * np.sin(0.1 * T)
    psi = np.cumsum(9.81 * np.tan(phi) / 18.0) * 0.02
    channels = {"V": 18.0 / factor + 0.3 * rng.normal(size=T.size), "phi": phi, "psi": psi}
    found = asked(channels)
    assert [name for name, _ in found] == ["V"]
    assert found[0][1] in ((unit,) if unit == "kt" else ("ft/s", "km/h"))  # 9 % apart: banks are not that steady
    assert asked({**channels, "V": factor * channels["V"]}) == []


def test_height_in_feet_is_questioned_by_the_climb():
    whole = flight()
    channels = {name: whole[name] for name in WITNESSES["climb"]}
    channels["h"] = channels["h"] / FT_M
    assert asked(channels) == [("h", "ft")]


def test_calibrated_airspeed_in_thin_air_is_no_other_unit():
    channels = flight(V=220.0, h=10_000.0)
    channels["V"] = channels["V"] * np.sqrt(air_density(10_000.0) / air_density(0.0))
    assert ("V", "kt") not in asked(channels)


def test_a_straight_flight_against_the_wind_is_no_other_unit():
    channels = {name: x for name, x in flight(wind=10.0).items() if name in ("V", "Vg", "psi")}
    channels["psi"] = 2.0 + np.pi + 0 * T
    channels["Vg"] = channels["V"] - 10.0
    assert asked(channels) == []


@pytest.mark.parametrize("name", ["attas_full", "twin_otter_longitudinal"])
def test_real_flights_are_in_the_units_that_they_state(name):
    flight_data()
    found = next(SCENARIOS.rglob(f"{name}.toml"))
    for _, _, record in read_records(RecordDescription.load(found)):
        assert implausible(signals_of(record)) == ()
