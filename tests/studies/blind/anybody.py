"""Blind test of anybody's aircraft, noise, air and starts as in life: ``python -m studies.blind.anybody``.

Nine aircraft, most of them not the testbench's own; four records of all axes. The noise of every channel is 0.7 to 1.4
times what is stated, half of it is coloured, half is quantised more coarsely; half of the flights are in light
turbulence, half begin in motion. What is hidden acts on commands, readings, mass or forces, all of it made here: the
true coefficients are drawn from the priors that are stated. Resumes: cases that have a row are not run again.
"""

import argparse
import hashlib
import json
import math
import os
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.signal import lfilter
from studies.blind import servos
from studies.blind.__main__ import _kept, _read, _rows
from studies.blind.flights import LOG_HZ, RATE_HZ, SETTLE_S, doublet, half_sine, joined, side_by_side, steps, suite
from studies.blind.parts import parts_said
from studies.blind.run import found_row
from studies.blind.truth import ALPHA, ALPHA_DOT, CHORD_TIME, Law, number, prop, state, term
from tables import write_rows

from testbench.aircraft import Aircraft, Amendment, Increment, ScaleCoefficient
from testbench.aircraft.amend import Change
from testbench.aircraft.geometry.build import model_from_plan
from testbench.aircraft.geometry.read import read_plan
from testbench.aircraft.seams import added_load, moved_centre
from testbench.core.constants import DEG_RAD
from testbench.core.errors import LimitError, ModelError, TrimError
from testbench.core.proportion import proportion_interval
from testbench.core.record import FlightAborted, FlightRecord, FloatArray
from testbench.flight import FlightCondition, load_aircraft, trim
from testbench.flight.air import ONSET_S, Air
from testbench.inference.calibrate import calibration_error
from testbench.questions import hidden
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.onset import LATER
from testbench.questions.gap.priors import deviations_of
from testbench.questions.gap.starts import Start
from testbench.questions.gap.workflow import GapSearch, find_gap
from testbench.sensors import SensorSuite

# On A the product may be calibrated; B was opened at 13 cases, one of which mended a kind; C is what is reported.
SEEDS = {"A": 20281201, "B": 20281202, "C": 20281203}
SURE = 0.9  # stated probability from which a part counts as called
CONTROLS = ("de", "da", "dr", "thr")
GEOMETRY = Path(__file__).with_name("uav.toml")


@dataclass(frozen=True)
class Plane:
    """How an aircraft is flown: speed, height, deflections (deg) of some 4 deg of alpha, 20 deg of bank, 5 deg of
    sideslip, and the time of the switching, near its short period."""

    V_m_s: float
    h_m: float
    de: float
    da: float
    dr: float
    unit_s: float


PLANES: Mapping[str, Plane] = {
    "jsbsim:c172p": Plane(48.0, 1000.0, 2.0, 3.0, 4.0, 0.5),
    "jsbsim:f16": Plane(170.0, 2500.0, 2.0, 3.5, 2.4, 0.5),
    "jsbsim:T38": Plane(170.0, 3000.0, 1.5, 2.5, 3.0, 0.4),
    "jsbsim:737": Plane(145.0, 2500.0, 2.0, 4.0, 4.0, 0.8),
    "jsbsim:sgs233": Plane(35.0, 800.0, 1.2, 4.0, 5.0, 0.6),
    "jsbsim:J3Cub": Plane(31.0, 800.0, 1.0, 4.0, 4.0, 0.5),
    "uav": Plane(15.0, 150.0, 2.0, 3.0, 4.0, 0.3),
    "taurus": Plane(14.0, 100.0, 2.0, 2.0, 2.0, 0.3),
    "eolo": Plane(16.0, 547.0, 2.6, 5.0, 6.0, 0.4),
}


# --- what is hidden ---------------------------------------------------------------------------------------------------

Size = Mapping[str, float]
Made = tuple[str, Any]
"""What a kind changes: ("law", {control: Law}), ("mix", (from, to, ratio)), ("changes", edits), ("sensor", (channel,
fields)) or ("read", (channel, law of its deviations))."""


@dataclass(frozen=True)
class Kind:
    """One kind of hidden truth.

    Attributes:
        form: "library" (as the library has it), "other" (an effect of it in another form) or "outside".
        part: in which it acts.
        names: that are right, with spaces; none of what the library lacks.
        sizes: of each, log-uniform between bounds; one whose name ends in ``_`` has a random sign.
        make: (sizes, aircraft, its flying) -> what is changed.
    """

    form: str
    part: str
    names: str
    sizes: Mapping[str, tuple[float, float]]
    make: Callable[[Size, Aircraft, Plane], Made]

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Return sizes."""
        out = {}
        for name, (low, high) in self.sizes.items():
            x = float(np.exp(rng.uniform(np.log(low), np.log(high))))
            out[name.rstrip("_")] = x * (float(rng.choice([-1.0, 1.0])) if name.endswith("_") else 1.0)
        return out


def _add(coefficient: str, *terms: str) -> Increment:
    return Increment(coefficient, f"hidden/{coefficient}-{len(''.join(terms))}", terms)


def _law(control: str, make: Callable[[Size, Plane], Law]) -> Callable[[Size, Aircraft, Plane], Made]:
    return lambda s, a, f: ("law", {control: make(s, f)})


def _changes(make: Callable[[Size, Aircraft], Sequence[Change]]) -> Callable[[Size, Aircraft, Plane], Made]:
    return lambda s, a, f: ("changes", tuple(make(s, a)))


def _sensor(channel: str, **named: str) -> Callable[[Size, Aircraft, Plane], Made]:
    """Return what sets fields of a sensor by sizes: times in units of the aircraft's own."""
    return lambda s, a, f: (
        "sensor",
        (channel, {n: s[size] * (f.unit_s if n in ("lag_s", "delay_s") else 1.0) for n, size in named.items()}),
    )


def _path(control: str, word: str) -> dict[str, Kind]:
    """Return the kinds of one surface's path."""
    p, part = "" if word == "elevator" else f"{word}_", f"{word} path"
    lag = "actuator_lag" if not p else f"{p}lag"
    second = f"{lag} {p}second_order_actuator {p}delayed_servo"
    late, ratio = f"{p}transport_delay {p}delayed_servo", f"{p}surface_scale"
    most = {"de": lambda f: f.de, "da": lambda f: f.da, "dr": lambda f: f.dr}[control]
    return {
        f"slow {word} servo": Kind(
            "library", part, second, {"units": (0.3, 1.0)},
            _law(control, lambda s, f: servos.stages(1.0 / (s["units"] * f.unit_s), 1)),
        ),
        f"late {word} link": Kind(
            "library", part, late, {"units": (0.15, 0.5)},
            _law(control, lambda s, f: servos.late(s["units"] * f.unit_s)),
        ),
        f"{word} linkage ratio": Kind(
            "library", part, ratio, {"gain": (0.5, 0.7)}, _law(control, lambda s, f: servos.scaled(s["gain"])),
        ),
        f"{word} slew limit": Kind(
            "library", part, f"{p}rate_limit {p}asymmetric_rate_limit", {"units": (1.0, 2.5)},
            _law(control, lambda s, f: servos.slewed(most(f) * DEG_RAD / (s["units"] * f.unit_s))),
        ),
        f"{word} servo of two stages": Kind(
            "other", part, f"{second} {late}", {"units": (0.2, 0.5)},
            _law(control, lambda s, f: servos.stages(1.0 / (s["units"] * f.unit_s), 2)),
        ),
        f"{word} link with jitter": Kind(
            "other", part, late, {"units": (0.2, 0.5)},
            _law(control, lambda s, f: servos.late(s["units"] * f.unit_s, 0.3, 5)),
        ),
        f"{word} that saturates softly": Kind(
            "outside", part, "", {"share": (0.4, 0.8)},
            _law(control, lambda s, f: lambda u, dt: s["share"] * most(f) * DEG_RAD * np.tanh(
                u / (s["share"] * most(f) * DEG_RAD))),
        ),
    }  # fmt: skip


def _turning(s: Size, a: Aircraft, coefficient: str, control: str, damping: str, rate: str, f: Plane) -> Made:
    """A damper: the surface turns against a filtered rate, by a share of the aircraft's own damping."""
    name, lag_s = f"hidden/{rate}-filtered", s["units"] * f.unit_s
    held = state(name, prop(f"velocities/{rate}-rad_sec"), lag_s)
    gain = s["share"] * a.coefficient(damping) * a.geometry.b_m / (2.0 * f.V_m_s)
    return "changes", (*held, _add(coefficient, number(gain), prop(name)))


def _stall(s: Size, a: Aircraft, f: Plane) -> Made:
    """Lift lost beyond an angle above trim, late, with a moment."""
    name = "hidden/alpha-late"
    held = state(name, prop(ALPHA), s["units"] * f.unit_s)
    start = trimmed_alpha(a, f) + s["above_deg"] * DEG_RAD
    beyond = term("difference", prop(name), number(start))
    lost = term("max", beyond, number(0.0))
    slope = a.coefficient("CL_alpha")
    return "changes", (
        *held,
        _add("CL", number(-s["share"] * slope), lost),
        _add("Cm", number(-0.1 * s["share"] * slope), lost),
    )


_HALF_SPAN = term("quotient", prop("metrics/bw-ft"), term("product", number(2.0), prop("velocities/vt-fps")))
_P, _Q, _R = (term("product", prop(f"velocities/{c}-rad_sec"), _HALF_SPAN) for c in "pqr")
BETA = "aero/beta-rad"
_QUANTITIES = {"alpha": prop(ALPHA), "beta": prop(BETA), "p": _P, "q": _Q, "r": _R}
_OF = {"CL": "lift", "CD": "drag", "CY": "fin", "Cl": "wing", "Cm": "pitching moment", "Cn": "fin"}
_TERMS = {  # random forces and moments: symmetric products in the longitudinal, the others in the lateral
    "Cm": ("beta beta", "p p", "alpha q", "p r"),
    "CL": ("beta beta", "alpha q", "p p"),
    "Cl": ("alpha p", "alpha beta", "q beta", "q r"),
    "Cn": ("alpha p", "alpha r", "q beta", "q p"),
    "CY": ("alpha p", "alpha beta", "q r"),
}
_USUAL = {"alpha": 0.07, "beta": 0.09, "p": 0.03, "q": 0.02, "r": 0.012}
_SCALE = {"Cm": 0.02, "CL": 0.12, "Cl": 0.006, "Cn": 0.005, "CY": 0.03}


def _random(coefficient: str, product: str) -> Kind:
    """Return a random term of forces or moments, behind a lag, which the library does not have."""
    first, second = product.split()

    def make(s: Size, a: Aircraft, f: Plane) -> Made:
        name = "hidden/random"
        both = term("product", _QUANTITIES[first], _QUANTITIES[second])
        size = s["size"] * _SCALE[coefficient] / (_USUAL[first] * _USUAL[second])
        held = state(name, both, s["units"] * f.unit_s)
        return "changes", (*held, _add(coefficient, number(size), prop(name)))

    return Kind("outside", _OF[coefficient], "", {"size_": (0.7, 2.0), "units": (0.1, 0.6)}, make)


def _per_square(s: Size, a: Aircraft) -> float:
    return s["share"] * a.coefficient("Cn_beta") / 0.1**2


KINDS: Mapping[str, Kind] = {
    **_path("de", "elevator"),
    **_path("da", "aileron"),
    **_path("dr", "rudder"),
    "slow motor": Kind(
        "library", "thrust", "thrust_lag second_order_thrust_lag", {"units": (2.0, 6.0)},
        _law("thr", lambda s, f: servos.stages(1.0 / (s["units"] * f.unit_s), 1)),
    ),
    "weak motor": Kind(
        "library", "thrust", "throttle_scale thrust_scale", {"gain": (0.5, 0.7)},
        _law("thr", lambda s, f: servos.scaled(s["gain"])),
    ),
    "motor that rises slower than it falls": Kind(
        "other", "thrust", "thrust_lag second_order_thrust_lag throttle_asymmetric_rate_limit throttle_rate_limit",
        {"units": (2.0, 5.0)},
        _law("thr", lambda s, f: servos.motor(1.4 * s["units"] * f.unit_s, 0.7 * s["units"] * f.unit_s)),
    ),
    "interconnect": Kind(
        "library", "rudder path", "interconnect late_interconnect", {"ratio_": (0.15, 0.5)},
        lambda s, a, f: ("mix", ("da", "dr", s["ratio"])),
    ),
    **{
        f"{c} gain": Kind("library", f"{c} sensor", f"{c}_scale", {"scale": (0.78, 0.9)}, _sensor(c, scale="scale"))
        for c in ("alpha", "beta", "p", "q", "r")
    },
    **{
        f"{c} lag": Kind(
            "library", f"{c} sensor", f"{c}_lag {c}_delay", {"units": (0.3, 1.0)}, _sensor(c, lag_s="units")
        )
        for c in ("alpha", "beta", "V")
    },
    **{
        f"{c} late": Kind(
            "library", f"{c} sensor", f"{c}_delay {c}_lag", {"units": (0.2, 0.6)}, _sensor(c, delay_s="units")
        )
        for c in ("theta", "phi")
    },
    "alpha vane of second order": Kind(
        "other", "alpha sensor", "alpha_lag alpha_delay", {"units": (0.4, 1.0)},
        lambda s, a, f: ("read", ("alpha", servos.sprung(1.0 / (s["units"] * f.unit_s), 0.6))),
    ),
    "yaw gyro with a bent scale": Kind(
        "other", "r sensor", "r_scale", {"gain": (0.75, 0.88)},
        lambda s, a, f: ("read", ("r", lambda y, dt: y * (s["gain"] + 0.1 * np.tanh(y / 0.1)))),
    ),
    "sticky vane": Kind(
        "outside", "beta sensor", "", {"deg": (1.0, 2.5)},
        lambda s, a, f: ("read", ("beta", servos.backlash(s["deg"] * DEG_RAD))),
    ),
    "ballast": Kind(
        "library", "mass", "payload mass_error", {"ratio": (0.12, 0.35)},
        _changes(lambda s, a: added_load(a, s["ratio"] * a.mass.mass_kg, 0.0)),
    ),
    "centre of gravity aft": Kind(
        "library", "pitching moment", "cg_shift payload", {"chords": (0.03, 0.06)},
        _changes(lambda s, a: moved_centre(a, (s["chords"] * a.geometry.cbar_m, 0.0, 0.0))),
    ),
    "centre of gravity aside": Kind(
        "library", "mass", "lateral_cg side_payload asymmetric_lift wing_twist", {"spans_": (0.004, 0.012)},
        _changes(lambda s, a: moved_centre(a, (0.0, s["spans"] * a.geometry.b_m, 0.0))),
    ),
    "roughness": Kind(
        "library", "drag", "drag_increment", {"share": (0.3, 0.8)},
        _changes(lambda s, a: (_add("CD", number(s["share"] * a.coefficient("CD"))),)),
    ),
    "moment of downwash that is late": Kind(
        "library", "pitching moment", "alpha_dot wake_lag", {"share": (0.4, 1.0)},
        _changes(
            lambda s, a: (_add("Cm", number(s["share"] * a.coefficient("Cm_q")), prop(ALPHA_DOT), prop(CHORD_TIME)),)
        ),
    ),
    "weathercock that grows": Kind(
        "library", "fin", "cubic_weathercock", {"share": (0.8, 2.0)},
        _changes(lambda s, a: (_add("Cn", number(_per_square(s, a)), *(prop(BETA),) * 3),)),
    ),
    "fin that fades": Kind(
        "other", "fin", "cubic_weathercock", {"share": (0.4, 0.8)},
        _changes(
            lambda s, a: (
                _add("Cn", number(-0.1 * _per_square(s, a)), prop(BETA), term("abs", prop(BETA))),
            )
        ),
    ),
    "yaw damper": Kind(
        "library", "rudder path", "yaw_damper filtered_yaw_damper", {"share": (1.0, 3.0), "units": (0.3, 1.0)},
        lambda s, a, f: _turning(s, a, "Cn", "dr", "Cn_r", "r", f),
    ),
    "roll damper": Kind(
        "library", "aileron path", "roll_damper filtered_roll_damper", {"share": (0.3, 0.8), "units": (0.3, 1.0)},
        lambda s, a, f: _turning(s, a, "Cl", "da", "Cl_p", "p", f),
    ),
    "late stall with its moment": Kind(
        "other", "lift", "stall stall_hysteresis stall_moment nonlinear_lift",
        {"above_deg": (0.5, 2.0), "share": (0.5, 1.0), "units": (0.2, 0.8)}, _stall,
    ),
    **{
        f"{c} by {product}": _random(c, product) for c, products in _TERMS.items() for product in products
    },
    **{
        f"{c} wrong": Kind(
            "library", _OF[c.partition("_")[0]], c, {"factor": low},
            _changes(lambda s, a, c=c: (ScaleCoefficient(c, s["factor"]),)),
        )
        for c, low in {"Cl_beta": (1.8, 2.5), "Cm_q": (1.9, 2.6), "Cn_r": (2.2, 3.2), "Cl_p": (1.5, 2.0)}.items()
    },
}  # fmt: skip


# --- cases ------------------------------------------------------------------------------------------------------------

STRATA: Mapping[str, int] = {"one": 180, "outside": 50, "two": 20, "in flight": 20, "nothing": 30}


@dataclass(frozen=True)
class Case:
    """One case: everything that is hidden.

    Attributes:
        name: stratum and number.
        aircraft: its name in PLANES.
        kinds: that are hidden.
        sizes: of each.
        factors: what the true coefficients are times the believed ones.
        noise: channel -> real noise over what is stated.
        colour: correlation from sample to sample of that noise.
        quanta: quantisation in units of the stated noise.
        rms_m_s: of turbulence.
        quiet: whether records begin in trimmed flight.
        onset: record, and second in it, from which the truth acts; None for all of the flights.
        seed: of noise and turbulence.
    """

    name: str
    aircraft: str
    kinds: tuple[str, ...]
    sizes: tuple[Mapping[str, float], ...]
    factors: Mapping[str, float]
    noise: Mapping[str, float]
    colour: float
    quanta: float
    rms_m_s: float
    quiet: bool
    onset: tuple[int, float] | None
    seed: int

    @property
    def stratum(self) -> str:
        """Its row of STRATA."""
        return self.name.rpartition(" ")[0]

    @property
    def parts(self) -> set[str]:
        """In which what is hidden acts."""
        return {KINDS[k].part for k in self.kinds}

    @property
    def outside(self) -> bool:
        """Whether the library lacks it."""
        return any(KINDS[k].form == "outside" for k in self.kinds)

    @property
    def in_library(self) -> bool:
        """Whether the library has the form of all that is hidden."""
        return all(KINDS[k].form == "library" for k in self.kinds)


def drawn(seed: int, counts: Mapping[str, int] = STRATA) -> tuple[Case, ...]:
    """Return the cases of a seed, in an order in which every stratum is spread evenly."""
    order = sorted((((i + 0.5) / n, s, i) for s, n in counts.items() for i in range(n)))
    return tuple(_case(f"{s} {i + 1}", np.random.default_rng([seed, list(counts).index(s), i])) for _, s, i in order)


def _case(name: str, rng: np.random.Generator) -> Case:
    for _ in range(20):
        case = _any(name, rng)
        try:
            for held_out in (False, True):
                fly(case, held_out)
        except (FlightAborted, LimitError, ModelError, TrimError):
            continue
        return case
    raise LimitError(f"a case must fly within twenty draws, '{name}' did not")


def _any(name: str, rng: np.random.Generator) -> Case:
    stratum = name.rpartition(" ")[0]
    outside = [k for k, v in KINDS.items() if v.form == "outside"]
    inside = [k for k, v in KINDS.items() if v.form != "outside"]
    laws = [k for k in inside if KINDS[k].part.endswith("path") and "damper" not in k]
    aircraft = str(rng.choice(list(PLANES)))
    kinds: tuple[str, ...] = ()
    if stratum == "one":
        kinds = (str(rng.choice(inside)),)
    elif stratum == "outside":
        kinds = (str(rng.choice(outside)),)
    elif stratum == "in flight":
        kinds = (str(rng.choice([k for k in laws if k != "interconnect"])),)
    elif stratum == "two":
        first = str(rng.choice(laws))
        kinds = (first, str(rng.choice([k for k in inside if k not in laws and KINDS[k].part != KINDS[first].part])))
    factors = {
        n: 1.0 + s * float(np.clip(rng.standard_normal(), -2.0, 2.0))
        for n, s in deviations_of(believed_aircraft(aircraft)).items()
    }
    channels = [c for c in suite(every_axis=True).channels if not c.endswith("_cmd")]
    return Case(
        name,
        aircraft,
        kinds,
        tuple(KINDS[k].draw(rng) for k in kinds),
        factors,
        {c: float(np.exp(rng.uniform(np.log(0.7), np.log(1.4)))) for c in channels},
        float(rng.uniform(0.2, 0.7)) if rng.random() < 0.5 else 0.0,
        float(rng.uniform(1.0, 2.0)) if rng.random() < 0.5 else 0.0,
        float(rng.uniform(0.05, 0.25)) if rng.random() < 0.5 else 0.0,
        bool(rng.random() < 0.5),
        (int(rng.integers(0, 3)), float(rng.uniform(0.3, 0.5))) if stratum == "in flight" else None,
        int(rng.integers(1, 2**31 - 10**7)),
    )


@cache
def believed_aircraft(name: str) -> Aircraft:
    """Return what is believed to fly; the one from a plan is made by the testbench as a user would."""
    if name != "uav":
        return load_aircraft(name, "rigid", commanded_at="surface")  # as when the draws were sealed
    made_of = hashlib.sha256(GEOMETRY.read_bytes()).hexdigest()[:12]
    folder = Path(tempfile.gettempdir()) / f"blind-uav-{made_of}"
    if not folder.exists():
        folder.mkdir()
        model_from_plan(read_plan(GEOMETRY, None), "uav").write(folder)
    return load_aircraft(str(folder), "rigid")


def condition_of(name: str) -> FlightCondition:
    """Return where an aircraft is flown."""
    return FlightCondition(PLANES[name].V_m_s, PLANES[name].h_m)


@cache
def _alpha(name: str, condition: FlightCondition) -> float:
    aircraft = next(a for a in map(believed_aircraft, PLANES) if a.name == name)
    return trim(aircraft, condition, aircraft.rate_hz).alpha


def trimmed_alpha(aircraft: Aircraft, plane: Plane) -> float:
    """Return the angle of attack of trimmed flight, rad."""
    return _alpha(aircraft.name, FlightCondition(plane.V_m_s, plane.h_m))


def manoeuvres(f: Plane, held_out: bool, throttle: bool) -> dict[str, dict[str, FloatArray]]:
    """Return name -> commands by control, at LOG_HZ."""
    u, long = f.unit_s, 8.0 + 12.0 * f.unit_s
    de, da, dr = (x * DEG_RAD for x in (f.de, f.da, f.dr))
    if held_out:
        return {
            "elevator, then aileron": {
                "de": steps(long, 1.2 * u, (2, 1, 1), -1.1 * de),
                "da": joined(long, [(0.6 * long, doublet(u, -da))]),
            },
            "rudder, then pull-up": {
                "dr": joined(long, [(0.5, doublet(1.4 * u, -dr))]),
                "de": joined(long, [(0.5 * long, half_sine(1.4, -de))]),
            },
        }
    thr = {"thr": joined(long, [(0.5, doublet(2.5, 0.08))])} if throttle else {}
    return {
        "elevator": {"de": steps(long, u, (3, 2, 1, 1), de)},
        "aileron": {"da": steps(long, u, (3, 2, 1, 1), da)},
        "rudder": {"dr": joined(long, [(0.5, doublet(u, 1.4 * dr)), (0.6 * long, doublet(u, -0.6 * dr))])},
        "throttle and all surfaces": thr
        | {
            "de": joined(long, [(0.45 * long, doublet(0.8 * u, 1.3 * de))]),
            "da": joined(long, [(0.6 * long, doublet(u, -da))]),
            "dr": joined(long, [(0.75 * long, doublet(0.8 * u, dr))]),
        },
    }


def fly(case: Case, held_out: bool) -> dict[str, FlightRecord]:
    """Fly the truth; return name -> measured record.

    Raises:
        TrimError, FlightAborted, LimitError: it cannot fly the manoeuvres.
    """
    plane, aircraft = PLANES[case.aircraft], believed_aircraft(case.aircraft)
    controls = tuple(c for c in CONTROLS if c in aircraft.controls)
    start = Start(condition_of(case.aircraft))
    out: dict[str, FlightRecord] = {}
    for i, (name, signals) in enumerate(manoeuvres(plane, held_out, "thr" in controls).items()):
        u = side_by_side({c: x for c, x in signals.items() if c in controls}, controls)
        seed = case.seed + i + (10_000 if held_out else 0)
        air = Air(turbulence_rms_m_s=(case.rms_m_s,) * 3, seed=seed) if case.rms_m_s else None
        begins = 0.0
        if case.onset is not None and not held_out:
            first, share = case.onset
            begins = np.inf if i < first else share * len(u) / LOG_HZ if i == first else 0.0
        real = hidden.Real(aircraft, truth=_truth(case, aircraft, plane, begins, seed))
        flights = [hidden.Commands(name, controls, u, SETTLE_S + ONSET_S, seed, start, air)]
        record = hidden.fly_hidden(real, _suite(aircraft), flights, RATE_HZ)[name]
        record = record.between(
            record.t_s[round(ONSET_S * LOG_HZ)], record.t_s[-1]
        )  # turbulence does not begin with it
        out[name] = record if case.quiet else _in_motion(record)
    return out


def _suite(aircraft: Aircraft) -> SensorSuite:
    plain = suite(every_axis=True)
    kept = tuple(s for s in plain.sensors if s.channel != "thr_cmd" or "thr" in aircraft.controls)
    return replace(plain, name=f"anybody_{len(kept)}", sensors=kept)


def _in_motion(record: FlightRecord) -> FlightRecord:
    """Return a record without the quiet flight before its manoeuvre and the first of its motion."""
    first = round((SETTLE_S + 1.2) * LOG_HZ)
    return record.between(record.t_s[first], record.t_s[-1])


def _truth(case: Case, aircraft: Aircraft, plane: Plane, begins_s: float, seed: int) -> hidden.Truth:
    made = [KINDS[k].make(s, aircraft, plane) for k, s in zip(case.kinds, case.sizes, strict=True)]
    changes: list[Change] = [ScaleCoefficient(n, f) for n, f in case.factors.items()]
    changes += [edit for what, edits in made if what == "changes" for edit in edits]
    fields = {channel: values for what, sensor in made if what == "sensor" for channel, values in [sensor]}

    def amend(believed: Aircraft, sensors: SensorSuite, at_s: float) -> tuple[Aircraft, SensorSuite]:
        flies = believed.amended(Amendment("hidden", "hidden", tuple(changes)))
        real = []
        for s in sensors.sensors:
            own = fields.get(s.channel, {})
            times = {n: getattr(s, n) + x for n, x in own.items() if n != "scale"}
            quiet = {"noise_std": 0.0, "quantum": 0.0} if s.noise_std else {}
            real.append(replace(s, **quiet, **times, scale=s.scale * own.get("scale", 1.0)))
        return flies, replace(sensors, sensors=tuple(real))

    def send(controls: Sequence[str], u: FloatArray, dt_s: float, at_s: float) -> FloatArray:
        out, acts = u.copy(), (np.arange(len(u)) * dt_s >= begins_s)
        for what, how in made:
            for control, law in how.items() if what == "law" else ():
                if control not in controls:
                    raise LimitError(f"{aircraft.name} has no {control}")
                k = list(controls).index(control)
                out[:, k] = np.where(acts, law(u[:, k], dt_s), u[:, k])
            if what == "mix":
                out[:, controls.index(how[1])] += how[2] * u[:, controls.index(how[0])]
        return out

    def read(record: FlightRecord) -> FlightRecord:
        data, stated = record.data.copy(), {s.channel: s for s in _suite(aircraft).sensors}
        for what, how in made:
            if what == "read":
                k = record.channels.index(how[0])
                data[:, k] = data[0, k] + how[1](data[:, k] - data[0, k], record.dt_s)
        for k, channel in enumerate(record.channels):
            sensor = stated.get(channel)
            if sensor is not None and sensor.noise_std > 0.0 and channel in case.noise:
                white = np.random.default_rng([seed, k]).standard_normal(len(data))
                data[:, k] += case.noise[channel] * sensor.noise_std * _coloured(white, case.colour)
                if quantum := max(sensor.quantum, case.quanta * sensor.noise_std):  # of what is read, noise and all
                    data[:, k] = quantum * np.rint(data[:, k] / quantum)
        return replace(record, data=data)

    return hidden.Truth(amend, send, read)


def _coloured(white: FloatArray, colour: float) -> FloatArray:
    return np.asarray(lfilter([np.sqrt(1.0 - colour**2)], [1.0, -colour], white))


# --- naming and judging -----------------------------------------------------------------------------------------------


def named(case: Case) -> dict[str, Any]:
    """Return what the workflow says of a case, as JSON values."""
    aircraft = believed_aircraft(case.aircraft)
    believed = Believed(aircraft, _suite(aircraft), condition_of(case.aircraft), RATE_HZ)
    records, held_out = fly(case, False), fly(case, True)
    removed: list[float] = []

    def find() -> Any:
        found = find_gap(believed, records, held_out, GapSearch(noise="stated"))
        before, after = (
            sum(float(np.sum((x - 1.0) * s.taken)) for s in found.shrink for x in [getattr(s, when)])
            for when in ("energy_before", "energy_after")
        )
        removed.append(1.0 - after / before if before > 0.0 else 0.0)
        return found

    return {"case": case.name, **found_row(find), "removed": removed[0] if removed else None}


def part_is_right(case: Case, row: Mapping[str, Any]) -> bool:
    """Return whether all that is named acts in parts in which the truth acts."""
    return bool(row["names"]) and parts_said(row["names"]) <= case.parts


def effect_in_set(case: Case, row: Mapping[str, Any]) -> bool:
    """Return whether the credible set holds an effect that is right for each kind."""
    said = {single.removesuffix(LATER) for name in row.get("credible", ()) for single in name.split(" + ")}
    return all(said & set(KINDS[k].names.split()) for k in case.kinds)


def rates(cases: Sequence[Case], rows: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, int, int, str]]:
    """Return (rate, count, of, bar) of the rows."""
    run = [(c, rows[c.name]) for c in cases if c.name in rows and rows[c.name]["outcome"] != "failed"]
    sure = [(c, r) for c, r in run if r["names"] and r["part"] >= SURE]
    null = [(c, r) for c, r in run if not c.kinds]
    outside = [(c, r) for c, r in run if c.outside]
    library = [(c, r) for c, r in run if c.kinds and c.in_library]
    off = [(c, r) for c, r in run if any(_wrong(c, *a[:3]) for a in r["accused"])]
    count = len(run)
    return [
        ("part stated with 0.9 or more is right", sum(part_is_right(c, r) for c, r in sure), len(sure), ">= 92 %"),
        ("wrong part with 0.9 or more", sum(not part_is_right(c, r) for c, r in sure), count, "<= 3 %"),
        ("false gap", sum(r["outcome"] != "no gap" for _, r in null), len(null), "<= 2 %"),
        ("outside: wrong part with 0.9 or more",
         sum(bool(r["names"]) and r["part"] >= SURE and not part_is_right(c, r) for c, r in outside),
         len(outside), "<= 5 %"),
        # A partial model is added to what is unexplained as a whole: the answer still says that the library lacks it.
        ("outside: unknown, or the right part",
         sum(r["outcome"] in ("unexplained", "partial") or part_is_right(c, r) for c, r in outside), len(outside),
         ">= 90 %"),
        ("library form: right part with 0.9 or more",
         sum(part_is_right(c, r) and r["part"] >= SURE for c, r in library), len(library), ">= 70 %"),
        ("library form: right effect in the credible set", sum(effect_in_set(c, r) for c, r in library), len(library),
         ">= 95 %"),
        ("a coefficient accused by more than 4 errors", len(off), count, "<= 2 %"),
        ("failed", sum(rows[c.name]["outcome"] == "failed" for c in cases if c.name in rows),
         sum(c.name in rows for c in cases), ""),
    ]  # fmt: skip


def _wrong(case: Case, coefficient: str, factor: float, error: float) -> bool:
    true = case.factors.get(coefficient, 1.0)
    for kind, sizes in zip(case.kinds, case.sizes, strict=True):
        true *= sizes["factor"] if kind == f"{coefficient} wrong" else 1.0
        true *= sizes["gain"] if "linkage ratio" in kind and coefficient.endswith(_CONTROL[kind.split()[0]]) else 1.0
    return abs(factor - true) > 4.0 * error


_CONTROL = {"elevator": "_de", "aileron": "_da", "rudder": "_dr"}


def figures(cases: Sequence[Case], rows: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, float, int, str]]:
    """Return (figure, value, of, bar) of the rows that are no rates."""
    run = [(c, rows[c.name]) for c in cases if c.name in rows and rows[c.name]["outcome"] != "failed"]
    said = []  # (stated probability, whether that is right) of what the first sentence says
    for c, r in run:
        if r["outcome"] == "no gap":
            said.append((r["nothing"], not c.kinds))
        elif r["outcome"] in ("unexplained", "partial"):
            said.append((r["unknown"], not c.in_library))
        else:
            said.append((r["part"], part_is_right(c, r)))
    stated, right = np.array(said, dtype=float).reshape(-1, 2).T
    library = [r for c, r in run if c.kinds and c.in_library]
    sets = [len(set(r["credible"]) - {"nothing", "unknown"}) for r in library]
    removed = [r["removed"] for c, r in run if c.kinds and r["removed"] is not None]
    seconds = [r["seconds"] for _, r in run]
    return [
        ("expected calibration error of what is said", calibration_error(stated, right), len(run), "<= 0.05"),
        ("library form: effects in the credible set, median", _median(sets), len(sets), "<= 2"),
        ("held-out excess removed where anything is hidden, median", _median(removed), len(removed), ">= 0.8"),
        ("processor time of a case, median, s", _median(seconds), len(seconds), "<= 5"),
        ("processor time of a case, 95 %, s", float(np.quantile(seconds, 0.95)) if seconds else math.nan, len(seconds),
         "<= 15"),
    ]  # fmt: skip


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if len(values) else math.nan


def report(folder: Path, cases: Sequence[Case], rows: Mapping[str, Mapping[str, Any]]) -> None:
    """Write rates.csv, figures.csv and cases.csv."""
    told = [(n, f"{x:.3g}", of, bar) for n, x, of, bar in figures(cases, rows) if of]
    write_rows(folder / "figures.csv", ("figure", "value", "of", "bar"), told)
    counted = [
        (rate, count, of, *(f"{x:.3f}" for x in proportion_interval(count, of)), bar)
        for rate, count, of, bar in rates(cases, rows)
        if of
    ]
    write_rows(folder / "rates.csv", ("rate", "count", "of", "low", "high", "bar"), counted)
    each = []
    for c in cases:
        if (r := rows.get(c.name)) is not None:
            said = " | ".join(r["names"]) or r["outcome"]
            numbers = [f"{r[n]:.3g}" if n in r else "" for n in ("part", "unknown")]
            right = part_is_right(c, r) if c.kinds else r["outcome"] == "no gap"
            hidden_ = " + ".join(c.kinds) or "nothing"
            each.append((c.name, c.aircraft, hidden_, said, *numbers, right, r.get("seconds", "")))
    heads = ("case", "aircraft", "hidden", "said", "part", "unknown", "right part", "seconds")
    write_rows(folder / "cases.csv", heads, each)


def main(arguments: list[str] | None = None) -> int:
    """Seal the answers, run the cases that have no row yet, and write rates, figures and cases."""
    parser = argparse.ArgumentParser(prog="python -m studies.blind.anybody", description=__doc__)
    parser.add_argument("--draw", choices=[*SEEDS], default="C")
    parser.add_argument("--seed", type=int, help="of a trial, in place of that of the draw")
    parser.add_argument("--out", type=Path, default=Path("results/gap/anybody"))
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--minutes", type=float, default=None, help="start no case after so many minutes")
    asked = parser.parse_args(arguments)
    folder = asked.out / asked.draw if asked.seed is None else asked.out
    folder.mkdir(parents=True, exist_ok=True)
    cases = _sealed(folder, asked.seed or SEEDS[asked.draw])
    rows = _read(folder / "rows.jsonl")
    stop = None if asked.minutes is None else time.monotonic() + 60.0 * asked.minutes
    due = [partial(named, c) for c in cases if c.name not in rows]
    for row in _kept(folder / "rows.jsonl", _rows(due, asked.workers, stop)):
        rows[row["case"]] = row
        case = next(c for c in cases if c.name == row["case"])
        print(f"{len(rows)} {case.name}, {case.aircraft}, {case.kinds}: {row['outcome']} {row['names']}", flush=True)
    report(folder, cases, rows)
    return 0


def _sealed(folder: Path, seed: int) -> tuple[Case, ...]:
    """Return the cases, whose answers are sealed by their hash before any is named.

    Raises:
        SystemExit: the answers are not those that were sealed.
    """
    answers, seal = folder / "answers.json", folder / "sealed.sha256"
    if not answers.exists():
        text = json.dumps([asdict(c) for c in drawn(seed)], indent=1, sort_keys=True) + "\n"
        seal.write_text(f"{hashlib.sha256(text.encode()).hexdigest()}  answers.json, seed {seed}\n", encoding="utf-8")
        answers.write_text(text, encoding="utf-8")
    text = answers.read_text(encoding="utf-8")
    if not seal.read_text(encoding="utf-8").startswith(hashlib.sha256(text.encode()).hexdigest()):
        raise SystemExit(f"the answers must be those that were sealed, {seal} holds another hash")
    lists = ("kinds", "sizes")
    return tuple(
        Case(**{**c, **{n: tuple(c[n]) for n in lists}, "onset": c["onset"] and tuple(c["onset"])})
        for c in json.loads(text)
    )


if __name__ == "__main__":
    sys.exit(main())
