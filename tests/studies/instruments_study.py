"""Which instrument errs? Random aircraft, one wrong instrument, and none: results/instruments/kinds.csv.

Run ``python tests/studies/instruments_study.py [--seeds N] [--first SEED]``. Every seed draws an aircraft of JSBSim's,
or one made from a geometry, a speed, a manoeuvre, sample rate, noise, quantisation, small errors that sound instruments
have, and the channels that are logged. A kind of error is laid over it; the same seed never serves two kinds.
"""

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from any_aircraft import geometry_of_the_guide
from clock import since
from smallest import results, sized
from tables import write_rows

import testbench as tb
from testbench.aircraft.geometry.build import model_from_plan
from testbench.aircraft.geometry.read import read_plan
from testbench.core.record import FlightRecord, FloatArray
from testbench.effects import EFFECTS
from testbench.flight.air import Air, turbulence_rms
from testbench.inference.instruments import Agreement, agreement
from testbench.sensors.sensor import first_order_lag

TABLE = results("instruments", "kinds.csv")


@dataclass(frozen=True)
class Flown:
    """What flies: its name, speeds m/s, height m, elevator rad and step s of its manoeuvres."""

    name: str
    slow_m_s: float
    fast_m_s: float
    h_m: float
    de_rad: float
    step_s: float


FLOWN = (
    Flown("jsbsim:c172p", 45.0, 58.0, 1000.0, 0.035, 0.5),
    Flown("jsbsim:T38", 150.0, 200.0, 2500.0, 0.02, 0.4),
    Flown("jsbsim:f16", 150.0, 190.0, 2500.0, 0.015, 0.4),
    Flown("jsbsim:A4", 120.0, 150.0, 2000.0, 0.02, 0.5),
    Flown("jsbsim:737", 130.0, 160.0, 2000.0, 0.03, 0.8),
    Flown("geometry", 15.0, 22.0, 300.0, 0.05, 0.3),
    Flown("geometry", 15.0, 22.0, 300.0, 0.05, 0.3),
)
KINDS: Mapping[str, tuple[str, str, float]] = {
    "clean": ("", "", 0.0),
    "clean in gusts": ("", "", 0.0),
    "q x 0.85": ("q", "scale", -0.15),
    "q x 1.15": ("q", "scale", 0.15),
    "q clock 40 ms late": ("q", "late", 0.04),
    "alpha lag 0.1 s": ("alpha", "lag", 0.1),
    "alpha x 0.85": ("alpha", "scale", -0.15),
    "accelerometer 0.25 m ahead": ("az", "place", 0.25),
    "theta lag 0.1 s": ("theta", "lag", 0.1),
    "V x 0.9": ("V", "scale", -0.1),
}
NOISE = {"V": 0.1, "alpha": 0.0017, "q": 0.0026, "theta": 0.0014, "az": 0.05, "ax": 0.05, "h": 0.1, "beta": 0.0017,
         "p": 0.0026, "r": 0.0026, "phi": 0.0014, "ay": 0.05, "psi": 0.003}  # fmt: skip
QUANTUM = {"V": 0.1, "alpha": 0.0017, "q": 0.0009, "theta": 0.0009, "az": 0.02, "h": 0.1}
SOUND = {"alpha": 0.03, "beta": 0.03, "V": 0.02, "h": 0.0, "psi": 0.0}
"""Standard deviations of the scales of sound instruments, where they are not 1 %."""
LATE_S = 0.004
LOG_HZ = 100.0


@cache
def aircraft_of(name: str, draw: int) -> tb.Aircraft:
    """Return an aircraft; one from geometry is the guide's with another tail arm and mass."""
    if name != "geometry":
        return tb.load_aircraft(name, commanded_at="surface")  # the records hold the surfaces
    rng, folder = np.random.default_rng([draw, 21]), Path(mkdtemp())
    text = geometry_of_the_guide().replace("x_m = 0.85", f"x_m = {rng.uniform(0.8, 1.1):.3f}")
    text = text.replace("mass_kg = 2.2", f"mass_kg = {rng.uniform(1.8, 3.0):.3f}")
    (folder / "plan.toml").write_text(text, encoding="utf-8")
    made = folder / f"drawn{draw}"
    made.mkdir()
    model_from_plan(read_plan(folder / "plan.toml"), made.name).write(made)
    return tb.load_aircraft(made)


def condition(seed: int) -> tb.FlightCondition:
    """Return where one draw is flown."""
    flown = FLOWN[seed % len(FLOWN)]
    return tb.FlightCondition(np.random.default_rng([seed, 20]).uniform(flown.slow_m_s, flown.fast_m_s), flown.h_m)


@dataclass(frozen=True)
class Flying:
    """How one draw is flown: in gusts, beside an effect of the library, with inputs that are larger, limited or held.

    Attributes:
        gusts: turbulence of 0.1 to 0.5 m/s.
        effect: name and values of what the aircraft has besides.
        larger: factor of the inputs.
        rate: largest rate of the input, in its own sizes per second; 0 without limit.
        held_hz: rate at which a computer renews the input of a sweep; 0 for a 3-2-1-1.
        thrust: throttle that moves with the elevator, per its own size.
    """

    gusts: bool = False
    effect: tuple[str, tuple[tuple[str, float], ...]] = ("", ())
    larger: float = 1.0
    rate: float = 0.0
    held_hz: float = 0.0
    thrust: float = 0.0


@cache
def flight(seed: int, how: Flying) -> tuple[FlightRecord, np.random.Generator]:
    """Return the truth of one draw, and what draws the instruments."""
    rng, flown = np.random.default_rng([seed, 20]), FLOWN[seed % len(FLOWN)]
    aircraft = aircraft_of(flown.name, seed % 5)
    if how.effect[0]:
        aircraft, _ = EFFECTS[how.effect[0]].amend(aircraft, tb.load_suite("eolo_gap"), dict(how.effect[1]))
    trim = tb.trim(aircraft, condition(seed))
    rng.uniform()  # as far as the condition has drawn
    step, size = flown.step_s * rng.uniform(0.8, 1.3), flown.de_rad * rng.uniform(0.7, 1.2)
    t = np.arange(round(rng.uniform(15.0, 20.0) * trim.rate_hz)) / trim.rate_hz
    u = np.zeros((t.size, 1))
    for begin, sign in ((1.5, 1.0), (1.5 + 12.0 * step, -1.0)):
        for length, way in ((3, 1), (2, -1), (1, 1), (1, -1)):
            u[(t >= begin) & (t < begin + length * step), 0] = sign * way * size
            begin += length * step
    rms = rng.uniform(0.1, 0.5) if how.gusts else 0.0
    air = Air(turbulence_rms_m_s=turbulence_rms(rms, flown.h_m), height_m=flown.h_m, seed=seed) if how.gusts else None
    if how.held_hz:  # a sweep from a quarter to twice the frequency of the steps
        f = np.linspace(0.06, 0.5, t.size) / step
        u[:, 0] = size * np.sin(2.0 * np.pi * np.cumsum(f) / trim.rate_hz)
        u = u[np.arange(t.size) // round(trim.rate_hz / how.held_hz) * round(trim.rate_hz / how.held_hz)]
    if how.rate:
        most = how.rate * size / trim.rate_hz
        for k in range(1, t.size):
            u[k] = np.clip(u[k], u[k - 1] - most, u[k - 1] + most)
    u = u * how.larger
    if how.thrust:
        u = np.column_stack([u[:, 0], how.thrust * u[:, 0] / size])
    manoeuvre = tb.Manoeuvre("3211", tb.InputSignal(t, u, ("de", "thr")[: u.shape[1]]), settle_s=0.0)
    return tb.fly(
        aircraft, trim, manoeuvre, min(trim.rate_hz, 2.0 * LOG_HZ), (*NOISE, "qdot", *manoeuvre.signal.channels), air
    ), rng


def measured(kind: str, seed: int, how: Flying | None = None) -> FlightRecord:
    """Return the record of one draw with one kind of error, flown as ``how`` says."""
    truth, rng = flight(seed, how or Flying(kind == "clean in gusts"))
    channel, what, size = KINDS[kind]
    dt, true = truth.dt_s, {c: truth[c].copy() for c in NOISE}
    true["psi"] = np.unwrap(true["psi"])
    if what == "place":
        true["az"] = true["az"] - size * truth["qdot"]
    late = {c: LATE_S * rng.standard_normal() + (size if (c, what) == (channel, "late") else 0.0) for c in NOISE}
    step = int(rng.choice([2, 4, 8])) if dt < 0.006 else int(rng.choice([1, 2]))
    quantised, out = rng.random() < 0.3, {}
    for c, std in NOISE.items():
        y: FloatArray = true[c]
        if (c, what) == (channel, "lag"):
            y = first_order_lag(y, dt, size)
        y = np.interp(truth.t_s - late[c], truth.t_s, y)[::step]
        y = y * (1.0 + SOUND.get(c, 0.01) * rng.standard_normal() + (size if (c, what) == (channel, "scale") else 0.0))
        y = y + std * rng.uniform(0.7, 1.4) * rng.standard_normal(y.size)
        out[c] = np.round(y / QUANTUM[c]) * QUANTUM[c] if quantised and c in QUANTUM else y
    out["q"] = out["q"] + 0.003 * rng.standard_normal()
    out["az"] = out["az"] + 0.1 * rng.standard_normal()
    channels = ["V", "alpha", "q", "theta", "az"]
    channels += [c for c in ("ax", "h") if rng.random() < 0.5]
    channels += ["p", "r", "phi", "beta", "ay", "psi"] if rng.random() < 0.3 else []
    columns = np.column_stack([out[c] for c in channels])
    return FlightRecord(truth.t_s[::step][: len(columns)], tuple(channels), columns, "measured")


def _own(name: str) -> float:
    """Return the standard deviation of the small error of one kind that an instrument has anyway."""
    channel, _, kind = name.rpartition("_")
    return {"scale": SOUND.get(channel, 0.01), "late": LATE_S, "lag": LATE_S}.get(kind, 0.0)


def row_of(kind: str, seeds: Iterator[int] | range, tell: bool = False) -> dict[str, object]:
    """Return the row of one kind of error."""
    channel, what, size = KINDS[kind]
    found: list[Agreement] = []
    spent = []
    for seed in seeds:
        record = measured(kind, seed)
        began = time.process_time()
        found.append(agreement([record]))
        spent.append(since(began))
        if tell:
            a = found[-1]
            said = ", ".join(f"{f.name} {f.probability:.2f} {f.estimate:.3f}+-{f.std:.3f}" for f in a.faults[:3])
            name, compared = FLOWN[seed % len(FLOWN)].name, ",".join(a.compared)
            print(f"  {seed} {name} {spent[-1]:.1f} s, agree {a.p_agree:.2g}: {said}; {compared}", flush=True)
    named = [a.fault for a in found]
    right = [f for f in named if f is not None and f.channel == channel]
    same = [f for f in right if f.kind == what]
    return {
        "kind": kind,
        "flights": len(found),
        "flagged": sum(a.contradicted for a in found),
        "instrument_named": len(right),
        "named_wrong": sum(f is not None for f in named) - len(right),
        "kind_named": len(same),
        "within_3_std": sum(bool(abs(f.estimate - size) < 3.0 * np.hypot(f.std, _own(f.name))) for f in same),
        "median_s": f"{np.median(spent):.2f}",
    }


def by_kinds(
    kinds: Sequence[str], row: Callable[[str, range, bool], dict[str, object]], table: Path, seeds: int
) -> None:
    """Draw, ask, and write a table with a row for each kind, whose seeds begin a thousand after those before."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=sized(seeds, 1))
    parser.add_argument("--first", type=int, default=10_000)
    parser.add_argument("--kinds", nargs="*", default=list(kinds))
    parser.add_argument("--tell", action="store_true")
    parser.add_argument("--dry", action="store_true")
    given = parser.parse_args()
    rows = []
    for i, kind in enumerate(kinds):
        if kind not in given.kinds:
            continue
        first = given.first + 1000 * i
        rows.append(row(kind, range(first, first + given.seeds), given.tell))
        print(rows[-1], flush=True)
    if not given.dry:
        write_rows(table, rows[0], rows)


if __name__ == "__main__":
    by_kinds(list(KINDS), row_of, TABLE, 20)
