"""What drives an aircraft, in words: its engines, and how much of their thrust a trim takes."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.constants import DEG_RAD, LBF_N, RPM_RAD_S
from testbench.flight.condition import TrimmedFlight
from testbench.flight.executive import Executive
from testbench.flight.trim import place_at_trim


def engine_words(fdm: Executive, i: int) -> str:
    """Return engine ``i`` in words: its kind and file, and its propeller."""
    elements = ET.fromstring(fdm.aircraft.xml).findall("propulsion/engine")
    element = elements[i] if i < len(elements) else None
    file = "" if element is None else element.get("file", "")
    text = fdm.aircraft.engine_files.get(f"{file}.xml", "")
    kind = next((m.group(1) for m in re.finditer(r"<(\w+)_(?:engine|motor)\b", text)), "engine")
    thruster = element.find("thruster") if element is not None else None
    rpm = f"propulsion/engine[{i}]/propeller-rpm"
    turning = f", propeller {thruster.get('file')}" if thruster is not None and fdm.has(rpm) else ""
    governed = f"propulsion/engine[{i}]/constant-speed-mode"
    how = " of constant speed" if turning and fdm.has(governed) and fdm.get(governed) else ""
    return f"{kind.removesuffix('_dc')} {file}{turning}{how}".rstrip()


def thrust_N(fdm: Executive) -> float:
    """Return the thrust of all engines as they stand, N."""
    count = fdm.fdm.get_propulsion().get_num_engines()
    return sum(fdm.get(f"propulsion/engine[{i}]/thrust-lbs") for i in range(count)) * LBF_N


def full_thrust_N(aircraft: Aircraft, trimmed: TrimmedFlight) -> float:
    """Return the thrust of all engines at full throttle in the state of a trim, N."""
    fdm = Executive(aircraft, trimmed.rate_hz, trimmed.condition)
    place_at_trim(fdm, trimmed)
    fdm.command({"thr": aircraft.controls["thr"].full})
    fdm.evaluate(to_rest=True)
    return thrust_N(fdm)


def thrust_words(aircraft: Aircraft, trimmed: TrimmedFlight) -> str:
    """Return in a sentence what gives thrust at a trim, how much of how much; or that nothing does, and its path."""
    fdm = Executive(aircraft, trimmed.rate_hz, trimmed.condition)
    place_at_trim(fdm, trimmed)
    V, count = trimmed.condition.V_m_s, fdm.fdm.get_propulsion().get_num_engines()
    if "thr" not in trimmed.controls:
        what = f"its {count} engine{'s' * (count > 1)} give{'s' * (count == 1)} none: flown as " if count else ""
        return f"no thrust: {what}a glider, path {trimmed.condition.gamma_rad / DEG_RAD:.1f} deg at {V:g} m/s"
    held = thrust_N(fdm)
    speeds = np.unique(np.round(fdm.propellers.speeds() / RPM_RAD_S))
    turning = f" at {' and '.join(f'{n:.0f}' for n in speeds)} rpm" if speeds.size else ""
    engines = dict.fromkeys(engine_words(fdm, i) for i in range(count))
    several = f"{count} engines, " if count > 1 else ""
    return (
        f"thrust: {held:.3g} N{turning} of {full_thrust_N(aircraft, trimmed):.3g} N at full throttle and {V:g} m/s "
        f"({several}{'; '.join(engines)})"
    )
