"""What a design promises and what its simulation realised, as a file beside the design: promises/NAME.json.

A flight plan that took the design over reads it after the flight. All errors are standard errors in SI units.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.door import read_json
from testbench.core.errors import RecordError
from testbench.core.record import FloatArray
from testbench.questions.design.answer import air_words
from testbench.questions.design.realise import Errors, Realised
from testbench.questions.files import promise_beside

if TYPE_CHECKING:
    from testbench.questions.design.result import DesignResult, Ranked

Modes = dict[str, complex | tuple[complex, complex]]


@dataclass(frozen=True, eq=False)
class Promise:
    """The promise of one design.

    Attributes:
        names: (t,) targets: parameters such as "M_q", and "wn of MODE", "zeta of MODE".
        values: (t,) of the believed aircraft.
        wanted: (t,) standard errors that were asked for; NaN where none was.
        promised: (t,) standard errors by information.
        modes: mode -> its believed pole, or its two real roots.
        V_m_s: true airspeed of the design.
        h_m: its height above sea level.
        air: in which it was flown in simulation, in words; "" if it was not.
        realised: over simulated flights; None if it was not computed.
    """

    names: tuple[str, ...]
    values: FloatArray
    wanted: FloatArray
    promised: FloatArray
    modes: Modes
    V_m_s: float
    h_m: float
    air: str = ""
    realised: Realised | None = None

    @property
    def headline(self) -> FloatArray:
        """(t,) the errors of one run to plan with: realised where they contradict the promised ones."""
        return self.promised if self.realised is None else self.realised.headline


def promise_of(result: DesignResult, entry: Ranked) -> Promise:
    """Return the promise of one of the designs of a result."""
    t = result.problem.targets
    return Promise(
        t.names,
        t.values,
        t.wanted,
        entry.design.errors,
        dict(t.modes),
        result.scenario.condition.V_m_s,
        result.scenario.condition.h_m,
        air_words(result) if entry.realised is not None else "",
        entry.realised,
    )


def promise_text(promise: Promise) -> str:
    """Return the text of the file; an error without bound, or that nobody wanted, is null."""
    r = promise.realised
    realised = None
    if r is not None:
        realised = {
            "errors": r.found.errors.tolist(),
            "stated": r.found.stated.tolist(),
            "failed": list(r.found.failed),
            "counts": r.differs.tolist(),
            "causes": [dict(c) for c in r.causes],
        }
    content = {
        "targets": list(promise.names),
        "believed": promise.values.tolist(),
        "wanted": _finite(promise.wanted),
        "promised": _finite(promise.promised),
        "modes": {name: [[z.real, z.imag] for z in _roots(pole)] for name, pole in promise.modes.items()},
        "V_m_s": promise.V_m_s,
        "h_m": promise.h_m,
        "air": promise.air,
        "realised": realised,
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def read_promise(design: Path) -> Promise | None:
    """Return the promise of a design's file ``designs/NAME.toml``; None if none lies beside it.

    Raises:
        RecordError: it is not as :func:`promise_text` writes it.
    """
    file = promise_beside(design)
    return None if file is None else promise_of_file(file)


def promise_of_file(file: Path) -> Promise:
    """Return the promise that a file ``promises/NAME.json`` holds.

    Raises:
        RecordError: it is not as :func:`promise_text` writes it, or cannot be read.
    """
    found = read_json(file, "promise")
    try:
        return _read(found)
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise RecordError(
            f"a promise must be as `testbench design` writes it, got '{file}' ({type(error).__name__}: {error}); "
            "design again, or remove it"
        ) from error


def _read(found: Mapping[str, Any]) -> Promise:
    names, realised = tuple(str(n) for n in found["targets"]), None
    t = len(names)
    values = _row(found["believed"], t)
    wanted = _row([np.nan if e is None else e for e in found["wanted"]], t)
    promised = _row([np.inf if e is None else e for e in found["promised"]], t)
    modes: Modes = {}
    for name, roots in found["modes"].items():
        poles = [complex(*root) for root in roots]
        modes[name] = (poles[0], poles[1]) if len(poles) == 2 else poles[0]
    if found["realised"] is not None:
        r = found["realised"]
        errors, stated = (np.array(r[key], float).reshape(-1, t) for key in ("errors", "stated"))
        counts = np.array(r["counts"], bool).reshape(t)
        realised = Realised(promised, Errors(errors, stated, tuple(r["failed"])), counts, tuple(r["causes"]))
    V_m_s, h_m = float(found["V_m_s"]), float(found["h_m"])
    return Promise(names, values, wanted, promised, modes, V_m_s, h_m, str(found["air"]), realised)


def _finite(values: FloatArray) -> list[float | None]:
    return [float(e) if np.isfinite(e) else None for e in values]


def _row(values: Any, t: int) -> FloatArray:
    return np.array(values, float).reshape(t)


def _roots(pole: complex | tuple[complex, complex]) -> tuple[complex, ...]:
    return pole if isinstance(pole, tuple) else (pole,)
