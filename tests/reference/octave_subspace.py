"""Poles by SLICOT's moen4 and n4sid (GNU Octave, control package) on simulated data, stored in octave_subspace.json.

Run as a script, with Octave and its control package at hand, to make the file anew; the tests read it and make the
same data again. Data: PRBS inputs, orders 2 and 4, one or two inputs, exact and with 5 % noise on the outputs.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
STORED = HERE / "octave_subspace.json"
HORIZON = 12

_SECOND = (np.array([[0.9, 0.2], [-0.2, 0.85]]), np.array([[0.2], [1.0]]), np.eye(2))
_FOURTH = (
    np.array([[0.85, 0.3, 0.0, 0.1], [-0.3, 0.85, 0.0, 0.0], [0.0, 0.0, 0.97, 0.08], [0.0, 0.0, -0.08, 0.97]]),
    np.array([[0.3, 0.0], [1.0, 0.2], [0.0, 0.1], [0.05, 0.2]]),
    np.array([[1.0, 0.0, 0.5, 0.0], [0.0, 1.0, 0.0, 0.3], [0.2, 0.0, 1.0, 0.0]]),
)
CASES = {
    "second_exact": (*_SECOND, 0.0),
    "second_noisy": (*_SECOND, 0.05),
    "fourth_exact": (*_FOURTH, 0.0),
    "fourth_noisy": (*_FOURTH, 0.05),
}


def data(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return inputs (1500, m) and outputs (1500, p) of a case."""
    A, B, C, noise = CASES[name]
    rng = np.random.default_rng(sorted(CASES).index(name))
    u = np.repeat(rng.choice([-1.0, 1.0], size=(500, B.shape[1])), 3, axis=0)
    x, y = np.zeros(len(A)), np.empty((1500, len(C)))
    for k in range(1500):
        y[k] = C @ x
        x = A @ x + B @ u[k]
    return u, y + noise * y.std(axis=0) * rng.standard_normal(y.shape)


def main() -> None:
    """Run Octave and store what it finds."""
    stored = {}
    with tempfile.TemporaryDirectory() as folder:
        lines = []
        for name, (A, B, _, _) in CASES.items():
            np.savetxt(Path(folder) / f"{name}.csv", np.hstack(data(name)), fmt="%.17g", delimiter=",")
            lines.append(f"{name},{B.shape[1]},{len(A)},{HORIZON}")
        (Path(folder) / "cases.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
        subprocess.run(["octave-cli", str(HERE / "octave_subspace.m"), folder], check=False)
        for name in CASES:
            for method in ("moen4", "n4sid"):
                poles = np.loadtxt(Path(folder) / f"{name}_{method}.csv", delimiter=",", ndmin=2)
                stored[f"{name}_{method}"] = sorted(poles.tolist())
    STORED.write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
