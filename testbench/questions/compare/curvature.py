"""Can a bound be believed that takes the model as linear in its parameters over the errors that it predicts?

Along each principal direction d_i of the predicted covariance, one standard error long, the response and the targets
bend by

    c_i = (y(p + d_i) + y(p - d_i)) / 2 - y(p),

which moves an estimate by e_i z^2, z standard normal, e_i being the estimator's answer to c_i: terms of second order,
as of M. J. Box, Journal of the Royal Statistical Society B 33(2), 1971. Their share of the standard error,
(2 sum e_i^2)^1/2 over it, says how far it can be believed. Terms of two directions at once are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from testbench.core.record import FloatArray
from testbench.information.aircraft_structure import AircraftStructure
from testbench.information.fisher import Accuracy
from testbench.information.targets import Targets

Answer = Callable[[FloatArray], FloatArray]


def second_order_share(
    response: Callable[[FloatArray], FloatArray],
    structure: AircraftStructure,
    aims: Targets,
    poles: Mapping[str, complex],
    known: Accuracy,
    answer: Answer,
) -> FloatArray:
    """Return the terms of second order over the standard errors (t,) of the targets; inf where nothing is known.

    Args:
        response: parameters (k,) -> outputs (N, p) in units of the sensors' noise; not finite where the aircraft
            diverges.
        structure: the aircraft.
        aims: the targets.
        poles: name -> true pole, rad/s, of the modes among it.
        known: predicted errors of the parameters.
        answer: what the estimator makes of residuals (N, p, r) in units of the sensors' noise: errors (k, r).
    """
    std = aims.errors(known)
    if not np.all(np.isfinite(known.std)):
        return np.full(std.size, np.inf)
    size = known.std
    values, vectors = np.linalg.eigh(known.covariance / np.outer(size, size))
    directions = size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    true = structure.true
    y0 = response(true)
    bends, turns = [], []
    for d in directions.T:
        bends.append(0.5 * (response(true + d) + response(true - d)) - y0)
        if not np.all(np.isfinite(bends[-1])):  # within its errors the aircraft may diverge
            return np.full(std.size, np.inf)
        f0, up, down = (_values(structure, aims.names, poles, p) for p in (true, true + d, true - d))
        turns.append(0.5 * (up + down) - f0)
    moved = answer(np.stack(bends, axis=2))
    squares = np.sum((aims.jacobian @ moved + np.stack(turns, axis=1)) ** 2, axis=1)
    return np.asarray(np.sqrt(2.0 * squares) / std)


def _values(
    structure: AircraftStructure, targets: Sequence[str], modes: Mapping[str, complex], params: FloatArray
) -> FloatArray:
    """Return the targets (t,) of parameters (k,): of each mode the root nearest to the true one."""
    poles = np.linalg.eigvals(structure.matrices(params).A)
    names = structure.parameter_names
    out = np.empty(len(targets))
    for k, name in enumerate(targets):
        kind, _, mode = name.partition(" of ")
        if not mode:
            out[k] = params[names.index(name)]
            continue
        s = poles[int(np.argmin(np.abs(poles - modes[mode])))]
        out[k] = abs(s) if kind == "wn" else -s.real / abs(s)
    return out
