"""The page of a global model."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from testbench.page.page import FLOWN, Page
from testbench.questions.global_model.answer import global_answer
from testbench.questions.global_model.figures import global_plates
from testbench.questions.global_model.tables import domain_table, held_table, terms_table

if TYPE_CHECKING:
    from testbench.questions.global_model.result import GlobalFound


def global_page(found: GlobalFound) -> Page:
    """Return the page: the answer, functions over alpha, held-out flights, terms, the flown domain; and model.json."""
    closing = []
    if found.new is not None:
        folder = found.new[1]
        closing = [("Aircraft", str(folder)), ("Next", f"testbench check {folder}")]
    held = held_table(found)
    return Page(
        kicker=f"Global model: {found.aircraft.name}",
        title=found.aircraft.title,
        question="What are the coefficients over all that was flown?",
        answer=global_answer(found),
        tables=[held, terms_table(found), domain_table(found)],
        plates=global_plates(found),
        asked=[
            (
                "flights",
                ", ".join(f"{f.name}{'' if f.use == 'identification' else ' (held out)'}" for f in found.flights),
            ),
            ("filter", f"all channels to {found.cutoff_hz:.3g} Hz"),
            ("instruments", ", ".join(f"{n} {s:.2g}" for n, s in found.instrument_std.items()) or "taken as they read"),
        ],
        files={"model.json": json.dumps(_plain(found), indent=1) + "\n"},
        packages=FLOWN,
        terminal=[held],
        closing=closing,
    )


def _plain(found: GlobalFound) -> dict[str, object]:
    """Return functions and domain as JSON values."""
    domain = found.model.domain
    return {
        "aircraft": found.aircraft.name,
        "V_ref_m_s": found.V_ref_m_s,
        "hinges_rad": {n: knot for f in found.model.functions.values() for n, knot in f.hinges.items()},
        "functions": {
            f.name: {"terms": f.terms, "params": f.params.tolist(), "covariance": f.covariance.tolist()}
            for f in found.model.functions.values()
        },
        "domain": {
            "alpha_rad": [domain.low, domain.high],
            "at_alpha_rad": domain.alpha.tolist(),
            "signals": domain.signals,
            "middle": domain.middle.tolist(),
            "half": domain.half.tolist(),
            "radius": domain.radius.tolist(),
        },
    }
