"""The global model in sentences: what was found over which domain, how held-out flights follow it, what to doubt."""

from __future__ import annotations

from testbench.core.constants import DEG_RAD
from testbench.page.labels import number
from testbench.page.words import Line, counted, sentence
from testbench.questions.global_model.amend import BLEND
from testbench.questions.global_model.result import GlobalFound

_POOR = 0.5
"""Share of the energy of a coefficient below which a held-out flight does not follow its function; judged."""
_FEW_INSIDE = 0.8  # share of the held-out samples below which they judge little of the domain; judged
_SURE = 3.0  # standard errors that a zero of an accelerometer must be to be told


def global_answer(found: GlobalFound) -> list[Line]:
    """Return the answer, the most important sentence first."""
    domain, functions, old = found.model.domain, found.model.functions, found.aircraft.name
    alpha = f"{number(domain.low / DEG_RAD)} to {number(domain.high / DEG_RAD)} deg"
    fitted = counted(len(found.of_use("identification")), "flight")
    said = [("lead", f"{len(functions)} coefficients of {old} over alpha from {alpha}, from {fitted}")]
    if found.new is not None:
        said.append(
            (
                "finding",
                f"'{found.new[0].name}' has these functions inside the flown domain and the a-priori coefficients of "
                f"{old} beyond {1.0 + BLEND:g} times its size, with a linear transition",
            )
        )
    misses = ", ".join(f"{h.coefficient} {100.0 * h.missed / h.span:.1f} %" for h in found.held)
    names = ", ".join(f.name for f in found.of_use("validation"))
    said.append(("finding", f"held-out {names}: errors of {misses} of the range of each coefficient, noise included"))
    better = ", ".join(h.coefficient for h in found.held if h.missed < h.believed) or "none"
    said.append(("finding", f"the functions are nearer to them than the a-priori model in {better}"))
    said += [
        ("doubt", f"doubt: {h.coefficient} of held-out flights does not follow its function; fly more like them")
        for h in found.held
        if h.r2 < _POOR and h.missed > 2.0 * h.fitted
    ]
    inside = min(h.inside for h in found.held)
    if inside < _FEW_INSIDE:
        said.append(
            (
                "doubt",
                (
                    f"doubt: the held-out flights are a weak test: {100.0 * inside:.0f} % of their samples lie in the "
                    "flown domain"
                ),
            )
        )
    still = ", ".join(f.name for f in functions.values() if len(f.terms) == 1)
    if still:
        said.append(("doubt", f"doubt: these flights support no term of {still}; excite it"))
    zeros = ", ".join(
        f"{n} {number(c)} ± {number(s, 2)} m/s2"
        for f in functions.values()
        for n, (c, s) in f.apart.items()
        if abs(c) > _SURE * s
    )
    if zeros:
        said.append(
            ("note", f"left out of the functions, as no aerodynamic force: zeros of accelerometers or thrust, {zeros}")
        )
    if not found.instrument_std:
        said.append(
            ("note", "instruments are assumed to be exact; [instrument_std] of a description gives their errors")
        )
    said.append(
        (
            "note",
            "outside the flown domain the model gives no value; the domain is a box about each alpha, without the "
            "corners outside an ellipsoid",
        )
    )
    return [Line(kind, sentence(text)) for kind, text in (*said, *(("note", n) for n in found.notes))]
