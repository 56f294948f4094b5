"""A complete, commented plan file for an aircraft, with designs taken over where there are some."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.door import read_text
from testbench.core.errors import RecordError, ScenarioError
from testbench.core.escape import one_line, quoted, toml_value
from testbench.core.paths import AIRCRAFT, SENSOR_SUITES, as_named, not_found, suite_names
from testbench.core.scenario.air import CALM_RMS_M_S
from testbench.core.scenario.base import Manoeuvre
from testbench.core.store import settle
from testbench.evaluation.modes import longitudinal_modes
from testbench.flight import FlightCondition, LinearModel, TrimmedFlight, linearise, trim
from testbench.page.labels import number
from testbench.questions.design.scenario import DesignScenario
from testbench.questions.plan.bounds import stall_speed_m_s
from testbench.questions.plan.repeats import turn_back
from testbench.questions.plan.result import Point
from testbench.questions.plan.scenario import HEAVY_KG, Airspace, PlanLimits, PlannedManoeuvre
from testbench.questions.run.scenario import Scenario
from testbench.sensors import SensorSuite, load_suite
from testbench.sensors.suite import MOTIONS, needed

_SPEEDS = (0.9, 1.0, 1.1)  # of the design speed
_ABOVE_STALL = 1.25  # 1.2 stall speeds are the lowest limit: a planned speed lies above it
_BELOW_LIMIT = 0.9
_THROW = {"de": 0.15, "da": 0.15, "dr": 0.2}  # amplitude as a part of full throw; the plan scales it down at a limit
_USUAL_LIMITS = {
    "load_factor": "[0.0, 2.0]", "alpha_deg": "[-5.0, 10.0]", "beta_deg": "10.0", "bank_deg": "40.0",
    "pitch_change_deg": "30.0", "speed_change_m_s": "3.0", "height_change_m": "30.0", "V_min_m_s": "10.0",
    "V_max_m_s": "20.0", "deflection_deg": "{ de = 10.0 }", "rate_deg_s": "{ de = 300.0 }",
}  # fmt: skip
_ABOVE_M = ((25.0, 100.0), (HEAVY_KG, 300.0), (math.inf, 1000.0))
"""(up to this mass in kg, height above the field in m): room to recover in, some 3000 ft for what carries people."""
_WIND = (0.3, 8.0)  # strongest wind of a new plan: a part of the speed, at most so many m/s
_LEVEL_MIN = 20.0  # time of level flight that the battery of a new plan holds
_SETTLE_S = 2.0
_SIGNALS_PER_S = 50.0  # what an autopilot's script reaches: steps last whole periods of it


def suite_of(aircraft: Aircraft) -> tuple[str, bool]:
    """Return the packaged suite for an aircraft, and whether it is its own: else it is one to be replaced."""
    own = [name for name in suite_names() if name.startswith(f"{aircraft.name.split(',')[0]}_")]
    return (own[0], True) if own else ("eolo_alpha", False)


def plan_text(
    aircraft: Aircraft, name: str, autopilot: str, suite: str | None = None, designs: Sequence[Taken] = ()
) -> str:
    """Return the text of a plan that is complete: it can be flown in the simulator as it is.

    Args:
        aircraft: what flies.
        name: as the file names it: packaged, a path, or a folder of the project.
        autopilot: "ardupilot", "px4", "own", or "pilot" for flights by hand.
        suite: sensors; those of the designs, or a packaged suite of the aircraft, if None.
        designs: taken over; without them the usual manoeuvres for the rigid motion.

    Raises:
        TrimError: the aircraft cannot be trimmed at its design condition.
        ScenarioError: a design cannot be flown by a plan.
    """
    V, h = _conditions(aircraft, designs)[0]
    point = _point(aircraft, V, h)
    flown = [_design(t, m, designs) for t in designs for m in (t.manoeuvre, t.judge) if m is not None]
    if not designs:
        chosen, own = (suite, True) if suite else suite_of(aircraft)
        flown = _usual(aircraft, point.model, autopilot, load_suite(chosen) if own else None)
    lines = _head(aircraft, name, autopilot, point, suite, designs, max(length for _, length in flown))
    lines += [line for made, _ in flown for line in made]
    return "\n".join(lines).rstrip() + "\n"


def plan_head(aircraft: Aircraft, name: str, autopilot: str, longest_s: float) -> str:
    """Return the text of a plan of one speed up to its manoeuvres, of which the longest lasts so long.

    Raises:
        TrimError: the aircraft cannot be trimmed at its design condition.
    """
    point = _point(aircraft, *_conditions(aircraft, ())[0])
    return "\n".join(_head(aircraft, name, autopilot, point, None, (), _SETTLE_S + longest_s))


def _point(aircraft: Aircraft, V: float, h: float) -> Point:
    trimmed = trim(aircraft, FlightCondition(V, h))
    return Point(1, V, h, trimmed, linearise(aircraft, trimmed), 0.0, None, (), None)


def _head(
    aircraft: Aircraft,
    name: str,
    autopilot: str,
    point: Point,
    suite: str | None,
    designs: Sequence[Taken],
    longest: float,
) -> list[str]:
    """Return the lines of a plan before its manoeuvres."""
    V, trimmed = point.V_m_s, point.trimmed
    chosen, own = (suite, True) if suite else (designs[0].scenario.suites[0], True) if designs else suite_of(aircraft)
    stall = stall_speed_m_s(aircraft, point)
    speeds, heights = _speeds(aircraft, V, stall), [point.h_m]
    if designs:
        speeds = sorted({V for V, _ in _conditions(aircraft, designs)})
        heights = sorted({h for _, h in _conditions(aircraft, designs)})
    above = _above_m(aircraft)
    field = max(0.0, round(min(heights) - above, -1)) if min(heights) > 0.0 else min(heights) - above
    wings = [f"wings = {quoted(designs[0].scenario.wings)}"] if designs else []
    airs = [d.scenario.air if d.asked is None else d.asked.expected_air for d in designs]
    rms = max((air.turbulence_rms_m_s for air in airs), default=CALM_RMS_M_S)
    stall_words = "" if stall is None else f"; level flight at {stall:.3g} m/s takes the highest angle of attack"
    lines = [
        "# A flight plan, made by `testbench plan new`. It can be run unchanged. Enter your own values, then",
        "#     testbench check THIS_FILE",
        "#     testbench plan THIS_FILE",
        "# Lines with YOURS are guesses.",
        f"title = {quoted(f'{Path(name).name}: flights to identify it from')}",
        'question = "How many flights does it take, and what stays inside the limits?"',
        f"aircraft = {quoted(as_named(name, AIRCRAFT))}",
        *wings,
        "seed = 1                      # of the turbulence that widens the expected bands",
        f"flown_by = {quoted('pilot' if autopilot == 'pilot' else 'autopilot')}",
        f"speeds_m_s = [{_numbers(speeds)}]  # true airspeeds{stall_words}",
        f"heights_m = [{_numbers(heights)}]  # above sea level",
        "scale = true                  # lower the amplitude of a card that meets a limit, instead of refusing it",
        f"suite = {quoted(as_named(chosen, SENSOR_SUITES))}"
        + ("" if own else "  # YOURS: these are the sensors of another aircraft"),
        "uncertainty_percent = 15.0    # of each derivative of the model, one standard deviation",
        f"turbulence_rms_m_s = {rms:g}      # vertical air that the expected bands allow for",
        "onset_margin_percent = 10.0   # below the onset of an elastic instability",
        "",
        (
            "# Keys that are omitted here come from the aircraft: alpha, sideslip and stops by its own limits, speed "
            "between"
        ),
        "# 1.2 stall speeds and its limit, bank and pitch by half its limit but 30 to 45 deg, load factor 0 to 2,",
        "# height by half the height above the field. Each card says where its limits come from and who watches them.",
        *_limits(designs),
        "[timing]",
        f"turn_s = {45.0 if V < 40.0 else 90.0}                 # YOURS: per run, to turn back and trim again",
        "overhead_s = 180.0            # YOURS: per flight, for take-off, climb, descent and landing",
        f"field_m = {_plain(field)}                # YOURS: height of the field above sea level",
        "",
        *_airspace(max(speeds), max(heights), field, longest),
        *_energy(aircraft, trimmed, V, heights, field),
        "[card]                        # what cards say that no simulation knows",
        f"units = {quoted('aviation' if aircraft.mass.mass_kg > HEAVY_KG else 'metric')}"
        f"{' ' * 14}# knots and feet, or m/s and m",
        '# configuration = "flaps up, gear up, camera on board"   # YOURS',
        '# hazards = ["birds at the ridge"]                       # YOURS',
        '# emergency = ["loss of link: it returns and circles"]   # YOURS: loss of link, fire, landing out',
        "",
    ]
    if autopilot != "pilot":
        lines += [
            "[autopilot]",
            "# ardupilot: a Lua script per card; px4: a MAVLink sender per card; own: the signals as CSV alone",
            f"system = {quoted(autopilot)}",
            *(
                [
                    "switch_option = 300           # RCn_OPTION of the start switch",
                    "mode = 0                      # MANUAL",
                ]
                if autopilot == "ardupilot"
                else []
            ),
            *(["switch_channel = 7            # radio channel of the start switch"] if autopilot == "px4" else []),
            "period_ms = 20                # how often a script sends; the simulated input is held as long",
            "speed_window_m_s = 1.0        # a run starts within this of the card's speed",
            "",
        ]
    return lines


def _above_m(aircraft: Aircraft) -> float:
    """Return the height above the field at which a new plan flies."""
    return next(above for most, above in _ABOVE_M if aircraft.mass.mass_kg <= most)


def _conditions(aircraft: Aircraft, designs: Sequence[Taken]) -> list[tuple[float, float]]:
    if not designs:
        return [(aircraft.design_V_m_s, max(aircraft.design_h_m, _above_m(aircraft)))]
    return [(t.scenario.condition.V_m_s, t.scenario.condition.h_m) for t in designs]


def _speeds(aircraft: Aircraft, V_m_s: float, stall: float | None) -> list[float]:
    """Return the speeds of a new plan: around the design speed, between the stall and the aircraft's limit."""
    low, high = aircraft.limits.get("V", (0.0, math.inf))
    least = max(low, _ABOVE_STALL * stall if stall is not None else 0.0)
    tried = [float(f"{part * V_m_s:.3g}") for part in _SPEEDS]
    return [V for V in tried if least < V < _BELOW_LIMIT * high or V_m_s == V] or [V_m_s]


def _limits(designs: Sequence[Taken]) -> list[str]:
    """Return the limits: those of the designs, and as comments what else may be given."""
    known = limits_of_designs(designs)
    unknown = [t.file.name for t in designs if t.asked is None]
    lines = ["[limits]"]
    if unknown:
        lines.append(f"# The limits of {', '.join(unknown)} are not known: no design.toml lies beside its folder.")
    for key, usual in _USUAL_LIMITS.items():
        lines.append(f"{key} = {toml_value(known[key])}" if key in known else f"# {key} = {usual}")
    return [*lines, ""]


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(_plain(v) for v in values)


def _plain(value: float) -> str:
    return repr(float(f"{value:.6g}"))


def _airspace(V: float, h: float, field: float, longest_s: float) -> list[str]:
    """Return the box: two of the longest runs at the fastest speed fit between its turns."""
    wind = float(round(min(_WIND[0] * V, _WIND[1])))
    space = Airspace(length_m=1e5, width_m=1e5, lowest_m=0.0, highest_m=1.0, wind_m_s=wind)
    radius, turn_s = turn_back(V, space)
    length = 2.0 * (V + wind) * longest_s + 2.0 * radius + wind * turn_s
    return [
        "[airspace]                    # YOURS: leave it out if nobody limits you",
        f"length_m = {_plain(100.0 * math.ceil(length / 100.0))}            # the runs lie along it",
        f"width_m = {_plain(100.0 * math.ceil(max(2.0 * radius, 200.0) / 100.0))}",
        f"lowest_m = {_plain(field)}              # above sea level",
        f"highest_m = {_plain(h + (h - field))}",
        f"wind_m_s = {_plain(wind)}                # strongest mean wind in which you fly",
        "",
    ]


def _energy(aircraft: Aircraft, trimmed: TrimmedFlight, V: float, heights: Sequence[float], field: float) -> list[str]:
    source = 'source = "YOURS: a guess of testbench plan new"'
    if "thr" not in aircraft.controls:
        return [
            "[energy]                      # YOURS",
            'kind = "tow"',
            f"release_m = {_plain(max(heights) + 300.0)}",
            f"lowest_m = {_plain(field + 50.0)}",
            "",
        ]
    power = max(trimmed.state.get("thrust", 0.0), 0.0) * V
    if aircraft.mass.mass_kg > HEAVY_KG:
        kg = max(1.0, 2.0 * 3600.0 * power / 0.25 / 43e6 / 0.8)
        return [
            "[energy]                      # YOURS",
            'kind = "fuel"',
            f"capacity_kg = {_plain(float(f'{kg:.2g}'))}",
            "efficiency_percent = 25.0     # from fuel to thrust power",
            source,
            "",
        ]
    watt_hours = max(5.0, (power / 0.5 + 5.0) * _LEVEL_MIN / 60.0 / 0.8)
    return [
        "[energy]                      # YOURS",
        'kind = "battery"',
        f"capacity_Wh = {_plain(float(f'{watt_hours:.2g}'))}",
        "usable_percent = 80.0",
        "efficiency_percent = 50.0     # from battery to thrust power",
        "avionics_W = 5.0",
        source,
        "",
    ]


def _design(taken: Taken, manoeuvre: Manoeuvre, designs: Sequence[Taken]) -> tuple[list[str], float]:
    """Return the lines of a manoeuvre of a design, and the time of one run."""
    made = planned(taken, manoeuvre)
    name = made.name
    if sum(name in (t.manoeuvre.name, t.judge.name if t.judge else "") for t in designs) > 1:
        name = f"{name} {designs.index(taken) + 1}"
    condition = taken.scenario.condition
    judges = made.use == "validation"
    promised = [
        f"# Taken from {one_line(taken.file.name)}. Promised standard errors of one run:",
        *(f"#     {text}" for text in taken.promised),
    ]
    lines = [
        *(["# It judges what the manoeuvre before it gave."] if judges else promised),
        "[[manoeuvre]]",
        f"name = {quoted(name)}",
        f"duration_s = {_plain(made.duration_s)}",
        f"settle_s = {_plain(made.settle_s)}",
        "repeats = 1",
        f"design = {quoted(made.design or '')}",
        *(['use = "validation"'] if judges else []),
        f"speeds_m_s = [{_plain(condition.V_m_s)}]",
        f"heights_m = [{_plain(condition.h_m)}]",
    ]
    for entry in manoeuvre.input:
        given = entry.model_dump(exclude_defaults=True, exclude_none=True)
        lines += ["[[manoeuvre.input]]", *(f"{key} = {toml_value(value)}" for key, value in given.items())]
    return [*lines, ""], made.settle_s + made.duration_s


def _usual(
    aircraft: Aircraft, model: LinearModel, autopilot: str, suite: SensorSuite | None
) -> list[tuple[list[str], float]]:
    """Return the usual manoeuvres, and the time of one run of each.

    A 3-2-1-1 on the elevator at the short period, doublets at the Dutch roll; of a motion that the sensors do not see,
    what it would take. ``suite`` is None where the sensors are a guess.

    Raises:
        ScenarioError: the sensors see neither motion.
    """
    seen = [m for m in MOTIONS if suite is None or suite.sees(m)]
    if not seen:
        assert suite is not None
        raise ScenarioError(
            f"the sensors of a plan must see a motion ({needed()}), got {', '.join(suite.channels)} of {suite.name}"
        )
    least = 1.0 if autopilot == "pilot" else 5.0 / _SIGNALS_PER_S
    out: list[tuple[list[str], float]] = []
    short = _period_s(longitudinal_modes(model, {}), "short period")
    step = _rounded(0.3 * short, least)
    pilot = ["pilot = { rise_s = 0.2, shortest_s = 1.0 }"] if autopilot == "pilot" else []
    if "de" in aircraft.controls and "longitudinal" in seen:
        words = f"# Steps of 0.3 times the period of the short period, {number(short)} s at the design speed."
        lasts = _whole(1.0 + 7.0 * step + max(3.0, 3.0 * short))
        shape = _input(aircraft, "de", "3211", [f"step_s = {_plain(step)}"], pilot)
        out.append(([words, *_manoeuvre("elevator 3-2-1-1", lasts, "M_alpha"), *shape], _SETTLE_S + lasts))
    dutch = _dutch_roll_s(model)
    half = _rounded(0.5 * dutch, least)
    for control, name, parameter in (("da", "aileron doublet", "L_da"), ("dr", "rudder doublet", "N_dr")):
        if control in aircraft.controls and "lateral" in seen:
            words = f"# One period of the Dutch roll, {number(dutch)} s at the design speed."
            lasts = _whole(1.0 + 2.0 * half + max(3.0, 2.0 * dutch))
            shape = _input(aircraft, control, "doublet", [f"period_s = {_plain(2.0 * half)}"], pilot)
            out.append(([words, *_manoeuvre(name, lasts, parameter), *shape], _SETTLE_S + lasts))
    unseen = [m for m in MOTIONS if m not in seen]
    if out and unseen:
        out[-1][0].extend(f"# Nothing of the {m} motion: that needs {needed(m)} among the sensors." for m in unseen)
    return out


def _whole(value_s: float) -> float:
    """Return a time rounded up to half seconds."""
    return math.ceil(2.0 * value_s) / 2.0


def _manoeuvre(name: str, duration_s: float, parameter: str) -> list[str]:
    return [
        "[[manoeuvre]]",
        f"name = {quoted(name)}",
        f"duration_s = {_plain(duration_s)}",
        f"settle_s = {_plain(_SETTLE_S)}",
        f"repeats = 3                   # or accuracy_percent = {{ {parameter} = 5.0 }}: the repeats follow from it",
    ]


def _input(aircraft: Aircraft, control: str, signal: str, shape: list[str], pilot: list[str]) -> list[str]:
    c = aircraft.controls[control]
    amplitude = math.degrees(_THROW[control] * min(c.full, -c.low))
    return [
        "[[manoeuvre.input]]",
        f"signal = {quoted(signal)}",
        f"control = {quoted(control)}",
        f"amplitude_deg = {_plain(float(f'{amplitude:.2g}'))}",
        *shape,
        "start_s = 1.0",
        *pilot,
        "",
    ]


def _rounded(value_s: float, least_s: float) -> float:
    """Return a time as whole periods of an autopilot's script, inside what can be flown."""
    return min(max(round(value_s * _SIGNALS_PER_S) / _SIGNALS_PER_S, least_s), 3.0)


def _period_s(modes: dict[str, complex], name: str) -> float:
    """Return 2 pi over the natural frequency of a mode; of two roots, over the geometric mean."""
    found = [abs(pole) for mode, pole in modes.items() if mode.startswith(name)]
    return 2.0 * math.pi / float(np.sqrt(np.prod(found)) if len(found) > 1 else found[0]) if found else 1.0


def _dutch_roll_s(model: LinearModel) -> float:
    """Return the period of the fastest oscillation of the lateral motion, 1 s if there is none."""
    states = [s for s in ("v", "p", "r", "phi") if s in model.states]
    poles = np.linalg.eigvals(model.subsystem(states).A)
    pairs = [abs(p) for p in poles if p.imag > 1e-6]
    return 2.0 * math.pi / max(pairs) if pairs else 1.0


# --- designs that are taken over --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Taken:
    """A designed manoeuvre: its file, the scenario in it, the manoeuvre to identify from, and what was promised.

    ``judge`` is the manoeuvre that the design is judged by, None without one; ``asked`` the design scenario that lies
    beside, with limits and who flies, None where it does not.
    """

    file: Path
    scenario: Scenario
    manoeuvre: Manoeuvre
    judge: Manoeuvre | None
    promised: tuple[str, ...]
    asked: DesignScenario | None


def take(paths: Sequence[Path]) -> list[Taken]:
    """Return the designs of folders (the best of each) or files.

    Raises:
        RecordError: a path holds no design.
        ScenarioError: designs that one plan cannot hold: of several aircraft or suites, or what no plan can fly.
    """
    out = [_taken(path) for path in paths]
    for key, found in (
        ("aircraft", {(t.scenario.aircraft, t.scenario.wings) for t in out}),
        ("suites", {t.scenario.suites[0] for t in out}),
    ):
        if len(found) > 1:
            words = sorted(" with wings ".join(x) if isinstance(x, tuple) else x for x in found)
            raise ScenarioError(
                f"the designs of one plan must have the same {key}, got {', '.join(words)}; make a plan of each"
            )
    return out


def _taken(path: Path) -> Taken:
    file = settle(path)
    if path.is_dir():
        folder = path / "designs" if (path / "designs").is_dir() else path
        ranked = sorted((p for p in folder.glob("*.toml") if p.stem[:1].isdigit()), key=lambda p: (_rank(p), p.name))
        if not ranked:
            raise RecordError(
                f"a folder with designs must hold designs/1_*.toml, as `testbench design` writes them, got '{path}'"
            )
        file = ranked[0]
    if not file.is_file():
        raise RecordError(f"a design must be a file or a folder that `testbench design` wrote, got {not_found(file)}")
    scenario = Scenario.load(file)
    flown = [m for m in scenario.manoeuvre if m.use != "validation"]
    if not flown:
        raise ScenarioError(f"{file}, manoeuvre: a design must have one with use = 'identification'")
    lines = read_text(file, "scenario").splitlines()
    promised = tuple(line.lstrip("# ") for line in lines[: _comments(lines)] if line.startswith("#  "))
    asked = file.parent.parent / "design.toml"
    judge = next((m for m in scenario.manoeuvre if m.use == "validation"), None)
    return Taken(file, scenario, flown[0], judge, promised, DesignScenario.load(asked) if asked.is_file() else None)


def limits_of_designs(taken: Sequence[Taken]) -> dict[str, object]:
    """Return the limits that all designs keep, key -> value as a plan has it: the narrowest of each that is given."""
    out: dict[str, object] = {}
    for design in taken:
        if design.asked is None:
            continue
        for key, value in design.asked.limits.model_dump(exclude_none=True).items():
            if key not in PlanLimits.model_fields or value == {}:
                continue
            had = out.get(key)
            if isinstance(value, dict):
                surfaces = {c: v for c, v in value.items() if c != "thr"}
                both = had if isinstance(had, dict) else {}
                out[key] = {c: min(v, both.get(c, v)) for c, v in {**both, **surfaces}.items()}
            elif isinstance(value, tuple):
                out[key] = value if not isinstance(had, tuple) else (max(had[0], value[0]), min(had[1], value[1]))
            else:
                out[key] = value if not isinstance(had, float) else min(had, value)
    return out


def _rank(path: Path) -> int:
    digits = path.stem.split("_")[0]
    return int(digits) if digits.isdigit() else 0


def _comments(lines: Sequence[str]) -> int:
    """Return how many lines the comment at the head of a file has."""
    return next((i for i, line in enumerate(lines) if not line.startswith("#")), len(lines))


def planned(taken: Taken, manoeuvre: Manoeuvre) -> PlannedManoeuvre:
    """Return a manoeuvre of a design as a plan has it.

    Raises:
        ScenarioError: a plan cannot fly it.
    """
    made = {
        "name": manoeuvre.name,
        "duration_s": manoeuvre.duration_s,
        "settle_s": manoeuvre.settle_s,
        "repeats": 1,
        "design": Path(os.path.relpath(taken.file)).as_posix(),  # from the working directory, as it is looked for
        "use": "validation" if manoeuvre.use == "validation" else "identification",
        "input": [i.model_dump() for i in manoeuvre.input],
    }
    try:
        return PlannedManoeuvre.model_validate(made)
    except ValueError as error:
        said = str(error).splitlines()
        why = next((line.strip() for line in said if "Value error" in line), said[-1]).replace("Value error, ", "")
        raise ScenarioError(f"{taken.file}, manoeuvre: a plan cannot fly it: {why.split(' [type=')[0]}") from error
