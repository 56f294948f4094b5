"""The answer in words: what a sensor bought, and where fitted poles come from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import binom

from testbench.estimators.identification import estimator_name
from testbench.evaluation.modes import frequency_and_damping, frequency_of, roots_of
from testbench.inputs.signal import energy_spectrum
from testbench.page.words import listed

if TYPE_CHECKING:
    from testbench.core.record import FlightRecord


_WITHIN = 2.0  # standard errors
_SHARE = 0.9545  # of a normal distribution that lies within them
_SURPRISE = 0.05


def alpha_findings(cases: Sequence[Any]) -> list[str]:
    """Say what adding alpha bought, for every estimator that ran both with and without it.

    Only outputs that both suites sense are compared: a mean over different channels would compare unlike things.

    Args:
        cases: objects with ``suite``, ``estimator``, ``model`` and ``evaluation`` (:class:`testbench.line.Case`).
    """
    out = []
    for name in dict.fromkeys(estimator_name(c.estimator) for c in cases):
        same = [c for c in cases if estimator_name(c.estimator) == name]
        without = next((c for c in same if "alpha" not in c.model.outputs), None)
        with_alpha = next((c for c in same if "alpha" in c.model.outputs), None)
        if without is None or with_alpha is None:
            continue
        common = [o for o in without.model.outputs if o in with_alpha.model.outputs]
        before, after = (
            np.mean([c.evaluation.validation.mrse_percent[c.model.outputs.index(o)] for o in common])
            for c in (without, with_alpha)
        )
        shown = f"{before:.1f} %", f"{after:.1f} %"
        word = "leaves" if shown[0] == shown[1] else "lowers" if after < before else "raises"
        change = f"at {shown[1]}" if word == "leaves" else f"from {shown[0]} to {shown[1]}"
        new = {(m.name, m.outputs): m for m in with_alpha.evaluation.poles}
        wanted = roots_of({m.name: m.true for m in without.evaluation.poles}, "short period")
        pole = [
            f"; {_called(m.name)} is {_both(m.found, n.found)} (true {_pole(m.true)})"
            for m, n in ((m, _same_mode(m, new)) for m in without.evaluation.poles)
            if m.name in wanted and n is not None
        ]
        out.append(
            f"{name}: adding alpha {word} the mean validation MRSE over {', '.join(common)} {change}{''.join(pole)}"
        )
    return out


def error_findings(cases: Sequence[Any]) -> list[str]:
    """Say whose standard errors hold: of the estimates whose truth is known, how many lie within two of them.

    A method is believed if so few within would be no surprise: the chance of as few or fewer is 5 % or more, were the
    errors right and independent of each other. Nothing is said of a single method.

    Args:
        cases: :class:`testbench.line.Case` objects.
    """
    judged: dict[str, tuple[int, int]] = {}
    for case in cases:
        off = [p.deviations for p in case.evaluation.parameters if p.free and p.deviations is not None]
        if off:
            inside, of = judged.get(case.label, (0, 0))
            judged[case.label] = inside + sum(abs(d) <= _WITHIN for d in off), of + len(off)
    if len(judged) < 2:
        return []
    suites = {c.suite for c in cases}
    name = {c.label: c.label if len(suites) > 1 else estimator_name(c.estimator) for c in cases}
    good = [label for label, (inside, of) in judged.items() if binom.cdf(inside, of, _SHARE) >= _SURPRISE]
    best = max(judged, key=lambda label: judged[label][0] / judged[label][1])
    count = {label: f"{inside} of {of}" for label, (inside, of) in judged.items()}
    if good:
        states = f"only {name[good[0]]} states" if len(good) == 1 else f"{listed([name[g] for g in good])} state"
        first = (
            f"of {len(judged)} methods {states} errors that this "
            f"flight does not contradict: {listed([count[g] for g in good])} true values lie within two of them"
        )
    else:
        first = (
            f"none of {len(judged)} methods states errors that can be believed; {name[best]} comes nearest, with "
            f"{count[best]} true values within two standard errors"
        )
    told = ", ".join(f"{name[label]} {text}" for label, text in count.items())
    return [first, f"true values within two of the stated errors, where 95 % should be: {told}"]


def _same_mode(match: Any, others: Mapping[tuple[str, str], Any]) -> Any:
    """Return the match of the same mode among ``others``, of the same output where poles belong to single outputs."""
    if (match.name, match.outputs) in others:
        return others[match.name, match.outputs]
    joint = [m for (name, outputs), m in others.items() if name == match.name and ", " in outputs]
    return joint[0] if joint else None


def _called(mode: str) -> str:
    """Return "its short period", or "the slow root of its short period"."""
    name, _, root = mode.partition(", ")
    return f"the {root} of its {name}" if root else f"its {name}"


def _both(without: complex | None, with_alpha: complex | None) -> str:
    if without is None and with_alpha is None:
        return "not found, with or without alpha"
    return f"{_pole(without)} without alpha, {_pole(with_alpha)} with alpha"


def _pole(pole: complex | None) -> str:
    if pole is None:
        return "not found"
    if pole.imag == 0.0:
        return f"{pole.real:.2f} 1/s"
    wn, zeta = frequency_and_damping(pole)
    return f"wn {wn:.2f} rad/s, zeta {zeta:.2f}"


def sampling_findings(
    cases: Sequence[Any], modes: Mapping[str, complex], flight: Any, lowpass_hz: float | None
) -> list[str]:
    """Say whether poles fitted output by output belong to a true mode, or to the input, the filter or the sampling.

    Args:
        cases: :class:`testbench.line.Case` objects; only those of transfer functions count.
        modes: true poles by name.
        flight: the :class:`testbench.line.Flight` from which the models were identified.
        lowpass_hz: edge of the noise filter, if any.
    """
    case = next((c for c in cases if c.estimator.method == "transfer_function"), None)
    true = frequency_of(modes, "short period")
    if case is None or true is None:
        return []
    record: FlightRecord = next(iter(flight.measured.values()))
    control = case.model.inputs[0]
    nyquist = np.pi / record.dt_s
    omega = np.linspace(0.05, nyquist, 2000)
    u = record[control] - record[control][0]
    peak = omega[int(np.argmax(energy_spectrum(u, record.dt_s, omega)))]
    fast = {
        o: max((abs(p) for p in poles if p.imag > 1e-9), default=float("nan"))
        for o, poles in case.model.poles().items()
    }
    text = ", ".join(f"{o} {w:.1f}" for o, w in fast.items())
    edge = f", the noise filter ends at {2.0 * np.pi * lowpass_hz:.1f}" if lowpass_hz else ""
    out = [
        f"the fastest oscillatory poles of the outputs are, in rad/s: {text}; the true short period lies at "
        f"{true:.1f}, the input's spectrum peaks at {peak:.1f}{edge}, and the sampling limit is {nyquist:.1f}"
    ]
    fit = case.evaluation.validation.fit_percent
    slow = frequency_of(modes, "phugoid") or 0.0
    low = [o for o, w in fast.items() if 1.5 * slow < w < 0.5 * true]
    if low:
        out.append(
            f"the poles of {', '.join(low)} are not the short period: they lie where the input and the filter leave "
            f"energy. The fits on validation data reach {np.max(fit):.0f} % all the same: a good fit is no proof of a "
            "mode"
        )
    return out
