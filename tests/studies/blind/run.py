"""Name what one blind case hides: records, believed model and suite go in, the answer does not."""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from clock import since
from studies.blind.flights import RATE_HZ, condition, suite

from testbench.core.errors import Refusal
from testbench.core.record import FlightRecord
from testbench.effects import Effect, library
from testbench.flight import load_aircraft
from testbench.flight.batch.jobs import Simulator
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.air import listen
from testbench.questions.gap.explain import Naming
from testbench.questions.gap.name import Sought
from testbench.questions.gap.parts import parts_of
from testbench.questions.gap.result import GapFinding
from testbench.questions.gap.workflow import search


def believe(aircraft: str, simulator: Simulator = "auto") -> Believed:
    """Return what is believed of an aircraft: rigid wings, the suite, the condition."""
    flown = load_aircraft(aircraft, "rigid")
    return Believed(flown, suite(), condition(aircraft), RATE_HZ, simulator=simulator)


def name_case(
    aircraft: str,
    records: Mapping[str, FlightRecord],
    held_out: Mapping[str, FlightRecord],
    without: Sequence[str] = (),
    simulator: Simulator = "auto",
    only: Sequence[str] = (),
) -> dict[str, Any]:
    """Return what the workflow says of the records of one case, as JSON values.

    Args:
        aircraft: which one is believed to fly.
        records: measured records, used to name.
        held_out: measured records, used to judge.
        without: effects to take out of the library, and with them those of which they are special cases.
        simulator: "jsbsim" flies nothing in batches.
        only: effects to search, in place of the whole library.
    """
    began = time.process_time()
    believed = believe(aircraft, simulator)
    naming_records = list(records.values())
    effects = {n: e for n, e in _without(believed, without).items() if not only or n in only}
    heard = listen(believed, naming_records)
    sought = Sought(effects, held_out=list(held_out.values()))
    _, naming, heard = search(believed, naming_records, heard, lambda stage: None, sought)
    return {
        **_row(naming),
        "turbulence_rms_m_s": heard.rms_m_s if heard.moves else 0.0,
        "removed": _removed(believed, naming, list(held_out.values())),
        "seconds": since(began),
    }


def _without(believed: Believed, out: Sequence[str]) -> dict[str, Effect]:
    """Return the library less some effects and those of which they are special cases."""
    gone = set(out)
    return {n: e for n, e in library(believed.suite).items() if n not in gone and gone.isdisjoint(e.contains)}


def _row(naming: Naming) -> dict[str, Any]:
    first = naming.best or next(iter(naming.ranking), None)
    second = next((f for f in naming.ranking if f is not first), None)
    return {
        "outcome": naming.outcome,
        "names": list(naming.names),
        "best": first.effect.name if first else "",
        "values": dict(first.values) if first else {},
        "errors": {k: float(v) for k, v in first.errors.items()} if first else {},
        "share": None if first is None or not np.isfinite(first.share) else first.share,
        "gain": first.gain if first else 0.0,
        "chi2_left": first.chi2 if first else naming.chi2_tuned,
        "runner_up": second.effect.name if second else "",
        "runner_up_gain": second.gain if second else 0.0,
        "runner_up_chi2": second.chi2 if second else naming.chi2_tuned,
        "chi2_believed": naming.chi2_believed,
        "chi2_tuned": naming.chi2_tuned,
        "samples": naming.samples,
        **probabilities(naming),
    }


def probabilities(naming: Naming) -> dict[str, Any]:
    """Return what is stated of a naming: of its names, of nothing, of something unknown, of the parts it calls."""
    weighed = naming.weighed
    called = [e for f in naming.ranking if f.effect.name in naming.names for e in f.effect.singles]
    return {
        "stated": [weighed[name] for name in naming.names],
        "nothing": weighed.nothing,
        "unknown": weighed.unknown,
        "credible": list(weighed.credible()),
        "part": weighed.part([p.name for p in parts_of(called)]),
        "kappa": 0.0 if naming.best is None else naming.best.kappa,
    }


def _removed(believed: Believed, naming: Naming, records: Sequence[FlightRecord]) -> float | None:
    """Return the share of the held-out excess over the noise that the amendment removes; None without a name.

    The excess is that of the believed model as it is, parameter errors included.
    """
    best = naming.best
    if best is None:
        return None
    amended = best.added_to(believed)
    energy = [sum(float(np.sum(m.residuals(r) ** 2 - 1.0)) for r in records) for m in (believed, amended)]
    return 1.0 - energy[1] / energy[0] if energy[0] > 0.0 else None


def found_row(find: Callable[[], GapFinding]) -> dict[str, Any]:
    """Return what the workflow says, as JSON values, and the processor time that it took."""
    began = time.process_time()
    try:
        found = find()
    except Refusal as error:
        return {"outcome": "failed", "names": [], "accused": [], "why": str(error)}
    naming = found.naming
    first = naming.best or next(iter(naming.ranking), None)
    return {
        "outcome": naming.outcome,
        "names": list(naming.names),
        "best": first.effect.name if first else "",
        "values": {k: float(v) for k, v in first.values.items()} if first else {},
        "gain": float(first.gain) if first else 0.0,
        "accused": [
            [n, float(f.nuisances[n]), float(f.spread[n]), [x for x in naming.names if x != f.effect.name]]
            for f in naming.coefficients
            for n in f.coefficients
        ],
        **probabilities(naming),
        "seconds": since(began),
    }
