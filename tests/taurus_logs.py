"""Flights of Taurus at several speeds and masses, written as a pilot's logs: CSV files and a description of each."""

from dataclasses import replace
from pathlib import Path

import numpy as np

import testbench as tb
from testbench.aircraft import Aircraft
from testbench.aircraft.amend import Amendment
from testbench.aircraft.seams import scaled_mass
from testbench.core.scenario.inputs import StandardMultistep
from testbench.flight import FlightCondition

H_M = 100.0
NOISE = {"V": 0.05, "alpha": 0.002, "q": 0.004, "theta": 0.002, "de": 0.0002, "h": 0.3}

DESCRIPTION = """title = "Taurus at {V:g} m/s with {mass:.4g} kg"
source = "simulated"
rights = "free"
aircraft = "{aircraft}"
{trim}
[condition]
mass_kg = {mass:.6g}
Iyy_kg_m2 = {Iyy:.6g}
[time]
column = "t"
[[record]]
name = "fit"
file = "{name}.csv"
use = "identification"
segments = [[0.0, 30.0]]
[[record]]
name = "judge"
file = "{name}.csv"
use = "validation"
segments = [[30.05, 60.0]]
{channels}
[preparation]
bias = "trim"
[identification]
inputs = ["de"]
outputs = ["V", "alpha", "q", "theta"]
[[identification.estimators]]
method = "output_error"
structure = "longitudinal"
"""
CHANNEL = '[[channel]]\nname = "{name}"\ncolumn = "{name}"\nunit = "{unit}"'


def loaded_taurus(mass: float, inertia: float) -> Aircraft:
    """Return Taurus with mass and pitch inertia times these factors."""
    taurus = tb.load_aircraft("taurus")
    changes, properties = scaled_mass(taurus, {"mass_kg": mass, "Iyy": inertia})
    return replace(taurus.amended(Amendment("loaded", "payload", changes)), mass=properties)


def write_log(
    folder: Path, name: str, V_m_s: float, mass: float = 1.0, inertia: float = 1.0, seed: int = 0, airspeed: float = 1.0
) -> Path:
    """Fly Taurus, write NAME.csv and NAME.toml, and return the description.

    Args:
        folder: of both files.
        name: of both files.
        V_m_s: true airspeed.
        mass: factor on the mass.
        inertia: factor on the pitch inertia.
        seed: of the noise.
        airspeed: factor by which the recorded airspeed is wrong.
    """
    aircraft = loaded_taurus(mass, inertia)
    trimmed = tb.trim(aircraft, FlightCondition(V_m_s, H_M))
    inputs = [
        StandardMultistep(signal="3211", control="de", start_s=start, step_s=0.12, amplitude_deg=0.6 * sign)
        for start, sign in ((2.0, 1.0), (6.0, -1.0), (10.0, 1.0), (14.0, -1.0), (32.0, 1.0), (36.0, -1.0))
    ]
    manoeuvre = tb.Manoeuvre.of(name, inputs, 58.0, trimmed.rate_hz, settle_s=2.0)
    flight = tb.fly_and_measure(tb.Job(aircraft, trimmed, manoeuvre, 60.0, tuple(NOISE)))
    rng = np.random.default_rng(seed)
    record = flight.flown.select(tuple(NOISE))
    data = record.data + rng.standard_normal(record.data.shape) * np.array(list(NOISE.values()))
    data[:, 0] *= airspeed
    head = ",".join(["t", *NOISE])
    np.savetxt(folder / f"{name}.csv", np.column_stack([record.t_s, data]), delimiter=",", header=head, comments="")
    units = {"V": "m/s", "h": "m", "q": "rad/s"}
    channels = "\n".join(CHANNEL.format(name=n, unit=units.get(n, "rad")) for n in NOISE)
    taurus = tb.load_aircraft("taurus").mass
    text = DESCRIPTION.format(
        V=V_m_s,
        mass=taurus.mass_kg * mass,
        Iyy=taurus.Iyy * inertia,
        name=name,
        aircraft="taurus",
        trim="trim_s = 1.5",
        channels=channels,
    )
    (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    return folder / f"{name}.toml"


def true_coefficients(V_m_s: float, mass: float = 1.0, inertia: float = 1.0) -> dict[str, float]:
    """Return the coefficients of the linearised model at a condition."""
    from testbench.evaluation.derivatives import dimensional_derivatives

    aircraft = loaded_taurus(mass, inertia)
    trimmed = tb.trim(aircraft, FlightCondition(V_m_s, H_M))
    by_name = {d.name: d.held for d in dimensional_derivatives(tb.linearise(aircraft, trimmed), trimmed)}
    g, force = aircraft.geometry, trimmed.condition.qbar_Pa * aircraft.geometry.S_m2
    per = {"q": 2.0 * V_m_s / g.cbar_m}
    size = {"Z": ("CZ", aircraft.mass.mass_kg / force), "M": ("Cm", aircraft.mass.Iyy / (force * g.cbar_m))}
    return {
        f"{size[axis][0]}_{v}": by_name[f"{axis}_{v}"] * size[axis][1] * per.get(v, 1.0)
        for axis in "ZM"
        for v in ("alpha", "q", "de")
    }
