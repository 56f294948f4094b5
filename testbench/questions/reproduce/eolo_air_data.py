"""What the EOLO paper announces: identification with alpha and beta measured, longitudinal and lateral."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.constants import DEG_RAD
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.scenario.inputs import Doublet, StandardMultistep
from testbench.estimators.identification import Estimator
from testbench.estimators.prepare import prepare
from testbench.evaluation.envelope import fly_envelope
from testbench.evaluation.modes import match_poles
from testbench.flight import FlightCondition, trim
from testbench.page.figure import Panel, Plate
from testbench.page.labels import number, symbol
from testbench.page.tables import Column, Table, Value
from testbench.page.words import listed
from testbench.questions.reproduce.bench import EOLO_FUTURE, EOLO_PAST, Bench, attempt, bench, dsr_e, lost_poles
from testbench.questions.reproduce.section import Comparison, Say, Section, Why, claim_row, judge_claim, line, plate
from testbench.sensors import load_suite

SEEDS = 8
HORIZONS: dict[str, tuple[Estimator, Estimator]] = {
    f"J = {EOLO_PAST}, L = {EOLO_FUTURE}": (dsr_e(4, EOLO_PAST, EOLO_FUTURE), dsr_e(4, EOLO_PAST, EOLO_FUTURE)),
    "J = L = 50 or 40": (dsr_e(5, 50, 50), dsr_e(5, 40, 40)),
}
"""Horizons -> estimator of the longitudinal and of the lateral motion."""

FAST, SLOW = "short period, fast root", "short period, slow root"


@dataclass(frozen=True)
class Motion:
    """One motion: its records (one per seed), inputs, outputs without the vane, the vane, and the true poles."""

    name: str
    records: tuple[FlightRecord, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    vane: str
    true: Mapping[str, complex]


def longitudinal(stand: Bench, seeds: int) -> Motion:
    """Fly the 3-2-1-1 of ``eolo_alpha``."""
    entry = stand.scenario.manoeuvre[0]
    truth = stand.fly(entry.input, entry.duration_s)
    true = {n: s for n, s in stand.truth.modes.items() if n in (FAST, SLOW, "phugoid")}
    return Motion("longitudinal", _measure(truth, seeds), ("de",), ("V", "q", "theta"), "alpha", true)


def lateral(stand: Bench, seeds: int) -> Motion:
    """Fly a 3-2-1-1 on the rudder and a doublet on the aileron."""
    truth = stand.fly(
        (
            StandardMultistep(signal="3211", control="dr", amplitude_deg=5.0, step_s=0.3),
            Doublet(signal="doublet", control="da", amplitude_deg=3.0, period_s=1.0, start_s=8.0),
        ),
        18.0,
    )
    c = stand.scenario.condition
    found = fly_envelope(stand.aircraft, [c.V_m_s], c.h_m)
    names = [n for n in found.names("lateral-directional", False) if n != "spiral"]
    true = {n: found.poles[0][n][0] for n in names}
    return Motion("lateral", _measure(truth, seeds), ("da", "dr"), ("p", "r", "phi"), "beta", true)


def _measure(truth: FlightRecord, seeds: int) -> tuple[FlightRecord, ...]:
    suite = load_suite("eolo_alpha_beta")
    return tuple(prepare(suite.measure(truth, s), bias="trim", trim_s=2.0) for s in range(1, seeds + 1))


@dataclass(frozen=True, eq=False)
class Outcome:
    """The errors of one setting over all noises of one motion.

    ``errors`` holds mode -> 100 |ln(found / true)| per noise, at most 100, which also stands for a mode not found;
    ``lost`` is the percentage of models with a real pole z <= 0.
    """

    errors: Mapping[str, FloatArray]
    lost: float

    def median(self, mode: str) -> float:
        """Return the median error of ``mode`` in percent."""
        return float(np.median(self.errors[mode]))


Outcomes = Mapping[tuple[str, str, bool], Outcome]  # (motion, horizons, with the vane) -> outcome


def outcome(motion: Motion, spec: Estimator, with_vane: bool) -> Outcome:
    """Return the errors of all poles of ``motion`` over its noises."""
    outputs = (motion.vane, *motion.outputs) if with_vane else motion.outputs
    errors: dict[str, list[float]] = {n: [] for n in motion.true}
    lost = 0
    for record in motion.records:
        model = attempt(spec, [record], motion.inputs, outputs)
        lost += model is not None and lost_poles(model) > 0
        matches = match_poles(next(iter(model.poles().values())), motion.true) if model else []
        found = {m.name: m.found for m in matches}
        for n, true in motion.true.items():
            s = found.get(n)
            errors[n].append(100.0 if s is None else min(100.0, 100.0 * abs(np.log(s / true))))
    return Outcome({n: np.array(v) for n, v in errors.items()}, 100.0 * lost / len(motion.records))


def better(without: Outcome, with_: Outcome) -> tuple[str, ...]:
    """Return the modes that the second finds better by a tenth, and better in at least 7 of 8 paired noises.

    Seven of eight come by chance in 3.5 % of cases (sign test).
    """
    return tuple(
        n
        for n, error in without.errors.items()
        if np.sum(with_.errors[n] < error) >= 0.875 * max(8, error.size) and with_.median(n) < 0.9 * without.median(n)
    )


def section(say: Say) -> Section:
    """Return what alpha and beta buy on EOLO."""
    stand = bench("eolo_alpha")
    say("EOLO: with alpha")
    motions = [longitudinal(stand, SEEDS)]
    say("EOLO: with beta")
    motions.append(lateral(stand, SEEDS))
    found = {
        (m.name, label, vane): outcome(m, specs[k], vane)
        for k, m in enumerate(motions)
        for label, specs in HORIZONS.items()
        for vane in (False, True)
    }
    return Section(
        "eolo_air_data",
        "With angle of attack and sideslip, the paper's future work",
        findings(motions, found),
        (*(comparison(m, found) for m in motions), altitude_row(stand.aircraft)),
        (_table(motions, found),),
        (_plate(motions[1]),),
    )


def altitude_row(aircraft: Aircraft) -> Comparison:
    """Return the statement that altitude hardly changes the flight envelope beside trims over height and speed."""
    lows, highs = (100.0, 1500.0), (13.0, 22.0)
    over_height = [trim(aircraft, FlightCondition(16.0, h)).alpha / DEG_RAD for h in lows]
    over_speed = [trim(aircraft, FlightCondition(V, 547.0)).alpha / DEG_RAD for V in highs]
    height, speed = (abs(float(np.ptp(a))) for a in (over_height, over_speed))
    return claim_row(
        "altitude practically does not vary the flight envelope",
        "section 3.2",
        "true airspeed matters most, above all for α",
        f"α at trim changes by {height:.1f} deg from {lows[0]:g} to {lows[1]:g} m at 16 m/s, by {speed:.1f} deg from "
        f"{highs[0]:g} to {highs[1]:g} m/s at 547 m; “agrees” if the first is a tenth of the second or less, in "
        "kind if less than a half",
        judge_claim(height <= 0.1 * speed, height < 0.5 * speed),
        Why(
            "Air is little thinner up there.",
            "Air is a seventh thinner up there, and speed counts by its square.",
            "Thinner air counts as much here.",
        ),
    )


def _worth(motion: Motion, found: Outcomes, label: str) -> str:
    """Return in words what the vane buys for one motion at one pair of horizons."""
    without, with_ = found[motion.name, label, False], found[motion.name, label, True]
    gains = [_change(n, without, with_) for n in better(without, with_)]
    if with_.lost < without.lost - 25.0:
        gains.append(f"models with a real pole z ≤ 0: {without.lost:.0f} → {with_.lost:.0f} %")
    losses = [_change(n, without, with_) for n in better(with_, without)]
    if with_.lost > without.lost + 25.0:
        losses.append(f"models with a real pole z ≤ 0: {without.lost:.0f} → {with_.lost:.0f} %")
    gains += [f"and costs {'; '.join(losses)}"] if losses else []
    return "; ".join(gains) if gains else "nothing that stands out of the noise"


def _change(mode: str, without: Outcome, with_: Outcome) -> str:
    return f"{mode}: {number(without.median(mode), 2)} → {number(with_.median(mode), 2)} %"


def findings(motions: Sequence[Motion], found: Outcomes) -> tuple[str, ...]:
    """Return what the vanes buy, in words."""
    paper, long = HORIZONS
    out = []
    for m in motions:
        out.append(
            f"{symbol(m.vane)} in the {m.name} motion buys, {paper}: {_worth(m, found, paper)}; {long}: "
            f"{_worth(m, found, long)} (errors of poles, medians over {SEEDS} noises; 100 %: not found)"
        )
    m = motions[0]
    best = min(found[m.name, label, vane].median(FAST) for label in HORIZONS for vane in (False, True))
    where = [
        f"{label} {'with' if vane else 'without'} {symbol(m.vane)}"
        for label in HORIZONS
        for vane in (False, True)
        if found[m.name, label, vane].median(FAST) <= 1.5 * best
    ]
    out.append(
        f"The fast root of the short period is found to {best:.0f} % at best: {listed(where)}"
        + (
            ". That is the horizon's doing and not the vane's"
            if all(long in w for w in where) and len(where) == 2
            else ""
        )
    )
    return tuple(out)


def comparison(motion: Motion, found: Outcomes) -> Comparison:
    """Return the paper's expectation beside what the vane of ``motion`` buys."""
    paper, long = HORIZONS
    gains, harms = {}, False
    for label in HORIZONS:
        without, with_ = found[motion.name, label, False], found[motion.name, label, True]
        gains[label] = bool(better(without, with_)) or with_.lost < without.lost - 25.0
        harms |= bool(better(with_, without)) or with_.lost > without.lost + 25.0
    return claim_row(
        f"{symbol(motion.vane)} improves the {motion.name} model",
        "section 3.2 and conclusions, future work",
        "results expected to improve",
        f"{paper}: {_worth(motion, found, paper)}; {long}: {_worth(motion, found, long)}; “agrees” if both improve and "
        "nothing gets worse, in kind if one improves",
        judge_claim(all(gains.values()) and not harms, any(gains.values())),
        Why(
            "On a simulated aircraft with an estimated vane (0.25 deg of noise, no upwash left).",
            "It improves some and not all: what it keeps from being lost at a short future it does not make exact.",
            "Nothing that the paired noises would show.",
        ),
    )


def _table(motions: Sequence[Motion], found: Outcomes) -> Table:
    rows: list[tuple[Value, ...]] = []
    for m in motions:
        cases = [found[m.name, label, vane] for label in HORIZONS for vane in (False, True)]
        for mode, s in m.true.items():
            pole = f"{number(s.real)} 1/s" if abs(s.imag) < 1e-9 else f"{number(s.real)} ± j{number(abs(s.imag))} 1/s"
            rows.append((m.name, mode, pole, symbol(m.vane), *(c.median(mode) for c in cases)))
        rows.append((m.name, "models with a real pole z ≤ 0", "", symbol(m.vane), *(c.lost for c in cases)))
    columns = [Column("motion", "motion"), Column("mode", "mode"), Column("pole", "true pole"), Column("vane", "vane")]
    for label in HORIZONS:
        columns += [
            Column(f"without {label}", "without", "%", label, decimals=1),
            Column(f"with {label}", "with the vane", "%", label, decimals=1),
        ]
    return Table(
        "eolo_air_data",
        "Errors of the poles with and without the vane, DSR_e",
        f"100 % times |ln(found / true)|, medians over {SEEDS} noises; 100 % stands for a mode that was not found. The "
        "spiral, with a time constant of minutes, is not asked for. Order 4 with the paper's horizons, 5 with the "
        "long.",
        tuple(columns),
        tuple(rows),
    )


def _plate(motion: Motion) -> Plate:
    record = motion.records[0]
    models = [
        (name, attempt(spec[1], [record], motion.inputs, (motion.vane, *motion.outputs)), k)
        for k, (name, spec) in enumerate(HORIZONS.items())
    ]
    panels = []
    for o in (motion.vane, *motion.outputs):
        scale = float(np.degrees(1.0))
        lines = [line(record.t_s, scale * record[o], "measured", "measured", width=2.0)]
        lines += [
            line(record.t_s, scale * m.simulate(record)[:, m.outputs.index(o)], n, k)
            for n, m, k in models
            if m is not None
        ]
        unit = "deg" if o in ("beta", "phi") else "deg/s"
        panels.append(Panel(x="t, s", y=f"Δ{symbol(o)}, {unit}", draws=lines))
    return plate(
        "eolo_beta",
        "Lateral motion with β measured",
        "A 3-2-1-1 on the rudder, a doublet on the aileron at 10 s; predictions from the controls alone.",
        panels,
        height_in=1.3,
    )
