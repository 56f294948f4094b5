"""Why do the residuals of an identified model look as they do? One comparison of hypotheses, for every method.

The estimates are first taken to the best model of the same kind, by Gauss-Newton steps of the free run: what noise has
done to a method that it biases would else look like missing dynamics. What that leaves of the outputs is

    v = S b + X a + n,    n[k] = sum_j A[j] n[k - j] + e[k],

with the slopes S of the model's parameters and initial states, the term X that a hypothesis adds to the model
(:mod:`.terms`), and noise that may be coloured. Hypotheses are sets of causes, at most one of each place; a row of
:data:`CAUSES` has its words:

==========  ==================  ==================================================================================
place       cause               term
==========  ==================  ==================================================================================
input       delay, lag,         the input moved in time, through a lag or at a limited rate, with the best model of
            rate_limit          the kind beside it
            held                inputs held from sample to sample in place of straight lines
            order_too_low       the inputs of the samples before, through any linear response
            elastic_mode        the inputs through a mode of second order, faster than the model's own
sensors     drift               a constant and a line per output and record
            drift, slow motion  the inputs through lags longer than any response of the model
aircraft    bend                quadratic and cubic terms of a simulated output, through the model's own slow modes; of
                                small-motion equations what their derivatives do with the airspeed, squared angles
==========  ==================  ==================================================================================

The evidence of each is that of Schwarz, ln L - k / 2 ln N, with k columns and N values (G. Schwarz, Annals of
Statistics 6, 1978), in the noise that all terms together leave. Each place holds with ``P_CAUSE`` any of its causes,
and a cause is named if the records are told ``CLEAR`` with it than without. Where none is, the estimates may be far
from the best of their kind, or innovations coloured. Feedback is a hypothesis on the inputs (:mod:`.feedback`). The
coefficients b are one step towards the estimates with the causes in the model: by how much they have shifted them. That
shift has an error of its own, large where columns of a cause look like slopes: a verdict takes what it is at least.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2, norm

from testbench.core.advice import Advice, Severity, ranked
from testbench.core.blas import on_one_thread
from testbench.core.constants import DEG_RAD, WHITE
from testbench.core.errors import EstimationError, Refusal
from testbench.core.record import AS_DESIGNED, FlightRecord, FloatArray
from testbench.estimators.model import IdentifiedModel
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.prediction_error import predict
from testbench.estimators.residuals import LAG_SHARE, Autoregression, autoregression
from testbench.estimators.state_space import StateSpaceModel
from testbench.estimators.transfer_function import TransferFunctionModel, in_free_run
from testbench.inference.feedback import steps, strongest_feedback
from testbench.inference.free_run import (
    SOONEST,
    Beside,
    Flown,
    Late,
    Regression,
    all_poles,
    feeds_through,
    neighbours,
    plainly,
    regress,
    samples_lost,
    settled,
    solved,
    whitened,
)
from testbench.inference.terms import (
    any_linear,
    bends,
    estimated,
    estimated_along,
    joined,
    likeliest_mode,
    lines,
    nuisances,
    slow_response,
    whatever_else,
)

P_CAUSE, CLEAR = 0.1, 0.9
"""Prior probability of a cause at each place, and probability from which one is taken."""
ODDS = math.log(CLEAR / (1.0 - CLEAR))
_LEAST = float(norm.isf(1.0 - CLEAR))  # standard deviations that a shift lies above what it is at least, by ``CLEAR``
_CHANCE = 1e-3  # of noise to look like an estimate that is no optimum
_CHANCE_LOOP = 0.04  # of the test of feedback: 8 of 396 open loops of noisy inputs in coloured noise lay beyond it
_DESIGNED = 0.98  # likeness to planned commands; what is left is sampling, a servo and noise
_LONGEST = 3000  # samples of all outputs looked at; of longer records the stretch where the inputs move most
_PER_UNKNOWN = 10.0  # valid output samples per unknown below which data are few
_ROUNDING = 1e-6  # residuals below this share of every output are no noise
SLOW = "slow motion"

# --- a cause that was found, and what is said of it -------------------------------------------------------------------


_ERRORS, _TENTH = 4.0, 0.1  # shift in standard errors, and relative or of the motion, beyond which a model is wrong
_HARDLY, _LITTLE = 2.0, 0.02  # the same below which a cause is only worth a note: a 95 % interval holds it
_SCATTER = 3.0  # errors that a method less efficient than the best may be off by chance, in any of some five estimates
_MOST = 0.5  # share of the residuals beyond which missing dynamics make a model wrong, and any cause a doubt


class Found(NamedTuple):
    """A cause: its code, whom it concerns, what it explains of the residuals, and how far it shifts the estimates.

    Attributes:
        code: of :data:`CAUSES`.
        subject: input or output; empty where all are concerned; of an elastic mode its damping ratio.
        amount: seconds of delay, lag or half a hold, rad/s of a limited rate or of an elastic mode, else 0.
        share: of the squared residuals, or for feedback of what is new in the input, that it explains.
        errors: largest shift of a parameter over its standard error; NaN without standard errors.
        moved: name of that parameter; without standard errors the pole that moves most and its shift, in words.
        relative: its shift over its value; without standard errors that of the pole that moves most.
        probability: of the cause, among the hypotheses that were compared; NaN where it was tested by itself.
        of_motion: size of what it explains, as a share of the motion of the output where that is largest.
        unsure: standard deviation of the shift, with the cause in the model, over the shift.
    """

    code: str
    subject: str
    amount: float
    share: float
    errors: float
    moved: str
    relative: float
    probability: float = math.nan
    of_motion: float = math.nan
    unsure: float = 0.0


class Cause(NamedTuple):
    """What is said of a cause, the remedy for models with a structure, and for others."""

    says: str
    remedy: str
    otherwise: str


_SURFACE = "or take the position of the surface as the input instead of its command"
_ACTS = ("set delays_s = {{{subject} = {time}}}, " + _SURFACE, "give the input {time} s later, " + _SURFACE)
_BEND = "fly smaller inputs, use the part of the record where {subject} stays near its trim, or take "
_FIT = "estimate offsets where the method can, free the slow mode or raise the order, and compare the fits"
_HOLD = "set held = [{names}] if a computer made it; a delay of {time} s has the same effect"
_LOOP = (
    "take a method that is consistent in closed loop (filter_error with process noise; prediction_error with "
    "disturbances, ssarx or pbsid_opt with closed_loop = true, of an order that includes the gusts), and excite the "
    "loop by an independent signal"
)
_COLOUR = "compare a higher order and prediction_error with disturbances"
CAUSES = {
    "delay": Cause("{subject} acts some {time} s later than in the model", *_ACTS),
    "lag": Cause("{subject} acts through a lag of some {time} s, as of a servo, which the model lacks", *_ACTS),
    "rate_limit": Cause(
        "{subject} turns at some {rate} deg/s at most, a rate limit of a servo that the model lacks",
        "set rate_limit_deg_s = {rate} of its servo, " + _SURFACE,
        _SURFACE.removeprefix("or "),
    ),
    "held": Cause(
        "{subject} acts half a sample later than straight lines between its samples, as if held from one to the next",
        _HOLD,
        _HOLD,
    ),
    "bend": Cause(
        "the response is nonlinear in {subject}",
        f"{_BEND}a structure with nonlinear aerodynamics",
        f"{_BEND}a nonlinear model",
    ),
    "drift": Cause(
        "the outputs have biases or drifts that the model does not estimate",
        "name the outputs in output_biases and output_trends, or remove the drift",
        "remove biases and drifts from the records first, or estimate them where the method can",
    ),
    SLOW: Cause(
        "the outputs move slowly in a way that the model does not follow: biases or drifts of the sensors, or a slow "
        "mode that it lacks, such as the {slow}, which this record does not separate",
        _FIT,
        _FIT,
    ),
    "far_from_best": Cause(
        "a model of the same kind predicts the records better in free run: noise of the outputs has biased these "
        "estimates",
        "refine them by output_error",
        "refine them by prediction_error",
    ),
    "coloured_residuals": Cause(
        "the innovations of {subject} are not white: gusts, or noise of the sensors that is slower than the model's "
        "states, move the poles beyond their scatter in white noise",
        _COLOUR,
        _COLOUR,
    ),
    "order_too_low": Cause(
        "the outputs follow the inputs through dynamics that the model lacks",
        "free what is fixed or take a structure with more states",
        "raise the order",
    ),
    "elastic_mode": Cause(
        "the outputs follow the inputs through an oscillation near {hertz} Hz (damping ratio {subject}), such as an "
        "elastic mode, that the model lacks",
        "take a structure with this mode (flexible with modes_hz = [{hertz}] for longitudinal motion), or take it out "
        "of inputs and outputs alike (lowpass_hz below it)",
        "raise the order by two, or take it out of inputs and outputs alike (lowpass_hz below it)",
    ),
    "closed_loop": Cause("{subject} reacts to the outputs (closed loop), and the residuals are coloured", _LOOP, _LOOP),
}
"""Code -> words."""
_TRENDS = ("dsr_e", "moesp", "n4sid", "cva", "dsr", "ssarx", "pbsid_opt")  # methods that have offset = "trend"


def in_words(model: IdentifiedModel, c: Found) -> Advice:
    """Return what a cause does, by how much, and what to do, with its rank."""
    longitudinal = {"V", "u", "w", "alpha", "q", "theta", "az"} & set(model.outputs)
    words = {
        "subject": c.subject,
        "time": f"{c.amount:.2g}",
        "rate": f"{c.amount / DEG_RAD:.2g}",
        "hertz": f"{c.amount / (2.0 * math.pi):.2g}",
        "slow": "phugoid" if longitudinal else "spiral",
        "names": ", ".join(f'"{name}"' for name in c.subject.split(", ")),
    }
    row = CAUSES[SLOW if c.subject == SLOW else c.code]
    remedy = row.remedy if isinstance(model, ParametricModel) else row.otherwise
    if c.code == "drift" and c.subject != SLOW and model.method in _TRENDS:
        remedy = 'set offset = "trend", or remove the drift'
    said, loop = row.says.format(**words), c.code == "closed_loop"
    if c.share > 0.005:  # estimates far from the best of their kind may fit better by another step than by the cause
        said += f": {'the residuals explain' if loop else 'this explains'} {100.0 * c.share:.0f} % "
        said += "of what is new in it" if loop else "of the residuals"
        said += f", {100.0 * c.of_motion:.2g} % of the motion" if c.of_motion < 1.0 and not loop else ""
    if loop and model.method == "filter_error" and "coloured_residuals" not in {a.code for a in ranked(model.advice)}:
        # gusts are estimated, and nothing of them is left in what is new
        return Advice(f"{said}; {model.method} with these settings is not biased by it", "note", c.code)
    return Advice(f"{said}{_shifted(c)}; {remedy.format(**words)}", _severity(c), c.code)


def _shifted(c: Found) -> str:
    if np.isfinite(c.errors) and c.moved:
        around = 100.0 * c.unsure * c.relative
        share = f"{100.0 * c.relative:.0f}{f' ± {around:.0f}' if around >= 0.5 else ''} %"
        share = share if c.relative <= 1.0 else "more than its value"
        errors = float(f"{c.errors:.2g}")  # 210, not 2.1e+02
        return f", and it shifts {c.moved} by some {errors:g} of its standard errors ({share})"
    if not np.isfinite(c.relative):
        return ""
    # percent of a pole near the origin say nothing
    return f", and it shifts {f'a pole by some {100.0 * c.relative:.0f} %' if c.relative <= 1.0 else c.moved}"


def _severity(c: Found) -> Severity:
    much = c.share > _MOST
    large = c.of_motion > _TENTH
    if c.code in ("coloured_residuals", "order_too_low"):
        return "wrong" if much and large and c.code == "order_too_low" else "doubt"
    known, least = np.isfinite(c.errors), 1.0 - _LEAST * c.unsure
    if least * c.relative > _TENTH and (least * c.errors > _ERRORS if known else large):
        return "wrong"
    chance = _SCATTER if c.code == "far_from_best" else _HARDLY
    moved = c.errors > chance if known else c.relative > _LITTLE
    # the shift knows no bias that a loop gives to the best of the kind as well
    return "doubt" if moved or much or c.code == "closed_loop" else "note"


@on_one_thread
def with_causes(model: IdentifiedModel, records: Sequence[FlightRecord]) -> IdentifiedModel:
    """Return the model with the causes of its residuals before its own advice, and in ``diagnostics["causes"]``.

    A model without known parameters, such as one of a user's own class, stays as it is, and so does one that cannot fly
    its records.

    Args:
        model: of any method.
        records: those it was identified from.

    Example:
        >>> import testbench as tb
        >>> model = tb.estimate("dsr_e", [record], ["de"], ["q"], past_horizon=20, future_horizon=20)  # doctest: +SKIP
        >>> [a.code for a in tb.with_causes(model, [record]).advice]  # doctest: +SKIP
        ['delay']
    """
    unknowns = len(list(neighbours(model)))
    if not unknowns:
        return model
    causes: list[Found] = []
    total = unknowns + len(all_poles(model)) * len(records)
    values = sum(int(r.select(model.outputs).valid.sum()) for r in records)
    if values < _PER_UNKNOWN * total:
        text = "are few: faults of the model would not be visible, and errors are known only roughly; give more "
        text = f"{values} output samples for {total} unknowns {text}records, or free fewer parameters"
        advice = [Advice(text, "doubt", "few_data")]
    else:
        longest = _LONGEST // (len(records) * len(model.outputs))
        try:
            causes = named(model, [_busiest(r, model.inputs, longest) for r in records])
        except Refusal:  # it diverges over its records, as its own advice says, or too few samples follow each other
            return model
        advice = [in_words(model, c) for c in causes]
    if not advice:
        return model
    codes = {a.code for a in advice}
    if causes:  # a bend or a delay looks like feedback to the innovations of subspace methods, which know neither
        codes.add("closed_loop")
    rest = [a for a in model.advice if getattr(a, "code", "") not in codes]
    if any(a.severity != "note" for a in advice):
        rest = [_without_comfort(a) for a in ranked(rest)]
    return replace(
        model, advice=(*advice, *rest), diagnostics={**model.diagnostics, "causes": [c._asdict() for c in causes]}
    )


def _without_comfort(advice: Advice) -> Advice:
    """Return advice on coloured residuals without the word that errors are corrected: no correction holds a bias."""
    if advice.code != "coloured_residuals" or "corrected" not in advice:
        return advice
    said = f"{advice.rpartition(': ')[0]}: standard errors do not include the influence of the cause above"
    return Advice(said, advice.severity, advice.code)


def _busiest(record: FlightRecord, inputs: Sequence[str], longest: int) -> FlightRecord:
    """Return the stretch of at most ``longest`` samples in which the inputs move most."""
    if len(record) <= longest:
        return record
    step = np.abs(np.diff(record.columns(inputs), axis=0))
    activity = np.cumsum(np.concatenate([[0.0], np.sum(step / np.maximum(step.max(axis=0), 1e-300), axis=1)]))
    first = int(np.argmax(activity[longest - 1 :] - activity[: len(activity) - longest + 1]))
    return record.between(float(record.t_s[first]), float(record.t_s[first + longest - 1]))


# --- the comparison ---------------------------------------------------------------------------------------------------


_STARTS = {"delay": (1.0, 4.0, 16.0), "lag": (1.0, 4.0, 16.0), "rate_limit": (3.0, 6.0, 12.0, 24.0)}
"""Samples from which each way to be late is sought, the likeliest of them with the parameters one step further."""
_NAMED = 2  # causes at most
_FORM = {"bend": 0.1}  # relative error of form of a term,
_CLOSE = 0.02  # of one that is not in the table
_STEPS = 12  # of Gauss-Newton towards the best model of the same kind
_SHARES = (1.0, 0.25, 0.06)  # of a step that are tried
_SURE = 2.0  # standard deviations that a shift must stand above zero to count


class Term(NamedTuple):
    """What a cause adds: its name, a flight that may be another by it, and columns (p, N, d) per record; none if ().

    ``searched`` counts the unknowns that the columns were made with.
    """

    code: str
    subject: str
    amount: float
    at: Flown
    columns: Sequence[FloatArray] = ()
    searched: int = 0


Fit = Callable[[Flown, list[FloatArray]], Regression]
"""How what a flight leaves is regressed on columns."""


class Comparison(NamedTuple):
    """Every set of causes with at most one at each place: ln of evidence and prior, and what of it is their price.

    Both are (i, j, k); a place has none of its terms first. The price is k / 2 ln N less ln of the prior.
    """

    places: tuple[Sequence[Term | None], ...]
    ln_p: FloatArray
    price: FloatArray

    def simplest(self) -> tuple[list[int], FloatArray]:
        """Return the place of the cheapest set that none is clearly better than, and all probabilities.

        No term has quite the form of what it is named for: a share of its own signature may be left (``_FORM``), by
        chance for or against it. All odds are therefore those of an evidence that is so much less that ``ODDS`` are the
        squares of these shares of what each term explains.
        """
        most = tuple(map(int, np.unravel_index(np.argmax(self.ln_p), self.ln_p.shape)))
        behind, left = self.ln_p[most] - self.ln_p, 0.0
        for k, i in enumerate(most):
            if (term := self.places[k][i]) is not None:
                left += _FORM.get(term.code, _CLOSE) ** 2 * behind[(*most[:k], 0, *most[k + 1 :])]
        less = 1.0 + left / ODDS
        alike = np.where(behind <= less * ODDS, self.price, np.inf)
        at = np.unravel_index(np.argmin(np.where(alike == alike.min(), behind, np.inf)), alike.shape)
        p = np.exp(-behind / less)
        return [int(i) for i in at], p / p.sum()


def named(model: IdentifiedModel, records: list[FlightRecord]) -> list[Found]:
    """Return the causes of the residuals, the one that explains most first.

    A model with gusts whose innovations are noise lacks nothing, whatever gusts do to its free run: whether there is
    feedback is all that is asked.

    Raises:
        Refusal: the model cannot fly its records, or too few samples follow each other.
    """
    given = Flown.of(model, records)
    size = np.sqrt(np.mean(np.hstack(given.left) ** 2, axis=1))
    if np.all(size <= _ROUNDING * np.sqrt(np.mean(np.vstack(given.simulated) ** 2, axis=0))):
        return []
    loop = _loop(given)
    if model.settings.get("process_noise") and np.all(np.asarray(model.diagnostics.get("whiteness_p", 0.0)) > WHITE):
        return [] if loop is None else [loop]
    still = regress(given, whatever_else(given)).criterion
    best, fit = _best_of_its_kind(given, whatever_else, regress)
    compared = comparison(best, given)
    at, p = compared.simplest()

    def but(place: int, other: int = 0) -> float:
        return float(compared.ln_p[tuple(other if k == place else i for k, i in enumerate(at))])

    chosen = sorted((k for k in range(len(at)) if at[k]), key=but)
    terms = {k: t for k in chosen if (t := compared.places[k][at[k]]) is not None}
    base, start = best, regress(given, nuisances(given))
    if terms:
        base = terms[0].at if 0 in terms else best
        found = regress(
            base, joined(base.slopes, nuisances(base), *(t.columns for t in terms.values() if t.columns)), twice=True
        )
        # All terms at once take for a signal what noise of a long memory does as well: the noise is estimated anew.
        # Noise that remembers the whole record is a drift itself.
        plain = regress(best, joined(best.slopes, nuisances(best)), twice=True)
        lasting = plain.noise.slowest() > math.exp(-LAG_SHARE / max(map(len, records)))
        more = int(np.sum(found.std > 0.0)) - int(np.sum(plain.std > 0.0))
        if lasting or plain.criterion - found.criterion > chi2.isf(_CHANCE, max(more, 1)):
            fit = found
        else:
            base, terms = best, {}
    counts = [settled(g, samples_lost(given.left)) for g in given.good]  # of others no regression knows what is left
    before, after = (np.hstack([v[:, c] for v, c in zip(r.left, counts, strict=True)]) for r in (start, fit))
    share, shift, gone = _explained(before, after), _shift(model, base, fit), before - after
    motion = np.var(np.vstack([r.columns(model.outputs) for r in records]), axis=0)
    of_motion = float(np.sqrt(np.max(np.mean(gone**2, axis=1) / np.where(motion > 0.0, motion, np.inf))))
    out: list[Found] = []
    for k, t in terms.items():
        probability, subject = float(p.take(at[k], k).sum()), t.subject
        if out and probability < CLEAR:
            continue  # beside the first only what is clear
        if t.code == "drift" and but(k, at[k]) - but(k, len(compared.places[k]) - 1) < ODDS:
            subject = SLOW  # a slow response to the inputs, such as of a phugoid, does it as well
        moved = _Shift(np.nan, "", np.nan) if t.code == "order_too_low" else shift
        out.append(Found(t.code, subject, t.amount, share, *moved[:3], probability, of_motion, moved.unsure))
    if not out:  # what a cause leaves moves the best of the kind as well
        # estimates of output error are the best but for the colour of the noise, which its own advice weighs
        far = model.method != "output_error" and still - fit.criterion > chi2.isf(_CHANCE, max(len(best.near), 1))
        out += (
            [Found("far_from_best", "", 0.0, share, *shift[:3], of_motion=of_motion, unsure=shift.unsure)]
            if far and best.model is not model
            else []
        )
        out += [c for c in [_coloured(best, fit)] if c is not None]
    if loop is not None:  # what else is found presumes inputs that know nothing of the outputs
        out.insert(0, loop._replace(**shift._asdict(), of_motion=of_motion))
    return out[:_NAMED]


def comparison(best: Flown, given: Flown) -> Comparison:
    """Return the evidence of every set of causes.

    Args:
        best: the best model of its kind over its records.
        given: the model as it was identified.
    """
    linear = Term("order_too_low", "", 0.0, best, any_linear(best))
    sensors = [Term("drift", "", 0.0, best, lines(best))] if estimated_along(best.model) < 2 else []
    sensors.append(Term("drift", SLOW, 0.0, best, slow_response(best)))
    aircraft = [Term("bend", name, 0.0, best, columns) for name, columns in bends(best)]
    base = joined(best.slopes, nuisances(best))
    whole = joined(base, *(t.columns for t in (linear, *sensors, *aircraft)))
    noise, lost, variance = regress(best, whole, twice=True).noise, samples_lost(best.left), 1.0
    elastic = _elastic(best, base, noise, lost)
    if elastic is not None:  # what rings on looks like noise of a resonance
        whole = joined(whole, elastic.columns)
        noise = regress(best, whole, twice=True).noise

    def white(signals: Sequence[FloatArray]) -> FloatArray:
        return whitened(noise, best.good, signals, lost)

    def residual(at: Flown) -> FloatArray:
        return white([v[:, :, None] for v in at.left])[:, 0]

    def in_this_noise(at: Flown, columns: list[FloatArray]) -> Regression:
        e, Z = residual(at), white(columns)
        b, std = solved(Z, e)
        return Regression(b, std, [], noise, float(np.sum((e - Z @ b) ** 2)) / variance)

    nothing, least = Beside(white(base), residual(best)), in_this_noise(best, whole)
    n, rank = nothing.e.size, int(np.sum(least.std > 0.0))
    variance = least.criterion / max(n - rank, 1)
    explained = 0.5 * (nothing.square / variance - (n - rank)) - 0.5 * (rank - nothing.rank)
    if explained < ODDS - math.log(P_CAUSE / (1.0 - P_CAUSE)) + 0.5 * math.log(n):  # all at once are not worth one
        return Comparison(((None,),) * 3, np.zeros((1, 1, 1)), np.zeros((1, 1, 1)))
    inputs = (*_late(best, given, in_this_noise), linear, *([] if elastic is None else [elastic]))
    places = tuple((None, *t) for t in (inputs, sensors, aircraft))
    shape = tuple(map(len, places))
    ln_p, price = np.zeros(shape), np.zeros(shape)
    for k, size in enumerate(shape):  # each place has one of its causes with a probability P_CAUSE
        prior = np.log([1.0 - P_CAUSE, *[P_CAUSE / max(size - 1, 1)] * (size - 1)])
        price -= prior.reshape([-1 if k == axis else 1 for axis in range(3)])
    columns = [[white(t.columns) if t else np.zeros((n, 0)) for t in place] for place in places[1:]]
    for i, late in enumerate(places[0]):
        at = best if late is None else late.at
        own = joined(at.slopes, nuisances(at), *([late.columns] if late and late.columns else []))
        rest = Beside(white(own), residual(at))
        for j, k in np.ndindex(shape[1:]):
            left, rank = rest.beside(np.hstack([columns[0][j], columns[1][k]]))
            price[i, j, k] += 0.5 * (rank + (late.searched if late else 0)) * math.log(n)
            ln_p[i, j, k] = -0.5 * left / variance
    return Comparison(places, ln_p - price, price)


def _elastic(best: Flown, base: list[FloatArray], noise: Autoregression, lost: int) -> Term | None:
    """Return a mode of second order that inputs drive beside the model, of the frequency and damping that fit best."""

    def white(signals: Sequence[FloatArray]) -> FloatArray:
        return whitened(noise, best.good, signals, lost)

    beside = Beside(white(base), white([v[:, :, None] for v in best.left])[:, 0])
    width = 2 * len(best.model.inputs) * len(best.model.outputs)

    def left(columns: list[FloatArray]) -> list[float]:
        Z = white(columns)
        return [beside.beside(Z[:, i : i + width])[0] for i in range(0, Z.shape[1], width)]

    mode = likeliest_mode(best, held_of(best.model), left)
    return None if mode is None else Term("elastic_mode", f"{mode.zeta:.2g}", mode.wn_rad_s, best, mode.columns, 2)


def _late(best: Flown, given: Flown, fit: Fit) -> Iterator[Term]:
    """Yield delay, lag and limited rate of each input, and inputs that are held, each with the best model of the kind.

    Without them the best model may be far from the aircraft, and from what was identified: both are starts.
    """
    model = best.model

    def ahead(way: Flown) -> float:
        return fit(way, joined(way.slopes, estimated(way))).criterion

    for i, name in enumerate(model.inputs):
        span = max(float(np.ptp(r[name])) for r in best.records)
        for code, starts in _STARTS.items():
            lates = [Late(code, name, k, held_of(model)[i], span) for k in starts]
            ways = [min((Flown.of(m, best.records, late) for late in lates), key=ahead) for m in (given.model, model)]
            at, _ = min((_best_of_its_kind(way, estimated, fit) for way in ways), key=lambda one: one[1].criterion)
            if at.late is not None and at.late.samples > SOONEST:
                time_s = at.late.samples * model.dt_s
                yield Term(code, name, span / time_s if code == "rate_limit" else time_s, at)
    lines = [n for n, held in zip(model.inputs, held_of(model), strict=True) if not held]
    if lines:
        structured = isinstance(model, ParametricModel)
        all_held: Any = {"held" if structured else "hold": (True if structured else "zoh",) * len(model.inputs)}
        at, _ = _best_of_its_kind(Flown.of(replace(model, **all_held), best.records), estimated, fit)
        yield Term("held", ", ".join(lines), 0.5 * model.dt_s, at)


def held_of(model: IdentifiedModel) -> tuple[bool, ...]:
    """Return whether a model takes each input as held from sample to sample; else it runs on straight lines."""
    if isinstance(model, ParametricModel):
        return tuple(model.held)
    return tuple(h == "zoh" for h in getattr(model, "hold", ("zoh",) * len(model.inputs)))


def _best_of_its_kind(given: Flown, beside: Callable[[Flown], list[FloatArray]], fit: Fit) -> tuple[Flown, Regression]:
    """Return the model after Gauss-Newton steps of its free run in coloured noise, and the regression on its slopes.

    What noise has done to the estimates of a method that does not minimise the errors of its free run would else look
    like missing dynamics.
    """

    def tried(model: IdentifiedModel, late: Late | None) -> tuple[Flown, float] | None:
        try:
            at = Flown.of(model, given.records, late)
            return at, fit(at, beside(at)).criterion
        except (Refusal, np.linalg.LinAlgError):
            return None  # it cannot fly the records

    best, model, late, reached = given, given.model, given.late, fit(given, beside(given)).criterion
    if isinstance(model, TransferFunctionModel):  # its equation errors may be so biased that no step leads back
        acting = [r if late is None else late.acting(r) for r in given.records]
        other = tried(in_free_run(model, acting), late)
        if other is not None and other[1] < reached:
            best, reached = other
    promised = np.inf
    for _ in range(_STEPS):
        found = fit(best, joined(best.slopes, beside(best)))
        little = reached - found.criterion < chi2.isf(_CHANCE, max(len(best.near), 1))
        if little or promised - found.criterion < 2.0 * ODDS:
            return best, found
        promised = found.criterion
        for share in _SHARES:
            other = tried(*best.stepped(share * found.b))
            if other is not None and other[1] < reached and len(other[0].near) == len(given.near):
                best, reached = other
                break
        else:
            return best, found
    return best, fit(best, joined(best.slopes, beside(best)))


def _loop(given: Flown) -> Found | None:
    """Return feedback, if what is new in an input goes with what any linear response to its past leaves of the outputs.

    The model has no part in it: one that is wrong hides what it is wrong for. Outputs with direct feedthrough follow
    what is new in an input in any case and are left out. What bends would leave is taken out: where little is new in an
    input, such as a multisine, it is told by what it has bent before, without any loop.
    """
    model, apart = given.model, ~feeds_through(given.model)
    p, m = len(model.outputs), len(model.inputs)
    if all(_as_designed(r) > _DESIGNED for r in given.records):
        return None  # what was chosen before the flight does not react to it
    if not np.any(apart) or all(steps([r[name] for r in given.records]) for name in model.inputs):
        return None
    outputs = [
        (r.columns(model.outputs) - r.columns(model.outputs)[0]).T * g
        for r, g in zip(given.records, given.good, strict=True)
    ]
    response, straight = any_linear(given, 1), lines(given)
    enough = min(80, min(len(g) for g in given.good) // 8)
    # by ordinary least squares: a whole flight of gusts is not to be whitened away
    b, left = plainly(outputs, given.good, joined(response, straight, *(columns for _, columns in bends(given))))
    if not len(autoregression([v.T for v in left]).A):
        return None
    width = response[0].shape[2] // (m * p)
    first = b[: m * width * p].reshape(m, width, p)[:, 0].T  # the response one sample later
    f = strongest_feedback(
        [r.columns(model.inputs) for r in given.records],
        [v[apart] for v in left],
        [settled(g, enough) for g in given.good],
        first[apart],
    )
    if f is None or chi2.sf(f.statistic, f.degrees) * m > _CHANCE_LOOP:
        return None
    return Found("closed_loop", model.inputs[f.at], 0.0, f.share, np.nan, "", np.nan)


def _as_designed(record: FlightRecord) -> float:
    """Return the likeness of a record's commands to planned ones, as it or the file that it was read from says."""
    told = record.provenance
    return float(told.get(AS_DESIGNED, told.get("recorded", {}).get(AS_DESIGNED, 0.0)))


def _explained(before: FloatArray, after: FloatArray) -> float:
    """Return the share of the squared residuals (p, N) of all outputs that a regression explains."""
    first, rest = (np.sum(v**2, axis=1) for v in (before, after))
    return 1.0 - float(np.mean(rest / np.where(first > 0.0, first, 1.0)))


def _coloured(best: Flown, fit: Regression) -> Found | None:
    """Return colour of what the best of the kind leaves, for methods that do not test it, or test their own filter.

    Of a state-space model it is what its predictor leaves, which white process noise does not colour. An autoregression
    is a hypothesis like the others.
    """
    model = best.model
    if any(getattr(a, "code", "") == "coloured_residuals" and a.severity != "note" for a in ranked(model.advice)):
        return None
    if isinstance(model, StateSpaceModel):
        try:
            innovations = [predict(model, record)[1][3 * model.order :] for record in best.records]
        except EstimationError:
            return None  # a predictor that cannot be run says nothing of colour
    elif model.method == "equation_error":
        innovations = [left.T for left in fit.left]
    else:
        return None
    coloured = []
    for i, name in enumerate(model.outputs):
        each = [e[:, [i]] for e in innovations]
        noise, lost = autoregression(each), samples_lost([e.T for e in each])
        total, white = sum(len(e) - lost for e in each), float(np.mean(np.vstack([e[lost:] for e in each]) ** 2))
        gain = 0.5 * total * math.log(white / float(noise.S[0, 0])) - 0.5 * len(noise.A) * math.log(total)
        if gain + math.log(P_CAUSE / (1.0 - P_CAUSE)) > ODDS:
            coloured.append(name)
    return Found("coloured_residuals", ", ".join(coloured), 0.0, 0.0, np.nan, "", np.nan) if coloured else None


class _Shift(NamedTuple):
    """What a cause does to the estimates: see the attributes of :class:`Found`."""

    errors: float
    moved: str
    relative: float
    unsure: float = 0.0


def _shift(model: IdentifiedModel, at: Flown, fit: Regression) -> _Shift:
    """Return the largest shift over the standard error of the estimate, whose it is, relative, and how unsure.

    Without standard errors it is the shift of the pole that moves most, relative to its size; in words in rad/s.

    What is left of trim values takes up every drift, which need not touch the others: it counts where nothing else is.
    """
    k, first = len(at.near), list(neighbours(model))
    b, std, error = fit.b[:k], fit.std[:k], np.array([n.error for n in first])
    if len(first) != k or not np.all(np.isfinite(error)):
        before, after = all_poles(model), all_poles(at.moved(b))
        if not before.size or before.size != after.size:
            return _Shift(np.nan, "", np.inf if before.size != after.size else 0.0)
        # those that turn from complex to real ones, or back, are paired by the nearest
        off = np.min(np.abs(before[:, None] - after), axis=1)
        size = np.maximum(np.abs(before), 1e-9)
        i = int(np.argmax(off / size))
        return _Shift(np.nan, f"a pole of {size[i]:.2g} rad/s by some {off[i]:.2g} rad/s", float(off[i] / size[i]))
    b = b + np.array([n.value for n in at.near]) - np.array([n.value for n in first])
    size = np.where(np.abs(b) > _SURE * std, np.abs(b), 0.0) / error
    constants = model.structure.trim_constants if isinstance(model, ParametricModel) else ()
    counts = np.array([n.name not in constants for n in first])
    if np.any(counts):
        size = np.where(counts, size, 0.0)
    i = int(np.argmax(size))
    unsure = float(std[i] / abs(b[i])) if size[i] > 0.0 else 0.0
    return _Shift(float(size[i]), first[i].name, float(abs(b[i]) / max(abs(first[i].value), 1e-300)), unsure)
