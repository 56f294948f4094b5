"""How errors corrected for coloured residuals fall short in short records: scatter over stated error.

Run with ``python tests/studies/coloured_errors.py``. A linear regression on a constant and four responses to square
waves, with noise of correlation time tau (s) in records of T (s), 40 records each. Ratios are rms error over rms stated
error: for white noise, as :func:`coloured_information` corrects, the same times the equation error's correction for k
fitted parameters ("leverage"), and the same divided by its own expected shortfall in 8 simulations of the fitted
autoregression ("bootstrap"; B. Efron and R. J. Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 10). The
table is results/estimators/coloured_errors.csv.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from testbench.estimators.residuals import autoregression, coloured_information, corrected_covariance

OUT = Path(__file__).resolve().parents[2] / "results" / "estimators" / "coloured_errors.csv"
STEP_S, SEEDS, DRAWS, SETTLE = 0.04, 40, 8, 500
Floats = NDArray[np.float64]


def regressors(n: int) -> Floats:
    """Return (n, 5): a constant, and first-order responses to square waves."""
    t = np.arange(n) * STEP_S
    waves = ((1.0, 8.0), (2.0, 3.1), (4.0, 1.7), (0.5, 9.3))  # bandwidth in rad/s, period in s
    moved = [lfilter([STEP_S], [1.0, STEP_S * w - 1.0], np.sign(np.sin(2.0 * np.pi * t / q))) for w, q in waves]
    return np.column_stack([np.ones(n), *moved])


def leverage(X: Floats, H: Floats) -> Floats:
    """Return (k,) the correction for fitted parameters as equation error has it."""
    size = 4 * len(X)
    share = (np.abs(np.fft.fft(np.linalg.qr(X)[0], size, axis=0)) ** 2).sum(axis=1) / len(X)
    W = np.abs(np.fft.fft(H.T, size, axis=0)) ** 2
    return np.asarray(W.sum(axis=0) / (W * (1.0 - share)[:, None]).sum(axis=0))


def row(tau: float, length: float, rng: np.random.Generator) -> dict[str, float]:
    """Return the ratios and the coverages of the 95 % interval for one correlation time and record length."""
    n = round(length / STEP_S)
    X = regressors(n)
    plain = np.asarray(np.linalg.inv(X.T @ X), dtype=np.float64)
    H = plain @ X.T
    errors = []
    variances: dict[str, list[Floats]] = {"white": [], "corrected": [], "leverage": [], "bootstrap": []}

    def corrected(v: Floats) -> Floats:
        score = coloured_information([X[:, None, :]], [v[:, None]])
        return np.diag(corrected_covariance(plain, score))

    for _ in range(SEEDS):
        e = lfilter([1.0], [1.0, -np.exp(-STEP_S / tau) if tau else 0.0], rng.standard_normal(n + SETTLE))[SETTLE:]
        v = e - X @ (H @ e)
        errors.append(H @ e)
        found, model = corrected(v), autoregression([v[:, None]])
        a = np.concatenate([[1.0], -model.A[:, 0, 0]])
        drawn = []
        for _ in range(DRAWS):
            x = lfilter([1.0], a, np.sqrt(model.S[0, 0]) * rng.standard_normal(n + SETTLE))[SETTLE:]
            drawn.append(corrected(x - X @ (H @ x)))
        variances["white"].append(np.diag(plain) * (v @ v) / (n - X.shape[1]))
        variances["corrected"].append(found)
        variances["leverage"].append(found * leverage(X, H))
        variances["bootstrap"].append(found**2 / np.mean(drawn, axis=0))
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
    with OUT.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, found[0])
        writer.writeheader()
        writer.writerows(found)


if __name__ == "__main__":
    main()
