"""The response to a planned manoeuvre: flown in the simulator against its limits, scaled if asked for, with a band."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.channels import CONTROLS
from testbench.core.constants import DEG_RAD
from testbench.core.errors import EstimationError, LimitError
from testbench.core.record import FlightAborted, FlightRecord, FloatArray
from testbench.core.scenario.inputs import Input
from testbench.estimators.parametric.response import respond
from testbench.flight.air import Air, turbulence_rms
from testbench.information.aircraft_structure import aircraft_structure, parameter_names
from testbench.inputs import InputSignal, build
from testbench.line import fly_and_measure
from testbench.questions.design.limits import Limits, breaches
from testbench.questions.plan.repeats import command_names
from testbench.questions.plan.result import Point
from testbench.questions.plan.scenario import PlanLimits, PlannedManoeuvre, PlanScenario
from testbench.sensors import SensorSuite

SHOWN = {"longitudinal": ("V", "alpha", "q", "az"), "lateral": ("beta", "p", "r", "phi")}
"""Channels of the expected response that a card shows."""
_COEFFICIENT_OF = {"X": "CD", "Z": "CL", "M": "Cm", "Y": "CY", "L": "Cl", "N": "Cn"}  # axis -> coefficient
LOGGED = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "ay", "az", "h", "thrust", *CONTROLS)
_LOG_HZ = 100.0
_HALVINGS = 6
_LEAST_FACTOR = 0.05
_SIGMAS = 1.96  # 95 % of a normal deviate


@dataclass(frozen=True, eq=False)
class Flown:
    """One simulated flight of a manoeuvre: the input, the record up to its end, and the limits that it breaks."""

    signal: InputSignal
    record: FlightRecord
    met: tuple[str, ...]


def limits_of(limits: PlanLimits, aircraft: Aircraft, onset_m_s: float | None) -> Limits:
    """Return the limits of a plan in SI; if no highest speed is given, the onset of instability is one.

    Raises:
        LimitError: a limit breaks its law.
    """
    fastest = [v for v in (limits.V_max_m_s, onset_m_s) if v is not None]

    def degrees(value: float | None) -> float | None:
        """Return an angle given in degrees in rad."""
        return None if value is None else value * DEG_RAD

    given: dict[str, float] = {c: v * DEG_RAD for c, v in limits.deflection_deg.items()}
    return Limits(
        deflection={c: given.get(c, max(control.full, -control.low)) for c, control in aircraft.controls.items()},
        rate={c: v * DEG_RAD for c, v in limits.rate_deg_s.items()},
        load_factor=limits.load_factor,
        alpha=None if limits.alpha_deg is None else (limits.alpha_deg[0] * DEG_RAD, limits.alpha_deg[1] * DEG_RAD),
        beta=degrees(limits.beta_deg),
        speed_change_m_s=limits.speed_change_m_s,
        height_change_m=limits.height_change_m,
        pitch_change=degrees(limits.pitch_change_deg),
        bank=degrees(limits.bank_deg),
        V_max_m_s=min(fastest) if fastest else None,
        V_min_m_s=limits.V_min_m_s,
        throw={n: (c.low, c.full) for n, c in aircraft.controls.items()},
    )


def bands_of(limits: Limits, point: Point, controls: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Return channel -> (lowest, highest) absolute value at a point, the deflections of the moved controls included.

    Raises:
        LimitError: trim itself lies outside a limit.
    """
    bands = limits.bands(dict(point.trimmed.state))
    for name in controls:
        bands[name] = limits.control_band(name)
    return bands


def scaled(inputs: Sequence[Input], factor: float) -> tuple[Input, ...]:
    """Return scenario entries at ``factor`` times their amplitude."""
    out = []
    for spec in inputs:
        key = "amplitude_percent" if spec.control == "thr" else "amplitude_deg"
        out.append(spec.model_copy(update={key: round(float(getattr(spec, key)) * factor, 6)}))
    return tuple(out)


def log_rate_of(rate_hz: float) -> float:
    """Return the rate that expected responses are logged at: the highest that divides the simulator's, to 100 Hz."""
    return rate_hz / max(1, int(np.ceil(rate_hz / _LOG_HZ)))


def fly_once(aircraft: Aircraft, point: Point, spec: PlannedManoeuvre, limits: Limits, factor: float) -> Flown:
    """Fly a manoeuvre at ``factor`` times its amplitude in still air; times of limits count from the input's start.

    Raises:
        LimitError: trim lies outside the limits, or no part of the manoeuvre can be flown.
    """
    trimmed = point.trimmed
    signal = build(scaled(spec.input, factor), spec.duration_s, trimmed.rate_hz)
    bands = bands_of(limits, point, spec.controls)
    aborted: list[str] = []
    try:
        record = _flight(aircraft, point, spec, signal)
    except FlightAborted as error:
        if error.record is None:
            raise
        record = error.record
        aborted = [f"the flight ends at t = {error.time_s - spec.settle_s:.2f} s: {error.reason}"]
    found = [b._replace(t_s=b.t_s - spec.settle_s).sentence for b in breaches(record, bands)]
    return Flown(signal, record, (*found, *_too_fast(record, spec, limits), *aborted))


def _flight(
    aircraft: Aircraft,
    point: Point,
    spec: PlannedManoeuvre,
    signal: InputSignal,
    channels: Sequence[str] = LOGGED,
    air: Air | None = None,
) -> FlightRecord:
    """Fly a signal from the trim of a point, with the undisturbed flight that the manoeuvre begins with."""
    return fly_and_measure(
        aircraft,
        point.trimmed,
        spec.name,
        signal,
        log_rate_hz=log_rate_of(point.trimmed.rate_hz),
        settle_s=spec.settle_s,
        channels=[c for c in channels if c in point.trimmed.state],  # a glider has no throttle
        air=air,
    ).flown


def _too_fast(record: FlightRecord, spec: PlannedManoeuvre, limits: Limits) -> list[str]:
    """Return the deflection rates that pass their limit, in words; one log interval is the time they are taken over."""
    out = []
    for name in spec.controls:
        if name in limits.rate:
            rate = np.diff(record[name]) / record.dt_s
            over = np.abs(rate) > limits.rate[name]
            if over.any():
                at = record.t_s[int(np.argmax(over)) + 1] - spec.settle_s
                out.append(
                    f"the rate of {name} passes {limits.rate[name] / DEG_RAD:.3g} deg/s at t = {at:.2f} s "
                    f"(extreme {np.abs(rate).max() / DEG_RAD:.3g} deg/s)"
                )
    return out


def fly_within(
    aircraft: Aircraft, point: Point, spec: PlannedManoeuvre, limits: Limits, scale: bool
) -> tuple[float, Flown, tuple[str, ...]]:
    """Return the factor on the amplitude that keeps all limits, the flight at it, and the limits broken at factor 1.

    Bisection finds the factor to 1/64. It is 0 if the manoeuvre is refused, because it breaks a limit and may not be
    scaled, or breaks one even at a twentieth of its amplitude. The flight is then the one at factor 1.
    """
    first = _attempt(aircraft, point, spec, limits, 1.0)
    if isinstance(first, Flown) and not first.met:
        return 1.0, first, ()
    met = first.met if isinstance(first, Flown) else (first,)
    good: tuple[float, Flown] | None = None
    if scale:
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            found = _attempt(aircraft, point, spec, limits, middle)
            if isinstance(found, Flown) and not found.met:
                low, good = middle, (middle, found)
            else:
                high = middle
    if good is not None and good[0] >= _LEAST_FACTOR:
        return good[0], good[1], met
    if isinstance(first, Flown):
        return 0.0, first, met
    still = _flight(aircraft, point, spec, build(scaled(spec.input, 0.0), spec.duration_s, point.trimmed.rate_hz))
    signal = build(spec.input, spec.duration_s, point.trimmed.rate_hz)
    return 0.0, Flown(signal, still, met), met


def _attempt(aircraft: Aircraft, point: Point, spec: PlannedManoeuvre, limits: Limits, factor: float) -> Flown | str:
    """Return the flight, or why the commands cannot be given or trim is outside the limits, in words."""
    try:
        return fly_once(aircraft, point, spec, limits, factor)
    except LimitError as error:
        return error.message


def expected_band(
    scenario: PlanScenario,
    aircraft: Aircraft,
    suite: SensorSuite,
    point: Point,
    spec: PlannedManoeuvre,
    flown: Flown,
    modes: Sequence[int],
) -> dict[str, FloatArray]:
    """Return channel -> (n,) half width of the 95 % band about the expected response, for the channels of SHOWN.

    The half width is 1.96 times the root of the sum of three variances. One is the sensor's noise and rounding, if the
    suite has the channel. One is that of the derivatives, each uncertain by ``uncertainty_percent`` and independent of
    the others, through the sensitivities of the linearised aircraft; where the aircraft has a deviation of its own for
    the coefficient that a derivative hangs on, that one counts. One is that of turbulence, from one flight through
    it without input.

    Raises:
        EstimationError: the linearised aircraft diverges over the manoeuvre.
    """
    plane, shown = spec.plane, SHOWN[spec.plane]
    names = parameter_names(spec.controls, plane, ())
    commands = command_names(point.model, spec.controls)
    structure = aircraft_structure(point.model, point.V_m_s, point.trimmed.alpha, plane, modes, commands, shown, names)
    record = flown.record
    rate = 1.0 / record.dt_s
    u = np.zeros((len(record.t_s), len(commands)))
    rows = np.rint((record.t_s - spec.settle_s) / flown.signal.dt_s).astype(int)
    inside = (rows >= 0) & (rows < len(flown.signal.u))
    for j, name in enumerate(spec.controls):
        u[inside, j] = flown.signal.u[rows[inside], flown.signal.channels.index(name)]
    held = np.ones(len(commands), bool)
    start = np.zeros(len(structure.states))
    r = respond(structure, structure.true, range(len(names)), u, 1.0 / rate, held, start)
    spread = relative_spread(names, aircraft, scenario.uncertainty_percent / 100.0) * np.abs(structure.true)
    variance = np.sum((r.dparams * spread) ** 2, axis=2)
    if not np.all(np.isfinite(variance)):
        raise EstimationError("the linearised aircraft diverges over this manoeuvre; shorten it")
    noise = suite.noise_std
    rough = _turbulence(scenario, aircraft, point, spec)
    return {
        name: _SIGMAS * np.sqrt(variance[:, i] + noise.get(name, 0.0) ** 2 + rough.get(name, 0.0) ** 2)
        for i, name in enumerate(shown)
    }


def relative_spread(names: Sequence[str], aircraft: Aircraft, general: float) -> FloatArray:
    """Return the relative standard deviation (k,) of derivatives such as "M_alpha".

    That of the coefficient behind it ("Cm_alpha"), if the aircraft has one of its own, else the general one.
    """
    out = []
    for name in names:
        axis, variable = name.split("_", 1)
        out.append(aircraft.uncertainty.get(f"{_COEFFICIENT_OF[axis]}_{variable}", general))
    return np.array(out)


def _turbulence(scenario: PlanScenario, aircraft: Aircraft, point: Point, spec: PlannedManoeuvre) -> dict[str, float]:
    """Return channel -> rms deviation from trim of a flight without input through the turbulence of the plan."""
    if scenario.turbulence_rms_m_s == 0.0:
        return {}
    above = point.h_m - scenario.timing.field_m
    seed = scenario.seed + zlib.crc32(f"{point.label}, {spec.name}".encode()) % 2**31
    air = Air(
        turbulence_rms_m_s=turbulence_rms(scenario.turbulence_rms_m_s, above),
        height_m=above,
        seed=seed,
    )
    still = build(scaled(spec.input, 0.0), spec.duration_s, point.trimmed.rate_hz)
    shown = SHOWN[spec.plane]
    try:
        record = _flight(aircraft, point, spec, still, shown, air)
    except FlightAborted as error:
        if error.record is None or len(error.record.t_s) < 2:
            raise
        record = replace(error.record, outcome="completed", reason="")
    return {n: float(np.sqrt(np.mean((record[n] - point.trimmed.state[n]) ** 2))) for n in shown}
