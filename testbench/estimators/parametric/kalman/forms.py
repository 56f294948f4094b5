"""Which form process noise has: none, of every state by itself, of all states together, or a gust; by likelihood.

Whether there is any is a likelihood ratio. Under "none" the intensities F F' lie on their bound, so that twice the
logarithm of the ratio is not chi-square with n degrees of freedom but chi-bar-square, a mixture of 0 to n degrees: for
one intensity half of it is zero (S. G. Self and K.-Y. Liang, Journal of the American Statistical Association 82, 1987).
The weights here are binomial, those of intensities that the data tell apart.

Which form it has: forms are not nested, and a gust that is not there has a bandwidth that nothing decides, so that no
such ratio has a known distribution. The least of G. Schwarz's criterion (Annals of Statistics 6, 1978) is taken,
-2 ln L + k ln N, with the k unknowns that a form adds. A form whose innovations are clearly larger than another's after
some rounds is given up there.
"""

from __future__ import annotations

from collections.abc import Callable
from math import comb
from typing import NamedTuple

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.parametric.kalman.gust import Sensor
from testbench.estimators.parametric.kalman.likelihood import FilterLikelihood
from testbench.estimators.parametric.kalman.search import Found, search

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
