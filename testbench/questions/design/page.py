"""The page of a designed input, its tables and figures; scenarios and signals ready to fly lie beside it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.design.realise import FALSE_ALARM, INTERVAL, TRUST
from testbench.page import figure as fig
from testbench.page.labels import axis_label, number, shown_unit, symbol
from testbench.page.page import Page, source_of
from testbench.page.tables import Column, Table, Value
from testbench.page.words import counted
from testbench.questions.design.answer import (
    air_words,
    design_sentences,
    family_label,
    is_ratio,
    limit_rows,
    peak_words,
)
from testbench.questions.design.ready import ready_to_fly

if TYPE_CHECKING:
    from testbench.core.record import FloatArray
    from testbench.design.amplitude import Flown
    from testbench.design.problem import Problem
    from testbench.questions.design.known import AllKnown, Known
    from testbench.questions.design.result import DesignResult
    from testbench.questions.design.scenario import DesignScenario


_COMPARED = 5
_DECADES = 6
_LIMITED = 4  # limited channels that are drawn: those that use up most of their limit
_BINS, _PER_BIN = 240, 10  # of a spectrum: means over narrow bands, which long inputs would fill with lines else
_BAR = 0.13  # height of a bar, in
_DRAWN = "over drawn aircraft"
_MOST_COLUMNS = 5  # targets beyond which a terminal shows the criterion alone


def design_page(result: DesignResult) -> Page:
    """Return the page of a design: what to fly, the ranking, and what prevents more accuracy."""
    scenario, ready = result.scenario, ready_to_fly(result)
    ranking, *others = design_tables(result)
    known = next((t for t in others if t.name == "known"), None)
    estimated = ", ".join(result.problem.experiment.structure.parameter_names)
    return Page(
        kicker=f"Input design: {result.name}",
        title=scenario.title,
        question=scenario.question,
        answer=design_sentences(result),
        tables=others,
        more_tables=[ranking],
        plates=design_plates(result),
        files=ready,
        template="questions/design/page.html.j2",
        context={"ranking": ranking, "ready": [path for path in ready if path.startswith("designs/")]},
        asked=[
            ("aircraft", result.aircraft.title),
            ("condition", f"{scenario.condition.V_m_s:g} m/s at {scenario.condition.h_m:g} m"),
            ("sensors", result.ensemble.range_.suite.title),
            ("flown by", f"{scenario.by}, steps of {scenario.shortest_s:g} s or longer"),
            ("time", f"{scenario.duration_s:g} s, the first {scenario.start_s:g} s undisturbed"),
            *([("flown before", result.known.prior.source)] if result.known is not None else []),
            *([("uncertainty", _drawn_words(result))] if result.draws is not None else []),
            ("air", air_words(result)),
            ("limits", "; ".join(limit_rows(result))),
            ("estimated", f"{estimated}; all other parameters are assumed known"),
        ],
        flown=result.tally,
        provenance=[("seed", str(scenario.seed))],
        source=source_of(scenario),
        terminal=[
            *([known.without("model", "value")] if known is not None else []),
            short_ranking(result),
            *([short_realised(result)] if result.best.realised else []),
        ],
        closing=[("Ready to fly", "testbench run {}/designs/1_*.toml")],
    )


def nothing_page(scenario: DesignScenario, found: AllKnown) -> Page:
    """Return the page of a design that needs no flight: what was flown before tells every target."""
    table = known_table(found.problem, found.known)
    return Page(
        kicker=f"Input design: {scenario.name}",
        title=scenario.title,
        question=scenario.question,
        answer=[
            f"Nothing has to be flown: every wanted accuracy is reached by {found.known.prior.source}",
            *found.known.notes,
        ],
        tables=[table],
        source=source_of(scenario),
        terminal=[table],
    )


def _drawn_words(result: DesignResult) -> str:
    """Return what was drawn, and what it decides."""
    assert result.draws is not None
    who = f"uncertainty of {result.aircraft.name}" if result.aircraft.uncertainty else "accuracy of handbooks"
    chosen = "the worst of them" if result.scenario.robust else "the a-priori model"
    return (
        f"{counted(result.draws.asked, 'aircraft', 'aircraft')} drawn with the stated {who}; input and amplitude are "
        f"chosen for {chosen}"
    )


# --- tables -----------------------------------------------------------------------------------------------------------


def design_tables(result: DesignResult) -> list[Table]:
    """Return the ranking, the errors over drawn aircraft, the energy in the modes, the screening, and the obstacles."""
    out = [
        ranking_table(result),
        known_table(result.problem, result.known, result.total(result.best), result.best.errors),
        realised_table(result),
        elsewhere_table(result),
        draws_table(result),
        energy_table(result),
        screening_table(result),
        obstacle_table(result),
    ]
    return [t for t in out if t.rows]


def _columns(group: str = "", digits: int = 3, **heads: str) -> list[Column]:
    """Return columns by key and head."""
    return [Column(key, head, "", group, digits=digits) for key, head in heads.items()]


def _errors(name: str, value: float, *errors: float) -> tuple[str, str, list[float | None]]:
    """Return a target, the unit of its errors and the errors in it: percent of the value but for damping ratios."""
    factor = 100.0 / abs(value) if is_ratio(name) else 1.0
    return name, "%" if is_ratio(name) else "", [float(factor * e) if np.isfinite(e) else None for e in errors]


def ranking_table(result: DesignResult) -> Table:
    """Return every design flown, best first, with predicted standard errors and the limit that binds."""
    t, drawn = result.problem.targets, result.best.over is not None
    columns = [
        Column("rank", "", given=True),
        *_columns(signal="signal", quantities="free quantities", peak="peak command"),
        Column("end", "input ends", "s", decimals=2),
        Column("record", "record ends", "s", decimals=2),
        Column("worst", "criterion", "", digits=3),
    ]
    if drawn:
        columns += [Column("median", "median", "", _DRAWN), Column("worst of draws", "worst", "", _DRAWN)]
    for name, value, wanted in zip(t.names, t.values, t.wanted, strict=True):
        _, unit, (shown,) = _errors(name, value, wanted)
        words = f"{unit} (wanted {shown:.3g})".lstrip()
        columns.append(Column(f"error of {name}", name, words, "predicted standard errors", digits=2))
    columns += [Column("limit", "limit met", "", "flown"), Column("share", "used", "%", "flown", decimals=0)]
    columns += [Column("note", "at the linear prediction's amplitude", "", "flown")]
    entries = [(str(rank), entry) for rank, entry in enumerate(result.ranking, 1)]
    entries += [("shortest", result.shortest)] if result.shortest is not None else []
    entries += [("rejected", flown) for flown in result.rejected]
    rows: list[tuple[Value, ...]] = []
    for rank, f in entries:
        d = f.design
        head = (rank, family_label(d.family), d.words, peak_words(d), d.end_s, d.duration_s, float(d.cost))
        costs: tuple[Value, ...] = (f.over.rank[::-1] if f.over else (None, None)) if drawn else ()
        each = zip(t.names, t.values, d.errors, strict=True)
        errors = [float(100.0 * e / abs(v)) if is_ratio(n) else float(e) for n, v, e in each]
        limit = limit_symbol(f.tightest.name), 100.0 * f.tightest.share, f.breach or "all limits kept"
        rows.append((*head, *costs, *errors, *limit))
    counted = "" if result.known is None else ", with the previous flights; the errors are those of the flight alone"
    caption = (
        "Each design has its largest admissible amplitude in the nonlinear simulator. Criterion "
        f"{result.scenario.criterion}, in units of the wanted errors{counted}: at 1 or less they are reached. Standard "
        "errors are Cramér-Rao bounds for these sensors in the air that is expected; sensor offsets, initial states "
        "of a rigid aircraft and all other free parameters are estimated too. Realised errors are in a separate "
        "table."
    )
    if drawn:
        caption += " Median and worst: the criterion of the same commands over the drawn aircraft" + (
            "; the designs are ranked by the worst." if result.scenario.robust else "."
        )
    return Table("ranking", "Designs, ranked", caption, tuple(columns), tuple(rows), wide=True)


def known_table(
    problem: Problem, known: Known | None, after: FloatArray | None = None, alone: FloatArray | None = None
) -> Table:
    """Return per target what is known now and after the recommended flight; without earlier flights no rows.

    Args:
        problem: of the design.
        known: by earlier flights.
        after: (t,) errors after the flight of the recommended input; None: nothing is to be flown.
        alone: (t,) errors of that flight alone.
    """
    t, flown = problem.targets, [] if after is None or alone is None else [alone, after]
    columns = _columns(target="target", unit="unit", model="value of the model", value="value now")
    columns += _columns(digits=2, wanted="wanted error", now="known now")
    columns += _columns(digits=2, alone="this flight alone", after="after this flight") if flown else []
    rows: list[tuple[Value, ...]] = []
    for k, name in enumerate(t.names if known is not None else ()):
        assert known is not None
        _, unit, cells = _errors(name, t.values[k], *(e[k] for e in (t.wanted, known.errors, *flown)))
        met = "met after this flight" if flown and flown[1][k] <= t.wanted[k] else "not met"
        met = "met" if known.errors[k] <= t.wanted[k] else met
        model = float(known.before[k]) if np.isfinite(known.before[k]) else None
        rows.append((name, unit, model, float(t.values[k]), *cells, met))
    caption = (
        "Standard errors by all flights before, by this flight alone (realised where it was realised), and by both "
        "together. The input is designed at the present estimates: those of the flights, and of the model where the "
        "flights give little information."
    )
    columns += _columns(verdict="verdict")
    return Table("known", "Known now, promised after this flight", caption, tuple(columns), tuple(rows))


def draws_table(result: DesignResult) -> Table:
    """Return the errors of the recommended input over the drawn aircraft; without draws a table without rows."""
    t, over = result.problem.targets, result.best.over
    columns = _columns(target="target", unit="unit") + _columns(digits=2, wanted="wanted", believed="believed aircraft")
    columns += _columns(_DRAWN, 2, median="median", worst="worst") + _columns(
        _DRAWN, reached="reach it", have="have it"
    )
    rows: list[tuple[Value, ...]] = []
    kinds = [t.wanted, result.best.design.errors]
    kinds += [over.told.over(how) * t.wanted for how in (np.median, np.max)] if over is not None else []
    for k, name in enumerate(t.names if over is not None else ()):
        assert over is not None
        name, unit, cells = _errors(name, t.values[k], *(e[k] for e in kinds))
        ratios = over.told.ratios[:, k]
        rows.append((name, unit, *cells, int(np.sum(ratios <= 1.0)), int(np.sum(~np.isnan(ratios)))))
    n = 0 if over is None else len(over.told.costs)
    caption = (
        f"Predicted standard errors of the recommended input over {n} aircraft whose coefficients are drawn, "
        f"independently, with the stated uncertainty of {result.aircraft.name}. Every one is trimmed and linearised "
        "anew. Errors in percent are relative to the values of the a-priori model. A mode that has split into two real "
        "roots keeps wn = sqrt(s1 s2) and zeta = -(s1 + s2) / (2 wn). No prior is included: output error has none."
    )
    return Table("draws", "Over the aircraft's own uncertainty", caption, tuple(columns), tuple(rows))


def realised_table(result: DesignResult) -> Table:
    """Return promised against realised errors of the designs that were flown and identified; else no rows."""
    t = result.problem.targets
    columns = _columns(signal="signal", target="target", unit="unit")
    columns += _columns(digits=2, wanted="wanted", promised="promised")
    columns += _columns("realised", 2, realised="rms", low="from", high="to", bias="mean")
    columns += _columns(digits=2, stated="stated by the estimator")
    columns += _columns(flights="estimates", failed="none", counts="counts")
    columns += _columns(digits=2, headline="to plan with") + _columns(cause="most of it")
    rows: list[tuple[Value, ...]] = []
    for entry in result.ranking:
        if (r := entry.realised) is None:
            continue
        found, label = r.found, family_label(entry.design.family)
        kinds = (t.wanted, r.promised, found.rms, *found.interval(), found.bias, found.claimed, r.headline)
        for k, name in enumerate(t.names):
            _, unit, (*cells, head) = _errors(name, t.values[k], *(e[k] for e in kinds))
            counts = "realised" if r.differs[k] else "both"
            rows.append((label, name, unit, *cells, found.n, len(found.failed), counts, head, r.cause(k)))
    caption = (
        f"Flown in {air_words(result)}, sensed by the suite and identified by the estimator of the scenario. Promised: "
        "by information in that air, and the bias of the estimates without noise. The interval holds "
        f"{100 * INTERVAL:g} % for normal errors. Realised errors are used if they contradict the promise: chi-square, "
        f"probability of a false alarm {100 * FALSE_ALARM:g} % per design. Otherwise both are combined, the promise "
        f"with the weight of {TRUST} flights."
    )
    return Table("realised", "Promised and realised", caption, tuple(columns), tuple(rows), wide=True)


def short_realised(result: DesignResult) -> Table:
    """Return what a terminal shows of what was realised: units beside the targets, failures where there are any."""
    whole = realised_table(result)
    keys = [c.key for c in whole.columns]
    target, unit, failed = map(keys.index, ("target", "unit", "failed"))
    rows = []
    for row in whole.rows:
        named = f"{row[target]}, {row[unit]}" if row[unit] else row[target]
        rows.append((*row[:target], named, *row[target + 1 :]))
    none = () if any(row[failed] for row in whole.rows) else ("failed",)
    return replace(whole, rows=tuple(rows)).without("wanted", "low", "high", "unit", "counts", *none)


def elsewhere_table(result: DesignResult) -> Table:
    """Return the errors of the recommended input where the aircraft's fast mode lies elsewhere; else no rows."""
    columns = _columns(aircraft="aircraft", target="target", unit="unit", value="true value")
    columns += _columns(digits=2, predicted="predicted", realised="realised rms", bias="realised mean")
    columns += [*_columns(flights="estimates", limit="limit met"), Column("used", "used", "%", decimals=0)]
    rows: list[tuple[Value, ...]] = []
    for e in result.elsewhere:
        if e.found is None or e.values is None or e.predicted is None or e.flight is None:
            continue
        limit = limit_symbol(e.flight.tightest.name), 100.0 * e.flight.tightest.share
        for k, name in enumerate(result.problem.targets.names):
            _, unit, cells = _errors(name, e.values[k], e.predicted[k], e.found.rms[k], e.found.bias[k])
            rows.append((e.what, name, unit, float(e.values[k]), *cells, e.found.n, *limit))
    caption = (
        "The commands of the recommended input with an aircraft other than the a-priori model; the estimator is that "
        "of the scenario, with the parameters that it does not estimate at a-priori values. Limits are those of one "
        "flight in still air."
    )
    return Table("elsewhere", "If the fast mode lies elsewhere", caption, tuple(columns), tuple(rows), wide=True)


def limit_symbol(name: str) -> str:
    """Return a limit's name with the symbol of its channel."""
    for kind in ("rate of ", "command of "):
        if name.startswith(kind):
            return kind + symbol(name.removeprefix(kind))
    return "load factor" if name == "az" else symbol(name) if name else "aborted"


def energy_table(result: DesignResult) -> Table:
    """Return for each design and mode the share of its energy and the signal-to-noise ratio at the best sensor."""
    energies = [result.energy(entry.design) for entry in result.ranking]
    modes = energies[0].modes
    columns = [
        Column("rank", "", given=True),
        Column("signal", "signal"),
        Column("below", "95 % of energy below", "rad/s"),
    ]
    for m in modes:
        wn = number(abs(result.modes[m]))
        columns.append(Column(f"share {m}", "share", "%", f"{m}, {wn} rad/s", digits=2))
        columns.append(Column(f"snr {m}", "best sensor", "", f"{m}, {wn} rad/s"))
    rows = []
    for rank, (entry, e) in enumerate(zip(result.ranking, energies, strict=True), 1):
        cells: list[Value] = []
        for i, m in enumerate(modes):
            sensor, snr = e.seen(m)
            cells += [100.0 * float(e.share[i]), f"{symbol(sensor)} {snr:+.0f} dB".replace("-", "−")]
        rows.append((str(rank), family_label(entry.design.family), float(np.nanmax(e.below_95)), *cells))
    caption = (
        "Share of the input's energy in each mode's half-power band, and the mode's own response there over the noise "
        "of the sensor that shows it best. Above 10 dB a mode counts as excited."
    )
    return Table("energy", "Spectral energy", caption, tuple(columns), tuple(rows), wide=True)


def screening_table(result: DesignResult) -> Table:
    """Return how each family did in the screening."""
    columns = (
        Column("family", "family", get=lambda x: family_label(x[0])),
        Column("candidates", "candidates", get=lambda x: x[1][0]),
        Column("cost", "lowest criterion", digits=3, get=lambda x: x[1][1]),
        Column("snr", "worst mode of interest, best candidate", "dB", decimals=0, get=lambda x: x[1][2]),
    )
    caption = (
        f"{result.screened[0]} candidates over the free quantities of every family, each at the largest amplitude that "
        "the linearised aircraft allows. They are judged by their spectral energy at the sensors, and by information."
    )
    return Table.of("screening", "Screening", caption, columns, result.families.items())


def obstacle_table(result: DesignResult) -> Table:
    """Return what the best design would reach without one sensor's noise, or without the limit that binds."""
    now = result.best.design.cost
    columns = (
        Column("what", "what if", get=lambda o: f"without {o.words}"),
        Column("cost", "criterion", digits=3),
        Column("share", "of its value", "%", digits=2, get=lambda o: 100.0 * o.cost / now),
    )
    caption = (
        "The same input with one obstacle removed: either one sensor has a hundredth of its noise, or the binding "
        "limit is omitted."
    )
    title = "Obstacles to a smaller error"
    return Table.of("obstacles", title, caption, columns, result.obstacles.tried)


def short_ranking(result: DesignResult) -> Table:
    """Return the ranking as a terminal shows it: without the free quantities and errors where there are many."""
    table = ranking_table(result).without("record", "note")
    if len(result.problem.targets.names) <= _MOST_COLUMNS:
        return table
    return table.without("quantities", *(c.key for c in table.columns if c.key.startswith("error of ")))


# --- figures ----------------------------------------------------------------------------------------------------------


def design_plates(result: DesignResult) -> list[fig.Plate]:
    """Return the figures of a design, that of the answer first."""
    return [_flight_plate(result), _spectrum_plate(result), _error_plate(result)]


def compared(result: DesignResult) -> list[Flown]:
    """Return the designs drawn side by side: the best few, and single doublet and 3-2-1-1 whatever their rank."""
    out = [r for k, r in enumerate(result.ranking) if k < _COMPARED - 2 or r.design.family in ("doublet", "3211")]
    return out[:_COMPARED]


# --- the winner in flight ---------------------------------------------------------------------------------------------


def _flight_plate(result: DesignResult) -> fig.Plate:
    best = result.best
    record, design = best.record, best.design
    used = {n: _used(result, n) for n in result.envelope.bands if n not in design.controls and n in record}
    limited = sorted(used, key=lambda n: -used[n])[:_LIMITED]
    lateral = result.scenario.plane == "lateral"
    extra = [n for n in (("p", "r") if lateral else ("q",)) if n in record]
    panels = [_channel(result, name) for name in (*design.controls, *extra, *limited)]
    near = any(isinstance(drawn, fig.Rule) for panel in panels for drawn in panel.draws)
    caption = (
        "The recommended input as the nonlinear simulator flies it at its largest admissible amplitude: command, "
        f"motion of the surface, and the channels that come nearest to their limits{' (dashed)' if near else ''}. The "
        "dot marks where a limit is used up most."
    )
    title = f"The recommended input in flight: {family_label(design.family)}"
    return fig.Plate("flight", title, caption, fig.grid(panels, 2, share_x=True))


def _used(result: DesignResult, name: str) -> float:
    """Return the share of the room from trim to the limits of a channel that the winner uses."""
    low, high = result.envelope.bands[name]
    x = result.best.record[name]
    at = result.envelope.trim.get(name, float(x[0]))
    return float(max((x.max() - at) / (high - at), (at - x.min()) / (at - low)))


def _channel(result: DesignResult, name: str) -> fig.Panel:
    best = result.best
    record, tight = best.record, best.tightest
    factor = -1.0 / G0_M_S2 if name == "az" else shown_unit(name)[0]
    y = factor * record[name]
    draws: list[fig.Drawn] = [fig.Curve(x=record.t_s, y=y, name="flown", colour=fig.COLOURS[0])]
    shown = [float(y.min()), float(y.max())]
    if name in best.design.controls:
        command = factor * record[f"{name}_cmd"]
        draws.append(fig.Curve(x=record.t_s, y=command, name="command", dash=fig.DOTTED))
        shown += [float(command.min()), float(command.max())]
    middle, half = 0.5 * (max(shown) + min(shown)), max(0.5 * (max(shown) - min(shown)), 1e-9)
    for bound in sorted(factor * b for b in result.envelope.bands.get(name, ())):
        if abs(bound - middle) < 2.2 * half:
            draws.append(fig.Rule(at=bound, of="y", name="limit", colour=fig.WARN, width=1.1, dash=fig.DASHED))
            shown.append(bound)
    if tight.name == name:
        k = int(np.argmin(np.abs(record.t_s - tight.t_s)))
        draws.append(fig.Curve(x=[record.t_s[k]], y=[y[k]], marker="o", colour=fig.WARN, size=4.5, order=5.0))
    pad = 0.1 * (max(shown) - min(shown) or 1.0)
    return fig.Panel(
        draws=draws, x="t, s", y="load factor" if name == "az" else axis_label(name), tall_in=1.05,
        x_range=(0.0, float(record.t_s[-1])), y_range=(min(shown) - pad, max(shown) + pad),
    )  # fmt: skip


# --- spectra among the modes ------------------------------------------------------------------------------------------


def _spectrum_plate(result: DesignResult) -> fig.Plate:
    wn = [abs(p) for p in result.modes.values() if abs(p) > 0.05]
    low, high = 0.5 * min(wn), 2.5 * max(wn)
    fine = np.geomspace(low, high, _BINS * _PER_BIN)
    centres = np.sqrt(fine[::_PER_BIN] * fine[_PER_BIN - 1 :: _PER_BIN])
    curves = []
    for k, r in enumerate(compared(result)):
        energy = result.spectrum(r.design, fine).reshape(_BINS, _PER_BIN).mean(axis=1) / DEG_RAD**2
        look = fig.line_look(k) | {"width": 1.0 if k else 1.6, "order": 3.0 - 0.1 * k}
        curves.append(fig.Curve(x=centres, y=energy, name=family_label(r.design.family), **look))
    peak = max(float(np.max(c.y)) for c in curves)
    elastic = result.aircraft.flown_modes()
    marks = fig.mode_marks(result.modes, [m.name for m in elastic.modes] if elastic else [], low, high)
    panel = fig.Panel(
        draws=[*curves, *marks], x="frequency, rad/s", y="energy density, (deg s)²", log_x=True, log_y=True,
        x_range=(low, high), y_range=(10.0**-_DECADES * peak, 3.0 * peak), tall_in=2.7,
    )  # fmt: skip
    caption = (
        "Energy spectra of the commands, as means over narrow bands; each design has its own largest admissible "
        "amplitude. Vertical lines: the modes of this plane (green: rigid, over their half-power bands; purple: "
        "elastic). An input does not excite a mode if its spectrum has little energy there."
    )
    return fig.Plate("spectra", "Energy of each input over frequency", caption, fig.Chart([[panel]]))


# --- predicted errors -------------------------------------------------------------------------------------------------


def _error_plate(result: DesignResult) -> fig.Plate:
    entries, t = compared(result), result.problem.targets
    ratios = np.array([r.design.errors / t.wanted for r in entries])
    drawn = result.best.over is not None
    worst = np.array([r.over.told.over(np.max) if r.over else row for r, row in zip(entries, ratios, strict=True)])
    worst = np.where(np.isnan(worst), ratios, worst)  # no draw has the target
    largest = float(worst[np.isfinite(worst)].max(initial=float(ratios.max())))
    worst = np.minimum(worst, 10.0 * largest)  # without bound: beyond the edge
    each, low = _BAR * len(entries) + 0.16, min(0.5 * float(ratios.min()), 0.6)  # the wanted error, 1, stands inside
    at = each * np.arange(len(t.names))
    draws: list[fig.Drawn] = []
    for k, r in enumerate(entries):
        name = family_label(r.design.family)
        draws.append(fig.bars(at + _BAR * k, low, ratios[k], 0.115, name=name, colour=fig.COLOURS[k % 6]))
        if drawn:
            ends = np.column_stack([ratios[k], worst[k], np.full(at.size, np.nan)]).ravel()
            rows = np.repeat(at + _BAR * k, 3)
            draws.append(fig.Curve(x=ends, y=rows, width=0.8, marker="|", size=4.0, joined=True, order=3.0))
    for i, y in enumerate(at):
        end = float(min(worst[0, i], 1.2 * largest))
        text = _short_error(result, entries[0].design.errors, i)
        draws.append(fig.Words(x=end, y=y, text=text, shift=(3, 0), size=7.0, colour=fig.QUIET))
    draws.append(fig.Rule(at=1.0, name="wanted", colour=fig.WARN, width=1.2, dash=fig.DASHED))
    middle = 0.5 * _BAR * (len(entries) - 1)
    panel = fig.Panel(
        draws=draws, x="predicted standard error over the wanted one", log_x=True,
        x_range=(low, max(2.0, 1.6 * largest)), tall_in=each * len(t.names),
        y_ticks=[(y + middle, n) for y, n in zip(at, t.names, strict=True)],
        y_range=(each * len(t.names) - 0.14, -0.14),
    )  # fmt: skip
    caption = (
        "Predicted standard error of every target over the wanted one: left of the dashed line is good enough. Bars "
        "stand in the order of the legend. The number beside the first bar is the error of the recommended input."
    )
    if drawn:
        caption += " The thin line runs to the error in the worst of the drawn aircraft."
    return fig.Plate("errors", "Expected accuracy of each input", caption, fig.Chart([[panel]]))


def _short_error(result: DesignResult, errors: Any, i: int) -> str:
    t = result.problem.targets
    value = 100.0 * errors[i] / abs(t.values[i]) if is_ratio(t.names[i]) else errors[i]
    return f"{number(float(value), 2)}{' %' if is_ratio(t.names[i]) else ''}"
