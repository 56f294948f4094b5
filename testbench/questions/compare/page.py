"""The page of a comparison of sensor suites: its tables and figures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from testbench.page.explore import View
from testbench.page.figure import QUIET, Chart, Curve, Drawn, Panel, Plate, Words, grid, marker_look, rows
from testbench.page.labels import number, symbol
from testbench.page.page import Page, source_of
from testbench.page.tables import Column, Table, Value
from testbench.questions.compare.answer import (
    added,
    compare_answer,
    compare_sentences,
    more_of,
    per_hundred,
    quantity_words,
    worth,
)
from testbench.questions.compare.result import CaseKey
from testbench.questions.run.result import finite
from testbench.questions.side_by_side import Contest, best_words, pair_table, rank_plates, rank_table
from testbench.questions.tidy import COLUMNS, files_of

if TYPE_CHECKING:
    import pandas as pd

    from testbench.core.record import FloatArray
    from testbench.questions.compare.placement import Placed
    from testbench.questions.compare.result import CompareResult, Gain, Quantity, Summary
    from testbench.sensors import SensorSuite as Suite


OVER = "repetitions of every input"
_ROW_IN = 0.3
_DOT_IN = 0.13  # so that a count stands in the line of its own interval, clear of the next
_NOTE_ROOM = 0.55  # share of an axis' end beyond which a note stands above its interval
_ROOM = 0.6  # share of the smallest value that an axis begins at
_KINDS = ("prediction", "mode", "parameter")
_HUNDREDTHS = 100.0  # damping ratios are drawn in hundredths, beside percent


def tidy_comparison(result: CompareResult) -> pd.DataFrame:
    """Return one row per repetition, input, suite, estimator and quantity; the value is the error of the estimate."""
    import pandas as pd

    rows = [
        (k, *case, f"error of {quantity_words(quantity)}", float(error), quantity.unit, "")
        for case, quantities in result.errors.items()
        for quantity, errors in quantities.items()
        for k, error in enumerate(errors)
    ]
    rows += [(f.repetition, *f.case, "", float("nan"), "", f.reason) for f in result.failures]
    found = pd.DataFrame(rows, columns=["run", "input", "suite", "estimator", "figure", "value", "unit", "reason"])
    same = {"scenario": result.name, "aircraft": result.scenario.aircraft, "seed": result.seed}
    none = dict.fromkeys(("truth", "standard_error"), float("nan"))
    return found.assign(**same, **none)[list(COLUMNS)].sort_values("run", kind="stable", ignore_index=True)


def compare_page(result: CompareResult) -> Page:
    """Return the page of a comparison: what each sensor buys, by simulation and by information."""
    contests = ranked_contests(result)
    first, *doubts = compare_answer(result)
    return Page(
        kicker=f"Comparison of sensor suites: {result.name}",
        title=result.scenario.title,
        question=result.scenario.question,
        answer=[first, *(("finding", text) for text in best_words(contests, OVER)), *doubts],
        tables=compare_tables(result),
        plates=[*compare_plates(result), *rank_plates(contests, OVER)],
        files=files_of(tidy_comparison(result)) if result.errors else {},
        template="questions/compare/page.html.j2",
        context={"result": result, "details": compare_sentences(result)},
        provenance=[("seed", str(result.seed))],
        flown=result.tally if result.flights else None,
        source=source_of(result.scenario),
        terminal=[information_table(result)],
    )


# --- tables -----------------------------------------------------------------------------------------------------------


def compare_tables(result: CompareResult) -> list[Table]:
    """Return what the suites cost, what they buy, all errors, what information says, placement and failures."""
    out = [suite_table(result), gain_table(result), error_table(result), information_table(result)]
    out += [worth_table(result), *placement_tables(result), pair_table(contests(result))]
    out += [rank_table(ranked_contests(result), OVER), failure_table(result)]
    return [t for t in out if t.rows]


def suite_table(result: CompareResult) -> Table:
    """Return the suites with price and mass."""
    base = result.suites[0]

    def per(s: Suite, what: str) -> float | None:
        """Return the factor of a suite for 100 of what it costs or weighs more."""
        more = more_of(getattr(s, what), getattr(base, what))
        return per_hundred(None if s is base else worth(result, s), more)

    errors = "standard errors"
    return Table.of(
        "suites",
        "The sensor suites",
        "Price and mass are those of all sensors with mounting and cable; a dash: not known. The last columns give, by "
        "information, the factor by which the added sensors divide the standard errors (the geometric mean of those "
        "that every suite gives), and the same factor for 100 € or 100 g.",
        (
            Column("suite", "suite", get="name"),
            Column("rate", "rate", "Hz", given=True, get="rate_hz"),
            Column("adds", "adds to the first", get=lambda s: "" if s is base else added(result, s)),
            Column("price", "price", "€", given=True, digits=6, get="price_eur"),
            Column("mass", "mass", "g", given=True, digits=6, get="mass_g"),
            Column("divides", "divided by", "", errors, get=lambda s: None if s is base else worth(result, s)),
            Column("per_100_eur", "for 100 €", "", errors, get=lambda s: per(s, "price_eur")),
            Column("per_100_g", "for 100 g", "", errors, get=lambda s: per(s, "mass_g")),
        ),
        result.suites,
    )


def gain_table(result: CompareResult) -> Table:
    """Return every gain with its interval and probability."""
    s = result.scenario
    what = {"wilcoxon": "Hodges-Lehmann pseudo-median", "t": "mean"}[s.test]
    test = {"wilcoxon": "Wilcoxon's signed rank test, exact", "t": "Student's paired t test"}[s.test]
    suites = {suite.name: suite for suite in result.suites}

    def per(g: Gain, what: str) -> float | None:
        """Return the gain for 100 of what its suite costs or weighs more than the first."""
        more = more_of(getattr(suites[g.case.suite], what), getattr(result.suites[0], what))
        return 100.0 * g.paired.difference.value / more if g.paired.difference and more else None

    difference = "paired difference"
    return Table.of(
        "gains",
        f"Gain of each suite over {result.suites[0].name}",
        "Size of the error with the first suite minus that with this one, in the same flight with the same noise: "
        f"{what} and 95 % interval. p: {test}; p corrected: for all questions of this table together (Holm). A gain is "
        f"significant where the corrected p is at most {s.level:g}. Information: ratio of the predicted standard "
        "errors, this suite over the first. Where some repetitions miss a mode, the table also compares how often, in "
        "percent, by McNemar's exact test with a 95 % interval of Clopper and Pearson. Errors of damping ratios are "
        "absolute. Errors of predictions are percent of the rms, all others percent of the true value, or absolute "
        "where that is near zero.",
        (
            Column("suite", "suite", get="case.suite"),
            Column("input", "input", get="case.manoeuvre"),
            Column("estimator", "estimator", get="case.estimator"),
            Column("quantity", "error of", get=_quantity),
            Column("before", "with the first", "", "median size", get=lambda g: finite(g.before)),
            Column("after", "with this one", "", "median size", get=lambda g: finite(g.after)),
            Column("gain", "gain", "", difference, get="paired.difference.value"),
            Column("low", "from", "", difference, get="paired.difference.low"),
            Column("high", "to", "", difference, get="paired.difference.high"),
            Column("pairs", "pairs", get="paired.pairs"),
            Column("p", "p", digits=2, get="paired.p"),
            Column("p_holm", "p corrected", digits=2),
            Column("sure", "sure", get=lambda g: None if g.p_holm is None else g.significant(s.level)),
            Column("information", "information", digits=2, get="predicted"),
            Column("per_100_eur", "100 €", "", "gain per", digits=2, get=lambda g: per(g, "price_eur")),
            Column("per_100_g", "100 g", "", "gain per", digits=2, get=lambda g: per(g, "mass_g")),
        ),
        result.gains,
        wide=True,
    )


def _quantity(of: Gain | Summary) -> str:
    return quantity_words(of.quantity) + (f", {of.quantity.unit}" if of.quantity.unit else "")


def error_table(result: CompareResult) -> Table:
    """Return every error of every case."""
    over = "scatter over predicted"
    return Table.of(
        "errors",
        "Errors of every input, suite and estimator",
        f"Over {result.scenario.seeds} repetitions: root mean square with 95 % interval, mean (bias), the best case's "
        "error from the same flight without any noise, standard deviation (scatter), and the standard error that "
        "information predicts for an estimator with the aircraft's equations and its instruments known. For that "
        "estimator the table gives scatter over predicted error with its 95 % interval, which contains 1 where "
        "information and simulation agree. The ratio is left empty where the model is not linear over the predicted "
        "errors (terms of second order are more than half of them): a linear bound is not meaningful there. "
        "Predictions are compared with the readings of sensors without noise and biases.",
        (
            Column("input", "input", get="case.manoeuvre"),
            Column("suite", "suite", get="case.suite"),
            Column("estimator", "estimator", get="case.estimator"),
            Column("quantity", "error of", get=_quantity),
            Column("found", "found"),
            Column("of", "of"),
            Column("rms", "rms", "", "error", get="rms.value"),
            Column("low", "from", "", "error", get="rms.low"),
            Column("high", "to", "", "error", get="rms.high"),
            Column("bias", "bias", "", "error", get="mean.value"),
            Column("of_flight", "without noise", "", "error"),
            Column("scatter", "scatter", "", "error"),
            Column("predicted", "predicted scatter", get=lambda s: finite(s.predicted)),
            Column("ratio", "ratio", "", over, get="ratio.value"),
            Column("ratio_low", "from", "", over, get="ratio.low"),
            Column("ratio_high", "to", "", over, get="ratio.high"),
        ),
        result.summaries,
        wide=True,
    )


def information_table(result: CompareResult) -> Table:
    """Return the predicted standard errors, quantities down, suites across."""
    rows: list[tuple[Value, ...]] = []
    for m in result.manoeuvres:
        found = [result.predictions[m, s.name] for s in result.suites]
        for name, unit in dict.fromkeys(pair for p in found for pair in zip(p.names, p.units, strict=True)):
            rows.append((m, name + (f", {unit}" if unit else ""), *(finite(p.of(name)) for p in found)))
    return Table(
        "information",
        "Standard errors by information, without simulation",
        "Cramér-Rao bound of the linearised aircraft with unknown derivatives and sensor offsets; noise of measured "
        "inputs is included. Percent of the true value; absolute for damping ratios, and where no suite gives less "
        "than 100 % (the true value is near zero). A dash: not identifiable.",
        (
            Column("input", "input"),
            Column("quantity", "standard error of"),
            *(Column(s.name, s.name) for s in result.suites),
        ),
        tuple(rows),
    )


def worth_table(result: CompareResult) -> Table:
    """Return by how much the standard errors grow if a single sensor is left out."""
    rows: list[tuple[Value, ...]] = []
    names = list(dict.fromkeys(n for p in result.predictions.values() for n in p.names))
    for (m, suite_name), p in result.predictions.items():
        suite = next(s for s in result.suites if s.name == suite_name)
        for sensor in suite.sensors:
            if sensor.channel in p.without:
                grown = dict(zip(p.names, p.without[sensor.channel].tolist(), strict=True))
                row = (finite(grown.get(n)) for n in names)
                rows.append((m, suite_name, sensor.channel, sensor.price_eur, sensor.mass_g, *row))
    return Table(
        "without_each",
        "Value of each sensor by information",
        "Factor by which standard errors grow if this sensor alone is left out of its suite. A dash: without it the "
        "quantity is not identifiable.",
        (
            Column("input", "input"),
            Column("suite", "suite"),
            Column("sensor", "without"),
            Column("price", "price", "€", given=True, digits=6),
            Column("mass", "mass", "g", given=True, digits=6),
            *(Column(n, n, "", "standard error grows by") for n in names),
        ),
        tuple(rows),
        wide=True,
    )


def placement_tables(result: CompareResult) -> list[Table]:
    """Return the chosen stations in the order of their gain, and the errors before and after."""
    p = result.placed
    if p is None:
        return []
    how = (
        f"All {p.sets} sets were tried, and this one is the best"
        if p.all_tried
        else f"It was found by adding and exchanging among {number(p.sets)} sets ({p.exchanged} exchanges); no "
        "exchange of one sensor improves it"
    )
    path = Table(
        "placement",
        f"Best stations along the wing, in addition to {p.base}",
        f"Sensors in the order of their gain. Criterion {p.asked.criterion}, in units of {p.asked.wn_percent:g} % of a "
        f"frequency and {p.asked.zeta:g} of a damping ratio. {how}.",
        (Column("sensor", "sensor"), Column("criterion", "criterion with it", digits=3)),
        (("none", finite(p.path[0])), *((s.words, finite(c)) for s, c in zip(p.spots, p.path[1:], strict=True))),
    )
    errors = Table(
        "placement_errors",
        "Standard errors of the modes before and after",
        "By information, with the commands known exactly. Percent; absolute for damping ratios.",
        (Column("quantity", "standard error of"), Column("before", p.base), Column("after", "with the placed sensors")),
        tuple((n, finite(float(b)), finite(float(a))) for n, b, a in zip(p.names, p.before, p.after, strict=True)),
    )
    return [path, errors]


def failure_table(result: CompareResult) -> Table:
    """Return identifications without a model."""
    return Table(
        "failures",
        "Identifications that gave no model",
        "These identifications are not included in the errors.",
        tuple(Column(k, k) for k in ("input", "suite", "estimator", "repetition", "reason")),
        tuple((*f.case, f.repetition + 1, f.reason) for f in result.failures),
        wide=True,
    )


# --- figures ----------------------------------------------------------------------------------------------------------


class Dot(NamedTuple):
    """One figure in a panel: which row and suite, its value and interval, whether it is predicted, and a word on it."""

    row: str
    suite: int
    value: float
    low: float
    high: float
    predicted: bool
    note: str = ""


def compare_plates(result: CompareResult) -> list[Plate]:
    """Return the figures: errors by simulation (if there are any), by information, and the placement."""
    suites = [s.name for s in result.suites]
    out = []
    if result.errors:
        out.append(
            Plate(
                "errors",
                "Errors through each suite",
                f"Root mean square over {result.scenario.seeds} repetitions with 95 % interval, percent; damping "
                "ratios in hundredths. Open signs: standard errors that information predicts for the same estimator. "
                '"sure": the difference from the first suite is beyond chance, over all questions of the comparison '
                "together. 9/12: found in 9 of 12 repetitions. Quantities that only one suite predicts, or whose true "
                "value is near zero, are in the table.",
                _chart(_error_panels(result), suites),
            )
        )
    else:
        out.append(
            Plate(
                "information",
                "Standard errors by information",
                "Cramér-Rao bound through each suite, percent; damping ratios in hundredths. Nothing was flown. "
                "Quantities whose true value is near zero are in the table.",
                _chart(_information_panels(result), suites),
            )
        )
    if result.placed is not None:
        panels = _placement(result.placed)
        out.append(
            Plate(
                "placement",
                "Best positions of sensors along the wing",
                "Left: the criterion that one added sensor reaches, over its station; lower is better, and filled "
                "signs are the stations of the best set. Right: the criterion as the sensors of the best set are added "
                "one by one.",
                Chart([panels]),
                [View(name=p.title, panels=[p]) for p in panels],
            )
        )
    return out


def _error_panels(result: CompareResult) -> dict[str, list[Dot]]:
    """Return title -> dots, one panel per input and estimator."""
    from testbench.questions.compare.scenario import BEST_CASE

    index = {s.name: k for k, s in enumerate(result.suites)}
    out: dict[str, list[Dot]] = {}
    sure = {(g.case, g.quantity) for g in result.gains if g.significant(result.scenario.level)}
    seen = {s.quantity: {o.case.suite for o in result.summaries if o.quantity == s.quantity} for s in result.summaries}
    least = min(2, len(result.suites))  # suites that a row compares
    kinds, order = _KINDS.index, list(dict.fromkeys(s.case.estimator for s in result.summaries))
    for s in sorted(result.summaries, key=lambda s: (order.index(s.case.estimator), kinds(s.quantity.kind))):
        if (s.quantity.kind == "prediction" and len(seen[s.quantity]) < least) or s.quantity.unit not in ("%", ""):
            continue
        title = f"{s.case.estimator}, {s.case.manoeuvre}" if len(result.manoeuvres) > 1 else s.case.estimator
        dots = out.setdefault(title, [])
        k, factor = index[s.case.suite], 1.0 if s.quantity.unit else _HUNDREDTHS
        name = f"prediction of {symbol(s.quantity.name)}" if s.quantity.kind == "prediction" else s.quantity.name
        if s.rms is not None:
            words = ["sure"] if (s.case, s.quantity) in sure else []
            words += [f"{s.found}/{s.of}"] if s.found < s.of else []
            low, high = factor * s.rms.low, factor * s.rms.high
            dots.append(Dot(name, k, factor * s.rms.value, low, high, False, " ".join(words)))
        else:
            dots.append(Dot(name, k, np.nan, np.nan, np.nan, False, f"{s.found}/{s.of}"))
        if s.case.estimator == BEST_CASE and s.predicted is not None and np.isfinite(s.predicted):
            dots.append(Dot(name, k, factor * s.predicted, factor * s.predicted, factor * s.predicted, True))
    return {title: dots for title, dots in out.items() if any(np.isfinite(d.value) for d in dots)}


def _information_panels(result: CompareResult) -> dict[str, list[Dot]]:
    out: dict[str, list[Dot]] = {}
    for (manoeuvre, suite), p in result.predictions.items():
        k = [s.name for s in result.suites].index(suite)
        for name, std, unit in zip(p.names, p.std.tolist(), p.units, strict=True):
            value = std * (1.0 if unit else _HUNDREDTHS)
            if np.isfinite(value) and unit in ("%", ""):
                out.setdefault(manoeuvre, []).append(Dot(name, k, value, value, value, True))
    return out


def _chart(panels: dict[str, list[Dot]], suites: Sequence[str]) -> Chart:
    """Return one panel per title: rows of quantities, a sign per suite."""
    return grid([_dots(title, dots, suites) for title, dots in panels.items()], min(2, len(panels)))


def _dots(title: str, dots: Sequence[Dot], suites: Sequence[str]) -> Panel:
    names = list(dict.fromkeys(d.row for d in dots))
    drawn = [d for d in dots if np.isfinite(d.value)]
    floor = _ROOM * min(d.value for d in drawn)
    end = min(1.4 * max(d.high for d in drawn), 3.0 * max(d.value for d in drawn))
    step = 0.7 / max(len(suites), 1)
    draws: list[Drawn] = []
    for d in dots:
        y = names.index(d.row) + step * (d.suite - 0.5 * (len(suites) - 1)) + (0.12 * step if d.predicted else 0.0)
        look = marker_look(d.suite)
        x = d.value if np.isfinite(d.value) else floor  # found too seldom for an error
        if d.high > d.low:
            draws.append(Curve(x=[max(d.low, floor), d.high], y=[y, y], colour=look["colour"], width=1.2))
        if np.isfinite(d.value):
            hollow = "white" if d.predicted else False
            name = suites[d.suite] if not d.predicted or all(e.predicted for e in dots) else ""
            draws.append(Curve(x=[x], y=[y], name=name, **look, size=4.5, hollow=hollow, order=3.0))
        if d.note:
            at = min(max(d.high, x) if np.isfinite(d.value) else floor, end)
            beside = at < _NOTE_ROOM * end  # the marker, else above it
            draws.append(Words(x=at, y=y, text=d.note, shift=(6, 0) if beside else (-4, 6), size=6.5,
                               across="left" if beside else "right", colour=look["colour"]))  # fmt: skip
    row_in = max(_ROW_IN, _DOT_IN * len(suites) + 0.1)
    short = [n.replace("wn of ", "ωn ").replace("zeta of ", "ζ ").replace("symmetric", "symm.") for n in names]
    return Panel(
        draws=draws, title=title, x="error, % (ζ: hundredths)", log_x=True, x_range=(floor, end), **rows(short, row_in)
    )


def _placement(placed: Placed) -> list[Panel]:
    """Return the criterion over the span for each kind, and along the path to the best set."""
    draws: list[Drawn] = []
    for k, kind in enumerate(dict.fromkeys(s.kind for s in placed.candidates)):
        spots = sorted((s for s in placed.candidates if s.kind == kind), key=lambda s: s.y_m)
        y, cost = np.array([s.y_m for s in spots]), np.array([placed.candidates[s] for s in spots])
        best, look = np.array([s in placed.spots for s in spots]), marker_look(k)
        draws.append(Curve(x=y, y=cost, name=kind, colour=look["colour"], width=1.0))
        for these, name, hollow in ((best, f"{kind}, chosen", False), (~best, f"{kind}, stations", "white")):
            draws.append(Curve(x=y[these], y=cost[these], name=name, **look, hollow=hollow, order=3.0))
    finite = np.isfinite(placed.path)
    steps, path = np.arange(len(placed.path)), np.array(placed.path)
    way: list[Drawn] = [Curve(x=steps[finite], y=path[finite], marker="o", size=3.5, joined=True)]
    for k, spot in enumerate(placed.spots, 1):
        if finite[k]:
            short = f"{'a' if spot.kind == 'accelerometer' else 's'} {spot.y_m:+.1f}".replace("-", "−")
            way.append(Words(x=k, y=path[k], text=short, shift=(2, 6 if k % 2 else -12), size=7.5, colour=QUIET))
    stations = [s.y_m for s in placed.candidates]
    return [
        Panel(
            draws=draws, title="one sensor alone", x="station y, m (right wing positive)", y="criterion", log_y=True,
            x_range=(min(stations) - 0.1, max(stations) + 0.1), tall_in=2.3, broad=1.6,
        ),
        Panel(
            draws=way, title="the best set, one by one", x="sensors placed", name="criterion", log_y=True, whole="x",
            x_range=(-0.3, len(placed.path) + 0.2), y_range=(0.6 * float(path[finite].min()), None), tall_in=2.3,
        ),
    ]  # fmt: skip


# --- the estimators side by side --------------------------------------------------------------------------------------


def contests(result: CompareResult) -> list[Contest]:
    """Return every error that two or more estimators give through the same suite from the same input."""
    out = []
    for manoeuvre in result.manoeuvres:
        for suite in result.suites:
            by_quantity: dict[Quantity, dict[str, FloatArray]] = {}
            for label in result.scenario.identification.labels:
                for quantity, errors in result.errors.get(CaseKey(manoeuvre, suite.name, label), {}).items():
                    by_quantity.setdefault(quantity, {})[label] = np.abs(errors)
            where = f"{suite.name}, {manoeuvre}"
            out += [
                Contest(where, quantity_words(q), q.unit, tuple(found), np.column_stack(list(found.values())))
                for q, found in by_quantity.items()
                if len(found) > 1
            ]
    return out


def ranked_contests(result: CompareResult) -> list[Contest]:
    """Return the errors of prediction by suite, the mean over the outputs that all estimators predict."""
    out = []
    for suite in result.suites:
        found = [
            (label, [result.errors.get(CaseKey(m, suite.name, label), {}) for m in result.manoeuvres])
            for label in result.scenario.identification.labels
        ]
        found = [(label, of) for label, of in found if all(of)]
        common = [
            q
            for q in (found[0][1][0] if found else {})
            if q.kind == "prediction" and all(q in e for _, of in found for e in of)
        ]
        if len(found) < 2 or not common:
            continue
        means = [np.concatenate([np.mean([e[q] for q in common], axis=0) for e in of]) for _, of in found]
        names = tuple(label for label, _ in found)
        out.append(Contest(suite.name, "prediction, mean over the outputs", "%", names, np.column_stack(means)))
    return out
