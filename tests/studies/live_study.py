"""What is said of a flight while it flies, against the truth: results/live/flights.csv, of simulated flights replayed.

Aircraft are drawn within a stated uncertainty of the believed ones and flown, each time from trim, through a 3-2-1-1 of
the elevator and doublets of aileron and rudder, in turbulence, with noise as of instruments that are sold, over a link
of 50, 25 or 8 Hz with jitter and loss. A third of the flights have a fault: a control that works backwards, by half or
late, an airspeed that fails, or a wing that is iced. One row a flight: how many live 95 % intervals hold, how long it
was said that accuracy would take over how long it took, and what was called out.

Run ``python tests/studies/live_study.py [--flights N] [--first K]``; it goes on where it stopped.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from clock import since
from smallest import results, sized
from tables import read_rows, write_rows

import testbench as tb
from testbench.aircraft import Aircraft
from testbench.aircraft.amend import Amendment, ScaleCoefficient
from testbench.aircraft.believed import coefficient_names, drawn
from testbench.core.errors import Refusal
from testbench.core.record import FlightRecord
from testbench.core.scenario.base import AirSpec
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.flight import linearise
from testbench.flight.air import air_of
from testbench.inputs import InputSignal
from testbench.questions.live.ask import UPDATE_S, Session, fly_along
from testbench.questions.live.stream import Sample, Source

TABLE = results("live") / "flights.csv"
COLUMNS = ("flight", "aircraft", "link_hz", "turbulence_m_s", "fault", "intervals", "held", "by_derivative",
           "foretold", "stop_after_s", "called", "load", "latency_s")  # fmt: skip
AIRCRAFT = ("taurus", "eolo", "b1", "jsbsim:c172p", "jsbsim:J3Cub", "jsbsim:T37", "jsbsim:SGS", "jsbsim:pa28")
FAULTS = ("reversed", "half", "late", "icing", "pitot")
KNOWN = 0.1
"""Stated standard deviation of the coefficients, of an aircraft that was identified before."""
ROUNDS = 4  # of the manoeuvres of all controls, in sound flights
SEED, SETTLE_S, RUN_S, BETWEEN_S = 6601, 7.0, 8.0, 10.0
SIZES_DEG = (3.0, 1.5, 0.75, 0.4)  # of inputs, the first of which flies
SERVO_S = 0.08
NOISE = {"p": 0.003, "q": 0.003, "r": 0.003, "alpha": 0.003, "beta": 0.003, "phi": 0.003, "theta": 0.003, "V": 0.2,
         "ax": 0.05, "ay": 0.05, "az": 0.05, "h": 0.3, "de": 0.0005, "da": 0.0005, "dr": 0.0005}  # fmt: skip
WANTED = 0.04
LOSS, JITTER_S = 0.01, 0.01


def believed(name: str) -> Aircraft:
    """Return an aircraft whose stability and control derivatives are stated to be known to 10 %."""
    aircraft = tb.load_aircraft(name, "rigid")
    own = [n for n in coefficient_names(aircraft) if "_" in n and abs(aircraft.coefficient(n)) > 1e-6]
    return replace(aircraft, uncertainty=dict.fromkeys(own, KNOWN))


def inputs(control: str, step_s: float, size_rad: float, rate_hz: float) -> InputSignal:
    """Return a 3-2-1-1 of the elevator, or a doublet and its opposite of another control, as fast as a servo moves."""
    t = np.arange(round(RUN_S * rate_hz)) / rate_hz
    u, begin = np.zeros((t.size, 1)), 0.0
    for part in (3.0, -2.0, 1.0, -1.0) if control == "de" else (1.5, -3.0, 1.5):
        end = begin + abs(part) * step_s
        u[(t >= begin) & (t < end), 0] = np.sign(part) * size_rad
        begin = end
    keep = np.exp(-1.0 / (SERVO_S * rate_hz))
    return InputSignal(t, lfilter([1.0 - keep], [1.0, -keep], u, axis=0), (control,))


def sent(
    record: FlightRecord, zero_s: float, link_hz: float, fault: str, at_s: float, rng: np.random.Generator
) -> Iterator[Sample]:
    """Yield what arrives of a flight: channels with clocks of their own, noise, samples that are late and lost."""
    out = []
    scale = {"reversed": -1.0, "half": 2.0}.get(fault, 1.0)
    for name, std in NOISE.items():
        if name not in record:
            continue
        t = np.arange(record.t_s[0] + rng.uniform(0.0, 1.0 / link_hz), record.t_s[-1], 1.0 / link_hz)
        t = t[rng.random(t.size) >= LOSS]
        surface = name in ("de", "da", "dr")
        x = np.interp(t + (0.25 if fault == "late" and surface else 0.0), record.t_s, record[name])
        x = x * scale if surface else x
        if fault == "pitot" and name == "V":
            at = at_s - zero_s
            x = np.where(t > at, x * (0.4 + 0.6 * np.exp(-np.maximum(t - at, 0.0))), x)
        x += std * rng.standard_normal(t.size)
        out += zip((t + 0.02 + JITTER_S * np.abs(rng.standard_normal(t.size))).tolist(), t.tolist(),
                   [name] * t.size, x.tolist(), strict=True)  # fmt: skip
    for arrived, taken, name, value in sorted(out):
        yield Sample(zero_s + taken, {name: value}, zero_s + arrived)


def _trims(aircraft: Aircraft, condition: tb.FlightCondition) -> bool:
    """Return whether it trims there, with room for the smallest input."""
    try:
        trimmed = tb.trim(aircraft, condition, aircraft.rate_hz)
    except Refusal:
        return False
    room = 1.01 * np.radians(SIZES_DEG[-1])
    within = ((aircraft.controls[n], x) for n, x in trimmed.controls.items() if n in ("de", "da", "dr"))
    return all(control.low + room < x < control.full - room for control, x in within)


def true_one(aircraft: Aircraft, number: int, fault: str) -> Aircraft:
    """Return a drawn aircraft, iced if that is the fault."""
    true = drawn(aircraft, SEED + 1, number)
    if fault != "icing":
        return true
    cut = {"CL_alpha": 0.7, "Cm_alpha": 0.6, "Cm_de": 0.5, "CD0": 1.5, "Cl_da": 0.5}
    known = coefficient_names(true)
    changes = tuple(ScaleCoefficient(n, f) for n, f in cut.items() if n in known)
    return true.amended(Amendment("ice", "iced wing and tail", changes))


def fly(number: int) -> dict[str, Any]:
    """Fly one aircraft, follow it, and return its row."""
    rng = np.random.default_rng([SEED, number])
    name = AIRCRAFT[number % len(AIRCRAFT)]
    fault = FAULTS[number // 3 % len(FAULTS)] if number % 3 == 2 else ""
    link_hz = float((50.0, 25.0, 50.0, 8.0)[number // 2 % 4])
    rms = float(rng.choice([0.0, 0.3, 0.7]))
    aircraft = believed(name)
    condition = tb.FlightCondition(aircraft.design_V_m_s, max(aircraft.design_h_m, 100.0))
    draws = (true_one(aircraft, number + 1000 * k, fault) for k in range(100))
    true = next(one for one in draws if _trims(one, condition))  # the first draw that does
    air = air_of(AirSpec(turbulence_rms_m_s=rms), condition.h_m, number) if rms else None
    trimmed = tb.trim(true, condition, aircraft.rate_hz, air)
    model = linearise(true, trimmed)
    quick = max((abs(s) for s in model.longitudinal().poles()), default=3.0)
    controls = [c for c in ("de", "da", "dr") if c in aircraft.controls]
    log_hz = next(aircraft.rate_hz / k for k in range(1, 100) if aircraft.rate_hz / k <= 120.0)
    step_s = float(np.clip(1.6 / quick, 0.15, 1.0))
    flown: list[FlightRecord] = []
    for turn, control in enumerate(controls * (1 if fault else ROUNDS)):
        air = air_of(AirSpec(turbulence_rms_m_s=rms), condition.h_m, 10 * number + turn) if rms else None
        for size_deg in SIZES_DEG:
            signal = inputs(control, step_s, np.radians(size_deg), aircraft.rate_hz)
            try:
                manoeuvre = tb.Manoeuvre("live", signal, SETTLE_S)
                run = tb.fly_and_measure(tb.Job(true, trimmed, manoeuvre, log_hz, air=air))
                break
            except Refusal as refused:
                error = refused
        else:
            raise error
        flown.append(run.flown)
    length = SETTLE_S + RUN_S + BETWEEN_S
    at_s = SETTLE_S + 3.0 if fault == "pitot" else SETTLE_S
    arriving = (s for k, run in enumerate(flown) for s in sent(run, k * length, link_hz, fault, at_s, rng))
    session, begun = Session(name, aircraft), time.process_time()
    longest, last = 0.0, time.process_time()
    for _ in fly_along(Source(name, arriving), aircraft, wanted=WANTED, session=session):
        longest, last = max(longest, since(last)), time.process_time()
    load = since(begun) / (len(flown) * length)
    held, foretold = {}, []
    if not fault:
        there = tb.trim(true, tb.FlightCondition(session.V_m_s, session.h_m))
        foretold = times(session)
        held = holds(session, {d.name: d.held if d.static is None else d.static
                               for d in dimensional_derivatives(linearise(true, there), there)})  # fmt: skip
    stops = [c for c in session.calls if c.kind in ("stop", "instrument")]
    after = [c.t_s - at_s for c in stops]
    return dict(zip(COLUMNS, (
        number, name, f"{link_hz:g}", f"{rms:g}", fault, len(held), sum(held.values()), json.dumps(held),
        json.dumps(foretold), f"{min(after):.2f}" if after else "",
        "; ".join(f"{c.kind} {c.channel} {c.value:.2g} {c.words}" for c in stops[:3]), f"{load:.3f}", f"{longest:.3f}",
    ), strict=True))  # fmt: skip


def holds(session: Session, truth: Mapping[str, float]) -> dict[str, int]:
    """Return derivative -> whether its last interval of 95 % holds the truth, of those known to half their value."""
    found = [e for plane in ("longitudinal", "lateral") for e in session.latest(plane)]
    return {
        e.name: int(abs(e.value - truth[e.name]) <= e.half) for e in found if e.wanted and e.std < 0.5 * abs(e.value)
    }


def times(session: Session) -> list[list[float]]:
    """Return [foretold, realised] time in manoeuvres, s, until each derivative was as accurate as wanted.

    It is foretold as the first manoeuvre ends, and realised where that is in another.
    """
    out = []
    for plane in ("longitudinal", "lateral"):
        at_s, begun = 0.0, {}
        for update in session.updates:
            if plane not in update.active:
                continue
            at_s += UPDATE_S
            for e in update.estimates.get(plane, ()):
                if e.wanted and e.reached and e.name in begun:
                    when, foretold = begun[e.name]
                    if foretold:
                        out.append([round(foretold, 2), at_s - when])
                    begun[e.name] = 0.0, None
                elif e.wanted and (e.reached or e.more_s is not None):
                    begun.setdefault(e.name, (at_s, e.more_s))
    return out


def main() -> None:
    """Fly the flights that are missing, and write the table after each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=sized(60, 1), help="number of them")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    asked = parser.parse_args()
    TABLE.parent.mkdir(parents=True, exist_ok=True)
    rows = read_rows(TABLE)
    for number in range(asked.first, asked.first + asked.flights):
        if not any(int(r["flight"]) == number for r in rows):
            rows.append(fly(number))
            write_rows(TABLE, COLUMNS, rows)
    said(rows)


def said(rows: list[dict[str, Any]]) -> None:
    """Print what the rows say."""
    sound, faulty = ([r for r in rows if bool(r["fault"]) == is_faulty] for is_faulty in (False, True))
    n, held = (sum(int(r[k]) for r in sound) for k in ("intervals", "held"))
    caught = [r for r in faulty if r["stop_after_s"] and -0.5 <= float(r["stop_after_s"]) <= 3.0]
    false = [r for r in sound if r["stop_after_s"]]
    print(f"95 % intervals hold in {100.0 * held / max(n, 1):.1f} % of {n}")
    both = np.array([pair for r in sound for pair in json.loads(r["foretold"])]).reshape(-1, 2)
    if len(both):
        whole, longer = np.maximum(np.ceil(both / RUN_S), 1.0), both[both[:, 1] > RUN_S]
        off = np.abs(longer[:, 0] / longer[:, 1] - 1.0)
        right = f"{np.mean(whole[:, 0] == whole[:, 1]):.2f} of {len(both)} right to the manoeuvre"
        of = f"{len(off)} longer ones"
        print(f"foretold time to accuracy: {right}; off by {np.median(off):.2f} in the median of {of}")
    calls = f"faults called within 3 s: {len(caught)} of {len(faulty)}"
    print(f"{calls}; false stops in {len(false)} of {len(sound)} flights")
    load, latency = (max(float(r[k]) for r in rows) for k in ("load", "latency_s"))
    print(f"load {load:.2f} at most, {latency:.2f} s an update")


if __name__ == "__main__":
    main()
