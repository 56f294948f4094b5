"""Taurus paper: whether filter, log at 8 Hz or doublet of 2 s hides the short period; and the loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from testbench.core.record import FlightAborted, FlightRecord
from testbench.core.scenario.inputs import Doublet
from testbench.estimators.prepare import prepare
from testbench.estimators.settings import TransferFunctions
from testbench.page.figure import Panel, Plate
from testbench.page.tables import Column, Table, Value
from testbench.questions.reproduce.bench import DOUBLET_S, LOG_HZ, Bench, attempt, bench
from testbench.questions.reproduce.section import Comparison, Say, Section, Why, claim_row, judge_claim, line, plate
from testbench.questions.reproduce.taurus_model import fast_pair
from testbench.sensors import load_suite

PERIODS_S = (DOUBLET_S, 0.5)
RATES_HZ = (LOG_HZ, 40.0)
CUTOFFS_HZ = (0.4, 3.0, None)
PAPER = (DOUBLET_S, LOG_HZ, 0.4)
"""Doublet, log and filter that give poles like the printed ones; the paper does not say where its filter ended."""
NEAR = 40.0  # distance in percent up to which a pole is said to be near the short period
LOOP_DEG, LOOP_AMPLITUDE_DEG, LOOP_PERIODS_S = 90.0, 4.0, (2.0, 3.0, 4.0)
_FLIGHTS = 8
_FOUR_POLES = TransferFunctions(method="transfer_function", poles=4, zeros=(0, 1, 2, 3))
Setting = tuple[float, float, float | None]


def fast_poles(stand: Bench, flights: int = _FLIGHTS) -> dict[Setting, complex | None]:
    """Return (doublet s, log Hz, cut-off Hz) -> fast pole of one four-pole fit of q to all flights together."""
    suite = load_suite("taurus_8hz")
    suite = replace(suite, sensors=tuple(s for s in suite.sensors if s.channel in ("q", "de_cmd")))
    out: dict[Setting, complex | None] = {}
    for period in PERIODS_S:
        entry = Doublet(signal="doublet", control="de", amplitude_deg=3.0, period_s=period, start_s=1.0)
        seeds = range(1, flights + 1)
        truths = [stand.fly((entry,), 8.0, 40.0, turbulence_m_s=0.3, seed=k) for k in seeds]
        for rate in RATES_HZ:
            measured = [replace(suite, rate_hz=rate).measure(t, k) for k, t in zip(seeds, truths, strict=True)]
            for cutoff in CUTOFFS_HZ:
                records = [prepare(r, bias="trim", trim_s=2.0, lowpass_hz=cutoff) for r in measured]
                model = attempt(_FOUR_POLES, records, ["de_cmd"], ["q"])
                out[period, rate, cutoff] = fast_pair(model.poles()["q"]) if model else None
    return out


def distances(poles: Mapping[Setting, complex | None], short_period: complex) -> dict[Setting, float]:
    """Return setting -> 100 |ln(found / short period)| in percent; NaN without an oscillatory pole."""
    return {k: float("nan") if s is None else 100.0 * abs(np.log(s / short_period)) for k, s in poles.items()}


def cause(found: Mapping[Setting, float]) -> tuple[str, dict[str, float]]:
    """Return the single change from PAPER that brings the pole nearest to the short period, and all distances."""
    single = {
        "no filter": found[PAPER[0], PAPER[1], None],
        f"a log of {RATES_HZ[1]:g} Hz": found[PAPER[0], RATES_HZ[1], PAPER[2]],
        f"doublets of {PERIODS_S[1]:g} s": found[PERIODS_S[1], PAPER[1], PAPER[2]],
    }
    return min(single, key=lambda k: single[k] if np.isfinite(single[k]) else np.inf), single


def steepest_pitch(stand: Bench, period_s: float) -> tuple[float, bool]:
    """Return the largest |theta| in deg of one doublet, nose down first, and whether the flight left its limits."""
    entry = Doublet(signal="doublet", control="de", amplitude_deg=LOOP_AMPLITUDE_DEG, period_s=period_s)
    try:
        truth: FlightRecord = stand.fly((entry,), 8.0, 40.0, settle_s=1.0)
    except FlightAborted:
        return float("nan"), True
    return float(np.degrees(np.max(np.abs(truth["theta"])))), False


def section(say: Say) -> Section:
    """Return which of the three does it."""
    say("Taurus: filter, log rate or doublet?")
    stand = bench("taurus_doublet")
    short = complex(stand.truth.modes["short period"])
    poles = fast_poles(stand)
    found = distances(poles, short)
    loops = {p: steepest_pitch(stand, p) for p in LOOP_PERIODS_S}
    return Section(
        "taurus_causes",
        "The finding about 8 Hz, 2 s doublets and the filter",
        findings(found),
        (loop_row(loops),),
        (_table(poles, found, short),),
        (_plate(poles, short),),
    )


def findings(found: Mapping[Setting, float]) -> tuple[str, ...]:
    """Return in words which of the three keeps the short period away."""
    name, single = cause(found)
    others = ", ".join(f"{k} {v:.0f} %" for k, v in single.items() if k != name)
    best = min((k for k in found if np.isfinite(found[k])), key=lambda k: found[k])
    eight = [v for (_, rate, cutoff), v in found.items() if rate == LOG_HZ and cutoff != PAPER[2] and np.isfinite(v)]
    enough = bool(eight) and max(eight) <= NEAR
    return (
        f"Filtered at {PAPER[2]:g} Hz, logged at {LOG_HZ:g} Hz and flown with {DOUBLET_S:g} s doublets the fast pole "
        f"of q is {found[PAPER]:.0f} % away from the short period; of the three, one changed at a time, {name} brings "
        f"it nearest: {single[name]:.0f} % ({others})",
        f"Without that filter every record at {LOG_HZ:g} Hz comes within {NEAR:g} %: the log rate is not what hides "
        "the short period"
        if enough
        else f"Not every record at {LOG_HZ:g} Hz comes within {NEAR:g} % without that filter: the log has its share",
        f"The nearest of all, {found[best]:.0f} %, comes from {best[0]:g} s doublets at {best[1]:g} Hz "
        + ("unfiltered" if best[2] is None else f"filtered at {best[2]:g} Hz")
        + ": four poles also have to serve servo, delay and noise",
    )


def loop_row(loops: Mapping[float, tuple[float, bool]]) -> Comparison:
    """Return the paper's remark on longer doublets beside what ours do."""
    first, last = loops[LOOP_PERIODS_S[0]], loops[LOOP_PERIODS_S[-1]]
    ours = ", ".join(f"{p:g} s: {'left its limits' if out else f'{peak:.0f} deg'}" for p, (peak, out) in loops.items())
    looped = any(peak >= LOOP_DEG for peak, _ in loops.values())
    worse = not first[1] and (last[1] or last[0] > 1.25 * first[0])
    return claim_row(
        "longer doublets",
        "section V",
        f"more than {DOUBLET_S:g} s pulled the aircraft into a loop",
        f"largest pitch angle at ±{LOOP_AMPLITUDE_DEG:g} deg: {ours}; “agrees” from {LOOP_DEG:g} deg, in kind if a "
        "longer one leaves the limits or pitches a quarter more",
        judge_claim(looped, worse),
        Why(
            "A pitch angle of a loop is reached.",
            "No loop, but the longer doublet pitches further and ends at the stall: the paper's amplitude is not "
            "printed, and the elevator left beside trim allows no more here.",
            "Longer doublets do not pitch this aircraft further.",
        ),
        headline=False,
    )


def _table(poles: Mapping[Setting, complex | None], found: Mapping[Setting, float], short_period: complex) -> Table:
    rows: list[tuple[Value, ...]] = []
    for (period, rate, cutoff), s in poles.items():
        size = (None, None) if s is None else (abs(s), -s.real / abs(s))
        away = found[period, rate, cutoff]
        rows.append((period, rate, "none" if cutoff is None else f"{cutoff:g}", *size, away))
    return Table(
        "taurus_causes",
        "Fast pole of q over doublet, log rate and filter",
        f"One four-pole fit to {_FLIGHTS} elevator doublets each, turbulence and noise as in the campaign. The short "
        f"period: {abs(short_period):.2f} rad/s, ζ {-short_period.real / abs(short_period):.2f}.",
        (
            Column("period_s", "doublet", "s", given=True),
            Column("rate_hz", "log", "Hz", given=True),
            Column("cutoff_hz", "filter, Hz"),
            Column("wn", "ωn", "rad/s", decimals=1),
            Column("zeta", "ζ", decimals=2),
            Column("away", "|ln(found / true)|", "%", decimals=0),
        ),
        tuple(rows),
    )


def _plate(poles: Mapping[Setting, complex | None], short_period: complex) -> Plate:
    lines = []
    for k, cutoff in enumerate(CUTOFFS_HZ):
        s = np.array([v for (_, _, c), v in poles.items() if c == cutoff and v is not None])
        name = "no filter" if cutoff is None else f"filtered at {cutoff:g} Hz"
        lines.append(line(s.real, s.imag, name, k, marker="osD"[k], joined=False))
    true = np.array([short_period])
    lines.append(line(true.real, true.imag, "true short period", "ink", marker="*", joined=False))
    return plate(
        "taurus_causes",
        "What keeps the short period away",
        f"Fast pole of q, doublets of {PERIODS_S[0]:g} and {PERIODS_S[1]:g} s, logs of {RATES_HZ[0]:g} and "
        f"{RATES_HZ[1]:g} Hz: the filter sorts them.",
        (Panel(x="Re s, rad/s", y="Im s, rad/s", draws=lines),),
        columns=1,
        height_in=2.4,
    )
