"""What is found in flights of what was found: the user's own flight again, many times, by the same likelihood.

A model flies the records' own inputs from their own starts; what it left of each record is drawn anew and laid over
it, and the parameters are estimated again (parametric bootstrap: B. Efron and R. J. Tibshirani, An Introduction to the
Bootstrap, 1993, section 6.5). What is left is drawn as a surrogate that has its spectra and cross-spectra with other
phases (J. Theiler and others, Physica D 58, 1992), so that noise of any colour stays what it was.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.core.errors import Refusal
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.parametric.gauss_newton import minimise
from testbench.estimators.parametric.likelihood import Likelihood
from testbench.estimators.parametric.model import ParametricModel

MOST, FEWEST = 200, 10  # flights at most and at least, where nobody says how many
_WORK = 2_500_000  # samples times outputs times unknowns of all flights together: about a second
_STEPS = 10  # of Gauss-Newton: from the point that was flown few are needed
HOLDS, FAR = 1.96, 4.0  # standard errors within which 95 % lie, and beyond which an estimate is wrong


@dataclass(frozen=True, eq=False)
class Reflown:
    """Estimates from flights of a model."""

    names: tuple[str, ...]  # (k,) of the free parameters
    flown: FloatArray  # (k,) what flew
    stated: FloatArray  # (k,) standard errors that the estimator stated of the records
    estimates: FloatArray  # (flights, k)
    failed: int  # flights that gave no estimate

    @property
    def bias(self) -> FloatArray:
        """Mean error (k,)."""
        return np.asarray(self.estimates.mean(axis=0) - self.flown)

    @property
    def scatter(self) -> FloatArray:
        """Standard deviation (k,)."""
        return np.asarray(self.estimates.std(axis=0, ddof=1))

    @property
    def held(self) -> FloatArray:
        """Share (k,) of flights whose 95 % interval holds what flew."""
        return np.asarray(np.mean(np.abs(self.estimates - self.flown) <= HOLDS * self.stated, axis=0))

    @property
    def wrong(self) -> float:
        """Share of flights in which some estimate is off by more than four of its standard errors, widened."""
        wide = np.sqrt(self.stated**2 + self.added)
        return float(np.mean(np.any(np.abs(self.estimates - self.flown) > FAR * wide, axis=1)))

    @property
    def added(self) -> FloatArray:
        """Variance (k,) that flights show beyond what is stated, where it is more than their own number explains."""
        found = np.mean((self.estimates - self.flown) ** 2, axis=0)
        # Two standard errors of a mean square of so many normal values.
        chance = 1.0 + 2.0 * np.sqrt(2.0 / len(self.estimates))
        return np.where(found > chance * self.stated**2, found - self.stated**2, 0.0)


def surrogate(left: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return noise (n, p) with the spectra and cross-spectra of ``left`` (n, p) and random phases.

    Example:
        >>> rng = np.random.default_rng(1)
        >>> surrogate(np.array([[1.0], [-1.0], [1.0], [-1.0]]), rng).std()
        1.0
    """
    spectrum = np.fft.rfft(left, axis=0)
    turned = spectrum * np.exp(2j * np.pi * rng.random(len(spectrum)))[:, None]
    # A fit leaves no mean, but noise has one, as large as its slowest motion is.
    turned[0] = np.sqrt(2.0) * (spectrum[1] * np.exp(2j * np.pi * rng.random())).real
    if len(left) % 2 == 0:
        turned[-1] = spectrum[-1] * rng.choice([-1.0, 1.0])  # real, as the mean
    return np.asarray(np.fft.irfft(turned, len(left), axis=0))


def reflown(
    model: ParametricModel,
    records: Sequence[FlightRecord],
    rng: np.random.Generator,
    flights: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Reflown | None:
    """Fly a model again and estimate it again; None of a model that is not by output error.

    Args:
        model: by output error, not yet widened by errors of instruments or form.
        records: prepared, that it was identified from.
        rng: draws what is laid over the flights.
        flights: how many; if not given as many as some second allows, 10 to 200.
        progress: called with the flights done and to be done.

    Raises:
        EstimationError: the model diverges over a record.
    """
    if model.method != "output_error":
        return None
    chosen = np.flatnonzero(model.structure.free)
    flown = [model.simulate(record) for record in records]
    left = [
        np.where((part := r.select(model.outputs)).valid, part.data - y, 0.0)
        for r, y in zip(records, flown, strict=True)
    ]
    # A fit leaves less than the noise was: as many samples fewer as it has unknowns.
    like = Likelihood.of(model, records)
    wide = float(np.sqrt(like.counts.sum() / max(like.counts.sum() - like.unknowns, 1)))
    low, high = like.bounds()
    estimates: list[FloatArray] = []
    failed, work = 0, int(like.counts.sum()) * like.unknowns
    count = max(FEWEST, min(MOST, _WORK // work)) if flights is None else flights
    for k in range(count):
        again = [
            r.with_columns(dict(zip(model.outputs, (y + wide * surrogate(e, rng)).T, strict=True)))
            for r, y, e in zip(records, flown, left, strict=True)
        ]
        try:
            one = Likelihood.of(model, again)
            problem = one.problem(model.params, model.noise_covariance)
            tolerance = 1e-3 / float(one.counts.sum())
            found = minimise(problem, one.start(model.params), low, high, tolerance=tolerance, max_iterations=_STEPS)
            estimates.append(one.parameters(found.point, model.params)[chosen])
        except (Refusal, np.linalg.LinAlgError):
            failed += 1
        if progress is not None:
            progress(k + 1, count)
    if len(estimates) < 2:
        return None
    return Reflown(
        tuple(model.structure.parameter_names[i] for i in chosen),
        model.params[chosen],
        np.sqrt(np.diag(model.covariance))[chosen],
        np.array(estimates),
        failed,
    )
