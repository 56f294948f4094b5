"""Taurus paper, section V: the campaign of 63 runs, 70 % to estimate, 30 % to judge, and where its poles come from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.core.constants import DEG_RAD
from testbench.core.record import FlightRecord
from testbench.estimators import estimate
from testbench.estimators.prepare import prepare
from testbench.estimators.settings import TransferFunctions
from testbench.evaluation.metrics import fit_percent
from testbench.evaluation.truth import true_model
from testbench.flight import FlightCondition, TrimmedFlight, load_aircraft, trim
from testbench.flight.air import Air, turbulence_rms
from testbench.flight.batch.jobs import Job
from testbench.flight.simulate import Manoeuvre
from testbench.line import fly_and_measure
from testbench.page.figure import Panel, Plate
from testbench.page.labels import symbol
from testbench.page.tables import Column, Table, Value
from testbench.questions.plan.scenario import PlanScenario
from testbench.questions.reproduce.bench import (
    DOUBLET_S,
    LATERAL,
    LOG_HZ,
    LONGITUDINAL,
    RUNS,
    SHARE_PERCENT,
    TRANSFER_FUNCTIONS,
    attempt,
)
from testbench.questions.reproduce.section import (
    Comparison,
    Say,
    Section,
    Why,
    Written,
    claim_row,
    judge_claim,
    judge_number,
    line,
    number_row,
    plate,
    span,
    taken_over,
)
from testbench.questions.reproduce.taurus_model import fast_pair, peak_rad_s, printed_poles
from testbench.sensors import SensorSuite, load_suite

OUTPUTS = ("theta", "q", "u", "h")
CUTOFFS_HZ = (0.3, 0.4, 0.6, 0.8, 1.2, 1.6, 2.4)
PAPER_LIKE_HZ = 0.4
FOLLOWS = 0.7  # power of the cut-off from which the fast pole is said to follow it
_LATERAL = {"theta": "phi", "q": "p", "u": "u", "h": "h"}
_FOUR_POLES = TransferFunctions(method="transfer_function", poles=4, zeros=(0, 1, 2, 3))
_SHOWN = {"de": ("theta", "q"), "thr": ("u", "h"), "da": ("phi", "p"), "dr": ("phi", "p")}


Sweep = Mapping[float, tuple[Mapping[str, complex | None], Mapping[str, float]]]
"""Cut-off in Hz -> fast pole and fit in percent by output."""


@dataclass(frozen=True, eq=False)
class Run:
    """One doublet: which control, at which speed, and its record at 8 Hz."""

    control: str
    V_m_s: float
    record: FlightRecord


def fly_campaign(say: Say, controls: Sequence[str] = ("de", "thr", "da", "dr")) -> list[Run]:
    """Fly the runs of ``scenarios/plan/taurus_63.toml`` on the given controls: by hand, in light turbulence, at 8 Hz.

    Every run has its own pilot timing, turbulence and noise, all from the number of the run.
    """
    plan = PlanScenario.load("plan/taurus_63")
    aircraft = load_aircraft(plan.aircraft, plan.wings)
    rms = turbulence_rms(plan.turbulence_rms_m_s, plan.heights_m[0])
    longitudinal = load_suite(plan.suite)
    trims: dict[float, TrimmedFlight] = {}
    runs, number = [], 0
    for entry in plan.manoeuvre:
        control = entry.input[0].control
        if control in controls:
            say(f"Taurus: fly {entry.name}s")
        for V in entry.speeds_m_s or plan.speeds_m_s:
            for _ in range(entry.repeats or 1):
                number += 1
                if control not in controls:
                    continue
                if V not in trims:
                    trims[V] = trim(aircraft, FlightCondition(V, plan.heights_m[0]))
                signal = entry.input[0]
                pilot = signal.pilot.model_copy(update={"jitter_s": 0.1, "seed": number})  # type: ignore[union-attr]
                inputs = (signal.model_copy(update={"pilot": pilot}),)
                suite = _suite_for(longitudinal, control)
                manoeuvre = Manoeuvre.of(entry.name, inputs, entry.duration_s, trims[V].rate_hz, settle_s=2.0)
                air = Air(0.0, 0.0, 0.0, rms, None, None, number)
                flight = fly_and_measure(Job(aircraft, trims[V], manoeuvre, 40.0, air=air), [suite], number)
                runs.append(Run(control, V, flight.measured[suite.name]))
    return runs


def _suite_for(suite: SensorSuite, control: str) -> SensorSuite:
    """Return the 8 Hz suite with the command of ``control``, and with p and phi for the lateral runs."""
    lateral = control in ("da", "dr")
    sensors = []
    for s in suite.sensors:
        name = f"{control}_cmd" if s.channel == "de_cmd" else _LATERAL[s.channel] if lateral else s.channel
        sensors.append(s if name == s.channel else replace(s, channel=name))
    return replace(suite, sensors=tuple(sensors))


def four_poles(runs: Sequence[Run], lowpass_hz: float | None) -> tuple[dict[str, complex | None], dict[str, float]]:
    """Return output -> fast pole pair and output -> fit on held-out runs, of one fit to 70 % of the runs."""
    records = [prepare(r.record, bias="trim", trim_s=2.0, lowpass_hz=lowpass_hz) for r in runs]
    order = np.random.default_rng(0).permutation(len(records))
    cut = round(0.7 * len(records))
    fit, judge = [records[k] for k in order[:cut]], [records[k] for k in order[cut:]]
    model = estimate(_FOUR_POLES, fit, ["de_cmd"], OUTPUTS, judge)
    y = np.vstack([r.columns(OUTPUTS) for r in judge])
    predicted = np.vstack([model.simulate(r) for r in judge])
    good = dict(zip(OUTPUTS, fit_percent(y, predicted).tolist(), strict=True))
    return {o: fast_pair(p) for o, p in model.poles().items()}, good


def single_runs(runs: Sequence[Run], lowpass_hz: float) -> dict[str, list[complex]]:
    """Return output -> fast pole pairs of fits to each run by itself."""
    out: dict[str, list[complex]] = {o: [] for o in OUTPUTS}
    for run in runs:
        record = prepare(run.record, bias="trim", trim_s=2.0, lowpass_hz=lowpass_hz)
        model = attempt(_FOUR_POLES, [record], ["de_cmd"], OUTPUTS)
        for o, poles in model.poles().items() if model else ():
            found = fast_pair(poles)
            if found is not None:
                out[o].append(found)
    return out


def section(say: Say) -> Section:
    """Return the campaign and what its fits say of filter and poles."""
    runs = fly_campaign(say)
    elevator = [r for r in runs if r.control == "de"]
    aircraft = load_aircraft("taurus")
    truth = true_model(aircraft, trim(aircraft, FlightCondition(12.0, 100.0)))
    short, w = truth.modes["short period"], truth.linear.states.index("w")
    heave = -float(truth.linear.A[w, w])
    say("Taurus: four poles over the cut-off of the noise filter")
    sweep = {c: four_poles(elevator, c) for c in CUTOFFS_HZ}
    alone = single_runs(elevator, PAPER_LIKE_HZ)
    return Section(
        "taurus_campaign",
        "The campaign of 63 runs, and its wandering poles",
        findings(sweep, alone, abs(short)),
        comparisons(runs, sweep, alone, heave),
        (_run_table(runs), _sweep_table(sweep)),
        (_sweep_plate(sweep, abs(short)), _wander_plate(alone, short)),
    )


def findings(sweep: Sweep, alone: Mapping[str, Sequence[complex]], short_period: float) -> tuple[str, ...]:
    """Return what the pooled and the single fits say, in words."""
    ratio = [abs(s) / (2.0 * np.pi * c) for c, (poles, _) in sweep.items() for s in poles.values() if s is not None]
    low, high = (float(v) for v in np.percentile(ratio, [10, 90]))
    follow = slope(sweep)
    printed = [abs(p[0]) for p in printed_poles().values()]
    found = [abs(s) for s in sweep[PAPER_LIKE_HZ][0].values() if s is not None]
    spread = {o: np.percentile([abs(s) for s in v], [10, 90]) for o, v in alone.items() if v}
    follows = "follows" if follow >= FOLLOWS else "does not follow"
    near = judge_number(float(np.mean(printed)), float(np.mean(found)))
    return (
        f"The fast pole of a four-pole fit {follows} the cut-off of the noise filter: over cut-offs from "
        f"{CUTOFFS_HZ[0]:g} to {CUTOFFS_HZ[-1]:g} Hz it grows as its power {follow:.2f} and lies at {low:.2f} to "
        f"{high:.2f} times it (8 of 10 fits), wherever the true short period is ({short_period:.1f} rad/s)",
        f"A filter at {PAPER_LIKE_HZ:g} Hz and doublets whose energy peaks at {peak_rad_s():.1f} rad/s give fast poles "
        f"of {span(found, 'rad/s', 1)}; printed are {span(printed, 'rad/s', 1)}"
        + (": such a filter may explain them" if near != "differs" else ": such a filter does not explain them"),
        "From run to run they wander: "
        + ", ".join(f"{symbol(o)} {low:.1f} to {high:.1f} rad/s" for o, (low, high) in spread.items())
        + f" (8 of 10 single runs at {PAPER_LIKE_HZ:g} Hz)",
    )


def slope(sweep: Sweep) -> float:
    """Return d ln(fast pole) / d ln(cut-off), least squares over all outputs: 1 follows the filter, 0 does not."""
    pairs = [(np.log(c), np.log(abs(s))) for c, (poles, _) in sweep.items() for s in poles.values() if s is not None]
    x, y = np.array(pairs).T
    return float(np.polyfit(x, y, 1)[0])


def comparisons(
    runs: Sequence[Run], sweep: Sweep, alone: Mapping[str, Sequence[complex]], heave: float
) -> tuple[Comparison, ...]:
    """Return counts and poles beside the paper's; ``heave``: damping of w by lift, 1/s."""
    like, fits = sweep[PAPER_LIKE_HZ]
    why = Why(
        "With the cut-off chosen for it: the paper does not say where its filter ended.",
        "The cut-off was chosen for such poles: the paper does not say where its filter ended.",
        "Not even a cut-off chosen for such poles brings this output near.",
    )
    rows = [
        taken_over(
            "runs flown",
            "section V",
            f"{RUNS}: {LONGITUDINAL} longitudinal, {LATERAL} lateral",
            f"{len(runs)}: {sum(r.control in ('de', 'thr') for r in runs)} longitudinal, "
            f"{sum(r.control in ('da', 'dr') for r in runs)} lateral",
            "How they divide over controls, speeds and amplitudes is not printed and is assumed.",
        ),
        taken_over(
            "division of the data",
            "section VII",
            f"{SHARE_PERCENT[0]} % to estimate, {SHARE_PERCENT[1]} % to validate",
            f"{SHARE_PERCENT[0]} % and {SHARE_PERCENT[1]} % of the elevator runs, drawn once",
            "The paper divides data points, here whole runs are divided, so that no run judges itself.",
        ),
        taken_over("log and doublet", "sections IV and V", f"{LOG_HZ:g} Hz, {DOUBLET_S:g} s", "the same"),
    ]
    for o in OUTPUTS:
        s = like[o]
        printed, where = abs(printed_poles()[o][0]), TRANSFER_FUNCTIONS[o][0]
        found = float("nan") if s is None else abs(s)
        rows.append(
            number_row(
                f"campaign: ωn of the fast pole of {symbol(o)}", where, printed, found,
                Written("rad/s", 2, 2,
                        f", pooled fit to {SHARE_PERCENT[0]} % of the runs; fit {fits[o]:.0f} % on the rest"), why,
            )
        )  # fmt: skip
    share = inside(alone)
    rows.append(
        claim_row(
            "the printed fast poles lie among those of single runs",
            "equations 6 to 9",
            ", ".join(f"{symbol(o)} {abs(printed_poles()[o][0]):.2f}" for o in OUTPUTS) + " rad/s",
            f"{sum(share.values())} of {len(share)} lie between the 10th and 90th percentile of our single runs; "
            "“agrees” if all, in kind from half",
            judge_claim(all(share.values()), 2 * sum(share.values()) >= len(share)),
            Why(
                "A single doublet at 8 Hz behind such a filter leaves the fast pole open over this range.",
                "A single doublet behind such a filter leaves the fast pole open over a range that holds most of them.",
                "The wandering here does not reach them.",
            ),
        )
    )
    trace = [-np.roots(below).sum().real for _, _, below in TRANSFER_FUNCTIONS.values()]
    rows.append(
        claim_row(
            "the printed poles can be those of an aircraft of this size",
            "equations 6 to 9",
            f"−{max(trace):.2f} to −{min(trace):.2f} 1/s",
            f"the simulated aircraft's heave damping alone is −{heave:.1f} 1/s at 12 m/s; “agrees” if the largest "
            "printed sum reaches that",
            judge_claim(heave <= max(trace)),
            Why(
                "The printed poles can be an aircraft's.",
                "",
                f"With the printed wing area the mass, which is not printed and estimated here, would have to be "
                f"{heave / max(trace):.1f} times ours: the printed poles are those of a filter and an input.",
            ),
        )
    )
    return tuple(rows)


def inside(alone: Mapping[str, Sequence[complex]]) -> dict[str, bool]:
    """Return output -> whether the printed fast pole lies between the 10th and 90th percentile of single runs."""
    out = {}
    for o in OUTPUTS:
        low, high = np.percentile([abs(s) for s in alone[o]], [10, 90]) if alone[o] else (np.nan, np.nan)
        out[o] = bool(low <= abs(printed_poles()[o][0]) <= high)
    return out


def _run_table(runs: Sequence[Run]) -> Table:
    rows: list[tuple[Value, ...]] = []
    for control in ("de", "thr", "da", "dr"):
        for V in sorted({r.V_m_s for r in runs if r.control == control}):
            chosen = [r for r in runs if r.control == control and r.V_m_s == V]
            peaks = []
            for name in _SHOWN[control]:
                scale = 1.0 if name in ("u", "h") else 1.0 / DEG_RAD
                peaks.append(float(np.median([scale * np.ptp(r.record[name]) for r in chosen])))
            names = ", ".join(symbol(n) for n in _SHOWN[control])
            rows.append((f"{symbol(control)} doublets", V, len(chosen), names, *peaks))
    return Table(
        "taurus_runs",
        "The runs",
        "Doublets of 2 s by hand in turbulence of 0.3 m/s. Peak to peak (median over the runs) of the two channels "
        "named, degrees or degrees per second for angles and rates, m/s and m else.",
        (
            Column("control", "control"),
            Column("V", "V", "m/s", given=True),
            Column("runs", "runs"),
            Column("channels", "channels"),
            Column("first", "first, peak to peak", decimals=1),
            Column("second", "second, peak to peak", decimals=1),
        ),
        tuple(rows),
    )


def _sweep_table(sweep: Sweep) -> Table:
    columns = [Column("cutoff_hz", "cut-off", "Hz", given=True), Column("cutoff_rad_s", "cut-off", "rad/s")]
    columns += [Column(f"wn {o}", symbol(o), "rad/s", "fast pole") for o in OUTPUTS]
    columns += [Column(f"fit {o}", symbol(o), "%", "fit on held-out runs", decimals=0) for o in OUTPUTS]
    rows: list[tuple[Value, ...]] = []
    for cutoff, (poles, fits) in sweep.items():
        sizes = [None if (s := poles[o]) is None else abs(s) for o in OUTPUTS]
        rows.append((cutoff, 2.0 * np.pi * cutoff, *sizes, *(fits[o] for o in OUTPUTS)))
    return Table(
        "taurus_cutoffs",
        "Fast pole and fit over the cut-off of the noise filter",
        "Pooled fits to 70 % of the elevator runs, judged on the rest. The paper says that noise was filtered, and not "
        "where.",
        tuple(columns),
        tuple(rows),
    )


def _sweep_plate(sweep: Sweep, short: float) -> Plate:
    cutoff = np.array(list(sweep))
    lines = [line(cutoff, 2.0 * np.pi * cutoff, "cut-off of the filter", "quiet", width=2.0)]
    for k, o in enumerate(OUTPUTS):
        sizes = np.array([np.nan if (s := poles[o]) is None else abs(s) for poles, _ in sweep.values()])
        lines.append(line(cutoff, sizes, symbol(o), k, marker="osD^"[k]))
    lines.append(line(cutoff, np.full(cutoff.size, short), "true short period", "ink", width=2.0))
    return plate(
        "taurus_cutoffs",
        "The fast pole follows the filter, not the aircraft",
        "Natural frequency of the fastest pole pair of pooled four-pole fits over the cut-off of the zero-phase filter "
        "that input and outputs pass.",
        (Panel(x="cut-off, Hz", y="ωn of the fast pole, rad/s", draws=lines, log_x=True, log_y=True),),
        columns=1,
        height_in=2.4,
    )


def _wander_plate(alone: dict[str, list[complex]], short: complex) -> Plate:
    lines = []
    for k, o in enumerate(OUTPUTS):
        s = np.array(alone[o])
        lines.append(line(s.real, s.imag, f"{symbol(o)}, single runs", k, marker="osD^"[k], joined=False))
    printed = np.array([p[0] for p in printed_poles().values()])
    lines.append(line(printed.real, printed.imag, "printed, equations 6 to 9", "ink", marker="x", joined=False))
    true = np.array([short])
    lines.append(line(true.real, true.imag, "true short period", "ink", marker="*", joined=False))
    return plate(
        "taurus_wandering",
        "The wandering poles",
        f"Fastest pole pair of four-pole fits to each elevator doublet by itself, filtered at {PAPER_LIKE_HZ:g} Hz, "
        "the "
        "printed ones, and the short period that all of these runs excited.",
        (Panel(x="Re s, rad/s", y="Im s, rad/s", draws=lines, x_range=(-8.0, 1.5), y_range=(-0.2, 8.0)),),
        columns=1,
        height_in=2.8,
    )
