"""What a flight card says, in words: set-up, sequence, limits and what to do, go or no-go, what to log."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.atmosphere import air_density
from testbench.core.constants import FT_M, G0_M_S2, KT_M_S
from testbench.evaluation.derivatives import dimensional_derivatives, static_margin
from testbench.page.labels import file_stem, number, shown_unit, symbol
from testbench.page.words import listed, some
from testbench.questions.plan.injection.scripts import WATCHED, heap_bytes, injectable, lua_script
from testbench.questions.plan.repeats import leg_of
from testbench.questions.plan.scenario import HEAVY_KG, Fuel, Tow

if TYPE_CHECKING:
    from testbench.core.record import FloatArray
    from testbench.questions.plan.result import Card, Plan

_HELD_S = 0.1  # a level that lasts so long is a step that is said
_MOST_STEPS = 14
_WHAT_TO_DO = {
    "V": "release, throttle to trim, slow down by raising the nose gently; look at the record before the next run",
    "az": "release, wait for trim; repeat with half the amplitude",
    "alpha": "release, push to unload, add power; repeat with half the amplitude",
    "beta": "release the rudder, wait; repeat with half the amplitude",
    "phi": "release, level the wings, fly back to height and speed",
    "theta": "release, bring the nose to the horizon, then the speed back",
    "h": "end the run, return to height",
}
_RELEASE = {
    "pilot": "release, wings level, throttle to trim, climb away from the box's floor",
    "autopilot": "start switch low, sticks centred: the pilot has control; wings level, throttle to trim",
}
_CALLS = (
    "a limit met or the band left",
    "vibration, a new sound or smell",
    "telemetry, link or position lost",
    "traffic, people, wind",
    "anyone in doubt",
)
_HAZARDS = {
    "de": "stall or overstress in the pulse: unload first, then power",
    "da": "bank runs away to a spiral: throttle idle, level the wings, then the nose",
    "dr": "sideslip to a departure or spin: rudder centred, unload, throttle idle, recover above the floor",
    "thr": "engine stops: best glide, field ahead first",
    "elastic": "flutter: throttle idle, a gentle climb, land; the flight is over",
    "autopilot": "script or servo sticks: start switch low, another flight mode, then power off what sends",
}
_NO_EMERGENCY = "[card] emergency does not state the procedures for loss of link, fire, landing out"
_NARROW = "\u00a0"  # a unit stays on the line of its number
_STOPS = "the surface is at its limit: the run is void, trim anew"
CONTROL_NAMES = {"de": "elevator", "da": "aileron", "dr": "rudder", "thr": "throttle"}
POSITIVE = {"de": "trailing edge down", "da": "right wing down", "dr": "trailing edge left", "thr": "more power"}


@dataclass(frozen=True)
class CardText:
    """The words of a card."""

    status: str  # how it went in the simulator, in one sentence
    standing: str  # what is to be done with it, in a word or two
    setup: tuple[tuple[str, str], ...]  # (what, value)
    sequence: tuple[str, ...]  # lines on the control sequence
    # (limit, range, what to do when it is met, who watches it and where it comes from)
    limits: tuple[tuple[str, str, str, str], ...]
    modes: tuple[tuple[str, str, str, str], ...]  # (mode, frequency, damping here, predicted at the next point)
    before: tuple[str, ...]  # go or no-go before the run, one line each
    go: str  # the rule for a go to the next speed, in one sentence
    hazards: tuple[str, ...]  # what may go wrong in this manoeuvre, and what is done then
    calls: tuple[str, ...]  # what anybody calls "knock it off" for, and what follows, one line each
    emergency: tuple[str, ...]  # what is done when something fails, as the plan says
    log: tuple[str, ...]  # what to log
    notes: tuple[str, ...]  # accuracy, band, limits met at full amplitude


def card_stem(card: Card) -> str:
    """Return the name of a card's files, without ending."""
    return file_stem(f"{card.number:02d}_{card.spec.name}_{card.point.V_m_s:g}mps_{card.point.h_m:g}m")


def in_units(channel: str, plan: Plan) -> tuple[float, str]:
    """Return factor and unit in which cards give a channel: knots and feet for aircraft that are flown by them."""
    units = plan.scenario.card.units or ("aviation" if plan.aircraft.mass.mass_kg > HEAVY_KG else "metric")
    aviation = {"V": (1.0 / KT_M_S, "kt"), "h": (1.0 / FT_M, "ft")} if units == "aviation" else {}
    return aviation.get(channel) or shown_unit(channel)


def speed(V_m_s: float, plan: Plan) -> str:
    """Return a speed in the units of the cards."""
    factor, unit = in_units("V", plan)
    return f"{factor * V_m_s:.0f}{_NARROW}{unit}" if unit == "kt" else f"{V_m_s:g} m/s"


def height(h_m: float, plan: Plan) -> str:
    """Return a height in the units of the cards, feet to tens."""
    factor, unit = in_units("h", plan)
    return f"{round(factor * h_m, -1):.0f}{_NARROW}{unit}" if unit == "ft" else f"{h_m:g} m"


def card_title(card: Card, plan: Plan) -> str:
    """Return what is flown where, in the units of the cards."""
    return f"{card.spec.name} at {speed(card.point.V_m_s, plan)}, {height(card.point.h_m, plan)}"


def short_name(name: str) -> str:
    """Return the name of a mode as it fits beside its figures."""
    for long, short in (("asymmetric", "asym."), ("symmetric", "sym."), ("tail-boom", "boom"), (" and ", " + ")):
        name = name.replace(long, short)
    return name if len(name) <= 46 else name[:45] + "…"


def shown(channel: str, value: float, digits: int = 3) -> str:
    """Return a value with its shown unit."""
    factor, unit = shown_unit(channel)
    return f"{number(value * factor, digits)}{_NARROW + unit if unit else ''}"


def levels(t_s: FloatArray, u: FloatArray) -> list[tuple[float, float, float]]:
    """Return (begin, end, level) of every level but zero that a signal holds for at least 0.1 s."""
    jumps = np.flatnonzero(np.diff(u) != 0.0) + 1
    edges = [0, *jumps.tolist(), len(u)]
    dt = float(t_s[1] - t_s[0])
    return [
        (float(t_s[a]), float(t_s[a]) + (b - a) * dt, float(u[a]))
        for a, b in pairwise(edges)
        if u[a] != 0.0 and (b - a) * dt >= _HELD_S - 1e-9
    ]


def sequence_lines(card: Card) -> list[str]:
    """Return the control sequence in words, one line per control and input."""
    out = []
    for j, name in enumerate(card.signal.channels):
        held = levels(card.signal.t_s, card.signal.u[:, j])
        head = f"{CONTROL_NAMES[name]} (+: {POSITIVE[name]})"
        if held and len(held) <= _MOST_STEPS:
            steps = [f"{number(a)} to {number(b)} s: {_signed(name, level)}" for a, b, level in held]
            out.append(f"{head}: {'; '.join(steps)}; then trim")
        else:
            peak = float(np.abs(card.signal.u[:, j]).max())
            kinds = [_kind(s) for s in card.spec.input if s.control == name]
            out.append(f"{head}: {'; '.join(kinds)}; peak {shown(name, peak)}; then trim")
    return out


def _signed(name: str, value: float) -> str:
    text = shown(name, value)
    return text if value < 0.0 else f"+{text}"


def _kind(spec: Any) -> str:
    """Return a signal that is no sequence of steps in words."""
    begin = f"from {spec.start_s:g} s"
    if spec.signal == "multisine":
        band = f"{spec.f_min_hz:g} to {spec.f_max_hz:g} Hz"
        return f"multisine {begin}, {band}, {spec.periods} periods of {spec.period_s:g} s"
    if spec.signal == "sweep":
        return f"sweep {begin}, {spec.f_start_hz:g} to {spec.f_end_hz:g} Hz in {spec.sweep_s:g} s"
    return f"{spec.signal} {begin}"


def card_text(card: Card, plan: Plan) -> CardText:
    """Return the words of a card."""
    return CardText(
        status_line(card),
        standing(card),
        tuple(_setup(card, plan)),
        tuple(sequence_lines(card)),
        tuple(_limits(card, plan)),
        tuple(_modes(card)),
        tuple(before_lines(card, plan)),
        go_rule(card, plan),
        tuple(_hazards(card, plan)),
        (f"KNOCK IT OFF: {_RELEASE[plan.scenario.flown_by]}", f"called by anybody for {'; '.join(_CALLS)}"),
        plan.scenario.card.emergency or (_NO_EMERGENCY,),
        tuple(_log(card, plan)),
        tuple(_notes(card, plan)),
    )


def status_line(card: Card) -> str:
    """Return what became of a card in the simulator."""
    if card.status == "refused":
        return f"REFUSED, do not fly: {card.met[0]}"
    beyond = beyond_limits(card)
    watch = f"WATCH {listed(beyond)}, the 95 % band passes the limit; " if beyond else ""
    if card.status == "scaled":
        return f"{watch}amplitude scaled to {100.0 * card.factor:.0f} %: at full amplitude {card.met[0]}"
    return f"{watch}flown in the simulator at full amplitude: no limit is met"


def standing(card: Card) -> str:
    """Return what is to be done with a card, in a word or two.

    "fly" stands only where the 95 % band of the expected response, too, keeps every limit. Where it does not, a flight
    may meet the limit though the simulator's did not: "watch".
    """
    if card.status == "refused":
        return "refused"
    words = [f"scaled to {100.0 * card.factor:.0f} %"] if card.status == "scaled" else []
    words += ["watch"] if beyond_limits(card) else []
    return ", ".join(words) or "fly"


def _setup(card: Card, plan: Plan) -> list[tuple[str, str]]:
    point, scenario = card.point, plan.scenario
    trimmed = point.trimmed
    eas = point.V_m_s * math.sqrt(air_density(point.h_m) / air_density(0.0))
    mine = [r for r in plan.runs if r.card is card]
    flights = sorted({r.flight for r in mine})
    names = {"de": "elevator", "thr": "throttle"}
    held = ", ".join(f"{words} {shown(n, trimmed.controls[n])}" for n, words in names.items() if n in trimmed.controls)
    factor, unit = in_units("V", plan)
    above = height(point.h_m - scenario.timing.field_m, plan)
    steps = sorted({p.V_m_s for p in plan.points if p.h_m == point.h_m})
    out = [
        ("aircraft", plan.aircraft.name),
        ("configured", scenario.card.configuration or "flaps, gear and payload as in the model of the aircraft"),
        ("mass, c.g.", _mass_words(card, plan)),
        ("speed", f"{speed(point.V_m_s, plan)} true, {eas * factor:.3g} {unit} equivalent"),
        ("height", f"{height(point.h_m, plan)} above sea level, {above} above the field"),
        ("build-up", f"speed {steps.index(point.V_m_s) + 1} of {len(steps)}: {_steps_words(steps, plan)}"),
        ("trim", f"alpha {shown('alpha', trimmed.alpha)}, {held}, hands off for {card.spec.settle_s:g} s"),
        ("to the onset", onset_words(card, plan)),
        (
            "runs",
            f"{card.repeats} of {card.length_s:g} s"
            + (
                f": no. {_range(mine[0].number, mine[-1].number)}, flight {', '.join(map(str, flights))}"
                if mine
                else ""
            ),
        ),
        ("power", _power_words(card, plan)),
        ("flown by", scenario.flown_by),
    ]
    out += _script_rows(card, plan)
    return out


def _mass_words(card: Card, plan: Plan) -> str:
    """Return mass, and where the centre of gravity lies by the static margin that it makes."""
    found = static_margin(plan.aircraft, dimensional_derivatives(card.point.model, card.point.trimmed))
    mass = plan.aircraft.mass.mass_kg
    where = f"{abs(found.flown):.0f} % of the chord {'ahead of' if found.flown > 0.0 else 'BEHIND'} the neutral point"
    return f"{f'{mass:.0f}' if mass >= 100.0 else f'{mass:.3g}'} kg; c.g. {where}"


def _steps_words(steps: Sequence[float], plan: Plan) -> str:
    factor, unit = in_units("V", plan)
    return f"{some([f'{factor * V:.3g}' for V in steps], 6, ', ')} {unit}, slow to fast"


def _power_words(card: Card, plan: Plan) -> str:
    """Return what level flight takes: watts, or litres of fuel in an hour; a glider, its sink."""
    energy, power = plan.scenario.energy, card.point.power_W
    if isinstance(energy, Fuel):
        return f"{_litres(3600.0 * power, energy):.3g} litres of fuel in an hour of level flight"
    if isinstance(energy, Tow):
        return f"sinks at {power / plan.weight_N:.2g} m/s"
    return f"{number(power)} W in level flight"


def _litres(energy_J: float, fuel: Fuel) -> float:
    return energy_J / (1e6 * fuel.heating_MJ_kg * fuel.density_kg_l)


def _hazards(card: Card, plan: Plan) -> list[str]:
    """Return what may go wrong in this manoeuvre; the plan's own lines come first."""
    kinds: list[str] = [*card.spec.controls]
    kinds += ["elastic"] if any(m.elastic for m in card.point.modes) else []
    kinds += ["autopilot"] if plan.scenario.flown_by == "autopilot" else []
    return [*plan.scenario.card.hazards, *(_HAZARDS[k] for k in kinds)]


def _script_rows(card: Card, plan: Plan) -> list[tuple[str, str]]:
    """Return the script of a card, its settings and its switch, or why there is none."""
    pilot = plan.scenario.autopilot
    if plan.scenario.flown_by != "autopilot" or card.status == "refused":
        return []
    if "thr" in card.spec.controls:
        return [("script", "none: scripts move surfaces only; command the throttle by hand or from the CSV")]
    if pilot.system == "own":
        return [("player", f"your own, at {1e3 / pilot.period_ms:.3g} Hz, from {card_stem(card)}.csv")]
    if pilot.system == "px4":
        need = {
            "manual_control": "PX4 1.17 or later, mode MANUAL, COM_RC_IN_MODE 6",
            "actuator_control": "PX4 1.13 with mixers, from MANUAL",
        }[pilot.interface]
        return [
            ("script", f"{card_stem(card)}.py on a companion computer; {need}"),
            ("switch", f"radio channel {pilot.switch_channel}: low, then high; low, or a stick, at once ends it"),
        ]
    heap = heap_bytes(lua_script(card, plan.aircraft, pilot))
    return [
        ("script", f"{card_stem(card)}.lua; SCR_USER1 = {card.number}, mode {pilot.mode}"),
        ("switch", f"RCn_OPTION = {pilot.switch_option}: low, then high; low, or a stick, at once ends it"),
        ("memory", f"one script at a time in APM/scripts; it takes up to {heap} of SCR_HEAP_SIZE"),
    ]


def _range(first: int, last: int) -> str:
    return f"{first}" if first == last else f"{first} to {last}"


def onset_words(card: Card, plan: Plan) -> str:
    """Return the distance to the onset of instability in words."""
    point = card.point
    if point.margin is None or point.onset is None or point.onset.V_m_s is None:
        return "no elastic instability predicted"
    factor, unit = in_units("V", plan)
    return f"{100.0 * point.margin:.0f} % below {factor * point.onset.V_m_s:.3g} {unit} ({point.onset.name})"


def _limits(card: Card, plan: Plan) -> list[tuple[str, str, str, str]]:
    out = []
    for limit in card.limits:
        if limit.channel == "az":
            low, high, unit, name = -limit.high / G0_M_S2, -limit.low / G0_M_S2, "g", "load factor"
        else:
            factor, unit = in_units(limit.channel, plan)
            low, high, name = limit.low * factor, limit.high * factor, symbol(limit.channel)
        if not math.isfinite(low) or (limit.channel == "V" and low <= 0.0):
            span = f"≤ {_plain(high)} {unit}"
        else:
            span = f"{_plain(low)} to {_plain(high)} {unit}"
        who = watcher(limit.channel, card, plan)
        out.append((name, span, _WHAT_TO_DO.get(limit.channel, _STOPS), f"{who} watches, {limit.source}"))
    slower = "start switch low, " if plan.scenario.flown_by == "autopilot" else "release, "
    if any(m.elastic for m in card.point.modes):
        what = f"{slower}throttle idle, slow down by a tenth; the flight is over"
        out.append(("vibration", "dies away", what, "PILOT watches"))
    return out


def watcher(channel: str, card: Card, plan: Plan) -> str:
    """Return who watches a limit: the script where one flies the card and measures it, else the pilot.

    A surface's deflection needs no watching where a script commands it: it does not start without room for it.
    """
    scripted = plan.scenario.flown_by == "autopilot" and plan.scenario.autopilot.scripted and injectable(card)
    return "script" if scripted and (channel in WATCHED or channel in CONTROL_NAMES) else "PILOT"


def _plain(value: float) -> str:
    return (f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.3g}").replace("-", "−")


def _modes(card: Card) -> list[tuple[str, str, str, str]]:
    rows = []
    for m in card.point.modes:
        if not m.elastic and (m.name in {"phugoid", "short period"}) != (card.spec.plane == "longitudinal"):
            continue
        rows.append(
            (
                short_name(m.name),
                f"{number(m.f_hz)} Hz",
                _damping(m.zeta),
                "–" if m.zeta_next is None else _damping(m.zeta_next),
            )
        )
    return rows


def _damping(zeta: float) -> str:
    return f"{zeta:.4f}".replace("-", "−")


def before_lines(card: Card, plan: Plan) -> list[str]:
    """Return what decides before a run whether it is flown, one line each: wind, box, energy."""
    if card.status == "refused" or not card.repeats:
        return ["NO-GO: the card is refused"]
    scenario, space = plan.scenario, plan.scenario.airspace
    beyond = beyond_limits(card)
    out = _cleared_lines(card, plan)
    out += [f"limits: GO if the monitor of {listed(beyond)} is ready to end the run"] if beyond else []
    if space is not None:
        gusts = "" if space.gust_m_s is None else f" and gusts at most {speed(space.gust_m_s, plan)}"
        rms = scenario.turbulence_rms_m_s
        calm = f"; turbulence no stronger than {rms:g} m/s rms" if rms else ""
        out.append(f"weather: GO if the mean wind is at most {speed(space.wind_m_s, plan)}{gusts}{calm}")
        leg = leg_of(card, space)
        turn = f"turn back after {leg.runs} {'run' if leg.runs == 1 else 'runs'}" if leg.turns else "no turn between"
        out.append(
            f"box: GO if {leg.run_m:.0f} m lie ahead per run; {turn}, {leg.radius_m:.0f} m radius, {leg.turn_s:.0f} s; "
            f"floor {height(space.lowest_m, plan)}, ceiling {height(space.highest_m, plan)} above sea level"
        )
    need = _energy_of_a_run_J(card, plan)
    if isinstance(scenario.energy, Tow):
        kept = scenario.energy.lowest_m
        out.append(
            f"height: GO if the run ends above {height(kept, plan)}; it takes {need / plan.weight_N:.0f} m and the "
            "landing"
        )
    elif isinstance(scenario.energy, Fuel):
        out.append(
            f"fuel: GO if {_litres(need, scenario.energy):.2g} litres of what is usable are left: this run and landing"
        )
    else:
        out.append(
            f"{scenario.energy.kind}: GO if {need / 3600.0:.3g} Wh of what is usable are left: this run and landing"
        )
    return out


def _cleared_lines(card: Card, plan: Plan) -> list[str]:
    """Return whether this speed is cleared, of an aircraft whose structure vibrates."""
    waits, told = plan.waits(card.point.V_m_s), plan.cleared
    if told is None:
        return [f"speed: NO-GO yet, {waits}"] if waits else []
    if not any(m.elastic for m in card.point.modes):
        return []
    factor, unit = in_units("V", plan)
    shown_at = {p: f"{factor * V:.3g} {unit}" for p, V in {**told.onset_m_s, "most": told.cleared_m_s}.items()}
    median = f", its median at {shown_at['0.5']}" if "0.5" in shown_at else ""
    flown = some([f"{factor * V:.3g}" for V in told.flown_m_s], 4, ", ")
    return [
        f"speed: {'NO-GO yet' if waits else 'GO'}, cleared to {shown_at['most']}; flutter lies lower at a probability "
        f"of {100.0 * told.risk:.2g} %{median}, after {flown} {unit}"
    ]


def _energy_of_a_run_J(card: Card, plan: Plan) -> float:
    """Return the energy of one run with its turn, and of half the time beside the runs, which is the way home."""
    timing = plan.scenario.timing
    return card.point.power_W * (card.length_s + timing.turn_s + 0.5 * timing.overhead_s)


def go_rule(card: Card, plan: Plan) -> str:
    """Return the rule for going on to the next point."""
    following = card.point.next_V_m_s
    if following is None:
        return "last speed of the build-up at this height"
    if not any(m.elastic for m in card.point.modes):
        return f"GO to {speed(following, plan)} if no limit was met and the response lay inside its band"
    return (
        f"GO to {speed(following, plan)} if testbench modes clears it from the records so far, no limit was met and "
        "the response lay inside its band; else NO-GO, evaluate on the ground"
    )


def _log(card: Card, plan: Plan) -> list[str]:
    suite = plan.suite
    out = [f"{suite.title} (suite {suite.name}): {', '.join(suite.channels)} at {suite.rate_hz:g} Hz"]
    commands = ", ".join(f"{c}_cmd" for c in card.spec.controls)
    out.append(f"the commands {commands} at no less than {suite.rate_hz:g} Hz, in the same file and clock")
    if plan.scenario.flown_by == "autopilot" and plan.scenario.autopilot.system == "ardupilot":
        out.append("the autopilot's own log, with the TBSQ messages of the script: LOG_BITMASK bits 0 or 20, 13, 19")
    elif plan.scenario.flown_by == "autopilot" and plan.scenario.autopilot.system == "px4":
        out.append("the autopilot's own log: SDLOG_PROFILE 25")
    out.append("run number, time of day, wind, battery before and after, remarks of the crew")
    return out


def beyond_limits(card: Card) -> list[str]:
    """Return the symbols of limited channels whose band passes a limit."""
    out = []
    for limit in card.limits:
        if limit.channel in card.band:
            y, half = card.expected[limit.channel], card.band[limit.channel]
            if np.any(y - half < limit.low) or np.any(y + half > limit.high):
                out.append(symbol(limit.channel))
    return out


def _notes(card: Card, plan: Plan) -> list[str]:
    scenario = plan.scenario
    rough = f", and from turbulence of {scenario.turbulence_rms_m_s:g} m/s rms" if scenario.turbulence_rms_m_s else ""
    own = ", or by the stated uncertainty of the aircraft" if plan.aircraft.uncertainty else ""
    out = [
        "the 95 % band comes from sensor noise and from derivatives of the rigid motion that are each uncertain by "
        f"{scenario.uncertainty_percent:g} % (one standard deviation){own}{rough}"
    ]
    out += [f"accuracy, {r.sentence}" for r in card.reached]
    out += _system_id(card, plan)
    if card.status != "fly":
        out += [f"at full amplitude: {text}" for text in card.met[1:3]]
    return out


_SID_AXIS = {"de": 23, "da": 22}  # SID_AXIS of ArduPilot Plane: FW Mixer Pitch, FW Mixer Roll


def _system_id(card: Card, plan: Plan) -> list[str]:
    """Return the settings of ArduPilot's own system identification where it can fly the like of a card.

    Plane 4.7 and later, in fixed-wing flight: a chirp of exponentially rising frequency on pitch or roll.
    """
    pilot, entries = plan.scenario.autopilot, card.spec.input
    if plan.scenario.flown_by != "autopilot" or pilot.system != "ardupilot" or card.status == "refused":
        return []
    sweep = entries[0]
    if len(entries) != 1 or sweep.signal != "sweep" or sweep.control not in _SID_AXIS:
        return []
    control = plan.aircraft.controls[sweep.control]
    part = card.factor * abs(sweep.amplitude) / min(control.full, -control.low)
    return [
        f"Plane 4.7 and later flies a like sweep at the rate of its loop: SID_AXIS {_SID_AXIS[sweep.control]}, "
        f"SID_MAGNITUDE {part:.3g}, SID_F_START_HZ {sweep.f_start_hz:g}, SID_F_STOP_HZ {sweep.f_end_hz:g}, SID_T_REC "
        f"{sweep.sweep_s:g}, RCn_OPTION 184; its stabilisation stays on, and it monitors none of these limits"
    ]
