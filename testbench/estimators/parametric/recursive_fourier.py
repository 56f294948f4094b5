"""Real-time regression: a structure by least squares on Fourier transforms that grow sample by sample.

E. A. Morelli, "Real-Time Parameter Estimation in the Frequency Domain", Journal of Guidance, Control, and Dynamics
23(5), 2000; V. Klein and E. A. Morelli, Aircraft System Identification, AIA, 2006, chapter 11 (chapter from memory). At
some lines w of a band, kept in rad/s or Hz once and for all,

    X(w, t) = forgetting X(w, t - dt) + x(t) exp(-j w t)

is all that is remembered of a signal, and at any time theta = Re(X+ X)^-1 Re(X+ Y), with Y the transform of the state
derivative and X those of the terms. The paper takes Y = j w X of perturbations that begin and end at trim. Here Y is
the transform of the changes from sample to sample and X that of the terms halfway between, which holds at any time of a
manoeuvre; held inputs are what they are over the sample. A straight line through all data up to then is taken out of
both, from running sums. Bias, drift, and noise beyond the band do not reach the estimates; noise of the measured states
within the band biases them as it does any regression.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.model import ComplexArray
from testbench.estimators.parametric.accuracy import correlations, null_directions
from testbench.estimators.parametric.likelihood import Driven
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.parametric.response import delayed
from testbench.estimators.parametric.servo import by_surfaces, in_front
from testbench.estimators.parametric.state_equations import (
    Regression,
    SmoothedStates,
    equations,
    free_of,
    model_of_equations,
)
from testbench.estimators.parametric.structure import ModelStructure
from testbench.estimators.regression.smoothing import bridge
from testbench.estimators.settings import RecursiveFourier

_PASSES = 10  # over the data, of a structure that is not linear in its parameters
_STILL = 1e-8  # change of the parameters, in standard errors, that ends them
_ROUNDS = 3  # of weighing the equations by their residuals
_NEIGHBOURS = 5  # lines over which the power of the residuals is averaged
_NOTHING = 1e-9  # what is known of a parameter without slopes, inverse standard deviation
_DECIDED = 1e-10  # eigenvalue ratio of the scaled information below which the data do not decide the estimates yet


class Fit(NamedTuple):
    """Least squares at one time: step (f,) of the parameters, covariances (f, f), residuals (n, r lines) of r records.

    ``whole`` is the covariance as if all lines were independent, ``corrected`` that of :func:`estimate`.
    """

    step: FloatArray
    whole: FloatArray
    corrected: FloatArray
    residuals: ComplexArray
    weights: FloatArray
    R: FloatArray


_DEFAULT = RecursiveFourier()


def estimate(
    records: Sequence[FlightRecord], structure: ModelStructure, settings: RecursiveFourier = _DEFAULT
) -> ParametricModel:
    """Estimate the free parameters of a structure as the data come in; all its states measured.

    A structure that is linear in its parameters needs one pass over the data, as in flight; another one is linearised
    about the last estimates and passed again. Bounds are not enforced: a last estimate beyond one is moved onto it, and
    the advice says so. Priors count as data.

    Args:
        records: measured records with one sample time; transforms of those before are kept.
        structure: the equations; every state is a channel.
        settings: the band, and how fast the estimates follow.

    Returns:
        The model of the last update. Its diagnostics hold ``history``: ``t_s`` (m,) and ``record`` (m,) of the updates
        at which the data decided all estimates, ``names`` (f,), ``params`` and ``std`` (m, f). Errors count lines as
        far as they are independent (a line per 1/duration) and are corrected for residuals whose power changes over the
        band: P (sum of A' S A) P, with S the power of the residuals around each line.

    Raises:
        EstimationError: a setting against the laws above, a state is not measured, nothing is free, or the data never
            decide the estimates.
        ChannelError: a record lacks a channel.
    """
    if in_front(structure):
        return by_surfaces(records, structure, settings, estimate)
    free, dt = free_of(records, structure, "real-time regression"), records[0].dt_s
    if not settings.update_s >= dt:
        raise EstimationError(f"update_s >= the sample time {dt:g} s must hold, got {settings.update_s:g}")
    lines = _lines(settings, dt)
    driven = Driven.of(settings, structure, records)
    data = [_between(r, structure, driven.delays_s, driven.held) for r in records]
    stds = (structure.parameters[i].prior_std for i in free)
    prior = np.array([0.0 if std is None else 1.0 / std for std in stds])
    count = sum(int(d.taken.sum()) for d in data)
    if count <= 2 * free.size:
        raise EstimationError(
            f"real-time regression of '{structure.name}' needs more than twice as many samples as its {free.size} "
            f"parameters, got {count} with all states and inputs sampled; give more data or fix some parameters"
        )
    params = structure.values
    still = _unmoved(Regression(structure, data, params, free))
    every, free, prior = free, free[~still], prior[~still]
    for _ in range(_PASSES):
        fit = Regression(structure, data, params, free)
        history = _updates(fit, prior, settings, lines)
        if not history:
            names = [structure.parameter_names[i] for i in free]
            J = np.vstack([j.reshape(-1, free.size) for j in equations(*fit)[1]])
            lost = null_directions(J, np.linalg.norm(J, axis=0), names) or ", ".join(names)
            raise EstimationError(
                f"these data never determine {lost} within the band and the memory: not identifiable; widen band_hz, "
                "raise forgetting, excite more, or fix some of them"
            )
        last = history[-1][2]
        before, params = params, params.copy()
        params[free] += last.step
        if np.all(np.abs(last.step) <= _STILL * np.sqrt(np.diag(last.whole))) or _is_linear(fit):
            break
    said = {
        "t_s": np.array([t for _, t, _ in history]),
        "record": np.array([r for r, _, _ in history]),
        "names": [structure.parameter_names[i] for i in free],
        "params": np.array([before[free] + fit.step for _, _, fit in history]),
        "std": np.array([np.sqrt(np.diag(fit.corrected)) for _, _, fit in history]),
    }
    k = params.size
    covariance, whole = np.zeros((k, k)), np.zeros((k, k))
    covariance[np.ix_(free, free)], whole[np.ix_(free, free)] = last.corrected, last.whole
    if still.any():
        _constants(fit.at(params), every[still], last, covariance, whole)
    free = every
    left = np.vstack(equations(structure, data, params, free)[0])
    size = np.sqrt(np.diag(whole)[free])
    return model_of_equations(
        "recursive_fourier",
        Regression(structure, data, params, free),
        records,
        driven,
        covariance,
        whole,
        {
            "residual_std": left.std(axis=0),
            "whiteness_p": _evenness(last.residuals, last.weights),
            "correlation": correlations(whole[np.ix_(free, free)]),
            "error_inflation": np.sqrt(np.diag(covariance)[free]) / np.maximum(size, 1e-300),
            "history": said,
        },
    )


def _between(
    record: FlightRecord, structure: ModelStructure, delays: FloatArray, held: NDArray[np.bool_]
) -> SmoothedStates:
    """Return states and inputs halfway between samples and the changes of the states; nothing is smoothed."""
    part = record.select((*structure.states, *structure.inputs))
    rows = np.array([bridge(record.t_s, part[name], part.valid[:, i], name) for i, name in enumerate(part.channels)])
    n, dt = len(structure.states), record.dt_s
    x, driven = rows[:n].T, delayed(rows[n:].T, dt, delays)
    middle = 0.5 * (x[1:] + x[:-1])
    around = np.vstack([driven[:1], driven[:-2]]) if len(driven) > 1 else driven[:0]
    # A staircase has (sin y / y)^2 / (tan y / y) = 1 - 2 y^2/3 of the spectrum of its samples here, y = w dt/2.
    steps = (around + 4.0 * driven[:-1] + driven[1:]) / 6.0
    u = np.where(held, steps, 0.5 * (driven[1:] + driven[:-1]))
    taken = np.asarray(part.valid.all(axis=1))
    return SmoothedStates(
        x=np.repeat(middle[None], n, axis=0),
        u=np.repeat(u[None], n, axis=0),
        xdot=np.diff(x, axis=0) / dt,
        taken=np.asarray(taken[1:] & taken[:-1], bool),
        noise=np.zeros((n, n)),
        cutoffs_hz=np.full(n, 0.5 / dt),
        driven=driven[:-1],
        dt_s=dt,
    )


def _unmoved(fit: Regression) -> NDArray[np.bool_]:
    """Return which free parameters (f,) multiply constants and lines alone, such as what is left of trim."""
    J, free = equations(*fit)[1], fit.free
    size, rest = np.zeros(free.size), np.zeros(free.size)
    for slopes, d in zip(J, fit.data, strict=True):
        part = slopes[d.taken].reshape(int(d.taken.sum()), -1)
        line = np.column_stack([np.ones(len(part)), np.linspace(-1.0, 1.0, len(part))])
        left = part - line @ np.linalg.lstsq(line, part, rcond=None)[0]
        size += np.sum(part.reshape(len(part), -1, free.size) ** 2, axis=(0, 1))
        rest += np.sum(left.reshape(len(part), -1, free.size) ** 2, axis=(0, 1))
    return np.asarray((size > 0.0) & (rest <= 1e-18 * size))


def _constants(
    fit: Regression, constant: NDArray[np.intp], last: Fit, covariance: FloatArray, whole: FloatArray
) -> None:
    """Put in the parameters that multiply constants, and their covariances, from the means of the equations.

    A level power spectrum that gives the real part of a transform over T seconds the variance R gives a mean 2 R / T^2.
    """
    structure, data, params, free = fit
    c = constant.size
    errors, slopes = equations(structure, data, params, np.concatenate([constant, free]))
    taken = [d.taken for d in data]
    J = -np.mean(np.vstack([s[t] for s, t in zip(slopes, taken, strict=True)]), axis=0)  # (n, c + f)
    mean = np.mean(np.vstack([e[t] for e, t in zip(errors, taken, strict=True)]), axis=0)
    length = sum(int(t.sum()) for t in taken) * data[0].dt_s
    inverse = np.linalg.pinv(J[:, :c])
    params[constant] += inverse @ mean
    by_others = -inverse @ J[:, c:]
    own = inverse @ np.diag(2.0 * last.R * len(data) / length**2) @ inverse.T
    for P in (covariance, whole):
        P[np.ix_(constant, free)] = by_others @ P[np.ix_(free, free)]
        P[np.ix_(free, constant)] = P[np.ix_(constant, free)].T
        P[np.ix_(constant, constant)] = by_others @ P[np.ix_(free, free)] @ by_others.T + own


def _is_linear(fit: Regression) -> bool:
    """Return whether the equations are linear in their free parameters: their slopes do not change with them."""
    structure, data, _, free = fit
    few = data[0]._replace(x=data[0].x[:, :50], u=data[0].u[:, :50])
    few = few._replace(xdot=few.xdot[:50], taken=few.taken[:50])
    params = structure.values
    moved = params.copy()
    moved[free] += 0.1 * (1.0 + np.abs(params[free]))
    one, other = (equations(structure, [few], p, free)[1][0] for p in (params, moved))
    return bool(np.max(np.abs(one - other)) <= 1e-9 * np.max(np.abs(one)))


def _updates(
    fit: Regression, prior: FloatArray, settings: RecursiveFourier, lines: FloatArray
) -> list[tuple[int, float, Fit]]:
    """Return (record, time from its first sample, fit) at every update at which the data decide the estimates."""
    structure, data, params, free = fit
    n, dt, forgetting = len(structure.states), data[0].dt_s, settings.forgetting
    stride = round(settings.update_s / dt)
    out: list[tuple[int, float, Fit]] = []
    kept: list[tuple[ComplexArray, float]] = []  # transforms of the records before, and their independent lines
    centre = params[free] - structure.values[free]
    for number, d in enumerate(data):
        (errors,), (slopes,) = equations(structure, [d], params, free)
        grown = Grown(lines, d.dt_s, forgetting)
        N, done = len(errors), 0
        now = grown.level(n, settings.step_hz)
        for end in np.arange(N, 0, -stride)[::-1]:
            rows = slice(done, int(end))
            grown.add(d.taken[rows], d.xdot[rows], errors[rows], slopes[rows])
            done, now = int(end), grown.level(n, settings.step_hz)
            if (found := _fit([*kept, now], n, np.diag(prior), -prior * centre)) is not None:
                out.append((number, float(d.dt_s * end), found))
        kept.append(now)
    return out


class Grown:
    """The transforms of one record at the lines (l,), Hz, which grow by blocks of its samples, and its running line.

    All that is remembered: transforms of the samples, and the sums from which a straight line is taken out of them.
    """

    def __init__(self, lines: FloatArray, dt_s: float, forgetting: float = 1.0) -> None:
        self.lines, self.dt_s, self.forgetting = lines, dt_s, forgetting
        self.count, self.span_s = 0, 0.0
        self._F: ComplexArray = np.zeros((lines.size, 1), np.complex128)
        self._M: FloatArray = np.zeros((2, 1))

    def add(self, taken: NDArray[np.bool_], xdot: FloatArray, errors: FloatArray, slopes: FloatArray) -> None:
        """Add the next b samples: whether taken (b,), state changes (b, n), errors (b, n), their slopes (b, n, f)."""
        b = len(errors)
        t, one = self.dt_s * np.arange(self.count, self.count + b), np.where(taken, 1.0, 0.0)
        moved = np.where(taken[:, None], xdot, 0.0)
        columns = np.column_stack([one, one * t, moved, moved - errors, -slopes.reshape(b, -1)])
        w, fade = self.forgetting ** np.arange(b)[::-1], self.forgetting**b
        self._F = fade * self._F + (np.exp(-2j * np.pi * np.outer(self.lines, t)) * w) @ columns
        self._M = fade * self._M + (columns[:, :2] * w[:, None]).T @ columns
        self.span_s = fade * self.span_s + float(w @ one) * self.dt_s
        self.count += b

    def level(self, n: int, step_hz: float) -> tuple[ComplexArray, float]:
        """Return errors and slopes (l, n + n f) of n states with the line taken out, and the independent lines' share.

        Changes over a sample are larger than means between samples by tan(w dt/2) / (w dt/2).
        """
        turn = np.pi * np.minimum(self.lines * self.dt_s, 0.49)
        between = (np.tan(turn) / turn)[:, None]
        line = np.linalg.lstsq(self._M[:, :2], self._M[:, 2:], rcond=None)[0]
        level = (self._F[:, 2:] - self._F[:, :2] @ line) * self.dt_s
        changes, terms = level[:, :n], between * level[:, n:]
        return np.hstack([changes - terms[:, :n], terms[:, n:]]), min(1.0, step_hz * self.span_s)


class InFlight:
    """A structure in flight: blocks of samples go in as they come, at any time the estimates come out.

    The structure must be linear in its parameters, with all its states among the samples. Constants, which a straight
    line takes out, are not estimated.

    Args:
        structure: the equations.
        settings: band, distance of the lines, forgetting.
        dt_s: of the samples.

    Attributes:
        place: where the present record is flown, in numbers; remembered for :meth:`fit_along`.

    Raises:
        EstimationError: the band holds no line below the Nyquist frequency.
    """

    def __init__(self, structure: ModelStructure, settings: RecursiveFourier, dt_s: float) -> None:
        self.structure, self.settings, self.dt_s = structure, settings, dt_s
        self.lines = _lines(settings, dt_s)
        named = [p.free and not p.name.endswith("_0") for p in structure.parameters]
        self.free = np.flatnonzero(named)
        self._kept: list[tuple[ComplexArray, float]] = []
        self._places: list[tuple[float, ...]] = []
        self._instead: dict[int, tuple[tuple[int, ...], FloatArray, FloatArray]] = {}
        self.place: tuple[float, ...] = ()
        self._before_s = 0.0
        self._grown = Grown(self.lines, dt_s, settings.forgetting)
        self._last: FlightRecord | None = None
        self._known: FloatArray = np.zeros((1, len(structure.states)))

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters (f,) that are estimated."""
        return tuple(self.structure.parameter_names[i] for i in self.free)

    @property
    def spans_s(self) -> float:
        """Time of all records so far, s."""
        return self._before_s + self._grown.span_s

    @property
    def places(self) -> list[tuple[float, ...]]:
        """``place`` of each of the r records so far."""
        return [*self._places, *([self.place] if self._grown.span_s > 0.0 else [])]

    def begin(self) -> None:
        """Begin another record of the same condition: what was flown before counts on."""
        if self._grown.span_s > 0.0:
            self._kept.append(self._grown.level(len(self.structure.states), self.settings.step_hz))
            self._places.append(self.place)
            self._before_s += self._grown.span_s
        self._grown = Grown(self.lines, self.dt_s, self.settings.forgetting)
        self._last = None

    def add(self, block: FlightRecord, scales: FloatArray | float = 1.0, known: FloatArray | float = 0.0) -> None:
        """Add the samples that follow those before: states and inputs as measured, at the sample time.

        Args:
            block: of b samples.
            scales: (b, n, f) factors on what each parameter does in each equation, where the condition changes: with
                dynamic pressure, say.
            known: (b, n) derivatives of the states beside those of the structure, as by the turning frame.
        """
        structure, last = self.structure, self._last
        part = block.select((*structure.states, *structure.inputs))
        if last is not None:
            t = np.concatenate([last.t_s, part.t_s])
            data, valid = np.vstack([last.data, part.data]), np.vstack([last.valid, part.valid])
            part = FlightRecord(t, part.channels, data, "measured", valid)
        self._last = (
            part if len(part) < 2 else replace(part, t_s=part.t_s[-2:], data=part.data[-2:], valid=part.valid[-2:])
        )
        if len(part) < 3:
            return
        m = len(structure.inputs)
        d = _between(part, structure, np.zeros(m), np.zeros(m, bool))
        (errors,), (slopes,) = equations(structure, [d], np.zeros(len(structure.parameters)), self.free)
        new = slice(0 if last is None else len(last) - 1, None)
        count = len(errors[new])
        scales, known = (np.broadcast_to(x, (len(block), *s.shape[1:])) for x, s in ((scales, slopes), (known, errors)))
        before = known[:1] if last is None else self._known
        middle = 0.5 * (known + np.vstack([before, known[:-1]]))
        self._known = known[-1:]
        self._grown.add(d.taken[new], d.xdot[new], errors[new] - middle[-count:], slopes[new] * scales[-count:])

    def take_instead(self, records: Sequence[int], values: FloatArray, covariance: FloatArray) -> None:
        """Let what another estimator made of records stand for them, in place of what stood for the first of them.

        Args:
            records: their places among all so far.
            values: (f,) its estimates.
            covariance: (f, f) of them.
        """
        self._instead[records[0]] = tuple(records), covariance, values

    def fit(self) -> Fit | None:
        """Return least squares now, its step counted from zero; None if nothing is decided yet."""
        if not self.spans_s > 0.0:
            return None
        rows, right = [np.zeros((0, self.free.size))], [np.zeros(0)]
        for _, covariance, values in self._instead.values():
            rows.append(_whitening(covariance))
            right.append(rows[-1] @ values)
        parts = [part for k, part in enumerate(self._parts()) if k not in self._replaced] or [self._none(1)]
        return _fit(parts, len(self.structure.states), np.vstack(rows), np.concatenate(right))

    def fit_along(self, along: FloatArray, mean: FloatArray, prior: FloatArray, form: float = 0.0) -> Fit | None:
        """Return least squares of parameters that change from record to record; None if nothing is decided yet.

        Args:
            along: (r, d) functions of the place of each record; a parameter is their sum with d coefficients.
            mean: (d f,) of the prior of the coefficients, those of the first function first.
            prior: (d f,) their inverse standard deviations about it.
            form: share by which what stands in for records is off there beside its covariance.
        """
        if not self.spans_s > 0.0:
            return None
        n, f, parts = len(self.structure.states), self.free.size, []
        for k, ((level, weight), row) in enumerate(zip(self._parts(), along, strict=True)):
            if k not in self._replaced:
                slopes = level[:, None, n:].reshape(len(level), n, 1, f) * row[:, None]
                parts.append((np.hstack([level[:, :n], slopes.reshape(len(level), -1)]), weight))
        rows, right = [np.diag(prior)], [prior * mean]
        for records, covariance, values in self._instead.values():
            root = _whitening(covariance + np.diag((form * values) ** 2))
            rows.append(np.kron(along[list(records)].mean(axis=0), root))
            right.append(root @ values)
        return _fit(parts or [self._none(along.shape[1])], n, np.vstack(rows), np.concatenate(right))

    def _none(self, d: int) -> tuple[ComplexArray, float]:
        """Return the lines of no record, for parameters that are sums of d functions."""
        n = len(self.structure.states)
        return np.zeros((self.lines.size, n + n * d * self.free.size), np.complex128), 0.0

    @property
    def _replaced(self) -> set[int]:
        return {k for records, _, _ in self._instead.values() for k in records}

    def _parts(self) -> list[tuple[ComplexArray, float]]:
        n = len(self.structure.states)
        return [*self._kept, *([self._grown.level(n, self.settings.step_hz)] if self._grown.span_s > 0.0 else [])]


def _whitening(covariance: FloatArray) -> FloatArray:
    """Return W (f, f), W' W the inverse of a covariance."""
    size = np.sqrt(np.diag(covariance))
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance / np.outer(size, size))) / size)


def _fit(parts: Sequence[tuple[ComplexArray, float]], n: int, prior: FloatArray, right: FloatArray) -> Fit | None:
    """Return weighted least squares of errors (lines, n) on slopes (lines, n f), or None if they do not decide it.

    Beside them stands what is known before: rows ``prior`` (k, f) of what is ``right`` (k,), with errors of 1. A
    parameter without slopes, as that of a control that has not moved, is zero with an error beyond all.
    """
    f = prior.shape[1]
    F = np.vstack([part for part, _ in parts])
    lines = len(parts[0][0])
    weight = np.repeat([w for _, w in parts], lines)
    e, X = F[:, :n].T, F[:, n:].reshape(len(F), n, f).transpose(1, 0, 2)  # (n, lines), (n, lines, f)
    felt = np.any(X != 0.0, axis=1)  # (n, f)
    freedoms = 2.0 * weight.sum() - felt.sum(axis=1)
    if float(np.min(freedoms)) < 1.0 and not np.all(np.any(prior != 0.0, axis=0)):
        return None
    freedoms = np.maximum(freedoms, 1.0)
    root = np.sqrt(weight)
    R = np.sum(weight * np.abs(e) ** 2, axis=1) / freedoms
    for _ in range(_ROUNDS):
        R = np.maximum(R, 1e-24 * np.sum(weight * np.abs(e) ** 2, axis=1) + 1e-300)
        A = (X * (root[None, :] / np.sqrt(R)[:, None])[:, :, None]).reshape(-1, f)
        b = (e * root / np.sqrt(R)[:, None]).ravel()
        left = np.vstack([A.real, A.imag, prior])
        size = np.linalg.norm(left, axis=0)
        if not np.any(size > 0.0):
            return None
        nothing = size == 0.0
        left = np.vstack([left, np.diag(np.where(nothing, _NOTHING, 0.0))[nothing]])
        size = np.where(nothing, _NOTHING, size)
        U, s, Vt = np.linalg.svd(left / size, full_matrices=False)
        if not s[-1] ** 2 > _DECIDED * s[0] ** 2:
            return None
        step = (Vt.T / s) @ (U.T @ np.concatenate([b.real, b.imag, right, np.zeros(nothing.sum())])) / size
        v = e - X @ step
        R = np.sum(weight * np.abs(v) ** 2, axis=1) / freedoms
    inverse = (Vt.T / s**2) @ Vt / np.outer(size, size)
    power = (
        np.abs(v) ** 2 / np.maximum(R, 1e-300)[:, None] * weight.sum() / freedoms[:, None]
    )  # 1 on average, for a level spectrum
    by_line = np.mean(power.reshape(n, len(parts), lines), axis=1)
    width = np.ones(min(_NEIGHBOURS, lines))
    level = [np.convolve(row, width, "same") / np.convolve(np.ones(lines), width, "same") for row in by_line]
    A = A.reshape(n, -1, f)
    meat = np.einsum("ilf,il,ilg->fg", A.conj(), np.tile(level, (1, len(parts))), A, optimize=True).real
    corrected = inverse @ (meat + prior.T @ prior + np.diag(np.where(nothing, _NOTHING**2, 0.0))) @ inverse
    return Fit(step, inverse * float(np.mean(weight)), np.asarray(corrected), np.asarray(v), weight[::lines], R)


def _evenness(v: ComplexArray, weight: FloatArray) -> FloatArray:
    """Return per state the probability that level residuals differ as much between the halves of the band.

    The logarithm of the ratio of two powers has the variance 1/m1 + 1/m2, m their independent lines.
    """
    lines = v.shape[1] // weight.size
    total = np.abs(v.reshape(len(v), weight.size, lines)) ** 2
    half = lines // 2
    low, high = (np.mean(part, axis=(1, 2)) for part in (total[:, :, :half], total[:, :, half:]))
    counts = float(weight.sum()) * half, float(weight.sum()) * (lines - half)
    if min(counts) < 2.0:
        return np.ones(len(v))
    there = (low > 0.0) & (high > 0.0)
    ratio = np.log(np.where(there, high, 1.0) / np.where(there, low, 1.0))
    return np.asarray(erfc(np.abs(ratio) / np.sqrt(2.0 / counts[0] + 2.0 / counts[1])))


def _lines(settings: RecursiveFourier, dt_s: float) -> FloatArray:
    """Return the multiples of ``step_hz`` within the band, Hz."""
    (low, high), step = settings.band_hz, settings.step_hz
    nyquist = 0.5 / dt_s
    if not high <= nyquist * (1.0 + 1e-9):
        raise EstimationError(
            f"0 < low < high <= Nyquist frequency = {nyquist:g} Hz must hold, got {low:g} and {high:g}"
        )
    lines = step * np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1)
    if not lines.size:
        raise EstimationError(
            f"{low:g} to {high:g} Hz holds no multiple of {step:g} Hz; widen the band or give a smaller step_hz"
        )
    return np.asarray(lines)
