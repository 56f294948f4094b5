"""Linear models of motion from equation error: x' = A x + B u + offset, one regression per state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.core.advice import Advised, ranked
from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.model import ComplexArray
from testbench.estimators.regression.data import RegressionData
from testbench.estimators.regression.equation_error import equation_error
from testbench.estimators.regression.result import RegressionResult

_RATES = {"alpha": "alphadot", "beta": "betadot", "p": "pdot", "q": "qdot", "r": "rdot"}


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearModel(Advised):
    """x' = A x + B u + offset in SI units.

    Attributes:
        states: (n,) names.
        inputs: (m,) names.
        A: (n, n), rad and s.
        B: (n, m).
        offset: (n,).
        A_std: (n, n) standard errors, corrected for coloured residuals.
        B_std: (n, m).
        results: (n,) regressions of the state derivatives.
        advice: that of all regressions; ``status`` follows from it.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    A: FloatArray
    B: FloatArray
    offset: FloatArray
    A_std: FloatArray
    B_std: FloatArray
    results: tuple[RegressionResult, ...]
    advice: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("A", "B", "offset", "A_std", "B_std"):
            array = np.array(getattr(self, name), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def poles(self) -> ComplexArray:
        """Return the eigenvalues of A, rad/s, by magnitude."""
        found = np.linalg.eigvals(self.A).astype(np.complex128)
        return found[np.lexsort((found.imag, np.abs(found)))]


def linear_model(
    data: RegressionData | Sequence[RegressionData], *, states: Sequence[str], inputs: Sequence[str]
) -> LinearModel:
    """Regress each state's derivative on all states and inputs, e.g. ("alpha", "q") on ("de",): the short period.

    Args:
        data: signals of one or several records.
        states: some of alpha, beta, p, q, r.
        inputs: controls.

    Raises:
        EstimationError: a state without a derivative in the table, or against ``equation_error``.
        ChannelError: a signal is not there.
    """
    for state in states:
        if state not in _RATES:
            raise EstimationError(f"states must be some of {', '.join(_RATES)}, got '{state}'")
    terms = [*states, *inputs]
    results = tuple(equation_error(data, _RATES[state], terms) for state in states)
    if not results:
        raise EstimationError("a linear model needs at least one state, got none")
    n = len(states)
    params, std = np.array([r.params for r in results]), np.array([r.std_corrected for r in results])
    advice = tuple(a.about(r.target) for r in results for a in ranked(r.advice))
    return LinearModel(
        states=tuple(states),
        inputs=tuple(inputs),
        A=params[:, :n],
        B=params[:, n:-1],
        offset=params[:, -1],
        A_std=std[:, :n],
        B_std=std[:, n:-1],
        results=results,
        advice=advice,
    )
