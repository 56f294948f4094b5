"""Which of several hypotheses do records support? One table, whatever is asked.

Every hypothesis predicts what the sensors read, from parameters with priors. Noise scales and an unknown motion of free
size belong to all of them, so that no threshold of chi-square decides: a hypothesis that leaves something needs an
unknown motion beside it, and pays for it.

The evidence of a hypothesis is that of its linearisation at the best point (Laplace's approximation), times the
probability that lies within the bounds of its parameters. Where flights one standard error away show that the
posterior is not Gaussian, it is corrected by importance sampling; the effective number of samples stands beside it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import cho_solve
from scipy.special import logsumexp
from scipy.stats import chi2, norm

from testbench.core.constants import WHITE
from testbench.core.errors import EstimationError, RecordError
from testbench.core.record import FlightRecord, FloatArray
from testbench.inference.calibrate import CREDIBLE, fewest
from testbench.inference.linear import (
    KAPPAS,
    Grams,
    Linearised,
    Motion,
    Reduced,
    Sized,
    fewer,
    reduced,
    sized,
    whitened,
)
from testbench.inference.parameters import Noise, Parameter, deviations_of, means_of

if TYPE_CHECKING:
    import pandas as pd

Predict = Callable[[FlightRecord, Mapping[str, float]], FloatArray]
"""(record, parameter -> value) -> what the channels would have read, (n, channels), SI, without noise."""
Pulses = Callable[[FlightRecord], FloatArray]
"""record -> what pulses do to the channels, (n, channels, m), SI, see :mod:`.unknown`."""
Unknown = Callable[[FlightRecord], FloatArray | Motion]
"""The same of an unknown motion; or its principal directions, in units of the noise."""
Slopes = Callable[[FlightRecord], Mapping[str, FloatArray]]
"""record -> parameter -> change of the prediction by one unit of it, (n, channels), SI."""
Points = Sequence[tuple["Hypothesis", Mapping[str, float]]]
"""(hypothesis, its parameter -> value), of all that is predicted next, so that it can be flown together."""

WHOLE = 1e-3
"""Size of the unknown motion up to which a hypothesis is the whole story; beyond it is a part."""
P_WHOLE = 0.5
"""Prior probability that a hypothesis, if it is true, is the whole story."""
_ROUNDS = 20
_REST = 4  # rounds of noise scales and point in turn
_PATIENCE = 2  # rounds before a fit may be given up
_HOPELESS = 30.0  # in ln p behind the best: a fit that promises less ends there, if
_REACH = 100.0  # in ln p behind the best: what is nearer may come to lead once its flights begin where they suit it
_BEGUN = 0.5  # in ln p: starts are found anew as long as that gains more
_LITTLE = 0.5  # it also promises less than this share of what the best gains; neither decides anything
_SAME = 0.01  # change of ln s below which they are at rest
_SHARES = (1.0, 0.5, 0.25, 0.1, 0.02)  # of a step, tried in turn
_FORM_S = 2.0  # between the knots of what modulates a form error: slower than the motion, quicker than a record
_AT_REST = 0.02  # in ln p: rounds end where another one promises less
_NEARBY = 1.0  # in ln p: tangents made afresh hold beyond a step that promises less
_SKEW = 0.2  # in ln p at one standard error: beyond it the posterior is sampled
_FAR = 7.0  # in ln p behind the best: beyond it no correction would bring a hypothesis back
_SEGMENT_S = 1.0  # of records, whose log-likelihoods tell how sure a difference is
_WORTH = 5  # segments that the belief in the model's likelihood is worth; judged
_OVERSTATES = 2.0  # misfit from which it is said
_LAGS = 10


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """What may be true of the records.

    Attributes:
        name: of the row.
        parameters: all that it does not know, with priors; nuisances as well as what is asked about.
        predict: see :data:`Predict`; NaN where it cannot be flown.
        odds: prior odds against the other hypotheses.
        begin: parameter -> value that the fit begins at, where that is not the mean of its prior.
        more: further such beginnings; the best fit of all is kept.
        slopes: see :data:`Slopes`, of those parameters whose tangents are known without differences.
        form: as ``predict``: how far what is true may depart from what the hypothesis says, as no law has quite the
            form of the real thing; its signature times the relative error of its form.
        begun: parameter -> value becomes the same hypothesis whose flights begin where they suit that point, or None if
            they begin there already; nuisances that are not among the parameters, as they belong to one record alone.

    Example:
        >>> import numpy as np
        >>> import testbench as tb
        >>> rise = tb.Parameter("a", "effect", 0.0, 1.0)
        >>> tb.Hypothesis("rise", (rise,), lambda record, values: values["a"] * record.t_s[:, None]).at(np.array([2.0]))
        {'a': 2.0}
    """

    name: str
    parameters: tuple[Parameter, ...]
    predict: Predict
    odds: float = 1.0
    begin: Mapping[str, float] = field(default_factory=dict)
    more: Sequence[Mapping[str, float]] = ()
    slopes: Slopes | None = None
    form: Predict | None = None
    begun: Callable[[Mapping[str, float]], Hypothesis | None] | None = None

    @property
    def first(self) -> dict[str, float]:
        """Parameter -> value that the fit begins at."""
        return {p.name: self.begin.get(p.name, p.value) for p in self.parameters}

    def at(self, theta: FloatArray) -> dict[str, float]:
        """Return parameter -> value."""
        return dict(zip((p.name for p in self.parameters), theta.tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class Posterior:
    """What records say of the parameters of one hypothesis.

    Attributes:
        parameters: (k,) with their priors.
        values: (k,).
        covariance: (k, k).
        noise: channel -> (true over stated standard deviation, standard error).
        kappa: size of the unknown motion that is still needed, a share of the motion.
        log_evidence: ln p(records | hypothesis), whole or in part.
        log_whole, log_part: the same if it is the whole story, and if an unknown motion is beside it.
        p_whole: probability that it is the whole story, if it is true.
        whiteness: probability that white noise would look as coloured as what is left, in any channel.
        strain: sum of squares of the parameters' distances from their prior means over those of the priors.
        effective: share of importance samples that count, 1 where Laplace's approximation holds.
        misfit: by what the likelihood overstates what the records say, 1 where the model is right.
        inflation: (k,) of the standard errors by it, which ``covariance`` holds.
        doubts: sentences.

    Example:
        >>> import testbench as tb
        >>> found = tb.compare_hypotheses(records, hypotheses, noise)  # doctest: +SKIP
        >>> posterior: tb.Posterior = found.best.posterior  # doctest: +SKIP
        >>> posterior["delay_s"], posterior.doubts  # doctest: +SKIP
    """

    parameters: tuple[Parameter, ...]
    values: FloatArray
    covariance: FloatArray
    noise: Mapping[str, tuple[float, float]]
    kappa: float
    log_evidence: float
    log_whole: float
    log_part: float
    p_whole: float
    whiteness: float
    strain: float
    effective: float
    misfit: float
    inflation: FloatArray
    doubts: tuple[str, ...]

    @property
    def errors(self) -> FloatArray:
        """Standard errors (k,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def by_name(self) -> dict[str, float]:
        """Parameter -> value."""
        return dict(zip((p.name for p in self.parameters), self.values.tolist(), strict=True))

    @cached_property
    def by_records(self) -> dict[str, tuple[float, float]]:
        """Parameter -> (value, standard error) by the records alone.

        Of the Gaussian posterior of each, its prior is divided out; infinite where the records say nothing.
        """
        out = {}
        each = (self.values.tolist(), self.errors.tolist(), self.inflation.tolist())
        for p, value, error, more in zip(self.parameters, *each, strict=True):
            weight, prior = (more / error) ** 2, p.prior_std**-2.0
            told = weight - prior
            out[p.name] = (
                ((value * weight - p.value * prior) / told, more * told**-0.5) if told > 0.0 else (p.value, math.inf)
            )
        return out

    @property
    def learned(self) -> FloatArray:
        """What the records added (k,): 1 less the ratio of posterior and prior variance, from 0 to 1."""
        return np.clip(1.0 - (self.errors / deviations_of(self.parameters)) ** 2, 0.0, 1.0)

    def __getitem__(self, name: str) -> tuple[float, float]:
        """Return value and standard error of a parameter."""
        k = [p.name for p in self.parameters].index(name)
        return float(self.values[k]), float(self.errors[k])


@dataclass(frozen=True, eq=False)
class Row:
    """One hypothesis of a comparison.

    Attributes:
        name: of the hypothesis.
        probability: posterior, all rows together 1; differences of ``log_evidence`` count as the likelihood of the most
            probable one deserves (:attr:`Posterior.misfit`).
        log_evidence: natural logarithm.
        difference: of ``log_evidence`` to the first row, 0 or less but for prior odds.
        difference_error: standard error of it, from segments of one second.
        held_out: ln p of records held out, a sample, less that of the first hypothesis given; None without any.
        posterior: of its parameters.
    """

    name: str
    probability: float
    log_evidence: float
    difference: float
    difference_error: float
    held_out: float | None
    posterior: Posterior


@dataclass(frozen=True, eq=False)
class Comparison:
    """Hypotheses, the most probable first, as ``arviz_stats.compare`` tables them."""

    rows: tuple[Row, ...]
    fits: Mapping[str, tuple[Hypothesis, _Fit]] = field(default_factory=dict, repr=False)
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


def compare_hypotheses(
    records: Sequence[FlightRecord],
    hypotheses: Sequence[Hypothesis],
    noise: Noise,
    unknown: Unknown | None = None,
    held_out: Sequence[FlightRecord] = (),
    air: Pulses | None = None,
    samples: int = 128,
    ahead: Callable[[Points], None] | None = None,
    before: Comparison | None = None,
) -> Comparison:
    """Compare hypotheses about measured records by their evidence, noise and unknown motion being uncertain.

    Args:
        records: measured.
        hypotheses: at least one; probabilities are relative to those that are given, so that "nothing" is one of them.
        noise: of the channels that are compared, as stated, and how it is known.
        unknown: what an unknown motion does, see :func:`testbench.inference.unknown.pulses`; without it every
            hypothesis must be the whole story.
        held_out: measured records that judge, and that nothing is fitted to.
        air: what each standard deviation of the gusts of a record does to the channels, likewise.
        samples: of importance sampling, where a posterior is not Gaussian; with 0 nothing is sampled.
        ahead: called with all that is predicted next, of all hypotheses together.
        before: an earlier comparison of the same records: hypotheses that it holds are not fitted again, and of one of
            the same name that begins elsewhere the better fit is kept.

    Raises:
        RecordError: a record is not measured, or lacks a channel that has noise.
        EstimationError: no hypothesis is given, two have one name, or a prediction has another shape.

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
    fly, known = ahead or (lambda points: None), {} if before is None else before.fits
    shared = next(iter(known.values()))[1].shared if known else _Shared()

    def run(some: Sequence[Hypothesis], scales: FloatArray | None = None) -> list[_Fit]:
        """Return the best fit of each."""
        new = [(i, h) for i, h in enumerate(some) if h.name not in known or known[h.name][0] is not h]
        best = {i: known[h.name][1] for i, h in enumerate(some) if h.name in known}
        for k in range(1 + max((len(h.more) for _, h in new), default=0)):  # what others reached ends what is hopeless
            begins = [(i, replace(h, begin=(h.begin, *h.more)[k])) for i, h in new if k <= len(h.more)]
            runs = [_Fit.of(h, records, noise, unknown, air, shared, scales) for _, h in begins]
            for (i, _), found in zip(begins, _together(runs, fly), strict=True):
                if i not in best or found.log_evidence > best[i].log_evidence:
                    best[i] = found
        return [best[i] for i in range(len(some))]

    (first,) = run(hypotheses[:1])
    shared.first = shared.most if math.isinf(shared.first) else shared.first
    found = [first, *run(hypotheses[1:], first.scales)]
    odds = np.log([h.odds for h in hypotheses])
    top = max(np.array([f.log_evidence for f in found]) + odds)
    far = [f for f, o in zip(found, odds, strict=True) if samples and f.log_evidence + o > top - _FAR]
    again = dict(zip(map(id, far), _together([f.sampled(samples) for f in far], fly), strict=True))
    found = [again.get(id(f), f) for f in found]
    logs = np.array([f.log_evidence for f in found])
    weights = logs / found[int(np.argmax(logs + odds))].misfit[0] + odds
    probabilities = np.exp(weights - logsumexp(weights))
    order = np.argsort(-probabilities, kind="stable")
    first = found[order[0]]
    scores = [f.score(held_out) for f in found] if held_out else []
    rows = []
    for k in order:
        difference = found[k]._segments[0] - first._segments[0]
        rows.append(
            Row(
                names[k],
                float(probabilities[k]),
                found[k].log_evidence,
                found[k].log_evidence - first.log_evidence,
                float(np.std(difference) * math.sqrt(len(difference))),
                scores[k] - scores[0] if scores else None,
                found[k].posterior,
            )
        )
    return Comparison(tuple(rows), dict(zip(names, zip(hypotheses, found, strict=True), strict=True)))


class _Shared:
    """What fits of the same records share.

    Attributes:
        most: ln p that any of them has reached, at a point that it flew; ``first`` is that of the first hypothesis.
        measured: record -> readings (n, p) in units of the noise, and what counts.
        moved: record -> the unknown motion, and gusts (n, p, q), likewise.
    """

    def __init__(self) -> None:
        self.most = self.first = -math.inf
        self.measured: dict[FlightRecord, tuple[FloatArray, Any]] = {}
        self.moved: dict[FlightRecord, tuple[Motion, FloatArray]] = {}

    @property
    def least(self) -> float:
        """Ln p that a fit must promise to be followed."""
        if not math.isfinite(self.first):
            return -math.inf
        return self.most - max(_HOPELESS, (1.0 - _LITTLE) * (self.most - self.first))


_Asks = tuple[Hypothesis, Sequence[Mapping[str, float]]]
_Run = Generator[_Asks, None, "_Fit"]
"""A fit on its way: gives (hypothesis, points) that it predicts next, and returns itself once it is at rest."""


def _together(runs: Sequence[_Run], fly: Callable[[Points], None]) -> list[_Fit]:
    """Bring fits to rest side by side, so that all that they predict next is flown together."""
    ended: dict[int, _Fit] = {}
    wanted: dict[int, _Asks] = {}

    def go_on(some: Iterable[int]) -> None:
        wanted.clear()
        for i in some:
            try:
                wanted[i] = next(runs[i])
            except StopIteration as end:
                ended[i] = end.value

    go_on(range(len(runs)))
    while wanted:
        fly([(hypothesis, x) for hypothesis, points in wanted.values() for x in points])
        go_on(list(wanted))
    return [ended[i] for i in range(len(runs))]


@dataclass(frozen=True, eq=False)
class _Fit:
    """A hypothesis at its best point, and the evidence over all sizes of the unknown motion there."""

    hypothesis: Hypothesis
    records: Sequence[FlightRecord]
    noise: Noise
    unknown: Unknown | None
    air: Pulses | None
    theta: FloatArray
    blocks: Sequence[Linearised]
    grams: Sequence[Grams]
    scales: FloatArray
    k: int = 0  # place in KAPPAS
    sized: Sized | None = None
    at: Mapping[int, float] = field(default_factory=dict)  # place in KAPPAS -> ln of the evidence there
    correction: float = 0.0  # of the evidence, by bounds and by importance samples
    effective: float = 1.0
    flown: dict[tuple[FlightRecord, bytes], FloatArray] = field(default_factory=dict)  # predictions; they cost most
    shared: _Shared = field(default_factory=_Shared)
    tangents: Sequence[Mapping[str, FloatArray]] | None = None  # of each record, those that are known, per deviation
    fresh: bool = False  # they were made where the fit is

    @classmethod
    def of(
        cls,
        hypothesis: Hypothesis,
        records: Sequence[FlightRecord],
        noise: Noise,
        unknown: Unknown | None,
        air: Pulses | None,
        shared: _Shared,
        scales: FloatArray | None = None,
    ) -> _Run:
        """Fit by Gauss and Newton's steps; noise scales come to rest where these do, from ``scales`` if they are given.

        A fit that promises far less than another has reached is not followed to its end.

        Beside an unknown motion the noise hardly depends on what the model lacks, so that few rounds of either do.
        """
        begin = np.array(list(hypothesis.first.values()))
        here = cls(hypothesis, records, noise, unknown, air, begin, (), (), np.ones(len(noise.std)), shared=shared)
        if hypothesis.slopes is not None:
            stated = np.array(list(noise.std.values()))
            known = [{n: s / stated for n, s in hypothesis.slopes(r).items()} for r in records]
            here = replace(here, tangents=known)
        here = yield from here._linearised(begin)
        here = here._at_rest() if scales is None else replace(here, scales=scales, k=here._best_of(scales))
        for _ in range(_REST):
            here = yield from here._started(shared)
            before, here = here.scales, here._at_rest()
            if np.max(np.abs(np.log(here.scales / before)), initial=0.0) < _SAME:
                break
        if hypothesis.form is not None:
            here = yield from here._linearised(here.theta, fresh=here.fresh)
        here = here._judged()
        if KAPPAS[here.k] > WHOLE and here.promised > shared.most - _HOPELESS:
            # A large unknown motion does what the parameters have left undone: they go on where it is small.
            small = replace(here, k=max(j for j in here._every if KAPPAS[j] <= WHOLE), fresh=here.tangents is None)
            there = yield from small._started(shared, beyond=here.promised)
            there = there._at_rest()
            if hypothesis.form is not None:
                there = yield from there._linearised(there.theta, fresh=there.fresh)
            here = max(here, there._judged(), key=lambda f: f.log_evidence)
        return here._bounded()

    def _started(self, shared: _Shared, beyond: float | None = None) -> _Run:
        """Return the fit at the best point, see :meth:`_descended`, with flights that begin where they suit it.

        Starts are fitted to all that is left: a large unknown motion would be in it, and does what they leave undone.
        """
        here = yield from self._descended(shared, beyond)
        for _ in range(_REST):
            if here.hypothesis.begun is None or KAPPAS[here.k] > WHOLE or here.promised < shared.most - _REACH:
                break
            begun = here.hypothesis.begun(here.hypothesis.at(here.theta))
            if begun is None:
                break
            there = yield from replace(here, hypothesis=begun, flown={})._linearised(here.theta, form=False)
            if there.promised < here.promised + _BEGUN:
                break
            here = yield from there._descended(shared, beyond)
        return here

    def _judged(self) -> _Fit:
        """Return the fit with its evidence for every size of the unknown motion."""
        assert self.sized is not None
        # Where the descent stopped before it was at rest, what another step promises is none of its evidence.
        more = self.sized.price - max(self._step()[1], 0.0)
        every = {j: self._reduced(self.scales, j).log_evidence(self._offset, self._std) for j in self._every}
        return replace(self, at={j: density + more for j, density in every.items()})

    @property
    def _every(self) -> range:
        return range(len(KAPPAS) if self.unknown is not None else 1)

    def _reduced(self, scales: FloatArray, k: int) -> Reduced:
        return reduced(self.grams, scales, KAPPAS[k])

    def _best_of(self, scales: FloatArray, places: Sequence[int] | None = None) -> int:
        """Return the most probable place of kappa at these scales."""
        prior = _log_prior([KAPPAS[j] for j in self._every])

        def density(j: int) -> float:
            return self._reduced(scales, j).log_evidence(self._offset, self._std) + float(prior[j])

        return max(self._every if places is None else places, key=density)

    def _at_rest(self) -> _Fit:
        """Return the fit with noise scales at rest at the most probable kappa."""
        k, scales, found = self.k, self.scales, self.sized
        for _ in range(_REST):
            found = sized(self.grams, self._offset, self._std, self.noise.spread, KAPPAS[k], scales)
            scales, before = found.scales, k
            k = self._best_of(scales)
            if k == before:
                break
        assert found is not None
        return replace(self, k=k, scales=scales, sized=found)

    @property
    def promised(self) -> float:
        """Ln p that the linear model promises at its best point, but for a constant of the records."""
        return self._reduced(self.scales, self.k).log_evidence(self._offset, self._std)

    def _descended(self, shared: _Shared, beyond: float | None = None) -> _Run:
        """Return the fit at the best point for its noise scales.

        Where it has to come ``beyond`` a promise, it holds its size of the unknown motion, and ends once it would not
        come near if all rounds that are left gained as much as the promise moved in the last one.
        """
        here, hold, last = self, beyond is not None, -math.inf
        for done in range(_ROUNDS):
            step, promised = here._step()
            reach, last = here.promised + (_ROUNDS - done) * abs(here.promised - last), here.promised
            if beyond is not None and done >= _PATIENCE and reach < beyond - _HOPELESS:
                break
            shared.most = max(shared.most, here.promised - promised)
            far = not hold and here.promised < shared.most - _HOPELESS
            if done >= _PATIENCE and not hold and here.promised < shared.least:
                break
            if promised < _AT_REST:
                if here.fresh or far:
                    break
                here = yield from here._linearised(here.theta, form=False, fresh=True)
                continue
            there, before = None, here._log_joint(here.theta)
            for share in _SHARES:
                theta = np.clip(here.theta + share * step, here._low, here._high)
                # A whole step hardly ever fails, and its neighbours are flown with it: a few more cost a batch nothing.
                few = here._beside(theta)[0].values() if share == 1.0 else ()
                yield here._wanted([theta, *few])
                if here._log_joint(theta) > before + 1e-3 * promised * share:
                    there = theta
                    break
            if there is None:
                if here.fresh or far:
                    break
                here = yield from here._linearised(here.theta, form=False, fresh=True)
                continue
            kept = here.fresh and promised < _NEARBY
            here = replace((yield from here._linearised(there, form=False)), fresh=kept or here.tangents is None)
            near = [here.k] if hold else [j for j in (here.k - 1, here.k, here.k + 1) if j in here._every]
            here = replace(here, k=here._best_of(here.scales, near))
        return here

    def _wanted(self, points: Sequence[FloatArray]) -> _Asks:
        """Return what is predicted next."""
        return self.hypothesis, [self.hypothesis.at(x) for x in points]

    @cached_property
    def log_weights(self) -> dict[int, float]:
        """Place in KAPPAS -> ln of the evidence there and of the prior of kappa."""
        prior = _log_prior([KAPPAS[j] for j in self._every])
        return {j: density + float(prior[j]) for j, density in self.at.items()}

    @property
    def _low(self) -> FloatArray:
        return np.array([p.low for p in self.hypothesis.parameters])

    @property
    def _high(self) -> FloatArray:
        return np.array([p.high for p in self.hypothesis.parameters])

    @property
    def _std(self) -> FloatArray:
        return deviations_of(self.hypothesis.parameters)

    @property
    def _log_held(self) -> float:
        """Ln of the prior probability that the parameters lie within their bounds."""
        prior = means_of(self.hypothesis.parameters)
        held = norm.cdf((self._high - prior) / self._std) - norm.cdf((self._low - prior) / self._std)
        return float(np.sum(np.log(held)))

    @property
    def _offset(self) -> FloatArray:
        """Prior means less the point that the columns belong to."""
        return means_of(self.hypothesis.parameters) - self.theta

    def _predicted(self, record: FlightRecord, theta: FloatArray) -> FloatArray:
        key = record, theta.tobytes()
        if key not in self.flown:
            y = np.asarray(self.hypothesis.predict(record, self.hypothesis.at(theta)), dtype=float)
            wanted = (len(record), len(self.noise.channels))
            if y.shape != wanted:
                raise EstimationError(
                    f"'{self.hypothesis.name}' must predict {wanted} samples and channels, got {y.shape}"
                )
            self.flown[key] = y / np.array(list(self.noise.std.values()))
        return self.flown[key]

    def _measured(self, record: FlightRecord) -> tuple[FloatArray, Any]:
        if record not in self.shared.measured:
            at = [record.channels.index(c) for c in self.noise.channels]
            z = np.column_stack([record[c] for c in self.noise.channels]) / np.array(list(self.noise.std.values()))
            self.shared.measured[record] = z, record.valid[:, at]
        return self.shared.measured[record]

    def _linearised(self, theta: FloatArray, form: bool = True, fresh: bool = False) -> _Run:
        """Return the fit about a point, with the form error there or, to save flights, as it was before.

        Tangents that are known are taken, also from another point, until a step fails or none is left to take: then
        those of a fit that is not far behind are made afresh.
        """
        known: Sequence[Mapping[str, FloatArray]] = [{}] * len(self.records)
        if self.tangents is not None and not fresh:
            known = self.tangents
        beside, steps = self._beside(theta, fresh)
        yield self._wanted([theta, *beside.values()])
        blocks = []
        stated = np.array(list(self.noise.std.values()))
        for number, (record, slopes) in enumerate(zip(self.records, known, strict=True)):
            y, (z, valid) = self._predicted(record, theta), self._measured(record)
            columns = np.empty((*y.shape, len(theta)))
            for i, p in enumerate(self.hypothesis.parameters):
                if i in beside:
                    columns[:, :, i] = np.nan_to_num((self._predicted(record, beside[i]) - y) / steps[i])
                else:
                    columns[:, :, i] = slopes[p.name]
            U, own = self._of_record(record)
            if self.hypothesis.form is not None and not form and self.blocks:
                own = self.blocks[number].all_own
            elif self.hypothesis.form is not None:
                t = record.t_s - record.t_s[0]
                knots = np.arange(0.0, t[-1] + _FORM_S, _FORM_S)
                hats = np.maximum(0.0, 1.0 - np.abs(t[:, None] - knots) / _FORM_S)
                signature = self.hypothesis.form(record, self.hypothesis.at(theta)) / stated
                own = np.concatenate([own, signature[:, :, None] * hats[:, None, :]], axis=2)
            blocks.append(Linearised(np.where(valid, z - y, 0.0), columns, U, valid, own))
        kept = self.grams if self.grams and (self.hypothesis.form is None or not form) else [None] * len(blocks)
        same = [i for i in range(len(theta)) if i not in beside]  # their tangents are known, and so are their sums
        sums = [Grams.made(block, before, same) for block, before in zip(blocks, kept, strict=True)]
        tangents = self.tangents
        if fresh and tangents is not None:
            names = [p.name for p in self.hypothesis.parameters]
            tangents = [{n: b.columns[:, :, names.index(n)] for n in tangents[0]} for b in blocks]
        fresh = fresh or tangents is None
        return replace(self, theta=theta, blocks=blocks, grams=sums, tangents=tangents, fresh=fresh)

    def _beside(self, theta: FloatArray, fresh: bool = False) -> tuple[dict[int, FloatArray], list[float]]:
        """Return parameter -> neighbour of a point (k,), of those whose tangents are differences, and all steps."""
        parameters = self.hypothesis.parameters
        steps = [
            p.difference if t + p.difference <= p.high else -p.difference
            for t, p in zip(theta, parameters, strict=True)
        ]
        known = [] if self.tangents is None or fresh else self.tangents
        wanted = [i for i, p in enumerate(parameters) if not known or any(p.name not in k for k in known)]
        return {i: theta + steps[i] * (np.arange(len(theta)) == i) for i in wanted}, steps

    def _of_record(self, record: FlightRecord) -> tuple[Motion, FloatArray]:
        """Return the unknown motion and gusts (n, p, q) of a record, in units of the noise, made once for all."""
        known = self.shared.moved
        if record not in known:
            stated = np.array(list(self.noise.std.values()))
            taken, own = self._measured(record)[1], np.zeros((len(record), len(stated), 0))
            U = Motion.none(taken)
            if self.unknown is not None:
                moved = self.unknown(record)
                U = moved if isinstance(moved, Motion) else fewer(moved / stated[:, None], taken)
            if self.air is not None:
                own = self.air(record) / stated[:, None]
            known[record] = U, own
        return known[record]

    def _step(self) -> tuple[FloatArray, float]:
        """Return the step to the best point of the linear model, and what it promises in ln p."""
        found = self._reduced(self.scales, self.k)
        H, g = found.A + np.diag(self._std**-2.0), found.b + self._offset / self._std**2
        low, high = self._low - self.theta, self._high - self.theta
        step, free = np.zeros(len(g)), np.ones(len(g), dtype=bool)
        while free.any():  # what would leave its bounds stays at them, and the others go along
            step[free] = np.linalg.solve(H[np.ix_(free, free)], g[free] - H[np.ix_(free, ~free)] @ step[~free])
            beyond = free & ((step < low) | (step > high))
            if not beyond.any():
                break
            step = np.where(beyond, np.clip(step, low, high), step)
            free &= ~beyond
        return step, float(g @ step - 0.5 * step @ H @ step)

    def _log_joint(self, theta: FloatArray) -> float:
        """Return ln p(y, theta) but for constants, predicted at theta, at the scales and the kappa of the fit."""
        grams = []
        for record, block, sums in zip(self.records, self.blocks, self.grams, strict=True):
            y, (z, valid) = self._predicted(record, theta), self._measured(record)
            if not np.all(np.isfinite(y[valid])):
                return -math.inf
            grams.append(sums.left_by(block, z - y))
        c = reduced(grams, self.scales, KAPPAS[self.k]).c
        return -0.5 * (c + float(np.sum(((theta - means_of(self.hypothesis.parameters)) / self._std) ** 2)))

    def _bounded(self) -> _Fit:
        """Return the fit with its evidence multiplied by the posterior probability of the bounds over the prior one."""
        if not self.hypothesis.parameters:
            return self
        centre, covariance = self._gaussian()
        errors = np.sqrt(np.diag(covariance))
        mass = norm.cdf((self._high - centre) / errors) - norm.cdf((self._low - centre) / errors)
        return replace(self, correction=float(np.sum(np.log(np.maximum(mass, 1e-12)))) - self._log_held)

    def _gaussian(self) -> tuple[FloatArray, FloatArray]:
        """Return centre and covariance of the posterior of the linear model."""
        mean, covariance = self._reduced(self.scales, self.k).posterior(self._offset, self._std)
        return self.theta + mean, covariance

    def sampled(self, samples: int) -> _Run:
        """Return the fit with its evidence by importance sampling, where the posterior is far from Gaussian."""
        if not self.hypothesis.parameters:
            return self
        centre, covariance = self._gaussian()
        errors = np.sqrt(np.diag(covariance))
        top = self._log_joint(self.theta)
        ends = [self.theta + sign * covariance[:, i] / errors[i] for i in range(len(centre)) for sign in (1.0, -1.0)]
        ends = [x for x in ends if np.all((x >= self._low) & (x <= self._high))]
        yield self._wanted(ends)
        worst = max((abs(self._log_joint(x) - top + 0.5) for x in ends), default=0.0)
        if worst <= _SKEW:
            return self
        rng = np.random.default_rng(0)
        root = np.linalg.cholesky(covariance + 1e-12 * np.diag(errors**2))
        draws = rng.standard_normal((samples, len(centre)))
        wide = rng.chisquare(5.0, samples) / 5.0  # Student's t: no tail of the posterior is without samples
        logs = np.full(samples, -np.inf)
        d = len(centre)
        scaled = draws / np.sqrt(wide)[:, None]
        points = centre + scaled @ root.T
        held = np.all((points >= self._low) & (points <= self._high), axis=1)
        yield self._wanted(list(points[held]))
        for s, (z, theta) in enumerate(zip(scaled, points, strict=True)):
            if held[s]:
                proposal = -0.5 * (5.0 + d) * math.log1p(z @ z / 5.0)
                logs[s] = self._log_joint(theta) - top - proposal
        log_t = math.lgamma(0.5 * (5 + d)) - math.lgamma(2.5) - 0.5 * d * math.log(5.0 * math.pi)
        log_normal = -0.5 * d * math.log(2.0 * math.pi)
        if not np.any(np.isfinite(logs)):
            return replace(self, effective=0.0)
        gain = float(logsumexp(logs) - math.log(samples)) - log_t + log_normal
        weights = np.exp(logs - logsumexp(logs))
        correction = gain - self._log_held
        return replace(self, correction=correction, effective=float(1.0 / np.sum(weights**2)) / samples)

    @property
    def log_evidence(self) -> float:
        """ln p(records | hypothesis)."""
        stated = np.log(list(self.noise.std.values()))
        taken = sum(float(b.taken.sum(axis=0) @ stated) for b in self.blocks)
        return float(logsumexp(list(self.log_weights.values()))) - taken + self.correction

    @cached_property
    def _left(self) -> list[tuple[FloatArray, Any]]:
        """Return of each record what is left (n, p), in units of the noise that was found, and what counts."""
        kappa, scales = KAPPAS[self.k], self.scales
        out = []
        for block, sums in zip(self.blocks, self.grams, strict=True):
            D, factor, _ = sums.inner(scales, kappa)
            d = D * cho_solve(factor, D * (scales**-2.0 @ sums.across[:, : len(D), -1])) if len(D) else D
            own, moved = d[: sums.q], d[sums.q :]
            left = block.residual - block.all_own @ own - (block.unknown.response[:, :, : len(moved)] @ moved).T
            out.append((np.where(block.taken, left / scales, 0.0), block.taken))
        return out

    @cached_property
    def _segments(self) -> tuple[FloatArray, FloatArray]:
        """Return of segments of one second ln p (s,) but for a constant, and its gradient by the parameters (s, k)."""
        logs, gradients = [], []
        for record, block, sums in zip(self.records, self.blocks, self.grams, strict=True):
            left, columns = whitened(block, sums, self.scales, KAPPAS[self.k])
            starts = np.arange(0, len(record), max(1, round(_SEGMENT_S / record.dt_s)))
            each = -0.5 * left**2 - np.where(block.taken, np.log(self.scales), 0.0)
            logs.append(np.add.reduceat(each.sum(axis=1), starts))
            gradients.append(np.add.reduceat(np.einsum("npk,np->nk", columns, left), starts))
        return np.concatenate(logs), np.concatenate(gradients)

    @cached_property
    def misfit(self) -> tuple[float, FloatArray]:
        """Return how much the likelihood overstates what the records say, and the same of each parameter (k,), squared.

        The gradients of ln p of a model that is right scatter from segment to segment as its curvature says (the
        information equality). Where they scatter by more, errors are those of the sandwich (H. White, 1982; P. J.
        Huber, 1967), and differences of ln p are divided by the mean ratio of the two (F. Pauli, W. Racugno, L.
        Ventura, 2011, of composite likelihoods). Few segments tell little, so that the ratio is drawn to 1.
        """
        k = len(self.theta)
        if not k:
            return 1.0, np.ones(0)
        covariance, (logs, g) = self._gaussian()[1], self._segments
        A, scatter = self._reduced(self.scales, self.k).A, g.T @ g
        n = len(logs)
        excess = np.einsum("ij,jk,ki->i", covariance, scatter - A, covariance) / np.diag(covariance)
        told = max(float(np.trace(covariance @ A)), 1e-9)
        mean = 1.0 + float(np.trace(covariance @ (scatter - A))) / told
        drawn = n / (n + _WORTH)
        return max(1.0, 1.0 + drawn * (mean - 1.0)), np.maximum(1.0, 1.0 + drawn * excess)

    def score(self, records: Sequence[FlightRecord]) -> float:
        """Return ln p of records that were not used, a sample, at the best point."""
        grams = []
        for record in records:
            y, (z, valid) = self._predicted(record, self.theta), self._measured(record)
            U, own = self._of_record(record)
            grams.append(Grams.made(Linearised(np.where(valid, z - y, 0.0), np.zeros((*y.shape, 0)), U, valid, own)))
        found = reduced(grams, self.scales, KAPPAS[self.k])
        return -0.5 * (math.log(2.0 * math.pi) + (found.log_det + found.c) / found.samples)

    @cached_property
    def posterior(self) -> Posterior:
        """Return what the records say of the parameters."""
        assert self.sized is not None
        inflation = np.sqrt(self.misfit[1])
        covariance = inflation[:, None] * self._gaussian()[1] * inflation
        values = self.theta
        total = logsumexp(list(self.log_weights.values()))
        whiteness = _whiteness(self._left)
        whole = sum(math.exp(w - total) for j, w in self.log_weights.items() if KAPPAS[j] <= WHOLE)
        sizes, densities = [KAPPAS[j] for j in self.at], np.array(list(self.at.values()))
        log_whole, log_part = (float(x) for x in whole_and_part(densities, sizes) + (self.log_evidence - total))
        doubts = []
        if whiteness < WHITE:
            doubts.append(f"what is left is coloured (noise would be so with a probability of {whiteness:.1g})")
        if self.effective < 0.1:
            doubts.append(f"only {100 * self.effective:.0f} % of the samples of its posterior count")
        at_bound = [
            p.name
            for p, v, e in zip(self.hypothesis.parameters, values, np.sqrt(np.diag(covariance)), strict=True)
            if min(v - p.low, p.high - v) < 0.1 * e
        ]
        if self.misfit[0] > _OVERSTATES:
            times = math.sqrt(self.misfit[0])
            doubts.append(f"what is left is no white noise: errors are {times:.2g} times what they were if it were")
        if at_bound:
            doubts.append(f"{', '.join(at_bound)} rests at the end of what is possible")
        return Posterior(
            self.hypothesis.parameters,
            values,
            covariance,
            dict(
                zip(
                    self.noise.channels,
                    zip(self.scales.tolist(), (self.scales * self.sized.log_errors).tolist(), strict=True),
                    strict=True,
                )
            ),
            KAPPAS[self.k],
            self.log_evidence,
            log_whole,
            log_part,
            whole,
            whiteness,
            float(np.sum(((values - means_of(self.hypothesis.parameters)) / self._std) ** 2)),
            self.effective,
            self.misfit[0],
            inflation,
            tuple(doubts),
        )


def whole_and_part(density: FloatArray, kappas: Sequence[float] = KAPPAS) -> FloatArray:
    """Return ln p (2, ...) if a hypothesis is the whole story, and if it is a part, of ln p (kappas, ...) by size."""
    whole = np.array(kappas) <= WHOLE
    return np.array(
        [
            logsumexp(density[some], axis=0) - math.log(np.count_nonzero(some))
            if some.any()
            else np.full(density.shape[1:], -math.inf)
            for some in (whole, ~whole)
        ]
    )


def _log_prior(kappas: Sequence[float]) -> FloatArray:
    """Return ln of the prior (kappas,) of the unknown motion: whole or part, all sizes of each alike."""
    k = np.array(kappas)
    whole = k <= WHOLE
    if whole.all():
        return np.full(len(k), -math.log(len(k)))
    return np.where(whole, math.log(P_WHOLE / whole.sum()), math.log((1.0 - P_WHOLE) / max((~whole).sum(), 1)))


def _whiteness(left: Sequence[tuple[FloatArray, Any]]) -> float:
    """Return the probability that white noise has autocorrelations as large (G. M. Ljung, G. E. P. Box, 1978).

    The least of all channels is multiplied by their number (Bonferroni).
    """
    p = left[0][0].shape[1]
    least = 1.0
    for c in range(p):
        products, squares, count = np.zeros(_LAGS), 0.0, 0
        for values, taken in left:
            v = values[:, c] - (values[taken[:, c], c].mean() if taken[:, c].any() else 0.0)
            v = np.where(taken[:, c], v, 0.0)
            squares += float(v @ v)
            count += int(taken[:, c].sum())
            products += [float(v[lag:] @ v[:-lag]) for lag in range(1, _LAGS + 1)]
        if count <= 2 * _LAGS or squares == 0.0:
            continue
        r = products / squares
        Q = count * (count + 2) * float(np.sum(r**2 / (count - np.arange(1, _LAGS + 1))))
        least = min(least, float(chi2.sf(Q, _LAGS)))
    return min(1.0, p * least)
