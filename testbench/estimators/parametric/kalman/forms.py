"""Which form process noise has: none, of every state by itself, of all states together, or a gust; by likelihood.

Whether there is any is a likelihood ratio. Under "none" the intensities F F' lie on their bound, so that twice the
logarithm of the ratio is not chi-square with n degrees of freedom but chi-bar-square, a mixture of 0 to n degrees: for
one intensity half of it is zero (S. G. Self and K.-Y. Liang, Journal of the American Statistical Association 82, 1987).
The weights here are binomial, those of intensities that the data tell apart.

Which form it has: forms are not nested, and a gust that is not there has a bandwidth that nothing decides, so that no
such ratio has a known distribution. The least of G. Schwarz's criterion (Annals of Statistics 6, 1978) is taken,
-2 ln L + k ln N, with the k unknowns that a form adds. A form whose innovations are clearly larger than another's after
some rounds is given up there.

A gust that turns the flow: one more state of a structure, through which turbulence acts on all equations at once.

    dx/dt = f(x + e g, u, params),    y = h(x + e g, u, params),    dg/dt = -a g + noise

e picks the flow angle (alpha, or beta): the forces feel the angle of the air, the inertial angle plus that of the gust
g, so that the gust enters the equations in the proportion of their own derivatives, Z_alpha to M_alpha. Where the
sensor of the flow angle is inertial (a navigation filter), its output does not feel g; where it is a vane, it does. The
gust is of first order with the bandwidth a, rad/s: for vertical gusts close to Dryden's spectrum with a about V / L
(MIL-F-8785C, 1980).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import comb
from typing import Literal, NamedTuple

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.parametric.kalman.likelihood import FilterLikelihood, Found, search
from testbench.estimators.parametric.structure import AnyArray, LinearStructure, Matrices, ModelStructure, Parameter

# --- a gust that turns the flow ---------------------------------------------------------------------------------------


Sensor = Literal["inertial", "vane"]
ANGLES = ("alpha", "beta")
BANDWIDTH = "ln_gust_bandwidth"
_MIDDLE, _SPREAD = 1.0, 1.5  # prior of the bandwidth: 1 rad/s, within a factor exp(1.5) of it (judged)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Gust(ModelStructure):
    """The structure with its gust: the state "gust" comes first, the parameter ln a last."""

    calm: ModelStructure  # the structure without gust
    angle: int  # index of the state that is the flow angle
    inertial: tuple[bool, ...]  # (p,) outputs that do not feel the gust

    @property
    def meaning(self) -> str:
        """That of the structure without gust."""
        return self.calm.meaning

    @property
    def followers(self) -> tuple[str, ...]:
        """Those of the structure without gust."""
        return self.calm.followers

    def at_rest(self, u: FloatArray) -> FloatArray:
        """Return the states ``followers`` where the inputs (m,) have been constant."""
        return self.calm.at_rest(u)

    def derivative(self, x: AnyArray, u: AnyArray, params: AnyArray) -> AnyArray:
        """Return d/dt of gust and states."""
        moved = self.calm.derivative(self._felt(x), u, params[..., :-1])
        gust = -np.exp(params[..., -1]) * x[..., 0]
        return np.concatenate([np.broadcast_to(gust[..., None], (*moved.shape[:-1], 1)), moved], axis=-1)

    def output(self, x: AnyArray, u: AnyArray, params: AnyArray) -> AnyArray:
        """Return the outputs."""
        y = self.calm.output(self._felt(x), u, params[..., :-1])
        return y - np.where(self.inertial, x[..., :1], 0.0)

    def _felt(self, x: AnyArray) -> AnyArray:
        out = x[..., 1:].copy()
        out[..., self.angle] += x[..., 0]
        return out


@dataclass(frozen=True, eq=False, kw_only=True)
class _LinearGust(_Gust, LinearStructure):
    """The same of a linear structure."""

    def matrices(self, params: AnyArray) -> Matrices:
        """Return the matrices of parameters (..., k)."""
        assert isinstance(self.calm, LinearStructure)
        s, lead = self.calm.matrices(params[..., :-1]), params.shape[:-1]
        n, m, p = len(self.calm.states), len(self.inputs), len(self.outputs)
        kind = np.result_type(params, float)
        A, B = np.zeros((*lead, n + 1, n + 1), kind), np.zeros((*lead, n + 1, m), kind)
        C, bx = np.zeros((*lead, p, n + 1), kind), np.zeros((*lead, n + 1), kind)
        A[..., 1:, 1:], A[..., 1:, 0], A[..., 0, 0] = s.A, s.A[..., :, self.angle], -np.exp(params[..., -1])
        C[..., 1:], C[..., 0] = s.C, s.C[..., :, self.angle] - np.array(self.inertial, float)
        B[..., 1:, :], bx[..., 1:] = s.B, s.bx
        return Matrices(A, B, C, s.D, bx, s.by)

    derivative = LinearStructure.derivative
    output = LinearStructure.output


def flow_angle(structure: ModelStructure) -> str | None:
    """Return the state that a gust turns: alpha, else beta, else None."""
    return next((name for name in ANGLES if name in structure.states), None)


def with_gust(structure: ModelStructure, sensor: Sensor, nyquist_rad_s: float) -> ModelStructure:
    """Return a structure that has a flow angle among its states, with a gust.

    Args:
        structure: without gust.
        sensor: what measures the flow angle, if it is an output.
        nyquist_rad_s: upper bound of the gust's bandwidth.
    """
    name = flow_angle(structure)
    assert name is not None
    low, high = np.log(1e-2), np.log(nyquist_rad_s)
    bandwidth = Parameter(BANDWIDTH, min(np.log(_MIDDLE), high - 1.0), low=low, high=high, prior_std=_SPREAD)
    make = _LinearGust if isinstance(structure, LinearStructure) else _Gust
    return make(
        name=structure.name,
        states=("gust", *structure.states),
        inputs=structure.inputs,
        outputs=structure.outputs,
        parameters=(*structure.parameters, bandwidth),
        calm=structure,
        angle=structure.states.index(name),
        inertial=tuple(sensor == "inertial" and output == name for output in structure.outputs),
    )


# --- which form process noise has -------------------------------------------------------------------------------------


FALSE_ALARM = 0.01
"""Share of calm records in which process noise is seen."""

_ROUNDS = 6  # after which a form may be given up
_CLEARLY = 0.05  # of the innovations' variance, on average: what further rounds do not catch up with (judged)


class Form(NamedTuple):
    """ "none", "diagonal", "full" or "gust"; a gust with what measures the flow angle."""

    name: str
    sensor: Sensor | None = None

    def __str__(self) -> str:
        """Return its name, with the sensor of a gust."""
        return self.name if self.sensor is None else f"{self.name}, {self.sensor}"


class Fit(NamedTuple):
    """The end of the search with one form of process noise, twice its log likelihood, and its noise's unknowns."""

    form: Form
    likelihood: FilterLikelihood
    found: Found
    two_ln_L: float
    unknowns: int

    @property
    def criterion(self) -> float:
        """Schwarz's criterion without what all forms share."""
        return self.unknowns * float(np.log(self.likelihood.base.counts.sum())) - self.two_ln_L


class Choice(NamedTuple):
    """The fit that is taken, all of them, and 2 ln L of process noise against none with its probability under none.

    The last two are None where either was not fitted.
    """

    fit: Fit
    tried: tuple[Fit, ...]
    against_none: float | None
    probability: float | None


def chi_bar_square(x: float, n: int) -> float:
    """Return the probability that a likelihood ratio 2 ln L of n variances on their bound exceeds x.

    Args:
        x: 2 ln L.
        n: number of variances; 0 gives 1.
    """
    from scipy.stats import chi2

    if x <= 0.0:
        return 1.0
    return float(sum(comb(n, k) / 2.0**n * chi2.sf(x, k) for k in range(1, n + 1))) if n else 1.0


def fitted(form: Form, likelihood: FilterLikelihood, values: FloatArray, max_iterations: int, least: float) -> Fit:
    """Return the fit with one form of process noise, from parameter values (k,).

    Args:
        form: its name.
        likelihood: with this form.
        values: to start from.
        max_iterations: Gauss-Newton steps of the last round.
        least: the criterion to reach; a search that stays clearly above it is given up.

    Raises:
        EstimationError: the filter diverges from these values.
    """
    if np.isfinite(least):
        fit = _fit(form, likelihood, search(likelihood, values, max_iterations, _ROUNDS))
        if fit.criterion > least + _CLEARLY * float(likelihood.base.counts.sum()):
            return fit
        values = _values(fit, values.size)
    return _fit(form, likelihood, search(likelihood, values, max_iterations))


def _fit(form: Form, likelihood: FilterLikelihood, found: Found) -> Fit:
    base = likelihood.base
    R = np.diag(base.noise([part.v for part in found.parts]))
    unknowns = likelihood.unknowns - base.unknowns
    if form.name == "gust":
        unknowns += 1 + base.layout.free_states * len(base.stretches)  # bandwidth, and where the gust begins
    return Fit(form, likelihood, found, -float(base.counts @ np.log(R)), unknowns)


def chosen(
    forms: tuple[Form, ...],
    make: Callable[[Form], FilterLikelihood],
    values: FloatArray,
    max_iterations: int,
    against_none: bool = True,
) -> Choice:
    """Fit forms of process noise and choose one.

    "none" is fitted beside the others, for the test against it, unless ``against_none`` is False; it is taken if it is
    the only one asked for, or if it is among those asked for and the test does not refuse it.

    Args:
        forms: asked for; the first that is not "none" starts the others.
        make: the likelihood with one form.
        values: (k,) parameter values to start from, of the structure without gust.
        max_iterations: Gauss-Newton steps of the last round.
        against_none: whether "none" is fitted where it is not asked for.

    Raises:
        EstimationError: no form that was asked for can be fitted; the reason of the first.
    """
    fits: list[Fit] = []
    failure: EstimationError | None = None
    noisy = [form for form in forms if form.name != "none"]
    calm_too = against_none or len(noisy) < len(forms)
    for form in (*noisy, *((Form("none"),) if calm_too else ())):
        likelihood = make(form)
        first = likelihood.base.structure.values.copy()
        first[: values.size] = values
        try:
            least = min((fit.criterion for fit in fits), default=np.inf)
            fits.append(fitted(form, likelihood, first, max_iterations, least))
        except EstimationError as error:
            failure = failure or error
            continue
        if len(fits) == 1 and fits[0].found.converged:
            values = _values(fits[0], values.size)
    asked = [fit for fit in fits if fit.form in forms]
    if not asked:
        assert failure is not None
        raise failure
    good = [fit for fit in asked if fit.found.converged] or asked
    best = min(good, key=lambda fit: fit.criterion)
    calm = next((fit for fit in fits if fit.form.name == "none"), None)
    # against none the forms whose ratio has a known distribution, and the one that is taken
    tested = next((fit for fit in fits if fit.form.name in ("diagonal", "full")), None)
    if calm is None or tested is None:
        return Choice(best, tuple(fits), None, None)
    ratio = tested.two_ln_L - calm.two_ln_L
    probability = chi_bar_square(ratio, tested.unknowns)
    if calm in asked and calm.found.converged and probability > FALSE_ALARM and calm.criterion <= best.criterion:
        best = calm
    elif best is calm:
        best = min((fit for fit in good if fit is not calm), key=lambda fit: fit.criterion, default=calm)
    return Choice(best, tuple(fits), ratio, probability)


def _values(fit: Fit, count: int) -> FloatArray:
    """Return the parameter values (count,) that a fit ended at."""
    base = fit.likelihood.base
    return base.parameters(fit.found.minimum.point, base.structure.values)[:count]
