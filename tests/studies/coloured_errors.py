"""How errors corrected for coloured residuals fall short in short records: scatter over stated error.

Run with ``python tests/studies/coloured_errors.py``. A linear regression on a constant and four responses to square
waves, with noise of correlation time tau (s) in records of T (s), 60 records each. Ratios are rms error over rms stated
error: for white noise, corrected for colour alone ("corrected": :meth:`Colour.score`), and as the parametric methods
tell them ("told": the same times what :func:`shortfall` simulates). The table is
results/estimators/coloured_errors.csv.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from smallest import results, sized
from tables import write_rows

from testbench.estimators.parametric.accuracy import coloured_covariance
from testbench.estimators.parametric.gauss_newton import Sensitivities
from testbench.estimators.residuals import coloured_information, corrected_covariance

OUT = results("estimators", "coloured_errors.csv")
STEP_S, SEEDS, SETTLE = 0.04, sized(60, 2), 500
Floats = NDArray[np.float64]


def regressors(n: int) -> Floats:
    """Return (n, 5): a constant, and first-order responses to square waves."""
    t = np.arange(n) * STEP_S
    waves = ((1.0, 8.0), (2.0, 3.1), (4.0, 1.7), (0.5, 9.3))  # bandwidth in rad/s, period in s
    moved = [lfilter([STEP_S], [1.0, STEP_S * w - 1.0], np.sign(np.sin(2.0 * np.pi * t / q))) for w, q in waves]
    return np.column_stack([np.ones(n), *moved])


def row(tau: float, length: float, rng: np.random.Generator) -> dict[str, float]:
    """Return the ratios and the coverages of the 95 % interval for one correlation time and record length."""
    n = round(length / STEP_S)
    X = regressors(n)
    inverse = np.asarray(np.linalg.inv(X.T @ X), dtype=np.float64)
    H = inverse @ X.T
    errors = []
    variances: dict[str, list[Floats]] = {"white": [], "corrected": [], "told": []}
    felt = [Sensitivities.of_all(X[:, None, :])]
    for _ in range(SEEDS):
        e = lfilter([1.0], [1.0, -np.exp(-STEP_S / tau) if tau else 0.0], rng.standard_normal(n + SETTLE))[SETTLE:]
        v = e - X @ (H @ e)
        errors.append(H @ e)
        R = v @ v / (n - X.shape[1])
        plain, residuals = inverse * R, [v[:, None]]
        score = coloured_information([X[:, None, :] / R], residuals)
        told = coloured_covariance(residuals, lambda: felt, np.array([[R]]), plain, np.zeros(X.shape[1]))
        variances["white"].append(np.diag(plain))
        variances["corrected"].append(np.diag(corrected_covariance(plain, score)))
        variances["told"].append(np.diag(told))
    off = np.array(errors)
    out = {"tau_s": tau, "length_s": length}
    for name, listed in variances.items():
        each = np.array(listed)
        out[f"{name}_ratio"] = round(float(np.sqrt((off**2).mean(axis=0) / each.mean(axis=0)).mean()), 2)
        out[f"{name}_held_percent"] = round(100.0 * float((np.abs(off) < 1.96 * np.sqrt(each)).mean()), 1)
    return out


def main() -> None:
    """Write the table."""
    rng = np.random.default_rng(1)
    found = [row(tau, length, rng) for tau in (0.0, 0.3, 1.0) for length in (10.0, 40.0)]
    write_rows(OUT, found[0], found)


if __name__ == "__main__":
    main()
