"""The tables of a global model: held-out flights, terms with errors, and the flown domain."""

from __future__ import annotations

from testbench.core.constants import DEG_RAD, PERCENT
from testbench.page.tables import Column, Table, Value
from testbench.questions.global_model.result import GlobalFound

_ANGLES = ("alpha", "beta", "de", "da", "dr")


def held_table(found: GlobalFound) -> Table:
    """Return how each coefficient of the held-out flights follows its function."""
    rows: list[tuple[Value, ...]] = [
        (
            h.coefficient, len(found.model.functions[h.coefficient].terms) - 1, h.span,
            *(x / h.span / PERCENT for x in (h.fitted, h.missed, h.believed)), h.r2, h.inside / PERCENT,
        )
        for h in found.held
    ]  # fmt: skip
    caption = (
        "Root mean square of felt less function, noise of the instruments included, as a share of the range of the "
        "coefficient in the flights of the fit; zeros of accelerometers are taken out of all alike. Believed: the "
        f"same of {found.aircraft.name} as it was. R²: share of the energy about the mean that the function explains."
    )
    columns = (
        Column("coefficient", "coefficient"),
        Column("terms", "terms"),
        Column("range", "range"),
        Column("fitted", "fitted", "%", group="missed by", decimals=2),
        Column("held_out", "held out", "%", group="missed by", decimals=2),
        Column("believed", "believed, held out", "%", group="missed by", decimals=2),
        Column("r2", "R²", decimals=3),
        Column("inside", "in the domain", "%", decimals=0),
    )
    return Table("held_out", "Flights that were held out", caption, columns, tuple(rows))


def terms_table(found: GlobalFound) -> Table:
    """Return every term with its error, and how many fits without one flight chose it, too."""
    rows: list[tuple[Value, ...]] = [
        (f.name, t, p, s, sum(t in other.terms for other in f.others) or None)
        for f in found.model.functions.values()
        for t, p, s in zip(f.terms, f.params.tolist(), f.std.tolist(), strict=True)
    ]
    count = len(found.of_use("identification"))
    caption = (
        "Angles and deflections in rad, p b/2V, q c̄/2V, r b/2V; V_rel = V/"
        f"({found.V_ref_m_s:.4g} m/s) − 1; alpha_over_8deg = max(alpha − 8 deg, 0). Errors hold for these terms; "
        "those of the functions in the figures count the choice of terms as well. Again: in how many of the "
        f"{count} fits without one flight the term was chosen, too."
    )
    columns = (
        Column("coefficient", "coefficient"),
        Column("term", "term"),
        Column("value", "value", digits=4),
        Column("std", "± std", digits=2),
        Column("again", "again"),
    )
    return Table("terms", "The functions, term by term", caption, columns, tuple(rows))


def domain_table(found: GlobalFound) -> Table:
    """Return the range of every signal in each band of alpha."""
    domain = found.model.domain
    scale = [1.0 / DEG_RAD if s in _ANGLES else 1.0 for s in domain.signals]
    rows: list[tuple[Value, ...]] = []
    for k, a in enumerate(domain.alpha.tolist()):
        ends = [(domain.middle[k] + sign * domain.half[k]) * scale for sign in (-1.0, 1.0)]
        rows.append((a / DEG_RAD, *(f"{low:.3g} to {high:.3g}" for low, high in zip(*ends, strict=True))))
    caption = (
        "Flown range of each signal about that alpha (quantiles 0.01 to 0.99); deg, and without unit. A state is "
        "inside if each signal is in its range, and all together in the ellipsoid that holds 98 % of the samples. "
        "Beyond, the model does not answer."
    )
    unit = {s: "deg" if s in _ANGLES else "" for s in domain.signals}
    columns = (Column("alpha", "alpha", "deg", decimals=1), *(Column(s, s, unit[s]) for s in domain.signals))
    return Table("domain", "The flown domain", caption, columns, tuple(rows), wide=True)
