"""The page of a global model: held-out flights, terms, the domain that was flown, functions over alpha."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np

from testbench.core.constants import DEG_RAD, PERCENT
from testbench.page.figure import COLOURS, INTERVAL, MEASURED, Curve, Drawn, Panel, Plate, band, grid
from testbench.page.page import FLOWN, Page
from testbench.page.tables import Column, Table, Value
from testbench.questions.global_model.answer import global_answer
from testbench.questions.global_model.result import GlobalFound

if TYPE_CHECKING:
    from testbench.core.record import FloatArray

_SLOPES = (
    ("CL", "alpha"), ("CL", "de"), ("Cm", "alpha"), ("Cm", "q_hat"), ("Cm", "de"), ("CY", "beta"), ("Cl", "beta"),
    ("Cn", "beta"), ("Cl", "p_hat"), ("Cl", "da"), ("Cn", "r_hat"), ("Cn", "dr"),
)  # fmt: skip
_POINTS = 600  # drawn of what was felt
_STEP = 0.5  # of the half range of a signal, to either side, over which a slope is taken
_ALPHA_STEP = 1.0 * DEG_RAD
_LEAST_SHARE = 0.2  # of a slope, that its panel spans at least
_KEPT = ("V_rel", "de")  # signals of trim, which go with alpha; the others are zero in the figures
_ANGLES = ("alpha", "beta", "de", "da", "dr")


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
        question="What are the coefficients over the flown envelope?",
        answer=global_answer(found),
        tables=[held, terms_table(found), domain_table(found)],
        plates=global_plates(found),
        asked=[
            (
                "flights",
                ", ".join(f"{f.name}{'' if f.use == 'identification' else ' (held out)'}" for f in found.flights),
            ),
            ("filter", f"all channels to {found.cutoff_hz:.3g} Hz"),
            ("instruments", ", ".join(f"{n} {s:.2g}" for n, s in found.instrument_std.items()) or "assumed exact"),
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


# --- tables -----------------------------------------------------------------------------------------------------------


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
        "Root mean square of measured less modelled coefficient, noise of the instruments included, as a share of the "
        "range of the coefficient in the flights of the fit; zeros of accelerometers are removed from all. A priori: "
        f"the same for {found.aircraft.name} before. R²: share of the energy about the mean that the function "
        "explains."
    )
    columns = (
        Column("coefficient", "coefficient"),
        Column("terms", "terms"),
        Column("range", "range"),
        Column("fitted", "fitted", "%", group="missed by", decimals=2),
        Column("held_out", "held out", "%", group="missed by", decimals=2),
        Column("believed", "a priori, held out", "%", group="missed by", decimals=2),
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
        f"Angles and deflections in rad, p b/2V, q c̄/2V, r b/2V; V_rel = V/({found.V_ref_m_s:.4g} m/s) − 1; "
        "alpha_over_8deg = max(alpha − 8 deg, 0). Errors hold for these terms; those of the functions in the figures "
        f"count the choice of terms as well. Chosen again: in how many of the {count} fits without one flight the term "
        "was also chosen."
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
        "Outside, the model gives no value."
    )
    unit = {s: "deg" if s in _ANGLES else "" for s in domain.signals}
    columns = (Column("alpha", "alpha", "deg", decimals=1), *(Column(s, s, unit[s]) for s in domain.signals))
    return Table("domain", "The flown domain", caption, columns, tuple(rows), wide=True)


# --- figures ----------------------------------------------------------------------------------------------------------


def global_plates(found: GlobalFound) -> list[Plate]:
    """Return the coefficients over alpha, and their slopes over alpha."""
    domain, functions = found.model.domain, found.model.functions
    alpha = np.linspace(domain.low, domain.high, 61)
    at = {"alpha": alpha} | {
        s: np.interp(alpha, domain.alpha, domain.middle[:, i]) * (s in _KEPT) for i, s in enumerate(domain.signals)
    }
    flights = [f.signals for f in found.of_use("identification")]
    flown = np.concatenate([f["alpha"] for f in flights]) / DEG_RAD
    some = slice(None, None, max(1, flown.size // _POINTS))
    values, slopes = list[Panel](), list[Panel]()
    for c, f in functions.items():
        felt = np.concatenate([s[c] - f.beside(s) for s in flights])
        points = Curve(x=flown[some], y=felt[some], name="felt", colour=MEASURED, marker=".", size=2.5)
        values.append(_panel(c, alpha, *f.at(at), points))
    for c, s in _SLOPES:
        if s != "alpha" and s not in domain.signals:
            continue
        half = np.full_like(alpha, _ALPHA_STEP)
        if s != "alpha":
            half = _STEP * np.interp(alpha, domain.alpha, domain.half[:, domain.signals.index(s)])
        change, std = functions[c].at({**at, s: at[s] + half}, {**at, s: at[s] - half})
        slopes.append(_panel(f"{c} by {s}", alpha, change / (2.0 * half), std / (2.0 * half)))
    middle = "with the V and de of the middle of the flown domain at that alpha; all other signals are zero"
    return [
        Plate(
            "functions",
            "Coefficients over the angle of attack",
            "Points: coefficients measured in the flights of the fit, at all deflections, rates and sideslips. Line "
            f"and band: the function and its 95 % interval {middle}.",
            grid(values, 3),
        ),
        Plate(
            "slopes",
            "Derivatives over the angle of attack",
            "Differences of the functions across half of the flown range of one signal (of alpha, 2 deg), per rad or "
            f"per nondimensional rate, with 95 % intervals, {middle}.",
            grid(slopes, 3),
        ),
    ]


def _panel(title: str, alpha: FloatArray, value: FloatArray, std: FloatArray, *behind: Drawn) -> Panel:
    x, half = alpha / DEG_RAD, INTERVAL * std
    line = Curve(x=x, y=value, colour=COLOURS[0], width=1.4, name="function, 95 %")
    drawn = [*(c.y for c in behind if isinstance(c, Curve)), value - half, value + half]
    low, high = float(min(map(np.min, drawn))), float(max(map(np.max, drawn)))
    room = 0.05 * (high - low) + max(0.0, _LEAST_SHARE * max(abs(low), abs(high)) - (high - low)) / 2.0
    return Panel(
        draws=[*behind, band(x, value - half, value + half, COLOURS[0]), line], title=title, x="alpha, deg",
        y_range=(low - room, high + room),
    )  # fmt: skip
