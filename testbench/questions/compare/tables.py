"""Tables of a comparison: what the suites cost and buy, all errors, information, placement, failures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.page.labels import number
from testbench.page.tables import Column, Table, Value
from testbench.questions.compare.answer import added, more_of, per_hundred, quantity_words, worth
from testbench.questions.compare.methods import OVER, contests, ranked_contests
from testbench.questions.run.found import finite
from testbench.questions.side_by_side import pair_table, rank_table

if TYPE_CHECKING:
    from testbench.questions.compare.result import CompareResult, Gain, Summary
    from testbench.sensors import SensorSuite as Suite


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
        f"What each suite buys over {result.suites[0].name}",
        f"Size of the error with the first suite minus that with this one, in the same flight with the same noise: "
        f"{what} and 95 % interval. p: {test}; p corrected: for all questions of this table together (Holm). A gain is "
        f"sure where the corrected p is at most {s.level:g}. Information: ratio of the predicted standard errors, this "
        "suite over the first. Where some repetitions miss a mode, the table also compares how often, in percent, by "
        "McNemar's exact test with a 95 % interval of Clopper and Pearson. Errors of damping ratios are absolute. "
        "Errors of predictions are percent of the rms, all others percent of the true value, or absolute where that is "
        "near zero.",
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
        "information predicts for an estimator that knows the aircraft's equations and its instruments. For that "
        "estimator the table gives scatter over predicted error with its 95 % interval, which holds 1 where "
        "information and simulation agree. The ratio is left empty where the model is not linear over the predicted "
        "errors (terms of second order are more than half of them): there a linear bound says little. Predictions are "
        "compared with what the sensors would show without noise and biases.",
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
        "What each sensor is worth by information",
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
        f"Best stations along the wing, beside {p.base}",
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
        "These identifications count in none of the errors.",
        tuple(Column(k, k) for k in ("input", "suite", "estimator", "repetition", "reason")),
        tuple((*f.case, f.repetition + 1, f.reason) for f in result.failures),
        wide=True,
    )
