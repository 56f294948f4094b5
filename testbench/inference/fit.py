"""Fit of one hypothesis to measured records: its best point, what they say of its parameters, and its evidence.

A hypothesis predicts what the sensors read, from parameters with priors. Noise scales and an unknown motion of free
size belong to all of them, so that no threshold of chi-square decides: a hypothesis that leaves something needs an
unknown motion beside it, and pays for it. The fit takes Gauss and Newton's steps; fits side by side give what they
predict next, so that it is flown together.

The evidence of a hypothesis is that of its linearisation at the best point (Laplace's approximation), times the
probability that lies within the bounds of its parameters. Where flights one standard error away show that the
posterior is not Gaussian, it is corrected by importance sampling; the effective number of samples stands beside it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from scipy.linalg import cho_solve
from scipy.special import logsumexp
from scipy.stats import chi2, norm

from testbench.core.constants import WHITE
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
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
from testbench.inference.parameters import Noise, Parameter, deviations_of

Predict = Callable[[FlightRecord, Mapping[str, float]], FloatArray]
"""(record, parameter -> value) -> what the channels would have read, (n, channels), SI, without noise."""
Unknown = Callable[[FlightRecord], FloatArray | Motion]
"""record -> what pulses of an unknown motion do to the channels, (n, channels, m), SI, see :mod:`.unknown`; or its
principal directions, in units of the noise."""
Slopes = Callable[[FlightRecord], Mapping[str, FloatArray]]
"""record -> parameter -> change of the prediction by one unit of it, (n, channels), SI."""
Points = Sequence[tuple["Hypothesis", Mapping[str, float]]]
"""(hypothesis, its parameter -> value), of all that is predicted next, so that it can be flown together."""


class Keeper(Protocol):
    """Keeps fits that came to rest together, as JSON values: a search that was interrupted goes on from them."""

    def known(self, group: str) -> Any:
        """Return what was kept of the group that comes next, whose name tells all that its fits begin with; or None."""

    def keep(self, group: str, content: Any) -> None:
        """Keep a group that is at rest."""


WHOLE = 1e-3  #: size of the unknown motion up to which a hypothesis is the whole story; beyond it is a part
P_WHOLE = 0.5  #: prior probability that a hypothesis, if it is true, is the whole story
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
_CREEPS = 0.25  # share of what the round before promised, beyond which tangents are made afresh
_NEARBY = 1.0  # in ln p: tangents made afresh hold beyond a step that promises less
_SKEW = 0.2  # in ln p at one standard error: beyond it the posterior is sampled
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
        more: further such beginnings, tried while no hypothesis is the whole story, but for those that an earlier fit
            came by; the best fit of all is kept.
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

    @cached_property
    def mean(self) -> FloatArray:
        """Means of the priors (k,)."""
        return np.array([p.value for p in self.parameters])

    @cached_property
    def std(self) -> FloatArray:
        """Standard deviations of the priors (k,)."""
        return deviations_of(self.parameters)

    @cached_property
    def low(self) -> FloatArray:
        """Least values that are possible (k,)."""
        return np.array([p.low for p in self.parameters])

    @cached_property
    def high(self) -> FloatArray:
        """Largest values that are possible (k,)."""
        return np.array([p.high for p in self.parameters])

    def held(self, mean: FloatArray, std: FloatArray) -> FloatArray:
        """Return the probability (k,) of what is possible, of Gaussian parameters."""
        return norm.cdf((self.high - mean) / std) - norm.cdf((self.low - mean) / std)

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


@dataclass(eq=False)
class Data:
    """Measured records and all that hypotheses about them share."""

    records: Sequence[FlightRecord]  #: measured
    noise: Noise  #: of the channels that are compared
    unknown: Unknown | None = None  #: see :func:`.compare_hypotheses`
    #: ln p that any fit has reached, at a point that it flew; ``first`` is that of the first hypothesis
    most: float = -math.inf
    first: float = -math.inf
    _readings: dict[FlightRecord, tuple[FloatArray, Any]] = field(default_factory=dict, repr=False)
    _motions: dict[FlightRecord, Motion] = field(default_factory=dict, repr=False)

    @cached_property
    def stated(self) -> FloatArray:
        """Stated standard deviations of the noise (p,)."""
        return np.array(list(self.noise.std.values()))

    @property
    def sizes(self) -> range:
        """Places in KAPPAS that an unknown motion may have."""
        return range(len(KAPPAS) if self.unknown is not None else 1)

    @property
    def least(self) -> float:
        """Ln p that a fit must promise to be followed."""
        if not math.isfinite(self.first):
            return -math.inf
        return self.most - max(_HOPELESS, (1.0 - _LITTLE) * (self.most - self.first))

    def readings(self, record: FlightRecord) -> tuple[FloatArray, Any]:
        """Return readings (n, p) of a record in units of the noise, and what counts."""
        if record not in self._readings:
            at = [record.channels.index(c) for c in self.noise.channels]
            z = np.column_stack([record[c] for c in self.noise.channels]) / self.stated
            self._readings[record] = z, record.valid[:, at]
        return self._readings[record]

    def motion(self, record: FlightRecord) -> Motion:
        """Return the unknown motion of a record, in units of the noise, made once for all."""
        if record not in self._motions:
            taken = self.readings(record)[1]
            moved = Motion.none(taken) if self.unknown is None else self.unknown(record)
            self._motions[record] = moved if isinstance(moved, Motion) else fewer(moved / self.stated[:, None], taken)
        return self._motions[record]


_SCALARS = ("kappa", "log_evidence", "log_whole", "log_part", "p_whole", "whiteness", "strain", "effective", "misfit")
_ARRAYS = ("values", "covariance", "inflation")  #: of a posterior
Asks = tuple[Hypothesis, Sequence[Mapping[str, float]]]
Run = Generator[Asks, None, "Fit"]
"""A fit on its way: gives (hypothesis, points) that it predicts next, and returns itself once it is at rest."""


def fit_together(runs: Sequence[Run], fly: Callable[[Points], None]) -> list[Fit]:
    """Bring fits to rest side by side, so that all that they predict next is flown together."""
    ended: dict[int, Fit] = {}
    wanted: dict[int, Asks] = {}

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
class Fit:
    """A hypothesis at its best point, and the evidence over all sizes of the unknown motion there."""

    hypothesis: Hypothesis
    data: Data
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
    tangents: Sequence[Mapping[str, FloatArray]] | None = None  # of each record, those that are known, per deviation
    fresh: bool = False  # they were made where the fit is
    moved: tuple[FloatArray, ...] = ()  # points at which flights were begun anew

    def told(self) -> dict[str, Any]:
        """Return all that is asked of a fit at rest, as JSON values; floats keep every digit."""
        if not math.isfinite(self.log_evidence):  # it cannot fly where it ended: no other is worse, nothing is asked
            return {"log_evidence": self.log_evidence}
        p, (logs, gradients) = self.posterior, self.segments
        own = {name: getattr(p, name) for name in _SCALARS} | {name: getattr(p, name).tolist() for name in _ARRAYS}
        return {
            "theta": self.theta.tolist(), "moved": [x.tolist() for x in self.moved], "scales": self.scales.tolist(),
            "k": self.k, "at": list(self.at.items()), "correction": self.correction, "effective": self.effective,
            "log_evidence": self.log_evidence, "misfit": [self.misfit[0], self.misfit[1].tolist()],
            "segments": [logs.tolist(), gradients.tolist()], "noise": p.noise, "doubts": p.doubts, "posterior": own,
        }  # fmt: skip

    @classmethod
    def again(cls, told: Mapping[str, Any], hypothesis: Hypothesis, data: Data) -> Fit:
        """Return a fit at rest from what :meth:`told` said of it; its flights begin where they did."""
        if "theta" not in told:
            return cls._lost(hypothesis, data, told["log_evidence"])
        moved = tuple(np.array(x) for x in told["moved"])
        for x in moved:
            hypothesis = (hypothesis.begun and hypothesis.begun(hypothesis.at(x))) or hypothesis
        here = cls(
            hypothesis, data, np.array(told["theta"]), (), (), np.array(told["scales"]), told["k"],
            None, dict(told["at"]), told["correction"], told["effective"], moved=moved,
        )  # fmt: skip
        k, own = len(told["theta"]), told["posterior"]
        arrays = {n: np.array(own[n]).reshape((k, k) if n == "covariance" else k) for n in _ARRAYS}
        found: dict[str, Any] = {"parameters": hypothesis.parameters, "doubts": tuple(told["doubts"]), **arrays}
        found |= {"noise": {n: tuple(v) for n, v in told["noise"].items()}, **{n: own[n] for n in _SCALARS}}
        logs, gradients = told["segments"]
        here.__dict__.update(
            log_evidence=told["log_evidence"],
            misfit=(told["misfit"][0], np.array(told["misfit"][1])),
            segments=(np.array(logs), np.array(gradients).reshape(len(logs), k)),
            posterior=Posterior(**found),
        )
        return here

    @classmethod
    def _lost(cls, hypothesis: Hypothesis, data: Data, log_evidence: float = -math.inf) -> Fit:
        """Return a fit that cannot fly: no other is worse, and nothing is asked of it."""
        begin = np.array(list(hypothesis.first.values()))
        lost = cls(hypothesis, data, begin, (), (), np.ones(len(data.stated)))
        lost.__dict__["log_evidence"] = log_evidence
        return lost

    @classmethod
    def of(cls, hypothesis: Hypothesis, data: Data, scales: FloatArray | None = None) -> Run:
        """Fit by Gauss and Newton's steps; noise scales come to rest where these do, from ``scales`` if they are given.

        A fit that promises far less than another has reached is not followed to its end.

        Beside an unknown motion the noise hardly depends on what the model lacks, so that few rounds of either do.
        """
        begin = np.array(list(hypothesis.first.values()))
        here = cls(hypothesis, data, begin, (), (), np.ones(len(data.stated)))
        if hypothesis.slopes is not None:
            known = [{n: s / data.stated for n, s in hypothesis.slopes(r).items()} for r in data.records]
            here = replace(here, tangents=known)
        here = yield from here._linearised(begin)
        if not all(np.isfinite(b.residual).all() for b in here.blocks):
            return cls._lost(hypothesis, data)
        here = here._at_rest() if scales is None else replace(here, scales=scales, k=here._best_of(scales))
        for _ in range(_REST):
            here = yield from here._started()
            before, here = here.scales, here._at_rest()
            if np.max(np.abs(np.log(here.scales / before)), initial=0.0) < _SAME:
                break
        if hypothesis.form is not None:
            here = yield from here._linearised(here.theta, fresh=here.fresh)
        here = here._judged()
        if KAPPAS[here.k] > WHOLE and here.promised > data.most - _HOPELESS:
            # A large unknown motion does what the parameters have left undone: they go on where it is small.
            small = replace(here, k=max(j for j in data.sizes if KAPPAS[j] <= WHOLE), fresh=here.tangents is None)
            there = yield from small._started(beyond=here.promised)
            there = there._at_rest()
            if hypothesis.form is not None:
                there = yield from there._linearised(there.theta, fresh=there.fresh)
            here = max(here, there._judged(), key=lambda f: f.log_evidence)
        if not hypothesis.parameters:
            return here
        centre, covariance = here._gaussian()  # of which what is possible counts, over what was so a priori
        mass = hypothesis.held(centre, np.sqrt(np.diag(covariance)))
        return replace(here, correction=float(np.sum(np.log(np.maximum(mass, 1e-12)))) - here._log_held)

    def _started(self, beyond: float | None = None) -> Run:
        """Return the fit at the best point, see :meth:`_descended`, with flights that begin where they suit it.

        Starts are fitted to all that is left: a large unknown motion would be in it, and does what they leave undone.
        """
        here = yield from self._descended(beyond)
        for _ in range(_REST):
            if here.hypothesis.begun is None or KAPPAS[here.k] > WHOLE or here.promised < self.data.most - _REACH:
                break
            begun = here.hypothesis.begun(here.hypothesis.at(here.theta))
            if begun is None:
                break
            there = yield from replace(here, hypothesis=begun, flown={})._linearised(here.theta, form=False)
            if there.promised < here.promised + _BEGUN:
                break
            here = replace((yield from there._descended(beyond)), moved=(*here.moved, here.theta))
        return here

    def _judged(self) -> Fit:
        """Return the fit with its evidence for every size of the unknown motion."""
        assert self.sized is not None
        # Where the descent stopped before it was at rest, what another step promises is none of its evidence.
        more = self.sized.price - max(self._step()[1], 0.0)
        return replace(self, at={j: self._density(self.scales, j) + more for j in self.data.sizes})

    def _reduced(self, scales: FloatArray, k: int) -> Reduced:
        return reduced(self.grams, scales, KAPPAS[k])

    def _density(self, scales: FloatArray, k: int) -> float:
        """Return ln p of the linear model at its best point, but for a constant of the records."""
        return self._reduced(scales, k).log_evidence(self._offset, self.hypothesis.std)

    def _best_of(self, scales: FloatArray, places: Sequence[int] | None = None) -> int:
        """Return the most probable place of kappa at these scales."""
        prior = _log_prior([KAPPAS[j] for j in self.data.sizes])

        some = self.data.sizes if places is None else places
        return max(some, key=lambda j: self._density(scales, j) + float(prior[j]))

    def _at_rest(self) -> Fit:
        """Return the fit with noise scales at rest at the most probable kappa."""
        k, scales, found = self.k, self.scales, self.sized
        for _ in range(_REST):
            found = sized(self.grams, self._offset, self.hypothesis.std, self.data.noise.spread, KAPPAS[k], scales)
            scales, before = found.scales, k
            k = self._best_of(scales)
            if k == before:
                break
        assert found is not None
        return replace(self, k=k, scales=scales, sized=found)

    @property
    def promised(self) -> float:
        """Ln p that the linear model promises at its best point, but for a constant of the records."""
        return self._density(self.scales, self.k)

    def _descended(self, beyond: float | None = None) -> Run:
        """Return the fit at the best point for its noise scales.

        Where it has to come ``beyond`` a promise, it holds its size of the unknown motion, and ends once it would not
        come near if all rounds that are left gained as much as the promise moved in the last one.
        """
        here, data, hold, last = self, self.data, beyond is not None, -math.inf
        promises = {self.k: math.inf}  # of the round before, by its size of the unknown motion
        for done in range(_ROUNDS):
            step, promised = here._step()
            reach, last = here.promised + (_ROUNDS - done) * abs(here.promised - last), here.promised
            if beyond is not None and done >= _PATIENCE and reach < beyond - _HOPELESS:
                break
            data.most = max(data.most, here.promised - promised)
            far = not hold and here.promised < data.most - _HOPELESS
            if done >= _PATIENCE and not hold and here.promised < data.least:
                break
            # A fit with tangents of elsewhere creeps: its rounds would end before it is at rest.
            creeps = not far and not here.fresh and promised > _CREEPS * promises.get(here.k, math.inf)
            promises = {here.k: promised}
            if promised < _AT_REST or creeps:
                if here.fresh or far:
                    break
                here = yield from here._linearised(here.theta, form=False, fresh=True)
                continue
            there, before = None, here._log_joint(here.theta)
            for share in _SHARES:
                theta = np.clip(here.theta + share * step, here.hypothesis.low, here.hypothesis.high)
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
            near = [here.k] if hold else [j for j in (here.k - 1, here.k, here.k + 1) if j in data.sizes]
            here = replace(here, k=here._best_of(here.scales, near))
        return here

    def _wanted(self, points: Sequence[FloatArray]) -> Asks:
        """Return what is predicted next."""
        return self.hypothesis, [self.hypothesis.at(x) for x in points]

    @cached_property
    def log_weights(self) -> dict[int, float]:
        """Place in KAPPAS -> ln of the evidence there and of the prior of kappa."""
        prior = _log_prior([KAPPAS[j] for j in self.data.sizes])
        return {j: density + float(prior[j]) for j, density in self.at.items()}

    @property
    def _offset(self) -> FloatArray:
        """Prior means less the point that the columns belong to."""
        return self.hypothesis.mean - self.theta

    def _predicted(self, record: FlightRecord, theta: FloatArray) -> FloatArray:
        key = record, theta.tobytes()
        if key not in self.flown:
            y = np.asarray(self.hypothesis.predict(record, self.hypothesis.at(theta)), dtype=float)
            wanted = (len(record), len(self.data.noise.channels))
            if y.shape != wanted:
                raise EstimationError(
                    f"'{self.hypothesis.name}' must predict {wanted} samples and channels, got {y.shape}"
                )
            self.flown[key] = y / self.data.stated
        return self.flown[key]

    def _linearised(self, theta: FloatArray, form: bool = True, fresh: bool = False) -> Run:
        """Return the fit about a point, with the form error there or, to save flights, as it was before.

        Tangents that are known are taken, also from another point, until a step fails or none is left to take: then
        those of a fit that is not far behind are made afresh.
        """
        data, parameters, tangents = self.data, self.hypothesis.parameters, self.tangents
        beside, steps = self._beside(theta, fresh)
        yield self._wanted([theta, *beside.values()])
        formed = self.hypothesis.form is not None and (form or not self.blocks)
        blocks = []
        for number, record in enumerate(data.records):
            y, (z, valid) = self._predicted(record, theta), data.readings(record)
            columns = np.empty((*y.shape, len(theta)))
            for i, p in enumerate(parameters):
                if i in beside:
                    columns[:, :, i] = np.nan_to_num((self._predicted(record, beside[i]) - y) / steps[i])
                elif tangents is not None:
                    columns[:, :, i] = tangents[number][p.name]
            own = self._form(record, theta) if formed else self.blocks[number].own if self.blocks else None
            blocks.append(Linearised(np.where(valid, z - y, 0.0), columns, data.motion(record), valid, own))
        before = self.grams if self.grams and not formed else [None] * len(blocks)
        same = [i for i in range(len(theta)) if i not in beside]  # their tangents are known, and so are their sums
        sums = [Grams.made(block, of, same) for block, of in zip(blocks, before, strict=True)]
        if fresh and tangents is not None:
            names = [p.name for p in parameters]
            tangents = [{n: b.columns[:, :, names.index(n)] for n in tangents[0]} for b in blocks]
        fresh = fresh or tangents is None
        return replace(self, theta=theta, blocks=blocks, grams=sums, tangents=tangents, fresh=fresh)

    def _form(self, record: FlightRecord, theta: FloatArray) -> FloatArray:
        """Return what an error of the form of the hypothesis does to a record (n, p, knots), in units of the noise."""
        assert self.hypothesis.form is not None
        t = record.t_s - record.t_s[0]
        knots = np.arange(0.0, t[-1] + _FORM_S, _FORM_S)
        hats = np.maximum(0.0, 1.0 - np.abs(t[:, None] - knots) / _FORM_S)
        signature = self.hypothesis.form(record, self.hypothesis.at(theta)) / self.data.stated
        return np.asarray(signature[:, :, None] * hats[:, None, :])

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

    def _step(self) -> tuple[FloatArray, float]:
        """Return the step to the best point of the linear model, and what it promises in ln p."""
        found = self._reduced(self.scales, self.k)
        H, g = found.A + np.diag(self.hypothesis.std**-2.0), found.b + self._offset / self.hypothesis.std**2
        low, high = self.hypothesis.low - self.theta, self.hypothesis.high - self.theta
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
        for record, block, sums in zip(self.data.records, self.blocks, self.grams, strict=True):
            y, (z, valid) = self._predicted(record, theta), self.data.readings(record)
            if not np.all(np.isfinite(y[valid])):
                return -math.inf
            grams.append(sums.left_by(block, z - y))
        c = reduced(grams, self.scales, KAPPAS[self.k]).c
        return -0.5 * (c + float(np.sum(((theta - self.hypothesis.mean) / self.hypothesis.std) ** 2)))

    @property
    def _log_held(self) -> float:
        """Ln of the prior probability that the parameters lie within their bounds."""
        return float(np.sum(np.log(self.hypothesis.held(self.hypothesis.mean, self.hypothesis.std))))

    def _gaussian(self) -> tuple[FloatArray, FloatArray]:
        """Return centre and covariance of the posterior of the linear model."""
        mean, covariance = self._reduced(self.scales, self.k).posterior(self._offset, self.hypothesis.std)
        return self.theta + mean, covariance

    def sampled(self, samples: int) -> Run:
        """Return the fit with its evidence by importance sampling, where the posterior is far from Gaussian."""
        if not self.hypothesis.parameters:
            return self
        centre, covariance = self._gaussian()
        errors = np.sqrt(np.diag(covariance))
        top = self._log_joint(self.theta)
        ends = [self.theta + sign * covariance[:, i] / errors[i] for i in range(len(centre)) for sign in (1.0, -1.0)]
        ends = [x for x in ends if np.all((x >= self.hypothesis.low) & (x <= self.hypothesis.high))]
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
        held = np.all((points >= self.hypothesis.low) & (points <= self.hypothesis.high), axis=1)
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

    @cached_property
    def log_evidence(self) -> float:
        """ln p(records | hypothesis)."""
        stated = np.log(self.data.stated)
        taken = sum(float(b.taken.sum(axis=0) @ stated) for b in self.blocks)
        return float(logsumexp(list(self.log_weights.values()))) - taken + self.correction

    @cached_property
    def segments(self) -> tuple[FloatArray, FloatArray]:
        """Return of segments of one second ln p (s,) but for a constant, and its gradient by the parameters (s, k)."""
        logs, gradients = [], []
        for record, block, sums in zip(self.data.records, self.blocks, self.grams, strict=True):
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
        covariance, (logs, g) = self._gaussian()[1], self.segments
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
            y, (z, valid) = self._predicted(record, self.theta), self.data.readings(record)
            left, none = np.where(valid, z - y, 0.0), np.zeros((*y.shape, 0))
            grams.append(Grams.made(Linearised(left, none, self.data.motion(record), valid)))
        found = reduced(grams, self.scales, KAPPAS[self.k])
        return -0.5 * (math.log(2.0 * math.pi) + (found.log_det + found.c) / found.samples)

    @cached_property
    def posterior(self) -> Posterior:
        """Return what the records say of the parameters."""
        assert self.sized is not None
        inflation = np.sqrt(self.misfit[1])
        covariance = inflation[:, None] * self._gaussian()[1] * inflation
        total = logsumexp(list(self.log_weights.values()))
        kappa, scales, rest = KAPPAS[self.k], self.scales, []  # what is left of each record, and what counts
        for block, sums in zip(self.blocks, self.grams, strict=True):
            D, factor, _ = sums.inner(scales, kappa)
            d = D * cho_solve(factor, D * (scales**-2.0 @ sums.across[:, : len(D), -1])) if len(D) else D
            own, moved = d[: sums.q], d[sums.q :]
            left = block.residual - block.all_own @ own - (block.unknown.response[:, :, : len(moved)] @ moved).T
            rest.append((np.where(block.taken, left / scales, 0.0), block.taken))
        whiteness = _whiteness(rest)
        whole = sum(math.exp(w - total) for j, w in self.log_weights.items() if KAPPAS[j] <= WHOLE)
        sizes, densities = [KAPPAS[j] for j in self.at], np.array(list(self.at.values()))
        log_whole, log_part = (float(x) for x in whole_and_part(densities, sizes) + (self.log_evidence - total))
        noise = zip(self.scales.tolist(), (self.scales * self.sized.log_errors).tolist(), strict=True)
        return Posterior(
            parameters=self.hypothesis.parameters,
            values=self.theta,
            covariance=covariance,
            noise=dict(zip(self.data.noise.channels, noise, strict=True)),
            kappa=KAPPAS[self.k],
            log_evidence=self.log_evidence,
            log_whole=log_whole,
            log_part=log_part,
            p_whole=whole,
            whiteness=whiteness,
            strain=float(np.sum((self._offset / self.hypothesis.std) ** 2)),
            effective=self.effective,
            misfit=self.misfit[0],
            inflation=inflation,
            doubts=tuple(self._doubts(whiteness, np.sqrt(np.diag(covariance)))),
        )

    def _doubts(self, whiteness: float, errors: FloatArray) -> Iterable[str]:
        """Yield what speaks against the posterior."""
        if whiteness < WHITE:
            yield f"the residual is coloured (noise would be so with a probability of {whiteness:.1g})"
        if self.effective < 0.1:
            yield f"only {100 * self.effective:.0f} % of the samples of its posterior count"
        if self.misfit[0] > _OVERSTATES:
            times = math.sqrt(self.misfit[0])
            yield f"the residual is not white noise: errors are {times:.2g} times those for white noise"
        near = np.minimum(self.theta - self.hypothesis.low, self.hypothesis.high - self.theta) < 0.1 * errors
        if near.any():
            names = [p.name for p, ends in zip(self.hypothesis.parameters, near, strict=True) if ends]
            yield f"{', '.join(names)} is at the end of its range"


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
