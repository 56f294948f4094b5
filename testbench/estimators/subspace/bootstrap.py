"""Uncertainty of a subspace estimate by a bootstrap over the residuals of its free run.

Moving-block bootstrap (H. R. Kuensch, "The jackknife and the bootstrap for general stationary observations", Annals of
Statistics 17(3), 1989): blocks of residuals, all outputs together, are drawn with replacement and added to the free run
of the model, and the whole identification is repeated. Blocks keep the colour of the residuals within their length.
The inputs stay as they are, so that inputs which react to the outputs are not covered.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.model import continuous_poles
from testbench.estimators.state_space import Series, StateSpaceModel, free_run
from testbench.estimators.subspace.data import LEAD, Stretch
from testbench.estimators.subspace.tail import pair

if TYPE_CHECKING:
    from testbench.estimators.settings import Subspace
    from testbench.estimators.subspace.data import Outcome

_POINTS = 50  # of the frequency grid


def spread(
    model: StateSpaceModel,
    out: Outcome,
    stretches: Sequence[Stretch],
    again: Subspace,
    identify: Callable[..., Outcome],
    sizes: tuple[FloatArray, FloatArray],
    replicas: int,
) -> dict[str, Any]:
    """Return deviations of poles and frequency response over replicas, as diagnostics.

    Args:
        model: the estimate in SI units.
        out: the same in units of the stretches.
        stretches: the scaled records.
        again: settings of a replica: order and stride fixed.
        identify: makes a model of scaled stretches, settings and a sample time.
        sizes: root mean squares of inputs (m,) and outputs (p,) that scaled the records.
        replicas: number of replicas, at least 2.

    Raises:
        EstimationError: fewer than two replicas succeed.
    """
    rng = np.random.default_rng(np.random.SeedSequence(again.seed))
    block = again.past_horizon + again.future_horizon
    lead = LEAD[again.offset]
    free = [free_run(out.A, out.B, out.C, out.D, Series(s.u, s.y, s.valid_y), lead) for s in stretches]
    residuals = [
        np.where(s.valid_y, s.y - y, 0.0) - np.mean(s.y - y, axis=0, where=s.valid_y | ~s.valid_y.any(axis=0))
        for s, y in zip(stretches, free, strict=True)
    ]
    (reference,) = model.poles().values()
    omega = np.geomspace(1e-3, 0.999, _POINTS) * np.pi / model.dt_s
    gains = sizes[1][:, None] / sizes[0]
    poles, responses, failed = [], [], 0
    for _ in range(replicas):
        drawn = []
        for s, y, rest in zip(stretches, free, residuals, strict=True):
            length = min(block, len(rest))
            starts = rng.integers(0, len(rest) - length + 1, size=-(-len(rest) // length))
            index = (starts[:, None] + np.arange(length)).ravel()[: len(rest)]
            drawn.append(s._replace(y=y + rest[index]))
        try:
            replica = identify(drawn, again, model.dt_s, bare=True)
        except EstimationError:
            failed += 1
            continue
        found = continuous_poles(np.linalg.eigvals(replica.A).astype(complex), model.dt_s)[0]
        if found.size != reference.size:
            failed += 1
            continue
        poles.append(pair(reference, found))
        z = np.exp(1j * omega * model.dt_s)[:, None, None]
        inner = np.linalg.solve(z * np.eye(len(replica.A)) - replica.A, replica.B.astype(complex))
        responses.append((replica.C @ inner + replica.D) * gains)
    if len(poles) < 2:
        raise EstimationError(
            f"a bootstrap needs at least 2 replicas that can be identified, got {len(poles)} of {replicas}; "
            "lower the order or give more data"
        )
    wn = np.abs(np.array(poles))
    zeta = -np.array(poles).real / np.maximum(wn, 1e-300)
    return {
        "bootstrap_reference_poles": reference,
        "wn_std": np.std(wn, axis=0, ddof=1),
        "zeta_std": np.std(zeta, axis=0, ddof=1),
        "poles_std": np.sqrt(np.sum(np.abs(np.array(poles) - reference) ** 2, axis=0) / (len(poles) - 1)),
        "response_omega_rad_s": omega,
        "response_std": np.std(np.array(responses), axis=0, ddof=1),
        "bootstrap_failed": failed,
    }
