"""The page of a pooling: its tables, and every log's coefficients with the pooled ones."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np

from testbench.line import RECORDED
from testbench.page.figure import (
    BAND,
    COLOURS,
    DASHED,
    INK,
    INTERVAL,
    MEASURED,
    Curve,
    Drawn,
    Panel,
    Plate,
    Rule,
    Span,
    band,
    grid,
)
from testbench.page.page import COMPUTED, Page
from testbench.page.tables import Column, Table, Value
from testbench.page.words import counted
from testbench.pooling.pool import Pooled
from testbench.questions.identify.pool.answer import VARIABLES, pool_answer
from testbench.questions.identify.pool.ask import PooledFlights

if TYPE_CHECKING:
    from testbench.line import Flight


_MOST = 24  # coefficients drawn; more than that is for the table
_APART = 0.025  # of the range of the condition, between logs at one
_BESIDE = 0.08  # of the range of the condition, drawn on either side of the logs


def pool_page(flights: PooledFlights) -> Page:
    """Return the page: the answer, coefficients over the condition, tables, and pooled.json for a later prior."""
    found = flights.found
    aircraft = next((f.before.aircraft.name for f in found if f.before is not None), None)
    table = pooled_table(flights)
    return Page(
        kicker=f"Pooled from recorded flights: {', '.join(flights.names)}",
        title=f"Coefficients{f' of {aircraft}' if aircraft else ''} from {counted(len(found), 'log')}",
        question=(
            "What are the nondimensional derivatives of all logs together, and what did the logs add to the prior?"
        ),
        answer=pool_answer(flights),
        tables=pool_tables(flights),
        plates=pool_plates(flights),
        files={"pooled.json": json.dumps(flights.pooled.written(), indent=1) + "\n"},
        packages=COMPUTED,
        provenance=[
            (f"log {name}", ", ".join(dict.fromkeys(_record(flight) for flight in f.flights)))
            for name, f in zip(flights.names, found, strict=True)
        ],
        terminal=[table.without("logs", "own_std", "bits"), condition_table(flights).without("Ixx", "Iyy", "Izz")],
    )


def _record(flight: Flight) -> str:
    provenance = flight.measured[RECORDED].provenance
    return f"{provenance['file']} ({str(provenance['sha256'])[:12]})"


# --- tables -----------------------------------------------------------------------------------------------------------


def pool_tables(flights: PooledFlights) -> list[Table]:
    """Return the tables, that of the pooled coefficients first."""
    out = [pooled_table(flights), log_table(flights), condition_table(flights)]
    left = left_out_table(flights)
    return out if left is None else [*out, left]


def pooled_table(flights: PooledFlights) -> Table:
    """Return one row per coefficient: data, prior, both, and what the data added."""
    pooled = flights.pooled
    sloped, believed = bool(pooled.trend.names), pooled.prior is not None
    factor, unit = VARIABLES[pooled.trend.variable][1:] if sloped else (1.0, "")
    columns = [
        Column("coefficient", "coefficient"),
        Column("logs", "logs"),
        Column("data", "data", digits=4),
        Column("data_std", "± std", digits=2),
        Column("own_std", "own errors ±", digits=2),
        Column("between", "log to log", digits=2),
    ]
    scaled = bool(pooled.scale_uncertainty)
    if scaled:
        columns.append(Column("shared_std", "airspeed, mass, inertia ±", digits=2))
    if sloped:
        columns += [Column("slope", f"slope per {unit}", digits=3), Column("slope_std", "± std", digits=2)]
    if believed:
        columns += [
            Column("prior", "prior", digits=4),
            Column("prior_std", "± std", digits=2),
            Column("posterior", "both", digits=4),
            Column("posterior_std", "± std", digits=2),
            Column("added", "data added", "%", digits=3),
            Column("bits", "bits", decimals=1),
            Column("distance", "data − prior, std", decimals=1),
        ]
    rows: list[tuple[Value, ...]] = []
    for c in pooled.coefficients:
        row: list[Value] = [c.name, c.logs, c.value, c.std, c.own_std, c.between or None]
        row += [c.shared_std] if scaled else []
        if sloped:
            slope, std = (c.posterior_slope, c.posterior_slope_std) if believed else (c.slope, c.slope_std)
            row += [None if slope is None else slope / factor, None if std is None else std / factor]
        if believed:
            row += [c.prior, c.prior_std, c.posterior, c.posterior_std]
            row += [None if c.added is None else 100.0 * c.added, c.bits, c.distance]
        rows.append(tuple(row))
    return Table("pooled", "Pooled coefficients", _caption(flights), tuple(columns), tuple(rows))


def _caption(flights: PooledFlights) -> str:
    pooled = flights.pooled
    out = [
        "Nondimensional derivatives per rad, and per p b/2V, q c̄/2V, r b/2V; CX and CZ in stability axes: CZ_alpha = "
        f"−CL_alpha − CD. {_counted(pooled)} Own errors: from those of the logs alone; log to log: standard deviation "
        "that was added because logs disagree by more."
    ]
    if pooled.trend.names:
        word, factor, unit = VARIABLES[pooled.trend.variable]
        out.append(f"Values at the mean {word} of the logs, {pooled.trend.reference * factor:.4g} {unit}.")
    if pooled.prior is not None:
        out.append(
            f"Prior: {pooled.prior.source}. Both: information matrices of data and prior added. Data added: 1 − "
            "(variance of both)/(variance of the prior); bits: log2 of the factor by which the error shrank. A "
            "distance beyond 3 is a contradiction."
        )
    return " ".join(out)


def _counted(pooled: Pooled) -> str:
    stated = pooled.scale_uncertainty
    if not stated:
        return (
            "Errors of mass, inertia, geometry and airspeed are not included: the aircraft states none under "
            "[uncertainty]."
        )
    return (
        f"Errors include the stated uncertainty of {', '.join(f'{n} ({100.0 * s:.2g} %)' for n, s in stated.items())}, "
        "which all logs share; those of geometry are not included."
    )


def log_table(flights: PooledFlights) -> Table:
    """Return one row per coefficient and log: derivative, coefficient, and how far it lies from the pooled one."""
    pooled = flights.pooled
    columns = (
        Column("log", "log"),
        Column("derivative", "derivative"),
        Column("derivative_value", "value", digits=4),
        Column("derivative_std", "± std", digits=2),
        Column("coefficient", "coefficient"),
        Column("value", "value", digits=4),
        Column("std", "± std", digits=2),
        Column("pooled", "pooled", digits=4),
        Column("distance", "difference, std", decimals=1),
    )
    rows: list[tuple[Value, ...]] = []
    for part, found in zip(flights.contributions, flights.found, strict=True):
        log = part.coefficients
        for i, name in enumerate(log.names):
            derivative = part.derivative_of[name]
            own = next(d for d in found.derivatives if d.name == derivative)
            c, std = pooled.coefficient(name), float(log.covariance[i, i]) ** 0.5
            there = c.value
            if c.slope is not None:
                there += c.slope * (log.at[pooled.trend.variable] - pooled.trend.reference)
            y = float(log.values[i])
            rows.append((log.log, derivative, own.value, own.std, name, y, std, there, (y - there) / std))
    caption = (
        "Coefficients of every log by its own airspeed, dynamic pressure and mass. Pooled: the result of all logs at "
        "the condition of this one. Difference: in standard errors of the log alone."
    )
    return Table("logs", "Coefficients of every log", caption, columns, tuple(rows))


def condition_table(flights: PooledFlights) -> Table:
    """Return where every log was flown."""
    columns = (
        Column("log", "log"),
        Column("V", "airspeed", "m/s", digits=4),
        Column("qbar", "dynamic pressure", "Pa", digits=4),
        Column("alpha", "angle of attack", "deg", digits=3),
        Column("mass", "mass", "kg", digits=4),
        Column("Ixx", "Ixx", "kg m²", digits=3),
        Column("Iyy", "Iyy", "kg m²", digits=3),
        Column("Izz", "Izz", "kg m²", digits=3),
    )
    rows: list[tuple[Value, ...]] = []
    for name, found in zip(flights.names, flights.found, strict=True):
        f = found.flown
        assert f is not None
        alpha = None if f.alpha_rad is None else f.alpha_rad * VARIABLES["alpha"][1]
        rows.append((name, f.V_m_s, f.qbar_Pa, alpha, f.mass.mass_kg, f.mass.Ixx, f.mass.Iyy, f.mass.Izz))
    caption = "As recorded or given; mass and inertia given, else those of the aircraft."
    return Table("conditions", "Where the logs were flown", caption, columns, tuple(rows))


def left_out_table(flights: PooledFlights) -> Table | None:
    """Return what was identified and is not in the pool; None if that is nothing."""
    rows = tuple((part.coefficients.log, what, why) for part in flights.contributions for what, why in part.balance)
    if not rows:
        return None
    columns = (Column("log", "log"), Column("what", "what"), Column("why", "why"))
    return Table("left_out", "Identified, but not pooled", "", columns, rows)


# --- figures ----------------------------------------------------------------------------------------------------------


def pool_plates(flights: PooledFlights) -> list[Plate]:
    """Return one panel per coefficient, logs over the variable of the trend, or over speed."""
    pooled = flights.pooled
    variable = pooled.trend.variable or ("V" if all("V" in log.at for log in pooled.logs) else "qbar")
    shown = pooled.coefficients[:_MOST]
    believed = any(c.prior is not None for c in shown)
    both = "data and prior together" if believed else "pooled"
    wide_band = " The wide pale band is the prior." if believed else ""
    caption = (
        f"Bars: every log with its 95 % interval, over {VARIABLES[variable][0]}. "
        f"Line and band: {both}, 95 %.{wide_band} Logs at one condition are drawn side "
        "by side. A wide prior may reach beyond the vertical range."
    )
    panels = [_panel(flights, c.name, variable, "pooled with prior" if believed else "pooled") for c in shown]
    return [Plate("pooled", "Coefficients of every log, and pooled", caption, grid(panels, 3, share_x=True))]


def _panel(flights: PooledFlights, name: str, variable: str, said: str) -> Panel:
    pooled, (word, factor, unit) = flights.pooled, VARIABLES[variable]
    c, outlying = pooled.coefficient(name), pooled.disagreement.outlying if pooled.disagreement is not None else ""
    every = np.array([log.at[variable] for log in pooled.logs])
    reach = float(np.ptp(every)) or 0.2 * abs(float(every[0])) or 0.1
    beside, shifts = _BESIDE * reach, _shifts(flights, variable, _APART * reach)
    x = np.linspace(every.min() - beside, every.max() + beside, 41)
    value, std = np.array([pooled.at(name, v) if c.slope is not None else (c.posterior, c.posterior_std) for v in x]).T
    low, high = value - INTERVAL * std, value + INTERVAL * std
    seen, draws = [*low, *high], list[Drawn]()
    if c.prior is not None and c.prior_std is not None:
        wide = INTERVAL * c.prior_std
        draws += [Span(low=c.prior - wide, high=c.prior + wide, of="y", name="prior", colour=BAND),
                  Rule(at=c.prior, of="y", colour=MEASURED, dash=DASHED)]  # fmt: skip
        seen.append(c.prior)
    for log in pooled.logs:
        if name not in log.names:
            continue
        i = log.names.index(name)
        bar, y = INTERVAL * float(log.covariance[i, i]) ** 0.5, float(log.values[i])
        apart = outlying == log.log
        draws.append(
            Curve(x=[(log.at[variable] + shifts[log.log]) * factor], y=[y], y_error=bar, marker="o", size=4.0,
                  colour=COLOURS[1] if apart else INK, name=f"{outlying}, apart" if apart else "one log", order=4.0)
        )  # fmt: skip
        seen += [y - bar, y + bar]
    draws += [
        band(x * factor, low, high, COLOURS[0]), Curve(x=x * factor, y=value, colour=COLOURS[0], name=said, order=3.0)
    ]  # fmt: skip
    margin = 0.08 * (max(seen) - min(seen) or 1.0)
    return Panel(
        draws=draws, title=name, x=f"{word}, {unit}", x_range=(x[0] * factor, x[-1] * factor), tall_in=1.35,
        y_range=(min(seen) - margin, max(seen) + margin),
    )  # fmt: skip


def _shifts(flights: PooledFlights, variable: str, apart: float) -> dict[str, float]:
    """Return log -> by how much it is drawn beside its place, so that logs at one condition can be told apart."""
    out: dict[str, float] = {}
    near: list[tuple[float, str]] = []
    every = sorted((log.at[variable], log.log) for log in flights.pooled.logs)
    for place, name in [*every, (float("inf"), "")]:
        if near and place - near[-1][0] > apart:
            middle = 0.5 * (len(near) - 1)
            out |= {log: (k - middle) * apart for k, (_, log) in enumerate(near)}
            near = []
        near.append((place, name))
    return out
