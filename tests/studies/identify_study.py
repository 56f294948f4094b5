"""Can `testbench identify` be believed? Logs of random aircraft, one error or none: results/estimators/believed.csv.

Run ``python tests/studies/identify_study.py [--seeds N] [--first SEED]``. The flights are those of
instruments_study.py, with the deflection of the elevator or what stands for it; each goes the way of a user's log: a
file, `testbench import`, `testbench identify`. What is called determined is compared with the derivatives of the
aircraft at its trim.
"""

import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from clock import since
from smallest import results
from studies.instruments_study import FLOWN, KINDS, NOISE, Flying, aircraft_of, by_kinds, condition, flight, measured

import testbench as tb
from testbench.core.advice import ranked
from testbench.core.errors import Refusal
from testbench.core.record import FlightAborted, FlightRecord
from testbench.evaluation.derivatives import Derivative, dimensional_derivatives, true_parameters
from testbench.flight import linearise
from testbench.questions.identify.ask import identify
from testbench.questions.identify.logs import descriptions_of
from testbench.questions.identify.result import Identified
from testbench.questions.identify.scenario import RecordDescription
from testbench.sensors.sensor import first_order_lag

TABLE = results("estimators", "believed.csv")


@dataclass(frozen=True)
class Kind:
    """What is in the way of a log but for errors of instruments.

    Attributes:
        how: it is flown.
        lag_s: behind what is logged of the elevator.
        early_s: by which the elevator is logged early.
        commanded: log the elevator as it would have moved without ``how.rate``.
        without: channels that are not logged.
        drift: of every channel, over the record, in standard deviations of its noise.
        colour_s: time constant of noise four times as large; 0 for white noise alone.
        samples: that are logged, from just before the first input; 0 for all.
    """

    how: Flying = field(default_factory=Flying)
    lag_s: float = 0.0
    early_s: float = 0.0
    commanded: bool = False
    without: tuple[str, ...] = ()
    drift: float = 0.0
    colour_s: float = 0.0
    samples: int = 0


OTHERS: Mapping[str, Kind] = {
    "command, servo of 0.1 s": Kind(lag_s=0.1),
    "surface logged 60 ms early": Kind(early_s=0.06),
    "command, rate limit": Kind(Flying(rate=8.0), commanded=True),
    "gusts, no vane": Kind(Flying(gusts=True), without=("alpha", "beta")),
    "pitch damper in gusts": Kind(Flying(True, ("pitch_damper", (("gain_s", 0.15),)))),
    "filtered damper in gusts": Kind(Flying(True, ("filtered_pitch_damper", (("gain_s", 0.1), ("lag_s", 0.1))))),
    "washed damper in gusts": Kind(Flying(True, ("washed_pitch_damper", (("gain_s", 0.15), ("washout_rad_s", 0.5))))),
    "twice the input": Kind(Flying(larger=2.0)),
    "drifts": Kind(drift=5.0),
    "coloured noise": Kind(colour_s=0.5),
    "held at 10 Hz": Kind(Flying(held_hz=10.0)),
    "thirty samples": Kind(samples=30),
    "throttle moves with it": Kind(Flying(thrust=0.1)),
}
"""Kinds beside those of instruments."""
UNITS = dict.fromkeys(("az", "ax", "ay"), "m/s2") | dict.fromkeys(("p", "q", "r"), "rad/s") | {"V": "m/s", "h": "m"}
KINDS_HERE = (*KINDS, *OTHERS)
ERRORS = 4.0


@dataclass(frozen=True)
class Judged:
    """One log: whether it was refused or called not to be used, (value - truth) / std of what is determined, all, s."""

    refused: bool
    unusable: bool
    off: tuple[float, ...]
    derivatives: int
    spent_s: float
    said: str = ""


def logged(kind: str, seed: int) -> FlightRecord:
    """Return the record of one draw with the elevator as it is logged."""
    own = OTHERS.get(kind, Kind())
    record = measured(kind if kind in KINDS else "clean", seed, own.how if kind in OTHERS else None)
    truth, rng = flight(seed, own.how if kind in OTHERS else Flying(kind == "clean in gusts"))
    if own.commanded:
        truth, _ = flight(seed, replace(own.how, rate=0.0))
    controls = [c for c in ("de", "thr") if c in truth]
    de, t = truth["de"], truth.t_s
    if own.early_s:
        de = np.interp(t + own.early_s, t, de)
    if own.lag_s:  # the command that a servo of this lag turns into what flew
        de = de + own.lag_s * np.gradient(first_order_lag(de, truth.dt_s, 0.02), t)
    step, kept = round(record.dt_s / truth.dt_s), [c for c in record.channels if c not in own.without]
    inputs = np.column_stack([de, *(truth[c] for c in controls[1:])])[::step][: len(record)]
    n, noise = len(record), np.array([NOISE[c] for c in kept])
    columns = record.select(kept).data + own.drift * noise * np.linspace(0.0, 1.0, n)[:, None]
    if own.colour_s:
        white = rng.standard_normal(columns.shape)
        slow = first_order_lag(white, record.dt_s, own.colour_s)
        columns = columns + 4.0 * noise * slow / slow.std(axis=0)
    taken = slice(0, n)
    if own.samples:
        first = int(np.argmax(np.abs(inputs[:, 0] - inputs[0, 0]) > 1e-3)) - 3
        every = max(1, round(0.05 / record.dt_s))
        taken = slice(first, first + own.samples * every, every)
    data = np.column_stack([columns, inputs])[taken]
    return FlightRecord(record.t_s[: len(data)] * (taken.step or 1), (*kept, *controls), data, "measured")


def judge(kind: str, seed: int) -> Judged:
    """Return what is said of one log."""
    try:
        record = logged(kind, seed)
    except FlightAborted as error:
        return Judged(True, False, (), 0, 0.0, str(error))
    began = time.process_time()
    with TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        header = ",".join(["time [s]", *(f"{c} [{UNITS.get(c, 'rad')}]" for c in record.channels)])
        np.savetxt(path, np.column_stack([record.t_s, record.data]), "%.9g", ",", header=header, comments="")
        try:
            descriptions = descriptions_of(path, Path(folder) / "out")
            found = identify(RecordDescription.load(descriptions[0]))
        except Refusal as error:
            return Judged(True, False, (), 0, since(began), str(error))
    spent = since(began)
    aircraft = aircraft_of(FLOWN[seed % len(FLOWN)].name, seed % 5)
    trimmed = tb.trim(aircraft, condition(seed))
    return _judged(found, dimensional_derivatives(linearise(aircraft, trimmed), trimmed), condition(seed).V_m_s, spent)


def _judged(found: Identified, true: Sequence[Derivative], V_m_s: float, spent_s: float) -> Judged:
    off, count, said = [], 0, []
    mine = [c for i, c in enumerate(found.cases) if i not in found.replaced]
    for d in found.derivatives:
        told = true_parameters(found.cases[d.case].model.structure.name, true, V_m_s)
        if d.name not in told or d.case in found.replaced:
            continue
        count += 1
        if d.determined:
            off.append((d.value - told[d.name]) / d.std)
            if abs(off[-1]) > ERRORS:
                said.append(f"{d.name} {d.value:.4g}+-{d.std:.2g} ({told[d.name]:.4g})")
    said += [f"{a.severity} {a.code}" for c in mine for a in ranked(c.model.advice) if a.severity != "note"]
    said += [m.why[:90] for m in found.missed]
    said += [str(a)[:90] for c in mine for a in c.model.advice if a.severity == "wrong"]
    said += [note[:160] for note in found.notes if "white" in note or "late" in note]
    unusable = bool(found.missed) or any(c.model.status == "wrong" for c in mine)
    return Judged(False, unusable, tuple(off), count, spent_s, "; ".join(said))


def row_of(kind: str, seeds: Iterator[int] | range, tell: bool = False) -> dict[str, object]:
    """Return the row of one kind."""
    found = []
    for seed in seeds:
        found.append(judge(kind, seed))
        if tell:
            j = found[-1]
            print(
                f"  {seed} {FLOWN[seed % len(FLOWN)].name} {j.spent_s:.1f} s {len(j.off)} of {j.derivatives}: {j.said}",
                flush=True,
            )
    off = np.abs([e for j in found for e in j.off])
    return {
        "kind": kind,
        "flights": len(found),
        "refused": sum(j.refused for j in found),
        "unusable": sum(j.unusable for j in found),
        "derivatives": sum(j.derivatives for j in found),
        "determined": off.size,
        "within_95": f"{np.mean(off < 1.96):.3f}" if off.size else "",
        "wrong_unseen": sum(any(abs(e) > ERRORS for e in j.off) for j in found),
        "median_s": f"{np.median([j.spent_s for j in found]):.2f}",
    }


if __name__ == "__main__":
    by_kinds(KINDS_HERE, row_of, TABLE, 10)
