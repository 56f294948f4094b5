"""Taurus paper, figures 2, 3, 5 to 8 and equations 6 to 9: inputs, spectra, four-pole transfer functions."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from testbench.core.scenario.inputs import Doublet, Input, StandardMultistep
from testbench.estimators.model import ComplexArray
from testbench.inputs import build
from testbench.page.figure import DOTTED, Panel, Plate, Rule
from testbench.page.labels import number, shown_unit, symbol
from testbench.page.tables import Column, Table
from testbench.questions.reproduce.bench import DOUBLET_S, LOG_HZ, TRANSFER_FUNCTIONS, polynomial
from testbench.questions.reproduce.section import (
    Comparison,
    Say,
    Section,
    Why,
    Written,
    claim_row,
    judge_claim,
    line,
    not_printed,
    number_row,
    plate,
    span,
)
from testbench.questions.run.ask import run
from testbench.questions.run.result import RunResult
from testbench.questions.run.scenario import Scenario

_FIGURE = {"theta": "figure 5", "h": "figure 6", "u": "figure 7", "q": "figure 8"}
_ORDER = ("theta", "q", "u", "h")
_SAMPLING_LIMIT = np.pi * LOG_HZ  # rad/s
GOOD_FIT_PERCENT, FAIR_FIT_PERCENT = 80.0, 60.0
APART = 1.2  # ratio of the largest to the smallest fast pole from which outputs are said to have different ones
NEAR_MODE = 0.2  # |ln(found / true)| up to which a pole counts as a mode of the aircraft


def printed_poles() -> dict[str, ComplexArray]:
    """Return output -> the roots of the printed denominators in the upper half plane, rad/s, fastest first."""
    out = {}
    for name, (_, _, below) in TRANSFER_FUNCTIONS.items():
        roots = np.roots(below)
        out[name] = np.array(sorted((s for s in roots if s.imag > -1e-9), key=lambda s: -abs(s)))
    return out


def fast_pair(poles: ComplexArray) -> complex | None:
    """Return the oscillatory pole of highest frequency, or None."""
    pairs = [complex(s) for s in poles if s.imag > 1e-6]
    return max(pairs, key=abs) if pairs else None


def words(poles: ComplexArray) -> str:
    """Return poles as "1.43 rad/s (ζ 0.14)" or "−0.54 1/s", fastest first."""
    parts = []
    for s in sorted((complex(p) for p in poles if p.imag > -1e-9), key=lambda s: -abs(s)):
        if s.imag > 1e-6:
            parts.append(f"{number(abs(s))} rad/s (ζ {-s.real / abs(s):.2f})".replace("-", "−"))
        else:
            parts.append(f"{number(s.real)} 1/s")
    return "; ".join(parts)


def section(say: Say) -> Section:
    """Return the paper's inputs, fits and transfer functions beside ours."""
    say("Taurus: inputs and four-pole transfer functions")
    result = run(Scenario.load("taurus_doublet"), causes=False)
    (case,) = result.cases
    assert result.truth is not None
    fit = dict(zip(case.model.outputs, case.evaluation.validation.fit_percent.tolist(), strict=True))
    true = result.truth.modes["short period"]
    return Section(
        "taurus_model",
        "Inputs, spectra and transfer functions (figures 2, 3, 5 to 8, equations 6 to 9)",
        findings(case.model.poles(), fit, complex(true), abs(result.truth.modes["phugoid"])),
        tuple(comparisons(case.model.poles(), fit)),
        (_equation_table(case.model.poles()), _pole_table(result, fit)),
        (_inputs_plate(abs(true)), _fit_plate(result, fit)),
        head=_head(case.model.poles(), fit, complex(true), abs(result.truth.modes["phugoid"])),
    )


def _head(poles: Mapping[str, ComplexArray], fit: Mapping[str, float], short_period: complex, phugoid: float) -> str:
    """Return in one sentence that good fits prove no mode, or what came out instead."""
    fast = [s for o in _ORDER if (s := fast_pair(poles[o])) is not None and abs(s) > 1.5 * phugoid]
    right = sum(abs(np.log(s / short_period)) <= NEAR_MODE for s in fast)
    return (
        f"Taurus: transfer functions fit unseen data to {span(list(fit.values()), '%', 0)}, yet {right or 'none'} of "
        f"{len(fast)} fast pole pairs is the short period"
    )


def findings(
    poles: Mapping[str, ComplexArray], fit: Mapping[str, float], short_period: complex, phugoid: float
) -> tuple[str, ...]:
    """Return what the four fits say, in words."""
    fast = [s for o in _ORDER if (s := fast_pair(poles[o])) is not None and abs(s) > 1.5 * phugoid]
    right = [s for s in fast if abs(np.log(s / short_period)) <= NEAR_MODE]
    fits = span(list(fit.values()), "%", 0)
    good = min(fit.values()) >= GOOD_FIT_PERCENT
    sets = "different sets" if _apart(poles) >= APART else "nearly the same set"
    return (
        f"Four-pole transfer functions from {DOUBLET_S:g} s doublets at {LOG_HZ:g} Hz predict unseen data with fits of "
        f"{fits}, and {len(right) if right else 'none'} of their {len(fast)} oscillatory poles above the phugoid is "
        f"the short period: {span([abs(s) for s in fast], 'rad/s')} were found, it lies at "
        f"{abs(short_period):.1f} rad/s",
        f"Four outputs give {sets} of poles here, and four different ones in the paper; one aircraft has one set"
        + (". A good fit to doublets is no proof of a mode" if good and not right else ""),
    )


def _apart(poles: Mapping[str, ComplexArray]) -> float:
    sizes = [abs(s) for o in _ORDER if (s := fast_pair(poles[o])) is not None]
    return max(sizes) / min(sizes) if sizes else 1.0


def comparisons(poles: Mapping[str, ComplexArray], fit: Mapping[str, float]) -> list[Comparison]:
    """Return equations 6 to 9 and figures 5 to 8 beside our poles and fits."""
    out = []
    why = Why(
        "Both follow the filter and the doublet (next section), so that the nearness says nothing of the aircraft.",
        "Another aircraft, the same doublet: the poles follow filter and input, not the aircraft (next section).",
        "Printed and own poles are those of filter, input and noise, not of an aircraft (next section).",
    )
    for name in _ORDER:
        where = TRANSFER_FUNCTIONS[name][0]
        ours, theirs = fast_pair(poles[name]), printed_poles()[name][0]
        out.append(
            number_row(
                f"{symbol(name)} / δe: ωn of the fastest oscillatory pole", where, abs(theirs),
                float("nan") if ours is None else abs(ours), Written("rad/s", 2, 2, "" if ours is None else
                f" (ζ {-ours.real / abs(ours):.2f}; printed {-theirs.real / abs(theirs):.2f})"), why,
            )
        )  # fmt: skip
    apart, printed = _apart(poles), _apart(printed_poles())
    out.append(
        claim_row(
            "poles differ from output to output",
            "equations 6 to 9",
            f"largest over smallest fast pole {printed:.2f}",
            f"{apart:.2f}; “agrees” from {APART:g}",
            judge_claim(apart >= APART),
            Why(
                "One linear aircraft has one denominator; separate fits in noise do not find it.", "", "Ours coincide."
            ),
        )
    )
    least = min(fit.values())
    out.append(
        claim_row(
            "high goodness of fit on the held-out 30 %",
            "abstract, section VIII",
            "high",
            f"{span(list(fit.values()), '%', 0)}; “agrees” from {GOOD_FIT_PERCENT:g} % for all, in kind from "
            f"{FAIR_FIT_PERCENT:g} %",
            judge_claim(least >= GOOD_FIT_PERCENT, least >= FAIR_FIT_PERCENT),
            Why(
                "After a filter at 0.4 Hz only slow motion is left, which four poles can follow.",
                "Not all outputs reach it here.",
                "At least one output is not predicted here.",
            ),
        )
    )
    out += [
        not_printed(
            f"fit of {symbol(name)} on the 30 % held out", _FIGURE[name],
            "a percentage inside the figure, which the text does not give", f"{fit[name]:.1f} %",
            "The figure itself was not at hand.",
        )
        for name in ("theta", "h", "u", "q")
    ]  # fmt: skip
    return out


def _equation_table(poles: Mapping[str, ComplexArray]) -> Table:
    rows = []
    for name in _ORDER:
        where, above, below = TRANSFER_FUNCTIONS[name]
        own = tuple(float(c) for c in np.real(np.poly(poles[name])))
        ours = polynomial(tuple(float(f"{c:.4g}") for c in own)) if len(own) == len(below) else "fewer than four poles"
        rows.append((f"{symbol(name)} / δe", where, f"({polynomial(above)}) / ({polynomial(below)})", ours))
    return Table(
        "taurus_equations",
        "Equations 6 to 9",
        "As printed, δe in rad and nose up positive; our denominators from the discrete poles at 8 Hz, ln(z) / dt.",
        (
            Column("transfer_function", ""),
            Column("where", "where"),
            Column("printed", "printed"),
            Column("ours", "our denominator"),
        ),
        tuple(rows),
        wide=True,
    )


def _pole_table(result: RunResult, fit: dict[str, float]) -> Table:
    assert result.truth is not None
    (case,) = result.cases
    rows = [
        (symbol(o), words(printed_poles()[o]), words(case.model.poles()[o]), float(fit[o]))
        for o in ("theta", "q", "u", "h")
    ]
    known = ", ".join(f"{n} {words(np.array([s]))}" for n, s in result.truth.modes.items())
    return Table(
        "taurus_poles",
        "Poles of the four transfer functions",
        f"Printed: roots of the denominators of equations 6 to 9. The simulated aircraft has: {known}.",
        (
            Column("output", "output"),
            Column("printed", "printed poles"),
            Column("ours", "our poles"),
            Column("fit", "our fit, validation", "%", decimals=1),
        ),
        tuple(rows),
        wide=True,
    )


def peak_rad_s(period_s: float = DOUBLET_S) -> float:
    """Return where a doublet's energy spectrum peaks, rad/s."""
    signal = build((Doublet(signal="doublet", control="de", amplitude_deg=1.0, period_s=period_s),), 12.0, 100.0)
    omega = np.linspace(0.05, 20.0, 2000)
    return float(omega[np.argmax(signal.energy_spectrum(omega)[:, 0])])


def _inputs_plate(short_period: float) -> Plate:
    rate, duration = 100.0, 12.0
    signals: dict[str, Input] = {
        "doublet, 2 s": Doublet(signal="doublet", control="de", amplitude_deg=1.0, period_s=2.0, start_s=1.0),
        "3-2-1-1, 1 s": StandardMultistep(signal="3211", control="de", amplitude_deg=1.0, step_s=1.0, start_s=1.0),
    }
    omega = np.geomspace(0.1, 60.0, 600)
    time, spectra = [], []
    for k, (name, entry) in enumerate(signals.items()):
        signal = build((entry,), duration, rate)
        energy = signal.energy_spectrum(omega)[:, 0]
        time.append(line(signal.t_s, np.degrees(signal.u[:, 0]), name, k))
        spectra.append(line(omega, energy / energy.max(), name, k))
    named = ((short_period, "short period"), (_SAMPLING_LIMIT, "8 Hz"))
    marks = [Rule(at=at, text=text, dash=DOTTED) for at, text in named]
    return plate(
        "taurus_inputs",
        "Taurus figures 2 and 3: the inputs and their spectra",
        "Left: doublet and 3-2-1-1. Right: energy spectra, each over its own peak. The doublet of 2 s peaks at "
        f"{peak_rad_s():.1f} rad/s, the short period of the simulated aircraft lies at {short_period:.1f} rad/s. The "
        "paper's 3-2-1-1 has no printed step length; 1 s is assumed.",
        (
            Panel(title="inputs", x="t, s", y="Δδe, deg", draws=time),
            Panel(
                title="energy spectra", x="ω, rad/s", y="share of the peak", draws=[*spectra, *marks], log_x=True,
                log_y=True, x_range=(0.1, 60.0), y_range=(1e-4, 2.0),
            ),
        ),
    )  # fmt: skip


def _fit_plate(result: RunResult, fit: dict[str, float]) -> Plate:
    (case,) = result.cases
    record, predicted = case.validation[0], case.evaluation.validation.predictions[0]
    panels = []
    for name in ("theta", "h", "u", "q"):
        factor, unit = shown_unit(name)
        k = case.model.outputs.index(name)
        lines = (
            line(record.t_s, factor * record[name], "measured, prepared", "measured", width=2.2),
            line(record.t_s, factor * predicted[:, k], "four-pole model", 0),
        )
        title = f"{_FIGURE[name]}: fit {fit[name]:.1f} %"
        panels.append(Panel(title=title, x="t, s", y=f"Δ{symbol(name)}, {unit}", draws=lines))
    return plate(
        "taurus_fits",
        "Taurus figures 5 to 8: pitch angle, altitude, airspeed and pitch rate, validation",
        "The 30 % of the record that took no part in the identification, and what the models predict from the elevator "
        "alone, the initial state fitted.",
        panels,
        height_in=1.45,
    )
