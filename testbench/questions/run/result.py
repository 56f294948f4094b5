"""What a run finds: flights and their records, the truth beside them, and each case of suite and estimator."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import binom

from testbench.estimators.cells import FailedCell
from testbench.estimators.identification import estimator_name
from testbench.evaluation.modes import frequency_and_damping, frequency_of, roots_of
from testbench.evaluation.truth import Truth
from testbench.inputs.signal import energy_spectrum
from testbench.line import Case, Flight
from testbench.page.shown import Shown
from testbench.page.words import listed
from testbench.questions.run.scenario import Scenario
from testbench.questions.run.seeds import Repeats
from testbench.questions.run.seeds_answer import seeds_findings
from testbench.sensors import SensorSuite

if TYPE_CHECKING:
    from testbench.core.record import FlightRecord
    from testbench.questions.identify.scenario import RecordDescription


_WITHIN = 2.0  # standard errors
_SHARE = 0.9545  # of a normal distribution that lies within them
_SURPRISE = 0.05


@dataclass(frozen=True, eq=False)
class RunResult(Shown, page="testbench.questions.run.page:run_page"):
    """Everything a run found. ``table`` and ``findings`` are made from it; nothing is stored twice.

    ``questions`` are implausible values of recorded flights, in words. ``failed`` are the suites and
    estimators that gave no model. ``repeats`` has the errors over all seeds, if there are several.
    """

    name: str
    title: str
    question: str
    source: Scenario | RecordDescription
    seed: int
    flights: tuple[Flight, ...]
    cases: tuple[Case, ...]
    truth: Truth | None = None
    suites: tuple[SensorSuite, ...] = ()
    reference: Mapping[str, Any] = field(default_factory=dict)
    questions: tuple[str, ...] = ()
    failed: tuple[FailedCell, ...] = ()
    repeats: Repeats | None = None

    @cached_property
    def table(self) -> Any:
        """Pandas DataFrame, one row per suite, estimator, data set and output: MRSE and fit in percent."""
        import pandas as pd

        rows = [
            {
                "suite": c.suite,
                "estimator": estimator_name(c.estimator),
                "data": data,
                "output": o,
                "mrse_percent": m,
                "fit_percent": f,
            }
            for c in self.cases
            for data, scores in (
                ("identification", c.evaluation.identification),
                ("validation", c.evaluation.validation),
            )
            for o, m, f in zip(c.model.outputs, scores.mrse_percent, scores.fit_percent, strict=True)
        ]
        return pd.DataFrame(rows)

    @cached_property
    def findings(self) -> tuple[str, ...]:
        """The answer in a few sentences; the last are what is wrong or doubtful with each model, as advice."""
        out = [*self.questions]
        if self.repeats is None:
            out += alpha_findings(self.cases)
        else:
            out += seeds_findings(self.repeats, {s.name: s.channels for s in self.suites})
        out += error_findings(self.cases)
        if self.truth is not None:
            identification = next(f for f in self.flights if f.use != "validation")
            out += sampling_findings(self.cases, self.truth.modes, identification, self.source.preparation.lowpass_hz)
            out += [e.sentence for e in self.truth.excitation]
        for case in self.cases:
            out += [a.about(case.label) for a in case.advice if a.severity != "note"]
        return tuple(out)


def _damping(pole: complex) -> float:
    return -pole.real / abs(pole) if pole != 0.0 else math.nan


OF_MODES: tuple[tuple[str, Callable[[complex], float]], ...] = (("wn, rad/s", abs), ("zeta", _damping))


def found_of(result: RunResult) -> dict[str, Any]:
    """Return what a run found, a number that is not finite as None.

    ``figures``: case -> name -> number; ``poles``: case -> outputs -> [real, imaginary], rad/s, upper half plane;
    ``true``: name -> number, of the modes of the aircraft, if the truth is asked for; ``failed``: case -> why
    it gave no model, if one did.
    """
    out: dict[str, Any] = {"figures": {}, "poles": {}}
    if result.failed:
        out["failed"] = {cell.label: cell.reason for cell in result.failed}
    for case in result.cases:
        out["figures"][case.label] = {name: finite(value) for name, value in _figures(case).items()}
        out["poles"][case.label] = {
            outputs: [
                [p.real, p.imag] for p in sorted(poles[poles.imag >= 0.0].tolist(), key=lambda p: (abs(p), p.real))
            ]
            for outputs, poles in case.model.poles().items()
        }
    if result.truth is not None:
        modes = result.truth.modes.items()
        out["true"] = {f"{mode} {name}": finite(value(s)) for mode, s in modes for name, value in OF_MODES}
    return out


def finite(value: float | None) -> float | None:
    """Return a number, None if it is not finite."""
    return None if value is None or not math.isfinite(value) else float(value)


def _figures(case: Case) -> dict[str, float | None]:
    """Return the scalars of one case: prediction, modes and parameters, these with standard error and truth beside."""
    e = case.evaluation
    out: dict[str, float | None] = {"warning": float(case.model.status != "good")}
    for k, output in enumerate(case.model.outputs):
        out[f"validation MRSE of {output}, %"] = float(e.validation.mrse_percent[k])
        out[f"validation fit of {output}, %"] = float(e.validation.fit_percent[k])
    out["validation MRSE, %"] = e.validation.mrse_mean
    out["identification MRSE, %"] = e.identification.mrse_mean
    sets = len({match.outputs for match in e.poles})
    for match in e.poles:
        of = f" ({match.outputs})" if sets > 1 else ""
        for name, value in OF_MODES:
            out[f"{match.name}{of} {name}"] = None if match.found is None else value(match.found)
    for p in e.parameters:
        if p.free:
            out[p.name], out[f"{p.name}, std"] = p.value, p.std
            if p.true is not None:
                out[f"{p.name}, true"] = p.true
    return out


# --- what the estimates show ------------------------------------------------------------------------------------------


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
            f"of {len(judged)} methods {states} errors that agree with this flight: {listed([count[g] for g in good])} "
            "true values lie within two of them"
        )
    else:
        first = (
            f"none of {len(judged)} methods states correct errors; {name[best]} is the best, with {count[best]} true "
            "values within two standard errors"
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
            f"the poles of {', '.join(low)} are not the short period: they lie where input and filter have energy. The "
            f"fits on validation data nevertheless reach {np.max(fit):.0f} %: a good fit is no proof of a mode"
        )
    return out
