"""The one form in which an identified model is exported, whatever the estimator: deviations from trim,

    dx/dt = A x + B u  or  x[k+1] = A x[k] + B u[k],    y = C x + D u,

with dead times tau_ij from input j to output i besides.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import factorial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbench.core.advice import Advised, from_json
from testbench.core.channels import channel
from testbench.core.door import read_json
from testbench.core.errors import RecordError, located
from testbench.core.files import parsed
from testbench.core.paths import not_found
from testbench.core.record import FloatArray

PADE = 4  # order of a dead time in continuous time: right to 1 deg up to w tau = 4.5


@dataclass(frozen=True, eq=False)
class Matrices(Advised):
    """A model in the form above.

    Attributes:
        name, method: of the file and of the estimator.
        inputs, outputs: channel names (m,) and (p,).
        A, B, C, D: (n, n), (n, m), (p, n), (p, m).
        dt_s: sample time; 0 for continuous time.
        delays_s: (p, m) dead times, whole samples in discrete time.
        advice: that of the estimator; ``status`` follows from it.
    """

    name: str
    method: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    dt_s: float
    delays_s: FloatArray
    advice: tuple[str, ...]


def load_matrices(path: Path | str) -> Matrices:
    """Return the matrices of a model file that ``testbench run`` or ``testbench identify`` wrote (models/*.json).

    Raises:
        RecordError: the file is missing, damaged, or none of a model with matrices or transfer functions.
    """
    path = Path(path)
    if not path.is_file():
        raise RecordError(f"a model must be a file that exists, got {not_found(path)}")
    content = read_json(path, "model")
    kinds = {"A": _of_state_space, "denominators": _of_transfer_functions}
    kind = next((key for key in kinds if isinstance(content, dict) and key in content), None)
    if kind is None:
        raise RecordError(
            f"'{path}' must hold a model with matrices or transfer functions (models/*.json of a run), but it does not"
        )
    with parsed(path, "a complete model file"):
        model = kinds[kind](path.stem, content)
    with located(path, "inputs and outputs"):
        for name in (*model.inputs, *model.outputs):
            channel(str(name))
    n, p, m = len(model.A), len(model.outputs), len(model.inputs)
    shapes = {"A": (n, n), "B": (n, m), "C": (p, n), "D": (p, m), "delays_s": (p, m)}
    for name, shape in shapes.items():
        found = getattr(model, name)
        if found.shape != shape or not np.all(np.isfinite(found)):
            raise RecordError(f"{name} of '{path}' must be finite and of shape {shape}, got shape {found.shape}")
    return model


def _of_state_space(name: str, content: Mapping[str, Any]) -> Matrices:
    A, B, C, D = (np.array(content[key], float) for key in "ABCD")
    p, m = len(content["outputs"]), len(content["inputs"])
    n = len(A)
    delays = np.tile(np.array(content.get("delays_s", [0.0] * m), float), (p, 1))
    return _matrices(name, content, A.reshape(n, n), B.reshape(n, m), C.reshape(p, n), D.reshape(p, m), delays)


def _of_transfer_functions(name: str, content: Mapping[str, Any]) -> Matrices:
    """Realise one block per output: denominators are its own."""
    outputs, discrete = content["outputs"], content["time"] == "discrete"
    if discrete:  # by output, one input, b1 ... bn against 1, a1 ... an
        above = np.array([[[0.0, *content["numerators"][o]]] for o in outputs], float)
        below = np.array([content["denominators"][o] for o in outputs], float)
        delays = float(content["dt_s"]) * np.array([[content["delays"][o]] for o in outputs], float)
    else:
        above, below = np.array(content["numerators"], float), np.array(content["denominators"], float)
        delays = np.array(content["delays_s"], float)
    blocks = [
        _companion(*(_without_zeros(above[i], below[i]) if discrete else (above[i], below[i])))
        for i in range(len(outputs))
    ]
    m, n = above.shape[1], sum(len(block[0]) for block in blocks)
    A, B, C = np.zeros((n, n)), np.zeros((n, m)), np.zeros((len(outputs), n))
    at = 0
    for i, (a, b, c, _) in enumerate(blocks):
        own = slice(at, at + len(a))
        A[own, own], B[own], C[i, own] = a, b, c
        at += len(a)
    return _matrices(name, content, A, B, C, np.stack([d for *_, d in blocks]), delays)


def _without_zeros(above: FloatArray, below: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a discrete transfer function without the powers of z that cancel."""
    while below.size > 1 and below[-1] == 0.0 and not np.any(above[:, -1]):
        above, below = above[:, :-1], below[:-1]
    return above, below


def _companion(above: FloatArray, below: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return A (n, n), B (n, m), c (n,), d (m,) of one output: the observable companion form.

    Args:
        above: (m, n + 1) numerators, highest power first.
        below: (n + 1,) denominator, zeros first where its degree is lower.
    """
    lead = int(np.flatnonzero(below)[0])
    if np.any(above[:, :lead] != 0.0):
        raise ValueError("a numerator must not be of a higher degree than its denominator")
    a, b = below[lead + 1 :] / below[lead], above[:, lead:] / below[lead]
    n = a.size
    A = np.eye(n, k=1)
    A[:, 0] = -a
    c = np.zeros(n)
    c[:1] = 1.0
    return A, (b[:, 1:] - b[:, :1] * a).T, c, b[:, 0]


def _matrices(
    name: str, content: Mapping[str, Any], A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, tau: FloatArray
) -> Matrices:
    dt = float(content["dt_s"]) if content["time"] == "discrete" else 0.0
    inputs, outputs = tuple(content["inputs"]), tuple(content["outputs"])
    advice = from_json(content.get("advice", ()))
    return Matrices(name, str(content["method"]), inputs, outputs, A, B, C, D, dt, tau, advice)


def without_delays(model: Matrices) -> Matrices:
    """Return the model with its dead times as states: Pade in continuous, exact in discrete time."""
    tau = model.delays_s
    if not np.any(tau > 0.0):
        return model
    p, m = tau.shape
    alike = bool(np.all(tau == tau[0]))
    blocks = [_delayed(model, np.arange(p) if alike else np.array([i])) for i in range(1 if alike else p)]
    sizes = [len(a) for a, *_ in blocks]
    A, B = np.zeros((sum(sizes), sum(sizes))), np.vstack([b for _, b, _, _ in blocks])
    C, D = np.zeros((p, sum(sizes))), np.vstack([d for *_, d in blocks])
    at = row = 0
    for a, _, c, _ in blocks:
        A[at : at + len(a), at : at + len(a)], C[row : row + len(c), at : at + len(a)] = a, c
        at, row = at + len(a), row + len(c)
    return replace(model, A=A, B=B, C=C, D=D, delays_s=np.zeros((p, m)))


def _delayed(model: Matrices, rows: NDArray[np.intp]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return A, B, C, D of the outputs ``rows``, which share their dead times, behind these."""
    A, B, C, D = model.A, model.B.copy(), model.C[rows], model.D[rows].copy()
    for j, tau in enumerate(model.delays_s[rows[0]]):
        if tau <= 0.0:
            continue
        a, b, c, d = _dead_time(float(tau), model.dt_s)
        A = np.block([[A, np.outer(B[:, j], c)], [np.zeros((len(a), len(A))), a]])
        C = np.hstack([C, np.outer(D[:, j], c)])
        B = np.vstack([B, np.zeros((len(a), B.shape[1]))])
        B[:, j] *= d
        B[-len(a) :, j] = b
        D[:, j] *= d
    return A, B, C, D


def _dead_time(tau: float, dt_s: float) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return A, b, c, d of a dead time."""
    if dt_s:
        n = round(tau / dt_s)
        return np.eye(n, k=1), np.eye(n)[-1], np.eye(n)[0], 0.0
    n = PADE  # coefficients: G. H. Golub, C. F. Van Loan, Matrix Computations, 4th ed. 2013, sec. 9.3.1
    k = np.arange(n, -1, -1)
    size = np.array([factorial(2 * n - i) / (factorial(i) * factorial(n - i)) for i in k.tolist()])
    A, B, c, d = _companion(np.array([size * (-tau) ** k]), size * tau**k)
    return A, B[:, 0], c, float(d[0])
