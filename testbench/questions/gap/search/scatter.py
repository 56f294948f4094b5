"""A link that hands on every command late, each by a time of its own: the scatter beside the mean delay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

from testbench.core.record import FlightRecord, FloatArray
from testbench.effects import SERVOS
from testbench.effects.servo import CONTROLS
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.decide import noise_floor
from testbench.questions.gap.search.fit import EffectFit
from testbench.questions.gap.search.gauss_newton import AT_REST, SHORTENED
from testbench.questions.gap.search.hypothesis import Hypothesis, Signature
from testbench.questions.gap.search.polish import slopes

# Effects whose delay may differ from command to command, and the commands.
_SCATTERS = {SERVOS["delay", control].name: f"{control}_cmd" for control in CONTROLS}
_SMALL = 1e-2  # share of the largest change of a command below which a change is noise of the measured command
_ROUNDS = 8


def scattered(base: Hypothesis, fits: Sequence[EffectFit], chi2_tuned: float) -> EffectFit | None:
    """Return the fit of a delay with the scatter that its remainder asks for; None if more than noise is left then.

    Scatter is tried only for a delay that alone explains most of the excess but leaves more than noise.

    Command k changes by du_k and arrives d_k later than the mean. With the response h of the residuals to its
    control, that adds -sum_k h(t - t_k) du_k d_k to them. With independent Gaussian d_k of deviation s the residuals'
    covariance is V = I + s^2 J J', J the columns -h(t - t_k) du_k. Parameters and coefficients minimise r' V^-1 r,
    s minimises r' V^-1 r + ln det V (marginal likelihood), which takes the place of chi-square.

    Args:
        base: a point without any effect.
        fits: of all effects.
        chi2_tuned: weighted sum of squares without any effect, nuisances re-tuned.
    """
    noise, samples = chi2.isf(CRITERIA.scatter_left, noise_floor(base.believed, base.samples)), base.samples
    fit = next((f for f in fits if f.effect.name in _SCATTERS and f.settled and f.share > CRITERIA.scatter_leads), None)
    if fit is None or fit.chi2 <= noise:
        return None
    found = _at_rest(base, fit)
    if (
        found is None
        or found.s > 0.99 * CRITERIA.scatter_most * found.x[0]
        or fit.chi2 - found.cost < CRITERIA.told_apart
    ):
        return None  # the link is late by something else, or what is left does not scatter with the commands
    if found.left - samples > max(noise - samples, CRITERIA.scatter_form * (chi2_tuned - found.cost)):
        return None
    errors = dict(zip(fit.values, found.error.tolist(), strict=True))
    return replace(fit.brought_to(found.x, found.point, found.cost, chi2_tuned), errors=errors, scatter_s=found.s)


@dataclass(frozen=True, eq=False)
class _Scattered:
    """A point flown with a delay x (1,), and the likeliest scatter s of its residuals."""

    point: Hypothesis
    x: FloatArray
    s: float
    spread: _Spread

    @property
    def left(self) -> float:
        """The weighted sum of squares r' V^-1 r, and the price of the coefficients."""
        point = self.point
        return float(point.exact @ self.spread.weigh(point.exact, self.s) + point.deviations @ point.deviations)

    @property
    def cost(self) -> float:
        """What takes the place of chi-square."""
        return self.left + self.spread.volume(self.s)

    def normal(self, slope: FloatArray, tangents: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return normal matrix and gradient of half of ``left`` over the delay and the coefficients."""
        J = np.hstack([slope, tangents])
        price = np.concatenate([np.zeros(slope.shape[1]), 1.0 / self.point.prior_std**2])
        off = np.concatenate([np.zeros(slope.shape[1]), self.point.nuisances - 1.0])
        weighed = self.spread.weigh(J, self.s)
        return J.T @ weighed + np.diag(price), weighed.T @ self.point.exact + price * off

    @property
    def error(self) -> FloatArray:
        """Standard error of the delay (1,), which is the mean of delays that scatter.

        Its slope is the sum of the slopes of all commands, as V takes them to be linear.
        """
        normal, _ = self.normal(self.spread.together[:, None], self.point.tangents)
        return np.sqrt(np.diag(np.linalg.inv(normal))[:1])


def _at_rest(base: Hypothesis, fit: EffectFit) -> _Scattered | None:
    """Descend from a delay without scatter by Gauss-Newton steps; None if nothing flies there, or the delay is none."""
    signature, (delay,) = Signature(base, fit.effect), fit.effect.parameters
    errors = np.array(list(fit.errors.values()))

    def at(x: FloatArray, nuisances: FloatArray, spread: _Spread | None) -> _Scattered | None:
        point = base.moved(signature.model(x), nuisances)
        if point is None or x[0] <= delay.low:
            return None
        if spread is None:
            model, command = point.model.with_nuisances(point.by_name), _SCATTERS[fit.effect.name]
            spread = _Spread([_responses(model, r, command) for r in base.records])
        return _Scattered(point, x, spread.likeliest(point.exact, CRITERIA.scatter_most * float(x[0])), spread)

    here = at(np.array(list(fit.values.values())), base.vector(fit.nuisances), None)
    for _ in range(_ROUNDS if here is not None else 0):
        assert here is not None
        near = here.point.afresh(True)
        here = replace(here, point=near)
        normal, gradient = here.normal(slopes(signature, near, here.x, errors), near.tangents)
        step = -np.linalg.solve(normal, gradient)
        for share in SHORTENED:
            x = np.clip(here.x + share * step[:1], delay.low, delay.high)
            there = at(x, near.towards(near.nuisances + share * step[1:]), here.spread)
            if there is not None and there.cost < here.cost:
                break
        else:
            return here
        fallen, here = here.cost - there.cost, there
        if fallen < AT_REST:
            return here
    return here


@dataclass(frozen=True, eq=False)
class _Spread:
    """What scattered commands spread the residuals by.

    Attributes:
        responses: (samples of a record, commands that change) of every record, residuals per second of lateness.
    """

    responses: Sequence[FloatArray]

    @property
    def together(self) -> FloatArray:
        """What all commands a second later add to the residuals (samples,)."""
        return np.concatenate([J.sum(axis=1) for J in self.responses])

    @cached_property
    def _modes(self) -> list[tuple[FloatArray, FloatArray]]:
        """Directions (samples, modes) and the squares (modes,) of their sizes, of every record."""
        out = []
        for J in self.responses:
            U, sizes, _ = np.linalg.svd(J, full_matrices=False)
            out.append((U, sizes**2))
        return out

    def _split(self, r: FloatArray) -> list[FloatArray]:
        return np.split(r, np.cumsum([len(J) for J in self.responses])[:-1])

    def weigh(self, r: FloatArray, s: float) -> FloatArray:
        """Return V^-1 r, r (samples, ...)."""
        parts = []
        for part, (U, sizes) in zip(self._split(r), self._modes, strict=True):
            share = s**2 * sizes / (1.0 + s**2 * sizes)
            parts.append(part - U @ (share[:, None] * (U.T @ part) if part.ndim > 1 else share * (U.T @ part)))
        return np.concatenate(parts)

    def volume(self, s: float) -> float:
        """Return ln det V."""
        return float(sum(np.sum(np.log1p(s**2 * sizes)) for _, sizes in self._modes))

    def likeliest(self, r: FloatArray, most: float) -> float:
        """Return the scatter s, in seconds and up to ``most``, of the largest likelihood of residuals (samples,)."""
        seen = [((U.T @ part) ** 2, sizes) for part, (U, sizes) in zip(self._split(r), self._modes, strict=True)]

        def cost(ln_s: float) -> float:
            s2 = np.exp(2.0 * ln_s)
            return float(sum(np.sum(np.log1p(s2 * z) - c * s2 * z / (1.0 + s2 * z)) for c, z in seen))

        return float(np.exp(minimize_scalar(cost, bounds=(np.log(1e-6), np.log(most)), method="bounded").x))


def _responses(believed: Believed, record: FlightRecord, command: str) -> FloatArray:
    """Return the change of residuals (samples, commands that change) per second that a model has a command late."""
    u = record.columns([command])[:, 0] if command in record else np.zeros(len(record))
    du = np.diff(u, prepend=u[0])
    changed = np.flatnonzero(np.abs(du) > _SMALL * np.max(np.abs(du)))
    if not changed.size:
        return np.zeros((len(record) * len(believed.outputs), 1))
    first, data = int(changed[0]), record.data.copy()
    data[first - 1 : first + 1, record.channels.index(command)] += 0.5  # half to either side of where it changes
    pulse = (believed.predict_linear(replace(record, data=data)) - believed.predict_linear(record))[first - 1 :]
    columns = []
    for k in changed:
        late = np.zeros((len(record), pulse.shape[1]))
        late[k - 1 :] = pulse[: len(record) - k + 1]
        columns.append(believed.in_noise_units(record, late * du[k] / record.dt_s).ravel())
    return np.column_stack(columns)
