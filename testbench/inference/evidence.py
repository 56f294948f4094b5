"""Which of several hypotheses do records support? One table of probabilities by evidence, whatever is asked.

Each hypothesis is fitted (:mod:`.fit`); those whose posterior is not Gaussian are sampled unless they are far behind.
Differences of ln p count as the likelihood of the most probable one deserves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import logsumexp

from testbench.core.errors import EstimationError, RecordError
from testbench.core.record import FlightRecord, FloatArray
from testbench.inference.calibrate import CREDIBLE, fewest
from testbench.inference.fit import WHOLE, Data, Fit, Hypothesis, Keeper, Points, Posterior, Unknown, fit_together
from testbench.inference.linear import KAPPAS
from testbench.inference.parameters import Noise

if TYPE_CHECKING:
    import pandas as pd

_FAR = 7.0  # in ln p behind the best: beyond it no correction would bring a hypothesis back


@dataclass(frozen=True, eq=False)
class Row:
    """One hypothesis of a comparison."""

    name: str  #: of the hypothesis
    #: posterior, all rows together 1; differences of ``log_evidence`` count as the likelihood of the most probable one
    #: deserves (:attr:`Posterior.misfit`)
    probability: float
    log_evidence: float  #: natural logarithm
    difference: float  #: of ``log_evidence`` to the first row, 0 or less but for prior odds
    difference_error: float  #: standard error of it, from segments of one second
    #: ln p of records held out, a sample, less that of the first hypothesis given; None without any
    held_out: float | None
    posterior: Posterior  #: of its parameters


@dataclass(frozen=True, eq=False)
class Comparison:
    """Hypotheses, the most probable first, as ``arviz_stats.compare`` tables them."""

    rows: tuple[Row, ...]
    fits: Mapping[str, tuple[Hypothesis, Fit]] = field(default_factory=dict, repr=False)
    """By name; a later comparison of the same records goes on from them."""

    def __getitem__(self, name: str) -> Row:
        """Return the row of a hypothesis."""
        return next(row for row in self.rows if row.name == name)

    @property
    def best(self) -> Row:
        """The most probable."""
        return self.rows[0]

    def credible(self, probability: float = CREDIBLE) -> tuple[str, ...]:
        """Return the fewest hypotheses that hold so much probability together."""
        return fewest({row.name: row.probability for row in self.rows}, probability)

    @cached_property
    def noise(self) -> dict[str, tuple[float, float]]:
        """Channel -> (true over stated noise, standard error), over all hypotheses by their probabilities."""
        out = {}
        for channel in self.best.posterior.noise:
            values, errors = np.array([row.posterior.noise[channel] for row in self.rows]).T
            weights = np.array([row.probability for row in self.rows])
            mean = float(weights @ values)
            out[channel] = mean, float(np.sqrt(weights @ (errors**2 + (values - mean) ** 2)))
        return out

    def to_pandas(self) -> pd.DataFrame:
        """Return the table with one row per hypothesis."""
        import pandas as pd

        return pd.DataFrame(
            {
                "probability": row.probability,
                "ln evidence": row.log_evidence,
                "difference": row.difference,
                "difference error": row.difference_error,
                "whole": row.posterior.p_whole,
                "kappa": row.posterior.kappa,
                "whiteness": row.posterior.whiteness,
                "strain": row.posterior.strain,
                "held out": row.held_out,
                "effective": row.posterior.effective,
            }
            for row in self.rows
        ).set_axis([row.name for row in self.rows])

    def _repr_html_(self) -> str:
        """Return the table as a notebook shows it."""
        return str(self.to_pandas().to_html(float_format="{:.3g}".format))

    def __str__(self) -> str:
        wide = max(len(row.name) for row in self.rows)
        lines = [f"{'hypothesis':<{wide}}  probability  difference      whole  kappa"]
        for row in self.rows:
            difference = f"{row.difference:.1f} +- {row.difference_error:.1f}"
            lines.append(
                f"{row.name:<{wide}}  {row.probability:11.3f}  {difference:<14}  {row.posterior.p_whole:5.2f}  "
                f"{row.posterior.kappa:.0e}"
            )
        return "\n".join(lines)


@dataclass(frozen=True)
class Fitting:
    """How posteriors are found.

    Attributes:
        samples: of importance sampling, where a posterior is not Gaussian; with 0 nothing is sampled.
        ahead: called with all that is predicted next, of all hypotheses together.
        keeper: of fits at rest, where nothing is sampled; those that it knows are not made again.

    Example:
        >>> import testbench as tb
        >>> tb.Fitting(samples=0).keeper is None
        True
    """

    samples: int = 128
    ahead: Callable[[Points], None] | None = None
    keeper: Keeper | None = None


_SAMPLED = Fitting()


def compare_hypotheses(
    records: Sequence[FlightRecord],
    hypotheses: Sequence[Hypothesis],
    noise: Noise,
    unknown: Unknown | None = None,
    held_out: Sequence[FlightRecord] = (),
    before: Comparison | None = None,
    fitting: Fitting = _SAMPLED,
) -> Comparison:
    """Compare hypotheses about measured records by their evidence, noise and unknown motion being uncertain.

    Args:
        records: measured.
        hypotheses: at least one; probabilities are relative to those that are given, so that "nothing" is one of them.
        noise: of the channels that are compared, as stated, and how it is known.
        unknown: what an unknown motion does, see :func:`testbench.inference.unknown.pulses`; without it every
            hypothesis must be the whole story.
        held_out: measured records that judge, and that nothing is fitted to.
        before: an earlier comparison of the same records: hypotheses that it holds are not fitted again, and of one of
            the same name that begins elsewhere the better fit is kept.
        fitting: how posteriors are found.

    Raises:
        RecordError: a record is not measured, or lacks a channel that has noise.
        EstimationError: no hypothesis is given, two have one name, a prediction has another shape, or one gives no
            numbers from any of its beginnings.

    Example:
        >>> import testbench as tb
        >>> noise = tb.Noise({"q": 0.003, "theta": 0.002})
        >>> tb.compare_hypotheses(records, [nothing, lag, delay], noise)  # doctest: +SKIP
    """
    names = [h.name for h in hypotheses]
    if not names or len(set(names)) < len(names):
        raise EstimationError(f"hypotheses must have names that differ, got {', '.join(names) or 'none'}")
    for record in (*records, *held_out):
        if record.kind != "measured":
            raise RecordError(f"hypotheses are compared on measured records, got one of kind '{record.kind}'")
        if missing := [c for c in noise.channels if c not in record]:
            raise RecordError(f"every record must have the channels of the noise, got one without {missing[0]}")
    known = {} if before is None else before.fits
    data = next(iter(known.values()))[1].data if known else Data(records, noise, unknown)
    fly, samples = fitting.ahead or (lambda points: None), fitting.samples
    found = _fitted(hypotheses, data, known, fly, None if samples else fitting.keeper)
    odds = np.log([h.odds for h in hypotheses])
    top = max(np.array([f.log_evidence for f in found]) + odds)
    near = [i for i in range(len(found)) if samples and found[i].log_evidence + odds[i] > top - _FAR]
    for i, fit in zip(near, fit_together([found[i].sampled(samples) for i in near], fly), strict=True):
        found[i] = fit
    logs = np.array([f.log_evidence for f in found])
    weights = logs / found[int(np.argmax(logs + odds))].misfit[0] + odds
    probabilities = np.exp(weights - logsumexp(weights))
    order = np.argsort(-probabilities, kind="stable")
    first = found[order[0]]
    scores = [f.score(held_out) for f in found] if held_out else []
    rows = []
    for k in order:
        difference = found[k].segments[0] - first.segments[0]
        rows.append(
            Row(
                name=names[k],
                probability=float(probabilities[k]),
                log_evidence=found[k].log_evidence,
                difference=found[k].log_evidence - first.log_evidence,
                difference_error=float(np.std(difference) * math.sqrt(len(difference))),
                held_out=scores[k] - scores[0] if scores else None,
                posterior=found[k].posterior,
            )
        )
    return Comparison(tuple(rows), dict(zip(names, zip(hypotheses, found, strict=True), strict=True)))


def _passed(hypothesis: Hypothesis, ways: Sequence[FloatArray]) -> bool:
    """Return whether a fit would begin where an earlier one has come by: between its first and its last point."""
    begin = np.array(list(hypothesis.first.values()))
    slack = 1e-9 * hypothesis.std
    return any(bool(np.all((w.min(0) - slack <= begin) & (begin <= w.max(0) + slack))) for w in ways)


def _fitted(
    hypotheses: Sequence[Hypothesis],
    data: Data,
    known: Mapping[str, tuple[Hypothesis, Fit]],
    fly: Callable[[Points], None],
    keeper: Keeper | None,
) -> list[Fit]:
    """Return the best fit of each, the first one alone: noise scales of the others begin with its own.

    What others reached from their first beginnings ends what is hopeless from the next ones.
    """

    def at_rest(begun: Sequence[Hypothesis], scales: FloatArray | None) -> list[Fit]:
        """Return fits that come to rest together, as they are kept if they are."""
        head = repr((data.most, data.first, None if scales is None else scales.tolist()))
        group = "; ".join([head, *(repr((h.name, h.parameters, sorted(h.begin.items()))) for h in begun)])
        kept = keeper.known(group) if keeper is not None and begun else None
        if kept is not None:
            data.most = max(data.most, kept["most"])
            return [Fit.again(told, h, data) for told, h in zip(kept["fits"], begun, strict=True)]
        out = fit_together([Fit.of(h, data, scales) for h in begun], fly)
        if keeper is not None and begun:
            keeper.keep(group, {"most": data.most, "fits": [f.told() for f in out]})
        return out

    def whole(fits: Mapping[str, Fit]) -> bool:
        """Return whether the best of them needs no unknown motion: from elsewhere others could be its equal at best."""
        best = max([*fits.values(), *(fit for _, fit in known.values())], key=lambda f: f.log_evidence)
        return data.unknown is not None and math.isfinite(best.log_evidence) and KAPPAS[best.k] <= WHOLE

    def run(some: Sequence[Hypothesis], scales: FloatArray | None = None) -> list[Fit]:
        best = {h.name: known[h.name][1] for h in some if h.name in known}
        new = [h for h in some if h.name not in known or known[h.name][0] is not h]
        ways: dict[str, list[FloatArray]] = {h.name: [] for h in new}  # first and last point of each fit
        for k in range(1 + max((len(h.more) for h in new), default=0)):
            begun = [replace(h, begin=(h.begin, *h.more)[k]) for h in new if k <= len(h.more)]
            begun = [h for h in begun if not _passed(h, ways[h.name])]
            if k and whole(best):
                break
            for one, found in zip(begun, at_rest(begun, scales), strict=True):
                ways[one.name].append(np.array([list(one.first.values()), found.theta]))
                if one.name not in best or found.log_evidence > best[one.name].log_evidence:
                    best[one.name] = found
        for h in some:
            if best[h.name].log_evidence == -math.inf:
                raise EstimationError(f"'{h.name}' must predict numbers where its fit begins, got none from {h.first}")
        return [best[h.name] for h in some]

    (first,) = run(hypotheses[:1])
    data.first = data.most if math.isinf(data.first) else data.first
    return [first, *run(hypotheses[1:], first.scales)]
