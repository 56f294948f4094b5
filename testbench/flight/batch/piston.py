"""Piston engines as operations (FGPiston): manifold pressure a state; air, fuel, friction and boost by formulas.

Temperatures and oil pressure feed nothing back and are left out.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass

from testbench.flight.batch import registers as r
from testbench.flight.batch.mount import Mount
from testbench.flight.batch.program import Untranslated, Value
from testbench.flight.batch.units import convert

# FGJSBBase and FGPiston: conversions and constants, to the last digit that JSBSim has
_PSF_PA, _INHG_PA, _PSI_PA, _FT_M = 47.88, 3386.38, 6895.0, 0.3048
_IN3_M3 = (1.0 / 12.0) ** 3 * _FT_M**3
_R_AIR, _STANDARD_PA, _SEA_LEVEL_PA = 287.3, 101320.73, 101325.0
_GAMMA, _GAMMA_BOOST = 1.3, 1.414
_KG_LB, _STOICHIOMETRIC, _RICHEST = 2.2046, 14.7, 1.3
_HP_W, _CYCLE_HP, _HP_TORQUE = 745.7, 22371.0, 5252.0
_STALLED, _LEAST_HP, _OPEN = 0.8, 0.125, 0.98
_NO_IMPEDANCE_SPEED = 999999.0
_HYSTERESIS_PA, _SWITCH_FT = 1000.0, 1000.0
_STANDARD = (2116.217, -7.648932746e-2, 1.0925498604e-6, -7.1135726027e-12, 1.7470331356e-17)
_MIXTURE = (
    (0.05, 0.0), (0.05137, 0.00862), (0.05179, 0.21552), (0.0543, 0.48276), (0.05842, 0.7069), (0.06312, 0.83621),
    (0.06942, 0.93103), (0.07786, 1.0), (0.08845, 1.0), (0.0927, 0.98276), (0.1012, 0.93103), (0.11455, 0.72414),
    (0.12158, 0.4569), (0.12435, 0.23276), (0.125, 0.0),
)  # fmt: skip
"""Fuel per air, and the share of full power that the mixture gives, unless the file has a table of its own."""
_NUMBERS: Mapping[str, tuple[str, float]] = {
    "minmp": ("INHG", 6.5), "maxmp": ("INHG", 28.5), "man-press-lag": ("", 1.0), "displacement": ("IN3", 360.0),
    "maxhp": ("HP", 200.0), "static-friction": ("HP", 1.5), "cycles": ("", 4.0), "idlerpm": ("", 600.0),
    "maxrpm": ("", 2800.0), "bsfc": ("LBS/HP*HR", -1.0), "volumetric-efficiency": ("", 0.85),
    "compression-ratio": ("", 8.5), "stroke": ("IN", 4.375), "air-intake-impedance-factor": ("", -999.0),
    "ram-air-factor": ("", 1.0), "dynamic-fmep": ("PA", 18400.0), "static-fmep": ("PA", 46500.0),
    "peak-piston-speed": ("", 100.0), "boost-loss-factor": ("", 0.0), "takeoffboost": ("PSI", 0.0),
    "numboostspeeds": ("", 0.0), "boostoverride": ("", 0.0), "boostmanual": ("", 0.0),
    **{f"ratedboost{i}": ("PSI", 0.0) for i in (1, 2, 3)}, **{f"ratedpower{i}": ("HP", 0.0) for i in (1, 2, 3)},
    **{f"ratedrpm{i}": ("", 2500.0) for i in (1, 2, 3)}, **{f"ratedaltitude{i}": ("FT", 0.0) for i in (1, 2, 3)},
}  # fmt: skip
"""Element -> unit and default."""


class Piston:
    """One piston engine.

    Args:
        mount: where it runs.
        e: the ``piston_engine`` element.

    Raises:
        Untranslated: the model starts or stops it, or its supercharger is not given in full.
    """

    def __init__(self, mount: Mount, e: ET.Element) -> None:
        mount.unmoved(
            "propulsion/magneto_cmd", "propulsion/starter_cmd", "propulsion/engine[#]/set-running",
            "propulsion/engine[#]/map-pa",
        )  # fmt: skip
        self._m, self._e = mount, e
        n = {name: _number(e, name, unit, default) for name, (unit, default) in _NUMBERS.items()}
        self._n = n
        self._rated_speed = n["maxrpm"] * n["stroke"] / 360.0
        self._displacement = n["displacement"] * _IN3_M3
        if n["bsfc"] < 0.0:
            n["bsfc"] = self._fitting_consumption()
        n["maxmp"] = min(n["maxmp"], 29.9)
        if n["air-intake-impedance-factor"] < 0.0:
            engine = n["peak-piston-speed"] / self._rated_speed
            n["air-intake-impedance-factor"] = _STANDARD_PA * engine / (n["maxmp"] * _INHG_PA) - engine
        idle = n["peak-piston-speed"] / (n["idlerpm"] * n["stroke"] / 360.0)
        pressure = _STANDARD_PA / (n["minmp"] * _INHG_PA) - 1.0
        self._throttle_impedance = idle * pressure - n["air-intake-impedance-factor"]
        self._boosts = _boosts(n)

    def _fitting_consumption(self) -> float:
        """Return the fuel per power at which the engine has the power that its file gives, lb/(hp h)."""
        n, efficiency = self._n, self._n["volumetric-efficiency"]
        pumping = (29.92 - n["maxmp"]) * _INHG_PA * efficiency
        friction = n["dynamic-fmep"] * self._rated_speed * _FT_M + n["static-fmep"]
        lost = (pumping + friction) * self._displacement * n["maxrpm"] / (n["cycles"] * _CYCLE_HP)
        fuel = 1.1 * n["displacement"] * n["maxrpm"] * efficiency * (n["maxmp"] / 29.92)
        return fuel / (9411.0 * (n["maxhp"] + lost - n["static-friction"]))

    def horsepower(self, rpm: Value) -> Value:
        """Return the power of a frame, hp, at a speed of its shaft, rpm."""
        m, n = self._m, self._n
        m.functions(self._e)
        efficiency = m.given("volumetric-efficiency", n["volumetric-efficiency"])
        displacement = m.b.number(self._displacement)
        ambient = m.b.core(r.PRESSURE) * _PSF_PA
        kelvin = m.b.core(r.TEMPERATURE) / 1.8
        speed = rpm * m.b.number(n["stroke"]) / 360.0
        running = self._fired(rpm)
        throttled, pressure, loss = self._manifold(ambient, speed, rpm)
        pumping = (throttled - ambient) * efficiency
        # air
        most = m.b.number(n["compression-ratio"])
        ratio = (pressure < 1.0).then(most, ambient / pressure).at_most(most)
        filled = (_GAMMA - 1.0) / _GAMMA + (most - ratio) / (_GAMMA * (most - 1.0))
        volume = displacement * (rpm / 60.0) / 2.0 * (efficiency * filled)
        air = volume * (pressure / (_R_AIR * kelvin))
        # fuel
        richness = _RICHEST * m.lever("mixture") * _SEA_LEVEL_PA / ambient
        starved = m.hidden("starved")
        fuel = (starved > 0.5).then(0.0, air * richness / _STOICHIOMETRIC)
        flow = fuel * _KG_LB
        # power
        static = m.given("friction-hp", n["static-friction"])
        burnt = flow * 3600.0 / m.given("bsfc-lbs_hphr", n["bsfc"]) * self._mixture(fuel / air) - static
        rubbing = -m.b.number(n["dynamic-fmep"]) * speed * _FT_M - m.b.number(n["static-fmep"])
        indicated = (running > 0.5).then(burnt, -static)
        friction = (running > 0.5).then(rubbing, 0.0)
        power = indicated + (pumping + friction) * displacement * rpm / (m.b.number(n["cycles"]) * _CYCLE_HP) - loss
        m.hide("starved", starved)
        m.hide("air-volume", volume)
        for name, value in (
            ("set-running", running & (indicated >= _LEAST_HP)), ("fuel-flow-rate-pps", flow), ("power-hp", power),
            ("map-pa", pressure), ("map-inhg", pressure / _INHG_PA),
        ):  # fmt: skip
            m.set(name, value)
        return power

    def _fired(self, rpm: Value) -> Value:
        """Return 1 if the engine runs: fuel flowed in the last frame, and the shaft turns fast enough."""
        m = self._m
        least = m.b.number(self._n["idlerpm"]) * _STALLED
        fuel = m.get("fuel-flow-rate-pps") > 0.0
        return fuel & (m.get("set-running") > 0.5).then(rpm >= least, rpm > least)

    def _mixture(self, fuel_per_air: Value) -> Value:
        table = next((t for t in self._e.findall("table") if t.get("name") == "MIXTURE"), None)
        if table is not None:
            return self._m.f.looked_up(table, [fuel_per_air])
        return self._m.f.interpolated(_MIXTURE, fuel_per_air)

    def _manifold(self, ambient: Value, speed: Value, rpm: Value) -> tuple[Value, Value, Value]:
        """Return the pressure behind the throttle and in the manifold, Pa, and the power that boosting takes, hp."""
        m, n = self._m, self._n
        ram = m.given("ram-air-factor", n["ram-air-factor"])
        rammed = (m.b.core(r.TOTAL_PRESSURE) * _PSF_PA - ambient) * ram + ambient
        shut = 1.0 - m.lever("throttle")
        throttle = shut * shut * m.b.number(self._throttle_impedance)
        engine = (speed > 0.0).then(m.b.number(n["peak-piston-speed"]) / speed, _NO_IMPEDANCE_SPEED)
        box = m.given("air-intake-impedance-factor", n["air-intake-impedance-factor"])
        before = m.hidden("throttled") if self._boosts else m.get("map-pa")
        away = before - rammed * (engine / (engine + box + throttle))
        lag = m.b.number(n["man-press-lag"])
        throttled = before - (lag > m.dt).then(away * (m.dt / lag), away)
        pressure = throttled
        if self._boosts:
            raised, most = self._boosting(rpm, ambient)
            # JSBSim gives only the pressure behind the supercharger; where that is held down, the one before it begins
            # in equilibrium.
            behind = m.get("map-pa")
            begun = (behind < most).then(behind / raised, before - away)
            throttled = m.dt.equals(0.0).then(begun, throttled)
            m.hide("throttled", throttled)
            pressure = (throttled * raised).at_most(most)
        if self._e.find("numboostspeeds") is None or self._e.find("boost-loss-factor") is None:
            return throttled, pressure, m.b.constant(0.0)
        g = _GAMMA_BOOST
        work = throttled * m.hidden("air-volume") * g / (g - 1.0)
        factor = m.given("boostloss-factor", n["boost-loss-factor"])
        taken = work * ((pressure / throttled) ** ((g - 1.0) / g) - 1.0) * factor / _HP_W
        loss = (factor > 0.0).then(taken, 0.0)
        m.set("boostloss-hp", loss)
        return throttled, pressure, loss

    def _boosting(self, rpm: Value, ambient: Value) -> tuple[Value, Value]:
        """Return by how much the supercharger raises the pressure, and up to what, Pa; its gear changes with the
        pressure outside."""
        m, n, boosts = self._m, self._n, self._boosts
        gear, last = m.get("boost-speed"), len(boosts) - 1
        if n["boostmanual"] == 1.0:
            gear = (gear > last).then(last, gear)
            gear = (gear < 0.0).then(0.0, gear)
        elif last > 0:
            up = [m.b.number(b.switch_Pa - _HYSTERESIS_PA) for b in boosts[:-1]]
            down = [m.b.number(b.switch_Pa + _HYSTERESIS_PA) for b in boosts[:-1]]
            gear = ((gear < last) & (ambient < _chosen(gear, up))).then(gear + 1.0, gear)
            gear = ((gear > 0.0) & (ambient > _chosen(gear - 1.0, down))).then(gear - 1.0, gear)
        m.set("boost-speed", gear)
        raised = _chosen(gear, [(m.b.number(b.ratio) - 1.0) / m.b.number(b.rpm) for b in boosts])
        if n["boostoverride"] == 1.0:
            return raised * rpm + 1.0, m.b.constant(math.inf)
        most = _chosen(gear, [m.b.number(b.rated_Pa) for b in boosts])
        takeoff = _chosen(gear, [m.b.number(b.takeoff_Pa) for b in boosts])
        return raised * rpm + 1.0, (m.lever("throttle") > _OPEN).then(takeoff, most)


@dataclass(frozen=True)
class _Boost:
    """One speed of a supercharger: limits of the manifold pressure, how much it raises it at which speed of the engine,
    and the pressure outside at which the next speed takes over."""

    rated_Pa: float
    takeoff_Pa: float
    ratio: float
    rpm: float
    switch_Pa: float


def _boosts(n: Mapping[str, float]) -> list[_Boost]:
    """Return the speeds of the supercharger, up to the first that the file does not give in full."""
    count, out = int(n["numboostspeeds"]), []
    for i in range(1, count + 1):
        height = n[f"ratedaltitude{i}"]
        below = n[f"ratedaltitude{i - 1}"] if i > 1 else 0.0
        if n[f"ratedboost{i}"] <= 0.0 or n[f"ratedpower{i}"] <= 0.0 or height < below:
            if i < count:
                raise Untranslated("a supercharger has a speed that is not given in full")
            break
        rated = _STANDARD_PA + n[f"ratedboost{i}"] * _PSI_PA
        more = max(n["takeoffboost"] - n["ratedboost1"], 0.0) * _PSI_PA
        switch = _standard_psf(height + _SWITCH_FT if height > 0.0 else 0.0) * _PSF_PA if i < count else math.nan
        out.append(_Boost(rated, rated + more, rated / (_standard_psf(height) * _PSF_PA), n[f"ratedrpm{i}"], switch))
    return out


def _standard_psf(height_ft: float) -> float:
    return sum(c * min(height_ft, 100000.0) ** i for i, c in enumerate(_STANDARD))


def _chosen(gear: Value, values: list[Value]) -> Value:
    """Return the value of a gear, counted from 0."""
    out = values[-1]
    for i in range(len(values) - 2, -1, -1):
        out = (gear < i + 0.5).then(values[i], out)
    return out


def _number(e: ET.Element, name: str, unit: str, default: float) -> float:
    inside = e.find(name)
    return convert(inside, unit or ((inside.get("unit") or "") if inside is not None else ""), default)
