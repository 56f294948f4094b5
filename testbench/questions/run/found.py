"""What a run found as plain numbers by name, as campaigns store them and tidy tables show them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from testbench.line import Case
    from testbench.questions.run.result import RunResult


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
