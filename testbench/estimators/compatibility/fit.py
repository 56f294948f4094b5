"""Output error on the kinematics, with residuals whitened, and the timing of instruments.

Noise of gyros and accelerometers is integrated by the kinematics and comes out as residuals that wander. An
autoregressive filter whitens them, output by output. It is estimated from them, in turn with the errors (generalised
least squares; D. Cochrane and G. H. Orcutt, Journal of the American Statistical Association 44, 1949).

How far the noise of gyros and accelerometers makes the reconstruction drift over a record.

The errors that instruments may have: their names, their plausible sizes, and the words for them.

A name is a channel and a kind: ``alpha_scale``, ``q_bias``, ``V_delay``, ``alpha_lag``; or the wind's direction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.signal import lfilter

from testbench.core.advice import Advice, note
from testbench.core.channels import channel
from testbench.core.constants import DEG_RAD
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.words import with_error
from testbench.estimators.parametric.gauss_newton import Minimum, minimise
from testbench.estimators.parametric.kinematics import ACCELEROMETERS, RATES, KinematicStructure
from testbench.estimators.parametric.response import Sampling, respond
from testbench.estimators.parametric.structure import STEP, AnyArray
from testbench.estimators.regression.smoothing import white_std

# --- the errors that instruments may have -----------------------------------------------------------------------------


TIMED = ("V", "alpha", "beta")
"""Channels that may come late: by a pure delay (negative: early, or the inertial unit is late), or through a lag."""
DELAY_LIMIT_S = 0.3
LAG_LIMIT_S = 1.0
LAG_LEAST_S = 1e-3
SETTLING_S = 0.5  # of timed channels at the start of a record: what they read goes back to before it

# Plausible sizes: an instrument with a larger error is broken rather than in need of calibration (estimates).
_SIZE = {
    "V_bias": 5.0,
    "alpha_bias": 5.0 * DEG_RAD,
    "beta_bias": 5.0 * DEG_RAD,
    "phi_bias": 5.0 * DEG_RAD,
    "theta_bias": 5.0 * DEG_RAD,
    "V_scale": 0.3,
    "alpha_scale": 0.5,
    "beta_scale": 0.5,
    "phi_scale": 0.2,
    "theta_scale": 0.2,
    "wind_north": 20.0,
    "wind_east": 20.0,
    "wind_down": 3.0,
}
_INSTRUMENT = {
    "V": "airspeed sensor",
    "alpha": "angle-of-attack vane",
    "beta": "sideslip vane",
    "p": "roll-rate gyro",
    "q": "pitch-rate gyro",
    "r": "yaw-rate gyro",
    "ax": "forward accelerometer",
    "ay": "lateral accelerometer",
    "az": "vertical accelerometer",
    "phi": "bank angle",
    "theta": "pitch angle",
}
_TOWARDS = {"wind_north": "towards north", "wind_east": "towards east", "wind_down": "downwards"}
_REVERSED = {"wind_north": "towards south", "wind_east": "towards west", "wind_down": "upwards"}
_IN_DEGREES = {"rad": "deg", "rad/s": "deg/s"}


def instrument(channel_name: str) -> str:
    """Return what measures a channel, e.g. "pitch-rate gyro"."""
    return _INSTRUMENT.get(channel_name, channel_name)


def plausible_size(name: str) -> float:
    """Return the size beyond which error ``name`` is not plausible, in SI units."""
    if name in _SIZE:
        return _SIZE[name]
    of, _, kind = name.rpartition("_")
    if kind == "delay":
        return DELAY_LIMIT_S
    if kind == "lag":
        return LAG_LIMIT_S
    if kind == "scale":
        return 0.1  # of a gyro
    return 3.0 * DEG_RAD if of in RATES else 1.0


def none_value(name: str) -> float:
    """Return the value of ``name`` that means no error."""
    return 1.0 if name.endswith("_scale") else 0.0


def candidates(structure: KinematicStructure) -> tuple[str, ...]:
    """Return the errors that can be sought, in the order in which they are believed when data cannot tell."""
    have = [p.name for p in structure.parameters if p.free]
    ranked = [f"{n}_bias" for n in (*RATES, *ACCELEROMETERS)]
    ranked += [f"{n}_{kind}" for kind in ("scale", "bias") for n in ("alpha", "beta", "V")]
    delays = [f"{n}_delay" for n in TIMED if n in structure.outputs]
    ranked += [*delays, *_TOWARDS]
    ranked += [f"{n}_{kind}" for kind in ("scale", "bias") for n in ("theta", "phi")]
    ranked += [f"{n}_scale" for n in RATES]
    return tuple(n for n in ranked if n in have or n in delays)


def in_words(name: str, value: float, error: float) -> str:
    """Return what an error means, e.g. "the angle-of-attack vane reads 9.8 +- 0.6 % too much"."""
    if name in _TOWARDS:
        where = _TOWARDS[name] if value >= 0.0 else _REVERSED[name]
        return f"the wind blows {with_error(abs(value), error)} m/s {where}"
    of, _, kind = name.rpartition("_")
    what = _INSTRUMENT[of]
    if kind in ("delay", "lag"):
        if kind == "lag":
            return f"the {what} lags with a time constant of {with_error(value, error)} s"
        late = "late" if value >= 0.0 else "early"
        return f"the {what} comes {with_error(abs(value), error)} s {late} against the inertial unit"
    if kind == "scale":
        off = 100.0 * (value - 1.0)
        return f"the {what} reads {with_error(abs(off), 100.0 * error)} % too {'much' if off >= 0.0 else 'little'}"
    unit = channel(of).unit
    factor = 1.0 / DEG_RAD if unit in _IN_DEGREES else 1.0
    size = with_error(abs(value) * factor, error * factor)
    return f"the {what} reads {size} {_IN_DEGREES.get(unit, unit)} too {'much' if value >= 0.0 else 'little'}"


# --- output error on the kinematics, with residuals whitened, and the timing of instruments ---------------------------


_ORDERS = (0, 1, 2, 3, 4, 6, 8, 12, 16, 24)  # of the whitening filters
_SAMPLES_PER_ORDER = 20
_ROUNDS = 4
_SETTLED = 1e-4  # squared change of the unknowns in standard errors, per unknown, that ends the rounds
_EXACT = 1e-6  # residuals below this share of an output's size are errors of integration: nothing to whiten
_MOVING = 0.1  # as _SETTLED; beyond it the search is said not to have settled
_ITERATIONS = 15


class Stretch(NamedTuple):
    """One record: inputs (N, m), outputs (N, p), which of them count, and measured states (N, n)."""

    u: FloatArray
    y: FloatArray
    valid: NDArray[np.bool_]
    x: FloatArray


@dataclass(frozen=True)
class Whitener:
    """Filter of the residuals of one output: e[i] = (v[i] - sum_j a[j] v[i-1-j]) / std over the samples that count."""

    a: FloatArray
    std: float


class Fit(NamedTuple):
    """The end of a search: errors by name, initial states, residuals (N, p) as measured, filters, and how it went."""

    values: dict[str, float]
    x0: list[FloatArray]
    residuals: list[FloatArray]
    whiteners: list[Whitener]
    cost: float
    converged: bool
    at_bound: tuple[str, ...]


def stretch(record: FlightRecord, structure: KinematicStructure) -> Stretch:
    """Return a record as the search sees it: gaps of the inputs bridged by lines, angles unwrapped, rates derived.

    Angular accelerations that positions of accelerometers need, and that the record lacks, are differences of rates.

    Raises:
        EstimationError: a channel has fewer than two valid samples.
    """
    part = record.select([n for n in (*structure.inputs, *structure.outputs) if n in record])
    columns = {}
    for name in part.channels:
        good = part.valid[:, part.channels.index(name)]
        if good.sum() < 2:
            raise EstimationError(
                f"data compatibility needs at least 2 valid samples of '{name}', got {int(good.sum())}"
            )
        samples = np.unwrap(part[name][good]) if name in ("phi", "psi") else part[name][good]
        columns[name] = np.interp(part.t_s, part.t_s[good], samples)
    for name in structure.inputs:
        if name not in columns:  # angular accelerations only: kinematics() has asked for the rest
            columns[name] = np.gradient(columns[name.removesuffix("dot")], record.dt_s)
    y = np.column_stack([columns[n] for n in structure.outputs])
    valid = np.column_stack([part.valid[:, part.channels.index(n)] for n in structure.outputs])
    t = record.t_s - record.t_s[0]
    for i, name in enumerate(structure.outputs):
        if name in TIMED:
            valid[:, i] &= (t >= SETTLING_S) & (t <= t[-1] - DELAY_LIMIT_S)
    u = np.column_stack([columns[n] for n in structure.inputs])
    return Stretch(u, y, valid, _measured_states(columns, structure.states))


def _measured_states(columns: Mapping[str, FloatArray], states: Sequence[str]) -> FloatArray:
    """Return the states (N, n) that the outputs show; where alpha is not measured, those of level flight."""
    V, beta = columns["V"], columns.get("beta", 0.0)
    alpha = columns.get("alpha", columns.get("theta", 0.0))
    velocity = {
        "u": V * np.cos(alpha) * np.cos(beta),
        "v": V * np.sin(beta),
        "w": V * np.sin(alpha) * np.cos(beta),
    }
    return np.column_stack([velocity[s] if s in velocity else columns[s] for s in states])


def late(columns: FloatArray, dt_s: float, delay_s: float) -> tuple[FloatArray, FloatArray]:
    """Return samples (N, c) as they come ``delay_s`` late (early if negative) and the derivative of the first column.

    Between samples quintic splines interpolate; beyond the ends the outermost value is held.
    """
    t = dt_s * np.arange(len(columns))
    spline = make_interp_spline(t, columns, k=min(5, len(t) - 1))
    at = np.clip(t - delay_s, 0.0, t[-1])
    return np.asarray(spline(at)), np.asarray(-spline.derivative()(at)[:, 0])


def lagged(columns: AnyArray, dt_s: float, lag_s: AnyArray | float | complex) -> AnyArray:
    """Return samples (N, c) through a first-order lag at rest with the first of them; exact for straight lines."""
    h = dt_s / lag_s
    a = np.exp(-h)
    mean = (1.0 - a) / h
    return np.asarray(lfilter([1.0 - mean, mean - a], [1.0, -a], columns - columns[0], axis=0)) + columns[0]


class Problem:
    """The residuals of all records as functions of the errors and the initial states."""

    def __init__(self, structure: KinematicStructure, stretches: Sequence[Stretch], dt_s: float) -> None:
        self.structure, self.stretches, self.dt_s = structure, stretches, dt_s
        self.held = np.zeros(len(structure.inputs), bool)
        self.n = len(structure.states)
        self._near = [s.x for s in stretches]  # of each the states found last, where the next response is begun
        y = [s.y[s.valid[:, i], i] for s in stretches for i in range(len(structure.outputs))]
        spread = np.array([np.std(column) if column.size else 0.0 for column in y]).reshape(len(stretches), -1)
        self.size = np.maximum(spread.max(axis=0), 1e-6)
        self.counts = np.sum([s.valid.sum(axis=0) for s in stretches], axis=0)

    def respond(
        self, values: Mapping[str, float], x0: Sequence[FloatArray], names: Sequence[str] = ()
    ) -> list[tuple[FloatArray, FloatArray]]:
        """Return per record what the instruments read (N, p) and its derivatives (N, p, k + n * records).

        Args:
            values: error -> value; no error where not named.
            x0: initial state (n,) per record.
            names: the k errors whose derivatives are wanted.
        """
        of = self.structure.parameter_names
        params = self.structure.values.copy()
        for name, value in values.items():
            if name in of:
                params[of.index(name)] = value
        chosen = [of.index(name) for name in names if name in of]
        out = []
        for i, (s, start) in enumerate(zip(self.stretches, x0, strict=True)):
            near = self._near[i]
            begin = start if near is None else np.concatenate([start[None], near[1:]])
            r = respond(self.structure, params, chosen, s.u, Sampling(self.dt_s, self.held), begin)
            if np.all(np.isfinite(r.x)):
                self._near[i] = r.x
            J = np.zeros((*s.y.shape, len(names) + self.n * len(self.stretches)))
            J[:, :, [j for j, name in enumerate(names) if name in of]] = r.dparams
            own = slice(len(names) + i * self.n, len(names) + (i + 1) * self.n)
            J[:, :, own] = r.dx0
            y = r.y.copy()
            if np.all(np.isfinite(y)):
                self._time(y, J, values, names)
            out.append((y, J))
        return out

    def _time(self, y: FloatArray, J: FloatArray, values: Mapping[str, float], names: Sequence[str]) -> None:
        """Send the timed channels through their lags and delays, in place."""
        for i, name in enumerate(self.structure.outputs):
            lag, delay = f"{name}_lag", f"{name}_delay"
            columns = np.column_stack([y[:, i], J[:, i]])
            if lag in names or values.get(lag, 0.0) > 0.0:
                tau = max(values.get(lag, 0.0), LAG_LEAST_S)
                slope = lagged(columns[:, :1], self.dt_s, tau + 1j * STEP).imag[:, 0] / STEP
                columns = lagged(columns, self.dt_s, tau)
                if lag in names:
                    columns[:, 1 + names.index(lag)] = slope
            if delay in names or values.get(delay, 0.0):
                columns, slope = late(columns, self.dt_s, values.get(delay, 0.0))
                if delay in names:
                    columns[:, 1 + names.index(delay)] = slope
            y[:, i], J[:, i] = columns[:, 0], columns[:, 1:]

    def residuals(self, values: Mapping[str, float], x0: Sequence[FloatArray]) -> list[FloatArray]:
        """Return measured minus read, (N, p) per record, zero where not valid."""
        pairs = zip(self.stretches, self.respond(values, x0), strict=True)
        return [np.where(s.valid, s.y - y, 0.0) for s, (y, _) in pairs]

    def whitened(
        self, whiteners: Sequence[Whitener], values: Mapping[str, float], x0: Sequence[FloatArray], names: Sequence[str]
    ) -> list[tuple[FloatArray, FloatArray]]:
        """Return per record whitened residuals (N, p) and their derivatives (N, p, k + n * records)."""
        out = []
        for s, (y, J) in zip(self.stretches, self.respond(values, x0, names), strict=True):
            both = np.concatenate([(s.y - y)[:, :, None], -J], axis=2)
            white = np.zeros_like(both)
            for i, w in enumerate(whiteners):
                rows = np.flatnonzero(s.valid[:, i])
                order = w.a.size
                if rows.size <= order:
                    continue
                columns = both[rows, i]
                e = columns[order:].copy()
                for j, a in enumerate(w.a):
                    e -= a * columns[order - 1 - j : len(columns) - 1 - j]
                white[rows[order:], i] = e / w.std
            out.append((white[:, :, 0], white[:, :, 1:]))
        return out

    def first_whiteners(self) -> list[Whitener]:
        """Return the noise of every output from third differences of its samples, which leave little of the motion."""
        out = []
        for i in range(len(self.structure.outputs)):
            std = white_std([s.y[s.valid[:, i], i] for s in self.stretches])
            out.append(Whitener(np.zeros(0), max(std, 1e-3 * self.size[i])))
        return out

    def start(self, names: Sequence[str]) -> tuple[dict[str, float], list[FloatArray], list[Whitener]]:
        """Return the start of a search: biases of rates and accelerations, initial states, and white noise.

        Equation error in integral form: with the measured states x in the equations, x(t) = x(0) + integral of
        f(x, u, 0) + sum of b integral df/db is linear in the biases b and x(0). Without it the drift that a bias makes
        over a long record sends the search to solutions far from any instrument.
        """
        of, k, records = self.structure.parameter_names, 0, len(self.stretches)
        chosen = [n for n in names if n in {f"{c}_bias" for c in (*RATES, *ACCELEROMETERS)}]
        k = len(chosen)
        P = np.tile(self.structure.values.astype(complex), (k + 1, 1))
        P[np.arange(k), [of.index(n) for n in chosen]] += 1j * STEP
        left, right = [], []
        for i, s in enumerate(self.stretches):
            shape = (len(s.u), k + 1)
            x = np.broadcast_to(s.x[:, None, :], (*shape, self.n))
            u = np.broadcast_to(s.u[:, None, :], (*shape, s.u.shape[1]))
            f = self.structure.derivative(x, u, P)
            sums = np.concatenate([np.zeros((1, *f.shape[1:])), np.cumsum(0.5 * (f[1:] + f[:-1]), axis=0)]) * self.dt_s
            J = np.zeros((len(s.u), self.n, k + self.n * records))
            J[:, :, :k] = sums[:, :k].imag.transpose(0, 2, 1) / STEP
            J[:, :, k + i * self.n + np.arange(self.n)] = np.eye(self.n)
            left.append(J)
            right.append(s.x - sums[:, k].real)
        A, b = np.concatenate(left), np.concatenate(right)
        weight = 1.0 / np.maximum(np.std(b, axis=0), 1e-9)
        for _ in range(3):  # each equation by its own misfit
            point = np.linalg.lstsq((A * weight[:, None]).reshape(-1, A.shape[2]), (b * weight).ravel(), rcond=1e-10)[0]
            weight = 1.0 / np.maximum(np.std(b - A @ point, axis=0), 1e-9)
        size = np.array([plausible_size(n) for n in chosen])
        values = dict(zip(chosen, np.clip(point[:k], -size, size).tolist(), strict=True))
        x0 = list(point[k:].reshape(records, self.n))
        noise = np.sum([np.sum(r**2, axis=0) for r in self.residuals(values, x0)], axis=0)
        std = np.sqrt(noise / np.maximum(self.counts, 1))
        least = [w.std for w in self.first_whiteners()]
        return values, x0, [Whitener(np.zeros(0), max(float(v), m)) for v, m in zip(std, least, strict=True)]

    def whiteners(self, residuals: Sequence[FloatArray], unknowns: int) -> list[Whitener]:
        """Return the filters that whiten residuals, their order by the Bayesian information criterion."""
        out = []
        share = 1.0 - unknowns / max(float(self.counts.sum()), unknowns + 1.0)  # degrees of freedom that are left
        for i in range(len(self.structure.outputs)):
            v = [r[s.valid[:, i], i] for r, s in zip(residuals, self.stretches, strict=True)]
            total = np.concatenate(v)
            rms = float(np.sqrt(np.mean(total**2))) if total.size else 1.0
            white = Whitener(np.zeros(0), max(rms, 1e-13 * self.size[i]))
            least = _EXACT * self.size[i]
            filtered = white if total.size == 0 or np.std(total) <= least else _autoregression(v, share, least)
            # What a filter predicts to within errors of integration is no noise, and a filter of it would take out
            # what the errors sought for show: data without noise stay as they are.
            out.append(white if filtered.std <= least else filtered)
        return out

    def solve(
        self,
        names: Sequence[str],
        values: Mapping[str, float],
        x0: Sequence[FloatArray],
        whiteners: Sequence[Whitener],
    ) -> Fit:
        """Return the errors ``names`` and the initial states that minimise the whitened residuals.

        The prior of every error is zero, with its plausible size as standard deviation. It holds the search in place
        along directions that the data do not decide, and is negligible along the others.

        Args:
            names: the errors that are sought; the others keep their ``values``.
            values: where the search starts.
            x0: initial states (n,) that it starts from, per record.
            whiteners: filters that it starts with.

        Raises:
            EstimationError: the motion diverges over a record.
        """
        unknowns = len(names) + self.n * len(self.stretches)
        here, starts, filters, settled = dict(values), list(x0), list(whiteners), False
        for _ in range(_ROUNDS):
            tolerance = (1e-3 if settled else 1.0) / float(self.counts.sum())
            here, starts, found, moved = self._search(names, here, starts, filters, tolerance)
            residuals = self.residuals(here, starts)
            filters = self.whiteners(residuals, unknowns)
            exact = all(w.std <= _EXACT * size for w, size in zip(filters, self.size, strict=True))
            if settled and (exact or moved <= _SETTLED * unknowns):
                break
            settled = True
        at_bound = tuple(m for m, b in zip(names, found.at_bound, strict=False) if b)
        converged = bool(found.converged and (exact or moved <= _MOVING * unknowns))
        return Fit(here, starts, residuals, filters, found.cost, converged, at_bound)

    def _search(
        self,
        names: Sequence[str],
        values: Mapping[str, float],
        x0: Sequence[FloatArray],
        whiteners: Sequence[Whitener],
        tolerance: float,
    ) -> tuple[dict[str, float], list[FloatArray], Minimum, float]:
        """Return values, initial states, how the search with these filters went, and how far, in standard errors."""
        names, records, k = list(names), len(self.stretches), len(names)
        low, high = self._bounds(names)
        point = np.concatenate([[values.get(m, none_value(m)) for m in names], *x0])
        fixed = {m: v for m, v in values.items() if m not in names}
        centre = np.array([none_value(m) for m in names])
        prior = np.zeros((k, point.size))
        prior[np.arange(k), np.arange(k)] = [1.0 / plausible_size(m) for m in names]

        def split(at: FloatArray) -> tuple[dict[str, float], list[FloatArray]]:
            return {**fixed, **dict(zip(names, at[:k].tolist(), strict=True))}, list(at[k:].reshape(records, self.n))

        def problem(at: FloatArray) -> tuple[FloatArray, FloatArray]:
            with np.errstate(all="ignore"):  # a trial step may diverge: the search sees that and shortens it
                parts = self.whitened(whiteners, *split(at), names)
            r = [*(r.ravel() for r, _ in parts), prior @ at - prior[:, :k] @ centre]
            return np.concatenate(r), np.vstack([*(J.reshape(-1, at.size) for _, J in parts), prior])

        try:
            found = minimise(problem, point, low, high, tolerance=tolerance, max_iterations=_ITERATIONS)
        except EstimationError as error:
            raise EstimationError(
                "the motion that the kinematics reconstruct diverges: check signs and units of rates, accelerations "
                "and angles, or use shorter records"
            ) from error
        moved = float(np.sum((found.R @ (found.point - point)) ** 2))
        return *split(found.point), found, moved

    def instead(self, fit: Fit, lag: str, delay: str) -> Fit:
        """Return the fit with a lag in the place of a delay, whitened as it was."""
        names = [n for n in fit.values if n != delay]
        start = {n: fit.values[n] for n in names} | {lag: fit.values[delay]}
        tolerance = 1e-3 / float(self.counts.sum())
        values, x0, found, _ = self._search([*names, lag], start, fit.x0, fit.whiteners, tolerance)
        return fit._replace(values=values, x0=x0, residuals=self.residuals(values, x0), cost=found.cost)

    def _bounds(self, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        free = self.n * len(self.stretches)
        low, high = np.full(len(names) + free, -np.inf), np.full(len(names) + free, np.inf)
        for i, name in enumerate(names):
            kind = name.rpartition("_")[2]
            if kind == "delay":
                low[i], high[i] = -DELAY_LIMIT_S, DELAY_LIMIT_S
            elif kind == "lag":
                low[i], high[i] = LAG_LEAST_S, LAG_LIMIT_S
            elif kind == "scale":
                low[i], high[i] = 0.1, 10.0
        return low, high


def _autoregression(v: Sequence[FloatArray], share: float, floor: float) -> Whitener:
    """Return the filter that whitens series of one output, all orders fitted to the same samples by least squares."""
    most = min(_ORDERS[-1], sum(x.size for x in v) // _SAMPLES_PER_ORDER, min(x.size for x in v) // 4)
    orders = [order for order in _ORDERS if order <= most]
    rows = [np.lib.stride_tricks.sliding_window_view(x, orders[-1] + 1)[:, ::-1] for x in v if x.size > orders[-1]]
    table = np.vstack(rows)
    target, past = table[:, 0], table[:, 1:]
    count = len(target)
    best: tuple[float, FloatArray, float] | None = None
    for order in orders:
        a = np.asarray(np.linalg.lstsq(past[:, :order], target, rcond=None)[0]) if order else np.zeros(0)
        variance = float(np.mean((target - past[:, :order] @ a) ** 2))
        score = count * np.log(max(variance, floor**2)) + order * np.log(count)
        if best is None or score < best[0]:
            best = score, a, variance
    assert best is not None
    # estimated means count as spent: residuals are smaller than the noise by the unknowns fitted to them
    return Whitener(best[1], max(float(np.sqrt(best[2] / share)), floor))


_LONG = 3.0
_OF_RATE = {"p": "phi", "q": "theta", "r": "psi"}


def noise_std(stretches: Sequence[Stretch], column: int, of_inputs: bool = True) -> float:
    """Return the standard deviation of white noise in a column."""
    return white_std([(s.u if of_inputs else s.y)[:, column] for s in stretches])


def too_long(structure: KinematicStructure, stretches: Sequence[Stretch], dt_s: float) -> list[Advice]:
    """Return in words where records are long for output error, which takes rates and accelerations as exact.

    White noise of standard deviation s in the samples of a rate makes the angle drift by s sqrt(dt T) after T, and
    through gravity a velocity by g s sqrt(dt T^3 / 3). A record is called long if that exceeds three times the noise of
    the angle, or of the airspeed.
    """
    T = max(len(s.u) for s in stretches) * dt_s
    drifts = []
    for rate, angle in _OF_RATE.items():
        if rate not in structure.inputs:
            continue
        gyro = noise_std(stretches, structure.inputs.index(rate))
        pairs = [(angle, gyro * np.sqrt(dt_s * T), 1.0 / DEG_RAD, "deg")]
        if rate != "r":
            pairs.append(("V", structure.gravity_m_s2 * gyro * np.sqrt(dt_s * T**3 / 3.0), 1.0, "m/s"))
        for name, drift, factor, unit in pairs:
            if name not in structure.outputs:
                continue
            noise = noise_std(stretches, structure.outputs.index(name), False)
            if drift > _LONG * noise > 0.0:
                drifts.append(
                    f"that of {rate} moves {name} by {drift * factor:.2g} {unit} (noise of {name}: "
                    f"{noise * factor:.2g} {unit})"
                )
    if not drifts:
        return []
    said = (
        f"records of {T:.0f} s are long for output error, because noise of the rates adds up: {'; '.join(drifts)}; the "
        "standard errors allow for it, and shorter records would make them smaller"
    )
    return [note("long_records", said)]
