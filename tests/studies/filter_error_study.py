"""Filter error in gusts and in calm air: how often its 95 % intervals hold the truth, and what form of noise it takes.

Run with ``python tests/studies/filter_error_study.py [SEEDS]``; it writes results/estimators/filter_error_gusts.csv.
The flights: a short period of 4 rad/s, 10 s at 25 Hz with 3-2-1-1 inputs without a pause. In gusts a first-order gust
of 0.02 rad and 3 s adds to the angle of attack of the forces; the angle of attack that is measured is inertial, or
that of a vane.
"""

import sys
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from smallest import results, sized
from tables import write_rows

from testbench.core.record import FlightRecord
from testbench.estimators.parametric import filter_error
from testbench.estimators.parametric.structures import short_period
from testbench.estimators.settings import FilterError

SEEDS = sized(50, 2)
DT_S, SAMPLES, SUBSTEPS = 0.04, 250, 60
TRUE = {"Z_alpha": -1.8, "Z_de": -0.12, "M_alpha": -14.0, "M_q": -2.6, "M_de": -18.0}
NOISE = np.array([0.004, 0.008])
GUST_RMS, GUST_TIME_S = 0.02, 3.0
FILE = results("estimators", "filter_error_gusts.csv")


def structure():
    """Return the short period that starts from the truth, no effect of the pitch rate on lift."""
    return short_period().with_parameters(TRUE).with_parameters({"Z_q": 0.0}, fixed=["Z_q"])


def elevator(samples: int = SAMPLES) -> np.ndarray:
    """Return elevator movements of 3, 2, 1, 1, 3, ... times 0.24 s and 0.05 rad, (samples,)."""
    u, k, sign = np.zeros(samples), 10, 1.0
    while k < samples:
        for n in (3, 2, 1, 1):
            u[k : k + 6 * n] = 0.05 * sign
            k, sign = k + 6 * n, -sign
    return u


def flight(seed: int, sensor: str, samples: int = SAMPLES) -> FlightRecord:
    """Return a record; ``sensor`` is "inertial" or "vane" in gusts, "calm" without."""
    rng = np.random.default_rng(seed)
    A = np.array([[TRUE["Z_alpha"], 1.0], [TRUE["M_alpha"], TRUE["M_q"]]])
    B, G = np.array([TRUE["Z_de"], TRUE["M_de"]]), A[:, 0]
    u, x, gust, h = elevator(samples), np.zeros(2), 0.0, DT_S / SUBSTEPS
    rms = 0.0 if sensor == "calm" else GUST_RMS
    X = np.zeros((samples, 2))
    for k in range(samples):
        X[k] = x + np.array([gust if sensor == "vane" else 0.0, 0.0])
        ahead = u[min(k + 1, samples - 1)]
        for j in range(SUBSTEPS):
            x = x + h * (A @ x + B * (u[k] + (ahead - u[k]) * (j + 0.5) / SUBSTEPS) + G * gust)
            gust += -h / GUST_TIME_S * gust + rms * np.sqrt(2.0 * h / GUST_TIME_S) * rng.standard_normal()
    data = np.column_stack([u, X + NOISE * rng.standard_normal(X.shape)])
    return FlightRecord(DT_S * np.arange(samples), ("de", "alpha", "q"), data, "measured")


def rows(seeds: int) -> list[dict[str, object]]:
    """Return a row per flight condition, model and parameter."""
    out = []
    for sensor in ("inertial", "vane", "calm")[: sized(None, 1)]:
        records = [flight(seed, sensor) for seed in range(seeds)]
        for model in ("auto", "diagonal", "full"):
            fits = [
                filter_error.estimate([r], structure(), FilterError(process_noise_model=model, held=()))
                for r in records
            ]
            taken = Counter(fit.diagnostics["process_noise_model"] for fit in fits)
            silent = sum(
                fit.status == "good" and any(abs(fit.values[n] - TRUE[n]) > 4.0 * fit.standard_errors[n] for n in TRUE)
                for fit in fits
            )
            for name, true in TRUE.items():
                values = np.array([fit.values[name] for fit in fits])
                errors = np.array([fit.standard_errors[name] for fit in fits])
                out.append(
                    {
                        "flight": sensor,
                        "process_noise_model": model,
                        "parameter": name,
                        "true": true,
                        "bias_percent": round(100.0 * float(values.mean() / true - 1.0), 1),
                        "scatter_percent": round(100.0 * float(values.std(ddof=1) / abs(true)), 1),
                        "claimed_percent": round(100.0 * float(np.sqrt(np.mean(errors**2)) / abs(true)), 1),
                        "held_percent": round(100.0 * float(np.mean(np.abs(values - true) < 1.96 * errors)), 0),
                        "four_errors_off_in_silence": f"{silent}/{seeds}",
                        "taken": "; ".join(f"{n} {c}" for n, c in sorted(taken.items())),
                    }
                )
            print(
                sensor,
                model,
                [(r["parameter"], r["bias_percent"], r["held_percent"]) for r in out[-5:]],
                taken,
                silent,
                flush=True,
            )
    return out


def main() -> None:
    """Write the table."""
    found = rows(int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS)
    write_rows(FILE, found[0], found)


if __name__ == "__main__":
    main()
